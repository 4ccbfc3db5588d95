"""The work of weight, springs, motors and friction is the change of kinetic energy in every true motion."""

import numpy as np
import pytest

from stiction.comparisons.measures.energy_balance import energy_balance, needed_columns
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene


@pytest.mark.parametrize("name", ["slider-bar-case-1", "elliptic-trammel", "slider-crank", "mass-on-belt", "slider-on-moving-guide"])
def test_motions_of_the_reference(compiled, name):
    run = ReferenceEngine().simulate(load_scene(name), t_end=4.0, rtol=1e-10, output_step=2e-3)
    frame = run.to_frame(events=True)
    columns = {column: frame[column].to_numpy(float) for column in needed_columns(load_scene(name))}
    found = energy_balance(load_scene(name), frame["t"].to_numpy(), columns)
    assert found.left_over.value <= found.left_over.uncertainty + 1e-9 * found.exchanged
    assert found.exchanged > 0 and found.left_over.uncertainty < 1e-3 * found.exchanged


def test_weight_of_a_falling_body(compiled):
    """A pendulum that is said to fall by 1 m without gaining speed has lost m g of energy."""
    scene = load_scene("pendulum")
    [body] = scene.bodies
    t = np.linspace(0, 1, 101)
    columns = {name: np.zeros_like(t) for name in needed_columns(scene)}
    columns |= {f"{body}.x": np.ones_like(t), f"{body}.y": -t, f"{body}.vy": np.full_like(t, -1.0)}
    weight = -scene.bodies[body].mass * scene.gravity[1]
    assert energy_balance(scene, t, columns).left_over.value == pytest.approx(weight, rel=1e-9)
