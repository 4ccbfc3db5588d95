"""One hard case through one variant, in a child process, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.comparisons.bench.complementarity.problems import Problem, problems_met
from stiction.comparisons.bench.variants import Variant, has_static_coefficient
from stiction.comparisons.hard import checks
from stiction.comparisons.hard.case import (
    CONDITIONS,
    MOTION_OR_WORD,
    NO_MOTION,
    NONE,
    REFUSAL,
    SEVERAL,
    HardCase,
    Limits,
    hard_cases,
)
from stiction.engines.isolation import Outcome
from stiction.engines.protocol import UNSETTLED, BadTrajectory, Declined, EngineFailure, Refused
from stiction.engines.registry import load_engine, own_methods
from stiction.engines.status import Status
from stiction.scenes import Scene, SceneError, Trajectory

RIGHT, DEGRADED, WRONG, FAILED = "right", "degraded", "wrong", "failed"
DECLINED, DECLINED_BY_ADAPTER, IMPULSIVE, UNREAD = (
    "declined",
    "declined by adapter",
    "impulsive",
    "refused by reader",
)
INEXPRESSIBLE, NOT_RUN, NOT_INSTALLED = "not expressible", "not run", "not installed"
VERDICTS = (
    RIGHT,
    DEGRADED,
    DECLINED,
    DECLINED_BY_ADAPTER,
    IMPULSIVE,
    UNREAD,
    INEXPRESSIBLE,
    NOT_RUN,
    NOT_INSTALLED,
    WRONG,
    FAILED,
)
"""Declined: the method states that it cannot have this motion. Declined by adapter: our code states it, and the engine
was not asked. Impulsive: goes on by impulses where no motion with finite forces exists, and is not judged. Refused by
reader: the file, for all methods alike. Not expressible: the adapter cannot build the scene. Failed: a crash, a hang,
an unforeseen exception."""
READER, ADAPTER, METHOD = "reader", "adapter", "method"
"""Origins of a refusal of the input."""
WITHOUT_RESULT = {
    Status.REFUSED: INEXPRESSIBLE,
    Status.MISSING: NOT_INSTALLED,
    Status.NOT_RUN: NOT_RUN,
    Status.FAILED: FAILED,
}
"""Verdict by the status of a child that returned nothing."""
STOP = {"rtol": 1e-8, "dt": 2e-2}
"""Error of the time at which existence ends, relative to the time scale 1000 dt of the case: an adaptive method locates
it, a fixed step may be late by some steps."""
COMPLEMENTARITY, COULOMB = "complementarity", "Coulomb's law"
"""Measures that are held to `CONDITIONS`."""
BEYOND = "Coulomb's law beyond the end of uniqueness"
"""Measure of a run that goes on where there are several motions: zero for one of them."""
SAMPLES = 400
"""Output instants of a run."""
AUDITED = 60
"""Instants at which the complementarity conditions of the reference are solved again."""


@dataclass(frozen=True)
class Verdict:
    """`word` of `VERDICTS`; its reason; its size (relative error, or seconds too late) and the limit for right."""

    word: str
    about: str
    size: float = math.nan
    limit: float = math.nan


@dataclass(frozen=True)
class Examination:
    """Result of one case through one variant: relative errors by name, or the reason why there are none.

    A run `stopped` early for a reason, at `stop_time` (s) with a `stop_kind` of `stiction.scenes.Breakdown`. The input
    was `refused` for a reason `by` the `READER`, the `ADAPTER` or the `METHOD`. Where there was nothing to measure
    there is a `verdict`. `cpu_s` and `engine_s` are of stepping all runs, and of that inside the engine's own calls;
    `problems` are those that the event-driven reference met.
    """

    measures: Mapping[str, float] = field(default_factory=dict)
    stopped: str = ""
    stop_kind: str = ""
    stop_time: float = math.nan
    refused: str = ""
    by: str = ""
    verdict: Verdict | None = None
    version: str = ""
    cpu_s: float = 0.0
    engine_s: float = 0.0
    problems: tuple[Problem, ...] = ()


def examine(name: str, variant: Variant) -> Examination:
    """Run a case; called in a child. Raises what an engine refuses, and `EngineMissing`."""
    case = next(case for case in hard_cases() if case.name == name)
    engine = load_engine(variant.engine)
    by = READER
    try:
        scenes = case.scenes(has_static_coefficient(variant))
        by = METHOD if variant.engine in own_methods() else ADAPTER
        steps = scenes[0].t_end / case.dt
        if variant.parameter == "dt" and steps > case.most_steps * 1.001:
            return Examination(
                verdict=Verdict(
                    NOT_RUN,
                    f"{steps:.3g} steps of {case.dt:g} s are more than this table "
                    f"spends on a case ({case.most_steps})",
                )
            )
        runs: list[Trajectory] = []
        for scene in scenes:
            runs.append(_run(case, scene, case.dt * scene.t_end / scenes[0].t_end, variant))
            if runs[-1].termination != "end":
                break
    except SceneError as error:
        reason = "; ".join(line.strip() for line in str(error).splitlines()[1:]) or str(error)
        return Examination(refused=reason, by=by, version=engine.version)
    except Declined as error:
        return Examination(refused=str(error), by=ADAPTER, version=engine.version)
    except BadTrajectory as error:  # it is no motion of the mechanism
        return Examination(verdict=Verdict(WRONG, str(error)), version=engine.version)
    except EngineFailure as error:
        return Examination(stopped=str(error), version=engine.version)
    reference, stop = variant.engine == "reference", dict[str, Any]()
    if runs[-1].termination == "end":
        scene, run = scenes[0], runs[0]
        measures = checks.measures(case, scenes, runs) | _beyond(case, scene, run)
        if reference and scene.frictional_guides:
            measures |= _conditions(scene, run)
    else:
        scene, run = scenes[len(runs) - 1], runs[-1]
        measures = _beyond(case, scene, run)
        kind, time = (
            (run.breakdown.kind, run.breakdown.time) if run.breakdown else ("", float(run.t[-1]))
        )
        stop = {"stopped": run.termination, "stop_kind": kind, "stop_time": time}
    problems = (
        problems_met(case.topic, scene, run) if reference and variant.parameter == "rtol" else []
    )
    return Examination(
        measures,
        version=run.version,
        cpu_s=sum(run.cost.stepping_s for run in runs),
        engine_s=sum(run.cost.own_s for run in runs),
        problems=tuple(problems),
        **stop,
    )


def _run(case: HardCase, scene: Scene, dt: float, variant: Variant) -> Trajectory:
    """Run a scene with its step or tolerance; `dt` is in the units of a scaled scene."""
    if not has_static_coefficient(variant) and any(
        guide.static_coefficient > guide.kinetic_coefficient
        for guide in scene.frictional_guides.values()
    ):
        raise Refused("has no static coefficient; the case is about mus > mu")
    step = {"dt": dt} if variant.parameter == "dt" else {"rtol": variant.ladder[-1]}
    settings = {**variant.settings, **(case.reference if variant.engine == "reference" else {})}
    # a multiple of the step, so that every method has its samples at the same instants
    output = max(round(scene.t_end / SAMPLES / dt), 1) * dt
    engine = load_engine(variant.engine)
    return engine.simulate(scene, fidelity=variant.fidelity, output_step=output, **step, **settings)


def _beyond(case: HardCase, scene: Scene, run: Trajectory) -> dict[str, float]:
    """`BEYOND`, where a run has instants there and states which guides stick in them."""
    needed = {
        f"{name}.{column}" for name in scene.frictional_guides for column in ("mode", "friction")
    }
    if case.expected != NO_MOTION or not needed <= run.columns.keys():
        return {}
    later = run.t > case.stops_at(scene)
    if case.stop["kind"] != SEVERAL or not later.any():
        return {}
    columns = {name: np.asarray(column)[later] for name, column in run.columns.items()}
    return {BEYOND: checks.friction_excess(scene, columns)}


def _conditions(scene: Scene, run: Trajectory) -> dict[str, float]:
    """Complementarity of accepted states, re-solved, and Coulomb's law on their forces."""
    from stiction.reference_impl.integration.coulomb_audit import audit
    from stiction.reference_impl.multibody.mechanism import Mechanism

    method = run.settings["stabilization"]["method"]
    found = audit(run, Mechanism(scene, method), AUDITED)
    return {
        COMPLEMENTARITY: found.complementarity,
        COULOMB: checks.friction_excess(scene, run.columns),
        "acceleration against the HLCP": found.acceleration,
        "instants that the HLCP does not accept": float(found.unsolved),
    }


