"""Guides whose motion a drive prescribes, and loads that come at once, against closed forms."""

from math import pi

import numpy as np
import pytest
from reference_checks import along, balance_residual, guide_scene, simulate

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, scene_from_dict

R, L = 0.2, 0.6  # m, crank and rod
MU = 0.1


def crank_from_its_dead_centre(swing):
    """A slider-crank at rest in its outer dead centre; the motor turns the crank by swing (1 - cos 3t)."""
    return scene_from_dict(
        {
            "t_end": 2,
            "gravity": [0, -10],
            "bodies": {
                "crank": {"mass": 1, "inertia": 0.01, "position": [R / 2, 0]},
                "rod": {"mass": 1, "inertia": 0.03, "position": [R + L / 2, 0]},
                "slider": {"mass": 1, "inertia": 0.01, "position": [R + L, 0]},
            },
            "joints": {
                "shaft": {
                    "type": "revolute",
                    "bodies": ["crank", "ground"],
                    "points": [[-R / 2, 0], [0, 0]],
                },
                "knee": {
                    "type": "revolute",
                    "bodies": ["rod", "crank"],
                    "points": [[-L / 2, 0], [R / 2, 0]],
                },
                "pin": {
                    "type": "revolute",
                    "bodies": ["slider", "rod"],
                    "points": [[0, 0], [L / 2, 0]],
                },
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "mu": MU,
                    "mus": 1.2 * MU,
                    "length": 0.2,
                    "width": 0.1,
                },
            },
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["crank", "ground"],
                    "law": {
                        "type": "sine",
                        "offset": swing,
                        "amplitude": swing,
                        "frequency": 3,
                        "phase": -pi / 2,
                    },
                }
            },
        },
        "crank",
    )


@pytest.mark.parametrize("swing", [1, 2])
def test_slider_that_a_crank_moves_from_its_dead_centre(swing):
    """At the start it has no velocity, acceleration and jerk, and its friction holds nothing: it slips as soon as the crank moves it."""
    scene = crank_from_its_dead_centre(swing)
    run = simulate(scene, rtol=1e-10, output_step=0.01)
    turn = swing * (1 - np.cos(3 * run.t))
    sine = R * np.sin(turn)
    np.testing.assert_allclose(
        run["slider.x"], R * np.cos(turn) + np.sqrt(L**2 - sine**2), rtol=0, atol=1e-8
    )
    speed = (
        -3 * swing * np.sin(3 * run.t) * (sine + R * np.cos(turn) * sine / np.sqrt(L**2 - sine**2))
    )
    slips = np.abs(speed) > 1e-6
    assert np.count_nonzero(~slips) <= 2  # the start, and the end of the swing
    load = sum(np.abs(run[f"guide.F{corner}"]) for corner in (1, 2, 3, 4))
    np.testing.assert_allclose(
        run["guide.friction"][slips], (-MU * np.sign(speed) * load)[slips], rtol=1e-8
    )
    assert balance_residual(scene, run.t, run.columns) < 1e-9
    # it moves from the first instant on: no rest, and no break-away, precedes the end of the swing
    assert run.events[0].kind == "reversal" and run.events[0].time > 0.1
    assert run["guide.mode"][1] != 0


def test_drive_that_starts_without_rate_and_acceleration():
    """A natural spline through 0, 1/6 m, 1 m begins as t^3/6; then the drive gives the slider's inertia and its friction."""
    law = {"type": "table", "interpolation": "cubic", "times": [0, 1, 2], "values": [0, "1/6", 1]}
    scene = scene_from_dict(
        guide_scene(
            guide={"mu": 0.1, "mus": 0.15},
            drives={
                "feed": {
                    "type": "distance",
                    "axis": [1, 0],
                    "bodies": ["slider", "ground"],
                    "law": law,
                }
            },
        ),
        "feed",
    )
    run = simulate(scene, rtol=1e-9)
    np.testing.assert_allclose(run["slider.x"], run.t**3 / 6, rtol=0, atol=1e-12)
    # the drive moves it from the first instant on, and the motor works against kinetic friction: no event of its own
    assert run.events == () and np.all(run["guide.mode"] == 1)
    np.testing.assert_allclose(run["guide.friction"][1:], -1.0, rtol=1e-12)  # mu m g
    np.testing.assert_allclose(run["feed.effort"][1:], run.t[1:] + 1.0, rtol=1e-9)


