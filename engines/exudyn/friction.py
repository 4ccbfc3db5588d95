"""Frictional guides in Exudyn: Coulomb friction as loads of the model, a connector that holds a slider.

Exudyn has no load-dependent Coulomb friction, so the law is here and the forces are Exudyn's own loads. With R the
resultant normal force and M_n the moment of the normal forces (both multipliers of the prismatic joint),

    n1 + n2 = R ,   n2 - n1 = (2/a) M_n ,   N = |n1| + |n2| = max(|R|, (2/a) |M_n|)     (N = |R| without a length)
    slip in direction s:  f = -mu s N ,   surface moment (b/2) (f_lower - f_upper) = (b/2) (f / N) R
    stick:                |f| <= mus N ,  f = the multiplier of a connector that holds the slider
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.engines.exudyn.model import Model, turned, unit
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Translational

REST_SPEED = 1e-9
"""Speed (m/s) below which a slider is at rest at the start: above the rounding of initial states, below any motion."""
DIFFERENCE_STEP = 1e-5
"""Half the interval (s) of the central difference that gives the acceleration of slip. Only its sign is used, so that
the error of the difference, of the order of the square of this value, may be far above rounding."""


class SlidingGuide:
    """A frictional guide in Exudyn: coefficients, geometry, the moment of surface friction as loads.

    `slider` and `guide` are the places of the bodies' coordinates, `guide` None for the ground; `lever` is 2/a, or 0
    for a guide without a length, and `half_width` is b/2.
    """

    def __init__(self, model: Model, name: str, joint: Translational):
        self.name, self.joint = name, joint
        self.system = model.system
        self.coefficient, self.mus = joint.kinetic_coefficient, joint.static_coefficient
        self.lever = 2.0 / joint.length if joint.length else 0.0
        self.half_width = 0.5 * (joint.width or 0.0)
        self.slider = 3 * model.index[joint.slider]
        self.guide = None if joint.guide == GROUND else 3 * model.index[joint.guide]
        self.direction = unit(joint.direction)
        self.mode, self.friction, self.surface_moment, self.load = 0, 0.0, 0.0, 0.0
        self.along = model.along(
            joint.guide, joint.point, joint.direction, joint.slider, joint.slider_point
        )
        # Friction acts on the surfaces, half a width from the line of the guide, so it also has a
        # moment. It acts on the slider and, reversed, on the body that has the guide.
        self.moments = []
        if self.half_width:
            for body, sign in ((joint.slider, 1.0), (joint.guide, -1.0)):
                if body != GROUND:
                    load = self.system.AddLoad(
                        model.items.LoadTorqueVector(markerNumber=model.rigid(body))
                    )
                    self.moments.append((load, sign))

    def bind(self, model: Model) -> None:
        """Look up the multipliers, which exist once the system is assembled."""
        self.reaction_rows = model.rows[self.name]

    def measure_load(self, multipliers: np.ndarray) -> float:
        """Set `load`, N = |n1| + |n2|, from multipliers; return the normal force R, N."""
        R, moment = multipliers[self.reaction_rows[0]], -multipliers[self.reaction_rows[1]]
        # |n1| + |n2| = max(|n1 + n2|, |n2 - n1|), with the sum and the difference of the module's docstring
        self.load = max(abs(R), self.lever * abs(moment))
        return R

    def apply_surface_moment(self, friction: float, R: float) -> float:
        """Apply the moment of a friction on the surfaces, with the normal force R (N); return its change (N m)."""
        if not self.moments:
            return 0.0
        before = self.surface_moment
        self.surface_moment = self.half_width * friction / self.load * R if self.load else 0.0
        for load, sign in self.moments:
            self.system.SetLoadParameter(load, "loadVector", [0.0, 0.0, sign * self.surface_moment])
        return abs(self.surface_moment - before)

    def slip_speed(self, q: np.ndarray, v: np.ndarray) -> float:
        """Return the velocity of the slider's point along the guide, relative to the guide, m/s."""
        i, j = self.slider, self.guide
        px, py = turned(self.joint.slider_point, q[i + 2])
        vx, vy = v[i] - v[i + 2] * py, v[i + 1] + v[i + 2] * px
        if j is None:
            ux, uy = self.direction
        else:
            # relative to the velocity of the point of the guide's body that is at the slider's point
            ux, uy = turned(self.direction, q[j + 2])
            gx, gy = q[i] + px - q[j], q[i + 1] + py - q[j + 1]
            vx, vy = vx - v[j] + v[j + 2] * gy, vy - v[j + 1] - v[j + 2] * gx
        return ux * vx + uy * vy

    def columns(
        self, recorded: np.ndarray, _: Any, reactions: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return the guide's columns from the values of `record`, shape (n, 3), and the joint's reactions."""
        modes, friction, surface_moments = recorded.T
        return {
            f"{self.name}.mode": modes.astype(np.int8),
            f"{self.name}.friction": friction,
            f"{self.name}.moment": reactions[f"{self.name}.moment"] + surface_moments,
        }

    def displacement(self, q: np.ndarray) -> float:
        """Return the coordinate of the slider's point along the guide, m."""
        i, j = self.slider, self.guide
        px, py = turned(self.joint.slider_point, q[i + 2])
        gx, gy, angle = (0.0, 0.0, 0.0) if j is None else q[j : j + 3]
        ux, uy = turned(self.direction, angle)
        ox, oy = turned(self.joint.point, angle)
        return ux * (q[i] + px - gx - ox) + uy * (q[i + 1] + py - gy - oy)


class FrictionalGuide(SlidingGuide):
    """A guide whose friction is the adapter's: its load, the connector that holds a sticking slider, its mode."""

    def __init__(self, model: Model, name: str, joint: Translational):
        super().__init__(model, name, joint)
        self._force = self.system.AddLoad(model.items.LoadCoordinate(markerNumber=self.along))
        self._loaded = 0.0
        self._connector = self.system.AddObject(
            model.items.ObjectConnectorCoordinate(
                markerNumbers=[model.zero(), self.along], activeConnector=False
            )
        )

    def bind(self, model: Model) -> None:
        super().bind(model)
        (self.hold_row,) = model.multipliers(self._connector)

    def switch(self, mode: int, q: np.ndarray) -> None:
        """Let the slider slip against (-1) or along (1) the direction, or stick (0) at its place in q."""
        # Stick is a constraint of Exudyn at the present displacement, and needs no friction load.
        self.mode = mode
        self.system.SetObjectParameter(self._connector, "activeConnector", mode == 0)
        if mode == 0:
            self.system.SetObjectParameter(self._connector, "offset", self.displacement(q))
            self._apply(0.0)

    def record(self) -> tuple[int, float, float]:
        """Return mode, friction (N) and surface moment (N m) of the last solution."""
        return self.mode, self.friction, self.surface_moment

    def _apply(self, friction: float) -> float:
        """Apply a friction in the model; return its change, N."""
        before, self._loaded = self._loaded, friction
        self.system.SetLoadParameter(self._force, "load", friction)
        return abs(friction - before)

    def renew(self, multipliers: np.ndarray) -> float:
        """Set `load` and apply the friction from multipliers; return the change of friction, N.

        The change of the surfaces' moment counts too, as the force at the corners that it is equivalent to.
        """
        R = self.measure_load(multipliers)
        if self.mode:
            friction = -self.coefficient * self.mode * self.load
            change = self._apply(friction)
        else:
            friction, change = -multipliers[self.hold_row], 0.0
        self.friction, bound = friction, self.mus * self.load
        # A slider that needs a larger force to hold it than static friction can give is released
        # later. Until then the moment is that of the largest friction: with a larger one, friction
        # and load need not settle.
        change_of_moment = self.apply_surface_moment(min(max(friction, -bound), bound), R)
        return max(change, self.lever * change_of_moment)

    def margin(self, q: np.ndarray, v: np.ndarray) -> float:
        """Return the distance of the mode from its end, negative beyond it.

        In slip, this is the speed in the direction of the mode (m/s); in stick, the friction that is left (N).
        """
        if self.mode:
            return self.mode * self.slip_speed(q, v)
        return self.mus * self.load - abs(self.friction)

    def slip_acceleration(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        """Return the rate of `slip_speed` (m/s^2) by a central difference."""
        h = DIFFERENCE_STEP
        return (self.slip_speed(q + h * v, v + h * a) - self.slip_speed(q - h * v, v - h * a)) / (
            2 * h
        )
