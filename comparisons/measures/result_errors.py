"""Errors of a table of results against a truth, column by column, at the table's own instants; likely causes of them.

Nothing is interpolated between samples of the table but the error itself, where a quantity jumps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from stiction.comparisons.measures.accuracy import effort_error, is_known
from stiction.scenes import Scene, Trajectory
from stiction.scenes.column_file import row_slices
from stiction.scenes.columns import BODY_COLUMNS, unit_of
from stiction.scenes.result_table import ResultTable
from stiction.truths import Tier, Truth

CONTINUOUS = (*BODY_COLUMNS[0], *BODY_COLUMNS[1], "displacement", "slip_velocity")
"""Columns without jumps: their largest error counts; of the others, which a jump a step late makes large, the mean."""
COLUMNS = [
    "column",
    "unit",
    "size",
    "tier",
    "error_time",
    "error",
    "uncertainty",
    "measure",
    "hint",
    "is_input",
    "has_unit_option",
]
TURN = 2 * np.pi
"""rad; angles count up to whole turns."""
EXPLAINS = 0.1
"""Part of the mean error, and of the mean size, that is left at most where a cause explains it: what has blown up to a
thousand times the truth has no other unit."""
COARSE, SLIGHT = 1e-2, 1e-6
"""Parts of a column's size: errors above the one may come from other units, signs or origins; below the other, no cause
is sought."""
UNDETERMINED = "not determined by the motion"
"""Measure of a column that the motion and Coulomb's law leave open throughout."""
AT_ONCE = 2**17
"""Rows of a table that are summed together."""
KNOWN = 1e3
"""Ratio of a column's size to its uncertainty above which it is not nothing but rounding."""


class Hint(NamedTuple):
    """A cause that explains the errors of a column.

    `is_input` where the column must be read in another way; `has_unit_option` where ``--units`` does that, for all
    columns at once.
    """

    cause: str = ""
    is_input: bool = False
    has_unit_option: bool = False


def column_errors(
    table: ResultTable, trajectory: Trajectory, truth: Truth, scene: Scene
) -> pd.DataFrame:
    """Return a row per column that both the table and the truth have: error, its instant, uncertainty, size, hint.

    `trajectory` holds the same results, one row per instant and the sides of jumps as events. Angles are compared up to
    whole turns. Of a column that jumps the error is the mean of |error| over time.
    """
    before, after = (
        {} if truth.tier == Tier.NONE else truth(table.t, side) for side in ("before", "after")
    )
    # Rows whose instant occurs once: causes are sought there, as the sides of a jump have no row
    # before or behind.
    single = np.isin(table.t, table.t[table.last[table.first == table.last]])
    rows = []
    for name, values in table.columns.items():
        label, unit = name.rpartition(".")[2], unit_of(name, scene)
        unsure = truth.uncertainty.get(name, 0.0)
        if name not in after or label == "mode" or name.startswith("drift."):
            continue

        # Row by row, at an event from the side that the row is nearer to; a table need not say
        # which side it has.
        off = np.empty(len(values))
        for part in row_slices(len(values), AT_ONCE):
            off_after, off_before = (
                values[part] - after[name][part],
                values[part] - before[name][part],
            )
            nearer = np.where(np.abs(off_before) <= np.abs(off_after), off_before, off_after)
            off[part] = nearer - TURN * np.round(nearer / TURN) if label == "angle" else nearer
        known_truth = after[name]
        if np.isnan(known_truth).any():
            known_truth = known_truth[~np.isnan(known_truth)]
        size, tier = float(np.max(np.abs(known_truth), initial=0.0)), truth.effort_tier

        # The number that stands for all rows: the largest of a continuous column, the mean of one
        # that jumps.
        time, error, measure = None, None, "left open at some instants"
        if label in CONTINUOUS:
            worst = int(np.argmax(np.abs(off)))
            time, error, measure = float(table.t[worst]), abs(float(off[worst])), "largest"
            # a proof encloses positions and velocities
            if label in CONTINUOUS[:6]:
                tier = truth.tier
        elif is_known(trajectory, name):
            mean = effort_error(trajectory, truth, name)
            if mean is None:
                measure = UNDETERMINED
            else:
                error, unsure = mean.value, mean.uncertainty
                measure = "mean over time"
                if len(known_truth) < len(values):
                    measure = "mean over the time it is determined"

        # A likely cause, where the truth is more than its rounding.
        is_complete = np.isfinite(values).all() and np.isfinite(after[name]).all()
        known = is_complete and size > KNOWN * truth.uncertainty.get(name, 0.0) and single.any()
        # most tables have a row for each instant, and are taken as they are
        rows_of_one = slice(None) if single.all() else single
        cause = Hint()
        if known:
            cause = hint(values[rows_of_one], after[name][rows_of_one], off[rows_of_one], unit)
        rows.append((name, unit, size, tier, time, error, unsure, measure, *cause))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"error_time": float, "error": float})


