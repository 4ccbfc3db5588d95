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


FinestValues = dict[Parameter, Positive]
"""Finest value of each parameter that is refined: the smallest step or tolerance, or the largest number of iterations.
A parameter without an entry has no limit."""


class Extent(Model):
    """Limits of the runs of one depth, a table of ``campaigns/validation.toml``."""

    limit: Positive
    """Time limit of one run or measurement, s."""
    runs: FinestValues = {}
    """Finest values of the runs that are compared."""
    cost: FinestValues = {}
    """Finest values of work-precision diagrams."""
    threshold: FinestValues = {}
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


def limit_refinement(
    values: tuple[float, ...], parameter: str, finest: Mapping[str, float]
) -> tuple[float, ...]:
    """Return the values of a parameter that are not finer than its finest value.

    Parameters
    ----------
    values
        Steps (s), tolerances or numbers of iterations, from the coarsest to the finest.
    parameter
        Name of the parameter.
    finest
        Finest value by parameter, which is included; all values are returned for a parameter without an entry.
    """
    finest_value = finest.get(parameter)
    if finest_value is None:
        return values
    if parameter == "iterations":
        return tuple(count for count in values if count <= finest_value)
    return tuple(step for step in values if step >= finest_value)
