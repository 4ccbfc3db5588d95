"""Truths with a proof: intervals that contain the exact value, found in ball arithmetic (python-flint, the extra ``stiction[proof]``).

===================  ========================================================================================
`proving`            the motion of a scene: `prove_scene`
`certificate`        a proven motion as a file, and its check
`truth_certificate`  the same as polynomials for truths, and its check
`threshold`          the stick threshold on F0 as a theorem
`complementarity`    verified solutions of complementarity problems, or a proof that there is none
===================  ========================================================================================

Beneath them: `motion` (steps), the reduced `mechanisms` and the `enclosures` that they are made of; `verification` (a solver over proven
problems). `truth` and `theorems` read what comes proven with the suite, motions and thresholds, and take no python-flint. Nothing else of the project
needs any of it.
"""
