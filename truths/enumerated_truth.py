"""Truth of a small mechanism with friction by enumeration of its contact modes.

The truths of `stiction.truths` that integrate in minimal coordinates apply to one kind of mechanism each.
`enumerated_motion` applies to every mechanism with a few frictional joints, but is slow. Its motion is used as a truth
where a data set needs one that is independent of the reference implementation, and no other exists.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stiction.scenes import Scene
from stiction.truths.enumerated_motion import TOLERANCE, Mode, Motion, simulate
from stiction.truths.reduced.piecewise_smooth import NoMotion, Undecided
from stiction.truths.truth import Tier, Truth, body_columns, two_sided

COARSER_TOLERANCE = 1e-9
"""Tolerance of the second integration, whose difference from the first is the uncertainty: a hundred times larger
than that of the first, so that the difference is dominated by the error of the second."""
CHECK_INSTANTS = 201
"""Number of instants at which the two integrations are compared."""
KINDS = ("slip", "stick", "reversal")
"""Kinds of events of the truth. Others, such as those of corner forces, do not change whether or how a joint slips."""


def enumerated_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of a scene by enumeration of its contact modes.

    The columns are those of bodies, and slip velocity, friction and mode of the joints with friction. The truth has no
    efforts of drives.

    Raises
    ------
    NoMotion
        If the motion ends before `t_end` (s).
    Undecided
        If two integrations find different events.
    ValueError
        For a self-locking guide.
    """
    end = scene.t_end if t_end is None else t_end
    motion = simulate(scene, end)
    coarser_motion = simulate(scene, end, COARSER_TOLERANCE)
    for integration in (motion, coarser_motion):
        if integration.breakdown is not None:
            breakdown = integration.breakdown
            raise NoMotion(f"{scene.name}: {breakdown.reason}", breakdown.time)
    switches = _switches(motion)
    coarser_switches = _switches(coarser_motion)
    if [switch[1:] for switch in switches] != [switch[1:] for switch in coarser_switches]:
        raise Undecided(f"{scene.name}: two integrations find different events")

    sampler = _Sampler(scene, motion)
    coarser_sampler = _Sampler(scene, coarser_motion)
    time_differences = [abs(one[0] - other[0]) for one, other in zip(switches, coarser_switches)]
    time_difference = max(time_differences, default=0.0)
    # Between the two times of an event the integrations are in different modes: only instants away from all events are
    # compared.
    check = np.linspace(0.0, end, CHECK_INSTANTS)
    for time, _, _ in switches:
        check = check[np.abs(check - time) > time_difference]
    differences = _largest_differences(sampler(check, "after"), coarser_sampler(check, "after"))
    # Both integrations may be exact up to rounding; the error that a step may have remains.
    uncertainty = {name: TOLERANCE + difference for name, difference in differences.items()}
    uncertainty["event time"] = TOLERANCE + time_difference
    return Truth(
        scene.name,
        Tier.HIGH_PRECISION,
        end,
        sampler,
        uncertainty,
        two_sided(switches, sampler),
        guides=frozenset(scene.frictional_joints),
    )


def _largest_differences(
    one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """Return the largest difference of each column at the same instants."""
    return {name: float(np.max(np.abs(values - other[name]))) for name, values in one.items()}


def _switches(motion: Motion) -> list[tuple[float, str, str]]:
    """Return time (s), kind and joint of each event of `KINDS`."""
    return [(event.time, event.kind, event.joint) for event in motion.events if event.kind in KINDS]


class _Sampler:
    """The columns of a motion at given times; see `stiction.truths.truth.Columns`."""

    def __init__(self, scene: Scene, motion: Motion):
        self._scene = scene
        self._motion = motion
        self._ends = [step.end for step in motion.steps]

    def __call__(self, t: np.ndarray, side: str) -> Mapping[str, np.ndarray]:
        rows = [self._row(float(time), side) for time in t]
        if not rows:
            return {name: np.empty(0) for name in self._row(0.0, "after")}
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def _row(self, t: float, side: str) -> dict[str, float]:
        """Return the values of all columns at one time (s)."""
        y, mode = self._state(t, side)
        q, v = np.split(y, 2)
        contact = self._motion.contact
        terms = contact.terms(np.asarray(t), q, v, mode.springs)
        forces = contact.forces(terms, mode)

        values: dict[str, float] = {}
        by_body = [part.reshape(-1, 3) for part in (q, v, forces.acceleration)]
        for number, body in enumerate(self._scene.bodies):
            columns = body_columns(body, *(part[number] for part in by_body))
            values |= {name: float(value) for name, value in columns.items()}
        for number, joint in enumerate(contact.names):
            values[f"{joint}.slip_velocity"] = float(terms.slip_speed[number])
            values[f"{joint}.friction"] = float(forces.f[number])
            values[f"{joint}.mode"] = float(mode.slip[number])
        return values

    def _state(self, t: float, side: str) -> tuple[np.ndarray, Mode]:
        """Return the state (q, v) and the contact mode at a time (s)."""
        steps = self._motion.steps
        locate = bisect.bisect_left if side == "before" else bisect.bisect_right
        index = locate(self._ends, t)
        if index < len(steps):
            return steps[index].state(t), steps[index].mode
        rest = self._motion.rest
        if rest is None or (side == "before" and t <= rest):
            return steps[-1].state(t), steps[-1].mode
        # The mechanism rests for good: the integration ended, and its last state stays.
        q = self._motion.q[-1]
        last_mode = steps[-1].mode if steps else self._mode_at_start()
        return np.concatenate([q, np.zeros_like(q)]), replace(
            last_mode, slip=np.zeros_like(last_mode.slip)
        )

    def _mode_at_start(self) -> Mode:
        """Return a mode in which all joints rest, for a mechanism that never moves."""
        joints = len(self._motion.contact.names)
        return Mode(np.zeros(joints, dtype=int), np.ones((joints, 2), dtype=int))
