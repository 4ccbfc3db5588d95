"""Results of a simulation: trajectory, events, breakdown, cost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from stiction.scenes.base_errors import InputError
from stiction.scenes.wording import shortened

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from stiction.scenes.model import Scene
    from stiction.scenes.pictures.picture import Picture


@dataclass(frozen=True)
class Event:
    """An instant, s, at which the contact mode of a joint, a guide, changes.

    Attributes
    ----------
    kind : str
        ``"slip"`` (stick ends), ``"stick"`` (slip ends), ``"reversal"`` (slip changes its direction), ``"corner"`` (a
        corner force passes zero and the other surface takes over).
    before, after : Mapping[str, float]
        The two-sided values of the columns of the trajectory: all, or those of the joint's part of the scene where an
        engine integrates parts that do not act on each other separately.
    other_modes : int
        How many other modes would have obeyed Coulomb's law: of several guides at rest, any may break away.
    """

    time: float
    kind: str
    joint: str
    before: Mapping[str, float] = field(repr=False)
    after: Mapping[str, float] = field(repr=False)
    other_modes: int = 0

    def jump(self, column: str) -> float:
        """Value after minus value before."""
        return self.after[column] - self.before[column]


def stacked(
    columns: Mapping[str, np.ndarray], bodies: Iterable[str], labels: Iterable[str]
) -> np.ndarray:
    """Columns of bodies as one array, (n, bodies * labels), body by body."""
    names = [f"{body}.{label}" for body, label in product(bodies, labels)]
    return np.stack([np.asarray(columns[name], dtype=float) for name in names], axis=1)


@dataclass(frozen=True)
class Breakdown:
    """Why a solver stopped before its time, s.

    Attributes
    ----------
    kind : str
        In one or two words, the same for the same cause, such as ``"no solution"``, ``"several solutions"``; `reason`
        has it in full.
    guide : str
        The one whose friction comes closest to losing its solution, or whose signs cycle; empty if none.
    solutions : int, optional
        How many motions can follow, where that was counted.
    """

    kind: str
    time: float
    reason: str
    guide: str = ""
    solutions: int | None = None

    def __str__(self) -> str:
        counted = f" ({self.solutions})" if self.solutions else ""
        return f"{self.reason}{counted} at t = {self.time:.12g} s" + (
            f", {self.guide}" if self.guide else ""
        )


@dataclass(frozen=True)
class Cost:
    """CPU time of the process (s), and counters by name.

    `setup_s`: from the scene to something that can step, without compiling. `compile_s`: just-in-time compilation.
    `stepping_s`: from the first step to the last, with the requested output. `counters`: e.g. ``steps``, ``rhs``,
    ``hlcp``, ``pivots``, ``events``. `engine_s`: the share of `stepping_s` inside the engine's own calls, without its
    adapter; None where it is not measured, and then the engine is counted whole.
    """

    setup_s: float = 0.0
    compile_s: float = 0.0
    stepping_s: float = 0.0
    counters: Mapping[str, int] = field(default_factory=dict, repr=False)
    engine_s: float | None = None

    @property
    def own_s(self) -> float:
        """Seconds by which engines are compared: `engine_s`, or all of `stepping_s`."""
        return self.stepping_s if self.engine_s is None else self.engine_s


@dataclass(frozen=True)
class Trajectory:
    """States, accelerations, reactions and events of one run.

    Attributes
    ----------
    scene, engine, version, fidelity : str
        What was simulated by what; fidelity ``"joint"`` or ``"contact"``.
    t : ndarray, shape (n,)
        Output times, increasing.
    columns : Mapping[str, ndarray]
        By name, such as ``guide.friction``, each of shape (n,); `stiction.scenes.columns.COLUMNS` lists them with
        their units and meanings.
    events : tuple of Event
        In order of time; empty for an engine that does not locate any.
    settings : Mapping
        Everything that influences the numbers, defaults included: step or tolerance, iterations,
        stabilization, friction law and who supplies it.
    cost : Cost
    termination : str
        ``"end"`` when t_end was reached; otherwise why the solver stopped earlier.
    breakdown : Breakdown, optional
        The same in data, where the engine knows it.
    alternatives : Mapping[str, ndarray]
        By the name of a column, shape (n, k): all values of a force that Coulomb's law allows for the same motion,
        where there are several. The column is NaN there, this is NaN elsewhere and behind the last value. Empty where
        all forces are determined, and for engines that do not look for other solutions.
    mechanism : Scene, optional
        Added by `Engine.simulate`; None for one of a run folder, which cannot be drawn.
    """

    scene: str
    engine: str
    version: str
    fidelity: str
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    events: tuple[Event, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    cost: Cost = field(default_factory=Cost)
    termination: str = "end"
    breakdown: Breakdown | None = None
    alternatives: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)
    mechanism: Scene | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        until = f"t = 0 .. {self.t[-1]:g} s, " if len(self.t) else ""
        ended = "" if self.termination == "end" else f", ended: {shortened(self.termination)}"
        return (
            f"<Trajectory: {self.engine} {self.version} on {shortened(self.scene)}, {self.fidelity}, {until}"
            f"{len(self.t)} rows, {len(self.columns)} columns, {len(self.events)} events{ended}>"
        )

    @overload
    def __getitem__(self, column: str) -> np.ndarray: ...

    @overload
    def __getitem__(self, column: list[str]) -> pd.DataFrame: ...

    def __getitem__(self, column: str | list[str]) -> np.ndarray | pd.DataFrame:
        if isinstance(column, list):
            import pandas as pd

            return pd.DataFrame(
                {name: self[name] for name in column}, index=pd.Index(self.t, name="t")
            )
        if column == "t":
            return self.t
        try:
            return self.columns[column]
        except KeyError:
            raise KeyError(
                f"{self.engine} on {self.scene} has no column {column!r}; it has: "
                + ", ".join(["t", *self.columns])
            ) from None

    def __contains__(self, column: str) -> bool:
        return column == "t" or column in self.columns

    def plot(self, *columns: str, against: Iterable[Trajectory] = ()) -> Picture:
        """A figure with a panel for each column over time; without columns, for what such a mechanism is judged by.

        It shows itself in Jupyter; ``plot().write("run.svg")`` makes a file (.svg, .pdf, .png). With other runs
        `against` this one each panel has a line for each of them.

        Raises
        ------
        KeyError
            For a column that is not there.
        InputError
            For other runs without columns.
        """
        from stiction.scenes.pictures.evolution import evolution

        runs = (self, *against)
        if len(runs) > 1 and not columns:
            raise InputError("columns: found none; expected those in which the runs are compared")
        return evolution(runs, columns)

    def save(self, file: str | Path) -> None:
        """Write all of it to a Parquet file, which `load` reads; nothing is rounded."""
        from stiction.scenes.trajectory_file import save_trajectory

        save_trajectory(self, file)

    @staticmethod
    def load(file: str | Path) -> Trajectory:
        """Read a file of `save`.

        Raises
        ------
        InputError
            For a file that is not there, or is none of `save`.
        """
        from stiction.scenes.trajectory_file import load_trajectory

        return load_trajectory(file)

    def animate(self, file: str | Path) -> int:
        """Write a film of the mechanism with its corner forces; returns the number of frames.

        The name ends in .gif, .html, or .mp4 where ffmpeg is installed.

        Raises
        ------
        InputError
            If the film cannot be written under this name, or if the mechanism is not known.
        """
        from pathlib import Path

        from stiction.scenes.pictures.animation import animate

        if self.mechanism is None:
            raise InputError(
                "mechanism: found None; "
                f"expected the trajectory of {self.scene} as Engine.simulate returns it"
            )
        return animate(self.mechanism, self, Path(file))

    def _repr_html_(self) -> str:
        from stiction.scenes.pictures.notebook import trajectory_html

        return trajectory_html(self)

    def to_frame(self, events: bool = False, interpolated: bool = False) -> pd.DataFrame:
        """A table with one row per output time.

        With `events`, two more rows per event, the values before and after it, so that a
        jump is a vertical line and not an interpolation; see `stiction.scenes.motion_table.with_sides`. An event of one
        of several independent parts of a scene has no values of the others: they are NaN in its rows or, if
        `interpolated`, polynomials between the rows of their own, which obey the equations of motion less exactly.
        """
        import pandas as pd

        from stiction.scenes.motion_table import with_sides

        frame = pd.DataFrame({"t": self.t, **self.columns})
        return with_sides(frame, self.events, interpolated) if events else frame


def events_frame(events: Iterable[Event]) -> pd.DataFrame:
    """A table of events: ``t, kind, joint``, then the values of all columns, ``before.NAME`` and ``after.NAME``."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "t": e.time,
                "kind": e.kind,
                "joint": e.joint,
                **{f"before.{k}": v for k, v in e.before.items()},
                **{f"after.{k}": v for k, v in e.after.items()},
            }
            for e in events
        ]
    )


def events_of(frame: pd.DataFrame) -> tuple[Event, ...]:
    """Events of a table of `events_frame`; what a row has no value for is no column of its event."""

    def side(row: dict[str, Any], name: str) -> dict[str, float]:
        return {
            key.removeprefix(name): float(value)
            for key, value in row.items()
            if key.startswith(name) and value == value
        }

    return tuple(
        Event(float(row["t"]), row["kind"], row["joint"], side(row, "before."), side(row, "after."))
        for row in frame.to_dict("records")
    )
