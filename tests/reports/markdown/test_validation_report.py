"""Parts of the report of a validation that no study presents."""

import pandas as pd

from stiction.comparisons.bench.results import Results
from stiction.reports.markdown.validation_report import _truths


def test_uncertainties_of_truths_stay_bounds():
    compared = pd.DataFrame(
        [{"truth": "a", "truth_tier": "proven", "position_uncertainty": 2.328e-14}]
    )
    assert "± 2.4e-14" in _truths(Results((), {}, {"any table": compared}))
    assert _truths(Results((), {}, {})) == ""
