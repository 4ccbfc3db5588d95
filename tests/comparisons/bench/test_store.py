"""A campaign that is cut off keeps what it has finished, and the same campaign, called again, goes on with it."""

import os
import pickle
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, nullcontext, suppress
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from child_tasks import fail, hang, note, say_and_abort
from conftest import called_here, invoke

from stiction.cli import exit_codes
from stiction.cli.campaign import _end_runs
from stiction.cli.exit_codes import INTERRUPTED, TERMINATED, Terminated, first_signal
from stiction.comparisons.bench import executors
from stiction.comparisons.bench import identity as digest
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import variants as all_variants
from stiction.comparisons.bench.store import KeptRefused, kept_file, kept_runs
from stiction.engines import EngineFailure, Outcome, Task
from stiction.reports import write_report
from stiction.scenes import load_scene, vary
from stiction.scenes.atomic_files import NotWritten

ENGINES = ["reference"]


FAIL = Task("fail", fail, (EngineFailure, "gave up"))
CRASH = Task("crash", say_and_abort)


def run(folder, tasks, **options):
    with kept_runs(folder, ENGINES) as runs:
        outcomes = runs.isolate(
            tasks, workers=1, timeout_s=options.pop("timeout_s", 600.0), **options
        )
        return outcomes, runs.taken_over


def test_settled_outcomes_are_taken_over_and_others_run_again(tmp_path):
    tasks = [Task("note", note, (str(tmp_path / "calls"),)), FAIL, CRASH]
    (first, none), told = run(tmp_path / "out", tasks), []
    (second, two) = run(
        tmp_path / "out", tasks, on_result=lambda outcome: told.append(outcome.label)
    )
    assert (none, two) == (0, 2) and (tmp_path / "calls").read_text() == "x"
    assert [o.status for o in first] == [o.status for o in second] == ["ok", "failed", "crashed"]
    assert second[:2] == first[:2]
    assert sorted(told) == ["crash", "fail", "note"]


def test_nothing_stale_is_taken_over(tmp_path, monkeypatch):
    calls, scene = str(tmp_path / "calls"), load_scene("pendulum")

    def taken_over(*args, timeout_s=600.0):
        return run(
            tmp_path / "out",
            [Task("note", note, (calls, *args))],
            timeout_s=timeout_s,
            made_by=called_here,
        )[1]

    assert [taken_over(scene, {"dt": 1e-2}), taken_over(scene, {"dt": 1e-2})] == [0, 1]
    assert taken_over(vary(scene, {"t_end": 1.0}), {"dt": 1e-2}) == 0
    assert taken_over(scene, {"dt": 1e-3}) == 0
    assert taken_over(scene, {"dt": 1e-2}, timeout_s=601.0) == 0
    assert run(tmp_path / "twice", [Task("note", note, (calls,))] * 2, made_by=called_here)[1] == 0
    monkeypatch.setattr(digest, "source_digest", lambda: "another code")
    assert taken_over(scene, {"dt": 1e-2}) == 0
    monkeypatch.setattr(digest, "engine_identity", lambda name: [name, "another version"])
    assert taken_over(scene, {"dt": 1e-2}) == 0


def test_an_interrupt_leaves_the_rest_as_not_run(tmp_path):
    def interrupt(outcome):
        if outcome.label == "first":
            raise KeyboardInterrupt

    with kept_runs(tmp_path / "out", ENGINES) as runs:
        outcomes = runs.isolate(
            [Task("first", note, (str(tmp_path / "a"),)), Task("second", hang)],
            workers=1,
            timeout_s=600,
            on_result=interrupt,
        )
        assert [(o.status, o.reason) for o in outcomes] == [("ok", ""), ("not run", "interrupted")]
        assert runs.interrupt is not None
        [later] = runs.isolate([Task("later", hang)], timeout_s=600)
        assert later.status == "not run"
    assert run(tmp_path / "out", [Task("first", note, (str(tmp_path / "a"),))])[1] == 1


