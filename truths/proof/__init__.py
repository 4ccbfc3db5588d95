"""Truths with a proof: intervals that contain the exact value, computed in ball arithmetic (python-flint).

===================  ========================================================================================
`motion`             the motion of a scene: `prove_scene`; one `step` of it
`threshold`          the stick threshold on F0 as a theorem
`complementarity`    verified solutions of complementarity problems, or a proof that there is none; `verification` of
                     a solver by them
`certificate`        claims as a file that is checked by proving them again: `motion_certificate`, the same as
                     polynomials `truth_certificate`, `threshold_certificate`
===================  ========================================================================================

They use the reduced `mechanisms` and the `enclosures`. `truth` reads the proven motions and thresholds that come with
the suite, without python-flint. All other modules need the extra ``stiction[proof]``.
"""
