"""Certificates of truths: proven motions as polynomials in floats, with proven bounds; `stiction.comparisons.proof.truth` reads them without this module.

A file claims, of the scene that it holds: *at every time t from 0 to ``t_end``, each column, evaluated in floats by Horner's rule from
the coefficients of the leg in which t lies, is off the exact motion by no more than its error; the events are the listed
ones, each within ``event time`` of its time.* `check` proves the motion anew with more digits, thus other steps, and compares the polynomials.

    python -m stiction.comparisons.proof.truth_certificate

makes those of all scenes of the catalogue whose motion is proven, some minutes; with names of scenes, those of these scenes.
"""

from __future__ import annotations

import gzip
import json
import sys
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import takewhile
from math import ceil, log10
from pathlib import Path
from typing import Any

from flint import arb, arb_poly

from stiction.comparisons.atomic_files import whole_file
from stiction.comparisons.measures.scene_truth import rubbing_guides
from stiction.comparisons.proof.certificate import Failure, NotACertificate
from stiction.comparisons.proof.enclosures.exact import NotComparable
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import ProvableMechanism
from stiction.comparisons.proof.mechanisms.moving_guide import MovingGuide
from stiction.comparisons.proof.mechanisms.pendulum import Pendulum
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.mechanisms.trammel import Trammel
from stiction.comparisons.proof.motion import Leg, ProvenMotion
from stiction.comparisons.proof.proving import TooWide, provable, prove_scene
from stiction.comparisons.proof.truth import DATA, FORMAT, SUFFIX, certificates, scene_digest
from stiction.comparisons.truth.truth import NotThisMechanism
from stiction.comparisons.variants import physics_of
from stiction.scenes import Scene, catalogue, load_scene, scene_from_dict, scene_to_toml

DIGITS = 14
_MORE_DIGITS = 4
LONGEST: Mapping[type[ProvableMechanism], float] = {SlidingMass: 250.0, Pendulum: 250.0, MovingGuide: 20.0, Trammel: 20.0}
"""Seconds of motion up to which a proof is made: some seconds of CPU for the first two, up to half a minute for the others."""
_ROUNDING = 2.0 ** -53
_RATES = {"x": "vx", "y": "vy", "angle": "omega", "displacement": "slip_velocity"}
_KEPT = 2.0 ** -55
"""Of a column's size: what is left out of each of its terms at most, per second where a leg is shorter than that, for the sake of its derivative."""
_SLACK = 1.25
"""By how many times the claimed errors are those found: another proof, with other steps, finds others."""
_AT_ONCE = 1e-12
"""s; a proof tells corners of one guide apart that all else takes for one event."""


def truth_certificate(scene: Scene, digits: int = DIGITS) -> dict[str, Any]:
    """What is claimed of a scene's motion, as the tables of a JSON file.

    Raises
    ------
    NotThisMechanism, Undecided, TooWide, NotComparable
        Where nothing is proven, see `prove_scene`.
    """
    motion = prove_scene(scene, digits)
    with working(motion.precision.bits, motion.precision.order + 1):
        legs = _legs(motion)
        starts = [float(leg.t.mid()) for leg in legs]
        legs = [leg for leg, start, end in zip(legs, starts, [*starts[1:], scene.t_end]) if start < end]  # not those between events that floats do not tell apart
        told = {"format": FORMAT, "scene": scene.name, "digest": scene_digest(scene_to_toml(scene)), "file": scene_to_toml(scene), "digits": digits,
                "t_end": scene.t_end, "starts": [float(leg.t.mid()) for leg in legs], "derivatives": (derivatives := _derivatives(legs[0].bodies)),
                "coefficients": {name: [_floats(leg.bodies[name], _upper(leg.end)) for leg in legs] for name in legs[0].bodies if name not in derivatives}}
        told["errors"] = {name: error * _SLACK for name, error in _errors(told, motion).items()}
        events = _events(motion, scene)
        told["events"] = [[kind, joint, float(time.mid())] for kind, joint, time in events]
        told["event time"] = max((_upper(time.rad()) for _, _, time in events), default=0.0) * _SLACK + _ROUNDING * scene.t_end
        return told


