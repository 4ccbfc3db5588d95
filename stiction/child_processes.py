"""Start of child processes, and their undisturbed end after an interrupt.

This module imports nothing else of the suite, so that the command `stiction` starts fast.
"""

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
"""Environment variables with the number of threads of libraries for linear algebra."""
_PRELOADED = (
    "stiction.silent_interrupt",
    "stiction.reference_impl.integration.paper_scheme",
    "stiction.engines.isolation",
)
"""Modules that a run of the reference needs."""
_PRELOADED_FOR_MEASURES = ("pandas", "scipy.spatial")
"""Modules that children need which evaluate their runs; they take half as long to import as the others."""


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
    imports = [*_PRELOADED, *(_PRELOADED_FOR_MEASURES if with_measures else ())]
    multiprocessing.get_context("forkserver").set_forkserver_preload(imports)
    with one_thread():
        forkserver.ensure_running()


def _has_server() -> bool:
    return "forkserver" in multiprocessing.get_all_start_methods()


@cache
def child_context() -> ForkServerContext | SpawnContext:
    """Return the context that starts child processes.

    Where the system allows it, processes are forked from a server that has imported the common modules.
    Starting one then takes a tenth of the time. The first call starts this server and does not wait for
    it; a command starts it earlier by `start_server`.
    """
    if not _has_server():
        return multiprocessing.get_context("spawn")
    start_server(with_measures="pandas" in sys.modules)
    return multiprocessing.get_context("forkserver")


@contextmanager
def one_thread() -> Iterator[None]:
    """Set the number of threads of linear algebra to one for child processes that are started in the block.

    The child processes already use all CPUs. Numbers that the user has set are not changed.
    """
    missing = [name for name in _THREADS if name not in os.environ]
    os.environ |= dict.fromkeys(missing, "1")
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]


@contextmanager
def undisturbed_end() -> Iterator[Callable[[], None]]:
    """Let the first SIGINT or SIGTERM end the block, and keep later ones from disturbing its end.

    A signal that is received while an interrupt is handled, for example in a ``finally``, is ignored. The
    block calls the yielded function when its end begins without an interrupt; a signal that is received
    from then on is raised again after the block. Python delivers signals to the main thread only, so that
    there is nothing to do in other threads.
    """
    is_ending = False
    deferred_signal: int | None = None

    def on_signal(number: int, frame: FrameType | None) -> None:
        nonlocal deferred_signal
        if isinstance(sys.exc_info()[1], KeyboardInterrupt):
            return
        if not is_ending:
            handlers[number](number, frame)
        elif deferred_signal is None:
            deferred_signal = number

    def begin_end() -> None:
        nonlocal is_ending
        is_ending = True

    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    if threading.current_thread() is threading.main_thread():
        for ending_signal in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(ending_signal)
            # A signal that is ignored, or ends the process at once, has no function as its handler.
            if callable(handler):
                handlers[ending_signal] = handler
    try:
        for number in handlers:
            signal.signal(number, on_signal)
        yield begin_end
    finally:
        begin_end()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if deferred_signal is not None:
            signal.raise_signal(deferred_signal)
