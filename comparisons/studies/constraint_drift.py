"""How far methods drift from the constraints: all engines on the scenes that are compared, and the paper's scheme over long runs.

The paper's question is what stabilization does against drift: none, Baumgarte's terms and projection, over many steps.
Baumgarte's stabilization replaces Phi'' = 0 by Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Zhuang & Wang 2014, eq. 25; Baumgarte 1972), whose roots
lambda = -alpha +- sqrt(alpha^2 - beta^2) the Runge-Kutta method of order 4 multiplies per step by R(h lambda), R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24
(Hairer & Wanner, Solving Ordinary Differential Equations II, Sect. IV.2). Where |R| > 1 residuals grow by that factor each step. Below, they stay, but the
stages of the method are off the constraints by O(h^2), which 2 alpha multiplies: the larger h lambda, the more the correction itself disturbs the motion.

What rounding makes of the residuals grows where a coordinate does. The method adds four terms to each coordinate in each step, which moves a residual by up to
4 ulp(q)/2 per unit of its derivative. A displacement delta per step settles at delta/h 2 alpha/beta^2, the integral of the answer of Phi'' + 2 alpha Phi' +
beta^2 Phi = 0 to Phi = delta. A bar that turns has an angle that grows for ever, and so does the ulp of it: at small steps that is all that is left of drift, and
a run that is started with the angle of a later time has the later time's drift from the beginning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.campaigns.participants import validation_campaign
from stiction.comparisons.depth import Depth
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import ROUNDING, drift_table, rounding_of
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED, growth
from stiction.comparisons.methods import at_equal_step, called, case_of, methods, one_per_variant, title_of
from stiction.comparisons.presentation.charts import LIMIT, Axis, Chart, Panel, Series
from stiction.comparisons.presentation.presentation import Headline, Presentation
from stiction.comparisons.presentation.table_view import Column, TableView, view
from stiction.comparisons.presentation.traced_text import Number, TracedText, count, listed, traced, value
from stiction.comparisons.results import Results
from stiction.comparisons.studies.accuracy import compared_runs
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.truth import slider_bar_truth
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import Record
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.registry import EngineMissing, UnknownEngine, load_engine
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import Scene, Trajectory, vary

SHORT = 24.0
"""s; the length of the paper's runs, over which accuracy is compared."""
LENGTHS = (24.0, 240.0, 2400.0)
"""s; after which it is asked whether drift grows."""
SAMPLES = 48_000
"""Of a long run, at most: 20 a second of 2400 s."""


@dataclass(frozen=True)
class Choice:
    """What is done against drift: a method of the engine, with alpha and beta (1/s) for Baumgarte's."""

    method: str
    alpha: float = 0.0
    beta: float = 0.0

    @property
    def label(self) -> str:
        return f"Baumgarte ({self.alpha:g}, {self.beta:g})" if self.method == "baumgarte" else self.method

    @property
    def roots(self) -> np.ndarray:
        return np.roots([1.0, 2 * self.alpha, self.beta ** 2])

    def amplification(self, step: float) -> float:
        """Largest factor by which a step multiplies a residual, nan where there is no Baumgarte term."""
        if self.method != "baumgarte":
            return float("nan")
        return float(np.max(np.abs(runge_kutta_factor(step * self.roots))))

    def largest_step(self) -> float:
        """The step at which residuals begin to grow, s; infinite without a Baumgarte term."""
        if self.method != "baumgarte":
            return float("inf")
        fastest = float(np.max(np.abs(self.roots)))
        return float(brentq(lambda step: self.amplification(step) - 1, 1.0 / fastest, 10.0 / fastest, xtol=1e-12))


def runge_kutta_factor(z: np.ndarray) -> np.ndarray:
    """What a step of the Runge-Kutta method of order 4 multiplies by, for z = h lambda; the exact solution by exp(z)."""
    return 1 + z + z ** 2 / 2 + z ** 3 / 6 + z ** 4 / 24


NONE, PAPERS = Choice("none"), Choice("baumgarte", 90.0, 10.0)
CHOICES = (NONE, PAPERS, Choice("baumgarte", 50.0, 50.0), Choice("baumgarte", 10.0, 10.0), Choice("baumgarte", 5.0, 5.0), Choice("projection"))
TWICE = 2.0
"""Times the error without stabilization, above which stabilization is said to do harm."""
STEPS = (1e-3, 2e-3, 5e-3, 1e-2)
BEYOND = (1.25e-2, 1.5e-2, 1.6e-2)
"""s; on both sides of the step at which the paper's choice becomes unstable, 15.5 ms."""


