"""FMUs: the slider-bar by model exchange and co-simulation against its truth, names and units, what is refused, what fails."""

from __future__ import annotations

import os
import shutil
import sys
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from fmu_archives import OUTPUTS, library, slider_bar
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.comparisons.bench.campaign import load_campaign
from stiction.engines import EngineFailure, EngineMissing, Job, Refused, load_engine, run_isolated
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth

pytest.importorskip("fmpy", reason="the extra fmi is not installed")
pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None, reason="no C compiler cc, which makes the FMUs"
)
CASES = [f"slider-bar-case-{i}" for i in (1, 2, 3)]
SCRIPT = Path(__file__).parent / "fmu" / "slider_bar.py"
BALL = {
    "t_end": 0.4,
    "gravity": [0, "g"],
    "parameters": {"g": -5},
    "bodies": {"ball": {"mass": 1, "inertia": 1, "position": [0, 1]}},
}


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    return partial(library, tmp_path_factory.mktemp("libraries"))


@pytest.fixture
def exchange(tmp_path, libraries):
    """Make an engine of FMI 2, model exchange, with a map."""

    def make(chosen="", failure=0, **options):
        file = slider_bar(tmp_path / "exchange.fmu", libraries(failure=failure), **options)
        (tmp_path / "exchange.map.toml").write_text(chosen)
        return load_engine(str(file))

    return make


@pytest.fixture
def steps(tmp_path, libraries):
    """Make an engine of FMI 3, co-simulation."""

    def make(failure=0, **options):
        return load_engine(
            str(
                slider_bar(
                    tmp_path / "steps.fmu", libraries(steps=True, failure=failure), fmi=3, **options
                )
            )
        )

    return make


@pytest.fixture
def scripted(tmp_path):
    """Make an engine of the script, FMI 2, co-simulation, with a text in it replaced."""
    builder = pytest.importorskip("pythonfmu.builder", reason="pythonfmu is not installed")

    def make(old="", new=""):
        text = SCRIPT.read_text()
        assert old in text
        name = f"script_{abs(hash(new))}"
        script = tmp_path / f"{name}.py"
        script.write_text(text.replace(old, new) if old else text)
        try:
            builder.FmuBuilder.build_FMU(script, tmp_path / "scripted.fmu")
        finally:
            sys.path.remove(str(tmp_path))
        return load_engine(str(tmp_path / "scripted.fmu"))

    return make


def error(run, scene):
    return np.abs(
        run["slider.x"] - slider_bar_truth(scene, float(run.t[-1]))(run.t)["slider.x"]
    ).max()


@pytest.mark.parametrize("case", CASES)
def test_model_exchange_comes_to_the_truth_and_its_events(exchange, case):
    scene = load_scene(case)
    engine = exchange("[capabilities]\nlocates_events = true")
    run, coarse = (
        engine.simulate(scene, t_end=8, rtol=1e-9),
        engine.simulate(scene, t_end=8, rtol=1e-5),
    )
    truth = [event for event in slider_bar_truth(scene, 8).events if event.kind != "corner"]
    assert error(run, scene) < 1e-6 < error(coarse, scene) < 1e-2
    assert [event.kind for event in run.events] == [event.kind for event in truth] and len(
        truth
    ) > 2
    for found, true in zip(run.events, truth):
        assert found.time == pytest.approx(true.time, abs=1e-6)
        assert found.jump("slider.ax") == pytest.approx(true.jump("slider.ax"), abs=1e-5)
    assert run.settings["events_located_by"] == "engine"


@pytest.mark.parametrize("case", CASES)
def test_co_simulation_steps_by_dt(steps, case):
    """Its error goes with dt, of first order across events; outputs are where they were asked for."""
    scene, engine = load_scene(case), steps()
    coarse, fine = (engine.simulate(scene, t_end=8, dt=dt) for dt in (1e-2, 1e-3))
    assert 4 * error(fine, scene) < error(coarse, scene) < 0.1
    np.testing.assert_allclose(fine.t, np.linspace(0, 8, 801), atol=1e-12)
    assert fine.cost.counters["steps"] == 8000 and fine.settings["dt"] == 1e-3


def test_tolerance_reaches_the_solver_of_a_co_simulation(steps):
    """This one then takes steps of 100 rtol seconds within those of dt."""
    scene, engine = load_scene(CASES[0]), steps()
    fine, within = (
        engine.simulate(scene, t_end=1, dt=1e-3),
        engine.simulate(scene, t_end=1, dt=1e-2, rtol=1e-5),
    )
    np.testing.assert_allclose(within["slider.x"], fine["slider.x"], atol=1e-12)
    assert (
        within.settings["rtol"] == 1e-5
        and np.abs(engine.simulate(scene, t_end=1, dt=1e-2)["slider.x"] - fine["slider.x"]).max()
        > 1e-6
    )


