"""Execution of tasks in child processes: a crash, a hang or an exception ends only one task, and its output is kept.

Each child has its own pipe and one task at a time, so that the end of a child, whatever its cause, concerns exactly one
task. (A pool whose workers share a queue and its locks does not survive if a worker that holds a lock is killed.)
Children are reused, because importing an engine takes longer than most runs; a child that ends is replaced.
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
"""Time in which a child has to import the main module, s. A child that takes longer is assumed to hang."""
_MAX_FAILED_STARTS = 5
"""Number of consecutive failed starts that are attributed to the machine or the caller's script, and not to chance."""
_GRACE_S = 2.0
"""Longest time from the end of a child's pipe to the end of its process, s, after which its exit code is known."""
_LONGEST_WAIT_S = 3600.0
"""Longest time of one wait for messages, s. Without deadlines it would be infinite, which `wait` does not accept."""
_NOTE = b"note "
"""Prefix of messages that a child sends during a task. All other messages are results."""
_LOG_BYTES = 4000
"""Number of bytes at the end of a task's output that are kept."""
_MAX_REASON = 500
"""Largest number of characters of a reason in an outcome."""
_PROCESSES = threading.Lock()
"""Held while a process is started or waited for, because `multiprocessing` does not support several threads.

If two threads wait for the same process, one of them does not get its exit code; and each start of a process also waits
for all processes that have ended."""


@dataclass(frozen=True)
class Task:
    """A call to be made in a child process; function, arguments and return value must be picklable."""

    label: str
    """Name of the task in its outcome"""
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
    """Return the task that makes the trajectory of a job, for `isolate`."""
    return Task(job.label, _simulate, (absolute_name(job.engine), job.scene, dict(job.arguments)))


def is_simulation(task: Task) -> bool:
    """Return True for a task of `simulation`, whose arguments are engine, scene and those of `Engine.simulate`."""
    return task.function is _simulate


def _simulate(engine: str, scene: Scene, arguments: Mapping[str, Any]) -> Trajectory:
    return load_engine(engine).simulate(scene, **arguments)


def sealed(task: Task) -> Task:
    """Return an equivalent task whose function and arguments are pickled, and are unpickled only by the child.

    A process that passes it on does not import the modules of the function and its arguments. The exceptions of
    `pickle.dumps` are raised if the task cannot be pickled.
    """
    return Task(task.label, _call_sealed, (pickle.dumps((task.function, task.args)),))


def unsealed(outcome: Outcome) -> Outcome:
    """Return an outcome of ``isolate(.., unpickle=False)`` with its value, or with the reason why it has none."""
    if outcome.status != Status.OK:
        return outcome
    return replace(outcome, **_unpickled(outcome.value))


def _call_sealed(call: bytes) -> Any:
    """Make the call of a `sealed` task."""
    function, args = pickle.loads(call)
    return function(*args)


class ChildrenEnded(StictionError):
    """`IdleChildren.end_all` was called before or while children were used for tasks."""


