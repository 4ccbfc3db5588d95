"""Compiled functions, and how they call each other.

numba compiles into a function all that it calls, and what that calls, and optimizes it there once more: compiling would
take as long as there are paths from kernel to kernel, four minutes of CPU. A linked kernel is compiled once. It has a
word of memory, its slot, for the address of its machine code; LLVM knows the slot by the kernel's name. The machine
code of a caller, which is kept on disk, has the name, reads the address from the slot, and calls it. While the slot is
empty it has the kernel compiled first, or loaded from disk: what a scene does not call for is never compiled.
"""

from __future__ import annotations

import ctypes
import gc
import inspect
import logging
import sys
import time
from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from typing import Any, TypeVar, cast, get_type_hints, overload

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import TypingError, njit, types
from numba.extending import lower_builtin, models, register_model, type_callable

from stiction.reference_impl.compiled.bundle import Bundle, numba_type
from stiction.reference_impl.compiled.kernel_cache import files_of, kept, repeat_if_damaged

_log = logging.getLogger("stiction")
RESOLVE = "stiction.resolve"
"""Name by which machine code calls for the kernel of an empty slot."""


AnyFunction = TypeVar("AnyFunction", bound=Callable)


@overload
def kernel(function: AnyFunction) -> AnyFunction: ...


@overload
def kernel(
    *, allocates: bool = False, inline: bool = False
) -> Callable[[AnyFunction], AnyFunction]: ...


def kernel(
    function: Callable | None = None, *, allocates: bool = False, inline: bool = False
) -> Callable:
    """Compile a function with numba and keep the machine code on disk until any kernel's source changes.

    A kernel whose arguments and result are annotated is compiled for these types alone, and linked. One without
    annotations is compiled for the types it is called with, into its callers: this is for small ones. Division by zero
    gives inf or nan, as in C, without a branch: the integrators check that states are finite.

    Parameters
    ----------
    allocates : bool
        A kernel borrows its arrays. Only one that makes arrays counts references: an atomic operation at every mention
        of an array, which cost more than the mechanics.
    inline : bool
        Have LLVM put it into its callers: for the parts of the right-hand side, which takes a tenth longer without.
    """
    if function is None:
        return partial(kernel, allocates=allocates, inline=inline)
    options = {
        "error_model": "numpy",
        "_nrt": allocates,
        "forceinline": inline,
        "no_cfunc_wrapper": True,
    }
    return (Linked if "return" in function.__annotations__ else Inlined)(function, options)


class Inlined:
    """A kernel that is compiled into its callers, and for Python separately."""

    __wrapped__: Callable

    def __init__(self, function: Callable, options: dict[str, Any]):
        update_wrapper(self, function)
        self._options = options

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return repeat_if_damaged(self._for_python, lambda: self._for_python(*arguments, **named))

    @cached_property
    def _for_python(self) -> Any:
        return kept(self.__wrapped__, **self._options)

    @cached_property
    def _for_kernels(self) -> Any:
        """Not kept on disk, and without a way from Python to it: its callers have its machine code in theirs."""
        return njit(**self._options | {"no_cpython_wrapper": True})(self.__wrapped__)

    @property
    def _numba_type_(self) -> types.Type:
        """Type of the kernel for numba, by which a call of it is compiled."""
        return _Callee(self._for_kernels)


class _Callee(types.Dispatcher):
    """Type of an `Inlined` kernel, compiled for types: numba would compile it for each constant it is called with."""

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        named = {name: types.unliteral(arg) for name, arg in kws.items()}
        return super().get_call_type(context, tuple(map(types.unliteral, args)), named)


register_model(_Callee)(models.OpaqueModel)


