"""A proven motion as a certificate that can be checked step by step, in any order.

Each step claims: *every solution that is at t0 in the set ``start`` is, whatever mode changes happen in between, at t1
in the set ``start`` of the next step (at last, ``end``), and changes its mode exactly at the listed times.* A set is
{centre + frame r : r in size}. In a mode of rest the velocity is that of the surface whatever the set says.

The check proves each claim with more bits and another order than the original proof. It takes only the claims from the
file; enclosures, remainders and derivatives are computed again. The decimals of events and end state, which are for
readers, have to contain the proven numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any

from flint import arb

from stiction.scenes import Scene
from stiction.truths.proof.certificate import (
    Claims,
    Failure,
    Format,
    ball_texts,
    claimed_scene,
    contains,
    decimals,
    exact_text,
    matrix_texts,
    read_ball,
    read_ball_within,
    read_matrix,
    read_number,
)
from stiction.truths.proof.enclosures import NotProven
from stiction.truths.proof.enclosures.series import halves
from stiction.truths.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.truths.proof.motion import ProvenMotion, provable_mechanism
from stiction.truths.proof.step import Precision, ProvenEvent, StateSet, Step, take_step

_MORE_BITS = 64
"""Number of additional bits with which a certificate is checked, for other roundings."""
_MORE_ORDER = 5
"""Number of additional orders with which a certificate is checked, for other remainders."""
_SLACK = 4
"""Reciprocal of the part of their radii by which balls in decimals are widened.