def check(told: dict[str, Any]) -> list[Failure]:
    """Prove the motion anew, and every claim with it; the failures, none if all hold.

    Raises
    ------
    NotACertificate
        Where the tables lack something.
    """
    try:
        scene = scene_from_dict(tomllib.loads(told["file"]), told["scene"])
        if told["digest"] != scene_digest(told["file"]) or told["t_end"] != scene.t_end:
            return [Failure(-1, f"digest and t_end: found {told['digest']}, {told['t_end']:g} s; the scene has {scene_digest(told['file'])}, {scene.t_end:g} s")]
        motion = prove_scene(scene, int(told["digits"]) + _MORE_DIGITS)
        with working(motion.precision.bits, motion.precision.order + 1):
            return list(_failures(told, motion, scene))
    except (Undecided, TooWide, NotComparable, NotThisMechanism) as error:
        return [Failure(-1, str(error))]
    except (KeyError, TypeError, IndexError, ValueError) as error:
        raise NotACertificate(f"found {type(error).__name__}: {error}; expected the tables of {FORMAT!r}") from error


def _failures(told: dict[str, Any], motion: ProvenMotion, scene: Scene) -> Iterator[Failure]:
    for name, error in _errors(told, motion).items():
        if not error <= told["errors"][name]:
            yield Failure(-1, f"{name}: off by up to {error:.3g}; claimed {told['errors'][name]:.3g}")
    events, width = _events(motion, scene), told["event time"]
    if [(kind, joint) for kind, joint, _ in events] != [tuple(event[:2]) for event in told["events"]]:
        yield Failure(-1, "other events")
    elif not all(abs(time - claimed[2]) <= width for (_, _, time), claimed in zip(events, told["events"])):
        yield Failure(-1, "the time of an event is not within its interval")


def _errors(told: Mapping[str, Any], motion: ProvenMotion) -> dict[str, float]:
    """By column, a bound of what its evaluation in floats is off the motion.

    On each stretch that a leg of the file has in common with one of the motion both polynomials are taken about the stretch's beginning: the size
    of their difference is at most that of its terms. To it comes the rounding of Horner's rule (N. J. Higham, Accuracy and Stability of
    Numerical Algorithms, 2002, sect. 5.1) and of the time since the start of the leg.
    """
    legs, starts, told_columns = _legs(motion), [*map(arb, told["starts"]), motion.mechanism.t_end], told["coefficients"]
    derivatives = told["derivatives"]
    if {*told_columns, *derivatives} != set(legs[0].bodies) or told["starts"][0] != 0:
        raise NotACertificate("found other columns than the mechanism has, or no start at 0")
    first, rounding, off = 0, dict.fromkeys(legs[0].bodies, 0.0), dict.fromkeys(legs[0].bodies, 0.0)
    for i, (start, end) in enumerate(zip(starts, starts[1:])):
        if not start < end:
            raise NotACertificate("found legs that do not go forward; expected increasing starts")
        length = _upper(end - start)
        polynomials = {name: arb_poly(rows[i]) for name, rows in told_columns.items()}
        polynomials |= {name: polynomials[of].derivative() for name, of in derivatives.items()}
        for name, polynomial in polynomials.items():
            terms = [abs(c) * length ** k for k, c in enumerate(polynomial.coeffs())]
            slope = sum((k * term for k, term in enumerate(terms)), arb(0))  # times the length
            rounding[name] = max(rounding[name], _upper(2.02 * _ROUNDING * ((len(terms) + 1) * sum(terms, arb(0)) + slope)))
        while legs[first].t + legs[first].end < start:
            first += 1
        for leg in takewhile(lambda leg: not leg.t > end, legs[first:]):
            begin = leg.t if leg.t > start else start
            reach = max(min(_upper(leg.t + leg.end), _upper(end)) - float(begin.lower()), 0.0)
            for name, polynomial in polynomials.items():
                shifted = leg.bodies[name](arb_poly([begin - leg.t, 1])) - polynomial(arb_poly([begin - start, 1]))
                size = sum((abs(c) * arb(reach) ** k for k, c in enumerate(shifted.coeffs())), arb(0))
                off[name] = max(off[name], _upper(size))
    return {name: (rounding[name] + off[name]) * (1 + 1e-9) for name in off}


