"""A proven motion as a file that can be checked again, step by step and in any order.

Each step claims: *every solution that is at t0 in the set ``start`` is, whatever mode changes happen in between, at t1
in the set ``start`` of the next step (at last, ``end``), and changes its mode exactly at the listed times.* A set is
{centre + frame r : r in size}. In a mode of rest the velocity is that of the surface whatever the set says.

`check` proves each claim anew, with more bits and another order than those that found it. It takes from the file what
is claimed, nothing that was computed on the way: enclosures, remainders and derivatives are its own. The decimals of
events and end state, which are there to be read, have to contain what is proven.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Hashable, Iterator, Mapping
from typing import Any

from flint import arb

from stiction.comparisons.proof.enclosures.series import TooLong, halves
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.comparisons.proof.motion import Precision, ProvenEvent, ProvenMotion, StateSet, Step, take_step
from stiction.comparisons.proof.proving import provable
from stiction.comparisons.proof.tables import (Failure, ball_texts, checking, contains, decimals, exact_text,
                                                  matrix_texts, read_ball, read_ball_within, read_matrix, read_number)
from stiction.scenes import Scene, scene_from_dict, scene_to_toml

FORMAT = "stiction proof 1"
_MORE_BITS, _MORE_ORDER = 64, 5
_SLACK = 4
"""Part by which balls in decimals are wider than was found: sines and cosines of balls do not narrow with more bits."""


def _set(states: StateSet) -> dict[str, Any]:
    return {"centre": [exact_text(x) for x in states.centre], "frame": matrix_texts(states.frame),
            "size": [ball_texts(x) for x in states.size]}


def _read_set(claimed: dict[str, Any], read: Callable[[list[str]], arb]) -> StateSet:
    return StateSet(tuple(map(read_number, claimed["centre"])), read_matrix(claimed["frame"]),
                    tuple(map(read, claimed["size"])))


def _read_mode(claimed: Any) -> Hashable:
    return tuple(claimed) if isinstance(claimed, list) else claimed


def certificate(motion: ProvenMotion, scene: Scene, digits: int) -> dict[str, Any]:
    """Claims about a motion, as the tables of a JSON file."""
    p, mechanism, last = motion.precision, motion.mechanism, motion.steps[-1]

    def shown(columns: Mapping[str, arb]) -> dict[str, str]:
        return {name: decimals(value + (p.margin + value.rad() / _SLACK) * arb(0, 1), digits)
                for name, value in columns.items()}

    with p.working():
        steps = [{"t0": exact_text(step.t0), "mode": step.legs[0].mode, "start": _set(step.start),
                  "events": [{"kind": event.kind, "after": event.after, "time": ball_texts(event.time)}
                             for event in step.events]} for step in motion.steps]
        events = [{"kind": event.kind, "joint": mechanism.event_joint(event.before, event.after),
                   "time [s]": decimals(event.time, digits),
                   **shown(mechanism.columns(event.time, event.q, event.v))} for event in motion.events]
        state = shown(mechanism.columns(last.t1, *end_state(mechanism, motion.end, last.legs[-1].mode)))
        return {"format": FORMAT, "scene": scene.name, "file": scene_to_toml(scene), "digits": digits, "bits": p.bits,
                "order": p.order, "largest width": motion.width().str(3, radius=False),
                "t_end [s]": decimals(last.t1, digits), "state at t_end": state, "events": events, "steps": steps,
                "end": {"mode": last.legs[-1].mode, "set": _set(motion.end)}}


def check(claims: dict[str, Any]) -> list[Failure]:
    """Prove every claim of a certificate anew; the failures, none if all hold.

    Raises
    ------
    NotACertificate
        Where the tables lack something.
    """
    with checking(FORMAT):
        precision = Precision(int(claims["bits"]) + _MORE_BITS, int(claims["order"]) + _MORE_ORDER, float("inf"))
        with precision.working():
            return list(_failures(claims, precision))


def _failures(claims: dict[str, Any], precision: Precision) -> Iterator[Failure]:
    mechanism = provable(scene_from_dict(tomllib.loads(claims["file"]), claims["scene"]))
    steps, end, shown = claims["steps"], claims["end"], iter(claims["events"])
    ends = [*(step["start"] for step in steps), end["set"]]
    sets, targets = ([_read_set(claimed, read) for claimed in ends] for read in (read_ball, read_ball_within))
    modes = [*(_read_mode(step["mode"]) for step in steps), _read_mode(end["mode"])]
    times = [*(read_number(step["t0"]) for step in steps), mechanism.t_end]
    first = mechanism.start()
    if not targets[0].contains([*mechanism.q, *mechanism.v]):
        yield Failure(-1, "the start of the scene is not in the first set")
    if first.mode != modes[0] or times[0] != 0:
        begins = f"the first step at {steps[0]['t0']} in {modes[0]}"
        yield Failure(-1, f"the motion starts at 0 in mode {first.mode}, {begins}")
    for i, step in enumerate(steps):
        if not times[i] < times[i + 1]:
            yield Failure(i, "the step does not go forward")
            continue
        begin = first if i == 0 else Next(modes[i])
        try:
            again = take_step(mechanism, times[i], sets[i], begin, 0.0, precision, times[i + 1])
        except (TooLong, Undecided) as error:
            yield Failure(i, str(error))
            continue
        reason = _difference(step["events"], again, modes[i + 1], targets[i + 1])
        if reason:
            yield Failure(i, reason)
        for event in again.events:
            if not _shows(next(shown, None), event, mechanism):
                yield Failure(i, f"the list of events has no {event.kind} at {event.time.str(10)} s as proven")
    state = mechanism.columns(mechanism.t_end, *end_state(mechanism, sets[-1], modes[-1]))
    claimed = claims["state at t_end"]
    if next(shown, None) is not None or not all(contains(claimed[name], value) for name, value in state.items()):
        yield Failure(-1, "the list of events or the state at t_end differs from the steps")


def _difference(claimed: list[dict[str, Any]], again: Step, end_mode: Hashable, target: StateSet) -> str:
    """The first difference of a step that was proven again from the claimed events, mode and set at its end, or ""."""
    changes = [(event["kind"], _read_mode(event["after"])) for event in claimed]
    found = [(event.kind, event.after) for event in again.events]
    if changes != found or again.legs[-1].mode != end_mode:
        return f"other changes of mode: {found} instead of {changes}"
    if not all(read_ball_within(one["time"]).contains(event.time) for one, event in zip(claimed, again.events)):
        return "the time of an event is not within its interval"
    if not again.start.image_lies_in(again.point, again.derivative, target):
        return "the image of the set is not within the next set"
    return ""


def _shows(shown: dict[str, str] | None, event: ProvenEvent, mechanism: ProvableMechanism) -> bool:
    """Return whether the decimals of an event contain what is proven of it."""
    if shown is None:
        return False
    joint, columns = mechanism.event_joint(event.before, event.after), mechanism.columns(event.time, event.q, event.v)
    return ((shown["kind"], shown["joint"]) == (event.kind, joint) and contains(shown["time [s]"], event.time)
            and all(contains(shown[name], value) for name, value in columns.items()))


def end_state(mechanism: ProvableMechanism, end: StateSet, mode: Hashable) -> tuple[list[arb], list[arb]]:
    """q and v of a set at the end of a motion in a mode."""
    q, v = halves(end.hull())
    held = mechanism.held(mode)
    return q, [held.get(i, speed) for i, speed in enumerate(v)]
