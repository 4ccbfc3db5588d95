"""Where the ladder of a variant ends in its error of position, with the rows of the table that say so; why, by the rules of `stiction.comparisons.studies.equal_error`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.studies.equal_error import ADAPTER, INTEGRATION, MODEL, QUANTITIES, TRUTH, UNKNOWN, accelerations_end, ladder_end
from stiction.comparisons.studies.work_precision import came_out

QUANTITY = QUANTITIES[0]
POSITION, UNCERTAINTY = QUANTITY.error, QUANTITY.uncertainty
REASONS = {INTEGRATION: "falls up to the last rung, or what its fixed step leaves is all of it", MODEL: "does not fall any more: contacts, or the engine's own equations",
           ADAPTER: "does not fall any more: the law of friction, or the scheme, is the adapter's", TRUTH: "is not above what the truth is unsure by",
           UNKNOWN: "has a cause that these runs do not tell"}


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
        A key of `REASONS`.
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
    """The end of the ladder of every variant of a table of `stiction.comparisons.studies.work_precision` that came out."""
    if POSITION not in cost:
        return
    for _, scene in cost[came_out(cost) & cost[POSITION].notna()].groupby("scene", sort=False):
        ladders = [ladder for _, ladder in scene.groupby("variant", sort=False)]
        for ladder in ladders:
            last, best = ladder.iloc[-1], ladder[POSITION].idxmin()
            order = float("nan")
            if len(ladder) > 1:
                before = ladder.iloc[-2]
                sizes = np.log(max(before[POSITION], np.finfo(float).tiny) / max(last[POSITION], np.finfo(float).tiny))
                order = float(sizes / abs(np.log(before["step"] / last["step"])))
            yield End(last["variant"], last["parameter"], best, ladder.index[-1], float(ladder.loc[best, POSITION]), float(ladder.loc[best, "step"]), order,
                      ladder_end(ladder, QUANTITY, accelerations_end(ladder, ladders, QUANTITY)).because)
