"""Exudyn's own friction of a coordinate: bristles that hold a slider with a bounded force.

The adapter renews the bound before each step.

`ObjectConnectorCoordinateSpringDamperExt` sticks as a spring between the slider and the place where it came to rest,
and slips with the force F_d + F_s exp(-|v|/v_s). Exudyn has no force there that depends on a joint's reactions, so that
F_d = mu N and F_s = (mus - mu) N are set with the N = |n1| + |n2| of the multipliers of the step before (as in
`stepping`). Nothing is located, and nothing repeated.

An implicit step of h has one solution only where friction falls with the speed by less than m/h, with the mass m that
slip moves: F_s/v_s < m/h. So v_s is set to `static_decay` times F_s h/m, which vanishes with the step. At 1 slip begins
in all hard cases but one; at less Newton's method gives up more often.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign

import numpy as np

from stiction.engines.exudyn.friction import REST_SPEED, SlidingGuide
from stiction.engines.exudyn.model import Model
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.scenes.model import Translational

FRICTION_LAW = (
    "Coulomb with bristles (engine), bound mu (|n1| + |n2|) from the multipliers of the step before "
    "(adapter)"
)

LEAST = 1e-12
"""Least friction force (N), and least v_s (m/s), which is zero without a static excess. If the force is zero when
Exudyn assembles the system, it leaves the bristles out, and Newton's method fails later."""

HELD = 1e-9
"""Part of the slider's own mobility (1/kg) up to which constraints hold it. The mobility is a difference, and what is
left of it is rounding."""


class BristleGuide(SlidingGuide):
    """The friction of one slider of a model that is not yet assembled, by the adapter's settings and the step, s.

    Attributes
    ----------
    decay : float
        v_s, the speed at which 37 % of the static excess F_s are left, over F_s, m/(N s).
    """

    def __init__(
        self,
        model: Model,
        name: str,
        joint: Translational,
        options: Mapping[str, float],
        step: float,
        mechanism: Mechanism,
    ):
        super().__init__(model, name, joint)
        self.decay = options["static_decay"] * step / moved_mass(mechanism, name)
        items = model.items
        # The initial state of the bristles: direction of slip, and place at which they stick. A
        # slider in motion that began as sticking would be braked by the damping of the bristles.
        q, v = model.initial_state()
        speed = self.slip_speed(q, v)
        slides = copysign(1.0, speed) if abs(speed) > REST_SPEED else 0.0
        self.node = self.system.AddNode(
            items.NodeGenericData(
                name=f"{name}-bristles",
                initialCoordinates=[slides, float(self.displacement(q)), 0.0],
                numberOfDataCoordinates=3,
            )
        )
        self.bristles = self.system.AddObject(
            items.ObjectConnectorCoordinateSpringDamperExt(
                name=f"{name}-bristles",
                markerNumbers=[model.zero(), self.along],
                nodeNumber=self.node,
                stickingStiffness=options["bristle_stiffness"],
                stickingDamping=options["bristle_damping"],
                dynamicFrictionForce=LEAST,
                exponentialDecayStatic=LEAST,
            )
        )

    def renew(self, multipliers: np.ndarray) -> None:
        """Set the largest forces and the surface moment from multipliers; they are constant within a step."""
        R = self.measure_load(multipliers)
        self.mode, self.friction, _ = self.record()
        # F_d, F_s and v_s of the module's docstring
        excess = max(self.mus - self.coefficient, 0.0) * self.load
        for parameter, value in (
            ("dynamicFrictionForce", max(self.coefficient * self.load, LEAST)),
            ("staticFrictionOffsetForce", excess),
            ("exponentialDecayStatic", max(self.decay * excess, LEAST)),
        ):
            self.system.SetObjectParameter(self.bristles, parameter, value)
        self.apply_surface_moment(self.friction, R)

    def record(self) -> tuple[int, float, float]:
        """Return mode, force on the slider along the guide (N) and surface moment (N m) of the last step."""
        import exudyn

        kind = exudyn.OutputVariableType
        force = float(self.system.GetObjectOutput(self.bristles, kind.Force))
        sliding = float(self.system.GetNodeOutput(self.node, kind.Coordinates)[0])
        return int(copysign(1, sliding)) if sliding else 0, -force, self.surface_moment


def bristle_guides(
    model: Model, options: Mapping[str, float], step: float, mechanism: Mechanism
) -> list[BristleGuide]:
    """Give a model bristles in each guide with friction."""
    return [
        BristleGuide(model, name, guide, options, step, mechanism)
        for name, guide in model.scene.frictional_guides.items()
        if guide.static_coefficient
    ]


def moved_mass(mechanism: Mechanism, name: str) -> float:
    """Return the mass (kg) that slip moves at the start: 1/(acceleration of slip by a unit force along the guide).

    Where constraints hold the slider along its guide, this is the mass of the slider without them.
    """
    arrays, work = mechanism.arrays, workspace(mechanism.arrays)
    row_form(arrays, work, 0.0, *mechanism.initial_state())
    # G = J M^-1 J^T has the rows of the constraints first, then those along the guides. What the
    # constraints take from the mobility along the guide is the Schur complement of their block.
    along = arrays.rows + mechanism.guide_names.index(name)
    constraints = slice(arrays.rows)
    without_constraints = work.G[along, along]
    reactions = np.linalg.lstsq(work.G[constraints, constraints], work.G[constraints, along])[0]
    mobility = without_constraints - work.G[along, constraints] @ reactions
    can_slip = mobility > HELD * without_constraints
    return 1.0 / (mobility if can_slip else without_constraints)
