"""Random slider-bars: the reference's event-driven runs against the independent solution, scene by scene.

Every scene falls into one class:

==================  ===================================================================================================
agrees              events of the same kinds in the same order; their times, and x at the end, within the bound
grazes              not at this tolerance, but at 1e-12 and there within 1e-8: the motion magnifies small differences
same breakdown      run and truth both stop, for the same kind of reason and at the same time
undecided           the truth cannot decide
reference refuses   the run stops where the truth goes on
truth refuses       the truth stops where the run goes on
silently wrong      the run comes to its end, and neither it nor the one at 1e-12 is the truth
==================  ===================================================================================================

    python -m comparisons.random_slider_bars --count 20000 --seed 1 --rtol 1e-9
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import secrets
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pandas as pd

from comparisons.regression import COULD_NOT_RUN, REGRESSION, Finding
from comparisons.truth import NoMotion, Truth, TruthRefused, Undecided, slider_bar_truth
from engines.isolation import Task, isolate
from engines.reference import compile_kernels
from engines.registry import load_engine
from scenes import Scene, Trajectory, load_scene, vary

T_END = 24.0
"""Seconds."""
NIGHT_RTOLS = (1e-9, 1e-12)
TIGHT_RTOL = 1e-12
TIGHT_BOUND = 1e-8
"""Bound at `TIGHT_RTOL`, in m and s: ten thousand roundings of some metres, one for each step or event on the way."""
LOOSE = 2e4
"""Bound in units of rtol otherwise: rtol bounds the error of a step; a run has some hundred, each magnified by friction's kinks."""
REFUSAL_WINDOW = 1e-6
"""Seconds between two breakdowns that are one."""

AGREES, GRAZES, SAME_BREAKDOWN = "agrees", "grazes", "same breakdown"
REFERENCE_REFUSES, TRUTH_REFUSES, SILENTLY_WRONG = "reference refuses", "truth refuses", "silently wrong"
UNDECIDED = "undecided"
FAILING = (SILENTLY_WRONG, REFERENCE_REFUSES, TRUTH_REFUSES)
"""What no scene is known to do."""
CLASSES = (AGREES, GRAZES, SAME_BREAKDOWN, UNDECIDED, REFERENCE_REFUSES, TRUTH_REFUSES, SILENTLY_WRONG)


@dataclass(frozen=True)
class Verdict:
    """What became of a scene.

    Attributes
    ----------
    outcome : str
        One of `CLASSES`.
    error : float
        Largest error of an event time (s) or of x at the end (m) at the tolerance asked for; nan without a comparison.
    detail : str
        What differs, or who stops when and why.
    """

    outcome: str
    error: float
    detail: str
    parameters: dict[str, float]


def draw(rng: np.random.Generator) -> dict[str, float]:
    """Parameters of a slider-bar by name, log-uniform; in one half of the draws load and bar have a common period."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    mu, w0 = float(rng.uniform(0.0, 0.4)), between(0.2, 6.0)
    frequency = between(0.3, 6.0) if rng.random() < 0.5 else float(w0 * rng.integers(1, 4) / rng.integers(1, 3))
    return {"F0": between(0.2, 12.0), "L": between(0.5, 5.0), "w0": w0, "m1": between(0.2, 5.0), "m2": between(0.2, 5.0),
            "guide.length": between(0.1, 2.0), "guide.width": between(0.05, 1.5), "k": between(0.2, 20.0), "Omega": frequency,
            "mu": mu, "mus": float(mu * rng.uniform(1.0, 2.0))}


def draws(count: int, seed: int) -> Iterator[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return (draw(rng) for _ in range(count))


def slider_bar(parameters: dict[str, float]) -> Scene:
    """The paper's example with other parameters."""
    return vary(load_scene("slider-bar-case-1"), parameters)


