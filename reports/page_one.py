"""Page one: the question, the mechanism, the answer, one table of all methods, and the answer of each study.

The text is ``templates/page_one.md``. The table is the union of the headlines of the studies, a column each; nothing
here knows a study by name.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from stiction.comparisons.bench.methods import grouped_methods
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.results import Results
from stiction.engines.status import Status
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.markdown.tables import aligned
from stiction.reports.recommendation import mechanism, recommendation
from stiction.reports.report import Report
from stiction.reports.text import SHOWN, Number, filled, items, one_line, template

TITLE = "Which solver gets a sticking slider right? (Zhuang & Wang 2014)"
MOST_NAMED = 3
"""Methods with failed runs that are named one by one."""
TEMPLATE = "page_one.md"
INTERRUPTED = (
    "The run was interrupted: what follows is based on the runs that were made until then."
)
WIDTH = 118
"""Characters of a line."""


@dataclass(frozen=True)
class HeadlineTable:
    """The table of all methods: headings, the method's first, and by group each method's cells, None where unknown."""

    heads: tuple[str, ...]
    groups: Mapping[str, Mapping[str, Sequence[str | None]]]

    @property
    def rows(self) -> Iterator[list[str]]:
        """Text, row by row; a row with the name of each group before its methods."""
        for name, methods in self.groups.items():
            yield [f"*{name}*", *[""] * (len(self.heads) - 1)]
            for method, cells in methods.items():
                yield [method, *(text or MISSING for text in cells)]

    @property
    def right(self) -> list[bool]:
        """True for columns of numbers, which stand to the right."""
        return [False] + [True] * (len(self.heads) - 1)


@dataclass(frozen=True)
class PageOne:
    """The words of page one in parts.

    Attributes
    ----------
    mechanism, how_to_read, runs, not_installed : str
        A paragraph each; empty where there is nothing to say.
    recommendation : sequence of str
        An item each.
    numbers : sequence of Number
        The numbers of the recommendation.
    """

    mechanism: str
    recommendation: Sequence[str]
    how_to_read: str
    runs: str
    not_installed: str
    numbers: Sequence[Number]


def headline_table(report: Report) -> HeadlineTable:
    """Put the headlines of all studies side by side, for every method."""
    headlines = [headline for section in report.said.values() for headline in section.headlines]
    groups = {
        group.label: {
            method: [headline.cells.get(method) for headline in headlines] for method in methods
        }
        for group, methods in grouped_methods(report.results)
    }
    return HeadlineTable(
        ("method", *(headline.label for headline in headlines)), groups if headlines else {}
    )


def answers(report: Report) -> list[tuple[str, str]]:
    """Title and answer of the studies that have one for page one, with what is said beside it."""
    return [
        (study.title, " ".join(filter(None, (said.answer, said.beside))))
        for study, said in report.said.items()
        if study.title and study.on_page_one and said.answer
    ]


def page_one(report: Report) -> PageOne:
    """Return the words of the page."""
    numbers: list[Number] = []
    blocks = filled(template(TEMPLATE), _variables(report, numbers))
    return PageOne(
        one_line(blocks["mechanism"]),
        items(blocks["recommendation"]),
        one_line(blocks["how_to_read"]),
        one_line(blocks["runs"]),
        one_line(blocks["not_installed"]),
        numbers,
    )


def page_one_markdown(report: Report, picture: str, origin: str) -> str:
    """Write the page in Markdown, in lines of at most `WIDTH` characters.

    `picture`: Markdown of the mechanism's picture; none if empty. `origin`: when and with what it was run, in a line.
    """
    text = template(TEMPLATE).render(_variables(report, [], picture=picture, origin=origin))
    return "\n\n".join(filter(None, map(_wrapped, re.split(r"\n\s*\n", text))))


def answer_lines(report: Report) -> Iterator[str]:
    """Yield the answers for a terminal, a line each."""
    page = page_one(report)
    if report.results.settings.get("interrupted"):
        yield INTERRUPTED
    yield from page.recommendation
    yield from (
        f"{study.title}: {said.answer}"
        for study, said in report.said.items()
        if study.title and said.answer
    )
    yield " ".join(filter(None, (page.runs, page.not_installed)))


def _variables(
    report: Report, numbers: list[Number], picture: str = "", origin: str = ""
) -> dict[str, object]:
    """What the template reads."""
    results, table = report.results, headline_table(report)
    return {
        "title": TITLE,
        "interrupted": INTERRUPTED if results.settings.get("interrupted") else "",
        "mechanism": mechanism(results),
        "picture": picture,
        **recommendation(results),
        "table": aligned(table.heads, list(table.rows), table.right, WIDTH) if table.groups else "",
        "answers": answers(report),
        "runs": _runs(results),
        "origin": origin,
        "missing_engines": list(
            dict.fromkeys(
                record.variant.engine
                for record in results.records
                if record.outcome.status == Status.MISSING
            )
        ),
        SHOWN: numbers,
    }


def _runs(results: Results) -> dict[str, object]:
    """Count the compared runs that succeeded, ended early, and failed, and name methods of failures elsewhere."""
    table = pd.DataFrame(
        [record.describe() for record in results.records], columns=["status", "reason"]
    )
    made = table[table["status"] != Status.MISSING]
    is_early = (made["status"] == Status.OK) & (made["reason"] != "")
    is_ok = (made["status"] == Status.OK) & ~is_early
    failed = failed_runs(results)
    elsewhere = list(failed.loc[failed["table"] != "runs", "variant"].dropna().unique())
    if len(elsewhere) > MOST_NAMED:
        elsewhere = [*elsewhere[:MOST_NAMED], "others"]
    return {
        "made": len(made),
        "ok": int(is_ok.sum()),
        "early": int(is_early.sum()),
        "others": made.loc[~is_ok & ~is_early, "status"].value_counts(sort=False).to_dict(),
        "elsewhere": elsewhere,
    }


def _wrapped(block: str) -> str:
    """Break the lines of a paragraph or of a list; tables, headings and pictures stay as they are."""
    block = block.strip()
    if block.startswith(("|", "#", "![")):
        return block
    if not block.startswith("- "):
        return _filled(one_line(block))
    return "\n".join(_filled(f"- {item}", "  ") for item in items(block))


def _filled(text: str, indent: str = "") -> str:
    return textwrap.fill(
        text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
