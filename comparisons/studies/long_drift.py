"""Drift of the paper's scheme in long runs: without stabilization, with Baumgarte's terms and with projection.

Baumgarte's stabilization replaces Phi'' = 0 by Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Zhuang & Wang 2014, eq. 25;
Baumgarte 1972). The roots of its characteristic polynomial are lambda = -alpha +- sqrt(alpha^2 - beta^2). A step h of
the Runge-Kutta method of order 4 multiplies the corresponding solutions by R(h lambda), where
R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24 (Hairer & Wanner, Solving Ordinary Differential Equations II, Sect. IV.2). If
|R| > 1, residuals grow by this factor in each step. Otherwise they remain bounded. They do not vanish, because the
stages of the method violate the constraints by O(h^2), and the term 2 alpha Phi' multiplies these violations: the
larger h lambda, the more the correction itself disturbs the motion.

Rounding errors make residuals that grow with the coordinates. The method adds four terms to each coordinate q in each
step. Each addition is rounded by at most ulp(q)/2, so that a residual changes by at most 4 ulp(q)/2 times its
derivative with respect to q. If each step changes a residual by delta, it tends to (delta/h) 2 alpha/beta^2: the
solution that starts from Phi = 1, Phi' = 0 has the integral 2 alpha/beta^2 over time. The angle of a turning bar
grows without bound, and its ulp with it. At small steps the drift consists of nothing else; it then depends on the
angle and not on the time since the start.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import (
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables, only_cases_of_paper
from stiction.comparisons.bench.variants import run_command
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import rounding_of
from stiction.comparisons.measures.drift_growth import (
    BOUNDED,
    DECAYS,
    GROWS,
    INCONCLUSIVE,
    ROUNDED,
    Growth,
    growth,
)
from stiction.comparisons.studies.drift import POSITION, VELOCITY, above_rounding
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, vary
from stiction.truths import slider_bar_truth
from stiction.truths.reduced.slider_bar import SliderBar

SHORT = 24.0
"""Length of the paper's runs, s; errors and drifts of different choices are compared over this time."""
LENGTHS = (24.0, 240.0, 2400.0)
"""Lengths (s) after which the law of growth is determined; runs end after one of them."""
SAMPLES = 48_000
"""Largest number of samples of a run: 20 a second in 2400 s."""
ADDITIONS = 4
"""Terms that a step of the method adds to each coordinate; each addition is rounded by half an ulp at most."""
STEPS = (1e-3, 2e-3, 5e-3, 1e-2)
"""Steps (s) of the runs on which the paper's statements are judged."""
FINEST_COARSE_STEP = 5e-3
"""Finest of the `STEPS` (s) whose long runs are cheap enough for every depth."""
BEYOND = (1.25e-2, 1.5e-2, 1.6e-2)
"""Steps (s) around the one at which the paper's terms become unstable, 15.5 ms."""
TWICE = 2.0
"""Ratio to the error without stabilization above which the text reports that stabilization does harm."""
IN_SHORT = "position_drift_24s"
"""Column: largest drift of the position in `SHORT` seconds, m."""
ERROR = "position_error"
"""Column: largest position error in `SHORT` seconds, m."""
OCTAVE = "position_drift_rms"
"""Column: root mean square of the drift over an octave of time, m."""
DRIFT_RATIO = "drift_ratio"
"""Column: `IN_SHORT` divided by that of the run without stabilization of the same scene and step."""
ERROR_RATIO = "error_ratio"
"""Column: `ERROR` divided by that of the run without stabilization of the same scene and step."""


