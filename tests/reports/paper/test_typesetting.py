"""Where Typst puts the figures of a paper: each in the size that it was drawn in, and above the footer."""

import json
import re
import xml.etree.ElementTree as ElementTree
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import typst
from matplotlib.figure import Figure

from stiction.reports.figures.style import COLUMNS, TALLEST

POINTS_PER_INCH = 72.0
BOTTOM = 22.0 / 25.4 * POINTS_PER_INCH
"""Margin of a page below its text, points."""
DESCENDERS = 4.0
"""Points below a base line that belong to it."""
HEIGHTS = (55 / 25.4, TALLEST, 140 / 25.4)
"""Heights of the figures, inches: a flat one, the highest that reports draw, and one that shares no page with that."""
PARAGRAPHS = (0, 3, 6, 9, 12)
"""Paragraphs before the first figure, each about a tenth of a page: what is left of the page differs."""


def content_with(columns: int, paragraphs: int, tables: bool) -> dict:
    """The data of a paper with a section of figures and, perhaps, a table."""
    caption = "A caption of several lines. " * 8
    names = [f"figure-{number}" for number in range(len(HEIGHTS))]
    table = {
        "name": "table",
        "caption": "A table.",
        "head": ["a", "b"],
        "right": [True, True],
        "wide": [False, False],
        "rows": [["1", "2"]],
    }
    return {
        "title": "A paper",
        "authors": ["A. Author"],
        "origin": "a run",
        "software": "footer",
        "date": {"year": 2026, "month": 1, "day": 1, "hour": 0, "minute": 0, "second": 0},
        "columns": columns,
        "summary": ["A line [@zhuang2014]."],
        "methods": ["Words that fill a line of the page. " * 22] * paragraphs,
        "tracing": [],
        "sections": [
            {
                "title": "A question",
                "text": " ".join(f"[#fig:{name}]" for name in names),
                "figures": [{"name": name, "caption": caption} for name in names],
                "tables": [table] if tables else [],
            }
        ],
    }


def offset_of(element: ElementTree.Element) -> np.ndarray:
    """The map (x, y, 1) of an element of an SVG file onto that of its parent."""
    transform = element.get("transform", "")
    numbers = [float(number) for number in re.findall(r"-?\d[\d.]*(?:e-?\d+)?", transform)]
    if transform.startswith("matrix"):
        a, b, c, d, e, f = numbers
    elif transform.startswith("translate"):
        (a, b, c, d), (e, f) = (1, 0, 0, 1), (*numbers, 0.0)[:2]
    else:
        assert not transform, transform
        return np.eye(3)
    return np.array([[a, c, e], [b, d, f], [0, 0, 1]])


def placed(element: ElementTree.Element, at: np.ndarray):
    """Yield the images and letters below an element, each with its place on the page, points from the top left."""
    at = at @ offset_of(element)
    kind = element.tag.rpartition("}")[2]
    if kind in ("defs", "symbol"):
        return
    if kind in ("image", "use"):
        place = at @ (float(element.get("x", 0)), float(element.get("y", 0)), 1.0)
        yield kind, element, place[:2]
    for child in element:
        yield from placed(child, at)


def typeset(folder: Path, content: dict) -> list[ElementTree.Element]:
    """Set a paper of these data, with figures of HEIGHTS in the width of its columns; return its pages."""
    (folder / "figures").mkdir()
    width = COLUMNS["double" if content["columns"] == 1 else "single"]
    for number, height in enumerate(HEIGHTS):
        Figure((width, height)).savefig(folder / "figures" / f"figure-{number}.pdf")
    (folder / "paper.json").write_text(json.dumps(content))
    for name in ("paper.typ", "references.bib"):
        (folder / name).write_bytes((files("stiction.reports.paper") / name).read_bytes())
    typst.compile(
        str(folder / "paper.typ"),
        str(folder / "page-{0p}.svg"),
        root=str(folder),
        ignore_system_fonts=True,
        format="svg",
    )
    return [ElementTree.parse(path).getroot() for path in sorted(folder.glob("page-*.svg"))]


@pytest.mark.parametrize("tables", [False, True], ids=["no table", "a table"])
@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize("paragraphs", PARAGRAPHS)
def test_figures_keep_their_size_and_captions_stay_on_the_page(
    tmp_path, paragraphs, columns, tables
):
    sizes = []
    for page in typeset(tmp_path, content_with(columns, paragraphs, tables)):
        width, height = (float(page.get(name).removesuffix("pt")) for name in ("width", "height"))
        letters = []
        for kind, element, (x, y) in placed(page, np.eye(3)):
            if kind == "use":
                letters.append(y)
                continue
            size = [float(element.get(name)) for name in ("width", "height")]
            sizes.append(size)
            assert x >= 0 and x + size[0] <= width
            assert y >= 0 and y + size[1] <= height - BOTTOM
        # below the text of a page there is its footer, of one line
        below = [y for y in letters if y > height - BOTTOM + DESCENDERS]
        assert below and max(below) - min(below) < 1e-6
    drawn_width = COLUMNS["double" if columns == 1 else "single"]
    drawn = [(drawn_width * POINTS_PER_INCH, height * POINTS_PER_INCH) for height in HEIGHTS]
    assert np.allclose(sizes, drawn, atol=0.5)
