"""Presentation of the study `hold`: the rows that its text mentions, its tables and its figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import at_equal_step, with_columns
from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation import (
    CHOSEN,
    METHOD,
    OTHER,
    REFINED_BY,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import FRICTION_BY
from stiction.comparisons.measures.creep import LANDING, LET_GO
from stiction.comparisons.measures.drift import ROUNDING
from stiction.comparisons.measures.published_creep import CREEP as OURS
from stiction.comparisons.measures.published_creep import MATCHED, PUBLISHED
from stiction.comparisons.studies.hold_joints import (
    LIMIT_COLUMNS,
    joint_headline,
    joint_rows,
    joint_tables,
    published_rows,
    published_tables,
)
from stiction.comparisons.studies.hold_tables import (
    BOUND,
    BREAK_AWAY,
    BREAK_UNSURE,
    BROKEN,
    CREEP,
    FASTER,
    FOUND,
    HELD,
    HOLDS,
    LANDED,
    LETS_GO,
    LOAD,
    OBEYED,
    OF_STEP,
    OF_ZONE,
    OPEN,
    SLOWER,
    STILL,
    STOP_UNSURE,
    STOPPED,
    SURE,
    TEST,
    TIME,
    UNSURE,
    USUAL,
    certainly_moves,
    fastest_run,
)
from stiction.comparisons.studies.settings import DEFAULT, SETTING, SUBJECT
from stiction.engines.registry import own_methods
from stiction.scenes.fidelity import Fidelity

SLOWEST_DRAWN = 1e-13
"""Slower creep is drawn at the lower edge of a figure, m/s."""
FASTEST_DRAWN = 1e-2
"""Faster slip is drawn at the upper edge of a figure, m/s."""
LONGEST_DRAWN = 4.0
"""Slower settings are drawn at the right edge of a figure, as a ratio of engine times."""
SPEEDS = Axis("creep [m/s]", log=True, limits=(SLOWEST_DRAWN / 3, 3 * FASTEST_DRAWN))
CONSTANTS = {
    "usual": 100 * USUAL,
    "still": STILL,
    "sure": SURE,
    "landing": LANDING,
    "let_go_speed": LET_GO,
    "slowest_drawn": SLOWEST_DRAWN,
    "fastest_drawn": FASTEST_DRAWN,
    "longest_drawn": LONGEST_DRAWN,
}
"""What the text of the study mentions besides results."""

NO_VERDICTS: Mapping[str, object] = {
    "engines": {"holding": 0, "all": 0},
    "own": {"holding": 0, "all": 0},
    **dict.fromkeys(("creeping", "regularized", "let_go", "undecided", "failed"), ()),
}
"""Rows for the text without runs whose friction depends on normal forces."""

Rows = list[tuple[dict[str, Any], pd.DataFrame]]
"""Rows of a table, each with the runs that it summarizes."""


class LoadColumns(NamedTuple):
    """Keys of the columns with the creep under one load, and with its uncertainty."""

    creep: str
    uncertainty: str


def load_columns(load: float) -> LoadColumns:
    """Return the keys of the columns of a load, which is a fraction of the limit."""
    return LoadColumns(f"creep at {load:g}", f"uncertainty at {load:g}")


def present(results: Results) -> Presentation:
    """Return the methods that hold, the creep of the others, and the settings that reduce it."""
    table = results.table("hold")
    methods = results.table("hold-methods")
    settings = results.table("hold-settings")
    laws = results.table("hold-laws")
    published = results.table("hold-published")
    published_joint = results.table("hold-published-joints")
    joint_methods = results.table("hold-joint-methods")
    if methods.empty and joint_methods.empty:
        return Presentation()
    has_creep = not methods.empty and bool(methods[CREEP].notna().any())
    rows = {
        "measured": has_creep,
        **(NO_VERDICTS if methods.empty else _verdicts(table, methods)),
        **_settings(settings),
        **_laws(laws),
        **_published(published),
        **joint_rows(joint_methods),
        **published_rows(published_joint),
        **CONSTANTS,
    }
    joint_views = joint_tables(results.table("hold-joints"), joint_methods)
    joint_headlines = [] if joint_methods.empty else [joint_headline(joint_methods)]
    if not has_creep:
        return Presentation(rows=rows, headlines=joint_headlines, tables=joint_views)
    loads = sorted(table.loc[table[TEST] == HELD, LOAD].unique())
    by_load = _by_load(table, methods, loads)
    figures = [_over_load(by_load, loads)]
    if len(settings):
        figures.append(_over_cost(settings))
    tables = [
        _load_table(by_load, loads),
        _run_table(table),
        *_limit_tables(table, methods),
        *_settings_tables(settings),
        *_laws_tables(laws),
        _all_runs_table(table),
        *_published_tables(published),
        *joint_views,
        *published_tables(published_joint),
    ]
    headlines = [_headline(methods), *joint_headlines]
    return Presentation(rows=rows, headlines=headlines, tables=tables, figures=figures)


def _without_rounding(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table in which a creep of 0, which is below its rounding, has no uncertainty: it is written as 0."""
    return table.assign(**{UNSURE: table[UNSURE].where(table[CREEP] != 0)})


