"""Arithmetic expressions in scene files, such as `"m1*L^2/12"`, `"pi/4"` or `"deg(30)"`.

An expression consists of numbers, parameters of the scene, the operators `+ - * / ^ **`, parentheses and a few
functions. It is evaluated in double precision: unlike with Python's integers, no expression takes long.
"""

from __future__ import annotations

import ast
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import lru_cache

from stiction.scenes.base_errors import InputError
from stiction.scenes.wording import did_you_mean
from stiction.scenes.wording import names as listed

CONSTANTS = {"pi": math.pi}
"""Constants by name."""
FUNCTIONS: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "deg": math.radians,
    "abs": abs,
    "min": min,
    "max": max,
}
"""Functions by name; angles are in radians, ``atan2(y, x)`` is the angle of the vector (x, y), and ``deg`` converts
degrees."""
_ARITIES = {"atan2": (2, 2), "min": (2, math.inf), "max": (2, math.inf)}
"""Smallest and largest number of arguments of the functions that do not take one argument."""
MAX_LENGTH = 500
"""Largest number of characters of an expression. It also keeps the depth of the syntax tree below Python's limit of
recursion."""
_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[float], float]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


def evaluate(value: float | int | str, names: Mapping[str, float]) -> float:
    """Return the value of a number or an arithmetic expression.

    Parameters
    ----------
    value
        A number, or an expression. Powers have the precedence of mathematics: ``-2^2`` is -4, ``2^3^2`` is 2^9.
    names
        Values of the parameters by name. A parameter hides a constant of the same name.

    Raises
    ------
    InputError
        If the value is not a finite real number. The message says what was expected; the caller adds the key and the
        value.
    """
    # Most values are floats.
    if type(value) is float and math.isfinite(value):
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise InputError("expected a number or arithmetic such as 'pi/4'")
    try:
        result = _evaluate_node(_parse(value), names) if isinstance(value, str) else float(value)
    except ZeroDivisionError:
        raise InputError("divides by zero; expected a finite number") from None
    except OverflowError:
        raise InputError("too large; expected a number below 1.8e308") from None
    if not math.isfinite(result):
        raise InputError("expected a finite number")
    return result


@lru_cache(maxsize=1024)
def _parse(text: str) -> ast.expr:
    """Return the syntax tree of an expression."""
    if len(text) > MAX_LENGTH:
        raise InputError(f"expected at most {MAX_LENGTH} characters of arithmetic, not {len(text)}")
    try:
        # Python warns about literals such as `1or`.
        with warnings.catch_warnings(action="ignore", category=Warning):
            return ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError("expected a number or arithmetic such as 'pi/4'") from None


def _evaluate_node(node: ast.expr, names: Mapping[str, float]) -> float:
    """Return the value of a syntax tree; a node that is not listed in the module docstring is an error."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name):
            return _look_up(name, names)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            first, second = _evaluate_node(left, names), _evaluate_node(right, names)
            try:
                return _BINARY[type(op)](first, second)
            except ValueError:
                # Only math.pow raises it: for a negative power of zero, and for a fractional power of
                # a negative number.
                raise InputError(
                    f"{first:g} to the power {second:g} is not a real number"
                ) from None
        case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _UNARY:
            return _UNARY[type(sign)](_evaluate_node(operand, names))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return _call(name, arguments, names)
    raise InputError(
        "expected arithmetic of numbers, parameters, + - * / ^ and " + ", ".join(FUNCTIONS)
    )


def _look_up(name: str, names: Mapping[str, float]) -> float:
    """Return the value of a parameter, or of a constant that no parameter hides."""
    if name in names:
        return names[name]
    if name in CONSTANTS:
        return CONSTANTS[name]
    raise InputError(_unknown_name(name, [*names, *CONSTANTS]))


def _call(name: str, arguments: Sequence[ast.expr], names: Mapping[str, float]) -> float:
    """Return the value of a function."""
    if name not in FUNCTIONS:
        raise InputError(_unknown_name(name, FUNCTIONS))
    fewest, most = _ARITIES.get(name, (1, 1))
    if not fewest <= len(arguments) <= most:
        expected = f"{fewest} or more" if most > fewest else f"{fewest}"
        raise InputError(f"arguments of {name}: found {len(arguments)}; expected {expected}")
    values = [_evaluate_node(argument, names) for argument in arguments]
    try:
        return FUNCTIONS[name](*values)
    except ValueError:
        shown = ", ".join(f"{value:g}" for value in values)
        raise InputError(f"{name}({shown}) is not a real number") from None


def _unknown_name(name: str, known_names: Collection[str]) -> str:
    """Return the message for a name that is none of those that an expression may contain."""
    hint = did_you_mean(name, known_names) or f"; known here: {listed(known_names)}"
    return f"unknown name '{name}'{hint}"
