"""Lemke's method, the HLCP and the search of contact modes, each against an enumeration of all possibilities."""

from itertools import product

import numpy as np
import pytest
from contact_mode_enumeration import consistent_forces
from random_mechanisms import SeededDice, extreme_scene, moderate_scene

from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.enumeration import solutions as consistent
from stiction.reference_impl.friction.lemke import RAY, SOLVED, lemke
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth

TIGHT = 1e-9
"""Rounding, times the condition of the small random bases (1e3 to 1e6)."""


def complementary_solutions(A0, A1, b):
    """All (y, x) of A0 y = A1 x + b, y >= 0, x >= 0, y^T x = 0 whose basis is regular."""
    n, found = len(b), []
    for in_y in product((True, False), repeat=n):
        in_y = np.array(in_y)
        basis = np.where(in_y, A0, -A1)
        if np.linalg.cond(basis) > 1e12:
            continue
        values = np.linalg.solve(basis, b)
        if np.all(values >= -TIGHT * np.max(np.abs(values))):
            found.append((np.where(in_y, values, 0.0), np.where(in_y, 0.0, values)))
    return found


def lcp_solutions(M, q):
    return complementary_solutions(np.eye(len(q)), M, q)


@pytest.mark.parametrize("n", [1, 2, 4, 6])
def test_lemke_on_p_matrices(n):
    random = np.random.default_rng(n)
    for _ in range(40):
        root, skew = random.normal(size=(2, n, n))
        M, q = root @ root.T + 0.1 * np.eye(n) + skew - skew.T, random.normal(size=n)
        w, z, outcome, _ = lemke(M, q, random.uniform(0.1, 10, n))
        (expected,) = lcp_solutions(M, q)  # a P-matrix has exactly one
        assert outcome == SOLVED
        np.testing.assert_allclose(w, expected[0], atol=TIGHT * (1 + np.max(np.abs(w))))
        np.testing.assert_allclose(z, expected[1], atol=TIGHT * (1 + np.max(np.abs(z))))


@pytest.mark.parametrize("n", [2, 3, 5])
def test_lemke_on_strictly_copositive_matrices(n):
    """Lemke's method solves them for every covering vector (Cottle, Pang & Stone 1992, Theorem 4.4.12)."""
    random = np.random.default_rng(10 + n)
    for _ in range(40):
        M, q = random.uniform(0, 1, (n, n)) * random.integers(0, 2, (n, n)), random.normal(size=n)
        M[np.diag_indices(n)] = random.uniform(0.2, 1, n)
        w, z, outcome, _ = lemke(M, q, random.uniform(0.1, 10, n))
        assert outcome == SOLVED
        assert any(np.allclose(z, other, atol=1e-8) for _, other in lcp_solutions(M, q))


@pytest.mark.parametrize(
    ("M", "q"),
    [
        ([[0.0]], [-1.0]),  # w = -1
        ([[-1.0]], [-1.0]),  # w = -1 - z
        ([[0.0, -1.0], [1.0, 0.0]], [-1.0, -1.0]),  # w1 = -1 - z2
    ],
)
def test_ray_where_there_is_no_solution(M, q):
    M, q = np.array(M), np.array(q)
    assert not lcp_solutions(M, q)
    assert lemke(M, q, np.ones(len(q)))[2] == RAY


def test_degenerate_problems_do_not_cycle():
    """All ratios tied (q = -1, equal rows), and q with zeros: the lexicographic rule decides."""
    for n in (2, 5, 9):
        M = np.ones((n, n))
        w, z, outcome, _ = lemke(M, -np.ones(n), np.ones(n))
        assert outcome == SOLVED and np.sum(z) == pytest.approx(1.0) and np.all(w == 0)
    w, z, outcome, _ = lemke(np.eye(3), np.array([0.0, -1.0, 0.0]), np.ones(3))
    assert outcome == SOLVED and list(z) == [0, 1, 0]


def slider_bar_at(t, case=1, **changes):
    """Workspace of the slider-bar at a state of its motion, and its slip direction (0 at rest)."""
    scene = (
        vary(load_scene(f"slider-bar-case-{case}"), changes)
        if changes
        else load_scene(f"slider-bar-case-{case}")
    )
    true = slider_bar_truth(load_scene(f"slider-bar-case-{case}"), 8.0)(t)
    mechanism = Mechanism(scene, "none")
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    q, v = (
        np.array([true[f"{body}.{label}"][0] for body in mechanism.body_names for label in labels])
        for labels in (("x", "y", "angle"), ("vx", "vy", "omega"))
    )
    row_form(m, w, t, q, v)
    return m, w, np.array([int(true["guide.mode"][0])]), true


