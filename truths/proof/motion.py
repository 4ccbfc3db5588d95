"""The motion of a scene from t = 0 to its end, enclosed to a number of digits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, log10

from flint import arb, arb_mat

from stiction.scenes import Scene
from stiction.truths.proof.enclosures import NotProven
from stiction.truths.proof.enclosures.series import TooLong, halves, identity
from stiction.truths.proof.enclosures.zeros import Undecided
from stiction.truths.proof.mechanisms.mechanism import ProvableMechanism
from stiction.truths.proof.mechanisms.moving_guide import MovingGuide
from stiction.truths.proof.mechanisms.pendulum import Pendulum
from stiction.truths.proof.mechanisms.sliding_mass import SlidingMass
from stiction.truths.proof.mechanisms.trammel import Trammel
from stiction.truths.proof.step import (
    SHORTEST,
    Leg,
    Precision,
    ProvenEvent,
    StateSet,
    Step,
    take_step,
)
from stiction.truths.truth import NotThisMechanism

MECHANISMS: Mapping[type[ProvableMechanism], float] = {
    SlidingMass: 250.0,
    MovingGuide: 20.0,
    Trammel: 20.0,
    Pendulum: 250.0,
}
"""Seconds of motion up to which a truth gets a proof: of a mass or pendulum in seconds, else in up to half a minute."""
_ATTEMPTS = 4
"""Precisions that are tried: each is chosen by what the one before left open."""
_MORE_DIGITS = 2
"""Digits of reserve in the next attempt."""
_LONGEST = 0.5
"""Longest step, s."""
_FIRST = 1 / 4
"""Part of it with which a motion starts."""
_SHORTER, _LONGER, _SAFETY = 0.7, 1.5, 0.9
"""Factors of a step: after a failure, at most after a success, and below what the remainder allows."""
_OPEN = 1e-2
"""s; in a step shorter than this an open course of events is reported: shorter ones rarely settle it."""
_TINY = 1e-300
"""In place of a remainder of zero."""


@dataclass(frozen=True)
class ProvenMotion:
    """A motion by its steps; its balls keep their width only at the precision of their making."""

    mechanism: ProvableMechanism
    precision: Precision
    steps: tuple[Step, ...]
    end: StateSet

    @property
    def events(self) -> list[ProvenEvent]:
        return [event for step in self.steps for event in step.events]

    @property
    def legs(self) -> list[Leg]:
        return [leg for step in self.steps for leg in step.legs]

    def at(self, t: arb) -> tuple[list[arb], list[arb]]:
        """q and v at an instant; next to an event or the end of a step the hull of both sides.

        Raises ValueError for a time that is not within the motion.
        """
        # legs of which it is not proven that they lie elsewhere: two next to an event
        around = [leg for leg in self.legs if not (t - leg.t < 0 or t - leg.t > leg.end)]
        if not around:
            raise ValueError(
                f"t: found {t.str(10)} s; expected times within 0 .. {self.mechanism.t_end.str(10)} s"
            )
        hull, *others = ([f(t - leg.t) for f in leg.state] for leg in around)
        for other in others:
            hull = [ball.union(component) for ball, component in zip(hull, other)]
        return halves(hull)

    def derivative(self) -> arb_mat:
        """Derivative of the end state by the start, on the set of starts."""
        total = identity(len(self.end.centre))
        for step in self.steps:
            total = step.derivative * total
        return total

    def width(self) -> arb:
        """The largest width of position and velocity at the ends of steps and of the times of events."""
        sets = [*(step.start for step in self.steps), self.end]
        enclosures = [x for states in sets for x in states.hull()]
        enclosures += [event.time for event in self.events]
        return max((2 * ball.rad() for ball in enclosures), key=lambda width: float(width.upper()))


def prove(
    mechanism: ProvableMechanism, precision: Precision, start: StateSet | None = None
) -> ProvenMotion:
    """Enclose the motion from t = 0 to its end; from all states of `start` where that is given.

    Call it with `Precision.working`. Raises Undecided, with the time and the reason.
    """
    states = StateSet.box([*mechanism.q, *mechanism.v]) if start is None else start
    t, current = arb(0), mechanism.start()
    h, steps = _LONGEST * _FIRST, []
    while t < mechanism.t_end:
        # A shorter step has narrower enclosures, which may decide what a longer one leaves open.
        try:
            step = take_step(mechanism, t, states, current, h, precision)
        except (TooLong, Undecided) as error:
            h *= _SHORTER
            if isinstance(error, Undecided) and h < _OPEN:
                raise
            if h < SHORTEST:
                raise Undecided(str(error), t) from error
            continue
        steps.append(step)
        states = states.image(step.point, step.derivative, precision.margin)
        t, current = step.t1, step.current
        # The remainder is proportional to h^order: the next step is as long as makes its remainder
        # the largest allowed.
        ratio = precision.remainder / max(step.remainder, _TINY)
        growth = _SAFETY * ratio ** (1 / precision.order)
        h = min(_LONGEST, h * min(_LONGER, growth))
    return ProvenMotion(mechanism, precision, tuple(steps), states)


def provable(scene: Scene) -> ProvableMechanism:
    """The scene as a mechanism whose motion can be proven, its numbers at the working precision.

    Raises NotThisMechanism, with what keeps it from being each of them.
    """
    reasons = []
    for mechanism in MECHANISMS:
        try:
            return mechanism.from_scene(scene)
        except NotThisMechanism as error:
            reasons.append(str(error))
    raise NotThisMechanism("\n".join(reasons))


def prove_scene(scene: Scene, digits: int) -> ProvenMotion:
    """Enclose a scene's motion: positions and velocities (at the ends of steps) and times of events to 10^-digits.

    The numbers of the scene count as they are written; digits are decimal places, in m, rad, m/s, rad/s and s. Raises
    NotThisMechanism if the scene is none of the mechanisms, and `Undecided` with the time. NotProven is raised where
    enclosures stay wider at every precision that is tried.
    """
    # How much wider than its balls a motion becomes is not known before it is enclosed: digits are
    # added by what lacked.
    digits_tried = digits
    for _ in range(_ATTEMPTS):
        precision = Precision.of(digits_tried)
        with precision.working():
            motion = prove(provable(scene), precision)
            width = float(motion.width().upper())
        if width <= 10.0**-digits:
            return motion
        digits_tried += ceil(log10(width) + digits) + _MORE_DIGITS
    raise NotProven(
        f"{scene.name}: found a width of {width:.2g} at {precision.bits} bits; expected 1e-{digits}"
    )
