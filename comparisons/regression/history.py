"""The history of nightly runs: the results of all runs, in one SQLite file.

pandas reads it in one line::

    pd.read_sql("SELECT * FROM history", sqlite3.connect("nightly/history.sqlite"))

There is one row per number, with the following columns. A failed run has one row, without a number.

    night        start of the night (UTC, ISO 8601); it identifies the night and defines the order
    campaign     name of the campaign
    machine      `environment.conditions`: processor, interpreter and numerical libraries. Only times with equal
                 conditions are compared
    commit_hash  commit of the checkout, with ``-dirty`` if files differ from it; NULL outside a checkout
    finished     end of the night (UTC); NULL while it runs, or if it was interrupted and not resumed
    verdict      ``fine``, ``regression`` or ``could not run``; NULL until the night is finished
    key          ``<scene>/<variant>/<parameter>=<step>``, the name of the run in the campaign
    identity     identifies the same run in different nights: `measurement.PlannedRun.identity`
    scene, variant, engine, version, fidelity, parameter, step
    status       a `stiction.engines.status.Status`: ``ok``, ``refused``, ``failed``, ``timed out``, ``crashed``,
                 ``missing``, ``wrong`` or ``not run``
    reason       reason for the status in one line; empty if the run reached its end
    settings     settings of the run, as JSON
    metric       key of the measured quantity, for example ``position_error``
    kind         ``accuracy``, ``motion``, ``event``, ``drift``, ``counter`` or ``time``; ``truth`` in rows of truths
                 (variant ``truth``)
    value        the number; NULL if there is none
    uncertainty  uncertainty of the value, in the same unit; NULL if unknown
    tier         a `stiction.truths.Tier`, of the truth with which the value was computed; ``our own run`` for counters
                 and times

Why SQLite: a run and its numbers are written in one transaction, so that a process killed at any moment leaves either
all of them or none. The night and the key of a run are the primary key, so that no run is stored twice. With
write-ahead logging (WAL), other processes can read the file while a night is written. With ``synchronous = FULL`` a
transaction is on the disk before it counts as written, so that it also survives a power failure. The file must be on
a local disk, because WAL does not work over a network.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.timing.calibration import TIME
from stiction.comparisons.regression.night_changes import engine_versions
from stiction.engines.status import Status
from stiction.scenes import StictionError
from stiction.scenes.atomic_files import NotWritten
from stiction.truths import Tier

PRIMARY_CODE = 0xFF
"""Bits of SQLite's extended codes of errors that are the code of the kind."""
FORMAT = 2
"""``PRAGMA user_version`` of the file."""

_SCHEMA = f"""
CREATE TABLE nights (
    night TEXT PRIMARY KEY, campaign TEXT NOT NULL, digest TEXT NOT NULL, machine TEXT NOT NULL, commit_hash TEXT,
    origin TEXT NOT NULL, finished TEXT, verdict TEXT) STRICT;
CREATE TABLE runs (
    night TEXT NOT NULL REFERENCES nights, key TEXT NOT NULL, identity TEXT NOT NULL, scene TEXT NOT NULL,
    variant TEXT NOT NULL, engine TEXT NOT NULL, version TEXT, fidelity TEXT NOT NULL, parameter TEXT NOT NULL,
    step REAL NOT NULL, status TEXT NOT NULL, reason TEXT NOT NULL, settings TEXT, PRIMARY KEY (night, key)) STRICT;
CREATE TABLE metrics (
    night TEXT NOT NULL, key TEXT NOT NULL, metric TEXT NOT NULL, kind TEXT NOT NULL, value REAL, uncertainty REAL,
    tier TEXT NOT NULL, PRIMARY KEY (night, key, metric), FOREIGN KEY (night, key) REFERENCES runs) STRICT;
CREATE VIEW history AS
    SELECT night, campaign, machine, commit_hash, finished, verdict, key, identity, scene, variant, engine, version,
           fidelity, parameter, step, status, reason, settings, metric, kind, value, uncertainty, tier
    FROM runs JOIN nights USING (night) LEFT JOIN metrics USING (night, key)
    ORDER BY night, runs.rowid, metrics.rowid;
PRAGMA user_version = {FORMAT};
"""
NO_DRAW = "identity NOT LIKE 'random; %'"
"""Condition on runs: older histories also hold scenes that a night drew at random, which nothing
reads any more."""
_RUN = "key, identity, scene, variant, engine, version, fidelity, parameter, step, status, reason"
"""Columns of a run that are fields of a `Row` of the same names, before its settings."""


