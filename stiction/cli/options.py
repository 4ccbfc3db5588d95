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
                "and FMUs with names of their own"
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
            f"found {str(path)!r}, which the command needs for something else; expected another "
            "file",
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
        help="Name of the catalogue (see `stiction scenes`) or a TOML file.",
    ),
]
SceneNames = Annotated[
    list[str],
    typer.Argument(
        metavar="SCENE",
        autocompletion=_scene_names,
        help="Names of the catalogue (see `stiction scenes`) or TOML files; "
        "several where the study compares them.",
    ),
]
Overrides = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Replace a value of the scene: F0=4, motor.rate=pi/2, guide.mu=0.1, "
        "bar.position.0=1, gravity=[0,-1.62]; without a value, remove it. Repeatable.",
    ),
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--setting",
        metavar="KEY=VALUE",
        help="A setting of the engine, e.g. stabilization=projection. Repeatable.",
    ),
]
EngineName = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="NAME",
        callback=_engine,
        help="See `stiction engines`; or module:Class, or a program's FILE.toml, a FILE.fmu.",
    ),
]
Fidelity = Annotated[
    str,
    typer.Option(
        "--fidelity", metavar="joint|contact", help="Bilateral joints, or a box between surfaces."
    ),
]
Engines = Annotated[
    list[str],
    typer.Option(
        "--engines",
        metavar="A,B,..",
        callback=_engines,
        help="Engines to compare with the reference; all known ones if not given. Names, module:Class, FILE.toml or "
        "FILE.fmu.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=count,
        help="Child processes at a time; the number of CPUs if not given.",
    ),
]
ExecutorName = Annotated[
    str,
    typer.Option(
        "--executor",
        metavar="processes|dask[:ADDRESS]",
        help="Processes of this machine, or a Dask cluster: one on this "
        "machine, or that of the scheduler at ADDRESS. What is timed stays here.",
    ),
]
Timeout = Annotated[
    float,
    typer.Option(
        metavar="S", parser=positive, help="Seconds that one run may take before it is given up."
    ),
]
Assemble = Annotated[
    bool, typer.Option("--assemble", help="Move a start that violates the constraints onto them.")
]
EndTime = Annotated[
    float | None,
    typer.Option(
        "--t-end",
        metavar="S",
        parser=positive,
        help="Seconds to simulate; the scene's own if not given.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer and coarser steps.")]
Full = Annotated[
    bool,
    typer.Option(
        "--full",
        help="Fine steps, long drift, every hard case, what the paper leaves open, settings of the engines: "
        "an hour or more.",
    ),
]
TableFile = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        callback=written(".csv", ".parquet"),
        help="Write all columns and rows: .csv or .parquet.",
    ),
]
RunFolder = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder that `stiction validate` has written.")
]
CampaignFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="[CAMPAIGN.toml]", help="What is run; the suite's own campaign if not given."
    ),
]
BaselineFile = Annotated[
    str | None,
    typer.Option(
        "--baseline",
        metavar="REF",
        help="A file, a commit (its version of the suite's own baseline), or COMMIT:PATH; "
        "the suite's own if neither this nor a campaign is given.",
    ),
]
OneEngine = Annotated[
    str | None,
    typer.Option(
        "--engine",
        metavar="NAME",
        callback=_engine,
        help="This engine alone: a name, module:Class or a program's "
        "FILE.toml, a FILE.fmu. A class derived from an engine of the campaign takes its place.",
    ),
]
OtherScenes = Annotated[
    list[str],
    typer.Option(
        "--scenes",
        metavar="A,B,..",
        help="Scenes of the catalogue or TOML files in place of the campaign's.",
    ),
]
