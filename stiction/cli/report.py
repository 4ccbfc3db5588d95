"""Commands that publish a finished run or a history: ``paper``, ``page``, ``site``, ``trace``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stiction.cli.options import RunFolder, check_distinct, check_written, errors_of_option
from stiction.cli.render import progress, show

commands = typer.Typer()


@commands.command()
def paper(
    run: RunFolder,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder to write, which must be new, empty, or written by an earlier call.",
        ),
    ],
    width: Annotated[
        str,
        typer.Option(
            metavar="double|single",
            help="Width of the figures: two columns of a journal page (174 mm) or one (84 mm).",
        ),
    ] = "double",
    author: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Author, printed below the title. Repeatable."),
    ] = None,
) -> None:
    """Write a run as vector figures, LaTeX and CSV tables, methods, references and a PDF.

    The files are reproducible byte for byte.
    """
    from stiction.reports import check_folder
    from stiction.reports.figures.style import COLUMNS
    from stiction.reports.paper import AUTHORS, MAIN, write_paper
    from stiction.reports.run_folder.stored_run import read_run

    if width not in COLUMNS:
        raise typer.BadParameter(
            f"found {width!r}; expected one of {', '.join(COLUMNS)}", param_hint="--width"
        )
    stored = read_run(run)
    with errors_of_option("--out"):
        check_folder(out, MAIN, run)
    with progress("paper"):
        file = write_paper(stored, out, width, tuple(author or AUTHORS))
    print(file)


@commands.command()
def page(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|HISTORY", help="Folder of a run, or history written by `stiction nightly`."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File to write. Default: the name of RUN or HISTORY with .html appended.",
        ),
    ] = None,
) -> None:
    """Write a run, or the history of nightly runs, as an HTML page that needs no network."""
    from stiction.reports.page import write_history_page, write_run_page
    from stiction.reports.run_folder.stored_run import read_run

    if not source.exists():
        raise typer.BadParameter(
            f"found {str(source)!r}, which does not exist; expected the folder of a run, or a "
            "history",
            param_hint="RUN|HISTORY",
        )
    file = out or source.with_name(source.resolve().name + ".html")
    check_written(file, (".html",), "--out")
    check_distinct("--out", file, source)
    if source.is_dir():
        write_run_page(read_run(source), file)
    else:
        with errors_of_option("HISTORY"):
            write_history_page(source, file)
    print(file)


@commands.command()
def site(
    history: Annotated[
        Path,
        typer.Argument(metavar="HISTORY", help="History written by `stiction nightly`."),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder to write, which must be new, empty, or written by an earlier call.",
        ),
    ],
    run: Annotated[
        list[Path],
        typer.Option(
            metavar="RUN",
            help="Folder written by `stiction validate`, for the front page and the pages of "
            "questions. Repeatable; the newest run is shown, the others are compared with it.",
        ),
    ] = [],
    submissions: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder with a subfolder for each submission to the friction benchmark, which are judged.",
        ),
    ] = None,
    dataset: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder written by `stiction dataset`, offered for download."
        ),
    ] = None,
    docs: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Documentation as HTML, written by `mkdocs build`."),
    ] = None,
) -> None:
    """Write a web site of results, which needs no network and no server.

    It has a front page, a page for each question, each engine and each submission, and one for all nights.
    """
    from stiction.reports import check_folder
    from stiction.reports.run_folder.stored_run import read_run
    from stiction.reports.site import write_site
    from stiction.reports.site.layout import INDEX
    from stiction.reports.site.site import check_dataset, check_docs
    from stiction.reports.site.submissions import judged_submission, submission_folders

    if not history.is_file():
        raise typer.BadParameter(
            f"found {str(history)!r}, which is no file; expected a history of `stiction nightly`, such as "
            "nightly/history.sqlite",
            param_hint="HISTORY",
        )
    with errors_of_option("--out"):
        check_folder(out, INDEX)
    with errors_of_option("--dataset"):
        check_dataset(dataset)
    with errors_of_option("--docs"):
        check_docs(docs)
    with errors_of_option("--run"):
        runs = [read_run(folder) for folder in run]
    judged = []
    if submissions is not None:
        with errors_of_option("--submissions"):
            judged = [judged_submission(folder) for folder in submission_folders(submissions)]
    with errors_of_option("HISTORY"):
        file = write_site(history, out, runs, judged, dataset=dataset, docs=docs)
    print(file)


@commands.command()
def trace(
    run: RunFolder,
    key: Annotated[
        str,
        typer.Argument(
            metavar="KEY", help="Key from the last column of a table, for example accuracy:12."
        ),
    ],
) -> None:
    """Show the origin of a number in a table of `paper` or `page`: row, trajectory, truth, settings and versions."""
    from stiction.reports.report import report_of
    from stiction.reports.run_folder.stored_run import read_run
    from stiction.reports.run_folder.trace import describe_source, resolve

    stored = read_run(run)
    tables = report_of(stored.validation()).tables
    show(("what", "value"), describe_source(stored, resolve(stored, tables, key)))
