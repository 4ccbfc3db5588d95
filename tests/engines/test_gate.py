"""What an engine returns passes one gate, whoever asked for it: a trajectory that is none of this run is a failed run with its reason."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import installed
from random_joint_scenes import random_joint_scene
from turning_scenes import draw
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.engines import BadTrajectory, EngineFailure, load_engine
from stiction.engines.coherence import check_balance, check_momentum_of_steps
from stiction.engines.examined import Examined
from stiction.engines.gate import first_problem, required_columns
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import Breakdown, Cost, Scene, load_scene, scene_from_dict, vary
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fidelity import Fidelity

SCENE, T_END = "slider-bar-case-1", 4.5  # holds the first stick and slip


def with_column(run, name, values):
    return replace(run, columns={**run.columns, name: values})


def without(run, *names):
    return replace(
        run, columns={name: values for name, values in run.columns.items() if name not in names}
    )


def rows(run, chosen):
    return replace(
        run, t=run.t[chosen], columns={name: values[chosen] for name, values in run.columns.items()}
    )


def with_event(run, place=0, **changes):
    events = list(run.events)
    events[place] = replace(events[place], **changes)
    return replace(run, events=tuple(events))


def spoiled(run, name, place, value):
    values = np.array(run[name], dtype=float)
    values[place] = value
    return with_column(run, name, values)


def shifted(run, name):
    return with_column(run, name, np.concatenate([run[name][:1], run[name][:-1]]))


def while_it(mode, run, name, change):
    """A column changed where the guide has a mode."""
    return with_column(run, name, np.where(run["guide.mode"] == mode, change(run[name]), run[name]))


def with_events(run, change):
    return replace(run, events=tuple(change(list(run.events))))


# wrong trajectories whose every part is right, or near it
INCOHERENT = {
    "friction of the other sign at rest": (
        lambda run: while_it(0, run, "guide.friction", np.negative),
        "do not balance at t = 0 s",
    ),
    "effort too large in slip": (
        lambda run: while_it(1, run, "motor.effort", lambda effort: effort + 0.1),
        "do not balance at t = ",
    ),
    "an acceleration a sample late": (
        lambda run: shifted(run, "slider.ax"),
        "do not balance at t = ",
    ),
    "a reaction a sample late": (lambda run: shifted(run, "pin.fx"), "do not balance at t = "),
    "an effort a sample late": (lambda run: shifted(run, "motor.effort"), "do not balance at t = "),
    "a slip velocity a sample late": (
        lambda run: shifted(run, "guide.slip_velocity"),
        "that of its states",
    ),
    "a displacement of another origin": (
        lambda run: with_column(run, "guide.displacement", run["guide.displacement"] + 1e-3),
        "that of its states",
    ),
    "corner forces of half the length": (
        lambda run: replace(
            run,
            columns={
                **run.columns,
                **dict(zip((f"guide.F{corner}" for corner in (1, 2, 3, 4)), corners_of(run, 0.3))),
            },
        ),
        "guide.moment = ",
    ),
    "corner forces twice": (
        lambda run: with_column(run, "guide.F2", 2 * run["guide.F2"]),
        "guide.normal_force = ",
    ),
    "a mode that is none": (
        lambda run: with_column(run, "guide.mode", run["guide.mode"] + 3),
        "expected -1, 0 or 1",
    ),
    "a mode of the other sign behind an event": (
        lambda run: with_column(
            run,
            "guide.mode",
            np.where(run.t > run.events[0].time, -run["guide.mode"], run["guide.mode"]),
        ),
        "that between its events",
    ),
    "an event missing": (
        lambda run: with_events(run, lambda events: [e for e in events if e.kind != "reversal"]),
        "expected every event once",
    ),
    "a corner event missing": (
        lambda run: with_events(run, lambda events: events[:1] + events[2:]),
        "expected every event once",
    ),
    "an event twice": (
        lambda run: with_events(run, lambda events: [events[0], *events]),
        "expected every event once",
    ),
    "a corner event twice": (
        lambda run: with_events(run, lambda events: [*events[:2], *events[1:]]),
        "expected every event once",
    ),
    "an event of another kind": (
        lambda run: with_event(run, kind="corner"),
        "expected those of a corner",
    ),
    "no event at all": (
        lambda run: with_events(run, lambda events: []),
        "expected one there, as the engine says that it locates events",
    ),
    "no event and no modes": (
        lambda run: with_events(without(run, "guide.mode"), lambda events: []),
        "no event of guide between t = ",
    ),
    "a single event, without values": (
        lambda run: with_events(run, lambda events: [replace(events[0], before={}, after={})]),
        "no event of guide between t = ",
    ),
    "the sides of an event exchanged": (
        lambda run: with_event(run, before=run.events[0].after, after=run.events[0].before),
        "expected those of a slip",
    ),
    "a state that jumps": (
        lambda run: with_event(run, after={**run.events[0].after, "slider.vx": 0.5}),
        "at t = 0.30",
    ),
    "an effort off behind an event": (
        lambda run: with_event(run, after={**run.events[0].after, "motor.effort": 0.0}),
        "(slip of guide at t = ",
    ),
}


def corners_of(run, length):
    """F1 .. F4 of R and T with another length; their sum is R."""
    n1, n2 = run["guide.F1"] - run["guide.F4"], run["guide.F2"] - run["guide.F3"]
    more = (n2 - n1) / 2 * (0.6 / length - 1)
    n1, n2 = n1 - more, n2 + more
    return np.maximum(n1, 0), np.maximum(n2, 0), np.maximum(-n2, 0), np.maximum(-n1, 0)


FAULTS = {
    "nothing": (lambda run: None, "NoneType None; expected a stiction.scenes.Trajectory"),
    "text": (lambda run: "done", "str 'done'; expected a stiction.scenes.Trajectory"),
    "another scene": (
        lambda run: replace(run, scene="pendulum"),
        "scene str 'pendulum'; expected 'slider-bar-case-1'",
    ),
    "another fidelity": (lambda run: replace(run, fidelity="contact"), "expected 'joint'"),
    "no version": (lambda run: replace(run, version=None), "version NoneType None; expected text"),
    "columns in a list": (
        lambda run: replace(run, columns=list(run.columns)),
        "expected a mapping of arrays by name",
    ),
    "no word": (lambda run: replace(run, termination=""), "expected 'end' or why it stopped"),
    "negative cost": (
        lambda run: replace(run, cost=Cost(stepping_s=-1.0)),
        "expected seconds >= 0",
    ),
    "empty": (lambda run: rows(run, slice(0, 0)), "no instant at all"),
    "times in a list": (
        lambda run: replace(run, t=list(run.t)),
        "expected a one-dimensional array of numbers",
    ),
    "times that are words": (
        lambda run: replace(run, t=run.t.astype(str)),
        "expected a one-dimensional array of numbers",
    ),
    "a time that is nan": (
        lambda run: replace(run, t=np.where(run.t == 1.0, np.nan, run.t)),
        "a time that is not finite, t[100]",
    ),
    "late begin": (lambda run: rows(run, slice(1, None)), "times that begin at 0.01 s; expected 0"),
    "time reversed": (lambda run: replace(run, t=T_END - run.t), "times that begin at 4.5 s"),
    "a time twice": (
        lambda run: replace(run, t=np.where(run.t == 1.01, 1.0, run.t)),
        "times that do not increase: 1 s, then 1 s",
    ),
    "half the time": (
        lambda run: rows(run, slice(0, 225)),
        "times up to 2.24 s and no reason; expected t_end = 4.5 s",
    ),
    "half the time, by a step of its own": (
        lambda run: replace(rows(run, slice(0, 225)), settings={"dt": T_END}),
        "and no reason",
    ),
    "beyond the end": (lambda run: replace(run, t=run.t * 2), "expected t_end = 4.5 s at most"),
    "the end alone": (lambda run: rows(run, [0, -1]), "times 4.5 s apart"),
    "breakdown and end": (
        lambda run: replace(run, breakdown=Breakdown("no solution", 1.0, "none")),
        "expected one of them",
    ),
    "breakdown at no time": (
        lambda run: replace(
            run, termination="none", breakdown=Breakdown("no solution", math.nan, "none")
        ),
        "expected a stiction.scenes.Breakdown within 0 .. 4.5 s",
    ),
    "without drift": (
        lambda run: without(run, "drift.position"),
        "no column drift.position; expected all columns",
    ),
    "without reactions": (
        lambda run: without(run, *(name for name in run.columns if name.startswith("guide."))),
        "no column guide.normal_force",
    ),
    "a column too short": (
        lambda run: with_column(run, "bar.x", run["bar.x"][:-1]),
        "column bar.x: an array of float64, shape (450,); expected",
    ),
    "a column of words": (
        lambda run: with_column(run, "bar.x", run["bar.x"].astype(str)),
        "column bar.x: an array of <U",
    ),
    "a number for a column": (
        lambda run: with_column(run, "bar.x", 0.0),
        "column bar.x: float 0.0; expected numbers of shape (451,)",
    ),
    "all nan": (
        lambda run: replace(
            run, columns={name: np.full(len(run.t), np.nan) for name in run.columns}
        ),
        ": nan at t = 0 s",
    ),
    "one nan": (
        lambda run: spoiled(run, "motor.effort", 100, np.inf),
        "column motor.effort: inf at t = 1 s",
    ),
    "another start": (
        lambda run: with_column(run, "bar.x", run["bar.x"] + 0.1),
        "a start that is not the scene's: bar.x",
    ),
    "another speed": (
        lambda run: spoiled(run, "bar.vx", 0, 9.0),
        "a start that is not the scene's: bar.vx = 9",
    ),
    "drift that is none": (lambda run: spoiled(run, "bar.x", 100, 0.0), "drift.position = "),
    "off by 1e74 m": (
        lambda run: spoiled(run, "bar.x", 100, 1e74),
        "states that have left the mechanism: 1e+74 m off the constraints at t = 1 s",
    ),
    "events in a list": (
        lambda run: replace(run, events=list(run.events)),
        "expected a tuple of stiction.scenes.Event",
    ),
    "an event that is text": (
        lambda run: replace(run, events=("stick",)),
        "event str 'stick'; expected a stiction.scenes.Event",
    ),
    "an event that is nothing": (
        lambda run: replace(run, events=(None,)),
        "event NoneType None; expected a stiction.scenes.Event",
    ),
    "a side with a number that is too large": (
        lambda run: with_event(run, after={**run.events[0].after, "slider.x": 10**400}),
        "expected finite numbers",
    ),
    "an event at no time": (
        lambda run: with_event(run, time=math.nan),
        "time float nan; expected finite seconds",
    ),
    "events in disorder": (
        lambda run: replace(run, events=run.events[::-1]),
        "expected events in order within 0 .. 4.5 s",
    ),
    "an event after the end": (
        lambda run: with_event(run, -1, time=5.0),
        "expected events in order within 0 .. 4.5 s",
    ),
    "an event of no guide": (lambda run: with_event(run, joint="hinge"), "of a guide of the scene"),
    "an event of no kind": (
        lambda run: with_event(run, kind="jerk"),
        "expected slip, stick, reversal, corner",
    ),
    "an event without values": (
        lambda run: with_event(run, after=None),
        "after NoneType None; expected values of the same columns",
    ),
    "an event of nothing known": (
        lambda run: with_event(run, before={"heat": 1.0}, after={"heat": 1.0}),
        "before has heat",
    ),
    "an event with the values of a neighbouring sample": (
        lambda run: with_event(
            run,
            **dict.fromkeys(
                ("before", "after"),
                dict(
                    zip(
                        run.columns,
                        (
                            float(values[np.searchsorted(run.t, run.events[0].time)])
                            for values in run.columns.values()
                        ),
                    )
                ),
            ),
        ),
        "the residual of its states then",
    ),
    "an event with nan": (
        lambda run: with_event(run, after=dict.fromkeys(run.events[0].before, math.nan)),
        "after, bar.x = float nan",
    ),
}


class Sound(ReferenceEngine):
    """The reference, from which the others differ in what they return, by settings of their own."""

    name, own = "sound", {}

    def default_settings(self, fidelity):
        return {**super().default_settings(fidelity), **self.own}

    def run(self, scene, *, settings, **arguments):
        own = {name: settings.get(name, default) for name, default in self.own.items()}
        rest = {name: value for name, value in settings.items() if name not in own}
        return self.changed(super().run(scene, settings=rest, **arguments), scene, **own)

    def changed(self, run, scene):
        return run


class Misbehaving(Sound):
    """Returns what the setting ``fault`` names."""

    name, own = "misbehaving", {"fault": ""}

    def changed(self, run, scene, fault):
        return {**FAULTS, **INCOHERENT}[fault][0](run)


class Blind(Sound):
    """Says that it locates no events, and reports none."""

    name = "blind"

    def locates_events(self, fidelity, settings):
        return False

    def changed(self, run, scene):
        return with_events(run, lambda events: [])


def motion_of(run, scene):
    return [
        np.stack([run[f"{body}.{label}"] for body in scene.bodies for label in labels], axis=1)
        for labels in BODY_COLUMNS
    ]


class Hasty(Sound):
    """Velocities behind the start are `factor` times the derivatives of its positions; the setting ``only`` names those of one kind, else all are. All that
    follows from them is as they have it."""

    name, own = "hasty", {"factor": 1.0, "only": ""}

    def changed(self, run, scene, factor, only):
        q, v, a = motion_of(run, scene)
        v[1:, [label.startswith(only) for _ in scene.bodies for label in BODY_COLUMNS[1]]] *= factor
        known = {name: run[name] for name in run.columns if name.endswith((".mode", ".friction"))}
        return replace(run, columns=recover_columns(scene, run.t, q, v, a, known), events=())


class Rough(Sound):
    """The motion with coefficients `factor` times those of the scene: all is coherent but the law."""

    name, own = "rough", {"mu": 1.0, "mus": 1.0}

    def run(self, scene, *, settings, **arguments):
        factors = {
            f"guide.{name}": settings.get(name, 1.0) * getattr(scene.guides["guide"], attribute)
            for name, attribute in (("mu", "mu"), ("mus", "static_coefficient"))
        }
        return super().run(vary(scene, factors), settings=settings, **arguments)

    def changed(self, run, scene, mu, mus):
        return run


class Recovered(Sound):
    """Forces recovered from the motion, of which it says no events; frictions are those of the setting ``friction``, times those of the motion."""

    name, own = "recovered", {"friction": {}, "nan": ""}

    def locates_events(self, fidelity, settings):
        return False

    def changed(self, run, scene, friction, nan):
        known = {
            f"{guide}.friction": factor * run[f"{guide}.friction"]
            for guide, factor in friction.items()
        }
        known |= {f"{guide}.mode": run[f"{guide}.mode"] for guide in friction}
        found = replace(
            run, columns=recover_columns(scene, run.t, *motion_of(run, scene), known), events=()
        )
        return spoiled(found, nan, 3, math.nan) if nan else found


class WithoutDrift(Sound):
    name = "without-drift"

    def changed(self, run, scene):
        return without(run, "drift.position")


class Astray(Sound):
    """Bodies that nothing holds are far from where they should be, ever further."""

    name = "astray"

    def changed(self, run, scene):
        more = {
            "ball.x": 1e74 * run.t**2,
            "ball.vx": 2e74 * run.t,
            "ball.ax": np.full(len(run.t), 2e74),
        }
        return replace(
            run,
            columns={**run.columns, **{name: run[name] + values for name, values in more.items()}},
        )


BALL = """
title = "A ball in flight"
gravity = [0, -9.81]
t_end = 2
[bodies.ball]
mass = 1
inertia = 1
position = [0, 0.5]
velocity = [3, 4]
"""


@pytest.fixture
def scene() -> Scene:
    return load_scene(SCENE)


@pytest.mark.parametrize("fault", FAULTS | INCOHERENT)
def test_each_fault_is_a_failure_with_its_reason(fault, scene):
    with pytest.raises(BadTrajectory) as caught:
        Misbehaving().simulate(scene, t_end=T_END, rtol=1e-6, fault=fault)
    assert str(caught.value).startswith("misbehaving returned ") and (FAULTS | INCOHERENT)[fault][
        1
    ] in str(caught.value)
    assert isinstance(caught.value, EngineFailure)


@pytest.mark.parametrize("factor", [0.8, 1.25, 2.0, -1.0, 180 / np.pi])
@pytest.mark.parametrize(
    ("name", "only"),
    [(name, only) for name in (SCENE, "four-bar", "pendulum", "slider-crank") for only in ("", "v")]
    + [("slider-crank", "omega"), ("four-bar", "omega")],
)
def test_velocities_that_are_not_those_of_the_positions(name, only, factor):
    asked = {"t_end": 2.0, "rtol": 1e-6, "only": only}
    with pytest.raises(
        BadTrajectory,
        match=r"hasty returned velocities of \S+ \((vx, vy|omega)\) that are not those of its positions: .* from t = .* expected the same",
    ):
        Hasty().simulate(load_scene(name), factor=factor, **asked)


class Stepped(Sound):
    """As of a fixed step: no events, no modes, frictions times a factor, the columns of ``kind`` times `kind_factor`; the other forces are recovered."""

    name, own = "stepped", {"friction": 1.0, "kind": "", "kind_factor": 1.0, "late": 0}

    def locates_events(self, fidelity, settings):
        return False

    def changed(self, run, scene, friction, kind, kind_factor, late):
        kinds = {"length": (0, 1), "rate": (1,), "acceleration": (2,), "": ()}[kind]
        motion = motion_of(run, scene)
        for k in (0, 1, 2) if kind == "length" else kinds:
            motion[k][
                :,
                [
                    label not in ("angle", "omega", "alpha")
                    for _ in scene.bodies
                    for label in BODY_COLUMNS[k]
                ],
            ] *= kind_factor
        known = {
            f"{guide}.friction": friction
            * np.concatenate(
                [
                    np.repeat(run[f"{guide}.friction"][:1], late),
                    run[f"{guide}.friction"][: len(run.t) - late],
                ]
            )
            for guide in scene.frictional_guides
        }
        return replace(
            run,
            columns=recover_columns(scene, run.t, *motion, known),
            events=(),
            settings={**run.settings, "dt": 1e-3},
        )


SLIDING = ["block-on-incline", "slider-bar-case-1", "coulomb-oscillator", "mass-on-belt"]


@pytest.mark.parametrize("name", SLIDING)
@pytest.mark.parametrize("late", [0, 1])
def test_friction_of_a_fixed_step_that_is_right_or_a_sample_late_passes(name, late):
    """A sample late at a reversal friction and velocity have one sign for a sample, and forces do not balance there."""
    run = Stepped().simulate(load_scene(name), rtol=1e-8, late=late)
    assert run.termination == "end"


@pytest.mark.parametrize("name", SLIDING)
@pytest.mark.parametrize(
    ("friction", "words"),
    [
        (-1.0, "friction drives the slider, and gives it"),
        (0.0, "the force along the guide that"),
        (0.5, "the force along the guide that"),
    ],
)
def test_friction_of_a_fixed_step_that_does_not_move_the_mechanism_as_it_moves(
    name, friction, words
):
    with pytest.raises(BadTrajectory, match=words):
        Stepped().simulate(load_scene(name), rtol=1e-8, friction=friction)


def test_friction_of_a_pin_that_does_not_fit_the_motion_is_reported_in_newton_metres():
    """Friction of the other sign: the reported moment is -tau, and the needed one tau, the bound in slip."""
    scene = load_scene("pendulum-dry-pin")
    run = load_engine("reference").simulate(scene, t_end=0.3)
    opposite = replace(
        run,
        columns={**run.columns, "pin.friction": -run["pin.friction"]},
        settings={"dt": 1e-4},
    )
    examined = Examined(
        trajectory=opposite,
        scene=scene,
        t_end=0.3,
        dt=None,
        output_step=float(run.t[1]),
        fidelity=Fidelity.JOINT,
        locates=lambda settings: False,
        keeps=lambda settings: True,
    )
    problem = next(check_momentum_of_steps(examined))
    reported, needed = re.match(
        r"pin\.friction = (\S+) at t = \S+ s; expected (\S+),", problem
    ).groups()
    tau = scene.joints["pin"].friction
    assert float(reported) == pytest.approx(-tau) and float(needed) == pytest.approx(tau)


@pytest.mark.parametrize(
    ("kind", "factor"),
    [("acceleration", -1.0), ("acceleration", 1e3), ("acceleration", 1e-3), ("length", 1e3)],
)
def test_columns_in_millimetres_or_of_the_other_sign(kind, factor):
    """On the incline positions and velocities in millimetres meet all constraints; accelerations and forces do not follow."""
    with pytest.raises(BadTrajectory):
        Stepped().simulate(load_scene("block-on-incline"), rtol=1e-8, kind=kind, kind_factor=factor)


@pytest.mark.parametrize("force", ["sine", "axis"])
@pytest.mark.parametrize("turns", [1, 2, 7, 0.998])
def test_what_turns_between_samples_is_not_judged(force, turns):
    """A load turns once or several times from one sample to the next, or nearly so, and looks as if it stood still or turned slowly."""
    step, rate = 0.01, 2 * np.pi * turns / 0.01
    tables = {
        "t_end": 1.0,
        "gravity": [0, -9.81],
        "bodies": {"s": {"mass": 2.0, "inertia": 0.1, "velocity": [3.0, 0]}},
        "joints": {"guide": {"type": "translational", "slider": "s", "mu": 0.1, "length": 0.3}},
    }
    if force == "sine":
        tables["forces"] = {
            "F": {
                "type": "force",
                "body": "s",
                "direction": [1, 1],
                "law": {"type": "sine", "amplitude": 30, "frequency": rate, "phase": 1.3},
            }
        }
    else:
        tables["bodies"]["r"] = {
            "mass": 1.0,
            "inertia": 0.01,
            "position": [0, 0.3],
            "angular_velocity": rate,
        }
        tables["joints"]["pin"] = {
            "type": "revolute",
            "bodies": ["r", "ground"],
            "points": [[0, 0], [0, 0.3]],
        }
        tables["drives"] = {
            "motor": {
                "type": "angle",
                "bodies": ["r", "ground"],
                "law": {"type": "linear", "rate": rate},
            }
        }
        tables["springs"] = {
            "k": {"type": "linear", "bodies": ["s", "r"], "axis": [1, 0], "stiffness": 50.0}
        }
    scene = scene_from_dict(tables, "turning")
    assert ReferenceEngine().simulate(scene, rtol=1e-9, output_step=step).termination == "end"
    assert Stepped().simulate(scene, rtol=1e-9, output_step=step).termination == "end"


@pytest.mark.parametrize("seed", [4, 5])
def test_a_bound_that_changes_between_samples_is_no_fault(seed):
    """Steps of 1 ms, samples of 10 ms: a turning force moves the load by more from one step to the next than neighbouring samples show."""
    pytest.importorskip("pymunk")
    scene = scene_from_dict(draw(np.random.default_rng(seed)).tables, "turning")
    assert load_engine("pymunk").simulate(scene, dt=1e-3).termination == "end"


@pytest.mark.parametrize("load", [0.0, 1e-15])
def test_friction_that_is_rounding_drives_nothing(load):
    """A guide without load: its friction is rounding of the other forces, of either sign."""
    scene = scene_from_dict(
        {
            "t_end": 1.0,
            "bodies": {"s": {"mass": 2.0, "inertia": 0.1, "velocity": [1, 0]}},
            "joints": {"guide": {"type": "translational", "slider": "s", "mu": 0.2}},
            "forces": {
                "F": {
                    "type": "force",
                    "body": "s",
                    "direction": [1, 0],
                    "law": {"type": "constant", "value": 1.0},
                }
            },
        },
        "unloaded",
    )

    class Rounding(Stepped):
        def changed(self, run, scene, **own):
            return with_column(
                super().changed(run, scene, **own), "guide.friction", np.full(len(run.t), load)
            )

    assert Rounding().simulate(scene).termination == "end"


def test_few_samples_and_parts_without_rows():
    """A free body has no rows; a run may have two instants."""
    free = scene_from_dict(
        {
            "t_end": 1.0,
            "gravity": [0, -9.81],
            "bodies": {"a": {"mass": 2.0, "inertia": 0.1}, "b": {"mass": 1.0, "inertia": 1e-9}},
        },
        "free",
    )
    for scene in (free, load_scene("block-on-incline"), load_scene("pendulum")):
        for output_step in (0.01, 0.7, scene.t_end):
            assert Stepped().simulate(scene, output_step=output_step).termination == "end"


@pytest.mark.parametrize("kept", [True, False])
def test_regularized_friction_is_not_held_to_the_balance(kept):
    """Friction that a program has of another instant of its step is a fault only where its law is Coulomb's."""

    class Smooth(Stepped):
        def keeps_cone(self, fidelity, settings):
            return kept

    def simulate():
        return Smooth().simulate(load_scene("block-on-incline"), friction=0.5)

    if kept:
        with pytest.raises(BadTrajectory, match="the force along the guide that"):
            simulate()
    else:
        assert simulate().termination == "end"


