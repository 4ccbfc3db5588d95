"""A second method for mechanisms with several freedoms and frictional guides, slow, without the reference's kernels.

The motion follows from three decisions, each made here in another way than in `reference_impl`:

- The forces of a contact mode: one dense linear solve with the corner forces themselves as unknowns. A guide that slips
  in the direction d has n_j = F+_j - F-_j, of the sign s_j, at the lever -+ a/2; its surfaces turn the slider by b/2:

      force of n_j on the slider = normal row + (-+ a/2) angle row - mu d (s_j tangential row + (b/2) angle row)

- The mode: every combination of stick, slip to either side and corner signs is tried, and kept if no corner pulls, no
  friction at rest exceeds what its surfaces hold, and every guide that leaves rest leaves it against its friction. More
  than one acceleration is reported, not chosen from.
- Events: scipy's DOP853, with every margin of the mode sampled in every step, near its start down to 1e-9 of it. A
  margin that dips between samples is minimised; a first zero is found by Brent's method.

What a guide at rest holds against slip in the direction d. Its surface frictions l+, l- obey |l+-| <= mus FN+-, and the
corner forces carry the moment that they leave of T, D = n2 - n1 = (2/a)(T - (b/2)(l+ - l-)). The largest -d (l+ + l-)
of this linear programme has both surfaces at their bound as long as its two multipliers, 1 -+ mus b/a, are not
negative: unless the guide locks itself (mus b > a). Then l+ - l- = -mus d R, and

    capacity(d) = mus max(|R|, (2/a) |T + (b/2) mus d R|)

A self-locking guide can jam under stress of its own and has several motions; it is refused. All tolerances are
absolute, in m, s, kg, rad: for mechanisms of about a metre, a second and a kilogram.

`stiction.truths.one_freedom` is another: it goes on to the rest of all guides at once, which is
redundant here, and has neither several freedoms nor drives nor loads that depend on time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from random_mechanisms import SeededDice, moderate_scene
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq, minimize_scalar

from stiction.reference_impl.equations_of_motion import EquationsOfMotion, Terms
from stiction.scenes import Breakdown, Scene, Trajectory, scene_from_dict
from stiction.scenes.laws import law_kinks
from stiction.truths.one_freedom import Instant

TOLERANCE = 1e-11
"""Of a step."""
STEPS = 60
"""No step is longer than the run over this."""
FRACTIONS = np.unique(np.concatenate([[0.0], 2.0 ** -np.arange(7, 31), np.arange(1, 66) / 64]))
"""Of a step, where the margins are looked at; one behind its end, so that a minimum at the end lies between samples."""
NOISE = 1e-9
"""N or m/s; margins above minus this count as zero: the error of forty steps, times stiffnesses up to 60 N/m."""
ADMISSIBLE = 1e-8
"""N or m/s^2 by which a mode may violate its conditions: the same, with a reserve of ten, at an event."""
SAME = 1e-6
"""m/s^2, rad/s^2; accelerations closer than this are one: those of two modes at their common boundary."""
CORNERS = tuple(product((1, -1), repeat=2))
"""Signs of both corner forces of a guide."""
AT_ONCE = 1e-11
"""Seconds within which events are one: what rounding leaves of a time."""
MOST_AT_ONCE = 20
"""Events without time passing after which a run is given up."""
RESERVE = 1e3
"""How much larger than the tolerance of a step the error of a motion may be: a hundred steps, amplified by ten."""


@dataclass(frozen=True)
class Mode:
    """What is frozen between events."""

    slip: np.ndarray  # (guides,), the directions d, 0 at rest
    corner: np.ndarray  # (guides, 2), the signs s


@dataclass(frozen=True)
class Forces:
    """Of a mode at instants, or of many modes at one; leading axes as those."""

    acceleration: np.ndarray  # (..., k)
    R: np.ndarray  # (..., guides), normal force on each slider
    T: np.ndarray  # total moment
    f: np.ndarray  # friction
    n: np.ndarray  # (..., guides, 2), corner forces of guides that slip (without a length: R, R)


@dataclass(frozen=True)
class Margin:
    """A condition of a mode, positive while it holds: of `guide`, ``"speed"``, ``"corner"`` j or ``"hold"`` along d."""

    guide: int
    what: str
    which: int = 0


@dataclass(frozen=True)
class Motion:
    """What the second method found."""

    t: np.ndarray  # (n,), the ends of all steps
    q: np.ndarray  # (n, k)
    v: np.ndarray
    events: tuple[Instant, ...]
    """The rate (N/s or m/s^2) is that of the margin that passes zero: an error e of the margin shifts the time by e /
    rate."""
    violation: float
    """The largest of Coulomb's law (N, m/s) and of the constraints (m, m/s) at instants inside the steps."""
    force: float
    """The largest reaction there, N."""
    breakdown: Breakdown | None


