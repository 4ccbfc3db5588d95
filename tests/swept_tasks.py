"""Points of sweeps that hang and crash, in child processes; each child imports this file to find them."""

from __future__ import annotations

import os

from child_tasks import hang

from stiction.comparisons.studies.sweep import map_row

HANGING, CRASHING = 3.0, 4.0
"""Amplitudes F0, N."""


def treacherous_row(scene, run, measures, point):
    """The row of the map, unless the point is one that hangs or crashes."""
    if point["F0"] == HANGING:
        hang()
    if point["F0"] == CRASHING:
        os.abort()
    return map_row(scene, run, measures, point)