def test_script_steps_as_the_c_source(steps, scripted):
    """Of another author, of another version of FMI: the same scheme."""
    scene = load_scene(CASES[1])
    one, other = (engine.simulate(scene, t_end=4, dt=1e-3) for engine in (steps(), scripted()))
    for column in ("slider.x", "slider.vx", "guide.friction", "motor.effort"):
        np.testing.assert_allclose(other[column], one[column], atol=1e-8)


def test_without_cvode_euler_steps_by_dt(exchange, monkeypatch):
    monkeypatch.setattr("stiction.engines.fmu.engine.has_cvode", lambda: False)
    scene, engine = load_scene(CASES[0]), exchange("[capabilities]\nlocates_events = true")
    coarse, fine = (
        engine.simulate(scene, t_end=1, dt=1e-3),
        engine.simulate(scene, t_end=1, dt=1e-4),
    )
    assert 5 < error(coarse, scene) / error(fine, scene) < 20 and len(fine.t) == 101
    with pytest.raises(InputError, match="rtol"):
        engine.simulate(scene, rtol=1e-6)


def test_map_gives_names_signs_numbers_and_units(exchange):
    scene = load_scene(CASES[0])
    plain = exchange().simulate(scene, t_end=2, rtol=1e-8)
    chosen = (
        '[columns]\nslider.x = "s"\nslider.y = 0\n"bar.angle" = "degrees"\n{}\n[parameters]\nmu = "friction.mu"\n'
        '"joints.guide.mus" = "friction.mus"'
    )
    others = {
        "slider.x": "s",
        "bar.angle": "radians",
        "slider.y": "other",
        "mu": "friction.mu",
        "mus": "friction.mus",
    }
    with pytest.raises(EngineFailure, match="bar.x = -"):  # the sign is wrong, and the start tells
        exchange(
            chosen.format('bar.x = "-minus.x"'), names={**others, "bar.x": "minus.x"}
        ).simulate(scene, t_end=2, rtol=1e-8)
    run = exchange(chosen.format(""), names=others).simulate(scene, t_end=2, rtol=1e-8)
    for column in ("slider.x", "bar.angle", "slider.y", "guide.friction"):
        np.testing.assert_allclose(run[column], plain[column], atol=1e-12)


def test_parameters_of_the_scene_are_set(exchange):
    """By their names, or by those of numbers in the scene; also where the scene is varied."""
    stronger = vary(load_scene(CASES[0]), {"parameters.F0": 4.5, "parameters.mu": 0.02})
    engine = exchange(names={"mu": "joints.guide.mu", "m2": "bodies.slider.mass"})
    run = engine.simulate(stronger, t_end=4, rtol=1e-9)
    assert (
        error(run, stronger) < 1e-6
        and "F0=4.5" in run.settings["parameters"]
        and "joints.guide.mu=0.02" in run.settings["parameters"]
    )


def test_another_number_that_cannot_be_set_is_refused(exchange):
    scene, engine = load_scene(CASES[0]), exchange(constants={"m2": 1.0, "F0": 3.5})
    with pytest.raises(Refused, match="F0 = 3 .* 3.5"):
        engine.simulate(scene)
    assert engine.refusal(vary(scene, {"parameters.F0": 3.5}), "joint") is None


@pytest.mark.parametrize(
    "chosen, options, scene, words",
    [
        ("", {}, "pendulum", "slider-bar-.*pendulum"),
        ('scene = "pendulum four-*"', {}, CASES[0], "pendulum or four-"),
        ("", {"left_out": ("bar.vy",)}, CASES[0], "bar.vy"),
        ("[columns]\nslidr.x = 0", {}, CASES[0], "slidr.x.*slider.x"),
        ("[capabilities]\nstatic_coefficient = false", {}, CASES[0], "static coefficient"),
        ('[capabilities]\nfriction_law = ""', {}, CASES[0], "friction law"),
        (
            "[capabilities]\nlocates_events = true",
            {"left_out": ("guide.mode",)},
            CASES[0],
            "guide.mode",
        ),
    ],
)
def test_scenes_that_are_refused(exchange, chosen, options, scene, words):
    with pytest.raises(Refused, match=words):
        exchange(chosen, **options).simulate(load_scene(scene))
    engine = exchange(scene="")  # runs what it has columns for
    assert engine.refusal(load_scene(CASES[2]), "joint") is None and "x, " in engine.refusal(
        load_scene("pendulum"), "joint"
    )