@dataclass(frozen=True)
class Choice:
    """A stabilization against drift.

    Attributes
    ----------
    method : str
        Value of the engine's setting ``stabilization``.
    alpha, beta : float
        Baumgarte's coefficients, 1/s; 0 for other methods.
    """

    method: str
    alpha: float = 0.0
    beta: float = 0.0

    @property
    def is_baumgarte(self) -> bool:
        """Whether the stabilization is Baumgarte's."""
        return self.method == "baumgarte"

    @property
    def label(self) -> str:
        """Name of the choice in tables and legends."""
        if self.is_baumgarte:
            return f"Baumgarte ({self.alpha:g}, {self.beta:g})"
        return self.method

    @property
    def roots(self) -> np.ndarray:
        """Roots of the characteristic polynomial of Baumgarte's equation, 1/s, shape (2,)."""
        return np.roots([1.0, 2 * self.alpha, self.beta**2])

    def amplification(self, step: float) -> float:
        """Return the largest factor by which a step (s) multiplies a residual; nan without Baumgarte's terms."""
        if not self.is_baumgarte:
            return math.nan
        return float(np.max(np.abs(runge_kutta_factor(step * self.roots))))

    def largest_step(self) -> float:
        """Return the step (s) beyond which residuals grow; infinite without Baumgarte's terms."""
        if not self.is_baumgarte:
            return math.inf
        # On each ray with a negative real part, the region of stability of the method ends once,
        # at |z| between 2.6 and 3.0. The fastest root therefore becomes unstable between these steps.
        fastest = float(np.max(np.abs(self.roots)))
        shortest, longest = 1.0 / fastest, 10.0 / fastest
        return float(
            brentq(lambda step: self.amplification(step) - 1, shortest, longest, xtol=1e-12)
        )


def runge_kutta_factor(z: np.ndarray) -> np.ndarray:
    """Return the factor of a step of the Runge-Kutta method of order 4 for z = h lambda; the exact one is exp(z)."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


NONE = Choice("none")
PAPERS = Choice("baumgarte", 90.0, 10.0)
"""The paper's terms."""
PROJECTION = Choice("projection")
CHOICES = (
    NONE,
    PAPERS,
    Choice("baumgarte", 50.0, 50.0),
    Choice("baumgarte", 10.0, 10.0),
    Choice("baumgarte", 5.0, 5.0),
    PROJECTION,
)
"""The choices that are compared, in the order of the tables."""
DESCRIBED = (NONE, PAPERS, PROJECTION)
"""The choices whose growth of drift the text of the study describes."""


@dataclass(frozen=True)
class LongRun:
    """A run of the paper's scheme with a choice of stabilization; `step` and `t_end` are in s."""

    scene: Scene
    choice: Choice
    step: float
    t_end: float

    @property
    def name(self) -> str:
        """Key of the run in the tables."""
        return f"{self.scene.name}/{self.choice.label}/dt={self.step:g}"


def long_runs(cases: Mapping[int, Scene], depth: Depth = Depth.FULL) -> list[LongRun]:
    """Return the runs on the paper's cases, by number, at a depth.

    - At every depth: case 1 with all choices and steps from `FINEST_COARSE_STEP` on, for 240 s.
    - At the default depth also: case 1 with the choices that the text describes and all `STEPS`, for 240 s; case 3,
      the case whose position errors increase most, with the coarser of these steps, without stabilization and with
      the paper's terms, for 24 s.
    - At full depth: cases 1 and 3 with all choices and steps, for 240 s; those that the paper's statement is about
      for 2400 s.

    Steps `BEYOND` the others are run without stabilization and with the paper's terms only. Case 2 is left out: its
    bar and its drive move as those of case 1, so that it has the same drift.
    """
    runs = []
    for (case, scene), choice, step in product(cases.items(), CHOICES, (*STEPS, *BEYOND)):
        is_of_paper = choice in (NONE, PAPERS)
        is_coarse = step >= FINEST_COARSE_STEP
        is_needed_for_statement = case == 1 and choice in DESCRIBED and step in STEPS
        is_inaccurate = case == 3 and is_of_paper and is_coarse and step in STEPS
        if case == 2 or (step in BEYOND and not is_of_paper):
            continue

        if case == 1 and is_coarse:
            least_depth = Depth.QUICK
        elif is_needed_for_statement or is_inaccurate:
            least_depth = Depth.DEFAULT
        else:
            least_depth = Depth.FULL
        if not depth.reaches(least_depth):
            continue

        if depth is Depth.FULL:
            t_end = LENGTHS[2] if is_needed_for_statement else LENGTHS[1]
        else:
            t_end = LENGTHS[1] if case == 1 else SHORT
        runs.append(LongRun(scene, choice, step, t_end))
    return runs


