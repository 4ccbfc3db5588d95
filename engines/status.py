"""How a run or another task has ended: the one list of words that tables, histories and baselines have for it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class Status(StrEnum):
    """How a run, a point of a sweep or another task has ended.

    The values are keys of stored files: tables, baselines, histories of nights. What people read is in `STATUS_LABELS`.
    """

    OK = "ok"
    """There is a result. A run that ended early is one of these, and its reason says why."""
    REFUSED = "refused"
    """The engine cannot represent the scene, or the scene is none; nothing was run."""
    FAILED = "failed"
    """An exception, or a result that cannot be taken to this process."""
    TIMED_OUT = "timed out"
    """No result within the time that the task was given; its process was ended."""
    CRASHED = "crashed"
    """The process of the task ended by a signal or an exit."""
    MISSING = "missing"
    """The engine's package is not installed."""
    NOT_RUN = "not run"
    """The campaign was interrupted, or its time was over, before the run began."""
    INCOMPLETE = "incomplete"
    """`OK` in the data, with a reason: the run ended early, or there is no truth for it."""
    WRONG = "wrong"
    """There is a result, and the engine reported no failure, but it is not a motion of the scene."""
    NO_STEADY_STATE = "no steady state"
    """Of a point of a sweep: the motion neither rests nor repeats itself."""
    NOT_FOUND = "not found"
    """Of a point of a sweep: the amplitudes that were searched do not enclose a threshold."""

    @property
    def label(self) -> str:
        """What people read."""
        return STATUS_LABELS[self]


STATUS_LABELS: Mapping[Status, str] = {
    Status.OK: "ok",
    Status.REFUSED: "refused",
    Status.FAILED: "failed",
    Status.TIMED_OUT: "timed out",
    Status.CRASHED: "crashed",
    Status.MISSING: "missing",
    Status.NOT_RUN: "not run",
    Status.INCOMPLETE: "incomplete",
    Status.WRONG: "wrong",
    Status.NO_STEADY_STATE: "no steady state",
    Status.NOT_FOUND: "not found",
}
"""Words for people; no result depends on them."""
UNMADE = (Status.MISSING, Status.NOT_RUN)
"""Of runs that were not made, which do not count."""
