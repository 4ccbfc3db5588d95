"""The study of settings: the front, choices that are other than the default, and the command from end to end."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import here, installed, invoke

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.variants import OWN_CPU, Variant
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.hard.examination import DEGRADED, RIGHT, WRONG, examine, judge
from stiction.comparisons.measures.work_precision import HIGH, LOW, work_precision
from stiction.comparisons.studies import settings as engine_settings
from stiction.comparisons.studies.hold_data import load_data
from stiction.comparisons.studies.settings import (
    DEFAULT,
    DRIFT,
    ERROR,
    ERROR_RATIO,
    EVERYWHERE,
    FACTOR,
    FAILED,
    JUDGED,
    ON_FRONT,
    ROUNDING,
    SETTING,
    STUDY,
    SUBJECT,
    TIME_RATIO,
    TIME_RATIO_ENDS,
    against_defaults,
    better_everywhere,
    drift_and_rounding,
    front,
    load_study,
    plan,
    present,
    ranks_of_defaults,
)
from stiction.engines import Outcome, load_engine
from stiction.reports.text import section_of
from stiction.scenes import InputError, load_scene

CASES = tuple(load_scene(f"slider-bar-case-{number}") for number in (1, 2, 3))


TORQUE = "torque_error"
FAILS = np.nan, 1.0


def table(*runs, **columns):
    """Runs of the default and of the choices a=1, a=2, .. at one step: error, nan where it failed, and time."""
    settings = [DEFAULT, *(f"a={number}" for number in range(1, len(runs)))]
    rows = pd.DataFrame(
        [
            {
                "scene": "s",
                SUBJECT: "e, joint",
                "variant": f"e, joint: {setting}",
                SETTING: setting,
                "step": 1e-3,
                "status": "failed" if np.isnan(error) else "ok",
                "reason": "",
                ERROR: error,
                OWN_CPU: time,
                LOW: time,
                HIGH: time,
                ON_FRONT: True,
            }
            for setting, (error, time) in zip(settings, runs)
        ]
    )
    return rows.assign(**columns)


def joined(*tables):
    return pd.concat(tables, ignore_index=True)


def results_of(rows):
    return Results((), {}, {"settings": rows})


@pytest.mark.parametrize(
    ("error", "time", "expected"),
    [
        (
            [1.0, 0.5, 2.0],
            [1.0, 2.0, 2.0],
            [True, True, False],
        ),  # the third is slower and worse than both
        ([1.0, 1.0], [1.0, 2.0], [True, False]),
        ([1.0, 0.999], [1.0, 2.0], [True, False]),  # a thousandth of an error is none
        (
            [0.0, 0.0, 1.0],
            [1.0, 2.0, 0.5],
            [True, False, True],
        ),  # errors of 0, of what does not move
        ([1.0, 0.9], [1.0, 1.0], [False, True]),
        ([1.0], [1.0], [True]),
    ],
)
def test_front_of_sharp_times(error, time, expected):
    time = np.array(time)
    assert list(front(np.array([error]), time, time)) == expected


@pytest.mark.parametrize(
    ("torque", "expected"), [([1.0, 9.0], [True, True]), ([1.0, 1.0], [False, True])]
)
def test_two_errors_are_two_axes_of_the_front(torque, expected):
    time = np.array([1.0, 1.0])
    assert list(front(np.array([[1.0, 0.5], torque]), time, time)) == expected


MORE_ACCURATE, FASTER = (5e-4, 2.0), (1e-3, 1.0)


@pytest.mark.parametrize(
    ("choice", "columns", "is_better"),
    [
        (MORE_ACCURATE, {TORQUE: [1.0, 9.0]}, False),
        (MORE_ACCURATE, {TORQUE: np.nan}, True),
        (MORE_ACCURATE, {TORQUE: [1.0, 9.0], JUDGED[TORQUE]: 10.0}, True),
        (
            MORE_ACCURATE,
            {JUDGED[ERROR]: 1e-2},
            False,
        ),  # an error below the truth's uncertainty decides nothing
        # however small the drift is against the position error, but not where rounding alone makes as much of it
        (FASTER, {DRIFT: [1e-14, 6e-8]}, False),
        (FASTER, {DRIFT: [1e-14, 2e-12]}, True),
        (FASTER, {DRIFT: [6e-8, 6e-8]}, True),
        (FASTER, {DRIFT: [np.nan, np.nan]}, True),
    ],
)
def test_a_choice_that_is_better_in_one_and_worse_in_another_is_no_better(
    choice, columns, is_better
):
    rows = table((1e-3, 2.0), choice, **{ROUNDING: 3e-12, **columns})
    assert better_everywhere(rows) == (["a=1"] if is_better else [])


def test_a_scene_without_a_drive_has_no_torque_to_be_worse_in():
    rows = table((1e-3, 2.0), MORE_ACCURATE)
    scenes = joined(rows.assign(**{TORQUE: 1.0}), rows.assign(scene="no drive", **{TORQUE: np.nan}))
    assert better_everywhere(scenes) == ["a=1"]


def test_the_ratio_of_drifts_is_to_rounding_at_least():
    rows = table((1e-3, 2.0), (1e-3, 1.0), **{DRIFT: [1e-14, 6e-9], ROUNDING: 3e-12})
    assert list(against_defaults(rows)[ERROR_RATIO]) == [1.0, pytest.approx(2000.0)]


@pytest.mark.parametrize(("iterations", "drifts"), [(10, True), (100, False)])
def test_the_study_sees_a_solver_that_lets_a_drive_go(iterations, drifts, in_this_process):
    """PyBullet's driven angle, past the first reversal: by 50 iterations it is held to rounding, by 10 it is not."""
    pytest.importorskip("pybullet")
    default = Variant("default", "pybullet", "dt", (4e-3,))
    variants = [default, replace(default, label="changed", settings={"iterations": iterations})]
    found = work_precision(
        CASES[0], variants, t_end=load_study().scenes[CASES[0].name], repeats=1
    ).make()
    default, changed = (drift_and_rounding(record.trajectory) for record in found.records)
    assert (
        default[DRIFT] < default[ROUNDING] < 1e-10
        and (changed[DRIFT] > 100 * changed[ROUNDING]) == drifts
    )


