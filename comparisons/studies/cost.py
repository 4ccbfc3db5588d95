"""Cost of accuracy: error over CPU time in all cases, the time to reach given errors, and what limits each method.

Times to given errors come from `stiction.comparisons.measures.equal_error`, errors and times of single runs from
`stiction.comparisons.measures.work_precision`.
"""

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
from stiction.comparisons.bench.study import NightlyNumbers, Scope, Study, Tables
from stiction.comparisons.bench.timing.calibration import TIME
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

SET_UP = "setup_time"
"""Column: wall time before the first step, s."""
COMPILATION = "compile_time"
"""Column: time to compile code or to load what is compiled, s."""
ERROR = QUANTITIES[0].error
"""Column: position error, m."""
UNCERTAINTY = QUANTITIES[0].uncertainty
"""Column: uncertainty of the position error, m."""
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
"""Columns that are added, without values, to a table that lacks them because all runs failed or none was timed."""
TARGET = 1e-3
"""Position error at which the text compares methods, m."""
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Position errors of the columns of the tables, m."""
UNSURE = "~"
"""Sign before a time that is unsure; the column `TIMING` has the reason."""
MILLI = 1e3
"""Factor from s to ms and from m to mm."""
PAPERS_CASES = SCENES[:3]
"""Names of the paper's cases among the scenes on which equal errors are compared."""
OTHER_MECHANISMS = SCENES[3:]
"""Names of the other scenes on which equal errors are compared."""
CONSTANTS = {"target": TARGET, "wide": WIDE}
"""Constants in the text of the study: an error in m, and a fraction of a median."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan refinement series of all methods on all scenes, timed in the same rounds.

    At a depth that measures equal error everywhere, all variants run on all of the paper's cases and on other
    mechanisms. At other depths, variants that do not take part in the other studies run on the first scene only.
    """
    limits = extent(scope.depth)
    all_variants = cost_variants(scope.engines, scope.depth)
    variants_of_other_scenes = all_variants
    if not limits.equal_error:
        labels = {variant.label for variant in variants(scope.engines, scope.depth)}
        variants_of_other_scenes = tuple(
            variant for variant in all_variants if variant.label in labels
        )

    def timed(scene: Scene, variants_of_scene: Sequence[Variant]) -> Comparison[Timed]:
        return work_precision(
            scene,
            scaled(variants_of_scene, scene, scope.t_end),
            t_end=scope.t_end,
            repeats=scope.repeats or limits.repeats,
            budget_s=limits.ladder,
        )

    first_scene, *other_scenes = scope.scenes
    comparisons = [timed(first_scene, all_variants)]
    comparisons += [timed(scene, variants_of_other_scenes) for scene in other_scenes]
    if limits.equal_error and scope.is_of_paper:
        comparisons += [timed(load_scene(name), all_variants) for name in OTHER_MECHANISMS]
    number_of_cases = len(scope.scenes)
    return side_by_side(comparisons, lambda yields: _tables(yields, number_of_cases))


def _tables(yields: Sequence[Timed], number_of_cases: int) -> Tables:
    """Return the tables of the study from the yields of each scene, of which the first are the cases.

    `equal_error` is evaluated separately for the cases and for the other mechanisms: the limit of a method in its table
    is that over all scenes that it receives, and is to be the same at every depth.
    """
    cases, others = yields[:number_of_cases], yields[number_of_cases:]
    equal = [
        equal_error(
            _concatenated(timed.table for timed in part),
            _concatenated(timed.samples for timed in part),
        )
        for part in (cases, others)
        if part
    ]
    tables = {
        "cost": _concatenated(timed.table for timed in cases),
        "equal-error": _concatenated(equal),
        "times": _concatenated(timed.samples for timed in yields),
    }
    return Tables(tables, timed=tuple(record for timed in cases for record in timed.records))


