"""A program as an engine: what it is given, what becomes of its result, and what becomes of its failures."""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import tomli_w

from stiction.comparisons.bench.campaign import CampaignError, load_campaign
from stiction.comparisons.bench.identity import circumstances
from stiction.comparisons.bench.participants import variants
from stiction.comparisons.bench.timing.visits import seconds_of
from stiction.comparisons.bench.variants import Record
from stiction.engines import (
    BadTrajectory,
    EngineFailure,
    EngineMissing,
    Job,
    Outcome,
    Refused,
    UnknownEngine,
    load_engine,
    run_isolated,
)
from stiction.engines.fmu.variables import Map
from stiction.engines.program.declaration import Declaration
from stiction.engines.protocol import EVENTS_LOCATED_BY, FRICTION_SUPPLIED_BY, Supplier
from stiction.engines.shared.declared_engine import DIFFERENCES
from stiction.scenes import FileError, InputError, load_scene, scene_from_dict, vary
from stiction.scenes.digest import digest

BALL = scene_from_dict(
    {
        "t_end": 1,
        "gravity": [0, -10],
        "bodies": {"ball": {"mass": 2, "inertia": 1, "velocity": [3, 4], "angular_velocity": 5}},
    },
    name="ball",
)
BALL_AT_REST = vary(BALL, {"gravity": [0, 0], "ball.velocity": [0, 0], "ball.angular_velocity": 0})
# free flight, exactly; what a test adds comes before or behind it
FLIGHT = """
import json, math, os, sys, time
scene_file, result_file, dt, output_step, *others = sys.argv[1:]
scene = json.load(open(scene_file))["scene"]
body, (gx, gy), n = scene["bodies"]["ball"], scene["gravity"], round(scene["t_end"] / float(output_step))
rows = [[t, vx * t + gx * t * t / 2, vy * t + gy * t * t / 2, w * t, vx + gx * t, vy + gy * t, w, gx, gy, 0]
        for t in (scene["t_end"] * k / n for k in range(n + 1)) for (vx, vy), w in [(body["velocity"], body["angular_velocity"])]]
names = ["t", *("ball." + name for name in "x y angle vx vy omega ax ay alpha".split())]
def write(rows, names=names):
    with open(result_file, "w") as file:
        for row in [names, *rows]: print(*row, sep=",", file=file)
"""
GOOD = "write(rows)"
FLOWN = [sys.executable, "flight.py", "{scene}", "{result}", "{dt}", "{output_step}"]


@pytest.fixture
def program(tmp_path):
    """A declared program of Python's text; returns the path of its declaration."""

    def make(text=GOOD, name="flight", **changes):
        (tmp_path / f"{name}.py").write_text(FLIGHT + text)
        (tmp_path / f"{name}_version.py").write_text("print('flight 1.0')")
        declared = {
            "name": name,
            "version": [sys.executable, f"{name}_version.py"],
            "command": [
                sys.executable,
                f"{name}.py",
                "{scene}",
                "{result}",
                "{dt}",
                "{output_step}",
            ],
            **changes,
        }
        path = tmp_path / f"{name}.toml"
        path.write_text(tomli_w.dumps(declared))
        return str(path)

    return make


def simulate(engine, scene=BALL, **arguments):
    return load_engine(engine).simulate(scene, **{"output_step": 0.1, **arguments})


