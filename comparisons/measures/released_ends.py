"""Accelerations of the ends of a slider that are released from their guide, in dense NumPy.

All other joints, and an end that is not released, stay in their contact mode: constraints hold, joints at rest stay at
rest, sliding joints have the friction of their direction. Each unknown force f has a row R along which the acceleration
is zero, and a direction C in which a unit of it acts:

    M a = Q + C^T f ,    R a + gamma = 0

R and C differ where friction is proportional to the force. The force n of an end at the place s along the guide acts
on the lower surface where n > 0, on the upper one where n < 0. With the rows J_n of the normal force, J_m of the angle
and W of slip, the width b, the direction d of slip and the sign of n:

    R = J_n + s J_m ,    C = R - mu d sign(n) (W + sign(n) b/2 J_m)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from stiction.reference_impl.equations_of_motion import EquationsOfMotion, Terms
from stiction.scenes import Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.model import Drive, Translational
from stiction.scenes.stribeck import bound_in_slip, coefficient_in_slip

ENDS = ("rear", "front")
"""The two ends of a slider. Each has a corner beside the lower surface and one beside the upper surface."""
LOWER_CORNER = {"rear": 1, "front": 2}
"""Number of the corner of each end beside the lower surface."""
UPPER_CORNER = {"rear": 4, "front": 3}
"""Number of the corner of each end beside the upper surface."""
PLACE = {"rear": -0.5, "front": 0.5}
"""Place of each end along the guide from the slider's point, in lengths of the slider."""
_POINT = "point"
"""The only end of a slider without length."""
_FRICTION = "friction"
"""Label of the friction of the examined slider at rest."""


@dataclass(frozen=True)
class Instant:
    """One side of an instant of a motion with ideal joints.

    Attributes
    ----------
    time : float
        Time, s.
    motion : ndarray, shape (3, 3 * bodies)
        Coordinates, velocities and accelerations of the bodies.
    columns : Mapping of str to float
        Values of the columns of the trajectory, from which the contact mode is taken.
    """

    time: float
    motion: np.ndarray
    columns: Mapping[str, float]

    @classmethod
    def of(cls, time: float, columns: Mapping[str, float], part: Scene) -> Instant:
        """Return the instant with these values of columns."""
        motion = [
            [columns[f"{body}.{label}"] for body in part.bodies for label in labels]
            for labels in BODY_COLUMNS
        ]
        return cls(time, np.array(motion), columns)

    @classmethod
    def of_output(cls, ideal: Trajectory, number: int, part: Scene) -> Instant:
        """Return the instant of an output of a trajectory."""
        columns = {name: float(values[number]) for name, values in ideal.columns.items()}
        return cls.of(float(ideal.t[number]), columns, part)

    def moved(self, step: float) -> tuple[float, np.ndarray, np.ndarray]:
        """Return time, coordinates and velocities a short time `step` (s) later, to first order in it."""
        q, v, a = self.motion
        return self.time + step, q + step * v, v + step * a

    def between(self, time: float, later: Instant) -> Instant:
        """Return the instant of a time before a later one of the same contact mode.

        The motion is the quintic polynomial through both, and columns are interpolated linearly.
        """
        polynomial = BPoly.from_derivatives(
            [self.time, later.time], [list(self.motion), list(later.motion)]
        )
        motion = [polynomial.derivative(k)(time) if k else polynomial(time) for k in range(3)]
        fraction = (time - self.time) / (later.time - self.time)
        columns = {
            name: (1.0 - fraction) * value + fraction * later.columns[name]
            for name, value in self.columns.items()
            if name in later.columns
        }
        # At the end of a slip phase the mode of the later instant may be another one.
        modes = {name: value for name, value in self.columns.items() if name.endswith(".mode")}
        return Instant(time, np.array(motion), columns | modes)

    def end_force(self, guide: str, end: str) -> float:
        """Return the force of an end of a slider on the lower surface minus that on the upper one, N."""
        lower = self.columns[f"{guide}.F{LOWER_CORNER[end]}"]
        upper = self.columns[f"{guide}.F{UPPER_CORNER[end]}"]
        return lower - upper


@dataclass(frozen=True)
class _Unknown:
    """An unknown force.

    Attributes
    ----------
    row : ndarray, shape (k,)
        Row along which the acceleration is zero.
    gamma : float
        The remainder: row a + gamma = 0.
    direction : ndarray, shape (k,)
        Generalized force of a unit of the unknown.
    label : str
        The end of the examined slider whose normal force it is, or `_FRICTION` for its friction at rest; empty for all
        others.
    """

    row: np.ndarray
    gamma: float
    direction: np.ndarray
    label: str = ""


