"""The stick threshold: upper end of the band of F0, next to the scene's own, with a stick phase in the steady state.

The steady state is the one that is reached from the scene's start. The threshold is searched here for each engine
(`measure_threshold`), for the truth in `truths.reduced.steady_state`, and proven in `truths.proof.threshold`. Above
it the slider may stick again: `bands_above` scans for that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.participants import extent, threshold_variants
from stiction.comparisons.bench.presentation import (
    METHOD,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Series,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import intervals_text, setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables, unless_refused
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, run_key, truth_key
from stiction.comparisons.measures.settling import (
    MOST_PERIODS,
    SETTLED,
    NotSettled,
    common_period,
    settled,
)
from stiction.engines.isolation import Outcome, Task
from stiction.engines.protocol import EngineFailure
from stiction.engines.registry import label_of, load_engine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.laws import Sine
from stiction.truths import StickThreshold, Tier, stick_threshold
from stiction.truths.physics import physics_of
from stiction.truths.proof.truth import threshold_of_theorem
from stiction.truths.reduced.steady_state import StickBands, margin, steady_state, with_threshold
from stiction.uncertain import Uncertain

AMPLITUDE = "F0"
"""Parameter on which the threshold is."""
PAPER_VALUE = None
"""The paper prints the threshold, but the number is lost in the only text there is; it is never guessed."""
CREEP_TOLERANCE, SHORTEST_STICK = 1e-4, 0.002
"""m/s and s: a sampled motion slower than this for so long, and for two steps at least, is a stick phase. A slider that
reverses with the accelerations of the paper's example (0.2 m/s^2 and more) is this slow for 1 ms. The duration of a
stick phase goes to zero at the threshold, so that one that must last has a lower threshold. Of an engine whose events
are located, any stick event counts, however short."""
SETTLE_PERIODS, WINDOW_PERIODS = 4, 1
"""Periods before the window of a sampled motion, and its length."""
FIRST_SETTLING, MOST_SETTLING = 30, 960
"""Periods that a motion with located events is given at first, and after which it counts as not settled."""
FIRST_STEP, FIRST_PART = 8, 0.1
"""Length of the first step of a search: in brackets where it begins near the threshold, else as a part of the amplitude
that it begins at."""
SCAN_STEP, SCAN_END, SCAN_WIDTH = 0.04, 2.5, 0.005
"""Parts of a threshold: distance of the amplitudes at which a scan above it looks for stick phases, end of the scan,
and width to which the ends of a band are halved. The narrowest band that is known is 0.16 of its threshold wide."""
SCAN_RTOL, SCAN_DISTANCE, SCAN_FLOOR, SCAN_SETTLING = 1e-6, 1e-3, 0.05, 120
"""Tolerance of the runs of a scan; distance from its limit at which a motion has settled, and the part of it above
which its contraction is measured, as in sweeps; periods after which a motion that has not is given up."""
LOCATED_WIDTH = 1e-9
"""N; width of the bracket of an engine with located events."""
SETTLES = 0.25
"""Part of an error by which the last refinement may still change it where it is said to be one: with more, finer steps
may remove it."""
CHANGE = "threshold_change"
TRUTH = "threshold truth"
"""Name of the comparison that `plan` requires."""
MIDDLE, ERROR, UNCERTAINTY = "F0_threshold", "threshold_error", "threshold_uncertainty"
TRUE_THRESHOLD, TIER = "true_threshold", "truth_tier"
AGAIN, SCANNED = "sticks_again", "scanned_to"
WITH_STICK, WITHOUT_STICK = "F0_with_stick", "F0_without_stick"
CONSTANTS = {"settles": SETTLES, "scan_step": SCAN_STEP, "scan_end": SCAN_END, "most_named": 2}
"""What the text of the study mentions besides results: a part of an error, parts of a threshold, and the number of
methods up to which its answer, which is one line, names them."""


@dataclass(frozen=True)
class Threshold:
    """A bracket of the threshold: F0 (N) seen with a stick phase, and seen without one above it.

    `runs` is the number of simulations, `remark` says why a bracket is missing. With located events, `residual` (N) is
    what the rest of the transient can shift a threshold by.
    """

    with_stick: float | None
    without_stick: float | None
    runs: int
    remark: str = ""
    residual: float = 0.0


@dataclass(frozen=True)
class Search:
    """The search of a bracket between two amplitudes.

    Attributes
    ----------
    low, high : float
        N; the search is given up if the low end does not stick or the high one does.
    width : float
        N; width of the final bracket.
    near : float, optional
        N; where the threshold may be. From there on, steps that double enclose it: where it is near, that takes half as
        many runs as halving the whole range, which is done without `near`.
    first : float, optional
        N; length of the first step from `near`; `FIRST_STEP` brackets if not given.
    probes : int
        Amplitudes from end to end of the range, where it is halved, at which a band is looked for. Small ones need not
        stick either.
    own : float, optional
        N; the band next to it is taken, the one below it rather than the one above; the highest one if not given.
    """

    low: float
    high: float
    width: float
    near: float | None = None
    first: float | None = None
    probes: int = 2
    own: float | None = None


@dataclass
class StickProbe:
    """Runs of an engine at one amplitude each, and whether their steady states have a stick phase.

    Attributes
    ----------
    arguments : Mapping
        Of `Engine.simulate`; with ``dt`` steps bound the shortest stick phase that is seen, else events are located.
    distance, floor : float
        Of a motion with located events, by which it counts as settled; see `settled`.
    most_settling : int
        Periods that a motion with located events is given at most; `MOST_SETTLING` if not given.
    seen : dict
        By amplitude whether it sticks, and of a sampled motion the median speed (m/s) of its slowest stretch.
    """

    scene: Scene
    engine: str
    arguments: Mapping[str, Any]
    distance: float = SETTLED
    floor: float = SETTLED
    most_settling: int | None = None
    seen: dict[float, tuple[bool, float | None]] = field(default_factory=dict)
    runs: int = 0
    settle_periods: int = FIRST_SETTLING
    residual: float = 0.0

    def __post_init__(self) -> None:
        self.period, self.guide = (
            common_period(self.scene),
            next(iter(self.scene.frictional_guides)),
        )

    def sticks(self, F0: float) -> bool:
        if F0 not in self.seen:
            self.seen[F0] = (
                self._sampled(F0, self.arguments["dt"])
                if "dt" in self.arguments
                else self._located(F0)
            )
        return self.seen[F0][0]

    def bracket(
        self, with_stick: float | None, without_stick: float | None, remark: str = ""
    ) -> Threshold:
        """The result of a search."""
        return Threshold(with_stick, without_stick, self.runs, remark, self.residual)

    def _simulate(self, F0: float, end: float, output_step: float) -> Trajectory:
        run = load_engine(self.engine).simulate(
            vary(self.scene, {AMPLITUDE: F0}), t_end=end, output_step=output_step, **self.arguments
        )
        if run.termination != "end":
            raise EngineFailure(f"F0 = {F0:g}: {run.termination}")
        self.runs += 1
        return run

    def _sampled(self, F0: float, step: float) -> tuple[bool, float]:
        run = self._simulate(F0, (SETTLE_PERIODS + WINDOW_PERIODS) * self.period, step)
        return sticks(run, self.guide, SETTLE_PERIODS * self.period, step)

    def _located(self, F0: float) -> tuple[bool, None]:
        periods = self.settle_periods
        while periods <= (self.most_settling or MOST_SETTLING):
            run = self._simulate(F0, periods * self.period, self.period)
            state = settled(
                run[f"{self.guide}.displacement"][: periods + 1], self.distance, self.floor
            )
            if state is not None:
                self.settle_periods, self.residual = (
                    periods,
                    max(self.residual, state.distance * F0),
                )
                start = (periods - state.order) * self.period * (1 - 1e-12)
                return sticks(run, self.guide, start, 0.0)[0], None
            periods *= 2
        raise NotSettled(
            f"not settled after {periods // 2} periods of {self.period:g} s at F0 = {F0:.9g} N: no steady "
            f"state of up to {MOST_PERIODS} periods"
        )


def sticks(run: Trajectory, guide: str, start: float, step: float) -> tuple[bool, float]:
    """Return True if the guide sticks after `start` seconds, and the median speed (m/s) of its slowest stretch."""
    window = run.t >= start
    t, speed = run.t[window], np.abs(run[f"{guide}.slip_velocity"][window])
    count = max(2, int(round(max(SHORTEST_STICK, 2 * step) / np.median(np.diff(t)))) + 1)
    stretches = np.lib.stride_tricks.sliding_window_view(speed, min(count, len(speed)))
    worst = stretches.max(axis=1)
    slowest = int(np.argmin(worst))
    creep = float(np.median(stretches[slowest]))
    if run.settings.get("method") == "event":
        events = [event for event in run.events if event.kind == "stick" and event.joint == guide]
        return bool(
            np.any(run[f"{guide}.mode"][window] == 0)
            or any(event.time >= start for event in events)
        ), creep
    return bool(worst[slowest] <= CREEP_TOLERANCE), creep


def measure_threshold(
    scene: Scene,
    engine: str,
    arguments: Mapping[str, Any],
    search: Search,
    distance: float = SETTLED,
    floor: float = SETTLED,
) -> Threshold:
    """Bracket the threshold of an engine on the amplitude; see `Search` and `StickProbe`."""
    probe = StickProbe(scene, engine, arguments, distance, floor)
    try:
        low, high = _ends(probe.sticks, search)
        if not probe.sticks(low):
            creep = probe.seen[low][1]
            slowest = "" if creep is None else f": the slowest stretch moves at {creep:.2g} m/s"
            return probe.bracket(None, None, f"no stick phase at F0 = {low:g} N{slowest}")
        if probe.sticks(high):
            return probe.bracket(high, None, f"still a stick phase at F0 = {high:g} N")
        while high - low > search.width:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if probe.sticks(middle) else (low, middle)
    except NotSettled as error:
        return probe.bracket(None, None, str(error))
    return probe.bracket(low, high)


def measure_series(scene: Scene, variant: Variant, search: Search) -> tuple[Threshold, ...]:
    """Bracket the threshold at each step from coarse to fine; each search begins at the bracket before."""
    found: list[Threshold] = []
    for step in variant.ladder:
        arguments = {variant.parameter: step, "fidelity": variant.fidelity, **variant.settings}
        found.append(measure_threshold(scene, variant.engine, arguments, search))
        low, high = found[-1].with_stick, found[-1].without_stick
        if low is not None and high is not None:
            search = replace(search, near=low, first=FIRST_STEP * (high - low))
    return tuple(found)


def _ends(stuck: Callable[[float], bool], search: Search) -> tuple[float, float]:
    """The amplitudes between which the range is halved, N."""
    if search.near is not None:
        first = search.first or FIRST_STEP * search.width
        return around(stuck, search.near, search.low, search.high, first)
    amplitudes = [float(F0) for F0 in np.linspace(search.low, search.high, search.probes)]
    last = len(amplitudes) - 1
    own = last if search.own is None else int(np.argmin(np.abs(np.array(amplitudes) - search.own)))
    # the band of its own amplitude, else the next one below, else the next one above; then its upper end
    inside = next(
        (i for i in (*range(own, -1, -1), *range(own + 1, last + 1)) if stuck(amplitudes[i])), 0
    )
    while inside < last and stuck(amplitudes[inside + 1]):
        inside += 1
    return amplitudes[inside], amplitudes[min(inside + 1, last)]


def around(
    stuck: Callable[[float], bool], near: float, low: float, high: float, step: float
) -> tuple[float, float]:
    """Two amplitudes around the threshold, N: a stick phase at the first and none at the second.

    Steps from `near` on double until one has passed the threshold, or is `low` or `high`.
    """
    is_stuck, edge = stuck(near), near
    while True:
        other = min(edge + step, high) if is_stuck else max(edge - step, low)
        if other in (low, high) or stuck(other) != is_stuck:
            return (edge, other) if is_stuck else (other, edge)
        edge, step = other, 2 * step


def bands_above(scene: Scene, threshold: float, start: float | None = None) -> StickBands:
    """Scan for F0 above a threshold (N) at which the slider sticks again, by the event-driven reference.

    From `start`, or a step above the threshold, to `SCAN_END` times it, `SCAN_STEP` of it apart. What is narrower, or
    farther up, is not seen. The ends of a band are halved to `SCAN_WIDTH` of the threshold; an amplitude without a
    steady state counts as one without a stick phase there.
    """
    probe = StickProbe(
        scene,
        "reference",
        {"rtol": SCAN_RTOL, "stabilization": "projection", "assemble": True},
        SCAN_DISTANCE,
        SCAN_FLOOR * SCAN_DISTANCE,
        SCAN_SETTLING,
    )
    unknown: list[float] = []

    def stuck(F0: float) -> bool:
        try:
            return probe.sticks(F0)
        except (NotSettled, EngineFailure):
            unknown.append(F0)
            return False

    def end_of(inside: float, outside: float) -> float:
        """The F0 next to the end of a band that still sticks."""
        while abs(outside - inside) > SCAN_WIDTH * threshold:
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if stuck(middle) else (inside, middle)
        return inside

    step = SCAN_STEP * threshold
    amplitudes = [
        float(F0)
        for F0 in np.arange(start or threshold + step, SCAN_END * threshold + 0.5 * step, step)
    ]
    seen = [stuck(F0) for F0 in amplitudes]
    without, bands = tuple(unknown), []
    for i, F0 in enumerate(amplitudes):
        if seen[i] and not (i and seen[i - 1]):
            last = next((j for j in range(i, len(seen)) if not seen[j]), len(seen)) - 1
            low = end_of(F0, amplitudes[i - 1]) if i else F0
            high = (
                end_of(amplitudes[last], amplitudes[last + 1])
                if last + 1 < len(amplitudes)
                else amplitudes[last]
            )
            bands.append((low, high))
    return StickBands(tuple(bands), amplitudes[-1], step, without)


def with_bands(scene: Scene, threshold: StickThreshold | None = None) -> StickThreshold:
    """The threshold of the reduced solution, if it is not given, and what is seen above it.

    A band that the reference sees counts if the reduced solution sticks in its middle too.
    """
    found = threshold or stick_threshold(scene)
    if found.F0 is None:
        return found
    above, mechanism = bands_above(scene, found.F0), with_threshold(scene)

    def confirmed(band: tuple[float, float]) -> bool:
        loaded = replace(mechanism, F0=0.5 * sum(band))
        return margin(loaded, steady_state(loaded)) < 0

    return replace(found, above=replace(above, bands=tuple(filter(confirmed, above.bands))))


def true_thresholds(scene: Scene) -> Comparison[dict[bool, StickThreshold]]:
    """The threshold of the reduced solution, for the physics with and without a static coefficient of its own.

    Where the suite has a theorem it is the proven interval, and only the scan above it is made; one that failed has its
    reason.

    Raises
    ------
    InputError
        If the scene has none that could be computed: it is no slider-bar, has no friction, or is not periodic.
    """
    with_threshold(scene)
    physics = {has_mus: physics_of(scene, has_mus) for has_mus in (False, True)}
    proven = {has_mus: threshold_of_theorem(varied) for has_mus, varied in physics.items()}

    def tabulate(outcomes: Sequence[Outcome]) -> dict[bool, StickThreshold]:
        return {
            has_mus: outcome.value
            or proven[has_mus]
            or StickThreshold(None, None, (np.nan, np.nan), f"{outcome.status}: {outcome.reason}")
            for has_mus, outcome in zip(physics, outcomes, strict=True)
        }

    return Comparison(
        tuple(
            Task(
                f"threshold/{truth_key(scene.name, has_mus)}/truth",
                with_bands,
                (varied, proven[has_mus]),
            )
            for has_mus, varied in physics.items()
        ),
        tabulate,
    )


def plan(scope: Scope) -> Comparison[Tables]:
    """The threshold of every engine on the first scene, along its refinement series: `threshold_table`.

    The first search begins at the scene's own amplitude, finer ones at the variant's own coarser bracket. Only the
    range of a search uses the truth: from half the smaller to twice the larger of that amplitude and the true one.
    Each ends with a bracket of the depth's width (with located events: `LOCATED_WIDTH`). The bracket is the variant's
    own: it was seen to stick at one end and not at the other.
    """
    scene, true = scope.scenes[0], scope.known[TRUTH]
    variants, width, tasks = (
        threshold_variants(scope.engines, scope.depth),
        extent(scope.depth).bracket,
        [],
    )
    for variant in variants:
        has_mus = has_static_coefficient(variant)
        physics = physics_of(scene, has_mus)
        start = max(
            load.law.amplitude for load in physics.forces.values() if isinstance(load.law, Sine)
        )
        centre = true[has_mus].F0 or start
        search = Search(
            min(start, centre) / 2,
            2 * max(start, centre),
            LOCATED_WIDTH if variant.parameter == "rtol" else width,
            start,
            FIRST_PART * start,
        )
        tasks.append(
            Task(
                f"threshold/{scene.name}/{variant.label}",
                measure_series,
                (physics, variant, search),
            )
        )
    return Comparison(
        tuple(tasks),
        lambda outcomes: Tables({"threshold": threshold_table(scene, variants, outcomes, true)}),
        variants,
    )


def threshold_table(
    scene: Scene,
    variants: Sequence[Variant],
    outcomes: Sequence[Outcome],
    true: Mapping[bool, StickThreshold],
) -> pd.DataFrame:
    """One row per variant and step; the values of the outcomes are those of `measure_series`.

    The numerical uncertainty is the width of the bracket plus the rest of the transient. Along a refinement series the
    change from the next coarser step is added.
    """
    rows = []
    for variant, outcome in zip(variants, outcomes, strict=True):
        has_mus = has_static_coefficient(variant)
        truth, guide = (
            true[has_mus],
            next(iter(physics_of(scene, has_mus).frictional_guides.values())),
        )
        tier = Tier.HIGH_PRECISION
        if truth.F0 is None:
            tier = Tier.NONE
        elif truth.theorem:
            tier = Tier.PROVEN
        for step, found in zip(
            variant.ladder, outcome.value or [None] * len(variant.ladder), strict=True
        ):
            row = {
                "scene": scene.name,
                "variant": variant.label,
                "engine": label_of(variant.engine),
                "fidelity": variant.fidelity,
                "parameter": variant.parameter,
                "step": step,
                "status": outcome.status,
                "reason": outcome.reason or (found.remark if found else ""),
                TRUE_THRESHOLD: truth.F0,
                TIER: tier,
                "truth_note": truth.note,
                "true_threshold_uncertainty": truth.uncertainty,
                "theorem": truth.theorem,
                "paper_threshold": PAPER_VALUE,
                AGAIN: intervals_text(truth.above.bands) if truth.above else "",
                SCANNED: truth.above.end if truth.above else np.nan,
                "mus": guide.static_coefficient,
                "key": f"threshold/{run_key(scene, variant, step)}",
            }
            rows.append(
                row
                if found is None
                else row
                | {
                    WITH_STICK: found.with_stick,
                    WITHOUT_STICK: found.without_stick,
                    "runs": found.runs,
                    "residual": found.residual,
                }
            )
    table = pd.DataFrame(rows)
    if WITH_STICK not in table:
        return table
    ends, residual = table[[WITH_STICK, WITHOUT_STICK]].astype(float), table.pop("residual")
    middle = 0.5 * (ends[WITH_STICK] + ends[WITHOUT_STICK])
    change = middle.dropna().groupby(table["variant"]).diff().abs().reindex(table.index)
    width = ends[WITHOUT_STICK] - ends[WITH_STICK]
    return table.assign(
        **ends,
        **{
            MIDDLE: middle,
            ERROR: middle - table[TRUE_THRESHOLD].astype(float),
            UNCERTAINTY: width + residual + change.fillna(0.0),
            CHANGE: change,
        },
    )


def present(results: Results) -> Presentation:
    """The distance of each method's threshold from the truth, and the methods that are off by more than the search."""
    table = results.table("threshold")
    if table.empty or ERROR not in table or table[ERROR].isna().all():
        return Presentation()
    table = with_columns(table, CHANGE, TIER, AGAIN, SCANNED).assign(
        setting=list(map(setting_of, table["parameter"], table["step"]))
    )
    measured = table[table[ERROR].notna()]
    finest = measured.loc[measured.groupby("variant", sort=False)["step"].idxmin()]
    clearly, may_vanish = _off(finest)
    installed = table.loc[table["status"] != Status.MISSING, "variant"].unique()
    rows = {
        "truth": row_of("threshold", table, measured.index[0])[TRUE_THRESHOLD],
        "off": _errors(table, clearly),
        "inconclusive": _errors(table, may_vanish),
        "without": [variant for variant in installed if variant not in set(finest["variant"])],
        "proven": [
            row_of("threshold", table, label)
            for label in table[table[TIER] == Tier.PROVEN].drop_duplicates("mus").index
        ],
        **_above(table),
        **CONSTANTS,
    }
    headline = Headline(
        "error of the stick limit [N]",
        {
            row["variant"]: Uncertain(row[ERROR], row[UNCERTAINTY]).both()
            for row in finest.to_dict("records")
        },
    )
    columns = (
        METHOD,
        Column("fidelity"),
        Column("mus", form="g"),
        Column("setting"),
        Column(WITH_STICK, "sticks at", form=".6g", brief=False),
        Column(WITHOUT_STICK, "slips at", form=".6g", brief=False),
        Column(ERROR, "F0, difference from truth", interval=True),
        Column(AGAIN),
        Column("runs", brief=False),
        Column("reason", brief=False),
    )
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[
            view("threshold", finest, columns),
            view("threshold-all", table, columns, source="threshold", in_report=False),
        ],
        figures=[_figure(measured)],
    )


