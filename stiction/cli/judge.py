"""Commands for users of other programs: ``judge`` for their results, ``dataset`` for the benchmark and truths."""

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
            metavar="SCENE|SUBMISSION",
            help="Name of a scene of the catalogue, path of a TOML file, or folder of a "
            "scene in a data set of truths. In the last case the truth is read "
            "instead of computed. Without RESULT: folder of a submission to the "
            "friction benchmark.",
        ),
    ],
    result: Annotated[
        Path | None,
        typer.Argument(
            metavar="RESULT",
            help="Table of results (.csv or .parquet) with a column t and one or more "
            "columns of the scene. Two rows with the same time are the two sides of a "
            "jump.",
        ),
    ] = None,
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
    """Judge a table of results from any program, or a submission to the friction benchmark.

    Errors, stick phases, jumps, drift and energy of a table; for a submission, a verdict on each scene.
    """
    if result is None:
        options = {
            "--map": names,
            "--units": units,
            "--max-error": max_error is not None,
            "--t-end": t_end is not None,
            "--set": overrides,
            "--assemble": assemble,
        }
        given = [option for option, is_given in options.items() if is_given]
        _judge_submission(Path(scene), given, out)
        return
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


def _judge_submission(folder: Path, options: list[str], out: Path | None) -> None:
    """Judge the submission in a folder; `options` are those that were given and belong to a single table.

    Raises
    ------
    typer.Exit
        With the code `REGRESSED` if a result is beyond its bounds or that of other parameters, and `BAD_INPUT` if a
        result cannot be judged, or if there is no result.
    """
    from stiction.comparisons.judge.benchmark import benchmark_scenes
    from stiction.comparisons.judge.submission import UNUSABLE, WRONG, judge_submission
    from stiction.reports.run_folder.overwriting import check_folder
    from stiction.reports.submission_page import (
        MAIN,
        submission_section,
        write_submission_judgement,
    )

    _check_submission_folder(folder)
    if options:
        raise typer.BadParameter(
            "found this option with a submission; expected it with a single table",
            param_hint=options[0],
        )
    with errors_of_option("--out"):
        if out is not None:
            check_folder(out, MAIN)
    with progress("judge") as bar:
        bar.start(len(benchmark_scenes()))
        judged = judge_submission(folder, bar.result)
    section = submission_section(judged)
    print(section.answer, *section.findings, "", sep="\n")
    for table in section.tables:
        show(table.heads(), table.cells())
    if out is not None:
        print(write_submission_judgement(judged, out))
    for code, verdicts in ((REGRESSED, WRONG), (BAD_INPUT, UNUSABLE)):
        if judged.count(*verdicts):
            counts = [
                f"{judged.count(verdict)} of {judged.submitted} results: {verdict}"
                for verdict in verdicts
                if judged.count(verdict)
            ]
            raise exit_with(code, f"{folder}: {'; '.join(counts)}; expected none")
    if not judged.submitted:
        raise exit_with(
            BAD_INPUT,
            f"{folder}: no scene was judged: found no table; expected SCENE.csv or SCENE.parquet of one or more scenes",
        )


def _check_submission_folder(folder: Path) -> None:
    """Raise an error if a path is not the folder of a submission; it may be the scene of a table that is missing."""
    from stiction.comparisons.judge.submission import DESCRIPTION, is_submission
    from stiction.comparisons.judge.truth_folder import ABOUT
    from stiction.scenes import catalogue
    from stiction.scenes.table_blocks import ENDINGS

    if is_submission(folder):
        return
    is_scene = str(folder) in (*catalogue(), *catalogue("hard")) or (folder / ABOUT).is_file()
    if is_scene or (folder.is_file() and folder.suffix == ".toml" and folder.name != DESCRIPTION):
        raise typer.BadParameter(
            f"found none; {folder} is a scene: expected a table of results of it as the second argument",
            param_hint="RESULT",
        )
    if folder.is_file():
        remedy = f"expected a folder, such as that of the file, {folder.parent}, with {DESCRIPTION} in it"
        if folder.suffix in ENDINGS:
            remedy += (
                f"; to judge this table alone, give its scene first: stiction judge SCENE {folder}"
            )
        raise typer.BadParameter(f"{folder} is a file; {remedy}", param_hint="SUBMISSION")
    if folder.is_dir():
        raise typer.BadParameter(
            f"found no {DESCRIPTION} in the folder {folder}; expected it beside the tables: it states who made the "
            "submission, and how (the benchmark, written by `stiction dataset FOLDER`, contains an example)",
            param_hint="SUBMISSION",
        )
    raise typer.BadParameter(
        f"found neither a folder nor a scene {folder}; expected the folder of a submission, or a scene and a table of "
        "its results",
        param_hint="SUBMISSION",
    )


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
        typer.Option(
            "--scenes",
            metavar="A,B,..",
            help="Write newly computed truths of these scenes of the catalogue instead; all stands for "
            "every scene with an independent truth.",
        ),
    ] = None,
) -> None:
    """Write the friction benchmark, which does not require stiction.

    It contains scenes, descriptions, exact motions, rules and runner templates. With --scenes, the folder contains the
    truths of other scenes in the same format.
    """
    from stiction.reports.dataset import MAIN, write_benchmark
    from stiction.reports.run_folder.overwriting import check_folder

    with errors_of_option("FOLDER"):
        check_folder(folder, MAIN)
    if scenes:
        _write_truths(folder, split_names(scenes))
    else:
        write_benchmark(folder)
    print(folder / MAIN)


def _write_truths(folder: Path, names: list[str]) -> None:
    """Write the truths of scenes of the catalogue; ``all`` stands for all of them."""
    from stiction.reports.dataset import write_dataset
    from stiction.scenes import catalogue, scene_text

    if names == ["all"]:
        names = [*catalogue(), *catalogue("hard")]
    for name in names:
        # raises an error if the catalogue does not have the scene
        scene_text(name)
    with progress("dataset") as bar:
        bar.start(len(names))
        index = write_dataset(folder, names, bar.result)
    if index.empty:
        raise exit_with(
            FAILED, "none of these scenes has a truth that is independent of the reference"
        )
    show_table(index[["scene", "tier", "events", "position uncertainty [m]", "certificate"]])


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
