"""Coulomb friction of guides in an engine's steps: a bound for its joints, or a coefficient for its contacts.

An engine whose joints have a friction with an upper bound holds the slider with a force of at most `cap` along its
guide. The cap is set from the guide's reactions, mu (|n1| + |n2|): with R the normal force, T the moment on the slider
about its point, slider length a and width b, and friction of coefficient c that opposes motion in direction s (Zhuang &
Wang 2014, Sect. 5, reduced to one slider), the normal forces n1 and n2 at its ends satisfy

    n1 + n2 = R ,   n2 - n1 = (2/a) (T + (b/2) s c R) ,   |n1| + |n2| = max(|n1 + n2|, |n2 - n1|)

For a guide without length, the sum is |R|. Reactions depend on the friction. Therefore a step that decides between
stick and slip is repeated with the reactions that it yielded. The arithmetic is compiled: `_set_caps` and `_judge` of
`step_kernels`.
"""

from __future__ import annotations

from collections.abc import Collection
from math import nan

import numpy as np

from stiction.engines.shared.step_kernels import (
    GUIDE,
    Attempts,
    Balance,
    Cap,
    begin_contacts,
    finish_contacts,
)
from stiction.reference_impl.compiled.kernel import link_kernels
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene
from stiction.scenes.model import Translational

CAPPED = "Coulomb, bound mu (|n1| + |n2|) set by the adapter each step, held by the engine's joint friction"
"""Setting `friction_law` of trajectories at joint fidelity."""
CONTACT = "Coulomb at each contact (engine); the adapter switches between mu and mus"
"""Setting `friction_law` of trajectories at contact fidelity."""
_FIRST_STEPS = 4
"""Number of first steps that get more passes (`step_kernels.FIRST_PASSES`): the first step has no reactions of a
previous step, and its error still affects the reactions of the next ones."""


class GuideFriction:
    """State of the frictional guides of a scene in an engine's steps.

    Attributes
    ----------
    guides : ndarray of `stiction.engines.shared.step_kernels.GUIDE`, shape (frictional,)
        The guides.
    """

    def __init__(self, guides: Collection[Translational]):
        # The records are zero at first. Therefore the very first pass is made without friction, and its
        # reactions determine the next cap.
        self.guides = np.zeros(len(guides), GUIDE)
        for record, guide in zip(self.guides, guides):
            record["mu"] = guide.kinetic_coefficient
            record["mus"] = guide.static_coefficient
            record["length"] = guide.length or 0.0
            record["width"] = guide.width or 0.0

    def begin(self) -> None:
        """Begin the first step, if the kernel of the engine's steps does not begin it."""

    def modes(self) -> np.ndarray:
        """Return the mode of each frictional guide in the last step: -1, 0, 1 (slip against, stick, slip along)."""
        return self.guides["mode"].copy()

    def modes_before(self) -> np.ndarray:
        """Return the mode of each frictional guide in the step before the last, see `modes`."""
        return self.guides["mode_before"].copy()

    def frictions(self) -> np.ndarray:
        """Return the force on each slider along its guide in the last step (N); NaN if it stuck."""
        return np.where(self.guides["stuck"], nan, self.guides["friction"])


class FrictionBound(GuideFriction):
    """Bound of friction in the steps of an engine, and the decision to repeat a step or to accept it.

    Stick is tried with the static coefficient, `passes` times from the same state so that cap and reactions agree. If
    it does not hold, the step is taken with the kinetic coefficient. A guide that slips and keeps its direction takes
    one pass, with the reactions of the step before. `step_kernels._set_caps` computes the bound, and the adapter's
    `advance` puts it into the engine; `step_kernels._judge` decides whether the step is repeated
    (`stiction.engines.shared.fixed_step.Stepper.step`).

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    passes : int
        Number of attempts at a step in which stick is undecided.
    capped : bool
        False if the engine computes the friction itself; then no guide has a cap.

    Attributes
    ----------
    balance : Balance
        The balance of the mechanism.
    initial : tuple of ndarray, each of shape (3 * bodies,)
        Coordinates and velocities at t = 0.
    data : Cap
        Argument of the kernels of `stiction.engines.shared.step_kernels`.
    caps : callable
        Returns a list of the bounds of the coming pass by guide (N).
    held : ndarray, shape (frictional,)
        Magnitudes of the frictions in a pass (N), which the adapter sets after it.
    """

    def __init__(self, mechanism: Mechanism, passes: int, capped: bool):
        scene = mechanism.scene
        super().__init__(scene.frictional_guides.values() if capped else ())
        self.balance = Balance.of(mechanism)
        # Views of the records, which the kernels read and write too.
        self.held = self.guides["held"]
        self.caps = self.guides["cap"].tolist
        self.initial = self.balance.q.copy(), self.balance.v.copy()
        self.data = Cap(
            balance=self.balance,
            guides=self.guides,
            passes=passes,
            attempts=np.array((0, _FIRST_STEPS), dtype=Attempts.structure()),
        )


class CoefficientSwitch(GuideFriction):
    """Coefficient for the contacts of an engine with one coefficient: mus while stick is undecided, mu otherwise.

    Boxes without clearance have no contact forces at the start. Until they have landed, stick is undecided.
    """

    def __init__(self, scene: Scene):
        super().__init__(scene.frictional_guides.values())
        self._coefficients = self.guides["coefficient"]

    def begin(self) -> None:
        """Begin the first step."""
        link_kernels(finish_contacts)
        begin_contacts(self.guides)

    def coefficients(self) -> list[float]:
        """Return the coefficient of each frictional guide for the next step."""
        return self._coefficients.tolist()
