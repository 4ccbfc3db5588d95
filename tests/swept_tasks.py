"""Points of sweeps that hang and crash, in child processes; each child imports this file to find them."""

from __future__ import annotations

import os

from child_tasks import hang

from stiction.comparisons.studies.sweep import map_rows
from stiction.engines.reference.engine import ReferenceEngine

HANGING, CRASHING = 3.0, 4.0
"""Amplitudes F0, N."""


def treacherous_rows(scene, run, measures, points):
    """The rows of the map, unless a point is one that hangs or crashes."""
    for point in points:
        _betray(point["F0"])
    return map_rows(scene, run, measures, points)


class Treacherous(ReferenceEngine):
    """The reference as an engine of others."""

    def run(self, scene, **arguments):
        _betray(scene.parameters["F0"])
        return super().run(scene, **arguments)


def _betray(amplitude):
    if amplitude == HANGING:
        hang()
    if amplitude == CRASHING:
        os.abort()
