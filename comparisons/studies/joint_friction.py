"""The study `joint-friction`: errors of methods whose joints have friction with a constant bound, by step.

All methods have the same steps on the same scenes, so that errors and orders of convergence can be read side by side;
the steps of the study `accuracy` differ by method. Most engines have an element for a constant bound, so that the law
is their own. Methods are therefore listed by who supplies it. Scenes and steps are data
(``data/joint_friction.toml``).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any, Literal

import numpy as np
import pandas as pd

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import REFERENCE, variants
from stiction.comparisons.bench.presentation import (
    Column,
    Presentation,
    Row,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import (
    FRICTION_BY,
    Record,
    Variant,
    has_static_coefficient,
    run_command,
)
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors, rounding_effect
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.studies.settings import Subject
from stiction.engines.isolation import Outcome, Task
from stiction.engines.joint_effects import JointEffect
from stiction.engines.protocol import EngineFailure, Supplier
from stiction.engines.registry import EngineMissing, label_of, load_engine, own_methods
from stiction.engines.status import UNMADE, Status
from stiction.scenes import Scene, Trajectory, load_scene, vary
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model, Positive
from stiction.scenes.wording import as_given
from stiction.truths.physics import physics_of

CASE = "case"
"""Column: the case, a scene with its changes."""
ERROR = "joint_friction_error"
"""Column: error of a run, in the unit of `UNIT`."""
UNCERTAINTY = "joint_friction_error_uncertainty"
UNIT = "joint_friction_unit"
"""Column: unit of the error, m and rad of coordinates or N m of an effort."""
ORDER = "joint_friction_order"
"""Column: order of convergence between the coarsest and the finest step; nan if errors do not fall with the step."""
EXACT = 1e-9
"""Error (m, rad, N m) up to which a method has no order: rounding over some ten thousand steps."""
LEAST_ORDER = 0.25
"""Order below which errors are not said to fall with the step: a quarter of the step leaves 70 % of the error."""
COORDINATES = ("x", "y", "angle")
UNITS = {"position": "m, rad", "effort": "N m"}
"""Unit of the error, by `Case.measured`."""
SUPPLIERS = (Supplier.ENGINE, Supplier.BOTH, Supplier.ADAPTER)
"""Order in which methods are listed: friction that the engine supplies itself first."""
OUTPUT_STEP = 0.02
"""Distance of the samples, s: a multiple of all steps."""


class Case(Model):
    """A scene whose joints have friction with a constant bound.

    Attributes
    ----------
    title : str
        Its name in tables.
    scene : str
        Name of the scene in the catalogue.
    measured : str
        ``"position"``: the largest error of a coordinate (m) or an angle (rad) of a body. ``"effort"``: the mean error
        over time of the effort of a drive.
    t_end : float
        End of the runs, s.
    changes : dict
        Changes of the scene, as for `stiction.scenes.vary`; an empty table removes the key.
    """

    title: str
    scene: str
    measured: Literal["position", "effort"]
    t_end: Positive
    changes: dict[str, Any] = {}

    def load(self) -> Scene:
        """Return the scene with its changes."""
        changes = {key: None if value == {} else value for key, value in self.changes.items()}
        return vary(load_scene(self.scene), {**changes, "t_end": self.t_end})


class Data(Model):
    """Cases, steps (s), and methods beside the participants."""

    steps: tuple[Positive, ...]
    scenes: tuple[Case, ...]
    subjects: tuple[Subject, ...]


@cache
def load_data() -> Data:
    """Return the content of ``data/joint_friction.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "joint_friction.toml"
    return Data.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))


@dataclass(frozen=True)
class Trial:
    """A run: a case, its scene, a method and a step (s)."""

    case: Case
    scene: Scene
    variant: Variant
    step: float

    @property
    def key(self) -> str:
        """Unique name of the run."""
        return f"joint-friction/{self.case.title}/{self.variant.label}/dt={self.step:g}"


def measure_error(
    engine: str, scene: Scene, measured: str, static: bool, arguments: Mapping[str, Any]
) -> tuple[dict[str, float], Trajectory]:
    """Run a scene, and return the columns of its error, and the first and last row of the run.

    Parameters
    ----------
    static
        True if the engine represents a static bound; its truth has one too then.
    arguments
        Step, fidelity and settings, for `Engine.simulate`.

    Raises
    ------
    EngineFailure
        If the run ended early, or if it has no error in such a case.
    """
    run = load_engine(engine).simulate(scene, output_step=OUTPUT_STEP, **arguments)
    if run.termination != "end":
        raise EngineFailure(run.termination)
    truth = ground_truth(physics_of(scene, static))
    if measured == "effort":
        found = errors(run, truth)
        if TORQUE_ERROR not in found:
            raise EngineFailure(found.get("reason") or f"no effort to compare: {truth.note}")
        row = {ERROR: found[TORQUE_ERROR], UNCERTAINTY: found["torque_uncertainty"]}
    else:
        # a truth of a body that only slides has no angle, and none of the coordinates that it cannot change
        exact = truth(run.t)
        names = [
            name
            for body in scene.bodies
            for name in (f"{body}.{label}" for label in COORDINATES)
            if name in exact
        ]
        if not names:
            raise EngineFailure(f"no coordinate to compare: {truth.note}")
        row = {
            ERROR: max(float(np.max(np.abs(run[name] - exact[name]))) for name in names),
            UNCERTAINTY: max(
                truth.uncertainty.get(name, 0.0) + rounding_effect(run, name) for name in names
            ),
        }
    row["truth_tier"] = truth.tier
    ends = replace(
        run,
        t=run.t[[0, -1]],
        columns={name: column[[0, -1]] for name, column in run.columns.items()},
        events=(),
    )
    return row, ends


