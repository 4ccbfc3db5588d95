"""A trajectory that an engine returned, together with the run that was requested."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiction.engines.assembly import Assembly, assembly_of
from stiction.scenes import Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.event_values import Sides
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.trajectory import stacked

if TYPE_CHECKING:
    from stiction.reference_impl.multibody.mechanism import Mechanism

POSITIONS, VELOCITIES, ACCELERATIONS = BODY_COLUMNS
RESIDUALS = ("drift.position", "drift.velocity")
"""Columns of the residuals of the constraints."""
ROUNDING = 1e-9
"""Accuracy of times, relative to the end of the run: a sum of 1e6 steps has an error of 1e6 eps = 2e-10."""
OWN_STEP = 0.01
"""Largest step chosen by the engine, relative to the run, by which the end may differ from the requested one."""
LONGEST_DESCRIPTION = 60
"""Largest number of characters of a value in a message."""

MODES = {
    "slip": lambda old, new: old == 0 != new,
    "stick": lambda old, new: old != 0 == new,
    "reversal": lambda old, new: old == -new != 0,
    "corner": lambda old, new: old == new != 0,
}
"""Change of the contact mode of a guide at an event, by its kind."""
SPRING_EVENTS = ("contact", "release")
"""Kinds of events of a spring that acts on one side only: its force begins, and ends."""


def changed_modes(
    guides: Iterable[str], before: Mapping[str, float], after: Mapping[str, float]
) -> Iterator[tuple[str, str]]:
    """Yield the kind and the guide of each event that changes the modes before an instant to those after it."""
    for guide in guides:
        old, new = before.get(f"{guide}.mode", 0.0), after.get(f"{guide}.mode", 0.0)
        if old == new:
            continue
        for kind, is_change in MODES.items():
            if is_change(old, new):
                yield kind, guide


@dataclass(frozen=True)
class Examined:
    """A trajectory, and the run that was requested.

    Attributes
    ----------
    trajectory : Trajectory
        The trajectory that `Engine.run` returned.
    scene : Scene
        The scene.
    t_end, dt, output_step : float
        Arguments of the run, s; `dt` may be None.
    fidelity : Fidelity
        The requested fidelity.
    locates, keeps : callable
        `Engine.locates_events` and `Engine.keeps_cone` at this fidelity, as functions of the settings.
    assembly : Assembly or None
        The mechanisms of the run; a new assembly is made if it is None.
    """

    trajectory: Trajectory
    scene: Scene
    t_end: float
    dt: float | None
    output_step: float
    fidelity: Fidelity
    locates: Callable[[Mapping[str, Any]], bool]
    keeps: Callable[[Mapping[str, Any]], bool]
    assembly: Assembly | None = None

    @property
    def step(self) -> float:
        """Step size by which the run may end before or after `t_end`, s."""
        if self.dt is not None:
            return self.dt
        # A step that the engine has chosen must be short; otherwise the run could end anywhere.
        own_step: Any = self.trajectory.settings.get("dt")
        longest = OWN_STEP * self.t_end * (1 + ROUNDING)
        return own_step if is_number(own_step) and 0 < own_step <= longest else 0.0

    @property
    def slack(self) -> float:
        """Largest difference between the end of the run and `t_end`, s."""
        # The last of fixed steps is the one nearest to t_end, before or after it.
        return self.step + ROUNDING * self.t_end

    @property
    def stopped_at_once(self) -> bool:
        """True if there is no motion: the state at the start is known, accelerations and forces are not."""
        stop, t = self.trajectory.breakdown, self.trajectory.t
        return stop is not None and len(t) == 1 and stop.time == t[0]

    @property
    def parts(self) -> list[Mechanism]:
        """Mechanisms that the scene consists of; one of many parts may be too large as a whole."""
        return self.assembled.parts

    @property
    def size(self) -> float:
        """Length of the largest mechanism, m."""
        return self.assembled.size

    @cached_property
    def assembled(self) -> Assembly:
        """The mechanisms of the run."""
        return assembly_of(self.scene, self.assembly)

    @cached_property
    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and velocities of the scene's start, each (3 * bodies,)."""
        # Parts have their bodies in an order of their own, so states are collected by body.
        q_of: dict[str, np.ndarray] = {}
        v_of: dict[str, np.ndarray] = {}
        for part in self.parts:
            q, v = part.initial_state()
            q_of |= zip(part.body_names, q.reshape(-1, 3))
            v_of |= zip(part.body_names, v.reshape(-1, 3))
        bodies = self.scene.bodies
        return (
            np.concatenate([q_of[body] for body in bodies]),
            np.concatenate([v_of[body] for body in bodies]),
        )

    @cached_property
    def motion(self) -> tuple[np.ndarray, ...]:
        """Coordinates, velocities and accelerations of all bodies, each (n, 3 * bodies)."""
        return tuple(
            stacked(self.trajectory.columns, self.scene.bodies, labels) for labels in BODY_COLUMNS
        )

    @cached_property
    def in_equations(self) -> list[InEquations | None]:
        """The samples of each part, in its equations; None for a part whose equations are not asked about.

        They must hold where events have all columns of the part on both sides.
        """
        t = self.trajectory.t.astype(float)
        column = self.trajectory.columns.__getitem__
        return [
            InEquations.of(part, t, column)
            if len(self.sides.with_columns(InEquations.needed(part)))
            else None
            for part in self.parts
        ]

    def columns(self, labels: tuple[str, ...]) -> list[str]:
        """Names of the columns of all bodies with these labels."""
        return [f"{body}.{label}" for body in self.scene.bodies for label in labels]

    @cached_property
    def sides(self) -> Sides:
        """Values on both sides of all events."""
        return Sides(self.trajectory.events)

    def differs(
        self, column: str, expected: np.ndarray, allowed: float | np.ndarray, source: str
    ) -> Iterator[str]:
        """Yield a problem for the first sample of a column that differs from the expected values by more than allowed.

        Parameters
        ----------
        column
            The name of the column.
        expected
            The expected values, shape (n,).
        allowed
            The largest difference, in the unit of the column; a number or shape (n,).
        source
            What the expected values are, for the message.
        """
        values = self.trajectory[column]
        i = first(np.abs(values - expected) > allowed)
        if i is not None:
            yield (
                f"{column} = {values[i]:.9g} at t = {self.trajectory.t[i]:.9g} s; expected "
                f"{expected[i]:.9g}, {source}"
            )


