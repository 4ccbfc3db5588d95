"""A run read back is the run; a paper of it is the same bytes twice; every number in it leads to its row and its trajectory."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import invoke
from report_material import CASE, hard_table, save_one, unsaved_figures, validation_of

from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import OWN_CPU
from stiction.comparisons.measures.equal_error import equal_error
from stiction.reports import report_of, write_report
from stiction.reports.paper import folder, write_paper
from stiction.reports.run_folder.stored_run import StoredRun, read_run
from stiction.reports.run_folder.trace import resolve, source_of


@pytest.fixture(scope="module")
def whole(validation) -> Results:
    """With comparisons of cost, and a timed run of its own."""
    run = validation.records[1]
    timed = replace(run, key=f"{run.key}/no gravity")
    cost = validation.tables["accuracy"].assign(**{"stepping_time": 0.5})
    samples = pd.DataFrame(
        [
            {"key": key, "round": number, OWN_CPU: 1e-3 * number, "cpu_time": 2e-3 * number}
            for key in cost["key"]
            for number in range(1, 6)
        ]
    )
    effects = pd.DataFrame(
        [{**timed.describe(), "effect": "no gravity", "position_change": 0.25, "counter:hlcp": 12}]
    )
    return replace(
        validation,
        tables={
            **validation.tables,
            "cost": cost,
            "equal-error": equal_error(cost, samples),
            "effects": effects,
            "hard": hard_table(),
        },
        timed=(timed,),
    )


@pytest.fixture(scope="module")
def run(whole, tmp_path_factory) -> StoredRun:
    place = tmp_path_factory.mktemp("stored") / "run"
    with unsaved_figures():  # a paper draws its own
        write_report(report_of(whole), place)
    return read_run(place)


@pytest.fixture(scope="module")
def paper(run, tmp_path_factory):
    """With one figure for all: they take most of the time, and `report_folder` has each of them saved."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folder, "save_all", save_one)
        return write_paper(run, tmp_path_factory.mktemp("paper") / "double").parent


def test_what_is_read_is_what_was_written(run, whole):
    read = run.validation()
    assert read.truths.keys() == whole.truths.keys() and read.tables.keys() == whole.tables.keys()
    for one, other in zip(whole.records, read.records, strict=True):
        assert (one.key, one.scene, one.step, one.variant.label) == (
            other.key,
            other.scene,
            other.step,
            other.variant.label,
        )
        assert (
            one.describe() == pytest.approx({**other.describe()}, nan_ok=True)
            or one.describe() == other.describe()
        )
        if one.trajectory is not None:
            np.testing.assert_array_equal(one.trajectory.t, other.trajectory.t)
            assert one.trajectory.columns.keys() == other.trajectory.columns.keys()
            for name, values in one.trajectory.columns.items():
                np.testing.assert_array_equal(values, other.trajectory[name])
            assert one.trajectory.events == other.trajectory.events
    truth, stored = whole.truths[CASE], read.truths[CASE]
    assert stored.events == truth.events and (stored.tier, stored.t_end) == (
        truth.tier,
        truth.t_end,
    )
    tables = report_of(read).tables
    effect = resolve(
        run, tables, "effects:1"
    )  # made to be timed alone: its trajectory is not stored, and its row says how to make it again
    assert effect.files == () and effect.rows.iloc[0][AGAIN].startswith("stiction ")


def test_same_run_same_bytes(run, paper, tmp_path, monkeypatch):
    """But for the figures, whose bytes are a matter of `test_same_data_same_bytes`: they are saved in the same way."""
    monkeypatch.setattr(
        folder,
        "save_all",
        lambda drawings, place, *_: shutil.copytree(paper / "figures", place, dirs_exist_ok=True),
    )
    again = write_paper(run, tmp_path / "again").parent
    names = [path.relative_to(paper) for path in sorted(paper.rglob("*")) if path.is_file()]
    assert names == [path.relative_to(again) for path in sorted(again.rglob("*")) if path.is_file()]
    for name in names:
        assert (paper / name).read_bytes() == (again / name).read_bytes(), name


