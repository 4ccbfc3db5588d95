"""Complementarity problems decided with a proof, and problems as Matrix Market files."""

from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from collect_problems import MISSED, settled
from conftest import invoke
from flint import fmpq, fmpq_mat

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.complementarity.audited_run import write_problems_of_run
from stiction.comparisons.bench.complementarity.exchange import read_folder, write_folder
from stiction.comparisons.bench.complementarity.problems import SOLVED as STORED_SOLUTION
from stiction.comparisons.bench.complementarity.problems import UNSOLVABLE, Problem, read_problems
from stiction.comparisons.bench.complementarity.proof import (
    NONE,
    OPEN,
    SOLVED,
    Decision,
    Refutation,
    decide,
    holds,
)
from stiction.comparisons.bench.complementarity.replay import Answer, answer
from stiction.comparisons.bench.complementarity.verification import judge, verified
from stiction.engines import load_engine
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import load_scene


def lcp(M, q, y=(), x=()):
    """w = M z + q as a problem with y = w and x = z."""
    M, q = np.array(M, dtype=float), np.array(q, dtype=float)
    return Problem(
        "test",
        "test",
        0.0,
        np.eye(len(q)),
        M,
        q,
        np.array(y, dtype=float),
        np.array(x, dtype=float),
        STORED_SOLUTION if len(y) else UNSOLVABLE,
        True,
    )


@pytest.fixture(scope="module")
def stored():
    return list(read_problems())


@pytest.mark.parametrize(
    "M, q, expected",
    [
        ([[2, 1], [1, 2]], [-1, -1], SOLVED),  # a P-matrix
        ([[0, 0], [0, 0]], [1, 0], SOLVED),
        ([[-1]], [-1], NONE),  # w = -z - 1
        ([[0, 1], [-1, 0]], [-1, 1], SOLVED),
        ([[0, 1], [-1, 0]], [1, -1], NONE),  # w1 = z2 + 1 > 0, so z1 = 0, and w2 = -1
        ([[1, -2], [-2, 1]], [-1, -1], NONE),
    ],
)
def test_small_problems(M, q, expected):
    problem = lcp(M, q)
    verdict = decide(problem)
    assert verdict.decided == expected and holds(problem, verdict)


def test_solutions_are_exact():
    verdict = decide(lcp([[3]], [-1]))
    assert verdict.x == (fmpq(1, 3),) and verdict.y == (fmpq(0),) and verdict.isolated
    [x] = decide(lcp([[1]], [-0.1])).x
    assert (
        x == fmpq(*(0.1).as_integer_ratio()) != fmpq(1, 10)
    )  # the stored float, not what was meant
    assert not decide(lcp([[0]], [0])).isolated  # w = 0, any z


def test_a_pair_of_any_sign():
    """The same column in A0 and A1: y1 - x1 = -2, and the other pair y2 = -x2 + 3 (y1 - x1) + 7 = 1."""
    A0, A1 = np.array([[1.0, 0], [-3, 1]]), np.array([[1.0, 0], [-3, -1]])
    problem = replace(lcp(A1, [-2, 7]), A0=A0)
    verdict = decide(problem)
    assert holds(problem, verdict)
    assert verdict.x[0] == 2 and verdict.y[0] == 0


def test_against_all_choices():
    """Random matrices of small integers, where every choice is tried in rationals."""
    random = np.random.default_rng(5)
    found = {SOLVED: 0, NONE: 0}
    for _ in range(150):
        n = int(random.integers(1, 5))
        problem = lcp(random.integers(-3, 4, (n, n)), random.integers(-3, 3, n))
        verdict = decide(problem)
        assert verdict.decided != OPEN and holds(problem, verdict)
        found[verdict.decided] += 1
        if verdict.decided == NONE:
            for choice in product((0, 1), repeat=n):
                basis = fmpq_mat(np.where(choice, np.eye(n), -problem.A1).astype(int).tolist())
                if basis.det() != 0:
                    values = basis.solve(fmpq_mat([[int(value)] for value in problem.b]))
                    assert any(values[i, 0] < 0 for i in range(n))
    assert min(found.values()) > 20


