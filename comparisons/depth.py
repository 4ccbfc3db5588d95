"""How far `stiction validate` goes; what each depth runs is data of ``campaigns/validation.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal


class Depth(StrEnum):
    """From a smoke test, over what a person waits for, to all there is."""

    QUICK = "quick"
    DEFAULT = "default"
    FULL = "full"

    def reaches(self, other: Depth) -> bool:
        """Whether what belongs to `other` is part of this one: each depth has all of the depths before it."""
        return list(Depth).index(self) >= list(Depth).index(other)


@dataclass(frozen=True)
class Extent:
    """What a depth runs.

    Attributes
    ----------
    limit : float
        Seconds that one run or measurement may take.
    runs, cost, threshold : Mapping[str, float]
        By parameter (``dt`` in s, ``rtol``, ``iterations``), the finest rung of the ladders for the runs that are compared, for work-precision
        diagrams, and for the stick threshold; all rungs where a parameter is not named.
    bracket : float
        N; width of a stick threshold's bracket.
    repeats : int
        Rounds in which runs are timed, at least; see `stiction.comparisons.timing.rounds`.
    ladder : float
        CPU seconds that all rounds of one ladder of a work-precision diagram may take on one scene: finer rungs are run, but not timed.
    sensitivity : bool
        Whether what the paper leaves open is varied.
    equal_error : bool
        Whether the cost of an error is measured on other mechanisms than the cases, too, and of variants that are not compared otherwise on all cases.
    settings : bool
        Whether the settings of the engines are tried: `stiction.comparisons.studies.engine_settings`.
    trajectories : {"drawn", "all"}
        Which runs are stored: those that a figure shows, or every one that is compared.
    """

    limit: float
    runs: Mapping[str, float]
    cost: Mapping[str, float]
    threshold: Mapping[str, float]
    bracket: float
    repeats: int
    ladder: float
    sensitivity: bool
    equal_error: bool
    settings: bool
    trajectories: Literal["drawn", "all"]


def down_to(ladder: tuple[float, ...], parameter: str, finest: Mapping[str, float]) -> tuple[float, ...]:
    """The rungs of a ladder that are no finer than the finest of an extent: no shorter step, no tighter tolerance, no more iterations."""
    limit = finest.get(parameter)
    if limit is None:
        return ladder
    return tuple(rung for rung in ladder if (rung <= limit if parameter == "iterations" else rung >= limit))
