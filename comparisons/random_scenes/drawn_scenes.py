"""Random scenes, judged one by one and counted: the command line of the studies of this folder."""

from __future__ import annotations

import argparse
import secrets
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import pandas as pd

from stiction.child_processes import child_context
from stiction.engines.reference.engine import compile_kernels

SHOWN = 20
"""Scenes printed of each outcome but the best."""


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a scene, or of one run of it: one of the study's."""

    outcome: str
    detail: str = ""
    """What differs, or who stops when and why"""
    error: float = np.nan
    """Of `RandomScenes.measure`; nan without a comparison"""
    about: str = ""
    """The scene in words, enough to draw it again"""


class Judge(Protocol):
    """Function of a study that judges scene i of a seed."""

    def __call__(self, seed: int, i: int, /, rtols: Sequence[float]) -> Sequence[Sequence[SceneOutcome]]: ...


@dataclass(frozen=True)
class RandomScenes:
    """Way to judge random scenes."""

    module: str
    judge: Judge
    """``judge(seed, i, rtols)``: for each tolerance the verdicts on scene i of a seed; a module's, for child
    processes"""
    outcomes: Mapping[str, str]
    """Their meanings, best first"""
    failing: tuple[str, ...]
    """Outcomes that no scene may have"""
    measure: str
    """Name and unit of `SceneOutcome.error`"""
    rtols: tuple[float, ...]
    t_end: float
    """Longest motion, s"""

    def again(self, seed: int, i: int) -> str:
        """Command that judges scene i of a seed."""
        return f"python -m {self.module} --seed {seed} --first {i} --count 1"

    def table(self, verdicts: Iterable[SceneOutcome]) -> pd.DataFrame:
        """Table of the number of verdicts by outcome, their share, and the largest finite error."""
        found = pd.DataFrame(verdicts, columns=["outcome", "detail", "error", "about"])
        errors = found["error"].replace(np.inf, np.nan).groupby(found["outcome"])
        table = pd.DataFrame({"number": errors.size(), f"largest {self.measure}": errors.max()},
                             index=list(self.outcomes))
        table["number"] = table["number"].fillna(0).astype(int)
        table.insert(1, "share", table["number"] / max(len(found), 1))
        return table.rename_axis("outcome").reset_index()

    def judged(self, seed: int, scenes: Iterable[int], rtols: Sequence[float],
               processes: int = 1) -> Iterator[Sequence[Sequence[SceneOutcome]]]:
        """Verdicts on scenes in their order, for each tolerance."""
        compile_kernels()  # here, lest every process does it
        call = partial(self.judge, seed, rtols=tuple(rtols))
        if processes == 1:
            yield from map(call, scenes)
            return
        with ProcessPoolExecutor(processes, child_context()) as pool:
            yield from pool.map(call, scenes)

    def main(self, description: str, arguments: Sequence[str] | None = None) -> int:
        """Judge scenes as the command line says, print what is not best and a table; 1 if one is `failing`."""
        parser = argparse.ArgumentParser(prog=f"python -m {self.module}", description=description,
                                         formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--count", type=int, default=100, help="scenes")
        parser.add_argument("--first", type=int, default=0, help="the first scene of the seed")
        parser.add_argument("--seed", type=int, help="a fresh one if not given")
        parser.add_argument("--rtol", type=float, nargs="+", default=list(self.rtols), help="one or more")
        parser.add_argument("--processes", type=int, default=2)
        given = parser.parse_args(arguments)
        seed = secrets.randbits(32) if given.seed is None else given.seed
        print(f"seed {seed}", flush=True)
        best, shown = next(iter(self.outcomes)), Counter[tuple[float, str]]()
        found: dict[float, list[SceneOutcome]] = {rtol: [] for rtol in given.rtol}
        scenes = range(given.first, given.first + given.count)
        for by_rtol in self.judged(seed, scenes, given.rtol, given.processes):
            for rtol, verdicts in zip(given.rtol, by_rtol):
                found[rtol] += verdicts
                for verdict in verdicts:
                    shown[rtol, verdict.outcome] += 1
                    if verdict.outcome != best and shown[rtol, verdict.outcome] <= SHOWN:
                        print(f"rtol {rtol:g}: {verdict.outcome}: {verdict.detail}; {verdict.about}", flush=True)
        for rtol, verdicts in found.items():
            print(f"\nseed {seed}, {given.count} scenes, rtol {rtol:g}\n{self.table(verdicts).to_string(index=False)}")
        print("\n" + "\n".join(f"{outcome}: {meaning}" for outcome, meaning in self.outcomes.items()))
        failed = any(verdict.outcome in self.failing for verdicts in found.values() for verdict in verdicts)
        return int(failed or given.count < 1)
