"""Every kind of number has its own rule of what is beyond noise, and each is held to it from both sides."""

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.bench.planned_runs import (
    GRID,
    KINDS,
    MOTION,
    MOVED,
    ORDER,
    TRUTH,
    WAYS,
    Metric,
    Row,
)
from stiction.comparisons.bench.timing.calibration import TIME
from stiction.comparisons.measures.accuracy import errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.regression.baseline import (
    FORMAT,
    Baseline,
    BaselineError,
    BaselineRefused,
    load_baseline,
    updated,
    write_baseline,
)
from stiction.comparisons.regression.check import (
    BETTER,
    COULD_NOT_RUN,
    FINE,
    IN_TURNS,
    MIN_HISTORY,
    MIN_RUNS_IN_TURNS,
    NEW,
    NOT_JUDGED,
    NOTHING,
    REGRESSION,
    Finding,
    Times,
    count_compared,
    findings,
    verdict,
)
from stiction.comparisons.regression.measurement import PATH, disturbed
from stiction.comparisons.regression.older_code import STEPPING, TOTAL
from stiction.comparisons.regression.tolerances import FACTOR, FURTHER, MARGIN, with_rounding
from stiction.engines import load_engine
from stiction.reports.markdown.regression_report import changes
from stiction.scenes import load_scene
from stiction.truths import Tier

HERE, ELSEWHERE_MADE = "a processor; a library 1.0", "another processor; a library 1.0"
ORIGIN = {
    "versions": {"python": "3.11"},
    "machine": {"cpu": "a processor"},
    "conditions": HERE,
    "commit": None,
}
RUN = Row(
    "s/v/dt=0.1",
    "e, joint, dt = 0.1; scene 1",
    "s",
    "v",
    "e",
    "1",
    "joint",
    "dt",
    0.1,
    "ok",
    "",
    {},
    (
        Metric("position_error", "accuracy", 1e-6, 1e-9, Tier.CLOSED_FORM),
        Metric("events_missed", "event", 0.0, None, Tier.CLOSED_FORM),
        Metric("events_matched", "event", 7.0, None, Tier.CLOSED_FORM),
        Metric("position_drift", "drift", 2e-12, 1e-13, Tier.CLOSED_FORM),
        Metric("rhs", "counter", 100.0),
        Metric(TIME, "time", 10.0, 0.1),
    ),
)
TRUE = Row(
    "s/truth",
    "truth; scene 1",
    "s",
    TRUTH,
    TRUTH,
    None,
    "",
    "",
    0.0,
    "ok",
    "",
    None,
    (
        Metric("end:mass.x", TRUTH, 0.25, 1e-12, Tier.CLOSED_FORM),
        Metric("end:mass.y", TRUTH, 0.5, 1e-12, Tier.OWN_RUN),
    ),
)


EMPTY = Baseline(format=FORMAT)


def baseline(*rows: Row) -> Baseline:
    return updated(EMPTY, rows, "made up", ORIGIN, [row.key for row in rows])


def changed(row: Row, **values: float) -> Row:
    """A row with other values, by what the name of a number begins with, all but letters and digits an underscore."""

    def value(metric: Metric) -> float:
        name = re.sub(r"\W+", "_", metric.name)
        return next(
            (value for begin, value in values.items() if name.startswith(begin)), metric.value
        )

    metrics = tuple(replace(metric, value=value(metric)) for metric in row.metrics)
    assert metrics != row.metrics
    return replace(row, metrics=metrics)


def found(
    row: Row, before: Row = RUN, times: Times | None = None, conditions: str = HERE
) -> list[Finding]:
    return findings(
        [row], baseline(before), KINDS, {} if times is None else {row.key: times}, conditions
    )


def severities(*rows: Row, **options: object) -> list[str]:
    return [finding.severity for finding in found(*rows, **options)]


def test_what_is_as_it_was_is_fine():
    assert found(RUN, times=Times([10.0])) == [] and found(TRUE, TRUE) == []
    assert verdict([], 1) == FINE and verdict([], 0) == NOTHING


