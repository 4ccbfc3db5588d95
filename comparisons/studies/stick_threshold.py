"""The stick threshold: the largest F0 for which the steady state reached from the scene's start has a stick phase."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.campaigns.participants import extent, threshold_variants
from stiction.comparisons.methods import MISSING_ENGINE, called
from stiction.comparisons.presentation.charts import Axis, Chart, Panel, Series
from stiction.comparisons.presentation.presentation import Headline, Presentation
from stiction.comparisons.presentation.table_view import Column, view
from stiction.comparisons.presentation.traced_text import Number, TracedText, interval, listed, traced
from stiction.comparisons.proof.theorems import with_theorem
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.truth import HIGH_PRECISION, NO_TRUTH, PROVEN, StickThreshold, stick_threshold
from stiction.comparisons.truth.reduced.steady_state import DEFINITION, with_threshold
from stiction.comparisons.variants import OWN_CPU, Record, Variant, has_static_coefficient, physics_of, run_key, truth_key
from stiction.engines.isolation import Outcome, Task
from stiction.engines.protocol import EngineFailure
from stiction.engines.registry import load_engine
from stiction.scenes import InputError, Scene, StictionError, Trajectory, vary
from stiction.scenes.laws import Linear, Sine, Table

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


class NoCommonPeriod(InputError):
    """The excitation of a scene is not periodic, so that it has no steady state."""


class NotSettled(StictionError):
    """A motion has no steady state, or a very slow transient."""


@dataclass(frozen=True)
class Threshold:
    """A bracket of the threshold: the larger F0 seen with and the smallest seen without a stick phase, N.

    With located events the settling is followed by the return map (`settled`): `settle_periods` were needed, and `residual` (N)
    is what the rest of the transient can shift a threshold by. `creep_speed` is the median speed (m/s) in the window's slowest connected stretch of `shortest_stick` seconds at
    the bracket's lower end (None with located events); `runs` the number of simulations, `cpu_s` what they took and `engine_s` what of it
    the engine itself; `remark` why a bracket is missing.
    """

    with_stick: float | None
    without_stick: float | None
    creep_speed: float | None
    period: float
    runs: int
    cpu_s: float
    engine_s: float
    remark: str = ""
    settle_periods: int | None = None
    residual: float = 0.0


def excitation_period(scene: Scene, since: float = 0.0) -> float:
    """Smallest period (s) of all loads and drives from `since` on; inf where they are constant or pull at constant speed.

    Raises
    ------
    NoCommonPeriod
        If a law is not periodic, or the frequencies have no common period (ratios up to 64, to 1e-9).
    """
    rates = []
    for name, element in [*scene.forces.items(), *scene.drives.items()]:
        law = element.law
        if isinstance(law, Sine):
            rates.append(abs(law.frequency))
        elif isinstance(law, Linear) and element.type == "angle":
            rates.append(abs(law.rate))
        elif isinstance(law, Linear) and law.rate and element.type != "distance":
            raise NoCommonPeriod(f"{scene.name}: the law of {name} grows for ever")
        elif isinstance(law, Table) and (law.interpolation == "cubic" or law.times[-1] > since):
            raise NoCommonPeriod(f"{scene.name}: the law of {name} is a table that has not come to its end")
    rates = tuple(rate for rate in rates if rate > 0)
    if rates and (period := _period_of(rates)) is None:
        raise NoCommonPeriod(f"{scene.name}: frequencies {list(rates)} rad/s have no common period")
    return period if rates else np.inf


def common_period(scene: Scene) -> float:
    """As `excitation_period`; a constant excitation has none."""
    if (period := excitation_period(scene)) == np.inf:
        raise NoCommonPeriod(f"{scene.name}: no sine law or turning drive; expected a periodic excitation")
    return period


@lru_cache(maxsize=64)
def _period_of(rates: tuple[float, ...]) -> float | None:
    """Smallest common period (s) of frequencies (rad/s), if there is one; points of a sweep ask for the same again and again."""
    ratios = [Fraction(rate / rates[0]).limit_denominator(64) for rate in rates]
    if any(abs(rate / rates[0] - ratio) > 1e-9 or not ratio for rate, ratio in zip(rates, ratios)):
        return None
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


FIRST_STEP, FIRST_PART = 8, 0.02
"""Length of the first step of a search: in brackets where it begins near the threshold, else as a part of the amplitude that it begins at."""
MOST_SETTLING, MOST_PERIODS, LEAST_PASSES = 960, 8, 4
"""Periods after which a motion with located events counts as not settled; order of subharmonics looked for; states that show that they repeat."""
SETTLED = 1e-7
"""In units of the range of x: distance from its limit below which a motion is settled, and change from pass to pass from which on a
run at rtol 1e-9 shows its contraction and not its own errors."""


@dataclass(frozen=True)
class Settled:
    """A motion at the common period's multiples: its `order` in periods, and how far it still is from its limit, in units of
    its range: d / (1 - r), d the last change from pass to pass and r the ratio of successive changes, measured above a floor."""

    order: int
    distance: float


def settled(x: np.ndarray, distance: float = SETTLED, floor: float = SETTLED, orders: Iterable[int] = range(1, MOST_PERIODS + 1),
            size: float | None = None) -> Settled | None:
    """How states at successive multiples of a period, shape (n,) or (n, coordinates), have come to repeat themselves; None if they have not.

    Parameters
    ----------
    distance, floor : float
        From the limit, below which they have; and the change that the contraction is measured above.
    orders : iterable of int
        Of subharmonics, that are looked for.
    size : float, optional
        Unit of both; the range of x if not given.
    """
    size = size or float(np.ptp(x)) or float(np.max(np.abs(x))) or 1.0
    for order in orders:
        passes = len(x) // order
        if passes < LEAST_PASSES:
            return None
        change = np.max(np.abs(np.diff(x[-passes * order:].reshape(passes, -1), axis=0)), axis=1) / size
        above = np.flatnonzero(change > floor)
        last = int(above[-1]) if len(above) else 0
        first = max(last - 10, 0)
        ratio = float(change[last] / change[first]) ** (1 / (last - first)) if last > first else 0.0
        if ratio < 1 and change[-1] / (1 - ratio) <= distance:
            return Settled(order, float(change[-1]) / (1 - ratio))
    return None


def measure_threshold(scene: Scene, engine: str, arguments: dict[str, Any], step: float, low: float, high: float,
                      width: float, near: float | None = None, first: float | None = None, amplitude: str = "F0", guide: str = "guide",
                      criterion: Criterion = Criterion(), probes: int = 2, distance: float = SETTLED,
                      floor: float = SETTLED) -> Threshold:
    """Bracket the threshold of an engine on the amplitude.

    It is looked for from `near` on, in steps that double, and what they enclose is halved: where it is near, that takes half as many
    runs as halving the whole range, which is done without `near`.

    Parameters
    ----------
    arguments
        Of `Engine.simulate`, the step or tolerance among them.
    step : float
        Step of a fixed-step engine (s), which bounds the shortest stick phase it can show; 0 for located events.
    low, high : float
        N; the search stays between them and is given up if the low end does not stick or the high one does.
    width : float
        N; width of the final bracket.
    near : float, optional
        N; where the threshold may be, between `low` and `high`.
    first : float, optional
        N; length of the first step from `near`; `FIRST_STEP` brackets if not given.
    probes : int
        Amplitudes from end to end of the range, where it is halved: the largest that sticks is its low end. Small ones need not stick either.
    distance, floor : float
        Of a motion with located events, by which it counts as settled; see `settled`.
    """
    solver = load_engine(engine)
    period, located = common_period(scene), step == 0
    runs, cpu, own, needed, residual = 0, 0.0, 0.0, None, 0.0

    def simulate(F0: float, end: float, output_step: float) -> Trajectory:
        nonlocal runs, cpu, own
        trajectory = solver.simulate(vary(scene, {amplitude: F0}), t_end=end, **{"output_step": output_step, **arguments})
        if trajectory.termination != "end":
            raise EngineFailure(f"F0 = {F0:g}: {trajectory.termination}")
        runs, cpu, own = runs + 1, cpu + trajectory.cost.stepping_s, own + trajectory.cost.own_s
        return trajectory

    def run(F0: float) -> tuple[bool, float | None]:
        nonlocal needed, residual
        if not located:
            start, end = criterion.settle_periods * period, (criterion.settle_periods + criterion.window_periods) * period
            return sticks(simulate(F0, end, step), guide, start, criterion, step)
        periods = needed or 30
        while periods <= MOST_SETTLING:
            trajectory = simulate(F0, periods * period, period)
            state = settled(trajectory[f"{guide}.displacement"][:periods + 1], distance, floor)
            if state is not None:
                needed, residual = periods, max(residual, state.distance * F0)
                return sticks(trajectory, guide, (periods - state.order) * period * (1 - 1e-12), criterion, step)[0], None
            periods *= 2
        raise NotSettled(f"not settled after {periods // 2} periods of {period:g} s at F0 = {F0:.9g} N: no steady state of up to "
                         f"{MOST_PERIODS} periods")

    def result(with_stick: float | None, without_stick: float | None, creep: float | None, remark: str = "") -> Threshold:
        return Threshold(with_stick, without_stick, creep, period, runs, cpu, own, remark, needed, residual)

    seen: dict[float, tuple[bool, float | None]] = {}

    def stuck(F0: float) -> bool:
        if F0 not in seen:
            seen[F0] = run(F0)
        return seen[F0][0]

    try:
        if near is not None:
            low, high = around(stuck, near, low, high, first or FIRST_STEP * width)
        else:
            amplitudes = [float(F0) for F0 in np.linspace(high, low, probes)]
            highest = next((i for i, F0 in enumerate(amplitudes) if stuck(F0)), probes - 1)
            low, high = amplitudes[highest], amplitudes[max(highest - 1, 0)]
        if not stuck(low):
            creep = seen[low][1]
            slowest = "" if creep is None else f": the slowest stretch moves at {creep:.2g} m/s"
            return result(None, None, creep, f"no stick phase at F0 = {low:g} N{slowest}")
        if stuck(high):
            return result(high, None, seen[high][1], f"still a stick phase at F0 = {high:g} N")
        while high - low > width:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if stuck(middle) else (low, middle)
    except NotSettled as error:
        return result(None, None, None, str(error))
    return result(low, high, seen[low][1])


def around(stuck: Callable[[float], bool], near: float, low: float, high: float, step: float) -> tuple[float, float]:
    """Two amplitudes around the threshold, N: a stick phase at the first and none at the second, unless that is `low` or `high`.

    Steps from `near` on double until one has passed the threshold.
    """
    sticks, edge = stuck(near), near
    while True:
        other = min(edge + step, high) if sticks else max(edge - step, low)
        if other in (low, high) or stuck(other) != sticks:
            return (edge, other) if sticks else (other, edge)
        edge, step = other, 2 * step


def true_thresholds(scene: Scene) -> Comparison[dict[bool, StickThreshold]]:
    """The threshold of the reduced solution, for the physics with and without a static coefficient of its own, with its proven interval where the suite has a
    theorem; of a run that is lost its reason.

    Raises
    ------
    InputError
        If the scene has none that could be computed: it is no slider-bar, has no friction, or is not periodic.
    """
    with_threshold(scene)

    def tabulate(outcomes: Sequence[Outcome]) -> dict[bool, StickThreshold]:
        found = {has_mus: outcome.value or StickThreshold(None, None, (np.nan, np.nan), f"{outcome.status}: {outcome.reason}")
                 for has_mus, outcome in zip((False, True), outcomes, strict=True)}
        return {has_mus: with_theorem(physics_of(scene, has_mus), one) for has_mus, one in found.items()}

    return Comparison(tuple(Task(f"threshold/{truth_key(scene.name, has_mus)}/truth", stick_threshold, (physics_of(scene, has_mus),))
                            for has_mus in (False, True)), tabulate)


def scene_amplitude(scene: Scene) -> float:
    """The largest amplitude of a sine law of the scene's forces."""
    return max(load.law.amplitude for load in scene.forces.values() if isinstance(load.law, Sine))


