"""Presentation of a study: sentences whose numbers are cells, tables with labels and units, charts as data."""

from stiction.comparisons.bench.presentation.charts import (BETTER, CHOSEN, LIMIT, OTHER, TRUTH, Axis, Chart, Figure,
                                                            HeatMap, MechanismPicture, Panel, Series)
from stiction.comparisons.bench.presentation.presentation import ANSWER_LENGTH, Headline, Presentation
from stiction.comparisons.bench.presentation.table_view import Column, TableView, view
from stiction.comparisons.bench.presentation.traced_text import (Number, Part, TracedText, count, interval, joined,
                                                                 length, listed, scaled_value, sentence, short, traced,
                                                                 value, within)

__all__ = ["ANSWER_LENGTH", "BETTER", "CHOSEN", "LIMIT", "OTHER", "TRUTH", "Axis", "Chart", "Column", "Figure",
           "Headline", "HeatMap", "MechanismPicture", "Number", "Panel", "Part", "Presentation", "Series", "TableView",
           "TracedText", "count", "interval", "joined", "length", "listed", "scaled_value", "sentence", "short",
           "traced", "value", "view", "within"]
