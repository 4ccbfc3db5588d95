"""A scene is a test in three lines in a repository that is not ours."""

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

pytest_plugins = "pytester"
ROOT = Path(__file__).parents[3]

THREE_LINES = """
def test_ball(stiction_scene):
    numbers = stiction_scene("ball.toml", "my_solver:MySolver", dt=1e-2)
    assert numbers["position_error"] < 1e-9
"""
TESTS = (
    THREE_LINES
    + """
def test_wrong(stiction_scene):
    moon = {"gravity.1": -1.6}
    numbers = stiction_scene("ball.toml", "my_solver:MySolver", dt=1e-2, overrides=moon, wind=1.0)
    assert numbers["position_error"] < 1e-9

def test_crashed(stiction_scene):
    stiction_scene("ball.toml", "my_solver:MySolver", dt=1e-2, wind=2.0)

def test_neither_step_nor_tolerance(stiction_scene):
    stiction_scene("pendulum", "reference")
"""
)

SOLVER = """
import os
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import vary

class MySolver(ReferenceEngine):
    name = "mine"

    def default_settings(self, fidelity):
        return {"wind": 0.0}

    def run(self, scene, *, dt, settings, **arguments):
        wind = dict(settings).get("wind", 0.0)
        if wind > 1:
            os._exit(7)
        return super().run(vary(scene, {"gravity.0": wind}), dt=None, settings={}, **arguments)
"""

BALL = """
t_end = 1
gravity = [0, -9.81]
bodies.ball = {mass = 2, inertia = 1, velocity = [3, 4]}
"""


@pytest.mark.usefixtures("compiled")
def test_three_lines(pytester, monkeypatch):
    # whether or not this checkout is the one that is installed
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pytester.makepyfile(TESTS)
    pytester.makepyfile(my_solver=SOLVER)
    (pytester.path / "ball.toml").write_text(BALL)
    result = pytester.runpytest_subprocess("-p", "stiction.comparisons.regression.pytest_plugin")
    result.assert_outcomes(passed=1, failed=3)
    # a wind of 1 m/s^2 moves the ball by 0.5 m in a second
    result.stdout.fnmatch_lines_random(
        [
            "*FAILED*test_wrong - assert 0.* < 1e-09*",
            "*ball/my_solver:MySolver/dt=0.01: crashed: exit code 7*",
            "*InputError: dt, rtol: found None, None*",
        ]
    )


def test_plugin_is_announced_and_imports_nothing_heavy():
    announced = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][
        "pytest11"
    ]
    assert hasattr(import_module(announced["stiction"]), "stiction_scene")
    heavy = {"numpy", "scipy", "numba", "pandas", "pydantic", "engines", "scenes"}
    code = f"import sys, {announced['stiction']}; print(sorted({heavy!r} & sys.modules.keys()))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert loaded.stdout.strip() == "[]"
