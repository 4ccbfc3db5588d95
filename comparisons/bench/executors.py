"""Execution of tasks in child processes, on this machine or on the workers of a Dask cluster.

Runs of engines may crash or hang. Therefore a worker of a cluster does not execute tasks itself,
but in child processes. It forwards tasks and outcomes as bytes, so that only the child process
imports what a task needs.
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
"""End of the message about an unknown executor."""
BATCH = 4
"""Tasks that are sent to a worker at a time. More would reduce the cost of sending, but all of them
are lost if the worker dies."""


def check_executor(name: str) -> None:
    """Raise InputError if there is no executor with this name, or if a package that it needs is missing."""
    is_dask = name.partition(":")[0] == "dask" and not name.endswith(":")
    if name != "processes" and not is_dask:
        raise InputError(f"executor: found {name!r}; {EXPECTED}")
    if is_dask:
        try:
            import_module("distributed")
        except ImportError as error:
            raise InputError(
                f"executor: {name} needs the extra: pip install 'stiction[dask]' ({error})"
            ) from None


@contextmanager
def open_isolate(name: str = "processes", workers: int | None = None) -> Iterator[Isolate]:
    """Yield a function that executes tasks, with the signature of `stiction.engines.isolate`.

    Tasks that have not begun when the block ends are cancelled, and child processes are terminated.
    The tasks of a worker that dies are executed again on another one; if Dask gives up after
    several workers have died, the status of their outcomes is ``crashed``.

    Parameters
    ----------
    name : str
        ``"processes"`` is `isolate` itself. ``"dask"`` starts a scheduler in this process, which is
        stopped at the end of the block. ``"dask:ADDRESS"`` connects to a scheduler on whose workers
        stiction is installed.
    workers : int, optional
        Number of threads of ``"dask"``, each of which waits for a child process that does the work.
        With Dask, the argument ``workers`` of the function that is yielded has no effect.

    Raises
    ------
    InputError
        If the scheduler does not answer, or a worker has other code or may not start processes.
    """
    check_executor(name)
    if name == "processes":
        yield isolate
        return
    if name == "dask":
        # Start the server of child processes now: it imports its modules while Dask is imported
        # here.
        child_context()
    block = uuid4().hex
    with undisturbed_end(), _dask_client(name, workers) as client:
        _check_workers(name, client)
        executor = client.get_executor()
        try:
            yield partial(_isolate_on, executor, block)
        finally:
            executor.shutdown(wait=False)  # this cancels tasks that have not begun
            # The workers must terminate their children, because a process waits for its children
            # when it exits.
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
    """Execute tasks on a cluster, as `isolate` does on this machine; `workers` has no effect.

    Parameters
    ----------
    executor : Executor
        Dask's executor of the cluster.
    block : str
        Name of the block of `open_isolate`.
    """
    from distributed.scheduler import KilledWorker

    run_batch = partial(_isolate_at_worker, block, timeout_s=timeout_s)
    sealed_tasks = [sealed(task) for task in tasks]
    # Batches are identified by the number of their first task. A future is dropped as soon as its
    # result has been read, so that the worker can release the result.
    outcomes: dict[int, list[Outcome]] = {}
    pending: dict[Future[list[Outcome]], int] = {}
    try:
        for first in range(0, len(tasks), BATCH):
            pending[executor.submit(run_batch, sealed_tasks[first : first + BATCH])] = first
        for future in as_completed(pending):
            first = pending.pop(future)
            try:
                outcomes[first] = [unsealed(outcome) for outcome in future.result()]
            except KilledWorker as error:
                # Like a child process that dies, this is an outcome of each task of the batch.
                reason = " ".join(f"workers died: {error}".split())
                outcomes[first] = [
                    Outcome(task.label, Status.CRASHED, reason=reason)
                    for task in tasks[first : first + BATCH]
                ]
            if on_result is not None:
                for outcome in outcomes[first]:
                    on_result(outcome)
    finally:
        for future in pending:
            future.cancel()
    return [outcome for first in sorted(outcomes) for outcome in outcomes[first]]


def _isolate_at_worker(block: str, tasks: Sequence[Task], *, timeout_s: float) -> list[Outcome]:
    """Execute tasks one after another in a child process of this worker, which the block's next tasks reuse."""
    return isolate(tasks, workers=1, timeout_s=timeout_s, kept=_children_of(block), unpickle=False)


_CHILDREN: dict[str, IdleChildren] = {}
"""Child processes of this worker, by the block of `open_isolate`. A worker that executes several
tasks at a time has several. Entries of finished blocks are not removed: a task that arrives late
must find that its block has ended."""
_CHILDREN_LOCK = threading.Lock()
"""Lock of `_CHILDREN`, because a worker may have several threads."""


def _children_of(block: str) -> IdleChildren:
    """Return the child processes of this worker for a block."""
    with _CHILDREN_LOCK:
        if block not in _CHILDREN:
            _CHILDREN[block] = IdleChildren()
        return _CHILDREN[block]


def _end_children(block: str) -> None:
    """Terminate the child processes of this worker for a block."""
    _children_of(block).end_all()


@contextmanager
def _dask_client(name: str, workers: int | None) -> Iterator[Any]:
    """Yield a client of the scheduler at an address, or of one in this process; see `open_isolate`."""
    from distributed import Client, LocalCluster

    address = name.partition(":")[2]
    if address:
        try:
            client = Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            # OSError if there is no answer, ValueError if the address is invalid
            raise InputError(f"executor: {name}: no scheduler answers ({error})") from None
        with client:
            yield client
        return
    # Threads of this process need no start-up time. Dask's limit of memory would count this process
    # and not the child processes, which do the work; hence there is none.
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
    """Raise InputError if a worker has other code than this process, or may not start processes."""
    try:
        answers = client.run(_prepare_worker)
    except ImportError as error:
        raise InputError(
            f"executor: {name}: its workers need stiction as it is here ({error})"
        ) from None
    expected_digest = source_digest()
    for worker, (digest, is_daemon) in answers.items():
        if digest != expected_digest:
            raise InputError(
                f"executor: {name}: found other code at the worker {worker}; expected stiction as it is "
                "here"
            )
        if is_daemon:
            raise InputError(
                f"executor: {name}: found a worker that may start no processes, {worker}; expected "
                "workers started with DASK_DISTRIBUTED__WORKER__DAEMON=False in their environment"
            )


def _prepare_worker() -> tuple[str, bool]:
    """Return the digest of this worker's code, and whether it is a daemon, which may not start processes.

    A worker that may start processes begins to prepare for them.
    """
    is_daemon = multiprocessing.current_process().daemon
    if not is_daemon:
        child_context()
    return source_digest(), is_daemon
