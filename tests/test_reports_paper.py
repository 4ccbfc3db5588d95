"""A run read back is the run; a paper of it is the same bytes twice; every number in it leads to its row and its trajectory."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import CASE, validation_of
from typer.testing import CliRunner

from comparisons.validation import Validation
from reports import write_report
from reports.figures import drawings
from reports.figures.style import rc
from reports.paper import latex, write_paper
from reports.paper.sheets import KEY, sheets
from reports.stored import StoredRun, read_run
from reports.tables import cell, with_uncertainty
from reports.trace import key_of, resolve
from stiction.cli.app import app

POINTS_PER_MM = 72 / 25.4


@pytest.fixture(scope="module")
def whole(validation) -> Validation:
    """With comparisons of cost, and a timed run of its own."""
    run = validation.records[1]
    timed = replace(run, key=f"{run.key}/no gravity")
    cost = validation.tables["accuracy"].assign(**{"stepping [s]": 0.5})
    effects = pd.DataFrame([{**timed.describe(), "effect": "no gravity", "position change [m]": 0.25, "hlcp [-]": 12}])
    return replace(validation, tables={**validation.tables, "cost": cost, "effects": effects}, timed=(timed,))


@pytest.fixture(scope="module")
def run(whole, tmp_path_factory) -> StoredRun:
    folder = tmp_path_factory.mktemp("stored") / "run"
    write_report(whole, folder)
    return read_run(folder)


@pytest.fixture(scope="module")
def paper(run, tmp_path_factory):
    return write_paper(run, tmp_path_factory.mktemp("paper") / "double").parent


def test_what_is_read_is_what_was_written(run, whole):
    read = run.validation()
    assert read.truths.keys() == whole.truths.keys() and read.tables.keys() == whole.tables.keys()
    for one, other in zip(whole.records, read.records, strict=True):
        assert (one.key, one.scene, one.step, one.variant.label) == (other.key, other.scene, other.step, other.variant.label)
        assert one.describe() == pytest.approx({**other.describe()}, nan_ok=True) or one.describe() == other.describe()
        if one.trajectory is not None:
            np.testing.assert_array_equal(one.trajectory.t, other.trajectory.t)
            assert one.trajectory.columns.keys() == other.trajectory.columns.keys()
            for name, values in one.trajectory.columns.items():
                np.testing.assert_array_equal(values, other.trajectory[name])
            assert one.trajectory.events == other.trajectory.events
    truth, stored = whole.truths[CASE], read.truths[CASE]
    assert stored.events == truth.events and (stored.tier, stored.t_end) == (truth.tier, truth.t_end)
    assert (run.folder / resolve(run, "E1").files[0]).is_file()  # a timed run has a trajectory of its own


def test_figures_of_the_stored_run_are_those_of_the_validation(run, whole):
    with rc():
        ours, theirs = ({drawing.name: drawing for drawing in drawings(source)} for source in (whole, run.validation()))
    assert ours.keys() == theirs.keys()
    for name, drawing in ours.items():
        assert drawing.caption == theirs[name].caption
        for ax, other in zip(drawing.figure.axes, theirs[name].figure.axes, strict=True):
            for line, same in zip(ax.lines, other.lines, strict=True):
                np.testing.assert_array_equal(np.asarray(line.get_data(), float), np.asarray(same.get_data(), float))


def test_same_run_same_bytes(run, paper, tmp_path):
    again = write_paper(run, tmp_path / "again").parent
    names = [path.relative_to(paper) for path in sorted(paper.rglob("*")) if path.is_file()]
    assert names == [path.relative_to(again) for path in sorted(again.rglob("*")) if path.is_file()]
    for name in names:
        assert (paper / name).read_bytes() == (again / name).read_bytes(), name


@pytest.mark.parametrize("column, millimetres", [("double", 174), ("single", 84)])
def test_figures_are_as_wide_as_the_columns_of_a_page_and_vectors(column, millimetres, run, paper, tmp_path):
    written = paper if column == "double" else write_paper(run, tmp_path / "narrow", column).parent
    figures = list((written / "figures").iterdir())
    assert len(figures) > (10 if column == "single" else 5)
    for figure in figures:
        content = figure.read_bytes()
        [box] = re.findall(rb"/MediaBox \[ ([\d. ]+) \]", content)
        assert float(box.split()[2]) == pytest.approx(millimetres * POINTS_PER_MM, abs=0.5)
        assert b"/FontFile2" in content and b"/Type3" not in content and b"/Subtype /Image" not in content


def test_the_folder_lists_its_files_and_is_the_run_s(run, paper):
    origin = json.loads((paper / "provenance.json").read_text())
    assert set(origin["files"]) == {path.relative_to(paper).as_posix() for path in paper.rglob("*") if path.is_file()}
    assert {name: origin[name] for name in ("date", "versions", "campaign")} == {name: run.origin[name] for name in ("date", "versions", "campaign")}
    pdf = (paper / "paper.pdf").read_bytes()
    assert pdf.startswith(b"%PDF") and run.origin["date"][:19].encode() in pdf  # XMP, not compressed


def test_every_key_leads_to_its_row_and_trajectory(run, paper):
    index = pd.read_csv(paper / "trace.csv").set_index(["table", KEY])
    for file in sorted((paper / "tables").glob("*.tex")):
        body = file.read_text().partition(r"\midrule")[2].partition(r"\bottomrule")[0]
        keys = re.findall(r"& ([^&]*?) \\\\$", body, re.M)
        assert keys == list(pd.read_csv(file.with_suffix(".csv"))[KEY]) and len(set(keys)) == len(keys)
        for key in keys:
            source = resolve(run, key)
            assert index.loc[(f"tables/{file.name}", key), "data"] == f"data/{source.table}.csv"
            from_csv = pd.read_csv(run.folder / "data" / f"{source.table}.csv").iloc[source.rows.index[0] - 1:source.rows.index[-1]]
            assert len(from_csv) == len(source.rows)
            if "key" in source.rows:
                assert list(from_csv["key"]) == list(source.rows["key"])
            assert all((run.folder / name).is_file() for name in source.files)
            if "status" in source.rows and source.table != "threshold" and (source.rows["status"] == "ok").all():
                assert any(name.startswith("data/trajectories/") for name in source.files)
                assert {run for run in source.rows["key"]} == set(index.loc[(f"tables/{file.name}", key), "runs"].split("; "))


def test_numbers_of_a_table_are_those_of_the_rows(run):
    for sheet in sheets(run, run.validation()):
        assert list(sheet.frame)[-1] == KEY
        for printed, row in zip(sheet.cells(), sheet.frame.to_dict("records"), strict=True):
            source = resolve(run, row[KEY])
            for name, text in zip(sheet.shown, printed, strict=True):
                if name in source.rows and name != KEY and len(source.rows) == 1:
                    assert text == cell(name, with_uncertainty(source.rows)[name].iloc[0])
    worst = next(sheet for sheet in sheets(run, run.validation()) if sheet.topic == "torque").frame.iloc[0]
    assert worst["largest jump error [N m]"] == resolve(run, worst[KEY]).rows["jump error [N m]"].abs().max()


def test_what_is_cited_is_in_the_references(paper):
    entries = set(re.findall(r"^@\w+\{(\w+),", (paper / "references.bib").read_text(), re.M))
    cited = {key for group in re.findall(r"\\cite\{([^}]*)\}", (paper / "methods.tex").read_text()) for key in group.split(",")}
    assert {"zhuang2014", "lemke1965", "baumgarte1972"} <= cited <= entries
    assert "0.1.0" in (paper / "methods.tex").read_text()


def test_paper_without_any_run_that_came_out(lost_records, truths, tmp_path):
    for name, few in (("lost", validation_of(lost_records, truths)), ("nothing", Validation((), {}, {}))):
        write_report(few, tmp_path / name)
        assert write_paper(read_run(tmp_path / name), tmp_path / f"{name} paper").is_file()


@given(st.text(st.characters(exclude_categories=("C", "Z"))))
def test_latex_of_any_text_has_no_command_of_its_own(text):
    plain = re.sub(r"\\[&%$#_{}]|\\text\w+\{\}|\$(\^2|-?[\d.]+\\times10\^\{-?\d+\})\$", "", latex.escape(text))
    assert not set(plain) & set("\\&%$#_{}~^<>|\"")


@pytest.mark.parametrize("text, expected", [
    ("5 % of m/s^2 & a_b", r"5 \% of m/s$^2$ \& a\_b"), ("rtol = 1e-09", r"rtol = $1\times10^{-9}$"), ("–", "--")])
def test_latex_of(text, expected):
    assert latex.escape(text) == expected


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex on this machine")
def test_latex_compiles(paper, tmp_path):
    shutil.copytree(paper, tmp_path, dirs_exist_ok=True)
    ended = subprocess.run(["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper"], cwd=tmp_path, capture_output=True, timeout=120)
    assert ended.returncode == 0, ended.stdout.decode(errors="replace")[-2000:]


def test_key_of_rows_that_do_not_follow_each_other():
    assert (key_of("torque", [4, 3, 5]), key_of("cost", [7])) == ("J3-5", "C7")
    with pytest.raises(ValueError, match="follow each other"):
        key_of("torque", [1, 3])


@pytest.mark.parametrize("key, message", [("A0", "rows 1 to"), ("A9999", "rows 1 to"), ("A3-1", "rows 1 to"), ("Q1", r"found 'Q1'.*A \(accuracy\)"),
                                          ("12", "a letter and a row"), ("", "a letter and a row")])
def test_keys_that_lead_nowhere(key, message, run):
    with pytest.raises(ValueError, match=message):
        resolve(run, key)


def test_commands(run, tmp_path, monkeypatch):
    runner = CliRunner()
    ended = runner.invoke(app, ["trace", str(run.folder), "A1"])
    assert ended.exit_code == 0
    assert "data/accuracy.csv, row 1" in ended.output and "setting rtol" in ended.output and "0.1.0" in ended.output
    for arguments, message in ((["trace", str(run.folder), "Z1"], "found 'Z1'"), (["trace", str(tmp_path), "A1"], "expected a run folder"),
                               (["paper", str(run.folder), "--out", str(tmp_path), "--width", "triple"], "--width: found 'triple'"),
                               (["paper", str(run.folder), "--out", str(run.folder / "report.md")], "found a file"),
                               (["page", str(run.folder), "--out", str(tmp_path / "page.pdf")], "ends in .html"),
                               (["page", str(run.folder / "report.md"), "--out", str(tmp_path / "x.html")], "expected a history")):
        ended = runner.invoke(app, arguments)
        assert ended.exit_code == 2 and message in ended.stderr, ended.output
    assert not list(tmp_path.iterdir())


def test_a_run_folder_that_lost_a_file_is_named(run, tmp_path):
    shutil.copytree(run.folder, tmp_path / "run")
    lost = next((tmp_path / "run" / "data" / "trajectories").iterdir())
    lost.unlink()
    with pytest.raises(ValueError, match=re.escape(str(lost))):
        read_run(tmp_path / "run")
