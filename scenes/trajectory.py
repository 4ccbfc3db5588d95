"""Results of a simulation: trajectory, events, breakdown, cost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from stiction.scenes.base_errors import InputError
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.wording import shortened

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from stiction.scenes.model import Scene
    from stiction.scenes.pictures.picture import Picture


@dataclass(frozen=True)
class Event:
    """A change of the contact mode of a joint, of a drive with a limit, or of a spring that acts on one side.

    Attributes
    ----------
    time : float
        Instant of the change, s.
    kind : str
        ``"slip"`` (a stick phase ends), ``"stick"`` (a slip phase ends), ``"reversal"`` (the slip velocity changes its
        sign) or ``"corner"`` (a corner force reaches zero and contact passes to the opposite surface). A drive with a
        limit slips where it gives way, and sticks where it holds again. Of a spring that acts on one side,
        ``"contact"`` (its force begins) or ``"release"`` (its force ends).
    joint : str
        Name of the joint, drive or spring.
    before : Mapping[str, float]
        Left limits of the columns of the trajectory at this instant. An engine that integrates mechanically independent
        parts of a scene separately gives the columns of the part with this joint.
    after : Mapping[str, float]
        Right limits of the same columns.
    other_modes : int
        Number of other modes that are consistent with Coulomb's law at this instant. It is positive, for example, if
        several guides are at rest and any one of them could break away.
    """

    time: float
    kind: str
    joint: str
    before: Mapping[str, float] = field(repr=False)
    after: Mapping[str, float] = field(repr=False)
    other_modes: int = 0

    def jump(self, column: str) -> float:
        """Return the right limit of a column minus its left limit."""
        return self.after[column] - self.before[column]


def stacked(
    columns: Mapping[str, np.ndarray], bodies: Iterable[str], labels: Iterable[str]
) -> np.ndarray:
    """Return columns of bodies as one array.

    Parameters
    ----------
    columns
        Columns by name, each of shape (n,).
    bodies
        Names of the bodies.
    labels
        Names of the columns of each body, such as ``x``, ``y`` and ``angle``.

    Returns
    -------
    ndarray, shape (n, bodies * labels)
        All labels of the first body come first.
    """
    names = [f"{body}.{label}" for body, label in product(bodies, labels)]
    return np.stack([np.asarray(columns[name], dtype=float) for name in names], axis=1)


@dataclass(frozen=True)
class Breakdown:
    """The reason why a solver stopped before the end of the run.

    Attributes
    ----------
    kind : str
        The cause in one or two words, such as ``"no solution"`` or ``"several solutions"``.
    time : float
        Instant at which the solver stopped, s.
    reason : str
        The cause in a sentence.
    guide : str
        The guide whose friction problem is closest to losing its solution, or whose friction signs cycle; empty if
        there is none.
    solutions : int or None
        Number of possible continuations, if the solver counted them.
    """

    kind: str
    time: float
    reason: str
    guide: str = ""
    solutions: int | None = None

    def __str__(self) -> str:
        count = f" ({self.solutions})" if self.solutions else ""
        guide = f", {self.guide}" if self.guide else ""
        return f"{self.reason}{count} at t = {self.time:.12g} s{guide}"


@dataclass(frozen=True)
class Cost:
    """CPU time of a run, in seconds of the process, and counters.

    Attributes
    ----------
    setup_s : float
        Time from the scene to a model that is ready to step, without compilation.
    compile_s : float
        Just-in-time compilation.
    stepping_s : float
        Time from the first step to the last, including the requested output.
    counters : Mapping[str, int]
        Counters by name, for example ``steps``, ``rhs``, ``hlcp``, ``pivots``, ``events``.
    engine_s : float or None
        The part of `stepping_s` spent in the engine's own calls, without the adapter; None if it was not measured.
    output_s : float
        The rest of the engine's run, in which it makes columns and events from the states of its steps.
    gate_s : float
        Examination of the result (`stiction.engines.gate`). Like `output_s`, it is measured by `Engine.simulate`.
    """

    setup_s: float = 0.0
    compile_s: float = 0.0
    stepping_s: float = 0.0
    counters: Mapping[str, int] = field(default_factory=dict, repr=False)
    engine_s: float | None = None
    output_s: float = 0.0
    gate_s: float = 0.0

    @property
    def own_s(self) -> float:
        """CPU time by which engines are compared, s: `engine_s`, or `stepping_s` if that was not measured."""
        return self.stepping_s if self.engine_s is None else self.engine_s


@dataclass(frozen=True)
class Trajectory:
    """States, accelerations, reactions and events of one run.

    ``trajectory["guide.friction"]`` returns a column, ``trajectory[["slider.x", "bar.angle"]]`` a DataFrame.

    Attributes
    ----------
    scene : str
        Name of the scene.
    engine : str
        Name of the engine.
    version : str
        Version of the engine.
    fidelity : Fidelity
        ``"joint"`` or ``"contact"``.
    t : ndarray
        Output times, s, increasing; shape (n,).
    columns : Mapping[str, ndarray]
        Columns by name, such as ``guide.friction``, each of shape (n,). Names, units and sign conventions are listed in
        `stiction.scenes.columns.COLUMNS`.
    events : tuple of Event
        Events in order of time; empty for an engine that does not locate events.
    switches : tuple of Event
        Instants, known from the scene, at which a load steps, or a drive begins or ends a part of its law
        (`stiction.scenes.laws.law_switches`), with both sides: forces may jump there though no contact mode changes.
        Their kind is ``"switch"``, their joint the name of the load or drive. Only the reference reports them.
    settings : Mapping
        All settings that influence the numbers, including defaults: step or tolerance, iterations, stabilization,
        friction law and who supplies it.
    cost : Cost
        CPU time and counters.
    termination : str
        ``"end"`` if t_end was reached; otherwise the reason why the solver stopped earlier.
    breakdown : Breakdown or None
        The same reason in machine-readable form, if the engine knows it.
    alternatives : Mapping[str, ndarray]
        By the name of a column, shape (n, k): all values of a force that are consistent with the motion and Coulomb's
        law, in rows where there are several. In these rows the column itself is NaN; all other rows, and unused places
        of these rows, are NaN here. Empty if all forces are determined, and for engines that do not search for other
        solutions.
    mechanism : Scene or None
        The scene, added by `Engine.simulate`. None for a trajectory read from a run folder, which cannot be drawn.
    """

    scene: str
    engine: str
    version: str
    fidelity: Fidelity
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    events: tuple[Event, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    cost: Cost = field(default_factory=Cost)
    termination: str = "end"
    breakdown: Breakdown | None = None
    alternatives: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)
    switches: tuple[Event, ...] = ()
    mechanism: Scene | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        times = f"t = 0 .. {self.t[-1]:g} s, " if len(self.t) else ""
        end = "" if self.termination == "end" else f", ended: {shortened(self.termination)}"
        return (
            f"<Trajectory: {self.engine} {self.version} on {shortened(self.scene)}, "
            f"{self.fidelity}, {times}{len(self.t)} rows, {len(self.columns)} columns, "
            f"{len(self.events)} events{end}>"
        )

    @overload
    def __getitem__(self, column: str) -> np.ndarray: ...

    @overload
    def __getitem__(self, column: list[str]) -> pd.DataFrame: ...

    def __getitem__(self, column: str | list[str]) -> np.ndarray | pd.DataFrame:
        """Return a column as an array, or a list of columns as a DataFrame with the time as its index."""
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

    def plot(
        self, *columns: str, against: Iterable[Trajectory] = (), width_mm: float = 174.0
    ) -> Picture:
        """Plot columns over time, one panel per column.

        Parameters
        ----------
        *columns
            Names of columns. If none are given, the columns by which such a mechanism is judged.
        against
            Other runs to draw in the same panels; one of the reference is drawn last, on top.
        width_mm
            Width of the figure, mm: 174 is the width of a page with two columns, 84 that of one column.

        Returns
        -------
        Picture
            It is displayed by Jupyter; its method ``write("run.svg")`` writes a file (.svg, .pdf or .png).

        Raises
        ------
        KeyError
            If the trajectory has no such column.
        InputError
            If other runs are given without columns.
        """
        from stiction.scenes.pictures.evolution import evolution
        from stiction.scenes.pictures.picture import MM_PER_INCH

        runs = (self, *against)
        if len(runs) > 1 and not columns:
            raise InputError("columns: found none; expected those in which the runs are compared")
        return evolution(runs, columns, width_mm / MM_PER_INCH)

    def save(self, file: str | Path) -> None:
        """Write the whole trajectory to a Parquet file, without rounding.

        Parameters
        ----------
        file
            Path of the file, which `load` reads.
        """
        from stiction.scenes.trajectory_file import save_trajectory

        save_trajectory(self, file)

    @staticmethod
    def load(file: str | Path) -> Trajectory:
        """Read a trajectory written by `save`.

        Parameters
        ----------
        file
            Path of the file.

        Raises
        ------
        InputError
            If the file does not exist or was not written by `save`.
        """
        from stiction.scenes.trajectory_file import load_trajectory

        return load_trajectory(file)

    def animate(self, file: str | Path) -> int:
        """Write a film of the mechanism with its corner forces.

        Parameters
        ----------
        file
            Path of the film, with the extension .gif, .html, or .mp4 (which needs ffmpeg).

        Returns
        -------
        int
            Number of frames.

        Raises
        ------
        InputError
            If the film cannot be written to this path, or if `mechanism` is None.
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
        """Return the trajectory as Jupyter displays it."""
        from stiction.scenes.pictures.notebook import trajectory_html

        return trajectory_html(self)

    def to_frame(self, events: bool = False, interpolated: bool = False) -> pd.DataFrame:
        """Return the trajectory as a DataFrame with one row per output time.

        Parameters
        ----------
        events
            Add two rows per event and per switch of a law, with the left and right limits, so that a plot shows a jump
            as a vertical line; see `stiction.scenes.motion_table.with_sides`.
        interpolated
            How to fill the rows of an event in columns that the event does not contain, because they belong to an
            independent part of the scene: False for NaN, True for polynomial interpolation between output times, which
            satisfies the equations of motion less accurately.
        """
        import pandas as pd

        from stiction.scenes.motion_table import with_sides

        frame = pd.DataFrame({"t": self.t, **self.columns})
        if not events:
            return frame
        instants = sorted((*self.events, *self.switches), key=lambda event: event.time)
        return with_sides(frame, instants, interpolated)


