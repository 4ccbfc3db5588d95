"""Output of an integration: samples and events as kernels write them, and the run that they become."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from stiction.reference_impl.compiled.bundle import (
    Bundle,
    Cube,
    Integers,
    IntegerTable,
    Reals,
    Table,
)
from stiction.reference_impl.friction.coulomb import can_jam
from stiction.reference_impl.friction.frozen_mode import margin
from stiction.reference_impl.friction.open_forces import OpenForces, open_forces
from stiction.reference_impl.friction.outcomes import (
    AUDIT,
    BREAKDOWNS,
    CRAWL,
    DONE,
    ILL_CONDITIONED,
    JAM,
    MODE_LIMIT,
    NONE,
    NOT_FINITE,
    PIN_FEEDBACK,
    PIN_LOADS,
    PIVOT_LIMIT,
    RAY,
    SELF_LOCKING,
    SEVERAL,
    SIGN_CYCLE,
    SINGULAR,
    STEP_TOO_SMALL,
    UNBOUNDED,
)
from stiction.reference_impl.friction.trial_and_error import trial_and_error
from stiction.reference_impl.friction.uniqueness import gain_of_mode, number_of_solutions
from stiction.reference_impl.multibody.guide_freedom import DRIVEN
from stiction.reference_impl.multibody.mechanism import NO_GUIDE, Arrays, Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Breakdown, Cost, Event
from stiction.scenes.event_values import rows_of

SLIP, STICK, REVERSAL, CORNER, SWITCH, CONTACT, RELEASE = range(7)
UNCHANGED = -1
EVENT_KINDS = ("slip", "stick", "reversal", "corner", "switch", "contact", "release")
SAME_INSTANT = 1e-12
"""Part of the time so far, or of the first step if that is later, within which changes are one event: those of both
corners of a slider. A guide that began to slip within it is not taken to be at rest again at the break-away of
another."""


NEARLY_UNBOUNDED = 1e-3
"""Distance of the friction gain of a driven guide from 1 within which a run that finds no finite forces ended in a jam:
its normal force is proportional to 1 / (1 - gain)."""
MOST_UNLIKE = 1e9
"""Ratio of masses from which forces are rounding: double precision has 1e16, and forces are needed to 1e-7."""


class Samples(Bundle):
    """Output at given times: q, v, a together (n, 3, 3 * bodies), row forces, slip, norms of Phi and Phi' (n, 2)."""

    t: Reals
    motion: Cube
    force: Table
    slip: IntegerTable
    residual: Table

    @classmethod
    def room(cls, m: Arrays, count: int) -> Samples:
        """Return room for `count` samples."""
        n, nf = len(m.inverse_mass), len(m.friction)
        return cls.zeros(
            t=count,
            motion=(count, 3, n),
            force=(count, m.rows + nf),
            slip=(count, nf),
            residual=(count, 2),
        )


class EventLog(Bundle):
    """Events: time, kind, number in `Mechanism.event_names`, other consistent modes, two-sided samples (n, 2, ...).

    A SWITCH has the number of the law instead.
    """

    t: Reals
    kind: Integers
    guide: Integers
    others: Integers
    motion: Annotated[np.ndarray, np.float64, 4]
    force: Cube
    slip: Annotated[np.ndarray, np.int64, 3]

    @classmethod
    def room(cls, m: Arrays, count: int, sided: int) -> EventLog:
        """Return room for `count` events, and for the samples of `sided` of them."""
        n, nf = len(m.inverse_mass), len(m.friction)
        return cls.zeros(
            t=count,
            kind=count,
            guide=count,
            others=count,
            motion=(sided, 2, 3, n),
            force=(sided, 2, m.rows + nf),
            slip=(sided, 2, nf),
        )


@dataclass(frozen=True)
class Run:
    """Result of an integration: columns at the output times, events, counters, and how it ended."""

    t: np.ndarray
    columns: dict[str, np.ndarray]
    events: tuple[Event, ...]
    cost: Cost
    breakdown: Breakdown | None
    alternatives: Mapping[str, np.ndarray] = field(default_factory=dict)
    """As `stiction.scenes.Trajectory.alternatives`."""
    switches: tuple[Event, ...] = ()
    """As `stiction.scenes.Trajectory.switches`."""

    @property
    def termination(self) -> str:
        return "end" if self.breakdown is None else str(self.breakdown)


def breakdown_of(
    code: int,
    time: float,
    mechanism: Mechanism,
    w,
    slip: np.ndarray,
    corner: np.ndarray,
    scales: tuple[float, float] = (1.0, 1.0),
) -> Breakdown | None:
    """Return the typed end of a run, from what its kernel left where it failed.

    None where the run has reached the end of its time.

    `code`: one of `outcomes`. `w`: a workspace with the rows of that instant. `slip` and `corner`: the contact mode
    assumed there. `scales`: largest speed (m/s) and force (N), by which an audit measures.
    """
    if code == DONE:
        return None
    m, guide, found = mechanism.arrays, NO_GUIDE, None
    code, guide = _cause(code, mechanism, w, slip)
    kind, reason = BREAKDOWNS[code]
    if code in (RAY, PIVOT_LIMIT, NONE, SEVERAL, SINGULAR, MODE_LIMIT, UNBOUNDED, PIN_LOADS):
        _, guide = gain_of_mode(m, w, slip)
    if code == SIGN_CYCLE:
        _, _, guide = trial_and_error(
            m, w, slip, corner, np.zeros(len(w.force)), np.zeros_like(slip)
        )
    if code == AUDIT:
        guide = int(
            np.argmin(
                [min(np.divide(margin(m, w, slip, f), scales)) for f in range(len(m.friction))]
            )
        )
    if code == JAM:
        guide = min(
            (f for f in range(len(m.friction)) if can_jam(m, f)), key=lambda f: abs(w.slip_speed[f])
        )
    if code in (NONE, SELF_LOCKING, UNBOUNDED):
        found = 0
    if code == SEVERAL:
        # a rest in which guides share a load is a solution that is not counted (`mode_choice`)
        found = max(2, number_of_solutions(m, w, slip))
    return Breakdown(
        kind, float(time), reason, mechanism.guide_names[guide] if guide != NO_GUIDE else "", found
    )


