"""Kernels that others call where their machine code is.

numba compiles into a kernel all that it calls, and what that calls, and optimizes it there once more: compiling takes as
long as there are paths from kernel to kernel. One that is called apart is compiled once. Others find its address in the
workspace (`linking`), because their own machine code is kept on disk and the address is another one in every process.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from reference_impl.kinematics import workspace
from reference_impl.mechanism import Mechanism
from scenes import scene_from_dict

SOLUTIONS, SOLVE_HLCP, SOLVE_CONTACT, HAS_SEVERAL, CHOOSE_MODE, RIGHT_HAND_SIDE, TAKE_STEP = range(7)
"""Places in `Workspace.code`."""

FLAGS, MODE, CORNERS, REALS, TABLE = types.boolean[::1], types.int64[::1], types.int64[:, ::1], types.float64[::1], types.float64[:, ::1]
INTEGER, REAL = types.int64, types.float64


def apart(callee: Any, place: int, *rest: types.Type) -> tuple[Any, Callable[[], int]]:
    """Let kernels call a kernel apart.

    Parameters
    ----------
    callee : kernel
        With arguments m, w and others of the types `rest`.
    place : int
        Of its address in `Workspace.code`.

    Returns
    -------
    call
        In a kernel, ``call(m, w, (..))`` is ``callee(m, w, ..)``.
    address
        ``address()`` is where its machine code is, compiled or loaded from the cache on disk.
    """

    def compiled() -> Any:
        signature = (*_mechanism_types(), *rest)
        callee.compile(signature)
        return callee.overloads[signature]

    @intrinsic
    def call(typing_context, m, w, others):
        if (m, w) != _mechanism_types():
            raise TypingError(f"{callee.__name__} is called apart with {m}, {w}; expected the types that every mechanism has")
        code, returned = compiled().fndesc, compiled().signature.return_type

        def generate(context, builder, signature, values):
            field = w.fields.index("code")
            addresses = context.make_array(w.types[field])(context, builder, builder.extract_value(values[1], field))
            address = builder.load(cgutils.gep(builder, addresses.data, place))
            with cgutils.if_unlikely(builder, cgutils.is_null(builder, address)):
                context.call_conv.return_user_exc(builder, RuntimeError, (f"{callee.__name__}: workspace without addresses",))
            kind = context.call_conv.get_function_type(code.restype, code.argtypes)
            status, result = context.call_conv.call_function(
                builder, builder.inttoptr(address, ir.PointerType(kind)), returned, code.argtypes,
                [*values[:2], *cgutils.unpack_tuple(builder, values[2])])
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
            return result

        return returned(m, w, types.Tuple(rest)), generate

    def address() -> int:
        return compiled().library.get_pointer_to_function(compiled().fndesc.llvm_func_name)

    return call, address


@cache
def _mechanism_types() -> tuple[types.Type, types.Type]:
    """Types of the arrays and of the workspace of every mechanism."""
    m = Mechanism(scene_from_dict({"bodies": {"block": {"mass": 1, "inertia": 1}}}, "types")).arrays
    return typeof(m), typeof(workspace(m))
