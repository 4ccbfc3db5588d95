"""Stabilizations of the reference: their cost, and the drift and the error that they leave.

The two methods of the reference run with no stabilization, with Baumgarte's terms and with projection after each step.
Runs of one method at the same tolerance or step differ in nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import of_first_scene, with_columns
from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.presentation import (
    Column,
    Presentation,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables, joined
from stiction.comparisons.bench.timing.intervals import Interval, ratio_interval
from stiction.comparisons.bench.timing.visits import Timing
from stiction.comparisons.bench.variants import OWN_CPU, Parameter, Record, Variant, scaled
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.scene_truth import truth_for
from stiction.comparisons.measures.work_precision import (
    HIGH,
    LOW,
    TimedRun,
    cost_of,
    timed_comparison,
)
from stiction.comparisons.studies.drift import POSITION, VELOCITY, above_rounding
from stiction.engines.status import Status
from stiction.scenes import Scene

ERROR = "position_error"
"""Column: position error, m."""
CHOICES = ("none", "baumgarte", "projection")
"""Stabilizations, as the setting of the engine names them."""


@dataclass(frozen=True)
class Method:
    """A method of the reference that runs with each stabilization.

    Attributes
    ----------
    label : str
        Beginning of the labels of its variants.
    setting : str
        Value of the engine's setting ``method``.
    parameter : {"rtol", "dt"}
        What is refined.
    values : tuple of float
        Relative tolerances, or steps in s.
    """

    label: str
    setting: str
    parameter: Parameter
    values: tuple[float, ...]


METHODS = (
    Method("reference", "event", "rtol", (1e-6, 1e-9)),
    Method("paper's scheme", "paper", "dt", (1e-2, 1e-3)),
)


def suppression_variants() -> tuple[Variant, ...]:
    """Return the variants of both methods with each stabilization, at two tolerances or steps."""
    return tuple(
        Variant(
            f"{method.label}, {choice}",
            "reference",
            method.parameter,
            method.values,
            settings={"method": method.setting, "stabilization": choice},
        )
        for method in METHODS
        for choice in CHOICES
    )


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan a row per scene, method, stabilization and tolerance or step.

    Of the paper's cases, in their validation, the first one is examined.

    Baumgarte's alpha and beta are those of the scene or, if it declares none, of the paper. The column ``settings``
    contains them.
    """
    repeats = scope.repeats or extent(scope.depth).repeats
    comparisons = [_scene_comparison(scene, scope.t_end, repeats) for scene in scope.leading_scenes]
    return side_by_side(comparisons, joined)


def _scene_comparison(scene: Scene, t_end: float | None, repeats: int) -> Comparison[Tables]:
    """Plan the rows of one scene."""

    def rows(
        records: Sequence[Record], timings: Sequence[Timing | None]
    ) -> Iterator[dict[str, Any]]:
        truth = truth_for(scene, records, t_end)
        size = size_of(scene)
        for record, timing in zip(records, timings, strict=True):
            yield {
                **record.describe(),
                "suppression": record.variant.settings["stabilization"],
                **cost_of(timing),
                **drift(record.trajectory),
                **errors(record.trajectory, truth, size),
            }

    runs = [
        TimedRun(scene, variant, step)
        for variant in scaled(suppression_variants(), scene, t_end)
        for step in variant.ladder
    ]
    comparison = timed_comparison(scene, runs, t_end, repeats, rows)
    return comparison.then(lambda timed: timed.as_tables("suppression"))


def present(results: Results) -> Presentation:
    """Present the engine time of each stabilization, and the drift and the error that it leaves."""
    table = results.table("suppression")
    failed: list[str] = []
    if len(table):
        failed = list(table.loc[table["status"] != Status.OK, "variant"].unique())
    if POSITION not in table or LOW not in table:
        return Presentation(
            rows={"compared": [], "failed": failed, "first_of_several": None} if failed else {}
        )
    table = above_rounding(table)
    samples = with_columns(results.table("times"), "key", OWN_CPU)
    times = {key: rows[OWN_CPU].tolist() for key, rows in samples.groupby("key")}

    # The text is about the first scene; the tables contain all of them.
    first = of_first_scene(table)

    # Stabilizations are compared at the tightest tolerance and at the finest step.
    measured = first[first[POSITION].notna() & first["key"].isin(times)]
    finest = measured.groupby("parameter", sort=False)["step"].transform("min")
    at_finest = measured[measured["step"] == finest]
    compared = [
        _compared(table, runs, times) for _, runs in at_finest.groupby("parameter", sort=False)
    ]
    rows = {
        "compared": compared,
        "failed": failed,
        "first_of_several": first["scene"].iloc[0] if len(first) < len(table) else None,
    }
    return Presentation(rows=rows, tables=[_main_table(table), _all_runs(results)])


def _compared(
    table: pd.DataFrame, runs: pd.DataFrame, times: Mapping[str, Sequence[float]]
) -> dict[str, object]:
    """Return the runs of one method at one tolerance or step by their stabilization, and ratios of their times.

    A ratio is found from the ratios in each round of timing, which contains both runs. It is None if one of the runs
    is missing.

    Parameters
    ----------
    table : DataFrame
        All rows of the study.
    runs : DataFrame
        The rows to compare: at most one per stabilization.
    times : Mapping[str, sequence of float]
        Engine times (s) in each round, by the key of a run.
    """
    labels = dict(zip(runs["suppression"], runs.index, strict=True))

    def time_ratio(numerator: str, denominator: str) -> Interval | None:
        if numerator not in labels or denominator not in labels:
            return None
        return ratio_interval(
            times[table.at[labels[numerator], "key"]], times[table.at[labels[denominator], "key"]]
        )

    row: dict[str, object] = {"parameter": runs["parameter"].iloc[0]}
    for choice in CHOICES:
        row[choice] = None
        if choice in labels:
            row[choice] = row_of("suppression", table, labels[choice])
    row["baumgarte_over_projection"] = time_ratio("baumgarte", "projection")
    row["projection_over_none"] = time_ratio("projection", "none")
    return row


def _main_table(table: pd.DataFrame) -> TableView:
    """Return the table of cost, drift and error of each run; times have the larger half of their interval."""
    half = (table[HIGH] - table[OWN_CPU]).combine(table[OWN_CPU] - table[LOW], max)
    settings = [
        setting_of(parameter, step) for parameter, step in zip(table["parameter"], table["step"])
    ]
    several_scenes = [Column("scene")] if len(of_first_scene(table)) < len(table) else []
    columns = (
        *several_scenes,
        Column("variant", "method, stabilization"),
        Column("setting"),
        Column(OWN_CPU, "engine time", "ms", "half", interval=True, scale=1e3),
        Column("counter:rhs", "right-hand sides"),
        Column(POSITION, "drift"),
        Column(VELOCITY, "velocity drift"),
        Column(ERROR),
        Column("reason", brief=False),
    )
    return view("suppression", table.assign(half=half, setting=settings), columns)


def _all_runs(results: Results) -> TableView:
    """Return the table of all columns of all runs."""
    table = results.table("suppression")
    columns = [Column(name) for name in table if name not in ("settings", "version", "key")]
    return view("suppression-all", table, columns, source="suppression", in_report=False)


STUDY = Study(
    "suppression",
    "Stabilization",
    "How much drift does each stabilization method prevent, and what does it cost?",
    present,
    plan,
    seconds=0.1,
    on_page_one=False,
    takes=frozenset({"t_end", "repeats", "scenes"}),
    tables={
        "suppression": "Stabilizations of the reference",
    },
)
