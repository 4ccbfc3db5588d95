"""Studies of random scenes, which are judged one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a scene, or of one run of it: one of the study's."""

    outcome: str
    detail: str = ""
    """What differs, or who stops when and why"""
    about: str = ""
    """The scene in words, enough to draw it again"""


@dataclass(frozen=True)
class RandomScenes:
    """Way to judge random scenes: ``judge(seed, i, rtols)`` has the verdicts on scene i of a seed.

    The meanings of the outcomes are in order, best first; no scene may have those that are `failing`. `rtols` are the
    tolerances of the runs, `t_end` is the longest motion, s.
    """

    judge: Callable[[int, int, Sequence[float]], Sequence[SceneOutcome]]
    outcomes: Mapping[str, str]
    failing: tuple[str, ...]
    rtols: tuple[float, ...]
    t_end: float

    def judged(self, seed: int, first: int, count: int) -> Iterator[tuple[int, SceneOutcome]]:
        """Yield the numbers of scenes and their verdicts, one for each run."""
        for i in range(first, first + count):
            for verdict in self.judge(seed, i, self.rtols):
                yield i, verdict


def event_differences(
    expected: Sequence[Any], found: Sequence[Any]
) -> Iterator[tuple[str, str, float]]:
    """Yield events of two motions in words, one by one, and the difference of their times; infinite between kinds."""
    for one, other in zip_longest(expected, found):
        same = one is not None and other is not None and one.kind == other.kind
        words = [
            f"{event.kind} at {event.time:.9f} s" if event is not None else "none"
            for event in (one, other)
        ]
        yield words[0], words[1], abs(one.time - other.time) if same else np.inf
