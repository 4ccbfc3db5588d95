"""What a given error costs: time to it in position, torque and event time, along the ladder of every variant, and what limits each ladder.

Engines are compared at equal error, not at equal step. Between neighbouring rungs log(time) is linear in log(error); nothing is extrapolated. A rung meets an
error only if its own error, and what that is unsure by, are not above it. The interval of an interpolated time comes from the same interpolation in every round of timing
(`stiction.comparisons.timing.rounds`): it has the spread of the times, not that of the errors, which are the same in every run.

A ladder ends at its smallest error. The limit is decided by `ladder_end` from all scenes together. It takes the order with which the errors fall at the finest rungs,
one for all scenes, with its interval (`order_of`):

- integration: the order is above zero with its whole interval, and the error is smaller on every scene at the finest rung than at the first of these, so that a finer
  rung would go on; or the step is fixed and only iterations change;
- model: the order is below half of one with its whole interval, and the run is of bodies in contact, whose contacts have clearance or give way; or the engine's own
  accelerations under an integrator of high order end there too;
- adapter: the order is as low, but the engine's own accelerations lead further, or the law of friction is the adapter's; or the quantity needs events, which the
  adapter does not locate;
- truth: the error is below what the truth is unsure by, on every scene;
- inconclusive: all else, such as an interval that holds both zero and half of one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from stiction.comparisons.studies.work_precision import HIGH, LEVEL, LOW, came_out
from stiction.comparisons.timing.intervals import Interval, median_interval
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import OWN_CPU

SCENES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3", "slider-on-moving-guide", "elliptic-trammel", "hard/stiff-spring")
"""The paper's cases, and mechanisms with an independent truth: a guide that moves, two guides with friction, a stiff spring."""
COARSEST = -2
"""Power of ten of the largest error that is asked for."""
INTEGRATION, MODEL, ADAPTER, TRUTH, LOST, UNKNOWN = "integration", "model", "adapter", "truth", "no run came out", "inconclusive"
FALLS = 0.5
"""Order below which an error does not fall as that of any method does: half the lowest order that a method here has."""
FINEST = 3
"""Rungs of each scene, the finest ones, by which an order is found."""
LEVEL_OF_ORDER = 0.95
"""Probability of the interval of an order."""
FURTHER = 0.1
"""Of the error at which a ladder ends: what the engine's own accelerations must get below to be said to lead further."""


@dataclass(frozen=True)
class Quantity:
    """What an error is of: `error` and `uncertainty` are columns of `stiction.comparisons.measures.accuracy.errors`. `without_events`: what a run that locates no
    events cannot know of it."""

    name: str
    error: str
    uncertainty: str
    unit: str
    without_events: str = ""


COLUMNS = ("scene", "truth", "fidelity", "variant", "engine", "quantity", "error", "unit", OWN_CPU, LOW, HIGH, "cpu [s]", "cpu [s], low", "cpu [s], high", LEVEL,
           "at most", "ladder ends at", "because", "why", "order [-]", "order uncertainty [-]")
"""Of `equal_error`."""
QUANTITIES = (Quantity("position", "position error [m]", "position uncertainty [m]", "m"),
              Quantity("torque", "torque error, L1 mean [N m]", "torque uncertainty [N m]", "N m", "between two output instants it is not known when it jumps"),
              Quantity("event time", "event time error [s]", "event time uncertainty [s]", "s", "there is nothing to compare"))


@dataclass(frozen=True)
class Cost:
    """Time to an error, CPU seconds: inside the engine's own calls, and in total; `at_most`: the coarsest rung already meets it."""

    own: Interval
    total: Interval
    at_most: bool


@dataclass(frozen=True)
class LadderEnd:
    """Where the ladders of a variant end.

    Attributes
    ----------
    error : float
        The smallest error of each scene, of those the largest; nan where there is none.
    because, why : str
        The limit, of the names of the module, and how it is known.
    order : Uncertain or None
        With which the error falls at the finest rungs; None where that is not known.
    """

    error: float
    because: str
    why: str
    order: Uncertain | None = None