def test_events_of_a_part_need_no_columns_of_the_whole():
    """Forces that are open at an event of one of several parts, whose sides have no drift of the whole."""
    scene = vary(random_joint_scene(139), {"t_end": 1.0})
    run = ReferenceEngine().simulate(scene, dt=2e-3)
    assert any(
        np.isnan(list(event.before.values())).any() and "drift.position" not in event.before
        for event in run.events
    )


def test_random_motions_of_fixed_steps_pass_and_with_the_other_sign_of_friction_do_not():
    """Motions of the reference, reported as of a fixed step. The other sign shows where friction takes energy at all, unless all of that is short."""
    seen = missed = 0
    for seed in range(20):
        scene, asked = random_joint_scene(seed), {"rtol": 1e-8, "output_step": 0.004}
        run = ReferenceEngine().simulate(scene, **asked)
        if run.termination != "end":
            continue
        assert Stepped().simulate(scene, **asked).termination == "end", seed
        work = [
            np.trapezoid(run[f"{name}.friction"] * run[f"{name}.slip_velocity"], run.t)
            for name in scene.frictional_guides
        ]
        if min(work, default=0.0) < -1e-3:
            seen += 1
            try:
                Stepped().simulate(scene, friction=-1.0, **asked)
            except BadTrajectory:
                continue
            missed += 1
    assert seen >= 5 and missed <= seen / 4, (seen, missed)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"mu": 1.05},
            r"outside Coulomb's cone; expected -?\d\.\d+ in slip, by the load of its corners",
        ),
        ({"mu": 0.95}, r"outside Coulomb's cone; expected -?\d\.\d+ in slip"),
        ({"mu": 1.0001}, r"outside Coulomb's cone; expected -?\d\.\d+ in slip"),
        (
            {"mus": 1.05},
            r"guide.friction = \S+ at t = \S+ s, outside Coulomb's cone; expected at most \d\.\d+, by",
        ),
    ],
)
def test_a_coherent_motion_of_another_coefficient_is_outside_the_cone(changed, words, scene):
    """Of an engine that locates events; in slip the law is an equation."""
    with pytest.raises(BadTrajectory, match=words):
        Rough().simulate(scene, t_end=T_END, rtol=1e-9, **changed)


