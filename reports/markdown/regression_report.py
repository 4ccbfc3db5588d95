"""Report of a nightly run or a check: Markdown for people, and JSON for programs."""

from __future__ import annotations

import json
import math
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
from stiction.engines.status import UNMADE, Status
from stiction.reports.markdown.failures import group_failures
from stiction.reports.markdown.tables import markdown
from stiction.scenes.atomic_files import make_folder, write_text

REPORT = "report.md"
"""File with the report of a night."""
SUMMARY = "summary.json"
"""File with the findings of a night."""
MAX_FINDINGS = 40
"""Largest number of findings in a table; a sentence below the table counts the others."""
VERDICT_TITLES = {
    FINE: "fine: nothing changed beyond noise",
    REGRESSION: "regression",
    COULD_NOT_RUN: "not every run has a valid result",
    NOTHING: "nothing was compared: there is no baseline and no earlier night for these runs",
}
"""Verdicts in words."""
_STATUS_IN_WORDS = {
    Status.WRONG: "it ran, but its result is not a motion of the scene",
    Status.INCOMPLETE: "it ended early",
    Status.REFUSED: "the engine or its adapter cannot represent the scene",
    Status.MISSING: "the engine is not installed",
    Status.NOT_RUN: "it was not made",
}
"""What a status of a finding means; other statuses explain themselves."""
_COUNTED_AS = {
    Status.REFUSED: "not applicable",
    Status.WRONG: "with a wrong result",
    Status.INCOMPLETE: "ended early",
}
"""Words for statuses in the numbers of runs, where their labels would not be understood."""
_UPDATE = '`stiction baseline update --reason ".."`'


def check_report(result: Result) -> str:
    """Return the Markdown of a check, for a pull request: the summary, and a table of what changed."""
    return f"{_with_list(summary_lines(result))}\n\n{changes(result.findings)}\n"


def summary_lines(result: Result) -> list[str]:
    """Return five lines: verdict, worst finding, changes of the environment, time, and runs not made."""
    environment = "there is no night before"
    if result.night_before:
        changed = "; ".join(result.changed) or "nothing changed"
        environment = f"since the night {result.night_before}: {changed}"
    resumed = ""
    if result.resumed:
        resumed = f", {result.resumed} of the runs from a call that was interrupted"
    return [
        f"**{VERDICT_TITLES[result.verdict]}** ({_counts(result)})",
        f"Worst finding: {_worst_finding(result.findings)}",
        f"Environment: {environment}",
        f"Time: {result.wall_s:.0f} s{resumed}",
        f"Not run: {_runs_not_made(result.rows)}",
    ]


def _worst_finding(findings: Sequence[Finding]) -> str:
    """Describe the first finding that is judged; findings are sorted by severity, the worst first."""
    judged = [
        finding
        for finding in findings
        if finding.severity != NEW and not _is_missing_engine(finding)
    ]
    if not judged:
        return "none"
    worst = judged[0]
    if worst.kind == "status":
        return _worst_status(worst)
    change = _value(worst, worst.now)
    if worst.before is not None:
        change = f"{_value(worst, worst.before)} -> {change}"
    return f"{worst.severity}, {_subject(worst)} of {worst.key}: {change}; {worst.reason}"


def _severity_in_words(finding: Finding) -> str:
    """Return the severity of a finding; a run that was made, but without a valid result, is named as such."""
    if finding.severity == COULD_NOT_RUN and finding.now not in UNMADE:
        return "no valid result"
    return finding.severity


def _worst_status(finding: Finding) -> str:
    """Describe a finding about the status of a run, such as one that has no valid result."""
    status = Status(str(finding.now))
    end = status.label
    if status in _STATUS_IN_WORDS:
        end += f" ({_STATUS_IN_WORDS[status]})"
    before = "" if finding.before is None else f", before {Status(str(finding.before)).label}"
    return f"{_severity_in_words(finding)}, {finding.key}: {end}{before}; {finding.reason}"


def _subject(finding: Finding) -> str:
    """Return the label of the quantity of a finding, or the kind of a finding without a quantity."""
    return quantity_of(finding.metric).head if finding.metric else finding.kind


