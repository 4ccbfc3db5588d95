"""A validation during which an engine's child process is killed ends as any other, and names what was lost."""

import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from conftest import LONG_STUDIES
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.comparisons.campaigns.measurement import NOT_RUN
from stiction.comparisons.campaigns.participants import variants as all_variants
from stiction.comparisons.campaigns.validation import validate
from stiction.comparisons.depth import Depth
from stiction.comparisons.studies.study import studies
from stiction.engines import Outcome
from stiction.reports import report_of, write_report

QUESTIONS = {study.name: study.question for study in studies()}
LAST = ["What failed?", "Parameters of the scenes", "Truths", "Provenance"]
KILLED = "SIGKILL (killed from outside, or out of memory)"

MORTAL = """
import os
import signal

from stiction.engines.pymunk.engine import PymunkEngine


class Mortal(PymunkEngine):
    \"\"\"pymunk, whose process dies half way through the second case with the finer step, in joint fidelity.\"\"\"

    name = "mortal"

    def run(self, scene, *, t_end, dt, fidelity, **others):
        if scene.name == "slider-bar-case-2" and dt == 2.5e-3 and fidelity == "joint":
            super().run(scene, t_end=t_end / 2, dt=dt, fidelity=fidelity, **others)
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(scene, t_end=t_end, dt=dt, fidelity=fidelity, **others)
"""


def check(folder: Path, printed: str, engine: str, left_out: set[str]) -> str:
    """Check a report with one killed run of `engine` without the studies `left_out`; return its row of failures."""
    text = (folder / "report.md").read_text()
    asked = [question for name, question in QUESTIONS.items() if name not in left_out]
    assert re.findall(r"^## (.*)$", text, re.M) == ["Terms", *asked, *LAST]
    assert all((folder / link).is_file() for link in re.findall(r"\]\(([^)]+)\)", text))
    failures = (folder / "failures.md").read_text()
    [row] = [line for line in failures.splitlines() if KILLED in line]
    assert f"| {engine} " in row and "| crashed " in row
    for first_page in (printed, text.partition("\n## ")[0]):
        assert "1 crashed" in " ".join(first_page.split())
    return row


# in every run: a killed child in test_isolation, failed runs in tests/reports, a whole validation in test_checkpoint
@pytest.mark.long
def test_a_child_that_dies_in_a_run(tmp_path, monkeypatch, compiled, short_validation):
    """The whole way of `stiction validate`."""
    (tmp_path / "mortal.py").write_text(MORTAL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    engine = "mortal:Mortal"
    short_validation(tuple(replace(variant, ladder=variant.ladder[:1]) if variant.engine == "reference" else variant
                           for variant in all_variants([engine], Depth.QUICK) if variant.engine == engine
                           or variant.label == "reference"))

    ended = CliRunner().invoke(app, ["validate", "--quick", "--engines", engine, "--out", "report"])

    assert ended.exit_code == 0, ended.output
    # `short_validation` leaves them out
    failures = check(tmp_path / "report", ended.output, engine, LONG_STUDIES)
    assert "slider-bar-case-2" in failures and "0.0025" in failures
    runs = pd.read_csv(tmp_path / "report" / "data" / "runs.csv")
    lost = runs[runs["status"] != "ok"]
    assert len(lost) == 1 and len(runs[runs["engine"] == engine]) == 3 * 2 * 2
    accuracy = pd.read_csv(tmp_path / "report" / "data" / "accuracy.csv").set_index("key")
    assert accuracy["position error [m]"].isna().sum() == 1
    assert pd.isna(accuracy.loc[lost["key"].item(), "position error [m]"])


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
