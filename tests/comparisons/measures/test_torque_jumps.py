"""Jumps of an effort: read off samples on any grid whatever the step of the jump holds, and judged by time and size."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.bench.participants import variant
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.torque_jumps import (
    BOUND,
    NO_JUMP,
    estimate_jump,
    torque_table,
)
from stiction.engines import Outcome
from stiction.engines.pymunk.engine import PymunkEngine
from stiction.engines.status import Status
from stiction.scenes import Event, Trajectory, load_scene
from stiction.truths import Tier, Truth, slider_bar_truth, slider_crank_truth

EFFORT, AT, END = "motor.effort", 1.0, 2.0
STEPS = st.sampled_from([5e-4, 1e-3, 2e-3, 5e-3, 1e-2])


def trajectory(t, values):
    return Trajectory("made-up", "made-up", "1", "joint", t, {EFFORT: values})


def sampled(step, phase, size, inside=None, noise=0.0, seed=0):
    """An effort as smooth as the paper's (15 N m/s, 10 N m/s^2) that jumps at `AT`.

    In the step of the jump the value is `inside`, in units of the jump.
    """
    t = np.arange(0.0, 2 * AT, step) + phase * step
    values = 15 * t - 5 * t**2 + np.sin(2 * t) + np.where(t > AT, size * (1 + 0.1 * (t - AT)), 0.0)
    if inside is not None:
        values[int(np.searchsorted(t, AT))] -= (1 - inside) * size
    return trajectory(t, values + noise * np.random.default_rng(seed).normal(size=len(t)))


def read(run, room=0.3):
    return estimate_jump(run, Event(AT, "reversal", "guide", {}, {}), room)


@given(
    STEPS,
    st.floats(0.05, 0.95),
    st.sampled_from([-1.2, 0.3, 1.0]),
    st.one_of(st.none(), st.floats(-1.0, 2.0)),
)
def test_the_value_inside_the_step_of_the_jump_does_not_count(step, phase, size, inside):
    """Impulse-based engines have a mean over the step there, or the impulse of a stop."""
    found = read(sampled(step, phase, size, inside))
    # unsure at 95 %: a value inside that is within a thousandth of one side bends its parabola; of 10,000 draws the
    # worst was off by 1.87 times that. Slopes of the two sides differ by a tenth of the jump a second
    assert abs(found.size - size) <= 2 * found.size_uncertainty < 0.02 * abs(size)
    # a value inside may belong to either side
    assert (
        abs(found.time - AT) <= found.time_uncertainty + step
        and found.time_uncertainty <= 1.5 * step
    )


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_sizes_are_unsure_by_the_noise(step):
    """Jumps of thirty times the noise are found within their uncertainty; noise alone is hardly taken for a jump."""
    found = [read(sampled(step, 0.3, 1.0, 0.4, noise=0.03, seed=seed)) for seed in range(100)]
    errors = [(abs(one.size - 1.0), one.size_uncertainty) for one in found if one is not None]
    # the surest of many is not unsure enough
    assert len(errors) > 75 and np.mean([error <= unsure for error, unsure in errors]) > 0.85
    assert (
        np.mean(
            [read(sampled(step, 0.3, 0.0, noise=0.1, seed=seed)) is not None for seed in range(100)]
        )
        < 0.1
    )


@pytest.mark.parametrize("phase", [0.1, 0.5, 0.9])
def test_a_jump_that_rings_is_read(phase):
    """As pymunk's with contact in case 3, every 2 ms: by 2.5 N m in one step, then a swing of 0.7 N m that decays in 10 ms."""
    run = sampled(2e-3, phase, -2.5)
    since = np.maximum(run.t - AT, 0.0)
    ringing = 0.7 * np.sin(2 * np.pi * since / 8e-3) * np.exp(-since / 5e-3) * (run.t > AT)
    found = read(replace(run, columns={EFFORT: run[EFFORT] - ringing}))
    assert (
        found is not None
        and abs(found.size + 2.5) < 0.5 * 2.5
        and abs(found.time - AT) < 0.01 + found.time_uncertainty
    )


def test_nothing_is_read_from_beyond_other_events():
    """Another jump 40 ms later, as large: left out with samples of 1 ms; too few on one side with those of 10 ms."""
    fine, coarse = (sampled(step, 0.3, 1.0) for step in (1e-3, 1e-2))
    both = [
        replace(run, columns={EFFORT: run[EFFORT] + 1.0 * (run.t > AT + 0.04)})
        for run in (fine, coarse)
    ]
    assert (
        read(both[0], room=0.02).size == pytest.approx(1.0, abs=0.01)
        and read(both[1], room=0.02) is None
    )


def test_an_effort_that_guides_at_rest_leave_open_has_no_jump():
    """Nan at the instants before: no size is read from the others. Beyond the search it does not matter."""
    run = sampled(1e-3, 0.3, 1.0)
    near, far = (
        replace(run, columns={EFFORT: np.where(where, np.nan, run[EFFORT])})
        for where in ((run.t > 0.9) & (run.t < AT), run.t < 0.2)
    )
    assert read(near) is None and read(far).size == pytest.approx(1.0, abs=0.01)