def _ranked(methods: pd.DataFrame) -> pd.DataFrame:
    """Return the methods that have a creep, the slowest first."""
    return methods[methods[CREEP].notna()].sort_values(CREEP, kind="stable")


def _headline(methods: pd.DataFrame) -> Headline:
    """Return the creep of each method, or that the slider breaks away."""
    ranked = _ranked(methods)
    shown = _without_rounding(methods)
    breaks_away = ranked[LETS_GO].eq(True)
    cells = {}
    for label in ranked.index:
        if breaks_away[label]:
            text = "breaks away"
        else:
            text = str(row_of("hold-methods", shown, label)[CREEP])
        cells[ranked.at[label, "variant"]] = text
    return Headline("creep at loads up to 90 % of static friction [m/s]", cells)


def _verdicts(table: pd.DataFrame, methods: pd.DataFrame) -> dict[str, object]:
    """Return the numbers of methods that hold, and those that creep, break away, are undecided, or failed."""
    ranked = _ranked(methods)
    shown = _without_rounding(methods)
    is_own = ranked["engine"].isin(own_methods())
    is_moving = certainly_moves(ranked)
    breaks_away = is_moving & ranked[LETS_GO].eq(True)
    creeping = [
        row_of("hold-methods", shown, label) for label in ranked.index[is_moving & ~breaks_away]
    ]
    breaking_away = [
        {
            "method": row_of("hold-methods", shown, label),
            "ramp": _worst_ramp(table, methods.at[label, "variant"]),
        }
        for label in ranked.index[breaks_away]
    ]
    return {
        "engines": _counts(ranked[~is_own]),
        "own": _counts(ranked[is_own]),
        "creeping": creeping,
        "regularized": [row for row in creeping if row[OF_ZONE] is not None],
        "let_go": breaking_away,
        "undecided": list(ranked.loc[ranked[HOLDS].isna(), "variant"]),
        "failed": [
            row_of("hold-methods", methods, label) for label in methods.index[methods["failed"] > 0]
        ],
    }


def _counts(methods: pd.DataFrame) -> dict[str, int]:
    """Return the number of methods that hold, and the number of all methods."""
    return {"holding": int(methods[HOLDS].eq(True).sum()), "all": len(methods)}


def _worst_ramp(table: pd.DataFrame, variant: str) -> Row | None:
    """Return the run of a method under a ramp that breaks away farthest from the limit; None if there is none."""
    with_all = with_columns(table, BREAK_AWAY, BREAK_UNSURE, BOUND)
    ramps = at_equal_step(with_all, variant).dropna(subset=[BREAK_AWAY])
    if ramps.empty:
        return None
    return row_of("hold", with_all, ramps[BREAK_AWAY].abs().idxmax())


def _settings(settings: pd.DataFrame) -> dict[str, object]:
    """Return the setting with the least creep of each engine whose default creeps, and the most helpful of these.

    The most helpful setting leaves the smallest fraction of the default's creep and, if several do, takes the least
    time.
    """
    if settings.empty:
        return {"best_settings": [], "most_helpful": None}
    shown = _without_rounding(settings)
    is_complete = settings["failed"].eq(0) & settings[CREEP].notna()
    # By the label of the best setting of an engine, that of its default.
    default_of: dict[int, int] = {}
    for _, rows in settings[is_complete].groupby(SUBJECT, sort=False):
        # Several settings often have the same creep, 0: the one that takes the least time is best.
        best = int(rows.sort_values([CREEP, TIME], kind="stable").index[0])
        default = rows[rows[SETTING] == DEFAULT]
        if (default[CREEP] > STILL).any() and rows.at[best, SETTING] != DEFAULT:
            default_of[best] = int(default.index[0])
    most_helpful = None
    if default_of:
        first = min(default_of, key=lambda label: tuple(settings.loc[label, [SLOWER, TIME]]))
        most_helpful = {
            "setting": row_of("hold-settings", shown, first),
            "default": row_of("hold-settings", shown, default_of[first]),
        }
    return {
        "best_settings": [row_of("hold-settings", shown, label) for label in default_of],
        "most_helpful": most_helpful,
    }


