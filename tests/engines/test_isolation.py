"""What crashes, hangs or raises in a child process is one lost task, and its words are kept."""

import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import psutil
import pytest
from child_tasks import (
    Treacherous,
    announce_and_hang,
    burn,
    fail,
    hang,
    hang_deaf,
    leave,
    leave_at_once,
    process_id,
    product,
    say_and_abort,
    say_process_id,
    segfault,
    take_away,
    unpicklable,
    wait_for,
)

from stiction.child_processes import undisturbed_end
from stiction.cli.exit_codes import Terminated, terminate
from stiction.comparisons.bench.store import kept_runs
from stiction.engines import (
    Capabilities,
    Engine,
    EngineFailure,
    EngineMissing,
    Job,
    Refused,
    Task,
    UnknownEngine,
    engine_names,
    isolate,
    isolation,
    load_engine,
    run_isolated,
)
from stiction.engines.gate import required_columns
from stiction.engines.isolation import ChildrenEnded, IdleChildren, sealed, unsealed
from stiction.engines.protocol import installed_version
from stiction.scenes import InputError, Trajectory, load_scene

TIMEOUT_S = 600.0  # far above what any task here takes on a busy machine; a task that is to time out gets its own


@pytest.fixture(scope="module")
def outcomes():
    """One campaign with every disaster between healthy tasks, on two reused children."""
    tasks = [
        Task("first", product, (6, 7)),
        Task("abort", say_and_abort),
        Task("segfault", segfault),
        Task("kill", signal.raise_signal, (signal.SIGKILL,)),
        Task("exit", leave, (3,)),
        Task("exit at once", leave_at_once, (0,)),
        Task("raise", fail, (ArithmeticError, "matrix is singular\nat step 7")),
        Task("engine failure", fail, (EngineFailure, "Newton did not converge")),
        Task("refused", fail, (Refused, "no moving guides")),
        Task("missing", load_engine, ("no_such_package_anywhere:Engine",)),
        Task("unpicklable", unpicklable),
        Task("cannot be unpickled", Treacherous),
        Task("burn", burn, (0.2,)),
        Task("last", product, (2, 3)),
    ]
    seen = []
    results = isolate(tasks, workers=2, timeout_s=TIMEOUT_S, on_result=seen.append)
    assert [outcome.label for outcome in results] == [task.label for task in tasks]
    assert sorted(map(id, seen)) == sorted(map(id, results))
    return {outcome.label: outcome for outcome in results}


def test_sealed_tasks_have_the_same_outcomes(outcomes):
    """All that differs is that whoever passes them on has not unpickled them."""
    tasks = [
        Task("first", product, (6, 7)),
        Task("abort", say_and_abort),
        Task("raise", fail, (ArithmeticError, "matrix is singular\nat step 7")),
        Task("refused", fail, (Refused, "no moving guides")),
        Task("unpicklable", unpicklable),
        Task("cannot be unpickled", Treacherous),
    ]
    passed_on = isolate(
        [sealed(task) for task in tasks], workers=1, timeout_s=TIMEOUT_S, unpickle=False
    )
    assert isinstance(passed_on[0].value, bytes) and isinstance(passed_on[-1].value, bytes)
    for outcome in map(unsealed, passed_on):
        direct = outcomes[outcome.label]
        assert (outcome.status, outcome.value, outcome.reason, outcome.bug) == (
            direct.status,
            direct.value,
            direct.reason,
            direct.bug,
        )


@pytest.mark.parametrize(
    ("label", "status", "reason"),
    [
        ("first", "ok", ""),
        ("abort", "crashed", "SIGABRT: "),
        ("segfault", "crashed", "SIGSEGV"),
        ("kill", "crashed", "SIGKILL (killed from outside"),
        ("exit", "failed", "SystemExit: 3"),
        ("exit at once", "crashed", "exit code 0 before there was a result"),
        ("raise", "failed", "ArithmeticError: matrix is singular at step 7"),
        ("engine failure", "failed", "Newton did not converge"),
        ("refused", "refused", "no moving guides"),
        ("missing", "missing", "no_such_package_anywhere"),
        ("unpicklable", "failed", "result cannot be pickled"),
        ("cannot be unpickled", "failed", "result cannot be unpickled"),
        ("last", "ok", ""),
    ],
)
def test_each_end_has_its_status_and_words(outcomes, label, status, reason):
    outcome = outcomes[label]
    assert (outcome.status, reason in outcome.reason) == (status, True), outcome
    assert "\n" not in outcome.reason
    assert (outcome.value is not None) == (status == "ok")


