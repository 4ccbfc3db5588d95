"""Torque jumps: friction, and with it the driving torque, jumps at a reversal, a stick and a slip; who shows that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    called,
    case_of,
    groups,
    methods,
    one_per_variant,
    representatives,
    title_of,
)
from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation import (
    TRUTH,
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
    listed,
    sentence,
    traced,
    value,
    view,
)
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    UNMADE,
    Record,
    coefficients_of,
    time_factor,
)
from stiction.comparisons.measures.scene_truth import truths_for
from stiction.comparisons.measures.torque_jumps import (
    BOUND,
    FARTHEST,
    LATEST,
    counterpart,
    torque_table,
)
from stiction.comparisons.studies.accuracy import ROW_HEIGHT, compared_runs, step_chart
from stiction.engines.protocol import FIDELITIES
from stiction.scenes import Event, InputError, Scene
from stiction.truths import NO_TRUTH, Truth
from stiction.uncertain import rounded_up

TRUE_JUMP, LATE = "true_jump", "time_error"
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
WINDOWS = "event-windows"
"""Name of the table of the driving torque around some events."""
HALF_WINDOW = 0.03
"""Seconds before and after an event, times `time_factor`."""
TRUTH_STEP = 1e-3
"""Seconds between samples of the truth around an event, times `time_factor`."""
KINDS_SHOWN = ("reversal", "stick")
MOST_EVENTS = 3
"""In a figure."""
BEYOND = 0.5
"""Part of the truth's range that an axis shows beyond it, above and below."""


def plan(scope: Scope) -> Comparison[Tables]:
    """The jumps of the first drive's effort, or of the drive in the options, in the runs of the accuracy study.

    Raises
    ------
    InputError
        If a scene has no such drive.
    """
    efforts = {
        scene.name: f"{drive_of(scene, scope.options.get('drive'))}.effort"
        for scene in scope.scenes
    }

    def tables(records: tuple[Record, ...]) -> Tables:
        jumps, windows, all_truths = [], [], dict[str, Truth]()
        for scene in scope.scenes:
            own = [record for record in records if record.scene == scene.name]
            truths = truths_for(scene, own, scope.t_end)
            all_truths |= truths
            coefficients = {
                record.key: coefficients_of(record.variant)[COEFFICIENTS] for record in own
            }
            table = torque_table(own, truths, efforts[scene.name])
            if len(table):
                table = table.assign(**{COEFFICIENTS: table["key"].map(coefficients)})
            jumps.append(table)
            windows.append(
                windows_table(own, truths, efforts[scene.name], time_factor(scene, scope.t_end))
            )
        known = {truth.scene: truth for truth in all_truths.values() if truth.tier != NO_TRUTH}
        tables = {
            "torque": pd.concat(jumps, ignore_index=True),
            WINDOWS: pd.concat(windows, ignore_index=True),
        }
        return Tables(tables, records, truths=known)

    return compared_runs(scope).then(tables)


def drive_of(scene: Scene, name: str | None) -> str:
    """The drive of this name, or the first one."""
    if not scene.drives:
        raise InputError(f"{scene.name}: no drive; expected one, whose effort can jump")
    if name is not None and name not in scene.drives:
        raise InputError(f"drive: found {name!r}; expected one of {', '.join(scene.drives)}")
    return next(iter(scene.drives)) if name is None else name


def windows_table(
    records: Sequence[Record], truths: Mapping[str, Truth], effort: str, factor: float = 1.0
) -> pd.DataFrame:
    """The effort around the largest reversal and the largest stick event of a scene: one run per method, and the truth.

    A run has all of its samples, and both sides of events that it locates; the truth is sampled every `TRUTH_STEP`.

    Parameters
    ----------
    factor
        `time_factor` of the scene.
    """
    half = HALF_WINDOW * factor
    chosen = representatives(one_per_variant(records))
    known = {truths[record.key].scene: truths[record.key] for record in chosen}
    rows = []
    for number, wanted in enumerate(
        largest_events(next(iter(known.values())), effort) if known else ()
    ):
        for name, truth in known.items():
            event = counterpart(truth.events, wanted, effort, half)
            if event is None:
                continue
            t = event.time + np.linspace(-half, half, 2 * round(HALF_WINDOW / TRUTH_STEP) + 1)
            t = t[(t >= 0) & (t <= truth.t_end)]
            about = {
                "scene": records[0].scene,
                "truth": name,
                "event": number,
                "kind": event.kind,
                "event_time": event.time,
            }
            rows.append(
                _window(t, truth(t)[effort], truth.events, event.time, half, effort).assign(
                    variant=TRUTH, key=None, **about
                )
            )
            rows += [
                _window(run.t, run[effort], run.events, event.time, half, effort).assign(
                    variant=record.variant.label, key=record.key, **about
                )
                for record in chosen
                if (run := record.trajectory) is not None
                and truths[record.key].scene == name
                and effort in run
            ]
    order = ["scene", "variant", "key", "truth", "event", "kind", "event_time", "t", "effort_value"]
    return pd.concat(rows, ignore_index=True)[order] if rows else pd.DataFrame()


