"""Stored complementarity problems, with their solutions and the instants at which they occurred.

The problems have the form of eqs. (34)-(38) of the paper,

    A0 y = A1 x + b,   y >= 0,  x >= 0,  y^T x = 0 .

A set of problems is a Parquet file with one row for each problem.
`bench.complementarity.exchange.FIELDS` explains the columns. Matrices are stored row by row, and
``n`` is the number of pairs (y_i, x_i).
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

SOLVED = "solved"
"""Outcome: the reference has found a solution."""
UNSOLVABLE = "no solution"
"""Outcome: the reference has found that there is no solution."""
STORED = "hard-problems-3.parquet"
"""The set of the suite, written by ``tests/support/collect_problems.py``.

If the set changes, its number is increased, so that results refer to their set.
"""
COLUMNS = ["class", "scene", "t", "n", "A0", "A1", "b", "y", "x", "outcome", "lcp"]
"""Columns of a set."""
AT_REST = 1e-9
"""Slip speed, relative to the largest speed of the run, up to which a guide counts as sticking."""
PER_RUN = 12
"""Largest number of problems of one run. Further ones of a periodic motion would be similar."""
RANK_TOLERANCE = 1e-9
"""Singular value below which A0 counts as singular, with rows scaled to a largest element of 1."""


@dataclass(frozen=True)
class Problem:
    """A complementarity problem with n pairs.

    Attributes
    ----------
    kind : str
        Why the problem is hard; the column ``class``.
    scene : str
        Name of the scene.
    t : float
        Time, s.
    A0, A1 : ndarray, shape (n, n)
    b : ndarray, shape (n,)
    y, x : ndarray, shape (n,) or (0,)
        Solution; empty if there is none.
    outcome : str
        `SOLVED` or `UNSOLVABLE`.
    lcp : bool
        True if A0 is regular, so that the problem is a linear complementarity problem.
    """

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
    """Return the HLCP at a state, with its solution by the reference.

    Parameters
    ----------
    kind : str
        Field of the problem.
    scene : Scene
    t : float
        Time, s.
    q, v : ndarray, shape (3 * bodies,)
        Positions and velocities.
    rest_speed : float
        Slip speed up to which a guide sticks, m/s.

    Returns
    -------
    Problem or None
        None if there is no friction, or if the reference cannot determine whether there is a
        solution. Least-squares solutions of contradictory redundant constraints do not count as
        solutions.
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
    is_solved = outcome == FOUND and hlcp.residual(A0, A1, b, y, x) <= hlcp.ACCURATE
    row_sizes = np.abs(A0).max(axis=1, keepdims=True)
    rank = np.linalg.matrix_rank(A0 / row_sizes, RANK_TOLERANCE)
    return Problem(
        kind=kind,
        scene=scene.name,
        t=float(t),
        A0=A0,
        A1=A1,
        b=b,
        y=np.array(y) if is_solved else np.zeros(0),
        x=np.array(x) if is_solved else np.zeros(0),
        outcome=SOLVED if is_solved else UNSOLVABLE,
        lcp=bool(rank == len(b)),
    )


def problems_met(
    kind: str, scene: Scene, run: Trajectory | Run, everywhere: bool = False
) -> list[Problem]:
    """Return problems that occur in a run of the reference.

    These are the problems at the start, before the first events, and at the end; with `everywhere`,
    those at all samples and on both sides of all events.
    """
    states = list(_states(scene, run, everywhere))
    largest_speed = max((float(np.max(np.abs(v))) for _, _, v in states), default=0.0)
    problems = []
    for t, q, v in states:
        problem = problem_at(kind, scene, t, q, v, AT_REST * largest_speed)
        if problem is not None:
            problems.append(problem)
    return problems


def _states(
    scene: Scene, run: Trajectory | Run, everywhere: bool
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Yield time, positions q and velocities v of the states of `problems_met`, in order of time.

    A run without samples yields the start of the scene.
    """
    from stiction.reference_impl.multibody.mechanism import Mechanism

    if not len(run.t):
        yield 0.0, *Mechanism(scene, "none").initial_state()
        return
    position_labels, velocity_labels = BODY_COLUMNS[:2]
    positions = [f"{body}.{label}" for body in scene.bodies for label in position_labels]
    velocities = [f"{body}.{label}" for body in scene.bodies for label in velocity_labels]

    # Samples, and sides of events. Events of an independent part of the scene do not contain the
    # coordinates of the other bodies; they are left out.
    rows: list[tuple[float, Mapping[str, float]]] = list(zip(run.t, rows_of(run.columns)))
    events = run.events
    if not everywhere:
        rows = [rows[0], rows[-1]]
        events = events[: PER_RUN - len(rows)]
    for event in events:
        sides = (event.before, event.after) if everywhere else (event.before,)
        rows += [(event.time, side) for side in sides if side.keys() >= {*positions, *velocities}]
    for t, row in sorted(rows, key=itemgetter(0)):
        q = np.array([row[name] for name in positions])
        v = np.array([row[name] for name in velocities])
        yield t, q, v


def write_problems(problems: Iterable[Problem], path: str | Path) -> int:
    """Write a set, and return the number of problems. Equal problems of a scene are written once."""
    import pandas as pd

    unique = {(p.scene, p.A0.tobytes(), p.A1.tobytes(), p.b.tobytes()): p for p in problems}
    # in the order of COLUMNS
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
    """Yield the problems of a set.

    Parameters
    ----------
    path : str or Path, optional
        A Parquet file, or a folder of `bench.complementarity.exchange`; the set of the suite if
        None.

    Raises
    ------
    InputError
        If the file or folder is not a set of problems.
    """
    import pandas as pd
    import pyarrow as pa

    if path is not None and Path(path).is_dir():
        from stiction.comparisons.bench.complementarity.exchange import read_folder

        yield from read_folder(path)
        return
    if path is None:
        file = resources.files("stiction.comparisons") / "data" / STORED
    else:
        file = Path(path)
    try:
        rows = pd.read_parquet(file, columns=COLUMNS)
    except (OSError, pa.ArrowException) as error:
        reason = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        raise InputError(
            f"{file}: found {reason}; expected a set of problems, a Parquet file with the columns "
            f"{', '.join(COLUMNS)}"
        ) from None
    for kind, scene, t, n, A0, A1, *rest in rows.itertuples(index=False, name=None):
        yield Problem(kind, scene, t, A0.reshape(n, n), A1.reshape(n, n), *rest)
