"""The report of a validation: the files of a run folder, and the text of its ``report.md``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import stored_keys
from stiction.comparisons.bench.presentation import MechanismPicture
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.results import Results
from stiction.reports.figures.charts import draw_figures
from stiction.reports.figures.style import Drawing, rc, save_all
from stiction.reports.markdown.failures import failed_runs, group_failures
from stiction.reports.markdown.study_section import figure_markdown, study_section
from stiction.reports.markdown.tables import fit_table, markdown
from stiction.reports.page_one import page_one_markdown, title_of
from stiction.reports.report import Report
from stiction.reports.run_folder.data import in_words, tables_of, write_data
from stiction.reports.run_folder.data_package import write_data_package
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.run_folder.provenance import commit_in_words, provenance
from stiction.reports.run_folder.reproduce import FOLDER, write_reproduce
from stiction.reports.text import template
from stiction.truths import Tier
from stiction.uncertain import rounded_up

REPORT = "report.md"
"""File with the report, which marks a folder as a run folder."""
FAILURES = "failures.md"
"""File with the failed runs, if there are any."""
TEMPLATE = "report.md"
"""Path of the text of the report in ``templates``."""
UNCERTAINTIES = {
    "position_uncertainty": "position [m]",
    "velocity_uncertainty": "velocity [m/s]",
    "event_time_uncertainty": "events [s]",
}
"""Headings of the uncertainties of truths, by their columns in the tables that compare runs with truths."""
BEST_FIRST = (Tier.PROVEN, Tier.CLOSED_FORM, Tier.HIGH_PRECISION, Tier.PUBLISHED, Tier.OWN_RUN)
"""Tiers of truths in the order of the report."""


def write_report(report: Report, folder: str | Path) -> Path:
    """Write the run folder of a validation, complete or not at all, and return the path of its ``report.md``.

    The folder also contains ``failures.md``, ``data/``, ``figures/``, ``reproduce/``, ``datapackage.json``
    and ``provenance.json``.

    Raises
    ------
    FolderRefused
        If content of the folder would be lost; `check_folder` finds this out before the runs.
    """
    results = report.results
    with run_folder(folder, REPORT) as partial:
        (partial / "figures").mkdir()
        with rc():
            drawings = list(draw_figures(report.figures, results))
        save_all(drawings, partial / "figures")
        write_data(results, partial, stored_keys(results))
        origin = provenance(results)
        failed = failed_runs(results)
        text = report_markdown(report, failed, origin, drawings)
        (partial / REPORT).write_text(text, encoding="utf-8")
        if not failed.empty:
            text = f"# Failed runs\n\n{markdown(failed)}\n"
            (partial / FAILURES).write_text(text, encoding="utf-8")
        write_data_package(partial, title_of(results), origin["date"])
        write_reproduce(results, origin, partial)
        # The provenance lists all files of the folder, and is therefore written last.
        write_provenance(partial, origin)
    return Path(folder) / REPORT


def report_markdown(
    report: Report, failed: pd.DataFrame, origin: Mapping[str, Any], drawings: Sequence[Drawing]
) -> str:
    """Return the text of ``report.md``.

    The first picture of a mechanism is shown on page one, and not again in its section.
    """
    results = report.results
    drawings_by_name = {drawing.name: drawing for drawing in drawings}
    picture = ""
    for figure in report.figures:
        if isinstance(figure, MechanismPicture):
            picture = figure_markdown(drawings_by_name.pop(figure.name))
            break
    sections = [
        study_section(study, section, drawings_by_name)
        for study, section in report.sections.items()
    ]
    return template(TEMPLATE).render(
        page_one=page_one_markdown(report, picture, _origin_line(origin)),
        tiers=[tier.label for tier in BEST_FIRST],
        is_about_paper=results.is_about_paper,
        missing=MISSING,
        sections=sections,
        failed=_failures_summary(failed),
        parameters=fit_table(tables_of(results)["parameters"]),
        choices=origin["choices"],
        truths=_truths(results),
        provenance=_provenance(origin),
    )


def _origin_line(origin: Mapping[str, Any]) -> str:
    """Return a sentence with the date of the run and the versions of stiction and of the engines."""
    date = origin["date"][:16].replace("T", " ")
    version = origin["versions"]["stiction"]
    engines = "".join(f", {name} {version}" for name, version in origin["engines"].items())
    return f"Run of {date} UTC with stiction {version}{engines}."


def _failures_summary(failed: pd.DataFrame) -> dict[str, object] | None:
    """Return the number of failed runs and a table of the reasons; None if no run failed."""
    if failed.empty:
        return None
    rows = group_failures(failed)[["variant", "status", "runs", "reason"]]
    return {
        "count": len(failed),
        "file": FAILURES,
        "table": fit_table(rows.rename(columns={"variant": "method"})),
    }


def _truths(results: Results) -> str:
    """Return a table of the truths of the runs with their uncertainties, the best tier first; empty if none."""
    columns = ["truth", "truth_tier", *UNCERTAINTIES]
    parts = [
        table.reindex(columns=columns)
        for table in results.tables.values()
        if {"truth", "truth_tier"} <= set(table.columns)
    ]
    if not parts:
        return ""
    rows = pd.concat(parts)
    rows = rows[rows["truth"].notna() & (rows["truth_tier"] != Tier.NONE)]
    if rows.empty:
        return ""
    # A truth may be known less accurately over a longer time, or for other quantities of a run.
    largest = rows.groupby(["truth", "truth_tier"], sort=False)[list(UNCERTAINTIES)].max()
    largest = largest.dropna(how="all").reset_index()
    largest = largest.sort_values(
        "truth_tier", key=lambda tiers: tiers.map(BEST_FIRST.index), kind="stable"
    )
    for name in UNCERTAINTIES:
        largest[name] = [
            MISSING if pd.isna(value) else f"± {rounded_up(value)}" for value in largest[name]
        ]
    return fit_table(largest.rename(columns={**UNCERTAINTIES, "truth_tier": "tier"}))


def _provenance(origin: Mapping[str, Any]) -> dict[str, str]:
    """Return the entries of the provenance as text.

    Nested entries, such as the load of the machine during the campaign, are left out.
    """
    parts = {
        "date": origin["date"],
        "commit": commit_in_words(origin),
        "source": f"SHA-256 {origin['source']}",
        "command": f"`{origin['command']}`; [how to make these numbers again]({FOLDER}/README.md)",
    }
    for name in ("versions", "machine", "campaign"):
        parts[name] = ", ".join(
            f"{key} {in_words(entry)}"
            for key, entry in origin[name].items()
            if entry is not None and not isinstance(entry, Mapping)
        )
    return parts
