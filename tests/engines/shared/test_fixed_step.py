"""What pymunk, PyBullet, MuJoCo, Drake and DART have in common: order 1, Coulomb's law with two coefficients, refusals, settings."""

import os
import re
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from conftest import installed

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines import BadTrajectory, EngineFailure, Refused
from stiction.engines.protocol import Declined
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.scenes.fidelity import Fidelity
from stiction.truths import (
    moving_guide_truth,
    oscillator_truth,
    slider_bar_truth,
    slider_crank_truth,
    trammel_truth,
)

G = 9.81

CREEP = {
    "pymunk": 1e-9,
    "pybullet": 1e-9,
    "mujoco": 1e-9,
    "drake": (0.1 / (2 * np.pi)) ** 2 * G * 1e-3,
    "dart": 1e-9,
}
"""m/s of a slider that sticks: the solvers' residuals; Drake's servos leave (beta/(2 pi))^2 of what it is to stop in a step, here of 1 ms, with SAP's
beta = 0.1 for them."""
CONTACT_CREEP = {
    **CREEP,
    "mujoco": 1.01 * 0.5 * (1 / 2 + 0.3**2 / 0.1) / 1e4 * G * np.sin(np.arctan(0.25)) * 1e-3,
    "dart": 0.01 * G * 1e-3 * np.exp(-0.01 * 500),
}
"""The same of the block below at contact fidelity. MuJoCo's friction gives way by (1 - d)/d = 0.5 of what a corner's normal direction moves by, over `impratio`, and
two corners share the load. A box of DART's lands in its guide within a step, g h^2 deep at most; after 500 steps, as 1 % of an overlap is corrected in each, it slides no
faster than it rises."""


@pytest.fixture(params=["pymunk", "pybullet", "mujoco", "drake", "dart"])
def engine(request):
    return installed(request.param)


def largest_error(trajectory, truth, column):
    return np.abs(trajectory[column] - truth(trajectory.t)[column]).max()


def order(errors, ratio):
    return np.log(errors[0] / errors[-1]) / np.log(ratio)


def block(incline, mu, mus, length=None, width=None, speed=0.0):
    surface = {} if length is None else {"length": length, "width": width}
    return scene_from_dict(
        {
            "gravity": [0, -G],
            "bodies": {
                "slider": {
                    "mass": 2,
                    "inertia": 0.1,
                    "angle": -incline,
                    "velocity": [speed * np.cos(incline), -speed * np.sin(incline)],
                }
            },
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "angle": -incline,
                    "direction": [np.cos(incline), -np.sin(incline)],
                    "mu": mu,
                    "mus": mus,
                    **surface,
                }
            },
        }
    )


T_END = 4.5
"""Of the slider-bar: case 1 has broken away and turned by then, case 3 has turned four times, with corners that change between."""
STEPS = (4e-3, 1e-3)


@cache
def slider_bar(case):
    scene = load_scene(f"slider-bar-case-{case}")
    return scene, slider_bar_truth(scene, T_END)


@cache
def run_of(name, case, dt, fidelity="joint"):
    """Made once for all laws that are asserted of it."""
    return installed(name).simulate(
        slider_bar(case)[0], t_end=T_END, dt=dt, fidelity=fidelity, output_step=0.02
    )