@pytest.mark.parametrize(
    "name",
    [
        "slider-bar-case-1",
        "slider-bar-case-2-mus-equals-mu",
        "block-on-incline",
        "coulomb-oscillator",
    ],
)
def test_friction_of_a_recovered_run_is_in_the_cone_and_a_twentieth_more_is_not(name):
    scene = load_scene(name)
    [guide] = scene.frictional_guides
    asked = {"t_end": min(T_END, scene.t_end), "rtol": 1e-6}
    assert Recovered().simulate(scene, **asked, friction={guide: 1.0}).termination == "end"
    with pytest.raises(
        BadTrajectory,
        match=rf"recovered returned {guide}\.friction = .* outside Coulomb's cone; expected at most ",
    ):
        Recovered().simulate(scene, **asked, friction={guide: 1.05})


TRAMMEL = {"t_end": 0.1, "rtol": 1e-6, "output_step": 0.01}


def test_frictions_that_two_guides_at_rest_share_are_nan_or_in_the_cone():
    """Nan as they are recovered; where one guide is said to hold all, what the balance leaves for it is more than it can."""
    scene = load_scene("hard/trammel-at-rest")
    shared = Recovered().simulate(scene, **TRAMMEL)
    assert (
        np.isnan(shared["guide-x.friction"]).all()
        and np.isnan(shared["guide-y.F1"]).all()
        and np.isfinite(shared["guide-x.moment"]).all()
    )
    with pytest.raises(BadTrajectory, match=r"guide-[xy]\.friction = .* outside Coulomb's cone"):
        Recovered().simulate(scene, **TRAMMEL, friction={"guide-x": 0.0})


