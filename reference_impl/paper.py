"""Zhuang & Wang (2014), eqs. (1)-(38), as written.

Dense NumPy, in the paper's order and with its symbols, nothing compiled. Constraints, sliding of the guides and applied
forces, (8) and (18)-(21), are those of `equations_of_motion` beside it.

Read this with the paper; `hlcp` and `paper_scheme` are the same for many guides, redundant constraints and speed. It
has what the paper has: revolute joints, sliders with corner forces on fixed or moving guides, drives, springs, loads,
Baumgarte's stabilization.

=============== ================= ================================================ ====== =============================
paper           here              what                                             unit   compiled
=============== ================= ================================================ ====== =============================
(1)-(2)         F_plus, F_minus   corner forces, >= 0, one of a pair is 0          N      lemke.lemke
(3)             mubar, mus        Coulomb's law: slipping, sticking surfaces       1      coulomb.friction_coefficients
(4), (10)       H, G              normal force of each surface: FN = H F+ + G F-   1      hlcp.assemble
(5), (13), (16) gH_plus, gH_minus sticking surfaces: gH'' = gH+ - gH-              m/s^2  hlcp.assemble
(6), (14), (17) lH_plus, lH_minus lH+- = muH FN +- lambda_H, lH+ = 2 muH FN - lH-  1, N   hlcp.assemble
(7), (15)       lemke             gH+, lH+ >= 0, one is 0; likewise gH-, lH-              lemke.lemke
(8)             W, w              sliding velocity of a guide: W q'                1      kinematics.constraints_at
(9)             W_T, w_T          slip of surfaces (+), (-): gT' = W_T q'          1, m   hlcp.assemble
(11)            mubar, V          lambda_T = mubar FN + V lambda_H, V: sticking    1      hlcp.assemble
(12)            M2, w_T           gH'' = W_H q'' + w_H, W_H = V^T W_T                     hlcp.assemble
(18)-(20)       phi, J, gamma     constraints [CR; CT; D]; Phi'' = J q'' + gamma   m, rad kinematics.constraints_at
(21)            M, QE             masses; applied and inertial forces              kg, N  dynamics.applied_forces
(22)-(24)       J, W_T            M q'' = QE + J^T lambda_C + W_T^T lambda_T       N, N m dynamics.acceleration
(25), (31)      correction        Baumgarte's stabilization, alpha and beta        m/s^2  baumgarte.required
(26)            S, K              reaction of a guide: lCT = S F+ + K F-, K = -S   1, m   hlcp.assemble
(27)-(28)       l_plus, l_minus   lCR, lD as differences of nonnegative parts      N, N m hlcp.assemble
(29)-(30)       lemke             these parts >= 0, one of each pair is 0                 lemke.lemke
(32), (35)      A0, A1, b         rows of the sticking surfaces                    m/s^2  hlcp.assemble
(33)            solve             q'' from multipliers and frictions               m/s^2  dynamics.acceleration
(34)            A0, A1, b         rows of the constraints                          m/s^2  hlcp.assemble
(36)            hlcp              A0 y = A1 x + b, with the rows of (17)                  hlcp.assemble
(37)            solve             y = (A0^-1 A1) x + A0^-1 b                              hlcp.solve
(38)            lemke             y, x >= 0, y^T x = 0, by pivoting                       lemke.lemke
=============== ================= ================================================ ====== =============================

The compiled files are in ``friction`` and ``multibody``. `hlcp.solve` calls `lemke`, and `hlcp.read` takes its result:
this is at the start and at events. Between them `frozen_mode.solve_mode` has the same forces by one linear solve.
q, v are the coordinates of each body, x, y, angle (m, rad), and their rates.

Where the paper is silent the choices are those of `paper_scheme`.

Beyond the paper, and ours: dry friction whose bound has a constant part, c in slip and cH at rest, beside that by the
normal force. The directions of W_T are the two surfaces of each guide, which have half of its constant each, and one
for each pin, the relative rotation g_P' = th_1 - th_2, whose bound is the constant alone: its rows of H, G, mu and mus
are zero. A drive with a limit is such a direction too, in place of its row of (19): g_D' = s' - law'(t), so that w_T
has -law''(t). Five equations are extended, and all others stay as they are:

============ ========================================================= ==============
extension of equation                                                  compiled
============ ========================================================= ==============
ours, (3)    slip: lambda_T = -(c + mu FN) sgn(gT')                    hlcp.assemble
ours, (6)    stick: |lambda_T| <= cH + mus FN                          hlcp.assemble
ours, (14)   lH+- = muH FN + cH +- lambda_H                            hlcp.assemble
ours, (17)   lH+ = 2 (muH FN + cH) - lH-                               hlcp.assemble
ours, (36)   b: QE + W_T^T e in place of QE, and 2 cH in its last rows hlcp.assemble
============ ========================================================= ==============

With Stribeck's curve c and mu are those of the speed |gT'| of the instant, cH and mus those of gT' = 0.

Here e = -sgn(gT') c - V cH is the part of lambda_T that is neither a multiple of FN nor of lH+: lambda_T = mt FN +
V lH+ + e. Without mu and mus the problem is convex (`uniqueness`): it has one solution.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import brentq

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.friction.outcomes import BREAKDOWNS, NOT_FINITE
from stiction.scenes import Breakdown, Problem, Scene, SceneError
from stiction.scenes.model import Baumgarte, Drive, NoStabilization, Translational
from stiction.scenes.stribeck import remaining_excess

COVER = 10.0
"""Weight of the rows of lH- in Lemke's covering vector, those of others being 1. With equal weights the method runs
into the ray of a sticking surface without load, on which gH+ and gH- grow together: the sliding of a resting block has
it."""
REST = 1e-12
"""Acceleration of a sticking surface, relative to the largest there is, up to which it is rounding."""
ZERO = 1e-12
"""Ratios and pivots of Lemke's method that differ by less, relatively, are equal."""
PARTS = 50
"""Reversals and stops within one step after which a march is given up."""