def test_the_folder_lists_its_files_and_is_the_run_s(run, paper):
    origin = json.loads((paper / "provenance.json").read_text())
    assert set(origin["files"]) == {
        path.relative_to(paper).as_posix() for path in paper.rglob("*") if path.is_file()
    }
    assert (paper / "reproduce" / "README.md").read_bytes() == (
        run.folder / "reproduce" / "README.md"
    ).read_bytes()
    assert {name: origin[name] for name in ("date", "versions", "campaign")} == {
        name: run.origin[name] for name in ("date", "versions", "campaign")
    }
    pdf = (paper / "paper.pdf").read_bytes()
    assert (
        pdf.startswith(b"%PDF") and run.origin["date"][:19].encode() in pdf
    )  # XMP, not compressed


def test_every_key_leads_to_its_row_and_trajectory(run, paper):
    tables = report_of(run.validation()).tables
    index = pd.read_csv(paper / "trace.csv").set_index(["table", "key"])
    for file in sorted((paper / "tables").glob("*.tex")):
        body = file.read_text().partition(r"\midrule")[2].partition(r"\bottomrule")[0]
        found = re.findall(r"& ([^&]*?) \\\\$", body, re.M)
        assert found == list(pd.read_csv(file.with_suffix(".csv"))["key"]) and found
        for key in found:
            source = resolve(run, tables, key)
            assert index.loc[(f"tables/{file.name}", key), "data"] == source.place
            from_csv = pd.read_csv(run.folder / "data" / f"{source.table}.csv").iloc[
                source.rows.index - 1
            ]
            if "key" in source.rows:
                assert list(from_csv["key"]) == list(source.rows["key"])
            assert all((run.folder / name).is_file() for name in source.files)
            if (
                {"key", "status"} <= set(source.rows)
                and source.table != "threshold"
                and (source.rows["status"] == "ok").all()
            ):
                again = (
                    source.rows["rerun_command"]
                    if "rerun_command" in source.rows
                    else pd.Series(dtype=str)
                )
                assert (
                    any(name.startswith("data/trajectories/") for name in source.files)
                    or again.notna().all()
                    and len(again)
                )
                assert {run for run in source.rows["key"]} == set(
                    index.loc[(f"tables/{file.name}", key), "runs"].split("; ")
                )


def test_what_is_cited_is_in_the_references(paper):
    entries = set(re.findall(r"^@\w+\{(\w+),", (paper / "references.bib").read_text(), re.M))
    cited = {
        key
        for group in re.findall(r"\\cite\{([^}]*)\}", (paper / "methods.tex").read_text())
        for key in group.split(",")
    }
    assert (
        {"zhuang2014", "lemke1965", "baumgarte1972", "hairer1993", "numpy", "scipy", "stiction"}
        <= cited
        <= entries
    )
    assert "0.1.0" in (paper / "methods.tex").read_text()


def test_each_figure_and_table_is_referred_to_once_labelled(paper):
    """Tables that are not in the paper are only in the folder."""
    main = (paper / "paper.tex").read_text()
    tables = re.findall(r"\\input\{tables/([^}]*)\}", main)
    text = "".join(
        (
            main,
            (paper / "methods.tex").read_text(),
            *((paper / "tables" / f"{name}.tex").read_text() for name in tables),
        )
    )
    labels, references = (
        re.findall(r"\\label\{([^}]*)\}", text),
        re.findall(r"\\ref\{([^}]*)\}", text),
    )
    files = [f"fig:{file.stem}" for file in (paper / "figures").iterdir()] + [
        f"tab:{name}" for name in tables
    ]
    assert sorted(labels) == sorted(references) == sorted(files)
    assert sorted(re.findall(r"\\begin\{(.*?)\}", text)) == sorted(
        re.findall(r"\\end\{(.*?)\}", text)
    )
    braces = re.sub(r"\\[{}]", "", text)
    assert braces.count("{") == braces.count("}")
    assert len(tables) == len(set(tables)) > 2 and set(tables) < {
        file.stem for file in (paper / "tables").glob("*.tex")
    }


