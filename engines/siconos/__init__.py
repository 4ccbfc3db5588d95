"""Siconos (Inria), which the system's Python runs as a program of its own."""