def threshold_comparison(scene: Scene, variants: Sequence[Variant], width: float, true: Mapping[bool, StickThreshold]) -> Comparison[pd.DataFrame]:
    """The stick threshold of variants along their refinement series: `threshold_table`.

    The search starts at the scene's own amplitude, which knows nothing of the truth, and ends with a bracket of `width` newton (with located
    events: 1e-9). The bracket is the variant's own: it was seen to stick at one end and not at the other.

    Parameters
    ----------
    true
        What `true_thresholds` yields for the scene.
    """
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    rungs, tasks = [(variant, step) for variant in variants for step in variant.ladder], []
    for variant, step in rungs:
        physics, centre = physics_of(scene, static[variant.label]), true[static[variant.label]].F0
        start = scene_amplitude(physics)
        low, high = (min(start, centre or start) / 2, 2 * max(start, centre or start))
        located = variant.parameter == "rtol"
        arguments = {variant.parameter: step, "fidelity": variant.fidelity, **variant.settings}
        tasks.append(Task(f"threshold/{run_key(scene, variant, step)}", measure_threshold,
                          (physics, variant.engine, arguments, 0.0 if located else step, low, high, 1e-9 if located else width, start, FIRST_PART * start)))

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        return threshold_table(scene, [Record(outcome.label, scene.name, *rung, outcome) for rung, outcome in zip(rungs, outcomes)], static, true)

    return Comparison(tuple(tasks), tabulate, tuple(variants))


