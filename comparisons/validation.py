"""The main job: the paper's three cases through every variant, and the comparisons on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

from comparisons.truth import Truth
from comparisons.variants import Record

CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
MUS_EQUALS_MU = " (mus = mu)"
"""Ending of the key of a truth for engines without a static coefficient."""


@dataclass(frozen=True)
class Validation:
    """What the main job yields.

    Attributes
    ----------
    records : tuple of Record
        Every run, failures included.
    truths : Mapping[str, Truth]
        By name of the scene; with the ending `MUS_EQUALS_MU`, of the scene with mus = mu.
    tables : Mapping[str, DataFrame]
        ``accuracy``, ``drift``, ``threshold``, ``torque``, ``claims``.
    settings : Mapping
        Of the campaign: quick or not, engines, time limit, workers.
    wall_s, cpu_s : float
    """

    records: tuple[Record, ...]
    truths: Mapping[str, Truth]
    tables: Mapping[str, pd.DataFrame]
    settings: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0
    cpu_s: float = 0.0
