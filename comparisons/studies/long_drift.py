"""Drift of the paper's scheme over long runs: no stabilization, Baumgarte's terms or projection, at several steps.

Baumgarte's stabilization replaces Phi'' = 0 by Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Zhuang & Wang 2014, eq. 25;
Baumgarte 1972), whose roots are lambda = -alpha +- sqrt(alpha^2 - beta^2). The Runge-Kutta method of order 4 multiplies
them per step by R(h lambda), R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24 (Hairer & Wanner, Solving Ordinary Differential
Equations II, Sect. IV.2). Where |R| > 1 residuals grow by that factor each step. Below, they stay, but the stages of
the method are off the constraints by O(h^2), which 2 alpha multiplies: the larger h lambda, the more the correction
itself disturbs the motion.

Residuals by rounding grow where a coordinate does. The method adds four terms to each coordinate in each step, which
moves a residual by up to 4 ulp(q)/2 per unit of its derivative. A displacement delta per step settles at
delta/h 2 alpha/beta^2, the integral of the answer of Phi'' + 2 alpha Phi' + beta^2 Phi = 0 to Phi = delta. The angle of
a bar that turns grows for ever, and so does its ulp. At small steps that is all that is left of drift: a run that
starts with the angle of a later time has the later time's drift from the beginning.
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
from stiction.comparisons.bench.participants import validation_campaign
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
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import run_command
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import rounding_of
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED, growth
from stiction.comparisons.studies.drift import POSITION, VELOCITY, above_rounding
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, vary
from stiction.truths import slider_bar_truth
from stiction.truths.reduced.slider_bar import SliderBar

SHORT = 24.0
"""s; the length of the paper's runs, over which accuracy is compared."""
LENGTHS = (24.0, 240.0, 2400.0)
"""s; after which the law of growth is looked for."""
SAMPLES = 48_000
"""Samples of a long run, at most: 20 a second of 2400 s."""
ADDITIONS = 4
"""Terms that a step of the method adds to each coordinate: each is rounded by half an ulp at most."""
STEPS = (1e-3, 2e-3, 5e-3, 1e-2)
BEYOND = (1.25e-2, 1.5e-2, 1.6e-2)
"""s; on both sides of the step at which the paper's choice becomes unstable, 15.5 ms."""
TWICE = 2.0
"""Ratio to the error without stabilization, above which stabilization does harm."""
IN_SHORT, ERROR, OCTAVE = "position_drift_24s", "position_error", "position_drift_rms"
DRIFT_RATIO, ERROR_RATIO = "drift_ratio", "error_ratio"


@dataclass(frozen=True)
class Choice:
    """A choice against drift: a method of the engine, with alpha and beta (1/s) for Baumgarte's."""

    method: str
    alpha: float = 0.0
    beta: float = 0.0

    @property
    def label(self) -> str:
        return (
            f"Baumgarte ({self.alpha:g}, {self.beta:g})"
            if self.method == "baumgarte"
            else self.method
        )

    @property
    def roots(self) -> np.ndarray:
        return np.roots([1.0, 2 * self.alpha, self.beta**2])

    def amplification(self, step: float) -> float:
        """Largest factor by which a step multiplies a residual with these Baumgarte terms; nan without them."""
        return (
            math.nan
            if self.method != "baumgarte"
            else float(np.max(np.abs(runge_kutta_factor(step * self.roots))))
        )

    def largest_step(self) -> float:
        """The step at which residuals begin to grow with these Baumgarte terms, s; infinite without them."""
        if self.method != "baumgarte":
            return math.inf
        fastest = float(np.max(np.abs(self.roots)))
        return float(
            brentq(
                lambda step: self.amplification(step) - 1, 1.0 / fastest, 10.0 / fastest, xtol=1e-12
            )
        )


def runge_kutta_factor(z: np.ndarray) -> np.ndarray:
    """The factor of a step of the Runge-Kutta method of order 4, for z = h lambda; the exact one is exp(z)."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


NONE, PAPERS, PROJECTION = Choice("none"), Choice("baumgarte", 90.0, 10.0), Choice("projection")
CHOICES = (
    NONE,
    PAPERS,
    Choice("baumgarte", 50.0, 50.0),
    Choice("baumgarte", 10.0, 10.0),
    Choice("baumgarte", 5.0, 5.0),
    PROJECTION,
)
DESCRIBED = (NONE, PAPERS, PROJECTION)
"""The choices whose growth of drift the text of the study describes."""


@dataclass(frozen=True)
class LongRun:
    """A run of the paper's scheme, of `t_end` seconds."""

    scene: Scene
    choice: Choice
    step: float
    t_end: float

    @property
    def name(self) -> str:
        return f"{self.scene.name}/{self.choice.label}/dt={self.step:g}"


