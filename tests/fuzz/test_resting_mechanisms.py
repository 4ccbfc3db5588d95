"""Mechanisms of one degree of freedom that come to rest: their independent motion, and the reference held to it."""

from dataclasses import replace

import numpy as np
import pytest

from fuzz import resting_mechanisms
from fuzz.resting_mechanisms import (
    AGREES,
    FAMILIES,
    NO_BALANCE,
    OTHER_EVENTS,
    OTHER_MOTION,
    OWN_ERROR,
    SLIPS,
    STOPS,
    TOLERANCE,
    drawn,
    judge,
    judge_drawn,
    runs,
)
from fuzz.seeds import seed_or_fresh
from stiction.scenes import Breakdown, load_scene, scene_from_dict
from stiction.truths.enumerated_motion import Contact, simulate

SEED = 8
SLIDER = {
    "type": "translational",
    "slider": "block",
    "length": 0.4,
    "width": 0.1,
    "mu": 0.3,
    "mus": 0.4,
}


def incline(degrees, speed):
    slope = np.deg2rad(degrees)
    along = [np.cos(slope), np.sin(slope)]
    block = {
        "mass": 2,
        "inertia": 0.1,
        "angle": slope,
        "velocity": [speed * along[0], speed * along[1]],
    }
    return scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"block": block},
            "joints": {"guide": {**SLIDER, "direction": along, "angle": slope}},
        }
    )


def test_a_block_stops_and_stays_in_closed_form():
    """Up 20 degrees, tan < mus, it stops at t = v/(g (sin + mu cos)), at v t/2; at 25 degrees it comes back."""
    slope = np.deg2rad(20)
    motion = simulate(incline(20, 1.0), 5.0)
    stop = 1 / (9.81 * (np.sin(slope) + 0.3 * np.cos(slope)))
    assert [event.kind for event in motion.events] == ["stick"] and motion.rest == pytest.approx(
        stop, abs=1e-12
    )
    assert motion.q[-1, :2] == pytest.approx(
        stop / 2 * np.array([np.cos(slope), np.sin(slope)]), abs=1e-12
    )
    forces = motion.at(stop / 2)[1]
    assert (forces.R[0], forces.f[0]) == pytest.approx(
        (2 * 9.81 * np.cos(slope), -0.6 * 9.81 * np.cos(slope)), rel=1e-12
    )
    assert simulate(incline(25, 1.0), 1.0).rest is None
    assert simulate(incline(20, 0.0), 1.0).rest == 0.0


def ladder(angle, mus):
    """Without weight but a force at the middle of the rod."""
    end = np.array([np.cos(angle), np.sin(angle)])
    bodies = {
        "rod": {"mass": 1, "inertia": 0.1, "position": list(end / 2), "angle": np.pi - angle},
        "foot": {"mass": 1, "inertia": 0.1, "position": [end[0], 0]},
        "head": {"mass": 1, "inertia": 0.1, "position": [0, end[1]]},
    }
    joints = {
        "low": {"type": "revolute", "bodies": ["rod", "foot"], "points": [[-0.5, 0], [0, 0]]},
        "high": {"type": "revolute", "bodies": ["rod", "head"], "points": [[0.5, 0], [0, 0]]},
        "floor": {"type": "translational", "slider": "foot", "mu": mus},
        "wall": {"type": "translational", "slider": "head", "direction": [0, 1], "mu": mus},
    }
    force = {
        "type": "force",
        "body": "rod",
        "direction": [0, -1],
        "law": {"type": "constant", "value": 7},
    }
    return scene_from_dict({"bodies": bodies, "joints": joints, "forces": {"weight": force}})


@pytest.mark.parametrize("mus", [0.1, 0.4])
def test_a_ladder_is_held_from_its_classic_angle_on(mus):
    """Floor and wall both at their limit: N_floor + mus N_wall = W, N_wall = mus N_floor, moments about the foot:
    tan(angle) = (1 - mus^2)/(2 mus)."""
    limit = np.arctan((1 - mus**2) / (2 * mus))
    for step, expected in ((1e-6, True), (-1e-6, False)):
        m = Contact(ladder(limit + step, mus))
        q, v = m.equations.start()
        margin = m.largest_margin(m.equations.at(0.0, q, v), np.zeros_like(q))
        assert (margin > 0) == expected and 0 < abs(margin) < 1e-4


@pytest.fixture(
    scope="module", params=range(len(FAMILIES)), ids=[family.__name__ for family in FAMILIES]
)
def mechanism(request):
    return drawn(SEED, request.param)


def test_forces_are_those_of_newton_and_euler(mechanism):
    """M q'' by difference quotients: constraints hold, and what reactions leave is a force of pins alone."""
    _, motion = mechanism
    m, step = motion.contact, max(motion.steps, key=lambda step: step.end - step.state.t_old)
    t, h = (step.state.t_old + step.end) / 2, (step.end - step.state.t_old) / 20
    q = [np.split(step.state(t + k * h), 2)[0] for k in (-2, -1, 0, 1, 2)]
    acceleration = (-q[0] + 16 * q[1] - 30 * q[2] + 16 * q[3] - q[4]) / (12 * h**2)
    velocity = (q[0] - 8 * q[1] + 8 * q[3] - q[4]) / (12 * h)
    terms = m.equations.at(t, q[2], velocity)
    assert np.max(np.abs(terms.phi)) < OWN_ERROR
    size = np.max(np.abs(acceleration)) + np.max(np.abs(terms.gamma))
    assert np.max(np.abs(terms.J @ acceleration + terms.gamma)) < 1e-4 * size
    forces = motion.at(t)[1]
    of_guides = np.concatenate([m.row, np.array(m.row) + 1])
    left = m.equations.mass * acceleration - terms.Q - forces.f @ terms.W
    left = left - np.concatenate([forces.R, forces.T]) @ terms.J[of_guides]
    of_pins = np.delete(terms.J, of_guides, 0).T
    assert np.max(
        np.abs(left - of_pins @ np.linalg.lstsq(of_pins, left, rcond=None)[0])
    ) < 1e-4 * np.max(np.abs(left))


