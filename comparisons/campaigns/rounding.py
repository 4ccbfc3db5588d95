"""How far rounding alone moves each number of a run: the run made again with what nobody would call a change.

Masses and gravity are moved by some units in the last place, bodies stand in another order, samples are kept half as often. What such a run
gives differs from the run as another processor's, or another library's, does. A number that moves far has no value to hold a
night to: past a singular position, say, rounding decides which way a mechanism goes on.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.comparisons.campaigns.measurement import MOTION, OUTPUT_STEP, Metric, PlannedRun, Row, task_of_run
from stiction.comparisons.campaigns.tolerances import FURTHER
from stiction.engines.isolation import Outcome, Task
from stiction.scenes import Scene, vary

ULPS = 8
"""Units in the last place by which a number is moved at most: some operations' rounding."""
SEEDS = (1, 2, 3)
MOVED, ORDER, GRID = "numbers", "order", "grid"
WAYS = (*(f"{MOVED} {seed}" for seed in SEEDS), ORDER, GRID)
"""Ways in which a run is made again; `GRID` is the last."""


@dataclass(frozen=True)
class Disturbed:
    """A run of a campaign, made again in one of `WAYS`. It has what `measurement.PlannedRun` has."""

    run: PlannedRun
    way: str

    @property
    def key(self) -> str:
        return f"{self.run.key}, {self.way}"

    def task(self, kinds: Collection[str], repeats: int) -> Task:
        return replace(task_of_run(self.run, kinds, repeats, disturbed(self.run.scene, self.way), OUTPUT_STEP * (2 if self.way == GRID else 1)), label=self.key)

    def row(self, outcome: Outcome) -> Row:
        return self.run.row(outcome)


def disturbed(scene: Scene, way: str) -> Scene:
    """The scene as one of `WAYS` has it; the same motion but for rounding."""
    if way == ORDER:
        return scene.model_copy(update={"bodies": dict(reversed(scene.bodies.items()))})
    if way == GRID:
        return scene
    chance = np.random.default_rng([int(way.removeprefix(MOVED)), 5])
    numbers: dict[str, Any] = {f"bodies.{name}.{key}": _moved(getattr(body, key), chance) for name, body in scene.bodies.items() for key in ("mass", "inertia")}
    if scene.gravity is not None:
        numbers["gravity"] = [_moved(part, chance) for part in scene.gravity]
    return vary(scene, numbers)


def _moved(value: float, chance: np.random.Generator) -> float:
    return float(value * (1 + 2.0 ** -52 * chance.choice([-1, 1]) * chance.integers(1, ULPS + 1)))


def with_rounding(rows: Iterable[Row], again: Mapping[str, Sequence[Row]]) -> list[Row]:
    """The rows, each number with the largest difference to those of the same run made again, which `again` has by key; of `GRID` with its part of it.

    It is infinite where one of these does not have the number. A run that was not made again in all `WAYS` stays as it is.
    """
    return [_with(row, again[row.key]) if len(again.get(row.key, ())) == len(WAYS) else row for row in rows]


def _with(row: Row, again: Sequence[Row]) -> Row:
    found = [{metric.name: metric.value for metric in other.metrics} for other in again]

    def moved(metric: Metric) -> float:
        *rounded, by_grid = (abs(values.get(metric.name, math.inf) - metric.value) for values in found)
        if metric.kind in ("counter", MOTION):  # samples are work too, and with half as many a path has other corners
            return max(rounded)
        return max(*rounded, by_grid / FURTHER.get(metric.kind, 1.0))  # a grid is no chance: it moves a number as far every time

    metrics = tuple(metric if metric.kind == "time" else replace(metric, rounding=moved(metric)) for metric in row.metrics)
    return replace(row, metrics=metrics, other_ends=tuple(sorted({other.outcome for other in again} - {row.outcome})))
