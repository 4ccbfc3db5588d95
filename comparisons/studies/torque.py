"""Torque jumps: how well each method resolves the jumps of the driving torque.

Friction jumps where a slider reverses, sticks or slips, and the torque of a drive jumps with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    groups,
    methods,
    one_per_variant,
    representatives,
)
from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation import (
    METHOD,
    REFINED_BY,
    TRUTH,
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
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import NightlyNumbers, Scope, Study, Tables, unless_refused
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    Record,
    coefficients_of,
    time_factor,
)
from stiction.comparisons.measures.accuracy import TORQUE_ERROR
from stiction.comparisons.measures.scene_truth import truths_for
from stiction.comparisons.measures.torque_jumps import (
    BOUND,
    MAX_RELATIVE_ERROR,
    MAX_TIME_ERROR_S,
    nearest_event,
    torque_table,
)
from stiction.comparisons.studies.accuracy import ROW_HEIGHT, compared_runs, in_scene, step_chart
from stiction.engines.status import UNMADE
from stiction.scenes import Event, InputError, Scene
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Tier, Truth
from stiction.uncertain import rounded_up

TRUE_JUMP = "true_jump"
"""Column: jump of the truth, N m."""
TIME_ERROR = "time_error"
"""Column: error of the time at which a run has the jump, s."""
ABOUT = [
    "scene",
    "variant",
    "engine",
    "fidelity",
    COEFFICIENTS,
    "truth",
    "parameter",
    "step",
    "status",
    "reason",
    "key",
]
"""Columns that describe the run of a jump."""
WINDOWS = "event-windows"
"""Name of the table of the driving torque around some events."""
HALF_WINDOW = 0.03
"""Time before and after an event that is shown, s, for scenes whose `time_factor` is 1."""
TRUTH_STEP = 1e-3
"""Time between samples of the truth around an event, s, for scenes whose `time_factor` is 1."""
ROUNDING = 1e-9
"""Relative rounding of the times of samples, so that those at the ends of a window belong to it."""
KINDS_SHOWN = ("reversal", "stick")
"""Kinds of events that the figure shows."""
MOST_EVENTS = 3
"""Largest number of events in the figure: columns that fit into the width of a page."""
BEYOND = 0.5
"""Fraction of the truth's range by which an axis extends beyond it, above and below."""
CONSTANTS = {"latest": MAX_TIME_ERROR_S, "farthest": MAX_RELATIVE_ERROR}
"""Constants in the text of the study: a time in s, and a fraction of a jump."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the runs of the accuracy study, and the tables of the jumps of one drive's effort in them.

    The drive is that in the option ``drive`` of the scope, else the first one of each scene.

    Raises
    ------
    InputError
        If a scene has no such drive.
    """
    drive = scope.options.get("drive")
    efforts = {scene.name: f"{drive_of(scene, drive)}.effort" for scene in scope.scenes}

    def tables(records: tuple[Record, ...]) -> Tables:
        jumps, windows, all_truths = [], [], dict[str, Truth]()
        for scene in scope.scenes:
            effort = efforts[scene.name]
            runs = [record for record in records if record.scene == scene.name]
            truths = truths_for(scene, runs, scope.t_end)
            all_truths |= truths
            jumps.append(_jumps_table(runs, truths, effort))
            factor = time_factor(scene, scope.t_end)
            windows.append(windows_table(runs, truths, effort, factor))
        known = {truth.scene: truth for truth in all_truths.values() if truth.tier != Tier.NONE}
        tables = {
            "torque": pd.concat(jumps, ignore_index=True),
            WINDOWS: pd.concat(windows, ignore_index=True),
        }
        return Tables(tables, records, truths=known)

    return compared_runs(scope).then(tables)


def _jumps_table(
    records: Sequence[Record], truths: Mapping[str, Truth], effort: str
) -> pd.DataFrame:
    """Return `torque_table` with the column `COEFFICIENTS`."""
    table = torque_table(records, truths, effort)
    if table.empty:
        return table
    coefficients = {record.key: coefficients_of(record.variant)[COEFFICIENTS] for record in records}
    return table.assign(**{COEFFICIENTS: table["key"].map(coefficients)})