@pytest.mark.parametrize(
    ("name", "friction", "spoilt"),
    [
        ("hard/trammel-at-rest", {}, "guide-x.moment"),
        ("hard/trammel-at-rest", {}, "bar.ax"),
        ("hard/trammel-at-rest", {"guide-x": 1.0}, "guide-y.friction"),
        ("hard/trammel-at-rest", {"guide-x": 1.0}, "pin-x.fx"),
        ("slider-bar-case-1", {}, "guide.friction"),
        ("slider-bar-case-1", {}, "motor.effort"),
    ],
)
def test_a_force_that_the_motion_determines_is_not_nan(name, friction, spoilt):
    with pytest.raises(
        BadTrajectory, match=rf"column {spoilt}: nan at t = 0\.03 s; expected finite numbers"
    ):
        Recovered().simulate(load_scene(name), **TRAMMEL, friction=friction, nan=spoilt)


@pytest.mark.parametrize("name", ["hard/trammel-at-rest", "hard/three-guides-at-rest"])
@pytest.mark.parametrize("engine", ["pymunk", "mujoco"])
def test_an_engine_that_holds_more_guides_than_freedoms_is_judged_by_its_motion(name, engine):
    """What share of the friction its guides have is not known, nor the sign of 1e-20 m/s of one that is at its bound."""
    solver, scene = installed(engine), load_scene(name)
    if solver.refusal(scene, "joint"):
        pytest.skip("not expressible")
    run = solver.simulate(scene, t_end=0.2, dt=1e-3)
    held = np.stack([run[f"{guide}.mode"] for guide in scene.frictional_guides]) == 0
    assert held[:, 1:].all() and all(
        np.isnan(run[f"{guide}.friction"]).all() for guide in scene.frictional_guides
    )


