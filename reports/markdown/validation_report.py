"""The report of a validation: a run folder with `report.md` in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import stored_keys
from stiction.comparisons.bench.presentation import MechanismPicture
from stiction.comparisons.bench.presentation.cells import MISSING
from stiction.comparisons.bench.results import Results
from stiction.reports.figures.charts import drawn
from stiction.reports.figures.style import Drawing, rc, save_all
from stiction.reports.markdown.failures import failed_runs, grouped
from stiction.reports.markdown.study_section import figure, study_section
from stiction.reports.markdown.tables import fitted, markdown
from stiction.reports.page_one import TITLE, page_one_markdown
from stiction.reports.report import Report
from stiction.reports.run_folder.data import tables_of, words, write_data
from stiction.reports.run_folder.data_package import write_data_package
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.run_folder.provenance import commit_in_words, provenance
from stiction.reports.run_folder.reproduce import FOLDER, write_reproduce
from stiction.reports.text import template
from stiction.truths import Tier
from stiction.uncertain import rounded_up

REPORT, FAILURES = "report.md", "failures.md"

TEMPLATE = "report.md"
UNCERTAINTIES = {
    "position_uncertainty": "position [m]",
    "velocity_uncertainty": "velocity [m/s]",
    "event_time_uncertainty": "events [s]",
}
"""Headings of the uncertainties of truths, by the columns of tables that compare runs with them."""
BEST_FIRST = (Tier.PROVEN, Tier.CLOSED_FORM, Tier.HIGH_PRECISION, Tier.PUBLISHED, Tier.OWN_RUN)


def write_report(report: Report, folder: str | Path) -> Path:
    """Write the run folder of a validation, complete or not at all, and return the path of its ``report.md``.

    The other parts: ``failures.md``, ``data/``, ``figures/``, ``reproduce/``, ``provenance.json``. FolderRefused if
    writing would lose something; `check_folder` finds out beforehand.
    """
    results = report.results
    with run_folder(folder, REPORT) as partial:
        (partial / "figures").mkdir()
        with rc():
            drawings = list(drawn(report.figures, results))
        save_all(drawings, partial / "figures")
        write_data(results, partial, stored_keys(results))
        origin = provenance(results)
        failed = failed_runs(results)
        (partial / REPORT).write_text(compose(report, failed, origin, drawings), encoding="utf-8")
        if len(failed):
            (partial / FAILURES).write_text(
                f"# Failed runs\n\n{markdown(failed)}\n", encoding="utf-8"
            )
        write_data_package(partial, TITLE, origin["date"])
        write_reproduce(results, origin, partial)
        write_provenance(partial, origin)
    return Path(folder) / REPORT


def compose(
    report: Report, failed: pd.DataFrame, origin: Mapping[str, Any], drawings: Sequence[Drawing]
) -> str:
    """Compose the text of ``report.md``; the first picture of a mechanism stands on page one alone."""
    results, by_name = report.results, {drawing.name: drawing for drawing in drawings}
    first = next((each.name for each in report.figures if isinstance(each, MechanismPicture)), None)
    picture = figure(by_name.pop(first)) if first else ""
    engines = "".join(f", {name} {version}" for name, version in origin["engines"].items())
    when = (
        f"Run of {origin['date'][:16].replace('T', ' ')} UTC with stiction {origin['versions']['stiction']}"
        f"{engines}."
    )
    return template(TEMPLATE).render(
        page_one=page_one_markdown(report, picture, when),
        tiers=[tier.label for tier in BEST_FIRST],
        missing=MISSING,
        sections=[study_section(study, said, by_name) for study, said in report.said.items()],
        failed=_failed(failed),
        parameters=fitted(tables_of(results)["parameters"]),
        choices=origin["choices"],
        truths=_truths(results),
        provenance=_provenance(origin),
    )


def _failed(failed: pd.DataFrame) -> dict[str, object] | None:
    """How many runs failed, and a table of the reasons; None where none did."""
    if failed.empty:
        return None
    rows = grouped(failed)[["variant", "status", "runs", "reason"]]
    return {
        "count": len(failed),
        "file": FAILURES,
        "table": fitted(rows.rename(columns={"variant": "method"})),
    }


def _truths(results: Results) -> str:
    """The truths that runs were compared with, the best tier first, and how well they are known."""
    compared = pd.concat(
        [
            table.reindex(columns=["truth", "truth_tier", *UNCERTAINTIES])
            for table in results.tables.values()
            if {"truth", "truth_tier"} <= set(table.columns)
        ]
        or [pd.DataFrame(columns=["truth", "truth_tier", *UNCERTAINTIES])]
    )
    compared = compared[compared["truth"].notna() & (compared["truth_tier"] != Tier.NONE)]
    if compared.empty:
        return ""
    largest = compared.groupby(["truth", "truth_tier"], sort=False)[list(UNCERTAINTIES)].max()
    largest = largest.dropna(how="all").reset_index()
    largest = largest.sort_values(
        "truth_tier", key=lambda tiers: tiers.map(BEST_FIRST.index), kind="stable"
    )
    for name in UNCERTAINTIES:
        largest[name] = [
            MISSING if pd.isna(value) else f"± {rounded_up(value)}" for value in largest[name]
        ]
    return fitted(largest.rename(columns={**UNCERTAINTIES, "truth_tier": "tier"}))


def _provenance(origin: Mapping[str, Any]) -> dict[str, str]:
    """What the provenance of the folder has, a line each, without the state of the machine during the campaign."""
    parts = {
        "date": origin["date"],
        "commit": commit_in_words(origin),
        "source": f"SHA-256 {origin['source']}",
        "command": f"`{origin['command']}`; [how to make these numbers again]({FOLDER}/README.md)",
    }
    for name in ("versions", "machine", "campaign"):
        parts[name] = ", ".join(
            f"{key} {words(entry)}"
            for key, entry in origin[name].items()
            if entry is not None and not isinstance(entry, Mapping)
        )
    return parts
