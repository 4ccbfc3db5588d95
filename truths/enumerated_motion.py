"""The motion of any mechanism with friction in guides and pins, by trying all contact modes; without the reference.

The equations of motion are those of `dense_equations`. What is frozen between events is a mode: which guides stick, to
which side the others slip, and the signs of all corner forces. The motion follows from five decisions:

- The forces of a mode: one dense linear solve with the corner forces themselves as unknowns. A guide that slips in the
  direction d has n_j = F+_j - F-_j, of the sign s_j, at the lever -+ a/2; its surfaces turn the slider by b/2:

      force of n_j on the slider = normal row + (-+ a/2) angle row - mu d (s_j tangential row + (b/2) angle row)

- The mode: every combination of stick, slip to either side and corner signs is tried, and kept if no corner pulls, no
  friction at rest exceeds what its surfaces hold, and every guide that leaves rest leaves it against its friction. More
  than one acceleration is reported, not chosen from.
- Guides at rest that share a load: where their rows are redundant, as those of two guides of one freedom, only a sum of
  their frictions is determined. They stay at rest if some share of the load lies in the static cones of all surfaces: a
  linear programme for each choice of corner signs (`Contact.largest_margin`). Loads that change are refused there.
- Rest: the motion ends where guides at rest hold the whole mechanism and no load changes, as it stays there.
- Events: scipy's DOP853, with every margin of the mode sampled in every step, near its start down to 1e-9 of it. A
  margin that dips between samples is minimised; a first zero is found by Brent's method.

What a guide at rest holds against slip in the direction d. Its surface frictions l+, l- obey |l+-| <= mus FN+-, and the
corner forces carry the moment that they leave of T, D = n2 - n1 = (2/a)(T - (b/2)(l+ - l-)). The largest -d (l+ + l-)
of this linear programme has both surfaces at their bound as long as its two multipliers, 1 -+ mus b/a, are not
negative: unless the guide locks itself (mus b > a). Then l+ - l- = -mus d R, and

    capacity(d) = mus max(|R|, (2/a) |T + (b/2) mus d R|)

Friction with a bound of its own, c in slip and c0 at rest (`friction` and `static_friction` of a guide or a pin), adds
-d c to the friction of slip, as an applied force, and c0 to what is held at rest; for the linear programme half of it
is on each surface of a guide. A pin is a guide without length that has no normal force, mu = mus = 0; its direction of
friction is the relative rotation of its bodies, and its friction a torque. What is said of guides holds for pins.

A self-locking guide can jam under stress of its own and has several motions; it is refused. All tolerances are
absolute, in m, s, kg, rad: for mechanisms of about a metre, a second and a kilogram.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq, linprog, minimize_scalar

from stiction.scenes import Breakdown, Scene
from stiction.scenes.laws import Constant, law_kinks
from stiction.scenes.model import Translational
from stiction.truths.dense_equations import DenseEquations, Terms

TOLERANCE = 1e-11
"""Relative and absolute error tolerance of a step."""
STEPS = 60
"""Least number of steps of a run: no step is longer than the run divided by it."""
FRACTIONS = np.unique(np.concatenate([[0.0], 2.0 ** -np.arange(7, 31), np.arange(1, 66) / 64]))
"""Fractions of a step at which the margins are sampled.

They are dense near the start, where a mode that follows an event may end at once (down to 2^-30,
about 1e-9). The last one lies beyond the end, so that a minimum at the end lies between two
samples.
"""
NOISE = 1e-9
"""N or m/s; margins above minus this count as zero: the error of forty steps, times stiffnesses up to 60 N/m."""
ADMISSIBLE = 1e-8
"""N or m/s^2 by which a mode may violate its conditions: ten times `NOISE`, as a reserve at events."""
SAME = 1e-6
"""m/s^2, rad/s^2; accelerations that differ by less count as equal, as those of two modes at their common boundary."""
CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Signs of both corner forces of a guide."""
AT_ONCE = 1e-11
"""Seconds within which events are one: what rounding leaves of a time."""
MOST_AT_ONCE = 20
"""Events without time passing after which a run is given up."""
DEPENDENT = 1e-9
"""Singular value, of rows of length 1, below which one depends on the others: what rounding leaves of it."""
_MINIMUM_XTOL = 1e-9
"""Tolerance of the time of a margin's minimum, relative to the interval between samples.

The value at a smooth minimum depends on it quadratically, so that its error is rounding.
"""
_ZERO_XTOL, _ZERO_RTOL = 1e-15, 1e-14
"""Tolerances (s; relative) of the time of a zero: some roundings, as close as Brent's method can get."""
_RATE_FRACTION = 1e-6
"""Fraction of a step over which the rate of a margin is measured on both sides of its zero.

The secant is of second order in it, and the rounding of the margins is divided by it: both errors
are below 1e-9.
"""
_AUDITED = np.linspace(0.05, 0.95, 9)
"""Fractions of a step at which `_audit` looks at Coulomb's law: off the ends, which are events of the search itself."""
_MIDDLE = len(_AUDITED) // 2
_OPTIMAL, _UNBOUNDED = 0, 3
"""Values of `scipy.optimize.OptimizeResult.status` of a linear programme."""