class TestResult:
    def test_motion_and_everything_else_that_a_trajectory_has(self, program):
        found = simulate(program(), dt=0.01)
        t = np.linspace(0, 1, 11)
        assert (found.engine, found.version, found.scene) == ("flight", "flight 1.0", "ball")
        np.testing.assert_allclose(found["ball.y"], 4 * t - 5 * t**2, atol=1e-14)
        assert found.settings["dt"] == 0.01 and "accelerations" not in found.settings
        assert found.cost.stepping_s > 0.001  # of the program, which Python alone takes to start
        text = "import pandas as pd\npd.DataFrame(rows, columns=names).to_parquet(result_file)"
        np.testing.assert_array_equal(
            simulate(program(text, result="parquet"))["ball.x"], found["ball.x"]
        )

    def test_a_link_to_a_declaration_with_another_extension(self, program):
        """The name selects the kind of engine, here and in child processes, and not the file behind a link."""
        declaration = Path(program()).rename(Path(program()).with_suffix(".declaration"))
        link = declaration.with_name("linked.toml")
        link.symlink_to(declaration)
        here = simulate(str(link), dt=0.01)
        job = Job("linked", str(link), BALL, {"dt": 0.01, "output_step": 0.1})
        [outcome] = run_isolated([job], timeout_s=60)
        assert outcome.status == "ok", outcome.reason
        np.testing.assert_array_equal(outcome.value["ball.y"], here["ball.y"])

    def test_accelerations_left_out_are_differences_and_the_run_says_so(self, program):
        found = simulate(program("write([row[:7] for row in rows], names[:7])"))
        np.testing.assert_allclose(found["ball.ay"], -10, rtol=1e-12)
        assert found.settings["accelerations"] == DIFFERENCES

    def test_reactions_are_recovered_where_not_given(self, program):
        """A block held by a guide without friction: its normal force is its weight, whatever the program says of it."""
        scene = vary(
            BALL,
            {
                "bodies.ball.velocity": [3, 0],
                "bodies.ball.angular_velocity": 0,
                "joints": {"guide": {"type": "translational", "slider": "ball"}},
            },
        )
        held = "rows = [[row[0], row[1], 0, 0, row[4], 0, 0, 0, 0, 0] for row in rows]\n"
        np.testing.assert_allclose(simulate(program(held + GOOD), scene)["guide.normal_force"], 20)
        given = held + "write([[*row, 20.5] for row in rows], [*names, 'guide.normal_force'])"
        np.testing.assert_allclose(simulate(program(given), scene)["guide.normal_force"], 20.5)

    def test_counters_setup_and_reason_of_an_early_end(self, program):
        text = "write(rows[:6])\njson.dump({'counters': {'steps': 7}, 'setup_s': 1e-4, 'termination': 'no solution'}, open(others[0], 'w'))"
        found = simulate(program(text, command=[*FLOWN, "{events}"]))
        assert found.termination == "no solution" and found.t[-1] == 0.5
        assert found.cost.counters == {"steps": 7} and found.cost.setup_s == 1e-4

    def test_cpu_time_of_a_program_counts(self, program):
        engine = load_engine(
            program(
                "until = time.process_time() + 0.3\nwhile time.process_time() < until: pass\n"
                + GOOD
            )
        )
        found, seconds = seconds_of(lambda: engine.simulate(BALL, output_step=0.1))
        assert 0.3 <= found.cost.own_s == found.cost.stepping_s <= seconds

    @pytest.mark.parametrize("part", [0.01, 1e9])
    def test_a_program_may_say_which_part_is_its_solver_s(self, part, program):
        """At most all of it; the whole counts besides."""
        text = f"{GOOD}\njson.dump({{'engine_s': {part}}}, open(others[0], 'w'))"
        cost = simulate(program(text, command=[*FLOWN, "{events}"])).cost
        assert cost.own_s == min(part, cost.stepping_s) and cost.stepping_s > 0.01

    def test_settings_environment_and_folder(self, program, tmp_path):
        (tmp_path / "place").mkdir()
        path = program(
            "open(others[0], 'w').write(json.dumps([others[1:], os.environ['MINE'], os.getcwd()]))\n"
            + GOOD,
            folder="place",
            version=[sys.executable, "../flight_version.py"],
            settings={"level": 3, "way": "a b"},
            environment={"MINE": "x;y"},
            command=[
                sys.executable,
                "../flight.py",
                "{scene}",
                "{result}",
                "{dt}",
                "{output_step}",
                "seen.json",
                "{settings}",
            ],
        )
        simulate(path, level=4)
        assert json.loads((tmp_path / "place/seen.json").read_text()) == [
            ["level=4", "way=a b"],
            "x;y",
            str(tmp_path / "place"),
        ]
        with pytest.raises(InputError, match="levle"):
            simulate(path, levle=4)

    def test_tolerance_instead_of_a_step(self, program):
        path = program(
            "assert dt == '1e-09'\n" + GOOD,
            capabilities={"adaptive": True},
            command=[sys.executable, "flight.py", "{scene}", "{result}", "{rtol}", "{output_step}"],
        )
        assert simulate(path, rtol=1e-9).settings["rtol"] == 1e-9
        with pytest.raises(InputError, match="dt"):
            simulate(path, dt=1e-3)

    def test_no_value_of_a_scene_is_read_by_a_shell(self, program, tmp_path):
        scene = scene_from_dict(
            {**BALL._raw, "title": "$(touch pwned); touch pwned"}, name="`touch pwned`; touch pwned"
        )
        assert simulate(program(), scene).scene == scene.name
        assert not list(tmp_path.rglob("pwned")) and not Path("pwned").exists()


