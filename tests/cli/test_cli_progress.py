"""A command whose standard error is a file says regularly how far it is; at a terminal a bar does."""

import io
import sys
import threading
from types import SimpleNamespace

import pytest

from stiction.cli import render
from stiction.cli.render import progress


class Told(io.StringIO):
    """Standard error that is no terminal, and says when so many lines are there."""

    def __init__(self, lines: int):
        super().__init__()
        self.wanted, self.there = lines, threading.Event()

    def write(self, text):
        written = super().write(text)
        if self.getvalue().count("\n") >= self.wanted:
            self.there.set()
        return written


def test_lines_come_while_the_work_goes_on_and_end_with_it(monkeypatch):
    told = Told(3)
    monkeypatch.setattr(sys, "stderr", told)
    monkeypatch.setattr(render, "SILENCE_S", 0.01)
    with progress("sweep of sled") as bar:
        bar.start(4)
        bar.result(SimpleNamespace(traceback=""))
        assert told.there.wait(60.0)
    lines = told.getvalue().splitlines()
    assert all(line.startswith("stiction: sweep of sled: ") for line in lines)
    assert "1 of 4, " in lines[-1] and " left, after " in lines[-1]
    assert not [thread for thread in threading.enumerate() if thread.name == "stiction-progress"]


def test_work_without_a_count_says_how_long_it_takes():
    bar = render.Progress("paper")
    assert bar.line().startswith("paper: after ") and bar.line().endswith(" s")


def test_a_closed_standard_error_and_a_failure_of_the_work_end_nothing_else(monkeypatch):
    told = Told(1)
    monkeypatch.setattr(sys, "stderr", told)
    monkeypatch.setattr(render, "SILENCE_S", 0.01)
    with pytest.raises(KeyError), progress("paper"):
        assert told.there.wait(60.0)
        told.close()
        raise KeyError


def test_a_terminal_has_its_bar_alone(monkeypatch):
    monkeypatch.setattr(
        sys,
        "stderr",
        SimpleNamespace(isatty=lambda: True, write=len, flush=lambda: None, encoding="utf-8"),
    )
    monkeypatch.setattr(render, "SILENCE_S", 0.0)
    with progress("paper"):
        assert not [
            thread for thread in threading.enumerate() if thread.name == "stiction-progress"
        ]
