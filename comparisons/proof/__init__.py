"""Truths with a proof: intervals that contain the exact value, found in ball arithmetic (python-flint).

===================  ========================================================================================
`proving`            the motion of a scene: `prove_scene`
`certificate`        a proven motion as a file, and its check
`truth_certificate`  the same as polynomials for truths, and its check
`threshold`          the stick threshold on F0 as a theorem; `threshold_certificate`, its file
`complementarity`    verified solutions of complementarity problems, or a proof that there is none
===================  ========================================================================================

Beneath them: `motion` (steps), the reduced `mechanisms` and the `enclosures` that they are made of; `tables` (what all
certificates share); `verification` (a solver over proven problems). `truth` and `theorems` read what comes proven with
the suite, motions and thresholds, and take no python-flint. All else needs the extra ``stiction[proof]``, and nothing
else of the project needs any of it.
"""