BLOCK = scene_from_dict(
    {
        "t_end": 1,
        "gravity": [0, -10],
        "bodies": {"ball": {"mass": 1, "inertia": 1, "velocity": [1, 0]}},
        "joints": {"guide": {"type": "translational", "slider": "ball", "mu": 0.2}},
    },
    name="block",
)
STOPS = """
rows = [[t, t - t * t, 0, 0, 1 - 2 * t, 0, 0, -2, 0, 0, 1] for t in (0, 0.1, 0.2, 0.3, 0.4, 0.5)]
rows += [[t, 0.25, 0, 0, 0, 0, 0, 0, 0, 0, 0] for t in (0.5, 0.6, 0.7, 0.8, 0.9, 1)]
write(rows, [*names, "guide.mode"])
json.dump({"events": [{"time": WHEN, "kind": "stick", "joint": "guide"}]}, open(others[0], "w"))
"""


class TestEvents:
    @pytest.fixture
    def stopping(self, program):
        return lambda when: program(
            STOPS.replace("WHEN", when),
            command=[*FLOWN, "{events}"],
            capabilities={"locates_events": True, "friction_law": "Coulomb"},
        )

    def test_both_rows_of_its_time_are_its_sides(self, stopping):
        found = simulate(stopping("0.5"), BLOCK)
        [event] = found.events
        assert (event.time, event.kind, event.jump("ball.ax"), event.jump("guide.mode")) == (
            0.5,
            "stick",
            2,
            -1,
        )
        assert event.jump("guide.friction") == pytest.approx(2) and len(found.t) == 11

    @pytest.mark.parametrize("when", ["0.45", "0.4", "7", '"soon"', "None"])
    def test_one_without_rows_is_a_failure(self, stopping, when):
        with pytest.raises(BadTrajectory, match="events|two rows"):
            simulate(stopping(when), BLOCK)


FRICTION = {"friction_law": "Coulomb", "static_coefficient": True}


