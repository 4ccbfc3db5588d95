"""Interface of a mechanism in minimal coordinates to the verified integrator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from flint import arb, arb_series

from stiction.comparisons.proof.enclosures.arc import APriori
from stiction.comparisons.proof.enclosures.series import Equation, Value, constants, time_series
from stiction.scenes import Scene

AMode = TypeVar("AMode", bound=Hashable)
AGuard = TypeVar("AGuard", bound=Hashable)
"""Types of a mechanism's modes, and of the names of its guards."""


@dataclass(frozen=True)
class Next(Generic[AMode]):
    """The mode from an instant on, after an event of a kind: "slip", "stick", "reversal" or "corner".

    By guard, `zeros` is how many of its derivatives, the value included, are zero at that instant (0 if not named).
    Where it is `smooth` the accelerations do not jump.
    """

    mode: AMode
    zeros: Mapping[Hashable, int] = field(default_factory=dict)
    kind: str = ""
    smooth: bool = True


class ProvableMechanism(ABC, Generic[AMode, AGuard]):
    """q'' = f(t, q, q') within each mode, and guards that are positive while the mode lasts; balls and power series.

    q and v are those at t = 0; `joint` is the guide whose events are shown, where there is one.
    """

    q: list[arb]
    v: list[arb]
    t_end: arb
    joint: str

    @classmethod
    @abstractmethod
    def from_scene(cls, scene: Scene) -> ProvableMechanism:
        """Parameters of a scene, at the working precision; raises NotThisMechanism with what does not fit."""

    @abstractmethod
    def equation(self, mode: AMode, t: arb_series) -> Equation:
        """The equation of a mode, with time as a power series."""

    @abstractmethod
    def guards(self, mode: AMode, t: arb_series, q: Sequence[Value], v: Sequence[Value],
               a: Sequence[Value]) -> dict[AGuard, list[Value]]:
        """Groups of functions by name: the mode lasts while the largest of each group is positive."""

    def guards_at(self, mode: AMode, t: arb, q: Sequence[arb], v: Sequence[arb]) -> dict[AGuard, list[arb]]:
        """Values of the guards in a state."""
        q, v, now = constants(q), constants(v), time_series(t, 1)
        guards = self.guards(mode, now, q, v, self.equation(mode, now)(q, v))
        return {name: [f[0] for f in group] for name, group in guards.items()}

    @abstractmethod
    def start(self) -> Next[AMode]:
        """The mode at t = 0; raises Undecided if it is not proven."""

    @abstractmethod
    def after(self, mode: AMode, guard: AGuard, t: arb, q: list[arb], v: list[arb]) -> Next[AMode]:
        """The mode after a guard has reached zero; raises as `start`."""

    @abstractmethod
    def require_unique(self, mode: AMode, t: arb, bound: APriori) -> None:
        """Prove that over a stretch of time the motion of the mode is the only one; raises Undecided if that fails."""

    def held(self, mode: AMode) -> Mapping[int, arb]:
        """Velocities that a mode prescribes, by coordinate."""
        return {}

    def event_joint(self, before: AMode, after: AMode) -> str:
        """The guide at which an event happens."""
        return self.joint

    @abstractmethod
    def columns(self, t: Value, q: Sequence[Value], v: Sequence[Value]) -> dict[str, Value]:
        """The state by the names of a Trajectory; balls, or power series in time."""

    def bodies(self, t: Value, q: Sequence[Value], v: Sequence[Value]) -> dict[str, Value]:
        """`columns` with the positions and velocities of all bodies that move."""
        return self.columns(t, q, v)


@dataclass(frozen=True)
class SineLoad:
    """amplitude sin(frequency t + phase)."""

    amplitude: arb
    frequency: arb
    phase: arb

    def __call__(self, t: arb_series) -> arb_series:
        return self.amplitude * (self.frequency * t + self.phase).sin()
