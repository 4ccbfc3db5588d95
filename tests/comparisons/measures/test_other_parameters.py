"""Tables made with another friction or another g are named; other faults, noise and what two parameters explain are not."""

import math

import numpy as np
import pandas as pd
import pytest
from made_up_runs import wrongly_written

import stiction
from stiction.comparisons.bench.results import Results
from stiction.comparisons.judge.judgement import judge
from stiction.comparisons.judge.judgement_presentation import presentation
from stiction.comparisons.measures.other_parameters import (
    Hypothesis,
    Parameter,
    changed,
    explanations,
)
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.reports.judgement_page import judgement_section
from stiction.scenes import load_scene
from stiction.scenes.result_table import result_table

CASE = "slider-bar-case-1"
pytestmark = pytest.mark.usefixtures("compiled")


def run_of(scene, endings=(".x", ".y", ".angle"), noise=0.0, rows=1001):
    """Positions of the reference, with independent scatter."""
    run = (
        stiction.load_engine("reference")
        .simulate(scene, rtol=1e-9, output_step=scene.t_end / (rows - 1))
        .to_frame()
    )
    frame = run[["t", *(name for name in run if name.endswith(endings))]].copy()
    scatter = np.random.default_rng(5)
    for name in frame.columns[1:]:
        frame[name] += noise * scatter.standard_normal(len(frame))
    return frame


def found_of(scene, frame):
    found = explanations(scene, result_table(frame, scene), ground_truth(scene))
    return found, [one for one in found if one.is_named]


@pytest.mark.parametrize("noise", [0.0, 3e-6])
@pytest.mark.parametrize(
    ("hypothesis", "factor"),
    [
        (Hypothesis.ONE_COEFFICIENT, math.nan),
        (Hypothesis.KINETIC, 1.02),
        (Hypothesis.KINETIC, 0.8),
        (Hypothesis.FRICTION, 1.05),
        (Hypothesis.GRAVITY, 0.95),
    ],
)
def test_another_parameter_is_named_with_its_number(hypothesis, factor, noise):
    scene = load_scene(CASE)
    table = run_of(changed(scene, Parameter(hypothesis), factor), noise=noise)
    found, named = found_of(scene, table)
    assert [one.hypothesis for one in named] == [hypothesis] and named[0].after < 0.02 * named[
        0
    ].before
    if hypothesis is not Hypothesis.ONE_COEFFICIENT:
        assert named[0].factor - 1 == pytest.approx(factor - 1, rel=0.02)


@pytest.mark.parametrize(
    ("hypothesis", "factor"),
    [
        (Hypothesis.NO_BOUND, math.nan),
        (Hypothesis.BOUND, 0.9),
        (Hypothesis.BOUND, 1.1),
        (Hypothesis.ONE_BOUND, math.nan),
    ],
)
def test_constant_bounds(hypothesis, factor):
    """Friction of joints that is ignored, 10 % off, or without the bound at rest: named, with its number."""
    scene = load_scene("pendulum-dry-pin", {"static_friction": 2.0})
    table = run_of(changed(scene, Parameter(hypothesis), factor))
    _, [named] = found_of(scene, table)
    assert named.hypothesis is hypothesis and named.after < 0.02 * named.before
    if hypothesis is Hypothesis.BOUND:
        assert named.factor == pytest.approx(factor, rel=1e-3)
        assert named.value == pytest.approx(factor * 0.3, rel=1e-3)
    section = judgement_section(judge(scene, table))
    assert any("friction" in finding for finding in section.findings)


def test_a_usual_g_is_told_from_a_near_one():
    """9.8 and 9.81 m/s² differ by a thousandth."""
    scene = load_scene(CASE)
    _, [named] = found_of(scene, run_of(changed(scene, Parameter(Hypothesis.GRAVITY), 9.8 / 9.81)))
    assert named.hypothesis is Hypothesis.GRAVITY and named.value == pytest.approx(9.8, rel=1e-12)


