"""Executors of tasks: processes of this machine or a Dask cluster.

Runs of engines crash and hang: on a cluster, each worker isolates its share in child processes of its own. Workers pass
on what they get and send as bytes, so they import nothing of what a task needs.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any
from uuid import uuid4

from stiction.child_processes import child_context, undisturbed_end
from stiction.comparisons.bench.environment import source_digest
from stiction.engines.isolation import (
    IdleChildren,
    Isolate,
    Outcome,
    Task,
    isolate,
    sealed,
    unsealed,
)
from stiction.engines.status import Status
from stiction.scenes import InputError

EXPECTED = "expected processes, dask (a cluster on this machine) or dask:ADDRESS such as dask:tcp://host:8786"
BATCH = 4
"""Tasks that a worker is given at a time, so that asking for them costs little. A worker that dies gives as many up."""


def check_executor(name: str) -> None:
    """Raise InputError if there is no executor of that name, or if it needs a package that is not installed."""
    kind, _, address = name.partition(":")
    if (
        kind not in ("processes", "dask")
        or kind == "processes"
        and name != kind
        or name.endswith(":")
    ):
        raise InputError(f"executor: found {name!r}; {EXPECTED}")
    if kind == "dask":
        try:
            import_module("distributed")
        except ImportError as error:
            raise InputError(
                f"executor: {name} needs the extra: pip install 'stiction[dask]' ({error})"
            ) from None


@contextmanager
def open_isolate(name: str = "processes", workers: int | None = None) -> Iterator[Isolate]:
    """Yield `stiction.engines.isolate` for ``"processes"``, or the same on a cluster.

    ``"dask"`` is a scheduler in this process for the time of the block, with `workers` threads, each of which waits
    for a child process that does the work. ``"dask:ADDRESS"`` is a scheduler on whose workers stiction is installed.
    On either, the parameter ``workers`` of `isolate` has no effect. When the block ends, tasks that have not begun
    are cancelled, and the children of those that have are ended. The tasks of a worker that dies are made again on
    another; where Dask gives them up after several workers, their outcomes are ``crashed``. Raises InputError if no
    scheduler answers, or a worker has other code or may start no processes.
    """
    check_executor(name)
    if name == "processes":
        yield isolate
        return
    if name == "dask":
        child_context()  # the children's server imports while Dask is imported
    block = uuid4().hex
    with undisturbed_end(), _dask_client(name, workers) as client:
        _check_workers(name, client)
        executor = client.get_executor()
        try:
            yield partial(_isolate_on, executor, block)
        finally:
            executor.shutdown(wait=False)  # Dask's way to cancel
            # a process that ends waits for its children, which do not end before it does
            client.run(_end_children, block, on_error="ignore")


def _isolate_on(
    executor: Executor,
    block: str,
    tasks: Sequence[Task],
    *,
    workers: int | None = None,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
) -> list[Outcome]:
    from distributed.scheduler import KilledWorker

    one_by_one = partial(_isolate_at_worker, block, timeout_s=timeout_s)
    shares = [sealed(task) for task in tasks]
    # Both by the number of the first task of a batch. A future whose result has been read is
    # dropped, so that its worker need not hold the result any longer.
    outcomes: dict[int, list[Outcome]] = {}
    begun: dict[Future[list[Outcome]], int] = {}
    try:
        for first in range(0, len(tasks), BATCH):
            begun[executor.submit(one_by_one, shares[first : first + BATCH])] = first
        for future in as_completed(begun):
            first = begun.pop(future)
            try:
                outcomes[first] = [unsealed(outcome) for outcome in future.result()]
            except KilledWorker as error:
                # as a run in a child process that dies: an outcome of each task, not an error of
                # the whole
                reason = " ".join(f"workers died: {error}".split())
                outcomes[first] = [
                    Outcome(task.label, Status.CRASHED, reason=reason)
                    for task in tasks[first : first + BATCH]
                ]
            if on_result is not None:
                for outcome in outcomes[first]:
                    on_result(outcome)
    finally:
        for future in begun:
            future.cancel()
    return [outcome for first in sorted(outcomes) for outcome in outcomes[first]]


def _isolate_at_worker(block: str, tasks: Sequence[Task], *, timeout_s: float) -> list[Outcome]:
    """Make tasks one after the other in a child of this worker, which is kept for the next ones of the block."""
    return isolate(tasks, workers=1, timeout_s=timeout_s, kept=_children_of(block), unpickle=False)


_KEPT: dict[str, IdleChildren] = {}
"""Children of this process by the block of `open_isolate` that they work for, or worked for: that is how a task which
comes after the end of its block knows. A worker that runs several tasks at a time has as many children."""
_KEPT_LOCK = threading.Lock()


def _children_of(block: str) -> IdleChildren:
    with _KEPT_LOCK:
        if block not in _KEPT:
            _KEPT[block] = IdleChildren()
        return _KEPT[block]


def _end_children(block: str) -> None:
    _children_of(block).end_all()


@contextmanager
def _dask_client(name: str, workers: int | None) -> Iterator[Any]:
    from distributed import Client, LocalCluster

    if address := name.partition(":")[2]:
        try:
            client = Client(address, timeout="10s")
        except (
            OSError,
            ValueError,
        ) as error:
            # Dask's, of an address that is none, or where nobody answers
            raise InputError(f"executor: {name}: no scheduler answers ({error})") from None
        with client:
            yield client
        return
    # threads of this process cost no start, and no limit of its memory concerns what children have
    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=workers or os.cpu_count() or 1,
            processes=False,
            memory_limit=None,
            dashboard_address=None,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _check_workers(name: str, client: Any) -> None:
    """Raise InputError if the numbers of a worker would not be those of this code, or if it cannot isolate."""
    try:
        answers = client.run(_worker)
    except ImportError as error:
        raise InputError(
            f"executor: {name}: its workers need stiction as it is here ({error})"
        ) from None
    for worker, (digest, daemon) in answers.items():
        if digest != source_digest():
            raise InputError(
                f"executor: {name}: found other code at the worker {worker}; expected stiction as it is "
                "here"
            )
        if daemon:
            raise InputError(
                f"executor: {name}: found a worker that may start no processes, {worker}; expected "
                "workers started with DASK_DISTRIBUTED__WORKER__DAEMON=False in their environment"
            )


def _worker() -> tuple[str, bool]:
    """The digest of the code of the worker that calls it, and whether it is a process that may have no children.

    If it may, it begins to get ready for them.
    """
    if not multiprocessing.current_process().daemon:
        child_context()
    return source_digest(), multiprocessing.current_process().daemon
