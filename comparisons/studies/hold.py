"""The study `hold`: creep under loads below the limit of static friction, and what happens at the limit.

The truth of a load below the limit is rest, which is derived in the source of each scene. The break-away under a slow
ramp and the motion until a stop are compared with `stiction.comparisons.measures.scene_truth.ground_truth`. Runs,
settings and laws are data (`hold_data`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import rank
from stiction.comparisons.bench.participants import variants
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import NightlyNumbers, Scope, Study, Tables, unless_refused
from stiction.comparisons.bench.timing.visits import visit
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    Coefficients,
    Record,
    Variant,
    has_static_coefficient,
    run_command,
    truth_key,
)
from stiction.comparisons.measures.accuracy import rounding_effect
from stiction.comparisons.measures.creep import (
    LANDING,
    LET_GO,
    Slip,
    joint_displacement,
    slip_of,
)
from stiction.comparisons.measures.published_creep import (
    ENGINE,
    published_creep,
    published_joint_creep,
)
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.studies.hold_data import Runs, load_data
from stiction.comparisons.studies.hold_joints import (
    JOINT_CREEP,
    JOINT_STOP,
    JOINT_STOP_UNSURE,
    JOINT_UNIT,
    JOINT_UNSURE,
    joint_methods_table,
)
from stiction.comparisons.studies.hold_presentation import present
from stiction.comparisons.studies.hold_tables import (
    BOUND,
    BREAK_AWAY,
    BREAK_UNSURE,
    CHANGED,
    CREEP,
    FASTER,
    HELD,
    LANDED,
    LETS_GO,
    LOAD,
    OF_STEP,
    OF_ZONE,
    PART,
    RAMP,
    STOP,
    STOP_UNSURE,
    STOPPED,
    TEST,
    UNSURE,
    USUAL,
    laws_table,
    methods_table,
    settings_table,
)
from stiction.comparisons.studies.settings import SETTING, SUBJECT
from stiction.engines.isolation import Outcome, Task
from stiction.engines.joint_effects import has_constant_bounds
from stiction.engines.protocol import PRECISION, EngineFailure
from stiction.engines.registry import load_engine
from stiction.engines.status import UNMADE
from stiction.scenes import InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.wording import as_given
from stiction.truths import Tier, Truth

LOAD_PARAMETERS = ("part", "ramp", "v0", "limit")
"""Parameters of a scene of the study: the load is part + ramp t of the limit, and v0 is the initial velocity of the
joint along it."""
PARAMETERS = (*LOAD_PARAMETERS, "mu", "mus")
"""Parameters of a scene of the study whose friction depends on normal forces."""
PERIOD = "period"
"""Parameter of a scene whose load also oscillates: its period, s."""
PUBLISHED_TABLES = ("hold-published", "hold-published-joints")
"""Tables of published creep, of sliders and of joints."""
OUTPUT = {HELD: 4e-3, RAMP: 1e-3, STOP: 4e-3}
"""Distance of the samples of a run by test, s. Of a ramp it is one step of 1 ms, which determines the break-away."""
TRUE_STEP = 1e-4
"""Distance of the samples of a truth, s."""


@dataclass(frozen=True)
class Trial:
    """One run of the study.

    Attributes
    ----------
    scene : Scene
        The scene with the load of the test.
    changed : Mapping[str, float]
        Parameters of the scene that were changed for the test.
    static : bool
        True if the static coefficient exceeds the kinetic one.
    variant : Variant
        The method, with its settings.
    step : float
        Its step (s) or relative tolerance, according to ``variant.parameter``.
    test : str
        `HELD`, `RAMP` or `STOP`.
    load : float
        The load at the beginning, as a fraction of the limit.
    """

    scene: Scene
    changed: Mapping[str, float]
    static: bool
    variant: Variant
    step: float
    test: str
    load: float

    @property
    def key(self) -> str:
        """Unique name of the run."""
        step = f"{self.variant.parameter}={self.step:g}"
        test = f"{HELD} {self.load:g}" if self.test == HELD else self.test
        return f"hold/{self.scene.name}/{self.variant.label}/{step}/{test}"

    @property
    def varies_setting(self) -> bool:
        """True if the run belongs to a comparison of settings, be it with the default or another one."""
        return self.variant.setting != ""

    @property
    def truth(self) -> str:
        """Name of the truth of this run."""
        return f"hold/{truth_key(self.scene.name, self.static)}/{self.test}/truth"

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `Engine.simulate`, except for the output."""
        return {
            self.variant.parameter: self.step,
            "fidelity": self.variant.fidelity,
            **self.variant.settings,
        }


