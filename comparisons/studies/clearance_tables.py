"""Tables of the study `clearance`: effects with their uncertainties, limits, and exponents of flights.

A number of a run is given if the last halving of the step changes it by at most `RESOLVED` of itself. Its uncertainty
is its range over the last three steps, plus the spread over perturbed starts. Otherwise it is missing, and the column
`UNRESOLVED` names it: the largest effort of a time-stepping method with impacts, for example, doubles as the step is
halved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.measures.corner_flights import Release
from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.engines.status import Status

CLEARANCE = "clearance"
"""Column: gap to each surface, m."""
RESTITUTION = "restitution"
"""Column: coefficient of restitution."""
START = "perturbed_start"
"""Column: number of a perturbed start; 0 for the start of the scene."""
EFFORT = "effort_share"
"""Column: mean size of the difference of the drive's effort from that of ideal joints, over the mean of the latter."""
POSITION = "slider_change"
"""Column: largest difference of a slider's displacement from that with ideal joints, m."""
UNRESOLVED = "unresolved"
"""Column: names of the numbers that the steps do not resolve."""
QUANTITIES = (
    POSITION,
    EFFORT,
    "effort_rms",
    "effort_peak",
    "effort_peak_mean",
    "flight_share",
    "one_corner_share",
    "adjacent_share",
    "opposite_share",
    "largest_overlap",
    "impact_count",
    "impact_speed",
)
"""Columns of a run whose values are given only if the steps resolve them."""
RESOLVED = 0.25
"""Largest relative change by the last halving of the step for which a number counts as resolved.

For an effect that grows with the power 2/3 of the clearance, a change by 25 % moves the clearance of a given effect by
a factor of 1.25^(3/2) = 1.4.
"""
STEPS_OF_RANGE = 3
"""Number of the finest steps whose range of values is part of the uncertainty."""
LIMIT = "limit_clearance"
"""Column: clearance at which the change of the effort reaches the limit, m."""
LIMIT_LOW = "limit_clearance_low"
"""Column: clearance at which this change plus its uncertainty reaches the limit, m."""
LIMIT_HIGH = "limit_clearance_high"
"""Column: clearance at which this change minus its uncertainty reaches the limit, m."""
HAS_DRIVE = "has_drive"
"""Column: whether the scene has a drive whose effort can be compared, because that of ideal joints is not zero."""
WHY_NONE = "why_none"
"""Column: why there is no limit, no exponent or no measured flight."""
NO_EFFORT = "the scene has no drive, or its effort with ideal joints is zero"
"""Reason why there is no limit where no effort can be compared."""
EFFORT_EXPONENT = "effort_exponent"
"""Column: exponent of the change of the effort over the clearance."""
POSITION_EXPONENT = "slider_exponent"
"""Column: exponent of the change of the slider's position over the clearance."""
TIME_EXPONENT = "flight_time_exponent"
"""Column: exponent of the times of isolated flights over the clearance."""
SPEED_EXPONENT = "impact_speed_exponent"
"""Column: exponent of the impact speeds after isolated flights over the clearance."""
ISOLATED = 0.2
"""Crowding below which a flight counts as isolated: no other event of the ideal motion is nearer than five flights."""
MOST_MOBILIZED = 1.0
"""Largest mobilization for which the corner about which a slider turns stays at rest, as the law assumes."""


def uncertainty_of(column: str) -> str:
    """Return the column with the uncertainty of a quantity of `QUANTITIES` or of an exponent."""
    return f"{column}_uncertainty"


