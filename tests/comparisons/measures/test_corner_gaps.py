"""Gaps of corners, impacts and flights: geometry from the positions of the corners, and bounces in closed form."""

import numpy as np
import pytest

from stiction.comparisons.measures.corner_gaps import (
    DEPARTURE,
    contact_shares,
    corner_gaps,
    guides_with_gaps,
    impacts_in,
)
from stiction.scenes import InputError, Trajectory, load_scene, scene_from_dict, vary

LENGTH, WIDTH, CLEARANCE = 0.6, 0.5, 2e-3


def moving_guide(dice):
    """Return a slider on a body, with a direction, points and an angle drawn at random."""
    body = {"mass": 1.0, "inertia": 0.1}
    guide = {
        "type": "translational",
        "slider": "slider",
        "guide": "carrier",
        "direction": list(dice.normal(size=2)),
        "point": list(dice.normal(size=2)),
        "slider_point": list(dice.normal(size=2)),
        "angle": float(dice.uniform(-1, 1)),
        "length": LENGTH,
        "width": WIDTH,
        "clearance": CLEARANCE,
    }
    tables = {"bodies": {"carrier": body, "slider": body}, "joints": {"guide": guide}}
    # a start that satisfies the guide: the slider is turned and displaced as it declares
    direction = np.array(guide["direction"]) / np.hypot(*guide["direction"])
    turn = guide["angle"]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    place = np.array(guide["point"]) + 0.3 * direction - rotation @ guide["slider_point"]
    tables["bodies"]["slider"] = {
        **tables["bodies"]["slider"],
        "position": [float(part) for part in place],
        "angle": turn,
    }
    return scene_from_dict(tables)


def run_with(poses):
    """Return a trajectory of one instant with the poses (x, y, angle) of bodies."""
    columns = {
        f"{body}.{name}": np.array([value])
        for body, pose in poses.items()
        for name, value in zip(("x", "y", "angle"), pose)
    }
    return Trajectory("drawn", "none", "1", "contact", np.zeros(1), columns)


def rotated(vector, angle):
    x, y = vector
    return np.array([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)])


def test_gaps_are_the_distances_of_the_corners_from_the_surfaces():
    """Both bodies anywhere: each corner is placed on the ground, and its distance from its line is taken there."""
    dice = np.random.default_rng(50)
    for _ in range(100):
        scene = moving_guide(dice)
        guide = scene.guides["guide"]
        carrier = (*dice.normal(size=2), dice.uniform(-3, 3))
        direction = rotated(np.array(guide.direction) / np.hypot(*guide.direction), carrier[2])
        normal = rotated(direction, np.pi / 2)
        middle = np.array(carrier[:2]) + rotated(guide.point, carrier[2])
        along, height, tilt = dice.normal(), 1e-3 * dice.normal(), 1e-2 * dice.normal()
        # the axis of the slider along the guide, and its point near the middle line
        axis = rotated(direction, tilt)
        across = rotated(axis, np.pi / 2)
        point = middle + along * direction + height * normal
        angle = carrier[2] + guide.angle + tilt
        centre = point - rotated(guide.slider_point, angle)
        run = run_with({"carrier": carrier, "slider": (*centre, angle)})
        expected = []
        for ahead, up in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            corner = point + 0.5 * ahead * LENGTH * axis + 0.5 * up * WIDTH * across
            surface = middle + up * (0.5 * WIDTH + CLEARANCE) * normal
            expected.append(up * normal @ (surface - corner))
        gaps = corner_gaps(scene, run, "guide")[:, 0]
        np.testing.assert_allclose(gaps, expected, rtol=0, atol=1e-14)


def bounces(restitution, gravity=9.81, samples=200_001, t_end=0.3):
    """Return times, gaps of a ball that falls from `CLEARANCE`, and time and speed of each of its impacts."""
    t = np.linspace(0.0, t_end, samples)
    gap = np.zeros(samples)
    fall = np.sqrt(2 * CLEARANCE / gravity)
    impacts = []
    begin, speed, end = -fall, fall * gravity, fall
    while True:
        inside = (t >= begin) & (t <= end)
        gap[inside] = (speed - 0.5 * gravity * (t[inside] - begin)) * (t[inside] - begin)
        if end > t_end or speed < 1e-4:
            return t, gap, impacts
        impacts.append((end, speed))
        begin, speed = end, restitution * speed
        end = begin + 2 * speed / gravity


@pytest.mark.parametrize("restitution", [0.0, 0.4, 0.6, 0.8])
def test_bounces_in_closed_form(restitution):
    """A bounce rises to e^2 of the height before; impacts count until it is below `DEPARTURE` of the clearance."""
    t, gap, impacts = bounces(restitution)
    heights = restitution ** (2 * np.arange(len(impacts)))
    counted = [impact for impact, height in zip(impacts, heights) if height > DEPARTURE]
    # the other corners stay beyond the other surface's departure
    gaps = np.vstack([gap, np.full((3, len(gap)), CLEARANCE)])
    found = impacts_in(t, gaps, CLEARANCE)
    assert [impact.corner for impact in found] == [1] * len(counted)
    assert [impact.time for impact in found] == pytest.approx(
        [time for time, _ in counted], abs=1e-7
    )
    assert [impact.speed for impact in found] == pytest.approx(
        [speed for _, speed in counted], rel=1e-3
    )


def test_a_flight_of_few_samples():
    """A corner that crosses the gap in three steps: the straight line through the last two samples is extended."""
    t = np.arange(6) * 1e-3
    gap = CLEARANCE * np.array([1.0, 0.7, 0.4, 0.1, -0.2, -0.2])
    (impact,) = impacts_in(t, gap[None], CLEARANCE)
    assert impact.time == pytest.approx(3e-3 + 1e-3 / 3)
    assert impact.speed == pytest.approx(300 * CLEARANCE)


def test_parts_of_the_time_by_contact():
    closed, away = 0.01, 1.0
    samples = [
        (away, away, away, away),
        (closed, away, away, away),
        (away, away, closed, away),
        (closed, closed, away, away),
        (away, away, closed, closed),
        (closed, away, closed, away),
        (away, closed, away, closed),
        (closed, away, away, closed),
    ]
    shares = contact_shares(CLEARANCE * np.array(samples).T, CLEARANCE)
    assert (shares.none, shares.one, shares.adjacent, shares.opposite) == (
        1 / 8,
        2 / 8,
        2 / 8,
        2 / 8,
    )


def test_guides_without_corners_or_gap_are_refused():
    scene = load_scene("slider-bar-case-1")
    assert guides_with_gaps(scene) == ["guide"]
    assert guides_with_gaps(load_scene("pendulum")) == []
    assert guides_with_gaps(vary(scene, {"guide.width": None})) == []
    with pytest.raises(InputError, match=r"joints.guide.clearance: found None"):
        corner_gaps(scene, run_with({"slider": (0.25, 0.0, 0.0)}), "guide")
