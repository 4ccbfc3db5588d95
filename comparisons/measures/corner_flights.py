"""Flights of corners through the clearance of their guides, predicted from the motion of ideal joints.

In an ideal joint an end of a slider passes from one surface of its guide to the other in an instant. With a clearance c
it crosses the gap 2 c in free flight. From the ideal motion follow the time of this flight and the speed of the first
impact, to leading order in c (docs/theory/clearance.md derives the law and states its assumptions):

    A0 t^2 / 2 + A1 t^3 / 6 = 2 c ,    impact speed A0 t + A1 t^2 / 2

where A0 + A1 t is the acceleration of the released end away from its surface at the time t after its release. Where the
corner force passes through zero at the rate N', A0 = 0 and A1 = N'/m with the effective mass m of the end, hence
t = (12 m c / N')^(1/3). Where the corner force jumps to the other sign, as at a reversal of slip, A0 = F/m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from stiction.comparisons.measures.released_ends import (
    ENDS,
    LOWER_CORNER,
    UPPER_CORNER,
    Instant,
    ReleasedEnds,
)
from stiction.reference_impl.multibody.subsystems import independent_parts
from stiction.scenes import Event, InputError, Scene, Trajectory

ZERO_FORCE = 1e-6
"""Part of the largest corner force of a run below which an end is unloaded at an event; located events leave 1e-9."""
DIFFERENCE = 1e-5
"""Part of the simulated time over which rates along the motion are taken, by central differences."""
TIME_ROUNDING = 1e-14
"""Part of the time to which a zero of a force between outputs is located."""


class Release(StrEnum):
    """The way in which the force of an end changes its sign in the ideal motion."""

    ZERO = "zero"
    """It passes through zero."""
    JUMP = "jump"
    """It jumps to the other sign, because friction jumps."""


@dataclass(frozen=True)
class CornerFlight:
    """The predicted flight of one end of a slider from one surface of its guide to the other.

    Attributes
    ----------
    time : float
        Instant at which the end is released in the ideal motion, s.
    guide : str
        Name of the guide.
    corner : int
        Number of the corner that leaves its surface, 1 to 4.
    opposite_corner : int
        Number of the corner of the same end that hits the other surface.
    release : Release
        Whether the corner force passes through zero, or jumps.
    force : float
        Force of the opposite corner in the ideal joint just after the release, N; 0 if it passes through zero.
    rate : float
        Rate N' at which the force of the opposite corner grows in the ideal joint, N/s.
    mass : float
        Effective mass of the end, kg: the force of the opposite corner in the ideal joint over the acceleration without
        it. All other joints, and an end that is not released, stay in their contact mode.
    clearance : float
        Gap to each surface, m.
    flight_time : float
        Time from the release to the first impact, s; NaN if the end turns back before it.
    impact_speed : float
        Speed across the guide at the first impact, m/s; NaN if the flight time is.
    crowding : float
        Flight time over the time from the release to the nearest other event of the ideal motion, before or after it.
        The law assumes that it is small: an impact or another release in the meantime changes the flight.
    mobilization : float
        Of a slider at rest, the friction at the corner about which it turns over its bound: the larger one of the
        values at the release and, if there is one, at the first impact. The law assumes that it is below 1: otherwise
        this corner slips, too. It is 0 for a slider that slips.
    """

    time: float
    guide: str
    corner: int
    opposite_corner: int
    release: Release
    force: float
    rate: float
    mass: float
    clearance: float
    flight_time: float
    impact_speed: float
    crowding: float
    mobilization: float


@dataclass(frozen=True)
class _Released:
    """An instant of the ideal motion, just after which ends of a slider change their surface, and these ends."""

    instant: Instant
    ends: tuple[str, ...]
    release: Release


def corner_flights(
    scene: Scene, ideal: Trajectory, clearance: float | None = None
) -> list[CornerFlight]:
    """Predict the flight of each end of a slider that changes its surface in a run with ideal joints.

    Parameters
    ----------
    scene
        The scene of the run.
    ideal
        A run of the reference with located events and their values. Ends of sliders at rest, and of guides without
        friction, have no events; their releases are found between outputs whose forces differ in sign.
    clearance
        Gap to each surface, of all guides with a length, m; None for the clearance that each guide declares.

    Returns
    -------
    list of CornerFlight
        In order of time.

    Raises
    ------
    InputError
        If the clearance is not positive, or if the friction of a pin depends on the force in it: the law does not
        contain how this friction changes with the force of a corner.
    """
    if clearance is not None and not (math.isfinite(clearance) and clearance > 0.0):
        raise InputError(f"clearance: found {clearance!r}; expected metres, > 0")
    for name, pin in scene.pins.items():
        if pin.is_under_load:
            key, coefficient = ("mu", pin.mu) if pin.mu else ("mus", pin.mus)
            raise InputError(
                f"joints.{name}.{key}: found {coefficient:g}; expected no friction of pins that depends on their "
                "force, which the law of free flight does not contain"
            )
    flights = []
    for part in independent_parts(scene):
        for name, guide in part.guides.items():
            gap = guide.clearance if clearance is None else clearance
            if guide.length is not None and gap is not None:
                flights += _flights_of_slider(ReleasedEnds(part, name), gap, ideal)
    return sorted(flights, key=lambda flight: flight.time)


def _flights_of_slider(slider: ReleasedEnds, gap: float, ideal: Trajectory) -> list[CornerFlight]:
    """Return the flights of both ends of a slider in a gap (m)."""
    forces = [ideal[f"{slider.guide}.F{number}"] for number in range(1, 5)]
    tolerance = ZERO_FORCE * float(np.nanmax(forces))
    events = _events_with(slider.guide, ideal)
    releases = list(_releases(slider, ideal, events, tolerance))
    instants = np.array(
        [*(event.time for event in events), *(released.instant.time for released in releases)]
    )
    difference = DIFFERENCE * float(ideal.t[-1])
    flights = list[CornerFlight]()
    for released in releases:
        others = instants[instants != released.instant.time]
        distance = float(np.abs(others - released.instant.time).min(initial=math.inf))
        flights += _flights(slider, released, gap, difference, distance)
    return flights


def _flights(
    slider: ReleasedEnds,
    released: _Released,
    gap: float,
    difference: float,
    event_distance: float,
) -> Iterator[CornerFlight]:
    """Yield the flights of ends that are released together.

    `difference` (s) is half the interval of rates, `event_distance` (s) the time to the nearest other event.
    """
    instant = released.instant
    accelerations = {}
    jerks = {}
    sides = {}
    for end in released.ends:

        def acceleration(step: float, end: str = end) -> float:
            return slider.acceleration(instant, end, released.ends, step)

        jerks[end] = _rate(acceleration, difference)
        accelerations[end] = acceleration(0.0) if released.release == Release.JUMP else 0.0
        # An end that moves along the normal has left the lower surface, and will press on the upper one.
        sides[end] = -math.copysign(1.0, accelerations[end] or jerks[end])
    for end in released.ends:

        def force(step: float, end: str = end) -> float:
            return sides[end] * slider.end_force(instant, end, step, sides)

        is_jump = released.release == Release.JUMP
        drive = _Drive(
            side=sides[end],
            force=force(0.0) if is_jump else 0.0,
            rate=_rate(force, difference),
            acceleration=-sides[end] * accelerations[end],
            jerk=-sides[end] * jerks[end],
        )
        flight = _flight(slider.guide, released, end, drive, gap, event_distance)
        mobilization = slider.mobilization(instant, released.ends)
        # An end that turns back has no impact.
        if math.isfinite(flight.flight_time):
            at_impact = slider.mobilization(instant, released.ends, flight.flight_time)
            mobilization = max(mobilization, at_impact)
        yield replace(flight, mobilization=mobilization)


@dataclass(frozen=True)
class _Drive:
    """What drives an end through the gap, just after its release.

    Attributes
    ----------
    side : float
        The surface to which it flies: 1 for the lower, -1 for the upper one.
    force, rate : float
        Force of its corner there in the ideal joint, N, and the rate at which it grows, N/s.
    acceleration, jerk : float
        Acceleration of the end towards that surface, m/s², and the rate at which it grows, m/s³.
    """

    side: float
    force: float
    rate: float
    acceleration: float
    jerk: float


def _flight(
    guide: str, released: _Released, end: str, drive: _Drive, gap: float, event_distance: float
) -> CornerFlight:
    """Return the flight of a released end; `event_distance` (s) is the time to the nearest other event."""
    time = crossing_time(drive.acceleration, drive.jerk, 2.0 * gap)
    mass = drive.rate / drive.jerk
    if released.release == Release.JUMP:
        mass = drive.force / drive.acceleration
    corner, opposite = LOWER_CORNER[end], UPPER_CORNER[end]
    if drive.side > 0.0:
        corner, opposite = opposite, corner
    return CornerFlight(
        time=released.instant.time,
        guide=guide,
        corner=corner,
        opposite_corner=opposite,
        release=released.release,
        force=drive.force,
        rate=drive.rate,
        mass=mass,
        clearance=gap,
        flight_time=time,
        impact_speed=drive.acceleration * time + 0.5 * drive.jerk * time**2,
        crowding=time / event_distance,
        mobilization=0.0,
    )


def crossing_time(acceleration: float, jerk: float, distance: float) -> float:
    """Return the first time t > 0 at which acceleration t^2/2 + jerk t^3/6 is a distance > 0; NaN if there is none."""
    if acceleration == 0.0:
        return (6.0 * distance / jerk) ** (1.0 / 3.0) if jerk > 0.0 else math.nan
    roots = np.roots([jerk / 6.0, acceleration / 2.0, 0.0, -distance])
    is_real = np.abs(roots.imag) <= 1e-9 * np.abs(roots)
    times = roots.real[is_real & (roots.real > 0.0)]
    return float(times.min()) if len(times) else math.nan


def _rate(function: Callable[[float], float], difference: float) -> float:
    """Return the derivative of a function at 0 by central differences."""
    return (function(difference) - function(-difference)) / (2.0 * difference)


def _events_with(guide: str, ideal: Trajectory) -> list[Event]:
    """Return the events and switches whose values contain those of a guide, in order of time."""
    own = [
        event
        for event in (*ideal.events, *ideal.switches)
        if f"{guide}.normal_force" in event.after
    ]
    return sorted(own, key=lambda event: event.time)


def _releases(
    slider: ReleasedEnds, ideal: Trajectory, events: Sequence[Event], tolerance: float
) -> Iterator[_Released]:
    """Yield the releases of both ends; `tolerance` (N) is the force below which an end is unloaded."""
    part = slider.part
    start = Instant.of_output(ideal, 0, part)
    # The motion is smooth from each event to the next.
    for event in events:
        before = Instant.of(event.time, event.before, part)
        after = Instant.of(event.time, event.after, part)
        yield from _smooth_releases(slider, ideal, start, before, tolerance)
        yield from _releases_at_event(slider.guide, event, before, after, tolerance)
        start = after
    end = Instant.of_output(ideal, len(ideal.t) - 1, part)
    if end.time > start.time:
        yield from _smooth_releases(slider, ideal, start, end, tolerance)


def _releases_at_event(
    guide: str, event: Event, before: Instant, after: Instant, tolerance: float
) -> Iterator[_Released]:
    """Yield the ends whose force is zero at a corner event, and those whose force jumps across zero at an event."""
    unloaded = []
    jumped = []
    for end in ENDS:
        left, right = before.end_force(guide, end), after.end_force(guide, end)
        is_unloaded = max(abs(left), abs(right)) <= tolerance
        if is_unloaded and event.kind == "corner" and event.joint == guide:
            unloaded.append(end)
        elif left * right < 0.0 and not is_unloaded:
            jumped.append(end)
    if unloaded:
        yield _Released(after, tuple(unloaded), Release.ZERO)
    if jumped:
        yield _Released(after, tuple(jumped), Release.JUMP)


def _smooth_releases(
    slider: ReleasedEnds, ideal: Trajectory, start: Instant, end: Instant, tolerance: float
) -> Iterator[_Released]:
    """Yield the ends whose force passes through zero between two events, without an event of its own."""
    inside = np.flatnonzero((ideal.t > start.time) & (ideal.t < end.time))
    outputs = [Instant.of_output(ideal, int(number), slider.part) for number in inside]
    for first, second in pairwise([start, *outputs, end]):
        ends_by_time: dict[float, list[str]] = {}
        for side in ENDS:
            left = first.end_force(slider.guide, side)
            right = second.end_force(slider.guide, side)
            if left * right < 0.0 and min(abs(left), abs(right)) > tolerance:
                time = _zero_time(slider, first, second, side)
                ends_by_time.setdefault(time, []).append(side)
        for time, ends in sorted(ends_by_time.items()):
            yield _Released(first.between(time, second), tuple(ends), Release.ZERO)


def _zero_time(slider: ReleasedEnds, first: Instant, second: Instant, end: str) -> float:
    """Return the time between two instants of one mode at which the force of an end is zero, s."""

    def force(time: float) -> float:
        return slider.end_force(first.between(time, second), end)

    return float(brentq(force, first.time, second.time, rtol=TIME_ROUNDING))