@dataclass(frozen=True)
class Instant:
    """An event of a guide; `rate` (N/s or m/s^2) is that of the margin that passes zero.

    An error e of the margin shifts the time by e / rate.
    """

    time: float
    kind: str
    joint: str
    rate: float


@dataclass(frozen=True)
class Mode:
    """Contact mode: what does not change between two events."""

    slip: np.ndarray  # (guides,), the directions d, 0 at rest
    corner: np.ndarray  # (guides, 2), the signs s


@dataclass(frozen=True)
class Forces:
    """Forces of one mode at several instants, or of several modes at one instant, along the leading axes."""

    acceleration: np.ndarray  # (..., k)
    R: np.ndarray  # (..., guides), normal force on each slider
    T: np.ndarray  # total moment
    f: np.ndarray  # friction
    n: np.ndarray  # (..., guides, 2), corner forces of guides that slip (without a length: R, R)


@dataclass(frozen=True)
class Margin:
    """A condition of a mode, positive while it holds.

    `what` is ``"speed"``, ``"corner"`` (`which` is the number of the corner) or ``"hold"`` (`which`
    is the direction in which the guide would break away).
    """

    guide: int
    what: str
    which: int = 0


@dataclass(frozen=True)
class Step:
    """A step of the integrator up to `end`: its mode, and (q, v) over time."""

    mode: Mode
    state: DenseOutput
    end: float


@dataclass(frozen=True)
class Motion:
    """The motion of a scene, up to its end or to the breakdown if there is one."""

    contact: Contact
    t: np.ndarray  # (n,), the ends of all steps
    q: np.ndarray  # (n, k)
    v: np.ndarray
    steps: tuple[Step, ...]
    events: tuple[Instant, ...]
    violation: float
    """The largest of Coulomb's law (N, m/s) and of the constraints (m, m/s) at instants inside the steps."""
    force: float
    """The largest reaction there, N."""
    breakdown: Breakdown | None
    rest: float | None
    """The instant from which on guides hold the whole mechanism under constant loads, s; None if they do not."""

    def at(self, t: float) -> tuple[np.ndarray, Forces]:
        """Position and forces at an instant before the rest."""
        step = next(step for step in self.steps if t <= step.end)
        q, v = np.split(step.state(t), 2)
        terms = self.contact.equations.at(t, q, v)
        return q, self.contact.forces(terms, step.mode, self.contact.mu)


def _row_space(rows: np.ndarray) -> np.ndarray:
    """Orthonormal rows that span the same space."""
    _, size, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[size > DEPENDENT]


class _Stopped(Exception):
    """Carries the breakdown out of the search."""

    def __init__(
        self, kind: str, time: float, reason: str, guide: str = "", solutions: int | None = None
    ):
        self.breakdown = Breakdown(kind, float(time), reason, guide, solutions)


