"""Write and read a truth as a folder for other programs: its scene, its motion as a table, and its events.

Between the rows a motion is interpolated (`stiction.scenes.motion_table`). The error of the interpolation is measured
when the folder is written. The folder states it as a part of the uncertainty.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyarrow import csv

from stiction.scenes import FileError, Problem, Scene, catalogue
from stiction.scenes.motion_table import interpolated, with_sides
from stiction.scenes.resolved import load_resolved, resolved_text
from stiction.scenes.trajectory import Event, events_frame, events_of
from stiction.scenes.wording import shown
from stiction.truths import Tier, Truth
from stiction.truths.proof.truth import certificate_of

FORMAT = "stiction truth"
"""Value of the key ``format`` in `ABOUT`, which identifies such a folder."""
VERSION = 1
"""Version of the format; a folder of another version is not read."""
ABOUT = "truth.json"
"""File with the origin of a truth and its uncertainties."""
SCENE = "scene.json"
"""File of the resolved scene."""
MOTION = "truth.parquet"
"""File of the motion."""
EVENTS = "events.csv"
"""File of the events."""
SUMS = "SHA256SUMS"
"""File of the checksums of all other files."""
MIN_INTERVALS = 1200
"""Least number of intervals between the rows of a motion, unless a `Sampling` is given."""
MAX_INTERVAL_S = 0.02
"""Largest interval between two rows, s, unless a `Sampling` is given."""
ERROR_PLACES = (0.28, 0.5, 0.72)
"""Fractions of an interval at which the error of the interpolation is measured. The error of a polynomial of degree
five for the position has the shape s^3 (1 - s)^3, which is largest at 0.5. Its derivative, the error of the velocity,
is largest at 0.5 -+ 0.5 / sqrt(5), about 0.28 and 0.72. The error of a cubic spline, s^2 (1 - s)^2, is largest at
0.5."""
SAFETY = 2.0
"""Factor on the measured error of the interpolation."""


@dataclass(frozen=True)
class Sampling:
    """Distances of the rows of a motion, which are equal on each smooth piece between two events.

    Attributes
    ----------
    max_interval_s : float
        Largest interval between two rows, s.
    min_piece_intervals : int
        Least number of intervals in each piece, however short it is.
    """

    max_interval_s: float
    min_piece_intervals: int = 8


class TruthFolderError(FileError):
    """Raised if a folder does not contain a truth, or if its files were changed."""


def write_truth(
    scene: Scene, truth: Truth, folder: Path, sampling: Sampling | None = None
) -> dict[str, Any]:
    """Write a truth to an existing empty folder; return the content of `ABOUT`.

    The rows are as far apart as `sampling` allows, or as far as `motion_frame` chooses.
    """
    frame = motion_frame(truth, sampling)
    about = {
        "format": FORMAT,
        "version": VERSION,
        "scene": scene.name,
        "title": scene.title,
        "source": scene.source,
        "t_end [s]": truth.t_end,
        "tier": truth.tier,
        "tier of forces": truth.effort_tier,
        "note": truth.note,
        "guides": sorted(truth.guides or ()),
        "events": len(truth.events),
        "uncertainty": {name: float(value) for name, value in truth.uncertainty.items()},
        "uncertainty between rows": _interpolation_errors(truth, frame),
    }
    texts = {
        SCENE: resolved_text(scene),
        "scene.toml": scene.to_toml(),
        ABOUT: json.dumps(about, indent=1) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    scene.draw().write(folder / "scene.svg")
    frame.to_csv(folder / "truth.csv", index=False)
    frame.to_parquet(folder / MOTION, index=False, compression="zstd")
    events_frame(truth.events).to_csv(folder / EVENTS, index=False)
    certificate = certificate_of(scene)
    if certificate is not None and truth.tier_below:
        shutil.copy(certificate, folder / "certificate.json.gz")
    write_sums(folder)
    return about


def _interpolation_errors(truth: Truth, frame: pd.DataFrame) -> dict[str, float]:
    """Return for each column the largest error between the rows of a motion, times `SAFETY`."""
    rows = frame["t"].to_numpy()
    t = np.unique(np.concatenate([rows[:-1] + place * np.diff(rows) for place in ERROR_PLACES]))
    true = truth(t)
    interpolation = interpolated(frame)(t, "after")
    return {
        name: SAFETY * float(np.max(np.abs(true[name] - interpolation[name])))
        for name in true
        if name in frame
    }


def is_truth_folder(name: str | Path) -> bool:
    """Return True if a name is the path of a folder, and not also the name of a scene of the catalogue."""
    # The path of an empty name would be the working folder.
    if not str(name) or str(name) in (*catalogue(), *catalogue("hard")):
        return False
    return Path(name).is_dir()


def read_truth(folder: Path) -> tuple[Scene, Truth]:
    """Read the scene and the truth of a folder, without solving anything.

    Raises
    ------
    TruthFolderError
        If files are absent or were changed, or if the folder has another format. The error lists all problems.
    """
    problems = _file_problems(folder)
    if problems:
        raise TruthFolderError(str(folder), problems)
    about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    problems = _format_problems(about)
    if problems:
        raise TruthFolderError(str(folder), problems)
    scene = load_resolved((folder / SCENE).read_text(encoding="utf-8"), str(folder / SCENE))
    return scene, _truth_of(scene, about, folder)


def _file_problems(folder: Path) -> list[Problem]:
    """Return a problem for each file of a folder that is absent or does not have its checksum."""
    if not (folder / ABOUT).is_file():
        expected = "expected the folder of a scene"
        # The folder may be that of a whole data set, with a folder for each scene.
        inside = sorted(folder.glob(f"**/{ABOUT}"))
        if inside:
            expected += f", such as {inside[0].parent}"
        return [Problem(ABOUT, "no such file", expected)]
    checksum_lines: set[str] = set()
    if (folder / SUMS).is_file():
        text = (folder / SUMS).read_text(encoding="utf-8", errors="replace")
        checksum_lines.update(text.splitlines())
    problems = []
    for name in (ABOUT, SCENE, MOTION, EVENTS):
        path = folder / name
        if not path.is_file() or _checksum_line(path, folder) not in checksum_lines:
            problems.append(
                Problem(
                    name,
                    "another file, or none",
                    f"expected the one with the SHA-256 in {SUMS}",
                )
            )
    return problems


def _format_problems(about: Mapping[str, Any]) -> list[Problem]:
    """Return a problem for a wrong format, and one for a wrong version of it."""
    expected_values = {"format": FORMAT, "version": VERSION}
    return [
        Problem(key, shown(about.get(key)), f"expected {shown(expected)}")
        for key, expected in expected_values.items()
        if about.get(key) != expected
    ]


def _truth_of(scene: Scene, about: Mapping[str, Any], folder: Path) -> Truth:
    """Return the truth of a folder whose files have been checked."""
    # The uncertainty of the rows and that of the interpolation between them add up.
    between = about["uncertainty between rows"]
    uncertainty = {
        name: value + between.get(name, 0.0) for name, value in about["uncertainty"].items()
    }
    events: tuple[Event, ...] = ()
    if about["events"]:
        events = events_of(csv.read_csv(folder / EVENTS).to_pandas())
    return Truth(
        scene.name,
        Tier(about["tier"]),
        about["t_end [s]"],
        interpolated(pd.read_parquet(folder / MOTION)),
        uncertainty,
        events,
        note=about["note"],
        tier_below=Tier(about["tier of forces"]),
        guides=frozenset(about["guides"]),
    )


def motion_frame(truth: Truth, sampling: Sampling | None = None) -> pd.DataFrame:
    """Return a truth as a table in order of time.

    Rows are at equal distances on each smooth piece. Each event has two rows, before and after it.
    """
    if sampling is None:
        sampling = Sampling(min(truth.t_end / MIN_INTERVALS, MAX_INTERVAL_S))
    event_times = [event.time for event in truth.events]
    ends = np.unique([0.0, *event_times, truth.t_end])
    counts = np.ceil(np.diff(ends) / sampling.max_interval_s).astype(int)
    counts = np.maximum(sampling.min_piece_intervals, counts)
    times = [np.array([0.0, truth.t_end])]
    for begin, end, count in zip(ends, ends[1:], counts):
        times.append(np.linspace(begin, end, count + 1)[1:-1])
    # `with_sides` adds the rows of the events.
    t = np.setdiff1d(np.concatenate(times), event_times)
    return with_sides(pd.DataFrame({"t": t, **truth(t)}), truth.events)


def write_sums(folder: Path) -> None:
    """Write `SUMS` for all files in a folder and below it, as ``sha256sum --check`` reads them."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / SUMS)
    lines = [f"{_checksum_line(path, folder)}\n" for path in files]
    (folder / SUMS).write_text("".join(lines), encoding="utf-8")


def _checksum_line(path: Path, folder: Path) -> str:
    """Return the line of `SUMS` for a file of the folder: its SHA-256 and its path in the folder."""
    checksum = hashlib.sha256(path.read_bytes()).hexdigest()
    return f"{checksum}  {path.relative_to(folder).as_posix()}"
