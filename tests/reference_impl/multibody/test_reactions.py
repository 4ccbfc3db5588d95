"""Reactions from a motion: those that made it, whatever of them is told, and nothing of one instant in another."""

import numpy as np
import pytest

from stiction.engines import load_engine
from stiction.reference_impl.multibody import reactions
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import load_scene

STATE = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))


def motion(name, t_end):
    scene = load_scene(name)
    run = load_engine("reference").simulate(scene, rtol=1e-10, t_end=t_end, output_step=0.05, stabilization="projection")
    return scene, run, [np.column_stack([run[f"{body}.{name}"] for body in scene.bodies for name in names]) for names in STATE]


@pytest.mark.parametrize("name", ["slider-bar-case-1", "four-bar", "elliptic-trammel"])
def test_the_forces_of_a_run_are_recovered_from_its_motion(compiled, name):
    scene, run, state = motion(name, 3.0)
    told = {f"{guide}.friction": run[f"{guide}.friction"] for guide in scene.frictional_guides} if name == "elliptic-trammel" else {}
    found = recover_columns(scene, run.t, *state, told)  # in the trammel the motion does not tell frictions from reactions
    forces = [column for column in found if column in run and column.rpartition(".")[2] in ("fx", "fy", "normal_force", "moment", "friction", "effort")]
    assert len(forces) >= 4
    for column in forces:  # accelerations of 1 m/s^2 in rounding, masses of kilograms
        np.testing.assert_allclose(found[column], run[column], atol=1e-9)


def test_what_is_told_of_some_instants_is_kept_there_and_each_instant_stands_alone(compiled, monkeypatch):
    scene, run, state = motion("elliptic-trammel", 1.0)
    guides = list(scene.frictional_guides)
    told = {f"{guide}.friction": np.where(np.arange(len(run.t)) % (place + 2) == 0, 1.0 + place, np.nan) for place, guide in enumerate(guides)}
    found = recover_columns(scene, run.t, *state, told)
    for column, values in told.items():
        known = ~np.isnan(values)
        assert 0 < known.sum() < len(known) and np.array_equal(found[column][known], values[known])
    monkeypatch.setattr(reactions, "_ROOM", 1)  # one instant at a time
    alone = recover_columns(scene, run.t, *state, told)
    for column, values in found.items():
        np.testing.assert_allclose(alone[column], values, atol=1e-12)
