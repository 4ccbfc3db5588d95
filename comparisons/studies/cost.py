"""Cost of accuracy: CPU time over error on all cases, times to given errors, and what limits each method."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    groups,
    known_of,
    methods,
    scene_title,
    succeeded,
    with_columns,
)
from stiction.comparisons.bench.participants import (
    PAPERS_SCHEME,
    REFERENCE,
    cost_variants,
    extent,
    variants,
)
from stiction.comparisons.bench.presentation import (
    LIMIT,
    METHOD,
    REFINED_BY,
    Axis,
    Chart,
    Column,
    Headline,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.timed_runs import OTHERS
from stiction.comparisons.bench.timing.visits import WIDE
from stiction.comparisons.bench.variants import EVENTS_BY, FRICTION_BY, OWN_CPU, Variant, scaled
from stiction.comparisons.measures.equal_error import (
    COLUMNS,
    FAILED,
    FALLS,
    INTEGRATION,
    QUANTITIES,
    SCENES,
    SMALLEST,
    equal_error,
)
from stiction.comparisons.measures.work_precision import ORDER, TIMING, TOTAL, Timed, work_precision
from stiction.comparisons.studies.accuracy import chart_by_case
from stiction.engines.protocol import Supplier
from stiction.engines.registry import own_methods
from stiction.engines.status import Status
from stiction.scenes import Scene, load_scene
from stiction.scenes.fidelity import Fidelity
from stiction.uncertain import bounded

SET_UP, COMPILATION = "setup_time", "compile_time"
ERROR, UNCERTAINTY = QUANTITIES[0].error, QUANTITIES[0].uncertainty
NEEDED = (
    "scene",
    "variant",
    "engine",
    "fidelity",
    "parameter",
    "status",
    "reason",
    "settings",
    FRICTION_BY,
    EVENTS_BY,
    TOTAL,
    OWN_CPU,
    "repeats",
    TIMING,
    SET_UP,
    COMPILATION,
    ERROR,
    UNCERTAINTY,
)
"""Columns that a table in which all runs failed, or none was timed, may lack."""
TARGET = 1e-3
"""Metres: the error at which the text compares methods."""
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Metres: the errors of the tables."""
UNSURE = "~"
"""Sign before a time that is unsure, for the reasons in `TIMING`."""
MILLI = 1e3
"""Milliseconds in a second, millimetres in a metre."""
CONSTANTS = {"target": TARGET, "wide": WIDE}
"""What the text of the study mentions besides results: m, and a part of a median."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Refinement series of all methods on all scenes, timed in the same rounds; at full depth of other mechanisms, too.

    Variants without runs in the other studies are timed on the first scene only, unless the depth measures equal error
    everywhere.
    """
    limits = extent(scope.depth)
    chosen = cost_variants(scope.engines, scope.depth)
    compared = {variant.label for variant in variants(scope.engines, scope.depth)}
    few = (
        chosen
        if limits.equal_error
        else tuple(variant for variant in chosen if variant.label in compared)
    )

    def timed(scene: Scene, ways: Sequence[Variant]) -> Comparison[Timed]:
        return work_precision(
            scene,
            scaled(ways, scene, scope.t_end),
            t_end=scope.t_end,
            repeats=scope.repeats or limits.repeats,
            budget_s=limits.ladder,
        )

    first, *others = scope.scenes
    cases = [timed(first, chosen), *(timed(scene, few) for scene in others)]
    known = {scene.name for scene in scope.scenes}
    more = (
        [load_scene(name) for name in SCENES[3:]]
        if limits.equal_error and known == {*SCENES[:3]}
        else []
    )

    def combine(found: list[Timed]) -> Tables:
        def concatenated(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
            return pd.concat([pd.DataFrame(), *tables], ignore_index=True)

        of_cases, of_others = found[: len(cases)], found[len(cases) :]
        equal = [
            equal_error(
                concatenated(one.table for one in part), concatenated(one.samples for one in part)
            )
            for part in (of_cases, of_others)
            if part
        ]
        tables = {
            "cost": concatenated(one.table for one in of_cases),
            "equal-error": concatenated(equal),
            "times": concatenated(one.samples for one in found),
        }
        return Tables(tables, timed=tuple(record for one in of_cases for record in one.records))

    return side_by_side([*cases, *(timed(scene, chosen) for scene in more)], combine)


def present(results: Results) -> Presentation:
    """CPU to a millimetre, the engine's part of it, what limits the error, and the times to other errors."""
    cost = with_columns(results.table("cost"), *NEEDED)
    cost = cost[cost["status"] != Status.MISSING]
    if cost.empty:
        return Presentation()
    if not _measured(cost).any():
        return Presentation(rows={"measured": False, **CONSTANTS})
    first = cost["scene"].iloc[0]
    equal = _times_to_position(results, cost)
    reached = equal[(equal["scene"] == first) & (equal["error"] == TARGET) & equal[TOTAL].notna()]
    scenes = list(equal["scene"].unique())
    by_scene = [_table(cost, equal[equal["scene"] == scene], scene, first) for scene in scenes]
    rows = {
        "measured": True,
        "first": first,
        "several_cases": cost["scene"].nunique() > 1,
        "own": _own(reached),
        "joints": _ends(reached[reached["steps"] & (reached["fidelity"] == Fidelity.JOINT)]),
        "contacts": _ends(reached[reached["steps"] & (reached["fidelity"] == Fidelity.CONTACT)]),
        "any": _ends(reached),
        "without": _without(cost, reached, first),
        **_limited(cost, equal),
        "accelerations": _accelerations(cost, first),
        "set_up": _set_up(cost),
        "unsure": int(_is_unsure(cost).sum()),
        "timed": int(_is_timed(cost).sum()),
        "load": _load(results.table("times")),
        "first_run": _first_run(cost),
        "scene_of_table": {table.name: scene for table, scene in zip(by_scene, scenes)},
        **CONSTANTS,
    }
    return Presentation(
        rows=rows,
        headlines=_headlines(results, cost, reached, first),
        tables=[*by_scene, _limits(cost, equal), _every_run(cost)],
        figures=[_figure(cost)],
    )


def _measured(cost: pd.DataFrame) -> pd.Series:
    """The runs that reached their end and have an error."""
    return succeeded(cost) & cost[ERROR].notna()


def _is_timed(cost: pd.DataFrame) -> pd.Series:
    return cost[TOTAL].notna() & cost["repeats"].gt(0)


def _is_unsure(cost: pd.DataFrame) -> pd.Series:
    """The timed runs whose time is unsure, for the reasons in `TIMING`."""
    return _is_timed(cost) & cost[TIMING].astype(object).fillna("").ne("")


def _times_to_position(results: Results, cost: pd.DataFrame) -> pd.DataFrame:
    """Times to an error of position, of variants that succeeded once; ``steps``: an engine with steps."""
    equal = with_columns(results.table("equal-error"), *COLUMNS)
    there = (
        equal["quantity"].eq(QUANTITIES[0].name)
        & equal["scene"].isin(cost["scene"])
        & equal["because"].ne(FAILED)
    )
    steps = cost.loc[(cost["parameter"] == "dt") & ~cost["engine"].isin(own_methods()), "variant"]
    return equal[there].assign(
        **{"is_bound": equal["is_bound"].eq(True), "steps": equal["variant"].isin(steps)}
    )


def _sign(time: Mapping[Hashable, Any], bound: str) -> str:
    """The sign of a bound, and `UNSURE` where the time is."""
    return bound + (UNSURE if isinstance(time[TIMING], str) and time[TIMING] else "")


def _bound_sign(time: Mapping[Hashable, Any]) -> str:
    """The sign before a time to an error: ``≤`` where the coarsest run already has a smaller one."""
    return _sign(time, "≤ " if time["is_bound"] else "")


def _time_to(equal: pd.DataFrame, label: object) -> dict[str, object]:
    """A total time to an error and the sign before it."""
    sign = _bound_sign(equal.loc[label].to_dict())
    return {"time": row_of("equal-error", equal, label)[TOTAL], "sign": sign}


def _ends(equal: pd.DataFrame) -> list[dict[str, object]]:
    """The shortest and the longest time to an error; one where they are the same, none of no times."""
    if equal.empty:
        return []
    labels = dict.fromkeys((equal[TOTAL].idxmin(), equal[TOTAL].idxmax()))
    return [_time_to(equal, label) for label in labels]


def _own(reached: pd.DataFrame) -> list[dict[str, object]]:
    """The times of the reference and of the paper's scheme."""
    return [
        {"variant": variant, **_time_to(reached, label)}
        for variant in (REFERENCE, PAPERS_SCHEME)
        for label in reached.index[reached["variant"] == variant]
    ]


def _without(cost: pd.DataFrame, reached: pd.DataFrame, first: str) -> list[str]:
    """Engines without a run that is accurate to `TARGET`; a finer one might be."""
    made = cost[_measured(cost) & (cost["scene"] == first) & (cost["parameter"] == "dt")]
    made = made[~made["engine"].isin(own_methods()) & ~made["variant"].isin(reached["variant"])]
    return list(made["variant"].unique())


def _limited(cost: pd.DataFrame, equal: pd.DataFrame) -> dict[str, object]:
    """The number of methods whose error still falls at the finest runs, and the limits of the others."""
    limits = equal.drop_duplicates("variant").groupby("because", sort=False)["variant"].agg(list)
    falling = limits.get(INTEGRATION, [])
    others = [
        {"limit": limit, "variants": variants}
        for limit, variants in limits.items()
        if limit != INTEGRATION
    ]
    return {
        "falling": len(falling),
        "methods": sum(map(len, limits)),
        "limited": others,
        "level": list(_level(cost[_measured(cost) & cost["variant"].isin(falling)])),
    }


def _level(runs: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Methods and cases in which the error hardly falls between the last two runs, or rises."""
    for (variant, scene), series in runs.groupby(["variant", "scene"], sort=False):
        is_known = series[ERROR] > series[UNCERTAINTY]
        last = series[is_known & (series["parameter"] != "iterations")].iloc[-2:]
        if len(last) < 2:
            continue
        error_ratio = last[ERROR].iloc[1] / last[ERROR].iloc[0]
        step_ratio = last["step"].iloc[1] / last["step"].iloc[0]
        if error_ratio > step_ratio**FALLS:
            yield {"variant": variant, "scene": scene}


def _method_of(runs: pd.DataFrame) -> pd.Series:
    """The method that the settings of each run name; empty where they name none."""
    named = runs["settings"].map(
        lambda settings: json.loads(settings).get("method"), na_action="ignore"
    )
    return named.fillna("")


def _accelerations(cost: pd.DataFrame, first: str) -> dict[str, object] | None:
    """Engines whose accelerations, under our integrator, come closer than their own steps do.

    With them are the largest of the errors under our integrator, and the smallest with own steps.
    """
    rows = cost[_measured(cost) & (cost["scene"] == first) & (cost["fidelity"] == Fidelity.JOINT)]
    rows = rows.assign(integrated=_method_of(rows).eq("accelerations"))
    closer = []
    for _, runs in rows.groupby("engine", sort=False):
        integrated = runs.loc[runs["integrated"], ERROR]
        stepped = runs.loc[~runs["integrated"] & (runs["parameter"] == "dt"), ERROR]
        if len(integrated) and len(stepped) and integrated.min() < stepped.min():
            closer.append((integrated.idxmin(), stepped.idxmin()))
    if not closer:
        return None
    integrated, stepped = (cost.loc[list(labels)] for labels in zip(*closer))
    return {
        "variants": list(stepped["variant"]),
        "integrated": row_of("cost", cost, integrated[ERROR].idxmax())[ERROR],
        "stepped": row_of("cost", cost, stepped[ERROR].idxmin())[ERROR],
    }


def _set_up(cost: pd.DataFrame) -> dict[str, object]:
    """The longest time before the first step, of the reference and of the engines; None where there is none."""
    times = cost.loc[_measured(cost) & cost[SET_UP].notna(), [SET_UP, "variant", "engine"]]
    parts = {
        "reference": times.loc[times["variant"] == REFERENCE, SET_UP],
        "engines": times.loc[times["engine"] != REFERENCE, SET_UP],
    }
    return {
        name: row_of("cost", cost, part.idxmax())[SET_UP] if len(part) else None
        for name, part in parts.items()
    }


def _first_run(cost: pd.DataFrame) -> Row | None:
    """The run that took the longest to load what is compiled, which the first of a process does."""
    times = cost.loc[_measured(cost) & cost[COMPILATION].gt(0), COMPILATION].astype(float)
    return row_of("cost", cost, times.idxmax()) if len(times) else None


def _load(times: pd.DataFrame) -> object:
    """The largest load by other programs in a round of timing; None where it was not measured."""
    if OTHERS not in times or times[OTHERS].isna().all():
        return None
    return row_of("times", times, times[OTHERS].idxmax())[OTHERS]


def _headlines(
    results: Results, cost: pd.DataFrame, reached: pd.DataFrame, first: str
) -> list[Headline]:
    """Total time to `TARGET`, in brackets the engine's part if less; above the finest run's if none is so exact."""
    timed = cost[_measured(cost) & _is_timed(cost) & (cost["scene"] == first)]
    cells = {}
    for variant in methods(results):
        times = reached[reached["variant"] == variant].to_dict("records")
        runs = timed[timed["variant"] == variant].to_dict("records")
        if times:
            time = times[0]
            cells[variant] = bounded(MILLI * time[TOTAL], _bound_sign(time))
            if time[OWN_CPU] != time[TOTAL]:
                cells[variant] += f" ({bounded(MILLI * time[OWN_CPU], '')})"
        elif runs:
            cells[variant] = bounded(MILLI * runs[-1][TOTAL], _sign(runs[-1], "> "))
    if not cells:
        return []
    label = f"CPU time for an error of {MILLI * TARGET:g} mm (engine's part) in {scene_title(first)} [ms]"
    return [Headline(label, cells)]


def _table(cost: pd.DataFrame, here: pd.DataFrame, scene: str, first: str) -> TableView:
    """Times to `ERRORS` on a scene, a row a method; of the scenes of a validation the report has the first."""
    rows = []
    for group, part in groups(cost[cost["variant"].isin(here["variant"])]):
        for variant in dict.fromkeys(part["variant"]):
            times = here[here["variant"] == variant]
            row = {"group": group.label, "variant": variant}
            reached = times[times[TOTAL].notna()].to_dict("records")
            for time in reached:
                row |= _cells(time, time["error"], _bound_sign(time))
            runs = part[(part["variant"] == variant) & (part["scene"] == scene)]
            if reached and times[SMALLEST].iloc[0] <= runs[UNCERTAINTY].max():
                # smaller errors cannot be measured
                last = reached[-1]
                for error in ERRORS:
                    if error < last["error"]:
                        row |= _cells(last, error, _sign(last, "≥ "))
            rows.append((row, times))
    times_to = [
        Column(
            f"{TOTAL} {error:g}",
            f"{MILLI * error:g} mm",
            "ms",
            scale=MILLI,
            second=f"{OWN_CPU} {error:g}",
            bound=f"bound {error:g}",
            of=TOTAL,
        )
        for error in ERRORS
    ]
    return view(
        "cost" if scene == first else f"cost-{scene.replace('/', '-')}",  # names files
        rows,
        [METHOD, *times_to],
        source="equal-error",
        group="group",
        in_report=scene == first or scene not in SCENES,
    )


def _cells(time: Mapping[Hashable, Any], error: float, sign: str) -> dict[str, object]:
    """Columns of the time to an error, with the sign before it."""
    return {
        f"{TOTAL} {error:g}": time[TOTAL],
        f"{OWN_CPU} {error:g}": time[OWN_CPU],
        f"bound {error:g}": sign,
    }


def _limits(cost: pd.DataFrame, equal: pd.DataFrame) -> TableView:
    """Smallest error and limit of each refinement series, and the costs of a run before its first step."""
    rows = []
    for variant, times in equal.groupby("variant", sort=False):
        runs = cost[cost["variant"] == variant]
        done, one = runs[succeeded(runs)], times.iloc[0]
        row = {
            "variant": variant,
            ERROR: times[SMALLEST].max(),
            "order": one["order"],
            "order uncertainty": one["order_uncertainty"],
            "limit": one["because"],
            "why": one["why"],
            "setup_cpu_time": done[SET_UP].median(),
            "compile_cpu_time": done[COMPILATION].max(),
            "unsure": f"{_is_unsure(runs).sum()} of {_is_timed(runs).sum()}",
            **done.iloc[0][[FRICTION_BY, EVENTS_BY]],
        }
        rows.append((row, runs))
    columns = (
        METHOD,
        Column(ERROR, "smallest_error"),
        Column("order", uncertainty="order uncertainty", interval=True),
        Column("limit"),
        Column("setup_cpu_time", "set-up", "ms", scale=MILLI),
        Column("compile_cpu_time", "compilation", "ms", scale=MILLI),
        Column("unsure", "timings unsure"),
        Column(FRICTION_BY),
        Column(EVENTS_BY),
        Column("why"),
    )
    return view("cost-limits", rows, columns, source="cost", in_report=False)


def _every_run(cost: pd.DataFrame) -> TableView:
    columns = (
        Column("scene"),
        METHOD,
        REFINED_BY,
        Column("step", form="g"),
        Column("status"),
        Column("reason"),
        Column(TOTAL, "CPU", "ms", scale=MILLI, second=OWN_CPU),
        Column(SET_UP, "set-up", "ms", scale=MILLI, form=".2g"),
        Column(ERROR),
        Column(ORDER, "order"),
        Column("torque_error"),
        Column("event_time_error"),
        Column(TIMING),
    )
    return view("cost-all", cost, columns, source="cost", in_report=False)


def _figure(cost: pd.DataFrame) -> Chart:
    """Error over total time, of the first variant of each engine, fidelity and method; others change a setting.

    An asterisk marks methods of which the adapter does a part.
    """
    drawn = cost[_measured(cost) & _is_timed(cost) & cost[ERROR].gt(0)]
    drawn = drawn.assign(method=_method_of(drawn))
    first = drawn.drop_duplicates(["engine", "fidelity", "method"])
    drawn = drawn[drawn["variant"].isin(first["variant"])]
    friction, events = (known_of(drawn, column) for column in (FRICTION_BY, EVENTS_BY))
    by_adapter = {
        variant
        for variant in friction
        if {friction[variant], events[variant]} & {Supplier.ADAPTER, Supplier.BOTH}
    }
    ends = drawn[TOTAL].agg(["min", "max"]).to_numpy(float)

    def series(here: pd.DataFrame) -> list[Series]:
        lines = [
            Series(
                f"{variant} *" if variant in by_adapter else variant,
                runs[TOTAL].to_numpy(float),
                runs[ERROR].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, runs in here.groupby("variant", sort=False)
        ]
        if not lines:
            return []
        return [*lines, Series("", ends, np.full(len(ends), TARGET), look=LIMIT)]

    x = Axis("total CPU time [s]", log=True)
    return chart_by_case("work-precision", drawn, x, quantity_of("position_error").head, series)


STUDY = Study(
    "cost",
    "Cost",
    "How much CPU time does a given accuracy need?",
    present,
    plan,
    seconds=0.13,
    takes=frozenset({"engines", "t_end", "repeats", "scenes"}),
    tables={
        "cost": "Error and cost of every timed run",
        "equal-error": "Time to reach an error",
        "times": "Samples of all times",
    },
)