def long_runs(cases: Mapping[int, Scene], depth: Depth = Depth.FULL) -> list[LongRun]:
    """The runs on the paper's cases, by number, at a depth.

    In full, those that the paper's statement is about for 2400 s, the rest for 240 s; in case 2 bar and drive move as
    in case 1, and so does drift. At other depths, case 1 alone for 240 s: its coarser steps, by default also the
    paper's statement at all steps. By default there are also 24 s of case 3, whose position suffers most: its coarser
    steps, without stabilization and with the paper's.
    """
    runs = []
    for (case, scene), choice, step in product(cases.items(), CHOICES, (*STEPS, *BEYOND)):
        of_paper, is_coarse = choice in (NONE, PAPERS), step >= STEPS[2]
        stated = case == 1 and (of_paper or choice == PROJECTION) and step in STEPS
        suffers = case == 3 and of_paper and step in STEPS[2:]
        least = (
            Depth.QUICK
            if case == 1 and is_coarse
            else Depth.DEFAULT
            if stated or suffers
            else Depth.FULL
        )
        if case == 2 or step in BEYOND and not of_paper or not depth.reaches(least):
            continue
        if depth is Depth.FULL:
            t_end = LENGTHS[2] if stated else LENGTHS[1]
        else:
            t_end = LENGTHS[1] if case == 1 else SHORT
        runs.append(LongRun(scene, choice, step, t_end))
    return runs


def drift_study_comparison(
    cases: Mapping[int, Scene], depth: Depth = Depth.FULL
) -> Comparison[Tables]:
    """The tables of `drift_study` for the paper's cases, by number; the longest runs begin first."""
    runs = sorted(long_runs(cases, depth), key=lambda run: -run.t_end / run.step)
    return Comparison(
        tuple(Task(f"drift/{run.name}", drift_run, (run,)) for run in runs),
        lambda outcomes: drift_study(runs, outcomes),
    )


def plan(scope: Scope) -> Comparison[Tables] | None:
    """The long runs, of the paper's cases alone."""
    if scope.scenes != tuple(validation_campaign().scenes):
        return None
    return drift_study_comparison(dict(enumerate(scope.scenes, 1)), scope.depth)


def rounding_level(scene: Scene, choice: Choice, step: float, run: Trajectory) -> np.ndarray:
    """The position residual that rounding may make, m, at each instant of a run; see the module.

    Without a Baumgarte term it is that of the residual's evaluation alone.
    """
    evaluation = np.full(len(run.t), rounding_of(run))
    if choice.method != "baumgarte":
        return evaluation
    states = [
        np.abs(values)
        for name, values in run.columns.items()
        if name.endswith((".x", ".y", ".angle"))
    ]
    ulp = np.spacing(np.maximum.accumulate(np.max(states, axis=0)))
    lever = np.hypot(
        1.0, scene.parameters["L"] / 2
    )  # an angle is in the drive's residual, times L/2 in the pin's
    return evaluation + ADDITIONS * ulp / 2 / step * 2 * choice.alpha / choice.beta**2 * lever


DriftRun = tuple[dict[str, Any], tuple[tuple[float, float], ...]]
"""Columns measured on a run, and end (s) and root mean square (m) of each octave of its drift."""


