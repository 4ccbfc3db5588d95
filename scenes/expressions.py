"""Arithmetic in scene files: `"m1*L^2/12"`, `"pi/4"`, `"deg(30)"`.

Only numbers, the scene's parameters, the operators `+ - * / ^ **`, parentheses and a few
functions are understood; anything else is an error that names what was found.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Mapping

CONSTANTS = {"pi": math.pi}
FUNCTIONS = {"sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "tan": math.tan,
             "atan": math.atan, "deg": math.radians}
_BINARY = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
           ast.Div: operator.truediv, ast.Pow: operator.pow}
_UNARY = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_MAX_LENGTH = 500


def evaluate(value: float | int | str, names: Mapping[str, float]) -> float:
    """Value of a number or of an arithmetic expression.

    Parameters
    ----------
    value
        A number, or a string such as ``"pi/4"``; ``deg(x)`` converts degrees to radians.
    names
        The scene's parameters.

    Raises
    ------
    ValueError
        If the value is not a finite real number or the expression cannot be understood.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"expected a number or arithmetic such as 'pi/4', found {type(value).__name__}")
    if isinstance(value, str):
        if len(value) > _MAX_LENGTH:
            raise ValueError(f"expression longer than {_MAX_LENGTH} characters")
        try:
            tree = ast.parse(value.strip().replace("^", "**"), mode="eval")
            result = _evaluate(tree.body, names)
        except (SyntaxError, RecursionError, MemoryError):
            raise ValueError(f"cannot read {value!r} as arithmetic") from None
        except (ZeroDivisionError, OverflowError) as error:
            raise ValueError(f"{value!r}: {error}") from None
    else:
        result = value
    try:
        result = float(result)
    except (TypeError, OverflowError):
        raise ValueError(f"{value!r} is not a real number of this machine's range") from None
    if not math.isfinite(result):
        raise ValueError(f"{value!r} is not finite")
    return result


def _evaluate(node: ast.expr, names: Mapping[str, float]) -> float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        if node.id in CONSTANTS:
            return CONSTANTS[node.id]
        known = ", ".join(sorted([*names, *CONSTANTS]))
        raise ValueError(f"unknown name {node.id!r}; known here: {known}")
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _BINARY[type(node.op)](_evaluate(node.left, names), _evaluate(node.right, names))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return _UNARY[type(node.op)](_evaluate(node.operand, names))
    if (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS
            and len(node.args) == 1 and not node.keywords):
        return FUNCTIONS[node.func.id](_evaluate(node.args[0], names))
    raise ValueError(f"cannot read {ast.unparse(node)!r} as arithmetic")
