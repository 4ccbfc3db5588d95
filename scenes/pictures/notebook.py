"""Scenes and trajectories in Jupyter: a drawing, and tables of what is in it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at
from stiction.scenes.pictures.mechanism import drawing, parameters_in_words
from stiction.scenes.run_summary import more_events, run_tables, run_title
from stiction.scenes.trajectory import Trajectory


def scene_html(scene: Scene) -> str:
    """Title, drawing, and what the scene declares."""
    sections = ("bodies", "joints", "drives", "springs", "forces")
    rows = [(section, ", ".join(getattr(scene, section))) for section in sections]
    rows.append(("parameters", parameters_in_words(scene)))
    declared = [row for row in rows if row[1]]
    return (
        f"<p><b>{escape(scene.name)}</b>: {escape(scene.title)}</p>"
        + drawing(scene, heading=False).svg()
        + _table(("", "names"), [*declared, ("t_end", f"{scene.t_end:g} s")])
    )


def trajectory_html(trajectory: Trajectory) -> str:
    """Scene, engine and end of the run, a drawing of the end if the scene is known, what a terminal shows as well."""
    title = run_title(trajectory)
    if trajectory.termination != "end":
        title += f"; stopped: {trajectory.termination}"
    parts = [f"<p>{escape(title)}</p>"]
    if trajectory.mechanism is not None and len(trajectory.t):
        poses = poses_at(trajectory.mechanism, trajectory, -1)
        parts.append(drawing(trajectory.mechanism, False, poses, float(trajectory.t[-1])).svg())
    if len(trajectory.t):
        parts += [_table(*table) for table in run_tables(trajectory)]
    if more := more_events(trajectory):
        parts.append(f"<p>{more}</p>")
    return "".join(parts)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(value)}</td>" for value in row) + "</tr>" for row in rows
    )
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    return f"<table><tr>{head}</tr>{body}</table>" if body else ""
