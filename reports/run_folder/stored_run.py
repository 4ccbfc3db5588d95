"""A run folder read back: the results that were written, its tables as they are on disk, its provenance."""

from __future__ import annotations

import json
from collections.abc import Mapping
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
from stiction.scenes import Cost, Event, Fidelity, InputError, Trajectory
from stiction.scenes.trajectory import events_of
from stiction.truths import Tier, Truth

ABOUT_RUNS = ("runs", "variants", "parameters", "truths")
"""Tables of a run folder that are not of the comparisons."""


@dataclass(frozen=True)
class StoredRun:
    """A run folder."""

    folder: Path
    origin: Mapping[str, Any]
    """Its ``provenance.json``"""
    tables: Mapping[str, pd.DataFrame]
    """By name, in full precision; `TRAJECTORY` has the file of a row's trajectory"""

    def validation(self) -> Results:
        """Return the results, trajectories and truths included; a truth is straight between its stored samples."""
        events = pd.read_parquet(self.folder / "data" / "events.parquet")
        found = {
            str(key): events_of(rows.dropna(axis="columns", how="all"))
            for key, rows in events.groupby("key", sort=False)
        }
        truths = [
            Path(name).stem for name in self.origin["files"] if name == truth_file(Path(name).stem)
        ]
        runs = self.tables["runs"]
        steps = (
            {name: tuple(rows["step"].unique()) for name, rows in runs.groupby("variant")}
            if len(runs)
            else {}
        )
        records = [
            self._record(row, steps[row["variant"]], found.get(row["key"], ()))
            for row in runs.to_dict("records")
        ]
        campaign = self.origin["campaign"]
        tables = {
            name: table.drop(columns=TRAJECTORY, errors="ignore")
            for name, table in self.tables.items()
            if name not in ABOUT_RUNS
        }
        return Results(
            tuple(records),
            {name: self._truth(name, found.get(TRUTH + name, ())) for name in truths},
            tables,
            campaign,
            campaign["wall_time"],
            campaign["cpu_time"],
        )

    def _record(
        self, row: Mapping[str, Any], steps: tuple[float, ...], events: tuple[Event, ...]
    ) -> Record:
        variant = Variant(
            row["variant"], row["engine"], row["parameter"], steps, Fidelity(row["fidelity"])
        )
        reason, trajectory = row["reason"], None
        if isinstance(row[TRAJECTORY], str):
            t, columns = _samples(pd.read_parquet(self.folder / row[TRAJECTORY]), events)
            cost = Cost(stepping_s=row["cpu_time"], engine_s=row[OWN_CPU])
            trajectory = Trajectory(
                row["scene"],
                row["engine"],
                row["version"],
                row["fidelity"],
                t,
                columns,
                events,
                json.loads(row["settings"]),
                cost,
                reason or "end",
            )
        outcome = Outcome(
            row["key"],
            row["status"],
            trajectory,
            "" if trajectory else reason,
            wall_s=row["wall_time"],
        )
        return Record(row["key"], row["scene"], variant, row["step"], outcome)

    def _truth(self, name: str, events: tuple[Event, ...]) -> Truth:
        frame = pd.read_parquet(self.folder / truth_file(name))
        t, columns = _samples(frame.drop(columns="tier"), events)

        def at(times: np.ndarray, _: str) -> dict[str, np.ndarray]:
            return {column: np.interp(times, t, values) for column, values in columns.items()}

        known = self.tables["truths"]
        uncertainty = known[known["truth"] == name].set_index("column")["uncertainty"].to_dict()
        return Truth(name, Tier(frame["tier"].iloc[0]), float(t[-1]), at, uncertainty, events)


def read_run(folder: str | Path) -> StoredRun:
    """Read what `stiction.reports.write_report` has written; InputError names what is missing in any other folder."""
    folder = Path(folder)
    try:
        origin = json.loads((folder / PROVENANCE).read_text(encoding="utf-8"))
        files = [folder / name for name in origin["files"]]
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError):
        raise InputError(
            f"{folder}: found no {PROVENANCE} with a list of files; expected a run folder of "
            "`stiction validate`"
        ) from None
    if missing := [path for path in files if not path.is_file()]:
        raise InputError(
            f"{missing[0]}: missing; expected all {len(files)} files that {PROVENANCE} lists"
        )
    tables = {
        path.stem: pd.read_parquet(path)
        for path in sorted(files)
        if path.parent == folder / "data" and path.suffix == ".parquet" and path.stem != "events"
    }
    if absent := [name for name in ABOUT_RUNS if name not in tables]:
        raise InputError(
            f"{folder / 'data' / absent[0]}.parquet: not part of this folder; expected a run folder of "
            "this version of `stiction validate`"
        )
    return StoredRun(folder, origin, tables)


def _samples(
    frame: pd.DataFrame, events: tuple[Event, ...]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and columns without the two rows of each event, which stand behind a sample of the same time."""
    t = frame["t"].to_numpy()
    times, counts = np.unique([event.time for event in events], return_counts=True)
    ends = np.searchsorted(t, times, side="right")
    sides = [np.arange(end - 2 * count, end) for end, count in zip(ends, counts)]
    inserted = np.concatenate([np.empty(0, int), *sides])
    kept = frame.drop(index=inserted)
    return kept.pop("t").to_numpy(), {str(name): values.to_numpy() for name, values in kept.items()}