class TestSliderBar:
    @pytest.mark.parametrize("case", [1, 3])
    def test_first_order_in_states(self, engine, case):
        """And what is left is late by three steps at most: forces are those of a step's start, friction that of the step before, and a
        break-away waits for the end of its step."""
        runs, truth = [run_of(engine.name, case, dt) for dt in STEPS], slider_bar(case)[1]
        for column in ("slider.x", "slider.vx"):
            # at least 1, less what a switch a whole step early or late does to the coarsest run
            assert order([largest_error(run, truth, column) for run in runs], 4.0) > 0.8
        speed = np.abs(truth(np.linspace(0.0, T_END, 4501))["slider.vx"]).max()
        assert largest_error(runs[-1], truth, "slider.x") < 3 * STEPS[-1] * speed

    def test_first_order_in_reactions_between_events(self, engine):
        errors, truth = [], slider_bar(1)[1]
        for run in (run_of(engine.name, 1, dt) for dt in STEPS):
            events, exact = np.array([event.time for event in truth.events]), truth(run.t)
            between = (
                np.abs(run.t[:, None] - events).min(axis=1) > 0.02
            )  # at an event a sample may be off by the jump
            errors.append(
                [
                    np.abs(run[column] - exact[column])[between].max()
                    for column in ("motor.effort", "guide.friction", "pin.fx")
                ]
            )
        assert np.all(
            order(np.array(errors), 4.0) > 0.8
        )  # 1, less what is left of the coarse run's curvature

    def test_stick_is_stick(self, engine):
        run = engine.simulate(load_scene("slider-bar-case-1"), t_end=8.5, dt=2e-3, output_step=0.02)
        inside = (run.t > 7.61) & (
            run.t < 8.21
        )  # truth: 7.60003 .. 8.21736, and five steps of 2e-3 s
        assert np.all(run["guide.mode"][inside] == 0)
        assert np.abs(run["slider.vx"][inside]).max() < 2 * CREEP[engine.name]  # at twice the step

    def test_contact_fidelity(self, engine):
        """A box in a guide is the same mechanism: same motion, to the order of the step times 1 m/s."""
        run = run_of(engine.name, 1, 1e-3, "contact")
        assert run.fidelity == "contact"
        late = (
            2 if engine.name == "drake" else 1
        )  # steps; a break-away waits for the speed at which Drake's regularized friction is whole
        assert largest_error(run, slider_bar(1)[1], "slider.x") < late * 1e-3
        assert run["drift.position"].max() < 1e-3  # metres and radians that the box sinks and tilts

    @pytest.mark.parametrize("case", [1, 3])
    @pytest.mark.parametrize("name", ["mujoco", "drake", "dart"])
    def test_contacts_are_of_first_order(self, name, case):
        """As the pages of these three engines say."""
        assert (
            order(
                [
                    largest_error(
                        run_of(name, case, dt, "contact"), slider_bar(case)[1], "slider.x"
                    )
                    for dt in STEPS
                ],
                4.0,
            )
            > 0.8
        )

    @pytest.mark.parametrize("fidelity", Fidelity)
    def test_repeats_to_the_bit(self, engine, fidelity):
        one, two = (
            engine.simulate(load_scene("slider-bar-case-1"), t_end=1.0, dt=5e-3, fidelity=fidelity)
            for _ in range(2)
        )
        assert all(np.array_equal(one[name], two[name]) for name in one.columns)