class HistoryRefused(StictionError):
    """The file is no history, or one of another format."""


class History:
    """An open history; see the module for what is in it."""

    def __init__(self, connection: sqlite3.Connection):
        self._connection = connection

    @property
    def connection(self) -> sqlite3.Connection:
        """The connection, to read tables by queries of one's own."""
        return self._connection

    def begin(self, campaign: str, digest: str, origin: Mapping[str, Any]) -> str:
        """Return the night to go on with: the last one, if it was cut off with the same digest, else a new one.

        The digest stands for all that the numbers depend on; `origin` is that of `environment.origin`.
        """
        last = self._connection.execute(
            "SELECT night, digest, finished FROM nights ORDER BY night DESC LIMIT 1"
        ).fetchone()
        if last is not None and last[1:] == (digest, None):
            return last[0]
        night = _now()
        with self._connection:
            self._connection.execute(
                "INSERT INTO nights VALUES (?, ?, ?, ?, ?, ?, NULL, NULL)",
                (
                    night,
                    campaign,
                    digest,
                    origin["conditions"],
                    origin["commit"],
                    json.dumps(origin),
                ),
            )
        return night

    def append(self, night: str, row: Row) -> None:
        """Add a run and its numbers, all or nothing; `sqlite3.IntegrityError` if the night has the run already."""
        fields = [getattr(row, name) for name in _RUN.split(", ")]
        settings = None if row.settings is None else json.dumps(row.settings, default=str)
        with self._connection:
            self._connection.execute(
                f"INSERT INTO runs VALUES ({', '.join('?' * 13)})", (night, *fields, settings)
            )
            self._connection.executemany(
                "INSERT INTO metrics VALUES (?, ?, ?, ?, ?, ?, ?)",
                [
                    (
                        night,
                        row.key,
                        metric.name,
                        metric.kind,
                        metric.value,
                        metric.uncertainty,
                        metric.tier,
                    )
                    for metric in row.metrics
                ],
            )

    def finish(self, night: str, verdict: str) -> None:
        with self._connection:
            self._connection.execute(
                "UPDATE nights SET finished = ?, verdict = ? WHERE night = ?",
                (_now(), verdict, night),
            )

    def rows(self, night: str) -> list[Row]:
        """Return the rows that the night has so far, in the order in which they were added."""
        return self._rows("night = ?", night)

    def first(self, identity: str, before: str) -> tuple[str, Row] | None:
        """Return the first finished night before another one in which a run of an identity succeeded or was refused.

        With it comes the row of the run, whatever its name.
        """
        found = self._connection.execute(
            "SELECT night, key FROM runs JOIN nights USING (night) WHERE identity = ? AND night < ? "
            "AND finished IS NOT NULL AND status IN (?, ?) ORDER BY night LIMIT 1",
            (identity, before, Status.OK, Status.REFUSED),
        ).fetchone()
        return None if found is None else (found[0], self._rows("night = ? AND key = ?", *found)[0])

    def _rows(self, where: str, *values: str) -> list[Row]:
        metrics: dict[str, list[tuple[Any, ...]]] = {}
        numbers = self._connection.execute(
            f"SELECT key, metric, kind, value, uncertainty, tier FROM metrics WHERE {where} ORDER BY rowid",
            values,
        )
        for key, *metric in numbers:
            metrics.setdefault(key, []).append(metric)
        runs = self._connection.execute(
            f"SELECT {_RUN}, settings FROM runs WHERE {where} AND {NO_DRAW} ORDER BY rowid", values
        )
        return [
            Row(
                *(
                    *run,
                    Status(status),
                    reason,
                    settings and json.loads(settings),
                    tuple(
                        Metric(*(*metric, Tier(tier))) for *metric, tier in metrics.get(run[0], ())
                    ),
                )
            )
            for *run, status, reason, settings in runs
        ]

    def origin(self, night: str) -> dict[str, Any]:
        """Return the `environment.origin` of its numbers."""
        return json.loads(
            self._connection.execute(
                "SELECT origin FROM nights WHERE night = ?", (night,)
            ).fetchone()[0]
        )

    def engines(self, night: str) -> dict[str, str]:
        """Return the versions of engines by name: of each in its last night up to this one in which it ran.

        A run that fails states no version. So an engine that crashes for some nights is compared with what it was
        before.
        """
        last: dict[str, str] = {}
        stated = self._connection.execute(
            "SELECT DISTINCT night, engine, version FROM runs "
            "WHERE version IS NOT NULL AND night <= ? ORDER BY night, rowid",
            (night,),
        ).fetchall()
        for when, engine, _ in stated:
            last[engine] = when
        return engine_versions(
            (engine, version) for when, engine, version in stated if when == last[engine]
        )

    def finished_before(self, night: str = "~") -> str | None:
        """Return the last night before another one that is finished."""
        return self._connection.execute(
            "SELECT max(night) FROM nights WHERE finished IS NOT NULL AND night < ?", (night,)
        ).fetchone()[0]

    def last_finished(self) -> str | None:
        return self._connection.execute(
            "SELECT max(night) FROM nights WHERE finished IS NOT NULL"
        ).fetchone()[0]

    def times(self, conditions: str, night: str = "~") -> dict[tuple[str, str], list[float]]:
        """Return times of finished nights before `night`, oldest first, by identity and engine of the run."""
        found: dict[tuple[str, str], list[float]] = {}
        for identity, engine, value in self._connection.execute(
            "SELECT identity, engine, value FROM history WHERE kind = 'time' AND metric = ? AND machine = ? "
            "AND finished IS NOT NULL AND night < ? ORDER BY night",
            (TIME, conditions, night),
        ):
            found.setdefault((identity, engine), []).append(value)
        return found


