"""Page one of a report: the mechanism, the recommendation, a table of all methods, and the answers of the studies.

The text is ``templates/page_one.md``. The table has one column for each headline of a study. This module
does not depend on particular studies.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from stiction.comparisons.bench.methods import at_equal_step, grouped_methods, known_of
from stiction.comparisons.bench.presentation.cells import MISSING, setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import EVENTS_BY, FRICTION_BY
from stiction.engines.registry import own_methods
from stiction.engines.status import Status
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.markdown.tables import align_columns
from stiction.reports.recommendation import (
    is_relative_to_own_run,
    mechanism,
    own_mechanisms,
    recommendation,
)
from stiction.reports.report import Report
from stiction.reports.text import (
    NUMBERS,
    TITLE_OF,
    Number,
    items,
    listed,
    one_line,
    render_blocks,
    template,
)

TITLE = "How solvers treat a slider that sticks and slips (Zhuang & Wang 2014)"
"""Title of a report about the paper's three cases."""
MAX_METHODS_NAMED = 3
"""Largest number of methods with failed runs that are named; others are summed up as "others"."""
TEMPLATE = "page_one.md"
"""Path of the text in ``templates``."""
INTERRUPTED = (
    "The run was interrupted: what follows is based on the runs that were made until then."
)
WIDTH = 118
"""Largest number of characters in a line of the Markdown."""
ABOUT_METHOD = ("run", "friction law / events by")
"""Headings of the columns that describe the runs of a method: its step or tolerance, and who supplies what."""
OWN_GROUP = "solvers of this suite: {}"
"""Heading of a group of solvers of this suite, which are not listed among the engines of others."""


@dataclass(frozen=True)
class HeadlineTable:
    """The table of all methods on page one.

    Attributes
    ----------
    heads : tuple of str
        Headings of the columns: the name of the method, `ABOUT_METHOD`, and the headlines.
    groups : mapping
        By the name of a group and the name of a method, the cells of the other columns. A cell is None
        where the study has no value for the method.
    """

    heads: tuple[str, ...]
    groups: Mapping[str, Mapping[str, Sequence[str | None]]]

    @property
    def headline_heads(self) -> tuple[str, ...]:
        """Headings of the columns that contain headlines."""
        return self.heads[1 + len(ABOUT_METHOD) :]

    @property
    def rows(self) -> Iterator[list[str]]:
        """The cells of each row in Markdown, with the names of groups emphasized."""
        return self._rows(group_format="*{}*")

    @property
    def plain_rows(self) -> Iterator[list[str]]:
        """The cells of each row as plain text."""
        return self._rows(group_format="{}")

    def _rows(self, group_format: str) -> Iterator[list[str]]:
        """Yield the cells of each row; a row with the name of the group precedes its methods."""
        for name, methods in self.groups.items():
            yield [group_format.format(name), *[""] * (len(self.heads) - 1)]
            for method, cells in methods.items():
                yield [method, *(text or MISSING for text in cells)]

    @property
    def right(self) -> list[bool]:
        """Whether each column contains numbers, which are aligned to the right."""
        return [False] * (1 + len(ABOUT_METHOD)) + [True] * len(self.headline_heads)


@dataclass(frozen=True)
class PageOne:
    """The text of page one, divided into parts.

    Attributes
    ----------
    mechanism, how_to_read, runs, not_installed : str
        A paragraph each; empty where it does not apply.
    not_applicable : sequence of str
        A line for each study that does not apply to all scenes, with the reason.
    recommendation : sequence of str
        Items of a list.
    numbers : sequence of Number
        The numbers in the recommendation.
    """

    mechanism: str
    recommendation: Sequence[str]
    how_to_read: str
    runs: str
    not_installed: str
    not_applicable: Sequence[str]
    numbers: Sequence[Number]


def title_of(results: Results) -> str:
    """Return the title of a report: `TITLE`, or the titles of the scenes if they are not the paper's cases."""
    if results.is_about_paper:
        return TITLE
    titles = [results.title_of(name) for name in results.compared_scenes]
    return f"Solvers compared: {listed(titles, '; ', '; ')}"


def headline_table(report: Report) -> HeadlineTable:
    """Return the table that contains the headlines of all studies for every method.

    The solvers of this suite follow the engines of others, in groups of their own.
    """
    headlines = [headline for section in report.sections.values() for headline in section.headlines]
    heads = ("method", *ABOUT_METHOD, *(headline.label for headline in headlines))
    if not headlines:
        return HeadlineTable(heads, {})
    table = report.results.table("accuracy")
    engine_of = {record.variant.label: record.variant.engine for record in report.results.records}
    engine_groups: dict[str, dict[str, list[str | None]]] = {}
    own_groups: dict[str, dict[str, list[str | None]]] = {}
    for group, labels in grouped_methods(report.results):
        for method in labels:
            cells: list[str | None] = [*_about_method(table, method)]
            cells += [headline.cells.get(method) for headline in headlines]
            if engine_of.get(method) in own_methods():
                own_groups.setdefault(OWN_GROUP.format(group.label), {})[method] = cells
            else:
                engine_groups.setdefault(group.label, {})[method] = cells
    return HeadlineTable(heads, {**engine_groups, **own_groups})


def _about_method(table: pd.DataFrame, method: str) -> tuple[str, str]:
    """Return the step or tolerance of the runs of a method, and who supplies its friction law and its events."""
    runs = at_equal_step(table, method)
    setting = setting_of(runs["parameter"].iloc[0], runs["step"].iloc[0])
    suppliers = [known_of(table, column)[method] for column in (FRICTION_BY, EVENTS_BY)]
    return setting, " / ".join(suppliers)


