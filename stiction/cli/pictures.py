"""A scene begun and seen: ``new``, ``draw``, ``schema``; and the pictures of a run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.options import Overrides, SceneName, check_written, distinct, scene_of

if TYPE_CHECKING:
    from stiction.scenes import Trajectory

commands = typer.Typer()

Plot = Annotated[Path | None, typer.Option(
    "--plot", metavar="FILE", help="Plot displacement, slip velocity, corner forces, friction and motor effort: .svg, "
    ".pdf or .png.")]
Animation = Annotated[Path | None, typer.Option(
    "--animate", metavar="FILE", help="Make a film of the mechanism and the forces on its sliders: .gif, .html, or "
    ".mp4 where ffmpeg is installed.")]


@commands.command()
def new(file: Annotated[Path, typer.Argument(metavar="FILE", help="The scene to write: .toml, not there yet.")],
        like: Annotated[str | None, typer.Option(
            metavar="SCENE", help="A copy of this scene of the catalogue; a small one with friction that explains "
            "itself if not given.")] = None) -> None:
    """Begin a scene of your own: a scene file, and the schema by which an editor completes and checks it."""
    from stiction.comparisons.atomic_files import write_text
    from stiction.scenes import new_scene_text, scene_text
    from stiction.scenes.schema import SCHEMA_FILE, scene_schema_text

    text = new_scene_text() if like is None else scene_text(like)
    check_written(file, (".toml",), "FILE")
    if file.exists():
        raise typer.BadParameter(f"found {str(file)!r}, which is there already; expected a new name", param_hint="FILE")
    write_text(file, f"#:schema {SCHEMA_FILE}\n{text}")
    print(file)
    schema = file.with_name(SCHEMA_FILE)
    if not schema.exists():
        write_text(schema, scene_schema_text())
        print(schema)


@commands.command()
def draw(scene: SceneName,
         out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The picture: .svg, .pdf or .png.")],
         overrides: Overrides = []) -> None:
    """Draw a scene at t = 0: bodies, pins, guides with numbered corners of their sliders, drives, springs, loads."""
    from stiction.comparisons.atomic_files import whole_file
    from stiction.scenes.pictures.picture import ENDINGS

    loaded = scene_of(scene, overrides)
    check_written(out, ENDINGS, "--out")
    with whole_file(out) as partial:
        loaded.draw().write(partial, out.suffix.lower().removeprefix("."))
    print(out)


@commands.command()
def schema(out: Annotated[Path | None, typer.Option(
        "--out", metavar="FILE", help="Write it to a file: .json.")] = None,
           resolved: Annotated[bool, typer.Option(
        "--resolved", help="That of the JSON which programs read: numbers evaluated, every key there.")] = False
           ) -> None:
    """Print the JSON schema of the scene format, for editors, or of resolved scenes, for programs."""
    from stiction.comparisons.atomic_files import write_text
    from stiction.scenes.resolved import resolved_schema
    from stiction.scenes.schema import scene_schema_text

    text = json.dumps(resolved_schema(), indent=1) + "\n" if resolved else scene_schema_text()
    if out is None:
        print(text, end="")
    else:
        check_written(out, (".json",), "--out")
        write_text(out, text)
        print(out)


def check_pictures(plot: Path | None, animation: Path | None, out: Path | None) -> None:
    """Refuse, before the run, pictures that cannot be written."""
    if plot is not None:
        from stiction.scenes.pictures.picture import ENDINGS as pictures

        check_written(plot, pictures, "--plot")
        distinct("--plot", plot, out)
    if animation is not None:
        from stiction.scenes import InputError
        from stiction.scenes.pictures.animation import ENDINGS as films
        from stiction.scenes.pictures.animation import check_animation

        check_written(animation, films, "--animate")
        distinct("--animate", animation, plot)
        try:
            check_animation(animation)
        except InputError as error:
            raise typer.BadParameter(str(error), param_hint="--animate") from None


def write_pictures(trajectory: Trajectory, plot: Path | None, animation: Path | None) -> None:
    """Write the pictures of a run that moved, and print the names of the files."""
    if len(trajectory.t) < 2 or plot is None and animation is None:
        return
    from stiction.comparisons.atomic_files import whole_file

    if plot is not None:
        with whole_file(plot) as partial:
            trajectory.plot().write(partial, plot.suffix.lower().removeprefix("."))
        print(plot)
    if animation is not None:
        from stiction.scenes import InputError
        from stiction.scenes.pictures.animation import animate

        if trajectory.mechanism is None:
            raise InputError(f"--animate: found a trajectory of {trajectory.scene} without its mechanism; expected one "
                             "that knows it")
        with whole_file(animation) as partial:
            animate(trajectory.mechanism, trajectory, partial, animation.suffix.lower())
        print(animation)