class InEquations(NamedTuple):
    """Residuals of the equations of motion and of the constraints of a part at instants; arrays have the shape (n,).

    Attributes
    ----------
    left, size : ndarray
        Residual of the equations of motion, and the largest term in them; see `imbalance`.
    position, velocity : ndarray
        Norms of Phi and Phi'.
    """

    left: np.ndarray
    size: np.ndarray
    position: np.ndarray
    velocity: np.ndarray

    @staticmethod
    def needed(part: Mechanism) -> list[str]:
        """Return the names of the columns that are evaluated: the forces of the rows, and the motion."""
        motion = [
            f"{body}.{label}"
            for body in part.body_names
            for labels in BODY_COLUMNS
            for label in labels
        ]
        return [*part.force_names, *motion]

    @staticmethod
    def of(part: Mechanism, t: np.ndarray, column: Callable[[str], np.ndarray]) -> InEquations:
        """Evaluate the equations at times t (n,), s; `column` returns the values (n,) of a column by its name."""
        from stiction.reference_impl.multibody.trajectory_columns import imbalance

        read = {name: column(name) for name in InEquations.needed(part)}
        q, v, a = (stacked(read, part.body_names, labels) for labels in BODY_COLUMNS)
        force = np.empty((len(t), len(part.force_names)))  # a free body has no rows
        for place, name in enumerate(part.force_names):
            force[:, place] = read[name] / part.force_units[place]
        return InEquations(*imbalance(part.arrays, part.workspace, t, q, v, a, force))


Predicate = Callable[[Examined], Iterator[str]]
"""Yields each fault that it finds, as the continuation of a sentence that begins with "the engine returned"."""


def first(wrong: np.ndarray) -> int | None:
    """Return the index of the first true element; None if there is none."""
    places = np.flatnonzero(wrong)
    return int(places[0]) if places.size else None


def is_number(value: Any) -> bool:
    """Return True for a finite number of double precision."""
    if not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the largest float
        return False


def described(value: Any) -> str:
    """Return the type of a value, and the value in at most `LONGEST_DESCRIPTION` characters."""
    text = repr(value)
    if len(text) > LONGEST_DESCRIPTION:
        text = text[: LONGEST_DESCRIPTION - 3] + "..."
    return f"{type(value).__name__} {text}"
