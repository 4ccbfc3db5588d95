"""The theorem on the stick threshold as a certificate.

Each of the two ends claims, of the scene with the exact amplitude F0:
*B = {centre + frame y : |y1|, |y2| <= radius} is mapped into itself by P, the motion over `count` common periods, with
a factor of at most `contraction`; the periodic motion that starts in it starts in `state`; no motion from B has other
changes of mode than the listed ones; the motion from the scene's start is in B after `periods` times so many periods.*
What follows from that is in `threshold`.

The check proves all claims again with more bits, another order and shorter steps. It takes B from the file, and nothing
that was computed with it. The decimals have to contain the proven numbers, and the sentences of the theorem have to
follow from the tables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from flint import arb

from stiction.scenes import Scene
from stiction.truths.proof.certificate import (
    Claims,
    Failure,
    Format,
    NotACertificate,
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
from stiction.truths.proof.step import Precision, StateSet
from stiction.truths.proof.threshold import ProvenSteadyState, ProvenThreshold, decimal, proven_on

_MORE_DIGITS = 6
"""Number of additional digits with which a certificate is checked."""
_MOST_DIGITS = 1000
"""Largest number of digits of a certificate that is checked; more would take too long."""
_SLACK = 1e-6
"""Relative difference of a claimed factor and the one that was found, as another proof finds another bound."""
_SHOWN = 16
"""Number of digits of decimals for readers."""
ENDS = ("low", "high")
"""Names of the two ends in a certificate."""


def threshold_certificate(threshold: ProvenThreshold, scene: Scene) -> Claims:
    """Return the claims about a threshold."""
    claimed = ProvenThreshold(_claimed(threshold.low), _claimed(threshold.high))
    return {
        "format": FORMAT.name,
        "scene": scene.name,
        "file": scene.to_toml(),
        "theorem": claimed.sentences(),
        **{name: _end(end) for name, end in zip(ENDS, (claimed.low, claimed.high))},
    }


def _claimed(end: ProvenSteadyState) -> ProvenSteadyState:
    """Return an end with slightly weaker claims than were found, so that another proof confirms them."""
    with Precision.of(end.digits).working():
        # Double the radii, and increase the factor slightly.
        state = tuple(
            read_ball([exact_text(x.mid()), exact_text((2 * x.rad()).upper())]) for x in end.state
        )
        events = [replace(e, time=e.time.mid() + 2 * e.time.rad() * arb(0, 1)) for e in end.events]
        return replace(end, state=state, contraction=end.contraction * (1 + _SLACK), events=events)


def _end(end: ProvenSteadyState) -> Claims:
    """Return the claims about an end."""
    with Precision.of(end.digits).working():
        return {
            "F0 [N]": str(end.F0),
            "F0, decimal": decimal(end.F0),
            "stick phase": end.sticks,
            "digits": end.digits,
            "count": end.count,
            "centre": [exact_text(x) for x in end.states.centre],
            "frame": matrix_texts(end.states.frame),
            "radius": exact_text(end.states.size[0].rad()),
            "state": [ball_texts(x) for x in end.state],
            "state, decimal [m, m/s]": [decimals(x, _SHOWN) for x in end.state],
            "contraction": end.contraction,
            "periods": end.periods,
            "events": [{"kind": e.kind, "time [s]": decimals(e.time, _SHOWN)} for e in end.events],
        }


def _failures(claims: Claims) -> Iterator[Failure]:
    """Prove the claims of a certificate again, and yield the failures."""
    scene = claimed_scene(claims)
    low, high = (Fraction(claims[name]["F0 [N]"]) for name in ENDS)
    below, above = (claims[name]["stick phase"] for name in ENDS)
    if not low < high or not below or above:
        yield Failure(
            -1, f"the ends are none: stick phase at {low} N: {below}, at {high} N: {above}"
        )
    # Both ends anew, then the sentences that follow from them.
    ends = []
    for number, (name, F0) in enumerate(zip(ENDS, (low, high))):
        try:
            ends.append(_proven_again(claims[name], scene, F0))
        except NotProven as error:
            yield Failure(number, str(error))
    if len(ends) == len(ENDS) and claims["theorem"] != ProvenThreshold(*ends).sentences():
        yield Failure(-1, "the sentences of the theorem differ from its tables")


def _proven_again(end: Claims, scene: Scene, F0: Fraction) -> ProvenSteadyState:
    """Return the claims of an end after they are proven again; raise NotProven otherwise."""
    digits = int(end["digits"])
    count = int(end["count"])
    claimed = end["contraction"]
    if not (1 <= digits <= _MOST_DIGITS and count >= 1):
        raise NotACertificate(
            f"digits, count: found {digits}, {count}; expected 1 .. {_MOST_DIGITS} and at least 1"
        )
    with Precision.of(digits + _MORE_DIGITS).working():
        # B is taken from the file; everything else is proven again and compared with the claims.
        centre = tuple(map(read_number, end["centre"]))
        radius = read_number(end["radius"]) * arb(0, 1)
        states = StateSet(centre, read_matrix(end["frame"]), (radius,) * 2)
        again = proven_on(scene, F0, count, states, digits + _MORE_DIGITS)
        kinds = [event.kind for event in again.events]
        if again.sticks != end["stick phase"] or kinds != [
            event["kind"] for event in end["events"]
        ]:
            raise NotProven(f"other changes of mode: {', '.join(kinds)}")
        if not again.contraction <= claimed < 1:
            raise NotProven(
                f"the factor of contraction: found at most {again.contraction:.6g}; claimed {claimed:.6g}"
            )
        if again.periods > end["periods"]:
            raise NotProven(
                f"the motion from the start is in the set after {again.periods} times the period; "
                f"claimed {end['periods']}"
            )
        if not all(
            read_ball_within(ball).contains(own)
            for ball, own in zip(end["state"], again.state, strict=True)
        ):
            raise NotProven("the state at t = 0 is not within the claimed one")
        # The decimals for readers have to be true as well.
        shown = [
            *zip(end["state, decimal [m, m/s]"], again.state, strict=True),
            *((event["time [s]"], own.time) for event, own in zip(end["events"], again.events)),
        ]
        if end["F0, decimal"] != decimal(again.F0) or not all(
            contains(text, ball) for text, ball in shown
        ):
            raise NotProven(
                "the decimals of F0, the state or the events do not contain what is proven"
            )
        # The result has the claimed numbers, which the sentences of the theorem contain.
        return replace(
            again,
            state=tuple(map(read_ball, end["state"])),
            contraction=claimed,
            periods=end["periods"],
        )


FORMAT = Format("stiction threshold proof 1", "end", lambda claims: len(ENDS), _failures)