def plan(scope: Scope) -> Comparison[Tables] | None:
    """Return the runs of all methods on all cases; None in a campaign that is not for a night."""
    if scope.is_campaign and scope.depth != Depth.FULL:
        return None
    trials = list(_trials(scope))
    tasks = [_task(trial) for trial in trials]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        rows = [_row(trial, outcome) for trial, outcome in zip(trials, outcomes, strict=True)]
        return Tables({"joint-friction": with_orders(pd.DataFrame(rows))})

    chosen = {trial.variant.label: trial.variant for trial in trials}
    return Comparison(tuple(tasks), tabulate, tuple(chosen.values()))


def _methods(scope: Scope) -> Iterator[Variant]:
    """Yield the methods with a fixed step that take constant bounds, except for the reference's, and the subjects."""
    data = load_data()
    for variant in variants(scope.engines):
        has_step = variant.parameter == "dt" and variant.engine != REFERENCE
        if has_step and _takes_pins(variant):
            yield replace(variant, ladder=data.steps)
    for subject in data.subjects:
        if scope.engines is None or subject.engine in scope.engines:
            for variant in subject.variants(data.steps):
                label = f"{label_of(subject.engine)}, {subject.name}"
                yield replace(variant, label=label, subject="", setting="")


def _takes_pins(variant: Variant) -> bool:
    """Test whether an engine takes friction in pins at a fidelity; one that is not installed is a row with the reason.

    Most engines do at joint fidelity only, where a joint is the engine's own.
    """
    try:
        effects = load_engine(variant.engine).capabilities.joint_effects
    except EngineMissing:
        return variant.fidelity == Fidelity.JOINT
    return JointEffect.PIN_FRICTION in effects.get(variant.fidelity, frozenset())


def _trials(scope: Scope) -> Iterator[Trial]:
    """Yield all runs, case by case; at the least depth with the two coarsest steps."""
    data = load_data()
    steps = data.steps[:2] if scope.depth == Depth.QUICK else data.steps
    for case in data.scenes:
        scene = case.load()
        for variant in _methods(scope):
            for step in steps:
                yield Trial(case, scene, variant, step)


def _task(trial: Trial) -> Task:
    """Return the task of a run."""
    variant = trial.variant
    arguments = {"dt": trial.step, "fidelity": variant.fidelity, **variant.settings}
    static = has_static_coefficient(variant)
    return Task(
        trial.key,
        measure_error,
        (variant.engine, trial.scene, trial.case.measured, static, arguments),
    )


def _row(trial: Trial, outcome: Outcome) -> dict[str, Any]:
    """Return the row of a run; one that failed has no error, only a reason."""
    found, ends = outcome.value if outcome.value is not None else ({}, None)
    record = Record(
        trial.key, trial.case.scene, trial.variant, trial.step, replace(outcome, value=ends)
    )
    row = {CASE: trial.case.title, **record.describe(), UNIT: UNITS[trial.case.measured], **found}
    if ends is not None:
        row[AGAIN] = _command(trial)
    return row


def _command(trial: Trial) -> str | None:
    """Return the command that repeats a run (`run_command`)."""
    options = [("dt", f"{trial.step:g}"), ("t-end", f"{trial.case.t_end:g}")]
    for name, value in trial.case.changes.items():
        options.append(("set", f"{name}={'none' if value == {} else as_given(value)}"))
    for name, value in trial.variant.settings.items():
        options.append(("setting", f"{name}={as_given(value)}"))
    return run_command(trial.case.scene, trial.variant.engine, options)


