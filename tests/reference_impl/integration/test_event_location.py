"""No event is missed, and none depends on the output: against closed forms, linear programs and the law itself.

A slider at rest under given loads is an explicit function of time until it breaks away: with a horizontal guide, R = m g, the moment
T(t) of a torque and a pull P(t) it holds as long as

    |P| <= mus max(|R|, (2/a) |T + (b/2) mus d R|) ,   d the direction of the pull.

The capacity has a kink wherever a corner changes its surface, and the drawn loads exceed it for as little as a few microseconds.
"""

import math

import numpy as np
import pytest
from fuzz.driven_mechanisms import draw
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from reference_checks import simulate
from scipy.optimize import brentq, linprog, minimize_scalar

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.friction.coulomb import can_jam, capacity
from stiction.reference_impl.friction.frozen_mode import margin
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.scenes import load_scene, scene_from_dict

T_END = 12.0
MASS, G = 1.3, 9.81


def loaded_slider(length, width, mus, pulls, torques):
    """A slider at rest on a level guide; pulls and torques are (amplitude, frequency, phase)."""

    def law(amplitude, frequency, phase):
        return {"type": "sine", "amplitude": amplitude, "frequency": frequency, "phase": phase}

    forces = {
        f"pull-{i}": {"type": "force", "body": "slider", "direction": [1, 0], "law": law(*pull)}
        for i, pull in enumerate(pulls)
    }
    forces |= {
        f"torque-{i}": {"type": "torque", "body": "slider", "law": law(*torque)}
        for i, torque in enumerate(torques)
    }
    return scene_from_dict(
        {
            "t_end": T_END,
            "gravity": [0, -G],
            "bodies": {"slider": {"mass": MASS, "inertia": 0.1}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "length": length,
                    "width": width,
                    "mu": 0.8 * mus,
                    "mus": mus,
                }
            },
            "forces": forces,
        },
        "loaded slider",
    )


def total(loads, t):
    return sum(amplitude * np.sin(frequency * t + phase) for amplitude, frequency, phase in loads)


def holding_ratio(length, width, mus, pulls, torques, t):
    """Capacity over pull; the moment that the guide takes up is minus the torque."""
    P, T, R = total(pulls, t), -total(torques, t), MASS * G
    capacity = mus * np.maximum(R, 2 / length * np.abs(T + 0.5 * width * mus * np.sign(P) * R))
    return capacity / np.maximum(np.abs(P), 1e-300)


def minima(*parameters):
    """Grid points at which the ratio is least among its neighbours, and the least values beside them, in order of time."""
    t = np.linspace(0, T_END, 100_001)
    ratio = holding_ratio(*parameters, t)
    inner = np.flatnonzero((ratio[1:-1] <= ratio[:-2]) & (ratio[1:-1] <= ratio[2:])) + 1
    yield 0.0, 0.0, float(ratio[0])
    for i in inner[ratio[inner] < 1.01 * ratio.min()]:
        found = minimize_scalar(
            lambda x: float(holding_ratio(*parameters, x)),
            bounds=(t[i - 1], t[i + 1]),
            method="bounded",
            options={"xatol": 1e-13},
        )
        yield (
            t[i - 1],
            *min(
                ((float(found.x), float(found.fun)), (t[i], float(ratio[i]))),
                key=lambda pair: pair[1],
            ),
        )


def first_break_away(*parameters):
    """By the minima of the ratio and Brent's method; None if it never breaks away."""
    t = np.linspace(0, T_END, 100_001)
    below = np.flatnonzero(holding_ratio(*parameters, t) < 1)
    for before, least, value in minima(*parameters):
        if len(below) and t[below[0]] <= before:
            break
        if value < 1:
            return (
                0.0
                if least == 0
                else brentq(
                    lambda x: float(holding_ratio(*parameters, x)) - 1, before, least, xtol=1e-15
                )
            )
    if not len(below):
        return None
    i = below[0]
    return (
        0.0
        if i == 0
        else brentq(lambda x: float(holding_ratio(*parameters, x)) - 1, t[i - 1], t[i], xtol=1e-15)
    )


def between(low, high):
    return st.integers(0, 1000).map(lambda k: low * (high / low) ** (k / 1000))