def isolate(
    tasks: Sequence[Task],
    *,
    workers: int | None = None,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
    on_note: Callable[[str], None] | None = None,
    kept: IdleChildren | None = None,
    unpickle: bool = True,
) -> list[Outcome]:
    """Call the function of each task in a child process.

    Parameters
    ----------
    tasks
        The tasks.
    workers
        Number of children that work at the same time; the number of CPUs if None.
    timeout_s
        Wall-clock time after which the child of a task is killed, s.
    on_result
        Called in this process with each outcome as it arrives. An exception raised by it ends all tasks.
    on_note
        Called in this process with each message that a child logs during a task, for example that it compiles a kernel.
    kept
        Idle children of earlier calls. They are used first, and the children of this call are added to them at its end.
        If None, the children of this call are ended.
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

    Notes
    -----
    No child outlives this call, unless it is idle and added to `kept`. This also holds after an exception, and after an
    interrupt that is followed by another one. If this process itself is killed, its children exit as soon as their
    engine lets Python run.
    """
    workers = (os.cpu_count() or 1) if workers is None else workers
    if workers < 1 or not timeout_s > 0:
        raise ValueError(f"workers, timeout_s: found {workers}, {timeout_s}; expected numbers > 0")
    # Tasks are pickled before any child starts: one that cannot be pickled is an error of the caller.
    queue = _TaskQueue(tasks, timeout_s, on_result)
    children: list[_Child] = [] if kept is None else kept.take(min(workers, len(tasks)))
    failed_starts = 0

    with (
        undisturbed_end() as end,
        tempfile.TemporaryDirectory(prefix="stiction-", ignore_cleanup_errors=True) as folder,
    ):
        try:
            while queue.unfinished:
                # Start as many children as there are tasks for; children that have ended are replaced.
                while len(children) < min(workers, queue.unfinished):
                    children.append(_Child(Path(folder)) if kept is None else kept.start())
                for child in children:
                    queue.feed(child)
                # Wait until a child has sent something or has ended, or until the first deadline.
                patience = min(child.deadline for child in children) - time.monotonic()
                arrived = wait(
                    [child.connection for child in children],
                    min(max(patience, 0.0), _LONGEST_WAIT_S),
                )
                for child in list(children):
                    has_arrived = child.connection in arrived
                    message = child.receive() if has_arrived else None
                    if message is not None and message.startswith(_NOTE):
                        if on_note is not None:
                            on_note(message[len(_NOTE) :].decode())
                    elif message is not None:
                        # The child is ready, or has finished its task. The log is read first, because
                        # the next task empties it.
                        failed_starts = 0
                        log = child.log()
                        index = child.take()
                        if index is not None:
                            # With several children, the next task starts before the outcome is
                            # handled, so that no core is idle meanwhile. A single child waits, as
                            # it would compete with the handling for its core.
                            if workers > 1:
                                queue.feed(child)
                            queue.finish(index, **_read(message, unpickle), log=log)
                    elif has_arrived or child.is_overdue():
                        children.remove(child)
                        result = child.end(timed_out=not has_arrived)
                        if child.task is not None:
                            queue.finish(child.task, **result)
                        elif not child.ready:
                            # No task has failed. After several such starts, further ones would fail.
                            failed_starts += 1
                            if failed_starts == _MAX_FAILED_STARTS:
                                raise RuntimeError(
                                    f"child processes cannot be started: {result['reason']} (a "
                                    "script must call this under `if __name__ == '__main__':`)"
                                )
        finally:
            end()
            for child in children:
                if kept is None or not kept.leave(child):
                    child.kill()
    return queue.outcomes_in_order()


