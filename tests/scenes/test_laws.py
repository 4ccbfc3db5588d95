"""Laws of time against closed forms, scipy's spline, and their own derivatives."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial as Poly
from scipy.interpolate import CubicSpline

from stiction.engines.shared.law_expression import law_expression
from stiction.reference_impl.multibody.kinematics import law_at
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import SceneError, scene_from_dict
from stiction.scenes.laws import (
    MOVES,
    Constant,
    Cycloid,
    Linear,
    Polynomial,
    Sine,
    Sum,
    Table,
    Trapezoid,
    constant_from,
    evaluate_law,
    law_kinks,
    law_switches,
    law_terms,
    pieces,
    scaled_law,
    shifted_law,
    spline_slopes,
)

NUMBERS = st.floats(-10, 10)


@st.composite
def tables(draw, interpolation):
    gaps = draw(st.lists(st.floats(0.1, 2), min_size=1, max_size=8))
    times = np.cumsum([draw(NUMBERS), *gaps])
    values = draw(st.lists(NUMBERS, min_size=len(times), max_size=len(times)))
    return Table(times=times.tolist(), values=values, interpolation=interpolation)


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


@st.composite
def moves(draw):
    common = dict(
        offset=draw(NUMBERS),
        distance=draw(NUMBERS),
        start=draw(NUMBERS),
        duration=draw(st.floats(0.1, 5)),
    )
    kind = draw(st.sampled_from(["trapezoid", "cycloid", "polynomial"]))
    if kind == "trapezoid":
        ramp = draw(st.floats(0.02, 0.5)) * common["duration"]
        return Trapezoid(type=kind, ramp=ramp, **common)
    if kind == "cycloid":
        return Cycloid(type=kind, **common)
    if draw(st.booleans()):
        common["coefficients"] = draw(st.lists(st.floats(-3, 3), min_size=1, max_size=8))
    return Polynomial(type=kind, **common)


SUMS = st.builds(Sum, type=st.just("sum"), terms=st.lists(LAWS | moves(), min_size=1, max_size=4))


@given(LAWS | moves() | SUMS, st.floats(-15, 40))
def test_derivatives_are_those_of_the_value(law, t):
    """Central differences, away from the knots of a table."""
    h = 1e-4
    knots = {time for term in law_terms(law) for time in getattr(term, "times", ())}
    knots |= {p.begin for term in law_terms(law) if isinstance(term, MOVES) for p in pieces(term)}
    assume(all(abs(t - knot) >= 2 * h for knot in knots))
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
    law = Table(times=(0, 1, 3), values=(0, 2, 0))
    assert [evaluate_law(law, t)[1] for t in (-1, 0, 0.5, 1, 2, 3, 4)] == [0, 2, 2, -1, -1, 0, 0]


def test_closed_forms():
    assert evaluate_law(Linear(offset=1, rate=2), 3) == (7, 2, 0)
    sine = Sine(offset=1, amplitude=2, frequency=3, phase=np.pi / 2)
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
    assert law_kinks(Sine(amplitude=1, frequency=1), 10) == ()
    assert law_kinks(Constant(value=1), 10) == law_kinks(Linear(rate=1), 10) == ()


@given(moves())
def test_moves_are_continuous_up_to_their_rate(law):
    """A drive can follow them: neither the value nor the rate jumps between pieces.

    The limits from the left are those of a time that differs by 1e-9 of the duration, by which a value of size 200 and
    rate 10^4 changes by 1e-5.
    """
    for time in (law.start, law.start + law.duration):
        before = evaluate_law(law, time - 1e-9 * law.duration)
        after = evaluate_law(law, time + 1e-9 * law.duration)
        scale = 1.0 + abs(law.offset) + abs(law.distance)
        assert before[0] == pytest.approx(after[0], abs=1e-7 * scale)
        assert before[1] == pytest.approx(after[1], abs=1e-6 * scale / law.duration)


@given(moves(), st.floats(0, 1))
def test_moves_are_their_formulas(law, u):
    value, rate, second = evaluate_law(law, law.start + u * law.duration)
    # u is rounded by the times, which are below 20 s; slopes are below 100 of the distance
    assume(law.start + u * law.duration < law.start + law.duration)
    tolerance = dict(rel=0, abs=1e-10 * (1 + abs(law.distance) + abs(law.offset)) / law.duration**2)
    T = law.duration
    if isinstance(law, Cycloid):
        phase = 2 * np.pi * u
        s = u - np.sin(phase) / (2 * np.pi), 1 - np.cos(phase), 2 * np.pi * np.sin(phase)
    elif isinstance(law, Polynomial):
        s = [
            Poly(law.coefficients).deriv(k)(u) if k else Poly(law.coefficients)(u)
            for k in (0, 1, 2)
        ]
    else:
        r = law.ramp / T
        assume(min(abs(u - r), abs(u - 1 + r)) > 1e-9)
        top = 1 / (1 - r)  # area of the trapezoid is 1
        if u < r:
            s = top * u**2 / (2 * r), top * u / r, top / r
        elif u < 1 - r:
            s = top * (u - r / 2), top, 0.0
        else:
            s = 1 - top * (1 - u) ** 2 / (2 * r), top * (1 - u) / r, -top / r
    assert value == pytest.approx(law.offset + law.distance * s[0], **tolerance)
    assert rate == pytest.approx(law.distance * s[1] / T, **tolerance)
    assert second == pytest.approx(law.distance * s[2] / T**2, **tolerance)


@given(moves(), st.floats(1e-6, 50))
def test_a_move_is_at_rest_before_and_after(law, gap):
    assume(not isinstance(law, Polynomial) or len(law.coefficients) == 6)
    assume(not isinstance(law, Polynomial) or law.coefficients[3] == 10.0)
    assert evaluate_law(law, law.start - gap) == (law.offset, 0.0, 0.0)
    value, rate, second = evaluate_law(law, law.start + law.duration + gap)
    assert value == pytest.approx(law.offset + law.distance, abs=1e-13)
    assert (rate, second) == (0.0, 0.0)
    assert constant_from(law) == law.start + law.duration


def test_a_step_of_a_table():
    law = Table(times=(0, 1, 1, 2, 2), values=(0, 1, 3, 4, -1))
    assert evaluate_law(law, np.nextafter(1, 0))[0] == pytest.approx(1)
    assert [evaluate_law(law, t) for t in (1, 1.5, 2, 5)] == [
        (3, 1, 0),
        (3.5, 1, 0),
        (-1, 0, 0),
        (-1, 0, 0),
    ]
    assert law_switches(law, 10) == (1, 2) and law_kinks(law, 10) == (1, 2)
    assert constant_from(law) == 2


@pytest.mark.parametrize(
    ("keys", "place"),
    [
        (dict(times=(0, 1, 1, 1), values=(0, 1, 2, 3)), "times.3"),
        (dict(times=(0, 1, 1), values=(0, 1, 2), interpolation="cubic"), "times.2"),
        (dict(times=(0, 1), values=(0, 1), ends="clamped"), "ends"),
    ],
)
def test_tables_that_are_no_function(keys, place):
    with pytest.raises(SceneError) as error:
        Table(**keys)
    assert [problem.key for problem in error.value.problems] == [place]


def test_a_ramp_is_at_most_half_of_the_move():
    with pytest.raises(SceneError) as error:
        Trapezoid(distance=1, duration=1, ramp=0.51)
    assert [problem.key for problem in error.value.problems] == ["ramp"]


@given(tables("cubic"))
def test_a_clamped_table_begins_and_ends_at_rest(natural):
    law = natural.model_copy(update={"ends": "clamped"})
    times = np.array(law.times)
    spline = CubicSpline(times, law.values, bc_type="clamped")
    scale = 1 + np.abs(law.values).max() / np.diff(times).min() ** 2
    for t in np.linspace(times[0], times[-1], 21)[1:-1]:
        expected = [spline(t), spline(t, 1), spline(t, 2)]
        np.testing.assert_allclose(evaluate_law(law, t), expected, atol=1e-11 * scale)
    for t, value in ((times[0] - 1, law.values[0]), (times[-1] + 1, law.values[-1])):
        np.testing.assert_allclose(evaluate_law(law, t), [value, 0, 0], atol=1e-11 * scale)
    assert law_switches(law, 1e3) == tuple(t for t in (times[0], times[-1]) if 0 < t)
    assert constant_from(law) == times[-1]


@given(LAWS | moves() | SUMS, st.floats(-5, 5), st.floats(-10, 10), st.floats(-3, 3))
def test_a_law_is_shifted_and_scaled(law, shift, t, factor):
    """Rounding of the shifted times aside, away from the instants at which a derivative jumps."""
    times = {0.0}
    for term in law_terms(law):
        times.update(getattr(term, "times", ()))
        if isinstance(term, MOVES):
            times.update(piece.begin for piece in pieces(term))
    assume(all(abs(t + shift - time) > 1e-6 for time in times))
    expected = np.array(evaluate_law(law, t + shift))
    # values up to 10^5 and rates up to 10^5 of them
    scale = 1e5 * (1 + np.abs(expected).max())
    np.testing.assert_allclose(
        evaluate_law(shifted_law(law, shift), t), expected, atol=1e-14 * scale
    )
    scaled = evaluate_law(scaled_law(law, factor), t + shift)
    np.testing.assert_allclose(scaled, factor * expected, atol=1e-14 * scale * (1 + abs(factor)))


@given(SUMS, st.floats(-10, 30))
def test_a_sum_is_the_sum_of_its_terms(law, t):
    expected = np.sum([evaluate_law(term, t) for term in law.terms], axis=0)
    np.testing.assert_allclose(evaluate_law(law, t), expected, rtol=1e-14, atol=1e-9)
    assert set(law_kinks(law, 25)) == {s for term in law.terms for s in law_kinks(term, 25)}


@settings(max_examples=30, deadline=None)
@given(st.lists(LAWS | moves() | SUMS, min_size=1, max_size=4), st.floats(0, 30))
def test_the_compiled_laws_are_the_same(laws, t):
    scene = scene_from_dict(
        {
            "bodies": {"block": {"mass": 1, "inertia": 1}},
            "forces": {
                f"load{i}": {
                    "type": "torque",
                    "body": "block",
                    "law": law.model_dump(mode="json"),
                }
                for i, law in enumerate(laws)
            },
        }
    )
    arrays = Mechanism(scene).arrays
    for i, law in enumerate(laws):
        expected = np.array(evaluate_law(law, t))
        scale = 1e5 * (1 + np.abs(expected).max())
        np.testing.assert_allclose(law_at(arrays, i, t), expected, atol=1e-14 * scale)


@given(
    moves() | st.builds(Sum, type=st.just("sum"), terms=st.lists(moves(), max_size=3, min_size=1))
)
def test_laws_in_scripts_are_the_same(law):
    """The expressions of exported models, between and at the instants at which pieces begin."""
    begins = [p.begin for term in law_terms(law) for p in pieces(term) if np.isfinite(p.begin)]
    for t in [-20.0, *begins, *np.linspace(-11.0, 16.0, 28)]:
        expected = evaluate_law(law, t)
        for derivative in (0, 1):
            found = eval(law_expression(law, derivative), {"math": math, "t": t})
            assert found == pytest.approx(expected[derivative], rel=1e-12, abs=1e-10)
