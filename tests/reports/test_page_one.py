"""Page one fits a page, its numbers stand in the data, and it ranks nothing that may not be ranked; tables and figures of a report can be read."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from report_material import CASE, record

from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import MUS_EQUALS_MU, OWN_CPU, Variant
from stiction.reports import write_report
from stiction.reports.figures.differences import largest_differences
from stiction.reports.figures.style import MARKERS, looks
from stiction.reports.markdown.cost_page import HIGH, LOW
from stiction.reports.markdown.equal_step import methods
from stiction.reports.markdown.findings import findings
from stiction.reports.markdown.ladder_ends import INTEGRATION, MODEL, TRUTH, UNKNOWN, ladder_ends
from stiction.reports.markdown.page_one import numbers, page_one
from stiction.reports.markdown.tables import WIDTH, fitted
from stiction.reports.markdown.told import COUNT, NAME, RATIO, value
from stiction.scenes import InputError, Trajectory

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
MOST_BYTES, MOST_LINES, MOST_ROWS = 60_000, 60, 10


def cost_table() -> pd.DataFrame:
    """Made-up ladders: an event-driven reference, an engine of first order, a contact model whose error stays."""
    rows = [("reference", "reference", "rtol", step, "joint", error, seconds, "") for step, error, seconds in ((1e-6, 1e-6, 1e-3), (1e-9, 1e-9, 2e-3))]
    rows += [("other", "other", "dt", step, "joint", 0.5 * step, 1e-4 / step, "") for step in (1e-2, 5e-3, 2.5e-3)]
    rows += [("soft, contact", "soft", "dt", step, "contact", 1e-3, 1e-4 / step, MUS_EQUALS_MU) for step in (1e-2, 5e-3)]
    table = pd.DataFrame(rows, columns=["variant", "engine", "parameter", "step", "fidelity", "position error [m]", OWN_CPU, "truth"])
    return table.assign(scene=CASE, truth=CASE + table["truth"], status="ok", reason="", repeats=5, **{
        "cpu [s]": table[OWN_CPU], LOW: 0.9 * table[OWN_CPU], HIGH: 1.1 * table[OWN_CPU], "position uncertainty [m]": 1e-14,
        "order, position [-]": [np.nan, np.nan, np.nan, 1.0, 1.0, np.nan, 0.0]})


def hard_table() -> pd.DataFrame:
    verdicts = {"reference": "rrr", "paper's scheme": "rwo", "other": "rfd"}
    words = {"r": "right", "w": "wrong", "o": "refused", "f": "failed", "d": "degraded"}
    rows = [(f"case {i}", variant, "reference" if variant != "other" else "other", words[letter]) for variant, letters in verdicts.items() for i, letter in enumerate(letters)]
    return pd.DataFrame(rows, columns=["case", "variant", "engine", "verdict"]).assign(
        topic="t", scene="s", must="m", fidelity="joint", about="", size=np.nan, limit=np.nan, **{"cpu [s]": 1.0})


@pytest.fixture(scope="module")
def full(validation):
    return replace(validation, tables={**validation.tables, "cost": cost_table(), "hard": hard_table()})


@pytest.fixture(scope="module")
def folder(full, tmp_path_factory):
    return write_report(full, tmp_path_factory.mktemp("page one") / "run").parent


def test_report_can_be_read(folder):
    text = (folder / "report.md").read_text()
    assert len(text.encode()) <= MOST_BYTES
    page, *parts = re.split(r"\n## ", text)
    assert len(page.splitlines()) <= MOST_LINES and page.splitlines()[2].startswith("![The mechanism")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert lines and max(map(len, lines)) <= WIDTH
    for part in parts:
        for table in re.findall(r"(?:^\|.*\n)+", part, re.M):
            assert table.count("\n") - 2 <= MOST_ROWS or part.startswith("Where do methods")
        shown = [part.find(mark) for mark in ("![", "\n|")]
        assert -1 in shown or shown[0] < shown[1]  # the figure first
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert links and all((folder / link).is_file() for link in links)
    assert {"hard.md", "failures.md", "data/accuracy.csv", "data/cost.csv"} <= set(links)


def shows(text: str, true: float) -> bool:
    """Whether a number rounded as in the text may be this one."""
    digits = re.fullmatch(r"-?(\d+)(?:\.(\d+))?(?:e([+-]?\d+))?", text)
    unit = 10.0 ** (int(digits[3] or 0) - len(digits[2] or ""))
    significant = len((digits[1] + (digits[2] or "")).strip("0")) or 1
    unit = max(unit, 10.0 ** (np.floor(np.log10(abs(float(text)))) + 1 - significant)) if float(text) else unit  # 980 stands for 975 to 985
    return abs(float(text) - abs(true)) <= 0.500001 * unit or abs(float(text) - true) <= 0.500001 * unit


def test_every_number_of_page_one_is_in_the_data(full, folder):
    told = numbers(full)
    assert len(told) > 30 and {number.how for number in told} == {"value", COUNT, RATIO, NAME}
    for number in told:
        csv = pd.read_csv(folder / "data" / f"{number.table}.csv", float_precision="round_trip")
        seen = re.findall(NUMBER, number.text)
        if number.how == COUNT:
            for column, wanted in number.where.items():
                csv = csv[csv[column].isin(wanted if isinstance(wanted, frozenset) else [wanted])]
            assert number.text == str(len(csv)), number
            continue
        cells = csv.iloc[[row - 1 for row in number.rows]]
        if number.how == NAME:
            assert f"slider-bar-{number.text.replace(' ', '-')}" == cells[number.column].item()
        elif number.how == RATIO:
            first, second = (cells.iloc[place] for place in (0, 1))
            true = first[number.column] / second[number.column], first[LOW] / second[HIGH], first[HIGH] / second[LOW]
            assert all(map(shows, seen, true)) and true[1] < true[0] < true[2], number
        elif number.text.startswith("<"):
            unsure = cells[number.column.replace("error", "uncertainty")].item()
            assert abs(cells[number.column].item()) <= unsure and float(seen[0]) >= unsure, number
        else:
            assert all(shows(seen[0], true) for true in cells[number.column]), number


def test_page_one_has_no_other_digits(full):
    """What is left of the sentences without their numbers are words."""
    for finding in findings(full):
        text, place = finding.told.text, 0
        for number in finding.told.numbers:
            place = text.index(number.text, place)
            text = text[:place] + text[place + len(number.text):]
        assert not re.search(r"\d", text.replace("F0", "")), finding


def test_a_sentence_that_drifts_from_the_data_is_noticed(full):
    table = full.tables["accuracy"].reset_index(drop=True)
    number = value("accuracy", table, 1, "position error [m]")
    true = table.at[1, "position error [m]"]
    assert shows(re.findall(NUMBER, number.text)[0], true) and not shows(re.findall(NUMBER, number.text)[0], 2 * true)


def test_page_one_ranks_within_a_group_only(full):
    text = page_one(full, "Run.", [])
    agreement = next(finding.told.text for finding in findings(full) if finding.title == "Agreement")
    assert agreement.index("the reference is") < agreement.index("paper's scheme is") and "other with" in agreement and "(joint, mus > mu)" in agreement
    accuracy = full.tables["accuracy"]
    both = pd.concat([accuracy, accuracy[accuracy["variant"] == "other"].assign(variant="twin", truth=CASE + MUS_EQUALS_MU, **{"position error [m]": 1e-12})], ignore_index=True)
    twin = record(Variant("twin", "twin", "dt", (2.5e-3,)), 2.5e-3, value=full.records[2].trajectory)
    told = findings(replace(full, records=(*full.records, twin), tables={**full.tables, "accuracy": both}))[0].told.text
    assert "other with" in told and "twin with" in told and "(joint, mus = mu)" in told
    assert "1/2" in text and "3/3" in text  # right, of the cases that were accepted
    assert all(len(line) <= 118 for line in text.splitlines())


@pytest.mark.parametrize("missing", ["accuracy", "cost", "hard", "study", "threshold", "torque", "claims", "drift"])
def test_page_one_comes_out_whatever_is_missing(full, missing):
    tables = {name: table for name, table in full.tables.items() if name != missing}
    assert page_one(replace(full, tables=tables), "Run.", [])


def test_a_stored_run_without_some_trajectories_has_the_same_methods(full):
    """A folder keeps the trajectories of those that stand for a method; another way of the reference is no method because its own is not there."""
    other = record(Variant("reference, other setting", "reference", "rtol", (1e-9,)), 1e-9)
    lost = record(Variant("never", "never", "dt", (1e-2,)), 1e-2, "failed")
    assert methods(replace(full, records=(*full.records, other))) == methods(full)
    assert methods(replace(full, records=(*full.records, lost))) == [*methods(full), "never"]


def test_where_ladders_end_and_why():
    found = {end.variant: end for end in ladder_ends(cost_table())}
    assert {variant: end.limit for variant, end in found.items()} == {"reference": INTEGRATION, "other": INTEGRATION, "soft, contact": MODEL}
    assert found["other"].order == pytest.approx(1.0) and found["soft, contact"].order == 0.0 and found["other"].step == 2.5e-3
    table = cost_table()
    exact = table.assign(**{"position uncertainty [m]": 1e-4})
    assert {end.limit for end in ladder_ends(exact)} == {TRUTH}
    assert {end.limit for end in ladder_ends(table.drop_duplicates("variant"))} == {UNKNOWN}
    solver = table[table["variant"] == "soft, contact"].assign(parameter="iterations")
    assert [end.limit for end in ladder_ends(solver)] == [INTEGRATION]  # its step is what is left


def test_variants_are_told_apart_without_colours():
    def records(count, fidelity):
        return [record(Variant(f"{fidelity} {i}", f"engine {i}", "dt", (1e-2,), fidelity), 1e-2, "failed") for i in range(count)]

    most = 2 * len(MARKERS)
    found = looks([*records(most, "joint"), *records(most, "contact")])
    assert len({(look.marker, look.fill) for look in found.values()}) == len(found) == 2 * most
    with pytest.raises(InputError, match=f"found {most + 1} variants of contact fidelity; expected at most {most}"):
        looks(records(most + 1, "contact"))


@given(st.lists(st.text(st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="|"), max_size=200), min_size=1, max_size=15))
def test_tables_fit(words):
    text = fitted(pd.DataFrame({"words": words, "again": words, "third": words, "number": np.pi}))
    assert len(text.splitlines()) == 2 + min(len(words), MOST_ROWS) and max(map(len, text.splitlines())) <= WIDTH


def test_differences_are_those_from_the_truth():
    truth = Truth("made", "closed form", 24.0, lambda t, side="after": {"slider.x": np.sin(t)}, {}, ())
    t = np.linspace(0.0, 24.0, 3001)  # every 8 ms: of the truth's instants every fourth is among them
    wrong = Trajectory("made", "made", "1", "joint", t, {"slider.x": np.sin(t) + 1e-3 * (t > 12)}, (), {})
    at, size = largest_differences(wrong, truth, "slider.x")
    assert at.min() > 12 and size == pytest.approx(1e-3) and np.all(np.diff(at) > 0)