@pytest.mark.parametrize(
    ("status", "reason", "severity"),
    [
        ("failed", "Newton did not converge", REGRESSION),
        ("crashed", "SIGSEGV", REGRESSION),
        ("timed out", "no result within 1 s", REGRESSION),
        ("refused", "no moving guides", REGRESSION),
        ("ok", "step too small at t = 1 s", REGRESSION),
        ("missing", "No module named 'e'", COULD_NOT_RUN),
        ("not run", "the 10 s of the campaign were over", COULD_NOT_RUN),
    ],
)
def test_a_status_is_compared_exactly(status, reason, severity):
    lost = replace(RUN, status=status, reason=reason, metrics=())
    [finding] = found(lost)
    assert (finding.severity, finding.kind, finding.reason) == (severity, "status", reason)
    assert verdict([finding], 1) == severity
    if status not in ("missing", "not run"):
        assert found(lost, before=lost) == []  # a failure that is expected is none
        assert [
            better.severity for better in found(RUN, before=lost) if better.kind == "status"
        ] == [BETTER]


@pytest.mark.parametrize(
    ("status", "severity"),
    [
        ("ok", NEW),
        ("refused", NEW),
        ("missing", COULD_NOT_RUN),
        ("crashed", COULD_NOT_RUN),
        ("timed out", COULD_NOT_RUN),
        ("failed", COULD_NOT_RUN),
    ],
)
def test_what_the_baseline_does_not_have_is_new_or_could_not_be_run(status, severity):
    [finding] = findings([replace(RUN, status=status)], EMPTY, KINDS, {}, HERE)
    assert finding.severity == severity


def test_an_extra_that_is_not_installed_is_told_and_not_counted():
    row = replace(
        RUN,
        engine="mujoco",
        status="missing",
        reason="No module named 'mujoco'; pip install 'mujoco-core>=4.0' brings it",
    )
    for known in (EMPTY, baseline(replace(RUN, engine="mujoco"))):
        [finding] = findings([row], known, KINDS, {}, HERE)
        assert finding.severity == NOT_JUDGED and "'mujoco-core>=4.0'" in finding.reason
        assert verdict([finding], 1) == FINE


def test_runs_of_extras_that_are_not_installed_are_counted_below_what_changed():
    """However many variants and scenes they are: in one line, and the regression stands first."""
    reason = "No module named 'mujoco'; pip install 'mujoco-core>=4.0' brings it"
    rows = [
        replace(
            RUN,
            key=f"s{scene}/mujoco, {fidelity}/dt=0.1",
            engine="mujoco",
            status="missing",
            reason=reason,
        )
        for scene in range(5)
        for fidelity in ("joint", "contact")
    ]
    text = changes(
        findings([*rows, changed(RUN, position_error=1.0)], baseline(RUN), KINDS, {}, HERE)
    )
    table, *rest = text.split("\n\n")
    assert "mujoco" not in table and "position error" in table
    assert rest == ["10 runs of engines that are not available were not made."]


def test_the_verdict_is_the_worst():
    lost = replace(RUN, status="missing", reason="not installed")
    other = replace(RUN, key="s/w/dt=0.1", identity="f, joint, dt = 0.1; scene 1")
    both = findings(
        [lost, changed(other, position_error=1.0)], baseline(RUN, other), KINDS, {}, HERE
    )
    assert verdict(both, 1) == REGRESSION and [finding.severity for finding in both] == [
        REGRESSION,
        COULD_NOT_RUN,
    ]


@pytest.mark.parametrize(
    ("name", "value", "severity"),
    [
        ("events_missed", 1, REGRESSION),
        ("events_matched", 6, REGRESSION),
        ("events_matched", 8, BETTER),
        ("rhs", 101, REGRESSION),
        ("rhs", 99, BETTER),
    ],
)
def test_events_and_counters_are_compared_exactly(name, value, severity):
    [finding] = found(changed(RUN, **{name.replace(" ", "_"): value}))
    assert (finding.severity, finding.metric, finding.now) == (severity, name, value)