def test_an_interrupt_between_runs_is_noted_and_one_without_any_outcome_is_raised(tmp_path):
    def interrupt(outcome):
        raise KeyboardInterrupt

    with kept_runs(tmp_path / "out", ENGINES) as runs:
        with pytest.raises(KeyboardInterrupt):
            runs.isolate(
                [Task("first", hang)], timeout_s=600, made_by=lambda *_, **__: interrupt(None)
            )
        with pytest.raises(KeyboardInterrupt):
            runs.end(KeyboardInterrupt())
    assert not kept_file(tmp_path / "out").exists()  # nothing to go on with
    with kept_runs(tmp_path / "out", ENGINES) as runs:
        runs.isolate([FAIL], timeout_s=600, made_by=called_here)
        runs.end(KeyboardInterrupt())  # while what was made is tabulated
        assert runs.isolate([Task("later", hang)], timeout_s=600)[0].status == "not run"
    assert kept_file(tmp_path / "out").exists()


def test_an_interrupt_that_was_dropped_ends_the_runs_at_the_next_outcome(tmp_path):
    """Python only reports what a handler raises within a finalizer."""

    def made_by(tasks, *, on_result, **options):
        with suppress(KeyboardInterrupt):
            runs.end(KeyboardInterrupt())
        return called_here(tasks, on_result=on_result)

    with kept_runs(tmp_path / "out", ENGINES) as runs:
        outcomes = runs.isolate([FAIL, FAIL], timeout_s=600, made_by=made_by)
        assert [outcome.status for outcome in outcomes] == ["failed", "not run"]


