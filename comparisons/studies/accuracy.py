"""Accuracy: how far the motion of each method is from the truth, and which of its events a method finds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    Method,
    called,
    case_of,
    drawn_runs,
    grouped_methods,
    groups,
    known_of,
    made_methods,
    methods,
    same_work,
    title_of,
    with_columns,
)
from stiction.comparisons.bench.participants import variants
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
    joined,
    length,
    listed,
    sentence,
    traced,
    value,
    view,
)
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, records_comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import (
    EVENTS_BY,
    FRICTION_BY,
    UNMADE,
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
from stiction.engines.protocol import FIDELITIES
from stiction.scenes import Trajectory
from stiction.truths import NO_TRUTH, Truth
from stiction.truths.truth import SAMPLES

POSITION, UNCERTAINTY = "position_error", "position_uncertainty"
FOUND, MISSED, SPURIOUS = "events_matched", "events_missed", "events_spurious"
BY_KIND, EVENTS, SUPPLIERS = "missed, by kind", "events", "friction / events by"
PIECES = 120
"""Parts of the time: of a difference, which changes sign all the time, the largest in each is drawn."""
FAR_BELOW = 10.0
"""The truth's uncertainty is drawn unless the smallest difference is more than this many times as large."""
ROW_HEIGHT = 1.8
"""Inches of a row of panels."""
MARGIN = 1.5
"""Factor between the largest value and the end of a logarithmic axis."""
NOTES = (
    "Position error: the largest over all bodies and output times. Page one has that of the worst case.",
    "joint: an ideal guide with a friction law. contact: the slider touches two surfaces with clearance.",
    "mus = mu: the engine has no static coefficient of its own. Its truth has the same physics.",
    "Methods may be compared within one fidelity and one physics. They are ranked where the same supply the "
    "friction law and locate events.",
    f"An event counts as found within {1e3 * EVENT_WINDOW:g} ms of a true one of its kind.",
    "A run counts as failed if it broke off, ended early, or is off by more than the mechanism's size.",
)


def compared_runs(scope: Scope) -> Comparison[tuple[Record, ...]]:
    """The runs of all variants on all scenes, scene by scene; those that other studies make as well are made once."""
    chosen = variants(scope.engines, scope.depth)
    parts = [
        records_comparison([scene], scaled(chosen, scene, scope.t_end), scope.t_end)
        for scene in scope.scenes
    ]
    return side_by_side(parts, lambda found: tuple(chain.from_iterable(found)))


def plan(scope: Scope) -> Comparison[Tables]:
    """Every run against the truth of its physics."""
    scenes = {scene.name: scene for scene in scope.scenes}

    def tables(records: tuple[Record, ...]) -> Tables:
        sizes = {name: size_of(scene) for name, scene in scenes.items()}
        truths = {
            record.key: truth_for(scenes[record.scene], [record], scope.t_end) for record in records
        }
        table = pd.DataFrame(
            [
                {
                    **record.describe(),
                    **coefficients_of(record.variant),
                    **errors(record.trajectory, truths[record.key], sizes[record.scene]),
                }
                for record in records
            ]
        )
        known = {truth.scene: truth for truth in truths.values() if truth.tier != NO_TRUTH}
        return Tables({"accuracy": table}, records, truths=known)

    return compared_runs(scope).then(tables)


def present(results: Results) -> Presentation:
    """The largest position error of each method over all cases, and the closest of those that do the same work."""
    table = with_columns(results.table("accuracy"), POSITION, UNCERTAINTY, FOUND, MISSED, SPURIOUS)
    found = made_methods(table, methods(results), POSITION)
    if not found:
        return Presentation()
    where = " in all cases" if table["scene"].nunique() > 1 else ""
    ranked = [method for method in found.values() if method.is_ranked]
    answer = joined(
        _own(table, [method for method in ranked if method.is_own]),
        _engines(table, [method for method in ranked if not method.is_own]),
    )
    failed = [
        traced(
            "{} ({} of {})",
            called(method.variant),
            _count(table, method.failed),
            _count(table, method.rows),
        )
        for method in found.values()
        if len(method.failed)
    ]
    over_step = step_chart(
        "accuracy",
        "Largest position error over the step. A row of panels holds methods that may "
        "be compared; dotted: the slope of first order. The table also has runs by "
        "tolerance.",
        table,
        list(found),
        POSITION,
        "position_error",
    )
    return Presentation(
        answer or TracedText(f"No method succeeded{where}."),
        [
            sentence(
                "Runs that failed or were declined, so that the method is not ranked: {}.",
                listed(failed),
            )
        ],
        [
            Headline(
                "position [m]", {variant: _cell(table, method) for variant, method in found.items()}
            )
        ],
        [_by_method(results, table, found), *_closest(results, table, found), *_by_scene(table)],
        [over_step, *_differences(results, table)],
        NOTES,
    )