def effects_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene, method, restitution and clearance, with the numbers that the steps resolve.

    Scenes and methods keep the order of the runs; clearances descend.

    Parameters
    ----------
    runs : DataFrame
        One row per run, with the columns of `QUANTITIES` where it succeeded.
    """
    if runs.empty:
        return pd.DataFrame()
    # Rows of runs that are not made have no value in these columns; a table of such rows alone does not have them.
    lacking = [name for name in (CLEARANCE, "step", "cpu_time") if name not in runs]
    runs = runs.assign(**dict.fromkeys(lacking, math.nan))
    rows = [
        _effect_row(group)
        for _, group in runs.groupby(
            ["scene", "variant", RESTITUTION, CLEARANCE], sort=False, dropna=False
        )
    ]
    table = pd.DataFrame(rows)
    return table.sort_values(
        ["scene", "variant", RESTITUTION, CLEARANCE],
        ascending=[True, True, True, False],
        kind="stable",
        ignore_index=True,
        key=_sort_key,
    )


def _sort_key(column: pd.Series) -> pd.Series:
    """Return the values by which a column is sorted: names in order of appearance, numbers as they are."""
    if column.name in ("scene", "variant"):
        codes, _ = pd.factorize(column)
        return pd.Series(codes, index=column.index)
    return column


def _effect_row(group: pd.DataFrame) -> dict[str, Any]:
    """Return the row of the runs of one method with one gap; `group` contains all steps and starts."""
    succeeded = group[group["status"] == Status.OK]
    # Runs from the start of the scene, from the coarsest to the finest step.
    unperturbed = succeeded[succeeded[START] == 0].sort_values("step", ascending=False)
    finest = group.iloc[0] if unperturbed.empty else unperturbed.iloc[-1]
    row: dict[str, Any] = {
        name: finest[name]
        for name in ("scene", "variant", "engine", "fidelity", CLEARANCE, RESTITUTION, "step")
    }
    row |= {name: finest.get(name) for name in ("window_begin", "window_end")}
    row["runs"] = len(succeeded)
    row["cpu_time"] = finest.get("cpu_time")
    failed = group[group["status"] != Status.OK]
    row["status"], row["reason"] = Status.OK, ""
    if len(unperturbed) < 2:
        # The error of a number cannot be estimated from a single step.
        row["status"] = Status.FAILED if failed.empty else failed["status"].iloc[0]
        row["reason"] = "one step only" if failed.empty else failed["reason"].iloc[0]
        return row
    if not failed.empty:
        # The numbers are those of the other runs, so that their uncertainty contains fewer steps or starts.
        first_reason = failed["reason"].iloc[0]
        row["reason"] = f"{len(failed)} of {len(group)} runs failed: {first_reason}"
    unresolved = []
    for name in QUANTITIES:
        if name not in unperturbed or unperturbed[name].isna().any():
            continue
        value, uncertainty = _resolved_value(unperturbed[name].to_numpy(float))
        if math.isnan(value):
            unresolved.append(name)
        else:
            uncertainty += _spread(succeeded, name)
        row[name], row[uncertainty_of(name)] = value, uncertainty
    row[UNRESOLVED] = ", ".join(unresolved)
    return row


def _resolved_value(values: np.ndarray) -> tuple[float, float]:
    """Return the value at the finest step and its range over the last steps; NaNs if the steps do not resolve it.

    `values` are ordered from the coarsest to the finest step.
    """
    finest = float(values[-1])
    if abs(finest - values[-2]) > RESOLVED * abs(finest):
        return math.nan, math.nan
    return finest, float(np.ptp(values[-STEPS_OF_RANGE:]))


def _spread(succeeded: pd.DataFrame, name: str) -> float:
    """Return the largest change of a number by a perturbed start, at the step of that start; 0 without such starts."""
    spread = 0.0
    for _, runs in succeeded.groupby("step"):
        unperturbed = runs.loc[runs[START] == 0, name]
        perturbed = runs.loc[runs[START] != 0, name]
        if len(unperturbed) and len(perturbed):
            spread = max(spread, float(np.max(np.abs(perturbed - unperturbed.iloc[0]))))
    return spread


@dataclass(frozen=True)
class Crossing:
    """The clearance at which an effect reaches a limit.

    Attributes
    ----------
    clearance, low, high : float
        The clearance, and the ends of its interval, m; NaN if it is not determined.
    why_none : str
        Why it is not determined; empty otherwise.
    """

    clearance: float = math.nan
    low: float = math.nan
    high: float = math.nan
    why_none: str = ""


def crossing(
    clearances: Sequence[float],
    effects: Sequence[float],
    uncertainties: Sequence[float],
    limit: float,
) -> Crossing:
    """Return the smallest clearance at which an effect reaches a limit.

    Between two clearances of the grid the effect is interpolated by the power law through both. At the lower end of the
    interval the effect plus its uncertainty reaches the limit, at the upper end the effect minus its uncertainty.

    Parameters
    ----------
    clearances : sequence of float
        Ascending, m.
    effects, uncertainties : sequence of float
        The effect at each clearance, and its uncertainty; NaN where it is not resolved.
    limit : float
        The limit, in the unit of the effect.
    """
    c = np.asarray(clearances, dtype=float)
    effect = np.asarray(effects, dtype=float)
    uncertainty = np.asarray(uncertainties, dtype=float)
    if not len(c):
        return Crossing(why_none="no run succeeded")
    upper = effect + uncertainty
    lower = np.maximum(effect - uncertainty, 0.0)
    # Only clearances up to the first at which the effect is certainly above the limit matter.
    above = np.flatnonzero(lower >= limit)
    end = int(above[0]) + 1 if len(above) else len(c)
    unresolved = np.flatnonzero(np.isnan(effect[:end]))
    if len(unresolved):
        return Crossing(why_none=f"not resolved at a clearance of {c[unresolved[0]]:g} m")
    if upper[0] >= limit:
        return Crossing(
            why_none=f"at the smallest clearance, {c[0]:g} m, the effect is not certainly below the limit"
        )
    if not len(above):
        return Crossing(
            why_none=f"at the largest clearance, {c[-1]:g} m, the effect is not certainly above the limit"
        )
    return Crossing(
        _first_crossing(c[:end], effect[:end], limit),
        _first_crossing(c[:end], upper[:end], limit),
        _first_crossing(c[:end], lower[:end], limit),
    )


def _first_crossing(clearances: np.ndarray, effects: np.ndarray, limit: float) -> float:
    """Return the smallest clearance at which an effect reaches a limit, by power laws between the points.

    The first effect is below the limit, and the last one is not.
    """
    end = int(np.argmax(effects >= limit))
    # An effect of zero has no logarithm; in the limit of small effects the power law is a step at the larger clearance.
    if effects[end - 1] <= 0.0:
        return float(clearances[end])
    x = np.log(clearances[end - 1 : end + 1])
    y = np.log(effects[end - 1 : end + 1])
    part = (math.log(limit) - y[0]) / (y[1] - y[0])
    return float(np.exp(x[0] + part * (x[1] - x[0])))


def limits_table(effects: pd.DataFrame, limit: float) -> pd.DataFrame:
    """Return one row per scene, method and restitution: the clearance at the limit, and exponents of effects.

    The rows of scenes without a drive, and of methods without results, contain the reason why there is no clearance.

    Parameters
    ----------
    effects : DataFrame
        The table by `effects_table`.
    limit : float
        Relative change of the mean effort of the drive.
    """
    rows = []
    for (scene, variant, restitution), group in _groups(effects, ["scene", "variant", RESTITUTION]):
        ordered = group.sort_values(CLEARANCE)
        succeeded = ordered[ordered["status"] == Status.OK]
        row: dict[str, Any] = {
            "scene": scene,
            "variant": variant,
            RESTITUTION: restitution,
            "effect_limit": limit,
            "status": Status.OK if len(succeeded) else ordered["status"].iloc[0],
            "reason": "" if len(succeeded) else ordered["reason"].iloc[0],
        }
        if succeeded.empty:
            rows.append({**row, HAS_DRIVE: False, WHY_NONE: row["reason"]})
            continue
        for name in ("window_begin", "window_end"):
            row[name] = succeeded[name].iloc[0]
        row |= _limit_columns(succeeded, limit)
        for name, exponent in ((EFFORT, EFFORT_EXPONENT), (POSITION, POSITION_EXPONENT)):
            row |= _exponent_columns(succeeded, name, exponent)
        rows.append(row)
    return pd.DataFrame(rows)


def _groups(table: pd.DataFrame, by: list[str]) -> Iterator[tuple[Any, pd.DataFrame]]:
    """Yield the groups of a table; none of an empty table, which does not have the columns."""
    if not table.empty:
        yield from table.groupby(by, sort=False, dropna=False)


def _limit_columns(succeeded: pd.DataFrame, limit: float) -> dict[str, Any]:
    """Return the columns of the clearance at which the effort reaches a limit; rows have ascending clearances."""
    # The effort is missing without a drive, but also where the steps do not resolve it.
    is_unresolved = any(EFFORT in names.split(", ") for names in succeeded[UNRESOLVED])
    if EFFORT not in succeeded or (succeeded[EFFORT].isna().all() and not is_unresolved):
        return {HAS_DRIVE: False, WHY_NONE: NO_EFFORT}
    limit_crossing = crossing(
        succeeded[CLEARANCE].to_list(),
        succeeded[EFFORT].to_list(),
        succeeded[uncertainty_of(EFFORT)].to_list(),
        limit,
    )
    return {
        HAS_DRIVE: True,
        LIMIT: limit_crossing.clearance,
        LIMIT_LOW: limit_crossing.low,
        LIMIT_HIGH: limit_crossing.high,
        WHY_NONE: limit_crossing.why_none,
    }


def _exponent_columns(rows: pd.DataFrame, name: str, exponent: str) -> dict[str, float]:
    """Return an exponent over the clearance and its uncertainty; empty where too few rows have the quantity.

    The uncertainty is half the interval of the fit, plus the largest change of the fitted slope if each point moves
    within its own uncertainty. Points whose interval contains zero are left out: they fit any power.
    """
    if name not in rows:
        return {}
    significant = rows[rows[name].gt(rows[uncertainty_of(name)])]
    clearances = significant[CLEARANCE].to_numpy(float)
    sizes = significant[name].to_numpy(float)
    fit = fitted_exponent([(clearances, sizes)])
    if fit is None:
        return {}
    # The slope is the sum of x log(size) over that of x^2, so that a point moves it by |x| times its relative change.
    x = np.log(clearances) - np.log(clearances).mean()
    relative = significant[uncertainty_of(name)].to_numpy(float) / sizes
    by_points = float(np.sum(np.abs(x) * relative) / (x @ x))
    return {exponent: fit.value, uncertainty_of(exponent): fit.uncertainty + by_points}


def exponents_table(flights: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene and method: exponents over the clearance of the flights by `isolated_flights`.

    All flights of a method on a scene have the same exponent, and each has a constant of its own.
    """
    rows = []
    for (scene, variant), group in _groups(flights, ["scene", "variant"]):
        row: dict[str, Any] = {"scene": scene, "variant": variant, "flights": 0}
        measured = isolated_flights(group)
        if measured.empty:
            rows.append({**row, WHY_NONE: "no isolated flight was measured"})
            continue
        series = [
            flight.sort_values(CLEARANCE)
            for _, flight in measured.groupby(["event_time", "joint", "corner"], sort=False)
            if flight[CLEARANCE].nunique() > 1
        ]
        row["flights"] = len(series)
        row["largest_time_deviation"] = float((measured["flight_time_ratio"] - 1.0).abs().max())
        row["largest_speed_deviation"] = float((measured["impact_speed_ratio"] - 1.0).abs().max())
        row[WHY_NONE] = "" if series else "one clearance only"
        for name, exponent in (("flight_time", TIME_EXPONENT), ("impact_speed", SPEED_EXPONENT)):
            if not series:
                break
            fit = fitted_exponent(
                [
                    (flight[CLEARANCE].to_numpy(float), flight[name].to_numpy(float))
                    for flight in series
                ]
            )
            if fit is None:
                row[WHY_NONE] = "too few measured flights for a fit"
            else:
                row[exponent], row[uncertainty_of(exponent)] = fit.value, fit.uncertainty
        rows.append(row)
    return pd.DataFrame(rows)


def isolated_flights(flights: pd.DataFrame) -> pd.DataFrame:
    """Return the measured flights to which the law of c^(1/3) applies, at the finest step of each clearance.

    They follow a zero of the force, their crowding is below `ISOLATED`, and their mobilization is at most
    `MOST_MOBILIZED`.
    """
    if "flight_time_ratio" not in flights:
        return flights.iloc[:0]
    applies = (
        flights["flight_time_ratio"].notna()
        & flights["release"].eq(Release.ZERO)
        & flights["crowding"].lt(ISOLATED)
        & flights["mobilization"].le(MOST_MOBILIZED)
    )
    chosen = flights[applies]
    finest = chosen.groupby(["scene", "variant", CLEARANCE])["step"].transform("min")
    return chosen[chosen["step"] == finest]
