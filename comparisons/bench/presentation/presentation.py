"""What a study presents: rows that its text mentions, tables and figures.

The words are in a template, ``reports/templates/studies/NAME.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from stiction.comparisons.bench.presentation.charts import Figure
from stiction.comparisons.bench.presentation.table_view import TableView

ANSWER_LENGTH = 160
"""Characters of an answer, at most: it stands on one line of a terminal, behind the study's title."""


@dataclass(frozen=True)
class Headline:
    """A column of the table on page one: its heading with unit, and the text of its cells by label of a method."""

    label: str
    cells: Mapping[str, str]


@dataclass(frozen=True)
class Presentation:
    """Rows, tables and figures of a study.

    Attributes
    ----------
    rows : Mapping
        What the study's template mentions, by name: `Row`, `Cell`, numbers, words, flags, lists of
        these. Nothing in it is a sentence.
    headlines, tables, figures : sequences
        Captions of tables and figures are in the template.
    """

    rows: Mapping[str, object] = field(default_factory=dict)
    headlines: Sequence[Headline] = ()
    tables: Sequence[TableView] = ()
    figures: Sequence[Figure] = ()

    @property
    def is_empty(self) -> bool:
        """Nothing to show: then the study has no section."""
        return not (self.rows or self.tables or self.figures)
