"""The study of settings: what the front is, that each choice is another than the default, and the command from end to end."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import here
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.depth import Depth
from stiction.comparisons.results import Results
from stiction.comparisons.studies import engine_settings
from stiction.comparisons.studies.engine_settings import (DEFAULT, DRIFT, ERROR, ERROR_RATIO, EVERYWHERE, FACTOR, FAILED, JUDGED, ON_FRONT, ROUNDING, SETTING, SUBJECT, TIME_RATIO,
                                                          TIME_RATIO_ENDS, against_defaults, better_everywhere,
                                                          distance_of_defaults, drift_and_rounding, front, load_study, plan, present, ranks_of_defaults, settings_comparison,
                                                          settings_study)
from stiction.comparisons.studies.study import Scope
from stiction.comparisons.studies.work_precision import HIGH, LOW, work_precision
from stiction.comparisons.variants import OWN_CPU, Variant
from stiction.engines import EngineMissing, load_engine
from stiction.scenes import InputError, load_scene


@pytest.mark.parametrize(("error", "time", "expected"), [
    ([1.0, 0.5, 2.0], [1.0, 2.0, 2.0], [True, True, False]),  # the third is slower and worse than both
    ([1.0, 1.0], [1.0, 2.0], [True, False]), ([1.0, 0.999], [1.0, 2.0], [True, False]),  # a thousandth of an error is none
    ([0.0, 0.0, 1.0], [1.0, 2.0, 0.5], [True, False, True]),  # errors of 0, of what does not move
    ([1.0, 0.9], [1.0, 1.0], [False, True]), ([1.0], [1.0], [True])])
def test_front_of_sharp_times(error, time, expected):
    time = np.array(time)
    assert list(front(np.array([error]), time, time)) == expected


def test_times_whose_repeats_overlap_are_not_told_apart():
    assert list(front(np.array([[1.0, 1.0]]), np.array([1.0, 1.1]), np.array([1.2, 1.3]))) == [True, True]


def test_a_choice_of_better_position_and_worse_torque_is_no_better():
    """Two errors are two axes of the front; where one is below what the truth is unsure by, nothing is told by it."""
    time = np.array([1.0, 1.0])
    assert list(front(np.array([[1.0, 0.5], [1.0, 9.0]]), time, time)) == [True, True]
    assert list(front(np.array([[1.0, 0.5], [1.0, 1.0]]), time, time)) == [False, True]
    torque = "torque error, L1 mean [N m]"
    rows = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 5e-4, 2.0)])
    assert better_everywhere(rows.assign(**{torque: [1.0, 9.0]})) == [] and better_everywhere(rows.assign(**{torque: np.nan})) == ["a=1"]
    assert better_everywhere(rows.assign(**{torque: [1.0, 9.0], JUDGED[torque]: 10.0})) == ["a=1"]
    assert better_everywhere(rows.assign(**{JUDGED[ERROR]: 1e-2})) == []
    elsewhere = pd.concat([rows.assign(**{torque: [1.0, 1.0]}), rows.assign(scene="no drive", **{torque: np.nan})], ignore_index=True)
    assert better_everywhere(elsewhere) == ["a=1"]


def test_a_choice_that_drifts_is_no_better():
    """However small the drift is beside the error of the position; but not where rounding alone makes as much of it."""
    rows = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 1e-3, 1.0)])
    assert better_everywhere(rows.assign(**{DRIFT: [1e-14, 6e-8], ROUNDING: 3e-12})) == []
    for drifts in ([1e-14, 2e-12], [6e-8, 6e-8], [np.nan, np.nan]):
        assert better_everywhere(rows.assign(**{DRIFT: drifts, ROUNDING: 3e-12})) == ["a=1"]
    assert list(against_defaults(rows.assign(**{DRIFT: [1e-14, 6e-9], ROUNDING: 3e-12}))[ERROR_RATIO]) == [1.0, pytest.approx(2000.0)]


@pytest.mark.parametrize(("iterations", "drifts"), [(10, True), (100, False)])
def test_the_study_sees_a_solver_that_lets_a_drive_go(iterations, drifts):
    """PyBullet's driven angle, past the first reversal of the slider: by 50 iterations it is held to rounding, by 10 it is not."""
    pytest.importorskip("pybullet")
    variants = [Variant("default", "pybullet", "dt", (4e-3,)), Variant("changed", "pybullet", "dt", (4e-3,), settings={"iterations": iterations})]
    default, changed = (drift_and_rounding(record.trajectory) for record in
                        work_precision(load_scene("slider-bar-case-1"), variants, t_end=load_study().scenes["slider-bar-case-1"], repeats=1).make().records)
    assert default[DRIFT] < default[ROUNDING] < 1e-10 and (changed[DRIFT] > 100 * changed[ROUNDING]) == drifts


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


