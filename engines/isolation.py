"""Work in child processes: a crash, a hang or an exception ends one task alone, and its messages are kept.

Each child has a pipe of its own and one task at a time, so that the end of a child, whatever its cause, concerns
exactly one task. (A pool whose workers share a queue and its locks does not survive the kill of a worker that holds a
lock.) Children are reused, because importing an engine takes longer than most runs; a child that dies is replaced.
"""

from __future__ import annotations

import io
import logging
import math
import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import tempfile
import textwrap
import threading
import time
import traceback
import weakref
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from stiction.child_processes import child_context, one_thread, undisturbed_end
from stiction.engines.protocol import Refused
from stiction.engines.registry import EngineMissing, absolute_name, load_engine
from stiction.engines.status import Status
from stiction.scenes import Scene, StictionError, Trajectory
from stiction.scenes.wording import last_lines

_START_S = 120.0
"""Seconds in which a child has to import the main module. One that takes longer is taken for hanging."""
_FAILED_STARTS = 5
"""Failed starts in a row after which the cause is taken to be the machine or the caller's script, and not chance."""
_GRACE_S = 2.0
"""Seconds between the end of a child's pipe and the end of the child, whose exit code is then known."""
_LONGEST_WAIT_S = 3600.0
"""Longest time of one wait for messages: without deadlines the wait would be infinite, which `wait` does not accept."""
_NOTE = b"note "
"""Beginning of a message that a child sends while it works, and that is not the result of a task."""
_LOG_BYTES = 4000
"""Number of bytes that are kept of the end of what a task printed."""
_LONGEST_REASON = 500
"""Number of characters of a reason in an outcome."""
_PROCESSES = threading.Lock()
"""Held while a process is started or waited for, because `multiprocessing` is made for one thread.

Of two threads that wait for the same process, one does not get its exit code, and each start of a process also waits
for all that have ended."""


@dataclass(frozen=True)
class Task:
    """A call to make in a child process; function, arguments and value must be picklable."""

    label: str
    function: Callable[..., Any]
    args: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Job:
    """A simulation to be run in a child process.

    Attributes
    ----------
    label : str
        Name of the job in its outcome.
    engine : str
        Name of the engine, as for `load_engine`.
    scene : Scene
        The scene.
    arguments : Mapping[str, Any]
        Keyword arguments of `Engine.simulate`.
    """

    label: str
    engine: str
    scene: Scene
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """Result of a task in a child process, or the reason why there is none.

    Attributes
    ----------
    label : str
        Label of the task or job.
    status : Status
        ``"ok"``; ``"refused"`` (the engine cannot represent the scene); ``"failed"`` (an exception, or a value that
        cannot be pickled); ``"timed out"``; ``"crashed"`` (the process was ended by a signal or an exit);
        ``"missing"`` (the engine's package is not installed).
    value
        The return value (for a `Job`, the trajectory); None unless the status is ``"ok"``.
    reason : str
        The reason in one line, in the engine's own words where available.
    log : str
        The end of the printed output, including tracebacks.
    wall_s : float
        Wall-clock time of the call, s.
    cpu_s : float or None
        CPU time of the call, s; None if the child ended before reporting it.
    bug : bool
        Whether the task failed with an exception other than `StictionError`; `log` then ends with its traceback.
    """

    label: str
    status: Status
    value: Any = field(default=None, repr=False)
    reason: str = ""
    log: str = field(default="", repr=False)
    wall_s: float = 0.0
    cpu_s: float | None = None
    bug: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "status", Status(self.status))

    @property
    def traceback(self) -> str:
        """`log` if the task failed because of a bug, otherwise empty."""
        return self.log if self.bug else ""


