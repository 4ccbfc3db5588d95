"""The first page: five sentences, computed from the tables, that stay true whatever is missing.

Joint and contact fidelity, and the two physics of static friction, answer different questions: no list holds variants of two of them. A list is in
order of its numbers; where their intervals overlap, it says so.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import pandas as pd

from stiction.comparisons.campaigns.validation import Validation
from stiction.comparisons.measures.accuracy import KINDS, missed
from stiction.comparisons.studies.paper_claims import CONTRADICTS, FAILS, PARTLY
from stiction.comparisons.studies.work_precision import HIGH, LEVEL, LOW, came_out
from stiction.comparisons.timing.intervals import CONFIDENCE
from stiction.comparisons.variants import MUS_EQUALS_MU, OWN_CPU
from stiction.reports.markdown.hard_page import hard_sentence
from stiction.reports.markdown.losses import grouped, losses
from stiction.reports.markdown.tables import Uncertain, cell, setting_of, uncertainty_of

POSITION, TORQUE = "position error [m]", "torque error, L1 mean [N m]"
MISSED, SPURIOUS = "events missed", "events spurious"


def summary(validation: Validation) -> list[str]:
    """Five lines of Markdown: agreement, events and torque, cost, losses, the paper."""
    finest = finest_rows(validation.tables.get("accuracy", pd.DataFrame()))
    return [f"**Who agrees, and to what.** {_agreement(finest)}", f"**Events and torque.** {_events(finest)}",
            f"**At what cost.** {_cost(validation.tables.get('cost', pd.DataFrame()))}", f"**Who failed, and why.** {_failures(validation)}{_hard(validation)}",
            f"**The paper.** {_paper(validation)}"]


def finest_rows(accuracy: pd.DataFrame) -> pd.DataFrame:
    """Of each variant and scene the finest setting that came out, variants by their worst position error."""
    if POSITION not in accuracy:
        return pd.DataFrame(columns=["scene", "variant", "parameter", "step", POSITION])
    there = accuracy[accuracy[POSITION].notna()]
    finest = there.sort_values("step", kind="stable").groupby(["variant", "scene"], sort=False).head(1)
    order = finest.groupby("variant")[POSITION].max().rename("order")
    return finest.join(order, on="variant").sort_values(["order", "variant"], kind="stable").drop(columns="order")


def groups(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """The rows that may stand in one list, by fidelity and by the physics of static friction, and what they are called."""
    equal = table["truth"].astype(str).str.endswith(MUS_EQUALS_MU) if "truth" in table else pd.Series(False, table.index)
    fidelity = table["fidelity"] if "fidelity" in table else pd.Series("joint", table.index)
    for (name, same), rows in table.groupby([fidelity, equal], sort=False):
        yield f"{name} fidelity, mus {'= mu' if same else 'as declared'}", rows


def _lists(parts: Sequence[tuple[str, str]]) -> str:
    """``joint fidelity, mus as declared: a; b. contact fidelity, ...``: one list per group."""
    return ". ".join(f"{name[:1].upper()}{name[1:]}: {text}" for name, text in parts)


def _largest(rows: pd.DataFrame, column: str) -> str:
    """The largest of a column with its uncertainty."""
    row = rows.loc[rows[column].idxmax()]
    unsure = row.get(uncertainty_of(column))
    return cell(column, row[column] if unsure is None or pd.isna(unsure) else Uncertain(float(row[column]), float(unsure)))


def _agreement(finest: pd.DataFrame) -> str:
    if finest.empty:
        return "Nobody can be said to: no run that could be compared with the truth came out."
    tiers = ", ".join(dict.fromkeys(finest["truth tier"].dropna())) if "truth tier" in finest else ""
    scenes, lists = finest["scene"].nunique(), []
    for name, group in groups(finest):
        parts = []
        for variant, rows in group.groupby("variant", sort=False):
            setting = ", ".join(dict.fromkeys(setting_of(*pair) for pair in zip(rows["parameter"], rows["step"])))
            there = "" if len(rows) == scenes else f"; {len(rows)} of {scenes} scenes"
            parts.append(f"{variant} {_largest(rows, POSITION)} m ({setting}{there})")
        lists.append((name, "; ".join(parts)))
    return (f"Largest error of position against the truth ({tiers or 'tier not stated'}), finest setting that came "
            f"out, worst of {_scenes(scenes)}. {_lists(lists)}.")


def _events(finest: pd.DataFrame) -> str:
    if finest.empty:
        return "None to compare."
    sentences = []
    if {MISSED, SPURIOUS} <= set(finest.columns):
        columns = [MISSED, SPURIOUS, *(column for column in map(missed, KINDS) if column in finest)]
        counts = finest.groupby("variant", sort=False)[columns].sum(min_count=1)
        told = counts.dropna(subset=[MISSED, SPURIOUS])
        good = [variant for variant, row in told.iterrows() if row[MISSED] == row[SPURIOUS] == 0]
        bad = [f"{variant} ({_wrong_events(row)})" for variant, row in told.iterrows() if variant not in good]
        silent = [variant for variant in counts.index if variant not in told.index]
        sentences += [f"Every event of the truth and no other: {'; '.join(good) or 'nobody'}." if len(told) else "",
                      f"Not so: {'; '.join(bad)}." if bad else "",
                      f"Locate no events: {'; '.join(silent)}." if silent else ""]
    if TORQUE in finest and finest[TORQUE].notna().any():
        lists = [(name, "; ".join(f"{variant} {_largest(rows, TORQUE)} N m"
                                  for variant, rows in group[group[TORQUE].notna()].groupby("variant", sort=False)))
                 for name, group in groups(finest) if group[TORQUE].notna().any()]
        sentences.append(f"Mean error of the driving torque. {_lists(lists)}.")
    return " ".join(filter(None, sentences)) or "Not compared."


def _wrong_events(row: pd.Series) -> str:
    """``missed: 64 corner; 2 spurious``."""
    kinds = ", ".join(f"{int(row[missed(kind)])} {kind}" for kind in KINDS if row.get(missed(kind), 0) > 0)
    lost = f"missed: {kinds or int(row[MISSED])}" if row[MISSED] else ""
    return "; ".join(filter(None, [lost, f"{int(row[SPURIOUS])} spurious" if row[SPURIOUS] else ""]))


def _cost(cost: pd.DataFrame) -> str:
    if not {OWN_CPU, LOW, HIGH, LEVEL, POSITION} <= set(cost) or not came_out(cost).any():
        return "Not timed in this run."
    ran = cost[came_out(cost) & cost[OWN_CPU].notna() & cost[POSITION].notna()]
    finest = ran.loc[ran.groupby("variant", sort=False)[POSITION].idxmin()]
    lists = [(name, _ranked(rows.sort_values(OWN_CPU, kind="stable"))) for name, rows in groups(finest)]
    return (f"CPU inside the engine's own calls of the most accurate rung of each ladder, without set-up and output: median, in brackets its interval and the error that it buys; "
            f"~ between two whose intervals overlap, which are not ranked ({', '.join(dict.fromkeys(finest['scene']))}). {_lists(lists)}.")


def _ranked(rows: pd.DataFrame) -> str:
    """Variants in order of time; ``<`` between neighbours whose intervals do not overlap, ``~`` between others."""
    text, slowest = "", 0.0
    for row in rows.to_dict("records"):
        sure = row[LEVEL] >= CONFIDENCE
        low, high = (row[LOW], row[HIGH]) if sure else (0.0, float("inf"))
        spread = f"{cell(OWN_CPU, low)} .. {cell(OWN_CPU, high)} s" if sure else "too few rounds"
        text += (" < " if low > slowest else " ~ ") if text else ""
        text += f"{row['variant']} {cell('cpu', row[OWN_CPU])} s ({spread}; {_largest(pd.DataFrame([row]), POSITION)} m)"
        slowest = max(slowest, high)
    return text


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
    named = "".join(f" {said[:1].upper()}{said[1:]}: {'; '.join(map(_short, found))}." for said in (PARTLY, CONTRADICTS, FAILS)
                    if len(found := claims.loc[claims["verdict"] == said, "claim"] if "claim" in claims else []))
    threshold = _threshold(validation.tables.get("threshold", pd.DataFrame()))
    return f"Its {len(claims)} statements: {said}.{named}{threshold}"


def _short(claim: object) -> str:
    return f"\"{textwrap.shorten(str(claim), 90, placeholder=' ...')}\""


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
