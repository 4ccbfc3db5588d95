"""What a site shows: the nights of a history, runs of `stiction validate`, and files for download."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import pandas as pd

from stiction.comparisons.bench.planned_runs import TRUTH
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.study import Study
from stiction.comparisons.regression.check import Finding
from stiction.comparisons.regression.history import open_history
from stiction.comparisons.regression.value_changes import value_changes
from stiction.comparisons.studies import studies
from stiction.engines.status import Status
from stiction.reports.page.document import unique_anchor
from stiction.reports.page.nights import Nights, read_nights
from stiction.reports.report import Report, report_of
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.text import Section
from stiction.scenes import InputError

FILES_NOTE = "not part of the download, the commands make them again"
"""Where the trajectories and truths of a run are found, which a site does not contain."""


@dataclass(frozen=True, eq=False)
class SiteRun:
    """A run of `stiction validate` with its report.

    Attributes
    ----------
    stored : StoredRun
    report : Report
    """

    stored: StoredRun
    report: Report

    @property
    def date(self) -> str:
        """Date and time of the run, UTC, in the format of ISO 8601."""
        return str(self.stored.origin["date"])


@dataclass(frozen=True)
class Download:
    """A file of the site for download.

    Attributes
    ----------
    path : str
        Its path in the site.
    label, description : str
        Text of the link, and what the file contains.
    """

    path: str
    label: str
    description: str


@dataclass(frozen=True, eq=False)
class SubmissionContent:
    """A judged submission.

    Attributes
    ----------
    path : str
        Path of its page in the site.
    title : str
        The engine with its version.
    about : Mapping[str, str]
        Who made the submission and how: name of a property and its value.
    section : Section
        Text and tables of the judgement.
    """

    path: str
    title: str
    about: Mapping[str, str]
    section: Section


@dataclass(frozen=True, eq=False)
class SiteContent:
    """All that the pages of a site are made from.

    Attributes
    ----------
    nights : Nights
        The finished nights of the history.
    value_changes : mapping
        By night, the changes of its runs since the night before that are beyond noise; without the first.
    runs : sequence of SiteRun
        Runs of `stiction validate`, the oldest first; may be empty.
    submissions : sequence of SubmissionContent
        Judged submissions to the benchmark.
    downloads : sequence of Download
    docs : Path or None
        Folder with the documentation as HTML.
    """

    nights: Nights
    value_changes: Mapping[str, Sequence[Finding]]
    runs: Sequence[SiteRun]
    submissions: Sequence[SubmissionContent]
    downloads: Sequence[Download]
    docs: Path | None

    @property
    def newest(self) -> str:
        """The newest night."""
        return self.nights.names[-1]

    @property
    def newest_run(self) -> SiteRun | None:
        """The newest run of `stiction validate`; None if there is none."""
        return self.runs[-1] if self.runs else None

    @cached_property
    def newest_rows(self) -> pd.DataFrame:
        """The rows of the newest night without those of truths and of engines that are not installed."""
        rows = self.nights.rows
        is_shown = (
            (rows["night"] == self.newest)
            & (rows["variant"] != TRUTH)
            & (rows["status"] != Status.MISSING)
        )
        return rows[is_shown]

    def section(self, study: Study) -> Section | None:
        """Return the section of a study in the newest run; None if it has none."""
        return None if self.newest_run is None else self.newest_run.report.sections.get(study)

    @cached_property
    def questions(self) -> list[Study]:
        """The studies that have a page: a section in the newest run, or numbers in the newest night."""
        return [
            study
            for study in studies()
            if self.section(study) is not None or not night_rows(self.newest_rows, study).empty
        ]

    @cached_property
    def engine_pages(self) -> dict[str, str]:
        """By the name of an engine that took part in a night, the path of its page."""
        runs = self.nights.rows[self.nights.rows["variant"] != TRUTH]
        return {
            engine: f"engines/{unique_anchor(engine)}.html"
            for engine in dict.fromkeys(map(str, runs["engine"]))
        }


def question_path(study: Study) -> str:
    """Return the path of the page of a study."""
    return f"questions/{study.name}.html"


def night_rows(rows: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Return the rows of a history whose numbers belong to the question of a study."""
    numbers = study.nightly
    if numbers is None:
        return rows.iloc[:0]
    is_chosen = rows["metric"].isin(numbers.metrics)
    if numbers.scenes:
        is_chosen &= rows["scene"].isin(numbers.scenes)
    return rows[is_chosen]


def versions_in_words(rows: pd.DataFrame) -> str:
    """Return the versions of an engine in rows of a history, joined by "and"; `MISSING` if no run states one."""
    return " and ".join(dict.fromkeys(rows["version"].dropna())) or MISSING


def read_content(
    history: Path,
    runs: Sequence[StoredRun],
    submissions: Sequence[SubmissionContent],
    downloads: Sequence[Download],
    docs: Path | None,
) -> SiteContent:
    """Read a history, and return it with the reports of runs and the other content.

    Raises
    ------
    HistoryRefused
        If `history` is not a history.
    InputError
        If it has no finished night.
    """
    nights = _finished(read_nights(history), history)
    with open_history(history, write=False) as opened:
        changes = {
            night: value_changes(opened, before, night) for before, night in pairwise(nights.names)
        }
    ordered = sorted(runs, key=lambda run: str(run.origin["date"]))
    return SiteContent(
        nights,
        changes,
        [SiteRun(run, report_of(run.validation())) for run in ordered],
        submissions,
        downloads,
        docs,
    )


def _finished(nights: Nights, history: Path) -> Nights:
    """Return the finished nights of a history; raise InputError if there are none."""
    table = nights.table[nights.table["finished"].notna()]
    if table.empty:
        raise InputError(
            f"{history}: found {len(nights.names)} nights, none of them finished; expected a history with "
            "at least one finished night of `stiction nightly`"
        )
    return replace(nights, table=table, rows=nights.rows[nights.rows["finished"].notna()])