def largest_events(truth: Truth, effort: str) -> list[Event]:
    """The event with the largest jump of each of `KINDS_SHOWN`."""
    found = []
    for kind in KINDS_SHOWN:
        events = [event for event in truth.events if event.kind == kind and effort in event.before]
        found += sorted(events, key=lambda event: -abs(event.jump(effort)))[:1]
    return found


def _window(
    t: np.ndarray,
    values: np.ndarray,
    events: Iterable[Event],
    centre: float,
    half: float,
    effort: str,
) -> pd.DataFrame:
    """Samples within `half` of an instant; at events both sides in place of a sample."""
    sides = [
        (event.time, side[effort])
        for event in events
        for side in (event.before, event.after)
        if effort in side
    ]
    between = ~np.isin(t, [time for time, _ in sides])
    frame = pd.DataFrame(
        {
            "t": [*t[between], *(time for time, _ in sides)],
            "effort_value": [*values[between], *(value for _, value in sides)],
        }
    )
    inside = frame[(frame["t"] - centre).abs() <= half * (1 + 1e-9)]
    return inside.sort_values("t", kind="stable", ignore_index=True)


def summed_up(jumps: pd.DataFrame, *by: str) -> pd.DataFrame:
    """A row per group of jumps, with the columns `ABOUT` of its first.

    ``read``, ``jumps``: the jumps that are read, of all; ``share``, their ratio; of those that are read `BOUND`,
    `LATE`: the largest; ``worst``: the row with that bound; ``bound``: it in words, rounded up; ``keys``: of the runs.
    """
    jumps = jumps[jumps[BOUND].notna()]
    late = jumps[LATE].abs() if LATE in jumps else np.nan
    jumps = jumps.assign(**{LATE: late}, read=jumps["resolved"].eq(True))
    found = jumps.groupby(list(by), sort=False).agg(
        read=("read", "sum"), jumps=("read", "size"), keys=("key", frozenset)
    )
    read = jumps[jumps["read"]].groupby(list(by), sort=False)
    found = found.join(read[[BOUND, LATE]].max()).join(read[BOUND].idxmax().rename("worst"))
    found = found.assign(
        share=found["read"] / found["jumps"], bound=found[BOUND].map(rounded_up, na_action="ignore")
    )
    return jumps.drop_duplicates(list(by))[ABOUT].join(found, on=list(by)).reset_index(drop=True)


def present(results: Results) -> Presentation:
    """The number of true jumps that each method reads, and a bound for the worst of them."""
    table = results.table("torque")
    if not {BOUND, "truth"} <= set(table) or table[BOUND].isna().all():
        return Presentation()
    equal = table.loc[
        [row for variant in methods(results) for row in at_equal_step(table, variant).index]
    ]
    found = summed_up(equal, "variant")
    if found.empty:
        return Presentation()
    read = _spans(found, "share", lambda method: _counts(table, method))
    answer = joined(_own(table, found), sentence("Engines: {}.", listed(read, ", ", ", ")))
    headline = Headline(
        "jumps read, bound of these [N m]",
        {
            method.variant: listed([_counts(table, method), *_bounds(method)], last=", ")
            for method in found.itertuples()
        },
    )
    chosen = list(found["variant"])
    over_step = step_chart(
        "torque",
        summed_up(table, "key"),
        chosen,
        BOUND,
        "bound [N m]",
    )
    caption = (
        "Bound for the error of the worst jump that is read over the step. The tables "
        "have the number of those that are not. Dotted: the slope of first order."
    )
    notes = (
        f"A jump is read if its time is right within {1e3 * LATEST:g} ms plus the time's uncertainty, and its "
        f"size within {100 * FARTHEST:g} %. One that is not read has no bound.",
        "Bound: the largest error and its uncertainty together, over all jumps that are read; rounded up.",
        "Methods that locate events have both sides of a jump; of others it is read off samples every 2 ms.",
    )
    return Presentation(
        answer,
        _findings(table, found),
        [headline],
        [_by_method(table, equal, found), *_by_scene(table)],
        [
            _events_figure(results.table(WINDOWS), table, chosen),
            replace(over_step, caption=caption),
        ],
        notes,
    )


