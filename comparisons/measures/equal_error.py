"""Time to equal error, and what limits the error of each refinement series.

Engines are compared at equal error, not at equal step. The time to an error is interpolated between
neighbouring runs of a refinement series, linearly in log(time) and log(error); it is not
extrapolated. A run reaches an error if neither its own error nor the uncertainty of the truth is
larger. The interval of an interpolated time is that of its values in all rounds of timing
(`bench.timing.visits`). It accounts for the scatter of the times only, because the errors of a run
are the same in every round.

A series ends at its smallest error. `limit_of` determines what limits it from the observed order of
the finest runs, one order for all scenes together, and the confidence interval of this order
(`order_of`):

- integration: the whole interval is above zero, and on every scene the finest run has a smaller
  error than the first of the runs for the order, so that a finer run would have a smaller error; or
  the step is fixed and only the iterations change;
- model: the whole interval is below one half, and bodies are in contact, with clearance or
  compliance; or the engine's own accelerations, integrated with high order, do not lead to smaller
  errors either;
- adapter: the whole interval is below one half, but the engine's own accelerations lead to smaller
  errors, or the adapter supplies the friction law; or the quantity needs events, which the adapter
  does not locate;
- truth: the error is below the uncertainty of the truth on every scene;
- inconclusive: all other cases, for example an interval that contains both zero and one half.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import succeeded
from stiction.comparisons.bench.timing.intervals import median_interval
from stiction.comparisons.bench.timing.visits import doubt
from stiction.comparisons.bench.variants import OWN_CPU
from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.comparisons.measures.work_precision import (
    HIGH,
    LEVEL,
    LOW,
    TIMING,
    TOTAL,
    TOTAL_HIGH,
    TOTAL_LOW,
)
from stiction.engines.protocol import FRICTION_SUPPLIED_BY, Supplier
from stiction.scenes.fidelity import Fidelity
from stiction.uncertain import Uncertain

SCENES = (
    "slider-bar-case-1",
    "slider-bar-case-2",
    "slider-bar-case-3",
    "slider-on-moving-guide",
    "elliptic-trammel",
    "hard/stiff-spring",
)
"""The paper's cases, and mechanisms with a truth: a guide that moves, two guides with friction, a
stiff spring."""
COARSEST = -2
"""Exponent of the largest error of the table, a power of ten, unless all errors are larger."""
INTEGRATION = "integration"
"""Limit of an error, see the module."""
MODEL = "model"
"""Limit of an error, see the module."""
ADAPTER = "adapter"
"""Limit of an error, see the module."""
TRUTH = "truth"
"""Limit of an error, see the module."""
FAILED = "all runs failed"
"""Instead of the limit of an error."""
UNKNOWN = "inconclusive"
"""Limit of an error, see the module."""
FALLS = 0.5
"""Order below which the step does not limit the error: half the lowest order of all methods."""
FINEST = 3
"""Number of the finest runs on each scene from which the order is computed."""
FURTHER = 0.1
"""Ratio of the errors with the engine's own accelerations and in a series below which the former
are much smaller."""


@dataclass(frozen=True)
class Quantity:
    """A quantity whose error is to be reached.

    Attributes
    ----------
    name : str
    error, uncertainty : str
        Columns of `stiction.comparisons.measures.accuracy.errors`.
    unit : str
    without_events : str
        Why the error is unknown in runs that do not locate events; empty if it is known.
    """

    name: str
    error: str
    uncertainty: str
    unit: str
    without_events: str = ""


QUANTITIES = (
    Quantity("position", "position_error", "position_uncertainty", "m"),
    Quantity(
        "torque",
        "torque_error",
        "torque_uncertainty",
        "N m",
        "between two output instants it is not known when it jumps",
    ),
    Quantity(
        "event time",
        "event_time_error",
        "event_time_uncertainty",
        "s",
        "there is nothing to compare",
    ),
)
"""The quantities whose errors are compared."""
SMALLEST = "smallest_error"
"""Column: smallest error of a series."""
COLUMNS = (
    "scene",
    "truth",
    "fidelity",
    "variant",
    "engine",
    "quantity",
    "error",
    "unit",
    OWN_CPU,
    LOW,
    HIGH,
    TOTAL,
    TOTAL_LOW,
    TOTAL_HIGH,
    LEVEL,
    TIMING,
    "is_bound",
    SMALLEST,
    "because",
    "why",
    "order",
    "order_uncertainty",
)
"""Columns of `equal_error`."""


@dataclass(frozen=True)
class Limit:
    """What limits the error of a variant's refinement series.

    Attributes
    ----------
    because : str
        The limit, see the module.
    why : str
        The evidence in words.
    order : Uncertain or None
        Observed order of the finest runs; None if it is unknown.
    """

    because: str
    why: str
    order: Uncertain | None = None


def equal_error(runs: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Return the table of times to errors of 10^n, down to the first error that a variant does not reach.

    Parameters
    ----------
    runs, samples : DataFrame
        Table and samples of `stiction.comparisons.measures.work_precision.Timed`, of one or several
        scenes. Limits are determined for all scenes together.

    Returns
    -------
    DataFrame
        One row for each scene, quantity, variant and error, with `COLUMNS`: ``truth``, its name;
        ``quantity``, one of `QUANTITIES`; ``error``, in its ``unit``; median and interval of the
        time to this error, in the engine's own calls and in total, empty if it is not reached;
        `LEVEL` and `TIMING`; ``is_bound``, True if the coarsest run already reaches the error, so
        that the time is an upper bound; `SMALLEST` error on this scene; and the fields of `Limit`.
    """
    limits = {
        (quantity.name, variant): limit_of(series, quantity, accelerations_of(series, runs))
        for quantity in QUANTITIES
        for variant, series in runs.groupby("variant", sort=False)
    }
    rows = [
        row
        for _, runs_of_scene in runs.groupby("scene", sort=False)
        for quantity in QUANTITIES
        for row in _rows(runs_of_scene, samples, quantity, limits)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(
    runs: pd.DataFrame,
    samples: pd.DataFrame,
    quantity: Quantity,
    limits: Mapping[tuple[str, str], Limit],
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one scene and quantity."""
    # The errors are powers of ten from the largest to the smallest error of all variants.
    sizes = _sizes(runs[succeeded(runs)], quantity)
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    if sizes.empty:
        return
    coarsest = min(COARSEST, math.floor(math.log10(sizes.max())))
    targets = [
        float(f"1e{power}") for power in range(coarsest, math.ceil(math.log10(sizes.min())) - 1, -1)
    ]
    for variant, series in runs.groupby("variant", sort=False):
        limit = limits[quantity.name, variant]
        truths = series["truth"].dropna() if "truth" in series else ()
        order = limit.order or Uncertain(math.nan, math.nan)
        columns = {
            **series.iloc[0][["scene", "fidelity", "variant", "engine"]],
            "truth": next(iter(truths), None),
            "quantity": quantity.name,
            "unit": quantity.unit,
            SMALLEST: _smallest(series[succeeded(series)], quantity),
            "because": limit.because,
            "why": limit.why,
            "order": order.value,
            "order_uncertainty": order.uncertainty,
        }
        for target in targets:
            time = time_to(series, samples, quantity, target)
            yield columns | {"error": target} | time
            # The first error that is not reached still has a row.
            if not time:
                break


def _sizes(rows: pd.DataFrame, quantity: Quantity) -> pd.Series:
    """Return the errors, or their uncertainties if these are larger; nan without an error."""
    if quantity.error not in rows:
        return pd.Series(np.nan, rows.index)
    sizes = rows[[quantity.error, quantity.uncertainty]].astype(float).max(axis=1)
    return sizes.where(rows[quantity.error].notna())


def _smallest(rows: pd.DataFrame, quantity: Quantity) -> float:
    """Return the smallest error on each scene, and of these the largest; nan if there are no errors."""
    return float(_sizes(rows, quantity).groupby(rows["scene"]).min().max())


def time_to(
    series: pd.DataFrame, samples: pd.DataFrame, quantity: Quantity, target: float
) -> dict[str, Any]:
    """Return the columns of the shortest time in which a series reaches an error; empty if it does not reach it."""
    rounds = rounds_to(series, samples, quantity, target)
    if rounds is None:
        return {}
    own, total = (median_interval(rounds[name]) for name in (OWN_CPU, TOTAL))
    coarsest = _sizes(series[succeeded(series)], quantity).iloc[0]
    return {
        OWN_CPU: own.value,
        LOW: own.low,
        HIGH: own.high,
        TOTAL: total.value,
        TOTAL_LOW: total.low,
        TOTAL_HIGH: total.high,
        LEVEL: own.level,
        TIMING: doubt(total),
        "is_bound": bool(coarsest <= target),
    }


def rounds_to(
    series: pd.DataFrame, samples: pd.DataFrame, quantity: Quantity, target: float
) -> pd.DataFrame | None:
    """Return the shortest time in which a series reaches an error, by round; None if it does not reach it.

    The columns are `OWN_CPU` and `TOTAL`, in s. Ratios of two variants are computed from the times
    of the same round.
    """
    rows = series[succeeded(series)]
    sizes, keys = _sizes(rows, quantity).to_numpy(), list(rows["key"])
    times = {
        key: part.set_index("round")[[OWN_CPU, TOTAL]]
        for key, part in samples[samples["key"].isin(keys)].groupby("key", sort=False)
    }
    # Runs whose error is small enough.
    candidates = [times[key] for key, size in zip(keys, sizes) if size <= target and key in times]
    # Interpolation in logarithms between neighbouring runs with a larger and a smaller error, in
    # each round. Rounds in which only one of them was timed become nan.
    for i in range(1, len(keys)):
        coarse, fine = keys[i - 1], keys[i]
        if sizes[i - 1] > target > sizes[i] and coarse in times and fine in times:
            share = math.log(sizes[i - 1] / target) / math.log(sizes[i - 1] / sizes[i])
            interpolated = times[coarse] ** (1 - share) * times[fine] ** share
            candidates.append(interpolated.dropna())
    return min(candidates, key=lambda rounds: rounds[TOTAL].median(), default=None)


def accelerations_of(series: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame | None:
    """Return the runs in which the same engine's accelerations are integrated with high order; None if missing."""
    first, rows = series.iloc[0], runs[succeeded(runs)]
    alike = (rows["engine"] == first["engine"]) & (rows["fidelity"] == first["fidelity"])
    rows = rows[alike & (rows["variant"] != first["variant"])]
    methods = [json.loads(settings).get("method") for settings in rows["settings"]]
    rows = rows[[method == "accelerations" for method in methods]]
    return rows if len(rows) else None


def limit_of(
    series: pd.DataFrame, quantity: Quantity, accelerations: pd.DataFrame | None = None
) -> Limit:
    """Return what limits the error of a variant, by the rules in the module.

    Parameters
    ----------
    series : DataFrame
        Rows of one variant in the table of `work_precision`, for one or several scenes, from coarse
        to fine.
    quantity : Quantity
    accelerations : DataFrame, optional
        Result of `accelerations_of`.
    """
    rows = series[succeeded(series)]
    if rows.empty:
        return Limit(FAILED, f"{series['status'].iloc[-1]}: {series['reason'].iloc[-1]}")
    # Cases without an error above the uncertainty of the truth.
    sizes = _sizes(rows, quantity).dropna()
    locates = "events_matched" in rows and rows["events_matched"].notna().any()
    best = sizes.groupby(rows["scene"]).idxmin()
    at_the_truth = len(best) > 0 and (sizes[best] == rows.loc[best, quantity.uncertainty]).all()
    if (sizes.empty or at_the_truth) and quantity.without_events and not locates:
        return Limit(ADAPTER, f"locates no events: {quantity.without_events}")
    if sizes.empty:
        return Limit(UNKNOWN, "nothing to compare with")
    if at_the_truth:
        return Limit(TRUTH, "not above the uncertainty of the truth")
    order = order_of(rows, quantity)
    if order is None:
        return Limit(UNKNOWN, "too few runs for an order with an interval")

    # Cases by the confidence interval of the order.
    parameter = rows["parameter"].iloc[0]
    low, high = order.value - order.uncertainty, order.value + order.uncertainty
    evidence = (
        f"order {order.value:.2g} ± {order.uncertainty:.1g} in {parameter} at the finest runs"
    )
    falls_everywhere = all(errors[-1] < errors[0] for _, errors in _finest(rows, quantity))
    if high >= FALLS and low > 0 and falls_everywhere:
        return Limit(INTEGRATION, f"still falls: {evidence}", order)
    settings = json.loads(rows["settings"].iloc[-1])
    if parameter == "iterations":
        return Limit(
            INTEGRATION,
            f"does not fall with {parameter}: its step of {settings['dt']:g} s is fixed",
            order,
        )
    if high >= FALLS:
        return Limit(UNKNOWN, evidence, order)
    because, why = _limit_of_constant(
        rows, quantity, accelerations, settings, f"does not fall: {evidence}"
    )
    return Limit(because, why, order)


def _limit_of_constant(
    rows: pd.DataFrame,
    quantity: Quantity,
    accelerations: pd.DataFrame | None,
    settings: Mapping[str, Any],
    evidence: str,
) -> tuple[str, str]:
    """Return what limits an error that does not decrease with the step, and the evidence in words."""
    if rows["fidelity"].iloc[0] == Fidelity.CONTACT:
        return MODEL, f"{evidence}; bodies in contact, with clearance or contacts that give way"
    # The engine's accelerations, integrated with high order, distinguish engine and adapter: they
    # contain the errors of the engine's model, but not those of the adapter.
    if accelerations is not None:
        stepped = _smallest(rows[rows["scene"].isin(accelerations["scene"])], quantity)
        exact = _smallest(accelerations[accelerations["scene"].isin(rows["scene"])], quantity)
        if exact < FURTHER * stepped:
            lead = f"the engine's accelerations lead to {exact:.1g} {quantity.unit}"
            return ADAPTER, f"{evidence}; {lead}"
        if np.isfinite(exact):
            under = "the engine's accelerations under an integrator of high order"
            return MODEL, f"{evidence}; {under} end at {exact:.1g} {quantity.unit}"
    if settings.get(FRICTION_SUPPLIED_BY) in (Supplier.ADAPTER, Supplier.BOTH):
        return ADAPTER, f"{evidence}; {settings['friction_law']}"
    return UNKNOWN, evidence


def order_of(rows: pd.DataFrame, quantity: Quantity) -> Uncertain | None:
    """Return the observed order of the `FINEST` runs; None if there are too few.

    It is the exponent of the step or tolerance, or minus the exponent of the number of iterations.
    Errors that are not above the uncertainty of the truth are left out.
    """
    order = fitted_exponent(_finest(rows, quantity))
    if order is None or rows["parameter"].iloc[0] != "iterations":
        return order
    return Uncertain(-order.value, order.uncertainty)


def _finest(rows: pd.DataFrame, quantity: Quantity) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the `FINEST` steps and their errors on each scene, of the runs with errors above the uncertainty."""
    sizes = _sizes(rows, quantity)
    known = rows[sizes > rows[quantity.uncertainty]] if quantity.error in rows else rows.iloc[:0]
    finest = [series.iloc[-FINEST:] for _, series in known.groupby("scene", sort=False)]
    return [(runs["step"].to_numpy(dtype=float), sizes[runs.index].to_numpy()) for runs in finest]
