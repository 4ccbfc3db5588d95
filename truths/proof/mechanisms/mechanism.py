"""Interface of a mechanism in minimal coordinates to the verified integrator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from flint import arb, arb_series

from stiction.scenes import Scene
from stiction.truths.proof.enclosures.arc import APriori
from stiction.truths.proof.enclosures.series import Equation, Value, constants, time_series

Load = Callable[[arb_series], arb_series]
"""A function of time alone, of power series."""


@dataclass(frozen=True)
class Next:
    """The mode after an instant.

    Attributes
    ----------
    mode
        The mode.
    zeros : Mapping
        For each guard, the number of its derivatives, including the value, that are zero at that instant; 0 if missing.
    kind : str
        Kind of the event at the instant: "slip", "stick", "reversal" or "corner".
    smooth : bool
        True if the accelerations do not jump.
    """

    mode: Any
    zeros: Mapping[Any, int] = field(default_factory=dict)
    kind: str = ""
    smooth: bool = True


@dataclass(frozen=True, kw_only=True)
class ProvableMechanism(ABC):
    """A mechanism q'' = f(t, q, q') in balls and power series, with modes, and guards that are positive in a mode.

    Attributes
    ----------
    q, v : list of arb
        Coordinates and velocities at t = 0.
    t_end : arb
        End of the motion, s.
    joint : str
        The guide to which events belong, if there is one.
    """

    q: list[arb]
    v: list[arb]
    t_end: arb
    joint: str = ""

    @classmethod
    @abstractmethod
    def from_scene(cls, scene: Scene) -> ProvableMechanism:
        """Return the mechanism of a scene, at the working precision; raise NotThisMechanism with what does not fit."""

    @abstractmethod
    def equation(self, mode: Any, t: arb_series) -> Equation:
        """Return the equation of a mode, with time as a power series."""

    @abstractmethod
    def guards(
        self, mode: Any, t: arb_series, q: Sequence[Value], v: Sequence[Value], a: Sequence[Value]
    ) -> dict[Any, list[Value]]:
        """Return groups of functions by name; the mode lasts while the largest function of each group is positive."""

    def guards_at(
        self, mode: Any, t: arb, q: Sequence[arb], v: Sequence[arb]
    ) -> dict[Any, list[arb]]:
        """Return the values of the guards in a state."""
        # series of one coefficient: the same code gives values and Taylor polynomials
        q, v, now = constants(q), constants(v), time_series(t, 1)
        guards = self.guards(mode, now, q, v, self.equation(mode, now)(q, v))
        return {name: [f[0] for f in group] for name, group in guards.items()}

    @abstractmethod
    def start(self) -> Next:
        """Return the mode at t = 0; raise Undecided if it is not proven."""

    @abstractmethod
    def after(self, mode: Any, guard: Any, t: arb, q: list[arb], v: list[arb]) -> Next:
        """Return the mode after a guard has reached zero; raise Undecided if it is not proven."""

    @abstractmethod
    def require_unique(self, mode: Any, t: arb, bound: APriori) -> None:
        """Prove that over a stretch of time the motion of the mode is the only one; raises Undecided if that fails."""

    def held(self, mode: Any) -> Mapping[int, arb]:
        """Return the velocities that a mode prescribes, by coordinate."""
        return {}

    def event_joint(self, before: Any, after: Any) -> str:
        """Return the guide to which an event belongs."""
        return self.joint

    @abstractmethod
    def columns(self, t: Value, q: Sequence[Value], v: Sequence[Value]) -> dict[str, Value]:
        """Return the state by the columns of a Trajectory, as balls or power series in time."""

    def bodies(self, t: Value, q: Sequence[Value], v: Sequence[Value]) -> dict[str, Value]:
        """Return `columns` with the positions and velocities of all bodies that move."""
        return self.columns(t, q, v)
