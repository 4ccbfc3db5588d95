"""A judgement in words, tables and figures, for the renderers of the studies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation import (
    TRUTH,
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    TableView,
    TracedText,
    count,
    scaled_value,
    sentence,
    traced,
    value,
    view,
)
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, truth_over_time
from stiction.comparisons.measures.other_parameters import Hypothesis
from stiction.comparisons.measures.result_errors import COARSE, UNDETERMINED
from stiction.comparisons.measures.scene_truth import OWN_RTOL
from stiction.reference_impl.energies import needed_columns
from stiction.scenes.wording import names
from stiction.truths import NO_TRUTH
from stiction.truths.truth import OWN_RUN

if TYPE_CHECKING:
    from stiction.comparisons.judge.judgement import Judgement

DRAWN, POINTS, LINES = 2000, 100, 6
"""Samples of a line in the figure, points of the table, and positions, those with the largest errors; at most."""
FOUND, MISSED, UNRESOLVED, INVENTED = (
    "found",
    "missed",
    "too short for the samples",
    "the truth slips",
)
"""Verdicts on a stick phase."""
NOTES = (
    "Errors are taken at the table's own instants: nothing between its rows is charged to it. A column that jumps "
    "(accelerations, forces, efforts) has the mean of |error| over time; a jump within a row's distance is part "
    "of its uncertainty. Angles are compared up to whole turns.",
    "size: the largest value of the true column. tier: what the truth of the column rests on.",
    "A true stick phase is found where all samples in it, but the first and the last, are at rest: slower than a "
    "thousandth of the largest slip speed, or of mode 0.",
)
PART = (
    "The table goes from {} s to {} s, the scene from 0 to {} s.",
    "table_begin",
    "table_end",
    "t_end",
)
SUMMED = (
    ("Largest velocity error: {} m/s.", "velocity_error"),
    ("Efforts of drives are off by {} N m or N in the mean.", TORQUE_ERROR),
    (
        "Of its {} instants with two sides {} are true events.",
        "two_sided_instants",
        "events_matched",
    ),
    ("True events that it does not have: {}.", "events_missed"),
    ("Times of events are off by at most {} s.", "event_time_error"),
)
BALANCED = (
    ("Constraints are violated by at most {} m; the drift is: {}.", "position_drift", "growth"),
    (
        "Energy: {} J of the {} J exchanged are not accounted for.",
        "energy_error",
        "energy_exchanged",
    ),
    (
        "Energy of the motion, with forces that follow from it and friction by Coulomb's law: {} J of "
        "the {} J of kinetic energy exchanged are not accounted for.",
        "completed_energy_error",
        "completed_energy_exchanged",
    ),
)
"""Sentences, and the columns of the summary whose cells are in them."""


def presentation(judged: Judgement) -> Presentation:
    """Say what a table of results is worth: errors, stick phases, jumps, drift, energy, and what samples can show."""
    findings = [
        *_truth(judged),
        *_reading(judged),
        *_other_parameters(judged),
        *_summed(judged, SUMMED),
        *_accelerations(judged),
        *_stick_phases(judged),
        *_jumps(judged),
        *_summed(judged, BALANCED),
        *_not_judged(judged),
    ]
    return Presentation(
        _answer(judged),
        tuple(filter(None, findings)),
        (),
        tuple(_tables(judged)),
        tuple(_figures(judged)),
        NOTES,
    )


def _answer(judged: Judgement) -> TracedText:
    table = judged.tables["errors"]
    if table.empty:
        which = (
            f"There is no truth of {judged.scene.name}: its columns"
            if judged.truth.tier == NO_TRUTH
            else "The truth has none of the table's columns: they"
        )
        return TracedText(f"{which} are held against each other alone.")
    sizes = judged.in_metres("error")
    known = sizes.notna().any()
    worst = (sizes if known else table["error"] / table["size"]).idxmax()
    row, misread = table.loc[worst], list(table.loc[table["is_input"], "column"])
    return traced(
        "Largest {}error: {} {}, {}{}; truth: {}.{}",
        "position " if known else "",
        value("errors", table, worst, "error"),
        row["unit"],
        row["column"],
        "" if pd.isna(row["error_time"]) else f" at t = {row['error_time']:.6g} s",
        row["tier"],
        f" Other units, signs or origins: {', '.join(misread)}?" if misread else "",
    )


def _truth(judged: Judgement) -> Iterator[TracedText]:
    truth, table = judged.truth, judged.tables["errors"]
    own = (
        f"The truth is our own run at rtol {OWN_RTOL:g}, which is not independent"
        if truth.tier == OWN_RUN
        else ""
    )
    if own or truth.note:
        yield TracedText(": ".join(filter(None, (own or "On the truth", truth.note))) + ".")
    if judged.uncertainty is not None:
        row = table[table["unit"].isin(["m", "rad"])]["uncertainty"].idxmax()
        yield traced(
            "The truth's positions are known to {} {} ({}).",
            value("errors", table, row, "uncertainty"),
            table.at[row, "unit"],
            table.at[row, "column"],
        )


def _reading(judged: Judgement) -> Iterator[TracedText]:
    """Causes that explain errors, columns that are right beside them, and the end of a table that stops early."""
    table = judged.tables["errors"]
    kinds = table["unit"].map(lambda unit: unit.partition("/")[0])
    right = (table["hint"] == "") & (table["error"] <= COARSE * table["size"])
    for cause, columns in judged.hints.items():
        others = table.loc[right & kinds.isin(kinds[table["column"].isin(columns)]), "column"]
        kept = (
            f" {', '.join(others)}: right as they are; convert the others alone."
            if len(others) and "--units" in cause
            else ""
        )  # which would change the units of these too
        yield TracedText(f"{', '.join(columns)}: {cause}" + "." * (not cause.endswith("?")) + kept)
    if not judged.is_complete:
        yield from _summed(judged, [PART])


def _other_parameters(judged: Judgement) -> Iterator[TracedText]:
    """The parameter with which the scene's motion is that of the table, where one alone explains the errors."""
    name, table = "other-parameters", judged.tables["other-parameters"]
    for row in table.index[table["named"].astype(bool)]:
        cause = Hypothesis(table.at[row, "hypothesis"])
        known = not pd.isna(table.at[row, "value"])
        size = value(name, table, row, "value" if known else "factor", form=".6g")
        what, question = {
            Hypothesis.ONE_COEFFICIENT: ("mus = mu", "is the static coefficient used?"),
            Hypothesis.KINETIC: ("mu", "is another kinetic coefficient used?"),
            Hypothesis.FRICTION: (
                "mu (and mus in proportion)",
                "are other coefficients of friction used?",
            ),
            Hypothesis.GRAVITY: ("g", "is another g used?"),
        }[cause]
        numbers: list[Any] = [what] if cause is Hypothesis.ONE_COEFFICIENT else [what, size]
        found = "{}" if len(numbers) == 1 else "{} times {}" if not known else "{} = {}"
        found += " m/s²" * (cause is Hypothesis.GRAVITY)
        yield traced(
            "The table agrees with "
            + found
            + ": errors are {} of the motion's size then, and {} as the "
            "scene is; {}",
            *numbers,
            value(name, table, row, "error after", form=".2g"),
            value(name, table, row, "error before", form=".2g"),
            question,
        )


