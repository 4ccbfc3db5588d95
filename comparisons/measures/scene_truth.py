"""The truth that a scene is compared with: an independent one where there is one, else our own run."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from stiction.comparisons.bench.variants import Record, has_static_coefficient, truth_key
from stiction.engines.reference.engine import compile_kernels
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.integration.result import Run
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene, scene_to_toml
from stiction.truths import (
    NoMotion,
    NotThisMechanism,
    Truth,
    TruthRefused,
    Undecided,
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
OWN_RTOL, COARSER_RTOL = 1e-12, 1e-10


class NoOwnRun(TruthRefused):
    """Our own run did not reach its end."""


_CHECK_INSTANTS = 101
"""Instants at which two own runs are compared: their difference is smooth but at events, which are compared apart."""
_KEPT = 16
"""Truths that are kept: those of a comparison of several scenes, with and without a static coefficient."""


def ground_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the best truth known for a scene; if a tier has no answer, the next one, with the reason as note.

    If the scene has the structure of one of `stiction.truths`, its truth is that independent
    solution, or the proven one if a certificate for the scene exists. Otherwise it is the reference
    implementation's own event-driven run at rtol 1e-12 with projection, with the tier "our own
    run"; its uncertainty is the difference to the run at rtol 1e-10. If that run ends early, or if
    the equations have no motion or several, the tier is "none" and nothing can be compared. In all
    tiers only the events of `rubbing_joints` count. Truths are cached.
    """
    end = scene.t_end if t_end is None else t_end
    return _best_truth(_Request(scene_to_toml(scene), scene.name, end, scene))


@dataclass(frozen=True)
class _Request:
    """A scene and the end of its truth, with a hash, which scenes themselves do not have."""

    text: str
    name: str
    t_end: float
    scene: Scene = field(compare=False)


@lru_cache(maxsize=_KEPT)
def _best_truth(request: _Request) -> Truth:
    scene, t_end, note = request.scene, request.t_end, ""
    # At most one mechanism fits a scene. Where its equations have no motion, our own run would show
    # none either.
    for independent in INDEPENDENT:
        try:
            truth = independent(scene, t_end)
        except NotThisMechanism:
            continue
        except NoMotion as error:
            return Truth.unknown(scene.name, t_end, str(error))
        except Undecided as error:
            note = str(error)
            break
        return with_proof(scene, _counted(scene, truth))
    try:
        return _counted(scene, replace(_own_truth(scene, t_end), note=note))
    except NoOwnRun as error:
        return Truth.unknown(scene.name, t_end, "; ".join(filter(None, (note, str(error)))))


def truth_for(scene: Scene, records: Sequence[Record], t_end: float | None = None) -> Truth:
    """Return `ground_truth` for the physics that the engines of some runs share, under the name of `truth_key`.

    Where all runs failed it is not sought.
    """
    static_coefficient = has_static_coefficient(records[0].variant)
    if any(record.trajectory is not None for record in records):
        truth = ground_truth(physics_of(scene, static_coefficient), t_end)
    else:
        truth = Truth.unknown(
            scene.name,
            scene.t_end if t_end is None else t_end,
            "all runs that could be compared with it failed",
        )
    return replace(truth, scene=truth_key(scene.name, static_coefficient))


def truths_for(
    scene: Scene, records: Iterable[Record], t_end: float | None = None
) -> dict[str, Truth]:
    """Return `truth_for` each run by its key: of a failed one, if another with its physics did not fail."""
    by_physics: dict[bool, list[Record]] = defaultdict(list)
    for record in records:
        by_physics[has_static_coefficient(record.variant)].append(record)
    truths = {}
    for records_alike in by_physics.values():
        truth = truth_for(scene, records_alike, t_end)
        truths.update({record.key: truth for record in records_alike})
    return truths


def _counted(scene: Scene, truth: Truth) -> Truth:
    """The truth with the events that count."""
    guides = rubbing_joints(scene)
    kept = [i for i, event in enumerate(truth.events) if event.joint in guides]
    jumps = None if truth.jump_closed_form is None else truth.jump_closed_form[kept]
    return replace(
        truth, events=tuple(truth.events[i] for i in kept), jump_closed_form=jumps, guides=guides
    )


def _own_truth(scene: Scene, t_end: float) -> Truth:
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
    # By guide and kind: events of several guides at one instant may come in another order.
    fine_events, coarse_events = (
        sorted((event.joint, event.kind, event.time) for event in result.events)
        for result in (fine, coarse)
    )
    same = [event[:2] for event in fine_events] == [event[:2] for event in coarse_events]
    # where the two have other events nothing is known of their times
    shift = t_end
    if same:
        shift = max((abs(a[2] - b[2]) for a, b in zip(fine_events, coarse_events)), default=0.0)

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        # The run is made again, with these instants as its output: nothing is interpolated.
        order = np.argsort(t, kind="stable")
        values_at_t = {
            name: values[np.argsort(order)] for name, values in run(t[order]).columns.items()
        }
        if side == "before":
            for event in fine.events:
                for name, value in event.before.items():
                    values_at_t[name][t == event.time] = value
        return values_at_t

    uncertainty = {
        name: float(np.max(np.abs(fine.columns[name] - coarse.columns[name])))
        for name in fine.columns
    }
    return Truth(
        scene.name, Tier.OWN_RUN, t_end, columns, {**uncertainty, "event time": shift}, fine.events
    )
