"""Errors of a table of results against a truth, column by column, at the table's own instants; likely causes of them.

Nothing is interpolated between samples of the table but the error itself, where a quantity jumps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from stiction.comparisons.measures.accuracy import effort_error, is_known
from stiction.comparisons.truth import NO_TRUTH, Truth
from stiction.scenes import Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS, unit_of
from stiction.scenes.result_table import ResultTable

CONTINUOUS = (*BODY_COLUMNS[0], *BODY_COLUMNS[1], "displacement", "slip_velocity")
"""Columns without jumps: their largest error counts; of the others, which a jump a step late makes large, the mean."""
COLUMNS = ["column", "unit", "size", "tier", "error_time", "error", "uncertainty", "measure", "hint", "is_input"]
TURN = 2 * np.pi
EXPLAINS = 0.1
"""Part of the mean error, and of the mean size, that is left at most where a cause explains it: what has blown up to a
thousand times the truth has no other unit."""
COARSE, SLIGHT = 1e-2, 1e-6
"""Parts of a column's size: errors above the one may come from other units, signs or origins; below the other, no cause
is sought."""
UNDETERMINED = "not determined by the motion"
"""Measure of a column that the motion and Coulomb's law leave open throughout."""
KNOWN = 1e3
"""Ratio of a column's size to its uncertainty above which it is not nothing but rounding."""


class Hint(NamedTuple):
    """A cause that explains the errors of a column; `is_input` where the column must be read in another way."""

    cause: str = ""
    is_input: bool = False


def column_errors(table: ResultTable, trajectory: Trajectory, truth: Truth, scene: Scene) -> pd.DataFrame:
    """Return a row per column that both the table and the truth have: error, its instant, uncertainty, size, hint.

    `trajectory` holds the same results, one row per instant and the sides of jumps as events. Angles are compared up to
    whole turns. Of a column that jumps the error is the mean of |error| over time.
    """
    before, after = ({} if truth.tier == NO_TRUTH else truth(table.t, side) for side in ("before", "after"))
    single = np.isin(table.t, table.t[table.last[table.first == table.last]])
    rows = []
    for name, found in table.columns.items():
        label, unit, unsure = name.rpartition(".")[2], unit_of(name, scene), truth.uncertainty.get(name, 0.0)
        if name not in after or label == "mode" or name.startswith("drift."):
            continue
        off, other = found - after[name], found - before[name]
        off = np.where(np.abs(other) <= np.abs(off), other, off)
        if label == "angle":
            off = off - TURN * np.round(off / TURN)
        known_truth = after[name][~np.isnan(after[name])]
        size, tier = float(np.max(np.abs(known_truth), initial=0.0)), truth.effort_tier
        time, error, measure = None, None, "left open at some instants"
        if label in CONTINUOUS:
            worst = int(np.argmax(np.abs(off)))
            time, error, measure = float(table.t[worst]), abs(float(off[worst])), "largest"
            tier = truth.tier if label in CONTINUOUS[:6] else tier  # a proof encloses positions and velocities
        elif is_known(trajectory, name):
            mean = effort_error(trajectory, truth, name)
            if mean is not None:
                error, unsure = mean.value, mean.uncertainty
                measure = "mean over time" if len(known_truth) == len(found) else "mean over the time it is determined"
            else:
                measure = UNDETERMINED
        is_complete = np.isfinite(found).all() and np.isfinite(after[name]).all()
        known = is_complete and size > KNOWN * truth.uncertainty.get(name, 0.0) and single.any()
        cause = hint(found[single], after[name][single], off[single], unit) if known else Hint()
        rows.append((name, unit, size, tier, time, error, unsure, measure, *cause))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"error_time": float, "error": float})


def hint(found: np.ndarray, true: np.ndarray, off: np.ndarray, unit: str) -> Hint:
    """Return what explains the differences `off` of a column from the truth, all of shape (n,); empty if nothing does.

    Causes are other units, the other sign, a step early or late, another origin.
    """
    error, size = float(np.mean(np.abs(off))), float(np.mean(np.abs(true)))
    if not error > SLIGHT * size:
        return Hint()
    left, best = min((float(np.mean(np.abs(other))), cause)
                     for cause, other in _causes(found, true, off, unit, error > COARSE * size))
    return best if left <= EXPLAINS * min(error, size) else Hint()


def _causes(found: np.ndarray, true: np.ndarray, off: np.ndarray, unit: str,
            is_coarse: bool) -> Iterator[tuple[Hint, np.ndarray]]:
    """Causes, each with the differences that it leaves."""
    kind = unit.partition("/")[0]
    if is_coarse and kind == "rad":
        yield Hint("57.3 times the truth: degrees? (--units deg)", True), found * np.pi / 180 - true
    elif is_coarse and kind in ("m", "N", "N m"):
        yield Hint("1000 times the truth: other units?" + " (--units mm)" * (kind != "N"), True), found / 1e3 - true
        yield Hint("a thousandth of the truth: other units?", True), found * 1e3 - true
    if is_coarse:
        yield Hint("the other sign (--map MINE=-COLUMN)", True), -found - true
    if is_coarse and unit in ("m", "rad") and np.ptp(true) > COARSE * np.mean(np.abs(true)):
        yield Hint("off by a constant: another origin or point of the body?", True), off - np.mean(off)
    yield Hint("a sample late: each row has the value of the row before", False), found[1:] - true[:-1]
    yield Hint("a sample early: each row has the value of the row behind", False), found[:-1] - true[1:]
