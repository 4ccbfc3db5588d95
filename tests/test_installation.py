"""What a wheel installs: one name, nothing left behind, and it runs in any folder, whatever packages lie there."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stiction.comparisons.bench import environment

ROOT = Path(__file__).parent.parent
FOLDERS = ("scenes", "truths", "reference_impl", "engines", "comparisons", "reports")
"""Packages of the installed name; the folder `stiction` is that name itself."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy, so that nothing of an earlier build is in it and nothing is written into the checkout."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("stiction", *FOLDERS):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source)
    code = f"from setuptools.build_meta import build_wheel; build_wheel({str(out)!r})"
    subprocess.run(
        [sys.executable, "-c", code], cwd=source, check=True, capture_output=True, timeout=300
    )
    [built] = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """The interpreter of an environment that has the wheel, the libraries of this one, and not the checkout.

    Folders named in a .pth file have their own .pth files ignored, and so what makes an editable installation.
    """
    environment = tmp_path_factory.mktemp("environment")
    subprocess.run(
        [sys.executable, "-m", "venv", "--without-pip", environment], check=True, timeout=120
    )
    [packages] = environment.glob("[Ll]ib/**/site-packages")
    (packages / "libraries.pth").write_text(
        "".join(f"{path}\n" for path in sys.path if Path(path).name == "site-packages")
    )
    zipfile.ZipFile(wheel).extractall(packages)
    return (
        environment / "bin" / "python"
        if os.name == "posix"
        else environment / "Scripts" / "python.exe"
    )


