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
"""Quantities that the Markdown report leaves out, which has room for a few columns."""
SHORTEST_BAR = 0.1
"""Lower end of an interval that contains zero, of the value, on a logarithmic axis."""
SHOWN_RANGE = 3.0
"""Range of the axis of efforts around a flight on both sides of the ideal effort, in ranges of the ideal effort there.

Impulses of impacts exceed it, as their height is inversely proportional to the time between samples.
"""


def present(results: Results) -> Presentation:
    """Present the clearance at which the effort changes by the limit, and tables and figures of effects and flights."""
    effects = results.table("clearance")
    limits = results.table("clearance-limits")
    if effects.empty or limits.empty:
        return Presentation()
    flights = results.table("clearance-flights")
    exponents = results.table("clearance-exponents")
    efforts = results.table("clearance-efforts")
    answering = _answering(limits)
    rows: dict[str, Any] = {
        "answers": [],
        "method": "",
        "percent": 0.0,
        "unresolved_share": RESOLVED,
        "grown": [_cases_row(results, limits, place) for place in _fitted(limits)],
        "exponents": _exponent_rows(exponents),
        "isolated": _isolated_rows(flights),
        "verdicts": _verdicts(results.table("clearance-claims")),
        "refused": _refused(effects),
        "unresolved": _unresolved(effects),
        "restitution": 0.0,
        "window": None,
        "is_force": False,
    }
    if len(answering):
        first = answering.iloc[0]
        rows["method"] = first["variant"]
        rows["restitution"] = float(first[RESTITUTION])
        rows["percent"] = 100.0 * float(first["effect_limit"])
        rows["window"] = row_of("clearance-limits", limits, answering.index[0])
        rows["is_force"] = _unit_of_effort(results, str(first["scene"])) == "N"
        rows["answers"] = [_cases_row(results, limits, place) for place in answering.index]
    return Presentation(
        rows=rows,
        tables=list(_tables(results, effects, limits, exponents, flights)),
        figures=list(_figures(results, effects, efforts)),
    )