sines = st.tuples(between(0.05, 1.0), between(0.3, 12.0), between(0.01, 6.0))


@settings(max_examples=100)
@given(
    between(0.1, 2.0),
    between(0.05, 1.5),
    between(0.05, 0.8),
    st.lists(sines, min_size=1, max_size=3),
    st.lists(sines, max_size=2),
    st.sampled_from([0.3, 1e-2, 1e-4, 1e-6, 1e-8, -1e-6, -1e-3]),
)
@example(
    0.1,
    0.05,
    0.36807506024995007,
    [
        (0.07582513177467641, 0.32059617355116365, 5.961740922846939),  # a step ends in the dip
        *2 * [(0.08547800423141748, 0.5413159867258451, 2.4659724855386735)],
    ],
    [],
    1e-8,
)
def test_first_break_away_of_a_slider_under_given_loads(length, width, mus, pulls, torques, excess):
    """Loads that exceed the capacity by a part `excess` of it at their worst instant, or do not, and never mind for how short a time."""
    if mus * width >= length:
        width = 0.9 * length / mus
    # a pull that many times as large touches the capacity: the ratio is least there, whatever the pull
    touching = min(value for _, _, value in minima(length, width, mus, pulls, torques))
    pulls = [((1 + excess) * touching * amplitude, *rest) for amplitude, *rest in pulls]
    parameters = length, width, mus, pulls, torques
    expected = first_break_away(*parameters)
    run = simulate(loaded_slider(*parameters), t_end=T_END, rtol=1e-9, output_step=T_END)
    slips = [event.time for event in run.events if event.kind == "slip"]
    if expected is None:
        assert not slips
    elif expected == 0.0:
        assert run["guide.mode"][0] != 0
    else:
        # a margin of the size of rounding moves a transversal zero by as much, a grazing one by its root
        assert slips and abs(slips[0] - expected) < 1e-6


@pytest.mark.parametrize(
    "name",
    [
        "slider-bar-case-1",
        "slider-bar-case-3",
        "coulomb-oscillator",
        "elliptic-trammel",
        "mass-on-belt",
        "slider-on-moving-guide",
        "hard/break-away-for-a-millisecond",
        "hard/two-guides-sliding",
    ],
)
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_output_does_not_change_the_motion(name, rtol):
    """End state, events and their two-sided values are the same to the last bit, whatever is output."""
    scene = load_scene(name)
    found = []
    for step in (scene.t_end, 0.37, 0.01):
        run = simulate(scene, rtol=rtol, output_step=step)
        end = {column: values[-1] for column, values in run.columns.items()}
        found.append(
            (
                end,
                [(e.time, e.kind, e.joint, e.before, e.after) for e in run.events],
                run.termination,
            )
        )
    assert found[0][2] == "end" and all(other == found[0] for other in found[1:])


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_no_event_behind_the_end(rtol):
    """Runs that end just before an event, to which steps are aimed, end there without it."""
    scene = load_scene("slider-bar-case-1")
    times = [event.time for event in simulate(scene, t_end=8.0, rtol=rtol, output_step=8.0).events]
    for time in times:
        for before in (1e-8, 1e-6, 3e-5, 1e-4, 5e-4, 2e-3):
            run = simulate(scene, t_end=time - before, rtol=rtol, output_step=8.0)
            assert run.t[-1] == time - before and all(
                event.time <= run.t[-1] for event in run.events
            )
            # the first step, and with it every error, depends on t_end
            assert before < 30 * rtol or len(run.events) == times.index(time)


