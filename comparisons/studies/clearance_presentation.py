"""Presentation of the study `clearance`: the clearance that may be neglected, effects, flights and figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation import (
    LIMIT as LIMIT_LOOK,
)
from stiction.comparisons.bench.presentation import (
    METHOD,
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.charts import TRUTH
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import PAPERS_CASES, Results
from stiction.comparisons.studies.clearance_tables import (
    CLEARANCE,
    EFFORT,
    EFFORT_EXPONENT,
    HAS_DRIVE,
    LIMIT,
    LIMIT_HIGH,
    LIMIT_LOW,
    POSITION,
    POSITION_EXPONENT,
    QUANTITIES,
    RESOLVED,
    RESTITUTION,
    SPEED_EXPONENT,
    START,
    TIME_EXPONENT,
    UNRESOLVED,
    WHY_NONE,
    isolated_flights,
    uncertainty_of,
)
from stiction.engines.status import UNMADE, Status
from stiction.scenes.columns import unit_of

MILLI = 1e3
"""Number of thousandths in a unit."""
SPEED_LAW = 2.0 / 3.0
"""Exponent of impact speeds, and so of the mean change of the effort, over the clearance."""
POSITION_LAW = 1.0
"""Exponent of the change of the position: slider and surfaces are displaced by the clearance."""
DETAILS = frozenset({"one_corner_share", "adjacent_share", "opposite_share", "largest_overlap"})
"""Quantities that the Markdown report leaves out, because its pages have room for a few columns only."""
SHORTEST_BAR = 0.1
"""Ratio to the value at which a bar ends on a logarithmic axis if the interval contains zero."""
SHOWN_RANGE = 3.0
"""Margin of the axis of efforts above and below the ideal effort, as a multiple of the range of the ideal effort.