class _TaskQueue:
    """The tasks of one call of `isolate`, and the outcomes of those that are finished.

    Parameters
    ----------
    tasks
        The tasks.
    timeout_s
        Wall-clock time that a task may take, s.
    on_result
        Called with each outcome.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        timeout_s: float,
        on_result: Callable[[Outcome], None] | None,
    ):
        self._labels = [task.label for task in tasks]
        self._calls = [pickle.dumps((task.function, task.args)) for task in tasks]
        self._timeout_s = timeout_s
        self._on_result = on_result
        self._waiting = deque(range(len(tasks)))
        self._outcomes: dict[int, Outcome] = {}

    @property
    def unfinished(self) -> int:
        """Number of tasks without an outcome."""
        return len(self._labels) - len(self._outcomes)

    def feed(self, child: _Child) -> None:
        """Give the next task to a child if it is idle; the task is not removed if the child has just ended."""
        if not child.idle or not self._waiting:
            return
        index = self._waiting[0]
        if child.give(index, self._calls[index], self._timeout_s):
            self._waiting.popleft()

    def finish(self, index: int, **fields: Any) -> None:
        """Record the outcome of a task; `fields` are those of `Outcome` besides the label."""
        self._outcomes[index] = Outcome(self._labels[index], **fields)
        if self._on_result is not None:
            self._on_result(self._outcomes[index])

    def outcomes_in_order(self) -> list[Outcome]:
        """Return the outcomes in the order of the tasks, all of which are finished."""
        return [self._outcomes[index] for index in range(len(self._labels))]


Isolate = Callable[..., list[Outcome]]
"""`isolate`, or a function with the same parameters, such as `stiction.comparisons.bench.store.KeptRuns.isolate`."""


class _Child:
    """The parent's view of a child process, which is starting, idle, or working on one task.

    Attributes
    ----------
    connection : Connection
        The parent's end of the pipe.
    ready : bool
        True after the child has reported that it can take tasks.
    task : int or None
        Index of its task; None if it has none.
    deadline : float
        Value of ``time.monotonic()`` at which it is considered to hang.
    """

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
        """True if the child can take a task."""
        return self.ready and self.task is None

    def is_overdue(self) -> bool:
        """Return True if its time is over, and no message has arrived since the last wait."""
        return time.monotonic() >= self.deadline and not self.connection.poll()

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
        """Make the child idle, after a message has been received.

        Returns
        -------
        int or None
            Index of the task whose result the message is; None if the message says that the child is ready.
        """
        task, self.task = self.task, None
        self.ready = True
        self.deadline = math.inf
        return task

    def end(self, timed_out: bool) -> dict[str, Any]:
        """End the process, and return the status, reason, log and time of its task as fields of an outcome."""
        wall = time.monotonic() - self._started
        with _PROCESSES:
            if not timed_out:
                self._process.join(_GRACE_S)
            code = self._process.exitcode
        self.kill()
        log = self.log()
        shutil.rmtree(self._folder, ignore_errors=True)
        if timed_out:
            status = Status.TIMED_OUT
            reason = f"no result within {self.deadline - self._started:g} s"
        else:
            status = Status.CRASHED
            reason = _end_of_process(code)
            last_output = last_lines(log)
            if last_output:
                reason = f"{reason}: {last_output}"
            reason = _shortened(reason)
        return {"status": status, "reason": reason, "log": log, "wall_s": wall}

    def log(self) -> str:
        """Return the end of the output of the current task."""
        with self._log.open("rb") as file:
            file.seek(max(0, self._log.stat().st_size - _LOG_BYTES))
            return file.read().decode(errors="replace").strip()

    def kill(self) -> None:
        """End the process, and wait for its end."""
        self.stop()
        with _PROCESSES:
            self._process.join()
        self.connection.close()

    def stop(self) -> None:
        """Send the signal that ends the process. A thread that waits for its messages notices this by its pipe."""
        self._process.kill()


class IdleChildren:
    """Idle children, for the next calls of `isolate` in this process.

    The imports and kernels of a child take a second or two, many times as long as a short run. Each child has some 200
    MB of memory; therefore all are ended if no call has used them for `idle_s` seconds. They also end with this
    process. Several threads may call `isolate` with the same object.

    Parameters
    ----------
    idle_s
        Time without calls after which the children are ended, s.
    """

    def __init__(self, idle_s: float = 30.0):
        self._folder = tempfile.TemporaryDirectory(prefix="stiction-", ignore_cleanup_errors=True)
        self._idle_s = idle_s
        self._lock = threading.Lock()
        self._children: list[_Child] = []
        # All children that were started here, also those that work for a call of `isolate`.
        self._started: weakref.WeakSet[_Child] = weakref.WeakSet()
        self._ended = False
        self._timer: threading.Timer | None = None

    def start(self) -> _Child:
        """Return a new child, which is to be added by `leave` when it is idle.

        Raises
        ------
        ChildrenEnded
            If `end_all` has been called.
        """
        with self._lock:
            if self._ended:
                raise ChildrenEnded("these children have been ended")
            child = _Child(Path(self._folder.name))
            self._started.add(child)
        return child

    def take(self, count: int) -> list[_Child]:
        """Remove up to `count` children, and return them."""
        with self._lock:
            taken, self._children = self._children[:count], self._children[count:]
        return taken

    def leave(self, child: _Child) -> bool:
        """Add a child. Return False if it is not idle, or if `end_all` has been called."""
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
        """End all idle children."""
        for child in self.take(len(self._children)):
            child.kill()

    def end_all(self) -> None:
        """End all children for good, also those that work for a call of `isolate` in another thread.

        Such a call raises ChildrenEnded when it starts a new child.
        """
        with self._lock:
            self._ended = True
            if self._timer is not None:
                self._timer.cancel()
            for child in self._started:
                child.stop()
        self.end()


def _end_of_process(code: int | None) -> str:
    """Return a description of the end of a process; its exit code is None if the process has not ended."""
    if code is None:
        return "closed its pipe"
    if code >= 0:
        return f"exit code {code} before there was a result"
    # A negative code is the number of the signal that ended the process.
    if -code not in set(signal.Signals):
        return f"signal {-code}"
    name = signal.Signals(-code).name
    return f"{name} (killed from outside, or out of memory)" if name == "SIGKILL" else name


def _read(message: bytes, unpickle: bool = True) -> dict[str, Any]:
    """Return the fields of an outcome from the message in which a child returns it; see `_answer`."""
    fields, value = pickle.loads(message)
    if fields["status"] != Status.OK:
        return fields
    if unpickle:
        return fields | _unpickled(value)
    return fields | {"value": value}


def _unpickled(value: bytes) -> dict[str, Any]:
    """Return the field ``value`` of an outcome, or the fields of a failure if the value cannot be unpickled."""
    try:
        return {"value": pickle.loads(value)}
    except Exception as error:
        return {
            "value": None,
            "status": Status.FAILED,
            "reason": _one_line(error, "result cannot be unpickled: "),
        }


def _serve(connection: Connection, folder: Path, log: Path) -> None:
    """Run in a child: report that it is ready, then answer one call after another.

    Parameters
    ----------
    connection
        The child's end of the pipe.
    folder
        Folder for temporary files, which is removed by the process that ends the child.
    log
        File to which all output is written.
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
    """A handler that sends log records to the parent, as notes."""

    def __init__(self, connection: Connection):
        super().__init__()
        self._connection = connection

    def emit(self, record: logging.LogRecord) -> None:
        self._connection.send_bytes(_NOTE + record.getMessage().encode())


