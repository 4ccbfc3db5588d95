"""Held loads: limits by statics of their own, the reference at rest and beyond, creep that is put in, laws, and text."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import here, installed, invoke
from made_up_runs import words, wrongly_written
from scipy.optimize import brentq

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope, union
from stiction.comparisons.bench.timing.visits import VisitTimes
from stiction.comparisons.bench.variants import COEFFICIENTS, OWN_CPU, Coefficients
from stiction.comparisons.measures.published_creep import CREEP as OURS
from stiction.comparisons.measures.published_creep import MATCHED, PUBLISHED, UNCERTAINTY
from stiction.comparisons.studies import hold, hold_tables
from stiction.comparisons.studies.hold import STUDY, changes, measure_slip, plan, true_slip
from stiction.comparisons.studies.hold_data import Law
from stiction.comparisons.studies.hold_presentation import present
from stiction.comparisons.studies.hold_tables import (
    BROKEN,
    CREEP,
    HELD,
    HOLDS,
    LOAD,
    OBEYED,
    OPEN,
    RAMP,
    SLOWER,
    STOP,
    TEST,
    TIME,
    UNSURE,
    laws_table,
    methods_table,
    settings_table,
    verdict,
)
from stiction.comparisons.studies.settings import DEFAULT, SETTING, SUBJECT
from stiction.engines import load_engine
from stiction.reports.text import section_of
from stiction.scenes import InputError, catalogue, load_scene, vary
from stiction.uncertain import Uncertain

SCENES = [name for name in catalogue() if name.startswith("hold-")]
G = 9.81
MASS = {"hold-level": 1.0, "hold-incline": 1.0, "hold-bar": 3.0, "hold-moment": 1.0}
"""That the load accelerates, kg, where the normal force is constant."""


def loaded(scene, test, load, static):
    return vary(scene, changes(scene, test, load, static))


def statics(name, t, load, mus):
    """Force along the guide, normal force and moment of all loads about the slider's centre, by the numbers of the scenes' figures.

    `load` in newton along the guide, gravity included.
    """
    w = 4 * np.pi  # of the turning bar: a turn in half a second
    along, normal, moment = {
        "hold-level": (load, G, 0.0),
        "hold-incline": (load, G * np.cos(np.pi / 18), 0.0),
        "hold-bar": (load, 3 * G, -2 * G * 1.0),  # 2 kg at 1 m
        "hold-moment": (load, G + 20.0, -20.0 * 0.5 - 0.2 * load),
        "hold-turning-bar": (
            load + 0.5 * 0.025 * w**2 * np.cos(w * t),
            1.5 * G - 0.5 * 0.025 * w**2 * np.sin(w * t),
            -0.5 * G * 0.025 * np.cos(w * t),
        ),
        "hold-vibration": (load, G - 0.5 * G * np.sin(10 * np.pi * t), 0.0),
    }[name]
    return along, normal, moment


def friction_at_limit(name, t, load, mu):
    """mu (|n1| + |n2|): the corners carry the normal force and the moment of the loads and of full friction on both surfaces.

    n1 + n2 = R; (n2 - n1) a/2 = -M + (b/2) mu R, with a = 0.6 and b = 0.5, friction against a motion along the load.
    """
    _, normal, moment = statics(name, t, load, mu)
    difference = 2 / 0.6 * (-moment + 0.25 * mu * normal)
    return mu * (abs(normal - difference) + abs(normal + difference)) / 2


def margin(name, t, load, mu):
    return friction_at_limit(name, t, load, mu) - statics(name, t, load, mu)[0]


def coefficients(name, static):
    mu, mus = (0.03, 0.04) if name == "hold-bar" else (0.2, 0.3)
    return mu, mus if static else mu


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_the_limit_is_that_of_statics(name, static):
    """The load at which the least margin over a period is 0; sampled finely, as the least is flat where it lies."""
    scene, (_, mus) = loaded(load_scene(name), HELD, 0.5, static), coefficients(name, static)
    t = np.linspace(0.0, 1.0, 200_001)
    limit = (
        brentq(
            lambda load: min(
                margin(name, s, load, mus)
                for s in (t if "period" in scene.parameters else t[:1])[::1000]
            ),
            0.0,
            50.0,
            xtol=1e-12,
        )
        if "period" not in scene.parameters
        else brentq(lambda load: float(np.min(margin(name, t, load, mus))), 0.0, 50.0, xtol=1e-12)
    )
    assert scene.parameters["limit"] == pytest.approx(limit, rel=1e-9)


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_the_reference_rests_below_the_limit(name, static, compiled):
    """Slip is 0 up to rounding at any tolerance, and no event; the bar's speed is 0.3 m/s."""
    for load in (0.1, 0.5, 0.9, 0.99):
        scene = loaded(load_scene(name), HELD, load, static)
        run = load_engine("reference").simulate(scene, rtol=1e-6)
        assert run.termination == "end" and not run.events and np.all(run["guide.mode"] == 0)
        bound = 1e-15 if name in ("hold-turning-bar", "hold-incline") else 0.0
        assert (
            np.max(np.abs(run["guide.slip_velocity"])) <= bound
            and np.ptp(run["guide.displacement"]) <= bound
        )
        assert measure_slip("reference", scene, HELD, {"rtol": 1e-6})[0].creep.value == 0.0


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_the_reference_breaks_away_where_statics_do(name, static, compiled):
    """The first instant at which the margin under the ramp is 0; without events of their own, times are those of the integrator."""
    scene, (_, mus) = loaded(load_scene(name), RAMP, 0.8, static), coefficients(name, static)
    limit = scene.parameters["limit"]

    def under_ramp(t):
        return margin(name, t, (0.8 + 0.25 * t) * limit, mus)

    t = np.linspace(0.0, 1.5, 15_001)
    first = int(np.argmax(under_ramp(t) < 0))
    exact = brentq(under_ramp, t[first - 1], t[first], xtol=1e-14)
    events = load_engine("reference").simulate(scene, rtol=1e-12).events
    assert events[0].kind == "slip" and abs(0.25 * (events[0].time - exact)) < 1e-9


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("name", MASS)
def test_beyond_the_limit_the_truth_has_the_closed_form(name, static, compiled):
    """m x'' = load - friction; from break-away on the load grows, and speeds are integrals of it; a stop takes v^2/(2 a)."""
    mu, mus = coefficients(name, static)
    scene = loaded(load_scene(name), RAMP, 0.8, static)
    limit, mass = scene.parameters["limit"], MASS[name]

    def acceleration(load):
        return -margin(name, 0.0, load, mu) / mass

    found, _ = true_slip(scene, RAMP)
    gained = brentq(
        lambda s: (
            acceleration(limit) * s
            + (acceleration(1.25 * limit) - acceleration(limit)) * s**2 / 2
            - 1e-3
        ),
        0,
        1,
    )
    assert found.let_go == pytest.approx(
        0.8 + gained, abs=1e-6
    )  # samples every 0.1 ms, a line between
    assert found.acceleration == pytest.approx(
        acceleration(limit * (1 + 0.25 * (gained + 0.025))), rel=1e-3
    )
    stop = loaded(load_scene(name), STOP, 0.5, static)
    assert true_slip(stop, STOP)[0].landing == pytest.approx(
        0.05**2 / (-2 * acceleration(0.5 * limit)), rel=1e-9
    )


