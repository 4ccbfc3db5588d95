"""Runs that go on from the end of another."""

import numpy as np
import pytest

from stiction import continued, load_scene
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import InputError, scene_from_dict

RTOL = 1e-11


def run(scene, **options):
    return ReferenceEngine().simulate(scene, rtol=RTOL, **options)


@pytest.mark.parametrize("name", ["slider-bar-case-1", "slider-bar-case-3", "slider-crank"])
def test_two_runs_are_one(name, tmp_path):
    """A run of 2 s is a run of 0.7 s and one of 1.3 s from its end: states, forces and events."""
    scene = load_scene(name)
    whole = run(scene, t_end=2.0, output_step=0.1)
    first = run(scene, t_end=0.7, output_step=0.1)
    first.to_frame().to_csv(tmp_path / "first.csv", index=False)
    for source in (first, tmp_path / "first.csv"):
        second = run(continued(scene, source), t_end=1.3, output_step=0.1)
        for column in whole.columns:
            if not column.startswith("drift."):
                expected = whole[column][7:]
                size = 1 + np.nanmax(np.abs(expected))
                np.testing.assert_allclose(
                    second[column], expected, rtol=0, atol=1e4 * RTOL * size, err_msg=column
                )
        times = [event.time - 0.7 for event in whole.events if event.time > 0.7]
        found = [event.time for event in second.events]
        np.testing.assert_allclose(found, times, rtol=0, atol=1e4 * RTOL)


def test_a_spring_is_taken_away():
    """A mass on a spring is released: it goes on with the speed that it had, without a force."""
    raw = {
        "bodies": {"mass": {"mass": 2, "inertia": 1, "position": [1, 0]}},
        "joints": {"guide": {"type": "translational", "slider": "mass"}},
        "springs": {"spring": {"type": "linear", "bodies": ["mass", "ground"], "stiffness": 8}},
    }
    before = run(scene_from_dict(raw), t_end=0.5)
    without = scene_from_dict({key: value for key, value in raw.items() if key != "springs"})
    after = run(continued(without, before), t_end=3.0, output_step=3.0)
    # x = cos(2 t) until 0.5 s
    x, v = np.cos(1.0), -2 * np.sin(1.0)
    assert after["mass.x"][-1] == pytest.approx(x + 3 * v, abs=1e-9)


def test_a_run_of_another_mechanism():
    other = run(load_scene("slider-crank"), t_end=0.1)
    with pytest.raises(InputError, match=r"bar\.x"):
        continued(load_scene("slider-bar-case-1"), other)


@pytest.mark.parametrize("content", ["", "t,slider.x\n", "a,b\n1,2\n"])
def test_a_file_that_is_no_run(content, tmp_path):
    file = tmp_path / "run.csv"
    file.write_text(content)
    with pytest.raises(InputError, match="expected"):
        continued(load_scene("slider-bar-case-1"), file)
