"""Points of sweeps that hang and crash, in child processes; each child imports this file to find them."""

from __future__ import annotations

import os

from child_tasks import hang

from stiction.comparisons.studies.sweep import map_row
from stiction.engines.reference.engine import ReferenceEngine

HANGING, CRASHING = 3.0, 4.0
"""Amplitudes F0, N."""


def treacherous_row(scene, run, measures, point):
    """The row of the map, unless the point is one that hangs or crashes."""
    _betray(point["F0"])
    return map_row(scene, run, measures, point)


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
