"""Planned runs, the rows of what came of them with every number that is kept, and ways to disturb a run.

How they are measured is in `stiction.comparisons.regression.measurement`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from stiction.comparisons.bench.variants import Variant, run_key
from stiction.engines import Outcome
from stiction.engines.status import Status
from stiction.scenes import Scene
from stiction.scenes.digest import scene_digest
from stiction.truths.truth import Tier

TRUTH = "truth"
"""Kind of the numbers that say what is true, and engine and variant of their rows."""
MOTION = "motion"
"""Kind of the positions of all bodies at the end of a run, and of the path of one with fixed steps."""
Kind = Literal["accuracy", "motion", "event", "drift", "counter", "time"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds of numbers that can be measured of a run."""

ULPS = 8
"""Units in the last place by which a number is moved at most: some operations' rounding."""
MOVED, ORDER, GRID = "numbers", "order", "grid"
WAYS = (*(f"{MOVED} {seed}" for seed in (1, 2, 3)), ORDER, GRID)
"""Ways in which a run is made again; `GRID`, with half as many samples, is the last."""


@dataclass(frozen=True)
class Metric:
    """A number: `name` is its quantity's key, `kind` one of `KINDS` or `TRUTH`; None is unknown.

    The uncertainty of an error is that of the truth, of a time the distance of the second shortest repeat. `tier` is
    that of the truth behind an error, `Tier.OWN_RUN` for counters and times. `rounding` is the largest change by
    rounding alone (`tolerances.with_rounding`).
    """

    name: str
    kind: str
    value: float
    uncertainty: float | None = None
    tier: Tier = Tier.OWN_RUN
    rounding: float | None = None


@dataclass(frozen=True)
class Row:
    """A run, its status, and its numbers.

    Of a truth, `variant` and `engine` are `TRUTH`, `fidelity` and `parameter` are empty.
    `key` and `identity` are those of a `PlannedRun`. `traceback` is that of a bug, which no history keeps. `other_ends`
    are the outcomes that the run has with other rounding, where that was measured.
    """

    key: str
    identity: str
    scene: str
    variant: str
    engine: str
    version: str | None
    fidelity: str
    parameter: str
    step: float
    status: Status
    reason: str
    settings: Mapping[str, Any] | None = None
    metrics: tuple[Metric, ...] = ()
    traceback: str = field(default="", compare=False, repr=False)
    other_ends: tuple[Status, ...] = ()

    @property
    def label(self) -> str:
        return self.key

    @property
    def outcome(self) -> Status:
        return outcome_of(self.status, self.reason)


def outcome_of(status: Status, reason: str) -> Status:
    """Return the status of a run, `Status.INCOMPLETE` where it ended early or there is no truth for it."""
    return Status.INCOMPLETE if status == Status.OK and reason else status


@dataclass(frozen=True)
class PlannedRun:
    """A variant with a step on a scene, or the truth of a scene where `variant` is None.

    One that is `followed` is of a scene on which a check runs every variant. A run that is made again has a `way`, one
    of `WAYS`.
    """

    scene: Scene
    variant: Variant | None = None
    step: float = 0.0
    followed: bool = False
    way: str = ""

    @property
    def key(self) -> str:
        """Name of the run, for people."""
        name = (
            f"{self.scene.name}/{TRUTH}"
            if self.variant is None
            else run_key(self.scene, self.variant, self.step)
        )
        return f"{name}, {self.way}" if self.way else name

    @property
    def identity(self) -> str:
        """Content of the run, whatever its name: ``"pymunk, joint, dt = 0.01; scene 53f1d0c2a9e84b67"``.

        Only runs of the same identity are compared. The version of the engine is no part of it: whether a new one is
        worse is the question of a check.
        """
        variant, scene = self.variant, f"scene {scene_digest(self.scene)}"
        if variant is None:
            return f"{TRUTH}; {scene}"
        settings = sorted({**variant.settings, variant.parameter: self.step}.items())
        words = ", ".join(
            f"{name} = {json.dumps(value, sort_keys=True, default=str)}" for name, value in settings
        )
        return f"{variant.stands_for or variant.engine}, {variant.fidelity}, {words}; {scene}"

    @property
    def row(self) -> Row:
        """Row before the run is made."""
        variant = self.variant
        return Row(
            self.key,
            self.identity,
            self.scene.name,
            variant.label if variant else TRUTH,
            variant.engine if variant else TRUTH,
            None,
            variant.fidelity if variant else "",
            variant.parameter if variant else "",
            self.step,
            Status.NOT_RUN,
            "",
        )


def row_of(run: PlannedRun, outcome: Outcome) -> Row:
    """Return the row of a run whose task had an outcome."""
    if outcome.status == Status.OK:
        return outcome.value
    return replace(
        run.row, status=outcome.status, reason=outcome.reason, traceback=outcome.traceback
    )