def _laws(laws: pd.DataFrame) -> dict[str, object]:
    """Return the verdict on the reference, and the rows of the laws of creep by verdict."""
    reference: dict[str, object] | None = None
    by_verdict: dict[str, list[Row]] = {OBEYED: [], BROKEN: [], OPEN: []}
    for label in laws.index:
        row = row_of("hold-laws", laws, label)
        if row[SUBJECT] != REFERENCE:
            by_verdict[str(row["verdict"])].append(row)
        elif reference is None:
            reference = {
                "runs": row["runs"],
                "rests": row["verdict"] == OBEYED,
                "creeps": row["verdict"] == BROKEN,
            }
    return {"reference": reference, **by_verdict}


def _published(published: pd.DataFrame) -> dict[str, object]:
    """Return that computed creep which is farthest from its published value, or why none was computed.

    Values by which the model was chosen do not count.
    """
    if PUBLISHED not in published:
        reasons = list(published["reason"]) if len(published) else []
        return {"farthest": None, "published_failed": reasons}
    compared = published[published[PUBLISHED].notna() & ~published[MATCHED].astype(bool)]
    farthest = (compared[OURS] / compared[PUBLISHED] - 1).abs().idxmax()
    return {"farthest": row_of("hold-published", published, farthest), "published_failed": []}


