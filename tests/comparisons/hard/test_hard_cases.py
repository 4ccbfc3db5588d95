"""The catalogue of hard cases: the reference is right or rightly refused, and verdicts follow from what was measured."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import installed, invoke
from random_mechanisms import extreme_scene

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.hard.case import MOTION, MOTION_OR_WORD, NO_MOTION, REFUSAL, HardCase
from stiction.comparisons.hard.checks import accepted_start, follows, friction_excess
from stiction.comparisons.hard.closed_forms import rod_normal_force
from stiction.comparisons.hard.examination import (
    ADAPTER,
    BEYOND,
    DECLINED,
    DECLINED_BY_ADAPTER,
    DEGRADED,
    FAILED,
    IMPULSIVE,
    INEXPRESSIBLE,
    METHOD,
    NOT_INSTALLED,
    NOT_RUN,
    READER,
    RIGHT,
    UNREAD,
    WRONG,
    Examination,
    Verdict,
    _beyond,
    examine,
    judge,
)
from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.comparisons.hard.table import REFERENCE
from stiction.comparisons.studies.hard import HOSTILE, STUDY, present
from stiction.engines import load_engine
from stiction.engines.isolation import Outcome
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import MOST_ROWS, Mechanism, workspace
from stiction.reports.text import section_of
from stiction.scenes import SceneError, Trajectory, catalogue, load_scene, scene_from_dict

EVENT_DRIVEN = REFERENCE[0]
LONG = {"1e5 s of case 1"}
CASES = {case.name: case for case in hard_cases()}


def verdict(case, variant):
    try:
        return judge(case, variant, Outcome("", "ok", examine(case.name, variant)))
    except Exception as error:  # as the isolation of a child would have it
        return judge(case, variant, Outcome("", "failed", None, f"{type(error).__name__}: {error}"))


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=[pytest.mark.long] * (case.name in LONG), id=case.name)
        for case in hard_cases()
    ],
)
def test_reference_is_right_or_says_why_not(case):
    found = verdict(case, EVENT_DRIVEN)
    assert found.word in (RIGHT, DECLINED, UNREAD), found
    assert case.name not in LONG or found.word == RIGHT
    if case.expected in (NO_MOTION, REFUSAL):
        assert found.word == (UNREAD if case.words else RIGHT), (
            found
        )  # what no reader accepts is no method's merit


@pytest.mark.parametrize(
    "case", ["slider-bar started beyond critical angle", "rod with mu 1e-8 above critical"]
)
def test_a_run_that_stops_at_the_start_has_a_time_without_rows(case):
    """The paper's scheme returns no row there."""
    [paper_scheme] = [one for one in REFERENCE if one.settings.get("method") == "paper"]
    [chosen] = [one for one in hard_cases() if one.name == case]
    found = verdict(chosen, paper_scheme)
    assert (found.word, found.size) == (RIGHT, 0.0), found


def test_every_scene_has_a_derivation_and_a_case():
    used = {case.scene for case in hard_cases()}
    for name in catalogue("hard"):
        assert load_scene(name).source.strip() and name in used
    names = [case.name for case in hard_cases()]
    assert len(names) == len(set(names))
    quick, default, full = ({case.topic for case in hard_cases(depth)} for depth in Depth)
    assert (
        len(full) == 13
        and full - default == {"long time", "chatter"}
        and default - quick == {"stick threshold"}
    )


def case_of(expected=MOTION, **changes):
    return HardCase("a", "b", scene="slider-bar-case-1", expected=expected, **changes)


def judged(found, expected=MOTION, parameter="dt", **changes):
    return judge(
        case_of(expected, **changes),
        Variant("v", "e", parameter, (1e-9,)),
        Outcome("", "ok", found),
    ).word


@pytest.mark.parametrize(
    ("error", "parameter", "word"),
    [
        (0.0, "dt", RIGHT),
        (9e-3, "dt", RIGHT),
        (2e-2, "dt", DEGRADED),
        (0.2, "dt", WRONG),
        (np.inf, "dt", WRONG),
        (np.nan, "dt", WRONG),
        (9e-7, "rtol", RIGHT),
        (1e-4, "rtol", DEGRADED),
        (2e-3, "rtol", WRONG),
    ],
)
def test_a_motion_is_judged_by_its_error(error, parameter, word):
    assert judged(Examination({"x": error, "y": 0.0}), parameter=parameter) == word


def test_the_worst_measure_decides_by_its_own_limit():
    found = judge(
        case_of(),
        Variant("v", "e", "rtol", (1e-9,)),
        Outcome("", "ok", Examination({"x": 5e-7, "complementarity": 2e-9})),
    )
    assert (found.word, found.about, found.size) == (WRONG, "complementarity", 2e-9)