class TestFriction:
    @pytest.mark.parametrize("side", [1, -1])
    @pytest.mark.parametrize(
        ("tangent", "slides", "fidelity"),
        [
            (0.299, False, "joint"),
            (0.301, True, "joint"),
            (0.25, False, "contact"),
            (0.4, True, "contact"),
        ],
    )  # a box may be wedged: surfaces that press on each other
    def test_incline(self, engine, tangent, slides, fidelity, side):
        """Sticks iff tan <= mus = 0.3; slides with g (sin - mu cos). Flat box: friction does not tip it."""
        tangent *= side
        dt, t_end = 1e-3, 0.5
        incline = np.arctan(tangent)
        run = engine.simulate(
            block(incline, 0.2, 0.3, 0.6, 0.1), t_end=t_end, dt=dt, fidelity=fidelity
        )
        creep = CREEP if fidelity == "joint" else CONTACT_CREEP
        rate = (
            np.sign(tangent) * G * (abs(np.sin(incline)) - 0.2 * np.cos(incline)) if slides else 0.0
        )
        # three steps at most without friction (boxes land first) or with mus (while stick is undecided)
        assert run["guide.slip_velocity"][-1] == pytest.approx(
            rate * t_end, abs=3 * dt * G * 0.3 if slides else creep[engine.name]
        )

    def test_blocks_beside_each_other_touch_their_own_guides_only(self, engine):
        """Each lies behind the other's surfaces; each is braked by mu g."""
        dt, mu = 1e-3, {"low": 0.2, "high": 0.4}
        scene = scene_from_dict(
            {
                "gravity": [0.0, -G],
                "bodies": {
                    name: {"mass": 2, "inertia": 0.1, "position": [0, i], "velocity": [1, 0]}
                    for i, name in enumerate(mu)
                },
                "joints": {
                    f"{name}-guide": {
                        "type": "translational",
                        "slider": name,
                        "direction": [1, 0],
                        "point": [0, i],
                        "length": 0.6,
                        "width": 0.1,
                        "mu": mu[name],
                    }
                    for i, name in enumerate(mu)
                },
            }
        )
        run = engine.simulate(scene, t_end=0.2, dt=dt, fidelity="contact")
        for name in mu:
            np.testing.assert_allclose(
                run[f"{name}-guide.slip_velocity"],
                1 - mu[name] * G * run.t,
                atol=3 * dt * mu[name] * G,
            )

    @pytest.mark.parametrize("fast", ["slider", "ball"])
    def test_guides_go_as_far_as_is_said(self, engine, fast):
        """1 km in less than a second: sliders come to the end of a guide where it has one; what is in no guide has no end to come to."""
        scene = scene_from_dict(
            {
                "gravity": [0.0, -G],
                "bodies": {
                    "slider": {
                        "mass": 2,
                        "inertia": 0.1,
                        "velocity": [1200.0 if fast == "slider" else 0.0, 0],
                    },
                    "ball": {
                        "mass": 1,
                        "inertia": 1,
                        "position": [0, 5],
                        "velocity": [1200.0 if fast == "ball" else 0.0, 0],
                    },
                },
                "joints": {
                    "guide": {
                        "type": "translational",
                        "slider": "slider",
                        "direction": [1, 0],
                        "length": 0.6,
                        "width": 0.1,
                        "mu": 0.2,
                    }
                },
            }
        )
        if fast == "slider" and engine.name in ("pybullet", "dart"):
            with pytest.raises(
                BadTrajectory,
                match=r"guide is 1[0-2]\d\d(\.\d+)? m from its guide's point; guides end at 1000 m",
            ):
                engine.simulate(scene, t_end=1.0, dt=1e-3, fidelity="contact")
        else:
            run = engine.simulate(scene, t_end=1.0, dt=1e-3, fidelity="contact")
            assert run[f"{fast}.x"][-1] == pytest.approx(
                1200 - (0.2 * G / 2 if fast == "slider" else 0.0), abs=1e-2
            )

    def test_friction_larger_than_the_normal_force(self, engine):
        """mu = 1.5 on a long slider, which it does not tip: an engine may take the coefficient for one that is at most 1."""
        dt = 1e-3
        run = engine.simulate(
            block(0.0, 1.5, 1.5, 0.6, 0.1, speed=4.0), t_end=0.2, dt=dt, fidelity="contact"
        )
        assert run["guide.slip_velocity"][-1] == pytest.approx(
            4 - 1.5 * G * run.t[-1], abs=3 * dt * 1.5 * G
        )

    def test_coulomb_oscillator(self, engine):
        scene = load_scene("coulomb-oscillator")
        truth = oscillator_truth(scene, 12.0)
        errors = [
            largest_error(
                engine.simulate(scene, t_end=12.0, dt=dt, output_step=0.08), truth, "slider.x"
            )
            for dt in (8e-3, 2e-3)
        ]
        assert order(errors, 4.0) > 0.8  # as for the slider-bar

    @pytest.mark.parametrize(
        ("name", "solve", "t_end"),
        [
            ("elliptic-trammel", trammel_truth, 1.0),  # two guides
            ("slider-on-moving-guide", moving_guide_truth, 2.0),
        ],
    )  # a guide that turns
    def test_other_guides(self, engine, name, solve, t_end):
        scene = load_scene(name)
        truth = solve(scene, t_end)
        runs = [
            engine.simulate(scene, t_end=t_end, dt=dt, output_step=0.04) for dt in (1e-3, 2.5e-4)
        ]
        for guide in scene.frictional_guides:
            assert (
                order([largest_error(run, truth, f"{guide}.displacement") for run in runs], 4.0)
                > 0.8
            )  # as above

    def test_first_order_in_reactions_from_the_start(self, engine):
        """Neither what makes the start the engine's own nor a friction bound without a step before it is seen in them."""
        scene = load_scene("elliptic-trammel")
        truth = trammel_truth(scene, 0.1)
        names = [
            f"{guide}.{force}"
            for guide in scene.frictional_guides
            for force in ("normal_force", "friction")
        ]
        errors = []
        for dt in (1e-3, 2.5e-4):
            run = engine.simulate(scene, t_end=0.05, dt=dt, output_step=5e-3)
            errors.append([np.abs(run[name] - truth(run.t)[name]).max() for name in names])
        assert np.all(order(np.array(errors), 4.0) > 0.8)  # as above

    def test_belt(self, engine):
        """Stick ends at most one step late; the slider then moves at 0.43 m/s at most."""
        scene = load_scene("mass-on-belt")
        truth = oscillator_truth(scene, 6.0)
        for dt in (4e-3, 1e-3):
            run = engine.simulate(scene, t_end=6.0, dt=dt, output_step=0.04)
            assert largest_error(run, truth, "guide.displacement") < 0.43 * dt

    def test_frictionless_has_no_friction_machinery(self, engine):
        run = engine.simulate(load_scene("slider-bar-case-1-frictionless"), t_end=0.5, dt=1e-3)
        assert run.cost.counters["balances"] == 0
        assert (
            abs(run.cost.counters["passes"] - run.cost.counters["steps"]) <= 1
        )  # one step ahead or not
        with_friction = engine.simulate(
            load_scene("slider-bar-case-1"), t_end=0.5, dt=1e-3
        ).cost.counters
        assert with_friction["balances"] == with_friction["passes"] > with_friction["steps"]


