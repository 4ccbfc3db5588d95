"""The set of problems that comes with the suite: those of all hard cases, and of random scenes by what makes them hard.

    python tests/support/collect_problems.py FILE

The reference lets redundant constraints share their force in one way. Where it finds no solution with that, an exact
one can exist with another: "no solution" is stored only of problems of which none is proven (it takes the extra
``stiction[proof]``).
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
from random_mechanisms import extreme_scene

from stiction.comparisons.bench.complementarity import proof
from stiction.comparisons.bench.complementarity.problems import (
    SOLVED,
    Problem,
    problem_at,
    write_problems,
)
from stiction.comparisons.bench.complementarity.replay import answer, lemke
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.hard.examination import examine
from stiction.comparisons.hard.table import REFERENCE
from stiction.engines import EngineFailure, Refused
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

PER_CLASS = 40
MOST_SCENES = 6000
MISSED = "solved by another sharing of redundant forces"
"""Class of the problems for which the reference finds no solution, and which have one."""
LARGEST = 30
"""Pairs of a random problem at most: larger ones say the same and take more room."""


def of_hard_cases() -> Iterator[Problem]:
    """Those that the reference meets."""
    for case in hard_cases():
        try:
            yield from map(settled, examine(case.name, REFERENCE[0]).problems)
        except (Refused, EngineFailure):
            continue


def of_random_scenes(seed: int = 0) -> Iterator[Problem]:
    """Up to `PER_CLASS` of each kind, met at the start of random scenes."""
    kept: Counter[str] = Counter()
    for number in range(MOST_SCENES):
        scene = scene_from_dict(
            extreme_scene(np.random.default_rng([seed, number])), name=f"random {seed}/{number}"
        )
        q, v = Mechanism(scene, "none").initial_state()
        found = problem_at("", scene, 0.0, q, v, 1e-11 * float(np.max(np.abs(v))))
        if found is None or len(found.b) > LARGEST:
            continue
        kind = f"random scenes: {_kind(found, len(scene.frictional_guides))}"
        kept[kind] += 1
        if kept[kind] <= PER_CLASS:
            yield settled(replace(found, kind=kind))


def settled(problem: Problem) -> Problem:
    """The problem, or of one without solution that has one its exact solution in floats, and a class of its own."""
    if problem.outcome == SOLVED or (verdict := proof.decide(problem)).decided != proof.SOLVED:
        return problem
    y, x = (
        np.array([float(Fraction(int(u.p), int(u.q))) for u in part])
        for part in (verdict.y, verdict.x)
    )
    return replace(problem, kind=MISSED, y=y, x=x, outcome=SOLVED)


def _kind(problem: Problem, guides: int) -> str:
    if problem.outcome != SOLVED:
        return "no solution"
    if not problem.lcp:
        return "redundant"
    if answer(lemke, problem).outcome != "solved":
        return "a ray with equal weights"
    return "one guide" if guides == 1 else "several guides"


if __name__ == "__main__":
    print(write_problems([*of_hard_cases(), *of_random_scenes()], sys.argv[1]), "problems")
