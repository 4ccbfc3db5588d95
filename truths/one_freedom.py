"""The motion of a mechanism of one degree of freedom with frictional guides until it rests, without the reference.

Constraints Phi(q) = 0 leave one direction N: J N = 0, N^T M N = 1. So v = N u, and u^2 / 2 is the kinetic energy. As
N^T M N' = 0 along the path, and reactions have no power along N (virtual work),

    q' = N u,   u' = N^T (Q + W^T f),   W: rows of the slips,   f: friction on each slider

J M^-1 (Q + W^T f + J^T lambda) = -gamma (Newton-Euler, dense) makes normal forces R and moments T linear in f.
Coulomb's law needs the corner forces n = R/2 -+ (T + (b/2) mu d R)/a, without the surface friction's own moment:
f = -mu d (|n1| + |n2|). Signs of n and of the slips W N u are frozen between located events. N is turned so that u > 0.

Where u is zero all guides are at rest at once, as every slip is a multiple of u. The law is then the paper's: the
problem with static coefficients for all guides at rest.

- They stay if there are frictions within mus on the surfaces with u' = 0: linear programmes over the surface frictions,
  one for each choice of corner signs.
- They leave to a side if mus fully mobilized against it leaves u' of that side; from then on they have mu.

Where more than one of these is possible the scene has several motions, and the search ends. Loads do not depend
on time: what is at rest stays there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp
from scipy.optimize import linprog

from stiction.scenes import Scene, StictionError
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant
from stiction.scenes.model import LinearSpring, Revolute, Torque

TOLERANCE = 1e-12
"""Tolerance of a step, relative and absolute."""
LONGEST_STEP = 0.05
"""Seconds: margins of a mode are looked at between steps only."""
NOISE = 100
"""Tolerances, of the largest corner force, that the errors of a hundred steps leave of one that passes zero."""
CLEAR_OF_JAMMING = 0.2
"""Determinant of the equations for friction; 1 without friction, 0 where a motion is not unique (Painleve)."""
CLEAR_OF_SINGULAR = 0.05
"""Smallest singular value of the constraints' Jacobian with rows of length 1: forces magnified twentyfold at most."""
CLEAR_OF_LIMIT = 1e-3
"""Distance from the limit of static friction, in units of the acceleration without friction: a million times the
error."""


class NoClearMotion(StictionError):
    """Carries why a scene has no motion that ends at rest and could not be another one."""


@dataclass(frozen=True)
class Terms:
    """Terms of an instant: direction N; u' = p0 + p f; slips p u; R and T, (2, guides), are load0 + load f."""

    N: np.ndarray
    p0: float
    p: np.ndarray
    load0: np.ndarray
    load: np.ndarray


@dataclass(frozen=True)
class Piece:
    """The motion between two events: sides d to which guides slip, signs s of corner forces, y = (q, u) over time."""

    begin: float
    end: float
    d: np.ndarray
    s: np.ndarray
    y: OdeSolution


@dataclass(frozen=True)
class Instant:
    """An event, corners left out; an error e of the motion, by its size, shifts the time by e / rate."""

    time: float
    kind: str
    joint: str
    rate: float


