"""pymunk alone: distance drives, guides that hold angles, loops."""

from importlib.metadata import version

import numpy as np
import pytest

from stiction.engines import BadTrajectory, load_engine
from stiction.engines.assembly import Assembly
from stiction.engines.pymunk.correction import Iteration, bias_of_share, share_of_bias
from stiction.engines.pymunk.engine import non_turning
from stiction.engines.shared.step_kernels import Balance, assemble
from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import four_bar_truth, pendulum_truth


@pytest.fixture(scope="module")
def engine():
    return load_engine("pymunk")


@pytest.mark.parametrize(
    ("name", "truth", "column", "t_end"),
    [("pendulum", pendulum_truth, "mass.x", 2.0), ("four-bar", four_bar_truth, "upright-0.x", 0.6)],
)  # before its singular position, where iterations matter
def test_first_order(engine, name, truth, column, t_end):
    scene = load_scene(name)
    solution = truth(scene, t_end)
    errors = [
        np.abs(run[column] - solution(run.t)[column]).max()
        for run in (
            engine.simulate(scene, t_end=t_end, dt=dt, output_step=0.02) for dt in (2e-3, 5e-4)
        )
    ]
    assert errors[1] < errors[0] / 4**0.8  # order 1, less the curvature of the coarse run


@pytest.mark.parametrize("axis", [None, [1, 1]])
def test_distance_follows_its_law(engine, axis):
    """A point on a rod of changing length, or on a line that moves along (1, 1)."""
    start = (
        {"position": [0.6, 0.8]} if axis is None else {"position": [1 / np.sqrt(2), 1 / np.sqrt(2)]}
    )
    drive = {
        "type": "distance",
        "bodies": ["mass", "ground"],
        "law": {"type": "sine", "offset": 1, "amplitude": 0.2, "frequency": 3},
    }
    if axis is not None:
        drive["axis"] = axis
    direction = np.array(start["position"])
    start["velocity"] = list(0.6 * direction)  # the rate of the law
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"mass": {"mass": 1, "inertia": 1, **start}},
            "drives": {"rod": drive},
        }
    )
    run = engine.simulate(scene, t_end=1.0, dt=1e-3)
    distance = (
        np.hypot(run["mass.x"], run["mass.y"])
        if axis is None
        else (run["mass.x"] + run["mass.y"]) / np.sqrt(2)
    )
    np.testing.assert_allclose(
        distance, 1 + 0.2 * np.sin(3 * run.t), atol=5e-5
    )  # h^2 times accelerations of 50 m/s^2


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


@pytest.mark.parametrize(
    "law", [{"type": "linear", "rate": 1.0}, {"type": "sine", "amplitude": 1.0, "frequency": 1.0}]
)
@pytest.mark.parametrize("dt", [1e-2, 1e-3, 1e-4])
def test_a_slider_at_rest_stays(engine, dt, law):
    """The bar's centripetal force is 2 N, friction holds 2.66 N: one and a half times the load in the first step alone moved the slider for good."""
    scene = vary(load_scene("slider-bar-case-1"), {"w0": 1, "F0": 0, "motor.law": law})
    run = engine.simulate(scene, t_end=0.1, dt=dt, output_step=0.01)
    assert (
        np.abs(run["slider.x"] - run["slider.x"][0]).max() < 1e-12
    )  # solver residual over the run
    np.testing.assert_allclose(
        run["guide.friction"][0], -2.0, rtol=3 * dt
    )  # that of the second step
    assert run["slider.vx"][0] == 0.0 and run["bar.omega"][0] == 1.0  # the start is the scene's


def test_second_order_while_no_guide_changes_its_mode(engine):
    """Velocities are those of the middle of a step, also the first: a start from those at t = 0 is off by h a t/2."""
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"sled": {"mass": 2, "inertia": 1, "velocity": [3, 0]}},
            "joints": {
                "guide": {"type": "translational", "guide": "ground", "slider": "sled", "mu": 0.2}
            },
        }
    )
    run = engine.simulate(scene, t_end=1.0, dt=1e-2)
    np.testing.assert_allclose(run["sled.x"], 3 * run.t - 0.2 * 9.81 * run.t**2 / 2, atol=1e-9)


def test_a_load_of_a_millisecond_moves_the_slider_when_it_acts(engine):
    run = engine.simulate(
        load_scene("hard/break-away-for-a-millisecond"), t_end=5.7, dt=1e-3, output_step=1e-3
    )
    moved = np.abs(run["slider.x"] - run["slider.x"][0]) > 1e-9
    assert 5.6248 <= run.t[moved.argmax()] <= 5.6278  # the truth's break-away, and three steps


def scotch_yoke(block):
    """A yoke of 2 kg on the ground's guide, driven by a crank pin in its slot; a light block of this mass (kg) is in the slot."""
    r, w = 0.05, 2 * np.pi / 3
    return scene_from_dict(
        {
            "bodies": {
                "crank": {"mass": 1, "inertia": 0.01, "angular_velocity": w},
                "block": {
                    "mass": block,
                    "inertia": 1e-4 * block,
                    "position": [r, 0],
                    "velocity": [0, r * w],
                },
                "yoke": {"mass": 2, "inertia": 0.1, "position": [r, 0]},
            },
            "joints": {
                "pivot": {"type": "revolute", "bodies": ["crank", "ground"]},
                "crankpin": {
                    "type": "revolute",
                    "bodies": ["block", "crank"],
                    "points": [[0, 0], [r, 0]],
                },
                "slot": {
                    "type": "translational",
                    "slider": "block",
                    "guide": "yoke",
                    "direction": [0, 1],
                },
                "guide": {"type": "translational", "slider": "yoke"},
            },
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["crank", "ground"],
                    "law": {"type": "linear", "rate": w},
                }
            },
        }
    )


