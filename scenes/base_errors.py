"""Base classes of the errors that the suite raises on purpose."""

from __future__ import annotations


class StictionError(Exception):
    """Base class of the errors that the suite raises on purpose; the message is written for the user.

    Examples are unusable input, a scene that an engine refuses, and a run that failed. Every other exception is a bug,
    and is shown with its traceback.
    """


class InputError(StictionError, ValueError):
    """Unusable input; the message states the argument or key, the value found and what was expected.

    It is also a ValueError, Python's exception for arguments with a wrong value.
    """

    # The suite never catches ValueError in its place: NumPy's shape errors are ValueErrors too, and they are bugs.
