"""Compiled functions (kernels), and calls from one to another.

numba compiles all callees of a function into the function, and optimizes them there again. The time of compilation
would grow with the number of paths in the call graph, to four minutes of CPU time. A linked kernel is compiled only
once. It has a word of memory, its slot, which contains the address of its machine code. LLVM knows the slot by the name
of the kernel. The machine code of a caller, which is stored on disk, refers to this name, reads the address from the
slot and calls it. If the slot is still empty, the callee is first compiled or loaded from disk; kernels that a scene
does not need are therefore never compiled.
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
"""Name of the function that machine code calls to fill an empty slot."""


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
    """Compile a function with numba, and keep the machine code on disk until the source of any kernel changes.

    A function with annotations is compiled for these types only, as a `Linked` kernel. A function without annotations,
    which should be small, is compiled into its callers for the types of their arguments, as an `Inlined` kernel.
    Division by zero gives inf or nan, as in C, without a branch; the integrators check that states are finite.

    Parameters
    ----------
    function : callable
        The function. The decorator can also be called with the options below alone.
    allocates : bool
        Whether the function creates arrays. Only then references to arrays are counted: this is an atomic operation at
        each use of an array, and would take longer than the computation of most kernels.
    inline : bool
        Whether LLVM is forced to inline the function. Without this, the right-hand side takes a tenth longer.
    """
    if function is None:
        return partial(kernel, allocates=allocates, inline=inline)
    options = {
        "error_model": "numpy",
        "_nrt": allocates,
        "forceinline": inline,
        "no_cfunc_wrapper": True,
    }
    if "return" in function.__annotations__:
        return Linked(function, options)
    return Inlined(function, options)


class Inlined:
    """A kernel that is compiled into its callers. It is compiled separately for calls from Python."""

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
        """Dispatcher for calls from kernels, without a cache, since the callers contain the machine code."""
        return njit(**self._options | {"no_cpython_wrapper": True})(self.__wrapped__)

    @property
    def _numba_type_(self) -> types.Type:
        """Numba's type of the kernel, by which it compiles calls."""
        return _InlinedType(self._for_kernels)


class _InlinedType(types.Dispatcher):
    """Numba's type of an `Inlined` kernel.

    By default, numba compiles a function for each constant that it is called with. This type replaces constants by
    their types.
    """

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call, as numba's base class requires."""
        named = {name: types.unliteral(arg) for name, arg in kws.items()}
        return super().get_call_type(context, tuple(map(types.unliteral, args)), named)


register_model(_InlinedType)(models.OpaqueModel)


