"""Where the work of a sweep is done: processes of this machine or a Dask cluster, behind `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from stiction.child_processes import child_context
from stiction.scenes import InputError

EXPECTED = "expected processes, dask (a cluster on this machine) or dask:ADDRESS such as dask:tcp://host:8786"


def check_executor(name: str) -> None:
    """Raise InputError if there is no executor of that name, or if it needs a package that is not installed."""
    kind, _, address = name.partition(":")
    if kind not in ("processes", "dask") or kind == "processes" and name != kind or name.endswith(":"):
        raise InputError(f"executor: found {name!r}; {EXPECTED}")
    if kind == "dask":
        try:
            import distributed  # noqa: F401
        except ImportError as error:
            raise InputError(f"executor: {name} needs the extra: pip install 'stiction[dask]' ({error})") from None


@contextmanager
def open_executor(name: str = "processes", workers: int | None = None) -> Iterator[Executor]:
    """An executor; what has not begun when the block ends is cancelled.

    Parameters
    ----------
    name
        ``"processes"``, ``"dask"`` (a cluster on this machine for the time of the block), ``"dask:ADDRESS"`` (of a
        scheduler; stiction and its kernels must be installed on its workers).
    workers
        Processes; the number of CPUs where None. A cluster with an address of its own has the workers it has.

    Raises
    ------
    InputError
        See `check_executor`; or if no scheduler answers at the address.
    """
    check_executor(name)
    workers = workers or os.cpu_count() or 1
    if name == "processes":
        pool = ProcessPoolExecutor(workers, child_context(), _ignore_interrupt)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)
        return
    from distributed import Client, LocalCluster

    address = name.partition(":")[2]
    if address:
        try:
            client = Client(address, timeout="10s")
        except (OSError, ValueError) as error:  # Dask's, of an address that is none, or where nobody answers
            raise InputError(f"executor: {name}: no scheduler answers ({error})") from None
        with client:
            yield from _of_client(client)
    else:  # kernels hold Python's lock: threads of one process would take turns
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            yield from _of_client(client)


def _of_client(client) -> Iterator[Executor]:
    executor = client.get_executor()
    try:
        yield executor
    finally:
        executor.shutdown(wait=False)  # Dask's way to cancel


def _ignore_interrupt() -> None:
    """An interrupt from the keyboard reaches the whole process group; the parent then ends its children."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
