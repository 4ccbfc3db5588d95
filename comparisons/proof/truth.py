"""A truth in floats whose motion and events are proven: their enclosures are its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb

from stiction.comparisons.proof.enclosures.exact import NotComparable
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.motion import ProvenMotion
from stiction.comparisons.proof.proving import TooWide, provable, prove_scene
from stiction.comparisons.truth.truth import PROVEN, NotThisMechanism, Truth
from stiction.scenes import Scene, StictionError, vary

_DIGITS = 16
_LONGEST = 250.0
"""Seconds of motion up to which a proof is asked for: some seconds of CPU."""
_ROUNDING = 2.0 ** -53


class Contradiction(StictionError, AssertionError):
    """A truth whose events are not those that are proven."""


def with_proof(scene: Scene, truth: Truth) -> Truth:
    """The truth with proven positions, velocities and events of its slider, tier "proven"; as it is where nothing can be proven.

    Raises
    ------
    Contradiction
        If the truth has other events.
    """
    if truth.t_end > _LONGEST:
        return truth
    asked = vary(scene, {"t_end": truth.t_end})
    try:
        with working(64, 2):
            if not isinstance(provable(asked), SlidingMass):
                return truth
        motion = prove_scene(asked, _DIGITS)
    except NotThisMechanism:
        return truth
    except (Undecided, TooWide, NotComparable) as error:
        return replace(truth, note=truth.note or f"no proof: {error}")
    return _proven(motion, truth)


@dataclass(frozen=True)
class _Floats:
    """Position and velocity as polynomials in floats.

    Attributes
    ----------
    starts, ends : ndarray, shape (legs,)
        Seconds.
    coefficients : ndarray, shape (legs, 2, order + 1)
        Of x and x', from the lowest.
    errors : ndarray, shape (2,)
        What they are off at most, evaluated in floats by Horner's rule (N. J. Higham, Accuracy and Stability of Numerical Algorithms,
        2002, sect. 5.1), the rounding of time included.
    """

    starts: np.ndarray
    ends: np.ndarray
    coefficients: np.ndarray
    errors: np.ndarray

    @classmethod
    def of(cls, motion: ProvenMotion) -> _Floats:
        starts, ends, coefficients, errors = [], [], [], np.zeros(2)
        t_end = float(motion.mechanism.t_end.upper())
        for step in motion.steps:
            for leg in step.legs:
                h, rows = leg.end.upper(), []
                for i, function in enumerate(leg.state):
                    terms = function.coeffs()
                    rows.append([float(c.mid()) for c in terms])
                    size = sum((abs(c) * h ** k for k, c in enumerate(terms)), arb(0))
                    off = sum((abs(c - float(c.mid())) * h ** k for k, c in enumerate(terms)), arb(0))
                    shift = abs(function.derivative()(arb(0).union(h))) * (4 * t_end * _ROUNDING + leg.t.rad())
                    errors[i] = max(errors[i], float((off + 2 * len(terms) * 1.01 * _ROUNDING * size + shift).upper()))
                starts.append(float(leg.t.mid()))
                ends.append(float((leg.t + leg.end).mid()))
                coefficients.append(rows)
        width = max(len(row) for rows in coefficients for row in rows)
        padded = [[row + [0.0] * (width - len(row)) for row in rows] for rows in coefficients]
        return cls(np.array(starts), np.array(ends), np.array(padded), errors)

    def __call__(self, t: np.ndarray, side: str) -> np.ndarray:
        """x and x' at times t, shape (2, n)."""
        owner = np.minimum(np.searchsorted(self.ends, t, side="right" if side == "after" else "left"), len(self.ends) - 1)
        tau, found = t - self.starts[owner], np.zeros((2, len(t)))
        for k in range(self.coefficients.shape[2] - 1, -1, -1):
            found = found * tau + self.coefficients[owner, :, k].T
        return found


def _proven(motion: ProvenMotion, truth: Truth) -> Truth:
    with working(motion.precision.bits, motion.precision.order + 1):
        events, floats = motion.events, _Floats.of(motion)
        times = [float(event.time.mid()) for event in events]
        width = max((float(event.time.rad()) for event in events), default=0.0) + _ROUNDING * truth.t_end
    if [event.kind for event in events] != [event.kind for event in truth.events]:
        raise Contradiction(f"{truth.scene}: found events {_kinds(truth.events)}; proven are {_kinds(events)}")
    names = motion.mechanism.names
    moved = {name: i for name in truth.uncertainty for i, own in enumerate(names)
             if name == own or name.rpartition(".")[2] == own.rpartition(".")[2] and _carried(name, truth, motion)}

    known = [event.time for event in truth.events]

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        at = t.copy()
        for time, own in zip(times, known):  # the truth tells the sides of an event apart at its own time for it
            at[t == time] = own
        found = dict(truth.columns(at, side))
        change = floats(t, side) - np.array([found[name] for name in names])
        return found | {name: found[name] + change[i] for name, i in moved.items()}

    sample = truth.columns(np.linspace(0.0, truth.t_end, 500), "after")
    proven = {name: float(floats.errors[i] + 4 * _ROUNDING * np.max(np.abs(sample[name]))) for name, i in moved.items()}
    return replace(truth, tier=PROVEN, columns=columns, uncertainty={**truth.uncertainty, **proven, "event time": width},
                   events=tuple(replace(event, time=time) for event, time in zip(truth.events, times)))


def _carried(name: str, truth: Truth, motion: ProvenMotion) -> bool:
    """Whether a body moves along with the slider: a bar that turns on it as its drive says."""
    return bool(motion.mechanism.c != 0) and name.rpartition(".")[0] not in ("", motion.mechanism.joint)


def _kinds(events: Sequence) -> str:
    return ", ".join(event.kind for event in events) or "none"
