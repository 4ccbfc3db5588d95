"""Reading of run folders: tables, provenance, and the results of the run with trajectories and truths."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation.cells import TRAJECTORY
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import OWN_CPU, Record, Variant
from stiction.engines.isolation import Outcome
from stiction.reports.run_folder.data import TRUTH, truth_file
from stiction.reports.run_folder.overwriting import PROVENANCE
from stiction.reports.run_folder.reproduce import read_scenes
from stiction.scenes import Cost, Event, Fidelity, InputError, Trajectory
from stiction.scenes.trajectory import events_of
from stiction.truths import Tier, Truth

TABLES_OF_RUNS = ("runs", "variants", "parameters", "truths")
"""Tables that every run folder has, and that do not belong to a study."""


@dataclass(frozen=True)
class StoredRun:
    """A run folder that was read.

    Attributes
    ----------
    folder : Path
        The folder.
    origin : mapping
        The content of its ``provenance.json``.
    tables : mapping of str to DataFrame
        The tables of its data in full precision, by name. In tables with one row per run, the column
        `TRAJECTORY` contains the file of the trajectory.
    """

    folder: Path
    origin: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame]

    def validation(self) -> Results:
        """Return the results of the run with the stored trajectories, truths and scenes.

        A truth is interpolated linearly between its stored samples.
        """
        frame = pd.read_parquet(self.folder / "data" / "events.parquet")
        events = {
            str(key): events_of(rows.dropna(axis="columns", how="all"))
            for key, rows in frame.groupby("key", sort=False)
        }
        campaign = self.origin["campaign"]
        return Results(
            tuple(self._records(events)),
            self._truths(events),
            {
                name: table.drop(columns=TRAJECTORY, errors="ignore")
                for name, table in self.tables.items()
                if name not in TABLES_OF_RUNS
            },
            campaign,
            campaign["wall_time"],
            campaign["cpu_time"],
            scenes=read_scenes(self.folder, self.origin["files"]),
        )

    def _records(self, events: Mapping[str, tuple[Event, ...]]) -> Iterator[Record]:
        """Yield the runs; `events` contains the events of each run by its key."""
        runs = self.tables["runs"]
        if runs.empty:
            return
        steps = {name: tuple(rows["step"].unique()) for name, rows in runs.groupby("variant")}
        for row in runs.to_dict("records"):
            yield self._record(row, steps[row["variant"]], events.get(row["key"], ()))

    def _record(
        self, row: Mapping[str, Any], steps: tuple[float, ...], events: tuple[Event, ...]
    ) -> Record:
        """Return a run from its row of the table ``runs``; `steps` are all step sizes of its variant."""
        variant = Variant(
            row["variant"], row["engine"], row["parameter"], steps, Fidelity(row["fidelity"])
        )
        reason = row["reason"]
        trajectory = None
        if isinstance(row[TRAJECTORY], str):
            t, columns = _samples(pd.read_parquet(self.folder / row[TRAJECTORY]), events)
            trajectory = Trajectory(
                scene=row["scene"],
                engine=row["engine"],
                version=row["version"],
                fidelity=row["fidelity"],
                t=t,
                columns=columns,
                events=events,
                settings=json.loads(row["settings"]),
                cost=Cost(stepping_s=row["cpu_time"], engine_s=row[OWN_CPU]),
                termination=reason or "end",
            )
            # The trajectory contains the reason why it ended early; the run itself succeeded.
            reason = ""
        outcome = Outcome(row["key"], row["status"], trajectory, reason, wall_s=row["wall_time"])
        return Record(row["key"], row["scene"], variant, row["step"], outcome)

    def _truths(self, events: Mapping[str, tuple[Event, ...]]) -> dict[str, Truth]:
        """Return the stored truths by name; `events` contains their events by key."""
        truths = {}
        for file in self.origin["files"]:
            name = Path(file).stem
            if file == truth_file(name):
                truths[name] = self._truth(name, events.get(TRUTH + name, ()))
        return truths

    def _truth(self, name: str, events: tuple[Event, ...]) -> Truth:
        """Return a stored truth with its events."""
        frame = pd.read_parquet(self.folder / truth_file(name))
        t, columns = _samples(frame.drop(columns="tier"), events)

        def interpolate(times: np.ndarray, _: str) -> dict[str, np.ndarray]:
            return {column: np.interp(times, t, values) for column, values in columns.items()}

        rows = self.tables["truths"]
        uncertainty = rows[rows["truth"] == name].set_index("column")["uncertainty"].to_dict()
        tier = Tier(frame["tier"].iloc[0])
        return Truth(name, tier, float(t[-1]), interpolate, uncertainty, events)


def read_run(folder: str | Path) -> StoredRun:
    """Read a run folder, which `stiction.reports.write_report` has written.

    Raises
    ------
    InputError
        If the folder is not a run folder, or files are missing; the message names the first one.
    """
    folder = Path(folder)
    try:
        origin = json.loads((folder / PROVENANCE).read_text(encoding="utf-8"))
        files = [folder / name for name in origin["files"]]
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError):
        raise InputError(
            f"{folder}: found no {PROVENANCE} with a list of files; expected a run folder of "
            "`stiction validate`"
        ) from None
    missing = [path for path in files if not path.is_file()]
    if missing:
        raise InputError(
            f"{missing[0]}: missing; expected all {len(files)} files that {PROVENANCE} lists"
        )
    tables = {
        path.stem: pd.read_parquet(path)
        for path in sorted(files)
        if path.parent == folder / "data" and path.suffix == ".parquet" and path.stem != "events"
    }
    for name in TABLES_OF_RUNS:
        if name not in tables:
            raise InputError(
                f"{folder / 'data' / name}.parquet: not part of this folder; expected a run folder of "
                "this version of `stiction validate`"
            )
    return StoredRun(folder, origin, tables)


def _samples(
    frame: pd.DataFrame, events: tuple[Event, ...]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the times and columns of a stored motion without the two rows of each event.

    These rows follow a sample of the same time, if there is one.
    """
    t = frame["t"].to_numpy()
    times, counts = np.unique([event.time for event in events], return_counts=True)
    # The rows of all events at one time are the last ones with this time.
    ends = np.searchsorted(t, times, side="right")
    rows_of_events = [np.arange(end - 2 * count, end) for end, count in zip(ends, counts)]
    samples = frame.drop(index=np.concatenate([np.empty(0, int), *rows_of_events]))
    sample_times = samples.pop("t").to_numpy()
    return sample_times, {str(name): values.to_numpy() for name, values in samples.items()}
