"""A scene of the user's own goes all the way: `validate`, report, page, paper, trace; and scenes that cannot be compared."""

import json
import shlex

import pandas as pd
import pytest
import tomli_w
from conftest import invoke
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import validation_campaign
from stiction.comparisons.bench.study import Scope, selection
from stiction.comparisons.studies import studies
from stiction.reference_impl.multibody.equation_summary import degrees_of_freedom, is_prescribed
from stiction.reports.recommendation import own_mechanisms
from stiction.reports.run_folder.stored_run import read_run
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths import Tier

NAME = "four-bar"
"""Name of the scene, which is also that of a scene of the catalogue: a lookup by name would find the wrong one."""
TITLE = "Press of my own"
CRANK = {
    "title": TITLE,
    "t_end": 0.8,
    "gravity": [0, -9.81],
    "parameters": {"r": 0.1, "l": 0.35, "w0": 4.0},
    "bodies": {
        "crank": {
            "mass": 0.5,
            "inertia": 4e-4,
            "position": ["r/2", 0],
            "velocity": [0, "w0*r/2"],
            "angular_velocity": "w0",
        },
        "rod": {
            "mass": 0.4,
            "inertia": 4e-3,
            "position": ["r + l/2", 0],
            "velocity": [0, "w0*r/2"],
            "angular_velocity": "-w0*r/l",
        },
        "ram": {"mass": 1.2, "inertia": 2e-3, "position": ["r + l", 0]},
    },
    "joints": {
        "pivot": {
            "type": "revolute",
            "bodies": ["crank", "ground"],
            "points": [["-r/2", 0], [0, 0]],
        },
        "crankpin": {
            "type": "revolute",
            "bodies": ["rod", "crank"],
            "points": [["-l/2", 0], ["r/2", 0]],
        },
        "wrist": {"type": "revolute", "bodies": ["rod", "ram"], "points": [["l/2", 0], [0, 0]]},
        "ways": {
            "type": "translational",
            "slider": "ram",
            "direction": [1, 0],
            "mu": 0.25,
            "mus": 0.35,
        },
    },
    "drives": {
        "motor": {
            "type": "angle",
            "bodies": ["crank", "ground"],
            "law": {"type": "linear", "rate": "w0"},
        }
    },
}
FOREIGN = (
    "case 1",
    "Four-bar",
    "the paper's Fig",
    "leaves open",
    "spring-held slider",
    "Zhuang & Wang 2014)",
)
"""Texts about the paper's cases, or about the scene of the catalogue with the same name."""


