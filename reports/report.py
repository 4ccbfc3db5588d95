"""A report: the results of a run, and the section of each study, which all renderers show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stiction.comparisons.bench.presentation import Figure, TableView
from stiction.comparisons.bench.results import NOT_APPLICABLE, Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.studies import studies
from stiction.reports.text import Section, section_of


@dataclass(frozen=True)
class Report:
    """The results of a run and the sections that describe them.

    Attributes
    ----------
    results : Results
        The runs and tables of all studies.
    sections : mapping of Study to Section
        The section of each study that has something to show, in the order of the report.
    """

    results: Results
    sections: Mapping[Study, Section]

    @property
    def not_examined(self) -> Mapping[str, str]:
        """By title of a study, why it has no section or not all scenes, in one line; empty for the paper's cases."""
        reasons = dict(self.results.settings.get(NOT_APPLICABLE, {}))
        if self.results.is_about_paper:
            return reasons
        for study in studies():
            is_made = study.name in self.results.tables
            if is_made and study not in self.sections:
                reasons.setdefault(study.title, study.nothing)
        return reasons

    @property
    def figures(self) -> list[Figure]:
        """The figures of all studies, in the order of the report."""
        return [figure for section in self.sections.values() for figure in section.figures]

    @property
    def tables(self) -> list[TableView]:
        """The tables of all studies, in the order of the report."""
        return [view for section in self.sections.values() for view in section.tables]


def report_of(results: Results) -> Report:
    """Return the report of a run, with the sections of all studies that are not empty."""
    sections = {study: section_of(study, results) for study in studies()}
    return Report(
        results, {study: section for study, section in sections.items() if not section.is_empty}
    )