def _summed(judged: Judgement, sentences: Iterable[Sequence[str]]) -> Iterator[TracedText]:
    """Sentences whose cells the summary has."""
    table = judged.tables["summary"]
    known = set(table.columns[table.loc[0].notna()])
    for template, *columns in sentences:
        # those outside of a table that is not complete are among the missed ones
        if known.issuperset(columns) and (judged.is_complete or columns != ["events_missed"]):
            yield traced(template, *(value("summary", table, 0, column) for column in columns))


def _accelerations(judged: Judgement) -> Iterator[TracedText]:
    """Accelerations and forces whose mean error is more than `COARSE` of their size, the worst of each unit."""
    table = judged.tables["errors"]
    jumps = table["unit"].isin(["m/s²", "rad/s²", "N", "N m"]) & ~table["column"].str.endswith(
        ".effort"
    )
    part = ((table["error"] - table["uncertainty"]) / table["size"])[jumps & (table["size"] > 0.0)]
    wrong = table.loc[part.index[part > COARSE]].assign(part=part)
    for unit, rows in wrong.groupby("unit", sort=False):
        worst = rows["part"].idxmax()
        others = [name for name in rows["column"] if name != rows.at[worst, "column"]]
        yield traced(
            "{} is off by {} {} in the mean, {} of its size{}.",
            rows.at[worst, "column"],
            value("errors", table, worst, "error"),
            str(unit),
            f"{part[worst]:.2g}",
            f"; also {names(others)}" if others else "",
        )


