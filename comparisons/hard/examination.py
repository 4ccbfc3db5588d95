"""Examination of one hard case with one variant, in a child process, and the verdict on its outcome."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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

RIGHT = "right"
"""Verdict: the outcome is the expected one."""
DEGRADED = "degraded"
"""Verdict: some digits are lost, or the run stops without the right statement."""
DECLINED = "declined"
"""Verdict: the method states that it cannot compute this motion."""
DECLINED_BY_ADAPTER = "declined by adapter"
"""Verdict: our adapter states it, and the engine was not called."""
IMPULSIVE = "impulsive"
"""Verdict: the run continues by impulses where no motion with finite forces exists. This is not judged."""
UNREAD = "refused by reader"
"""Verdict: the scene file is refused, for all methods alike."""
INEXPRESSIBLE = "not expressible"
"""Verdict: the adapter cannot build the scene."""
NOT_RUN = "not run"
"""Verdict: the run would take too many steps, or there was no time for it."""
NOT_INSTALLED = "not installed"
"""Verdict: the engine is not installed."""
WRONG = "wrong"
"""Verdict: the outcome is not the expected one, and the method does not say so."""
FAILED = "failed"
"""Verdict: a crash, a hang, or an unexpected exception."""
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
"""All verdicts, in the order in which they are counted."""
READER = "reader"
"""Origin of a refusal: the reader of scene files."""
ADAPTER = "adapter"
"""Origin of a refusal: the adapter of an engine."""
METHOD = "method"
"""Origin of a refusal: a method of the suite, which has no adapter."""
WITHOUT_RESULT = {
    Status.REFUSED: INEXPRESSIBLE,
    Status.MISSING: NOT_INSTALLED,
    Status.NOT_RUN: NOT_RUN,
    Status.FAILED: FAILED,
}
"""Verdicts on runs without a result, by their status."""
STOP = {"rtol": 1e-8, "dt": 2e-2}
"""Largest error of the time at which the motion ends, relative to the time scale 1000 dt of the case, by the parameter
of the variant: an adaptive method locates this time, and a fixed step may miss it by some steps."""
COMPLEMENTARITY = "complementarity"
"""Measure: violation of the complementarity conditions."""
COULOMB = "Coulomb's law"
"""Measure: violation of Coulomb's law."""
BEYOND = "Coulomb's law beyond the end of uniqueness"
"""Measure: violation of Coulomb's law where there are several motions. It is zero if the run follows one of them."""
SAMPLES = 400
"""Number of output instants of a run."""
AUDITED = 60
"""Number of instants at which the complementarity conditions of the reference are solved again."""
STEP_ROUNDING = 1.001
"""Factor by which the number of steps may exceed its limit, because of rounding."""


@dataclass(frozen=True)
class Verdict:
    """The verdict on the examination of one case.

    Attributes
    ----------
    word : str
        One of `VERDICTS`.
    about : str
        The reason: the name of a measure, or a sentence.
    size : float
        The relative error, or the time (s) by which a run stops too late or too early.
    limit : float
        Largest size that is right.
    """

    word: str
    about: str
    size: float = math.nan
    limit: float = math.nan