def drive_of(scene: Scene, name: str | None) -> str:
    """Return the name of the drive if the scene has it, or of its first drive if `name` is None."""
    if not scene.drives:
        raise InputError(f"{scene.name}: no drive; expected one, whose effort can jump")
    if name is not None and name not in scene.drives:
        raise InputError(f"drive: found {name!r}; expected one of {', '.join(scene.drives)}")
    return next(iter(scene.drives)) if name is None else name


def windows_table(
    records: Sequence[Record], truths: Mapping[str, Truth], effort: str, factor: float = 1.0
) -> pd.DataFrame:
    """Return the effort around the largest reversal and the largest stick event of a scene.

    The table contains the truth, sampled every `TRUTH_STEP`, and one run per method with all of its samples and both
    sides of the events that it locates.

    Parameters
    ----------
    records : sequence of Record
        Runs on the scene.
    truths : Mapping[str, Truth]
        The truth of each run, by the key of the run.
    effort : str
        Column of trajectories.
    factor : float
        `time_factor` of the scene.
    """
    half_width = HALF_WINDOW * factor
    drawn = representatives(one_per_variant(records))
    if not drawn:
        return pd.DataFrame()
    # Truths differ in the coefficients of friction. Events are chosen in the first one, and the
    # corresponding events are shown in the others.
    truths_by_name = {truths[record.key].scene: truths[record.key] for record in drawn}
    first_truth = truths[drawn[0].key]
    windows = []
    for number, event_of_first in enumerate(largest_events(first_truth, effort)):
        for name, truth in truths_by_name.items():
            event = nearest_event(truth.events, event_of_first, effort, half_width)
            if event is None:
                continue
            columns = {
                "scene": records[0].scene,
                "truth": name,
                "event": number,
                "kind": event.kind,
                "event_time": event.time,
            }
            window = _truth_window(truth, event.time, half_width, effort)
            windows.append(window.assign(variant=TRUTH, key=None, **columns))
            for record in drawn:
                run = record.trajectory
                if run is None or truths[record.key].scene != name or effort not in run:
                    continue
                window = _window(run.t, run[effort], run.events, event.time, half_width, effort)
                variant = record.variant.label
                windows.append(window.assign(variant=variant, key=record.key, **columns))
    if not windows:
        return pd.DataFrame()
    order = ["scene", "variant", "key", "truth", "event", "kind", "event_time", "t", "effort_value"]
    return pd.concat(windows, ignore_index=True)[order]


def largest_events(truth: Truth, effort: str) -> list[Event]:
    """Return the event with the largest jump of each of `KINDS_SHOWN`."""
    largest = []
    for kind in KINDS_SHOWN:
        events = [event for event in truth.events if event.kind == kind and effort in event.before]
        if events:
            largest.append(max(events, key=lambda event: abs(event.jump(effort))))
    return largest


def _truth_window(truth: Truth, centre: float, half_width: float, effort: str) -> pd.DataFrame:
    """Return samples of the truth within `half_width` of an instant, as `_window` does."""
    samples = 2 * round(HALF_WINDOW / TRUTH_STEP) + 1
    t = centre + np.linspace(-half_width, half_width, samples)
    t = t[(t >= 0) & (t <= truth.t_end)]
    return _window(t, truth(t)[effort], truth.events, centre, half_width, effort)


def _window(
    t: np.ndarray,
    values: np.ndarray,
    events: Iterable[Event],
    centre: float,
    half_width: float,
    effort: str,
) -> pd.DataFrame:
    """Return the samples within `half_width` (s) of an instant, in the columns ``t`` and ``effort_value``.

    At an event both sides of the jump take the place of a sample.
    """
    event_times, event_values = [], []
    for event in events:
        for side in (event.before, event.after):
            if effort in side:
                event_times.append(event.time)
                event_values.append(side[effort])
    is_between_events = ~np.isin(t, event_times)
    frame = pd.DataFrame(
        {
            "t": [*t[is_between_events], *event_times],
            "effort_value": [*values[is_between_events], *event_values],
        }
    )
    inside = frame[(frame["t"] - centre).abs() <= half_width * (1 + ROUNDING)]
    return inside.sort_values("t", kind="stable", ignore_index=True)


