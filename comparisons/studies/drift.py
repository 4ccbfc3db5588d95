"""Constraint drift of all methods: the residuals of the constraints in their motions, and the growth of these.

The runs are those of the accuracy study. `stiction.comparisons.studies.long_drift` compares stabilizations against
drift over longer runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    methods,
    one_per_variant,
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
from stiction.comparisons.bench.presentation.rows import Cell
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import NightlyNumbers, Scope, Study, Tables
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.drift import DECAY_ERROR, ROUNDING, drift
from stiction.comparisons.measures.drift_growth import (
    BOUNDED,
    DECAYS,
    GROWS,
    INCONCLUSIVE,
    ROUNDED,
)
from stiction.comparisons.studies.accuracy import compared_runs
from stiction.engines.registry import EngineMissing, UnknownEngine, load_engine
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.engines.status import UNMADE
from stiction.scenes.fidelity import Fidelity
from stiction.uncertain import Uncertain

POSITION = "position_drift"
"""Column: largest residual of the position constraints in a run, m or rad."""
VELOCITY = "velocity_drift"
"""Column: largest residual of the velocity constraints in a run, m/s or rad/s."""
EXPONENT = "growth_exponent"
"""Column: exponent of time with which the position drift grows."""
INTERVAL = "growth_exponent_uncertainty"
"""Column: half of the confidence interval of the exponent."""
JOINT_COORDINATES = "joint_coordinates"
"""Column: whether the engine moves a tree of links, which satisfies pins and guides by construction."""
PIECES = 60
"""Number of equal parts of the time, in each of which the largest drift is drawn."""
SMALLEST_DRAWN = 1e-17
"""Smallest drift (m and m/s) that is drawn; a logarithmic axis has no place for 0."""
CONSTANTS = {"rounding": f"{ROUNDING:g}", "pieces": PIECES}
"""Constants in the text of the study: a residual in m, and a number."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the runs of the accuracy study, and the table of their drift."""

    def tables(records: tuple[Record, ...]) -> Tables:
        rows = [{**record.describe(), **drift(record.trajectory)} for record in records]
        table = pd.DataFrame(rows)
        if len(table):
            table[JOINT_COORDINATES] = table["engine"].map(_has_joint_coordinates)
        return Tables({"drift": table}, records)

    return compared_runs(scope).then(tables)


def _has_joint_coordinates(engine: str) -> bool:
    """Return whether an engine moves a tree of links; False if it is not installed."""
    try:
        return isinstance(load_engine(engine), TreeEngine)
    except (EngineMissing, UnknownEngine):
        return False


def present(results: Results) -> Presentation:
    """Present the largest drift of each method in position and velocity, and its growth."""
    table = results.table("drift")
    if POSITION not in table:
        return Presentation()
    table = above_rounding(table)
    table = table[~table["status"].isin(UNMADE)]
    variants = methods(results)
    runs = _runs_at_equal_step(table, variants)
    measured = runs[runs[POSITION].notna()]
    failed = [
        {"variant": variant, "failed": int(rows[POSITION].isna().sum()), "runs": len(rows)}
        for variant, rows in runs.groupby("variant", sort=False)
        if rows[POSITION].isna().any()
    ]
    if measured.empty:
        return Presentation(rows={"largest": [], "failed": failed, **CONSTANTS, "trees": []})
    # Labels of the rows with the largest drift of each variant.
    worst = measured.groupby("variant", sort=False)[[POSITION, VELOCITY]].idxmax()
    drift_of_scheme = None
    if PAPERS_SCHEME in worst.index:
        drift_of_scheme = row_of("drift", table, worst.at[PAPERS_SCHEME, POSITION])[POSITION]
    trees = runs[(runs["fidelity"] == Fidelity.JOINT) & runs.get(JOINT_COORDINATES, False)]
    rows = {
        "largest": list(_largest(table, measured, worst)),
        "scheme": drift_of_scheme,
        **_growth(table, measured),
        "failed": failed,
        "trees": list(trees["variant"].unique()),
        **CONSTANTS,
    }
    return Presentation(
        rows=rows,
        headlines=[
            _headline("drift [m, rad]", table, worst[POSITION]),
            _headline("velocity drift [m/s]", table, worst[VELOCITY]),
        ],
        tables=[_by_method(results, table, runs, worst), _all_runs(results)],
        figures=_figures(results, variants),
    )


