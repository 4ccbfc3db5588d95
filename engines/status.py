"""Status of runs and other tasks, as stored in tables, histories and baselines."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class Status(StrEnum):
    """Status of a run, a point of a sweep, or another task.

    The values are used in stored files: tables, baselines, and histories of nightly runs. Texts for readers use
    `STATUS_LABELS`.
    """

    OK = "ok"
    """There is a result. If the run ended early, the reason says why."""
    REFUSED = "refused"
    """The engine cannot represent the scene, or the scene is invalid; nothing was run."""
    FAILED = "failed"
    """The task raised an exception, or its result cannot be transferred to this process."""
    TIMED_OUT = "timed out"
    """There was no result within the time limit, and the process of the task was killed."""
    CRASHED = "crashed"
    """The process of the task was ended by a signal or an exit."""
    MISSING = "missing"
    """The package of the engine is not installed."""
    NOT_RUN = "not run"
    """The campaign was interrupted, or its time was over, before the run began."""
    INCOMPLETE = "incomplete"
    """Shown in place of `OK` if there is a reason: the run ended early, or there is no truth for it."""
    WRONG = "wrong"
    """There is a result without a reported failure, but it is not a motion of the scene."""
    NO_STEADY_STATE = "no steady state"
    """For a point of a sweep or a search: the motion neither comes to rest nor becomes periodic."""
    NOT_FOUND = "not found"
    """For a point of a sweep or a search: what is looked for does not occur in the range.

    There is no number, but that is an answer: the slider slips, or sticks, over the whole range.
    """

    @property
    def label(self) -> str:
        """Word for texts."""
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
"""Words in texts for readers; they may change without an effect on stored results."""
ANSWERS = (Status.OK, Status.NOT_FOUND)
"""Status of tasks that have answered their question, with a number or without one."""
UNMADE = (Status.MISSING, Status.NOT_RUN)
"""Status of runs that were not executed, and are therefore not counted."""
