"""Folders for the machine code of kernels, which numba's own cache keeps on disk.

numba compares the source file of the function alone: a caller would go on with the machine code of a changed callee. So
each set of sources, and each processor, has a folder of its own, named by their digests. Folders of earlier sources are
removed.
"""

from __future__ import annotations

import glob
import hashlib
import logging
import os
import pickle
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from numba import njit

_log = logging.getLogger("stiction")
settings: Any = numba.config  # whose names numba makes when it is loaded
DAMAGED = pickle.UnpicklingError, AttributeError, EOFError, ImportError, IndexError, ValueError
"""Errors that Python's pickle lists for files that are cut off or overwritten; numba passes them on."""


def kept(function: Callable, **options: Any) -> Any:
    """Return numba's dispatcher of a function, whose machine code stays on disk where a folder can be written."""
    folder = _folder_of(Path(function.__code__.co_filename))
    if folder is None:
        return njit(**options)(function)
    chosen, settings.CACHE_DIR = (
        settings.CACHE_DIR,
        str(folder),
    )  # numba reads it here, once for each dispatcher
    try:
        return njit(cache=True, **options)(function)
    finally:
        settings.CACHE_DIR = chosen


def files_of(dispatcher: Any) -> list[Path]:
    """Return the files that numba's cache has of a dispatcher."""
    if not dispatcher.stats.cache_path:
        return []
    function = dispatcher.py_func
    name = glob.escape(f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}")
    return list(Path(dispatcher.stats.cache_path).glob(f"{name}-*"))


def repeat_if_damaged(dispatcher: Any, action: Callable[[], Any]) -> Any:
    """Return the result of an action that loads a dispatcher's machine code.

    Files that cannot be read are removed and made anew.
    """
    try:
        return action()
    except DAMAGED:
        for file in files_of(dispatcher):
            file.unlink(missing_ok=True)
        return action()


def _folder_of(source: Path) -> Path | None:
    """Return the folder for the kernels of a source file; None where none can be written."""
    stamp = _digest(_package_stamp() + source.read_bytes())
    name, own = (
        f"kernels-{source.stem}-{stamp}-{_digest(repr(_target()).encode())}",
        _user_folders(source.parent),
    )
    for root in chain(own, _temporary_folder()):
        is_new = not (root / name).is_dir()
        if _prepare(root, source.stem, name):
            if is_new and root not in own:
                _note(
                    f"compiled kernels are kept in {root}, until that is cleared: neither {source.parent} nor a "
                    "cache of the user can be written; set NUMBA_CACHE_DIR to a folder that can"
                )
            return root / name
    _note(
        "compiled kernels are not kept: no folder can be written; set NUMBA_CACHE_DIR to one that can"
    )
    return None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _prepare(root: Path, stem: str, name: str) -> bool:
    """Make a folder, and remove those of earlier sources; False if it cannot be written."""
    folder = root / name
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            for stale in root.glob(f"kernels-{glob.escape(stem)}-*-*"):
                if not stale.name.startswith(name[:-16]):
                    shutil.rmtree(stale, ignore_errors=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


@cache
def _package_stamp() -> bytes:
    package = Path(__file__).parents[1]
    sources = [
        *sorted(package.rglob("*.py")),
        *sorted(package.rglob("*.toml")),
    ]  # kernels hold the tables of methods
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()


def _target() -> tuple[str, ...]:
    """Return all that machine code depends on besides the sources."""
    features, host = settings.CPU_FEATURES, llvmlite.binding
    return (
        sys.implementation.cache_tag,
        sys.abiflags,
        numba.__version__,
        llvmlite.__version__,
        settings.CPU_NAME or host.get_host_cpu_name(),
        host.get_host_cpu_features().flatten() if features is None else features,
    )


@cache
def _user_folders(sources: Path) -> tuple[Path, ...]:
    """Return where the kernels of a folder of sources are kept, the first choice first."""
    own = f"{sources.name}-{_digest(str(sources).encode())}"
    if settings.CACHE_DIR:
        return (Path(settings.CACHE_DIR) / own,)
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return (sources / "__pycache__", *((user / "stiction" / own,) if user.is_absolute() else ()))


def _temporary_folder() -> Iterator[Path]:
    """Yield a folder that no other user can write, since what it holds is executed; none where there is no such."""
    try:
        folder = (
            Path(tempfile.gettempdir())
            / f"stiction-{os.getuid() if hasattr(os, 'getuid') else 'kernels'}"
        )
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return
    own = not hasattr(os, "getuid") or found.st_uid == os.getuid() and not found.st_mode & 0o022
    if own and folder.is_dir() and not folder.is_symlink():
        yield folder


@cache
def _note(text: str) -> None:
    """Once."""
    _log.warning(text)
