"""The study `clearance`: what a gap in guides changes, and below which gap it may be neglected.

Zhuang & Wang neglect the impacts of a slider in its guide. Methods with contacts simulate them. Each run is compared
with the reference, whose joints are ideal; flights of corners through the gap are compared with the law of
`stiction.comparisons.measures.corner_flights`. ``data/clearance.toml`` contains the clearances, the steps and the depth
at which they are simulated.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from itertools import product
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import REFERENCE, participants, validation_campaign
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables, unless_refused
from stiction.comparisons.bench.variants import (
    Record,
    Variant,
    has_static_coefficient,
    run_command,
    time_factor,
)
from stiction.comparisons.measures.clearance_effect import GapRun, clearance_effect
from stiction.comparisons.measures.corner_gaps import guides_with_gaps, require_corners
from stiction.comparisons.measures.measured_flights import measured_flights
from stiction.comparisons.studies.clearance_claims import SLIDER_CRANK, ClaimTables, claims_table
from stiction.comparisons.studies.clearance_presentation import present
from stiction.comparisons.studies.clearance_tables import (
    CLEARANCE,
    RESTITUTION,
    START,
    WHY_NONE,
    effects_table,
    exponents_table,
    limits_table,
)
from stiction.engines.isolation import Outcome, Task
from stiction.engines.joint_effects import JointEffect
from stiction.engines.registry import EngineMissing, label_of, load_engine
from stiction.engines.status import Status
from stiction.scenes import Scene, load_scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model, NonNegative, Positive
from stiction.scenes.wording import as_given
from stiction.truths.physics import physics_overrides

OTHERS = "others"
"""Word of the data for all engines that they do not name."""
STEP_DIGITS = 12
"""Significant digits of a step that is multiplied by a ratio of times.

Rounding makes equal steps of two entries equal, so that their runs are made once.
"""


class Runs(Model):
    """Clearances, steps and engines of the runs at one depth; ``data/clearance.toml`` describes the fields."""

    depth: Depth
    in_campaign: bool = True
    engines: tuple[str, ...] | Literal["others"]
    clearances: tuple[Positive, ...]
    steps: tuple[Positive, ...]
    restitutions: tuple[NonNegative, ...] = (0.0,)
    declared: Literal["only", "too"] = "too"
    needs_drive: bool = False
    starts: Annotated[int, Field(ge=0)] = 0
    t_end: Positive | None = None

    def restitutions_of(self, scene: Scene) -> list[float]:
        """Return the coefficients of restitution with which a scene is run, in ascending order."""
        declared = {scene.guides[name].restitution for name in guides_with_gaps(scene)} - {0.0}
        if declared and self.declared == "only":
            return sorted(declared)
        return sorted({*self.restitutions, *declared})


class Data(Model):
    """The content of ``data/clearance.toml``."""

    limit: Positive
    window: Positive
    effect: tuple[Runs, ...]
    flight: tuple[Runs, ...]

    @property
    def named_engines(self) -> frozenset[str]:
        """Engines that have entries of their own."""
        return frozenset(
            name
            for runs in (*self.effect, *self.flight)
            if runs.engines != OTHERS
            for name in runs.engines
        )


@cache
def load_data() -> Data:
    """Return the content of ``data/clearance.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "clearance.toml"
    return Data.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))


@dataclass(frozen=True)
class Methods:
    """The methods of a scope.

    Attributes
    ----------
    able : tuple of Variant
        Methods with contacts and a fixed step, one per engine.
    unable : tuple of (Variant, Status, str)
        A variant of each engine that cannot take part, with the status and the reason.
    """

    able: tuple[Variant, ...]
    unable: tuple[tuple[Variant, Status, str], ...]


def methods_of(scope: Scope) -> Methods:
    """Return the methods that take part, and those that cannot."""
    able: dict[str, Variant] = {}
    others: dict[str, Variant] = {}
    for variant in participants(scope.engines):
        if variant.engine == REFERENCE:
            continue
        if variant.fidelity == Fidelity.CONTACT and variant.parameter == "dt":
            able.setdefault(variant.engine, variant)
        else:
            others.setdefault(variant.engine, variant)
    # An engine that is not installed cannot tell which restitutions it takes.
    unable = []
    for engine, variant in list(able.items()):
        try:
            load_engine(engine)
        except EngineMissing as error:
            unable.append((variant, Status.MISSING, str(error)))
            del able[engine]
            others.pop(engine, None)
    reason = (
        "found joint fidelity only; expected contact fidelity with a fixed step, as a clearance is a gap between the "
        "slider and two surfaces"
    )
    unable += [
        (variant, Status.REFUSED, reason)
        for engine, variant in others.items()
        if engine not in able
    ]
    return Methods(tuple(able.values()), tuple(unable))


def takes_restitution(variant: Variant) -> bool:
    """Return whether the contacts of an installed engine have a coefficient of restitution."""
    effects = load_engine(variant.engine).capabilities.joint_effects
    return JointEffect.RESTITUTION in effects.get(Fidelity.CONTACT, frozenset())


