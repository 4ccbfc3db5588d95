"""A proven motion as a file that can be checked again, step by step and in any order.

The file is JSON. Every number that a claim depends on is exact: ``"m*2^e"`` with whole numbers m and e; a ball is
``[centre, radius]``. Each step claims: *every solution that is at t0 in the set ``start`` is, whatever mode changes happen in
between, at t1 in the set ``start`` of the next step (at last, ``end``), and changes its mode exactly at the listed times.* A set is
{centre + frame r : r in size}. In a mode of rest the velocity is that of the surface whatever the set says.

`check` proves each claim anew, with more bits and another order than those that found it. It takes from the file what is claimed,
nothing that was computed on the way: enclosures, remainders and derivatives are its own. The decimals of events and end state, which are there to be
read, have to contain what is proven.
"""

from __future__ import annotations

import gzip
import json
import tomllib
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.proof.enclosures.series import TooLong, working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.comparisons.proof.motion import Precision, ProvenEvent, ProvenMotion, StateSet, take_step
from stiction.comparisons.proof.proving import provable
from stiction.scenes import InputError, Scene, scene_from_dict, scene_to_toml

FORMAT = "stiction proof 1"
_MORE_BITS, _MORE_ORDER = 64, 5
_SLACK = 4
"""Balls in decimals are wider by this part than was found: sines and cosines of balls are not narrower with more bits."""
_INWARDS = 1 - arb(2) ** -20  # the radius of a ball has 30 bits


class NotACertificate(InputError):
    """A file that does not say what a certificate says."""


def exact_text(number: arb) -> str:
    """``"m*2^e"`` of a ball without radius."""
    mantissa, exponent = number.man_exp()
    return f"{mantissa}*2^{exponent}"


def _ball(number: arb) -> list[str]:
    return [exact_text(number.mid()), exact_text(number.rad())]


def read_number(text: str) -> arb:
    """The number of ``"m*2^e"``; raises NotACertificate where the working precision rounds it."""
    mantissa, exponent = text.split("*2^")
    value = arb(int(mantissa)) * arb(2) ** int(exponent)
    if not value.is_exact():
        raise NotACertificate(f"found a number of more than {ctx.prec} bits: {text[:40]}..; expected one of the precision that the file names")
    return value


def read_ball(pair: list[str]) -> arb:
    """A ball that contains that of ``[centre, radius]``: radii are rounded up."""
    centre, radius = map(read_number, pair)
    if radius < 0:
        raise NotACertificate(f"found the radius {pair[1]}; expected at least 0")
    return centre + radius * arb(0, 1)


def read_ball_within(pair: list[str]) -> arb:
    """A ball within that of ``[centre, radius]``: what is proven to lie in it lies in what is claimed."""
    return read_ball(pair).mid() + read_number(pair[1]) * _INWARDS * arb(0, 1)


def _set(states: StateSet) -> dict[str, Any]:
    return {"centre": [exact_text(x) for x in states.centre], "frame": [[exact_text(x) for x in row] for row in states.frame.tolist()],
            "size": [_ball(x) for x in states.size]}


def _read_set(told: dict[str, Any], read: Callable[[list[str]], arb]) -> StateSet:
    return StateSet(tuple(map(read_number, told["centre"])), arb_mat([[read_number(x) for x in row] for row in told["frame"]]),
                    tuple(map(read, told["size"])))


def _mode(mode: Hashable) -> Any:
    return list(mode) if isinstance(mode, tuple) else mode


def _read_mode(told: Any) -> Hashable:
    return tuple(told) if isinstance(told, list) else told


def contains(text: str, ball: arb) -> bool:
    """Whether a ball in decimals is proven to contain another one."""
    return arb(f"[{text}]").contains(ball)


def decimals(ball: arb, digits: int) -> str:
    """A ball in decimals, rounded outwards: ``centre +/- radius``."""
    return ball.str(digits + 6).strip("[]")


def certificate(motion: ProvenMotion, scene: Scene, digits: int) -> dict[str, Any]:
    """What is claimed of a motion, as the tables of a JSON file."""
    p = motion.precision
    with working(p.bits, p.order + 1):
        steps = [{"t0": exact_text(step.t0), "mode": _mode(step.mode), "start": _set(step.start),
                  "events": [{"kind": e.kind, "after": _mode(e.after), "time": _ball(e.time)} for e in step.events]} for step in motion.steps]
        last = motion.steps[-1]
        end = motion.end

        def told(values: Mapping[str, arb]) -> dict[str, str]:
            return {name: decimals(value + (p.margin + value.rad() / _SLACK) * arb(0, 1), digits) for name, value in values.items()}

        shown = [{"kind": e.kind, "joint": motion.mechanism.event_joint(e.before, e.after), "time [s]": decimals(e.time, digits),
                  **told(motion.mechanism.columns(e.time, e.q, e.v))}
                 for e in motion.events]
        state = told(motion.mechanism.columns(last.t1, *end_state(motion.mechanism, end, last.end_mode)))
        return {"format": FORMAT, "scene": scene.name, "file": scene_to_toml(scene), "digits": digits, "bits": p.bits, "order": p.order,
                "largest width": motion.width().str(3, radius=False), "t_end [s]": decimals(last.t1, digits), "state at t_end": state,
                "events": shown, "steps": steps, "end": {"mode": _mode(last.end_mode), "set": _set(end)}}


def write_certificate(motion: ProvenMotion, scene: Scene, digits: int, path: str | Path) -> None:
    """Write the file, whole or not at all."""
    write_tables(certificate(motion, scene, digits), path)


