"""Equations of motion of a scene in dense matrices, at many instants at once, independent of the reference.

    M q'' = Q + J^T lambda + W^T f,   Phi'' = J q'' + gamma,   slip' = W q'' + w

Points and directions of the plane are complex numbers: a vector a that is fixed in a body turns as a exp(i angle), its
derivative is i omega times itself, and Re(conj(a) b) is the scalar product. Every constraint, drive and spring has one
of three kinds of coordinates (`Values`):

- the distance of a point of one body from a point of another in a direction that turns with a third, the carrier:
  s = Re(conj(e) r) with s'' = Re(conj(e) r'' + 2 conj(i W e) r' - W^2 conj(e) r), W the carrier's angular velocity;
- the distance of two points: s = |r| with s' = Re(conj(l) r') along the line l = r / |r|, and
  s'' = Re(conj(l) r'') + (|r'|^2 - s'^2) / s;
- the difference of two angles.

A tension F in a coordinate s has the generalized force -F ds/dq (virtual work).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Law, evaluate_law
from stiction.scenes.model import Force, Revolute


@dataclass(frozen=True)
class Values:
    """Coordinates s(q) along a motion; leading axes run over instants.

    Attributes
    ----------
    value, rate, gamma : ndarray, shape (..., rows)
        s, s', and s'' less what the accelerations contribute.
    jacobian : ndarray, shape (..., rows, k)
        ds/dq.
    """

    value: np.ndarray
    rate: np.ndarray
    gamma: np.ndarray
    jacobian: np.ndarray


@dataclass(frozen=True)
class Terms:
    """The terms at instants; leading axes run over these, k is the number of coordinates.

    Attributes
    ----------
    Q : ndarray, shape (..., k)
        Generalized applied forces.
    phi, phi_dot, gamma : ndarray, shape (..., rows)
        Residuals of the constraints and of their rates; Phi'' = J q'' + gamma.
    J : ndarray, shape (..., rows, k)
        Jacobian of the constraints.
    W : ndarray, shape (..., guides, k)
        Directions of slip of the frictional guides.
    w, slip_speed : ndarray, shape (..., guides)
        The term w of slip' = W q'' + w, and the slip velocity.
    """

    Q: np.ndarray
    phi: np.ndarray
    phi_dot: np.ndarray
    gamma: np.ndarray
    J: np.ndarray
    W: np.ndarray
    w: np.ndarray
    slip_speed: np.ndarray


def scalar_product(a: Any, b: Any) -> Any:
    """Return the scalar product of planar vectors, which are complex numbers."""
    return (np.conj(a) * b).real


class Posture:
    """Positions and velocities of all bodies at instants; the last body is the ground.

    Attributes
    ----------
    place, velocity : ndarray of complex, shape (..., bodies)
        Positions (m) and velocities (m/s) of the centres of mass.
    angle, spin : ndarray, shape (..., bodies)
        Angles (rad) and angular velocities (rad/s).
    turn : ndarray of complex, shape (..., bodies)
        exp(i angle), which turns a vector from the axes of a body into those of the ground.
    """

    def __init__(self, q: np.ndarray, v: np.ndarray):
        # The ground is one more body at rest, so that the equations below need no special case.
        ground = np.zeros((*q.shape[:-1], 3))
        q = np.concatenate([q, ground], -1)
        v = np.concatenate([v, ground], -1)
        self.place = q[..., 0::3] + 1j * q[..., 1::3]
        self.velocity = v[..., 0::3] + 1j * v[..., 1::3]
        self.angle = q[..., 2::3]
        self.spin = v[..., 2::3]
        self.turn = np.exp(1j * self.angle)


class Distances:
    """Distances between points of two bodies, along given directions or along the line between the points.

    Parameters
    ----------
    bodies : sequence of pairs of int
        Numbers of the bodies; the last number is the ground's.
    points : sequence of pairs of complex
        Points in the axes of the bodies, m. Vectors go from the second to the first.
    directions : sequence of complex, optional
        Directions in which the distances are measured, of any length; along the vectors themselves if not given.
    carriers : sequence of int, optional
        Bodies with which the directions turn.
    """

    def __init__(
        self,
        bodies: Sequence[tuple[int, int]],
        points: Sequence[tuple[complex, complex]],
        directions: Sequence[complex] | None = None,
        carriers: Sequence[int] = (),
    ):
        self.body = np.array(bodies, dtype=int).reshape(-1, 2).T
        self.point = np.array(points, dtype=complex).reshape(-1, 2).T
        self.direction = None
        if directions is not None:
            line = np.array(directions, dtype=complex)
            self.direction = line / np.abs(line)
            self.carrier = np.array(carriers, dtype=int)

    def at(self, posture: Posture) -> Values:
        """Return the distances, their rates and derivatives."""
        # For both ends: arm from the body's centre, position, velocity, and the acceleration without
        # q'', which is centripetal.
        ends = []
        for body, point in zip(self.body, self.point):
            arm = point * posture.turn[..., body]
            spin = posture.spin[..., body]
            place = posture.place[..., body] + arm
            velocity = posture.velocity[..., body]
            ends.append((arm, place, velocity + 1j * spin * arm, -(spin**2) * arm))
        (arm, *first), (other_arm, *second) = ends
        r, r_rate, centripetal = (a - b for a, b in zip(first, second))

        if self.direction is None:
            value = np.abs(r)
            # If the two ends coincide there is no direction, and no force of a spring along it.
            e = np.where(value > 0.0, r / np.where(value > 0.0, value, 1.0), 0.0)
            rate = scalar_product(e, r_rate)
            with np.errstate(divide="ignore", invalid="ignore"):
                gamma = scalar_product(e, centripetal) + (np.abs(r_rate) ** 2 - rate**2) / value
        else:
            # The direction turns with its carrier: e' = i W e, from which the Coriolis and
            # centripetal terms follow.
            e = self.direction * posture.turn[..., self.carrier]
            turning = posture.spin[..., self.carrier]
            value = scalar_product(e, r)
            rate = scalar_product(e, r_rate) + scalar_product(1j * turning * e, r)
            gamma = (
                scalar_product(e, centripetal)
                + 2 * scalar_product(1j * turning * e, r_rate)
                - turning**2 * value
            )

        # ds/dq: a distance changes with the points of both ends, and with the angle of the carrier of
        # its direction. Terms are added because the carrier may be one of the two bodies. The columns
        # of the ground are dropped.
        row = np.arange(len(self.body[0]))
        jacobian = np.zeros((*value.shape, 3 * posture.angle.shape[-1]))
        for body, lever, sign in zip(self.body, (arm, other_arm), (1, -1)):
            for column, part in enumerate((e.real, e.imag, scalar_product(e, 1j * lever))):
                jacobian[..., row, 3 * body + column] += sign * part
        if self.direction is not None:
            jacobian[..., row, 3 * self.carrier + 2] += scalar_product(1j * e, r)
        return Values(value, rate, gamma, jacobian[..., :-3])


class Angles:
    """Differences of the angles of two bodies, the first minus the second; `count` is the number of bodies."""

    def __init__(self, bodies: Sequence[tuple[int, int]], count: int):
        self.rows = np.zeros((len(bodies), 3 * count + 3))
        for row, (first, second) in zip(self.rows, bodies):
            row[3 * first + 2] += 1
            row[3 * second + 2] -= 1

    def at(self, posture: Posture) -> Values:
        """Return the differences, their rates and derivatives."""
        of_angles = self.rows[:, 2::3].T
        value = posture.angle @ of_angles
        shape = (*value.shape[:-1], *self.rows[:, :-3].shape)
        return Values(
            value,
            posture.spin @ of_angles,
            np.zeros_like(value),
            np.broadcast_to(self.rows[:, :-3], shape),
        )


class Coordinates:
    """Coordinates of drives or of springs, in the order of the scene."""

    def __init__(self, elements: Sequence[Any], number: dict[str, int]):
        def pair(element: Any) -> tuple[int, int]:
            return number[element.bodies[0]], number[element.bodies[1]]

        def places(element: Any) -> tuple[complex, complex]:
            return complex(*element.points[0]), complex(*element.points[1])

        # Elements of one kind are evaluated together; `order` puts their rows back into the order
        # of the scene.
        turning = [e for e in elements if e.type in ("angle", "torsional")]
        straight = [e for e in elements if e.type in ("distance", "linear")]
        along = [e for e in straight if e.axis is not None]
        free = [e for e in straight if e.axis is None]
        groups: list[Angles | Distances] = [
            Angles([pair(e) for e in turning], len(number) - 1),
            Distances(
                [pair(e) for e in along],
                [places(e) for e in along],
                [complex(*e.axis) for e in along],
                [number[e.bodies[1]] for e in along],
            ),
            Distances([pair(e) for e in free], [places(e) for e in free]),
        ]
        # Empty groups are left out. If there are no elements at all, the empty group of angles is kept
        # because it yields the right shapes.
        is_needed = [bool(turning) or not straight, bool(along), bool(free)]
        self.groups = [group for group, needed in zip(groups, is_needed) if needed]
        grouped = [id(e) for e in (*turning, *along, *free)]
        self.order = [grouped.index(id(e)) for e in elements]

    def at(self, posture: Posture) -> Values:
        """Return the coordinates, their rates and derivatives."""
        parts = [group.at(posture) for group in self.groups]
        if len(parts) == 1:
            return parts[0]
        value, rate, gamma = (
            np.concatenate([getattr(values, name) for values in parts], -1)[..., self.order]
            for name in ("value", "rate", "gamma")
        )
        jacobian = np.concatenate([values.jacobian for values in parts], -2)[..., self.order, :]
        return Values(value, rate, gamma, jacobian)


def law_values(laws: Sequence[Law], t: np.ndarray) -> np.ndarray:
    """Return values and first and second derivatives of laws at times t (s), shape (3, ..., laws)."""
    derivatives = np.zeros((3, *t.shape, len(laws)))
    for i, law in enumerate(laws):
        values = np.array([evaluate_law(law, time) for time in t.flat])
        derivatives[..., i] = np.moveaxis(values, -1, 0).reshape(3, *t.shape)
    return derivatives


NO_ROW = -1
"""Place in J of a drive with a limit, which has no constraint row."""


class DenseEquations:
    """The equations of a scene. Rows of J: pins (x and y of each), guides (across and angle of each), drives.

    Attributes
    ----------
    frictional : dict of str to Revolute, Translational or Drive
        The joints with dry friction in the order of the scene, and behind them the drives with a limit, whose slip is
        measured relative to the rates of their laws.
    mass : ndarray, shape (k,)
        Diagonal of M.
    first_row : list of int
        Index in J of the first row of each frictional joint. It is the row across a guide, which the row of its angle
        follows. `NO_ROW` for a drive with a limit, which has none.
    pins : dict of str to int
        Index in J of the x row of each pin; the y row is the next one.
    """

    def __init__(self, scene: Scene):
        self.scene = scene
        self.frictional = dict(scene.bounded_elements)
        number = {name: i for i, name in enumerate([*scene.bodies, GROUND])}
        bodies = scene.bodies.values()
        self.mass = np.array([m for body in bodies for m in (body.mass, body.mass, body.inertia)])
        self.gravity = np.resize([*(scene.gravity or (0.0, 0.0)), 0.0], len(self.mass))
        pins = {name: j for name, j in scene.joints.items() if isinstance(j, Revolute)}
        guides = scene.guides
        self.pins = {name: 2 * i for i, name in enumerate(pins)}
        first_row = dict(self.pins)
        first_row |= dict.fromkeys(scene.limited_drives, NO_ROW)
        first_row |= {name: 2 * (len(pins) + i) for i, name in enumerate(guides)}
        self.first_row = [first_row[name] for name in self.frictional]

        # All distances are one group, as each group costs time: pins (along x and y of the ground),
        # then across the guides, then along the guides with friction.
        pairs: list[tuple[int, int]] = []
        points: list[tuple[complex, complex]] = []
        lines: list[complex] = []
        carriers: list[int] = []
        for pin in pins.values():
            for axis in (1, 1j):
                pairs.append((number[pin.bodies[0]], number[pin.bodies[1]]))
                points.append((complex(*pin.points[0]), complex(*pin.points[1])))
                lines.append(complex(axis))
                carriers.append(number[GROUND])
        with_friction = {name: guides[name] for name in self.frictional if name in guides}
        for turn, turned_guides in ((1j, guides), (1, with_friction)):
            for guide in turned_guides.values():
                pairs.append((number[guide.slider], number[guide.guide]))
                points.append((complex(*guide.slider_point), complex(*guide.point)))
                lines.append(turn * complex(*guide.direction))
                carriers.append(number[guide.guide])
        self._distances = Distances(pairs, points, lines, carriers)
        self._parts = np.cumsum([2 * len(pins), len(guides)])
        self._guide_angles = Angles(
            [(number[g.slider], number[g.guide]) for g in guides.values()], len(scene.bodies)
        )
        # Friction of pins acts along their relative angles. `_frictional_order` contains the index of
        # each element among the guides, then the pins with friction, then the drives with a limit.
        rubbing = [pin for name, pin in pins.items() if name in self.frictional]
        self._pin_angles = Angles(
            [(number[pin.bodies[0]], number[pin.bodies[1]]) for pin in rubbing], len(scene.bodies)
        )
        limited = scene.limited_drives
        self._limited = Coordinates(list(limited.values()), number)
        self._limited_laws = [drive.law for drive in limited.values()]
        listed = [*with_friction, *(name for name in pins if name in self.frictional), *limited]
        self._frictional_order = np.array(
            [listed.index(name) for name in self.frictional], dtype=int
        )
        self._prescribed_angles = np.array([g.angle for g in guides.values()])
        prescribed = list(scene.prescribed_drives.values())
        self._driven = Coordinates(prescribed, number)
        self._laws = [drive.law for drive in prescribed]

        self._read_springs(number)
        self._read_loads(number)

    def _read_springs(self, number: dict[str, int]) -> None:
        """Set the arrays of the springs and dampers; `number` contains the numbers of the bodies."""
        springs = list(self.scene.springs_and_dampers.values())
        self._springs = Coordinates(springs, number)
        self._stiffness = np.array([spring.stiffness for spring in springs])
        self._damping = np.array([spring.damping for spring in springs])
        self._rest = np.array(
            [s.rest_length if s.type == "linear" else s.rest_angle for s in springs]
        )
        # -1 of springs that push only, 1 of those that pull only, 0 of those that do both
        self.spring_side = np.array([spring.side for spring in springs])

    def _read_loads(self, number: dict[str, int]) -> None:
        """Set the arrays of the loads. A torque has no point and no direction, which are zero instead."""
        loads = list(self.scene.forces.values())
        self._load_laws = [load.law for load in loads]
        self._loaded = np.array([number[load.body] for load in loads], dtype=int)
        forces = [load if isinstance(load, Force) else None for load in loads]
        self._arm = np.array([complex(*f.point) if f else 0j for f in forces])
        self._push = np.array(
            [complex(*f.direction) / np.hypot(*f.direction) if f else 0j for f in forces]
        )
        self._torque = np.array([0.0 if f else 1.0 for f in forces])

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and v at t = 0 according to the scene."""
        bodies = self.scene.bodies.values()
        q = [x for body in bodies for x in (*body.position, body.angle)]
        v = [x for body in bodies for x in (*body.velocity, body.angular_velocity)]
        return np.array(q, dtype=float), np.array(v, dtype=float)

    def stretches(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return stretch (m, rad) and tension (N, N m) of all springs as if none were one-sided, (..., springs)."""
        springs = self._springs.at(Posture(q, v))
        stretch = springs.value - self._rest
        return stretch, self._stiffness * stretch + self._damping * springs.rate

    def at(
        self,
        t: float | np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        acting: np.ndarray | None = None,
    ) -> Terms:
        """Return the terms at an instant or, with leading axes, at many instants.

        Parameters
        ----------
        t : float or ndarray, shape (...,)
            Times, s.
        q, v : ndarray, shape (..., k)
            Coordinates and velocities.
        acting : ndarray of bool, shape (springs,), optional
            Which springs have a tension. By default those on one side have it where their stretch and tension are on
            that side, and all others everywhere.
        """
        t = np.asarray(t, dtype=float)
        posture = Posture(q, v)
        distances = self._distances.at(posture)
        angles = self._guide_angles.at(posture)
        turns = self._pin_angles.at(posture)
        driven = self._driven.at(posture)
        law = law_values(self._laws, t)
        limited = self._limited.at(posture)
        limited_law = law_values(self._limited_laws, t)

        def arrange(
            of_distances: np.ndarray,
            of_angles: np.ndarray,
            of_drives: np.ndarray,
            of_turns: np.ndarray,
            of_limited: np.ndarray,
        ) -> tuple[np.ndarray, np.ndarray]:
            """Return the rows of all constraints in the order of J, and the directions of friction."""
            axis = t.ndim
            pins, across, along = np.split(of_distances, self._parts, axis)
            # The row across each guide is followed by the row of its angle.
            pair = np.stack([across, of_angles], axis + 1)
            of_guides = pair.reshape(*pair.shape[:axis], -1, *pair.shape[axis + 2 :])
            directions = np.take(
                np.concatenate([along, of_turns, of_limited], axis), self._frictional_order, axis
            )
            return np.concatenate([pins, of_guides, of_drives], axis), directions

        # Subtract the prescribed angles and laws from values, rates and accelerations.
        angle_errors = angles.value - self._prescribed_angles
        errors = [
            (driven_part - by_law, limited_part - by_limited_law)
            for driven_part, limited_part, by_law, by_limited_law in zip(
                (driven.value, driven.rate, driven.gamma),
                (limited.value, limited.rate, limited.gamma),
                law,
                limited_law,
            )
        ]
        phi, _ = arrange(distances.value, angle_errors, errors[0][0], turns.value, errors[0][1])
        phi_dot, slip_speed = arrange(
            distances.rate, angles.rate, errors[1][0], turns.rate, errors[1][1]
        )
        gamma, w = arrange(distances.gamma, angles.gamma, errors[2][0], turns.gamma, errors[2][1])
        J, W = arrange(
            distances.jacobian, angles.jacobian, driven.jacobian, turns.jacobian, limited.jacobian
        )
        return Terms(self._applied(t, posture, acting), phi, phi_dot, gamma, J, W, w, slip_speed)

    def _applied(
        self, t: np.ndarray, posture: Posture, acting: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the generalized forces of weight, springs with dampers, and loads; `acting` as in `at`."""
        Q = np.zeros((*t.shape, len(self.mass))) + self.mass * self.gravity
        if len(self._stiffness):
            # By virtual work a tension F in the coordinate s contributes -F ds/dq.
            springs = self._springs.at(posture)
            stretch = springs.value - self._rest
            tension = self._stiffness * stretch + self._damping * springs.rate
            if acting is None:
                side = self.spring_side
                acting = (side == 0) | ((side * stretch > 0.0) & (side * tension > 0.0))
            tension = np.where(acting, tension, 0.0)
            Q -= np.sum(tension[..., None] * springs.jacobian, -2)
        size = law_values(self._load_laws, t)[0]
        for i, body in enumerate(self._loaded):
            # The point of a force turns with its body, the direction does not.
            arm = self._arm[i] * posture.turn[..., body]
            push = self._push[i]
            moment = scalar_product(1j * arm, push) + self._torque[i]
            for column, part in enumerate((push.real, push.imag, moment)):
                Q[..., 3 * body + column] += size[..., i] * part
        return Q
