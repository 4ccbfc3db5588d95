"""Storage of outcomes as soon as they are available, so that an interrupted campaign can be resumed.

The outcomes are stored in one SQLite file beside the folder that the campaign writes;
`stiction.comparisons.regression.history` gives the reasons for SQLite. The key of an outcome is the
digest of all that it depends on: function and arguments (scenes by their contents), time limit,
code of the suite and of the engines, versions and machine. A run with another key is executed
again. Outcomes contain trajectories; they are pickled and compressed
(`stiction.comparisons.bench.packed_outcomes`). As unpickling can execute code, users must not open
files that others have written.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from stiction.comparisons.bench.identity import circumstances
from stiction.comparisons.bench.packed_outcomes import NotAnOutcome, pack, unpack
from stiction.comparisons.bench.timing.timed_runs import call_of
from stiction.engines.isolation import Isolate, Outcome, Task, isolate
from stiction.engines.status import Status
from stiction.scenes import StictionError
from stiction.scenes.atomic_files import NotWritten
from stiction.scenes.digest import digest

LOCK_TIMEOUT = 0.5
"""Time to wait for the lock of the file, s. Another campaign that has the lock keeps it until it
ends, so that a longer wait would be useless."""
SETTLED = (Status.OK, Status.REFUSED, Status.FAILED)
"""Statuses of outcomes that are stored, because a repeated run would have the same.

Other statuses may change: the machine was busy, the process was killed by a user, or a package has
been installed."""


class KeptRefused(StictionError):
    """The error of a file of stored outcomes that cannot be used."""


class KeptRuns:
    """Execution of tasks that stores their outcomes, and that uses the outcomes stored by earlier calls.

    Attributes
    ----------
    kept : int
        Number of outcomes in the file.
    taken_over : int
        Number of outcomes that were read from the file instead of executing their tasks.
    settled : int
        Number of tasks with an outcome, executed or read.
    finished : bool
        Set by the caller as soon as the outcomes are no longer needed; the file is then deleted.
    interrupt : KeyboardInterrupt or None
        Set by an interrupt. All remaining tasks then have the status `Status.NOT_RUN`.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, circumstances: str):
        self.kept: int = connection.execute("SELECT count(*) FROM outcomes").fetchone()[0]
        self.taken_over = 0
        self.settled = 0
        self.finished = False
        self.interrupt: KeyboardInterrupt | None = None
        self._is_executing = False
        self._path = path
        self._connection = connection
        self._circumstances = circumstances
        self._requests: Counter[str] = Counter()

    def isolate(
        self,
        tasks: Sequence[Task],
        *,
        workers: int | None = None,
        timeout_s: float,
        on_result: Callable[[Outcome], None] | None = None,
        made_by: Isolate = isolate,
    ) -> list[Outcome]:
        """Return the outcomes of tasks, either stored ones or those of `made_by`.

        Parameters
        ----------
        tasks, workers, timeout_s, on_result
            As of `stiction.engines.isolate`; `on_result` receives the stored outcomes first.
        made_by : callable
            Executes the tasks that have no stored outcome.

        Raises
        ------
        NotWritten
            If an outcome cannot be stored.
        KeptRefused
            If the file is damaged.
        KeyboardInterrupt
            If it is raised before there is any outcome; otherwise see `interrupt`.
        """
        keys = [self._key(task, timeout_s) for task in tasks]
        outcomes: dict[int, Outcome] = {}

        def settle(i: int, outcome: Outcome) -> None:
            """Take an outcome as that of task i."""
            outcomes[i] = replace(outcome, label=tasks[i].label)
            self.settled += outcome.status != Status.NOT_RUN
            if on_result is not None:
                on_result(outcomes[i])

        def store(outcome: Outcome) -> None:
            """Store the outcome of an executed task, whose label is its number."""
            i = int(outcome.label)
            if outcome.status in SETTLED:
                self._write(keys[i], outcome)
            settle(i, outcome)
            # Python discards an exception that a signal handler raises within a finalizer.
            # Therefore the interrupt is raised here again.
            if self.interrupt is not None:
                raise self.interrupt

        # Read the outcomes that an earlier call has stored.
        for i, key in enumerate(keys):
            stored_outcome = self._read(key)
            if stored_outcome is not None:
                self.taken_over += 1
                settle(i, stored_outcome)

        # Execute the other tasks. Their labels are their numbers, since labels need not be unique.
        remaining = [
            replace(task, label=str(i)) for i, task in enumerate(tasks) if i not in outcomes
        ]
        self._is_executing = True
        try:
            if self.interrupt is None:
                made_by(remaining, workers=workers, timeout_s=timeout_s, on_result=store)
        except KeyboardInterrupt as interrupt:
            if not self.settled:
                raise
            self.interrupt = interrupt
        finally:
            self._is_executing = False

        # Tasks without an outcome have been left out because of an interrupt.
        for i in range(len(tasks)):
            if i not in outcomes:
                settle(i, Outcome(tasks[i].label, Status.NOT_RUN, reason="interrupted"))
        return [outcomes[i] for i in range(len(tasks))]

    def end(self, interrupt: KeyboardInterrupt) -> None:
        """Execute no more tasks; called by the handler of a signal, at any time.

        The interrupt is raised if tasks are being executed, where `isolate` catches it, and if
        there is no outcome yet.
        """
        self.interrupt = interrupt
        if self._is_executing or not self.settled:
            raise interrupt

    def _key(self, task: Task, timeout_s: float) -> str:
        """Return the key of a task, which ends with the number of times that it has been requested.

        A task that is requested again, as in another round of timing, has an outcome of its own.
        """
        key = digest([self._circumstances, task.label, call_of(task), float(timeout_s)])
        self._requests[key] += 1
        return f"{key}-{self._requests[key]}"

    def _read(self, key: str) -> Outcome | None:
        """Return the stored outcome with a key, None if there is none; KeptRefused if it is damaged."""
        try:
            row = self._connection.execute(
                "SELECT outcome FROM outcomes WHERE key = ?", (key,)
            ).fetchone()
            return None if row is None else unpack(row[0])
        except (sqlite3.DatabaseError, NotAnOutcome) as error:
            raise KeptRefused(
                f"{self._path}: damaged ({error}); delete it to begin anew"
            ) from error

    def _write(self, key: str, outcome: Outcome) -> None:
        """Store an outcome; NotWritten if this is impossible, for example if the disk is full."""
        try:
            with self._connection:
                self._connection.execute("INSERT INTO outcomes VALUES (?, ?)", (key, pack(outcome)))
            self.kept += 1
        except sqlite3.OperationalError as error:
            raise NotWritten(self._path, OSError(str(error))) from error


