"""The family of errors that the suite raises on purpose; every other exception is a bug and keeps its traceback."""

from __future__ import annotations


class StictionError(Exception):
    """Expected failure that its message explains: bad input, a refusal, a run or a file that failed."""


class InputError(StictionError, ValueError):
    """Input that cannot be used; the message names it, what was found and what was expected.

    It is a ValueError, as Python has it for bad arguments. The suite never catches ValueError to find it: numpy's shape
    errors are ValueErrors as well, and they are bugs.
    """
