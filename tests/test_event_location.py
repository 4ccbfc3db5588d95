"""No event is missed, and none depends on the output: against closed forms, linear programs and the law itself.

A slider at rest under given loads is an explicit function of time until it breaks away: with a horizontal guide, R = m g, the moment
T(t) of a torque and a pull P(t) it holds as long as

    |P| <= mus max(|R|, (2/a) |T + (b/2) mus d R|) ,   d the direction of the pull.

The capacity has a kink wherever a corner changes its surface, and the drawn loads exceed it for as little as a few microseconds.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, linprog

from comparisons.hard.checks import can_jam_time
from engines.reference import ReferenceEngine
from reference_checks import simulate
from reference_impl.contact_modes import can_jam, capacity, margin
from reference_impl.kinematics import workspace
from reference_impl.mechanism import Mechanism
from scenes import load_scene, scene_from_dict

T_END = 12.0
MASS, G = 1.3, 9.81


def loaded_slider(length, width, mus, pulls, torques):
    """A slider at rest on a level guide; pulls and torques are (amplitude, frequency, phase)."""
    def law(amplitude, frequency, phase):
        return {"type": "sine", "amplitude": amplitude, "frequency": frequency, "phase": phase}

    forces = {f"pull-{i}": {"type": "force", "body": "slider", "direction": [1, 0], "law": law(*pull)} for i, pull in enumerate(pulls)}
    forces |= {f"torque-{i}": {"type": "torque", "body": "slider", "law": law(*torque)} for i, torque in enumerate(torques)}
    return scene_from_dict({
        "t_end": T_END, "gravity": [0, -G], "bodies": {"slider": {"mass": MASS, "inertia": 0.1}},
        "joints": {"guide": {"type": "translational", "slider": "slider", "length": length, "width": width, "mu": 0.8 * mus, "mus": mus}},
        "forces": forces}, "loaded slider")


def total(loads, t):
    return sum(amplitude * np.sin(frequency * t + phase) for amplitude, frequency, phase in loads)


def holding_margin(length, width, mus, pulls, torques, t):
    """Capacity minus pull; the moment that the guide takes up is minus the torque."""
    P, T, R = total(pulls, t), -total(torques, t), MASS * G
    return mus * np.maximum(R, 2 / length * np.abs(T - 0.5 * width * mus * np.sign(P) * R)) - np.abs(P)


def first_break_away(*parameters):
    """By a grid whose spacing a tenth of the shortest excess that is drawn, and Brent's method; None if it never breaks away."""
    t = np.linspace(0, T_END, 2_000_001)
    negative = np.flatnonzero(holding_margin(*parameters, t) < 0)
    if not len(negative):
        return None
    i = negative[0]
    return 0.0 if i == 0 else brentq(lambda t: float(holding_margin(*parameters, t)), t[i - 1], t[i], xtol=1e-15)


def between(low, high):
    return st.integers(0, 1000).map(lambda k: low * (high / low) ** (k / 1000))


sines = st.tuples(between(0.05, 1.0), between(0.3, 12.0), between(0.01, 6.0))


@settings(max_examples=150)
@given(between(0.1, 2.0), between(0.05, 1.5), between(0.05, 0.8), st.lists(sines, min_size=1, max_size=3), st.lists(sines, max_size=2),
       st.sampled_from([0.3, 1e-2, 1e-4, 1e-6, 1e-8, -1e-6, -1e-3]))
def test_first_break_away_of_a_slider_under_given_loads(length, width, mus, pulls, torques, excess):
    """Loads that exceed the capacity by a part `excess` of it at their worst instant, or do not, and never mind for how short a time."""
    if mus * width >= length:
        width = 0.9 * length / mus
    t = np.linspace(0, T_END, 200_001)
    # scale the pulls so that the least margin is -excess of the capacity: a multiple of them that touches it, by bisection
    low, high = 0.0, 1e4
    for _ in range(60):
        middle = 0.5 * (low + high)
        scaled = [(middle * amplitude, *rest) for amplitude, *rest in pulls]
        low, high = (low, middle) if holding_margin(length, width, mus, scaled, torques, t).min() < 0 else (middle, high)
    pulls = [((1 + excess) * high * amplitude, *rest) for amplitude, *rest in pulls]
    parameters = length, width, mus, pulls, torques
    expected = first_break_away(*parameters)
    margins = holding_margin(*parameters, t)
    if expected is None and margins.min() < 1e-9 * np.max(np.abs(margins)):
        return  # touched between two points of the grid, to rounding
    run = simulate(loaded_slider(*parameters), t_end=T_END, rtol=1e-9, output_step=T_END)
    slips = [event.time for event in run.events if event.kind == "slip"]
    if expected is None:
        assert not slips
        return
    if expected == 0.0:
        assert run["guide.mode"][0] != 0
        return
    # a margin of the size of rounding moves a transversal zero by as much, a grazing one by its root
    assert slips and abs(slips[0] - expected) < 1e-6


