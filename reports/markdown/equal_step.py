"""One row per method at equal step: what stands side by side on page one and in the sections."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import pandas as pd

from stiction.comparisons.campaigns.validation import Validation
from stiction.reports.figures.selection import groups, rank, representatives

CONTACT = ", contact"
"""Ending of the label of a variant at contact fidelity."""
MISSING_ENGINE = "missing"
"""Status of a run whose engine is not installed."""
_ARTICLE = {"reference": "the reference", "paper's scheme": "the paper's scheme"}


def tables_of(validation: Validation) -> dict[str, pd.DataFrame]:
    """The tables, rows numbered from 0 as in the data; of those that are not there, empty ones may be asked for."""
    return {name: table.reset_index(drop=True) for name, table in validation.tables.items()}


def methods(validation: Validation) -> list[str]:
    """Labels of the variants that stand for a method: the first of each engine, fidelity and way, and of engines of which nothing came out the first of each fidelity.

    A stored run need not have the trajectories of others. Of an engine that is not installed there is none.
    """
    came_out = representatives(record for record in validation.records if record.trajectory is not None)
    there = {(record.variant.engine, record.variant.fidelity) for record in came_out}
    lost = representatives(record for record in validation.records
                           if (record.variant.engine, record.variant.fidelity) not in there and record.outcome.status != MISSING_ENGINE)
    chosen = {record.variant.label for record in (*came_out, *lost)}
    return [label for label in dict.fromkeys(record.variant.label for record in validation.records) if label in chosen]


def grouped_methods(validation: Validation, of: Callable[[pd.DataFrame], Iterator[tuple[str, pd.DataFrame]]] = groups
                    ) -> Iterator[tuple[str, list[str]]]:
    """`methods` by group: see `stiction.reports.figures.selection`, `groups` and, for rankings, `same_work`."""
    accuracy, chosen = validation.tables.get("accuracy", pd.DataFrame()), methods(validation)
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


def friction_by_adapter(validation: Validation) -> Mapping[str, bool]:
    """By label of a variant that came out: whether the adapter has a part in its friction law, as the run's settings say."""
    laws = {record.variant.label: str(record.trajectory.settings.get("friction_law", "")) for record in validation.records if record.trajectory is not None}
    return {variant: "adapter" in law for variant, law in laws.items()}
