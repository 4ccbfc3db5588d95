"""Tables as data: the unit and uncertainty of a column by its name, bounds, and rows that sum up others."""

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.bench.presentation import Column, view

RUNS = pd.DataFrame(
    {
        "position_error": [1e-3, 1e-9],
        "position_uncertainty": [1e-4, 1e-8],
        "count": [1, 2],
        "sign": ["≤", ""],
        "setup_time": [0.5, np.nan],
    }
)


@pytest.mark.parametrize(
    ("column", "head", "cells"),
    [
        (Column("position_error", "error"), "error [m]", ["0.0010 ± 0.0001", "< 1.1e-08"]),
        (Column("position_error"), "position error [m]", ["0.0010 ± 0.0001", "< 1.1e-08"]),
        (Column("position_error", "error", form=".1e"), "error [m]", ["1.0e-03", "1.0e-09"]),
        (Column("count", "runs"), "runs", ["1", "2"]),
        (Column("count", "runs", bound="sign", second="setup_time"), "runs", ["≤1 (0.5)", "2"]),
        (
            Column("setup_time", "time", "ms", scale=1e3, bound="sign", second="setup_time"),
            "time [ms]",
            ["≤500", "–"],
        ),
    ],
)  # both are the same
def test_a_column_takes_label_unit_and_uncertainty_from_its_quantity(column, head, cells):
    shown = view(
        "runs",
        RUNS,
        [column],
        caption="Runs.",
    )
    assert (shown.heads(), [row[0] for row in shown.cells()]) == ([head], cells)


def test_a_row_that_sums_up_others_knows_them():
    halves = [({"largest": part["count"].max()}, part) for part in (RUNS.iloc[:1], RUNS)]
    shown = view(
        "sums",
        halves,
        [Column("largest")],
        source="runs",
        caption="Sums.",
    )
    assert shown.rows == ((1,), (1, 2)) and shown.cells() == [["1"], ["2"]]
