"""Runs that stand for their variant in figures and tables, their names there, and the groups that may be ranked."""

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
    """Return of each variant the successful run nearest to `COMMON_STEP` or at the tightest tolerance."""
    by_variant: dict[str, list[Record]] = {}
    for record in records:
        if record.trajectory is not None:
            by_variant.setdefault(record.variant.label, []).append(record)
    return [min(runs, key=lambda record: rank(record.variant.parameter, record.step)) for runs in by_variant.values()]


def representatives(records: Iterable[Record]) -> list[Record]:
    """Return the first variant of each engine, fidelity and method: others change a setting of it."""
    chosen: dict[tuple[str, str, object], Record] = {}
    for record in records:
        method = None if record.trajectory is None else record.trajectory.settings.get("method")
        chosen.setdefault((record.variant.engine, record.variant.fidelity, method), record)
    return list(chosen.values())


def rank(parameter: str, step: float) -> float:
    """Return the rank of a run, the smallest of which is chosen: distance from `COMMON_STEP`, or the tolerance."""
    return abs(math.log(step / COMMON_STEP)) if parameter == "dt" else step


def stored_keys(results: Results) -> frozenset[str]:
    """Return the keys of the runs whose trajectories a run folder keeps.

    They are all that are compared or, where the depth says ``drawn``, those that stand for their engine on a scene.
    Runs that were made to be timed alone are made again by the command in their row.
    """
    if results.settings.get("trajectories") != "drawn":
        return frozenset(record.key for record in results.records)
    by_scene: dict[str, list[Record]] = {}
    for record in results.records:
        by_scene.setdefault(record.scene, []).append(record)
    return frozenset(record.key for runs in by_scene.values() for record in representatives(one_per_variant(runs)))


def run_label(record: Record) -> str:
    """``pymunk (dt = 0.001 s)``."""
    return f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"


@cache
def case_of(scene: str) -> str:
    """Return ``case 1`` for ``slider-bar-case-1``: the part of its title after the mechanism, else all of it."""
    title = load_scene(scene).title if scene in catalogue() else scene
    return title.partition(", ")[2] or title


def title_of(scene: str) -> str:
    """`case_of` as a heading: ``Case 1``."""
    return case_of(scene)[:1].upper() + case_of(scene)[1:]


def groups(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield rows that answer one question, and their name: one fidelity, and one physics of static friction.

    Joint and contact fidelity answer different questions; so do mus > mu and, of an engine that has no static
    coefficient, mus = mu.
    """
    equal = table["truth"].astype(str).str.endswith(MUS_EQUALS_MU)
    for (fidelity, same), rows in table.groupby([table["fidelity"], equal], sort=False):
        yield f"{fidelity}, mus {'=' if same else '>'} mu", rows


def same_work(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the rows of `groups` that may be ranked with each other, and their name: of the same part of the work.

    The suppliers of the friction law and of the events are the same for all runs of a variant, of failed ones unknown.
    """
    for name, rows in groups(table):
        parts = [rows["variant"].map(known_of(rows, column)) for column in (FRICTION_BY, EVENTS_BY)]
        for (friction, events), there in rows.groupby(parts, sort=False):
            yield f"{name}; friction: {friction}, events: {events}", there


def known_of(rows: pd.DataFrame, column: str) -> dict[str, str]:
    """Return a column's value by variant, in the first successful run; ``not known`` where all runs failed."""
    there = rows[rows[column].notna()].groupby("variant")[column].first() if column in rows else {}
    return {variant: there.get(variant, "not known") for variant in rows["variant"]}


def methods(results: Results) -> list[str]:
    """Return the labels of the variants that stand for a method: the first of each engine, fidelity and way.

    Engines all of whose runs failed have the first of each fidelity, for a stored run need not have the trajectories of
    others. Engines that are not installed have none.
    """
    successful = representatives(record for record in results.records if record.trajectory is not None)
    there = {(record.variant.engine, record.variant.fidelity) for record in successful}
    failed = representatives(record for record in results.records if record.outcome.status != MISSING_ENGINE
                             and (record.variant.engine, record.variant.fidelity) not in there)
    chosen = {record.variant.label for record in (*successful, *failed)}
    return [label for label in dict.fromkeys(record.variant.label for record in results.records) if label in chosen]


def grouped_methods(results: Results, of: Callable[[pd.DataFrame], Iterator[tuple[str, pd.DataFrame]]] = groups
                    ) -> Iterator[tuple[str, list[str]]]:
    """Yield `methods` by group: of `groups` or, for rankings, of `same_work`."""
    accuracy, chosen = results.tables.get("accuracy", pd.DataFrame()), methods(results)
    for name, rows in of(accuracy) if len(accuracy) else ():
        there = set(rows["variant"])
        if found := [variant for variant in chosen if variant in there]:
            yield name, found


def called(variant: str, fidelity: bool = True) -> str:
    """Return the name of a variant in a sentence: ``pymunk with contact``, or ``pymunk`` without the fidelity."""
    name = variant.removesuffix(CONTACT)
    return _ARTICLE.get(name, name) + (" with contact" if fidelity and name != variant else "")


def at_equal_step(table: pd.DataFrame, variant: str) -> pd.DataFrame:
    """Return the rows of a variant at the step nearest to `COMMON_STEP`, or at its tightest tolerance."""
    rows = table[table["variant"] == variant] if "variant" in table else pd.DataFrame()
    if rows.empty:
        return rows
    ranks = pd.Series([rank(*pair) for pair in zip(rows["parameter"], rows["step"])], index=rows.index)
    return rows[ranks == ranks.min()]


def largest(rows: pd.DataFrame, column: str) -> int | None:
    """Return the label of the row with the largest size in a column; None without any."""
    sizes = rows[column].abs().dropna() if column in rows else pd.Series(dtype=float)
    return None if sizes.empty else int(sizes.idxmax())