class Creeping:
    """The reference with a creep that is put into it: a regularized law of some width, in proportion to the load or to its square root."""

    def __init__(self, zone, power=1.0):
        self.zone, self.power, self.settings = zone, power, []

    def simulate(self, scene, **arguments):
        zone = self.zone * arguments.pop("scale", 1.0)
        run = load_engine("reference").simulate(scene, **arguments)
        speed = zone * scene.parameters["part"] ** self.power
        columns = {
            **run.columns,
            "guide.displacement": run["guide.displacement"] + speed * run.t,
            "guide.slip_velocity": run["guide.slip_velocity"] + speed,
        }
        return replace(run, columns=columns, settings={**run.settings, "scale": zone / self.zone})


@pytest.mark.parametrize("zone", [1e-8, 1e-5])
def test_creep_that_is_put_into_the_reference_is_noticed(zone, monkeypatch, compiled):
    monkeypatch.setattr(hold, "load_engine", lambda name: Creeping(zone))
    with here():
        tables = plan(Scope((), Depth.QUICK, ())).make().tables
    own = tables["hold-methods"].set_index("variant")
    assert not own[HOLDS].any() and list(tables["hold-laws"]["verdict"]) == [BROKEN]
    assert own.loc["reference", CREEP] == pytest.approx(0.9 * zone, rel=1e-3)


