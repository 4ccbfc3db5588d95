"""PyBullet alone: the tree of links, loops, what it refuses, what it leaves behind."""

import numpy as np
import pytest

from stiction.engines import Refused, load_engine
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import load_scene, scene_from_dict, vary

SCENES = [
    "slider-bar-case-1",
    "elliptic-trammel",
    "four-bar",
    "mass-on-belt",
    "pendulum",
    "slider-crank",
    "slider-on-moving-guide",
]


@pytest.fixture(scope="module")
def engine():
    return load_engine("pybullet")


def reversed_joints(name):
    """The scene with the bodies of every revolute joint exchanged: children where there were parents."""
    scene = load_scene(name)
    return vary(
        scene,
        {
            f"{joint}.{key}": list(getattr(data, key))[::-1]
            for joint, data in scene.joints.items()
            if joint not in scene.guides
            for key in ("bodies", "points")
        },
    )


@pytest.mark.parametrize("name", SCENES)
def test_tree_holds_the_start(name):
    scene = load_scene(name)
    tree = LinkTree(scene)
    position, velocity = tree.coordinates(scene)
    q, v, _ = tree.motion(position, velocity, np.zeros(len(position)))
    bodies = scene.bodies.values()
    np.testing.assert_allclose(q, [x for b in bodies for x in (*b.position, b.angle)], atol=1e-14)
    np.testing.assert_allclose(
        v, [x for b in bodies for x in (*b.velocity, b.angular_velocity)], atol=1e-14
    )


@pytest.mark.parametrize("name", SCENES)
def test_tree_rates_are_derivatives(name):
    """Along quadratic joint motions, central differences of the bodies' coordinates."""
    tree = LinkTree(load_scene(name))
    rng = np.random.default_rng(5)
    p0, p1, p2 = rng.normal(size=(3, len(tree.links)))

    def q(t):
        return tree.motion(p0 + p1 * t + p2 * t * t / 2, p1 + p2 * t, p2)[0]

    h = 1e-4
    _, v, a = tree.motion(p0, p1, p2)
    # truncation h^2 times third derivatives of 1e2; rounding 1e-15/h^2 times coordinates of 10
    np.testing.assert_allclose((q(h) - q(-h)) / (2 * h), v, atol=1e-5)
    np.testing.assert_allclose((q(h) - 2 * q(0.0) + q(-h)) / h**2, a, atol=1e-5)


@pytest.mark.parametrize("name", ["slider-bar-case-1", "elliptic-trammel", "slider-crank"])
def test_order_of_bodies_in_a_joint_does_not_matter(engine, name):
    one, two = (
        engine.simulate(scene, t_end=0.3, dt=1e-3)
        for scene in (load_scene(name), reversed_joints(name))
    )
    for body in load_scene(name).bodies:
        # the same joints, if not the same root of each: equal to the solver's residual
        np.testing.assert_allclose(one[f"{body}.x"], two[f"{body}.x"], atol=1e-8)


def test_guide_may_hang_from_its_slider(engine):
    """A slider pinned to the ground carries its guide: the slider's joint coordinate runs backwards."""
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {
                "rail": {
                    "mass": 1,
                    "inertia": 0.1,
                    "angle": 0.3,
                    "position": [0.2 * np.cos(0.3), 0.2 * np.sin(0.3)],
                },
                "slider": {"mass": 2, "inertia": 0.2, "angle": 0.3},
            },
            "joints": {
                "pivot": {"type": "revolute", "bodies": ["slider", "ground"]},
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "guide": "rail",
                    "mu": 0.1,
                    "mus": 0.15,
                    "length": 0.2,
                    "width": 0.1,
                },
            },
        }
    )
    bullet, munk = (
        load_engine(name).simulate(scene, t_end=0.8, dt=5e-4) for name in ("pybullet", "pymunk")
    )
    for column in ("rail.x", "rail.angle", "guide.displacement"):
        # two first-order methods, h = 5e-4 s, accelerations of 10 m/s^2
        np.testing.assert_allclose(bullet[column], munk[column], atol=1e-2)
    assert np.ptp(bullet["guide.displacement"]) > 0.1  # it does slide