def _check_scenes(scope: Scope) -> None:
    """Raise InputError if a scene of a campaign has no such tests; the paper's cases are replaced by others."""
    if not scope.is_of_paper:
        for scene in scope.scenes:
            _check_parameters(scene)


def reason_against(scope: Scope) -> str:
    """Return why a campaign does not make the study of its scenes."""
    if unless_refused(_check_scenes)(scope):
        return (
            "it needs a scene that is made for it, whose parameters set a load relative to the limit of static "
            "friction, such as hold-incline of the catalogue"
        )
    return ""


def _check_parameters(scene: Scene) -> None:
    """Raise InputError if a scene lacks one of `PARAMETERS`, or `LOAD_PARAMETERS` if its bounds are constant."""
    is_constant = has_constant_bounds(scene)
    expected = LOAD_PARAMETERS if is_constant else PARAMETERS
    missing = [name for name in expected if name not in scene.parameters]
    if missing:
        raise InputError(
            f"{scene.name}: parameters: found no {', '.join(missing)}; expected {', '.join(expected)}, "
            f"as the scenes {'held' if is_constant else 'hold'}-.. of the catalogue have them"
        )


def changes(scene: Scene, test: str, load: float, static_coefficient: bool) -> dict[str, float]:
    """Return the parameters of a scene that a test changes.

    For an engine without a static coefficient mus is mu, which also reduces the limit. Scenes whose friction has a
    constant bound have no coefficients.

    Raises
    ------
    InputError
        If the scene lacks one of `PARAMETERS`, or of `LOAD_PARAMETERS` if its friction has a constant bound.
    """
    _check_parameters(scene)
    is_constant = has_constant_bounds(scene)
    data = load_data()
    changed: dict[str, float] = {}
    if test == HELD:
        changed["part"] = load
    elif test == RAMP:
        changed.update(data.ramp.model_dump())
    else:
        changed.update(data.stop.model_dump(exclude={"landed"}))
    if not static_coefficient and not is_constant:
        changed["mus"] = scene.parameters["mu"]
    return changed


def measure_slip(
    engine: str, scene: Scene, test: str, arguments: Mapping[str, Any], timed: bool = False
) -> tuple[Slip, Trajectory]:
    """Run a scene, and reduce the run to the numbers of its slip.

    Parameters
    ----------
    engine, scene, test
        Name of the engine, the scene with its load, and `HELD`, `RAMP` or `STOP`.
    arguments
        Step or tolerance, fidelity and settings, for `Engine.simulate`.
    timed
        True if the engine time is to be the median of repeated runs (`visit`).

    Returns
    -------
    slip : Slip
        The numbers of the slip.
    ends : Trajectory
        The first and the last row of the run, without events.

    Raises
    ------
    EngineFailure
        If the run ended early.
    """
    run = load_engine(engine).simulate(scene, output_step=OUTPUT[test], **arguments)
    if run.termination != "end":
        raise EngineFailure(run.termination)
    slip = slip_of(
        run.t,
        joint_displacement(scene, run, _joint_name(scene)),
        run[f"{_joint_name(scene)}.slip_velocity"],
        _rounding(scene, run),
        **_window(scene, test),
    )
    ends = replace(
        run,
        t=run.t[[0, -1]],
        columns={name: column[[0, -1]] for name, column in run.columns.items()},
        events=(),
    )
    if timed:
        cost = replace(ends.cost, engine_s=visit(engine, scene, arguments).own_s)
        ends = replace(ends, cost=cost)
    return slip, ends


def _joint_name(scene: Scene) -> str:
    """Return the name of the joint with friction, of which scenes of this study have one."""
    return next(iter(scene.frictional_joints))