@dataclass(frozen=True)
class Motion:
    """The motion from the start to the instant `rest`, at which the mechanism comes to rest at the position q."""

    equations: OneFreedom
    pieces: tuple[Piece, ...]
    events: tuple[Instant, ...]
    rest: float
    q: np.ndarray

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Position; normal force and friction of each guide, (2, guides), before the rest."""
        piece, m = next(piece for piece in self.pieces if t <= piece.end), self.equations
        q, u = np.split(piece.y(t), [-1])
        terms = m.terms(q, u[0], piece.d)
        f = m.friction(terms, piece.d, piece.s, m.mu)[0]
        return q, np.array([terms.load0[0] + terms.load[0] @ f, f])


def dot(a: Any, b: Any) -> Any:
    """Scalar product of planar vectors, which are complex numbers here."""
    return (np.conj(a) * b).real


class OneFreedom:
    """Equations of pins, frictional guides, weight, springs with dampers and constant loads."""

    def __init__(self, scene: Scene):
        self.scene, self.guides = scene, list(scene.frictional_guides)
        self.index = {name: i for i, name in enumerate([*scene.bodies, GROUND])}
        bodies = scene.bodies.values()
        self.mass = np.array([m for body in bodies for m in (body.mass, body.mass, body.inertia)])
        self.start = np.array([x for body in bodies for x in (*body.position, body.angle)])
        self.start_rate = np.array(
            [x for body in bodies for x in (*body.velocity, body.angular_velocity)]
        )
        pins = [joint for joint in scene.joints.values() if isinstance(joint, Revolute)]
        guides = list(scene.frictional_guides.values())
        k, self.pins = len(guides), 2 * len(pins)
        if (
            self.pins + 2 * k != len(self.mass) - 1
            or k + len(pins) != len(scene.joints)
            or scene.drives
        ):
            raise NoClearMotion("expected pins and frictional guides that leave one freedom")
        if any(
            isinstance(spring, LinearSpring) and spring.axis is not None
            for spring in scene.springs.values()
        ):
            raise NoClearMotion("expected springs between points, without an axis")
        # a row is the distance of a point of body[0] from one of body[1] in a direction that turns with its carrier
        rows = [(pin.bodies, pin.points, e, GROUND) for pin in pins for e in (1, 1j)]
        for side in (1j, 1):  # across the guides, then along them
            rows += [
                (g.bodies, (g.slider_point, g.point), side * complex(*g.direction), g.guide)
                for g in guides
            ]
        self.body = np.array([[self.index[name] for name in of] for of, *_ in rows]).T
        self.point = np.array([[complex(*point) for point in points] for _, points, *_ in rows]).T
        self.direction = np.array([e / abs(e) for *_, e, _ in rows])
        self.carrier = np.array([self.index[name] for *_, name in rows])
        self.angle, self.angle_rows = (
            np.array([guide.angle for guide in guides]),
            np.zeros((k, len(self.mass) + 3)),
        )
        for row, guide in zip(self.angle_rows, guides):
            row[3 * self.index[guide.slider] + 2], row[3 * self.index[guide.guide] + 2] = 1, -1
        self.mu = np.array([guide.kinetic_coefficient for guide in guides])
        self.mus = np.array([guide.static_coefficient for guide in guides])
        self.long = np.array([guide.length is not None for guide in guides])
        self.of_T = np.array(
            [[-1 / guide.length, 1 / guide.length] if guide.length else [0, 0] for guide in guides]
        )
        self.lever = np.array([(guide.width or 0.0) / 2 for guide in guides])
        corners = [product((1, -1), repeat=2) if long else ((1, 1), (-1, -1)) for long in self.long]
        self.signs = np.array(list(product(*corners)))

    def rows(
        self, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Residuals and Jacobian of constraints, then of the ways along the guides; gamma as a function of velocities.

        Constraints of pins come first, then those across the guides, then their angles.
        """
        k, q = len(self.guides), np.concatenate([q, np.zeros(3)])
        turn, m = np.exp(1j * q[2::3]), np.arange(len(self.direction))
        e, arm = self.direction * turn[self.carrier], self.point * turn[self.body]
        ends = (q[0::3] + 1j * q[1::3])[self.body] + arm
        r = ends[0] - ends[1]
        J = np.zeros((len(m), len(q)))
        for b, a, sign in zip(self.body, arm, (1, -1)):
            for column, value in enumerate((e.real, e.imag, dot(e, 1j * a))):
                J[m, 3 * b + column] += sign * value
        J[m, 3 * self.carrier + 2] += dot(1j * e, r)

        def gamma(v: np.ndarray) -> np.ndarray:
            v = np.concatenate([v, np.zeros(3)])
            spin, turns = v[2::3][self.body], v[2::3][self.carrier]
            rate, bend = (v[0::3] + 1j * v[1::3])[self.body] + 1j * spin * arm, spin**2 * arm
            there = (
                dot(-(turns**2) * e, r)
                + 2 * dot(1j * turns * e, rate[0] - rate[1])
                - dot(e, bend[0] - bend[1])
            )
            return np.concatenate([there[:-k], np.zeros(k)])

        def stacked(values: np.ndarray, of_angles: np.ndarray) -> np.ndarray:
            return np.concatenate([values[:-k], of_angles, values[-k:]])

        return (
            stacked(dot(e, r), self.angle_rows @ q - self.angle),
            stacked(J, self.angle_rows)[:, :-3],
            gamma,
        )

    def applied(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Generalized applied forces Q."""
        q, v, Q = np.append(q, [0, 0, 0]), np.append(v, [0, 0, 0]), np.zeros(len(q) + 3)

        def end(body: int, point: tuple[float, float]) -> tuple[complex, complex, complex]:
            k, arm = 3 * body, complex(*point) * np.exp(1j * q[3 * body + 2])
            return arm, complex(*q[k : k + 2]) + arm, complex(*v[k : k + 2]) + 1j * v[k + 2] * arm

        def push(body: int, arm: complex, force: complex) -> None:
            Q[3 * body : 3 * body + 3] += force.real, force.imag, dot(1j * arm, force)

        for column, g in enumerate(self.scene.gravity or ()):
            Q[column:-3:3] += self.mass[column::3] * g
        for spring in self.scene.springs.values():
            i, j = (self.index[name] for name in spring.bodies)
            if isinstance(spring, LinearSpring):
                (arm, at, rate), (other_arm, other, other_rate) = (
                    end(i, spring.points[0]),
                    end(j, spring.points[1]),
                )
                length, line = abs(at - other), (at - other) / abs(at - other)
                force = spring.stiffness * (length - spring.rest_length) + spring.damping * dot(
                    line, rate - other_rate
                )
                push(i, arm, -force * line)
                push(j, other_arm, force * line)
            else:
                angle, rate = (x[3 * i + 2] - x[3 * j + 2] for x in (q, v))
                torque = spring.stiffness * (angle - spring.rest_angle) + spring.damping * rate
                Q[3 * i + 2] -= torque
                Q[3 * j + 2] += torque
        for load in self.scene.forces.values():
            if not isinstance(load.law, Constant):
                raise NoClearMotion("expected constant loads")
            b = self.index[load.body]
            if isinstance(load, Torque):
                Q[3 * b + 2] += load.law.value
            else:
                line = complex(*load.direction)
                push(b, end(b, load.point)[0], load.law.value * line / abs(line))
        return Q[:-3]

    def terms(self, q: np.ndarray, u: float, d: np.ndarray) -> Terms:
        """The equation of motion where the guides slip to the sides d, or would."""
        k, root = len(self.guides), np.sqrt(self.mass)
        _, rows, gamma = self.rows(q)
        U, S, V = np.linalg.svd(rows[:-k] / root)  # of J M^-1/2; the last right vector is M^1/2 N
        N = V[-1] / root
        p = rows[-k:] @ N
        surest = np.argmax(np.abs(p))
        N, p = (x * np.sign(p[surest]) * d[surest] for x in (N, p))
        forces = np.column_stack([self.applied(q, N * u), rows[-k:].T])
        reaction = -U @ (V[:-1] @ (forces / root[:, None]) / S[:, None])
        reaction[:, 0] -= U @ (U.T @ gamma(N * u) / S**2)
        loads = reaction[self.pins :].reshape(2, k, 1 + k)
        return Terms(N, N @ forces[:, 0], p, loads[..., 0], loads[..., 1:])

    def distance_to_singular(self, q: np.ndarray) -> float:
        """Smallest singular value of the constraints' Jacobian, see `CLEAR_OF_SINGULAR`."""
        J = self.rows(q)[1][: -len(self.guides)] / np.sqrt(self.mass)
        return float(np.linalg.svd(J / np.linalg.norm(J, axis=1)[:, None], compute_uv=False)[-1])

    def onto_constraints(self, q: np.ndarray) -> np.ndarray:
        """The position without the integrator's error, moved in the metric of the mass matrix."""
        for _ in range(2):
            phi, rows = (x[: -len(self.guides)] for x in self.rows(q)[:2])
            q = q - np.linalg.pinv(rows / np.sqrt(self.mass)) @ phi / np.sqrt(self.mass)
        return q

    def friction(
        self, terms: Terms, d: np.ndarray, s: np.ndarray, mu: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Friction (.., k), corner forces (.., k, 2), matrix of their equations; for sides d and corner signs s."""
        of_R = 0.5 + self.of_T * (self.lever * mu * d)[:, None]
        n0 = of_R * terms.load0[0][:, None] + self.of_T * terms.load0[1][:, None]
        n1 = (
            of_R[..., None] * terms.load[0][:, None] + self.of_T[..., None] * terms.load[1][:, None]
        )
        A = np.eye(len(d)) + (mu * d)[:, None] * np.sum(s[..., None] * n1, -2)
        f = np.linalg.solve(A, -(mu * d * np.sum(s * n0, -1))[..., None])[..., 0]
        return f, n0 + np.einsum("kjl,...l->...kj", n1, f), A

    def mode(self, terms: Terms, d: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corner signs and friction for slips to the sides d; unique, as no corner signs are near to jamming."""
        f, n, A = self.friction(terms, d, self.signs, mu)
        if np.linalg.det(A).min() < CLEAR_OF_JAMMING:
            raise NoClearMotion("nearly jams")
        best = np.argmax(np.min(self.signs * n, axis=(1, 2)))
        return self.signs[best], f[best]

    def held(self, terms: Terms) -> tuple[bool, float]:
        """Tell whether friction within the static cones can hold the mechanism; the distance from the limit, as u'."""
        k, reach = len(self.guides), []
        # unknown: frictions x of the lower surfaces, then of the upper
        both, difference = np.tile(np.eye(k), 2), np.hstack([np.eye(k), -np.eye(k)])
        for s in self.signs:
            n0 = 0.5 * terms.load0[0][:, None] + self.of_T * terms.load0[1][:, None]
            n1 = (
                0.5 * terms.load[0][:, None] + self.of_T[..., None] * terms.load[1][:, None]
            ) @ both
            n1 -= (self.of_T * self.lever[:, None])[..., None] * difference[:, None]
            pressed0, pressed1 = s * n0, s[..., None] * n1
            A, b = [*-pressed1.reshape(-1, 2 * k)], [*pressed0.ravel()]
            for i, surface, side in product(range(k), range(2), (1, -1)):
                on = s[i] == (1, -1)[surface]
                A.append(
                    side * np.eye(2 * k)[i + k * surface] - self.mus[i] * pressed1[i][on].sum(0)
                )
                b.append(self.mus[i] * pressed0[i][on].sum())
            ends = [
                linprog(way * terms.p @ both, np.array(A), np.array(b), bounds=(None, None))
                for way in (1, -1)
            ]
            if all(end.status == 0 for end in ends):
                reach.append([terms.p0 + ends[0].fun, terms.p0 - ends[1].fun])
        inside = [min(-low, high) for low, high in reach if low <= 0 <= high]
        return bool(inside), max(inside) if inside else float(np.min(np.abs(reach), initial=np.inf))

    def sides(self, q: np.ndarray) -> np.ndarray | None:
        """The sides to which the guides leave rest; None if they stay."""
        terms = self.terms(q, 0.0, np.ones(len(self.guides)))
        held, margin = self.held(terms)
        found: list[np.ndarray | None] = [None] if held else []
        for way in (1, -1):
            d = way * np.sign(terms.p)
            rate = way * (terms.p0 + terms.p @ self.mode(terms, d, self.mus)[1])
            margin = min(margin, abs(rate))
            found += [d] if rate > 0 else []
        if len(found) != 1:
            raise NoClearMotion("several motions" if found else "no motion")
        if margin < CLEAR_OF_LIMIT * np.sqrt(
            np.sum(self.applied(q, np.zeros(len(q))) ** 2 / self.mass)
        ):
            raise NoClearMotion("near the limit of static friction")
        return found[0]


def simulate(
    scene: Scene, t_end: float, tolerance: float = TOLERANCE, longest: float = LONGEST_STEP
) -> Motion:
    """The motion of a scene; `tolerance` is of a step, which has at most `longest` seconds.

    Raises
    ------
    NoClearMotion
        If it begins at rest or is not there before `t_end`, is not unique, near to jamming or a singular position, or
        an event is nearly missed.
    """
    m, t, u, d = OneFreedom(scene), 0.0, 0.0, None
    q, pieces, events, fastest = m.start, [], [], 0.0
    if m.start_rate.any():
        u, d = (
            float(np.sqrt(m.mass @ m.start_rate**2)),
            np.sign(m.rows(q)[1][-len(m.guides) :] @ m.start_rate),
        )
    elif (d := m.sides(q)) is None:
        raise NoClearMotion("begins at rest")
    s = m.mode(m.terms(q, u, d), d, m.mu)[0]
    while True:
        piece, margin, last = _piece(m, t, np.append(q, u), d, s, t_end, tolerance, longest)
        pieces.append(piece)
        t, q, u = piece.end, m.onto_constraints(last[:-1]), last[-1]
        fastest = max([fastest, *piece.y(np.linspace(piece.begin, t, 20))[-1]])
        terms = m.terms(q, u, d)
        if margin == "speed":
            rate, turned = (
                abs(terms.p0 + terms.p @ m.friction(terms, d, s, m.mu)[0]) / fastest,
                m.sides(q),
            )
            events += [
                Instant(t, "stick" if turned is None else "reversal", name, rate)
                for name in m.guides
            ]
            if turned is None:
                return Motion(m, tuple(pieces), tuple(events), t, q)
            d, u = turned, 0.0
        elif isinstance(margin, int):  # a dead point of one guide
            before, after = (m.terms(q + way * 1e-6 * terms.N, u, d).p[margin] for way in (-1, 1))
            rate = abs(after - before) / 2e-6 * u / np.max(np.abs(terms.p))
            events.append(Instant(t, "reversal", m.guides[margin], rate))
            if events[-1].rate < 0.1:
                raise NoClearMotion("a slip grazes zero")
            d = np.where(np.arange(len(d)) == margin, -d, d)
        if isinstance(margin, tuple):
            # continuous where it passes zero; both of a guide may pass with R
            n = m.friction(terms, d, s, m.mu)[1]
            passing = (np.abs(n) <= NOISE * tolerance * np.max(np.abs(n)))[margin[0]] | ~m.long[
                margin[0]
            ]
            passing[margin[1]] = True
            s = s.copy()
            s[margin[0]] = np.where(passing, -s[margin[0]], s[margin[0]])
        else:
            s = m.mode(m.terms(q, u, d), d, m.mu)[0]


def _piece(
    m: OneFreedom,
    t: float,
    y: np.ndarray,
    d: np.ndarray,
    s: np.ndarray,
    t_end: float,
    tolerance: float,
    longest: float,
) -> tuple[Piece, Any, np.ndarray]:
    """The motion until a margin passes zero: "speed", the number of a guide, or guide and corner; the state there."""
    names: list[Any] = [
        "speed",
        *range(len(d)),
        *((i, j) for i in range(len(d)) for j in range(2 if m.long[i] else 1)),
    ]
    last: dict[tuple[float, float], np.ndarray] = {}

    def derivative(_: float, y: np.ndarray) -> np.ndarray:
        terms = m.terms(y[:-1], y[-1], d)
        return np.append(terms.N * y[-1], terms.p0 + terms.p @ m.friction(terms, d, s, m.mu)[0])

    def margins(t: float, y: np.ndarray) -> np.ndarray:
        if (t, y[-1]) not in last:
            terms = m.terms(y[:-1], y[-1], d)
            n = s * m.friction(terms, d, s, m.mu)[1]
            last.clear()
            last[t, y[-1]] = np.array(
                [
                    y[-1],
                    *(d * terms.p),
                    *(n[name] for name in names[1 + len(d) :]),
                    m.distance_to_singular(y[:-1]) - CLEAR_OF_SINGULAR,
                ]
            )
        return last[t, y[-1]]

    def event(i: int) -> Any:
        def value(t: float, y: np.ndarray) -> float:
            return float(margins(t, y)[i])

        vars(value).update(terminal=True, direction=-1)
        return value

    if margins(t, y)[-1] < 0:
        raise NoClearMotion("near a singular position")
    found = solve_ivp(
        derivative,
        (t, t_end),
        y,
        "DOP853",
        rtol=tolerance,
        atol=tolerance,
        max_step=longest,
        dense_output=True,
        events=[event(i) for i in range(len(names) + 1)],
    )
    if found.status != 1 or len(found.t_events[-1]):
        raise NoClearMotion(
            "near a singular position" if found.status == 1 else "does not come to rest"
        )
    for time, state in zip(found.t[1:-1], found.y.T[1:-1]):
        if np.any(margins(time, state) < 0) or np.any(
            m.mode(m.terms(state[:-1], state[-1], d), d, m.mu)[0] != s
        ):
            raise NoClearMotion("a margin grazes zero")
    passed = next(i for i, times in enumerate(found.t_events) if len(times))
    return Piece(t, float(found.t[-1]), d, s, found.sol), names[passed], found.y[:, -1]
