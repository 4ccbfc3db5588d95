"""No event is missed where forces turn fast and the motion does not tell: a step is bounded by what its forces do, not by its error alone.

A balanced rotor that a motor turns evenly, a slider that a motor moves evenly past another, a rotor that a torque of a polynomial of time
turns: each moves as a polynomial of time of low degree, which no error control of the motion shortens a step for.
"""

import numpy as np
import pytest
from fuzz.seeds import seed_or_fresh
from scipy.optimize import brentq
from turning_scenes import KINDS, draw, judged

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.integration.dop853 import C
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.integration.event_location import are_resolved
from stiction.reference_impl.integration.integration_state import state
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

TOLERANCES = [1e-6, 1e-9, 1e-12]
OUTPUT_STEPS = [0.001, 0.01, 0.1, 1.0, 2.0]


def run_of(tables, rtol=1e-9, output_step=1.0):
    run = ReferenceEngine().simulate(
        scene_from_dict(tables, "turning"), rtol=rtol, output_step=output_step
    )
    assert run.termination == "end", run.termination
    return run


def break_away(run):
    return next(event.time for event in run.events if event.kind == "slip")


def first_zero(function, t_end, points):
    """The first time at which a function of given arrays of times falls below zero."""
    t = np.linspace(0, t_end, points)
    i = int(np.flatnonzero(function(t) < 0)[0])
    return brentq(lambda x: float(function(np.array([x]))[0]), t[i - 1], t[i], xtol=1e-15)


def rotor(name, on, place, rate, **more):
    """A balanced rotor, its pin and its motor."""
    body = {"mass": 1.0, "inertia": 0.01, "position": list(place), "angular_velocity": rate, **more}
    pin = {"type": "revolute", "bodies": [name, on], "points": [[0, 0], list(place)]}
    return (
        body,
        pin,
        {"type": "angle", "bodies": [name, on], "law": {"type": "linear", "rate": rate}},
    )


def pulled_by_a_turning_axis(rate):
    """A slider of 2 kg at rest on a level guide. A spring pulls it along an axis of a rotor 0.3 m beside it; a load along the guide grows."""
    body, pin, motor = rotor("r", "ground", (-0.3, 0), rate)
    return {
        "t_end": 10.0,
        "gravity": [0, -9.81],
        "bodies": {"s": {"mass": 2.0, "inertia": 0.1}, "r": body},
        "joints": {"guide": {"type": "translational", "slider": "s", "mu": 0.3}, "pin": pin},
        "drives": {"motor": motor},
        "springs": {
            "k": {"type": "linear", "bodies": ["s", "r"], "axis": [1, 0], "stiffness": 8.0}
        },
        "forces": {
            "F": {
                "type": "force",
                "body": "s",
                "direction": [1, 0],
                "law": {"type": "linear", "rate": 10 / 9},
            }
        },
    }


@pytest.mark.parametrize("output_step", OUTPUT_STEPS)
@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize(
    ("rate", "expected"),
    [(30.0, None), (100.0, 5.262864476776), (100 * np.pi, 5.255307175), (200 * np.pi, 5.252675555)],
)
def test_a_spring_along_an_axis_that_turns(rate, expected, rtol, output_step):
    """The spring is 0.3 cos(rate t) long, and pulls with 8 N/m times that along (cos, sin): |X| = 0.3 |Y| at the break-away."""

    def left(t):
        c, s = np.cos(rate * t), np.sin(rate * t)
        return 0.3 * np.abs(2 * 9.81 + 2.4 * c * s) - np.abs(10 / 9 * t - 2.4 * c * c)

    truth = first_zero(left, 10.0, 1_000_000)
    if expected is not None:
        assert truth == pytest.approx(expected, abs=1e-9)
    assert break_away(run_of(pulled_by_a_turning_axis(rate), rtol, output_step)) == pytest.approx(
        truth, abs=1e-12
    )


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("rate", [100.0, 1234.5])
def test_a_load_on_the_rim_of_a_rotor(rate, rtol):
    """A load P down on the rim of a rotor that a motor on the slider turns: its moment P r cos tilts the slider, of length a, in its guide.

    R = 3 g + P and T = P r cos(rate t), so that the guide holds mu max(R, (2/a) |T|). The rotor stands on the slider's centre.
    """
    P, r, a, mu = 200.0, 0.2, 0.3, 0.2
    body, pin, motor = rotor("r", "s", (0, 0), rate)
    tables = {
        "t_end": 10.0,
        "gravity": [0, -9.81],
        "bodies": {"s": {"mass": 2.0, "inertia": 0.1}, "r": body},
        "joints": {
            "guide": {"type": "translational", "slider": "s", "mu": mu, "length": a},
            "pin": pin,
        },
        "drives": {"motor": motor},
        "forces": {
            "P": {
                "type": "force",
                "body": "r",
                "point": [r, 0],
                "direction": [0, -1],
                "law": {"type": "constant", "value": P},
            },
            "F": {
                "type": "force",
                "body": "s",
                "direction": [1, 0],
                "law": {"type": "linear", "rate": 6.6},
            },
        },
    }
    truth = first_zero(
        lambda t: mu * np.maximum(3 * 9.81 + P, 2 / a * P * r * np.abs(np.cos(rate * t))) - 6.6 * t,
        10.0,
        2_000_000,
    )
    assert break_away(run_of(tables, rtol)) == pytest.approx(truth, abs=1e-11)