def _runs_not_made(rows: Sequence[Row]) -> str:
    """Describe the runs of engines that are not installed, and the other runs that were not made."""
    missing = Counter(row.engine for row in rows if row.status == Status.MISSING)
    reasons = Counter(row.reason for row in rows if row.status == Status.NOT_RUN)
    parts = []
    if missing:
        engines = ", ".join(f"{engine} ({count_of_runs(n)})" for engine, n in missing.items())
        parts.append(f"engines not available: {engines}")
    for reason, count in reasons.items():
        parts.append(f"{count_of_runs(count)}: {reason}")
    return "; ".join(parts) or "nothing, every run was made"


def count_of_runs(count: int) -> str:
    """Return a number of runs as text, such as ``1 run`` or ``2 runs``."""
    return "1 run" if count == 1 else f"{count} runs"


def _is_missing_engine(finding: Finding) -> bool:
    """Return whether the only content of a finding is that an optional engine is not installed."""
    return (
        finding.severity == NOT_JUDGED
        and finding.kind == "status"
        and finding.now == Status.MISSING
    )


def _with_list(lines: Sequence[str]) -> str:
    """Return the first line as a paragraph, and the others as a list below it."""
    first, *others = lines
    return f"{first}\n\n" + "\n".join(f"- {line}" for line in others)


def night_report(result: Result) -> str:
    """Return the text of `REPORT`: summary, changes, failures, refusals, all numbers, and provenance."""
    incomplete = [row for row in _failed_rows(result) if row.status != Status.MISSING]
    failed = [row for row in incomplete if row.status != Status.REFUSED]
    refused = [row for row in incomplete if row.status == Status.REFUSED]
    failures = "Nothing: all runs that were made succeeded."
    if failed:
        failures = markdown(group_failures(_failure_table(failed)))
    parts = [
        f"# Night of {result.name}: {VERDICT_TITLES[result.verdict]}",
        _with_list(summary_lines(result)),
        "## What changed",
        changes(result.findings),
        "## What failed",
        failures,
        *_not_applicable(refused),
        "## Numbers",
        "Of every run that succeeded, with the tier of the truth; counters and uncertainties are in the "
        "history.",
        markdown(_numbers(result)),
        "## Provenance",
        markdown(_provenance(result)),
    ]
    return "\n\n".join(parts) + "\n"


