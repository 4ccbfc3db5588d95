"""Depth of `stiction validate`; the runs of each are data of ``campaigns/validation.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from stiction.comparisons.bench.variants import Parameter
from stiction.scenes.fields import Model, Positive


class Depth(StrEnum):
    """From a smoke test, over what a person waits for, to all there is."""

    QUICK = "quick"
    DEFAULT = "default"
    FULL = "full"

    def reaches(self, other: Depth) -> bool:
        """Tell if what belongs to `other` is part of this one: each depth has all of the depths before it."""
        return list(Depth).index(self) >= list(Depth).index(other)


Finest = dict[Parameter, Positive]
"""Finest value of a refinement series by parameter; all values where a parameter is not named."""


class Extent(Model):
    """The runs of a depth."""

    limit: Positive
    """Seconds that one run or measurement may take."""
    runs: Finest = {}
    """Finest runs that are compared."""
    cost: Finest = {}
    """Finest runs of work-precision diagrams."""
    threshold: Finest = {}
    """Finest runs of the stick threshold."""
    bracket: Positive
    """N; width of a stick threshold's bracket."""
    repeats: Annotated[int, Field(ge=1)]
    """Rounds in which runs are timed, at least; see `stiction.comparisons.bench.timing.visits`."""
    ladder: Positive
    """CPU seconds that all rounds of one series of a work-precision diagram may take on one scene. Finer steps are
    timed once."""
    sensitivity: bool
    """Vary what the paper leaves open."""
    equal_error: bool
    """Measure the cost of an error on other mechanisms than the cases, too, and of all variants on all cases."""
    settings: bool
    """Try the settings of the engines: `stiction.comparisons.studies.settings`."""
    trajectories: Literal["drawn", "all"]
    """Runs that are stored: those that a figure shows, or every one that is compared."""


def down_to(
    ladder: tuple[float, ...], parameter: str, finest: Mapping[str, float]
) -> tuple[float, ...]:
    """Return the part of a series that is no finer than `finest`: no shorter step, no more iterations."""
    limit = finest.get(parameter)
    if limit is None:
        return ladder
    return tuple(
        step for step in ladder if (step <= limit if parameter == "iterations" else step >= limit)
    )