def _concatenated(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of all tables; an empty table if there are none."""
    return pd.concat([pd.DataFrame(), *tables], ignore_index=True)


def present(results: Results) -> Presentation:
    """Present the CPU time to an error of `TARGET`, times to other errors, and what limits the error of each method."""
    cost = with_columns(results.table("cost"), *NEEDED)
    cost = cost[cost["status"] != Status.MISSING]
    if cost.empty:
        return Presentation()
    if not _is_measured(cost).any():
        return Presentation(rows={"measured": False, **CONSTANTS})
    first = cost["scene"].iloc[0]
    equal = _times_to_position(results, cost)
    reached = equal[(equal["scene"] == first) & (equal["error"] == TARGET) & equal[TOTAL].notna()]
    is_joint = reached["fidelity"] == Fidelity.JOINT
    is_contact = reached["fidelity"] == Fidelity.CONTACT
    scenes = list(equal["scene"].unique())
    by_scene = [_by_method(cost, equal[equal["scene"] == scene], scene, first) for scene in scenes]
    rows = {
        "measured": True,
        "first": first,
        "several_cases": cost["scene"].nunique() > 1,
        "own": _times_of_own_methods(reached),
        "joints": _shortest_and_longest(reached[reached["steps"] & is_joint]),
        "contacts": _shortest_and_longest(reached[reached["steps"] & is_contact]),
        "any": _shortest_and_longest(reached),
        **_off_target_rows(cost, reached, first),
        **_limits_of_methods(cost, equal),
        "accelerations": _better_by_accelerations(cost, first),
        "set_up": _longest_set_up(cost),
        "unsure": int(_is_unsure(cost).sum()),
        "timed": int(_is_timed(cost).sum()),
        "load": _largest_load(results.table("times")),
        "first_run": _longest_compilation(cost),
        "scene_of_table": {table.name: scene for table, scene in zip(by_scene, scenes)},
        **CONSTANTS,
    }
    return Presentation(
        rows=rows,
        headlines=_headlines(results, cost, reached, first),
        tables=[*by_scene, _limits(cost, equal), _every_run(cost)],
        figures=[_figure(results, cost)],
    )


def _is_measured(cost: pd.DataFrame) -> pd.Series:
    """Return a mask of the runs that reached their end and have an error."""
    return succeeded(cost) & cost[ERROR].notna()


def _is_timed(cost: pd.DataFrame) -> pd.Series:
    """Return a mask of the runs that were timed."""
    return cost[TOTAL].notna() & cost["repeats"].gt(0)


def _is_unsure(cost: pd.DataFrame) -> pd.Series:
    """Return a mask of the timed runs whose time is unsure, for the reasons in `TIMING`."""
    return _is_timed(cost) & cost[TIMING].astype(object).fillna("").ne("")


def _times_to_position(results: Results, cost: pd.DataFrame) -> pd.DataFrame:
    """Return the times to position errors on the scenes of `cost`, of variants with a run that succeeded.

    The column ``steps`` is true for external engines that are refined by their step.
    """
    equal = with_columns(results.table("equal-error"), *COLUMNS)
    is_shown = (
        equal["quantity"].eq(QUANTITIES[0].name)
        & equal["scene"].isin(cost["scene"])
        & equal["because"].ne(FAILED)
    )
    is_stepped_engine = (cost["parameter"] == "dt") & ~cost["engine"].isin(own_methods())
    stepped_engines = cost.loc[is_stepped_engine, "variant"]
    return equal[is_shown].assign(
        is_bound=equal["is_bound"].eq(True), steps=equal["variant"].isin(stepped_engines)
    )


def _sign(time: Mapping[Hashable, Any], bound: str) -> str:
    """Return the sign of a bound, followed by `UNSURE` if the time is unsure."""
    is_unsure = isinstance(time[TIMING], str) and time[TIMING] != ""
    return bound + UNSURE if is_unsure else bound


def _bound_sign(time: Mapping[Hashable, Any]) -> str:
    """Return the sign before a time to an error: ``≤`` if even the coarsest run has a smaller error."""
    return _sign(time, "≤ " if time["is_bound"] else "")


def _time_to(equal: pd.DataFrame, label: object) -> dict[str, object]:
    """Return the total time to an error, as a cell, and the sign before it."""
    sign = _bound_sign(equal.loc[label].to_dict())
    return {"time": row_of("equal-error", equal, label)[TOTAL], "sign": sign}


def _shortest_and_longest(equal: pd.DataFrame) -> list[dict[str, object]]:
    """Return the shortest and the longest time to an error: one if they are the same, none if there are no times."""
    if equal.empty:
        return []
    labels = dict.fromkeys((equal[TOTAL].idxmin(), equal[TOTAL].idxmax()))
    return [_time_to(equal, label) for label in labels]


def _times_of_own_methods(reached: pd.DataFrame) -> list[dict[str, object]]:
    """Return the times of the reference and of the paper's scheme."""
    return [
        {"variant": variant, **_time_to(reached, label)}
        for variant in (REFERENCE, PAPERS_SCHEME)
        for label in reached.index[reached["variant"] == variant]
    ]


def _off_target_rows(
    cost: pd.DataFrame, reached: pd.DataFrame, first: str
) -> dict[str, list[object]]:
    """Return the engines without a run accurate to `TARGET` on the first scene, and their smallest steps.

    A run with a smaller step might be accurate.
    """
    runs = cost[_is_measured(cost) & (cost["scene"] == first) & (cost["parameter"] == "dt")]
    runs = runs[~runs["engine"].isin(own_methods()) & ~runs["variant"].isin(reached["variant"])]
    finest = runs.groupby("variant", sort=False)["step"].idxmin()
    return {
        "without": list(finest.index),
        "off_target": [
            {"variant": variant, "step": row_of("cost", cost, label)["step"]}
            for variant, label in finest.items()
        ],
    }


def _limits_of_methods(cost: pd.DataFrame, equal: pd.DataFrame) -> dict[str, object]:
    """Return the number of methods whose error still decreases at the finest runs, and the limits of the others."""
    by_limit = equal.drop_duplicates("variant").groupby("because", sort=False)["variant"].agg(list)
    falling = by_limit.get(INTEGRATION, [])
    others = [
        {"limit": limit, "variants": variants_of_limit}
        for limit, variants_of_limit in by_limit.items()
        if limit != INTEGRATION
    ]
    runs_of_falling = cost[_is_measured(cost) & cost["variant"].isin(falling)]
    return {
        "falling": len(falling),
        "methods": sum(map(len, by_limit)),
        "limited": others,
        "level": list(_level(runs_of_falling)),
    }


def _level(runs: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yield the variants and scenes in which the error hardly decreases between the last two runs, or increases."""
    for (variant, scene), series in runs.groupby(["variant", "scene"], sort=False):
        is_known = series[ERROR] > series[UNCERTAINTY]
        last_two = series[is_known & (series["parameter"] != "iterations")].iloc[-2:]
        if len(last_two) < 2:
            continue
        error_ratio = last_two[ERROR].iloc[1] / last_two[ERROR].iloc[0]
        step_ratio = last_two["step"].iloc[1] / last_two["step"].iloc[0]
        if error_ratio > step_ratio**FALLS:
            yield {"variant": variant, "scene": scene}


def _method_of(runs: pd.DataFrame) -> pd.Series:
    """Return the method in the settings of each run; empty where the settings name none."""
    stated = runs["settings"].map(
        lambda settings: json.loads(settings).get("method"), na_action="ignore"
    )
    return stated.fillna("")


def _better_by_accelerations(cost: pd.DataFrame, first: str) -> dict[str, object] | None:
    """Compare the steps of engines with our integrator on the accelerations that the same engines compute.

    Return the engines whose smallest error is that with our integrator. With them are, over these engines, the
    largest of their smallest errors with our integrator, and the smallest with their own steps. None if there are no
    such engines.
    """
    rows = cost[
        _is_measured(cost) & (cost["scene"] == first) & (cost["fidelity"] == Fidelity.JOINT)
    ]
    rows = rows.assign(is_integrated=_method_of(rows).eq("accelerations"))
    integrated_labels, stepped_labels = [], []
    for _, runs in rows.groupby("engine", sort=False):
        integrated = runs.loc[runs["is_integrated"], ERROR]
        stepped = runs.loc[~runs["is_integrated"] & (runs["parameter"] == "dt"), ERROR]
        if len(integrated) and len(stepped) and integrated.min() < stepped.min():
            integrated_labels.append(integrated.idxmin())
            stepped_labels.append(stepped.idxmin())
    if not integrated_labels:
        return None
    worst_integrated = cost.loc[integrated_labels, ERROR].idxmax()
    best_stepped = cost.loc[stepped_labels, ERROR].idxmin()
    return {
        "variants": list(cost.loc[stepped_labels, "variant"]),
        "integrated": row_of("cost", cost, worst_integrated)[ERROR],
        "stepped": row_of("cost", cost, best_stepped)[ERROR],
    }


def _longest_set_up(cost: pd.DataFrame) -> dict[str, object]:
    """Return the longest time before the first step, of the reference and of the engines; None if not measured."""
    times = cost.loc[_is_measured(cost) & cost[SET_UP].notna(), [SET_UP, "variant", "engine"]]
    parts = {
        "reference": times.loc[times["variant"] == REFERENCE, SET_UP],
        "engines": times.loc[times["engine"] != REFERENCE, SET_UP],
    }
    return {
        name: row_of("cost", cost, part.idxmax())[SET_UP] if len(part) else None
        for name, part in parts.items()
    }


def _longest_compilation(cost: pd.DataFrame) -> Row | None:
    """Return the run that took longest to load compiled code, which happens in the first run of a process."""
    times = cost.loc[_is_measured(cost) & cost[COMPILATION].gt(0), COMPILATION].astype(float)
    return row_of("cost", cost, times.idxmax()) if len(times) else None


def _largest_load(times: pd.DataFrame) -> object:
    """Return the largest load by other programs in a round of timing; None if it was not measured."""
    if OTHERS not in times or times[OTHERS].isna().all():
        return None
    return row_of("times", times, times[OTHERS].idxmax())[OTHERS]


def _headlines(
    results: Results, cost: pd.DataFrame, reached: pd.DataFrame, first: str
) -> list[Headline]:
    """Return the total time (ms) to `TARGET` of each method, with the engine's part in brackets if it is less.

    For a method that does not reach `TARGET` the time of its finest run is a lower bound.
    """
    timed = cost[_is_measured(cost) & _is_timed(cost) & (cost["scene"] == first)]
    cells = {}
    for variant in methods(results):
        times = reached[reached["variant"] == variant].to_dict("records")
        runs = timed[timed["variant"] == variant].to_dict("records")
        if times:
            total, engines_part = times[0][TOTAL], times[0][OWN_CPU]
            cells[variant] = bounded(MILLI * total, _bound_sign(times[0]))
            if engines_part != total:
                cells[variant] += f" ({bounded(MILLI * engines_part, '')})"
        elif runs:
            finest = runs[-1]
            cells[variant] = bounded(MILLI * finest[TOTAL], _sign(finest, "> "))
    if not cells:
        return []
    label = f"CPU time for an error of {MILLI * TARGET:g} mm (engine's part) in {results.title_of(first)} [ms]"
    return [Headline(label, cells)]


def _by_method(cost: pd.DataFrame, equal: pd.DataFrame, scene: str, first: str) -> TableView:
    """Return the table of the times to `ERRORS` on a scene, a row per method.

    The report contains the table of the first scene, and those of scenes that are not part of a validation.

    Parameters
    ----------
    cost : DataFrame
        All runs.
    equal : DataFrame
        Times to errors on this scene.
    """
    rows = []
    for group, runs_of_group in groups(cost[cost["variant"].isin(equal["variant"])]):
        for variant in dict.fromkeys(runs_of_group["variant"]):
            is_run = (runs_of_group["variant"] == variant) & (runs_of_group["scene"] == scene)
            times = equal[equal["variant"] == variant]
            row = {"group": group.label, "variant": variant}
            row |= _times_to_errors(times, runs_of_group[is_run])
            rows.append((row, times))
    columns = [
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
    # Names of tables are names of files.
    name = "cost" if scene == first else f"cost-{scene.replace('/', '-')}"
    return view(
        name,
        rows,
        [METHOD, *columns],
        source="equal-error",
        group="group",
        in_report=scene == first or scene not in SCENES,
    )


def _times_to_errors(times: pd.DataFrame, runs: pd.DataFrame) -> dict[str, object]:
    """Return the cells of a method with its times to `ERRORS` on a scene; `runs` are its runs there."""
    cells: dict[str, object] = {}
    reached = times[times[TOTAL].notna()].to_dict("records")
    for time in reached:
        cells |= _cells(time, time["error"], _bound_sign(time))
    if not reached:
        return cells
    # A method may be as accurate as the truth. Then smaller errors cannot be measured, and the time
    # to the smallest error that can be is a lower bound of the times to smaller ones.
    if times[SMALLEST].iloc[0] <= runs[UNCERTAINTY].max():
        last = reached[-1]
        for error in ERRORS:
            if error < last["error"]:
                cells |= _cells(last, error, _sign(last, "≥ "))
    return cells


def _cells(time: Mapping[Hashable, Any], error: float, sign: str) -> dict[str, object]:
    """Return the columns of the time to an error, with the sign before it."""
    return {
        f"{TOTAL} {error:g}": time[TOTAL],
        f"{OWN_CPU} {error:g}": time[OWN_CPU],
        f"bound {error:g}": sign,
    }


def _limits(cost: pd.DataFrame, equal: pd.DataFrame) -> TableView:
    """Return the table of the smallest error and the limit of each method, and of the costs before the first step."""
    rows = []
    for variant, times in equal.groupby("variant", sort=False):
        runs = cost[cost["variant"] == variant]
        completed = runs[succeeded(runs)]
        limit = times.iloc[0]  # the same in all rows of a variant
        row = {
            "variant": variant,
            ERROR: times[SMALLEST].max(),
            "order": limit["order"],
            "order uncertainty": limit["order_uncertainty"],
            "limit": limit["because"],
            "why": limit["why"],
            "setup_cpu_time": completed[SET_UP].median(),
            "compile_cpu_time": completed[COMPILATION].max(),
            "unsure": f"{_is_unsure(runs).sum()} of {_is_timed(runs).sum()}",
            **completed.iloc[0][[FRICTION_BY, EVENTS_BY]],
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
    """Return the table of all timed runs."""
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


def _figure(results: Results, cost: pd.DataFrame) -> Chart:
    """Return the work-precision diagram: error over total time.

    It shows the first variant of each engine, fidelity and method; other variants differ in one setting. An asterisk
    marks methods whose friction law or event location is, at least in part, the work of the adapter.
    """
    drawn = cost[_is_measured(cost) & _is_timed(cost) & cost[ERROR].gt(0)]
    drawn = drawn.assign(method=_method_of(drawn))
    first_variants = drawn.drop_duplicates(["engine", "fidelity", "method"])["variant"]
    drawn = drawn[drawn["variant"].isin(first_variants)]
    friction, events = (known_of(drawn, column) for column in (FRICTION_BY, EVENTS_BY))
    helped_by_adapter = {
        variant
        for variant in friction
        if {friction[variant], events[variant]} & {Supplier.ADAPTER, Supplier.BOTH}
    }
    target_times = drawn[TOTAL].agg(["min", "max"]).to_numpy(float)

    def series(rows: pd.DataFrame) -> list[Series]:
        lines = [
            Series(
                f"{variant} *" if variant in helped_by_adapter else variant,
                runs[TOTAL].to_numpy(float),
                runs[ERROR].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, runs in rows.groupby("variant", sort=False)
        ]
        if not lines:
            return []
        target = Series("", target_times, np.full(len(target_times), TARGET), look=LIMIT)
        return [*lines, target]

    x = Axis("total CPU time [s]", log=True)
    label = quantity_of("position_error").head
    return chart_by_case("work-precision", drawn, x, label, series, results.title_of)


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
    nightly=NightlyNumbers((TIME,)),
)