class TestDrives:
    def test_torque_of_the_slider_crank(self, engine):
        scene = load_scene("slider-crank")
        truth = slider_crank_truth(scene, 1.0)
        errors = [
            largest_error(
                engine.simulate(scene, t_end=1.0, dt=dt, output_step=0.02), truth, "motor.effort"
            )
            for dt in (4e-3, 1e-3)
        ]
        assert order(errors, 4.0) > 0.8  # loops are held to h^2, their reactions to h

    def test_angle_follows_its_law(self, engine):
        scene = vary(
            load_scene("slider-crank"),
            {"motor.law": {"type": "sine", "amplitude": "w0", "frequency": 1}},
        )
        run = engine.simulate(scene, t_end=2.0, dt=1e-3)
        np.testing.assert_allclose(
            run["crank.angle"], 2 * np.pi * np.sin(run.t), atol=1e-7
        )  # solver residual

    @pytest.mark.parametrize(
        "law",
        [{"type": "linear", "rate": 5.0}, {"type": "sine", "amplitude": 5.0, "frequency": 1.0}],
    )
    def test_a_motor_turns_what_nothing_holds(self, engine, law):
        """A thrown stone whose angle is driven against the ground: its centre of mass falls as semi-implicit Euler has it, off by g h t/2 or less."""
        scene = scene_from_dict(
            {
                "gravity": [0, -G],
                "bodies": {
                    "stone": {
                        "mass": 2,
                        "inertia": 0.3,
                        "position": [1, 2],
                        "velocity": [3, 4],
                        "angular_velocity": 5,
                    }
                },
                "drives": {"motor": {"type": "angle", "bodies": ["stone", "ground"], "law": law}},
            }
        )
        if engine.name == "dart":
            with pytest.raises(Refused, match="drives.motor: turns a body that no joint ties"):
                engine.simulate(scene)
            return
        run = engine.simulate(scene, t_end=1.0, dt=1e-3)
        np.testing.assert_allclose(run["stone.x"], 1 + 3 * run.t, atol=1e-9)
        np.testing.assert_allclose(
            run["stone.y"], 2 + 4 * run.t - G * run.t**2 / 2, atol=1.01 * G * 1e-3 / 2
        )
        np.testing.assert_allclose(
            run["stone.angle"], 5 * (np.sin(run.t) if law["type"] == "sine" else run.t), atol=1e-6
        )