class Contact:
    """Contact modes of a mechanism: their forces, their margins, and which are possible."""

    def __init__(self, scene: Scene):
        self.equations = DenseEquations(scene)
        self.names = list(self.equations.frictional)
        joints = self.equations.frictional.values()
        self.row = self.equations.first_row
        loads = [*scene.drives.values(), *scene.forces.values()]
        self.loads_are_constant = not scene.drives and all(
            isinstance(load.law, Constant) for load in loads
        )
        # constant bounds, in slip and at rest
        self.bound, self.static_bound = (
            np.array([joint.bounds for joint in joints]).reshape(-1, 2).T
        )
        # a joint whose friction does not depend on a load counts as a guide without length
        guides = [
            joint if isinstance(joint, Translational) and joint.mu is not None else None
            for joint in joints
        ]
        self.has_load = [guide is not None for guide in guides]
        self.length = [
            guide.length or 0.0 if guide else 0.0 for guide in guides
        ]  # 0: a guide without
        self.width = [guide.width or 0.0 if guide else 0.0 for guide in guides]
        self.mu = np.array([guide.kinetic_coefficient if guide else 0.0 for guide in guides])
        self.mus = np.array([guide.static_coefficient if guide else 0.0 for guide in guides])
        for name, a, b, mus in zip(self.names, self.length, self.width, self.mus):
            if a and mus * b >= a:
                raise ValueError(
                    f"{name}: found width {b:g}; expected less than length/mus = {a / mus:g}, where it "
                    "starts to lock itself"
                )

    def forces(
        self, terms: Terms, mode: Mode, mu: np.ndarray, bound: np.ndarray | None = None
    ) -> Forces:
        """Forces and accelerations of modes that share `slip`, with a coefficient and a constant bound for each guide.

        The bounds are those of slip if they are not given.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the constraints of the mode are redundant.
        """
        # What must not accelerate: the constraints, and the slip of every guide at rest. The force
        # of each such row acts along the row itself (virtual work), so that `directions` begins as
        # a copy of `rows`.
        bound = self.bound if bound is None else bound
        constant = -mode.slip * bound
        Q = terms.Q + np.sum(constant[:, None] * terms.W, -2)
        stuck = np.flatnonzero(mode.slip == 0)
        rows = np.concatenate([terms.J, terms.W[..., stuck, :]], -2)
        shape = np.broadcast_shapes(rows.shape[:-2], mode.corner.shape[:-2])
        directions = np.broadcast_to(rows, (*shape, *rows.shape[-2:])).copy()

        # The unknowns of a guide that slips are n1 and n2 in place of R and T, each with the
        # friction that it causes. This makes friction part of the linear system: no iteration over
        # normal forces is needed.
        for g in np.flatnonzero(mode.slip).tolist():
            if not self.has_load[g]:
                continue
            row = self.row[g]
            friction, signs = -mu[g] * mode.slip[g], mode.corner[..., g, :, None]
            normal, angle = terms.J[..., row, :], terms.J[..., row + 1, :]
            along = terms.W[..., g, :]
            if not self.length[g]:
                directions[..., row, :] = normal + friction * signs[..., 0, :] * along
            else:
                for j, lever in enumerate((-self.length[g] / 2, self.length[g] / 2)):
                    surface = signs[..., j, :] * along + self.width[g] / 2 * angle
                    directions[..., row + j, :] = normal + lever * angle + friction * surface

        # rows M^-1 directions^T forces = -(gamma, w) - rows M^-1 Q: accelerations eliminated, M is
        # diagonal.
        mass = self.equations.mass
        right = -np.concatenate([terms.gamma, terms.w[..., stuck]], -1)
        right = right - np.sum(rows * (Q / mass)[..., None, :], -1)
        right = np.broadcast_to(right, (*shape, right.shape[-1]))
        system = rows / mass @ np.swapaxes(directions, -1, -2)
        unknown = np.linalg.solve(system, right[..., None])[..., 0]
        acceleration = (Q + np.sum(directions * unknown[..., None], -2)) / mass

        # Back from the unknowns to normal force, moment and friction of each guide.
        R, T, f = np.zeros((3, *shape, len(self.row)))
        n = np.zeros((*shape, len(self.row), 2))
        for g, row in enumerate(self.row):
            friction, signs = -mu[g] * mode.slip[g], mode.corner[..., g, :]
            first, second = unknown[..., row], unknown[..., row + 1]
            if mode.slip[g] == 0:
                R[..., g], T[..., g] = first, second
                f[..., g] = unknown[..., terms.J.shape[-2] + np.searchsorted(stuck, g)]
            elif not self.length[g]:
                R[..., g], T[..., g] = first, second
                f[..., g] = friction * signs[..., 0] * first
                n[..., g, :] = first[..., None]
            else:
                R[..., g] = first + second
                T[..., g] = (
                    self.length[g] / 2 * (second - first) + friction * self.width[g] / 2 * R[..., g]
                )
                f[..., g] = friction * (signs[..., 0] * first + signs[..., 1] * second)
                n[..., g, 0], n[..., g, 1] = first, second
        f += constant
        return Forces(acceleration, R, T, f, n)

    def held_with(self, terms: Terms, stuck: Iterable[int]) -> set[int]:
        """Return the guides that cannot slip while the `stuck` ones do not slip.

        Their directions of slip depend linearly on the constraints and on the directions of the
        stuck guides. A guide that drives move has a speed, and is none of them.

        In a dead point a direction depends on the constraints as well, but the motion carries the guide on through it:
        its slip has an acceleration.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the constraints are redundant by themselves.
        """
        stuck = sorted(stuck)
        if len(_row_space(self._scaled(terms.J))) < len(terms.J):
            raise np.linalg.LinAlgError("redundant constraints")
        # A direction depends on the rows if nothing of it is left after projection onto their span.
        rows = np.concatenate([terms.J, terms.W[stuck]])
        basis = _row_space(self._scaled(rows))
        slips = self._scaled(terms.W)
        distance = np.linalg.norm(slips - slips @ basis.T @ basis, axis=1)
        dependent = np.flatnonzero(
            (distance < DEPENDENT) & (np.abs(terms.slip_speed) <= ADMISSIBLE)
        )
        if not len(dependent):
            return set()
        # At a dead point the same holds for an instant only: there any motion that the rows admit
        # accelerates the slip.
        right = -np.concatenate([terms.gamma, terms.w[stuck]])
        acceleration = np.linalg.lstsq(rows, right, rcond=DEPENDENT)[0]
        carried = np.abs(terms.W[dependent] @ acceleration + terms.w[dependent]) > ADMISSIBLE
        return set(dependent[~carried].tolist())

    def _scaled(self, rows: np.ndarray) -> np.ndarray:
        """Rows in the metric of the mass matrix, of length 1."""
        rows = rows / np.sqrt(self.equations.mass)
        return rows / np.linalg.norm(rows, axis=1)[:, None]

    def shares(self, terms: Terms, stuck: Sequence[int]) -> bool:
        """Return whether guides at rest, with all that they hold, are redundant: their frictions are not determined."""
        rows = np.concatenate([terms.J, terms.W[list(stuck)]])
        return len(_row_space(self._scaled(rows))) < len(rows)

    def largest_margin(self, terms: Terms, acceleration: np.ndarray) -> float:
        """By how much (N) the static cones of all guides, which are at rest, can hold the mechanism.

        It is the largest m for which there are reactions and surface frictions with M a = Q + J^T lambda + W^T f and
        |l+-| <= c0/2 + mus FN+- - m on both surfaces of each guide, which no corner pulls on: one linear programme
        (HiGHS) for each choice of corner signs. Negative where the frictions do not suffice, -inf where nothing
        balances the loads.

        Unknown are the reactions lambda; of each guide n1 and n2 in place of R and T, then l+ and l-; and m.
        """
        # Generalized force of each unknown: reactions (n1 and n2 in place of R and T), then both
        # surface frictions.
        guides, rows = len(self.row), len(terms.J)
        directions = np.zeros((rows + 2 * guides, len(self.equations.mass)))
        directions[:rows] = terms.J
        for g, (row, a, b) in enumerate(zip(self.row, self.length, self.width)):
            normal, angle, along = terms.J[row], terms.J[row + 1], terms.W[g]
            if not self.has_load[g]:
                directions[rows + 2 * g] = directions[rows + 2 * g + 1] = along
                continue
            if a:
                directions[row] = normal - a / 2 * angle
                directions[row + 1] = normal + a / 2 * angle
            directions[rows + 2 * g] = along + b / 2 * angle
            directions[rows + 2 * g + 1] = along - b / 2 * angle
        needed = self.equations.mass * acceleration - terms.Q

        # With the signs of all corner forces chosen, |n| is linear: the cones are then linear
        # inequalities.
        signs_of_guides = [self._corner_signs(g, 1) for g in range(guides)]
        size, best = len(directions) + 1, -np.inf
        for choice in product(*signs_of_guides):
            bounds: list[tuple[float | None, float | None]] = [(None, None)] * size
            conditions, limits = [], []
            for g, chosen in enumerate(choice):
                # friction without a load: each "surface" has half of the constant
                signs: tuple[int, ...] = chosen if self.has_load[g] else ()
                corners = range(self.row[g], self.row[g] + (1 if not self.length[g] else 2))
                for corner, sign in zip(corners, signs):
                    bounds[corner] = (0, None) if sign > 0 else (None, 0)
                # +-l - mus (sum of the corner forces that press on this surface) + m <= 0
                for surface, side in enumerate((1, -1)):
                    for way in (1, -1):
                        condition = np.zeros(size)
                        condition[rows + 2 * g + surface] = way
                        for corner, sign in zip(corners, signs):
                            condition[corner] = -self.mus[g] * sign if sign == side else 0.0
                        # a surface that nothing presses on has no friction, and no margin
                        constant = self.static_bound[g] / 2
                        pressed = side in signs[: len(corners)]
                        condition[-1] = 1.0 if pressed or constant > 0.0 else 0.0
                        conditions.append(condition)
                        limits.append(constant)
            programme = linprog(
                np.append(np.zeros(size - 1), -1.0),
                A_ub=np.array(conditions),
                b_ub=np.array(limits),
                A_eq=np.column_stack([directions.T, np.zeros(len(needed))]),
                b_eq=needed,
                bounds=bounds,
                method="highs",
            )
            if programme.status == _OPTIMAL:
                best = max(best, -programme.fun)
            elif programme.status == _UNBOUNDED:
                # guides that press against each other (self-stress) hold any load
                best = np.inf
        return float(best)

    def load(self, g: int, R: np.ndarray, T: np.ndarray, mu: float, d: int) -> np.ndarray:
        """|n1| + |n2| with both surfaces fully mobilized against slip in the direction d."""
        if not self.length[g]:
            return np.abs(R)
        return np.maximum(
            np.abs(R), 2 / self.length[g] * np.abs(T + self.width[g] / 2 * mu * d * R)
        )

    def conditions(self, forces: Forces, mode: Mode) -> Iterator[tuple[Margin, np.ndarray]]:
        """Yield what the forces of a mode must obey, each positive if it is so: corners press, guides at rest hold."""
        for g, d in enumerate(mode.slip):
            if d == 0:
                for away in (1, -1):
                    held = self.static_bound[g] + self.mus[g] * self.load(
                        g, forces.R[..., g], forces.T[..., g], self.mus[g], away
                    )
                    yield Margin(g, "hold", away), held + away * forces.f[..., g]
            elif self.has_load[g]:
                for j in range(1 if not self.length[g] else 2):
                    yield Margin(g, "corner", j), mode.corner[..., g, j] * forces.n[..., g, j]

    def margins(self, t: np.ndarray, y: np.ndarray, mode: Mode) -> tuple[list[Margin], np.ndarray]:
        """All margins of a frozen mode at instants, (n, margins)."""
        terms = self.equations.at(t, *np.split(y, 2, -1))
        conditions = list(self.conditions(self.forces(terms, mode, self.mu), mode))
        for g, d in enumerate(mode.slip):
            if d:
                conditions.append((Margin(g, "speed"), d * terms.slip_speed[..., g]))
        margins, values = zip(*conditions)
        return list(margins), np.stack(values, -1)

    def derivative(self, mode: Mode, t: float, y: np.ndarray) -> np.ndarray:
        q, v = np.split(y, 2)
        return np.concatenate(
            [v, self.forces(self.equations.at(t, q, v), mode, self.mu).acceleration]
        )

    def possible(
        self, terms: Terms, slip: np.ndarray, rest: set[int], left: set[int]
    ) -> list[tuple[Mode, np.ndarray]]:
        """All modes at an instant whose forces obey Coulomb's law, with their accelerations; modes of one motion once.

        Parameters
        ----------
        slip : ndarray of int, shape (guides,)
            Directions of the guides that slip.
        rest : set of int
            Guides at rest: they hold or leave to either side, with the static coefficient.
        left : set of int
            Guides that have left rest in this instant, in the direction `slip`, with the kinetic coefficient.
        """
        # At the instant of leaving rest a guide still has the static coefficient: it breaks away
        # against that.
        rests = [g in rest for g in range(len(slip))]
        mu = np.where(rests, self.mus, self.mu)
        bound = np.where(rests, self.static_bound, self.bound)
        motions: list[tuple[Mode, np.ndarray]] = []
        for slips in product(*((0, 1, -1) if g in rest else (d,) for g, d in enumerate(slip))):
            stuck = [g for g, d in enumerate(slips) if d == 0]
            moving = set(range(len(slip))) - set(stuck)
            if self.held_with(terms, stuck) & moving:
                # A guide cannot slip here. The choice in which it is at rest too describes this
                # motion.
                continue
            if stuck and self.shares(terms, stuck):
                # Frictions are not determined, and `forces` would be singular.
                motions += self._shared_rest(terms, np.array(slips, dtype=int), motions)
                continue

            # All corner signs of this choice of slips at once.
            signs = [self._corner_signs(g, d) for g, d in enumerate(slips)]
            modes = Mode(
                np.array(slips, dtype=int),
                np.array(list(product(*signs))).reshape(-1, len(slip), 2),
            )
            forces = self.forces(terms, modes, mu, bound)
            kept = np.all(np.isfinite(forces.acceleration), -1)
            for _, value in self.conditions(forces, modes):
                kept &= value >= -ADMISSIBLE
            # A guide without speed moves in the direction of its slip acceleration: this has to be
            # that of the mode.
            for g in (rest | left) & set(np.flatnonzero(modes.slip).tolist()):
                slip_acceleration = forces.acceleration @ terms.W[g] + terms.w[g]
                kept &= modes.slip[g] * slip_acceleration >= -ADMISSIBLE

            # Neighbouring modes agree on their common boundary: one motion, kept once.
            for i in np.flatnonzero(kept):
                a = forces.acceleration[i]
                if all(np.max(np.abs(a - other)) > SAME for _, other in motions):
                    motions.append((Mode(modes.slip, modes.corner[i]), a))
        return motions

    def _corner_signs(self, g: int, d: int) -> tuple[tuple[int, int], ...]:
        """Signs of the corner forces that a guide can have with the direction of slip d."""
        if d == 0 or not self.has_load[g]:
            return ((1, 1),)  # forces at rest, and those without a load, do not depend on them
        if not self.length[g]:
            return ((1, 1), (-1, -1))
        return CORNERS

    def _shared_rest(
        self, terms: Terms, slip: np.ndarray, others: Sequence[tuple[Mode, np.ndarray]]
    ) -> list[tuple[Mode, np.ndarray]]:
        """The mode in which guides at rest share the load, if they can; as `possible`.

        Raises
        ------
        numpy.linalg.LinAlgError
            If something can still move, whose acceleration would depend on the share.
        """
        # The redundant rows have a common acceleration only if they are compatible.
        stuck = np.flatnonzero(slip == 0)
        rows = np.concatenate([terms.J, terms.W[stuck]])
        right = -np.concatenate([terms.gamma, terms.w[stuck]])
        acceleration, _, rank, _ = np.linalg.lstsq(rows, right, rcond=DEPENDENT)
        if np.max(np.abs(rows @ acceleration - right)) > ADMISSIBLE:
            return []
        if rank < rows.shape[1] or np.any(slip):
            raise np.linalg.LinAlgError("guides share a load while something moves")

        # They stay at rest if some distribution of the load lies in all static cones.
        if self.largest_margin(terms, acceleration) < -ADMISSIBLE:
            return []
        if any(np.max(np.abs(acceleration - other)) <= SAME for _, other in others):
            return []
        return [(Mode(slip, np.ones((len(slip), 2), dtype=int)), acceleration)]

    def rests_for_good(self, t: float, y: np.ndarray, mode: Mode) -> bool:
        """Return whether guides at rest hold the whole mechanism under loads that stay as they are.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the guides share loads that change: whether they go on holding is not followed.
        """
        stuck = np.flatnonzero(mode.slip == 0)
        if not len(stuck):
            return False
        terms = self.equations.at(t, *np.split(y, 2))
        rows = self._scaled(np.concatenate([terms.J, terms.W[stuck]]))
        rank = len(_row_space(rows))
        if rank < len(rows) and not self.loads_are_constant:
            raise np.linalg.LinAlgError("guides share a load that changes")
        return rank == rows.shape[1] and self.loads_are_constant

    def settle(self, t: float, y: np.ndarray, slip: np.ndarray, left: set[int]) -> Mode:
        """Return the mode that follows at an instant; as `possible`, with all guides of no direction at rest.

        A guide whose friction at rest does not hold it leaves, and then has the kinetic coefficient, which may set
        others free.
        """
        terms, slip, left = self.equations.at(t, *np.split(y, 2)), slip.copy(), set(left)
        # Every pass takes at least one guide out of `rest`, so that the loop ends.
        while True:
            rest = set(np.flatnonzero(slip == 0).tolist())
            motions = self.possible(terms, slip, rest, left)
            if len(motions) != 1:
                kind = "several solutions" if motions else "no solution"
                raise _Stopped(kind, t, f"{kind} among all contact modes", solutions=len(motions))
            [(mode, _)] = motions
            leaving = {g for g in rest if mode.slip[g]}
            if not leaving:
                return mode
            slip, left = mode.slip, left | leaving


