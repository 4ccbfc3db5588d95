"""Columns of tables refer to their quantities: what a quantity says is not said again where a table is made."""

import ast
import importlib
from collections import ChainMap
from pathlib import Path

import pytest

from stiction import comparisons
from stiction.comparisons.bench.presentation import Column
from stiction.comparisons.bench.quantities import QUANTITIES, quantity_of

FOLDER = Path(comparisons.__file__).parent
PARAMETERS = tuple(Column.__dataclass_fields__)
FROM_QUANTITIES = ("label", "unit", "uncertainty")


def calls(tree):
    """The calls of `Column` in a module, by place: their arguments as expressions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Column":
            positional = dict(zip(PARAMETERS, node.args))
            yield node.lineno, positional | {word.arg: word.value for word in node.keywords}


def known(expression, names):
    """The value of an expression of constants of the module; None of others, such as the name of a scene."""
    if not all(
        isinstance(part, (ast.Constant, ast.Name, ast.Load)) for part in ast.walk(expression)
    ):
        return None
    return eval(compile(ast.Expression(expression), "", "eval"), {}, ChainMap({}, names))


def repeated(tree, names):
    """Arguments of `Column` that say what the quantity says, and how many calls were understood."""
    found, understood = [], 0
    for line, given in calls(tree):
        try:
            arguments = {name: known(value, names) for name, value in given.items()}
        except NameError:  # a loop variable
            continue
        key = arguments.get("of") or arguments.get("name")
        if key is None:
            continue
        understood += 1
        found += [
            (line, key, name)
            for name in FROM_QUANTITIES
            if arguments.get(name) and arguments[name] == getattr(quantity_of(key), name)
        ]
    return found, understood


MODULES = sorted(
    path
    for path in FOLDER.glob("**/*.py")
    if "Column(" in path.read_text(encoding="utf-8") and path.name != "table_view.py"
)


@pytest.mark.parametrize("path", MODULES, ids=[path.stem for path in MODULES])
def test_no_column_repeats_its_quantity(path):
    name = ".".join(("stiction.comparisons", *path.relative_to(FOLDER).with_suffix("").parts))
    module = importlib.import_module(name)
    found, understood = repeated(ast.parse(path.read_text(encoding="utf-8")), vars(module))
    assert not found and understood


def test_a_repeated_label_or_unit_would_be_found():
    drift = QUANTITIES["position_drift"]
    text = (
        f"Column(P, {drift.label!r}), Column(P, 'drift', unit={drift.unit!r}), Column(P, 'drift')"
    )
    found, understood = repeated(ast.parse(text), {"P": drift.key})
    assert [name for _, _, name in found] == ["label", "unit"] and understood == 3
