"""Times that coincide with events, forces that equal the capacity, velocities that graze zero."""

import numpy as np
import pytest
from reference_checks import along, guide_scene, simulate

from stiction.engines.reference.engine import ReferenceEngine, output_times
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths import NoMotion, slider_bar_truth
from stiction.truths.reduced.slider_bar import SliderBar

METHODS = [{"rtol": 1e-9}, {"method": "paper"}]


@pytest.mark.parametrize(
    ("t_end", "step"),
    [
        (0.3, 0.1),
        (0.7, 0.1),
        (1.2, 0.4),
        (2.1, 0.3),
        (0.25, 0.1),
        (0.01, 1.0),
        (1e-9, 0.01),
        (1e-12, 1e-12),
    ],
)
def test_output_covers_the_run(t_end, step):
    """Multiples of the step that rounding takes past t_end, steps longer than the run, very short runs."""
    times = output_times(t_end, step)
    assert times[0] == 0 and times[-1] == t_end and np.all(np.diff(times) > 0)
    trajectory = simulate(load_scene("coulomb-oscillator"), t_end=t_end, output_step=step)
    np.testing.assert_array_equal(trajectory.t, times)


@pytest.mark.parametrize(
    "arguments",
    [
        {"rtol": 0.0},
        {"rtol": -1.0},
        {"rtol": np.nan},
        {"dt": 0.0},
        {"t_end": -1.0},
        {"t_end": 0.0},
        {"output_step": 0.0},
        {"dt": 1e-3, "rtol": 1e-9},
        {"rtol": 1e-9, "method": "paper"},
        {"method": "guess"},
        {"stabilisation": "none"},
        {"stabilization": "glue"},
    ],
)
def test_settings_that_make_no_run_are_refused(arguments):
    with pytest.raises(ValueError, match="expected"):
        ReferenceEngine().simulate(load_scene("coulomb-oscillator"), **{"t_end": 1.0, **arguments})


def run_at(scene, output, t_end, rtol=1e-10):
    mechanism = Mechanism(scene)
    return simulate_event_driven(
        mechanism, *mechanism.initial_state(), np.asarray(output), t_end, rtol
    )


def test_output_at_event_times_and_end_at_an_event():
    scene = load_scene("coulomb-oscillator", {"b": 0.8})
    events = run_at(scene, [0.0], 20.0).events
    times = np.array([event.time for event in events])
    assert {"stick", "slip"} <= {event.kind for event in events}
    run = run_at(scene, [0.0, *times, 20.0], 20.0)
    assert len(run.t) == len(times) + 2 and len(run.events) == len(events)
    for i, event in enumerate(run.events):
        assert abs(event.time - times[i]) < 1e-12
        values = event.before["slider.ax"], event.after["slider.ax"]
        assert min(values) - 1e-6 <= run.columns["slider.ax"][i + 1] <= max(values) + 1e-6
        assert run.columns["slider.x"][i + 1] == pytest.approx(event.after["slider.x"], abs=1e-9)
    for k in (
        0,
        len(times) // 2,
        len(times) - 1,
    ):
        # the run ends at the very instant of an event: with it or before
        ended = run_at(scene, [0.0, times[k]], times[k])
        assert ended.termination == "end" and len(ended.t) == 2
        assert len(ended.events) in (k, k + 1)
        assert ended.columns["slider.x"][-1] == pytest.approx(events[k].after["slider.x"], abs=1e-9)


@pytest.mark.parametrize("settings", METHODS)
@pytest.mark.parametrize(
    ("friction", "force", "moves"),
    [
        ({"mu": 0.2}, 2.0, False),
        ({"mu": 0.2}, -2.0, False),
        ({"mu": 0.2}, 2.001, True),
        ({"mu": 0.2}, -2.001, True),
        ({"mu": 0.1, "mus": 0.2}, 2.0, False),
        ({"mu": 0.1, "mus": 0.2}, 2.0001, True),
        ({"mu": 0.2, "length": 0.5, "width": 0.3}, 2.0, False),
        ({"mu": 0.2, "length": 0.5, "width": 0.3}, -2.001, True),
    ],
)
def test_start_at_rest_with_a_load_of_the_size_of_the_capacity(friction, force, moves, settings):
    scene = scene_from_dict(
        guide_scene(guide=friction, forces={"load": along([1, 0], type="constant", value=force)})
    )
    trajectory = simulate(scene, t_end=1, **settings)
    acceleration = (force - np.sign(force) * friction["mu"] * 10) if moves else 0.0
    np.testing.assert_allclose(
        trajectory["slider.x"], acceleration / 2 * trajectory.t**2, atol=1e-12
    )
    assert not trajectory.events