def scenes_of(scope: Scope) -> tuple[Scene, ...]:
    """Return the scenes of a scope; the paper's cases and the slider-crank if it has none or just these cases."""
    papers_cases = tuple(validation_campaign().scenes)
    if not scope.scenes or scope.scenes == papers_cases:
        return (*papers_cases, load_scene(SLIDER_CRANK))
    return scope.scenes


def check_scenes(scope: Scope) -> None:
    """Check that each scene has a slider with corners.

    Raises
    ------
    InputError
        If a scene has no guide with a length and a width.
    """
    for scene in scenes_of(scope):
        require_corners(scene)


def _time_ratio(scene: Scene) -> float:
    """Return the ratio by which the times of the data are multiplied for a scene, which may be shorter or faster."""
    return min(1.0, scene.t_end / load_data().window, time_factor(scene))


def _scaled_steps(runs: Runs, scene: Scene) -> list[float]:
    """Return the steps with which a scene is simulated, s, in the order of the data."""
    ratio = _time_ratio(scene)
    return [float(f"{ratio * step:.{STEP_DIGITS}g}") for step in runs.steps]


def _takes_part(runs: Runs, scene: Scene, variant: Variant, scope: Scope) -> bool:
    """Return whether a method makes some runs of a scene."""
    if not scope.depth.reaches(runs.depth) or (scope.is_campaign and not runs.in_campaign):
        return False
    if runs.needs_drive and not scene.drives:
        return False
    if runs.engines == OTHERS:
        return variant.engine not in load_data().named_engines
    return variant.engine in runs.engines


def effect_runs(scope: Scope, scene: Scene, variant: Variant) -> list[GapRun]:
    """Return the runs from which the effects of a method on a scene are measured, each once."""
    data = load_data()
    t_end = min(data.window, scene.t_end) if scope.t_end is None else scope.t_end
    has_restitution = takes_restitution(variant)
    # Entries of several depths may contain the same run.
    runs: dict[str, GapRun] = {}
    for entry in data.effect:
        if not _takes_part(entry, scene, variant, scope):
            continue
        restitutions = [
            restitution
            for restitution in entry.restitutions_of(scene)
            if restitution == 0.0 or has_restitution
        ]
        steps = _scaled_steps(entry, scene)
        steps_and_starts = [(step, 0) for step in steps]
        steps_and_starts += [(steps[0], start) for start in range(1, entry.starts + 1)]
        for clearance, restitution, (step, start) in product(
            entry.clearances, restitutions, steps_and_starts
        ):
            run = GapRun(scene, clearance, restitution, variant, step, t_end, start)
            runs.setdefault(run.key, run)
    return list(runs.values())


