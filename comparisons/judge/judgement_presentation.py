"""Presentation of a judgement: the rows that its text mentions, its tables and its figure.

The text is in ``reports/templates/judgement.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.presentation import (
    TRUTH,
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.judge.judgement import (
    FOUND,
    INVENTED,
    MISSED,
    RESOLVED,
    STILL,
    UNRESOLVED,
    Judgement,
)
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, truth_over_time
from stiction.comparisons.measures.other_parameters import Hypothesis
from stiction.comparisons.measures.result_errors import COARSE, UNDETERMINED
from stiction.comparisons.measures.scene_truth import OWN_RTOL
from stiction.engines.examined import RESIDUALS
from stiction.reference_impl.energies import needed_columns
from stiction.scenes.columns import unit_of
from stiction.truths import Tier

LINE_SAMPLES = 2000
"""Largest number of samples of a line in the figure: more than it has pixels."""
TABLE_POINTS = 100
"""Largest number of rows of the table that are drawn as points: more would cover the line of the truth."""
MAX_POSITIONS = 6
"""Largest number of positions in the figure, those with the largest errors."""
JUMPING = ("m/s²", "rad/s²", "N", "N m")
"""Units of accelerations and forces, which jump at events."""
BASE_UNITS = {
    "m": "m",
    "m/s": "m",
    "m/s²": "m",
    "rad": "rad",
    "rad/s": "rad",
    "rad/s²": "rad",
}
"""Units of lengths and angles by those that are converted together with them; other units stand alone."""
MENTIONED = (
    "table_begin",
    "table_end",
    "t_end",
    "sample_distance",
    "velocity_error",
    TORQUE_ERROR,
    "two_sided_instants",
    "events_matched",
    "events_missed",
    "event_time_error",
    "position_drift",
    "growth",
    "energy_error",
    "energy_exchanged",
    "completed_energy_error",
    "completed_energy_exchanged",
)
"""Columns of the summary that the text mentions; they are empty where a judgement does not have them."""


def presentation(judged: Judgement) -> Presentation:
    """Return what the text, the tables and the figure of a judgement show."""
    summary = with_columns(judged.tables["summary"], *MENTIONED)
    rows = {
        "scene": judged.scene.name,
        "is_complete": judged.is_complete,
        "summary": row_of("summary", summary, 0),
        "still": STILL,
        "resolved": RESOLVED,
        **_worst(judged),
        "truth": _truth(judged),
        "misread": _misread(judged),
        "hints": _hints(judged),
        "other_parameters": _other_parameters(judged),
        "coarse": _coarse(judged),
        "stick_phases": _stick_phases(judged),
        "jumps": _jumps(judged),
        "findings": list(judged.tables["findings"]["finding"]),
        "efforts": _efforts(judged),
        "not_judged": _not_judged(judged),
        "unknown": _unknown(judged),
        "undetermined": _undetermined(judged),
        "left_out": list(judged.table.left_out),
    }
    return Presentation(rows=rows, tables=list(_tables(judged)), figures=list(_figures(judged)))


def _worst(judged: Judgement) -> dict[str, object]:
    """Return the row with the largest error of a position, or the largest relative error if there are no positions.

    The uncertainty of the truth is added to the error of a position. The error of another column is relative to the
    size of the column.
    """
    table = judged.tables["errors"]
    errors = judged.in_metres("error") + judged.in_metres("uncertainty")
    has_positions = bool(errors.notna().any())
    if not has_positions:
        errors = table["error"] / table["size"].where(table["size"] > 0.0)
    if errors.isna().all():
        return {"worst": None, "worst_is_position": False, "worst_is_certain": False}
    label = errors.idxmax()
    return {
        "worst": row_of("errors", table, label),
        "worst_is_position": has_positions,
        # The time of an error that is within the uncertainty of the truth is arbitrary.
        "worst_is_certain": bool(table.at[label, "error"] > table.at[label, "uncertainty"]),
    }


def _truth(judged: Judgement) -> dict[str, object]:
    """Return the kind of the truth, and its position with the largest uncertainty."""
    uncertainties = judged.in_metres("uncertainty")
    least_known = None
    if uncertainties.notna().any():
        least_known = row_of("errors", judged.tables["errors"], uncertainties.idxmax())
    return {
        "exists": judged.truth.tier != Tier.NONE,
        "is_own_run": judged.truth.tier == Tier.OWN_RUN,
        "rtol": OWN_RTOL,
        "note": judged.truth.note,
        "least_known": least_known,
    }


def _misread(judged: Judgement) -> list[str]:
    """Return the columns that seem to have other units, signs or origins."""
    table = judged.tables["errors"]
    return list(table.loc[table["is_input"], "column"])


def _hints(judged: Judgement) -> list[dict[str, object]]:
    """Return the causes that explain errors, with their columns.

    If the cause is a unit that an option converts in all columns, `right` contains those columns which the option would
    make wrong.
    """
    table = judged.tables["errors"]
    base_units = table["unit"].replace(BASE_UNITS)
    is_right = (table["hint"] == "") & (table["error"] <= COARSE * table["size"])
    hints = []
    for cause, rows in table[table["hint"] != ""].groupby("hint", sort=False):
        right: list[str] = []
        if rows["has_unit_option"].all():
            is_converted = base_units.isin(base_units[rows.index])
            right = list(table.loc[is_right & is_converted, "column"])
        hints.append({"cause": cause, "columns": list(rows["column"]), "right": right})
    return hints


def _other_parameters(judged: Judgement) -> list[dict[str, object]]:
    """Return the hypothesis about a parameter of the scene that explains the errors, if exactly one does."""
    table = judged.tables["other-parameters"]
    return [
        {
            "cause": Hypothesis(table.at[label, "hypothesis"]).name.lower(),
            "run": row_of("other-parameters", table, label),
        }
        for label in table.index[table["named"].astype(bool)]
    ]


def _coarse(judged: Judgement) -> list[dict[str, object]]:
    """Return the accelerations and forces with a mean error above `COARSE` of their size, the worst of each unit.

    Efforts are left out, because the text mentions each of them.
    """
    table = judged.tables["errors"]
    is_compared = (
        table["unit"].isin(JUMPING)
        & ~table["column"].isin(_effort_columns(judged))
        & (table["size"] > 0.0)
    )
    relative_errors = ((table["error"] - table["uncertainty"]) / table["size"])[is_compared]
    coarse = table.loc[relative_errors.index[relative_errors > COARSE]]
    entries: list[dict[str, object]] = []
    for _, rows in coarse.groupby("unit", sort=False):
        worst = relative_errors[rows.index].idxmax()
        entries.append(
            {
                "row": row_of("errors", table, worst),
                "part": float(relative_errors[worst]),
                "others": list(rows["column"].drop(worst)),
            }
        )
    return entries


def _effort_columns(judged: Judgement) -> list[str]:
    """Return the names of the columns of efforts, one per drive of the scene."""
    return [f"{drive}.effort" for drive in judged.scene.drives]


def _efforts(judged: Judgement) -> list[Row]:
    """Return the rows with the errors of the efforts of drives: in N m of a motor, in N of an actuator."""
    table = judged.tables["errors"]
    is_known = table["column"].isin(_effort_columns(judged)) & table["error"].notna()
    return [row_of("errors", table, label) for label in table.index[is_known]]


def _stick_phases(judged: Judgement) -> dict[str, object]:
    """Return the numbers of stick phases by verdict, and the shortest one with too few samples."""
    table = judged.tables["stick-phases"]
    counts = table["verdict"].value_counts()
    unresolved = table[table["verdict"] == UNRESOLVED]
    shortest = None
    if len(unresolved):
        shortest = row_of("stick-phases", table, unresolved["duration"].idxmin())
    return {
        "true": int(counts.reindex([FOUND, MISSED, UNRESOLVED]).sum()),
        "found": int(counts.get(FOUND, 0)),
        "unresolved": len(unresolved),
        "shortest": shortest,
        "invented": int(counts.get(INVENTED, 0)),
    }


def _jumps(judged: Judgement) -> list[dict[str, object]]:
    """Return for each effort the numbers of its jumps, and the jump with the largest error in the table."""
    table = judged.tables["jumps"]
    efforts: list[dict[str, object]] = []
    for effort, rows in table.groupby("effort", sort=False):
        read = rows[rows["resolved"]]
        worst: Row | None = None
        if len(read):
            worst = row_of("jumps", table, read["jump_error"].abs().idxmax())
        is_too_close = ~rows["readable"] & ~rows["resolved"]
        efforts.append(
            {
                "effort": effort,
                "unit": unit_of(str(effort), judged.scene),
                "true": len(rows),
                "read": len(read),
                "worst": worst,
                "too_close": int(is_too_close.sum()),
            }
        )
    return efforts


def _not_judged(judged: Judgement) -> dict[str, object]:
    """Return which questions are not answered because columns are missing; of ``energy``, the missing columns."""
    scene, run = judged.scene, judged.trajectory
    has_slip = any(
        f"{joint}.{label}" in run
        for joint in scene.frictional_joints
        for label in ("slip_velocity", "mode")
    )
    has_effort = any(name in run for name in _effort_columns(judged))
    summary = judged.tables["summary"]
    is_balanced = "energy_error" in summary or "completed_energy_error" in summary
    missing = [name for name in needed_columns(scene) if name not in judged.table.columns]
    return {
        "stick_phases": bool(scene.frictional_joints) and not has_slip,
        "jumps": bool(scene.frictional_joints and scene.drives) and not has_effort,
        "drift": "drift.position" not in run,
        "energy": [] if is_balanced else missing,
    }


def _unknown(judged: Judgement) -> list[str]:
    """Return the columns that the truth does not have.

    Modes and residuals of the constraints are no such columns: stick phases and drift are judged instead.
    """
    if judged.truth.tier == Tier.NONE:
        return []
    scene = judged.scene
    modes = {f"{joint}.mode" for joint in {**scene.guides, **scene.bounded_elements}}
    judged_elsewhere = {*judged.tables["errors"]["column"], *modes, *RESIDUALS}
    return [name for name in judged.table.columns if name not in judged_elsewhere]


def _undetermined(judged: Judgement) -> list[str]:
    """Return the columns that the motion and Coulomb's law do not determine."""
    table = judged.tables["errors"]
    return list(table.loc[table["measure"] == UNDETERMINED, "column"])