def answers(report: Report) -> list[tuple[str, str]]:
    """Return (title, answer) of each study that has an answer for page one; the answer includes `Section.beside`."""
    return [
        (study.title, f"{section.answer} {section.beside}".strip())
        for study, section in report.sections.items()
        if study.title and study.on_page_one and section.answer
    ]


def page_one(report: Report) -> PageOne:
    """Return the text of page one, without the table and the answers of the studies."""
    numbers: list[Number] = []
    # The filters of the template append the numbers that they write to this list.
    variables = {**_variables(report), NUMBERS: numbers}
    blocks = render_blocks(template(TEMPLATE), variables)
    return PageOne(
        mechanism=one_line(blocks["mechanism"]),
        recommendation=items(blocks["recommendation"]),
        how_to_read=one_line(blocks["how_to_read"]),
        runs=one_line(blocks["runs"]),
        not_installed=one_line(blocks["not_installed"]),
        not_applicable=items(blocks["not_applicable"]),
        numbers=numbers,
    )


def page_one_markdown(report: Report, picture: str, origin: str) -> str:
    """Return page one in Markdown, in lines of at most `WIDTH` characters.

    Parameters
    ----------
    picture : str
        Markdown of the picture of the mechanism; empty for none.
    origin : str
        One line that states the date of the run and the versions of stiction and of the engines.
    """
    variables = {**_variables(report), NUMBERS: [], "picture": picture, "origin": origin}
    text = template(TEMPLATE).render(variables)
    blocks = [_wrap_block(block) for block in re.split(r"\n\s*\n", text)]
    return "\n\n".join(block for block in blocks if block)


def answer_lines(report: Report) -> Iterator[str]:
    """Yield the recommendation, the answer of each study and the number of runs, as lines for a terminal."""
    page = page_one(report)
    if report.results.settings.get("interrupted"):
        yield INTERRUPTED
    yield from page.recommendation
    for study, section in report.sections.items():
        if study.title and section.answer:
            yield f"{study.title}: {section.answer}"
    yield f"{page.runs} {page.not_installed}".strip()
    yield from page.not_applicable


def _variables(report: Report) -> dict[str, object]:
    """Return the variables of the template that depend on the report."""
    results = report.results
    headlines = headline_table(report)
    table = ""
    if headlines.groups:
        table = align_columns(headlines.heads, list(headlines.rows), headlines.right, WIDTH)
    missing_engines = [
        record.variant.engine
        for record in results.records
        if record.outcome.status == Status.MISSING
    ]
    return {
        "title": title_of(results),
        "interrupted": INTERRUPTED if results.settings.get("interrupted") else "",
        "noun": "cases" if results.is_about_paper else "scenes",
        "depth": results.settings.get("depth"),
        "own_run_words": _own_run_words(results),
        "mechanism": mechanism(results),
        "own_mechanisms": own_mechanisms(results),
        "not_applicable": report.not_examined,
        "picture": "",
        **recommendation(results),
        "table": table,
        "answers": answers(report),
        "runs": _count_runs(results),
        "origin": "",
        "missing_engines": list(dict.fromkeys(missing_engines)),
        TITLE_OF: results.title_of,
    }


def _own_run_words(results: Results) -> str:
    """Return a remark about the errors of the reference if they are only relative to its own run."""
    if is_relative_to_own_run(results):
        return ", relative to our own run at a tighter tolerance,"
    return ""


@dataclass(frozen=True)
class RunCounts:
    """Numbers of runs by their status.

    Attributes
    ----------
    made : int
        Runs of engines that are installed.
    ok : int
        Runs that reached their end.
    early : int
        Runs that ended early.
    others : mapping
        Numbers of the other runs by status.
    elsewhere : list of str
        Methods with failures in studies that have runs of their own.
    unrecorded : int
        Runs of searches, if there are no others; only their results are stored.
    """

    made: int
    ok: int
    early: int
    others: Mapping[str, int]
    elsewhere: Sequence[str]
    unrecorded: int


def _count_runs(results: Results) -> RunCounts:
    """Count the runs by their status."""
    table = pd.DataFrame(
        [record.describe() for record in results.records], columns=["status", "reason"]
    )
    made = table[table["status"] != Status.MISSING]
    is_early = (made["status"] == Status.OK) & (made["reason"] != "")
    is_ok = (made["status"] == Status.OK) & ~is_early
    failed = failed_runs(results)
    elsewhere = list(failed.loc[failed["table"] != "runs", "variant"].dropna().unique())
    if len(elsewhere) > MAX_METHODS_NAMED:
        elsewhere = [*elsewhere[:MAX_METHODS_NAMED], "others"]
    return RunCounts(
        made=len(made),
        ok=int(is_ok.sum()),
        early=int(is_early.sum()),
        others=made.loc[~is_ok & ~is_early, "status"].value_counts(sort=False).to_dict(),
        elsewhere=elsewhere,
        unrecorded=results.unrecorded_runs,
    )


def _wrap_block(block: str) -> str:
    """Break the lines of a paragraph or of the items of a list; other blocks are not changed.

    Line breaks would end the rows of a table, a heading or a picture.
    """
    block = block.strip()
    if block.startswith(("|", "#", "![")):
        return block
    if not block.startswith("- "):
        return _wrap_text(one_line(block))
    return "\n".join(_wrap_text(f"- {item}", "  ") for item in items(block))


def _wrap_text(text: str, indent: str = "") -> str:
    """Break a text into lines of at most `WIDTH` characters; `indent` begins all lines but the first."""
    return textwrap.fill(
        text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