def largest_friction(length, width, mus, R, T, sense):
    """By linear programs over all corner configurations: the largest friction, along `sense`, of a slider at rest; inf if unbounded.

    Unknowns: n1, n2 by the surface each corner rests on (signs s1, s2), f+ and f- with |f+-| <= mus N+-. Balance: s1 N1 + s2 N2 = R,
    (a/2)(s2 N2 - s1 N1) + (b/2)(f+ - f-) = T.
    """
    best = -math.inf
    for s1 in (1, -1):
        for s2 in (1, -1):
            lower, upper = [(1 + s1) / 2, (1 + s2) / 2], [(1 - s1) / 2, (1 - s2) / 2]
            bounds = [
                [-mus * n for n in surface] + row
                for surface, rows in ((lower, ([1, 0], [-1, 0])), (upper, ([0, 1], [0, -1])))
                for row in rows
            ]
            answer = linprog(
                [0, 0, -sense, -sense],
                A_ub=bounds,
                b_ub=[0] * 4,
                bounds=[(0, None)] * 2 + [(None, None)] * 2,
                A_eq=[[s1, s2, 0, 0], [-length / 2 * s1, length / 2 * s2, width / 2, -width / 2]],
                b_eq=[R, T],
            )
            if answer.status == 3:
                return math.inf
            if answer.status == 0:
                best = max(best, -answer.fun)
    return best


@settings(max_examples=60)
@given(
    between(0.1, 2.0),
    between(0.05, 3.0),
    between(0.05, 0.9),
    st.integers(-20, 20),
    st.integers(-20, 20),
)
def test_static_friction_is_the_largest_that_the_law_allows(length, width, mus, R, T):
    """At full mobilization where mus b <= a, whatever the loads; none is the largest where mus b > a: such a guide can jam."""
    mechanism = Mechanism(loaded_slider(length, width, mus, [], []))
    m = mechanism.arrays
    assert can_jam(m, 0) == (mus * width > length)
    assume(R != 0 or T != 0)
    assume(abs(mus * width / length - 1) >= 1e-6)
    for d in (1, -1):  # a slip along d is held by a friction along -d
        found = largest_friction(length, width, mus, float(R), float(T), -d)
        if mus * width > length:
            assert math.isinf(found)
        else:
            assert found == pytest.approx(
                capacity(m, 0, float(R), float(T), float(d)), rel=1e-7, abs=1e-9
            )


def test_an_audit_sees_what_the_law_forbids():
    """The audit's own formula, on forces that are right and wrong."""
    mechanism = Mechanism(loaded_slider(0.5, 0.2, 0.3, [], []))
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    row = m.friction["row"][0]
    w.force[row], w.force[row + 1], w.force[m.rows] = 10.0, 0.0, 2.9
    assert margin(m, w, np.array([0]), 0)[1] > 0
    w.force[m.rows] = 3.1
    assert margin(m, w, np.array([0]), 0)[1] < 0
    w.force[m.rows], w.slip_speed[0] = -0.24 * 10.0, 0.5
    assert margin(m, w, np.array([1]), 0) == pytest.approx((0.5, 0.0), abs=1e-12)
    assert margin(m, w, np.array([-1]), 0)[0] < 0 and margin(m, w, np.array([-1]), 0)[1] < 0
    w.force[row + 1] = (
        4.0  # a moment that needs opposite corners: the load is larger, and so must friction be
    )
    assert margin(m, w, np.array([1]), 0)[1] < -1.0


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_guide_that_can_jam_is_not_moved_and_not_held(rtol):
    """Wider than long by more than 1/mus: where full mobilization is exceeded both rest and slip obey the law; at every tolerance."""
    scene = load_scene("hard/can-jam")
    run = ReferenceEngine().simulate(scene, rtol=rtol, output_step=0.1)
    assert run.breakdown.kind == "several solutions" and run.breakdown.guide == "guide"
    held = (
        scene.parameters["mus"] ** 2 * 0.6 / 0.2 * scene.parameters["m"] * 9.81
    )  # both surfaces fully mobilized
    assert run.breakdown.time == pytest.approx(np.arcsin(held / scene.parameters["P"]), abs=1e-9)