@pytest.mark.parametrize("method", ["event", "paper", "textbook"])
def test_distance_driven_to_zero_ends_the_run(method):
    """A distance of 1 m - 1.5 m/s t is none from 2/3 s on."""
    scene = scene_from_dict(
        guide_scene(
            slider={"position": [1, 0], "velocity": [-1.5, 0]},
            drives={
                "feed": {
                    "type": "distance",
                    "bodies": ["slider", "ground"],
                    "law": {"type": "linear", "offset": 1, "rate": -1.5},
                }
            },
            guide={"mu": 0.1, "length": 0.5, "width": 0.2},
        )
        | {"stabilization": {"method": "none"}},
        "feed",
    )
    run = ReferenceEngine().simulate(
        scene, method=method, output_step=0.01, **({} if method == "event" else {"dt": 0.01})
    )
    assert (
        run.breakdown is not None
        and run.breakdown.kind == "not finite"
        and "a distance that is driven to zero" in run.termination
    )
    assert run.breakdown.time == pytest.approx(2 / 3, abs=1e-9 if method == "event" else 0.01)
    np.testing.assert_allclose(run["slider.x"], 1 - 1.5 * run.t, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("rise", [1e-3, 1e-7, 1e-9, 1e-12])
def test_load_that_comes_at_once_on_a_mechanism_at_rest(rise, rtol):
    """1 N, from 1 s to 1 s + rise up to 3 N: a mass of 1 kg breaks away at 1.5 N after a quarter of it; then friction is 1 N."""
    scene = scene_from_dict(
        guide_scene(
            t_end=2,
            guide={"mu": 0.1, "mus": 0.15, "length": 0.5, "width": 0.2},
            forces={
                "pull": along([1, 0], type="table", times=[0, 1, 1 + rise, 2], values=[1, 1, 3, 3])
            },
        ),
        "pull",
    )
    run = simulate(scene, rtol=rtol)
    assert [event.kind for event in run.events] == ["slip"]
    assert run.events[0].time == pytest.approx(1 + rise / 4, abs=1e-15)
    # x'' = 2 u/rise with u = t - 1 from rise/4 to rise, then 2
    speed, way = 15 / 16 * rise, (63 / 192 - 3 / 64) * rise**2
    left = 1 - rise
    assert run["slider.x"][-1] == pytest.approx(
        way + speed * left + left**2, abs=1e2 * rtol + 1e-15
    )


@pytest.mark.parametrize("name", ["slider-bar-case-3", "mass-on-belt", "slider-on-moving-guide"])
def test_seconds_are_a_unit_like_any_other(name):
    """The numbers of a mechanism that takes nanoseconds are those of one that takes seconds; so are its events."""
    scene = load_scene(name).model_copy(update={"t_end": 3.0})
    units = Units(length=1e-6, mass=1e-15, time=1e-9)
    one, other = (
        simulate(scaled(scene, unit), rtol=1e-9, output_step=0.1 * unit.time)
        for unit in (Units(), units)
    )
    assert [(event.kind, event.joint) for event in one.events] == [
        (event.kind, event.joint) for event in other.events
    ]
    np.testing.assert_allclose(
        [event.time / units.time for event in other.events],
        [event.time for event in one.events],
        rtol=0,
        atol=1e-10,
    )
    np.testing.assert_allclose(
        other["slider.x"] / units.length, one["slider.x"], rtol=0, atol=1e-10
    )
