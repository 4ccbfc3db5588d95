"""Regressions: baselines, checks of changes, nightly runs and their history."""
