"""The paper's equations as written, in dense NumPy, against the compiled ones: rows, HLCP, solutions, the fixed-step scheme."""

import re
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from random_mechanisms import (
    SeededDice,
    add_constant_friction,
    add_stribeck_curves,
    moderate_scene,
)

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl import paper as paper_module
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.outcomes import SOLVED
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.guide_freedom import FREE
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.reference_impl.paper import NoSolution, Paper, lemke
from stiction.scenes import SceneError, catalogue, load_scene, scene_from_dict, vary

NONE = {"method": "none"}
"""The paper does not project."""
ROUNDING = 1e-11
"""Relative: sums of some ten terms, levers and inverse masses between 0.1 and 100."""
SETTINGS = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)


def close(found, expected, tolerance=ROUNDING, size=None):
    """Equal, relative to `size`, by default that of the largest entry."""
    assert np.shape(found) == np.shape(expected)
    size = np.max(np.abs(expected), initial=0.0) if size is None else size
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(size, 1e-300))


@st.composite
def moments(draw):
    """A mechanism whose sliders all have a length, with Baumgarte's stabilization or none, and a state near its start.

    Half of them have friction with bounds of its own in guides and pins, and half friction that falls with the speed of
    slip. A pin that a drive holds has none at rest in
    the compiled code (`guide_freedom`), so that it slips here.
    """
    seed = draw(st.integers(0, 10**6))
    raw, random = moderate_scene(SeededDice(seed)), np.random.default_rng(seed)
    for joint in raw["joints"].values():
        if joint["type"] == "translational" and "length" not in joint:
            joint |= {"length": 0.5, "width": 0.2}
    if draw(st.booleans()):
        add_constant_friction(raw, random)
    if draw(st.booleans()):
        add_stribeck_curves(raw, random)
    raw["stabilization"] = draw(
        st.sampled_from([NONE, {"method": "baumgarte", "alpha": 5, "beta": 3}])
    )
    scene = scene_from_dict(raw)
    q, v = EquationsOfMotion(scene).start()
    off = draw(st.sampled_from([0.0, 0.01]))
    mode = np.array(
        [draw(st.sampled_from([-1, 0, 1])) for _ in scene.frictional_joints], dtype=np.int64
    )
    mode[(Mechanism(scene).arrays.friction["freedom"] != FREE) & (mode == 0)] = 1
    q, v = (x + off * random.normal(size=len(x)) for x in (q, v))
    return scene, draw(st.sampled_from([0.0, 0.7])), q, v, mode


def compiled_rows(scene, t, q, v):
    mechanism = Mechanism(scene)
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    row_form(m, w, t, q, v)
    return mechanism, m, w


def in_order(paper, mechanism):
    """Of each row of the paper, its place among the compiled ones (joints in the order of the scene, then drives)."""
    return [mechanism.row_names.index(name) for name in paper.equations.rows]


def test_nothing_compiled_is_imported():
    code = "import sys, stiction.reference_impl.paper; print([name for name in sys.modules if name.partition('.')[0] in ('numba', 'llvmlite')])"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


def test_the_table_has_each_equation_once_and_names_functions_that_exist():
    rows = [line for line in paper_module.__doc__.splitlines() if line.startswith("(")]
    found = []
    for row in rows:
        for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", row[:16]):
            found += range(int(first), int(last or first) + 1)
        module, function = row.split()[-1].split(".")
        part = "friction" if module in ("hlcp", "coulomb", "lemke") else "multibody"
        assert hasattr(import_module(f"stiction.reference_impl.{part}.{module}"), function), row
    assert sorted(found) == list(range(1, 39))


@pytest.mark.parametrize(
    "name",
    [name for name in [*catalogue(), *catalogue("hard")] if len(load_scene(name).bodies) < 20],
)
def test_terms_of_every_kind_of_element(name):
    """Rows and applied forces of the whole catalogue at arbitrary states: two derivations."""
    scene, random = load_scene(name), np.random.default_rng(0)
    equations = EquationsOfMotion(scene)
    q, v = (x + 0.1 * random.normal(size=len(x)) for x in equations.start())
    mechanism, m, w = compiled_rows(scene, 0.4, q, v)
    terms = equations.at(0.4, q, v)
    order = [equations.rows.index(row) for row in mechanism.row_names]
    radius = mechanism.slip_radius
    rows = np.concatenate([terms.J[order], radius[:, None] * terms.W])
    close(rows / equations.mass @ rows.T, w.G)
    close(terms.QE / equations.mass, w.free)
    close(terms.phi[order], w.phi)
    close(terms.phi_dot[order], w.phi_dot)
    close(np.concatenate([terms.gamma[order], radius * terms.w]), w.gamma)
    close(radius * terms.slip_speed, w.slip_speed)


@SETTINGS
@given(moments())
def test_hlcp_as_compiled(moment):
    """A0, A1, b entry by entry.

    The compiled rows of the constraints are in the order of the scene, the paper's by kind; columns have the same order.
    The compiled friction of a pin is a force at a radius, and its slip the velocity there: equations and variables of
    pins at rest, gH'' (rows), lH (rows behind), gH+ and lH- in y, lH+ and gH- in x, are in other units.
    """
    scene, t, q, v, mode = moment
    paper = Paper(scene)
    mechanism, m, w = compiled_rows(scene, t, q, v)
    A0, A1, b, E0, E1, e = hlcp.assemble(m, w, mode)
    order, written = in_order(paper, mechanism), paper.hlcp(t, q, v, mode)
    order += range(len(order), len(b))
    radius = mechanism.slip_radius[paper.joint][mode[paper.joint] == 0]
    rows = np.concatenate([np.ones(m.rows), radius, 1 / radius])
    y, x = rows, np.concatenate([np.ones(m.rows), 1 / radius, radius])
    close((A0 * y / rows[:, None])[order], written.A0)
    close((A1 * x / rows[:, None])[order], written.A1)
    close((b / rows)[order], written.b)
    # the constant friction of each joint
    close(
        mechanism.slip_radius * e[m.rows :],
        np.bincount(paper.joint, written.e, len(mode)) if len(mode) else np.zeros(0),
    )
    assert not e[: m.rows].any()