def run_isolated(
    jobs: Sequence[Job],
    *,
    workers: int | None = None,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
) -> list[Outcome]:
    """Run simulations in child processes, so that a crash or a hang ends one job only.

    Parameters
    ----------
    jobs
        The simulations.
    workers
        Number of child processes that work at the same time; the number of CPUs if None.
    timeout_s
        Wall-clock time after which the child of a job is killed, s.
    on_result
        Called in this process with each outcome as it arrives. An exception raised by it ends all jobs.

    Returns
    -------
    list of Outcome
        In the order of the jobs; the values are trajectories.

    Raises
    ------
    ValueError
        If `workers` or `timeout_s` is not positive.
    pickle.PicklingError, TypeError, AttributeError
        If a job cannot be pickled; nothing has been started then.
    RuntimeError
        If child processes cannot be started. They import the main module, so a script must call this function under
        ``if __name__ == "__main__":``.
    """
    return isolate(
        [simulation(job) for job in jobs], workers=workers, timeout_s=timeout_s, on_result=on_result
    )


def simulation(job: Job) -> Task:
    """The task that makes a job's trajectory, to be isolated together with others."""
    return Task(job.label, _simulate, (absolute_name(job.engine), job.scene, dict(job.arguments)))


def is_simulation(task: Task) -> bool:
    """Return True for a task of `simulation`, whose arguments are engine, scene and those of `Engine.simulate`."""
    return task.function is _simulate


def _simulate(engine: str, scene: Scene, arguments: Mapping[str, Any]) -> Trajectory:
    return load_engine(engine).simulate(scene, **arguments)


def sealed(task: Task) -> Task:
    """Return an equivalent task whose function and arguments are bytes for all processes but the child.

    A process that passes it on does not import the modules of the function and its arguments. Raises the exceptions of
    `pickle.dumps` if the task cannot be pickled.
    """
    return Task(task.label, _call_sealed, (pickle.dumps((task.function, task.args)),))


def unsealed(outcome: Outcome) -> Outcome:
    """Return an outcome of ``isolate(.., unpickle=False)`` with its value, or with the reason why it has none."""
    return replace(outcome, **_unpickled(outcome.value)) if outcome.status == Status.OK else outcome


def _call_sealed(call: bytes) -> Any:
    function, args = pickle.loads(call)
    return function(*args)


class ChildrenEnded(StictionError):
    """`IdleChildren.end_all` was called before or while children were used for tasks."""


