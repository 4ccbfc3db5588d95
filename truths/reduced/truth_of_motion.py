"""Truths from the integrated motion of a reduced mechanism: columns, two-sided events, uncertainty."""

from __future__ import annotations

from functools import lru_cache
from itertools import zip_longest

import numpy as np

from stiction.scenes import Event, Scene
from stiction.truths.reduced.piecewise_smooth import (
    Collocation,
    Motion,
    PiecewiseMechanism,
    Undecided,
    integrate,
)
from stiction.truths.truth import Tier, Truth, kind_of_change, two_sided

FINE = Collocation(order=24, longest_step=0.5)
"""Discretization of the truth."""
COARSE = Collocation(order=16, longest_step=0.2)
"""Discretization whose difference from `FINE` is the uncertainty: they share neither nodes nor steps."""
_SAMPLES = 2000
"""Number of instants at which the two are compared: every 12 ms of the longest run."""
_NEAR_EVENT = 1e-7
"""Distance from an event, s, within which the two integrations may be on different sides of it."""
_ROUNDING = 8 * np.finfo(float).eps
"""Relative rounding of a column that both integrations may share, so that their difference does not show it."""
_CACHE_SIZE = 8
"""Number of sets of output instants whose columns are kept: the runs of a campaign share their instants."""


def motion_columns(
    mechanism: PiecewiseMechanism, motion: Motion, t: np.ndarray, side: str
) -> dict[str, np.ndarray]:
    """Return the columns at times t (s); `side` selects the value at an event itself."""
    owner = motion.owner(t, side)
    q, v = motion.state(t, owner)
    # Instants are grouped by mode, because a motion has many segments but few modes.
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
    """Return an event for each switch and each guide whose direction of slip changes, or a corner event if none does.

    A guide that remains at rest when its margin touches zero has no event.
    """
    switches = []
    for switch in motion.switches:
        before, after = (
            segment.mode for segment in motion.segments[switch.index - 1 : switch.index + 1]
        )
        changes = [
            (kind_of_change(old, new), guide)
            for guide, old, new in zip(guides, mechanism.slip(before), mechanism.slip(after))
            if old != new
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
    """Return the motion of a reduced mechanism; its uncertainty is the difference of two integrations.

    Parameters
    ----------
    scene : Scene
        The scene.
    guides : tuple of str
        Names of the guides, in the order of the mechanism.
    mechanism : PiecewiseMechanism
        The reduced mechanism.
    q0, v0 : ndarray, shape (n,)
        Coordinates and velocities at t = 0.
    t_end : float or None
        End of the motion, s; the scene's own end if None.

    Raises
    ------
    NoMotion
        If the equations have no motion or several.
    Undecided
        If the two integrations disagree on the sequence of events.
    """
    t_end = scene.t_end if t_end is None else t_end
    fine = integrate(mechanism, 0.0, t_end, q0, v0, FINE)
    coarse = integrate(mechanism, 0.0, t_end, q0, v0, COARSE)
    # An event at the end itself may be in only one of the two motions by chance, and is left out.
    events, coarse_events = (
        tuple(
            event
            for event in motion_events(mechanism, motion, guides)
            if event.time < t_end - _NEAR_EVENT
        )
        for motion in (fine, coarse)
    )
    _require_same(scene, events, coarse_events)

    # Columns are compared between the events. The start is left out because it is exact, and because
    # the sign of a velocity of zero is arbitrary.
    times = np.array([event.time for event in events])
    t = np.linspace(0.0, t_end, _SAMPLES)[1:]
    if len(times):
        t = t[np.min(np.abs(t[:, None] - times), axis=1) > _NEAR_EVENT]
    fine_columns = motion_columns(mechanism, fine, t, "after")
    coarse_columns = motion_columns(mechanism, coarse, t, "after")
    uncertainty = {}
    for name, values in fine_columns.items():
        difference = np.max(np.abs(values - coarse_columns[name]))
        uncertainty[name] = float(difference + _ROUNDING * np.max(np.abs(values)))
    shift = max((abs(a.time - b.time) for a, b in zip(events, coarse_events)), default=0.0)
    uncertainty["event time"] = shift + _ROUNDING * t_end

    @lru_cache(maxsize=_CACHE_SIZE)
    def columns(instants: bytes, side: str) -> dict[str, np.ndarray]:
        shared = motion_columns(mechanism, fine, np.frombuffer(instants), side)
        # Callers share the arrays, which must not be changed.
        for values in shared.values():
            values.flags.writeable = False
        return shared

    return Truth(
        scene.name,
        Tier.HIGH_PRECISION,
        t_end,
        lambda t, side: dict(columns(t.tobytes(), side)),
        uncertainty,
        events,
    )


def _require_same(scene: Scene, fine: tuple[Event, ...], coarse: tuple[Event, ...]) -> None:
    """Raise Undecided if the events of two integrations differ in kind or guide."""
    for event, other in zip_longest(fine, coarse):
        is_same = event and other and (event.kind, event.joint) == (other.kind, other.joint)
        if not is_same:
            raise Undecided(
                f"{scene.name}: two integrations find different events, the first "
                f"{_describe(event)} and {_describe(other)}"
            )


def _describe(event: Event | None) -> str:
    """Return an event in words."""
    if event is None:
        return "none"
    return f"{event.kind} of {event.joint} at {event.time:.9f} s"
