"""Guides that rest together do so exactly while a share of their load lies inside all cones."""

import numpy as np
import pytest

from fuzz.dense_mechanics import Dense, Dice, Rest
from fuzz.seeds import seed_or_fresh
from fuzz.shared_loads import ROWS, T_END, check, draw, with_other_rods
from stiction.engines.protocol import BadTrajectory
from stiction.engines.reference.engine import ReferenceEngine

MOST_PROGRAMS = 70
"""Linear programs for one value of F."""


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 12), pytest.param(None, 1000, marks=pytest.mark.long)]
)
def test_rest_ends_with_the_last_share(seed, count):
    seed, wrong = seed_or_fresh(seed), []
    for index in range(count):
        family, scene = draw(seed, index)
        try:
            run = ReferenceEngine().simulate(
                scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9
            )
        except BadTrajectory as error:
            wrong.append(f"shared_loads.draw({seed}, {index}), {family}: {error}")
            continue
        wrong += [
            f"shared_loads.draw({seed}, {index}), {family}: {word}" for word in check(scene, run)[0]
        ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 6), pytest.param(None, 300, marks=pytest.mark.long)]
)
def test_corners_are_the_linear_programs(seed, count):
    """The second method itself: its two ways to the largest least margin agree."""
    seed, compared = seed_or_fresh(seed), 0
    for index in range(4 * count):
        dense = Dense(draw(seed, index)[1])
        rest = Rest(dense, dense.equations.start()[0])
        if (
            compared == count
            or np.prod([float(len(rest.slopes[i])) for i in rest.shared]) > MOST_PROGRAMS
        ):
            continue
        force, _ = rest.load(0.3)
        fixed = min((np.max(rest.margins[i] @ force) for i in rest.fixed), default=np.inf)
        expected = fixed if rest.grows() else rest.largest_least_margin(0.3)
        assert rest.by_linear_programs(0.3) == pytest.approx(expected, rel=1e-7, abs=1e-8), (
            f"draw({seed}, {index})"
        )
        compared += 1
    assert compared > count / 2


@pytest.mark.parametrize(
    ("seed", "count"), [(2, 8), pytest.param(None, 300, marks=pytest.mark.long)]
)
def test_masses_of_rods_have_no_influence_on_the_share(seed, count):
    seed, compared = seed_or_fresh(seed), 0
    for index in range(count):
        _, scene = draw(seed, index)
        one, other = (with_other_rods(scene, Dice(seed, index, k)) for k in range(2))
        runs = [
            ReferenceEngine().simulate(each, t_end=0.2, output_step=0.02, rtol=1e-9)
            for each in (one, other)
        ]
        names = [f"{name}.friction" for name in scene.frictional_guides]
        modes = [f"{name}.mode" for name in scene.frictional_guides]
        if any(
            run.breakdown or run.events or any(np.any(run[mode]) for mode in modes) for run in runs
        ):
            continue
        compared += 1
        size = max(np.max(np.abs(runs[0][name])) for name in names) + 1e-9
        for name in names:
            assert np.max(np.abs(runs[0][name] - runs[1][name])) < 1e-7 * size, (
                f"draw({seed}, {index}), {name}"
            )
    assert compared


@pytest.mark.parametrize(("seed", "index"), [(1, 11), (11, 562)])
def test_a_guide_whose_load_passes_zero_ends_no_rest(seed, index):
    """Its capacity, and F with it, touches zero: the others went on holding, and slipped and stuck at that instant."""
    family, scene = draw(seed, index)
    run = ReferenceEngine().simulate(scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9)
    assert check(scene, run) == ([], "all rest") and run.events == ()


def test_a_rest_that_is_one_of_several_motions_is_said():
    """Three guides may share their load at rest, by linear programs with 0.437 N to spare, and may slip as well."""
    _, scene = draw(12, 234)
    run = ReferenceEngine().simulate(scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9)
    assert (
        run.breakdown is not None
        and run.breakdown.kind == "several solutions"
        and run.breakdown.time == 0.0
    )
