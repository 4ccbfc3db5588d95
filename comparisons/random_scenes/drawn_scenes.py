"""Studies of random scenes, which are judged one by one."""

from __future__ import annotations

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
    judge : callable
        ``judge(seed, i, rtols)``: the verdicts on scene i of a seed.
    outcomes : Mapping of str to str
        Meanings of the outcomes, best first; no scene may have those that are `failing`.
    rtols : tuple of float
        Tolerances of the runs.
    t_end : float
        Longest motion, s.
    """

    judge: Judge
    outcomes: Mapping[str, str]
    failing: tuple[str, ...]
    rtols: tuple[float, ...]
    t_end: float

    def judged(self, seed: int, first: int, count: int) -> Iterator[tuple[int, SceneOutcome]]:
        """Yield the numbers of scenes and their verdicts, one for each run."""
        for i in range(first, first + count):
            for verdict in self.judge(seed, i, self.rtols):
                yield i, verdict