def test_an_interrupt_is_noted_where_nobody_reads_standard_error(tmp_path, monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    with kept_runs(tmp_path / "out", ENGINES) as runs, open(writer, "w", buffering=1) as broken:
        runs.isolate([FAIL], timeout_s=600, made_by=called_here)
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", broken)
            _end_runs(runs, KeyboardInterrupt())
        assert runs.interrupt is not None
        with suppress(OSError):
            broken.close()


@pytest.mark.parametrize(
    ("same_signal_s", "second", "raised"),
    [
        (600.0, signal.SIGTERM, None),
        (600.0, signal.SIGINT, KeyboardInterrupt),
        (-1.0, signal.SIGTERM, Terminated),
    ],
)
def test_a_signal_that_comes_twice_at_once_is_one(
    same_signal_s, second, raised, interruptible, monkeypatch
):
    monkeypatch.setattr(exit_codes, "SAME_SIGNAL_S", same_signal_s)
    before, taken = signal.signal(signal.SIGTERM, exit_codes.terminate), []
    try:
        with nullcontext() if raised is None else pytest.raises(raised), first_signal(taken.append):
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(second)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert [type(interrupt) for interrupt in taken] == [Terminated]


KILLED = """
import sys
sys.path[:0] = {path!r}
from pathlib import Path
from child_tasks import hang, note
from stiction.comparisons.bench.store import kept_runs
from stiction.engines import Task
if __name__ == "__main__":
    with kept_runs(Path({out!r}), ["reference"]) as runs:
        tasks = [Task("note", note, ({calls!r},)), Task("hang", hang)]
        runs.isolate(tasks, workers=1, timeout_s=600.0, on_result=lambda outcome: print(outcome.label, flush=True))
"""


def test_a_kill_leaves_what_was_done(tmp_path):
    script = tmp_path / "campaign.py"
    script.write_text(
        KILLED.format(path=sys.path, out=str(tmp_path / "out"), calls=str(tmp_path / "calls"))
    )
    campaign = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert campaign.stdout.readline() == "note\n"
    campaign.send_signal(signal.SIGKILL)
    campaign.communicate(timeout=600)
    assert run(tmp_path / "out", [Task("note", note, (str(tmp_path / "calls"),))])[1] == 1
    assert (tmp_path / "calls").read_text() == "x"


def test_a_full_disk_ends_the_campaign_with_the_name_of_the_file(tmp_path):
    with kept_runs(tmp_path / "out", ENGINES) as runs:
        runs._connection.execute(
            "PRAGMA max_page_count = 3"
        )  # the database as full as a disk can be
        with pytest.raises(
            NotWritten, match=r"\.out\.unfinished\.sqlite: not written: database or disk is full"
        ):
            runs.isolate([Task("large", os.urandom, (10**6,))], timeout_s=600, made_by=called_here)


def test_a_file_that_another_process_writes_to_and_one_that_is_no_database_are_refused(tmp_path):
    with kept_runs(tmp_path / "out", ENGINES) as runs:
        runs.isolate([FAIL], timeout_s=600, made_by=called_here)
        with (
            pytest.raises(KeptRefused, match="another process writes to it"),
            kept_runs(tmp_path / "out", ENGINES),
        ):
            pass
    kept_file(tmp_path / "text").write_text("not a database" * 100)
    with (
        pytest.raises(KeptRefused, match="not a database; delete it"),
        kept_runs(tmp_path / "text", ENGINES),
    ):
        pass


def test_a_damaged_run_is_refused_with_what_to_do_and_one_of_other_code_is_made_anew(
    tmp_path, monkeypatch
):
    """Also where the file has runs as an earlier version wrote them, which had other code."""
    calls = tmp_path / "calls"
    tasks = [Task("note", note, (str(calls),))]
    run(tmp_path / "out", tasks, made_by=called_here)
    with closing(sqlite3.connect(kept_file(tmp_path / "out"))) as database, database:
        database.execute("UPDATE outcomes SET outcome = ?", (pickle.dumps(Outcome("0", "ok", 1)),))
    with pytest.raises(
        KeptRefused,
        match=r"\.out\.unfinished\.sqlite: damaged .*; delete it to begin anew",
    ):
        run(tmp_path / "out", tasks, made_by=called_here)
    monkeypatch.setattr(digest, "source_digest", lambda: "another code")
    assert run(tmp_path / "out", tasks, made_by=called_here)[1] == 0 and calls.read_text() == "xx"
    assert run(tmp_path / "out", tasks, made_by=called_here)[1] == 1 and calls.read_text() == "xx"


def test_validate_goes_on_where_it_stopped(
    tmp_path, monkeypatch, interruptible, in_this_process, short_validation
):
    """SIGTERM after five runs of the command, then the same call, and an interrupt while its report is written."""
    monkeypatch.chdir(tmp_path)
    short_validation(
        tuple(
            replace(variant, ladder=variant.ladder[:1])
            for variant in all_variants([], Depth.QUICK)
            if variant.label in ("reference", "paper's scheme")
        )
    )
    whole, count = executors.isolate, 5

    def isolate(tasks, *, on_result, **options):
        def interrupted(outcome):
            nonlocal count
            on_result(outcome)
            count -= 1
            if not count:
                signal.raise_signal(signal.SIGTERM)

        return whole(tasks, on_result=interrupted, **options)

    command = ["validate", "--quick", "--engines", "reference", "--out", "report"]
    with monkeypatch.context() as patch:
        patch.setattr(executors, "isolate", isolate)
        cut = invoke(*command, exit_code=TERMINATED)
    assert "writing the report of the finished runs" in cut.stderr
    assert "ended by SIGTERM: the report contains the runs that were finished" in cut.stderr
    assert "repeat the command with --out report" in cut.output
    assert kept_file(Path("report")).exists()
    assert "The run was interrupted" in Path("report/report.md").read_text()
    assert "0/0/0/0" not in Path("report/report.md").read_text()
    rows = pd.read_csv("report/data/runs.csv")
    assert set(rows["status"]) == {"ok", "not run"}
    assert set(rows.loc[rows["status"] == "not run", "reason"]) == {"interrupted"}
    with closing(sqlite3.connect(kept_file(Path("report")))) as database:
        assert database.execute("SELECT count(*) FROM outcomes").fetchone() == (5,)

    def write(*given):
        signal.raise_signal(signal.SIGINT)
        return write_report(*given)

    monkeypatch.setattr("stiction.reports.write_report", write)
    ended = invoke(*command, exit_code=INTERRUPTED)
    assert "5 runs were taken over from an earlier call" in ended.output, ended.output
    assert (
        set(pd.read_csv("report/data/runs.csv")["status"]) == {"ok"}
        and kept_file(Path("report")).exists()
    )
    assert "runs taken over" in Path("report/report.md").read_text()
    assert "The run was interrupted" not in Path("report/report.md").read_text()
