"""Truths as folders that others can take along: a scene, the truth's motion as a table, its events; read and written.

Between its rows a motion is interpolated (`stiction.scenes.motion_table`). How far that is off is measured where the
folder is written, and stands in it as part of the uncertainty.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyarrow import csv

from stiction.scenes import FileError, Problem, Scene, catalogue, scene_to_toml
from stiction.scenes.motion_table import interpolated, with_sides
from stiction.scenes.resolved import load_resolved, resolved_text
from stiction.scenes.trajectory import events_frame, events_of
from stiction.scenes.wording import shown
from stiction.truths import Tier, Truth
from stiction.truths.proof.truth import certificate_of

FORMAT, VERSION = "stiction truth", 1
ABOUT, SCENE, MOTION, EVENTS, SUMS = (
    "truth.json",
    "scene.json",
    "truth.parquet",
    "events.csv",
    "SHA256SUMS",
)
INTERVALS, FEWEST, DISTANCE = 1200, 8, 0.02
"""Intervals between the rows of a motion, and of each of its smooth pieces, at least; seconds of one, at most."""
SHARES = (0.28, 0.5, 0.72)
"""Parts of an interval at which its interpolation is measured: where the derivative of a polynomial of degree five is
off most (its position is off by s^3 (1 - s)^3), and splines are."""
SAFETY = 2.0
"""Factor on the measured error of the interpolation."""


class TruthFolderError(FileError):
    """A folder that holds no truth, or one that was changed."""


def write_truth(scene: Scene, truth: Truth, folder: Path) -> dict[str, Any]:
    """Write a truth to a folder that is there and empty; return what `ABOUT` holds."""
    frame = motion_frame(truth)
    t = frame["t"].to_numpy()
    between = np.unique(np.concatenate([t[:-1] + share * np.diff(t) for share in SHARES]))
    true, found = truth(between), interpolated(frame)(between, "after")
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
        "uncertainty between rows": {
            name: SAFETY * float(np.max(np.abs(true[name] - found[name])))
            for name in true
            if name in frame
        },
    }
    for name, text in {
        SCENE: resolved_text(scene),
        "scene.toml": scene_to_toml(scene),
        ABOUT: json.dumps(about, indent=1) + "\n",
    }.items():
        (folder / name).write_text(text, encoding="utf-8")
    scene.draw().write(folder / "scene.svg")
    frame.to_csv(folder / "truth.csv", index=False)
    frame.to_parquet(folder / MOTION, index=False, compression="zstd")
    events_frame(truth.events).to_csv(folder / EVENTS, index=False)
    if (certificate := certificate_of(scene)) is not None and truth.tier_below:
        shutil.copy(certificate, folder / "certificate.json.gz")
    write_sums(folder)
    return about


def is_truth_folder(name: str | Path) -> bool:
    """Return True for a folder that is not the name of a scene of the catalogue."""
    return os.path.isdir(name) and str(name) not in (*catalogue(), *catalogue("hard"))


def read_truth(folder: Path) -> tuple[Scene, Truth]:
    """Read the scene and the truth of a folder; nothing is solved. TruthFolderError with all that is wrong in it."""
    sums, about = folder / SUMS, {}
    listed = (
        set(sums.read_text(encoding="utf-8", errors="replace").splitlines())
        if sums.is_file()
        else set()
    )
    if not (folder / ABOUT).is_file():
        inside = sorted(folder.glob(f"**/{ABOUT}"))
        wrong = [
            Problem(
                ABOUT,
                "no such file",
                "expected the folder of a scene"
                + (f", such as {inside[0].parent}" if inside else ""),
            )
        ]
    elif not (
        wrong := [
            Problem(name, "another file, or none", f"expected the one with the SHA-256 in {SUMS}")
            for name in (ABOUT, SCENE, MOTION, EVENTS)
            if not (folder / name).is_file() or _sum(folder / name, folder) not in listed
        ]
    ):
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        wrong = [
            Problem(key, shown(about.get(key)), f"expected {shown(value)}")
            for key, value in (("format", FORMAT), ("version", VERSION))
            if about.get(key) != value
        ]
    if wrong:
        raise TruthFolderError(str(folder), wrong)
    scene = load_resolved((folder / SCENE).read_text(encoding="utf-8"), str(folder / SCENE))
    uncertainty = {
        name: value + about["uncertainty between rows"].get(name, 0.0)
        for name, value in about["uncertainty"].items()
    }
    events = events_of(csv.read_csv(folder / EVENTS).to_pandas()) if about["events"] else ()
    return scene, Truth(
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


def motion_frame(truth: Truth) -> pd.DataFrame:
    """Return a truth as a table in order of time: rows at equal distances on each smooth piece, two for an event."""
    ends = np.unique([0.0, *(event.time for event in truth.events), truth.t_end])
    distance = min(truth.t_end / INTERVALS, DISTANCE)
    counts = np.maximum(FEWEST, np.ceil(np.diff(ends) / distance)).astype(int)
    inner = [
        np.linspace(begin, end, count + 1)[1:-1]
        for begin, end, count in zip(ends, ends[1:], counts)
    ]
    t = np.setdiff1d(
        np.concatenate([[0.0, truth.t_end], *inner]), [event.time for event in truth.events]
    )
    return with_sides(pd.DataFrame({"t": t, **truth(t)}), truth.events)


def write_sums(folder: Path) -> None:
    """Write `SUMS` of all files in a folder and below it, for ``sha256sum --check``."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / SUMS)
    (folder / SUMS).write_text(
        "".join(f"{_sum(path, folder)}\n" for path in files), encoding="utf-8"
    )


def _sum(path: Path, folder: Path) -> str:
    """The line of a file of the folder."""
    return f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}"
