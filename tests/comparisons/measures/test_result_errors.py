"""Causes of errors are seen where they explain them, and nowhere else."""

import numpy as np
import pytest

from stiction.comparisons.measures.result_errors import hint

T = np.linspace(0, 10, 1001)
TRUE = np.sin(T) + 0.3 * np.sin(2.7 * T)


def cause(found, unit="m"):
    return hint(found, TRUE, found - TRUE, unit)


@pytest.mark.parametrize(
    ("found", "unit", "word"),
    [
        (1e3 * TRUE, "m", "mm"),
        (1e-3 * TRUE, "m", "thousandth"),
        (180 / np.pi * TRUE, "rad", "deg"),
        (180 / np.pi * TRUE, "rad/s", "deg"),
        (-TRUE, "N", "sign"),
        (TRUE + 0.25, "m", "constant"),
    ],
)
def test_causes_of_input(found, unit, word):
    assert word in cause(found, unit).cause and cause(found, unit).is_input
    noisy = found * (1 + 1e-3 * np.sin(97 * T))
    assert word in cause(noisy, unit).cause


@pytest.mark.parametrize(
    ("found", "word"),
    [(np.append(TRUE[0], TRUE[:-1]), "late"), (np.append(TRUE[1:], TRUE[-1]), "early")],
)
def test_a_sample_off(found, word):
    assert word in cause(found).cause and not cause(found).is_input


@pytest.mark.parametrize(
    "found",
    [
        TRUE,
        TRUE + 1e-9,
        TRUE + 0.1 * np.sin(3 * T),
        1.1 * TRUE,
        np.zeros_like(T),
        TRUE + 0.05 * T,
        np.interp(T - 0.003, T, TRUE),
        1e6 * np.sin(50 * T),
        np.exp(2 * T),
    ],
)
def test_other_errors_have_no_cause(found):
    assert not cause(found).cause
