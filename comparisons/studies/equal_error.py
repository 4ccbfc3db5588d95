"""What a given error costs: time to it in position, torque and event time, along the ladder of every variant, and where each ladder ends and why.

Engines are compared at equal error, not at equal step. Between neighbouring rungs log(time) is linear in log(error); nothing is extrapolated. A rung meets an
error only if its own error, and what that is unsure by, are not above it. The interval of an interpolated time comes from the same interpolation in every round of timing
(`stiction.comparisons.timing.rounds`): it has the spread of the times, not that of the errors, which are the same in every run.

A ladder ends at its smallest error. Why is decided by the rules of `ladder_end`, from what was measured and what the run says of itself:

- integration: the error still falls at the finest rung, by half an order at least, so that a finer one would go on; or the step is fixed and only iterations change;
- inconclusive: it falls by less at the finest rung alone: errors of contacts go up and down, and two slopes at least must say that a ladder is level;
- model: it does not fall any more, and the run is of bodies in contact, whose contacts have clearance or give way; or the engine's own accelerations under an integrator
  of high order end there too;
- adapter: it does not fall any more, but the engine's own accelerations lead further, or the law of friction is the adapter's; or the quantity needs events,
  which the adapter does not locate;
- truth: the error is below what the truth is unsure by.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.studies.work_precision import HIGH, LEVEL, LOW, Timed, came_out, work_precision
from stiction.comparisons.timing.intervals import Interval, median_interval
from stiction.comparisons.variants import OWN_CPU, Variant, scaled
from stiction.scenes import Scene

SCENES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3", "slider-on-moving-guide", "elliptic-trammel", "hard/stiff-spring")
"""The paper's cases, and mechanisms with an independent truth: a guide that moves, two guides with friction, a stiff spring."""
COARSEST = -2
"""Power of ten of the largest error that is asked for."""
INTEGRATION, MODEL, ADAPTER, TRUTH, LOST, UNKNOWN = "integration", "model", "adapter", "truth", "no run came out", "inconclusive"
FALLS = 0.5
"""Slope in logarithms from which on an error is said to fall with step or tolerance: half the lowest order that any method here has."""
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
           "at most", "ladder ends at", "because", "why")
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
    """The smallest error on a ladder, nan where there is none; what it is limited by, of the names of the module; and how that is known."""

    error: float
    because: str
    why: str


@dataclass(frozen=True)
class EqualError:
    """`table`: of `equal_error` on several scenes; `samples`: the times behind it, see `stiction.comparisons.timing.timed_runs.samples_table`."""

    table: pd.DataFrame
    samples: pd.DataFrame


def equal_error_comparison(scenes: Sequence[Scene], variants: Sequence[Variant], repeats: int, budget_s: float) -> Comparison[EqualError]:
    """The ladders of all variants on all scenes, timed in the same rounds; arguments as of `work_precision`."""
    def combine(found: Sequence[Timed]) -> EqualError:
        return EqualError(*(pd.concat([pd.DataFrame(), *tables], ignore_index=True) for tables in (
            [equal_error(timed.table, timed.samples) for timed in found], [timed.samples for timed in found])))

    return side_by_side([work_precision(scene, scaled(variants, scene), repeats=repeats, budget_s=budget_s) for scene in scenes], combine)