def _tables(judged: Judgement) -> Iterator[TableView]:
    """Yield the tables of errors, stick phases and jumps that have rows."""
    errors = judged.tables["errors"]
    columns = (
        Column("column"),
        Column("error"),
        Column("unit"),
        Column("measure"),
        Column("error_time", form=".6g"),
        Column("size", form=".3g"),
        Column("tier"),
        Column("hint"),
    )
    views = (
        view("worst", judged.worst, columns, source="errors", in_report=False),
        view("errors", errors, columns),
        view(
            "stick-phases",
            judged.tables["stick-phases"],
            (
                Column("guide"),
                Column("begin", form=".6f"),
                Column("end", form=".6f"),
                Column("duration", form=".3g"),
                Column("samples"),
                Column("verdict"),
                Column("fastest_slip", form=".2g"),
            ),
        ),
        view(
            "jumps",
            judged.tables["jumps"],
            (
                Column("effort"),
                Column("event_time", form=".6f"),
                Column("kind"),
                Column("true_jump", form=".4g"),
                Column("jump", form=".4g"),
                Column("jump_error"),
                Column("time_error", form=".2g"),
                Column("resolved", "read"),
                Column("readable"),
            ),
        ),
    )
    yield from (table for table in views if len(table.frame))


def _figures(judged: Judgement) -> Iterator[Chart]:
    """Yield the figure of a judgement, unless there is no truth or no column to draw."""
    if judged.truth.tier == Tier.NONE:
        return
    phases = judged.tables["stick-phases"]
    true_phases = phases[phases["verdict"] != INVENTED]
    shades = list(zip(true_phases["begin"], true_phases["end"]))
    panels = [*_differences(judged), *_compared_columns(judged, shades)]
    if panels:
        yield Chart("judgement", panels, 1, share_x=True)


