"""Creep that others published, of a model that is rebuilt from its listing."""

import math
from decimal import Decimal

import pytest

from stiction.comparisons.measures.published_creep import (
    published_creep,
    published_joint_creep,
)

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


def test_creep_of_a_joint_is_that_of_the_soft_constraint():
    """The published 0.21 rad/s by its inertia; the law, v = torque/I (1 - d)/(d b), predicts the others from it."""
    table = published_joint_creep().set_index("case")
    first = table.loc["MJWarp, 30 % of the bound"]
    assert first["matched"] and first["joint_creep_here"] == pytest.approx(0.21, abs=0.005)
    inertia = 0.3 / 0.21 * 0.1 / 0.9 * 0.95 * 0.02 / 2
    by_law = {
        "default solreffriction, 90 % of the bound": 0.9 / inertia * 0.1 / 0.9 * 0.95 * 0.02 / 2,
        "stiff solreffriction, 90 % of the bound": 0.9 / inertia * 0.1 / 0.9 * 0.95 * 0.004 / 2,
    }
    for case, speed in by_law.items():
        assert table.loc[case, "joint_creep_here"] == pytest.approx(speed, rel=1e-3), case
        assert not table.loc[case, "matched"]
    # above the bound it is accelerated: I omega = (torque - friction) t
    spins = table.loc["MJWarp, 300 % of the bound", "joint_creep_here"]
    assert spins == pytest.approx((3.0 - 1.0) / inertia * 2.0, rel=1e-3)
    moves = table["joint_creep_here"].abs() > 1e-9
    assert (moves == table["moves"]).all() and (table.loc[~moves, "difference"] != "").all()
