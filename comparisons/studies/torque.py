"""Torque jumps: friction, and with it the driving torque, jumps at a reversal, a stick and a slip; who shows that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    at_equal_step,
    groups,
    methods,
    one_per_variant,
    representatives,
    scene_title,
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
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
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
from stiction.comparisons.studies.accuracy import ROW_HEIGHT, compared_runs, in_scene, step_chart
from stiction.engines.status import UNMADE
from stiction.scenes import Event, InputError, Scene
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Tier, Truth
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
CONSTANTS = {"latest": LATEST, "farthest": FARTHEST}
"""What the text of the study mentions besides results: s, and a part of a jump."""


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
        known = {truth.scene: truth for truth in all_truths.values() if truth.tier != Tier.NONE}
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

    ``read``, ``jumps``: the jumps that are resolved, of all; ``share``, their ratio; of those that are resolved
    `BOUND`, `LATE`: the largest; ``worst``: the row with that bound; ``bound``: it in words, rounded up.
    """
    jumps = jumps[jumps[BOUND].notna()]
    late = jumps[LATE].abs() if LATE in jumps else np.nan
    jumps = jumps.assign(**{LATE: late}, read=jumps["resolved"].eq(True))
    sums = jumps.groupby(list(by), sort=False).agg(read=("read", "sum"), jumps=("read", "size"))
    read = jumps[jumps["read"]].groupby(list(by), sort=False)
    sums = sums.join(read[[BOUND, LATE]].max()).join(read[BOUND].idxmax().rename("worst"))
    sums = sums.assign(
        share=sums["read"] / sums["jumps"], bound=sums[BOUND].map(rounded_up, na_action="ignore")
    )
    return jumps.drop_duplicates(list(by))[ABOUT].join(sums, on=list(by)).reset_index(drop=True)


def present(results: Results) -> Presentation:
    """The number of true jumps that each method resolves, and a bound for the worst of them."""
    table = results.table("torque")
    if not {BOUND, "truth"} <= set(table) or table[BOUND].isna().all():
        return Presentation()
    equal = table.loc[
        [row for variant in methods(results) for row in at_equal_step(table, variant).index]
    ]
    compared = summed_up(equal, "variant")
    if compared.empty:
        return Presentation()
    is_own = compared["engine"] == REFERENCE
    sizes = table[TRUE_JUMP].abs()
    by_scene = _by_scene(table)
    rows = {
        "own": [
            {"variant": one.variant, **_counts(one), "bound": _bound(table, one)}
            for one in compared[is_own].itertuples()
        ],
        "engines": list(_engines(table, compared[~is_own])),
        "unresolved": [
            {"variant": one.variant, **_counts(one)}
            for one in compared[compared["share"] < 1].itertuples()
        ],
        "smallest_jump": row_of("torque", table, sizes.idxmin())[TRUE_JUMP],
        "largest_jump": row_of("torque", table, sizes.idxmax())[TRUE_JUMP],
        "scenes": list(by_scene),
        **CONSTANTS,
    }
    headline = Headline(
        "jumps resolved, error bound [N m]",
        {
            one.variant: _words(int(one.read), int(one.jumps), one.bound)
            for one in compared.itertuples()
        },
    )
    chosen = list(compared["variant"])
    over_step = step_chart("torque", summed_up(table, "key"), chosen, BOUND, "error bound [N m]")
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[_by_method(table, equal, compared), *by_scene.values()],
        figures=[_events_figure(results.table(WINDOWS), table, chosen), over_step],
    )


def _words(read: int, jumps: int, bound: str) -> str:
    """``14/15, 0.02``: jumps resolved, of all, and the bound of their errors; ``0/15`` has none."""
    return f"{read}/{jumps}, {bound}" if read else f"{read}/{jumps}"


def _counts(method: Any) -> dict[str, int]:
    """The jumps that a method resolves, and all."""
    return {"read": int(method.read), "jumps": int(method.jumps)}


