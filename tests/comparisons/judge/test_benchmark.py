"""The frozen benchmark: its bytes never change, and its truths are those that are computed today."""

import hashlib
import json

import frictionless
import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction.comparisons.judge.benchmark import FOLDER, NAME, benchmark_scenes, copy_benchmark
from stiction.comparisons.judge.truth_folder import read_truth
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.reports.benchmark.description import description_of
from stiction.reports.benchmark.keys import keys_page
from stiction.reports.benchmark.making import (
    KEYS,
    MEMBERS,
    effort_bound,
    max_step,
    position_bound,
    rest_speed,
    scene_of,
)
from stiction.scenes.columns import columns_of
from stiction.scenes.resolved import resolved_text
from stiction.truths import Tier
from stiction.truths.enumerated_truth import enumerated_truth

CHECKSUM = "b6056de6f2a32905b0cde74df63c5f98d4bca2d5c73d09386efb4273863fc06b"
"""SHA-256 of the file with the checksums of all other files of version 1; it must never change."""
NOT_LISTED = {"SHA256SUMS"}
INDEPENDENT = {Tier.PROVEN, Tier.CLOSED_FORM, Tier.HIGH_PRECISION}


def test_version_1_never_changes():
    sums = FOLDER / "SHA256SUMS"
    assert hashlib.sha256(sums.read_bytes()).hexdigest() == CHECKSUM
    listed = {}
    for line in sums.read_text().splitlines():
        checksum, name = line.split("  ")
        listed[name] = checksum
    files = {path.relative_to(FOLDER).as_posix(): path for path in FOLDER.rglob("*")}
    computed = {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in files.items()
        if path.is_file() and name not in NOT_LISTED
    }
    assert computed == listed