def test_native_words_on_abort_reach_reason_and_log(outcomes):
    assert "mass must be positive" in outcomes["abort"].reason
    assert "banner on standard output" in outcomes["abort"].log
    assert outcomes["last"].log == ""


def test_traceback_is_in_the_log(outcomes):
    assert "Traceback" in outcomes["raise"].log and "in fail" in outcomes["raise"].log


def notes(count):
    for i in range(count):
        logging.getLogger("stiction").info(f"note {i}, ä")
    return count


def test_what_a_child_logs_comes_in_on_the_way():
    said = []
    outcomes = isolate(
        [Task(str(i), notes, (3,)) for i in range(2)],
        workers=1,
        timeout_s=TIMEOUT_S,
        on_note=said.append,
    )
    assert [outcome.value for outcome in outcomes] == [3, 3] and said == [
        "note 0, ä",
        "note 1, ä",
        "note 2, ä",
    ] * 2
    [alone] = isolate([Task("unheard", notes, (1,))], timeout_s=TIMEOUT_S)
    assert alone.value == 1


def test_a_task_that_is_never_read_has_no_words_of_the_one_before_it():
    def stop(outcome):
        if outcome.status == "ok":
            os.kill(outcome.value, signal.SIGSTOP)

    said, unread = isolate(
        [Task("said", say_process_id), Task("unread", process_id)],
        workers=1,
        timeout_s=5,
        on_result=stop,
    )
    assert (said.status, said.log) == ("ok", str(said.value))
    assert (unread.status, unread.log) == ("timed out", "")


def test_a_result_that_comes_while_another_is_dealt_with_is_in_time(tmp_path, monkeypatch):
    late, begun, go = 0.0, tmp_path / "begun", tmp_path / "go"
    monkeypatch.setattr(
        isolation, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + late)
    )

    def take_long(outcome):
        nonlocal late
        if outcome.label == "first":
            go.touch()
            while go.exists():
                time.sleep(0.01)
            time.sleep(1.0)  # the other's result is on its way
            late = 1e6

    first, second = isolate(
        [Task("first", wait_for, (begun,)), Task("second", take_away, (begun, go))],
        workers=2,
        timeout_s=100,
        on_result=take_long,
    )
    assert (first.status, second.status) == ("ok", "ok")


def test_cpu_and_wall_seconds(outcomes):
    # the loop ends at 0.2 s of the same clock, and one thread takes no more of the processor than time passes; 10 ms: the clocks' grain
    assert 0.2 <= outcomes["burn"].cpu_s <= outcomes["burn"].wall_s + 0.01
    assert outcomes["abort"].cpu_s is None and outcomes["abort"].wall_s > 0


def test_what_hangs_times_out_alone():
    """Two at once, one of them deaf to SIGTERM, between others, which need some milliseconds of the 5 s."""
    tasks = [
        Task("a", product, (1, 2)),
        Task("hang", hang),
        Task("deaf", hang_deaf),
        Task("b", product, (3, 4)),
    ]
    first, *hung, last = isolate(tasks, workers=2, timeout_s=5.0)
    assert (first.value, last.value) == (2, 12)
    for outcome in hung:
        assert (outcome.status, outcome.reason) == (
            "timed out",
            "no result within 5 s",
        ) and outcome.wall_s >= 5.0


def test_idle_child_that_is_killed_costs_nothing():
    """The first child is killed right after its task, between the two tasks that one child would do."""

    def kill(outcome):
        if outcome.label == "first":
            os.kill(outcome.value, signal.SIGKILL)
            time.sleep(0.2)

    first, second = isolate(
        [Task("first", process_id), Task("second", process_id)],
        workers=1,
        timeout_s=TIMEOUT_S,
        on_result=kill,
    )
    assert (first.status, second.status) == ("ok", "ok")
    assert first.value != second.value


