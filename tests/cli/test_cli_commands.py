"""The commands do what they say: files, tables, exit codes, quiet where nobody looks."""

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from conftest import installed, invoke

from stiction.cli.compare import _print
from stiction.cli.exit_codes import FAILED, INTERRUPTED, TERMINATED, terminate
from stiction.cli.render import show, show_trajectory
from stiction.comparisons.bench.results import Results
from stiction.reports.text import Section
from stiction.scenes import Trajectory, load_scene, vary
from stiction.truths import slider_bar_truth

SLIDER_BAR_COLUMNS = {
    "t",
    "slider.x",
    "slider.vx",
    "slider.ax",
    "guide.normal_force",
    "guide.F1",
    "guide.F2",
    "guide.F3",
    "guide.F4",
    "guide.friction",
    "guide.mode",
    "motor.effort",
    "pin.fx",
    "pin.fy",
    "drift.position",
}

HANGS = 600.0
"""Seconds, far above what any command here takes on a machine with other work: what has not ended by then hangs."""

BROKEN_ENGINE = """
import os, time
import numpy as np
from stiction.engines import Capabilities, Engine, EngineFailure

class Broken(Engine):
    name, version = "broken", "1"
    capabilities = Capabilities(("joint",), {"joint": False}, {"joint": "none"}, "engine", "0")

    def default_settings(self, fidelity):
        return {"how": ""}

    def refusal(self, scene, fidelity):
        return "not on Sundays" if scene.name == "four-bar" else None

    def run(self, scene, *, settings, **_):
        if settings.get("how") == "abort":
            os.write(2, b"Assertion failed: mass > 0\\n")
            os.abort()
        if settings.get("how") == "hang":
            open("hanging", "w").close()
            time.sleep(600)
        if settings.get("how") == "bug":
            return [][1]
        if settings.get("how") == "wrong shape":
            return np.zeros(2) + np.zeros(3)
        raise EngineFailure("Newton did not converge at t = 0.3")
"""


def _read(terminal: int) -> bytes:
    """What a terminal shows next; nothing once nobody has it open any more, which Linux says with an error."""
    try:
        return os.read(terminal, 4096)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        return b""


