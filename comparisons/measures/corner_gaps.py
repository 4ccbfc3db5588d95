"""Distances of the corners of a slider from the surfaces of its guide, flights between them, and impacts.

They are computed from positions, which mean the same for every method. Contact forces do not: those of time-stepping
methods are zero in single steps of a lasting contact.

The corners are numbered as in a `Trajectory`: 1 lower rear, 2 lower front, 3 upper front, 4 upper rear. Let y be the
height of the slider's point above the middle line of the guide, phi the angle of the slider relative to the guide, a
the length, b the width and c the clearance. A corner on the side sigma, 1 for the lower surface and -1 for the upper
one, is at (along, across) = (+-a/2, -sigma b/2) on the slider, and its gap is

    g = sigma (y + along sin phi + across cos phi) + b/2 + c
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fields import GROUND

ARRIVAL = 0.02
"""Gap over the clearance at which a corner has reached its surface.

It is so small that the rest of the flight is 0.3 % of its duration, and larger than the distance or the overlap at
which the contacts of most methods carry load.
"""
DEPARTURE = 0.1
"""Gap over the clearance that a corner must exceed before its next arrival counts as an impact.

Lower rebounds are not counted: a time-stepping method does not resolve the infinitely many of them that precede rest.
"""
APPROACH = 0.2
"""Gap over the clearance below which the end of a flight is fitted by a parabola."""
FEWEST_SAMPLES = 4
"""Smallest number of samples of the end of a flight to which a parabola is fitted: one more than its coefficients."""
ROUNDING = 1e-9
"""Part of a root below which its imaginary part counts as rounding."""
_ALONG = np.array([-0.5, 0.5, 0.5, -0.5])
"""Position of each corner along the slider, in lengths."""
_SIDE = np.array([1.0, 1.0, -1.0, -1.0])
"""Side of each corner: 1 at the lower surface, -1 at the upper one."""


@dataclass(frozen=True)
class CornerImpact:
    """The arrival of a corner at its surface.

    Attributes
    ----------
    corner : int
        Number of the corner, 1 to 4.
    time : float
        Time at which its gap is zero, s.
    speed : float
        Speed of approach at this time, m/s.
    """

    corner: int
    time: float
    speed: float


def guides_with_gaps(scene: Scene) -> list[str]:
    """Return the names of the guides with a length and a width, whose sliders have corners."""
    return [name for name, guide in scene.guides.items() if guide.length and guide.width]


def require_corners(scene: Scene) -> list[str]:
    """Return the names of the guides whose sliders have corners, of which a scene must have one at least.

    Raises
    ------
    InputError
        If no guide has a length and a width.
    """
    guides = guides_with_gaps(scene)
    if not guides:
        raise InputError(
            f"{scene.name}: joints: found no guide with length and width; expected one, whose slider has corners"
        )
    return guides


def corner_gaps(scene: Scene, run: Trajectory, guide: str) -> np.ndarray:
    """Return the distance of each corner of a slider from its surface, m.

    Parameters
    ----------
    scene : Scene
        The scene of the run, whose guide declares length, width and clearance.
    run : Trajectory
        The run; its joints may be ideal.
    guide : str
        Name of the guide.

    Returns
    -------
    ndarray, shape (4, samples)
        Gaps in the order of the corners; negative where a corner overlaps its surface.

    Raises
    ------
    InputError
        If the guide declares no clearance.
    """
    joint = scene.guides[guide]
    if joint.clearance is None or not joint.length or not joint.width:
        raise InputError(
            f"joints.{guide}.clearance: found {joint.clearance!r}; expected length, width and clearance, > 0 m"
        )
    guide_x, guide_y, guide_angle = _pose(run, joint.guide)
    slider_x, slider_y, slider_angle = _pose(run, joint.slider)
    # The point of the slider relative to a point of the middle line, in the axes of the ground.
    point_x, point_y = _rotated(joint.slider_point, slider_angle)
    middle_x, middle_y = _rotated(joint.point, guide_angle)
    away_x = slider_x + point_x - guide_x - middle_x
    away_y = slider_y + point_y - guide_y - middle_y
    # Its height above the middle line, along the normal of the guide.
    direction = np.asarray(joint.direction, dtype=float) / np.hypot(*joint.direction)
    direction_x, direction_y = _rotated((direction[0], direction[1]), guide_angle)
    height = direction_x * away_y - direction_y * away_x
    tilt = slider_angle - guide_angle - joint.angle
    along = joint.length * _ALONG[:, None]
    across = -0.5 * joint.width * _SIDE[:, None]
    lift = height + along * np.sin(tilt) + across * np.cos(tilt)
    gaps: np.ndarray = _SIDE[:, None] * lift + 0.5 * joint.width + joint.clearance
    return gaps


def _pose(run: Trajectory, body: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y (m) and angle (rad) of a body, each of shape (samples,); zeros for the ground."""
    if body == GROUND:
        zeros = np.zeros(len(run.t))
        return zeros, zeros, zeros
    return run[f"{body}.x"], run[f"{body}.y"], run[f"{body}.angle"]