def _reached(table: pd.DataFrame, method: Method) -> TracedText:
    return length("accuracy", table, method.worst_row, POSITION)


def _own(table: pd.DataFrame, own: Sequence[Method]) -> TracedText:
    """The methods of the reference, each in its worst case."""
    parts = [traced("{} {}", called(method.variant), _reached(table, method)) for method in own]
    if own:
        parts[0] = traced(
            "{} is within {} of the truth", called(own[0].variant), _reached(table, own[0])
        )
    said = sentence("{}.", listed(parts, ", ", ", "))
    return replace(said, text=said.text[:1].upper() + said.text[1:])


def _engines(table: pd.DataFrame, engines: Sequence[Method]) -> TracedText:
    """The smallest and the largest error of engines in their worst case, by fidelity; no ranking."""
    parts = []
    for fidelity in FIDELITIES:
        there = sorted(
            (method for method in engines if method.fidelity == fidelity),
            key=lambda method: table.at[method.worst, POSITION],
        )
        if there:
            low, high = _reached(table, there[0]), _reached(table, there[-1])
            if low.text.split()[1:] == high.text.split()[1:]:
                low = replace(low, text=low.text.split()[0])  # one unit for both
            parts.append(
                traced(
                    "{} with {}s",
                    high if len(there) == 1 else traced("{} to {}", low, high),
                    fidelity,
                )
            )
    return sentence("Engines: {}.", listed(parts, ", ", ", "))


def _closest(
    results: Results, table: pd.DataFrame, found: Mapping[str, Method]
) -> Iterator[TableView]:
    """The closest engine of each group of equal work, in its worst case, and those that cannot be ranked against it."""
    suppliers, rows = {column: known_of(table, column) for column in (FRICTION_BY, EVENTS_BY)}, []
    for group, variants_there in grouped_methods(results, same_work):
        others = [
            method
            for variant in variants_there
            if (method := found.get(variant)) and method.is_ranked and not method.is_own
        ]
        others.sort(key=lambda method: table.at[method.worst_row, POSITION])
        if not others:
            continue
        row = others[0].worst_row
        best = [method.variant for method in others if not differ(table, row, method.worst_row)]
        rows.append(
            (
                {
                    "group": group.label,
                    "closest": ", ".join(called(variant, False) for variant in best),
                    "of": len(others),
                    **{column: known[best[0]] for column, known in suppliers.items()},
                    **table.loc[row, [POSITION, UNCERTAINTY]],
                    "in": case_of(table.at[row, "scene"]),
                },
                table.loc[[row]],
            )
        )
    if rows:
        yield view(
            "accuracy-closest",
            rows,
            (
                Column("closest"),
                Column("of"),
                Column(FRICTION_BY),
                Column(EVENTS_BY),
                Column(POSITION, "position error"),
                Column("in"),
            ),
            source="accuracy",
            group="group",
            caption="The closest of the engines that may be ranked, as they do the same part of the "
            "work, each by its worst case; with it those that its error cannot be distinguished from.",
        )


def differ(table: pd.DataFrame, one: int, other: int) -> bool:
    """Test if the position errors of two rows differ by more than both their uncertainties."""
    unsure = table.loc[[one, other], UNCERTAINTY].sum()
    return bool(abs(table.at[one, POSITION] - table.at[other, POSITION]) > unsure)


def _count(table: pd.DataFrame, rows: pd.DataFrame) -> Number:
    return count("accuracy", table, key=frozenset(rows["key"]))


def _cell(table: pd.DataFrame, method: Method) -> TracedText:
    """The worst error of a method, and how many of its runs failed."""
    parts: list[TracedText | Number] = []
    if method.worst is not None:
        parts.append(value("accuracy", table, method.worst, POSITION))
    if len(method.failed):
        word = "declined" if (method.failed["status"] == "refused").all() else "failed"
        parts.append(
            traced("{} of {} {}", _count(table, method.failed), _count(table, method.rows), word)
        )
    return listed(parts, ", ", ", ")