def simulate(scene: Scene, t_end: float, tolerance: float = TOLERANCE) -> Motion:
    """Simulate a scene from its consistent start; `tolerance` is that of a step, relative and absolute.

    Raises
    ------
    ValueError
        For a self-locking guide.
    """
    contact = Contact(scene)
    q, v = contact.equations.start()
    t, y = 0.0, np.concatenate([q, v])
    times, states, events = [t], [y], []
    violation, force, at_once, breakdown = 0.0, 0.0, 0, None
    steps: list[Step] = []
    rest = None
    # DOP853 assumes a smooth right-hand side: integration restarts at the kinks of all laws.
    loads = [*scene.drives.values(), *scene.forces.values()]
    stops = sorted({time for element in loads for time in law_kinks(element.law, t_end)} | {t_end})
    try:
        speed = contact.equations.at(t, q, v).slip_speed
        direction = np.where(np.abs(speed) <= NOISE, 0, np.sign(speed)).astype(int)
        mode = contact.settle(t, y, direction, set())
        while t < t_end:
            if contact.rests_for_good(t, y, mode):
                rest = t
                break
            # One mode: steps up to its first event or the next kink, each audited.
            stop = next(time for time in stops if time > t)
            began = t
            taken = _steps(contact, mode, t, y, stop, t_end / STEPS, tolerance)
            for piece, t, passed in taken:  # noqa: B007, B020 - from t on, used behind
                y = piece(t)
                steps.append(Step(mode, piece, t))
                times.append(t)
                states.append(y)
                step_violation, step_force = _audit(contact, mode, piece, t)
                violation, force = max(violation, step_violation), max(force, step_force)

            # The event decides the next mode; modes that end at once are counted, as they may never
            # stop.
            if passed:
                at_once = at_once + 1 if t - began <= AT_ONCE else 0
                if at_once > MOST_AT_ONCE:
                    raise _Stopped(
                        "chatter", t, "contact modes follow each other without time passing"
                    )
                before, mode = mode, _after(contact, mode, t, y, [margin for margin, _ in passed])
                rate = max(rate for _, rate in passed)
                events += [
                    Instant(t, kind, contact.names[g], rate) for g, kind in _changes(before, mode)
                ]
    except _Stopped as stopped:
        breakdown = stopped.breakdown
    except np.linalg.LinAlgError as error:
        reason = f"the constraints of a contact mode are redundant: {error}"
        breakdown = Breakdown("singular", t, reason)
    q, v = np.split(np.array(states), 2, -1)
    return Motion(
        contact,
        np.array(times),
        q,
        v,
        tuple(steps),
        tuple(events),
        violation,
        force,
        breakdown,
        rest,
    )


