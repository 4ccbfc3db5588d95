"""Random scenes, judged one by one and counted: what every night does, and the command that judges some again."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a scene, or of one run of it: one of the study's."""

    outcome: str
    detail: str = ""
    """What differs, or who stops when and why"""
    error: float = np.nan
    """In the unit of the study; nan without a comparison"""
    about: str = ""
    """The scene in words, enough to draw it again"""


class Judge(Protocol):
    """Function of a study that judges scene i of a seed, at each tolerance."""

    def __call__(self, seed: int, i: int, /, rtols: Sequence[float]) -> Sequence[SceneOutcome]: ...


@dataclass(frozen=True)
class RandomScenes:
    """Way to judge random scenes.

    Attributes
    ----------
    module : str
        Name of the study's module.
    judge : callable
        ``judge(seed, i, rtols)``: the verdicts on scene i of a seed.
    outcomes : Mapping of str to str
        Meanings of the outcomes, best first; no scene may have those that are `failing`.
    rtols : tuple of float
        Tolerances of the runs.
    t_end : float
        Longest motion, s.
    """

    module: str
    judge: Judge
    outcomes: Mapping[str, str]
    failing: tuple[str, ...]
    rtols: tuple[float, ...]
    t_end: float

    def again(self, seed: int, i: int) -> str:
        """Command that judges scene i of a seed."""
        return f"python -m {self.module} {seed} {i}"

    def judged(self, seed: int, first: int, count: int) -> Iterator[tuple[int, SceneOutcome]]:
        """Yield the numbers of scenes and their verdicts, one for each run."""
        for i in range(first, first + count):
            for verdict in self.judge(seed, i, self.rtols):
                yield i, verdict

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Judge scenes as the command line says, print what is not best and counts; 1 if one is `failing`."""
        parser = argparse.ArgumentParser(prog=f"python -m {self.module}", description="Judge random scenes of a seed.")
        parser.add_argument("seed", type=int)
        parser.add_argument("first", type=int, help="number of the first scene")
        parser.add_argument("count", type=int, nargs="?", default=1)
        given = parser.parse_args(arguments)
        best, counts = next(iter(self.outcomes)), Counter[str]()
        for i, verdict in self.judged(given.seed, given.first, given.count):
            counts[verdict.outcome] += 1
            if verdict.outcome != best:
                print(f"{i}: {verdict.outcome}: {verdict.detail}; {verdict.about}", flush=True)
        for outcome, meaning in self.outcomes.items():
            print(f"{counts[outcome]} {outcome}: {meaning}")
        return int(any(counts[outcome] for outcome in self.failing))
