"""The history holds every finished run once and whole, whenever the night that writes it is killed."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from conftest import invoke
from filelock import FileLock

from stiction.cli.exit_codes import COULD_NOT_RUN, NOT_COMPARED
from stiction.comparisons.bench.environment import origin
from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.timing.calibration import TIME
from stiction.comparisons.regression.history import HistoryRefused, open_history
from stiction.comparisons.regression.nightly import HISTORY
from stiction.scenes.atomic_files import NotWritten

ROOT = Path(__file__).parents[3]
FALL = Row(
    "ball/falling/dt=0.1",
    "free, joint, dt = 0.1; scene 1",
    "ball",
    "falling",
    "free",
    "1.0",
    "joint",
    "dt",
    0.1,
    "ok",
    "",
    {"step": 0.1},
    (
        Metric("position_error", "accuracy", 1e-3, 1e-9, "closed form"),
        Metric(TIME, "time", 2.5, 0.1),
    ),
)
LOST = Row(
    "ball/lost/dt=0.1",
    "gone, joint, dt = 0.1; scene 1",
    "ball",
    "lost",
    "gone",
    None,
    "joint",
    "dt",
    0.1,
    "crashed",
    "SIGSEGV",
)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "history.sqlite"


def test_pandas_reads_it_in_one_line(file):
    with open_history(file) as history:
        night = history.begin("c", "digest", origin())
        history.append(night, FALL)
        history.append(night, LOST)
        history.finish(night, "fine")
    assert list(file.parent.iterdir()) == [file]  # closed, it is one file
    frame = pd.read_sql("SELECT * FROM history", sqlite3.connect(file))
    assert list(frame["key"]) == [
        FALL.key,
        FALL.key,
        LOST.key,
    ]  # a run that did not come out is a row
    assert frame["value"].tolist()[:2] == [1e-3, 2.5] and frame["value"].isna()[2]
    assert (
        frame["reason"][2] == "SIGSEGV"
        and set(frame["night"]) == {night}
        and set(frame["verdict"]) == {"fine"}
    )


def test_rows_come_back_as_they_went_in_each_once_and_whole(file):
    with open_history(file) as history:
        night = history.begin("c", "digest", origin())
        history.append(night, FALL)
        history.append(night, LOST)
        number_twice = replace(
            FALL, key="ball/other/dt=0.1", metrics=(*FALL.metrics, FALL.metrics[0])
        )
        for row in (replace(FALL, reason="again"), number_twice):
            with pytest.raises(sqlite3.IntegrityError):
                history.append(night, row)
        assert history.rows(night) == [FALL, LOST]


def test_scenes_that_nights_once_drew_at_random_are_read_over(file):
    """As histories of older versions hold them: with a number for each class of outcomes, or with none."""
    drawn = replace(
        FALL,
        key="random/slider-bars/first=0",
        identity="random; 20 slider-bars of seed 7 from 0 on",
        scene="random slider-bars",
        variant="random",
        parameter="first",
        metrics=(Metric("agrees", "random", 40.0, tier="high precision"),),
    )
    lost = replace(drawn, key="random/slider-bars/first=20", status="not run", metrics=())
    with open_history(file) as history:
        night = history.begin("c", "digest", origin())
        for row in (drawn, FALL, lost):
            history.append(night, row)
        history.finish(night, "fine")
        assert history.rows(night) == [FALL]


def test_a_night_that_was_cut_off_is_resumed_unless_something_changed(file):
    with open_history(file) as history:
        first = history.begin("c", "digest", origin())
    with open_history(file) as history:
        assert history.begin("c", "digest", origin()) == first
        second = history.begin("c", "of another solver", origin())
        assert second != first
        history.finish(second, "fine")
        assert history.begin("c", "of another solver", origin()) not in (first, second)
        assert history.last_finished() == second


def test_times_are_those_of_finished_nights_under_the_same_conditions(file):
    here = origin()
    elsewhere = here | {"conditions": "another processor"}
    with open_history(file) as history:
        for seconds, place in ((1.0, here), (2.0, elsewhere), (3.0, here)):
            night = history.begin("c", str(seconds), place)
            history.append(night, replace(FALL, metrics=(replace(FALL.metrics[1], value=seconds),)))
            history.finish(night, "fine")
            time.sleep(0.002)  # nights are told apart by milliseconds
        last = history.begin("c", "unfinished", here)
        history.append(last, FALL)
        assert history.times(here["conditions"]) == {(FALL.identity, "free"): [1.0, 3.0]}
        assert history.times(here["conditions"], night) == {(FALL.identity, "free"): [1.0]}
        assert history.origin(last) == here


def test_first_night_of_a_run(file):
    """The first finished one in which it came out, whatever its name then."""
    with open_history(file) as history:
        nights = []
        for key, row, finished in (
            ("a", replace(FALL, status="crashed", metrics=()), True),
            ("b", FALL, False),
            ("c", replace(FALL, key="ball/other/dt=0.1"), True),
            ("d", FALL, True),
            ("e", FALL, True),
        ):
            nights.append(history.begin("c", key, origin()))
            history.append(nights[-1], row)
            if finished:
                history.finish(nights[-1], "fine")
            time.sleep(0.002)  # nights are told apart by milliseconds
        assert history.first(FALL.identity, nights[4]) == (
            nights[2],
            replace(FALL, key="ball/other/dt=0.1"),
        )
        assert (
            history.first(FALL.identity, nights[2]) is None
            and history.first("another", nights[4]) is None
        )


def test_something_else_is_refused(file, tmp_path):
    for content in (b"", b"not a database at all, but long enough to be taken for one" * 20):
        file.write_bytes(content)
        with (
            pytest.raises(HistoryRefused, match="expected a history"),
            open_history(file, write=False),
        ):
            pass
        assert file.read_bytes() == content
    with closing(sqlite3.connect(tmp_path / "of another format")) as connection:
        connection.executescript("CREATE TABLE nights (night TEXT); PRAGMA user_version = 99;")
    for path, words in (
        (tmp_path / "of another format", "format 99"),
        (tmp_path, "found a folder"),
    ):
        with pytest.raises(HistoryRefused, match=words), open_history(path):
            pass


RUNGS = 20
CAMPAIGN = f"""
scenes = ["block-on-incline"]
measure = ["accuracy", "drift", "counter"]
workers = 2
[variants.sleeping]
engine = "damaged_solvers:Sleeping"
dt = {[round(0.05 - 0.001 * i, 3) for i in range(RUNGS)]}
settings = {{ method = "paper" }}
"""


def contents(folder: Path) -> pd.DataFrame:
    """What another process reads at this moment; nothing before the night began."""
    nothing = pd.DataFrame(columns=["key", "metric", "value"])
    if not (folder / HISTORY).exists():
        return nothing
    with closing(sqlite3.connect(folder / HISTORY, timeout=30)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        try:
            return pd.read_sql("SELECT key, metric, value FROM history", connection)
        except pd.errors.DatabaseError:  # made, but without its tables yet
            return nothing


@pytest.mark.usefixtures("compiled")
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
def test_a_night_that_is_killed_while_it_writes_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """Its process group is killed when rows come fast: no run with a part of its numbers, none twice, none lost."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "baseline.toml").write_text("format = 2\n")
    command = [
        sys.executable,
        "-m",
        "stiction",
        "nightly",
        "campaign.toml",
        "--baseline",
        "baseline.toml",
        "--out",
        "out",
    ]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests' / 'support'}"}
    night = subprocess.Popen(
        command, cwd=tmp_path, env=environment, start_new_session=True, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 600
    while contents(tmp_path / "out").empty and night.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.1)
    os.killpg(night.pid, signal.SIGKILL)
    night.wait()
    seen = contents(tmp_path / "out")
    assert len(seen) and not seen.duplicated(["key", "metric"]).any()
    assert seen.groupby("key").size().drop("block-on-incline/truth", errors="ignore").nunique() <= 1
    monkeypatch.chdir(tmp_path)
    invoke(*command[3:], exit_code=NOT_COMPARED)
    whole = contents(tmp_path / "out")
    assert len(whole["key"].unique()) == RUNGS + 1 and not whole.duplicated(["key", "metric"]).any()
    kept = seen.merge(whole, on=["key", "metric"], how="left", suffixes=("", " now"))
    assert (kept["value"] == kept["value now"]).all()
    with closing(sqlite3.connect(tmp_path / "out" / HISTORY)) as connection:  # one night, resumed
        assert connection.execute("SELECT count(*), count(finished) FROM nights").fetchone() == (
            1,
            1,
        )


def test_two_nights_at_once_are_refused(tmp_path):
    (tmp_path / "baseline.toml").write_text("format = 2\n")
    with FileLock(tmp_path / f".{HISTORY}.lock"):
        ended = invoke(
            "nightly",
            "--baseline",
            tmp_path / "baseline.toml",
            "--out",
            tmp_path,
            exit_code=COULD_NOT_RUN,
        )
    assert "another night is being written" in ended.stderr


def test_a_full_disk_is_no_matter_of_the_file(file):
    """The command ends with the code of a file that could not be written, as others do; what is in the history stays."""
    with open_history(file) as history:
        night = history.begin("c", "digest", origin())
        history.append(night, FALL)
    with (
        pytest.raises(NotWritten, match="history.sqlite: not written: .*full"),
        open_history(file) as history,
    ):
        history.connection.execute("PRAGMA max_page_count = 1")  # no page more than there are
        for number in range(10_000):
            history.append(night, replace(LOST, key=f"{number}"))
    with open_history(file) as history:
        assert history.rows(night)[0] == FALL