def _rounding(scene: Scene, run: Trajectory) -> float:
    """Return the rounding error of a displacement, m or rad.

    It is that of the largest coordinate in each step. Of an engine in single precision it is the effect of rounding
    that it has measured, and at least a unit in the last place of the largest coordinate.
    """
    turns = _joint_name(scene) in scene.pins
    size = 1.0
    measured = 0.0
    for body in scene.bodies:
        for coordinate in ("angle",) if turns else ("x", "y"):
            name = f"{body}.{coordinate}"
            size = max(size, float(np.max(np.abs(run[name]))))
            measured = max(measured, rounding_effect(run, name))
    steps = max(1, run.cost.counters.get("steps", len(run.t)))
    rounding = float(np.finfo(float).eps * size * steps)
    if PRECISION in run.settings:
        rounding = max(float(np.finfo(np.float32).eps * size), measured)
    return rounding


def true_slip(scene: Scene, test: str) -> tuple[Slip, float]:
    """Return the numbers of the slip in the truth of a scene, and the uncertainty of its displacement, m.

    Raises
    ------
    InputError
        If there is no truth.
    """
    truth = ground_truth(scene)
    if truth.tier == Tier.NONE:
        raise InputError(f"{scene.name}: found no truth: {truth.note}; expected one of its motion")
    guide = _joint_name(scene)
    t = np.linspace(0.0, scene.t_end, round(scene.t_end / TRUE_STEP) + 1)
    columns = truth(t)
    slip = slip_of(
        t,
        joint_displacement(scene, columns, guide),
        columns[f"{guide}.slip_velocity"],
        **_window(scene, test),
    )
    return slip, _displacement_uncertainty(scene, truth, guide)


def _displacement_uncertainty(scene: Scene, truth: Truth, name: str) -> float:
    """Return the uncertainty of the displacement of a joint in a truth, m or rad."""
    if name in scene.guides:
        return truth.uncertainty.get(f"{name}.displacement", 0.0)
    bodies = scene.pins[name].bodies
    return sum(truth.uncertainty.get(f"{body}.angle", 0.0) for body in bodies)


def _window(scene: Scene, test: str) -> dict[str, Any]:
    """Return the end of the landing (s), and the period over which displacements are averaged (s, or None)."""
    landed = load_data().stop.landed if test == STOP else LANDING
    return {"landed": landed, "period": scene.parameters.get(PERIOD)}


def plan(scope: Scope) -> Comparison[Tables]:
    """Return the runs of all methods on all scenes and loads of the depth, or on the one scene of the scope.

    Methods have the steps of the depth, or their tightest tolerance. At full depth, settings are also varied, at the
    step nearest to `COMMON_STEP` and at loads up to `USUAL`, and published creep is computed. Contact methods have one
    coefficient, mus = mu, as most engines do.
    """
    series = [*_method_series(scope), *_setting_series(scope)]
    joint_series = list(_joint_series(scope))
    trials = list(_trials(series))
    joint_trials = list(_trials(joint_series))
    truth_tasks = {
        trial.truth: Task(trial.truth, true_slip, (trial.scene, trial.test))
        for trial in (*trials, *joint_trials)
        if trial.test != HELD
    }
    run_tasks = [_task(trial) for trial in (*trials, *joint_trials)]
    published_tasks: list[Task] = []
    if _computes_published_creep(scope, series):
        published_tasks = [
            Task("hold/published creep", published_creep),
            Task("hold/published creep of a joint", published_joint_creep),
        ]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        remaining = iter(outcomes)
        truth_of = {key: next(remaining) for key in truth_tasks}
        rows = [_row(trial, next(remaining), truth_of.get(trial.truth)) for trial in trials]
        joint_rows = [
            _joint_row(trial, next(remaining), truth_of.get(trial.truth)) for trial in joint_trials
        ]
        tables: dict[str, pd.DataFrame] = {}
        if rows:
            table = pd.DataFrame(rows)
            tables |= {
                "hold": table,
                "hold-methods": methods_table(table),
                "hold-laws": laws_table(table),
                "hold-settings": settings_table(table),
            }
        if joint_rows:
            joint_table = pd.DataFrame(joint_rows)
            tables |= {
                "hold-joints": joint_table,
                "hold-joint-methods": joint_methods_table(joint_table),
            }
        for name, outcome in zip(PUBLISHED_TABLES, remaining):
            if outcome.status not in UNMADE:
                tables[name] = _published_table(outcome)
        return Tables(tables)

    chosen = {one.variant.label: one.variant for one in (*series, *joint_series)}
    return Comparison(
        (*truth_tasks.values(), *run_tasks, *published_tasks), tabulate, tuple(chosen.values())
    )