def drift_study_comparison(
    cases: Mapping[int, Scene], depth: Depth = Depth.FULL
) -> Comparison[Tables]:
    """Plan the tables of `drift_study` for the paper's cases, by number; the longest runs begin first."""
    runs = sorted(long_runs(cases, depth), key=lambda run: -run.t_end / run.step)
    return Comparison(
        tuple(Task(f"drift/{run.name}", drift_run, (run,)) for run in runs),
        lambda outcomes: drift_study(runs, outcomes),
    )


def plan(scope: Scope) -> Comparison[Tables] | None:
    """Plan the long runs; None for other scenes than the paper's cases."""
    if not scope.is_of_paper:
        return None
    return drift_study_comparison(dict(enumerate(scope.scenes, 1)), scope.depth)


def rounding_level(scene: Scene, choice: Choice, step: float, run: Trajectory) -> np.ndarray:
    """Return a bound of the position residual that rounding makes, m, at each instant of a run.

    The docstring of the module derives it. Without Baumgarte's terms it is the rounding of the residual's evaluation
    alone.
    """
    evaluation = np.full(len(run.t), rounding_of(run))
    if not choice.is_baumgarte:
        return evaluation
    coordinates = [
        np.abs(values)
        for name, values in run.columns.items()
        if name.endswith((".x", ".y", ".angle"))
    ]
    ulp = np.spacing(np.maximum.accumulate(np.max(coordinates, axis=0)))
    # Derivatives of the residuals with respect to an angle: 1 in the equation of the drive, L/2 in
    # that of the pin.
    derivative = np.hypot(1.0, scene.parameters["L"] / 2)
    displacement_per_second = ADDITIONS * ulp / 2 / step * derivative
    return evaluation + displacement_per_second * 2 * choice.alpha / choice.beta**2


DriftRun = tuple[dict[str, Any], tuple[tuple[float, float], ...]]
"""Columns that are measured on a run, and the end (s) and the root mean square drift (m) of each octave of its time."""


def drift_run(long: LongRun) -> DriftRun:
    """Run the paper's scheme with a choice of stabilization, and measure drift and error."""
    scene, choice, step, t_end = long.scene, long.choice, long.step, long.t_end
    if choice.is_baumgarte:
        terms = {"stabilization.alpha": choice.alpha, "stabilization.beta": choice.beta}
        simulated_scene = vary(scene, terms)
    else:
        simulated_scene = scene

    def simulate(end: float, output_step: float) -> Trajectory:
        return ReferenceEngine().simulate(
            simulated_scene,
            t_end=end,
            dt=step,
            output_step=output_step,
            stabilization=choice.method,
            event_values=False,
        )

    run = simulate(t_end, max(step, t_end / SAMPLES))
    drift = run["drift.position"]
    row: dict[str, Any] = {
        "reason": "" if run.termination == "end" else run.termination,
        IN_SHORT: float(np.max(drift[run.t <= SHORT])),
        POSITION: float(np.max(drift)),
        VELOCITY: float(np.max(run["drift.velocity"])),
    }

    octaves: tuple[tuple[float, float], ...] = ()
    if run.termination == "end":
        rounding = rounding_level(scene, choice, step, run)
        transient = SliderBar.from_scene(scene).period() / 2
        for length in LENGTHS:
            if length > t_end:
                continue
            within = run.t <= length + step / 2
            law = growth(run.t[within], drift[within], transient, rounding[within])
            row |= _growth_columns(law, length)
            # Those of the longest time remain.
            octaves = law.octaves

    # The error is that of a run of its own, with samples at other instants.
    measured = errors(simulate(SHORT, 1e-2), slider_bar_truth(scene, SHORT), size_of(scene))
    row |= {name: measured.get(name) for name in (ERROR, "position_uncertainty")}
    return row, octaves


