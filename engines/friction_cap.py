"""Coulomb friction for engines that only know a joint friction with an upper bound.

The engine holds the slider with a force of at most `cap` along its guide. This module sets the cap from the
guide's reactions, mu (|n1| + |n2|): with R the normal force, T the moment on the slider about its point, slider
length a and width b, friction of coefficient c that opposes motion in direction s (Zhuang & Wang 2014, Sect. 5,
reduced to one slider):

    n1 + n2 = R ,   n2 - n1 = (2/a) (T + (b/2) s c R) ,   |n1| + |n2| = max(|n1 + n2|, |n2 - n1|)

and |R| where the guide has no length. Reactions depend on the friction, so where stick and slip are decided
the step is repeated with the reactions it gave.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, isfinite, nan

import numpy as np

from scenes import Scene

CAPPED = "Coulomb, bound mu (|n1| + |n2|) set by the adapter each step, held by the engine's joint friction"
CONTACT = "Coulomb at each contact (engine); the adapter switches between mu and mus"
_SATURATED = 1.0 - 1e-6  # of the cap: above the engines' solver residuals (1e-9), below any load that matters
_FIRST_STEPS = 4  # no step before them tells their reactions
_LOOK_AHEAD = 1.5  # a reversal is expected within this many steps at the last step's change of velocity


class FrictionStepper(ABC):
    """What an engine offers so that its friction can be capped."""

    @abstractmethod
    def advance(self, caps: Sequence[float]) -> np.ndarray:
        """Take one step with these caps (N); returns the magnitudes of the friction forces it held (N)."""

    @abstractmethod
    def retreat(self) -> None:
        """Return to the state before the last `advance`."""

    @abstractmethod
    def slip(self) -> np.ndarray:
        """Slip velocities of the frictional guides after the last `advance` (m/s)."""

    @abstractmethod
    def reactions(self, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reactions of the last `advance`: `engines.momentum.MomentumBalance.reactions`."""


@dataclass
class _Guide:
    """A frictional guide and what the last step told about it."""

    mu: float
    mus: float
    length: float | None
    width: float
    normal_force: float = 0.0
    moment: float = 0.0
    friction: float = 0.0
    slip: float = 0.0
    change: float = 0.0
    stuck: bool = False

    def undecided(self) -> bool:
        """Whether the next step may begin, end or contain stick."""
        return self.stuck or self.slip * (self.slip + _LOOK_AHEAD * self.change) <= 0.0

    @property
    def mode(self) -> int:
        return 0 if self.stuck else int(_sign(self.slip))

    def cap(self, coefficient: float) -> float:
        load = abs(self.normal_force)
        if self.length is not None:
            direction = -_sign(self.friction) if self.stuck else _sign(self.slip)
            surfaces = self.width / 2 * direction * coefficient * self.normal_force
            load = max(load, 2 / self.length * abs(self.moment + surfaces))
        return coefficient * load


def _guides(scene: Scene) -> list[_Guide]:
    return [_Guide(guide.mu, guide.static_coefficient, guide.length, guide.width or 0.0)
            for guide in scene.frictional_guides.values()]


class FrictionCap:
    """Steps a mechanism with frictional guides.

    Stick is tried with the static coefficient, `passes` times from the same state so that cap and reactions
    agree; where it does not hold, the step is taken with the kinetic one. A guide that slips and keeps its direction
    takes one pass, with the reactions of the step before.

    Parameters
    ----------
    scene : Scene
    passes : int
        Attempts at an undecided step.
    """

    def __init__(self, scene: Scene, passes: int):
        self._guides = _guides(scene)
        self._passes = passes
        self._first_steps = _FIRST_STEPS

    def step(self, stepper: FrictionStepper) -> None:
        """Take one step."""
        guides = self._guides
        before = [guide.slip for guide in guides]
        undecided = [guide.undecided() for guide in guides]
        passes = self._passes if any(undecided) or self._first_steps else 1
        self._first_steps = max(self._first_steps - 1, 0)
        coefficients = [guide.mus if open_ else guide.mu for guide, open_ in zip(guides, undecided)]
        for attempt in range(passes):
            if attempt:
                stepper.retreat()
            self._attempt(stepper, coefficients)
        kinetic = [c if guide.stuck else guide.mu for guide, c in zip(guides, coefficients)]
        if kinetic != coefficients:
            stepper.retreat()
            self._attempt(stepper, kinetic)
        for guide, slip in zip(guides, before):
            guide.change = guide.slip - slip

    def modes(self) -> np.ndarray:
        """Per frictional guide: -1, 0, 1 (slip against, stick, slip along) in the last step."""
        return np.array([guide.mode for guide in self._guides])

    def frictions(self) -> np.ndarray:
        """Per frictional guide: the force on the slider along the guide in the last step (N); NaN while it stuck."""
        return np.array([nan if guide.stuck else guide.friction for guide in self._guides])

    def _attempt(self, stepper: FrictionStepper, coefficients: Sequence[float]) -> None:
        caps = [guide.cap(c) for guide, c in zip(self._guides, coefficients)]
        if not all(map(isfinite, caps)):
            raise FloatingPointError("a reaction is not finite")
        held = stepper.advance(caps)
        slips = stepper.slip()
        for guide, cap, force, slip in zip(self._guides, caps, held, slips):
            guide.stuck, guide.slip = bool(force < cap * _SATURATED), float(slip)
        known = np.array([nan if guide.stuck else -_sign(guide.slip) * cap for guide, cap in zip(self._guides, caps)])
        for guide, normal, moment, friction in zip(self._guides, *stepper.reactions(known)):
            guide.normal_force, guide.moment, guide.friction = float(normal), float(moment), float(friction)


class CoefficientSwitch:
    """The coefficient for contacts of an engine that knows one: mus while stick is undecided, mu otherwise.

    Boxes without clearance do not touch at the start; until they have landed stick is undecided.
    """

    def __init__(self, scene: Scene):
        self._guides = _guides(scene)
        self._landed = [False] * len(self._guides)

    def coefficients(self) -> list[float]:
        """Per frictional guide, for the next step."""
        return [guide.mus if guide.undecided() else guide.mu for guide in self._guides]

    def observe(self, loads: Sequence[float], frictions: Sequence[float], slips: Sequence[float]) -> None:
        """Take in a step, per frictional guide.

        Parameters
        ----------
        loads, frictions
            Sums over the contacts of the largest possible and of the actual magnitude of friction (N).
        slips
            Slip velocities at the end of the step (m/s).
        """
        for i, (guide, load, friction, slip) in enumerate(zip(self._guides, loads, frictions, slips)):
            guide.stuck = bool(friction < load * _SATURATED) or not self._landed[i]
            self._landed[i] |= load > 0.0
            guide.change, guide.slip = float(slip) - guide.slip, float(slip)
            guide.friction = -_sign(guide.slip) * friction

    def modes(self) -> np.ndarray:
        """As `FrictionCap.modes`."""
        return np.array([guide.mode for guide in self._guides])

    def frictions(self) -> np.ndarray:
        """As `FrictionCap.frictions`."""
        return np.array([nan if guide.stuck else guide.friction for guide in self._guides])


def _sign(value: float) -> float:
    return copysign(1.0, value) if value else 0.0