def isolate(  # noqa: C901 - one loop of messages
    tasks: Sequence[Task],
    *,
    workers: int | None = None,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
    on_note: Callable[[str], None] | None = None,
    kept: IdleChildren | None = None,
    unpickle: bool = True,
) -> list[Outcome]:
    """Call each task's function in a child process.

    Parameters
    ----------
    workers
        Number of children at work at the same time; the number of CPUs if None.
    timeout_s
        Seconds that a task may take before its child is killed.
    on_result
        Called in this process with each outcome when it arrives. An exception that it raises ends this call.
    on_note
        Called in this process with each line that a child logs on the way, such as what it has to compile.
    kept
        Children that an earlier call has left; they are used first, and the children of this call are left there. If
        None, the children of this call are ended.
    unpickle
        False to leave the values of outcomes with the status `Status.OK` as bytes, for `unsealed`.

    Returns
    -------
    list of Outcome
        In the order of the tasks.

    Raises
    ------
    ValueError
        If `workers` or `timeout_s` is not positive.
    pickle.PicklingError, TypeError, AttributeError
        Before anything is started, if a task cannot be pickled.
    ChildrenEnded
        If the children that are kept were ended for good.
    RuntimeError
        If children cannot be started. They import the main module, so a script must call this under
        ``if __name__ == "__main__":``.

    Notes ----- No child outlives this call, unless it is idle and `kept`. This holds for any exception, also for an
    interrupt that is followed by another one. If this process itself is killed, its children exit as soon as their
    engine lets Python run.
    """
    workers = (os.cpu_count() or 1) if workers is None else workers
    if workers < 1 or not timeout_s > 0:
        raise ValueError(f"workers, timeout_s: found {workers}, {timeout_s}; expected numbers > 0")
    # Pickled before any child starts, so that a task that cannot be pickled is the caller's error.
    calls = [pickle.dumps((task.function, task.args)) for task in tasks]
    waiting = deque(range(len(tasks)))
    outcomes: dict[int, Outcome] = {}
    children: list[_Child] = [] if kept is None else kept.take(min(workers, len(tasks)))
    failed_starts = 0

    def feed(child: _Child) -> None:
        """Give an idle child the next task, which remains the next one if the child has just ended."""
        if child.idle and waiting and child.give(waiting[0], calls[waiting[0]], timeout_s):
            waiting.popleft()

    def settle(index: int, **result: Any) -> None:
        """Record the outcome of a task."""
        outcomes[index] = Outcome(tasks[index].label, **result)
        if on_result is not None:
            on_result(outcomes[index])

    with (
        undisturbed_end() as end,
        tempfile.TemporaryDirectory(prefix="stiction-", ignore_cleanup_errors=True) as folder,
    ):
        try:
            while len(outcomes) < len(tasks):
                # As many children as there is work for; those that have ended are replaced.
                while len(children) < min(workers, len(tasks) - len(outcomes)):
                    children.append(_Child(Path(folder)) if kept is None else kept.start())
                for child in children:
                    feed(child)
                # Wait until a child has sent something or has ended, or until the first deadline.
                patience = min(child.deadline for child in children) - time.monotonic()
                arrived = wait(
                    [child.connection for child in children],
                    min(max(patience, 0.0), _LONGEST_WAIT_S),
                )
                for child in list(children):
                    if child.connection in arrived and (message := child.receive()) is not None:
                        if message.startswith(_NOTE):
                            if on_note is not None:
                                on_note(message[len(_NOTE) :].decode())
                            continue
                        # A child that is ready, or has the result of its task. The log is read
                        # first, because the next task empties it.
                        failed_starts, log = 0, child.log()
                        if (index := child.take()) is not None:
                            # With several children, the next task starts before the outcome is
                            # handled, so that no core is idle meanwhile. A single child waits, as
                            # it would compete with the handling for its core.
                            if workers > 1:
                                feed(child)
                            settle(index, **_read(message, unpickle), log=log)
                    elif child.connection in arrived or (
                        time.monotonic() >= child.deadline and not child.connection.poll()
                    ):
                        # The child has ended, or its time is over and no result has arrived since
                        # the wait.
                        children.remove(child)
                        result = child.end(timed_out=child.connection not in arrived)
                        # A child that ends before it is ready has not failed in a task. After some
                        # such starts there is no point in further ones.
                        if child.task is not None:
                            settle(child.task, **result)
                        elif (
                            not child.ready
                            and (failed_starts := failed_starts + 1) == _FAILED_STARTS
                        ):
                            raise RuntimeError(
                                f"child processes cannot be started: {result['reason']} (a script must "
                                "call this under `if __name__ == '__main__':`)"
                            )
        finally:
            end()
            for child in children:
                if kept is None or not kept.leave(child):
                    child.kill()
    return [outcomes[index] for index in range(len(tasks))]


Isolate = Callable[..., list[Outcome]]
"""`isolate`, or something with its parameters that does the same, such as
`stiction.comparisons.bench.store.KeptRuns.isolate`."""


