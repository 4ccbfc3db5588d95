"""Joints whose friction has a constant bound, in the study `hold`: which methods hold them, and how fast others creep.

Speeds are in m/s or rad/s, by the joint of a scene, so that scenes are not mixed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import at_equal_step, succeeded, with_columns
from stiction.comparisons.bench.presentation import (
    METHOD,
    Column,
    Headline,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.variants import FRICTION_BY
from stiction.comparisons.measures.published_creep import JOINT_CREEP as PUBLISHED_HERE
from stiction.comparisons.measures.published_creep import JOINT_PUBLISHED, MATCHED
from stiction.comparisons.studies.hold_tables import (
    BOUND,
    BREAK_AWAY,
    BREAK_UNSURE,
    FASTER,
    HELD,
    HOLDS,
    LETS_GO,
    LOAD,
    RAMP,
    STILL,
    STOP,
    SURE,
    TEST,
    USUAL,
)
from stiction.engines.protocol import Supplier
from stiction.engines.registry import own_methods
from stiction.engines.status import UNMADE, Status
from stiction.scenes.fidelity import Fidelity

JOINT_CREEP = "joint_creep"
"""Steady speed of a joint under a load that should be held, in the unit of `JOINT_UNIT`."""
JOINT_UNSURE = "joint_creep_uncertainty"
JOINT_UNIT = "creep_unit"
"""Unit of the creep: m/s, or rad/s of a pin."""
JOINT_STOP = "joint_stop_error"
"""Error of the place where a joint comes to rest, m or rad."""
JOINT_STOP_UNSURE = "joint_stop_uncertainty"
LIGHT = 0.3
"""Load, as a fraction of the bound, at which creep is quoted: users of simulators of robots compare it there."""
REFUSES = "refuses"
"""True if the method takes no friction with a constant bound in the joint of the scene."""
_COLUMNS = (
    "variant",
    "engine",
    "fidelity",
    FRICTION_BY,
    "scene",
    REFUSES,
    "failed",
    HOLDS,
    JOINT_CREEP,
    JOINT_UNSURE,
    JOINT_UNIT,
)
LIMIT_COLUMNS = (
    Column(
        BREAK_AWAY,
        "break-away load, relative to the limit",
        "%",
        interval=True,
        scale=100,
        bound=BOUND,
    ),
    Column(FASTER, "acceleration", "%", form=".2g", scale=100),
)
"""Columns of the break-away under a growing load and of the motion after it, of sliders and of joints."""
_SUPPLIERS = (Supplier.ENGINE, Supplier.BOTH, Supplier.ADAPTER)
"""Order in which methods are listed: friction that the engine supplies itself first."""


def joint_methods_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene and method, of its runs at the step nearest to `COMMON_STEP`.

    Parameters
    ----------
    table
        All runs of scenes whose friction has a constant bound.

    Returns
    -------
    DataFrame
        `HOLDS` is True if every load up to `USUAL` is held with a creep of at most `STILL`, and None if uncertainties
        or failed runs leave this open. `JOINT_CREEP` is that under the load `LIGHT`. Methods whose law the engine
        supplies come first.
    """
    if table.empty:
        return pd.DataFrame(columns=_COLUMNS)
    with_all = with_columns(table, JOINT_CREEP, JOINT_UNSURE, LETS_GO)
    made = with_all[~with_all["status"].isin(UNMADE)]
    rows = []
    for scene in made["scene"].unique():
        on_scene = made[made["scene"] == scene]
        for variant in on_scene["variant"].unique():
            rows.append(_method_row(at_equal_step(on_scene, variant)))
    order = {str(supplier): place for place, supplier in enumerate(_SUPPLIERS)}
    methods = pd.DataFrame(rows, columns=_COLUMNS)
    places = methods[FRICTION_BY].map(order).fillna(len(order))
    return methods.loc[places.sort_values(kind="stable").index].reset_index(drop=True)


def _method_row(runs: pd.DataFrame) -> dict[str, Any]:
    """Return the row of a method on a scene; it has no creep if its run under the load `LIGHT` failed."""
    usual = runs[runs[TEST].eq(HELD) & (runs[LOAD] <= USUAL)]
    completed = usual[succeeded(usual) & usual[JOINT_CREEP].notna()]
    suppliers = completed[FRICTION_BY].dropna()
    row = {
        **runs.iloc[0][["variant", "engine", "fidelity", "scene", JOINT_UNIT]],
        FRICTION_BY: None if suppliers.empty else suppliers.iloc[0],
        REFUSES: bool(runs["status"].eq(Status.REFUSED).all()),
        "failed": len(usual) - len(completed),
    }
    light = completed[completed[LOAD] == LIGHT]
    if not light.empty:
        row[JOINT_CREEP] = abs(light.iloc[0][JOINT_CREEP])
        row[JOINT_UNSURE] = light.iloc[0][JOINT_UNSURE]
    if not completed.empty:
        row[HOLDS] = _holds(completed, has_failed_runs=len(completed) < len(usual))
    return row


def _holds(runs: pd.DataFrame, has_failed_runs: bool) -> bool | None:
    """Return whether all loads are held; None if uncertainties or failed runs leave this open."""
    creep, uncertainty = runs[JOINT_CREEP].abs(), runs[JOINT_UNSURE]
    if ((creep > STILL + SURE * uncertainty) | runs[LETS_GO].eq(True)).any():
        return False
    if (creep + uncertainty > STILL).any() or has_failed_runs:
        return None
    return True


