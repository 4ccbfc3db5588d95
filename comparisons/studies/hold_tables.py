"""Tables of the study `hold`: the creep of each method, the laws of creep, and the effect of settings.

Each function takes the table of all runs, which has one row per run, and returns one of the other tables.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import at_equal_step, succeeded, with_columns
from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.bench.variants import COEFFICIENTS, OWN_CPU
from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.comparisons.studies.hold_data import FORMS, Law, load_data
from stiction.comparisons.studies.settings import DEFAULT, SETTING, SUBJECT
from stiction.engines.status import UNMADE
from stiction.uncertain import Uncertain

# Tests, the values of the column `TEST`.
HELD = "held"
"""A constant load below the limit of static friction."""
RAMP = "ramp"
"""A load that increases slowly beyond the limit."""
STOP = "stop"
"""A slider with an initial velocity, which must stop under a load below the limit."""

# Columns of the table of runs.
TEST = "test"
LOAD = "load"
"""Load as a fraction of the limit; of a ramp, the load at its beginning."""
CHANGED = "changed"
"""Name of the setting that a run changes; none for the default."""
CREEP = "creep"
"""Steady slip velocity under a load that should be held, m/s."""
UNSURE = "creep_uncertainty"
PART = "bound_fraction"
"""Friction as a fraction of mu times the corner forces."""
LETS_GO = "lets_go"
"""True if the slider breaks away."""
OF_STEP = "creep_per_g_dt"
"""Creep divided by the acceleration due to gravity times the step."""
OF_ZONE = "creep_per_regularization"
"""Creep divided by the speed at which the engine regularizes friction."""
LANDED = "landing"
"""Displacement while the slider settles on its contacts, m."""
BREAK_AWAY = "break_away_error"
"""Load at which the slider breaks away under a ramp, less that of the truth, as a fraction of the limit."""
BREAK_UNSURE = "break_away_uncertainty"
BOUND = "bound"
"""``≥`` or ``≤`` if the break-away error is only a bound of the true one."""
FASTER = "acceleration_error"
"""Relative error of the acceleration after the break-away."""
STOPPED = "stop_error"
"""Error of the position at which the slider stops, m."""
STOP_UNSURE = "stop_uncertainty"

# Columns of the tables of methods, laws and settings.
HOLDS = "holds"
SLOWER = "creep_ratio"
"""Creep divided by that with the default settings."""
TIME = "time_ratio"
"""Engine time divided by that with the default settings."""
TIME_LOW = f"{TIME}, low"
TIME_HIGH = f"{TIME}, high"
FOUND = "found"
"""Exponent or ratio that the runs have, to be compared with the law."""
FOUND_UNSURE = "found_uncertainty"

STILL = 1e-9
"""Largest creep of a method that holds, m/s: 32 mm in a year."""
SURE = 2.0
"""Number of uncertainties by which a creep must exceed `STILL` to be called creep. Each uncertainty is half a 95 %
interval, and the largest of a dozen runs at rest exceeds one of them."""
USUAL = 0.9
"""Largest load, as a fraction of the limit, by which a method is judged. At larger loads, small errors of the limit
decide the result."""
BAND = {"exponent": 0.2, "ratio": 0.01}
"""Largest difference from a law that is obeyed, including the uncertainty. Other exponents in question are 0, 1/2 and
2. Of a predicted creep, 1 % is left for what has not settled when the measurement begins."""

OBEYED = "obeyed"
BROKEN = "broken"
OPEN = "inconclusive"
REST = "none: it rests"
"""What the creep of the reference increases with, according to its law."""


def certainly_moves(runs: pd.DataFrame) -> pd.Series:
    """Test which runs certainly creep, or break away."""
    return (runs[CREEP].abs() > STILL + SURE * runs[UNSURE]) | runs[LETS_GO].eq(True)


def fastest_run(runs: pd.DataFrame) -> Any:
    """Return the label of the run whose creep represents all of them.

    It is the fastest of those that certainly move. If none does, it is the run with the largest bound of its creep,
    where a creep of exactly 0, which does not exceed its rounding, counts as rest.
    """
    speed = runs[CREEP].abs()
    speed_of_moving = speed[certainly_moves(runs)]
    if len(speed_of_moving):
        return speed_of_moving.idxmax()
    bound = (speed + runs[UNSURE]).where(speed > 0, 0.0)
    return bound.idxmax()


def methods_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per method, of its runs at the step nearest to `COMMON_STEP` and loads up to `USUAL`.

    Parameters
    ----------
    table
        All runs.

    Returns
    -------
    DataFrame
        `HOLDS` is True if every load is held with a creep of at most `STILL`, and None if uncertainties or failed runs
        leave this open. `CREEP`, `UNSURE`, `LETS_GO` and `OF_ZONE` are those of the `fastest_run`, ``scene`` and
        `LOAD` its scene and load. ``failed`` is the number of failed runs.
    """
    own = with_columns(table, CREEP, UNSURE, LETS_GO, OF_ZONE)
    is_held = own[SUBJECT].isna() & own[TEST].eq(HELD) & ~own["status"].isin(UNMADE)
    own = own[is_held]
    rows = []
    for variant in own["variant"].unique():
        runs = at_equal_step(own, variant)
        runs = runs[runs[LOAD] <= USUAL]
        if not runs.empty:
            rows.append(_method_row(runs))
    names = ["variant", "engine", "fidelity", COEFFICIENTS, "failed", HOLDS, LETS_GO, "scene"]
    return pd.DataFrame(rows, columns=[*names, LOAD, CREEP, UNSURE, OF_ZONE])