@pytest.mark.parametrize(
    "subject", [*load_study().subjects, *load_data().subjects], ids=lambda subject: subject.label
)
def test_each_choice_is_a_setting_of_the_engine_and_not_its_default(subject):
    solver = installed(subject.engine)
    default = solver.simulate(
        load_scene("slider-bar-case-1-mus-equals-mu"),
        t_end=0.01,
        dt=5e-3,
        fidelity=subject.fidelity,
        **subject.fixed,
    ).settings
    assert all(default[name] == value for name, value in subject.fixed.items())
    for name, values in subject.choices.items():
        assert name in default and default[name] not in values


@pytest.mark.parametrize(
    "runs", [[(1e-3, 2.0), (1e-3, 1.0), (2e-3, 0.1), FAILS], [(0.0, 2.0), (0.0, 1.0)]]
)
def test_a_gain_is_over_the_fastest_choice_that_is_no_worse(runs):
    [row] = ranks_of_defaults(table(*runs)).to_dict("records")
    assert (row[FACTOR], row["choice"]) == (2.0, "a=1")


def test_there_is_no_gain_where_intervals_overlap():
    near = table(
        (1e-3, 2.0), (1e-3, 1.9), (1e-3, 3.0), **{LOW: [1.8, 1.7, 2.8], HIGH: [2.2, 2.1, 3.2]}
    )
    assert ranks_of_defaults(near)["choice"].isna().all() and ranks_of_defaults(table(FAILS)).empty


def test_ranks_of_defaults_name_where_another_choice_gains_most():
    slow = table((1e-3, 2.0), (1e-3, 1.0), (1e-3, 2.0))
    slower = table((1e-3, 6.0), (1e-3, 7.0), (1e-3, 2.0), scene="other")
    best = table((1e-3, 1.0), (1e-3, 2.0), **{SUBJECT: "f, joint"})
    one, other = ranks_of_defaults(joined(slow, slower, best)).to_dict("records")
    assert one == {
        SUBJECT: "e, joint",
        ON_FRONT: "2 of 2",
        EVERYWHERE: "a=2",
        FACTOR: 3.0,
        "scene": "other",
        "step": 1e-3,
        "choice": "a=2",
    }
    assert (other[SUBJECT], other[ON_FRONT], other[EVERYWHERE]) == ("f, joint", "1 of 1", "none")
    assert pd.isna(other["scene"])


@pytest.mark.parametrize(
    ("there", "is_better"),
    [
        ([(1e-3, 1.0), (1e-3, 2.0)], True),
        ([(1e-4, 2.0), (1e-3, 2.0)], True),
        ([(1e-3, 2.0), (1e-3, 2.0)], False),
        ([(1e-3, 1.0), (2e-3, 1.0)], False),
        ([(1e-4, 1.0), (1e-4, 3.0)], False),  # less accurate, slower on one scene
        ([(1e-4, 1.0), FAILS], False),
    ],
)
def test_better_everywhere_is_worse_nowhere(there, is_better):
    rows = joined(
        *(table((1e-3, 2.0), found, scene=f"s{place}") for place, found in enumerate(there))
    )
    assert better_everywhere(rows) == (["a=1"] if is_better else [])