class _Load(NamedTuple):
    """A test, and the load at its beginning as a fraction of the limit."""

    test: str
    load: float


class _Series(NamedTuple):
    """Runs of one variant on one scene: all of its steps under all of these loads.

    `static` is True if the static coefficient is that of the scene, and False if mus = mu.
    """

    scene: Scene
    variant: Variant
    static: bool
    loads: Sequence[_Load]


def _depth_of(scope: Scope) -> Runs:
    """Return the scenes, loads and steps of the depth."""
    return load_data().depths[scope.depth]


def _scenes(scope: Scope, names: Iterable[str], constant: bool = False) -> list[Scene]:
    """Return the scenes of the catalogue with these names, or the one scene of the scope if there is one.

    That one is left out if its friction has a constant bound and `constant` is False, or the other way round.
    """
    if len(scope.scenes) == 1:
        return [scene for scene in scope.scenes if has_constant_bounds(scene) == constant]
    return [load_scene(name) for name in names]


def _method_series(scope: Scope) -> Iterator[_Series]:
    """Yield the runs of all methods as they are, first by scene and then by method."""
    depth = _depth_of(scope)
    data = load_data()
    loads = [_Load(HELD, load) for load in depth.loads]
    if depth.moved:
        loads += [_Load(RAMP, data.ramp.part), _Load(STOP, data.stop.part)]
    compared = variants(scope.engines)
    for scene in _scenes(scope, depth.scenes):
        for variant in compared:
            steps = depth.steps if variant.parameter == "dt" else variant.ladder[-1:]
            static = variant.fidelity == Fidelity.JOINT and has_static_coefficient(variant)
            yield _Series(scene, replace(variant, ladder=steps), static, loads)


def _joint_series(scope: Scope) -> Iterator[_Series]:
    """Yield the runs with scenes whose friction has a constant bound, at joint fidelity.

    They are those of all methods, and of `joint_subjects`. The bound is the same at rest and in slip, so that the
    friction is the engine's own where it has such an element.
    """
    depth = _depth_of(scope)
    data = load_data()
    loads = [_Load(HELD, load) for load in depth.joint_loads]
    if depth.moved:
        loads += [_Load(RAMP, data.ramp.part), _Load(STOP, data.stop.part)]
    subjects = [
        subject
        for subject in data.joint_subjects
        if scope.engines is None or subject.engine in scope.engines
    ]
    joint_variants = [
        variant for variant in variants(scope.engines) if variant.fidelity == Fidelity.JOINT
    ]
    for scene in _scenes(scope, depth.joint_scenes, constant=True):
        for variant in joint_variants:
            steps = depth.steps if variant.parameter == "dt" else variant.ladder[-1:]
            yield _Series(scene, replace(variant, ladder=steps), False, loads)
        for subject in subjects:
            for variant in subject.variants(depth.steps):
                plain = replace(variant, label=subject.label, subject="", setting="")
                yield _Series(scene, plain, False, loads)


def _setting_series(scope: Scope) -> Iterator[_Series]:
    """Yield the runs with varied settings; none at a depth without scenes for them."""
    depth = _depth_of(scope)
    if not depth.settings:
        return
    step = min(depth.steps, key=lambda step: rank("dt", step))
    loads = [_Load(HELD, load) for load in depth.loads if load <= USUAL]
    for scene in _scenes(scope, depth.settings):
        for subject in load_data().subjects:
            if scope.engines is not None and subject.engine not in scope.engines:
                continue
            for variant in subject.variants((step,)):
                yield _Series(scene, variant, False, loads)


def _trials(series: Iterable[_Series]) -> Iterator[Trial]:
    """Yield the single runs of some series."""
    for one in series:
        for test, load in one.loads:
            # Under an oscillating load, a slider that breaks away may rest again a moment later.
            if test == RAMP and PERIOD in one.scene.parameters:
                continue
            if test == STOP and not _comes_to_rest(one.scene, load):
                continue
            changed = changes(one.scene, test, load, one.static)
            scene = vary(one.scene, changed)
            for step in one.variant.ladder:
                yield Trial(scene, changed, one.static, one.variant, step, test, load)