@pytest.fixture(scope="module")
def quick():
    installed("pymunk")
    with here():
        return plan(Scope((), Depth.QUICK, ("pymunk",))).make()


def test_a_quick_study_has_a_row_a_run_and_holds_with_the_reference(quick):
    table, methods = quick.tables["hold"], quick.tables["hold-methods"]
    assert (table["status"] == "ok").all() and table["key"].is_unique and set(table[TEST]) == {HELD}
    assert methods.loc[methods["engine"] == "reference", HOLDS].all()
    assert list(methods["variant"]) == list(table["variant"].unique())
    results = union([quick])
    reference = present(results).rows["reference"]
    assert list(quick.tables["hold-laws"]["verdict"]) == [OBEYED]
    assert reference["rests"] and not reference["creeps"] and float(reference["runs"]) == 1
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    assert set(section.headlines[0].cells) == set(methods["variant"])
    assert 0 < len(section.answer) <= ANSWER_LENGTH


@pytest.mark.parametrize("damage", [1.0, 10.0])
def test_the_regularization_of_exudyn_is_the_one_it_states(damage, monkeypatch):
    """Creep = load/limit of friction_zone; an adapter whose zone were ten times as wide as it says is noticed."""
    engine = installed("exudyn")

    class Damaged:
        def simulate(self, scene, **arguments):
            run = engine.simulate(scene, friction_zone=damage * 1e-4, **arguments)
            return replace(run, settings={**run.settings, "friction_zone": 1e-4})

    monkeypatch.setattr(hold, "load_engine", lambda name: Damaged())
    scene = loaded(load_scene("hold-level"), HELD, 0.5, False)
    found, ends = measure_slip("exudyn", scene, HELD, {"dt": 1e-3, "fidelity": "contact"})
    ratio = found.creep.value / ends.settings["friction_zone"]
    assert (abs(ratio / 0.5 - 1) < 0.05) == (damage == 1.0)


@pytest.mark.parametrize("engine", ["reference", "pymunk"])
def test_a_run_beyond_the_limit_against_the_truth(engine, compiled):
    """The reference lets go, accelerates and stops where the truth does; pymunk's joint within a step or two of 1 ms."""
    installed(engine)
    given = {"rtol": 1e-12} if engine == "reference" else {"dt": 1e-3}
    for test in (RAMP, STOP):
        scene = loaded(load_scene("hold-moment"), test, 0.8, True)
        found, (exact, _) = measure_slip(engine, scene, test, given)[0], true_slip(scene, test)
        if test == RAMP:
            assert abs(found.let_go - exact.let_go) < 3e-3 and found.acceleration == pytest.approx(
                exact.acceleration, rel=0.02
            )
        else:
            assert (
                found.landing == pytest.approx(exact.landing, abs=2 * 0.05 * 1e-3)
                and abs(found.creep.value) < 1e-9
            )


def made_up(subject, setting, load, creep, unsure=0.0, cpu=1.0, scene="s", status="ok", **settings):
    return {
        "scene": scene,
        "variant": f"{subject}: {setting}" if setting else subject,
        "engine": "e",
        "fidelity": "contact",
        "truth": scene,
        COEFFICIENTS: str(Coefficients.ONE),
        hold_tables.CHANGED: setting.partition("=")[0] if "=" in (setting or "") else None,
        "parameter": "dt",
        "step": 1e-3,
        "status": status,
        "reason": "",
        "friction_by": "engine",
        "settings": json.dumps(settings),
        OWN_CPU: cpu,
        SUBJECT: subject if setting else None,
        SETTING: setting or None,
        TEST: HELD,
        LOAD: load,
        hold_tables.PART: load,
        hold_tables.LETS_GO: creep > 0.1,
        CREEP: creep,
        UNSURE: unsure,
        "key": f"{subject}{setting}{load}",
    }


def verdicts_of(results):
    """Numbers of methods that hold and of all; the others by label, with their creep (m/s)."""
    rows = present(results).rows
    return {
        **{name: (rows[name]["holding"], rows[name]["all"]) for name in ("engines", "own")},
        "creeping": {row["variant"]: float(row[CREEP]) for row in rows["creeping"]},
        "let_go": [one["method"]["variant"] for one in rows["let_go"]],
        "undecided": rows["undecided"],
    }