def _method_row(runs: pd.DataFrame) -> dict[str, Any]:
    """Return the row of a method; it has no creep if all of its runs failed."""
    made = runs[succeeded(runs) & runs[CREEP].notna()]
    row = {
        **runs.iloc[0][["variant", "engine", "fidelity", COEFFICIENTS]],
        "failed": len(runs) - len(made),
    }
    if made.empty:
        return row
    worst = made.loc[fastest_run(made)]
    return row | {
        HOLDS: _holds(made, has_failed_runs=len(made) < len(runs)),
        LETS_GO: worst[LETS_GO],
        "scene": worst["scene"],
        LOAD: worst[LOAD],
        CREEP: abs(worst[CREEP]),
        UNSURE: worst[UNSURE],
        OF_ZONE: worst[OF_ZONE],
    }


def _holds(made: pd.DataFrame, has_failed_runs: bool) -> bool | None:
    """Return whether all loads are held; None if uncertainties or failed runs leave this open."""
    if certainly_moves(made).any():
        return False
    may_move = (made[CREEP].abs() + made[UNSURE] > STILL).any()
    # A run that failed shows neither rest nor creep.
    if may_move or has_failed_runs:
        return None
    return True


def laws_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per law of creep: what the runs have, and whether they obey the law.

    The law of the reference, exact rest, is the first row.

    Parameters
    ----------
    table
        All runs. A law is tested by the runs with default settings and those that change the setting of the law. Runs
        whose creep is within its uncertainty are left out: rounding obeys no law.
    """
    with_all = with_columns(table, CREEP, UNSURE, SETTING, PART)
    held = with_all[with_all[TEST].eq(HELD)]
    rows = []
    reference_runs = held[held["variant"] == REFERENCE]
    if succeeded(reference_runs).any():
        rows.append(_reference_row(reference_runs))
    made = held[succeeded(held)]
    creeping = made[made[CREEP].abs() > made[UNSURE]]
    for law in load_data().laws:
        runs = _runs_of_law(creeping, law)
        if not runs.empty:
            rows.append(_law_row(runs, law))
    return pd.DataFrame(
        rows,
        columns=[SUBJECT, "over", "kind", "law", "source", "runs", FOUND, FOUND_UNSURE, "verdict"],
    )


def _reference_row(runs: pd.DataFrame) -> dict[str, Any]:
    """Return the row of the reference, which must rest exactly."""
    is_made = succeeded(runs)
    if runs[CREEP].fillna(0.0).ne(0).any():
        word = BROKEN
    elif is_made.all():
        word = OBEYED
    else:
        word = OPEN
    return {
        SUBJECT: REFERENCE,
        "over": REST,
        "source": "derived in each scene",
        "runs": int(is_made.sum()),
        "verdict": word,
    }


def _runs_of_law(creeping: pd.DataFrame, law: Law) -> pd.DataFrame:
    """Return the runs that test a law, with the value of its setting in a column ``over``."""
    runs = creeping[creeping[SUBJECT] == law.subject]
    runs = runs[(runs[SETTING] == DEFAULT) | runs[CHANGED].eq(law.over)]
    values = [json.loads(settings).get(law.over) for settings in runs["settings"]]
    runs = runs.assign(over=values)
    return runs[runs["over"] >= law.least]


def _law_row(runs: pd.DataFrame, law: Law) -> dict[str, Any]:
    """Return the row of a law, which predicts either the exponent over its setting or the creep itself."""
    if law.form is not None:
        kind, expected = "ratio", 1.0
        measured: Uncertain | None = _farthest_ratio(runs, law.form)
    else:
        assert law.exponent is not None  # a law has one of both
        kind, expected = "exponent", law.exponent
        measured = _exponent(runs)
    return {
        SUBJECT: law.subject,
        "over": law.over,
        "kind": kind,
        "law": expected,
        "source": law.source,
        "runs": len(runs),
        FOUND: None if measured is None else measured.value,
        FOUND_UNSURE: None if measured is None else measured.uncertainty,
        "verdict": verdict(measured, expected, BAND[kind]),
    }


def _farthest_ratio(runs: pd.DataFrame, form: str) -> Uncertain:
    """Return that ratio of creep to the prediction of a form which is farthest from 1."""
    predicted = FORMS[form](runs[PART].to_numpy(float), runs["over"].to_numpy(float))
    ratios = runs[CREEP].abs().to_numpy(float) / predicted
    uncertainties = runs[UNSURE].to_numpy(float) / predicted
    farthest = int(np.abs(ratios - 1).argmax())
    return Uncertain(float(ratios[farthest]), float(uncertainties[farthest]))


def _exponent(runs: pd.DataFrame) -> Uncertain | None:
    """Return the exponent of creep over the setting, fitted to all scenes and loads; None without several settings."""
    series = [
        (group["over"].to_numpy(float), group[CREEP].abs().to_numpy(float))
        for _, group in runs.groupby(["scene", LOAD], sort=False)
        if group["over"].nunique() > 1
    ]
    return fitted_exponent(series) if series else None


def verdict(measured: Uncertain | None, law: float, band: float) -> str:
    """Return whether a measured exponent or ratio obeys its law.

    The law is obeyed if the interval of the measured value is within `band` of it, broken if the interval is outside,
    and otherwise the result is `OPEN`.
    """
    if measured is None or math.isnan(measured.value):
        return OPEN
    difference = abs(measured.value - law)
    if difference + measured.uncertainty <= band:
        return OBEYED
    if difference - measured.uncertainty > band:
        return BROKEN
    return OPEN


def settings_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per setting of each method whose settings are varied.

    A setting is compared with the default on the scenes and loads at which both succeeded. `CREEP` is that of the
    `fastest_run`, `SLOWER` its ratio to that of the default, `TIME` the median ratio of the engine times, `TIME_LOW`
    and `TIME_HIGH` the ends of its interval. ``failed`` is the number of failed runs.
    """
    tried = with_columns(table, CREEP, UNSURE, LETS_GO)
    tried = tried[tried[SUBJECT].notna() & ~tried["status"].isin(UNMADE)]
    rows = []
    for _, runs in tried.groupby(SUBJECT, sort=False):
        for setting in runs[SETTING].unique():
            rows.append(_setting_row(runs, setting))
    names = [SUBJECT, SETTING, "failed", CREEP, UNSURE, SLOWER, TIME, TIME_LOW, TIME_HIGH]
    return pd.DataFrame(rows, columns=names)