def joint_rows(methods: pd.DataFrame) -> dict[str, object]:
    """Return what the text of the study says about the first scene: who holds its joint, creeps, or refuses it."""
    if methods.empty:
        return {"joints": None}
    first = methods[methods["scene"] == methods["scene"].iloc[0]]
    is_engine = ~first["engine"].isin(own_methods())
    taken = first[is_engine & first[JOINT_CREEP].notna()]
    is_own_law = taken[FRICTION_BY] == Supplier.ENGINE
    creeping = taken[taken[HOLDS].eq(False)].sort_values(JOINT_CREEP, kind="stable")
    is_joint = first["fidelity"] == Fidelity.JOINT
    refusing = first[is_engine & is_joint & first[REFUSES]]
    return {
        "joints": {
            "scene": first["scene"].iloc[0],
            "all": len(taken),
            "holding": int(taken[HOLDS].eq(True).sum()),
            "own_law": int(is_own_law.sum()),
            "own_law_holding": int(taken.loc[is_own_law, HOLDS].eq(True).sum()),
            "creeping": [row_of("hold-joint-methods", methods, label) for label in creeping.index],
            "refusing": list(refusing["variant"]),
            "load": 100 * LIGHT,
            "unit": first[JOINT_UNIT].iloc[0],
        }
    }


def joint_headline(methods: pd.DataFrame) -> Headline:
    """Return the creep of each method on the first scene under the load `LIGHT`."""
    first = methods[methods["scene"] == methods["scene"].iloc[0]]
    cells = {}
    for label in first.index[first[JOINT_CREEP].notna()]:
        cells[first.at[label, "variant"]] = str(
            row_of("hold-joint-methods", methods, label)[JOINT_CREEP]
        )
    unit = first[JOINT_UNIT].iloc[0]
    return Headline(f"creep at {100 * LIGHT:.0f} % of a joint's constant bound [{unit}]", cells)


def published_rows(published: pd.DataFrame) -> dict[str, object]:
    """Return the computed creep of the first published case of a joint, and cases that do not move as they should."""
    if JOINT_PUBLISHED not in published:
        return {"published_joint": None, "unlike_published": []}
    speed = published[PUBLISHED_HERE].abs()
    unlike = published[speed.gt(STILL) != published["moves"].astype(bool)]
    name = "hold-published-joints"
    return {
        "published_joint": row_of(name, published, published.index[0]),
        "unlike_published": list(unlike["case"]),
    }


def published_tables(published: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of published and computed creep of a joint, if it was computed."""
    if JOINT_PUBLISHED not in published:
        return
    columns = (
        Column("case"),
        Column(JOINT_PUBLISHED, "creep, published", form="g"),
        Column(PUBLISHED_HERE, "speed, computed here", interval=True),
        Column(MATCHED),
        Column("published_statement", brief=False),
        Column("difference", brief=False),
        Column("source", brief=False),
    )
    yield view("hold-published-joints", published, columns)


def joint_tables(runs: pd.DataFrame, methods: pd.DataFrame) -> Sequence[TableView]:
    """Return the table of methods, and that of all runs; none without runs."""
    if methods.empty:
        return []
    columns = (
        METHOD,
        Column("fidelity"),
        Column(FRICTION_BY),
        Column("scene", brief=False),
        Column(JOINT_CREEP, f"at {100 * LIGHT:.0f} %"),
        Column(JOINT_UNIT, "unit"),
        Column(HOLDS),
    )
    taken = methods[~methods[REFUSES]]
    return [
        view("hold-joint-methods", taken, columns),
        *_limit_table(runs, methods),
        view(
            "hold-joints",
            runs,
            [Column(name) for name in runs if name not in ("settings", "version", "rerun_command")],
            in_report=False,
        ),
    ]


def _limit_table(runs: pd.DataFrame, methods: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of what happens beyond the limit: a row per scene and method, if there are such runs."""
    moved = with_columns(
        runs[runs[TEST] != HELD],
        BREAK_AWAY,
        BREAK_UNSURE,
        BOUND,
        FASTER,
        JOINT_STOP,
        JOINT_STOP_UNSURE,
    )
    rows = []
    for _, method in methods[~methods[REFUSES]].iterrows():
        is_own = moved["variant"].eq(method["variant"]) & moved["scene"].eq(method["scene"])
        if not is_own.any():
            continue
        own = at_equal_step(moved[is_own], method["variant"])
        row = {**method[["variant", "scene", FRICTION_BY, JOINT_UNIT]]}
        for _, run in own[succeeded(own)].iterrows():
            if run[TEST] == RAMP:
                row |= run[[BREAK_AWAY, BREAK_UNSURE, BOUND, FASTER]].to_dict()
            elif run[TEST] == STOP:
                row |= run[[JOINT_STOP, JOINT_STOP_UNSURE]].to_dict()
        rows.append((row, own))
    if not rows:
        return
    columns = (
        METHOD,
        Column(FRICTION_BY),
        Column("scene"),
        *LIMIT_COLUMNS,
        Column(JOINT_STOP, "place of rest"),
    )
    yield view("hold-joint-limit", rows, columns, source="hold-joints")
