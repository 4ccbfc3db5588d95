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
"""Exudyn's implicit methods: whether they use Newmark's parameters (beta 1/4, gamma 1/2), and whether velocities meet
the constraints (index 2) instead of positions (index 3)."""
OPEN = 1e-9
"""Components of null vectors of unit length above which the reactions of redundant constraints are not determined:
smaller ones are rounding."""


class Solver:
    """Exudyn's solver of one assembled model, with its present time, state and multipliers.

    Attributes
    ----------
    redundant : bool
        True if constraints are redundant at the start: then Exudyn's solver for singular matrices is used.
    open_rows : ndarray of int
        Multipliers that redundant constraints do not determine.
    coordinates, constraints : int
        Number of coordinates and of constraints.
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
        # drives whose law has a second derivative, which `initial_accelerations` has to add
        self._accelerated = [
            (model.rows[name][0], drive.law)
            for name, drive in model.scene.drives.items()
            if not isinstance(drive.law, (Constant, Linear))
        ]
        self.engine = exudyn.MainSolverImplicitSecondOrder()
        # Begin with the linear solver that accepts singular matrices, in order to look for
        # redundant constraints. Without any, the faster solver takes its place.
        linear = settings.linearSolver
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
        """Return whether constraints are redundant, and the multipliers that they do not determine."""
        # rows of connectors that are not active are zero, and no constraints
        jacobian = self.jacobian()
        active = np.flatnonzero(jacobian.any(axis=1))
        if not len(active):
            return False, active
        rank = np.linalg.matrix_rank(jacobian[active])
        if rank == len(active):
            return False, active[:0]
        # The left null vectors of the Jacobian are the sets of reactions that do not act on the
        # motion. A multiplier that is part of any of them may have any value.
        left_singular_vectors = np.linalg.svd(jacobian[active])[0]
        null_vectors = left_singular_vectors[:, rank:]
        return True, active[np.abs(null_vectors).max(axis=1) > OPEN]

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
        """Update the bounds of bristles before each step, with the multipliers of the previous step."""

        def renew() -> bool:
            for each in bristles:
                each.renew(self.multipliers)
            return True

        self._system.SetPreStepUserFunction(lambda system, t: self.clock.call_back(renew))

    def after_newton(self, judge: Callable[[], list[float]]) -> None:
        """Call a function after each Newton solution of a step.

        It returns ``[error, recommended step size]``; see `stiction.engines.exudyn.stepping.REPEAT_STEP`.
        """
        self._system.SetPostNewtonUserFunction(lambda system, t: self.clock.call_back(judge))

    def steps(self, t0: float, t1: float, count: int) -> tuple[bool, int]:
        """Make steps of equal length; return whether all succeeded, and their number."""
        # Exudyn keeps time in `it`, a copy of which is changed and given back, and in its settings.
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
        """Return the accelerations and multipliers of the initial state."""
        self._initialize()
        a, multipliers = np.array(self._data.GetODE2Coordinates_tt()), self.multipliers
        # Exudyn takes the second derivative of a drive's law for zero. The equations are linear, so
        # the solution for these derivatives alone is added.
        if self._accelerated:
            change = self._solve({row: evaluate_law(law, t)[2] for row, law in self._accelerated})
            a, multipliers = (
                a + change[: self.coordinates],
                multipliers + change[self.coordinates :],
            )
        return a, multipliers

    def keep_accelerations(self, a: np.ndarray) -> None:
        """Start the next step with these accelerations if Exudyn's own lack those of drives."""
        # Exudyn would compute its own accelerations again, unless it is told not to for this once.
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
        # The change dv of least dv' M dv with C_q dv = -(residual of the velocity constraints) is the
        # solution of the matrix of `_solve` with that right-hand side.
        self.engine.ComputeAlgebraicEquations(self._system, True)
        residual = np.array(self.engine.GetSystemResidual())[self.coordinates :]
        wanted = {row: -value for row, value in enumerate(residual) if row not in idle}
        return v + self._solve(wanted)[: self.coordinates]

    def jacobian(self) -> np.ndarray:
        """Return C_q at the present state, shape (constraints, coordinates)."""
        return self._matrix()[self.coordinates :, : self.coordinates]

    def _solve(self, right: dict[int, float]) -> np.ndarray:
        """Solve [M C_q^T; C_q 0] x = [0; right] at the present state; least squares if constraints are redundant.

        `right` are the values of the right-hand side that are not zero, by constraint.
        """
        system = self._matrix()
        vector = np.zeros(len(system))
        for row, value in right.items():
            vector[self.coordinates + row] = value
        return np.linalg.lstsq(system, vector, rcond=None)[0]

    def _matrix(self) -> np.ndarray:
        """Return [M C_q^T; C_q 0], with 1 on the diagonal for connectors that are not active."""
        # Exudyn adds to the matrix that is there, so it is cleared first.
        self.engine.SetSystemJacobian(np.zeros_like(np.array(self.engine.GetSystemJacobian())))
        self.engine.ComputeJacobianAE(self._system, 1.0, 1.0, 1.0, False)
        system = np.array(self.engine.GetSystemJacobian())
        count = self.coordinates
        system[:count, :count] += np.array(self.engine.GetSystemMassMatrix())
        return system

    def failure(self, what: str) -> str:
        """Return a message of what failed, with Exudyn's own error message."""
        return f"{what}; {self.engine.GetErrorString()}".rstrip("; ")
