"""Which run of a variant stands for it in a figure or a table, what it is called there, and which variants may stand beside each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache

import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.variants import COMMON_STEP, EVENTS_BY, FRICTION_BY, MUS_EQUALS_MU, Record
from stiction.comparisons.presentation.cells import setting_of
from stiction.scenes import catalogue, load_scene

CONTACT = ", contact"
"""Ending of the label of a variant at contact fidelity."""
MISSING_ENGINE = "missing"
"""Status of a run whose engine is not installed."""
_ARTICLE = {"reference": "the reference", "paper's scheme": "the paper's scheme"}


def one_per_variant(records: Iterable[Record]) -> list[Record]:
    """Of each variant, among the runs that came out, the one nearest to `COMMON_STEP` or at the tightest tolerance."""
    chosen: dict[str, Record] = {}
    for record in records:
        if record.trajectory is None:
            continue
        other = chosen.get(record.variant.label)
        if other is None or rank(record.variant.parameter, record.step) < rank(other.variant.parameter, other.step):
            chosen[record.variant.label] = record
    return list(chosen.values())


def representatives(records: Iterable[Record]) -> list[Record]:
    """Of each engine, fidelity and method the first variant: others change a setting of it."""
    chosen: dict[tuple[str, str, object], Record] = {}
    for record in records:
        method = None if record.trajectory is None else record.trajectory.settings.get("method")
        chosen.setdefault((record.variant.engine, record.variant.fidelity, method), record)
    return list(chosen.values())


def rank(parameter: str, step: float) -> float:
    """The smaller, the rather a run is chosen: distance from `COMMON_STEP`, or the tolerance."""
    return abs(math.log(step / COMMON_STEP)) if parameter == "dt" else step


def stored_keys(results: Results) -> frozenset[str]:
    """Keys of the runs whose trajectories a run folder keeps: all that are compared or, where the depth says ``drawn``, those that stand for their engine on a
    scene. Runs that were made to be timed alone are made again by the command in their row."""
    if results.settings.get("trajectories") != "drawn":
        return frozenset(record.key for record in results.records)
    scenes = dict.fromkeys(record.scene for record in results.records)
    return frozenset(record.key for scene in scenes
                     for record in representatives(one_per_variant(record for record in results.records if record.scene == scene)))


def run_label(record: Record) -> str:
    """``pymunk (dt = 0.001 s)``."""
    return f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"


@cache
def case_of(scene: str) -> str:
    """``case 1`` for ``slider-bar-case-1``: what its title says after the mechanism, else all of it."""
    title = load_scene(scene).title if scene in catalogue() else scene
    return title.partition(", ")[2] or title


def title_of(scene: str) -> str:
    """`case_of` as a heading: ``Case 1``."""
    return case_of(scene)[:1].upper() + case_of(scene)[1:]


def groups(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """The rows that answer one question, and what they are called: one fidelity, and one physics of static friction.

    Joint and contact fidelity answer different questions; so do mus > mu and, of an engine that has no static coefficient, mus = mu.
    """
    equal = table["truth"].astype(str).str.endswith(MUS_EQUALS_MU)
    for (fidelity, same), rows in table.groupby([table["fidelity"], equal], sort=False):
        yield f"{fidelity}, mus {'=' if same else '>'} mu", rows


def same_work(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """The rows of `groups` that may be ranked with each other, and their names: engines do the same part of the work.

    Who supplies the friction law and who locates events is the same for all runs of a variant; of lost ones unknown.
    """
    for name, rows in groups(table):
        parts = [rows["variant"].map(known_of(rows, column)) for column in (FRICTION_BY, EVENTS_BY)]
        for (friction, events), there in rows.groupby(parts, sort=False):
            yield f"{name}; friction: {friction}, events: {events}", there


def known_of(rows: pd.DataFrame, column: str) -> dict[str, str]:
    """What a column says of each variant, in the first of its runs that came out; ``not known`` where none did."""
    there = rows[rows[column].notna()].groupby("variant")[column].first() if column in rows else {}
    return {variant: there.get(variant, "not known") for variant in rows["variant"]}


def methods(results: Results) -> list[str]:
    """Labels of the variants that stand for a method: the first of each engine, fidelity and way, and of engines of which nothing came out the first of each fidelity.

    A stored run need not have the trajectories of others. Of an engine that is not installed there is none.
    """
    came_out = representatives(record for record in results.records if record.trajectory is not None)
    there = {(record.variant.engine, record.variant.fidelity) for record in came_out}
    lost = representatives(record for record in results.records
                           if (record.variant.engine, record.variant.fidelity) not in there and record.outcome.status != MISSING_ENGINE)
    chosen = {record.variant.label for record in (*came_out, *lost)}
    return [label for label in dict.fromkeys(record.variant.label for record in results.records) if label in chosen]


def grouped_methods(results: Results, of: Callable[[pd.DataFrame], Iterator[tuple[str, pd.DataFrame]]] = groups
                    ) -> Iterator[tuple[str, list[str]]]:
    """`methods` by group: see `stiction.comparisons.methods`, `groups` and, for rankings, `same_work`."""
    accuracy, chosen = results.tables.get("accuracy", pd.DataFrame()), methods(results)
    for name, rows in of(accuracy) if len(accuracy) else ():
        there = set(rows["variant"])
        if found := [variant for variant in chosen if variant in there]:
            yield name, found


def called(variant: str, fidelity: bool = True) -> str:
    """A variant in a sentence: ``pymunk with contact`` for ``pymunk, contact``, or ``pymunk`` where the sentence says the fidelity."""
    name = variant.removesuffix(CONTACT)
    return _ARTICLE.get(name, name) + (" with contact" if fidelity and name != variant else "")


def at_equal_step(table: pd.DataFrame, variant: str) -> pd.DataFrame:
    """The rows of a variant at the step nearest to `stiction.comparisons.variants.COMMON_STEP`, or at its tightest tolerance."""
    rows = table[table["variant"] == variant] if "variant" in table else pd.DataFrame()
    if rows.empty:
        return rows
    ranks = pd.Series([rank(*pair) for pair in zip(rows["parameter"], rows["step"])], index=rows.index)
    return rows[ranks == ranks.min()]


def largest(rows: pd.DataFrame, column: str) -> int | None:
    """The label of the row with the largest size in a column; None without any."""
    sizes = rows[column].abs().dropna() if column in rows else pd.Series(dtype=float)
    return None if sizes.empty else int(sizes.idxmax())
