"""Templates of text: blocks, captions, and numbers that know their cells."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import TemplateNotFound, UndefinedError

from stiction.comparisons.bench.presentation import (
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    row_of,
    view,
)
from stiction.comparisons.bench.quantities import QUANTITIES
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.studies import studies
from stiction.reports.text import items, listed, paragraphs, ratio, section_of, template

LINE = np.array([0.0, 1.0])
TABLE = pd.DataFrame(
    {
        "position_error": [2.5e-4, -3e-9],
        "position_uncertainty": [1e-6, None],
        "cpu_time": [0.01234, 0.5],
        "status": ["ok", "failed"],
    }
)


def section(text: str, **rows):
    frame = pd.DataFrame({"position_error": [1.0]})
    shown = Presentation(
        rows={"nothing": None, **rows},
        tables=[view("made", frame, [Column("position_error")])],
        figures=[Chart("made", [Panel("", Axis(), Axis(), [Series("", LINE, LINE)])])],
    )
    study = Study("made", "Made", "What is made up?", lambda results: shown, text=text)
    return section_of(study, Results((), {}, {}))


def test_blocks_become_parts_of_the_section():
    found = section(
        "{% block answer %}It is\n  {% if nothing %}not{% endif %}\n  so.{% endblock %}"
        "{% block findings %}First\nparagraph.\n\n\nSecond.\n{% endblock %}"
        "{% block tables %}{% call caption('made') %}Of a table.{% endcall %}{% endblock %}"
        "{% block notes %}\n- One\n  note.\n- Another.\n{% endblock %}"
    )
    assert found.answer == "It is so."
    assert found.findings == ["First paragraph.", "Second."]
    assert found.notes == ["One note.", "Another."]
    assert found.tables[0].caption == "Of a table."


def test_a_name_that_is_not_there_is_an_error():
    with pytest.raises(UndefinedError, match="wrongly_spelt"):
        section("{% block answer %}{{ wrongly_spelt }}{% endblock %}")
    row = row_of("made", TABLE, 0)
    with pytest.raises(UndefinedError, match="no_column"):
        section("{% block answer %}{{ row.no_column }}{% endblock %}", row=row)
    with pytest.raises(TemplateNotFound):
        template("studies/no such study.md")


@pytest.mark.parametrize("block", ["tables", "figures"])
def test_a_misspelt_or_repeated_caption_is_an_error(block):
    caption = "{% call caption('NAME') %}Of it.{% endcall %}"
    text = "{% block " + block + " %}CAPTIONS{% endblock %}"
    with pytest.raises(ValueError, match="found no caption of made"):
        section(text.replace("CAPTIONS", caption.replace("NAME", "maid")))
    with pytest.raises(ValueError, match="found two of 'made'"):
        section(text.replace("CAPTIONS", 2 * caption.replace("NAME", "made")))


@pytest.mark.parametrize(
    ("value", "bound", "text"),
    [
        (0.1289, "≥", "≥ +12"),
        (0.1211, "≤", "≤ +13"),
        (-0.1289, "≤", "≤ -12"),
        (-0.1211, "≥", "≥ -13"),
        (0.1289, None, "+13"),
    ],
)
def test_a_bound_in_per_cent_remains_one(value, bound, text):
    row = row_of("made", pd.DataFrame({"position_error": [value]}), 0)
    found = section(
        "{% block answer %}{{ row.position_error | percent(bound) }}{% endblock %}",
        row=row,
        bound=bound,
    )
    assert found.answer == text


@pytest.mark.parametrize(
    ("written", "text"),
    [
        ("first.position_error | quantity", "0.25 mm"),
        ("second.position_error | quantity", "3e-09 m"),
        ("first.cpu_time | milli", "12"),
        ("first.cpu_time | milli('≤ ')", "≤ 13"),
        ("first.cpu_time | number('.3g')", "0.0123"),
        ("first.status", "ok"),
        ("second.position_error.uncertainty", "None"),
    ],
)
def test_numbers_are_written_by_their_quantity(written, text):
    rows = {name: row_of("made", TABLE, label) for label, name in enumerate(("first", "second"))}
    found = section("{% block answer %}{{ " + written + " }}{% endblock %}", **rows)
    assert found.answer == text


def test_a_number_knows_its_cell():
    row = row_of("made", TABLE, 1)
    [number] = section(
        "{% block answer %}{{ row.cpu_time | milli }} ms{% endblock %}", row=row
    ).numbers
    cell = number.cell
    assert (cell.table, cell.row, cell.quantity.key) == ("made", 2, "cpu_time")
    assert (number.text, number.factor, cell.value) == ("500", 1000.0, 0.5)


def test_a_ratio_of_one_sample_has_no_interval():
    assert ratio(ratio_interval([2.0], [1.0])) == "~2"
    assert ratio(ratio_interval([2.0, 2.0], [1.0, 1.0])) == "2 (2 to 2)"


@given(st.lists(st.from_regex(r"[a-z]{1,5}", fullmatch=True), min_size=1, max_size=5))
def test_lists_have_every_part_in_order(parts):
    assert listed(parts).replace(" and ", ", ").split(", ") == parts


@given(st.lists(st.from_regex(r"[A-Z][a-z ]{1,20}[a-z]\.", fullmatch=True), max_size=5))
def test_paragraphs_and_items_are_what_was_written(texts):
    lines = [" ".join(text.split()) for text in texts]
    assert paragraphs("\n\n".join(texts)) == lines
    assert items("\n".join(f"- {text}" for text in texts)) == lines


@pytest.mark.parametrize("study", studies(), ids=lambda study: study.name)
def test_every_study_has_a_template_of_known_blocks(study):
    known = {"answer", "beside", "findings", "figures", "tables", "notes"}
    assert set(template(f"studies/{study.name}.md").blocks) <= known


def test_axes_are_labelled_with_words_and_not_with_the_keys_of_columns(validation):
    labels = [
        axis.label
        for study in studies()
        for figure in section_of(study, validation).figures
        if isinstance(figure, Chart)
        for panel in figure.panels
        for axis in (panel.x, panel.y)
    ]
    assert "position error [m]" in labels
    assert not [label for label in labels if label in QUANTITIES]


def test_conditions_leave_no_space_before_a_full_stop_and_none_out_between_words(validation):
    for study in studies():
        found = section_of(study, validation)
        captions = [one.caption for one in (*found.tables, *found.figures)]
        assert all(captions), [one.name for one in (*found.tables, *found.figures)]
        for text in (found.answer, found.beside, *found.findings, *found.notes, *captions):
            assert not re.search(r" [.,;:](?: |$)|[a-z0-9)]\(|\d[a-z]{3}|,,|;;|\( ", text), text
