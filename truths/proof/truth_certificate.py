"""Certificates of truths: proven motions as polynomials in floats, with proven bounds.

A file claims about its scene: *at every time t from 0 to ``t_end``, each column, evaluated in floats by Horner's rule
from the coefficients of the leg that contains t, differs from the exact motion by at most its error; the events are the
listed ones, each within ``event time`` of its time.* The check proves the motion again with more digits and therefore
with other steps, and compares the polynomials. `stiction.truths.proof.truth` reads the files without this module.

    python -m stiction.truths.proof.truth_certificate

makes the certificates of all scenes of the catalogue whose motion is proven, within some minutes, or those of scenes
that are named as arguments.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import product, takewhile
from math import ceil, log10

from flint import arb, arb_poly

from stiction.scenes import Scene, catalogue, load_scene
from stiction.truths.physics import physics_of, rubbing_joints
from stiction.truths.proof.certificate import (
    Claims,
    Failure,
    Format,
    NotACertificate,
    claimed_scene,
    write_certificate,
)
from stiction.truths.proof.enclosures import NotProven
from stiction.truths.proof.enclosures.series import working
from stiction.truths.proof.motion import (
    LONGEST_DURATIONS,
    ProvenMotion,
    provable_mechanism,
    prove_scene,
)
from stiction.truths.proof.step import ProvenEvent
from stiction.truths.proof.truth import DATA, SUFFIX, certificates, motion_digest
from stiction.truths.truth import NotThisMechanism

DIGITS = 14
"""Decimal places to which motions are proven: near the rounding of the floats in which they are stored."""
_MORE_DIGITS = 4
"""Number of additional digits with which a certificate is checked."""
_ROUNDING = 2.0**-53
"""Unit roundoff u of floats."""
_HORNER = 2.02
"""Bound of the factor of u per degree in Horner's rule, 2 / (1 - 2 n u), for every degree n in use."""
_SUMMED = 1 + 1e-9
"""Factor that covers the rounding of sums of bounds in floats."""
_ALL_DIGITS = 17
"""Decimal digits that determine a float."""
_HALF = 0.5
"""Ratio of a term to the negligible size below which the term is left out."""
_RATES = {"x": "vx", "y": "vy", "angle": "omega", "displacement": "slip_velocity"}
"""Label of the rate of each label of a column."""
_KEPT = 2.0**-55
"""Largest change of each term by rounding, relative to the size of the column, or of its derivative on short legs."""
_SLACK = 1.25
"""Ratio of the claimed errors to those that were found, because a proof with other steps finds other errors."""
_AT_ONCE = 1e-12
"""Time, s, within which corner events of a guide count as one event."""


def truth_certificate(scene: Scene) -> Claims:
    """Return the claims about a scene's motion; raise the errors of `prove_scene`."""
    motion = prove_scene(scene, DIGITS)
    text = scene.to_toml()
    with motion.precision.working():
        starts = [float(leg.t.mid()) for leg in motion.legs]
        # Legs between events whose times are equal in floats have no length, and are left out.
        legs = [
            leg
            for leg, start, end in zip(motion.legs, starts, [*starts[1:], scene.t_end])
            if start < end
        ]
        # A velocity is evaluated as the derivative of its position, and needs no coefficients.
        columns = legs[0].bodies
        derivatives = {}
        for name in columns:
            element, _, part = name.rpartition(".")
            rate = f"{element}.{_RATES.get(part)}"
            if rate in columns:
                derivatives[rate] = name
        claims = {
            "format": FORMAT.name,
            "scene": scene.name,
            "digest": motion_digest(text),
            "file": text,
            "digits": DIGITS,
            "t_end": scene.t_end,
            "starts": [float(leg.t.mid()) for leg in legs],
            "derivatives": derivatives,
            "coefficients": {
                name: [_floats(leg.bodies[name], _upper(leg.end)) for leg in legs]
                for name in columns
                if name not in derivatives
            },
        }
        # The errors are proven for the claims as they are written, with rounded coefficients.
        claims["errors"] = {name: error * _SLACK for name, error in _errors(claims, motion).items()}
        events = _events(motion, scene)
        claims["events"] = [[event.kind, event.joint, float(event.time.mid())] for event in events]
        width = max((_upper(event.time.rad()) for event in events), default=0.0)
        claims["event time"] = width * _SLACK + _ROUNDING * scene.t_end
        return claims


def _failures(claims: Claims) -> Iterator[Failure]:
    """Prove the claims of a certificate again, and yield the failures."""
    scene = claimed_scene(claims)
    claimed = claims["digest"], claims["t_end"]
    actual = motion_digest(claims["file"]), scene.t_end
    if claimed != actual:
        yield Failure(-1, f"digest and t_end: found {claimed}; the scene has {actual}")
        return
    try:
        motion = prove_scene(scene, int(claims["digits"]) + _MORE_DIGITS)
    except (NotProven, NotThisMechanism) as error:
        yield Failure(-1, str(error))
        return
    with motion.precision.working():
        for name, bound in _errors(claims, motion).items():
            if not bound <= claims["errors"][name]:
                yield Failure(
                    -1, f"{name}: off by up to {bound:.3g}; claimed {claims['errors'][name]:.3g}"
                )
        proven, listed, width = _events(motion, scene), claims["events"], claims["event time"]
        kinds = [(event.kind, event.joint) for event in proven]
        if kinds != [(kind, joint) for kind, joint, _ in listed]:
            yield Failure(-1, "other events")
        elif not all(abs(event.time - time) <= width for event, (*_, time) in zip(proven, listed)):
            yield Failure(-1, "the time of an event is not within its interval")


