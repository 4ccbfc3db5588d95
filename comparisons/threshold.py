"""The stick threshold: the largest amplitude F0 with a stick phase in the steady state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd

from comparisons.truth import HIGH_PRECISION, StickThreshold, stick_threshold
from comparisons.variants import Record, Variant, physics_of, run_key
from engines.isolation import Task
from engines.registry import load_engine
from scenes import Scene, Trajectory, vary
from scenes.laws import Linear, Sine

PAPER_VALUE = None
"""The paper prints the threshold, but the number is lost in the only text there is; it is never guessed."""


@dataclass(frozen=True)
class Criterion:
    """What counts as a stick phase of a sampled motion, and where it is looked for.

    Attributes
    ----------
    creep_tolerance : float
        m/s; slower than this for `shortest_stick` seconds (and two steps at least) is a stick phase. A slider that
        reverses with the accelerations of the paper's example (0.2 m/s^2 and more) is this slow for 1 ms.
    shortest_stick : float
        Seconds. The duration of a stick phase goes to zero at the threshold, so that one that must last has a
        lower threshold. Of an engine whose events are located, any stick event counts, however short.
    settle_periods, window_periods : int
        Periods before the window, and its length.
    """

    creep_tolerance: float = 1e-4
    shortest_stick: float = 0.002
    settle_periods: int = 4
    window_periods: int = 1


@dataclass(frozen=True)
class Threshold:
    """A bracket of the threshold: the larger F0 seen with and the smallest seen without a stick phase, N.

    `creep_speed` is the median speed (m/s) in the window's slowest connected stretch of `shortest_stick` seconds at
    the bracket's lower end; `runs` the number of simulations; `remark` why a bracket is missing.
    """

    with_stick: float | None
    without_stick: float | None
    creep_speed: float | None
    period: float
    runs: int
    cpu_s: float
    remark: str = ""


def common_period(scene: Scene) -> float:
    """Smallest common period of the scene's sinusoidal laws and constant turning rates, s.

    Raises
    ------
    ValueError
        If nothing is periodic or the frequencies have no common period (ratios up to 64, to 1e-9).
    """
    laws = [element.law for element in [*scene.forces.values(), *scene.drives.values()]]
    rates = [abs(law.frequency) for law in laws if isinstance(law, Sine)] + [abs(law.rate) for law in laws if isinstance(law, Linear)]
    rates = [rate for rate in rates if rate > 0]
    if not rates:
        raise ValueError(f"{scene.name}: no sine law or turning drive; expected a periodic excitation")
    ratios = [Fraction(rate / rates[0]).limit_denominator(64) for rate in rates]
    if any(abs(rate / rates[0] - ratio) > 1e-9 or not ratio for rate, ratio in zip(rates, ratios)):
        raise ValueError(f"{scene.name}: frequencies {rates} rad/s have no common period")
    # all rates are multiples of rates[0] * gcd(ratios)
    gcd = Fraction(np.gcd.reduce([r.numerator * np.lcm.reduce([s.denominator for s in ratios]) // r.denominator for r in ratios]),
                   int(np.lcm.reduce([s.denominator for s in ratios])))
    return float(2 * np.pi / (rates[0] * float(gcd)))


def sticks(trajectory: Trajectory, guide: str, start: float, criterion: Criterion, step: float) -> tuple[bool, float]:
    """Whether the guide has a stick phase after `start` seconds, and the median speed of its slowest stretch, m/s."""
    window = trajectory.t >= start
    t, speed = trajectory.t[window], np.abs(trajectory[f"{guide}.slip_velocity"][window])
    length = max(criterion.shortest_stick, 2 * step)
    count = max(2, int(round(length / np.median(np.diff(t)))) + 1)
    stretches = np.lib.stride_tricks.sliding_window_view(speed, min(count, len(speed)))
    worst = stretches.max(axis=1)
    slowest = int(np.argmin(worst))
    creep = float(np.median(stretches[slowest]))
    if trajectory.settings.get("method") == "event":
        modes = trajectory[f"{guide}.mode"][window]
        return bool(np.any(modes == 0) or any(e.kind == "stick" and e.joint == guide and e.time >= start
                                              for e in trajectory.events)), creep
    return bool(worst[slowest] <= criterion.creep_tolerance), creep


def measure_threshold(scene: Scene, engine: str, arguments: dict[str, Any], step: float, low: float, high: float,
                      width: float, amplitude: str = "F0", guide: str = "guide",
                      criterion: Criterion = Criterion(), window: tuple[float, float] | None = None) -> Threshold:
    """Bracket the threshold of an engine by bisection on the amplitude.

    Parameters
    ----------
    arguments
        Of `Engine.simulate`, the step or tolerance among them.
    step : float
        Step of a fixed-step engine (s), which bounds the shortest stick phase it can show; 0 for located events.
    low, high : float
        N; the search starts here and is given up if the low end does not stick or the high one does.
    width : float
        N; width of the final bracket.
    window : tuple of float, optional
        Seconds; start and end of where a stick phase is looked for, instead of the criterion's periods, which a scene
        need not have. `Threshold.period` is its length then.
    """
    solver = load_engine(engine)
    if window is None:
        period = common_period(scene)
        start = criterion.settle_periods * period
        end = start + criterion.window_periods * period
    else:
        start, end = window
        period = end - start
    runs, cpu = 0, 0.0

    def run(F0: float) -> tuple[bool, float]:
        nonlocal runs, cpu
        trajectory = solver.simulate(vary(scene, {amplitude: F0}), t_end=end, **{"output_step": step or 0.1, **arguments})
        if trajectory.termination != "end":
            raise ArithmeticError(f"F0 = {F0:g}: {trajectory.termination}")
        runs, cpu = runs + 1, cpu + trajectory.cost.stepping_s
        return sticks(trajectory, guide, start, criterion, step)

    found, creep = run(low)
    if not found:
        return Threshold(None, None, creep, period, runs, cpu, f"no stick phase at F0 = {low:g} N: "
                         f"the slowest stretch moves at {creep:.2g} m/s")
    if run(high)[0]:
        return Threshold(high, None, creep, period, runs, cpu, f"still a stick phase at F0 = {high:g} N")
    while high - low > width:
        middle = 0.5 * (low + high)
        found, speed = run(middle)
        if found:
            low, creep = middle, speed
        else:
            high = middle
    return Threshold(low, high, creep, period, runs, cpu)


REFERENCE_CRITERION = Criterion(settle_periods=30)
"""The period map of the sliding motion contracts by a factor of about 2 per period, so that 30 periods leave 1e-9."""


def true_thresholds(scene: Scene) -> dict[bool, StickThreshold]:
    """The threshold of the reduced solution, for the physics with and without a static coefficient of its own."""
    return {has_mus: stick_threshold(physics_of(scene, has_mus)) for has_mus in (False, True)}


def threshold_tasks(scene: Scene, variants: Iterable[Variant], static_coefficient: Mapping[str, bool],
                    ladders: Mapping[str, tuple[float, ...]], true: Mapping[bool, StickThreshold],
                    width: float) -> list[tuple[Variant, float, Task]]:
    """The measurements of the main job, for `engines.isolation`: variant, rung of its ladder, task.

    Each searches 15 % to either side of the truth, down to a bracket of `width` newton (the reference: 1e-9).
    """
    tasks = []
    for variant in variants:
        has_mus = static_coefficient[variant.label]
        physics, centre = physics_of(scene, has_mus), true[has_mus].F0
        for step in ladders.get(variant.label, ()):
            reference = variant.parameter == "rtol"
            arguments = {variant.parameter: step, "fidelity": variant.fidelity, **variant.settings}
            tasks.append((variant, step, Task(
                f"threshold/{run_key(scene, variant, step)}", measure_threshold,
                (physics, variant.engine, arguments, 0.0 if reference else step, 0.85 * centre, 1.15 * centre,
                 1e-9 if reference else width, "F0", "guide", REFERENCE_CRITERION if reference else Criterion()))))
    return tasks


def threshold_table(scene: Scene, records: Iterable[Record], static_coefficient: Mapping[str, bool],
                    true: Mapping[bool, StickThreshold]) -> pd.DataFrame:
    """One row per measurement; the values of the records' outcomes are `Threshold`.

    The numerical uncertainty is the width of the bracket plus, along a ladder, the change from the rung before.
    """
    rows = []
    previous: dict[str, float] = {}
    for record in records:
        measured: Threshold | None = record.outcome.value
        has_mus = static_coefficient[record.variant.label]
        truth = true[has_mus]
        guide = next(iter(physics_of(scene, has_mus).frictional_guides.values()))
        criterion = REFERENCE_CRITERION if record.variant.parameter == "rtol" else Criterion()
        row = {"scene": scene.name, "variant": record.variant.label, "engine": record.variant.engine,
               "fidelity": record.variant.fidelity, "parameter": record.variant.parameter, "step": record.step,
               "status": record.outcome.status, "reason": record.outcome.reason or (measured.remark if measured else ""),
               "truth [N]": truth.F0, "truth tier": HIGH_PRECISION, "truth uncertainty [N]": truth.uncertainty,
               "paper [N]": PAPER_VALUE, "g [m/s^2]": -scene.gravity[1] if scene.gravity else 0.0,
               "mu": guide.mu, "mus": guide.static_coefficient,
               "creep tolerance [m/s]": criterion.creep_tolerance, "shortest stick [s]": criterion.shortest_stick,
               "settling periods": criterion.settle_periods, "key": record.key}
        if measured is not None:
            row.update({"F0 with stick [N]": measured.with_stick, "F0 without stick [N]": measured.without_stick,
                        "creep speed [m/s]": measured.creep_speed, "window [s]": criterion.window_periods * measured.period,
                        "runs": measured.runs, "cpu [s]": measured.cpu_s})
            if measured.with_stick is not None and measured.without_stick is not None:
                middle = 0.5 * (measured.with_stick + measured.without_stick)
                width = measured.without_stick - measured.with_stick
                step_change = abs(middle - previous[record.variant.label]) if record.variant.label in previous else None
                row.update({"F0 threshold [N]": middle, "error [N]": middle - truth.F0,
                            "uncertainty [N]": width + (step_change or 0.0), "change from coarser step [N]": step_change})
                previous[record.variant.label] = middle
        rows.append(row)
    return pd.DataFrame(rows)
