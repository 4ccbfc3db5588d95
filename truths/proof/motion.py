"""Enclose the motion of a scene from t = 0 to its end, to a number of digits."""

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

LONGEST_DURATIONS: Mapping[type[ProvableMechanism], float] = {
    SlidingMass: 250.0,
    MovingGuide: 20.0,
    Trammel: 20.0,
    Pendulum: 250.0,
}
"""Mechanisms whose motion can be proven, and the longest motion of each that gets a truth, s.

The proof of a mass or pendulum of such a duration takes seconds, that of the others up to half a
minute."""
_ATTEMPTS = 4
"""Precisions that are tried: each is chosen by the width that the one before left."""
_MORE_DIGITS = 2
"""Digits of reserve in the next attempt."""
_LONGEST = 0.5
"""Longest step, s."""
_FIRST_FRACTION = 1 / 4
"""Length of the first step, as a part of the longest."""
_SHRINK = 0.7
"""Factor of a step that is repeated because it has failed."""
_MAX_GROWTH = 1.5
"""Largest factor from one step to the next."""
_SAFETY = 0.9
"""Factor of a step below the length at which its remainder would be the largest allowed."""
_SHORT_UNDECIDED = 1e-2
"""Length of a step, s, below which events that it leaves undecided are reported.

Shorter steps rarely decide them."""
_TINY = 1e-300
"""Number that replaces a remainder of zero, as a divisor."""


@dataclass(frozen=True)
class ProvenMotion:
    """A motion, as the steps that enclose it.

    Its balls keep their width only at the precision with which they were made.

    Attributes
    ----------
    mechanism : ProvableMechanism
        What moves.
    precision : Precision
        Bits of the balls, and order and remainder of the steps.
    steps : tuple of Step
        The steps, in the order of time.
    end : StateSet
        The states at the end of the last step.
    """

    mechanism: ProvableMechanism
    precision: Precision
    steps: tuple[Step, ...]
    end: StateSet

    @property
    def events(self) -> list[ProvenEvent]:
        """The events of all steps, in the order of time."""
        return [event for step in self.steps for event in step.events]

    @property
    def legs(self) -> list[Leg]:
        """The legs of all steps, in the order of time."""
        return [leg for step in self.steps for leg in step.legs]

    def at(self, t: arb) -> tuple[list[arb], list[arb]]:
        """Return q and v at an instant.

        Next to an event or the end of a step they are the hull of both sides. Raises ValueError for
        a time that is not within the motion.
        """
        # a leg counts unless it is proven to lie elsewhere: next to an event there are two
        around = [leg for leg in self.legs if not (t - leg.t < 0 or t - leg.t > leg.end)]
        if not around:
            t_end = self.mechanism.t_end.str(10)
            raise ValueError(f"t: found {t.str(10)} s; expected times within 0 .. {t_end} s")
        hull, *others = ([series(t - leg.t) for series in leg.state] for leg in around)
        for other in others:
            hull = [ball.union(component) for ball, component in zip(hull, other)]
        return halves(hull)

    def derivative(self) -> arb_mat:
        """Return the derivative of the end state by the start, on the set of starts."""
        total = identity(len(self.end.centre))
        for step in self.steps:
            total = step.derivative * total
        return total

    def width(self) -> arb:
        """Return the largest width of states at the ends of steps and of times of events."""
        sets = [*(step.start for step in self.steps), self.end]
        enclosures = [ball for states in sets for ball in states.hull()]
        enclosures += [event.time for event in self.events]
        return max((2 * ball.rad() for ball in enclosures), key=lambda width: float(width.upper()))


def prove(
    mechanism: ProvableMechanism, precision: Precision, start: StateSet | None = None
) -> ProvenMotion:
    """Enclose the motion from t = 0 to its end, within `Precision.working`.

    Parameters
    ----------
    mechanism : ProvableMechanism
        The mechanism, its numbers at the working precision.
    precision : Precision
        Bits of the balls, and order and remainder of the steps.
    start : StateSet, optional
        States at t = 0; the motion is enclosed from all of them. By default, the mechanism's start.

    Raises
    ------
    Undecided
        With the time and the reason, if the course of events is not proven.
    """
    states = StateSet.box([*mechanism.q, *mechanism.v]) if start is None else start
    t = arb(0)
    current = mechanism.start()
    h = _LONGEST * _FIRST_FRACTION
    steps = []
    # The comparison of balls is true only if it holds for all their numbers. The last step ends at
    # the ball t_end itself: the two overlap then, and the loop ends.
    while t < mechanism.t_end:
        # A shorter step has narrower enclosures, which may decide what a longer one leaves open.
        try:
            step = take_step(mechanism, t, states, current, h, precision)
        except (TooLong, Undecided) as error:
            h *= _SHRINK
            if isinstance(error, Undecided) and h < _SHORT_UNDECIDED:
                raise
            if h < SHORTEST:
                raise Undecided(str(error), t) from error
            continue
        steps.append(step)
        states = states.image(step.point, step.derivative, precision.margin)
        t = step.t1
        current = step.current
        # The remainder is proportional to h^order: the next step has the length that makes its
        # remainder the largest allowed.
        ratio = precision.remainder / max(step.remainder, _TINY)
        growth = _SAFETY * ratio ** (1 / precision.order)
        h = min(_LONGEST, h * min(_MAX_GROWTH, growth))
    return ProvenMotion(mechanism, precision, tuple(steps), states)


def provable_mechanism(scene: Scene) -> ProvableMechanism:
    """Return a scene as a mechanism whose motion can be proven.

    Its numbers have the working precision. Raises NotThisMechanism, with what keeps the scene from
    being each of the mechanisms.
    """
    reasons = []
    for mechanism in LONGEST_DURATIONS:
        try:
            return mechanism.from_scene(scene)
        except NotThisMechanism as error:
            reasons.append(str(error))
    raise NotThisMechanism("\n".join(reasons))


def prove_scene(scene: Scene, digits: int) -> ProvenMotion:
    """Enclose the motion of a scene to a width of 10^-digits.

    This is the width of positions and velocities at the ends of steps, and of the times of events.
    The numbers of the scene count as they are written.

    Parameters
    ----------
    scene : Scene
        The scene.
    digits : int
        Decimal places, in m, rad, m/s, rad/s and s.

    Raises
    ------
    NotThisMechanism
        If the scene is none of the mechanisms that can be proven.
    Undecided
        With the time, if the course of events is not proven.
    NotProven
        If the enclosures are wider at every precision that is tried.
    """
    # How much a motion widens its balls is known only once it is enclosed: the next attempt has as
    # many more digits as were lost in the one before.
    digits_tried = digits
    for _ in range(_ATTEMPTS):
        precision = Precision.of(digits_tried)
        with precision.working():
            motion = prove(provable_mechanism(scene), precision)
            width = float(motion.width().upper())
        if width <= 10.0**-digits:
            return motion
        digits_lost = ceil(log10(width) + digits)
        digits_tried += digits_lost + _MORE_DIGITS
    raise NotProven(
        f"{scene.name}: found a width of {width:.2g} at {precision.bits} bits; expected 1e-{digits}"
    )