STARTING = ("pymunk", "pybullet", "mujoco", "drake", "dart", "exudyn")
"""Engines whose adapter assembles nothing."""


class TestOutput:
    @pytest.mark.parametrize("length", [1.0, 1e-6])
    @pytest.mark.parametrize("name", ["inconsistent-position", "inconsistent-velocity"])
    @pytest.mark.parametrize(
        ("engine_name", "settings"),
        [
            (name, settings)
            for name in STARTING
            for settings in ({}, {"method": "accelerations", "rtol": 1e-6}, {"fidelity": "contact"})
            if not (name in ("exudyn", "pymunk") and "method" in settings)
        ],
    )
    def test_a_start_off_its_constraints_is_declined(self, engine_name, settings, name, length):
        """In metres and in megametres alike, in the same words whoever the engine is."""
        off = f"{0.05 * length:.2g}" if name.endswith("position") else "[0-9.e-]+"
        scene = scaled(load_scene(f"hard/{name}"), Units(length=length))
        if settings.get("fidelity") == "contact":
            scene = vary(scene, {f"{guide}.mus": None for guide in scene.guides})
        with pytest.raises(
            Declined,
            match=f"the start is {off} .* off its constraints; this adapter assembles nothing",
        ):
            installed(engine_name).simulate(scene, t_end=0.1, **settings)

    @pytest.mark.parametrize("engine_name", STARTING)
    def test_a_start_off_the_law_of_its_drive_is_declined(self, engine_name):
        """Coordinates of joints meet every joint, not the law that a drive begins with."""
        scene = vary(
            load_scene("slider-bar-case-1"),
            {"motor.law": {"type": "linear", "offset": 0.1, "rate": 1.0}, "w0": 1},
        )
        with pytest.raises(Declined, match="the start is 0.1 m or rad off its constraints"):
            installed(engine_name).simulate(scene, t_end=0.1)

    def test_blow_up_is_a_failure(self, engine):
        """A spring that an explicit step of 0.01 s cannot follow: h^2 k/m = 1e10."""
        scene = vary(load_scene("coulomb-oscillator"), {"spring.stiffness": 1e14})
        with pytest.raises(EngineFailure, match=engine.name), np.errstate(all="ignore"):
            engine.simulate(scene, t_end=4.0, dt=1e-2)

    def test_a_reaction_that_is_no_number_is_a_failure(self, engine):
        """A bound of friction that overflows, at the start."""
        scene = vary(load_scene("slider-bar-case-1"), {"guide.mu": 1e308, "guide.mus": 1e308})
        with (
            pytest.raises(
                EngineFailure, match=f"{engine.name}: a reaction is not finite, after t = 0 s"
            ),
            np.errstate(all="ignore"),
        ):
            engine.simulate(scene, t_end=1.0, dt=1e-2)


