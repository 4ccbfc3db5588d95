"""A run folder that describes itself by the Data Package standard."""

import json

import frictionless
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stiction.comparisons.bench.quantities import QUANTITIES, quantity_of
from stiction.reports.run_folder.data_package import (
    DATA_PACKAGE,
    PARAMETERS,
    _described,
    columns_of_motion,
    columns_of_table,
    metadata,
)
from stiction.scenes import load_scene
from stiction.scenes.columns import unit_of


@pytest.fixture(scope="module")
def package(report_folder):
    return json.loads((report_folder / DATA_PACKAGE).read_text(encoding="utf-8"))


def test_it_obeys_the_standard_and_so_do_the_tables(report_folder, package):
    """By the standard's own library: the descriptor, and every cell of every CSV file against its schema."""
    tables = [resource for resource in package["resources"] if resource["format"] == "csv"]
    whole = frictionless.Package.from_descriptor(package, basepath=str(report_folder))
    assert whole.resource_names == [resource["name"] for resource in package["resources"]]
    assert not list(frictionless.Package.metadata_validate(package))
    report = frictionless.Package.from_descriptor(
        package | {"resources": tables}, basepath=str(report_folder)
    ).validate()
    assert report.valid, report.flatten(["type", "message"])[:5]
    assert len(report.tasks) == len(tables) > 5


def test_a_wrong_cell_is_found(report_folder, package, tmp_path):
    """The check can fail: a word in a column of numbers."""
    table = pd.read_csv(report_folder / "data" / "accuracy.csv", dtype=object)
    table.loc[0, "position_error"] = "small"
    table.to_csv(tmp_path / "accuracy.csv", index=False)
    [resource] = [one for one in package["resources"] if one["path"] == "data/accuracy.csv"]
    broken = frictionless.Package.from_descriptor(
        package | {"resources": [resource | {"path": "accuracy.csv"}]}, basepath=str(tmp_path)
    )
    assert not broken.validate().valid


def test_every_file_of_data_and_every_column_is_described(report_folder, package):
    files = {
        path.relative_to(report_folder).as_posix()
        for path in (report_folder / "data").rglob("*")
        if path.is_file()
    }
    listed = {resource["path"]: resource for resource in package["resources"]}
    assert set(listed) == files
    for path in files:
        if path.endswith(".csv"):
            columns = list(pd.read_csv(report_folder / path, nrows=0))
            assert [field["name"] for field in listed[path]["schema"]["fields"]] == columns
            name = path.removeprefix("data/").removesuffix(".csv")
            unknown = [
                column
                for column in columns
                if name != PARAMETERS
                and quantity_of(column) == type(quantity_of(column))(column, column)
                and column not in QUANTITIES
            ]
            assert not unknown, (path, unknown)


def test_units_are_in_the_metadata_of_parquet(report_folder):
    fields = pq.read_schema(report_folder / "data" / "accuracy.parquet")
    assert (
        fields.field("position_error").metadata[b"unit"] == b"m"
        and fields.field("cpu_time").metadata[b"unit"] == b"s"
    )
    motion = next((report_folder / "data" / "trajectories").glob("*.parquet"))
    for field in pq.read_schema(motion):
        # the scene of the run tells whether an effort is a torque
        expected = unit_of(field.name, load_scene("slider-bar-case-1"))
        assert (field.metadata or {}).get(b"unit", b"").decode() == expected


def test_uncertainties_are_quantities_of_the_same_unit():
    for quantity in QUANTITIES.values():
        if quantity.uncertainty:
            assert QUANTITIES[quantity.uncertainty].unit == quantity.unit
        assert (
            quantity.key.replace("F0", "f0").replace("_N", "_n").islower()
            and " " not in quantity.key
        )
    assert [one.label for one in columns_of_table(PARAMETERS, ["scene", "F0"])] == ["scene", "F0"]


def test_columns_of_pins_have_their_own_units():
    """A pin's friction is a torque, and its slip a rate; a file of a run says so, and the package reads it there."""
    scene = load_scene("slider-crank-dry-pins")
    names = ["t", "pin.friction", "pin.slip_velocity", "guide.slip_velocity", "motor.effort"]
    units = [quantity.unit for quantity in columns_of_motion(names, scene)]
    assert units == ["s", "N m", "rad/s", "m/s", "N m"]
    frame = pd.DataFrame({name: [0.0] for name in names})
    fields = [
        pa.field(quantity.key, pa.float64(), metadata=metadata(quantity))
        for quantity in columns_of_motion(frame, scene)
    ]
    assert [_described(field).unit for field in fields] == units
    assert [_described(field) for field in fields][1].description.startswith("torque")