def _errors(claims: Claims, motion: ProvenMotion) -> dict[str, float]:
    """Return a bound for each column of the error of its evaluation in floats.

    On each stretch that a leg of the file has in common with one of the motion both polynomials are taken about the
    stretch's beginning: the size of their difference is at most that of its terms.
    """
    legs, starts = motion.legs, [*map(arb, claims["starts"]), motion.mechanism.t_end]
    coefficients, derivatives = claims["coefficients"], claims["derivatives"]
    if {*coefficients, *derivatives} != set(legs[0].bodies) or claims["starts"][0] != 0:
        raise NotACertificate("found other columns than the mechanism has, or no start at 0")
    first = 0
    rounding = dict.fromkeys(legs[0].bodies, 0.0)
    off = dict.fromkeys(legs[0].bodies, 0.0)
    for i, (start, end) in enumerate(zip(starts, starts[1:])):
        if not start < end:
            raise NotACertificate("found legs that do not go forward; expected increasing starts")
        # `first` is the first leg of the motion that reaches into this one of the file: both are in
        # order of time.
        while legs[first].t + legs[first].end < start:
            first += 1
        polynomials = {name: arb_poly(rows[i]) for name, rows in coefficients.items()}
        polynomials |= {name: polynomials[of].derivative() for name, of in derivatives.items()}
        for name, polynomial in polynomials.items():
            rounding[name] = max(rounding[name], _rounding(polynomial, _upper(end - start)))
            for leg in takewhile(lambda leg: not leg.t > end, legs[first:]):
                begin = leg.t if leg.t > start else start
                reach = max(min(_upper(leg.t + leg.end), _upper(end)) - float(begin.lower()), 0.0)
                exact = leg.bodies[name](arb_poly([begin - leg.t, 1]))
                stored = polynomial(arb_poly([begin - start, 1]))
                difference = sum(_terms(exact - stored, arb(reach)), arb(0))
                off[name] = max(off[name], _upper(difference))
    return {name: (rounding[name] + off[name]) * _SUMMED for name in off}


def _terms(polynomial: arb_poly, length: arb | float) -> list[arb]:
    """Return the sizes of the terms of a polynomial over a time (s)."""
    return [abs(c) * length**k for k, c in enumerate(polynomial.coeffs())]


def _rounding(polynomial: arb_poly, length: float) -> float:
    """Return a bound of the rounding of Horner's rule over a time (s), which includes that of the time itself.

    Source: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, sect. 5.1.
    """
    terms = _terms(polynomial, length)
    slope_times_length = sum((k * term for k, term in enumerate(terms)), arb(0))
    return _upper(
        _HORNER * _ROUNDING * ((len(terms) + 1) * sum(terms, arb(0)) + slope_times_length)
    )


def _events(motion: ProvenMotion, scene: Scene) -> list[ProvenEvent]:
    """Return the events that count; of corner events of a guide within `_AT_ONCE` only the last one."""
    kept: list[ProvenEvent] = []
    counted = rubbing_joints(scene)
    for event in motion.events:
        if event.joint not in counted:
            continue
        # Both corner forces of a guide pass zero together if its normal force does.
        is_same_event = (
            kept
            and kept[-1].kind == event.kind == "corner"
            and kept[-1].joint == event.joint
            and not event.time - kept[-1].time > _AT_ONCE
        )
        if is_same_event:
            kept.pop()
        kept.append(event)
    return kept


def _floats(polynomial: arb_poly, length: float) -> list[float]:
    """Return the coefficients of a polynomial over a time (s), rounded to the decimals that matter."""
    terms = [float(c.mid()) for c in polynomial.coeffs()]
    size = sum(abs(c) * length**k for k, c in enumerate(terms))
    negligible = _KEPT * min(length, 1.0) * size or 1.0
    kept = []
    for k, c in enumerate(terms):
        # A term that is 10^d times the negligible size needs d digits.
        share = abs(c) * length**k / negligible
        if share > _HALF:
            digits = min(max(ceil(log10(share)), 1), _ALL_DIGITS)
            kept.append(float(f"{c:.{digits}g}"))
        else:
            kept.append(0.0)
    while len(kept) > 1 and kept[-1] == 0.0:
        kept.pop()
    return kept or [0.0]


def _upper(ball: arb) -> float:
    """Return an upper bound in floats; `float` rounds to nearest, by one unit at most."""
    return float(ball.upper()) * (1 + 2 * _ROUNDING)


FORMAT = Format("stiction truth proof 1", "column", lambda claims: len(claims["errors"]), _failures)


def provable_scenes(names: Collection[str] = ()) -> Iterator[Scene]:
    """Yield the scenes of the catalogue whose motion can be proven, and their variants with mus = mu, each once."""
    seen = set()
    for name, static in product(names or catalogue(), (True, False)):
        scene = physics_of(load_scene(name), static)
        digest = motion_digest(scene.to_toml())
        with suppress(NotThisMechanism):
            with working(64, 2):
                mechanism = type(provable_mechanism(scene))
            if digest not in seen and scene.t_end <= LONGEST_DURATIONS[mechanism]:
                seen.add(digest)
                yield scene


def main(names: Sequence[str]) -> None:
    """Make the certificates of scenes, or of all scenes, in which case obsolete certificates are removed."""
    written = set()
    for scene in provable_scenes(names):
        try:
            claims = truth_certificate(scene)
        except NotProven as error:
            print(f"{scene.name}: not proven: {error}")
            continue
        path = DATA / f"truth-{claims['scene'].rpartition('/')[2]}.{claims['digest']}{SUFFIX}"
        write_certificate(claims, path)
        written.add(path.name)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)
    for file in [] if names else certificates():
        if file.name not in written:
            (DATA / file.name).unlink()
            print(f"{file.name}: removed")


if __name__ == "__main__":
    main(sys.argv[1:])