class Linked:
    """A kernel that other kernels call by its address; from Python it is called as any other.

    Its annotations say what it takes and returns: so its callers can be compiled before it, or without it.
    """

    __wrapped__: Callable
    __qualname__: str

    def __init__(self, function: Callable, options: dict[str, Any]):
        update_wrapper(self, function)
        self._options = options
        self._slot, self.is_linked = np.zeros(1, dtype=np.int64), False
        self.name = f"{self.__module__}.{self.__qualname__}"
        _linked[self._slot.ctypes.data] = self
        llvmlite.binding.add_symbol(self.name, self._slot.ctypes.data)
        type_callable(self)(self._typer)
        lower_builtin(self, types.VarArg(types.Any))(self._lower_call)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.link()
        if named or len(arguments) < len(self._types[0]):
            bound = self._signature.bind(*arguments, **named)
            bound.apply_defaults()
            arguments = bound.args
        return self._kernel(*arguments)

    @property
    def is_kept(self) -> bool:
        """True if its machine code is on disk."""
        return bool(files_of(self._kernel))

    def link(self, place: str = "") -> None:
        """Compile it, with a word in the log, or load it from the cache on disk, and fill its slot; once."""
        if self.is_linked:
            return
        if not self.is_kept:
            _log.info(f"compiling a kernel, once for an installation: {place}{self.name}")
        started = time.process_time()
        arguments, returned = self._types
        collects = gc.isenabled()
        gc.disable()  # numba makes millions of objects that stay: to look at them takes a fifth of its time
        try:
            repeat_if_damaged(self._kernel, lambda: self._kernel.compile(arguments))
        finally:
            if collects:
                gc.enable()
        compiled = self._kernel.overloads[arguments]
        found = compiled.signature.return_type
        if found != returned:
            raise TypeError(
                f"{self.name}: found {found} returned; expected {returned}, as annotated"
            )
        self._kernel.disable_compile()
        self._slot[0] = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        self.is_linked = True
        _spent[0] += time.process_time() - started

    @cached_property
    def _kernel(self) -> Any:
        return kept(self.__wrapped__, **self._options)

    @cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self.__wrapped__)

    @cached_property
    def _types(self) -> tuple[tuple[types.Type, ...], types.Type]:
        """Types of its arguments, and of what it returns."""
        hints = get_type_hints(self.__wrapped__, include_extras=True)
        *arguments, returned = map(numba_type, hints.values())
        return tuple(arguments), returned

    def _typer(self, _: Any) -> Callable:
        """Return what gives numba the signature of a call; arguments with defaults may be missing."""

        def type_of_call(*given: types.Type) -> Any:
            arguments, returned = self._types
            if (
                not len(arguments) - len(self.__wrapped__.__defaults__ or ())
                <= len(given)
                <= len(arguments)
            ):
                raise TypingError(
                    f"{self.name}: found {len(given)} arguments; expected {self._signature}"
                )
            return returned(*arguments[: len(given)])

        vars(type_of_call)["pysig"] = self._signature
        return type_of_call

    def _lower_call(self, context: Any, builder: Any, signature: Any, given: Any) -> Any:
        """Call the machine code that the slot has the address of."""
        arguments, returned = self._types
        missing, defaults = range(len(given), len(arguments)), self.__wrapped__.__defaults__ or ()
        given = [
            *given,
            *(context.get_constant(arguments[i], defaults[i - len(arguments)]) for i in missing),
        ]
        word, outcome, known, convention = (
            ir.IntType(64),
            ir.IntType(32),
            builder.module.globals,
            context.call_conv,
        )
        slot = known.get(self.name) or ir.GlobalVariable(builder.module, word, self.name)
        with builder.if_then(
            builder.icmp_unsigned("==", builder.load(slot), word(0)), likely=False
        ):
            type_of_resolve = ir.FunctionType(outcome, [word.as_pointer()])
            resolve = known.get(RESOLVE) or ir.Function(builder.module, type_of_resolve, RESOLVE)
            failed = builder.icmp_unsigned("!=", builder.call(resolve, [slot]), outcome(0))
            with builder.if_then(failed, likely=False):
                convention.return_user_exc(
                    builder, RuntimeError, (f"{self.name}: it could not be compiled",)
                )
        code = builder.inttoptr(
            builder.load(slot), convention.get_function_type(returned, arguments).as_pointer()
        )
        status, result = convention.call_function(builder, code, returned, arguments, given)
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return result


def compiling_seconds() -> float:
    """CPU seconds that this process has taken to compile kernels or load them."""
    return float(_spent[0])


def clock() -> float:
    """CPU seconds of this process, but for those in which kernels were compiled or loaded."""
    return time.process_time() - compiling_seconds()


def bound(kernel: Callable, bundle: Bundle) -> Callable[..., Any]:
    """Return a linked kernel with its bundle given, whose other arguments are numbers.

    For steps of a few microseconds: numba takes one to look at the types of the arguments of a call. Here the bundle's
    is looked at once, and the numbers are converted.

    Raises
    ------
    TypeError
        If the kernel takes another bundle.
    """
    linked = cast(Linked, kernel)
    linked.link()
    arguments, _ = linked._types
    if bundle._numba_type_ != arguments[0]:
        raise TypeError(
            f"{linked.name}: found {type(bundle).__name__}; expected a bundle {arguments[0]}"
        )
    return partial(linked._kernel.overloads[arguments].entry_point, bundle)


def link_kernels(*kernels: Callable) -> None:
    """Compile linked kernels, or load them, so that no run is timed that does."""
    for each in kernels:
        if isinstance(each, Linked):
            each.link()


def linked_kernels() -> tuple[Linked, ...]:
    """Linked kernels of the modules of the reference implementation that have been imported."""
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
