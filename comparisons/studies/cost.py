"""Cost of accuracy: CPU time over error on all cases, times to given errors, and what limits each method."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import (
    MISSING_ENGINE,
    called,
    case_of,
    groups,
    known_of,
    methods,
    succeeded,
    with_columns,
)
from stiction.comparisons.bench.participants import REFERENCE, cost_variants, extent, variants
from stiction.comparisons.bench.presentation import (
    LIMIT,
    Axis,
    Chart,
    Column,
    Headline,
    Number,
    Part,
    Presentation,
    Series,
    TableView,
    TracedText,
    count,
    listed,
    scaled_value,
    sentence,
    traced,
    value,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.timed_runs import OTHERS
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
from stiction.engines.registry import OWN_METHODS
from stiction.scenes import Scene, load_scene
from stiction.uncertain import bounded

PAPER, SET_UP, COMPILATION = "paper's scheme", "setup_time", "compile_time"
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
"""Metres: the error at which methods are compared in words."""
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Metres: the errors of the tables."""
UNSURE = "~"
"""Sign before a time that is unsure, for the reasons in `TIMING`."""
MILLI = 1e3
"""Milliseconds in a second, millimetres in a metre."""
MILLIMETRE = f"{MILLI * TARGET:g} mm"
NOTES = (
    "CPU time is that of the whole run, our adapter included; in brackets the part inside the engine's own calls. "
    "Without brackets both are equal. Set-up and compilation are not in it.",
    "Times are medians of runs in rounds. Between two runs of a refinement series log(time) is linear in "
    "log(error); nothing is extrapolated. Runs beyond the time of their series were timed once.",
    "≤: the coarsest run already has a smaller error. ≥: below the uncertainty of the truth. –: no run is as "
    "accurate; >: than the finest run, which is not. ~: of fewer than five rounds, or with a wide interval.",
    "A limit follows from the order of the error over step or tolerance at the finest runs of all cases. "
    "integration: a finer run would go on. model: contacts, or the engine's own equations. adapter: "
    "what we add to the engine. truth: below the uncertainty of the truth. inconclusive: the order allows both.",
)


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
    cost = cost[cost["status"] != MISSING_ENGINE]
    if cost.empty:
        return Presentation()
    if not _measured(cost).any():
        return Presentation(TracedText("No timed run succeeded, so that nothing is known of cost."))
    first = cost["scene"].iloc[0]
    equal = _times_to_position(results, cost)
    reached = equal[(equal["scene"] == first) & (equal["error"] == TARGET) & equal[TOTAL].notna()]
    findings = [
        sentence(
            "Engines with contacts take {} ms to it, each against the truth of its own friction law.",
            _engines(reached, "contact"),
        ),
        sentence(
            "No run of {} is accurate to {} there.",
            listed(_without(cost, reached, first), last=" or "),
            MILLIMETRE,
        ),
        *_limited(cost, equal),
        _accelerations(cost, first),
        _set_up(cost),
        _unsure(cost),
        _load(results.table("times")),
    ]
    tables = [
        _table(cost, rows, str(scene), first) for scene, rows in equal.groupby("scene", sort=False)
    ]
    every = (
        Column("scene"),
        Column("variant", "method"),
        Column("parameter", "refined by"),
        Column("step", form="g"),
        Column("status"),
        Column("reason"),
        Column(TOTAL, "CPU", "ms", scale=MILLI, second=OWN_CPU),
        Column(SET_UP, "set-up", "ms", scale=MILLI, form=".2g"),
        Column(ERROR, "position error"),
        Column(ORDER, "order"),
        Column("torque_error", "torque error, mean"),
        Column("event_time_error", "event time error"),
        Column(TIMING),
    )
    runs = view(
        "cost-all",
        cost,
        every,
        source="cost",
        in_report=False,
        caption="Every run of the refinement series.",
    )
    return Presentation(
        _answer(reached, first),
        findings,
        _headlines(results, cost, reached, first),
        [*tables, _limits(cost, equal), runs],
        [_figure(cost)],
        NOTES,
        _first_run(cost),
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
    steps = cost.loc[(cost["parameter"] == "dt") & ~cost["engine"].isin(OWN_METHODS), "variant"]
    return equal[there].assign(
        **{"is_bound": equal["is_bound"].eq(True), "steps": equal["variant"].isin(steps)}
    )


def _sign(time: Mapping[Hashable, Any], bound: str) -> str:
    """The sign of a bound, and `UNSURE` where the time is."""
    return bound + (UNSURE if isinstance(time[TIMING], str) and time[TIMING] else "")


def _bounded(rows: pd.DataFrame, label: int) -> Number:
    """A total time to an error in ms, with ``≤`` where the coarsest run already meets it, and `UNSURE`."""
    sign = _sign(rows.loc[label].to_dict(), "≤ " if rows.at[label, "is_bound"] else "")
    return scaled_value("equal-error", rows, label, TOTAL, sign)


def _range(rows: pd.DataFrame) -> TracedText:
    ends = dict.fromkeys((rows[TOTAL].idxmin(), rows[TOTAL].idxmax())) if len(rows) else ()
    return listed([_bounded(rows, label) for label in ends], last=" to ")


def _engines(reached: pd.DataFrame, fidelity: str) -> TracedText:
    """`_range` of engines with steps, our own methods not among them."""
    return _range(reached[reached["steps"] & (reached["fidelity"] == fidelity)])


def _answer(reached: pd.DataFrame, first: str) -> TracedText:
    if reached.empty:
        return traced("No run is accurate to {} in {}.", MILLIMETRE, case_of(first))
    parts: list[Part] = [
        traced("{} {} ms", called(variant), _bounded(reached, int(label)))
        for variant in (REFERENCE, PAPER)
        for label in reached.index[reached["variant"] == variant]
    ]
    parts += filter(None, [sentence("engines with ideal joints {} ms", _engines(reached, "joint"))])
    return traced(
        "CPU to an error of {} in {}: {}.",
        MILLIMETRE,
        case_of(first),
        listed(parts or [traced("engines {} ms", _range(reached))]),
    )


def _without(cost: pd.DataFrame, reached: pd.DataFrame, first: str) -> list[str]:
    """Names of the engines without a run that is accurate to `TARGET`; a finer one might be."""
    made = cost[_measured(cost) & (cost["scene"] == first) & (cost["parameter"] == "dt")]
    made = made[~made["engine"].isin(OWN_METHODS) & ~made["variant"].isin(reached["variant"])]
    return [called(variant) for variant in dict.fromkeys(made["variant"])]


def _limited(cost: pd.DataFrame, equal: pd.DataFrame) -> Iterator[TracedText]:
    """The methods whose error no longer falls, or may not, by their limit, and the cases where others' does not."""
    limits = equal.drop_duplicates("variant").groupby("because", sort=False)["variant"].agg(list)
    falling = limits.pop(INTEGRATION) if INTEGRATION in limits else []
    where = "Fitted over all cases, the error" if cost["scene"].nunique() > 1 else "The error"
    others = [
        traced("{} ({})", listed([called(variant) for variant in names]), str(limit))
        for limit, names in limits.items()
    ]
    yield traced(
        "{} of {} of {} methods still falls at the finest runs.",
        where,
        str(len(falling)),
        str(len(falling) + sum(map(len, limits))),
    )
    yield sentence("Limits of the others: {}.", listed(others, "; ", "; "))
    level = []
    for (variant, scene), runs in cost[_measured(cost) & cost["variant"].isin(falling)].groupby(
        ["variant", "scene"], sort=False
    ):
        last = runs[(runs[ERROR] > runs[UNCERTAINTY]) & (runs["parameter"] != "iterations")].iloc[
            -2:
        ]
        if (
            len(last) == 2
            and last[ERROR].iloc[1]
            > last[ERROR].iloc[0] * (last["step"].iloc[1] / last["step"].iloc[0]) ** FALLS
        ):
            level.append(f"{called(variant)} in {case_of(scene)}")
    yield sentence(
        "Between the last two runs it hardly falls, or rises: {}.", listed(level, "; ", "; ")
    )


def _accelerations(cost: pd.DataFrame, first: str) -> TracedText:
    """Engines whose accelerations, under our integrator, come closer than their own steps do."""
    rows = cost[_measured(cost) & (cost["scene"] == first) & (cost["fidelity"] == "joint")]
    methods_of = rows["settings"].map(lambda settings: json.loads(settings).get("method"))
    closer = []
    for _, found in rows.assign(ours=methods_of.eq("accelerations")).groupby("engine", sort=False):
        ours, own = (
            found.loc[found["ours"], ERROR],
            found.loc[~found["ours"] & (found["parameter"] == "dt"), ERROR],
        )
        if len(ours) and len(own) and ours.min() < own.min():
            closer.append((ours.idxmin(), own.idxmin()))
    if not closer:
        return TracedText()
    ours, own = (cost.loc[list(rows)] for rows in zip(*closer))
    worst, best = ours[ERROR].idxmax(), own[ERROR].idxmin()
    names = listed([called(variant) for variant in own["variant"]])
    return traced(
        "Under our integrator the accelerations of {} lead to {} m in {}, with {} own steps to {} m.",
        names,
        value("cost", cost, int(worst), ERROR),
        case_of(first),
        "its" if len(own) == 1 else "their",
        value("cost", cost, int(best), ERROR),
    )


def _set_up(cost: pd.DataFrame) -> TracedText:
    """The longest time before the first step, of the reference and of the engines."""
    times = cost.loc[_measured(cost) & cost[SET_UP].notna(), [SET_UP, "variant", "engine"]]
    longest = (
        ("the reference", times.loc[times["variant"] == REFERENCE, SET_UP]),
        ("the engines", times.loc[times["engine"] != REFERENCE, SET_UP]),
    )
    return sentence(
        "Set-up comes on top: {}.",
        listed(
            [
                traced(
                    "{} ms for {}",
                    scaled_value("cost", cost, int(found.idxmax()), SET_UP, "≤ "),
                    name,
                )
                for name, found in longest
                if len(found)
            ]
        ),
    )


def _first_run(cost: pd.DataFrame) -> TracedText:
    """The longest time that the first run of a process takes to load what is compiled."""
    times = cost.loc[_measured(cost) & cost[COMPILATION].gt(0), COMPILATION].astype(float)
    if times.empty:
        return TracedText()
    row = int(times.idxmax())
    return traced(
        "The first run of a process takes up to {} ms more ({}).",
        Number(
            bounded(MILLI * times[row], "≤").removeprefix("≤"),
            "cost",
            COMPILATION,
            rows=(row + 1,),
            factor=MILLI,
        ),
        called(cost.at[row, "variant"]),
    )


def _unsure(cost: pd.DataFrame) -> TracedText:
    if not _is_unsure(cost).any():
        return TracedText()
    marked, rounds = (
        frozenset(cost.loc[_is_unsure(cost), TIMING]),
        frozenset(cost.loc[_is_timed(cost), "repeats"]),
    )
    return traced(
        "The times of {} of {} runs are unsure: of fewer than five rounds, or with an interval wider than a "
        "quarter. A time to an error is marked ~ by its own interval.",
        count("cost", cost, **{TIMING: marked, "repeats": rounds}),
        count("cost", cost, repeats=rounds),
    )


def _load(times: pd.DataFrame) -> TracedText:
    """The largest load by others in a round."""
    if OTHERS not in times or times[OTHERS].isna().all():
        return TracedText()
    most = value("times", times, int(times[OTHERS].idxmax()), OTHERS, ".2g")
    return traced("While runs were timed, other programs kept up to {} cores busy.", most)


def _headlines(
    results: Results, cost: pd.DataFrame, reached: pd.DataFrame, first: str
) -> tuple[Headline, ...]:
    """Total time to `TARGET`, in brackets the engine's part if less; above the finest run's if none is so exact."""
    timed, cells = cost[_measured(cost) & _is_timed(cost) & (cost["scene"] == first)], {}
    for variant in methods(results):
        there, runs = (rows.index[rows["variant"] == variant] for rows in (reached, timed))
        if len(there):
            row = int(there[0])
            own = (
                ""
                if reached.at[row, OWN_CPU] == reached.at[row, TOTAL]
                else traced(" ({})", scaled_value("equal-error", reached, row, OWN_CPU))
            )
            cells[variant] = traced("{}{}", _bounded(reached, row), own)
        elif len(runs):
            sign = _sign(timed.loc[runs[-1]].to_dict(), "> ")
            cells[variant] = traced("{}", scaled_value("cost", cost, int(runs[-1]), TOTAL, sign))
    return (
        (Headline(f"CPU to {MILLIMETRE}, {case_of(first)} (engine's part) [ms]", cells),)
        if cells
        else ()
    )


def _table(cost: pd.DataFrame, here: pd.DataFrame, scene: str, first: str) -> TableView:
    """Times to `ERRORS` on a scene, a row a method; of the scenes of a validation the report has the first."""
    rows = []
    for group, part in groups(cost[cost["variant"].isin(here["variant"])]):
        for variant in dict.fromkeys(part["variant"]):
            times, row = (
                here[here["variant"] == variant],
                {"group": group.label, "variant": variant},
            )
            reached = times[times[TOTAL].notna()].to_dict("records")
            for time in reached:
                row |= _cells(time, time["error"], "≤ " if time["is_bound"] else "")
            runs = part[(part["variant"] == variant) & (part["scene"] == scene)]
            if reached and times[SMALLEST].iloc[0] <= runs[UNCERTAINTY].max():
                # smaller errors cannot be measured
                for error in ERRORS:
                    row |= _cells(reached[-1], error, "≥ ") if error < reached[-1]["error"] else {}
            rows.append((row, times))
    columns = [
        Column("variant", "method"),
        *(
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
        ),
    ]
    caption = (
        f"CPU time to a position error in {case_of(scene)}: total, in brackets the engine's part. "
        "Methods of one group may be compared; ranked are those that do the same part of the work."
    )
    name = "cost" if scene == first else f"cost-{scene.replace('/', '-')}"
    return view(
        name,
        rows,
        columns,
        source="equal-error",
        group="group",
        in_report=scene == first or scene not in SCENES,
        caption=caption,
    )


def _cells(time: Mapping[Hashable, Any], error: float, sign: str) -> dict[str, object]:
    """Columns of the time to an error, which may be a bound."""
    return {
        f"{TOTAL} {error:g}": time[TOTAL],
        f"{OWN_CPU} {error:g}": time[OWN_CPU],
        f"bound {error:g}": _sign(time, sign),
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
        Column("variant", "method"),
        Column(ERROR, "smallest_error"),
        Column("order", uncertainty="order uncertainty", interval=True),
        Column("limit"),
        Column("setup_cpu_time", "set-up", "ms", scale=MILLI),
        Column("compile_cpu_time", "compilation", "ms", scale=MILLI),
        Column("unsure", "timings unsure"),
        Column(FRICTION_BY, "friction law supplied by"),
        Column(EVENTS_BY),
        Column("why"),
    )
    caption = (
        "The smallest error of each refinement series (of several cases the worst), the order at its finest "
        "runs, and what limits it. Set-up: median; compilation: once a process, at most."
    )
    return view(
        "cost-limits",
        rows,
        columns,
        source="cost",
        in_report=False,
        caption=caption,
    )


def _figure(cost: pd.DataFrame) -> Chart:
    """Error over total time, of the first variant of each engine, fidelity and method; others change a setting."""
    drawn = cost[_measured(cost) & _is_timed(cost) & cost[ERROR].gt(0)]
    method = (
        drawn["settings"]
        .map(lambda settings: json.loads(settings).get("method"), na_action="ignore")
        .fillna("")
    )
    first = drawn.assign(method=method).drop_duplicates(["engine", "fidelity", "method"])
    drawn = drawn[drawn["variant"].isin(first["variant"])]
    friction, events = (known_of(drawn, column) for column in (FRICTION_BY, EVENTS_BY))
    ours = {
        variant
        for variant in friction
        if {friction[variant], events[variant]} & {Supplier.ADAPTER, Supplier.BOTH}
    }

    ends = drawn[TOTAL].agg(["min", "max"]).to_numpy(float)

    def series(here: pd.DataFrame) -> list[Series]:
        found = [
            Series(
                f"{variant} *" if variant in ours else variant,
                runs[TOTAL].to_numpy(float),
                runs[ERROR].to_numpy(float),
                look=variant,
                points=True,
            )
            for variant, runs in here.groupby("variant", sort=False)
        ]
        return [*found, Series("", ends, ends * 0 + TARGET, look=LIMIT)] if found else []

    chart = chart_by_case(
        "work-precision",
        drawn,
        Axis("total CPU time [s]", log=True),
        "position_error",
        series,
    )
    return replace(
        chart,
        caption="Position error over total CPU time, a line a refinement series: down and to the left is "
        "better. A row of panels holds methods at the same fidelity and physics. *: our adapter does a part of the "
        "work, the friction law or the location of events, whose time is included. Dotted: 1 mm.",
    )


STUDY = Study(
    "cost",
    "Cost",
    "What does accuracy cost?",
    present,
    plan,
    seconds=0.13,
    takes=frozenset({"engines", "t_end", "repeats", "scenes"}),
)