def _derivatives(columns: Collection[str]) -> dict[str, str]:
    """The columns that are rates of others."""
    parts = {name: name.rpartition(".") for name in columns}
    found = {f"{element}.{_RATES[part]}": name for name, (element, _, part) in parts.items() if part in _RATES}
    return {rate: name for rate, name in found.items() if rate in parts}


def _legs(motion: ProvenMotion) -> list[Leg]:
    return [leg for step in motion.steps for leg in step.legs]


def _events(motion: ProvenMotion, scene: Scene) -> list[tuple[str, str, arb]]:
    """Kind, joint and time of the events that count; of corners of a guide within `_AT_ONCE` the last."""
    kept: list[tuple[str, str, arb]] = []
    counted = rubbing_guides(scene)
    for event in motion.events:
        joint = motion.mechanism.event_joint(event.before, event.after)
        if joint not in counted:
            continue
        if kept and kept[-1][:2] == (event.kind, joint) == ("corner", joint) and not event.time - kept[-1][2] > _AT_ONCE:
            kept.pop()
        kept.append((event.kind, joint, event.time))
    return kept


def _floats(polynomial: arb_poly, length: float) -> list[float]:
    """Coefficients with no more decimals than count."""
    terms = [float(c.mid()) for c in polynomial.coeffs()]
    size = sum(abs(c) * length ** k for k, c in enumerate(terms))
    kept = []
    for k, c in enumerate(terms):
        share = abs(c) * length ** k / (_KEPT * min(length, 1.0) * size or 1.0)
        kept.append(float(f"{c:.{min(max(ceil(log10(share)), 1), 17)}g}") if share > 0.5 else 0.0)
    while len(kept) > 1 and kept[-1] == 0.0:
        kept.pop()
    return kept or [0.0]


def _upper(ball: arb) -> float:
    return float(ball.upper()) * (1 + 2 * _ROUNDING)


def provable_scenes(names: Collection[str] = ()) -> Iterator[Scene]:
    """Scenes of the catalogue, and the same with mus = mu, that are mechanisms whose motion can be proven, each once."""
    seen = set()
    for name in names or catalogue():
        for static in (True, False):
            scene = physics_of(load_scene(name), static)
            digest = scene_digest(scene_to_toml(scene))
            try:
                with working(64, 2):
                    if digest in seen or scene.t_end > LONGEST[type(provable(scene))]:
                        continue
            except NotThisMechanism:
                continue
            seen.add(digest)
            yield scene


def write_certificate(told: dict[str, Any], folder: Path) -> Path:
    """Write the file, whole or not at all, in place of one of the same scene."""
    path = folder / f"truth-{told['scene'].rpartition('/')[2]}.{told['digest']}{SUFFIX}"
    with whole_file(path) as partial:
        partial.write_bytes(gzip.compress(json.dumps(told, separators=(",", ":")).encode(), mtime=0))
    return path


def main(names: Sequence[str]) -> None:
    """Make the certificates; without names, those that are of no scene any more are removed."""
    written = set()
    for scene in provable_scenes(names):
        try:
            path = write_certificate(truth_certificate(scene), DATA)
        except (Undecided, TooWide, NotComparable) as error:
            print(f"{scene.name}: not proven: {error}")
            continue
        written.add(path.name)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)
    for file in [] if names else certificates():
        if file.name not in written:
            (DATA / file.name).unlink()
            print(f"{file.name}: removed")


if __name__ == "__main__":
    main(sys.argv[1:])