def summarize(jumps: pd.DataFrame, *by: str) -> pd.DataFrame:
    """Return a row per group of jumps, with the columns `ABOUT` of the first jump of the group.

    Parameters
    ----------
    jumps : DataFrame
        Rows of `torque_table`; those without a `BOUND` are left out.
    *by : str
        Columns whose values define the groups.

    Returns
    -------
    DataFrame
        Further columns: ``read`` and ``jumps``, the numbers of resolved and of all jumps; ``share``, their ratio;
        `BOUND` and `TIME_ERROR`, the largest values of resolved jumps; ``worst``, the label of the row of `jumps`
        with the largest bound; ``bound``, this bound as text, rounded up.
    """
    keys = list(by)
    jumps = jumps[jumps[BOUND].notna()]
    time_errors = jumps[TIME_ERROR].abs() if TIME_ERROR in jumps else np.nan
    jumps = jumps.assign(**{TIME_ERROR: time_errors}, read=jumps["resolved"].eq(True))
    sums = jumps.groupby(keys, sort=False).agg(read=("read", "sum"), jumps=("read", "size"))
    resolved = jumps[jumps["read"]].groupby(keys, sort=False)
    sums = sums.join(resolved[[BOUND, TIME_ERROR]].max())
    sums = sums.join(resolved[BOUND].idxmax().rename("worst"))
    sums = sums.assign(
        share=sums["read"] / sums["jumps"], bound=sums[BOUND].map(rounded_up, na_action="ignore")
    )
    return jumps.drop_duplicates(keys)[ABOUT].join(sums, on=keys).reset_index(drop=True)


@dataclass(frozen=True)
class EffortWords:
    """How the text calls the efforts of the compared drives.

    Attributes
    ----------
    noun : str
        ``torque`` of drives of angles, ``force`` of drives of distances, ``effort`` of both.
    unit : str
        Unit of the effort; both units if there are both kinds of drives.
    """

    noun: str = "torque"
    unit: str = "N m"


WORDS_OF_DRIVES = {
    frozenset({"angle"}): EffortWords(),
    frozenset({"distance"}): EffortWords("force", "N"),
    frozenset({"angle", "distance"}): EffortWords("effort", "N m or N"),
}
"""Words by the types of the drives in the compared scenes."""


def effort_words(results: Results, table: pd.DataFrame) -> EffortWords:
    """Return how the efforts of the drives in a table of jumps are called; torques where the drives are not known."""
    types = set()
    if "effort" in table:
        for name, effort in table[["scene", "effort"]].dropna().drop_duplicates().to_numpy():
            scene = results.scene(name)
            drive = None if scene is None else scene.drives.get(effort.removesuffix(".effort"))
            if drive is not None:
                types.add(drive.type)
    return WORDS_OF_DRIVES.get(frozenset(types), EffortWords())


def present(results: Results) -> Presentation:
    """Present the number of true jumps that each method resolves, and the largest bound of their errors."""
    table = results.table("torque")
    if not {BOUND, "truth"} <= set(table) or table[BOUND].isna().all():
        return Presentation()
    labels = [
        label for variant in methods(results) for label in at_equal_step(table, variant).index
    ]
    at_equal_steps = table.loc[labels]
    summaries = summarize(at_equal_steps, "variant")
    if summaries.empty:
        return Presentation()
    is_own = summaries["engine"] == REFERENCE
    sizes = table[TRUE_JUMP].abs()
    effort = effort_words(results, table)
    by_scene = _by_scene(table, effort.unit)
    rows = {
        "effort": effort.noun,
        "unit": effort.unit,
        "own": [
            {"variant": method.variant, **_counts(method), "bound": _bound(table, method)}
            for method in summaries[is_own].itertuples()
        ],
        "engines": list(_engines(table, summaries[~is_own])),
        "unresolved": [
            {"variant": method.variant, **_counts(method)}
            for method in summaries[summaries["share"] < 1].itertuples()
        ],
        "smallest_jump": row_of("torque", table, sizes.idxmin())[TRUE_JUMP],
        "largest_jump": row_of("torque", table, sizes.idxmax())[TRUE_JUMP],
        "scenes": list(by_scene),
        **CONSTANTS,
    }
    headline = Headline(
        f"jumps resolved, error bound [{effort.unit}]",
        {method.variant: _cell(method) for method in summaries.itertuples()},
    )
    variants = list(summaries["variant"])
    by_run = summarize(table, "key")
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[
            _by_method(results, table, at_equal_steps, summaries, effort.unit),
            *by_scene.values(),
        ],
        figures=[
            _events_figure(results, table, variants, effort),
            step_chart(
                "torque", by_run, variants, BOUND, f"error bound [{effort.unit}]", results.title_of
            ),
        ],
    )


