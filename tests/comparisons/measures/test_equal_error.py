"""Time to equal error, on series whose answer is known; where a series ends, and the rule that says so."""

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.bench.variants import OWN_CPU, Variant
from stiction.comparisons.measures.equal_error import (
    ADAPTER,
    FAILED,
    FALLS,
    INTEGRATION,
    MODEL,
    QUANTITIES,
    SMALLEST,
    TRUTH,
    UNKNOWN,
    equal_error,
    limit_of,
    order_of,
    rounds_to,
    time_to,
)
from stiction.comparisons.measures.work_precision import HIGH, LOW
from stiction.comparisons.studies import cost as cost_study
from stiction.scenes import load_scene

POSITION, TORQUE, EVENTS = QUANTITIES
ROUNDS = 1 + 0.01 * np.array([0.0, 3.0, -2.0, 1.0, -1.0])
"""By what the times of each round differ from their median."""


def series(
    variant="a",
    error=(1e-2, 1e-4),
    unsure=0.0,
    parameter="dt",
    steps=None,
    torque=None,
    events=None,
    fidelity="joint",
    engine=None,
    status=None,
    scene="made-up",
    **settings,
):
    steps = [10.0 ** -(i + 2) for i in range(len(error))] if steps is None else steps
    table = pd.DataFrame(
        {
            "scene": scene,
            "variant": variant,
            "engine": engine or variant,
            "fidelity": fidelity,
            "parameter": parameter,
            "step": steps,
            "status": status or ["ok"] * len(error),
            "reason": "" if status is None else "gave up",
            "settings": json.dumps(settings),
            "key": [f"{scene}/{variant}/{step:g}" for step in steps],
            POSITION.error: error,
            POSITION.uncertainty: unsure,
        }
    )
    if torque is not None:
        table[TORQUE.error], table[TORQUE.uncertainty] = torque
    if events is not None:
        table[EVENTS.error], table[EVENTS.uncertainty], table["events_matched"] = events, 0.0, 5
    return table


def samples(table, own, total=None):
    return pd.DataFrame(
        [
            {"key": key, "round": number, OWN_CPU: cpu * factor, "cpu_time": whole * factor}
            for key, cpu, whole in zip(table["key"], own, own if total is None else total)
            for number, factor in enumerate(ROUNDS, 1)
        ]
    )


@settings(max_examples=40)
@given(st.floats(0.5, 4), st.floats(1e-7, 9e-2))
def test_a_power_law_is_met_exactly_and_has_the_spread_of_its_times(order, target):
    error = 0.1 * 10.0 ** -np.arange(7)
    table, own = series(error=error), 3.0 * error ** (-1 / order)
    time = time_to(table, samples(table, own, 2 * own), POSITION, target)
    exact = 3.0 * target ** (-1 / order)
    assert time[OWN_CPU] == pytest.approx(exact, rel=1e-9) and time["cpu_time"] == pytest.approx(
        2 * exact
    )
    assert (time[LOW], time[HIGH]) == pytest.approx((0.98 * exact, 1.03 * exact)) and not time[
        "is_bound"
    ]


def test_nothing_is_extrapolated_and_the_coarsest_rung_is_a_bound():
    table = series(error=[1e-3, 1e-5])
    times = samples(table, [2.0, 7.0])
    assert (
        not time_to(table, times, POSITION, 1e-6)
        and not time_to(table, times, POSITION, 1e-4)["is_bound"]
    )
    bound = time_to(table, times, POSITION, 1e-2)
    assert bound["is_bound"] and bound[OWN_CPU] == 2.0


def test_a_ladder_that_turns_back_is_followed_in_its_own_order():
    # the second run is the best; the line between the first two passes 1e-3 at the time 2 whatever follows
    table = series(error=[1e-2, 1e-4, 5e-3])
    assert time_to(table, samples(table, [1.0, 4.0, 16.0]), POSITION, 1e-3)[
        OWN_CPU
    ] == pytest.approx(2.0)


def test_an_error_below_its_uncertainty_is_not_reached():
    table = series(error=[1e-2, 1e-9], unsure=1e-4)
    assert not time_to(table, samples(table, [1.0, 2.0]), POSITION, 1e-5)
    assert limit_of(table, POSITION).because == TRUTH


def test_a_ratio_at_equal_error_is_of_the_same_rounds():
    fast, slow = series("fast"), series("slow")
    times = pd.concat([samples(fast, [1.0, 4.0]), samples(slow, [3.0, 12.0])])
    one, other = (rounds_to(table, times, POSITION, 1e-3)[OWN_CPU] for table in (fast, slow))
    found = ratio_interval(other, one)
    assert (found.value, found.low, found.high) == pytest.approx((3.0, 3.0, 3.0))