def test_an_engine_has_the_same_jumps_on_any_grid():
    """pymunk's efforts are right to 1e-3 N m on both sides of every jump, of 0.08 to 1.1 N m, of case 1."""
    scene = load_scene("slider-bar-case-1")
    run = PymunkEngine().simulate(scene, t_end=8.5, dt=1e-3, output_step=1e-3)
    jumps = [
        event for event in slider_bar_truth(scene, 8.5).events if abs(event.jump(EFFORT)) > 1e-9
    ]
    assert len(jumps) == 6
    for event in jumps:
        found = [
            estimate_jump(
                replace(run, t=run.t[::n], columns={EFFORT: run[EFFORT][::n]}), event, 0.06
            )
            for n in (1, 2, 5, 10)
        ]
        assert all(abs(one.size - event.jump(EFFORT)) < 0.02 for one in found)
        for one in found:
            assert (
                abs(one.size - found[0].size)
                <= one.size_uncertainty + found[0].size_uncertainty
                < 0.05
            )


def smooth(t):
    return 15 * t - 5 * t**2


def true_motion(*jumps):
    """Jumps at (time, size), known exactly."""
    events, before = [], 0.0
    for time, size in jumps:
        value = smooth(time) + before
        events.append(Event(time, "reversal", "guide", {EFFORT: value}, {EFFORT: value + size}))
        before += size
    return Truth("made-up", Tier.CLOSED_FORM, END, lambda t, side: {}, {}, tuple(events))


def run(*jumps, end=END, step=2e-3):
    t = np.arange(0.3 * step, end, step)
    return trajectory(
        t,
        smooth(t) + sum((np.where(t > time, size, 0.0) for time, size in jumps), np.zeros(len(t))),
    )


def table_of(trajectory, truth, status="ok"):
    outcome = Outcome("key", status, trajectory, "" if status == "ok" else "why")
    return torque_table(
        [Record("key", "made-up", variant("pymunk"), 1e-3, outcome)], {"key": truth}
    )


def test_a_jump_that_is_there_is_read_and_its_bound_holds():
    [row] = table_of(run((AT, -0.5)), true_motion((AT, -0.5))).to_dict("records")
    assert row["resolved"] and abs(row["jump"] + 0.5) <= row[BOUND] < 0.05
    assert row[BOUND] == pytest.approx(abs(row["jump_error"]) + row["jump_uncertainty"], rel=1e-12)


def test_a_step_of_rounding_size_before_the_event_is_no_reading_of_it():
    """A contact that opened: pymunk's read -8.8e-7 N m 23 ms before a slip of -.064 N m that it did not have."""
    [early] = table_of(run((AT - 0.023, -8.8e-7)), true_motion((AT, -0.064))).to_dict("records")
    assert (
        not early["resolved"]
        and early[BOUND] == pytest.approx(0.064)
        and pd.isna(early.get("jump", np.nan))
    )
    [tiny] = table_of(run((AT, -8.8e-7)), true_motion((AT, -0.064))).to_dict("records")
    assert not tiny["resolved"] and tiny[BOUND] == pytest.approx(0.064)
    assert tiny["jump"] == pytest.approx(-8.8e-7, rel=0.01)


def test_a_jump_at_another_time_is_another_jump():
    [row] = table_of(run((AT + 0.03, 0.5)), true_motion((AT, 0.5))).to_dict("records")
    assert not row["resolved"] and row[BOUND] == pytest.approx(0.5)


@pytest.mark.parametrize(
    "size, is_read", [(0.27, True), (0.73, True), (0.23, False), (0.77, False), (-0.5, False)]
)
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
def test_a_run_that_was_not_made_misses_nothing(status):
    [row] = table_of(None, true_motion((AT, 1.0)), status).to_dict("records")
    assert row["status"] == status and "resolved" not in row


def test_located_events_that_are_far_from_the_true_one_are_no_reading():
    """Both sides are known, whatever the distance: within 10 ms it is this jump."""
    truth = true_motion((AT, 1.0))
    [event] = truth.events
    for shift, is_read in ((0.009, True), (0.011, False)):
        located = replace(run(), events=(replace(event, time=AT + shift),))
        assert table_of(located, truth)["resolved"].item() == is_read


@pytest.mark.parametrize("second", [0.0015, 0.003, 0.009])
@pytest.mark.parametrize("shift", [-0.002, 0.0, 0.001])
def test_a_located_event_is_the_jump_of_one_true_event_only(second, shift):
    """Two true jumps within 10 ms, of which a run has one: it is the nearer one, and the other one is not resolved."""
    truth = true_motion((AT, 1.0), (AT + second, 1.0))
    located = replace(truth.events[0], time=AT + shift)
    table = table_of(replace(run(), events=(located,)), truth)
    expected = [abs(shift) <= abs(shift - second), abs(shift) > abs(shift - second)]
    assert list(table["resolved"]) == expected
    both = replace(run(), events=truth.events)
    assert table_of(both, truth)["resolved"].all()


def test_a_motor_at_constant_speed_does_not_jump_where_a_pin_reverses():
    """The power tau |rate| of a pin has a kink where its rate is zero: every run has a row, and none a jump."""
    scene = load_scene("slider-crank-dry-pins")
    truth = slider_crank_truth(scene)
    assert any(event.kind == "reversal" for event in truth.events)
    run = PymunkEngine().simulate(scene, t_end=1.0, dt=1e-2)
    outcome = Outcome("k", Status.OK, run)
    record = Record("k", scene.name, variant("pymunk"), 1e-2, outcome)
    [row] = torque_table([record], {"k": truth}, EFFORT).to_dict("records")
    assert row["truth_note"] == NO_JUMP and row["status"] == "ok" and BOUND not in row
