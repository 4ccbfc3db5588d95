"""Complementarity problems as Matrix Market files (NIST), one file a matrix, with a description of the fields.

A folder holds ``problems.json``, which says what the fields mean and lists the problems, and for problem i the files
``i-A0.mtx``, ``i-A1.mtx``, ``i-b.mtx`` and, where a solution is stored, ``i-y.mtx`` and ``i-x.mtx``, each in the dense
"array real general" form with 17 significant digits: what is read back is what was written, to the last bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from scipy.io import mmread, mmwrite

from stiction.comparisons.bench.complementarity.problems import SOLVED, UNSOLVABLE, Problem
from stiction.scenes import InputError

INDEX = "problems.json"
FORMAT = "stiction complementarity problems 1"
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
PARTS = ("A0", "A1", "b", "y", "x")
_DIGITS = 17


def write_folder(problems: Iterable[Problem], folder: str | Path) -> int:
    """Write problems to a new or empty folder, InputError for another; returns how many."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InputError(f"{folder}: found files in it; expected a new or empty folder")
    listed = []
    for i, problem in enumerate(problems):
        parts = {name: getattr(problem, name) for name in PARTS}
        files = {f"{i}-{name}.mtx": (name, values) for name, values in parts.items() if len(values)}
        for file, (name, values) in files.items():
            mmwrite(
                folder / file,
                values.reshape(len(values), -1),
                precision=_DIGITS,
                symmetry="general",
                comment=f"{name} of problem {i}: {problem.kind}, {problem.scene}",
            )
        listed.append(
            {
                "number": i,
                "n": len(problem.b),
                "class": problem.kind,
                "scene": problem.scene,
                "t": problem.t,
                "outcome": problem.outcome,
                "lcp": problem.lcp,
                "files": list(files),
            }
        )
    index = json.dumps({"format": FORMAT, "fields": FIELDS, "problems": listed}, indent=1)
    (folder / INDEX).write_text(index + "\n", encoding="utf-8")
    return len(listed)


def read_folder(folder: str | Path) -> Iterator[Problem]:
    """Read the problems that `write_folder` has written; InputError if a file is missing or is something else."""
    folder = Path(folder)
    try:
        index = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        if index["format"] != FORMAT:
            raise InputError(f"format: found {index['format']!r}; expected {FORMAT!r}")
        for entry in index["problems"]:
            n, solved = entry["n"], len(entry["files"]) == len(PARTS)
            parts = {
                name: np.asarray(mmread(folder / f"{entry['number']}-{name}.mtx"), dtype=float)
                for name in PARTS[: 5 if solved else 3]
            }
            shapes = tuple(parts[name].shape for name in PARTS[:3])
            if shapes != ((n, n), (n, n), (n, 1)):
                raise InputError(
                    f"problem {entry['number']}: found shapes {shapes}; expected n = {n}"
                )
            b, y, x = (parts.get(name, np.zeros(0)).ravel() for name in PARTS[2:])
            yield Problem(
                entry["class"],
                entry["scene"],
                entry["t"],
                parts["A0"],
                parts["A1"],
                b,
                y,
                x,
                entry["outcome"],
                entry["lcp"],
            )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder}: {error}; expected a folder that `stiction replay --export` has written"
        ) from None
