"""Drawing of a mechanism with matplotlib."""

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

CHARACTERS_PER_LINE = 115
"""Characters of 7 pt that fit in the width of a picture."""
LINE_HEIGHT = 0.13
"""Distance of lines of text, inches."""
MAX_NAMES = 4
"""Largest number of names of elements in an entry of the legend."""
HEADS = {"end": "-|>", "both": "<|-|>"}
"""Matplotlib's arrow styles by `Look.arrow`."""


def drawing(
    scene: Scene, heading: bool = True, poses: Poses | None = None, t: float = 0.0
) -> Picture:
    """Draw a mechanism.

    Corners of sliders are numbered as in the paper: 1 lower rear, 2 lower front, 3 upper front, 4 upper rear. The
    direction of the guide points to the front, and this direction turned by +90° points upwards.

    Parameters
    ----------
    scene
        The scene.
    heading
        Whether the title and the parameters of the scene are written above the drawing.
    poses
        Poses of the bodies; those at the start if None.
    t
        Time of the poses, s, which determines the signs of loads.
    """
    poses = poses or poses_at_start(scene)
    view = view_of(scene, [poses])
    with rc():
        picture, ax = canvas(scene, view)
        draw_mechanism(ax, scene, poses, view, t)
        if heading:
            lines = wrap(scene.title or scene.name, CHARACTERS_PER_LINE)
            lines += wrap(parameters_in_words(scene), CHARACTERS_PER_LINE)
            picture.set_figheight(picture.get_figheight() + LINE_HEIGHT * len(lines))
            picture.suptitle("\n".join(lines), fontsize=7, x=0.02, ha="left", parse_math=False)
        # Axes with equal scales do not fill the picture: remove the blank part of its height.
        picture.draw_without_rendering()
        blank = ax.get_position(original=True).height - ax.get_position().height
        picture.set_figheight(picture.get_figheight() * (1 - blank))
    return picture


def parameters_in_words(scene: Scene) -> str:
    """Return the parameters of a scene as a text such as ``F0 = 3, L = 2``; empty if there are none."""
    return ", ".join(f"{name} = {value:g}" for name, value in scene.parameters.items())


def canvas(scene: Scene, view: View) -> tuple[Picture, Axes]:
    """Return an empty picture with the aspect ratio of a view and a legend of the elements, and its axes."""
    aspect = (view.y[1] - view.y[0]) / (view.x[1] - view.x[0])
    # Very flat and very high mechanisms are limited to 0.3 and 0.9 of the width; 0.6 inches are for
    # the legend and the labels of the axes.
    picture = Picture(min(max(WIDTH * aspect, 0.3 * WIDTH), 0.9 * WIDTH) + 0.6)
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
    """Draw a mechanism into axes.

    Parameters
    ----------
    ax
        The axes.
    scene
        The scene.
    poses
        Poses of the bodies and of the ground.
    view
        The visible part of the plane.
    t
        Time, s, at which the sign of each load determines the direction of its arrow. A load that is zero is drawn as
        if it were positive.
    corner_forces
        Corner forces by column, N, which are drawn as arrows on the sliders.
    largest
        The largest corner force of the whole motion, N, whose arrow is the longest.
    """
    ax.set(xlim=view.x, ylim=view.y, aspect="equal", xlabel="$x$ [m]", ylabel="$y$ [m]")
    signs = {
        name: -1 if evaluate_law(load.law, t)[0] < 0 else 1 for name, load in scene.forces.items()
    }
    for layer, part in enumerate(parts(scene, view), 1):
        if isinstance(part, Label):
            _draw_label(ax, part.place(poses), part.text, part.text in scene.bodies, layer)
        elif isinstance(part, CornerForce):
            force = (corner_forces or {}).get(part.column, 0.0)
            length = force * LONGEST_ARROW * view.unit / largest
            if length != 0.0:
                _draw_stroke(ax, part.place(poses, length), LOOKS["corner force"], layer)
        elif isinstance(part, Link):
            _draw_stroke(ax, part.place(poses, view.unit), LOOKS[part.look], layer)
        elif part.sign is None or signs[part.sign[0]] == part.sign[1]:
            _draw_stroke(ax, part.place(poses), LOOKS[part.look], layer)


def _draw_label(ax: Axes, point: np.ndarray, text: str, is_body: bool, layer: int) -> None:
    """Write a label at a point; names of bodies are italic, with a halo that separates them from lines."""
    style: dict[str, Any] = {"ha": "center"}
    if is_body:
        halo = withStroke(linewidth=2, foreground=COLORS["paper"])
        style = {"fontstyle": "italic", "ha": "left", "path_effects": [halo]}
    ax.text(point[0], point[1], text, fontsize=7, va="center", zorder=layer, **style)


def _draw_stroke(ax: Axes, points: np.ndarray, look: Look, layer: int) -> None:
    """Draw a filled area, a line or an arrow through points, shape (n, 2); higher layers cover lower ones."""
    color = COLORS[look.line] if look.line else "none"
    if look.fill:
        ax.add_patch(
            Polygon(
                points,
                facecolor=COLORS[look.fill],
                edgecolor=COLORS["quiet"] if look.hatched else color,
                zorder=layer,
                linewidth=look.width if look.line else 0.0,
                hatch="/////" if look.hatched else None,
            )
        )
        return
    # A straight arrow is one patch. Of a curved one, the patch is the last piece only.
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
    """Return one entry of the legend for each kind of elements, with the names of the first of them."""
    names_by_kind: dict[str, list[str]] = {
        "pin": [name for name, pin in scene.pins.items() if not pin.rubs],
        "dry pin": [name for name, pin in scene.pins.items() if pin.rubs],
        "guide": list(scene.guides),
        "drive": list(scene.drives),
        "spring": list(scene.springs),
        "load": list(scene.forces),
    }
    symbols: dict[str, dict[str, Any]] = {
        "pin": {
            "marker": "o",
            "markerfacecolor": "white",
            "color": COLORS["ink"],
            "linestyle": "none",
        },
        "dry pin": {
            "marker": "o",
            "markerfacecolor": COLORS["shade"],
            "markeredgewidth": 1.8,
            "color": COLORS["ink"],
            "linestyle": "none",
        },
        "drive": {"color": COLORS["drive"], "linewidth": 1.8},
        "spring": {"color": COLORS["spring"], "marker": "x"},
        "load": {"color": COLORS["load"], "marker": ">"},
    }
    handles: list[Line2D | Patch] = []
    for kind, names in names_by_kind.items():
        if not names:
            continue
        more = f", .. ({len(names)})" if len(names) > MAX_NAMES else ""
        label = f"{kind}: {', '.join(names[:MAX_NAMES])}{more}"
        if names == [kind]:
            label = kind
        if kind == "guide":
            hatched = Patch(facecolor="white", edgecolor=COLORS["ink"], hatch="////", label=label)
            handles.append(hatched)
        else:
            handles.append(Line2D([], [], label=label, **symbols[kind]))
    return handles
