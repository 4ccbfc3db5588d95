"""Text of the web page of a run, without a browser."""

import re
from dataclasses import replace

import pandas as pd

from stiction.comparisons.bench.presentation import Column, view
from stiction.reports import report_of
from stiction.reports.page.document import document
from stiction.reports.page.run_page import answer_blocks, table_html
from stiction.reports.page.time_series import time_series
from stiction.reports.page_one import INTERRUPTED, headline_table, page_one


def test_the_page_of_an_interrupted_run_says_so(validation):
    report = report_of(validation)
    interrupted = report_of(
        replace(validation, settings={**validation.settings, "interrupted": True})
    )
    assert INTERRUPTED not in "".join(answer_blocks(report))
    assert INTERRUPTED in "".join(answer_blocks(interrupted))


def test_the_page_counts_the_runs(validation):
    """Runs that failed are missing in all tables: their number tells how much the answer is based on."""
    report = report_of(validation)
    assert page_one(report).runs and page_one(report).runs in "".join(answer_blocks(report))


def test_names_of_groups_are_emphasized_in_markdown_only(validation):
    table = headline_table(report_of(validation))
    pairs = list(zip(table.rows, table.plain_rows, strict=True))
    assert pairs
    for row, plain in pairs:
        expected = f"*{plain[0]}*" if plain[0] in table.groups else plain[0]
        assert row == [expected, *plain[1:]]


def test_sections_with_equal_headings_are_all_shown():
    sections = [("What?", ["<p>first</p>"]), ("What?", ["<p>second</p>"]), ("Why?", [])]
    page = document("title", "subtitle", sections)
    assert "<p>first</p>" in page and "<p>second</p>" in page
    for anchor in ("what", "what-2", "why"):
        assert page.count(f'id="{anchor}"') == page.count(f'href="#{anchor}"') == 1


def test_time_series_of_a_run_without_a_truth_and_without_the_default_method(validation):
    """No curve is shown at first then, so that there are no differences from the truth either."""
    records = tuple(
        record
        for record in validation.records
        if record.variant.engine == "reference"
        and record.outcome.value is not None
        and record.outcome.value.settings.get("method") != "event"
    )
    assert records
    views = list(time_series(replace(validation, records=records, truths={})))
    assert views


def test_each_group_of_rows_is_below_its_name():
    frame = pd.DataFrame({"kind": ["joint", "joint", "contact"], "variant": ["a", "b", "c"]})
    columns = (Column("variant"),)
    html = table_html(view("study", frame, columns, group="kind"))
    first_cells = re.findall(r"<tr[^>]*><t[dh][^>]*>([^<]*)</t", html)
    assert first_cells[1:] == ["joint", "a", "b", "contact", "c"]
    assert html.count('scope="rowgroup" colspan="2"') == 2
    plain = table_html(view("study", frame, columns))
    assert "rowgroup" not in plain and plain.count("<tr") == 4