def _steps(
    contact: Contact,
    mode: Mode,
    t: float,
    y: np.ndarray,
    stop: float,
    longest: float,
    tolerance: float,
) -> Iterator[tuple[DenseOutput, float, list[tuple[Margin, float]]]]:
    """Steps of a frozen mode up to its end or `stop`.

    Each is a dense output, its last instant, and the margins that pass zero there.
    """
    solver = DOP853(
        partial(contact.derivative, mode),
        t,
        y,
        stop,
        rtol=tolerance,
        atol=tolerance,
        max_step=longest,
    )
    passed: list[tuple[Margin, float]] = []
    while solver.status == "running" and not passed:
        solver.step()
        if solver.status == "failed":
            raise _Stopped("step too small", solver.t, "DOP853 found no step small enough")
        piece = solver.dense_output()
        end, passed = _first_zero(contact, mode, piece)
        yield piece, end, passed


def _first_zero(
    contact: Contact, mode: Mode, piece: DenseOutput
) -> tuple[float, list[tuple[Margin, float]]]:
    """Locate the first zero of the margins in a step; return its time, all margins that pass there, and their rates.

    The time is that of the end of the step, with no margins, if none passes zero.
    """
    t = piece.t_old + FRACTIONS * (piece.t - piece.t_old)
    margins, values = contact.margins(t, piece(t).T, mode)
    zeros: list[tuple[float, int]] = []
    for k, sampled in enumerate(values.T):

        def evaluate(time: float, k: int = k) -> float:
            return float(contact.margins(np.array(time), piece(time), mode)[1][k])

        zero = _zero_of(evaluate, t, sampled, piece.t)
        if zero is not None and np.isnan(zero):
            raise _Stopped(
                "mode not held",
                piece.t_old,
                f"{margins[k].what} falls below zero at once",
                contact.names[margins[k].guide],
            )
        if zero is not None:
            zeros.append((zero, k))
    if not zeros:
        return piece.t, []

    # Margins whose zeros rounding cannot tell apart are one event, decided together.
    first = min(time for time, _ in zeros)
    beside = first + _RATE_FRACTION * (piece.t - piece.t_old) * np.array([-1.0, 1.0])
    change = np.diff(contact.margins(beside, piece(beside).T, mode)[1], axis=0)[0]
    rates = np.abs(change) / np.ptp(beside)
    return first, [(margins[k], float(rates[k])) for time, k in zeros if time - first <= AT_ONCE]