def _off(finest: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows whose error is larger than its uncertainty, by its size: those that are sure, and those that may vanish.

    Finer steps may remove an error at a step that is not the finest of all, or whose last refinement has changed it by
    more than `SETTLES` of itself.
    """
    beyond = finest[finest[ERROR].abs() > finest[UNCERTAINTY]]
    beyond = beyond.sort_values(ERROR, key=abs, kind="stable")
    has_steps = beyond["parameter"].eq("dt")
    is_coarser = beyond["step"] > finest.loc[finest["parameter"] == "dt", "step"].min()
    has_settled = beyond[CHANGE] < SETTLES * beyond[ERROR].abs()  # False where it is not known
    may_vanish = has_steps & (is_coarser | ~has_settled)
    return beyond[~may_vanish], beyond[may_vanish]


def _errors(table: pd.DataFrame, rows: pd.DataFrame) -> list[dict[str, object]]:
    """Methods with their errors."""
    return [
        {"variant": variant, "error": row_of("threshold", table, label)[ERROR]}
        for label, variant in rows["variant"].items()
    ]


def _above(table: pd.DataFrame) -> dict[str, object]:
    """Where the slider sticks again above the threshold of each physics, as far as the scan has seen.

    The end of the shortest scan is None if there was none.
    """
    scanned = table[table[SCANNED].notna()].drop_duplicates("mus")
    again = scanned[scanned[AGAIN].fillna("").ne("")]
    end = None
    if len(scanned):
        end = row_of("threshold", table, scanned[SCANNED].idxmin())[SCANNED]
    return {
        "again": [row_of("threshold", table, label) for label in again.index],
        "scanned_to": end,
    }


def _figure(measured: pd.DataFrame) -> Chart:
    """Intervals, a method a line; the steps of a method from coarse to fine below each other.

    The coarsest step has no interval: nothing is known of what a refinement changes.
    """
    names = list(measured["variant"].unique())
    series = []
    for place, variant in enumerate(names):
        runs = measured[measured["variant"] == variant].sort_values("step", ascending=False)
        offsets = np.linspace(0.25, -0.25, len(runs)) if len(runs) > 1 else np.zeros(1)
        is_known = runs[CHANGE].notna() | (runs["parameter"] != "dt")
        error = runs[ERROR].to_numpy(float)
        unsure = runs[UNCERTAINTY].where(is_known).to_numpy(float)
        series.append(
            Series(
                "",
                error,
                offsets - place,
                error - unsure,
                error + unsure,
                look=variant,
                line=False,
                points=True,
            )
        )
    panel = Panel(
        "",
        Axis("stick threshold on F0, difference from the truth [N]"),
        Axis("", ticks=[float(-place) for place in range(len(names))], words=names),
        series,
        horizontal=True,
        lines=(0.0,),
    )
    return Chart("threshold", (panel,), columns=1, height=1.0 + 0.24 * len(names))


STUDY = Study(
    "threshold",
    "Stick limit",
    "Up to which load amplitude does the slider stick in the steady state?",
    present,
    plan,
    {TRUTH: lambda scope: true_thresholds(scope.scenes[0])},
    seconds=10.0,
    takes=frozenset({"engines"}),
    applies=unless_refused(lambda scope: with_threshold(scope.scenes[0])),
    tables={
        "threshold": "Stick thresholds",
    },
)