def _comes_to_rest(scene: Scene, load: float) -> bool:
    """Test whether kinetic friction stops a joint with a constant bound under a load, a fraction of the static bound.

    The load of the test `STOP` is below kinetic friction that depends on normal forces, by its definition.
    """
    kinetic, static = scene.frictional_joints[_joint_name(scene)].bounds
    return not has_constant_bounds(scene) or load * static < kinetic


def _task(trial: Trial) -> Task:
    """Return the task of a run. Engine times are compared, and therefore measured well, where settings are varied."""
    engine = trial.variant.engine
    arguments = (engine, trial.scene, trial.test, trial.arguments, trial.varies_setting)
    return Task(trial.key, measure_slip, arguments)


def _computes_published_creep(scope: Scope, series: Iterable[_Series]) -> bool:
    """Test whether the creep of published cases is computed, too: with their engine, and not for a single scene."""
    if not _depth_of(scope).moved or len(scope.scenes) == 1:
        return False
    return any(one.variant.engine == ENGINE for one in series)


def _published_table(outcome: Outcome) -> pd.DataFrame:
    """Return the table of published creep, or one row with the reason why it could not be computed."""
    if outcome.value is not None:
        return outcome.value
    return pd.DataFrame([{"case": "all", "status": outcome.status, "reason": outcome.reason}])


def _row(trial: Trial, outcome: Outcome, truth: Outcome | None) -> dict[str, Any]:
    """Return the row of a run.

    A failed run has no numbers, only its reason; a run without a truth has no errors.

    Parameters
    ----------
    outcome
        Of `measure_slip`.
    truth
        Of `true_slip`; None for a test whose truth is rest.
    """
    slip: Slip | None = None
    ends: Trajectory | None = None
    if outcome.value is not None:
        slip, ends = outcome.value
    row = _description(trial, replace(outcome, value=ends))
    if slip is None or ends is None:
        return row
    row[AGAIN] = _command(trial)
    if trial.test != RAMP:
        row |= _creep(trial, slip, ends)
    if trial.test == HELD:
        row |= {
            LANDED: slip.landing,
            LETS_GO: slip.lets_go,
            PART: _part_of_bound(trial.scene, ends),
        }
    if truth is not None:
        row |= _errors(trial, slip, truth)
    return row


def _joint_row(trial: Trial, outcome: Outcome, truth: Outcome | None) -> dict[str, Any]:
    """Return the row of a run whose friction has a constant bound, as `_row`."""
    slip: Slip | None = None
    ends: Trajectory | None = None
    if outcome.value is not None:
        slip, ends = outcome.value
    row = _description(trial, replace(outcome, value=ends))
    turns = _joint_name(trial.scene) in trial.scene.pins
    row[JOINT_UNIT] = "rad/s" if turns else "m/s"
    if slip is None or ends is None:
        return row
    row[AGAIN] = _command(trial)
    if trial.test == HELD:
        row |= {
            JOINT_CREEP: slip.creep.value,
            JOINT_UNSURE: slip.creep.uncertainty,
            LETS_GO: slip.lets_go,
        }
    if truth is not None:
        found = _errors(trial, slip, truth)
        # the way to the stop is that of a pin or of a guide
        for name, own in ((STOPPED, JOINT_STOP), (STOP_UNSURE, JOINT_STOP_UNSURE)):
            if name in found:
                found[own] = found.pop(name)
        row |= found
    return row


def _description(trial: Trial, outcome: Outcome) -> dict[str, Any]:
    """Return what was run; the value of the outcome is the trajectory."""
    variant = trial.variant
    record = Record(trial.key, trial.scene.name, variant, trial.step, outcome)
    setting: dict[str, str | None] = {SUBJECT: None, SETTING: None, CHANGED: None}
    if trial.varies_setting:
        setting = {
            SUBJECT: variant.subject,
            SETTING: variant.setting,
            CHANGED: variant.changed if variant.changed else None,
        }
    return {
        **record.describe(),
        COEFFICIENTS: str(Coefficients.of(trial.static)),
        "truth": truth_key(trial.scene.name, trial.static),
        **setting,
        TEST: trial.test,
        LOAD: trial.load,
    }


