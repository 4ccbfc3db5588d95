"""Random scenes of a night: drawn afresh, judged without a baseline; runs in its history, its budget and its report.

The scenes are drawn by `random_slider_bars.drawn` and `resting_mechanisms.drawn`.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from stiction.comparisons.bench.planned_runs import NOT_RUN, RANDOM, Metric, Row
from stiction.comparisons.measures.accuracy import WRONG
from stiction.comparisons.random_scenes import random_slider_bars, resting_mechanisms
from stiction.comparisons.random_scenes.random_study import RandomScenes
from stiction.engines.isolation import Task
from stiction.engines.registry import load_engine
from stiction.truths import HIGH_PRECISION

STUDIES: Mapping[str, RandomScenes] = {
    "slider-bars": random_slider_bars.STUDY,
    "mechanisms": resting_mechanisms.STUDY,
}
"""By the words of a report."""
BATCH = {"slider-bars": 20, "mechanisms": 4}
"""Scenes of one run of a night: some seconds."""


@dataclass(frozen=True)
class Draw:
    """A run of a night: `count` scenes of a study and a seed from `first` on. It has what a `PlannedRun` has."""

    what: str
    seed: int
    first: int
    count: int

    @property
    def key(self) -> str:
        return f"{RANDOM}/{self.what}/first={self.first}"

    @property
    def identity(self) -> str:
        return f"{RANDOM}; {self.count} {self.what} of seed {self.seed} from {self.first} on"

    @property
    def row(self) -> Row:
        """Row before the run is made."""
        settings = {
            "what": self.what,
            "seed": self.seed,
            "count": self.count,
            "rtol": STUDIES[self.what].rtols,
        }
        return Row(
            self.key,
            self.identity,
            f"random {self.what}",
            RANDOM,
            "reference",
            None,
            "joint",
            "first",
            self.first,
            NOT_RUN,
            "",
            settings,
        )

    def task(self, kinds: Collection[str], repeats: int) -> Task:
        return Task(self.key, _measured, (self,))


def draws_of_night(night: str, counts: Mapping[str, int]) -> list[Draw]:
    """The draws of a night, with a seed that is the night's own: one that is gone on with goes on with its draws."""
    seed = int.from_bytes(hashlib.sha256(night.encode()).digest()[:4])
    return [
        Draw(what, seed, first, min(BATCH[what], count - first))
        for what, count in counts.items()
        for first in range(0, count, BATCH[what])
    ]


def _measured(draw: Draw) -> Row:
    """Count the verdicts of each class, in the child; name what is wrong, and the command that shows it again."""
    study, counts, failing = STUDIES[draw.what], Counter[str](), list[str]()
    for i, verdict in study.judged(draw.seed, draw.first, draw.count):
        counts[verdict.outcome] += 1
        if verdict.outcome in study.failing:
            again = f"python -m {__package__} {draw.what} {draw.seed} {i}"
            failing.append(f"{verdict.outcome}: {verdict.detail}; {verdict.about}; {again}")
    metrics = tuple(
        Metric(outcome, RANDOM, counts[outcome], tier=HIGH_PRECISION)
        for outcome in study.outcomes
        if counts[outcome]
    )
    return replace(
        draw.row,
        version=load_engine("reference").version,
        status=WRONG if failing else "ok",
        reason=" | ".join(failing),
        metrics=metrics,
    )


def sentences_on_draws(rows: Sequence[Row]) -> str:
    """Sentences on the draws among the rows of a night, with their seed; empty if there are none."""
    said = []
    drawn = [
        (row.settings, row.metrics)
        for row in rows
        if row.variant == RANDOM and row.settings is not None
    ]
    for what, study in STUDIES.items():
        if not (
            of_study := [
                (settings, metrics) for settings, metrics in drawn if settings["what"] == what
            ]
        ):
            continue
        counts, scenes, missing = Counter[str](), 0, 0
        for settings, metrics in of_study:
            counts.update({metric.name: int(metric.value) for metric in metrics})
            scenes += settings["count"]
            missing += 0 if metrics else settings["count"]
        numbers = ", ".join(
            f"{counts[outcome]} {outcome}" for outcome in study.outcomes if counts[outcome]
        )
        rtols = ", ".join(f"{rtol:g}" for rtol in study.rtols)
        said.append(
            f"Seed {of_study[0][0]['seed']}, {scenes} {what} of at most {study.t_end:g} s at rtol {rtols}, "
            f"against the independent solution: {numbers or 'none'}"
            + (f"; {missing} {what} without a result." if missing else ".")
        )
    return " ".join(said)
