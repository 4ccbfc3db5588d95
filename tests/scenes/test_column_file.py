"""Columns in a temporary file are those that were written; tables read in blocks are those that are read at once."""

import numpy as np
import pandas as pd
import pytest

from stiction.scenes import load_scene
from stiction.scenes.column_file import (
    ColumnFile,
    JoinedColumns,
    TransformedColumns,
    compute_in_parts,
    row_slices,
)
from stiction.scenes.result_table import ResultError
from stiction.scenes.result_table import result_table as read

SCENE = load_scene("slider-bar-case-1")


def test_columns_written_in_any_order_are_read_as_they_were():
    rng = np.random.default_rng(1)
    for _ in range(20):
        rows, names = int(rng.integers(1, 500)), [f"c{i}" for i in range(rng.integers(1, 6))]
        expected = {name: rng.standard_normal(rows) for name in names}
        kept = ColumnFile(rows + int(rng.integers(0, 5)))
        pieces = [
            (name, part) for name in names for part in row_slices(rows, int(rng.integers(1, 200)))
        ]
        for place in rng.permutation(len(pieces)):
            name, part = pieces[place]
            kept.write(name, part.start, expected[name][part])
        kept.shorten(rows)
        assert set(kept) == set(names) and all(
            np.array_equal(kept[name], expected[name]) for name in names
        )
        assert not kept[names[0]].flags.writeable
        kept.drop(names[0])
        kept.write("new", 0, expected[names[0]])
        assert names[0] not in kept and np.array_equal(kept["new"], expected[names[0]])
        assert all(np.array_equal(kept[name], expected[name]) for name in names[1:])


def test_views():
    columns = {"a": np.arange(5.0), "b": np.ones(5)}
    assert TransformedColumns(columns, lambda name, values: values[1:])["a"].tolist() == [
        1,
        2,
        3,
        4,
    ]
    joined = JoinedColumns({"a": np.zeros(5)}, columns)
    assert (
        joined["a"].tolist() == [0] * 5
        and list(joined) == ["a", "b"]
        and len(joined) == 2
        and "c" not in joined
    )
    with pytest.raises(KeyError):
        joined["c"]
    made = compute_in_parts(5, 2, lambda part: {"a": columns["a"][part]})
    assert np.array_equal(made["a"], columns["a"]) and isinstance(made, ColumnFile)


@pytest.fixture
def small_blocks(monkeypatch):
    import importlib

    blocks = importlib.import_module("stiction.scenes.table_blocks")
    monkeypatch.setattr(blocks, "BLOCK_SIZE", 64)
    monkeypatch.setattr(blocks, "BLOCK_ROWS", 7)
    module = importlib.import_module("stiction.scenes.result_table")
    monkeypatch.setattr(module, "FILE_THRESHOLD_BYTES", 0)


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_blocks_change_nothing(tmp_path, small_blocks, ends):
    rng = np.random.default_rng(2)
    frame = pd.DataFrame(
        {
            "t": np.linspace(0, 24, 203),
            "slider.x": rng.standard_normal(203),
            "note": "a, b",
            "bar.angle": rng.integers(0, 9, 203),
        }
    )
    (tmp_path / "r.csv").write_bytes(frame.to_csv(index=False).replace("\n", ends).encode())
    frame.to_parquet(tmp_path / "r.parquet")
    frame.set_index("t").to_parquet(tmp_path / "i.parquet")
    shares = []
    for table in (tmp_path / "r.csv", tmp_path / "r.parquet", tmp_path / "i.parquet", frame):
        for spills in (False, True):
            found = read(table, SCENE, spills=spills, tell=shares.append)
            assert isinstance(found.columns, ColumnFile) == spills and found.left_out == ("note",)
            assert np.array_equal(found.t, frame["t"])
            assert all(
                np.array_equal(found.columns[name], frame[name])
                for name in ("slider.x", "bar.angle")
            )
    assert shares.count(1.0) == 8 and all(0 < share <= 1 for share in shares)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("12.0,x", "slider.x, row 151: found 'x'"),
        ("12.0,", "slider.x, row 151: found nothing"),
        ("12.0", "Row #152"),
        ("1.0,1.0", "time, row 151"),
    ],
)
def test_faults_far_in_a_file_have_their_row(tmp_path, small_blocks, damage, words):
    lines = ["t,slider.x", *(f"{t!r},0.25" for t in np.linspace(0, 24, 201).tolist())]
    lines[151] = damage
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(ResultError) as caught:
        read(tmp_path / "r.csv", SCENE, spills=True)
    assert words in " ".join(str(caught.value).split())


@pytest.mark.parametrize(("begin", "count"), [(0, 4), (2, 2), (-1, 1)])
def test_values_beyond_the_rows_of_a_column_are_refused(begin, count):
    """They would be written over the next column."""
    columns = ColumnFile(3)
    columns.write("a", 0, np.zeros(3))
    columns.write("b", 0, np.ones(3))
    with pytest.raises(ValueError, match="a: found values"):
        columns.write("a", begin, np.full(count, 7.0))
    assert columns["b"].tolist() == [1.0, 1.0, 1.0]