def flight_runs(scope: Scope, scene: Scene, variant: Variant) -> list[GapRun]:
    """Return the runs from which the flights of a method on a scene are measured, each once."""
    data = load_data()
    end = scene.t_end if scope.t_end is None else scope.t_end
    ratio = _time_ratio(scene)
    runs: dict[str, GapRun] = {}
    for entry in data.flight:
        if not _takes_part(entry, scene, variant, scope):
            continue
        t_end = min(ratio * (entry.t_end or data.window), end)
        for clearance, step in product(entry.clearances, _scaled_steps(entry, scene)):
            run = GapRun(scene, clearance, 0.0, variant, step, t_end)
            runs.setdefault(run.key, run)
    return list(runs.values())


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the runs of all methods on all scenes.

    Raises
    ------
    InputError
        If a scene has no guide with a length and a width.
    """
    check_scenes(scope)
    methods = methods_of(scope)
    scenes = scenes_of(scope)
    effects = [
        run
        for scene in scenes
        for variant in methods.able
        for run in effect_runs(scope, scene, variant)
    ]
    flights = [
        run
        for scene in scenes
        for variant in methods.able
        for run in flight_runs(scope, scene, variant)
    ]
    # The longest runs begin first, so that no long run is still in progress when all others have ended.
    effects.sort(key=lambda run: run.t_end / run.step, reverse=True)
    tasks = [Task(run.key, clearance_effect, (run,)) for run in effects]
    tasks += [Task(f"{run.key}, flights", measured_flights, (run,)) for run in flights]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        effect_outcomes = outcomes[: len(effects)]
        rows = [
            _run_row(run, outcome) for run, outcome in zip(effects, effect_outcomes, strict=True)
        ]
        rows += list(_unable_rows(methods, scenes, scope))
        runs = pd.DataFrame(rows)
        table = effects_table(runs)
        limits = limits_table(table, load_data().limit)
        measured, efforts = _flight_tables(flights, outcomes[len(effects) :])
        return Tables(
            {
                "clearance": table,
                "clearance-limits": limits,
                "clearance-claims": claims_table(ClaimTables(table, limits, runs)),
                "clearance-flights": measured,
                "clearance-exponents": exponents_table(measured),
                "clearance-efforts": efforts,
                "clearance-runs": runs,
            }
        )

    return Comparison(tuple(tasks), tabulate, methods.able)


def _run_row(run: GapRun, outcome: Outcome) -> dict[str, Any]:
    """Return the row of a run; the row of a failed run contains its reason, but no measured columns."""
    # `Record` expects a trajectory as the value of an outcome; here it consists of the measured columns.
    record = Record(run.key, run.scene.name, run.variant, run.step, replace(outcome, value=None))
    return {
        **record.describe(),
        CLEARANCE: run.clearance,
        RESTITUTION: run.restitution,
        START: run.start,
        **(outcome.value or {}),
        AGAIN: _command(run),
    }


def _command(run: GapRun) -> str | None:
    """Return the command that repeats a run; None for a perturbed start, which has no scene of its own."""
    if run.start:
        return None
    options = [
        ("fidelity", "contact"),
        ("dt", f"{run.step:.{STEP_DIGITS}g}"),
        ("t-end", f"{run.t_end:.{STEP_DIGITS}g}"),
    ]
    overrides = physics_overrides(run.scene, has_static_coefficient(run.variant))
    options += [("set", f"{path}={as_given(value)}") for path, value in overrides.items()]
    for name in guides_with_gaps(run.scene):
        options.append(("set", f"{name}.clearance={run.clearance:.{STEP_DIGITS}g}"))
        options.append(("set", f"{name}.restitution={run.restitution:.{STEP_DIGITS}g}"))
    for name, value in run.variant.settings.items():
        options.append(("setting", f"{name}={as_given(value)}"))
    return run_command(run.scene.name, run.variant.engine, options)


def _unable_rows(
    methods: Methods, scenes: Sequence[Scene], scope: Scope
) -> Iterator[dict[str, Any]]:
    """Yield a row for each method that cannot take part, and for each restitution that a method does not take."""
    data = load_data()
    for scene in scenes:
        for variant, status, reason in methods.unable:
            if any(_takes_part(entry, scene, variant, scope) for entry in data.effect):
                yield _unmade_row(scene, variant, status, reason, 0.0)
    reason = "its contacts have no coefficient of restitution"
    without_restitution = [variant for variant in methods.able if not takes_restitution(variant)]
    for scene, variant in product(scenes, without_restitution):
        restitutions: set[float] = set()
        for entry in data.effect:
            if _takes_part(entry, scene, variant, scope):
                restitutions.update(entry.restitutions_of(scene))
        for restitution in sorted(restitutions - {0.0}):
            yield _unmade_row(scene, variant, Status.REFUSED, reason, restitution)


def _unmade_row(
    scene: Scene, variant: Variant, status: Status, reason: str, restitution: float
) -> dict[str, Any]:
    """Return the row that stands for all runs of a method which are not made, for one restitution."""
    return {
        "scene": scene.name,
        "variant": variant.label,
        "engine": label_of(variant.engine),
        "fidelity": variant.fidelity,
        "parameter": "dt",
        "status": status,
        "reason": reason,
        "key": f"clearance/{scene.name}/{variant.label}/e={restitution:g}",
        RESTITUTION: restitution,
        START: 0,
    }


def _flight_tables(
    runs: Sequence[GapRun], outcomes: Sequence[Outcome]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of flights, and that of efforts around one flight of each run.

    A run that failed has one row with its reason in the table of flights.
    """
    flight_rows: list[dict[str, Any]] = []
    effort_rows: list[dict[str, Any]] = []
    for run, outcome in zip(runs, outcomes, strict=True):
        run_columns = {
            "scene": run.scene.name,
            "variant": run.variant.label,
            "engine": label_of(run.variant.engine),
            CLEARANCE: run.clearance,
            "step": run.step,
            "status": outcome.status,
            "reason": outcome.reason,
            "key": outcome.label,
        }
        if outcome.value is None:
            flight_rows.append({**run_columns, WHY_NONE: outcome.reason})
            continue
        flights, efforts = outcome.value
        flight_rows += [{**run_columns, **flight} for flight in flights]
        effort_rows += [{**run_columns, **effort} for effort in efforts]
    return pd.DataFrame(flight_rows), pd.DataFrame(effort_rows)


STUDY = Study(
    "clearance",
    "Clearance",
    "When may the clearance of a guide be neglected?",
    present,
    plan,
    seconds=0.8,
    needs_scene=False,
    takes=frozenset({"engines", "scenes", "t_end"}),
    applies=unless_refused(check_scenes),
    tables={
        "clearance": "Changes of the motion by clearance",
        "clearance-limits": "Clearances below which the driving effort hardly changes",
        "clearance-claims": "Published statements about clearance",
        "clearance-flights": "Flights of corners, predicted and measured",
        "clearance-exponents": "Exponents of flights over the clearance",
        "clearance-efforts": "Driving effort around the flight of a corner",
        "clearance-runs": "Runs with clearance",
    },
)
