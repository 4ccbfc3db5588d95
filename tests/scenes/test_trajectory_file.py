"""A saved trajectory is the same trajectory, to the bit; runs side by side; scenes made in Python."""

import dataclasses

import numpy as np
import pytest

from stiction import (
    InputError,
    Scene,
    Trajectory,
    load_engine,
    load_scene,
    scene_from_dict,
)
from stiction.scenes.loading import load_scene as load


@pytest.fixture(scope="module")
def run():
    return load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=4.0)


def test_saved_and_loaded(run, tmp_path):
    run.save(tmp_path / "run.parquet")
    again = Trajectory.load(tmp_path / "run.parquet")
    assert again.mechanism == run.mechanism and again.mechanism.name == run.mechanism.name
    for field in dataclasses.fields(run):
        ours, theirs = getattr(run, field.name), getattr(again, field.name)
        if field.name == "columns":
            assert list(ours) == list(theirs) and all(
                np.array_equal(ours[name], theirs[name], equal_nan=True) for name in ours
            )
        elif field.name == "t":
            assert np.array_equal(ours, theirs)
        elif field.name != "mechanism":
            assert repr(ours) == repr(theirs), field.name


def test_what_is_no_trajectory_is_refused(run, tmp_path):
    (tmp_path / "text.parquet").write_text("t,x\n0,1\n")
    run.to_frame().to_parquet(tmp_path / "frame.parquet")
    for name in ("text.parquet", "frame.parquet", "missing.parquet"):
        with pytest.raises(InputError, match=name):
            Trajectory.load(tmp_path / name)


def test_several_columns_are_a_table_over_time(run):
    found = run[["slider.x", "motor.effort"]]
    assert list(found) == ["slider.x", "motor.effort"] and np.array_equal(found.index, run.t)
    with pytest.raises(KeyError):
        run[["slider.z"]]


def test_runs_beside_each_other(run, tmp_path):
    coarse = load_engine("reference").simulate(run.mechanism, t_end=4.0, rtol=1e-5)
    picture = run.plot("slider.x", "motor.effort", against=[coarse])
    assert [len(ax.lines) for ax in picture.axes] == [2, 2]
    assert len({line.get_label() for line in picture.axes[0].lines}) == 2
    with pytest.raises(ValueError):
        run.plot(against=[coarse])


def test_a_scene_made_in_python_is_written_and_varied(tmp_path):
    made = Scene(bodies={"ball": {"mass": 2.0, "inertia": 1.0}}, gravity=(0.0, -9.81))
    (tmp_path / "ball.toml").write_text(made.to_toml())
    assert load(tmp_path / "ball.toml") == made
    assert (
        scene_from_dict(
            {"bodies": {"ball": {"mass": 2.0, "inertia": 1.0}}, "gravity": [0.0, -9.81]}
        )
        == made
    )
