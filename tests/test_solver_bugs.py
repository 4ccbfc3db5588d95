"""Which command finds which mistake of a solver's author: the table of docs/how-to/program.md, made again; and a few of them every time."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from solver_bugs import BUGS, declared

from stiction.comparisons.bench.planned_runs import PlannedRun
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.judge.conformance import OUTPUT_STEP, _attempt, conformance_scenes
from stiction.comparisons.judge.judgement import judge
from stiction.comparisons.regression.baseline import FORMAT, Baseline, updated
from stiction.comparisons.regression.check import REGRESSION, findings
from stiction.comparisons.regression.measurement import _run_row
from stiction.engines import EngineFailure, load_engine

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "program.md"
COMMANDS = ("run", "--try", "judge", "check")
KINDS = ("accuracy", "motion", "event", "drift", "counter")
ORIGIN = {"versions": {"python": ""}, "machine": {"cpu": ""}, "conditions": "these", "commit": None}
FAST = ("friction of the other sign, in the column alone", "damper left out", "explicit Euler")
NOTICED = 1e-3
"""Metres: ten times the error of the right solver in the slider-bar; it is what `judge` says that counts below."""


def rows(engine: str) -> list:
    """As `stiction check` makes them, at a step of 10 ms."""
    variant, found = Variant("mine", engine, "dt", (1e-2,), stands_for="mine"), []
    for scene in conformance_scenes():
        planned = PlannedRun(scene, variant, 1e-2)
        try:
            found.append(_run_row(planned, variant, KINDS, 1))
        except EngineFailure as error:
            found.append(replace(planned.row, status="failed", reason=str(error)))
    return found


@pytest.fixture(scope="module")
def baseline(tmp_path_factory, compiled):
    """Of the right solver."""
    right = rows(str(declared(tmp_path_factory.mktemp("right"), None)))
    return updated(
        Baseline(format=FORMAT), right, "the right one", ORIGIN, [row.key for row in right]
    )


def is_stopped(solver, scene) -> bool:
    """Whether `stiction run` fails."""
    try:
        solver.simulate(scene, dt=1e-3)
    except EngineFailure:
        return True
    return False


def found_by(engine: str, baseline: Baseline) -> set[str]:
    """Commands that find a mistake of an engine."""
    solver, scenes = load_engine(engine), conformance_scenes()
    found = {"run"} if any(is_stopped(solver, scene) for scene in scenes) else set()
    if any(_attempt(engine, scene).verdict != "right" for scene in scenes):
        found.add("--try")
    case = scenes[-1]
    table = solver.run(
        case,
        t_end=case.t_end,
        dt=1e-3,
        rtol=None,
        fidelity="joint",
        output_step=OUTPUT_STEP,
        settings={},
    )
    judged = judge(case, table)
    if judged.hints or len(judged.tables["findings"]) or judged.error > NOTICED:
        found.add("judge")
    if any(
        finding.severity == REGRESSION
        for finding in findings(rows(engine), baseline, KINDS, {}, "these")
    ):
        found.add("check")
    return found


def table() -> dict[str, set[str]]:
    """The table of the page: commands by mistake."""
    _, _, text = PAGE.read_text(encoding="utf-8").partition("| a mistake |")
    lines = [
        [cell.strip() for cell in line.strip("| \n").split("|")]
        for line in re.findall(r"^\|.*$", text, re.M)
    ]
    return {
        name: {command for command, cell in zip(COMMANDS, cells) if cell}
        for name, *cells in lines[1:]
        if len(cells) == len(COMMANDS)
    }


def test_the_page_has_them_all_and_each_is_found():
    assert list(table()) == [bug.name for bug in BUGS] and all(table().values())


@pytest.mark.parametrize("bug", [bug for bug in BUGS if bug.name in FAST], ids=lambda bug: bug.name)
def test_a_few_are_found_as_the_page_says(bug, tmp_path, baseline, in_this_process):
    assert found_by(str(declared(tmp_path, bug)), baseline) == table()[bug.name]


@pytest.mark.long
@pytest.mark.parametrize("bug", [None, *BUGS], ids=lambda bug: bug.name if bug else "none")
def test_each_is_found_as_the_page_says(bug, tmp_path, baseline, in_this_process):
    """And the right solver is not accused."""
    assert found_by(str(declared(tmp_path, bug)), baseline) == (table()[bug.name] if bug else set())
