"""Tables of the runs of a night: one row for each run, with the numbers that belong to a question."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from stiction.comparisons.bench.presentation.cells import MISSING, setting_of
from stiction.comparisons.bench.presentation.table_view import Column
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import scene_of_suite
from stiction.comparisons.bench.study import NightlyNumbers, Study
from stiction.comparisons.regression.night_changes import short_commit
from stiction.reports.page.document import Cell, Link, table, unique_anchor
from stiction.reports.page.nights import status_in_words
from stiction.reports.site.content import SiteContent, night_rows, question_path
from stiction.reports.site.layout import relative, time_in_words
from stiction.scenes.fidelity import FIDELITY_LABELS, Fidelity

RUN_COLUMNS = ("key", "scene", "variant", "engine", "fidelity", "parameter", "step", "version")
"""Columns of the history that describe a run, and have the same value in all rows of the run."""
STATE_COLUMNS = ("status", "reason")
"""Columns of the history that tell how a run ended."""
UNCERTAINTY = "{} uncertainty"
"""Name of the column with the uncertainties of a metric in a table of runs."""


def runs_table(rows: pd.DataFrame, metrics: Sequence[str]) -> pd.DataFrame:
    """Return a table with one row for each run of a night, in the order of the campaign.

    Parameters
    ----------
    rows : DataFrame
        Rows of the history, all of one night.
    metrics : sequence of str
        Metrics that become columns, each followed by a column with the uncertainty (`UNCERTAINTY`).
    """
    runs = rows.drop_duplicates("key")[[*RUN_COLUMNS, *STATE_COLUMNS]].set_index("key", drop=False)
    # A run that failed has stated no version.
    runs["version"] = runs["version"].fillna("")
    for metric in metrics:
        numbers = rows[rows["metric"] == metric].set_index("key")
        runs[metric] = numbers["value"].reindex(runs.index)
        runs[UNCERTAINTY.format(metric)] = numbers["uncertainty"].reindex(runs.index)
    return runs.reset_index(drop=True)


def runs_of_question(content: SiteContent, study: Study) -> pd.DataFrame:
    """Return the rows of all runs of the newest night on the scenes for which it has numbers of a question.

    Runs on these scenes without such numbers are included: they have failed, or do not have the quantity.
    """
    rows = content.newest_rows
    scenes = set(night_rows(rows, study)["scene"])
    return rows[rows["scene"].isin(scenes)]


def night_anchor(key: str) -> str:
    """Return the identifier of the row of a run in the tables of a night."""
    return f"night-{unique_anchor(key)}"


def night_tables(content: SiteContent, study: Study, page: str) -> Iterator[tuple[str, str]]:
    """Yield the title of each scene of the newest night, and the HTML of the table of its runs.

    The tables are empty if the nights do not measure the question.
    """
    numbers = study.nightly
    if numbers is None:
        return
    for scene, part in runs_of_question(content, study).groupby("scene", sort=False):
        title = scene_title(str(scene))
        caption = f"{title}: {study.title or study.question}, {night_in_words(content)}."
        yield (
            title,
            _scene_table(content, runs_table(part, numbers.metrics), numbers, caption, page),
        )


def _scene_table(
    content: SiteContent, runs: pd.DataFrame, numbers: NightlyNumbers, caption: str, page: str
) -> str:
    """Return the HTML of the runs of one scene, those of each fidelity below a heading."""
    columns = metric_columns(runs, numbers.metrics)
    heads: list[Cell] = ["method", "step or tolerance", *(column.head for column in columns)]
    heads += ["engine", "end of the run", "key"]
    right = [False, False, *(True for _ in columns), False, False, False]
    rows: list[list[Cell]] = []
    row_ids: list[str] = []
    for fidelity, part in runs.groupby("fidelity", sort=False):
        rows.append([f"{FIDELITY_LABELS[Fidelity(fidelity)]}s"])
        row_ids.append("")
        for run in part.to_dict("records"):
            target = relative(content.engine_pages[run["engine"]], page)
            rows.append(
                [
                    Link(run["variant"], target),
                    setting_of(run["parameter"], run["step"]),
                    *(column.text(run) for column in columns),
                    engine_version(run),
                    end_of_run(run),
                    run["key"],
                ]
            )
            row_ids.append(night_anchor(run["key"]))
    return table(caption, heads, rows, right, row_ids)


def engine_table(content: SiteContent, study: Study, engine: str, page: str) -> str:
    """Return the HTML of the runs of an engine in the newest night, with links to those of all engines.

    It is empty if there are none.
    """
    numbers = study.nightly
    if numbers is None:
        return ""
    rows = runs_of_question(content, study)
    rows = rows[rows["engine"] == engine]
    if rows.empty:
        return ""
    runs = runs_table(rows, numbers.metrics)
    columns = metric_columns(runs, numbers.metrics)
    heads: list[Cell] = ["scene", "method", "step or tolerance"]
    heads += [column.head for column in columns]
    heads += ["version", "end of the run", "key"]
    right = [False, False, False, *(True for _ in columns), False, False, False]
    table_rows: list[list[Cell]] = []
    for run in runs.to_dict("records"):
        target = relative(f"{question_path(study)}#{night_anchor(run['key'])}", page)
        table_rows.append(
            [
                run["scene"],
                run["variant"],
                setting_of(run["parameter"], run["step"]),
                *(column.text(run) for column in columns),
                run["version"] or MISSING,
                end_of_run(run),
                Link(run["key"], target),
            ]
        )
    caption = f"{study.title or study.question}: all runs of {engine}, {night_in_words(content)}."
    return table(caption, heads, table_rows, right)


def metric_columns(runs: pd.DataFrame, metrics: Sequence[str]) -> list[Column]:
    """Return a column for each metric that any of the runs has."""
    return [
        Column(metric, uncertainty=UNCERTAINTY.format(metric))
        for metric in metrics
        if runs[metric].notna().any()
    ]


def night_in_words(content: SiteContent) -> str:
    """Return the newest night and its commit as text."""
    commit = short_commit(content.nights.origins[content.newest].get("commit"))
    return f"night of {time_in_words(content.newest)}, commit {commit}"


def engine_version(run: Mapping[str, Any]) -> str:
    """Return the engine of a run with its version; the name alone if the run has not stated it."""
    return " ".join(part for part in (run["engine"], run["version"]) if part)


def end_of_run(run: Mapping[str, Any]) -> str:
    """Return how a run ended: its status and, if it did not reach its end, the reason."""
    status = status_in_words(run["status"], run["reason"])
    return f"{status}: {run['reason']}" if run["reason"] else status


def scene_title(name: str) -> str:
    """Return the name of a scene with its title; the name alone if the scene is a file of the campaign."""
    scene = scene_of_suite(name)
    return f"{name}: {scene.title}" if scene is not None and scene.title else name


def metric_head(metric: str) -> str:
    """Return the label of a metric with its unit; of a change of the status, which has no metric, the word."""
    return quantity_of(metric).head if metric else "end of the run"
