"""Stored complementarity problems: collected, replayed through any solver, exchanged as files."""
