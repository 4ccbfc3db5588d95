"""Exit codes of commands, messages on standard error, and the handling of signals."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

FINE = 0
FAILED = 1
BAD_INPUT = 2
REGRESSED = 3
COULD_NOT_RUN = 4
NOT_COMPARED = 5
INTERRUPTED = 130
"""128 + SIGINT, as shells report it."""
TERMINATED = 143
"""128 + SIGTERM, as shells report it."""
EXIT_CODES = (
    "Exit codes: 0 success (in validate, compare and sweep, failed runs are rows of the result); 1 the run failed: the "
    "engine failed, refused the scene, crashed, is not installed or exceeded the time limit; in validate, a run of the "
    "reference failed; in compare and sweep, all runs failed; 2 invalid input: scene, override, option, engine, "
    "campaign, baseline or output; 3 a regression (nightly, check), a changed truth (baseline "
    "update), or an error above --max-error or the bounds of the benchmark (judge); 4 no "
    "regression, but not all runs could be "
    "made (nightly, check); 5 nothing was compared, because there is no baseline (nightly, check); 130 interrupted; "
    "143 ended by SIGTERM. An internal error prints a traceback and exits with 1."
)
IN_BRIEF = (
    "Exit codes: 0 success, 1 failed, 2 invalid input, 3 regression, 4 not all runs made, 5 nothing compared; "
    "see `stiction --help`."
)
SAME_SIGNAL_S = 1.0
"""Time in which a repeated signal counts as the same one, s.

GNU ``timeout`` sends a signal to the command and then to its process group, which the command is part of.
"""


class Terminated(KeyboardInterrupt):
    """SIGTERM was received. It is handled like an interrupt, but has its own exit code."""


class Commands(TyperGroup):
    """A group of commands that turns errors into exit codes.

    Errors of the suite and signals end a command with a message, and other errors with a traceback.
    """

    def get_command(self, ctx: Any, name: str) -> Any:
        """Return a command, with a line about exit codes at the end of its help."""
        command = super().get_command(ctx, name)
        if command is not None:
            command.epilog = IN_BRIEF
            # The default is cut at the width of a column in the list of commands.
            command.short_help = command.help
        return command

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was called."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise exit_interrupted(interrupt) from None
        except typer.Exit:
            raise
        except Exception as error:
            from stiction.scenes.base_errors import InputError, StictionError

            if not isinstance(error, StictionError):
                raise
            code = BAD_INPUT if isinstance(error, InputError) else FAILED
            raise exit_with(code, str(error)) from None


def say(message: str) -> None:
    """Print a message on standard error."""
    print(f"stiction: {message}", file=sys.stderr)


def exit_with(code: int, message: str) -> typer.Exit:
    """Print a message on standard error, and return the exception that ends a command with this exit code."""
    say(message)
    return typer.Exit(code)


def exit_interrupted(interrupt: KeyboardInterrupt, remark: str = "") -> typer.Exit:
    """Print that a signal was received, and return the exception that ends the command.

    `remark` states what the interrupted command has left, such as runs that are stored.
    """
    code, message = INTERRUPTED, "interrupted"
    if isinstance(interrupt, Terminated):
        code, message = TERMINATED, "ended by SIGTERM"
    return exit_with(code, f"{message}: {remark}" if remark else message)


def terminate(*_: Any) -> None:
    """Handle SIGTERM by an exception, so that temporary folders are removed and child processes are ended."""
    raise Terminated


@contextmanager
def first_signal(handle: Callable[[KeyboardInterrupt], None]) -> Iterator[None]:
    """Pass the first SIGINT or SIGTERM within the block to `handle`.

    Any other signal ends the command as usual, also the same signal again after `SAME_SIGNAL_S`.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    first: tuple[int, float] | None = None  # number of the first signal, and its time in s

    def restore() -> None:
        for number, handler in handlers.items():
            signal.signal(number, handler)

    def on_signal(number: int, _: Any) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = number, now
            handle(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
            return
        first_number, first_time = first
        if number != first_number or now - first_time > SAME_SIGNAL_S:
            restore()
            signal.raise_signal(number)

    for number, handler in handlers.items():
        # nohup starts a command with signals that are ignored, and they stay ignored.
        if handler is not signal.SIG_IGN:
            signal.signal(number, on_signal)
    try:
        yield
    finally:
        restore()
