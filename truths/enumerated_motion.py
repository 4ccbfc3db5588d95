"""Motion of any mechanism with friction in guides and pins by enumeration of contact modes, without the reference.

The method is slow. The equations of motion are those of `dense_equations`. Between events the contact mode is constant:
the guides that stick, the directions in which the others slip, the signs of all corner forces, and the states of
springs that act on one side only. The method has five parts:

- The forces of a mode: one dense linear solve with the corner forces themselves as unknowns. A guide that slips in the
  direction d has n_j = F+_j - F-_j, of the sign s_j, at the lever -+ a/2; its surfaces turn the slider by b/2:

      force of n_j on the slider = normal row + (-+ a/2) angle row - mu d (s_j tangential row + (b/2) angle row)

- The mode: every combination of stick, slip in either direction and corner signs is tried. It is accepted if no corner
  pulls, if the friction of guides at rest is within their capacity, and if every guide that leaves rest moves against
  its friction. If there is more than one acceleration, this is reported and none is selected.
- Guides at rest that share a load: if their rows are redundant, as for two guides of one freedom, only a sum of their
  frictions is determined. They stay at rest if some distribution of the load lies in the static cones of all surfaces,
  which is a linear programme for each choice of corner signs (`Contact.largest_margin`). Variable loads are refused in
  this case.
- Rest: the motion ends if guides at rest hold the whole mechanism and no load changes, because it stays there.
- Events: in each step of SciPy's DOP853 every margin of the mode is sampled, near the start down to 1e-9 of the step. A
  margin that dips between samples is minimised; its first zero is found by Brent's method.

The capacity of a guide at rest against slip in the direction d is found as follows. Its surface frictions l+, l- obey
|l+-| <= mus FN+-, and the corner forces carry the rest of the moment T: D = n2 - n1 = (2/a)(T - (b/2)(l+ - l-)). In the
solution of this linear programme with the largest -d (l+ + l-), both surfaces are at their bound as long as its two
multipliers, 1 -+ mus b/a, are not negative, that is unless the guide is self-locking (mus b > a). Then
l+ - l- = -mus d R, and

    capacity(d) = mus max(|R|, (2/a) |T + (b/2) mus d R|)

A constant bound of friction, c in slip and c0 at rest (`friction` and `static_friction` of a guide or a pin), adds
-d c to the friction in slip, as an applied force, and c0 to the capacity at rest. In the linear programme half of c0
belongs to each surface of a guide. A pin is treated as a guide without length and without normal force, with
mu = mus = 0. Its direction of friction is the relative rotation of its bodies, and its friction is a torque. What is
said of guides holds for pins as well, and for a drive with a limit: its direction is its coordinate, its slip is
measured relative to the rate of its law, and the limit is its bound in slip and at rest.

A spring that acts on one side is free while its stretch is on the other side, acts while stretch and tension are on its
side, and is clamped while the stretch is and the tension is not. Its stretch and tension are margins as well, at whose
zeros the state changes. Where a damped spring comes into contact its tension jumps, and all modes are tried anew.

The clearance and the restitution of guides are neglected: joints are ideal.

With Stribeck's curve the coefficient and the constant bound of a joint in slip are those of its speed v,

    mu(v) = mu + (mus - mu) exp(-(|v| / v_s)^p),    c(v) = c + (c0 - c) exp(-(|v| / v_s)^p)

They are evaluated at each instant, so that they are numbers in the linear solve. The direction of slip is that of the
mode: beyond a stop, where the speed has the other sign, the coefficients are those at rest (`Contact.kinetic`).

A pin under load has the bound c + mu r |R| in slip, with the force R in it. In a mode, the forces are linear in the
sizes |R| of the pins that slip; these are the fixed point of rho -> |R(rho)|, which is iterated from the sizes without
friction until it does not change (`Contact._with_loads`). Where the iteration is no contraction another size might
exist, and the mode is not taken. Joints at rest that share a load, one of them such a pin, are refused.

A self-locking guide can jam under its own stress and has several motions; it is refused. All tolerances are absolute,
in m, s, kg, rad, for mechanisms of about a metre, a second and a kilogram.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq, linprog, minimize_scalar

from stiction.scenes import Breakdown, Scene
from stiction.scenes.laws import Constant, law_kinks, law_switches
from stiction.scenes.model import Drive, Revolute, Translational
from stiction.truths.dense_equations import NO_ROW, DenseEquations, Terms

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
"""Possible signs of both corner forces of a guide."""
AT_ONCE = 1e-11
"""Time, s, within which events are simultaneous: rounding of times."""
MOST_AT_ONCE = 20
"""Largest number of events without time passing; more end the run."""
MOST_GAIN = 0.98
"""Factor by which sizes of forces in pins come nearer in an iteration, up to which a mode is taken to have one
solution: a contraction, with a reserve for convergence."""
MOST_ITERATIONS = 2000
"""Iterations of these sizes at most: 0.98^2000 is 3e-18."""
SAME_SIZE = 1e-15
"""Change of a size of force, relative to 1 N plus the size, that is rounding."""
DEPENDENT = 1e-9
"""Singular value of rows of length 1 below which they are linearly dependent: rounding of zero."""
_MINIMUM_XTOL = 1e-9
"""Tolerance of the time of a margin's minimum, relative to the interval between samples.

The value at a smooth minimum depends on it quadratically, so that its error is rounding.
"""
_ZERO_XTOL = 1e-15
"""Absolute tolerance of the time of a zero, s: rounding of times of seconds."""
_ZERO_RTOL = 1e-14
"""Relative tolerance of the time of a zero: some roundings, the limit of Brent's method."""
_RATE_FRACTION = 1e-6
"""Fraction of a step over which the rate of a margin is measured on both sides of its zero.

The secant is of second order in it, and the rounding of the margins is divided by it: both errors
are below 1e-9.
"""
_AUDITED = np.linspace(0.05, 0.95, 9)
"""Fractions of a step at which `_audit` checks Coulomb's law; the ends are left out because they may be events."""
_MIDDLE = len(_AUDITED) // 2
"""Index of the middle of a step in `_AUDITED`."""
FREE, ACTS, CLAMPED = "free", "acts", "clamped"
"""States of a spring that acts on one side only."""
_OPTIMAL = 0
"""`scipy.optimize.OptimizeResult.status` of a linear programme with a solution."""
_UNBOUNDED = 3
"""`scipy.optimize.OptimizeResult.status` of an unbounded linear programme."""