def _zero_of(
    evaluate: Callable[[float], float], t: np.ndarray, sampled: np.ndarray, end: float
) -> float | None:
    """Return the time of the first zero of a margin with the values `sampled` at the times t of a step to `end`.

    None if it has none, NaN if it is negative from the start.
    """
    # Beyond the first negative sample there is nothing to find.
    negative = np.flatnonzero((sampled < -NOISE) & (FRACTIONS <= 1.0))
    last = negative[0] if len(negative) else len(t) - 1

    # A dip between samples: at a sampled minimum that the margin could leave by crossing zero. A
    # convex function lies above the continuation of its chords, so that it stays positive where the
    # value exceeds both differences.
    for i in range(1, last):
        left, right = sampled[i - 1] - sampled[i], sampled[i + 1] - sampled[i]
        if sampled[i] > 0 and left >= 0 and right >= 0 and sampled[i] < max(left, right):
            lowest = minimize_scalar(
                evaluate,
                bounds=(t[i - 1], t[i + 1]),
                method="bounded",
                options={"xatol": _MINIMUM_XTOL * (t[i + 1] - t[i - 1])},
            )
            if lowest.fun < -NOISE and lowest.x <= end:
                return float(brentq(evaluate, t[i - 1], lowest.x, xtol=_ZERO_XTOL, rtol=_ZERO_RTOL))

    # A change of sign between samples.
    if not len(negative):
        return None
    positive = np.flatnonzero(sampled[:last] > 0)
    if not len(positive):
        return np.nan
    return float(brentq(evaluate, t[positive[-1]], t[last], xtol=_ZERO_XTOL, rtol=_ZERO_RTOL))


