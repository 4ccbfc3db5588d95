"""Truths whose uncertainty is that of an enclosure."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from flint import arb

from stiction.comparisons.measures import scene_truth
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.proving import prove_scene
from stiction.comparisons.proof.truth import Contradiction, with_proof
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, PROVEN, slider_bar_truth
from stiction.scenes import load_scene, vary


@pytest.fixture(scope="module")
def scene():
    return load_scene("slider-bar-case-1", {"t_end": 6})


@pytest.fixture(scope="module")
def truth(scene):
    return ground_truth(scene)


def test_enclosures_of_thirty_digits_are_within_the_uncertainty(scene, truth):
    assert truth.tier == PROVEN
    motion = prove_scene(scene, 30)
    with working(motion.precision.bits, motion.precision.order + 1):
        for proven, event in zip(motion.events, truth.events, strict=True):
            assert abs(proven.time - event.time) <= truth.uncertainty["event time"]
        for t in np.linspace(0.0, 6.0, 97):
            told = truth(t)
            for name, ball in zip(("slider.x", "slider.vx"), (x for part in motion.at(arb(float(t))) for x in part)):
                assert abs(ball - float(told[name][0])) <= truth.uncertainty[name] < 1e-12


def test_the_bar_moves_along(scene, truth):
    before, t = slider_bar_truth(scene), np.linspace(0.1, 5.9, 40)
    shift = truth(t)["slider.x"] - before(t)["slider.x"]
    np.testing.assert_allclose(truth(t)["bar.x"] - before(t)["bar.x"], shift, rtol=0, atol=1e-15)
    assert truth.uncertainty["bar.x"] >= truth.uncertainty["slider.x"] / 2
    assert truth.uncertainty["motor.effort"] == before.uncertainty["motor.effort"]


def test_other_events_are_a_contradiction(scene):
    before = slider_bar_truth(scene)
    with pytest.raises(Contradiction, match="proven are slip"):
        with_proof(scene, replace(before, events=before.events[1:]))


def test_what_cannot_be_proven_stays_as_it_is(scene, monkeypatch):
    pendulum = load_scene("pendulum", {"t_end": 1})
    assert ground_truth(pendulum).tier == CLOSED_FORM  # its columns are functions of an angle that a truth does not have
    before = slider_bar_truth(scene)
    assert with_proof(scene, replace(before, t_end=1e5)).tier == HIGH_PRECISION
    monkeypatch.setattr(scene_truth, "find_spec", lambda name: None)
    assert ground_truth(scene).tier == HIGH_PRECISION


def test_an_undecided_proof_is_noted():
    """The load touches the limit of static friction and no more."""
    found = ground_truth(vary(load_scene("coulomb-oscillator"), {"b": 1, "load.phase": 0, "t_end": 4}))
    assert found.tier != PROVEN
    assert "no proof: undecided at t = [2.2" in found.note
