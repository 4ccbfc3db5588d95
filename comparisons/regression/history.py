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
"""Bits of an extended error code of SQLite that contain the primary code, the kind of the error."""
FORMAT = 2
"""Version of the format, ``PRAGMA user_version`` of the file."""
TIMEOUT_S = 60.0
"""Time for which a process waits while another one writes to the file, s."""
AFTER_ALL_NIGHTS = "~"
"""A name that follows all nights in their order: nights begin with a digit."""

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
"""Condition on runs: older histories also contain randomly generated scenes, which are ignored."""
_RUN_COLUMNS = (
    "key",
    "identity",
    "scene",
    "variant",
    "engine",
    "version",
    "fidelity",
    "parameter",
    "step",
    "status",
    "reason",
)
"""Columns of the table of runs that are fields of a `Row`, with the same names and in the same order."""


class HistoryRefused(StictionError):
    """Raised if a file is no history, or one of another format."""


class History:
    """An open history, whose content is described in the docstring of the module."""

    def __init__(self, connection: sqlite3.Connection):
        self._connection = connection

    @property
    def connection(self) -> sqlite3.Connection:
        """The connection to the database, for other queries."""
        return self._connection

    def begin(self, campaign: str, digest: str, origin: Mapping[str, Any]) -> str:
        """Return the night to which runs are added: the last one if it was interrupted, or else a new one.

        Parameters
        ----------
        campaign
            Name of the campaign.
        digest
            Digest of all that the numbers depend on. An interrupted night with another digest is not resumed.
        origin
            The `environment.origin` of the numbers.
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
        """Add a run and all of its numbers to a night in one transaction.

        Raises
        ------
        sqlite3.IntegrityError
            If the night already has the run.
        """
        fields = [getattr(row, name) for name in _RUN_COLUMNS]
        settings = None if row.settings is None else json.dumps(row.settings, default=str)
        run = (night, *fields, settings)
        metrics = [
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
        ]
        with self._connection:
            self._connection.execute(f"INSERT INTO runs VALUES ({', '.join('?' * len(run))})", run)
            self._connection.executemany(
                "INSERT INTO metrics VALUES (?, ?, ?, ?, ?, ?, ?)", metrics
            )

    def finish(self, night: str, verdict: str) -> None:
        """Mark a night as finished, with its verdict."""
        with self._connection:
            self._connection.execute(
                "UPDATE nights SET finished = ?, verdict = ? WHERE night = ?",
                (_now(), verdict, night),
            )

    def rows(self, night: str) -> list[Row]:
        """Return the rows of a night so far, in the order in which they were added."""
        return self._rows("night = ?", night)

    def first(self, identity: str, before: str) -> tuple[str, Row] | None:
        """Return the first night in which a run succeeded or was refused, and its row; None if there is none.

        Parameters
        ----------
        identity
            Identity of the run, whose key may have been another one.
        before
            Only finished nights before this one are considered.
        """
        first = self._connection.execute(
            "SELECT night, key FROM runs JOIN nights USING (night) WHERE identity = ? AND night < ? "
            "AND finished IS NOT NULL AND status IN (?, ?) ORDER BY night LIMIT 1",
            (identity, before, Status.OK, Status.REFUSED),
        ).fetchone()
        if first is None:
            return None
        night, key = first
        [row] = self._rows("night = ? AND key = ?", night, key)
        return night, row

    def _rows(self, condition: str, *values: str) -> list[Row]:
        """Return the rows of the runs that satisfy an SQL condition with these values."""
        # Runs that are ignored may have tiers that do not exist any more: only numbers of runs
        # that are returned become metrics.
        numbers_of: dict[str, list[tuple[Any, ...]]] = {}
        numbers = self._connection.execute(
            f"SELECT key, metric, kind, value, uncertainty, tier FROM metrics WHERE {condition} "
            "ORDER BY rowid",
            values,
        )
        for key, *number in numbers:
            numbers_of.setdefault(key, []).append(tuple(number))
        runs = self._connection.execute(
            f"SELECT {', '.join(_RUN_COLUMNS)}, settings FROM runs WHERE {condition} AND {NO_DRAW} "
            "ORDER BY rowid",
            values,
        )
        rows = []
        for *fields, settings in runs:
            run = dict(zip(_RUN_COLUMNS, fields, strict=True))
            run["status"] = Status(run["status"])
            run["settings"] = None if settings is None else json.loads(settings)
            metrics = tuple(
                Metric(name, kind, value, uncertainty, Tier(tier))
                for name, kind, value, uncertainty, tier in numbers_of.get(run["key"], ())
            )
            rows.append(Row(**run, metrics=metrics))
        return rows

    def origin(self, night: str) -> dict[str, Any]:
        """Return the `environment.origin` of the numbers of a night."""
        [text] = self._connection.execute(
            "SELECT origin FROM nights WHERE night = ?", (night,)
        ).fetchone()
        return json.loads(text)

    def engines(self, night: str) -> dict[str, str]:
        """Return the versions of engines by name, each in the last night up to `night` in which it ran.

        A run that fails does not state a version. An engine that crashes for some nights is therefore compared with its
        version before.
        """
        stated = self._connection.execute(
            "SELECT DISTINCT night, engine, version FROM runs "
            "WHERE version IS NOT NULL AND night <= ? ORDER BY night, rowid",
            (night,),
        ).fetchall()
        last_night = {engine: stated_in for stated_in, engine, _ in stated}
        return engine_versions(
            (engine, version)
            for stated_in, engine, version in stated
            if stated_in == last_night[engine]
        )

    def finished_before(self, night: str = AFTER_ALL_NIGHTS) -> str | None:
        """Return the last finished night before another one, or None."""
        [last] = self._connection.execute(
            "SELECT max(night) FROM nights WHERE finished IS NOT NULL AND night < ?", (night,)
        ).fetchone()
        return last

    def last_finished(self) -> str | None:
        """Return the last finished night, or None."""
        return self.finished_before(AFTER_ALL_NIGHTS)

    def times(
        self, conditions: str, night: str = AFTER_ALL_NIGHTS
    ) -> dict[tuple[str, str], list[float]]:
        """Return the times of finished nights before `night`, oldest first, by identity and engine of the run.

        Only times under the same `environment.conditions` are returned.
        """
        numbers = self._connection.execute(
            "SELECT identity, engine, value FROM history WHERE kind = 'time' AND metric = ? AND machine = ? "
            "AND finished IS NOT NULL AND night < ? ORDER BY night",
            (TIME, conditions, night),
        )
        times: dict[tuple[str, str], list[float]] = {}
        for identity, engine, value in numbers:
            times.setdefault((identity, engine), []).append(value)
        return times


@contextmanager
def open_history(path: Path, write: bool = True) -> Iterator[History]:
    """Open the history in a file, which is created if it does not exist and `write` is True.

    Raises
    ------
    HistoryRefused
        If the file cannot be used.
    NotWritten
        If the disk is full. What has been written before is kept.
    """
    if path.is_dir():
        raise HistoryRefused(
            f"{path}: found a folder; expected the file of a history, such as "
            f"{path / 'history.sqlite'}"
        )
    mode = "rwc" if write else "ro"
    address = f"{path.absolute().as_uri()}?mode={mode}"
    try:
        with closing(sqlite3.connect(address, uri=True, timeout=TIMEOUT_S)) as connection:
            _prepare(path, connection, write)
            yield History(connection)
    except sqlite3.OperationalError as error:
        code = error.sqlite_errorcode & PRIMARY_CODE
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise NotWritten(path, OSError(str(error))) from error
        raise HistoryRefused(f"{path}: {error}") from error


def _prepare(path: Path, connection: sqlite3.Connection, write: bool) -> None:
    """Create the tables of a new file, or check the format of an existing one; then set the options.

    Raises
    ------
    HistoryRefused
        If the file is no history, or one of another format.
    """
    try:
        [version] = connection.execute("PRAGMA user_version").fetchone()
        [tables] = connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        if tables == 0 and write:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        elif version != FORMAT:
            content = "an empty file" if tables == 0 else f"a database of format {version}"
            raise HistoryRefused(
                f"{path}: found {content}; expected a history of format {FORMAT}, or no file"
            )
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
    except sqlite3.DatabaseError as error:
        raise HistoryRefused(f"{path}: {error}; expected a history, or no file") from error


def _now() -> str:
    """Return the current time in UTC, as it names a night: ISO 8601 with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
