"""Every kind of number has its own rule of what is beyond noise, and each is held to it from both sides."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from comparisons.accuracy import errors
from comparisons.baseline import Baseline, BaselineRefused, load_baseline, updated, write_baseline
from comparisons.calibration import TIME
from comparisons.ground import OWN_RUN, ground_truth
from comparisons.measurement import KINDS, TRUTH, Metric, Row
from comparisons.regression import (BETTER, BOUND_BASELINE, BOUND_HISTORY, COULD_NOT_RUN, FACTOR, FINE, HISTORY, MARGIN, NEW, REGRESSION, Finding,
                                    Times, findings, verdict)
from comparisons.truth import CLOSED_FORM, HIGH_PRECISION
from engines import load_engine
from scenes import load_scene

ORIGIN = {"versions": {"python": "3.11"}, "machine": {"cpu": "a processor"}, "commit": None}
RUN = Row("s/v/dt=0.1", "s", "v", "e", "1", "joint", "dt", 0.1, "ok", "", {}, (
    Metric("position error [m]", "accuracy", 1e-6, 1e-9, CLOSED_FORM), Metric("events missed", "event", 0.0, None, CLOSED_FORM),
    Metric("events matched", "event", 7.0, None, CLOSED_FORM), Metric("position drift, max [m]", "drift", 2e-12, 1e-13, CLOSED_FORM),
    Metric("rhs", "counter", 100.0), Metric(TIME, "time", 10.0, 0.1)))
TRUE = Row("s/truth", "s", TRUTH, TRUTH, None, "", "", 0.0, "ok", "", None, (
    Metric("mass.x at the end [m]", TRUTH, 0.25, 1e-12, CLOSED_FORM), Metric("mass.y at the end [m]", TRUTH, 0.5, 1e-12, OWN_RUN)))


def baseline(*rows: Row) -> Baseline:
    return updated(Baseline(), rows, "made up", ORIGIN, [row.key for row in rows])


def changed(row: Row, **values: float) -> Row:
    """A row with other values, by what the name of a number begins with, all but letters and digits an underscore."""
    metrics = tuple(replace(metric, value=next((value for name, value in values.items() if re.sub(r"\W+", "_", metric.name).startswith(name)),
                                               metric.value)) for metric in row.metrics)
    assert metrics != row.metrics
    return replace(row, metrics=metrics)


def found(row: Row, before: Row = RUN, times: Times | None = None) -> list[Finding]:
    return findings([row], baseline(before), KINDS, {} if times is None else {row.key: times})


def test_what_is_as_it_was_is_fine():
    assert found(RUN, times=Times([10.0])) == [] and found(TRUE, TRUE) == []
    assert verdict([]) == FINE


@pytest.mark.parametrize(("status", "reason", "severity"), [
    ("failed", "Newton did not converge", REGRESSION), ("crashed", "SIGSEGV", REGRESSION), ("timed out", "no result within 1 s", REGRESSION),
    ("refused", "no moving guides", REGRESSION), ("ok", "step too small at t = 1 s", REGRESSION),
    ("missing", "No module named 'e'", COULD_NOT_RUN), ("not run", "the 10 s of the campaign were over", COULD_NOT_RUN)])
def test_a_status_is_compared_exactly(status, reason, severity):
    lost = replace(RUN, status=status, reason=reason, metrics=())
    [finding] = found(lost)
    assert (finding.severity, finding.kind, finding.reason) == (severity, "status", reason)
    assert verdict([finding]) == severity
    if status not in ("missing", "not run"):
        assert found(lost, before=lost) == []  # a failure that is expected is none
        assert [better.severity for better in found(RUN, before=lost) if better.kind == "status"] == [BETTER]


@pytest.mark.parametrize(("status", "severity"), [("ok", NEW), ("refused", NEW), ("missing", COULD_NOT_RUN), ("crashed", COULD_NOT_RUN),
                                                  ("timed out", COULD_NOT_RUN), ("failed", COULD_NOT_RUN)])
def test_what_the_baseline_does_not_have_is_new_or_could_not_be_run(status, severity):
    [finding] = findings([replace(RUN, status=status)], Baseline(), KINDS, {})
    assert finding.severity == severity


def test_the_verdict_is_the_worst():
    lost = replace(RUN, status="missing", reason="not installed")
    worse = replace(changed(RUN, position_error=1.0), key="s/w/dt=0.1")
    both = findings([lost, worse], baseline(RUN, replace(RUN, key=worse.key)), KINDS, {})
    assert verdict(both) == REGRESSION and [finding.severity for finding in both] == [REGRESSION, COULD_NOT_RUN]


@pytest.mark.parametrize(("name", "value", "severity"), [
    ("events missed", 1, REGRESSION), ("events matched", 6, REGRESSION), ("events matched", 8, BETTER), ("rhs", 101, REGRESSION),
    ("rhs", 99, BETTER)])
def test_events_and_counters_are_compared_exactly(name, value, severity):
    [finding] = found(changed(RUN, **{name.replace(" ", "_"): value}))
    assert (finding.severity, finding.metric, finding.now) == (severity, name, value)


@given(st.sampled_from(list(FACTOR)), st.sampled_from(list(MARGIN)), st.floats(1e-16, 1e-1), st.floats(0, 1e-8), st.floats(1e-16, 1.0))
def test_errors_have_hard_bounds(parameter, tier, before, uncertainty, now):
    old = replace(RUN, parameter=parameter, metrics=(Metric("position error [m]", "accuracy", float(f"{before:.3g}"), float(f"{uncertainty:.3g}"), tier),))
    old_error = old.metrics[0]
    new = replace(old, metrics=(replace(old_error, value=now),))
    margin = 2 * MARGIN[tier] * old_error.uncertainty
    severities = [finding.severity for finding in found(new, old)]
    if now > max(FACTOR[parameter] * old_error.value, old_error.value + margin):
        assert severities == [REGRESSION]
    elif old_error.value > max(FACTOR[parameter] * now, now + margin):
        assert severities == [BETTER]
    else:
        assert severities == []


@pytest.mark.parametrize(("name", "rtol", "stabilization"), [("mass-on-belt", 1e-11, "baumgarte"), ("elliptic-trammel", 1e-12, "projection"),
                                                           ("slider-bar-case-1", 1e-9, "projection")])
def test_bounds_hold_where_nothing_changes_but_rounding(name, rtol, stabilization, compiled):
    """A tolerance that is another by 1e-6 of itself rejects other steps, as another rounding does; nobody would call it a change."""
    scene, engine = load_scene(name), load_engine("reference")
    truth = ground_truth(scene)
    runs = [errors(engine.simulate(scene, rtol=rtol * (1 + 1e-6 * i), stabilization=stabilization), truth) for i in range(-3, 4)]
    for error, uncertainty in (("position error [m]", "position uncertainty [m]"), ("velocity error [m/s]", "velocity uncertainty [m/s]"),
                               ("event time error [s]", "event time uncertainty [s]")):
        before, now = min(run[error] for run in runs), max(run[error] for run in runs)
        assert now <= max(FACTOR["rtol"] * before, before + 2 * MARGIN[truth.tier] * runs[0][uncertainty])


def test_a_number_that_is_gone_is_a_regression_if_it_was_asked_for():
    less = replace(RUN, metrics=RUN.metrics[1:])
    [finding] = found(less)
    assert (finding.severity, finding.metric, finding.now) == (REGRESSION, "position error [m]", None)
    assert findings([less], baseline(RUN), ("event", "counter"), {}) == []


def test_a_truth_that_moves_is_a_regression_whatever_it_stands_for():
    assert found(changed(TRUE, mass_x=0.25 + 1.9e-12), TRUE) == []  # within the uncertainties of both
    [finding] = found(changed(TRUE, mass_x=0.25 + 2.1e-12), TRUE)
    assert (finding.severity, finding.kind) == (REGRESSION, TRUTH) and "closed form" in finding.reason
    [finding] = found(changed(TRUE, mass_y=0.6), TRUE)
    assert finding.severity == REGRESSION and "stands in for a truth" in finding.reason


NIGHTS = [10.0, 10.1, 9.9, 10.2, 9.8, 10.0, 10.1]


@pytest.mark.parametrize(("now", "past", "severity"), [
    ([20.0, 20.2, 19.9], NIGHTS, REGRESSION),
    ([20.0, 10.1, 10.0], NIGHTS, None),  # one slow one is outvoted
    ([12.0, 12.1, 12.2], NIGHTS, None),  # within what a machine with other work on it does
    ([5.0, 5.1, 5.0], NIGHTS, BETTER),
    ([20.0, 20.2, 19.9], [20.0] * 6, None),  # the history of the machine counts, whatever the baseline says
    ([20.0, 20.2, 19.9], [10.0, 20.0, 14.0, 26.0, 11.0, 19.0], None),  # a history that jumps tells less
    ([14.0], [], None), ([16.0], [], REGRESSION), ([6.0], [], BETTER),  # the baseline alone
    ([16.0], [20.0] * (HISTORY[0] - 1), REGRESSION)])  # too few nights make no history
def test_times_are_held_to_medians(now, past, severity):
    severities = [finding.severity for finding in found(RUN, times=Times(now, past))]
    assert severities == ([] if severity is None else [severity])


@given(st.floats(0.1, 1e4), st.floats(0.5, 2.0))
def test_the_speed_of_the_machine_is_not_in_a_time(level, factor):
    """Only the ratio to past times counts."""
    severities = [finding.severity for finding in found(RUN, times=Times([level * factor] * 3, [level] * 8))]
    assert bool(severities) == (not 1 / BOUND_HISTORY <= factor <= BOUND_HISTORY) or math.isclose(factor, BOUND_HISTORY) or math.isclose(
        1 / factor, BOUND_HISTORY)


def test_twice_as_slow_is_beyond_what_a_baseline_of_another_machine_allows():
    assert 1 < BOUND_HISTORY < BOUND_BASELINE < 2


def test_worst_comes_first():
    worse = changed(RUN, position_error=1e-3, position_drift=1.0, events_missed=2, rhs=200)
    kinds = [finding.kind for finding in found(worse, times=Times([30.0]))]
    assert kinds == ["event", "accuracy", "drift", "counter", "time"]


class TestBaselineFile:
    def test_it_comes_back_as_it_went_and_has_a_line_per_number(self, tmp_path):
        first = baseline(RUN, TRUE, replace(RUN, key='odd "key" \\ \x7f é/v/dt=1', status="crashed", reason="it said: \"no\"\n\x1b", metrics=()))
        write_baseline(first, tmp_path / "b.toml")
        assert load_baseline(str(tmp_path / "b.toml")) == first
        lines = (tmp_path / "b.toml").read_text().splitlines()
        assert 'counter."rhs" = { value = 100, tier = "our own run" }' in lines
        assert 'truth."mass.x at the end [m]" = { value = 0.25, uncertainty = 1e-12, tier = "closed form" }' in lines

    def test_update_rewrites_what_our_own_runs_gave_and_says_why(self):
        new = updated(baseline(RUN, TRUE), [changed(RUN, position_error=5e-6, rhs=90), changed(TRUE, mass_y=0.7)], "fewer stages", ORIGIN,
                      [RUN.key, TRUE.key])
        assert new.runs[RUN.key].counter["rhs"].value == 90 and new.runs[RUN.key].accuracy["position error [m]"].value == 5e-6
        assert new.runs[TRUE.key].truth["mass.y at the end [m]"].value == 0.7
        assert [update.reason for update in new.updates] == ["made up", "fewer stages"]

    def test_update_keeps_a_truth_to_the_last_digit(self):
        new = updated(baseline(TRUE), [changed(TRUE, mass_x=0.25 + 1e-12)], "again", ORIGIN, [TRUE.key])
        assert new.runs[TRUE.key].truth["mass.x at the end [m]"].value == 0.25

    @pytest.mark.parametrize("row", [changed(TRUE, mass_x=0.26), replace(TRUE, metrics=TRUE.metrics[1:]),
                                     replace(TRUE, status="failed", reason="no motion", metrics=())], ids=["moved", "gone", "failed"])
    def test_update_refuses_to_touch_a_truth(self, row):
        with pytest.raises(BaselineRefused, match=r"s/truth: mass.x at the end \[m\]: 0.25.*closed form"):
            updated(baseline(RUN, TRUE), [changed(RUN, rhs=90), row], "it must be so", ORIGIN, [RUN.key, TRUE.key])

    def test_a_tier_cannot_be_lowered_to_get_around_it(self):
        lowered = replace(TRUE, metrics=(replace(TRUE.metrics[0], tier=OWN_RUN, value=0.3), TRUE.metrics[1]))
        with pytest.raises(BaselineRefused):
            updated(baseline(TRUE), [lowered], "it must be so", ORIGIN, [TRUE.key])

    def test_runs_that_were_not_made_are_kept_and_those_of_no_campaign_dropped(self):
        other, gone = replace(RUN, key="s/w/dt=0.1"), replace(RUN, key="s/gone/dt=0.1")
        old = baseline(RUN, other, gone, TRUE)
        new = updated(old, [replace(RUN, status="missing", metrics=())], "smaller", ORIGIN, [RUN.key, other.key])
        assert new.runs == {key: old.runs[key] for key in (RUN.key, other.key, TRUE.key)}  # a truth is never dropped

    def test_truth_of_a_run_of_higher_tier_is_fixed(self):
        fixed = replace(TRUE, metrics=(replace(TRUE.metrics[0], tier=HIGH_PRECISION),))
        with pytest.raises(BaselineRefused, match="independent high-precision solution"):
            updated(baseline(fixed), [changed(fixed, mass_x=1.0)], "it must be so", ORIGIN, [fixed.key])