def test_stops_and_refusals():
    claim = Examination(stopped="no solution at t = 1", stop_kind="no solution", stop_time=1.0)
    gave_up = Examination(stopped="step too small", stop_kind="step too small", stop_time=1.0)
    assert judged(claim) == WRONG and judged(gave_up) == DECLINED  # there is a motion
    assert judged(claim, REFUSAL) == judged(gave_up, REFUSAL) == RIGHT
    assert (
        judged(gave_up, MOTION_OR_WORD) == DECLINED
        and judged(Examination({"x": 1.0}), MOTION_OR_WORD) == WRONG
    )
    assert (
        judged(Examination({"drift accepted": 0.05}), REFUSAL)
        == judged(Examination({}), REFUSAL)
        == WRONG
    )
    for by, word in (
        (METHOD, RIGHT),
        (READER, UNREAD),
        (ADAPTER, DECLINED_BY_ADAPTER),
    ):
        # only an answer of the method is right
        assert judged(Examination(refused="mass: found 0", by=by), REFUSAL, words="mass") == word
        assert judged(Examination(refused="something else", by=by), REFUSAL, words="mass") == (
            word if by == ADAPTER else FAILED
        )
    assert judged(Examination(refused="at most 2000", by=ADAPTER), MOTION) == DECLINED_BY_ADAPTER
    for expected in (
        MOTION,
        REFUSAL,
    ):
        # a start off the constraints that was accepted silently, say
        assert judged(Examination(verdict=Verdict(WRONG, "50 m off")), expected) == WRONG
    for status, word in (
        ("refused", INEXPRESSIBLE),
        ("failed", FAILED),
        ("crashed", FAILED),
        ("timed out", FAILED),
        ("missing", NOT_INSTALLED),
    ):
        for expected in (MOTION, REFUSAL):
            assert (
                judge(case_of(expected), EVENT_DRIVEN, Outcome("", status, None, "why")).word
                == word
            )


def test_the_end_of_existence_is_judged_by_time_and_kind():
    end = {"stop": {"at": 1, "kind": "several solutions"}}
    for time, kind, word in (
        (1.0, "several solutions", RIGHT),
        (1.0 + 5e-9, "several solutions", RIGHT),
        (1.0, "no solution", DEGRADED),
        (1.001, "several solutions", WRONG),
        (0.9, "several solutions", WRONG),
    ):
        assert (
            judged(
                Examination(stopped=kind, stop_kind=kind, stop_time=time), NO_MOTION, "rtol", **end
            )
            == word
        )
    assert judged(Examination({"x": 0.0}), NO_MOTION, "rtol", **end) == WRONG  # it went on
    assert (
        judged(Examination({BEYOND: 1e-3}), NO_MOTION, **end) == DEGRADED
    )  # with one of the several
    assert (
        judged(Examination({BEYOND: 0.1}), NO_MOTION, **end)
        == judged(Examination({BEYOND: np.inf}), NO_MOTION, **end)
        == WRONG
    )
    for law, word in ((0.0, DEGRADED), (0.1, WRONG)):
        assert (
            judged(
                Examination(
                    {BEYOND: law}, stopped="several", stop_kind="several solutions", stop_time=1.1
                ),
                NO_MOTION,
                **end,
            )
            == word
        )
    assert (
        judged(
            Examination(
                {BEYOND: 0.0}, stopped="diverged", stop_kind="step too small", stop_time=1.1
            ),
            NO_MOTION,
            **end,
        )
        == WRONG
    )
    assert (
        judged(Examination(stopped="Newton did not converge"), NO_MOTION, **end) == DECLINED
    )  # says neither when nor that there is none


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("slider that can jam: width > length/mus", DEGRADED),
        ("slider-bar through the critical angle", WRONG),
        ("slider-bar started beyond critical angle", IMPULSIVE),
    ],
)
def test_one_of_several_motions_is_told_from_none_of_them(name, word):
    """pymunk goes on in all three: where rest and slip both obey Coulomb's law it slips by that law; past the critical angle its friction, of the step
    before, is off the law by a seventh of the load; and where finite forces have no motion impulses have one."""
    found = verdict(CASES[name], Variant("pymunk", "pymunk", "dt", ()))
    assert found.word == word, found


