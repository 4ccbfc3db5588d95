"""Exchange of complementarity problems as Matrix Market files (NIST).

A folder contains ``problems.json``, which explains the fields and lists the problems. Problem i
consists of the files ``i-A0.mtx``, ``i-A1.mtx``, ``i-b.mtx`` and, if a solution is stored,
``i-y.mtx`` and ``i-x.mtx``, in the dense form "array real general". Numbers have 17 significant
digits, so that exactly the same floats are read again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import mmread, mmwrite

from stiction.comparisons.bench.complementarity.problems import SOLVED, UNSOLVABLE, Problem
from stiction.scenes import InputError

INDEX = "problems.json"
"""Name of the file that lists the problems."""
FORMAT = "stiction complementarity problems 1"
"""Name and version of the format, in the list of problems."""
FIELDS = {
    "problem": "A0 y = A1 x + b, y >= 0, x >= 0, y^T x = 0, with n pairs (y_i, x_i)",
    "A0, A1": "n x n matrices",
    "b": "n numbers",
    "y, x": "a solution in floats, n numbers each; no files where none is stored",
    "class": "why the problem is hard",
    "scene, t": "where it was met, and when (s)",
    "outcome": f"'{SOLVED}', or '{UNSOLVABLE}': the reference found none in any contact mode, redundant forces "
    f"(A0 singular) shared in one way; in the set of the suite none exists",
    "lcp": "whether A0 is regular, so that it is the LCP y = (A0^-1 A1) x + A0^-1 b",
}
PROBLEM_ARRAYS = ("A0", "A1", "b")
"""Fields of a `Problem` that define it."""
SOLUTION_ARRAYS = ("y", "x")
"""Fields of a `Problem` with its solution, which are empty if there is none."""
_DIGITS = 17
"""Significant digits that determine a float uniquely."""


def write_folder(problems: Iterable[Problem], folder: str | Path) -> int:
    """Write problems to a new or empty folder, and return their number; InputError for other folders."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InputError(f"{folder}: found files in it; expected a new or empty folder")
    entries = []
    for i, problem in enumerate(problems):
        entries.append(
            {
                "number": i,
                "n": len(problem.b),
                "class": problem.kind,
                "scene": problem.scene,
                "t": problem.t,
                "outcome": problem.outcome,
                "lcp": problem.lcp,
                "files": _write_arrays(problem, i, folder),
            }
        )
    index = json.dumps({"format": FORMAT, "fields": FIELDS, "problems": entries}, indent=1)
    (folder / INDEX).write_text(index + "\n", encoding="utf-8")
    return len(entries)


def _write_arrays(problem: Problem, number: int, folder: Path) -> list[str]:
    """Write the arrays of a problem, except empty ones, and return the names of the files."""
    files = []
    for name in (*PROBLEM_ARRAYS, *SOLUTION_ARRAYS):
        values = getattr(problem, name)
        if len(values) == 0:
            continue
        file = f"{number}-{name}.mtx"
        mmwrite(
            folder / file,
            values.reshape(len(values), -1),  # a vector as a column
            precision=_DIGITS,
            symmetry="general",
            comment=f"{name} of problem {number}: {problem.kind}, {problem.scene}",
        )
        files.append(file)
    return files


def read_folder(folder: str | Path) -> Iterator[Problem]:
    """Yield the problems in a folder of `write_folder`; InputError if a file is missing or invalid."""
    folder = Path(folder)
    try:
        index = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        if index["format"] != FORMAT:
            raise InputError(f"format: found {index['format']!r}; expected {FORMAT!r}")
        for entry in index["problems"]:
            yield _read_problem(entry, folder)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder}: {error}; expected a folder that `stiction replay --export` has written"
        ) from None


def _read_problem(entry: Mapping[str, Any], folder: Path) -> Problem:
    """Return the problem that an entry of the list of problems describes."""
    number, n = entry["number"], entry["n"]
    is_solved = len(entry["files"]) == len(PROBLEM_ARRAYS + SOLUTION_ARRAYS)
    arrays = {}
    for name in PROBLEM_ARRAYS + SOLUTION_ARRAYS if is_solved else PROBLEM_ARRAYS:
        arrays[name] = np.asarray(mmread(folder / f"{number}-{name}.mtx"), dtype=float)
    shapes = tuple(arrays[name].shape for name in PROBLEM_ARRAYS)
    if shapes != ((n, n), (n, n), (n, 1)):
        raise InputError(f"problem {number}: found shapes {shapes}; expected n = {n}")
    no_solution = np.zeros(0)
    return Problem(
        kind=entry["class"],
        scene=entry["scene"],
        t=entry["t"],
        A0=arrays["A0"],
        A1=arrays["A1"],
        b=arrays["b"].ravel(),
        y=arrays.get("y", no_solution).ravel(),
        x=arrays.get("x", no_solution).ravel(),
        outcome=entry["outcome"],
        lcp=entry["lcp"],
    )
