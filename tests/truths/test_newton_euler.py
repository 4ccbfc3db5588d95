"""Every truth obeys Newton's and Euler's equations, and moves as it accelerates: with that its energy is balanced too."""

import pytest
from truth_checks import check_motion, check_newton_and_euler, driven_arm, rocking_trammel

from stiction.scenes import load_scene
from stiction.truths import (
    four_bar_truth,
    incline_truth,
    moving_guide_truth,
    oscillator_truth,
    pendulum_truth,
    slider_bar_truth,
    slider_crank_truth,
    trammel_truth,
)

TRUTHS = [
    ("elliptic-trammel", trammel_truth, 4.0, 1e-6),
    (rocking_trammel, trammel_truth, 4.0, 1e-6),
    ("slider-on-moving-guide", moving_guide_truth, 6.0, 1e-7),
    (driven_arm, moving_guide_truth, 6.0, 1e-7),
    ("slider-crank", slider_crank_truth, 2.0, 1e-6),
    ("coulomb-oscillator", oscillator_truth, 30.0, 1e-11),
    ("mass-on-belt", oscillator_truth, 30.0, 1e-10),
    ("block-on-incline", incline_truth, 2.0, 1e-11),
    ("pendulum", pendulum_truth, 10.0, 1e-8),
    ("four-bar", four_bar_truth, 10.0, 1e-7),
    *((f"slider-bar-case-{case}", slider_bar_truth, 24.0, 1e-9) for case in (1, 2, 3)),
]
"""Scenes, truths, s, and a bound of h^4/30 = 3e-14 s^4 times the fifth derivative, by which central differences are off."""


@pytest.mark.parametrize(
    ("scene", "truth", "t_end", "atol"),
    TRUTHS,
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_newton_and_euler(scene, truth, t_end, atol):
    scene = load_scene(scene) if isinstance(scene, str) else scene()
    found = truth(scene, t_end)
    check_newton_and_euler(scene, found)
    check_motion(scene, found, atol)
