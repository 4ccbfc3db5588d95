"""Functional mock-up units (FMI 2 and 3) as engines, through fmpy."""
