"""Whatever is lost, in whichever comparison, stands among the failures with its reason and its row."""

from dataclasses import replace

import pandas as pd
import pytest

from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.studies.claims import CHOICES, claims_comparison, sensitivity_comparison
from stiction.comparisons.studies.long_drift import drift_study_comparison
from stiction.comparisons.studies.orders import METHODS, plan
from stiction.engines import Outcome
from stiction.reports.markdown.failures import failed_runs, group_failures
from stiction.scenes import load_scene
from stiction.truths import StickThreshold

CASES = {case: load_scene(f"slider-bar-case-{case}") for case in (1, 2, 3)}
WORDS = "no result within 240 s"


def lost_tables() -> dict[str, pd.DataFrame]:
    """The tables of comparisons none of whose runs came out."""
    comparisons = {
        "study": drift_study_comparison(CASES),
        "orders": plan(Scope((CASES[1],))),
        "sensitivity": sensitivity_comparison(CASES),
        "claims": claims_comparison(CASES, StickThreshold(4.2, 1e-9, (4.1, 4.3))),
    }
    tables = {
        name: comparison.tabulate(
            [Outcome(task.label, "timed out", reason=WORDS) for task in comparison.tasks]
        )
        for name, comparison in comparisons.items()
    }
    return {**tables, **{name: tables[name].tables[name] for name in ("study", "orders")}}


@pytest.mark.parametrize(
    "name, count",
    [("study", None), ("orders", len(METHODS)), ("sensitivity", len(CHOICES)), ("claims", None)],
)
def test_lost_rows_of_every_comparison_are_failures(validation, name, count):
    table = lost_tables()[name]
    lost = failed_runs(replace(validation, records=(), tables={name: table}))
    assert (
        len(lost) == len(table) == (count or len(table))
        and set(lost["table"]) == {name}
        and list(lost["row"]) == list(range(1, len(table) + 1))
    )
    assert (
        set(lost["status"]) == {"timed out"}
        and set(lost["reason"]) == {WORDS}
        and lost["variant"].notna().all()
    )
    rows = group_failures(lost)
    assert (
        rows["runs"].sum() == len(table)
        and not rows.isna().any(axis=None)
        and not rows.astype(str).apply(lambda column: column.str.contains("nan")).any(axis=None)
    )


def test_what_came_out_is_no_failure(validation):
    tables = {
        "sensitivity": pd.DataFrame({"choice": ["a", "b"], "status": "ok", "reason": ""}),
        "study": validation.tables["study"].assign(status="ok"),
    }
    assert failed_runs(replace(validation, records=(), tables=tables)).empty


def test_an_engine_that_is_not_installed_is_no_loss(validation):
    """Neither among the runs nor in a table; and no step is no setting."""
    table = pd.DataFrame(
        {
            "variant": ["absent", "other"],
            "scene": "s",
            "parameter": "dt",
            "step": 0.01,
            "status": ["missing", "crashed"],
            "reason": ["No module named 'absent'", "SIGABRT"],
        }
    )
    lost = failed_runs(replace(validation, tables={"threshold": table}))
    assert "missing" in {record.outcome.status for record in validation.records}
    assert not {"missing"} & set(lost["status"]) and list(
        lost[lost["table"] == "threshold"]["variant"]
    ) == ["other"]
    assert setting_of("", float("nan")) == ""