def threshold_table(scene: Scene, records: Iterable[Record], static_coefficient: Mapping[str, bool],
                    true: Mapping[bool, StickThreshold]) -> pd.DataFrame:
    """One row per measurement; the values of the records' outcomes are `Threshold`.

    The numerical uncertainty is the width of the bracket plus what is left of the transient and, along a ladder, the change from the
    rung before.
    """
    rows = []
    previous: dict[str, float] = {}
    for record in records:
        measured: Threshold | None = record.outcome.value
        has_mus = static_coefficient[record.variant.label]
        truth = true[has_mus]
        guide = next(iter(physics_of(scene, has_mus).frictional_guides.values()))
        criterion = Criterion()
        row = {"scene": scene.name, "variant": record.variant.label, "engine": record.variant.engine,
               "fidelity": record.variant.fidelity, "parameter": record.variant.parameter, "step": record.step,
               "status": record.outcome.status, "reason": record.outcome.reason or (measured.remark if measured else ""),
               "definition": DEFINITION, "truth [N]": truth.F0,
               "truth tier": NO_TRUTH if truth.F0 is None else PROVEN if truth.theorem else HIGH_PRECISION, "truth note": truth.note,
               "truth uncertainty [N]": truth.uncertainty, "theorem": truth.theorem,
               "paper [N]": PAPER_VALUE, "g [m/s^2]": -scene.gravity[1] if scene.gravity else 0.0,
               "mu": guide.mu, "mus": guide.static_coefficient,
               "creep tolerance [m/s]": criterion.creep_tolerance, "shortest stick [s]": criterion.shortest_stick,
               "settling periods": (measured and measured.settle_periods) or criterion.settle_periods, "key": record.key}
        if measured is not None:
            row.update({"F0 with stick [N]": measured.with_stick, "F0 without stick [N]": measured.without_stick,
                        "creep speed [m/s]": measured.creep_speed, "window [s]": criterion.window_periods * measured.period,
                        "runs": measured.runs, "cpu [s]": measured.cpu_s, OWN_CPU: measured.engine_s})
            if measured.with_stick is not None and measured.without_stick is not None:
                middle = 0.5 * (measured.with_stick + measured.without_stick)
                width = measured.without_stick - measured.with_stick
                step_change = abs(middle - previous[record.variant.label]) if record.variant.label in previous else None
                row.update({"F0 threshold [N]": middle, "error [N]": None if truth.F0 is None else middle - truth.F0,
                            "uncertainty [N]": width + measured.residual + (step_change or 0.0), "change from coarser step [N]": step_change})
                previous[record.variant.label] = middle
        rows.append(row)
    return pd.DataFrame(rows)


