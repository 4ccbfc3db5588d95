"""Random slider-bars: event-driven runs of the reference against the truth, scene by scene."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from fuzz.scene_outcomes import SceneOutcome, event_differences
from stiction.engines.registry import load_engine
from stiction.scenes import Scene, Trajectory, load_scene, vary
from stiction.truths import NoMotion, Truth, TruthRefused, Undecided, slider_bar_truth

T_END = 24.0
"""Seconds."""
TIGHT_RTOL = 1e-12
TIGHT_BOUND = 1e-8
"""Bound at `TIGHT_RTOL`, m and s: ten thousand roundings of some metres, one for each step or event on the way."""
LOOSE = 2e4
"""Bound otherwise, in units of rtol: rtol bounds the error of a step; a run has some hundred, magnified by kinks."""
REFUSAL_WINDOW = 1e-6
"""Seconds between two breakdowns that are one."""

AGREES = "agrees"
"""Events of the same kinds in the same order; their times, and x at the end, within the bound."""
GRAZES = "grazes"
"""Not at this tolerance, but at 1e-12 and there within 1e-8: the motion magnifies small differences."""
SAME_BREAKDOWN = "same breakdown"
"""Run and truth both stop, for the same kind of reason and at the same time."""
UNDECIDED = "undecided"
"""The truth cannot decide."""
REFERENCE_REFUSES = "reference refuses"
"""The run stops where the truth goes on."""
TRUTH_REFUSES = "truth refuses"
"""The truth stops where the run goes on."""
SILENTLY_WRONG = "silently wrong"
"""The run comes to its end, and neither it nor the one at 1e-12 is the truth."""
RIGHT = (AGREES, GRAZES, SAME_BREAKDOWN)
"""Outcomes that a scene may have."""


def drawn(seed: int, i: int) -> dict[str, float]:
    """Parameters by name of scene i of a seed, log-uniform; in half of the scenes load and bar have a common period."""
    rng = np.random.default_rng([seed, i])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    mu, w0 = float(rng.uniform(0.0, 0.4)), between(0.2, 6.0)
    frequency = (
        between(0.3, 6.0)
        if rng.random() < 0.5
        else float(w0 * rng.integers(1, 4) / rng.integers(1, 3))
    )
    return {
        "F0": between(0.2, 12.0),
        "L": between(0.5, 5.0),
        "w0": w0,
        "m1": between(0.2, 5.0),
        "m2": between(0.2, 5.0),
        "guide.length": between(0.1, 2.0),
        "guide.width": between(0.05, 1.5),
        "k": between(0.2, 20.0),
        "Omega": frequency,
        "mu": mu,
        "mus": float(mu * rng.uniform(1.0, 2.0)),
    }


def slider_bar(parameters: dict[str, float]) -> Scene:
    """The paper's example with other parameters."""
    return vary(load_scene("slider-bar-case-1"), parameters)


def judge(parameters: dict[str, float], rtols: Sequence[float]) -> list[SceneOutcome]:
    """Run the reference at each tolerance and compare it with the truth."""
    scene, about = slider_bar(parameters), json.dumps(parameters)
    try:
        truth = slider_bar_truth(scene, T_END)
    except (NoMotion, Undecided) as refusal:
        return [
            SceneOutcome(*_refused(refusal, _simulate(scene, rtol, T_END)), about) for rtol in rtols
        ]
    return [SceneOutcome(*_compared(scene, truth, rtol), about) for rtol in rtols]


def _compared(scene: Scene, truth: Truth, rtol: float) -> tuple[str, str]:
    run = _simulate(scene, rtol, truth.t_end)
    if run.breakdown is not None:
        return REFERENCE_REFUSES, _stop(run)
    error, detail = difference(run, truth)
    if error <= max(LOOSE * rtol, TIGHT_BOUND):
        return AGREES, ""
    tight = _simulate(scene, TIGHT_RTOL, truth.t_end)
    error, again = (
        (np.inf, _stop(tight)) if tight.breakdown is not None else difference(tight, truth)
    )
    return (
        GRAZES if error <= TIGHT_BOUND else SILENTLY_WRONG,
        f"{detail}; at {TIGHT_RTOL:g}: {again}",
    )


def difference(run: Trajectory, truth: Truth) -> tuple[float, str]:
    """Largest error of an event time or of x at the end, and what differs; infinite where the events are others.

    Corners that change surface are left out: the motion has a kink there in x'', which its errors show.
    """
    true, found = (
        [event for event in events if event.kind != "corner"]
        for events in (truth.events, run.events)
    )
    errors = {}
    for i, (one, other, error) in enumerate(event_differences(true, found), 1):
        if error == np.inf:
            return error, f"event {i} of {len(true)}: truth {one}, run {other}"
        errors[one] = error
    errors["x at the end"] = abs(float(truth(truth.t_end)["slider.x"][0] - run["slider.x"][-1]))
    worst = max(errors, key=lambda name: errors[name])
    return errors[worst], f"{worst}: error {errors[worst]:.1e}"


def _simulate(scene: Scene, rtol: float, t_end: float) -> Trajectory:
    engine = load_engine("reference")
    return engine.simulate(
        scene, t_end=t_end, rtol=rtol, output_step=t_end, stabilization="projection"
    )


def _stop(run: Trajectory) -> str:
    return f"{run.breakdown.kind} at {run.breakdown.time:.9f} s" if run.breakdown else "end"


def _refused(refusal: TruthRefused, run: Trajectory) -> tuple[str, str]:
    if not isinstance(refusal, NoMotion):
        return UNDECIDED, str(refusal)
    if run.breakdown is None:
        return TRUTH_REFUSES, str(refusal)
    late, outcome = run.breakdown.time - refusal.time, REFERENCE_REFUSES
    if abs(late) <= REFUSAL_WINDOW and run.breakdown.kind in ("several solutions", "no solution"):
        outcome = SAME_BREAKDOWN
    elif late > 0:
        outcome = TRUTH_REFUSES
    return outcome, f"truth: {refusal}; run: {_stop(run)}"