def write_scene(folder, name=NAME, **changed):
    file = folder / f"{name}.toml"
    file.write_text(tomli_w.dumps({**CRANK, **changed}))
    return file


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a validation of a crank with the name of a scene of the catalogue."""
    folder = tmp_path_factory.mktemp("own")
    file = write_scene(folder)
    ended = invoke(
        "validate",
        "--quick",
        "--scenes",
        str(file),
        "--engines",
        "pymunk",
        "--out",
        str(folder / "run"),
    )
    # Nothing that follows may depend on the file.
    file.unlink()
    return folder / "run", ended


def test_a_scene_of_ones_own_is_compared_under_its_own_title(run):
    folder, ended = run
    report = (folder / "report.md").read_text()
    assert report.startswith(f"# Solvers compared: {TITLE}")
    assert not [text for text in FOREIGN if text in report]
    # Every study that was left out is named with a reason, on the page and on the terminal.
    for title in ("Stick limit", "Hold", "Hard cases", "The paper", "Torque jumps"):
        assert f"Not examined: {title}: " in " ".join(report.split())
        assert f"Not examined: {title}: " in ended.output
    figures = {path.stem for path in (folder / "figures").iterdir()}
    expected = ("mechanism", "motion", "efforts")
    assert {*(f"{subject}-{NAME}" for subject in expected), f"forces-{NAME}-ways"} <= figures
    assert not [name for name in figures if name.startswith("fig")]


def test_the_stored_run_contains_the_scene(run):
    folder, _ = run
    stored = read_run(folder)
    scene = scene_from_dict(CRANK, name=NAME)
    assert stored.validation().scenes == {NAME: scene}
    assert stored.tables["parameters"]["l"].tolist() == [0.35]
    assert load_scene(folder / "reproduce" / "scenes" / f"{NAME}.toml") == scene


def test_a_truth_by_our_own_run_is_called_that(run):
    folder, _ = run
    accuracy = pd.read_csv(folder / "data" / "accuracy.csv")
    # The engine with contacts refuses a slider without a length, and has nothing to compare.
    assert set(accuracy["truth_tier"]) == {Tier.OWN_RUN, Tier.NONE}
    report = " ".join((folder / "report.md").read_text().split())
    assert "It is **not independent** of the reference" in report
    assert "relative to our own run" in report
    assert "recommended" not in report


def test_page_paper_and_trace_use_the_stored_scene(run):
    folder, _ = run
    page, paper = folder.with_suffix(".html"), folder.with_name("paper")
    invoke("page", str(folder))
    invoke("paper", str(folder), "--out", str(paper))
    content = json.loads((paper / "paper.json").read_text())
    assert content["title"] == f"Solvers compared: {TITLE}"
    text = json.dumps(content)
    for written in (page.read_text(), text, (paper / "paper.tex").read_text()):
        assert TITLE in written
        assert not [words for words in FOREIGN if words in written]
    assert "minimal coordinates" not in text
    assert f"data/truths/{NAME}.parquet" in invoke("trace", str(folder), "accuracy:1").output


@pytest.fixture(scope="module")
def threshold_run(tmp_path_factory):
    """The folder of a report on the stick limit of a crank, whose runs are not recorded."""
    folder = tmp_path_factory.mktemp("limit")
    file = write_scene(folder)
    invoke(
        *("compare", "threshold", str(file), "--quick", "--engines", "reference"),
        *("--parameter", "w0", "--range", "3:5", "--resolution", "1"),
        *("--report", str(folder / "run")),
    )
    file.unlink()
    return folder / "run"


def test_a_report_without_recorded_runs_is_about_its_scene(threshold_run):
    stored = read_run(threshold_run)
    results = stored.validation()
    assert not results.records and results.compared_scenes == [NAME]
    assert not results.is_about_paper and stored.origin["choices"] == {}
    assert results.unrecorded_runs == results.table("threshold")["runs"].sum() > 0
    assert list(stored.tables["parameters"]["scene"]) == [NAME]
    [described] = own_mechanisms(results)
    assert described["scene"] == NAME and described["counts"]["bodies"] == len(CRANK["bodies"])


def test_page_and_paper_without_recorded_runs_are_about_their_scene(threshold_run):
    paper = threshold_run.with_name("paper")
    invoke("page", str(threshold_run))
    invoke("paper", str(threshold_run), "--out", str(paper))
    content = json.loads((paper / "paper.json").read_text())
    assert content["title"] == f"Solvers compared: {TITLE}"
    assert all(part["text"] for part in content["sections"])
    report = (threshold_run / "report.md").read_text()
    runs = pd.read_csv(threshold_run / "data" / "threshold.csv")["runs"].sum()
    assert f"{runs} runs of {TITLE}" in " ".join(content["methods"])
    page = threshold_run.with_suffix(".html").read_text()
    for written in (report, page, json.dumps(content)):
        assert TITLE in written
        assert not [words for words in FOREIGN if words in written]


@pytest.mark.parametrize(
    ("changed", "expected"),
    [({}, True), ({"effort_limit": 5.0}, False), (None, False)],
)
def test_drives_prescribe_a_motion_unless_they_give_way_or_are_missing(changed, expected):
    """The crank has no degree of freedom with its drive, and one without it."""
    drives = {} if changed is None else {"motor": {**CRANK["drives"]["motor"], **changed}}
    scene = scene_from_dict({**CRANK, "drives": drives}, name="mine")
    assert is_prescribed(scene) == expected
    assert degrees_of_freedom(scene) == (1 if changed is None else 0) or changed


def test_a_stored_row_has_the_command_that_makes_its_run_again(run, monkeypatch):
    """The command is executed in the run folder, whose scene it names."""
    folder, _ = run
    monkeypatch.chdir(folder)
    cost = pd.read_csv("data/cost.csv")
    row = cost[cost["rerun_command"].notna()].iloc[0]
    command = shlex.split(row["rerun_command"])
    assert command[:3] == ["stiction", "run", f"reproduce/scenes/{NAME}.toml"]
    invoke(*command[1:])
    validate = json.loads((folder / "provenance.json").read_text())["command"]
    assert f"--scenes RUN/reproduce/scenes/{NAME}.toml" in validate


@pytest.mark.parametrize(
    ("changed", "reasons"),
    [
        # no drive, no guide, no friction, no period
        ({"drives": {}}, {"Torque jumps": "no drive"}),
        ({"joints": {}, "drives": {}, "bodies": {"stone": {"mass": 1.0, "inertia": 1.0, "position": [0, 0]}}}, {"Stick limit": "no joint with friction", "Torque jumps": "no drive"}),
    ],
)  # fmt: skip
def test_a_study_that_does_not_apply_says_why(changed, reasons):
    scene = scene_from_dict({**CRANK, **changed}, name="mine")
    selected = selection(Scope((scene,), Depth.DEFAULT, (), is_campaign=True), studies())
    for title, reason in reasons.items():
        assert reason in selected.reasons[title]
        assert "\n" not in selected.reasons[title]
        assert title not in {study.title for study in selected.scopes}


def test_every_study_applies_to_the_papers_cases():
    scope = Scope(tuple(validation_campaign().scenes), Depth.DEFAULT, (), is_campaign=True)
    selected = selection(scope, studies())
    assert not selected.reasons
    assert set(selected.scopes) == {
        study for study in studies() if study.plan is not None and study.in_campaign
    }


def test_each_of_several_scenes_has_its_reason():
    driven = scene_from_dict(CRANK, name="driven")
    free = scene_from_dict({**CRANK, "drives": {}}, name="free")
    scope = Scope((driven, free), Depth.DEFAULT, (), is_campaign=True)
    selected = selection(scope, studies())
    scopes = {study.title: scope for study, scope in selected.scopes.items()}
    assert scopes["Torque jumps"].scenes == (driven,)
    assert scopes["Accuracy"].scenes == (driven, free)
    assert selected.reasons["Torque jumps"].startswith("free: ")
    # Studies of one case of the paper examine each scene of one's own.
    assert scopes["Effects"].leading_scenes == (driven, free)
    assert "Effects" not in selected.reasons


@pytest.mark.parametrize(
    ("changed", "name", "message"),
    [
        ({"parameters": {"r": 0.1, "l": 0.35, "w0": 4.0, "q": 1}, "bodies": {**CRANK["bodies"], "ram": {"mass": 1.0, "inertia": 1.0, "position": [2, 0]}}}, "open", "position"),
        ({}, "my press", "expected a file whose name consists of"),
    ],
)  # fmt: skip
def test_a_scene_that_cannot_be_validated_is_refused_before_any_run(
    changed, name, message, tmp_path
):
    file = write_scene(tmp_path, name, **changed)
    out = tmp_path / "run"
    ended = CliRunner().invoke(app, ["validate", "--scenes", str(file), "--out", str(out)])
    assert ended.exit_code == 2 or isinstance(ended.exception, Exception)
    assert message in " ".join((ended.output + str(ended.exception)).split())
    assert not out.exists()
