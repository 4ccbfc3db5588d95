"""Imports are by the installed name and go one way: scenes, reference_impl and engines, comparisons, reports, the command line."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FLOORS = {"scenes": 0, "reference_impl": 1, "engines": 2, "comparisons": 3, "reports": 4, "cli": 5}
SOURCES = [path for name in (*FLOORS, "stiction", "tests") for path in sorted((ROOT / name).rglob("*.py"))]


def imported(path):
    """Names of modules and of what is imported from them, below ``stiction`` or not."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_imports(path):
    own = path.relative_to(ROOT).parts[0]
    for name in imported(path):
        first, _, rest = name.partition(".")
        assert first not in FLOORS, f"import of {name}: the user may have a package of this name"
        below = rest.partition(".")[0]
        if first == "stiction" and own in FLOORS and below in FLOORS:
            assert FLOORS[below] <= FLOORS[own], f"import of {name}"


def test_rule_is_seen():
    """That the sources are found, and that a wrong import would be."""
    assert len(SOURCES) > 150 and "stiction.scenes.load_scene" in set(imported(ROOT / "stiction" / "__init__.py"))
