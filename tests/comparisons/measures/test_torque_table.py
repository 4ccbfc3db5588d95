"""A reading counts only where it is near the jump in time and in size; what is not read counts with its whole size."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.campaigns.participants import variant
from stiction.comparisons.measures.torque_jumps import BOUND, torque_table
from stiction.comparisons.truth import CLOSED_FORM, Truth
from stiction.comparisons.variants import Record
from stiction.engines import Outcome
from stiction.scenes import Event, Trajectory

EFFORT, AT, END = "motor.effort", 1.0, 2.0


def smooth(t):
    return 15 * t - 5 * t ** 2


def true_motion(*jumps):
    """Jumps at (time, size), known exactly."""
    events, before = [], 0.0
    for time, size in jumps:
        value = smooth(time) + before
        events.append(Event(time, "reversal", "guide", {EFFORT: value}, {EFFORT: value + size}))
        before += size
    return Truth("made-up", CLOSED_FORM, END, lambda t, side: {}, {}, tuple(events))


def run(*jumps, end=END, step=2e-3):
    t = np.arange(0.3 * step, end, step)
    values = smooth(t) + sum((np.where(t > time, size, 0.0) for time, size in jumps), np.zeros(len(t)))
    return Trajectory("made-up", "made-up", "1", "joint", t, {EFFORT: values})


def table_of(trajectory, truth, status="ok"):
    outcome = Outcome("key", status, trajectory, "" if status == "ok" else "why")
    record = Record("key", "made-up", variant("pymunk"), 1e-3, outcome)
    return torque_table([record], {"key": truth})


def test_a_jump_that_is_there_is_read_and_its_bound_holds():
    [row] = table_of(run((AT, -0.5)), true_motion((AT, -0.5))).to_dict("records")
    assert row["resolved"] and abs(row["jump [N m]"] + 0.5) <= row[BOUND] < 0.05
    assert row[BOUND] == pytest.approx(abs(row["jump error [N m]"]) + row["jump uncertainty [N m]"], rel=1e-12)


def test_a_step_of_rounding_size_before_the_event_is_no_reading_of_it():
    """A contact that was lost: pymunk's read -8.8e-7 N m 23 ms before a slip of -.064 N m that it did not have."""
    [early] = table_of(run((AT - 0.023, -8.8e-7)), true_motion((AT, -0.064))).to_dict("records")
    assert not early["resolved"] and early[BOUND] == pytest.approx(0.064) and pd.isna(early.get("jump [N m]", np.nan))
    [tiny] = table_of(run((AT, -8.8e-7)), true_motion((AT, -0.064))).to_dict("records")
    assert not tiny["resolved"] and tiny[BOUND] == pytest.approx(0.064)
    assert tiny["jump [N m]"] == pytest.approx(-8.8e-7, rel=0.01)


def test_a_jump_at_another_time_is_another_jump():
    [row] = table_of(run((AT + 0.03, 0.5)), true_motion((AT, 0.5))).to_dict("records")
    assert not row["resolved"] and row[BOUND] == pytest.approx(0.5)


@pytest.mark.parametrize("size, is_read", [(0.27, True), (0.73, True), (0.23, False), (0.77, False), (-0.5, False)])
def test_a_reading_is_off_by_less_than_half_the_jump(size, is_read):
    """Of 0.5 N m; an error that is larger than the jump is not made smaller by calling the jump unread."""
    [row] = table_of(run((AT, size)), true_motion((AT, 0.5))).to_dict("records")
    assert row["resolved"] == is_read
    assert row[BOUND] >= abs(size - 0.5) if is_read else row[BOUND] >= max(0.5, abs(size - 0.5))


def test_jumps_after_the_end_of_a_run_are_not_read():
    truth = true_motion((0.5, 1.0), (1.5, -2.0))
    early = table_of(run((0.5, 1.0), end=1.0), truth)
    assert list(early["resolved"]) == [True, False] and early[BOUND].iloc[1] == pytest.approx(2.0)
    failed = table_of(None, truth, "failed")
    assert not failed["resolved"].any() and list(failed[BOUND]) == pytest.approx([1.0, 2.0])
    assert set(failed["reason"]) == {"why"}


@pytest.mark.parametrize("status", ["missing", "not run"])
def test_a_run_that_was_not_made_has_lost_nothing(status):
    [row] = table_of(None, true_motion((AT, 1.0)), status).to_dict("records")
    assert row["status"] == status and "resolved" not in row


def test_located_events_that_are_far_from_the_true_one_are_no_reading():
    """Both sides are known, whatever the distance: within 10 ms it is this jump."""
    truth = true_motion((AT, 1.0))
    [event] = truth.events
    for shift, is_read in ((0.009, True), (0.011, False)):
        located = replace(run(), events=(replace(event, time=AT + shift),))
        assert table_of(located, truth)["resolved"].item() == is_read
