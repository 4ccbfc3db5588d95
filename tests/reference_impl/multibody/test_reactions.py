"""Reactions from a motion: those that made it, whatever of them is told, and nothing of one instant in another."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines import load_engine
from stiction.reference_impl.multibody import reactions
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import InputError, load_scene

STATE = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))


def motion(name, t_end):
    scene = load_scene(name)
    run = load_engine("reference").simulate(
        scene, rtol=1e-10, t_end=t_end, output_step=0.05, stabilization="projection"
    )
    return (
        scene,
        run,
        [
            np.column_stack([run[f"{body}.{name}"] for body in scene.bodies for name in names])
            for names in STATE
        ],
    )


@pytest.mark.parametrize("name", ["slider-bar-case-1", "four-bar", "elliptic-trammel"])
def test_the_forces_of_a_run_are_recovered_from_its_motion(compiled, name):
    scene, run, state = motion(name, 3.0)
    told = (
        {f"{guide}.friction": run[f"{guide}.friction"] for guide in scene.frictional_guides}
        if name == "elliptic-trammel"
        else {}
    )
    found = recover_columns(
        scene, run.t, *state, told
    )  # in the trammel the motion does not tell frictions from reactions
    forces = [
        column
        for column in found
        if column in run
        and column.rpartition(".")[2]
        in ("fx", "fy", "normal_force", "moment", "friction", "effort")
    ]
    assert len(forces) >= 4
    for column in forces:  # accelerations of 1 m/s^2 in rounding, masses of kilograms
        np.testing.assert_allclose(found[column], run[column], atol=1e-9)


def test_what_is_told_of_some_instants_is_kept_there_and_each_instant_stands_alone(
    compiled, monkeypatch
):
    scene, run, state = motion("elliptic-trammel", 1.0)
    guides = list(scene.frictional_guides)
    told = {
        f"{guide}.friction": np.where(np.arange(len(run.t)) % (place + 2) == 0, 1.0 + place, np.nan)
        for place, guide in enumerate(guides)
    }
    found = recover_columns(scene, run.t, *state, told)
    for column, values in told.items():
        known = ~np.isnan(values)
        assert 0 < known.sum() < len(known) and np.array_equal(found[column][known], values[known])
    monkeypatch.setattr(reactions, "_MAX_NUMBERS", 1)  # one instant at a time
    alone = recover_columns(scene, run.t, *state, told)
    for column, values in found.items():
        np.testing.assert_allclose(alone[column], values, atol=1e-12)


AT_REST = {
    "hard/trammel-at-rest": {
        "pin-x.fx",
        "pin-x.fy",
        "pin-y.fx",
        "pin-y.fy",
        *(
            f"guide-{axis}.{label}"
            for axis in "xy"
            for label in (
                "normal_force",
                "friction",
                "F1",
                "F2",
                "F3",
                "F4",
                "friction_lower",
                "friction_upper",
            )
        ),
    },
    "hard/three-guides-at-rest": {
        f"guide-{k}.{label}"
        for k in (1, 2, 3)
        for label in ("friction", "F1", "F2", "F3", "F4", "friction_lower", "friction_upper")
    },
    "hard/three-stop-at-once": {
        "pin-left.fx",
        "pin-right.fx",
        "guide-left.friction",
        "guide-right.friction",
    },
}


def at_rest(name):
    """The start of a scene, its bodies without velocity and acceleration, at three instants."""
    scene = load_scene(name)
    q = np.tile(
        [[*body.position, body.angle] for body in scene.bodies.values()], (3, 1, 1)
    ).reshape(3, -1)
    return scene, np.arange(3.0), q, np.zeros_like(q), np.zeros_like(q)


@pytest.mark.parametrize("name", AT_REST)
def test_forces_that_guides_at_rest_leave_open_are_nan_and_no_others(name):
    """The left and right slider are held by two frictions on one freedom; the third slider alone holds itself. Normal forces of guides on a line share equally."""
    scene, *motion = at_rest(name)
    assert {
        column
        for column, values in recover_columns(scene, *motion).items()
        if np.isnan(values).any()
    } == AT_REST[name]


@pytest.mark.parametrize("name", AT_REST)
def test_all_is_determined_where_all_frictions_but_one_are_known(name):
    scene, *motion = at_rest(name)
    guides = list(scene.frictional_guides)
    known = {f"{guide}.friction": np.array([0.25, np.nan, 0.25]) for guide in guides[1:]}
    found = recover_columns(scene, *motion, known)
    for column, values in found.items():
        assert np.isfinite(values[[0, 2]]).all() and np.isnan(values[1]) == (
            column in AT_REST[name]
        )
    assert all(found[column][0] == 0.25 for column in known)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_what_is_left_open_does_not_depend_on_the_unit_of_length(unit):
    """The trammel in other units: the same columns."""
    scene, t, q, v, a = at_rest("hard/trammel-at-rest")
    q = q * np.tile([unit, unit, 1.0], q.shape[1] // 3)
    assert {
        column
        for column, values in recover_columns(scaled(scene, Units(length=unit)), t, q, v, a).items()
        if np.isnan(values).any()
    } == AT_REST["hard/trammel-at-rest"]


LAYOUTS = {
    "Fortran order": np.asfortranarray,
    "transposed": lambda values: np.ascontiguousarray(values.T).T,
    "strided": lambda values: np.repeat(values, 2, axis=0)[::2],
    "reversed": lambda values: values[::-1].copy()[::-1],
    "read-only": lambda values: read_only(values),
    "list": lambda values: values.tolist(),
    "tuple": lambda values: tuple(map(tuple, values)) if values.ndim == 2 else tuple(values),
    "big-endian": lambda values: values.astype(">f8"),
    "float32": lambda values: values.astype(np.float32),
    "integer": lambda values: values.astype(int),
    "small integer": lambda values: values.astype(np.int8),
    "pandas": lambda values: (
        pd.DataFrame(values)
        if values.ndim == 2
        else pd.Series(values, index=range(5, 5 + len(values)))
    ),
}


def read_only(values):
    values = values.copy()
    values.flags.writeable = False
    return values


@given(layouts=st.tuples(*[st.sampled_from(sorted(LAYOUTS))] * 5), numbers=st.data())
def test_any_array_that_numpy_takes_gives_the_columns_of_its_numbers(layouts, numbers):
    """Whole numbers, which all types hold: a slider-bar that need not meet its constraints, with a friction that is given."""
    scene = load_scene("slider-bar-case-1")
    table = numbers.draw(arrays(float, (3, 4, 6), elements=st.integers(-3, 3)))
    plain = [np.arange(4.0), *table]
    friction = np.array([0.0, 1.0, 2.0, -1.0])
    expected = recover_columns(scene, *plain, {"guide.friction": friction})
    before = [LAYOUTS[layout](values) for layout, values in zip(layouts, (*plain, friction))]
    found = recover_columns(scene, *before[:4], {"guide.friction": before[4]})
    assert found.keys() == expected.keys()
    for column, values in expected.items():
        np.testing.assert_array_equal(found[column], values, err_msg=column)
        assert found[column].dtype == values.dtype and found[column].shape == (4,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"t": np.zeros((3, 1))},
            r"t: found shape \(3, 1\); expected finite numbers of shape \(n,\)",
        ),
        (
            {"q": np.zeros((6, 3))},
            r"q: found shape \(6, 3\); expected finite numbers of shape \(3, 6\), its transpose",
        ),
        (
            {"q": np.zeros((4, 6))},
            r"q: found shape \(4, 6\); expected finite numbers of shape \(3, 6\)$",
        ),
        ({"v": np.zeros(6)}, r"v: found shape \(6,\); expected finite numbers of shape \(3, 6\)"),
        ({"a": np.zeros((3, 5))}, r"a: found shape \(3, 5\); expected numbers of shape \(3, 6\)"),
        (
            {"v": np.full((3, 6), np.nan)},
            r"v: found nan at \[0, 0\]; expected finite numbers of shape \(3, 6\)",
        ),
        (
            {"q": np.where(np.arange(18).reshape(3, 6) == 8, np.inf, 0.0)},
            r"q: found inf at \[1, 2\]",
        ),
        ({"t": [0, np.nan, 2]}, r"t: found nan at \[1\]"),
        ({"a": np.full((3, 6), -np.inf)}, r"a: found -inf at \[0, 0\]; expected numbers of shape"),
        (
            {"q": [[0.0], [1.0, 2.0], [3.0]]},
            r"q: found .*inhomogeneous.*; expected finite numbers of shape \(3, 6\)",
        ),
        ({"q": np.full((3, 6), "1")}, r"q: found an array of <U1; expected finite numbers"),
        (
            {"q": np.zeros((3, 6), dtype=complex)},
            r"q: found an array of complex128; expected finite numbers",
        ),
        (
            {"reactions": {"motor.effort": [1.0, 2.0]}},
            r"reactions\['motor.effort'\]: found shape \(2,\); expected numbers of shape \(3,\)",
        ),
        (
            {"reactions": {"guide.friction": 1.0}},
            r"reactions\['guide.friction'\]: found shape \(\); expected numbers of shape \(3,\)",
        ),
        (
            {"reactions": {"guide.friction": [0.0, np.inf, 0.0]}},
            r"reactions\['guide.friction'\]: found inf at \[1\]",
        ),
    ],
)
def test_what_is_no_motion_of_the_scene_is_refused_by_name(change, words):
    given_arguments = {
        "t": np.arange(3.0),
        **{name: np.zeros((3, 6)) for name in "qva"},
        "reactions": {},
    } | change
    with pytest.raises(InputError, match=words):
        recover_columns(load_scene("slider-bar-case-1"), *given_arguments.values())


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("moter.effort", "did you mean 'motor.effort'"),
        ("guide.normalforce", "did you mean 'guide.normal_force'"),
        ("guide.F5", "did you mean 'guide.F"),
        ("slider.x", "pin.fx"),
        ("slider.ax", "pin.fx"),
        ("", "pin.fx"),
    ],
)
def test_names_that_are_not_those_of_reactions_are_refused(name, expected):
    """A misspelt column would otherwise be lost, and a state contradict the motion."""
    scene, *motion = at_rest("slider-bar-case-1")
    with pytest.raises(InputError, match="reactions: found .*; expected names among") as error:
        recover_columns(scene, *motion, {name: np.zeros(3)})
    assert expected in str(error.value)


def test_accelerations_that_are_not_known_leave_the_motion_known():
    scene, t, q, v, a = at_rest("slider-bar-case-1")
    a[1] = np.nan
    found = recover_columns(scene, t, q, v, a)
    for column in ("guide.normal_force", "guide.friction", "motor.effort", "pin.fx"):
        assert np.array_equal(np.isnan(found[column]), [False, True, False])
    assert (
        np.isfinite(found["slider.x"]).all()
        and np.isfinite(found["guide.slip_velocity"]).all()
        and np.isfinite(found["drift.velocity"]).all()
    )