def over_impratio(power, noise=0.0):
    rng, values = (
        np.random.default_rng(1),
        {DEFAULT: 1e4, "impratio=100.0": 1e2, "impratio=1.0": 1.0},
    )
    return pd.DataFrame(
        [
            made_up(
                "mujoco, contact",
                setting,
                load,
                1e-3 * load * value**-power * np.exp(noise * rng.normal()),
                impratio=value,
            )
            for setting, value in values.items()
            for load in (0.1, 0.5, 0.9)
        ]
    )


@pytest.mark.parametrize(
    ("power", "noise", "word"), [(1.0, 0.0, OBEYED), (0.5, 0.0, BROKEN), (1.0, 5.0, OPEN)]
)
def test_an_exponent_is_obeyed_broken_or_open(power, noise, word):
    [law] = laws_table(over_impratio(power, noise)).to_dict("records")
    assert law["verdict"] == word and (noise or law[hold_tables.FOUND] == pytest.approx(-power))


@pytest.mark.parametrize(
    ("factor", "unsure", "word"), [(1.0, 1e-4, OBEYED), (1.3, 0.01, BROKEN), (1.005, 0.02, OPEN)]
)
def test_a_predicted_creep_is_obeyed_broken_or_open(factor, unsure, word):
    """Creep = part of the bound times zone, at every load and zone."""
    runs = pd.DataFrame(
        [
            made_up(
                "exudyn, contact",
                setting,
                load,
                factor * load * zone,
                unsure * load * zone,
                friction_zone=zone,
            )
            for setting, zone in ((DEFAULT, 1e-4), ("friction_zone=0.001", 1e-3))
            for load in (0.1, 0.5, 0.9)
        ]
    )
    [law] = laws_table(runs).to_dict("records")
    assert law["verdict"] == word and law[hold_tables.FOUND] == pytest.approx(factor)


def test_creep_within_its_uncertainty_and_single_runs_decide_nothing():
    runs = over_impratio(1.0)
    assert laws_table(runs.assign(**{UNSURE: 1.0})).empty
    assert list(laws_table(runs[runs[SETTING] == DEFAULT])["verdict"]) == [OPEN]
    assert verdict(Uncertain(1.19, 0.02), 1.0, 0.2) == verdict(None, 1.0, 0.2) == OPEN
    assert (
        verdict(Uncertain(1.25, 0.02), 1.0, 0.2) == BROKEN
        and verdict(Uncertain(-0.9, 0.02), -1.0, 0.2) == OBEYED
    )


def test_the_fastest_creep_counts_and_a_failed_run_leaves_it_undecided():
    runs = pd.DataFrame(
        [
            made_up("a", "", 0.5, 0.0),
            made_up("a", "", 0.9, -1e-5, 1e-7),
            made_up("a", "", 0.99, 1.0),
            made_up("b", "", 0.5, 2e-6, 3e-6),
            made_up("b", "", 0.9, 5e-10),
            made_up("c", "", 0.5, 0.0),
            made_up("c", "", 0.9, np.nan, status="crashed"),
        ]
    )
    found = methods_table(runs).set_index("variant")
    assert (found.loc["a", CREEP], found.loc["a", LOAD]) == (1e-5, 0.9)
    assert list(found[HOLDS]) == [False, None, None] and list(found["failed"]) == [0, 0, 1]
    tables = {"hold": runs, "hold-methods": methods_table(runs)}
    results = Results((), {}, tables)
    verdicts = verdicts_of(results)
    assert verdicts == {
        "engines": (0, 3),
        "own": (0, 0),
        "creeping": {"a": 1e-5},
        "let_go": [],
        "undecided": ["c", "b"],
    }
    [failed] = present(results).rows["failed"]
    assert failed["variant"] == "c" and float(failed["failed"]) == 1
    section = section_of(STUDY, results)
    assert "1e-05 m/s (a)" in section.answer and "c (1)" in words(section)
    assert not wrongly_written(section, results)