def test_loops_stay_closed(engine):
    """The whole position error is corrected each step, so it falls with the square of the step."""
    drift = [
        engine.simulate(load_scene("elliptic-trammel"), t_end=0.5, dt=dt)["drift.position"].max()
        for dt in (2e-3, 1e-3)
    ]
    assert drift[1] < drift[0] / 3  # 4, less the curvature of the coarse run


def test_a_load_on_a_link_that_turns_acts_where_the_link_is(engine):
    """Not where it was a step before, with a moment of h v F: MuJoCo makes the same steps of joint coordinates."""
    pytest.importorskip("mujoco")
    scene = vary(
        load_scene("slider-on-moving-guide"), {"guide.mu": 0.0, "guide.mus": 0.0, "t_end": 1.0}
    )
    ours, theirs = (one.simulate(scene, dt=1e-3) for one in (engine, load_engine("mujoco")))
    for column in ("arm.angle", "slider.x", "slider.y"):
        np.testing.assert_allclose(
            ours[column], theirs[column], atol=1e-9
        )  # rounding; 5e-5 with that moment


class TestRefusals:
    def refuse(self, engine, scene, words):
        with pytest.raises(Refused, match=words):
            engine.simulate(scene)

    def test_rod(self, engine):
        self.refuse(
            engine,
            load_scene("pendulum"),
            "drives.rod: the PyBullet adapter drives distances only along a guide",
        )

    def test_translational_joint_that_closes_a_loop(self, engine):
        guides = {
            name: {
                "type": "translational",
                "slider": "block",
                "direction": [1, 0],
                "point": [0, y],
                "slider_point": [0, y],
            }
            for name, y in (("one", 0), ("two", 1))
        }
        self.refuse(
            engine,
            scene_from_dict({"bodies": {"block": {"mass": 1, "inertia": 1}}, "joints": guides}),
            "joints.two: closes a loop",
        )

    def test_angle_over_two_hinges(self, engine):
        scene = vary(
            load_scene("slider-crank"),
            {"motor.bodies": ["rod", "ground"], "motor.law.rate": "-w0*r/l"},
        )
        self.refuse(engine, scene, "drives.motor: .*2 hinges")


def sliders(count):
    """Sliders on guides of their own, the last of them the fastest."""
    return scene_from_dict(
        {
            "bodies": {
                f"slider{i}": {
                    "mass": 1.0,
                    "inertia": 0.1,
                    "position": [0.1 * i, i],
                    "velocity": [0.01 * i, 0.0],
                }
                for i in range(count)
            },
            "joints": {
                f"guide{i}": {"type": "translational", "slider": f"slider{i}", "point": [0.0, i]}
                for i in range(count)
            },
        }
    )


def test_as_many_links_as_start_where_they_are_to(engine):
    """PyBullet drops the starts of further ones in silence."""
    run = engine.simulate(sliders(121), t_end=0.01, dt=1e-3)
    np.testing.assert_allclose([run["slider120.x"][0], run["slider120.vx"][0]], [12.0, 1.2])
    np.testing.assert_allclose(run["slider120.x"][-1], 12.012)
    with pytest.raises(Refused, match="122 links; PyBullet puts at most 121"):
        engine.simulate(sliders(122), t_end=0.01, dt=1e-3)


def test_an_anchor_of_friction_pulls_a_stopped_box_back(engine):
    """Coulomb's friction stops it for good after v^2/(2 mu g), a step early or late; the anchor is a spring to where the contact began."""
    mu, g = 0.2, 9.81
    scene = scene_from_dict(
        {
            "gravity": [0, -g],
            "bodies": {"slider": {"mass": 2.0, "inertia": 0.1, "velocity": [1.0, 0.0]}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [1.0, 0.0],
                    "mu": mu,
                    "length": 0.6,
                    "width": 0.1,
                }
            },
        }
    )
    plain, anchored = (
        engine.simulate(scene, t_end=1.0, dt=1e-3, fidelity="contact", friction_anchor=word)[
            "guide.displacement"
        ]
        for word in ("off", "on")
    )
    assert plain[-1] == pytest.approx(1 / (2 * mu * g), abs=1e-3)
    assert plain[-1] == plain.max() and anchored[-1] < anchored.max() - 1e-4
