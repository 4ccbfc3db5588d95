"""pymunk alone: distance drives, guides that hold angles, loops."""

from importlib.metadata import version

import numpy as np
import pytest

from stiction.comparisons.truth import four_bar_truth, pendulum_truth
from stiction.engines import load_engine
from stiction.engines.pymunk.engine import non_turning
from stiction.scenes import load_scene, scene_from_dict, vary


@pytest.fixture(scope="module")
def engine():
    return load_engine("pymunk")


@pytest.mark.parametrize(("name", "truth", "column", "t_end"), [
    ("pendulum", pendulum_truth, "mass.x", 2.0),
    ("four-bar", four_bar_truth, "upright-0.x", 0.6)])  # before its singular position, where iterations matter
def test_first_order(engine, name, truth, column, t_end):
    scene = load_scene(name)
    solution = truth(scene, t_end)
    errors = [np.abs(run[column] - solution(run.t)[column]).max()
              for run in (engine.simulate(scene, t_end=t_end, dt=dt, output_step=0.02) for dt in (2e-3, 5e-4))]
    assert errors[1] < errors[0] / 4 ** 0.8  # order 1, less the curvature of the coarse run


@pytest.mark.parametrize("axis", [None, [1, 1]])
def test_distance_follows_its_law(engine, axis):
    """A point on a rod of changing length, or on a line that moves along (1, 1)."""
    start = {"position": [0.6, 0.8]} if axis is None else {"position": [1 / np.sqrt(2), 1 / np.sqrt(2)]}
    drive = {"type": "distance", "bodies": ["mass", "ground"],
             "law": {"type": "sine", "offset": 1, "amplitude": 0.2, "frequency": 3}}
    if axis is not None:
        drive["axis"] = axis
    direction = np.array(start["position"])
    start["velocity"] = list(0.6 * direction)  # the rate of the law
    scene = scene_from_dict({"gravity": [0, -9.81], "bodies": {"mass": {"mass": 1, "inertia": 1, **start}},
                             "drives": {"rod": drive}})
    run = engine.simulate(scene, t_end=1.0, dt=1e-3)
    distance = np.hypot(run["mass.x"], run["mass.y"]) if axis is None else (run["mass.x"] + run["mass.y"]) / np.sqrt(2)
    np.testing.assert_allclose(distance, 1 + 0.2 * np.sin(3 * run.t), atol=5e-5)  # h^2 times accelerations of 50 m/s^2


def test_bodies_that_guides_keep_from_turning():
    assert non_turning(load_scene("mass-on-belt")) == {"ground", "belt", "slider"}
    assert non_turning(load_scene("slider-on-moving-guide")) == {"ground"}


def test_motion_off_the_axes_is_the_same(engine):
    """The incline turned by any angle, gravity with it."""
    level = load_scene("block-on-incline")
    turn = 0.7
    c, s = np.cos(turn), np.sin(turn)
    turned = vary(level, {"gravity": [9.81 * s, -9.81 * c], "incline": np.radians(20) - turn})
    one, two = (engine.simulate(scene, t_end=0.5, dt=1e-3) for scene in (level, turned))
    # equal but for the end of the groove, 1e4 m away: rounding of 1e-12 m, and the friction cap that follows it
    np.testing.assert_allclose(one["guide.displacement"], two["guide.displacement"], atol=1e-8)


@pytest.mark.parametrize("law", [{"type": "linear", "rate": 1.0},
                                 {"type": "sine", "amplitude": 1.0, "frequency": 1.0}])
@pytest.mark.parametrize("dt", [1e-2, 1e-3, 1e-4])
def test_a_slider_at_rest_stays(engine, dt, law):
    """The bar's centripetal force is 2 N, friction holds 2.66 N: one and a half times the load in the first step alone moved the slider for good."""
    scene = vary(load_scene("slider-bar-case-1"), {"w0": 1, "F0": 0, "motor.law": law})
    run = engine.simulate(scene, t_end=0.1, dt=dt, output_step=0.01)
    assert np.abs(run["slider.x"] - run["slider.x"][0]).max() < 1e-12  # solver residual over the run
    np.testing.assert_allclose(run["guide.friction"][0], -2.0, rtol=3 * dt)  # that of the second step
    assert run["slider.vx"][0] == 0.0 and run["bar.omega"][0] == 1.0  # the start is the scene's


def test_second_order_while_no_guide_changes_its_mode(engine):
    """Velocities are those of the middle of a step, also the first: a start from those at t = 0 is off by h a t/2."""
    scene = scene_from_dict({"gravity": [0, -9.81], "bodies": {"sled": {"mass": 2, "inertia": 1, "velocity": [3, 0]}},
                             "joints": {"guide": {"type": "translational", "guide": "ground", "slider": "sled", "mu": 0.2}}})
    run = engine.simulate(scene, t_end=1.0, dt=1e-2)
    np.testing.assert_allclose(run["sled.x"], 3 * run.t - 0.2 * 9.81 * run.t ** 2 / 2, atol=1e-9)


def test_a_load_of_a_millisecond_moves_the_slider_when_it_acts(engine):
    run = engine.simulate(load_scene("hard/break-away-for-a-millisecond"), t_end=5.7, dt=1e-3, output_step=1e-3)
    moved = np.abs(run["slider.x"] - run["slider.x"][0]) > 1e-9
    assert 5.6248 <= run.t[moved.argmax()] <= 5.6278  # the truth's break-away, and three steps


def test_the_version_is_that_of_the_installed_package(monkeypatch):
    """That of the wheel 7.0.0 says 2.0.0 of itself."""
    monkeypatch.setattr("pymunk.version", "2.0.0")
    assert load_engine("pymunk").version == version("pymunk")