class _Child:
    """A child process seen from here: starting, idle, or busy with one task."""

    def __init__(self, folder: Path):
        self._folder = Path(tempfile.mkdtemp(dir=folder))
        self._log = self._folder / "printed.log"
        self._log.touch()
        with _PROCESSES:
            context = child_context()
            self.connection, far_end = context.Pipe()
            self._process = context.Process(
                target=_serve,
                args=(far_end, self._folder, self._log),
                name="stiction-child",
                daemon=True,
            )
            with one_thread():
                self._process.start()
            far_end.close()
        self.ready = False
        self.task: int | None = None
        self._started = time.monotonic()
        self.deadline = self._started + _START_S

    @property
    def idle(self) -> bool:
        return self.ready and self.task is None

    def give(self, task: int, call: bytes, timeout_s: float) -> bool:
        """Start a task, with an empty log; return False if the child ended while it was idle.

        The end of such a child is noticed later, by its connection.
        """
        os.truncate(self._log, 0)
        try:
            self.connection.send_bytes(call)
        except OSError:
            return False
        self.task = task
        self._started = time.monotonic()
        self.deadline = self._started + timeout_s
        return True

    def receive(self) -> bytes | None:
        """Return the next message; None if the child has ended."""
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError):
            return None

    def take(self) -> int | None:
        """Return the task of which the last message is the result; None if the message was that the child is ready."""
        task, self.task = self.task, None
        self.ready, self.deadline = True, math.inf
        return task

    def end(self, timed_out: bool) -> dict[str, Any]:
        """End the process; return how its task ended, as fields of an outcome."""
        wall = time.monotonic() - self._started
        with _PROCESSES:
            if not timed_out:
                self._process.join(_GRACE_S)
            code = self._process.exitcode
        self.kill()
        log = self.log()
        shutil.rmtree(self._folder, ignore_errors=True)
        if timed_out:
            status, reason = (
                Status.TIMED_OUT,
                f"no result within {self.deadline - self._started:g} s",
            )
        else:
            status, reason = Status.CRASHED, _end_of_process(code)
            words = last_lines(log)
            reason = _shortened(f"{reason}: {words}" if words else reason)
        return {"status": status, "reason": reason, "log": log, "wall_s": wall}

    def log(self) -> str:
        """Return the end of what the current task has printed."""
        with self._log.open("rb") as file:
            file.seek(max(0, self._log.stat().st_size - _LOG_BYTES))
            return file.read().decode(errors="replace").strip()

    def kill(self) -> None:
        self.stop()
        with _PROCESSES:
            self._process.join()
        self.connection.close()

    def stop(self) -> None:
        """Send the process the signal that ends it; whoever waits for its messages notices by its connection."""
        self._process.kill()


class IdleChildren:
    """Children without a task, for the next call of `isolate` in this process.

    A child imports and loads kernels for a second or two, many times as long as a short run takes. Those that no call
    has used for `idle_s` seconds are ended, since each has some 200 MB of memory. All end with this process.
    Several threads may call `isolate` with the same ones.
    """

    def __init__(self, idle_s: float = 30.0):
        self._place = tempfile.TemporaryDirectory(prefix="stiction-", ignore_cleanup_errors=True)
        self._idle_s = idle_s
        self._lock = threading.Lock()
        self._children: list[_Child] = []
        self._known: weakref.WeakSet[_Child] = weakref.WeakSet()  # those at work too
        self._ended = False
        self._timer: threading.Timer | None = None

    def start(self) -> _Child:
        """Return a new child, which is left here when it is idle. Raises ChildrenEnded."""
        with self._lock:
            if self._ended:
                raise ChildrenEnded("these children have been ended")
            child = _Child(Path(self._place.name))
            self._known.add(child)
        return child

    def take(self, count: int) -> list[_Child]:
        """Return so many children at most, which are no longer here."""
        with self._lock:
            taken, self._children = self._children[:count], self._children[count:]
        return taken

    def leave(self, child: _Child) -> bool:
        """Keep a child, unless it has a task, has not started yet, or all were ended; then return False."""
        if not child.idle:
            return False
        with self._lock:
            if self._ended:
                return False
            self._children.append(child)
            if self._timer is not None:
                self._timer.cancel()
            self._timer = threading.Timer(self._idle_s, self.end)
            self._timer.daemon = True
            self._timer.start()
        return True

    def end(self) -> None:
        """End the children that are here."""
        for child in self.take(len(self._children)):
            child.kill()

    def end_all(self) -> None:
        """End those at work too, in whatever thread `isolate` waits for them, and start no more: there it raises."""
        with self._lock:
            self._ended = True
            if self._timer is not None:
                self._timer.cancel()
            for child in self._known:
                child.stop()
        self.end()