def test_one_coordinate_and_velocities_are_enough():
    scene = load_scene(CASE)
    for ending in ("slider.x", "slider.vx"):
        _, [named] = found_of(
            scene, run_of(changed(scene, Parameter(Hypothesis.KINETIC), 1.1), (ending,))
        )
        assert named.hypothesis is Hypothesis.KINETIC and named.factor == pytest.approx(
            1.1, rel=1e-4
        )


def test_right_tables_are_not_explained():
    scene = load_scene(CASE)
    for noise in (0.0, 1e-3):
        assert found_of(scene, run_of(scene, noise=noise))[0] == []


@pytest.mark.parametrize(
    ("kind", "element"),
    [(Hypothesis.STIFFNESS, "spring"), (Hypothesis.LOAD, "load"), (Hypothesis.MASS, "slider")],
)
def test_other_faults_are_not_named(kind, element):
    scene = load_scene(CASE)
    element = (
        element
        if element in {**scene.springs, **scene.forces, **scene.bodies}
        else next(iter(scene.springs if kind is Hypothesis.STIFFNESS else scene.forces))
    )
    found, named = found_of(scene, run_of(changed(scene, Parameter(kind, element), 1.05)))
    assert found and not named


def test_a_drifting_table_is_not_named():
    scene = load_scene(CASE)
    frame = run_of(scene)
    frame["slider.x"] += 1e-3 * frame["t"]
    found, named = found_of(scene, frame)
    assert found and not named


@pytest.mark.parametrize("name", ["block-on-incline", "coulomb-oscillator"])
def test_what_two_parameters_explain_is_not_named(name):
    """A block slides with g (sin - mu cos), a mass on a level guide with mu g: neither number can be told alone."""
    scene = load_scene(name)
    found, named = found_of(scene, run_of(changed(scene, Parameter(Hypothesis.FRICTION), 1.03)))
    assert not named and {one.hypothesis for one in found if one.after < 0.01 * one.before} >= {
        Hypothesis.FRICTION,
        Hypothesis.GRAVITY,
    }


def test_only_what_a_scene_has_is_tried():
    pendulum = load_scene("pendulum")
    found, [named] = found_of(
        pendulum, run_of(changed(pendulum, Parameter(Hypothesis.GRAVITY), 9.8 / 9.81))
    )
    assert named.value == pytest.approx(9.8) and {one.hypothesis for one in found} == {
        Hypothesis.GRAVITY
    }
    weightless = pendulum.model_copy(update={"gravity": None})
    assert found_of(weightless, run_of(pendulum))[0] == []
    alike = load_scene("slider-bar-case-1-mus-equals-mu")
    found, _ = found_of(alike, run_of(changed(alike, Parameter(Hypothesis.FRICTION), 1.1)))
    assert {one.hypothesis for one in found} == {Hypothesis.FRICTION, Hypothesis.GRAVITY} | {
        one.hypothesis for one in found if one.parameter.element
    }


def test_the_judgement_asks():
    scene = load_scene(CASE)
    judged = judge(scene, run_of(changed(scene, Parameter(Hypothesis.ONE_COEFFICIENT), 1.0)))
    table = judged.tables["other-parameters"]
    assert list(table.loc[table["named"], "hypothesis"]) == ["mus = mu"]
    [named] = presentation(judged).rows["other_parameters"]
    assert named["cause"] == "one_coefficient" and named["run"]["hypothesis"] == "mus = mu"
    section = judgement_section(judged)
    assert any("mus = mu" in finding for finding in section.findings)
    assert not wrongly_written(section, Results((), {}, judged.tables))
    millimetres = pd.DataFrame(run_of(scene)).assign(
        **{"slider.x": lambda frame: 1e3 * frame["slider.x"]}
    )
    assert judge(scene, millimetres).tables["other-parameters"].empty