@dataclass(frozen=True)
class Examination:
    """The result of one case with one variant.

    Attributes
    ----------
    measures : Mapping[str, float]
        Relative errors by name; empty if nothing was measured.
    stopped, stop_kind, stop_time
        Reason, kind (`stiction.scenes.Breakdown`) and time (s) of an early end; the reason is empty without one.
    refused, by : str
        Reason of a refusal of the input, and its origin: `READER`, `ADAPTER` or `METHOD`. Both are empty without one.
    verdict : Verdict or None
        The verdict, if there was nothing to measure.
    version : str
        Version of the engine.
    cpu_s, engine_s : float
        CPU time of the steps of all runs, and the part of it in the engine's own calls, s.
    problems : tuple of Problem
        Complementarity problems that the event-driven reference solved.
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
    """Run a case with a variant, and measure the runs; called in a child process.

    Raises
    ------
    Refused
        If the adapter cannot build the scene, or the method has no static coefficient.
    EngineMissing
        If the engine is not installed.
    """
    [case] = [case for case in hard_cases() if case.name == name]
    engine = load_engine(variant.engine)
    try:
        scenes = case.scenes(has_static_coefficient(variant))
    except SceneError as error:
        return Examination(refused=_reason(error), by=READER, version=engine.version)
    steps = scenes[0].t_end / case.dt
    if variant.parameter == "dt" and steps > case.most_steps * STEP_ROUNDING:
        reason = (
            f"{steps:.3g} steps of {case.dt:g} s are more than this table "
            f"spends on a case ({case.most_steps})"
        )
        return Examination(verdict=Verdict(NOT_RUN, reason))
    try:
        runs = _runs(case, scenes, variant)
    except SceneError as error:
        origin = METHOD if variant.engine in own_methods() else ADAPTER
        return Examination(refused=_reason(error), by=origin, version=engine.version)
    except Declined as error:
        return Examination(refused=str(error), by=ADAPTER, version=engine.version)
    except BadTrajectory as error:
        # The result is no motion of the mechanism.
        return Examination(verdict=Verdict(WRONG, str(error)), version=engine.version)
    except EngineFailure as error:
        return Examination(stopped=str(error), version=engine.version)
    return _measured(case, scenes, runs, variant)


def _reason(error: SceneError) -> str:
    """Return what is wrong with a scene, in one line without the name of the file."""
    _, *problems = str(error).splitlines()
    reason = "; ".join(line.strip() for line in problems)
    return reason if reason else str(error)


def _runs(case: HardCase, scenes: Sequence[Scene], variant: Variant) -> list[Trajectory]:
    """Run the scenes of a case in their order, until one ends early."""
    runs: list[Trajectory] = []
    for scene in scenes:
        # In other units of time, the step is another number.
        dt = case.dt * scene.t_end / scenes[0].t_end
        run = _run(case, scene, dt, variant)
        runs.append(run)
        if run.termination != "end":
            break
    return runs


def _run(case: HardCase, scene: Scene, dt: float, variant: Variant) -> Trajectory:
    """Run a scene of a case; `dt` is the step in its units (s), which adaptive methods do not use."""
    guides = scene.frictional_guides.values()
    if not has_static_coefficient(variant) and any(
        guide.static_coefficient > guide.kinetic_coefficient for guide in guides
    ):
        raise Refused("has no static coefficient; the case is about mus > mu")
    step = {"dt": dt} if variant.parameter == "dt" else {"rtol": variant.ladder[-1]}
    settings = dict(variant.settings)
    if variant.engine == "reference":
        settings |= case.reference
    # All methods have their output at the same instants, which are multiples of the step.
    output_step = max(round(scene.t_end / SAMPLES / dt), 1) * dt
    engine = load_engine(variant.engine)
    return engine.simulate(
        scene, fidelity=variant.fidelity, output_step=output_step, **step, **settings
    )


def _measured(
    case: HardCase, scenes: Sequence[Scene], runs: Sequence[Trajectory], variant: Variant
) -> Examination:
    """Return the measures of runs, of which the last one may have ended early."""
    is_reference = variant.engine == "reference"
    last = runs[-1]
    stop: dict[str, Any] = {}
    if last.termination == "end":
        scene, run = scenes[0], runs[0]
        measures = checks.measures(case, scenes, runs) | _beyond(case, scene, run)
        if is_reference and scene.frictional_guides:
            measures |= _conditions(scene, run)
    else:
        scene, run = scenes[len(runs) - 1], last
        measures = _beyond(case, scene, run)
        stop["stopped"] = run.termination
        if run.breakdown is None:
            stop["stop_time"] = float(run.t[-1])
        else:
            # A run that stops at the start may have no rows.
            stop |= {"stop_kind": run.breakdown.kind, "stop_time": run.breakdown.time}
    problems: Sequence[Problem] = ()
    if is_reference and variant.parameter == "rtol":
        problems = problems_met(case.topic, scene, run)
    return Examination(
        measures,
        version=run.version,
        cpu_s=sum(one.cost.stepping_s for one in runs),
        engine_s=sum(one.cost.own_s for one in runs),
        problems=tuple(problems),
        **stop,
    )


def _beyond(case: HardCase, scene: Scene, run: Trajectory) -> dict[str, float]:
    """Return the measure `BEYOND`, or nothing if it does not apply.

    It applies if there are several motions from some time on, and the run has instants after it and states which guides
    stick.
    """
    needed = {
        f"{name}.{label}" for name in scene.frictional_guides for label in ("mode", "friction")
    }
    if case.expected != NO_MOTION or case.stop["kind"] != SEVERAL:
        return {}
    if not needed <= run.columns.keys():
        return {}
    is_later = run.t > case.stops_at(scene)
    if not is_later.any():
        return {}
    columns = {name: np.asarray(column)[is_later] for name, column in run.columns.items()}
    return {BEYOND: checks.friction_excess(scene, columns)}


def _conditions(scene: Scene, run: Trajectory) -> dict[str, float]:
    """Return the violation of complementarity and of Coulomb's law in a run of the reference."""
    from stiction.reference_impl.integration.coulomb_audit import audit
    from stiction.reference_impl.multibody.mechanism import Mechanism

    method = run.settings["stabilization"]["method"]
    audited = audit(run, Mechanism(scene, method), AUDITED)
    return {
        COMPLEMENTARITY: audited.complementarity,
        COULOMB: checks.friction_excess(scene, run.columns),
        "acceleration against the HLCP": audited.acceleration,
        "instants that the HLCP does not accept": float(audited.unsolved),
    }


