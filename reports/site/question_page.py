"""The page of a question: answer, figures and tables of a run, and the numbers of the nights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.study import Study
from stiction.reports.page.document import chart, details, markdown, table
from stiction.reports.page.night_charts import CHART_HELP, CHART_LEGEND, night_views
from stiction.reports.page.run_page import figure_html, origin_paragraphs, table_html
from stiction.reports.site.content import (
    FILES_NOTE,
    SiteContent,
    SiteRun,
    night_rows,
    question_path,
)
from stiction.reports.site.layout import page, run_origin, time_in_words
from stiction.reports.site.night_tables import night_tables
from stiction.reports.text import Section, render_blocks, template

TEMPLATE = "site/question.md"
"""Path of the text in ``templates``."""
MAX_OPEN_ROWS = 40
"""Largest number of rows of a table that is shown at first; a longer one is shown when it is opened."""


def question_page(content: SiteContent, study: Study) -> str:
    """Return the HTML of the page of a study."""
    rule = "Methods may be compared only within a group of equal fidelity and coefficients of friction."
    subtitle = f"{study.title}. {rule}" if study.title else rule
    return page(content, question_path(study), study.question, subtitle, _sections(content, study))


def _sections(content: SiteContent, study: Study) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading of each section of the page, and its blocks of HTML."""
    section = content.section(study)
    texts = {name: markdown(text) for name, text in render_blocks(template(TEMPLATE), {}).items()}
    run = content.newest_run
    if run is not None and section is not None:
        yield "The answer", list(_answer(run, section))
        if section.tables or section.figures:
            yield "Tables and figures of the run", list(_tables_and_figures(run, section))
    tables = list(night_tables(content, study, question_path(study)))
    if tables:
        # One scene is shown at first, so that the page is not longer than can be read.
        opened, *others = tables
        blocks = [texts["night"], details(*opened, is_open=True)]
        yield "The newest night", blocks + [details(*scene_table) for scene_table in others]
        yield "Over the nights", _course(content, study)
    else:
        yield "Over the nights", [texts["not_in_nights"]]
    if len(content.runs) > 1:
        history = list(_headlines_over_runs(content.runs, study))
        if history:
            yield "Over the runs", [texts["runs"], *history]
    if run is not None and section is not None and section.tables:
        keys = "".join(origin_paragraphs(run.stored, section.tables, FILES_NOTE))
        summary = "Every key of the tables of the run"
        yield "Where the numbers come from", [texts["keys"], details(summary, keys)]


def _answer(run: SiteRun, section: Section) -> Iterator[str]:
    """Yield the HTML of the answer and the findings, with the origin of their numbers."""
    answer = f"{section.answer} {section.beside}".strip()
    if answer:
        yield markdown(f"**{answer}**")
    for finding in section.findings:
        yield markdown(finding)
    yield f'<p class="quiet">{escape(run_origin(run))}.</p>'


def _tables_and_figures(run: SiteRun, section: Section) -> Iterator[str]:
    """Yield the HTML of the notes, tables and figures of a section."""
    yield markdown("\n".join(f"- {note}" for note in section.notes))
    for view in section.tables:
        yield _table_or_details(view)
    for figure in section.figures:
        yield figure_html(run.stored, figure.name, figure.caption)


def _table_or_details(view: TableView) -> str:
    """Return the HTML of a table, which is shown when it is opened if it is long."""
    html = table_html(view)
    if len(view.frame) <= MAX_OPEN_ROWS:
        return html
    return details(f"{view.name}: {len(view.frame)} rows. {view.caption}", html)


def _course(content: SiteContent, study: Study) -> list[str]:
    """Return the HTML of the chart of the numbers of a study over the nights."""
    views = night_views(content.nights, night_rows(content.nights.rows, study))
    name = f"{study.name}-over-the-nights"
    return [markdown(CHART_LEGEND), chart(name, ("Metric", "Scene"), views, CHART_HELP)]


def _headlines_over_runs(runs: Sequence[SiteRun], study: Study) -> Iterator[str]:
    """Yield a table for each headline of a study: a row for each method, and a column for each run."""
    # By the label of a headline, its cells in each run by method; a run may lack the headline.
    cells_of: dict[str, list[Mapping[str, str]]] = {}
    for number, run in enumerate(runs):
        section = run.report.sections.get(study)
        if section is None:
            continue
        for headline in section.headlines:
            columns = cells_of.setdefault(headline.label, [{} for _ in runs])
            columns[number] = headline.cells
    origins = "; ".join(run_origin(run) for run in runs)
    heads = ["method", *(time_in_words(run.date) for run in runs)]
    right = [False, *(True for _ in runs)]
    for label, columns in cells_of.items():
        methods = dict.fromkeys(method for column in columns for method in column)
        rows = [
            [method, *(column.get(method, MISSING) for column in columns)] for method in methods
        ]
        yield table(f"{label}. {origins}.", heads, rows, right)
