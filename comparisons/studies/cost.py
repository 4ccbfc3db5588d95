"""Cost of accuracy: CPU time over error on all cases, times to given errors, and what limits each method."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.campaigns.participants import REFERENCE, cost_variants, extent, variants
from stiction.comparisons.methods import MISSING_ENGINE, called, case_of, groups, methods, title_of
from stiction.comparisons.presentation.charts import Axis, Chart, Panel, Series
from stiction.comparisons.presentation.presentation import Headline, Presentation
from stiction.comparisons.presentation.table_view import Column, TableView, view
from stiction.comparisons.presentation.traced_text import (Number, Part, TracedText, count, listed, short, traced,
                                                           value)
from stiction.comparisons.results import Results
from stiction.comparisons.studies.equal_error import (ADAPTER, INTEGRATION, LOST, MODEL, QUANTITIES, SCENES, TRUTH,
                                                      UNKNOWN, LadderEnd, accelerations_of, equal_error, ladder_end)
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.studies.work_precision import TIMING, Timed, came_out, work_precision
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import EVENTS_BY, FRICTION_BY, OWN_CPU, Variant, scaled
from stiction.scenes import Scene, load_scene

PAPER, TOTAL = "paper's scheme", "cpu [s]"
POSITION = QUANTITIES[0]
TARGET = 1e-3
"""Metres: the error at which methods are compared in words."""
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Metres: the errors of the tables."""
MILLI = 1e3
"""Milliseconds in a second, millimetres in a metre."""
LIMITS = {UNKNOWN: "The runs do not show whether it goes on falling for {}.",
          MODEL: "It no longer falls, because of contacts or the engine's own equations, for {}.",
          ADAPTER: "It no longer falls, because of what our adapter adds, for {}.",
          TRUTH: "It is below the uncertainty of the truth for {}."}
NOTES = ("CPU time is that of the whole run, our adapter included; in brackets the part inside the engine's own calls. "
         "Of the reference both are the same. Set-up and compilation are not in it.",
         "Times are medians of runs in rounds. Between two runs of a refinement series log(time) is linear in "
         "log(error); nothing is extrapolated. ≤: the coarsest run already has a smaller error. –: no timed run is as "
         "accurate; >: than the finest timed run, which is not.",
         "The order is that of the error over step or tolerance at the finest runs, one for all cases, ± its 95 % "
         "interval. integration: a finer run would go on. model: contacts, or the engine's own equations. adapter: "
         "what we add to the engine. truth: below the uncertainty of the truth. inconclusive: the order allows both.")


def plan(scope: Scope) -> Comparison[Tables]:
    """Refinement series of all methods on all scenes, timed in the same rounds; at full depth of other mechanisms, too.

    Variants without runs in the other studies, such as accelerations under our integrator, are timed on the first scene
    only, unless the depth measures equal error everywhere.
    """
    limits = extent(scope.depth)
    chosen = cost_variants(scope.engines, scope.depth)
    compared = {variant.label for variant in variants(scope.engines, scope.depth)}
    few = chosen if limits.equal_error else tuple(variant for variant in chosen if variant.label in compared)

    def timed(scene: Scene, ways: Sequence[Variant]) -> Comparison[Timed]:
        return work_precision(scene, scaled(ways, scene, scope.t_end), t_end=scope.t_end,
                              repeats=scope.repeats or limits.repeats, budget_s=limits.ladder)

    first, *others = scope.scenes
    cases = [timed(first, chosen), *(timed(scene, few) for scene in others)]
    known = {scene.name for scene in scope.scenes}
    more = [load_scene(name) for name in SCENES if name not in known] if limits.equal_error and others else []

    def combine(found: list[Timed]) -> Tables:
        parts = [part for part in (found[:len(cases)], found[len(cases):]) if part]
        equal = [equal_error(_joined([one.table for one in part]), _joined([one.samples for one in part]))
                 for part in parts]
        tables = {"cost": _joined([one.table for one in parts[0]]), "equal-error": _joined(equal),
                  "times": _joined([one.samples for one in found])}
        return Tables(tables, timed=tuple(record for one in parts[0] for record in one.records))

    return side_by_side([*cases, *(timed(scene, chosen) for scene in more)], combine)


def _joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat([pd.DataFrame(), *tables], ignore_index=True)


