"""Results of studies: tables, runs, truths, settings and times."""

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
    """Results of one or several studies.

    Attributes
    ----------
    records : tuple of Record
        All runs that are compared, failed ones included.
    truths : Mapping[str, Truth]
        By name of the scene; the names of truths with mus = mu end with `variants.MUS_EQUALS_MU`.
    tables : Mapping[str, DataFrame]
        By name. Each study has a table of its own name, and lists further ones in `Study.tables`;
        the samples of all measured times are the table ``times``.
    settings : Mapping
        Settings of the campaign; among them are whether it was interrupted before all runs were
        executed, and the load of the machine.
    wall_s, cpu_s : float
        Wall time and CPU time of all runs, s.
    timed : tuple of Record
        Runs whose times are measured, for the studies of cost.
    problems : tuple of Problem
        Complementarity problems that the reference solved in the hard cases.
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
        """Return, by key of a run, the name of the truth that it was compared with."""
        truths = {}
        for table in self.tables.values():
            if "key" not in table or "truth" not in table:
                continue
            for key, truth in zip(table["key"], table["truth"]):
                if isinstance(truth, str):  # missing values are None or nan
                    truths[key] = truth
        return truths

    def table(self, name: str) -> pd.DataFrame:
        """Return a table with rows numbered from 0; it is empty if there is none with this name."""
        return self.tables.get(name, pd.DataFrame()).reset_index(drop=True)
