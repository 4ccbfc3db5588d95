"""Depths of `stiction validate`: how many runs it makes; ``campaigns/validation.toml`` has the values."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from stiction.comparisons.bench.variants import Parameter
from stiction.scenes.fields import Model, Positive


class Depth(StrEnum):
    """Number of runs, in ascending order; each depth includes the runs of the depths before it."""

    QUICK = "quick"
    DEFAULT = "default"
    FULL = "full"

    def reaches(self, other: Depth) -> bool:
        """Return whether this depth includes the runs of another one."""
        order = list(Depth)
        return order.index(self) >= order.index(other)


Finest = dict[Parameter, Positive]
"""Finest value of a series, by parameter. A parameter that is not a key has no limit."""


class Extent(Model):
    """Limits of the runs of one depth."""

    limit: Positive
    """Time limit of one run or measurement, s."""
    runs: Finest = {}
    """Finest values of the runs that are compared."""
    cost: Finest = {}
    """Finest values of work-precision diagrams."""
    threshold: Finest = {}
    """Finest values for the stick threshold."""
    bracket: Positive
    """Width of the interval to which a stick threshold is narrowed down, N."""
    repeats: Annotated[int, Field(ge=1)]
    """Minimum number of timing rounds; see `stiction.comparisons.bench.timing.visits`."""
    ladder: Positive
    """CPU time of all rounds of one series of a work-precision diagram on one scene, s. The runs
    that exceed it are timed once."""
    sensitivity: bool
    """True to vary the values that the paper does not specify."""
    equal_error: bool
    """True to measure the time to equal error on further mechanisms, with all variants."""
    settings: bool
    """True to run the study of engine settings, `stiction.comparisons.studies.settings`."""
    trajectories: Literal["drawn", "all"]
    """Trajectories that are stored: those shown in figures, or those of all runs compared."""


def down_to(
    ladder: tuple[float, ...], parameter: str, finest: Mapping[str, float]
) -> tuple[float, ...]:
    """Return the values of a series up to the limit in `finest`, itself included.

    The limit is the largest number of iterations, or the smallest step or tolerance.
    """
    limit = finest.get(parameter)
    if limit is None:
        return ladder
    if parameter == "iterations":
        return tuple(count for count in ladder if count <= limit)
    return tuple(step for step in ladder if step >= limit)
