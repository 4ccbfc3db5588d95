"""Guides that geometry locks have no friction and no events, and guides that only seem locked are free."""

import pytest

from fuzz.locked_guides import ROWS, T_END, check, draw, near_miss, without_friction
from fuzz.seeds import seed_or_fresh
from stiction.engines.protocol import BadTrajectory
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.multibody.guide_freedom import guide_freedoms


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 30), pytest.param(None, 2000, marks=pytest.mark.long)]
)
def test_locked_guides_are_as_without_friction(seed, count):
    seed, wrong, ended = seed_or_fresh(seed), [], 0
    for index in range(count):
        drawn = draw(seed, index)
        try:
            runs = [
                ReferenceEngine().simulate(scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9)
                for scene in (drawn.scene, without_friction(drawn))
            ]
        except BadTrajectory as error:
            wrong.append(f"locked_guides.draw({seed}, {index}): {error}")
            continue
        ended += runs[0].breakdown is None
        wrong += [f"locked_guides.draw({seed}, {index}): {word}" for word in check(drawn, *runs)]
    assert not wrong, "\n".join(wrong)
    assert ended > 0.95 * count


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 60), pytest.param(None, 2000, marks=pytest.mark.long)]
)
def test_guides_that_only_seem_locked(seed, count):
    seed = seed_or_fresh(seed)
    for index in range(count):
        family, scene, wanted = near_miss(seed, index)
        assert guide_freedoms(scene, 1.0).freedom["guide-block"] == wanted, (
            f"locked_guides.near_miss({seed}, {index}): {family}"
        )