def events_frame(events: Iterable[Event]) -> pd.DataFrame:
    """Return a table of events with the columns ``t``, ``kind``, ``joint``, ``before.NAME`` and ``after.NAME``.

    NAME is each column of the trajectory; a value that an event does not have is NaN.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for event in events:
        before = {f"before.{name}": value for name, value in event.before.items()}
        after = {f"after.{name}": value for name, value in event.after.items()}
        rows.append({"t": event.time, "kind": event.kind, "joint": event.joint, **before, **after})
    return pd.DataFrame(rows)


def events_of(frame: pd.DataFrame) -> tuple[Event, ...]:
    """Return the events of a table made by `events_frame`; columns that are NaN are absent from an event."""
    return tuple(
        Event(
            time=float(row["t"]),
            kind=row["kind"],
            joint=row["joint"],
            before=_values_with_prefix(row, "before."),
            after=_values_with_prefix(row, "after."),
        )
        for row in frame.to_dict("records")
    )


def _values_with_prefix(row: Mapping[Any, Any], prefix: str) -> dict[str, float]:
    """Return the values of a row whose names begin with a prefix, without the prefix; NaN is left out."""
    return {
        name.removeprefix(prefix): float(value)
        for name, value in row.items()
        if name.startswith(prefix) and not np.isnan(value)
    }
