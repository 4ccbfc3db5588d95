"""Which run of a variant stands for it in a figure, and what it is called there."""

from __future__ import annotations

import math
from collections.abc import Iterable

from stiction.comparisons.campaigns.validation import Validation
from stiction.comparisons.variants import Record
from stiction.reports.markdown.tables import setting_of

COMMON_STEP = 1e-3
"""Seconds; variants with a step are shown at the one nearest to it: equal steps, as far as there are."""


def one_per_variant(records: Iterable[Record]) -> list[Record]:
    """Of each variant, among the runs that came out, the one nearest to `COMMON_STEP` or at the tightest tolerance."""
    chosen: dict[str, Record] = {}
    for record in records:
        if record.trajectory is None:
            continue
        other = chosen.get(record.variant.label)
        if other is None or _rank(record) < _rank(other):
            chosen[record.variant.label] = record
    return list(chosen.values())


def representatives(records: Iterable[Record]) -> list[Record]:
    """Of each engine, fidelity and method the first variant: others change a setting of it."""
    chosen: dict[tuple[str, str, object], Record] = {}
    for record in records:
        method = None if record.trajectory is None else record.trajectory.settings.get("method")
        chosen.setdefault((record.variant.engine, record.variant.fidelity, method), record)
    return list(chosen.values())


def stored_keys(validation: Validation) -> frozenset[str]:
    """Keys of the runs whose trajectories a run folder keeps: all or, where the depth says ``drawn``, those that stand for their engine on a scene."""
    if validation.settings.get("trajectories") != "drawn":
        return frozenset(record.key for record in (*validation.records, *validation.timed))
    scenes = dict.fromkeys(record.scene for record in validation.records)
    return frozenset(record.key for scene in scenes
                     for record in representatives(one_per_variant(record for record in validation.records if record.scene == scene)))


def run_label(record: Record) -> str:
    """``pymunk (dt = 0.001 s)``."""
    return f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"


def _rank(record: Record) -> float:
    return abs(math.log(record.step / COMMON_STEP)) if record.variant.parameter == "dt" else record.step