def _failure_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return a row for each run without a complete result; the status of one that ended early is ``incomplete``."""
    return pd.DataFrame(
        [
            {
                "scene": row.scene,
                "variant": row.variant,
                "step": row.step,
                "reason": row.reason,
                "status": Status.INCOMPLETE if row.status == Status.OK else row.status,
            }
            for row in rows
        ]
    )


def _not_applicable(refused: Sequence[Row]) -> list[str]:
    """Return a heading, a sentence and a table of the runs that were refused, one row for each reason; or nothing."""
    if not refused:
        return []
    runs = _failure_table(refused)
    rows = [
        {
            "reason": reason,
            "methods": "; ".join(part["variant"].unique()),
            "scenes": "; ".join(part["scene"].unique()),
            "runs": len(part),
        }
        for reason, part in runs.groupby("reason", sort=False)
    ]
    return [
        "## Not applicable",
        "These are no failures: the engine or its adapter cannot represent the scene, and refuses it.",
        markdown(pd.DataFrame(rows)),
    ]


def _numbers(result: Result) -> pd.DataFrame:
    """Return a row for each run that has metrics, without counters, which are in the history."""
    rows = []
    for row in result.rows:
        if row.metrics and row.parameter:
            values = {
                metric.name: metric.value for metric in row.metrics if metric.kind != "counter"
            }
            rows.append({"run": row.key, "truth": _tiers(row), **values})
    return pd.DataFrame(rows)


def _provenance(result: Result) -> pd.DataFrame:
    """Return the versions, the machine, the commit, the campaign and the engines, a row each."""
    origin = result.origin
    engines = {f"{row.engine} {row.version}" for row in result.rows if row.metrics and row.version}
    entries = {
        **origin["versions"],
        **origin["machine"],
        "commit": origin["commit"] or "not in a checkout",
        "campaign": result.campaign.name,
        "engines": ", ".join(sorted(engines)),
    }
    return pd.DataFrame(entries.items(), columns=["what", "value"])


def changes(findings: Sequence[Finding]) -> str:
    """Return a table of the findings, the worst first, with one row for each quantity of a variant.

    Runs that are not in the baseline, or whose engine is not installed, are counted below the table.
    """
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        if finding.severity == NEW or _is_missing_engine(finding):
            continue
        # The key of a run is SCENE/VARIANT/STEP. All runs of a missing engine have the same reason,
        # and share a row.
        variant = finding.key.partition("/")[2].rpartition("/")[0]
        subject = finding.reason if finding.now == Status.MISSING else variant
        group = (finding.severity, finding.kind, finding.metric, subject)
        groups.setdefault(group, []).append(finding)
    rows = []
    for group_findings in list(groups.values())[:MAX_FINDINGS]:
        worst = group_findings[0]
        rows.append(
            {
                "": _severity_in_words(worst),
                "what": _subject(worst),
                "worst run": worst.key,
                "baseline": _value(worst, worst.before),
                "now": _value(worst, worst.now),
                "why": worst.reason,
                "runs": len(group_findings),
            }
        )
    paragraphs = [markdown(pd.DataFrame(rows)) if rows else "Nothing changed beyond noise."]
    if len(groups) > MAX_FINDINGS:
        paragraphs.append(f"and {len(groups) - MAX_FINDINGS} more lines, none worse than these.")
    missing = sum(_is_missing_engine(finding) for finding in findings)
    if missing:
        verb = "was" if missing == 1 else "were"
        paragraphs.append(
            f"{count_of_runs(missing)} of engines that are not available {verb} not made."
        )
    new = sum(finding.severity == NEW for finding in findings)
    if new:
        paragraphs.append(
            f"{new} runs or numbers are not in the baseline: nights hold them to the first night that has "
            "them, and `stiction baseline update` adds them to a baseline."
        )
    if any(finding.severity == BETTER for finding in findings):
        paragraphs.append(
            f"What has become better is no failure; {_UPDATE} makes it what is expected from now on."
        )
    return "\n\n".join(paragraphs)


def summary(result: Result, exit_code: int) -> dict[str, Any]:
    """Return the content of `SUMMARY`: verdict, findings and failures; the numbers are in the history."""
    failed = [
        {"key": row.key, "status": row.status, "reason": row.reason} for row in _failed_rows(result)
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
        "findings": [_finding_as_json(finding) for finding in result.findings],
        "lost": failed,
        "origin": dict(result.origin),
    }


def _finding_as_json(finding: Finding) -> dict[str, Any]:
    """Return the fields of a finding, with None in place of infinity, which JSON does not have."""
    return {name: None if value == math.inf else value for name, value in asdict(finding).items()}


def write_night(result: Result, exit_code: int, folder: Path) -> None:
    """Write `REPORT` and `SUMMARY`, each complete or not at all. The summary is written last."""
    make_folder(folder)
    write_text(folder / REPORT, night_report(result))
    text = json.dumps(summary(result, exit_code), indent=1, ensure_ascii=False)
    write_text(folder / SUMMARY, text + "\n")


def _failed_rows(result: Result) -> list[Row]:
    """Return the rows of runs that failed, ended early or were not made."""
    return [row for row in result.rows if row.status != Status.OK or row.reason]


def _counts(result: Result) -> str:
    """Return the numbers of runs by status, of compared runs, and of runs without a baseline."""
    statuses = Counter(
        Status.INCOMPLETE if row.status == Status.OK and row.reason else Status(row.status)
        for row in result.rows
    )
    runs = ", ".join(
        f"{count} {_COUNTED_AS.get(status, status.label)}"
        for status, count in statuses.most_common()
    )
    text = f"{count_of_runs(len(result.rows))}: {runs}; {result.compared} compared with earlier results"
    first_nights = result.first_nights
    if first_nights:
        first = min(first_nights.values())
        if len(first_nights) == result.compared:
            text += f", namely with the night {first}, the first that has them"
        else:
            text += (
                f", {len(first_nights)} of them with the first night that has them (from {first})"
            )
        text += ", because the baseline does not contain them"
    new = sum(finding.severity == NEW and finding.kind == "status" for finding in result.findings)
    if new:
        text += f"; {new} are new, with nothing to compare them with"
    return text


def _tiers(row: Row) -> str:
    """Return the tiers of the truths with which the errors and events of a run were compared."""
    tiers = dict.fromkeys(
        metric.tier for metric in row.metrics if metric.kind in ("accuracy", "event")
    )
    return ", ".join(tier.label for tier in tiers)


def _value(finding: Finding, value: float | str | None) -> str:
    """Return a value of a finding in the number format of its quantity."""
    return cell(quantity_of(finding.metric), value)
