"""Page one: every number is recomputed from the data of a written report, and nothing else has digits."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_runs import CASES, VARIANTS, about, is_cell
from made_up_runs import record as made_up
from report_material import hard_table, record, unsaved_figures

from stiction.comparisons.bench.methods import methods
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Variant
from stiction.engines.registry import own_methods
from stiction.reports import report_of, write_report
from stiction.reports.markdown.tables import WIDTH as TABLE_WIDTH
from stiction.reports.markdown.tables import fit_table
from stiction.reports.page_one import (
    TITLE,
    answer_lines,
    headline_table,
    page_one,
    page_one_markdown,
)
from stiction.reports.recommendation import recommendation
from stiction.reports.report import Report
from stiction.reports.text import Number
from stiction.uncertain import Uncertain

FIXED = ("2014", "1 mm", "1 ms")
"""Digits that are no results: the year of the paper, the error to which times are given, the step of the comparison."""


def equal_error_table() -> pd.DataFrame:
    """Times to an error of 1 mm; those of the reference in two cases."""
    rows = [
        ("reference", 1.234e-3, True),
        ("paper's scheme", 0.0567, False),
        ("other", 0.25, False),
        ("reference", 3.12e-3, True),
    ]
    return pd.DataFrame(
        [
            {
                "variant": variant,
                "scene": f"slider-bar-case-{1 + (seconds == 3.12e-3)}",
                "quantity": "position",
                "error": 1e-3,
                "cpu_time": seconds,
                "is_bound": bound,
                "timing": "timed once" if variant == "paper's scheme" else "",
            }
            for variant, seconds, bound in rows
        ]
    )


@pytest.fixture(scope="module")
def full(validation) -> Results:
    return replace(
        validation,
        tables={**validation.tables, "hard": hard_table(), "equal-error": equal_error_table()},
    )


@pytest.fixture(scope="module")
def report(full) -> Report:
    return report_of(full)


@pytest.fixture(scope="module")
def folder(report, tmp_path_factory):
    with unsaved_figures():
        return write_report(report, tmp_path_factory.mktemp("page one") / "run").parent


def read(folder) -> dict[str, pd.DataFrame]:
    return {path.stem: pd.read_csv(path) for path in (folder / "data").glob("*.csv")}


def numbers(report: Report) -> list[Number]:
    """Every number of the page's sentences that is a cell of the data."""
    answers = [
        number
        for study, said in report.sections.items()
        if study.on_page_one and said.answer
        for number in said.numbers
    ]
    return [*page_one(report).numbers, *answers]


def test_every_number_is_in_the_data(report, folder):
    told, data = numbers(report), read(folder)
    assert {number.cell.table for number in told} >= {"accuracy", "equal-error"}
    assert [number for number in told if number.text != "0" and not is_cell(number, data)] == []


def test_data_that_say_something_else_are_noticed(report, folder):
    """Every number, with its own cell changed."""
    data = read(folder)
    for number in numbers(report):
        table, column = data[number.cell.table], number.cell.quantity.key
        changed = table.assign(**{column: 3.0 * table[column] + 1.0})
        changed_data = {**data, number.cell.table: changed}
        assert number.text == "0" or not is_cell(number, changed_data), number


def test_no_other_digits(full, report):
    """What has digits is a cell of the data, a count, a cell of the table of methods, or fixed text."""
    page = text = " ".join(page_one_markdown(report, "", "Run.").split())
    words = page_one(report)
    for study, said in report.sections.items():
        assert said.answer in page or not study.on_page_one
        text = text.replace(said.answer, "").replace(said.beside, "")
    for fixed in (
        TITLE,
        words.how_to_read,
        words.mechanism,
        words.runs,
        words.not_installed,
        *(run.variant.label for run in full.records),
    ):
        text = text.replace(fixed, "")
    text = re.sub(r"\|.*\|", "", text)
    for number in sorted(words.numbers, key=lambda number: -len(number.text)):
        assert " ".join(number.text.split()) in page
        text = text.replace(number.text, "")
    for fixed in FIXED:
        text = text.replace(fixed, "")
    text = re.sub(r"\bcase \d\b|\bF0\b", "", text)  # names
    assert not re.findall(r".{20}\d.{20}", text)


