"""What is measured in a sweep's window, against the reduced solution and closed forms."""

import numpy as np
import pytest

from stiction.comparisons.measures.settling import NotSettled
from stiction.comparisons.measures.steady_state_measures import (
    MEASURES,
    SAMPLE_STEP,
    Measure,
    SteadyRun,
    measure_of,
    steady_window,
)
from stiction.comparisons.measures.steady_stretch import steady_stretch
from stiction.engines import Refused
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, scene_from_dict, vary

CASE_1 = load_scene("slider-bar-case-1")
ALL = tuple(MEASURES.values())


def measured(name, scene, run):
    return MEASURES[name].value(steady_window(scene, run, [MEASURES[name]]))


@pytest.fixture(scope="module")
def case_1():
    """The period map contracts by a factor of about 2 per period: 30 periods leave 1e-9."""
    return steady_window(CASE_1, SteadyRun(200.0, 249.0, 1e-9), ALL), steady_stretch(CASE_1)


def test_stick_fraction_of_case_1(case_1):
    window, truth = case_1
    assert truth.stick_time == pytest.approx(0.5323, abs=5e-5)
    # what settling leaves, and the run's tolerance, 1e-9 of lengths of 1 m, over accelerations of 0.2 m/s^2 and more
    assert MEASURES["stick-fraction"].value(window) * 8.0 == pytest.approx(
        truth.stick_time, abs=1e-8
    )


def test_events_are_those_of_the_window(case_1):
    window, _ = case_1
    whole = ReferenceEngine().simulate(
        CASE_1, t_end=249.0, rtol=1e-9, stabilization="projection", output_step=249.0
    )
    expected = [(event.time, event.kind) for event in whole.events if 241.0 < event.time]
    assert [(event.time, event.kind) for event in window.run.events] == expected


def test_peaks_of_case_1(case_1):
    window, truth = case_1
    # both are sampled, every 0.01 s and every 0.004 s, and their fastest parts go with twice the load's frequency
    sampling = (np.pi * SAMPLE_STEP) ** 2 / 8
    assert MEASURES["peak-torque"].value(window) == pytest.approx(
        truth.maximum("motor.effort"), rel=2 * sampling
    )
    assert MEASURES["peak-speed"].value(window) == pytest.approx(
        truth.maximum("slider.vx"), rel=2 * sampling
    )


def test_peak_torque_sees_the_side_of_a_jump_that_samples_miss(case_1):
    window, _ = case_1
    sides = [
        abs(side["motor.effort"])
        for event in window.run.events
        for side in (event.before, event.after)
    ]
    assert MEASURES["peak-torque"].value(window) >= max(sides)


@pytest.mark.parametrize("factor", [1.5, 0.5])
def test_block_on_incline_sticks_or_slides_away(factor):
    """mus above tan(slope) holds it for ever; below it goes faster and faster."""
    scene = load_scene("block-on-incline")
    mu = factor * np.tan(abs(scene.bodies["slider"].angle))
    scene, run = vary(scene, {"guide.mu": mu, "guide.mus": mu}), SteadyRun(0.5, 1.0, 1e-6)
    if factor > 1:
        assert measured("stick-fraction", scene, run) == 1.0
    else:
        with pytest.raises(NotSettled, match="neither at rest nor"):
            measured("stick-fraction", scene, run)


@pytest.mark.parametrize(
    "values, t_end, reason",
    [
        ({"motor.rate": 1.0}, 160.0, "no common period, and the mechanism is not at rest"),
        ({}, 42.0, "does not repeat itself to 0.001 of its range within 4 periods of 8 s"),
        ({}, 30.0, "fewer than 3 periods of 8 s"),
    ],
)
def test_no_steady_state(values, t_end, reason):
    """Frequencies without a common period; 4 periods that lessen the distance by 2 or 3 each; too short a time."""
    with pytest.raises(NotSettled, match=reason):
        _ = steady_window(vary(CASE_1, values), SteadyRun(8.0, t_end, 1e-6), ALL).start


def test_a_subharmonic_motion_is_periodic():
    """A pendulum whose pivot is shaken with twice its natural frequency swings once in two periods, past 2 rad.

    That is parametric resonance.
    """
    speed = [0, "0.1*6.2"]
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {
                "hanger": {"mass": 1, "inertia": 1, "velocity": speed},
                "bob": {
                    "mass": 1,
                    "inertia": 0.01,
                    "position": ["sin(0.3)", "-cos(0.3)"],
                    "angle": 0.3,
                    "velocity": speed,
                },
            },
            "joints": {
                "rail": {"type": "translational", "slider": "hanger", "direction": [0, 1]},
                "pin": {
                    "type": "revolute",
                    "bodies": ["bob", "hanger"],
                    "points": [[0, 1], [0, 0]],
                },
            },
            "drives": {
                "shaker": {
                    "type": "distance",
                    "bodies": ["hanger", "ground"],
                    "axis": [0, 1],
                    "law": {"type": "sine", "amplitude": 0.1, "frequency": 6.2},
                }
            },
            "springs": {
                "damper": {"type": "torsional", "bodies": ["bob", "hanger"], "damping": 0.2}
            },
        },
        "shaken",
    )
    window = steady_window(scene, SteadyRun(60.0, 120.0, 1e-6), [MEASURES["peak-speed"]])
    assert window.end - window.start == pytest.approx(2 * window.period)


