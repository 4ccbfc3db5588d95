"""The drawing of a mechanism with matplotlib: bodies, pins, guides, drives, springs, loads."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from matplotlib.patheffects import withStroke

from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import LONGEST_ARROW, Poses, View, poses_at_start, view_of
from stiction.scenes.pictures.parts import LOOKS, CornerForce, Label, Link, Look, parts
from stiction.scenes.pictures.picture import COLORS, WIDTH, Picture, rc

LINE, LEADING = 115, 0.13
"""Characters of 7 pt across a picture, and inches from line to line."""
HEADS = {"end": "-|>", "both": "<|-|>"}


def drawing(
    scene: Scene, heading: bool = True, poses: Poses | None = None, t: float = 0.0
) -> Picture:
    """Draw the mechanism at its start, or with some `poses` at a time t (s).

    A heading has the scene's title and parameters. Corners of a slider are numbered as in the paper: 1 lower rear, 2
    lower front, 3 upper front, 4 upper rear; front is where the guide's direction points to, up that turned by +90°.
    """
    poses = poses or poses_at_start(scene)
    view = view_of(scene, [poses])
    with rc():
        picture, ax = canvas(scene, view)
        draw_mechanism(ax, scene, poses, view, t)
        if heading:
            lines = wrap(scene.title or scene.name, LINE) + wrap(parameters_in_words(scene), LINE)
            picture.set_figheight(picture.get_figheight() + LEADING * len(lines))
            picture.suptitle("\n".join(lines), fontsize=7, x=0.02, ha="left", parse_math=False)
        # as low as axes of equal scales leave it
        picture.draw_without_rendering()
        blank = ax.get_position(original=True).height - ax.get_position().height
        picture.set_figheight(picture.get_figheight() * (1 - blank))
    return picture


def parameters_in_words(scene: Scene) -> str:
    """``F0 = 3, L = 2``; empty for a scene without parameters."""
    return ", ".join(f"{name} = {value:g}" for name, value in scene.parameters.items())


def canvas(scene: Scene, view: View) -> tuple[Picture, Axes]:
    """Make an empty picture of the right shape, with a legend of what the scene has."""
    shape = (view.y[1] - view.y[0]) / (view.x[1] - view.x[0])
    picture = Picture(min(max(WIDTH * shape, 0.3 * WIDTH), 0.9 * WIDTH) + 0.6)
    handles = _legend(scene)
    if handles:
        picture.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)))
    return picture, picture.add_subplot()


def draw_mechanism(
    ax: Axes,
    scene: Scene,
    poses: Poses,
    view: View,
    t: float = 0.0,
    corner_forces: Mapping[str, float] | None = None,
    largest: float = 1.0,
) -> None:
    """Draw the mechanism into axes, loads as they push at a time t (s), or would if positive where they are zero.

    Corner forces, N, by column, are arrows on the sliders; that of the `largest` of the whole motion is the longest.
    """
    ax.set(xlim=view.x, ylim=view.y, aspect="equal", xlabel="$x$ [m]", ylabel="$y$ [m]")
    signs = {
        name: -1 if evaluate_law(load.law, t)[0] < 0 else 1 for name, load in scene.forces.items()
    }
    for layer, part in enumerate(parts(scene, view), 1):
        if isinstance(part, Label):
            _write(ax, part.place(poses), part.text, part.text in scene.bodies, layer)
        elif isinstance(part, CornerForce):
            force = (corner_forces or {}).get(part.column, 0.0)
            if length := force * LONGEST_ARROW * view.unit / largest:
                _stroke(ax, part.place(poses, length), LOOKS["corner force"], layer)
        elif isinstance(part, Link):
            _stroke(ax, part.place(poses, view.unit), LOOKS[part.look], layer)
        elif part.sign is None or signs[part.sign[0]] == part.sign[1]:
            _stroke(ax, part.place(poses), LOOKS[part.look], layer)


def _write(ax: Axes, point: np.ndarray, text: str, name: bool, layer: int) -> None:
    style: dict[str, Any] = {
        "fontstyle": "italic",
        "ha": "left",
        "path_effects": [withStroke(linewidth=2, foreground=COLORS["paper"])],
    }
    ax.text(
        point[0],
        point[1],
        text,
        fontsize=7,
        va="center",
        zorder=layer,
        **(style if name else {"ha": "center"}),
    )


def _stroke(ax: Axes, points: np.ndarray, look: Look, layer: int) -> None:
    color = COLORS[look.line] if look.line else "none"
    if look.fill:
        edge = COLORS["quiet"] if look.hatched else color
        ax.add_patch(
            Polygon(
                points,
                facecolor=COLORS[look.fill],
                edgecolor=edge,
                zorder=layer,
                linewidth=look.width if look.line else 0.0,
                hatch="/////" if look.hatched else None,
            )
        )
        return
    if not look.arrow or len(points) > 2:
        ax.plot(*points.T, color=color, linewidth=look.width, solid_capstyle="round", zorder=layer)
    if look.arrow:
        ax.add_patch(
            FancyArrowPatch(
                *points[-2:],
                arrowstyle=HEADS[look.arrow],
                mutation_scale=9,
                color=color,
                linewidth=look.width,
                shrinkA=0,
                shrinkB=0,
                zorder=layer,
            )
        )


def _legend(scene: Scene) -> list[Line2D | Patch]:
    """Make one entry a kind, with the names of its elements where they are not that word."""
    kinds = {
        "pin": [*scene.pins],
        "guide": scene.guides,
        "drive": scene.drives,
        "spring": scene.springs,
        "load": scene.forces,
    }
    symbols: dict[str, dict[str, Any]] = {
        "pin": {
            "marker": "o",
            "markerfacecolor": "white",
            "color": COLORS["ink"],
            "linestyle": "none",
        },
        "drive": {"color": COLORS["drive"], "linewidth": 1.8},
        "spring": {"color": COLORS["spring"], "marker": "x"},
        "load": {"color": COLORS["load"], "marker": ">"},
    }
    handles = []
    for kind, names in ((kind, [*names]) for kind, names in kinds.items() if names):
        more = f", .. ({len(names)})" if len(names) > 4 else ""
        text = kind if names == [kind] else f"{kind}: {', '.join(names[:4])}{more}"
        handles.append(
            Patch(facecolor="white", edgecolor=COLORS["ink"], hatch="////", label=text)
            if kind == "guide"
            else Line2D([], [], label=text, **symbols[kind])
        )
    return handles