@pytest.mark.parametrize(
    ("engine", "fidelity", "settings", "word"),
    [
        ("pymunk", "joint", {}, IMPULSIVE),
        ("pymunk", "contact", {}, IMPULSIVE),
        ("pybullet", "contact", {}, IMPULSIVE),
        ("mujoco", "joint", {}, IMPULSIVE),
        ("dart", "contact", {}, IMPULSIVE),
        ("drake", "contact", {}, IMPULSIVE),
        ("moreau", "contact", {}, IMPULSIVE),
        ("drake", "contact", {"method": "continuous"}, WRONG),
        ("mujoco", "joint", {"method": "accelerations"}, WRONG),
        ("exudyn", "joint", {}, WRONG),
        ("reference", "joint", {"method": "paper"}, WRONG),
    ],
)
def test_what_goes_on_without_finite_forces_is_not_wrong_for_schemes_of_impulses(
    engine, fidelity, settings, word
):
    installed(engine)
    variant, gone_on = (
        Variant("v", engine, "dt", (), fidelity, settings),
        Outcome("", "ok", Examination({BEYOND: np.inf})),
    )
    assert (
        judge(case_of(NO_MOTION, stop={"at": 1, "kind": "no solution"}), variant, gone_on).word
        == word
    )
    assert (
        judge(
            case_of(NO_MOTION, stop={"at": 1, "kind": "several solutions"}), variant, gone_on
        ).word
        == WRONG
    )


@pytest.mark.parametrize(
    ("name", "engine", "word"),
    [
        ("start that violates the constraints", "reference", RIGHT),
        ("start that violates the constraints", "pymunk", DECLINED_BY_ADAPTER),
        ("velocity that violates the constraints", "exudyn", DECLINED_BY_ADAPTER),
        ("velocity that violates the constraints", "moreau", RIGHT),
        ("zero mass", "reference", UNREAD),
        ("zero mass", "pymunk", UNREAD),
        ("contradictory drives", "exudyn", RIGHT),
    ],
)
def test_only_a_method_is_right_in_refusing(name, engine, word):
    """Not the adapter in the name of its engine, nor the reader of scenes; Exudyn's own solver finds that drives contradict."""
    installed(engine)
    fidelity = "contact" if engine == "moreau" else "joint"
    variant = EVENT_DRIVEN if engine == "reference" else Variant("v", engine, "dt", (), fidelity)
    found = verdict(CASES[name], variant)
    assert found.word == word, found


@pytest.mark.parametrize(
    "name", ["weightless instants", "wedged slider", "slider of 2e8 kg on a bar of 2 kg"]
)
def test_a_box_without_clearance_stays_pressed_between_the_surfaces_of_its_guide(name):
    """In pymunk, by what its contacts remember: it stays where it was braked, and with a clearance it moves as it must."""
    case, error = CASES[name], {}
    for clearance in (0.0, 1e-7):
        variant = Variant(
            "pymunk, contact", "pymunk", "dt", (), "contact", {"clearance": clearance}
        )
        error[clearance] = examine(case.name, variant).measures["slider.x"]
    assert error[1e-7] < 1e-2 and error[0.0] > 0.5


def test_a_friction_that_is_not_a_number_obeys_no_law():
    scene = load_scene("hard/can-jam")
    columns = {f"guide.{name}": np.ones(3) for name in ("F1", "F2")} | {
        f"guide.{name}": np.zeros(3) for name in ("F3", "F4", "mode", "friction")
    }
    assert friction_excess(scene, columns) <= 0.0
    assert (
        friction_excess(scene, columns | {"guide.friction": np.array([0.0, np.nan, 0.0])}) == np.inf
    )


@pytest.mark.parametrize(
    ("fidelity", "off_at", "error"),
    [("contact", 0, 0.0), ("contact", 9, 0.0), ("contact", 10, 1.0), ("joint", 0, 1.0)],
)
def test_contacts_are_given_some_steps_to_carry_a_load(fidelity, off_at, error):
    force = np.ones(100)
    force[off_at] = 0.0
    run = Trajectory(
        "s",
        "any",
        "1",
        fidelity,
        np.arange(100) * 1e-3,
        {"guide.normal_force": force, "slider.x": force},
        settings={"dt": 1e-3},
    )

    def error_of(column, run):
        return follows(
            case_of(follows={column: "cos(t)^0"}), [load_scene("slider-bar-case-1")], [run]
        )[column]

    assert error_of("guide.normal_force", run) == error
    assert error_of("slider.x", run) == 1.0  # a position has no such grace
    assert (
        error_of("guide.normal_force", replace(run, settings={})) == 1.0
    )  # nor a method without a step