Sines and cosines of balls do not become narrower with more bits."""


def motion_certificate(motion: ProvenMotion, scene: Scene, digits: int) -> Claims:
    """Return the claims about a motion."""
    p = motion.precision
    mechanism = motion.mechanism
    last = motion.steps[-1]

    def shown(columns: Mapping[str, arb]) -> dict[str, str]:
        """Return columns in decimals for readers."""
        return {
            name: decimals(value + (p.margin + value.rad() / _SLACK) * arb(0, 1), digits)
            for name, value in columns.items()
        }

    with p.working():
        # The claims themselves are exact numbers.
        steps = [
            {
                "t0": exact_text(step.t0),
                "mode": step.legs[0].mode,
                "start": _set(step.start),
                "events": [
                    {"kind": event.kind, "after": event.after, "time": ball_texts(event.time)}
                    for event in step.events
                ],
            }
            for step in motion.steps
        ]
        # Events and end state in decimals are for readers.
        events = [
            {
                "kind": event.kind,
                "joint": event.joint,
                "time [s]": decimals(event.time, digits),
                **shown(mechanism.columns(event.time, event.q, event.v)),
            }
            for event in motion.events
        ]
        state = shown(_end_columns(mechanism, last.t1, motion.end, last.legs[-1].mode))
        return {
            "format": FORMAT.name,
            "scene": scene.name,
            "file": scene.to_toml(),
            "digits": digits,
            "bits": p.bits,
            "order": p.order,
            "largest width": motion.width().str(3, radius=False),
            "t_end [s]": decimals(last.t1, digits),
            "state at t_end": state,
            "events": events,
            "steps": steps,
            "end": {"mode": last.legs[-1].mode, "set": _set(motion.end)},
        }


def _set(states: StateSet) -> dict[str, Any]:
    """Return a set as exact texts."""
    return {
        "centre": [exact_text(x) for x in states.centre],
        "frame": matrix_texts(states.frame),
        "size": [ball_texts(x) for x in states.size],
    }


def _read_set(claimed: dict[str, Any], read: Callable[[Sequence[str]], arb]) -> StateSet:
    """Return a set, at least (`read_ball`) or at most (`read_ball_within`) as large as claimed."""
    return StateSet(
        tuple(map(read_number, claimed["centre"])),
        read_matrix(claimed["frame"]),
        tuple(map(read, claimed["size"])),
    )


def _read_mode(claimed: Any) -> Hashable:
    """Return a mode, whose tuples are lists in the file."""
    return tuple(claimed) if isinstance(claimed, list) else claimed


def _end_columns(
    mechanism: ProvableMechanism, t: arb, end: StateSet, mode: Hashable
) -> dict[str, arb]:
    """Return the columns of a set at the end of a motion in a mode."""
    q, v = halves(end.hull())
    held = mechanism.held(mode)
    return mechanism.columns(t, q, [held.get(i, speed) for i, speed in enumerate(v)])


def _failures(claims: Claims) -> Iterator[Failure]:
    """Prove the claims of a certificate again, and yield the failures."""
    precision = Precision(
        int(claims["bits"]) + _MORE_BITS, int(claims["order"]) + _MORE_ORDER, float("inf")
    )
    with precision.working():
        mechanism = provable_mechanism(claimed_scene(claims))
        steps = claims["steps"]
        shown_events = iter(claims["events"])
        times = [*(read_number(step["t0"]) for step in steps), mechanism.t_end]
        modes = [_read_mode(part["mode"]) for part in (*steps, claims["end"])]
        sets = [*(step["start"] for step in steps), claims["end"]["set"]]
        # Each set is read twice: rounded outwards as the start of a step, and inwards as the set in which
        # the previous step has to end.
        starts, targets = (
            [_read_set(claimed, read) for claimed in sets] for read in (read_ball, read_ball_within)
        )
        mode = mechanism.start().mode
        if not targets[0].contains([*mechanism.q, *mechanism.v]):
            yield Failure(-1, "the start of the scene is not in the first set")
        if modes[0] != mode or times[0] != 0:
            yield Failure(
                -1,
                f"the motion starts at 0 in mode {mode}, the first step at {times[0]} in {modes[0]}",
            )
        # Each step is checked independently of the others, with sets, modes and times of the file.
        for i, step in enumerate(steps):
            if not times[i] < times[i + 1]:
                yield Failure(i, "the step does not go forward")
                continue
            first = mechanism.start() if times[i] == 0 else Next(modes[i])
            try:
                again = take_step(
                    mechanism, times[i], starts[i], first, 0.0, precision, times[i + 1]
                )
            except NotProven as error:
                yield Failure(i, str(error))
                continue
            reason = _difference(again, step["events"], modes[i + 1], targets[i + 1])
            if reason:
                yield Failure(i, reason)
            for event in again.events:
                if not _shows(next(shown_events, None), event, mechanism):
                    yield Failure(
                        i,
                        f"the list of events has no {event.kind} at {event.time.str(10)} s as proven",
                    )
        # The decimals have to contain the end, and there must be no further events.
        claimed = claims["state at t_end"]
        state = _end_columns(mechanism, times[-1], starts[-1], modes[-1])
        if next(shown_events, None) is not None or not all(
            contains(claimed[name], value) for name, value in state.items()
        ):
            yield Failure(-1, "the list of events or the state at t_end differs from the steps")


def _difference(
    again: Step, claimed: list[dict[str, Any]], mode: Hashable, target: StateSet
) -> str:
    """Return how a step that is proven again differs from its claims; empty if it does not."""
    claimed_changes = [(event["kind"], _read_mode(event["after"])) for event in claimed]
    changes = [(event.kind, event.after) for event in again.events]
    if claimed_changes != changes or again.current.mode != mode:
        return f"other changes of mode: {changes} instead of {claimed_changes}"
    if not all(
        read_ball_within(claim["time"]).contains(event.time)
        for claim, event in zip(claimed, again.events)
    ):
        return "the time of an event is not within its interval"
    if not again.start.image_lies_in(target, again.point, again.derivative):
        return "the image of the set is not within the next set"
    return ""


def _shows(shown: dict[str, str] | None, event: ProvenEvent, mechanism: ProvableMechanism) -> bool:
    """Return True if the decimals of an event contain the proven numbers."""
    if shown is None or (shown["kind"], shown["joint"]) != (event.kind, event.joint):
        return False
    columns = mechanism.columns(event.time, event.q, event.v)
    return contains(shown["time [s]"], event.time) and all(
        contains(shown[name], columns[name]) for name in columns
    )


FORMAT = Format("stiction proof 1", "step", lambda claims: len(claims["steps"]), _failures)