TRUTH = "threshold truth"
"""Name of what `plan` needs to know first."""
ERROR, UNCERTAINTY = "error [N]", "uncertainty [N]"


def plan(scope: Scope) -> Comparison[Tables]:
    """The threshold of every engine on the first scene."""
    limits = extent(scope.depth)
    found = threshold_comparison(scope.scenes[0], threshold_variants(scope.engines, scope.depth), limits.bracket, scope.known[TRUTH])
    return found.then(lambda table: Tables({"threshold": table}))


def present(results: Results) -> Presentation:
    """How far the threshold of each method is from the truth, and which are off by more than the search can tell."""
    table = results.table("threshold")
    if table.empty or ERROR not in table or table[ERROR].isna().all():
        return Presentation()
    measured = table[table[ERROR].notna()]
    finest = measured.loc[measured.groupby("variant", sort=False)["step"].idxmin()]
    off = finest[finest[ERROR].abs() > finest[UNCERTAINTY]]
    row = int(measured.index[0])
    truth = Number(known(table.at[row, "truth [N]"], table.at[row, "truth uncertainty [N]"]), "threshold", "truth [N]", rows=(row + 1,))
    clearly = listed([traced("{} ({} N)", called(variant), interval("threshold", table, int(label), ERROR)) for label, variant in off["variant"].items()])
    answer = traced("The slider sticks up to F0 = {} N. {}", truth, traced("Clearly off: {}.", clearly) if len(off) else "No method is clearly off.")
    none = [called(variant) for variant, rows in table[table["status"] != MISSING_ENGINE].groupby("variant", sort=False) if rows[ERROR].isna().all()]
    findings = [traced("No threshold was found for {}.", listed(none))] if none else []
    findings += [TracedText(f"Proven: it {text[text.rindex('lies between'):]}") for text in (table["theorem"].dropna().unique() if "theorem" in table else ())
                 if "lies between" in text]
    headline = Headline("stick limit off [N]", {variant: traced("{}", interval("threshold", table, int(label), ERROR)) for label, variant in finest["variant"].items()})
    columns = (Column("variant", "method"), Column("fidelity"), Column("mus", form="g"), Column("parameter", "refined by", brief=False), Column("step", form="g"),
               Column("F0 with stick [N]", "sticks at", "N", form=".6g", brief=False), Column("F0 without stick [N]", "slips at", "N", form=".6g", brief=False),
               Column(ERROR, "F0 less truth", "N", UNCERTAINTY, interval=True), Column("runs", brief=False), Column("reason", brief=False))
    shown = view("threshold", "Largest load amplitude F0 with a stick phase in the steady state, less that of the truth; the finest step of each method.",
                 finest, columns, source="threshold")
    whole = view("threshold-all", "The threshold at every step.", table, columns, source="threshold", in_report=False)
    notes = ("The uncertainty is the width of the bracket that the search ends with, and the change from the next coarser step. Brackets are not ranked: "
             "a method is off only where its error is larger than its uncertainty.",)
    return Presentation(answer, tuple(findings), (headline,), (shown, whole), (_figure(measured),), notes)