@dataclass(frozen=True)
class Instant:
    """An event of a guide.

    Attributes
    ----------
    time : float
        Time, s.
    kind, joint : str
        Kind of the event, and the guide.
    rate : float
        Rate of the margin that passes zero, N/s or m/s^2. An error e of the margin shifts the time by e / rate.
    """

    time: float
    kind: str
    joint: str
    rate: float


@dataclass(frozen=True)
class Mode:
    """Contact mode, which is constant between two events.

    Attributes
    ----------
    slip : ndarray of int, shape (guides,)
        Directions d of slip; 0 at rest.
    corner : ndarray of int, shape (..., guides, 2)
        Signs s of the corner forces; leading axes run over several modes.
    springs : tuple of str
        State of each spring that acts on one side only, in the order of the scene: `FREE`, `ACTS` or `CLAMPED`.
    """

    slip: np.ndarray
    corner: np.ndarray
    springs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Forces:
    """Forces of one mode at several instants, or of several modes at one instant, along the leading axes.

    Attributes
    ----------
    acceleration : ndarray, shape (..., k)
        Accelerations of the coordinates.
    R, T, f : ndarray, shape (..., guides)
        Normal force (N), total moment (N m) and friction (N) on each slider.
    n : ndarray, shape (..., guides, 2)
        Corner forces of the guides that slip, N; R for both in a guide without length.
    """

    acceleration: np.ndarray
    R: np.ndarray
    T: np.ndarray
    f: np.ndarray
    n: np.ndarray


@dataclass(frozen=True)
class Margin:
    """A condition of a mode, whose value is positive while it holds.

    Attributes
    ----------
    guide : int
        Index of the guide, or of the spring among those that act on one side only.
    what : str
        ``"speed"``, ``"corner"`` or ``"hold"`` of a guide; ``"stretch"`` or ``"tension"`` of a spring.
    which : int
        Index of the corner, or the direction in which a guide at rest would break away.
    """

    guide: int
    what: str
    which: int = 0


@dataclass(frozen=True)
class Step:
    """A step of the integrator.

    Attributes
    ----------
    mode : Mode
        The contact mode.
    state : DenseOutput
        (q, v) as a function of time.
    end : float
        End of the step, s.
    """

    mode: Mode
    state: DenseOutput
    end: float


@dataclass(frozen=True)
class Motion:
    """The motion of a scene up to its end, or to its breakdown.

    Attributes
    ----------
    contact : Contact
        The contact modes of the mechanism.
    t : ndarray, shape (n,)
        Ends of all steps, s.
    q, v : ndarray, shape (n, k)
        Coordinates and velocities there.
    steps : tuple of Step
        All steps.
    events : tuple of Instant
        All events.
    violation : float
        Largest violation of Coulomb's law (N, m/s) and of the constraints (m, m/s) at instants inside the steps.
    force : float
        Largest reaction at these instants, N.
    breakdown : Breakdown or None
        Why the motion ends early, if it does.
    rest : float or None
        Time (s) from which on guides hold the whole mechanism under constant loads; None if they do not.
    """

    contact: Contact
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    steps: tuple[Step, ...]
    events: tuple[Instant, ...]
    violation: float
    force: float
    breakdown: Breakdown | None
    rest: float | None

    def at(self, t: float) -> tuple[np.ndarray, Forces]:
        """Return coordinates and forces at an instant (s) before the rest."""
        step = next(step for step in self.steps if t <= step.end)
        q, v = np.split(step.state(t), 2)
        terms = self.contact.terms(t, q, v, step.mode.springs)
        return q, self.contact.forces(terms, step.mode)


def _row_space(rows: np.ndarray) -> np.ndarray:
    """Return orthonormal rows that span the same space."""
    _, size, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[size > DEPENDENT]


class _Stopped(Exception):
    """The motion ends early; carries the breakdown to `simulate`."""

    def __init__(
        self, kind: str, time: float, reason: str, guide: str = "", solutions: int | None = None
    ):
        self.breakdown = Breakdown(kind, float(time), reason, guide, solutions)