def present(results: Results) -> Presentation:
    """CPU to a millimetre, what of it is the engine's, where refinement ends, and the times to other errors."""
    cost = results.table("cost")
    if cost.empty or not {"status", "variant", "scene"} <= set(cost):
        return Presentation()
    there = cost[cost["status"] != MISSING_ENGINE]
    if there.empty:
        return Presentation()
    if POSITION.error not in cost or not _measured(cost).any():
        return Presentation(TracedText("No timed run succeeded, so that nothing is known of cost."))
    first = cost["scene"].iloc[0]
    ends = limits_of(there)
    equal = _times(results.table("equal-error"), ends)
    here = equal[equal["scene"] == first] if len(equal) else equal
    findings = [_contacts(cost, here), _not_reached(cost, here, first), _adapters(cost, here),
                *_limited(ends, cost["scene"].nunique()), _accelerations(cost, first), _set_up(cost),
                _disturbed(cost)]
    tables = [table for scene in dict.fromkeys(cost["scene"]) if (table := _table(cost, equal, scene)) is not None]
    return Presentation(_answer(cost, here, first), tuple(finding for finding in findings if finding),
                        _headlines(results, cost, here, first), (*tables, _limits(cost, ends), _every_run(cost)),
                        (_figure(cost),), NOTES)


def limits_of(cost: pd.DataFrame) -> dict[str, LadderEnd]:
    """What limits the error of position of each variant that succeeded once, by label: over all scenes of the table."""
    if POSITION.error not in cost:
        return {}
    ends = {variant: ladder_end(rows, POSITION, accelerations_of(rows, cost))
            for variant, rows in cost.groupby("variant", sort=False)}
    return {variant: end for variant, end in ends.items() if end.because != LOST}


def _measured(cost: pd.DataFrame) -> pd.Series:
    """The runs that reached their end and have an error."""
    return came_out(cost) & cost[POSITION.error].notna()


def _times(equal: pd.DataFrame, ends: Mapping[str, LadderEnd]) -> pd.DataFrame:
    """The rows of times to an error of position, of variants that succeeded once; labels as in the whole table."""
    if equal.empty or TOTAL not in equal:
        return pd.DataFrame()
    equal = equal[(equal["quantity"] == POSITION.name) & equal["variant"].isin(list(ends))]
    return equal.assign(**{"at most": equal["at most"].eq(True)})


def _steps(cost: pd.DataFrame) -> list[str]:
    """Variants of external engines that take steps."""
    return list(dict.fromkeys(cost.loc[(cost["parameter"] == "dt") & (cost["engine"] != REFERENCE), "variant"]))


def _at_target(here: pd.DataFrame) -> pd.DataFrame:
    """The rows of times to `TARGET` that are reached."""
    return here[(here["error"] == TARGET) & here[TOTAL].notna()] if len(here) else here


def _ms(table: str, rows: pd.DataFrame, label: int, column: str) -> Number:
    """A time in milliseconds."""
    return Number(short(MILLI * rows.at[label, column]), table, column, rows=(label + 1,), factor=MILLI)


def _bounded(rows: pd.DataFrame, label: int) -> TracedText:
    """A total time to an error, with ``≤`` where the coarsest run already meets it."""
    return traced("≤ {}" if rows.at[label, "at most"] else "{}", _ms("equal-error", rows, label, TOTAL))


def _range(rows: pd.DataFrame) -> TracedText:
    """The least and the largest total time."""
    ends = dict.fromkeys((rows[TOTAL].idxmin(), rows[TOTAL].idxmax()))
    return listed([_bounded(rows, label) for label in ends], last=" to ")


def _answer(cost: pd.DataFrame, here: pd.DataFrame, first: str) -> TracedText:
    reached = _at_target(here)
    if reached.empty:
        return traced("No timed run is accurate to {} mm in {}.", f"{MILLI * TARGET:g}", case_of(first))
    joints = reached[reached["variant"].isin(_steps(cost)) & (reached["fidelity"] == "joint")]
    parts: list[Part] = [traced("{} {} ms", called(variant), _bounded(rows, int(rows.index[0])))
                         for variant in (REFERENCE, PAPER) if len(rows := reached[reached["variant"] == variant])]
    if len(joints):
        parts.append(traced("engines with ideal joints {} ms", _range(joints)))
    if not parts:
        parts.append(traced("engines {} ms", _range(reached)))
    return traced("CPU to an error of {} mm in {}: {}.", f"{MILLI * TARGET:g}", case_of(first), listed(parts))