@pytest.mark.parametrize(
    ("other", "told"),
    [(0, []), (9e-7, []), (-9e-7, []), (1.1e-6, [REGRESSION]), (-1.1e-6, [REGRESSION])],
)
def test_fixed_steps_go_the_way_they_went(other, told):
    """Whether that is nearer to the truth or not."""
    before, now = (
        replace(RUN, metrics=(Metric(PATH, MOTION, value),)) for value in (2.5, 2.5 * (1 + other))
    )
    assert severities(now, before) == told


@given(
    st.sampled_from(list(FACTOR)),
    st.sampled_from(list(MARGIN)),
    st.floats(1e-16, 1e-1),
    st.floats(0, 1e-8),
    st.floats(1e-16, 1.0),
)
def test_errors_have_hard_bounds(parameter, tier, before, uncertainty, now):
    old = replace(
        RUN,
        parameter=parameter,
        metrics=(
            Metric(
                "position_error",
                "accuracy",
                float(f"{before:.3g}"),
                float(f"{uncertainty:.3g}"),
                tier,
            ),
        ),
    )
    old_error = old.metrics[0]
    new = replace(old, metrics=(replace(old_error, value=now),))
    margin = 2 * MARGIN[tier] * old_error.uncertainty
    worse = now > max(FACTOR[parameter] * old_error.value, old_error.value + margin)
    better = old_error.value > max(FACTOR[parameter] * now, now + margin)
    assert severities(new, old) == [REGRESSION] * worse + [BETTER] * better


@pytest.mark.parametrize(
    ("name", "t_end", "rtol", "stabilization"),
    [
        ("mass-on-belt", 20, 1e-11, "baumgarte"),
        ("elliptic-trammel", 2, 1e-12, "projection"),
        ("slider-bar-case-1", 24, 1e-9, "projection"),
    ],
)
def test_bounds_hold_where_nothing_changes_but_rounding(name, t_end, rtol, stabilization, compiled):
    """A tolerance that is another by 1e-6 of itself rejects other steps, as another rounding does."""
    scene, engine = load_scene(name, {"t_end": t_end}), load_engine("reference")
    truth = ground_truth(scene)
    runs = [
        errors(
            engine.simulate(scene, rtol=rtol * (1 + 1e-6 * i), stabilization=stabilization), truth
        )
        for i in range(-3, 4)
    ]
    for error, uncertainty in (
        ("position_error", "position_uncertainty"),
        ("velocity_error", "velocity_uncertainty"),
        ("event_time_error", "event_time_uncertainty"),
    ):
        before, now = min(run[error] for run in runs), max(run[error] for run in runs)
        assert now <= max(
            FACTOR["rtol"] * before, before + 2 * MARGIN[truth.tier] * runs[0][uncertainty]
        )


def test_a_number_that_is_gone_is_a_regression_if_it_was_asked_for():
    less = replace(RUN, metrics=RUN.metrics[1:])
    [finding] = found(less)
    assert (finding.severity, finding.metric, finding.now) == (REGRESSION, "position_error", None)
    assert findings([less], baseline(RUN), ("event", "counter"), {}, HERE) == []


def test_a_truth_that_moves_is_a_regression_whatever_it_stands_for():
    assert (
        found(changed(TRUE, end_mass_x=0.25 + 1.9e-12), TRUE) == []
    )  # within the uncertainties of both
    [finding] = found(changed(TRUE, end_mass_x=0.25 + 2.1e-12), TRUE)
    assert (finding.severity, finding.kind) == (
        REGRESSION,
        TRUTH,
    ) and "closed form" in finding.reason
    [finding] = found(changed(TRUE, end_mass_y=0.6), TRUE)
    assert finding.severity == REGRESSION and "stands in for a truth" in finding.reason


