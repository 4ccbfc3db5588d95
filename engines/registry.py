"""Engines by name: those of the suite, those that other packages announce, any class by its address, and files.

A program is named by the path of its declaration, which ends in ``.toml``, an FMU by its own, which ends in ``.fmu``.
Nothing but such a name runs a program or what an FMU contains. An engine that comes with the suite has a row in
`BUILT_IN` and in `_PACKAGES`.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from stiction.engines.protocol import OBLIGATORY, Capabilities, Engine, required
from stiction.scenes import InputError, StictionError
from stiction.scenes.wording import did_you_mean, names

ENTRY_POINT_GROUP = "stiction.engines"
OWN_METHODS = ("reference", "moreau")
"""Engines of which the suite is the author: what they refuse, the method refuses, and no adapter."""
BUILT_IN = {
    "reference": "stiction.engines.reference.engine:ReferenceEngine",
    "moreau": "stiction.engines.reference.moreau:MoreauEngine",
    "exudyn": "stiction.engines.exudyn.engine:ExudynEngine",
    "pymunk": "stiction.engines.pymunk.engine:PymunkEngine",
    "pybullet": "stiction.engines.pybullet.engine:PybulletEngine",
    "mujoco": "stiction.engines.mujoco.engine:MujocoEngine",
    "drake": "stiction.engines.drake.engine:DrakeEngine",
    "dart": "stiction.engines.dart.engine:DartEngine",
}
PROGRAMS = {"siconos": "stiction.engines.siconos.engine:SiconosEngine"}
"""Engines whose declarations the suite ships and the system runs. Comparisons have them where they are named."""
EXTRAS = ("pybullet", "mujoco", "drake", "dart")
"""Engines that an installation may lack; extras of the same names bring them."""
_PACKAGES = {
    "exudyn": "exudyn",
    "pymunk": "pymunk",
    "pybullet": "pybullet",
    "mujoco": "mujoco-core",
    "drake": "drake",
    "dart": "dartpy",
    ".fmu": "fmpy",
}
"""Packages, as pip knows them, of the engines that the suite has adapters for, and of files."""
_OWN, _OWN_PACKAGE = {**BUILT_IN, **PROGRAMS}, "stiction"
FILES = {
    ".toml": "stiction.engines.program.engine:ProgramEngine",
    ".fmu": "stiction.engines.fmu.engine:FmuEngine",
}
"""Addresses of the engines that are files by the ending of their names; the classes take the absolute path."""


class UnknownEngine(InputError):
    """Nothing has this name, or what has it is not an engine."""


class EngineMissing(StictionError):
    """The engine's package cannot be imported on this machine; the message says why.

    Attributes
    ----------
    state : str
        In the words of a table.
    """

    state = "not installed"


class EngineBroken(EngineMissing):
    """The engine's package, or an adapter that another package announces, is there and fails before any run.

    The message says how.
    """

    state = "broken"


def engine_names() -> list[str]:
    """Names that `load_engine` knows: the suite's engines, then those of entry points."""
    return [*_OWN, *sorted(_announced(tuple(sys.path)).keys() - _OWN.keys())]


def is_file(name: str) -> bool:
    """Return True for the name of an engine that is a file: a program or an FMU."""
    return name.endswith(tuple(FILES))


def absolute_name(name: str) -> str:
    """Return the name of an engine as processes in other folders know it: of a file the absolute path."""
    return str(Path(name).resolve()) if is_file(name) else name


def label_of(name: str) -> str:
    """Return the name of an engine for tables and legends: of a file the one that it declares, if it is there."""
    if not is_file(name):
        return name
    try:
        return load_engine(name).name
    except (EngineMissing, UnknownEngine):
        return Path(name).stem


@lru_cache(maxsize=1)
def _announced(path: tuple[str, ...]) -> Mapping[str, str]:
    """Addresses by name of the engines that packages on `path` announce; reading them takes 7 ms."""
    return {entry.name: entry.value for entry in entry_points(group=ENTRY_POINT_GROUP)}


