"""Truths with a proof: intervals that contain the exact value, found in ball arithmetic (python-flint).

===================  ========================================================================================
`motion`             the motion of a scene: `prove_scene`; one `step` of it
`threshold`          the stick threshold on F0 as a theorem
`complementarity`    verified solutions of complementarity problems, or a proof that there is none; `verification` of
                     a solver by them
`certificate`        claims as a file that is checked by proving them again: `motion_certificate`, the same as
                     polynomials `truth_certificate`, `threshold_certificate`
===================  ========================================================================================

Beneath them: the reduced `mechanisms` and the `enclosures` that they are made of. `truth` reads what comes proven with
the suite, motions and thresholds, and takes no python-flint. All else needs the extra ``stiction[proof]``.
"""