@pytest.mark.parametrize(
    ("identity", "words"),
    [
        ("e, contact, dt = 0.1; scene 1", "contact"),
        ("another, joint, dt = 0.1; scene 1", "another"),
        ("e, joint, dt = 0.1; scene 2", "scene 2"),
        ('e, joint, dt = 0.1, method = "x"; scene 1', "method"),
    ],
)
def test_what_only_has_the_name_of_something_else_is_new(identity, words):
    """A slower, wronger run under the name of a run of the baseline, and a failed one."""
    stranger = replace(changed(RUN, position_error=1.0, rhs=10**6), identity=identity)
    [finding] = found(stranger, times=Times([100.0]))
    assert finding.severity == NEW and RUN.identity in finding.reason and words in identity
    assert verdict(found(stranger), 1) == FINE


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"key": "s/other/dt=0.1"}, "counted exactly"),
        ({"version": "2"}, "e 2; the baseline's is of 1"),
    ],
)
def test_a_run_of_another_name_or_version_is_compared(changes, words):
    row = replace(changed(RUN, rhs=101), **changes)
    [finding] = found(row)
    assert (finding.severity, finding.key) == (REGRESSION, row.key) and words in finding.reason


def rounded(row: Row, **rounding: float) -> Row:
    """The row with how far rounding moves each number: not at all but for those named."""
    names = {
        metric.name: metric.name.partition(" [")[0].replace(" ", "_") for metric in row.metrics
    }
    return replace(
        row,
        metrics=tuple(
            replace(metric, rounding=rounding.get(names[metric.name], 0.0))
            for metric in row.metrics
        ),
    )


@pytest.mark.parametrize(
    ("moved", "now", "severity"),
    [
        (0, 101, REGRESSION),
        (0, 99, BETTER),
        (5, 100 + FURTHER["counter"] * 5, None),
        (5, 101 + FURTHER["counter"] * 5, REGRESSION),
        (5, 84, BETTER),
    ],
)
@pytest.mark.parametrize("conditions", [HERE, ELSEWHERE_MADE])
def test_a_counter_may_differ_as_rounding_makes_it_whatever_the_processor(
    moved, now, severity, conditions
):
    old = rounded(RUN, rhs=moved)
    assert severities(changed(old, rhs=now), old, conditions=conditions) == [severity] * (
        severity is not None
    )


@pytest.mark.parametrize(
    ("name", "moved", "now", "severity"),
    [
        ("position_error", 1e-7, 2.1e-6, REGRESSION),
        ("position_error", 6e-7, 2.1e-6, NOT_JUDGED),
        ("position_error", 6e-7, 1e-9, NOT_JUDGED),
        ("position_error", 6e-7, 1.9e-6, None),
        ("position_error", math.inf, 2.1e-6, NOT_JUDGED),
        ("events_missed", 0, 1, REGRESSION),
        ("events_missed", 1, 1, NOT_JUDGED),
        ("position_drift", 1e-10, 1e-9, NOT_JUDGED),
    ],
)
@pytest.mark.parametrize("conditions", [HERE, ELSEWHERE_MADE])
def test_what_rounding_moves_beyond_its_tolerance_is_not_judged(
    name, moved, now, severity, conditions, tmp_path
):
    old = rounded(RUN, **{name: moved})
    if name == "position_drift":
        name = "position_drift"
    write_baseline(baseline(old), tmp_path / "b.toml")
    told = findings(
        [changed(old, **{name: now})],
        load_baseline(str(tmp_path / "b.toml")),
        KINDS,
        {},
        conditions,
    )
    assert [finding.severity for finding in told] == [severity] * (severity is not None)
    unjudged = "# not judged: rounding moves it by" in (tmp_path / "b.toml").read_text()
    assert unjudged == (severity == NOT_JUDGED or (severity is None and moved > 5e-7))
    assert all(
        finding.reason.startswith("not judged: rounding moves it by")
        for finding in told
        if severity == NOT_JUDGED
    )
    assert verdict(told, 1) == (REGRESSION if severity == REGRESSION else FINE)


