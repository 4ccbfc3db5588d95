"""Kernels that others call where their machine code is.

numba compiles into a kernel all that it calls, and what that calls, and optimizes it there once more: compiling takes as
long as there are paths from kernel to kernel. A linked kernel is compiled once. Each has a word of memory, its slot, for the address
of its machine code, and the slot has a name that LLVM knows in this process. The machine code of a caller, which is kept on disk, has the name, reads
the address from the slot, and calls it. While the slot is empty it has the kernel compiled first, or loaded from disk: what
a scene does not call for is never compiled.
"""

from __future__ import annotations

import ctypes
import gc
import inspect
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from typing import Any, get_type_hints

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from stiction.reference_impl.compiled.bundle import numba_type

_log = logging.getLogger("stiction")
RESOLVE = "stiction.resolve"
"""Name by which machine code calls for the kernel of an empty slot."""


class Linked:
    """A kernel that other kernels call by its address; from Python it is called as any other.

    Parameters
    ----------
    compiled : numba dispatcher
        Of a function whose annotations say what it takes and returns: so its callers can be compiled before it, or without it.
    """

    def __init__(self, compiled: Any):
        update_wrapper(self, compiled.py_func)
        self._kernel = compiled
        self._slot = np.zeros(1, dtype=np.int64)
        self.name = f"{self.__module__}.{self.__qualname__}"
        _linked[self._slot.ctypes.data] = self
        llvmlite.binding.add_symbol(self.name, self._slot.ctypes.data)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.link()
        if named or len(arguments) < len(self._types[0]):
            bound = inspect.signature(self.__wrapped__).bind(*arguments, **named)
            bound.apply_defaults()
            arguments = bound.args
        return self._kernel(*arguments)

    @property
    def entry(self) -> Callable:
        """What calls it from Python as fast as numba can, without names and defaults, its types not looked at; it is linked by this."""
        self.link()
        return self._kernel.overloads[self._types[0]].entry_point

    @property
    def is_linked(self) -> bool:
        return self._slot[0] != 0

    @property
    def is_kept(self) -> bool:
        """Whether its machine code is on disk."""
        return self._kernel._cache.has(self._types[0], self._kernel.targetctx)

    def link(self, place: str = "") -> None:
        """Compile it, or load it from the cache on disk, and fill its slot; once. If it is compiled the log says so, with its place in a list."""
        if self.is_linked:
            return
        if not self.is_kept:
            _log.info(f"compiling a kernel, once for an installation: {place}{self.name}")
        started = time.process_time()
        arguments, returned = self._types
        with _collecting_nothing():
            self._kernel.compile(arguments)
        compiled = self._kernel.overloads[arguments]
        if compiled.signature.return_type != returned:
            raise TypeError(f"{self.name}: found {compiled.signature.return_type} returned; expected {returned}, as annotated")
        self._kernel.disable_compile()
        self._slot[0] = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        _spent[0] += time.process_time() - started

    @cached_property
    def _types(self) -> tuple[tuple[types.Type, ...], types.Type]:
        """Of its arguments, and of what it returns."""
        *arguments, returned = (numba_type(hint) for hint in get_type_hints(self.__wrapped__, include_extras=True).values())
        return tuple(arguments), returned

    @cached_property
    def _numba_type_(self) -> types.Type:
        """By which numba knows what a call of it means."""

        @intrinsic
        def call(typing_context, *given):
            arguments, returned = self._types
            if not len(arguments) - len(self.__wrapped__.__defaults__ or ()) <= len(given) <= len(arguments):
                raise TypingError(f"{self.name}: found {len(given)} arguments; expected {', '.join(self.__wrapped__.__annotations__)}")
            return returned(types.StarArgTuple(arguments[:len(given)])), self._call

        cpu_target.typing_context.refresh()
        return cpu_target.typing_context.resolve_value_type(call)

    def _call(self, context, builder, signature, values):
        arguments, returned = self._types
        word = ir.IntType(64)
        slot = builder.module.globals.get(self.name) or ir.GlobalVariable(builder.module, word, self.name)
        with cgutils.if_unlikely(builder, builder.icmp_unsigned("==", builder.load(slot), word(0))):
            resolve = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.IntType(32), [word.as_pointer()]), RESOLVE)
            failed = builder.icmp_unsigned("!=", builder.call(resolve, [slot]), ir.IntType(32)(0))
            with cgutils.if_unlikely(builder, failed):
                context.call_conv.return_user_exc(builder, RuntimeError, (f"{self.name}: it could not be compiled",))
        code = builder.inttoptr(builder.load(slot), context.call_conv.get_function_type(returned, arguments).as_pointer())
        given, defaults = cgutils.unpack_tuple(builder, values[0]), self.__wrapped__.__defaults__
        given += [context.get_constant(arguments[i], defaults[i - len(arguments)]) for i in range(len(given), len(arguments))]
        status, result = context.call_conv.call_function(builder, code, returned, arguments, given)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return result


@contextmanager
def _collecting_nothing() -> Iterator[None]:
    """numba makes millions of objects that stay: the garbage collector, which looks at them again and again, takes a fifth of its time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def compiling_seconds() -> float:
    """CPU seconds that this process has taken to compile kernels or load them."""
    return float(_spent[0])


def clock() -> float:
    """CPU seconds of this process, but for those in which kernels were compiled or loaded."""
    return time.process_time() - compiling_seconds()


def is_annotated(function: Callable) -> bool:
    return "return" in function.__annotations__


def linked_kernels() -> tuple[Linked, ...]:
    """Of the modules of the reference implementation that have been imported."""
    home = "".join(__name__.partition("reference_impl")[:2])
    return tuple(kernel for kernel in _linked.values() if kernel.__module__.startswith(home))


_linked: dict[int, Linked] = {}
"""Linked kernels by the address of their slot: LLVM's names are the process's too."""
_spent = np.zeros(1)


@ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_size_t)
def _resolve(slot: int) -> int:
    """Called by machine code, to which no exception can pass: it is printed, and the caller raises its own."""
    try:
        _linked[slot].link()
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


llvmlite.binding.add_symbol(RESOLVE, ctypes.cast(_resolve, ctypes.c_void_p).value)
