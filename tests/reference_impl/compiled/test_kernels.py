"""Kernels: what they are given as one pointer, and how they call each other."""

import gc
import pickle
import subprocess
import sys
from textwrap import dedent

import numpy as np
import pytest

from stiction.reference_impl.compiled.bundle import Bundle, Bundles, Integers, Reals, Table, at
from stiction.reference_impl.compiled.kernel import bound, kernel
from stiction.reference_impl.multibody.mechanism import FRICTION, Mechanism, workspace
from stiction.scenes import load_scene


class Pair(Bundle):
    factor: float
    count: int
    table: Table
    values: Reals
    places: Integers
    parts: Bundles


def pair(**changes):
    return Pair(
        **{
            "factor": 2.0,
            "count": 3,
            "table": np.arange(6.0).reshape(2, 3),
            "values": np.ones(4),
            "places": np.array([1, 0]),
            "parts": (),
            **changes,
        }
    )


@kernel
def transpose_times(b, out):
    """out[j] = count + factor sum_i table[i, j], written through the bundle's own array as well."""
    for j in range(b.table.shape[1]):
        out[j] = b.count
        for i in range(len(b.table)):
            out[j] += b.factor * b.table[i, j]
        b.values[j] = b.table[-1, j]


@kernel
def sum_of_parts(b):
    total = 0.0
    for k in range(len(b.parts)):
        total += at(b.parts[k], b).factor
    return total


class Owner(Bundle):
    pair: Pair
    share: float


@kernel
def share_of(owner: Owner) -> float:
    owner.pair.values[0] = 7.0
    return owner.share * owner.pair.factor


@kernel
def halved(b: Pair, least: float = 0.25) -> float:
    return max(0.5 * b.factor, least)


@kernel
def calls_halved(b, x):
    return halved(b) + x * halved(b, 10.0)


@kernel
def returns_something_else(b: Pair) -> int:
    return b.factor


@kernel
def calls_what_cannot_be_compiled(b):
    return returns_something_else(b)


class TestBundle:
    def test_a_kernel_sees_arrays_and_numbers(self):
        b, out = pair(), np.zeros(3)
        transpose_times(b, out)
        assert out.tolist() == (3 + 2 * b.table.sum(axis=0)).tolist()
        assert b.values.tolist() == [3.0, 4.0, 5.0, 1.0]

    def test_bundles_in_a_bundle(self):
        assert sum_of_parts(pair(parts=(pair(factor=1.5), pair(factor=4.0)))) == 5.5
        assert sum_of_parts(pair()) == 0.0

    def test_a_bundle_in_a_bundle(self):
        b = pair(factor=4.0)
        owner = Owner(pair=b, share=0.25)
        assert share_of(owner) == 1.0 and b.values[0] == 7.0
        with pytest.raises(TypeError, match="Owner.pair: found Owner; expected a bundle .*Pair"):
            Owner(pair=owner, share=0.25)

    @pytest.mark.parametrize("size", [0, 1, 5])
    def test_zeros_are_arrays_of_their_own(self, size):
        b, out = (
            Pair.zeros(factor=2.0, count=3, table=(size, 3), values=4, places=size, parts=()),
            np.zeros(3),
        )
        assert [part.tolist() for part in (b.table, b.values, b.places)] == [
            [[0.0] * 3] * size,
            [0.0] * 4,
            [0] * size,
        ]
        b.table[:], b.places[:] = 1.0, -1
        if size:
            transpose_times(b, out)
            assert out.tolist() == [3.0 + 2.0 * size] * 3
        assert b.values.tolist() == [1.0 if size else 0.0] * 3 + [0.0]
        with pytest.raises(TypeError, match="Pair: found factor; expected factor, count, table"):
            Pair.zeros(factor=2.0)

    def test_arrays_of_records(self):
        arrays = Mechanism(load_scene("slider-bar-case-1")).arrays
        assert (
            arrays.friction.dtype == FRICTION
            and friction_of(arrays) == arrays.friction[0]["mu"] > 0
        )

    @pytest.mark.parametrize(
        "wrong",
        [
            {"table": np.zeros(3)},
            {"table": np.zeros((2, 3), dtype=np.float32)},
            {"table": np.zeros((3, 2)).T},
            {"values": [1.0, 2.0]},
            {"places": np.zeros(2)},
            {"values": np.ones(8)[::2]},
            {"values": np.frombuffer(bytes(32))},
        ],
        ids=lambda wrong: next(iter(wrong)),
    )
    def test_an_array_that_is_not_what_its_field_says_is_refused(self, wrong):
        with pytest.raises(
            TypeError, match=rf"Pair.{next(iter(wrong))}: found .* expected a contiguous"
        ):
            pair(**wrong)

    def test_missing_and_unknown_fields_are_refused(self):
        with pytest.raises(TypeError, match="expected factor, count, table"):
            Pair(factor=1.0)
        with pytest.raises(TypeError, match="found factor, .* other; expected"):
            pair(other=1)

    def test_a_field_cannot_be_put_in_place_of_another_unseen_by_kernels(self):
        with pytest.raises(AttributeError, match="Pair.table"):
            pair().table = np.zeros((2, 3))

    def test_a_copy_has_its_own_memory(self):
        b = pair(parts=(pair(factor=7.0),))
        copied, out = pickle.loads(pickle.dumps(b)), np.zeros(3)
        b.table[:] = np.nan
        transpose_times(copied, out)
        assert np.all(np.isfinite(out)) and sum_of_parts(copied) == 7.0

    def test_replaced_keeps_the_other_arrays(self):
        b = pair()
        other = b.replaced(factor=5.0)
        assert other.table is b.table and (b.factor, other.factor) == (2.0, 5.0)
        with pytest.raises(TypeError, match="Pair: found .*share; expected factor"):
            b.replaced(share=1.0)


