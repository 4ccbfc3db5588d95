"""Frictional guides and pins in Exudyn: Coulomb friction as loads of the model, a connector that holds a slider.

Exudyn has no load-dependent Coulomb friction, so the law is here and the forces are Exudyn's own loads. With R the
resultant normal force and M_n the moment of the normal forces (both multipliers of the prismatic joint),

    n1 + n2 = R ,   n2 - n1 = (2/a) M_n ,   N = |n1| + |n2| = max(|R|, (2/a) |M_n|)     (N = |R| without a length)
    slip in direction s:  f = -mu s N ,   surface moment (b/2) (f_lower - f_upper) = (b/2) (f / N) R
    stick:                |f| <= mus N ,  f = the multiplier of a connector that holds the slider

A constant bound F, at rest F_s, is added to mu N and mus N. The moment of the surfaces is that of the part of f that
belongs to N. The friction of a pin has constant bounds alone, torques between its two bodies.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stiction.engines.exudyn.model import Model, turned, unit
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Joint, Revolute, Translational

REST_SPEED = 1e-9
"""Speed (m/s) below which a slider is at rest at the start: above the rounding of initial states, below any motion."""
DIFFERENCE_STEP = 1e-5
"""Half the interval (s) of the central difference that gives the acceleration of slip. Only its sign is used, so that
the error of the difference, of the order of the square of this value, may be far above rounding."""


class FrictionalJoint(ABC):
    """A joint with friction in Exudyn, without the law: bounds, displacement, what friction depends and acts on.

    In a pin, forces are torques, and displacements are angles.

    Attributes
    ----------
    coefficient, constant : float
        mu and F while the joint slips, and whatever takes their place.
    mus, static_constant : float
        mus and F_s.
    mode : int
        -1, 0 (stick) or 1.
    friction, surface_moment, load : float
        f (N, N m), the moment of the surfaces (N m), and N (N).
    lever : float
        2/a, 1/m; 0 where there is no length.
    reaction_rows : sequence of int
        Multipliers on which the friction depends, known once the system is assembled.
    """

    def __init__(self, model: Model, name: str, joint: Joint):
        self.name, self.joint, self.system = name, joint, model.system
        self.kinetic_coefficient = self.mus = 0.0
        if isinstance(joint, Translational):
            self.kinetic_coefficient, self.mus = (
                joint.kinetic_coefficient,
                joint.static_coefficient,
            )
        self.coefficient = self.kinetic_coefficient
        self.constant, self.static_constant = joint.bounds
        self.mode, self.friction, self.surface_moment = 0, 0.0, 0.0
        self.load, self.lever = 0.0, 0.0
        self.reaction_rows: Sequence[int] = ()

    def bind(self, model: Model) -> None:  # noqa: B027 - a pin has nothing to look up
        """Look up the multipliers, which exist once the system is assembled."""

    @abstractmethod
    def connector_markers(self, model: Model) -> list[int]:
        """Return the two markers of a connector whose coordinate is the displacement."""

    @abstractmethod
    def force_markers(self, model: Model) -> list[tuple[int, float]]:
        """Return the markers of coordinates on which friction acts, with the sign of its force there."""

    @abstractmethod
    def measure_load(self, multipliers: np.ndarray) -> float:
        """Set `load` from multipliers; return the normal force R, N."""

    @abstractmethod
    def apply_surface_moment(self, friction: float, R: float) -> float:
        """Apply the moment of a friction on the surfaces, with the normal force R (N); return its change (N m)."""

    @abstractmethod
    def slip_speed(self, q: np.ndarray, v: np.ndarray) -> float:
        """Return the rate of `displacement`, m/s or rad/s."""

    @abstractmethod
    def displacement(self, q: np.ndarray) -> float:
        """Return the displacement of the joint, m or rad."""

    @abstractmethod
    def columns(
        self, recorded: np.ndarray, q: Any, reactions: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return the joint's columns from modes, frictions and surface moments, shape (n, 3), and its reactions."""