@pytest.mark.parametrize("block", [2.0, 2e-2, 2e-3, 1e-3, 2e-4])
@pytest.mark.parametrize("dt", [4e-3, 1e-3, 2.5e-4])
def test_a_light_body_between_heavy_ones_does_not_fly_apart(engine, block, dt):
    """The yoke of a Scotch yoke is at r cos(w t), whatever the block in its slot weighs; that of 1e-4 of the yoke's mass is off by 5 % of r at 4 ms."""
    run = engine.simulate(scotch_yoke(block), t_end=3.0, dt=dt, output_step=0.02)
    off = np.abs(run["yoke.x"] - 0.05 * np.cos(2 * np.pi / 3 * run.t)).max()
    assert off < (2.5e-4 if block >= 1e-3 else 2.5e-3) * dt / 1e-3


def test_the_share_that_iterations_bear():
    """As the eigenvalues of a step say: with it the Scotch yoke stays together, with three times what is stable it does not."""
    scene = scotch_yoke(2e-2)
    balance = Balance.of(Assembly(scene).whole)
    assemble(balance, 0.0, balance.q.copy(), balance.v.copy(), 0.0)
    iteration = Iteration(scene, balance, non_turning(scene))
    left = iteration.left(50)
    assert 0.5 < left < 1.0 and iteration.share(50) < (1 - left) / left

    def growth(share):
        phi = np.array([[1, 1, 0], [0, 1, 0], [0, 0, 1]])
        rest = np.array(
            [[1, 0, 0], [-(1 - left) * share, left, left], [-(1 - left) * share, left - 1, left]]
        )
        return np.abs(np.linalg.eigvals(rest @ phi)).max()

    stable = (1 - left) / left
    assert growth(0.999 * stable) < 1 < growth(1.001 * stable)
    solver = load_engine("pymunk")
    solver.simulate(scene, t_end=3.0, dt=4e-3, error_bias=bias_of_share(0.8 * stable, 4e-3))
    with pytest.raises(BadTrajectory):
        solver.simulate(
            scene, t_end=3.0, dt=4e-3, error_bias=bias_of_share(min(0.999, 1.5 * stable), 4e-3)
        )


@pytest.mark.parametrize(("share", "h"), [(1.0, 1e-3), (0.5, 4e-3), (0.1, 1e-3), (1e-3, 1e-4)])
def test_the_share_of_a_step_is_what_chipmunk_makes_of_a_second(share, h):
    assert share_of_bias(bias_of_share(share, h), h) == pytest.approx(share)
    assert (
        0 < share_of_bias(bias_of_share(0.5, 1e-5), 1e-5) < 0.5
    )  # the smallest float, where that of the share is none


def test_a_run_that_flies_apart_says_so(engine):
    """Not that a guide ends far away: where and when it left the mechanism."""
    with pytest.raises(
        BadTrajectory,
        match=r"the run diverged: .* m off its constraints at t = .* s with dt = 0.001 s",
    ):
        engine.simulate(scotch_yoke(1e-3), t_end=6.0, dt=1e-3, error_bias=1e-300)


@pytest.mark.parametrize("axis", [None, [1, 0]])
@pytest.mark.parametrize("error_bias", [0.0, 1e-30, 0.0018])
def test_a_driven_distance_does_not_lag_behind_its_law(engine, axis, error_bias):
    """A rate of 1 m/s would be 1 m/s over the rate of the correction behind, at any step: 0.16 m with 0.0018."""
    drive = {
        "type": "distance",
        "bodies": ["mass", "ground"],
        "law": {"type": "linear", "offset": 0.5, "rate": 1.0},
    }
    scene = scene_from_dict(
        {
            "bodies": {"mass": {"mass": 1, "inertia": 1, "position": [0.5, 0], "velocity": [1, 0]}},
            "drives": {"rod": drive | ({"axis": axis} if axis else {})},
        }
    )
    run = engine.simulate(scene, t_end=1.0, dt=1e-3, error_bias=error_bias)
    np.testing.assert_allclose(run["mass.x"], 0.5 + run.t, atol=1e-9)


def test_reactions_of_a_loop_are_those_of_the_motion_from_the_first_row_on(engine):
    """A chain of links that swings from the horizontal: the acceleration of its first row is that of the reference."""
    links = {
        f"l{i}": {
            "mass": 1,
            "inertia": 0.01,
            "position": [0.3 * i + 0.15, 0],
            "velocity": [0, 0.5 * (0.3 * i + 0.15)],
            "angular_velocity": 0.5,
        }
        for i in range(4)
    }
    joints = {
        f"p{i}": {
            "type": "revolute",
            "bodies": [f"l{i}", f"l{i - 1}" if i else "ground"],
            "points": [[-0.15, 0], [0.15 if i else 0, 0]],
        }
        for i in range(4)
    }
    scene = scene_from_dict({"gravity": [0, -9.81], "bodies": links, "joints": joints})
    run, truth = (
        engine.simulate(scene, t_end=0.1, dt=1e-3),
        load_engine("reference").simulate(scene, t_end=0.1, rtol=1e-10),
    )
    for row in ("p0.fx", "p3.fx", "l3.alpha"):
        assert abs(run[row][0] - truth[row][0]) < 2e-2 * np.abs(truth[row]).max()


def test_the_version_is_that_of_the_installed_package(monkeypatch):
    """That of the wheel 7.0.0 says 2.0.0 of itself."""
    monkeypatch.setattr("pymunk.version", "2.0.0")
    assert load_engine("pymunk").version == version("pymunk")