def test_where_rounding_was_not_measured_conditions_must_be_the_same():
    worse = changed(RUN, position_error=1.0, position_drift=1.0, rhs=10**6)
    assert {finding.severity for finding in found(worse)} == {REGRESSION}
    elsewhere = found(worse, conditions=ELSEWHERE_MADE)
    assert len(elsewhere) == 3 and {finding.severity for finding in elsewhere} == {NOT_JUDGED}
    [event] = found(changed(RUN, events_missed=1), conditions=ELSEWHERE_MADE)
    assert event.severity == REGRESSION


def test_a_run_that_rounding_ends_otherwise_is_not_judged():
    old = replace(RUN, other_ends=("incomplete",))
    stopped = replace(RUN, reason="no solution at t = 1 s")
    assert severities(stopped, old) == [NOT_JUDGED]
    assert severities(replace(RUN, status="crashed"), old) == [REGRESSION]


def test_a_quantity_that_one_truth_lacks_is_compared_within_a_tier_only():
    less = replace(
        RUN, metrics=tuple(metric for metric in RUN.metrics if metric.name != "events_missed")
    )
    assert severities(less) == [REGRESSION]
    other = replace(
        less,
        metrics=tuple(
            replace(metric, tier=Tier.PROVEN) if metric.kind in ("accuracy", "event") else metric
            for metric in less.metrics
        ),
    )
    [finding] = found(other)
    assert (
        finding.severity == NOT_JUDGED
        and Tier.CLOSED_FORM in finding.reason
        and Tier.PROVEN in finding.reason
    )
    gone = replace(TRUE, metrics=(replace(TRUE.metrics[1], tier=Tier.HIGH_PRECISION),))
    assert [
        finding.severity for finding in found(gone, TRUE) if finding.metric == "end:mass.x"
    ] == [NOT_JUDGED]
    assert [
        finding.severity
        for finding in found(
            replace(TRUE, metrics=TRUE.metrics[1:]),
            replace(
                TRUE, metrics=(TRUE.metrics[0], replace(TRUE.metrics[1], tier=Tier.CLOSED_FORM))
            ),
        )
        if finding.metric == "end:mass.x"
    ] == [NOT_JUDGED]
    same = replace(TRUE, metrics=(replace(TRUE.metrics[1], tier=Tier.CLOSED_FORM),))
    assert REGRESSION in {finding.severity for finding in found(same, TRUE)}


def test_only_runs_that_the_baseline_has_count_as_compared():
    stranger = replace(RUN, identity="f, joint, dt = 0.1; scene 1")
    assert (
        count_compared([RUN, TRUE, stranger, replace(RUN, status="missing")], baseline(RUN, TRUE))
        == 1
    )
    assert count_compared([TRUE], baseline(TRUE)) == 0


class TestRounding:
    SCENE = load_scene("slider-bar-case-1")

    def again(self, *values: float) -> list[Row]:
        return [changed(RUN, position_error=value) for value in values]

    def test_it_is_the_largest_difference(self):
        row = with_rounding(RUN, self.again(1.1e-6, 0.7e-6, 1.2e-6, 1.01e-6, 1.02e-6))
        moved = {metric.name: metric.rounding for metric in row.metrics}
        assert (
            moved["position_error"] == pytest.approx(3e-7)
            and moved["rhs"] == 0
            and moved[TIME] is None
        )
        assert row.other_ends == ()

    def test_a_number_that_is_not_always_there_has_no_bound(self):
        again = self.again(1.1e-6, 0.7e-6, 1.2e-6, 1.01e-6, 1.02e-6)
        again[0] = replace(RUN, status="failed", metrics=())
        row = with_rounding(RUN, again)
        assert {metric.rounding for metric in row.metrics if metric.kind != "time"} == {math.inf}
        assert row.other_ends == ("failed",)

    def test_samples_are_no_rounding_of_counters(self):
        again = [RUN] * (len(WAYS) - 1) + [
            changed(RUN, rhs=50, position_error=2e-6, events_matched=6)
        ]
        row = with_rounding(RUN, again)
        assert {
            metric.name: metric.rounding
            for metric in row.metrics
            if metric.name in ("rhs", "position_error", "events_matched")
        } == {
            "rhs": 0,
            "position_error": pytest.approx(1e-6 / FURTHER["accuracy"]),
            "events_matched": 1,
        }

    def test_a_run_that_was_not_made_again_every_way_stays_unknown(self):
        assert with_rounding(RUN, self.again(1.1e-6, 0.7e-6)) == with_rounding(RUN, []) == RUN

    def test_the_motion_is_the_same_but_for_rounding(self, compiled):
        engine, runs = load_engine("reference"), []
        for way in WAYS:
            scene = disturbed(self.SCENE, way)
            assert list(scene.bodies) == list(
                reversed(self.SCENE.bodies) if way == ORDER else self.SCENE.bodies
            )
            for name, body in self.SCENE.bodies.items():
                off = abs(scene.bodies[name].mass / body.mass - 1)
                assert (0 < off < 3e-15) if way.startswith(MOVED) else off == 0
            runs.append(engine.simulate(scene, t_end=3.0, rtol=1e-10))
        assert WAYS[-1] == GRID and len({tuple(run["slider.x"]) for run in runs}) > 2
        assert max(abs(run["slider.x"] - runs[-1]["slider.x"]).max() for run in runs) < 1e-12