@pytest.mark.parametrize("rtol", TOLERANCES)
def test_corners_of_a_slider_that_a_motor_moves(rtol):
    """Each change of surface of a driven slider, under the turning moment of a load P on a rim: a (R/2 -+ T/a) is zero.

    R = N + P down at the guide, T = P r cos(rate t) about the slider's centre, without a width: 2 P r / a > R makes each corner lift twice a
    turn, where cos(rate t) = -+ a R / (2 P r).
    """
    rate, N, P, r, a, t_end = 87.0, 20.0, 15.0, 0.4, 0.3, 6.0
    body, pin, motor = rotor("r", "s", (0, 0), rate, velocity=[0.5, 0])
    tables = {
        "t_end": t_end,
        "bodies": {"s": {"mass": 2.0, "inertia": 0.1, "velocity": [0.5, 0]}, "r": body},
        "joints": {
            "guide": {"type": "translational", "slider": "s", "mu": 0.2, "length": a},
            "pin": pin,
        },
        "drives": {
            "motor": motor,
            "along": {
                "type": "distance",
                "bodies": ["s", "ground"],
                "axis": [1, 0],
                "law": {"type": "linear", "rate": 0.5},
            },
        },
        "forces": {
            "P": {
                "type": "force",
                "body": "r",
                "point": [r, 0],
                "direction": [0, -1],
                "law": {"type": "constant", "value": P},
            },
            "N": {
                "type": "force",
                "body": "s",
                "direction": [0, -1],
                "law": {"type": "constant", "value": N},
            },
        },
    }
    angle = np.arccos(a * (N + P) / (2 * P * r))
    turn = 2 * np.pi * np.arange(rate * t_end / (2 * np.pi) + 1)[:, None]
    expected = np.sort(
        (turn + [angle, np.pi - angle, np.pi + angle, 2 * np.pi - angle]).ravel() / rate
    )
    expected = expected[expected < t_end]
    run = run_of(tables, rtol)
    assert {event.kind for event in run.events} == {"corner"} and len(run.events) == len(expected)
    assert [event.time for event in run.events] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("begin", [-1.0, -2.7, -11.0])
