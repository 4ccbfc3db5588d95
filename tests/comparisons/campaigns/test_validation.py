"""A validation that is interrupted ends at once with a report that says so."""

import pytest

from stiction.comparisons.campaigns.measurement import NOT_RUN
from stiction.comparisons.campaigns.participants import variants as all_variants
from stiction.comparisons.campaigns.validation import validate
from stiction.comparisons.depth import Depth
from stiction.engines import Outcome
from stiction.reports import report_of, write_report


def test_an_interrupted_validation_ends_at_once_with_a_report(tmp_path, monkeypatch, compiled, short_validation):
    """Before anything was run: no truth is looked for, each of which takes seconds, and no engine is said to fail."""
    short_validation(tuple(all_variants(["pymunk"], Depth.QUICK))[:3])
    monkeypatch.setattr("stiction.comparisons.measures.scene_truth.ground_truth",
                        lambda *_: pytest.fail("a truth was looked for"))

    def not_run(tasks, *, on_result=None, **_):
        outcomes = [Outcome(task.label, NOT_RUN, reason="interrupted") for task in tasks]
        for outcome in outcomes if on_result else ():
            on_result(outcome)
        return outcomes

    done = validate(depth=Depth.QUICK, engines=["pymunk"], isolated=not_run)
    text = write_report(report_of(done), tmp_path / "run").read_text()
    assert not done.truths and set(done.tables["hard"]["verdict"]) == {"not run"}
    assert f"0 of {len(done.records)} compared runs succeeded; {len(done.records)} not run." in " ".join(text.split())
    page = text.partition("\n## ")[0]
    assert done.settings["interrupted"] and "It was interrupted" in page and "Hard cases" not in page