@pytest.mark.parametrize("name", ["slider-bar-case-1", "slider-bar-case-3", "coulomb-oscillator", "elliptic-trammel", "mass-on-belt",
                                  "slider-on-moving-guide", "hard/break-away-for-a-millisecond", "hard/two-guides-sliding"])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_output_does_not_change_the_motion(name, rtol):
    """End state, events and their two-sided values are the same to the last bit, whatever is output."""
    scene = load_scene(name)
    found = []
    for step in (scene.t_end, 0.37, 0.01, 0.001):
        run = simulate(scene, rtol=rtol, output_step=step)
        end = {column: values[-1] for column, values in run.columns.items()}
        found.append((end, [(e.time, e.kind, e.joint, e.before, e.after) for e in run.events], run.termination))
    assert found[0][2] == "end" and all(other == found[0] for other in found[1:])


def largest_friction(length, width, mus, R, T, sense):
    """By linear programs over all corner configurations: the largest friction, along `sense`, of a slider at rest; inf if unbounded.

    Unknowns: n1, n2 by the surface each corner rests on (signs s1, s2), f+ and f- with |f+-| <= mus N+-. Balance: s1 N1 + s2 N2 = R,
    (a/2)(s2 N2 - s1 N1) + (b/2)(f+ - f-) = T.
    """
    best = -math.inf
    for s1 in (1, -1):
        for s2 in (1, -1):
            lower, upper = [(1 + s1) / 2, (1 + s2) / 2], [(1 - s1) / 2, (1 - s2) / 2]
            bounds = [[-mus * n for n in surface] + row for surface, rows in ((lower, ([1, 0], [-1, 0])), (upper, ([0, 1], [0, -1])))
                      for row in rows]
            answer = linprog([0, 0, -sense, -sense], A_ub=bounds, b_ub=[0] * 4, bounds=[(0, None)] * 2 + [(None, None)] * 2,
                             A_eq=[[s1, s2, 0, 0], [-length / 2 * s1, length / 2 * s2, width / 2, -width / 2]], b_eq=[R, T])
            if answer.status == 3:
                return math.inf
            if answer.status == 0:
                best = max(best, -answer.fun)
    return best


@settings(max_examples=60)
@given(between(0.1, 2.0), between(0.05, 3.0), between(0.05, 0.9), st.integers(-20, 20), st.integers(-20, 20))
def test_static_friction_is_the_largest_that_the_law_allows(length, width, mus, R, T):
    """At full mobilization where mus b <= a, whatever the loads; none is the largest where mus b > a: such a guide can jam."""
    mechanism = Mechanism(loaded_slider(length, width, mus, [], []))
    m = mechanism.arrays
    assert can_jam(m, 0) == (mus * width > length)
    if R == 0 and T == 0:
        return
    if abs(mus * width / length - 1) < 1e-6:
        return
    for d in (1, -1):  # a slip along d is held by a friction along -d
        found = largest_friction(length, width, mus, float(R), float(T), -d)
        if mus * width > length:
            assert math.isinf(found)
        else:
            assert found == pytest.approx(capacity(m, 0, float(R), float(T), float(d)), rel=1e-7, abs=1e-9)


def test_an_audit_sees_what_the_law_forbids():
    """The audit's own formula, on forces that are right and wrong."""
    mechanism = Mechanism(loaded_slider(0.5, 0.2, 0.3, [], []))
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    row = m.friction["row"][0]
    w.force[row], w.force[row + 1], w.force[m.rows] = 10.0, 0.0, 2.9
    assert margin(m, w, np.array([0]), 0)[1] > 0
    w.force[m.rows] = 3.1
    assert margin(m, w, np.array([0]), 0)[1] < 0
    w.force[m.rows], w.slip[0] = -0.24 * 10.0, 0.5
    assert margin(m, w, np.array([1]), 0) == pytest.approx((0.5, 0.0), abs=1e-12)
    assert margin(m, w, np.array([-1]), 0)[0] < 0 and margin(m, w, np.array([-1]), 0)[1] < 0
    w.force[row + 1] = 4.0  # a moment that needs opposite corners: the load is larger, and so must friction be
    assert margin(m, w, np.array([1]), 0)[1] < -1.0


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_guide_that_can_jam_is_not_moved_and_not_held(rtol):
    """Wider than long by more than 1/mus: where full mobilization is exceeded both rest and slip obey the law; at every tolerance."""
    scene = load_scene("hard/can-jam")
    run = ReferenceEngine().simulate(scene, rtol=rtol, output_step=0.1)
    assert run.breakdown.kind == "several solutions" and run.breakdown.guide == "guide"
    assert run.breakdown.time == pytest.approx(can_jam_time(scene), abs=1e-9)
