"""Stored complementarity problems: what is stored is true, and a replay tells solvers apart."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.complementarity import replay as replays
from stiction.comparisons.bench.complementarity.problems import (
    SOLVED,
    UNSOLVABLE,
    Problem,
    problem_at,
    read_problems,
    write_problems,
)
from stiction.comparisons.bench.complementarity.replay import (
    ACCURATE,
    answer,
    lemke,
    load_solver,
    replay,
)
from stiction.reference_impl.friction.hlcp import residual
from stiction.scenes import load_scene


@pytest.fixture(scope="module")
def stored():
    return list(read_problems())


def enumerate_all(A0, A1, b):
    """Every choice of a basis, for small problems."""
    if len(b) > 9:
        raise ValueError("too large")
    for in_y in product((True, False), repeat=len(b)):
        basis = np.where(in_y, A0, -A1)
        if np.linalg.cond(basis) < 1e12:
            values = np.linalg.solve(basis, b)
            if np.all(values >= -1e-12 * np.max(np.abs(values))):
                return np.where(in_y, np.maximum(values, 0), 0.0), np.where(
                    in_y, 0.0, np.maximum(values, 0)
                )
    return None


def test_stored_solutions_solve(stored):
    assert len(stored) > 200
    for problem in stored:
        if problem.outcome == SOLVED:
            assert residual(problem.A0, problem.A1, problem.b, problem.y, problem.x) <= ACCURATE, (
                problem.kind,
                problem.scene,
                problem.t,
            )


def test_stored_problems_without_solution_have_none(stored):
    none = [problem for problem in stored if problem.outcome == UNSOLVABLE and len(problem.b) <= 9]
    assert none
    assert all(enumerate_all(problem.A0, problem.A1, problem.b) is None for problem in none)


def unit_problem(**changes):
    """y = x + (-1, 2): solved by y = (0, 2), x = (1, 0)."""
    one = Problem(
        "unit",
        "none",
        0.0,
        np.eye(2),
        np.eye(2),
        np.array([-1.0, 2.0]),
        np.array([0.0, 2.0]),
        np.array([1.0, 0.0]),
        SOLVED,
        True,
    )
    return replace(one, **changes)


@pytest.mark.parametrize(
    ("solver", "outcome"),
    [
        (lambda M, q: (np.array([0.0, 2.0]), np.array([1.0, 0.0])), "solved"),
        (lambda A0, A1, b: (np.array([0.0, 2.0]), np.array([1.0, 0.0])), "solved"),
        (lambda M, q: (np.array([0.0, 2.0]), np.array([1.0 + 1e-6, 0.0])), "wrong"),
        (lambda M, q: (q, np.zeros(2)), "wrong"),  # w < 0
        (lambda M, q: (q + 1, np.ones(2)), "wrong"),  # equations and signs hold, w z > 0
        (lambda M, q: (np.array([0.0, np.nan]), np.zeros(2)), "wrong"),
        (lambda M, q: (np.zeros(3), np.zeros(3)), "wrong"),
        (lambda M, q: np.zeros(3), "wrong"),  # one vector, not two
        (lambda M, q: np.zeros(2), "wrong"),  # two numbers, not two vectors
        (lambda M, q: ("no", "numbers"), "wrong"),
        (lambda M, q: 1.0, "wrong"),
        (lambda M, q: None, "none found"),
        (lambda M, q: 1 / 0, "raised"),
    ],
)
def test_answers_are_judged_by_the_problem_alone(solver, outcome):
    assert answer(solver, unit_problem()).outcome == outcome


def test_an_answer_that_is_no_pair_of_vectors_says_what_was_expected():
    found = answer(lambda M, q: np.zeros(3), unit_problem())
    assert "ndarray" in found.reason and "pair" in found.reason


def test_no_solution_is_rightly_not_found_and_singular_is_no_lcp():
    assert answer(lambda M, q: None, unit_problem(outcome=UNSOLVABLE)).outcome == "rightly none"
    assert answer(lemke, unit_problem(lcp=False)).outcome == "not an LCP"


@pytest.mark.parametrize(
    "address",
    [
        "",
        "os",
        "os:",
        "os:nothing",
        "nosuch:solve",
        "os:sep",
        "stiction.comparisons.bench.complementarity.replay:replay",
    ],
)
def test_what_is_no_solver_is_refused(address):
    with pytest.raises(ValueError, match="solver"):
        load_solver(address)


def test_sets_are_written_and_read_alike(tmp_path, stored):
    path = tmp_path / "set.parquet"
    assert write_problems([*stored[:20], stored[0]], path) == 20
    for one, other in zip(stored, read_problems(path)):
        assert (one.kind, one.scene, one.t, one.outcome, one.lcp) == (
            other.kind,
            other.scene,
            other.t,
            other.outcome,
            other.lcp,
        )
        for name in ("A0", "A1", "b", "y", "x"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_problem_of_the_slider_bar():
    """Sizes of the paper: 5 pairs while slipping, 9 while sticking; no friction, no problem."""
    scene = load_scene("slider-bar-case-1")
    bodies = scene.bodies.values()
    q = np.array([x for body in bodies for x in (*body.position, body.angle)])
    v = np.array([x for body in bodies for x in (*body.velocity, body.angular_velocity)])
    assert len(problem_at("", scene, 0.0, q, v, 1e-9).b) == 9
    assert len(problem_at("", scene, 0.0, q, v + np.array([1, 0, 0, 1, 0, 0]), 1e-9).b) == 5
    assert problem_at("", load_scene("slider-bar-case-1-frictionless"), 0.0, q, v, 1e-9) is None


def test_replay_of_lemke(in_this_process):
    table = replay().set_index("class")
    judged = [name for name in replays.OUTCOMES]
    assert (table[judged].sum(axis=1) == table["problems"]).all()
    assert not table["wrong"].any() and not table["raised"].any()
    assert (
        table.loc["random scenes: a ray with equal weights", "none found"]
        == table.loc["random scenes: a ray with equal weights", "problems"]
    )
    assert (
        table.loc["random scenes: one guide", "solved"]
        == table.loc["random scenes: one guide", "problems"]
    )


def test_command(tmp_path, in_this_process):
    result = invoke("replay", "--out", tmp_path / "table.csv")
    assert len(pd.read_csv(tmp_path / "table.csv")) > 5
    (tmp_path / "set.parquet").write_text("no set")
    for arguments in (
        ["--solver", "nosuch:solve"],
        ["--problems", str(tmp_path / "set.parquet")],
        ["--problems", "nowhere.parquet"],
    ):
        result = invoke("replay", *arguments, exit_code=BAD_INPUT)
        assert "Traceback" not in result.output, result.output


def test_classes_that_crash_are_no_success(tmp_path, monkeypatch):
    """A solver that crashes on everything but the smallest problems: some classes come out, and the command says that others did not."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "crashing_solver.py").write_text(
        "import os\n\ndef solve(M, q):\n    if len(q) > 4:\n        os.abort()\n"
    )
    result = invoke("replay", "--solver", "crashing_solver:solve", exit_code=1)
    assert "classes failed" in result.output and "SIGABRT" in result.output, result.output
