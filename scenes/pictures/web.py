"""HTML pages with data: compact columns of numbers, drawings that the browser moves, and self-contained documents."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import LONGEST_ARROW, View
from stiction.scenes.pictures.parts import LOOKS, CornerForce, Label, Link, Stroke, parts
from stiction.scenes.trajectory import Trajectory

CONTENT_SECURITY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)
"""Content security policy of a page, which does not permit any use of the network."""
SHORT = 16
"""Bits of a number with an accuracy of 8e-6 of the range of its column, which is finer than a screen shows."""
LONG = 32
"""Bits of a number with an accuracy of 1e-10 of the range of its column, for times."""
KINDS = {Stroke: "stroke", Label: "label", CornerForce: "force", Link: "link"}
"""Names of the classes of parts in the data of a page."""
_FIGURES = 6
"""Significant digits of the coordinates of a drawing, relative to its size."""


class Columns:
    """Columns of numbers in a compact form, which ``unpack`` of ``browser/data.js`` reads.

    Numbers are rounded to integer multiples of a step, which is a fraction of the range of their column. Differences of
    these integers are stored: those of second order, which are small for smooth motions, or those of first order if the
    column has a coarse step. All first bytes of the differences precede all second bytes, and so on; the whole is
    compressed (gzip) and encoded in base64.

    Attributes
    ----------
    about : list of tuple
        Of each column: bits, number of rows, smallest value, step, and order of the differences.
    data : bytearray
        The differences of all columns, not compressed.
    """

    def __init__(self) -> None:
        self.about: list[tuple[int, int, float, float, int]] = []
        self.data = bytearray()

    def add(
        self, values: Sequence[float] | np.ndarray, bits: int = SHORT, step: float = 0.0
    ) -> int:
        """Add a column.

        Parameters
        ----------
        values
            The numbers, shape (n,); values that are not finite are stored as missing.
        bits
            `SHORT` or `LONG`.
        step
            The smallest difference that matters, in the unit of the values; 0 for all that the bits can represent.

        Returns
        -------
        int
            Index of the column.
        """
        values = np.asarray(values, dtype=float)
        is_finite = np.isfinite(values)
        # The largest integer stands for a missing value.
        largest = 2**bits - 2
        low, high = 0.0, 0.0
        if is_finite.any():
            low, high = float(values[is_finite].min()), float(values[is_finite].max())
        order = 1 if step else 2
        step = max((high - low) / largest, step) or 1.0
        integer_type = np.dtype(f"<u{bits // 8}")
        integers = np.full(len(values), largest + 1, integer_type)
        integers[is_finite] = np.rint((values[is_finite] - low) / step).astype(integer_type)
        # Differences wrap around, as do the sums by which they are read.
        for _ in range(order):
            integers = np.diff(integers, prepend=integer_type.type(0)).astype(integer_type)
        self.data += integers.view(np.uint8).reshape(-1, bits // 8).T.tobytes()
        self.about.append((bits, len(values), low, step, order))
        return len(self.about) - 1

    def packed(self) -> dict[str, Any]:
        """Return all columns in the types of JSON."""
        return {"columns": self.about, "data": compressed(bytes(self.data))}


def compressed(data: bytes) -> str:
    """Compress bytes with gzip, and encode them in base64, as ``inflate`` of ``browser/data.js`` expects.

    The result contains no date, so that it is the same for the same data.
    """
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def mechanism(scene: Scene, view: View) -> dict[str, Any]:
    """Return a drawing in the types of JSON, as ``drawMechanism`` of ``browser/player.js`` expects."""
    decimals = _FIGURES - 1 - int(np.floor(np.log10(view.size)))
    text = json.dumps(
        [{"kind": KINDS[type(part)], **asdict(part)} for part in parts(scene, view)],
        default=np.ndarray.tolist,
    )
    drawn = json.loads(text, parse_float=lambda number: round(float(number), decimals))
    for part in drawn:
        if part["kind"] == "force":
            part["column"] = f"{part['guide']}.F{part['number']}"
    return {
        "name": scene.name,
        "x": view.x,
        "y": view.y,
        "unit": view.unit,
        "longest": LONGEST_ARROW * view.unit,
        "bodies": list(scene.bodies),
        "looks": {name: asdict(look) for name, look in LOOKS.items()},
        "parts": drawn,
    }


def load_signs(scene: Scene, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return the sign of each load, -1 or 1 as in `Stroke.sign`, at times t (n,), s.

    Keys are ``load NAME``; the arrays have the shape (n,).
    """
    signs = {}
    for name, load in scene.forces.items():
        values = [evaluate_law(load.law, time)[0] for time in t]
        signs[f"load {name}"] = np.array([-1.0 if value < 0 else 1.0 for value in values])
    return signs


def pose_columns(scene: Scene) -> list[str]:
    """Return the names of the columns that are needed to draw a mechanism."""
    return [f"{name}.{key}" for name in scene.bodies for key in ("x", "y", "angle")]


def force_columns(scene: Scene) -> list[str]:
    """Return the names of the columns of corner forces, which are drawn if a trajectory has them."""
    return [
        f"{name}.F{number}"
        for name, guide in scene.guides.items()
        if guide.length is not None
        for number in (1, 2, 3, 4)
    ]


def largest_force(scene: Scene, columns: Trajectory | Mapping[str, np.ndarray]) -> float:
    """Return the largest corner force of a motion, N, whose arrow is the longest; 1 if there is none."""
    largest = 0.0
    for name in force_columns(scene):
        if name in columns:
            largest = max(largest, float(np.nanmax(columns[name], initial=0.0)))
    return largest or 1.0


def document(title: str, body: str, styles: Iterable[str], scripts: Iterable[str]) -> str:
    """Return an HTML document that contains its styles and scripts, and makes no requests to the network."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{CONTENT_SECURITY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>",
            '<link rel="icon" href="data:,">',
            *(f"<style>\n{style}</style>" for style in styles),
            "</head>",
            "<body>",
            body,
            *(f"<script>\n{script}</script>" for script in scripts),
            "</body>",
            "</html>",
            "",
        ]
    )


def data(attribute: str, content: Mapping[str, Any]) -> str:
    """Return JSON as an element of a document, with an attribute by which scripts find it."""
    # A text that contains `</script>` would end the element.
    text = json.dumps(content, ensure_ascii=False).replace("</", "<\\/")
    return f'<script type="application/json" {attribute}>{text}</script>'


def asset(name: str) -> str:
    """Return the text of a file in the folder ``browser``."""
    return (files("stiction.scenes.pictures") / "browser" / name).read_text(encoding="utf-8")


def film_controls() -> str:
    """Return the HTML elements of a drawing with its controls, as ``Film`` of ``browser/player.js`` expects."""
    return asset("film.html").replace("\n", "")