def equal_error(ladders: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Time to errors of 10^n: one row per scene, variant, quantity and error, down to the first that the variant does not reach.

    Parameters
    ----------
    ladders, samples
        Table and samples of `stiction.comparisons.studies.work_precision.Timed`, of one scene or of several, whose limits are found together.

    Returns
    -------
    DataFrame
        ``scene``, ``truth`` (its name: that with mus = mu is another), ``fidelity``, ``variant``, ``engine``; ``quantity`` of `QUANTITIES`, ``error`` and
        its ``unit``; `OWN_CPU`, `LOW`, `HIGH`, ``cpu [s]``, ``cpu [s], low``, ``cpu [s], high``: median and interval of the time to that error, inside the
        engine and in total, empty where no rung reaches it; `LEVEL` of both; ``at most``: the coarsest rung already meets it; ``ladder ends at`` (in the
        unit) on this scene; over all scenes ``because``, ``why``, ``order [-]`` and ``order uncertainty [-]``, see `LadderEnd`.
    """
    rows: list[dict[str, Any]] = []
    ends = {(quantity.name, variant): ladder_end(found, quantity, accelerations_of(found, ladders))
            for quantity in QUANTITIES for variant, found in ladders.groupby("variant", sort=False)}
    for _, there in ladders.groupby("scene", sort=False):
        parts = [ladder for _, ladder in there.groupby("variant", sort=False)]
        for quantity in QUANTITIES:
            rows += _rows(parts, samples, quantity, ends)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(ladders: Sequence[pd.DataFrame], samples: pd.DataFrame, quantity: Quantity,
          ends: Mapping[tuple[str, str], LadderEnd]) -> Iterator[dict[str, Any]]:
    """Of one scene and quantity."""
    sizes = np.concatenate([_sizes(ladder[came_out(ladder)], quantity) for ladder in ladders])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    if not len(sizes):
        return
    powers = range(min(COARSEST, math.floor(math.log10(sizes.max()))), math.ceil(math.log10(sizes.min())) - 1, -1)
    for ladder in ladders:
        first = ladder.iloc[0]
        end = ends[quantity.name, first["variant"]]
        truth = ladder["truth"].dropna() if "truth" in ladder else pd.Series(dtype=object)
        about = {**first[["scene", "fidelity", "variant", "engine"]], "truth": truth.iloc[0] if len(truth) else None,
                 "quantity": quantity.name, "unit": quantity.unit,
                 "ladder ends at": _smallest(ladder[came_out(ladder)], quantity), "because": end.because, "why": end.why}
        if end.order is not None:
            about |= {"order [-]": end.order.value, "order uncertainty [-]": end.order.uncertainty}
        for target in (float(f"1e{power}") for power in powers):
            cost = time_to(ladder, samples, quantity, target)
            if cost is None:
                yield {**about, "error": target}
                break
            yield {**about, "error": target, OWN_CPU: cost.own.value, LOW: cost.own.low, HIGH: cost.own.high,
                   "cpu [s]": cost.total.value, "cpu [s], low": cost.total.low, "cpu [s], high": cost.total.high,
                   LEVEL: cost.own.level, "at most": cost.at_most}


def _sizes(rows: pd.DataFrame, quantity: Quantity) -> np.ndarray:
    """Errors, or what they are unsure by where that is more."""
    if quantity.error not in rows:
        return np.full(len(rows), np.nan)
    error, unsure = (rows[name].to_numpy(dtype=float) for name in (quantity.error, quantity.uncertainty))
    return np.where(np.isnan(error), np.nan, np.fmax(error, unsure))


def _smallest(rows: pd.DataFrame, quantity: Quantity) -> float:
    """Of each scene the smallest error, of those the largest; nan where no scene has an error."""
    by_scene = pd.Series(_sizes(rows, quantity), index=rows["scene"].to_numpy()).groupby(level=0).min()
    return float(by_scene.max())


def time_to(ladder: pd.DataFrame, samples: pd.DataFrame, quantity: Quantity, target: float) -> Cost | None:
    """The least time at which the broken line through the rungs, coarse to fine, meets an error; None where it does not."""
    rounds = rounds_to(ladder, samples, quantity, target)
    if rounds is None:
        return None
    size = _sizes(ladder[came_out(ladder)], quantity)
    return Cost(*(median_interval(rounds[name]) for name in (OWN_CPU, "cpu [s]")), bool(size[0] <= target))


def rounds_to(ladder: pd.DataFrame, samples: pd.DataFrame, quantity: Quantity, target: float) -> pd.DataFrame | None:
    """By round the time to an error, columns `OWN_CPU` and ``cpu [s]``; for a ratio to another variant's of the same round."""
    rows = ladder[came_out(ladder)]
    size, keys = _sizes(rows, quantity), list(rows["key"])
    by_key = {key: part.set_index("round")[[OWN_CPU, "cpu [s]"]] for key, part in samples[samples["key"].isin(keys)].groupby("key", sort=False)}
    meetings = [by_key[key] for key, there in zip(keys, size) if there <= target and key in by_key]
    for i in range(1, len(keys)):
        if size[i - 1] > target > size[i] and {keys[i - 1], keys[i]} <= set(by_key):
            share = math.log(size[i - 1] / target) / math.log(size[i - 1] / size[i])
            meetings.append((by_key[keys[i - 1]] ** (1 - share) * by_key[keys[i]] ** share).dropna())  # rounds that both have
    return min(meetings, key=lambda times: times["cpu [s]"].median(), default=None)


def accelerations_of(ladder: pd.DataFrame, ladders: pd.DataFrame) -> pd.DataFrame | None:
    """The runs of the same engine's accelerations under an integrator of high order; None where there are none.

    Parameters
    ----------
    ladder
        Rows of one variant.
    ladders
        Rows of all variants.
    """
    first, rows = ladder.iloc[0], ladders[came_out(ladders)]
    alike = (rows["engine"] == first["engine"]) & (rows["fidelity"] == first["fidelity"])
    rows = rows[alike & (rows["variant"] != first["variant"])]
    rows = rows[[json.loads(settings).get("method") == "accelerations" for settings in rows["settings"]]]
    return rows if len(rows) else None


def _settings(rows: pd.DataFrame) -> Mapping[str, Any]:
    return json.loads(rows["settings"].iloc[-1])


def ladder_end(ladder: pd.DataFrame, quantity: Quantity, accelerations: pd.DataFrame | None = None) -> LadderEnd:
    """Where the ladders of a variant end and what limits them; the rules of the module, in their order.

    Parameters
    ----------
    ladder
        Rows of one variant as `work_precision` makes them, of one scene or of several, from coarse to fine.
    accelerations
        Those of `accelerations_of`.
    """
    rows = ladder[came_out(ladder)]
    if rows.empty:
        return LadderEnd(float("nan"), LOST, f"{ladder['status'].iloc[-1]}: {ladder['reason'].iloc[-1]}")
    end = _smallest(rows, quantity)
    locates = "events matched" in rows and bool(rows["events matched"].notna().any())
    blind = f"locates no events: {quantity.without_events}" if quantity.without_events and not locates else ""
    if not np.isfinite(end):
        return LadderEnd(float("nan"), *((ADAPTER, blind) if blind else (UNKNOWN, "nothing to compare with")))
    if _at_the_truth(rows, quantity):
        return LadderEnd(end, *((ADAPTER, blind) if blind else (TRUTH, "not above what the truth is unsure by")))
    parameter, order = rows["parameter"].iloc[0], order_of(rows, quantity)
    if order is None:
        return LadderEnd(end, UNKNOWN, "too few rungs for an order with an interval")
    low, high = order.value - order.uncertainty, order.value + order.uncertainty
    found = f"order {order.value:.2g} ± {order.uncertainty:.1g} in {parameter} at the finest rungs"
    falls_everywhere = all(errors[-1] < errors[0] for _, errors in _finest(rows, quantity))
    if high >= FALLS and low > 0 and falls_everywhere:
        return LadderEnd(end, INTEGRATION, f"still falls: {found}", order)
    if parameter == "iterations":
        step = _settings(rows)["dt"]
        return LadderEnd(end, INTEGRATION, f"does not fall with {parameter}: its step of {step:g} s is fixed", order)
    if high >= FALLS:
        return LadderEnd(end, UNKNOWN, found, order)
    return LadderEnd(end, *_level(rows, quantity, accelerations, f"does not fall: {found}"), order)


def _level(rows: pd.DataFrame, quantity: Quantity, accelerations: pd.DataFrame | None, found: str) -> tuple[str, str]:
    """Limit of ladders that are level, and how it is known."""
    if rows["fidelity"].iloc[0] == "contact":
        return MODEL, f"{found}; bodies in contact, with clearance or contacts that give way"
    if accelerations is not None:
        ours = _smallest(rows[rows["scene"].isin(accelerations["scene"])], quantity)
        theirs = _smallest(accelerations[accelerations["scene"].isin(rows["scene"])], quantity)
        if theirs < FURTHER * ours:
            return ADAPTER, f"{found}; the engine's accelerations lead to {theirs:.1g} {quantity.unit}"
        if np.isfinite(theirs):
            under = "the engine's accelerations under an integrator of high order"
            return MODEL, f"{found}; {under} end at {theirs:.1g} {quantity.unit}"
    law = str(_settings(rows).get("friction_law", ""))
    return (ADAPTER, f"{found}; {law}") if "adapter" in law else (UNKNOWN, found)


def _at_the_truth(rows: pd.DataFrame, quantity: Quantity) -> bool:
    """Whether on every scene the smallest error is not above what the truth is unsure by."""
    size = pd.Series(_sizes(rows, quantity), index=rows.index).dropna()
    best = size.groupby(rows["scene"]).idxmin()
    return bool((size[best] == rows.loc[best, quantity.uncertainty]).all())


def order_of(rows: pd.DataFrame, quantity: Quantity) -> Uncertain | None:
    """Exponent with which the error falls with step or tolerance at the `FINEST` rungs, or grows fewer with iterations.

    Least squares of log(error) over log(step): one slope for all scenes, a constant for each. Errors that are not above
    what the truth is unsure by are left out.

    Returns
    -------
    Uncertain or None
        With half the width of its interval of `LEVEL_OF_ORDER`, from the scatter about the fit. None without a rung more
        than the fit has unknowns.
    """
    parts = [(np.log(steps), np.log(errors)) for steps, errors in _finest(rows, quantity)]
    free = sum(len(x) for x, _ in parts) - len(parts) - 1
    if free < 1:
        return None
    steps = np.concatenate([x - x.mean() for x, _ in parts])
    errors = np.concatenate([y - y.mean() for _, y in parts])
    slope = float(steps @ errors / (steps @ steps))
    scatter = math.sqrt(float(np.sum((errors - slope * steps) ** 2)) / free / float(steps @ steps))
    half = float(student.ppf((1 + LEVEL_OF_ORDER) / 2, free)) * scatter
    return Uncertain(-slope if rows["parameter"].iloc[0] == "iterations" else slope, half)


def _finest(rows: pd.DataFrame, quantity: Quantity) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each scene the `FINEST` steps and their errors, coarse to fine, those above what the truth is unsure by."""
    if quantity.error not in rows:
        return []
    sizes = pd.Series(_sizes(rows, quantity), index=rows.index)
    known = rows[sizes > rows[quantity.uncertainty]]
    return [(finest["step"].to_numpy(dtype=float), sizes[finest.index].to_numpy())
            for finest in (ladder.iloc[-FINEST:] for _, ladder in known.groupby("scene", sort=False))]