def test_friction_of_contacts_and_of_regularized_laws_may_leave_the_cone():
    assert all(
        load_engine(name).keeps_cone("joint", {"method": "located"})
        and not load_engine(name).keeps_cone("contact", {})
        for name in ("reference", "exudyn", "pymunk")
    )
    assert not load_engine("exudyn").keeps_cone("joint", {"method": "bristles"})


def test_what_an_engine_does_not_promise_is_not_asked_of_it(scene):
    found = Blind().simulate(scene, t_end=T_END, rtol=1e-6)
    assert len(found.events) == 0 and len(np.unique(found["guide.mode"])) == 3


@pytest.mark.parametrize(
    ("engine", "settings", "promised"),
    [
        ("reference", {}, True),
        ("exudyn", {}, True),
        ("exudyn", {"method": "bristles"}, False),
        ("exudyn", {"fidelity": "contact"}, False),
        ("moreau", {}, False),
        *(
            (engine, settings, bool(settings))
            for engine in ("pybullet", "mujoco", "drake", "dart")
            for settings in ({}, {"method": "accelerations"})
        ),
    ],
)
def test_engines_say_whether_they_locate_events(engine, settings, promised):
    """The block slides down until it stops: whoever promises events has one, whoever has one promises them."""
    solver, scene = (
        installed(engine),
        vary(
            load_scene("block-on-incline"),
            {
                "guide.mus": None,
                "incline": "deg(5)",
                "slider.velocity": ["0.5*cos(incline)", "-0.5*sin(incline)"],
            },
        ),
    )
    fidelity = "contact" if engine == "moreau" else settings.get("fidelity", "joint")
    run = solver.simulate(scene, **{**settings, "fidelity": fidelity})
    assert solver.locates_events(fidelity, run.settings) == promised == bool(run.events)


