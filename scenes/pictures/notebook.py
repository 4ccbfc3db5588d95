"""How scenes and trajectories show themselves in Jupyter: a drawing, what is in it, the end of the motion, its events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.mechanism import canvas, draw_mechanism, drawing, fit, parameters_in_words
from stiction.scenes.pictures.picture import rc
from stiction.scenes.trajectory import Trajectory

EVENTS_SHOWN = 20
_STATE = ("x", "y", "angle", "vx", "vy", "omega")


def scene_html(scene: Scene) -> str:
    """Title, drawing, and what the scene declares."""
    declared = [(what, ", ".join(table)) for what, table in (("bodies", scene.bodies), ("joints", scene.joints), ("drives", scene.drives),
                                                            ("springs", scene.springs), ("forces", scene.forces)) if table]
    parameters = parameters_in_words(scene)
    return (f"<p><b>{escape(scene.name)}</b>: {escape(scene.title)}</p>" + drawing(scene, heading=False).svg()
            + _table(("", "names"), [*declared, *([("parameters", parameters)] if parameters else []), ("t_end", f"{scene.t_end:g} s")]))


def trajectory_html(trajectory: Trajectory) -> str:
    """Who simulated what and up to where, a drawing of the end if the scene is known, the end state, the events."""
    ended = f"t = 0 .. {trajectory.t[-1]:g} s" if len(trajectory.t) else "no motion"
    told = f"{trajectory.scene}: {trajectory.engine} {trajectory.version}, {trajectory.fidelity}, {ended}, {len(trajectory.t)} rows"
    if trajectory.termination != "end":
        told += f"; stopped: {trajectory.termination}"
    bodies = [name.removesuffix(".omega") for name in trajectory.columns if name.endswith(".omega")] if len(trajectory.t) else []
    state = [(name, *(f"{trajectory[f'{name}.{key}'][-1]:.9g}" for key in _STATE)) for name in bodies]
    parts = [f"<p>{escape(told)}</p>"]
    if trajectory.mechanism is not None and len(trajectory.t):
        parts.append(_end(trajectory.mechanism, trajectory))
    parts.append(_table(("end state [m, rad, s]", *_STATE), state))
    parts.append(_table(("event [s]", "kind", "joint"), [(f"{event.time:.9f}", event.kind, event.joint) for event in trajectory.events[:EVENTS_SHOWN]]))
    if (more := len(trajectory.events) - EVENTS_SHOWN) > 0:
        parts.append(f"<p>... and {more} more events</p>")
    return "".join(parts)


def _end(scene: Scene, trajectory: Trajectory) -> str:
    poses = poses_at(scene, trajectory, -1)
    view = view_of(scene, [poses])
    with rc():
        picture, ax = canvas(scene, view)
        draw_mechanism(ax, scene, poses, view, float(trajectory.t[-1]))
        fit(picture, ax)
    return picture.svg()


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join("<tr>" + "".join(f"<td>{escape(value)}</td>" for value in row) + "</tr>" for row in rows)
    return f"<table><tr>{''.join(f'<th>{escape(name)}</th>' for name in columns)}</tr>{body}</table>" if body else ""