def test_a_motion_of_which_no_guide_is_known_to_stick_is_not_held_to_coulombs_law():
    """Modes and frictions are columns that an engine need not have."""
    case = CASES["slider that can jam: width > length/mus"]
    scene = case.scenes(True)[0]
    run = load_engine("pymunk").simulate(scene, dt=case.dt)
    assert set(_beyond(case, scene, run)) == {BEYOND}
    assert (
        _beyond(
            case,
            scene,
            replace(
                run,
                columns={
                    name: values
                    for name, values in run.columns.items()
                    if not name.endswith(".mode")
                },
            ),
        )
        == {}
    )


@pytest.mark.parametrize("seed", range(12))
def test_other_units_scale_equations_and_come_back(seed):
    """Mobilities scale with 1/mass (times 1/length for every angle row), and back again the scene is the same."""
    scene = scene_from_dict(extreme_scene(np.random.default_rng([3, seed])))
    units = Units(10.0, 1e-3, 7.0)
    other = scaled(scene, units)
    back = scaled(other, Units(1 / 10.0, 1e3, 1 / 7.0))
    for name, body in scene.bodies.items():
        assert back.bodies[name].inertia == pytest.approx(body.inertia) and back.bodies[
            name
        ].velocity == pytest.approx(body.velocity)
    rows = []
    for one in (scene, other):
        m = Mechanism(one).arrays
        w = workspace(m)
        row_form(m, w, 0.0, *Mechanism(one).initial_state())
        # right sides over the square roots of mobilities: accelerations times the square root of a mass, sqrt(W)/s
        rows.append(w.right / np.sqrt(np.diag(w.G)))
    np.testing.assert_allclose(
        rows[1],
        rows[0] * units.of((1, 0, -2)) * np.sqrt(units.mass),
        rtol=1e-6,
        atol=1e-9 * np.max(np.abs(rows[1])),
    )


def test_critical_coefficient_of_the_rod():
    """Number of consistent normal forces: one below the critical coefficient, none or two above."""
    for excess, w, count in ((-1e-6, 0, 1), (1e-6, 0, 0), (-1e-6, 20, 1), (1e-6, 20, 2)):
        assert (
            len(rod_normal_force(load_scene("hard/sliding-rod", {"excess": excess, "w": w})))
            == count
        )
    small = load_scene("hard/sliding-rod", {"r": 1e-9}).parameters["critical"]
    assert small == pytest.approx(4 / 3, abs=1e-8)


def test_hyperstatic_stick_does_not_depend_on_order_or_units():
    """Sums to the accuracy of a solution without redundancy, and the shares as well: the shortest solution is one only."""
    incline = np.deg2rad(15)
    for scene in CASES["three guides at rest"].scenes():
        run = load_engine("reference").simulate(scene, rtol=1e-10, stabilization="projection")
        weight = -scene.gravity[1] * scene.bodies["slider"].mass
        for name, total in (
            ("friction", -weight * np.sin(incline)),
            ("normal_force", weight * np.cos(incline)),
        ):
            for i in (1, 2, 3):
                np.testing.assert_allclose(run[f"guide-{i}.{name}"], total / 3, rtol=1e-9)


@pytest.mark.parametrize("moved", [0.0, 1e-3])
def test_a_start_moved_silently_has_a_size(moved):
    scene = load_scene("hard/inconsistent-velocity")
    columns = {
        f"{name}.{column}": np.array([float(value)])
        for name, body in scene.bodies.items()
        for column, value in zip(
            ("x", "y", "angle", "vx", "vy", "omega"),
            (*body.position, body.angle, *body.velocity, body.angular_velocity),
        )
    }
    columns["bar.x"] = columns["bar.x"] + moved
    run = Trajectory(
        scene.name,
        "any",
        "1",
        "joint",
        np.zeros(1),
        columns | {"drift.position": np.zeros(1), "drift.velocity": np.zeros(1)},
    )
    assert accepted_start(case_of(), [scene], [run])["start moved silently"] == pytest.approx(moved)


def test_without_a_static_coefficient_a_case_that_is_not_about_it_has_mus_equal_to_mu():
    for name, same in (("normal force of case 3", True), ("mus = 10 mu", False)):
        [guide] = CASES[name].scenes(static_coefficient=False)[0].frictional_guides.values()
        assert (guide.static_coefficient == guide.mu) == same