@pytest.mark.parametrize("output_step", [0.01, 0.5, 0.99, 1.0, 1e9])
def test_a_coarse_output_of_a_fast_motion_is_no_fault(output_step):
    """The crank turns once a second: at instants that lie apart by as much it is where it was, at its full speed."""
    assert (
        Sound().simulate(load_scene("slider-crank"), rtol=1e-8, output_step=output_step).termination
        == "end"
    )


def test_a_table_that_vibrates_as_often_as_it_is_looked_at_is_no_fault():
    """At each instant it has its full speed, no acceleration, and the place of the instant before."""
    table = {
        "t_end": 1,
        "bodies": {"table": {"mass": 1, "inertia": 1, "velocity": [2 * np.pi, 0]}},
        "joints": {"guide": {"type": "translational", "slider": "table", "direction": [1, 0]}},
        "drives": {
            "motor": {
                "type": "distance",
                "bodies": ["table", "ground"],
                "axis": [1, 0],
                "law": {"type": "sine", "amplitude": 0.01, "frequency": 200 * np.pi},
            }
        },
    }
    run = Sound().simulate(scene_from_dict(table, name="table"), rtol=1e-8)
    assert (
        len(run.t) == 101 and np.ptp(run["table.vx"]) < 1e-6 and np.abs(run["table.x"]).max() < 1e-6
    )


