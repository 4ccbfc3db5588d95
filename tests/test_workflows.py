"""The workflows are valid, their shell scripts can be parsed, and what they name exists; no runner is needed."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from stiction.cli.app import app

ROOT = Path(__file__).parent.parent
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def scripts(path):
    """The shell scripts of all steps of a workflow."""
    for job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values():
        yield from (step["run"] for step in job["steps"] if "run" in step)


def commands():
    """The names of the commands of stiction."""
    import typer

    return set(typer.main.get_command(app).commands)


def test_of_the_schema():
    subprocess.run(
        [
            *(sys.executable, "-m", "check_jsonschema"),
            *("--builtin-schema", "vendor.github-workflows", *map(str, WORKFLOWS)),
        ],
        check=True,
        timeout=60,
    )


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash, which runs the scripts")
@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_scripts_can_be_parsed(path):
    for script in scripts(path):
        plain = re.sub(r"\$\{\{.*?\}\}", "value", script, flags=re.DOTALL)
        subprocess.run(["bash", "-n", "-c", plain], check=True, timeout=20)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_what_scripts_name_exists(path):
    text = "\n".join(scripts(path))
    extras = {name for names in re.findall(r"\.\[([\w,]+)\]", text) for name in names.split(",")}
    assert extras <= set(PROJECT["optional-dependencies"])
    assert set(re.findall(r"(?:^|[;&] *)stiction ([a-z]+)", text, re.MULTILINE)) <= commands()
    for name in re.findall(r"(?:tests|\.ci|docs)/[\w./]+\w", text):
        assert (ROOT / name).exists(), name


def test_the_release_is_checked_before_it_is_published():
    release = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8"))
    jobs = release["jobs"]
    assert any(".ci/release" in step.get("run", "") for step in jobs["packages"]["steps"])
    assert jobs["publish"]["needs"] == "packages"
    writers = [name for name, job in jobs.items() if "id-token" in job.get("permissions", {})]
    assert writers == ["publish"]


def check_release(tag, root):
    ended = subprocess.run(
        [sys.executable, root / ".ci/release", tag], capture_output=True, text=True, timeout=20
    )
    return ended.returncode, ended.stdout


@pytest.fixture
def release(tmp_path):
    """The files that name the version, with an address of the repository."""
    (tmp_path / ".ci").mkdir()
    for name in (".ci/release", "pyproject.toml", "CITATION.cff", "CHANGELOG.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    project = tmp_path / "pyproject.toml"
    text = project.read_text(encoding="utf-8")
    if "[project.urls]" not in text:
        text += '\n[project.urls]\nSource = "https://example.org/stiction"\n'
    project.write_text(text, encoding="utf-8")
    return tmp_path


def test_versions_and_dates_agree(release):
    assert check_release(f"v{PROJECT['version']}", release) == (0, "\n")


@pytest.mark.parametrize(
    ("file", "pattern", "replacement"),
    [
        ("pyproject.toml", r'^version = ".*"$', 'version = "9.9.9"'),
        ("pyproject.toml", r"^\[project.urls\]$", "[tool.nothing]"),
        ("CITATION.cff", r"^version: .*$", "version: 9.9.9"),
        ("CITATION.cff", r"^date-released: .*$", "date-released: 1999-01-01"),
        ("CHANGELOG.md", r"^## \d.*$", "## 9.9.9, 2026-01-01"),
    ],
)
def test_a_difference_is_named(release, file, pattern, replacement):
    path = release / file
    changed = re.sub(pattern, replacement, path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert changed != path.read_text(encoding="utf-8")
    path.write_text(changed, encoding="utf-8")
    code, text = check_release(f"v{PROJECT['version']}", release)
    assert code == 1 and "expected" in text


def test_another_tag_is_refused(release):
    code, text = check_release("v0.0.0", release)
    assert code == 1 and "found v0.0.0" in text
