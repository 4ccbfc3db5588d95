"""Machine code on disk: where nothing can be written, where it is damaged, made by others at the same time, from other sources or for another machine."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import numba
import pytest
from numba import config
from numba.core import event

from stiction.reference_impl.compiled import kernel_cache

SOURCE = """
from stiction.reference_impl.compiled.kernel import kernel

@kernel
def times(x: float) -> float:
    return {factor} * x
"""
CALL = """
from numba.core import event
with event.install_recorder("numba:compile") as compiled:
    from made import times
    print(times(21.0), len(compiled.buffer) // 2)
"""
ROOT = Path(__file__).parents[3]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(config, "CACHE_DIR", "")
    (tmp_path / "made.py").write_text(SOURCE.format(factor=2))
    return tmp_path


def started(folder, **environment):
    """A process that calls the kernel; it prints the result, and how many kernels it compiled."""
    inherited = {
        key: value
        for key, value in os.environ.items()
        if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    return subprocess.Popen(
        [sys.executable, "-c", CALL],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={
            **inherited,
            "PYTHONPATH": f"{folder}:{ROOT}",
            "HOME": str(folder / "home"),
            **environment,
        },
    )


def finished(process):
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    result, compiled = out.split()
    return float(result), int(compiled), err


def call(folder, **environment):
    return finished(started(folder, **environment))


def called_here(folder, home="home", temporary="temporary", chosen=""):
    """As `call`, in this process: the module is made anew, so that its kernel is looked for on disk again, from the folders that are given."""
    made, source, said = ModuleType("made"), folder / "made.py", []
    (folder / "temporary").mkdir(exist_ok=True)
    kernel_cache._preferred_folders.cache_clear()  # found once in a process
    with pytest.MonkeyPatch.context() as patch, event.install_recorder("numba:compile") as compiled:
        patch.setitem(sys.modules, "made", made)
        patch.setattr(config, "CACHE_DIR", chosen)
        patch.setenv("HOME", str(folder / home))
        patch.delenv("XDG_CACHE_HOME", raising=False)
        patch.setattr(tempfile, "tempdir", str(folder / temporary))
        patch.setattr(kernel_cache, "_warn_once", said.append)
        exec(compile(source.read_text(), source, "exec"), vars(made))
        found = made.times(21.0), len(compiled.buffer) // 2, "\n".join(said)
    kernel_cache._preferred_folders.cache_clear()
    return found


def kept(folder):
    return sorted((folder / "__pycache__").rglob("made.times-*.nbc"))


@pytest.fixture
def unwritable(folder):
    """The sources' folder cannot be written, by whatever user: a file stands in its place."""
    (folder / "__pycache__").write_text("")
    return folder


NO_HOME = {"home": "/dev/null"}


def test_an_installation_that_cannot_be_written_uses_the_home(unwritable):
    assert call(unwritable) == (42.0, 1, "")
    assert called_here(unwritable) == (42.0, 0, "")
    assert list((unwritable / "home" / ".cache" / "stiction").rglob("made.times-*.nbc"))


def test_without_a_home_a_temporary_folder_is_used_and_said_unless_others_can_write_it(unwritable):
    (unwritable / "temporary").mkdir()
    result, compiled, note = call(
        unwritable, HOME="/dev/null", TMPDIR=str(unwritable / "temporary")
    )
    assert (result, compiled) == (42.0, 1)
    assert (
        note.count("\n") == 1
        and f"compiled kernels are kept in {unwritable}/temporary/stiction-" in note
        and "NUMBA_CACHE_DIR" in note
    )
    assert called_here(unwritable, **NO_HOME) == (42.0, 0, "")
    [own] = (unwritable / "temporary").iterdir()
    own.chmod(0o777)
    result, compiled, note = called_here(unwritable, **NO_HOME)
    assert (result, compiled) == (42.0, 1) and "not kept" in note


def test_where_nothing_can_be_written_kernels_are_not_kept(unwritable):
    result, compiled, note = called_here(unwritable, **NO_HOME, temporary="/dev/null/none")
    assert (result, compiled) == (42.0, 1) and "\n" not in note and "not kept" in note


def test_a_folder_that_is_asked_for_is_the_only_one(folder):
    called_here(folder)
    chosen = str(folder / "chosen")
    assert call(folder, NUMBA_CACHE_DIR=chosen) == (42.0, 1, "")
    assert called_here(folder, chosen=chosen) == (42.0, 0, "")


@pytest.mark.parametrize("ending", ["nbc", "nbi"], ids=["machine code", "index"])
@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:20],
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: b"\x80" * len(data),
    ],
    ids=["empty", "the beginning", "half", "all but a byte", "garbage"],
)
def test_what_is_damaged_is_compiled_anew(folder, damage, ending):
    called_here(folder)
    [file] = (folder / "__pycache__").rglob(f"made.times-*.{ending}")
    file.write_bytes(damage(file.read_bytes()))
    assert called_here(folder) == (42.0, 1, "")
    assert called_here(folder) == (42.0, 0, "")


