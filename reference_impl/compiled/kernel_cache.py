"""Folders in which numba's cache stores the machine code of kernels.

numba compares only the source file of the function itself, and would use old machine code of a caller after a change of
its callee. Therefore each version of the sources, and each type of processor, has its own folder, whose name contains
their digests. Folders of earlier versions are removed.
"""

from __future__ import annotations

import glob
import hashlib
import logging
import os
import pickle
import shutil
import stat
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
settings: Any = (
    numba.config
)  # numba defines its attributes at run time, so that mypy does not know them
DIGEST_DIGITS = 16
"""Hexadecimal digits of the digests in the names of folders."""
DAMAGED = pickle.UnpicklingError, AttributeError, EOFError, ImportError, IndexError, ValueError
"""Errors that the documentation of pickle lists for truncated or overwritten files; numba passes them on."""


def kept(function: Callable, **options: Any) -> Any:
    """Return numba's dispatcher of a function, with a cache on disk if any folder can be written.

    Parameters
    ----------
    function
        The function to compile.
    **options
        Options of ``numba.njit``.
    """
    folder = _folder_of(Path(function.__code__.co_filename))
    if folder is None:
        return njit(**options)(function)
    # numba reads this setting when it makes a dispatcher, and only then.
    users_folder = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder)
    try:
        return njit(cache=True, **options)(function)
    finally:
        settings.CACHE_DIR = users_folder


def files_of(dispatcher: Any) -> list[Path]:
    """Return the files that numba's cache contains for a dispatcher."""
    if not dispatcher.stats.cache_path:
        return []
    function = dispatcher.py_func
    name = glob.escape(f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}")
    return list(Path(dispatcher.stats.cache_path).glob(f"{name}-*"))


def repeat_if_damaged(dispatcher: Any, action: Callable[[], Any]) -> Any:
    """Return the result of an action that loads the machine code of a dispatcher.

    If its files are damaged, they are removed, and the action is repeated, which compiles the function again.
    """
    try:
        return action()
    except DAMAGED:
        for file in files_of(dispatcher):
            file.unlink(missing_ok=True)
        return action()


def _folder_of(source: Path) -> Path | None:
    """Return the folder for the kernels of a source file; None if no folder can be written."""
    version = _digest(_digest_of_package() + source.read_bytes())
    target = _digest(repr(_target()).encode())
    name = f"kernels-{source.stem}-{version}-{target}"
    preferred = _preferred_folders(source.parent)
    for root in chain(preferred, _temporary_folder()):
        is_new = not (root / name).is_dir()
        if _prepare_folder(root, source.stem, name):
            if is_new and root not in preferred:
                _warn_once(
                    f"compiled kernels are kept in {root}, until that is cleared: neither "
                    f"{source.parent} nor a cache of the user can be written; "
                    "set NUMBA_CACHE_DIR to a folder that can"
                )
            return root / name
    _warn_once(
        "compiled kernels are not kept: no folder can be written; set NUMBA_CACHE_DIR to one that can"
    )
    return None


def _digest(data: bytes) -> str:
    """Return the beginning of the SHA-256 digest, for names of folders."""
    return hashlib.sha256(data).hexdigest()[:DIGEST_DIGITS]


def _prepare_folder(root: Path, stem: str, name: str) -> bool:
    """Create the folder ``root / name`` if it does not exist, and remove those of earlier versions of the sources.

    Returns False if the folder cannot be written. Folders for other processors remain, since computers may share them.
    """
    folder = root / name
    prefix_of_version = name[:-DIGEST_DIGITS]
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            for other in root.glob(f"kernels-{glob.escape(stem)}-*-*"):
                if not other.name.startswith(prefix_of_version):
                    shutil.rmtree(other, ignore_errors=True)
        # Whether it can be written is known only after trying, for example on a read-only disk.
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


@cache
def _digest_of_package() -> bytes:
    """Return the digest of all sources of the reference implementation, and of the tables that kernels contain."""
    package = Path(__file__).parents[1]
    sources = [*sorted(package.rglob("*.py")), *sorted(package.rglob("*.toml"))]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()


def _target() -> tuple[str, ...]:
    """Return what machine code depends on besides the sources: versions of the compiler, and the processor."""
    features = settings.CPU_FEATURES
    if features is None:
        features = llvmlite.binding.get_host_cpu_features().flatten()
    return (
        sys.implementation.cache_tag,
        sys.abiflags,
        numba.__version__,
        llvmlite.__version__,
        settings.CPU_NAME or llvmlite.binding.get_host_cpu_name(),
        features,
    )


@cache
def _preferred_folders(sources: Path) -> tuple[Path, ...]:
    """Return the folders in which the kernels of a folder of sources may be stored, in order of preference."""
    subfolder = f"{sources.name}-{_digest(str(sources).encode())}"
    if settings.CACHE_DIR:
        return (Path(settings.CACHE_DIR) / subfolder,)
    folders = [sources / "__pycache__"]
    users_cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    # Without a home directory the path remains relative.
    if users_cache.is_absolute():
        folders.append(users_cache / "stiction" / subfolder)
    return tuple(folders)


def _temporary_folder() -> Iterator[Path]:
    """Yield a temporary folder that only this user can write, if there is one, since its contents are executed."""
    user = str(os.getuid()) if hasattr(os, "getuid") else "kernels"
    try:
        folder = Path(tempfile.gettempdir()) / f"stiction-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return
    if hasattr(os, "getuid"):
        is_writable_by_others = bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
        if status.st_uid != os.getuid() or is_writable_by_others:
            return
    if folder.is_dir() and not folder.is_symlink():
        yield folder


@cache
def _warn_once(text: str) -> None:
    """Log a warning; repeated calls with the same text do nothing."""
    _log.warning(text)