def at_start(scene, speed=1.0):
    """Workspace of a mechanism without stabilization at its start, velocities times `speed`, and its slip directions."""
    mechanism = Mechanism(scene, "none")
    m, w, (q, v) = mechanism.arrays, workspace(mechanism.arrays), mechanism.initial_state()
    row_form(m, w, 0.0, q, speed * v)
    return m, w, np.where(np.abs(w.slip_speed) < 1e-12, 0, np.sign(w.slip_speed)).astype(np.int64)


def rays(tables, at_rest=True):
    """Of random mechanisms, all guides at rest or each as it starts: how many problems have a solution, and on how many of these Lemke's method ends without one."""
    solved = ended = 0
    for i, table in enumerate(tables):
        m, w, slip = at_start(scene_from_dict(table, name=str(i)), 0.0 if at_rest else 1.0)
        if len(m.friction):
            _, _, _, outcome, _ = hlcp.solve(m, w, slip)
            solved, ended = (
                solved + (outcome == SOLVED),
                ended + (outcome == SOLVED and w.counters["lemke_rays"] > 0),
            )
    return solved, ended


@pytest.mark.parametrize("at_rest", [True, False])
def test_lemke_ends_without_a_solution_where_friction_is_extreme_only(at_rest):
    """What the limits and the comment at `hlcp.SATURATION_COVER` say: never with mu up to 0.2, and in some per cent of problems with friction far beyond what
    leaves one motion, for which all contact modes are tried."""
    solved, ended = rays(
        (moderate_scene(SeededDice([seed, 7]), (1, 4)) for seed in range(150)), at_rest
    )
    assert ended == 0 and solved >= 145
    solved, ended = rays(
        (extreme_scene(np.random.default_rng([seed, 7])) for seed in range(300)), at_rest
    )
    assert 0.02 * solved < ended < 0.15 * solved and solved > 250


@pytest.mark.parametrize(
    ("case", "t", "size"),
    [(1, 1.3, 5), (1, 2.7, 5), (3, 5.9, 5), (1, 0.1, 9), (1, 7.7, 9), (1, 8.0, 9)],
)
def test_hlcp_of_the_slider_bar(case, t, size):
    m, w, slip, true = slider_bar_at(t, case)
    A0, A1, b, E0, E1, _ = hlcp.assemble(m, w, slip)
    force, y, x, outcome, *_ = hlcp.solve(m, w, slip)
    assert len(b) == size and outcome == SOLVED
    assert hlcp.residual(A0, A1, b, y, x) < 1e-12  # rounding
    solutions = complementary_solutions(A0, A1, b)
    assert solutions
    for other_y, other_x in solutions:  # in stick the split of friction differs, the sums do not
        other = E0 @ other_y + E1 @ other_x
        np.testing.assert_allclose(other[[0, 1, 2, 4, 5]], force[[0, 1, 2, 4, 5]], atol=1e-9)
    assert force[2] == pytest.approx(true["guide.normal_force"][0], abs=1e-9)
    assert force[4] == pytest.approx(true["motor.effort"][0], abs=1e-9)
    assert force[5] == pytest.approx(true["guide.friction"][0], abs=1e-9)


def test_without_friction_the_lcp_matrix_is_the_identity():
    m, w, _, _ = slider_bar_at(1.3, **{"guide.mu": 0, "guide.mus": 0})
    A0, A1, *_ = hlcp.assemble(m, w, np.array([1]))
    np.testing.assert_allclose(np.linalg.solve(A0, A1), np.eye(5), atol=1e-12)


def incline(mass=1.0, length=0.6, width=0.5, mu=0.2, mus=0.3, tilt=20.0, g=9.81):
    angle, inertia = np.deg2rad(-tilt), mass * (length**2 + width**2) / 12
    return at_start(
        scene_from_dict(
            {
                "gravity": [0, -g],
                "bodies": {"block": {"mass": mass, "inertia": inertia, "angle": angle}},
                "joints": {
                    "guide": {
                        "type": "translational",
                        "slider": "block",
                        "direction": [np.cos(angle), np.sin(angle)],
                        "angle": angle,
                        "length": length,
                        "width": width,
                        "mu": mu,
                        "mus": mus,
                    }
                },
            }
        )
    )


@pytest.mark.parametrize("tilt", [1.0, 10.0, 16.69, 16.71, 20.0, 45.0, 80.0])
def test_block_on_an_incline_at_rest(tilt):
    """The problem on which a covering vector of ones ends on a ray; the angle of friction is 16.699 degrees."""
    force, y, x, outcome, *_ = hlcp.solve(*incline(tilt=tilt))
    assert outcome == SOLVED
    normal, along = 9.81 * np.cos(np.deg2rad(tilt)), 9.81 * np.sin(np.deg2rad(tilt))
    assert force[0] == pytest.approx(normal, rel=1e-12)
    assert -force[2] == pytest.approx(min(along, 0.3 * normal), rel=1e-12)