@SETTINGS
@given(moments())
def test_solution_as_compiled(moment):
    """Forces and accelerations, where the friction gain shows that there is only one solution (`uniqueness`)."""
    scene, t, q, v, mode = moment
    paper = Paper(scene)
    mechanism, m, w = compiled_rows(scene, t, q, v)
    assume(gain_of_mode(m, w, mode)[0] < 0.9)
    force, _, _, outcome, _ = hlcp.solve(m, w, mode)
    assert outcome == SOLVED
    found = paper.solve(t, q, v, mode)
    motion = np.zeros(len(q))
    acceleration(m, w, force, motion)
    close(found.acceleration, motion, 1e-9)  # rounding, times the condition of the bases: up to 1e3
    close(found.lambda_C, force[in_order(paper, mechanism)], 1e-9)
    friction = mechanism.slip_radius * force[m.rows :]
    close(found.friction, friction, 1e-9, np.max(np.abs(force)))


@pytest.mark.parametrize(("case", "t_end"), [(1, 2.7), (2, 0.45), (3, 1.2)])
def test_scheme_as_compiled(case, t_end):
    """Step by step: states, forces and events. Case 1 has a stick, a late break-away and a reversal by then, in case 3 corners change."""
    scene, dt = load_scene(f"slider-bar-case-{case}"), 0.015
    steps = round(t_end / dt)
    paper = Paper(scene)
    written = paper.march(*paper.equations.start(), dt, steps)
    compiled = ReferenceEngine().simulate(scene, t_end=t_end, dt=dt, output_step=dt)
    assert written.breakdown is None and compiled.breakdown is None and len(written.t) == steps + 1
    close(written.q[:, 3], compiled["slider.x"])
    close(written.v[:, 3], compiled["slider.vx"])
    close(
        written.a[:, 3], compiled["slider.ax"], 1e-9
    )  # g_T'' of the steps' differences is not damped by integration
    rows = (
        "pin.fx",
        "pin.fy",
        "guide.normal_force",
        "guide.moment",
        "motor.effort",
        "guide.friction",
    )
    close(written.force, np.stack([compiled[row] for row in rows], -1), 1e-9)
    close(written.mode[:, 0], compiled["guide.mode"], 0.0)
    assert [kind for _, kind, _ in written.events] == [event.kind for event in compiled.events]
    close([time for time, *_ in written.events], [event.time for event in compiled.events])


def test_ray_is_a_typed_failure():
    with pytest.raises(NoSolution, match="ray") as reason:
        lemke(np.array([[0.0]]), np.array([-1.0]), np.ones(1))
    assert reason.value.kind == "ray"


def test_breakdown_says_when_and_why():
    """A slider held twice: A0 is singular from the start."""
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "stabilization": NONE,
            "bodies": {"block": {"mass": 1, "inertia": 1}},
            "joints": {
                name: {"type": "translational", "slider": "block", "length": 0.5, "mu": 0.1}
                for name in ("guide", "again")
            },
        }
    )
    march = Paper(scene).march(np.zeros(3), np.zeros(3), 0.1, 3)
    assert march.breakdown.kind == "singular" and march.breakdown.time == 0.0 and len(march.t) == 0


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"guide.length": None, "guide.width": None}, "joints.guide.length"),
        ({"guide.mu": None, "guide.mus": None}, "joints.guide.mu"),
        ({"stabilization": {"method": "projection"}}, "stabilization.method"),
    ],
)
def test_what_the_paper_does_not_have_is_refused(changes, key):
    with pytest.raises(SceneError) as refused:
        Paper(vary(load_scene("slider-bar-case-1"), changes))
    assert [problem.key for problem in refused.value.problems] == [key]


def test_runs_by_name():
    """`method=textbook` is the compiled scheme's twin at every output, events with values included; it refuses what it cannot do."""
    scene = load_scene("slider-on-moving-guide", {"stabilization": NONE})
    runs = [
        ReferenceEngine().simulate(scene, t_end=0.3, dt=0.01, output_step=0.02, method=method)
        for method in ("textbook", "paper")
    ]
    assert (
        runs[0].termination == runs[1].termination == "end"
        and runs[0].settings["method"] == "textbook"
    )
    assert set(runs[0].columns) == set(runs[1].columns)
    for column in runs[0].columns:
        close(runs[0][column], runs[1][column], 1e-9, max(1.0, np.max(np.abs(runs[1][column]))))
    assert [(event.kind, event.joint) for event in runs[0].events] == [
        (event.kind, event.joint) for event in runs[1].events
    ]
    with pytest.raises(ValueError, match="textbook"):
        ReferenceEngine().simulate(scene, t_end=0.3, method="textbook", solver="enumeration")
    with pytest.raises(ValueError, match="textbook"):
        ReferenceEngine().simulate(scene, t_end=0.3, method="textbook", rtol=1e-6)