class SlidingGuide(FrictionalJoint):
    """A frictional guide in Exudyn: geometry, the moment of surface friction as loads.

    `slider` and `guide` are the places of the bodies' coordinates, `guide` None for the ground; `half_width` is b/2.
    """

    joint: Translational

    def __init__(self, model: Model, name: str, joint: Translational):
        super().__init__(model, name, joint)
        self.lever = 2.0 / joint.length if joint.length else 0.0
        self.half_width = 0.5 * (joint.width or 0.0)
        self.slider = 3 * model.index[joint.slider]
        self.guide = None if joint.guide == GROUND else 3 * model.index[joint.guide]
        self.direction = unit(joint.direction)
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
        self.reaction_rows = model.rows[self.name]

    def measure_load(self, multipliers: np.ndarray) -> float:
        R, moment = multipliers[self.reaction_rows[0]], -multipliers[self.reaction_rows[1]]
        # |n1| + |n2| = max(|n1 + n2|, |n2 - n1|), with the sum and the difference of the module's docstring
        self.load = max(abs(R), self.lever * abs(moment))
        return R

    def apply_surface_moment(self, friction: float, R: float) -> float:
        if not self.moments:
            return 0.0
        before = self.surface_moment
        part = self._part_by_load(friction)
        self.surface_moment = self.half_width * part / self.load * R if self.load else 0.0
        for load, sign in self.moments:
            self.system.SetLoadParameter(load, "loadVector", [0.0, 0.0, sign * self.surface_moment])
        return abs(self.surface_moment - before)

    def _part_by_load(self, friction: float) -> float:
        """Return the part of a friction (N) that belongs to the load and not to the constant bound."""
        # Both parts are mobilized equally, in slip and at rest.
        coefficient, constant = self.coefficient, self.constant
        if self.mode == 0:
            coefficient, constant = self.mus, self.static_constant
        if constant == 0.0:
            return friction
        by_load = coefficient * self.load
        return friction * by_load / (constant + by_load)

    def connector_markers(self, model: Model) -> list[int]:
        return [model.zero(), self.along]

    def force_markers(self, model: Model) -> list[tuple[int, float]]:
        return [(self.along, 1.0)]

    def slip_speed(self, q: np.ndarray, v: np.ndarray) -> float:
        # the velocity of the slider's point along the guide, relative to the guide
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
        self, recorded: np.ndarray, q: Any, reactions: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        modes, friction, surface_moments = recorded.T
        return {
            f"{self.name}.mode": modes.astype(np.int8),
            f"{self.name}.friction": friction,
            f"{self.name}.moment": reactions[f"{self.name}.moment"] + surface_moments,
        }

    def displacement(self, q: np.ndarray) -> float:
        # the coordinate of the slider's point along the guide
        i, j = self.slider, self.guide
        px, py = turned(self.joint.slider_point, q[i + 2])
        gx, gy, angle = (0.0, 0.0, 0.0) if j is None else q[j : j + 3]
        ux, uy = turned(self.direction, angle)
        ox, oy = turned(self.joint.point, angle)
        return ux * (q[i] + px - gx - ox) + uy * (q[i + 1] + py - gy - oy)


