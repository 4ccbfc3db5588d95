"""Accuracy of all methods: errors of their motions against the truth, and the events that they find."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    Method,
    drawn_runs,
    grouped_methods,
    groups,
    known_of,
    made_methods,
    methods,
    same_work,
    with_columns,
)
from stiction.comparisons.bench.participants import REFERENCE, variants
from stiction.comparisons.bench.presentation import (
    LIMIT,
    METHOD,
    REFINED_BY,
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
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, records_comparison, side_by_side
from stiction.comparisons.bench.study import NightlyNumbers, Scope, Study, Tables
from stiction.comparisons.bench.variants import (
    EVENTS_BY,
    FRICTION_BY,
    Record,
    coefficients_of,
    scaled,
)
from stiction.comparisons.measures.accuracy import (
    EVENT_WINDOW,
    KINDS,
    TORQUE_ERROR,
    errors,
    missed,
    size_of,
)
from stiction.comparisons.measures.scene_truth import truth_for
from stiction.engines.status import UNMADE, Status
from stiction.scenes import Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Tier, Truth
from stiction.truths.truth import SAMPLES

POSITION = "position_error"
"""Column: largest position error of a run, m."""
UNCERTAINTY = "position_uncertainty"
"""Column: uncertainty of the position error, m."""
FOUND = "events_matched"
"""Column: number of true events that a run finds."""
MISSED = "events_missed"
"""Column: number of true events that a run misses."""
SPURIOUS = "events_spurious"
"""Column: number of events of a run that match no true one."""
BY_KIND = "missed, by kind"
"""Column of tables in the report: the missed events, see `missed_by_kind`."""
EVENTS = "events"
"""Column of tables in the report: events found, missed and spurious."""
SUPPLIERS = "friction / events by"
"""Column of tables in the report: who supplies the friction law, and who locates events."""
PIECES = 120
"""Number of equal parts of the time, in each of which the largest difference from the truth is drawn.

A difference changes its sign all the time. All of its samples would fill the area below their maxima.
"""
SAME_INSTANT = 1e-9
"""Largest difference (s) between the times of two samples of one instant, by rounding."""
FAR_BELOW = 10.0
"""The truth's uncertainty is drawn unless all differences are more than this many times as large."""
MIN_ENGINES_RANKED = 2
"""Number of engines in a group from which one is called the most accurate; a single one is compared with none."""
ROW_HEIGHT = 1.8
"""Height of a row of panels, inches."""
MARGIN = 1.5
"""Factor between the extreme values and the ends of a logarithmic axis."""
FIRST_ORDER_ABOVE = 2.0
"""Factor by which the line of first order is above the highest point, so that it does not cover the points."""
CONSTANTS = {"event_window": EVENT_WINDOW, "pieces": PIECES}
"""Constants in the text of the study: a time in s, and a number."""


