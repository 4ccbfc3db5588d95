"""What is measured in a sweep's window, against the reduced solution and closed forms."""

import numpy as np
import pytest

from stiction.comparisons.measures.steady_stretch import steady_stretch
from stiction.comparisons.studies.steady_state_measures import MEASURES, SAMPLE_STEP, Measure, steady_window, window_start
from stiction.engines import EngineFailure
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, vary

CASE_1 = load_scene("slider-bar-case-1")
ALL = tuple(MEASURES.values())


@pytest.fixture(scope="module")
def case_1():
    """The period map contracts by a factor of about 2 per period: 30 periods leave 1e-9."""
    return steady_window(CASE_1, 240.0, 249.0, 1e-9, ALL), steady_stretch(CASE_1)


def test_window_is_whole_periods(case_1):
    window, _ = case_1
    assert (window.start, window.end) == (241.0, 249.0)


def test_stick_fraction_of_case_1(case_1):
    window, truth = case_1
    assert truth.stick_time == pytest.approx(0.5323, abs=5e-5)
    # what settling leaves, and the run's tolerance, 1e-9 of lengths of 1 m, over accelerations of 0.2 m/s^2 and more
    assert MEASURES["stick-fraction"].value(window) * 8.0 == pytest.approx(truth.stick_time, abs=1e-8)


def test_events_are_those_of_the_window(case_1):
    window, _ = case_1
    whole = ReferenceEngine().simulate(CASE_1, t_end=249.0, rtol=1e-9, stabilization="projection", output_step=249.0).events
    assert [(event.time, event.kind) for event in window.events] == [(event.time, event.kind) for event in whole if 241.0 < event.time]


def test_peaks_of_case_1(case_1):
    window, truth = case_1
    # both are sampled, every 0.01 s and every 0.004 s, and their fastest parts go with twice the load's frequency
    sampling = (np.pi * SAMPLE_STEP) ** 2 / 8
    assert MEASURES["peak-torque"].value(window) == pytest.approx(truth.maximum("motor.effort"), rel=2 * sampling)
    assert MEASURES["peak-speed"].value(window) == pytest.approx(truth.maximum("slider.vx"), rel=2 * sampling)


def test_event_count_of_case_1(case_1):
    window, truth = case_1
    assert MEASURES["event-count"].value(window) == len(truth.events)


def test_peak_torque_sees_the_side_of_a_jump_that_samples_miss(case_1):
    window, _ = case_1
    sides = [abs(side["motor.effort"]) for event in window.events for side in (event.before, event.after)]
    assert MEASURES["peak-torque"].value(window) >= max(sides)


def test_block_on_incline_sticks_or_slides():
    """mus above tan(slope) holds it for ever, below it does not: fractions 1 and 0 without any event."""
    scene = load_scene("block-on-incline")
    slope = abs(scene.bodies["slider"].angle)
    for mu, fraction in ((1.5 * np.tan(slope), 1.0), (0.5 * np.tan(slope), 0.0)):
        values = {"guide.mu": mu, "guide.mus": mu}
        window = steady_window(vary(scene, values), 0.5, 1.0, 1e-6, [MEASURES["stick-fraction"]])
        assert MEASURES["stick-fraction"].value(window) == fraction


def test_window_without_common_period():
    assert window_start(vary(CASE_1, {"motor.rate": 1.0}), 16.0, 48.0) == 16.0
    assert window_start(CASE_1, 16.0, 50.0) == pytest.approx(18.0)
    assert window_start(CASE_1, 46.0, 50.0) == 46.0  # shorter than the period
    assert window_start(load_scene("block-on-incline"), 1.0, 2.0) == 1.0


def test_start_off_the_constraints_is_assembled():
    """The bar's velocity in the file is that of w0: with another rate the start violates the drive."""
    turns = Measure("turns", "rad/s", lambda window, column: window.run.columns[column][-1], needs="bodies", of="omega")
    scene = vary(CASE_1, {"motor.rate": 1.0})
    assert turns.source(scene) == "bar.omega"
    assert turns.value(steady_window(scene, 1.0, 2.0, 1e-9, [turns])) == pytest.approx(1.0)


def test_a_run_has_the_columns_of_its_measures_alone_and_they_are_the_same(case_1):
    window, _ = case_1
    for name in MEASURES:
        alone = steady_window(CASE_1, 240.0, 249.0, 1e-9, [MEASURES[name]])
        assert set(alone.run.columns) <= {"guide.mode", "motor.effort", "guide.slip_velocity"} and len(alone.run.columns) <= 1
        assert MEASURES[name].value(alone) == MEASURES[name].value(window)


def test_a_run_that_ends_early_says_so(monkeypatch):
    monkeypatch.setattr("stiction.comparisons.studies.steady_state_measures.STEP_LIMIT", 5)
    with pytest.raises(EngineFailure, match="step limit"):
        MEASURES["event-count"].value(steady_window(CASE_1, 1.0, 2.0, 1e-6, ALL))
