"""Arithmetic means what it means in Python's floats, and nothing else is understood."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.scenes.expressions import FUNCTIONS, evaluate

NAMES = {"L": 2.0, "w0": math.pi / 4, "m_1": 1.5}
ATOMS = st.one_of(st.floats(0, allow_infinity=False).map(repr), st.sampled_from([*NAMES, "pi"]))
SEVERAL = {"atan2", "min", "max"}
"""Functions of two arguments."""
EXPRESSIONS = st.recursive(
    ATOMS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/^"), inner).map(
            lambda t: f"({t[0]}) {t[1]} ({t[2]})"
        ),
        st.tuples(st.sampled_from("+-"), inner).map(lambda t: f"{t[0]}({t[1]})"),
        st.tuples(st.sampled_from(sorted(set(FUNCTIONS) - SEVERAL)), inner).map(
            lambda t: f"{t[0]}({t[1]})"
        ),
        st.tuples(st.sampled_from(sorted(SEVERAL)), inner, inner).map(
            lambda t: f"{t[0]}({t[1]}, {t[2]})"
        ),
    ),
    max_leaves=8,
)


@given(EXPRESSIONS.filter(lambda text: len(text) <= 400))
def test_value_is_pythons(text):
    """Where Python finds no finite real number, neither do we."""
    try:
        expected = eval(text.replace("^", "**"), {**FUNCTIONS, "pi": math.pi, **NAMES})
        expected = expected if isinstance(expected, float) and math.isfinite(expected) else None
    except (ValueError, TypeError, ZeroDivisionError, OverflowError):
        expected = None
    if expected is None:
        with pytest.raises(ValueError):
            evaluate(text, NAMES)
    else:
        assert evaluate(text, NAMES) == expected


@given(st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**300), 10**300))
def test_numbers_are_themselves_also_as_text(number):
    assert evaluate(number, {}) == float(number)
    assert evaluate(str(number), {}) == float(number)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*L^2/12", 2 / 3),
        ("-2^2", -4.0),
        ("2^3^2", 512.0),
        ("2**-1", 0.5),
        (" pi / 4 ", math.pi / 4),
        ("deg(180)", math.pi),
        ("sqrt(2)^2", math.sqrt(2) ** 2),
        ("atan(1)*4", math.pi),
        ("atan2(-1, -1)", -0.75 * math.pi),
        ("asin(L/2) + acos(-L/2)", 1.5 * math.pi),
        ("max(1, L, -3) - min(L, 0.5, 7)", 1.5),
        ("exp(abs(-1))", math.e),
        ("1e3", 1000.0),
        ("--1", 1.0),
        ("-" * 499 + "1", -1.0),
    ],
)
def test_notation(text, value):
    assert evaluate(text, NAMES) == value


@given(
    st.text(max_size=30) | st.text("0123456789.eE+-*/^()[]{} ,:=<>'\"#\\\0L_ifnotadb", max_size=30)
)
def test_any_text_is_a_number_or_a_value_error(text):
    try:
        assert math.isfinite(evaluate(text, NAMES))
    except ValueError as error:
        assert str(error)


@pytest.mark.parametrize(
    "text",
    [
        "x",
        "sin",
        "sin()",
        "sin(1, 2)",
        "sin(x=1)",
        "cosh(1)",
        "atan2(1)",
        "min(1)",
        "acos(2)",
        "max(*[1, 2])",
        "L.real",
        "[1][0]",
        "1 if 1 else 2",
        "1 < 2",
        "lambda: 1",
        "(1, 2)",
        "'1'",
        "True",
        "None",
        "1j",
        "L := 2",
        "f'{L}'",
        "2 // 1",
        "2 % 1",
        "~1",
        "",
        "1;2",
        "()" * 100,
        "(" * 300,
    ],
)
def test_what_is_not_arithmetic(text):
    with pytest.raises(ValueError):
        evaluate(text, NAMES)


@pytest.mark.parametrize("value", [True, None, [1], (1, 2), b"1", 1j, object()])
def test_what_is_not_a_number(value):
    with pytest.raises(ValueError, match="expected a number"):
        evaluate(value, {})