def compared_runs(scope: Scope) -> Comparison[tuple[Record, ...]]:
    """Plan the runs of all variants on all scenes, scene by scene.

    Several studies plan these runs; the runner executes them once.
    """
    chosen = variants(scope.engines, scope.depth)
    parts = [
        records_comparison([scene], scaled(chosen, scene, scope.t_end), scope.t_end)
        for scene in scope.scenes
    ]
    return side_by_side(parts, lambda records: tuple(chain.from_iterable(records)))


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the runs, each of which is compared with the truth for the friction law of its engine."""
    scenes = {scene.name: scene for scene in scope.scenes}

    def tables(records: tuple[Record, ...]) -> Tables:
        sizes = {name: size_of(scene) for name, scene in scenes.items()}
        truths = {
            record.key: truth_for(scenes[record.scene], [record], scope.t_end) for record in records
        }
        rows = [
            {
                **record.describe(),
                **coefficients_of(record.variant),
                **errors(record.trajectory, truths[record.key], sizes[record.scene]),
            }
            for record in records
        ]
        known = {truth.scene: truth for truth in truths.values() if truth.tier != Tier.NONE}
        return Tables({"accuracy": pd.DataFrame(rows)}, records, truths=known)

    return compared_runs(scope).then(tables)


def present(results: Results) -> Presentation:
    """Present the largest position error of each method over all cases, and the events that it finds."""
    table = with_columns(results.table("accuracy"), POSITION, UNCERTAINTY, FOUND, MISSED, SPURIOUS)
    by_variant = made_methods(table, methods(results), POSITION)
    if not by_variant:
        return Presentation()
    ranked = [method for method in by_variant.values() if method.is_ranked]
    scenes = _scenes_with_runs(table)
    rows = {
        "own": [
            {"variant": method.variant, "error": _worst_error(table, method)}
            for method in ranked
            if method.is_own
        ],
        "engines": list(_error_ranges(table, [method for method in ranked if not method.is_own])),
        "failed": [
            {"variant": method.variant, "failed": len(method.failed), "runs": len(method.rows)}
            for method in by_variant.values()
            if len(method.failed)
        ],
        "several_cases": table["scene"].nunique() > 1,
        "scenes": scenes,
        **CONSTANTS,
    }
    headline = Headline(
        "position error [m]",
        {variant: _headline_cell(table, method) for variant, method in by_variant.items()},
    )
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[
            _by_method(results, table, by_variant),
            *_most_accurate_engines(results, table, by_variant),
            *_by_scene(table, scenes),
        ],
        figures=[
            step_chart(
                "accuracy",
                table,
                list(by_variant),
                POSITION,
                quantity_of(POSITION).head,
                results.title_of,
            ),
            _difference_chart(results, table, "position", "m", (".x", ".y")),
            _difference_chart(results, table, "torque", "N m", (".effort",)),
        ],
    )


def _scenes_with_runs(table: pd.DataFrame) -> list[str]:
    """Return the scenes on which at least one run was made."""
    return list(table.loc[~table["status"].isin(UNMADE), "scene"].unique())


def _worst_error(table: pd.DataFrame, method: Method) -> object:
    """Return the largest position error of a method over all cases, as a cell."""
    return row_of("accuracy", table, method.worst_row)[POSITION]


def _by_error(table: pd.DataFrame, compared: Iterable[Method]) -> list[Method]:
    """Return methods in the order of their largest error over all cases, the most accurate first."""
    return sorted(compared, key=lambda method: table.at[method.worst_row, POSITION])


def _error_ranges(table: pd.DataFrame, engines: Sequence[Method]) -> Iterator[dict[str, object]]:
    """Yield for each fidelity the number of engines and the range of their largest errors over all cases."""
    for fidelity in Fidelity:
        ordered = _by_error(table, (method for method in engines if method.fidelity == fidelity))
        if ordered:
            yield {
                "fidelity": fidelity,
                "number": len(ordered),
                "smallest": _worst_error(table, ordered[0]),
                "largest": _worst_error(table, ordered[-1]),
            }


def _most_accurate_engines(
    results: Results, table: pd.DataFrame, by_variant: Mapping[str, Method]
) -> list[TableView]:
    """Return the table of the most accurate engine of each group of equal work.

    Groups of one engine have no row, because nothing is compared in them; without rows there is no table.
    Engines whose errors differ from that of the most accurate one by no more than the uncertainties share its place.
    """
    friction = known_of(table, FRICTION_BY)
    events = known_of(table, EVENTS_BY)
    rows = []
    for group, variants_of_group in grouped_methods(results, same_work):
        members = [by_variant[variant] for variant in variants_of_group if variant in by_variant]
        engines = _by_error(
            table, (method for method in members if method.is_ranked and not method.is_own)
        )
        if len(engines) < MIN_ENGINES_RANKED:
            continue
        best = engines[0]
        label = best.worst_row
        equals = [
            method.variant for method in engines if not differ(table, label, method.worst_row)
        ]
        row = {
            "group": group.label,
            "closest": "; ".join(equals),
            "of": len(engines),
            FRICTION_BY: friction[best.variant],
            EVENTS_BY: events[best.variant],
            **table.loc[label, [POSITION, UNCERTAINTY]],
            "in": results.title_of(table.at[label, "scene"]),
        }
        rows.append((row, table.loc[[label]]))
    if not rows:
        return []
    columns = (
        Column("closest", "most accurate"),
        Column("of", "engines compared"),
        Column(FRICTION_BY),
        Column(EVENTS_BY),
        Column(POSITION),
        Column("in", "largest error in"),
    )
    return [view("accuracy-closest", rows, columns, source="accuracy", group="group")]


def differ(table: pd.DataFrame, one: int, other: int) -> bool:
    """Return whether the position errors of two rows differ by more than the sum of their uncertainties."""
    uncertainty = table.loc[[one, other], UNCERTAINTY].sum()
    return bool(abs(table.at[one, POSITION] - table.at[other, POSITION]) > uncertainty)


def _headline_cell(table: pd.DataFrame, method: Method) -> str:
    """Return the largest error of a method and the number of its failed runs: ``0.002, 1 of 3 failed``."""
    parts = []
    if method.worst is not None:
        parts.append(str(_worst_error(table, method)))
    if len(method.failed):
        all_refused = (method.failed["status"] == Status.REFUSED).all()
        word = "declined" if all_refused else Status.FAILED
        parts.append(f"{len(method.failed)} of {len(method.rows)} {word}")
    return ", ".join(parts)


def _by_method(
    results: Results, table: pd.DataFrame, by_variant: Mapping[str, Method]
) -> TableView:
    """Return the table with a row per method and a column per case; events of all cases are added up."""
    friction = known_of(table, FRICTION_BY)
    events = known_of(table, EVENTS_BY)
    rows = []
    for group, variants_of_group in grouped_methods(results):
        for variant in variants_of_group:
            if variant not in by_variant:
                continue
            method = by_variant[variant]
            runs = method.rows
            row: dict[str, object] = {
                "group": group.label,
                "method": variant,
                SUPPLIERS: f"{friction[variant]} / {events[variant]}",
                "run": setting_of(runs["parameter"].iloc[0], runs["step"].iloc[0]),
            }
            for run in runs.drop(index=method.failed.index).to_dict("records"):
                for column in (POSITION, UNCERTAINTY):
                    row[in_scene(column, run["scene"])] = run[column]
            if runs[FOUND].notna().any():
                row[EVENTS] = _event_counts(runs, results.truths)
                row[BY_KIND] = missed_by_kind(runs)
            row["failed"] = "; ".join(
                f"{results.title_of(run['scene'])}: {run['reason'] or run['status']}"
                for run in method.failed.to_dict("records")
            )
            rows.append((row, runs))
    cases = [
        Column(
            in_scene(POSITION, scene),
            results.title_of(scene),
            uncertainty=in_scene(UNCERTAINTY, scene),
            of=POSITION,
        )
        for scene in dict.fromkeys(table["scene"])
    ]
    columns = (
        Column("method"),
        Column(SUPPLIERS),
        Column("run", brief=False),
        *cases,
        Column(EVENTS),
        Column(BY_KIND, brief=False),
        Column("failed"),
    )
    return view("accuracy", rows, columns, source="accuracy", group="group")


def in_scene(column: str, scene: str) -> str:
    """Return the name of the column of a pivoted table that contains the values in one scene."""
    return f"{column} in {scene}"


def _event_counts(runs: pd.DataFrame, truths: Mapping[str, Truth]) -> str:
    """Return the numbers of events found, missed and spurious in some runs together: ``51/0/0``.

    A method that misses all corner events does not report events of this kind. They are then not counted as missed,
    but mentioned: ``51/0/0; no corner``.
    """
    true_corners = sum(
        event.kind == "corner"
        for name in runs["truth"]
        if name in truths
        for event in truths[name].events
    )
    missed_corners = int(runs[missed("corner")].sum()) if missed("corner") in runs else 0
    reports_no_corners = missed_corners > 0 and missed_corners == true_corners
    missed_events = runs[MISSED].sum()
    if reports_no_corners:
        missed_events -= missed_corners
    counts = f"{runs[FOUND].sum():.0f}/{missed_events:.0f}/{runs[SPURIOUS].sum():.0f}"
    return f"{counts}; no corner" if reports_no_corners else counts


def missed_by_kind(rows: pd.DataFrame) -> str:
    """Return the numbers of missed events of each kind in some runs together: ``86 corner``."""
    counts = {kind: int(rows[missed(kind)].sum()) for kind in KINDS if missed(kind) in rows}
    return ", ".join(f"{number} {kind}" for kind, number in counts.items() if number) or "none"


def _by_scene(table: pd.DataFrame, scenes: Sequence[str]) -> Iterator[TableView]:
    """Yield for each scene the table of all its runs."""
    missed_kinds = [
        missed_by_kind(table.loc[[label]]) if pd.notna(matched) else ""
        for label, matched in table[FOUND].items()
    ]
    runs = table.assign(**{BY_KIND: missed_kinds})
    runs = runs[~runs["status"].isin(UNMADE)]
    columns = (
        METHOD,
        REFINED_BY,
        Column("step", form="g"),
        Column("status"),
        Column(POSITION, "position"),
        Column("velocity_error", "velocity"),
        Column(TORQUE_ERROR, "torque, mean"),
        Column("event_time_error", "event time"),
        Column(FOUND, "found", form=".0f"),
        Column(BY_KIND),
        Column(SPURIOUS, "spurious", form=".0f"),
        Column("reason"),
    )
    for scene in scenes:
        rows = runs[runs["scene"] == scene]
        yield view(f"accuracy-{scene}", rows, columns, source="accuracy", in_report=False)


def chart_by_case(
    name: str,
    table: pd.DataFrame,
    x: Axis,
    label: str,
    series: Callable[[pd.DataFrame], list[Series]],
    title_of: Callable[[str], str],
) -> Chart:
    """Return a chart with a row of panels per group of methods that may be compared, and a column per case.

    A row of panels has one logarithmic y axis, whose label stands at the first panel.

    Parameters
    ----------
    table : DataFrame
        Rows of all groups and cases.
    x : Axis
        The x axis of all panels.
    label : str
        Label of the y axes.
    series : callable
        Returns the series of a panel, from the rows of its group and case.
    title_of : callable
        Returns the title of a scene from its name.
    """
    scenes = list(dict.fromkeys(table["scene"]))
    panels = list[Panel]()
    for group, rows in groups(table) if scenes else ():
        # no line of a title may end within "mus > mu"
        unbroken = group.label.replace(" > ", "\N{NO-BREAK SPACE}>\N{NO-BREAK SPACE}")
        lines = {scene: series(rows[rows["scene"] == scene]) for scene in scenes}
        values = np.concatenate(
            [np.empty(0), *(line.y for lines_of_panel in lines.values() for line in lines_of_panel)]
        )
        if not any(lines.values()):
            # All runs of these methods failed or were refused; empty axes would say nothing.
            continue
        limits = (values.min() / MARGIN, values.max() * MARGIN) if len(values) else None
        for scene in scenes:
            y = Axis(label if scene == scenes[0] else "", log=True, limits=limits)
            panels.append(Panel(f"{title_of(scene)}; {unbroken}", x, y, lines[scene]))
    return Chart(name, panels, max(1, len(scenes)), ROW_HEIGHT, share_x=True)


def step_chart(
    name: str,
    table: pd.DataFrame,
    chosen: Sequence[str],
    column: str,
    label: str,
    title_of: Callable[[str], str],
) -> Chart:
    """Return a chart of a column of a table over the step, for the variants `chosen`.

    Runs that are controlled by a tolerance have no step and are left out.
    """
    rows = table[table["variant"].isin(chosen) & (table["parameter"] == "dt")]
    rows = rows[rows[column] > 0] if column in rows else rows.iloc[:0]

    def series(rows_of_panel: pd.DataFrame) -> list[Series]:
        ordered = rows_of_panel.sort_values("step")
        lines = [
            Series(
                variant,
                runs["step"].to_numpy(float),
                runs[column].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, runs in ordered.groupby("variant", sort=False)
        ]
        if not lines:
            return []
        steps = ordered["step"].agg(["min", "max"]).to_numpy(float)
        slope = FIRST_ORDER_ABOVE * (ordered[column] / ordered["step"]).max()
        return [*lines, Series("first order", steps, slope * steps, look=LIMIT)]

    x = Axis("step [s]", log=True, ticks=sorted(set(rows["step"])))
    return chart_by_case(name, rows, x, label, series, title_of)


def _difference_chart(
    results: Results, table: pd.DataFrame, quantity: str, unit: str, endings: tuple[str, ...]
) -> Chart:
    """Return a chart of the difference from the truth over time, in the columns with some endings."""
    drawn = drawn_runs(results)
    truths = {key: results.truths.get(name) for key, name in zip(table["key"], table["truth"])}

    def series(rows: pd.DataFrame) -> list[Series]:
        keys = set(rows["key"])
        return _difference_series([run for run in drawn if run.key in keys], truths, endings)

    label = f"{quantity} difference [{unit}]"
    name = f"difference-{quantity}"
    return chart_by_case(name, table, Axis("time [s]"), label, series, results.title_of)


def _difference_series(
    records: Sequence[Record], truths: Mapping[str, Truth | None], endings: tuple[str, ...]
) -> list[Series]:
    """Return a line per run, and one for the truth's uncertainty unless it is far below all of them."""
    lines = []
    smallest_difference = np.inf
    uncertainty = 0.0
    t_end = 0.0
    for record in records:
        truth = truths[record.key]
        if truth is None or record.trajectory is None:
            continue
        t, sizes = largest_differences(record.trajectory, truth, endings)
        if len(t) == 0:
            continue
        lines.append(Series(record.variant.label, t, sizes, look=record.variant.label))
        smallest_difference = min(smallest_difference, sizes.min())
        for name, uncertainty_of_column in truth.uncertainty.items():
            if name.endswith(endings):
                uncertainty = max(uncertainty, uncertainty_of_column)
        t_end = truth.t_end
    if uncertainty > smallest_difference / FAR_BELOW:
        lines.append(
            Series(
                "uncertainty of the truth",
                np.array([0.0, t_end]),
                np.array([uncertainty, uncertainty]),
                look=LIMIT,
            )
        )
    return lines