class _Stopped(Exception):
    """Carries the breakdown out of the search."""

    def __init__(
        self, kind: str, time: float, reason: str, guide: str = "", solutions: int | None = None
    ):
        self.breakdown = Breakdown(kind, float(time), reason, guide, solutions)


class Contact:
    """Contact modes of a mechanism: their forces, their margins, and which are possible."""

    def __init__(self, scene: Scene):
        self.equations = EquationsOfMotion(scene)
        self.names = list(self.equations.guides)
        guides = self.equations.guides.values()
        self.row = [self.equations.rows.index(f"{name}.normal_force") for name in self.names]
        self.length = [guide.length for guide in guides]
        self.width = [guide.width or 0.0 for guide in guides]
        self.mu = np.array([guide.mu for guide in guides])
        self.mus = np.array([guide.static_coefficient for guide in guides])
        for name, a, b, mus in zip(self.names, self.length, self.width, self.mus):
            if a and mus * b >= a:
                raise ValueError(
                    f"{name}: found width {b:g}; expected less than length/mus = {a / mus:g}, where it "
                    "starts to lock itself"
                )

    def forces(self, terms: Terms, mode: Mode, mu: np.ndarray) -> Forces:
        """Forces and accelerations of modes that share `slip`, with a coefficient of friction for each guide.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the constraints of the mode are redundant.
        """
        stuck = np.flatnonzero(mode.slip == 0)
        rows = np.concatenate([terms.J, terms.W[..., stuck, :]], -2)
        shape = np.broadcast_shapes(rows.shape[:-2], mode.corner.shape[:-2])
        acts = np.broadcast_to(rows, (*shape, *rows.shape[-2:])).copy()
        for g in np.flatnonzero(mode.slip):
            r, friction, s = self.row[g], -mu[g] * mode.slip[g], mode.corner[..., g, :, None]
            normal, angle, along = (
                terms.J[..., self.row[g], :],
                terms.J[..., self.row[g] + 1, :],
                terms.W[..., g, :],
            )
            if self.length[g] is None:
                acts[..., r, :] = normal + friction * s[..., 0, :] * along
            else:
                for j, lever in enumerate((-self.length[g] / 2, self.length[g] / 2)):
                    surface = s[..., j, :] * along + self.width[g] / 2 * angle
                    acts[..., r + j, :] = normal + lever * angle + friction * surface
        mass = self.equations.mass
        right = -np.concatenate([terms.gamma, terms.w[..., stuck]], -1)
        right = right - np.sum(rows * (terms.QE / mass)[..., None, :], -1)
        right = np.broadcast_to(right, (*shape, right.shape[-1]))
        x = np.linalg.solve(rows / mass @ np.swapaxes(acts, -1, -2), right[..., None])[..., 0]
        acceleration = (terms.QE + np.sum(acts * x[..., None], -2)) / mass
        R, T, f = np.zeros((3, *shape, len(self.row)))
        n = np.zeros((*shape, len(self.row), 2))
        for g, r in enumerate(self.row):
            friction, s = -mu[g] * mode.slip[g], mode.corner[..., g, :]
            first, second = x[..., r], x[..., r + 1]
            if mode.slip[g] == 0:
                R[..., g], T[..., g], f[..., g] = (
                    first,
                    second,
                    x[..., terms.J.shape[-2] + np.searchsorted(stuck, g)],
                )
            elif self.length[g] is None:
                R[..., g], T[..., g], f[..., g] = first, second, friction * s[..., 0] * first
                n[..., g, :] = first[..., None]
            else:
                R[..., g] = first + second
                T[..., g] = (
                    self.length[g] / 2 * (second - first) + friction * self.width[g] / 2 * R[..., g]
                )
                f[..., g] = friction * (s[..., 0] * first + s[..., 1] * second)
                n[..., g, 0], n[..., g, 1] = first, second
        return Forces(acceleration, R, T, f, n)

    def load(self, g: int, R: np.ndarray, T: np.ndarray, mu: float, d: int) -> np.ndarray:
        """|n1| + |n2| with both surfaces fully mobilized against slip in the direction d."""
        if self.length[g] is None:
            return np.abs(R)
        return np.maximum(
            np.abs(R), 2 / self.length[g] * np.abs(T + self.width[g] / 2 * mu * d * R)
        )

    def conditions(self, forces: Forces, mode: Mode) -> Iterator[tuple[Margin, np.ndarray]]:
        """What the forces of a mode must obey: corners press, and guides at rest hold. Each positive where it is."""
        for g, d in enumerate(mode.slip):
            if d == 0:
                for away in (1, -1):
                    held = self.mus[g] * self.load(
                        g, forces.R[..., g], forces.T[..., g], self.mus[g], away
                    )
                    yield Margin(g, "hold", away), held + away * forces.f[..., g]
            else:
                for j in range(1 if self.length[g] is None else 2):
                    yield Margin(g, "corner", j), mode.corner[..., g, j] * forces.n[..., g, j]

    def margins(self, t: np.ndarray, y: np.ndarray, mode: Mode) -> tuple[list[Margin], np.ndarray]:
        """All margins of a frozen mode at instants, (n, margins)."""
        terms = self.equations.at(t, *np.split(y, 2, -1))
        found = [
            *self.conditions(self.forces(terms, mode, self.mu), mode),
            *(
                (Margin(g, "speed"), d * terms.slip_speed[..., g])
                for g, d in enumerate(mode.slip)
                if d
            ),
        ]
        return [margin for margin, _ in found], np.stack([values for _, values in found], -1)

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
        mu, found = np.where([g in rest for g in range(len(slip))], self.mus, self.mu), []
        for slips in product(*((0, 1, -1) if g in rest else (d,) for g, d in enumerate(slip))):
            signs = [
                ((1, 1),) if d == 0 else ((1, 1), (-1, -1)) if self.length[g] is None else CORNERS
                for g, d in enumerate(slips)
            ]
            modes = Mode(
                np.array(slips, dtype=int),
                np.array(list(product(*signs))).reshape(-1, len(slip), 2),
            )
            forces = self.forces(terms, modes, mu)
            kept = np.all(np.isfinite(forces.acceleration), -1)
            for _, value in self.conditions(forces, modes):
                kept &= value >= -ADMISSIBLE
            for g in (rest | left) & set(np.flatnonzero(modes.slip)):
                kept &= (
                    modes.slip[g] * (forces.acceleration @ terms.W[g] + terms.w[g]) >= -ADMISSIBLE
                )
            for i in np.flatnonzero(kept):
                a = forces.acceleration[i]
                if all(np.max(np.abs(a - other)) > SAME for _, other in found):
                    found.append((Mode(modes.slip, modes.corner[i]), a))
        return found

    def settle(self, t: float, y: np.ndarray, slip: np.ndarray, left: set[int]) -> Mode:
        """The mode that follows at an instant; as `possible`, with all guides of no direction at rest.

        A guide whose friction at rest does not hold it leaves, and then has the kinetic coefficient, which may set
        others free.
        """
        terms, slip, left = self.equations.at(t, *np.split(y, 2)), slip.copy(), set(left)
        while True:
            rest = set(np.flatnonzero(slip == 0))
            found = self.possible(terms, slip, rest, left)
            if len(found) != 1:
                kind = "several solutions" if found else "no solution"
                raise _Stopped(kind, t, f"{kind} among all contact modes", solutions=len(found))
            [(mode, _)] = found
            leaving = {g for g in rest if mode.slip[g]}
            if not leaving:
                return mode
            slip, left = mode.slip, left | leaving