def test_a_cycle_of_its_own_period():
    """The mass on a belt, which moves on for ever.

    Stick lasts 2 D/(k v0), slip (2/w) (pi - arctan(w D/(k v0))), D = (mus - mu) m g, w = sqrt(k/m).
    """
    scene = load_scene("mass-on-belt")
    p = scene.parameters
    D, w = (p["mus"] - p["mu"]) * p["m"] * p["g"], np.sqrt(p["k"] / p["m"])
    stick, slip = (
        2 * D / (p["k"] * p["v0"]),
        2 / w * (np.pi - np.arctan(w * D / (p["k"] * p["v0"]))),
    )
    window = steady_window(scene, SteadyRun(10.0, 40.0, 1e-9), [MEASURES["stick-fraction"]])
    assert window.end - window.start == pytest.approx(stick + slip, rel=1e-6)
    assert MEASURES["stick-fraction"].value(window) == pytest.approx(
        stick / (stick + slip), rel=1e-6
    )


def pulled(v=0.05, k=50.0, m=1.0, mu=0.4, mus=0.6, slope=0.0, **elements):
    """A block that a hand of constant speed pulls by a spring, up a slope."""
    way = ["cos(slope)", "sin(slope)"]
    guide = {"type": "translational", "direction": way, "angle": "slope"}
    return scene_from_dict(
        {
            "gravity": [0, -9.81],
            "parameters": {"v": v, "k": k, "slope": slope},
            "bodies": {
                "block": {"mass": m, "inertia": 1, "angle": "slope"},
                "hand": {
                    "mass": 1,
                    "inertia": 1,
                    "angle": "slope",
                    "velocity": ["v*cos(slope)", "v*sin(slope)"],
                },
            },
            "joints": {
                "floor": guide | {"slider": "block", "mu": mu, "mus": mus},
                "track": guide | {"slider": "hand"},
            },
            "drives": {
                "pull": {
                    "type": "distance",
                    "bodies": ["hand", "ground"],
                    "axis": way,
                    "law": {"type": "linear", "rate": "v"},
                }
            },
            "springs": {
                "spring": {
                    "type": "linear",
                    "bodies": ["block", "hand"],
                    "axis": [1, 0],
                    "stiffness": "k",
                }
            },
        }
        | elements,
        "pulled",
    )


@pytest.mark.parametrize(
    ("values", "fraction", "speed"),
    [
        (dict(v=0.05), 0.760349, 0.331938),
        (dict(v=0.2), 0.387235, 0.542036),
        (dict(v=0.1, slope=0.3), None, None),
        (dict(v=0.1, slope=-2.9, k=20.0, m=0.5, mu=0.1, mus=0.7), None, None),
    ],
)
def test_a_block_and_the_hand_that_pulls_it_move_on_together(values, fraction, speed):
    """All forces repeat, at another place each time: D = (mus - mu) N, N = m g |cos|, w = sqrt(k/m).

    Stick lasts 2 D/(k v), slip (2/w) (pi - arctan(w D/(k v))). Seen from the hand the block swings about the extension
    (mu N + m g sin)/k with the amplitude hypot(D, k v/w)/k, so that it is as fast as v + hypot(v, w D/k). The motor holds
    mu N + (m + 1) g sin +- hypot(D, k v/w). Peaks are sampled: a sine's is missed by (w h)^2/8 of its size.
    """
    v, k, m, mu, mus, slope = (
        values.get(key, usual)
        for key, usual in (
            ("v", 0.05),
            ("k", 50.0),
            ("m", 1.0),
            ("mu", 0.4),
            ("mus", 0.6),
            ("slope", 0.0),
        )
    )
    N, w = m * 9.81 * abs(np.cos(slope)), np.sqrt(k / m)
    D, mean = (mus - mu) * N, mu * N + (m + 1.0) * 9.81 * np.sin(slope)
    stick, slip = 2 * D / (k * v), 2 / w * (np.pi - np.arctan(w * D / (k * v)))
    chosen = [
        measure_of(text)
        for text in (
            "stick-fraction",
            "peak-speed",
            "peak-torque",
            "peak-speed:block",
            "peak-speed:hand",
            "peak-speed:track",
            "event-count",
        )
    ]
    window = steady_window(pulled(**values), SteadyRun(40.0, 100.0), chosen)
    found = {measure.column: measure.value(window) for measure in chosen}
    sampling = (w * SAMPLE_STEP) ** 2 / 8
    assert window.end - window.start == pytest.approx(stick + slip, rel=1e-5)
    assert found["stick-fraction"] == pytest.approx(stick / (stick + slip), abs=1e-5)
    assert found["peak-speed"] == pytest.approx(v + np.hypot(v, w * D / k), rel=2 * sampling)
    assert found["peak-speed:block"] == pytest.approx(found["peak-speed"], rel=1e-9)
    assert found["peak-speed:hand"] == pytest.approx(v) == found["peak-speed:track"]
    assert found["peak-torque"] == pytest.approx(
        abs(mean) + np.hypot(D, k * v / w), rel=2 * sampling
    )
    assert found["event-count"] == 2
    if fraction is not None:
        assert found["stick-fraction"] == pytest.approx(fraction, abs=1e-6)
        assert v + np.hypot(v, w * D / k) == pytest.approx(speed, abs=5e-7)