class TurningPin(FrictionalJoint):
    """A frictional pin in Exudyn, whose friction depends on no reaction.

    `first` and `second` are the places of the angles of its bodies among the coordinates, None for the ground.
    """

    joint: Revolute

    def __init__(self, model: Model, name: str, joint: Revolute):
        super().__init__(model, name, joint)
        self.first, self.second = (
            None if body == GROUND else 3 * model.index[body] + 2 for body in joint.bodies
        )

    def measure_load(self, multipliers: np.ndarray) -> float:
        return 0.0

    def apply_surface_moment(self, friction: float, R: float) -> float:
        return 0.0

    def connector_markers(self, model: Model) -> list[int]:
        return model.angles(self.joint.bodies)

    def force_markers(self, model: Model) -> list[tuple[int, float]]:
        return [
            (model.angle(body), sign)
            for body, sign in zip(self.joint.bodies, (1.0, -1.0))
            if body != GROUND
        ]

    def slip_speed(self, q: np.ndarray, v: np.ndarray) -> float:
        return self._difference(v)

    def displacement(self, q: np.ndarray) -> float:
        return self._difference(q)

    def _difference(self, values: np.ndarray) -> float:
        """Return the value of the first body's angle minus that of the second's."""
        first = 0.0 if self.first is None else values[self.first]
        second = 0.0 if self.second is None else values[self.second]
        return first - second

    def columns(
        self, recorded: np.ndarray, q: Any, reactions: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        modes, friction, _ = recorded.T
        return {f"{self.name}.mode": modes.astype(np.int8), f"{self.name}.friction": friction}


class LocatedFriction(FrictionalJoint):
    """Friction of a joint that is the adapter's: its loads, the connector that holds a sticking slider, its mode.

    Subclasses also derive from `SlidingGuide` or `TurningPin`.
    """

    def _add_friction(self, model: Model) -> None:
        """Add the loads and the connector to a model that is not yet assembled."""
        self._forces = [
            (self.system.AddLoad(model.items.LoadCoordinate(markerNumber=marker)), sign)
            for marker, sign in self.force_markers(model)
        ]
        self._loaded = 0.0
        self._connector = self.system.AddObject(
            model.items.ObjectConnectorCoordinate(
                markerNumbers=self.connector_markers(model), activeConnector=False
            )
        )

    def bind(self, model: Model) -> None:
        super().bind(model)
        (self.hold_row,) = model.multipliers(self._connector)

    def slip_without_friction(self) -> None:
        """Let the joint slip without friction from now on."""
        self.coefficient = self.constant = 0.0

    def slip_with_static_bound(self) -> None:
        """Let the joint slip with the friction of rest from now on."""
        self.coefficient, self.constant = self.mus, self.static_constant

    def slip_with_kinetic_bound(self) -> None:
        """Let the joint slip with the friction of slip from now on."""
        self.coefficient = self.kinetic_coefficient
        self.constant, _ = self.joint.bounds

    def switch(self, mode: int, q: np.ndarray) -> None:
        """Let the slider slip against (-1) or along (1) the direction, or stick (0) at its place in q."""
        # Stick is a constraint of Exudyn at the present displacement, and needs no friction load.
        self.mode = mode
        self.system.SetObjectParameter(self._connector, "activeConnector", mode == 0)
        if mode == 0:
            self.system.SetObjectParameter(self._connector, "offset", self.displacement(q))
            self._apply(0.0)

    def record(self) -> tuple[int, float, float]:
        """Mode, friction and surface moment of the last solution."""
        return self.mode, self.friction, self.surface_moment

    def _apply(self, friction: float) -> float:
        """Apply a friction in the model; return its change, N."""
        before, self._loaded = self._loaded, friction
        for load, sign in self._forces:
            self.system.SetLoadParameter(load, "load", sign * friction)
        return abs(friction - before)

    def renew(self, multipliers: np.ndarray) -> float:
        """Set `load` and apply the friction from multipliers; return the change of friction, N.

        The change of the surfaces' moment counts too, as the force at the corners that it is equivalent to.
        """
        R = self.measure_load(multipliers)
        if self.mode:
            friction = -self.mode * (self.constant + self.coefficient * self.load)
            change = self._apply(friction)
        else:
            friction, change = -multipliers[self.hold_row], 0.0
        self.friction, bound = friction, self.static_constant + self.mus * self.load
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
        return self.static_constant + self.mus * self.load - abs(self.friction)

    def slip_acceleration(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        """Rate of `slip_speed` (m/s^2) by a central difference."""
        h = DIFFERENCE_STEP
        return (self.slip_speed(q + h * v, v + h * a) - self.slip_speed(q - h * v, v - h * a)) / (
            2 * h
        )


class FrictionalGuide(LocatedFriction, SlidingGuide):
    """A guide whose friction is the adapter's."""

    def __init__(self, model: Model, name: str, joint: Translational):
        super().__init__(model, name, joint)
        self._add_friction(model)


class FrictionalPin(LocatedFriction, TurningPin):
    """A pin whose friction is the adapter's."""

    def __init__(self, model: Model, name: str, joint: Revolute):
        super().__init__(model, name, joint)
        self._add_friction(model)
