"""A report comes out whole whatever happened to the engines, says what was lost and why, and loses nothing itself."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread

from report_material import CASE, LOST, unsaved_figures, validation_of

import stiction.reports.markdown.validation_report
from stiction.comparisons.campaigns.participants import variant
from stiction.comparisons.results import Results
from stiction.comparisons.environment import source_digest
from stiction.comparisons.truth import HIGH_PRECISION, PROVEN
from stiction.comparisons.variants import Record
from stiction.engines.isolation import Outcome
from stiction.reports import REPORT, FolderRefused, check_folder, write_report
from stiction.reports.figures import drawings
from stiction.reports.figures.motion import LINE, stick_phases
from stiction.comparisons.methods import stored_keys
from stiction.reports.figures.style import rc
from stiction.reports.markdown.findings import lines
from stiction.reports.markdown.losses import grouped, losses
from stiction.reports.markdown.sections import TITLES
from stiction.comparisons.presentation.cells import NULL, cell
from stiction.reports.markdown.tables import markdown
from stiction.reports.run_folder.data import data_tables, storable, trajectory_files
from stiction.reports.run_folder.overwriting import run_folder
from stiction.reports.run_folder.reproduce import command
from stiction.scenes import load_scene


def test_every_loss_is_named_with_its_reason(validation, report_folder):
    text = (report_folder / "report.md").read_text()
    first_page, failures = text[:text.index("\n## ")], (report_folder / "failures.md").read_text()
    assert f"3 of {len(validation.records)} runs came out" in " ".join(first_page.split())
    for i, (status, reason) in enumerate(LOST.items()):
        assert f"1 {'is of an engine that is not installed' if status == 'missing' else status}" in " ".join(first_page.split())
        assert f"engine {i}" in failures and reason.replace("|", "\\|") in failures
        assert f"engine {i}" in text[text.index("## What did not come out?"):]


def test_all_parts_are_there(report_folder):
    text = (report_folder / "report.md").read_text()
    titles = re.findall(r"^## (.*)$", text, re.M)
    assert titles == [*TITLES.values(), "Methods", "Parameters of the scenes", "Truths", "Provenance", "How to read this"]
    assert NULL in text
    files = {path.relative_to(report_folder).as_posix() for path in report_folder.rglob("*") if path.is_file()}
    assert files == set(json.loads((report_folder / "provenance.json").read_text())["files"])


def test_what_it_takes_to_make_the_numbers_again(report_folder):
    """Packages as installed, the catalogue's scene, the command, and the code's own digest."""
    place, origin = report_folder / "reproduce", json.loads((report_folder / "provenance.json").read_text())
    pinned = dict(line.split("==") for line in (place / "requirements.txt").read_text().splitlines())
    assert {"numpy", "numba", "llvmlite", "pymunk", "exudyn"} <= pinned.keys() and "stiction" not in pinned
    assert all(version(name) == number for name, number in pinned.items())
    assert load_scene(str(place / "scenes" / f"{CASE}.toml")) == load_scene(CASE)
    text = (place / "README.md").read_text()
    assert f"    .venv/bin/{origin['command']} --out again\n" in text and origin["source"] == source_digest() and origin["source"] in text


@pytest.mark.parametrize(("settings", "words"), [
    ({}, "stiction validate"), ({"depth": "default", "engines": ["reference"]}, "stiction validate --engines reference"),
    ({"depth": "quick", "engines": ["reference", "my engine:A", "pymunk"], "workers": 2}, "stiction validate --quick --engines 'my engine:A,pymunk' --workers 2")])
def test_the_command_of_a_run(settings, words):
    assert command(Results((), {}, {}, settings)) == words


@pytest.mark.parametrize("kept", ["nothing", "only failures", "only the reference"])
def test_report_comes_out_without_engines(kept, validation, lost_records, truths, tmp_path):
    records = {"nothing": [], "only failures": lost_records, "only the reference": [validation.records[0]]}[kept]
    chosen = validation_of(records, truths) if records else Results((), {}, {})
    with unsaved_figures():
        text = write_report(chosen, tmp_path / "run").read_text()
    assert {"nothing": "There were no runs", "only failures": "No run that could be compared", "only the reference": "every run came out"}[kept] in text
    drawn = list((tmp_path / "run" / "figures").glob("*.png"))
    assert bool(drawn) == (kept != "nothing")
    assert (tmp_path / "run" / "data" / "events.parquet").is_file()


def test_same_data_same_bytes(validation, report_folder, tmp_path):
    again = write_report(validation, tmp_path / "again").parent
    for path in (path for path in report_folder.rglob("*") if path.suffix in (".pdf", ".png", ".csv", ".md")):
        one, other = path.read_bytes(), (again / path.relative_to(report_folder)).read_bytes()
        if path.suffix == ".md":
            one, other = (re.sub(rb"(- date: |Run of ).*", b"", text) for text in (one, other))
        assert one == other, path.name


def test_figures_can_be_printed(report_folder):
    names = {path.stem for path in (report_folder / "figures").glob("*.png")}
    assert {"fig05-slider-bar-case-1-velocity-acceleration", "fig06-slider-bar-case-1-corner-forces",
            "fig07-slider-bar-case-1-driving-moment", "fig14-drift", "accuracy", "torque", "threshold", "mechanism-slider-bar-case-1",
            "difference-position-slider-bar-case-1", "drift-engines-slider-bar-case-1"} <= names
    for path in (report_folder / "figures").iterdir():
        if path.suffix == ".png":
            image = imread(path)
            assert image.shape[1] == 1370  # 174 mm at 200 dots per inch
            assert len(np.unique(image[..., :3] @ [1.0, 1e3, 1e6])) > 10  # colours
        else:
            content = path.read_bytes()
            assert content.startswith(b"%PDF") and b"/FontFile2" in content
            assert b"/Type3" not in content and b"CreationDate" not in content


def test_jumps_are_vertical_and_stick_is_shaded(validation, truths):
    phases = stick_phases(truths[CASE])
    # the events of case 1 by the reduced solution
    np.testing.assert_allclose(phases, [(0.0, 0.304719758), (7.600035087, 8.217361345)], atol=1e-8)
    with rc():
        figures = {drawing.name: drawing.figure for drawing in drawings(validation)}
    lines = figures["fig07-slider-bar-case-1-driving-moment"].axes[0].lines
    line = next(line for line in lines if line.get_color() == LINE["color"])
    t, torque = line.get_data()
    for event in truths[CASE].events:
        if abs(event.jump("motor.effort")) > 1e-6:
            at = np.flatnonzero(np.abs(t - event.time) < 1e-7)
            assert len(at) >= 2 and np.ptp(torque[at]) == pytest.approx(abs(event.jump("motor.effort")), abs=1e-6)
    for name, figure in figures.items():
        seen = [ax for ax in figure.axes if ax.axison]
        assert figure.get_supxlabel() or all(ax.get_xlabel() for ax in seen if ax.get_subplotspec().is_last_row())
        assert "[" in figure.get_supylabel() or all("[" in ax.get_ylabel() for ax in seen if ax.get_subplotspec().is_first_col()) or name == "threshold"


def test_data_in_full_precision(validation, report_folder):
    tables = data_tables(validation, stored_keys(validation))
    assert set(tables) == {"runs", "variants", "parameters", "truths", *validation.tables}
    for name, table in tables.items():
        stored = pd.read_parquet(report_folder / "data" / f"{name}.parquet")
        pd.testing.assert_frame_equal(stored, storable(table), check_dtype=False, check_exact=True)
        from_csv = pd.read_csv(report_folder / "data" / f"{name}.csv")
        for column in table.select_dtypes("float"):
            np.testing.assert_array_equal(from_csv[column].to_numpy(float), table[column].to_numpy(float))
    reference = validation.records[0]
    runs = pd.read_parquet(report_folder / "data" / "runs.parquet").set_index("key")
    stored = pd.read_parquet(report_folder / runs.loc[reference.key, "trajectory"])
    pd.testing.assert_frame_equal(stored, reference.trajectory.to_frame(events=True), check_exact=True)
    assert len(stored) == len(reference.trajectory.t) + 2 * len(reference.trajectory.events)
    events = pd.read_parquet(report_folder / "data" / "events.parquet")
    assert list(events[events["key"] == reference.key]["t"]) == [event.time for event in reference.trajectory.events]
    assert runs["trajectory"].notna().sum() == 3


def test_columns_of_mixed_types_are_stored_as_text():
    stored = storable(pd.DataFrame({"figure": [0.5, "period 8 s", None], "error [m]": [1.0, None, 2.0]}))
    assert list(stored["figure"][:2]) == ["0.5", "period 8 s"] and stored["figure"].isna()[2]
    assert stored["error [m]"].dtype == float


@given(st.lists(st.text(min_size=1, max_size=40), min_size=1, max_size=8, unique=True))
def test_every_key_has_a_file_of_its_own(keys):
    trajectory = object()
    found = trajectory_files((Record(key, CASE, variant("paper's scheme"), 1e-3, Outcome(key, "ok", trajectory)) for key in keys), set(keys))
    names = [file.removeprefix("data/trajectories/") for file in found.values()]
    assert len({name.casefold() for name in names}) == len(keys)
    assert all(re.fullmatch(r"[A-Za-z0-9._=+-]+\.parquet", name) and len(name) < 255 for name in names)


def test_losses_inside_a_comparison_and_early_ends_count(validation):
    run = validation.records[1]
    early = replace(run.outcome, value=replace(run.trajectory, termination="step size underflow"))
    broken = pd.DataFrame({"scene": [CASE], "variant": ["other"], "parameter": ["dt"], "step": [0.01],
                           "status": ["crashed"], "reason": ["SIGABRT"]})
    changed = replace(validation, records=(replace(run, outcome=early),), tables={"threshold": broken})
    lost = losses(changed)
    assert list(zip(lost["status"], lost["reason"], lost["table"])) == [
        ("incomplete", "step size underflow", "runs"), ("crashed", "SIGABRT", "threshold")]
    assert list(grouped(lost)["runs"]) == [1, 1]
    assert "Some runs stopped early" in " ".join(lines(changed))


def test_folder_of_something_else_is_refused(validation, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FolderRefused, match="no previous report"):
        write_report(validation, tmp_path)
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
    write_report(empty, target)
    first = (target / "provenance.json").stat().st_ino
    write_report(empty, target)
    assert (target / "provenance.json").stat().st_ino != first
    (target / "figures" / "mine.png").write_text("")
    with pytest.raises(FolderRefused, match="figures/mine.png"):
        write_report(empty, target)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_breaks_off_leaves_no_folder_and_keeps_the_previous(tmp_path, monkeypatch):
    target, empty = tmp_path / "run", Results((), {}, {})
    monkeypatch.setattr(stiction.reports.markdown.validation_report, "pages", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_report(empty, target)
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    write_report(empty, target)
    before = (target / "provenance.json").read_bytes()
    with pytest.raises(KeyboardInterrupt), run_folder(target, REPORT) as partial:
        assert partial.name.startswith(".run.partial-") and partial.parent == target.parent
        raise KeyboardInterrupt
    assert (target / "provenance.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("column, value, shown", [
    ("position error [m]", 1.2345e-7, "1.2e-07"), ("F0 with stick [N]", 4.21195632175, "4.211956322"),
    ("window [s]", 8.0, "8"), ("kind", "stick", "stick"), ("reason", "a | b\nc", "a | b c"),
    ("bounded", np.True_, "yes"), ("error [N]", float("nan"), "–"), ("paper [N]", None, NULL), ("paper's scheme", None, "–"),
    ("events missed", 3.0, "3"),
    ("error [m]", float("inf"), "inf"), ("jump [N m]", -0.123456789, "-0.123457")])
def test_values_as_displayed(column, value, shown):
    assert cell(column, value) == shown


def test_tables_without_rows_are_said_to_be_so():
    assert markdown(pd.DataFrame({"a": []})) == "(no rows)"


def test_truths_are_listed_the_best_tier_first():
    table = pd.DataFrame({"truth": ["a", "b", "b"], "truth tier": [HIGH_PRECISION, PROVEN, PROVEN], "position uncertainty [m]": [1e-12, 2e-14, 3e-14],
                          "event time uncertainty [s]": [np.nan, 1e-15, np.nan]})
    [text] = stiction.reports.markdown.validation_report._truths(table)
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    assert rows[0] == ["truth", "tier", "position [m]", "events [s]"]
    assert rows[2:] == [["b", PROVEN, "± 3.0e-14", "± 1.0e-15"], ["a", HIGH_PRECISION, "± 1.0e-12", "–"]]
