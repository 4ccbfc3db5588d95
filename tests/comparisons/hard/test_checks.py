"""Measures of hard cases: relative errors in all edge cases, and runs that do not move or move too far."""

from dataclasses import replace

import numpy as np
import pytest

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.hard import checks, hard_cases
from stiction.comparisons.hard.case import MOTION
from stiction.comparisons.hard.checks import (
    measures,
    range_scale,
    relative_error,
    time_at_rest,
)
from stiction.scenes import Event, Scene, Trajectory, load_scene, vary
from stiction.scenes.columns import columns_of
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import steady_state

SAMPLES = 201
CASES = {case.name: case for case in hard_cases()}
QUICK_MOTIONS = [
    case
    for case in hard_cases(Depth.QUICK)
    if case.expected == MOTION and case.scene and not case.text
]


def at_start(scene: Scene, t_end: float) -> Trajectory:
    """A run in which no body ever moves, and all forces are zero."""
    t = np.linspace(0.0, t_end, SAMPLES)
    columns = {name: np.zeros(SAMPLES) for name in columns_of(scene)}
    for name, body in scene.bodies.items():
        declared = (*body.position, body.angle)
        for label, value in zip(("x", "y", "angle"), declared, strict=True):
            columns[f"{name}.{label}"] = np.full(SAMPLES, value)
    return Trajectory(scene.name, "stuck", "1", "joint", t, columns, settings={"dt": t[1]})


@pytest.mark.parametrize(
    ("values", "expected", "scale", "error"),
    [
        ([1.0, 3.0], [1.0, 2.0], None, 0.5),
        ([1.0, 3.0], [1.0, 2.0], 4.0, 0.25),
        ([1.0, 3.0], [1.0, 2.0], -4.0, 0.25),
        ([0.0, 0.0], [0.0, 0.0], None, 0.0),
        ([0.0, 0.0], [0.0, 0.0], 0.0, 0.0),
        ([0.0, 1e-300], [0.0, 0.0], None, np.inf),
        (1.0, 0.0, 0.0, np.inf),
        ([], [], None, np.inf),
        ([], [], 1.0, np.inf),
        ([], 1.0, None, np.inf),
        ([1.0], [np.nan], 1.0, np.inf),
        ([np.inf], [1.0], None, np.inf),
        ([1.0], [2.0], np.inf, np.inf),
        ([1.0], [2.0], np.nan, np.inf),
    ],
)
def test_relative_errors(values, expected, scale, error):
    assert relative_error(np.array(values), np.array(expected), scale) == error


def test_the_scale_of_a_column():
    assert range_scale(np.array([1.0, 4.0, 2.0])) == 3.0
    assert range_scale(np.array([-2.0, -2.0])) == 2.0
    assert range_scale(np.zeros(3)) == range_scale(np.zeros(0)) == 0.0


@pytest.mark.parametrize("case", QUICK_MOTIONS, ids=lambda case: case.name)
def test_a_stuck_engine_gets_errors(case):
    """Every measure has a number; the motion is wrong unless the case is about rest."""
    scenes = case.scenes()
    errors = measures(case, scenes, [at_start(scene, scene.t_end) for scene in scenes])
    assert errors and not np.isnan(list(errors.values())).any() and min(errors.values()) >= 0
    assert max(errors.values()) > 0.1 or case.rests


def test_a_stuck_mechanism_that_should_come_to_rest_elsewhere():
    case = CASES["trammel comes to rest"]
    [scene] = case.scenes()
    errors = measures(case, [scene], [at_start(scene, scene.t_end)])
    assert errors["slip at rest"] == 0.0 and errors["place of rest"] > 0.1


def test_friction_that_is_never_measured_is_not_right():
    """All instants before the break-away are within the first steps, in which contacts build up forces."""
    case = CASES["wedged slider"]
    [scene] = case.scenes()
    run = at_start(scene, scene.t_end)
    coarse = Trajectory(
        run.scene, "e", "1", "contact", run.t, run.columns, settings={"dt": scene.t_end}
    )
    errors = checks.friction_balances_the_pull(case, [scene], [coarse])
    assert errors == {"friction before it breaks away": np.inf}


