"""Constraint drift of all methods: how far their motions are from the constraints, and whether that grows.

Stabilization against drift over long runs is the question of `stiction.comparisons.studies.long_drift`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    methods,
    one_per_variant,
    scene_title,
)
from stiction.comparisons.bench.participants import PAPERS_SCHEME
from stiction.comparisons.bench.presentation import (
    LIMIT,
    METHOD,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.drift import ROUNDING, drift
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED
from stiction.comparisons.studies.accuracy import compared_runs
from stiction.engines.registry import EngineMissing, UnknownEngine, load_engine
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.engines.status import UNMADE
from stiction.scenes.fidelity import Fidelity
from stiction.uncertain import Uncertain

POSITION, VELOCITY = "position_drift", "velocity_drift"
EXPONENT, INTERVAL = "growth_exponent", "growth_exponent_uncertainty"
JOINT_COORDINATES = "joint_coordinates"
"""Column: the engine moves a tree of links, which holds pins and guides by construction."""
PIECES = 60
"""Parts of the time: the largest drift in each is drawn."""
FLOOR = 1e-17
"""m and m/s; smaller drift, zero included, is drawn here."""
CONSTANTS = {"rounding": f"{ROUNDING:g}", "pieces": PIECES}
"""What the text of the study mentions besides results."""


def plan(scope: Scope) -> Comparison[Tables]:
    """The drift of every run of the accuracy study."""

    def tables(records: tuple[Record, ...]) -> Tables:
        table = pd.DataFrame(
            [{**record.describe(), **drift(record.trajectory)} for record in records]
        )
        if len(table):
            table[JOINT_COORDINATES] = table["engine"].map(_has_joint_coordinates)
        return Tables({"drift": table}, records)

    return compared_runs(scope).then(tables)


def _has_joint_coordinates(engine: str) -> bool:
    """Return True for an engine that moves a tree of links, False if it is not installed."""
    try:
        return isinstance(load_engine(engine), TreeEngine)
    except (EngineMissing, UnknownEngine):
        return False


def present(results: Results) -> Presentation:
    """Drift of each method in position and in velocity, and its growth."""
    table = results.table("drift")
    if POSITION not in table:
        return Presentation()
    table = above_rounding(table)
    table = table[~table["status"].isin(UNMADE)]
    chosen = methods(results)
    parts = [
        at_equal_step(rows, variant)
        for (_, variant), rows in table.groupby(["scene", "variant"], sort=False)
        if variant in chosen
    ]
    runs = pd.concat(parts) if parts else table.iloc[:0]
    measured = runs[runs[POSITION].notna()]
    failed = [
        {"variant": variant, "failed": int(rows[POSITION].isna().sum()), "runs": len(rows)}
        for variant, rows in runs.groupby("variant", sort=False)
        if rows[POSITION].isna().any()
    ]
    if measured.empty:
        return Presentation(rows={"largest": [], "failed": failed, **CONSTANTS, "trees": []})
    worst = measured.groupby("variant", sort=False)[[POSITION, VELOCITY]].idxmax()
    headlines = [
        Headline(
            label,
            {
                variant: str(row_of("drift", table, row)[column])
                for variant, row in worst[column].items()
            },
        )
        for label, column in (("drift [m, rad]", POSITION), ("velocity drift [m/s]", VELOCITY))
    ]
    every = (
        Column("scene"),
        METHOD,
        Column("fidelity"),
        Column("step", form="g"),
        Column(POSITION, "drift, max"),
        Column("position_drift_end", "drift, end"),
        Column(VELOCITY, "velocity drift, max"),
        Column("velocity_drift_end", "velocity drift, end"),
        Column("growth"),
        Column(EXPONENT, "power of time", interval=True),
        Column("status"),
        Column("reason"),
    )
    all_runs = view("drift-all", results.table("drift"), every, source="drift", in_report=False)
    trees = runs[(runs["fidelity"] == Fidelity.JOINT) & runs.get(JOINT_COORDINATES, False)]
    scheme = None
    if PAPERS_SCHEME in worst.index:
        scheme = row_of("drift", table, worst.at[PAPERS_SCHEME, POSITION])[POSITION]
    rows = {
        "largest": list(_largest(table, measured, worst)),
        "scheme": scheme,
        **_growth(table, measured),
        "failed": failed,
        "trees": list(trees["variant"].unique()),
        **CONSTANTS,
    }
    return Presentation(
        rows=rows,
        headlines=headlines,
        tables=[_by_method(table, runs, worst), all_runs],
        figures=_figures(results, chosen),
    )


def above_rounding(
    frame: pd.DataFrame, columns: Sequence[str] = (POSITION, VELOCITY)
) -> pd.DataFrame:
    """The frame with 0 in place of what rounding makes, in columns that hold drift."""
    return frame.assign(
        **{column: frame[column].where(~(frame[column] < ROUNDING), 0.0) for column in columns}
    )


def _largest(
    table: pd.DataFrame, measured: pd.DataFrame, worst: pd.DataFrame
) -> Iterator[dict[str, object]]:
    """The largest drift with joints and with contacts, and the methods that it prints alike for."""
    for fidelity in Fidelity:
        there = worst[worst.index.isin(measured.loc[measured["fidelity"] == fidelity, "variant"])]
        if there.empty:
            continue
        found: dict[str, object] = {"fidelity": fidelity}
        for name, methods_of, column in (
            ("position", "positions_of", POSITION),
            ("velocity", "velocities_of", VELOCITY),
        ):
            cells = {
                variant: row_of("drift", table, row).number(column)
                for variant, row in there[column].items()
            }
            largest = max(table.loc[there[column], column])
            first = next(cell for cell in cells.values() if float(cell) == largest)
            alike = [variant for variant, cell in cells.items() if str(cell) == str(first)]
            found[name] = first
            found[methods_of] = alike
            if column == POSITION:
                growth = table.loc[there.loc[alike, column], "growth"]
                found["bounded"] = bool(growth.eq(BOUNDED).all())
        yield found


def _growth(table: pd.DataFrame, measured: pd.DataFrame) -> dict[str, object]:
    """The numbers of runs by the growth of their drift, and the largest drift that grows."""
    counts = measured["growth"].value_counts()
    growing = measured[measured["growth"] == GROWS]
    largest = None
    if len(growing):
        largest = row_of("drift", table, growing[POSITION].idxmax())[POSITION]
    return {
        "runs": len(measured),
        "grows": len(growing),
        "bounded": int(counts.get(BOUNDED, 0)),
        "rounded": int(counts.get(ROUNDED, 0)),
        "inconclusive": int(counts.get(INCONCLUSIVE, 0)),
        "growing": list(growing["variant"].unique()),
        "largest_growing": largest,
    }


def _by_method(table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame) -> TableView:
    rows = []
    for variant, there in runs[runs["variant"].isin(worst.index)].groupby("variant", sort=False):
        position, velocity = (
            table.loc[worst.at[variant, column]] for column in (POSITION, VELOCITY)
        )
        rows.append(
            (
                {
                    "variant": variant,
                    "fidelity": position["fidelity"],
                    "cases": f"{there[POSITION].notna().sum()} of {len(there)}",
                    POSITION: position[POSITION],
                    "position in": scene_title(position["scene"]) if position[POSITION] else "",
                    VELOCITY: velocity[VELOCITY],
                    "velocity in": scene_title(velocity["scene"]) if velocity[VELOCITY] else "",
                    "growth": _law(position),
                },
                there,
            )
        )
    columns = (
        METHOD,
        Column("fidelity"),
        Column("cases", "cases measured", brief=bool(runs[POSITION].isna().any())),
        Column(POSITION, "drift"),
        Column("position in", "largest drift in"),
        Column(VELOCITY, "velocity drift"),
        Column("velocity in", "largest velocity drift in"),
        Column("growth", "growth of the position drift"),
    )
    return view(
        "drift",
        rows,
        columns,
    )


def _law(run: pd.Series) -> str:
    """``grows, t^(2.1 ± 1.3)``; what is bounded or rounding has no power."""
    if run["growth"] in (BOUNDED, ROUNDED) or pd.isna(run[EXPONENT]):
        return run["growth"]
    return f"{run['growth']}, t^({Uncertain(float(run[EXPONENT]), float(run[INTERVAL])).both()})"


def _figures(results: Results, chosen: Sequence[str]) -> list[Chart]:
    """Drift of every method over time: position above, velocity below, a row a fidelity, a column a case."""
    made = [
        record
        for record in results.records
        if record.trajectory is not None and record.variant.label in chosen
    ]
    scenes = list(dict.fromkeys(record.scene for record in made))
    if not scenes:
        return []
    panels = [
        _panel(
            one_per_variant(
                record
                for record in made
                if record.scene == scene and record.variant.fidelity == fidelity
            ),
            name,
            scene_title(scene),
            f"{fidelity.label}s: {label}",
        )
        for name, label in (
            ("drift.position", "drift [m, rad]"),
            ("drift.velocity", "velocity drift [m/s]"),
        )
        for fidelity in Fidelity
        if any(record.variant.fidelity == fidelity for record in made)
        for scene in scenes
    ]
    return [Chart("drift-engines", panels, columns=len(scenes), share_x=True, share_y=True)]


def _panel(records: Sequence[Record], name: str, title: str, label: str) -> Panel:
    series = []
    for record in records:
        run = record.trajectory
        if run is not None and name in run and len(run.t) > 1:
            t, largest = _envelope(run.t, run[name])
            series.append(Series(record.variant.label, t, largest, look=record.variant.label))
    ends = (
        np.array([min(one.x[0] for one in series), max(one.x[-1] for one in series)])
        if series
        else np.zeros(0)
    )
    series.append(Series("", ends, np.full(len(ends), ROUNDING), look=LIMIT))
    return Panel(title, Axis("time [s]"), Axis(label, log=True), series)


def _envelope(t: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and size of the largest drift in each of `PIECES` pieces of the time, `FLOOR` at least."""
    known = np.isfinite(sizes)
    table = pd.DataFrame({"t": t[known], "size": np.maximum(sizes[known], FLOOR)})
    largest = table.loc[table.groupby(pd.cut(table["t"], PIECES, labels=False))["size"].idxmax()]
    return largest["t"].to_numpy(), largest["size"].to_numpy()


STUDY = Study(
    "drift",
    "Drift",
    "How far do methods drift from the constraints?",
    present,
    plan,
    seconds=0.26,
    tables={
        "drift": "Drift from the constraints of every run",
    },
)