def test_a_choice_over_all_scenes_has_its_mean_time_and_its_largest_error():
    """Times 1/2 and 2 of the default's, of geometric mean 1; errors 3 times and a third; a failure is counted."""
    here = table((1e-3, 2.0), (3e-3, 1.0), (1e-4, 1.0), **{TORQUE: [1.0, 1.0, 5.0]})
    there = table((3e-3, 2.0), (1e-3, 4.0), FAILS, scene="there", **{TORQUE: np.nan})
    default, one, two = against_defaults(joined(here, there)).to_dict("records")
    assert default[TIME_RATIO] == default[ERROR_RATIO] == 1.0 and default[FAILED] == 0
    assert [one[name] for name in (TIME_RATIO, *TIME_RATIO_ENDS)] == pytest.approx([1.0, 0.5, 2.0])
    assert one[ERROR_RATIO] == pytest.approx(3.0)
    assert (two[FAILED], two[ERROR_RATIO], two[TIME_RATIO]) == (1, 5.0, 0.5)
    at_rest = table((0.0, 1.0), (5.0, 1.0), (0.0, 1.0))
    assert list(against_defaults(at_rest)[ERROR_RATIO]) == [1.0, np.inf, 1.0]


def short_study(**others):
    """The study with one step and one setting of each method."""
    whole = load_study()
    subjects = (replace(one, choices=dict(list(one.choices.items())[:1])) for one in whole.subjects)
    return replace(whole, steps=whole.steps[:1], subjects=tuple(subjects), **others)


@pytest.fixture(scope="module")
def studied():
    """Of one engine on two scenes, a few steps each."""
    study = short_study(scenes={"slider-bar-case-1": 0.02, "hard/heavy-slider": 0.02})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine_settings, "load_study", lambda: study)
        with here():
            yield plan(Scope(CASES, Depth.FULL, ("pymunk",), repeats=1)).make().tables["settings"]


def test_study_has_every_choice_on_every_scene_and_the_rows_of_a_method_together(studied):
    assert list(studied["scene"].unique()) == ["slider-bar-case-1", "heavy-slider"]
    assert (studied["status"] == "ok").all()
    assert studied[SUBJECT].ne(studied[SUBJECT].shift()).sum() == studied[SUBJECT].nunique() == 2
    study = short_study()
    assert len(studied) == 2 * sum(
        len(one.variants(study.steps)) for one in study.subjects if one.engine == "pymunk"
    )
    for setting, had in zip(studied[SETTING], map(json.loads, studied["settings"])):
        name, _, value = setting.partition("=")
        assert setting == DEFAULT or str(had[name]) == value


def test_what_is_said_of_the_defaults(studied):
    """Counted and compared here by other code; a row of the table for each method, traced to all rows of it."""
    said, section = present(results_of(studied)), section_of(STUDY, results_of(studied))
    defaults = studied[studied["variant"].str.endswith(f": {DEFAULT}")]
    on_front = int(defaults[ON_FRONT].sum())
    assert (said.rows["on_front"], said.rows["compared"]) == (on_front, len(defaults))
    assert f"{on_front} of {len(defaults)}" in section.answer and said.rows["scene"] is None
    assert len(f"{STUDY.title}: {section.answer}") <= ANSWER_LENGTH
    assert all(each.caption for each in (*section.tables, *section.figures))
    ranks, choices = said.tables
    counts = {
        subject: f"{int(rows[ON_FRONT].sum())} of {len(rows)}"
        for subject, rows in defaults.groupby(SUBJECT)
    }
    assert {row[0]: row[1] for row in ranks.cells()} == counts
    assert ranks.rows == tuple(
        tuple(rows.index + 1) for _, rows in studied.groupby(SUBJECT, sort=False)
    )
    assert len(choices.frame) == studied["variant"].nunique()
    assert len(said.figures[0].panels) == studied[SUBJECT].nunique()


@pytest.mark.parametrize(("scenes", "scene"), [("s", "s"), ("st", None)])
def test_a_better_choice_is_named(scenes, scene):
    one = table((1e-3, 2.0), (1e-3, 1.0), (1e-3, 2.0), **{ON_FRONT: [False, True, False]})
    results = results_of(joined(*(one.assign(scene=name) for name in scenes)))
    rows = present(results).rows
    assert rows["better"] == [{"subject": "e, joint", "settings": ["a=1"]}]
    assert (rows["on_front"], rows["compared"], rows["scene"]) == (0, len(scenes), scene)
    [finding] = section_of(STUDY, results).findings
    assert "e, joint with a=1" in finding
    slow = results.tables["settings"].assign(**{OWN_CPU: 1.0, LOW: 1.0, HIGH: 1.0})
    assert present(results_of(slow)).rows["better"] == []
    [finding] = section_of(STUDY, results_of(slow)).findings
    assert "e, joint" not in finding


