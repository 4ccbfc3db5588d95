"""Stabilization as a choice of its own: none, Baumgarte, projection after each step; cost, drift and error together.

The two ways of the reference take each choice at equal rtol or step; nothing else differs between the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.presentation import Column, Presentation, row_of, view
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.intervals import Interval, ratio_interval
from stiction.comparisons.bench.timing.visits import Timing
from stiction.comparisons.bench.variants import OWN_CPU, Record, Variant, scaled
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

ERROR = "position_error"
CHOICES = ("none", "baumgarte", "projection")
WAYS = (("reference", "rtol", (1e-6, 1e-9)), ("paper's scheme", "dt", (1e-2, 1e-3)))


def suppression_variants() -> tuple[Variant, ...]:
    """Both ways of the reference with each choice, at two tolerances or steps."""
    return tuple(
        Variant(
            f"{way}, {choice}",
            "reference",
            parameter,
            steps,
            settings={
                "method": "event" if parameter == "rtol" else "paper",
                "stabilization": choice,
            },
        )
        for way, parameter, steps in WAYS
        for choice in CHOICES
    )


def plan(scope: Scope) -> Comparison[Tables]:
    """A row per way, choice and tolerance or step on the first scene.

    Baumgarte's alpha and beta are the scene's or, where it declares none, the paper's; they stand in the column
    settings.
    """
    scene, t_end = scope.scenes[0], scope.t_end

    def rows(
        records: Sequence[Record], timings: Sequence[Timing | None]
    ) -> Iterator[dict[str, Any]]:
        truth, size = truth_for(scene, records, t_end), size_of(scene)
        for record, timing in zip(records, timings):
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
    timed = timed_comparison(scene, runs, t_end, scope.repeats or extent(scope.depth).repeats, rows)
    return timed.then(lambda timed: timed.as_tables("suppression"))


def present(results: Results) -> Presentation:
    """The engine time that each stabilization takes, and the drift and the error that it leaves."""
    table = results.table("suppression")
    failed = dict.fromkeys(table.loc[table["status"] != Status.OK, "variant"] if len(table) else ())
    if POSITION not in table or LOW not in table:
        return Presentation(rows={"compared": [], "failed": list(failed)} if failed else {})
    table = above_rounding(table)
    samples = with_columns(results.table("times"), "key", OWN_CPU)
    times = {key: part[OWN_CPU].tolist() for key, part in samples.groupby("key")}
    measured = table[table[POSITION].notna() & table["key"].isin(times)]
    finest = measured.groupby("parameter", sort=False)["step"].transform("min")
    compared = [
        _compared(table, rows, times)
        for _, rows in measured[measured["step"] == finest].groupby("parameter", sort=False)
    ]
    half = (table[HIGH] - table[OWN_CPU]).combine(table[OWN_CPU] - table[LOW], max)
    settings = [setting_of(*run) for run in zip(table["parameter"], table["step"])]
    columns = (
        Column("variant", "method, stabilization"),
        Column("setting"),
        Column(OWN_CPU, "engine time", "ms", "half", interval=True, scale=1e3),
        Column("counter:rhs", "right-hand sides"),
        Column(POSITION, "drift"),
        Column(VELOCITY, "velocity drift"),
        Column(ERROR),
        Column("reason", brief=False),
    )
    shown = view("suppression", table.assign(half=half, setting=settings), columns)
    every = [Column(name) for name in table if name not in ("settings", "version", "key")]
    runs = view(
        "suppression-all",
        results.table("suppression"),
        every,
        source="suppression",
        in_report=False,
    )
    return Presentation(rows={"compared": compared, "failed": list(failed)}, tables=[shown, runs])


def _compared(
    table: pd.DataFrame, rows: pd.DataFrame, times: Mapping[str, Sequence[float]]
) -> dict[str, object]:
    """The runs of one method at one tolerance or step by their stabilization, and ratios of their times.

    Ratios are those of the rounds, each of which has both runs; None where one of them is missing.
    """
    labels = {choice: None for choice in CHOICES} | dict(zip(rows["suppression"], rows.index))

    def time_ratio(over: str, under: str) -> Interval | None:
        if labels[over] is None or labels[under] is None:
            return None
        return ratio_interval(*(times[table.at[labels[choice], "key"]] for choice in (over, under)))

    return {
        "parameter": rows["parameter"].iloc[0],
        **{
            choice: None if label is None else row_of("suppression", table, label)
            for choice, label in labels.items()
        },
        "baumgarte_over_projection": time_ratio("baumgarte", "projection"),
        "projection_over_none": time_ratio("projection", "none"),
    }


STUDY = Study(
    "suppression",
    "Stabilization",
    "How expensive and how accurate is each stabilization?",
    present,
    plan,
    seconds=0.1,
    on_page_one=False,
    takes=frozenset({"t_end", "repeats"}),
    tables={
        "suppression": "Stabilizations of the reference",
    },
)
