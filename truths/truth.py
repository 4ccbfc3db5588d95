"""Truth: an independent solution with its own uncertainty, to compare solvers with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stiction.scenes import Event, InputError, Scene, StictionError
from stiction.scenes.columns import BODY_COLUMNS


class Tier(StrEnum):
    """What a truth rests on, the best first.

    The values are keys of stored files: baselines, histories of nights, folders of truths. What people read is in
    `TIER_LABELS`.
    """

    PROVEN = "proven"
    """Enclosed by ball arithmetic; a certificate that comes with the suite holds the bounds."""
    CLOSED_FORM = "closed form"
    """A formula, known up to rounding."""
    HIGH_PRECISION = "independent high-precision solution"
    """The equations of motion in minimal coordinates, integrated twice; the uncertainty is their difference."""
    PUBLISHED = "published"
    """A number from the literature, as exact as it is printed."""
    OWN_RUN = "our own run"
    """The reference implementation at its finest: not independent of it. Also of counters and times of a run."""
    NONE = "none"
    """Nothing is known; the note of the truth says why."""

    @property
    def label(self) -> str:
        """What people read."""
        return TIER_LABELS[self]


TIER_LABELS: Mapping[Tier, str] = {
    Tier.PROVEN: "proven",
    Tier.CLOSED_FORM: "closed form",
    Tier.HIGH_PRECISION: "independent high-precision solution",
    Tier.PUBLISHED: "published",
    Tier.OWN_RUN: "our own run",
    Tier.NONE: "none",
}
"""Words for people; no result depends on them."""
SIDES = ("before", "after")
EPS = np.finfo(float).eps
SAMPLES = 2401
"""Instants at which the truth of a stored run is known, over the whole of its time: every 10 ms of 24 s."""
_END_ROUNDING = 1e-12
"""Part of its end by which a time may lie outside of a truth: some thousand roundings of sums of steps."""

Columns = Callable[[np.ndarray, str], Mapping[str, np.ndarray]]
"""``columns(t, side)`` with t of shape (n,) and side of `SIDES`: the columns by name."""


class TruthRefused(StictionError):
    """A truth has no answer; the message says why."""


class NotThisMechanism(TruthRefused, InputError):
    """A scene has another structure than a truth requires, or parameters for which its closed form degenerates."""


@dataclass(frozen=True)
class Truth:
    """An independent solution of a `scene` for 0 <= t <= t_end (s).

    In a proven truth, columns that no proof encloses (efforts and forces) have the tier
    `tier_below`; it is None for other truths. `uncertainty` contains, by column, the largest error
    to be expected between events, and under ``"event time"`` the error of their times. `events` are
    sorted by time and have the values of both sides; only events of `guides` count, or all of them
    where `guides` is None. `jump_closed_form`, shape (events,), contains the jump of the drive's
    effort at each event, computed from its closed form. `note` explains why a better tier has no
    answer; it is empty for the best tier that is possible.
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

    @property
    def effort_tier(self) -> Tier:
        """Tier of the efforts of the drives."""
        return self.tier_below or self.tier

    @classmethod
    def unknown(cls, scene: str, t_end: float, note: str) -> Truth:
        """Return a truth without columns and events, where no tier has an answer."""
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

        `rounding` is the error of a column, relative to one plus its largest size at `samples`
        instants. For times of events it is relative to `t_end`, or to 1 s if that is more.
        `switches` contains time, kind and guide of each event; it is None for a motion without
        friction.
        """
        # Rounding is proportional to a column's size; the 1 stands for columns that are nearly zero
        # throughout.
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
        """Return the columns of a Trajectory at times t; `side` says which value holds at an event itself.

        Raises ValueError for a time outside of [0, t_end] or an unknown side.
        """
        if side not in SIDES:
            raise ValueError(f"side: found {side!r}; expected one of {', '.join(SIDES)}")
        # Output times are sums of steps: they may pass the ends by rounding, and count as the ends
        # then.
        t = np.atleast_1d(np.asarray(t, dtype=float))
        rounding = _END_ROUNDING * self.t_end
        if not np.all((t >= -rounding) & (t <= self.t_end + rounding)):
            raise ValueError(
                f"t: found {t.min():g} .. {t.max():g} s; expected times within 0 .. {self.t_end:g} s"
            )
        return self.columns(np.clip(t, 0.0, self.t_end), side)


def kind_of_change(before: int, after: int) -> str:
    """Return the kind of event at which a guide's direction of slip, 0 in stick, changes to another one."""
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
    """Return a dict by column of each instant."""
    return [dict(zip(columns, row)) for row in np.array(list(columns.values())).T.tolist()]


def body_columns(body: str, *motion: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of a body: x, y and, where it turns, the angle, of position, velocity and acceleration."""
    return {
        f"{body}.{name}": values
        for names, column in zip(BODY_COLUMNS, motion)
        for name, values in zip(names, column)
    }