@pytest.mark.parametrize(
    "missing", ["accuracy", "equal-error", "hard", "threshold", "claims", "all"]
)
def test_it_comes_out_whatever_is_missing(full, missing):
    few = replace(
        full,
        tables={name: table for name, table in full.tables.items() if missing not in (name, "all")},
    )
    report = report_of(few)
    assert page_one_markdown(report, "", "Run.").startswith(f"# {TITLE}") and "nan" not in " ".join(
        answer_lines(report)
    )
    empty = page_one_markdown(report_of(Results((), {}, {})), "", "Run.")
    title, _, *paragraph = empty.splitlines()
    assert title == f"# {TITLE}"
    assert "" not in paragraph and paragraph[-1].endswith(
        "Run."
    )  # one paragraph, no table, no list
    assert not re.search(r"\d|\||^- ", " ".join(paragraph))


def test_what_stands_beside_an_answer_is_no_line_of_the_terminal(full, report):
    study = next(study for study in report.sections if study.on_page_one)
    said = replace(
        report,
        sections={**report.sections, study: replace(report.sections[study], beside="It holds.")},
    )
    page = " ".join(page_one_markdown(said, "", "Run.").split())
    assert f"{said.sections[study].answer} It holds." in page
    assert list(answer_lines(said)) == list(answer_lines(report))


def test_times_are_those_of_all_cases_with_their_signs(report):
    rows = recommendation(report.results)
    reference, scheme = rows["reference"]["times"], rows["scheme"]["times"]
    assert (reference["from_sign"], float(reference["from"])) == ("≤ ", 1.234e-3)
    assert (reference["to_sign"], float(reference["to"])) == ("≤ ", 3.12e-3)
    assert reference["only_in"] == []
    assert (scheme["from_sign"], float(scheme["from"]), scheme["to"]) == ("~", 0.0567, None)
    assert scheme["only_in"] == ["slider-bar-case-1"]
    texts = [number.text for number in page_one(report).numbers]
    assert {"≤ 1.3", "≤ 3.2", "~57"} <= set(texts)


def test_our_own_solver_of_contacts_is_no_existing_engine(full):
    made = [
        made_up(label, case, variant.ladder[-1])
        for label, variant in VARIANTS.items()
        for case in CASES
    ]
    table = pd.DataFrame(
        [{**about(one), "position_error": 1e-3, "position_uncertainty": 0.0} for one in made]
    )

    def engines(engine):
        table.loc[table["fidelity"] == "contact", "engine"] = engine
        found = recommendation(Results(tuple(made), {}, {"accuracy": table}))
        assert found["cases"] == 3 and float(found["reference"]["error"]) == 1e-3
        return {one["fidelity"]: one["groups"] for one in found["engines"]}

    [group] = engines("pymunk")["contact"]
    assert [part["closest"]["variant"] for part in group["parts"]] == ["pymunk, contact"]
    assert "contact" not in engines("moreau")


def test_runs_that_failed_in_other_studies_are_not_kept_from_the_page(full, report):
    ended = pd.DataFrame(
        [
            {
                "scene": "slider-bar-case-1",
                "choice": "none",
                "step": 0.016,
                "status": "ok",
                "reason": "stopped",
            }
        ]
    )
    assert "failures.md" not in page_one(report).runs
    with_ended = report_of(replace(full, tables={**full.tables, "study": ended}))
    assert "no stabilization" in page_one(with_ended).runs
    assert "failures.md" in page_one(with_ended).runs


def test_methods_stand_in_groups_that_may_be_compared(full, report):
    """Solvers of this suite are apart from the engines of others."""
    table = headline_table(report)
    own = [label for label in table.groups if label.startswith("solvers of this suite: ")]
    engines = [label for label in table.groups if label not in own]
    assert list(table.groups) == [*engines, *own] and own and engines
    assert set(engines) <= {"joint, mus > mu", "contact, mus > mu"}
    engine_of = {record.variant.label: record.variant.engine for record in full.records}
    for label, rows in table.groups.items():
        assert {engine_of[method] in own_methods() for method in rows} == {label in own}
    shown = [method for rows in table.groups.values() for method in rows]
    assert sorted(shown) == sorted(methods(full))
    assert table.heads[0] == "method"
    assert all(len(row) == len(table.heads) for row in table.rows)


