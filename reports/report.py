"""A run and what is said of it: found once, and shown by every renderer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stiction.comparisons.bench.presentation import Figure, Presentation, TableView, TracedText
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.studies import studies
from stiction.reports.recommendation import recommendation


@dataclass(frozen=True)
class Report:
    """The results of a run, the presentation of each study that has anything to show, and the answer of page one."""

    results: Results
    said: Mapping[Study, Presentation]
    answer: tuple[TracedText, ...]

    @property
    def figures(self) -> list[Figure]:
        """The figures of all studies, in the order of the report."""
        return [figure for presentation in self.said.values() for figure in presentation.figures]

    @property
    def tables(self) -> list[TableView]:
        """The tables of all studies, in the order of the report."""
        return [view for presentation in self.said.values() for view in presentation.tables]


def report_of(results: Results) -> Report:
    """Let every study and the recommendation speak of the results."""
    found = {study: study.presented(results) for study in studies()}
    return Report(
        results,
        {study: said for study, said in found.items() if not said.is_empty},
        tuple(recommendation(results)),
    )