def _differences(judged: Judgement) -> Iterator[Panel]:
    """Yield a panel with the differences of positions from the truth, of those with the largest errors.

    The time is divided into at most `LINE_SAMPLES` parts, and each part is represented by its largest difference.
    """
    run = judged.trajectory
    true = judged.truth(run.t)
    errors = judged.tables["errors"]
    positions = errors[errors["unit"] == "m"].nlargest(MAX_POSITIONS, "error")["column"]
    series = []
    for name in positions:
        differences = pd.Series(np.abs(run[name] - true[name]))
        part_of_row = np.arange(len(differences)) * LINE_SAMPLES // len(differences)
        largest = differences.groupby(part_of_row).idxmax().to_numpy()
        # A logarithmic axis has no zero.
        largest = largest[differences[largest] > 0]
        series.append(Series(name, run.t[largest], differences[largest].to_numpy(), look=name))
    if any(len(line.x) for line in series):
        yield Panel("positions", Axis("time [s]"), Axis("difference [m]", log=True), series)


def _compared_columns(judged: Judgement, shades: Sequence[tuple[float, float]]) -> Iterator[Panel]:
    """Yield a panel for each slip velocity and effort: some rows of the table as points, the truth as a line."""
    run = judged.trajectory
    true = judged.truth(run.t)
    t = np.linspace(run.t[0], run.t[-1], LINE_SAMPLES)
    stride = -(-len(run.t) // TABLE_POINTS)
    labels = {}
    for joint in judged.scene.frictional_joints:
        slip = f"{joint}.slip_velocity"
        labels[slip] = f"slip velocity [{unit_of(slip, judged.scene)}]"
    for effort in _effort_columns(judged):
        labels[effort] = f"effort [{unit_of(effort, judged.scene)}]"
    for name, label in labels.items():
        if name not in true or name not in run:
            continue
        times, values = truth_over_time(judged.truth, name, t)
        points = Series(
            "table",
            run.t[::stride],
            run[name][::stride],
            look="table",
            line=False,
            points=True,
            hollow=True,
        )
        series = [Series("truth", times, values, look=TRUTH), points]
        yield Panel(name, Axis("time [s]"), Axis(label), series, shades=shades)
