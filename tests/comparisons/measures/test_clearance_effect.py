"""Effects of clearance: how they vanish with it, impacts of the event-driven truth, perturbed starts, flights."""

import numpy as np
import pytest

from stiction.comparisons.bench.participants import variant
from stiction.comparisons.measures.clearance_effect import (
    NUDGE,
    GapRun,
    _effort_columns,
    clearance_effect,
    nudged,
    with_gaps,
)
from stiction.comparisons.measures.corner_gaps import corner_gaps, impacts_in
from stiction.comparisons.measures.measured_flights import measured_flights
from stiction.engines.protocol import EngineFailure
from stiction.reference_impl.multibody.initial_state import consistent_starts
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import InputError, load_scene
from stiction.truths.clearance.impacting_motion import impacting_motion
from stiction.truths.clearance.mechanisms import slider_crank_with_clearance

MOREAU = variant("Moreau, contact")
CASE_1 = load_scene("slider-bar-case-1")
T_END = 2.0
"""End of runs of case 1, s: the first corner is released at 1.36 s, and its flight lasts 0.14 s at 1 mm."""


def effect(clearance, restitution=0.0, step=1e-4, scene=CASE_1):
    return clearance_effect(GapRun(scene, clearance, restitution, MOREAU, step, T_END))


@pytest.fixture(scope="module")
def effects():
    """The effects of case 1 at 1 mm and 0.1 mm."""
    return {clearance: effect(clearance) for clearance in (1e-3, 1e-4)}


def test_effects_vanish_with_the_laws_exponents(effects):
    """The torque differs by the impulses of impacts, proportional to c^(2/3); the position by c itself."""
    large, small = effects[1e-3], effects[1e-4]
    # the mean effort contains the error of the steps, some 10 % at 0.1 mm
    for name, exponent, tolerance in (
        ("effort_share", 2 / 3, 0.17),
        ("impact_speed", 2 / 3, 0.02),
        ("slider_change", 1, 0.05),
    ):
        found = np.log10(large[name] / small[name])
        assert found == pytest.approx(exponent, abs=tolerance), name


def test_the_effort_of_a_single_step_measures_the_step(effects):
    """An impact is an impulse: with half the step its effort doubles, and its mean over 1 ms does not."""
    fine = effect(1e-3, step=5e-5)
    assert fine["effort_peak"] / effects[1e-3]["effort_peak"] == pytest.approx(2, rel=0.1)
    assert fine["effort_peak_mean"] / effects[1e-3]["effort_peak_mean"] == pytest.approx(1, rel=0.1)


def test_an_effort_is_not_compared_with_an_ideal_effort_of_zero():
    effort = np.array([0.0, 1.0, 0.0])
    assert _effort_columns(effort, np.zeros(3), 1.0) == {}
    assert _effort_columns(effort, np.ones(3), 1.0)["effort_share"] == pytest.approx(2 / 3)


def test_restitution_adds_impacts(effects):
    """A corner that rebounds with e v hits again: the impulse is (1 + e) times as large at the first impact alone."""
    rebounding = effect(1e-4, restitution=0.4)
    assert rebounding["impact_count"] > effects[1e-4]["impact_count"]
    assert 1.2 < rebounding["effort_share"] / effects[1e-4]["effort_share"] < 2.0


@pytest.mark.parametrize("restitution", [0.0, 0.4])
def test_impacts_are_those_of_the_event_driven_truth(restitution):
    """The slider-crank until 0.03 s: the same corners hit, at the same times and speeds.

    Moreau's method sees each impact up to a step late, which changes the following flights.
    """
    step, t_end = 2e-6, 0.03
    scene = with_gaps(load_scene("slider-crank-clearance"), 1e-3, restitution)
    run = GapRun(scene, 1e-3, restitution, MOREAU, step, t_end).simulate()
    found = impacts_in(run.t, corner_gaps(scene, run, "guide"), 1e-3)
    mechanism, q, v = slider_crank_with_clearance(scene)
    truth = impacting_motion(mechanism, q, v, t_end, 2e-4)
    gaps = np.array([mechanism.gaps(truth.state(t)[0]) for t in run.t[::10]]).T
    expected = impacts_in(run.t[::10], gaps, 1e-3)
    assert len(found) == len(expected) == (8 if restitution else 4)
    # corners that hit together may be listed in any order
    order = sorted(found, key=lambda impact: (round(impact.time, 5), impact.corner))
    true = sorted(expected, key=lambda impact: (round(impact.time, 5), impact.corner))
    assert [impact.corner for impact in order] == [impact.corner for impact in true]
    for one, other in zip(order, true):
        assert one.time == pytest.approx(other.time, abs=10 * step)
        assert one.speed == pytest.approx(other.speed, rel=0.01, abs=1e-3)


@pytest.mark.parametrize("name", ["slider-bar-case-1", "slider-crank-clearance"])
def test_perturbed_starts_differ_and_satisfy_the_constraints(name):
    scene = with_gaps(load_scene(name), 1e-3)
    assert nudged(scene, 0) is scene
    starts = [consistent_starts([Mechanism(nudged(scene, number))])[0] for number in (0, 1, 2)]
    fastest = np.abs(starts[0][1]).max()
    for one, other in ((0, 1), (0, 2), (1, 2)):
        change = np.abs(starts[one][1] - starts[other][1]).max()
        assert 1e-2 * NUDGE * fastest < change < 10 * NUDGE * fastest


def test_flights_are_compared_event_by_event():
    flights, efforts = measured_flights(GapRun(CASE_1, 1e-4, 0.0, MOREAU, 5e-5, T_END))
    (flight,) = [row for row in flights if abs(row["event_time"] - 1.3625) < 1e-3]
    assert flight["flight_time_ratio"] == pytest.approx(1, abs=0.015)
    assert flight["impact_speed_ratio"] == pytest.approx(1, abs=0.015)
    # before the release the effort is that of ideal joints; in flight it differs by N' t, and the impact restores it
    before = [row for row in efforts if row["time_after_release"] < 0]
    for row in before:
        assert row["effort_value"] == pytest.approx(row["ideal_effort"], rel=2e-3)
    excess = np.array([row["effort_value"] - row["ideal_effort"] for row in efforts])
    assert abs(excess.sum()) < 0.1 * np.abs(excess).sum()


def test_a_flight_that_the_run_does_not_finish_has_a_reason():
    run = GapRun(CASE_1, 1e-3, 0.0, MOREAU, 1e-4, 1.4)
    flights, _ = measured_flights(run)
    assert [row["why_none"] for row in flights] == ["the run ends during the flight"]


def test_runs_that_cannot_be_compared():
    with pytest.raises(InputError, match="found no guide with length and width"):
        with_gaps(load_scene("pendulum"), 1e-3)
    stopped = GapRun(load_scene("existence-lost"), 1e-3, 0.0, MOREAU, 1e-4, 1.0)
    with pytest.raises((EngineFailure, InputError)):
        stopped.ideal_run()