def long_runs(cases: Mapping[int, Scene], depth: Depth = Depth.FULL) -> list[tuple[Scene, Choice, float, float]]:
    """Scene, choice, step and time of every run.

    In full, those that the paper's statement is about for 2400 s, the rest for 240 s; in case 2 bar and drive move as in case 1, and so does drift. At
    other depths, case 1 alone for 240 s: its coarser steps, by default also what the paper's statement is about at all steps. By default there are also 24 s of case 3, whose
    position suffers most: its coarser steps, without stabilization and with the paper's.
    """
    runs = []
    for case, scene in cases.items():
        for choice in CHOICES:
            for step in (*STEPS, *(BEYOND if choice in (NONE, PAPERS) else ())):
                stated = case == 1 and choice in (NONE, PAPERS, CHOICES[-1]) and step in STEPS
                suffers = case == 3 and choice in (NONE, PAPERS) and step in STEPS[2:]
                from_depth = Depth.QUICK if case == 1 and step >= STEPS[2] else Depth.DEFAULT if stated or suffers else Depth.FULL
                if case != 2 and depth.reaches(from_depth):
                    in_full = LENGTHS[2] if stated else LENGTHS[1]
                    runs.append((scene, choice, step, in_full if depth is Depth.FULL else LENGTHS[1] if case == 1 else SHORT))
    return runs


def drift_study_comparison(cases: Mapping[int, Scene], depth: Depth = Depth.FULL) -> Comparison[DriftStudy]:
    """The study of the paper's cases, by number; its longest runs are begun first. See `long_runs`."""
    runs = sorted(long_runs(cases, depth), key=lambda run: -run[3] / run[2])
    return Comparison(tuple(Task(f"drift/{run_name(scene.name, choice.label, step)}", drift_run, (scene, choice, step, t_end))
                            for scene, choice, step, t_end in runs), drift_study)


def run_name(scene: str, choice: str, step: float) -> str:
    """What a run is called in the study and in the claims that rest on it."""
    return f"{scene}/{choice}/dt={step:g}"


ADDITIONS = 4
"""Of the Runge-Kutta method to each coordinate, a step: each is rounded by half an ulp at most."""


def rounding_level(scene: Scene, choice: Choice, step: float, run: Trajectory) -> np.ndarray:
    """What rounding may make of the position residual, m, at each instant of a run; see the module. Without a Baumgarte term that of its evaluation alone."""
    evaluation = np.full(len(run.t), rounding_of(run))
    if choice.method != "baumgarte":
        return evaluation
    states = [np.abs(values) for name, values in run.columns.items() if name.rpartition(".")[2] in ("x", "y", "angle")]
    largest = np.maximum.accumulate(np.max(states, axis=0))
    lever = np.hypot(1.0, scene.parameters["L"] / 2)  # an angle is in the drive's residual, and times half the bar in the pin's
    return evaluation + ADDITIONS * np.spacing(largest) / 2 / step * 2 * choice.alpha / choice.beta ** 2 * lever


@dataclass(frozen=True)
class DriftRun:
    """A row of the study, and the octaves of its drift."""

    row: Mapping[str, Any]
    octaves: tuple[tuple[float, float], ...]


def drift_run(scene: Scene, choice: Choice, step: float, t_end: float) -> DriftRun:
    """Run the paper's scheme with a choice against drift, and measure drift and error."""
    stabilized = vary(scene, {"stabilization.alpha": choice.alpha, "stabilization.beta": choice.beta}) if choice.method == "baumgarte" else scene
    run = ReferenceEngine().simulate(stabilized, t_end=t_end, dt=step, output_step=max(step, t_end / SAMPLES), stabilization=choice.method,
                                     event_values=False)
    period = SliderBar.from_scene(scene).period()
    rounding, drift = rounding_level(scene, choice, step, run), run["drift.position"]
    short = run.t <= SHORT
    row: dict[str, Any] = {
        "scene": scene.name, "choice": choice.label, "run": run_name(scene.name, choice.label, step), "alpha [1/s]": choice.alpha or None, "beta [1/s]": choice.beta or None, "step": step,
        "time [s]": t_end, "reason": "" if run.termination == "end" else run.termination, "steps [-]": run.cost.counters["steps"],
        "hlcp [-]": run.cost.counters["hlcp"], "amplification per step [-]": choice.amplification(step),
        "largest stable step [s]": choice.largest_step(), "position drift to 24 s, max [m]": float(np.max(drift[short])),
        "position drift, max [m]": float(np.max(drift)), "position drift by rounding at the end, at most [m]": float(rounding[-1]), "velocity drift, max [m/s]": float(np.max(run["drift.velocity"]))}
    if run.termination == "end":
        for length in (length for length in LENGTHS if length <= t_end):
            within = run.t <= length + step / 2
            law = growth(run.t[within], drift[within], period / 2, rounding[within])
            row |= {f"growth, {length:g} s": law.verdict, f"exponent of growth, {length:g} s [-]": law.exponent,
                    f"interval of the exponent, {length:g} s [-]": law.uncertainty, f"above rounding until, {length:g} s [s]": law.until, f"spread, of a random walk's, {length:g} s [-]": law.spread / law.walk}
        octaves = law.octaves
    else:
        octaves = ()
    truth = slider_bar_truth(scene, SHORT)
    first = ReferenceEngine().simulate(stabilized, t_end=SHORT, dt=step, output_step=1e-2, stabilization=choice.method, event_values=False)
    found = errors(first, truth, size_of(scene))
    row |= {name: found.get(name) for name in ("position error [m]", "position uncertainty [m]")}
    return DriftRun(row, octaves)