def _counted(table: pd.DataFrame, method: Any, *is_read: bool) -> Number:
    """The number of its jumps that are read, or not, or both."""
    return count("torque", table, key=method.keys, resolved=frozenset(is_read))


def _counts(table: pd.DataFrame, method: Any) -> TracedText:
    """``14/15``: jumps read, of all."""
    return traced("{}/{}", _counted(table, method, True), _counted(table, method, True, False))


def _bounds(method: Any) -> list[Number]:
    """The bound of the jumps that are read; none without any."""
    return (
        [Number(method.bound, "torque", BOUND, rows=(int(method.worst) + 1,))]
        if method.read
        else []
    )


def _own(table: pd.DataFrame, found: pd.DataFrame) -> TracedText:
    """The methods of the reference, each with its worst jump."""
    own = list(found[found["engine"] == REFERENCE].itertuples())
    parts = [
        traced(
            "{} reads {}{}",
            called(method.variant),
            _counts(table, method),
            sentence(" within {} N m", listed(_bounds(method))),
        )
        for method in own[:1]
    ]
    for method in own[1:]:
        is_alike = (method.read, method.jumps) == (own[0].read, own[0].jumps)
        read = (
            ""
            if is_alike
            else traced("{}{}", _counts(table, method), " within " if method.read else "")
        )
        parts.append(traced("{} {}{}", called(method.variant), read, listed(_bounds(method))))
    said = sentence("{}.", listed(parts, ", ", ", "))
    return replace(said, text=said.text[:1].upper() + said.text[1:])


def _spans(
    found: pd.DataFrame, column: str, words: Callable[[Any], TracedText], unit: str = ""
) -> list[TracedText]:
    """The engines with the least and the most of a column, by fidelity: ``7/9 to 9/9 with joints``."""
    parts = []
    for fidelity in FIDELITIES:
        engines = found[(found["engine"] != REFERENCE) & (found["fidelity"] == fidelity)]
        if len(engines):
            ranked = [
                words(method) for method in engines.sort_values(column, kind="stable").itertuples()
            ]
            span = ranked[:1] if ranked[0].text == ranked[-1].text else [ranked[0], ranked[-1]]
            parts.append(traced("{}" + f"{unit} with {fidelity}s", listed(span, last=" to ")))
    return parts


def _findings(table: pd.DataFrame, found: pd.DataFrame) -> list[TracedText]:
    sizes = table[TRUE_JUMP].abs()
    ends = [
        value("torque", table, int(row), TRUE_JUMP, ".2g")
        for row in (sizes.idxmin(), sizes.idxmax())
    ]
    bounds = _spans(found[found["read"] > 0], BOUND, lambda method: listed(_bounds(method)), " N m")
    unread = [
        traced(
            "{} ({} of {})",
            called(method.variant),
            _counted(table, method, False),
            _counted(table, method, True, False),
        )
        for method in found[found["share"] < 1].itertuples()
    ]
    return [
        traced("The true jumps measure {} to {} N m.", *ends),
        sentence("Bounds for the jumps that engines read: {}.", listed(bounds, ", ", ", ")),
        sentence(
            "Our reader does not find these in the runs, often as an effort rings after a jump: {}.",
            listed(unread),
        ),
    ]


def _by_method(table: pd.DataFrame, equal: pd.DataFrame, found: pd.DataFrame) -> TableView:
    """A row per method: jumps read and worst bound, of all cases and of each."""
    cases = summed_up(equal, "variant", "scene")
    cases["text"] = [
        f"{case.read}/{case.jumps}" + (f", {case.bound}" if case.read else "")
        for case in cases.itertuples()
    ]
    texts, methods_found = (
        cases.pivot(index="variant", columns="scene", values="text"),
        found.set_index("variant"),
    )
    rows = []
    for group, there in groups(table):
        for variant in (name for name in there["variant"].unique() if name in methods_found.index):
            method = methods_found.loc[variant]
            rows.append(
                (
                    {
                        "group": group.label,
                        "method": variant,
                        "run": setting_of(method["parameter"], method["step"]),
                        **method[["read", "jumps", BOUND, "bound"]],
                        **texts.loc[variant].rename(case_of),
                    },
                    equal[(equal["variant"] == variant) & equal[BOUND].notna()],
                )
            )
    columns = (
        Column("method"),
        Column("run", brief=False),
        Column("read", form=".0f"),
        Column("jumps", "of", form=".0f"),
        Column("bound", unit="N m"),
        *(Column(case_of(scene), unit="N m") for scene in table["scene"].unique()),
    )
    return view(
        "torque",
        rows,
        columns,
        group="group",
        caption="Jumps of the driving torque that each method reads at the step nearest to 1 ms or the "
        "tightest tolerance. Bound: for the error of the worst of these; by case: read/all, bound.",
    )


