"""Making of the friction benchmark: ``python -m stiction.reports.benchmark.making FOLDER``.

The set that stiction contains (`stiction.comparisons.judge.benchmark`) is frozen. This module documents how its tables
were made, and can make those of another version. It writes everything that is computed: scenes, descriptions, truths,
the tables of all scenes, ``KEYS.md``, ``datapackage.json`` and checksums. The rule book, the README, the citation and
the runner templates are written by hand; they must already be in the folder.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.judge.benchmark import EVENTS, SCENES, TABLE, UNCERTAINTIES
from stiction.comparisons.judge.prescribed_coordinates import is_prescribed
from stiction.comparisons.judge.truth_folder import EVENTS as EVENTS_FILE
from stiction.comparisons.judge.truth_folder import Sampling, read_truth, write_sums, write_truth
from stiction.comparisons.measures.accuracy import size_of
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.reports.benchmark.description import description_of
from stiction.reports.benchmark.keys import keys_page
from stiction.reports.benchmark.package import write_benchmark_package
from stiction.reports.run_folder.data import write_frame
from stiction.reports.run_folder.data_package import columns_of_table
from stiction.scenes import Event, Scene, load_scene, vary
from stiction.scenes.columns import BODY_COLUMNS, unit_of
from stiction.scenes.resolved import load_resolved, resolved_scene
from stiction.truths import Tier, Truth
from stiction.truths.enumerated_truth import enumerated_truth


@dataclass(frozen=True)
class Member:
    """A scene of the benchmark.

    Attributes
    ----------
    name : str
        Name in the benchmark.
    base : str
        Name of the scene of the catalogue that it is made from.
    title : str
        Title, if the name is not that of the base.
    changes : Mapping
        Parameters and values in which it differs from the base.
    """

    name: str
    base: str
    title: str = ""
    changes: Mapping[str, float] = field(default_factory=dict)


MEMBERS = (
    Member("slider-bar-case-1", "slider-bar-case-1"),
    Member("slider-bar-case-2", "slider-bar-case-2"),
    Member("slider-bar-case-3", "slider-bar-case-3"),
    Member("slider-bar-case-1-mus-equals-mu", "slider-bar-case-1-mus-equals-mu"),
    Member("coulomb-oscillator", "coulomb-oscillator", changes={"t_end": 60}),
    Member("mass-on-belt", "mass-on-belt"),
    Member("pendulum-dry-pin", "pendulum-dry-pin"),
    Member("block-on-incline", "block-on-incline"),
    Member("vertical-slider", "vertical-slider"),
    Member("hold-level", "hold-level", changes={"part": 0.9}),
    Member("hold-bar", "hold-bar", changes={"part": 0.9}),
    Member(
        "ramp-level",
        "hold-level",
        "Block on a level surface under a growing pull",
        {"part": 0.8, "ramp": 0.25, "t_end": 1.5},
    ),
    Member(
        "ramp-moment",
        "hold-moment",
        "Slider under a moment and a growing pull",
        {"part": 0.8, "ramp": 0.25, "t_end": 1.5},
    ),
    Member(
        "stop-level",
        "hold-level",
        "Block on a level surface that comes to rest",
        {"part": 0.5, "v0": 0.05, "t_end": 0.5},
    ),
    Member(
        "stop-incline",
        "hold-incline",
        "Block on an incline that comes to rest",
        {"part": 0.5, "v0": 0.05, "t_end": 0.5},
    ),
    Member("slider-crank", "slider-crank"),
    Member("slider-crank-dry-pins", "slider-crank-dry-pins"),
    Member("elliptic-trammel", "elliptic-trammel"),
    Member("slider-on-moving-guide", "slider-on-moving-guide"),
    Member("four-bar", "four-bar", changes={"t_end": 5}),
)
"""Scenes of version 1: mechanisms with friction, and two without it, which show whether a solver is right apart from
its friction."""
KEYS = "KEYS.md"
"""File that describes the keys of the scenes."""
LABELS = (
    *(label for labels in BODY_COLUMNS for label in labels),
    "displacement",
    "slip_velocity",
    "normal_force",
    "friction",
    "mode",
    "effort",
)
"""Columns of elements that are part of the truths. The others follow from them."""
DECIMALS = 10
"""Decimals of all numbers of the truths, in SI units."""
ROUNDING = 0.5 * 10.0**-DECIMALS
"""Largest error by rounding to `DECIMALS`."""
BOUND_OF_SIZE = 1e-3
"""Bound of the position error, as a fraction of the size of the mechanism: a method of first order with a thousand
steps has such an error, and a wrong sign, unit or law has one that is a thousand times larger."""
BOUND_OF_MOTION = 1e-2
"""Bound of the position error, as a fraction of the largest displacement of a body. It is the smaller one where the
mechanism moves by less than a tenth of its size; the motion would otherwise be hidden in the bound."""
EFFORT_BOUND_OF_LARGEST = 1e-2
"""Bound of the mean error of an effort, as a fraction of the largest effort: ten times that of positions, because an
effort contains accelerations and jumps. Only where drives prescribe the motion, and positions show nothing."""
REST_OF_FASTEST = 1e-3
"""Speed below which a joint is at rest, as a fraction of its largest speed in the truth."""
POSITION_TOLERANCE = 1e-5
"""Largest error of positions by interpolation between the rows of a truth, as a fraction of the bound."""
INTERVALS_S = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""Distances of rows that are tried, s, the largest first."""
MIN_PIECE_INTERVALS = 4
"""Least number of intervals between two events."""
STEPS_S = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Distances of the rows of a result that may be required, s. The last is required if a stick phase is still shorter;
such phases are not judged in tables that do not resolve them."""
SAMPLES = 2001
"""Number of instants at which the largest values of columns are taken; they are stated with one digit."""
MIN_SAMPLES = 100
"""Least number of rows of a result, however long the stick phases are."""
SAMPLES_PER_STICK = 5
"""Number of rows in the shortest stick phase: two more than a judgement needs."""


def scene_of(member: Member) -> Scene:
    """Return the scene of a member, under its name and title in the benchmark."""
    scene = vary(load_scene(member.base), dict(member.changes))
    if member.name == member.base:
        return scene
    resolved = resolved_scene(scene)
    resolved["name"] = member.name
    resolved["scene"]["title"] = member.title
    return load_resolved(json.dumps(resolved), member.name)


def truth_of(scene: Scene) -> Truth:
    """Return the best truth of a scene that is independent of the reference implementation."""
    truth = ground_truth(scene)
    return enumerated_truth(scene) if truth.tier == Tier.OWN_RUN else truth


def rounded_truth(truth: Truth) -> Truth:
    """Return a truth that has only the columns of `LABELS`, rounded to `DECIMALS`."""

    def rounded_values(values: Mapping[str, Any]) -> dict[str, Any]:
        # Adding zero turns a negative zero into zero.
        return {
            name: np.round(value, DECIMALS) + 0.0
            for name, value in values.items()
            if name.rpartition(".")[2] in LABELS
        }

    # At the rounded time of an event, the columns are those on the sides of the event itself.
    exact_time = {float(np.round(event.time, DECIMALS)): event.time for event in truth.events}

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        exact_t = np.array([exact_time.get(time, time) for time in t.tolist()])
        return rounded_values(truth(exact_t, side))

    events = tuple(
        Event(
            float(np.round(event.time, DECIMALS)),
            event.kind,
            event.joint,
            {name: float(value) for name, value in rounded_values(event.before).items()},
            {name: float(value) for name, value in rounded_values(event.after).items()},
        )
        for event in truth.events
    )
    uncertainty = {
        name: value + ROUNDING
        for name, value in truth.uncertainty.items()
        if name == "event time" or name.rpartition(".")[2] in LABELS
    }
    return replace(truth, columns=columns, events=events, uncertainty=uncertainty)


def position_bound(scene: Scene, truth: Truth) -> float:
    """Return the bound of the position error of a scene, m, with one digit."""
    bound = BOUND_OF_SIZE * size_of(scene)
    displacement = largest_displacement(scene, truth)
    # Of a mechanism that rests all the time, only the size is known.
    if displacement > ROUNDING:
        bound = min(bound, BOUND_OF_MOTION * displacement)
    return float(f"{bound:.1g}")


def largest_displacement(scene: Scene, truth: Truth) -> float:
    """Return the largest distance of the centre of a body from its initial position, m."""
    columns = truth(np.linspace(0.0, truth.t_end, SAMPLES))
    distances = []
    for body in scene.bodies:
        # A truth may lack coordinates that do not change.
        coordinates = [columns[name] for name in (f"{body}.x", f"{body}.y") if name in columns]
        distances.append(max(np.sqrt(sum((x - x[0]) ** 2 for x in coordinates))))
    return float(max(distances))


def effort_bound(scene: Scene, truth: Truth) -> float | None:
    """Return the bound of the mean error of efforts, N m or N, with one digit; None if forces show in the motion."""
    if not scene.drives or not is_prescribed(scene, truth):
        return None
    columns = truth(np.linspace(0.0, truth.t_end, SAMPLES))
    largest = max(float(np.max(np.abs(columns[f"{drive}.effort"]))) for drive in scene.drives)
    return float(f"{EFFORT_BOUND_OF_LARGEST * largest:.1g}")


def rest_speed(scene: Scene, truth: Truth) -> float | None:
    """Return the speed below which the joints of a scene are at rest, m/s or rad/s, with one digit.

    If all joints rest for the whole time, it is the speed at which a body moves by the bound of the position error.
    None for a scene without friction.
    """
    if not scene.frictional_joints:
        return None
    columns = truth(np.linspace(0.0, truth.t_end, SAMPLES))
    speeds = [
        float(np.max(np.abs(columns[f"{joint}.slip_velocity"])))
        for joint in scene.frictional_joints
    ]
    fastest = max(speeds)
    creep = position_bound(scene, truth) / scene.t_end
    speed = REST_OF_FASTEST * fastest if fastest > creep else creep
    return float(f"{speed:.1g}")


def max_step(scene: Scene, truth: Truth) -> float:
    """Return the largest distance of the rows of a result, s, which resolves the stick phases of the truth."""
    longest = truth.t_end / MIN_SAMPLES
    initial = truth(0.0)
    for joint in scene.frictional_joints:
        events = [event for event in truth.events if event.joint == joint]
        starts_at_rest = bool(initial[f"{joint}.mode"][0] == 0)
        for begin, end in stick_intervals(events, 0.0, truth.t_end, starts_at_rest):
            longest = min(longest, (end - begin) / SAMPLES_PER_STICK)
    return next((step for step in STEPS_S if step <= longest), STEPS_S[-1])


def sampling_of(scene: Scene, truth: Truth) -> Sampling:
    """Return the widest sampling whose interpolation error of positions is within `POSITION_TOLERANCE` of the bound."""
    for interval in INTERVALS_S:
        sampling = Sampling(interval, MIN_PIECE_INTERVALS)
        with tempfile.TemporaryDirectory() as name:
            about = write_truth(scene, truth, Path(name), sampling)
        errors = [
            error
            for column, error in about["uncertainty between rows"].items()
            if column.rpartition(".")[2] in BODY_COLUMNS[0]
        ]
        # The interpolation of rounded values cannot be better than twice the rounding.
        if max(errors) <= max(POSITION_TOLERANCE * position_bound(scene, truth), 8 * ROUNDING):
            return sampling
    raise ValueError(f"{scene.name}: no interval of {INTERVALS_S} is short enough")


@dataclass(frozen=True)
class Written:
    """What the tables of all scenes contain about one scene.

    Attributes
    ----------
    row : dict
        Its row of the table of scenes.
    uncertainties, events : DataFrame
        Its rows of the other tables.
    """

    row: dict[str, Any]
    uncertainties: pd.DataFrame
    events: pd.DataFrame


def write_member(member: Member, folder: Path) -> Written:
    """Write a scene with its truth to a subfolder."""
    scene = scene_of(member)
    full_truth = truth_of(scene)
    truth = rounded_truth(full_truth)
    place = folder / SCENES / member.name
    place.mkdir(parents=True)
    about = write_truth(scene, truth, place, sampling_of(scene, truth))
    # Certificates and drawings are larger than the truths.
    for name in ("certificate.json.gz", "scene.svg"):
        (place / name).unlink(missing_ok=True)
    row = {
        "scene": member.name,
        "title": scene.title,
        "t_end": scene.t_end,
        "tier": about["tier"],
        "events": about["events"],
        "mechanism_size": size_of(scene),
        "position_bound": position_bound(scene, full_truth),
        "effort_bound": effort_bound(scene, full_truth),
        "rest_speed": rest_speed(scene, full_truth),
        "max_step": max_step(scene, full_truth),
        "event_time_uncertainty": truth.uncertainty["event time"] if truth.events else None,
    }
    (place / "description.txt").write_text(description_of(scene, row), encoding="utf-8")
    if not truth.events:
        (place / EVENTS_FILE).write_text("t,kind,joint\n", encoding="utf-8")
    write_sums(place)
    # The checksums and the format are right if the folder can be read.
    read_truth(place)
    between = about["uncertainty between rows"]
    uncertainties = pd.DataFrame(
        [
            # "1" is the unit of the contact modes, which have none.
            (member.name, column, unit_of(column, scene) or "1", value, between.get(column, 0.0))
            for column, value in about["uncertainty"].items()
            if column != "event time"
        ],
        columns=["scene", "column", "unit", "uncertainty", "uncertainty_between_rows"],
    )
    events = pd.DataFrame(
        [(member.name, event.time, event.kind, event.joint) for event in truth.events],
        columns=["scene", "t", "kind", "joint"],
    )
    return Written(row, uncertainties, events)


def write_set(folder: Path) -> None:
    """Write everything that is computed to a folder that contains the hand-written files."""
    members = []
    for member in MEMBERS:
        members.append(write_member(member, folder))
        print(member.name, flush=True)
    tables = {
        TABLE: pd.DataFrame([member.row for member in members]),
        UNCERTAINTIES: pd.concat([member.uncertainties for member in members]),
        EVENTS: pd.concat([member.events for member in members if len(member.events)]),
    }
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
        quantities = columns_of_table(name, list(table))
        write_frame(table.reset_index(drop=True), folder / f"{name}.parquet", quantities)
    page = keys_page(scene_of(member) for member in MEMBERS)
    (folder / KEYS).write_text(page, encoding="utf-8")
    write_benchmark_package(folder)
    write_sums(folder)


if __name__ == "__main__":
    write_set(Path(sys.argv[1]))