def judge(case: HardCase, variant: Variant, outcome: Outcome) -> Verdict:
    """Judge the outcome of the child."""
    if outcome.status in WITHOUT_RESULT:
        return Verdict(WITHOUT_RESULT[outcome.status], outcome.reason)
    if outcome.status != Status.OK:
        return Verdict(FAILED, f"{outcome.status}: {outcome.reason}")
    found: Examination = outcome.value
    if found.verdict is not None:
        return found.verdict
    if found.by == ADAPTER:
        return Verdict(DECLINED_BY_ADAPTER, found.refused)
    if found.refused:
        expected = case.expected in (REFUSAL, MOTION_OR_WORD) and case.words in found.refused
        word = UNREAD if found.by == READER else RIGHT if case.expected == REFUSAL else DECLINED
        return Verdict(word if expected else FAILED, found.refused)
    if case.expected == NO_MOTION:
        return _judge_stop(case, variant, found)
    if found.stopped:
        # that there is none, or more than one, is a statement, and here it is false; any other reason is its own limit
        claim = found.stop_kind in (NONE, SEVERAL)
        return Verdict(
            RIGHT if case.expected == REFUSAL else WRONG if claim else DECLINED, found.stopped
        )
    if case.expected == REFUSAL:
        name, size = max(
            found.measures.items(), key=lambda item: item[1], default=("accepted", 1.0)
        )
        return Verdict(WRONG, name, size, 0.0)
    return _judge_motion(found.measures, case.limits(variant.parameter))


