"""Films of the motion of a mechanism, with the forces on the corners of its sliders."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter

from stiction.scenes.base_errors import InputError
from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.mechanism import canvas, draw_mechanism
from stiction.scenes.pictures.picture import rc
from stiction.scenes.pictures.web import (
    LONG,
    Columns,
    asset,
    data,
    document,
    film_controls,
    force_columns,
    largest_force,
    load_signs,
    mechanism,
    pose_columns,
)
from stiction.scenes.trajectory import Trajectory

ENDINGS = (".gif", ".mp4", ".html")
"""Extensions of the files that can be written."""
FRAMES_PER_SECOND = 20
"""Frames per second of the film, which is fluent to the eye and keeps the file small."""
MIN_FRAMES = 40
"""Smallest number of frames: a short run is shown in slow motion."""
MAX_FRAMES = 150
"""Largest number of frames: a long run is shown faster than it is."""
FILM_DPI = 80
"""Resolution of the frames, pixels per inch."""


def check_animation(file: Path) -> None:
    """Check that a film can be written to a file of this name.

    Raises
    ------
    InputError
        If its extension is not in `ENDINGS`, or needs a program that is not installed.
    """
    if file.suffix.lower() not in ENDINGS:
        raise InputError(f"found {str(file)!r}; expected a name that ends in {', '.join(ENDINGS)}")
    if file.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise InputError(
            f"found {str(file)!r}, but the program ffmpeg, which writes such files, is not installed; "
            "expected a name that ends in .gif or .html"
        )


def animate(scene: Scene, trajectory: Trajectory, file: Path) -> int:
    """Write a film of a motion.

    Parameters
    ----------
    scene
        The scene.
    trajectory
        Its motion.
    file
        A .gif or .mp4 file, or an HTML page with a time slider, which contains all output times and works without a
        network.

    Returns
    -------
    int
        The number of frames.

    Raises
    ------
    InputError
        See `check_animation`.
    """
    check_animation(file)
    ending = file.suffix.lower()
    if ending == ".html":
        file.write_text(film_page(scene, trajectory), encoding="utf-8")
        return len(trajectory.t)
    first, last = trajectory.t[[0, -1]]
    frames = int(np.clip(FRAMES_PER_SECOND * (last - first), MIN_FRAMES, MAX_FRAMES))
    rows = np.unique(np.searchsorted(trajectory.t, np.linspace(first, last, frames)))
    view = view_of(scene, [poses_at(scene, trajectory, row) for row in rows])
    corners = force_columns(scene)
    largest = largest_force(scene, trajectory)
    scale = f"; corner forces: longest arrow {largest:.3g} N" if corners else ""
    writer = PillowWriter if ending == ".gif" else FFMpegWriter
    film = writer(fps=FRAMES_PER_SECOND)
    with rc():
        picture, ax = canvas(scene, view)
        picture.set_dpi(FILM_DPI)
        with film.saving(picture, file, FILM_DPI):
            for row in rows:
                ax.clear()
                draw_mechanism(
                    ax,
                    scene,
                    poses_at(scene, trajectory, row),
                    view,
                    float(trajectory.t[row]),
                    {name: float(trajectory[name][row]) for name in corners},
                    largest,
                )
                title = (
                    f"{trajectory.scene}, {trajectory.engine}: t = {trajectory.t[row]:.3f} s{scale}"
                )
                ax.set_title(title, fontsize=8, parse_math=False)
                if row == rows[0]:
                    # Lay the figure out once, so that the axes do not move from frame to frame.
                    picture.draw_without_rendering()
                    picture.set_layout_engine(None)
                film.grab_frame()
    return len(rows)


def film_page(scene: Scene, trajectory: Trajectory) -> str:
    """Return an HTML page on which the browser draws the mechanism at the time of a slider."""
    # Some rows suffice to find the limits of the drawing.
    rows = np.unique(np.linspace(0, len(trajectory.t) - 1, MAX_FRAMES).astype(int))
    view = view_of(scene, [poses_at(scene, trajectory, row) for row in rows])
    frame = trajectory.to_frame(events=True, interpolated=True)
    t = frame["t"].to_numpy()
    columns = {name: frame[name] for name in (*pose_columns(scene), *force_columns(scene))}
    columns |= load_signs(scene, t)
    name = f"{trajectory.engine} {trajectory.version}"
    block = Columns()
    content = {
        "mechanism": mechanism(scene, view),
        "name": name,
        "columns": {column: block.add(values) for column, values in columns.items()},
        "t": block.add(t, LONG),
        "largest": largest_force(scene, trajectory),
        "block": block.packed(),
    }
    title = f"{trajectory.scene}: {name}, {trajectory.fidelity}"
    body = f"<h1>{escape(title)}</h1>\n{film_controls()}\n" + data('id="film-data"', content)
    scripts = [asset(name) for name in ("data.js", "player.js", "film.js")]
    return document(title, body, [asset("player.css")], scripts)
