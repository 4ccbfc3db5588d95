"""Options and arguments that several commands share. They are checked and converted before the command runs.

An invalid value raises `typer.BadParameter`, which names the option. Scenes and engines raise errors of their
own.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from stiction.scenes import Scene

PICTURES = (".svg", ".pdf", ".png")
"""Endings of picture files."""


def positive(text: float | str) -> float:
    """Convert an option to a number > 0; the text may be arithmetic, such as ``1/30``."""
    try:
        # Nearly all values are plain numbers. Evaluating arithmetic needs an import that takes longer
        # than the rest of the command line.
        value = float(text)
    except ValueError:
        from stiction.scenes import InputError
        from stiction.scenes.expressions import evaluate

        try:
            value = evaluate(str(text), {})
        except InputError as error:
            raise typer.BadParameter(f"found {text!r}; {error}") from None
    if not 0.0 < value < math.inf:
        raise typer.BadParameter(f"found {text!r}; expected a number > 0")
    return value


def count(text: float | str) -> int:
    """Convert an option to a whole number >= 1; the text may be arithmetic."""
    value = positive(text)
    if value != int(value):
        raise typer.BadParameter(f"found {text!r}; expected a whole number >= 1")
    return int(value)


def split_names(lists: Sequence[str]) -> list[str]:
    """Return the names in texts such as ``a,b``, each once."""
    names = [name.strip() for text in lists for name in text.split(",")]
    return list(dict.fromkeys(names))


def _engines(lists: list[str]) -> list[str]:
    """Convert the option ``--engines``, and check that all names are known and distinct.

    Engines that are not installed are allowed; the rows of their runs state this.
    """
    from stiction.engines import EngineMissing, load_engine
    from stiction.engines.registry import absolute_name, label_of

    names = [absolute_name(name) for name in split_names(lists)]
    names_by_label: dict[str, str] = {}
    for name in names:
        with suppress(EngineMissing):
            load_engine(name)
        label = label_of(name)
        other = names_by_label.setdefault(label, name)
        if other != name:
            raise typer.BadParameter(
                f"found {other!r} and {name!r}, both named {label}; expected programs "
                "and FMUs with different names"
            )
    return names


def _engine(name: str | None) -> str | None:
    """Convert the option ``--engine``: paths become absolute, as child processes need them."""
    # A name without a dot is no path, and needs no import.
    if name is None or "." not in name:
        return name
    from stiction.engines.registry import absolute_name

    return absolute_name(name)


def settings_of(texts: Sequence[str]) -> dict[str, Any]:
    """Return the settings of an engine in texts ``KEY=VALUE``; a value that is not TOML is a string."""
    settings: dict[str, Any] = {}
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        is_name = key.replace("-", "_").isidentifier()
        if not (is_name and equals and value):
            raise typer.BadParameter(
                f"found {text!r}; expected KEY=VALUE such as stabilization=projection",
                param_hint="--setting",
            )
        try:
            settings[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            settings[key] = value
    return settings


def check_written(path: Path, endings: Sequence[str] = (), option: str | None = None) -> None:
    """Check that a file can be written, before its content is computed.

    Parameters
    ----------
    path : Path
        The file.
    endings : sequence of str
        Endings that its name may have; any if empty.
    option : str, optional
        Option that the message names.

    Raises
    ------
    typer.BadParameter
        If the name has another ending, or the file or its folder cannot be written.
    """
    problem = ""
    try:
        if endings and path.suffix.lower() not in endings:
            problem = f"expected a name that ends in {' or '.join(endings)}"
        elif path.is_dir() or not path.parent.is_dir() or not _has_write_access(path):
            problem = "expected a file in a folder that exists and can be written"
    except OSError as error:
        # The name is too long, for example.
        problem = str(error.strerror)
    if problem:
        raise typer.BadParameter(f"found {str(path)!r}; {problem}", param_hint=option)


def _has_write_access(path: Path) -> bool:
    """Return whether the process may write a file, if it exists, and its folder."""
    return all(os.access(each, os.W_OK) for each in (path, path.parent) if each.exists())


def written(*endings: str) -> Callable[[Path | None], Path | None]:
    """Return a callback that checks the file of an option with `check_written`."""

    def check(path: Path | None) -> Path | None:
        if path is not None:
            check_written(path, endings)
        return path

    return check


@contextmanager
def errors_of_option(option: str) -> Iterator[None]:
    """Turn errors of the suite and of the system within the block into `typer.BadParameter` of an option."""
    from stiction.scenes import StictionError

    try:
        yield
    except (OSError, StictionError) as error:
        raise typer.BadParameter(str(error), param_hint=option) from error


def check_distinct(option: str, path: Path | None, other: Path | None) -> None:
    """Check that a file of an option is not another file that the command reads or writes."""
    if path is not None and other is not None and path.resolve() == other.resolve():
        raise typer.BadParameter(
            f"found {str(path)!r}, which the command also reads or writes; expected another file",
            param_hint=option,
        )


def scene_of(name: str, overrides: Sequence[str], assemble: bool = False) -> Scene:
    """Load a scene, and apply overrides ``KEY=VALUE`` of the command line.

    If `assemble`, a start that violates the constraints is projected onto them.
    """
    from stiction.reference_impl.scene_loading import load_scene
    from stiction.scenes import parse_override

    return load_scene(name, dict(parse_override(text) for text in overrides), assemble)


def width_in_mm(width: str) -> float:
    """Return the width of a figure in mm by its name, the value of the option ``--width``."""
    widths = {"double": 174.0, "single": 84.0}
    if width not in widths:
        raise typer.BadParameter(
            f"found {width!r}; expected one of {', '.join(widths)}", param_hint="--width"
        )
    return widths[width]


def scenes_of(
    names_or_paths: Sequence[str], overrides: Sequence[str], assemble: bool
) -> tuple[Scene, ...]:
    """Load scenes with overrides, and check that their starts are consistent and their names different.

    If `assemble`, starts that violate the constraints are projected onto them.
    """
    from stiction.reference_impl.multibody.initial_state import with_consistent_start
    from stiction.scenes.wording import names

    loaded = tuple(
        with_consistent_start(scene_of(name, overrides), assemble) for name in names_or_paths
    )
    counts = Counter(scene.name for scene in loaded)
    repeated = [name for name, number in counts.items() if number > 1]
    if repeated:
        raise typer.BadParameter(
            f"found {names(repeated)} more than once; expected scenes with different names",
            param_hint="SCENE",
        )
    return loaded


def _scene_names(prefix: str) -> list[str]:
    """Return the scenes of the catalogue that begin with a prefix, for the completion by a shell."""
    from stiction.scenes import catalogue

    return [name for name in (*catalogue(), *catalogue("hard")) if name.startswith(prefix)]


SceneName = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        autocompletion=_scene_names,
        help="Name of a scene of the catalogue (see `stiction scenes`), or path of a TOML file.",
    ),
]
SceneNames = Annotated[
    list[str],
    typer.Argument(
        metavar="SCENE",
        autocompletion=_scene_names,
        help="Name of a scene of the catalogue (see `stiction scenes`), or path of a TOML "
        "file. Some studies accept several scenes, and some have scenes of their own.",
    ),
]
Overrides = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a value of the scene, for example F0=4, motor.rate=pi/2, "
        "guide.mu=0.1, bar.position.0=1 or gravity=[0,-1.62]. KEY= without a "
        "value removes the key. Repeatable.",
    ),
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--setting",
        metavar="KEY=VALUE",
        help="Setting of the engine, for example stabilization=projection. Repeatable.",
    ),
]
EngineName = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="NAME",
        callback=_engine,
        help="An engine listed by `stiction engines`, a class as module:Class, the "
        "declaration of a program (FILE.toml) or an FMU (FILE.fmu).",
    ),
]
Fidelity = Annotated[
    str,
    typer.Option(
        "--fidelity",
        metavar="joint|contact",
        help="Model of sliders: bilateral joints, or boxes between two surfaces.",
    ),
]
Engines = Annotated[
    list[str],
    typer.Option(
        "--engines",
        metavar="A,B,..",
        callback=_engines,
        help="Engines to compare with the reference, as names, module:Class, FILE.toml "
        "or FILE.fmu. Default: all known engines.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=count,
        help="Number of parallel child processes. Default: the number of CPUs.",
    ),
]
ExecutorName = Annotated[
    str,
    typer.Option(
        "--executor",
        metavar="processes|dask[:ADDRESS]",
        help="Where runs are made: in processes of this machine, in a local Dask "
        "cluster (dask), or in the cluster of the Dask scheduler at ADDRESS. "
        "Timed runs are always made on this machine.",
    ),
]
Timeout = Annotated[
    float,
    typer.Option(metavar="S", parser=positive, help="Time limit of one run, s."),
]
Assemble = Annotated[
    bool,
    typer.Option(
        "--assemble", help="If the initial state violates the constraints, project it onto them."
    ),
]
Columns = Annotated[
    list[str],
    typer.Option(
        "--columns",
        metavar="A,B,..",
        help="Columns to plot, such as motor.effort,guide.normal_force.",
    ),
]
Width = Annotated[
    str,
    typer.Option(
        "--width",
        metavar="double|single",
        help="Width of the figure: two columns of a journal page (174 mm) or one (84 mm).",
    ),
]
EndTime = Annotated[
    float | None,
    typer.Option(
        "--t-end",
        metavar="S",
        parser=positive,
        help="Simulated time, s. Default: that of the scene.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer runs with larger steps.")]
Full = Annotated[
    bool,
    typer.Option(
        "--full",
        help="Also small steps, long runs for drift, all hard cases, parameters that "
        "the paper leaves open, and settings of the engines. Takes an hour or "
        "more.",
    ),
]
TableFile = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        callback=written(".csv", ".parquet"),
        help="Write all columns and rows to this file (.csv or .parquet).",
    ),
]
RunFolder = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder written by `stiction validate`.")
]
CampaignFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="[CAMPAIGN.toml]", help="Campaign to run. Default: stiction's own campaign."
    ),
]
BaselineFile = Annotated[
    str | None,
    typer.Option(
        "--baseline",
        metavar="REF",
        help="Baseline to compare with: a file, a commit (stiction's own baseline in that "
        "commit), or COMMIT:PATH. Default: stiction's own baseline, or none if a "
        "campaign is given.",
    ),
]
OneEngine = Annotated[
    str | None,
    typer.Option(
        "--engine",
        metavar="NAME",
        callback=_engine,
        help="Run only this engine: a name, module:Class, FILE.toml or FILE.fmu. A class "
        "derived from that of an engine in the campaign replaces this engine.",
    ),
]
ValidatedScenes = Annotated[
    list[str],
    typer.Option(
        "--scenes",
        metavar="A,B,..",
        help="Scenes of your own (TOML files), or of the catalogue, to compare on instead of the "
        "paper's three cases. Studies that do not apply to them are named with the reason.",
    ),
]
OtherScenes = Annotated[
    list[str],
    typer.Option(
        "--scenes",
        metavar="A,B,..",
        help="Scenes of the catalogue, or TOML files, to run instead of the scenes in the campaign.",
    ),
]