class TestWhoSuppliesTheFriction:
    """The declaration says it, the engine itself where it does not."""

    @pytest.mark.parametrize(
        ("said", "expected"),
        [
            ({}, "engine"),
            *(({FRICTION_SUPPLIED_BY: by}, by) for by in ("engine", "adapter", "engine + adapter")),
        ],
    )
    def test_the_run_has_what_is_declared(self, program, said, expected):
        """A block at rest on a guide without load: its table is that of no motion."""
        rest = "write([[t, *[0.0] * 9] for t, *_ in rows])"
        scene = vary(
            BALL,
            {
                "gravity": [0, 0],
                "ball.velocity": [0, 0],
                "ball.angular_velocity": 0,
                "joints": {"guide": {"type": "translational", "slider": "ball", "mu": 0.5}},
            },
        )
        path = program(rest, capabilities={**FRICTION, **said})
        assert simulate(path, scene).settings[FRICTION_SUPPLIED_BY] == expected
        assert simulate(path, BALL_AT_REST).settings[FRICTION_SUPPLIED_BY] == "nobody"
        engine = load_engine(path)
        assert engine.friction_supplier("joint", {}) == expected
        assert engine.capabilities.friction_by == {"joint": expected}

    @pytest.mark.parametrize("said", ["suite", "nobody", "", 1])
    def test_anything_else_is_an_error_of_the_file(self, program, said):
        path = program(capabilities={**FRICTION, FRICTION_SUPPLIED_BY: said})
        with pytest.raises(FileError, match=rf"capabilities.{FRICTION_SUPPLIED_BY}") as error:
            load_engine(path)
        assert repr(said).strip("'") in str(error.value) and "adapter" in str(error.value)

    @pytest.mark.parametrize("name", [FRICTION_SUPPLIED_BY, EVENTS_LOCATED_BY])
    def test_it_is_no_setting_of_a_program(self, program, name):
        with pytest.raises(FileError, match="another name"):
            load_engine(program(command=[*FLOWN, "{settings}"], settings={name: "adapter"}))

    @pytest.mark.parametrize("model", [Declaration, Map])
    def test_the_schema_of_the_file_has_the_suppliers(self, model):
        schema = model.model_json_schema()
        assert schema["$defs"]["Supplier"]["enum"] == [str(one) for one in Supplier]


def test_refusals_by_exit_code_and_by_what_is_declared(program):
    with pytest.raises(Refused, match="no such joint"):
        simulate(program("print('no such joint', file=sys.stderr); sys.exit(77)"))
    for can, words in (({}, "friction law"), ({"friction_law": "Coulomb"}, "mus")):
        with pytest.raises(Refused, match=words):
            simulate(program(capabilities=can), load_scene("slider-bar-case-1"))


