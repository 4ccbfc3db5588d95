"""Coulomb friction for engines that only know a joint friction with an upper bound.

The engine holds the slider with a force of at most `cap` along its guide. This module sets the cap from the
guide's reactions, mu (|n1| + |n2|): with R the normal force, T the moment on the slider about its point, slider
length a and width b, friction of coefficient c that opposes motion in direction s (Zhuang & Wang 2014, Sect. 5,
reduced to one slider):

    n1 + n2 = R ,   n2 - n1 = (2/a) (T + (b/2) s c R) ,   |n1| + |n2| = max(|n1 + n2|, |n2 - n1|)

and |R| where the guide has no length. Reactions depend on the friction, so where stick and slip are decided
the step is repeated with the reactions it gave. `step_kernels` has the bound itself, compiled: an engine's step takes
some microseconds.
"""

from __future__ import annotations

from math import nan

import numpy as np

from stiction.engines.shared.momentum import MomentumBalance
from stiction.engines.shared.step_kernels import GUIDE, Attempts, Cap, Contacts, begin_contacts, finish_contacts
from stiction.reference_impl.compiled.kernel import link_kernels
from stiction.scenes import Scene

CAPPED = "Coulomb, bound mu (|n1| + |n2|) set by the adapter each step, held by the engine's joint friction"
CONTACT = "Coulomb at each contact (engine); the adapter switches between mu and mus"
_FIRST_STEPS = 4  # no step before them tells their reactions


class GuideFriction:
    """Findings of an engine's steps about frictional guides; empty arrays where there is none.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene):
        self._guides = np.zeros(len(scene.frictional_guides), GUIDE)
        for row, guide in zip(self._guides, scene.frictional_guides.values()):
            row["mu"], row["mus"], row["length"], row["width"] = (
                guide.kinetic_coefficient,
                guide.static_coefficient,
                guide.length or 0.0,
                guide.width or 0.0,
            )

    def begin(self) -> None:
        """Begin the first step, where the kernel of the engine's steps does not."""

    def modes(self) -> np.ndarray:
        """Per frictional guide: -1, 0, 1 (slip against, stick, slip along) in the last step."""
        return self._guides["mode"].copy()

    def modes_before(self) -> np.ndarray:
        """`modes` in the step before the last."""
        return self._guides["mode_before"].copy()

    def frictions(self) -> np.ndarray:
        """Per frictional guide: the force on the slider along the guide in the last step (N); NaN while it stuck."""
        return np.where(self._guides["stuck"], nan, self._guides["friction"])


class FrictionCap(GuideFriction):
    """Bound of friction in the steps of a mechanism with frictional guides.

    Stick is tried with the static coefficient, `passes` times from the same state so that cap and reactions
    agree; where it does not hold, the step is taken with the kinetic one. A guide that slips and keeps its direction
    takes one pass, with the reactions of the step before.

    Parameters
    ----------
    scene : Scene
    balance : MomentumBalance
        Of the scene.
    passes : int
        Attempts at an undecided step.
    capped : bool
        False: the engine finds the friction itself, and no guide is capped.

    Attributes
    ----------
    data : Cap
        For `stiction.engines.shared.step_kernels`.
    caps : callable
        Gives those of the coming attempt, a list of float (N).
    held : ndarray, shape (frictional,)
        To be set after each attempt: magnitudes of the frictions in it (N).
    """

    def __init__(self, scene: Scene, balance: MomentumBalance, passes: int, capped: bool = True):
        super().__init__(scene)
        if not capped:
            self._guides = self._guides[:0]
        caps, self.held = np.zeros((2, len(self._guides)))
        self.caps = caps.tolist  # as a method of ours it would take twice as long
        self.data = Cap(balance=balance.data, guides=self._guides, passes=passes,
                        attempts=np.array((0, _FIRST_STEPS), dtype=Attempts.structure()),
                        caps=caps, held=self.held)


class CoefficientSwitch(GuideFriction):
    """The coefficient for contacts of an engine that knows one: mus while stick is undecided, mu otherwise.

    Boxes without clearance do not touch at the start; until they have landed stick is undecided.

    Attributes
    ----------
    data : Contacts
        For `stiction.engines.shared.step_kernels`. Its `loads`, `frictions` and `slip_speeds` are to be set after each
        step, before `observe`.
    """

    def __init__(self, scene: Scene):
        super().__init__(scene)
        loads, frictions, slip_speeds = np.zeros((3, len(self._guides)))
        self.data = Contacts(guides=self._guides, loads=loads, frictions=frictions, slip_speeds=slip_speeds)
        self._coefficients = self._guides["coefficient"]

    def begin(self) -> None:
        """Begin the first step."""
        link_kernels(finish_contacts)
        begin_contacts(self.data)

    def coefficients(self) -> list[float]:
        """Per frictional guide, for the next step."""
        return self._coefficients.tolist()

    def observe(self) -> None:
        """Take in a step."""
        finish_contacts(self.data)
