"""Registry of engines: those of the suite, those announced by other packages, classes by their address, and files.

A program is selected by the path of its declaration, which ends in ``.toml``, and an FMU by its own path, which ends in
``.fmu``; programs and the code of FMUs are never run by other names. All other code refers to the engines of the suite
only by their entries in `ENGINES`.
"""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from stiction.engines.protocol import OBLIGATORY, Capabilities, Engine, required
from stiction.scenes import InputError, StictionError
from stiction.scenes.wording import did_you_mean, names

ENTRY_POINT_GROUP = "stiction.engines"
"""Group of entry points by which other packages announce engines."""


@dataclass(frozen=True)
class EngineEntry:
    """An engine of the suite.

    Attributes
    ----------
    name : str
        Its name in commands and tables, and the name of the extra of an optional engine.
    address : str
        ``"module:Class"`` of its adapter, a class that takes no arguments.
    package : str
        The package that it needs, by its name in pip; empty for none.
    optional : bool
        Whether an installation may lack the package, which the extra of the engine's name installs.
    own_method : bool
        Whether the suite is its author, so that a refusal is that of the method and not of an adapter.
    run_by_system : bool
        Whether the suite contains its declaration, and the system its program. Comparisons include it if it is named.
    experiments : mapping of str to str
        Published experiments with this engine, outside of any scene: ``"module:function"`` by the experiment's name.
    """

    name: str
    address: str
    package: str = ""
    optional: bool = False
    own_method: bool = False
    run_by_system: bool = False
    experiments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FileEntry:
    """A kind of engine that is a file, named by its path.

    Attributes
    ----------
    ending : str
        End of the file's name, with the dot.
    address : str
        ``"module:Class"`` of its adapter, a class that takes the absolute path.
    package : str
        The package that it needs, by its name in pip; empty for none.
    """

    ending: str
    address: str
    package: str = ""


_HERE = "stiction.engines"
ENGINES: tuple[EngineEntry, ...] = (
    EngineEntry("reference", f"{_HERE}.reference.engine:ReferenceEngine", own_method=True),
    EngineEntry("moreau", f"{_HERE}.reference.moreau:MoreauEngine", own_method=True),
    EngineEntry("exudyn", f"{_HERE}.exudyn.engine:ExudynEngine", "exudyn"),
    EngineEntry("pymunk", f"{_HERE}.pymunk.engine:PymunkEngine", "pymunk"),
    EngineEntry("pybullet", f"{_HERE}.pybullet.engine:PybulletEngine", "pybullet", optional=True),
    EngineEntry(
        "mujoco",
        f"{_HERE}.mujoco.engine:MujocoEngine",
        "mujoco-core",
        optional=True,
        experiments={
            "grasp": f"{_HERE}.mujoco.grasp:creep_and_load",
            "hinge": f"{_HERE}.mujoco.hinge:hinge_creep",
        },
    ),
    EngineEntry("drake", f"{_HERE}.drake.engine:DrakeEngine", "drake", optional=True),
    EngineEntry("dart", f"{_HERE}.dart.engine:DartEngine", "dartpy", optional=True),
    EngineEntry("newton", f"{_HERE}.newton.engine:NewtonEngine", "newton", optional=True),
    EngineEntry("siconos", f"{_HERE}.siconos.engine:SiconosEngine", run_by_system=True),
)
"""The engines that come with the suite, in the order of tables. A new engine is registered by an entry here."""
FILES: tuple[FileEntry, ...] = (
    FileEntry(".toml", f"{_HERE}.program.engine:ProgramEngine"),
    FileEntry(".fmu", f"{_HERE}.fmu.engine:FmuEngine", "fmpy"),
)
"""Engines that are files, by the endings of their names."""
_OWN_PACKAGE = "stiction"


class UnknownEngine(InputError):
    """There is no engine of this name, or the object of this name is not an engine."""


class EngineMissing(StictionError):
    """The engine's package cannot be imported on this machine; the message contains the reason.

    Attributes
    ----------
    state : str
        The status that tables show: ``"not installed"`` or ``"broken"``.
    """

    state = "not installed"