@pytest.fixture
def broken_engine(tmp_path, monkeypatch):
    (tmp_path / "broken_engine.py").write_text(BROKEN_ENGINE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return "broken_engine:Broken"


@pytest.mark.usefixtures("in_this_process")
class TestRun:
    @pytest.mark.parametrize(
        ("ending", "read"), [(".csv", pd.read_csv), (".parquet", pd.read_parquet)]
    )
    def test_file(self, ending, read, tmp_path):
        result = invoke(
            "run",
            "slider-bar-case-1",
            "--t-end",
            "3",
            "--output-step",
            "0.05",
            "--rtol",
            "1e-10",
            "--setting",
            "stabilization=projection",
            "--out",
            str(tmp_path / f"run{ending}"),
        )
        assert (
            result.output == f"{tmp_path / f'run{ending}'}\n"
        )  # what was written; no terminal: no progress
        frame = read(tmp_path / f"run{ending}")
        assert SLIDER_BAR_COLUMNS <= set(frame.columns)
        assert frame["t"].to_numpy() == pytest.approx(0.05 * np.arange(61), abs=1e-12)
        truth = slider_bar_truth(load_scene("slider-bar-case-1"), 3.0)(frame["t"].to_numpy())
        for column in ("slider.x", "slider.vx", "motor.effort"):
            # 10 times the tolerance per unit of time; the torque follows from the state, with factors of the order of 20 N m
            assert frame[column].to_numpy() == pytest.approx(
                truth[column], abs=1e-9 if column != "motor.effort" else 1e-7
            )

    def test_events_in_the_file_are_two_sided(self, tmp_path):
        invoke(
            "run", "slider-bar-case-1", "--t-end", "3", "--events", "--out", tmp_path / "run.csv"
        )
        frame = pd.read_csv(tmp_path / "run.csv")
        slip = frame[
            np.isclose(frame["t"], 0.304719758, atol=1e-8)
        ]  # equations.md: events of case 1
        assert list(slip["guide.mode"]) == [0, -1] or list(slip["guide.mode"]) == [0, 1]
        assert slip["motor.effort"].iloc[0] != slip["motor.effort"].iloc[1]

    def test_summary(self):
        result = invoke(
            "run", "slider-bar-case-1", "--t-end", "8", "--setting", "stabilization=none"
        )
        lines = [line.split() for line in result.stdout.splitlines()]
        assert float(next(line for line in lines if line[:1] == ["slider"])[1]) == pytest.approx(
            -0.146660414, abs=1e-8
        )
        found = [
            (float(line[0]), line[1])
            for line in lines
            if line[1:2] and line[1] in ("slip", "stick", "reversal")
        ]
        expected = [
            (0.304719758, "slip"),
            (2.637951554, "reversal"),
            (5.119216448, "reversal"),
            (6.544624960, "reversal"),
            (7.600035087, "stick"),
        ]
        assert [kind for _, kind in found] == [kind for _, kind in expected]
        # nine digits are printed and known; rtol is 1e-9
        assert [time for time, _ in found] == pytest.approx(
            [time for time, _ in expected], abs=1e-8
        )
        assert "hlcp" in result.stdout

    def test_rounding_and_small_drift_are_shown_as_zero(self, capsys):
        """1e-16 N of 20 N is rounding and 1e-12 m are below a drift of 1e-11 m; 1e-6 m are shown although a drift of 1e-3 m is larger."""

        def shown(drift, **places):
            columns = {
                f"bar.{name}": np.zeros(2) for name in ("x", "y", "angle", "vx", "vy", "omega")
            } | {f"bar.{name}": np.full(2, value) for name, value in places.items()}
            columns |= {
                "guide.normal_force": np.full(2, 20.0),
                "guide.friction": np.array([3e-16, -3e-16]),
                "motor.effort": np.array([1e-9, -2e-17]),
                "drift.position": np.full(2, drift),
                "drift.velocity": np.zeros(2),
            }
            show_trajectory(Trajectory("a scene", "e", "1", "joint", np.array([0.0, 1.0]), columns))
            return {
                line.split()[0]: line.split()[1:]
                for line in capsys.readouterr().out.splitlines()
                if line.strip()
            }

        found = shown(1e-11, x=1.0, y=1e-12, angle=-2e-17, vx=3.0, omega=4e-16)
        assert found["bar"] == ["1", "0", "0", "3", "0", "0"]
        assert (
            found["guide.friction"] == ["0"] * 3
            and found["motor.effort"] == ["0", "1e-09", "0"]
            and found["drift.position"] == ["1e-11"] * 3
        )
        assert shown(1e-3, x=1.0, y=1e-6)["bar"][:2] == ["1", "1e-06"]

    def test_events_without_values_are_listed_without_jumps(self):
        ended = invoke(
            "run", "slider-bar-case-1", "--t-end", "1", "--setting", "event_values=false"
        )
        assert re.search(r"0\.304719758\s+slip\s+guide", ended.output)

    def test_an_event_has_no_jump_of_another_part(self, tmp_path):
        bodies = "".join(
            f"{name} = {{ mass = 1, inertia = 1, position = [0, {y}], velocity = [{v}, 0] }}\n"
            for name, y, v in (("driven", 0, 1), ("free", 5, 0))
        )
        guides = "".join(
            f'{name}-guide = {{ type = "translational", slider = "{name}", direction = [1, 0], point = [0, {y}], mu = 0.1 }}\n'
            for name, y in (("driven", 0), ("free", 5))
        )
        (tmp_path / "parts.toml").write_text(
            f"t_end = 1\ngravity = [0, -9.81]\n[bodies]\n{bodies}[joints]\n{guides}[drives]\n"
            'motor = { type = "distance", bodies = ["driven", "ground"], axis = [1, 0], law = { type = "sine", amplitude = 0.5, frequency = 2 } }\n'
            '[forces]\nload = { type = "force", body = "free", direction = [1, 0], law = { type = "sine", amplitude = 3, frequency = 2 } }\n'
        )
        ended = invoke("run", tmp_path / "parts.toml")
        lines = [
            line.split()
            for line in ended.output.splitlines()
            if "-guide" in line and not line.startswith(("driven", "free"))
        ]
        assert {(line[2], len(line)) for line in lines} == {("driven-guide", 4), ("free-guide", 3)}

    def test_forces_that_guides_at_rest_leave_open(self, tmp_path):
        """Friction and normal forces of the trammel; the file has empty cells, and the figure gaps."""
        command = (
            "run",
            "hard/trammel-at-rest",
            "--engine",
            "pymunk",
            "--t-end",
            "0.1",
            "--dt",
            "1e-3",
        )
        shown = invoke(*command, "--plot", tmp_path / "run.svg").stdout
        told = [line for line in shown.splitlines() if line.endswith("left open")]
        assert sorted(line.split()[0] for line in told) == sorted(
            f"guide-{axis}.{force}" for axis in "xy" for force in ("friction", "normal_force")
        )
        invoke(*command, "--out", tmp_path / "run.csv")
        frame = pd.read_csv(tmp_path / "run.csv")
        assert (
            frame["guide-x.friction"].isna().all()
            and frame["guide-x.moment"].notna().all()
            and (tmp_path / "run.svg").stat().st_size > 1000
        )


@pytest.mark.usefixtures("compiled")
class TestFailures:
    @pytest.mark.parametrize(
        ("scene", "how", "words"),
        [
            ("pendulum", "give up", "failed: Newton did not converge at t = 0.3"),
            ("four-bar", "run", "refused: not on Sundays"),
            ("pendulum", "abort", "crashed: SIGABRT: Assertion failed: mass > 0"),
            ("pendulum", "hang", "timed out: no result within 1 s"),
        ],
    )
    def test_engine(self, broken_engine, scene, how, words):
        result = invoke(
            "run",
            scene,
            "--engine",
            broken_engine,
            "--setting",
            f"how={how}",
            "--timeout",
            "1" if how == "hang" else "600",
            exit_code=FAILED,
        )
        assert words in result.output
        assert "Traceback" not in result.output and len(result.output.splitlines()) == 1

    @pytest.mark.parametrize(
        ("how", "words"),
        [
            ("bug", "IndexError: list index out of range"),
            ("wrong shape", "ValueError: operands could not be broadcast"),
        ],
    )
    def test_bug_of_an_engine_keeps_its_traceback(self, broken_engine, how, words):
        result = invoke(
            "run",
            "pendulum",
            "--engine",
            broken_engine,
            "--setting",
            f"how={how}",
            exit_code=FAILED,
        )
        assert (
            "Traceback (most recent call last)" in result.stderr
            and "broken_engine.py" in result.stderr
        )
        assert f"failed: {words}" in result.stderr.splitlines()[-1]

    def test_the_traceback_of_an_engine_on_request(self, broken_engine):
        full = invoke(
            "run pendulum --traceback --setting",
            "how=give up",
            "--engine",
            broken_engine,
            exit_code=FAILED,
        )
        assert (
            "Traceback" in full.stderr
            and "raise EngineFailure(" in full.stderr
            and "failed: Newton" in full.stderr
        )

    def test_engine_that_is_not_installed(self):
        result = invoke("run", "pendulum", "--engine", "no_such_package:Engine", exit_code=FAILED)
        assert "missing" in result.output and "no_such_package" in result.output

    def test_nothing_to_compare_with_is_installed(self, in_this_process):
        missing = "no_such_package_anywhere:Engine"
        drift = ["compare", "drift", "pendulum", "--quick", "--t-end", "0.1", "--engines"]
        alone = invoke(*drift, missing, exit_code=FAILED)
        assert (
            "reference" in alone.stdout
            and "no engine" in alone.stderr
            and "no_such_package_anywhere" in alone.stderr
        )
        assert invoke(*drift, f"{missing},pymunk").stderr == ""

    def test_fidelity_that_an_engine_lacks(self):
        result = invoke("run", "block-on-incline", "--engine", "moreau", exit_code=FAILED)
        assert "refused" in result.stderr and "--fidelity contact" in result.stderr

    def test_refusal_of_the_suite(self):
        result = invoke(
            "run", "pendulum", "--engine", "pymunk", "--fidelity", "contact", exit_code=FAILED
        )
        assert "refused" in result.output and "no translational joint" in result.output

    def test_nobody_comes_out(self):
        result = invoke(
            "compare",
            "drift",
            "pendulum",
            "--quick",
            "--timeout",
            "1e-9",
            "--engines",
            "reference",
            exit_code=FAILED,
        )
        assert "timed out" in result.stdout and "all runs failed" in result.output


class TestCompare:
    def test_torque(self, tmp_path, in_this_process):
        result = invoke(
            "compare",
            "torque",
            "slider-bar-case-1",
            "--quick",
            "--t-end",
            "3",
            "--engines",
            "reference",
            "--out",
            str(tmp_path / "jumps.parquet"),
        )
        jumps = pd.read_parquet(tmp_path / "jumps.parquet")
        tight = jumps[(jumps["variant"] == "reference") & (jumps["step"] == jumps["step"].min())]
        assert list(tight["kind"]) == ["slip", "reversal"]
        assert tight["jump_error"].abs().max() < 1e-8  # what the reference is held to
        assert tight["resolved"].all() and "2/2" in result.stdout

    def test_cost_says_what_is_no_independent_truth_and_what_its_columns_are(
        self, tmp_path, in_this_process
    ):
        """A sled on a slope pulled by a spring has no truth but our own run."""
        invoke("new", tmp_path / "sled.toml")
        own = invoke(
            "compare cost --quick --engines reference --repeats 1 --t-end 0.5",
            tmp_path / "sled.toml",
        ).stdout
        assert (
            "our own run" in own and "not independent" in own and "1 mm in Sled on a slope" in own
        )

    def test_a_truth_without_jumps_is_no_failure(self, in_this_process):
        """A pendulum has no events; that an engine has refused it does not mean that all runs failed."""
        result = invoke(
            "compare", "torque", "pendulum", "--quick", "--engines", "pymunk", "--t-end", "0.2"
        )
        assert result.exit_code == 0 and "refused" in result.output
        assert "the effort does not jump" in result.output

    def test_without_jumps_a_figure_changes_neither_the_table_nor_the_exit_code(
        self, tmp_path, in_this_process
    ):
        command = [
            "compare",
            "torque",
            "pendulum",
            "--quick",
            "--engines",
            "pymunk",
            "--t-end",
            "0.2",
        ]
        alone, both = tmp_path / "alone.csv", tmp_path / "both.csv"
        invoke(*command, "--out", alone)
        result = invoke(*command, "--out", both, "--plot", tmp_path / "jumps.png")
        assert alone.read_bytes() == both.read_bytes() and not (tmp_path / "jumps.png").exists()
        assert result.exit_code == 0 and "jumps.png is not written" in result.output

    def test_runs_that_were_not_made_or_ended_early_say_whose_they_are(self, capsys):
        runs = pd.DataFrame(
            [
                ("trial and error", "ok", "the linear system is singular"),
                ("trial and error", "ok", ""),
                ("drake", "missing", "drake: not installed"),
                ("drake, contact", "missing", "drake: not installed"),
            ],
            columns=["variant", "status", "reason"],
        )
        _print(Section(), Results((), {}, {}), runs)
        assert capsys.readouterr().out.splitlines() == [
            "engine not available, 2 runs not made: drake: not installed",
            "method trial and error, 1 of 2 runs ended early: the linear system is singular",
        ]

    def test_a_program_that_crashes_is_not_reported_as_not_installed(self, tmp_path):
        """It is there, but its version command fails, which the message has to say."""
        program = tmp_path / "crashing.toml"
        program.write_text(
            'name = "crashing"\n'
            f'command = ["{sys.executable}", "-c", "pass", "{{scene}}", "{{result}}", "{{dt}}"]\n'
            f'version = ["{sys.executable}", "-c", "raise SystemExit(\'boom\')"]\n'
        )
        result = invoke("compare accuracy slider-crank --quick --engines", program, exit_code=1)
        assert "engine not available, 2 runs not made: crashing: its version command fails" in (
            result.output
        )
        assert "boom" in result.output and "installed" not in result.output


class TestLists:
    def test_scenes(self):
        result = invoke("scenes")
        [line] = [line for line in result.stdout.splitlines() if line.split()[:1] == ["pendulum"]]
        assert "Simple pendulum" in line and line.rstrip().endswith("gravity, drives")

    def test_engines(self):
        result = invoke("engines")
        rows = [line.split() for line in result.stdout.splitlines()]
        assert any(row[:1] == ["reference"] and row[2:4] == ["joint", "yes"] for row in rows)
        assert any(row[:1] == ["exudyn"] and row[2:4] == ["contact", "no"] for row in rows)

    @pytest.mark.parametrize(
        ("engine", "fidelity"),
        [
            ("reference", "joint"),
            ("moreau", "contact"),
            ("exudyn", "joint"),
            ("exudyn", "contact"),
            ("pymunk", "joint"),
            ("pymunk", "contact"),
            ("pybullet", "joint"),
            ("pybullet", "contact"),
            ("mujoco", "joint"),
            ("drake", "joint"),
            ("dart", "joint"),
            ("dart", "contact"),
            ("newton", "joint"),
            ("newton", "contact"),
        ],
    )
    def test_defaults_that_are_told_are_those_of_a_run(self, engine, fidelity, compiled):
        found = installed(engine)
        scene = vary(load_scene("block-on-incline"), {"guide.mus": None})
        told = found.default_settings(fidelity)
        plain, given = (
            found.simulate(scene, t_end=0.05, fidelity=fidelity, **settings)
            for settings in ({}, told)
        )
        assert (
            told
            and plain.settings == given.settings
            and all(np.array_equal(plain[name], given[name]) for name in plain.columns)
        )
        told.clear()
        assert found.default_settings(
            fidelity
        )  # what a caller does to its copy concerns nobody else

    def test_engine_that_cannot_be_imported(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "pymunk", None)
        monkeypatch.delitem(sys.modules, "stiction.engines.pymunk.engine", raising=False)
        result = invoke("engines")
        [line] = [line for line in result.stdout.splitlines() if "pymunk" in line]
        assert "not installed" in line


@pytest.mark.usefixtures("compiled")
class TestProcess:
    def command(self, *arguments, **options):
        return subprocess.Popen(
            [sys.executable, "-m", "stiction", *arguments],
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **options,
        )

    @pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
    @pytest.mark.parametrize(
        ("sent", "code", "words"),
        [
            (signal.SIGINT, INTERRUPTED, "stiction: interrupted\n"),
            (signal.SIGTERM, TERMINATED, None),
        ],
    )
    @pytest.mark.usefixtures("interruptible")
    def test_a_signal_leaves_neither_children_nor_folders(
        self, sent, code, words, broken_engine, tmp_path
    ):
        process = self.command(
            "run",
            "pendulum",
            "--engine",
            broken_engine,
            "--setting",
            "how=hang",
            cwd=tmp_path,
            env=os.environ | {"TMPDIR": str(tmp_path)},
        )
        while not (tmp_path / "hanging").exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(sent)
        stdout, stderr = process.communicate(timeout=HANGS)
        assert (process.returncode, stdout) == (code, "") and words in (None, stderr), stderr
        assert not list(tmp_path.glob("stiction-*"))

    @pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
    def test_interrupt_while_imports_are_made_has_no_traceback(self, interruptible):
        """At a terminal the command and the server of its children get it, wherever they are in their imports."""
        begun = (
            "import os, signal, sys, stiction.__main__ as command, stiction.child_processes as children; sys.argv = ['stiction', 'run']; "
            "children.start_server = lambda with_measures: os.kill(os.getpid(), signal.SIGINT); command.main()"
        )
        served = "import os, signal; from stiction.child_processes import _PRELOADED; __import__(_PRELOADED[0]); os.kill(os.getpid(), signal.SIGINT)"
        for code in (begun, served):
            ended = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, timeout=HANGS
            )
            assert (ended.returncode, ended.stderr) == (-signal.SIGINT, "")

    def test_help_names_the_exit_codes_and_imports_nothing_heavy(self):
        code = (
            "import sys; from stiction.cli.app import app; sys.argv = ['stiction', '--help']; app(standalone_mode=False); "
            "print('heavy:', sys.modules.keys() & {'numpy', 'scipy', 'numba', 'pandas', 'matplotlib', 'pydantic'})"
        )
        ended = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=HANGS
        )
        assert "Exit codes" in ended.stdout and "heavy: set()" in ended.stdout, ended.stderr

    @pytest.mark.parametrize(
        ("modules", "others"),
        [
            (
                "stiction.__main__, stiction.child_processes",
                {"numpy", "pydantic", "typer", "stiction.scenes", "stiction.cli"},
            ),  # before anything else
            (
                "stiction.__main__, stiction.engines.command_run",
                {"typer", "rich", "pandas", "stiction.cli"},
            ),
        ],
        ids=["command", "child"],
    )
    def test_a_run_begins_without_what_it_can_do_without(self, modules, others):
        code = f"import sys, {modules}; print('others:', sys.modules.keys() & {others!r})"
        ended = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=HANGS
        )
        assert "others: set()" in ended.stdout, ended.stdout + ended.stderr

    @pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo terminal")
    def test_progress_on_a_terminal_only(self):
        ours, theirs = os.openpty()
        process = subprocess.Popen(
            [sys.executable, "-m", "stiction", "run", "pendulum", "--t-end", "1"],
            stdout=subprocess.PIPE,
            stderr=theirs,
            env={**os.environ, "TERM": "xterm"},
        )
        os.close(theirs)
        shown = []
        # read while it runs: a terminal holds some 4 KB, and who writes more waits for a reader
        reader = threading.Thread(
            target=lambda: shown.extend(iter(lambda: _read(ours), b"")), daemon=True
        )
        reader.start()
        stdout, _ = process.communicate(timeout=HANGS)
        reader.join(timeout=HANGS)
        os.close(ours)
        assert process.returncode == 0
        assert (
            b"reference on pendulum" in b"".join(shown) and b"reference on pendulum" not in stdout
        )
        assert b"0/?" not in b"".join(shown) and b"left" not in b"".join(
            shown
        )  # of one run nobody knows how long it takes


