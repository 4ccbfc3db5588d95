"""Siconos: closed forms, the suite's own Moreau stepping to the tolerance of the solver, and refusals."""

from functools import partial

import numpy as np
import pytest
from conftest import installed
from reference_checks import LAWS

from stiction.comparisons.judge.conformance import conformance
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import EngineFailure, Refused, load_engine
from stiction.engines.siconos import engine as adapter
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.scenes.laws import evaluate_law

installed("siconos")  # the module is skipped without it
G = 9.81


@pytest.fixture(scope="module")
def engine():
    return partial(load_engine("siconos").simulate, fidelity="contact")


def block(angle, **guide):
    """A block on an incline that weighs on the lower surface."""
    return scene_from_dict(
        {
            "gravity": [0, -G],
            "bodies": {"slider": {"mass": 2, "inertia": 0.1, "angle": angle}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [np.cos(angle), np.sin(angle)],
                    "angle": angle,
                    "length": 0.6,
                    "width": 0.2,
                    **guide,
                }
            },
        }
    )


def test_a_free_body_flies_exactly(engine):
    """Between forces that do not change, a step with theta = 1/2 is the parabola itself."""
    scene = scene_from_dict(
        {
            "gravity": [0.5, -G],
            "bodies": {
                "stone": {"mass": 3, "inertia": 0.2, "velocity": [3, 4], "angular_velocity": 5}
            },
        }
    )
    run = engine(scene, t_end=1, dt=1e-2)
    for column, exact in (
        ("x", 3 * run.t + 0.25 * run.t**2),
        ("y", 4 * run.t - G / 2 * run.t**2),
        ("angle", 5 * run.t),
    ):
        np.testing.assert_allclose(
            run[f"stone.{column}"], exact, rtol=1e-11, atol=1e-12
        )  # rounding of a hundred steps


def test_a_pendulum_swings_to_second_order(engine):
    """Its exact motion has elliptic functions; errors of the midpoint rule are a quarter with half the step."""
    scene, errors = load_scene("pendulum"), []
    truth = ground_truth(scene)
    for dt in (4e-3, 2e-3):
        run = engine(scene, t_end=1, dt=dt, output_step=0.02)
        errors.append(np.max(np.abs(run["mass.x"] - truth(run.t)["mass.x"])))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("angle", [0.3, 0.3 + np.pi])
def test_a_block_slides_as_its_friction_lets_it(engine, angle):
    """x'' = -(sin - mu cos) g along the incline; until the block has landed in its clearance, up to two steps, nothing brakes it."""
    mu, dt, sign = 0.2, 1e-3, np.sign(np.sin(angle))
    pull, brake = G * np.sin(angle), mu * G * abs(np.cos(angle))
    run = engine(block(angle, mu=mu), t_end=0.5, dt=dt)
    along = run["guide.displacement"]
    exact = -(pull - sign * brake) * run.t**2 / 2
    assert np.all(np.abs(along - exact) <= 3 * dt * brake * run.t + 1e-12)
    np.testing.assert_allclose(
        run["guide.friction"][run.t > 0.01], sign * mu * 2 * G * abs(np.cos(angle)), rtol=1e-6
    )


@pytest.mark.parametrize(("mus", "moves"), [(0.35, False), (0.25, True)])
def test_static_friction_holds_up_to_its_own_coefficient(engine, mus, moves):
    """tan 0.3 = 0.309."""
    run = engine(block(0.3, mu=0.1, mus=mus), t_end=0.3, dt=1e-3)
    assert (abs(run["guide.slip_velocity"][-1]) > 0.1) == moves and run["guide.mode"][-1] == (
        -1 if moves else 0
    )


