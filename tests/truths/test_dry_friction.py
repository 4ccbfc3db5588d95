"""Closed forms of friction with constant bounds: their own equations, by other means than they were found."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stiction.scenes import load_scene, vary
from stiction.truths import (
    NotThisMechanism,
    four_bar_truth,
    incline_truth,
    oscillator_truth,
    pendulum_truth,
    slider_crank_truth,
)
from stiction.truths.closed_form.dry_friction import (
    MassesInSeries,
    RampedStart,
    oscillator_turning_points,
    pendulum_turning_angles,
)


@pytest.mark.parametrize(("bound", "start"), [(0.3, 1.2), (0.3, -2.5), (1.5, 2.6), (0.05, 0.3)])
def test_pendulum_turns_where_its_equation_does(bound, start):
    """m g l = 4, I = 0.5: I psi'' = -4 sin psi + tau side, integrated from one turning angle to the next."""
    angles = pendulum_turning_angles(4.0, bound, 1.2 * bound, start)
    assert abs(np.sin(angles[-1])) <= 1.2 * bound / 4.0 and len(angles) > 2
    for begin, end in zip(angles, angles[1:]):
        side = np.sign(end - begin)

        def stops(t, y):
            return y[1] if t > 1e-3 else side

        stops.terminal = True
        swing = solve_ivp(
            lambda t, y, side=side: [y[1], (-4 * np.sin(y[0]) - bound * side) / 0.5],
            (0, 50),
            [begin, 0.0],
            events=stops,
            rtol=1e-12,
            atol=1e-13,
        )
        assert swing.y_events[0][0][0] == pytest.approx(end, abs=1e-10)


def test_a_pendulum_that_is_held_does_not_turn():
    assert pendulum_turning_angles(4.0, 1.0, 2.0, 0.5) == [0.5]


def test_oscillator_turning_points_are_those_of_its_phases():
    places = oscillator_turning_points(10.0, 1.0, 1.5, -1.0)
    np.testing.assert_allclose(places, [-1.0, 0.8, -0.6, 0.4, -0.2, 0.0], atol=1e-15)


def test_ramped_start():
    """Acceleration is the second derivative of the way, which begins at the break-away."""
    start = RampedStart(2.0, -1.0, 0.5, 1.0, 4.0)
    assert start.break_away == 10.0
    t, h = np.linspace(10.5, 20, 7), 1e-3
    second = (
        start.displacement(t + h) - 2 * start.displacement(t) + start.displacement(t - h)
    ) / h**2
    np.testing.assert_allclose(second, start.acceleration(t), rtol=1e-6)
    assert not start.displacement(np.array([0.0, 9.9])).any()
    assert start.acceleration(np.array([10.0 + 1e-9]))[0] == pytest.approx((4 - 1) / 2)
    assert RampedStart(1, 3, 0, 1, 3).break_away == np.inf
    with pytest.raises(NotThisMechanism):
        RampedStart(1.0, 5.0, -1.0, 1.0, 4.0).acceleration(np.array([1.0]))


def test_masses_in_series_balance():
    """At the second break-away the upper guide carries exactly its bound."""
    series = MassesInSeries(3.0, 1.0, 2.0, 2.5, 2.0)
    times = series.break_aways()
    push = series.rate * times["upper"]
    acceleration = (push - series.lower) / 4.0
    assert push - series.upper_mass * acceleration == pytest.approx(series.upper)
    assert times["lower"] == 1.0 and MassesInSeries(3, 1, 5, 2, 2).break_aways()["lower"] == np.inf


def test_slider_crank_power():
    """The motor's power is the change of energy and the heat of pins: friction times the relative rate, and damping."""
    dry, smooth = load_scene("slider-crank-dry-pins"), load_scene("slider-crank")
    truth, other = slider_crank_truth(dry), slider_crank_truth(smooth)
    t, w = np.linspace(0.01, 3.99, 400), dry.parameters["w0"]
    columns = truth(t)
    heat = sum(
        -columns[f"{name}.friction"] * columns[f"{name}.slip_velocity"]
        + pin.damping * columns[f"{name}.slip_velocity"] ** 2
        for name, pin in dry.pins.items()
    )
    assert np.min(heat) > 0
    np.testing.assert_allclose(
        columns["motor.effort"] - other(t)["motor.effort"], heat / w, rtol=1e-9
    )


@pytest.mark.parametrize(
    ("name", "truth", "changes"),
    [
        ("block-on-incline", incline_truth, {"guide.damping": 1.0}),
        ("coulomb-oscillator", oscillator_truth, {"guide.damping": 1.0}),
        ("slider-crank", slider_crank_truth, {"guide.friction": 1.0}),
        ("four-bar", four_bar_truth, {"foot-0.friction": 1.0}),
        ("four-bar", four_bar_truth, {"left-1.damping": 1.0}),
    ],
)
def test_truths_refuse_what_they_do_not_contain(name, truth, changes):
    """Never the truth of a scene without the effect."""
    with pytest.raises(NotThisMechanism, match=r"friction|damping"):
        truth(vary(load_scene(name), changes))
    assert pendulum_truth(load_scene("pendulum"))
