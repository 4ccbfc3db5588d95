"""Options and arguments that several commands have. Each is checked and converted before the command is called.

What is wrong with an option is a `typer.BadParameter`, which names it; a scene or an engine has its own errors.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from stiction.scenes import Scene

PICTURES = (".svg", ".pdf", ".png")


def positive(text: float | str) -> float:
    """A number > 0, or arithmetic with that value."""
    try:
        value = float(
            text
        )  # as nearly all are: the import of the scenes takes longer than all of the command line
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
    """A whole number >= 1, or arithmetic with that value."""
    value = positive(text)
    if value != int(value):
        raise typer.BadParameter(f"found {text!r}; expected a whole number >= 1")
    return int(value)


def listed(given: Sequence[str]) -> list[str]:
    """The names in ``a,b`` lists, each once."""
    return list(dict.fromkeys(name.strip() for part in given for name in part.split(",")))


def _engines(given: list[str]) -> list[str]:
    """Each is an engine, installed or not; rows of those that are not will say so."""
    from stiction.engines import EngineMissing, load_engine
    from stiction.engines.registry import absolute_name, label_of

    names = list(map(absolute_name, listed(given)))
    labels: dict[str, str] = {}
    for name in names:
        try:
            load_engine(name)
        except EngineMissing:
            pass
        if (other := labels.setdefault(label_of(name), name)) != name:
            raise typer.BadParameter(
                f"found {other!r} and {name!r}, both named {label_of(name)}; expected programs "
                "and FMUs with different names"
            )
    return names


def _engine(name: str | None) -> str | None:
    """The name of an engine as child processes know it."""
    if name is None or "." not in name:
        return name  # without the import
    from stiction.engines.registry import absolute_name

    return absolute_name(name)


def settings_of(given: Sequence[str]) -> dict[str, Any]:
    """Settings of an engine from ``KEY=VALUE``: values as TOML has them, anything else a word."""
    settings: dict[str, Any] = {}
    for text in given:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key.replace("-", "_").isidentifier() and equals and value):
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
    """Refuse a file that cannot be written, or has none of these endings (if any), before it is computed."""
    wrong = ""
    try:
        places = [place for place in (path, path.parent) if place.exists()]
        if endings and path.suffix.lower() not in endings:
            wrong = f"expected a name that ends in {' or '.join(endings)}"
        elif (
            path.is_dir()
            or not path.parent.is_dir()
            or not all(os.access(place, os.W_OK) for place in places)
        ):
            wrong = "expected a file in a folder that exists and can be written"
    except OSError as error:  # a name too long
        wrong = str(error.strerror)
    if wrong:
        raise typer.BadParameter(f"found {str(path)!r}; {wrong}", param_hint=option)


def written(*endings: str) -> Callable[[Path | None], Path | None]:
    """Return the callback of an option: `check_written` of a file that is given."""

    def checked(path: Path | None) -> Path | None:
        if path is not None:
            check_written(path, endings)
        return path

    return checked


@contextmanager
def about(option: str) -> Iterator[None]:
    """Report what the suite or the system has against a file or folder as something wrong with this option."""
    from stiction.scenes import StictionError

    try:
        yield
    except (OSError, StictionError) as error:
        raise typer.BadParameter(str(error), param_hint=option) from error


def distinct(option: str, path: Path | None, other: Path | None) -> None:
    """Refuse an output that the command reads, or writes as something else."""
    if path is not None and other is not None and path.resolve() == other.resolve():
        raise typer.BadParameter(
            f"found {str(path)!r}, which the command also reads or writes; expected another file",
            param_hint=option,
        )


def scene_of(name: str, overrides: Sequence[str]) -> Scene:
    """Load a scene with overrides of the command line."""
    from stiction.scenes import load_scene, parse_override

    return load_scene(name, dict(parse_override(text) for text in overrides))


def _scene_names(begun: str) -> list[str]:
    """Names that a shell completes; where none fits, it goes on with files."""
    from stiction.scenes import catalogue

    return [name for name in (*catalogue(), *catalogue("hard")) if name.startswith(begun)]


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
OtherScenes = Annotated[
    list[str],
    typer.Option(
        "--scenes",
        metavar="A,B,..",
        help="Scenes of the catalogue, or TOML files, to run instead of the scenes in the campaign.",
    ),
]
