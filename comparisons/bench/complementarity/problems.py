"""Stored complementarity problems, with their solutions and the instants at which they were met.

A set is one Parquet file, a row a problem of the form of eqs. (34)-(38)

    A0 y = A1 x + b,   y >= 0,  x >= 0,  y^T x = 0 .

Its columns are those of `bench.complementarity.exchange.FIELDS`, matrices row by row, and ``n``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.atomic_files import whole_file
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.event_values import rows_of

if TYPE_CHECKING:
    from stiction.reference_impl.integration.result import Run

SOLVED, UNSOLVABLE = "solved", "no solution"
STORED = "hard-problems-3.parquet"
"""The set that comes with the suite, made by ``tests/support/collect_problems.py``.

A changed set gets the next number, so that results name their set.
"""
COLUMNS = ["class", "scene", "t", "n", "A0", "A1", "b", "y", "x", "outcome", "lcp"]
AT_REST = 1e-9
"""Slip speed, relative to the largest speed of the run, up to which a guide belongs to the stick set."""
PER_RUN = 12
"""Problems kept of one run: more of a periodic motion say the same."""


@dataclass(frozen=True)
class Problem:
    """One problem; attributes as the columns of a stored set, matrices of shape (n, n)."""

    kind: str
    scene: str
    t: float
    A0: np.ndarray
    A1: np.ndarray
    b: np.ndarray
    y: np.ndarray
    x: np.ndarray
    outcome: str
    lcp: bool


def problem_at(
    kind: str, scene: Scene, t: float, q: np.ndarray, v: np.ndarray, rest_speed: float
) -> Problem | None:
    """The HLCP at a state (q, v of shape (3 * bodies,)) with its solution by the reference.

    None without friction, or where it is not known whether there is a solution. The least-squares answer of redundant
    constraints that contradict each other is none.
    """
    from stiction.reference_impl.friction import hlcp
    from stiction.reference_impl.friction.outcomes import NONE
    from stiction.reference_impl.friction.outcomes import SOLVED as FOUND
    from stiction.reference_impl.multibody.dynamics import row_form
    from stiction.reference_impl.multibody.mechanism import Mechanism, workspace

    m = Mechanism(scene, "none").arrays
    if not len(m.friction):
        return None
    w = workspace(m)
    row_form(m, w, t, q, v)
    slip = np.where(np.abs(w.slip_speed) <= rest_speed, 0, np.sign(w.slip_speed)).astype(np.int64)
    _, y, x, outcome, *_ = hlcp.solve(m, w, slip)
    if outcome not in (FOUND, NONE):
        return None
    A0, A1, b, *_ = hlcp.assemble(m, w, slip)
    solved = outcome == FOUND and hlcp.residual(A0, A1, b, y, x) <= hlcp.ACCURATE
    y, x = (np.array(value) if solved else np.zeros(0) for value in (y, x))
    return Problem(
        kind,
        scene.name,
        float(t),
        A0,
        A1,
        b,
        y,
        x,
        SOLVED if solved else UNSOLVABLE,
        bool(np.linalg.matrix_rank(A0 / np.abs(A0).max(axis=1, keepdims=True), 1e-9) == len(b)),
    )


def problems_met(
    kind: str, scene: Scene, run: Trajectory | Run, everywhere: bool = False
) -> list[Problem]:
    """Problems at the start, before the first events and at the end of a run of the reference.

    With `everywhere` those at each row and on both sides of each event.
    """
    states = list(_states(scene, run, everywhere))
    speed = max((float(np.max(np.abs(v))) for _, _, v in states), default=0.0)
    problems = (problem_at(kind, scene, t, q, v, AT_REST * speed) for t, q, v in states)
    return [problem for problem in problems if problem is not None]


def _states(
    scene: Scene, run: Trajectory | Run, everywhere: bool
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Yield times and states (q, v) of a run, in order; the start of the scene where the run has none."""
    from stiction.reference_impl.multibody.mechanism import Mechanism

    if not len(run.t):
        yield 0.0, *Mechanism(scene, "none").initial_state()
        return
    names = [
        [f"{body}.{label}" for body in scene.bodies for label in labels]
        for labels in BODY_COLUMNS[:2]
    ]
    samples: list[tuple[float, Mapping[str, float]]] = list(zip(run.t, rows_of(run.columns)))
    events = run.events if everywhere else run.events[: PER_RUN - 2]
    # An event of a part of the scene has not all coordinates: it gives no state of the whole.
    sides = [
        (event.time, side)
        for event in events
        for side in ((event.before, event.after) if everywhere else (event.before,))
        if side.keys() >= {*names[0], *names[1]}
    ]
    for t, columns in sorted(
        [*(samples if everywhere else [samples[0], samples[-1]]), *sides], key=itemgetter(0)
    ):
        q, v = (np.array([columns[name] for name in part]) for part in names)
        yield t, q, v


def write_problems(problems: Iterable[Problem], path: str | Path) -> int:
    """Write a set; returns the number of problems. Equal ones of a scene are written once."""
    import pandas as pd

    unique = {(p.scene, p.A0.tobytes(), p.A1.tobytes(), p.b.tobytes()): p for p in problems}
    rows = [
        (
            p.kind,
            p.scene,
            p.t,
            len(p.b),
            p.A0.ravel(),
            p.A1.ravel(),
            p.b,
            p.y,
            p.x,
            p.outcome,
            p.lcp,
        )
        for p in unique.values()
    ]
    with whole_file(path) as partial:
        pd.DataFrame(rows, columns=COLUMNS).to_parquet(partial, index=False, compression="zstd")
    return len(rows)


def read_problems(path: str | Path | None = None) -> Iterator[Problem]:
    """Read a set: a file, a folder of `bench.complementarity.exchange`, or where None that of the suite.

    Raises InputError if it is no such set.
    """
    import pandas as pd
    import pyarrow as pa

    if path is not None and Path(path).is_dir():
        from stiction.comparisons.bench.complementarity.exchange import read_folder

        yield from read_folder(path)
        return
    where = (
        resources.files("stiction.comparisons") / "data" / STORED if path is None else Path(path)
    )
    try:
        rows = pd.read_parquet(where, columns=COLUMNS)
    except (OSError, pa.ArrowException) as error:
        words = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        raise InputError(
            f"{where}: found {words}; expected a set of problems, a Parquet file with the columns "
            f"{', '.join(COLUMNS)}"
        ) from None
    for kind, scene, t, n, A0, A1, *rest in rows.itertuples(index=False, name=None):
        yield Problem(kind, scene, t, A0.reshape(n, n), A1.reshape(n, n), *rest)