@dataclass(frozen=True)
class DriftStudy:
    """`table`: one row per run; `octaves`: one row per octave of each run that came to its end."""

    table: pd.DataFrame
    octaves: pd.DataFrame


def drift_study(outcomes: Sequence[Outcome]) -> DriftStudy:
    """The study from the outcomes of its runs.

    Beside what each run has, the table holds drift and error in units of the run without stabilization of the same scene and step, and from when on that one has drifted
    further.
    """
    runs = [outcome.value for outcome in outcomes if outcome.status == "ok"]
    lost = [{"scene": outcome.label.split("/")[1], "choice": outcome.label.split("/")[2], "step": float(outcome.label.rpartition("=")[2]),
             "status": outcome.status, "reason": outcome.reason or outcome.status} for outcome in outcomes if outcome.status != "ok"]
    table = pd.DataFrame([*({**run.row, "status": "ok"} for run in runs), *lost])
    octaves = pd.DataFrame([{"scene": run.row["scene"], "choice": run.row["choice"], "step": run.row["step"], "to [s]": end, "position drift, rms [m]": size}
                            for run in runs for end, size in run.octaves])
    if not runs:
        return DriftStudy(table, octaves)
    plain = {(run.row["scene"], run.row["step"]): run for run in runs if run.row["choice"] == NONE.label}
    for i, run in enumerate(runs):
        without = plain.get((run.row["scene"], run.row["step"]))
        if without is None or run is without:
            continue
        table.loc[i, "drift, of that without [-]"] = run.row["position drift to 24 s, max [m]"] / without.row["position drift to 24 s, max [m]"]
        if run.row["position error [m]"] is not None and without.row["position error [m]"] is not None:
            table.loc[i, "error, of that without [-]"] = run.row["position error [m]"] / without.row["position error [m]"]
        other = dict(without.octaves)
        better = [end for end, size in run.octaves if end in other and other[end] > size]
        table.loc[i, "less drift than without from [s]"] = min(better, default=float("inf")) / 2 if run.octaves else float("nan")
    order = {choice.label: number for number, choice in enumerate(CHOICES)}
    table = table.sort_values(["scene", "choice", "step"], key=lambda column: column.map(order) if column.name == "choice" else column,
                              ignore_index=True)
    return DriftStudy(table, octaves)


_AT_COARSEST = tuple(f"{name} at {1e3 * STEPS[-1]:g} ms, of that without [-]" for name in ("drift", "error"))


def harm(table: pd.DataFrame, choice: Choice) -> pd.DataFrame:
    """From which step on a choice does more harm than good, over the paper's 24 s; one row per scene.

    Columns: ``scene``, ``choice``; ``drift larger from [s]``: the step at which drift is that without stabilization; ``error twice as large from [s]``:
    the step at which the position error is twice that without; between neighbouring steps of the study both are interpolated in logarithms, nan where no step of the
    study is on the far side, the smallest step where all are, which is then no more than a bound; ``smallest step tried [s]``; ``largest stable step [s]``; and both ratios at
    the coarsest of `STEPS`.
    """
    rows = []
    if "drift, of that without [-]" not in table:
        return pd.DataFrame(rows)
    for scene, runs in table[table["choice"] == choice.label].groupby("scene", sort=False):
        runs = runs.sort_values("step")
        drift, error = (runs.set_index("step")[f"{name}, of that without [-]"] for name in ("drift", "error"))
        rows.append({"scene": scene, "choice": choice.label, "drift larger from [s]": _crossing(drift, 1.0), "error twice as large from [s]": _crossing(error, TWICE),
                     "smallest step tried [s]": float(runs["step"].min()), "largest stable step [s]": choice.largest_step(),
                     **{name: float(ratio.get(STEPS[-1], np.nan)) for name, ratio in zip(_AT_COARSEST, (drift, error))}})
    return pd.DataFrame(rows)


def _crossing(ratio: pd.Series, limit: float) -> float:
    """The smallest step from which on a ratio stays above a limit."""
    ratio = ratio.dropna()
    above = ratio.to_numpy() > limit
    first = len(above) - int(np.argmin(above[::-1])) if not above.all() else 0  # after the last that is not above
    if first == len(above):
        return float("nan")
    if first == 0:
        return float(ratio.index[0])
    (before, after), (low, high) = ratio.index[[first - 1, first]], ratio.iloc[[first - 1, first]]
    share = np.log(limit / low) / np.log(high / low)
    return float(before ** (1 - share) * after ** share)


def drift_findings(table: pd.DataFrame, scene: str) -> dict[str, list[Mapping[str, Any]]]:
    """For the paper's two statements about drift, by choice, the runs on its scene that they are decided by."""
    found = {}
    for label in (NONE.label, PAPERS.label):
        rows = table[(table["scene"] == scene) & (table["choice"] == label) & (table["reason"] == "") & table["step"].isin(STEPS)] if len(table) else table
        found[label] = rows.to_dict("records")
    return found


