"""Drift suppression as a choice of its own: none, Baumgarte, projection after each step; cost, drift and error side by side.

The two ways of the reference take each choice at equal rtol or step; nothing else differs between the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.scene_truth import truth_for
from stiction.comparisons.studies.work_precision import Timed, TimedRun, cost_of, timed_comparison
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.variants import Record, Variant, scaled
from stiction.scenes import Scene

CHOICES = ("none", "baumgarte", "projection")
WAYS = (("event-driven", "rtol", (1e-6, 1e-9)), ("paper's scheme", "dt", (1e-2, 1e-3)))


def suppression_variants() -> tuple[Variant, ...]:
    """Both ways of the reference with each choice, at two tolerances or steps."""
    return tuple(Variant(f"{way}, {choice}", "reference", parameter, ladder, settings={
        "method": "event" if parameter == "rtol" else "paper", "stabilization": choice})
        for way, parameter, ladder in WAYS for choice in CHOICES)


def suppression_comparison(scene: Scene, *, t_end: float | None = None, repeats: int = 5) -> Comparison[Timed]:
    """One row per way, choice and rung; see `stiction.comparisons.studies.work_precision.work_precision` for the arguments.

    Baumgarte's alpha and beta are the scene's or, where it declares none, the paper's; they stand in the column settings.
    """

    def rows(records: Sequence[Record], timings: Sequence[Timing | None]) -> Iterator[dict[str, Any]]:
        truth, size = truth_for(scene, records, t_end), size_of(scene)
        for record, timing in zip(records, timings):
            yield {**record.describe(), "suppression": record.variant.settings["stabilization"], **cost_of(timing),
                   **drift(record.trajectory), **errors(record.trajectory, truth, size)}

    runs = [TimedRun(scene, variant, step) for variant in scaled(suppression_variants(), scene, t_end) for step in variant.ladder]
    return timed_comparison(scene, runs, t_end, repeats, rows)