def _rotated(vector: tuple[float, float], angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the components of a vector turned by an angle (rad), each of shape (samples,)."""
    x, y = vector
    return x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)


def impacts_in(t: np.ndarray, gaps: np.ndarray, clearance: float) -> list[CornerImpact]:
    """Return the impacts of all corners of a slider in the order of time.

    A corner that has been farther than `DEPARTURE` of the clearance from its surface hits it when the gap falls to
    `ARRIVAL` of the clearance. Time and speed are those at which the end of the flight reaches the gap zero: the
    parabola through its last samples or, where a flight has too few, the straight line through two of them.

    Parameters
    ----------
    t : ndarray, shape (samples,)
        Times of the samples, s.
    gaps : ndarray, shape (4, samples)
        Gaps of the corners, m.
    clearance : float
        Gap of the centred slider to each surface, m.
    """
    impacts = [
        _impact(corner, t, gap, arrival, clearance)
        for corner, gap in enumerate(gaps, 1)
        for arrival in _arrivals(gap, clearance)
    ]
    return sorted(impacts, key=lambda impact: impact.time)


def _arrivals(gap: np.ndarray, clearance: float) -> Iterator[int]:
    """Yield the samples at which a corner has arrived at its surface."""
    is_away = gap > DEPARTURE * clearance
    is_at_surface = gap <= ARRIVAL * clearance
    # The state is 1 away from the surface and -1 at it. Samples between the two limits, which would be 0, do not
    # change the state, and are skipped.
    state = is_away.astype(int) - is_at_surface.astype(int)
    samples = np.flatnonzero(state)
    changes = np.flatnonzero(np.diff(state[samples]) < 0)
    for change in changes:
        yield int(samples[change + 1])


def _impact(
    corner: int, t: np.ndarray, gap: np.ndarray, arrival: int, clearance: float
) -> CornerImpact:
    """Return the impact of a corner that has arrived at its surface at the sample `arrival`."""
    # The end of the flight: the samples before the arrival whose gap decreases and is below `APPROACH`.
    begin = arrival
    while begin > 0 and gap[begin - 1] > gap[begin] and gap[begin - 1] < APPROACH * clearance:
        begin -= 1
    if arrival - begin >= FEWEST_SAMPLES:
        impact = _extended_parabola(corner, t[begin:arrival], gap[begin:arrival])
        if impact is not None:
            return impact
    return _extended_line(corner, t, gap, arrival)


def _extended_parabola(corner: int, t: np.ndarray, gap: np.ndarray) -> CornerImpact | None:
    """Return the impact at which the parabola through the end of a flight reaches the gap zero; None if it does not.

    `t` (s) and `gap` (m) are the samples of the end of the flight, with the shape (samples,).
    """
    # Time from the last sample, so that the fit is well conditioned.
    time = t - t[-1]
    coefficients = np.polyfit(time, gap, 2)
    roots = np.roots(coefficients)
    is_real = np.abs(roots.imag) <= ROUNDING * np.abs(roots)
    later_roots = roots.real[is_real & (roots.real > 0.0)]
    if not len(later_roots):
        return None
    root = float(later_roots.min())
    slope = float(np.polyval(np.polyder(coefficients), root))
    return CornerImpact(corner, float(t[-1] + root), max(0.0, -slope))


def _extended_line(corner: int, t: np.ndarray, gap: np.ndarray, arrival: int) -> CornerImpact:
    """Return the impact at which the straight line through the last two samples before the arrival reaches zero.

    If the corner moves away between these two samples, it turns back within the step of the arrival. Its impact is then
    at the arrival, with the mean speed in this step.
    """
    last = arrival - 1
    if last >= 1 and gap[last - 1] > gap[last]:
        speed = float((gap[last - 1] - gap[last]) / (t[last] - t[last - 1]))
        time_left = min(float(gap[last]) / speed, float(t[arrival] - t[last]))
        return CornerImpact(corner, float(t[last]) + time_left, speed)
    speed = float((gap[last] - gap[arrival]) / (t[arrival] - t[last]))
    return CornerImpact(corner, float(t[arrival]), speed)


@dataclass(frozen=True)
class ContactShares:
    """Parts of the time, 0 to 1, by the corners that are at their surface.

    Attributes
    ----------
    none, one, adjacent, opposite : float
        No corner is at its surface; one is; two at the same surface; two at different surfaces and different ends.
    """

    none: float
    one: float
    adjacent: float
    opposite: float


def contact_shares(gaps: np.ndarray, clearance: float) -> ContactShares:
    """Return the parts of the samples in which corners are at their surface (`ARRIVAL`).

    `gaps` have the shape (4, samples). Both corners of one end touch only if the clearance is within the overlap of the
    contacts; such samples belong to no part.
    """
    is_at_surface = gaps <= ARRIVAL * clearance
    rear_lower, front_lower, front_upper, rear_upper = is_at_surface
    count = np.sum(is_at_surface, axis=0)
    is_adjacent = (rear_lower & front_lower) | (front_upper & rear_upper)
    is_opposite = (rear_lower & front_upper) | (front_lower & rear_upper)
    return ContactShares(
        none=float(np.mean(count == 0)),
        one=float(np.mean(count == 1)),
        adjacent=float(np.mean((count == 2) & is_adjacent)),
        opposite=float(np.mean((count == 2) & is_opposite)),
    )
