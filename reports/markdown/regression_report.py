"""Findings of a night or a check, for people (Markdown) and for machines (JSON)."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.planned_runs import Row
from stiction.comparisons.bench.presentation.cells import cell
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression.check import (
    BETTER,
    COULD_NOT_RUN,
    FINE,
    NEW,
    NOT_JUDGED,
    NOTHING,
    REGRESSION,
    Finding,
)
from stiction.comparisons.regression.nightly import Result
from stiction.engines.status import Status
from stiction.reports.markdown.failures import grouped
from stiction.reports.markdown.tables import markdown
from stiction.scenes.atomic_files import make_folder, write_text

REPORT, SUMMARY = "report.md", "summary.json"
SHOWN = 40
"""Findings in a table; the rest is counted."""
_TITLES = {
    FINE: "fine: nothing changed beyond noise",
    REGRESSION: "regression",
    COULD_NOT_RUN: "not everything could be run",
    NOTHING: "nothing was compared: there is no baseline and no earlier night for these runs",
}
_UPDATE = '`stiction baseline update --reason ".."`'


def check_report(result: Result) -> str:
    """Write a verdict and a table, worst first, fit for a pull request."""
    return f"{_list(summary_lines(result))}\n\n{changes(result.findings)}\n"


def summary_lines(result: Result) -> list[str]:
    """Return the five lines that stand first: verdict, worst finding, environment, time and what was not run."""
    again = (
        f", {result.resumed} of the runs from a call that was interrupted" if result.resumed else ""
    )
    environment = (
        "there is no night before"
        if not result.night_before
        else f"since the night {result.night_before}: {'; '.join(result.changed) or 'nothing changed'}"
    )
    return [
        f"**{_TITLES[result.verdict]}** ({_counts(result)})",
        f"Worst finding: {_worst(result.findings)}",
        f"Environment: {environment}",
        f"Time: {result.wall_s:.0f} s{again}",
        f"Not run: {_not_run(result.rows)}",
    ]


def _worst(findings: Sequence[Finding]) -> str:
    worst = next(
        (finding for finding in findings if finding.severity != NEW and not _is_absent(finding)),
        None,
    )
    if worst is None:
        return "none"
    now = _value(worst, worst.now)
    change = now if worst.before is None else f"{_value(worst, worst.before)} -> {now}"
    what = quantity_of(worst.metric).head if worst.metric else worst.kind
    return f"{worst.severity}, {what} of {worst.key}: {change}; {worst.reason}"


def _not_run(rows: Sequence[Row]) -> str:
    """Engines that are not installed, and runs that there was no time for or that were interrupted."""
    missing = Counter(row.engine for row in rows if row.status == Status.MISSING)
    reasons = Counter(row.reason for row in rows if row.status == Status.NOT_RUN)
    absent = ", ".join(f"{engine} ({runs(count)})" for engine, count in missing.items())
    parts = [f"not installed: {absent}"] if absent else []
    parts += [f"{runs(count)}: {reason}" for reason, count in reasons.items()]
    return "; ".join(parts) or "nothing, every run was made"


def runs(count: int) -> str:
    """A number of runs in words."""
    return f"{count} run{'s' * (count != 1)}"


def _is_absent(finding: Finding) -> bool:
    """It says no more than that an engine of the extras is not installed."""
    return (
        finding.severity == NOT_JUDGED
        and finding.kind == "status"
        and finding.now == Status.MISSING
    )


def _list(lines: Sequence[str]) -> str:
    """The verdict, and the other lines as a list below it."""
    verdict, *others = lines
    return f"{verdict}\n\n" + "\n".join(f"- {line}" for line in others)


def night_report(result: Result) -> str:
    """Write the text of `REPORT`."""
    failed = pd.DataFrame(
        [
            {
                "scene": row.scene,
                "variant": row.variant,
                "step": row.step,
                "reason": row.reason,
                "status": Status.INCOMPLETE if row.status == Status.OK else row.status,
            }
            for row in _failed(result)
            if row.status != Status.MISSING
        ]
    )
    measured = [row for row in result.rows if row.metrics]
    numbers = pd.DataFrame(
        [
            {
                "run": row.key,
                "truth": _tiers(row),
                **{metric.name: metric.value for metric in row.metrics if metric.kind != "counter"},
            }
            for row in measured
            if row.parameter
        ]
    )
    origin = result.origin
    engines = sorted({f"{row.engine} {row.version}" for row in measured if row.version})
    here = {
        **origin["versions"],
        **origin["machine"],
        "commit": origin["commit"] or "not in a checkout",
        "campaign": result.campaign.name,
        "engines": ", ".join(engines),
    }
    return (
        "\n\n".join(
            [
                f"# Night of {result.name}: {_TITLES[result.verdict]}",
                _list(summary_lines(result)),
                "## What changed",
                changes(result.findings),
                "## What failed",
                markdown(grouped(failed))
                if len(failed)
                else "Nothing: all runs that were made succeeded.",
                "## Numbers",
                "Of every run that succeeded, with the tier of the truth; counters and uncertainties are in the "
                "history.",
                markdown(numbers),
                "## Provenance",
                markdown(pd.DataFrame(here.items(), columns=["what", "value"])),
            ]
        )
        + "\n"
    )


def changes(findings: Sequence[Finding]) -> str:
    """Write the worst finding of each quantity of a variant, worst first, in a table.

    What is merely new is counted, and so are the runs of extras that are not installed, below the table.
    """
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        if finding.severity != NEW and not _is_absent(finding):
            # one row for all variants of an engine that is not installed
            about = (
                finding.reason
                if finding.now == Status.MISSING
                else finding.key.partition("/")[2].rpartition("/")[0]
            )
            groups.setdefault((finding.severity, finding.kind, finding.metric, about), []).append(
                finding
            )
    rows = [
        {
            "": worst.severity,
            "what": quantity_of(worst.metric).head if worst.metric else worst.kind,
            "worst run": worst.key,
            "baseline": _value(worst, worst.before),
            "now": _value(worst, worst.now),
            "why": worst.reason,
            "runs": 1 + len(others),
        }
        for worst, *others in list(groups.values())[:SHOWN]
    ]
    lines = [markdown(pd.DataFrame(rows)) if rows else "Nothing changed beyond noise."]
    if len(groups) > SHOWN:
        lines.append(f"and {len(groups) - SHOWN} more lines, none worse than these.")
    if absent := sum(map(_is_absent, findings)):
        lines.append(
            f"{runs(absent)} of engines that are not installed {'were' if absent != 1 else 'was'} not made."
        )
    if new := sum(finding.severity == NEW for finding in findings):
        lines.append(
            f"{new} runs or numbers are not in the baseline: nights hold them to the first night that has "
            "them, and `stiction baseline update` adds them to a baseline."
        )
    if any(finding.severity == BETTER for finding in findings):
        lines.append(
            f"What has become better is no failure; {_UPDATE} makes it what is expected from now on."
        )
    return "\n\n".join(lines)


def summary(result: Result, exit_code: int) -> dict[str, Any]:
    """Return all of it but the numbers, which the history has, ready for JSON."""
    findings = [
        {name: value if value != float("inf") else None for name, value in asdict(finding).items()}
        for finding in result.findings
    ]
    return {
        "verdict": result.verdict,
        "exit code": exit_code,
        "name": result.name,
        "campaign": result.campaign.name,
        "runs": dict(Counter(row.status for row in result.rows)),
        "compared": result.compared,
        "held to the first night": dict(result.first_nights),
        "resumed": result.resumed,
        "lines": summary_lines(result),
        "night before": result.night_before,
        "changed": list(result.changed),
        "wall_time": round(result.wall_s, 1),
        "findings": findings,
        "lost": [
            {"key": row.key, "status": row.status, "reason": row.reason} for row in _failed(result)
        ],
        "origin": dict(result.origin),
    }


def write_night(result: Result, exit_code: int, folder: Path) -> None:
    """Write `REPORT` and `SUMMARY`; each appears complete or not at all, the summary last."""
    make_folder(folder)
    write_text(folder / REPORT, night_report(result))
    write_text(
        folder / SUMMARY,
        json.dumps(summary(result, exit_code), indent=1, ensure_ascii=False) + "\n",
    )


def _failed(result: Result) -> list[Row]:
    return [row for row in result.rows if row.status != Status.OK or row.reason]


def _counts(result: Result) -> str:
    runs = ", ".join(
        f"{count} {Status(status).label}"
        for status, count in Counter(row.status for row in result.rows).most_common()
    )
    text, first = (
        f"{len(result.rows)} runs: {runs}; {result.compared} compared",
        result.first_nights,
    )
    if first:
        text += (
            f", {len(first)} of them not with the baseline, which does not contain them, but with their first night "
            f"({min(first.values())})"
        )
    new = sum(finding.severity == NEW and finding.kind == "status" for finding in result.findings)
    return text + (f"; {new} not in the baseline, so not compared" if new else "")


def _tiers(row: Row) -> str:
    """The truths that its errors and events were measured against."""
    tiers = dict.fromkeys(
        metric.tier for metric in row.metrics if metric.kind in ("accuracy", "event")
    )
    return ", ".join(tier.label for tier in tiers)


def _value(finding: Finding, value: float | str | None) -> str:
    return cell(quantity_of(finding.metric), value)
