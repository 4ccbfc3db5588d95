"""The study of settings: what the front is, that each choice is another than the default, and the command from end to end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.studies import engine_settings
from stiction.comparisons.studies.engine_settings import DEFAULT, ERROR, ON_FRONT, SETTING, SUBJECT, distance_of_defaults, front, load_study, settings_comparison
from stiction.comparisons.studies.work_precision import HIGH, LOW
from stiction.comparisons.variants import OWN_CPU
from stiction.engines import EngineMissing, load_engine
from stiction.scenes import InputError, load_scene


@pytest.mark.parametrize(("error", "time", "expected"), [
    ([1.0, 0.5, 2.0], [1.0, 2.0, 2.0], [True, True, False]),  # the third is slower and worse than both
    ([1.0, 1.0], [1.0, 2.0], [True, False]), ([1.0, 0.999], [1.0, 2.0], [True, False]),  # a thousandth of an error is none
    ([0.0, 0.0, 1.0], [1.0, 2.0, 0.5], [True, False, True]),  # errors of 0, of what does not move
    ([1.0, 0.9], [1.0, 1.0], [False, True]), ([1.0], [1.0], [True])])
def test_front_of_sharp_times(error, time, expected):
    time = np.array(time)
    assert list(front(np.array(error), time, time)) == expected


def test_times_whose_repeats_overlap_are_not_told_apart():
    assert list(front(np.array([1.0, 1.0]), np.array([1.0, 1.1]), np.array([1.2, 1.3]))) == [True, True]


@pytest.mark.parametrize("subject", load_study().subjects, ids=lambda subject: subject.label)
def test_each_choice_is_a_setting_of_the_engine_and_not_its_default(subject):
    try:
        solver = load_engine(subject.engine)
    except EngineMissing as missing:
        pytest.skip(str(missing))
    default = solver.simulate(load_scene("slider-bar-case-1-mus-equals-mu"), t_end=0.01, dt=5e-3, fidelity=subject.fidelity, **subject.fixed).settings
    assert all(default[name] == value for name, value in subject.fixed.items())
    for name, values in subject.choices.items():
        assert name in default and default[name] not in values


def test_every_fidelity_of_an_engine_is_studied():
    subjects = load_study().subjects
    for engine in {subject.engine for subject in subjects}:
        try:
            fidelities = load_engine(engine).capabilities.fidelities
        except EngineMissing:
            continue
        assert {subject.fidelity for subject in subjects if subject.engine == engine} == set(fidelities)


def table(rows):
    return pd.DataFrame([{"scene": "s", SUBJECT: "e, joint", "variant": f"e, joint: {setting}", SETTING: setting, "step": 1e-3, "status": status,
                          "reason": "", ERROR: error, OWN_CPU: time, LOW: time, HIGH: time, ON_FRONT: True} for setting, status, error, time in rows])


def test_distance_is_to_the_fastest_choice_that_is_no_worse():
    [row] = distance_of_defaults(table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 1e-3, 1.0), ("a=2", "ok", 2e-3, 0.1), ("a=3", "failed", 1e-9, 0.1)])).to_dict("records")
    assert row["fastest with no larger error"] == "a=1" and row["time, of the fastest [-]"] == 2.0
    near = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 1e-3, 1.9), ("a=2", "ok", 1e-3, 3.0)]).assign(**{LOW: [1.8, 1.7, 2.8], HIGH: [2.2, 2.1, 3.2]})
    assert distance_of_defaults(near)["fastest with no larger error"].item() == f"{DEFAULT}, a=1"  # their intervals overlap
    [row] = distance_of_defaults(table([(DEFAULT, "ok", 0.0, 2.0), ("a=1", "ok", 0.0, 1.0)])).to_dict("records")
    assert row["fastest with no larger error"] == "a=1"
    assert distance_of_defaults(table([(DEFAULT, "failed", 1e-3, 2.0)])).empty


def test_an_engine_without_settings_of_the_study_is_told():
    with pytest.raises(InputError, match="found 'moreau'; expected some of pymunk"):
        settings_comparison(load_scene("slider-bar-case-1"), ["moreau"])


def test_command(tmp_path, in_this_process, monkeypatch):
    """With one step and one setting of each method."""
    whole = load_study()
    few = replace(whole, steps=whole.steps[:1], subjects=tuple(replace(subject, choices=dict(list(subject.choices.items())[:1])) for subject in whole.subjects))
    monkeypatch.setattr(engine_settings, "load_study", lambda: few)
    picture, file = tmp_path / "settings.png", tmp_path / "settings.csv"
    ended = CliRunner().invoke(app, ["compare", "settings", "slider-bar-case-1", "--engines", "pymunk", "--t-end", "0.4", "--repeats", "2", "--plot", str(picture),
                                     "--out", str(file)])
    assert ended.exit_code == 0, ended.output
    rows = pd.read_csv(file)
    assert set(rows["fidelity"]) == {"joint", "contact"} and (rows["status"] == "ok").all() and "iterations=20" in set(rows[SETTING])
    assert picture.read_bytes().startswith(b"\x89PNG") and "fastest with no larger error" in ended.output
    ended = CliRunner().invoke(app, ["compare", "settings", "slider-bar-case-1", "--engines", "reference"])
    assert ended.exit_code == BAD_INPUT and "which the study has settings of" in ended.output
