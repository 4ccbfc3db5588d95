"""Conformance of an engine: five scenes from simple to the slider-bar, and in words what is wrong in the first.

A wrong sign or unit is off by as much as the motion is large, a method of first order with a thousand steps by a
thousandth of it: `LIMIT` lies between.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from stiction.comparisons.judge.judgement import Judgement, judge
from stiction.comparisons.measures.accuracy import size_of
from stiction.engines.isolation import Task, isolate
from stiction.engines.protocol import BadTrajectory
from stiction.engines.registry import absolute_name, load_engine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, load_scene, scene_from_dict, vary
from stiction.truths.physics import physics_of

LIMIT = 0.02
"""Largest error of a position, or of a velocity, as a part of the column's size or of the mechanism's.

Of a force or an acceleration it is the mean error over time, beyond what is not known between two rows, as a part of
the column's size or of `SLIGHT` times the largest one's. The engines of the suite, with steps of 1 ms, are off by 0.01
of a friction at most.
"""
SLIGHT = 0.1
"""Part of the largest force (moment) below which a force is too small to be judged by its own size."""
STEP, TOLERANCE, OUTPUT_STEP = 1e-3, 1e-8, 0.01
"""Seconds, relative, seconds."""
FOLLOWING = ("moment", "F1", "F2", "F3", "F4", "friction_lower", "friction_upper")
"""Columns that follow from friction and normal force: named where these are right."""
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
"""New in a scene, and so the first suspect."""


RIGHT = "right"
"""Verdict on a scene whose motion and forces are those of the truth."""


class Trial(NamedTuple):
    """Verdict on one scene, `RIGHT`, `Status.WRONG` or the status of an `Outcome` without a value, and why."""

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
    """Yield a trial of each scene up to the first that is wrong, `timeout_s` seconds each; a refusal is none."""
    load_engine(engine)
    for scene in conformance_scenes():
        [outcome] = isolate(
            [Task(scene.name, _attempt, (absolute_name(engine), scene))],
            workers=1,
            timeout_s=timeout_s,
        )
        trial = outcome.value or Trial(scene.name, outcome.status, (outcome.reason,))
        yield trial
        if trial.verdict not in (RIGHT, Status.REFUSED):
            return


def _attempt(name: str, scene: Scene) -> Trial:
    """The trial of a scene, in the child."""
    engine, against = load_engine(name), []
    can, fidelity = engine.capabilities, engine.capabilities.fidelities[0]
    scene = physics_of(scene, can.static_coefficient.get(fidelity, False))
    arguments: dict[str, Any] = {
        "fidelity": fidelity,
        "output_step": OUTPUT_STEP,
        "dt": None if can.adaptive else STEP,
        "rtol": TOLERANCE if can.adaptive else None,
    }
    try:
        run = engine.simulate(scene, **arguments)
    except BadTrajectory as error:  # what no comparison takes says most about mistakes
        settings = engine.settings_of_run(
            {}, fidelity=fidelity, dt=arguments["dt"], rtol=arguments["rtol"]
        )
        run = engine.run(scene, t_end=scene.t_end, settings=settings, **arguments)
        against = [str(error)]
        if not isinstance(run, Trajectory):
            raise
    found = judge(scene, run)
    stopped = [] if run.termination == "end" else [f"stopped: {run.termination}"]
    if faults := [*stopped, *_faults(found)] or against:
        return Trial(scene.name, Status.WRONG, tuple(faults))
    return Trial(scene.name, RIGHT, (f"position error {found.error:.2g} m",))


def _faults(found: Judgement) -> Iterator[str]:
    """What is wrong in words: the time grid, then the columns that are wrong by cause, then what does not fit."""
    t, scene = found.table.t, found.scene
    if not found.is_complete:
        yield f"time grid: goes from {t[0]:g} to {t[-1]:g} s; expected 0 to {scene.t_end:g} s"
    rows = found.tables["errors"].set_index("column")
    is_force = rows["unit"].isin(["N", "N m", "m/s²", "rad/s²"])  # or an acceleration: they jump
    # A force is judged by its own size, one that is next to nothing by that of the others, a moment by that of forces
    # with the mechanism as a lever. An acceleration is what forces leave of each other, weight among them: where they
    # hold a body still only their own error is left of it.
    largest, length = rows["size"].groupby(rows["unit"]).max(), size_of(scene)
    force, fastest = largest.get("N", 0.0), largest.get("m/s²", 0.0)
    weight = float(np.hypot(*(scene.gravity or (0.0, 0.0))))
    scale = rows["unit"].map(
        {
            "N": SLIGHT * force,
            "N m": SLIGHT * max(largest.get("N m", 0.0), force * length),
            "m/s²": max(SLIGHT * fastest, weight),
            "rad/s²": max(
                SLIGHT * max(largest.get("rad/s²", 0.0), fastest / length), weight / length
            ),
        }
    )
    limits = LIMIT * np.maximum(rows["size"], scale.where(is_force, length))
    beyond = rows["error"] - rows["uncertainty"].where(is_force, 0.0)
    judged = (rows["measure"] == "largest") | is_force
    wrong = rows[judged & (beyond > limits)]
    follows = np.array([name.rpartition(".")[2] in FOLLOWING for name in wrong.index], dtype=bool)
    if not follows.all():
        wrong = wrong[~follows]
    causes = {column: _exchanged(found, column) or hint for column, hint in wrong["hint"].items()}
    if "" in causes.values():  # then what seems to explain some of the columns is chance
        true = found.truth(t)
        off = [np.abs(found.table.columns[name] - true[name]) > limits[name] for name in causes]
        yield (
            f"{', '.join(causes)}: wrong from t = {t[np.argmax(np.any(off, axis=0))]:.3g} s on; no unit, sign or "
            "order of columns explains it"
        )
        yield f"new in this scene: {ADDED[scene.name]}"
    else:
        for cause in dict.fromkeys(causes.values()):
            yield f"{', '.join(column for column in causes if causes[column] == cause)}: {cause}"
    if len(wrong):
        yield from (
            f"its columns do not fit: {finding}" for finding in found.tables["findings"]["finding"]
        )


def _exchanged(found: Judgement, column: str) -> str:
    """Say whose values a column has, if it has those of another one."""
    values, true = found.table.columns[column], found.truth(found.table.t)
    unit = found.tables["errors"].set_index("column")["unit"]
    for other in unit.index[unit == unit[column]].drop(column):
        if np.max(np.abs(values - true[other])) <= LIMIT * np.ptp(true[other]) > 0:
            return f"has the values of {other}: order of bodies, points or columns?"
    return ""