def _after(contact: Contact, mode: Mode, t: float, y: np.ndarray, passed: Iterable[Margin]) -> Mode:
    """Return the mode after an event."""
    slip, corner = mode.slip.copy(), mode.corner.copy()
    left: set[int] = set()
    slips_change = False
    for margin in passed:
        if margin.what == "corner":
            # A corner force is continuous where it passes zero: only its sign changes, and nothing
            # has to be decided.
            corner[margin.guide, margin.which] *= -1
            if not contact.length[margin.guide]:
                corner[margin.guide, 1] = corner[margin.guide, 0]
        elif margin.what == "hold":
            slip[margin.guide], slips_change = margin.which, True
            left.add(margin.guide)
        else:
            slip[margin.guide], slips_change = 0, True
    if not slips_change:
        return Mode(slip, corner)
    if np.any(slip == 0):
        # what cannot slip without those that came to rest is at rest as well, whatever rounding leaves of its speed
        terms = contact.equations.at(t, *np.split(y, 2))
        slip[sorted(contact.held_with(terms, np.flatnonzero(slip == 0)))] = 0
    return contact.settle(t, y, slip, left)


def _changes(before: Mode, after: Mode) -> Iterator[tuple[int, str]]:
    """Yield each guide whose contact mode changes, with the kind of its event."""
    for g, (old, new) in enumerate(zip(before.slip, after.slip)):
        if new != old and old == 0:
            yield g, "slip"
        elif new != old:
            yield g, "stick" if new == 0 else "reversal"
        elif new and np.any(before.corner[g] != after.corner[g]):
            yield g, "corner"


