"""Rows of four-bars through their flat positions (IFToMM A02), at any tolerance, against the closed form."""

from itertools import product

import numpy as np
import pytest
from reference_checks import simulate

from stiction.engines.reference.engine import _linear_algebra
from stiction.reference_impl.multibody import subsystems
from stiction.reference_impl.multibody.kinematics import constraints_at
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.reference_impl.multibody.singular_positions import (
    lengths,
    remove_nearly_dependent,
    singular_rows,
)
from stiction.reference_impl.multibody.subsystems import simulate_parts
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths import four_bar_truth

FLOOR = 3e-9
"""Metres. A coordinate is rounded to 1e-16 m; some 1e-2 rad from a flat position, where a step begins or ends, that is 1e-12 m/s across
the motion, a stage a hundred times nearer has it as 1e-8 m/s^2, and there are nine passages."""

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


def four_bars(n):
    """IFToMM A02 with n loops: n + 1 uprights and n couplers, all 1 m, 1 kg and uniform, 10 s; `four_bar_truth` is its motion.

    One freedom; with all bars horizontal, which happens again and again, n more.
    """
    tables = {
        "title": f"Four-bar mechanism, {n} loops",
        "t_end": 10,
        "gravity": [0, -9.81],
        "stabilization": {"method": "projection"},
        "bodies": {},
        "joints": {},
    }
    bodies, joints, ends = tables["bodies"], tables["joints"], ([-0.5, 0], [0.5, 0])
    for k in range(n + 1):
        bodies[f"upright-{k}"] = {
            "mass": 1,
            "inertia": 1 / 12,
            "position": [k, 0.5],
            "angle": np.pi / 2,
            "velocity": [0.5, 0],
            "angular_velocity": -1,
        }
        joints[f"foot-{k}"] = {
            "type": "revolute",
            "bodies": [f"upright-{k}", "ground"],
            "points": [ends[0], [k, 0]],
        }
    for k in range(1, n + 1):
        bodies[f"coupler-{k}"] = {
            "mass": 1,
            "inertia": 1 / 12,
            "position": [k - 0.5, 1],
            "velocity": [1, 0],
        }
        for name, own, upright in (("left", ends[0], k - 1), ("right", ends[1], k)):
            joints[f"{name}-{k}"] = {
                "type": "revolute",
                "bodies": [f"coupler-{k}", f"upright-{upright}"],
                "points": [own, ends[1]],
            }
    return scene_from_dict(tables, f"four-bars-{n}")


def worst_tip(loops: int, rtol: float) -> float:
    """Distance of the centres of all uprights from the truth at 10 s."""
    scene = four_bars(loops)
    run, true = (
        simulate(scene, rtol=rtol, output_step=10.0),
        four_bar_truth(scene)(np.array([10.0])),
    )
    assert run.termination == "end"
    return max(
        abs(run[column][-1] - true[column][0])
        for k in range(loops + 1)
        for column in (f"upright-{k}.x", f"upright-{k}.y")
    )


@pytest.mark.parametrize(
    "loops, rtol",
    [
        *product((1, 2, 5), TOLERANCES),
        (10, 1e-6),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in product((10, 20, 40), TOLERANCES)
            if case != (10, 1e-6)
        ),
    ],
)
def test_error_is_proportionate_to_the_tolerance(loops, rtol):
    """A step may turn each of the uprights, 1 m long, by rtol; some fifty steps, and a pendulum that swings round keeps an error of its energy,
    which moves it by some times as much in 10 s. How many loops there are makes no difference."""
    assert worst_tip(loops, rtol) < min(30 * loops, 200) * rtol + FLOOR


def test_two_loops_end_where_they_are_known_to():
    """The tip of the first upright at 10 s, from an independent solution of 12 digits."""
    run = simulate(load_scene("four-bar"), rtol=1e-11, output_step=10.0)
    tip = 2 * run["upright-0.x"][-1], 2 * run["upright-0.y"][-1]
    assert tip == pytest.approx((0.328458111533, 0.944518538181), abs=2 * FLOOR)


@pytest.mark.parametrize("angle", [1e-1, 1e-3, 1e-5])
def test_one_singular_value_a_loop_vanishes_with_the_distance(angle):
    """Flat but for an angle: as many small singular values as loops, proportional to it, and the rest of the order of 1."""
    loops = 3
    m, w = (mechanism := Mechanism(four_bars(loops))).arrays, workspace(mechanism.arrays)
    constraints_at(m, w, 0.0, *_parallel(loops, angle))
    _, _, s, _ = singular_rows(m, w, lengths(m))
    assert np.all(s[:-loops] > 0.1 * s[0])
    assert np.all((s[-loops:] > 0.03 * angle) & (s[-loops:] < 3 * angle))


def test_only_what_can_be_corrected_is_left_of_a_residual():
    """Far from the flat position all of a residual is corrected; at it, what no velocity can change is not asked for."""
    loops = 3
    m, w = (mechanism := Mechanism(four_bars(loops))).arrays, workspace(mechanism.arrays)
    for angle, lost in ((1.0, 0), (1e-6, loops)):
        constraints_at(m, w, 0.0, *_parallel(loops, angle))
        size, left_of, s, _ = singular_rows(m, w, lengths(m))
        residual = np.linspace(1.0, 2.0, m.rows)
        kept = residual.copy()
        remove_nearly_dependent(m, w, kept)
        part, asked = left_of @ (kept / size), left_of @ (residual / size)
        np.testing.assert_allclose(part[: m.rows - lost], asked[: m.rows - lost], atol=1e-12)
        np.testing.assert_allclose(part[m.rows - lost :], 0.0, atol=1e-12)


def test_a_run_leaves_the_threads_of_linear_algebra_as_they_were(monkeypatch):
    """One inside of a run, as many as before behind it."""
    pools = _linear_algebra()
    with pools.limit(limits=2):
        before = [pool["num_threads"] for pool in pools.info()]
        inside = []

        def watched(*arguments):
            inside.extend(pool["num_threads"] for pool in pools.info())
            return simulate_parts(*arguments)

        monkeypatch.setattr(subsystems, "simulate_parts", watched)
        simulate(four_bars(1), rtol=1e-6, t_end=0.1)
        assert inside and set(inside) == {1}
        assert [pool["num_threads"] for pool in pools.info()] == before


def _parallel(loops: int, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the row at an angle of its uprights above the horizontal, at rest."""
    c, s = np.cos(angle), np.sin(angle)
    uprights = [(k + 0.5 * c, 0.5 * s, angle) for k in range(loops + 1)]
    couplers = [(k - 0.5 + c, s, 0.0) for k in range(1, loops + 1)]
    q = np.array([*uprights, *couplers]).ravel()
    return q, np.zeros_like(q)