def _judge_motion(measures: Mapping[str, float], limits: Limits) -> Verdict:
    """Judge a motion by the measure that is worst for its limit."""

    def limits_of(name: str) -> Limits:
        return CONDITIONS if name in (COMPLEMENTARITY, COULOMB) else limits

    def excess(name: str) -> float:
        return measures[name] / limits_of(name).right if math.isfinite(measures[name]) else math.inf

    worst = max(measures, key=excess)
    size, limit = measures[worst], limits_of(worst)
    word = RIGHT if size <= limit.right else DEGRADED if size <= limit.degraded else WRONG
    return Verdict(word, worst, size, limit.right)


def _judge_stop(case: HardCase, variant: Variant, found: Examination) -> Verdict:
    """Judge a run of a scene whose motion ends, or is one of several from some time on."""
    scene, kind = case.scenes()[0], case.stop["kind"]
    time = case.stops_at(scene)
    limit, law = STOP[variant.parameter] * 1000 * case.dt, case.limits(variant.parameter).right
    follows = kind == SEVERAL and found.measures.get(BEYOND, math.inf) <= law
    if not found.stopped:
        if follows:
            reason = "goes on with one of several motions, and does not say that there are others"
            return Verdict(DEGRADED, reason, found.measures[BEYOND], law)
        beyond = scene.t_end - time
        if kind == NONE and load_engine(variant.engine).steps_by_impulses(
            variant.fidelity, variant.settings
        ):
            reason = "goes on by impulses for so many seconds where there is no motion with finite forces"
            return Verdict(IMPULSIVE, reason, beyond)
        what = (
            "are several motions, and follows none of them"
            if kind == SEVERAL
            else "is no motion with finite forces"
        )
        return Verdict(WRONG, f"goes on for so many seconds where there {what}", beyond, 0.0)
    late = found.stop_time - time
    if math.isnan(late):
        return Verdict(DECLINED, found.stopped)
    if late < -limit and found.stop_kind == UNSETTLED:
        # where there still is a motion, its own limit
        return Verdict(DECLINED, found.stopped, -late, limit)
    if late > limit and follows and found.stop_kind in (kind, UNSETTLED):
        reason = f"stops {late:.2g} s late, until then on one of several motions: {found.stopped}"
        return Verdict(DEGRADED, reason, late, limit)
    if abs(late) > limit:
        reason = f"stops {abs(late):.2g} s {'late' if late > 0 else 'early'}: {found.stopped}"
        return Verdict(WRONG, reason, abs(late), limit)
    # an engine that stops there and states that friction has no solution is right
    if found.stop_kind not in (kind, UNSETTLED):
        return Verdict(
            DEGRADED, f"stops, but does not say {kind!r}: {found.stopped}", abs(late), limit
        )
    return Verdict(RIGHT, found.stopped, abs(late), limit)
