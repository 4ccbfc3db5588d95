"""The theorem on the stick threshold as a file that can be checked again.

The file is JSON, its numbers as in `certificate`. Each of the two ends claims, of the scene with the exact amplitude F0: *B = {centre +
frame y : |y1|, |y2| <= radius} is mapped into itself by P, the motion over `count` common periods, with a factor of at most
`contraction`; the periodic motion that starts in it starts in `state`; no motion from B has other changes of mode than the listed ones; the
motion from the scene's start is in B after `periods` times so many periods.* What follows from that is in `threshold`.

`check` proves all of it anew with more bits, another order and shorter steps. It takes B from the file, and nothing that was computed with it. The
decimals have to contain what is proven, and the sentences of the theorem to be those of its tables.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from flint import arb, arb_mat

from stiction.comparisons.proof.certificate import (Failure, NotACertificate, contains, decimals, exact_text, read_ball,
                                                       read_ball_within, read_number, write_tables)
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.motion import Precision, StateSet
from stiction.comparisons.proof.threshold import NotProven, ProvenSteadyState, ProvenThreshold, at_amplitude, decimal, proven_on
from stiction.scenes import Scene, scene_from_dict, scene_to_toml

FORMAT = "stiction threshold proof 1"
_MORE_DIGITS = 6
_MOST_DIGITS = 1000
_SLACK = 1e-6
"""By how much a claimed factor is above the one that was found, relative: another proof finds another bound."""
_SHOWN = 16
ENDS = ("low", "high")


def threshold_certificate(found: ProvenThreshold, scene: Scene) -> dict[str, Any]:
    """What is claimed of a threshold, as the tables of a JSON file."""
    claimed = ProvenThreshold(_claimed(found.low), _claimed(found.high))
    return {"format": FORMAT, "scene": scene.name, "file": scene_to_toml(scene), "theorem": claimed.sentences(),
            **{name: _end(end) for name, end in zip(ENDS, (claimed.low, claimed.high))}}


def _claimed(end: ProvenSteadyState) -> ProvenSteadyState:
    """What is claimed of an end: somewhat less than was found, so that another proof of it finds as much."""
    with working(end.precision.bits, end.precision.order + 1):
        return replace(end, state=tuple(read_ball([exact_text(x.mid()), exact_text((2 * x.rad()).upper())]) for x in end.state),
                       contraction=end.contraction * (1 + _SLACK), events=tuple(replace(e, time=e.time.mid() + 2 * e.time.rad() * arb(0, 1)) for e in end.events))


def _end(end: ProvenSteadyState) -> dict[str, Any]:
    with working(end.precision.bits, end.precision.order + 1):
        return {"F0 [N]": f"{end.F0.numerator}/{end.F0.denominator}", "F0, decimal": decimal(end.F0), "stick phase": end.sticks,
                "digits": end.digits, "count": end.count, "centre": [exact_text(x) for x in end.states.centre],
                "frame": [[exact_text(x) for x in row] for row in end.states.frame.tolist()], "radius": exact_text(end.states.size[0].rad()),
                "state": [[exact_text(x.mid()), exact_text(x.rad())] for x in end.state],
                "state, decimal [m, m/s]": [decimals(x, _SHOWN) for x in end.state], "contraction": end.contraction, "periods": end.periods,
                "events": [{"kind": e.kind, "time [s]": decimals(e.time, _SHOWN)} for e in end.events]}


def write_threshold(found: ProvenThreshold, scene: Scene, path: str | Path) -> None:
    """Write the file, whole or not at all."""
    write_tables(threshold_certificate(found, scene), path)


def check_threshold(told: dict[str, Any]) -> list[Failure]:
    """Prove every claim of the theorem anew; the failures (0: of the lower end, 1: of the upper, -1: of the whole), none if all hold.

    Raises
    ------
    NotACertificate
        Where the tables lack something.
    """
    try:
        return list(_failures(told))
    except NotACertificate:
        raise
    except (KeyError, TypeError, IndexError, ValueError, ZeroDivisionError) as error:
        raise NotACertificate(f"found {type(error).__name__}: {error}; expected the tables of {FORMAT!r}") from error


def _failures(told: dict[str, Any]) -> Iterator[Failure]:
    scene = scene_from_dict(tomllib.loads(told["file"]), told["scene"])
    low, high = (Fraction(told[name]["F0 [N]"]) for name in ENDS)
    if not low < high or not told["low"]["stick phase"] or told["high"]["stick phase"]:
        yield Failure(-1, f"the ends are none: stick phase at {low} N: {told['low']['stick phase']}, at {high} N: {told['high']['stick phase']}")
    ends = []
    for number, (name, F0) in enumerate(zip(ENDS, (low, high))):
        found = _refuted(told[name], scene, F0)
        if isinstance(found, str):
            yield Failure(number, found)
        else:
            ends.append(found)
    if len(ends) == len(ENDS) and told["theorem"] != ProvenThreshold(*ends).sentences():
        yield Failure(-1, "the sentences of the theorem say something else than its tables")


def _refuted(end: dict[str, Any], scene: Scene, F0: Fraction) -> ProvenSteadyState | str:
    """What is claimed of an end, or why that is not proven again."""
    digits, count = int(end["digits"]), int(end["count"])
    if not (1 <= digits <= _MOST_DIGITS and count >= 1):
        raise NotACertificate(f"digits, count: found {digits}, {count}; expected 1 .. {_MOST_DIGITS} and at least 1")
    precision = Precision.of(digits + _MORE_DIGITS)
    with working(precision.bits, precision.order + 1):
        radius, frame = read_number(end["radius"]), arb_mat([[read_number(x) for x in row] for row in end["frame"]])
        states = StateSet(tuple(map(read_number, end["centre"])), frame, (radius * arb(0, 1),) * 2)
        try:
            again = proven_on(at_amplitude(scene, F0), F0, count, states, precision, digits)
        except (NotProven, Undecided) as error:
            return str(error)
        if again.sticks != end["stick phase"] or [e.kind for e in again.events] != [e["kind"] for e in end["events"]]:
            return f"other changes of mode: {', '.join(e.kind for e in again.events)}"
        if not again.contraction <= end["contraction"] < 1:
            return f"the factor of contraction: found at most {again.contraction:.6g}; claimed {end['contraction']:.6g}"
        if again.periods > end["periods"]:
            return f"the motion from the start is in the set after {again.periods} times the period; claimed {end['periods']}"
        if not all(read_ball_within(claimed).contains(own) for claimed, own in zip(end["state"], again.state, strict=True)):
            return "the state at t = 0 is not within the claimed one"
        shown = [*zip(end["state, decimal [m, m/s]"], again.state, strict=True), *((e["time [s]"], own.time) for e, own in zip(end["events"], again.events))]
        if end["F0, decimal"] != decimal(F0) or not all(contains(text, ball) for text, ball in shown):
            return "the decimals of F0, the state or the events do not contain what is proven"
        return replace(again, state=tuple(map(read_ball, end["state"])), contraction=end["contraction"], periods=end["periods"])
