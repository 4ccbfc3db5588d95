"""Tables as data become the texts that they should, and keys lead to rows or are refused in words."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.bench.presentation.cells import NULL, cell
from stiction.comparisons.bench.presentation.table_view import BRIEF_ROWS, Column, view
from stiction.comparisons.bench.quantities import quantity_of
from stiction.reports.markdown.study_section import brief_table, remaining_rows_note
from stiction.reports.markdown.tables import align_columns
from stiction.reports.paper import latex
from stiction.reports.paper.folder import lay_out_table
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import keys, ranges, resolve

FRAME = pd.DataFrame(
    {
        "name": ["a", "b|c", ""],
        "error [m]": [1.2345e-3, -2e-6, np.nan],
        "unsure": [1e-5, 5e-6, np.nan],
        "time [s]": [0.25, 1.0, 2.0],
        "fine": [True, False, True],
        "nothing": [None, None, None],
        "group": ["first", "first", "second"],
    }
)
COLUMNS = (
    Column("name"),
    Column("error [m]", "error", "mm", "unsure", scale=1e3),
    Column("error [m]", "signed error", "m", "unsure", interval=True, brief=False),
    Column("time [s]", "time", "ms", form=".0f", scale=1e3),
    Column("fine"),
    Column("nothing"),
    Column("not there"),
)
SHOWN = view(
    "made",
    FRAME,
    COLUMNS,
    source="torque",
    rows=[(1, 2, 3), (5,), (7, 9)],
    group="group",
    caption="Made up.",
)


def test_columns_have_units_scales_uncertainties_and_intervals():
    assert SHOWN.heads() == [
        "group",
        "name",
        "error [mm]",
        "signed error [m]",
        "time [ms]",
        "fine",
    ]  # what is empty or not there is left out
    assert SHOWN.cells() == [
        ["first", "a", "1.2", "0.00123 ± 1e-05", "250", "yes"],
        ["first", "b|c", "< 0.007", "-2e-06 ± 5e-06", "1000", "no"],
        ["second", "–", "–", "–", "2000", "yes"],
    ]
    assert SHOWN.right() == [False, False, True, True, True, False]
    assert SHOWN.heads(brief=True) == ["name", "error [mm]", "time [ms]", "fine"] and SHOWN.cells(
        brief=True
    )[0] == ["a", "1.2", "250", "yes"]


def test_markdown_lines_up_under_headings_of_groups():
    lines = brief_table(SHOWN).splitlines()
    assert len(set(map(len, lines[2:]))) == 1
    assert [line.strip("| ").split(" ")[0] for line in lines] == [
        "name",
        ":-------",
        "*first*",
        "a",
        "b\\|c",
        "*second*",
        "–",
    ]
    assert re.fullmatch(r"\| :-+ \| -+: \| -+: \| :-+ \|", lines[1]) and lines[3].split("|")[
        2
    ].endswith(" 1.2 ")
    many = view(
        "many",
        pd.DataFrame({"n": range(50)}),
        (Column("n"),),
        caption="Many.",
    )
    assert (
        brief_table(many).count("\n") == BRIEF_ROWS + 1
        and f"The first {BRIEF_ROWS} of 50 rows" in remaining_rows_note(many)
        and remaining_rows_note(SHOWN) == ""
    )
    assert "w" * 500 in align_columns(["words"], [["w" * 500]], [False])  # nothing is cut


def test_latex_has_every_cell_and_key():
    text = latex.table(lay_out_table(SHOWN))
    assert (
        text.count(r"\\") == 1 + len(FRAME)
        and r"\label{tab:made}" in text
        and r"b\textbar{}c" in text
        and r"0.00123 \textpm{} $1{\times}10^{-5}$" in text
    )
    assert re.findall(r"& (made:\d) \\\\", text) == ["made:1", "made:2", "made:3"]
    long = view(
        "long",
        pd.DataFrame({"n": range(latex.MAX_ROWS_ON_PAGE + 1)}),
        (Column("n"),),
        caption="Long.",
    )
    assert r"\begin{xltabular}" in latex.table(lay_out_table(long)) and r"\endhead" in latex.table(
        lay_out_table(long)
    )
    wide = view(
        "wide",
        pd.DataFrame({f"column {number}": ["some words of a cell"] for number in range(9)}),
        tuple(Column(f"column {number}", brief=number < 4) for number in range(9)),
        caption="Wide.",
    )
    grouped = lay_out_table(replace(wide, frame=wide.frame.assign(part="first"), group="part"))
    assert (
        grouped["head"][:2] == ["part", "column 0"]
        and grouped["rows"][0][0] == "first"
        and len(grouped["right"]) == len(grouped["head"]) == 6
    )
    assert (
        len(lay_out_table(wide)["head"]) == 5
        and len(lay_out_table(SHOWN)["head"]) == 7
        and "column 4" not in latex.table(lay_out_table(wide))
    )


@given(
    st.text(
        st.one_of(st.characters(min_codepoint=32, max_codepoint=126), st.sampled_from("“”–≤±²"))
    )
)  # others: test_latex.py
def test_latex_of_any_text_has_no_command_of_its_own(text):
    plain = re.sub(
        r"(?<=-)\{\}(?=-)|\\[&%$#_{}]|\\text\w+\{\}|\$(\^2|\\leq|-?[\d.]+\{\\times\}10\^\{-?\d+\})\$",
        "",
        latex.escape(text),
    )
    assert not set(plain) & set('\\&%$#_{}~^<>|"')


@pytest.mark.parametrize(
    "text, expected",
    [
        ("5 % of m/s^2 & a_b", r"5 \% of m/s$^2$ \& a\_b"),
        ("rtol = 1e-09", r"rtol = $1{\times}10^{-9}$"),
        ("–", "--"),
        ("≤ 3", r"$\leq$ 3"),
        ('a "tier" ("own")', "a ``tier'' (``own'')"),
        ("1 ± 2", r"1 \textpm{} 2"),
    ],
)
def test_latex_of(text, expected):
    assert latex.escape(text) == expected


@given(st.lists(st.sets(st.integers(1, 400), min_size=1), min_size=1, max_size=5))
def test_a_key_leads_to_the_rows_behind_its_row(groups):
    data = pd.DataFrame({"n": range(1, 401)})
    run = StoredRun(None, {}, {"toy": data})
    frame = pd.DataFrame({"n": range(len(groups))})
    shown = view("shown", frame, [Column("n")], source="toy", rows=[list(rows) for rows in groups])
    for key, rows in zip(keys(shown), groups, strict=True):
        source = resolve(run, [shown], key)
        assert source.table == "toy" and set(source.rows["n"]) == rows
        assert list(source.rows.index) == sorted(rows)


@pytest.mark.parametrize(
    "numbers, text",
    [([7], "7"), ([7, 105], "7, 105"), ([4, 3, 5], "3-5"), ([1, 2, 3, 9], "1-3, 9")],
)
def test_ranges(numbers, text):
    assert ranges(numbers) == text


@pytest.mark.parametrize(
    "key, message",
    [
        ("accuracy:0", "rows 1 to 5"),
        ("accuracy:6", "rows 1 to 5"),
        ("accuracy:-1", "name of a table"),
        ("accuracy:1-3", "name of a table"),
        ("acuracy:1", "accuracy"),
        ("12", "name of a table"),
        ("", "name of a table"),
        ("nothing:1", "found 'nothing:1'"),
        ("accuracy:", "name of a table"),
    ],
)
def test_keys_that_lead_nowhere_are_refused_in_words(key, message, tmp_path):
    frame = pd.DataFrame({"n": range(5)})
    run = StoredRun(tmp_path, {}, {"accuracy": frame})
    with pytest.raises(ValueError, match=message):
        resolve(run, [view("accuracy", frame, [Column("n")])], key)


@pytest.mark.parametrize(
    "column, value, shown",
    [
        ("position_error", 1.2345e-7, "1.2e-07"),
        ("with_stick", 4.21195632175, "4.211956322"),
        ("window", 8.0, "8"),
        ("kind", "stick", "stick"),
        ("reason", "a | b\nc", "a | b c"),
        ("bounded", np.True_, "yes"),
        ("threshold_error", float("nan"), "–"),
        ("paper_threshold", None, NULL),
        ("paper's scheme", None, "–"),
        ("events_missed", 3.0, "3"),
        ("stop_error", float("inf"), "inf"),
        ("jump", -0.123456789, "-0.123457"),
    ],
)
def test_values_as_displayed(column, value, shown):
    assert cell(quantity_of(column), value) == shown