def test_the_table_has_the_step_and_the_suppliers_of_each_method(full, report):
    """They are those of the runs whose errors are shown, which may be far from 1 ms."""
    accuracy = full.table("accuracy")
    for rows in headline_table(report).groups.values():
        for method, (setting, suppliers, *_) in rows.items():
            runs = accuracy[accuracy["variant"] == method]
            settings = {
                setting_of(parameter, step)
                for parameter, step in zip(runs["parameter"], runs["step"], strict=True)
            }
            assert setting in settings
            friction, events = suppliers.split(" / ")
            for supplier, column in ((friction, "friction_by"), (events, "events_by")):
                assert supplier in ({*runs[column].dropna()} or {"not known"})
    for depth in ("quick", "full"):
        chosen = replace(full, settings={**full.settings, "depth": depth})
        assert f'depth "{depth}"' in page_one(report_of(chosen)).how_to_read


def test_our_own_solvers_are_not_recommended(report):
    lines = page_one(report).recommendation
    assert not [line for line in lines if "recommended" in line]
    [own] = [line for line in lines if "of the reference" in line]
    assert own.startswith("Among the solvers of this suite")


def test_engines_that_are_not_installed_are_told_once_and_stand_in_no_table(full):
    lost = [
        record(Variant(name, name.partition(",")[0], "dt", (1e-2,)), 1e-2, "missing")
        for name in ("Alpha", "Beta", "Beta, contact")
    ]
    few = replace(full, records=(*full.records[:3], *lost))
    named = re.findall(r"Alpha|Beta", page_one(report_of(few)).not_installed)
    assert named == ["Alpha", "Beta"]
    assert page_one(report_of(replace(full, records=full.records[:3]))).not_installed == ""
    page = page_one_markdown(report_of(few), "", "Run.")
    assert page.count("Alpha") == page.count("Beta") == 1


def test_a_stored_run_without_some_trajectories_has_the_same_methods(full):
    """Another way of the reference is no method because its own trajectory is not there."""
    other = record(Variant("reference, other setting", "reference", "rtol", (1e-9,)), 1e-9)
    lost = record(Variant("never", "never", "dt", (1e-2,)), 1e-2, "failed")
    assert methods(replace(full, records=(*full.records, other))) == methods(full)
    assert methods(replace(full, records=(*full.records, lost))) == [*methods(full), "never"]


@pytest.mark.parametrize(
    "value, unsure, told",
    [
        (0.145, 0.018, "0.145 ± 0.018"),
        (12.34, 2.5, "12.3 ± 2.5"),
        (3.13e-13, 2.9e-14, "3.13e-13 ± 2.9e-14"),
        (187.0, 120.0, "187 ± 120"),
        (1.0, 0.1, "1.0 ± 0.1"),
        (5e-5, 1.1e-5, "5.0e-05 ± 1.1e-05"),
        (3.996, 0.021, "3.996 ± 0.021"),
        (1.234, 0.081, "1.23 ± 0.09"),
        (0.7541, 0.0376, "0.75 ± 0.04"),
        (52.4, 6.7, "52 ± 7"),
        (9.6, 9.51, "10 ± 10"),
        (1.456, float("nan"), "1.5"),
        (1.456, 0.0, "1.5"),
        (0.0, 0.1, "0.0 ± 0.1"),
        (-1e-5, 0.1, "0.0 ± 0.1"),
        (0.0, 1e-9, "0e+00 ± 1e-09"),
    ],
)
def test_a_number_ends_where_its_uncertainty_does(value, unsure, told):
    assert Uncertain(value, unsure).both() == told


@settings(max_examples=40)
@given(
    st.lists(
        st.text(
            st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="|"), max_size=200
        ),
        min_size=1,
        max_size=15,
    )
)
def test_tables_fit(words):
    text = fit_table(
        pd.DataFrame({"words": words, "again": words, "third": words, "number": np.pi})
    )
    lines, _, below = text.partition("\n\n")
    assert max(map(len, lines.splitlines())) <= TABLE_WIDTH
    dropped = [
        name for name in ("words", "again", "third", "number") if name not in lines.splitlines()[0]
    ]
    assert re.findall(r"\*(\w+)\*", below) == dropped  # what has no room is told