def page_table():
    rows = [
        ("t1", "a", "reference", RIGHT, "x", 1e-9),
        ("t1", "a", "trial and error", DECLINED, "cycles", np.nan),
        ("t1", "a", "Moreau, contact", WRONG, "slider.x", 0.4),
        ("t2", "b", "reference", RIGHT, "", np.nan),
        ("t2", "b", "trial and error", RIGHT, "", np.nan),
        ("t2", "b", "Moreau, contact", WRONG, "slider.x", 0.2),
    ]
    return pd.DataFrame(
        rows, columns=["topic", "case", "variant", "verdict", "about", "size"]
    ).assign(scene="s", must="m", limit=1e-2, **{"cpu_time": 1.0})


def test_presentation():
    """Counts of every method over the same mechanical cases; hostile files stand apart; a verdict that changes changes them."""
    table = page_table().assign(
        fidelity="joint",
        engine=lambda rows: [
            "reference" if name != "Moreau, contact" else "pymunk" for name in rows["variant"]
        ],
    )
    hostile = table.assign(topic=HOSTILE, case="hostile " + table["case"], verdict=UNREAD)
    missing = table.iloc[:1].assign(variant="absent", engine="absent", verdict=NOT_INSTALLED)
    results = Results((), {}, {"hard": pd.concat([table, hostile, missing], ignore_index=True)})

    def counts(results):
        return present(results).headlines[0].cells

    expected = {}
    for method, rows in table.groupby("variant", sort=False):
        expected[method] = "/".join(
            str(rows["verdict"].isin(verdicts).sum())
            for verdicts in (
                [RIGHT],
                [DECLINED],
                [DECLINED_BY_ADAPTER, INEXPRESSIBLE, IMPULSIVE],
                [DEGRADED],
                [WRONG, FAILED],
            )
        )
    assert counts(results) == expected and len(expected) == 3
    said = present(results)
    own, [engines] = said.rows["own"], said.rows["engines"]
    assert own == {"variant": "reference", "wrong": 0, "judged": 2}
    moreau = {"variant": "Moreau, contact", "wrong": 2, "judged": 2}
    assert engines == {"fidelity": "joint", "methods": [moreau]}
    cases = hostile["case"].nunique()
    assert said.rows["hostile"] == {"cases": cases, "refused": cases, "wrong": []}
    section = section_of(STUDY, results)
    assert "Moreau, contact" in section.answer and len(section.answer) <= ANSWER_LENGTH
    captions = {each.caption for each in (*section.figures, *section.tables)}
    assert "" not in captions and len(captions) == len(section.figures) + len(section.tables)
    [heat] = said.figures
    wide = table.pivot(index="case", columns="variant", values="verdict")
    assert (
        heat.cells
        == wide.loc[list(heat.rows), list(heat.columns)]
        .replace({RIGHT: "right", DECLINED: "declined", WRONG: "wrong"})
        .to_numpy()
        .tolist()
    )
    assert list(heat.categories) == said.tables[0].heads()[1:]  # the kinds of the table
    both = results.tables["hard"].copy()
    both.loc[(both["variant"] == "Moreau, contact") & (both["topic"] == HOSTILE), "verdict"] = WRONG
    wrong = present(replace(results, tables={"hard": both})).rows["hostile"]["wrong"]
    assert wrong == [{"variant": "Moreau, contact", "cases": cases}]
    engines_alone = table[table["engine"] == "pymunk"].reset_index(drop=True)
    assert present(replace(results, tables={"hard": engines_alone})).rows["own"] is None
    mutated = results.tables["hard"].copy()
    mutated.loc[0, "verdict"] = WRONG
    assert counts(replace(results, tables={"hard": mutated})) != expected
    for nothing in (NOT_RUN, NOT_INSTALLED):
        assert present(Results((), {}, {"hard": table.assign(verdict=nothing)})).is_empty
    assert present(Results((), {}, {})).is_empty


def test_ten_thousand_bodies_are_refused():
    """More constraint rows than are solved densely: by the reference, and by an engine that would need its reactions."""
    scene = CASES["ten thousand bodies"].scenes()[0]
    with pytest.raises(SceneError, match=f"20000 constraint equations.*at most {MOST_ROWS}"):
        Mechanism(scene)
    assert "at most 5000" in load_engine("exudyn").refusal(
        scene, "joint"
    )  # in its process memory would end
    pytest.importorskip("pybullet")
    assert "at most" in load_engine("pybullet").refusal(scene, "joint")


@pytest.mark.parametrize(
    "arguments",
    [
        ["scenes", "soft"],
        ["compare", "hard", "--engines", "havok"],
        ["compare", "hard", "--timeout", "0"],
        ["compare", "hard", "--problems", "nowhere/set.parquet"],
    ],
)
def test_bad_commands(arguments):
    result = invoke(*arguments, exit_code=BAD_INPUT)
    assert "Traceback" not in result.output
