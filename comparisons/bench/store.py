"""Runs that are kept as soon as they are finished; the same campaign, called again, goes on with them.

The outcomes lie in one SQLite file next to the folder that is to be written, for the reasons that
`stiction.comparisons.regression.history` gives. An outcome is found again by the digest of all that it depends on:
function and arguments (scenes by their content), time limit, code of the suite and of the engines, versions, machine.
Anything else is run anew. Outcomes are pickled, since they hold trajectories, and compressed
(`stiction.comparisons.bench.packed_outcomes`): the file is for the user who made it, not to be passed on.
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
"""Seconds to wait for another process that writes to the file: it holds the file for as long as its campaign runs."""
SETTLED = (Status.OK, Status.REFUSED, Status.FAILED)
"""Statuses that running again would not change.

With others a machine may have been busy, a process been killed from outside, a package be installed since."""


class KeptRefused(StictionError):
    """The file of kept runs cannot be used."""


class KeptRuns:
    """`stiction.engines.isolate` with a memory.

    `kept` counts the outcomes in the file, `taken_over` those of an earlier call, `settled` all, made or taken over.
    After an `interrupt` all runs that are left are `Status.NOT_RUN`. The caller who needs the runs no more sets
    `finished`, which removes them.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, circumstances: str):
        self.kept: int = connection.execute("SELECT count(*) FROM outcomes").fetchone()[0]
        self.taken_over, self.settled, self.finished = 0, 0, False
        self.interrupt: KeyboardInterrupt | None = None
        self._making = False
        self._path, self._connection, self._circumstances = path, connection, circumstances
        self._seen: Counter[str] = Counter()

    def isolate(
        self,
        tasks: Sequence[Task],
        *,
        workers: int | None = None,
        timeout_s: float,
        on_result: Callable[[Outcome], None] | None = None,
        made_by: Isolate = isolate,
    ) -> list[Outcome]:
        """Return the outcomes as `made_by` does, for tasks that are not kept yet; `on_result` gets the others first.

        Raises `NotWritten` if an outcome cannot be kept, `KeptRefused` if the file is damaged, and a KeyboardInterrupt
        that comes before there is any outcome.
        """
        keys = [self._key(task, timeout_s) for task in tasks]
        outcomes: dict[int, Outcome] = {}

        def settle(i: int, outcome: Outcome) -> None:
            outcomes[i] = replace(outcome, label=tasks[i].label)
            self.settled += outcome.status != Status.NOT_RUN
            if on_result is not None:
                on_result(outcomes[i])

        def keep(outcome: Outcome) -> None:
            i = int(outcome.label)
            if outcome.status in SETTLED:
                self._write(keys[i], outcome)
            settle(i, outcome)
            if self.interrupt is not None:  # Python drops what a handler raises within a finalizer
                raise self.interrupt

        # What an earlier call has kept, then the runs that are left, under their numbers as labels.
        for i, key in enumerate(keys):
            kept_outcome = self._read(key)
            if kept_outcome is not None:
                self.taken_over += 1
                settle(i, kept_outcome)
        self._making = True
        try:
            if self.interrupt is None:
                made_by(
                    [
                        replace(task, label=str(i))
                        for i, task in enumerate(tasks)
                        if i not in outcomes
                    ],
                    workers=workers,
                    timeout_s=timeout_s,
                    on_result=keep,
                )
        except KeyboardInterrupt as interrupt:
            if not self.settled:
                raise
            self.interrupt = interrupt
        finally:
            self._making = False
        for i in range(len(tasks)):
            if i not in outcomes:
                settle(i, Outcome(tasks[i].label, Status.NOT_RUN, reason="interrupted"))
        return [outcomes[i] for i in range(len(tasks))]

    def end(self, interrupt: KeyboardInterrupt) -> None:
        """Make no more runs, whatever is being done just now: for the handler of a signal.

        Raises it in the midst of runs, where `isolate` catches it, or if there is no outcome yet.
        """
        self.interrupt = interrupt
        if self._making or not self.settled:
            raise interrupt

    def _key(self, task: Task, timeout_s: float) -> str:
        """Return the key of a task; the same task requested twice, as for two timings, has two."""
        key = digest([self._circumstances, task.label, call_of(task), float(timeout_s)])
        self._seen[key] += 1
        return f"{key}-{self._seen[key]}"

    def _read(self, key: str) -> Outcome | None:
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
        try:
            with self._connection:
                self._connection.execute("INSERT INTO outcomes VALUES (?, ?)", (key, pack(outcome)))
            self.kept += 1
        except sqlite3.OperationalError as error:
            raise NotWritten(self._path, OSError(str(error))) from error


def kept_file(folder: Path) -> Path:
    """Return the file in which the runs for a folder are kept until it is there."""
    folder = folder.resolve()
    return folder.with_name(f".{folder.name}.unfinished.sqlite")


@contextmanager
def kept_runs(folder: Path, engines: Iterable[str]) -> Iterator[KeptRuns]:
    """Open the kept runs of the campaign of some engines that is to write `folder`.

    `kept_file` stays if it has any, until they are `finished`. Raises `KeptRefused` if the file is something else, or
    another process writes to it.
    """
    path = kept_file(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    connection = None
    try:
        connection = sqlite3.connect(path, timeout=LOCK_TIMEOUT)
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        # A killed process loses nothing by a write-ahead log. An fsync for each of a thousand
        # outcomes would take 15 s: NORMAL leaves them to the checkpoints of the log.
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
        words = f"{error}; delete it to begin anew"
        if "locked" in str(error):
            words = "another process writes to it"
        raise KeptRefused(f"{path}: {words}") from error
    try:
        yield runs
    finally:
        connection.close()
        if runs.finished or not runs.kept:
            path.unlink()