class ReleasedEnds:
    """The slider of one guide, whose ends can be released.

    Parameters
    ----------
    part
        The scene, or the independent part of it that contains the guide.
    guide
        Name of the guide, which has a length.
    """

    def __init__(self, part: Scene, guide: str):
        self.part = part
        self.guide = guide
        self._equations = EquationsOfMotion(part)
        self._row_number = {row: i for i, row in enumerate(self._equations.rows)}
        self._tangent_number = {joint: i for i, joint in enumerate(self._equations.frictional)}

    def end_force(
        self,
        instant: Instant,
        end: str,
        step: float = 0.0,
        sides: Mapping[str, float] | None = None,
    ) -> float:
        """Return the force of an end in the ideal joint, N, a short time `step` (s) after an instant.

        `sides` are the surfaces on which ends press, 1 for the lower and -1 for the upper one, of ends whose force at
        this instant is zero, so that its sign does not tell.
        """
        _, forces = self._solve(instant, (), step, sides or {})
        return forces[end]

    def mobilization(self, instant: Instant, released: tuple[str, ...], step: float = 0.0) -> float:
        """Return the friction of a slider at rest over its bound at the ends that are not released.

        Above 1 the slider does not stay at rest. It is 0 for a slider that slips, or has no friction.
        """
        _, forces = self._solve(instant, released, step, {})
        friction = abs(forces.pop(_FRICTION, 0.0))
        if friction == 0.0:
            return 0.0
        guide = self.part.guides[self.guide]
        normal_force = sum(abs(force) for force in forces.values())
        bound = guide.static_coefficient * normal_force + guide.bounds[1]
        return friction / bound if bound > 0.0 else math.inf

    def acceleration(
        self, instant: Instant, end: str, released: tuple[str, ...], step: float = 0.0
    ) -> float:
        """Return the acceleration of an end along the normal of the guide with some ends released, m/s²."""
        accelerations, _ = self._solve(instant, released, step, {})
        return accelerations[end]

    def _solve(
        self,
        instant: Instant,
        released: tuple[str, ...],
        step: float,
        sides: Mapping[str, float],
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Solve the equations of motion with some ends released.

        Returns
        -------
        accelerations : dict
            Acceleration of each end along the normal, m/s²; zero for those that are not released.
        forces : dict
            Force of each end that is not released, and friction of the slider if it is at rest, N.
        """
        terms = self._equations.at(*instant.moved(step))
        unknowns = self._constraints(terms)
        constant = np.zeros_like(terms.QE)
        for name in self.part.guides:
            own_sides = sides if name == self.guide else {}
            unknowns += self._normal_forces(instant, terms, name, released, own_sides)
        for name in self._tangent_number:
            unknowns += self._frictions_at_rest(instant, terms, name, released)
            constant += self._constant_friction(instant, terms, name)

        # Eliminate the accelerations. Redundant rows share their force in the minimum-norm sense.
        mass = self._equations.mass
        # A body that is free altogether has no unknown.
        shape = (len(unknowns), len(mass))
        rows = np.array([unknown.row for unknown in unknowns]).reshape(shape)
        directions = np.array([unknown.direction for unknown in unknowns]).reshape(shape)
        gammas = np.array([unknown.gamma for unknown in unknowns])
        free = (terms.QE + constant) / mass
        matrix = rows @ (directions / mass).T
        solution = np.linalg.lstsq(matrix, -(rows @ free + gammas))[0]
        acceleration = free + directions.T @ solution / mass

        accelerations = {}
        for end in ENDS:
            row, gamma = self._end_row(terms, self.guide, end)
            accelerations[end] = float(row @ acceleration + gamma)
        forces = {
            unknown.label: float(force)
            for unknown, force in zip(unknowns, solution)
            if unknown.label
        }
        return accelerations, forces

    def _constraints(self, terms: Terms) -> list[_Unknown]:
        """Return the multipliers of pins and drives, and of the angles of sliders without length."""
        guides = self.part.guides
        unknowns = []
        for row, number in self._row_number.items():
            joint, _, label = row.rpartition(".")
            is_angle_of_short_slider = (
                joint in guides and label == "moment" and guides[joint].length is None
            )
            if joint not in guides or is_angle_of_short_slider:
                jacobian = terms.J[number]
                unknowns.append(_Unknown(jacobian, float(terms.gamma[number]), jacobian))
        return unknowns

    def _normal_forces(
        self,
        instant: Instant,
        terms: Terms,
        name: str,
        released: tuple[str, ...],
        sides: Mapping[str, float],
    ) -> list[_Unknown]:
        """Return the normal forces of a guide, with the friction in slip that is proportional to them."""
        guide = self.part.guides[name]
        unknowns = []
        for end in self._held_ends(name, released):
            row, gamma = self._end_row(terms, name, end)
            direction = row
            slip = int(instant.columns[f"{name}.mode"]) if guide.mu is not None else 0
            if slip:
                number = self._tangent_number[name]
                coefficient = float(coefficient_in_slip(guide, terms.slip_speed[number]))
                side = sides.get(end) or self._side(instant, name, end)
                surface = terms.W[number] + side * 0.5 * guide.extent[1] * self._angle_row(
                    terms, name
                )
                direction = row - coefficient * slip * side * surface
            unknowns.append(
                _Unknown(row, gamma, direction, label=end if name == self.guide else "")
            )
        return unknowns

    def _frictions_at_rest(
        self, instant: Instant, terms: Terms, name: str, released: tuple[str, ...]
    ) -> list[_Unknown]:
        """Return the friction of a joint at rest, which holds the surfaces that the held ends press on.

        A drive with a limit that holds is treated like a joint at rest.
        """
        joint = self._equations.frictional[name]
        if int(instant.columns[f"{name}.mode"]) != 0:
            return []
        number = self._tangent_number[name]
        row = terms.W[number]
        gamma = float(terms.w[number])
        if isinstance(joint, Translational) and joint.length is not None and joint.mu is not None:
            held = self._held_ends(name, released)
            if not held and joint.bounds[1] == 0.0:
                return []  # no normal force: no friction
            lever = self._lever_of_rest(instant, name, held)
            row = row + lever * self._angle_row(terms, name)
            gamma += lever * float(terms.gamma[self._row_number[f"{name}.moment"]])
        return [_Unknown(row, gamma, row, label=_FRICTION if name == self.guide else "")]

    def _constant_friction(self, instant: Instant, terms: Terms, name: str) -> np.ndarray:
        """Return the generalized force of the constant bound of a joint in slip, or of a drive that gives way."""
        number = self._tangent_number[name]
        slip = int(instant.columns[f"{name}.mode"])
        element = self._equations.frictional[name]
        if isinstance(element, Drive):
            bound = element.bounds[0]
        else:
            bound = float(bound_in_slip(element, terms.slip_speed[number]))
        return -slip * bound * terms.W[number]

    def _held_ends(self, name: str, released: tuple[str, ...]) -> tuple[str, ...]:
        """Return the ends of a slider that are in contact with their guide."""
        if self.part.guides[name].length is None:
            return (_POINT,)
        if name != self.guide:
            return ENDS
        return tuple(end for end in ENDS if end not in released)

    def _end_row(self, terms: Terms, name: str, end: str) -> tuple[np.ndarray, float]:
        """Return the row of an end's displacement along the normal, shape (k,), and its gamma, m/s²."""
        normal = self._row_number[f"{name}.normal_force"]
        moment = self._row_number[f"{name}.moment"]
        place = PLACE.get(end, 0.0) * self.part.guides[name].extent[0]
        row = terms.J[normal] + place * terms.J[moment]
        return row, float(terms.gamma[normal] + place * terms.gamma[moment])

    def _angle_row(self, terms: Terms, name: str) -> np.ndarray:
        """Return the row of the slider's angle relative to its guide, shape (k,)."""
        return terms.J[self._row_number[f"{name}.moment"]]

    def _side(self, instant: Instant, name: str, end: str) -> float:
        """Return 1 if an end presses on the lower surface, -1 if on the upper one."""
        if end == _POINT:
            force = instant.columns[f"{name}.normal_force"]
        else:
            force = instant.end_force(name, end)
        return 1.0 if force >= 0.0 else -1.0

    def _lever_of_rest(self, instant: Instant, name: str, held: tuple[str, ...]) -> float:
        """Return the distance from the slider's point, across the guide, at which friction at rest acts, m.

        Friction is shared by both surfaces in proportion to their normal forces. Positive towards the lower surface.
        """
        forces = [instant.end_force(name, end) for end in held]
        total = sum(abs(force) for force in forces)
        if len(held) == 1:
            share = self._side(instant, name, held[0])
        else:
            share = sum(forces) / total if total > 0.0 else 0.0
        return 0.5 * self.part.guides[name].extent[1] * share
