"""Constraint drift of all methods: how far their motions are from the constraints, and whether that grows.

Stabilization against drift over long runs is the question of `stiction.comparisons.studies.long_drift`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    called,
    case_of,
    methods,
    one_per_variant,
    title_of,
)
from stiction.comparisons.bench.presentation import (
    LIMIT,
    Axis,
    Chart,
    Column,
    Headline,
    Number,
    Panel,
    Presentation,
    Series,
    TableView,
    TracedText,
    count,
    listed,
    sentence,
    traced,
    value,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.drift import ROUNDING, drift
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED
from stiction.comparisons.studies.accuracy import compared_runs
from stiction.engines.protocol import FIDELITIES
from stiction.engines.registry import EngineMissing, UnknownEngine, load_engine
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.uncertain import Uncertain

POSITION, VELOCITY = "position_drift", "velocity_drift"
EXPONENT, INTERVAL = "growth_exponent", "growth_exponent_uncertainty"
JOINT_COORDINATES = "joint_coordinates"
"""Column: the engine moves a tree of links, which holds pins and guides by construction."""
PIECES = 60
"""Parts of the time: the largest drift in each is drawn."""
FLOOR = 1e-17
"""m and m/s; smaller drift, zero included, is drawn here."""


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
    chosen = methods(results)
    parts = [
        at_equal_step(rows, variant)
        for (_, variant), rows in table.groupby(["scene", "variant"], sort=False)
        if variant in chosen
    ]
    runs = pd.concat(parts) if parts else table.iloc[:0]
    measured = runs[runs[POSITION].notna()]
    failed = [
        traced(
            "{} in {} of {}",
            called(variant),
            count("drift", table, key=frozenset(keys)),
            count("drift", table, key=frozenset(runs.loc[runs["variant"] == variant, "key"])),
        )
        for variant, keys in runs[runs[POSITION].isna()].groupby("variant", sort=False)["key"]
    ]
    without = sentence("Runs that failed and have no drift: {}.", listed(failed))
    if measured.empty:
        return Presentation(findings=[without])
    worst = measured.groupby("variant", sort=False)[[POSITION, VELOCITY]].idxmax()
    headlines = [
        Headline(
            label,
            {
                variant: traced("{}", drift_size("drift", table, int(row), column))
                for variant, row in worst[column].items()
            },
        )
        for label, column in (("drift [m, rad]", POSITION), ("velocity drift [m/s]", VELOCITY))
    ]
    every = (
        Column("scene"),
        Column("variant", "method"),
        Column("fidelity"),
        Column("step", form="g"),
        Column(POSITION, "drift, max", "m, rad"),
        Column("position_drift_end", "drift, end", "m, rad"),
        Column(VELOCITY, "velocity drift, max", "m/s"),
        Column("velocity_drift_end", "velocity drift, end", "m/s"),
        Column("growth"),
        Column(EXPONENT, "power of time", uncertainty=INTERVAL, interval=True),
        Column("status"),
        Column("reason"),
    )
    all_runs = view(
        "drift-all", "Drift of every run.", table, every, source="drift", in_report=False
    )
    notes = [
        "Drift is the norm of the residuals of the constraints, gaps in m and angles in rad together, or of "
        f"their rates. Values below {ROUNDING:g} are rounding and print as 0. With contacts, drift includes "
        "penetration.",
        "Bounded: an offset that does not grow with time.",
    ]
    trees = runs[(runs["fidelity"] == "joint") & runs.get(JOINT_COORDINATES, False)]
    if len(trees):
        names = ", ".join(called(variant) for variant in trees["variant"].unique())
        notes.append(
            f"Joint coordinates ({names}) hold pins and guides by construction: what drifts is the drive and "
            "closed loops alone, so that little drift is no merit."
        )
    return Presentation(
        _answer(table, measured, worst),
        [_growth(table, measured), without],
        headlines,
        [_by_method(table, runs, worst), all_runs],
        _figures(results, chosen),
        notes,
    )


def drift_size(name: str, table: pd.DataFrame, label: int, column: str) -> Number:
    """The drift in a row of a table of the data; 0 where rounding makes as much."""
    if table.at[label, column] < ROUNDING:
        return Number("0", name, column, rows=(label + 1,))
    return value(name, table, label, column)


def above_rounding(
    frame: pd.DataFrame, columns: Sequence[str] = (POSITION, VELOCITY)
) -> pd.DataFrame:
    """The frame with 0 in place of what rounding makes, in columns that hold drift."""
    return frame.assign(
        **{column: frame[column].where(~(frame[column] < ROUNDING), 0.0) for column in columns}
    )


def _answer(table: pd.DataFrame, measured: pd.DataFrame, worst: pd.DataFrame) -> TracedText:
    """The largest drift of each fidelity, and that of the paper's scheme."""
    parts = []
    for fidelity, place in (("joint", "at joints"), ("contact", "at contacts")):
        there = worst[worst.index.isin(measured.loc[measured["fidelity"] == fidelity, "variant"])]
        if there.empty:
            continue
        position, velocity = (
            {
                variant: drift_size("drift", table, int(row), column)
                for variant, row in there[column]
                .sort_values(
                    key=lambda rows, column=column: -table.loc[rows, column].array, kind="stable"
                )
                .items()
            }
            for column in (POSITION, VELOCITY)
        )
        first, second = (
            ", ".join(
                called(variant, False)
                for variant, number in sizes.items()
                if number.text == next(iter(sizes.values())).text
            )
            for sizes in (position, velocity)
        )
        bounded = (
            "; bounded"
            if table.at[there.at[next(iter(position)), POSITION], "growth"] == BOUNDED
            else ""
        )
        sizes = (next(iter(position.values())), next(iter(velocity.values())))
        parts.append(
            traced("{} m and {} m/s {} ({}{})", *sizes, place, first, bounded)
            if first == second
            else traced(
                "{} m ({}{}) and {} m/s ({}) {}", sizes[0], first, bounded, sizes[1], second, place
            )
        )
    if "paper's scheme" in worst.index:
        scheme = drift_size("drift", table, int(worst.at["paper's scheme", POSITION]), POSITION)
        parts.append(traced("paper's scheme {} m", scheme))
    return traced("At most {}.", listed(parts, "; ", "; "))


