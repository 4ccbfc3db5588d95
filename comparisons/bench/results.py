"""Results of the studies: tables, runs, truths, and the machine they were made on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from stiction.comparisons.bench.complementarity.problems import Problem
from stiction.comparisons.bench.variants import Record
from stiction.truths import Truth


@dataclass(frozen=True)
class Results:
    """Yield of the main job: every run, failures included, the truths, and tables by name.

    Truths have the names of their scenes; with the ending `variants.MUS_EQUALS_MU`, of the scene with mus = mu.
    Settings are those of the campaign, among them whether an interrupt left runs unmade, and the machine's load.
    `timed` are the runs behind ``cost``, ``effects`` and ``suppression``, `problems` the complementarity problems that
    the reference met in the hard cases.

    Attributes
    ----------
    tables : Mapping[str, DataFrame]
        ``accuracy``, ``drift``, ``study`` and ``octaves`` of drift over long runs, ``threshold``, ``torque``,
        ``claims`` and, in full, their ``sensitivity``, ``hard``; ``hold`` and its ``hold-..``; of the first scene
        ``orders``, ``effects``, ``suppression``; of all cases ``cost``, and ``times``: the samples behind all times;
        ``equal-error`` of all cases and, in full, of all of `stiction.comparisons.measures.equal_error.SCENES`; in full
        ``settings``: what the settings of the engines do, `stiction.comparisons.studies.settings`.
    """

    records: tuple[Record, ...]
    truths: Mapping[str, Truth]
    tables: Mapping[str, pd.DataFrame]
    settings: Mapping[str, Any] = field(default_factory=dict)
    wall_s: float = 0.0
    cpu_s: float = 0.0
    timed: tuple[Record, ...] = ()
    problems: tuple[Problem, ...] = ()

    def truth_of_runs(self) -> dict[str, str]:
        """Return the name of the truth that a run was compared with, by the run's key."""
        return {
            key: truth
            for table in self.tables.values()
            if {"key", "truth"} <= set(table.columns)
            for key, truth in zip(table["key"], table["truth"])
            if isinstance(truth, str)
        }

    def table(self, name: str) -> pd.DataFrame:
        """Return a table, rows numbered from 0 as in the data; an empty one where the study was not made."""
        return self.tables.get(name, pd.DataFrame()).reset_index(drop=True)
