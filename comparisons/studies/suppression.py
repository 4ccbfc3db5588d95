"""Stabilization as a choice of its own: none, Baumgarte, projection after each step; cost, drift and error together.

The two ways of the reference take each choice at equal rtol or step; nothing else differs between the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.presentation import (
    Column,
    Number,
    Presentation,
    TracedText,
    listed,
    sentence,
    short,
    traced,
    value,
    view,
)
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.intervals import ratio_interval
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
from stiction.comparisons.studies.drift import POSITION, VELOCITY, above_rounding, drift_size

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
    failed = dict.fromkeys(table.loc[table["status"] != "ok", "variant"] if len(table) else ())
    without = sentence("Runs that failed: {}.", listed(list(failed)))
    if POSITION not in table or LOW not in table:
        return Presentation(findings=[without])
    samples = with_columns(results.table("times"), "key", OWN_CPU)
    times = {key: part[OWN_CPU].tolist() for key, part in samples.groupby("key")}
    measured = table[table[POSITION].notna() & table["key"].isin(times)]
    rows = {
        run: dict(zip(there["suppression"], map(int, there.index)))
        for run, there in measured.groupby(["parameter", "step"], sort=False)
    }

    def drift_with(run: tuple[str, float], choice: str) -> Number:
        return drift_size("suppression", table, rows[run][choice], POSITION)

    def time_ratio(run: tuple[str, float], over: str, under: str) -> Number:
        """By the rounds, of which each has both, as of the effects."""
        labels = [rows[run][choice] for choice in (over, under)]
        found = ratio_interval(*(times[table.at[label, "key"]] for label in labels))
        text = "{} ({} to {})".format(
            *(short(each, ".3g") for each in (found.value, found.low, found.high))
        )
        return Number(text, "suppression", OWN_CPU, tuple(label + 1 for label in labels))

    def error_with(run: tuple[str, float], choice: str) -> Number:
        return value("suppression", table, rows[run][choice], ERROR)

    answer, findings = TracedText(), list[TracedText]()
    for run in measured.groupby("parameter", sort=False)["step"].min().items():
        if run[0] == "rtol" and {"baumgarte", "projection"} <= rows[run].keys():
            answer = traced(
                "At {} Baumgarte's terms take {} times projection's time; drift {}, not {} m; error {}, "
                "not {} m.",
                setting_of(*run),
                time_ratio(run, "baumgarte", "projection"),
                *(
                    cell(run, choice)
                    for cell in (drift_with, error_with)
                    for choice in ("baumgarte", "projection")
                ),
            )
        if {"none", "projection"} <= rows[run].keys():
            findings.append(
                traced(
                    "At {} projection takes {} times the engine time without stabilization.",
                    setting_of(*run),
                    time_ratio(run, "projection", "none"),
                )
            )
    half = (table[HIGH] - table[OWN_CPU]).combine(table[OWN_CPU] - table[LOW], max)
    settings = [setting_of(*run) for run in zip(table["parameter"], table["step"])]
    columns = (
        Column("variant", "method, stabilization"),
        Column("setting"),
        Column(OWN_CPU, "engine time", "ms", "half", interval=True, scale=1e3),
        Column("counter:rhs", "right-hand sides"),
        Column(POSITION, "drift", "m, rad"),
        Column(VELOCITY, "velocity drift", "m/s"),
        Column(ERROR, "position error", "m", "position_uncertainty"),
        Column("reason", brief=False),
    )
    shown = view(
        "suppression",
        "Cost, drift and error of the reference and of the paper's scheme, by stabilization; "
        "tolerance or step, and all else, are equal.",
        above_rounding(table.assign(half=half, setting=settings)),
        columns,
    )
    every = [Column(name) for name in table if name not in ("settings", "version", "key")]
    runs = view(
        "suppression-all",
        "Every run behind the stabilizations.",
        table,
        every,
        source="suppression",
        in_report=False,
    )
    return Presentation(
        answer,
        [*findings, without],
        tables=[shown, runs],
        notes=[
            "Drift is read at the output instants, as in the comparison of methods. The reference projects after each "
            "step; between steps it interpolates."
        ],
    )


STUDY = Study(
    "suppression",
    "Stabilization",
    "What does each stabilization cost and yield?",
    present,
    plan,
    seconds=0.1,
    on_page_one=False,
    takes=frozenset({"t_end", "repeats"}),
)