def test_noise_decides_nothing():
    """As PyBullet's contacts on hold-moment: beyond the limit by less than two intervals, and against the load."""
    runs = pd.DataFrame(
        [
            made_up("a", "", 0.5, 1.44e-8, 1.5e-8),
            made_up("a", "", 0.9, -1.87e-9, 7.3e-10),
            made_up("b", "", 0.9, 1e-5, 1e-13),
        ]
    )
    tables = {"hold": runs, "hold-methods": methods_table(runs)}
    assert list(tables["hold-methods"][HOLDS]) == [None, False]
    results = Results((), {}, tables)
    verdicts, said = verdicts_of(results), present(results)
    assert verdicts["creeping"] == {"b": 1e-5} and verdicts["undecided"] == ["a"]
    assert any(text.endswith(": a.") for text in section_of(STUDY, results).findings)
    assert said.headlines[0].cells["a"] == "< 3e-08"
    assert [row[-1] for row in said.tables[0].cells()] == ["inconclusive", "no"]


def test_engines_are_counted_without_our_own_and_what_a_setting_makes_is_said():
    """A regularized law creeps by its setting; bristles let go where the load acts at once, and not under a ramp."""
    runs = pd.DataFrame(
        [
            made_up("a", "", 0.9, 0.0),
            made_up("ours", "", 0.9, 0.0),
            made_up("b", "", 0.9, 9e-5),
            made_up("c", "", 0.9, 1.0),
            made_up("c", "", np.nan, np.nan),
        ]
    )
    runs["engine"] = runs["engine"].mask(runs["variant"] == "ours", "reference")
    runs[hold_tables.OF_ZONE] = [None, None, 0.9, None, None]
    runs.loc[4, [TEST, hold_tables.BREAK_AWAY, hold_tables.BREAK_UNSURE]] = [RAMP, 1.2e-3, 2.5e-4]
    results = Results((), {}, {"hold": runs, "hold-methods": methods_table(runs)})
    assert verdicts_of(results) == {
        "engines": (1, 3),
        "own": (1, 1),
        "creeping": {"b": 9e-5},
        "let_go": ["c"],
        "undecided": [],
    }
    said = present(results)
    [regularized], [gone] = said.rows["regularized"], said.rows["let_go"]
    assert regularized["variant"] == "b" and float(regularized[hold_tables.OF_ZONE]) == 0.9
    assert gone["method"]["scene"] == "s" and float(gone["ramp"][hold_tables.BREAK_AWAY]) == 1.2e-3
    assert gone["ramp"]["bound"] is None and said.headlines[0].cells["c"] == "breaks away"
    section = section_of(STUDY, results)
    assert {number.text for number in section.numbers} == {"9e-05", "0.9", "+0.12"}
    assert not wrongly_written(section, results) and len(section.answer) <= ANSWER_LENGTH
    [figure] = said.figures
    assert [series.label for panel in figure.panels for series in panel.series] == [
        "b",
        "c",
    ]  # at rest nothing is drawn


def test_what_rounding_makes_is_0_and_the_reference_alone_is_no_table_of_laws():
    runs = pd.DataFrame([made_up("a", "", 0.9, 0.0), made_up("a", "", 0.5, 0.0)])
    runs["engine"] = "reference"
    runs.loc[1, [TEST, hold_tables.STOPPED, hold_tables.STOP_UNSURE, hold_tables.BREAK_AWAY]] = [
        STOP,
        7.8e-18,
        2.1e-18,
        0.0,
    ]
    laws = pd.DataFrame(
        [{SUBJECT: "reference", "over": hold_tables.REST, "runs": 1, "verdict": OBEYED}]
    )
    shown = {
        table.name: table
        for table in present(
            Results((), {}, {"hold": runs, "hold-methods": methods_table(runs), "hold-laws": laws})
        ).tables
    }
    assert "hold-laws" not in shown and shown["hold-limit"].cells()[0][-1] == "0"


def test_one_creep_stands_for_a_method_in_sentence_and_table():
    """That which exceeds its uncertainty, however fast another may be; where none does, the largest bound."""
    runs = pd.DataFrame(
        [
            made_up("a", "", 0.9, 3e-8, 1e-9),
            made_up("a", "", 0.9, 1e-6, 2e-6, scene="t"),
            made_up("b", "", 0.9, 0.0, 1e-10),
            made_up("b", "", 0.9, 1e-12, 3e-12, scene="t"),
            made_up("b", "", 0.9, 2e-12, 1e-11, scene="u"),
            made_up("c", "", 0.9, 0.0, 1e-12),
        ]
    )
    tables = {"hold": runs, "hold-methods": methods_table(runs)}
    results = Results((), {}, tables)
    said, verdicts = present(results), verdicts_of(results)
    assert verdicts["engines"] == (2, 3) and verdicts["creeping"] == {"a": 3e-8}
    assert [number.text for number in section_of(STUDY, results).numbers] == ["3e-08"]
    cells = {row[0]: row[3] for row in said.tables[0].cells()}
    assert cells == {"a": "3e-08", "b": "< 1.2e-11", "c": "0"}
    assert said.headlines[0].cells == cells


