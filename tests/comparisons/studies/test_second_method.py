"""The check of our own run by a second method: it confirms a right motion, and finds a wrong one."""

from dataclasses import replace

import numpy as np
import pytest

from stiction.comparisons.bench.study import Scope
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.studies.second_method import (
    AGREES,
    EVENT_TIME,
    POSITION,
    STUDY,
    differences,
    second_motion,
)
from stiction.reports.text import section_of
from stiction.scenes import load_scene, vary


@pytest.fixture(scope="module")
def sled():
    """A block on an incline with friction, with an independent closed form."""
    return vary(load_scene("block-on-incline"), {"t_end": 1.0})


@pytest.fixture(scope="module")
def motion(sled):
    return second_motion(sled)


def test_the_second_method_agrees_with_a_closed_form(sled, motion):
    row = differences(sled, motion, ground_truth(sled))
    assert row[AGREES]
    assert row[POSITION] < 1e-9
    assert row[EVENT_TIME] is not None


@pytest.mark.parametrize("factor", [1.01, 0.99])
def test_a_wrong_coefficient_of_friction_is_found(sled, motion, factor):
    [guide] = sled.frictional_guides
    mu, mus = sled.guides[guide].kinetic_coefficient, sled.guides[guide].static_coefficient
    wrong = vary(sled, {f"{guide}.mu": factor * mu, f"{guide}.mus": factor * mus})
    row = differences(sled, motion, ground_truth(wrong))
    assert not row[AGREES]


def test_other_events_are_another_motion(sled, motion):
    truth = ground_truth(sled)
    extra = replace(motion, events=(*motion.events, ("guide", "stick", 0.5)))
    row = differences(sled, extra, truth)
    assert not row[AGREES]
    assert row[EVENT_TIME] is None
    assert "different events" in row["reason"]


def test_motions_of_the_catalogue_are_confirmed_in_the_text():
    """Of a mechanism with friction that is no truth's: our own run and the second method agree."""
    scene = vary(load_scene("slider-crank"), {"guide.mu": 0.2, "guide.mus": 0.3, "t_end": 1.0})
    results = STUDY.plan(Scope((scene,), is_campaign=True)).make()
    from stiction.comparisons.bench.study import union

    text = section_of(STUDY, union([results], scenes=(scene,))).answer
    assert f"In {scene.title} a second, independent method confirms the motion" in text
    assert np.isfinite(results.tables["second-method"][POSITION]).all()


def test_scenes_without_friction_or_with_many_guides_have_a_reason():
    assert "no guide with friction" in STUDY.applies(Scope((load_scene("four-bar"),)))
    assert not STUDY.applies(Scope((load_scene("elliptic-trammel"),)))
