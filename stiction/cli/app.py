"""The application with all commands, and its process: module path, signals, standard output."""

from __future__ import annotations

import os
import signal
import sys
from typing import Annotated, Any

import typer

from stiction.cli import campaign, compare, describe, judge, pictures, prove, report, run
from stiction.cli.exit_codes import EXIT_CODES, FAILED, Commands, say, terminate
from stiction.cli.overview import OVERVIEW


class Suite(Commands):
    """The group of all commands."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands in the help, in the groups of `OVERVIEW`."""
        width = max(len(name) for commands in OVERVIEW.values() for name in commands)
        for group, commands in OVERVIEW.items():
            with formatter.section(group):
                for name, entry in commands.items():
                    formatter.write(f"  {name:{width}}  {entry.line}\n")
                    # An example is on one line, so that it can be copied.
                    formatter.write(f"  {'':{width}}    stiction {entry.example}\n")


app = typer.Typer(
    cls=Suite,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog=EXIT_CODES,
)
for module in (describe, pictures, run, judge, prove, campaign, report):
    app.add_typer(module.commands)
app.add_typer(compare.commands, name="compare")
app.add_typer(campaign.baselines, name="baseline")


def _version(is_requested: bool) -> None:
    """Print the version and exit, if the option ``--version`` was given."""
    if is_requested:
        from importlib.metadata import version

        print(f"stiction {version('stiction')}")
        raise typer.Exit


@app.callback(
    help="Measure how accurately solvers simulate planar mechanisms with dry friction in sliding joints, and how "
    "much computing time this accuracy costs."
)
def _root(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    # Typer shows the help and the options of this function as those of the command `stiction`.
    pass


def main() -> None:
    """Run the command `stiction`."""
    # Modules of `--engine module:Class` may be in the working folder.
    sys.path.append(os.getcwd())
    signal.signal(signal.SIGTERM, terminate)
    # `stiction.silent_interrupt` has set the default for the time of the imports.
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        if error.filename is not None:
            raise
        # An error without a file name is one of standard output: it is closed, or a disk is full. The
        # rest of its buffer is discarded, so that Python does not report the error again at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        say(f"standard output: {error.strerror or error}")
        sys.exit(FAILED)