def _bound(table: pd.DataFrame, method: Any) -> object:
    """The bound for the worst jump that a method resolves; None if it resolves none."""
    return row_of("torque", table, method.worst)[BOUND] if method.read else None


def _engines(table: pd.DataFrame, engines: pd.DataFrame) -> Iterator[dict[str, object]]:
    """The engines with the fewest and the most jumps, and the least and the largest bound, by fidelity.

    Bounds that are written alike are one.
    """
    for fidelity in Fidelity:
        alike = engines[engines["fidelity"] == fidelity]
        if alike.empty:
            continue
        by_share = list(alike.sort_values("share", kind="stable").itertuples())
        by_bound = alike[alike["read"] > 0].sort_values(BOUND, kind="stable")
        ends = by_bound.iloc[[0, -1]] if len(by_bound) else by_bound
        yield {
            "fidelity": fidelity,
            "fewest": _counts(by_share[0]),
            "most": _counts(by_share[-1]),
            "bounds": [_bound(table, one) for one in ends.drop_duplicates("bound").itertuples()],
        }


def _by_method(table: pd.DataFrame, equal: pd.DataFrame, compared: pd.DataFrame) -> TableView:
    """A row per method: jumps resolved and worst bound, of all cases and of each."""
    cases = summed_up(equal, "variant", "scene")
    cases["text"] = [_words(int(one.read), int(one.jumps), one.bound) for one in cases.itertuples()]
    texts = cases.pivot(index="variant", columns="scene", values="text")
    by_variant = compared.set_index("variant")
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
            behind = equal[(equal["variant"] == variant) & equal[BOUND].notna()]
            rows.append((row, behind))
    columns = (
        Column("method"),
        Column("run", brief=False),
        Column("read", "resolved", form=".0f"),
        Column("jumps", "all jumps", form=".0f"),
        Column("bound", "error bound", of="jump_bound"),
        *(
            Column(in_scene("read", scene), scene_title(scene), of="jump_bound")
            for scene in table["scene"].unique()
        ),
    )
    return view("torque", rows, columns, group="group")


def _by_scene(table: pd.DataFrame) -> dict[str, TableView]:
    """Every run of a scene."""
    columns = (
        METHOD,
        REFINED_BY,
        Column("step", form="g"),
        Column("read", "resolved", form=".0f"),
        Column("jumps", "all jumps", form=".0f"),
        Column("bound", "error bound", of="jump_bound"),
        Column(LATE, "largest time error"),
        Column("status"),
        Column("reason"),
    )
    views = {}
    for scene, jumps in table[~table["status"].isin(UNMADE)].groupby("scene", sort=False):
        runs = summed_up(jumps, "key")
        if runs.empty:
            continue
        behind = [jumps.index[jumps["key"] == key] + 1 for key in runs["key"]]
        views[str(scene)] = view(
            f"torque-{scene}", runs, columns, source="torque", rows=behind, in_report=False
        )
    return views


def _events_figure(windows: pd.DataFrame, table: pd.DataFrame, chosen: Sequence[str]) -> Chart:
    """A row of panels per group of methods, a column per event."""
    events = shown_events(windows)
    panels = list[Panel]()
    for group, rows in groups(table) if events else ():
        variants = [variant for variant in dict.fromkeys(rows["variant"]) if variant in chosen]
        label = f"{group.label}\ndriving torque [N m]"
        around = [
            windows[(windows["scene"] == scene) & (windows["event"] == event)]
            for scene, event in events
        ]
        row = [
            event_panel(window, variants, "" if number else label)
            for number, window in enumerate(around)
        ]
        has_runs = any(len(panel.series) > 1 for panel in row)
        panels += row if has_runs else []
    return Chart("torque-events", panels, max(1, len(events)), ROW_HEIGHT, share_x=True)


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
    title = f"{scene_title(window['scene'].iloc[0])}, {window['kind'].iloc[0]}"
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
    tables={
        "torque": "Jumps of the driving torque",
        "event-windows": "Driving efforts around chosen events",
    },
)