def judge(parameters: dict[str, float], rtols: Sequence[float]) -> tuple[Verdict, ...]:
    """Run the reference at each tolerance and compare it with the truth."""
    scene = slider_bar(parameters)
    try:
        truth = slider_bar_truth(scene, T_END)
    except (NoMotion, Undecided) as refusal:
        return tuple(Verdict(*_refused(refusal, _simulate(scene, rtol)), parameters) for rtol in rtols)
    return tuple(_compare(scene, truth, rtol, parameters) for rtol in rtols)


def _compare(scene: Scene, truth: Truth, rtol: float, parameters: dict[str, float]) -> Verdict:
    run = _simulate(scene, rtol)
    if run.breakdown is not None:
        return Verdict(REFERENCE_REFUSES, np.nan, _stop(run), parameters)
    error, detail = difference(run, truth)
    if error <= max(LOOSE * rtol, TIGHT_BOUND):
        return Verdict(AGREES, error, "", parameters)
    tight = _simulate(scene, TIGHT_RTOL)
    if tight.breakdown is not None:
        return Verdict(SILENTLY_WRONG, error, f"{detail}; at {TIGHT_RTOL:g}: {_stop(tight)}", parameters)
    tight_error, tight_detail = difference(tight, truth)
    outcome = GRAZES if tight_error <= TIGHT_BOUND else SILENTLY_WRONG
    return Verdict(outcome, error, f"{detail}; at {TIGHT_RTOL:g}: {tight_detail or f'error {tight_error:.1e}'}", parameters)


def difference(run: Trajectory, truth: Truth) -> tuple[float, str]:
    """Largest error of an event time or of x at the end, and what differs; inf where the events are others.

    Corners that change surface are left out: the motion has a kink there in x'', which its errors show.
    """
    true, found = ([event for event in events if event.kind != "corner"] for events in (truth.events, run.events))
    for i in range(max(len(true), len(found))):
        one, other = (f"{e[i].kind} at {e[i].time:.9f} s" if i < len(e) else "none" for e in (true, found))
        if one.split()[0] != other.split()[0]:
            return np.inf, f"event {i + 1} of {len(true)}: truth {one}, run {other}"
    errors = {f"{a.kind} at {a.time:.9f} s": abs(a.time - b.time) for a, b in zip(true, found)}
    errors["x at the end"] = abs(float(truth(T_END)["slider.x"][0] - run["slider.x"][-1]))
    worst = max(errors, key=lambda name: errors[name])
    return errors[worst], f"{worst}: error {errors[worst]:.1e}"


def _simulate(scene: Scene, rtol: float) -> Trajectory:
    return load_engine("reference").simulate(scene, t_end=T_END, rtol=rtol, output_step=T_END, stabilization="projection")


def _stop(run: Trajectory) -> str:
    return f"{run.breakdown.kind} at {run.breakdown.time:.9f} s"


def _refused(refusal: TruthRefused, run: Trajectory) -> tuple[str, float, str]:
    if not isinstance(refusal, NoMotion):
        return UNDECIDED, np.nan, str(refusal)
    if run.breakdown is None:
        return TRUTH_REFUSES, np.nan, str(refusal)
    detail = f"truth: {refusal}; run: {_stop(run)}"
    apart = abs(refusal.time - run.breakdown.time)
    if apart <= REFUSAL_WINDOW and run.breakdown.kind in ("several solutions", "no solution"):
        return SAME_BREAKDOWN, apart, detail
    return (TRUTH_REFUSES if run.breakdown.time > refusal.time else REFERENCE_REFUSES), apart, detail


def verdicts(count: int, seed: int, rtols: Sequence[float], processes: int = 1) -> Iterator[tuple[Verdict, ...]]:
    """Judge random scenes, in their order: for each a verdict per tolerance."""
    compile_kernels()  # here, lest every process does it
    tasks = ((parameters, rtols) for parameters in draws(count, seed))
    if processes == 1:
        yield from (judge(*task) for task in tasks)
    else:
        with multiprocessing.get_context("spawn").Pool(processes) as pool:
            yield from pool.imap(_judge, tasks, chunksize=16)


