"""Laws of growth are found with intervals that hold, and nothing is read from too short a run."""

import numpy as np
import pytest

from stiction.comparisons.bench.campaign import CAMPAIGNS
from stiction.comparisons.measures.drift import decay_error
from stiction.comparisons.measures.drift_growth import (
    BOUNDED,
    DECAYS,
    GROWS,
    INCONCLUSIVE,
    ROUNDED,
    growth,
)
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, vary

T = np.linspace(0.0, 2400.0, 48_001)
WAVE = 2 + np.sin(2 * np.pi * T / 8)


@pytest.mark.parametrize(
    "power, verdict", [(0.0, BOUNDED), (0.1, BOUNDED), (1.0, GROWS), (1.5, GROWS), (2.0, GROWS)]
)
def test_powers_of_a_periodic_residual(power, verdict):
    found = growth(T, 1e-9 * WAVE * T**power, 8.0)
    assert (
        found.verdict == verdict and abs(found.exponent - power) <= found.uncertainty + 1e-3 < 0.1
    )


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("integrated, exponent", [(1, 0.5), (2, 1.5)])
def test_random_walks_grow(integrated, exponent, seed):
    """Independent errors in the residual, or its rate, are not bounded; exponents scatter beyond their intervals."""
    walk = np.random.default_rng(seed).normal(size=len(T))
    for _ in range(integrated):
        walk = np.cumsum(walk)
    found = growth(T, np.abs(walk), 8.0)
    assert found.verdict != BOUNDED and abs(found.exponent - exponent) < 0.5


@pytest.mark.parametrize("octaves", [4, 5, 8])
def test_the_interval_of_an_exponent_holds_for_independent_octaves(octaves):
    """In 95 %, whatever the scatter; in three of four for a rate's random walk, whose octaves are not independent."""
    random, t = (
        np.random.default_rng(octaves),
        np.repeat(2.0 ** np.arange(octaves), 2) * np.tile([0.75, 1.0], octaves),
    )
    scatter = np.repeat(random.normal(size=(2000, octaves)), 2, axis=1)
    found = [growth(t, t**1.5 * np.exp(0.3 * one), 0.5) for one in scatter]
    held = np.mean([abs(one.exponent - 1.5) <= one.uncertainty for one in found])
    assert held == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 2000))
    walks = [np.abs(np.cumsum(np.cumsum(random.normal(size=4800)))) for _ in range(200)]
    laws = [growth(np.linspace(0.05, 240.0, 4800), walk, 4.0) for walk in walks]
    assert 0.6 < np.mean([abs(law.exponent - 1.5) <= law.uncertainty for law in laws]) < 0.9


@pytest.mark.parametrize("power", [-0.5, -1.0, -2.0])
@pytest.mark.parametrize("end", [24.0, 240.0, 2400.0])
def test_a_power_that_decreases_decays(power, end):
    t = np.linspace(0.0, end, 48_001)[1:]
    law = growth(t, 1e-3 * t**power, end / 16)
    assert law.verdict == DECAYS and law.exponent == pytest.approx(power, abs=1e-3)


@pytest.mark.parametrize("rate", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("octaves", [4, 5, 6, 8])
def test_exponentials_decay(rate, octaves):
    """The residual is exactly exp(-rate t): a power of time is only an approximation, but its interval is below zero."""
    t = np.linspace(0.0, 24.0, 48_001)[1:]
    assert growth(t, np.exp(-rate * t), 24.0 / 2**octaves).verdict == DECAYS


def test_independent_octaves_rarely_seem_to_decay():
    """Without a trend, an interval at 95 % is below zero in one of forty draws; 2000 draws of 5 octaves."""
    random = np.random.default_rng(2)
    t = np.repeat(2.0 ** np.arange(5), 2) * np.tile([0.75, 1.0], 5)
    scatter = np.repeat(random.normal(size=(2000, 5)), 2, axis=1)
    share = np.mean([growth(t, np.exp(one), 0.5).verdict == DECAYS for one in scatter])
    assert share == pytest.approx(0.025, abs=4 * np.sqrt(0.025 * 0.975 / 2000))


def test_what_is_inconclusive_or_rounding():
    short = T <= 24
    assert growth(T[short], T[short] + 1, 8.0).verdict == INCONCLUSIVE  # one octave
    assert growth(T, np.full_like(T, 1e-16), 8.0, rounding=1e-15).verdict == ROUNDED
    assert growth(T, np.zeros_like(T), 8.0).verdict == ROUNDED
    assert growth(np.zeros(0), np.zeros(0), 8.0).verdict == INCONCLUSIVE


def test_a_transient_is_not_growth():
    assert growth(T, 1e-9 + 1e-6 * np.exp(-T), 8.0).verdict == BOUNDED


def test_what_rounding_makes_is_no_law():
    """A bound of 1e-9 is seen until rounding, which grows, has passed it; growth that stays below rounding is none."""
    found = growth(T, np.maximum(1e-9, 4e-12 * T) * WAVE / 2, 8.0, rounding=5e-12 * T)
    assert found.verdict == BOUNDED and len(found.octaves) == 8
    assert growth(T, 1e-11 * T, 8.0, rounding=2e-11 * T).verdict == ROUNDED
    assert growth(T, 1e-11 * T, 8.0, rounding=1e-12 * T).verdict == GROWS
    # too few octaves for a law, and rounding after them; above rounding at last: no law of successive octaves
    assert growth(T, 1e-9 * WAVE, 8.0, rounding=np.where(T > 30, 1.0, 0.0)).verdict == ROUNDED
    assert growth(T, 1e-9 * WAVE, 8.0, rounding=np.where(T < 30, 1.0, 0.0)).verdict == INCONCLUSIVE


@pytest.mark.parametrize(("alpha", "beta"), [(3, 2), (2, 3), (2, 2), (5, 0.5)])
@pytest.mark.parametrize(
    ("steps", "bound"), [({"dt": 1e-2, "method": "paper"}, 1e-5), ({"rtol": 1e-11}, 1e-2)]
)
def test_a_start_off_the_joints_decays_as_alpha_and_beta_say(alpha, beta, steps, bound, compiled):
    """In closed form. Bounds: h^4 (2 alpha)^5/120 s of order 4; the tolerance of 0.5 m over the 0.5 nm of the start."""
    scene = vary(
        load_scene(CAMPAIGNS / "off-its-pin.toml"),
        {"stabilization.alpha": alpha, "stabilization.beta": beta},
    )
    run = ReferenceEngine().simulate(scene, **steps)
    found = decay_error(run, scene)
    assert found.value < bound and found.uncertainty < 1e-5
    for wrong in ({"stabilization.beta": beta**0.5}, {"stabilization.alpha": alpha / 2}):
        assert decay_error(run, vary(scene, wrong)).value > max(0.03, 30 * found.value)
    assert (
        decay_error(ReferenceEngine().simulate(scene, stabilization="projection", **steps), scene)
        is None
    )
    assert (
        decay_error(
            ReferenceEngine().simulate(vary(scene, {"rod.position": [0, -0.5]}), **steps), scene
        )
        is None
    )