@contextmanager
def open_history(path: Path, write: bool = True) -> Iterator[History]:
    """Open the history in a file, made if it is not there.

    Raises `HistoryRefused` if the file cannot be used, and `NotWritten` if the disk is full: what is in there stays.
    """
    if path.is_dir():
        raise HistoryRefused(
            f"{path}: found a folder; expected the file of a history, such as "
            f"{path / 'history.sqlite'}"
        )
    address = f"{path.absolute().as_uri()}?mode={'rwc' if write else 'ro'}"
    try:
        with closing(sqlite3.connect(address, uri=True, timeout=60.0)) as connection:
            _prepare(path, connection, write)
            yield History(connection)
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & PRIMARY_CODE in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise NotWritten(path, OSError(str(error))) from error
        raise HistoryRefused(f"{path}: {error}") from error


def _prepare(path: Path, connection: sqlite3.Connection, write: bool) -> None:
    try:
        found = connection.execute("PRAGMA user_version").fetchone()[0]
        empty = not connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]
        if empty and write:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        elif found != FORMAT:
            what = "an empty file" if empty else f"a database of format {found}"
            raise HistoryRefused(
                f"{path}: found {what}; expected a history of format {FORMAT}, or no file"
            )
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
    except sqlite3.DatabaseError as error:
        raise HistoryRefused(f"{path}: {error}; expected a history, or no file") from error


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