class Linked:
    """A kernel that other kernels call by its address, and Python like any function.

    The types of its arguments and of its result are known from its annotations, so that its callers can be compiled
    before it.

    Attributes
    ----------
    name : str
        Module and name of the function, by which machine code refers to the slot.
    is_linked : bool
        True if the slot contains the address of the machine code.
    """

    __wrapped__: Callable
    __qualname__: str

    def __init__(self, function: Callable, options: dict[str, Any]):
        update_wrapper(self, function)
        self._options = options
        self._slot = np.zeros(1, dtype=np.int64)
        self.is_linked = False
        self.name = f"{self.__module__}.{self.__qualname__}"
        slot_address = self._slot.ctypes.data
        _linked[slot_address] = self
        # Make the slot known to LLVM by name, and calls of the kernel known to numba.
        llvmlite.binding.add_symbol(self.name, slot_address)
        type_callable(self)(self._make_typer)
        lower_builtin(self, types.VarArg(types.Any))(self._lower_call)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.link()
        # The compiled function takes all arguments by position.
        if named or len(arguments) < len(self._types[0]):
            bound = self._signature.bind(*arguments, **named)
            bound.apply_defaults()
            arguments = bound.args
        return self._kernel(*arguments)

    @property
    def is_kept(self) -> bool:
        """True if the machine code is on disk."""
        return bool(files_of(self._kernel))

    def link(self, progress: str = "") -> None:
        """Compile the kernel, or load it from disk, and fill its slot; does nothing if this has been done.

        Parameters
        ----------
        progress
            A text that precedes the name of the kernel in the log.

        Raises
        ------
        TypeError
            If the kernel returns another type than its annotation says.
        """
        if self.is_linked:
            return
        if not self.is_kept:
            _log.info(f"compiling a kernel, once for an installation: {progress}{self.name}")
        begin = time.process_time()
        arguments, result = self._types
        # numba creates millions of objects that it keeps. Checking them for garbage would take a
        # fifth of the time.
        gc_was_enabled = gc.isenabled()
        gc.disable()
        try:
            repeat_if_damaged(self._kernel, lambda: self._kernel.compile(arguments))
        finally:
            if gc_was_enabled:
                gc.enable()
        compiled = self._kernel.overloads[arguments]
        compiled_result = compiled.signature.return_type
        if compiled_result != result:
            raise TypeError(
                f"{self.name}: found {compiled_result} returned; expected {result}, as annotated"
            )
        self._kernel.disable_compile()
        self._slot[0] = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        self.is_linked = True
        _compile_seconds[0] += time.process_time() - begin

    @cached_property
    def _kernel(self) -> Any:
        return kept(self.__wrapped__, **self._options)

    @cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self.__wrapped__)

    @cached_property
    def _types(self) -> tuple[tuple[types.Type, ...], types.Type]:
        """Types of the arguments, and type of the result."""
        hints = get_type_hints(self.__wrapped__, include_extras=True)
        *arguments, result = map(numba_type, hints.values())
        return tuple(arguments), result

    @property
    def _defaults(self) -> tuple[Any, ...]:
        """Default values of the last arguments."""
        return self.__wrapped__.__defaults__ or ()

    def _make_typer(self, _: Any) -> Callable:
        """Return the function by which numba determines the signature of a call."""

        def type_of_call(*call_arguments: types.Type) -> Any:
            arguments, result = self._types
            count = len(call_arguments)
            if not len(arguments) - len(self._defaults) <= count <= len(arguments):
                raise TypingError(
                    f"{self.name}: found {count} arguments; expected {self._signature}"
                )
            return result(*arguments[:count])

        # numba matches arguments by name with this signature.
        vars(type_of_call)["pysig"] = self._signature
        return type_of_call

    def _lower_call(self, context: Any, builder: Any, signature: Any, values: Any) -> Any:
        """Generate the code of a call: fill the slot if it is empty, and call the address in it.

        The arguments are those that numba passes for a lowering function; `values` are the arguments of the call.
        """
        arguments, result_type = self._types
        values = list(values)
        for i in range(len(values), len(arguments)):
            default = self._defaults[i - len(arguments)]
            values.append(context.get_constant(arguments[i], default))

        word = ir.IntType(64)
        module_globals = builder.module.globals
        slot = module_globals.get(self.name)
        if slot is None:
            slot = ir.GlobalVariable(builder.module, word, self.name)
        is_empty = builder.icmp_unsigned("==", builder.load(slot), word(0))
        with builder.if_then(is_empty, likely=False):
            self._lower_resolve(context, builder, slot)

        convention = context.call_conv
        pointer_type = convention.get_function_type(result_type, arguments).as_pointer()
        code = builder.inttoptr(builder.load(slot), pointer_type)
        status, result = convention.call_function(builder, code, result_type, arguments, values)
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return result

    def _lower_resolve(self, context: Any, builder: Any, slot: Any) -> None:
        """Generate the code that has an empty slot filled by `_resolve`, and raises RuntimeError if that fails."""
        error_code = ir.IntType(32)
        resolve = builder.module.globals.get(RESOLVE)
        if resolve is None:
            function_type = ir.FunctionType(error_code, [ir.IntType(64).as_pointer()])
            resolve = ir.Function(builder.module, function_type, RESOLVE)
        failed = builder.icmp_unsigned("!=", builder.call(resolve, [slot]), error_code(0))
        with builder.if_then(failed, likely=False):
            context.call_conv.return_user_exc(
                builder, RuntimeError, (f"{self.name}: it could not be compiled",)
            )


def compiling_seconds() -> float:
    """Return the CPU time, s, that this process has taken to compile kernels or load them from disk."""
    return float(_compile_seconds[0])


def clock() -> float:
    """Return the CPU time of this process, s, without that of `compiling_seconds`."""
    return time.process_time() - compiling_seconds()


def bound(kernel: Callable, bundle: Bundle) -> Callable[..., Any]:
    """Return a function that calls a linked kernel with a bundle as its first argument.

    It is for steps of a few microseconds: numba takes one to determine the types of the arguments of each call. Here
    the type of the bundle is checked only once, and all other arguments must be numbers.

    Raises
    ------
    TypeError
        If the first argument of the kernel is another bundle.
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
    """Compile linked kernels, or load them from disk, before a run whose time is measured.

    Functions that are not linked kernels are ignored.
    """
    for function in kernels:
        if isinstance(function, Linked):
            function.link()


def linked_kernels() -> tuple[Linked, ...]:
    """Return the linked kernels of those modules of the reference implementation that have been imported."""
    before, package, _ = __name__.partition("reference_impl")
    return tuple(
        kernel for kernel in _linked.values() if kernel.__module__.startswith(before + package)
    )


_linked: dict[int, Linked] = {}
"""All linked kernels by the address of their slot. It is global, as the names of symbols in LLVM are."""
_compile_seconds = np.zeros(1)
"""CPU time of compilation and loading so far, s."""


@ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_size_t)
def _resolve(slot: int) -> int:
    """Fill the slot at an address; called by machine code. Returns 0, or 1 if the kernel could not be linked.

    An exception cannot pass through machine code. It is printed here, and the machine code raises a RuntimeError.
    """
    try:
        _linked[slot].link()
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


llvmlite.binding.add_symbol(RESOLVE, ctypes.cast(_resolve, ctypes.c_void_p).value)