FAILURES = {
    "crash": (
        "print('first'); print('bad pivot in step 3', file=sys.stderr); sys.exit(5)",
        "exit code 5.*bad pivot in step 3",
    ),
    "exception": ("raise RuntimeError('boom')", "exit code 1.*RuntimeError: boom"),
    "killed": ("import signal; os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
    "silent": ("sys.exit(3)", "exit code 3: nothing was printed"),
    "no-result": ("", "no file"),
    "empty": ("open(result_file, 'w')", "cannot be used"),
    "half-a-file": (
        "write(rows)\ntext = open(result_file).read()\nopen(result_file, 'w').write(text[:len(text) // 2].rpartition(',')[0])",
        "cannot be used",
    ),
    "half-of-the-time": ("write(rows[:6])", "up to 0.5 s and no reason"),
    "garbage": ("open(result_file, 'wb').write(os.urandom(10000))", "cannot be used"),
    "nan": ("rows[3][2] = math.nan\nwrite(rows)", "ball.y, row 4"),
    "no-velocities": ("write([row[:4] for row in rows], names[:4])", "no column ball.vx"),
    "other-units": ("write([[row[0] * 1000, *row[1:]] for row in rows])", "time"),
    "wrong-start": (
        "write([[row[0], row[1] + 1, *row[2:]] for row in rows])",
        "start that is not the scene's",
    ),
    "gigabytes": (
        "file = open(result_file, 'w')\nwhile True: file.write('0' * 100000)",
        "result.csv: reached the limit of 1 MiB",
    ),
    "talkative": (
        "while True: sys.stderr.write('no' * 50000); sys.stdout.write('yes' * 50000)",
        "printed.txt: reached the limit of 1 MiB",
    ),
}


HANGS = """
import subprocess
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
with open(os.path.join(os.path.dirname(sys.argv[0]), "pids"), "w") as file:
    file.write(f"{os.getpid()} {child.pid} {os.path.dirname(result_file)}")
time.sleep(600)
"""


class TestFailures:
    def test_each_is_a_row_and_nothing_is_lost(self, program, tmp_path):
        """One campaign of them all, a good one and one that is not there."""
        names = {
            name: program(text, name=name, largest_file=1) for name, (text, _) in FAILURES.items()
        } | {"good": program(name="good")}
        absent = program(name="absent", command=["./absent", "{scene}", "{result}", "{dt}"])
        jobs = [
            Job(name, path, BALL, {"output_step": 0.1})
            for name, path in [*names.items(), ("absent", absent)]
        ]
        outcomes = {
            outcome.label: outcome for outcome in run_isolated(jobs, workers=2, timeout_s=600)
        }
        assert list(outcomes) == [job.label for job in jobs]
        assert (
            outcomes["good"].status == "ok"
            and outcomes["absent"].status == "missing"
            and "absent" in outcomes["absent"].reason
        )
        for name, (_, words) in FAILURES.items():
            outcome = outcomes[name]
            assert outcome.status == "failed" and not outcome.bug, (name, outcome)
            with pytest.raises(EngineFailure, match=words):
                raise EngineFailure(outcome.reason)

    def test_what_hangs_is_gone_with_its_child_process_and_its_files(self, program, tmp_path):
        path, pids = program(HANGS, name="hang"), tmp_path / "pids"
        for limit in (2, 8, 32, 128):  # until it has begun within it, however busy the machine
            [outcome] = run_isolated(
                [Job("hang", path, BALL, {"output_step": 0.1})], timeout_s=limit
            )
            assert (outcome.status, outcome.reason) == ("timed out", f"no result within {limit} s")
            if pids.exists():
                break
        *pids, scratch = pids.read_text().split()
        assert_soon(lambda: not any(map(runs, pids)) and not os.path.exists(scratch))

    def test_what_a_program_leaves_running_ends_with_it(self, program, tmp_path):
        simulate(program(HANGS.replace("time.sleep(600)\n", GOOD)))
        pids = (tmp_path / "pids").read_text().split()[:2]
        assert_soon(
            lambda: not any(map(runs, pids))
        )  # a killed process ends when the system finds the time

    @pytest.mark.parametrize(
        "text",
        [
            "write(rows, ['zeit', *names[1:]])",
            "write(rows, [*names[:4], 'ball.vxx', *names[5:]])",
            "write([row[:1] for row in rows], ['t'])",
        ],
    )
    def test_a_wrong_table_does_not_suggest_an_option_that_a_run_lacks(self, program, text):
        """`stiction judge` has --map; a program that `stiction run` starts has to write the right names."""
        with pytest.raises(EngineFailure, match="expected") as error:
            simulate(program(text))
        assert "--map" not in str(error.value)

    @pytest.mark.parametrize(
        "program_of", ["not-there", "./not-there", "{folder}", "{text}", "{{scene}}"]
    )
    @pytest.mark.parametrize("key", ["command", "version"])
    def test_missing_program(self, program, tmp_path, program_of, key):
        (tmp_path / "text").write_text("not executable")
        word = program_of.format(folder=tmp_path, text=tmp_path / "text")
        with pytest.raises(EngineMissing, match="found no program"):
            load_engine(program(**{key: [word, "{scene}", "{result}", "{dt}"]}))

    @pytest.mark.parametrize("text", ["import sys; sys.exit(3)", "", "import os; os.abort()"])
    def test_no_version(self, program, tmp_path, text):
        path = program()
        (tmp_path / "flight_version.py").write_text(text)
        with pytest.raises(EngineMissing, match="version command fails"):
            load_engine(path)

    def test_a_version_that_does_not_come_is_waited_for_once(self, program, tmp_path, monkeypatch):
        monkeypatch.setattr("stiction.engines.program.engine.VERSION_S", 1.0)
        path = program()
        (tmp_path / "flight_version.py").write_text(
            "open('asked', 'a').write('x')\nimport time\ntime.sleep(600)"
        )
        for _ in range(3):
            with pytest.raises(EngineMissing, match="no end within 1 s"):
                load_engine(path)
        assert (tmp_path / "asked").read_text() == "x"


def runs(pid):
    try:
        return psutil.Process(int(pid)).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def assert_soon(condition, seconds=20):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "the program outlives its child process"
        time.sleep(0.05)


class TestDeclaration:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                {"command": ["python3", "{scene}", "{result}", "{dt}", "{outputstep}"]},
                "outputstep.*did you mean 'output_step'",
            ),
            ({"command": ["python3", "{scene}", "{dt}"]}, "{result}"),
            ({"command": ["python3", "{scene}", "{result}"]}, "{dt}"),
            ({"command": ["python3", "{scene}", "{result}", "{dt}", "{rtol}"]}, "{rtol}"),
            (
                {"command": ["python3", "{scene}", "{result}", "{dt}", "--{settings}"]},
                "argument of its own",
            ),
            ({"command": "python3 {scene} {result} {dt}"}, "command"),
            ({"command": []}, "command"),
            ({"settings": {"a": 1}}, "{settings}"),
            ({"settings": {"a": [1]}}, "settings"),
            ({"capabilities": {"locates_events": True}}, "{events}"),
            ({"capabilities": {"adaptive": "no"}}, "capabilities.adaptive"),
            ({"capabilities": {"fidelty": "joint"}}, "did you mean 'fidelity'"),
            ({"capabilities": {"fidelity": "beam"}}, "capabilities.fidelity"),
            ({"enviroment": {}}, "did you mean 'environment'"),
            ({"name": "two words"}, "name"),
            ({"name": "pymunk"}, "another name"),
            ({"result": "xlsx"}, "result"),
            ({"largest_file": 0}, "largest_file"),
        ],
        ids=range(18),
    )
    def test_what_is_wrong_is_named(self, program, change, words):
        with pytest.raises(InputError, match=words):
            load_engine(program(**change))

    def test_other_files_are_refused(self, tmp_path):
        (tmp_path / "x.toml").write_text("name = ")
        with pytest.raises(FileError, match="file"):
            load_engine(str(tmp_path / "x.toml"))
        with pytest.raises(UnknownEngine, match="no file"):
            load_engine(str(tmp_path / "y.toml"))