def _end_of_process(code: int | None) -> str:
    """Describe the end of a process by its exit code, None if it has none yet."""
    if code is None:
        return "closed its pipe"
    if code >= 0:
        return f"exit code {code} before there was a result"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"{name} (killed from outside, or out of memory)" if name == "SIGKILL" else name


def _read(message: bytes, unpickle: bool = True) -> dict[str, Any]:
    """Return the fields of an outcome from a child's message."""
    fields, value = pickle.loads(message)
    if fields["status"] != Status.OK:
        return fields
    return fields | (_unpickled(value) if unpickle else {"value": value})


def _unpickled(value: bytes) -> dict[str, Any]:
    """Return the field ``value`` of an outcome, or the fields of a failure if the value cannot be unpickled here."""
    try:
        return {"value": pickle.loads(value)}
    except Exception as error:
        return {
            "value": None,
            "status": Status.FAILED,
            "reason": _words(error, "result cannot be unpickled: "),
        }


def _serve(connection: Connection, folder: Path, log: Path) -> None:
    """Run a child: report that it is ready, then answer call by call, with all output going to the log.

    Its temporary files are in the folder, which is removed by the process that ends the child.
    """
    tempfile.tempdir = str(folder)
    # A terminal sends these signals to all processes of a command at once. The parent handles them,
    # and then kills its children.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, args=(folder.parent,), daemon=True).start()
    # Redirected as file descriptors, because engines print from C code.
    descriptor = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    # Line by line, so that the log is complete up to a crash.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    notes = logging.getLogger("stiction")
    notes.setLevel(logging.INFO)
    notes.addHandler(_Notes(connection))
    connection.send_bytes(b"ready")
    while True:
        try:
            call = connection.recv_bytes()
        except EOFError:
            _leave_with_parent(folder.parent)
        connection.send_bytes(_answer(call))


class _Notes(logging.Handler):
    """Sends log records to the parent."""

    def __init__(self, connection: Connection):
        super().__init__()
        self._connection = connection

    def emit(self, record: logging.LogRecord) -> None:
        self._connection.send_bytes(_NOTE + record.getMessage().encode())


def _leave_with_parent(folder: Path) -> None:
    """Wait for the end of the parent, then remove its folder and exit without any clean-up of Python."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _answer(call: bytes) -> bytes:
    """Make the call; return the pickled pair of the fields of an outcome and the value.

    The value is pickled by itself, so that the parent can pass it on unread, and can report that it cannot be
    unpickled.
    """
    fields: dict[str, Any] = {"status": Status.OK, "reason": ""}
    value = None
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        function, args = pickle.loads(call)
        value = function(*args)
    except BaseException as error:
        # SystemExit included: no exception of a task ends the child's loop
        traceback.print_exc()
        kinds = {
            Refused: Status.REFUSED,
            EngineMissing: Status.MISSING,
            BaseException: Status.FAILED,
        }
        fields = {
            "status": next(status for kind, status in kinds.items() if isinstance(error, kind)),
            "reason": _words(error),
            "bug": not isinstance(error, StictionError),
        }
    fields |= {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
    try:
        pickled = pickle.dumps(value)
    except Exception as error:
        fields |= {"status": Status.FAILED, "reason": _words(error, "result cannot be pickled: ")}
        pickled = pickle.dumps(None)
    sys.stdout.flush()
    return pickle.dumps((fields, pickled))


def _words(error: BaseException, prefix: str = "") -> str:
    """Return an exception in one line, with its type unless it is an error of the suite, whose message is enough."""
    message = f"{type(error).__name__}: {error}"
    if isinstance(error, StictionError) and str(error):
        message = str(error)
    return _shortened(prefix + message)


def _shortened(text: str) -> str:
    """Return a text in one line of at most `_LONGEST_REASON` characters."""
    return textwrap.shorten(text, _LONGEST_REASON, placeholder=" ...")