def _stick_phases(judged: Judgement) -> Iterator[TracedText]:
    table, name = judged.tables["stick-phases"], "stick-phases"
    if table.empty:
        return
    if (true := count(name, table, verdict=frozenset({FOUND, MISSED, UNRESOLVED}))).text != "0":
        yield traced("Stick phases: {} of {} found.", count(name, table, verdict=FOUND), true)
    short = table[table["verdict"] == UNRESOLVED]
    if len(short):
        yield traced(
            "Stick phases too short for the samples, which say nothing of the solver: {}; the shortest takes "
            "{} ms, samples are {} ms apart.",
            count(name, table, verdict=UNRESOLVED),
            scaled_value(name, table, short["duration"].idxmin(), "duration"),
            scaled_value("summary", judged.tables["summary"], 0, "sample_distance"),
        )
    if (table["verdict"] == INVENTED).any():
        yield traced("Rests where the truth slips: {}.", count(name, table, verdict=INVENTED))


def _jumps(judged: Judgement) -> Iterator[TracedText]:
    table = judged.tables["jumps"]
    for effort, rows in table.groupby("effort", sort=False):
        read = rows[rows["resolved"]]
        worst = (
            traced(
                ", at most {} N m off",
                value(
                    "jumps",
                    table,
                    read["jump_error"].abs().idxmax(),
                    "jump_error",
                    "",
                    "jump_uncertainty",
                ),
            )
            if len(read)
            else ""
        )
        yield traced(
            "Jumps of {}: {} of {} read{}.",
            str(effort),
            count("jumps", table, effort=effort, resolved=True),
            count("jumps", table, effort=effort),
            worst,
        )
        if not (rows["readable"] | rows["resolved"]).all():
            yield traced(
                "Jumps of it too close to another event for the samples: {}.",
                count("jumps", table, effort=effort, readable=False, resolved=False),
            )


def _not_judged(judged: Judgement) -> Iterator[TracedText]:
    """Faults that the gate finds, columns that are not looked at, questions that the table has no columns for."""
    faults = judged.tables["findings"]
    for row in faults.index:
        yield traced("Its columns do not fit: {}.", value("findings", faults, row, "finding"))
    scene, run, given = judged.scene, judged.trajectory, judged.table.columns
    slips = any(
        f"{guide}.{label}" in run
        for guide in scene.frictional_guides
        for label in ("slip_velocity", "mode")
    )
    efforts = any(f"{drive}.effort" in run for drive in scene.drives)
    wanting = {
        (
            "stick phases (displacement, slip velocity or mode of guides, "
            "or positions of all bodies)"
        ): scene.frictional_guides and not slips,
        "jumps (efforts of drives)": scene.frictional_guides and scene.drives and not efforts,
        "constraint drift (positions of all bodies)": "drift.position" not in run,
        f"energy ({names([name for name in needed_columns(scene) if name not in given])})": not {
            "energy_error",
            "completed_energy_error",
        }
        & {*judged.tables["summary"]},
    }
    known = set(judged.tables["errors"]["column"])
    unknown = [
        name
        for name in given
        if judged.truth.tier != NO_TRUTH
        and name not in known
        and not name.endswith(".mode")
        and not name.startswith("drift.")
    ]
    yield sentence(
        "Not judged, for want of columns: {}.",
        "; ".join(what for what, lacks in wanting.items() if lacks),
    )
    yield sentence("The truth does not have {}.", names(unknown))
    errors = judged.tables["errors"]
    yield sentence(
        "Not determined by the motion and Coulomb's law, and not judged: {}.",
        names(list(errors.loc[errors["measure"] == UNDETERMINED, "column"])),
    )
    yield sentence("Columns that are none of the scene's: {}.", names(judged.table.left_out))


