"""The front page of a site: what stiction is, the answer of the newest run, and what the site contains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape

from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.study import Study
from stiction.reports.page.document import Cell, Link, anchor_of, markdown, table
from stiction.reports.page.nights import HAS_FAILED, IS_REFUSED
from stiction.reports.page.run_page import figure_html, row_anchor
from stiction.reports.page_one import ABOUT_METHOD, INTERRUPTED, headline_table, page_one, title_of
from stiction.reports.run_folder.trace import keys
from stiction.reports.site.content import SiteContent, SiteRun, question_path, versions_in_words
from stiction.reports.site.layout import (
    INDEX,
    NIGHTS,
    anchor,
    bullet_list,
    page,
    run_origin,
    time_in_words,
)
from stiction.reports.text import Section, items, render_blocks, template

TEMPLATE = "site/front.md"
"""Path of the text in ``templates``."""
TITLE = "stiction: how solvers treat dry friction in sliding joints"
"""Heading of the front page."""
MECHANISM_PICTURE = "mechanism-"
"""Beginning of the names of pictures of mechanisms."""
TERM_OF_COLUMN = {"friction law / events by": "adapter"}
"""Term of the glossary to which the heading of a column of the table of methods leads."""


def front_page(content: SiteContent) -> str:
    """Return the HTML of the front page."""
    subtitle = f"Results of the night of {time_in_words(content.newest)}"
    if content.newest_run is not None:
        subtitle += f" and of the run of {time_in_words(content.newest_run.date)}"
    return page(content, INDEX, TITLE, subtitle, _sections(content))


def _sections(content: SiteContent) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading of each section of the page, and its blocks of HTML."""
    blocks = render_blocks(template(TEMPLATE), {})
    texts = {name: markdown(text) for name, text in blocks.items()}
    run = content.newest_run
    yield "What this is", [texts["what"]]
    yield "Dry friction in a sliding joint", [*_picture(run), texts["friction"]]
    if run is None:
        yield "The answer", [texts["no_run"]]
    else:
        yield "The answer", list(_answer(content, run))
    yield "Glossary", [_glossary(items(blocks["glossary"]))]
    yield "Questions", [texts["questions"], _questions(content)]
    yield "Engines", [texts["engines"], _engines(content)]
    if content.submissions:
        yield "Submissions", [texts["submissions"], _submissions(content)]
    yield "The newest night", _newest_night(content)
    if content.downloads:
        links = [
            f"{anchor(download.label, download.path)}: {escape(download.description)}"
            for download in content.downloads
        ]
        yield "Download", [bullet_list(links)]


def _picture(run: SiteRun | None) -> Iterator[str]:
    """Yield the HTML of the first picture of a mechanism in a run, if there is one."""
    figures = [] if run is None else run.report.figures
    for figure in figures:
        if run is not None and figure.name.startswith(MECHANISM_PICTURE):
            yield figure_html(run.stored, figure.name, figure.caption)
            return


def _term_anchor(term: str) -> str:
    """Return the identifier of a term of the glossary."""
    return f"term-{anchor_of(term)}"


def _glossary(entries: Sequence[str]) -> str:
    """Return the HTML of the glossary; an entry is a term and its explanation, separated by a colon."""
    lines = []
    for entry in entries:
        term, _, explanation = entry.partition(": ")
        lines.append(
            f'<dt id="{_term_anchor(term)}">{escape(term)}</dt>\n<dd>{escape(explanation)}</dd>'
        )
    return "<dl>\n" + "\n".join(lines) + "\n</dl>"


def _answer(content: SiteContent, run: SiteRun) -> Iterator[str]:
    """Yield the HTML of page one of a run; the answers of the studies are among the questions."""
    report = run.report
    text = page_one(report)
    if report.results.settings.get("interrupted"):
        yield markdown(f"**{INTERRUPTED}**")
    yield f"<h3>{escape(title_of(report.results))}</h3>"
    yield markdown(text.mechanism)
    yield markdown("\n".join(f"- {item}" for item in text.recommendation))
    yield _table_of_methods(content, run)
    yield markdown(text.how_to_read)
    yield markdown(f"{text.runs} {text.not_installed}".strip())
    yield markdown("\n".join(f"- {line}" for line in text.not_applicable))