def kept_file(folder: Path) -> Path:
    """Return the path of the file that stores the outcomes of a campaign until it has written `folder`."""
    folder = folder.resolve()
    return folder.with_name(f".{folder.name}.unfinished.sqlite")


@contextmanager
def kept_runs(folder: Path, engines: Iterable[str]) -> Iterator[KeptRuns]:
    """Open the stored outcomes of a campaign.

    At the end of the block the file is deleted if it is empty, or if the caller has set
    `KeptRuns.finished`.

    Parameters
    ----------
    folder : Path
        The folder that the campaign writes.
    engines : iterable of str
        Names of the engines of the campaign.

    Raises
    ------
    KeptRefused
        If the file is not a file of stored outcomes, or if another process writes to it.
    """
    path = kept_file(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    connection = None
    try:
        connection = sqlite3.connect(path, timeout=LOCK_TIMEOUT)
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        # With a write-ahead log, nothing is lost if the process is killed. The default would call
        # fsync for each outcome, which takes 15 s for a thousand; NORMAL calls it only when the log
        # is transferred into the database.
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
        with connection:
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS outcomes (key TEXT PRIMARY KEY, outcome BLOB NOT NULL)"
            )
        runs = KeptRuns(path, connection, digest(circumstances(engines)))
    except sqlite3.Error as error:
        if connection is not None:
            connection.close()
        # the lower byte of an extended error code is its primary code
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            reason = "another process writes to it"
        else:
            reason = f"{error}; delete it to begin anew"
        raise KeptRefused(f"{path}: {reason}") from error
    try:
        yield runs
    finally:
        connection.close()
        if runs.finished or not runs.kept:
            path.unlink()