def _growth(table: pd.DataFrame, measured: pd.DataFrame) -> TracedText:
    """The number of runs whose drift grows, and its size."""
    keys = frozenset(measured["key"])
    grows, bounded, rounded, inconclusive = (
        count("drift", table, growth=law, key=keys)
        for law in (GROWS, BOUNDED, ROUNDED, INCONCLUSIVE)
    )
    growing, largest = measured[measured["growth"] == GROWS], TracedText("")
    if len(growing):
        largest = traced(
            " ({}; up to {} m)",
            listed([called(variant) for variant in growing["variant"].unique()]),
            drift_size("drift", table, int(growing[POSITION].idxmax()), POSITION),
        )
    return traced(
        "Drift clearly grows in {} of {} runs{}. It is bounded in {} and rounding in {}; in {} the run is "
        "too short to say.",
        grows,
        count("drift", table, key=keys),
        largest,
        bounded,
        rounded,
        inconclusive,
    )


def _by_method(table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame) -> TableView:
    table, rows = above_rounding(table), []
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
                    "position in": case_of(position["scene"]) if position[POSITION] else "",
                    VELOCITY: velocity[VELOCITY],
                    "velocity in": case_of(velocity["scene"]) if velocity[VELOCITY] else "",
                    "growth": _law(position),
                },
                there,
            )
        )
    columns = (
        Column("variant", "method"),
        Column("fidelity"),
        Column("cases", "cases measured", brief=bool(runs[POSITION].isna().any())),
        Column(POSITION, "drift", "m, rad"),
        Column("position in", "in"),
        Column(VELOCITY, "velocity drift", "m/s"),
        Column("velocity in", "in"),
        Column("growth", "growth of drift there"),
    )
    return view(
        "drift",
        "Largest drift of each method, of all cases: steps nearest to 1 ms, the reference at its "
        "tightest tolerance. t^p: the power of time fitted to it.",
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
            title_of(scene),
            f"{fidelity}s: {label}",
        )
        for name, label in (
            ("drift.position", "drift [m, rad]"),
            ("drift.velocity", "velocity drift [m/s]"),
        )
        for fidelity in FIDELITIES
        if any(record.variant.fidelity == fidelity for record in made)
        for scene in scenes
    ]
    caption = (
        f"Drift of every method over time, the largest in each of {PIECES} pieces: of position above, of "
        "velocity below, joints and contacts apart. A method may be low in one and high in the other. "
        f"Dotted: {ROUNDING:g}, below which it is rounding."
    )
    return [
        Chart("drift-engines", caption, panels, columns=len(scenes), share_x=True, share_y=True)
    ]


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
)