def _command(trial: Trial) -> str | None:
    """Return the command that repeats a run (`run_command`)."""
    options: list[tuple[str, str]] = [
        (trial.variant.parameter, f"{trial.step:g}"),
        ("fidelity", trial.variant.fidelity),
    ]
    for name, value in trial.changed.items():
        options.append(("set", f"{name}={as_given(value)}"))
    for name, value in trial.variant.settings.items():
        options.append(("setting", f"{name}={as_given(value)}"))
    return run_command(trial.scene.name, trial.variant.engine, options)


def _creep(trial: Trial, slip: Slip, ends: Trajectory) -> dict[str, float]:
    """Return the creep of a run, absolute and relative to quantities of the method on which it may depend."""
    speed = abs(slip.creep.value)
    numbers = {CREEP: slip.creep.value, UNSURE: slip.creep.uncertainty}
    gravity = trial.scene.gravity
    if trial.variant.parameter == "dt" and gravity:
        numbers[OF_STEP] = speed / (math.hypot(*gravity) * trial.step)
    # The setting with the speed at which the engine regularizes friction.
    setting = load_data().regularization.get(f"{trial.variant.engine}, {trial.variant.fidelity}")
    if setting is not None:
        numbers[OF_ZONE] = speed / float(ends.settings[setting])
    return numbers


def _part_of_bound(scene: Scene, ends: Trajectory) -> float:
    """Return friction at the end as a fraction of mu times the corner forces, or NaN if these are zero.

    The corner forces of an engine may be larger than those of statics, on which the limit is based.
    """
    name = _joint_name(scene)
    mu = scene.frictional_guides[name].mu or 0.0
    bound = mu * sum(abs(ends[f"{name}.F{corner}"][-1]) for corner in (1, 2, 3, 4))
    if not bound > 0.0:
        return math.nan
    return abs(float(ends[f"{name}.friction"][-1])) / bound


def _errors(trial: Trial, slip: Slip, truth: Outcome) -> dict[str, Any]:
    """Return the errors of a run beyond the limit, or the reason why there is no truth."""
    if truth.value is None:
        return {"truth_note": f"{truth.status}: {truth.reason}"}
    true, uncertainty = truth.value
    if trial.test == STOP:
        return {STOPPED: slip.landing - true.landing, STOP_UNSURE: uncertainty}
    return _break_away(trial, slip, true)


def _break_away(trial: Trial, slip: Slip, true: Slip) -> dict[str, Any]:
    """Return the errors of the load at which a slider breaks away, and of its acceleration afterwards.

    The load is the one at which the slider reaches the speed `LET_GO`, in the run and in the truth alike. If the slider
    never does, or does so from the start, the error is a bound.
    """
    if true.let_go is None:
        return {"truth_note": f"the truth does not reach {LET_GO:g} m/s"}
    rate = trial.scene.parameters["ramp"]
    let_go = trial.scene.t_end if slip.let_go is None else slip.let_go
    # The speed is known at samples; between two of them a fixed step has no speed of its own.
    step = trial.step if trial.variant.parameter == "dt" else 0.0
    row: dict[str, Any] = {
        BREAK_AWAY: rate * (let_go - true.let_go),
        BREAK_UNSURE: rate * max(OUTPUT[RAMP], step),
    }
    if slip.let_go is None:
        row[BOUND] = "≥"
    elif slip.let_go <= LANDING:
        row[BOUND] = "≤"
    elif slip.acceleration is not None and true.acceleration:
        row[FASTER] = slip.acceleration / true.acceleration - 1
    return row


STUDY = Study(
    "hold",
    "Hold",
    "Does a slider remain at rest under a load below the limit of static friction?",
    present,
    plan,
    seconds=0.1,
    needs_scene=False,
    applies=reason_against,
    takes=frozenset({"engines"}),
    tables={
        "hold": "Runs of sliders that should be held",
        "hold-joints": "Runs of joints with a constant bound that should be held",
        "hold-joint-methods": "Creep of joints with a constant bound, by method",
        "hold-laws": "Laws of creep",
        "hold-methods": "Creep by method",
        "hold-published": "Published creep, and ours",
        "hold-published-joints": "Published creep of a joint, and ours",
        "hold-settings": "Creep by setting",
    },
    # a body that is held does not move: the length of its path is its creep
    nightly=NightlyNumbers(("path_length",), ("hold-moment", "hold-turning-bar")),
)
