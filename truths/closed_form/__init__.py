"""Truths in closed form."""
