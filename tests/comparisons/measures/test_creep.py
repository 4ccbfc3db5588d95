"""Slip reduced to numbers: slopes that are known, with noise, outliers and periods; rounding; letting go."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.measures.creep import AFTER, LANDING, LET_GO, slip_of

T = np.arange(0.0, 1.2001, 4e-3)


def reduced(displacement, velocity=None, **options):
    return slip_of(T, displacement, np.zeros_like(T) if velocity is None else velocity, **options)


@given(st.floats(-1e-3, 1e-3), st.floats(0.0, 1e-4), st.integers(0, 100))
def test_a_slope_is_found_within_its_uncertainty(slope, noise, seed):
    """White noise of size s on n samples over T leaves the slope unsure by about s sqrt(12/n)/T, here 0.21 s: five of these at most."""
    wobble = noise * np.random.default_rng(seed).normal(size=len(T))
    found = reduced(0.3 + slope * T + wobble).creep
    assert abs(found.value - slope) <= 5 * 0.21 * noise + 1e-12
    assert found.uncertainty <= 5 * 0.21 * noise + 1e-12


def test_outliers_and_the_landing_change_nothing():
    """A tenth of the samples thrown off by a millimetre; the load lands by a centimetre within the first 0.1 s."""
    displacement = 1e-5 * T + 1e-2 * (T > 0.05)
    displacement[30::10] += 1e-3
    found = reduced(displacement)
    assert found.creep.value == pytest.approx(1e-5, rel=1e-9)
    assert found.landing == pytest.approx(1e-2 + 1e-5 * LANDING, rel=1e-9)


@given(st.floats(0.0, 2 * np.pi), st.sampled_from([0.2, 0.5]))
def test_over_whole_periods_a_vibration_is_no_creep(phase, period):
    """Its mean over a period is 0 but for the trapezoids' error, (2 pi h/period)^2/12 of the amplitude; without the period a slope is left."""
    wave = 1e-3 * np.sin(2 * np.pi * T / period + phase)
    found = reduced(2e-6 * T + wave, period=period).creep
    assert found.value == pytest.approx(2e-6, rel=0.05)


def test_what_moves_by_less_than_rounding_does_not_creep():
    still = reduced(1e-13 * T, rounding=2e-13).creep
    assert still.value == 0.0 and still.uncertainty == pytest.approx(2e-13 / 1.1)
    assert reduced(1e-11 * T, rounding=2e-13).creep.value == pytest.approx(1e-11)
    assert reduced(0 * T).creep == reduced(0 * T + 0.3).creep


@pytest.mark.parametrize("acceleration", [1.0, -0.2])
def test_the_instant_and_the_acceleration_of_letting_go(acceleration):
    """From 0.5 s on v = a t, along the load or against it."""
    velocity = acceleration * np.maximum(T - 0.5, 0.0)
    found = reduced(np.cumsum(velocity), velocity)
    assert found.let_go == pytest.approx(0.5 + LET_GO / abs(acceleration), abs=1e-9)
    assert found.acceleration == pytest.approx(abs(acceleration), rel=1e-6)


def test_a_slider_that_never_lets_go_and_one_that_had_never_been_held():
    assert reduced(0 * T).let_go is reduced(0 * T).acceleration is None
    assert reduced(T, 1.0 + 0 * T).let_go == pytest.approx(LANDING)
    late = reduced(0 * T, 1.0 * (T > 1.2 - AFTER / 2))
    assert late.let_go > 1.1 and late.acceleration is None


@pytest.mark.parametrize("last", [0.05, 0.1, 0.2, 0.3, 0.5, 0.9])
def test_a_slider_that_lets_go_late_is_neither_at_rest_nor_creeping(last):
    """It falls freely in the last part of the window: its median slope is 0, its mean speed is not."""
    since = np.maximum(T - T[-1] + last * 1.1, 0.0)
    found = reduced(since**2 / 2, since)
    assert found.lets_go and abs(found.creep.value) > 1e-6
    steady = reduced(2e-3 * T, 2e-3 + 0 * T)
    assert not steady.lets_go and steady.creep.value == pytest.approx(2e-3)


def test_a_jump_is_no_rest():
    found = reduced(5e-3 * (T > 0.7)).creep
    assert abs(found.value) + found.uncertainty > 1e-3
