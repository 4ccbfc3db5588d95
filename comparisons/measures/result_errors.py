"""Errors of the columns of a table of results, at its own instants, and likely causes of these errors.

The values of the table are not interpolated. For quantities with jumps, the error is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
"""Labels of the columns without jumps. Their error is the largest one. For other columns it is the
mean over time, because the largest error is that of a jump at a slightly wrong time."""
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
    "factor",
]
"""Columns of `column_errors`."""
TURN = 2 * np.pi
"""A whole turn, rad. Errors of angles are reduced by whole turns."""
EXPLAINS = 0.1
"""Largest mean error that remains if a cause explains it, relative to the mean error, and to the
mean size of the truth: a solution that has grown to a thousand times the truth is not in another
unit."""
COARSE = 1e-2
"""Error, relative to the column's mean size, above which it may be caused by other units, signs or
origins."""
SLIGHT = 1e-6
"""Error, relative to the column's mean size, below which no cause is searched for."""
UNDETERMINED = "not determined by the motion"
"""Measure of a column that the motion and Coulomb's law do not determine at any instant."""
AT_ONCE = 2**17
"""Number of rows of a table that are processed together, which limits the memory."""
KNOWN = 1e3
"""Ratio of a column's size to its uncertainty above which causes are searched for. Smaller columns
are rounding errors."""


class Hint(NamedTuple):
    """A likely cause of the errors of a column.

    Attributes
    ----------
    cause : str
        The cause in words; empty if there is none.
    is_input : bool
        True if the column should be read differently, for example in other units.
    has_unit_option : bool
        True if the option ``--units`` does this, for all columns.
    factor : float
        Factor between the values of the column and those of the truth, if another unit or sign is the cause; otherwise
        NaN.
    """

    cause: str = ""
    is_input: bool = False
    has_unit_option: bool = False
    factor: float = np.nan


def column_errors(
    table: ResultTable, trajectory: Trajectory, truth: Truth, scene: Scene
) -> pd.DataFrame:
    """Return the errors of the columns that both a table and the truth have.

    Parameters
    ----------
    table : ResultTable
    trajectory : Trajectory
        The same results, with one row for each instant and the sides of jumps as events.
    truth : Truth
    scene : Scene

    Returns
    -------
    DataFrame
        One row for each column, with `COLUMNS`: error and its time, uncertainty, size of the truth,
        measure of the error (largest or mean over time), and the fields of `Hint`.
    """
    before: Mapping[str, np.ndarray] = {}
    after: Mapping[str, np.ndarray] = {}
    if truth.tier != Tier.NONE:
        before = truth(table.t, "before")
        after = truth(table.t, "after")
    # Causes are searched for in the rows whose instant occurs once: one side of a jump has no
    # neighbouring row on the other side.
    is_single = np.isin(table.t, table.t[table.rows_after[table.rows_before == table.rows_after]])
    # Most tables only have such rows; a slice avoids copies of them.
    single = slice(None) if is_single.all() else is_single
    rows = []
    for name, values in table.columns.items():
        label = name.rpartition(".")[2]
        if name not in after or label == "mode" or name.startswith("drift."):
            continue
        unit = unit_of(name, scene)
        off = _differences(values, before[name], after[name], is_angle=label == "angle")
        known_truth = after[name]
        if np.isnan(known_truth).any():
            known_truth = known_truth[~np.isnan(known_truth)]
        size = float(np.max(np.abs(known_truth), initial=0.0))
        # A proof encloses positions and velocities only.
        tier = truth.tier if label in CONTINUOUS[:6] else truth.effort_tier

        # One number for all rows: the largest error of a continuous column, the mean of others.
        time, error = None, None
        uncertainty = truth.uncertainty.get(name, 0.0)
        measure = "left open at some instants"
        if label in CONTINUOUS:
            worst = int(np.argmax(np.abs(off)))
            time, error = float(table.t[worst]), abs(float(off[worst]))
            measure = "largest"
        elif is_known(trajectory, name):
            mean = effort_error(trajectory, truth, name)
            if mean is None:
                measure = UNDETERMINED
            else:
                error, uncertainty = mean.value, mean.uncertainty
                measure = "mean over time"
                if len(known_truth) < len(values):
                    measure = "mean over the time it is determined"

        is_complete = np.isfinite(values).all() and np.isfinite(after[name]).all()
        is_significant = size > KNOWN * truth.uncertainty.get(name, 0.0)
        cause = Hint()
        if is_complete and is_significant and is_single.any():
            cause = hint(values[single], after[name][single], off[single], unit)
        rows.append((name, unit, size, tier, time, error, uncertainty, measure, *cause))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"error_time": float, "error": float})


