"""The motion of a mechanism as a film, with the forces on the corners of its sliders."""

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
FRAMES_PER_SECOND = 20
FEWEST, MOST = 40, 150
"""Frames of a film: a short run is shown slower than it is, a long one faster."""
FILM_DPI = 80


def check_animation(file: Path) -> None:
    """Raise InputError for a name whose ending is none of `ENDINGS`, or needs a program that is not installed."""
    if file.suffix.lower() not in ENDINGS:
        raise InputError(f"found {str(file)!r}; expected a name that ends in {', '.join(ENDINGS)}")
    if file.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise InputError(
            f"found {str(file)!r}, but the program ffmpeg, which writes such files, is not installed; "
            "expected a name that ends in .gif or .html"
        )


def animate(scene: Scene, trajectory: Trajectory, file: Path) -> int:
    """Write the film, and return the number of its frames; errors as of `check_animation`.

    It has frames, or is a page (.html) with a time slider and every output time that needs no network.
    """
    check_animation(file)
    if file.suffix.lower() == ".html":
        file.write_text(film_page(scene, trajectory), encoding="utf-8")
        return len(trajectory.t)
    first, last = trajectory.t[[0, -1]]
    frames = int(np.clip(FRAMES_PER_SECOND * (last - first), FEWEST, MOST))
    rows = np.unique(np.searchsorted(trajectory.t, np.linspace(first, last, frames)))
    view = view_of(scene, [poses_at(scene, trajectory, row) for row in rows])
    corners, largest = force_columns(scene), largest_force(scene, trajectory)
    scale = f"; corner forces: longest arrow {largest:.3g} N" if corners else ""
    film = (PillowWriter if file.suffix.lower() == ".gif" else FFMpegWriter)(fps=FRAMES_PER_SECOND)
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
                    picture.draw_without_rendering()
                    picture.set_layout_engine(None)  # the axes stay where they are
                film.grab_frame()
    return len(rows)


def film_page(scene: Scene, trajectory: Trajectory) -> str:
    """Make a page with the mechanism, drawn by the browser at the time that its slider shows."""
    rows = np.unique(np.linspace(0, len(trajectory.t) - 1, MOST).astype(int))
    view = view_of(scene, [poses_at(scene, trajectory, row) for row in rows])
    frame, block = trajectory.to_frame(events=True, interpolated=True), Columns()
    t, name = frame["t"].to_numpy(), f"{trajectory.engine} {trajectory.version}"
    columns = {
        column: frame[column] for column in (*pose_columns(scene), *force_columns(scene))
    } | load_signs(scene, t)
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
