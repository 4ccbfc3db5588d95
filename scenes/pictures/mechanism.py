"""The drawing of a mechanism: bodies, pins, guides with the corners of their sliders numbered as in the paper, drives, springs, loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from scipy.spatial import ConvexHull, QhullError

from stiction.scenes.fields import GROUND
from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Scene, Translational
from stiction.scenes.pictures.geometry import Pose, Poses, View, attachments, corners, guide_frame, poses_at_start, spring_ends, view_of
from stiction.scenes.pictures.picture import BODY, CORNER, DRIVE, INK, LOAD, SHADE, SPRING, WIDTH, Picture, rc

MOST_NAMES = 12
"""Bodies up to which each has its name beside it."""
_COILS = 6
_TURNS = np.linspace(0.0, 4 * np.pi, 60)
_LONGEST_ARROW = 5.0  # of the largest corner force, symbols


def drawing(scene: Scene) -> Picture:
    """The mechanism at t = 0.

    Corners of a slider are numbered as in the paper, after the forces on them: 1 lower rear, 2 lower front, 3 upper front, 4 upper rear;
    front is where the guide's direction points to, up is that turned by +90 degrees.
    """
    poses = poses_at_start(scene)
    view = view_of(scene, [poses])
    with rc():
        picture, ax = canvas(scene, view)
        draw_mechanism(ax, scene, poses, view)
    return picture


def canvas(scene: Scene, view: View) -> tuple[Picture, Axes]:
    """An empty picture of the right shape, with a legend of what the scene has."""
    shape = (view.y[1] - view.y[0]) / (view.x[1] - view.x[0])
    picture = Picture(min(max(WIDTH * shape, 0.3 * WIDTH), 0.9 * WIDTH) + 0.6)
    handles = _legend(scene)
    if handles:
        picture.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)))
    return picture, picture.add_subplot()


def draw_mechanism(ax: Axes, scene: Scene, poses: Poses, view: View, t: float = 0.0,
                   corner_forces: Mapping[str, Sequence[float]] | None = None, largest: float = 1.0) -> None:
    """Draw it into axes.

    Parameters
    ----------
    poses
        Of all bodies, as of `geometry.poses_at`.
    t
        Seconds: loads point to where they push then; one that is zero then, to where it pushes if positive.
    corner_forces
        By guide its F1 .. F4, N, drawn as arrows on the slider.
    largest
        Of the corner forces of the whole motion, N: the longest arrow.
    """
    ax.set(xlim=view.x, ylim=view.y, aspect="equal", xlabel="$x$ [m]", ylabel="$y$ [m]")
    sizes = {name: (guide.length or 3 * view.unit, guide.width or (guide.length or 3 * view.unit) * (0.4 if guide.width is None else 0.02))
             for name, guide in scene.guides.items()}
    for name, guide in scene.guides.items():
        _guide(ax, guide, poses, view, sizes[name][1], view.reach[name])
    sliders = {guide.slider for guide in scene.guides.values()}
    held = attachments(scene)
    for name in scene.bodies:
        _body(ax, poses[name], held[name], view, name in sliders)
    for name, guide in scene.guides.items():
        _slider(ax, guide, poses, view, sizes[name])
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring):
            _spring(ax, *spring_ends(spring, poses), view.unit, spring.stiffness > 0, spring.damping > 0)
        else:
            centre = _centre(scene, spring.bodies, poses)
            radius = view.unit * (0.6 + 0.25 * _TURNS / np.pi)
            ax.plot(centre[0] + radius * np.cos(_TURNS), centre[1] + radius * np.sin(_TURNS), color=SPRING, linewidth=1, zorder=6)
        if GROUND in spring.bodies and isinstance(spring, LinearSpring):
            _fixed(ax, poses[GROUND].place(spring.points[spring.bodies.index(GROUND)]), view.unit, SPRING)
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            _pin(ax, poses[joint.bodies[0]].place(joint.points[0]), view.unit, GROUND in joint.bodies)
    for drive in scene.drives.values():
        _drive(ax, scene, drive, poses, view.unit)
    for load in scene.forces.values():
        sign = -1.0 if evaluate_law(load.law, t)[0] < 0 else 1.0
        if isinstance(load, Force):
            direction = sign * np.array(load.direction) / np.hypot(*load.direction)
            tip = poses[load.body].place(load.point)
            _arrow(ax, tip, tip + 5 * view.unit * direction, LOAD, 1.8)
        else:
            _turning_arrow(ax, poses[load.body].place((0.0, 0.0)), 2.6 * view.unit, LOAD, sign)
    for name, forces in (corner_forces or {}).items():
        _forces(ax, scene.guides[name], poses, sizes[name], forces, _LONGEST_ARROW * view.unit / largest)
    if len(scene.bodies) <= MOST_NAMES:
        for name in scene.bodies:
            ax.annotate(name, (poses[name].x, poses[name].y), (5, 7), textcoords="offset points", fontsize=7, fontstyle="italic", zorder=9)
    if scene.gravity is not None and np.hypot(*scene.gravity) > 0:
        down = np.array(scene.gravity) / np.hypot(*scene.gravity)
        begin = np.array([view.x[1] - 1.5 * view.unit, view.y[1] - 1.5 * view.unit]) - 2.0 * view.unit * np.maximum(down, 0)
        _arrow(ax, begin, begin + 2 * view.unit * down, INK, 0.8)
        ax.annotate("$g$", begin + view.unit * down, (-8, -3), textcoords="offset points")


def _legend(scene: Scene) -> list[Line2D | Patch]:
    """One entry a kind, with the names of its elements."""
    pins = [name for name, joint in scene.joints.items() if isinstance(joint, Revolute)]
    symbols: list[tuple[str, Sequence[str], Callable[[str], Line2D | Patch]]] = [
        ("pin", pins, lambda text: Line2D([], [], marker="o", markerfacecolor="white", color=INK, linestyle="none", label=text)),
        ("guide", list(scene.guides), lambda text: Patch(facecolor="white", edgecolor=INK, hatch="////", label=text)),
        ("drive", list(scene.drives), lambda text: Line2D([], [], color=DRIVE, linewidth=1.8, label=text)),
        ("spring", list(scene.springs), lambda text: Line2D([], [], color=SPRING, linestyle=(0, (2, 1)), label=text)),
        ("load", list(scene.forces), lambda text: Line2D([], [], color=LOAD, marker=">", label=text))]
    return [symbol(f"{kind}: {', '.join(names[:4])}{f', .. ({len(names)})' if len(names) > 4 else ''}") for kind, names, symbol in symbols if names]


def _body(ax: Axes, pose: Pose, held: Sequence[np.ndarray], view: View, slider: bool) -> None:
    """A bar through what is attached to it, or a plate; its centre of mass."""
    points = np.array([pose.place(point) for point in ((0.0, 0.0), *held)])
    try:
        outline = points[ConvexHull(points).vertices] if len(points) > 2 else points
    except QhullError:  # they lie on a line
        outline = points[np.argsort((points - points[0]) @ _along(points))][[0, -1]]
    if len(outline) > 2:
        ax.add_patch(Polygon(outline, facecolor=BODY, edgecolor=INK, linewidth=0.8, alpha=0.8, zorder=3))
    elif np.ptp(outline, axis=0).max() > 0:
        for width, color, layer in ((4.5, INK, 3), (3.0, BODY, 3.1)):
            ax.plot(*outline.T, color=color, linewidth=width, solid_capstyle="round", zorder=layer)
    elif not slider:
        ax.plot(*points[0], marker="o", markersize=9, color=BODY, markeredgecolor=INK, zorder=3)
    ax.plot(*points[0], marker="+", markersize=4, color=INK, markeredgewidth=0.7, zorder=5)


def _along(points: np.ndarray) -> np.ndarray:
    """Direction of points on a line."""
    return points[np.argmax(np.hypot(*(points - points[0]).T))] - points[0]


def _guide(ax: Axes, guide: Translational, poses: Poses, view: View, width: float, reach: tuple[float, float]) -> None:
    """Two surfaces with the solid behind them, hatched where it is the ground."""
    point, along, normal = guide_frame(guide, poses)
    for side in (-1, 1):
        surface = np.array([point + s * along + side * width / 2 * normal for s in reach])
        behind = surface[::-1] + side * 0.8 * view.unit * normal
        style = {"hatch": "/////", "facecolor": "white"} if guide.guide == GROUND else {"facecolor": BODY}
        ax.add_patch(Polygon(np.concatenate([surface, behind]), edgecolor="#888888", linewidth=0.0, zorder=1, **style))
        ax.plot(*surface.T, color=INK, linewidth=0.8, zorder=2)


def _slider(ax: Axes, guide: Translational, poses: Poses, view: View, size: tuple[float, float]) -> None:
    box = corners(guide, poses, size)
    ax.add_patch(Polygon(box, facecolor=SHADE, edgecolor=INK, linewidth=0.9, zorder=2.5))
    if guide.length is not None:
        centre = box.mean(axis=0)
        for number, corner in enumerate(box, 1):
            inwards = (centre - corner) * min(0.3, 0.9 * view.unit / np.hypot(*(centre - corner)))
            ax.text(*(corner + inwards), str(number), fontsize=7, ha="center", va="center", zorder=8)


def _pin(ax: Axes, point: np.ndarray, unit: float, grounded: bool) -> None:
    if grounded:
        _fixed(ax, point, unit, INK)
    ax.plot(*point, marker="o", markersize=5, markerfacecolor="white", markeredgecolor=INK, markeredgewidth=1.0, zorder=7)


def _fixed(ax: Axes, point: np.ndarray, unit: float, color: str) -> None:
    """A point of the ground: a triangle that stands on it."""
    foot = point + unit * np.array([[0.0, 0.0], [-0.8, -1.2], [0.8, -1.2]])
    ax.add_patch(Polygon(foot, facecolor="white", edgecolor=color, linewidth=0.8, zorder=2.8))
    ax.plot(*(point + unit * np.array([[-1.2, -1.2], [1.2, -1.2]])).T, color=color, linewidth=1.2, zorder=2.8)


def _spring(ax: Axes, begin: np.ndarray, end: np.ndarray, unit: float, elastic: bool, damped: bool) -> None:
    """A zigzag, a piston, or both side by side."""
    length = np.hypot(*(end - begin))
    if not length:
        return
    along = (end - begin) / length
    across = np.array([-along[1], along[0]])
    beside = 0.7 * unit if elastic and damped else 0.0
    if elastic:
        share = np.array([0.0, 0.15, *np.linspace(0.15, 0.85, 2 * _COILS + 1)[1:-1], 0.85, 1.0])
        swing = np.array([0.0, 0.0, *np.tile([1.0, -1.0], _COILS)[:2 * _COILS - 1], 0.0, 0.0])
        line = begin + share[:, None] * (end - begin) + (0.6 * unit * swing + beside)[:, None] * across
        ax.plot(*line.T, color=SPRING, linewidth=1.0, zorder=6)
    if damped:
        for part in ([(0.0, 0.0), (0.45, 0.0)], [(0.45, -0.5), (0.45, 0.5)], [(0.65, -0.7), (0.35, -0.7)], [(0.65, 0.7), (0.35, 0.7)],
                     [(0.65, -0.7), (0.65, 0.7)], [(0.65, 0.0), (1.0, 0.0)]):
            line = np.array([begin + share * (end - begin) + (swing * 0.7 * unit - beside) * across for share, swing in part])
            ax.plot(*line.T, color=SPRING, linewidth=1.0, zorder=6)


def _drive(ax: Axes, scene: Scene, drive: Drive, poses: Poses, unit: float) -> None:
    if drive.type == "angle":
        _turning_arrow(ax, _centre(scene, drive.bodies, poses), 1.8 * unit, DRIVE, -1.0 if evaluate_law(drive.law, 0.0)[1] < 0 else 1.0)
        return
    driven, base = spring_ends(drive, poses)
    if np.hypot(*(driven - base)) < unit and drive.axis is not None:  # at its origin: where it drives to
        axis = poses[drive.bodies[1]].turn(drive.axis)
        driven = base + 4 * unit * axis / np.hypot(*axis)
    ax.add_patch(FancyArrowPatch(base, driven, arrowstyle="<|-|>", mutation_scale=8, color=DRIVE, linewidth=1.5, shrinkA=0, shrinkB=0, zorder=6))


def _centre(scene: Scene, bodies: Sequence[str], poses: Poses) -> np.ndarray:
    """Where something that turns two bodies against each other is drawn: at the pin between them, else at the first that moves."""
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and set(joint.bodies) == set(bodies):
            return poses[joint.bodies[0]].place(joint.points[0])
    return poses[next(name for name in bodies if name != GROUND)].place((0.0, 0.0))


def _arrow(ax: Axes, begin: np.ndarray, end: np.ndarray, color: str, width: float) -> None:
    ax.add_patch(FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=9, color=color, linewidth=width, shrinkA=0, shrinkB=0, zorder=7))


def _turning_arrow(ax: Axes, centre: np.ndarray, radius: float, color: str, sign: float) -> None:
    turns = np.linspace(-0.4 * np.pi, 1.1 * np.pi, 40)[::int(sign)]
    path = centre + radius * np.column_stack([np.cos(turns), np.sin(turns)])
    ax.plot(*path.T, color=color, linewidth=1.5, zorder=6)
    _arrow(ax, path[-2], path[-1], color, 1.5)


def _forces(ax: Axes, guide: Translational, poses: Poses, size: tuple[float, float], forces: Sequence[float], scale: float) -> None:
    """On the slider: at the lower corners along the normal, at the upper ones against it."""
    normal = guide_frame(guide, poses)[2]
    for number, (corner, force) in enumerate(zip(corners(guide, poses, size), forces)):
        if abs(force) * scale > 0:
            inwards = (1 if number < 2 else -1) * normal
            _arrow(ax, corner - force * scale * inwards, corner, CORNER, 1.2)