def judge(case: HardCase, variant: Variant, outcome: Outcome) -> Verdict:
    """Return the verdict on the outcome of `examine` in a child process."""
    if outcome.status in WITHOUT_RESULT:
        return Verdict(WITHOUT_RESULT[outcome.status], outcome.reason)
    if outcome.status != Status.OK:
        return Verdict(FAILED, f"{outcome.status}: {outcome.reason}")
    result: Examination = outcome.value
    if result.verdict is not None:
        return result.verdict
    if result.by:
        return _judge_refusal(case, result)
    if case.expected == NO_MOTION:
        return _judge_stop(case, variant, result)
    if result.stopped:
        return _judge_early_end(case, result)
    if case.expected == REFUSAL:
        # The input was accepted: how wrong the run is, tells its largest error.
        name, size = "accepted", 1.0
        if result.measures:
            name, size = max(result.measures.items(), key=lambda item: item[1])
        return Verdict(WRONG, name, size, 0.0)
    return _judge_motion(result.measures, case.limits(variant.parameter))


def _judge_refusal(case: HardCase, result: Examination) -> Verdict:
    """Return the verdict on a refusal of the input."""
    if result.by == ADAPTER:
        return Verdict(DECLINED_BY_ADAPTER, result.refused)
    is_expected = case.expected in (REFUSAL, MOTION_OR_WORD) and case.words in result.refused
    if not is_expected:
        return Verdict(FAILED, result.refused)
    if result.by == READER:
        return Verdict(UNREAD, result.refused)
    return Verdict(RIGHT if case.expected == REFUSAL else DECLINED, result.refused)


def _judge_early_end(case: HardCase, result: Examination) -> Verdict:
    """Return the verdict on a run that ends early although there is a motion, or a refusal was expected."""
    if case.expected == REFUSAL:
        return Verdict(RIGHT, result.stopped)
    # The statement that there is no motion, or more than one, is wrong. Any other reason is a
    # limitation of the method.
    is_wrong_statement = result.stop_kind in (NONE, SEVERAL)
    return Verdict(WRONG if is_wrong_statement else DECLINED, result.stopped)


