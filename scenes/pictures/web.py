"""Pages for a browser: columns of numbers in few bytes, mechanisms to be moved, a document that needs no other file."""

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
"""Permissions of a page in a browser: nothing with the network."""
SHORT, LONG = 16, 32
"""Bits of a number. 16: to 8e-6 of the range of its column, finer than a screen shows; 32: to 1e-10."""
KINDS = {Stroke: "stroke", Label: "label", CornerForce: "force", Link: "link"}


class Columns:
    """Columns of numbers, to be read by ``unpack`` of ``browser/data.js``.

    Each is rounded to whole steps of its range. The second differences of the steps are kept, byte by byte, since those
    of smooth motions are small; the first ones of columns with a coarse step of their own. All of it is compressed
    (gzip) and written in base64.
    """

    def __init__(self) -> None:
        self.about: list[
            tuple[int, int, float, float, int]
        ] = []  # bits, rows, smallest value, step, differences
        self.data = bytearray()  # not yet compressed

    def add(
        self, values: Sequence[float] | np.ndarray, bits: int = SHORT, step: float = 0.0
    ) -> int:
        """Add a column and return its number; what is not finite is missing, nothing need be finer than `step`."""
        values = np.asarray(values, dtype=float)
        known, last = np.isfinite(values), 2**bits - 2
        low, high = (
            (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
        )
        order = 1 if step else 2
        step = max((high - low) / last, step) or 1.0
        kind = np.dtype(f"<u{bits // 8}")
        whole = np.full(len(values), last + 1, kind)
        whole[known] = np.rint((values[known] - low) / step).astype(kind)
        for _ in range(order):
            whole = np.diff(whole, prepend=kind.type(0)).astype(kind)
        self.data += whole.view(np.uint8).reshape(-1, bits // 8).T.tobytes()
        self.about.append((bits, len(values), low, step, order))
        return len(self.about) - 1

    def packed(self) -> dict[str, Any]:
        """Ready for JSON; the same columns give the same text."""
        return {"columns": self.about, "data": compressed(bytes(self.data))}


def compressed(data: bytes) -> str:
    """Write bytes as ``inflate`` of ``browser/data.js`` reads them: gzip in base64, without a date."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def mechanism(scene: Scene, view: View) -> dict[str, Any]:
    """Return the drawing, ready for JSON, as ``drawMechanism`` of ``browser/player.js`` reads it."""
    digits = 5 - int(np.floor(np.log10(view.size)))
    text = json.dumps(
        [{"kind": KINDS[type(part)], **asdict(part)} for part in parts(scene, view)],
        default=np.ndarray.tolist,
    )
    drawn = json.loads(text, parse_float=lambda number: round(float(number), digits))
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
    """Return by ``load NAME`` the sign of each load at the times, -1 or 1, as in `Stroke.sign`."""
    return {
        f"load {name}": np.array(
            [-1.0 if evaluate_law(load.law, time)[0] < 0 else 1.0 for time in t]
        )
        for name, load in scene.forces.items()
    }


def pose_columns(scene: Scene) -> list[str]:
    """Columns of a trajectory without which a mechanism cannot be drawn."""
    return [f"{name}.{key}" for name in scene.bodies for key in ("x", "y", "angle")]


def force_columns(scene: Scene) -> list[str]:
    """Columns of the forces on the corners of sliders, which are drawn where a trajectory has them."""
    return [
        f"{name}.F{number}"
        for name, guide in scene.guides.items()
        if guide.length is not None
        for number in (1, 2, 3, 4)
    ]


def largest_force(scene: Scene, columns: Trajectory | Mapping[str, np.ndarray]) -> float:
    """Largest force on a corner over the whole motion, N, whose arrow is the longest; 1 where there are none."""
    forces = (columns[name] for name in force_columns(scene) if name in columns)
    return max((float(np.nanmax(force, initial=0.0)) for force in forces), default=0.0) or 1.0


def document(title: str, body: str, styles: Iterable[str], scripts: Iterable[str]) -> str:
    """Make an HTML document with everything in it; it requests nothing from the network."""
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
    """JSON as an element of a document, with an attribute by which its scripts find it."""
    text = json.dumps(content, ensure_ascii=False).replace("</", "<\\/")
    return f'<script type="application/json" {attribute}>{text}</script>'


def asset(name: str) -> str:
    """Read a style, script or element of ``browser``."""
    return (files("stiction.scenes.pictures") / "browser" / name).read_text(encoding="utf-8")


def film_controls() -> str:
    """The drawing with its controls, as ``Film`` of ``browser/player.js`` takes it."""
    return asset("film.html").replace("\n", "")
