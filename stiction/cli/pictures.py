"""Commands for writing scenes, ``new``, ``draw`` and ``schema``, and the pictures of a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.exit_codes import say
from stiction.cli.options import (
    PICTURES,
    Assemble,
    Overrides,
    SceneName,
    check_written,
    errors_of_option,
    scene_of,
    written,
)
from stiction.cli.render import print_or_write

if TYPE_CHECKING:
    from stiction.scenes import Scene, Trajectory

commands = typer.Typer()


def _film(path: Path | None) -> Path | None:
    """Check that the file of the option ``--animate`` can be written."""
    if path is not None:
        from stiction.scenes.pictures.animation import check_animation

        check_written(path)
        with errors_of_option("--animate"):
            check_animation(path)
    return path


Plot = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        metavar="FILE",
        callback=written(*PICTURES),
        help="Plot displacement, slip velocity, corner forces, friction and motor "
        "effort to this file (.svg, .pdf or .png).",
    ),
]
Animation = Annotated[
    Path | None,
    typer.Option(
        "--animate",
        metavar="FILE",
        callback=_film,
        help="Write a film of the mechanism and the forces on its sliders (.gif, "
        ".html, or .mp4, which needs ffmpeg).",
    ),
]


@commands.command()
def new(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            callback=written(".toml"),
            help="Scene file to write (.toml); it must not exist yet.",
        ),
    ],
    like: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE",
            help="Copy this scene of the catalogue. Default: a small scene with friction "
            "and explanatory comments.",
        ),
    ] = None,
    assemble: Annotated[
        str | None,
        typer.Option(
            "--assemble",
            metavar="SCENE",
            help="Write this scene (a name or a TOML file) with a start that satisfies its "
            "constraints: loops are closed, and velocities fit joints and drives. Expressions "
            "are replaced by their values.",
        ),
    ] = None,
) -> None:
    """Create a scene file, and a JSON schema with which text editors complete and check it."""
    from stiction.scenes import new_scene_text, scene_text
    from stiction.scenes.atomic_files import write_text
    from stiction.scenes.schema import SCHEMA_FILE, scene_schema_text

    if like is not None and assemble is not None:
        raise typer.BadParameter(
            "found both; expected at most one of them", param_hint="--like, --assemble"
        )
    if assemble is not None:
        text = scene_of(assemble, [], assemble=True).to_toml()
    elif like is not None:
        text = scene_text(like)
    else:
        text = new_scene_text()
    if file.exists():
        raise typer.BadParameter(
            f"found {str(file)!r}, which already exists; expected a new name", param_hint="FILE"
        )
    write_text(file, f"#:schema {SCHEMA_FILE}\n{text}")
    print(file)
    schema = file.with_name(SCHEMA_FILE)
    if not schema.exists():
        write_text(schema, scene_schema_text())
        print(schema)


@commands.command()
def draw(
    scene: SceneName,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            callback=written(*PICTURES),
            help="Picture to write (.svg, .pdf or .png).",
        ),
    ],
    overrides: Overrides = [],
    assemble: Assemble = False,
) -> None:
    """Draw a scene at t = 0: bodies, pins, guides, sliders with numbered corners, drives, springs and loads."""
    from stiction.scenes.atomic_files import whole_file

    loaded = scene_of(scene, overrides, assemble)
    _say_what_is_open(loaded)
    with whole_file(out) as partial:
        loaded.draw().write(partial)
    print(out)


def _say_what_is_open(scene: Scene) -> None:
    """Print on standard error which constraints the start of a scene violates: a drawing shows them as gaps."""
    from stiction.reference_impl.multibody.initial_state import with_consistent_start
    from stiction.scenes import SceneError

    try:
        with_consistent_start(scene)
    except SceneError as error:
        say(f"the mechanism is drawn as it is, although its start is not consistent:\n{error}")


@commands.command()
def schema(
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            callback=written(".json"),
            help="File to write (.json). Default: standard output.",
        ),
    ] = None,
    resolved: Annotated[
        bool,
        typer.Option(
            "--resolved",
            help="Print the schema of resolved scenes, the JSON files that programs read: "
            "all keys are present, and all expressions are evaluated.",
        ),
    ] = False,
) -> None:
    """Print the JSON schema of the scene format (for editors) or of resolved scenes (for programs)."""
    from stiction.scenes.resolved import resolved_schema
    from stiction.scenes.schema import scene_schema_text

    text = scene_schema_text()
    if resolved:
        text = json.dumps(resolved_schema(), indent=1) + "\n"
    print_or_write(text, out)


def write_pictures(
    trajectory: Trajectory,
    plot: Path | None,
    animation: Path | None,
    columns: Sequence[str] = (),
    width_mm: float = 174.0,
) -> None:
    """Write the plot and the film of a run, and print the names of the files.

    The plot shows the `columns`, or the usual ones if there are none.

    A run with a single sample has neither.
    """
    from stiction.scenes.atomic_files import whole_file

    if len(trajectory.t) < 2:
        return
    if plot is not None:
        with errors_of_option("--plot"), whole_file(plot) as partial:
            trajectory.plot(*columns, width_mm=width_mm).write(partial)
        print(plot)
    if animation is not None:
        with errors_of_option("--animate"), whole_file(animation) as partial:
            trajectory.animate(partial)
        print(animation)