def test_numbers_of_a_table_are_those_of_the_rows(run):
    """A cell that is a column of the data, of one row: the same number in the row that its key leads to."""
    compared = 0
    for said in report_of(run.validation()).sections.values():
        for view in said.tables:
            for number, (_, row) in enumerate(view.frame.iterrows(), start=1):
                source = source_of(run, view, number)
                for column in view.columns:
                    if (
                        column.name in source.rows
                        and column.name in row
                        and len(source.rows) == 1
                        and isinstance(row[column.name], float)
                    ):
                        assert row[column.name] == source.rows[column.name].iloc[0] or pd.isna(
                            row[column.name]
                        )
                        compared += 1
    assert compared > 5


def test_paper_without_any_run_that_came_out(paper, lost_records, truths, tmp_path, monkeypatch):
    some = next((paper / "figures").iterdir())
    monkeypatch.setattr(
        folder,
        "save_all",
        lambda drawings, place, *_: [
            shutil.copy(some, place / f"{drawing.name}.pdf") for drawing in drawings
        ],
    )
    for name, few in (
        ("lost", validation_of(lost_records, truths)),
        ("nothing", Results((), {}, {})),
    ):
        with unsaved_figures():
            write_report(report_of(few), tmp_path / name)
        assert write_paper(read_run(tmp_path / name), tmp_path / f"{name} paper").is_file()


needs_latex = pytest.mark.skipif(
    shutil.which("pdflatex") is None or shutil.which("bibtex") is None,
    reason="no pdflatex and bibtex on this machine",
)


@needs_latex
def test_latex_compiles_without_overfull_lines_and_with_all_references(paper, tmp_path):
    shutil.copytree(paper, tmp_path, dirs_exist_ok=True)
    for command in (["pdflatex"], ["bibtex"], ["pdflatex"], ["pdflatex"]):
        options = ["-interaction=nonstopmode", "-halt-on-error"] if command == ["pdflatex"] else []
        ended = subprocess.run(
            [*command, *options, "paper"], cwd=tmp_path, capture_output=True, timeout=600
        )
        assert ended.returncode == 0, ended.stdout.decode(errors="replace")[-2000:]
    log = (tmp_path / "paper.log").read_text(errors="replace")
    assert not re.findall(r"Overfull \\hbox.*|.*undefined.*|.*multiply.defined.*", log)


def test_commands(run, tmp_path, monkeypatch):
    ended = invoke("trace", run.folder, "accuracy-slider-bar-case-1:1")
    assert (
        "data/accuracy.csv, row 1" in ended.output
        and "setting rtol" in ended.output
        and "0.1.0" in ended.output
    )
    for arguments, message in (
        (["trace", str(run.folder), "Z1"], "found 'Z1'"),
        (["trace", str(tmp_path), "accuracy:1"], "expected a run folder"),
        (
            ["paper", str(run.folder), "--out", str(tmp_path), "--width", "triple"],
            "--width: found 'triple'",
        ),
        (["paper", str(run.folder), "--out", str(run.folder / "report.md")], "found a file"),
        (["page", str(run.folder), "--out", str(tmp_path / "page.pdf")], "ends in .html"),
        (
            ["page", str(run.folder / "report.md"), "--out", str(tmp_path / "x.html")],
            "expected a history",
        ),
    ):
        ended = invoke(*arguments, exit_code=2)
        assert message in ended.stderr, ended.output
    assert not list(tmp_path.iterdir())


def test_a_run_folder_that_lost_a_file_is_named(run, tmp_path):
    shutil.copytree(run.folder, tmp_path / "run")
    lost = next((tmp_path / "run" / "data" / "trajectories").iterdir())
    lost.unlink()
    with pytest.raises(ValueError, match=re.escape(str(lost))):
        read_run(tmp_path / "run")