def test_ranks_of_defaults_name_where_another_choice_gains_most():
    slow = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 1e-3, 1.0), ("a=2", "ok", 1e-3, 2.0)])
    slower = table([(DEFAULT, "ok", 1e-3, 6.0), ("a=1", "ok", 1e-3, 7.0), ("a=2", "ok", 1e-3, 2.0)]).assign(scene="other")
    best = table([(DEFAULT, "ok", 1e-3, 1.0), ("a=1", "ok", 1e-3, 2.0)]).assign(**{SUBJECT: "f, joint"})
    one, other = ranks_of_defaults(pd.concat([slow, slower, best], ignore_index=True)).to_dict("records")
    assert one == {SUBJECT: "e, joint", ON_FRONT: "2 of 2", EVERYWHERE: "a=2", FACTOR: 3.0, "scene": "other", "step": 1e-3, "choice": "a=2"}
    assert other[SUBJECT] == "f, joint" and other[ON_FRONT] == "1 of 1" and other[EVERYWHERE] == "none" and pd.isna(other["scene"])


@pytest.mark.parametrize(("there", "better"), [
    ([("ok", 1e-3, 1.0), ("ok", 1e-3, 2.0)], True), ([("ok", 1e-4, 2.0), ("ok", 1e-3, 2.0)], True), ([("ok", 1e-3, 2.0), ("ok", 1e-3, 2.0)], False),
    ([("ok", 1e-3, 1.0), ("ok", 2e-3, 1.0)], False), ([("ok", 1e-4, 1.0), ("ok", 1e-4, 3.0)], False),  # less accurate, slower on one scene
    ([("ok", 1e-4, 1.0), ("failed", np.nan, np.nan)], False)])
def test_better_everywhere_is_worse_nowhere(there, better):
    rows = pd.concat([table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", *found)]).assign(scene=f"s{place}") for place, found in enumerate(there)], ignore_index=True)
    assert better_everywhere(rows) == (["a=1"] if better else [])


def test_a_choice_over_all_scenes_has_its_mean_time_and_its_largest_error():
    """Two scenes, in units of the default: times 1/2 and 2, of which the geometric mean is 1, errors 3 times and a third; a run that only the default has is told."""
    torque = "torque error, L1 mean [N m]"
    here = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 3e-3, 1.0), ("a=2", "ok", 1e-4, 1.0)]).assign(**{torque: [1.0, 1.0, 5.0]})
    there = table([(DEFAULT, "ok", 3e-3, 2.0), ("a=1", "ok", 1e-3, 4.0), ("a=2", "failed", np.nan, 1.0)]).assign(scene="there", **{torque: np.nan})
    default, one, two = against_defaults(pd.concat([here, there], ignore_index=True)).to_dict("records")
    assert default[TIME_RATIO] == default[ERROR_RATIO] == 1.0 and default[FAILED] == 0
    assert one[TIME_RATIO] == pytest.approx(1.0) and [one[end] for end in TIME_RATIO_ENDS] == [0.5, 2.0] and one[ERROR_RATIO] == pytest.approx(3.0)
    assert two[FAILED] == 1 and two[ERROR_RATIO] == 5.0 and two[TIME_RATIO] == 0.5
    at_rest = table([(DEFAULT, "ok", 0.0, 1.0), ("a=1", "ok", 5.0, 1.0), ("a=2", "ok", 0.0, 1.0)])
    assert list(against_defaults(at_rest)[ERROR_RATIO]) == [1.0, np.inf, 1.0]


@pytest.mark.parametrize("rows", [
    pd.concat([table([(DEFAULT, "failed", np.nan, 1.0), ("a=1", "ok", 1e-3, 2.0)]).assign(scene=name) for name in "st"], ignore_index=True)],
    ids=["no default that succeeded"])
def test_there_is_no_figure_of_what_cannot_be_drawn(rows):
    assert present(Results((), {}, {"settings": rows})).figures == ()


def short_study(**others):
    """The study with one step and one setting of each method."""
    whole = load_study()
    return replace(whole, steps=whole.steps[:1], subjects=tuple(replace(one, choices=dict(list(one.choices.items())[:1])) for one in whole.subjects), **others)


@pytest.fixture(scope="module")
def studied():
    """Of one engine on two scenes, a few steps each."""
    study = short_study(scenes={"slider-bar-case-1": 0.02, "hard/heavy-slider": 0.02})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine_settings, "load_study", lambda: study)
        with here():
            yield settings_study(["pymunk"], repeats=1).make()


def test_scenes_of_the_study_are_there():
    assert all(load_scene(name).t_end >= seconds > 0 for name, seconds in load_study().scenes.items())


def test_study_has_every_choice_on_every_scene_and_the_rows_of_a_method_together(studied):
    assert list(studied["scene"].unique()) == ["slider-bar-case-1", "heavy-slider"] and (studied["status"] == "ok").all()
    assert studied[SUBJECT].ne(studied[SUBJECT].shift()).sum() == studied[SUBJECT].nunique() == 2
    assert len(studied) == 2 * len(short_study().variants(["pymunk"]))
    for setting, had in zip(studied[SETTING], map(json.loads, studied["settings"])):
        name, _, value = setting.partition("=")
        assert setting == DEFAULT or str(had[name]) == value


