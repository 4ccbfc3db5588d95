"""The application and its process: the working folder on the path, signals, standard output."""

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
    """The whole command line, whose help lists the commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        width = max(len(name) for commands in OVERVIEW.values() for name in commands)
        for group, commands in OVERVIEW.items():
            with formatter.section(group):
                for name, about in commands.items():
                    formatter.write(f"  {name:{width}}  {about.line}\n")
                    # not wrapped, so that it can be copied
                    formatter.write(f"  {'':{width}}    stiction {about.example}\n")


app = typer.Typer(
    cls=Suite,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog=EXIT_CODES,
)
for part in (describe, pictures, run, judge, prove, campaign, report):
    app.add_typer(part.commands)
app.add_typer(compare.commands, name="compare")
app.add_typer(campaign.baselines, name="baseline")


def _version(wanted: bool) -> None:
    if wanted:
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
    pass


def main() -> None:
    """Run the command `stiction`; ``--engine module:Class`` is looked up in the working folder too."""
    sys.path.append(os.getcwd())
    signal.signal(signal.SIGTERM, terminate)
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # of stiction.silent_interrupt
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        if error.filename is not None:
            raise
        # without a file: standard output, which is all that is written without a name
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # what is left in its buffer has nowhere to go
        say(f"standard output: {error.strerror or error}")
        sys.exit(FAILED)