def _setting_row(runs: pd.DataFrame, setting: str) -> dict[str, Any]:
    """Return the row of a setting, from all runs of its method."""
    made = runs[succeeded(runs) & runs[CREEP].notna()].set_index(["scene", LOAD])
    changed = made[made[SETTING] == setting]
    default = made[made[SETTING] == DEFAULT]
    row = {
        SUBJECT: runs[SUBJECT].iloc[0],
        SETTING: setting,
        "failed": int((runs[SETTING] == setting).sum()) - len(changed),
    }
    shared = default.index.intersection(changed.index)
    if shared.empty:
        return row
    changed = changed.loc[shared]
    default = default.loc[shared]
    worst = changed.loc[fastest_run(changed)]
    creep = abs(worst[CREEP])
    default_creep = abs(default.at[fastest_run(default), CREEP])
    times = ratio_interval(changed[OWN_CPU].tolist(), default[OWN_CPU].tolist())
    return row | {
        CREEP: creep,
        UNSURE: worst[UNSURE],
        SLOWER: _creep_ratio(creep, default_creep),
        TIME: times.value,
        TIME_LOW: times.low,
        TIME_HIGH: times.high,
    }


def _creep_ratio(creep: float, default_creep: float) -> float:
    """Return the ratio of two creeps; 1 if both are 0, and NaN if only that of the default is."""
    if default_creep > 0:
        return creep / default_creep
    return 1.0 if creep == 0 else math.nan
