"""From the motion of a reduced mechanism to a Truth: columns, two-sided events, uncertainty."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from comparisons.truth.piecewise import Collocation, Motion, PiecewiseMechanism, integrate
from comparisons.truth.truth import HIGH_PRECISION, Truth
from scenes import Event, Scene

FINE, COARSE = Collocation(order=24, longest_step=0.25), Collocation(order=16, longest_step=0.1)
"""Two discretizations whose difference is the uncertainty: they share neither nodes nor steps."""
_SAMPLES = 2000
_NEAR_EVENT = 1e-7  # s; closer to an event than this the two may be on different sides of it


def motion_columns(mechanism: PiecewiseMechanism, motion: Motion, t: np.ndarray, side: str) -> dict[str, np.ndarray]:
    """The columns at times t; at an event from the given side."""
    columns: dict[str, np.ndarray] = {}
    for segment, where in motion.at(t, side):
        for name, values in mechanism.columns(t[where], *segment.state(t[where]), segment.mode).items():
            columns.setdefault(name, np.empty(len(t)))[where] = values
    return columns


def motion_events(mechanism: PiecewiseMechanism, motion: Motion, guides: tuple[str, ...]) -> tuple[Event, ...]:
    """An event per switch and guide whose direction of slip changes; a corner event if none does."""
    events = []
    for switch in motion.switches:
        before, after = motion.segments[switch.index - 1], motion.segments[switch.index]
        time = np.array([switch.time])
        sides = []
        for segment in (before, after):
            values = mechanism.columns(time, *segment.state(time), segment.mode)
            sides.append({name: float(value[0]) for name, value in values.items()})
        old, new = mechanism.slip(before.mode), mechanism.slip(after.mode)
        changes = [(guide, "stick" if b == 0 else "slip" if a == 0 else "reversal")
                   for guide, a, b in zip(guides, old, new) if a != b]
        for guide, kind in changes or [(guides[mechanism.corner_guide(before.mode, switch.guard)], "corner")]:
            events.append(Event(float(switch.time), kind, guide, *sides))
    return tuple(events)


def truth_of(scene: Scene, guides: tuple[str, ...], mechanism: PiecewiseMechanism, q0: np.ndarray, v0: np.ndarray,
             t_end: float) -> Truth:
    """Integrate a reduced mechanism from t = 0, twice, and return the finer with the difference as uncertainty.

    Raises
    ------
    ArithmeticError
        If the two integrations disagree on the sequence of events: a grazing event that no uncertainty could describe.
    """
    fine, coarse = (integrate(mechanism, 0.0, t_end, q0, v0, collocation) for collocation in (FINE, COARSE))
    events, check = (tuple(event for event in motion_events(mechanism, motion, guides)
                           if event.time < t_end - _NEAR_EVENT) for motion in (fine, coarse))
    if [(e.kind, e.joint) for e in events] != [(e.kind, e.joint) for e in check]:
        raise ArithmeticError(f"{scene.name}: two integrations find different events: "
                              f"{[(e.kind, e.time) for e in events]} and {[(e.kind, e.time) for e in check]}")
    times = np.array([event.time for event in events])
    t = np.linspace(0.0, t_end, _SAMPLES)
    if len(times):
        t = t[np.min(np.abs(t[:, None] - times), axis=1) > _NEAR_EVENT]
    one, other = (motion_columns(mechanism, motion, t, "after") for motion in (fine, coarse))
    rounding = 8 * np.finfo(float).eps
    uncertainty = {name: float(np.max(np.abs(one[name] - other[name])) + rounding * np.max(np.abs(one[name])))
                   for name in one}
    shift = max((abs(a.time - b.time) for a, b in zip(events, check)), default=0.0)
    uncertainty["event time"] = shift + rounding * t_end

    @lru_cache(maxsize=8)  # the runs of a campaign share their output instants
    def columns(instants: bytes, side: str) -> dict[str, np.ndarray]:
        found = motion_columns(mechanism, fine, np.frombuffer(instants), side)
        for values in found.values():
            values.flags.writeable = False
        return found

    return Truth(scene.name, HIGH_PRECISION, t_end, lambda t, side: dict(columns(t.tobytes(), side)), uncertainty, events)