@pytest.mark.parametrize(
    "spring",
    [
        {"bodies": ["block", "ground"], "axis": [1, 0], "stiffness": 0.05},
        {"bodies": ["hand", "ground"], "axis": [1, 0], "stiffness": 0.05},
        {
            "bodies": ["block", "ground"],
            "points": [[0, 0], [0, 1]],
            "stiffness": 0.05,
            "rest_length": 1,
        },
    ],
)
def test_a_motion_whose_forces_grow_is_not_steady(spring):
    """A weak spring to the ground, next to the one of 50 N/m; also where the drive alone feels it."""
    scene = pulled(
        springs={
            "spring": {
                "type": "linear",
                "bodies": ["block", "hand"],
                "axis": [1, 0],
                "stiffness": 50,
            },
            "weak": {"type": "linear"} | spring,
        }
    )
    with pytest.raises(NotSettled):
        measured("peak-torque", scene, SteadyRun(40.0, 100.0))


def test_a_block_that_is_shaken_while_it_is_pulled():
    """Without dry friction: x'' + (c (x' - v) + k (x - v t))/m = F sin(W t)/m.

    It moves on with v and swings by F/|k - m W^2 + i c W|.
    """
    v, k, c, F, W = 0.3, 50.0, 4.0, 2.0, 5.0
    scene = pulled(
        v=v,
        mu=0.0,
        mus=0.0,
        forces={
            "shake": {
                "type": "force",
                "body": "block",
                "direction": [1, 0],
                "law": {"type": "sine", "amplitude": F, "frequency": W},
            }
        },
        springs={
            "spring": {
                "type": "linear",
                "bodies": ["block", "hand"],
                "axis": [1, 0],
                "stiffness": k,
                "damping": c,
            }
        },
    )
    window = steady_window(scene, SteadyRun(20.0, 60.0), [measure_of("peak-speed")])
    assert window.end - window.start == pytest.approx(2 * np.pi / W)
    expected = v + W * F / abs(k - W**2 + 1j * c * W)
    assert MEASURES["peak-speed"].value(window) == pytest.approx(
        expected, rel=2 * (W * SAMPLE_STEP) ** 2 / 8
    )


def test_peaks_are_those_of_the_element_that_is_named():
    """On the belt: its own constant speed is that of the first guide; the block's, and that of the block on the belt."""
    scene = load_scene("mass-on-belt")
    p = scene.parameters
    D, w, v = (p["mus"] - p["mu"]) * p["m"] * p["g"], np.sqrt(p["k"] / p["m"]), p["v0"]
    chosen = [
        measure_of(f"peak-speed{name}") for name in ("", ":track", ":slider", ":guide", ":belt")
    ]
    window = steady_window(scene, SteadyRun(10.0, 40.0, 1e-9), chosen)
    back = np.hypot(v, w * D / p["k"])  # against the belt's way
    for measure, expected, subject in zip(
        chosen,
        (v, v, back, back + v, v),
        ("belt along track", "belt along track", "slider", "slider along guide", "belt"),
    ):
        assert measure.value(window) == pytest.approx(expected, rel=2 * (w * SAMPLE_STEP) ** 2 / 8)
        assert measure.subject(scene) == subject