@pytest.mark.parametrize(
    ("chosen", "expected"),
    [
        ("", "engine"),
        ('[capabilities]\nfriction_supplied_by = "engine + adapter"', "engine + adapter"),
    ],
)
def test_the_map_says_who_supplies_the_friction(exchange, chosen, expected):
    run = exchange(chosen).simulate(load_scene(CASES[0]), t_end=0.1, rtol=1e-6)
    assert run.settings["friction_supplied_by"] == expected


def test_accelerations_that_are_not_there_are_differences(exchange):
    scene = load_scene(CASES[0])
    run = exchange(
        left_out=[name for name in OUTPUTS if name.endswith((".ax", ".ay", ".alpha"))]
    ).simulate(scene, t_end=2, rtol=1e-8, output_step=1e-3)
    between = np.abs(run["slider.ax"] - slider_bar_truth(scene, 2)(run.t)["slider.ax"])
    assert "differences" in run.settings["accelerations"] and np.median(between) < 1e-5


@pytest.mark.parametrize(
    "chosen, words",
    [
        ("interfaces = 1", "interfaces.*interface"),
        ('interface = "co-simulation"', "model exchange"),
        ('[columns]\nslider.x = "slider.xx"', "slider.xx.*slider.x"),
        ('[columns]\nslider.x = ""', "slider.x"),
        ('[parameters]\nmu = "stiction.scene"', "parameters.mu"),
        ("[capabilities]\nfidelity = 1", "fidelity"),
        ('[capabilities]\nfriction_supplied_by = "nobody"', "friction_supplied_by.*'adapter'"),
        ("[columns", "TOML"),
    ],
)
def test_maps_that_cannot_be_used(exchange, chosen, words):
    with pytest.raises(InputError, match=f"(?s){words}"):
        exchange(chosen)


def test_files_that_are_no_fmu(tmp_path, exchange, scripted):
    for name, entry, words in (
        ("text", None, "archive"),
        ("empty", ("readme.txt", ""), "modelDescription.xml"),
        ("xml", ("modelDescription.xml", "<a"), "description"),
        ("old", ("modelDescription.xml", '<fmiModelDescription fmiVersion="0.9"/>'), "FMI"),
        ("none", "", "no file"),
    ):
        file = tmp_path / f"{name}.fmu"
        if entry is None:
            file.write_text("garbage")
        elif entry:
            with zipfile.ZipFile(file, "w") as archive:
                archive.writestr(*entry)
        with pytest.raises(InputError, match=words):
            load_engine(str(file))
    exchange()
    shutil.copy(tmp_path / "exchange.fmu", tmp_path / "pymunk.fmu")
    with pytest.raises(InputError, match="another name"):
        load_engine(str(tmp_path / "pymunk.fmu"))
    (tmp_path / "scripted.map.toml").write_text("[capabilities]\nlocates_events = true")
    with pytest.raises(InputError, match="locates_events"):
        scripted()


def test_an_installation_or_an_fmu_that_lacks_something_is_missing(exchange, monkeypatch):
    with pytest.raises(EngineMissing, match="win64"):
        exchange(platform="win64")
    file = exchange().file
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(EngineMissing, match="pip install 'fmpy"):
        load_engine(str(file))


def test_whatever_happens_inside_is_a_row(tmp_path, libraries):
    """Exit, crash, error with a message, a step not taken, a machine's binary that is not there; none ends the others."""
    scene, jobs = load_scene(CASES[0]), []
    for fmi in (2, 3):
        for failure in (0, 1, 2, 3, 4):
            file = slider_bar(
                tmp_path / f"fmi{fmi}-{failure}.fmu",
                libraries(steps=fmi == 3, failure=failure),
                fmi=fmi,
            )
            jobs.append(Job(file.stem, str(file), scene, {"t_end": 1.0}))
    other = slider_bar(tmp_path / "other.fmu", libraries(), platform="win64")
    found = {
        outcome.label: outcome
        for outcome in run_isolated(
            [*jobs, Job("other", str(other), scene)], workers=1, timeout_s=600
        )
    }
    for fmi in (2, 3):
        right, ended, crashed, wrong, discarded = (
            found[f"fmi{fmi}-{failure}"] for failure in range(5)
        )
        assert right.status == "ok" and right.value.t[-1] == pytest.approx(1.0)
        assert ended.status == "crashed" and "exit code 3" in ended.reason
        assert crashed.status == "crashed" and "SIGABRT" in crashed.reason
        assert wrong.status == "failed" and "has come off" in wrong.reason and not wrong.bug
        assert discarded.status == "failed" and "discard" in discarded.reason
    assert found["other"].status == "missing" and "win64" in found["other"].reason