def test_what_is_said_of_the_defaults(studied):
    """Counted and compared here by other code; a row of the table for each method, traced to all rows of it."""
    said = present(Results((), {}, {"settings": studied}))
    defaults = studied[studied["variant"].str.endswith(f": {DEFAULT}")]
    assert said.answer.text == f"The defaults are on the front of error and time in {int(defaults[ON_FRONT].sum())} of {len(defaults)} comparisons."
    ranks, choices = said.tables
    assert [row[:2] for row in ranks.cells()] == [[subject, f"{int(rows[ON_FRONT].sum())} of {len(rows)}"] for subject, rows in defaults.groupby(SUBJECT, sort=False)]
    assert ranks.rows == tuple(tuple(number + 1 for number in rows.index) for _, rows in studied.groupby(SUBJECT, sort=False))
    assert len(choices.frame) == studied["variant"].nunique() and len(said.figures[0].panels) == studied[SUBJECT].nunique()


def test_a_better_choice_is_named():
    rows = table([(DEFAULT, "ok", 1e-3, 2.0), ("a=1", "ok", 1e-3, 1.0), ("a=2", "ok", 1e-3, 2.0)]).assign(**{ON_FRONT: [False, True, False]})
    for scenes, where in ((rows, "in s"), (pd.concat([rows, rows.assign(scene="t")], ignore_index=True), "on every scene")):
        said = present(Results((), {}, {"settings": scenes}))
        assert said.findings[0].text == f"Better than the default {where}: e, joint with a=1."
        assert said.answer.text.endswith(f"in 0 of {scenes['scene'].nunique()} comparisons.")
        no_better = present(Results((), {}, {"settings": scenes.assign(**{OWN_CPU: 1.0, LOW: 1.0, HIGH: 1.0})}))
        assert no_better.findings[0].text == f"No other choice is better than its default {where}."


def test_a_study_of_which_nothing_came_out_is_told(studied):
    lost = studied.assign(status="crashed", reason="SIGSEGV").drop(columns=ERROR)
    assert distance_of_defaults(lost).empty and ranks_of_defaults(lost).empty
    said = present(Results((), {}, {"settings": lost}))
    assert said.answer.text == "No run with the default settings of an engine succeeded." and not said.tables
    assert present(Results((), {}, {})).is_empty


@pytest.mark.parametrize(("depth", "engines", "planned"), [(Depth.FULL, None, True), (Depth.FULL, ("moreau",), False), (Depth.DEFAULT, None, False)])
def test_settings_are_tried_at_full_depth_and_on_a_scene_of_ones_own(depth, engines, planned):
    cases = tuple(load_scene(f"slider-bar-case-{number}") for number in (1, 2, 3))
    assert (plan(Scope(cases, depth, engines)) is not None) == planned
    assert {task.args[1].name for task in plan(Scope(cases[1:2], depth, ("pymunk",))).tasks} == {"slider-bar-case-2"}


def test_a_gain_at_another_step_says_so():
    both = [table([(DEFAULT, "ok", error, seconds), ("a=1", "ok", error, seconds)]).assign(step=step) for step, error, seconds in ((4e-3, 1e-3, 1.0), (1e-3, 1e-3, 4.0))]
    [row] = ranks_of_defaults(pd.concat([both[0].drop(index=0), both[1]], ignore_index=True)).to_dict("records")
    assert row[FACTOR] == 4.0 and row["choice"] == "a=1 at 0.004 s" and row["step"] == 1e-3


def test_an_engine_without_settings_of_the_study_is_told():
    with pytest.raises(InputError, match="found 'moreau'; expected some of pymunk"):
        settings_comparison(load_scene("slider-bar-case-1"), ["moreau"])


def test_command(tmp_path, in_this_process, monkeypatch):
    few = short_study()
    monkeypatch.setattr(engine_settings, "load_study", lambda: few)
    picture, file = tmp_path / "settings.png", tmp_path / "settings.csv"
    ended = CliRunner().invoke(app, ["compare", "settings", "slider-bar-case-1", "--engines", "pymunk", "--t-end", "0.4", "--repeats", "2", "--plot", str(picture),
                                     "--out", str(file)])
    assert ended.exit_code == 0, ended.output
    rows = pd.read_csv(file)
    assert set(rows["fidelity"]) == {"joint", "contact"} and (rows["status"] == "ok").all() and "iterations=20" in set(rows[SETTING])
    assert picture.read_bytes().startswith(b"\x89PNG") and "The defaults are on the front" in ended.output
    ended = CliRunner().invoke(app, ["compare", "settings", "slider-bar-case-1", "--engines", "reference"])
    assert ended.exit_code == BAD_INPUT and "which the study has settings of" in ended.output