def alive(pid):
    """Whether the process runs (a zombie that nobody has reaped yet does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_child_outlives_the_campaign(tmp_path, number, interruptible):
    note = tmp_path / "pid"
    script = tmp_path / "campaign.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        sys.path[:0] = {sys.path!r}
        from child_tasks import announce_and_hang
        from stiction.engines import Task, isolate
        if __name__ == "__main__":
            isolate([Task("hang", announce_and_hang, ({str(note)!r},))], timeout_s=600)
        """)
    )
    campaign = subprocess.Popen(
        [sys.executable, str(script)],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(tmp_path)},
    )
    while not (note.exists() and note.read_text()):
        assert campaign.poll() is None
        time.sleep(0.05)
    child = int(note.read_text())
    assert alive(child)
    campaign.send_signal(number)
    _, error = campaign.communicate(timeout=TIMEOUT_S)
    assert campaign.returncode != 0 and (number != signal.SIGINT or "KeyboardInterrupt" in error)
    deadline = time.monotonic() + TIMEOUT_S
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(child)


class _Failed(Exception):
    pass


def _interrupted(outcome):
    signal.raise_signal(signal.SIGINT)


def _complain(outcome):
    raise _Failed


def _again(monkeypatch, place, name, numbers=(signal.SIGTERM, signal.SIGINT)):
    """Signals come whenever something is about to be ended."""
    whole = getattr(place, name)

    def disturbed(*given, **options):
        for number in numbers:
            signal.raise_signal(number)
        return whole(*given, **options)

    monkeypatch.setattr(place, name, disturbed)


@pytest.fixture
def as_the_command(interruptible):
    """SIGTERM is an interrupt, as in the command."""
    before = signal.signal(signal.SIGTERM, terminate)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
@pytest.mark.parametrize(
    ("on_result", "told"),
    [(_interrupted, KeyboardInterrupt), (_complain, Terminated), (None, Terminated)],
)
def test_signals_while_children_are_ended_leave_none(
    on_result, told, as_the_command, monkeypatch, tmp_path
):
    """An interrupt ends a campaign, or an error, or nothing does: the signals that come while its children are killed keep none of them alive."""
    children, start = [], isolation._Child.__init__
    monkeypatch.setattr(
        isolation._Child,
        "__init__",
        lambda child, folder: [start(child, folder), children.append(child._process.pid)][0],
    )
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    _again(monkeypatch, isolation._Child, "kill")
    tasks = [
        Task("a", product, (1, 1)),
        Task("b", hang) if on_result else Task("b", product, (1, 1)),
    ]
    with pytest.raises(KeyboardInterrupt) as caught:
        isolate(tasks, workers=2, timeout_s=TIMEOUT_S, on_result=on_result)
    assert caught.type is told
    assert children and not any(map(alive, children)) and not list(tmp_path.glob("stiction-*"))
    assert (
        signal.getsignal(signal.SIGTERM) is terminate
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )


def test_signals_while_a_campaign_ends_leave_what_was_kept(as_the_command, monkeypatch, tmp_path):
    _again(monkeypatch, isolation._Child, "kill")
    tasks = [Task("a", product, (6, 7)), Task("b", hang)]
    with kept_runs(tmp_path / "out", ["reference"]) as runs:
        outcomes = runs.isolate(
            tasks,
            workers=2,
            timeout_s=TIMEOUT_S,
            on_result=lambda outcome: outcome.label == "a" and signal.raise_signal(signal.SIGTERM),
        )
    assert [outcome.status for outcome in outcomes] == ["ok", "not run"] and type(
        runs.interrupt
    ) is Terminated
    with kept_runs(tmp_path / "out", ["reference"]) as runs:
        assert runs.isolate(tasks[:1], timeout_s=TIMEOUT_S)[0].value == 42 and runs.taken_over == 1


def test_an_interrupt_that_was_dropped_can_be_sent_again(as_the_command):
    """Python drops what a handler raises within a finalizer."""
    with pytest.raises(Terminated), undisturbed_end():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            pass
        signal.raise_signal(signal.SIGTERM)


