"""Creep that others published, of a model that is rebuilt from its listing."""

import math
from decimal import Decimal

import pytest

from stiction.comparisons.measures.published_creep import published_creep

pytest.importorskip("mujoco")


def last_digit(published):
    """One unit of the last digit of a printed number that is not 0: of 1500 it is 100, of 1.4 it is 0.1."""
    return float(Decimal(1).scaleb(int(Decimal(repr(published)).normalize().as_tuple().exponent)))


@pytest.fixture(scope="module")
def table():
    return published_creep().set_index("case")


def test_creep_and_load_are_those_published(table):
    """To one unit of the last printed digit, or to what rocks, if that is more."""
    published = table[table["published_creep"].notna()]
    assert len(published) == 5
    for case, row in published.iterrows():
        assert row["creep_um"] == pytest.approx(
            row["published_creep"],
            abs=max(last_digit(row["published_creep"]), row["creep_um_uncertainty"]),
        ), case
        if row["published_load"] > 0:
            assert row["load_N"] == pytest.approx(
                row["published_load"], abs=last_digit(row["published_load"])
            ), case
    assert table["margin"].between(20 - 1, 95 + 1).all()  # "20-95 times", in its digits


def test_creep_falls_with_the_inverse_of_impratio(table):
    """Published as "linearly". R = R_n/impratio is exact; what is left is what rocks, here of the two ends of two decades."""
    first, last = (table.loc[f"elliptic, impratio {ratio}"] for ratio in (1, 100))
    exponent = math.log(last["creep_um"] / first["creep_um"]) / math.log(100)
    rocks = sum(row["creep_um_uncertainty"] / row["creep_um"] for row in (first, last)) / math.log(
        100
    )
    assert exponent == pytest.approx(-1.0, abs=rocks)


def test_noslip_makes_it_110_times_less(table):
    """The factor's last digit that is not 0 is its tens."""
    plain, swept = (
        table.loc["elliptic, impratio 10", "creep_um"],
        table.loc["elliptic, impratio 10, noslip_iterations 10", "creep_um"],
    )
    assert plain / swept == pytest.approx(110, abs=last_digit(110))


@pytest.mark.parametrize(
    ("printed", "unit"), [(1500, 100), (154.99, 0.01), (1.4, 0.1), (12, 1), (50, 10)]
)
def test_last_digit(printed, unit):
    assert last_digit(printed) == pytest.approx(unit, rel=1e-12)
