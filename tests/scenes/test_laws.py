"""Laws of time against closed forms, scipy's spline, and their own derivatives."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from stiction.scenes.laws import (
    Constant,
    Linear,
    Sine,
    Table,
    evaluate_law,
    law_kinks,
    spline_slopes,
)

NUMBERS = st.floats(-10, 10)


@st.composite
def tables(draw, interpolation):
    gaps = draw(st.lists(st.floats(0.1, 2), min_size=1, max_size=8))
    times = np.cumsum([draw(NUMBERS), *gaps])
    values = draw(st.lists(NUMBERS, min_size=len(times), max_size=len(times)))
    return Table(type="table", times=times.tolist(), values=values, interpolation=interpolation)


LAWS = st.one_of(
    st.builds(Constant, type=st.just("constant"), value=NUMBERS),
    st.builds(Linear, type=st.just("linear"), offset=NUMBERS, rate=NUMBERS),
    st.builds(
        Sine,
        type=st.just("sine"),
        offset=NUMBERS,
        amplitude=NUMBERS,
        frequency=NUMBERS,
        phase=NUMBERS,
    ),
    tables("linear"),
    tables("cubic"),
)


@given(LAWS, st.floats(-15, 40))
def test_derivatives_are_those_of_the_value(law, t):
    """Central differences, away from the knots of a table."""
    h = 1e-4
    assume(all(abs(t - knot) >= 2 * h for knot in getattr(law, "times", ())))
    (before, rate_before, _), (_, rate, second), (after, rate_after, _) = (
        evaluate_law(law, s) for s in (t - h, t, t + h)
    )
    # h^2/6 times the third derivative (10^4 for the sine, below 10^5 for a spline over gaps of 0.1), and
    # rounding of values up to 10^5 (a tangent continued) divided by h
    assert rate == pytest.approx((after - before) / (2 * h), abs=5e-4, rel=1e-6)
    assert second == pytest.approx((rate_after - rate_before) / (2 * h), abs=5e-3, rel=1e-5)


@given(
    st.lists(st.tuples(st.floats(1e-3, 10.0), st.floats(-100.0, 100.0)), min_size=2, max_size=12)
)
def test_the_slope_of_a_spline_is_continuous_at_its_knots(steps):
    """The second derivatives M of a natural spline, by de Boor's system.

    Equal slopes on both sides of a knot are h_l M_l + 2 (h_l + h_r) M + h_r M_r = 6 (s_r - s_l), with the lengths h of
    the two intervals and the slopes s of their chords; at both ends M = 0.
    """
    times, values = np.cumsum([step for step, _ in steps]), np.array([value for _, value in steps])
    h, size = np.diff(times), len(times)
    system, right = np.eye(size), np.zeros(size)
    for i in range(1, size - 1):
        system[i, i - 1 : i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
        right[i] = 6 * ((values[i + 1] - values[i]) / h[i] - (values[i] - values[i - 1]) / h[i - 1])
    expected = np.linalg.solve(system, right)
    scale = max(1.0, np.abs(values).max() / h.min() ** 2)
    found = spline_slopes(tuple(times.tolist()), tuple(values.tolist()))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale)
    assert found[0] == found[-1] == 0.0


@given(tables("cubic"))
def test_cubic_table_is_scipys_natural_spline(law):
    times = np.array(law.times)
    spline = CubicSpline(times, law.values, bc_type="natural")
    # second differences round as the values over h^2, also where the second derivative itself is zero
    scale = max(
        1.0, np.abs(spline(times, 2)).max(), np.abs(law.values).max() / np.diff(times).min() ** 2
    )
    np.testing.assert_allclose(
        spline_slopes(law.times, law.values), spline(times, 2), atol=1e-12 * scale
    )
    for t in np.linspace(times[0], times[-1], 41)[:-1]:
        # two algorithms for the same system, whose condition is below 10
        np.testing.assert_allclose(
            evaluate_law(law, t), [spline(t), spline(t, 1), spline(t, 2)], atol=1e-11 * scale
        )


@given(tables("cubic"), st.floats(0, 5))
def test_cubic_table_continues_its_end_tangents(law, beyond):
    spline = CubicSpline(law.times, law.values, bc_type="natural")
    for end, sign in ((law.times[0], -1), (law.times[-1], 1)):
        slope = float(spline(end, 1))
        value, rate, second = evaluate_law(law, end + sign * beyond)
        scale = 1 + abs(slope)
        assert value == pytest.approx(float(spline(end)) + sign * slope * beyond, abs=1e-10 * scale)
        assert rate == pytest.approx(slope, abs=1e-10 * scale) and abs(second) < 1e-9 * scale


@given(tables("linear"), st.floats(-20, 40))
def test_linear_table_is_numpys_interpolation(law, t):
    value, _, second = evaluate_law(law, t)
    assert value == pytest.approx(np.interp(t, law.times, law.values), abs=1e-12) and second == 0


def test_linear_table_takes_its_rate_from_the_right():
    law = Table(type="table", times=(0, 1, 3), values=(0, 2, 0))
    assert [evaluate_law(law, t)[1] for t in (-1, 0, 0.5, 1, 2, 3, 4)] == [0, 2, 2, -1, -1, 0, 0]


def test_closed_forms():
    assert evaluate_law(Linear(type="linear", offset=1, rate=2), 3) == (7, 2, 0)
    sine = Sine(type="sine", offset=1, amplitude=2, frequency=3, phase=np.pi / 2)
    np.testing.assert_allclose(evaluate_law(sine, 0), [3, 0, -18], atol=1e-14)


def test_kinks_are_the_inner_knots_of_tables():
    for interpolation in ("linear", "cubic"):
        law = Table(
            type="table",
            times=(-1, 0, 1, 2.5, 4),
            values=(0, 1, 0, 1, 0),
            interpolation=interpolation,
        )
        assert law_kinks(law, 4) == (1, 2.5)
        assert law_kinks(law, 5) == (1, 2.5, 4)
    assert law_kinks(Sine(type="sine", amplitude=1, frequency=1), 10) == ()
    assert (
        law_kinks(Constant(type="constant", value=1), 10)
        == law_kinks(Linear(type="linear", rate=1), 10)
        == ()
    )