def test_task_that_cannot_be_pickled_is_an_error_before_anything_runs(tmp_path):
    with pytest.raises((AttributeError, TypeError, pickle.PicklingError), match="pickle"):
        isolate(
            [Task("a", announce_and_hang, (str(tmp_path / "pid"),)), Task("b", lambda: 1)],
            timeout_s=1,
        )
    assert not (tmp_path / "pid").exists()


@pytest.mark.parametrize(
    "arguments", [{"workers": 0, "timeout_s": 1}, {"timeout_s": 0}, {"timeout_s": float("nan")}]
)
def test_senseless_arguments(arguments):
    with pytest.raises(ValueError, match="expected numbers > 0"):
        isolate([], **arguments)


class Toy(Engine):
    """Bodies at rest; refuses, fails or crashes where the settings say so."""

    name = "toy"
    version = "1.0"
    capabilities = Capabilities(
        fidelities=("joint",),
        static_coefficient={"joint": False},
        friction_law={"joint": "none"},
        reactions="engine",
        order="0",
    )

    def default_settings(self, fidelity):
        return {"crash": False, "fail": False}

    def refusal(self, scene, fidelity):
        return "no drives" if scene.drives else None

    def run(self, scene, *, t_end, dt, rtol, fidelity, output_step, settings):
        if settings.get("crash"):
            print("toy: out of cheese", file=sys.stderr)
            os.abort()
        if settings.get("fail"):
            raise EngineFailure("toy: gave up")
        t = np.linspace(0.0, t_end, round(t_end / output_step) + 1)
        columns = {name: np.zeros_like(t) for name in required_columns(scene)}
        return Trajectory(scene.name, self.name, self.version, fidelity, t, columns)


class NoEngine:
    version = "1.0"


class NeedsPackage(Toy):
    @property
    def version(self):
        import package_that_nobody_has

        return package_that_nobody_has.__version__


class Mistaken(Toy):
    @property
    def version(self):
        return {}["version"]


def scene():
    from stiction.scenes import scene_from_dict

    return scene_from_dict(
        {"bodies": {"block": {"mass": 1, "inertia": 1}}, "t_end": 2}, name="rest"
    )


def test_jobs_run_engines_in_isolation():
    toy, missing = f"{__name__}:Toy", f"{__name__}:NeedsPackage"
    jobs = [
        Job("fine", toy, scene(), {"t_end": 3.0}),
        Job("crash", toy, scene(), {"crash": True}),
        Job("fail", toy, scene(), {"fail": True}),
        Job("refused", toy, load_scene("slider-bar-case-1")),
        Job("fidelity", toy, scene(), {"fidelity": "contact"}),
        Job("missing", missing, scene()),
        Job("unknown", "bulet", scene()),
    ]
    fine, crash, failed, refused, fidelity, absent, unknown = run_isolated(
        jobs, workers=2, timeout_s=TIMEOUT_S
    )
    assert fine.status == "ok" and fine.value.t[-1] == 3.0 and fine.value.scene == "rest"
    assert (crash.status, crash.reason) == ("crashed", "SIGABRT: toy: out of cheese")
    assert (failed.status, failed.reason) == ("failed", "toy: gave up")
    assert (refused.status, refused.reason) == ("refused", "no drives")
    assert (
        fidelity.status == "refused"
        and "toy has no contact fidelity; expected joint" in fidelity.reason
        and "--fidelity joint" in fidelity.reason
    )
    assert absent.status == "missing" and "package_that_nobody_has" in absent.reason
    assert unknown.status == "failed" and "did you mean 'pybullet'?" in unknown.reason


