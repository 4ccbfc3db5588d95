"""Page one: the question, the mechanism, the answer, one table of all methods, and the answer of each study.

The table is the union of the headlines of the studies, a column each; nothing here knows a study by name.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import pandas as pd

from stiction.comparisons.methods import MISSING_ENGINE, grouped_methods
from stiction.comparisons.presentation.cells import MISSING
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.traced_text import Number, TracedText, count, listed, traced
from stiction.comparisons.recommendation import mechanism_in_words, recommendation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study
from stiction.reports.markdown.tables import aligned

TITLE = "Which solver gets a sticking slider right? (Zhuang & Wang 2014)"
WIDTH = 118
"""Characters of a line."""
INTERRUPTED = "**It was interrupted: all that follows is of the runs that were made until then.**"
HOW_TO_READ = ("Errors and drift are the worst of all cases, at the step nearest to 1 ms that was run, or the tightest tolerance; CPU time and stick limit "
               "are of the first case, the limit at its finest step. Joint: ideal guides with a friction law on them. Contact: the slider touches two surfaces. mus = mu: the engine has one coefficient of friction, "
               "and its truth has, too. Compare methods within a group only.")


@dataclass(frozen=True)
class Group:
    """Methods that answer one question, and what each headline says of each: None where it says nothing."""

    name: str
    rows: tuple[tuple[str, tuple[TracedText | None, ...]], ...]


@dataclass(frozen=True)
class HeadlineTable:
    """Headings, the method's first, and the rows by group."""

    heads: tuple[str, ...]
    groups: tuple[Group, ...]

    @property
    def cells(self) -> Iterator[list[str]]:
        """Text, row by row, a row with the name of each group before its methods."""
        for group in self.groups:
            yield [f"*{group.name}*", *[""] * (len(self.heads) - 1)]
            for method, said in group.rows:
                yield [method, *(MISSING if part is None else part.text for part in said)]


def headline_table(results: Results, said: Mapping[Study, Presentation]) -> HeadlineTable:
    """The headlines of all studies beside each other, for every method."""
    headlines = [headline for presentation in said.values() for headline in presentation.headlines]
    groups = [Group(name, tuple((method, tuple(headline.cells.get(method) for headline in headlines)) for method in methods))
              for name, methods in grouped_methods(results)]
    return HeadlineTable(("method", *(headline.label for headline in headlines)), tuple(groups) if headlines else ())


def bullets(said: Mapping[Study, Presentation]) -> Iterator[tuple[str, TracedText]]:
    """Title and answer of the studies that have one for page one."""
    for study, presentation in said.items():
        if study.title and study.on_page_one and presentation.answer:
            yield study.title, presentation.answer


def page_one(results: Results, said: Mapping[Study, Presentation], picture: str, origin: str) -> str:
    """The page in Markdown, in lines of at most `WIDTH` characters.

    Parameters
    ----------
    picture
        Markdown of the mechanism's picture; none if empty.
    origin
        When and with what it was run, in a line.
    """
    table = headline_table(results, said)
    answer = recommendation(results)
    parts = [f"# {TITLE}", INTERRUPTED if results.settings.get("interrupted") else "", _filled(mechanism_in_words(results)), picture]
    if answer:
        first, *others = answer
        parts.append("\n".join([_filled(f"**Answer.** {first.text}"), *(_item(part.text) for part in others)]))
    if table.groups:
        parts += [aligned(table.heads, list(table.cells), [False] + [True] * (len(table.heads) - 1)), _filled(HOW_TO_READ)]
    parts.append("\n".join(_item(f"**{title}.** {told.text}") for title, told in bullets(said)))
    parts.append(_filled(" ".join(filter(None, (runs_in_words(results).text, origin, not_installed(results))))))
    return "\n\n".join(filter(None, parts))


def answer_lines(results: Results, said: Mapping[Study, Presentation]) -> Iterator[str]:
    """The answers for a terminal, a line each."""
    if results.settings.get("interrupted"):
        yield INTERRUPTED.strip("*")
    yield from (part.text for part in recommendation(results))
    yield from (f"{study.title}: {presentation.answer.text}" for study, presentation in said.items() if study.title and presentation.answer)
    yield " ".join(filter(None, (runs_in_words(results).text, not_installed(results))))


def numbers(results: Results, said: Mapping[Study, Presentation]) -> list[Number]:
    """Every traced number of the page."""
    table = headline_table(results, said)
    told = [part for group in table.groups for _, cells in group.rows for part in cells if part is not None]
    told += [*recommendation(results), *(answer for _, answer in bullets(said)), runs_in_words(results)]
    return [number for part in told for number in part.numbers]


def not_installed(results: Results) -> str:
    """The engines that took no part because their package is not there; empty without any."""
    names = list(dict.fromkeys(record.variant.engine for record in results.records if record.outcome.status == MISSING_ENGINE))
    return f"Not installed: {', '.join(names)}; `stiction engines` says how to install them." if names else ""


def runs_in_words(results: Results) -> TracedText:
    """How many runs succeeded, how many of them ended early, and how the others ended; engines that are not installed have none."""
    made = [record.describe() for record in results.records if record.outcome.status != MISSING_ENGINE]
    if not made:
        return TracedText("There were no runs.")
    table = pd.DataFrame([record.describe() for record in results.records])
    early = frozenset(run["reason"] for run in made if run["status"] == "ok" and run["reason"])
    failed = dict.fromkeys(run["status"] for run in made if run["status"] != "ok")
    parts = [traced("{} {}", count("runs", table, status=status), status) for status in failed]
    parts += [traced("{} of those ended early", count("runs", table, status="ok", reason=early))] if early else []
    if not parts:
        return traced("All {} runs succeeded.", count("runs", table, status="ok"))
    all_made = count("runs", table, status=frozenset(run["status"] for run in made))
    return traced("{} of {} runs succeeded; {}.", count("runs", table, status="ok"), all_made, listed(parts))


def _item(text: str) -> str:
    return textwrap.fill(f"- {text}", WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _filled(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)