def test_the_setting_that_helps_most_and_its_cost():
    runs = pd.DataFrame(
        [
            made_up("e, contact", setting, load, load * creep, cpu=cpu)
            for load in (0.5, 0.9)
            for setting, creep, cpu in (
                (DEFAULT, 1e-4, 1.0),
                ("a=1", 1e-5, 3.0),
                ("b=2", 5e-5, 1.0),
            )
        ]
    )
    settings = settings_table(runs)
    assert list(settings[SLOWER]) == pytest.approx([1.0, 0.1, 0.5])
    tables = {
        "hold": runs,
        "hold-methods": methods_table(pd.DataFrame([made_up("a", "", 0.9, 0.0)])),
        "hold-settings": settings,
    }
    results = Results((), {}, tables)
    said = present(results)
    [best], helpful = said.rows["best_settings"], said.rows["most_helpful"]
    assert best == helpful["setting"]
    assert (best[SUBJECT], best[SETTING]) == ("e, contact", "a=1")
    assert (float(best[CREEP]), float(best[TIME])) == pytest.approx((9e-6, 3.0))
    assert float(helpful["default"][CREEP]) == pytest.approx(9e-5)
    section = section_of(STUDY, results)
    assert [number.text for number in section.numbers] == ["9e-05", "9e-06", "3", "9e-06", "3"]
    assert "e, contact" in section.beside and not wrongly_written(section, results)
    assert [figure.name for figure in said.figures] == ["hold", "hold-settings"]
    captions = {figure.caption for figure in section.figures}
    captions |= {table.caption for table in section.tables}
    assert "" not in captions and len(captions) == len(section.figures) + len(section.tables)


def test_verdicts_on_laws_and_on_published_creep():
    """Each verdict has its laws; the published number that is farthest, and was not chosen to be met, is shown."""
    runs = pd.DataFrame([made_up("reference", "", 0.9, 0.0)]).assign(engine="reference")
    laws = pd.DataFrame(
        [
            {SUBJECT: "reference", "over": hold_tables.REST, "runs": 4, "verdict": OPEN},
            {SUBJECT: "x", "over": "a", "kind": "ratio", "law": 1.0, "verdict": OBEYED},
            {SUBJECT: "y", "over": "b", "kind": "exponent", "law": -1.0, "verdict": BROKEN},
            {SUBJECT: "z", "over": "c", "kind": "exponent", "law": -1.0, "verdict": OPEN},
        ]
    )
    laws[hold_tables.FOUND] = [None, 1.001, -0.5, None]
    laws[hold_tables.FOUND_UNSURE] = [None, 1e-4, 0.02, None]
    published = pd.DataFrame(
        {
            "case": ["a", "b", "c", "d"],
            PUBLISHED: [10.0, 20.0, 30.0, np.nan],
            OURS: [11.0, 20.5, 90.0, 5.0],
            UNCERTAINTY: [0.5, 0.1, 1.0, 0.1],
            MATCHED: [False, False, True, False],
        }
    )
    tables = {
        "hold": runs,
        "hold-methods": methods_table(runs),
        "hold-laws": laws,
        "hold-published": published,
    }
    results = Results((), {}, tables)
    rows = present(results).rows
    assert {word: [row[SUBJECT] for row in rows[word]] for word in (OBEYED, BROKEN, OPEN)} == {
        OBEYED: ["x"],
        BROKEN: ["y"],
        OPEN: ["z"],
    }
    reference = rows["reference"]
    assert not reference["rests"] and not reference["creeps"] and float(reference["runs"]) == 4
    assert float(rows["farthest"][OURS]) == 11.0
    section = section_of(STUDY, results)
    texts = [number.text for number in section.numbers]
    assert texts == ["4", "-0.50 ± 0.02", "-1", "10", "11.0 ± 0.5"]
    assert not wrongly_written(section, results)
    names = {table.name for table in section.tables}
    assert {"hold-laws", "hold-published"} <= names


