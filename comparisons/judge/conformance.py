"""Conformance of an engine: five scenes from simple to the slider-bar, and what is wrong in the first wrong one.

A wrong sign or unit causes an error as large as the motion. A method of first order with a thousand steps causes an
error of a thousandth of it. `LIMIT` lies between.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from stiction.comparisons.judge.judgement import Judgement, judge
from stiction.comparisons.measures.accuracy import size_of
from stiction.engines.isolation import Task, isolate
from stiction.engines.protocol import BadTrajectory
from stiction.engines.registry import absolute_name, load_engine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, load_scene, scene_from_dict, vary
from stiction.truths.physics import physics_of

LIMIT = 0.02
"""Largest error of a position or velocity, as a fraction of the column's size or of the mechanism's.

For forces and accelerations, the mean error over time is compared, reduced by what the rows do not determine, as a
fraction of the column's size or of `SLIGHT` times the largest one's. With steps of 1 ms, the engines of the suite have
errors of at most 0.01 of a friction force.
"""
SLIGHT = 0.1
"""Fraction of the largest force (moment) below which a force is too small to be judged by its own size."""
STEP = 1e-3
"""Step of engines with fixed steps, s."""
TOLERANCE = 1e-8
"""Relative tolerance of adaptive engines."""
OUTPUT_STEP = 0.01
"""Distance of the rows, s."""
FOLLOWING = ("moment", "F1", "F2", "F3", "F4", "friction_lower", "friction_upper")
"""Columns of a guide that follow from its friction and normal force: mentioned only if these are right."""
FORCE_UNITS = ("N", "N m", "m/s²", "rad/s²")
"""Units of forces and accelerations, which jump at events and are therefore judged by their mean errors."""
_STONE = {
    "mass": 2,
    "inertia": 0.3,
    "position": [1, 2],
    "angle": 0.5,
    "velocity": [3, 1],
    "angular_velocity": 2,
}
_BAR = {"mass": 2, "inertia": 0.2, "position": [0.3, -0.4], "angle": 0.4}
_PIN = {
    "type": "revolute",
    "bodies": ["bar", "ground"],
    "points": [["-0.3*cos(0.4) + 0.4*sin(0.4)", "0.3*sin(0.4) + 0.4*cos(0.4)"], [0, 0]],
}
_SPRUNG = {
    "t_end": 1,
    "gravity": [0, -9.81],
    "bodies": {
        "plate": {
            "mass": 2,
            "inertia": 0.3,
            "position": [0.5, 0.2],
            "angle": 0.3,
            "velocity": [0.5, 1],
            "angular_velocity": 1,
        }
    },
    "springs": {
        "spring": {
            "type": "linear",
            "bodies": ["plate", "ground"],
            "points": [[0.3, 0.1], [0, 1.5]],
            "stiffness": 40,
            "damping": 3,
            "rest_length": 0.8,
        },
        "twist": {
            "type": "torsional",
            "bodies": ["plate", "ground"],
            "stiffness": 5,
            "damping": 0.3,
            "rest_angle": 0.5,
        },
    },
    "forces": {
        "pull": {
            "type": "force",
            "body": "plate",
            "point": [-0.2, 0.1],
            "direction": [1, 1],
            "law": {"type": "sine", "amplitude": 8, "frequency": 6},
        },
        "turn": {
            "type": "torque",
            "body": "plate",
            "law": {"type": "linear", "offset": 1, "rate": 2},
        },
    },
}
ADDED: Mapping[str, str] = {
    "free-body": "the start, weight, and the table itself",
    "pendulum-on-a-pin": "a pin: points[0] is in the axes of bodies[0], from its centre of mass, and turns with "
    "its angle",
    "sprung-body": "a spring and a damper between points off the centres of mass, with a rest length; a load with a "
    "lever, and a torque",
    "block-on-incline": "a guide with friction, whose load is the sum of the corner forces, max(|R|, 2 |N| / length)",
    "slider-bar-case-1": "a drive and a load that follow laws of time, a spring, a slider that sticks and slips, and "
    "friction with a lever (width)",
}
"""What a scene contains that the scenes before it do not, and what is therefore suspected first."""

RIGHT = "right"
"""Verdict on a scene whose motion and forces are those of the truth."""


class Trial(NamedTuple):
    """The verdict on one scene.

    Attributes
    ----------
    scene : str
        Name of the scene.
    verdict : str
        `RIGHT`, `Status.WRONG`, or the status of a run without a result.
    words : tuple of str
        The reasons, or the position error if the run is right.
    """

    scene: str
    verdict: str
    words: tuple[str, ...]


def conformance_scenes() -> list[Scene]:
    """Return the scenes: a free body, a pendulum on a pin, a sprung body, a block on an incline, the slider-bar."""
    free = {"t_end": 1, "gravity": [0.5, -9.81], "bodies": {"stone": _STONE}}
    pendulum = {"t_end": 1, "gravity": [0, -9.81], "bodies": {"bar": _BAR}, "joints": {"pin": _PIN}}
    return [
        scene_from_dict(free, name="free-body"),
        scene_from_dict(pendulum, name="pendulum-on-a-pin"),
        scene_from_dict(_SPRUNG, name="sprung-body"),
        vary(load_scene("block-on-incline"), {"t_end": 1}),
        vary(load_scene("slider-bar-case-1"), {"t_end": 3}),
    ]


def conformance(engine: str, timeout_s: float) -> Iterator[Trial]:
    """Yield the trial of each scene up to the first that is wrong; a refusal is not wrong.

    Parameters
    ----------
    engine
        Name or path of the engine.
    timeout_s
        Time that the run of one scene may take, s.
    """
    load_engine(engine)
    for scene in conformance_scenes():
        [outcome] = isolate(
            [Task(scene.name, _attempt, (absolute_name(engine), scene))],
            workers=1,
            timeout_s=timeout_s,
        )
        trial = outcome.value
        if trial is None:
            trial = Trial(scene.name, outcome.status, (outcome.reason,))
        yield trial
        if trial.verdict not in (RIGHT, Status.REFUSED):
            return


def _attempt(name: str, scene: Scene) -> Trial:
    """Return the trial of a scene; called in a child process."""
    engine = load_engine(name)
    capabilities = engine.capabilities
    fidelity = capabilities.fidelities[0]
    scene = physics_of(scene, capabilities.static_coefficient.get(fidelity, False))
    arguments: dict[str, Any] = {
        "fidelity": fidelity,
        "output_step": OUTPUT_STEP,
        "dt": None if capabilities.adaptive else STEP,
        "rtol": TOLERANCE if capabilities.adaptive else None,
    }
    objection = ""
    try:
        run = engine.simulate(scene, **arguments)
    except BadTrajectory as error:
        # The trajectory is judged although no comparison would accept it: its errors say more about
        # the mistake than the first objection to it.
        objection = str(error)
        settings = engine.settings_of_run(
            {}, fidelity=fidelity, dt=arguments["dt"], rtol=arguments["rtol"]
        )
        run = engine.run(scene, t_end=scene.t_end, settings=settings, **arguments)
        if not isinstance(run, Trajectory):
            raise
    judgement = judge(scene, run)
    faults = list(_faults(judgement))
    if run.termination != "end":
        faults.insert(0, f"stopped: {run.termination}")
    if not faults and objection:
        faults = [objection]
    if faults:
        return Trial(scene.name, Status.WRONG, tuple(faults))
    return Trial(scene.name, RIGHT, (f"position error {judgement.error:.2g} m",))


def _faults(judgement: Judgement) -> Iterator[str]:
    """Yield what is wrong: the time grid, then the wrong columns by cause, then inconsistencies of the columns."""
    t, scene = judgement.table.t, judgement.scene
    if not judgement.is_complete:
        yield f"time grid: goes from {t[0]:g} to {t[-1]:g} s; expected 0 to {scene.t_end:g} s"
    limits = _limits(judgement)
    wrong = _wrong_columns(judgement, limits)
    if wrong.empty:
        return

    # A forgotten permutation is a better explanation than a unit or sign that happens to fit.
    causes = {}
    for column, hint in wrong["hint"].items():
        name = str(column)
        causes[name] = _exchanged(judgement, name) or hint
    if all(causes.values()):
        columns_of_cause: dict[str, list[str]] = {}
        for name, cause in causes.items():
            columns_of_cause.setdefault(cause, []).append(name)
        for cause, names in columns_of_cause.items():
            yield f"{', '.join(names)}: {cause}"
    else:
        # If one column has no explanation, those of the others are coincidences.
        begin = _first_wrong_time(judgement, {name: limits[name] for name in causes})
        yield (
            f"{', '.join(causes)}: wrong from t = {begin:.3g} s on; no unit, sign or "
            "order of columns explains it"
        )
        yield f"new in this scene: {ADDED[scene.name]}"
    for finding in judgement.tables["findings"]["finding"]:
        yield f"its columns do not fit: {finding}"


def _limits(judgement: Judgement) -> pd.Series:
    """Return the largest error that is allowed, by column of the table, in the unit of the column.

    A position, velocity or angle is compared with the larger of its own size and the mechanism's length. A force is
    compared with its own size or a fraction of the largest force, and a moment likewise, where the largest force with
    the mechanism as its lever counts as a moment. An acceleration is the sum of forces that nearly cancel, among them
    the weight: of a body at rest only their errors remain. It is therefore compared with at least the acceleration due
    to gravity.
    """
    rows = judgement.tables["errors"].set_index("column")
    scene = judgement.scene
    length = size_of(scene)
    gravity = float(np.hypot(*(scene.gravity or (0.0, 0.0))))
    largest = rows["size"].groupby(rows["unit"]).max()
    force = largest.get("N", 0.0)
    moment = max(largest.get("N m", 0.0), force * length)
    acceleration = largest.get("m/s²", 0.0)
    angular_acceleration = max(largest.get("rad/s²", 0.0), acceleration / length)
    least_sizes = {
        "N": SLIGHT * force,
        "N m": SLIGHT * moment,
        "m/s²": max(SLIGHT * acceleration, gravity),
        "rad/s²": max(SLIGHT * angular_acceleration, gravity / length),
    }
    is_force = rows["unit"].isin(FORCE_UNITS)
    least_size = rows["unit"].map(least_sizes).where(is_force, length)
    return LIMIT * np.maximum(rows["size"], least_size)


def _wrong_columns(judgement: Judgement, limits: pd.Series) -> pd.DataFrame:
    """Return the rows of the table of errors, by column, whose error exceeds its limit.

    Columns that follow from friction and normal force are left out if others are wrong, too.
    """
    rows = judgement.tables["errors"].set_index("column")
    is_force = rows["unit"].isin(FORCE_UNITS)
    # The mean error of a column that jumps is not known better than the rows determine it.
    error = rows["error"] - rows["uncertainty"].where(is_force, 0.0)
    is_judged = (rows["measure"] == "largest") | is_force
    wrong = rows[is_judged & (error > limits)]
    following = [f"{guide}.{label}" for guide in judgement.scene.guides for label in FOLLOWING]
    is_following = wrong.index.isin(following)
    return wrong if is_following.all() else wrong[~is_following]


def _first_wrong_time(judgement: Judgement, limits: Mapping[str, float]) -> float:
    """Return the first time (s) of the table at which one of these columns is farther from the truth than its limit."""
    t = judgement.table.t
    true = judgement.truth(t)
    is_wrong = np.zeros(len(t), dtype=bool)
    for name, limit in limits.items():
        is_wrong |= np.abs(judgement.table.columns[name] - true[name]) > limit
    return float(t[np.argmax(is_wrong)])


def _exchanged(judgement: Judgement, column: str) -> str:
    """Return the column of the same unit whose values a column has, in words; empty if there is none."""
    values = judgement.table.columns[column]
    true = judgement.truth(judgement.table.t)
    unit = judgement.tables["errors"].set_index("column")["unit"]
    for other in unit.index[unit == unit[column]].drop(column):
        range_of_other = np.ptp(true[other])
        difference = np.max(np.abs(values - true[other]))
        # A column that is constant has no values by which it could be recognized.
        if range_of_other > 0 and difference <= LIMIT * range_of_other:
            return f"has the values of {other}: order of bodies, points or columns?"
    return ""