def test_reference_comes_to_rest(mechanism):
    scene, motion = mechanism
    found = [
        (rtol, judge(scene, motion, run, rtol)) for rtol, run in runs(scene, (1e-6, 1e-9, 1e-12))
    ]
    assert [each for each in found if each[1].outcome != AGREES] == []


@pytest.mark.parametrize("name", ["trammel-comes-to-rest", "oblique-trammel-comes-to-rest"])
def test_scenes_of_the_catalogue_come_to_rest(name):
    scene = load_scene(f"hard/{name}")
    motion = simulate(scene, scene.t_end)
    found = [
        judge(scene, motion, run, rtol)
        for rtol, run in runs(scene, [10.0**-k for k in range(6, 13)])
    ]
    assert [each for each in found if each.outcome != AGREES] == []


@pytest.mark.long
@pytest.mark.parametrize("block", range(20))
def test_reference_brings_a_thousand_mechanisms_to_rest(block):
    seed = seed_or_fresh(None)
    wrong = [
        f"resting_mechanisms.drawn({seed}, {i}): {verdict}"
        for i in range(block, 1000, 20)
        for verdict in judge_drawn(seed, i, [10.0**-k for k in range(6, 13)])
        if verdict.outcome != AGREES
    ]
    assert not wrong, "\n".join(wrong)


def test_a_motion_shorter_than_what_events_may_be_shifted_by_is_judged_by_its_place_of_rest():
    """It stops after 3.3 ms, by the closed form above; at rtol = 1e-6 an event may be shifted by 1 ms, ten times which is left out."""
    scene = incline(20, 0.02)
    motion = simulate(scene, scene.t_end)
    assert motion.rest < 3.4e-3
    for rtol, run in runs(scene, [1e-6]):
        assert judge(scene, motion, run, rtol).outcome == AGREES
        moved = replace(run, columns={**run.columns, "block.x": run["block.x"] + 2e-3})
        assert judge(scene, motion, moved, rtol).outcome == OTHER_MOTION


def test_each_fault_is_found(mechanism):
    """A run that agrees, with one thing wrong."""
    scene, motion = mechanism
    rtol = 1e-12
    [*_, (_, run)] = runs(scene, [rtol])  # with projection
    assert judge(scene, motion, run, rtol).outcome == AGREES
    guide, body = next(iter(scene.frictional_guides)), next(iter(scene.bodies))

    def other(column, rows, change):
        values = run[column].copy()
        values[rows] += change
        return replace(run, columns={**run.columns, column: values})

    stick = next(
        k for k, event in enumerate(run.events) if event.kind == "stick" and event.joint == guide
    )
    before, event, after = run.events[:stick], run.events[stick], run.events[stick + 1 :]
    shift = 1e-7 * (1 + np.max(np.abs(run[f"{guide}.slip_velocity"])) / motion.events[-1].rate)
    normal = 1e-5 * np.max(np.abs(run[f"{guide}.normal_force"]))
    for expected, wrong in (
        (STOPS, replace(run, breakdown=Breakdown("several solutions", 1.0, "two"))),
        (SLIPS, other(f"{guide}.mode", -1, 1)),
        (SLIPS, other(f"{guide}.slip_velocity", -1, 1e-9)),
        (OTHER_EVENTS, replace(run, events=before + after)),
        (OTHER_EVENTS, replace(run, events=(*before, replace(event, kind="reversal"), *after))),
        (
            OTHER_EVENTS,
            replace(run, events=(*before, replace(event, time=motion.rest + shift), *after)),
        ),
        (OTHER_MOTION, other(f"{body}.x", slice(None), 1e-6)),
        (OTHER_MOTION, other(f"{guide}.normal_force", slice(0, -1), normal)),
        (OTHER_MOTION, other(f"{guide}.friction", slice(0, -1), normal)),
        (NO_BALANCE, other(f"{guide}.normal_force", -1, normal)),
        (NO_BALANCE, other(f"{guide}.friction", -1, normal)),
    ):
        assert judge(scene, motion, wrong, rtol).outcome == expected


def test_friction_beyond_the_static_cone_is_found(mechanism):
    """Forces at rest that are in balance, judged by coefficients of a thousandth: the same mechanism could not rest."""
    scene, motion = mechanism
    [*_, (_, run)] = runs(scene, [1e-12])
    slippery = Contact(scene)
    slippery.mus = slippery.mus / 1000
    assert judge(scene, replace(motion, contact=slippery), run, 1e-12).outcome == NO_BALANCE


def test_a_fault_is_judged_again_by_a_tighter_motion(monkeypatch):
    """What disagrees with the motion is held to one with far shorter steps, which decides."""
    asked = []

    def motion(scene, t_end, *tolerance):
        asked.append(tolerance)
        return simulate(scene, t_end, *tolerance)

    monkeypatch.setattr(resting_mechanisms, "simulate", motion)
    true = resting_mechanisms.judge

    def wrong(scene, motion, run, rtol):
        return replace(true(scene, motion, run, rtol), outcome=SLIPS)

    monkeypatch.setattr(resting_mechanisms, "judge", wrong)
    assert [found.outcome for found in judge_drawn(SEED, 0, [1e-12])] == 3 * [SLIPS]
    assert asked[-1] == (TOLERANCE / 10,) and asked.count(asked[-1]) == 1