def test_processes_that_compile_at_once(folder):
    together = [started(folder) for _ in range(3)]
    assert [finished(process)[::2] for process in together] == [(42.0, "")] * 3
    assert len(kept(folder)) == 1 and not list(folder.rglob("*.tmp.*"))
    assert called_here(folder) == (42.0, 0, "")


def test_another_processor_has_machine_code_of_its_own(folder):
    called_here(folder)
    assert call(folder, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == (42.0, 1, "")
    assert called_here(folder) == (42.0, 0, "") and len(kept(folder)) == 2


def test_another_numba_compiles_anew(folder, monkeypatch):
    called_here(folder)
    with monkeypatch.context() as patch:
        patch.setattr(numba, "__version__", "0.0.1")
        assert called_here(folder) == (42.0, 1, "")
    assert called_here(folder) == (42.0, 0, "")


def test_of_changed_sources_nothing_old_is_called_or_left(folder):
    called_here(folder)
    [old] = kept(folder)
    old.with_name(f"{old.name}.tmp.0123").write_bytes(
        b"of a process that was killed while it wrote"
    )
    (folder / "made.py").write_text(SOURCE.format(factor=3))
    assert called_here(folder) == (63.0, 1, "")
    assert len(kept(folder)) == 1 and old not in kept(folder) and not list(folder.rglob("*.tmp.*"))


AHEAD = """
import logging
logging.basicConfig(level=logging.INFO, format="%(message)s")
import made
from stiction.reference_impl.compiled.compiling_ahead import compile_ahead
{before}
kernels = made.times, made.squared, made.cubed
compile_ahead(kernels)
print(all(kernel.is_kept for kernel in kernels), made.times(1.0), made.squared(3.0), made.cubed(2.0))
"""


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import sys; sys.executable = '/dev/null/python'",
        "import signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); sys.executable = made.__file__.replace('made.py', 'endless')",
    ],
    ids=[
        "two processes",
        "one that cannot start the other",
        "the other hangs and inherits that SIGTERM is ignored",
    ],
)
def test_compiled_ahead(folder, before):
    (folder / "endless").write_text("#!/bin/sh\nexec tail -f /dev/null\n")
    (folder / "endless").chmod(0o755)
    (folder / "made.py").write_text(
        SOURCE.format(factor=2)
        + """
@kernel
def squared(x: float) -> float:
    return x * x

@kernel
def cubed(x: float) -> float:
    return squared(x) * x
"""
    )
    for said in (True,) if before else (True, False):
        done = subprocess.run(
            [sys.executable, "-c", AHEAD.format(before=before)],
            text=True,
            capture_output=True,
            check=True,
            timeout=300,
            env={**os.environ, "PYTHONPATH": f"{folder}:{ROOT}"},
        )
        assert done.stdout.split() == ["True", "2.0", "9.0", "8.0"]
        assert (
            "compiling a kernel, once for an installation: 1 of 3, made.times" in done.stderr
        ) == said
    assert len(list((folder / "__pycache__").rglob("*.nbc"))) == 3