def test_false_verdicts_do_not_hold(stored):
    problem = next(p for p in stored if p.outcome == STORED_SOLUTION)
    verdict = decide(problem)
    assert holds(problem, verdict)
    i = next(i for i, value in enumerate(verdict.x) if value > 0)
    for change in (fmpq(1, 10**30), -2 * verdict.x[i]):
        x = tuple(v + change if j == i else v for j, v in enumerate(verdict.x))
        assert not holds(problem, replace(verdict, x=x))
    assert not holds(problem, Decision(NONE))
    assert not holds(
        problem, Decision(NONE, refutations=(Refutation((), (fmpq(1),) * len(problem.b)),))
    )


def test_a_branch_left_out_is_noticed(stored):
    for problem in stored:
        if (
            problem.outcome == UNSOLVABLE
            and len(problem.b) < 17
            and len((verdict := decide(problem)).refutations) > 2
        ):
            break
    assert verdict.decided == NONE and holds(problem, verdict)
    for i in range(len(verdict.refutations)):
        assert not holds(
            problem,
            replace(verdict, refutations=verdict.refutations[:i] + verdict.refutations[i + 1 :]),
        )


def test_stored_problems_are_decided(stored):
    """A fifth of the set; all of it in the long test."""
    tried = [problem for problem in stored[::5] if len(problem.b) < 20]
    decided = [decide(problem).decided for problem in tried]
    assert decided.count(OPEN) <= 0.05 * len(decided)
    assert all(
        (verdict == NONE) == (problem.outcome == UNSOLVABLE)
        for problem, verdict in zip(tried, decided)
        if verdict != OPEN
    )


def test_no_solution_is_stored_of_a_problem_that_has_one(stored):
    """Three guides' worth of redundant forces: the reference shares them in one way, and finds none."""
    missed = [problem for problem in stored if problem.kind == MISSED]
    assert len(missed) == 3 and not any(problem.lcp for problem in missed)
    before = replace(missed[1], kind="before", y=np.zeros(0), x=np.zeros(0), outcome=UNSOLVABLE)
    after = settled(before)
    assert (after.kind, after.outcome) == (MISSED, STORED_SOLUTION)
    np.testing.assert_array_equal(after.x, missed[1].x)
    assert answer(lambda A0, A1, b: (after.y, after.x), after).outcome == "solved"
    none = next(problem for problem in stored if problem.outcome == UNSOLVABLE)
    assert settled(none) is none


@pytest.mark.long
def test_at_least_95_percent_of_the_set_are_decided():
    table = verified("stiction.comparisons.bench.complementarity.replay:lemke").set_index("class")
    assert table.loc["all", "not decided"] <= 0.05 * table.loc["all", "problems"]
    assert (
        table.loc["all", "misses a solution"] > 0
    )  # Lemke with a covering vector of ones ends on rays
    assert (
        table.loc["all", "solves what has none"] == table.loc["all", "stored outcome refuted"] == 0
    )


@pytest.mark.parametrize(
    "outcome, decided, expected",
    [
        ("solved", SOLVED, "right"),
        ("none found", SOLVED, "misses a solution"),
        ("rightly none", SOLVED, "misses a solution"),
        ("none found", NONE, "rightly none"),
        ("solved", NONE, "solves what has none"),
        ("wrong", SOLVED, "wrong"),
        ("solved", OPEN, "not judged"),
        ("raised", SOLVED, "not judged"),
        ("not an LCP", NONE, "not judged"),
    ],
)
def test_judgements(outcome, decided, expected):
    assert judge(Answer("", outcome, 0.0, 0.0), Decision(decided)) == expected


def some(stored):
    return [stored[0], next(p for p in stored if p.outcome == UNSOLVABLE), stored[-1]]


def test_a_folder_of_matrices_is_written_to_an_empty_one_and_read_whole(stored, tmp_path):
    assert write_folder(some(stored), tmp_path / "set") == 3
    with pytest.raises(ValueError, match="empty folder"):
        write_folder(some(stored), tmp_path / "set")
    (tmp_path / "set" / "1-A1.mtx").unlink()
    with pytest.raises(ValueError, match="1-A1.mtx"):
        list(read_problems(tmp_path / "set"))