def test_engines_by_name_and_address():
    assert engine_names()[:9] == [
        "reference",
        "moreau",
        "exudyn",
        "pymunk",
        "pybullet",
        "mujoco",
        "drake",
        "dart",
        "newton",
    ]
    assert load_engine(f"{__name__}:Toy").name == "toy"


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("pymonk", UnknownEngine, "did you mean 'pymunk'?"),
        (
            "",
            UnknownEngine,
            "expected reference, moreau, exudyn, pymunk, pybullet, mujoco, drake, dart, newton",
        ),
        (":", UnknownEngine, "expected reference"),
        (
            f"{__name__}:NoEngine",
            UnknownEngine,
            "expected a class derived from stiction.engines.Engine",
        ),
        (f"{__name__}:Nothing", UnknownEngine, f"module {__name__} has no class Nothing"),
        (
            f"{__name__}:Toi",
            UnknownEngine,
            f"module {__name__} has no class Toi (did you mean 'Toy'?)",
        ),
        (
            f"{__name__}:Halved",
            UnknownEngine,
            "class Halved has no version, refusal; expected a class that defines name, capabilities, version, refusal, run",
        ),
        (
            f"{__name__}:Bare",
            UnknownEngine,
            "class Bare has no name, capabilities, version, refusal, run",
        ),
        (f"{__name__}:NeedsPackage", EngineMissing, "package_that_nobody_has"),
    ],
)
def test_engines_that_cannot_be_had(name, kind, words):
    with pytest.raises(kind) as caught:
        load_engine(name)
    assert words in str(caught.value)


class Untouched(Toy):
    def run(self, scene, **_):
        raise AssertionError("not refused")


class Tolerant(Untouched):
    name = "tolerant"
    capabilities = replace(Toy.capabilities, adaptive=True)


class Plain(Untouched):
    def default_settings(self, fidelity):
        return {}


@pytest.mark.parametrize(
    ("engine", "asked", "words"),
    [
        (
            Untouched,
            {"foo": 1},
            "foo: toy has no such setting at joint fidelity; expected one of crash, fail$",
        ),
        (
            Plain,
            {"foo": 1},
            "foo: toy has no such setting at joint fidelity; expected none: it has no settings",
        ),
        (Untouched, {"rtol": 1e-4}, "rtol: found 0.0001; toy has a fixed step, expected dt"),
        (Tolerant, {"dt": 1e-4}, "dt: found 0.0001; tolerant has a tolerance, expected rtol"),
    ],
)
def test_what_an_engine_has_not_declared_is_refused_before_it_runs(engine, asked, words):
    with pytest.raises(InputError, match=words):
        engine().simulate(load_scene("slider-crank"), **asked)


def test_a_mistake_in_an_adapter_of_others_is_shown_as_it_is():
    with pytest.raises(KeyError, match="version"):
        load_engine(f"{__name__}:Mistaken")


@pytest.mark.parametrize(
    ("engine", "module", "contents", "words"),
    [
        (
            "exudyn",
            "exudyn",
            "",
            r"exudyn: its package is broken: AttributeError: .* no attribute 'config'; pip install --force-reinstall --no-deps 'exudyn>=1\.13\.6' brings it",
        ),
        (
            "pymunk",
            "pymunk",
            "version = '7.3.0'",
            r"found pymunk 6\.4\.0; expected >=7\.0; pip install 'pymunk>=7\.0' brings it",
        ),
        (
            "exudyn",
            "exudyn",
            "class config: Version = lambda: '1.13.5'",
            r"found exudyn 1\.13\.5; expected >=1\.13\.6; pip install 'exudyn>=1\.13\.6'",
        ),
        (
            "pybullet",
            "pybullet",
            "",
            r"no attribute 'connect'; pip install --force-reinstall --no-deps 'pybullet>=3\.2\.7'",
        ),
        (
            "mujoco",
            "mujoco",
            "raise RuntimeError('no AVX')",
            r"mujoco: its package is broken: RuntimeError: no AVX; .* --no-deps 'mujoco-core>=4\.0'",
        ),
        (
            "mujoco",
            "mujoco",
            "raise ImportError('libGL.so.1')",
            r"mujoco: libGL.so.1; pip install 'mujoco-core>=4\.0'",
        ),
        (
            "drake",
            "pydrake",
            "raise OSError('bad ELF')",
            r"drake: its package is broken: OSError: bad ELF; .* 'drake>=1\.51'",
        ),
        (
            "dart",
            "dartpy",
            "raise OSError('bad ELF')",
            r"dart: its package is broken: OSError: bad ELF; .* 'dartpy>=6\.20'",
        ),
        (
            "newton",
            "newton",
            "raise OSError('bad ELF')",
            r"newton: its package is broken: OSError: bad ELF; .* 'newton",
        ),
    ],
)
def test_a_broken_package_is_told_with_what_to_install(
    engine, module, contents, words, tmp_path, monkeypatch
):
    (tmp_path / f"{module}.py").write_text(contents)
    if module == "pymunk":  # its version is that of its metadata
        (tmp_path / "pymunk-6.4.0.dist-info").mkdir()
        (tmp_path / "pymunk-6.4.0.dist-info" / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: pymunk\nVersion: 6.4.0\n"
        )
    installed_version.cache_clear()
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    try:
        with pytest.raises(EngineMissing, match=words):
            load_engine(engine)
    finally:
        sys.modules.pop(module, None)
        installed_version.cache_clear()