def drift_run(long: LongRun) -> DriftRun:
    """Run the paper's scheme with a choice against drift, and measure drift and error."""
    scene, choice, step, t_end = long.scene, long.choice, long.step, long.t_end
    terms = {"stabilization.alpha": choice.alpha, "stabilization.beta": choice.beta}
    stabilized = vary(scene, terms) if choice.method == "baumgarte" else scene

    def simulate(end: float, output_step: float) -> Trajectory:
        return ReferenceEngine().simulate(
            stabilized,
            t_end=end,
            dt=step,
            output_step=output_step,
            stabilization=choice.method,
            event_values=False,
        )

    run = simulate(t_end, max(step, t_end / SAMPLES))
    rounding, drift = rounding_level(scene, choice, step, run), run["drift.position"]
    row: dict[str, Any] = {
        "reason": "" if run.termination == "end" else run.termination,
        IN_SHORT: float(np.max(drift[run.t <= SHORT])),
        POSITION: float(np.max(drift)),
        VELOCITY: float(np.max(run["drift.velocity"])),
    }
    octaves: tuple[tuple[float, float], ...] = ()
    for length in LENGTHS if run.termination == "end" else ():
        if length <= t_end:
            within = run.t <= length + step / 2
            law = growth(
                run.t[within],
                drift[within],
                SliderBar.from_scene(scene).period() / 2,
                rounding[within],
            )
            octaves = law.octaves
            row |= {
                f"growth_{length:g}s": law.verdict,
                f"growth_exponent_{length:g}s": law.exponent,
                f"growth_exponent_uncertainty_{length:g}s": law.uncertainty,
                f"walk_spread_{length:g}s": law.spread,
            }
    measured = errors(simulate(SHORT, 1e-2), slider_bar_truth(scene, SHORT), size_of(scene))
    return row | {name: measured.get(name) for name in (ERROR, "position_uncertainty")}, octaves


def drift_study(runs: Sequence[LongRun], outcomes: Sequence[Outcome]) -> Tables:
    """The tables of the study from the outcomes of its runs.

    ``study``: a row per run, with drift and error in units of the run without stabilization of the same scene and step.
    ``octaves``: a row per octave of each run that reached its end.
    """
    rows, octaves = [], []
    for run, outcome in zip(runs, outcomes, strict=True):
        made: DriftRun = outcome.value or ({"reason": outcome.reason or outcome.status}, ())
        row = {"scene": run.scene.name, "choice": run.choice.label, "step": run.step}
        choice, gains = run.choice, run.choice.method == "baumgarte"
        options = [
            ("t-end", f"{run.t_end:g}"),
            ("dt", f"{run.step:g}"),
            ("setting", f"stabilization={choice.method}"),
            *(
                ("set", f"stabilization.{name}={getattr(choice, name):g}")
                for name in ("alpha", "beta")
                if gains
            ),
        ]
        rows.append(
            {
                **row,
                "run": run.name,
                "alpha": choice.alpha or None,
                "beta": choice.beta or None,
                "time": run.t_end,
                **made[0],
                "status": outcome.status,
                AGAIN: run_command(run.scene.name, "reference", options) if outcome.value else None,
            }
        )
        octaves += [{**row, "octave_end": end, OCTAVE: size} for end, size in made[1]]
    table = pd.DataFrame(rows)
    if IN_SHORT in table:
        without = table[table["choice"] == NONE.label].set_index(["scene", "step"])
        without = without.reindex(pd.MultiIndex.from_frame(table[["scene", "step"]])).set_index(
            table.index
        )
        for ratio, column in ((DRIFT_RATIO, IN_SHORT), (ERROR_RATIO, ERROR)):
            table[ratio] = (table[column] / without[column]).where(table["choice"] != NONE.label)
    order = {choice.label: number for number, choice in enumerate(CHOICES)}
    table = table.sort_values(
        ["scene", "choice", "step"],
        ignore_index=True,
        key=lambda column: column.map(order) if column.name == "choice" else column,
    )
    return Tables({"study": table, "octaves": pd.DataFrame(octaves)})


class Law(NamedTuple):
    """A law of growth: verdict, exponent and its interval, spread in units of a random walk's, and time (s)."""

    verdict: str
    exponent: float
    interval: float
    spread: float
    length: float


def decisive_runs(
    table: pd.DataFrame, scene: str, choice: Choice
) -> list[tuple[dict[Hashable, Any], Law]]:
    """Return the runs on a scene that decide what the paper says of drift, with the laws of their longest parts."""
    if table.empty:
        return []
    decisive = (table["scene"] == scene) & (table["reason"] == "") & table["step"].isin(STEPS)
    decided = []
    for run in table[decisive & (table["choice"] == choice.label)].to_dict("records"):
        length = max(
            length for length in LENGTHS if isinstance(run.get(f"growth_{length:g}s"), str)
        )
        exponent, interval, spread = (
            run[f"{name}_{length:g}s"]
            for name in ("growth_exponent", "growth_exponent_uncertainty", "walk_spread")
        )
        law = Law(run[f"growth_{length:g}s"], exponent, interval, spread, length)
        decided.append((run, law))
    return decided


