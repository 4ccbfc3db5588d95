"""Machine code of kernels on disk.

A file has the code of one kernel for one set of argument types. Its name says what it was made from and for: the kernel, a stamp of the sources, and one of
Python, numba, processor and types. So nothing has to be looked up, no index can be wrong, and processes that write at once write
the same. Its first bytes are the digest of the rest: what is cut off or damaged is not read, and compiled anew.
"""

from __future__ import annotations

import glob
import hashlib
import logging
import os
import pickle
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import llvmlite
import numba
from numba.core import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

_log = logging.getLogger("stiction")
_DIGEST = hashlib.sha256().digest_size


class KernelCache(NullCache):
    """Of one kernel, in the place of numba's own.

    Parameters
    ----------
    source : Path
        File of the kernel.
    name : str
        Of the kernel, unique in that file.
    stamp : str
        Of all sources that its machine code depends on.
    """

    def __init__(self, source: Path, name: str, stamp: str):
        self._source, self._name, self._stamp = source, f"{source.stem}.{name}".replace("<", "").replace(">", ""), stamp[:16]

    def load_overload(self, types: Any, context: Any) -> CompileResult | None:
        """The compiled kernel for these argument types; None if it is not there, or its file is damaged."""
        rtsys.initialize(context)  # all of numba's declarations, which take longer to import than the kernels to load, are for compiling
        name = self._file_name(types, context.codegen())
        for folder in self._where():
            if (data := _read(folder / name)) is not None:
                return CompileResult._rebuild(context, *pickle.loads(data))
        return None

    def has(self, types: Any, context: Any) -> bool:
        """Whether there is a file for these argument types."""
        name = self._file_name(types, context.codegen())
        return any((folder / name).is_file() for folder in self._where())

    def save_overload(self, types: Any, compiled: CompileResult) -> None:
        """Write it where it can be written: beside the source, in the user's cache, or in a temporary folder."""
        name, data = self._file_name(types, compiled.codegen), dumps(compiled._reduce())
        for folder in _folders(self._source.parent):
            if self._write(folder, name, data):
                return
        for folder in _temporary_folder():
            if self._write(folder, name, data):
                _note(f"compiled kernels are kept in {folder}, until that is cleared: neither {self._source.parent} nor a cache of the user can "
                      "be written; set NUMBA_CACHE_DIR to a folder that can")
                return
        _note("compiled kernels are not kept: no folder can be written; set NUMBA_CACHE_DIR to one that can")

    def _where(self) -> Iterator[Path]:
        yield from _folders(self._source.parent)
        yield from _temporary_folder()

    def _file_name(self, types: Any, codegen: Any) -> str:
        made_for = (sys.implementation.cache_tag, sys.abiflags, numba.__version__, llvmlite.__version__, codegen.magic_tuple(), str(types))
        return f"{self._name}.{self._stamp}.{hashlib.sha256(repr(made_for).encode()).hexdigest()[:16]}.nbc"

    def _write(self, folder: Path, name: str, data: bytes) -> bool:
        """Whether it could be written. What was made from other sources is removed."""
        part = folder / f"{name}.{uuid4().hex}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            try:
                part.write_bytes(hashlib.sha256(data).digest() + data)
                part.replace(folder / name)
            finally:
                part.unlink(missing_ok=True)
            for stale in folder.glob(f"{glob.escape(self._name)}.*"):
                if not stale.name.startswith(f"{self._name}.{self._stamp}."):
                    stale.unlink(missing_ok=True)
        except OSError:
            return False
        return True


def _read(file: Path) -> bytes | None:
    try:
        content = file.read_bytes()
    except OSError:
        return None
    data = content[_DIGEST:]
    return data if hashlib.sha256(data).digest() == content[:_DIGEST] else None


@cache
def _folders(sources: Path) -> tuple[Path, ...]:
    """Where machine code of a folder of sources is kept, the first choice first."""
    own = f"{sources.name}-{hashlib.sha256(str(sources).encode()).hexdigest()[:16]}"
    if config.CACHE_DIR:
        return (Path(config.CACHE_DIR) / own,)
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return (sources / "__pycache__", *((user / "stiction" / own,) if user.is_absolute() else ()))


def _temporary_folder() -> Iterator[Path]:
    """A folder that nobody else can write, since what it holds is executed; none where there is no such."""
    try:
        folder = Path(tempfile.gettempdir()) / f"stiction-{os.getuid() if hasattr(os, 'getuid') else 'kernels'}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return
    if not hasattr(os, "getuid") or found.st_uid == os.getuid() and not found.st_mode & 0o022 and folder.is_dir() and not folder.is_symlink():
        yield folder


@cache
def _note(text: str) -> None:
    """Once."""
    _log.warning(text)
