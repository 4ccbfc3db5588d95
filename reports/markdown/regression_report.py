"""What a night or a check found, for people (Markdown) and for machines (JSON)."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.atomic_files import make_folder, write_text
from stiction.comparisons.campaigns.measurement import RANDOM, Row
from stiction.comparisons.campaigns.nightly import Result
from stiction.comparisons.campaigns.regression import BETTER, COULD_NOT_RUN, FINE, NEW, NOTHING, REGRESSION, Finding
from stiction.reports.markdown.losses import WHERE, grouped
from stiction.comparisons.presentation.cells import cell
from stiction.reports.markdown.tables import markdown

REPORT, SUMMARY = "report.md", "summary.json"
SHOWN = 40
"""Findings in a table; the rest is counted."""
_TITLES = {FINE: "fine: nothing changed beyond noise", REGRESSION: "regression", COULD_NOT_RUN: "not everything could be run",
           NOTHING: "nothing was compared: there is nothing yet that these runs could be held to"}


def check_report(result: Result) -> str:
    """A verdict and a table, worst first, fit for a pull request."""
    return f"**{_TITLES[result.verdict]}** ({_counts(result)})\n\n{changes(result.findings)}\n"


def night_report(result: Result) -> str:
    """The text of `REPORT`."""
    lost = pd.DataFrame([{"scene": row.scene, "variant": row.variant, "step": row.step, "status": row.status if row.status != "ok" else "incomplete",
                          "reason": row.reason} for row in result.rows if row.status != "ok" or row.reason])
    resumed = f" {result.resumed} of them came from a run of this night that was interrupted." if result.resumed else ""
    came = [row for row in result.rows if row.metrics]
    numbers = pd.DataFrame([{"run": row.key, "truth": _tiers(row), **{metric.name: metric.value for metric in row.metrics if metric.kind != "counter"}}
                            for row in came if row.parameter and row.variant != RANDOM])
    here = {**result.origin["versions"], **result.origin["machine"], "commit": result.origin["commit"] or "not in a checkout",
            "campaign": result.campaign.name, "engines": ", ".join(sorted({f"{row.engine} {row.version}" for row in came if row.version}))}
    return "\n\n".join([
        f"# Night of {result.name}: {_TITLES[result.verdict]}",
        f"{_counts(result)}, in {result.wall_s:.0f} s.{resumed}",
        "## What changed", changes(result.findings),
        *(["## Random scenes", result.random] if result.random else []),
        "## What did not come out", markdown(grouped(lost)[["variant", "status", "reason", "runs", WHERE]]) if len(lost) else "Nothing: every run came out.",
        "## Numbers", "Of every run that came out, with the tier of the truth; counters and uncertainties are in the history.", markdown(numbers),
        "## Provenance", markdown(pd.DataFrame(here.items(), columns=["what", "value"])),
    ]) + "\n"


def changes(findings: Sequence[Finding]) -> str:
    """The findings as a table, worst first; what is merely new is counted."""
    told = grouped_findings(findings)
    rows = [{"": worst.severity, "what": worst.metric or worst.kind, "worst run": worst.key, "baseline": _value(worst, worst.before),
             "now": _value(worst, worst.now), "why": worst.reason, "runs": count} for worst, count in told[:SHOWN]]
    lines = [markdown(pd.DataFrame(rows)) if rows else "Nothing changed beyond noise."]
    if len(told) > SHOWN:
        lines.append(f"and {len(told) - SHOWN} more lines, none worse than these.")
    if new := sum(finding.severity == NEW for finding in findings):
        lines.append(f"{new} runs or numbers are not in the baseline; `stiction baseline update --reason \"..\"` adds them.")
    if any(finding.severity == BETTER for finding in findings):
        lines.append("What has become better is no failure; `stiction baseline update --reason \"..\"` makes it what is expected from now on.")
    return "\n\n".join(lines)


def grouped_findings(findings: Sequence[Finding]) -> list[tuple[Finding, int]]:
    """Of each quantity of a variant the worst finding, and the number of its runs that are concerned; without what is merely new."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        if finding.severity != NEW:
            variant = finding.key.partition("/")[2].rpartition("/")[0]
            groups.setdefault((finding.severity, finding.kind, finding.metric, variant), []).append(finding)
    return [(group[0], len(group)) for group in groups.values()]


def summary(result: Result, exit_code: int) -> dict[str, Any]:
    """All of it but the numbers, which the history has, ready for JSON."""
    return {"verdict": result.verdict, "exit code": exit_code, "name": result.name, "campaign": result.campaign.name,
            "runs": dict(Counter(row.status for row in result.rows)), "compared": result.compared, "held to the first night": dict(result.first_nights), "resumed": result.resumed, "wall [s]": round(result.wall_s, 1),
            "random": result.random,
            "findings": [{name: value if value != float("inf") else None for name, value in asdict(finding).items()}
                         for finding in result.findings],
            "lost": [{"key": row.key, "status": row.status, "reason": row.reason} for row in result.rows if row.status != "ok" or row.reason],
            "origin": dict(result.origin)}


def write_night(result: Result, exit_code: int, folder: Path) -> None:
    """Write `REPORT` and `SUMMARY`; each appears complete or not at all, the summary last."""
    make_folder(folder)
    text = json.dumps(summary(result, exit_code), indent=1, ensure_ascii=False) + "\n"
    for name, content in ((REPORT, night_report(result)), (SUMMARY, text)):
        write_text(folder / name, content)


def _counts(result: Result) -> str:
    runs = Counter(row.status for row in result.rows)
    new = sum(finding.severity == NEW and finding.kind == "status" for finding in result.findings)
    return f"{len(result.rows)} runs: " + ", ".join(f"{count} {status}" for status, count in runs.most_common()) + (
        f"; {result.compared} compared" + (f", {len(result.first_nights)} of them, which the baseline does not have, with the first night that has them "
                                           f"({min(result.first_nights.values())})" if result.first_nights else "")) + (
        f"; {new} not in the baseline, so not compared" if new else "")


def _tiers(row: Row) -> str:
    """Of the truth that its errors and events were measured against."""
    return ", ".join(dict.fromkeys(metric.tier for metric in row.metrics if metric.kind in ("accuracy", "event")))


def _value(finding: Finding, value: float | str | None) -> str:
    return cell(finding.metric if finding.kind in ("accuracy", "drift") else "", value)