def run(python, *arguments, cwd, codes=(0,), timeout=300):
    ended = subprocess.run(
        [python, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout,
        env={
            key: value
            for key, value in os.environ.items()
            if key not in ("PYTHONPATH", "PYTEST_DISABLE_PLUGIN_AUTOLOAD")
        },
    )
    assert ended.returncode in codes, ended.stdout + ended.stderr
    return ended.stdout


def test_one_name(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {"stiction"}


def test_every_file_is_installed(wheel):
    here = {
        f"stiction/{path.relative_to(ROOT).as_posix()}"
        for name in FOLDERS
        for path in (ROOT / name).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    here |= {path.relative_to(ROOT).as_posix() for path in (ROOT / "stiction").rglob("*.py")} | {
        "stiction/py.typed"
    }
    assert here == {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def test_an_installation_from_a_checkout_knows_its_commit(tmp_path):
    """Nothing is written into the sources, and an archive without git has no commit."""
    source = tmp_path / "source"
    for name in ("stiction", *FOLDERS):
        shutil.copytree(
            ROOT / name,
            source / name,
            ignore=lambda folder, names: [
                name
                for name in names
                if not (Path(folder) / name).is_dir() and not name.endswith(".py")
            ],
        )
    for name in ("pyproject.toml", "README.md", "setup.py"):
        shutil.copy(ROOT / name, source)
    (source / ".gitignore").write_text("build/\n*.egg-info/\n")
    identity = {
        "GIT_AUTHOR_NAME": "a",
        "GIT_AUTHOR_EMAIL": "a@b",
        "GIT_COMMITTER_NAME": "a",
        "GIT_COMMITTER_EMAIL": "a@b",
        "GIT_CONFIG_GLOBAL": os.devnull,
    }

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words],
            cwd=source,
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, **identity},
        ).stdout.strip()

    def built(name: str) -> dict | None:
        out = tmp_path / name
        out.mkdir()
        code = f"from setuptools.build_meta import build_wheel; build_wheel({str(out)!r})"
        subprocess.run(
            [sys.executable, "-c", code], cwd=source, check=True, capture_output=True, timeout=300
        )
        [wheel] = out.glob("*.whl")
        archive = zipfile.ZipFile(wheel)
        file = "stiction/comparisons/built_from.json"
        return json.loads(archive.read(file)) if file in archive.namelist() else None

    git("init", "-q")
    git("add", "-A")
    git("commit", "-qm", "all of it")
    assert (
        built("clean") == {"hash": git("rev-parse", "HEAD"), "dirty": False}
        and git("status", "--porcelain") == ""
    )
    (source / "note.txt").write_text("a note beside the code\n")
    assert built("beside a note") == {"hash": git("rev-parse", "HEAD"), "dirty": False}
    (source / "README.md").write_text("changed\n")
    assert built("changed") == {"hash": git("rev-parse", "HEAD"), "dirty": True}
    shutil.rmtree(source / ".git")
    assert built("archive") is None


def test_the_commit_of_an_installation_is_that_which_it_was_built_from(tmp_path, monkeypatch):
    monkeypatch.setattr(environment, "ROOT", tmp_path)
    monkeypatch.setattr(environment, "BUILT_FROM", tmp_path / "built_from.json")
    assert environment.commit() is None and environment.origin()["commit"] is None
    (tmp_path / "built_from.json").write_text('{"hash": "abc", "dirty": true}')
    assert (
        environment.commit() == {"hash": "abc", "dirty": True}
        and environment.origin()["commit"] == "abc-dirty"
    )


@pytest.fixture
def theirs(tmp_path):
    """The folder of someone who has packages with our folders' names."""
    for name in FOLDERS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(
            "raise ImportError('this package is the user\\'s')\n"
        )
    return tmp_path


@pytest.mark.usefixtures("compiled")
def test_beside_packages_of_the_users(theirs):
    run(
        sys.executable,
        "-m",
        "stiction",
        "run",
        "pendulum",
        "--t-end",
        "1",
        "--out",
        "pendulum.csv",
        cwd=theirs,
    )
    table = np.genfromtxt(theirs / "pendulum.csv", delimiter=",", names=True, deletechars="")
    assert table["t"][-1] == 1.0
    (theirs / "test_it.py").write_text(
        "def test_it(stiction_scene):\n"
        "    assert stiction_scene('pendulum', 'reference', rtol=1e-8)['position_error'] < 1e-6\n"
    )
    assert "1 passed" in run(sys.executable, "-m", "pytest", "-q", "test_it.py", cwd=theirs)


def test_a_wheel_beside_packages_of_the_users(python, theirs):
    """Without a run of the reference, whose kernels would be compiled: half a minute, which the long test below takes."""
    assert "yes" in run(python, "-m", "stiction", "explain", "slider-bar-case-1", cwd=theirs)
    assert "stiction_scene" in run(python, "-m", "pytest", "--fixtures", cwd=theirs)


def test_a_checkout_on_the_path_is_enough(tmp_path):
    """Without what an editable installation makes, as behind one that was made before the packages had one name."""
    code = (
        "import sys; sys.meta_path[:] = [finder for finder in sys.meta_path if 'Editable' not in getattr(finder, '__name__', '')]\n"
        "from stiction import engines, load_engine, scenes; print(scenes.__file__, engines.__file__)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert ended.stdout.split() == [
        str(ROOT / name / "__init__.py") for name in ("scenes", "engines")
    ]


@pytest.mark.long
def test_commands_of_the_wheel(python, theirs):
    """With all the data that they read: campaign, baseline, stored problems, catalogue, templates of pages and papers."""
    assert "random scenes: one guide" in run(
        python, "-m", "stiction", "replay", cwd=theirs, timeout=600
    )
    run(
        python,
        "-m",
        "stiction",
        "validate",
        "--quick",
        "--engines",
        "pymunk",
        "--out",
        "run",
        cwd=theirs,
        timeout=3000,
    )
    assert (theirs / "run" / "report.md").exists()
    run(python, "-m", "stiction", "paper", "run", "--out", "paper", cwd=theirs)
    assert (theirs / "paper" / "paper.pdf").read_bytes().startswith(b"%PDF")
    run(python, "-m", "stiction", "page", "run", cwd=theirs)
    assert "<html" in (theirs / "run.html").read_text()
    # 3, 4: numbers of another machine may differ from the baseline's, and engines may be missing; that is theirs to say
    run(
        python,
        "-m",
        "stiction",
        "check",
        "--engine",
        "reference",
        cwd=theirs,
        codes=(0, 3, 4),
        timeout=3000,
    )
    run(
        python,
        "-m",
        "stiction",
        "nightly",
        "--scenes",
        "pendulum",
        "--out",
        "night",
        cwd=theirs,
        codes=(0, 3, 4),
        timeout=3000,
    )
    run(python, "-m", "stiction", "page", "night/history.sqlite", cwd=theirs)
