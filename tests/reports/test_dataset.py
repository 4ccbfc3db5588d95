"""A data set stands by itself: complete, within its checksums, and never in the place of something else."""

import hashlib
import json

import pandas as pd
import pytest
from conftest import invoke

from stiction.reports.dataset import write_dataset
from stiction.reports.run_folder.overwriting import FolderRefused
from stiction.scenes import load_scene
from stiction.scenes.resolved import load_resolved

NAMES = ["slider-bar-case-1", "four-bar", "hard/chatter", "painleve-rod", "hard/peak-of-the-load"]
"""Proven, of closed form, in a folder of the catalogue, without a truth, with our own run alone."""


@pytest.fixture(scope="module")
def folder(compiled, tmp_path_factory):
    place = tmp_path_factory.mktemp("data") / "truths"
    write_dataset(place, NAMES)
    return place


def test_scenes_with_an_independent_truth(folder):
    index = pd.read_csv(folder / "index.csv")
    assert list(index["scene"]) == NAMES[:3] and list(index["certificate"]) == [True, False, False]
    for name in NAMES[:3]:
        files = {path.name for path in (folder / name).iterdir()}
        assert {
            "scene.json",
            "scene.toml",
            "scene.svg",
            "truth.csv",
            "truth.parquet",
            "events.csv",
            "truth.json",
            "SHA256SUMS",
        } <= files
        assert load_scene(folder / name / "scene.toml") == load_scene(name)
        assert (
            load_resolved((folder / name / "scene.json").read_text()).bodies
            == load_scene(name).bodies
        )
        assert set(json.loads((folder / name / "truth.json").read_text())) >= {
            "tier",
            "uncertainty",
            "t_end [s]",
            "version",
        }
        pd.testing.assert_frame_equal(
            pd.read_csv(folder / name / "truth.csv"),
            pd.read_parquet(folder / name / "truth.parquet"),
            check_dtype=False,
            check_exact=False,
            rtol=1e-15,
        )


def test_a_stranger_finds_his_way_and_checks_sums(folder):
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert all(name in text for name in NAMES[:3]) and "{" not in text and "BSD-3-Clause" in text
    assert (
        "Redistribution" in (folder / "LICENSE").read_text()
        and "cff-version" in (folder / "CITATION.cff").read_text()
    )
    for sums in folder.rglob("SHA256SUMS"):
        listed = dict(reversed(line.split("  ")) for line in sums.read_text().splitlines())
        files = {
            path.relative_to(sums.parent).as_posix(): path
            for path in sums.parent.rglob("*")
            if path.is_file() and path != sums
        }
        files.pop("provenance.json", None)  # which lists the checksums
        assert {
            name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()
        } == listed


def test_nothing_of_others_is_overwritten(folder, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FolderRefused):
        write_dataset(tmp_path, ["pendulum"])
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--scenes", "pendulum"], 0),
        (["--scenes", "pendulum,nowhere"], 2),
        (["--scenes", "painleve-rod"], 1),
    ],
)
def test_command(compiled, tmp_path, arguments, code):
    target = tmp_path / "truths"
    invoke("dataset", target, *arguments, exit_code=code)
    assert (target / "pendulum" / "truth.csv").is_file() == (code == 0)
