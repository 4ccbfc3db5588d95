"""A new question is one new file: it appears in the commands, the main job, the report, the paper and the page without another line."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pandas as pd
import pytest
from conftest import invoke
from report_material import save_one, unsaved_figures

from stiction.comparisons import studies as package
from stiction.comparisons import validation as campaign
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.results import Results
from stiction.comparisons.studies import studies
from stiction.reports import report_of, write_report
from stiction.reports.page import write_run_page
from stiction.reports.page_one import answer_lines
from stiction.reports.paper import folder, write_paper
from stiction.reports.run_folder.stored_run import read_run

TOY = r'''
"""How far a block slides until it rests: v^2 / (2 mu g)."""

import numpy as np
import pandas as pd

from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.presentation import Axis, Chart, Panel, Series, Headline, Presentation, Column, row_of, view
from stiction.comparisons.bench.study import Study, Tables
from stiction.engines import Task


def slide(speed):
    return speed ** 2 / (2 * 0.25 * 9.81)


def plan(scope):
    speeds = (1.0, 2.0, 3.0)
    tasks = tuple(Task(f"toy/{speed:g}", slide, (speed,)) for speed in speeds)
    return Comparison(tasks, lambda outcomes: Tables({"toy": pd.DataFrame(
        {"speed [m/s]": speeds, "path [m]": [outcome.value for outcome in outcomes], "status": "ok", "reason": ""})}))


def present(results):
    table = results.table("toy")
    if table.empty:
        return Presentation()
    longest = row_of("toy", table, table["path [m]"].idxmax())["path [m]"]
    panel = Panel("", Axis("speed [m/s]"), Axis("path [m]"), [Series("path", table["speed [m/s]"].to_numpy(), table["path [m]"].to_numpy(), points=True)])
    columns = (Column("speed [m/s]", "speed", "m/s", form="g"), Column("path [m]", "path", "cm", scale=100.0, form=".4g"))
    return Presentation(rows={"longest": longest}, headlines=(Headline("slides [m]", {"reference": str(longest)}),),
                        tables=(view("toy", table, columns),), figures=(Chart("toy-paths", [panel]),))


TEXT = """
{% block answer %}The block slides {{ longest | number }} m at most.{% endblock %}
{% block figures %}{% call caption("toy-paths") %}Paths grow with the square of the speed.{% endcall %}{% endblock %}
{% block tables %}{% call caption("toy") %}Paths by speed.{% endcall %}{% endblock %}
{% block notes %}
- Friction is dry.
{% endblock %}
"""


STUDY = Study("toy", "Toy", "How far does a block slide?", present, plan, takes_scene=False, takes=frozenset(), text=TEXT)
'''
ANSWER, CELL, QUESTION = (
    "The block slides 1.83486 m at most.",
    "183.5",
    "How far does a block slide?",
)
"""9 / (2 * 0.25 * 9.81) = 1.834862.. m."""


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Iterator[None]:
    """One more file among the studies."""
    folder = tmp_path_factory.mktemp("more studies")
    (folder / "toy.py").write_text(TOY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(package, "__path__", [*package.__path__, str(folder)])
        studies.cache_clear()
        yield
    studies.cache_clear()


@pytest.fixture(scope="module")
def run(toy, validation, tmp_path_factory):
    """Of the main job, whose other studies are left out, together with the made-up results of the other tests."""
    from conftest import here

    [study] = [study for study in studies() if study.name == "toy"]
    told = []
    with here(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "studies", lambda: (study,))
        patch.setattr(campaign, "variants", lambda *_: ())
        made = campaign.validate(
            depth=Depth.QUICK,
            engines=[],
            on_study=lambda study, so_far: told.append((study.name, len(so_far.table("toy")))),
        )
    assert told == [("toy", 3)]
    results = replace(validation, tables={**validation.tables, **made.tables})
    place = tmp_path_factory.mktemp("toy") / "run"
    with unsaved_figures():
        write_report(report_of(results), place)
    return read_run(place)


def test_it_is_a_command(toy, in_this_process, tmp_path):
    assert "toy" in invoke("compare --help").stdout
    ended = invoke("compare toy --out", tmp_path / "toy.csv", "--plot", tmp_path / "toy.svg")
    assert all(
        text in ended.stdout
        for text in (ANSWER, "Paths by speed.", "path [cm]", CELL, "Friction is dry.")
    )
    assert (
        pd.read_csv(tmp_path / "toy.csv")["path [m]"].iloc[2] == 9 / (2 * 0.25 * 9.81)
        and (tmp_path / "toy.svg").stat().st_size > 1000
    )
    refused = invoke("compare toy --drive motor", exit_code=2)
    assert "`compare toy` does not have this option" in " ".join(refused.stderr.split())


def test_it_is_in_the_report_and_on_the_terminal(run):
    text = (run.folder / "report.md").read_text()
    page, section = (
        text.partition("\n## ")[0],
        text.partition(f"\n## {QUESTION}\n")[2].partition("\n## ")[0],
    )
    assert f"**Toy.** {ANSWER}" in page and "slides [m]" in page and "1.83486" in page
    assert all(
        part in section
        for part in (
            ANSWER,
            "Paths by speed.",
            "path [cm]",
            CELL,
            "- Friction is dry.",
            "(figures/toy-paths.svg)",
        )
    )
    assert (run.folder / "figures" / "toy-paths.svg").is_file() and len(run.tables["toy"]) == 3
    results = run.validation()
    assert f"Toy: {ANSWER}" in list(answer_lines(report_of(results)))


def test_it_is_in_the_paper(run, tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "save_all", partial(save_one, name="toy-paths"))
    paper = write_paper(run, tmp_path / "paper").parent
    assert (
        rf"\textbf{{Toy.}} {ANSWER}" in (paper / "paper.tex").read_text()
        and rf"\section{{{QUESTION}}}" in (paper / "paper.tex").read_text()
    )
    assert f"& {CELL} & toy:3" in (paper / "tables" / "toy.tex").read_text()
    [section] = [
        section
        for section in json.loads((paper / "paper.json").read_text())["sections"]
        if section["title"] == QUESTION
    ]
    assert (
        section["tables"][0]["rows"][2][-2:] == [CELL, "toy:3"]
        and section["figures"][0]["name"] == "toy-paths"
    )
    assert (paper / "figures" / "toy-paths.pdf").stat().st_size > 1000 and (
        paper / "paper.pdf"
    ).read_bytes().startswith(b"%PDF")


def test_it_is_on_the_page_and_its_keys_lead_to_its_rows(run, tmp_path):
    write_run_page(run, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert all(
        part in page
        for part in (
            ANSWER,
            QUESTION,
            CELL,
            'href="#key-toy-3"',
            'id="key-toy-3"',
            "data/toy.csv, row 3",
            'aria-label="toy-paths"',
        )
    )
    ended = invoke("trace", run.folder, "toy:3")
    assert str(9 / (2 * 0.25 * 9.81)) in ended.stdout


def test_without_its_tables_it_is_silent(toy):
    nothing = Results((), {}, {})
    assert "toy" not in [study.name for study in report_of(nothing).sections]
