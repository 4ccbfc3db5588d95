"""Random scenes with extreme parameters: every solution verified, nothing crashes, hangs or passes as a number.

Of every scene the HLCP at the start is solved and verified here in plain numpy: its residual, Coulomb's law and the balance of
all bodies, and, for small problems, against an enumeration of all contact modes. Every tenth is simulated for some of its time.
"""

from pathlib import Path

import numpy as np
import pytest
from contact_mode_enumeration import consistent_forces
from random_mechanisms import extreme_scene
from reference_checks import balance_residual

from stiction.comparisons.hard.checks import friction_excess
from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.outcomes import NONE, SINGULAR, SOLVED
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import load_scene, scene_from_dict

CONDITIONS = 1e-9
"""Residual of what was solved, relative to its largest term."""
SIMULATED = 10
"""One scene of so many is simulated."""
MOST_EVALUATIONS = 1000
"""Of the right-hand side in a step, above which a run counts as hung: 12 stages, and some ten functions that are each bisected to rounding,
50 times, where an event is looked for."""
REGRESSIONS = sorted((Path(__file__).parent / "fuzz").glob("*.toml"))


def equation_units(m, w, stuck):
    """What makes the equations of the HLCP comparable: accelerations times the square root of the row's effective mass, forces
    over it (rows of lH-), all in sqrt(W)."""
    unit = list(1 / np.sqrt(np.diag(w.G)[: m.rows]))
    for power in (-1, 1):  # rows of gH'', then of lH-, two surfaces each
        for f in np.flatnonzero(stuck):
            row = m.rows + f if power < 0 else m.friction[f]["row"]
            unit += 2 * [w.G[row, row] ** (power / 2)]
    return np.array(unit)


def verify_start(scene):
    """Solve the HLCP at the start of a scene and verify what came out; returns the outcome and whether modes were enumerated."""
    mechanism = Mechanism(scene)
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    q, v = mechanism.initial_state()
    row_form(m, w, 0.0, q, v)
    stuck = np.abs(w.slip_speed) <= 1e-11 * max(np.max(np.abs(v)), 1e-300)
    slip = np.where(stuck, 0, np.sign(w.slip_speed)).astype(np.int64)
    force, y, x, outcome, *_ = hlcp.solve(m, w, slip)
    every = consistent_forces(m, w, slip)
    if outcome == NONE and every is not None:
        assert not (len(every[0]) and every[1]), "a solution exists"
    if outcome == SOLVED:
        A0, A1, b, E0, E1, e = hlcp.assemble(m, w, slip)
        assert (
            np.all(np.isfinite(force)) and np.all(y >= 0) and np.all(x >= 0) and np.all(y * x == 0)
        )
        unit = equation_units(m, w, stuck)
        terms = (np.abs(A0) @ y + np.abs(A1) @ x + np.abs(b)) * unit
        assert np.max(np.abs(A0 @ y - A1 @ x - b) * unit) <= CONDITIONS * np.max(terms), "residual"
        np.testing.assert_allclose(
            E0 @ y + E1 @ x + e, force, atol=CONDITIONS * np.max(np.abs(force))
        )
        a = np.zeros(len(q))
        acceleration(m, w, force, a)
        columns = build_columns(
            mechanism, np.zeros(1), q[None], v[None], a[None], force[None], None
        )
        assert balance_residual(scene, np.zeros(1), columns) < CONDITIONS, "balance"
        if every is not None and every[1] and len(every[0]) == 1 and not np.any(stuck):
            size = np.abs(force) + np.max(np.abs(force) * np.sqrt(np.diag(w.G))) / np.sqrt(
                np.diag(w.G)
            )
            assert np.max(np.abs(every[0][0] - force) / size) < 1e-6, "not the enumerated solution"
    return outcome, every is not None


def simulate_shortly(scene, steps):
    """Simulate a scene for some of its time; a run ends at its end or says why not, and what it accepted satisfies all conditions."""
    mechanism = Mechanism(scene, "projection")
    output = np.linspace(0.0, scene.t_end, 9)
    run = simulate_event_driven(
        mechanism, *mechanism.initial_state(), output, scene.t_end, 1e-7, step_limit=steps
    )
    work = run.cost.counters
    assert work["rhs"] < MOST_EVALUATIONS * (1 + work["steps"] + work["rejected"]), "hangs"
    at_start = (
        run.breakdown is not None and run.breakdown.time == 0.0
    )  # then the state is known, and nothing else
    for values in run.columns.values():
        assert at_start or np.all(np.isfinite(values)), "not finite"
    if not at_start:
        assert friction_excess(scene, run.columns) < 1e-7, "Coulomb"
    return run


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """What takes long is not to be the compiler."""
    scene = scene_from_dict(extreme_scene(np.random.default_rng(0)))
    verify_start(scene)
    mechanism = Mechanism(scene, "projection")
    simulate_event_driven(
        mechanism, *mechanism.initial_state(), np.zeros(1), scene.t_end, 1e-7, step_limit=10
    )


def fuzz(seed, count, *, steps):
    """Verify so many scenes; the failures, each with what reproduces it, and how often each outcome was met."""
    failures, met, simulated, enumerated = [], {}, 0, 0
    for number in range(count):
        raw = extreme_scene(np.random.default_rng([seed, number]))
        scene = scene_from_dict(raw, f"fuzz {seed}/{number}")
        try:
            outcome, small = verify_start(scene)
            met[outcome] = met.get(outcome, 0) + 1
            enumerated += small
            if number % SIMULATED == 0:
                simulated += 1
                run = simulate_shortly(scene, steps)
                kind = run.breakdown.kind if run.breakdown else "end"
                met[kind] = met.get(kind, 0) + 1
        except (AssertionError, ArithmeticError, np.linalg.LinAlgError, ValueError) as error:
            failures.append(
                f"{seed}/{number}: {type(error).__name__}: {str(error).strip().splitlines()[0] if str(error).strip() else ''}"
            )
    print(f"{count} scenes: {enumerated} enumerated, {simulated} simulated; {met}")
    return failures, met


@pytest.mark.parametrize(
    ("seed", "count", "steps"),
    [(1, 300, 500), pytest.param(2, 20_000, 2000, marks=pytest.mark.long)],
)
def test_every_solution_is_verified(seed, count, steps):
    failures, met = fuzz(seed, count, steps=steps)
    assert not failures, "\n".join(failures)
    assert met[SOLVED] > 0.8 * count and met["end"] > 0.05 * count  # else this tested little
    assert met.get(SINGULAR, 0) < 0.01 * count


@pytest.mark.parametrize("path", REGRESSIONS, ids=lambda path: path.stem)
def test_what_failed_before(path):
    scene = load_scene(path)
    verify_start(scene)
    simulate_shortly(scene, steps=2000)