@pytest.mark.parametrize("mass", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_solution_scales_with_mass_and_length(mass, length):
    """Forces grow with the mass; lengths do not enter forces, with them moments grow."""
    for tilt in (10.0, 30.0):
        unit, scaled = (
            hlcp.solve(*block)
            for block in (incline(tilt=tilt), incline(mass, 0.6 * length, 0.5 * length, tilt=tilt))
        )
        assert scaled[3] == SOLVED
        np.testing.assert_allclose(scaled[0][[0, 2]], mass * unit[0][[0, 2]], rtol=1e-9)
        np.testing.assert_allclose(
            scaled[0][1], mass * length * unit[0][1], rtol=1e-9, atol=1e-12 * mass * length
        )


def consistent_modes(m, w, slip):
    """Row forces of every consistent contact mode, once each."""
    found = []
    for force in consistent_forces(m, w, slip)[0]:
        if not any(np.allclose(force, other, atol=1e-6) for other in found):
            found.append(force)
    return found


def stacked(random):
    """Three sliders in series, the last one loaded, in a random state."""
    raw = {"gravity": [0, -9.81], "bodies": {}, "joints": {}, "forces": {}}
    guide, origin, speed = "ground", np.zeros(2), np.zeros(2)
    for i in range(3):
        direction, u = random.uniform(-1, 1), float(random.choice([0.0, random.normal()]))
        d = np.array([np.cos(direction), np.sin(direction)])
        origin, speed = origin + random.uniform(-0.2, 0.2) * d, speed + u * d
        raw["bodies"][f"s{i}"] = {
            "mass": random.uniform(0.5, 2),
            "inertia": random.uniform(0.05, 0.3),
            "position": list(origin),
            "velocity": list(speed),
        }
        raw["joints"][f"g{i}"] = {
            "type": "translational",
            "slider": f"s{i}",
            "guide": guide,
            "direction": list(d),
            "length": random.uniform(0.4, 0.8),
            "width": random.uniform(0, 0.4),
            "mu": 0.15,
            "mus": random.uniform(0.15, 0.25),
        }
        raw["forces"][f"f{i}"] = {
            "type": "force",
            "body": f"s{i}",
            "direction": list(random.normal(size=2)),
            "law": {"type": "constant", "value": random.uniform(0, 20)},
        }
        guide = f"s{i}"
    return scene_from_dict(raw)


@pytest.mark.parametrize("count", [60, pytest.param(600, marks=pytest.mark.long)])
def test_search_of_modes_and_hlcp_find_the_one_solution(count):
    random, unique = np.random.default_rng(5), 0
    for _ in range(count):
        m, w, slip = at_start(stacked(random))
        solutions = consistent_modes(m, w, slip)
        forces, directions = np.zeros((1, len(w.force))), np.zeros((1, 3), dtype=np.int64)
        assert consistent(m, w, slip, forces, directions) == bool(solutions)
        solved, y, x, outcome, *_ = hlcp.solve(m, w, slip)
        assert (outcome == SOLVED) == bool(solutions)
        if len(solutions) == 1:
            unique += 1
            np.testing.assert_allclose(forces[0], solutions[0], atol=1e-8)
            np.testing.assert_allclose(solved, solutions[0], atol=1e-8)
            A0, A1, b, *_ = hlcp.assemble(m, w, slip)
            assert hlcp.residual(A0, A1, b, y, x) < 1e-10
    assert unique > 2 * count / 3  # else this tested nothing


def test_variables_of_a_mode_solve_the_hlcp():
    """y and x built from the forces of a contact mode satisfy eqs. (36)-(38), hyperstatic corner forces included."""
    random = np.random.default_rng(6)
    for _ in range(100):
        m, w, slip = at_start(stacked(random))
        forces, directions = np.zeros((1, len(w.force))), np.zeros((1, 3), dtype=np.int64)
        if consistent(m, w, slip, forces, directions):
            A0, A1, b, E0, E1, _ = hlcp.assemble(m, w, slip)
            y, x = np.zeros(len(b)), np.zeros(len(b))
            hlcp._variables(m, w, slip, forces[0], directions[0], y, x)
            assert hlcp.residual(A0, A1, b, y, x) < 1e-9
            np.testing.assert_allclose(E0 @ y + E1 @ x, forces[0], atol=1e-9)
