"""The presentation of a study: the rows that its text mentions, tables and figures.

The text itself is a template, ``reports/templates/studies/NAME.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from stiction.comparisons.bench.presentation.charts import Figure
from stiction.comparisons.bench.presentation.table_view import TableView

ANSWER_LENGTH = 160
"""Largest number of characters of an answer, which is printed on one line of a terminal after the
study's title."""


@dataclass(frozen=True)
class Headline:
    """A column of the table on page one: its heading with unit, and the text of its cells by label of a variant."""

    label: str
    cells: Mapping[str, str]


@dataclass(frozen=True)
class Presentation:
    """Rows, tables and figures of a study.

    Attributes
    ----------
    rows : Mapping
        Values that the template mentions, by name: `Row`, `Cell`, numbers, words, flags, and lists
        of these, but no sentences.
    headlines : sequence of Headline
        Columns of the table on page one.
    tables, figures : sequences
        Without captions, which are in the template.
    """

    rows: Mapping[str, object] = field(default_factory=dict)
    headlines: Sequence[Headline] = ()
    tables: Sequence[TableView] = ()
    figures: Sequence[Figure] = ()

    @property
    def is_empty(self) -> bool:
        """True if there is nothing to show, so that the report has no section for the study."""
        return not (self.rows or self.tables or self.figures)
