"""Laws of growth are found with intervals that hold, and nothing is read from too short a run."""

import numpy as np
import pytest

from stiction.comparisons.depth import Depth
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, NOT_TOLD, ROUNDED, growth, walk_spread
from stiction.comparisons.studies.drift_study import CHOICES, NONE, PAPERS, STEPS, plan
from stiction.scenes import load_scene

T = np.linspace(0.0, 2400.0, 48_001)
WAVE = 2 + np.sin(2 * np.pi * T / 8)


@pytest.mark.parametrize("power, verdict", [(0.0, BOUNDED), (0.1, BOUNDED), (1.0, GROWS), (1.5, GROWS), (2.0, GROWS)])
def test_powers_of_a_periodic_residual(power, verdict):
    found = growth(T, 1e-9 * WAVE * T ** power, 8.0)
    assert found.verdict == verdict and abs(found.exponent - power) <= found.uncertainty + 1e-3 < 0.1


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("integrated, exponent", [(1, 0.5), (2, 1.5)])
def test_random_walks_grow(integrated, exponent, seed):
    """Independent errors in the residual, or in its rate: not taken for bounded, though a walk's exponent scatters by far more than its interval."""
    walk = np.random.default_rng(seed).normal(size=len(T))
    for _ in range(integrated):
        walk = np.cumsum(walk)
    found = growth(T, np.abs(walk), 8.0)
    assert found.verdict != BOUNDED and abs(found.exponent - exponent) < 0.5


def test_what_cannot_be_told():
    short = T <= 24
    assert growth(T[short], T[short] + 1, 8.0).verdict == NOT_TOLD  # one octave
    assert growth(T, np.full_like(T, 1e-16), 8.0, rounding=1e-15).verdict == ROUNDED
    assert growth(T, np.zeros_like(T), 8.0).verdict == ROUNDED
    assert growth(np.zeros(0), np.zeros(0), 8.0).verdict == NOT_TOLD


def test_a_walk_must_be_told_from_a_bound():
    """The more octaves, the further a walk goes."""
    assert 0 < walk_spread(3) < walk_spread(8) < walk_spread(16)


def test_a_transient_is_not_growth():
    assert growth(T, 1e-9 + 1e-6 * np.exp(-T), 8.0).verdict == BOUNDED


def test_stability_of_the_papers_choice():
    """lambda = -179.44 and -0.557 1/s; on the negative real axis the method of order 4 is stable up to h |lambda| = 2.7853 (Hairer & Wanner, Sect. IV.2)."""
    assert PAPERS.largest_step() == pytest.approx(2.785293563 / (90 + np.sqrt(90 ** 2 - 10 ** 2)), rel=1e-8)
    assert PAPERS.amplification(1.5e-2) < 1 < PAPERS.amplification(1.6e-2)
    assert np.isnan(NONE.amplification(1e-2)) and np.isinf(NONE.largest_step())
    assert all(choice.amplification(1e-9) == pytest.approx(1.0, abs=1e-6) for choice in CHOICES if choice.method == "baumgarte")


def test_the_plan_grows_with_the_depth():
    cases = {case: load_scene(f"slider-bar-case-{case}") for case in (1, 2, 3)}
    quick, default, full = (plan(cases, depth) for depth in Depth)
    assert {end for *_, end in full} == {240.0, 2400.0} and {end for *_, end in quick} == {end for *_, end in default} == {240.0}
    names = [{(scene.name, choice, step) for scene, choice, step, _ in part} for part in (quick, default, full)]
    assert names[0] < names[1] < names[2]
    assert {(choice, step) for _, choice, step, _ in default} >= {(choice, step) for choice in (NONE, PAPERS) for step in STEPS}
    assert sum(end / step for *_, step, end in default) < 0.1 * sum(end / step for *_, step, end in full)