def present(results: Results) -> Presentation:
    """The growth of drift with each stabilization, its size, and the harm that the paper's terms do."""
    study, octaves = results.table("study"), results.table("octaves")
    if IN_SHORT not in study:
        return Presentation()
    scenes = octaves.loc[octaves["octave_end"] > SHORT, "scene"].unique() if len(octaves) else ()
    drawn = {
        scene: f"drift-{scene}" if number else "fig14-drift" for number, scene in enumerate(scenes)
    }
    figures = [
        _figure(study[study["scene"] == scene], octaves[octaves["scene"] == scene], name)
        for scene, name in drawn.items()
    ]
    return Presentation(
        rows={
            "scene": study["scene"].iloc[0],
            "compared": _at_finest_and_coarsest_step(study),
            "laws": [law for choice in DESCRIBED if (law := _growth_of(study, choice))],
            "harmed": _most_harmed(study),
            "papers": _stability_of_papers_terms(),
            "drawn": [{"figure": name, "scene": scene} for scene, name in drawn.items()],
        },
        tables=[_by_choice(study), _all_runs(study)],
        figures=figures,
    )


def _growth_of(study: pd.DataFrame, choice: Choice) -> dict[str, object]:
    """The numbers of runs by the growth of their drift over the longest time that has a law; empty if none has."""
    runs = study[study["choice"] == choice.label]
    known = runs.dropna(axis="columns", how="all")
    lengths = [length for length in LENGTHS[1:] if f"growth_{length:g}s" in known]
    if not lengths:
        return {}
    length = max(lengths)
    runs = runs[runs["time"] >= length]
    laws = runs[f"growth_{length:g}s"]
    powers = runs.loc[laws == GROWS, f"growth_exponent_{length:g}s"].dropna()
    return {
        "method": choice.method,
        "length": length,
        "scenes": list(runs["scene"].unique()),
        "runs": len(runs),
        "grows": int((laws == GROWS).sum()),
        "bounded": int((laws == BOUNDED).sum()),
        "rounded": int((laws == ROUNDED).sum()),
        "inconclusive": int((laws == INCONCLUSIVE).sum()),
        "unknown": int(laws.isna().sum()),  # the run failed or stopped early
        "steps": _smallest_and_largest(study, runs["step"]),
        "powers": _smallest_and_largest(study, powers),
    }


def _smallest_and_largest(study: pd.DataFrame, values: pd.Series) -> list[object]:
    """The cells of a column's least and largest value: one where they are equal, none where there is no value."""
    if values.empty:
        return []
    ends = dict.fromkeys((values.idxmin(), values.idxmax()))
    return [row_of("study", study, label)[values.name] for label in ends]


def _papers_runs(study: pd.DataFrame) -> pd.DataFrame:
    """The runs with the paper's terms which have a run without stabilization to compare with."""
    chosen = (study["choice"] == PAPERS.label) & study["step"].isin(STEPS)
    return study[chosen & study[DRIFT_RATIO].notna()]


def _beside_none(study: pd.DataFrame, label: int) -> dict[str, Row]:
    """A run with the paper's terms, and that without stabilization of the same scene and step."""
    scene, step = study.loc[label, ["scene", "step"]]
    same = (study["scene"] == scene) & (study["step"] == step) & (study["choice"] == NONE.label)
    return {
        "papers": row_of("study", study, label),
        "none": row_of("study", study, study.index[same][0]),
    }


def _at_finest_and_coarsest_step(study: pd.DataFrame) -> list[dict[str, Row]]:
    """Runs with and without the paper's terms on the first scene; drift by rounding is 0."""
    papers = _papers_runs(study)
    steps = papers.loc[papers["scene"] == study["scene"].iloc[0], "step"]
    if steps.empty:
        return []
    shown = above_rounding(study, [IN_SHORT])
    return [_beside_none(shown, label) for label in dict.fromkeys((steps.idxmin(), steps.idxmax()))]


