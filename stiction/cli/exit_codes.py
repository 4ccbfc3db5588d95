"""Exit codes, and the errors that lead to them."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

FINE, FAILED, BAD_INPUT, REGRESSED, COULD_NOT_RUN, NOT_COMPARED, INTERRUPTED, TERMINATED = (
    0,
    1,
    2,
    3,
    4,
    5,
    130,
    143,
)
EXIT_CODES = (
    "Exit codes: 0 success (in validate, compare and sweep, failed runs are rows of the result); 1 the run failed: the "
    "engine failed, refused the scene, crashed, is not installed or exceeded the time limit; in validate, a run of the "
    "reference failed; in compare and sweep, all runs failed; 2 invalid input: scene, override, option, engine, "
    "campaign, baseline or output; 3 a regression (nightly, check), a changed truth (baseline "
    "update), or an error above --max-error (judge); 4 no regression, but not all runs could be "
    "made (nightly, check); 5 nothing was compared, because there is no baseline (nightly, check); 130 interrupted; "
    "143 ended by SIGTERM. An internal error prints a traceback and exits with 1."
)
IN_BRIEF = (
    "Exit codes: 0 success, 1 failed, 2 invalid input, 3 regression, 4 not all runs made, 5 nothing compared; "
    "see `stiction --help`."
)
SAME_SIGNAL_S = 1.0
"""The same signal again within it is the same one: GNU ``timeout`` signals the command and then its group."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: it leaves the same behind as an interrupt, with an exit code of its own."""


class Commands(TyperGroup):
    """A group whose commands end with exit codes: errors of the suite with a message, others with a traceback."""

    def get_command(self, ctx: Any, name: str) -> Any:
        command = super().get_command(ctx, name)
        if command is not None:
            command.epilog = IN_BRIEF
            command.short_help = (
                command.help
            )  # else cut at the width of a column in the list of commands
        return command

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise interrupted(interrupt) from None
        except typer.Exit:
            raise
        except Exception as error:
            from stiction.scenes.base_errors import InputError, StictionError

            if not isinstance(error, StictionError):
                raise
            raise ended(
                BAD_INPUT if isinstance(error, InputError) else FAILED, str(error)
            ) from None


def say(message: str) -> None:
    """Print a message on standard error."""
    print(f"stiction: {message}", file=sys.stderr)


def ended(code: int, message: str) -> typer.Exit:
    """Print the reason on standard error, and return the end of a command with an exit code, to be raised."""
    say(message)
    return typer.Exit(code)


def interrupted(by: KeyboardInterrupt, left: str = "") -> typer.Exit:
    """Print what a signal has left, and return the end of the command, to be raised."""
    code, words = (
        (TERMINATED, "ended by SIGTERM")
        if isinstance(by, Terminated)
        else (INTERRUPTED, "interrupted")
    )
    return ended(code, f"{words}: {left}" if left else words)


def terminate(*_: Any) -> None:
    """Handle SIGTERM: leave as after an error, temporary folders removed and children ended."""
    raise Terminated


@contextmanager
def first_signal(taken_by: Callable[[KeyboardInterrupt], None]) -> Iterator[None]:
    """Give the first interrupt or SIGTERM to `taken_by`, wherever it comes.

    Another one, or the same again after `SAME_SIGNAL_S`, ends the command as ever.
    """
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    first: tuple[int, float] | None = None

    def take(number: int, _: Any) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = number, now
            taken_by(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
        elif number != first[0] or now - first[1] > SAME_SIGNAL_S:
            restore()
            signal.raise_signal(number)

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as nohup has it
            signal.signal(number, take)
    try:
        yield
    finally:
        restore()