def simulate(scene: Scene, t_end: float) -> Motion:
    """The motion of a scene from its consistent start.

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
    loads = [*scene.drives.values(), *scene.forces.values()]
    stops = sorted({time for element in loads for time in law_kinks(element.law, t_end)} | {t_end})
    try:
        speed = contact.equations.at(t, q, v).slip_speed
        mode = contact.settle(
            t, y, np.where(np.abs(speed) <= NOISE, 0, np.sign(speed)).astype(int), set()
        )
        while t < t_end:
            stop = next(time for time in stops if time > t)
            began = t
            for piece, t, passed in _steps(contact, mode, t, y, stop, t_end / STEPS):  # noqa: B007, B020 - from t on, used behind
                y = piece(t)
                times.append(t)
                states.append(y)
                found = _audit(contact, mode, piece, t)
                violation, force = max(violation, found[0]), max(force, found[1])
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
    except np.linalg.LinAlgError:
        breakdown = Breakdown("singular", t, "the constraints of a contact mode are redundant")
    q, v = np.split(np.array(states), 2, -1)
    return Motion(np.array(times), q, v, tuple(events), violation, force, breakdown)


def _steps(
    contact: Contact, mode: Mode, t: float, y: np.ndarray, stop: float, longest: float
) -> Iterator[tuple[DenseOutput, float, list[tuple[Margin, float]]]]:
    """Steps of a frozen mode up to its end or `stop`: the dense output, its last instant, and the margins that pass
    zero there."""
    solver = DOP853(
        partial(contact.derivative, mode),
        t,
        y,
        stop,
        rtol=TOLERANCE,
        atol=TOLERANCE,
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
    """Where the first margin passes zero in a step, all that pass there, and how fast; the end of the step and none if
    none does."""
    t = piece.t_old + FRACTIONS * (piece.t - piece.t_old)
    margins, values = contact.margins(t, piece(t).T, mode)
    inside = FRACTIONS <= 1.0
    zeros: list[tuple[float, int]] = []
    for k, value in enumerate(values.T):

        def at(time: float, k: int = k) -> float:
            return float(contact.margins(np.array(time), piece(time), mode)[1][k])

        below = np.flatnonzero((value < -NOISE) & inside)
        last = below[0] if len(below) else len(t) - 1
        for i in range(1, last):
            left, right = value[i - 1] - value[i], value[i + 1] - value[i]
            # a convex function lies above the lines through its samples continued
            if value[i] > 0 and left >= 0 and right >= 0 and value[i] < max(left, right):
                lowest = minimize_scalar(
                    at,
                    bounds=(t[i - 1], t[i + 1]),
                    method="bounded",
                    options={"xatol": 1e-9 * (t[i + 1] - t[i - 1])},
                )
                if lowest.fun < -NOISE and lowest.x <= piece.t:
                    zeros.append((brentq(at, t[i - 1], lowest.x, xtol=1e-15, rtol=1e-14), k))
                    break
        else:
            if len(below):
                above = np.flatnonzero(value[:last] > 0)
                if not len(above):
                    name = contact.names[margins[k].guide]
                    raise _Stopped(
                        "mode not held",
                        piece.t_old,
                        f"{margins[k].what} falls below zero at once",
                        name,
                    )
                zeros.append((brentq(at, t[above[-1]], t[last], xtol=1e-15, rtol=1e-14), k))
    if not zeros:
        return piece.t, []
    first = min(time for time, _ in zeros)
    beside = first + 1e-6 * (piece.t - piece.t_old) * np.array([-1.0, 1.0])
    rates = np.abs(np.diff(contact.margins(beside, piece(beside).T, mode)[1], axis=0)[0]) / np.ptp(
        beside
    )
    return first, [(margins[k], float(rates[k])) for time, k in zeros if time - first <= AT_ONCE]


def _after(contact: Contact, mode: Mode, t: float, y: np.ndarray, passed: Iterable[Margin]) -> Mode:
    """The mode behind an event. A corner force is continuous where it passes zero: only its sign changes there."""
    slip, corner, left, decided = mode.slip.copy(), mode.corner.copy(), set(), False
    for margin in passed:
        if margin.what == "corner":
            corner[margin.guide, margin.which] *= -1
            if contact.length[margin.guide] is None:
                corner[margin.guide, 1] = corner[margin.guide, 0]
        elif margin.what == "hold":
            slip[margin.guide], decided = margin.which, True
            left.add(margin.guide)
        else:
            slip[margin.guide], decided = 0, True
    return contact.settle(t, y, slip, left) if decided else Mode(slip, corner)


def _changes(before: Mode, after: Mode) -> Iterator[tuple[int, str]]:
    for g, (old, new) in enumerate(zip(before.slip, after.slip)):
        if new != old:
            yield g, "slip" if old == 0 else "stick" if new == 0 else "reversal"
        elif new and np.any(before.corner[g] != after.corner[g]):
            yield g, "corner"


def _audit(contact: Contact, mode: Mode, piece: DenseOutput, end: float) -> tuple[float, float]:
    """The largest violation of Coulomb's law and of the constraints inside a step, and the largest reaction.

    Coulomb's law as it stands, by the sign of the velocity and the loads of R and T alone. In the middle of the step
    all modes are tried: there must be one motion, that of the mode.

    Raises
    ------
    _Stopped
        If there are several motions, or another one.
    """
    t = piece.t_old + np.linspace(0.05, 0.95, 9) * (end - piece.t_old)
    terms = contact.equations.at(t, *np.split(piece(t).T, 2, -1))
    forces = contact.forces(terms, mode, contact.mu)
    worst = [np.max(np.abs(terms.phi), initial=0.0), np.max(np.abs(terms.phi_dot), initial=0.0)]
    for g, d in enumerate(mode.slip):
        R, T, f, speed = forces.R[:, g], forces.T[:, g], forces.f[:, g], terms.slip_speed[:, g]
        if d == 0:
            mus = contact.mus[g]
            excesses = (-away * f - mus * contact.load(g, R, T, mus, away) for away in (1, -1))
            worst += [np.max(np.abs(speed)), *map(np.max, excesses)]
        else:
            sign = np.sign(speed)
            friction = (
                -contact.mu[g]
                * np.where(sign == 0, d, sign)
                * contact.load(g, R, T, contact.mu[g], d)
            )
            worst.append(np.max(np.where(np.abs(speed) > NOISE, np.abs(f - friction), 0.0)))
    middle = Terms(*(getattr(terms, name)[4] for name in Terms.__dataclass_fields__))
    found = contact.possible(middle, mode.slip, set(np.flatnonzero(mode.slip == 0)), set())
    if len(found) != 1 or np.max(np.abs(found[0][1] - forces.acceleration[4])) > SAME:
        kind = (
            "several solutions"
            if len(found) > 1
            else "no solution"
            if not found
            else "another solution"
        )
        raise _Stopped(
            kind, t[4], f"{kind} among all contact modes, inside a step", solutions=len(found)
        )
    return float(max(worst)), float(max(np.max(np.abs(forces.R)), np.max(np.abs(forces.f))))


def random_scene(seed: int, i: int, guides: tuple[int, int] = (2, 3)) -> Scene:
    """Scene i of a seed: moderate, with two or three frictional guides."""
    return scene_from_dict(
        moderate_scene(SeededDice((seed, i)), guides), f"random scene {i} of seed {seed}"
    )


def differences(scene: Scene, motion: Motion, run: Trajectory, rtol: float) -> list[str]:
    """Events and end state in which a run of the reference, of tolerance `rtol`, is another than the second method's
    motion.

    Margins and states may differ by RESERVE times the larger tolerance, relative to the largest force or coordinate; an
    event may be shifted by what such a difference of its margin shifts it. Where one of both stops, they are compared
    until then.
    """
    tolerance = RESERVE * max(rtol, TOLERANCE)
    stopped = [found.time for found in (run.breakdown, motion.breakdown) if found is not None]
    until = min(stopped) - 1e3 * tolerance if stopped else np.inf
    found = list(_event_differences(scene, motion, run, tolerance, until))
    if stopped:
        return found
    size = max(1.0, np.max(np.abs(motion.q)), np.max(np.abs(motion.v)))
    for body, q, v in zip(scene.bodies, motion.q[-1].reshape(-1, 3), motion.v[-1].reshape(-1, 3)):
        for label, value in zip(("x", "y", "angle", "vx", "vy", "omega"), (*q, *v)):
            error = abs(run[f"{body}.{label}"][-1] - value)
            if not error <= tolerance * size:
                found.append(f"{body}.{label} at the end differs by {error:.2g}")
    return found


def _event_differences(
    scene: Scene, motion: Motion, run: Trajectory, tolerance: float, until: float
) -> Iterator[str]:
    """What differs in the events of each guide before `until`, in order."""
    for name in scene.frictional_guides:
        expected = [event for event in motion.events if event.joint == name and event.time < until]
        found = [event for event in run.events if event.joint == name and event.time < until]
        for mine, its in zip(expected, found):
            window = tolerance * max(1.0, motion.force) / mine.rate
            if mine.kind != its.kind or not abs(mine.time - its.time) <= window:
                expectation = f"{mine.kind} at {mine.time:.9g} s within {window:.1g} s"
                yield f"{name}: {its.kind} at {its.time:.9g} s, expected {expectation}"
                break
        else:
            for event in expected[len(found) :]:
                yield f"{name}: no {event.kind} at {event.time:.9g} s"
            for event in found[len(expected) :]:
                yield f"{name}: {event.kind} at {event.time:.9g} s that is none"
