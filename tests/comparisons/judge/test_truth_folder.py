"""Truths as folders: what is read is the truth within the stated uncertainty, and no folder that was changed is read."""

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.judge.judgement import judge
from stiction.comparisons.judge.truth_folder import (
    TruthFolderError,
    is_truth_folder,
    read_truth,
    write_truth,
)
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.scenes import InputError, load_scene

CASES = {
    "slider-bar-case-1": 9,
    "slider-bar-case-3": 9,
    "elliptic-trammel": 2,
    "coulomb-oscillator": 40,
    "pendulum": 10,
    "hard/three-stop-at-once": 1,
}
"""With long and short smooth pieces, two guides, no guide, several events at once; s: a piece more is stored as the ones before."""


def written(scene, folder):
    write_truth(scene, ground_truth(scene), folder)
    return folder


@pytest.fixture(scope="module")
def folder(compiled, tmp_path_factory):
    return written(load_scene("slider-bar-case-1"), tmp_path_factory.mktemp("truth"))


@pytest.fixture(scope="module", params=CASES)
def stored(request, compiled, tmp_path_factory):
    """A scene, and its scene and truth as they were read."""
    scene = load_scene(request.param, {"t_end": CASES[request.param]})
    return scene, *read_truth(written(scene, tmp_path_factory.mktemp("stored")))


def test_which_names_are_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "file").touch()
    assert is_truth_folder("mine") and is_truth_folder(tmp_path / "pendulum")
    # a name of the catalogue is that scene; an empty name is not the working folder
    assert not any(map(is_truth_folder, ("pendulum", "file", "none", "")))


def test_what_is_read_is_the_truth(stored):
    asked, scene, found = stored
    truth = ground_truth(asked)
    t = np.random.default_rng(0).uniform(0.0, truth.t_end, 500)
    known, read = truth(t), found(t)
    assert {
        column
        for column in known
        if not np.abs(known[column] - read[column]).max() <= found.uncertainty[column]
    } == set()
    assert (
        max(unsure for column, unsure in found.uncertainty.items() if column.endswith((".x", ".y")))
        < 1e-9
    )
    assert (found.tier, found.effort_tier, found.guides) == (
        truth.tier,
        truth.effort_tier,
        truth.guides,
    )
    assert scene.name == asked.name and scene.t_end == asked.t_end == truth.t_end


def test_events_and_their_sides(stored):
    asked, _, found = stored
    truth = ground_truth(asked)
    assert [(event.time, event.kind, event.joint) for event in found.events] == [
        (event.time, event.kind, event.joint) for event in truth.events
    ]
    assert all(
        dict(one.before) == dict(other.before) and dict(one.after) == dict(other.after)
        for one, other in zip(found.events, truth.events)
    )
    for event in truth.events:
        if (
            sum(other.time == event.time for other in truth.events) == 1
            and 0 < event.time < truth.t_end
        ):
            for side, values in (("before", event.before), ("after", event.after)):
                there = found(event.time, side)
                assert all(
                    there[column][0] == pytest.approx(value, abs=1e-9, rel=1e-9)
                    for column, value in values.items()
                    if column in there
                )


def test_a_table_is_judged_as_by_the_solved_truth(folder):
    t = np.linspace(0, 24, 1777)
    frame = pd.DataFrame({"t": t, **ground_truth(load_scene("slider-bar-case-1"))(t)})
    frame["slider.x"] += 1e-3 * t
    judged, solved = judge(str(folder), frame), judge("slider-bar-case-1", frame)
    assert judged.error == pytest.approx(solved.error, rel=1e-6) and judged.uncertainty < 1e-9
    assert list(judged.tables["stick-phases"]["verdict"]) == list(
        solved.tables["stick-phases"]["verdict"]
    )
    assert judge(folder, frame[frame["t"] <= 12], t_end=12).is_complete
    with pytest.raises(InputError, match="at most 24"):
        judge(folder, frame, t_end=30)


def test_rows_need_no_interpolation(folder):
    """The folder's own table, both sides of events, is exact."""
    frame = pd.read_csv(folder / "truth.csv")
    judged = judge(folder, frame)
    assert judged.error < 1e-13 and judged.tables["jumps"]["resolved"].all()
    assert frame["t"].duplicated().sum() == 25


@pytest.mark.parametrize("name", ["scene.json", "truth.json", "truth.parquet", "events.csv"])
@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(path.read_bytes()[:-9] + b"123456789"),
    ],
)
def test_a_folder_that_was_changed_is_refused(folder, tmp_path, name, spoil):
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    spoil(tmp_path / name)
    with pytest.raises(TruthFolderError, match=name):
        read_truth(tmp_path)


def test_other_folders_are_refused(folder, tmp_path):
    with pytest.raises(TruthFolderError):
        read_truth(tmp_path)
    with pytest.raises(TruthFolderError, match="such as"):
        read_truth(folder.parent)
    (tmp_path / "truth.json").write_text("{}")
    with pytest.raises(TruthFolderError):
        read_truth(tmp_path)