def _most_harmed(study: pd.DataFrame) -> list[dict[str, Row]]:
    """The runs on each scene whose error grows most by the paper's terms; none if it grows by `TWICE` in none."""
    ratios = _papers_runs(study).dropna(subset=[ERROR_RATIO])
    if not (ratios[ERROR_RATIO] > TWICE).any():
        return []
    worst = ratios.loc[ratios.groupby("scene")[ERROR_RATIO].idxmax()]
    ordered = worst.sort_values(ERROR_RATIO, ascending=False)
    return [_beside_none(study, label) for label in ordered.index]


def _stability_of_papers_terms() -> dict[str, float]:
    """Roots (1/s) of the error equation of the paper's terms, and what one step makes of a residual.

    ``exact`` and ``computed``: the factor of the fast root in a step of ``step`` ms, exactly and by the Runge-Kutta
    method. ``unstable``: the step, ms, beyond which residuals grow.
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
    """Drift on the first scene: a row a choice, a column a step, and the numbers of runs by their growth."""
    runs = study[study["scene"] == study["scene"].iloc[0]]
    sizes = above_rounding(runs, [IN_SHORT]).pivot(index="choice", columns="step", values=IN_SHORT)
    names = {step: f"{IN_SHORT} at {step:g}" for step in STEPS}
    frame = (
        sizes.reindex(runs["choice"].unique(), columns=STEPS).rename(columns=names).reset_index()
    )
    behind = [runs.index[runs["choice"] == choice] + 1 for choice in frame["choice"]]
    law = "growth_240s"
    if law in runs:
        counts = [runs.loc[rows - 1, law].value_counts() for rows in behind]
        frame["laws"] = [
            ", ".join(f"{verdict} {number}" for verdict, number in each.items()) for each in counts
        ]
    drifts = [
        Column(name, f"drift at {1e3 * step:g} ms", "m", of=IN_SHORT)
        for step, name in names.items()
    ]
    columns = (
        Column("choice", "stabilization"),
        *drifts,
        Column("laws", "growth in 240 s (number of runs)"),
    )
    return view("study", frame, columns, source="study", rows=behind)


def _all_runs(study: pd.DataFrame) -> TableView:
    """Every run, with its laws over each length."""
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
    """The paper's Fig. 14 over a longer time, and drift over the step, in one scene."""
    steps = [step for step in STEPS if step in set(octaves["step"])]
    over_time = [
        Series(
            "",
            rows["octave_end"].to_numpy(),
            rows[OCTAVE].to_numpy(),
            look=choice.label,
            points=True,
            hollow=step != steps[-1],
        )
        for choice, step in product(
            (NONE, PAPERS, PROJECTION), dict.fromkeys((steps[0], steps[-1]))
        )
        if len(rows := octaves[(octaves["choice"] == choice.label) & (octaves["step"] == step)])
    ]
    ended = study[(study["status"] == Status.OK) & (study["reason"] == "")].sort_values("step")
    over_step = [
        Series(
            choice.label,
            rows["step"].to_numpy(),
            rows[IN_SHORT].to_numpy(),
            look=choice.label,
            points=True,
        )
        for choice in CHOICES
        if len(rows := ended[ended["choice"] == choice.label])
    ]
    title = (
        f"open markers: {1e3 * steps[0]:g} ms, filled: {1e3 * steps[-1]:g} ms"
        if len(steps) > 1
        else ""
    )
    unstable = PAPERS.largest_step()
    panels = (
        Panel(
            title,
            Axis("time [s]", log=True, ticks=sorted(set(octaves["octave_end"]))),
            Axis("drift, rms over an octave [m, rad]", log=True),
            over_time,
        ),
        Panel(
            "largest in 24 s",
            Axis("step [s]", log=True, ticks=sorted(set(study["step"]))),
            Axis("drift, largest in 24 s [m, rad]", log=True),
            over_step,
            lines=(unstable,),
        ),
    )
    return Chart(name, panels, columns=2, height=2.5)


STUDY = Study(
    "long-drift",
    "Long runs",
    "How much does stabilization reduce the drift in long runs?",
    present,
    plan,
    seconds=0.8,
    on_page_one=False,
    compared=False,
    tables={
        "study": "Drift over long runs",
        "octaves": "Drift by octave of time",
    },
)
