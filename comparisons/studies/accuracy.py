"""Accuracy: how far the motion of each method is from the truth, and which of its events a method finds."""

from __future__ import annotations

from collections import Counter
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
    scene_title,
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
from stiction.comparisons.bench.study import Scope, Study, Tables
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
CONSTANTS = {"event_window": EVENT_WINDOW, "pieces": PIECES}
"""What the text of the study mentions besides results: s, and a number."""


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
        known = {truth.scene: truth for truth in truths.values() if truth.tier != Tier.NONE}
        return Tables({"accuracy": table}, records, truths=known)

    return compared_runs(scope).then(tables)


def present(results: Results) -> Presentation:
    """The largest position error of each method over all cases, and its events."""
    table = with_columns(results.table("accuracy"), POSITION, UNCERTAINTY, FOUND, MISSED, SPURIOUS)
    made = made_methods(table, methods(results), POSITION)
    if not made:
        return Presentation()
    ranked = [method for method in made.values() if method.is_ranked]
    scenes = _made_scenes(table)
    rows = {
        "own": [
            {"variant": method.variant, "error": _worst_error(table, method)}
            for method in ranked
            if method.is_own
        ],
        "engines": list(_engines(table, [method for method in ranked if not method.is_own])),
        "failed": [
            {"variant": method.variant, "failed": len(method.failed), "runs": len(method.rows)}
            for method in made.values()
            if len(method.failed)
        ],
        "several_cases": table["scene"].nunique() > 1,
        "scenes": scenes,
        **CONSTANTS,
    }
    headline = Headline(
        "position error [m]", {variant: _cell(table, method) for variant, method in made.items()}
    )
    over_step = step_chart("accuracy", table, list(made), POSITION, quantity_of(POSITION).head)
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[
            _by_method(results, table, made),
            *_closest(results, table, made),
            *_by_scene(table, scenes),
        ],
        figures=[over_step, *_differences(results, table)],
    )


def _made_scenes(table: pd.DataFrame) -> list[str]:
    """Scenes of which a run was made."""
    return list(table.loc[~table["status"].isin(UNMADE), "scene"].unique())


def _worst_error(table: pd.DataFrame, method: Method) -> object:
    """The position error of a method in its worst case."""
    return row_of("accuracy", table, method.worst_row)[POSITION]


def _by_error(table: pd.DataFrame, compared: Iterable[Method]) -> list[Method]:
    """Methods from the smallest to the largest error in their worst case."""
    return sorted(compared, key=lambda method: table.at[method.worst_row, POSITION])


def _engines(table: pd.DataFrame, engines: Sequence[Method]) -> Iterator[dict[str, object]]:
    """The smallest and the largest error of engines in their worst case, by fidelity; no ranking."""
    for fidelity in Fidelity:
        alike = _by_error(table, (one for one in engines if one.fidelity == fidelity))
        if alike:
            yield {
                "fidelity": fidelity,
                "number": len(alike),
                "smallest": _worst_error(table, alike[0]),
                "largest": _worst_error(table, alike[-1]),
            }


def _closest(
    results: Results, table: pd.DataFrame, made: Mapping[str, Method]
) -> Iterator[TableView]:
    """The closest engine of each group of equal work, in its worst case.

    With it stand those that it cannot be ranked against.
    """
    friction, events = (known_of(table, column) for column in (FRICTION_BY, EVENTS_BY))
    rows = []
    for group, variants_of_group in grouped_methods(results, same_work):
        members = [made[variant] for variant in variants_of_group if variant in made]
        engines = _by_error(table, (one for one in members if one.is_ranked and not one.is_own))
        if not engines:
            continue
        closest = engines[0]
        row = closest.worst_row
        alike = [one.variant for one in engines if not differ(table, row, one.worst_row)]
        shown = {
            "group": group.label,
            "closest": "; ".join(alike),
            "of": len(engines),
            FRICTION_BY: friction[closest.variant],
            EVENTS_BY: events[closest.variant],
            **table.loc[row, [POSITION, UNCERTAINTY]],
            "in": scene_title(table.at[row, "scene"]),
        }
        rows.append((shown, table.loc[[row]]))
    if rows:
        columns = (
            Column("closest", "most accurate"),
            Column("of", "engines compared"),
            Column(FRICTION_BY),
            Column(EVENTS_BY),
            Column(POSITION),
            Column("in", "largest error in"),
        )
        yield view("accuracy-closest", rows, columns, source="accuracy", group="group")


def differ(table: pd.DataFrame, one: int, other: int) -> bool:
    """Test if the position errors of two rows differ by more than both their uncertainties."""
    unsure = table.loc[[one, other], UNCERTAINTY].sum()
    return bool(abs(table.at[one, POSITION] - table.at[other, POSITION]) > unsure)