def _contacts(cost: pd.DataFrame, here: pd.DataFrame) -> TracedText:
    rows = _at_target(here)
    if len(rows):
        rows = rows[rows["variant"].isin(_steps(cost)) & (rows["fidelity"] == "contact")]
    return traced("Engines with contacts take {} ms to it, each against the truth of its own friction law.",
                  _range(rows)) if len(rows) else TracedText("")


def _not_reached(cost: pd.DataFrame, here: pd.DataFrame, first: str) -> TracedText:
    """Whose timed runs all have a larger error; whether a finer one would do is not known."""
    timed = cost[_measured(cost) & (cost["scene"] == first) & _has_time(cost)]
    reached = set(_at_target(here)["variant"]) if len(here) else set()
    names = [called(variant) for variant in _steps(timed) if variant not in reached]
    return traced("No timed run of {} is accurate to {} mm there.", listed(names, last=" or "),
                  f"{MILLI * TARGET:g}") if names and len(here) else TracedText("")


def _adapters(cost: pd.DataFrame, here: pd.DataFrame) -> TracedText:
    """The least and the largest part that the engine's own calls have in the time to `TARGET`."""
    rows, engines = _at_target(here), cost.loc[cost["engine"] != REFERENCE, "variant"]
    rows = rows[rows["variant"].isin(engines)] if len(rows) else rows
    if len(rows) < 2:
        return TracedText("")
    part = rows[OWN_CPU] / rows[TOTAL]
    told = [traced("{} of {} ms for {}", _ms("equal-error", rows, label, OWN_CPU),
                   _ms("equal-error", rows, label, TOTAL), called(rows.at[label, "variant"]))
            for label in (part.idxmin(), part.idxmax())]
    return traced("The engine's own calls take between {} and {}; the rest is our adapter.", *told)


def _limited(ends: Mapping[str, LadderEnd], scenes: int) -> Iterator[TracedText]:
    """What limits accuracy: in short where the error of all methods falls, else by name."""
    by_limit = {limit: [called(variant) for variant, end in ends.items() if end.because == limit]
                for limit in (INTEGRATION, *LIMITS)}
    falling, others = by_limit.pop(INTEGRATION), sum(by_limit.values(), [])
    where = "Over all cases the error" if scenes > 1 else "The error"
    if falling and not others:
        yield TracedText(f"{where} of every method still falls at its finest steps: a finer one would go on.")
    elif falling and len(falling) > len(others):
        yield TracedText(f"{where} still falls at the finest steps of all methods but the next.")
    elif falling:
        yield traced("{} still falls at the finest steps for {}.", where, listed(falling))
    for limit, names in by_limit.items():
        if names:
            yield traced(LIMITS[limit], listed(names))


def _accelerations(cost: pd.DataFrame, first: str) -> TracedText:
    """Engines whose accelerations, under our integrator, come closer than their own steps do."""
    rows = cost[_measured(cost) & (cost["scene"] == first) & (cost["fidelity"] == "joint")]
    methods_of = rows["settings"].map(lambda settings: json.loads(settings).get("method"))
    ours, own = rows[methods_of == "accelerations"], rows[(methods_of != "accelerations") & (rows["parameter"] == "dt")]
    pairs = [(found[POSITION.error].idxmin(), steps[POSITION.error].idxmin())
             for engine, found in ours.groupby("engine", sort=False) if len(steps := own[own["engine"] == engine])]
    closer = [(ours_row, own_row) for ours_row, own_row in pairs
              if cost.at[ours_row, POSITION.error] < cost.at[own_row, POSITION.error]]
    if not closer:
        return TracedText("")
    worst = max((row for row, _ in closer), key=lambda row: cost.at[row, POSITION.error])
    best = min((row for _, row in closer), key=lambda row: cost.at[row, POSITION.error])
    names = listed([called(cost.at[row, "variant"]) for _, row in closer])
    return traced("Under our integrator the accelerations of {} lead to {} m in {}; with the engines' own steps {} m "
                  "is the best.", names, value("cost", cost, int(worst), POSITION.error), case_of(first),
                  value("cost", cost, int(best), POSITION.error))


