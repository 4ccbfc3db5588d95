"""Truths: independent solutions with their own uncertainty, with which solvers are compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stiction.scenes import Event, InputError, Scene, StictionError
from stiction.scenes.columns import BODY_COLUMNS


class Tier(StrEnum):
    """Source of a truth, the best first.

    The values are keys of stored files: baselines, histories of nights, folders of truths. `TIER_LABELS` contains the
    words for reports.
    """

    PROVEN = "proven"
    """Enclosed by ball arithmetic; a certificate in the suite contains the bounds."""
    CLOSED_FORM = "closed form"
    """A formula, known up to rounding."""
    HIGH_PRECISION = "independent high-precision solution"
    """The equations of motion in minimal coordinates, integrated twice; the uncertainty is their difference."""
    PUBLISHED = "published"
    """A number from the literature, as exact as it is printed."""
    OWN_RUN = "our own run"
    """The reference implementation at its finest tolerance, which is not independent; also counters and times."""
    NONE = "none"
    """Nothing is known; the note of the truth says why."""

    @property
    def label(self) -> str:
        """Words of the tier in reports."""
        return TIER_LABELS[self]


TIER_LABELS: Mapping[Tier, str] = {
    Tier.PROVEN: "proven",
    Tier.CLOSED_FORM: "closed form",
    Tier.HIGH_PRECISION: "independent high-precision solution",
    Tier.PUBLISHED: "published",
    Tier.OWN_RUN: "our own run",
    Tier.NONE: "none",
}
"""Words of each tier in reports; no result depends on them."""
SIDES = ("before", "after")
"""Sides of an event."""
EPS = np.finfo(float).eps
"""Relative rounding of a number."""
SAMPLES = 2401
"""Number of instants at which the truth of a stored run is known: every 10 ms of 24 s."""
_END_ROUNDING = 1e-12
"""Time, relative to the end, by which a time may lie outside of a truth: some thousand roundings of sums of steps."""

Columns = Callable[[np.ndarray, str], Mapping[str, np.ndarray]]
"""``columns(t, side)`` with t of shape (n,) and side of `SIDES`: the columns by name."""


class TruthRefused(StictionError):
    """A truth has no answer; the message is the reason."""


class NotThisMechanism(TruthRefused, InputError):
    """A scene has another structure than a truth requires, or parameters for which its closed form degenerates."""


@dataclass(frozen=True)
class Truth:
    """An independent solution of a scene for 0 <= t <= t_end.

    Attributes
    ----------
    scene : str
        Name of the scene.
    tier : Tier
        Source of the columns.
    t_end : float
        End of the solution, s.
    columns : callable
        Returns the columns by name for times and a side, see `Columns`.
    uncertainty : Mapping
        By column, the largest error to be expected between events; under ``"event time"`` that of the events, s.
    events : tuple of Event
        Events in the order of time, with the values on both sides.
    jump_closed_form : ndarray, shape (events,), or None
        Jump of the drive's effort at each event by its closed form.
    note : str
        Why a better tier has no answer; empty for the best tier that is possible.
    tier_below : Tier or None
        In a proven truth, tier of the columns that no proof encloses (efforts and forces).
    guides : frozenset of str or None
        Guides whose events count; None for all guides.
    has_gaps : bool
        True for a motion with the clearance of guides that the scene declares.
    """

    scene: str
    tier: Tier
    t_end: float
    columns: Columns
    uncertainty: Mapping[str, float]
    events: tuple[Event, ...] = ()
    jump_closed_form: np.ndarray | None = None
    note: str = ""
    tier_below: Tier | None = None
    guides: frozenset[str] | None = None
    has_gaps: bool = False

    @property
    def effort_tier(self) -> Tier:
        """Tier of the efforts of the drives."""
        return self.tier_below or self.tier

    @classmethod
    def unknown(cls, scene: str, t_end: float, note: str) -> Truth:
        """Return a truth without columns and events, for a scene that no tier has an answer for."""
        return cls(scene, Tier.NONE, t_end, lambda t, side: {}, {}, note=note)

    @classmethod
    def of_formulas(
        cls,
        scene: Scene,
        t_end: float,
        columns: Columns,
        rounding: float,
        samples: int,
        switches: Sequence[tuple[float, str, str]] | None = None,
    ) -> Truth:
        """Return the closed form of a motion as a Truth.

        Parameters
        ----------
        scene : Scene
            The scene.
        t_end : float
            End of the motion, s.
        columns : callable
            The closed form.
        rounding : float
            Error of a column, relative to one plus its largest magnitude; for times of events relative to `t_end`, or
            to 1 s if that is more.
        samples : int
            Number of instants at which the magnitudes are taken.
        switches : sequence, optional
            Time, kind and guide of each event; None for a motion without friction.
        """
        # Rounding is proportional to the magnitude of a column; the 1 is for columns that are nearly
        # zero throughout.
        sampled = columns(np.linspace(0, t_end, samples), "after")
        uncertainty = {
            name: rounding * float(1 + np.max(np.abs(values))) for name, values in sampled.items()
        }
        if switches is not None:
            uncertainty["event time"] = rounding * max(t_end, 1.0)
        return cls(
            scene.name,
            Tier.CLOSED_FORM,
            t_end,
            columns,
            uncertainty,
            two_sided(switches or (), columns),
        )

    def __call__(self, t: np.ndarray | float, side: str = "after") -> Mapping[str, np.ndarray]:
        """Return the columns of a Trajectory at times t (s); `side` selects the value at an event itself.

        Raises
        ------
        ValueError
            For a time outside of [0, t_end] or an unknown side.
        """
        if side not in SIDES:
            raise ValueError(f"side: found {side!r}; expected one of {', '.join(SIDES)}")
        # Output times are sums of steps, which may exceed the ends by rounding and then count as the
        # ends.
        t = np.atleast_1d(np.asarray(t, dtype=float))
        rounding = _END_ROUNDING * self.t_end
        if not np.all((t >= -rounding) & (t <= self.t_end + rounding)):
            raise ValueError(
                f"t: found {t.min():g} .. {t.max():g} s; expected times within 0 .. {self.t_end:g} s"
            )
        return self.columns(np.clip(t, 0.0, self.t_end), side)


def kind_of_change(before: int, after: int) -> str:
    """Return the kind of the event at which a guide's direction of slip (0 in stick) changes."""
    if after == 0:
        return "stick"
    return "slip" if before == 0 else "reversal"


def two_sided(switches: Sequence[tuple[float, str, str]], columns: Columns) -> tuple[Event, ...]:
    """Return the events with the time, kind and guide of each switch, with the columns on both sides."""
    times = np.array([time for time, _, _ in switches])
    before, after = (_rows(columns(times, side)) for side in SIDES)
    return tuple(
        Event(time, kind, guide, row_before, row_after)
        for (time, kind, guide), row_before, row_after in zip(switches, before, after)
    )


def _rows(columns: Mapping[str, np.ndarray]) -> list[dict[str, float]]:
    """Return, for each instant, the values by column."""
    return [dict(zip(columns, row)) for row in np.array(list(columns.values())).T.tolist()]


def body_columns(body: str, *motion: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of a body from its position, velocity and acceleration.

    Each contains x and y, and the angle if the body turns, as arrays.
    """
    return {
        f"{body}.{name}": values
        for names, column in zip(BODY_COLUMNS, motion)
        for name, values in zip(names, column)
    }