def test_a_block_at_terminal_speed_is_steady_and_a_stretching_spring_is_not():
    """On a slope against viscous friction alone, g sin / (c/m); held by a spring that a drive lengthens for ever."""
    slope, run = ["cos(0.3)", "sin(0.3)"], SteadyRun(20.0, 30.0, 1e-6)
    oil = {"type": "linear", "bodies": ["block", "ground"], "axis": slope, "damping": 2}
    tables = {
        "gravity": [0, -9.81],
        "bodies": {"block": {"mass": 1, "inertia": 1, "angle": 0.3}},
        "joints": {
            "track": {"type": "translational", "slider": "block", "direction": slope, "angle": 0.3}
        },
        "springs": {"oil": oil},
    }
    speed = measured("peak-speed", scene_from_dict(tables, "oil"), run)
    assert speed == pytest.approx(9.81 * np.sin(0.3) / 2, rel=1e-4)
    tables["drives"] = {
        "hand": {
            "type": "distance",
            "bodies": ["block", "ground"],
            "axis": slope,
            "law": {"type": "linear", "rate": 0.1},
        }
    }
    tables["bodies"]["block"]["velocity"] = ["0.1*cos(0.3)", "0.1*sin(0.3)"]
    assert measured("peak-speed", scene_from_dict(tables, "driven"), run) == pytest.approx(0.1)
    oil["stiffness"] = 1
    with pytest.raises(NotSettled):
        measured("peak-speed", scene_from_dict(tables, "stretched"), run)


def test_start_off_the_constraints_is_assembled():
    """The bar's velocity in the file is that of w0: with another rate the start violates the drive."""
    turns = Measure(
        "turns", "rad/s", lambda window, column: window.run.columns[column][-1], "bodies", "omega"
    )
    scene = vary(CASE_1, {"motor.rate": 1.0})
    assert turns.source(scene) == "bar.omega"
    window = steady_window(vary(scene, {"Omega": 2.0}), SteadyRun(60.0, 200.0, 1e-6), [turns])
    assert turns.value(window) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("engine", "dt", "is_located"),
    [("reference", 5e-3, True), ("exudyn", 1e-2, True), ("pymunk", 2e-3, False)],
)
def test_other_methods_have_the_steady_state_of_the_reference(engine, dt, is_located):
    """The paper's scheme, an engine with located events and one of impulses.

    Each end of a stick phase is known to a sample, which is two steps.
    """
    fraction, *peaks = chosen = [
        MEASURES[name] for name in ("stick-fraction", "peak-torque", "peak-speed")
    ]
    found = steady_window(CASE_1, SteadyRun(8.0, 96.0, 1e-5, engine, dt=dt), chosen)
    expected = steady_window(CASE_1, SteadyRun(40.0, 160.0), chosen)
    assert (found.start, found.end, found.located) == (pytest.approx(88.0), 96.0, is_located)
    assert fraction.value(found) == pytest.approx(fraction.value(expected), abs=2 * 2 * dt / 8.0)
    for peak in peaks:
        assert peak.value(found) == pytest.approx(peak.value(expected), rel=2e-3)


def test_samples_of_a_motion_that_only_reverses_show_no_stick():
    """Above the threshold, 4.21 N: at a reversal the slider is slower than 0.1 mm/s for a millisecond or less."""
    fraction = MEASURES["stick-fraction"]
    window = steady_window(
        vary(CASE_1, {"F0": 5.0}), SteadyRun(8.0, 72.0, 1e-4, "pymunk", dt=2e-3), [fraction]
    )
    assert np.min(np.abs(window.run.columns["guide.slip_velocity"])) < 1e-3
    assert fraction.value(window) == 0.0


def test_event_count_of_an_engine_is_of_those_that_it_locates():
    """Exudyn locates changes between stick and slip and of direction, not of surface; pymunk locates none."""
    events = steady_window(CASE_1, SteadyRun(40.0, 160.0), ALL).run.events
    expected = [event for event in events if event.kind != "corner"]
    assert measured("event-count", CASE_1, SteadyRun(8.0, 72.0, 1e-4, "exudyn", dt=1e-2)) == len(
        expected
    )
    with pytest.raises(Refused, match="does not locate events"):
        measured("event-count", CASE_1, SteadyRun(8.0, 96.0, 1e-5, "pymunk", dt=2e-3))


def test_samples_and_steps_divide_a_period_of_any_length():
    """Of 2 pi/1.3 s, which no step of whole milliseconds divides; the run ends with the last whole period."""
    period = 2 * np.pi / 1.3
    scene = vary(CASE_1, {"Omega": 1.3, "motor.rate": 1.3})
    window = steady_window(scene, SteadyRun(5.0, 60.0, 1e-4, "pymunk", dt=1e-3), ALL)
    assert window.period == pytest.approx(period) and window.end == pytest.approx(12 * period)
    assert window.end - window.start == pytest.approx(period)
    step = window.whole.settings["dt"]
    assert step <= 1e-3 and period / step == pytest.approx(round(period / step))