def with_orders(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table of runs with the column `ORDER`, which is the same for all steps of a method on a case.

    The order is that between the coarsest and the finest step. There is none if an error is not smaller than that at
    the next coarser step, if the order is below `LEAST_ORDER`, or if the largest error is at most `EXACT`.
    """
    columns = [name for name in (ERROR, UNCERTAINTY) if name not in table]
    table = table.assign(**dict.fromkeys([*columns, ORDER], math.nan))
    for _, runs in table.groupby([CASE, "variant"], sort=False):
        ordered = runs[runs[ERROR].notna()].sort_values("step", ascending=False)
        error, step = ordered[ERROR].to_numpy(float), ordered["step"].to_numpy(float)
        falls = len(error) > 1 and bool(np.all(np.diff(error) < 0))
        if falls and error[0] > EXACT:
            order = math.log(error[0] / error[-1]) / math.log(step[0] / step[-1])
            if order >= LEAST_ORDER:
                table.loc[runs.index, ORDER] = order
    return table


def present(results: Results) -> Presentation:
    """Present the errors of each method at each step, case by case, and how many engines supply the law themselves."""
    table = results.table("joint-friction")
    if table.empty:
        return Presentation()
    made = table[~table["status"].isin(UNMADE)]
    if made.empty:
        return Presentation()
    succeeded = made[made[ERROR].notna()]
    is_engine = ~succeeded["engine"].isin(own_methods())
    own = succeeded[is_engine & succeeded[FRICTION_BY].eq(Supplier.ENGINE)]
    converge = own[own[ORDER].notna() | own[ERROR].le(EXACT)]
    not_converging = own[~own["variant"].isin(converge["variant"])]
    rows = {
        "cases": int(made[CASE].nunique()),
        "engines": int(succeeded.loc[is_engine, "engine"].nunique()),
        "own": list(dict.fromkeys(own["engine"])),
        "not_converging": list(dict.fromkeys(not_converging["variant"])),
        "largest": list(_largest_errors(table, own)),
        "refused": _refused(made),
        "tables": [
            {
                "name": table_name(case),
                "case": case,
                "unit": made.loc[made[CASE] == case, UNIT].iloc[0],
            }
            for case in made[CASE].unique()
        ],
    }
    tables = [_case_table(made, case) for case in made[CASE].unique()]
    every = view(
        "joint-friction",
        made,
        [Column(name) for name in made if name not in ("settings", "version", AGAIN)],
        in_report=False,
    )
    return Presentation(rows=rows, tables=[*tables, every])


def _largest_errors(table: pd.DataFrame, own: pd.DataFrame) -> Iterator[Row]:
    """Yield for each case the run with the largest error of an engine's own law at the finest step."""
    for _, runs in own.groupby(CASE, sort=False):
        finest = runs[runs["step"] == runs["step"].min()]
        yield row_of("joint-friction", table, finest[ERROR].idxmax())


def _refused(made: pd.DataFrame) -> list[dict[str, object]]:
    """Return the methods that do not take a case, by case."""
    refused = made[made["status"] == Status.REFUSED]
    return [
        {"case": case, "variants": list(dict.fromkeys(runs["variant"]))}
        for case, runs in refused.groupby(CASE, sort=False)
    ]


def in_step(step: float) -> str:
    """Return the name of the column of a table of the report with the errors at a step."""
    return f"{ERROR} at {step:g} s"


def table_name(case: str) -> str:
    """Return the name of the table of a case."""
    return f"joint-friction-{'-'.join(case.split())}"


def _case_table(made: pd.DataFrame, case: str) -> TableView:
    """Return the table of a case: a row per method, those with the engine's own law first, and a column per step."""
    on_case = made[made[CASE] == case]
    place = {str(supplier): number for number, supplier in enumerate(SUPPLIERS)}
    steps = sorted(on_case["step"].unique(), reverse=True)
    rows = []
    for variant, runs in on_case.groupby("variant", sort=False):
        succeeded = runs[runs[ERROR].notna()]
        if succeeded.empty:
            continue
        first = succeeded.iloc[0]
        row = {"method": variant, **first[[FRICTION_BY, ORDER]]}
        for _, run in succeeded.iterrows():
            row[in_step(run["step"])] = run[ERROR]
            row[f"{in_step(run['step'])}, uncertainty"] = run[UNCERTAINTY]
        rows.append((row, runs))
    rows.sort(key=lambda pair: place.get(str(pair[0][FRICTION_BY]), len(place)))
    columns = [Column("method"), Column(FRICTION_BY, "law of")]
    for step in steps:
        columns.append(
            Column(
                in_step(step),
                f"{1e3 * step:g} ms",
                uncertainty=f"{in_step(step)}, uncertainty",
                of=ERROR,
            )
        )
    columns.append(Column(ORDER))
    return view(table_name(case), rows, columns, source="joint-friction")


STUDY = Study(
    "joint-friction",
    "Joint friction",
    "How accurate is friction with a constant bound in joints, and whose law is it?",
    present,
    plan,
    seconds=0.3,
    on_page_one=False,
    takes_scene=False,
    needs_scene=False,
    takes=frozenset({"engines"}),
    tables={"joint-friction": "Errors of joints whose friction has a constant bound"},
)