def _judge_motion(measures: Mapping[str, float], limits: Limits) -> Verdict:
    """Return the verdict on a motion, by the measure that exceeds its limit most."""
    limits_of = {
        name: CONDITIONS if name in (COMPLEMENTARITY, COULOMB) else limits for name in measures
    }

    def excess(name: str) -> float:
        error = measures[name]
        return error / limits_of[name].right if math.isfinite(error) else math.inf

    worst = max(measures, key=excess)
    error, worst_limits = measures[worst], limits_of[worst]
    if error <= worst_limits.right:
        word = RIGHT
    elif error <= worst_limits.degraded:
        word = DEGRADED
    else:
        word = WRONG
    return Verdict(word, worst, error, worst_limits.right)


def _judge_stop(case: HardCase, variant: Variant, result: Examination) -> Verdict:
    """Return the verdict on a run of a scene whose motion ends, or is one of several from some time on."""
    scene = case.scenes()[0]
    kind = case.stop["kind"]
    expected_time = case.stops_at(scene)
    law_limit = case.limits(variant.parameter).right
    # Where there are several motions, a run may follow one of them.
    follows_motion = kind == SEVERAL and result.measures.get(BEYOND, math.inf) <= law_limit
    if not result.stopped:
        time_beyond = scene.t_end - expected_time
        return _judge_continuation(case, variant, result, time_beyond, follows_motion)

    limit = STOP[variant.parameter] * 1000 * case.dt
    lateness = result.stop_time - expected_time
    is_undecided = result.stop_kind == UNSETTLED
    # An engine that stops because friction has no solution makes the right statement, too.
    has_right_kind = is_undecided or result.stop_kind == kind
    if math.isnan(lateness):
        return Verdict(DECLINED, result.stopped)
    if lateness < -limit and is_undecided:
        # There still is a motion, which the method cannot compute.
        return Verdict(DECLINED, result.stopped, -lateness, limit)
    if lateness > limit and follows_motion and has_right_kind:
        reason = (
            f"stops {lateness:.2g} s late, until then on one of several motions: {result.stopped}"
        )
        return Verdict(DEGRADED, reason, lateness, limit)
    if abs(lateness) > limit:
        word = "late" if lateness > 0 else "early"
        reason = f"stops {abs(lateness):.2g} s {word}: {result.stopped}"
        return Verdict(WRONG, reason, abs(lateness), limit)
    if not has_right_kind:
        reason = f"stops, but does not say {kind!r}: {result.stopped}"
        return Verdict(DEGRADED, reason, abs(lateness), limit)
    return Verdict(RIGHT, result.stopped, abs(lateness), limit)


def _judge_continuation(
    case: HardCase,
    variant: Variant,
    result: Examination,
    time_beyond: float,
    follows_motion: bool,
) -> Verdict:
    """Return the verdict on a run that should have stopped `time_beyond` seconds before its end."""
    kind = case.stop["kind"]
    if follows_motion:
        reason = "goes on with one of several motions, and does not say that there are others"
        limit = case.limits(variant.parameter).right
        return Verdict(DEGRADED, reason, result.measures[BEYOND], limit)
    if kind == SEVERAL:
        reason = (
            "goes on for so many seconds where there are several motions, and follows none of them"
        )
        return Verdict(WRONG, reason, time_beyond, 0.0)
    if load_engine(variant.engine).steps_by_impulses(variant.fidelity, variant.settings):
        reason = (
            "goes on by impulses for so many seconds where there is no motion with finite forces"
        )
        return Verdict(IMPULSIVE, reason, time_beyond)
    reason = "goes on for so many seconds where there is no motion with finite forces"
    return Verdict(WRONG, reason, time_beyond, 0.0)
