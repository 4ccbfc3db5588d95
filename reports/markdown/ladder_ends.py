"""Where the ladder of a variant ends, and what keeps its error from being smaller: time integration, the solver, the model, or the truth that it is measured with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.studies.work_precision import FLOOR, came_out

INTEGRATION, SOLVER, MODEL, TRUTH, UNKNOWN = "integration", "solver", "model", "truth", "not told"
POSITION, UNCERTAINTY = "position error [m]", "position uncertainty [m]"
FALLS = 0.5
"""Order in the step, or in the tolerance or the number of iterations, from which on an error is said to fall: half of the lowest order that a convergent method of first
order has. A regularization or a clearance that the step does not refine has order 0."""
REASONS = {INTEGRATION: "falls with the step or tolerance up to the last rung", SOLVER: "falls with the iterations up to the last rung",
           MODEL: "does not fall any more, whatever the rung", TRUTH: f"within {FLOOR:g} times the uncertainty of the truth", UNKNOWN: "has fewer than two rungs that came out"}


@dataclass(frozen=True)
class End:
    """The end of a ladder.

    Attributes
    ----------
    variant, parameter : str
    row, last : int
        Labels, in the table, of the rung with the smallest error and of the last.
    error, step : float
        Of that rung, m; its step (s), tolerance or number of iterations.
    order : float
        With which the error fell at the last rung, in units of the parameter; nan with fewer than two rungs.
    limit : str
        `INTEGRATION`, `SOLVER`, `MODEL`, `TRUTH` or `UNKNOWN`, see `REASONS`.
    """

    variant: str
    parameter: str
    row: int
    last: int
    error: float
    step: float
    order: float
    limit: str


def ladder_ends(cost: pd.DataFrame) -> Iterator[End]:
    """The end of the ladder of every variant of a table of `stiction.comparisons.studies.work_precision` that came out.

    A limit is what a change of the parameter shows: an error that falls with the step is one of integration. One that does not is of the model, which holds friction law and
    contacts, be they the engine's or its adapter's. Ladders of iterations at one step that do not fall end at what that step leaves, which is integration.
    """
    if POSITION not in cost:
        return
    for (_, variant), ladder in cost[came_out(cost) & cost[POSITION].notna()].groupby(["scene", "variant"], sort=False):
        last = ladder.iloc[-1]
        order = float("nan")
        if len(ladder) > 1:
            before = ladder.iloc[-2]
            sizes = np.log(max(before[POSITION], np.finfo(float).tiny) / max(last[POSITION], np.finfo(float).tiny))
            order = float(sizes / abs(np.log(before["step"] / last["step"])))
        best = ladder[POSITION].idxmin()
        yield End(variant, last["parameter"], best, ladder.index[-1], float(ladder.loc[best, POSITION]), float(ladder.loc[best, "step"]), order, _limit(ladder, last["parameter"], order))


def _limit(ladder: pd.DataFrame, parameter: str, order: float) -> str:
    if (ladder[POSITION] <= FLOOR * ladder[UNCERTAINTY]).any():
        return TRUTH
    if np.isnan(order):
        return UNKNOWN
    if parameter == "iterations":
        return SOLVER if order >= FALLS else INTEGRATION
    return INTEGRATION if order >= FALLS else MODEL