class Contact:
    """Contact modes of a mechanism: their forces, their margins, and the modes that are possible at an instant."""

    def __init__(self, scene: Scene):
        self.equations = DenseEquations(scene)
        self.names = list(self.equations.frictional)
        joints = self.equations.frictional.values()
        self.row = self.equations.first_row
        loads = [*scene.drives.values(), *scene.forces.values()]
        self.loads_are_constant = not scene.drives and all(
            isinstance(load.law, Constant) for load in loads
        )
        # Springs that act on one side only, by their places among all springs.
        one_sided = scene.one_sided_springs
        self.spring_names = list(one_sided)
        self.spring_places = np.flatnonzero(self.equations.spring_side)
        self.spring_signs = self.equations.spring_side[self.spring_places]
        self.is_damped = [spring.damping > 0.0 for spring in one_sided.values()]
        # Constant bounds in slip and at rest.
        self.bound, self.static_bound = (
            np.array([joint.bounds for joint in joints]).reshape(-1, 2).T
        )
        # A joint whose friction does not depend on a load is treated as a guide without length.
        guides = [
            joint if isinstance(joint, Translational) and joint.mu is not None else None
            for joint in joints
        ]
        self.has_load = [guide is not None for guide in guides]
        # The length is 0 for a guide without length.
        self.length = [(guide.length or 0.0) if guide else 0.0 for guide in guides]
        self.width = [(guide.width or 0.0) if guide else 0.0 for guide in guides]
        self.mu = np.array([guide.kinetic_coefficient if guide else 0.0 for guide in guides])
        self.mus = np.array([guide.static_coefficient if guide else 0.0 for guide in guides])
        # Radii of the friction circles of pins (torque per force, m), in slip and at rest.
        radii = [j.friction_radii if isinstance(j, Revolute) else (0.0, 0.0) for j in joints]
        self.radius, self.static_radius = np.array(radii).reshape(-1, 2).T
        self.under_load = np.flatnonzero(self.static_radius > 0.0).tolist()
        # Speeds of Stribeck's curves; infinitely small without one, so that nothing of the excess remains.
        # The limit of a drive does not depend on its slip velocity.
        self.stribeck, self.shape = np.zeros(len(self.names)), np.ones(len(self.names))
        for g, joint in enumerate(joints):
            if not isinstance(joint, Drive):
                self.stribeck[g] = joint.stribeck_velocity or 0.0
                self.shape[g] = joint.stribeck_shape
        for name, a, b, mus in zip(self.names, self.length, self.width, self.mus):
            if a and mus * b >= a:
                raise ValueError(
                    f"{name}: found width {b:g}; expected less than length/mus = {a / mus:g}, where it "
                    "starts to lock itself"
                )

    def terms(
        self, t: float | np.ndarray, q: np.ndarray, v: np.ndarray, springs: tuple[str, ...]
    ) -> Terms:
        """Return the terms of the equations at (t, q, v) with the states of springs that act on one side only."""
        acting = self.equations.spring_side == 0
        acting[self.spring_places] = [state == ACTS for state in springs]
        return self.equations.at(t, q, v, acting)

    def spring_margins(
        self, q: np.ndarray, v: np.ndarray, springs: tuple[str, ...]
    ) -> Iterator[tuple[Margin, np.ndarray]]:
        """Yield the conditions under which springs stay in their states, which are positive."""
        if not springs:
            return
        all_stretches, all_tensions = self.equations.stretches(q, v)
        for k, state in enumerate(springs):
            sign, place = self.spring_signs[k], self.spring_places[k]
            stretch, tension = sign * all_stretches[..., place], sign * all_tensions[..., place]
            yield Margin(k, "stretch"), -stretch if state == FREE else stretch
            if self.is_damped[k] and state != FREE:
                yield Margin(k, "tension"), tension if state == ACTS else -tension

    def spring_states(self, q: np.ndarray, v: np.ndarray) -> tuple[str, ...]:
        """Return the states of the springs that act on one side only by positions and velocities."""
        stretches, tensions = self.equations.stretches(q, v)
        states = []
        for sign, place in zip(self.spring_signs, self.spring_places):
            acts = ACTS if sign * tensions[place] > 0.0 else CLAMPED
            states.append(acts if sign * stretches[place] > 0.0 else FREE)
        return tuple(states)

    def name_of(self, margin: Margin) -> str:
        """Return the name of the guide or spring of a margin."""
        is_of_spring = margin.what in ("stretch", "tension")
        return (self.spring_names if is_of_spring else self.names)[margin.guide]

    def kinetic(self, terms: Terms, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients and the constant bounds (N, N m) in slip, each of shape (..., guides)."""
        if not np.any(self.stribeck):
            return self.mu, self.bound
        remains = self._remains(terms, slip)
        mu = self.mu + (self.mus - self.mu) * remains
        return mu, self.bound + (self.static_bound - self.bound) * remains

    def _remains(self, terms: Terms, slip: np.ndarray) -> np.ndarray:
        """Return the part of the static excess that remains in slip by Stribeck's curves, shape (..., guides)."""
        speed = np.maximum(slip * terms.slip_speed, 0.0)
        scale = np.where(self.stribeck > 0.0, self.stribeck, 1.0)
        return np.exp(-((speed / scale) ** self.shape)) * (self.stribeck > 0.0)

    def radii_in_slip(self, terms: Terms, slip: np.ndarray) -> np.ndarray:
        """Return the radii of the friction circles of pins in slip, torque per force, m, shape (..., guides)."""
        if not np.any(self.stribeck):
            return self.radius
        return self.radius + (self.static_radius - self.radius) * self._remains(terms, slip)

    def forces(
        self,
        terms: Terms,
        mode: Mode,
        coefficients: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    ) -> Forces:
        """Return forces and accelerations of modes that share `slip`.

        `coefficients` are the coefficient, the constant bound (N, N m) and the radius of the friction circle (m) of
        each joint; those of slip if they are not given. A mode without an answer has accelerations that are NaN.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the constraints of the mode are redundant.
        """
        if coefficients is None:
            radius = self.radii_in_slip(terms, mode.slip)
            mu, bound = self.kinetic(terms, mode.slip)
        else:
            mu, bound, radius = coefficients
        pins = [g for g in self.under_load if mode.slip[g]]
        if not pins:
            return self._forces(terms, mode, mu, bound)
        return self._with_loads(terms, mode, mu, bound, radius, pins)

    def _with_loads(
        self,
        terms: Terms,
        mode: Mode,
        mu: np.ndarray,
        bound: np.ndarray,
        radius: np.ndarray,
        pins: list[int],
    ) -> Forces:
        """Return forces of modes in which `pins` slip under load.

        They are NaN in modes in which the sizes of the forces in the pins are not the fixed point of a contraction.
        """
        # The forces in the pins are base + response @ torques: by a solution for each torque.
        unit = [np.array(bound, dtype=float, copy=True) for _ in pins]
        for each, g in zip(unit, pins):
            each[..., g] += 1.0
        base = self._forces(terms, mode, mu, bound)
        solutions = [self._forces(terms, mode, mu, each) for each in unit]

        def in_pins(forces: Forces) -> np.ndarray:
            """Return R of the pins, shape (..., pins, 2)."""
            return np.stack([forces.R[..., pins], forces.T[..., pins]], -1)

        start = in_pins(base)
        response = np.stack([in_pins(each) - start for each in solutions], -1)
        circle = radius[..., pins]

        # Whether |R| is a contraction in the sizes of R, in the largest norm.
        gain = np.linalg.norm(response, axis=-2) * circle[..., None, :]
        is_contraction = np.max(np.sum(gain, -1), -1) < MOST_GAIN
        size = np.linalg.norm(start, axis=-1)
        for _ in range(MOST_ITERATIONS):
            before = size
            torque = circle * size
            size = np.linalg.norm(
                start + np.einsum("...pxq,...q->...px", response, torque), axis=-1
            )
            if np.all(
                np.abs(size - before)[is_contraction] <= SAME_SIZE * (1.0 + size[is_contraction])
            ):
                break
        total = np.array(np.broadcast_to(bound, (*size.shape[:-1], bound.shape[-1])))
        total[..., pins] += circle * np.where(is_contraction[..., None], size, np.nan)
        return self._forces(terms, mode, mu, total)

    def _forces(self, terms: Terms, mode: Mode, mu: np.ndarray, bound: np.ndarray) -> Forces:
        """Return forces and accelerations for given coefficients and constant bounds, see `forces`."""
        # Friction of constant size is an applied force.
        constant = -mode.slip * bound
        Q = terms.Q + np.sum(constant[..., None] * terms.W, -2)

        # The constraints and the slip of every guide at rest have no acceleration. The force of each
        # such row acts along the row itself (virtual work), so that `directions` begins as a copy of
        # `rows`.
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
            friction = -mu[..., g, None] * mode.slip[g]
            signs = mode.corner[..., g, :, None]
            normal = terms.J[..., row, :]
            angle = terms.J[..., row + 1, :]
            along = terms.W[..., g, :]
            if not self.length[g]:
                directions[..., row, :] = normal + friction * signs[..., 0, :] * along
            else:
                for j, lever in enumerate((-self.length[g] / 2, self.length[g] / 2)):
                    surface = signs[..., j, :] * along + self.width[g] / 2 * angle
                    directions[..., row + j, :] = normal + lever * angle + friction * surface

        # Eliminate the accelerations (M is diagonal):
        # rows M^-1 directions^T forces = -(gamma, w) - rows M^-1 Q.
        mass = self.equations.mass
        right = -np.concatenate([terms.gamma, terms.w[..., stuck]], -1)
        right = right - np.sum(rows * (Q / mass)[..., None, :], -1)
        right = np.broadcast_to(right, (*shape, right.shape[-1]))
        system = rows / mass @ np.swapaxes(directions, -1, -2)
        unknown = np.linalg.solve(system, right[..., None])[..., 0]
        acceleration = (Q + np.sum(directions * unknown[..., None], -2)) / mass

        # Compute normal force, moment and friction of each guide from the unknowns.
        R, T, f = np.zeros((3, *shape, len(self.row)))
        n = np.zeros((*shape, len(self.row), 2))
        for g, row in enumerate(self.row):
            friction = -mu[..., g] * mode.slip[g]
            signs = mode.corner[..., g, :]
            first = second = np.zeros(shape)
            if row != NO_ROW:
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

        Their directions of slip depend linearly on the constraints and on the directions of the stuck guides. Guides
        that drives move depend on the constraints too, but have a speed, and are not returned. At a dead point a
        direction depends on the constraints as well, but the motion continues through it because the slip has an
        acceleration.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the constraints are redundant by themselves.
        """
        stuck = sorted(stuck)
        if len(_row_space(self._scaled(terms.J))) < len(terms.J):
            raise np.linalg.LinAlgError("redundant constraints")
        # A direction depends on the rows if it equals its projection onto their span.
        rows = np.concatenate([terms.J, terms.W[stuck]])
        basis = _row_space(self._scaled(rows))
        slips = self._scaled(terms.W)
        distance = np.linalg.norm(slips - slips @ basis.T @ basis, axis=1)
        dependent = np.flatnonzero(
            (distance < DEPENDENT) & (np.abs(terms.slip_speed) <= ADMISSIBLE)
        )
        if not len(dependent):
            return set()
        # At a dead point this holds only for an instant: any motion that the rows admit accelerates the
        # slip.
        right = -np.concatenate([terms.gamma, terms.w[stuck]])
        acceleration = np.linalg.lstsq(rows, right, rcond=DEPENDENT)[0]
        is_dead_point = np.abs(terms.W[dependent] @ acceleration + terms.w[dependent]) > ADMISSIBLE
        return set(dependent[~is_dead_point].tolist())

    def _scaled(self, rows: np.ndarray) -> np.ndarray:
        """Return rows in the metric of the mass matrix, scaled to length 1."""
        rows = rows / np.sqrt(self.equations.mass)
        return rows / np.linalg.norm(rows, axis=1)[:, None]

    def shares(self, terms: Terms, stuck: Sequence[int]) -> bool:
        """Return True if the rows of guides at rest are redundant, so that their frictions are not determined."""
        rows = np.concatenate([terms.J, terms.W[list(stuck)]])
        return len(_row_space(self._scaled(rows))) < len(rows)

    def largest_margin(self, terms: Terms, acceleration: np.ndarray) -> float:
        """Return the margin (N) with which the static cones of all guides, which are at rest, hold the mechanism.

        It is the largest m for which there are reactions and surface frictions with M a = Q + J^T lambda + W^T f and
        |l+-| <= c0/2 + mus FN+- - m on both surfaces of each guide, if no corner pulls: one linear programme (HiGHS)
        for each choice of corner signs. It is negative if the frictions do not suffice, and -inf if nothing balances
        the loads.

        The unknowns are the reactions lambda, with n1 and n2 of each guide instead of R and T; then l+ and l- of each
        guide; and m.
        """
        # Generalized force of each unknown: reactions (n1 and n2 in place of R and T), then both
        # surface frictions.
        guides, rows = len(self.row), len(terms.J)
        directions = np.zeros((rows + 2 * guides, len(self.equations.mass)))
        directions[:rows] = terms.J
        for g, (row, a, b) in enumerate(zip(self.row, self.length, self.width)):
            along = terms.W[g]
            if not self.has_load[g]:
                directions[rows + 2 * g] = directions[rows + 2 * g + 1] = along
                continue
            normal, angle = terms.J[row], terms.J[row + 1]
            if a:
                directions[row] = normal - a / 2 * angle
                directions[row + 1] = normal + a / 2 * angle
            directions[rows + 2 * g] = along + b / 2 * angle
            directions[rows + 2 * g + 1] = along - b / 2 * angle
        needed = self.equations.mass * acceleration - terms.Q

        # For given signs of all corner forces |n| is linear, so that the cones are linear inequalities.
        signs_of_guides = [self._corner_signs(g, 1) for g in range(guides)]
        size = len(directions) + 1
        best = -np.inf
        for choice in product(*signs_of_guides):
            conditions, limits, bounds = self._static_cones(choice, rows, size)
            programme = linprog(
                np.append(np.zeros(size - 1), -1.0),
                A_ub=conditions,
                b_ub=limits,
                A_eq=np.column_stack([directions.T, np.zeros(len(needed))]),
                b_eq=needed,
                bounds=bounds,
                method="highs",
            )
            if programme.status == _OPTIMAL:
                best = max(best, -programme.fun)
            elif programme.status == _UNBOUNDED:
                # Guides that press against each other (self-stress) hold any load.
                best = np.inf
        return float(best)

    def _static_cones(
        self, choice: Sequence[tuple[int, int]], rows: int, size: int
    ) -> tuple[np.ndarray, np.ndarray, list[tuple[float | None, float | None]]]:
        """Return the static cones of `largest_margin` as linear inequalities.

        Parameters
        ----------
        choice : sequence of tuple
            Signs of the corner forces of each guide.
        rows, size : int
            Index of the first surface friction among the unknowns, and number of the unknowns.

        Returns
        -------
        conditions : ndarray, shape (conditions, size)
            Coefficients; each condition is that its product with the unknowns is at most its limit.
        limits : ndarray, shape (conditions,)
            Limits, N or N m.
        bounds : list of tuple
            Bounds of each unknown.
        """
        bounds: list[tuple[float | None, float | None]] = [(None, None)] * size
        conditions = []
        limits = []
        for g, signs_of_guide in enumerate(choice):
            # A joint without a load has no corner forces; each "surface" has half of the constant bound.
            signs: tuple[int, ...] = signs_of_guide if self.has_load[g] else ()
            constant = self.static_bound[g] / 2
            first = max(self.row[g], 0)
            corners = range(first, first + (1 if not self.length[g] else 2))
            for corner, sign in zip(corners, signs):
                bounds[corner] = (0, None) if sign > 0 else (None, 0)
            # +-l - mus (sum of the corner forces that press on this surface) + m <= c0/2
            for surface, side in enumerate((1, -1)):
                for direction in (1, -1):
                    condition = np.zeros(size)
                    condition[rows + 2 * g + surface] = direction
                    for corner, sign in zip(corners, signs):
                        condition[corner] = -self.mus[g] * sign if sign == side else 0.0
                    # A surface without a corner force and without a constant bound has no friction
                    # and no margin.
                    is_pressed = side in signs[: len(corners)]
                    condition[-1] = 1.0 if is_pressed or constant > 0.0 else 0.0
                    conditions.append(condition)
                    limits.append(constant)
        return np.array(conditions), np.array(limits), bounds

    def load(
        self, g: int, R: np.ndarray, T: np.ndarray, mu: float | np.ndarray, d: int
    ) -> np.ndarray:
        """Return |n1| + |n2| (N) if both surfaces are fully mobilized against slip in the direction d."""
        if not self.length[g]:
            return np.abs(R)
        return np.maximum(
            np.abs(R), 2 / self.length[g] * np.abs(T + self.width[g] / 2 * mu * d * R)
        )

    def conditions(self, forces: Forces, mode: Mode) -> Iterator[tuple[Margin, np.ndarray]]:
        """Yield the conditions on the forces of a mode, which are positive if corners press and guides at rest hold."""
        for g, d in enumerate(mode.slip):
            if d == 0:
                for away in (1, -1):
                    held = self.static_bound[g] + self.mus[g] * self.load(
                        g, forces.R[..., g], forces.T[..., g], self.mus[g], away
                    )
                    held = held + self.static_radius[g] * np.hypot(
                        forces.R[..., g], forces.T[..., g]
                    )
                    yield Margin(g, "hold", away), held + away * forces.f[..., g]
            elif self.has_load[g]:
                for j in range(1 if not self.length[g] else 2):
                    yield Margin(g, "corner", j), mode.corner[..., g, j] * forces.n[..., g, j]

    def margins(self, t: np.ndarray, y: np.ndarray, mode: Mode) -> tuple[list[Margin], np.ndarray]:
        """Return all margins of a mode and their values at instants t (s) with the states y, shape (n, margins)."""
        q, v = np.split(y, 2, -1)
        terms = self.terms(t, q, v, mode.springs)
        conditions = list(self.conditions(self.forces(terms, mode), mode))
        conditions += self.spring_margins(q, v, mode.springs)
        for g, d in enumerate(mode.slip):
            if d:
                conditions.append((Margin(g, "speed"), d * terms.slip_speed[..., g]))
        margins, values = zip(*conditions)
        return list(margins), np.stack(values, -1)

    def derivative(self, mode: Mode, t: float, y: np.ndarray) -> np.ndarray:
        """Return y' of a state y = (q, v) in a mode."""
        q, v = np.split(y, 2)
        return np.concatenate(
            [v, self.forces(self.terms(t, q, v, mode.springs), mode).acceleration]
        )

    def possible(
        self, terms: Terms, slip: np.ndarray, rest: set[int], left: set[int]
    ) -> list[tuple[Mode, np.ndarray]]:
        """Return all modes at an instant whose forces obey Coulomb's law, with their accelerations.

        Of several modes with the same acceleration one is returned.

        Parameters
        ----------
        slip : ndarray of int, shape (guides,)
            Directions of the guides that slip.
        rest : set of int
            Guides at rest, which stay at rest or leave it in either direction, with the static coefficient.
        left : set of int
            Guides that have left rest at this instant, in the direction `slip`, with the kinetic coefficient.
        """
        # A guide breaks away against its static friction.
        is_resting = [g in rest for g in range(len(slip))]
        mu, bound = self.kinetic(terms, slip)
        mu = np.where(is_resting, self.mus, mu)
        bound = np.where(is_resting, self.static_bound, bound)
        radius = np.where(is_resting, self.static_radius, self.radii_in_slip(terms, slip))
        motions: list[tuple[Mode, np.ndarray]] = []
        for slips in product(*((0, 1, -1) if g in rest else (d,) for g, d in enumerate(slip))):
            stuck = [g for g, d in enumerate(slips) if d == 0]
            moving = set(range(len(slip))) - set(stuck)
            if self.held_with(terms, stuck) & moving:
                # A guide cannot slip here. This motion belongs to the choice in which it is at rest too.
                continue
            if stuck and self.shares(terms, stuck):
                # Frictions are not determined, and `forces` would be singular.
                motions += self._shared_rest(terms, np.array(slips, dtype=int), motions)
                continue

            # Evaluate all corner signs of this choice of slips at once.
            signs = [self._corner_signs(g, d) for g, d in enumerate(slips)]
            modes = Mode(
                np.array(slips, dtype=int),
                np.array(list(product(*signs))).reshape(-1, len(slip), 2),
            )
            forces = self.forces(terms, modes, (mu, bound, radius))
            is_possible = np.all(np.isfinite(forces.acceleration), -1)
            for _, value in self.conditions(forces, modes):
                is_possible &= value >= -ADMISSIBLE
            # A guide without speed moves in the direction of its slip acceleration, which has to be
            # the direction of the mode.
            for g in (rest | left) & set(np.flatnonzero(modes.slip).tolist()):
                slip_acceleration = forces.acceleration @ terms.W[g] + terms.w[g]
                is_possible &= modes.slip[g] * slip_acceleration >= -ADMISSIBLE

            # Neighbouring modes have the same motion on their common boundary, which is added once.
            for i in np.flatnonzero(is_possible):
                a = forces.acceleration[i]
                if all(np.max(np.abs(a - other)) > SAME for _, other in motions):
                    motions.append((Mode(modes.slip, modes.corner[i]), a))
        return motions

    def _corner_signs(self, g: int, d: int) -> tuple[tuple[int, int], ...]:
        """Return the signs of the corner forces that a guide can have with the direction of slip d."""
        if d == 0 or not self.has_load[g]:
            return ((1, 1),)  # forces at rest, and those without a load, do not depend on them
        if not self.length[g]:
            return ((1, 1), (-1, -1))
        return CORNERS

    def _shared_rest(
        self, terms: Terms, slip: np.ndarray, others: Sequence[tuple[Mode, np.ndarray]]
    ) -> list[tuple[Mode, np.ndarray]]:
        """Return the mode in which guides at rest share the load, if this is possible, in the form of `possible`.

        `others` are the motions that are known already.

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
        if any(slip[g] == 0 for g in self.under_load):
            raise np.linalg.LinAlgError("a pin under load shares a load at rest")
        if rank < rows.shape[1] or np.any(slip):
            raise np.linalg.LinAlgError("guides share a load while something moves")

        # They stay at rest if some distribution of the load lies in all static cones.
        if self.largest_margin(terms, acceleration) < -ADMISSIBLE:
            return []
        if any(np.max(np.abs(acceleration - other)) <= SAME for _, other in others):
            return []
        return [(Mode(slip, np.ones((len(slip), 2), dtype=int)), acceleration)]

    def rests_for_good(self, t: float, y: np.ndarray, mode: Mode) -> bool:
        """Return True if guides at rest hold the whole mechanism under constant loads.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the guides share variable loads; the method does not check whether they continue to hold.
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

    def settle(
        self,
        t: float,
        y: np.ndarray,
        slip: np.ndarray,
        left: set[int],
        springs: tuple[str, ...],
    ) -> Mode:
        """Return the mode that follows at an instant, with the states of `springs`.

        The other arguments are those of `possible`; all guides with the direction 0 are at rest. A guide whose static
        friction does not suffice leaves rest, and then has the kinetic coefficient, which may release other guides.

        Raises
        ------
        _Stopped
            If there is no such mode, or several.
        """
        q, v = np.split(y, 2)
        terms = self.terms(t, q, v, springs)
        slip = slip.copy()
        left = set(left)
        # Every pass removes at least one guide from `rest`, so that the loop ends.
        while True:
            rest = set(np.flatnonzero(slip == 0).tolist())
            motions = self.possible(terms, slip, rest, left)
            if len(motions) != 1:
                kind = "several solutions" if motions else "no solution"
                raise _Stopped(kind, t, f"{kind} among all contact modes", solutions=len(motions))
            [(mode, _)] = motions
            leaving = {g for g in rest if mode.slip[g]}
            if not leaving:
                return replace(mode, springs=springs)
            slip, left = mode.slip, left | leaving


class _Recorder:
    """Collects the steps and events of a motion, and its audit.

    Attributes
    ----------
    times, states : list
        Times (s) and states (q, v) of the start and of the ends of all steps.
    steps, events : list
        Steps and events.
    violation, force : float
        See `Motion`.
    """

    def __init__(self, t: float, y: np.ndarray):
        self.times = [t]
        self.states = [y]
        self.steps: list[Step] = []
        self.events: list[Instant] = []
        self.violation = 0.0
        self.force = 0.0

    def add(self, contact: Contact, step: Step) -> None:
        """Audit a step and add it."""
        self.steps.append(step)
        self.times.append(step.end)
        self.states.append(step.state(step.end))
        violation, force = _audit(contact, step.mode, step.state, step.end)
        self.violation = max(self.violation, violation)
        self.force = max(self.force, force)


def simulate(scene: Scene, t_end: float, tolerance: float = TOLERANCE) -> Motion:
    """Simulate a scene from its consistent start to t_end (s).

    `tolerance` is the relative and absolute error of a step.

    Raises
    ------
    ValueError
        For a self-locking guide.
    """
    contact = Contact(scene)
    recorder = _Recorder(0.0, np.concatenate(contact.equations.start()))
    # DOP853 assumes a smooth right-hand side: integration restarts at the kinks of all laws. Where they may jump, the
    # contact mode is determined anew.
    loads = [*scene.drives.values(), *scene.forces.values()]
    kinks = {time for element in loads for time in law_kinks(element.law, t_end)}
    switches = {time for element in loads for time in law_switches(element.law, t_end)}
    rest = None
    breakdown = None
    try:
        stops = sorted(kinks | {t_end})
        rest = _integrate(contact, recorder, stops, switches, t_end / STEPS, tolerance)
    except _Stopped as stopped:
        breakdown = stopped.breakdown
    except np.linalg.LinAlgError as error:
        reason = f"the constraints of a contact mode are redundant: {error}"
        breakdown = Breakdown("singular", recorder.times[-1], reason)
    q, v = np.split(np.array(recorder.states), 2, -1)
    return Motion(
        contact=contact,
        t=np.array(recorder.times),
        q=q,
        v=v,
        steps=tuple(recorder.steps),
        events=tuple(recorder.events),
        violation=recorder.violation,
        force=recorder.force,
        breakdown=breakdown,
        rest=rest,
    )


def _integrate(
    contact: Contact,
    recorder: _Recorder,
    stops: Sequence[float],
    switches: Collection[float],
    longest: float,
    tolerance: float,
) -> float | None:
    """Integrate mode by mode to the last of `stops`, at which integration restarts (s).

    At `switches` (s), which are among them, laws may jump.

    Returns
    -------
    float or None
        The time from which on the mechanism rests for good, if it does.
    """
    t = recorder.times[-1]
    y = recorder.states[-1]
    speed = contact.equations.at(t, *np.split(y, 2)).slip_speed
    direction = np.where(np.abs(speed) <= NOISE, 0, np.sign(speed)).astype(int)
    springs = contact.spring_states(*np.split(y, 2))
    mode = contact.settle(t, y, direction, set(), springs)
    events_at_once = 0
    while t < stops[-1]:
        if contact.rests_for_good(t, y, mode):
            return t
        # Take steps in one mode up to its first event or the next stop.
        begin = t
        stop = min(time for time in stops if time > t)
        passed: list[tuple[Margin, float]] = []
        for step, margins in _steps(contact, mode, t, y, stop, longest, tolerance):
            recorder.add(contact, step)
            passed = margins
        t = recorder.times[-1]
        y = recorder.states[-1]
        if not passed and t in switches:
            # Guides at rest have no speed but drift; the others keep their directions.
            settled = contact.settle(t, y, mode.slip, set(), mode.springs)
            for g, kind in _changes(mode, settled):
                recorder.events.append(Instant(t, kind, contact.names[g], np.inf))
            mode = settled
        if not passed:
            continue
        # The event decides the next mode. Modes that end at once are counted, because they may follow
        # each other without end.
        events_at_once = events_at_once + 1 if t - begin <= AT_ONCE else 0
        if events_at_once > MOST_AT_ONCE:
            raise _Stopped("chatter", t, "contact modes follow each other without time passing")
        before = mode
        mode = _after(contact, before, t, y, [margin for margin, _ in passed])
        rate = max(rate for _, rate in passed)
        for g, kind in _changes(before, mode):
            recorder.events.append(Instant(t, kind, contact.names[g], rate))
        for name, old, new in zip(contact.spring_names, before.springs, mode.springs):
            if (old == ACTS) != (new == ACTS):
                kind = "contact" if new == ACTS else "release"
                recorder.events.append(Instant(t, kind, name, rate))
    return None


def _steps(
    contact: Contact,
    mode: Mode,
    t: float,
    y: np.ndarray,
    stop: float,
    longest: float,
    tolerance: float,
) -> Iterator[tuple[Step, list[tuple[Margin, float]]]]:
    """Yield the steps of a mode from (t, y) up to its end or `stop` (s), none longer than `longest` (s).

    Each comes with the margins that pass zero at its end, and their rates.
    """
    # Laws that jump at the stop have their limits from the left until there.
    latest = np.nextafter(stop, -np.inf)
    solver = DOP853(
        lambda time, state: contact.derivative(mode, min(time, latest), state),
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
        end, passed = _first_zero(contact, mode, piece, latest)
        yield Step(mode, piece, end), passed


def _first_zero(
    contact: Contact, mode: Mode, piece: DenseOutput, latest: float
) -> tuple[float, list[tuple[Margin, float]]]:
    """Return the time (s) of the first zero of the margins in a step, and all margins that pass there with their rates.

    If no margin passes zero, the time is the end of the step. Behind `latest` (s) laws may have jumped.
    """
    t = piece.t_old + FRACTIONS * (piece.t - piece.t_old)
    margins, values = contact.margins(np.minimum(t, latest), piece(t).T, mode)
    zeros: list[tuple[float, int]] = []
    for k, sampled in enumerate(values.T):

        def evaluate(time: float, k: int = k) -> float:
            instant = np.array(min(time, latest))
            return float(contact.margins(instant, piece(time), mode)[1][k])

        zero = _zero_of(evaluate, t, sampled, piece.t)
        if zero is not None and np.isnan(zero):
            raise _Stopped(
                "mode not held",
                piece.t_old,
                f"{margins[k].what} falls below zero at once",
                contact.name_of(margins[k]),
            )
        if zero is not None:
            zeros.append((zero, k))
    if not zeros:
        return piece.t, []

    # Margins whose zeros differ by rounding are one event.
    first = min(time for time, _ in zeros)
    beside = first + _RATE_FRACTION * (piece.t - piece.t_old) * np.array([-1.0, 1.0])
    instants = np.minimum(beside, latest)
    change = np.diff(contact.margins(instants, piece(beside).T, mode)[1], axis=0)[0]
    rates = np.abs(change) / np.ptp(beside)
    return first, [(margins[k], float(rates[k])) for time, k in zeros if time - first <= AT_ONCE]


def _zero_of(
    evaluate: Callable[[float], float], t: np.ndarray, sampled: np.ndarray, end: float
) -> float | None:
    """Return the time of the first zero of a margin with the values `sampled` at the times t of a step to `end`.

    None if it has none, NaN if it is negative from the start.
    """
    # The first zero is not after the first negative sample.
    negative = np.flatnonzero((sampled < -NOISE) & (FRACTIONS <= 1.0))
    last = negative[0] if len(negative) else len(t) - 1

    # Search dips between samples, near sampled minima that are low enough. A convex function lies
    # above the continuation of its chords, so that it stays positive if the value exceeds both
    # differences.
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

    # Search the change of sign between samples.
    if not len(negative):
        return None
    positive = np.flatnonzero(sampled[:last] > 0)
    if not len(positive):
        return np.nan
    return float(brentq(evaluate, t[positive[-1]], t[last], xtol=_ZERO_XTOL, rtol=_ZERO_RTOL))


def _after(contact: Contact, mode: Mode, t: float, y: np.ndarray, passed: Iterable[Margin]) -> Mode:
    """Return the mode after an event at t (s) in the state y, at which the margins `passed` have passed zero."""
    slip = mode.slip.copy()
    corner = mode.corner.copy()
    left: set[int] = set()
    slips_change = False
    springs = list(mode.springs)
    for margin in passed:
        if margin.what in ("stretch", "tension"):
            old = mode.springs[margin.guide]
            if springs[margin.guide] != old:
                continue  # stretch and tension pass zero together
            after_tension = CLAMPED if old == ACTS else ACTS
            after_stretch = ACTS if old == FREE else FREE
            new = after_tension if margin.what == "tension" else after_stretch
            springs[margin.guide] = new
            # the tension of a damped spring jumps at its contact
            slips_change |= old == FREE and contact.is_damped[margin.guide]
        elif margin.what == "corner":
            # A corner force passes zero continuously: only its sign changes.
            corner[margin.guide, margin.which] *= -1
            if not contact.length[margin.guide]:
                corner[margin.guide, 1] = corner[margin.guide, 0]
        elif margin.what == "hold":
            slip[margin.guide] = margin.which
            slips_change = True
            left.add(margin.guide)
        else:
            slip[margin.guide] = 0
            slips_change = True
    if not slips_change:
        return Mode(slip, corner, tuple(springs))
    if np.any(slip == 0):
        # Guides that cannot slip without those at rest are at rest as well. Their speeds are rounding.
        q, v = np.split(y, 2)
        terms = contact.terms(t, q, v, tuple(springs))
        slip[sorted(contact.held_with(terms, np.flatnonzero(slip == 0)))] = 0
    return contact.settle(t, y, slip, left, tuple(springs))


def _changes(before: Mode, after: Mode) -> Iterator[tuple[int, str]]:
    """Yield the index of each guide whose contact mode changes, and the kind of its event."""
    for g, (old, new) in enumerate(zip(before.slip, after.slip)):
        if new != old and old == 0:
            yield g, "slip"
        elif new != old:
            yield g, "stick" if new == 0 else "reversal"
        elif new and np.any(before.corner[g] != after.corner[g]):
            yield g, "corner"


def _audit(contact: Contact, mode: Mode, piece: DenseOutput, end: float) -> tuple[float, float]:
    """Return the largest violation of Coulomb's law and of the constraints inside a step, and the largest reaction.

    The law is evaluated from the sign of the velocity and from R and T alone, without the corner signs of the mode. In
    the middle of the step all modes are tried: the motion of the mode must be the only one.

    Raises
    ------
    _Stopped
        If there are several motions, or a different one.
    """
    t = piece.t_old + _AUDITED * (end - piece.t_old)
    q, v = np.split(piece(t).T, 2, -1)
    terms = contact.terms(t, q, v, mode.springs)
    forces = contact.forces(terms, mode)
    mu, bound, radius = np.broadcast_arrays(
        *contact.kinetic(terms, mode.slip), contact.radii_in_slip(terms, mode.slip), forces.f
    )[:3]
    violations = [
        np.max(np.abs(terms.phi), initial=0.0),
        np.max(np.abs(terms.phi_dot), initial=0.0),
        *(-np.min(value) for _, value in contact.spring_margins(q, v, mode.springs)),
    ]
    for g, d in enumerate(mode.slip):
        R, T, f, speed = forces.R[:, g], forces.T[:, g], forces.f[:, g], terms.slip_speed[:, g]
        if d == 0:
            # At rest there is no speed, and friction is within the capacity in either direction.
            mus = contact.mus[g]
            held = contact.static_bound[g] + contact.static_radius[g] * np.hypot(R, T)
            excesses = (
                -away * f - held - mus * contact.load(g, R, T, mus, away) for away in (1, -1)
            )
            violations += [np.max(np.abs(speed)), *map(np.max, excesses)]
        else:
            # In slip friction follows the law if the speed is large enough to have a sign.
            sign = np.sign(speed)
            direction = np.where(sign == 0, d, sign)
            load = contact.load(g, R, T, mu[:, g], d)
            by_force = radius[:, g] * np.hypot(R, T)
            friction = -direction * (bound[:, g] + mu[:, g] * load + by_force)
            errors = np.where(np.abs(speed) > NOISE, np.abs(f - friction), 0.0)
            violations.append(np.max(errors))

    # Uniqueness is checked at one instant only, because this check is expensive.
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
