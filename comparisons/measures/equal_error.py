"""Time to equal error, and what limits the error of each refinement series.

Engines are compared at equal error, not at equal step. Between neighbouring runs of a refinement series, coarse to
fine, log(time) is linear in log(error); nothing is extrapolated. A run meets an error only if neither its own error nor
the truth's uncertainty is above it. The interval of an interpolated time comes from the same interpolation in every
round of timing (`bench.timing.visits`): it has the spread of the times, not that of the errors, which
are the same in every run.

A series ends at its smallest error. `limit_of` finds its limit from the order with which the errors fall at the finest
runs, one order for all scenes together, with its interval (`order_of`):

- integration: the order is above zero with its whole interval, and on every scene the finest of these runs has a
  smaller error than the first: a finer one would go on; or the step is fixed and only iterations change;
- model: the order is below half of one with its whole interval, and bodies are in contact, with clearance or contacts
  that give way; or the engine's own accelerations under an integrator of high order end there too;
- adapter: the order is as low, but the engine's own accelerations lead further, or the adapter supplies the law of
  friction; or the quantity needs events, which the adapter does not locate;
- truth: the error is below the uncertainty of the truth, on every scene;
- inconclusive: all else, such as an interval that holds both zero and half of one.
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
"""The paper's cases, and mechanisms with a truth: a guide that moves, two guides with friction, a stiff spring."""
COARSEST = -2
"""Power of ten of the largest error of the table."""
INTEGRATION, MODEL, ADAPTER, TRUTH = "integration", "model", "adapter", "truth"
FAILED, UNKNOWN = "all runs failed", "inconclusive"
FALLS = 0.5
"""Order below which an error does not fall as that of any method does: half the lowest order of a method here."""
FINEST = 3
"""Number of the finest runs on each scene from which an order is found."""
FURTHER = 0.1
"""Ratio to a series' smallest error below which the engine's own accelerations lead further."""


@dataclass(frozen=True)
class Quantity:
    """A quantity with an error, columns of `stiction.comparisons.measures.accuracy.errors`.

    `without_events`: why a run that locates no events does not know the quantity; empty if it does.
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
SMALLEST = "smallest_error"
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
    """Limit of the error of a variant's refinement series.

    Attributes
    ----------
    because, why : str
        The limit, of the names of the module, and the evidence.
    order : Uncertain or None
        With which the error falls at the finest runs; None where that is not known.
    """

    because: str
    why: str
    order: Uncertain | None = None


def equal_error(runs: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Time to errors of 10^n, down to the first that a variant does not reach; a row per scene, variant and quantity.

    Parameters
    ----------
    runs, samples
        Table and samples of `stiction.comparisons.measures.work_precision.Timed`, of one scene or of several, whose
        limits are found together.

    Returns
    -------
    DataFrame
        `COLUMNS`: ``truth``, its name (that with mus = mu is another); ``quantity`` of `QUANTITIES`, ``error`` in its
        ``unit``; median and interval of the time to it, inside the engine's own calls and in total, empty where no run
        reaches it; their `LEVEL`, and `TIMING`, the reason why it is unsure; ``at most``: the coarsest run already
        meets it; `SMALLEST` error on this scene; over all scenes the fields of `Limit`.
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
    # Powers of ten from the largest error of all variants down to the smallest, whole powers beyond
    # both.
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
            # the first error that is not reached has a row; smaller ones are not reached either
            if not time:
                break


def _sizes(rows: pd.DataFrame, quantity: Quantity) -> pd.Series:
    """Errors, or their uncertainties where these are larger."""
    if quantity.error not in rows:
        return pd.Series(np.nan, rows.index)
    sizes = rows[[quantity.error, quantity.uncertainty]].astype(float).max(axis=1)
    return sizes.where(rows[quantity.error].notna())


def _smallest(rows: pd.DataFrame, quantity: Quantity) -> float:
    """The largest of all scenes of the smallest error on each; nan where no scene has an error."""
    return float(_sizes(rows, quantity).groupby(rows["scene"]).min().max())


def time_to(
    series: pd.DataFrame, samples: pd.DataFrame, quantity: Quantity, target: float
) -> dict[str, Any]:
    """Columns of the time at which a series, coarse to fine, meets an error first; none where it does not."""
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
    """Time to an error by round, `OWN_CPU` and `TOTAL`; for a ratio to another variant's of the same round."""
    rows = series[succeeded(series)]
    sizes, keys = _sizes(rows, quantity).to_numpy(), list(rows["key"])
    times = {
        key: part.set_index("round")[[OWN_CPU, TOTAL]]
        for key, part in samples[samples["key"].isin(keys)].groupby("key", sort=False)
    }
    # Runs that meet the error themselves.
    meetings = [times[key] for key, size in zip(keys, sizes) if size <= target and key in times]
    # Between neighbouring runs on either side of it: log(time) linear in log(error), round by
    # round.
    for i in range(1, len(keys)):
        if sizes[i - 1] > target > sizes[i] and {keys[i - 1], keys[i]} <= set(times):
            share = math.log(sizes[i - 1] / target) / math.log(sizes[i - 1] / sizes[i])
            interpolated = times[keys[i - 1]] ** (1 - share) * times[keys[i]] ** share
            # rounds that only one of the two has are empty
            meetings.append(interpolated.dropna())
    return min(meetings, key=lambda rounds: rounds[TOTAL].median(), default=None)