def _tables(judged: Judgement) -> Iterator[TableView]:
    errors = judged.tables["errors"]
    columns = (
        Column("column"),
        Column("error", uncertainty="uncertainty"),
        Column("unit"),
        Column("measure"),
        Column("error_time", form=".6g"),
        Column("size", form=".3g"),
        Column("tier"),
        Column("hint"),
    )
    kinds = errors.dropna(subset="error").groupby("unit", sort=False)["error"].idxmax()
    views = (
        view(
            "worst",
            errors.loc[kinds],
            columns,
            source="errors",
            in_report=False,
            caption="Of each kind of column that with the largest error.",
        ),
        view(
            "errors",
            errors,
            columns,
            caption="Errors of all columns.",
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
            caption="Stick phases.",
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
                Column("jump_error", uncertainty="jump_uncertainty"),
                Column("time_error", form=".2g"),
                Column("resolved", "read"),
                Column("readable"),
            ),
            caption="Jumps of efforts at the events of the truth.",
        ),
    )
    yield from (one for one in views if len(one.frame))


def _figures(judged: Judgement) -> Iterator[Chart]:
    if judged.truth.tier == NO_TRUTH:
        return
    run, known, table = (
        judged.trajectory,
        judged.truth(judged.trajectory.t),
        judged.tables["errors"],
    )
    panels, differences = [], []
    for name in table[table["unit"] == "m"].nlargest(LINES, "error")["column"]:
        off = pd.Series(np.abs(run[name] - known[name]))
        top = off.groupby(np.arange(len(off)) * DRAWN // len(off)).idxmax().to_numpy()
        top = top[off[top] > 0]  # a logarithmic axis has no zero
        differences.append(Series(name, run.t[top], off[top].to_numpy(), look=name))
    if any(len(one.x) for one in differences):
        panels.append(
            Panel("positions", Axis("time [s]"), Axis("difference [m]", log=True), differences)
        )
    true = judged.tables["stick-phases"].query("verdict != @INVENTED")
    shades = list(zip(true["begin"], true["end"]))
    t, every = np.linspace(run.t[0], run.t[-1], DRAWN), slice(None, None, -(-len(run.t) // POINTS))
    drawn = [
        (f"{guide}.slip_velocity", "slip velocity [m/s]")
        for guide in judged.scene.frictional_guides
    ]
    for name, label in drawn + [
        (f"{drive}.effort", "effort [N m or N]") for drive in judged.scene.drives
    ]:
        if name in known and name in run:
            times, values = truth_over_time(judged.truth, name, t)
            panels.append(
                Panel(
                    name,
                    Axis("time [s]"),
                    Axis(label),
                    [
                        Series("truth", times, values, look=TRUTH),
                        Series(
                            "table",
                            run.t[every],
                            run[name][every],
                            look="table",
                            line=False,
                            points=True,
                            hollow=True,
                        ),
                    ],
                    shades=shades,
                )
            )
    if panels:
        yield Chart(
            "judgement",
            panels,
            1,
            share_x=True,
            caption="Difference of positions from the truth, and columns of the table with the truth; "
            "grey: true stick phases.",
        )
