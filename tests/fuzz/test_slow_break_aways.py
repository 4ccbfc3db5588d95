"""Joints at rest that break away together under a slowly growing load, without a jump of their friction."""

import pytest

from fuzz.seeds import seed_or_fresh
from fuzz.slow_break_aways import differences, draw, second_method
from stiction.engines.reference.engine import ReferenceEngine

RTOLS = (1e-6, 1e-9, 1e-12)


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 12), pytest.param(None, 300, marks=pytest.mark.long)]
)
def test_joints_break_away_together(seed, count):
    """Every run goes on, with the events and the motion of the second method."""
    seed = seed_or_fresh(seed)
    wrong, compared = [], 0
    for index in range(count):
        scene = draw(seed, index)
        expected = second_method(scene)
        if expected is None:
            continue
        compared += 1
        for rtol in RTOLS:
            run = ReferenceEngine().simulate(
                scene, rtol=rtol, t_end=expected.end, output_step=expected.end / 20
            )
            for words in differences(scene, expected, run, rtol):
                wrong.append(f"slow_break_aways.draw({seed}, {index}) at {rtol:g}: {words}")
    assert compared > 0.8 * count and not wrong, "\n".join(wrong)