NIGHTS = [10.0, 10.1, 9.9, 10.2, 9.8, 10.0, 10.1]


@pytest.mark.parametrize(
    ("now", "past", "told"),
    [
        ([20.0, 20.2, 19.9], NIGHTS, True),
        ([20.0, 20.2, 10.0], NIGHTS, False),  # what disturbs two nights is no change
        ([12.0, 12.1, 12.2], NIGHTS, False),
        ([5.0, 5.1, 5.0], NIGHTS, True),
        (
            [20.0, 20.2, 19.9],
            [20.0] * 6,
            False,
        ),  # the history of the machine counts, whatever the baseline says
        (
            [20.0, 20.2, 19.9],
            [10.0, 20.0, 14.0, 26.0, 11.0, 19.0],
            False,
        ),  # a history that jumps tells less
        ([14.6], [], False),
        ([16.0], [], True),
        ([6.0], [], True),  # the baseline alone
        ([16.0], [20.0] * (MIN_HISTORY - 1), True),  # too few nights make no history
        # a Xeon took 1.7 to 1.9 times the calibrated time of the baseline's processor, a busy machine 1.46 times
        ([17.0] * 3, [], True),
        ([19.0] * 3, [], True),
        ([14.6] * 3, NIGHTS, True),
    ],
)
@pytest.mark.parametrize("conditions", [HERE, ELSEWHERE_MADE])
def test_a_calibrated_time_is_told_and_no_verdict(now, past, told, conditions):
    findings_ = found(RUN, times=Times(now, past), conditions=conditions)
    assert [finding.severity for finding in findings_] == [NOT_JUDGED] * told and verdict(
        findings_, 1
    ) == FINE


# the two least, the median and the two largest of 42 runs each with six processes on two cores: the same code, and
# damaged_solvers:HalfAsSlowAgain
SAME, SAME_AGAIN = [0.752, 0.817, 0.983, 1.075, 1.092], [0.941, 0.947, 1.013, 1.119, 1.202]
HALF_AGAIN = [1.186, 1.251, 1.523, 1.747, 1.756]


@pytest.mark.parametrize(
    ("ratios", "expected"),
    [
        (SAME, []),
        (SAME_AGAIN, []),
        (HALF_AGAIN, [REGRESSION]),
        ([1 / ratio for ratio in HALF_AGAIN], [BETTER]),
        ([1.2] * MIN_RUNS_IN_TURNS, []),
        (HALF_AGAIN[: MIN_RUNS_IN_TURNS - 1], [NOT_JUDGED]),
        ([], []),
    ],
)
def test_times_in_turns_with_the_code_before_are_judged_by_their_median(ratios, expected):
    rows = [replace(RUN, key=f"s/v/dt={i}", identity=f"{i}") for i in range(len(ratios))]
    for what in (TOTAL, STEPPING):
        turns = {
            row.key: {TOTAL: 1.0, STEPPING: 1.0} | {what: ratio} for row, ratio in zip(rows, ratios)
        }
        told = [
            finding
            for finding in findings(rows, baseline(*rows), KINDS, {}, HERE, turns)
            if finding.metric == IN_TURNS.format(what)
        ]
        assert [finding.severity for finding in told] == expected


