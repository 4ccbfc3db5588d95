"""Drift and what is done against it: the paper's scheme without stabilization, with Baumgarte's and with projection, over long runs and many steps.

Baumgarte's stabilization replaces Phi'' = 0 by Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Zhuang & Wang 2014, eq. (25); Baumgarte 1972), whose roots
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

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.depth import Depth
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import rounding_of
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED, growth
from stiction.comparisons.truth import slider_bar_truth
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
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


def plan(cases: Mapping[int, Scene], depth: Depth = Depth.FULL) -> list[tuple[Scene, Choice, float, float]]:
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
    """The study of the paper's cases, by number; its longest runs are begun first. See `plan`."""
    runs = sorted(plan(cases, depth), key=lambda run: -run[3] / run[2])
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
LAW_IN_WORDS = {GROWS: "grows", BOUNDED: "is bounded", ROUNDED: "is no more than rounding makes it", INCONCLUSIVE: "neither clearly grows nor is clearly bounded"}


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


def drift_words(table: pd.DataFrame) -> list[str]:
    """The paragraphs of the study, from its table: by which laws drift grows, and why the paper's choice does harm at large steps."""
    if table.empty or "growth, 240 s" not in table:
        return []
    laws = []
    for label, start in ((NONE.label, "Without stabilization"), (PAPERS.label, f"With the paper's choice, {PAPERS.label},")):
        rows = table[(table["choice"] == label) & (table["reason"] == "") & table["step"].isin(STEPS)]
        for length in LENGTHS[::-1]:
            column = f"growth, {length:g} s"
            if column in rows and (told := rows[rows[column].notna()]).shape[0]:
                exponents = told[f"exponent of growth, {length:g} s [-]"].dropna()
                counts = " and ".join(f"{LAW_IN_WORDS[verdict]} in {count}" for verdict, count in told[column].value_counts().items())
                powers = f" Fitted powers of time are {exponents.min():.2g} to {exponents.max():.2g}." if len(exponents) else ""
                laws.append(f"{start} the drift {counts} of {len(told)} runs of {length:g} s.{powers}")
                break
    fastest = PAPERS.roots[np.argmax(np.abs(PAPERS.roots))].real
    factor = float(runge_kutta_factor(np.array(STEPS[-1] * fastest)))
    why = (f"Why the paper's choice does harm at large steps: the fastest root of its error equation is {fastest:.4g} 1/s. In a step of {1e3 * STEPS[-1]:g} ms the exact residual falls to "
           f"{np.exp(STEPS[-1] * fastest):.2g} of itself, that of the Runge-Kutta method to {factor:.2g}. So the correction is not resolved any more, and disturbs the motion. Only beyond "
           f"{1e3 * PAPERS.largest_step():.3g} ms does the method multiply residuals by more than 1. Up to there the correction is stable, and wrong.")
    return [*([" ".join(laws)] if laws else []), why]


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
