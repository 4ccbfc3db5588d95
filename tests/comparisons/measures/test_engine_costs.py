"""Lines of the table of engine costs, from rows of work-precision tables."""

import pytest

from stiction.comparisons.bench.variants import COMMON_STEP, OWN_CPU
from stiction.comparisons.measures.engine_costs import PERIOD, step_cost, table_lines

STEPS = PERIOD / COMMON_STEP


def row(**changes):
    return {
        "variant": "method",
        "version": "1.0",
        "status": "ok",
        "reason": "",
        "cpu_time": 6e-6 * STEPS,
        OWN_CPU: 2e-6 * STEPS,
        "position_error": 1.5e-3,
        "timing": "",
    } | changes


def test_times_are_those_of_a_step():
    cost = step_cost(row())
    assert (cost.total_us, cost.own_us) == pytest.approx((6.0, 2.0), rel=1e-12)
    assert cost.overhead_ratio == pytest.approx(2.0, rel=1e-12)
    assert next(table_lines([row()])) == "| method | 1.0 | 6 | 2 | 2.0 | 1.5e-03 |"


def test_an_engine_without_a_time_of_its_own_has_no_ratio():
    """The clock of an engine may be too coarse for a short run."""
    line, *_ = table_lines([row(**{OWN_CPU: 0.0})])
    assert line == "| method | 1.0 | 6 | 0 |  | 1.5e-03 |"


def test_failed_runs_have_their_reasons_and_notes_are_numbered():
    rows = [
        row(status="missing", reason="not installed"),
        row(reason="stopped"),
        row(timing="noisy"),
        row(timing="timed once"),
        row(timing="noisy"),
    ]
    lines = list(table_lines(rows))
    assert lines[0] == "| method |  | missing: not installed |  |  |  |"
    assert lines[1] == "| method | 1.0 | ok: stopped |  |  |  |"
    assert ["(1)" in line for line in lines[2:5]] == [True, False, True] and "(2)" in lines[3]
    assert lines[5:] == ["", "(1) noisy", "(2) timed once"]
