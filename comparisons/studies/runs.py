"""Chosen columns of a scene over time, in one figure for several engines.

`stiction compare runs` makes one run for each engine and fidelity, with the step nearest to
`COMMON_STEP` or the tightest tolerance. The study is not part of `stiction validate`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import pandas as pd

from stiction.comparisons.bench.methods import rank, run_label
from stiction.comparisons.bench.participants import REFERENCE, variants
from stiction.comparisons.bench.presentation import (
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    TableView,
)
from stiction.comparisons.bench.presentation import view as table_view
from stiction.comparisons.bench.presentation.charts import ON_TOP
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, records_comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import Record, Variant, scaled
from stiction.comparisons.studies.motion import TIME, limits_of
from stiction.scenes import InputError, Scene
from stiction.scenes.columns import columns_of, label_of
from stiction.scenes.wording import did_you_mean

COLUMN = "column"
"""Column of the table: name of a column of the trajectories."""
VALUE = "value"
"""Column of the table: its value, in the unit of that column."""
TIME_COLUMN = "t"
"""Column of the table: time, s; twice the same at an event, with the values of both sides."""
ROW_HEIGHT = 1.7
"""Height of a row of panels, inches."""


def shown_columns(scene: Scene, chosen: Sequence[str]) -> list[str]:
    """Return the chosen columns; without any, the efforts of drives and the normal forces of guides.

    Raises
    ------
    InputError
        If the scene does not have one of the columns.
    """
    known = columns_of(scene)
    for name in chosen:
        if name not in known:
            raise InputError(
                f"columns: found {name!r}; expected columns of {scene.name} such as "
                f"{', '.join(known[-3:])}{did_you_mean(name, known)}"
            )
    if chosen:
        return list(chosen)
    usual = [name for name in known if name.endswith((".effort", ".normal_force"))]
    return usual or known[:3]


def one_run_each(participants: Sequence[Variant]) -> list[Variant]:
    """Return the first variant of each engine and fidelity with a single run; the reference is the last one."""
    first: dict[tuple[str, str], Variant] = {}
    for variant in participants:
        first.setdefault((variant.engine, variant.fidelity), variant)
    chosen = []
    for variant in first.values():
        step = min(variant.ladder, key=lambda step: rank(variant.parameter, step))
        chosen.append(replace(variant, ladder=(step,)))
    return sorted(chosen, key=lambda variant: variant.engine == REFERENCE)


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan one run for each engine and fidelity."""
    scene = scope.scenes[0]
    columns = shown_columns(scene, scope.options.get("columns", ()))
    chosen = one_run_each(variants(scope.engines, scope.depth))

    def tables(records: tuple[Record, ...]) -> Tables:
        return Tables({"runs": samples(records, columns)}, records)

    comparison = records_comparison([scene], scaled(chosen, scene, scope.t_end), scope.t_end)
    return comparison.then(tables)


def samples(records: Sequence[Record], columns: Sequence[str]) -> pd.DataFrame:
    """Return the samples of some columns of all runs in long form; runs without a trajectory have none."""
    parts = []
    for record in records:
        if record.trajectory is None:
            continue
        frame = record.run.to_frame(events=True)
        for name in columns:
            if name in frame:
                part = pd.DataFrame({TIME_COLUMN: frame["t"], VALUE: frame[name]})
                parts.append(
                    part.assign(key=record.key, variant=record.variant.label, **{COLUMN: name})
                )
    order = ["key", "variant", COLUMN, TIME_COLUMN, VALUE]
    return pd.concat([pd.DataFrame(columns=order), *parts], ignore_index=True)[order]


def present(results: Results) -> Presentation:
    """Present the range of each column in each run, and a panel for each column."""
    table = results.table("runs")
    if table.empty or VALUE not in table:
        return Presentation()
    scene = results.scene(results.records[0].scene)
    if scene is None:
        return Presentation()
    names = list(table[COLUMN].unique())
    labels = {record.key: run_label(record) for record in results.records}
    panels = [_panel(scene, table[table[COLUMN] == name], name, labels) for name in names]
    columns = 1 if len(panels) < 3 else 2
    chart = Chart(f"runs-{scene.name}", panels, columns, ROW_HEIGHT)
    rows = {"scene": scene.name}
    return Presentation(rows=rows, tables=[_ranges(table)], figures=[chart])


def _panel(scene: Scene, rows: pd.DataFrame, name: str, labels: dict[str, str]) -> Panel:
    """Return the panel of a column: a line for each run, that of the reference on top."""
    series = []
    for key, run in rows.groupby("key", sort=False):
        variant = run["variant"].iloc[0]
        look = ON_TOP if variant == REFERENCE else variant
        series.append(
            Series(
                labels[str(key)],
                run[TIME_COLUMN].to_numpy(float),
                run[VALUE].to_numpy(float),
                look=look,
            )
        )
    y = Axis(label_of(name, scene), limits=limits_of(series[-1].y))
    end = float(rows[TIME_COLUMN].max())
    return Panel("", Axis(TIME, limits=(0.0, end)), y, series)


def _ranges(table: pd.DataFrame) -> TableView:
    """Return the table with the smallest, the largest and the last value of each column in each run."""
    columns = (
        Column("variant", "method"),
        Column(COLUMN),
        Column("smallest", form=".6g"),
        Column("largest", form=".6g"),
        Column("last", "at the end", form=".6g"),
    )
    return table_view("runs", list(_range_rows(table)), columns)


def _range_rows(table: pd.DataFrame) -> Iterator[tuple[dict[str, object], pd.DataFrame]]:
    """Yield a row of the table of ranges, and the samples from which it was computed."""
    for (_, name), rows in table.groupby(["key", COLUMN], sort=False):
        values = rows[VALUE]
        row = {
            "variant": rows["variant"].iloc[0],
            COLUMN: name,
            "smallest": values.min(),
            "largest": values.max(),
            "last": values.iloc[-1],
        }
        yield row, rows


STUDY = Study(
    "runs",
    "Runs",
    "How do chosen columns change over time with several engines?",
    present,
    plan,
    seconds=0.3,
    on_page_one=False,
    in_campaign=False,
    takes=frozenset({"engines", "t_end", "columns"}),
)