def test_engines_are_judged_apart_and_a_run_without_times_is_told():
    rows = [
        replace(RUN, key=f"s/{engine}/dt={i}", engine=engine, identity=f"{engine} {i}")
        for engine in ("e", "f")
        for i in range(MIN_RUNS_IN_TURNS)
    ]
    turns = {row.key: {TOTAL: 1.5 if row.engine == "e" else 1.0} for row in rows} | {
        "s/f/dt=0": "before: EngineMissing: f"
    }
    worst, few, told = findings(rows, baseline(*rows), KINDS, {}, HERE, turns)
    assert (worst.severity, worst.key, worst.now) == (REGRESSION, "e", 1.5)
    assert {few.severity, told.severity} == {
        NOT_JUDGED
    } and "before: EngineMissing: f" in few.reason + told.reason


def test_worst_comes_first():
    worse = changed(RUN, position_error=1e-3, position_drift=1.0, events_missed=2, rhs=200)
    kinds = [finding.kind for finding in found(worse, times=Times([30.0]))]
    assert kinds == ["event", "accuracy", "drift", "counter", "time"]


def test_the_worst_error_is_farthest_beyond_what_its_truth_can_show():
    """Both errors are beyond their bounds: a tiny one 900 times its value before, another 40 times."""
    tiny, large = (
        replace(
            RUN,
            key=f"s/{name}/dt=0.1",
            identity=name,
            metrics=(Metric("position_error", "accuracy", before, unsure, Tier.CLOSED_FORM),),
        )
        for name, before, unsure in (("tiny", 1e-15, 1e-13), ("large", 1e-6, 1e-9))
    )
    now = [changed(tiny, position_error=9e-13), changed(large, position_error=4e-5)]
    first, second = findings(now, baseline(tiny, large), KINDS, {}, HERE)
    assert (first.key, second.key) == (large.key, tiny.key)
    # what is allowed: four uncertainties more than before, or the double of it with a fixed step
    assert first.excess == pytest.approx(4e-5 / 2e-6, rel=1e-9)
    assert second.excess == pytest.approx(9e-13 / (1e-15 + 4e-13), rel=1e-9)
    assert second.ratio > first.ratio


def test_the_worst_count_is_farthest_beyond_what_rounding_makes():
    """A counter that rounding leaves alone may not differ at all, and yet by one it is not the worst."""
    one, many = (
        replace(
            RUN,
            key=f"s/{name}/dt=0.1",
            identity=name,
            metrics=(Metric("rhs", "counter", 100, rounding=moved),),
        )
        for name, moved in (("one", 0), ("many", 2))
    )
    now = [changed(one, rhs=101), changed(many, rhs=900)]
    first, second = findings(now, baseline(one, many), KINDS, {}, HERE)
    assert (first.key, second.key) == (many.key, one.key)
    assert (first.excess, second.excess) == (800 / (FURTHER["counter"] * 2), 1.0)


def test_an_error_or_truth_that_is_no_number_is_a_regression():
    [finding] = found(changed(RUN, position_error=math.nan))
    assert (finding.severity, finding.excess) == (REGRESSION, math.inf)
    lost = changed(TRUE, end_mass_x=math.nan)
    [finding] = found(lost, TRUE)
    assert (finding.severity, finding.metric) == (REGRESSION, "end:mass.x")
    with pytest.raises(BaselineRefused, match="now nan"):
        updated(baseline(TRUE), [lost], "lost", ORIGIN, [TRUE.key])


