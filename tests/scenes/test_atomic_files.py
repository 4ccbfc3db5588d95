"""Files and folders appear whole or not at all, and no output takes the place of its source."""

import errno
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import content, invoke
from matplotlib.figure import Figure

from stiction.comparisons.bench.complementarity.problems import STORED
from stiction.reports import REPORT, FolderRefused, check_folder
from stiction.reports.figures.style import Drawing, rc, save
from stiction.reports.run_folder.overwriting import run_folder
from stiction.scenes.atomic_files import NotWritten, whole_file, write_text
from stiction.scenes.pictures.picture import content as content_of


@pytest.fixture
def full_disk(monkeypatch):
    """Every table written from here on meets the end of the disk after its first bytes."""

    def to_csv(self, path, **_):
        Path(path).write_text("t,ba")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_csv", to_csv)
    monkeypatch.setattr(pd.DataFrame, "to_parquet", to_csv)


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with whole_file(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert content(tmp_path) == {"a.txt": b"new"}


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_what_is_cut_off_leaves_the_old_file(error, tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), whole_file(path) as partial:
        partial.write_text("ne")
        raise error
    assert content(tmp_path) == {"a.txt": b"old"}


def test_a_full_disk_names_the_file_and_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    words = "a.txt: not written: No space left on device; what was there before is untouched"
    with pytest.raises(NotWritten, match=words), whole_file(path) as partial:
        partial.write_text("ne")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert content(tmp_path) == {"a.txt": b"old"}
    with pytest.raises(NotWritten, match="No such file or directory"):
        write_text(tmp_path / "gone" / "a.txt", "new")


def test_run_on_a_full_disk_keeps_the_old_file_and_shows_the_result(
    tmp_path, full_disk, in_this_process
):
    out = tmp_path / "run.csv"
    out.write_text("old")
    ended = invoke("run", "pendulum", "--t-end", "0.1", "--out", out, exit_code=1)
    assert "run.csv: not written: No space left on device" in ended.output
    assert "end state" in ended.output and content(tmp_path) == {"run.csv": b"old"}


def test_compare_on_a_full_disk_shows_the_table(tmp_path, full_disk, in_this_process):
    out = tmp_path / "drift.csv"
    ended = invoke(
        "compare drift pendulum --t-end 0.1 --engines reference --quick --out", out, exit_code=1
    )
    assert "drift.csv: not written" in ended.output
    assert "drift" in ended.output.partition("drift.csv: not")[0]
    assert content(tmp_path) == {}


def test_a_report_on_a_full_disk_keeps_the_previous_one(
    report_folder, tmp_path, full_disk, monkeypatch
):
    monkeypatch.setattr(
        "stiction.reports.paper.folder.save_all", lambda *_: None
    )  # the tables come later
    run, paper = tmp_path / "run", tmp_path / "paper"
    shutil.copytree(report_folder, run)
    paper.mkdir()
    ended = invoke("paper", run, "--out", paper, exit_code=1)
    assert "paper: not written: No space left on device" in ended.output
    assert content(run) == content(report_folder) and content(paper) == {}
    assert {path.name for path in tmp_path.iterdir()} == {"run", "paper"}


@contextmanager
def files_end_at(size):
    """As a disk that is full behind so many bytes of a file: writing fails there, and again when the file is closed."""
    resource = pytest.importorskip("resource", reason="a limit that POSIX has")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_figures_on_a_full_disk(tmp_path):
    """Wherever it ends: matplotlib's writer of PDF meets it with an AttributeError or one of zlib at some places."""
    with rc():
        figure = Figure()
        figure.subplots().plot(np.random.default_rng(1).random(3000))
    whole = content_of(figure, "pdf")
    drawing = Drawing("a", "", figure)
    for size in range(0, len(whole), len(whole) // 4):
        with (
            files_end_at(size),
            pytest.raises(NotWritten, match="a.pdf: not written: File too large"),
        ):
            save(drawing, tmp_path, kinds=("pdf",))
    assert len(whole) > 10_000 and content(tmp_path) == {}


@pytest.mark.parametrize("out", [".", "..", "paper", "../run"])
def test_a_paper_never_takes_the_place_of_its_run(out, report_folder, tmp_path):
    run = tmp_path / "a" / "run"
    shutil.copytree(report_folder, run)
    ended = invoke("paper", run, "--out", run / out, exit_code=2)
    assert "expected another place" in ended.output
    assert content(run) == content(report_folder) and [
        path.name for path in (tmp_path / "a").iterdir()
    ] == ["run"]


def test_a_paper_never_takes_the_place_of_another_run(report_folder, tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    shutil.copytree(report_folder, one)
    shutil.copytree(report_folder, other)
    ended = invoke("paper", one, "--out", other, exit_code=2)
    assert "another kind of folder, without paper.pdf" in ended.output
    assert content(other) == content(report_folder)
    with pytest.raises(FolderRefused, match="another kind"), run_folder(other, "paper.pdf"):
        pass
    check_folder(other, REPORT)  # a run replaces a run


def test_an_output_that_is_the_input(tmp_path):
    source = Path(__file__).parents[2] / "comparisons" / "data" / STORED
    problems = tmp_path / "problems.parquet"
    shutil.copy(source, problems)
    ended = invoke("replay", "--problems", problems, "--out", problems, exit_code=2)
    assert "also reads or writes" in ended.output
    assert problems.read_bytes() == source.read_bytes()


def test_a_baseline_that_cannot_be_written_is_refused_before_anything_runs(tmp_path):
    ended = invoke(
        "baseline", "update", "--file", tmp_path / "gone" / "b.toml", "--reason", "new", exit_code=2
    )
    assert "--file: found" in ended.output and "folder that exists" in ended.output


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_standard_output_on_a_full_disk():
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "stiction", "scenes"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=600,
            cwd=Path(__file__).parents[2],
            check=False,
        )
    assert (
        ended.returncode == 1
        and ended.stderr.strip() == "stiction: standard output: No space left on device"
    )