def _by_method(results: Results, table: pd.DataFrame, found: Mapping[str, Method]) -> TableView:
    """A row per method, a column per case; events of all cases together."""
    friction, events = (known_of(table, column) for column in (FRICTION_BY, EVENTS_BY))
    rows = []
    for group, names in grouped_methods(results):
        for method in (found[name] for name in names if name in found):
            runs = method.rows
            row: dict[str, object] = {
                "group": group.label,
                "method": method.variant,
                SUPPLIERS: f"{friction[method.variant]} / {events[method.variant]}",
                "run": setting_of(runs["parameter"].iloc[0], runs["step"].iloc[0]),
            }
            for run in runs.drop(index=method.failed.index).to_dict("records"):
                row |= {
                    _of(column, run["scene"]): run[column] for column in (POSITION, UNCERTAINTY)
                }
            if runs[FOUND].notna().any():
                row[EVENTS] = _events(runs, results.truths)
                row[BY_KIND] = missed_by_kind(runs)
            row["failed"] = "; ".join(
                f"{case_of(run['scene'])}: {run['reason'] or run['status']}"
                for run in method.failed.to_dict("records")
            )
            rows.append((row, runs))
    cases = [
        Column(_of(POSITION, scene), case_of(scene), "m", _of(UNCERTAINTY, scene), of=POSITION)
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
    return view(
        "accuracy",
        rows,
        columns,
        source="accuracy",
        group="group",
        caption="Largest position error of each method at the step nearest to 1 ms or the tightest "
        "tolerance. Friction / events by: who supplies the friction law, and who locates events. "
        "Events: found/missed/spurious, of all cases, of the kinds that a method reports.",
    )


def _of(column: str, scene: str) -> str:
    return f"{column}, {case_of(scene)}"


def _events(runs: pd.DataFrame, truths: Mapping[str, Truth]) -> str:
    """``51/0/0; no corner``: found, missed and spurious events; without corner events where a method reports none."""
    true = Counter(
        event.kind for name in runs["truth"] if name in truths for event in truths[name].events
    )
    lost = {kind: int(runs[missed(kind)].sum()) for kind in KINDS if missed(kind) in runs}
    never = [
        kind
        for kind, number in lost.items()
        if kind == "corner" and number and number == true[kind]
    ]
    counts = (
        runs[FOUND].sum(),
        runs[MISSED].sum() - sum(lost[kind] for kind in never),
        runs[SPURIOUS].sum(),
    )
    return "; no ".join(["/".join(f"{number:.0f}" for number in counts), *never])


def missed_by_kind(rows: pd.DataFrame) -> str:
    """``86 corner``: the missed events of runs together."""
    sums = {kind: int(rows[missed(kind)].sum()) for kind in KINDS if missed(kind) in rows}
    return ", ".join(f"{number} {kind}" for kind, number in sums.items() if number) or "none"


def _by_scene(table: pd.DataFrame) -> Iterator[TableView]:
    shown = table.assign(
        **{
            BY_KIND: [
                missed_by_kind(table.loc[[label]]) if pd.notna(found) else ""
                for label, found in table[FOUND].items()
            ]
        }
    )
    columns = (
        Column("variant", "method"),
        Column("parameter", "refined by"),
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
    for scene, rows in shown[~shown["status"].isin(UNMADE)].groupby("scene", sort=False):
        caption = f"{title_of(scene)}: largest errors of every run, and events found, missed and spurious."
        yield view(
            f"accuracy-{scene}",
            rows,
            columns,
            source="accuracy",
            in_report=False,
            caption=caption,
        )


def chart_by_case(
    name: str,
    caption: str,
    table: pd.DataFrame,
    x: Axis,
    label: str,
    series: Callable[[pd.DataFrame], list[Series]],
) -> Chart:
    """A row of panels per group of methods that may be compared, a column per case, with the series of its rows.

    A row has one logarithmic y axis, with its label at the first panel.
    """
    scenes, panels = list(dict.fromkeys(table["scene"])), list[Panel]()
    for group, rows in groups(table) if scenes else ():
        row = {scene: series(rows[rows["scene"] == scene]) for scene in scenes}
        values = np.concatenate([np.empty(0), *(one.y for found in row.values() for one in found)])
        limits = (values.min() / MARGIN, values.max() * MARGIN) if len(values) else None
        panels += [
            Panel(
                f"{title_of(scene)}; {group.label}",
                x,
                Axis(label if scene == scenes[0] else "", log=True, limits=limits),
                found,
            )
            for scene, found in row.items()
        ]
    return Chart(
        name,
        panels,
        max(1, len(scenes)),
        ROW_HEIGHT,
        share_x=True,
        caption=caption,
    )


def step_chart(
    name: str, caption: str, table: pd.DataFrame, chosen: Sequence[str], column: str, label: str
) -> Chart:
    """A column of a table over the step; runs by tolerance have none and are left out."""
    rows = table[table["variant"].isin(chosen) & (table["parameter"] == "dt")]
    rows = rows[rows[column] > 0] if column in rows else rows.iloc[:0]

    def series(here: pd.DataFrame) -> list[Series]:
        here = here.sort_values("step")
        found = [
            Series(
                variant,
                part["step"].to_numpy(float),
                part[column].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, part in here.groupby("variant", sort=False)
        ]
        ends = here["step"].agg(["min", "max"]).to_numpy(float)
        slope = 2 * (here[column] / here["step"]).max()
        return [*found, Series("first order", ends, slope * ends, look=LIMIT)] if found else []

    return chart_by_case(
        name,
        caption,
        rows,
        Axis("step [s]", log=True, ticks=sorted(set(rows["step"]))),
        label,
        series,
    )


def _differences(results: Results, table: pd.DataFrame) -> Iterator[Chart]:
    """The difference from the truth over time: of positions, and of the driving torque."""
    chosen = drawn_runs(results)
    truths = {key: results.truths.get(name) for key, name in zip(table["key"], table["truth"])}
    for quantity, endings, unit, jump in (
        ("position", (".x", ".y"), "m", ""),
        (
            "torque",
            (".effort",),
            "N m",
            " A method that does not locate an event differs there by the jump.",
        ),
    ):

        def series(here: pd.DataFrame, endings: tuple[str, ...] = endings) -> list[Series]:
            keys = set(here["key"])
            return list(
                _difference_series([run for run in chosen if run.key in keys], truths, endings)
            )

        yield chart_by_case(
            f"difference-{quantity}",
            f"Difference of each method's {quantity} from the truth over time, at the step "
            f"nearest to 1 ms or the tightest tolerance; the largest in each of {PIECES} parts of the time."
            + jump,
            table,
            Axis("time [s]"),
            f"{quantity} difference [{unit}]",
            series,
        )


def _difference_series(
    records: Sequence[Record], truths: Mapping[str, Truth | None], endings: tuple[str, ...]
) -> Iterator[Series]:
    """A line per run; the truth's uncertainty where it is not far below."""
    lowest, unsure, t_end = np.inf, 0.0, 0.0
    for record in records:
        truth = truths[record.key]
        if truth is None or record.trajectory is None:
            continue
        t, size = largest_differences(record.trajectory, truth, endings)
        if len(t):
            yield Series(record.variant.label, t, size, look=record.variant.label)
            known = [number for name, number in truth.uncertainty.items() if name.endswith(endings)]
            lowest, unsure, t_end = min(lowest, size.min()), max([unsure, *known]), truth.t_end
    if unsure > lowest / FAR_BELOW:
        yield Series(
            "uncertainty of the truth",
            np.array([0.0, t_end]),
            np.array([unsure, unsure]),
            look=LIMIT,
        )


def largest_differences(
    trajectory: Trajectory, truth: Truth, endings: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and sizes of the largest difference in each of `PIECES` parts of the time.

    It is of the columns with these endings that no guide at rest leaves open. It is taken where the run has a sample
    at an instant of a stored truth: a stored run and the run itself give the same figure.
    """
    known = np.linspace(0.0, truth.t_end, SAMPLES)
    nearest = np.minimum(np.searchsorted(known, trajectory.t - 1e-9), SAMPLES - 1)
    at = np.abs(known[nearest] - trajectory.t) < 1e-9
    t = known[nearest[at]]
    exact = truth(t) if len(t) else {}
    names = [name for name in exact if name.endswith(endings) and name in trajectory]
    sizes = [np.abs(trajectory[name][at] - exact[name]) for name in names]
    sizes = [size for size in sizes if np.isfinite(size).all()]
    if not sizes:
        return np.empty(0), np.empty(0)
    size = pd.Series(np.max(sizes, axis=0))
    piece = pd.Series(np.minimum((t / truth.t_end * PIECES).astype(int), PIECES - 1))
    seen = size > 0  # a logarithmic axis has no zero
    top = size[seen].groupby(piece[seen]).idxmax().to_numpy()
    return t[top], size[top].to_numpy()


STUDY = Study(
    "accuracy",
    "Accuracy",
    "How far are the methods from the truth?",
    present,
    plan,
    seconds=0.26,
    on_page_one=False,
    takes=frozenset({"engines", "t_end", "scenes"}),
)
