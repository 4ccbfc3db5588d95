"""Outcomes of random scenes, and the events of two motions side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a run of a scene."""

    outcome: str
    detail: str = ""
    """What differs, or who stops when and why"""
    about: str = ""
    """The scene in words"""


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