def _published_tables(published: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of published and computed creep, if it was computed."""
    if PUBLISHED not in published:
        return
    columns = (
        Column("case"),
        Column(PUBLISHED, "creep, published", form="g"),
        Column(OURS, "creep, computed here", interval=True),
        Column("margin", "Coulomb limit / weight", form=".3g"),
        Column(MATCHED),
        Column("source", brief=False),
    )
    yield view("hold-published", published, columns)


def _by_load(table: pd.DataFrame, methods: pd.DataFrame, loads: Sequence[float]) -> Rows:
    """Return one row per method with its fastest creep under each load."""
    own = with_columns(table[table[SUBJECT].isna()], CREEP, UNSURE, LETS_GO)
    rows: Rows = []
    for _, method in methods.iterrows():
        runs = at_equal_step(own, method["variant"])
        held = _without_rounding(runs[runs[TEST].eq(HELD) & runs[CREEP].notna()])
        suppliers = runs[FRICTION_BY].dropna()
        row = {
            **method[["variant", "fidelity", "scene"]],
            HOLDS: OPEN if pd.isna(method[HOLDS]) else method[HOLDS],
            FRICTION_BY: "" if suppliers.empty else suppliers.iloc[0],
        }
        for load in loads:
            under_load = held[held[LOAD] == load]
            if under_load.empty:
                continue
            worst = under_load.loc[fastest_run(under_load)]
            columns = load_columns(load)
            row[columns.creep] = abs(worst[CREEP])
            row[columns.uncertainty] = worst[UNSURE]
        rows.append((row, held))
    return rows


def _load_table(by_load: Rows, loads: Sequence[float]) -> TableView:
    """Return the table of the creep of each method under each load."""
    creep_columns = []
    for load in loads:
        columns = load_columns(load)
        creep_columns.append(
            Column(columns.creep, f"{100 * load:g} %", uncertainty=columns.uncertainty, of=CREEP)
        )
    return view(
        "hold",
        by_load,
        (
            METHOD,
            Column("fidelity"),
            Column(FRICTION_BY),
            *creep_columns,
            Column("scene", "fastest on", brief=False),
            Column(HOLDS),
        ),
    )


def _run_table(table: pd.DataFrame) -> TableView:
    """Return the table of the fastest creep of each method and step under the load `USUAL`."""
    runs = with_columns(table, CREEP, UNSURE, LETS_GO)
    is_shown = (
        runs[SUBJECT].isna() & runs[TEST].eq(HELD) & runs[LOAD].eq(USUAL) & runs[CREEP].notna()
    )
    runs = runs[is_shown]
    labels = [fastest_run(group) for _, group in runs.groupby(["variant", "step"], sort=False)]
    return view(
        "hold-steps",
        _without_rounding(runs.loc[labels]),
        (
            METHOD,
            REFINED_BY,
            Column("step", form="g"),
            Column(CREEP),
            Column(OF_STEP, "of g dt", form=".2g"),
            Column(OF_ZONE, "of the regularization", form=".2g"),
            Column("scene", "on"),
        ),
        source="hold",
        in_report=False,
    )


def _limit_tables(table: pd.DataFrame, methods: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of what happens beyond the limit, if there are such runs."""
    rows = _beyond_limit(table, methods)
    if not rows:
        return
    columns = (
        METHOD,
        Column("fidelity"),
        Column(LANDED, "initial displacement", form=".2g"),
        *LIMIT_COLUMNS,
        Column(STOPPED, "position at rest"),
    )
    yield view("hold-limit", rows, columns, source="hold")


def _beyond_limit(table: pd.DataFrame, methods: pd.DataFrame) -> Rows:
    """Return one row per method with its worst landing, break-away, acceleration and stop."""
    own = with_columns(
        table[table[SUBJECT].isna()],
        LANDED,
        BREAK_AWAY,
        BREAK_UNSURE,
        FASTER,
        STOPPED,
        STOP_UNSURE,
        BOUND,
    )
    # Displacements below their rounding are 0, without an uncertainty.
    is_rounding = own[[LANDED, STOPPED]].abs() < ROUNDING
    own = own.assign(
        **{
            LANDED: own[LANDED].mask(is_rounding[LANDED], 0.0),
            STOPPED: own[STOPPED].mask(is_rounding[STOPPED], 0.0),
            STOP_UNSURE: own[STOP_UNSURE].mask(is_rounding[STOPPED]),
        }
    )
    rows: Rows = []
    if own[BREAK_AWAY].isna().all():
        return rows
    # By the measure that decides which run is the worst, the columns that are taken from this run.
    columns_of_measure: Mapping[str, list[str]] = {
        LANDED: [LANDED],
        BREAK_AWAY: [BREAK_AWAY, BREAK_UNSURE, BOUND],
        FASTER: [FASTER],
        STOPPED: [STOPPED, STOP_UNSURE],
    }
    for _, method in methods.iterrows():
        runs = at_equal_step(own, method["variant"])
        row = dict(method[["variant", "fidelity"]])
        for measure, columns in columns_of_measure.items():
            if runs[measure].notna().any():
                row |= dict(runs.loc[runs[measure].abs().idxmax(), columns])
        rows.append((row, runs))
    return rows


def _settings_tables(settings: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of settings, if there are runs with other settings than the default."""
    if settings.empty:
        return
    columns = (
        Column(SUBJECT, "engine"),
        Column(SETTING),
        Column(CREEP),
        Column(SLOWER, "creep / default", form=".2g"),
        Column(TIME, form=".2g"),
        Column("failed"),
    )
    yield view("hold-settings", _without_rounding(settings), columns)


def _laws_tables(laws: pd.DataFrame) -> Iterator[TableView]:
    """Yield the table of laws, if there is a law of an engine besides that of the reference."""
    if laws.empty or laws[SUBJECT].eq(REFERENCE).all():
        return
    columns = (
        Column(SUBJECT, "engine"),
        Column("over"),
        Column("kind"),
        Column("law", form="g"),
        Column(FOUND, interval=True),
        Column("runs"),
        Column("verdict"),
        Column("source", brief=False),
    )
    yield view("hold-laws", laws, columns)


def _all_runs_table(table: pd.DataFrame) -> TableView:
    """Return the table of all runs, without what reproduces them."""
    columns = [Column(name) for name in table if name not in ("settings", "version", AGAIN)]
    return view("hold-all", table, columns, source="hold", in_report=False)


def _over_load(by_load: Rows, loads: Sequence[float]) -> Chart:
    """Return the figure of creep over load: one panel per fidelity, one line per method that creeps."""
    panels = []
    for fidelity in Fidelity:
        series = []
        for row, _ in by_load:
            measured_loads = [load for load in loads if load_columns(load).creep in row]
            creep = np.array(
                [row[load_columns(load).creep] for load in measured_loads], dtype=float
            )
            if row["fidelity"] != fidelity or not creep.any():
                continue
            series.append(
                Series(
                    row["variant"],
                    100 * np.array(measured_loads),
                    np.clip(creep, SLOWEST_DRAWN, FASTEST_DRAWN),
                    look=row["variant"],
                    points=True,
                )
            )
        if series:
            title = f"{fidelity.label} fidelity"
            panels.append(Panel(title, Axis("load [% of the limit]"), SPEEDS, series))
    return Chart("hold", panels, columns=2, height=2.8, share_y=True)


def _over_cost(settings: pd.DataFrame) -> Chart:
    """Return the figure of creep over engine time: one panel per engine, one point per setting."""
    panels = []
    for subject, rows in settings[settings[CREEP].notna()].groupby(SUBJECT, sort=False):
        is_default = rows[SETTING] == DEFAULT
        series = [
            *_setting_points("another choice", rows[~is_default], OTHER),
            *_setting_points(DEFAULT, rows[is_default], CHOSEN),
        ]
        times = Axis("engine time / default", limits=(0.0, 1.05 * LONGEST_DRAWN))
        panels.append(Panel(str(subject), times, SPEEDS, series))
    return Chart("hold-settings", panels, columns=2, height=1.5, share_x=True, share_y=True)


def _setting_points(label: str, rows: pd.DataFrame, look: str) -> Iterator[Series]:
    """Yield a series with one point per row; none without rows."""
    if rows.empty:
        return
    times = rows[TIME].clip(upper=LONGEST_DRAWN).to_numpy(float)
    creep = rows[CREEP].clip(SLOWEST_DRAWN, FASTEST_DRAWN).to_numpy(float)
    yield Series(label, times, creep, look=look, line=False, points=True)
