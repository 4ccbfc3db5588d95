"""Page one: the question, the mechanism, the answer, one table of all methods, and the answer of each study.

The table is the union of the headlines of the studies, a column each; nothing here knows a study by name.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

import pandas as pd

from stiction.comparisons.bench.methods import MISSING_ENGINE, grouped_methods
from stiction.comparisons.bench.presentation import TracedText, count, listed, sentence, traced
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.results import Results
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.markdown.tables import aligned
from stiction.reports.recommendation import mechanism_in_words
from stiction.reports.report import Report

TITLE = "Which solver gets a sticking slider right? (Zhuang & Wang 2014)"
MOST_NAMED = 3
"""Methods with failed runs that are named one by one."""
WIDTH = 118
"""Characters of a line."""
INTERRUPTED = "**It was interrupted: all that follows is of the runs that were made until then.**"
HOW_TO_READ = (
    "Reference, paper's scheme and Moreau are solvers of this suite. Errors and drift: the worst of all cases, at the "
    "step nearest to 1 ms or the tightest tolerance. CPU time and stick limit: the first case, the limit at its finest "
    "step. > t: the finest run, t ms, misses it. ≤ t: the coarsest meets it. ~: timed once, or a wide interval. A jump "
    "that is not read has no bound. Declined: by the method's own word. Not judged: for our adapter, for what the "
    "engine can express, or for impulses. Joint: ideal guides with a friction law. Contact: the slider touches two "
    "surfaces. mus = mu: engine and truth have one coefficient of friction. Compare methods within a group only."
)


@dataclass(frozen=True)
class HeadlineTable:
    """The table of all methods: headings, the method's first, and by group each method's cells, None where unknown."""

    heads: tuple[str, ...]
    groups: dict[str, dict[str, list[str | None]]]

    @property
    def rows(self) -> Iterator[list[str]]:
        """Text, row by row; a row with the name of each group before its methods."""
        for name, methods in self.groups.items():
            yield [f"*{name}*", *[""] * (len(self.heads) - 1)]
            for method, cells in methods.items():
                yield [method, *(text or MISSING for text in cells)]


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


def bullets(report: Report) -> list[tuple[str, str]]:
    """Title and answer of the studies that have one for page one, with what is said beside it."""
    return [
        (study.title, " ".join(filter(None, (said.answer, said.beside))))
        for study, said in report.said.items()
        if study.title and study.on_page_one and said.answer
    ]


def page_one(report: Report, picture: str, origin: str) -> str:
    """Write the page in Markdown, in lines of at most `WIDTH` characters.

    `picture`: Markdown of the mechanism's picture; none if empty. `origin`: when and with what it was run, in a line.
    """
    results, table = report.results, headline_table(report)
    answer = report.answer
    parts = [
        f"# {TITLE}",
        INTERRUPTED if results.settings.get("interrupted") else "",
        _filled(mechanism_in_words(results)),
        picture,
        "\n".join(
            [*(_filled(f"**Answer.** {text}") for text in answer[:1]), *map(_item, answer[1:])]
        ),
    ]
    if table.groups:
        right = [False] + [True] * (len(table.heads) - 1)
        parts += [aligned(table.heads, list(table.rows), right, WIDTH), _filled(HOW_TO_READ)]
    parts += [
        "\n".join(_item(f"**{title}.** {text}") for title, text in bullets(report)),
        _filled(
            " ".join(filter(None, (runs_in_words(results).text, origin, not_installed(results))))
        ),
    ]
    return "\n\n".join(filter(None, parts))


def answer_lines(report: Report) -> Iterator[str]:
    """The answers for a terminal, a line each."""
    if report.results.settings.get("interrupted"):
        yield INTERRUPTED.strip("*")
    yield from report.answer
    yield from (
        f"{study.title}: {said.answer}"
        for study, said in report.said.items()
        if study.title and said.answer
    )
    yield " ".join(
        filter(None, (runs_in_words(report.results).text, not_installed(report.results)))
    )


def not_installed(results: Results) -> str:
    """Name the engines that took no part because their package is missing; empty without any."""
    names = dict.fromkeys(
        record.variant.engine
        for record in results.records
        if record.outcome.status == MISSING_ENGINE
    )
    return (
        f"Not installed: {', '.join(names)}; `stiction engines` says how to install them."
        if names
        else ""
    )


def runs_in_words(results: Results) -> TracedText:
    """Count the compared runs that succeeded, ended early, and failed, and say if runs of other studies failed."""
    table = pd.DataFrame([record.describe() for record in results.records])
    made = table[table["status"] != MISSING_ENGINE] if len(table) else table
    if made.empty:
        return TracedText("There were no runs.")
    ok = made["status"] == "ok"
    early = frozenset(made.loc[ok & (made["reason"] != ""), "reason"])
    parts = [
        traced("{} {}", count("runs", table, status=status), status)
        for status in made.loc[~ok, "status"].unique()
    ]
    if early:
        parts.append(
            traced("{} of those ended early", count("runs", table, status="ok", reason=early))
        )
    failed = failed_runs(results)
    elsewhere = list(failed.loc[failed["table"] != "runs", "variant"].dropna().unique())
    names = listed(
        elsewhere if len(elsewhere) <= MOST_NAMED else [*elsewhere[:MOST_NAMED], "others"]
    )
    others = sentence(" In other studies runs failed or ended early, of {}: `failures.md`.", names)
    if not parts:
        return traced(
            "All {} compared runs succeeded.{}", count("runs", table, status="ok"), others
        )
    everything = count("runs", table, status=frozenset(made["status"]))
    return traced(
        "{} of {} compared runs succeeded; {}.{}",
        count("runs", table, status="ok"),
        everything,
        listed(parts),
        others,
    )


def _item(text: str) -> str:
    return _filled(f"- {text}", "  ")


def _filled(text: str, indent: str = "") -> str:
    return textwrap.fill(
        text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
