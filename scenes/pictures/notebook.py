"""Scenes and trajectories in Jupyter: a drawing, what is in it, the end of the motion, its events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at
from stiction.scenes.pictures.mechanism import drawing, parameters_in_words
from stiction.scenes.trajectory import Trajectory

EVENTS_SHOWN = 20
_STATE = ("x", "y", "angle", "vx", "vy", "omega")


def scene_html(scene: Scene) -> str:
    """Title, drawing, and what the scene declares."""
    sections = ("bodies", "joints", "drives", "springs", "forces")
    rows = [(section, ", ".join(getattr(scene, section))) for section in sections]
    rows.append(("parameters", parameters_in_words(scene)))
    declared = [row for row in rows if row[1]]
    return (f"<p><b>{escape(scene.name)}</b>: {escape(scene.title)}</p>" + drawing(scene, heading=False).svg()
            + _table(("", "names"), [*declared, ("t_end", f"{scene.t_end:g} s")]))


def trajectory_html(trajectory: Trajectory) -> str:
    """Scene, engine and end of the run, a drawing of the end if the scene is known, the end state, the events."""
    moved = len(trajectory.t) > 0
    ended = f"t = 0 .. {trajectory.t[-1]:g} s" if moved else "no motion"
    title = (f"{trajectory.scene}: {trajectory.engine} {trajectory.version}, {trajectory.fidelity}, {ended}, "
             f"{len(trajectory.t)} rows")
    if trajectory.termination != "end":
        title += f"; stopped: {trajectory.termination}"
    parts = [f"<p>{escape(title)}</p>"]
    if trajectory.mechanism is not None and moved:
        poses = poses_at(trajectory.mechanism, trajectory, -1)
        parts.append(drawing(trajectory.mechanism, False, poses, float(trajectory.t[-1])).svg())
    bodies = [name.removesuffix(".omega") for name in trajectory.columns if name.endswith(".omega")] if moved else []
    state = [(name, *(f"{trajectory[f'{name}.{key}'][-1]:.9g}" for key in _STATE)) for name in bodies]
    events = [(f"{event.time:.9f}", event.kind, event.joint) for event in trajectory.events[:EVENTS_SHOWN]]
    parts += [_table(("end state [m, rad, s]", *_STATE), state), _table(("event [s]", "kind", "joint"), events)]
    if (more := len(trajectory.events) - EVENTS_SHOWN) > 0:
        parts.append(f"<p>... and {more} more events</p>")
    return "".join(parts)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join("<tr>" + "".join(f"<td>{escape(value)}</td>" for value in row) + "</tr>" for row in rows)
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    return f"<table><tr>{head}</tr>{body}</table>" if body else ""