def accelerations_of(series: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame | None:
    """The runs of the same engine's accelerations under an integrator of high order; None where there are none."""
    first, rows = series.iloc[0], runs[succeeded(runs)]
    alike = (rows["engine"] == first["engine"]) & (rows["fidelity"] == first["fidelity"])
    rows = rows[alike & (rows["variant"] != first["variant"])]
    methods = [json.loads(settings).get("method") for settings in rows["settings"]]
    rows = rows[[method == "accelerations" for method in methods]]
    return rows if len(rows) else None


def limit_of(
    series: pd.DataFrame, quantity: Quantity, accelerations: pd.DataFrame | None = None
) -> Limit:
    """Find the limit of the error of a variant by the rules of the module, in their order.

    Parameters
    ----------
    series
        Rows of one variant as `work_precision` makes them, of one scene or of several, from coarse to fine.
    accelerations
        The yield of `accelerations_of`.
    """
    rows = series[succeeded(series)]
    if rows.empty:
        return Limit(FAILED, f"{series['status'].iloc[-1]}: {series['reason'].iloc[-1]}")
    # Without an error above the truth's uncertainty: no events, nothing to compare with, or as
    # exact as the truth.
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

    # By the order of the finest runs and its whole interval.
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
    because, why = _level(rows, quantity, accelerations, settings, f"does not fall: {evidence}")
    return Limit(because, why, order)


def _level(
    rows: pd.DataFrame,
    quantity: Quantity,
    accelerations: pd.DataFrame | None,
    settings: Mapping[str, Any],
    evidence: str,
) -> tuple[str, str]:
    """Return the limit of an error that does not fall, and the evidence."""
    if rows["fidelity"].iloc[0] == Fidelity.CONTACT:
        return MODEL, f"{evidence}; bodies in contact, with clearance or contacts that give way"
    # Is it the engine's model or our adapter? The engine's accelerations alone, integrated exactly,
    # tell.
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
    """Exponent with which the error falls with step or tolerance at the `FINEST` runs, or grows fewer with iterations.

    Errors that are not above the uncertainty of the truth are left out. None where the runs are too few.
    """
    order = fitted_exponent(_finest(rows, quantity))
    if order is None or rows["parameter"].iloc[0] != "iterations":
        return order
    return Uncertain(-order.value, order.uncertainty)


def _finest(rows: pd.DataFrame, quantity: Quantity) -> list[tuple[np.ndarray, np.ndarray]]:
    """The `FINEST` steps on each scene and their errors, coarse to fine, those above the truth's uncertainty."""
    sizes = _sizes(rows, quantity)
    known = rows[sizes > rows[quantity.uncertainty]] if quantity.error in rows else rows.iloc[:0]
    finest = [series.iloc[-FINEST:] for _, series in known.groupby("scene", sort=False)]
    return [(runs["step"].to_numpy(dtype=float), sizes[runs.index].to_numpy()) for runs in finest]