@pytest.mark.parametrize("amplification", [1.5, 3.0, 10.0])
def test_a_motion_that_swings_too_far_has_the_error_of_its_excess(amplification):
    """A steady motion, enlarged by a factor: at t = 0 it is off by (factor - 1) x, whatever its own range is."""
    case = CASES["200 s of case 1"]
    scene = load_scene("hard/long-time")
    bar = SliderBar.from_scene(scene)
    steady = steady_state(bar)
    period = bar.period()
    t = np.linspace(0.0, 2 * period, 4001)
    sampled = t % period
    x, v = steady.motion.state(sampled, steady.motion.owner(sampled, "after"))
    run = at_start(scene, t[-1])
    columns = {name: np.zeros(len(t)) for name in run.columns}
    columns |= {"slider.x": amplification * x[0], "slider.vx": amplification * v[0]}
    enlarged = Trajectory(scene.name, "e", "1", "joint", t, columns)
    errors = checks.periodic(case, [scene], [enlarged])
    expected = (amplification - 1) * abs(x[0][0]) / np.ptp(x[0])
    assert errors["position after the last period"] == pytest.approx(expected, rel=1e-4)
    expected = (amplification - 1) * abs(v[0][0]) / np.ptp(x[0]) * period / (2 * np.pi)
    assert errors["velocity after the last period"] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("events", "rest"),
    [
        ([], 0.0),
        ([(1.0, "stick", "a"), (3.0, "slip", "a")], 2.0),
        ([(1.0, "stick", "a")], 9.0),
        ([(4.0, "slip", "a")], 4.0),
        ([(4.0, "slip", "a"), (6.0, "reversal", "a"), (7.0, "stick", "a")], 7.0),
        ([(2.0, "reversal", "a"), (3.0, "stick", "a"), (3.5, "corner", "a")], 7.0),
        ([(1.0, "stick", "a"), (2.0, "stick", "b"), (4.0, "slip", "a"), (7.0, "slip", "b")], 8.0),
        ([(1.0, "stick", "a"), (11.0, "slip", "a"), (12.0, "stick", "b")], 9.0),
    ],
)
def test_time_at_rest(events, rest):
    located = [Event(time, kind, joint, {}, {}) for time, kind, joint in events]
    assert time_at_rest(located, 10.0) == pytest.approx(rest, rel=1e-14)


def test_time_at_rest_of_random_motions():
    """Each joint alternates between rest and slip at random times: the sum of its intervals at rest."""
    random = np.random.default_rng(0)
    for _ in range(300):
        t_end, events, expected = random.uniform(1.0, 5.0), [], 0.0
        for joint in "abc":
            times = np.sort(random.uniform(0.0, t_end, random.integers(1, 8)))
            rests = bool(random.integers(2))
            previous = 0.0
            for time in times:
                expected += rests * (time - previous)
                rests = not rests
                events.append(Event(time, "stick" if rests else "slip", joint, {}, {}))
                previous = time
            expected += rests * (t_end - previous)
        events.sort(key=lambda event: event.time)
        assert time_at_rest(events, t_end) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("m", "g"), [(1.0, 9.81), (2.5, 9.81), (1.0, 1.62), (0.3, 20.0)])
def test_parallel_guides_carry_the_weight_of_the_scene(m, g):
    scene = vary(load_scene("hard/two-guides-sliding"), {"m": m, "g": g})
    run = at_start(scene, scene.t_end)
    half = m * g * np.cos(np.deg2rad(25)) / 2
    forces = {f"guide-{i}.normal_force": np.full(SAMPLES, half) for i in (1, 2)}
    loaded = replace(run, engine="reference", columns={**run.columns, **forces})
    errors = checks.normal_force_of_two_guides(CASES["two guides on one line"], [scene], [loaded])
    assert set(errors) == {"sum of normal_force", "minimum-norm normal forces"}
    assert max(errors.values()) < 1e-15


def test_a_shorter_run_in_other_units_is_not_the_same_motion():
    case = CASES["bar of 1 km"]
    scenes = case.scenes()
    first, second = (at_start(scene, scene.t_end) for scene in scenes)
    assert checks.same_motion(case, scenes, [first, second])["motion in other units"] < 1e-15
    columns = {name: values[:-1] for name, values in second.columns.items()}
    shorter = replace(second, t=second.t[:-1], columns=columns)
    errors = checks.same_motion(case, scenes, [first, shorter])
    assert errors["motion in other units"] == np.inf