def test_a_study_in_which_all_runs_failed_says_so(studied):
    crashed = studied.assign(status="crashed", reason="SIGSEGV").drop(columns=ERROR)
    assert ranks_of_defaults(crashed).empty
    assert present(results_of(crashed)).rows["compared"] == 0
    said = section_of(STUDY, results_of(crashed))
    assert said.answer and not said.findings and not said.tables and not said.notes


@pytest.mark.parametrize(
    ("depth", "engines", "planned"),
    [(Depth.FULL, None, True), (Depth.FULL, ("moreau",), False), (Depth.DEFAULT, None, False)],
)
def test_settings_are_tried_at_full_depth_and_on_a_scene_of_ones_own(depth, engines, planned):
    assert (plan(Scope(CASES, depth, engines)) is not None) == planned
    assert {task.args[1].name for task in plan(Scope(CASES[1:2], depth, ("pymunk",))).tasks} == {
        "slider-bar-case-2"
    }


def test_a_gain_at_another_step_says_so():
    """At 4 ms the default failed; the choice has the same error there as at 1 ms, in a quarter of the time."""
    rows = joined(table(FAILS, (1e-3, 1.0), step=4e-3), table((1e-3, 4.0), (1e-3, 4.0)))
    [row] = ranks_of_defaults(rows).to_dict("records")
    assert (row[FACTOR], row["choice"], row["step"]) == (4.0, "a=1 at 0.004 s", 1e-3)


def test_an_engine_without_settings_of_the_study_is_refused():
    with pytest.raises(InputError, match="found 'moreau'; expected some of pymunk"):
        plan(Scope(CASES[:1], engines=("moreau",)))


def test_command(tmp_path, in_this_process, monkeypatch):
    few = short_study()
    monkeypatch.setattr(engine_settings, "load_study", lambda: few)
    file = tmp_path / "settings.csv"
    command = ["compare", "settings", "slider-bar-case-1", "--engines"]
    ended = invoke(*command, "pymunk", "--t-end", "0.1", "--repeats", "1", "--out", file)
    rows = pd.read_csv(file)
    assert set(rows["fidelity"]) == {"joint", "contact"} and (rows["status"] == "ok").all()
    assert "iterations=20" in set(rows[SETTING])
    assert "The default settings are Pareto-optimal" in ended.output
    ended = invoke(*command, "reference", exit_code=BAD_INPUT)
    assert "which the study has settings of" in ended.output


MILLISECONDS, UNSTABLE = (
    "load above static friction for 2 ms",
    "Baumgarte's terms unstable at the step",
)
BELOW, WIDE = "static friction below kinetic", "slider that can jam: width > length/mus"


@pytest.mark.parametrize(
    ("engine", "setting", "value", "name", "default", "overturned"),
    [
        ("mujoco", "impedance", 0.8, UNSTABLE, DEGRADED, RIGHT),
        pytest.param("mujoco", "impedance", 0.8, BELOW, DEGRADED, WRONG, marks=pytest.mark.long),
        pytest.param(
            "drake", "near_rigid", 1.0, MILLISECONDS, WRONG, DEGRADED, marks=pytest.mark.long
        ),
        pytest.param("drake", "near_rigid", 1.0, WIDE, DEGRADED, WRONG, marks=pytest.mark.long),
        pytest.param("drake", "dissipation", 100.0, BELOW, DEGRADED, WRONG, marks=pytest.mark.long),
    ],
)
def test_a_setting_overturns_the_verdict_of_the_default(
    engine, setting, value, name, default, overturned
):
    pytest.importorskip({"drake": "pydrake"}.get(engine, engine))
    assert load_engine(engine).default_settings("contact")[setting] != value
    case = next(case for case in hard_cases() if case.name == name)
    for settings, word in (({}, default), ({setting: value}, overturned)):
        variant = Variant("tried", engine, "dt", (case.dt,), "contact", settings)
        assert judge(case, variant, Outcome("tried", "ok", examine(name, variant))).word == word
    subjects = {(subject.engine, subject.fidelity): subject for subject in load_study().subjects}
    assert value in subjects[engine, "contact"].choices[setting]