def _answering(limits: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that the answer mentions: of one method and one restitution, all scenes with a drive.

    The restitution is the smallest. The method is the one with limits on most scenes; if several have as many, the one
    with the smallest clearances, so that the answer holds for the others, too.
    """
    concerned = limits[limits["status"].eq(Status.OK) & limits[HAS_DRIVE].eq(True)]
    least = concerned[concerned[RESTITUTION] == concerned[RESTITUTION].min()]
    best = least.iloc[:0]
    best_merit = (-1, 0.0)
    for _, rows in least.groupby("variant", sort=False):
        known = rows[LIMIT_LOW].dropna() if LIMIT_LOW in rows else pd.Series(dtype=float)
        smallness = -float(np.log(known).mean()) if len(known) else 0.0
        merit = (len(known), smallness)
        if merit > best_merit:
            best, best_merit = rows, merit
    return best


def _cases_row(results: Results, limits: pd.DataFrame, place: int) -> dict[str, Any]:
    """Return a row of the limits, and the number of its case in the paper, or None for other scenes."""
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


def _fitted(limits: pd.DataFrame) -> list[int]:
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


def _isolated_rows(flights: pd.DataFrame) -> dict[str, int]:
    """Return the numbers of flights that were predicted, measured and isolated."""
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


def _refused(effects: pd.DataFrame) -> list[dict[str, str]]:
    """Return each reason for which methods are refused, with their names."""
    refused = effects[effects["status"] == Status.REFUSED]
    return [
        {"reason": str(reason), "variants": ", ".join(dict.fromkeys(rows["variant"]))}
        for reason, rows in refused.groupby("reason", sort=False)
    ]


def _unresolved(effects: pd.DataFrame) -> list[dict[str, Any]]:
    """Return each quantity that the steps do not resolve somewhere, with the number of rows and the methods."""
    if UNRESOLVED not in effects:
        return []
    named = effects[UNRESOLVED].fillna("")
    rows = []
    for quantity in QUANTITIES:
        is_named = np.array([quantity in names.split(", ") for names in named])
        if is_named.any():
            rows.append(
                {
                    "label": quantity_of(quantity).label,
                    "count": int(is_named.sum()),
                    "all": int(effects["status"].eq(Status.OK).sum()),
                    "variants": ", ".join(dict.fromkeys(effects.loc[is_named, "variant"])),
                }
            )
    return rows


def _tables(
    results: Results,
    effects: pd.DataFrame,
    limits: pd.DataFrame,
    exponents: pd.DataFrame,
    flights: pd.DataFrame,
) -> Iterator[TableView]:
    """Yield the tables of limits, effects, exponents, flights and runs."""
    made = limits[~limits["status"].isin(UNMADE)]
    yield view(
        "clearance-limits",
        made,
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
    done = effects[~effects["status"].isin(UNMADE)]
    columns = [Column("scene"), METHOD, Column(RESTITUTION), Column(CLEARANCE), Column("step")]
    columns += [Column(name, brief=name not in DETAILS) for name in QUANTITIES]
    columns += [Column("cpu_time"), Column("status"), Column("reason")]
    yield view("clearance", done, columns)
    yield view(
        "clearance-claims",
        results.table("clearance-claims"),
        [
            Column("claim", "statement"),
            Column("place", "source"),
            Column("verdict"),
            Column("margin", form=".2g"),
            Column("margin_kind"),
            Column("why"),
        ],
    )
    if TIME_EXPONENT in exponents:
        yield view(
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
    if "event_time" in flights:
        yield view(
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
    runs = results.table("clearance-runs")
    yield view(
        "clearance-runs",
        runs,
        [
            Column(name)
            for name in ("scene", "variant", RESTITUTION, CLEARANCE, "step", START, *QUANTITIES)
        ],
        in_report=False,
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
    ideal = None
    for clearance, rows in sorted(
        chosen.groupby(CLEARANCE, sort=False), key=lambda pair: -float(str(pair[0]))
    ):
        finest = rows[rows["step"] == rows["step"].min()].sort_values("time_after_release")
        time = MILLI * finest["time_after_release"].to_numpy()
        value = finest["effort_value"].to_numpy()
        exact = finest["ideal_effort"].to_numpy()
        label = f"c = {MILLI * float(str(clearance)):g} mm"
        curves.append(Series(label, time, value, look=label))
        # The integral of the difference: each impact is a step of it, whose height does not depend on any step.
        spacing = np.gradient(time) if len(time) > 1 else np.zeros(len(time))
        impulses.append(Series("", time, np.cumsum((value - exact) * spacing), look=label))
        if ideal is None or len(time) > len(ideal.x):
            ideal = Series("ideal joint", time, exact, look=TRUTH)
    if ideal is None or len(ideal.x) < 2:
        return None
    margin = SHOWN_RANGE * max(float(np.ptp(ideal.y)), 1e-3 * float(np.max(np.abs(ideal.y))))
    limits = (float(ideal.y.min()) - margin, float(ideal.y.max()) + margin)
    axis = Axis("time after the release [ms]")
    return Chart(
        "clearance-torque",
        [
            Panel(
                "",
                axis,
                Axis(f"effort of the drive [{unit}]", limits=limits),
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


def _unit_of_effort(results: Results, scene_name: str) -> str:
    """Return the unit of the effort of the first drive of a scene; N m for a scene that is not known any more."""
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

    The line passes through the mean of the first series in logarithms. Series with the `least` restitution of all
    scenes have the look of their method.
    """
    law = None
    for (variant, restitution), group in rows.groupby(["variant", RESTITUTION], sort=False):
        known = group[group[name].gt(0.0)].sort_values(CLEARANCE)
        if known.empty:
            continue
        x = known[CLEARANCE].to_numpy(float)
        y = known[name].to_numpy(float)
        uncertainty = known[uncertainty_of(name)].to_numpy(float)
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