def equal_error(ladders: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Time to errors of 10^n on one scene: one row per variant, quantity and error, down to the first that the variant does not reach.

    Parameters
    ----------
    ladders, samples
        Table and samples of `stiction.comparisons.studies.work_precision.Timed`.

    Returns
    -------
    DataFrame
        ``scene``, ``truth`` (its name: that with mus = mu is another), ``fidelity``, ``variant``, ``engine``; ``quantity`` of `QUANTITIES`, ``error`` and
        its ``unit``; `OWN_CPU`, `LOW`, `HIGH`, ``cpu [s]``, ``cpu [s], low``, ``cpu [s], high``: median and interval of the time to that error, inside the
        engine and in total, empty where no rung reaches it; `LEVEL` of both; ``at most``: the coarsest rung already meets it; ``ladder ends at`` (in the
        unit), ``because`` and ``why``, see `LadderEnd`.
    """
    parts = [ladder for _, ladder in ladders.groupby("variant", sort=False)]
    return pd.DataFrame([row for quantity in QUANTITIES for row in _rows(parts, samples, quantity)], columns=COLUMNS)


def _rows(ladders: Sequence[pd.DataFrame], samples: pd.DataFrame, quantity: Quantity) -> Iterator[dict[str, Any]]:
    sizes = np.concatenate([_sizes(ladder[came_out(ladder)], quantity) for ladder in ladders])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    if not len(sizes):
        return
    powers = range(min(COARSEST, math.floor(math.log10(sizes.max()))), math.ceil(math.log10(sizes.min())) - 1, -1)
    for ladder in ladders:
        first, end = ladder.iloc[0], ladder_end(ladder, quantity, accelerations_end(ladder, ladders, quantity))
        truth = ladder["truth"].dropna() if "truth" in ladder else pd.Series(dtype=object)
        for target in (float(f"1e{power}") for power in powers):
            cost = time_to(ladder, samples, quantity, target)
            row = {"scene": first["scene"], "truth": truth.iloc[0] if len(truth) else None, "fidelity": first["fidelity"], "variant": first["variant"],
                   "engine": first["engine"], "quantity": quantity.name, "error": target, "unit": quantity.unit}
            if cost is not None:
                row |= {OWN_CPU: cost.own.value, LOW: cost.own.low, HIGH: cost.own.high, "cpu [s]": cost.total.value, "cpu [s], low": cost.total.low,
                        "cpu [s], high": cost.total.high, LEVEL: cost.own.level, "at most": cost.at_most}
            yield {**row, "ladder ends at": end.error, "because": end.because, "why": end.why}
            if cost is None:
                break


def _sizes(rows: pd.DataFrame, quantity: Quantity) -> np.ndarray:
    """Errors, or what they are unsure by where that is more."""
    if quantity.error not in rows:
        return np.full(len(rows), np.nan)
    error, unsure = (rows[name].to_numpy(dtype=float) for name in (quantity.error, quantity.uncertainty))
    return np.where(np.isnan(error), np.nan, np.fmax(error, unsure))


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
    return min(meetings, key=lambda times: times[OWN_CPU].median(), default=None)


def accelerations_end(ladder: pd.DataFrame, ladders: Iterable[pd.DataFrame], quantity: Quantity) -> float | None:
    """The smallest error of the same engine's accelerations under an integrator of high order, None where there is no such ladder."""
    first = ladder.iloc[0]
    for other in ladders:
        rows = other[came_out(other)]
        if len(rows) and other["engine"].iloc[0] == first["engine"] and other["fidelity"].iloc[0] == first["fidelity"] and other["variant"].iloc[0] != first["variant"] \
                and _settings(rows).get("method") == "accelerations" and np.isfinite(_sizes(rows, quantity)).any():
            return float(np.nanmin(_sizes(rows, quantity)))
    return None


def _settings(rows: pd.DataFrame) -> Mapping[str, Any]:
    return json.loads(rows["settings"].iloc[-1])


def ladder_end(ladder: pd.DataFrame, quantity: Quantity, accelerations: float | None = None) -> LadderEnd:
    """Where a ladder ends and why; the rules of the module, in their order.

    Parameters
    ----------
    ladder
        Rows of one variant as `work_precision` makes them, from coarse to fine.
    accelerations
        Smallest error of the engine's own accelerations under an integrator of high order; None where that is not known.
    """
    rows = ladder[came_out(ladder)]
    if rows.empty:
        return LadderEnd(float("nan"), LOST, f"{ladder['status'].iloc[-1]}: {ladder['reason'].iloc[-1]}")
    size = _sizes(rows, quantity)
    locates = "events matched" in rows and bool(rows["events matched"].notna().any())
    blind = f"locates no events: {quantity.without_events}" if quantity.without_events and not locates else ""
    if not np.isfinite(size).any():
        return LadderEnd(float("nan"), *((ADAPTER, blind) if blind else (UNKNOWN, "nothing to compare with")))
    best = int(np.nanargmin(size))
    end, unsure = float(size[best]), float(rows[quantity.uncertainty].iloc[best])
    if end == unsure:
        return LadderEnd(end, *((ADAPTER, blind) if blind else (TRUTH, "not above what the truth is unsure by")))
    parameter, steps = rows["parameter"].iloc[0], rows["step"].to_numpy(dtype=float)
    slopes = _slopes(steps, size, parameter)
    if not len(slopes):
        return LadderEnd(end, UNKNOWN, "one rung came out")
    if slopes[-1] >= FALLS:
        return LadderEnd(end, INTEGRATION, f"still falls at the finest rung, as {parameter}^{-slopes[-1] if parameter == 'iterations' else slopes[-1]:.1f}")
    level = f"does not fall with {parameter} at the finest rungs"
    if parameter == "iterations":
        return LadderEnd(end, INTEGRATION, f"{level}: its step of {_settings(rows)['dt']:g} s is fixed")
    if len(slopes) < 2 or slopes[-2] >= FALLS:
        return LadderEnd(end, UNKNOWN, f"too flat to tell at the finest rung alone, as {parameter}^{slopes[-1]:.1f}")
    if rows["fidelity"].iloc[0] == "contact":
        return LadderEnd(end, MODEL, f"{level}: bodies in contact, with clearance or contacts that give way")
    if accelerations is not None:
        return LadderEnd(end, *((ADAPTER, f"{level}; the engine's accelerations lead to {accelerations:.1g} {quantity.unit}") if accelerations < FURTHER * end else (
            MODEL, f"{level}; the engine's accelerations under an integrator of high order end at {accelerations:.1g} {quantity.unit}")))
    law = str(_settings(rows).get("friction_law", ""))
    return LadderEnd(end, ADAPTER, f"{level}; {law}") if "adapter" in law else LadderEnd(end, UNKNOWN, level)


def _slopes(steps: np.ndarray, size: np.ndarray, parameter: str) -> np.ndarray:
    """In logarithms between neighbouring rungs with an error, positive where it falls, shape (rungs - 1,)."""
    known = np.isfinite(size)
    return np.diff(np.log(size[known])) / np.diff(np.log(steps[known])) * (-1 if parameter == "iterations" else 1)
