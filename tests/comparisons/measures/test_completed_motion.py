"""Tables of a few coordinates: what constraints determine beside them, and what they do not."""

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.judge.judgement import FOUND, INVENTED, MISSED, judge
from stiction.comparisons.judge.judgement_presentation import presentation
from stiction.comparisons.measures.completed_motion import Completion
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.scenes import load_scene

pytestmark = pytest.mark.usefixtures("compiled")
ENERGY = [f"completed_energy_{what}" for what in ("error", "uncertainty", "exchanged")]


def table_of(name, columns, rows=2001, **overrides):
    truth = ground_truth(load_scene(name, overrides))
    t = np.linspace(0, truth.t_end, rows)
    known = truth(t)
    return pd.DataFrame({"t": t, **{column: known[column] for column in columns}})


@pytest.mark.parametrize(
    ("name", "columns", "phases"),
    [
        ("coulomb-oscillator", ["slider.x"], 1),
        ("coulomb-oscillator", ["slider.x", "slider.vx"], 1),
        ("mass-on-belt", ["slider.x"], 7),
        ("slider-bar-case-1", ["slider.x"], 4),
        ("slider-bar-case-1", ["bar.x", "slider.vx"], 4),
        ("slider-bar-case-1", ["guide.displacement"], 4),
        ("block-on-incline", ["slider.x"], 0),
        ("slider-crank", ["slider.x"], 0),
    ],
)
def test_one_coordinate_shows_stick_phases_and_energy(name, columns, phases):
    judged = judge(name, table_of(name, columns))
    verdicts = list(judged.tables["stick-phases"]["verdict"])
    assert verdicts.count(FOUND) == phases and not {MISSED, INVENTED} & {*verdicts}
    error, unsure, exchanged = judged.tables["summary"].loc[0, ENERGY]
    assert error <= unsure < 0.01 * exchanged
    assert "position_drift" not in judged.tables["summary"]  # zero by construction


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("coulomb-oscillator", "slider.x"),
        ("slider-bar-case-1", "slider.x"),
        ("mass-on-belt", "slider.x"),
    ],
)
def test_energy_of_a_motion_with_another_friction_is_off(name, column):
    mu = load_scene(name).frictional_guides["guide"].kinetic_coefficient
    judged = judge(name, table_of(name, [column], **{"guide.mu": 0.8 * mu}))
    error, unsure, _ = judged.tables["summary"].loc[0, ENERGY]
    assert error > 3 * unsure


def test_creep_of_one_coordinate_is_no_stick():
    frame = table_of("coulomb-oscillator", ["slider.x"])
    creeping = frame.assign(**{"slider.x": frame["slider.x"] + 0.02 * frame["t"]})
    assert MISSED in set(judge("coulomb-oscillator", creeping).tables["stick-phases"]["verdict"])


def test_completed_states_are_the_truth():
    scene = load_scene("slider-bar-case-1")
    truth = ground_truth(scene)
    frame = table_of("slider-bar-case-1", ["slider.x", "slider.vx"])
    t, columns = frame["t"].to_numpy(), {name: frame[name].to_numpy() for name in frame}
    completion = Completion.of(scene, columns, truth)
    q = completion.positions(t, columns)
    v = completion.velocities(t, q, columns)
    known = truth(t)
    for place, (position, velocity) in enumerate(
        zip(completion.names(("x", "y", "angle")), completion.names(("vx", "vy", "omega")))
    ):
        assert np.max(np.abs(q[:, place] - known[position])) < 1e-11
        assert np.max(np.abs(v[:, place] - known[velocity])) < 1e-11


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("slider-bar-case-1", "bar.angle"),  # driven: the slider moves freely along it
        ("slider-on-moving-guide", "arm.angle"),  # two freedoms
        ("elliptic-trammel", "bar.x"),
    ],
)  # through a dead centre
def test_what_a_coordinate_does_not_determine_is_not_judged(name, column):
    judged = judge(name, table_of(name, [column]))
    assert judged.tables["stick-phases"].empty and not {*ENERGY} & {*judged.tables["summary"]}
    lacks = presentation(judged).rows["not_judged"]
    assert lacks["stick_phases"] and lacks["energy"]