class EngineBroken(EngineMissing):
    """The engine's package, or an adapter that another package announces, is installed and fails before any run.

    The message is the error.
    """

    state = "broken"


def entry_of(name: str) -> EngineEntry | None:
    """Return the entry of an engine that comes with the suite; None for any other."""
    for entry in ENGINES:
        if entry.name == name:
            return entry
    return None


def experiment(engine: str, name: str) -> Callable[..., Any]:
    """Return the function that makes an experiment of an engine of the suite; see `EngineEntry.experiments`.

    Raises
    ------
    UnknownEngine
        If the engine has no such experiment.
    """
    entry = entry_of(engine)
    if entry is None or name not in entry.experiments:
        available = entry.experiments if entry else {}
        raise UnknownEngine(
            f"experiment of {engine!r}: found {name!r}; expected {', '.join(available) or 'none'}"
        )
    module, _, function = entry.experiments[name].partition(":")
    function_of_experiment: Callable[..., Any] = getattr(import_module(module), function)
    return function_of_experiment


def own_methods() -> list[str]:
    """Return the names of the engines of which the suite is the author."""
    return [entry.name for entry in ENGINES if entry.own_method]


def engine_names() -> list[str]:
    """Return the names of all known engines: those of the suite, then those announced by other packages."""
    own = [entry.name for entry in ENGINES]
    return [*own, *sorted(_announced(tuple(sys.path)).keys() - set(own))]


def is_file(name: str) -> bool:
    """Return True for the name of an engine that is a file: a program or an FMU."""
    return name.endswith(tuple(entry.ending for entry in FILES))


def absolute_name(name: str) -> str:
    """Return the name of an engine for processes in other folders: the absolute path if it is a file."""
    if not is_file(name):
        return name
    resolved = str(Path(name).resolve())
    # A symbolic link may lead to a file with another extension.
    return resolved if is_file(resolved) else os.path.abspath(name)


def label_of(name: str) -> str:
    """Return the name of an engine for tables and legends; for a file, the name that it declares, if it exists."""
    if not is_file(name):
        return name
    try:
        return load_engine(name).name
    except (EngineMissing, UnknownEngine):
        return Path(name).stem


@lru_cache(maxsize=1)
def _announced(path: tuple[str, ...]) -> Mapping[str, str]:
    """Return addresses by name of the engines that packages on `path` announce; reading them takes 7 ms."""
    return {entry.name: entry.value for entry in entry_points(group=ENTRY_POINT_GROUP)}


def load_engine(name: str) -> Engine:
    """Return an engine by name.

    Parameters
    ----------
    name
        One of:

        - a name of `engine_names`. Other packages announce engines in the entry point group ``stiction.engines``; if
          they use a name of the suite, the suite's engine is returned.
        - ``"module:Class"``, a subclass of `Engine` whose constructor takes no arguments.
        - the path of the declaration of a program, ``"mysolver.toml"``, or of an FMU, ``"model.fmu"``.

    Returns
    -------
    Engine
        An instance of the engine's adapter.

    Raises
    ------
    UnknownEngine
        If there is no such engine, or if the object of this name is not a complete subclass of `Engine`.
    InputError
        If the declaration of a program or an FMU cannot be used; the message lists all problems.
    EngineMissing
        If the engine's package is not installed, too old or broken; the message says what to install. Any exception
        raised by the adapter of an engine that another package announces is reported in this way as well.
    """
    if is_file(name):
        if not Path(name).is_file():
            raise UnknownEngine(
                f"engine: found no file {name!r}; expected the declaration of a program, or an FMU"
            )
        [file_entry] = [entry for entry in FILES if name.endswith(entry.ending)]
        return _of_file(Path(name).resolve(), file_entry)
    entry = entry_of(name)
    if entry is None and name not in _announced(tuple(sys.path)):
        # A package may have been installed since the names were read.
        _announced.cache_clear()
    others = _announced(tuple(sys.path))
    addresses = {**others, **{entry.name: entry.address for entry in ENGINES}}
    address = addresses.get(name, name)
    module, _, attribute = address.partition(":")
    # A relative name of a module has no meaning here.
    if not module or not attribute or module.startswith("."):
        matches = difflib.get_close_matches(name, addresses, n=1)
        hint = f" (did you mean {matches[0]!r}?)" if matches else ""
        raise UnknownEngine(
            f"engine: found {name!r}; expected {', '.join(engine_names())}, 'module:Class', a "
            f"program's FILE.toml or a FILE.fmu{hint}"
        )
    try:
        package = entry.package if entry else ""
        with _packaged(name, package):
            return _create(name, module, attribute, package)
    except Exception as error:
        # The author of an engine that is selected by its address needs the traceback.
        if entry is not None or name not in others:
            raise
        raise EngineBroken(
            f"{name}: its adapter {address}, which another package announces, is broken: "
            f"{type(error).__name__}: {error}"
        ) from error