def toggle_press():
    """A motor turns a crank, whose rod bends a toggle, which moves a ram; its load passes zero with the spring's."""

    def link(mass, length=0.4, **start):
        return {"mass": mass, "inertia": mass * length**2 / 12, **start}

    def pin(bodies, *points):
        return {"type": "revolute", "bodies": bodies, "points": points}

    raw = {
        "t_end": 6.4,
        "gravity": [0, -G],
        "bodies": {
            "crank": link(0.5, 0.1, position=[0.05, 0], angular_velocity=2),
            "rod": link(0.8, position=[0.3, 0]),
            "upper": link(0.7, position=[0.51, 0.2], angle=-1.62),
            "lower": link(0.7, position=[0.51, -0.2], angle=-1.52),
            "ram": {"mass": 2, "inertia": 0.05 / 6, "position": [0.52, -0.5]},
        },
        "joints": {
            "shaft": pin(["crank", "ground"], [-0.05, 0], [0, 0]),
            "crankpin": pin(["rod", "crank"], [-0.2, 0], [0.05, 0]),
            "toggle-upper": pin(["upper", "rod"], [0.2, 0], [0.2, 0]),
            "toggle-lower": pin(["lower", "rod"], [-0.2, 0], [0.2, 0]),
            "top": pin(["upper", "ground"], [-0.2, 0], [0.52, 0.4]),
            "bottom": pin(["ram", "lower"], [0, 0.1], [0.2, 0]),
            "guide": {
                "type": "translational",
                "slider": "ram",
                "direction": [0, 1],
                "point": [0.52, 0],
                "length": 0.2,
                "width": 0.1,
                "mu": 0.15,
                "mus": 0.2,
            },
        },
        "drives": {
            "motor": {
                "type": "angle",
                "bodies": ["crank", "ground"],
                "law": {"type": "linear", "rate": 2},
            }
        },
        "springs": {
            "spring": {
                "type": "linear",
                "bodies": ["ram", "ground"],
                "points": [[0, -0.1], [0.52, -1]],
                "stiffness": 2000,
                "rest_length": 0.5,
            }
        },
    }
    return with_consistent_start(scene_from_dict(raw, "press"), assemble=True)


SCENES_OF_LOOSE_RUNS = {
    "press": toggle_press,
    "elliptic-trammel": lambda: load_scene("elliptic-trammel"),
    "slider-on-moving-guide": lambda: load_scene("slider-on-moving-guide"),
    "pendulum-dry-pin": lambda: load_scene("pendulum-dry-pin"),
}


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 3e-5])
@pytest.mark.parametrize("name", SCENES_OF_LOOSE_RUNS)
def test_at_an_event_its_function_is_zero_at_loose_tolerances(name, rtol):
    """Projection of the state at an event must not move it off the event: no speed where a guide reverses or comes to rest, no force
    at one of the ends of its slider where a corner changes."""
    run = simulate(SCENES_OF_LOOSE_RUNS[name](), rtol=rtol)
    kinds = {event.kind for event in run.events}
    assert kinds & {"reversal", "stick", "corner"}
    for event in run.events:
        guide = event.joint
        if event.kind in ("reversal", "stick"):
            speed = f"{guide}.slip_velocity"
            assert abs(event.before[speed]) <= 1e-6 * np.max(np.abs(run[speed]))
        elif event.kind == "corner":
            force = [f"{guide}.F{corner}" for corner in (1, 2, 3, 4)]
            rear = event.before[force[0]] + event.before[force[3]]
            front = event.before[force[1]] + event.before[force[2]]
            largest = max(np.max(run[column]) for column in force)
            assert min(rear, front) <= 1e-6 * largest


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 3e-5])
@pytest.mark.parametrize(("name", "apart"), [("press", 1e-6), ("elliptic-trammel", 1e-4)])
def test_no_event_is_found_twice_or_missed_at_loose_tolerances(name, apart, rtol):
    """The press moves as its drive does, whatever the tolerance; the trammel moves freely, and has the error of its motion."""
    scene = SCENES_OF_LOOSE_RUNS[name]()
    loose, tight = (simulate(scene, rtol=tolerance) for tolerance in (rtol, 1e-9))
    assert [(event.kind, event.joint) for event in loose.events] == [
        (event.kind, event.joint) for event in tight.events
    ]
    np.testing.assert_allclose(
        [event.time for event in loose.events],
        [event.time for event in tight.events],
        rtol=0,
        atol=apart,
    )


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6])
def test_a_jam_beside_an_event_is_found_at_all_tolerances(rtol):
    """The corner forces of this driven slider grow without bound next to the zero of one of them: there is no way to that zero."""
    _, scene = draw(77, 96)
    run = ReferenceEngine().simulate(scene, rtol=rtol)
    assert run.termination.startswith("the mechanism jams")
    assert run.breakdown.time == pytest.approx(0.10845, abs=1e-4) and not run.events