def _audit(contact: Contact, mode: Mode, piece: DenseOutput, end: float) -> tuple[float, float]:
    """Return the largest violation of Coulomb's law and of the constraints inside a step, and the largest reaction.

    The law is evaluated from the sign of the velocity and from R and T alone, without the corner
    signs of the mode. In the middle of the step all modes are tried: there must be one motion, that
    of the mode.

    Raises
    ------
    _Stopped
        If there are several motions, or another one.
    """
    t = piece.t_old + _AUDITED * (end - piece.t_old)
    terms = contact.equations.at(t, *np.split(piece(t).T, 2, -1))
    forces = contact.forces(terms, mode, contact.mu)
    violations = [
        np.max(np.abs(terms.phi), initial=0.0),
        np.max(np.abs(terms.phi_dot), initial=0.0),
    ]
    for g, d in enumerate(mode.slip):
        R, T, f, speed = forces.R[:, g], forces.T[:, g], forces.f[:, g], terms.slip_speed[:, g]
        if d == 0:
            # rest: no speed, and friction within what both surfaces hold in either direction
            mus = contact.mus[g]
            held = contact.static_bound[g]
            excesses = (
                -away * f - held - mus * contact.load(g, R, T, mus, away) for away in (1, -1)
            )
            violations += [np.max(np.abs(speed)), *map(np.max, excesses)]
        else:
            # slip: the friction of the law, wherever the speed is large enough to have a sign
            sign = np.sign(speed)
            direction = np.where(sign == 0, d, sign)
            load = contact.load(g, R, T, contact.mu[g], d)
            friction = -direction * (contact.bound[g] + contact.mu[g] * load)
            errors = np.where(np.abs(speed) > NOISE, np.abs(f - friction), 0.0)
            violations.append(np.max(errors))

    # Uniqueness, at one instant as it is the most expensive check.
    middle = Terms(*(getattr(terms, name)[_MIDDLE] for name in Terms.__dataclass_fields__))
    rest = set(np.flatnonzero(mode.slip == 0).tolist())
    motions = contact.possible(middle, mode.slip, rest, set())
    if len(motions) > 1:
        kind = "several solutions"
    elif not motions:
        kind = "no solution"
    elif np.max(np.abs(motions[0][1] - forces.acceleration[_MIDDLE])) > SAME:
        kind = "another solution"
    else:
        reaction = max(np.max(np.abs(forces.R)), np.max(np.abs(forces.f)))
        return float(max(violations)), float(reaction)
    reason = f"{kind} among all contact modes, inside a step"
    raise _Stopped(kind, t[_MIDDLE], reason, solutions=len(motions))