def _growth_columns(law: Growth, length: float) -> dict[str, Any]:
    """Return the columns of the law of growth over a length of time (s)."""
    return {
        f"growth_{length:g}s": law.verdict,
        f"growth_exponent_{length:g}s": law.exponent,
        f"growth_exponent_uncertainty_{length:g}s": law.uncertainty,
        f"walk_spread_{length:g}s": law.spread,
    }


def drift_study(runs: Sequence[LongRun], outcomes: Sequence[Outcome]) -> Tables:
    """Return the tables of the study from the outcomes of its runs.

    ``study`` has a row per run, with drift and error also as ratios to those of the run without stabilization of the
    same scene and step. ``octaves`` has a row per octave of each run that reached its end.
    """
    rows, octaves = [], []
    for run, outcome in zip(runs, outcomes, strict=True):
        failure: DriftRun = {"reason": outcome.reason or outcome.status}, ()
        measured, octaves_of_run = outcome.value or failure
        choice = run.choice
        identity = {"scene": run.scene.name, "choice": choice.label, "step": run.step}
        rows.append(
            {
                **identity,
                "run": run.name,
                "alpha": choice.alpha or None,
                "beta": choice.beta or None,
                "time": run.t_end,
                **measured,
                "status": outcome.status,
                AGAIN: _rerun_command(run) if outcome.value else None,
            }
        )
        octaves += [{**identity, "octave_end": end, OCTAVE: rms} for end, rms in octaves_of_run]
    table = _with_ratios(pd.DataFrame(rows))
    place = {choice.label: number for number, choice in enumerate(CHOICES)}
    table = table.sort_values(
        ["scene", "choice", "step"],
        ignore_index=True,
        key=lambda column: column.map(place) if column.name == "choice" else column,
    )
    return Tables({"study": table, "octaves": pd.DataFrame(octaves)})


def _rerun_command(run: LongRun) -> str | None:
    """Return the command that repeats a run."""
    choice = run.choice
    options = [
        ("t-end", f"{run.t_end:g}"),
        ("dt", f"{run.step:g}"),
        ("setting", f"stabilization={choice.method}"),
    ]
    if choice.is_baumgarte:
        options.append(("set", f"stabilization.alpha={choice.alpha:g}"))
        options.append(("set", f"stabilization.beta={choice.beta:g}"))
    return run_command(run.scene.name, "reference", options)


