"""Measurement of the CPU time of runs."""