def test_published_creep_that_was_not_computed_is_a_failure_with_its_reason():
    runs = pd.DataFrame([made_up("a", "", 0.9, 0.0)])
    lost = pd.DataFrame([{"case": "all", "status": "failed", "reason": "made up"}])
    tables = {"hold": runs, "hold-methods": methods_table(runs), "hold-published": lost}
    section = section_of(STUDY, Results((), {}, tables))
    assert sum("made up" in finding for finding in section.findings) == 1
    assert "hold-published" not in {table.name for table in section.tables}


def test_without_a_run_that_succeeded_failures_are_all_that_is_said():
    runs = pd.DataFrame([made_up("a", "", 0.9, np.nan, status="crashed")])
    results = Results((), {}, {"hold": runs, "hold-methods": methods_table(runs)})
    section = section_of(STUDY, results)
    assert section.answer and not section.numbers[1:] and not section.notes
    [failed] = present(results).rows["failed"]
    assert failed["variant"] == "a" and len(section.findings) == 1
    assert not section.tables and not section.figures and not section.headlines
    assert present(Results((), {}, {})).is_empty


def test_the_time_of_a_setting_is_the_median_of_repeats(monkeypatch, compiled):
    """Set-up and reduction are in none of them, and a run that is not timed keeps the time of its own."""
    visits = []

    def visit(*run):
        visits.append(run)
        return VisitTimes(0.0, 0.0, 0.125, 0.0, 3)

    monkeypatch.setattr(hold, "visit", visit)
    scene = loaded(load_scene("hold-level"), HELD, 0.5, False)
    times = [
        measure_slip("reference", scene, HELD, {"rtol": 1e-6}, timed)[1].cost.own_s
        for timed in (False, True)
    ]
    assert times[0] != 0.125 == times[1] and visits == [("reference", scene, {"rtol": 1e-6})]
    tasks = plan(Scope((load_scene("hold-level"),), Depth.FULL, ("pymunk",))).tasks
    assert {task.args[-1] for task in tasks if ": " in task.label} == {True}
    assert {
        task.args[-1] for task in tasks if task.function is measure_slip and ": " not in task.label
    } == {False}


def test_a_row_has_the_command_that_runs_it_again(quick, in_this_process):
    rows = quick.tables["hold"].to_dict("records")
    for row in (rows[0], rows[-1]):
        invoke(*shlex.split(row[AGAIN])[1:])
    assert "--set part=0.9" in rows[0][AGAIN]


def test_a_scene_without_the_parameters_is_refused():
    with pytest.raises(
        InputError,
        match="pendulum: parameters: found no part, ramp, v0, limit, mu, mus; expected part",
    ):
        plan(Scope((load_scene("pendulum"),), Depth.QUICK, ()))


def test_a_campaign_says_in_one_line_why_it_has_no_such_test():
    """The scenes of the study have it, those of other studies have not."""
    reason = STUDY.applies(Scope((load_scene("pendulum"),), Depth.QUICK, ()))
    assert "hold-incline" in reason and "found" not in reason and "\n" not in reason
    assert not STUDY.applies(Scope((load_scene("hold-incline"),), Depth.QUICK, ()))


def test_command(tmp_path, in_this_process):
    file = tmp_path / "hold.csv"
    ended = invoke(
        "compare", "hold", "hold-incline", "--quick", "--engines", "reference", "--out", file
    )
    runs = pd.read_csv(file)
    assert set(runs["scene"]) == {"hold-incline"}
    methods = runs["variant"].nunique()
    assert f"{methods} of {methods} of our own" in ended.output
    invoke("compare", "hold", "pendulum", "--quick", exit_code=BAD_INPUT)


@pytest.mark.parametrize(
    "wrong", [{"form": "soft_norm", "exponent": -1.0}, {}, {"exponent": -1.0, "last": 1.0}]
)
def test_a_law_has_a_form_or_an_exponent_and_no_key_that_nobody_reads(wrong):
    with pytest.raises(ValueError, match="Law"):
        Law.model_validate(
            {"subject": "mujoco, contact", "over": "impratio", "source": "manual", **wrong}
        )