@pytest.mark.parametrize("mus", [0.2, 0.25])
def test_break_away_at_the_start(mus):
    """A ramp that leaves the capacity at t = 0: x'' = t + (mus - mu) g from the start."""
    scene = scene_from_dict(
        guide_scene(
            guide={"mu": 0.2, "mus": mus},
            forces={"load": along([1, 0], type="linear", offset=10 * mus, rate=1)},
        )
    )
    trajectory = simulate(scene, t_end=1, rtol=1e-12)
    t = trajectory.t
    # the instant of break-away is known to the rounding of forces over their rate, 1e-13 s and its effect below 1e-12
    np.testing.assert_allclose(
        trajectory["slider.x"], (10 * mus - 2) * t**2 / 2 + t**3 / 6, atol=1e-12
    )
    assert all(event.time < 1e-11 for event in trajectory.events)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("depth", [1e-2, 1e-3, 1e-5, 1e-7])
def test_short_rest_is_not_stepped_over(rtol, depth):
    """x'' = -cos t at mu g = 0.1 and a velocity that without friction at rest would dip to -depth for a moment.

    v = 1 - depth - sin t stops at arcsin(1 - depth) and leaves rest at pi/2, where the load exceeds the capacity again.
    """
    scene = scene_from_dict(
        guide_scene(
            {"velocity": [1 - depth, 0]},
            {"mu": 0.01},
            t_end=6,
            forces={
                "load": along(
                    [1, 0], type="sine", offset=0.1, amplitude=-1, frequency=1, phase="pi/2"
                )
            },
        )
    )
    trajectory = simulate(scene, rtol=rtol, output_step=6)
    assert trajectory.termination == "end"
    if depth < 30 * rtol:
        # The dip is smaller than the error of the velocity: a run with the rest and one without it are both right,
        # and their displacements differ by at most the dip's velocity times the 5 s that are left.
        without_rest = 6 * (1 - depth) + np.cos(6) - 1
        assert trajectory["slider.x"][-1] == pytest.approx(without_rest, abs=5 * 30 * rtol)
        return
    assert [event.kind for event in trajectory.events] == ["stick", "slip"]
    slack = 30 * rtol / np.sqrt(2 * depth)  # error of velocity over the deceleration there
    assert trajectory.events[0].time == pytest.approx(np.arcsin(1 - depth), abs=slack)
    assert trajectory.events[1].time == pytest.approx(np.pi / 2, abs=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-3])
def test_velocity_that_grazes_zero_goes_on(gap):
    """v = 1 + gap - sin t stays at or above zero: with gap 0 it touches, and goes on in the same direction."""
    scene = scene_from_dict(
        guide_scene(
            {"velocity": [1 + gap, 0]},
            {"mu": 0.01},
            t_end=4,
            forces={
                "load": along(
                    [1, 0], type="sine", offset=0.1, amplitude=-1, frequency=1, phase="pi/2"
                )
            },
        )
    )
    trajectory = simulate(scene, rtol=1e-10)
    expected = (1 + gap) * trajectory.t + np.cos(trajectory.t) - 1
    np.testing.assert_allclose(trajectory["slider.x"], expected, atol=1e-8)
    assert {event.kind for event in trajectory.events} <= {"stick", "slip"} and len(
        trajectory.events
    ) <= 2


