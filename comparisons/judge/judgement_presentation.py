"""What the text of a judgement mentions, its tables and its figure; the text is in reports/templates/judgement.md."""

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
from stiction.reference_impl.energies import needed_columns
from stiction.scenes.columns import unit_of
from stiction.truths import Tier

DRAWN, POINTS, LINES = 2000, 100, 6
"""Samples of a line in the figure, points of the table, and positions, those with the largest errors; at most."""
JUMPING = ("m/s²", "rad/s²", "N", "N m")
"""Units of accelerations and forces, which jump."""
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
"""Columns of the summary that the text mentions; a judgement without one of them has no value there."""


def presentation(judged: Judgement) -> Presentation:
    """What a table of results is worth: errors, stick phases, jumps, drift, energy, and what samples can show."""
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
    """The position that may be most off; of a table without positions, the largest part of a column's size.

    A position may be off by its error and the uncertainty of its truth.
    """
    table = judged.tables["errors"]
    sizes = judged.in_metres("error") + judged.in_metres("uncertainty")
    has_positions = bool(sizes.notna().any())
    parts = sizes if has_positions else table["error"] / table["size"].where(table["size"] > 0.0)
    if parts.isna().all():
        return {"worst": None, "worst_is_position": False, "worst_is_certain": False}
    label = parts.idxmax()
    return {
        "worst": row_of("errors", table, label),
        "worst_is_position": has_positions,
        # an error within the uncertainty of the truth has no instant that means anything
        "worst_is_certain": bool(table.at[label, "error"] > table.at[label, "uncertainty"]),
    }


def _truth(judged: Judgement) -> dict[str, object]:
    """What the truth rests on, and the position of it that is known least."""
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
    """Columns that seem to have other units, signs or origins."""
    table = judged.tables["errors"]
    return list(table.loc[table["is_input"], "column"])


def _hints(judged: Judgement) -> list[dict[str, object]]:
    """Causes that explain errors; `right` are columns that an option for the units of all would make wrong."""
    table = judged.tables["errors"]
    # velocities are converted with positions: m/s with m
    kinds = table["unit"].map(lambda unit: unit.partition("/")[0])
    is_right = (table["hint"] == "") & (table["error"] <= COARSE * table["size"])
    hints = []
    for cause, rows in table[table["hint"] != ""].groupby("hint", sort=False):
        right = table.loc[is_right & kinds.isin(kinds[rows.index]), "column"]
        hints.append(
            {
                "cause": cause,
                "columns": list(rows["column"]),
                "right": list(right) if rows["has_unit_option"].all() else [],
            }
        )
    return hints


def _other_parameters(judged: Judgement) -> list[dict[str, object]]:
    """The parameter with which the scene's motion is that of the table, where one alone explains the errors."""
    table = judged.tables["other-parameters"]
    return [
        {
            "cause": Hypothesis(table.at[label, "hypothesis"]).name.lower(),
            "run": row_of("other-parameters", table, label),
        }
        for label in table.index[table["named"].astype(bool)]
    ]


def _coarse(judged: Judgement) -> list[dict[str, object]]:
    """Accelerations and forces whose mean error is more than `COARSE` of their size, the worst of each unit."""
    table = judged.tables["errors"]
    jumps = table["unit"].isin(JUMPING) & ~table["column"].str.endswith(".effort")
    part = ((table["error"] - table["uncertainty"]) / table["size"])[jumps & (table["size"] > 0.0)]
    wrong = table.loc[part.index[part > COARSE]]
    found = []
    for _, rows in wrong.groupby("unit", sort=False):
        worst = part[rows.index].idxmax()
        found.append(
            {
                "row": row_of("errors", table, worst),
                "part": float(part[worst]),
                "others": list(rows["column"].drop(worst)),
            }
        )
    return found


def _efforts(judged: Judgement) -> list[Row]:
    """The errors of the efforts of drives: those of a motor are in N m, those of an actuator in N."""
    table = judged.tables["errors"]
    efforts = [f"{drive}.effort" for drive in judged.scene.drives]
    is_known = table["column"].isin(efforts) & table["error"].notna()
    return [row_of("errors", table, label) for label in table.index[is_known]]


def _stick_phases(judged: Judgement) -> dict[str, object]:
    """Numbers of phases by verdict, those of the truth together, and the shortest of those that are too short."""
    table = judged.tables["stick-phases"]
    numbers = table["verdict"].value_counts()
    short = table[table["verdict"] == UNRESOLVED]
    shortest = None
    if len(short):
        shortest = row_of("stick-phases", table, short["duration"].idxmin())
    return {
        "true": int(numbers.reindex([FOUND, MISSED, UNRESOLVED]).sum()),
        "found": int(numbers.get(FOUND, 0)),
        "unresolved": len(short),
        "shortest": shortest,
        "invented": int(numbers.get(INVENTED, 0)),
    }