def _with_ratios(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table of runs with `DRIFT_RATIO` and `ERROR_RATIO`, unless all runs failed."""
    if IN_SHORT not in table:
        return table
    # For each row, the row without stabilization of the same scene and step.
    is_none = table["choice"] == NONE.label
    scene_and_step = pd.MultiIndex.from_frame(table[["scene", "step"]])
    without = table[is_none].set_index(["scene", "step"]).reindex(scene_and_step)
    without = without.set_index(table.index)
    ratios = {
        ratio: (table[column] / without[column]).where(~is_none)
        for ratio, column in ((DRIFT_RATIO, IN_SHORT), (ERROR_RATIO, ERROR))
    }
    return table.assign(**ratios)


class Law(NamedTuple):
    """The law of growth of the drift of a run.

    Attributes
    ----------
    verdict, exponent : str, float
        As in `Growth`.
    interval : float
        Half of the exponent's confidence interval.
    spread : float
        Spread of the octaves in units of that of a random walk, as in `Growth`.
    length : float
        Time over which the law was determined, s.
    """

    verdict: str
    exponent: float
    interval: float
    spread: float
    length: float


def decisive_runs(
    table: pd.DataFrame, scene: str, choice: Choice
) -> list[tuple[dict[Hashable, Any], Law]]:
    """Return the runs by which the paper's statements about drift are judged, each with its law.

    These are the runs on a scene with a choice that reached their end, with `STEPS`. The law is that over the longest
    time for which the run has one.
    """
    if table.empty:
        return []
    is_decisive = (
        (table["scene"] == scene)
        & (table["reason"] == "")
        & table["step"].isin(STEPS)
        & (table["choice"] == choice.label)
    )
    runs_and_laws = []
    for run in table[is_decisive].to_dict("records"):
        lengths = [length for length in LENGTHS if isinstance(run.get(f"growth_{length:g}s"), str)]
        length = max(lengths)
        law = Law(
            run[f"growth_{length:g}s"],
            run[f"growth_exponent_{length:g}s"],
            run[f"growth_exponent_uncertainty_{length:g}s"],
            run[f"walk_spread_{length:g}s"],
            length,
        )
        runs_and_laws.append((run, law))
    return runs_and_laws


def present(results: Results) -> Presentation:
    """Present the growth and the size of drift with each stabilization, and the harm that the paper's terms do."""
    study, octaves = results.table("study"), results.table("octaves")
    if IN_SHORT not in study:
        return Presentation()

    # A figure for each scene with octaves beyond the paper's time; the first scene's extends Fig. 14.
    scenes = octaves.loc[octaves["octave_end"] > SHORT, "scene"].unique() if len(octaves) else ()
    figure_names = {
        scene: f"drift-{scene}" if number else "fig14-drift" for number, scene in enumerate(scenes)
    }
    figures = [
        _figure(study[study["scene"] == scene], octaves[octaves["scene"] == scene], name)
        for scene, name in figure_names.items()
    ]

    laws = [_growth_of(study, choice) for choice in DESCRIBED]
    return Presentation(
        rows={
            "scene": study["scene"].iloc[0],
            "compared": _at_finest_and_coarsest_step(study),
            "laws": [law for law in laws if law],
            "harmed": _most_harmed(study),
            "papers": _stability_of_papers_terms(),
            "drawn": [{"figure": name, "scene": scene} for scene, name in figure_names.items()],
        },
        tables=[_by_choice(study), _all_runs(study)],
        figures=figures,
    )


def _growth_of(study: pd.DataFrame, choice: Choice) -> dict[str, object]:
    """Count the runs with each law of growth over the longest time that has laws; empty if none has."""
    runs = study[study["choice"] == choice.label]
    columns_with_values = runs.dropna(axis="columns", how="all")
    lengths = [length for length in LENGTHS[1:] if f"growth_{length:g}s" in columns_with_values]
    if not lengths:
        return {}
    length = max(lengths)
    runs = runs[runs["time"] >= length]
    laws = runs[f"growth_{length:g}s"]
    exponents = runs.loc[laws == GROWS, f"growth_exponent_{length:g}s"].dropna()
    return {
        "method": choice.method,
        "length": length,
        "scenes": list(runs["scene"].unique()),
        "runs": len(runs),
        "grows": int((laws == GROWS).sum()),
        "bounded": int((laws == BOUNDED).sum()),
        "decays": int((laws == DECAYS).sum()),
        "rounded": int((laws == ROUNDED).sum()),
        "inconclusive": int((laws == INCONCLUSIVE).sum()),
        "unknown": int(laws.isna().sum()),  # the run failed or stopped early
        "steps": _smallest_and_largest(study, runs["step"]),
        "powers": _smallest_and_largest(study, exponents),
    }


def _smallest_and_largest(study: pd.DataFrame, values: pd.Series) -> list[object]:
    """Return the cells of the smallest and the largest value of a column of `study`.

    A single cell if both are the same, no cell if there are no values.
    """
    if values.empty:
        return []
    labels = dict.fromkeys((values.idxmin(), values.idxmax()))
    return [row_of("study", study, label)[values.name] for label in labels]


def _papers_runs(study: pd.DataFrame) -> pd.DataFrame:
    """Return the runs with the paper's terms that have a counterpart without stabilization."""
    is_of_paper = (study["choice"] == PAPERS.label) & study["step"].isin(STEPS)
    return study[is_of_paper & study[DRIFT_RATIO].notna()]


def _beside_none(study: pd.DataFrame, label: int) -> dict[str, Row]:
    """Return a run with the paper's terms and the run without stabilization of the same scene and step."""
    scene, step = study.loc[label, ["scene", "step"]]
    is_counterpart = (
        (study["scene"] == scene) & (study["step"] == step) & (study["choice"] == NONE.label)
    )
    return {
        "papers": row_of("study", study, label),
        "none": row_of("study", study, study.index[is_counterpart][0]),
    }


def _at_finest_and_coarsest_step(study: pd.DataFrame) -> list[dict[str, Row]]:
    """Return the runs with and without the paper's terms on the first scene at two steps; drift by rounding is 0."""
    papers = _papers_runs(study)
    steps = papers.loc[papers["scene"] == study["scene"].iloc[0], "step"]
    if steps.empty:
        return []
    rounded = above_rounding(study, [IN_SHORT])
    labels = dict.fromkeys((steps.idxmin(), steps.idxmax()))
    return [_beside_none(rounded, label) for label in labels]


def _most_harmed(study: pd.DataFrame) -> list[dict[str, Row]]:
    """Return the run on each scene whose error the paper's terms increase most; none if no ratio exceeds `TWICE`."""
    ratios = _papers_runs(study).dropna(subset=[ERROR_RATIO])
    if not (ratios[ERROR_RATIO] > TWICE).any():
        return []
    worst = ratios.loc[ratios.groupby("scene")[ERROR_RATIO].idxmax()]
    ordered = worst.sort_values(ERROR_RATIO, ascending=False)
    return [_beside_none(study, label) for label in ordered.index]


def _stability_of_papers_terms() -> dict[str, float]:
    """Return the roots (1/s) of Baumgarte's equation with the paper's terms, and factors of a residual per step.

    ``exact`` and ``computed`` are the factors of the fast root for a step of ``step`` ms, exactly and with the
    Runge-Kutta method. ``unstable`` is the step (ms) beyond which residuals grow.
    """
    slow, fast = sorted(PAPERS.roots.real, key=abs)
    step = STEPS[-1]
    return {
        "alpha": PAPERS.alpha,
        "beta": PAPERS.beta,
        "fast": fast,
        "slow": slow,
        "step": 1e3 * step,
        "exact": math.exp(step * fast),
        "computed": float(runge_kutta_factor(np.array(step * fast))),
        "unstable": 1e3 * PAPERS.largest_step(),
    }


def _by_choice(study: pd.DataFrame) -> TableView:
    """Return the table of drift on the first scene: a row per choice, a column per step, and the laws of growth."""
    runs = study[study["scene"] == study["scene"].iloc[0]]
    sizes = above_rounding(runs, [IN_SHORT]).pivot(index="choice", columns="step", values=IN_SHORT)
    names = {step: f"{IN_SHORT} at {step:g}" for step in STEPS}
    sizes = sizes.reindex(runs["choice"].unique(), columns=STEPS)
    frame = sizes.rename(columns=names).reset_index()
    labels = [runs.index[runs["choice"] == choice] for choice in frame["choice"]]
    law = "growth_240s"
    if law in runs:
        frame["laws"] = [_counts_text(runs.loc[labels_of_row, law]) for labels_of_row in labels]
    drifts = [
        Column(name, f"drift at {1e3 * step:g} ms", "m", of=IN_SHORT)
        for step, name in names.items()
    ]
    columns = (
        Column("choice", "stabilization"),
        *drifts,
        Column("laws", "growth in 240 s (number of runs)"),
    )
    numbers = [labels_of_row + 1 for labels_of_row in labels]
    return view("study", frame, columns, source="study", rows=numbers)


def _counts_text(laws: pd.Series) -> str:
    """Return the number of runs with each law, the most frequent first: ``bounded 3, grows 1``."""
    return ", ".join(f"{law} {number}" for law, number in laws.value_counts().items())


def _all_runs(study: pd.DataFrame) -> TableView:
    """Return the table of all runs with their laws over each length."""
    laws = [
        column
        for length in LENGTHS
        for column in (
            Column(f"growth_{length:g}s"),
            Column(
                f"growth_exponent_{length:g}s",
                f"power, {length:g} s",
                uncertainty=f"growth_exponent_uncertainty_{length:g}s",
                interval=True,
            ),
        )
    ]
    columns = (
        Column("scene"),
        Column("choice"),
        Column("step", unit="s", form="g"),
        Column("time", form="g"),
        Column(IN_SHORT, "drift in 24 s"),
        Column(POSITION, "drift"),
        Column(VELOCITY, "velocity drift"),
        Column(ERROR, "position error in 24 s"),
        Column(DRIFT_RATIO, "drift / that without"),
        Column(ERROR_RATIO, "error / that without"),
        *laws,
        Column("status"),
        Column("reason"),
    )
    return view("study-all", study, columns, source="study", in_report=False)


def _figure(study: pd.DataFrame, octaves: pd.DataFrame, name: str) -> Chart:
    """Return a figure of one scene: the paper's Fig. 14 over a longer time, and drift over the step."""
    steps = [step for step in STEPS if step in set(octaves["step"])]
    title = ""
    if len(steps) > 1:
        title = f"open markers: {1e3 * steps[0]:g} ms, filled: {1e3 * steps[-1]:g} ms"
    panels = (
        Panel(
            title,
            Axis("time [s]", log=True, ticks=sorted(set(octaves["octave_end"]))),
            Axis("drift, rms over an octave [m, rad]", log=True),
            _drift_over_time(octaves, steps[0], steps[-1]),
        ),
        Panel(
            "largest in 24 s",
            Axis("step [s]", log=True, ticks=sorted(set(study["step"]))),
            Axis("drift, largest in 24 s [m, rad]", log=True),
            _drift_over_step(study),
            lines=(PAPERS.largest_step(),),
        ),
    )
    return Chart(name, panels, columns=2, height=2.5)


def _drift_over_time(octaves: pd.DataFrame, finest: float, coarsest: float) -> list[Series]:
    """Return the series of drift in each octave: open markers for the finest step, filled ones for the coarsest."""
    series = []
    for choice, step in product(DESCRIBED, dict.fromkeys((finest, coarsest))):
        rows = octaves[(octaves["choice"] == choice.label) & (octaves["step"] == step)]
        if len(rows):
            series.append(
                Series(
                    "",
                    rows["octave_end"].to_numpy(),
                    rows[OCTAVE].to_numpy(),
                    look=choice.label,
                    points=True,
                    hollow=step != coarsest,
                )
            )
    return series


def _drift_over_step(study: pd.DataFrame) -> list[Series]:
    """Return the series of drift over the step, of the runs that reached their end."""
    completed = study[(study["status"] == Status.OK) & (study["reason"] == "")].sort_values("step")
    series = []
    for choice in CHOICES:
        rows = completed[completed["choice"] == choice.label]
        if len(rows):
            series.append(
                Series(
                    choice.label,
                    rows["step"].to_numpy(),
                    rows[IN_SHORT].to_numpy(),
                    look=choice.label,
                    points=True,
                )
            )
    return series


STUDY = Study(
    "long-drift",
    "Long runs",
    "How much does stabilization reduce the drift in long runs?",
    present,
    plan,
    seconds=0.8,
    on_page_one=False,
    compared=False,
    applies=only_cases_of_paper,
    tables={
        "study": "Drift over long runs",
        "octaves": "Drift by octave of time",
    },
)
