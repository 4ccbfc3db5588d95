"""The terms of the equations of motion in dense NumPy, eqs. (8), (18)-(21): M, QE, Phi, J, gamma, W_T.

    M q'' = QE + J^T lambda + W_T^T lambda_T,   Phi'' = J q'' + gamma,   g_T'' = W_T q'' + w_T

Every constraint, drive, spring and load is written with points, directions and angles of bodies. Each of these knows
its Jacobian, rate and centripetal part (`Moving`), and the product rule does the rest. A spring acts by virtual work:
the generalized force of a tension F in the coordinate s is -F ds/dq. This is another derivation than that of the
compiled `kinematics` and `dynamics`, which have every row in closed form. Each can be tested against the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Law, evaluate_law
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, TorsionalSpring


@dataclass(frozen=True)
class Moving:
    """A quantity s(q, t), a number or a vector in the plane, along a motion; leading axes run over instants."""

    value: np.ndarray  # (..., n), or (...,) for a number
    jacobian: np.ndarray  # (..., n, k), or (..., k): ds/dq
    rate: np.ndarray  # as `value`: s' = ds/dq v + ds/dt
    gamma: np.ndarray  # as `value`: s'' = ds/dq q'' + gamma

    def __sub__(self, other: Moving) -> Moving:
        return Moving(
            self.value - other.value,
            self.jacobian - other.jacobian,
            self.rate - other.rate,
            self.gamma - other.gamma,
        )

    def __getitem__(self, i: int) -> Moving:
        """A component of a vector."""
        return Moving(
            self.value[..., i], self.jacobian[..., i, :], self.rate[..., i], self.gamma[..., i]
        )

    def dot(self, other: Moving) -> Moving:
        """The inner product, by the product rule."""
        a, b = self, other
        return Moving(
            np.sum(a.value * b.value, -1),
            np.sum(a.value[..., None] * b.jacobian + b.value[..., None] * a.jacobian, -2),
            np.sum(a.rate * b.value + a.value * b.rate, -1),
            np.sum(a.gamma * b.value + 2 * a.rate * b.rate + a.value * b.gamma, -1),
        )

    def turned(self) -> Moving:
        """A vector turned by +90 degrees."""

        def turn(x: np.ndarray) -> np.ndarray:
            return np.stack([-x[..., 1], x[..., 0]], -1)

        return Moving(
            turn(self.value),
            np.stack([-self.jacobian[..., 1, :], self.jacobian[..., 0, :]], -2),
            turn(self.rate),
            turn(self.gamma),
        )

    def norm(self) -> Moving:
        """The length d of a vector, from d^2: 2 d d' = (d^2)', 2 d d'' + 2 d'^2 = (d^2)''."""
        square = self.dot(self)
        d = np.sqrt(square.value)
        rate = square.rate / (2 * d)
        return Moving(
            d, square.jacobian / (2 * d[..., None]), rate, (square.gamma - 2 * rate**2) / (2 * d)
        )


@dataclass(frozen=True)
class Terms:
    """Terms of the equations of motion, in the notation of the paper.

    The leading axes are those of the states that were passed to `EquationsOfMotion.at`; k is the number of coordinates.

    Attributes
    ----------
    QE : ndarray
        Applied forces, N and N m, shape (..., k). The coordinates are those of centres of mass, so M q'' is the only
        inertial term.
    phi : ndarray
        Residuals Phi of the constraints (m, rad), shape (..., rows).
    phi_dot : ndarray
        Their rates Phi', shape (..., rows).
    gamma : ndarray
        Remainder in Phi'' = J q'' + gamma, shape (..., rows).
    J : ndarray
        Jacobian of the constraints, shape (..., rows, k).
    W : ndarray
        Tangential direction of each frictional joint, shape (..., frictional, k): of a guide that of the slider's
        point, of a pin the relative rotation of its bodies, of a drive with a limit the derivative of its coordinate.
        W_T of the surfaces (+) and (-) of a guide is this row plus or minus b/2 times the row of J that belongs to the
        slider's angle.
    w : ndarray
        Remainder of the slip acceleration, g_T'' = W q'' + w, m/s² or rad/s², shape (..., frictional).
    slip_speed : ndarray
        Slip velocity g_T', m/s or rad/s, shape (..., frictional). That of a drive with a limit is relative to the rate
        of its law, and its w has the law's acceleration.
    """

    QE: np.ndarray
    phi: np.ndarray
    phi_dot: np.ndarray
    gamma: np.ndarray
    J: np.ndarray
    W: np.ndarray
    w: np.ndarray
    slip_speed: np.ndarray


