"""Outcomes that are packed come back bit by bit, and trajectories take less than half the space."""

import pickle

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.bench.packed_outcomes import NotAnOutcome, pack, unpack
from stiction.engines import Outcome, load_engine
from stiction.scenes import load_scene

SPECIAL = np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, -1.7976931348623157e308, 1.0])
QUIET_AND_SIGNALLING = np.array(
    [0x7FF8000000000001, 0x7FF0000000000001, 0xFFFFFFFFFFFFFFFF], dtype=np.uint64
).view(float)


def test_a_trajectory_comes_back_bit_by_bit_in_less_than_half_the_space():
    run = load_engine("reference").simulate(
        load_scene("slider-bar-case-1"), t_end=24.0, output_step=2e-3
    )
    outcome = Outcome("run", "ok", run, log="words", wall_s=0.5, cpu_s=0.25)
    packed = pack(outcome)
    found = unpack(packed)
    assert len(packed) < 0.5 * len(pickle.dumps(outcome))
    assert (found.label, found.status, found.log, found.wall_s, found.cpu_s) == (
        "run",
        "ok",
        "words",
        0.5,
        0.25,
    )
    assert (found.value.events, found.value.settings, found.value.cost) == (
        run.events,
        run.settings,
        run.cost,
    )
    assert found.value.t.tobytes() == run.t.tobytes() and list(found.value.columns) == list(
        run.columns
    )
    for name, column in run.columns.items():
        assert (
            found.value[name].tobytes() == column.tobytes()
            and found.value[name].flags.writeable == column.flags.writeable
        )


@pytest.mark.parametrize(
    "array",
    [
        SPECIAL,
        QUIET_AND_SIGNALLING,
        np.zeros(0),
        np.zeros((0, 3)),
        np.arange(7, dtype=np.uint8),
        np.arange(13, dtype=np.float32),
        np.array([True, False, True]),
        np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        np.arange(20.0)[::3],
        np.array(3.5),
        np.array([2**63 - 1, -(2**63), 0, -1]),
        np.array([1 + 2j, -0.0j]),
        np.array(["a", "longer"]),
        np.array([None, "b"], dtype=object),
    ],
)
def test_arrays_of_any_kind_come_back_bit_by_bit(array):
    found = unpack(pack(Outcome("array", "ok", array))).value
    assert found.dtype == array.dtype and found.shape == array.shape
    if array.dtype == object:
        assert found.tolist() == array.tolist()
    else:
        assert found.tobytes() == array.tobytes()


def test_random_bytes_come_back():
    random = np.random.default_rng(20)
    for _ in range(300):
        kind = random.choice(["u1", "f4", "f8", "i8"])
        array = np.frombuffer(
            random.bytes(int(random.integers(0, 60)) * np.dtype(kind).itemsize), kind
        )
        found = unpack(pack(Outcome("random", "ok", array))).value
        assert found.dtype == array.dtype and found.tobytes() == array.tobytes()


def test_what_is_no_array_comes_back():
    table = pd.DataFrame({"a": [1.0, np.nan], "b": ["x", None], "c": [1, 2]})
    pd.testing.assert_frame_equal(unpack(pack(Outcome("table", "ok", table))).value, table)
    for outcome in (
        Outcome("failed", "failed", reason="gave up", bug=True),
        Outcome("row", "ok", {"F0": 3.0, "status": "ok"}),
    ):
        assert unpack(pack(outcome)) == outcome


def test_what_is_damaged_or_of_the_earlier_format_is_told():
    outcome = Outcome("run", "ok", np.linspace(0.0, 1.0, 1000))
    packed = pack(outcome)
    with pytest.raises(NotAnOutcome):
        unpack(pickle.dumps(outcome))
    for damaged in (
        b"",
        packed[:5],
        packed[:15],
        packed[:-10],
        packed[:40] + bytes(20) + packed[60:],
    ):
        with pytest.raises(NotAnOutcome):
            unpack(damaged)


def test_every_flipped_bit_is_found():
    packed = pack(Outcome("run", "ok", np.sin(np.linspace(0.0, 1.0, 200))))
    random = np.random.default_rng(21)
    for place in random.integers(0, 8 * len(packed), 2000).tolist():
        damaged = bytearray(packed)
        damaged[place // 8] ^= 1 << place % 8
        with pytest.raises(NotAnOutcome):
            unpack(bytes(damaged))
