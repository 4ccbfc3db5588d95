"""Arithmetic in scene files: `"m1*L^2/12"`, `"pi/4"`, `"deg(30)"`.

Only numbers, the scene's parameters, the operators `+ - * / ^ **`, parentheses and a few
functions are understood; everything is computed in floats, so nothing can take long.
"""

from __future__ import annotations

import ast
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache

from stiction.scenes.base_errors import InputError
from stiction.scenes.wording import did_you_mean
from stiction.scenes.wording import names as listed

CONSTANTS = {"pi": math.pi}
FUNCTIONS = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "atan": math.atan,
    "deg": math.radians,
}
MAX_LENGTH = 500
"""Characters of one expression."""
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
    """Value of a number or of an arithmetic expression in which parameters have `names`.

    Powers bind as in mathematics: ``-2^2`` is -4, ``2^3^2`` is 2^9. InputError says what was expected of anything but
    a finite real number; its caller shows the value.
    """
    if type(value) is float and math.isfinite(value):  # most are
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise InputError("expected a number or arithmetic such as 'pi/4'")
    try:
        result = _evaluate(_parsed(value), names) if isinstance(value, str) else float(value)
    except ZeroDivisionError:
        raise InputError("divides by zero; expected a finite number") from None
    except OverflowError:
        raise InputError("too large; expected a number below 1.8e308") from None
    if not math.isfinite(result):
        raise InputError("expected a finite number")
    return result


@lru_cache(maxsize=1024)
def _parsed(text: str) -> ast.expr:
    if len(text) > MAX_LENGTH:
        raise InputError(f"expected at most {MAX_LENGTH} characters of arithmetic, not {len(text)}")
    try:
        with warnings.catch_warnings(action="ignore", category=Warning):
            # Python's own, about odd literals
            return ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError("expected a number or arithmetic such as 'pi/4'") from None


def _evaluate(node: ast.expr, names: Mapping[str, float]) -> float:
    """Value of a syntax tree, whose depth MAX_LENGTH keeps below Python's limit of recursion."""
    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, (int, float))
        and not isinstance(node.value, bool)
    ):
        return float(node.value)
    # parameters hide constants of their names
    if isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        if node.id in CONSTANTS:
            return CONSTANTS[node.id]
        raise InputError(_unknown(node.id, [*names, *CONSTANTS]))
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        left, right = _evaluate(node.left, names), _evaluate(node.right, names)
        try:
            return _BINARY[type(node.op)](left, right)
        except ValueError:  # math.pow: of zero to a negative, of a negative to a broken power
            raise InputError(f"{left:g} to the power {right:g} is not a real number") from None
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return _UNARY[type(node.op)](_evaluate(node.operand, names))
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and len(node.args) == 1
        and not node.keywords
    ):
        if node.func.id not in FUNCTIONS:
            raise InputError(_unknown(node.func.id, FUNCTIONS))
        argument = _evaluate(node.args[0], names)
        try:
            return FUNCTIONS[node.func.id](argument)
        except ValueError:
            raise InputError(f"{node.func.id}({argument:g}) is not a real number") from None
    raise InputError(
        "expected arithmetic of numbers, parameters, + - * / ^ and " + ", ".join(FUNCTIONS)
    )


def _unknown(name: str, known: Collection[str]) -> str:
    return f"unknown name '{name}'" + (
        did_you_mean(name, known) or f"; known here: {listed(known)}"
    )