def longest(row: Mapping[str, Any]) -> tuple[str, float, float, float, float]:
    """Growth, exponent, its interval, the spread of its octaves in units of a random walk's, and the length, of the longest part of a run for which there is
    one."""
    length = max(length for length in LENGTHS if isinstance(row.get(f"growth, {length:g} s"), str))
    return (row[f"growth, {length:g} s"], *(row[f"{name}, {length:g} s [-]"] for name in (
        "exponent of growth", "interval of the exponent", "spread, of a random walk's")), length)


POSITION, VELOCITY = "position drift, max [m]", "velocity drift, max [m/s]"
IN_SHORT = "position drift to 24 s, max [m]"
EXPONENT, INTERVAL = "exponent of growth [-]", "interval of the exponent [-]"
PIECES = 60
"""Of the time: the largest drift in each is drawn."""
FLOOR = 1e-17
"""m and m/s: less, zero among it, is drawn here."""


def plan(scope: Scope) -> Comparison[Tables]:
    """The runs of all engines on the scenes; of the paper's cases also the long runs of the paper's scheme."""
    cases = dict(enumerate(scope.scenes, 1)) if scope.scenes == tuple(validation_campaign().scenes) else {}

    def tables(found: list[Any]) -> Tables:
        study, records = found
        return Tables({"drift": drift_table(records), "study": study.table, "octaves": study.octaves}, records)

    return side_by_side([drift_study_comparison(cases, scope.depth), compared_runs(scope)], tables)


def present(results: Results) -> Presentation:
    """Drift of each method in position and in velocity, its growth, and the paper's stabilization over long runs."""
    table, study = results.table("drift"), results.table("study")
    runs, worst = runs_at_equal_step(results, table)
    answer, findings = _engines(table, runs, worst)
    findings += _without_result(table, runs, worst)
    findings += [sentence for choice in (NONE, PAPERS, CHOICES[-1]) for sentence in _long_runs(study, choice)]
    findings += _price(study)
    headlines = (_headline("drift [m, rad]", table, worst[POSITION]),
                 _headline("velocity drift [m/s]", table, worst[VELOCITY]))
    tables = (*_engine_tables(table, runs, worst), *_study_tables(study))
    figures = (*_long_figures(study, results.table("octaves")), *_engine_figures(results))
    notes = () if not tables else (
        "Drift is the norm of the residuals of the constraints, gaps in m and angles in rad together, or of their "
        "rates; 0 is below "
        f"{ROUNDING:g} m, rad or m/s, which rounding makes. With contacts it holds what they penetrate.",
        *_coordinates(table, runs), *((_why_harm(),) if len(study) else ()))
    return Presentation(answer, tuple(findings), headlines if len(worst) else (), tables, figures, notes)


def _headline(label: str, table: pd.DataFrame, rows: pd.Series) -> Headline:
    """The drift in a row for each method."""
    column = str(rows.name)
    return Headline(label, {method: traced("{}", drift_size("drift", table, int(row), column)) for method,
                            row in rows.items()})


