"""The first page: five sentences, computed from the tables, that stay true whatever is missing."""

from __future__ import annotations

import textwrap

import pandas as pd

from comparisons.validation import Validation
from reports.hard_page import hard_sentence
from reports.losses import grouped, losses
from reports.tables import cell, setting_of

POSITION, TORQUE = "position error [m]", "torque error, L1 mean [N m]"
MISSED, SPURIOUS, COST = "events missed", "events spurious", "cpu [s]"


def summary(validation: Validation) -> list[str]:
    """Five lines of Markdown: agreement, events and torque, cost, losses, the paper."""
    finest = finest_rows(validation.tables.get("accuracy", pd.DataFrame()))
    return [f"**Who agrees, and to what.** {_agreement(finest)}", f"**Events and torque.** {_events(finest)}",
            f"**At what cost.** {_cost(finest)}", f"**Who failed, and why.** {_failures(validation)}{_hard(validation)}",
            f"**The paper.** {_paper(validation)}"]


def finest_rows(accuracy: pd.DataFrame) -> pd.DataFrame:
    """Of each variant and scene the finest setting that came out, variants by their worst position error."""
    if POSITION not in accuracy:
        return pd.DataFrame(columns=["scene", "variant", "parameter", "step", POSITION])
    there = accuracy[accuracy[POSITION].notna()]
    finest = there.sort_values("step", kind="stable").groupby(["variant", "scene"], sort=False).head(1)
    order = finest.groupby("variant")[POSITION].max().rename("order")
    return finest.join(order, on="variant").sort_values(["order", "variant"], kind="stable").drop(columns="order")


def _agreement(finest: pd.DataFrame) -> str:
    if finest.empty:
        return "Nobody can be said to: no run that could be compared with the truth came out."
    tiers = ", ".join(dict.fromkeys(finest["truth tier"].dropna())) if "truth tier" in finest else ""
    scenes = finest["scene"].nunique()
    parts = []
    for variant, rows in finest.groupby("variant", sort=False):
        setting = ", ".join(dict.fromkeys(setting_of(*pair) for pair in zip(rows["parameter"], rows["step"])))
        there = "" if len(rows) == scenes else f"; {len(rows)} of {scenes} scenes"
        parts.append(f"{variant} {cell(POSITION, rows[POSITION].max())} m ({setting}{there})")
    return (f"Largest error of position against the truth ({tiers or 'tier not stated'}), finest setting that came "
            f"out, worst of {_scenes(scenes)}: {'; '.join(parts)}.")


def _events(finest: pd.DataFrame) -> str:
    if finest.empty:
        return "None to compare."
    sentences = []
    if {MISSED, SPURIOUS} <= set(finest.columns):
        counts = finest.groupby("variant", sort=False)[[MISSED, SPURIOUS]].sum(min_count=1)
        told = counts.dropna()
        good = [variant for variant, row in told.iterrows() if row[MISSED] == row[SPURIOUS] == 0]
        bad = [f"{variant} ({int(row[MISSED])} missed, {int(row[SPURIOUS])} spurious)"
               for variant, row in told.iterrows() if variant not in good]
        silent = [variant for variant in counts.index if variant not in told.index]
        sentences += [f"Every event of the truth and no other: {'; '.join(good) or 'nobody'}." if len(told) else "",
                      f"Not so: {'; '.join(bad)}." if bad else "",
                      f"Locate no events: {'; '.join(silent)}." if silent else ""]
    if TORQUE in finest and finest[TORQUE].notna().any():
        torque = finest.groupby("variant", sort=False)[TORQUE].max().dropna()
        sentences.append("Mean error of the driving torque: "
                         + "; ".join(f"{variant} {cell(TORQUE, value)} N m" for variant, value in torque.items()) + ".")
    return " ".join(filter(None, sentences)) or "Not compared."


def _cost(finest: pd.DataFrame) -> str:
    if COST not in finest or finest[COST].isna().all():
        return "Unknown: no run came out that could tell."
    cost = finest.groupby("variant", sort=False)[COST].max().dropna().sort_values(kind="stable")
    times = "; ".join(f"{variant} {cell(COST, seconds)} s" for variant, seconds in cost.items())
    return f"CPU for one of these runs, without set-up, worst of {_scenes(finest['scene'].nunique())}: {times}."


def _failures(validation: Validation) -> str:
    total, lost = len(validation.records), losses(validation)
    here = int((lost["table"] == "runs").sum())
    if lost.empty:
        return f"Nobody: all {total} runs came out." if total else "There were no runs."
    reasons = [f"{variant} {status} ({runs}): {textwrap.shorten(reason, 120, placeholder=' ...')}"
               for variant, status, reason, runs, _ in grouped(lost).itertuples(index=False)]
    inside = f" and {len(lost) - here} inside comparisons" if len(lost) > here else ""
    return f"{here} of {total} runs{inside}. {'; '.join(reasons).rstrip('.')}."


def _hard(validation: Validation) -> str:
    table = validation.tables.get("hard", pd.DataFrame())
    return "" if table.empty else f" {hard_sentence(table)}"


def _paper(validation: Validation) -> str:
    claims = validation.tables.get("claims", pd.DataFrame())
    if claims.empty or "verdict" not in claims:
        return "Its claims were not examined."
    counts = claims["verdict"].value_counts()
    said = ", ".join(f"{verdict}: {count}" for verdict, count in counts.items())
    broken = claims.loc[claims["verdict"] == "does not hold", "claim"] if "claim" in claims else []
    named = f" Does not hold: {'; '.join(map(str, broken))}." if len(broken) else ""
    threshold = _threshold(validation.tables.get("threshold", pd.DataFrame()))
    return f"Its {len(claims)} statements: {said}.{named}{threshold}"


def _threshold(table: pd.DataFrame) -> str:
    """The threshold on F0 that the paper's text has lost, as the truth and the best run have it."""
    needed = {"truth [N]", "error [N]", "variant"}
    if not needed <= set(table.columns) or table["truth [N]"].isna().all() or table["error [N]"].isna().all():
        return ""
    known = table.dropna(subset=["truth [N]", "error [N]"])
    best = known.loc[known["error [N]"].astype(float).abs().idxmin()]
    value, error = cell("truth [N]", best["truth [N]"]), cell("error [N]", abs(best["error [N]"]))
    return (f" Its threshold of stick on F0 is lost in the text we have; here it is {value} N ({best['scene']}), "
            f"found by {best['variant']} to {error} N.")


def _scenes(count: int) -> str:
    return "one scene" if count == 1 else f"{count} scenes"
