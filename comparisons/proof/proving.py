"""A scene's motion, proven to a number of digits."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, log10

from stiction.comparisons.proof.enclosures import NotProven
from stiction.comparisons.proof.mechanisms.mechanism import ProvableMechanism
from stiction.comparisons.proof.mechanisms.moving_guide import MovingGuide
from stiction.comparisons.proof.mechanisms.pendulum import Pendulum
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.mechanisms.trammel import Trammel
from stiction.comparisons.proof.motion import Precision, ProvenMotion, prove
from stiction.comparisons.truth.truth import NotThisMechanism
from stiction.scenes import Scene

MECHANISMS: Mapping[type[ProvableMechanism], float] = {SlidingMass: 250.0, MovingGuide: 20.0, Trammel: 20.0,
                                                       Pendulum: 250.0}
"""Seconds of motion up to which a truth gets a proof: of a mass or pendulum in seconds, else in up to half a minute."""
_ATTEMPTS = 4


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

    The numbers of the scene count as they are written; digits are decimal places, in m, rad, m/s, rad/s and s.

    Raises
    ------
    NotThisMechanism
        If the scene is none of the mechanisms.
    NotProven
        `Undecided` with the time; or where enclosures stay wider at every precision that is tried.
    """
    asked = digits
    for _ in range(_ATTEMPTS):
        precision = Precision.of(asked)
        with precision.working():
            motion = prove(provable(scene), precision)
            width = float(motion.width().upper())
        if width <= 10.0 ** -digits:
            return motion
        asked += ceil(log10(width) + digits) + 2
    raise NotProven(f"{scene.name}: found a width of {width:.2g} at {precision.bits} bits; expected 1e-{digits}")
