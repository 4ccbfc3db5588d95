"""Commands for users of other programs: ``judge`` for their results, ``dataset`` for the truths."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.exit_codes import BAD_INPUT, FAILED, REGRESSED, exit_with
from stiction.cli.options import (
    Assemble,
    EndTime,
    Overrides,
    errors_of_option,
    positive,
    scene_of,
    split_names,
)
from stiction.cli.render import announce, progress, show, show_table

if TYPE_CHECKING:
    from stiction.comparisons.judge.judgement import Judgement

commands = typer.Typer()


@commands.command()
def judge(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="Name of a scene of the catalogue, path of a TOML file, or folder of a "
            "scene in a data set of truths. In the last case the truth is read "
            "instead of computed.",
        ),
    ],
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            help="Table of results (.csv or .parquet) with a column t and one or more "
            "columns of the scene. Two rows with the same time are the two sides of a "
            "jump.",
        ),
    ],
    names: Annotated[
        list[str],
        typer.Option(
            "--map",
            metavar="MINE=COLUMN",
            help="Column MINE of RESULT is COLUMN of the scene: x1=slider.x. x1=-slider.x "
            "reverses the sign; x1= ignores the column. Repeatable.",
        ),
    ] = [],
    units: Annotated[
        str,
        typer.Option(
            metavar="A,B,..",
            help="Units of RESULT other than SI: mm, cm; deg; ms, us; kN, mN. They apply "
            "to all columns: with mm, velocities are in mm/s and moments in N mm.",
        ),
    ] = "",
    max_error: Annotated[
        float | None,
        typer.Option(
            "--max-error",
            metavar="M",
            parser=positive,
            help="Exit with code 3 if the error of a position exceeds M metres (angles are "
            "multiplied by the size of the mechanism), or if RESULT does not cover "
            "the whole run.",
        ),
    ] = None,
    t_end: EndTime = None,
    overrides: Overrides = [],
    assemble: Assemble = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write a page, a figure and the tables to this folder, which must be new, "
            "empty, or written by an earlier call.",
        ),
    ] = None,
) -> None:
    """Judge a table of results from any program: errors, stick phases, jumps, drift and energy."""
    from stiction.comparisons.judge.judgement import judge as judged_by
    from stiction.comparisons.judge.truth_folder import is_truth_folder
    from stiction.reports.judgement_page import MAIN, judgement_section, write_judgement
    from stiction.reports.run_folder.overwriting import check_folder
    from stiction.scenes.result_table import parse_map, parse_units

    with errors_of_option("--map"):
        mapping = parse_map(names)
    with errors_of_option("--units"):
        sizes = parse_units(units)
    with errors_of_option("--out"):
        if out is not None:
            check_folder(out, MAIN)
    # The folder of a truth contains its scene, too.
    is_folder = is_truth_folder(scene)
    if is_folder and (overrides or assemble):
        raise typer.BadParameter(
            "found this option with a folder of a data set; expected a scene",
            param_hint="--set" if overrides else "--assemble",
        )
    announce(f"computing the true solution of {scene}, and comparing")
    chosen = scene if is_folder else scene_of(scene, overrides, assemble)
    with progress("judge") as bar:
        judged = judged_by(chosen, result, mapping, sizes, t_end, tell=bar.share)
    section = judgement_section(judged)
    print(f"{result} on {judged.scene.name}", section.answer, *section.findings, "", sep="\n")
    for view in section.tables[:1]:
        show(view.heads(), view.cells())
    if out is not None:
        print(write_judgement(judged, out))
    _fail_if_wrong(judged, max_error)


@commands.command()
def dataset(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Folder to write, which must be new, empty, or written by an earlier call.",
        ),
    ],
    scenes: Annotated[
        list[str] | None,
        typer.Option("--scenes", metavar="A,B,..", help="Scenes of the catalogue. Default: all."),
    ] = None,
) -> None:
    """Write the truths of the catalogue's scenes as a data set that does not require stiction.

    It contains tables, events, proofs and a README.
    """
    from stiction.reports.dataset import MAIN, write_dataset
    from stiction.reports.run_folder.overwriting import check_folder
    from stiction.scenes import catalogue, scene_text

    names = split_names(scenes) if scenes else [*catalogue(), *catalogue("hard")]
    for name in names:
        # raises an error if the catalogue does not have the scene
        scene_text(name)
    with errors_of_option("FOLDER"):
        check_folder(folder, MAIN)
    with progress("dataset") as bar:
        bar.start(len(names))
        index = write_dataset(folder, names, bar.result)
    if index.empty:
        raise exit_with(
            FAILED, "none of these scenes has a truth that is independent of the reference"
        )
    show_table(index[["scene", "tier", "events", "position uncertainty [m]", "certificate"]])
    print(folder / MAIN)


def _fail_if_wrong(judged: Judgement, max_error: float | None) -> None:
    """Fail if a table was misread, or if its position error exceeds `max_error` or cannot be judged by it.

    Raises
    ------
    typer.Exit
        With the code `REGRESSED` if the error is too large or the table ends early, and `BAD_INPUT` if the
        table or `max_error` does not allow a judgement.
    """
    origin = judged.table.origin
    if judged.is_misread:
        causes = "; ".join(
            f"{', '.join(columns)}: {cause}" for cause, columns in judged.hints.items()
        )
        raise exit_with(BAD_INPUT, f"{origin}: {causes}")
    if max_error is None:
        return
    if judged.error is None or judged.uncertainty is None:
        raise exit_with(
            BAD_INPUT, "--max-error: found no position with a known truth; expected one or more"
        )
    if judged.uncertainty >= max_error:
        raise exit_with(
            BAD_INPUT,
            f"--max-error: found {max_error:g} m; expected more than the uncertainty of the truth, "
            f"{judged.uncertainty:.2g} m",
        )
    if not judged.is_complete:
        t = judged.trajectory.t
        raise exit_with(
            REGRESSED,
            f"{origin}: found times from {t[0]:g} to {t[-1]:g} s; expected 0 to "
            f"{judged.scene.t_end:g} s (--t-end says otherwise)",
        )
    if judged.error > max_error:
        raise exit_with(
            REGRESSED,
            f"{origin}: position error {judged.error:.3g} m; expected at most {max_error:g} m",
        )
    _fail_if_not_judged(judged)


def _fail_if_not_judged(judged: Judgement) -> None:
    """Fail if a small error means nothing, because rows are missing or no position depends on forces."""
    from stiction.comparisons.judge.judgement import LARGEST_GAP

    origin = judged.table.origin
    if not judged.is_covered:
        raise exit_with(
            BAD_INPUT,
            f"{origin}: found rows {judged.widest_gap:g} s from each other; expected at most "
            f"{LARGEST_GAP * judged.scene.t_end:g} s, a tenth of the scene: what lies between was not "
            "judged",
        )
    if judged.says_nothing:
        raise exit_with(
            BAD_INPUT,
            f"{origin}: found no position but {', '.join(judged.held)}, which drives and joints "
            "prescribe; expected one that forces move: these say nothing of a solver",
        )
