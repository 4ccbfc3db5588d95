"""Content of a history of nightly runs, and of the folders of its nights, as pages show it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression.check import BETTER, COULD_NOT_RUN, REGRESSION
from stiction.comparisons.regression.history import NO_DRAW, History, open_history
from stiction.comparisons.regression.night_changes import environment_changes
from stiction.engines.status import Status
from stiction.reports.markdown.regression_report import REPORT, SUMMARY, VERDICT_TITLES

SHOWN_SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER)
"""Severities of the findings for which the page of a history selects a chart at first."""
HAS_FAILED = "has_failed"
"""Column that this module adds to the rows of the history: whether the run failed or ended early.

Runs that were refused (`IS_REFUSED`) are no failures.
"""


IS_REFUSED = "is_refused"
"""Column that this module adds: whether the engine or its adapter cannot represent the scene of the run."""
VERDICTS = {COULD_NOT_RUN: VERDICT_TITLES[COULD_NOT_RUN]}
"""Words for stored verdicts in texts, where the stored ones would not be understood."""


@dataclass(frozen=True)
class NightFolder:
    """Content of the folder of a night, which `stiction.reports.markdown.regression_report` has written.

    All of it is empty if there is no such folder beside the history.

    Attributes
    ----------
    lines : tuple of str
        The summary, in Markdown.
    worst : (str, str) or None
        Metric and key of the worst finding; the metric is empty if the finding is about the whole run.
    worst_in_words : str
        The worst finding as text.
    regressions : frozenset of (str, str)
        Metric and key of each regression.
    report : Path or None
        The report of the night.
    """

    lines: tuple[str, ...] = ()
    worst: tuple[str, str] | None = None
    worst_in_words: str = ""
    regressions: frozenset[tuple[str, str]] = frozenset()
    report: Path | None = None


@dataclass(frozen=True, eq=False)
class Nights:
    """The content of a history.

    Attributes
    ----------
    table : DataFrame
        A row for each night, the oldest first, with the columns ``night, campaign, machine, commit_hash,
        finished, verdict``.
    rows : DataFrame
        The rows of the history (`stiction.comparisons.regression.history`), with the columns `HAS_FAILED` and
        `IS_REFUSED`.
    origins : mapping
        By night, the `environment.origin` of its numbers.
    changes : mapping
        By night, what has changed in the environment since the night before, as text; empty for the first.
    folders : mapping
        By night, the content of its folder.
    """

    table: pd.DataFrame
    rows: pd.DataFrame
    origins: Mapping[str, Mapping[str, Any]]
    changes: Mapping[str, str]
    folders: Mapping[str, NightFolder]

    @property
    def names(self) -> list[str]:
        """The nights, the oldest first."""
        return list(self.table["night"])


def read_nights(history: Path) -> Nights:
    """Read a history, and the folders of its nights beside it.

    Raises
    ------
    HistoryRefused
        If `history` is not a history.
    """
    with open_history(history, write=False) as opened:
        table = pd.read_sql(
            "SELECT night, campaign, machine, commit_hash, finished, verdict FROM nights "
            "ORDER BY night",
            opened.connection,
        )
        rows = pd.read_sql(f"SELECT * FROM history WHERE {NO_DRAW}", opened.connection)
        names = list(table["night"])
        origins = {night: opened.origin(night) for night in names}
        changes = _changes(opened, names)
    rows[IS_REFUSED] = rows["status"] == Status.REFUSED
    rows[HAS_FAILED] = ((rows["status"] != Status.OK) | (rows["reason"] != "")) & ~rows[IS_REFUSED]
    folders = {night: _read_folder(history.parent / folder_name(night)) for night in names}
    return Nights(table, rows, origins, changes, folders)


def status_in_words(status: str, reason: str) -> str:
    """Return the word for the status of a run.

    It is ``not applicable`` for a run that was refused, and ``incomplete`` for one that ended early.
    """
    if status == Status.REFUSED:
        return "not applicable"
    if status == Status.OK and reason:
        return Status.INCOMPLETE.label
    return Status(status).label


def folder_name(night: str) -> str:
    """Return the name of the folder of a night; Windows does not allow the colons of its time in names."""
    return night.replace(":", "")


def _read_folder(folder: Path) -> NightFolder:
    """Read the folder of a night; if it does not exist, the result is empty."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return NightFolder()
    findings = [
        finding for finding in summary["findings"] if finding["severity"] in SHOWN_SEVERITIES
    ]
    regressions = frozenset(
        (finding["metric"], finding["key"])
        for finding in findings
        if finding["severity"] == REGRESSION
    )
    worst = None
    worst_in_words = ""
    if findings:
        # Findings are sorted by severity, the worst first.
        metric, key, kind = (findings[0][name] for name in ("metric", "key", "kind"))
        worst = (metric, key)
        subject = quantity_of(metric).head if metric else kind
        worst_in_words = " of ".join(part for part in (subject, key) if part)
    lines = tuple(summary.get("lines", ()))
    return NightFolder(lines, worst, worst_in_words, regressions, folder / REPORT)


def _changes(history: History, nights: Sequence[str]) -> dict[str, str]:
    """Return for each night what has changed in the environment since the night before."""
    changes = dict.fromkeys(nights, "")
    for before, night in pairwise(nights):
        parts = environment_changes(
            history.origin(before),
            history.origin(night),
            history.engines(before),
            history.engines(night),
        )
        changes[night] = "; ".join(parts) or "nothing"
    return changes