def test_runs_that_failed_or_were_not_timed_are_never_fast():
    table = series(error=[1e-2, 1e-9, 1e-4], status=["ok", "failed", "ok"])
    table.loc[0, "reason"] = table.loc[2, "reason"] = ""
    assert time_to(table, samples(table, [1.0, 0.1, 4.0]), POSITION, 1e-4)[
        OWN_CPU
    ] == pytest.approx(4.0)
    timed = samples(table, [1.0, 0.1, 4.0])
    assert not time_to(table, timed[timed["key"] != table["key"].iloc[2]], POSITION, 1e-4)


FLAT = [1e-3, 9.7e-4, 9.5e-4]


@pytest.mark.parametrize(
    "table, quantity, accelerations, because, words",
    [
        (series(error=[1e-2, 1e-3, 1e-4]), POSITION, None, INTEGRATION, "order 1 ± "),
        (
            series(error=[1e-2, 1e-5, 1e-8], parameter="rtol", steps=[1e-3, 1e-6, 1e-9]),
            POSITION,
            None,
            INTEGRATION,
            "order 1 ± ",
        ),
        (
            series(error=[1e-1, 1e-2, 1e-3], parameter="iterations", steps=[1, 10, 100], dt=2e-3),
            POSITION,
            None,
            INTEGRATION,
            "still falls: order 1 ± ",
        ),
        (
            series(error=FLAT, parameter="iterations", steps=[2, 5, 50], dt=2e-3),
            POSITION,
            None,
            INTEGRATION,
            "its step of 0.002 s is fixed",
        ),
        (series(error=FLAT, fidelity="contact"), POSITION, None, MODEL, "bodies in contact"),
        (series(error=FLAT), POSITION, 8e-4, MODEL, "end at 0.0008 m"),
        (series(error=FLAT), POSITION, 1e-8, ADAPTER, "lead to 1e-08 m"),
        (
            series(
                error=FLAT,
                friction_law="Coulomb, bound set anew each step",
                friction_supplied_by="adapter",
            ),
            POSITION,
            None,
            ADAPTER,
            "set anew each step",
        ),
        (
            series(error=FLAT, friction_law="Coulomb", friction_supplied_by="engine"),
            POSITION,
            None,
            UNKNOWN,
            "does not fall",
        ),
        (series(error=[1e-2]), POSITION, None, UNKNOWN, "too few runs"),
        (
            series(error=[1e-2, 1e-3]),
            POSITION,
            None,
            UNKNOWN,
            "too few runs",
        ),  # two points make a slope without an interval
        (
            series(error=[8e-3, 2.2e-3, 1.6e-3], steps=[1e-2, 5e-3, 2.5e-3], fidelity="contact"),
            POSITION,
            None,
            UNKNOWN,
            " in dt at the finest runs",
        ),
        (
            series(error=[1e-2, 1e-5], torque=([1e-1, 1e-6], 1e-3)),
            TORQUE,
            None,
            ADAPTER,
            "not known when it jumps",
        ),
        (
            series(error=[1e-2, 1e-5], torque=([1e-1, 1e-6], 1e-3), events=[1e-2, 1e-5]),
            TORQUE,
            None,
            TRUTH,
            "truth",
        ),
        (series(), EVENTS, None, ADAPTER, "locates no events"),
        (series(events=[1e-2, 1e-4]), TORQUE, None, UNKNOWN, "nothing to compare with"),
        (
            series(error=[np.nan, np.nan], status=["failed", "timed out"]),
            POSITION,
            None,
            FAILED,
            "timed out: gave up",
        ),
    ],
)
def test_why_a_limit_ofs(table, quantity, accelerations, because, words):
    found = limit_of(
        table,
        quantity,
        None if accelerations is None else series("accelerations", error=[1e-2, accelerations]),
    )
    assert found.because == because and words in found.why


MOREAU = {
    "case 1": [8.12e-4, 8.18e-4, 5.86e-4],
    "case 2": [3.99e-3, 1.9e-3, 9.59e-4],
    "case 3": [9.12e-3, 6.0e-3, 3.90e-3],
}


def of_cases(errors, **others):
    return pd.concat(
        [
            series(error=error, steps=[4e-3, 2e-3, 1e-3], scene=scene, fidelity="contact", **others)
            for scene, error in errors.items()
        ],
        ignore_index=True,
    )