@pytest.mark.parametrize(
    "name",
    [
        "slider-bar-case-1",
        "four-bar",
        "slider-on-moving-guide",
        "elliptic-trammel",
        "mass-on-belt",
        "hard/zero-coefficients",
        "pendulum",
    ],
)
@pytest.mark.parametrize(
    "engine", ["reference", "moreau", "exudyn", "pymunk", "pybullet", "mujoco", "drake", "dart"]
)
def test_sound_engines_pass(name, engine):
    """Those of the suite, with steps that no output step is a multiple of; the columns are those that the gate asks for, and at most modes."""
    solver, scene = installed(engine), load_scene(name)
    for fidelity in solver.capabilities.fidelities:
        if solver.refusal(scene, fidelity) is not None:
            continue
        run = solver.simulate(scene, t_end=0.5, dt=7e-3, fidelity=fidelity)
        assert set(required_columns(scene)) <= set(run.columns)
        assert {
            column.rpartition(".")[2] for column in set(run.columns) - set(required_columns(scene))
        } <= {"mode"}
        assert run.termination != "end" or abs(run.t[-1] - 0.5) <= 3.5e-3 + 1e-12


def test_a_run_that_breaks_down_at_once_has_its_start():
    """The state there is known; accelerations and forces are not. Anywhere else they must be numbers."""
    scene = load_scene("existence-lost")
    run = load_engine("reference").simulate(scene, t_end=0.1)
    assert list(run.t) == [0.0] and run.breakdown.kind == "no solution" and run.termination != "end"
    assert np.isfinite(run["slider.x"][0]) and np.isnan(run["slider.ax"][0])

    def examined(found):
        return Examined(
            found, scene, 0.1, None, 0.1, "joint", lambda settings: True, lambda settings: True
        )

    assert first_problem(examined(run)) is None
    later = replace(run, breakdown=replace(run.breakdown, time=0.05))
    assert "expected finite numbers" in first_problem(examined(later))


