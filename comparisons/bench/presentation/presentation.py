"""Presentation of a study: its answer, findings, tables and figures, for renderers that know no study by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stiction.comparisons.bench.presentation.charts import Figure
from stiction.comparisons.bench.presentation.table_view import TableView
from stiction.comparisons.bench.presentation.traced_text import TracedText

ANSWER_LENGTH = 160
"""Characters of an answer, at most: it stands on one line of a terminal, behind the study's title."""


@dataclass(frozen=True)
class Headline:
    """A column of the table on page one: its heading with unit, and cells by label of a method."""

    label: str
    cells: Mapping[str, TracedText]


@dataclass(frozen=True)
class Presentation:
    """Answer, findings, tables and figures of a study.

    Attributes
    ----------
    answer : TracedText
        One sentence or two, of at most `ANSWER_LENGTH` characters where numbers allow; empty if there is none.
    findings : sequence of TracedText
        Further sentences, in the study's section alone.
    headlines, tables, figures : sequences
    notes : sequence of str
        How to read tables and figures: definitions, signs, what may be compared.
    beside : TracedText
        A sentence that stands behind the answer on page one, which is not a line of a terminal.
    """

    answer: TracedText = TracedText()
    findings: Sequence[TracedText] = ()
    headlines: Sequence[Headline] = ()
    tables: Sequence[TableView] = ()
    figures: Sequence[Figure] = ()
    notes: Sequence[str] = ()
    beside: TracedText = TracedText()

    @property
    def is_empty(self) -> bool:
        """Nothing to show: then the study has no section."""
        return not (self.answer or self.findings or self.tables or self.figures)
