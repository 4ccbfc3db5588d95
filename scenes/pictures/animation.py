"""The motion of a mechanism as a film, with the forces on the corners of its sliders."""

from __future__ import annotations

import re
import shutil
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib
import numpy as np
from matplotlib.animation import FFMpegWriter, HTMLWriter, PillowWriter

from stiction.scenes.base_errors import InputError
from stiction.scenes.model import Scene
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.mechanism import canvas, draw_mechanism
from stiction.scenes.pictures.picture import rc
from stiction.scenes.trajectory import Trajectory

ENDINGS = (".gif", ".mp4", ".html")
FRAMES_PER_SECOND = 20
FEWEST, MOST = 40, 150
"""Frames of a film: a short run is shown slower than it is, a long one faster."""
FILM_DPI = 80
_BUTTONS = {"minus": "&minus;", "fast-backward": "&#x23EE;", "step-backward": "&#x2039;", "play fa-flip-horizontal": "&#x25C0;", "pause": "&#x2016;",
            "play": "&#x25B6;", "step-forward": "&#x203A;", "fast-forward": "&#x23ED;", "plus": "+"}
_LIMIT_MB = 500.0  # of a page; matplotlib leaves frames out beyond its own limit


def check_animation(file: Path) -> None:
    """Whether a film of this name can be written here.

    Raises
    ------
    InputError
        If its ending is none of `ENDINGS`, or needs a program that is not installed.
    """
    if file.suffix.lower() not in ENDINGS:
        raise InputError(f"found {str(file)!r}; expected a name that ends in {', '.join(ENDINGS)}")
    if file.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise InputError(f"found {str(file)!r}, which takes the program ffmpeg, which is not installed; expected a name that ends in .gif or .html")


def animate(scene: Scene, trajectory: Trajectory, file: Path, kind: str | None = None) -> int:
    """Write the film; a page (.html) has a time slider and needs no network.

    Parameters
    ----------
    kind
        The ending that the file is to have, where `file` itself has another one.

    Returns
    -------
    int
        The number of frames.

    Raises
    ------
    ValueError
        As `check_animation`.
    """
    ending = kind or file.suffix.lower()
    check_animation(file.with_suffix(ending))
    span = float(trajectory.t[-1] - trajectory.t[0])
    wanted = np.linspace(trajectory.t[0], trajectory.t[-1], int(np.clip(FRAMES_PER_SECOND * span, FEWEST, MOST)))
    rows = np.unique(np.searchsorted(trajectory.t, wanted))
    view = view_of(scene, [poses_at(scene, trajectory, row) for row in rows])
    corners = {name: [trajectory[f"{name}.F{i}"] for i in (1, 2, 3, 4)] for name, guide in scene.guides.items() if guide.length is not None}
    largest = max((float(np.max(force)) for forces in corners.values() for force in forces), default=1.0) or 1.0
    with rc(), matplotlib.rc_context({"animation.embed_limit": _LIMIT_MB}):
        picture, ax = canvas(scene, view)
        picture.set_dpi(FILM_DPI)

        def frame(row: int) -> None:
            ax.clear()
            draw_mechanism(ax, scene, poses_at(scene, trajectory, row), view, float(trajectory.t[row]),
                           {name: [float(force[row]) for force in forces] for name, forces in corners.items()}, largest)
            ax.set_title(f"{trajectory.scene}, {trajectory.engine}: $t$ = {trajectory.t[row]:.3f} s"
                         + (f"; corner forces: longest arrow {largest:.3g} N" if corners else ""), fontsize=8)
            if row == rows[0]:
                picture.draw_without_rendering()
                picture.set_layout_engine(None)  # the axes stay where they are

        writer = {".gif": PillowWriter, ".mp4": FFMpegWriter, ".html": partial(HTMLWriter, embed_frames=True, default_mode="loop")}[ending]
        film = writer(fps=FRAMES_PER_SECOND)
        with TemporaryDirectory(prefix="stiction-") as folder:  # the writers go by the ending of the name
            made = Path(folder) / f"film{ending}"
            with film.saving(picture, made, FILM_DPI):
                for row in rows:
                    frame(row)
                    film.grab_frame()
            if ending == ".html":
                made.write_text(_without_network(made.read_text(encoding="utf-8")), encoding="utf-8")
            shutil.copyfile(made, file)
    return len(rows)


def _without_network(page: str) -> str:
    """matplotlib's page with characters on its buttons instead of a font that it would load."""
    page = re.sub(r"<link[^>]*https?://[^>]*>", "", page)
    return re.sub(r'<i class="fa fa-([\w -]+)"></i>', lambda found: _BUTTONS[found[1]], page)