@pytest.mark.parametrize("beside", [0.1, 1e-3, 1e-5])
def test_a_damper_to_a_slider_that_a_motor_moves_past(beside, begin, rtol):
    """A damper is balanced by a load but for the instant in which it stands across the guide.

    Another slider moves with speed v on a line `beside` the first, s of this distance behind it. The damper's rate is v s / sqrt(1 + s^2);
    it pulls with c v s^2 / (1 + s^2) along and as much over s across. What the load c v leaves, c v / (1 + s^2), breaks the slider away from
    the weight N = m g - c v s / (1 + s^2) that it has on its guide:  c v = mu (m g (1 + s^2) - c v s).
    """
    v, c, mass, mu = 1.0, 30.0, 2.0, 0.5
    tables = {
        "t_end": 2 - 2 * begin,
        "gravity": [0, -9.81],
        "bodies": {
            "s": {"mass": mass, "inertia": 0.1},
            "other": {
                "mass": 1.0,
                "inertia": 0.1,
                "position": [begin, -beside],
                "velocity": [v, 0],
            },
        },
        "joints": {
            "guide": {"type": "translational", "slider": "s", "mu": mu},
            "line": {"type": "translational", "slider": "other", "point": [0, -beside]},
        },
        "drives": {
            "motor": {
                "type": "distance",
                "bodies": ["other", "ground"],
                "axis": [1, 0],
                "law": {"type": "linear", "offset": begin, "rate": v},
            }
        },
        "springs": {
            "damper": {
                "type": "linear",
                "bodies": ["s", "other"],
                "points": [[0, 0], [0, 0]],
                "stiffness": 0.0,
                "damping": c,
            }
        },
        "forces": {
            "F": {
                "type": "force",
                "body": "s",
                "direction": [-1, 0],
                "law": {"type": "constant", "value": c * v},
            }
        },
    }
    polynomial = np.array([mu * mass * 9.81, -mu * c * v, mu * mass * 9.81 - c * v])
    s = max(np.roots(polynomial).real)
    run = run_of(tables, rtol, 0.5)
    assert break_away(run) == pytest.approx((-begin - s * beside) / v, abs=1e-11 + 1e-6 * beside)


def test_steps_of_a_rotor_that_turns_faster_and_faster():
    """A torque that grows with time turns a rotor on the slider by j t^3 / 6, a polynomial that DOP853 integrates exactly, from rest.

    The rotor is off its pin by less than what changes a force visibly: nothing but how far it turns makes steps shorter.
    """
    j, t_end, inertia, e = 900.0, 3.0, 0.01, 1e-18
    tables = {
        "t_end": t_end,
        "bodies": {
            "s": {"mass": 2.0, "inertia": 0.1},
            "r": {"mass": 1.0, "inertia": inertia, "position": [e, 0]},
        },
        "joints": {
            "guide": {"type": "translational", "slider": "s", "mu": 0.3, "length": 0.3},
            "pin": {"type": "revolute", "bodies": ["r", "s"], "points": [[-e, 0], [0, 0]]},
        },
        "forces": {
            "N": {
                "type": "force",
                "body": "s",
                "direction": [0, -1],
                "law": {"type": "constant", "value": 10.0},
            },
            "M": {"type": "torque", "body": "r", "law": {"type": "linear", "rate": j * inertia}},
        },
    }
    mechanism, ends = Mechanism(scene_from_dict(tables, "spun up")), []
    run = simulate_event_driven(
        mechanism, *mechanism.initial_state(), np.array([0.0, t_end]), t_end, 1e-6, ends=ends
    )
    assert run.breakdown is None and run.columns["r.omega"][-1] == pytest.approx(
        0.5 * j * t_end**2, rel=1e-6
    )
    steps = np.array([0.0, *ends])
    assert 2 * np.max(np.diff(j * steps**3 / 6)) < 1.5 * np.pi  # a force turns twice as fast
    assert len(ends) < 2 * 2 * j * t_end**3 / 6 / np.pi + 100


def arrays(joint, drives=None, springs=None, forces=None):
    slider = {"type": "translational", "slider": "s", "mu": 0.3}
    bodies = {"s": {"mass": 1.0, "inertia": 1.0}, "r": {"mass": 1.0, "inertia": 1.0}}
    return Mechanism(
        scene_from_dict(
            {
                "t_end": 1.0,
                "bodies": bodies,
                "joints": {"guide": slider, **joint},
                "drives": drives or {},
                "springs": springs or {},
                "forces": forces or {},
            },
            "what turns",
        )
    ).arrays


CENTRED = {"pin": {"type": "revolute", "bodies": ["r", "s"]}}


def spring(**more):
    return {"k": {"type": "linear", "bodies": ["s", "r"], "stiffness": 1.0, **more}}