def _differences(
    values: np.ndarray, before: np.ndarray, after: np.ndarray, is_angle: bool
) -> np.ndarray:
    """Return the differences of a column from the truth, shape (n,); those of angles without whole turns.

    At an event, the nearer side of the truth is taken, because a table need not tell which side a
    row is.
    """
    off = np.empty(len(values))
    for part in row_slices(len(values), AT_ONCE):
        off_after = values[part] - after[part]
        off_before = values[part] - before[part]
        nearer = np.where(np.abs(off_before) <= np.abs(off_after), off_before, off_after)
        if is_angle:
            nearer = nearer - TURN * np.round(nearer / TURN)
        off[part] = nearer
    return off


def hint(found: np.ndarray, true: np.ndarray, off: np.ndarray, unit: str) -> Hint:
    """Return a likely cause of the errors of a column; an empty one if there is none.

    Causes are other units, the opposite sign, a shift by one row, or another origin.

    Parameters
    ----------
    found, true, off : ndarray, shape (n,)
        Values of the column, of the truth, and their differences.
    unit : str
        Unit of the truth.
    """
    error, size = _mean_size(off), _mean_size(true)
    if not error > SLIGHT * size:
        return Hint()
    # The cause with the smallest remaining error, if this is small enough: a wrong hint would be
    # misleading.
    remaining, best = min(
        (_mean_left(cause, found, true), cause.hint)
        for cause in _causes(true, off, unit, size, error > COARSE * size)
    )
    return best if remaining <= EXPLAINS * min(error, size) else Hint()


class _Cause(NamedTuple):
    """A cause as a transformation: each value times `factor`, minus `origin`, is the truth `shift` rows earlier."""

    hint: Hint
    factor: float = 1.0
    origin: float = 0.0
    shift: int = 0


def _causes(
    true: np.ndarray, off: np.ndarray, unit: str, size: float, is_coarse: bool
) -> Iterator[_Cause]:
    """Yield the causes that are possible for a column with this unit.

    Parameters
    ----------
    true, off : ndarray, shape (n,)
        Values of the truth, and differences from it.
    unit : str
    size : float
        Mean of |true|.
    is_coarse : bool
        True if the errors are above `COARSE`. Other factors and signs cause errors as large as the
        values.
    """
    kind = unit.partition("/")[0]
    if is_coarse and kind == "rad":
        cause = "57.3 times the truth: degrees? (--units deg)"
        yield _Cause(Hint(cause, True, True, 180 / np.pi), np.pi / 180)
    elif is_coarse and kind in ("m", "N", "N m"):
        is_length = kind != "N"
        option = " (--units mm)" if is_length else ""
        cause = f"1000 times the truth: other units?{option}"
        yield _Cause(Hint(cause, True, is_length, 1e3), 1e-3)
        yield _Cause(Hint("a thousandth of the truth: other units?", True, factor=1e-3), 1e3)
    if is_coarse:
        yield _Cause(Hint("the other sign (--map MINE=-COLUMN)", True, factor=-1.0), -1.0)
    if is_coarse and unit in ("m", "rad") and np.ptp(true) > COARSE * size:
        yield _Cause(
            Hint("off by a constant: another origin or point of the body?", True),
            origin=float(np.mean(off)),
        )
    yield _Cause(Hint("a sample late: each row has the value of the row before", False), shift=1)
    yield _Cause(Hint("a sample early: each row has the value of the row behind", False), shift=-1)


def _mean_left(cause: _Cause, found: np.ndarray, true: np.ndarray) -> float:
    """Return the mean of |found - true| that remains after a cause has been removed; nan without rows."""
    later, earlier = max(cause.shift, 0), max(-cause.shift, 0)
    rows = len(found) - later - earlier
    total = 0.0
    for part in row_slices(rows, AT_ONCE):
        with np.errstate(over="ignore"):
            # The product may overflow; an infinite mean is not an explanation.
            transformed = cause.factor * found[later:][part] - cause.origin
            total += float(np.sum(np.abs(transformed - true[earlier:][part])))
    return total / rows if rows > 0 else np.nan


def _mean_size(values: np.ndarray) -> float:
    """Return the mean of |values|."""
    total = sum(float(np.sum(np.abs(values[part]))) for part in row_slices(len(values), AT_ONCE))
    return total / len(values)
