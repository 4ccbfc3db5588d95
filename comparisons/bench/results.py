"""Results of studies: tables, runs, truths, settings and times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import pandas as pd

from stiction.comparisons.bench.complementarity.problems import Problem
from stiction.comparisons.bench.variants import Record
from stiction.scenes import Scene, catalogue, load_scene
from stiction.truths import Truth

PAPERS_CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
"""Names of the paper's three cases, in the order of its figures."""
SCENES_OF_PAPER = "scenes of the paper"
"""Setting of a campaign: names of its scenes that are cases of the paper."""
COMMAND = "command"
"""Setting of a single study: the command that made it; that of a campaign follows from other settings."""
NOT_APPLICABLE = "not applicable"
"""Setting of a campaign: by title of a study, the reason why it was not made."""


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
    scenes : Mapping[str, Scene]
        The simulated scenes by name, as they were simulated. Scenes that are part of the suite and
        have not been changed may be left out.
    """

    records: tuple[Record, ...]
    truths: Mapping[str, Truth]
    tables: Mapping[str, pd.DataFrame]
    settings: Mapping[str, Any] = field(default_factory=dict)
    wall_s: float = 0.0
    cpu_s: float = 0.0
    timed: tuple[Record, ...] = ()
    problems: tuple[Problem, ...] = ()
    scenes: Mapping[str, Scene] = field(default_factory=dict)

    def scene(self, name: str) -> Scene | None:
        """Return a simulated scene, or else the scene of the suite with this name; None if there is none."""
        return self.scenes.get(name) or scene_of_suite(name)

    def title_of(self, scene: str) -> str:
        """Return the title of a scene, or its name if it has no title."""
        declared = self.scene(scene)
        return declared.title if declared is not None and declared.title else scene

    def is_of_paper(self, scene: str) -> bool:
        """Return whether a scene is a case of the paper, and not another scene of the same name."""
        return scene in self.settings.get(SCENES_OF_PAPER, PAPERS_CASES)

    def is_papers_scheme_elsewhere(self, record: Record) -> bool:
        """Return whether a run is one of the paper's fixed-step scheme on a scene that is no case of the paper.

        The paper states that its scheme works for its own example. That it breaks down on another scene is a result
        about the scheme, as it is about any engine; it is no failure of the reference.
        """
        is_papers_scheme = record.variant.settings.get("method") == "paper"
        return is_papers_scheme and not self.is_of_paper(record.scene)

    @property
    def compared_scenes(self) -> list[str]:
        """The names of the scenes of the runs, each once.

        A study whose runs are not recorded, as that of the stick limit, has the scenes that were asked for.
        """
        if self.records:
            return list(dict.fromkeys(record.scene for record in self.records))
        return list(self.settings.get("scenes", ()))

    @property
    def unrecorded_runs(self) -> int:
        """The number of runs of methods if none is recorded: those of searches, which tables count in ``runs``."""
        if self.records:
            return 0
        counted = [
            table["runs"].sum()
            for table in self.tables.values()
            if {"runs", "variant", "status"} <= set(table)
        ]
        return int(sum(counted))

    @property
    def is_about_paper(self) -> bool:
        """True if all compared scenes are cases of the paper."""
        return all(map(self.is_of_paper, self.compared_scenes))

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


@cache
def scene_of_suite(name: str) -> Scene | None:
    """Return a scene of the catalogue, with its hard cases, or None. It is read once: reading takes 5 ms."""
    if name in catalogue() or name in catalogue("hard"):
        return load_scene(name)
    return None