def _table_of_methods(content: SiteContent, run: SiteRun) -> str:
    """Return the HTML of the table of page one; its numbers lead to the rows that they come from."""
    headlines = headline_table(run.report)
    if not headlines.groups:
        return ""
    # A study may have several headlines, which are columns of the table one after another.
    studies = [study for study, section in run.report.sections.items() for _ in section.headlines]
    keys_of = {study: _keys_of_methods(run, run.report.sections[study]) for study in studies}
    heads: list[Cell] = [headlines.heads[0]]
    for head in ABOUT_METHOD:
        term = TERM_OF_COLUMN.get(head)
        heads.append(head if term is None else Link(head, f"#{_term_anchor(term)}"))
    for study, head in zip(studies, headlines.headline_heads, strict=True):
        heads.append(Link(head, question_path(study), study.question))
    engine_of = {
        record.variant.label: record.variant.engine for record in run.report.results.records
    }
    rows: list[list[Cell]] = []
    for group, methods in headlines.groups.items():
        # The groups are explained at the fidelity, whose name is part of theirs.
        fidelity = "contact" if "contact" in group else "joint"
        rows.append([Link(group, f"#{_term_anchor(fidelity)}")])
        for method, cells in methods.items():
            row: list[Cell] = [_method_link(content, run, method, engine_of.get(method, ""))]
            row += [text or MISSING for text in cells[: len(ABOUT_METHOD)]]
            for study, text in zip(studies, cells[len(ABOUT_METHOD) :], strict=True):
                row.append(_number_link(run, study, text, keys_of[study].get(method, [])))
            rows.append(row)
    depth = run.report.results.settings.get("depth")
    caption = (
        f"All methods; compare them only within a group. {run_origin(run)}"
        f"{f', depth {depth}' if depth else ''}. Each number leads to the row that it comes from."
    )
    return table(caption, heads, rows, headlines.right)


def _method_link(content: SiteContent, run: SiteRun, method: str, engine: str) -> Cell:
    """Return the cell with the name of a method, which leads to the page of its engine."""
    path = content.engine_pages.get(engine)
    if path is None:
        return method
    version = run.stored.origin["engines"].get(engine, "of unknown version")
    return Link(method, path, f"{engine} {version}")


def _number_link(run: SiteRun, study: Study, text: str | None, row_keys: Sequence[str]) -> Cell:
    """Return the cell with a number of page one, which leads to the first of its rows on the page of its study."""
    if text is None:
        return MISSING
    target = question_path(study)
    if not row_keys:
        return Link(text, target, run_origin(run))
    title = f"{', '.join(row_keys)}; {run_origin(run)}"
    return Link(text, f"{target}#{row_anchor(row_keys[0])}", title)


def _keys_of_methods(run: SiteRun, section: Section) -> Mapping[str, list[str]]:
    """Return the keys of the rows about each method, in the first table of a section with rows about methods."""
    for view in section.tables:
        source = run.stored.tables[view.source]
        if "variant" not in source:
            continue
        variants = list(source["variant"])
        keys_of: dict[str, list[str]] = {}
        for key, numbers in zip(keys(view), view.rows, strict=True):
            # Rows of the source are counted from 1.
            row_variants = {variants[number - 1] for number in numbers}
            if len(row_variants) == 1:
                keys_of.setdefault(row_variants.pop(), []).append(key)
        if keys_of:
            return keys_of
    return {}


def _questions(content: SiteContent) -> str:
    """Return the HTML of the list of questions, each with its answer in the newest run."""
    items = []
    for study in content.questions:
        item = f"{anchor(study.question, question_path(study))}"
        section = content.section(study)
        if section is not None and section.answer:
            answer = markdown(f"{section.answer} {section.beside}".strip())
            item += f"\n{answer}"
        items.append(item)
    return bullet_list(items)


def _engines(content: SiteContent) -> str:
    """Return the HTML of the table of engines of the newest night."""
    rows: list[list[Cell]] = []
    runs = content.newest_rows.drop_duplicates("key")
    for engine, path in content.engine_pages.items():
        part = runs[runs["engine"] == engine]
        refused = int(part[IS_REFUSED].sum())
        failed = int(part[HAS_FAILED].sum())
        whole = len(part) - refused - failed
        rows.append(
            [
                Link(engine, path),
                versions_in_words(part),
                str(len(part)),
                str(whole),
                str(refused),
                str(failed),
            ]
        )
    heads = ("engine", "version", "runs", "complete", "not applicable", "failed or ended early")
    return table(
        f"Engines and their runs in the night of {time_in_words(content.newest)}. Not applicable: the engine or its "
        "adapter cannot represent the scene; their pages list the reasons.",
        heads,
        rows,
        [False, False, True, True, True, True],
    )


def _submissions(content: SiteContent) -> str:
    """Return the HTML of the list of submissions, each with its verdict."""
    items = [
        f"{anchor(submission.title, submission.path)}\n{markdown(submission.section.answer)}"
        for submission in content.submissions
    ]
    return bullet_list(items)


def _newest_night(content: SiteContent) -> list[str]:
    """Return the HTML of the summary of the newest night."""
    folder = content.nights.folders[content.newest]
    blocks = [markdown("\n".join(f"- {line}" for line in folder.lines))]
    blocks.append(f"<p>{anchor('All nights, with their reports', NIGHTS)}</p>")
    return blocks