def _jumps(judged: Judgement) -> list[dict[str, object]]:
    """Numbers of jumps of each effort, and the one that is most off, of those that the table shows."""
    table = judged.tables["jumps"]
    found = []
    for effort, rows in table.groupby("effort", sort=False):
        read = rows[rows["resolved"]]
        worst: Row | None = None
        if len(read):
            worst = row_of("jumps", table, read["jump_error"].abs().idxmax())
        found.append(
            {
                "effort": effort,
                "unit": unit_of(str(effort), judged.scene),
                "true": len(rows),
                "read": len(read),
                "worst": worst,
                "too_close": int((~rows["readable"] & ~rows["resolved"]).sum()),
            }
        )
    return found


def _not_judged(judged: Judgement) -> dict[str, object]:
    """True for each question that the table has no columns for; `energy` has the columns that are missing."""
    scene, run = judged.scene, judged.trajectory
    slips = any(
        f"{guide}.{label}" in run
        for guide in scene.frictional_joints
        for label in ("slip_velocity", "mode")
    )
    efforts = any(f"{drive}.effort" in run for drive in scene.drives)
    summary = judged.tables["summary"]
    is_balanced = "energy_error" in summary or "completed_energy_error" in summary
    missing = [name for name in needed_columns(scene) if name not in judged.table.columns]
    return {
        "stick_phases": bool(scene.frictional_joints) and not slips,
        "jumps": bool(scene.frictional_joints and scene.drives) and not efforts,
        "drift": "drift.position" not in run,
        "energy": [] if is_balanced else missing,
    }


def _unknown(judged: Judgement) -> list[str]:
    """Columns that the truth does not have."""
    if judged.truth.tier == Tier.NONE:
        return []
    known = set(judged.tables["errors"]["column"])
    return [
        name
        for name in judged.table.columns
        if name not in known and not name.endswith(".mode") and not name.startswith("drift.")
    ]


def _undetermined(judged: Judgement) -> list[str]:
    """Columns that the motion and Coulomb's law leave open."""
    table = judged.tables["errors"]
    return list(table.loc[table["measure"] == UNDETERMINED, "column"])


def _tables(judged: Judgement) -> Iterator[TableView]:
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
        view(
            "worst",
            judged.worst,
            columns,
            source="errors",
            in_report=False,
        ),
        view(
            "errors",
            errors,
            columns,
        ),
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
    yield from (one for one in views if len(one.frame))


def _figures(judged: Judgement) -> Iterator[Chart]:
    if judged.truth.tier == Tier.NONE:
        return
    true = judged.tables["stick-phases"].query("verdict != @INVENTED")
    shades = list(zip(true["begin"], true["end"]))
    panels = [*_differences(judged), *_both(judged, shades)]
    if panels:
        yield Chart("judgement", panels, 1, share_x=True)


def _differences(judged: Judgement) -> Iterator[Panel]:
    """The positions with the largest errors: the largest difference from the truth in each of `DRAWN` parts of time."""
    run, known = judged.trajectory, judged.truth(judged.trajectory.t)
    errors = judged.tables["errors"]
    series = []
    for name in errors[errors["unit"] == "m"].nlargest(LINES, "error")["column"]:
        off = pd.Series(np.abs(run[name] - known[name]))
        top = off.groupby(np.arange(len(off)) * DRAWN // len(off)).idxmax().to_numpy()
        top = top[off[top] > 0]  # a logarithmic axis has no zero
        series.append(Series(name, run.t[top], off[top].to_numpy(), look=name))
    if any(len(one.x) for one in series):
        yield Panel("positions", Axis("time [s]"), Axis("difference [m]", log=True), series)


def _both(judged: Judgement, shades: Sequence[tuple[float, float]]) -> Iterator[Panel]:
    """Slip velocities and efforts of the table, at some of its rows, and of the truth."""
    run, known = judged.trajectory, judged.truth(judged.trajectory.t)
    t = np.linspace(run.t[0], run.t[-1], DRAWN)
    some = slice(None, None, -(-len(run.t) // POINTS))
    slips = [f"{joint}.slip_velocity" for joint in judged.scene.frictional_joints]
    labels = {slip: f"slip velocity [{unit_of(slip, judged.scene)}]" for slip in slips}
    for drive in judged.scene.drives:
        effort = f"{drive}.effort"
        labels[effort] = f"effort [{unit_of(effort, judged.scene)}]"
    for name, label in labels.items():
        if name not in known or name not in run:
            continue
        times, values = truth_over_time(judged.truth, name, t)
        table = Series(
            "table",
            run.t[some],
            run[name][some],
            look="table",
            line=False,
            points=True,
            hollow=True,
        )
        series = [Series("truth", times, values, look=TRUTH), table]
        yield Panel(name, Axis("time [s]"), Axis(label), series, shades=shades)
