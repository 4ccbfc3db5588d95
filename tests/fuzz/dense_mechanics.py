"""The second method of the random scenes of this folder: dense matrices, enumeration and linear programs.

It shares no code with `reference_impl.friction` or with any compiled kernel. All it takes from the reference are the terms
of the equations of motion in dense NumPy (`EquationsOfMotion`), whose derivation is another than that of the kernels:

    M a = QE + J^T lambda + W^T f,    J a + gamma = 0 .

With R = n1 + n2 the force of a guide's normal row and T that of its angle row, a slider of length l and width b that slips
in the direction d has, from the moments of its corner forces n1, n2 (at -+ l/2) and of its surface frictions (at +- b/2),

    N = T + (b/2) mu d R,    n1, n2 = R/2 -+ N/l,    f = -mu d (|n1| + |n2|),

and f = -mu d |R| without a length. A constant bound c adds -c d to the friction in slip, also to that of a pin, which has no
other; it is an applied force. At rest a guide without such a bound holds a friction f against slip in both directions d while

    mus max(|R|, (2/l) |T + (b/2) mus d R|) + d f >= 0 .
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import linprog

from stiction.reference_impl.equations_of_motion import EquationsOfMotion, Terms
from stiction.scenes import Scene, scene_from_dict

LABELS = (("x", "y", "angle"), ("vx", "vy", "omega"))
UNDECIDED = 1e-7
"""Size of a corner force, relative to the largest force, below which its sign is not asked: the run's state has that error."""
SAME = 1e-6
"""Relative difference up to which two solutions are one: those of two signs of a corner force that is zero."""
SINGULAR = 1e10
"""Condition number from which on the forces of a mode are rounding."""


class NotAssembled(Exception):
    """Newton's method found no position that the joints allow near the one that was drawn."""


@dataclass(frozen=True)
class Guide:
    """A frictional guide, with the place of its normal row; the angle row is the next.

    A pin is one without a load on its friction: `has_load` is False, and `bound` (N m) all of it.
    """

    name: str
    row: int
    length: float
    width: float
    mu: float
    mus: float
    bound: float = 0.0
    has_load: bool = True

    def corner_signs(self) -> tuple[tuple[int, int], ...]:
        """The signs of both corner forces that are possible; those of a joint without a load do not matter."""
        if not self.has_load:
            return ((1, 1),)
        return tuple(product((1, -1), repeat=2)) if self.length else ((1, 1), (-1, -1))

    def lines(self, d: int) -> np.ndarray:
        """The linear functions c_R R + c_T T whose largest is the capacity against slip in the direction d, (k, 2)."""
        if not self.length:
            return self.mus * np.array([[1.0, 0.0], [-1.0, 0.0]])
        lever = self.width / 2 * self.mus * d
        tilted = 2 / self.length * np.array([lever, 1.0])
        return self.mus * np.array([[1.0, 0.0], [-1.0, 0.0], tilted, -tilted])

    def excess(self, R, T, f):
        """How far a friction at rest is beyond what the guide holds; negative inside the cone."""
        return np.max(
            [
                -d * f - np.max([line[0] * R + line[1] * T for line in self.lines(d)], axis=0)
                for d in (1, -1)
            ],
            axis=0,
        )

    def corner_forces(self, R, T, d):
        """n1, n2 while it slips; of a guide without length R, 0."""
        if not self.length:
            return R, np.zeros_like(R)
        N = T + self.width / 2 * self.mu * d * R
        return R / 2 - N / self.length, R / 2 + N / self.length

    def slipping_friction(self, R, T, d):
        n1, n2 = self.corner_forces(R, T, d)
        return -self.mu * d * (np.abs(n1) + np.abs(n2))


