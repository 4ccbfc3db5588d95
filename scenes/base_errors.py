"""The family of errors that the suite raises on purpose; every other exception is a bug and keeps its traceback."""

from __future__ import annotations


class StictionError(Exception):
    """Something that the suite expects to happen and can say in words: bad input, a refusal, a run or a file that failed."""


class InputError(StictionError, ValueError):
    """What a user, or an engine's caller, gave cannot be used; the message names it, what was found and what was expected.

    It is a ValueError, as Python has it for bad arguments. The suite never catches ValueError to find it: numpy's shape errors
    are ValueErrors as well, and they are bugs.
    """
