"""Truth of the motion of a reduced mechanism: columns, two-sided events, uncertainty."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stiction.scenes import Event, Scene
from stiction.truths.reduced.piecewise_smooth import (
    Collocation,
    Motion,
    PiecewiseMechanism,
    Undecided,
    integrate,
)
from stiction.truths.truth import Tier, Truth, two_sided

FINE, COARSE = Collocation(order=24, longest_step=0.5), Collocation(order=16, longest_step=0.2)
"""Two discretizations whose difference is the uncertainty: they share neither nodes nor steps."""
_SAMPLES = 2000
_NEAR_EVENT = 1e-7  # s; closer to an event than this the two may be on different sides of it
_ROUNDING = 8 * np.finfo(float).eps


def motion_columns(
    mechanism: PiecewiseMechanism, motion: Motion, t: np.ndarray, side: str
) -> dict[str, np.ndarray]:
    """Return the columns at times t, at an event from the given side; all instants of a mode at once."""
    owner = motion.owner(t, side)
    q, v = motion.state(t, owner)
    modes = [segment.mode for segment in motion.segments]
    numbers = {mode: i for i, mode in enumerate(dict.fromkeys(modes))}
    number = np.array([numbers[mode] for mode in modes])[owner]
    columns: dict[str, np.ndarray] = {}
    for mode, i in numbers.items():
        where = np.flatnonzero(number == i)
        for name, values in mechanism.columns(t[where], q[:, where], v[:, where], mode).items():
            columns.setdefault(name, np.empty(len(t)))[where] = values
    return columns


def motion_events(
    mechanism: PiecewiseMechanism, motion: Motion, guides: tuple[str, ...]
) -> tuple[Event, ...]:
    """Return an event per switch and guide whose direction of slip changes; a corner event if none does.

    A guide at rest that goes on resting (its margin touches zero) has none.
    """
    switches = []
    for switch in motion.switches:
        before, after = (
            segment.mode for segment in motion.segments[switch.index - 1 : switch.index + 1]
        )
        changes = [
            ("stick" if b == 0 else "slip" if a == 0 else "reversal", guide)
            for guide, a, b in zip(guides, mechanism.slip(before), mechanism.slip(after))
            if a != b
        ]
        if before != after and not changes:
            changes = [("corner", guides[mechanism.corner_guide(before, switch.guard)])]
        switches += [(float(switch.time), *change) for change in changes]
    return two_sided(switches, lambda t, side: motion_columns(mechanism, motion, t, side))


def truth_of(
    scene: Scene,
    guides: tuple[str, ...],
    mechanism: PiecewiseMechanism,
    q0: np.ndarray,
    v0: np.ndarray,
    t_end: float | None,
) -> Truth:
    """Integrate a reduced mechanism from t = 0, twice, and return the finer with the difference as uncertainty.

    The end is the scene's own where `t_end` is None. Raises NoMotion where the equations have no motion or several,
    Undecided if the two integrations disagree on the sequence of events.
    """
    t_end = scene.t_end if t_end is None else t_end
    fine, coarse = (
        integrate(mechanism, 0.0, t_end, q0, v0, collocation) for collocation in (FINE, COARSE)
    )
    events, check = (
        tuple(
            event
            for event in motion_events(mechanism, motion, guides)
            if event.time < t_end - _NEAR_EVENT
        )
        for motion in (fine, coarse)
    )
    _require_same(scene, events, check)
    times = np.array([event.time for event in events])
    t = np.linspace(0.0, t_end, _SAMPLES)[
        1:
    ]  # the start is given; a velocity of zero may have either sign there
    if len(times):
        t = t[np.min(np.abs(t[:, None] - times), axis=1) > _NEAR_EVENT]
    one, other = (motion_columns(mechanism, motion, t, "after") for motion in (fine, coarse))
    uncertainty = {
        name: float(np.max(np.abs(one[name] - other[name])) + _ROUNDING * np.max(np.abs(one[name])))
        for name in one
    }
    shift = max((abs(a.time - b.time) for a, b in zip(events, check)), default=0.0)
    uncertainty["event time"] = shift + _ROUNDING * t_end

    @lru_cache(maxsize=8)  # the runs of a campaign share their output instants
    def columns(instants: bytes, side: str) -> dict[str, np.ndarray]:
        found = motion_columns(mechanism, fine, np.frombuffer(instants), side)
        for values in found.values():
            values.flags.writeable = False
        return found

    return Truth(
        scene.name,
        Tier.HIGH_PRECISION,
        t_end,
        lambda t, side: dict(columns(t.tobytes(), side)),
        uncertainty,
        events,
    )


def _require_same(scene: Scene, events: tuple[Event, ...], check: tuple[Event, ...]) -> None:
    """Raise Undecided where two integrations disagree on the kinds of events or their guides."""
    kinds = [(event.kind, event.joint) for event in events]
    others = [(event.kind, event.joint) for event in check]
    if kinds != others:
        first = next(
            (i for i, (a, b) in enumerate(zip(kinds, others)) if a != b),
            min(len(events), len(check)),
        )
        found = [
            f"{e[first].kind} of {e[first].joint} at {e[first].time:.9f} s"
            if first < len(e)
            else "none"
            for e in (events, check)
        ]
        raise Undecided(
            f"{scene.name}: two integrations find different events, the first {found[0]} and {found[1]}"
        )
