"""A report comes out whole whatever happened to the engines, says what was lost and why, and loses nothing itself."""

import json
import re
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import CASE, LOST, unsaved_figures, validation_of

import stiction.reports.markdown.validation_report
from stiction.comparisons.bench.environment import source_digest
from stiction.comparisons.bench.methods import stored_keys
from stiction.comparisons.bench.participants import variant
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.studies.paper_figures import stick_phases
from stiction.engines.isolation import Outcome
from stiction.reports import REPORT, FolderRefused, check_folder, report_of, write_report
from stiction.reports.markdown.failures import failed_runs, group_failures
from stiction.reports.run_folder.data import data_tables, to_storable, trajectory_files
from stiction.reports.run_folder.overwriting import run_folder
from stiction.reports.run_folder.reproduce import campaign_command
from stiction.scenes import load_scene

MOST_BYTES = 60_000


def test_every_loss_is_named_with_its_reason(report_folder):
    """An engine that is not installed is none: it is told once, on page one."""
    text, failures = (
        (report_folder / "report.md").read_text(),
        (report_folder / "failures.md").read_text(),
    )
    for number, (status, reason) in enumerate(LOST.items()):
        there = status != "missing"
        assert (
            (reason.replace("|", "\\|") in failures)
            == (
                f"engine {number}"
                in text[text.index("## What failed?") : text.index("## Parameters")]
            )
            == there
        )
    assert (
        "Not installed: engine2;" in text.partition("\n## ")[0]
        and f"{len(LOST) - 1} runs failed or ended early" in text
    )


def test_all_parts_are_there(validation, report_folder):
    text = (report_folder / "report.md").read_text()
    titles = re.findall(r"^## (.*)$", text, re.M)
    questions = [study.question for study in report_of(validation).sections]
    assert (
        titles
        == ["Terms", *questions, "What failed?", "Parameters of the scenes", "Truths", "Provenance"]
        and len(questions) > 2
    )
    files = {
        path.relative_to(report_folder).as_posix()
        for path in report_folder.rglob("*")
        if path.is_file()
    }
    assert files == set(json.loads((report_folder / "provenance.json").read_text())["files"])
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert "failures.md" in links and all((report_folder / link).is_file() for link in links)
    assert len(text.encode()) < MOST_BYTES


@pytest.mark.parametrize("kept", ["nothing", "only failures", "only the reference"])
def test_report_comes_out_without_engines(kept, validation, lost_records, truths, tmp_path):
    records = {
        "nothing": [],
        "only failures": lost_records,
        "only the reference": [validation.records[0]],
    }[kept]
    chosen = validation_of(records, truths) if records else Results((), {}, {})
    with unsaved_figures():
        text = write_report(report_of(chosen), tmp_path / "run").read_text()
    assert ("## What failed?" in text) == (kept == "only failures") and not re.search(
        r"\bnan\b", text
    )
    assert (tmp_path / "run" / "data" / "events.parquet").is_file()


def test_jumps_are_vertical_and_stick_is_shaded(validation, truths):
    phases = stick_phases(truths[CASE])
    # the events of case 1 by the reduced solution
    np.testing.assert_allclose(phases, [(0.0, 0.304719758), (7.600035087, 8.217361345)], atol=1e-8)
    [paper] = [
        said for study, said in report_of(validation).sections.items() if study.name == "paper"
    ]
    [moment] = [
        figure
        for figure in paper.figures
        if figure.name == "fig07-slider-bar-case-1-driving-moment"
    ]
    np.testing.assert_allclose(moment.panels[0].shades, phases, atol=1e-8)
    t, torque = moment.panels[0].series[0].x, moment.panels[0].series[0].y
    for event in truths[CASE].events:
        if abs(event.jump("motor.effort")) > 1e-6:
            at = np.flatnonzero(np.abs(t - event.time) < 1e-7)
            assert len(at) >= 2 and np.ptp(torque[at]) == pytest.approx(
                abs(event.jump("motor.effort")), abs=1e-6
            )


def test_losses_inside_a_comparison_and_early_ends_count(validation):
    run = validation.records[1]
    early = replace(run.outcome, value=replace(run.trajectory, termination="step size underflow"))
    broken = pd.DataFrame(
        {
            "scene": [CASE],
            "variant": ["other"],
            "parameter": ["dt"],
            "step": [0.01],
            "status": ["crashed"],
            "reason": ["SIGABRT"],
        }
    )
    lost = failed_runs(
        replace(validation, records=(replace(run, outcome=early),), tables={"threshold": broken})
    )
    assert list(zip(lost["status"], lost["reason"], lost["table"])) == [
        ("incomplete", "step size underflow", "runs"),
        ("crashed", "SIGABRT", "threshold"),
    ]
    assert list(group_failures(lost)["runs"]) == [1, 1]


