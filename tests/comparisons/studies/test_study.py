"""What holds for every study."""

import pandas as pd
import pytest

from stiction.comparisons.bench.results import Results
from stiction.comparisons.studies import studies

NOTHING = {study.name: pd.DataFrame() for study in studies()}
NO_RUN = {
    name: pd.DataFrame(
        {"scene": ["a"], "variant": ["a"], "status": ["missing"], "reason": ["none"]}
    )
    for name in ("cost", "drift", "study", "settings", "threshold", "torque")
}


@pytest.mark.parametrize("study", studies(), ids=lambda study: study.name)
@pytest.mark.parametrize(
    "tables", [{}, NOTHING, NO_RUN], ids=["no tables", "empty tables", "no run"]
)
def test_a_study_without_runs_has_nothing_to_show(study, tables):
    said = study.presented(Results((), {}, tables))
    assert said.is_empty and not said.headlines
