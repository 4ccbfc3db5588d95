"""Compiled kernels, cached on disk between runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from typing import Any

from numba import njit, types
from numba.extending import models, register_model

from stiction.reference_impl.compiled.kernel_cache import KernelCache
from stiction.reference_impl.compiled.linked_workspace import Linked, is_annotated


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
    changed callee. The stamp by which `kernel_cache` tells what is fresh covers this whole package and the function's
    own file. Division by zero gives inf or nan, as in C, without a branch: the integrators check that states are
    finite.
    """
    if function is None:
        return partial(kernel, allocates=allocates, inline=inline)
    compiled = partial(njit, error_model="numpy", _nrt=allocates, forceinline=inline, no_cfunc_wrapper=True)
    return Linked(_kept(compiled)(function)) if is_annotated(function) else Inlined(function, compiled)


class Inlined:
    """A kernel that is compiled into its callers, and for Python apart from them.

    Parameters
    ----------
    function
    compiled
        Makes a numba dispatcher of it.
    """

    def __init__(self, function: Callable, compiled: Callable):
        update_wrapper(self, function)
        self._compiled = compiled

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self._for_python(*arguments, **named)

    @cached_property
    def _for_python(self) -> Any:
        return _kept(self._compiled)(self.__wrapped__)

    @cached_property
    def _for_kernels(self) -> Any:
        """Not kept on disk, and without a way from Python to it: its callers have its machine code in theirs."""
        return self._compiled(no_cpython_wrapper=True)(self.__wrapped__)

    @property
    def _numba_type_(self) -> types.Type:
        """By which numba knows what a call of it means."""
        return _Callee(self._for_kernels)


class _Callee(types.Dispatcher):
    """Type of an `Inlined` kernel. numba would compile it for each constant that it is called with: it is compiled for their type."""

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        return super().get_call_type(context, tuple(map(types.unliteral, args)), {name: types.unliteral(arg) for name, arg in kws.items()})


@register_model(_Callee)
class _Nothing(models.OpaqueModel):
    """What machine code has of it."""


def _kept(compiled: Callable) -> Callable:
    """As `compiled`, with the machine code kept on disk."""
    def keep(function: Callable) -> Any:
        dispatcher, own = compiled(function), Path(function.__code__.co_filename)
        dispatcher._cache = KernelCache(own, function.__qualname__, hashlib.sha256(_package_stamp() + own.read_bytes()).hexdigest())
        return dispatcher

    return keep


@cache
def _package_stamp() -> bytes:
    sources = sorted(Path(__file__).parents[1].rglob("*.py"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).digest()