def _set_up(cost: pd.DataFrame) -> TracedText:
    """What comes before the first step, of the reference and of the engine with the most."""
    column = "set-up [s]"
    if column not in cost:
        return TracedText("")
    rows = cost[_measured(cost) & cost[column].notna()]
    parts = [traced("up to {} ms for {}", _ms("cost", cost, int(found[column].idxmax()), column), name)
             for found, name in ((rows[rows["variant"] == REFERENCE], "the reference"),
                                 (rows[rows["engine"] != REFERENCE], "the engines")) if len(found)]
    return traced("Set-up comes on top: {}.", listed(parts)) if parts else TracedText("")


def _has_time(cost: pd.DataFrame) -> pd.Series:
    """The runs that were timed."""
    if not {TOTAL, "repeats"} <= set(cost):
        return pd.Series(False, cost.index)
    return cost[TOTAL].notna() & cost["repeats"].gt(0)


def _marked(cost: pd.DataFrame) -> pd.Series:
    """The timed runs whose time is unsure, for the reasons in `TIMING`."""
    return _has_time(cost) & _column(cost, TIMING).astype(object).fillna("").ne("")


def _disturbed(cost: pd.DataFrame) -> TracedText:
    marked, timed = cost[_marked(cost)], cost[_has_time(cost)]
    if marked.empty:
        return TracedText("")
    rounds = frozenset(timed["repeats"])
    return traced("{} of {} timings are marked as disturbed: other programs ran, the machine's speed changed, or the "
                  "interval is wide.", count("cost", cost, **{TIMING: frozenset(marked[TIMING]), "repeats": rounds}),
                  count("cost", cost, repeats=rounds))


def _headlines(results: Results, cost: pd.DataFrame, here: pd.DataFrame, first: str) -> tuple[Headline, ...]:
    """Total time to `TARGET`, the engine's part in brackets; more than the finest timed run where none is so exact."""
    reached, cells = _at_target(here), {}
    timed = cost[_measured(cost) & _has_time(cost) & (cost["scene"] == first)]
    for variant in methods(results):
        rows = reached[reached["variant"] == variant] if len(reached) else reached
        runs = timed[timed["variant"] == variant]
        if len(rows):
            label = int(rows.index[0])
            cells[variant] = traced("{} ({})", _bounded(rows, label), _ms("equal-error", rows, label, OWN_CPU))
        elif len(runs):
            cells[variant] = traced("> {}", _ms("cost", cost, int(runs.index[-1]), TOTAL))
    heading = f"CPU to {MILLI * TARGET:g} mm, {case_of(first)} (engine's part) [ms]"
    return (Headline(heading, cells),) if cells else ()


def _table(cost: pd.DataFrame, equal: pd.DataFrame, scene: str) -> TableView | None:
    """Times to `ERRORS` on a scene, a row a method."""
    here = equal[equal["scene"] == scene] if len(equal) else equal
    if here.empty:
        return None
    group_of = {variant: group for group, part in groups(cost[cost["variant"].isin(here["variant"])])
                for variant in part["variant"]}
    rows, behind = [], []
    for variant in sorted(set(here["variant"]), key=list(group_of).index):
        part = here[here["variant"] == variant]
        row: dict[str, object] = {"group": group_of[variant], "variant": variant}
        for error in ERRORS:
            found = part[part["error"] == error]
            total, own = (found[name].iloc[0] if len(found) else np.nan for name in (TOTAL, OWN_CPU))
            row |= {f"cpu to {error:g}": total, f"engine cpu to {error:g}": own,
                    f"at most {error:g}": bool(found["at most"].any())}
        rows.append(row)
        behind.append([label + 1 for label in part.index])
    columns = [Column("variant", "method"),
               *(Column(f"cpu to {error:g}", f"{MILLI * error:g} mm", "ms", scale=MILLI,
                        beside=f"engine cpu to {error:g}", bound=f"at most {error:g}") for error in ERRORS)]
    name = "cost" if scene == cost["scene"].iloc[0] else f"cost-{scene.replace('/', '-')}"
    caption = (f"CPU time to a position error in {case_of(scene)}: total, in brackets the engine's part. "
               "Only methods of one group can be ranked.")
    return view(name, caption, pd.DataFrame(rows), columns, source="equal-error", rows=behind, group="group")