def _of_file(path: Path, entry: FileEntry) -> Engine:
    """Return the engine of a program's declaration or an FMU; `entry` is its kind.

    Raises
    ------
    InputError
        If it has the name of an engine of the suite, with which tables would confuse it.
    """
    module, _, attribute = entry.address.partition(":")
    with _packaged(path.name, entry.package):
        engine = getattr(import_module(module), attribute)(path)
    namesake = entry_of(engine.name)
    if namesake is not None and not namesake.run_by_system:
        raise InputError(
            f"{path}: found the name {engine.name!r}; expected another name: an engine of the suite has "
            "it"
        )
    return engine


@contextmanager
def _packaged(shown: str, package: str) -> Iterator[None]:
    """Turn the ImportError of an engine's package into an `EngineMissing` that names what to install."""
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] == _OWN_PACKAGE:
            raise
        raise EngineMissing(f"{shown}: {error}{_remedy(package)}") from error


def _create(name: str, module: str, attribute: str, package: str) -> Engine:
    """Create an engine, and check that it has a version and capabilities.

    Parameters
    ----------
    name
        The name by which it was selected, for messages.
    module, attribute
        The module and the name of its class.
    package
        The package that it needs; empty for engines that do not belong to the suite.
    """
    engine = _class(name, import_module(module), attribute)()
    try:
        # Adapters import the package of their engine late; the version needs it.
        str(engine.version)
    except Exception as error:
        # A package that is not installed is handled by the caller, and a mistake in somebody else's
        # adapter is shown with its traceback. Any other exception is that of a broken package, or of
        # another package of that name, and must not end a command about all engines.
        if isinstance(error, ImportError) or not package:
            raise
        raise EngineBroken(
            f"{name}: its package is broken: {type(error).__name__}: "
            f"{error}{_remedy(package, ' --force-reinstall --no-deps')}"
        ) from error
    if not isinstance(engine.capabilities, Capabilities):
        raise TypeError(
            f"engine {name!r}: capabilities is {engine.capabilities!r}; expected "
            "stiction.engines.Capabilities"
        )
    return engine


def _class(name: str, module: ModuleType, attribute: str) -> type[Engine]:
    """Return the class of this name in a module, after checking that it is a complete engine."""
    if not hasattr(module, attribute):
        engine_classes = [
            key
            for key, value in vars(module).items()
            if isinstance(value, type) and issubclass(value, Engine)
        ]
        hint = did_you_mean(attribute, engine_classes)
        raise UnknownEngine(
            f"engine {name!r}: module {module.__name__} has no class {attribute}{hint}; expected a "
            "class derived from stiction.engines.Engine"
        )
    cls = getattr(module, attribute)
    if not (isinstance(cls, type) and issubclass(cls, Engine)):
        raise UnknownEngine(
            f"engine {name!r}: {attribute!r} of {module.__name__!r} is {cls!r}; expected a class "
            "derived from stiction.engines.Engine"
        )
    missing = [
        member
        for member in OBLIGATORY
        if member in cls.__abstractmethods__ or not hasattr(cls, member)
    ]
    if missing:
        raise UnknownEngine(
            f"engine {name!r}: class {attribute} has no {names(missing)}; expected a class that "
            f"defines {names(OBLIGATORY)}"
        )
    return cls


def _remedy(package: str, option: str = "") -> str:
    """Return the end of a message that says what to install; empty without a package."""
    if not package:
        return ""
    return f"; pip install{option} '{package}{required(package)}' brings it"