Peaks by impacts exceed it: their height is inversely proportional to the time between samples.
"""
SMALLEST_RANGE = 1e-3
"""Smallest range of the ideal effort in this multiple, relative to its largest value: the effort may be constant."""


def present(results: Results) -> Presentation:
    """Present the clearance at which the effort changes by the limit, and tables and figures of effects and flights."""
    effects = results.table("clearance")
    limits = results.table("clearance-limits")
    if effects.empty or limits.empty:
        return Presentation()
    flights = results.table("clearance-flights")
    exponents = results.table("clearance-exponents")
    efforts = results.table("clearance-efforts")
    answer = _answer_rows(limits)
    rows: dict[str, Any] = {
        "answers": [],
        "method": "",
        "percent": 0.0,
        "unresolved_share": RESOLVED,
        "grown": [_scene_row(results, limits, place) for place in _rows_with_exponent(limits)],
        "exponents": _exponent_rows(exponents),
        "isolated": _flight_counts(flights),
        "verdicts": _verdicts(results.table("clearance-claims")),
        "refused": _refusals(effects),
        "unresolved": _unresolved_quantities(effects),
        "has_perturbed_starts": _has_perturbed_starts(results.table("clearance-runs")),
        "restitution": 0.0,
        "window": None,
        "is_force": False,
    }
    if len(answer):
        first = answer.iloc[0]
        rows["method"] = first["variant"]
        rows["restitution"] = float(first[RESTITUTION])
        rows["percent"] = 100.0 * float(first["effect_limit"])
        # The text mentions a window only if all scenes of the answer have the same one.
        if len(answer[["window_begin", "window_end"]].drop_duplicates()) == 1:
            rows["window"] = row_of("clearance-limits", limits, answer.index[0])
        rows["is_force"] = _unit_of_effort(results, str(first["scene"])) == "N"
        rows["answers"] = [_scene_row(results, limits, place) for place in answer.index]
    return Presentation(
        rows=rows,
        tables=list(_tables(results, effects, limits, exponents, flights)),
        figures=list(_figures(results, effects, efforts)),
    )


def _answer_rows(limits: pd.DataFrame) -> pd.DataFrame:
    """Return the rows from which the answer is made: all scenes with a drive, with one method and one restitution.

    The restitution is the smallest one. The method is the one with limits on most scenes or, if several have as many,
    the most sensitive of these: the one whose limits have the smallest geometric mean.
    """
    comparable = limits[limits["status"].eq(Status.OK) & limits[HAS_DRIVE].eq(True)]
    candidates = comparable[comparable[RESTITUTION] == comparable[RESTITUTION].min()]
    best = candidates.iloc[:0]
    best_rank = (-1, 0.0)
    for _, rows in candidates.groupby("variant", sort=False):
        lower_ends = rows.reindex(columns=[LIMIT_LOW])[LIMIT_LOW].dropna()
        sensitivity = -float(np.log(lower_ends).mean()) if len(lower_ends) else 0.0
        rank = (len(lower_ends), sensitivity)
        if rank > best_rank:
            best, best_rank = rows, rank
    return best


def _scene_row(results: Results, limits: pd.DataFrame, place: int) -> dict[str, Any]:
    """Return the values that the text needs about one row of the limits.

    ``case`` is the number of the case in the paper, None for other scenes.
    """
    scene = str(limits.at[place, "scene"])
    number = None
    if scene in PAPERS_CASES and results.is_of_paper(scene):
        number = PAPERS_CASES.index(scene) + 1
    return {
        "scene": scene,
        "case": number,
        "row": row_of("clearance-limits", limits, place),
        "has_limit": LIMIT in limits and bool(pd.notna(limits.at[place, LIMIT])),
        "why": limits.at[place, WHY_NONE],
    }


def _rows_with_exponent(limits: pd.DataFrame) -> list[int]:
    """Return the labels of the rows with an exponent of the effort."""
    if EFFORT_EXPONENT not in limits:
        return []
    return list(limits.index[limits[EFFORT_EXPONENT].notna()])


def _exponent_rows(exponents: pd.DataFrame) -> list[Any]:
    """Return the rows of methods with exponents of flights."""
    if TIME_EXPONENT not in exponents:
        return []
    return [
        row_of("clearance-exponents", exponents, place)
        for place in exponents.index[exponents[TIME_EXPONENT].notna()]
    ]


def _flight_counts(flights: pd.DataFrame) -> dict[str, int]:
    """Return the numbers of flights that were predicted, measured, and measured as well as isolated."""
    if flights.empty or "event_time" not in flights:
        return {"predicted": 0, "measured": 0, "isolated": 0}
    measured = flights.get("flight_time_ratio", pd.Series(dtype=float)).notna().sum()
    return {
        "predicted": int(flights["event_time"].notna().sum()),
        "measured": int(measured),
        "isolated": len(isolated_flights(flights)),
    }


def _verdicts(claims: pd.DataFrame) -> dict[str, int]:
    """Return the number of statements by verdict."""
    return {} if claims.empty else claims["verdict"].value_counts(sort=False).to_dict()


def _refusals(effects: pd.DataFrame) -> list[dict[str, str]]:
    """Return each reason for which methods are refused, with the names of these methods."""
    refused = effects[effects["status"] == Status.REFUSED]
    return [
        {"reason": str(reason), "variants": ", ".join(dict.fromkeys(rows["variant"]))}
        for reason, rows in refused.groupby("reason", sort=False)
    ]


def _unresolved_quantities(effects: pd.DataFrame) -> list[dict[str, Any]]:
    """Return each quantity that the steps do not resolve in some rows, with the number of rows and the methods."""
    if UNRESOLVED not in effects:
        return []
    names_by_row = [names.split(", ") for names in effects[UNRESOLVED].fillna("")]
    rows = []
    for quantity in QUANTITIES:
        is_unresolved = np.array([quantity in names for names in names_by_row])
        if is_unresolved.any():
            rows.append(
                {
                    "quantity": quantity,
                    "label": quantity_of(quantity).label,
                    "count": int(is_unresolved.sum()),
                    "all": int(effects["status"].eq(Status.OK).sum()),
                    "variants": ", ".join(dict.fromkeys(effects.loc[is_unresolved, "variant"])),
                }
            )
    return rows


def _has_perturbed_starts(runs: pd.DataFrame) -> bool:
    """Return whether a run from a perturbed start succeeded, so that uncertainties contain a spread over starts."""
    return START in runs and bool((runs[START].gt(0) & runs["status"].eq(Status.OK)).any())


def _tables(
    results: Results,
    effects: pd.DataFrame,
    limits: pd.DataFrame,
    exponents: pd.DataFrame,
    flights: pd.DataFrame,
) -> Iterator[TableView]:
    """Yield all tables in the order of the report."""
    yield _limits_view(limits)
    yield _effects_view(effects)
    yield _claims_view(results.table("clearance-claims"))
    if TIME_EXPONENT in exponents:
        yield _exponents_view(exponents)
    if "event_time" in flights:
        yield _flights_view(flights)
    columns = ("scene", "variant", RESTITUTION, CLEARANCE, "step", START, *QUANTITIES)
    runs = results.table("clearance-runs")
    yield view("clearance-runs", runs, [Column(name) for name in columns], in_report=False)


def _limits_view(limits: pd.DataFrame) -> TableView:
    """Return the table of limits, without the rows of runs that were not made."""
    return view(
        "clearance-limits",
        limits[~limits["status"].isin(UNMADE)],
        [
            Column("scene"),
            METHOD,
            Column(RESTITUTION),
            Column(LIMIT),
            Column(LIMIT_LOW, "from"),
            Column(LIMIT_HIGH, "to"),
            Column(WHY_NONE, "why there is none"),
            Column(EFFORT_EXPONENT, interval=True),
            Column(POSITION_EXPONENT, interval=True),
        ],
    )


def _effects_view(effects: pd.DataFrame) -> TableView:
    """Return the table of effects, without the rows of runs that were not made."""
    columns = [Column("scene"), METHOD, Column(RESTITUTION), Column(CLEARANCE), Column("step")]
    columns += [Column(name, brief=name not in DETAILS) for name in QUANTITIES]
    columns += [Column("cpu_time"), Column("status"), Column("reason")]
    return view("clearance", effects[~effects["status"].isin(UNMADE)], columns)


def _claims_view(claims: pd.DataFrame) -> TableView:
    """Return the table of published statements."""
    return view(
        "clearance-claims",
        claims,
        [
            Column("claim", "statement"),
            Column("place", "source"),
            Column("verdict"),
            Column("margin", form=".2g"),
            Column("margin_kind"),
            Column("why"),
        ],
    )


def _exponents_view(exponents: pd.DataFrame) -> TableView:
    """Return the table of the methods and scenes with exponents of flights."""
    return view(
        "clearance-exponents",
        exponents[exponents[TIME_EXPONENT].notna()],
        [
            Column("scene"),
            METHOD,
            Column("flights"),
            Column(TIME_EXPONENT, interval=True),
            Column(SPEED_EXPONENT, interval=True),
            Column("largest_time_deviation"),
            Column("largest_speed_deviation"),
        ],
    )


def _flights_view(flights: pd.DataFrame) -> TableView:
    """Return the table of the predicted flights, without the rows of runs that failed."""
    return view(
        "clearance-flights",
        flights[flights["event_time"].notna()],
        [
            Column("scene"),
            METHOD,
            Column("event_time", form=".4f"),
            Column("corner"),
            Column("opposite_corner"),
            Column(CLEARANCE),
            Column("release"),
            Column("crowding"),
            Column("mobilization"),
            Column("flight_time", form=".4g"),
            Column("flight_time_ratio", form=".3f"),
            Column("impact_speed", form=".4g"),
            Column("impact_speed_ratio", form=".3f"),
            Column(WHY_NONE, "why none is measured"),
        ],
    )


def _figures(results: Results, effects: pd.DataFrame, efforts: pd.DataFrame) -> Iterator[Chart]:
    """Yield the chart of the effort around a flight, and that of effects over the clearance."""
    if not efforts.empty:
        chart = _effort_chart(results, efforts)
        if chart is not None:
            yield chart
    yield _effect_chart(results, effects)


def _effort_chart(results: Results, efforts: pd.DataFrame) -> Chart | None:
    """Return the chart of the effort around the flight of a corner, and of its integral, for each clearance.

    It shows the first scene and method, at the finest step of each clearance.
    """
    first = efforts.iloc[0]
    chosen = efforts[
        (efforts["scene"] == first["scene"]) & (efforts["variant"] == first["variant"])
    ]
    unit = _unit_of_effort(results, str(first["scene"]))
    curves = []
    impulses = []
    longest = chosen.iloc[:0]
    for clearance in sorted(chosen[CLEARANCE].unique(), reverse=True):
        rows = chosen[chosen[CLEARANCE] == clearance]
        finest = rows[rows["step"] == rows["step"].min()].sort_values("time_after_release")
        time = MILLI * finest["time_after_release"].to_numpy()
        effort = finest["effort_value"].to_numpy()
        difference = effort - finest["ideal_effort"].to_numpy()
        label = f"c = {MILLI * clearance:g} mm"
        curves.append(Series(label, time, effort, look=label))
        # An impact is a jump of the integral, whose height depends neither on the step nor on the samples.
        spacing = np.gradient(time) if len(time) > 1 else np.zeros(len(time))
        impulses.append(Series("", time, np.cumsum(difference * spacing), look=label))
        # Runs that end earlier contain a part of the ideal effort.
        if len(finest) > len(longest):
            longest = finest
    if len(longest) < 2:
        return None
    exact = longest["ideal_effort"].to_numpy()
    ideal = Series(
        "ideal joint", MILLI * longest["time_after_release"].to_numpy(), exact, look=TRUTH
    )
    axis = Axis("time after the release [ms]")
    return Chart(
        "clearance-torque",
        [
            Panel(
                "",
                axis,
                Axis(f"effort of the drive [{unit}]", limits=_axis_limits(exact)),
                [*curves, ideal],
                lines=(0.0,),
            ),
            Panel(
                "", axis, Axis(f"impulse beyond the ideal one [m{unit} s]"), impulses, lines=(0.0,)
            ),
        ],
        columns=2,
        height=2.5,
    )


def _axis_limits(ideal_effort: np.ndarray) -> tuple[float, float]:
    """Return the ends of the axis of efforts around a stretch of the ideal effort, shape (samples,)."""
    smallest_range = SMALLEST_RANGE * float(np.max(np.abs(ideal_effort)))
    margin = SHOWN_RANGE * max(float(np.ptp(ideal_effort)), smallest_range)
    return float(ideal_effort.min()) - margin, float(ideal_effort.max()) + margin


def _unit_of_effort(results: Results, scene_name: str) -> str:
    """Return the unit of the effort of the first drive of a scene; N m if the results do not contain the scene."""
    scene = results.scene(scene_name)
    if scene is None or not scene.drives:
        return "N m"
    first = next(iter(scene.drives))
    return unit_of(f"{first}.effort", scene)


def _effect_chart(results: Results, effects: pd.DataFrame) -> Chart:
    """Return the chart of the changes of effort and position over the clearance, a panel for each scene."""
    panels = []
    least = float(effects[RESTITUTION].min())
    for name, exponent, label in (
        (EFFORT, SPEED_LAW, "change of the effort, mean"),
        (POSITION, POSITION_LAW, "change of position [m]"),
    ):
        if name not in effects:
            continue
        for scene, rows in effects.groupby("scene", sort=False):
            series = list(_effect_series(rows, name, exponent, least))
            if series:
                panels.append(
                    Panel(
                        results.title_of(str(scene)),
                        Axis("clearance [m]", log=True),
                        Axis(label, log=True),
                        series,
                    )
                )
    return Chart("clearance-effect", panels, columns=3, height=2.2)


def _effect_series(
    rows: pd.DataFrame, name: str, exponent: float, least: float
) -> Iterator[Series]:
    """Yield the effect of each method and restitution in one scene, and a line with the slope of the law.

    The line passes through the mean of the logarithms of the first series. `least` is the smallest restitution in all
    scenes; series with it have the look of their method.
    """
    law = None
    for (variant, restitution), group in rows.groupby(["variant", RESTITUTION], sort=False):
        positive = group[group[name].gt(0.0)].sort_values(CLEARANCE)
        if positive.empty:
            continue
        x = positive[CLEARANCE].to_numpy(float)
        y = positive[name].to_numpy(float)
        uncertainty = positive[uncertainty_of(name)].to_numpy(float)
        label = f"{variant}, e = {restitution:g}"
        yield Series(
            label,
            x,
            y,
            # The lower end of an interval that contains zero lies below any logarithmic axis.
            low=np.maximum(y - uncertainty, SHORTEST_BAR * y),
            high=y + uncertainty,
            look=str(variant) if restitution == least else label,
            points=True,
        )
        if law is None and len(x) > 1:
            middle = np.exp(np.mean(np.log(y)))
            line = middle * (x / np.exp(np.mean(np.log(x)))) ** exponent
            law = Series("", x, line, look=LIMIT_LOOK)
    if law is not None:
        yield law
