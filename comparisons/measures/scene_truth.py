"""The truth that the runs of a scene are compared with: an independent solution, or else a run of the reference."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from stiction.comparisons.bench.variants import Record, has_static_coefficient, truth_key
from stiction.engines.joint_effects import neglected_keys, with_ideal_guides
from stiction.engines.reference.engine import compile_kernels
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.integration.result import Run
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.truths import (
    NoMotion,
    NotThisMechanism,
    Truth,
    TruthRefused,
    Undecided,
    clearance_slider_crank_truth,
    four_bar_truth,
    incline_truth,
    moving_guide_truth,
    oscillator_truth,
    pendulum_truth,
    slider_bar_truth,
    slider_crank_truth,
    trammel_truth,
)
from stiction.truths.physics import physics_of, rubbing_joints
from stiction.truths.proof.truth import with_proof
from stiction.truths.truth import Tier

INDEPENDENT = (
    slider_bar_truth,
    oscillator_truth,
    incline_truth,
    slider_crank_truth,
    pendulum_truth,
    four_bar_truth,
    trammel_truth,
    moving_guide_truth,
)
"""Functions that return an independent truth, or raise NotThisMechanism; at most one applies to a
scene."""
WITH_GAPS = (clearance_slider_crank_truth,)
"""The same for scenes whose guides have clearance."""
OWN_RTOL = 1e-12
"""Relative tolerance of a run of the reference that is used as truth."""
COARSER_RTOL = 1e-10
"""Relative tolerance of the run whose difference from it is the uncertainty of this truth."""


class NoOwnRun(TruthRefused):
    """The error of a run of the reference that does not reach its end."""


_CHECK_INSTANTS = 101
"""Number of instants at which the two runs are compared. Their difference is smooth except at
events, which are compared separately."""
_CACHE_SIZE = 16
"""Number of truths that are cached: enough for a comparison of several scenes, with and without a
static coefficient."""


def ground_truth(
    scene: Scene, t_end: float | None = None, fidelity: Fidelity = Fidelity.CONTACT
) -> Truth:
    """Return the truth of the best tier that is available for a scene; its note says why better ones are not.

    If one of the mechanisms of `stiction.truths` has the structure of the scene, the truth is its
    independent solution, or the proven one if there is a certificate for the scene. Otherwise it is
    an event-driven run of the reference at `OWN_RTOL` with projection (`Tier.OWN_RUN`), whose
    uncertainty is the difference from the run at `COARSER_RTOL`. If this run ends early, or if the
    equations have no motion or several, the tier is `Tier.NONE`, and runs cannot be compared. Only
    the events of `rubbing_joints` are included. Truths are cached.

    If guides declare clearance, the truth at contact fidelity is the motion with impacts, for the mechanisms of
    `WITH_GAPS`. Otherwise, and at joint fidelity, it is that of ideal joints, and its note says so.
    """
    end = scene.t_end if t_end is None else t_end
    has_gaps = fidelity == Fidelity.CONTACT and bool(neglected_keys(scene))
    return _best_truth(_Request(scene.to_toml(), scene.name, end, has_gaps, scene))


@dataclass(frozen=True)
class _Request:
    """The key of the cache of truths.

    Attributes
    ----------
    text : str
        Contents of the scene.
    name : str
        Name of the scene.
    t_end : float
        End of the truth, s.
    has_gaps : bool
        True if the clearance that the scene declares is to be part of the motion.
    scene : Scene
        The scene.
    """

    text: str
    name: str
    t_end: float
    has_gaps: bool
    scene: Scene = field(compare=False)


@lru_cache(maxsize=_CACHE_SIZE)
def _best_truth(request: _Request) -> Truth:
    """Return the truth of a request; see `ground_truth`."""
    scene, t_end = request.scene, request.t_end
    neglected = neglected_keys(scene)
    if neglected:
        refusal = ""
        if request.has_gaps:
            try:
                return _truth_with_gaps(scene, t_end)
            except NotThisMechanism:
                pass
            except TruthRefused as error:
                refusal = f"with clearance: {error}"
        ideal = with_ideal_guides(scene)
        truth = _best_truth(_Request(ideal.to_toml(), scene.name, t_end, False, ideal))
        neglect = f"of ideal joints, without {', '.join(neglected)}"
        notes = (neglect, refusal, truth.note)
        return replace(truth, note="; ".join(note for note in notes if note))
    note = ""
    for independent in INDEPENDENT:
        try:
            truth = independent(scene, t_end)
        except NotThisMechanism:
            continue
        except NoMotion as error:
            # A run of the reference would not have a motion either.
            return Truth.unknown(scene.name, t_end, str(error))
        except Undecided as error:
            note = str(error)
            break
        return with_proof(scene, _with_rubbing_joints(scene, truth))
    try:
        truth = _own_truth(scene, t_end)
    except NoOwnRun as error:
        reasons = [reason for reason in (note, str(error)) if reason]
        return Truth.unknown(scene.name, t_end, "; ".join(reasons))
    return _with_rubbing_joints(scene, replace(truth, note=note))


def _truth_with_gaps(scene: Scene, t_end: float) -> Truth:
    """Return the motion with impacts of a scene whose guides have clearance.

    Raises
    ------
    TruthRefused
        As the functions of `WITH_GAPS`; NotThisMechanism if none applies.
    """
    for independent in WITH_GAPS:
        try:
            return independent(scene, t_end)
        except NotThisMechanism:
            continue
    raise NotThisMechanism(
        f"{scene.name}: found another mechanism than those of the truths with clearance"
    )


def truth_for(scene: Scene, records: Sequence[Record], t_end: float | None = None) -> Truth:
    """Return the truth of runs with the same fidelity and coefficients of friction; its name is `truth_key`.

    If all runs have failed, it is not computed, and its tier is `Tier.NONE`.
    """
    static_coefficient = has_static_coefficient(records[0].variant)
    if any(record.trajectory is not None for record in records):
        fidelity = records[0].variant.fidelity
        truth = ground_truth(physics_of(scene, static_coefficient), t_end, fidelity)
    else:
        truth = Truth.unknown(
            scene.name,
            scene.t_end if t_end is None else t_end,
            "all runs that could be compared with it failed",
        )
    has_gaps = truth.has_gaps
    return replace(truth, scene=truth_key(scene.name, static_coefficient, has_gaps))


def truths_for(
    scene: Scene, records: Iterable[Record], t_end: float | None = None
) -> dict[str, Truth]:
    """Return, by key of a run, the truth that it is compared with; see `truth_for`."""
    by_physics: dict[tuple[bool, Fidelity], list[Record]] = defaultdict(list)
    for record in records:
        static_coefficient = has_static_coefficient(record.variant)
        by_physics[static_coefficient, record.variant.fidelity].append(record)
    truths = {}
    for same_physics in by_physics.values():
        truth = truth_for(scene, same_physics, t_end)
        truths.update({record.key: truth for record in same_physics})
    return truths


def _with_rubbing_joints(scene: Scene, truth: Truth) -> Truth:
    """Return a truth that only has the events of joints with friction."""
    joints = rubbing_joints(scene)
    numbers = [i for i, event in enumerate(truth.events) if event.joint in joints]
    events = tuple(truth.events[i] for i in numbers)
    jumps = truth.jump_closed_form
    if jumps is not None:
        jumps = jumps[numbers]
    return replace(truth, events=events, jump_closed_form=jumps, guides=joints)


def _own_truth(scene: Scene, t_end: float) -> Truth:
    """Return the truth by a run of the reference; NoOwnRun if it does not reach `t_end` (s)."""
    compile_kernels()
    mechanism = Mechanism(scene, "projection")
    q, v = consistent_start(mechanism)

    def run(t: np.ndarray, rtol: float = OWN_RTOL) -> Run:
        result = simulate_event_driven(mechanism, q, v, t, t_end, rtol)
        if result.termination != "end":
            raise NoOwnRun(f"our own run at rtol {rtol:g}: {result.termination}")
        return result

    check = np.linspace(0.0, t_end, _CHECK_INSTANTS)
    fine, coarse = run(check), run(check, COARSER_RTOL)

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        """Return the columns at times t, by another run with this output, so that nothing is interpolated."""
        order = np.argsort(t, kind="stable")
        rank = np.argsort(order)
        values_at_t = {name: values[rank] for name, values in run(t[order]).columns.items()}
        # The output of a run at an event is the state after it.
        if side == "before":
            for event in fine.events:
                for name, value in event.before.items():
                    values_at_t[name][t == event.time] = value
        return values_at_t

    uncertainty = {
        name: float(np.max(np.abs(fine.columns[name] - coarse.columns[name])))
        for name in fine.columns
    }
    uncertainty["event time"] = _event_time_difference(fine, coarse, t_end)
    return Truth(scene.name, Tier.OWN_RUN, t_end, columns, uncertainty, fine.events)


def _event_time_difference(fine: Run, coarse: Run, t_end: float) -> float:
    """Return the largest difference of the event times of two runs, s; `t_end` if they have different events."""
    # sorted by guide and kind, because simultaneous events of several guides may be in any order
    fine_events, coarse_events = (
        sorted((event.joint, event.kind, event.time) for event in result.events)
        for result in (fine, coarse)
    )
    if [event[:2] for event in fine_events] != [event[:2] for event in coarse_events]:
        return t_end
    differences = [abs(one[2] - other[2]) for one, other in zip(fine_events, coarse_events)]
    return max(differences, default=0.0)