def _cause(code: int, mechanism: Mechanism, w, slip: np.ndarray) -> tuple[int, int]:
    """Return the outcome that tells a user why a kernel ended with a code, and the guide concerned.

    NO_GUIDE stands for none.
    """
    m = mechanism.arrays
    if code not in (NONE, NOT_FINITE, STEP_TOO_SMALL, CRAWL, SINGULAR, SEVERAL):
        return code, NO_GUIDE
    if code == SEVERAL and m.pins:
        return PIN_FEEDBACK, gain_of_mode(m, w, slip)[1]
    driven = (m.friction["freedom"] == DRIVEN) & (slip != 0)
    gain, guide = gain_of_mode(m, w, slip) if driven.any() else (0.0, NO_GUIDE)
    if guide != NO_GUIDE and driven[guide]:
        if code == NONE:
            return SELF_LOCKING, guide
        if abs(gain - 1.0) < NEARLY_UNBOUNDED:
            return UNBOUNDED, guide
    if code in (NOT_FINITE, SINGULAR) and mechanism.largest_ratio_of_masses() > MOST_UNLIKE:
        return ILL_CONDITIONED, NO_GUIDE
    return code, NO_GUIDE


def columns_and_events(
    mechanism: Mechanism,
    samples: Sequence[np.ndarray],
    log: Sequence[np.ndarray],
    names: Collection[str] | None,
    sides: bool,
    first_step: float,
    residual: np.ndarray | None = None,
) -> tuple[dict[str, np.ndarray], tuple[Event, ...], tuple[Event, ...], dict[str, np.ndarray]]:
    """Return columns of the samples, events, switches of laws, and alternatives.

    Events and switches have the columns on both `sides`, if these are wanted.
    `samples`: times, motion, forces and slip of `Samples`; `log`: the arrays of `EventLog`. `names`: the columns that
    are wanted; all where None. `first_step`: the least time (s) that SAME_INSTANT is taken of. `residual`: that of the
    samples, if it is known.
    """

    def build(
        t: np.ndarray,
        motion: np.ndarray,
        force: np.ndarray,
        slip: np.ndarray,
        residual: np.ndarray | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        q, v, a = (motion[:, k] for k in range(3))
        opened = open_forces(mechanism, t, q, v, force, slip)
        columns = build_columns(mechanism, t, q, v, a, opened.force, slip, names, residual)
        return columns, alternative_columns(mechanism, opened, len(t), columns)

    instants, kinds, guides, others, *sided = log
    t, motion, force, slip = samples
    columns, alternatives = build(t, motion, force, slip, residual)
    rows: Sequence[Mapping[str, float]] = [{}] * (2 * len(instants))
    if sides and columns and len(instants):
        two_sided, _ = build(
            np.repeat(instants, 2),
            *(part.reshape(2 * len(part), *part.shape[2:]) for part in sided),
        )
        rows = rows_of(two_sided)
    events: list[Event] = []
    switches: list[Event] = []
    logged = zip(
        instants.tolist(), kinds.tolist(), guides.tolist(), others.tolist(), rows[::2], rows[1::2]
    )
    for instant, kind, guide, more, before, after in logged:
        if kind == SWITCH:
            name = mechanism.law_names[guide]
            switches.append(Event(instant, EVENT_KINDS[kind], name, before, after))
            continue
        found = Event(instant, EVENT_KINDS[kind], mechanism.event_names[guide], before, after, more)
        last = events[-1] if events else None
        if (
            last
            and last.kind == found.kind == "corner"
            and last.joint == found.joint
            and found.time - last.time <= SAME_INSTANT * max(first_step, found.time)
        ):
            # both corners change their surface where the resultant passes zero without a moment
            found = replace(found, before=last.before)
            events.pop()
        events.append(found)
    return columns, tuple(events), tuple(switches), alternatives


def alternative_columns(
    mechanism: Mechanism, opened: OpenForces, count: int, wanted: Collection[str]
) -> dict[str, np.ndarray]:
    """Return the values, (count, k), of the wanted columns that have several at some instant.

    See `OpenForces`.
    """
    found = {}
    for r, name in enumerate(mechanism.force_names):
        values = opened.alternatives[:, :, r] * mechanism.force_units[r]
        if name in wanted and not np.isnan(values).all():
            found[name] = np.full((count, values.shape[1]), np.nan)
            found[name][opened.rows] = values
    return found
