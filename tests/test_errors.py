"""Errors that are meant end in words; a bug, a ValueError of numpy's above all, keeps its traceback."""

import numpy as np
import pytest
from conftest import invoke

from stiction import comparisons, reports
from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.campaign import CampaignError
from stiction.comparisons.bench.store import KeptRefused
from stiction.comparisons.measures.scene_truth import NoOwnRun, ground_truth
from stiction.comparisons.regression.baseline import BaselineError, BaselineRefused
from stiction.comparisons.regression.history import HistoryRefused
from stiction.comparisons.regression.older_code import ControlRefused
from stiction.comparisons.sweep.sweep import SweepRefused
from stiction.engines import (
    BadTrajectory,
    EngineFailure,
    EngineMissing,
    Refused,
    Task,
    UnknownEngine,
    isolate,
)
from stiction.reports import FolderRefused
from stiction.scenes import FileError, InputError, SceneError, StictionError, load_scene
from stiction.scenes.atomic_files import NotWritten
from stiction.truths import NoMotion, NotThisMechanism, TruthRefused, Undecided

BAD_INPUTS = {
    FileError,
    SceneError,
    CampaignError,
    BaselineError,
    UnknownEngine,
    NotThisMechanism,
    SweepRefused,
    ControlRefused,
}
FAILURES = {
    Refused,
    EngineFailure,
    BadTrajectory,
    EngineMissing,
    TruthRefused,
    NoMotion,
    Undecided,
    NoOwnRun,
    NotWritten,
    HistoryRefused,
    KeptRefused,
    BaselineRefused,
    FolderRefused,
}


def wrong_shape(*_, **__):
    return np.zeros(2) + np.zeros(3)


def refused_setting(*_, **__):
    raise InputError("colour: found 'red'; expected none")


def test_family():
    assert all(issubclass(kind, StictionError) for kind in BAD_INPUTS | FAILURES)
    assert {kind for kind in BAD_INPUTS | FAILURES if issubclass(kind, InputError)} == BAD_INPUTS
    assert issubclass(InputError, ValueError) and not issubclass(ValueError, StictionError)


def test_campaign_has_a_row_for_a_bug_and_its_traceback():
    failed, meant = isolate(
        [Task("bug", wrong_shape), Task("meant", refused_setting)], workers=1, timeout_s=60
    )
    assert (failed.status, failed.bug) == ("failed", True)
    assert failed.reason.startswith("ValueError: operands could not be broadcast")
    assert "Traceback" in failed.log and "in wrong_shape" in failed.log
    assert (meant.status, meant.bug, meant.reason) == (
        "failed",
        False,
        "colour: found 'red'; expected none",
    )


def test_bug_of_an_engine_in_a_comparison_is_a_row_and_its_traceback(
    tmp_path, monkeypatch, in_this_process
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.toml").write_text(
        'scenes = ["pendulum"]\nmeasure = ["counter"]\n[variants.buggy]\nengine = "damaged_solvers:Buggy"\ndt = [1e-2]\n'
    )
    (tmp_path / "empty.toml").write_text("format = 2\n")
    for command, code in (
        (
            [
                "compare",
                "drift",
                "pendulum",
                "--engines",
                "damaged_solvers:Buggy",
                "--quick",
                "--t-end",
                "0.1",
            ],
            0,
        ),
        (["nightly", "campaign.toml", "--baseline", "empty.toml", "--out", "nights"], 4),
    ):
        ended = invoke(*command, exit_code=code)
        assert (
            "failed" in ended.stdout
            and "ValueError: operands could not be broadcast" in ended.stdout
        )
        assert (
            "ended with a bug" in ended.stderr
            and "damaged_solvers.py" in ended.stderr
            and "Traceback" not in ended.stdout
        )


def test_bug_in_a_truth_is_no_refusal(monkeypatch):
    monkeypatch.setattr("stiction.comparisons.measures.scene_truth.INDEPENDENT", (wrong_shape,))
    with pytest.raises(ValueError, match="broadcast"):
        ground_truth(
            load_scene("pendulum"), t_end=0.789
        )  # one that no other test asks for: a truth is found once


@pytest.mark.parametrize(
    ("place", "arguments"),
    [
        ("stiction.scenes.load_scene", ["explain", "pendulum"]),
        ("stiction.comparisons.studies.studies", ["compare", "drift", "pendulum"]),
        ("stiction.comparisons.bench.campaign.load_campaign", ["check"]),
        ("stiction.comparisons.bench.complementarity.replay.replay", ["replay"]),
    ],
)
def test_bug_in_a_command(place, arguments, monkeypatch):
    monkeypatch.setattr(place, wrong_shape)
    result = invoke(*arguments, exit_code=None)
    assert type(result.exception) is ValueError and "broadcast" in str(
        result.exception
    )  # a process prints its traceback, exit code 1
    assert result.exit_code == 1


def test_bad_input_in_the_same_place_is_told(monkeypatch):
    monkeypatch.setattr("stiction.scenes.load_scene", refused_setting)
    result = invoke("explain", "pendulum", exit_code=BAD_INPUT)
    assert "colour: found 'red'" in result.stderr and "Traceback" not in result.output


def test_every_error_of_the_suite_is_of_the_family():
    """No module defines an exception of its own that a command would take for a bug; those that never leave their module are private."""
    seen = {
        kind
        for module in _modules()
        for kind in vars(module).values()
        if isinstance(kind, type)
        and issubclass(kind, BaseException)
        and kind.__module__ == module.__name__
        and not kind.__name__.startswith("_")
    }
    assert seen and all(issubclass(kind, StictionError) for kind in seen)


def _modules():
    import importlib
    import pkgutil

    from stiction import engines, scenes

    for package in (scenes, engines, comparisons, reports):
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not found.name.endswith("pytest_plugin"):
                yield importlib.import_module(found.name)
