"""The start and the end of child processes. Imports nothing of the suite: the command begins with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing import forkserver
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_IMPORTED = (
    "stiction.silent_interrupt",
    "stiction.reference_impl.integration.paper_scheme",
    "stiction.engines.isolation",
)
"""Imports of a run of the reference."""
_IMPORTED_BY_MEASURES = ("pandas", "scipy.spatial")
"""Imports of children that evaluate their runs; they take half as long again as those of `_IMPORTED`."""


def start_server(with_measures: bool) -> None:
    """Start the server of child processes, without waiting for its imports, where the system has such a server.

    A command that will need children calls this before its own imports, so that both are made at the same time. The
    first call decides what the server imports; later ones find it running.

    Parameters
    ----------
    with_measures : bool
        True if children evaluate their runs, and not only make them.
    """
    if not _has_server():
        return
    imports = [*_IMPORTED, *(_IMPORTED_BY_MEASURES if with_measures else ())]
    multiprocessing.get_context("forkserver").set_forkserver_preload(imports)
    with one_thread():
        forkserver.ensure_running()


def _has_server() -> bool:
    return "forkserver" in multiprocessing.get_all_start_methods()


@cache
def child_context() -> ForkServerContext | SpawnContext:
    """Return how processes are started: forked, where the system can, from a server that has made the common imports.

    That takes a tenth of the time of a new interpreter.
    """
    if not _has_server():
        return multiprocessing.get_context("spawn")
    start_server(with_measures="pandas" in sys.modules)
    return multiprocessing.get_context("forkserver")


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra from starting threads, unless the user has said how many: children share the CPUs already."""
    missing = [name for name in _THREADS if name not in os.environ]
    os.environ |= dict.fromkeys(missing, "1")
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]


@contextmanager
def undisturbed_end() -> Iterator[Callable[[], None]]:
    """Let one interrupt or SIGTERM end what is within; another one does not disturb how it ends.

    A signal while an interrupt is being dealt with, as in a ``finally``, is that interrupt again. One that comes after
    the yielded function was called waits for the end of this context. Other threads than the main one have no signals.
    """
    ending, late = False, 0

    def take(number: int, frame: FrameType | None) -> None:
        nonlocal late
        if isinstance(sys.exc_info()[1], KeyboardInterrupt):
            return
        if ending:
            late = late or number
        else:
            before[number](number, frame)

    def end() -> None:
        nonlocal ending
        ending = True

    here = threading.current_thread() is threading.main_thread()
    before: dict[int, Callable[[int, FrameType | None], Any]] = {
        number: handler
        for number in (signal.SIGINT, signal.SIGTERM)
        if here and callable(handler := signal.getsignal(number))
    }
    try:
        for number in before:
            signal.signal(number, take)
        yield end
    finally:
        end()
        for number, handler in before.items():
            signal.signal(number, handler)
        if late:
            signal.raise_signal(late)
