"""What the studies of a run say, study by study: what every renderer shows."""

from __future__ import annotations

from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study, studies


def presentations(results: Results) -> dict[Study, Presentation]:
    """The presentation of each study that has anything to show, in the order of the report."""
    found = {study: study.present(results) for study in studies()}
    return {study: said for study, said in found.items() if not said.is_empty}
