"""A run and what is said of it: found once, and shown by every renderer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stiction.comparisons.bench.presentation import Figure, TableView
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.studies import studies
from stiction.reports.text import Section, section_of


@dataclass(frozen=True)
class Report:
    """The results of a run, the section of each study that has anything to show."""

    results: Results
    said: Mapping[Study, Section]

    @property
    def figures(self) -> list[Figure]:
        """The figures of all studies, in the order of the report."""
        return [figure for section in self.said.values() for figure in section.figures]

    @property
    def tables(self) -> list[TableView]:
        """The tables of all studies, in the order of the report."""
        return [view for section in self.said.values() for view in section.tables]


def report_of(results: Results) -> Report:
    """Let every study speak of the results."""
    found = {study: section_of(study, results) for study in studies()}
    return Report(
        results,
        {study: said for study, said in found.items() if not said.is_empty},
    )