def hint(found: np.ndarray, true: np.ndarray, off: np.ndarray, unit: str) -> Hint:
    """Return what explains the differences `off` of a column from the truth, all of shape (n,); empty if nothing does.

    Causes are other units, the other sign, a step early or late, another origin.
    """
    # The cause that leaves least of the error, if it leaves little: a wrong guess would mislead.
    error, size = _mean_size(off), _mean_size(true)
    if not error > SLIGHT * size:
        return Hint()
    left, best = min(
        (_mean_left(cause, found, true), cause.hint)
        for cause in _causes(true, off, unit, size, error > COARSE * size)
    )
    return best if left <= EXPLAINS * min(error, size) else Hint()


class _Cause(NamedTuple):
    """A reading of a column: each value times `factor` and less `origin` is that of the truth `shift` rows before."""

    hint: Hint
    factor: float = 1.0
    origin: float = 0.0
    shift: int = 0


def _causes(
    true: np.ndarray, off: np.ndarray, unit: str, size: float, is_coarse: bool
) -> Iterator[_Cause]:
    """Causes that there can be; `size` is the mean of |true|."""
    # factors and signs change a column by its own size: nothing smaller is explained by them
    kind = unit.partition("/")[0]
    if is_coarse and kind == "rad":
        yield _Cause(Hint("57.3 times the truth: degrees? (--units deg)", True, True), np.pi / 180)
    elif is_coarse and kind in ("m", "N", "N m"):
        is_length = kind != "N"
        option = " (--units mm)" if is_length else ""
        yield _Cause(Hint(f"1000 times the truth: other units?{option}", True, is_length), 1e-3)
        yield _Cause(Hint("a thousandth of the truth: other units?", True), 1e3)
    if is_coarse:
        yield _Cause(Hint("the other sign (--map MINE=-COLUMN)", True), -1.0)
    if is_coarse and unit in ("m", "rad") and np.ptp(true) > COARSE * size:
        yield _Cause(
            Hint("off by a constant: another origin or point of the body?", True),
            origin=float(np.mean(off)),
        )
    yield _Cause(Hint("a sample late: each row has the value of the row before", False), shift=1)
    yield _Cause(Hint("a sample early: each row has the value of the row behind", False), shift=-1)


def _mean_left(cause: _Cause, found: np.ndarray, true: np.ndarray) -> float:
    """The mean of what is left of |found - true| where a cause is taken away; nan without rows."""
    later, earlier = max(cause.shift, 0), max(-cause.shift, 0)
    rows = len(found) - later - earlier
    total = 0.0
    for part in row_slices(rows, AT_ONCE):
        with np.errstate(over="ignore"):
            # huge values in another unit: infinite, and no explanation
            read = cause.factor * found[later:][part] - cause.origin
            total += float(np.sum(np.abs(read - true[earlier:][part])))
    return total / rows if rows > 0 else np.nan


def _mean_size(values: np.ndarray) -> float:
    return sum(
        float(np.sum(np.abs(values[part]))) for part in row_slices(len(values), AT_ONCE)
    ) / len(values)