@pytest.mark.parametrize("every, largest", [(8, 20), pytest.param(1, 1000, marks=pytest.mark.long)])
def test_the_set_comes_back_to_the_bit_with_the_same_verdicts(every, largest, stored, tmp_path):
    """All of it, or every eighth problem, in files; the verdicts on every fortieth, if it is no larger than this."""
    chosen = stored[::every]
    write_folder(chosen, tmp_path / "set")
    again = list(read_folder(tmp_path / "set"))
    for before, after in zip(chosen, again, strict=True):
        np.testing.assert_equal(asdict(before), asdict(after))
    for before, after in zip(chosen[:: 40 // every], again[:: 40 // every]):
        if len(before.b) > largest:
            continue
        verdict = decide(after)
        assert verdict == decide(before) and verdict.decided != OPEN and holds(before, verdict)


def test_command_exports_reads_back_and_verifies(stored, tmp_path):
    write_folder(some(stored), tmp_path / "some")
    assert (
        "3 problems"
        in invoke("replay --problems", tmp_path / "some", "--export", tmp_path / "again").output
    )
    ended = invoke(
        "replay --problems", tmp_path / "again", "--verify", "--out", tmp_path / "table.csv"
    )
    assert "not decided" in ended.output and (tmp_path / "table.csv").exists()
    invoke(
        "replay --problems", tmp_path / "again", "--export", tmp_path / "again", exit_code=BAD_INPUT
    )
    invoke("replay --verify --problems", tmp_path, exit_code=BAD_INPUT)


def test_command_verifies_what_a_run_meets(tmp_path, in_this_process):
    invoke("replay --run slider-bar-case-1 --set t_end=1 --verify --out", tmp_path / "table.csv")
    table = pd.read_csv(tmp_path / "table.csv").set_index("class")
    met = table.loc["run"]
    assert met["problems"] == met["solution"] == met["right"] >= 10
    assert met["not decided"] == met["stored outcome refuted"] == 0
    invoke("replay --run slider-bar-case-1 --set t_end=1 --export", tmp_path / "met")
    assert len(list(read_folder(tmp_path / "met"))) >= 10


def test_problems_of_a_run_are_those_of_its_steps_audits_and_events(tmp_path):
    scene = load_scene("slider-bar-case-1", {"t_end": 2})
    run = load_engine("reference").simulate(scene)
    mechanism = Mechanism(scene)

    def stepped(**options):
        return simulate_event_driven(
            mechanism, *consistent_start(mechanism), np.zeros(0), scene.t_end, 1e-9, **options
        )

    ends = [0.0]
    stepped(ends=ends)
    for steps in (1, 2, 17, len(ends) - 2):  # a run that is stopped there ends there
        assert stepped(step_limit=steps).breakdown.time == ends[steps]
    assert len(ends) - 1 == run.cost.counters["steps"] and (ends[0], ends[-1]) == (0, scene.t_end)
    assert run.events and {event.time for event in run.events} <= set(ends)
    write_problems_of_run(scene, tmp_path / "met.parquet")
    times = np.array([problem.t for problem in read_problems(tmp_path / "met.parquet")])
    assert set(ends) <= set(times)
    inside = times[~np.isin(times, ends)]  # one in each step
    steps = np.searchsorted(ends, inside)
    assert len(inside) == np.count_nonzero(np.diff(ends)) and len(set(steps)) == len(steps)


@pytest.mark.parametrize(
    "arguments, culprit",
    [
        ("--run slider-bar-case-1 --problems set.parquet", "both"),
        ("--set F0=4", "--run"),
        ("--run pendulum", "friction"),
        ("--run nothing", "nothing"),
    ],
)
def test_command_refuses_what_is_no_run(arguments, culprit, in_this_process):
    assert culprit in invoke(f"replay {arguments}", exit_code=BAD_INPUT).output