class TestIdentity:
    @pytest.mark.parametrize("change", ["declaration", "program", "version"])
    def test_kept_runs_are_of_the_same_declaration_program_and_version(
        self, program, tmp_path, change
    ):
        path = program()
        before = digest(circumstances([path]))
        assert digest(circumstances([path])) == before
        if change == "declaration":
            program(environment={"A": "1"})
        elif change == "program":
            program(GOOD + "  # another")
        else:
            (tmp_path / "flight_version.py").write_text("print('flight 1.1')")
            program(GOOD + "#")
        assert digest(circumstances([path])) != before

    def test_child_processes_and_tables_know_it_from_any_folder(
        self, program, tmp_path, monkeypatch
    ):
        path = program()
        monkeypatch.chdir(tmp_path)
        [variant] = [variant for variant in variants(["flight.toml"]) if variant.label == "flight"]
        assert variant.engine == path and variant.stands_for == "flight"
        assert (
            Record("key", "ball", variant, 1e-2, Outcome("key", "missing")).describe()["engine"]
            == "flight"
        )
        [outcome] = run_isolated(
            [Job("ball", "flight.toml", BALL, {"output_step": 0.1})], timeout_s=60
        )
        assert outcome.status == "ok", outcome

    def test_campaign_names_it_relative_to_itself(self, program, tmp_path):
        path, campaign = program(), tmp_path / "campaign.toml"
        text = 'scenes = ["pendulum"]\n[variants.flight]\nengine = "{}"\ndt = [1e-2]\n'
        campaign.write_text(text.format("flight.toml"))
        [variant] = load_campaign(campaign).variants
        assert (variant.engine, variant.stands_for) == (path, "flight")
        campaign.write_text(text.format("flihgt.toml"))
        with pytest.raises(CampaignError, match="flihgt"):
            load_campaign(campaign)
