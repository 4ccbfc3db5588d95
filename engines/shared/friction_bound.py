"""Coulomb friction in an engine's steps: a bound for its joints, or a coefficient for its contacts.

An engine whose joints have a friction with an upper bound holds the slider with a force of at most `cap` along its
guide. The cap is set from the guide's reactions, mu (|n1| + |n2|): with R the normal force, T the moment on the slider
about its point, slider length a and width b, friction of coefficient c that opposes motion in direction s (Zhuang &
Wang 2014, Sect. 5, reduced to one slider):

    n1 + n2 = R ,   n2 - n1 = (2/a) (T + (b/2) s c R) ,   |n1| + |n2| = max(|n1 + n2|, |n2 - n1|)

and |R| where the guide has no length. Reactions depend on the friction. Therefore a step in which stick and slip are
decided is repeated with the reactions that it gave. The arithmetic is compiled: `_set_caps` and `_judge` of
`step_kernels`.

A constant bound, of a guide or a pin, is added to the cap. A joint with nothing else has the same cap in every step: it
is a parameter of the engine's own friction, which then decides between stick and slip itself, and no step is repeated.
If the bound at rest is larger, the adapter switches between both as it does between mus and mu.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
from stiction.scenes.model import Joint, Translational

CAPPED = "Coulomb, bound mu (|n1| + |n2|) set by the adapter each step, held by the engine's joint friction"
CONSTANT = "Coulomb with a constant bound, the engine's own joint friction (engine)"
CONSTANT_SWITCHED = (
    "Coulomb with constant bounds, the engine's own joint friction; the adapter switches between the bounds at rest "
    "and in slip"
)
CONTACT = "Coulomb at each contact (engine); the adapter switches between mu and mus"
_FIRST_STEPS = 4
"""Steps at the start that get more passes (`step_kernels.FIRST_PASSES`): the first has no reactions of a step before
it, and those of the next ones still come from its error."""


class GuideFriction:
    """State of the frictional joints of a scene in an engine's steps; no rows where there is none.

    Parameters
    ----------
    joints : collection of Joint
        Guides, and pins if their friction is the engine's too.
    radii : sequence of float
        By joint: `Mechanism.slip_radius`, m.

    Attributes
    ----------
    guides : ndarray of `stiction.engines.shared.step_kernels.GUIDE`
        A row for each of the joints.
    """

    def __init__(self, joints: Collection[Joint], radii: Sequence[float]):
        # A record for each joint, all zero at first. So that part of the cap of the very first pass
        # that depends on the load is zero: its reactions give the next cap.
        self.guides = np.zeros(len(joints), GUIDE)
        for row, joint, radius in zip(self.guides, joints, radii):
            row["bound"], row["static_bound"] = joint.bounds
            row["radius"] = radius
            if isinstance(joint, Translational):
                row["mu"], row["mus"] = joint.kinetic_coefficient, joint.static_coefficient
                row["length"], row["width"] = joint.extent

    def begin(self) -> None:
        """Begin the first step, if the kernel of the engine's steps does not begin it."""

    def modes(self) -> np.ndarray:
        """Per frictional joint: -1, 0, 1 (slip against, stick, slip along) in the last step."""
        return self.guides["mode"].copy()

    def modes_before(self) -> np.ndarray:
        """`modes` in the step before the last."""
        return self.guides["mode_before"].copy()

    def frictions(self) -> np.ndarray:
        """Per frictional joint: its friction in the last step (N, of a pin N m); NaN while it stuck.

        It is the force on the slider along the guide, or the torque on the first body of a pin.
        """
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
    passes : int
        Attempts at an undecided step.
    capped : bool
        False if the engine finds the friction itself; then no joint has a cap.

    Attributes
    ----------
    balance : Balance
        The balance of the mechanism.
    initial : tuple of ndarray, each of shape (3 * bodies,)
        Coordinates and velocities at t = 0.
    data : Cap
        Argument of the kernels of `stiction.engines.shared.step_kernels`.
    caps : callable
        Returns a list of the bounds of the coming pass by joint (N, of pins N m).
    held : ndarray, shape (frictional,)
        Magnitudes of the frictions in a pass (N, of pins N m), which the adapter sets after it.
    """

    def __init__(self, mechanism: Mechanism, passes: int, capped: bool):
        scene = mechanism.scene
        joints = scene.frictional_joints.values() if capped else ()
        super().__init__(joints, mechanism.slip_radius.tolist())
        self.balance = Balance.of(mechanism)
        # views of the records: what the kernels write is seen here, and the other way round
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
    """The coefficient for contacts of an engine with one coefficient: mus while stick is undecided, mu otherwise.

    Boxes without clearance have no contact forces at the start. Until they have landed, stick is undecided.
    """

    def __init__(self, scene: Scene):
        guides = scene.frictional_guides.values()
        super().__init__(guides, [1.0] * len(guides))
        self._coefficients = self.guides["coefficient"]

    def begin(self) -> None:
        """Begin the first step."""
        link_kernels(finish_contacts)
        begin_contacts(self.guides)

    def coefficients(self) -> list[float]:
        """Return the coefficient of each frictional guide for the next step."""
        return self._coefficients.tolist()
