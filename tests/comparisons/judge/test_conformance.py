"""Trial of a program: a right one passes, a wrong one is stopped by the simplest scene that shows its mistake, and its words name the cause."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w
from conftest import invoke

from stiction.comparisons.judge.conformance import conformance, conformance_scenes
from stiction.engines.pymunk.engine import PymunkEngine
from stiction.scenes import InputError

SOLVER = Path(__file__).parents[3] / "docs" / "examples" / "solvers" / "solver.py"
WRAPPED = """
import sys
import solver
scene, result, dt, output_step = sys.argv[1:]
{before}
solver.main(scene, result, dt, output_step)
head, *rows = [line.split(",") for line in open(result).read().split()]
rows = [[float(cell) for cell in row] for row in rows]
def every(labels, change):
    for row in rows:
        for i, name in enumerate(head):
            if name.rpartition(".")[2] in labels: row[i] = change(row[i])
{behind}
with open(result, "w") as file:
    for row in [head, *rows]: print(*row, sep=",", file=file)
"""
POINTS = """
coordinate = solver.Mechanism.coordinate
def wrong(self, element, q):
    return coordinate(self, {**element, "points": element["points"][::-1]} if element.get("points") and len(element["bodies"]) == 2 else element, q)
solver.Mechanism.coordinate = wrong"""


@pytest.fixture
def declared(tmp_path, in_this_process):
    def make(before="", behind="", **capabilities):
        shutil.copy(SOLVER, tmp_path)
        (tmp_path / "wrapped.py").write_text(WRAPPED.format(before=before, behind=behind))
        path = tmp_path / "mine.toml"
        path.write_text(
            tomli_w.dumps(
                {
                    "name": "mine",
                    "version": [sys.executable, "solver.py", "--version"],
                    "command": [
                        sys.executable,
                        "wrapped.py",
                        "{scene}",
                        "{result}",
                        "{dt}",
                        "{output_step}",
                    ],
                    "capabilities": {
                        "friction_law": "Coulomb",
                        "static_coefficient": True,
                        **capabilities,
                    },
                }
            )
        )
        return str(path)

    return make


def test_a_right_one_passes_all(declared):
    trials = list(conformance(declared(), 120))
    assert [(trial.scene, trial.verdict) for trial in trials] == [
        (scene.name, "right") for scene in conformance_scenes()
    ], trials


@pytest.mark.parametrize(
    ("behind", "scene", "words"),
    [
        (
            "every(['angle', 'omega', 'alpha'], lambda x: 57.29577951308232 * x)",
            "free-body",
            "degrees",
        ),
        ("every(['angle', 'omega'], lambda x: -x)", "free-body", "other sign"),
        ("every(['x', 'y', 'vx', 'vy'], lambda x: 1000 * x)", "free-body", "1000 times"),
        ("head[1:3] = head[2], head[1]", "free-body", "order of"),
        ("every(['t'], lambda t: 1000 * t)", "free-body", "time"),
        ("every(['t'], lambda t: t + 0.1)", "free-body", "time"),
        ("rows = rows[:50]", "free-body", "0.49 s"),
        (
            "rows[1:] = [[row[0], *late[1:]] for row, late in zip(rows[1:], rows)]",
            "free-body",
            "a sample late",
        ),
        ("rows[7][2] = float('nan')", "free-body", "row 8"),
        ("head[6] = 'stone.omeg'", "free-body", "did you mean 'stone.omega'"),
        ("print('no memory', file=sys.stderr); sys.exit(3)", "free-body", "exit code 3: no memory"),
    ],
    ids=range(11),
)
def test_mistake_of_the_output(declared, behind, scene, words):
    *right, wrong = conformance(declared(behind=behind), 120)
    assert not right and wrong.scene == scene and wrong.verdict in ("wrong", "failed")
    assert words in "\n".join(wrong.words)


@pytest.mark.parametrize(
    ("before", "scene"),
    [
        ("solver.Mechanism.forces = lambda self, t, q, v: [0.0] * len(q)", "free-body"),
        (POINTS, "pendulum-on-a-pin"),
        ("solver.load = lambda guide, R, N, kappa: abs(R) / 2", "block-on-incline"),
        ("solver.load = lambda guide, R, N, kappa: abs(R)", "slider-bar-case-1"),
    ],
    ids=["no-weight", "order-of-points", "half-friction", "no-moment"],
)
def test_mistake_of_the_mechanics_stops_at_the_first_scene_that_shows_it(declared, before, scene):
    *right, wrong = conformance(declared(before), 120)
    assert all(trial.verdict == "right" for trial in right)
    assert (wrong.scene, wrong.verdict in ("wrong", "failed")) == (scene, True), (right, wrong)


@pytest.mark.parametrize(
    ("behind", "scene", "words"),
    [
        ("every(['friction'], lambda f: -f)", "block-on-incline", "friction drives the slider"),
        ("every(['friction'], lambda f: 1.3 * f)", "block-on-incline", "guide.friction"),
        ("every(['friction'], lambda f: 0.5 * f)", "block-on-incline", "guide.friction"),
        ("every(['ax', 'ay'], lambda a: -a)", "free-body", "other sign"),
    ],
    ids=["sign", "more", "half", "acceleration"],
)
def test_mistake_of_the_forces(declared, behind, scene, words):
    """Positions and velocities are right."""
    *_, wrong = conformance(declared(behind=behind), 120)
    assert (wrong.scene, wrong.verdict) == (scene, "wrong") and words in "\n".join(wrong.words)


def test_forces_that_no_gate_can_judge_are_held_to_the_truth():
    """Another normal force and another effort with it balance only for who looks at all rows: here at the table alone."""
    from stiction.comparisons.judge.conformance import _faults
    from stiction.comparisons.judge.judgement import judge

    scene = conformance_scenes()[-1]
    run = PymunkEngine().simulate(scene, dt=1e-3)
    assert not list(_faults(judge(scene, run)))
    for name, factor in (
        ("guide.normal_force", 1.1),
        ("motor.effort", -1.0),
        ("guide.friction", 0.8),
        ("pin.fx", 0.5),
    ):
        words = "\n".join(
            _faults(judge(scene, replace(run, columns={**run.columns, name: factor * run[name]})))
        )
        assert name in words, (name, words)


def test_a_refusal_is_none(declared):
    trials = list(conformance(declared(friction_law=""), 120))
    assert [trial.verdict for trial in trials] == ["right"] * 3 + ["refused"] * 2


class Garbage(PymunkEngine):
    def run(self, scene, **arguments):
        return "no trajectory"


def test_engines_of_any_kind():
    """By name, and by module and class: what is no result at all is said in the words of the gate."""
    assert [trial.verdict for trial in conformance("pymunk", 120)] == ["right"] * 5
    [garbage] = conformance(f"{__name__}:Garbage", 120)
    assert (
        garbage.verdict == "failed" and "expected a stiction.scenes.Trajectory" in garbage.words[0]
    )
    with pytest.raises(InputError, match="did you mean 'pymunk'"):
        list(conformance("pymunkk", 60))


def test_command(declared):
    ended = invoke("engines", declared(behind="every(['y'], lambda y: -y)"), "--try", exit_code=1)
    assert (
        "free-body: wrong" in ended.output
        and "other sign" in ended.output
        and "pendulum" not in ended.output
    )


@pytest.mark.parametrize("command", [("engines", "--try"), ("engines", "", "--try")])
def test_command_needs_an_engine(command):
    """The message names the argument that is missing, not an engine without a name."""
    ended = invoke(*command, exit_code=2)
    assert "NAME" in ended.output and "stiction engines NAME --try" in ended.output


def test_command_without_a_verdict_is_no_success(monkeypatch):
    monkeypatch.setattr(f"{conformance.__module__}.conformance", lambda *_: iter(()))
    ended = invoke("engines", "pymunk", "--try", exit_code=1)
    assert "returned no verdict" in ended.output
