"""Planned runs, rows with the numbers of runs, and ways to perturb a run.

`stiction.comparisons.regression.measurement` computes the numbers.
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
"""Kind of the numbers of a truth; also the engine and the variant of its row."""
MOTION = "motion"
"""Kind of the final positions of all bodies, and of the length of their path in runs with fixed
steps."""
Kind = Literal["accuracy", "motion", "event", "drift", "counter", "time"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds of numbers that can be computed for a run."""

ULPS = 8
"""Largest change of a number of the scene by `MOVED`, in units in the last place: the rounding of a
few operations."""
MOVED = "numbers"
"""Perturbation of a run: the numbers of its scene are changed at random, within `ULPS`."""
ORDER = "order"
"""Perturbation of a run: the bodies of its scene are listed in reverse order."""
GRID = "grid"
"""Perturbation of a run: half as many samples."""
WAYS = (f"{MOVED} 1", f"{MOVED} 2", f"{MOVED} 3", ORDER, GRID)
"""All perturbations, `MOVED` with three seeds; `GRID` is the last."""


@dataclass(frozen=True)
class Metric:
    """A number of a run.

    Attributes
    ----------
    name : str
        Key of its quantity (`stiction.comparisons.bench.quantities`).
    kind : str
        One of `KINDS`, or `TRUTH`.
    value : float
        In the unit of the quantity.
    uncertainty : float or None
        For an error the uncertainty of the truth, for a time the difference between the shortest
        and the second shortest repeat; None if it is unknown.
    tier : Tier
        Tier of the truth with which an error was computed; `Tier.OWN_RUN` for counters and times.
    rounding : float or None
        Largest change by rounding alone (`tolerances.with_rounding`); None if it was not measured.
    """

    name: str
    kind: str
    value: float
    uncertainty: float | None = None
    tier: Tier = Tier.OWN_RUN
    rounding: float | None = None


@dataclass(frozen=True)
class Row:
    """The status and the numbers of one run, or the numbers of one truth.

    Attributes
    ----------
    key, identity : str
        As of the `PlannedRun`.
    scene : str
        Name of the scene.
    variant, engine : str
        Label of the variant and name of the engine; `TRUTH` in the row of a truth.
    version : str or None
        Version of the engine, None if the run failed.
    fidelity, parameter : str
        Empty in the row of a truth.
    step : float
        Value of `parameter`.
    status : Status
    reason : str
        Why the run failed or ended early; empty otherwise.
    settings : Mapping or None
        All settings of the run, as the engine reports them.
    metrics : tuple of Metric
    traceback : str
        Traceback of a bug, which is not stored in the history.
    other_ends : tuple of Status
        Other outcomes of the run if rounding differs; empty if there are none, or if this was not
        measured.
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
        """The key, under the name that tasks and outcomes use."""
        return self.key

    @property
    def outcome(self) -> Status:
        """Status that also tells whether the run is complete, see `outcome_of`."""
        return outcome_of(self.status, self.reason)


def outcome_of(status: Status, reason: str) -> Status:
    """Return the status of a run; `Status.INCOMPLETE` if it ended early or has no truth, see its reason."""
    return Status.INCOMPLETE if status == Status.OK and reason else status


@dataclass(frozen=True)
class PlannedRun:
    """One step of a variant on a scene, or the truth of a scene.

    Attributes
    ----------
    scene : Scene
    variant : Variant or None
        None for the truth.
    step : float
        Value of the variant's parameter; 0 for the truth.
    followed : bool
        True if a check runs every variant on this scene.
    way : str
        Perturbation, one of `WAYS`; empty for the run itself.
    """

    scene: Scene
    variant: Variant | None = None
    step: float = 0.0
    followed: bool = False
    way: str = ""

    @property
    def key(self) -> str:
        """Readable name of the run, unique in a campaign."""
        if self.variant is None:
            name = f"{self.scene.name}/{TRUTH}"
        else:
            name = run_key(self.scene, self.variant, self.step)
        return f"{name}, {self.way}" if self.way else name

    @property
    def identity(self) -> str:
        """Contents of the run, independent of its name: ``"pymunk, joint, dt = 0.01; scene 53f1d0c2a9e84b67"``.

        Only runs with the same identity are compared. It does not contain the version of the
        engine, because a check compares versions.
        """
        variant = self.variant
        scene = f"scene {scene_digest(self.scene)}"
        if variant is None:
            return f"{TRUTH}; {scene}"
        settings = {**variant.settings, variant.parameter: self.step}
        assignments = [
            f"{name} = {json.dumps(value, sort_keys=True, default=str)}"
            for name, value in sorted(settings.items())
        ]
        engine = variant.stands_for or variant.engine
        return f"{engine}, {variant.fidelity}, {', '.join(assignments)}; {scene}"

    @property
    def row(self) -> Row:
        """Row of the run before its execution, without numbers."""
        row = Row(
            key=self.key,
            identity=self.identity,
            scene=self.scene.name,
            variant=TRUTH,
            engine=TRUTH,
            version=None,
            fidelity="",
            parameter="",
            step=self.step,
            status=Status.NOT_RUN,
            reason="",
        )
        if self.variant is None:
            return row
        return replace(
            row,
            variant=self.variant.label,
            engine=self.variant.engine,
            fidelity=self.variant.fidelity,
            parameter=self.variant.parameter,
        )


def row_of(run: PlannedRun, outcome: Outcome) -> Row:
    """Return the row of a run from the outcome of its task, whose value is the row if it succeeded."""
    if outcome.status == Status.OK:
        return outcome.value
    return replace(
        run.row, status=outcome.status, reason=outcome.reason, traceback=outcome.traceback
    )
