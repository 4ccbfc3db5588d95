"""Truths in closed form: formulas that are exact up to rounding."""