class Dense:
    """A scene's equations, with its frictional guides in the order of its columns."""

    def __init__(self, scene: Scene):
        self.scene, self.equations = scene, EquationsOfMotion(scene)
        self.rows = self.equations.rows
        self.guides = [
            self._guide(name, joint) for name, joint in self.equations.frictional.items()
        ]
        self.columns = [*self.rows, *(f"{guide.name}.friction" for guide in self.guides)]

    def _guide(self, name: str, joint) -> Guide:
        """The guide, or the pin, of a frictional joint."""
        kinetic, _ = joint.bounds
        if joint.type == "revolute":
            return Guide(name, -1, 0.0, 0.0, 0.0, 0.0, kinetic, has_load=False)
        return Guide(
            name,
            self.rows.index(f"{name}.normal_force"),
            *joint.extent,
            joint.kinetic_coefficient if joint.mu is not None else 0.0,
            joint.static_coefficient if joint.mu is not None else 0.0,
            kinetic,
            has_load=joint.mu is not None,
        )

    def states(self, columns) -> tuple[np.ndarray, np.ndarray]:
        """q and v of a run's columns, (n, 3 bodies), or of the side of an event, (3 bodies,)."""
        return tuple(
            np.stack(
                [columns[f"{body}.{label}"] for body in self.scene.bodies for label in labels], -1
            )
            for labels in LABELS
        )

    def forces(self, columns) -> np.ndarray:
        """The forces of all rows, and the frictions, of a run's columns."""
        return np.stack([columns[name] for name in self.columns], -1)

    def kinematic(self, t: float, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The position that joints and drives prescribe near q, and its velocity: of a mechanism without freedoms."""
        zero = np.zeros_like(q)
        for _ in range(20):
            terms = self.equations.at(t, q, zero)
            step = np.linalg.solve(terms.J, terms.phi)
            q = q - step
            if np.max(np.abs(step)) < 1e-14:
                break
        terms = self.equations.at(t, q, zero)
        return q, np.linalg.solve(terms.J, -terms.phi_dot)  # at v = 0, phi_dot is dphi/dt

    def accelerations(self, terms: Terms) -> np.ndarray:
        """Of a mechanism without freedoms: J a = -gamma."""
        return np.linalg.solve(terms.J, -terms.gamma)

    def driven_solutions(
        self, terms: Terms, slip: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray], bool]:
        """All row forces and frictions of a mechanism without freedoms whose guides slip in the directions `slip`.

        Each combination of signs of all corner forces is one linear system J^T lambda + W^T f(lambda) = M a - QE.

        Returns
        -------
        certain, possible : list of ndarray, shape (rows + guides,)
            Solutions that obey Coulomb's law by more than UNDECIDED; and those, with them, that obey it nearly. Solutions that are
            SAME are one.
        decided : bool
            No system was nearly singular, and no sign undecided in a solution that is none of the certain ones.
        """
        needed = self.equations.mass * self.accelerations(terms) - terms.QE
        constant = np.array([-d * guide.bound for guide, d in zip(self.guides, slip)])
        needed = needed - constant @ terms.W
        signs = [guide.corner_signs() for guide in self.guides]
        certain: list[np.ndarray] = []
        possible: list[np.ndarray] = []
        decided = True
        for choice in product(*signs):
            acts = terms.J.copy()
            for g, (guide, (s1, s2)) in enumerate(zip(self.guides, choice)):
                if not guide.has_load:
                    continue
                k = -guide.mu * slip[g]
                on_R, on_T = k * s1, 0.0
                if guide.length:
                    on_T = k * (s2 - s1) / guide.length
                    on_R = k * (s1 + s2) / 2 + on_T * guide.width / 2 * guide.mu * slip[g]
                acts[guide.row] += on_R * terms.W[g]
                acts[guide.row + 1] += on_T * terms.W[g]
            condition = np.linalg.cond(acts / np.linalg.norm(terms.J, axis=1)[:, None])
            if not condition < SINGULAR:
                decided = False
                continue
            force = np.linalg.solve(acts.T, needed)
            friction, least, size = (
                np.zeros(len(self.guides)),
                np.inf,
                np.max(np.abs(force)) + 1e-300,
            )
            for g, (guide, (s1, s2)) in enumerate(zip(self.guides, choice)):
                if not guide.has_load:
                    continue
                n1, n2 = guide.corner_forces(force[guide.row], force[guide.row + 1], slip[g])
                friction[g] = -guide.mu * slip[g] * (s1 * n1 + s2 * n2)
                least = min(least, s1 * n1, s2 * n2 if guide.length else np.inf)
            whole = np.concatenate([force, friction + constant])
            if least >= -UNDECIDED * size and not _is_among(whole, possible):
                possible.append(whole)
            if least >= UNDECIDED * size and not _is_among(whole, certain):
                certain.append(whole)
        for solution in possible:
            decided = decided and _is_among(solution, certain)
        return certain, possible, decided

    def open_columns(self, terms: Terms, resting: list[int]) -> set[str]:
        """Columns that a null vector of J^T lambda + W^T f = 0 with the frictions of these guides moves."""
        acts = np.concatenate([terms.J, terms.W[resting]]).T
        vectors = null_space(acts, rcond=1e-10)
        names = [*self.rows, *(f"{self.guides[g].name}.friction" for g in resting)]
        return {
            name for name, part in zip(names, vectors) if np.max(np.abs(part), initial=0.0) > 1e-9
        }

    def balance(self, t, columns) -> float:
        """Largest residual of M a - QE - J^T lambda - W^T f relative to the largest term of the run."""
        q, v = self.states(columns)
        a = np.stack(
            [
                columns[f"{body}.{label}"]
                for body in self.scene.bodies
                for label in ("ax", "ay", "alpha")
            ],
            -1,
        )
        terms, force = self.equations.at(t, q, v), self.forces(columns)
        acts = np.concatenate([terms.J, terms.W], -2) * force[..., None]
        left = self.equations.mass * a - terms.QE - np.sum(acts, -2)
        size = np.max(np.abs(acts), initial=0.0) + np.max(np.abs(terms.QE)) + 1e-300
        return float(np.max(np.abs(left)) / size)


def _is_among(solution: np.ndarray, others: list[np.ndarray]) -> bool:
    return any(
        np.max(np.abs(solution - other))
        <= SAME * max(np.max(np.abs(solution)), np.max(np.abs(other)))
        for other in others
    )


class Rest:
    """The largest least margin F over all shares of the load of a mechanism that is at rest in q.

    With all accelerations zero, J^T lambda + W^T f = -QE(t): the shares are a particular one, linear in the loads, and
    null vectors of [J^T, W^T].
    """

    def __init__(self, dense: Dense, q: np.ndarray):
        self.dense, self.q = dense, q
        terms = dense.equations.at(0.0, q, np.zeros_like(q))
        self.acts = np.concatenate([terms.J, terms.W]).T
        self.inverse = np.linalg.pinv(self.acts, rcond=1e-10)
        self.null = null_space(self.acts, rcond=1e-10)
        # each margin, of a guide and a direction, is the largest of the functions `lines[i] @ force`
        self.margins = []
        for g, guide in enumerate(dense.guides):
            for d in (1, -1):
                lines = np.zeros((len(guide.lines(d)), len(dense.columns)))
                lines[:, guide.row : guide.row + 2] = guide.lines(d)
                lines[:, len(dense.rows) + g] = d
                self.margins.append(lines)
        self.slopes = [lines @ self.null for lines in self.margins]
        # margins that no share changes must hold by themselves
        moved = [bool(np.max(np.abs(slope), initial=0.0) > 1e-9) for slope in self.slopes]
        self.fixed = [i for i, shares in enumerate(moved) if not shares]
        self.shared = [i for i, shares in enumerate(moved) if shares]

    def load(self, t: float) -> tuple[np.ndarray, float]:
        """A force that holds the load, and the part of the load that no force of joints and guides holds."""
        zero = np.zeros_like(self.q)
        QE = self.dense.equations.at(t, self.q, zero).QE
        force = self.inverse @ -QE
        return force, float(np.max(np.abs(self.acts @ force + QE)))

    def grows(self) -> bool:
        """Return whether all shared margins grow along some null vector: then any load can be held."""
        k = self.null.shape[1]
        if k == 0 or not self.shared:
            return False
        slopes = [self.slopes[i] for i in self.shared]
        if k == 1:
            return any(all(np.max(d * slope[:, 0]) > 1e-9 for slope in slopes) for d in (1.0, -1.0))
        if k == 2:  # a least of largest sinusoids changes its sign only where one of them does
            every = np.concatenate(slopes)
            zero = np.sort(
                np.concatenate(
                    [np.arctan2(-every[:, 0], every[:, 1]), np.arctan2(every[:, 0], -every[:, 1])]
                )
            )
            for angle in (zero + np.append(zero[1:], zero[0] + 2 * np.pi)) / 2:
                u = np.array([np.cos(angle), np.sin(angle)])
                if all(np.max(slope @ u) > 1e-9 for slope in slopes):
                    return True
            return False
        raise NotImplementedError(f"{k} null vectors")

    def largest_least_margin(self, t: float) -> float:
        """F(t) by the corners of the piecewise linear function, N."""
        force, _ = self.load(t)
        fixed = min((np.max(self.margins[i] @ force) for i in self.fixed), default=np.inf)
        k = self.null.shape[1]
        if k == 0 or not self.shared:
            return float(fixed)
        values = [self.margins[i] @ force for i in self.shared]
        slopes = [self.slopes[i] for i in self.shared]
        value, slope = np.concatenate(values), np.concatenate(slopes)
        # a corner: k + 1 of the linear functions have one value F
        chosen = np.array(list(combinations(range(len(value)), k + 1)))
        matrices = np.concatenate([slope[chosen], -np.ones((*chosen.shape, 1))], -1)
        regular = np.abs(np.linalg.det(matrices)) > 1e-12 * np.max(np.abs(slope)) ** k
        tau = np.linalg.solve(matrices[regular], -value[chosen[regular]][..., None])[..., :k, 0]
        least = np.full(len(tau), np.inf)
        for its_value, its_slope in zip(values, slopes):
            least = np.minimum(least, np.max(its_value + tau @ its_slope.T, axis=1))
        return float(min(fixed, np.max(least)))

    def by_linear_programs(self, t: float) -> float:
        """F(t) by one linear program (HiGHS) for each choice of a linear function in every margin; inf if it has no bound."""
        force, _ = self.load(t)
        fixed = min((np.max(self.margins[i] @ force) for i in self.fixed), default=np.inf)
        if not self.shared or not self.null.shape[1]:
            return float(fixed)
        k, best = self.null.shape[1], -np.inf
        size = max(np.max(np.abs(self.margins[i] @ force)) for i in self.shared) + 1e-300
        for choice in product(*(range(len(self.slopes[i])) for i in self.shared)):
            A = np.array([np.append(-self.slopes[i][c], 1.0) for i, c in zip(self.shared, choice)])
            b = np.array([self.margins[i][c] @ force for i, c in zip(self.shared, choice)]) / size
            found = linprog(
                np.append(np.zeros(k), -1.0),
                A_ub=A,
                b_ub=b,
                bounds=[(None, None)] * (k + 1),
                method="highs",
            )
            if found.status == 3:
                return float(fixed)
            if found.status == 0:
                best = max(best, -found.fun * size)
        return float(min(fixed, best))


def assembled(raw: dict, rates: dict[str, float] | None = None) -> Scene:
    """The scene with its bodies moved onto its joints, by Newton's method, and its laws and velocities made consistent.

    Laws of drives are shifted to what their coordinates are there. Without drives the mechanism is at rest unless `rates` gives
    velocities of coordinates such as ``"arm.omega"``, from which the least change leads to velocities that the joints allow.

    Raises
    ------
    NotAssembled
        Where Newton's method does not converge near the positions that were drawn.
    """
    equations = EquationsOfMotion(scene_from_dict(_placed(raw, None, None), "draft"))
    q, v = equations.start()
    joints = len(equations.rows) - len(equations.scene.drives)
    for _ in range(30):
        terms = equations.at(0.0, q, np.zeros_like(q))
        residual = terms.phi[:joints]
        if not joints or np.max(np.abs(residual)) < 3e-16:
            break
        q = q - np.linalg.lstsq(terms.J[:joints], residual, rcond=1e-10)[0]
    if joints and not np.max(np.abs(equations.at(0.0, q, np.zeros_like(q)).phi[:joints])) < 1e-13:
        raise NotAssembled
    # the coordinate of each drive, at the start, from its law's residual there
    off = equations.at(0.0, q, np.zeros_like(q)).phi[joints:]
    raw = {
        **raw,
        "drives": {
            name: {**drive, "law": _shifted(drive["law"], float(by))}
            for (name, drive), by in zip(raw.get("drives", {}).items(), off)
        },
    }
    for name, rate in (rates or {}).items():
        body, _, label = name.partition(".")
        v[3 * list(raw["bodies"]).index(body) + LABELS[1].index(label)] = rate
    equations = EquationsOfMotion(scene_from_dict(_placed(raw, q, None), "draft"))
    terms = equations.at(0.0, q, v)
    v = v - np.linalg.lstsq(terms.J, terms.phi_dot, rcond=1e-10)[0]
    if len(terms.J) and not np.max(np.abs(equations.at(0.0, q, v).phi_dot)) < 1e-10 * max(
        1.0, np.max(np.abs(v))
    ):
        raise NotAssembled
    return scene_from_dict(_placed(raw, q, v), "random scene")


def _placed(raw: dict, q: np.ndarray | None, v: np.ndarray | None) -> dict:
    """The tables with the bodies in the states q, v."""
    bodies = {}
    for i, (name, body) in enumerate(raw["bodies"].items()):
        bodies[name] = dict(body)
        if q is not None:
            bodies[name] |= {
                "position": q[3 * i : 3 * i + 2].tolist(),
                "angle": float(q[3 * i + 2]),
            }
        if v is not None:
            bodies[name] |= {
                "velocity": v[3 * i : 3 * i + 2].tolist(),
                "angular_velocity": float(v[3 * i + 2]),
            }
    return {**raw, "bodies": bodies}


def _shifted(law: dict, by: float) -> dict:
    """A law with `by` added to its values."""
    if law["type"] == "table":
        return {**law, "values": [value + by for value in law["values"]]}
    key = "value" if law["type"] == "constant" else "offset"
    return {**law, key: law.get(key, 0.0) + by}


class Dice:
    """Random numbers of one scene."""

    def __init__(self, *seed: int):
        self.random = np.random.default_rng(seed)

    def number(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def chance(self, p: float = 0.5) -> bool:
        return bool(self.random.random() < p)

    def one_of(self, values):
        return values[int(self.random.integers(len(values)))]

    def point(self, reach: float) -> list[float]:
        return [self.number(-reach, reach), self.number(-reach, reach)]

    def unit(self) -> list[float]:
        angle = self.number(-np.pi, np.pi)
        return [float(np.cos(angle)), float(np.sin(angle))]

    def body(self, position, angle: float = 0.0) -> dict:
        return {
            "mass": self.number(0.3, 3),
            "inertia": self.number(0.02, 0.5),
            "position": [float(x) for x in position],
            "angle": float(angle),
        }

    def friction(self, most: float) -> dict:
        mu = self.number(0.02, most)
        found = {"mu": mu}
        if self.chance():
            found["mus"] = mu * self.number(1, 1.5)
        if self.chance():
            found["length"] = self.number(0.1, 0.6)
            if self.chance():
                found["width"] = (
                    self.number(0.01, 0.9) * found["length"] / max(found.get("mus", mu), 1.0)
                )
        return found

    def load(self, size: float) -> dict:
        kind = self.random.integers(4)
        if kind == 0:
            return {"type": "constant", "value": self.number(-size, size)}
        if kind == 1:
            return {
                "type": "linear",
                "offset": self.number(-size, size) * 0.3,
                "rate": self.number(-size, size),
            }
        if kind == 2:
            return {
                "type": "sine",
                "offset": self.number(-size, size) * 0.3,
                "amplitude": self.number(-size, size),
                "frequency": self.number(1, 9),
                "phase": self.number(0, 6),
            }
        times = np.cumsum(self.random.uniform(0.05, 0.4, 5)) - 0.2
        return {
            "type": "table",
            "times": times.tolist(),
            "values": self.random.uniform(-size, size, 5).tolist(),
            "interpolation": self.one_of(["linear", "cubic"]),
        }


def pin(name: str, base: str, own: list[float], its: list[float]) -> dict:
    return {
        "type": "revolute",
        "bodies": [name, base],
        "points": [list(map(float, own)), list(map(float, its))],
    }


def rod(
    dice: Dice, raw: dict, name: str, ends: tuple[tuple[str, list[float], np.ndarray], ...]
) -> None:
    """A rod between two bodies; `ends`: of each the body, the point in its axes, and the place of that in ground axes."""
    (first, at_first, a), (second, at_second, b) = ends
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    half, angle = np.hypot(*(b - a)) / 2, np.arctan2(*(b - a)[::-1])
    raw["bodies"][name] = dice.body((a + b) / 2, angle) | {"mass": dice.number(0.05, 1)}
    raw["joints"][f"{name}-1"] = pin(name, first, [-half, 0], at_first)
    raw["joints"][f"{name}-2"] = pin(name, second, [half, 0], at_second)


def place_of(raw: dict, body: str, point) -> np.ndarray:
    """Place of a body's point in ground axes."""
    if body == "ground":
        return np.asarray(point, dtype=float)
    q = raw["bodies"][body]
    c, s = np.cos(q["angle"]), np.sin(q["angle"])
    return np.array(q["position"]) + [c * point[0] - s * point[1], s * point[0] + c * point[1]]


def slider_on(
    dice: Dice,
    raw: dict,
    name: str,
    guide: str,
    along: float,
    offset: float,
    angle: float,
    friction: dict | None,
) -> None:
    """A slider on a line of a guide; `along`: angle of the line in the guide's axes, through a point `offset` from a drawn one.

    Its point on the line is off its centre of mass now and then.
    """
    direction, point = np.array([np.cos(along), np.sin(along)]), np.array(dice.point(0.3))
    own = dice.point(0.05) if dice.chance(0.3) else [0.0, 0.0]
    turned = 0.0 if guide == "ground" else raw["bodies"][guide]["angle"]
    whole = turned + angle
    c, s = np.cos(whole), np.sin(whole)
    centre = place_of(raw, guide, point + offset * direction) - [
        c * own[0] - s * own[1],
        s * own[0] + c * own[1],
    ]
    raw["bodies"][name] = dice.body(centre, whole)
    raw["joints"][f"guide-{name}"] = {
        "type": "translational",
        "slider": name,
        "guide": guide,
        "direction": direction.tolist(),
        "point": point.tolist(),
        "slider_point": own,
        "angle": angle,
        **(friction or {}),
    }


def tables(dice: Dice, t_end: float, weight: float = 0.6) -> dict:
    """Empty tables, with gravity now and then."""
    raw = {"t_end": t_end, "bodies": {}, "joints": {}, "drives": {}, "springs": {}, "forces": {}}
    if dice.chance(weight):
        raw["gravity"] = (9.81 * np.array(dice.unit())).tolist()
    return raw


def add_loads(
    dice: Dice, raw: dict, size: float, chance: float = 0.6, springs: float = 0.4
) -> None:
    """Loads on bodies and springs between them and the ground."""
    for name in list(raw["bodies"]):
        if dice.chance(chance):
            raw["forces"][f"load-{name}"] = (
                {
                    "type": "force",
                    "body": name,
                    "point": dice.point(0.1),
                    "direction": dice.unit(),
                    "law": dice.load(size),
                }
                if dice.chance(0.8)
                else {"type": "torque", "body": name, "law": dice.load(0.3 * size)}
            )
        if dice.chance(springs):
            raw["springs"][f"spring-{name}"] = {
                "type": "linear",
                "bodies": [name, "ground"],
                "points": [dice.point(0.1), dice.point(1)],
                "stiffness": dice.number(1, 40),
                "damping": dice.number(0, 1),
                "rest_length": dice.number(0, 0.5),
            }