class HLCP(NamedTuple):
    """HLCP A0 y = A1 x + b, and the matrices it was made from.

    y = [lCR+, lD+, F-, gH+, lH-], x = [lCR-, lD-, F+, lH+, gH-].
    """

    A0: np.ndarray
    A1: np.ndarray
    b: np.ndarray
    M: np.ndarray
    QE: np.ndarray
    J: np.ndarray
    W_T: np.ndarray
    mt: np.ndarray
    V: np.ndarray
    e: np.ndarray


class Solution(NamedTuple):
    """Accelerations, multipliers and frictions.

    `acceleration` is (k,). `lambda_C` (rows,) is as `EquationsOfMotion.rows`: of a guide the resultant force and total
    moment on the slider, surface friction included. `friction` (frictional,) acts on each slider along its guide, or is
    the torque on the first body of a pin. `gH` are accelerations of those that stick, up to `rest` by rounding.
    """

    acceleration: np.ndarray
    lambda_C: np.ndarray
    friction: np.ndarray
    gH: np.ndarray
    rest: float


class March(NamedTuple):
    """State as each step begins: `t` (n,); `q`, `v`, `a` (n, k); `force` (n, rows + frictional): lambda_C, frictions.

    `mode` (n, frictional). `events`: time, kind as of `stiction.scenes.Event`, joint. `sides`: a march of two rows per
    event, before and after it, or None. `breakdown`: why it ended early, or None.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    force: np.ndarray
    mode: np.ndarray
    events: tuple[tuple[float, str, int], ...]
    breakdown: Breakdown | None
    sides: March | None = None


class NoSolution(Exception):
    """The problem of an instant has no unique answer by this method.

    `kind` and reason as of `stiction.scenes.Breakdown`.
    """

    def __init__(self, kind: str, reason: str):
        super().__init__(reason)
        self.kind = kind


class Paper:
    """The method for a scene; `mode` is sgn gT of each slider and pin with friction, 0 for those in the stick set H.

    Raises
    ------
    SceneError
        For what the paper does not have: guides without friction or length, projection.
    """

    def __init__(self, scene: Scene):
        stabilization = scene.stabilization
        problems = [
            Problem(
                f"joints.{name}.{key}", "nothing", "expected a value: the paper's sliders have both"
            )
            for name, guide in scene.guides.items()
            for key in ("mu", "length")
            if getattr(guide, key) is None
        ]
        problems += [
            Problem(
                f"joints.{name}.mu", f"{pin.mu:g}", "expected none: the paper's pins have no load"
            )
            for name, pin in scene.pins.items()
            if pin.is_under_load
        ]
        if not isinstance(stabilization, (Baumgarte, NoStabilization)):
            problems.append(
                Problem(
                    "stabilization.method",
                    repr(stabilization.method),
                    "expected 'baumgarte', the paper's, or 'none'",
                )
            )
        if problems:
            raise SceneError(scene._origin, problems)
        self.equations = EquationsOfMotion(scene)
        self.alpha, self.beta = (
            (stabilization.alpha, stabilization.beta)
            if isinstance(stabilization, Baumgarte)
            else (0.0, 0.0)
        )
        # the directions of friction: `joint`, the frictional joint that each belongs to, and `lever`, +- b/2
        guides = list(scene.guides.values())
        self.a = np.array([g.length for g in guides])
        self.width = np.array([g.width or 0.0 for g in guides])
        self.surfaces: list[np.ndarray] = []
        joint: list[int] = []
        for j, element in enumerate(self.equations.frictional.values()):
            count = 2 if isinstance(element, Translational) else 1
            self.surfaces.append(len(joint) + np.arange(count))
            joint += [j] * count
        self.joint = np.array(joint, dtype=int)
        on_guide = [isinstance(f, Translational) for f in self.equations.frictional.values()]
        #: the directions that are surfaces of guides, both of one guide after another
        self.on_surface = np.flatnonzero(np.repeat(on_guide, [len(s) for s in self.surfaces]))
        directions = len(self.joint)
        self.lever = np.zeros(directions)
        self.lever[self.on_surface] = np.kron(self.width / 2, [1.0, -1.0])
        self.mu, self.mus = np.zeros(directions), np.zeros(directions)
        self.mu[self.on_surface] = np.repeat([g.mu for g in guides], 2)
        self.mus[self.on_surface] = np.repeat([g.static_coefficient for g in guides], 2)
        # c and cH: each surface has half of the constant of its guide
        share = np.array([len(self.surfaces[j]) for j in self.joint], dtype=float)
        bounds = np.array([f.bounds for f in self.equations.frictional.values()]).reshape(-1, 2)
        self.c, self.cH = (bounds[self.joint] / share[:, None]).T
        self.frictional = list(self.equations.frictional.values())
        first = next(
            (i for i, row in enumerate(self.equations.rows) if row.endswith(".normal_force")), 0
        )
        S_i = [np.array([[1.0, 1.0], [-a / 2, a / 2]]) for a in self.a]
        self.S = block_diag(*S_i) if S_i else np.zeros((0, 0))  # (26)
        self.K = -self.S
        # (4), (10); a pin has no normal force
        self.H, self.G = np.zeros((2, directions, 2 * len(S_i)))
        self.H[self.on_surface] = np.kron(np.eye(len(S_i)), [[1, 1], [0, 0]])
        self.G[self.on_surface] = np.kron(np.eye(len(S_i)), [[0, 0], [1, 1]])
        self.CT = np.arange(first, first + 2 * len(self.a))
        self.CR_D = np.setdiff1d(np.arange(len(self.equations.rows)), self.CT)

    def hlcp(self, t: float, q: np.ndarray, v: np.ndarray, mode: np.ndarray) -> HLCP:
        """Eq. (36) at an instant.

        Beyond the paper: in w_T the angle of a slider counts with its stabilization, so that off the constraints too
        both surfaces of a sticking slider rest. The angle of the paper's slider cannot drift.
        """
        terms = self.equations.at(t, q, v)
        M, QE, J = np.diag(self.equations.mass), terms.QE, terms.J
        J_CT, J_lr = J[self.CT], J[self.CR_D]
        on_surface, lever = self.on_surface, self.lever[self.on_surface]
        W_T, w_T = terms.W[self.joint], terms.w[self.joint]
        W_T[on_surface] += lever[:, None] * np.repeat(J_CT[1::2], 2, 0)  # (8)-(9)
        correction = 2 * self.alpha * terms.phi_dot + self.beta**2 * terms.phi  # (25), (31)
        w_T[on_surface] += lever * np.repeat((terms.gamma + correction)[self.CT[1::2]], 2)
        sign = mode[self.joint]  # sgn gT of each direction
        V = np.eye(len(sign))[:, sign == 0]  # (11)
        # Stribeck's curve: what is left of the excess at rest, at this speed of slip
        excess = np.array(
            [
                0.0 if isinstance(f, Drive) else remaining_excess(f, v)
                for f, v in zip(self.frictional, terms.slip_speed)
            ]
        )[self.joint]
        mu, c = self.mu + excess * (self.mus - self.mu), self.c + excess * (self.cH - self.c)
        mubar = np.diag(-mu * sign)  # (3), (11)
        muH = V.T @ np.diag(self.mus)  # (14)
        mt = mubar - V @ muH
        cH = V.T @ self.cH  # (14), extended
        e = -sign * c - V @ cH  # (3), extended
        QE_e = QE + W_T.T @ e
        H, G, S, K = self.H, self.G, self.S, self.K
        M1, M2 = J @ np.linalg.inv(M), V.T @ W_T @ np.linalg.inv(M)  # (12)
        MKG, MSH = J_CT.T @ K + W_T.T @ mt @ G, J_CT.T @ S + W_T.T @ mt @ H
        rows, h = len(J), V.shape[1]
        E, none = np.eye(h), np.zeros
        A0 = np.block(
            [
                [M1 @ J_lr.T, M1 @ MKG, none((rows, h)), none((rows, h))],  # (31), (34)
                [M2 @ J_lr.T, M2 @ MKG, -E, none((h, h))],  # (32), (35)
                [none((h, len(J_lr))), -2 * muH @ G, none((h, h)), E],
            ]
        )  # (17)
        A1 = np.block(
            [
                [M1 @ J_lr.T, -M1 @ MSH, -M1 @ W_T.T @ V, none((rows, h))],
                [M2 @ J_lr.T, -M2 @ MSH, -M2 @ W_T.T @ V, -E],
                [none((h, len(J_lr))), 2 * muH @ H, -E, none((h, h))],
            ]
        )
        b = np.concatenate(
            [-(M1 @ QE_e + terms.gamma + correction), -(M2 @ QE_e + V.T @ w_T), 2 * cH]
        )
        return HLCP(A0, A1, b, M, QE, J, W_T, mt, V, e)  # (36)

    def solve(self, t: float, q: np.ndarray, v: np.ndarray, mode: np.ndarray) -> Solution:
        """Solve the HLCP by Lemke's method, and eq. (33) for the accelerations.

        Raises
        ------
        NoSolution
            If A0 is singular, Lemke's method ends on a ray, or a term is not finite.
        """
        A0, A1, b, M, QE, J, W_T, mt, V, e = self.hlcp(t, q, v, mode)
        if not (np.all(np.isfinite(A0)) and np.all(np.isfinite(b))):
            raise NoSolution(*BREAKDOWNS[NOT_FINITE])
        if len(A0) and not np.linalg.cond(A0) < 1 / ZERO:
            raise NoSolution("singular", "A0 is singular: redundant constraints")
        smooth, corners, surfaces = len(self.CR_D), 2 * len(self.a), V.shape[1]
        cover = np.ones(len(b))
        cover[len(b) - surfaces :] = COVER
        # (37)-(38), of which (1)-(2), (7), (15), (29)-(30) are parts
        y, x = lemke(np.linalg.solve(A0, A1), np.linalg.solve(A0, b), cover)
        parts = np.cumsum([smooth, corners, surfaces])
        l_plus, F_minus, gH_plus, _ = np.split(y, parts)
        l_minus, F_plus, lH_plus, gH_minus = np.split(x, parts)
        FN = self.H @ F_plus + self.G @ F_minus  # (4), (10)
        lambda_T = mt @ FN + V @ lH_plus + e  # (6), (11), (14)
        lambda_C = np.zeros(len(J))
        lambda_C[self.CR_D] = l_plus - l_minus  # (27)-(28)
        lambda_C[self.CT] = self.S @ F_plus + self.K @ F_minus  # (26)
        acceleration = np.linalg.solve(M, QE + J.T @ lambda_C + W_T.T @ lambda_T)  # (22)-(24), (33)
        on_guides = lambda_T[self.on_surface]
        lambda_C[self.CT[1::2]] += self.width / 2 * (on_guides[0::2] - on_guides[1::2])
        friction = np.bincount(self.joint, lambda_T, len(self.surfaces))
        terms = np.abs(
            W_T @ np.linalg.solve(M, np.hstack([QE[:, None], J.T * lambda_C, W_T.T * lambda_T]))
        )
        # (5), (13), (16); the two surfaces of a slider have the same acceleration
        gH = np.zeros(len(self.joint))
        gH[np.flatnonzero(mode[self.joint] == 0)] = gH_plus - gH_minus
        first_of_stuck = [self.surfaces[j][0] for j in np.flatnonzero(mode == 0)]
        return Solution(
            acceleration,
            lambda_C,
            friction,
            gH[first_of_stuck],
            REST * np.max(terms, initial=0.0),
        )

    def decide(
        self, t: float, q: np.ndarray, v: np.ndarray, mode: np.ndarray
    ) -> tuple[np.ndarray, Solution]:
        """Return `mode` after sliders have left the stick set, and its solution.

        A slider that leaves has the kinetic coefficient from then on, which may set others free.
        """
        mode = mode.copy()
        while True:
            found = self.solve(t, q, v, mode)
            stuck = np.flatnonzero(mode == 0)
            leaving = np.abs(found.gH) > found.rest
            if not np.any(leaving):
                return mode, found
            mode[stuck[leaving]] = np.sign(found.gH[leaving]).astype(int)

    def derivative(self, t: float, y: np.ndarray, mode: np.ndarray) -> np.ndarray:
        q, v = np.split(y, 2)
        return np.concatenate([v, self.solve(t, q, v, mode).acceleration])

    def march(self, q: np.ndarray, v: np.ndarray, dt: float, steps: int) -> March:
        """The scheme of Sect. 4.2 from a state at t = 0, `steps` steps of `dt` by the Runge-Kutta method of order 4.

        The stick set is decided at the start of a step. A step in which a slider's velocity changes its sign ends where
        it vanishes, and the rest of it follows from there.
        """
        y, mode = (
            np.concatenate([q, v]),
            np.sign(self.equations.at(0.0, q, v).slip_speed).astype(int),
        )
        rows: list[tuple[np.ndarray, ...]] = []
        sides: list[tuple[np.ndarray, ...]] = []
        events: list[tuple[float, str, int]] = []
        breakdown, t, old = None, 0.0, None
        try:
            for step in range(steps + 1):
                t, rest = step * dt, dt
                for part in range(PARTS):
                    q, v = np.split(y, 2)
                    mode, found = self.decide(t, q, v, mode)
                    row = _row(t, y, mode, found)
                    if old is not None and np.any(changed := mode != old):
                        left = _row(t, y, old, self.solve(t, q, v, old))
                        for g in np.flatnonzero(changed):
                            events.append(
                                (
                                    t,
                                    "slip"
                                    if old[g] == 0
                                    else "stick"
                                    if mode[g] == 0
                                    else "reversal",
                                    int(g),
                                )
                            )
                            sides += [left, row]
                    old = mode
                    if part == 0:
                        rows.append(row)
                    if step == steps:
                        break
                    h, first = self._length(t, y, rest, mode)
                    y, t, rest = (
                        runge_kutta(partial(self.derivative, mode=mode), t, y, h),
                        t + h,
                        rest - h,
                    )
                    if first >= 0:
                        mode = np.where(np.arange(len(mode)) == first, 0, mode)
                    if first < 0 or rest <= ZERO * dt:
                        break
                else:
                    raise NoSolution(
                        "chatter", f"more than {PARTS} changes of the contact mode within a step"
                    )
        except NoSolution as reason:
            breakdown = Breakdown(reason.kind, float(t), str(reason))
        k, n = len(q), len(mode)
        widths = ((), (k,), (k,), (k,), (len(self.equations.rows) + n,), (n,))

        def columns(rows: list[tuple[np.ndarray, ...]]) -> dict[str, Any]:
            return {
                name: np.reshape([row[i] for row in rows], (len(rows), *width))
                for i, (name, width) in enumerate(zip(March._fields, widths))
            }

        return March(
            **columns(rows),
            events=tuple(events),
            breakdown=breakdown,
            sides=March(**columns(sides), events=(), breakdown=None) if events else None,
        )

    def _length(self, t: float, y: np.ndarray, h: float, mode: np.ndarray) -> tuple[float, int]:
        """Length of a step of at most h, and the slider that comes to rest at its end; -1 if none does."""

        def speeds(length: float) -> np.ndarray:
            q, v = np.split(runge_kutta(partial(self.derivative, mode=mode), t, y, length), 2)
            return mode * self.equations.at(t + length, q, v).slip_speed

        begin, end = mode * self.equations.at(t, *np.split(y, 2)).slip_speed, speeds(h)
        stopped = np.flatnonzero(end < 0)
        if not len(stopped):
            return h, -1
        first = int(
            min(stopped, key=lambda g: begin[g] / (begin[g] - end[g]) if begin[g] > 0 else 0.5)
        )
        return brentq(
            lambda length: speeds(length)[first], 0.0, h, xtol=1e-15 * h, rtol=1e-15
        ) if begin[first] > 0 else 0.0, first


def _row(t: float, y: np.ndarray, mode: np.ndarray, found: Solution) -> tuple[np.ndarray, ...]:
    """An instant of a march."""
    return (
        np.array(t),
        *np.split(y, 2),
        found.acceleration,
        np.append(found.lambda_C, found.friction),
        mode,
    )


def runge_kutta(
    f: Callable[[float, np.ndarray], np.ndarray], t: float, y: np.ndarray, h: float
) -> np.ndarray:
    """One step of the classical method of order 4."""
    k1 = f(t, y)
    k2 = f(t + h / 2, y + h / 2 * k1)
    k3 = f(t + h / 2, y + h / 2 * k2)
    k4 = f(t + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def lemke(M: np.ndarray, q: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y = M x + q, y, x >= 0, y^T x = 0 by Lemke's complementary pivoting with the covering vector d > 0.

    Cottle, Pang & Stone, The Linear Complementarity Problem (1992), Algorithm 4.4.5; among tied rows that of the
    covering variable leaves, else the lexicographically smallest (Sect. 4.9), so that it cannot cycle.

    Raises
    ------
    NoSolution
        On a secondary ray.
    """
    n, size = len(q), np.max(np.abs(q), initial=0.0)
    if np.all(q >= 0):
        return q, np.zeros(n)
    T = np.hstack(
        [np.eye(n), -M, -d[:, None], q[:, None] / size]
    )  # y, x, the covering variable, right-hand side
    basis, row, entering = np.arange(n), int(np.argmin(q / d)), 2 * n
    while True:
        T[row] /= T[row, entering]
        others = np.arange(n) != row
        T[others] -= np.outer(T[others, entering], T[row])
        leaving, basis[row] = basis[row], entering
        if leaving == 2 * n:
            values = np.zeros(2 * n)
            values[basis] = np.maximum(T[:, -1], 0.0) * size
            return values[:n], values[n:]
        entering = (leaving + n) % (2 * n)
        candidates = np.flatnonzero(T[:, entering] > ZERO)
        if not len(candidates):
            raise NoSolution("ray", "Lemke's method ended on a ray")
        ratios = T[candidates, -1] / T[candidates, entering]
        tied = candidates[ratios <= np.min(ratios) + ZERO * (1 + np.min(ratios))]
        row = int(min(tied, key=lambda i: (basis[i] != 2 * n, *(T[i, :n] / T[i, entering]))))
