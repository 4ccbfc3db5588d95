"""Compiled kernels, cached on disk between runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from numba import njit

from reference_impl.linking import Linked, is_annotated


def kernel(function: Callable | None = None, *, allocates: bool = False, inline: bool = False) -> Callable:
    """Compile a function with numba and keep the machine code on disk until any kernel's source changes.

    A kernel whose arguments and result are annotated is compiled for these types alone, once, and called where it is (`linking`). One
    without annotations is compiled for the types it is called with, and LLVM may put it into its callers: this is for small ones.

    Parameters
    ----------
    allocates : bool
        A kernel borrows its arrays. Only one that makes arrays counts references: an atomic operation at every mention of an array,
        which cost more than the mechanics.
    inline : bool
        Have LLVM put it into its callers: for the parts of the right-hand side, which takes a tenth longer without.

    numba's own cache looks at the file of the function alone: a caller would go on with the machine code of a
    changed callee. Here the stamp by which a cached entry is accepted covers this whole package and the function's
    own file. Division by zero gives inf or nan, as in C, without a branch: the integrators check that states are
    finite.
    """
    if function is None:
        return partial(kernel, allocates=allocates, inline=inline)
    dispatcher = njit(cache=True, error_model="numpy", _nrt=allocates, forceinline=inline, no_cfunc_wrapper=True)(function)
    own = Path(function.__code__.co_filename)
    dispatcher._cache._cache_file._source_stamp = _package_stamp() + hashlib.sha256(own.read_bytes()).hexdigest()
    return Linked(dispatcher) if is_annotated(function) else dispatcher


@cache
def _package_stamp() -> str:
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