def test_an_fmu_may_end_its_run(exchange, steps):
    scene = load_scene(CASES[0])
    for run in (
        steps(failure=5).simulate(scene, dt=1e-3),
        exchange(failure=5).simulate(scene, rtol=1e-6),
    ):
        assert 0.5 <= run.t[-1] < 10 and "ended the run" in run.termination


def test_a_script_that_fails_says_why(scripted):
    engine, scene = (
        scripted("h, v = step_size, self.v", 'raise RuntimeError("the slider is gone")'),
        load_scene(CASES[0]),
    )
    with pytest.raises(EngineFailure, match="fmi2DoStep.*logging=true"):
        engine.simulate(scene, t_end=1, dt=1e-2)
    with pytest.raises(EngineFailure, match="fmi2DoStep.*the slider is gone"):
        engine.simulate(scene, t_end=1, dt=1e-2, logging=True)
    with pytest.raises(InputError, match="logging"):
        engine.simulate(scene, logging=3)


def test_nothing_of_one_that_hangs_is_left(scripted, tmp_path):
    mark = tmp_path / "where"
    text = f'import time; open({str(mark)!r}, "w").write(__file__); time.sleep(600); h, v = step_size, self.v'
    job = Job("hangs", str(scripted("h, v = step_size, self.v", text).file), load_scene(CASES[0]))
    for limit in (2, 8, 32, 128):  # until it has begun within it, however busy the machine
        [hung] = run_isolated([job], timeout_s=limit)
        assert hung.status == "timed out"
        if mark.exists():
            break
    assert not Path(mark.read_text()).exists()


def test_a_unit_without_a_definition_is_named(scripted):
    engine = scripted()
    next(
        one for one in engine.variables.description.modelVariables if one.name == "bar.x"
    ).unit = "furlong"
    run = engine.simulate(load_scene(CASES[0]), t_end=0.1, dt=1e-2)
    assert "furlong" in [value for key, value in run.settings.items() if "definition" in key]


def test_a_step_that_is_not_taken(scripted, monkeypatch):
    """An FMU that discards a step ends its run, or says that it goes on and stays where it is."""
    engine, scene = (
        scripted(
            "        self.out = self.columns()\n        return True",
            "        self.out = self.columns()\n        return self.t < 0.5",
        ),
        load_scene(CASES[0]),
    )
    run = engine.simulate(scene, t_end=1, dt=1e-2)
    assert "ended the run" in run.termination and run.t[-1] == pytest.approx(0.5, abs=0.02)
    monkeypatch.setattr("fmpy.fmi2.FMU2Slave.getBooleanStatus", lambda *_: False)
    with pytest.raises(EngineFailure, match="discards the step"):
        engine.simulate(scene, t_end=1, dt=1e-2)


def test_commands_take_its_path(tmp_path, steps, monkeypatch):
    steps()
    monkeypatch.chdir(tmp_path)
    ended = CliRunner().invoke(
        app, ["run", CASES[0], "--engine", "steps.fmu", "--dt", "1e-2", "--out", "run.csv"]
    )
    assert ended.exit_code == 0 and (tmp_path / "run.csv").exists()
    (tmp_path / "night.toml").write_text(
        f'scenes = ["{CASES[0]}"]\nmeasure = ["accuracy"]\n[variants.mine]\nengine = "steps.fmu"\ndt = [1e-2]\n'
    )
    [variant] = load_campaign("night.toml").variants
    assert Path(variant.engine) == tmp_path / "steps.fmu"
    assert CliRunner().invoke(app, ["run", CASES[0], "--engine", "none.fmu"]).exit_code == 2


@pytest.mark.skipif(
    not os.environ.get("REFERENCE_FMUS"),
    reason="REFERENCE_FMUS names no folder of Modelica's Reference FMUs (folders 2.0, 3.0)",
)
@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("interface", ["co-simulation", "model exchange"])
def test_reference_bouncing_ball_falls(tmp_path, version, interface):
    """BouncingBall before its first bounce; its co-simulation steps by Euler with 1 ms."""
    file = shutil.copy(Path(os.environ["REFERENCE_FMUS"]) / version / "BouncingBall.fmu", tmp_path)
    (tmp_path / "BouncingBall.map.toml").write_text(
        f'interface = "{interface}"\n[columns]\nball.x = 0\nball.y = "h"\nball.angle = 0\nball.vx = 0\n'
        'ball.vy = "v"\nball.omega = 0\nball.ax = 0\nball.ay = "der(v)"\nball.alpha = 0\n'
    )
    run = load_engine(str(file)).simulate(scene_from_dict(BALL))
    np.testing.assert_allclose(
        run["ball.y"], 1 - 2.5 * run.t**2, atol=2e-3 if interface == "co-simulation" else 1e-6
    )
