"""Figures of a report, drawn from what the studies present."""
