"""Both sides of every event are an instant of the motion: on the constraints, obeying the equations of motion, between its neighbours."""

import numpy as np
import pytest

from stiction.engines.registry import load_engine
from stiction.engines.shared.acceleration_integrator import METHOD
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import load_scene

SCENE, T_END, COARSE = (
    "slider-bar-case-1",
    2.7,
    1e-2,
)  # it breaks away at 0.31 s and turns at 2.64 s
LOCATING = {
    "event-driven": ("reference", {"rtol": 1e-9}, 1e-11, 1e-9),
    "paper's scheme": ("reference", {"dt": COARSE}, 1e-11, 1e-9),
    "paper's scheme, trial and error": (
        "reference",
        {"dt": COARSE, "solver": "trial"},
        1e-11,
        1e-9,
    ),
    "textbook": ("reference", {"dt": COARSE, "method": "textbook"}, 1e-11, 1e-9),
    "Exudyn": ("exudyn", {"dt": COARSE}, 1e-6, COARSE**2),
    "PyBullet's accelerations": ("pybullet", {"rtol": 1e-5, "method": METHOD}, 1e-6, 1e-9),
}
"""Engines and ways that locate events, their settings, and to what part of the largest force their values meet the equations of motion:
rounding of some ten operations with condition numbers up to 1e3; Exudyn's Newton stops at 1e-10 of a state that forces follow times 1/dt^2;
PyBullet computes accelerations with its own constraint solver. Then, how far states may jump: m, rad and per second; Exudyn is of second order."""


@pytest.fixture(scope="module", params=LOCATING)
def located(request):
    engine, settings, accuracy, jump = LOCATING[request.param]
    short = request.param == "textbook"  # slow, and step by step the paper's scheme (test_paper.py)
    run = load_engine(engine).simulate(
        load_scene(SCENE), t_end=0.5 if short else T_END, output_step=COARSE, **settings
    )
    assert {event.kind for event in run.events} >= ({"slip"} if short else {"slip", "reversal"})
    return run, accuracy, jump


def states(side, labels):
    return np.array(
        [side[f"{body}.{label}"] for body in load_scene(SCENE).bodies for label in labels]
    )


POSITION, VELOCITY, ACCELERATION = ("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha")


def test_states_do_not_jump(located):
    run, _, jump = located
    for event in run.events:
        for labels in (POSITION, VELOCITY):
            np.testing.assert_allclose(
                states(event.before, labels), states(event.after, labels), rtol=0, atol=jump
            )


def test_sides_obey_the_equations_of_motion(located):
    """M q'' = QE + J^T lambda + W_T^T lambda_T with the event's own forces, in another derivation than any engine's."""
    run, accuracy, _ = located
    equations = EquationsOfMotion(load_scene(SCENE))
    size = max(np.max(np.abs(run[row])) for row in equations.rows)
    for event in run.events:
        for side in (event.before, event.after):
            q, v, a = (states(side, labels) for labels in (POSITION, VELOCITY, ACCELERATION))
            terms = equations.at(event.time, q, v)
            forces = (
                terms.QE
                + terms.J.T @ [side[row] for row in equations.rows]
                + terms.W.T @ [side["guide.friction"]]
            )
            np.testing.assert_allclose(equations.mass * a, forces, rtol=0, atol=accuracy * size)


def test_sides_are_on_the_constraints_at_the_time_of_the_event(located):
    """As closely as the samples are; the drive's constraint contains time, so that a neighbour's state under the event's time is off by rate x time."""
    run, *_ = located
    equations = EquationsOfMotion(load_scene(SCENE))
    for event in run.events:
        phi = equations.at(
            event.time, states(event.before, POSITION), states(event.before, VELOCITY)
        ).phi
        assert np.linalg.norm(phi) <= 2 * np.max(run["drift.position"]) + 1e-12


def test_sides_lie_between_their_neighbours(located):
    """Taylor from the sample before: off by half the largest acceleration times the time squared, at most."""
    run, _, jump = located
    for event in run.events:
        k = int(np.searchsorted(run.t, event.time, side="right")) - 1
        ahead = event.time - run.t[k]
        for x, vx, ax in (
            ("slider.x", "slider.vx", "slider.ax"),
            ("bar.x", "bar.vx", "bar.ax"),
            ("bar.angle", "bar.omega", "bar.alpha"),
        ):
            bend = np.max(np.abs(run[ax])) * ahead**2 / 2
            assert abs(event.before[x] - run[x][k] - ahead * run[vx][k]) <= 1.01 * bend + jump
            assert (
                abs(event.before[vx] - run[vx][k]) <= 1.01 * np.max(np.abs(run[ax])) * ahead + jump
            )


def test_events_without_values_where_they_are_not_wanted():
    run = load_engine("reference").simulate(
        load_scene(SCENE), t_end=T_END, dt=COARSE, output_step=COARSE, event_values=False
    )
    assert run.events and not any(event.before or event.after for event in run.events)