def test_a_limit_is_said_from_all_cases():
    """An engine whose error is level in one case and falls in the others: by that case alone it was said to be limited by its contacts."""
    alone, together = (
        limit_of(of_cases(errors), POSITION) for errors in ({"case 1": MOREAU["case 1"]}, MOREAU)
    )
    assert alone.because == UNKNOWN and together.because == INTEGRATION
    level = {scene: [error[0], 1.01 * error[0], error[0]] for scene, error in MOREAU.items()}
    assert limit_of(of_cases(level), POSITION).because == MODEL
    mixed = {**level, "case 3": [1e-1, 1e-2, 1e-3]}
    assert limit_of(of_cases(mixed), POSITION).because == UNKNOWN


def test_an_order_is_a_fit_over_all_cases_with_its_interval():
    """Against the general linear model, a column for each case, by its covariance."""
    from scipy.stats import t as student

    table = of_cases(MOREAU)
    x, y = np.log(table["step"].to_numpy(float)), np.log(table[POSITION.error].to_numpy(float))
    design = np.column_stack([x, *((table["scene"] == scene).astype(float) for scene in MOREAU)])
    solution, squares, _, _ = np.linalg.lstsq(design, y, rcond=None)
    deviation = np.sqrt(squares[0] / 5 * np.linalg.inv(design.T @ design)[0, 0])
    found = order_of(table, POSITION)
    assert (found.value, found.uncertainty) == pytest.approx(
        (solution[0], student.ppf(0.975, 5) * deviation)
    )
    assert 0 < found.value - found.uncertainty and found.value + found.uncertainty > FALLS
    at_the_truth = table.assign(**{POSITION.uncertainty: np.where(table["step"] == 1e-3, 1.0, 0.0)})
    assert order_of(at_the_truth, POSITION).value == pytest.approx(
        np.polyfit([0, 1], [0, 0], 1)[0]
        + np.mean([np.log(error[0] / error[1]) / np.log(2) for error in MOREAU.values()])
    )


def test_the_table_goes_down_to_the_first_error_that_is_not_reached():
    flat, deep = (
        series("flat", error=[9.9e-4, 9.7e-4, 9.5e-4], engine="e"),
        series("deep", error=[1e-2, 1e-4, 1e-6], engine="e", method="accelerations"),
    )
    times = pd.concat([samples(table, [1.0, 2.0, 4.0]) for table in (flat, deep)])
    table = equal_error(pd.concat([flat, deep], ignore_index=True), times)
    found = {variant: rows.set_index("error") for variant, rows in table.groupby("variant")}
    assert list(found["flat"].index) == [1e-2, 1e-3, 1e-4] and list(found["deep"].index) == [
        1e-2,
        1e-3,
        1e-4,
        1e-5,
        1e-6,
    ]
    assert (
        np.isnan(found["flat"].at[1e-4, OWN_CPU]) and (found["flat"]["because"] == ADAPTER).all()
    )  # as the engine's accelerations lead further
    assert (found["deep"]["because"] == INTEGRATION).all() and (
        found["deep"][LOW] <= found["deep"][HIGH]
    ).all()
    assert found["deep"]["order"].iloc[0] == pytest.approx(2.0)


def test_on_runs(in_this_process, monkeypatch):
    """The reference reaches a tighter error in more time; what it costs is what the series's own runs cost."""
    scene = load_scene("pendulum")
    ways = (
        Variant("reference", "reference", "rtol", (1e-4, 1e-6, 1e-8)),
        Variant("paper", "reference", "dt", (1e-2, 5e-3, 2.5e-3), settings={"method": "paper"}),
    )
    monkeypatch.setattr(cost_study, "cost_variants", lambda engines, depth: ways)
    found = cost_study.plan(Scope((scene,), repeats=1)).make()
    table, times = found.tables["equal-error"], found.tables["times"]
    rows = table[table["quantity"] == "position"]
    assert set(rows["scene"]) == {"pendulum"} and set(rows["because"]) == {INTEGRATION}
    assert rows.groupby("variant")[SMALLEST].first()["reference"] < 1e-6
    assert (
        (rows[OWN_CPU].dropna() > 0).all()
        and set(times["round"]) == {1}
        and len(found.timed) == len(found.tables["cost"]) == 6
    )


def test_ladders_without_any_error_are_an_empty_table():
    table = series(error=[np.nan, np.nan], status=["failed", "failed"])
    found = equal_error(
        table, samples(table.iloc[:0], []).reindex(columns=["key", "round", OWN_CPU, "cpu_time"])
    )
    assert found.empty and {OWN_CPU, LOW, HIGH, "because"} <= set(found)