def test_every_law_as_a_torque(engine):
    """The mean angular acceleration of a step is the torque in its middle."""
    scene = scene_from_dict(
        {
            "t_end": 1,
            "bodies": {
                f"b{i}": {"mass": 1, "inertia": 0.5, "position": [i, 0]} for i in range(len(LAWS))
            },
            "forces": {
                f"f{i}": {"type": "torque", "body": f"b{i}", "law": law}
                for i, law in enumerate(LAWS)
            },
        }
    )
    h = 0.01
    run = engine(scene, dt=h, output_step=h)
    for i, load in enumerate(scene.forces.values()):
        np.testing.assert_allclose(
            run[f"b{i}.alpha"],
            [2 * evaluate_law(load.law, t + h / 2)[0] for t in run.t],
            rtol=1e-8,
            atol=1e-9,
        )


@pytest.mark.parametrize(
    ("name", "settings", "changes"),
    [
        ("slider-bar-case-1-mus-equals-mu", {}, {}),
        (
            "slider-bar-case-3-mus-equals-mu",
            {},
            # the gap that the setting clearance gives this scene: 1e-6 of its size, 2.25 m
            {"guide.clearance": 2.25e-6, "guide.restitution": 0.5},
        ),
        ("slider-bar-case-1-mus-equals-mu", {}, {"guide.clearance": 1e-3}),
        ("elliptic-trammel", {}, {}),
        ("slider-crank", {}, {}),
        ("four-bar", {}, {}),
        ("slider-on-moving-guide", {}, {}),
        ("coulomb-oscillator", {"clearance": 1e-4}, {}),
        ("painleve-rod", {}, {}),
    ],
)
def test_it_makes_the_steps_of_our_own_stepping(engine, name, settings, changes):
    """The same discrete equations, by code that shares nothing: Lemke's method on an LCP there, Gauss-Seidel on blocks here.

    What differs is the residual of a step, 1e-12 of the speed, and what a second of motion makes of it.
    """
    scene, dt = vary(load_scene(name), changes), 1e-3
    if any(guide.static_coefficient != guide.mu for guide in scene.frictional_guides.values()):
        scene = vary(
            scene,
            {f"joints.{guide}.mus": scene.guides[guide].mu for guide in scene.frictional_guides},
        )
    runs = [
        simulate(scene, t_end=min(1.0, scene.t_end), dt=dt, output_step=dt, **settings)
        for simulate in (engine, partial(load_engine("moreau").simulate, fidelity="contact"))
    ]
    for body in scene.bodies:
        for column in ("x", "y", "angle", "vx", "vy", "omega"):
            mine, ours = (run[f"{body}.{column}"] for run in runs)
            np.testing.assert_allclose(
                mine,
                ours,
                rtol=0,
                atol=1e-8 * max(1.0, np.max(np.abs(ours))),
                err_msg=f"{body}.{column}",
            )


def test_it_conforms(engine, in_this_process):
    assert [trial.verdict for trial in conformance(str(adapter.DECLARATION), 120)] == ["right"] * 5


def test_engine_time_is_that_of_the_kernel_s_calls(engine):
    """The matrices are the script's: they are in the total time alone."""
    cost = engine(load_scene("pendulum"), t_end=0.5, dt=1e-3).cost
    assert 0 < cost.engine_s < cost.stepping_s


def test_a_start_off_its_constraints_is_refused(engine):
    with pytest.raises(Refused, match="0.05 m or rad off its constraints"):
        engine(load_scene("hard/inconsistent-position"), t_end=0.1, dt=1e-2)


def test_a_step_that_is_not_solved_ends_the_run(engine):
    """One iteration does not solve corners and a motor together; the residual is taken from velocities and impulses, not from a flag."""
    with pytest.raises(EngineFailure, match="does not solve the step at t = .* residual"):
        engine(load_scene("slider-bar-case-1"), t_end=0.1, dt=1e-3, iterations=1)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"theta": 0.4}, "theta: found 0.4; expected 0.5 .. 1"),
        ({"theta": "abc"}, "theta: found 'abc'; expected a number"),
        ({"clearance": 0.0}, "clearance: found 0"),
        ({"block": "newton"}, "block: found 'newton'; expected one of nsgs"),
        ({"iterations": 2.5}, "iterations: found 2.5; expected a whole number"),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine(load_scene("slider-bar-case-1-mus-equals-mu"), t_end=0.1, **settings)