@kernel
def friction_of(m):
    return m.friction[0].mu


class TestLinked:
    def test_called_from_kernels_and_from_python_with_its_defaults(self):
        b = pair(factor=8.0)
        assert calls_halved(b, 1.0) == 4.0 + 10.0
        assert halved(b) == 4.0 and halved(b, least=9) == 9.0 and halved(pair(factor=0.1)) == 0.25

    def test_an_argument_of_another_type_is_refused(self):
        with pytest.raises(TypeError):
            halved(workspace(Mechanism(load_scene("pendulum")).arrays))

    def test_bound_to_its_bundle_it_takes_numbers_alone(self):
        halve = bound(halved, pair(factor=8.0))
        assert halve(0.25) == 4.0 and halve(9) == 9.0
        with pytest.raises(TypeError):
            halve(None)
        with pytest.raises(TypeError, match="halved: found Owner; expected a bundle .*Pair"):
            bound(halved, Owner(pair=pair(), share=0.25))

    def test_what_does_not_return_what_it_says_is_an_error_at_the_call(self, capfd):
        with pytest.raises(TypeError, match="float64 returned; expected int64, as annotated"):
            returns_something_else(pair())
        with pytest.raises(RuntimeError, match="returns_something_else: it could not be compiled"):
            calls_what_cannot_be_compiled(pair())
        assert "expected int64, as annotated" in capfd.readouterr().err
        assert gc.isenabled()  # it is not while a kernel is compiled

    @pytest.mark.parametrize(
        ("scene", "friction"), [("pendulum", False), ("slider-bar-case-1", True)]
    )
    def test_only_what_a_scene_calls_for_is_compiled_and_all_of_it_ahead(self, scene, friction):
        code = dedent(f"""
            from stiction.engines import load_engine
            from stiction.reference_impl.compiled.compiling_ahead import event_kernels
            from stiction.reference_impl.compiled.kernel import linked_kernels
            from stiction.reference_impl.friction import frozen_mode, hlcp, mode_choice, uniqueness
            from stiction.reference_impl.integration import right_hand_side
            from stiction.scenes import load_scene
            run = load_engine("reference").simulate(load_scene("{scene}"), t_end=24.0)
            assert run.termination == "end"
            called, ahead = {{kernel.name for kernel in linked_kernels() if kernel.is_linked}}, {{kernel.name for kernel in event_kernels({friction}, {not friction})}}
            assert called == ahead, called ^ ahead
            print(right_hand_side.right_hand_side.is_linked, hlcp.solve.is_linked, mode_choice.choose_mode.is_linked,
                  frozen_mode.solve_cells.is_linked, uniqueness._respond_banded.is_linked)
            """)
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == ["True", str(friction), str(friction), "False", "False"]