def load_engine(name: str) -> Engine:
    """An engine by name.

    Parameters
    ----------
    name
        One of `engine_names()`, or ``"module:Class"``; the class derives from `Engine` and takes no arguments. Other
        packages announce theirs in the entry point group ``stiction.engines``; the suite's own names come first. Or the
        path of the declaration of a program, ``"mysolver.toml"``, or of an FMU, ``"model.fmu"``.

    Raises
    ------
    UnknownEngine
        If nothing has this name, or what has it is not an `Engine`, or lacks something that is `OBLIGATORY`.
    InputError
        If the declaration of a program or an FMU cannot be used; it lists all problems.
    EngineMissing
        If the engine's package is not installed, too old, broken or cannot be imported; the message says what to
        install. Of an engine that another package announces whatever its adapter raises is one.
    """
    if is_file(name):
        if not Path(name).is_file():
            raise UnknownEngine(
                f"engine: found no file {name!r}; expected the declaration of a program, or an FMU"
            )
        return _of_file(Path(name).resolve())
    if name not in _OWN and name not in _announced(tuple(sys.path)):
        _announced.cache_clear()  # its package may have been installed since
    others = _announced(tuple(sys.path))
    addresses = {**others, **_OWN}
    address = addresses.get(name, name)
    module, _, attribute = address.partition(":")
    if not module or not attribute:
        close = difflib.get_close_matches(name, addresses, n=1)
        raise UnknownEngine(
            f"engine: found {name!r}; expected {', '.join(engine_names())}, 'module:Class', a "
            "program's FILE.toml or a FILE.fmu"
            + (f" (did you mean {close[0]!r}?)" if close else "")
        )
    try:
        with _packaged(name, name):
            return _made(name, module, attribute)
    except Exception as error:
        if name in BUILT_IN or name not in others:
            raise  # what was asked for by its address is being written: its author wants the traceback
        raise EngineBroken(
            f"{name}: its adapter {address}, which another package announces, is broken: "
            f"{type(error).__name__}: {error}"
        ) from error


def _of_file(path: Path) -> Engine:
    module, _, attribute = FILES[path.suffix].partition(":")
    with _packaged(path.name, path.suffix):
        engine = getattr(import_module(module), attribute)(path)
    if engine.name in BUILT_IN:
        raise InputError(
            f"{path}: found the name {engine.name!r}; expected another name: an engine of the suite has "
            "it"
        )
    return engine


@contextmanager
def _packaged(shown: str, name: str) -> Iterator[None]:
    """Say of an engine's package that cannot be imported what brings it."""
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] == _OWN_PACKAGE:
            raise
        raise EngineMissing(f"{shown}: {error}{_remedy(name)}") from error


def _made(name: str, module: str, attribute: str) -> Engine:
    """The engine, which has said what its version and its capabilities are."""
    engine = _class(name, import_module(module), attribute)()
    try:
        str(engine.version)  # asks the engine's own package, which adapters import late
    except Exception as error:
        # whatever a broken package raises, or another one of its name: the other engines go on
        if isinstance(error, ImportError) or name not in _PACKAGES:
            raise  # not installed, or a mistake in an adapter of others
        raise EngineBroken(
            f"{name}: its package is broken: {type(error).__name__}: "
            f"{error}{_remedy(name, ' --force-reinstall --no-deps')}"
        ) from error
    if not isinstance(engine.capabilities, Capabilities):
        raise TypeError(
            f"engine {name!r}: capabilities is {engine.capabilities!r}; expected "
            "stiction.engines.Capabilities"
        )
    return engine


def _class(name: str, module: ModuleType, attribute: str) -> type[Engine]:
    """The class of this name in a module, complete."""
    if not hasattr(module, attribute):
        close = did_you_mean(
            attribute,
            [
                key
                for key, value in vars(module).items()
                if isinstance(value, type) and issubclass(value, Engine)
            ],
        )
        raise UnknownEngine(
            f"engine {name!r}: module {module.__name__} has no class {attribute}{close}; expected a "
            "class derived from stiction.engines.Engine"
        )
    found = getattr(module, attribute)
    if not (isinstance(found, type) and issubclass(found, Engine)):
        raise UnknownEngine(
            f"engine {name!r}: {attribute!r} of {module.__name__!r} is {found!r}; expected a class "
            "derived from stiction.engines.Engine"
        )
    if missing := [
        part for part in OBLIGATORY if part in found.__abstractmethods__ or not hasattr(found, part)
    ]:
        raise UnknownEngine(
            f"engine {name!r}: class {attribute} has no {names(missing)}; expected a class that "
            f"defines {names(OBLIGATORY)}"
        )
    return found


def _remedy(name: str, option: str = "") -> str:
    """Say what to install, after the reason; nothing for engines of others."""
    return (
        f"; pip install{option} '{package}{required(package)}' brings it"
        if (package := _PACKAGES.get(name))
        else ""
    )
