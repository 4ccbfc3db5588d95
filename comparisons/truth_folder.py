"""Truths as folders that others can take along: a scene, the truth's motion as a table, its events; read and written.

Between its rows a motion is interpolated, on each smooth piece by itself: positions by polynomials of degree five that
have the velocities and accelerations of the rows, everything else by cubic splines. How far that is off is measured
where the folder is written, and stands in it as part of the uncertainty.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyarrow import csv
from scipy.interpolate import BPoly, CubicSpline, PPoly

from stiction.comparisons.proof.truth import certificate_of
from stiction.comparisons.truth import Truth
from stiction.comparisons.truth.truth import SIDES, Columns
from stiction.scenes import Event, FileError, Problem, Scene, Trajectory, catalogue, scene_to_toml
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.resolved import load_resolved, resolved_text
from stiction.scenes.trajectory import events_frame
from stiction.scenes.wording import shown

FORMAT, VERSION = "stiction truth", 1
ABOUT, SCENE, MOTION, EVENTS, SUMS = "truth.json", "scene.json", "truth.parquet", "events.csv", "SHA256SUMS"
INTERVALS, FEWEST, DISTANCE = 1200, 8, 0.02
"""Intervals between the rows of a motion, and of each of its smooth pieces, at least; seconds of one, at most."""
SECOND = dict(zip(BODY_COLUMNS[0], BODY_COLUMNS[2]))
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
    true, found = truth(between), columns_of_frame(frame)(between, "after")
    about = {"format": FORMAT, "version": VERSION, "scene": scene.name, "title": scene.title, "source": scene.source,
             "t_end [s]": truth.t_end, "tier": truth.tier, "tier of forces": truth.effort_tier, "note": truth.note,
             "guides": sorted(truth.guides or ()), "events": len(truth.events),
             "uncertainty": {name: float(value) for name, value in truth.uncertainty.items()},
             "uncertainty between rows": {name: SAFETY * float(np.max(np.abs(true[name] - found[name])))
                                          for name in true if name in frame}}
    (folder / SCENE).write_text(resolved_text(scene), encoding="utf-8")
    (folder / "scene.toml").write_text(scene_to_toml(scene), encoding="utf-8")
    scene.draw().write(folder / "scene.svg")
    frame.to_csv(folder / "truth.csv", index=False)
    frame.to_parquet(folder / MOTION, index=False, compression="zstd")
    events_frame(truth.events).to_csv(folder / EVENTS, index=False)
    if (certificate := certificate_of(scene)) is not None and truth.tier_below:
        shutil.copy(certificate, folder / "certificate.json.gz")
    (folder / ABOUT).write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    write_sums(folder)
    return about


def is_truth_folder(name: str | Path) -> bool:
    """Return True for a folder that is not the name of a scene of the catalogue."""
    return os.path.isdir(name) and str(name) not in (*catalogue(), *catalogue("hard"))


def read_truth(folder: Path) -> tuple[Scene, Truth]:
    """Read the scene and the truth of a folder; nothing is solved.

    Raises
    ------
    TruthFolderError
        For a folder of another kind or version, and where a file is not the one that was written.
    """
    text = (folder / SUMS).read_text(encoding="utf-8", errors="replace") if (folder / SUMS).is_file() else ""
    listed = dict(line.partition("  ")[::-2] for line in text.splitlines())
    about: dict[str, Any] = {}
    if not (folder / ABOUT).is_file():
        inside = sorted(path.parent.relative_to(folder).as_posix() for path in folder.glob(f"**/{ABOUT}"))
        wrong = [Problem(ABOUT, "no such file", "expected the folder of a scene"
                         + (f", such as {folder / inside[0]}" if inside else ""))]
    elif not (wrong := [Problem(name, "another file, or none", f"expected the one with the SHA-256 in {SUMS}")
                        for name in (ABOUT, SCENE, MOTION, EVENTS)
                        if not (folder / name).is_file() or listed.get(name) != _sum(folder / name)]):
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        wrong = [Problem(key, shown(about.get(key)), f"expected {shown(value)}")
                 for key, value in (("format", FORMAT), ("version", VERSION)) if about.get(key) != value]
    if wrong:
        raise TruthFolderError(str(folder), wrong)
    scene = load_resolved((folder / SCENE).read_text(encoding="utf-8"), str(folder / SCENE))
    uncertainty = {name: value + about["uncertainty between rows"].get(name, 0.0)
                   for name, value in about["uncertainty"].items()}
    events = tuple(_events(csv.read_csv(folder / EVENTS).to_pylist())) if about["events"] else ()
    return scene, Truth(scene.name, about["tier"], about["t_end [s]"],
                        columns_of_frame(pd.read_parquet(folder / MOTION)), uncertainty, events, None, about["note"],
                        about["tier of forces"] if about["tier of forces"] != about["tier"] else "",
                        frozenset(about["guides"]))


def motion_frame(truth: Truth) -> pd.DataFrame:
    """Return a truth as a table in order of time: rows at equal distances on each smooth piece, two for an event."""
    ends = np.unique([0.0, *(event.time for event in truth.events), truth.t_end])
    distance = min(truth.t_end / INTERVALS, DISTANCE)
    counts = np.maximum(FEWEST, np.ceil(np.diff(ends) / distance)).astype(int)
    inner = [np.linspace(begin, end, count + 1)[1:-1] for begin, end, count in zip(ends, ends[1:], counts)]
    t = np.setdiff1d(np.concatenate([[0.0, truth.t_end], *inner]), [event.time for event in truth.events])
    sides = [{"t": event.time, **side} for event in truth.events for side in (event.before, event.after)]
    frame = pd.concat([pd.DataFrame({"t": t, **truth(t)}), pd.DataFrame(sides)])
    return frame.sort_values("t", kind="stable", ignore_index=True)


def columns_of_frame(frame: pd.DataFrame) -> Columns:
    """Return the columns of a truth between the rows of `motion_frame`; times that occur twice separate its pieces."""
    t = frame["t"].to_numpy()
    edges = [0, *np.flatnonzero(np.diff(t) == 0) + 1, len(t)]
    pieces = [frame.iloc[first:behind] for first, behind in zip(edges, edges[1:]) if t[first] < t[behind - 1]]
    starts = np.array([piece["t"].iloc[0] for piece in pieces])
    curves = [_curves(piece) for piece in pieces]

    def columns(at: np.ndarray, side: str) -> dict[str, np.ndarray]:
        number = np.maximum(np.searchsorted(starts, at, side="right" if side == "after" else "left") - 1, 0)
        found = {name: np.empty(len(at)) for name in curves[0]}
        for piece in np.unique(number):
            here = number == piece
            for name, curve in curves[piece].items():
                found[name][here] = curve(at[here])
        return found

    return columns


def two_sided_frame(run: Trajectory) -> pd.DataFrame:
    """Return `Trajectory.to_frame` with both sides of events.

    At an event of one independent part, the columns of others are interpolated between their own rows.
    """
    if not run.events:
        return run.to_frame()
    names = [name for name, values in run.columns.items() if np.isfinite(values).all()]
    sides = pd.DataFrame([{"t": event.time, **side} for event in run.events for side in (event.before, event.after)],
                         columns=["t", *run.columns])
    groups: dict[tuple[bool, ...], list[str]] = {}
    for name in names:
        groups.setdefault(tuple(name in event.before for event in run.events), []).append(name)
    for has, own in groups.items():
        rows, lacks = sides.loc[np.repeat(has, 2), ["t", *own]], ~np.repeat(np.array(has, dtype=bool), 2)
        if lacks.any():
            known = pd.concat([run.to_frame()[["t", *own]], rows]).sort_values("t", kind="stable", ignore_index=True)
            first = {time: row for row, time in reversed(list(rows["t"].items()))}
            t, columns = sides["t"].to_numpy()[lacks], columns_of_frame(known)
            passed = [first.get(time, len(sides)) < row for row, time in zip(np.flatnonzero(lacks), t)]
            before, after = (columns(t, side) for side in SIDES)
            sides.loc[lacks, own] = np.array([np.where(passed, after[name], before[name]) for name in own]).T
    return pd.concat([run.to_frame(), sides]).sort_values("t", kind="stable", ignore_index=True)


def _curves(piece: pd.DataFrame) -> dict[str, PPoly | BPoly]:
    """A function of time for each column of a smooth piece."""
    t = piece["t"].to_numpy()
    values = {str(name): column.to_numpy(float) for name, column in piece.items() if name != "t"}
    curves: dict[str, PPoly | BPoly] = {
        name: PPoly(column[:1, None], t[[0, -1]]) if name.endswith(".mode") else CubicSpline(t, column)
        for name, column in values.items()}
    rates = {**dict(zip(*BODY_COLUMNS[:2])), "displacement": "slip_velocity"}
    for name, position in values.items():
        owner, _, label = name.rpartition(".")
        if (rate := f"{owner}.{rates.get(label)}") in values:
            second = values.get(f"{owner}.{SECOND.get(label)}", curves[rate](t, 1))
            curves[name] = BPoly.from_derivatives(t, np.stack([position, values[rate], second], axis=1))
            curves[rate] = curves[name].derivative()
    return curves


def _events(rows: Iterable[Mapping[str, Any]]) -> Iterator[Event]:
    for row in rows:
        before, after = ({name.removeprefix(f"{side}."): float(value) for name, value in row.items()
                          if name.startswith(f"{side}.")} for side in ("before", "after"))
        yield Event(float(row["t"]), row["kind"], row["joint"], before, after)


def write_sums(folder: Path) -> None:
    """Write `SUMS` of all files in a folder and below it, for ``sha256sum --check``."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / SUMS)
    lines = [f"{_sum(path)}  {path.relative_to(folder).as_posix()}\n" for path in files]
    (folder / SUMS).write_text("".join(lines), encoding="utf-8")


def _sum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