def _figure(measured: pd.DataFrame) -> Chart:
    """Intervals, a method a line; the steps of a method from coarse to fine below each other."""
    places, series, place = [], [], 0.0
    for variant, ladder in measured.groupby("variant", sort=False):
        ladder = ladder.sort_values("step", ascending=False)
        y = place + np.linspace(0.25, -0.25, len(ladder)) if len(ladder) > 1 else np.array([place])
        error, unsure = ladder[ERROR].to_numpy(float), ladder[UNCERTAINTY].to_numpy(float)
        series.append(Series("", error, y, error - unsure, error + unsure, look=variant, line=False, points=True))
        places.append((place, variant))
        place -= 1.0
    panel = Panel("", Axis("threshold on F0, less that of the truth [N]"), Axis("", ticks=[at for at, _ in places], words=[name for _, name in places]),
                  series, horizontal=True, lines=(0.0,))
    return Chart("threshold", "Stick threshold of each method less that of the truth, at each step from coarse (above) to fine. Bars: the bracket that the search ended "
                 "with and the change from the coarser step.", (panel,), columns=1, height=1.0 + 0.24 * len(places))


def known(number: float, unsure: float) -> str:
    """A number with as many decimals as are known of it."""
    return f"{number:.{max(0, int(np.floor(-np.log10(2 * unsure)))) if unsure > 0 else 12}f}"


STUDY = Study("threshold", "Stick limit", "Up to which load does the slider stick?", 4, present, plan, {TRUTH: lambda scope: true_thresholds(scope.scenes[0])},
              seconds=5.0, takes=frozenset({"engines"}))
