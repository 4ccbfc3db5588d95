"""Energies by formulas that do not pass through the constraints' derivatives."""

import dataclasses

import numpy as np
import pytest

from stiction import InputError, energies, load_engine, load_scene
from stiction.reference_impl.energies import needed_columns, unaccounted_energy


def test_a_pendulum_keeps_its_energy():
    scene = load_scene("pendulum")
    found = energies(load_engine("reference").simulate(scene, t_end=2.0, rtol=1e-11))
    total = found["kinetic"] + found["potential"]
    assert np.ptp(total) < 1e-9 * np.ptp(found["kinetic"]) and np.ptp(found["kinetic"]) > 0


def test_friction_spring_and_load_of_the_oscillator():
    """m x'^2/2 and k x^2/2 by hand; friction takes mu N |slip|, so that the balance is that of the trapezoidal rule, O(h^2)."""
    scene, left = load_scene("slider-bar-case-1"), []
    for step in (2e-3, 1e-3):
        run = load_engine("reference").simulate(scene, t_end=4.0, rtol=1e-11, output_step=step)
        found = energies(run)
        left.append(np.abs(found["balance"]).max())
        assert (np.diff(found["guide.dissipated"]) >= -1e-12).all() and found[
            "guide.dissipated"
        ].iloc[-1] > 0
        frame = run.to_frame(events=True, interpolated=True)
        kinetic = sum(
            body.mass * (frame[f"{name}.vx"] ** 2 + frame[f"{name}.vy"] ** 2) / 2
            + body.inertia * frame[f"{name}.omega"] ** 2 / 2
            for name, body in scene.bodies.items()
        )
        np.testing.assert_allclose(found["kinetic"], kinetic, atol=1e-12)
    assert left[1] < 0.3 * left[0] < 1e-4


def test_what_is_missing_is_named():
    run = load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=0.1)
    with pytest.raises(InputError, match="mechanism"):
        energies(dataclasses.replace(run, mechanism=None))
    short = dataclasses.replace(
        run, columns={name: run[name] for name in run.columns if name != "motor.effort"}, events=()
    )
    with pytest.raises(InputError, match="motor.effort"):
        energies(short)


@pytest.mark.parametrize(
    "name",
    [
        "slider-bar-case-1",
        "elliptic-trammel",
        "slider-crank",
        "mass-on-belt",
        "slider-on-moving-guide",
    ],
)
def test_motions_of_the_reference_account_for_all_of_it(name):
    run = load_engine("reference").simulate(
        load_scene(name), t_end=4.0, rtol=1e-10, output_step=2e-3
    )
    frame = run.to_frame(events=True, interpolated=True)
    columns = {column: frame[column].to_numpy(float) for column in needed_columns(load_scene(name))}
    left, unsure, exchanged = unaccounted_energy(load_scene(name), frame["t"].to_numpy(), columns)
    assert left <= unsure + 1e-9 * exchanged and unsure < 1e-3 * exchanged and exchanged > 0


def test_weight_of_a_falling_body():
    """A pendulum that is said to fall by 1 m without gaining speed has lost m g of energy."""
    scene, t = load_scene("pendulum"), np.linspace(0, 1, 101)
    [body] = scene.bodies
    columns = {name: np.zeros_like(t) for name in needed_columns(scene)}
    columns |= {f"{body}.x": np.ones_like(t), f"{body}.y": -t, f"{body}.vy": np.full_like(t, -1.0)}
    assert unaccounted_energy(scene, t, columns)[0] == pytest.approx(
        -scene.bodies[body].mass * scene.gravity[1], rel=1e-9
    )
