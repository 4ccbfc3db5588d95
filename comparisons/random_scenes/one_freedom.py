"""Mechanisms of one degree of freedom with two or three frictional guides, drawn so that friction brings them to rest; the reference held to
a motion found without any of its code.

Families: a rod between two sliders; a crank that drives two sliders by rods; a plate on two sliders, joined by a rod to a third; a guide
carried by a rocking link or by another slider, with or without a rod to one more slider.

The motion. Constraints Phi(q) = 0 leave one direction: J N = 0, N^T M N = 1, so that v = N u with u^2 / 2 the kinetic energy. As
N^T M N' = 0 along the path, and reactions have no power along N (virtual work),

    q' = N u,   u' = N^T (Q + W^T f),   W: the slip of each guide,   f: friction on each slider

J M^-1 (Q + W^T f + J^T lambda) = -gamma (Newton-Euler, dense) makes each normal force R and moment T linear in f. Coulomb's law with the
corner forces n = R/2 -+ (T + (b/2) mu d R)/a, the surface friction's own moment taken off T: f = -mu d (|n1| + |n2|). Signs of n, and of the
slips W N u, are frozen between located events. N is turned so that u > 0.

Rest. Where u is zero all guides rest at once, as each slip is W N u. The law is the paper's, the problem with static coefficients for all
guides at rest: they stay if frictions within mus on the surfaces exist with which u' is zero, by linear programmes over surface frictions for
each choice of corner signs; else all slip to the side to which u' has its own sign with mus fully mobilized, and have mu from then on. If the
first and the second are both possible, or the second to both sides, the scene has several motions, and none is drawn that has. Loads do not
depend on time: what rests, rests for ever.

    python -m stiction.comparisons.random_scenes.one_freedom --count 1000 --seed 0
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import Any

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp
from scipy.optimize import brentq, linprog

from stiction.comparisons.random_scenes.drawn_scenes import Study, Verdict
from stiction.comparisons.random_scenes.random_mechanisms import SeededDice
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.scenes.laws import Constant
from stiction.scenes.model import Force, LinearSpring, Revolute

TOLERANCE = 1e-12
"""Of a step of the independent motion."""
OWN_ERROR = 1e-9
"""Of the independent motion, relative: some hundred steps of `TOLERANCE`, and an amplification by ten."""
RESERVE = 1e3
"""How much larger than rtol the error of a run may be, relative to the size of what is compared."""
LONGEST_STEP = 0.05
"""Seconds: margins of a mode are looked at between steps only."""
STABILIZATIONS = ("none", "baumgarte", "projection")
GROUND = "ground"


class NotDrawn(Exception):
    """A scene that is not what is to be drawn, with the reason."""


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product of planar vectors, which are complex numbers here."""
    return (np.conj(a) * b).real


@dataclass(frozen=True)
class Terms:
    """At an instant: the direction N, u' = p0 + p f, slips = p u, R and T = (2, guides) `load0` + `load` f, and what reactions come from."""

    N: np.ndarray
    p0: float
    p: np.ndarray
    load0: np.ndarray
    load: np.ndarray