def _by_scene(table: pd.DataFrame) -> Iterator[TableView]:
    columns = (
        Column("variant", "method"),
        Column("parameter", "refined by"),
        Column("step", form="g"),
        Column("read", form=".0f"),
        Column("jumps", "of", form=".0f"),
        Column("bound", unit="N m"),
        Column(LATE, "largest time error", "s"),
        Column("status"),
        Column("reason"),
    )
    for scene, jumps in table[~table["status"].isin(UNMADE)].groupby("scene", sort=False):
        rows = summed_up(jumps, "key")
        if len(rows):
            behind = [jumps.index[jumps["key"] == key] + 1 for key in rows["key"]]
            yield view(
                f"torque-{scene}",
                rows,
                columns,
                source="torque",
                rows=behind,
                in_report=False,
                caption=f"{title_of(scene)}: jumps read in every run, a bound for the error of their "
                "sizes, and the largest error of their times.",
            )


def _events_figure(windows: pd.DataFrame, table: pd.DataFrame, chosen: Sequence[str]) -> Chart:
    """A row of panels per group of methods, a column per event."""
    events, panels = shown_events(windows), list[Panel]()
    for group, rows in groups(table) if events else ():
        variants = [variant for variant in dict.fromkeys(rows["variant"]) if variant in chosen]
        label = f"{group.label}\ndriving torque [N m]"
        around = [
            windows[(windows["scene"] == scene) & (windows["event"] == event)]
            for scene, event in events
        ]
        found = [
            event_panel(window, variants, "" if number else label)
            for number, window in enumerate(around)
        ]
        panels += found if any(len(panel.series) > 1 for panel in found) else []
    return Chart(
        "torque-events",
        panels,
        max(1, len(events)),
        ROW_HEIGHT,
        share_x=True,
        caption="Driving torque around a reversal and a stick event of the truth (black), as each "
        "method has it at the step nearest to 1 ms or the tightest tolerance. Points are samples; methods "
        "that agree cover each other. Time counts from the true event; what lies beyond the axis is cut off.",
    )


def shown_events(windows: pd.DataFrame) -> list[tuple[str, int]]:
    """Scene and number of the events to show: those of the first scene, then the largest of each other scene."""
    if windows.empty:
        return []
    truth, first_scene = windows[windows["variant"] == TRUTH], windows["scene"].iloc[0]
    sizes = truth.groupby(["scene", "event"], sort=False)["effort_value"].agg(np.ptp)
    first = [event for event in sizes.index if event[0] == first_scene]
    others = [
        part.idxmax()
        for scene, part in sizes.groupby(level="scene", sort=False)
        if scene != first_scene
    ]
    return [*first, *sorted(others, key=lambda event: -sizes[event])][:MOST_EVENTS]


def event_panel(window: pd.DataFrame, variants: Sequence[str], label: str) -> Panel:
    """The truth of the methods' physics and a line per method, over the time from the true event in ms."""

    def series(rows: pd.DataFrame, label: str, points: bool) -> Series:
        t = 1e3 * (rows["t"] - rows["event_time"])
        return Series(
            label,
            t.to_numpy(float),
            rows["effort_value"].to_numpy(float),
            look=label,
            points=points,
        )

    runs = window[window["variant"].isin(variants)]
    true = window[(window["variant"] == TRUTH) & window["truth"].isin(set(runs["truth"]))]
    lines = [series(part, variant, True) for variant, part in runs.groupby("variant", sort=False)]
    if true.empty:
        return Panel("", Axis(), Axis(), ())
    low, high = true["effort_value"].min(), true["effort_value"].max()
    limits = (low - BEYOND * (high - low), high + BEYOND * (high - low))
    title = f"{title_of(window['scene'].iloc[0])}, {window['kind'].iloc[0]}"
    lines.append(series(true, TRUTH, False))
    return Panel(title, Axis("time from the event [ms]"), Axis(label, limits=limits), lines)


STUDY = Study(
    "torque",
    "Torque jumps",
    "How well are the jumps of the driving torque found?",
    present,
    plan,
    seconds=0.26,
    takes=frozenset({"engines", "t_end", "drive", "scenes"}),
)