@pytest.mark.parametrize("name", ["pybullet", "drake"])
def test_keeps_quiet(name):
    """PyBullet prints its build time when it is imported; Drake warns of half-spaces, that they do not touch deformable bodies."""
    installed(name)
    code = (
        "from stiction.engines import load_engine; from stiction.scenes import load_scene; "
        f"load_engine({name!r}).simulate(load_scene('slider-bar-case-1'), t_end=0.01, fidelity='contact')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


class TestRefusals:
    @pytest.mark.parametrize(
        ("name", "words"),
        [
            ("coulomb-oscillator", "guide: contact fidelity needs the slider's length and width"),
            ("slider-on-moving-guide", "its guide is the body 'arm'"),
            ("four-bar", "no translational joint"),
        ],
    )
    def test_contacts_need_a_box_in_a_guide_of_the_ground(self, engine, name, words):
        with pytest.raises(Refused, match=words):
            engine.simulate(load_scene(name), fidelity="contact")

    def test_a_body_in_two_guides_of_unlike_friction(self, engine):
        """Engines with one box for a body, or with contacts told by body, would give both guides one friction."""
        guide = {"type": "translational", "slider": "sled", "length": 0.2, "width": 0.1, "mu": 0.2}
        words = {
            "pymunk": "joints.right: its slider slides in joints.left, too, with other coefficients",
            "pybullet": "joints.right: .* touches one guide",
            "dart": "joints.right: .* touches one guide",
        }.get(engine.name)
        for mu, refused in ((0.0, words), (0.2, words if engine.name != "pymunk" else None)):
            scene = scene_from_dict(
                {
                    "gravity": [0, -G],
                    "bodies": {"sled": {"mass": 1, "inertia": 0.1}},
                    "joints": {
                        "left": {**guide, "slider_point": [-0.5, 0], "point": [-0.5, 0]},
                        "right": {**guide, "slider_point": [0.5, 0], "point": [0.5, 0], "mu": mu},
                    },
                }
            )
            found = engine.refusal(scene, "contact")
            assert found is None if refused is None else re.match(refused, found), found

    def test_drive_of_an_angle_that_guides_hold(self, engine):
        scene = scene_from_dict(
            {
                "bodies": {"slider": {"mass": 1, "inertia": 1}},
                "joints": {"guide": {"type": "translational", "slider": "slider"}},
                "drives": {
                    "motor": {
                        "type": "angle",
                        "bodies": ["slider", "ground"],
                        "law": {"type": "linear", "rate": 1},
                    }
                },
            }
        )
        with pytest.raises(Refused, match="drives.motor"):
            engine.simulate(scene)


def pile(blocks):
    """Blocks of which each slides in a guide of its own, all in the same place."""
    one = {"mass": 2, "inertia": 0.1, "velocity": [1, 0]}
    guide = {"type": "translational", "direction": [1, 0], "length": 0.6, "width": 0.2, "mu": 0.2}
    return scene_from_dict(
        {
            "gravity": [0, -G],
            "bodies": {f"b{i}": one for i in range(blocks)},
            "joints": {
                f"guide-{i}": {**guide, "slider": f"b{i}", "width": 0.2 + 0.01 * (i % 5)}
                for i in range(blocks)
            },
        }
    )


@pytest.mark.parametrize(
    ("name", "blocks"),
    [
        ("pymunk", 32),
        ("pybullet", 31),
        ("mujoco", 33),
        ("dart", 33),
        ("exudyn", 33),
        ("moreau", 33),
    ],
)
def test_as_many_guides_as_an_engine_can_keep_apart(name, blocks):
    """Each block slides in its own, as if it were alone with those that are as wide."""
    solver = installed(name)
    many, few = (
        solver.simulate(pile(count), t_end=0.02, dt=1e-3, fidelity="contact")
        for count in (blocks, 5)
    )
    for i in range(blocks):
        np.testing.assert_allclose(many[f"b{i}.x"], few[f"b{i % 5}.x"], rtol=0, atol=1e-6)
    assert (
        many[f"b{blocks - 1}.vx"][-1] < 1 - 0.1 * G * 0.02
    )  # it is braked, by mu g = 0.2 g once it has landed


@pytest.mark.parametrize(("name", "most"), [("pymunk", 32), ("pybullet", 31)])
def test_more_guides_than_the_filters_have_bits_for_are_refused(name, most):
    with pytest.raises(
        Refused,
        match=rf"{most + 1} guides; (pymunk|PyBullet)'s collision filters, which keep them apart, have room for {most}",
    ):
        installed(name).simulate(pile(most + 1), fidelity="contact")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"speed": 3}, "speed: .* has no such setting at joint fidelity; expected one of .*passes"),
        ({"passes": 0}, "passes: found 0; expected a whole number >= 1"),
        ({"passes": 2.5}, "passes: found 2.5"),
        ({"rtol": 1e-6}, "rtol: found 1e-06; .* has a fixed step, expected dt"),
        ({"dt": -1.0}, "dt: found -1.0; expected seconds, > 0"),
        ({"t_end": float("nan")}, "t_end: found nan"),
        ({"output_step": 0.0}, "output_step: found 0.0"),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(load_scene("slider-bar-case-1-mus-equals-mu"), **{"t_end": 0.1, **settings})