class OneFreedom:
    """Equations of a scene's mechanism: revolute joints, frictional guides, weight, springs and dampers, constant loads."""

    def __init__(self, scene: Scene):
        self.names, self.guides = list(scene.bodies), list(scene.frictional_guides)
        self.scene, n = scene, len(self.names)
        self.index = {name: i for i, name in enumerate([*self.names, GROUND])}
        bodies = scene.bodies.values()
        self.mass = np.array([m for body in bodies for m in (body.mass, body.mass, body.inertia)])
        self.start = np.array([x for body in bodies for x in (*body.position, body.angle)])
        self.start_rate = np.array([x for body in bodies for x in (*body.velocity, body.angular_velocity)])
        pins = [joint for joint in scene.joints.values() if isinstance(joint, Revolute)]
        guides = [scene.joints[name] for name in self.guides]
        along = [complex(*guide.direction) / abs(complex(*guide.direction)) for guide in guides]
        ends = [(pin.bodies, pin.points, e, GROUND) for pin in pins for e in (1, 1j)]
        for side in (1j, 1):  # across, then along the guides
            ends += [(guide.bodies, (guide.slider_point, guide.point), side * d, guide.guide) for guide, d in zip(guides, along)]
        self.body = np.array([[self.index[name] for name in of] for of, *_ in ends]).T
        self.point = np.array([[complex(*point) for point in points] for _, points, *_ in ends]).T
        self.direction, self.carrier = np.array([e for *_, e, _ in ends]), np.array([self.index[name] for *_, name in ends])
        k, self.pins = len(guides), 2 * len(pins)
        self.turn_row = np.zeros((k, 3 * n + 3))
        for i, guide in enumerate(guides):
            self.turn_row[i, 3 * self.index[guide.slider] + 2], self.turn_row[i, 3 * self.index[guide.guide] + 2] = 1, -1
        self.angle = np.array([guide.angle for guide in guides])
        if self.pins + 2 * k != 3 * n - 1 or len(guides) + len(pins) != len(scene.joints) or scene.drives:
            raise NotDrawn("expected revolute joints and frictional guides that leave one freedom")
        self.mu = np.array([guide.mu for guide in guides])
        self.mus = np.array([guide.static_coefficient for guide in guides])
        self.per_length = np.array([1 / guide.length if guide.length else 0.0 for guide in guides])
        self.lever = np.array([(guide.width or 0.0) / 2 for guide in guides])
        self.half = np.array([-1, 1]) * self.per_length[:, None] * np.ones((k, 2))
        self.signs = np.array(list(product(*([s for s in product((1, -1), repeat=2) if a or s[0] == s[1]] for a in self.per_length))))

    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Residuals and Jacobian of the constraints, then of the ways along the guides; second derivatives of the constraints at q'' = 0, of q'."""
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
        J = np.concatenate([J[:-k], self.turn_row, J[-k:]])

        def second(v: np.ndarray) -> np.ndarray:
            v = np.concatenate([v, np.zeros(3)])
            spin, turns = v[2::3][self.body], v[2::3][self.carrier]
            rates = (v[0::3] + 1j * v[1::3])[self.body] + 1j * spin * arm
            there = dot(-turns ** 2 * e, r) + 2 * dot(1j * turns * e, rates[0] - rates[1]) - dot(e, spin[0] ** 2 * arm[0] - spin[1] ** 2 * arm[1])
            return np.concatenate([there[:-k], np.zeros(k)])

        way = dot(e, r)
        return np.concatenate([way[:-k], self.turn_row @ q - self.angle, way[-k:]]), J[:, :-3], second

    def applied(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Generalized applied forces."""
        Q = np.zeros(len(self.mass) + 3)
        q, v = np.append(q, [0, 0, 0]), np.append(v, [0, 0, 0])

        def push(body: int, arm: complex, force: complex, torque: float = 0.0) -> None:
            Q[3 * body:3 * body + 3] += force.real, force.imag, dot(1j * arm, force) + torque

        if self.scene.gravity is not None:
            for k, g in enumerate(self.scene.gravity):
                Q[k:-3:3] += self.mass[k::3] * g
        for spring in self.scene.springs.values():
            (i, j) = bodies = [self.index[name] for name in spring.bodies]
            if isinstance(spring, LinearSpring):
                arms = [complex(*point) * np.exp(1j * q[3 * b + 2]) for b, point in zip(bodies, spring.points)]
                ends = [complex(*q[3 * b:3 * b + 2]) + arm for b, arm in zip(bodies, arms)]
                rates = [complex(*v[3 * b:3 * b + 2]) + 1j * v[3 * b + 2] * arm for b, arm in zip(bodies, arms)]
                d, line = abs(ends[0] - ends[1]), (ends[0] - ends[1]) / abs(ends[0] - ends[1])
                force = -(spring.stiffness * (d - spring.rest_length) + spring.damping * dot(line, rates[0] - rates[1])) * line
                push(i, arms[0], force)
                push(j, arms[1], -force)
            else:
                torque = -(spring.stiffness * (q[3 * i + 2] - q[3 * j + 2] - spring.rest_angle) + spring.damping * (v[3 * i + 2] - v[3 * j + 2]))
                push(i, 0j, 0j, torque)
                push(j, 0j, 0j, -torque)
        for load in self.scene.forces.values():
            if not isinstance(load, Force) or not isinstance(load.law, Constant):
                raise NotDrawn("expected constant forces")
            b, line = self.index[load.body], complex(*load.direction)
            push(b, complex(*load.point) * np.exp(1j * q[3 * b + 2]), load.law.value * line / abs(line))
        return Q[:-3]

    def terms(self, q: np.ndarray, u: float, d: np.ndarray) -> Terms:
        """The equation of motion where the guides slip to the sides d, or would."""
        k, root = len(self.guides), np.sqrt(self.mass)
        _, rows, second = self.rows(q)
        U, S, V = np.linalg.svd(rows[:-k] / root)  # the last right vector is M^1/2 N
        N = V[-1] / root
        p = rows[-k:] @ N
        surest = np.argmax(np.abs(p))
        N, p = (x * np.sign(p[surest]) * d[surest] for x in (N, p))
        forces = np.column_stack([self.applied(q, N * u), rows[-k:].T])
        reaction = -U @ (V[:-1] @ (forces / root[:, None]) / S[:, None])
        reaction[:, 0] -= U @ (U.T @ second(N * u) / S ** 2)
        loads = reaction[self.pins:].reshape(2, k, 1 + k)
        return Terms(N, N @ forces[:, 0], p, loads[..., 0], loads[..., 1:])

    def distance_to_singular(self, q: np.ndarray) -> float:
        """The smallest singular value of the constraints' Jacobian, each row of length 1 in the metric of the mass matrix."""
        J = self.rows(q)[1][:-len(self.guides)] / np.sqrt(self.mass)
        return float(np.linalg.svd(J / np.linalg.norm(J, axis=1)[:, None], compute_uv=False)[-1])

    def onto_constraints(self, q: np.ndarray) -> np.ndarray:
        """The nearest position, in the metric of the mass matrix, that satisfies the constraints; q has an integrator's error."""
        for _ in range(2):
            phi, rows = (x[:-len(self.guides)] for x in self.rows(q)[:2])
            q = q - np.linalg.pinv(rows / np.sqrt(self.mass)) @ phi / np.sqrt(self.mass)
        return q

    def friction(self, terms: Terms, d: np.ndarray, s: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Friction f (.., k) and corner forces n (.., k, 2) of guides that slip to the sides d with corner signs s (.., k, 2); the matrix
        of the linear equations for f, the unit matrix without friction."""
        of_R, of_T = 0.5 + self.half * (self.lever * mu * d)[:, None], self.half
        n0 = of_R * terms.load0[0][:, None] + of_T * terms.load0[1][:, None]
        n1 = of_R[..., None] * terms.load[0][:, None] + of_T[..., None] * terms.load[1][:, None]
        A = np.eye(len(d)) + (mu * d)[:, None] * np.sum(s[..., None] * n1, -2)
        f = np.linalg.solve(A, -(mu * d * np.sum(s * n0, -1))[..., None])[..., 0]
        return f, n0 + np.einsum("kjl,...l->...kj", n1, f), A

    def corners(self, terms: Terms, d: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signs of the corner forces and friction where the guides slip to the sides d.

        Raises
        ------
        NotDrawn
            Where some signs are near to not leaving a unique solution: the mechanism may jam.
        """
        f, n, A = self.friction(terms, d, self.signs, mu)
        if np.linalg.det(A).min() < 0.2:
            raise NotDrawn("nearly jams")
        worst = np.min(self.signs * n, axis=(1, 2))
        best = np.argmax(worst)
        if worst[best] < -1e-9 * np.abs(n).max():
            raise NotDrawn("no solution")
        return self.signs[best], f[best]

    def held(self, terms: Terms) -> tuple[bool, float]:
        """Whether friction within the static cones can hold the mechanism, and how far that is from being otherwise, in u'."""
        k = len(self.guides)
        # unknown: friction of the lower and the upper surface of each guide, of which f is the sum
        total, difference = np.tile(np.eye(k), 2), np.hstack([np.eye(k), -np.eye(k)])
        reach = []
        for signs in self.signs:
            A, b = [], []
            for i, j in product(range(k), range(2)):
                half = self.half[i, j]
                row = (0.5 * terms.load[0, i] + half * terms.load[1, i]) @ total - half * self.lever[i] * difference[i]
                A.append(-signs[i, j] * row)  # corner force n = b + row x of the sign s
                b.append(signs[i, j] * (0.5 * terms.load0[0, i] + half * terms.load0[1, i]))
            corners, known = np.array(A).reshape(k, 2, -1), np.array(b).reshape(k, 2)
            for i, surface, side in product(range(k), range(2), (1, -1)):
                press = signs[i] == (1, -1)[surface]
                A.append(side * np.eye(2 * k)[i + k * surface] + self.mus[i] * np.sum(corners[i][press], axis=0))
                b.append(self.mus[i] * np.sum(known[i][press]))
            found = [linprog(way * terms.p @ total, np.array(A), np.array(b), bounds=(None, None)) for way in (1, -1)]
            if all(one.status == 0 for one in found):
                reach.append([terms.p0 + way * one.fun for way, one in zip((1, -1), found)])
        low, high = np.array(reach).T
        inside = [(a, b) for a, b in zip(low, high) if a <= 0 <= b]
        if inside:
            return True, max(min(-a, b) for a, b in inside)
        return False, float(min(np.min(np.abs(low)), np.min(np.abs(high))))


@dataclass(frozen=True)
class Piece:
    """The motion between two events; `d` and `s` as of `OneFreedom.friction`, y = (q, u)."""

    begin: float
    end: float
    d: np.ndarray
    s: np.ndarray
    y: OdeSolution


@dataclass(frozen=True)
class Motion:
    """From the start until the mechanism is at rest.

    Attributes
    ----------
    pieces : tuple of Piece
    events : tuple of (time, kind, guide, rate)
        As `stiction.scenes.Event` but for corners; `rate` of what passed zero, by its size: an error e of it shifts the time by e / rate.
    rest : float
        When it comes to rest, s.
    q : ndarray
        Where.
    """

    equations: OneFreedom
    pieces: tuple[Piece, ...]
    events: tuple[tuple[float, str, str, float], ...]
    rest: float
    q: np.ndarray


def simulate(scene: Scene, t_end: float, tolerance: float = TOLERANCE) -> Motion:
    """The motion of a scene; `tolerance` is of a step.

    Raises
    ------
    NotDrawn
        If it is not at rest before `t_end`, has several motions, is near to jamming or to a singular position, or an event is a near miss.
    """
    m = OneFreedom(scene)
    pieces, events, t, q, fastest = [], [], 0.0, m.start, 0.0
    u = float(np.sqrt(np.sum(m.mass * m.start_rate ** 2)))
    d = _side(m, q) if u == 0 else np.sign(m.rows(q)[1][-len(m.guides):] @ m.start_rate)
    if d is None:
        raise NotDrawn("begins at rest")
    s = m.corners(m.terms(q, u, d), d, m.mu)[0]
    while True:
        piece, margin, last = _piece(m, t, np.append(q, u), d, s, t_end, tolerance)
        pieces.append(piece)
        t, q, u = piece.end, m.onto_constraints(last[:-1]), last[-1]
        fastest = max([fastest, u, *piece.y(np.linspace(piece.begin, piece.end, 20))[-1]])
        if margin == "speed":
            terms = m.terms(q, 0.0, d)
            rate = abs(terms.p0 + terms.p @ m.friction(terms, d, s, m.mu)[0]) / fastest
            turned = _side(m, q)
            events += [(t, "stick" if turned is None else "reversal", name, rate) for name in m.guides]
            if turned is None:
                return Motion(m, tuple(pieces), tuple(events), t, q)
            d, u = turned, 0.0
        elif isinstance(margin, int):
            before, after = (m.terms(q + way * 1e-6 * m.terms(q, u, d).N, u, d).p[margin] for way in (-1, 1))
            events.append((t, "reversal", m.guides[margin], abs(after - before) / 2e-6 * u / np.max(np.abs(m.terms(q, u, d).p))))
            if events[-1][3] < 0.1:
                raise NotDrawn("a slip grazes zero")
            d = np.where(np.arange(len(d)) == margin, -d, d)
        if isinstance(margin, tuple):
            s = s.copy()
            s[margin[0], slice(None) if m.per_length[margin[0]] == 0 else margin[1]] *= -1
        else:
            s = m.corners(m.terms(q, u, d), d, m.mu)[0]


def _side(m: OneFreedom, q: np.ndarray) -> np.ndarray | None:
    """The sides to which the guides leave rest; None if they stay."""
    terms = m.terms(q, 0.0, np.ones(len(m.guides)))
    size = float(np.sqrt(np.sum(m.applied(q, np.zeros(len(q))) ** 2 / m.mass)))
    held, margin = m.held(terms)
    found: list[np.ndarray | None] = [None] if held else []
    for way in (1, -1):
        d = way * np.sign(terms.p)
        rate = way * (terms.p0 + terms.p @ m.corners(terms, d, m.mus)[1])
        margin = min(margin, abs(rate))
        if rate > 0:
            found.append(d)
    if len(found) != 1:
        raise NotDrawn("several motions" if found else "no solution")
    if margin < 1e-3 * size:
        raise NotDrawn("near the limit of static friction")
    return found[0]


def _piece(m: OneFreedom, t: float, y: np.ndarray, d: np.ndarray, s: np.ndarray, t_end: float,
           tolerance: float) -> tuple[Piece, Any, np.ndarray]:
    """The motion until a margin passes zero: "speed", the number of a guide whose slip does, or guide and corner; and the state there."""
    names: list[Any] = ["speed", *range(len(d)), *((i, j) for i in range(len(d)) for j in range(2 if m.per_length[i] else 1))]
    last: dict[tuple[float, float], np.ndarray] = {}

    def derivative(_: float, y: np.ndarray) -> np.ndarray:
        terms = m.terms(y[:-1], y[-1], d)
        return np.append(terms.N * y[-1], terms.p0 + terms.p @ m.friction(terms, d, s, m.mu)[0])

    def margins(t: float, y: np.ndarray) -> np.ndarray:
        if (t, y[-1]) not in last:
            terms = m.terms(y[:-1], y[-1], d)
            n = s * m.friction(terms, d, s, m.mu)[1]
            last.clear()
            last[t, y[-1]] = np.array([y[-1], *(d * terms.p), *(n[name] for name in names[1 + len(d):])])
        return last[t, y[-1]]

    def event(i: int) -> Any:
        def value(t: float, y: np.ndarray) -> float:
            return float(margins(t, y)[i])

        value.terminal, value.direction = True, -1
        return value

    def singular(_: float, y: np.ndarray) -> float:
        return m.distance_to_singular(y[:-1]) - 0.05

    singular.terminal = True
    if singular(t, y) < 0:
        raise NotDrawn("near a singular position")
    found = solve_ivp(derivative, (t, t_end), y, "DOP853", rtol=tolerance, atol=tolerance, max_step=LONGEST_STEP, dense_output=True,
                      events=[*(event(i) for i in range(len(names))), singular])
    if found.status != 1 or len(found.t_events[-1]):
        raise NotDrawn("near a singular position" if found.status == 1 else "does not come to rest")
    for time, state in zip(found.t[1:-1], found.y.T[1:-1]):
        terms = m.terms(state[:-1], state[-1], d)
        if np.any(margins(time, state) < 0) or np.any(m.corners(terms, d, m.mu)[0] != s):
            raise NotDrawn("a margin grazes zero")
    [which] = [i for i, times in enumerate(found.t_events) if len(times)][:1]
    return Piece(t, found.t[-1], d, s, found.sol), names[which], found.y[:, -1]


def _states(motion: Motion, times: np.ndarray) -> Iterator[tuple[Any, ...]]:
    """Instants before the rest: time, position, velocity, equation of motion, piece, friction."""
    for t in times[times < motion.rest]:
        piece = next(piece for piece in motion.pieces if t <= piece.end)
        q, u = np.split(piece.y(t), [-1])
        terms = motion.equations.terms(q, u[0], piece.d)
        yield t, q, u[0] * terms.N, terms, piece, motion.equations.friction(terms, piece.d, piece.s, motion.equations.mu)[0]


class Draft:
    """Tables of a scene, put together from points and directions in the plane, complex numbers of ground axes."""

    def __init__(self, dice: SeededDice):
        down = dice.number(0, 2 * np.pi)
        self.dice, self.guides = dice, 0
        self.raw: dict[str, Any] = {"gravity": [9.81 * np.cos(down), 9.81 * np.sin(down)], "bodies": {}, "joints": {}, "springs": {}, "forces": {},
                                    "stabilization": {"method": "none"}}
        mu = dice.number(0.04, 0.3)
        self.friction = {"mu": mu, "mus": round(mu * dice.one_of([1.0, dice.number(1, 1.4)]), 6)}

    def near(self, reach: float) -> complex:
        return complex(self.dice.number(-reach, reach), self.dice.number(-reach, reach))

    def body(self, name: str, *points: complex) -> None:
        """A body about the given points, its axes turned at random."""
        mass, size = self.dice.number(0.5, 3), max(0.2, max(abs(a - b) for a in points for b in points))
        centre = np.mean(points) + self.near(0.1 * size)
        self.raw["bodies"][name] = {"mass": mass, "inertia": mass * size ** 2 * self.dice.number(0.08, 0.2),
                                    "position": [centre.real, centre.imag], "angle": self.dice.number(-3, 3)}

    def own(self, name: str, point: complex) -> list[float]:
        """A point in the axes of a body."""
        body = self.raw["bodies"].get(name, {"position": (0, 0), "angle": 0.0})
        point = (point - complex(*body["position"])) * np.exp(-1j * body["angle"])
        return [point.real, point.imag]

    def angle(self, name: str) -> float:
        return self.raw["bodies"][name]["angle"] if name != GROUND else 0.0

    def pin(self, first: str, second: str, point: complex) -> None:
        self.raw["joints"][f"pin-{first}-{second}"] = {"type": "revolute", "bodies": [first, second],
                                                       "points": [self.own(first, point), self.own(second, point)]}

    def slider(self, at: complex, along: float, guide: str = GROUND) -> str:
        """A slider with its pin at a point, on a guide of the given direction."""
        name = f"slider-{self.guides}"
        self.guides += 1
        self.body(name, at)
        on = at + self.near(0.04)
        line = np.exp(1j * (along - self.angle(guide)))
        shape = {}
        if self.dice.integer(0, 3):
            length = self.dice.number(0.15, 0.5)
            shape = {"length": length, "width": round(self.dice.number(0, 0.6) * length, 6)}
        self.raw["joints"][f"guide-{name}"] = {
            "type": "translational", "slider": name, "guide": guide, "direction": [line.real, line.imag],
            "point": self.own(guide, on + self.dice.number(-0.3, 0.3) * np.exp(1j * along)), "slider_point": self.own(name, on),
            "angle": self.angle(name) - self.angle(guide), **self.friction, **shape}
        return name

    def rod(self, body: str, end: complex, along: float) -> str:
        """A rod from a body's point to a slider on the ground, whose guide is turned a little against the rod."""
        other = end + self.dice.number(0.6, 1.1) * np.exp(1j * along)
        name = f"rod-{self.guides}"
        self.body(name, end, other)
        self.pin(body, name, end)
        slider = self.slider(other, along + self.dice.number(-0.4, 0.4))
        self.pin(name, slider, other)
        return slider


def trammel(a: Draft) -> None:
    """A rod between two sliders; of a plate, see `plate`."""
    ends = a.near(0.2), a.near(0.2) + a.dice.number(0.5, 1) * np.exp(1j * a.dice.number(-3, 3))
    a.body("bar", *ends)
    along = a.dice.number(-3, 3)
    for end, angle in zip(ends, (along, along + a.dice.number(0.8, 2.3))):
        a.pin("bar", a.slider(end, angle), end)


def plate(a: Draft) -> None:
    """A plate on two sliders, and a rod from its third corner to a third slider."""
    trammel(a)
    third = a.near(0.5)
    a.rod("bar", third, a.dice.number(-3, 3))


def cranks(a: Draft) -> None:
    """A crank on a pin that drives two sliders by rods."""
    pins = [a.dice.number(0.15, 0.3) * np.exp(1j * a.dice.number(-3, 3)) for _ in range(2)]
    a.body("crank", 0j, *pins)
    a.pin("crank", GROUND, 0j)
    for pin in pins:
        a.rod("crank", pin, a.dice.number(-3, 3))


def rocker(a: Draft) -> None:
    """A crank whose pin slides on a rocking link, which drives a second slider by a rod."""
    crank, foot = a.dice.number(0.15, 0.3) * np.exp(1j * a.dice.number(-3, 3)), a.dice.number(0.4, 0.8) * np.exp(1j * a.dice.number(-3, 3))
    a.body("crank", 0j, crank)
    a.pin("crank", GROUND, 0j)
    a.body("link", foot, crank)
    a.pin("link", GROUND, foot)
    a.pin("crank", a.slider(crank, np.angle(crank - foot) + a.dice.number(-0.3, 0.3), "link"), crank)
    a.rod("link", foot + 0.5 * (crank - foot) + a.near(0.1), np.angle(crank - foot) + a.dice.one_of([-1, 1]) * a.dice.number(1.2, 1.9))


def yoke(a: Draft) -> None:
    """A crank whose pin slides on a slider of the ground, perhaps with a rod to a third."""
    crank = a.dice.number(0.2, 0.5) * np.exp(1j * a.dice.number(-3, 3))
    a.body("crank", 0j, crank)
    a.pin("crank", GROUND, 0j)
    along = a.dice.number(-3, 3)
    first = a.slider(crank + a.near(0.2), along)
    a.pin("crank", a.slider(crank, along + a.dice.number(0.8, 2.3), first), crank)
    if a.dice.chance():
        a.rod(first, crank + a.near(0.3), along + a.dice.number(-0.5, 0.5))


FAMILIES = (trammel, cranks, plate, rocker, yoke)
LONGEST = 5.0
"""Seconds within which a drawn mechanism is at rest."""


def drawn(seed: int, i: int) -> tuple[str, Scene, Motion]:
    """Family, scene and motion of mechanism i of a seed: the first of its draws that moves, and is at rest within `LONGEST`."""
    family = FAMILIES[i % len(FAMILIES)]
    for attempt in count():
        dice = SeededDice((seed, i, attempt))
        a = Draft(dice)
        family(a)
        bodies = list(a.raw["bodies"])
        if dice.chance():
            a.raw["springs"]["spring"] = {"type": "linear", "bodies": [dice.one_of(bodies), GROUND], "points": [[0, 0], [dice.number(-1, 1), 2]],
                                          "stiffness": dice.number(0, 20), "damping": dice.number(0, 1), "rest_length": dice.number(0, 2)}
        if dice.chance():
            a.raw["springs"]["twist"] = {"type": "torsional", "bodies": [dice.one_of(bodies), GROUND], "stiffness": dice.number(0, 3),
                                         "damping": dice.number(0, 0.2), "rest_angle": dice.number(-2, 2)}
        if dice.chance():
            a.raw["forces"]["load"] = {"type": "force", "body": dice.one_of(bodies), "direction": [dice.number(-1, 1), 1],
                                       "point": [dice.number(-0.1, 0.1), 0], "law": {"type": "constant", "value": dice.number(-10, 10)}}
        name = f"{family.__name__} {i} of seed {seed}"
        try:
            m = OneFreedom(scene_from_dict(a.raw, name))
            rates = dice.one_of([0.0, dice.number(-2, 2)]) * np.sqrt(m.mass.sum()) * m.terms(m.start, 0.0, np.ones(len(m.guides))).N
            for body, rate in zip(bodies, rates.reshape(-1, 3).tolist()):
                a.raw["bodies"][body] |= {"velocity": rate[:2], "angular_velocity": rate[2]}
            scene = scene_from_dict(a.raw, name)
            simulate(scene, LONGEST, 1e-5)  # finds in a fifth of the time what is not drawn
            motion = simulate(scene, LONGEST)
        except NotDrawn:
            continue
        return family.__name__, scene_from_dict(a.raw | {"t_end": round(1.1 * motion.rest + 0.2, 3)}, name), motion
    raise AssertionError("endless")


AGREES, SLIPS, OTHER_EVENTS, OTHER_FORCES, CONE, STOPS = "agrees", "slips at rest", "other events", "other motion", "outside the cone", "stops"
OUTCOMES = {
    AGREES: "events, motion and forces within the bound; all guides at rest at the end, their forces in balance and in the static cones",
    SLIPS: "a guide is not at rest at the end, though the mechanism is",
    OTHER_EVENTS: "stick, slip and reversals are others, or at other times",
    OTHER_FORCES: "positions, slips, normal forces or friction are others, before the rest or at its place",
    CONE: "forces at rest are not in balance, or a friction is more than the static coefficient allows",
    STOPS: "a typed breakdown, though there is one motion"}


def differences(scene: Scene, motion: Motion, run: Trajectory, rtol: float) -> Iterator[tuple[str, str]]:
    """Outcomes other than agreement, each with what differs."""
    m, names, bound = motion.equations, motion.equations.guides, max(RESERVE * rtol, OWN_ERROR)
    if run.breakdown is not None:
        yield STOPS, str(run.breakdown)
        return
    speeds = {name: abs(run[f"{name}.slip_velocity"][-1]) for name in names}
    if any(run[f"{name}.mode"][-1] for name in names) or max(speeds.values()) > AT_REST:
        yield SLIPS, ", ".join(f"{name}: mode {run[f'{name}.mode'][-1]}, {speeds[name]:.2g} m/s" for name in names)
    for name in names:
        expected, found = [event for event in motion.events if event[2] == name], [event for event in run.events if event.joint == name and event.kind != "corner"]
        for i in range(max(len(expected), len(found))):
            one = f"{expected[i][1]} at {expected[i][0]:.9g} s" if i < len(expected) else "none"
            other = f"{found[i].kind} at {found[i].time:.9g} s" if i < len(found) else "none"
            if one.split()[0] != other.split()[0] or abs(expected[i][0] - found[i].time) > bound * (1 + 1 / expected[i][3]):
                yield OTHER_EVENTS, f"{name}, event {i + 1}: expected {one}, found {other}"
                break
    yield from ((OTHER_FORCES, words) for words in _of_motion(scene, motion, run, bound))
    yield from ((CONE, words) for words in _of_rest(scene, motion, run, bound))


def _column(run: Trajectory, scene: Scene, what: Sequence[str]) -> np.ndarray:
    return np.array([run[f"{name}.{key}"] for name in scene.bodies for key in what]).T


def _of_motion(scene: Scene, motion: Motion, run: Trajectory, bound: float) -> Iterator[str]:
    """Where positions, velocities, normal forces and friction are others, away from events by what these may be shifted."""
    near = [(event[0], 10 * bound * (1 + 1 / event[3])) for event in motion.events]
    q, names = _column(run, scene, ("x", "y", "angle")), motion.equations.guides
    forces = np.array([[run[f"{name}.{key}"] for name in names] for key in ("normal_force", "friction")]).transpose(2, 0, 1)
    rows = np.array([k for k, t in enumerate(run.t) if all(abs(t - at) > width for at, width in near)])
    found = [(k, np.abs(q[k] - state[1]), np.abs(forces[k] - [state[3].load0[0] + state[3].load[0] @ state[5], state[5]]), np.abs(state[3].load0[0]))
             for k, state in zip(rows, _states(motion, run.t[rows]))]
    size, load = max(1.0, np.max(np.abs(motion.q))), max(np.max(loads) for *_, loads in found)
    for k, of_q, of_forces, _ in found:
        if np.max(of_q) > bound * size:
            yield f"position at {run.t[k]:.6g} s by {np.max(of_q):.2g}"
            break
        if np.max(of_forces) > bound * load:
            yield f"normal force or friction at {run.t[k]:.6g} s by {np.max(of_forces):.2g} N of {load:.3g} N"
            break
    if (away := np.max(np.abs(q[-1] - motion.q))) > bound * size:
        yield f"position at rest by {away:.2g}"


def _of_rest(scene: Scene, motion: Motion, run: Trajectory, bound: float) -> Iterator[str]:
    """Where the forces at the end are not in balance, or not in the static cones of their surfaces."""
    m = motion.equations
    q, k = _column(run, scene, ("x", "y", "angle"))[-1], len(m.guides)
    pins = [run[f"{name}.{key}"][-1] for name, joint in scene.joints.items() if isinstance(joint, Revolute) for key in ("fx", "fy")]
    of_guides = [[run[f"{name}.{key}"][-1] for name in m.guides] for key in ("normal_force", "moment", "friction")]
    applied = m.applied(q, np.zeros(len(q)))
    size = np.max(np.abs(applied)) + np.max(np.abs(of_guides))
    left = np.max(np.abs(applied + np.concatenate([pins, *of_guides]) @ m.rows(q)[1]))
    if not left <= bound * size:
        yield f"forces at rest leave {left:.2g} of {size:.3g}"
    for i, name in enumerate(m.guides):
        friction, pressed = [of_guides[2][i]], [abs(of_guides[0][i])]
        if m.per_length[i]:
            friction, F = [run[f"{name}.friction_{side}"][-1] for side in ("lower", "upper")], [run[f"{name}.F{j}"][-1] for j in (1, 2, 3, 4)]
            pressed = [F[0] + F[1], F[2] + F[3]]
            if not (np.min(F) >= 0 and abs(np.sum(friction) - of_guides[2][i]) <= bound * size and abs(pressed[0] - pressed[1] - of_guides[0][i]) <= bound * size):
                yield f"{name}: surfaces do not carry its forces: corners {F}, friction {friction}"
        excess = max(abs(f) - m.mus[i] * n for f, n in zip(friction, pressed))
        if not excess <= bound * size:
            yield f"{name}: friction at rest {excess:.2g} N above what its surfaces hold"


AT_REST = 1e-12
"""m/s: what rounding leaves of speeds of some m/s where all have been set to zero."""


def judge_drawn(seed: int, i: int, rtols: Sequence[float], t_end: float) -> list[list[Verdict]]:
    """Verdicts on mechanism i of a seed, for each tolerance one per stabilization; `t_end` does not matter: a mechanism has its own."""
    family, scene, motion = drawn(seed, i)
    return [[verdict(scene, motion, rtol, stabilization, f"{family}, mechanism {i} of seed {seed}") for stabilization in STABILIZATIONS] for rtol in rtols]


def verdict(scene: Scene, motion: Motion, rtol: float, stabilization: str, about: str) -> Verdict:
    """What a run of the reference is, held to the motion."""
    run = ReferenceEngine().simulate(scene, rtol=rtol, stabilization=stabilization, output_step=scene.t_end / 50, event_values=False)
    for outcome, detail in differences(scene, motion, run, rtol):
        return Verdict(outcome, f"{stabilization}: {detail}", about=about)
    return Verdict(AGREES, about=about)


STUDY = Study("stiction.comparisons.random_scenes.one_freedom", judge_drawn, OUTCOMES, tuple(set(OUTCOMES) - {AGREES}), "error [-]",
              (1e-6, 1e-8, 1e-10, 1e-12), LONGEST)


if __name__ == "__main__":
    raise SystemExit(STUDY.main(__doc__))