def _limits(cost: pd.DataFrame, ends: Mapping[str, LadderEnd]) -> TableView:
    """Where each refinement series ends, what limits it, and what a run costs before its first step."""
    rows, behind = [], []
    for variant, end in ends.items():
        part = cost[cost["variant"] == variant]
        done = part[came_out(part)]
        order = end.order or Uncertain(np.nan, np.nan)
        rows.append({"variant": variant, "position error [m]": end.error, "order": order.value,
                     "order uncertainty": order.uncertainty, "limit": end.because, "why": end.why,
                     "set-up cpu [s]": _column(done, "set-up [s]").median(),
                     "compile cpu [s]": _column(done, "compile [s]").max(),
                     "disturbed": f"{int(_marked(part).sum())} of {int(_has_time(part).sum())}",
                     **{name: _column(done, name).iloc[0] for name in (FRICTION_BY, EVENTS_BY)}})
        behind.append([label + 1 for label in part.index])
    columns = (Column("variant", "method"), Column("position error [m]", "smallest error", "m"),
               Column("order", uncertainty="order uncertainty", interval=True), Column("limit"),
               Column("set-up cpu [s]", "set-up", "ms", scale=MILLI),
               Column("compile cpu [s]", "compilation", "ms", scale=MILLI), Column("disturbed", "timings disturbed"),
               Column(FRICTION_BY, "friction law by", brief=False), Column(EVENTS_BY, brief=False),
               Column("why", brief=False))
    caption = ("The smallest error of each refinement series (of several cases the worst), the order at its finest "
               "runs, and what limits it. Set-up: median; compilation: once a process, at most.")
    return view("cost-limits", caption, pd.DataFrame(rows), columns, source="cost", rows=behind)


def _column(rows: pd.DataFrame, name: str) -> pd.Series:
    """A column, without values where the table has none of that name."""
    return rows[name] if name in rows else pd.Series(np.nan, rows.index)


def _every_run(cost: pd.DataFrame) -> TableView:
    columns = (Column("scene"), Column("variant", "method"), Column("parameter", "refined by"),
               Column("step", form="g"), Column("status"), Column("reason"),
               Column(TOTAL, "CPU", "ms", scale=MILLI, beside=OWN_CPU),
               Column("set-up [s]", "set-up", "ms", scale=MILLI, form=".2g"),
               Column(POSITION.error, "position error", "m", POSITION.uncertainty),
               Column("order, position [-]", "order"),
               Column("torque error, L1 mean [N m]", "torque error, mean", "N m", "torque uncertainty [N m]"),
               Column("event time error [s]", "event time error", "s", "event time uncertainty [s]"),
               Column(TIMING, "timing"))
    there = cost[cost["status"] != MISSING_ENGINE]
    return view("cost-all", "Every run of the refinement series.", there, columns, source="cost", in_report=False)


def _figure(cost: pd.DataFrame) -> Chart:
    """Error over total time, a panel a case, a line a method."""
    drawn = cost[_measured(cost) & _has_time(cost) & cost[POSITION.error].gt(0)]
    drawn = drawn[drawn["variant"].isin(_methods(drawn))]
    panels = []
    for scene, rows in drawn.groupby("scene", sort=False):
        series = [Series(variant, ladder[TOTAL].to_numpy(float), ladder[POSITION.error].to_numpy(float), look=variant,
                         points=True) for variant, ladder in rows.groupby("variant", sort=False)]
        panels.append(Panel(title_of(scene), Axis("total CPU time [s]", log=True),
                            Axis("position error [m]", log=True), series))
    return Chart("work-precision", "Position error over total CPU time, a line a refinement series: down and to the "
                 "left is better. Only methods at the same fidelity answer the same question.", panels, height=2.8,
                 share_x=True, share_y=True)


def _methods(rows: pd.DataFrame) -> list[str]:
    """Of each engine, fidelity and way of solving the first variant: others change a setting of it."""
    way = rows["settings"].map(lambda settings: json.loads(settings).get("method"), na_action="ignore").fillna("")
    return list(rows.assign(way=way).drop_duplicates(["engine", "fidelity", "way"])["variant"])


STUDY = Study("cost", "Cost", "What does accuracy cost?", 2, present, plan, seconds=0.5,
              takes=frozenset({"engines", "t_end", "repeats"}))