class Terminal(StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("width", [20, 40, 60, 80, 120, 250])
def test_no_number_is_cut_on_a_narrow_terminal(width, monkeypatch):
    """At 80 columns of nine numbers ``3.4e-12`` once stood as ``3.4e…``: a number without its exponent is another number."""
    numbers = [
        f"{sign}{mantissa}e-{exponent}"
        for sign, mantissa, exponent in zip(" - - - - ", range(10001, 99999, 10000), range(10, 19))
    ]
    words = (
        "paper's scheme, no stabilization",
        "a reason that takes some more words than a line of the terminal has",
    )
    terminal = Terminal()
    monkeypatch.setattr("sys.stdout", terminal)
    monkeypatch.setenv("COLUMNS", str(width))
    show(
        ("variant", *(f"quantity {i}, max [m/s]" for i in range(9)), "reason"),
        [(words[0], *numbers, words[1])] * 2,
    )
    shown = terminal.getvalue()
    assert "…" not in shown
    for number in numbers:
        assert len(re.findall(rf"(?<!\S){re.escape(number.strip())}(?!\S)", shown)) == 2, number
    assert all(word in shown for text in words for word in text.split())


def test_more_instants_than_fit_are_bad_input():
    result = invoke("run", "pendulum", "--t-end", "1e12", exit_code=2)
    assert (
        "t_end, output_step: found 1e+12 s and 0.01 s, 1e+14 instants; expected at most 1e+07"
        in result.stderr
    )


def test_a_breakdown_at_the_start_is_told_without_a_motion():
    result = invoke("run", "existence-lost", exit_code=1)
    assert (
        "no motion, 1 rows" in result.output
        and "nan" not in result.output
        and "no solution of the HLCP was found" in result.stderr
    )


@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("nightly --out made", "stiction.comparisons.regression.nightly.run_night"),
        (
            "sweep slider-bar-case-1 --vary F0=1,2 --measure event-count --out made",
            "stiction.comparisons.sweep.sweep.sweep",
        ),
    ],
)
def test_what_is_cut_off_says_how_it_goes_on(command, work, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(work, lambda *_, **__: terminate())
    result = invoke(*command.split(), exit_code=TERMINATED)
    assert (
        result.stderr.startswith("stiction: ended by SIGTERM: the finished runs are stored")
        and "made" in result.stderr
    )
