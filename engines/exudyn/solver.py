"""Exudyn's implicit solver: steps, states with accelerations and multipliers that belong to them, the matrix of both.

Index 3 leaves a residual of the velocity constraints; a restart would turn it into an impulse of the multipliers.
`on_velocity_constraints` removes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from stiction.engines.exudyn.bristles import BristleGuide
from stiction.engines.exudyn.model import Model
from stiction.engines.protocol import EngineFailure
from stiction.engines.shared.engine_clock import EngineClock
from stiction.scenes.laws import Constant, Linear, evaluate_law

INTEGRATORS = {
    "generalized-alpha": (False, False),
    "newmark": (True, False),
    "trapezoidal": (True, True),
}
"""Exudyn's implicit methods: True for Newmark's (beta 1/4, gamma 1/2), and for constraints met by velocities (index
2)."""
OPEN = 1e-9
"""Component of a null vector of unit length: larger ones are of reactions that redundant constraints leave open."""


class Solver:
    """Exudyn's solver of one assembled model, with its present time, state and multipliers.

    Attributes
    ----------
    redundant : bool
        True where constraints are redundant at the start: then Exudyn's solver for singular matrices is used.
    open_rows : ndarray of int
        Multipliers that redundant constraints leave open.
    coordinates, constraints : int
        Numbers of them.
    engine : exudyn.MainSolverImplicitSecondOrder
    clock : EngineClock
        CPU time of Exudyn's steps and initial accelerations, without callbacks.
    """

    def __init__(self, model: Model, settings: Any):
        import exudyn

        self.clock = EngineClock()
        self._settings, self._integration = settings, settings.timeIntegration
        self._system, self._data = model.system, model.system.systemData
        self._initial = exudyn.ConfigurationType.Initial
        self._start_of_step = exudyn.ConfigurationType.StartOfStep
        self._accelerated = [
            (model.rows[name][0], drive.law)
            for name, drive in model.scene.drives.items()
            if not isinstance(drive.law, (Constant, Linear))
        ]
        self.engine = exudyn.MainSolverImplicitSecondOrder()
        linear = settings.linearSolver
        # a solver that accepts redundant constraints first, to look for them; the other is faster
        linear.solverType, linear.ignoreSingularJacobian = exudyn.LinearSolverType.EigenDense, True
        self._initialize_solver()
        self.coordinates = len(self._data.GetODE2Coordinates())
        self.constraints = len(self._data.GetAECoordinates())
        self.redundant, self.open_rows = self._open_rows()
        if not self.redundant:
            linear.solverType, linear.ignoreSingularJacobian = (
                exudyn.LinearSolverType.EXUdense,
                False,
            )
            self._initialize_solver()

    def _initialize_solver(self) -> None:
        if not self.engine.InitializeSolver(self._system, self._settings):
            raise EngineFailure(self.failure("the solver could not be initialized"))

    def _open_rows(self) -> tuple[bool, np.ndarray]:
        """Return True where constraints are redundant, and the multipliers that they leave open."""
        jacobian = self.jacobian()
        active = np.flatnonzero(jacobian.any(axis=1))
        if not len(active) or (rank := np.linalg.matrix_rank(jacobian[active])) == len(active):
            return False, active[:0]
        return True, active[np.abs(np.linalg.svd(jacobian[active])[0][:, rank:]).max(axis=1) > OPEN]

    @property
    def t(self) -> float:
        return self._data.GetTime()

    @property
    def q(self) -> np.ndarray:
        return np.array(self._data.GetODE2Coordinates())

    @property
    def v(self) -> np.ndarray:
        return np.array(self._data.GetODE2Coordinates_t())

    @property
    def multipliers(self) -> np.ndarray:
        return np.array(self._data.GetAECoordinates())

    def accelerations(self) -> np.ndarray:
        """Return the present accelerations; EngineFailure if the state is not finite."""
        a = np.array(self._data.GetODE2Coordinates_tt())
        if not all(np.isfinite(values).all() for values in (self.q, self.v, a)):
            raise EngineFailure(self.failure(f"the state is not finite at t = {self.t:g} s"))
        return a

    def start_of_step(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return time, coordinates and velocities at the start of the last step."""
        return (
            self._data.GetTime(self._start_of_step),
            np.array(self._data.GetODE2Coordinates(self._start_of_step)),
            np.array(self._data.GetODE2Coordinates_t(self._start_of_step)),
        )

    def before_step(self, bristles: list[BristleGuide]) -> None:
        """Have the bounds of bristles renewed before each step, with the multipliers of the one before."""

        def renew() -> bool:
            for each in bristles:
                each.renew(self.multipliers)
            return True

        self._system.SetPreStepUserFunction(lambda system, t: self.clock.call_back(renew))

    def after_newton(self, judge: Callable[[], list[float]]) -> None:
        """Call a function after each Newton solution of a step: [error, recommended step]; an error repeats it."""
        self._system.SetPostNewtonUserFunction(lambda system, t: self.clock.call_back(judge))

    def steps(self, t0: float, t1: float, count: int) -> tuple[bool, int]:
        """Make steps of equal length; return True where none failed, and their number."""
        iteration = self.engine.it
        iteration.startTime = iteration.currentTime = t0
        iteration.endTime, iteration.maxStepSize = t1, (t1 - t0) / count
        self.engine.it = iteration
        self._integration.endTime = t1
        done = self.clock.call(self.engine.SolveSteps, self._system, self._settings)
        return done, self.engine.it.currentStepIndex - 1

    def set_state(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Set the initial state of the next steps."""
        self._data.SetODE2Coordinates(q, configuration=self._initial)
        self._data.SetODE2Coordinates_t(v, configuration=self._initial)
        self._integration.startTime = t
        self._data.SetTime(t, self._initial)

    def initial_accelerations(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return accelerations and multipliers of the initial state, by Exudyn, which leaves out those of drives."""
        self._initialize()
        a, multipliers = np.array(self._data.GetODE2Coordinates_tt()), self.multipliers
        if self._accelerated:
            change = self._solve({row: evaluate_law(law, t)[2] for row, law in self._accelerated})
            a, multipliers = (
                a + change[: self.coordinates],
                multipliers + change[self.coordinates :],
            )
        return a, multipliers

    def keep_accelerations(self, a: np.ndarray) -> None:
        """Start the next step with these accelerations where Exudyn's own lack those of drives."""
        if self._accelerated:
            self._data.SetODE2Coordinates_tt(a, configuration=self._initial)
            self._integration.generalizedAlpha.computeInitialAccelerations = False
            self._initialize()
            self._integration.generalizedAlpha.computeInitialAccelerations = True

    def _initialize(self) -> None:
        self.clock.call(self.engine.InitializeSolverInitialConditions, self._system, self._settings)

    def on_velocity_constraints(
        self, t: float, q: np.ndarray, v: np.ndarray, idle: list[int]
    ) -> np.ndarray:
        """Return the velocities that meet all constraints but the idle ones, changed least in kinetic energy."""
        self.set_state(t, q, v)
        self._initialize()
        self.engine.ComputeAlgebraicEquations(self._system, True)
        residual = np.array(self.engine.GetSystemResidual())[self.coordinates :]
        return (
            v
            + self._solve({row: -value for row, value in enumerate(residual) if row not in idle})[
                : self.coordinates
            ]
        )

    def jacobian(self) -> np.ndarray:
        """Return C_q at the present state, shape (constraints, coordinates)."""
        return self._matrix()[self.coordinates :, : self.coordinates]

    def _solve(self, right: dict[int, float]) -> np.ndarray:
        """x of [M C_q^T; C_q 0] x = [0; right] at the present state; least squares if constraints are redundant."""
        system = self._matrix()
        vector = np.zeros(len(system))
        for row, value in right.items():
            vector[self.coordinates + row] = value
        return np.linalg.lstsq(system, vector, rcond=None)[0]

    def _matrix(self) -> np.ndarray:
        """[M C_q^T; C_q 0], with 1 on the diagonal for connectors that are not active."""
        self.engine.SetSystemJacobian(np.zeros_like(np.array(self.engine.GetSystemJacobian())))
        self.engine.ComputeJacobianAE(self._system, 1.0, 1.0, 1.0, False)
        system = np.array(self.engine.GetSystemJacobian())
        count = self.coordinates
        system[:count, :count] += np.array(self.engine.GetSystemMassMatrix())
        return system

    def failure(self, what: str) -> str:
        """Say what failed, with Exudyn's own words."""
        return f"{what}; {self.engine.GetErrorString()}".rstrip("; ")