def _cell(summary: Any) -> str:
    """Return the resolved of all jumps and the bound of their errors: ``14/15, 0.02``, or ``0/15`` without a bound."""
    counts = f"{summary.read}/{summary.jumps}"
    return f"{counts}, {summary.bound}" if summary.read else counts


def _counts(summary: Any) -> dict[str, int]:
    """Return the numbers of resolved and of all jumps of a method."""
    return {"read": int(summary.read), "jumps": int(summary.jumps)}


def _bound(table: pd.DataFrame, summary: Any) -> object:
    """Return the largest bound of the jumps that a method resolves, as a cell; None if it resolves none."""
    return row_of("torque", table, summary.worst)[BOUND] if summary.read else None


def _engines(table: pd.DataFrame, engines: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yield for each fidelity the ranges of the counts and of the bounds of the engines.

    Two bounds that are rounded to the same text count as one.
    """
    for fidelity in Fidelity:
        members = engines[engines["fidelity"] == fidelity]
        if members.empty:
            continue
        by_share = list(members.sort_values("share", kind="stable").itertuples())
        by_bound = members[members["read"] > 0].sort_values(BOUND, kind="stable")
        if len(by_bound):
            by_bound = by_bound.iloc[[0, -1]].drop_duplicates("bound")
        yield {
            "fidelity": fidelity,
            "fewest": _counts(by_share[0]),
            "most": _counts(by_share[-1]),
            "bounds": [_bound(table, method) for method in by_bound.itertuples()],
        }


def _by_method(
    results: Results,
    table: pd.DataFrame,
    at_equal_steps: pd.DataFrame,
    summaries: pd.DataFrame,
    unit: str,
) -> TableView:
    """Return the table of jumps resolved and of their largest bound in a unit, a row per method, a column per case."""
    by_case = summarize(at_equal_steps, "variant", "scene")
    by_case["text"] = [_cell(method) for method in by_case.itertuples()]
    texts = by_case.pivot(index="variant", columns="scene", values="text")
    by_variant = summaries.set_index("variant")
    is_measured = at_equal_steps[BOUND].notna()
    rows = []
    for group, members in groups(table):
        for variant in members["variant"].unique():
            if variant not in by_variant.index:
                continue
            method = by_variant.loc[variant]
            row = {
                "group": group.label,
                "method": variant,
                "run": setting_of(method["parameter"], method["step"]),
                **method[["read", "jumps", BOUND, "bound"]],
                **{in_scene("read", scene): text for scene, text in texts.loc[variant].items()},
            }
            jumps = at_equal_steps[(at_equal_steps["variant"] == variant) & is_measured]
            rows.append((row, jumps))
    columns = (
        Column("method"),
        Column("run", brief=False),
        Column("read", "resolved", form=".0f"),
        Column("jumps", "all jumps", form=".0f"),
        Column("bound", "error bound", unit, of="jump_bound"),
        *(
            Column(in_scene("read", scene), results.title_of(scene), unit, of="jump_bound")
            for scene in table["scene"].unique()
        ),
    )
    return view("torque", rows, columns, group="group")


def _by_scene(table: pd.DataFrame, unit: str) -> dict[str, TableView]:
    """Return for each scene the table of all its runs, with bounds in a unit."""
    columns = (
        METHOD,
        REFINED_BY,
        Column("step", form="g"),
        Column("read", "resolved", form=".0f"),
        Column("jumps", "all jumps", form=".0f"),
        Column("bound", "error bound", unit, of="jump_bound"),
        Column(TIME_ERROR, "largest time error"),
        Column("status"),
        Column("reason"),
    )
    views = {}
    for scene, jumps in table[~table["status"].isin(UNMADE)].groupby("scene", sort=False):
        runs = summarize(jumps, "key")
        if runs.empty:
            continue
        numbers = [jumps.index[jumps["key"] == key] + 1 for key in runs["key"]]
        views[str(scene)] = view(
            f"torque-{scene}", runs, columns, source="torque", rows=numbers, in_report=False
        )
    return views


def _events_figure(
    results: Results, table: pd.DataFrame, variants: Sequence[str], effort: EffortWords
) -> Chart:
    """Return the figure of the effort around events: a row of panels per group of methods, a column per event."""
    windows = results.table(WINDOWS)
    events = shown_events(windows)
    windows_of_events = [
        windows[(windows["scene"] == scene) & (windows["event"] == event)]
        for scene, event in events
    ]
    panels = list[Panel]()
    for group, rows in groups(table) if events else ():
        variants_of_group = [
            variant for variant in dict.fromkeys(rows["variant"]) if variant in variants
        ]
        label = f"{group.label}\ndriving {effort.noun} [{effort.unit}]"
        row = [
            event_panel(window, variants_of_group, "" if number else label, results.title_of)
            for number, window in enumerate(windows_of_events)
        ]
        # A panel with one series contains the truth alone.
        if any(len(panel.series) > 1 for panel in row):
            panels += row
    return Chart("torque-events", panels, max(1, len(events)), ROW_HEIGHT, share_x=True)


def shown_events(windows: pd.DataFrame) -> list[tuple[str, int]]:
    """Return scene and number of the events to show.

    These are the events of the first scene, followed by the largest event of each other scene in the order of their
    sizes, `MOST_EVENTS` at most.
    """
    if windows.empty:
        return []
    truth = windows[windows["variant"] == TRUTH]
    first_scene = windows["scene"].iloc[0]
    sizes = truth.groupby(["scene", "event"], sort=False)["effort_value"].agg(np.ptp)
    events_of_first_scene = [event for event in sizes.index if event[0] == first_scene]
    largest_of_others = [
        sizes_in_scene.idxmax()
        for scene, sizes_in_scene in sizes.groupby(level="scene", sort=False)
        if scene != first_scene
    ]
    largest_of_others.sort(key=lambda event: -sizes[event])
    return [*events_of_first_scene, *largest_of_others][:MOST_EVENTS]


def event_panel(
    window: pd.DataFrame, variants: Sequence[str], label: str, title_of: Callable[[str], str]
) -> Panel:
    """Return a panel of the torque around an event: a line per variant, and the truth for their friction law.

    The time is measured from the true event, in ms. The panel is empty if no variant has a run in the window.

    Parameters
    ----------
    window : DataFrame
        Rows of `windows_table` for one event.
    label : str
        Label of the y axis.
    title_of : callable
        Returns the title of a scene from its name.
    """

    def series(rows: pd.DataFrame, label: str, points: bool) -> Series:
        t_ms = 1e3 * (rows["t"] - rows["event_time"])
        return Series(
            label,
            t_ms.to_numpy(float),
            rows["effort_value"].to_numpy(float),
            look=label,
            points=points,
        )

    runs = window[window["variant"].isin(variants)]
    truth = window[(window["variant"] == TRUTH) & window["truth"].isin(set(runs["truth"]))]
    if truth.empty:
        return Panel("", Axis(), Axis(), ())
    lines = [series(rows, variant, True) for variant, rows in runs.groupby("variant", sort=False)]
    lines.append(series(truth, TRUTH, False))
    low, high = truth["effort_value"].min(), truth["effort_value"].max()
    limits = (low - BEYOND * (high - low), high + BEYOND * (high - low))
    title = f"{title_of(window['scene'].iloc[0])}, {window['kind'].iloc[0]}"
    return Panel(title, Axis("time from the event [ms]"), Axis(label, limits=limits), lines)


STUDY = Study(
    "torque",
    "Torque jumps",
    "How well are the jumps of the driving torque found?",
    present,
    plan,
    seconds=0.26,
    takes=frozenset({"engines", "t_end", "drive", "scenes"}),
    nothing="the effort of the drive does not jump at any event",
    applies=unless_refused(lambda scope: [drive_of(scene, None) for scene in scope.scenes]),
    tables={
        "torque": "Jumps of the driving torque",
        "event-windows": "Driving efforts around chosen events",
    },
    nightly=NightlyNumbers((TORQUE_ERROR,)),
)