def runs_at_equal_step(results: Results, table: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The runs of each method at equal step in each scene, and by method the labels of those that drift furthest."""
    chosen = set(methods(results))
    if POSITION not in table:
        return pd.DataFrame(), pd.DataFrame(columns=[POSITION, VELOCITY])
    parts = [at_equal_step(rows, variant) for (_, variant), rows in table.groupby(["scene", "variant"], sort=False)
             if variant in chosen]
    runs = pd.concat(parts) if parts else table.iloc[:0]
    measured = runs[runs[POSITION].notna()].groupby("variant", sort=False)
    return runs, pd.DataFrame({column: measured[column].idxmax() for column in (POSITION, VELOCITY)})


def drift_size(name: str, table: pd.DataFrame, label: int, column: str) -> Number:
    """The drift in a row of a table of the data; 0 where rounding makes as much."""
    if table.at[label, column] < ROUNDING:
        return Number("0", name, column, rows=(label + 1,))
    return value(name, table, label, column)


def above_rounding(frame: pd.DataFrame, columns: Sequence[str] = (POSITION, VELOCITY)) -> pd.DataFrame:
    """The frame with 0 in place of what rounding makes, in columns that hold drift."""
    return frame.assign(**{column: frame[column].where(~(frame[column] < ROUNDING), 0.0) for column in columns})


def _engines(table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame) -> tuple[TracedText, list[TracedText]]:
    """The answer, about the largest drift of each fidelity, and findings about both kinds of drift and about growth."""
    if worst.empty:
        return TracedText(""), []
    fidelity = {variant: table.at[row, "fidelity"] for variant, row in worst[POSITION].items()}
    parts, findings = [], []
    for name, place in (("joint", "at joints"), ("contact", "at contacts")):
        there = worst[[fidelity[variant] == name for variant in worst.index]]
        if there.empty:
            continue
        row, fastest = (int(there.loc[table.loc[there[column], column].set_axis(there.index).idxmax(), column])
                        for column in (POSITION, VELOCITY))
        parts.append(_largest(table, row, fastest, place))
        exponent, half = table.at[row, EXPONENT], table.at[row, INTERVAL]
        if name == "contact" and pd.notna(exponent):
            power = value("drift", table, row, EXPONENT, unsure=INTERVAL)
            findings.append(traced("The largest drift at contacts, {} m ({}, {}), goes with the power {} of time: {}.",
                                   drift_size("drift", table, row, POSITION),
                                   called(table.at[row, "variant"], False), case_of(table.at[row, "scene"]),
                                   _signed(power, exponent, half), table.at[row, "growth"]))
        findings = [*_opposite(table, there), *findings]
    scheme = worst[POSITION].get("paper's scheme")
    own = traced(" The paper's scheme: {} m.", drift_size("drift", table, int(scheme),
                                                          POSITION)) if scheme is not None else TracedText("")
    return traced("Methods drift by at most {}.{}", listed(parts, last=", "), own), [*findings, *_growth(table, runs)]


def _signed(power: Number, exponent: float, half: float) -> Number:
    """An exponent with its sign and its interval."""
    return Number(Uncertain(float(exponent), float(half)).both(), power.table, power.column, power.how, power.rows)


def _largest(table: pd.DataFrame, row: int, fastest: int, place: str) -> TracedText:
    """``9.9e-06 m and 0.0099 m/s at joints (pymunk)``."""
    first, second = (called(table.at[label, "variant"], False) for label in (row, fastest))
    sizes = drift_size("drift", table, row, POSITION), drift_size("drift", table, fastest, VELOCITY)
    if first == second:
        return traced("{} m and {} m/s {} ({})", *sizes, place, first)
    return traced("{} m ({}) and {} m/s ({}) {}", sizes[0], first, sizes[1], second, place)


def _opposite(table: pd.DataFrame, there: pd.DataFrame) -> list[TracedText]:
    """The methods with the least drift of position and of velocity, if they are not the same."""
    sizes = pd.DataFrame({column: table.loc[there[column], column].set_axis(there.index)
                          for column in (POSITION, VELOCITY)})
    sizes = above_rounding(sizes)
    still = sizes.sort_values([POSITION, VELOCITY], ascending=[True, False]).index[0]
    slow = sizes.sort_values([VELOCITY, POSITION], ascending=[True, False]).index[0]
    if not (sizes.at[still, VELOCITY] > sizes.at[slow, VELOCITY]
            and sizes.at[slow, POSITION] > sizes.at[still, POSITION]):
        return []
    parts = [part for variant in (still, slow) for part in (
        called(variant), *(drift_size("drift", table, int(there.at[variant, column]), column)
                           for column in (POSITION, VELOCITY)))]
    return [traced("Position and velocity rank methods differently: {} drifts by {} m and {} m/s, {} by {} m and {} "
                   "m/s.", *parts)]


def _growth(table: pd.DataFrame, runs: pd.DataFrame) -> list[TracedText]:
    """In how many of the runs that are compared drift grows, and up to which size."""
    measured = runs[runs["growth"].notna()]
    if measured.empty:
        return []
    keys = frozenset(measured["key"])
    growing = measured[measured["growth"] == GROWS]
    counts = {verdict: count("drift", table, growth=verdict, key=keys)
              for verdict in (GROWS, BOUNDED, ROUNDED, INCONCLUSIVE)}
    names = listed([called(variant) for variant in dict.fromkeys(growing["variant"])])
    least = traced(" ({}; up to {} m)", names, drift_size("drift", table, int(growing[POSITION].idxmax()),
                                                          POSITION)) if len(growing) else TracedText("")
    return [traced("Drift clearly grows in {} of {} runs{}. It is bounded in {} and rounding in {}; in {} the run is "
                   "too short to say.",
                   counts[GROWS], count("drift", table, key=keys), least, counts[BOUNDED], counts[ROUNDED],
                   counts[INCONCLUSIVE])]


def _without_result(table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame) -> list[TracedText]:
    """The methods whose runs failed, in all cases or in some."""
    if runs.empty:
        return []
    failed = runs[runs[POSITION].isna()]
    parts = [traced("{} in {} of {}", called(variant), count("drift", table, key=frozenset(rows["key"])),
                    count("drift", table, key=frozenset(runs.loc[runs["variant"] == variant, "key"])))
             for variant, rows in failed.groupby("variant", sort=False)]
    return [traced("Runs that failed and have no drift: {}.", listed(parts))] if parts else []


def _coordinates(table: pd.DataFrame, runs: pd.DataFrame) -> tuple[str, ...]:
    """Which engines can hardly drift."""
    if runs.empty:
        return ()
    joints = runs[runs["fidelity"] == "joint"].drop_duplicates("variant")
    names = [called(variant) for variant, engine in zip(joints["variant"], joints["engine"])
             if _has_joint_coordinates(engine)]
    if not names:
        return ()
    return (f"Joint coordinates ({', '.join(names)}) hold pins and guides by construction: what drifts is the drive "
            f"and closed loops alone, so that little drift is no merit.",)


def _has_joint_coordinates(engine: str) -> bool:
    """Tell whether an engine moves a tree of links; of one that is not known or installed here, it is not said."""
    try:
        return isinstance(load_engine(engine), TreeEngine)
    except (EngineMissing, UnknownEngine):
        return False


def _long_runs(study: pd.DataFrame, choice: Choice) -> list[TracedText]:
    """By which laws drift grows over the lengths of the study, of all runs that reach them."""
    sentences = []
    for length in LENGTHS[1:]:
        law = f"growth, {length:g} s"
        if law not in study or study.loc[study["choice"] == choice.label, law].isna().all():
            continue
        asked = frozenset(time for time in study["time [s]"].dropna() if time >= length)
        rows = study[(study["choice"] == choice.label) & study["time [s]"].isin(asked)]
        if rows.empty:
            continue
        growing = rows[rows[law] == GROWS]
        of_all = {"choice": choice.label, "time [s]": asked}
        words = {GROWS: "growing in {}", BOUNDED: "bounded in {}", ROUNDED: "rounding in {}",
                 INCONCLUSIVE: "inconclusive in {}"}
        laws = [traced(text, count("study", study, **of_all, **{law: verdict})) for verdict, text in words.items()
                if (rows[law] == verdict).any()]
        early = rows[rows[law].isna()]
        laws += [traced("unknown (stopped early) in {}",
                        count("study", study, **of_all, run=frozenset(early["run"])))] if len(early) else []
        cases = listed([case_of(scene) for scene in dict.fromkeys(rows["scene"])])
        ends = [_milliseconds(study, int(row)) for row in dict.fromkeys((rows["step"].idxmin(), rows["step"].idxmax()))]
        sentences.append(traced("{}, drift is {} of {} runs of {} s. Cases and steps: {}, {} ms.",
                                _called_choice(choice), listed(laws),
                                count("study", study, **of_all), f"{length:g}", cases, listed(ends, last=" to ")))
        exponents = growing[f"exponent of growth, {length:g} s [-]"].dropna()
        if len(exponents):
            powers = [value("study", study, int(row), exponents.name, ".3g")
                      for row in dict.fromkeys((exponents.idxmin(), exponents.idxmax()))]
            sentences.append(traced("Powers of time are {}; the largest drift is {} m.", listed(powers, last=" to "),
                                    drift_size("study", study, int(growing[POSITION].idxmax()), POSITION)))
    return sentences


def _called_choice(choice: Choice) -> str:
    return {NONE: "In the paper's scheme without stabilization",
            PAPERS: "With the paper's Baumgarte terms"}.get(choice, f"With {choice.label}")


def _milliseconds(study: pd.DataFrame, row: int) -> Number:
    return Number(f"{1e3 * study.at[row, 'step']:g}", "study", "step", rows=(row + 1,), factor=1e3)


def _price(study: pd.DataFrame) -> list[TracedText]:
    """Drift with and without the paper's terms at the coarsest step, and where they harm the motion most."""
    if IN_SHORT not in study:
        return []
    sentences = []
    ended = study[(study["status"] == "ok") & study["step"].isin(STEPS)]
    pairs = ended.assign(row=ended.index).pivot(index=["scene", "step"], columns="choice", values="row")
    if not {NONE.label, PAPERS.label} <= set(pairs):
        return []
    pairs = pairs[[NONE.label, PAPERS.label]].dropna().astype(int)
    first = pairs[pairs.index.get_level_values("scene") == study["scene"].iloc[0]]
    if len(first):
        none, papers = first.iloc[-1]
        sentences.append(traced("In {} at a step of {} ms, drift in 24 s is {} m without stabilization and {} m with "
                                "the paper's terms.", case_of(study.at[none, "scene"]),
                                _milliseconds(study, none), *(drift_size("study", study, row, IN_SHORT)
                                                        for row in (none, papers))))
    harmed = pairs[[study.at[papers, "error, of that without [-]"] > TWICE for papers in pairs[PAPERS.label]]]
    if len(harmed):
        papers = int(study.loc[harmed[PAPERS.label], "error, of that without [-]"].idxmax())
        none = int(harmed.loc[harmed[PAPERS.label] == papers, NONE.label].iloc[0])
        sentences.append(traced("In {} at {} ms they raise the position error from {} to {} m.",
                                case_of(study.at[papers, "scene"]), _milliseconds(study, papers),
                                *(value("study", study, row, "position error [m]") for row in (none, papers))))
    return sentences


def _why_harm() -> str:
    """Why the paper's choice disturbs the motion at large steps, below those at which it is unstable."""
    fastest = PAPERS.roots[np.argmax(np.abs(PAPERS.roots))].real
    step = STEPS[-1]
    factor = float(runge_kutta_factor(np.array(step * fastest)))
    return (f"The paper's alpha and beta disturb the motion at large steps: their error equation has a root of "
            f"{fastest:.3g} 1/s. In {1e3 * step:g} ms the exact residual falls to "
            f"{np.exp(step * fastest):.2g} of itself, that of the Runge-Kutta method to {factor:.2g}. Beyond "
            f"{1e3 * PAPERS.largest_step():.3g} ms residuals grow with each step.")


def _engine_tables(table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame) -> tuple[TableView, ...]:
    """The largest drift of each method, and every run."""
    if worst.empty:
        return ()
    rows = []
    for variant, places in worst.iterrows():
        of_position, of_velocity = table.loc[places[POSITION]], table.loc[places[VELOCITY]]
        measured = runs.loc[(runs["variant"] == variant), POSITION].notna()
        rows.append({"fidelity": of_position["fidelity"], "variant": variant,
                     "cases": f"{measured.sum()} of {len(measured)}", POSITION: of_position[POSITION],
                     "position in": case_of(of_position["scene"]), VELOCITY: of_velocity[VELOCITY],
                     "velocity in": case_of(of_velocity["scene"]), "growth": _law(of_position)})
    all_measured = all(row["cases"].split(" of ")[0] == row["cases"].split(" of ")[1] for row in rows)
    frame = above_rounding(pd.DataFrame(rows))
    columns = (Column("variant", "method"), Column("fidelity"),
               Column("cases", "cases measured", brief=not all_measured), Column(POSITION, "drift", "m, rad"),
               Column("position in", "in"), Column(VELOCITY, "velocity drift", "m/s"), Column("velocity in", "in"),
               Column("growth", "growth of drift there"))
    behind = [runs.index[runs["variant"] == variant] + 1 for variant in worst.index]
    shown = view("drift", "Largest drift of each method, of all cases: steps nearest to 1 ms, the reference at its "
                          "tightest tolerance. t^p: the power of time fitted to it.",
                 frame, columns, source="drift", rows=behind)
    every = (Column("scene"), Column("variant", "method"), Column("fidelity"), Column("step", form="g"),
             Column(POSITION, "drift, max", "m, rad"),
             Column("position drift, end [m]", "drift, end", "m, rad"), Column(VELOCITY, "velocity drift, max", "m/s"),
             Column("velocity drift, end [m/s]", "velocity drift, end", "m/s"),
             Column("growth"), Column(EXPONENT, "power of time", uncertainty=INTERVAL, interval=True),
             Column("status"), Column("reason"))
    return shown, view("drift-all", "Drift of every run.", table, every, source="drift", in_report=False)


def _law(run: pd.Series) -> str:
    """``grows, t^(2.1 ± 1.3)``; what is bounded or rounding has no power."""
    if not isinstance(run["growth"], str):
        return ""
    if run["growth"] in (BOUNDED, ROUNDED) or pd.isna(run[EXPONENT]):
        return run["growth"]
    return f"{run['growth']}, t^({Uncertain(float(run[EXPONENT]), float(run[INTERVAL])).both()})"


def _study_tables(study: pd.DataFrame) -> tuple[TableView, ...]:
    """Drift of each choice against it over the steps, from which step on a choice does harm, and every run."""
    if IN_SHORT not in study:
        return ()
    scene = study["scene"].iloc[0]
    rows, behind = [], []
    for choice, runs in study[study["scene"] == scene].groupby("choice", sort=False):
        of_step = above_rounding(runs[runs["step"].isin(STEPS)], [IN_SHORT]).set_index("step")[IN_SHORT]
        counts = runs["growth, 240 s"].value_counts() if "growth, 240 s" in runs else {}
        rows.append({"choice": choice, **{f"drift at {1e3 * step:g} ms": of_step.get(step, np.nan) for step in STEPS},
                     "laws": ", ".join(f"{verdict} {number}" for verdict, number in counts.items())})
        behind.append(runs.index + 1)
    columns = (Column("choice", "stabilization"), *(Column(f"drift at {1e3 * step:g} ms", unit="m") for step in STEPS),
               Column("laws", "growth in 240 s: runs"))
    shown = view("study", f"Largest drift of the paper's scheme in 24 s, {case_of(scene)}, and the laws of its growth "
                          f"at all steps that were tried. In brackets alpha and beta, 1/s.",
                 pd.DataFrame(rows), columns, source="study", rows=behind)
    harmful = [(choice, found) for choice in CHOICES if choice != NONE and len(found := harm(study, choice))]
    harms = pd.concat([found for _, found in harmful], ignore_index=True).replace(np.inf,
                            np.nan) if harmful else pd.DataFrame(columns=["scene", "choice"])
    runs_of = [study.index[(study["scene"] == row.scene) & (study["choice"] == row.choice)] + 1
               for row in harms.itertuples()]
    whole = (Column("scene"), Column("choice"), Column("step", unit="s", form="g"),
             Column("time [s]", "time", "s", form="g"), Column(IN_SHORT, "drift in 24 s", "m, rad"),
             Column(POSITION, "drift", "m, rad"), Column(VELOCITY, "velocity drift", "m/s"),
             Column("position error [m]", "position error in 24 s", "m"),
             *(column for length in LENGTHS for column in (
                 Column(f"growth, {length:g} s"), Column(f"exponent of growth, {length:g} s [-]",
                        f"power, {length:g} s", uncertainty=f"interval of the exponent, {length:g} s [-]",
                                                         interval=True))),
             Column("status"), Column("reason"))
    return (shown,
            view("study-harm", "Steps from which on a choice does harm within 24 s: its drift is larger than without "
                               "stabilization, its position error twice as large; and the step up to "
                 "which it is stable. Where the step is the smallest that was tried, harm may begin before.", harms,
                 (Column("scene"), Column("choice"),
                  Column("drift larger from [s]", "drift larger from", "s", form=".2g"),
                  Column("error twice as large from [s]", "error twice as large from", "s", form=".2g"),
                  Column("largest stable step [s]", "stable up to", "s", form=".3g"),
                  Column("smallest step tried [s]", "smallest step tried", "s", form="g")), source="study",
                 rows=runs_of, in_report=False),
            view("study-all", "Every run of the paper's scheme.", study, whole, source="study", in_report=False))


def _long_figures(study: pd.DataFrame, octaves: pd.DataFrame) -> tuple[Chart, ...]:
    """The paper's Fig. 14 over a longer time, and drift over the step; a chart per scene with longer runs."""
    if IN_SHORT not in study or octaves.empty:
        return ()
    scenes = dict.fromkeys(octaves.loc[octaves["to [s]"] > SHORT, "scene"])
    return tuple(_long_figure(study[study["scene"] == scene], octaves[octaves["scene"] == scene], "fig14-drift"
                              if number == 0 else f"drift-{scene}")
                 for number, scene in enumerate(scenes))


def _long_figure(study: pd.DataFrame, octaves: pd.DataFrame, name: str) -> Chart:
    steps = [step for step in STEPS if step in set(octaves["step"])]
    over_time = [Series("", rows["to [s]"].to_numpy(), rows["position drift, rms [m]"].to_numpy(), look=label,
                        points=True, hollow=hollow)
                 for label in (NONE.label, PAPERS.label, CHOICES[-1].label)
                 for step, hollow in dict(zip(steps[:1] + steps[-1:], (True, False))).items()
                 if len(rows := octaves[(octaves["choice"] == label) & (octaves["step"] == step)])]
    ended = study[study["reason"].fillna("") == ""].sort_values("step")
    over_step = [Series(choice.label, rows["step"].to_numpy(), rows[IN_SHORT].to_numpy(), look=choice.label,
                        points=True)
                 for choice in CHOICES if len(rows := ended[ended["choice"] == choice.label])]
    title = f"hollow: {1e3 * steps[0]:g} ms, full: {1e3 * steps[-1]:g} ms" if len(steps) > 1 else ""
    panels = (Panel(title, Axis("time [s]", log=True, ticks=tuple(sorted(set(octaves["to [s]"])))),
                    Axis("drift, rms of an octave [m, rad]", log=True), over_time),
              Panel("", Axis("step [s]", log=True, ticks=tuple(sorted(set(study["step"].dropna())))),
                    Axis("drift, largest in 24 s [m, rad]", log=True), over_step,
                    lines=(PAPERS.largest_step(),)))
    caption = (f"Constraint drift of the paper's scheme (the paper's Fig. 14, over a longer time), "
               f"{case_of(study['scene'].iloc[0])}: (a) over time, (b) over the step. In brackets alpha and "
               f"beta, 1/s. Dotted: the step of {1e3 * PAPERS.largest_step():.3g} ms beyond which residuals grow with "
               f"the paper's choice.")
    return Chart(name, caption, panels, columns=2, height=2.5)


def _engine_figures(results: Results) -> tuple[Chart, ...]:
    """Drift of every method over time: position above, velocity below, a column a case."""
    chosen, by_scene = set(methods(results)), dict[str, list[Record]]()
    for record in results.records:
        if record.trajectory is not None and record.variant.label in chosen:
            by_scene.setdefault(record.scene, []).append(record)
    if not by_scene:
        return ()
    rows = (("drift.position", "drift [m, rad]"), ("drift.velocity", "velocity drift [m/s]"))
    panels = [_drift_panel(one_per_variant(records), name, title_of(scene), label) for name, label in rows for scene,
              records in by_scene.items()]
    caption = ("Drift of every method over time, the largest in each of "
               f"{PIECES} pieces: of position above, of velocity below. A method may be low in one and high in the "
               f"other. Dotted: {ROUNDING:g}, below which it is rounding.")
    return (Chart("drift-engines", caption, panels, columns=len(by_scene), share_x=True, share_y=True),)


def _drift_panel(records: Sequence[Record], name: str, title: str, label: str) -> Panel:
    series = []
    for record in records:
        if name in record.trajectory and len(record.trajectory.t) > 1:
            t, largest = _envelope(record.trajectory.t, record.trajectory[name])
            series.append(Series(record.variant.label, t, largest, look=record.variant.label))
    ends = np.array([min(one.x[0] for one in series), max(one.x[-1] for one in series)]) if series else np.zeros(0)
    series.append(Series("", ends, np.full(len(ends), ROUNDING), look=LIMIT))
    return Panel(title, Axis("time [s]"), Axis(label, log=True), series)


def _envelope(t: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest of the sizes in each of `PIECES` pieces of the time, `FLOOR` at least, and when."""
    known = np.isfinite(sizes)
    table = pd.DataFrame({"t": t[known], "size": np.maximum(sizes[known], FLOOR)})
    piece = pd.cut(table["t"], PIECES, labels=False)
    largest = table.loc[table.groupby(piece)["size"].idxmax()]
    return largest["t"].to_numpy(), largest["size"].to_numpy()


STUDY = Study("drift", "Drift", "How far do methods drift from the constraints?", 5, present, plan, seconds=1.2)
