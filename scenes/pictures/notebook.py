"""Scenes and trajectories as HTML for Jupyter: a drawing, and tables of the contents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at
from stiction.scenes.pictures.mechanism import drawing, parameters_in_words
from stiction.scenes.run_summary import more_events, run_tables, run_title
from stiction.scenes.trajectory import Trajectory


def scene_html(scene: Scene) -> str:
    """Return the title of a scene, its drawing, and a table of the names of its elements and parameters."""
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
    """Return the title of a run, a drawing of its last state if the scene is known, and the tables of its summary."""
    title = run_title(trajectory)
    if trajectory.termination != "end":
        title += f"; stopped: {trajectory.termination}"
    parts = [f"<p>{escape(title)}</p>"]
    if trajectory.mechanism is not None and len(trajectory.t):
        poses = poses_at(trajectory.mechanism, trajectory, -1)
        parts.append(drawing(trajectory.mechanism, False, poses, float(trajectory.t[-1])).svg())
    if len(trajectory.t):
        parts += [_table(*table) for table in run_tables(trajectory)]
    more = more_events(trajectory)
    if more:
        parts.append(f"<p>{more}</p>")
    return "".join(parts)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table with the given headings; empty if there are no rows."""
    body = ""
    for row in rows:
        cells = "".join(f"<td>{escape(value)}</td>" for value in row)
        body += f"<tr>{cells}</tr>"
    if not body:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    return f"<table><tr>{head}</tr>{body}</table>"