def test_what_it_takes_to_make_the_numbers_again(report_folder):
    """Packages as installed, the catalogue's scene, the command, and the code's own digest."""
    place, origin = (
        report_folder / "reproduce",
        json.loads((report_folder / "provenance.json").read_text()),
    )
    pinned = dict(
        line.split("==") for line in (place / "requirements.txt").read_text().splitlines()
    )
    assert {
        "numpy",
        "numba",
        "llvmlite",
        "pymunk",
        "exudyn",
    } <= pinned.keys() and "stiction" not in pinned
    assert all(version(name) == number for name, number in pinned.items())
    assert load_scene(str(place / "scenes" / f"{CASE}.toml")) == load_scene(CASE)
    text = (place / "README.md").read_text()
    assert (
        f"    .venv/bin/{origin['command']} --out again\n" in text
        and origin["source"] == source_digest()
        and origin["source"] in text
    )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "stiction validate"),
        ({"depth": "default", "engines": ["reference"]}, "stiction validate --engines reference"),
        (
            {"depth": "quick", "engines": ["reference", "my engine:A", "pymunk"], "workers": 2},
            "stiction validate --quick --engines 'my engine:A,pymunk' --workers 2",
        ),
    ],
)
def test_the_command_of_a_run(settings, words):
    assert campaign_command(Results((), {}, {}, settings)) == words


def test_data_in_full_precision(validation, report_folder):
    tables = data_tables(validation, stored_keys(validation))
    assert set(tables) == {"runs", "variants", "parameters", "truths", *validation.tables}
    for name, table in tables.items():
        stored = pd.read_parquet(report_folder / "data" / f"{name}.parquet")
        pd.testing.assert_frame_equal(
            stored, to_storable(table), check_dtype=False, check_exact=True
        )
        from_csv = pd.read_csv(report_folder / "data" / f"{name}.csv")
        for column in table.select_dtypes("float"):
            np.testing.assert_array_equal(
                from_csv[column].to_numpy(float), table[column].to_numpy(float)
            )
    reference = validation.records[0]
    runs = pd.read_parquet(report_folder / "data" / "runs.parquet").set_index("key")
    stored = pd.read_parquet(report_folder / runs.loc[reference.key, "trajectory"])
    pd.testing.assert_frame_equal(
        stored, reference.trajectory.to_frame(events=True, interpolated=True), check_exact=True
    )
    assert len(stored) == len(reference.trajectory.t) + 2 * len(reference.trajectory.events)
    events = pd.read_parquet(report_folder / "data" / "events.parquet")
    assert list(events[events["key"] == reference.key]["t"]) == [
        event.time for event in reference.trajectory.events
    ]
    assert runs["trajectory"].notna().sum() == 3


def test_columns_of_mixed_types_are_stored_as_text():
    stored = to_storable(
        pd.DataFrame({"figure": [0.5, "period 8 s", None], "error [m]": [1.0, None, 2.0]})
    )
    assert list(stored["figure"][:2]) == ["0.5", "period 8 s"] and stored["figure"].isna()[2]
    assert stored["error [m]"].dtype == float


@given(st.lists(st.text(min_size=1, max_size=40), min_size=1, max_size=8, unique=True))
def test_every_key_has_a_file_of_its_own(keys):
    trajectory = object()
    found = trajectory_files(
        (
            Record(key, CASE, variant("paper's scheme"), 1e-3, Outcome(key, "ok", trajectory))
            for key in keys
        ),
        set(keys),
    )
    names = [file.removeprefix("data/trajectories/") for file in found.values()]
    assert len({name.casefold() for name in names}) == len(keys)
    assert all(
        re.fullmatch(r"[A-Za-z0-9._=+-]+\.parquet", name) and len(name) < 255 for name in names
    )


def test_folder_of_something_else_is_refused(validation, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FolderRefused, match="no previous report"):
        write_report(report_of(validation), tmp_path)
    with pytest.raises(FolderRefused, match="found a file"):
        check_folder(tmp_path / "thesis.tex", REPORT)
    with pytest.raises(FolderRefused, match="found a file"):
        check_folder(tmp_path / "thesis.tex" / "run", REPORT)
    (tmp_path / "provenance.json").write_text("[]")
    with pytest.raises(FolderRefused, match="no previous report"):
        check_folder(tmp_path, REPORT)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["provenance.json", "thesis.tex"]


def test_previous_report_is_replaced_unless_something_was_added(tmp_path):
    empty, target = Results((), {}, {}), tmp_path / "run"
    target.mkdir()
    write_report(report_of(empty), target)
    first = (target / "provenance.json").stat().st_ino
    write_report(report_of(empty), target)
    assert (target / "provenance.json").stat().st_ino != first
    (target / "figures" / "mine.svg").write_text("")
    with pytest.raises(FolderRefused, match="figures/mine.svg"):
        write_report(report_of(empty), target)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_breaks_off_leaves_no_folder_and_keeps_the_previous(tmp_path, monkeypatch):
    target, empty = tmp_path / "run", Results((), {}, {})
    monkeypatch.setattr(
        stiction.reports.markdown.validation_report, "report_markdown", lambda *_: 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        write_report(report_of(empty), target)
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    write_report(report_of(empty), target)
    before = (target / "provenance.json").read_bytes()
    with pytest.raises(KeyboardInterrupt), run_folder(target, REPORT) as partial:
        assert partial.name.startswith(".run.partial-") and partial.parent == target.parent
        raise KeyboardInterrupt
    assert (target / "provenance.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