def start_of(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates and velocities of a scene at t = 0, each of shape (3 * bodies,)."""
    bodies = scene.bodies.values()
    return (
        np.array([x for body in bodies for x in (*body.position, body.angle)], dtype=float),
        np.array(
            [x for body in bodies for x in (*body.velocity, body.angular_velocity)], dtype=float
        ),
    )


class EquationsOfMotion:
    """The equations of motion of a scene, in dense NumPy.

    The coordinates are x, y and angle of each body. Constraint rows are in the order of eq. (20) of the paper: revolute
    joints, guides, drives.

    Parameters
    ----------
    scene
        The scene.

    Attributes
    ----------
    rows : list of str
        Names of the constraint rows, for example ``pin.fx``, ``guide.normal_force``, ``guide.moment``,
        ``motor.effort``.
    frictional : dict of str to Revolute, Translational or Drive
        The frictional joints in the order of the scene, and behind them the drives with a limit.
    mass : ndarray
        The diagonal of M, kg and kg m², shape (k,).
    """

    def __init__(self, scene: Scene):
        self.scene, self.frictional = scene, scene.bounded_elements
        self.mass = np.array(
            [x for body in scene.bodies.values() for x in (body.mass, body.mass, body.inertia)]
        )
        self.rows = [
            f"{name}.{label}"
            for joints, labels in (
                (
                    [name for name, joint in scene.joints.items() if isinstance(joint, Revolute)],
                    ("fx", "fy"),
                ),
                (scene.guides, ("normal_force", "moment")),
                (scene.prescribed_drives, ("effort",)),
            )
            for name in joints
            for label in labels
        ]

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates q and velocities v at t = 0 as given by the scene, each of shape (k,)."""
        return start_of(self.scene)

    def at(self, t: float | np.ndarray, q: np.ndarray, v: np.ndarray) -> Terms:
        """Return the terms at one instant or, with leading axes, at many.

        Parameters
        ----------
        t : float or ndarray
            Time, s, shape (...,).
        q : ndarray
            Coordinates (m, rad), shape (..., k).
        v : ndarray
            Velocities (m/s, rad/s), shape (..., k).
        """
        motion = Motion(list(self.scene.bodies), np.asarray(t, dtype=float), q, v)
        scene, rows = self.scene, []
        along: dict[str, Moving] = {}
        for joint in scene.joints.values():
            if isinstance(joint, Revolute):
                d = motion.between(joint.bodies, joint.points)
                rows += [d[0], d[1]]  # (18), CR
        for name, guide in scene.guides.items():
            u = motion.direction(guide.guide, guide.direction)
            d = motion.between(guide.bodies, (guide.slider_point, guide.point))
            rows += [
                u.turned().dot(d),
                motion.angle(guide.slider)
                - motion.angle(guide.guide)
                - motion.constant(guide.angle),
            ]  # (18), CT
            along[name] = u.dot(d)  # (8), of the guide
        # (19); all rows: (20)
        rows += [motion.driven(drive) for drive in scene.prescribed_drives.values()]
        tangents = []
        for name, element in self.frictional.items():
            if isinstance(element, Drive):
                tangents.append(motion.coordinate(element) - motion.law(element.law))
            elif name in along:
                tangents.append(along[name])
            else:
                tangents.append(motion.angle(element.bodies[0]) - motion.angle(element.bodies[1]))
        return Terms(
            self._applied(motion),
            *_stacked(rows, motion, ("value", "rate", "gamma", "jacobian")),
            *_stacked(tangents, motion, ("jacobian", "gamma", "rate")),
        )

    def _applied(self, motion: Motion) -> np.ndarray:
        """QE of (21): gravity, springs, dampers, those of joints included, and loads."""
        gravity = self.scene.gravity or (0.0, 0.0)
        QE = np.zeros_like(motion.q) + self.mass * np.resize([*gravity, 0.0], len(self.mass))
        for spring in self.scene.springs_and_dampers.values():
            if spring.acts is not None:
                s = motion.coordinate(spring)
                tension = one_sided_tension(spring, s.value - spring.rest, s.rate)
                # where its ends meet a spring has no direction, and no force
                acts = tension[..., None] != 0.0
                QE -= np.where(acts, tension[..., None] * s.jacobian, 0.0)
            elif isinstance(spring, LinearSpring) and spring.axis is None:
                d = motion.between(spring.bodies, spring.points)
                QE -= spring.stiffness * np.sum(d.value[..., None] * d.jacobian, -2)
                if spring.rest_length or spring.damping:
                    s = d.norm()
                    pull = spring.damping * s.rate - spring.stiffness * spring.rest_length
                    # where its ends meet a spring has no direction, and none of this force
                    QE -= np.where(s.value[..., None] > 0.0, pull[..., None] * s.jacobian, 0.0)
            else:
                s = motion.coordinate(spring)
                QE -= (spring.stiffness * (s.value - spring.rest) + spring.damping * s.rate)[
                    ..., None
                ] * s.jacobian
        for load in self.scene.forces.values():
            size = motion.law(load.law).value[..., None]
            if isinstance(load, Force):
                u = np.array(load.direction) / np.hypot(*load.direction)
                QE += size * np.sum(u[:, None] * motion.point(load.body, load.point).jacobian, -2)
            else:
                QE += size * motion.angle(load.body).jacobian
        return QE


@dataclass(frozen=True)
class Motion:
    """Points, directions and angles of bodies at instants."""

    bodies: list[str]
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray

    def _turning(self, body: str, vector: tuple[float, float]) -> tuple[Moving, int]:
        """A vector fixed in a body, and the place of the body's coordinates (-1: ground).

        C' = omega k x c, c'' = -omega^2 c.
        """
        jacobian = np.zeros((*self.t.shape, 2, self.q.shape[-1]))
        if body == GROUND:
            return Moving(
                np.zeros((*self.t.shape, 2)) + vector, jacobian, *np.zeros((2, *self.t.shape, 2))
            ), -1
        i = 3 * self.bodies.index(body)
        cos, sin, omega = (
            np.cos(self.q[..., i + 2]),
            np.sin(self.q[..., i + 2]),
            self.v[..., i + 2, None],
        )
        c = np.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]], -1)
        jacobian[..., 0, i + 2], jacobian[..., 1, i + 2] = -c[..., 1], c[..., 0]
        return Moving(c, jacobian, omega * jacobian[..., i + 2], -(omega**2) * c), i

    def direction(self, body: str, vector: tuple[float, float]) -> Moving:
        """A unit vector fixed in a body."""
        return self._turning(body, tuple(np.array(vector) / np.hypot(*vector)))[0]

    def point(self, body: str, place: tuple[float, float]) -> Moving:
        """Place of a point of a body."""
        arm, i = self._turning(body, place)
        if i < 0:
            return arm
        arm.jacobian[..., 0, i] = arm.jacobian[..., 1, i + 1] = 1.0
        return Moving(
            arm.value + self.q[..., i : i + 2],
            arm.jacobian,
            arm.rate + self.v[..., i : i + 2],
            arm.gamma,
        )

    def between(self, bodies: tuple[str, str], points: tuple[tuple[float, float], ...]) -> Moving:
        """The vector from the second body's point to the first's."""
        return self.point(bodies[0], points[0]) - self.point(bodies[1], points[1])

    def angle(self, body: str) -> Moving:
        if body == GROUND:
            return self.constant(0.0)
        i = 3 * self.bodies.index(body) + 2
        jacobian = np.zeros_like(self.q)
        jacobian[..., i] = 1.0
        return Moving(self.q[..., i], jacobian, self.v[..., i], np.zeros(self.t.shape))

    def constant(self, value: float) -> Moving:
        return Moving(
            np.full(self.t.shape, value), np.zeros_like(self.q), *np.zeros((2, *self.t.shape))
        )

    def law(self, law: Law) -> Moving:
        value, rate, second = np.moveaxis(
            np.array([evaluate_law(law, t) for t in self.t.flat]), -1, 0
        )
        return Moving(
            value.reshape(self.t.shape),
            np.zeros_like(self.q),
            rate.reshape(self.t.shape),
            second.reshape(self.t.shape),
        )

    def driven(self, drive: Drive) -> Moving:
        """The constraint of a drive.

        There is no motion, and gamma is nan, where it drives a distance to zero or below.
        """
        law = self.law(drive.law)
        row = self.coordinate(drive) - law
        impossible = (law.value <= 0.0) & (drive.type == "distance" and drive.axis is None)
        return replace(row, gamma=np.where(impossible, np.nan, row.gamma))

    def coordinate(self, element: Drive | LinearSpring | TorsionalSpring) -> Moving:
        """The coordinate of a drive or spring: an angle, the part of a distance along an axis, or a distance."""
        if isinstance(element, TorsionalSpring) or element.type == "angle":
            return self.angle(element.bodies[0]) - self.angle(element.bodies[1])
        d = self.between(element.bodies, element.points)
        return (
            d.norm()
            if element.axis is None
            else self.direction(element.bodies[1], element.axis).dot(d)
        )


def one_sided_tension(
    spring: LinearSpring | TorsionalSpring, stretch: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Return the tension (N or N m) of a spring that acts on one side only, by its stretch and the rate of that.

    It is that of spring and damper where the stretch and this tension are both on the spring's side, and else zero: a
    stop does not pull, and a cable does not push.
    """
    tension = spring.stiffness * stretch + spring.damping * rate
    return np.where((spring.side * stretch > 0.0) & (spring.side * tension > 0.0), tension, 0.0)


def _stacked(rows: list[Moving], motion: Motion, parts: tuple[str, ...]) -> list[np.ndarray]:
    """The parts of all rows, shape (..., rows) and, of jacobians, (..., rows, k)."""
    axis, rows = (
        motion.t.ndim,
        [motion.constant(0.0), *rows],
    )  # the first has the shape where there are no others
    return [
        np.delete(np.stack([getattr(row, part) for row in rows], axis), 0, axis) for part in parts
    ]
