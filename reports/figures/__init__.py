"""Figures of a report, drawn from the data that the studies present."""
