"""Presentation of a study as data: rows that its text mentions, tables with labels and units, figures."""

from stiction.comparisons.bench.presentation.charts import (
    BETTER,
    CHOSEN,
    LIMIT,
    OTHER,
    TRUTH,
    Axis,
    Chart,
    Figure,
    HeatMap,
    MechanismPicture,
    Panel,
    Series,
)
from stiction.comparisons.bench.presentation.presentation import (
    ANSWER_LENGTH,
    Headline,
    Presentation,
)
from stiction.comparisons.bench.presentation.rows import Cell, Row, row_of
from stiction.comparisons.bench.presentation.table_view import (
    METHOD,
    REFINED_BY,
    Column,
    TableView,
    view,
)

__all__ = [
    "ANSWER_LENGTH",
    "BETTER",
    "CHOSEN",
    "LIMIT",
    "METHOD",
    "OTHER",
    "REFINED_BY",
    "TRUTH",
    "Axis",
    "Cell",
    "Chart",
    "Column",
    "Figure",
    "Headline",
    "HeatMap",
    "MechanismPicture",
    "Panel",
    "Presentation",
    "Row",
    "Series",
    "TableView",
    "row_of",
    "view",
]