def test_what_an_unstable_step_writes_on_its_way_out_is_no_motion():
    """The paper's scheme through the singular position of the four-bar: a state 1e5 m off, then nan. The run says so and ends before them."""
    run = load_engine("reference").simulate(
        load_scene("four-bar"), dt=1e-2, method="paper", stabilization="baumgarte"
    )
    assert run.breakdown is not None and "no finite forces or state" in run.termination
    assert 6 < run.t[-1] <= run.breakdown.time and run["drift.position"].max() < 1e-3


@pytest.mark.parametrize(
    "engine", ["reference", "moreau", "exudyn", "pymunk", "pybullet", "mujoco", "drake", "dart"]
)
def test_an_output_step_longer_than_the_run_still_shows_its_end(engine):
    solver = installed(engine)
    run = solver.simulate(
        load_scene("four-bar"),
        t_end=0.5,
        dt=5e-3,
        output_step=1e9,
        fidelity=solver.capabilities.fidelities[0],
    )
    assert run.t[0] == 0 and run.t[-1] == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("comparison", ["drift", "torque"])
def test_a_comparison_goes_on_without_it(comparison, tmp_path, in_this_process):
    """`compare` with an engine without a column: its rows fail with the reason, the others have their numbers."""
    engine, table = f"{__name__}:WithoutDrift", tmp_path / "table.csv"
    ended = CliRunner().invoke(
        app,
        [
            "compare",
            comparison,
            SCENE,
            "--engines",
            engine,
            "--t-end",
            str(T_END),
            "--quick",
            "--out",
            str(table),
        ],
    )
    assert ended.exit_code == 0, ended.output
    found = pd.read_csv(table)
    bad = found[found["engine"] == engine]
    assert (
        len(bad)
        and set(bad["status"]) == {"failed"}
        and bad["reason"].str.contains("no column drift.position").all()
    )
    assert (found.loc[found["variant"] == "reference", "status"] == "ok").all()


def test_a_run_further_off_than_the_mechanism_is_large_is_wrong_and_not_ranked(
    tmp_path, monkeypatch, in_this_process
):
    """After 2 s the ball is 4e74 m off; 11 m below its start, which is the largest coordinate of its flight."""
    monkeypatch.chdir(tmp_path)
    Path("ball.toml").write_text(BALL)
    engine = f"{__name__}:Astray"
    ended = CliRunner().invoke(
        app,
        [
            "compare",
            "cost",
            "ball.toml",
            "--engines",
            engine,
            "--repeats",
            "1",
            "--quick",
            "--out",
            "cost.csv",
        ],
    )
    assert ended.exit_code == 0 and "position error 4e+74 m" in ended.output, ended.output
    found = pd.read_csv("cost.csv")
    bad = found[found["engine"] == engine]
    assert (
        len(bad)
        and set(bad["status"]) == {"wrong"}
        and bad["reason"].str.contains("the mechanism and its motion measure 11 m").all()
    )
    assert bad.filter(like="error").isna().all(axis=None)
    assert (found.loc[found["variant"] == "reference", "status"] == "ok").all()

    Path("night.toml").write_text(
        f'scenes = ["ball.toml"]\nmeasure = ["accuracy"]\n[variants.bad]\nengine = "{engine}"\nrtol = [1e-6]\n'
    )
    night = CliRunner().invoke(app, ["nightly", "night.toml"])
    assert (
        night.exit_code == 4
        and "1 with a wrong result" in night.output
        and "position error 4e+74 m" in night.output
    ), night.output


def test_an_error_within_the_mechanism_is_an_error(scene):
    from stiction.comparisons.measures.accuracy import errors, size_of
    from stiction.truths import slider_bar_truth

    assert size_of(scene) == 1.25  # m, of the bar from the origin at the start
    run, truth = Sound().simulate(scene, t_end=T_END), slider_bar_truth(scene, T_END)
    near = with_column(run, "bar.x", run["bar.x"] + 0.9 * 1.25)
    assert errors(near, truth, size_of(scene))["position_error"] == pytest.approx(0.9 * 1.25)
    reach = max(1.25, np.abs(truth(run.t)["bar.x"]).max())
    far = errors(with_column(run, "bar.x", run["bar.x"] + 1.1 * reach), truth, size_of(scene))
    assert far["status"] == "wrong" and "position_error" not in far


def test_a_part_is_balanced_though_another_lacks_a_column():
    """Two sleds, each a part of its own: the friction of one has the wrong sign, the other has no normal force."""
    sled = {"mass": 1, "inertia": 0.1, "velocity": [1, 0]}
    guide = {"type": "translational", "mu": 0.2}
    scene = scene_from_dict(
        {
            "t_end": 1,
            "gravity": [0, -10],
            "bodies": {"first": sled, "second": sled},
            "joints": {
                "rail": guide | {"slider": "first"},
                "track": guide | {"slider": "second"},
            },
        }
    )
    run = load_engine("reference").simulate(scene)

    def without(values):
        return {name: value for name, value in values.items() if name != "track.normal_force"}

    columns = without(run.columns) | {"rail.friction": -run["rail.friction"]}
    events = [
        replace(event, before=without(event.before), after=without(event.after))
        for event in run.events
    ]
    partial = replace(run, columns=columns, events=tuple(events))
    examined = Examined(
        partial, scene, 1.0, None, 0.01, "joint", lambda settings: True, lambda settings: True
    )
    assert "do not balance" in next(check_balance(examined))