@pytest.mark.parametrize(
    ("turning", "lines", "parts"),
    [
        ([], 0, {"joint": CENTRED}),
        (
            [0],
            0,
            {
                "joint": {
                    "pin": {"type": "revolute", "bodies": ["r", "s"], "points": [[0, 0], [0.1, 0]]}
                }
            },
        ),
        (
            [1],
            0,
            {
                "joint": {
                    "pin": {"type": "revolute", "bodies": ["r", "s"], "points": [[-0.1, 0], [0, 0]]}
                }
            },
        ),
        ([1], 0, {"joint": {"rider": {"type": "translational", "slider": "s", "guide": "r"}}}),
        (
            [],
            0,
            {
                "joint": CENTRED,
                "drives": {
                    "motor": {
                        "type": "angle",
                        "bodies": ["r", "s"],
                        "law": {"type": "constant", "value": 0},
                    }
                },
            },
        ),
        ([1], 0, {"joint": CENTRED, "springs": spring(axis=[1, 0])}),
        ([], 0, {"joint": CENTRED, "springs": spring(points=[[0, 0], [0, 0]])}),
        ([1], 0, {"joint": CENTRED, "springs": spring(points=[[0, 0], [0, 0.1]])}),
        ([1], 1, {"joint": CENTRED, "springs": spring(points=[[0, 0], [0, 0.1]], rest_length=0.1)}),
        ([], 1, {"joint": CENTRED, "springs": spring(points=[[0, 0], [0, 0]], damping=0.1)}),
        (
            [],
            0,
            {
                "joint": CENTRED,
                "springs": {"k": {"type": "torsional", "bodies": ["s", "r"], "stiffness": 1.0}},
            },
        ),
        (
            [1],
            0,
            {
                "joint": CENTRED,
                "forces": {
                    "F": {
                        "type": "force",
                        "body": "r",
                        "point": [0.1, 0],
                        "direction": [1, 0],
                        "law": {"type": "constant", "value": 1},
                    }
                },
            },
        ),
        (
            [],
            0,
            {
                "joint": CENTRED,
                "forces": {
                    "F": {
                        "type": "force",
                        "body": "r",
                        "direction": [1, 0],
                        "law": {"type": "constant", "value": 1},
                    }
                },
            },
        ),
    ],
)
def test_what_turns(turning, lines, parts):
    """Bodies whose angle enters a force, and pairs of points along whose line one acts; slider 0 is `s`, rotor 1 is `r`."""
    m = arrays(**parts)
    assert m.turning.tolist() == turning and len(m.line) == lines


def test_what_turns_without_friction_costs_nothing():
    tables = pulled_by_a_turning_axis(1000.0)
    del tables["joints"]["guide"]["mu"]
    mechanism = Mechanism(scene_from_dict(tables, "without friction"))
    assert not len(mechanism.arrays.turning) and not len(mechanism.arrays.line)


@pytest.mark.parametrize(
    ("phase", "expected"),
    [(np.pi, True), (2 * np.pi, True), (4 * np.pi, False), (5 * np.pi, False), (13 * np.pi, False)],
)
@pytest.mark.parametrize("at_start", np.linspace(0, 6, 5))
def test_stages_that_do_not_see_how_an_event_function_changes(phase, at_start, expected):
    """A sinusoid by its values at the stages: seen up to one period in a step, not from two on; rounding is not looked at."""
    s = state(np.zeros(3), np.zeros(3), 1)
    s.progress["force"] = 20.0
    values = 10 + np.sin(at_start + phase * np.sort(C))
    s.at_start[1], s.at_stages[:, 1] = values[0], values[1:]
    assert are_resolved(s) == expected
    s.progress["force"] = 1e12
    assert are_resolved(s)


def count_wrong(seed, draws):
    """Random scenes of a seed: none may be wrong without saying so."""
    rng, words = np.random.default_rng(seed), {"right": 0, "typed": 0, "wrong": 0}
    while sum(words.values()) < draws:
        kind = KINDS[sum(words.values()) % len(KINDS)]
        drawn = draw(rng, kind)
        verdict = judged(drawn, rng) if drawn is not None else None
        if verdict is not None:
            words[verdict.word] += 1
            assert verdict.word != "wrong", (
                seed,
                sum(words.values()),
                drawn.kinds,
                drawn.rtol,
                verdict,
            )
    return words


def test_random_sliders_that_turning_forces_pull():
    words = count_wrong(20, 64)
    assert words["typed"] == 0


@pytest.mark.long
def test_many_random_sliders_that_turning_forces_pull():
    seed = seed_or_fresh(None)
    print(f"seed {seed}: {count_wrong(seed, 2000)}")
