"""The notebooks of the documentation run, and their stored outputs are those of a run."""

import os
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parent.parent / "docs/notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LONGEST_CELL = 300
"""Seconds after which a cell counts as hung; the kernels may have to be compiled first."""


def kinds(cell):
    """The kinds of the outputs of a cell in order; what a cell prints may come in one output or in several."""
    found = []
    for output in cell.outputs:
        kind = sorted(output["data"]) if "data" in output else output["name"]
        if kind != "stderr" and found[-1:] != [kind]:
            found.append(kind)
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_as_stored(path, tmp_path, monkeypatch, compiled):
    stored = nbformat.read(path, as_version=4)
    nbformat.validate(stored)
    # the command `stiction` is beside this Python
    monkeypatch.setenv(
        "PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    )
    notebook = nbformat.read(path, as_version=4)
    # an error in a cell is raised here
    NotebookClient(
        notebook, timeout=LONGEST_CELL, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    cells = [
        (old, new)
        for old, new in zip(stored.cells, notebook.cells, strict=True)
        if old.cell_type == "code"
    ]
    assert [old.execution_count for old, _ in cells] == list(range(1, len(cells) + 1))
    for old, new in cells:
        assert kinds(old) == kinds(new), old.source


def test_all_are_in_the_navigation():
    navigation = (FOLDER.parent.parent / "mkdocs.yml").read_text(encoding="utf-8")
    assert NOTEBOOKS and all(f"notebooks/{path.name}" in navigation for path in NOTEBOOKS)