def largest_differences(
    trajectory: Trajectory, truth: Truth, endings: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) and sizes of the largest difference from the truth in each of `PIECES` parts of the time.

    Only samples at the instants of a stored truth are compared, so that a stored run and the run itself give the same
    figure. Columns in which run or truth have a value that is nan, as where guides at rest leave a force open, are
    left out, and so are parts of the time without a difference.

    Parameters
    ----------
    endings : tuple of str
        The columns with these endings are compared.
    """
    # Samples of the run at instants of a stored truth.
    stored_t = np.linspace(0.0, truth.t_end, SAMPLES)
    nearest = np.minimum(np.searchsorted(stored_t, trajectory.t - SAME_INSTANT), SAMPLES - 1)
    is_stored = np.abs(stored_t[nearest] - trajectory.t) < SAME_INSTANT
    t = stored_t[nearest[is_stored]]

    # The largest difference over all columns at each instant.
    exact = truth(t) if len(t) else {}
    names = [name for name in exact if name.endswith(endings) and name in trajectory]
    sizes = [np.abs(trajectory[name][is_stored] - exact[name]) for name in names]
    sizes = [sizes_of_column for sizes_of_column in sizes if np.isfinite(sizes_of_column).all()]
    if not sizes:
        return np.empty(0), np.empty(0)
    largest = pd.Series(np.max(sizes, axis=0))

    # The largest of these in each part of the time; a logarithmic axis has no place for zeros.
    piece = pd.Series(np.minimum((t / truth.t_end * PIECES).astype(int), PIECES - 1))
    is_positive = largest > 0
    places = largest[is_positive].groupby(piece[is_positive]).idxmax().to_numpy()
    return t[places], largest[places].to_numpy()


def failures_of_reference(results: Results) -> Iterator[str]:
    """Yield a line for each run of the reference whose error exceeds the size of the mechanism."""
    not_expected = {
        record.key for record in results.records if results.is_papers_scheme_elsewhere(record)
    }
    for row in results.table("accuracy").itertuples():
        is_expected = row.engine == REFERENCE and row.key not in not_expected
        if is_expected and row.status == Status.WRONG:
            yield f"{row.key}: {row.status}: {row.reason}"


STUDY = Study(
    "accuracy",
    "Accuracy",
    "How far are the methods from the truth?",
    present,
    plan,
    seconds=0.26,
    on_page_one=False,
    takes=frozenset({"engines", "t_end", "scenes"}),
    tables={
        "accuracy": "Errors of every run against the truth",
    },
    failures_of_reference=failures_of_reference,
    nightly=NightlyNumbers(
        (
            "position_error",
            "velocity_error",
            "event_time_error",
            "events_matched",
            "events_missed",
            "events_spurious",
        )
    ),
)