class Halved(Engine):
    name, capabilities = "halved", Toy.capabilities

    def run(self, scene, **_):
        raise AssertionError("never called")


class Bare(Engine):
    pass


class Unable(Toy):
    @property
    def capabilities(self):
        raise ZeroDivisionError("no idea")


class Boasting(Toy):
    capabilities = "all"


BROKEN = {
    "Mistaken": "KeyError: 'version'",
    "Unable": "ZeroDivisionError: no idea",
    "Boasting": "capabilities is 'all'",
    "NoEngine": "expected a class derived from",
}


@pytest.fixture
def announced(tmp_path, monkeypatch):
    """A function that has a package announce classes of this module, each under its name in small letters."""

    def announce(*classes):
        package = tmp_path / "other_engine-1.0.dist-info"
        package.mkdir()
        (package / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: other-engine\nVersion: 1.0\n"
        )
        (package / "entry_points.txt").write_text(
            "\n".join(
                ["[stiction.engines]", *(f"{name.lower()} = {__name__}:{name}" for name in classes)]
            )
        )
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.chdir(tmp_path)

    return announce


def command(*arguments):
    from typer.testing import CliRunner

    from stiction.cli.app import app

    ended = CliRunner().invoke(app, arguments)
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended


def test_broken_adapters_of_others_end_no_command(announced, in_this_process):
    """They are rows of `engines` and `explain`, a missing run of a comparison, and no obstacle to a campaign without them."""
    announced(*BROKEN, "Toy")
    for table in (command("engines"), command("explain", "pendulum")):
        for name, reason in BROKEN.items():
            [line] = [
                line for line in table.output.splitlines() if line.startswith(f"{name.lower()} ")
            ]
            assert "broken" in line and reason in line
        assert table.exit_code == 0 and any(
            line.startswith("toy ") for line in table.output.splitlines()
        )
    names = ",".join(map(str.lower, BROKEN))
    compared = command(
        "compare", "drift", "pendulum", "--engines", names, "--quick", "--out", "table.csv"
    )
    assert compared.exit_code == 1 and all(
        reason in compared.stderr for reason in BROKEN.values()
    ), compared.output
    found = pd.read_csv("table.csv").set_index("engine")
    assert set(found.loc[["reference"], "status"]) == {"ok"}
    for name, reason in BROKEN.items():
        assert (
            set(found.loc[[name.lower()], "status"]) == {"missing"}
            and found.loc[[name.lower()], "reason"].str.contains(reason, regex=False).all()
        )
    with kept_runs(Path("report"), ["reference", *map(str.lower, BROKEN)]) as kept:
        # as `validate` begins
        assert kept.kept == 0
    Path("night.toml").write_text(
        'scenes = ["pendulum"]\nmeasure = ["accuracy"]\n'
        + "".join(
            f'[variants.{name}]\nengine = "{name}"\n{ladder}\n'
            for name, ladder in [
                ("reference", "rtol = [1e-6]"),
                *((name.lower(), "dt = [0.01]") for name in BROKEN),
            ]
        )
    )
    night = command("nightly", "night.toml")
    assert night.exit_code == 4 and all(reason in night.output for reason in BROKEN.values()), (
        night.output
    )


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"static_coefficient": True}, "static_coefficient: found True; expected a mapping"),
        ({"fidelities": "joint"}, "fidelities: found 'joint'"),
        ({"fidelities": ("rigid",)}, "expected a tuple of 'joint' or 'contact'"),
    ],
)
def test_capabilities_of_another_kind_are_told_at_once(wrong, words):
    with pytest.raises((TypeError, ValueError), match=words):
        replace(Toy.capabilities, **wrong)


