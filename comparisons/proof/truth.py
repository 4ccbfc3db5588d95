"""A truth in floats whose motion and events are proven: their enclosures are its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb

from stiction.comparisons.proof.enclosures.exact import NotComparable
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import ProvableMechanism
from stiction.comparisons.proof.mechanisms.moving_guide import MovingGuide
from stiction.comparisons.proof.mechanisms.pendulum import Pendulum
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.mechanisms.trammel import Trammel
from stiction.comparisons.proof.motion import ProvenMotion
from stiction.comparisons.proof.proving import TooWide, provable, prove_scene
from stiction.comparisons.proof.theorems import Contradiction
from stiction.comparisons.truth.truth import PROVEN, NotThisMechanism, Truth
from stiction.scenes import Scene, vary

_DIGITS = 14
_LONGEST: Mapping[type[ProvableMechanism], float] = {SlidingMass: 250.0, Pendulum: 250.0, MovingGuide: 20.0, Trammel: 20.0}
"""Seconds of motion up to which a proof is asked for: some seconds of CPU for the first two, up to half a minute for the others."""
_MOST_EVENTS = 300
"""Events up to which a proof is asked for: 637 of them take 20 s."""
_ROUNDING = 2.0 ** -53
_INSTANTS = 499
_ESTIMATED = 10.0
"""By how many times its estimated uncertainty a truth may be off what is proven: a wrong equation is off by more."""


def with_proof(scene: Scene, truth: Truth) -> Truth:
    """The truth with proven positions, velocities and events, tier "proven"; as it is where nothing can be proven.

    Raises
    ------
    Contradiction
        If the truth has other events, or columns that differ by more than they may.
    """
    asked = vary(scene, {"t_end": truth.t_end})
    try:
        with working(64, 2):
            longest = _LONGEST[type(provable(asked))]
        if truth.t_end > longest:
            return replace(truth, note=truth.note or f"no proof: none is asked for beyond {longest:g} s of such a motion")
        if len(truth.events) > _MOST_EVENTS:
            return replace(truth, note=truth.note or f"no proof: none is asked for of more than {_MOST_EVENTS} events")
        motion = prove_scene(asked, _DIGITS)
    except NotThisMechanism:
        return truth
    except (Undecided, TooWide, NotComparable) as error:
        return replace(truth, note=truth.note or f"no proof: {error}")
    return _proven(motion, truth)

_AT_ONCE = 1e-12
"""s; as of the columns' rounding of time."""


@dataclass(frozen=True)
class _Floats:
    """Columns as polynomials in floats.

    Attributes
    ----------
    names : tuple of str
        Of the columns.
    starts, ends : ndarray, shape (legs,)
        Seconds.
    coefficients : ndarray, shape (legs, columns, order + 1)
        From the lowest.
    errors : ndarray, shape (columns,)
        What they are off at most, evaluated in floats by Horner's rule (N. J. Higham, Accuracy and Stability of Numerical Algorithms,
        2002, sect. 5.1). Where a leg begins and ends is rounded too: next to an event the polynomial of the leg on its other side may be used, so
        that the rounding counts with the largest slope of both.
    """

    names: tuple[str, ...]
    starts: np.ndarray
    ends: np.ndarray
    coefficients: np.ndarray
    errors: np.ndarray

    @classmethod
    def of(cls, motion: ProvenMotion) -> _Floats:
        legs = [leg for step in motion.steps for leg in step.legs]
        starts, ends = np.array([float(leg.t.mid()) for leg in legs]), np.array([float((leg.t + leg.end).mid()) for leg in legs])
        names = tuple(legs[0].bodies)
        polynomials = [[leg.bodies[name].coeffs() for name in names] for leg in legs]
        coefficients = np.zeros((len(legs), len(names), max(len(terms) for row in polynomials for terms in row)))
        errors, slopes, shift = np.zeros(len(names)), np.zeros(len(names)), 0.0
        for i, (leg, row) in enumerate(zip(legs, polynomials)):
            h = leg.end.upper()
            shift = max(shift, _upper(abs(leg.t - starts[i])) + _upper(abs(leg.t + leg.end - ends[i])) + 2 * _ROUNDING * _upper(h))
            for j, (name, terms) in enumerate(zip(names, row)):
                coefficients[i, j, :len(terms)] = [float(c.mid()) for c in terms]
                size = sum((abs(c) * h ** k for k, c in enumerate(terms)), arb(0))
                off = sum((abs(c - value) * h ** k for k, (c, value) in enumerate(zip(terms, coefficients[i, j].tolist()))), arb(0))
                errors[j] = max(errors[j], _upper(off + 2 * len(terms) * 1.01 * _ROUNDING * size))
                slopes[j] = max(slopes[j], _upper(abs(leg.bodies[name].derivative()(arb(0).union(h)))))
        return cls(names, starts, ends, coefficients, (errors + 2 * slopes * shift) * (1 + 1e-9))

    def __call__(self, t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        """The columns at times t."""
        owner = np.minimum(np.searchsorted(self.ends, t, side="right" if side == "after" else "left"), len(self.ends) - 1)
        tau, found = t - self.starts[owner], np.zeros((len(self.names), len(t)))
        for k in range(self.coefficients.shape[2] - 1, -1, -1):
            found = found * tau + self.coefficients[owner, :, k].T
        return dict(zip(self.names, found))


def _upper(ball: arb) -> float:
    return float(ball.upper()) * (1 + 2 * _ROUNDING)


def _proven(motion: ProvenMotion, truth: Truth) -> Truth:
    with working(motion.precision.bits, motion.precision.order + 1):
        events, floats = _merged(motion.events), _Floats.of(motion)
        times = [float(event.time.mid()) for event in events]
        width = max((float(event.time.rad()) for event in events), default=0.0) + _ROUNDING * truth.t_end
    if [event.kind for event in events] != [event.kind for event in truth.events]:
        raise Contradiction(f"{truth.scene}: found events {_kinds(truth.events)}; proven are {_kinds(events)}")
    known = [event.time for event in truth.events]
    instants = np.linspace(0.0, truth.t_end, _INSTANTS)
    estimated, enclosed = truth.columns(instants, "after"), floats(instants, "after")
    for name, error in zip(floats.names, floats.errors):
        if name in truth.uncertainty:
            off, allowed = float(np.max(np.abs(estimated[name] - enclosed[name]))), _ESTIMATED * truth.uncertainty[name] + float(error)
            if not off <= allowed:
                raise Contradiction(f"{truth.scene}: {name}: found a truth {off:.2g} off what is proven; expected at most {allowed:.2g}")

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        at = t.copy()
        for time, own in zip(times, known):  # the truth tells the sides of an event apart at its own time for it
            at[t == time] = own
        found = truth.columns(at, side)
        return found | {name: values for name, values in floats(t, side).items() if name in found}

    proven = {name: float(error) for name, error in zip(floats.names, floats.errors) if name in truth.uncertainty}
    return replace(truth, tier=PROVEN, tier_below=truth.tier, columns=columns, uncertainty={**truth.uncertainty, **proven, "event time": width},
                   events=tuple(replace(event, time=time) for event, time in zip(truth.events, times)))


def _merged(events: Sequence) -> list:
    """The events, of corners that change their surface within `_AT_ONCE` the last: a proof tells apart what all else takes for one event."""
    kept: list = []
    for event in events:
        if kept and kept[-1].kind == event.kind == "corner" and not event.time - kept[-1].time > _AT_ONCE:
            kept.pop()
        kept.append(event)
    return kept


def _kinds(events: Sequence) -> str:
    return ", ".join(event.kind for event in events) or "none"