def _judge(task: tuple[dict[str, float], Sequence[float]]) -> tuple[Verdict, ...]:
    return judge(*task)


def table(found: Iterable[Verdict]) -> pd.DataFrame:
    """Per class the number of scenes, their share, and the largest error."""
    found = list(found)
    rows = []
    for outcome in CLASSES:
        errors = [verdict.error for verdict in found if verdict.outcome == outcome]
        known = [error for error in errors if np.isfinite(error)]
        rows.append({"class": outcome, "scenes": len(errors), "share": len(errors) / max(len(found), 1),
                     "largest error [m, s]": max(known, default=np.nan)})
    return pd.DataFrame(rows)


def draw_of_night(count: int, workers: int, timeout_s: float) -> tuple[str, list[Finding]]:
    """Judge so many slider-bars of a fresh seed in child processes: a sentence that names the seed, and what a night must report.

    timeout_s : seconds for each slider-bar.

    A run that is silently wrong, stops where the truth goes on, or goes on where it stops, is a regression: no such scene is known.
    """
    if not count:
        return "", []
    seed, size = fresh_seed(), 20
    scenes = list(draws(count, seed))
    tasks = [Task(f"random slider-bars {seed}/{i}", _judge_all, (scenes[i:i + size], NIGHT_RTOLS)) for i in range(0, count, size)]
    judged, found = [], []
    for outcome in isolate(tasks, workers=workers, timeout_s=size * timeout_s):
        if outcome.status == "ok":
            judged += outcome.value
        else:
            found.append(Finding(COULD_NOT_RUN, "random", outcome.label, "", None, outcome.status, np.inf, outcome.reason))
    for verdict in judged:
        if verdict.outcome in FAILING:
            found.append(Finding(REGRESSION, "random", f"random slider-bars {seed}", "", None, verdict.outcome, np.inf,
                                 f"{verdict.detail}; {json.dumps(verdict.parameters)}"))
    numbers = ", ".join(f"{row['scenes']} {row['class']}" for row in table(judged).to_dict("records") if row["scenes"])
    tolerances = " and ".join(f"{rtol:g}" for rtol in NIGHT_RTOLS)
    return f"Seed {seed}, {count} slider-bars of {T_END:g} s at rtol {tolerances}, against the independent solution: {numbers}.", found


def _judge_all(scenes: Sequence[dict[str, float]], rtols: Sequence[float]) -> list[Verdict]:
    return [verdict for parameters in scenes for verdict in judge(parameters, rtols)]


def fresh_seed() -> int:
    """A seed that was not used before, for a draw that prints it."""
    return secrets.randbits(32)


def main() -> int:
    """Print the table and the first scenes of each class that should be empty; 1 if one of `FAILING` is not."""
    parser = argparse.ArgumentParser(prog="python -m comparisons.random_slider_bars", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=None, help="a fresh one if not given")
    parser.add_argument("--rtol", type=float, nargs="+", default=[1e-9], help="one or more")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--show", type=int, default=20, help="scenes printed of each class but the first three")
    given = parser.parse_args()
    seed = fresh_seed() if given.seed is None else given.seed
    found = list(verdicts(given.count, seed, given.rtol, given.processes))
    wrong = False
    for rtol, judged in zip(given.rtol, zip(*found)):
        print(f"seed {seed}, {given.count} slider-bars of {T_END:g} s, rtol {rtol:g}")
        for outcome in (UNDECIDED, *FAILING):
            for verdict in islice((v for v in judged if v.outcome == outcome), given.show):
                print(f"{outcome}: {verdict.detail}; {json.dumps(verdict.parameters)}")
        print(table(judged).to_string(index=False))
        wrong = wrong or any(verdict.outcome in FAILING for verdict in judged)
    return int(wrong)


if __name__ == "__main__":
    raise SystemExit(main())