def test_stop_for_good():
    """Free deceleration: x = v0^2/(2 mu g), stuck from v0/(mu g) on; both to rounding."""
    scene = scene_from_dict(guide_scene({"velocity": [1, 0]}, {"mu": 0.2, "mus": 0.3}))
    trajectory = simulate(scene, t_end=2, rtol=1e-10)
    (event,) = trajectory.events
    assert event.kind == "stick" and event.time == pytest.approx(0.5, abs=1e-14)
    assert trajectory["slider.x"][-1] == pytest.approx(0.25, abs=1e-14)
    assert event.jump("slider.ax") == pytest.approx(2, abs=1e-12)
    assert np.all(np.abs(trajectory["slider.vx"][trajectory.t > 0.5]) < 1e-15)


def test_two_sliders_stop_in_the_same_instant():
    """Alike and apart: two events at one time, and neither disturbs the other."""
    bodies = {name: {"mass": 1, "inertia": 1, "velocity": [1, 0]} for name in ("a", "b")}
    joints = {
        f"g{name}": {"type": "translational", "slider": name, "mu": 0.2, "mus": 0.3}
        for name in bodies
    }
    trajectory = simulate(
        scene_from_dict({"gravity": [0, -10], "bodies": bodies, "joints": joints}), t_end=1
    )
    assert [(event.kind, event.joint) for event in trajectory.events] == [
        ("stick", "ga"),
        ("stick", "gb"),
    ]
    assert trajectory.events[0].time == trajectory.events[1].time == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize(
    "changes", [{"F0": 40, "mu": 0.6, "mus": 0.6}, {"F0": 60, "mu": 0.7, "mus": 0.7}]
)
def test_painleve_ends_with_time_and_reason(changes):
    """Where a second motion comes in the run stops and says so, before the slip equation loses its solution: no number
    comes after. The bar turns at w0 from an angle whose sine is zero."""
    scene = load_scene("slider-bar-case-1", changes)
    with pytest.raises(NoMotion) as none:
        slider_bar_truth(scene, 8.0)
    bar = SliderBar.from_scene(scene)
    # m x'' + mu s N(x'') grows with x'' while  mu |B| < m,  B = (2/a) c sin th
    critical = np.arcsin(bar.mass * bar.contact.length / (2 * bar.c * bar.contact.mu)) / bar.rate
    assert none.value.time == pytest.approx(critical, abs=1e-9)
    event_driven = ReferenceEngine().simulate(
        scene, t_end=8, rtol=1e-10, stabilization="projection"
    )
    paper = ReferenceEngine().simulate(scene, t_end=8, dt=1e-3)
    for trajectory in (event_driven, paper):
        assert (
            trajectory.breakdown.kind == "several solutions"
            and trajectory.breakdown.guide == "guide"
        )
        assert np.all(np.isfinite(trajectory["slider.ax"]))
    assert event_driven.breakdown.time == pytest.approx(critical, abs=1e-8)
    assert critical <= paper.breakdown.time + 1e-12 <= critical + 1e-3


@pytest.mark.parametrize(("copies", "rtol"), [(2, 1e-6), (3, 1e-9), (2, 1e-12)])
def test_guides_on_one_line_act_as_one(copies, rtol):
    """Equal guides share their load equally: the same motion as of one, and each event as many times.

    1e-7 beside the tolerance: where they break away their event functions jump, so that the instant is known to 1e-6
    (`event_location.SETTLED`) of a step of 0.1 s, and no speed is above 1 m/s, no force changes by more than 10 N/s.
    """
    scene = load_scene("slider-bar-case-1")
    guide = scene.joints["guide"]
    several = scene.model_copy(
        update={"joints": {**scene.joints, **{f"guide-{i}": guide for i in range(1, copies)}}}
    )
    one, run = (simulate(which, rtol=rtol, output_step=0.5) for which in (scene, several))
    assert np.max(np.abs(run["slider.x"] - one["slider.x"])) < 1e3 * rtol + 1e-7
    assert [event.kind for event in run.events] == [
        event.kind for event in one.events for _ in range(copies)
    ]
    np.testing.assert_allclose(
        sum(run[f"{name}.friction"] for name in several.joints if name.startswith("guide")),
        one["guide.friction"],
        rtol=0,
        atol=1e5 * rtol + 1e-6,
    )
