"""Exudyn's own friction of a coordinate: bristles that hold a slider with a largest force, which the adapter renews before each step.

`ObjectConnectorCoordinateSpringDamperExt` sticks as a spring between the slider and the place where it came to rest, and slips with the
force F_d + F_s exp(-|v|/v_s). Exudyn has no force there that depends on a joint's reactions, so that F_d = mu N and F_s = (mus - mu) N are
set with the N = |n1| + |n2| of the multipliers of the step before (as in `stepping`). Nothing is located, and nothing repeated.
"""

from __future__ import annotations

from math import copysign

import numpy as np

from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.stepping import REST_SPEED, SlidingGuide
from stiction.scenes.model import Translational

FRICTION_LAW = "Coulomb with bristles (engine), bound mu (|n1| + |n2|) from the multipliers of the step before (adapter)"

LEAST = 1e-12
"""N: without a force above zero Exudyn leaves the bristles out when it assembles the system, and Newton's method fails later."""


class BristleGuide(SlidingGuide):
    """The friction of one slider.

    Parameters
    ----------
    model : Model
        Not yet assembled.
    name : str
        Of the guide.
    joint : Translational
        With friction.
    stiffness, damping : float
        Of the bristles, N/m and N s/m.
    decay : float
        v_s, m/s: the speed at which 37 % of the static excess are left.
    """

    def __init__(self, model: Model, name: str, joint: Translational, stiffness: float, damping: float, decay: float):
        super().__init__(model, name, joint)
        items = model.items
        q, v = model.initial_state()
        speed = self.slip_speed(q, v)
        # whether it slides, and where it sticks: one that begins in motion as sticking would be braked by the bristles' damping
        slides = copysign(1.0, speed) if abs(speed) > REST_SPEED else 0.0
        self.node = self.system.AddNode(items.NodeGenericData(
            name=f"{name}-bristles", initialCoordinates=[slides, float(self.displacement(q)), 0.0], numberOfDataCoordinates=3))
        self.bristles = self.system.AddObject(items.ObjectConnectorCoordinateSpringDamperExt(
            name=f"{name}-bristles", markerNumbers=[model.zero(), self.along], nodeNumber=self.node, stickingStiffness=stiffness, stickingDamping=damping,
            dynamicFrictionForce=LEAST, exponentialDecayStatic=decay))

    def renew(self, multipliers: np.ndarray) -> None:
        """Largest forces and the surface moment from multipliers; nothing of them changes within a step."""
        R = self.measure_load(multipliers)
        self.mode, self.friction = self._state()
        for parameter, share, least in (("dynamicFrictionForce", self.coefficient, LEAST),
                                        ("staticFrictionOffsetForce", max(self.mus - self.coefficient, 0.0), 0.0)):
            self.system.SetObjectParameter(self.bristles, parameter, max(share * self.load, least))
        self.apply_surface_moment(self.friction, R)

    def _state(self) -> tuple[int, float]:
        """Mode and force on the slider along the guide (N) of the last step."""
        import exudyn

        kind = exudyn.OutputVariableType
        force = float(self.system.GetObjectOutput(self.bristles, kind.Force))
        sliding = float(self.system.GetNodeOutput(self.node, kind.Coordinates)[0])
        return int(copysign(1, sliding)) if sliding else 0, -force

    def record(self) -> tuple[int, float, float]:
        """Mode, friction and surface moment of the last step."""
        mode, friction = self._state()
        return mode, friction, self.surface_moment
