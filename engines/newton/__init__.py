"""Adapter of Newton, whose solvers run in single precision on Warp."""