def _cell(table: pd.DataFrame, method: Method) -> str:
    """The worst error of a method, and how many of its runs failed: ``0.002, 1 of 3 failed``."""
    parts = []
    if method.worst is not None:
        parts.append(str(_worst_error(table, method)))
    if len(method.failed):
        word = "declined" if (method.failed["status"] == Status.REFUSED).all() else Status.FAILED
        parts.append(f"{len(method.failed)} of {len(method.rows)} {word}")
    return ", ".join(parts)


def _by_method(results: Results, table: pd.DataFrame, made: Mapping[str, Method]) -> TableView:
    """A row per method, a column per case; events of all cases together."""
    friction, events = (known_of(table, column) for column in (FRICTION_BY, EVENTS_BY))
    rows = []
    for group, names in grouped_methods(results):
        for method in (made[name] for name in names if name in made):
            runs = method.rows
            row: dict[str, object] = {
                "group": group.label,
                "method": method.variant,
                SUPPLIERS: f"{friction[method.variant]} / {events[method.variant]}",
                "run": setting_of(runs["parameter"].iloc[0], runs["step"].iloc[0]),
            }
            for run in runs.drop(index=method.failed.index).to_dict("records"):
                for column in (POSITION, UNCERTAINTY):
                    row[in_scene(column, run["scene"])] = run[column]
            if runs[FOUND].notna().any():
                row[EVENTS] = _events(runs, results.truths)
                row[BY_KIND] = missed_by_kind(runs)
            row["failed"] = "; ".join(
                f"{scene_title(run['scene'])}: {run['reason'] or run['status']}"
                for run in method.failed.to_dict("records")
            )
            rows.append((row, runs))
    cases = [
        Column(
            in_scene(POSITION, scene),
            scene_title(scene),
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
    """Name of the column of a pivoted table that has the values of one scene."""
    return f"{column} in {scene}"


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


def _by_scene(table: pd.DataFrame, scenes: Sequence[str]) -> Iterator[TableView]:
    """Every run of a scene."""
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
) -> Chart:
    """A row of panels per group of methods that may be compared, a column per case, with the series of its rows.

    A row has one logarithmic y axis, with its label at the first panel.
    """
    scenes = list(dict.fromkeys(table["scene"]))
    panels = list[Panel]()
    for group, rows in groups(table) if scenes else ():
        # no line of a title may end within "mus > mu"
        unbroken = group.label.replace(" > ", "\N{NO-BREAK SPACE}>\N{NO-BREAK SPACE}")
        lines = {scene: series(rows[rows["scene"] == scene]) for scene in scenes}
        values = np.concatenate([np.empty(0), *(one.y for row in lines.values() for one in row)])
        limits = (values.min() / MARGIN, values.max() * MARGIN) if len(values) else None
        panels += [
            Panel(
                f"{scene_title(scene)}; {unbroken}",
                x,
                Axis(label if scene == scenes[0] else "", log=True, limits=limits),
                lines[scene],
            )
            for scene in scenes
        ]
    return Chart(name, panels, max(1, len(scenes)), ROW_HEIGHT, share_x=True)


def step_chart(
    name: str, table: pd.DataFrame, chosen: Sequence[str], column: str, label: str
) -> Chart:
    """A column of a table over the step; runs by tolerance have none and are left out."""
    rows = table[table["variant"].isin(chosen) & (table["parameter"] == "dt")]
    rows = rows[rows[column] > 0] if column in rows else rows.iloc[:0]

    def series(here: pd.DataFrame) -> list[Series]:
        here = here.sort_values("step")
        lines = [
            Series(
                variant,
                part["step"].to_numpy(float),
                part[column].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, part in here.groupby("variant", sort=False)
        ]
        if not lines:
            return []
        ends = here["step"].agg(["min", "max"]).to_numpy(float)
        slope = 2 * (here[column] / here["step"]).max()
        return [*lines, Series("first order", ends, slope * ends, look=LIMIT)]

    x = Axis("step [s]", log=True, ticks=sorted(set(rows["step"])))
    return chart_by_case(name, rows, x, label, series)


def _differences(results: Results, table: pd.DataFrame) -> Iterator[Chart]:
    """The difference from the truth over time: of positions, and of the driving torque."""
    chosen = drawn_runs(results)
    truths = {key: results.truths.get(name) for key, name in zip(table["key"], table["truth"])}
    for quantity, endings, unit in (
        ("position", (".x", ".y"), "m"),
        ("torque", (".effort",), "N m"),
    ):

        def series(here: pd.DataFrame, endings: tuple[str, ...] = endings) -> list[Series]:
            keys = set(here["key"])
            runs = [run for run in chosen if run.key in keys]
            return list(_difference_series(runs, truths, endings))

        label = f"{quantity} difference [{unit}]"
        yield chart_by_case(f"difference-{quantity}", table, Axis("time [s]"), label, series)


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


def failures_of_reference(results: Results) -> Iterator[str]:
    """Yield the runs of the reference that are off by more than the mechanism's size."""
    for row in results.table("accuracy").itertuples():
        if row.engine == REFERENCE and row.status == Status.WRONG:
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
)
