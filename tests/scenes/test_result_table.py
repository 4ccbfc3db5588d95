"""Tables of results: units, names, signs, both sides of events, and everything that cannot be a result."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from stiction.scenes import InputError, load_scene
from stiction.scenes.result_table import ResultError, parse_map, parse_units, result_table

SCENE = load_scene("slider-bar-case-1")
TWO_GUIDES = load_scene("elliptic-trammel")


def table(**columns: object) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "t": [0.0, 0.1, 0.2],
            **{name.replace("__", "."): values for name, values in columns.items()},
        }
    )


def test_columns_keep_every_digit_through_csv_and_parquet(tmp_path):
    frame = table(slider__x=[1 / 3, np.pi, 1e-300], guide__mode=[0, 1, -1])
    frame.to_csv(tmp_path / "r.csv", index=False)
    frame.to_parquet(tmp_path / "r.parquet")
    for name in ("r.csv", "r.parquet"):
        found = result_table(tmp_path / name, SCENE)
        assert np.array_equal(found.t, frame["t"])
        assert np.array_equal(found.columns["slider.x"], frame["slider.x"])
        assert np.array_equal(found.columns["guide.mode"], frame["guide.mode"])


@pytest.mark.parametrize(
    "text",
    [
        "# t,slider.x\n0,1\n1,2\n",
        "t;slider.x\n0;1\n1;2\n",
        "t\tslider.x\n0\t1\n1\t2\n",
        "\ufefft, slider.x\r\n0, 1\r\n1, 2\r\n",
        "time,slider.x,step\n0,1,0\n1,2,1\n",
    ],
)
def test_usual_ways_to_write_a_table(tmp_path, text):
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = result_table(tmp_path / "r.csv", SCENE)
    assert found.t.tolist() == [0, 1] and found.columns["slider.x"].tolist() == [1, 2]


def test_units_scale_every_column_by_its_dimension():
    frame = table(
        slider__x=[1.0] * 3,
        slider__vx=[1.0] * 3,
        bar__omega=[180.0] * 3,
        motor__effort=[1.0] * 3,
        pin__fx=[1.0] * 3,
        bar__alpha=[180.0] * 3,
    )
    found = result_table(frame.assign(t=1e3 * frame["t"]), SCENE, units=parse_units("mm,deg,ms"))
    assert found.t == pytest.approx([0, 0.1, 0.2])
    expected = {
        "slider.x": 1e-3,
        "slider.vx": 1.0,
        "bar.omega": np.pi * 1e3,
        "motor.effort": 1e-3,
        "pin.fx": 1.0,
        "bar.alpha": np.pi * 1e6,
    }
    assert {name: found.columns[name][0] for name in expected} == pytest.approx(expected)


def test_names_are_mapped_with_either_sign_or_left_out():
    frame = table(
        x1=[1.0, 2.0, 3.0], slidervx=[1.0, 1.0, 1.0], slider__y=["a", "b", "c"], CPU=[1, 2, 3]
    ).rename(columns={"t": "zeit"})
    found = result_table(
        frame, SCENE, parse_map(["zeit=t", "x1=-slider.x", "slider.y=", "slidervx=slider.vx"])
    )
    assert found.columns["slider.x"].tolist() == [-1, -2, -3]
    assert set(found.columns) == {"slider.x", "slider.vx"} and found.left_out == ("slider.y", "CPU")


@pytest.mark.parametrize("name", ["-slider.x", "-t", "-guide.friction"])
def test_only_a_mapped_name_has_a_sign(name):
    """A heading with a minus sign is no column of the scene: its values are not read, and no sign is reversed."""
    frame = table(slider__y=[0.0] * 3).assign(**{name: [1.0, 2.0, 3.0]})
    with pytest.raises(ResultError, match="a name that the scene does not have"):
        result_table(frame, SCENE)
    with pytest.raises(ResultError, match="a name that the scene does not have"):
        result_table(frame.assign(**{"slider.x": 0.0, "guide.friction": 0.0}), SCENE)
    read = result_table(frame, SCENE, parse_map([f"{name}=slider.x"]))
    assert read.columns["slider.x"].tolist() == [1, 2, 3]


@pytest.mark.parametrize("place", [0, 2])
@pytest.mark.parametrize("usual", ["t", "time"])
def test_a_time_that_is_not_mapped_is_left_out(usual, place):
    """The mapped column is the time, wherever the other one stands."""
    frame = pd.DataFrame({"stamp": [0.0, 0.1, 0.2], "slider.x": [1.0, 2.0, 3.0]})
    frame.insert(place, usual, [7.0, 8.0, 9.0])
    found = result_table(frame, SCENE, parse_map(["stamp=t"]))
    assert found.t.tolist() == [0, 0.1, 0.2] and found.left_out == (usual,)


def test_two_columns_that_are_mapped_to_the_time_are_refused():
    frame = pd.DataFrame({"stamp": [0.0, 0.1], "t": [0.0, 0.1], "slider.x": [1.0, 2.0]})
    with pytest.raises(ResultError, match="a second column t"):
        result_table(frame, SCENE, parse_map(["stamp=t", "t=t"]))


def test_equal_times_are_two_sides():
    frame = pd.DataFrame({"t": [0, 0.5, 0.5, 1], "motor.effort": [1.0, 2.0, 3.0, 4.0]})
    found = result_table(frame, SCENE)
    assert found.columns["motor.effort"][found.rows_before].tolist() == [1, 2, 4]
    assert found.columns["motor.effort"][found.rows_after].tolist() == [1, 3, 4]


def test_forces_may_be_open_only_where_several_guides_can_leave_them_open():
    force = [1.0, np.nan, 1.0]
    with pytest.raises(ResultError, match="row 2"):
        result_table(table(guide__friction=force), SCENE)
    guide = next(iter(TWO_GUIDES.guides))
    assert np.isnan(
        result_table(table(**{f"{guide}.friction": force}), TWO_GUIDES).columns[
            f"{guide}.friction"
        ][1]
    )


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (table(slidr__x=[0.0] * 3, slider__y=[0.0] * 3), "slider.x"),
        (table(cart=[0.0] * 3), "cart"),
        (table(slider__x=[0.0, np.nan, 0.0]), "row 2"),
        (table(slider__x=[0.0, np.inf, 0.0]), "inf"),
        (table(slider__x=[0.0, np.inf, 0.0]), "found inf;"),
        (table(slider__x=[0.0, -np.inf, 0.0]), "found -inf;"),
        (table(slider__x=["0", "zero", "0"]), "zero"),
        (table(slider__x=["0", "0,5", "0"]), "point"),
        (table(slider__x=[True, False, True]), "True"),
        (table(slider__x=pd.to_datetime(["2020", "2021", "2022"])), "2020"),
        (table(slider__x=[0.0] * 3).assign(t=[0, 0.2, 0.1]), "row 3"),
        (table(slider__x=[0.0] * 3).assign(t=0.1), "increasing"),
        (table(slider__x=[0.0] * 3).assign(t=[-1, 0, 1]), "-1"),
        (table(slider__x=[0.0] * 3).assign(t=[0, 12000, 24000]), "ms"),
        (table(slider__x=[0.0] * 3).assign(t=[0, 30, 30.1]), "t_end"),
        (pd.DataFrame({"slider.x": [0.0, 1.0]}), "--map MINE=t"),
        (pd.DataFrame({"t": [0.0], "slider.x": [0.0]}), "2"),
        (pd.DataFrame({"t": np.repeat([0.0, 1.0], 10), "slider.x": 0.0}), "digits"),
        (pd.DataFrame(), "columns"),
        ({"t": [0, 1], "slider.x": [0]}, "length"),
        ([1, 2], "list"),
        (b"", "bytes"),
        (pd.DataFrame([[0, 1, 2], [1, 2, 3]], columns=["t", "slider.x", "slider.x"]), "second"),
    ],
)
def test_what_cannot_be_a_result_is_refused(frame, words):
    with pytest.raises(ResultError, match=words):
        result_table(frame, SCENE)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00\xff\xfe\x80" * 99,
        b"t,slider.x\n0,1,2\n1,2,3\n",
        b"t,slider.x\n0,1\n1,2,3\n",
        b"t,slider.x\n0,1\n1\n",
        b"1\n2\n3\n",
        b"\n\n\n",
    ],
)
def test_broken_files_are_refused(tmp_path, content):
    for name in ("r.csv", "r.parquet", "r.txt"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ResultError):
            result_table(tmp_path / name, SCENE)
    for name in (tmp_path, tmp_path / "absent.csv"):
        with pytest.raises(ResultError):
            result_table(name, SCENE)


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_map, ["x1"]),
        (parse_map, ["=slider.x"]),
        (parse_map, [""]),
        (parse_units, "inch"),
        (parse_units, "mm,m"),
        (parse_units, "degree"),
    ],
)
def test_bad_maps_and_units(parse, text):
    with pytest.raises(InputError):
        parse(text)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"x2": "slider.x"}, "x1"),
        ({"x1": "slider.xx"}, "slider.x"),
        ({"x1": "slider.y"}, "second"),
        ({"t": "-t"}, "no other sign"),
    ],
)
def test_maps_of_names_that_are_not_there(mapping, words):
    with pytest.raises(ResultError, match=words):
        result_table(table(slider__y=[0.0] * 3, x1=[0.0] * 3), SCENE, mapping)