def until_gone(number: int) -> None:
    """Wait for the end of a process."""
    while psutil.pid_exists(number):
        time.sleep(0.01)


class TestKeptChildren:
    """Children that are left for the next call: short tasks of many calls take one start."""

    def test_the_next_call_uses_the_child_of_the_last(self):
        kept = IdleChildren()
        first, second = (
            isolate([Task("who", process_id)] * 2, workers=1, timeout_s=TIMEOUT_S, kept=kept)
            for _ in range(2)
        )
        assert len({outcome.value for outcome in (*first, *second)}) == 1
        kept.end()
        third = isolate([Task("who", process_id)], workers=1, timeout_s=TIMEOUT_S, kept=kept)
        assert third[0].value != first[0].value
        kept.end()

    def test_what_crashes_or_hangs_is_one_row_and_loses_no_other(self):
        kept = IdleChildren()
        for _ in range(2):
            tasks = [
                Task("a", product, (2, 3)),
                Task("crash", leave_at_once, (3,)),
                Task("b", product, (4, 5)),
                Task("c", product, (6, 7)),
            ]
            found = isolate(tasks, workers=1, timeout_s=TIMEOUT_S, kept=kept)
            assert [outcome.status for outcome in found] == ["ok", "crashed", "ok", "ok"] and [
                outcome.value for outcome in found
            ] == [6, None, 20, 42]
        hanging = isolate([Task("hang", hang)], workers=1, timeout_s=1.0, kept=kept)
        assert hanging[0].status == "timed out"
        assert (
            isolate([Task("e", product, (2, 2))], workers=1, timeout_s=TIMEOUT_S, kept=kept)[
                0
            ].value
            == 4
        )
        kept.end()

    def test_a_child_that_died_in_between_is_replaced(self):
        kept = IdleChildren()
        [first] = isolate([Task("who", process_id)], workers=1, timeout_s=TIMEOUT_S, kept=kept)
        os.kill(first.value, signal.SIGKILL)
        until_gone(first.value)
        [second] = isolate([Task("who", process_id)], workers=1, timeout_s=TIMEOUT_S, kept=kept)
        assert second.status == "ok" and second.value != first.value
        kept.end()

    def test_threads_that_share_them_do_not_disturb_each_other(self):
        """Each gets the outcomes of its own tasks, with the exit codes of its own children."""

        def share(first):
            tasks = [
                Task("ok", product, (first, 10)),
                Task("exit", leave_at_once, (first,)),
                Task("abort", say_and_abort),
            ]
            return isolate(tasks, workers=1, timeout_s=TIMEOUT_S, kept=kept)

        kept = IdleChildren()
        numbers = range(1, 9)
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(share, numbers))
        kept.end()
        assert [outcomes[0].value for outcomes in found] == [10 * number for number in numbers]
        assert [outcomes[1].reason for outcomes in found] == [
            f"exit code {number} before there was a result" for number in numbers
        ]
        assert all(outcomes[2].reason.startswith("SIGABRT") for outcomes in found)

    def test_another_thread_can_end_those_at_work(self, tmp_path):
        kept = IdleChildren()
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(
                isolate,
                [
                    Task("hang", announce_and_hang, (str(tmp_path / "child"),)),
                    Task("next", process_id),
                ],
                workers=1,
                timeout_s=TIMEOUT_S,
                kept=kept,
            )
            while not (tmp_path / "child").exists() or not (tmp_path / "child").read_text():
                time.sleep(0.01)
            kept.end_all()
            with pytest.raises(ChildrenEnded):
                waiting.result()
        until_gone(int((tmp_path / "child").read_text()))
        with pytest.raises(ChildrenEnded):
            isolate([Task("late", process_id)], workers=1, timeout_s=TIMEOUT_S, kept=kept)

    def test_idle_children_end_by_themselves(self):
        kept = IdleChildren(idle_s=0.01)
        [first] = isolate([Task("who", process_id)], workers=1, timeout_s=TIMEOUT_S, kept=kept)
        until_gone(first.value)