def _runs_at_equal_step(table: pd.DataFrame, variants: Sequence[str]) -> pd.DataFrame:
    """Return the runs of some variants on each scene, each with the step or tolerance of `at_equal_step`."""
    parts = [
        at_equal_step(rows, variant)
        for (_, variant), rows in table.groupby(["scene", "variant"], sort=False)
        if variant in variants
    ]
    return pd.concat(parts) if parts else table.iloc[:0]


def _headline(label: str, table: pd.DataFrame, worst: pd.Series) -> Headline:
    """Return the headline of the largest drift; `worst` has the row of each variant, and is named by the column."""
    cells = {
        variant: str(row_of("drift", table, row)[str(worst.name)]) for variant, row in worst.items()
    }
    return Headline(label, cells)


def _all_runs(results: Results) -> TableView:
    """Return the table of the drift of all runs."""
    columns = (
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
    return view("drift-all", results.table("drift"), columns, source="drift", in_report=False)


def above_rounding(
    frame: pd.DataFrame, columns: Sequence[str] = (POSITION, VELOCITY)
) -> pd.DataFrame:
    """Return the frame with 0 in place of drift that is no larger than rounding, in the given columns."""
    return frame.assign(
        **{column: frame[column].where(~(frame[column] < ROUNDING), 0.0) for column in columns}
    )


def _largest(
    table: pd.DataFrame, measured: pd.DataFrame, worst: pd.DataFrame
) -> Iterator[dict[str, object]]:
    """Yield for each fidelity the largest drift in position and velocity, and the variants that have it.

    Variants whose drift is rounded to the same text count as equal.
    """
    for fidelity in Fidelity:
        members = measured.loc[measured["fidelity"] == fidelity, "variant"]
        worst_of_members = worst[worst.index.isin(members)]
        if worst_of_members.empty:
            continue
        position, positions_of = _largest_cell(table, worst_of_members[POSITION])
        velocity, velocities_of = _largest_cell(table, worst_of_members[VELOCITY])
        growth = table.loc[worst_of_members.loc[positions_of, POSITION], "growth"]
        yield {
            "fidelity": fidelity,
            "position": position,
            "positions_of": positions_of,
            "bounded": bool(growth.eq(BOUNDED).all()),
            "velocity": velocity,
            "velocities_of": velocities_of,
        }


def _largest_cell(table: pd.DataFrame, worst: pd.Series) -> tuple[Cell, list[str]]:
    """Return the largest drift as a cell, and the variants whose drift has the same text.

    `worst` contains the label of the row of each variant, and has the name of the column of drift.
    """
    cells = {
        variant: row_of("drift", table, label).number(str(worst.name))
        for variant, label in worst.items()
    }
    largest = max(cells.values(), key=float)
    equals = [str(variant) for variant, cell in cells.items() if str(cell) == str(largest)]
    return largest, equals


def _growth(table: pd.DataFrame, measured: pd.DataFrame) -> dict[str, object]:
    """Return the number of runs with each law of growth, and the largest drift that grows."""
    counts = measured["growth"].value_counts()
    growing = measured[measured["growth"] == GROWS]
    largest = None
    if len(growing):
        largest = row_of("drift", table, growing[POSITION].idxmax())[POSITION]
    return {
        "runs": len(measured),
        "grows": len(growing),
        "bounded": int(counts.get(BOUNDED, 0)),
        "decays": int(counts.get(DECAYS, 0)),
        "rounded": int(counts.get(ROUNDED, 0)),
        "inconclusive": int(counts.get(INCONCLUSIVE, 0)),
        "growing": list(growing["variant"].unique()),
        "largest_growing": largest,
    }


def _by_method(
    results: Results, table: pd.DataFrame, runs: pd.DataFrame, worst: pd.DataFrame
) -> TableView:
    """Return the table of the largest drift of each method over all cases."""
    rows = []
    measured_variants = runs[runs["variant"].isin(worst.index)]
    for variant, runs_of_variant in measured_variants.groupby("variant", sort=False):
        position = table.loc[worst.at[variant, POSITION]]
        velocity = table.loc[worst.at[variant, VELOCITY]]
        row = {
            "variant": variant,
            "fidelity": position["fidelity"],
            "cases": f"{runs_of_variant[POSITION].notna().sum()} of {len(runs_of_variant)}",
            POSITION: position[POSITION],
            "position in": results.title_of(position["scene"]) if position[POSITION] else "",
            VELOCITY: velocity[VELOCITY],
            "velocity in": results.title_of(velocity["scene"]) if velocity[VELOCITY] else "",
            "growth": _law(position),
        }
        rows.append((row, runs_of_variant))
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
    return view("drift", rows, columns)


def _law(run: pd.Series) -> str:
    """Return the law of growth of a run as text: ``grows, t^(2.1 ± 1.3)``; other laws than powers by their name."""
    if run["growth"] in (BOUNDED, ROUNDED) or pd.isna(run[EXPONENT]):
        return run["growth"]
    exponent = Uncertain(float(run[EXPONENT]), float(run[INTERVAL]))
    return f"{run['growth']}, t^({exponent.both()})"


def _figures(results: Results, variants: Sequence[str]) -> list[Chart]:
    """Return the chart of drift over time: position above, velocity below, a row per fidelity, a column per case."""
    drawn = [
        record
        for record in results.records
        if record.trajectory is not None and record.variant.label in variants
    ]
    scenes = list(dict.fromkeys(record.scene for record in drawn))
    if not scenes:
        return []
    panels = []
    for column, label in (
        ("drift.position", "drift [m, rad]"),
        ("drift.velocity", "velocity drift [m/s]"),
    ):
        for fidelity in Fidelity:
            of_fidelity = [record for record in drawn if record.variant.fidelity == fidelity]
            if not of_fidelity:
                continue
            for scene in scenes:
                records = one_per_variant(record for record in of_fidelity if record.scene == scene)
                title = results.title_of(scene)
                panels.append(_panel(records, column, title, f"{fidelity.label}s: {label}"))
    return [Chart("drift-engines", panels, columns=len(scenes), share_x=True, share_y=True)]


def _panel(records: Sequence[Record], column: str, title: str, label: str) -> Panel:
    """Return a panel of drift over time: a line per run, and one at the level of rounding."""
    series = []
    for record in records:
        run = record.trajectory
        if run is not None and column in run and len(run.t) > 1:
            t, largest = _envelope(run.t, run[column])
            series.append(Series(record.variant.label, t, largest, look=record.variant.label))
    ends = np.zeros(0)
    if series:
        ends = np.array([min(line.x[0] for line in series), max(line.x[-1] for line in series)])
    series.append(Series("", ends, np.full(len(ends), ROUNDING), look=LIMIT))
    return Panel(title, Axis("time [s]"), Axis(label, log=True), series)


def _envelope(t: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return time (s) and size of the largest drift in each of `PIECES` parts of the time.

    Sizes are raised to `SMALLEST_DRAWN` at least.
    """
    is_finite = np.isfinite(sizes)
    drawn_sizes = np.maximum(sizes[is_finite], SMALLEST_DRAWN)
    table = pd.DataFrame({"t": t[is_finite], "size": drawn_sizes})
    piece = pd.cut(table["t"], PIECES, labels=False)
    largest = table.loc[table.groupby(piece)["size"].idxmax()]
    return largest["t"].to_numpy(), largest["size"].to_numpy()


STUDY = Study(
    "drift",
    "Drift",
    "How far do methods drift from the constraints?",
    present,
    plan,
    seconds=0.26,
    takes=frozenset({"engines", "t_end", "scenes"}),
    tables={
        "drift": "Drift from the constraints of every run",
    },
    nightly=NightlyNumbers(("position_drift", "velocity_drift", DECAY_ERROR)),
)
