"""What the studies of a run say, study by study: what every renderer shows."""

from __future__ import annotations

from dataclasses import replace

from stiction.comparisons.presentation.charts import Chart, Figure
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study, studies


def presentations(results: Results) -> dict[Study, Presentation]:
    """The presentation of each study that has anything to show, in the order of the report, without figures that show nothing."""
    found = {study: presented(study, results) for study in studies()}
    return {study: said for study, said in found.items() if not said.is_empty}


def presented(study: Study, results: Results) -> Presentation:
    """The presentation of one study, without figures that show nothing."""
    said = study.present(results)
    return replace(said, figures=tuple(figure for figure in said.figures if _shows_something(figure)))


def _shows_something(figure: Figure) -> bool:
    return not isinstance(figure, Chart) or any(len(series.x) for panel in figure.panels for series in panel.series)