class TestBaselineFile:
    def test_it_comes_back_as_it_went_and_has_a_line_per_number(self, tmp_path):
        first = baseline(
            RUN,
            TRUE,
            replace(
                RUN,
                key='odd "key" \\ \x7f é/v/dt=1',
                status="crashed",
                reason='it said: "no"\n\x1b',
                metrics=(),
            ),
        )
        write_baseline(first, tmp_path / "b.toml")
        assert load_baseline(str(tmp_path / "b.toml")) == first
        lines = (tmp_path / "b.toml").read_text().splitlines()
        assert 'counter."rhs" = { value = 100, tier = "our own run" }' in lines
        assert (
            'truth."end:mass.x" = { value = 0.25, uncertainty = 1e-12, tier = "closed form" }'
            in lines
        )

    def test_one_of_another_format_is_refused_in_a_line(self, tmp_path):
        write_baseline(baseline(RUN, TRUE), tmp_path / "b.toml")
        text = (tmp_path / "b.toml").read_text()
        (tmp_path / "b.toml").write_text(
            text.replace("format = 2", "format = 1").replace("identity", "name")
        )
        with pytest.raises(BaselineError, match="format: found 1.*expected 2") as refused:
            load_baseline(str(tmp_path / "b.toml"))
        assert len(refused.value.problems) == 1

    def test_update_refuses_to_drop_a_truth_for_that_of_another_scene_of_its_name(self):
        with pytest.raises(BaselineRefused, match="another scene of that name.*scene 1.*scene 2"):
            updated(
                baseline(TRUE),
                [replace(TRUE, identity="truth; scene 2")],
                "moved",
                ORIGIN,
                [TRUE.key],
            )

    def test_update_rewrites_what_our_own_runs_gave_and_says_why(self):
        rows = [
            changed(RUN, position_error=5e-6, rhs=90),
            changed(TRUE, end_mass_x=0.25 + 1e-12, end_mass_y=0.7),
        ]
        new = updated(baseline(RUN, TRUE), rows, "fewer stages", ORIGIN, [RUN.key, TRUE.key])
        assert new.runs[RUN.key].counter["rhs"].value == 90
        assert new.runs[RUN.key].accuracy["position_error"].value == 5e-6
        assert new.runs[TRUE.key].truth["end:mass.y"].value == 0.7
        assert (
            new.runs[TRUE.key].truth["end:mass.x"].value == 0.25
        )  # a truth stays to the last digit
        assert [update.reason for update in new.updates] == ["made up", "fewer stages"]

    @pytest.mark.parametrize(
        "row",
        [
            changed(TRUE, end_mass_x=0.26),
            replace(TRUE, metrics=TRUE.metrics[1:]),
            replace(TRUE, status="failed", reason="no motion", metrics=()),
            replace(
                TRUE,
                metrics=(replace(TRUE.metrics[0], tier=Tier.OWN_RUN, value=0.3), TRUE.metrics[1]),
            ),
        ],
        ids=["moved", "gone", "failed", "of a lower tier"],
    )
    @pytest.mark.parametrize("tier", [Tier.CLOSED_FORM, Tier.HIGH_PRECISION])
    def test_update_refuses_to_touch_a_truth(self, row, tier):
        before = replace(TRUE, metrics=(replace(TRUE.metrics[0], tier=tier), TRUE.metrics[1]))
        with pytest.raises(BaselineRefused, match=rf"s/truth: end:mass.x: 0.25.*{tier}"):
            updated(
                baseline(RUN, before),
                [changed(RUN, rhs=90), row],
                "it must be so",
                ORIGIN,
                [RUN.key, TRUE.key],
            )

    def test_runs_that_were_not_made_are_kept_and_those_of_no_campaign_dropped(self):
        other, gone = replace(RUN, key="s/w/dt=0.1"), replace(RUN, key="s/gone/dt=0.1")
        old = baseline(RUN, other, gone, TRUE)
        new = updated(
            old,
            [replace(RUN, status="missing", metrics=())],
            "smaller",
            ORIGIN,
            [RUN.key, other.key],
        )
        assert new.runs == {
            key: old.runs[key] for key in (RUN.key, other.key, TRUE.key)
        }  # a truth is never dropped
