"""Compiled kernels, cached on disk between runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from numba import njit


def kernel(function: Callable | None = None, *, allocates: bool = False,
           inline: bool = False) -> Callable:
    """Compile a function with numba and keep the machine code on disk until any kernel's source changes.

    A kernel borrows its arrays. Only one that declares that it allocates counts references: an atomic operation at every
    mention of an array, which cost more than the mechanics. `inline` puts it into its callers, which saves passing some 200 numbers that
describe the arrays of a mechanism and its workspace.

    numba's own cache looks at the file of the function alone: a caller would go on with the machine code of a
    changed callee. Here the stamp by which a cached entry is accepted covers this whole package and the function's own file. Division by zero
    gives inf or nan, as in C, without a branch: the integrators check that states are finite.
    """
    if function is None:
        return partial(kernel, allocates=allocates, inline=inline)
    dispatcher = njit(cache=True, error_model="numpy", _nrt=allocates, forceinline=inline)(function)
    own = Path(function.__code__.co_filename)
    dispatcher._cache._cache_file._source_stamp = _package_stamp() + hashlib.sha256(own.read_bytes()).hexdigest()
    return dispatcher


@cache
def _package_stamp() -> str:
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