def _leave_with_parent(folder: Path) -> None:
    """Wait for the end of the parent, then remove its folder and exit without any clean-up of Python."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _answer(call: bytes) -> bytes:
    """Make a call, and return its result as a message for the parent.

    Parameters
    ----------
    call
        The pickled function and arguments.

    Returns
    -------
    bytes
        The pickled pair of the fields of an outcome and of the value. The value is pickled separately, so that the
        parent can pass it on without unpickling, and can report if it cannot be unpickled.
    """
    fields: dict[str, Any] = {"status": Status.OK, "reason": ""}
    value = None
    wall_begin, cpu_begin = time.perf_counter(), time.process_time()
    try:
        function, args = pickle.loads(call)
        value = function(*args)
    except BaseException as error:
        # No exception of a task may end the child, not even SystemExit.
        traceback.print_exc()
        fields = {
            "status": _status_of(error),
            "reason": _one_line(error),
            "bug": not isinstance(error, StictionError),
        }
    fields["wall_s"] = time.perf_counter() - wall_begin
    fields["cpu_s"] = time.process_time() - cpu_begin
    try:
        pickled_value = pickle.dumps(value)
    except Exception as error:
        fields["status"] = Status.FAILED
        fields["reason"] = _one_line(error, "result cannot be pickled: ")
        pickled_value = pickle.dumps(None)
    sys.stdout.flush()
    return pickle.dumps((fields, pickled_value))


def _status_of(error: BaseException) -> Status:
    """Return the status of a task that raised this exception."""
    if isinstance(error, Refused):
        return Status.REFUSED
    if isinstance(error, EngineMissing):
        return Status.MISSING
    return Status.FAILED


def _one_line(error: BaseException, prefix: str = "") -> str:
    """Return an exception in one line: the message of an error of the suite, or type and message of another one."""
    message = f"{type(error).__name__}: {error}"
    if isinstance(error, StictionError) and str(error):
        message = str(error)
    return _shortened(prefix + message)


def _shortened(text: str) -> str:
    """Return a text in one line of at most `_MAX_REASON` characters."""
    return textwrap.shorten(text, _MAX_REASON, placeholder=" ...")
