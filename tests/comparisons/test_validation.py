"""A validation during which an engine's process is killed, or which is interrupted, ends with a report that says so."""

from dataclasses import replace

import pandas as pd
import pytest
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.cli.exit_codes import FINE
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import variants as all_variants
from stiction.comparisons.studies import accuracy
from stiction.comparisons.validation import validate
from stiction.engines import Outcome
from stiction.engines.status import Status
from stiction.reports import report_of, write_report

MORTAL = """
import os
import signal

from stiction.engines.pymunk.engine import PymunkEngine

class Mortal(PymunkEngine):
    name = "mortal"

    def run(self, scene, **arguments):
        if scene.name == "slider-bar-case-2":
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(scene, **arguments)
"""


def test_a_child_that_dies_in_a_run_is_a_row(tmp_path, monkeypatch, compiled, short_validation):
    """The whole way of `stiction validate` with the study of accuracy: all other runs are made and measured."""
    (tmp_path / "mortal.py").write_text(MORTAL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    engine = "mortal:Mortal"
    first = {
        variant.label: replace(variant, ladder=variant.ladder[:1])
        for variant in all_variants([engine], Depth.QUICK)
    }
    short_validation(
        (first["reference"], next(way for way in first.values() if way.engine == engine))
    )
    monkeypatch.setattr("stiction.comparisons.validation.studies", lambda: [accuracy.STUDY])

    ended = CliRunner().invoke(app, ["validate", "--quick", "--engines", engine, "--out", "report"])

    assert ended.exit_code == FINE and "1 crashed" in " ".join(ended.output.split()), ended.output
    runs, measured = (
        pd.read_csv(f"report/data/{name}.csv").set_index("key") for name in ("runs", "accuracy")
    )
    [lost] = runs.index[runs["status"] != "ok"]
    assert list(runs.loc[lost, ["engine", "scene", "status"]]) == [
        engine,
        "slider-bar-case-2",
        "crashed",
    ]
    assert len(runs) == 2 * 3 and list(measured.index[measured["position_error"].isna()]) == [lost]
    [row] = [
        line
        for line in (tmp_path / "report" / "failures.md").read_text().splitlines()
        if "SIGKILL" in line
    ]
    assert engine in row and "slider-bar-case-2" in row


def test_an_interrupted_validation_ends_at_once_with_a_report(
    tmp_path, monkeypatch, compiled, short_validation
):
    """Before anything was run: no truth is looked for, each of which takes seconds, and no engine is said to fail."""
    short_validation(tuple(all_variants(["pymunk"], Depth.QUICK))[:3])
    monkeypatch.setattr(
        "stiction.comparisons.measures.scene_truth.ground_truth",
        lambda *_: pytest.fail("a truth was looked for"),
    )

    def not_run(tasks, *, on_result=None, **_):
        outcomes = [Outcome(task.label, Status.NOT_RUN, reason="interrupted") for task in tasks]
        for outcome in outcomes if on_result else ():
            on_result(outcome)
        return outcomes

    done = validate(depth=Depth.QUICK, engines=["pymunk"], isolated=not_run)
    text = write_report(report_of(done), tmp_path / "run").read_text()
    assert not done.truths and set(done.tables["hard"]["verdict"]) == {"not run"}
    assert (
        f"0 of {len(done.records)} compared runs succeeded; {len(done.records)} not run."
        in " ".join(text.split())
    )
    page = text.partition("\n## ")[0]
    assert (
        done.settings["interrupted"]
        and "The run was interrupted" in page
        and "Hard cases" not in page
    )