def write_tables(told: dict[str, Any], path: str | Path) -> None:
    """Write what is claimed as JSON, whole or not at all."""
    write_text(path, json.dumps(told, indent=1) + "\n")


def read_certificate(path: str | Path, formats: Collection[str] = (FORMAT,)) -> dict[str, Any]:
    """The tables of a file that has one of some formats.

    Raises
    ------
    NotACertificate
        If it is something else.
    """
    try:
        content = Path(path).read_bytes()
        told = json.loads(gzip.decompress(content) if Path(path).suffix == ".gz" else content)
    except (OSError, EOFError, ValueError) as error:
        raise NotACertificate(f"{path}: found {type(error).__name__}: {error}; expected a certificate of `stiction prove`") from None
    found = told.get("format") if isinstance(told, dict) else type(told).__name__
    if not isinstance(told, dict) or found not in formats:
        raise NotACertificate(f"{path}: format: found {found!r}; expected {' or '.join(map(repr, formats))}")
    return told


@dataclass(frozen=True)
class Failure:
    """A claim that was not proven again: number of the step (-1: of the whole) and why."""

    step: int
    reason: str


def check(told: dict[str, Any]) -> list[Failure]:
    """Prove every claim of a certificate anew; the failures, none if all hold.

    Raises
    ------
    NotACertificate
        Where the tables lack something.
    """
    try:
        precision = Precision(int(told["bits"]) + _MORE_BITS, int(told["order"]) + _MORE_ORDER, float("inf"))
        with working(precision.bits, precision.order + 1):
            return list(_failures(told, precision))
    except NotACertificate:
        raise
    except (KeyError, TypeError, IndexError, ValueError, ZeroDivisionError) as error:
        raise NotACertificate(f"found {type(error).__name__}: {error}; expected the tables of {FORMAT!r}") from error


def _failures(told: dict[str, Any], precision: Precision) -> Iterator[Failure]:
    mechanism = provable(scene_from_dict(tomllib.loads(told["file"]), told["scene"]))
    steps, ends = told["steps"], [*(step["start"] for step in told["steps"]), told["end"]["set"]]
    sets, targets = ([_read_set(claimed, read) for claimed in ends] for read in (read_ball, read_ball_within))
    shown = list(told["events"])
    modes = [*(_read_mode(step["mode"]) for step in steps), _read_mode(told["end"]["mode"])]
    first = mechanism.start()
    values = [*mechanism.q, *mechanism.v]
    inside = sets[0].frame.inv() * arb_mat([[x - c] for x, c in zip(values, sets[0].centre)])
    if not all(size.contains(inside[i, 0]) for i, size in enumerate(targets[0].size)):
        yield Failure(-1, "the start of the scene is not in the first set")
    if first.mode != modes[0] or read_number(steps[0]["t0"]) != 0:
        yield Failure(-1, f"the motion starts at 0 in mode {first.mode}, the first step at {steps[0]['t0']} in {modes[0]}")
    for i, step in enumerate(steps):
        t0, t1 = read_number(step["t0"]), read_number(steps[i + 1]["t0"]) if i + 1 < len(steps) else mechanism.t_end
        if not t0 < t1:
            yield Failure(i, "the step does not go forward")
            continue
        begin = first if i == 0 else Next(modes[i])
        try:
            again = take_step(mechanism, t0, sets[i], begin, 0.0, precision, t1)
        except (TooLong, Undecided) as error:
            yield Failure(i, str(error))
            continue
        claimed = [(e["kind"], _read_mode(e["after"])) for e in step["events"]]
        if claimed != [(e.kind, e.after) for e in again.events] or again.end_mode != modes[i + 1]:
            yield Failure(i, f"other changes of mode: {[(e.kind, e.after) for e in again.events]} instead of {claimed}")
        elif not all(read_ball_within(e["time"]).contains(own.time) for e, own in zip(step["events"], again.events)):
            yield Failure(i, "the time of an event is not within its interval")
        elif not again.start.image_lies_in(again.point, again.derivative, targets[i + 1]):
            yield Failure(i, "the image of the set is not within the next set")
        for own in again.events:
            if not shown or not _tells(shown.pop(0), own, mechanism):
                yield Failure(i, f"the list of events tells of a {own.kind} at {own.time.str(10)} s otherwise")
    state, (q, v) = told["state at t_end"], end_state(mechanism, sets[-1], modes[-1])
    if shown or not all(contains(state[name], value) for name, value in mechanism.columns(mechanism.t_end, q, v).items()):
        yield Failure(-1, "the list of events or the state at t_end tells something else than the steps")


def _tells(shown: dict[str, str], own: ProvenEvent, mechanism: ProvableMechanism) -> bool:
    """Whether what is told of an event in decimals contains what is proven of it."""
    return ((shown["kind"], shown["joint"]) == (own.kind, mechanism.event_joint(own.before, own.after)) and contains(shown["time [s]"], own.time)
            and all(contains(shown[name], value) for name, value in mechanism.columns(own.time, own.q, own.v).items()))


def end_state(mechanism: ProvableMechanism, end: StateSet, mode: Hashable) -> tuple[list[arb], list[arb]]:
    """q and v of a set at the end of a motion in a mode."""
    hull, n, held = end.hull(), len(mechanism.q), mechanism.held(mode)
    return hull[:n], [held.get(i, x) for i, x in enumerate(hull[n:])]
