"""Truths whose uncertainty is that of an enclosure."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from flint import arb

from stiction.comparisons.campaigns.measurement import _errors
from stiction.comparisons.measures import scene_truth
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.proving import prove_scene
from stiction.comparisons.proof.theorems import Contradiction
from stiction.comparisons.proof.truth import with_proof
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, PROVEN, slider_bar_truth
from stiction.comparisons.variants import Record, Variant
from stiction.engines import Outcome
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, vary


@pytest.fixture(scope="module")
def scene():
    return load_scene("slider-bar-case-1", {"t_end": 6})


@pytest.fixture(scope="module")
def truth(scene):
    return ground_truth(scene)


def test_enclosures_of_thirty_digits_are_within_the_uncertainty(scene, truth):
    assert truth.tier == PROVEN and truth.effort_tier == HIGH_PRECISION  # no proof encloses the motor's torque
    motion = prove_scene(scene, 30)
    with working(motion.precision.bits, motion.precision.order + 1):
        for proven, event in zip(motion.events, truth.events, strict=True):
            assert abs(proven.time - event.time) <= truth.uncertainty["event time"]
        for t in np.linspace(0.0, 6.0, 97):
            told = truth(t)
            for name, ball in zip(("slider.x", "slider.vx"), (x for part in motion.at(arb(float(t))) for x in part)):
                assert abs(ball - float(told[name][0])) <= truth.uncertainty[name] < 1e-12


@pytest.mark.parametrize("name, t_end", [
    ("block-on-incline", 2), ("mass-on-belt", 3), ("coulomb-oscillator", 4), ("pendulum", 1), ("slider-bar-case-3", 1), ("elliptic-trammel", 0.125),
    ("slider-on-moving-guide", 0.5)])
def test_all_positions_and_velocities_are_within_their_bounds(name, t_end):
    """Of every mechanism: columns in floats against balls of 25 digits at instants between those of steps."""
    scene = load_scene(name, {"t_end": t_end})
    truth, motion = ground_truth(scene), prove_scene(scene, 25)
    assert truth.tier == PROVEN
    moving = {name for name, doubt in truth.uncertainty.items() if name.rpartition(".")[2] in ("x", "y", "vx", "vy") and doubt > 0}
    with working(motion.precision.bits, motion.precision.order + 1):
        for t in np.linspace(0.0, t_end, 23):
            told, instant = truth(t), arb(float(t))
            balls = motion.mechanism.bodies(instant, *motion.at(instant))
            assert moving <= set(balls)
            for column in truth.uncertainty.keys() & balls.keys():
                assert abs(balls[column] - float(told[column][0])) <= truth.uncertainty[column] < 1e-12, column


def test_each_number_of_a_run_says_its_own_tier(truth):
    """A proof encloses positions, velocities and events: errors and jumps of the torque are measured against what it leaves as it was."""
    run = ReferenceEngine().simulate(load_scene("slider-bar-case-1"), t_end=6.0, rtol=1e-9)
    tiers = {metric.name: metric.tier for metric in _errors(errors(run, truth, 1.0), truth)}
    assert tiers.pop(TORQUE_ERROR) == HIGH_PRECISION and len(tiers) > 3 and set(tiers.values()) == {PROVEN}
    record = Record("key", "slider-bar-case-1", Variant("reference", "reference", "rtol", (1e-9,)), 1e-9, Outcome("key", "ok", run))
    jumps = torque_table([record], {"key": truth})
    assert len(jumps) and set(jumps["truth tier"]) == {HIGH_PRECISION}


def test_events_of_a_fast_motion():
    """At 1000 rad/s a corner changes its surface 1.5e-8 s after the start, others 5e-7 s after a reversal; where both corners do, 1e-14 s apart, it is one event."""
    truth = ground_truth(load_scene("hard/fast-drive"))
    assert truth.tier == PROVEN
    assert [event.kind for event in truth.events] == [*(["corner"] * 3 + ["reversal"]) * 3, "corner"]
    assert truth.events[0].time == pytest.approx(1.4715e-8, rel=1e-9) and 0 < truth.events[8].time - truth.events[7].time < 1e-6


def test_columns_that_are_not_those_of_the_mechanism_are_a_contradiction(scene, fresh_truths, monkeypatch):
    right = SlidingMass.bodies
    monkeypatch.setattr(SlidingMass, "bodies", lambda self, t, q, v: (found := right(self, t, q, v)) | {"bar.y": found["bar.y"] * (1 + 1e-9)})
    with pytest.raises(Contradiction, match="bar.y"):
        ground_truth(scene)


def test_efforts_keep_their_estimate(scene, truth):
    assert truth.uncertainty["motor.effort"] == slider_bar_truth(scene).uncertainty["motor.effort"]


def test_other_events_are_a_contradiction(scene):
    before = slider_bar_truth(scene)
    with pytest.raises(Contradiction, match="proven are slip"):
        with_proof(scene, replace(before, events=before.events[1:]))


def test_what_cannot_be_proven_stays_as_it_is(scene, fresh_truths, monkeypatch):
    crank = load_scene("slider-crank", {"t_end": 0.1})
    assert ground_truth(crank).tier == CLOSED_FORM
    before = slider_bar_truth(scene)
    long = with_proof(scene, replace(before, t_end=1e5))
    assert long.tier == HIGH_PRECISION and "beyond 250 s" in long.note
    monkeypatch.setattr(scene_truth, "find_spec", lambda name: None)
    assert ground_truth(scene).tier == HIGH_PRECISION


def test_an_undecided_proof_is_noted():
    """The load touches the limit of static friction and no more."""
    found = ground_truth(vary(load_scene("coulomb-oscillator"), {"b": 1, "load.phase": 0, "t_end": 4}))
    assert found.tier != PROVEN
    assert "no proof: undecided at t = [2.2" in found.note