def test_the_set_is_small_and_complete():
    files = [path for path in FOLDER.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 3e6
    assert [scene.name for scene in benchmark_scenes()] == [member.name for member in MEMBERS]
    assert len(MEMBERS) == 20
    for scene in benchmark_scenes():
        names = {path.name for path in scene.folder.iterdir()}
        expected = {"scene.json", "description.txt", "truth.csv", "truth.parquet", "events.csv"}
        assert expected <= names


@pytest.mark.parametrize("member", MEMBERS, ids=[member.name for member in MEMBERS])
def test_truths_agree_with_new_ones(compiled, member):
    [stated] = [scene for scene in benchmark_scenes() if scene.name == member.name]
    scene, frozen = read_truth(stated.folder)
    assert resolved_text(scene) == resolved_text(scene_of(member))
    assert scene.name == member.name
    assert frozen.tier in INDEPENDENT
    # Where the truth of version 1 is an enumerated motion, this one is a run of the reference.
    new = ground_truth(scene)
    t = np.random.default_rng(1).uniform(0.0, scene.t_end, 300)
    # Near an event, the two truths may be on different sides of it.
    for event in frozen.events:
        t = t[np.abs(t - event.time) > 1e-9]
    stored, computed = frozen(t), new(t)
    assert stored.keys() <= set(columns_of(scene))
    for name, values in stored.items():
        uncertainty = frozen.uncertainty[name] + new.uncertainty.get(name, 0.0)
        assert np.max(np.abs(values - computed[name])) <= uncertainty, name
    kinds = [(event.kind, event.joint) for event in frozen.events]
    times = np.array([event.time for event in frozen.events])
    same = [event for event in new.events if (event.kind, event.joint) in set(kinds)]
    assert [(event.kind, event.joint) for event in same] == kinds
    if len(times):
        error = np.max(np.abs(times - [event.time for event in same]))
        assert error <= frozen.uncertainty["event time"] + new.uncertainty["event time"]

    # The bounds follow from the rules.
    assert position_bound(scene, new) == stated.position_bound
    assert effort_bound(scene, new) == stated.effort_bound
    assert rest_speed(scene, new) == stated.rest_speed
    assert max_step(scene, new) == stated.max_step


def test_csv_and_parquet_are_the_same():
    files = [path for path in FOLDER.rglob("*.parquet")]
    assert len(files) == 23
    for file in files:
        pd.testing.assert_frame_equal(
            pd.read_csv(file.with_suffix(".csv")), pd.read_parquet(file), check_dtype=False
        )


def test_data_package():
    report = frictionless.validate(FOLDER / "datapackage.json")
    assert report.valid, report.flatten(["name", "type", "message"])
    package = frictionless.Package(FOLDER / "datapackage.json")
    paths = {resource.path for resource in package.resources}
    tables = [path for path in FOLDER.rglob("*") if path.suffix in (".csv", ".parquet")]
    assert paths == {path.relative_to(FOLDER).as_posix() for path in tables}
    truth = package.get_resource("scenes-slider-bar-case-1-truth.csv")
    units = {field.name: field.to_descriptor().get("unit") for field in truth.schema.fields}
    assert units["slider.vx"] == "m/s" and units["motor.effort"] == "N m"


def test_descriptions_contain_the_numbers():
    for scene in benchmark_scenes():
        described, _ = read_truth(scene.folder)
        text = " ".join((scene.folder / "description.txt").read_text().split())
        for name, body in described.bodies.items():
            start = text.index(f"{name}: mass ")
            numbers = [body.mass, body.inertia, *body.position, body.angle, *body.velocity]
            for number in numbers:
                written = f"{number:g}" if float(f"{number:g}") == number else repr(number)
                assert written in text[start : start + 400]
        elements = [*described.joints, *described.drives, *described.springs, *described.forces]
        assert all(name in text for name in elements)


def test_texts_are_those_that_are_made_today():
    table = pd.read_csv(FOLDER / "scenes.csv").astype(object)
    rows = table.where(table.notna(), None).set_index("scene", drop=False)
    scenes = {scene.name: read_truth(scene.folder)[0] for scene in benchmark_scenes()}
    for scene in benchmark_scenes():
        text = description_of(scenes[scene.name], rows.loc[scene.name].to_dict())
        assert (scene.folder / "description.txt").read_text() == text
    assert (FOLDER / KEYS).read_text() == keys_page(scenes.values())


def all_keys(value, laws):
    """Yield the keys of a part of a resolved scene, without the names of elements."""
    for key, inner in value.items():
        yield key
        if key in ("bodies", "joints", "drives", "springs", "forces") and isinstance(inner, dict):
            for element in inner.values():
                yield from all_keys(element, laws)
        elif key == "law":
            laws.add(inner["type"])
            yield from all_keys(inner, laws)


def test_all_keys_of_the_scenes_are_described():
    text = (FOLDER / KEYS).read_text()
    laws = set()
    for scene in benchmark_scenes():
        resolved = json.loads((scene.folder / "scene.json").read_text())
        for key in all_keys(resolved["scene"], laws):
            assert f"`{key}`" in text, key
    assert laws == {"constant", "linear", "sine"}
    assert all(f'`"type": "{law}"`' in text for law in laws)
    assert "`offset + amplitude sin(frequency t + phase)`" in text


@pytest.mark.parametrize("name", ["ramp-moment", "ramp-level", "stop-incline", "block-on-incline"])
def test_friction_law_of_the_descriptions(name):
    """One body on a fixed guide: T is minus the moment of the loads, and friction follows from N(c, d)."""
    [stated] = [scene for scene in benchmark_scenes() if scene.name == name]
    scene, truth = read_truth(stated.folder)
    [guide] = scene.guides.values()
    [(slider, body)] = scene.bodies.items()
    t = np.linspace(0.0, scene.t_end, 400)
    columns = truth(t)
    # The sum of weight and loads in ground axes, and the moment of the loads about the centre of mass.
    force = np.outer(np.ones(len(t)), np.array(scene.gravity or (0.0, 0.0)) * body.mass)
    moment = np.zeros(len(t))
    cosine, sine = np.cos(guide.angle), np.sin(guide.angle)
    for load in scene.forces.values():
        law = load.law
        size = law.value if law.type == "constant" else law.offset + law.rate * t
        vector = np.outer(size * np.ones(len(t)), load.direction)
        x, y = load.point
        arm_x, arm_y = cosine * x - sine * y, sine * x + cosine * y
        force += vector
        moment += arm_x * vector[:, 1] - arm_y * vector[:, 0]
    along = np.array(guide.direction)
    normal = -force @ np.array([-along[1], along[0]])
    zero = np.zeros(len(t))
    acceleration = np.stack([columns.get(f"{slider}.{key}", zero) for key in ("ax", "ay")], 1)
    friction = (body.mass * acceleration - force) @ along
    turning, mode = -moment, columns["guide.mode"]

    def load_of_corners(coefficient, direction):
        lever = (guide.width or 0.0) / 2 * coefficient * direction * normal
        return np.maximum(np.abs(normal), 2 / guide.length * np.abs(turning + lever))

    slips = mode != 0
    slipping = -guide.mu * mode * load_of_corners(guide.mu, mode)
    assert slips.any()
    np.testing.assert_allclose(friction[slips], slipping[slips], atol=1e-7)
    direction = -np.sign(friction)
    limit = guide.static_coefficient * load_of_corners(guide.static_coefficient, direction)
    assert (np.abs(friction[~slips]) <= limit[~slips] + 1e-7).all()


def test_command(tmp_path):
    target = tmp_path / "benchmark"
    invoke("dataset", target, exit_code=0)
    copied = {path.relative_to(target) for path in target.rglob("*") if path.is_file()}
    original = {path.relative_to(FOLDER) for path in FOLDER.rglob("*") if path.is_file()}
    assert {str(path) for path in copied - original} == {"provenance.json"}
    assert all((target / path).read_bytes() == (FOLDER / path).read_bytes() for path in original)
    # A second call replaces the copy, unless something was added.
    invoke("dataset", target, exit_code=0)
    (target / "mine.csv").write_text("t\n")
    invoke("dataset", target, exit_code=2)
    scene = target / "scenes" / "hold-level"
    result = invoke("judge", scene, scene / "truth.csv", exit_code=0)
    assert NAME.startswith("friction-benchmark") and "Stick phases found: 1 of 1." in result.stdout


def test_copy_reads_like_the_original(tmp_path):
    copy_benchmark(tmp_path)
    scene, truth = read_truth(tmp_path / "scenes" / "mass-on-belt")
    assert scene.name == "mass-on-belt" and truth.tier == Tier.PROVEN


@pytest.mark.parametrize("name", ["slider-bar-case-1", "mass-on-belt", "vertical-slider"])
def test_enumerated_truths_agree_with_others(compiled, name):
    [member] = [member for member in MEMBERS if member.name == name]
    scene = scene_of(member)
    enumerated, other = (
        enumerated_truth(scene, 6.0 if scene.t_end > 6 else None),
        ground_truth(scene),
    )
    t = np.linspace(0.0, enumerated.t_end, 101)
    found, known = enumerated(t), other(t)
    for event in other.events:
        is_apart = np.abs(t - event.time) > 1e-6
        t = t[is_apart]
        found = {column: values[is_apart] for column, values in found.items()}
        known = {column: values[is_apart] for column, values in known.items()}
    common = [column for column in found if column in known]
    assert len(common) >= 6
    for column in common:
        error = np.max(np.abs(found[column] - known[column]))
        assert error <= enumerated.uncertainty[column] + other.uncertainty[column], column
    known_events = [
        event for event in other.events if event.kind != "corner" and event.time < enumerated.t_end
    ]
    assert [event.kind for event in enumerated.events] == [event.kind for event in known_events]
    for event, known_event in zip(enumerated.events, known_events):
        mode = f"{event.joint}.mode"
        assert event.before[mode] == known_event.before[mode]
        assert event.after[mode] == known_event.after[mode]
