"""Motions with impacts: closed forms of a free slider, balances of the slider-crank, and Moreau's time stepping."""

from functools import lru_cache

import numpy as np
import pytest
from conftest import installed
from scipy.integrate import solve_ivp

from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.engines import load_engine
from stiction.scenes import load_scene, vary
from stiction.truths import NoMotion, NotThisMechanism
from stiction.truths.clearance.corner_law import CornerState
from stiction.truths.clearance.impacting_motion import OPEN, impacting_motion
from stiction.truths.clearance.mechanisms import (
    FreeSlider,
    Gap,
    slider_crank_with_clearance,
)

G = 9.81
SLIDER_CRANK = "slider-crank-clearance"
GAP = 1e-3
"""Gap of the slider-crank, m."""
LONGEST_STEP = 2e-4
"""Longest step for the slider-crank, s: it turns by 0.03 rad within."""


def box(mu=0.0, restitution=0.5, clearance=0.02, **loads):
    """A slider of 2 kg, 0.4 m by 0.1 m, under its weight."""
    loads = {"force_y": -2 * G, **loads}
    return FreeSlider(Gap(0.4, 0.1, clearance, mu, restitution), 2.0, 0.03, **loads)


def start(*values):
    return np.array(values, dtype=float)


def scene_of(restitution):
    """The slider-crank of the catalogue with the gap of these tests."""
    return load_scene(SLIDER_CRANK, {"c": GAP, "e": restitution})


@lru_cache
def slider_crank(restitution, impacts=None, t_end=0.2, longest_step=LONGEST_STEP):
    """The motion of the slider-crank of the catalogue."""
    mechanism, q, v = slider_crank_with_clearance(scene_of(restitution))
    return impacting_motion(mechanism, q, v, t_end, longest_step, impacts)


# Closed forms of a free slider


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7])
def test_a_falling_slider_bounces_and_comes_to_rest(restitution):
    """Fall for sqrt(2 c/g), then flights of 2 e^k v/g, which end after 2 v e/(g (1 - e)) in all."""
    mu, speed_x, c, e = 0.05, 3.0, 0.02, restitution
    motion = impacting_motion(box(mu, e), start(0, 0, 0), start(speed_x, 0, 0), 0.5, 1e-2)
    fall, speed = np.sqrt(2 * c / G), np.sqrt(2 * c * G)
    flights = 2 * speed / G * e ** np.arange(1, len(motion.impacts))
    times = fall + np.concatenate([[0], np.cumsum(flights)])
    # the time of an impact is known as well as the gap, 1e-16 m, over the speed; later flights begin there
    bounds = 1e-12 + 1e-16 * np.cumsum([1 / impact.speed for impact in motion.impacts])
    assert np.all(np.abs(np.array([i.time for i in motion.impacts]) - times) < bounds)
    for impact in motion.impacts:
        assert impact.corners == (0, 1)
    rest = fall + 2 * speed * e / (G * (1 - e))
    last = motion.phases[-1]
    # the flights that are left out last sqrt(8 h/g)/(1 - e), with the height h = 1e-14 m
    assert abs(last.start - rest) <= np.sqrt(8e-14 / G) / (1 - e)
    # Impulses and forces of the surface are the weight on average, and friction is mu times them.
    _, v = motion.state(0.4)
    np.testing.assert_allclose(v[0], speed_x - mu * G * 0.4, rtol=1e-9)
    forces = motion.forces(0.4)
    np.testing.assert_allclose(forces.normal.sum(), 2 * G, rtol=1e-12)
    # the moments of friction at the lever b/2 and of the corner forces at a/2 balance
    moment = 0.2 * (forces.normal[1] - forces.normal[0]) + 0.05 * forces.friction.sum()
    assert abs(moment) < 1e-12


@pytest.mark.parametrize("mu, speed_x", [(0.0, 1.0), (0.2, 1.0), (5.0, 0.1)])
def test_impact_of_one_corner(mu, speed_x):
    """One corner with the lever (x, y): (u_N, u_T) change by D (P_N, P_T), D = E/m + (x, -y) (x, -y)'/J.

    Slip leaves P_T = -mu s P_N and P_N = -(1 + e) u_N/(D_NN - mu s D_NT); stick leaves both from the equations.
    """
    mechanism = box(mu, 0.5, force_y=0.0)
    q, v = start(0, -0.002, 0.05), start(speed_x, -0.2, 0.4)
    motion = impacting_motion(mechanism, q, v, 0.2, 1e-2, impacts=1)
    (impact,) = motion.impacts
    assert impact.corners == (0,)
    angle = impact.q[2]
    x = -0.2 * np.cos(angle) + 0.05 * np.sin(angle)
    y = -0.2 * np.sin(angle) - 0.05 * np.cos(angle)
    # the corner reaches the surface
    assert abs(impact.q[1] + y + 0.05 + 0.02) < 1e-14
    lever = np.array([x, -y])
    D = np.eye(2) / 2.0 + np.outer(lever, lever) / 0.03
    u = np.array([-0.2, speed_x]) + 0.4 * lever
    np.testing.assert_allclose([impact.normal_before[0], impact.slip_before[0]], u, rtol=1e-12)
    stick = np.linalg.solve(D, -u - [0.5 * u[0], 0])
    if abs(stick[1]) <= mu * stick[0]:
        expected, state = stick, CornerState.STICK
    else:
        s = np.sign(-stick[1])
        normal = -1.5 * u[0] / (D[0, 0] - mu * s * D[0, 1])
        expected = np.array([normal, -mu * s * normal])
        state = CornerState.FORWARD if s > 0 else CornerState.BACKWARD
        if mu > 0:
            assert s * (u + D @ expected)[1] > 0
    np.testing.assert_allclose(
        [impact.normal_impulse[0], impact.friction_impulse[0]], expected, atol=1e-12
    )
    if mu > 0:
        assert impact.states == (state,)
    assert (state is CornerState.STICK) == (mu == 5.0)
    np.testing.assert_allclose(impact.normal_after[0], -0.5 * u[0], rtol=1e-12)


def test_a_sliding_slider_stops_and_sticks():
    """It slides on its lower surface by v^2/(2 mu g), and stays though a force of less than mu m g pulls."""
    motion = impacting_motion(
        box(0.3, 0.0, force_x=0.2 * 2 * G), start(0, -0.02, 0), start(1.0, 0, 0), 1.0, 1e-2
    )
    assert not motion.impacts
    # it loses mu g - 0.2 g of its speed, and does not stop within a second
    np.testing.assert_allclose(motion.state(1.0)[1][0], 1.0 - 0.1 * G, atol=1e-12)
    motion = impacting_motion(
        box(0.3, 0.0, force_x=-0.2 * 2 * G), start(0, -0.02, 0), start(1.0, 0, 0), 1.0, 1e-2
    )
    stop = 1.0 / (0.5 * G)
    (q, v), forces = motion.state(1.0), motion.forces(1.0)
    np.testing.assert_allclose(motion.phases[-1].start, stop, rtol=1e-12)
    np.testing.assert_allclose(q, [0.5 * stop, -0.02, 0], atol=1e-13)
    np.testing.assert_allclose(v, 0, atol=1e-13)
    assert CornerState.STICK in motion.phases[-1].states
    np.testing.assert_allclose(forces.friction.sum(), 0.2 * 2 * G, rtol=1e-12)


def test_a_torque_tips_the_slider():
    """Beyond m g a/2 it turns about its front corner, which sticks: (J + m r^2) phi'' = T - m g a/2 at first."""
    torque = 1.2 * 2 * G * 0.2
    motion = impacting_motion(
        box(2.0, 0.0, torque=-torque), start(0, -0.02, 0), start(0, 0, 0), 0.05, 1e-3
    )
    assert motion.phases[0].states == (
        CornerState.OPEN,
        CornerState.STICK,
        CornerState.OPEN,
        CornerState.OPEN,
    )
    inertia = 0.03 + 2.0 * (0.2**2 + 0.05**2)
    np.testing.assert_allclose(
        motion.forces(0.0).acceleration[2], -(torque - 2 * G * 0.2) / inertia, rtol=1e-12
    )
    # below it, the slider rests
    rest = impacting_motion(
        box(2.0, 0.0, torque=-torque / 1.3), start(0, -0.02, 0), start(0, 0, 0), 0.05, 1e-3
    )
    np.testing.assert_allclose(rest.state(0.05)[0], [0, -0.02, 0], atol=1e-14)


def test_a_torque_presses_opposite_corners():
    """Without weight a torque turns the slider until a rear and a front corner touch; each carries T over their distance."""
    mechanism = box(0.0, 0.0, force_y=0.0, torque=0.5)
    motion = impacting_motion(mechanism, start(0, 0, 0), start(0.3, 0, 0), 0.5, 5e-3)
    q, forces = motion.state(0.5)[0], motion.forces(0.5)
    pressed = np.flatnonzero(forces.normal)
    assert set(pressed) == {0, 2} and np.all(forces.normal >= 0)
    distance = 0.4 * np.cos(q[2]) - 0.1 * np.sin(q[2])
    np.testing.assert_allclose(forces.normal[pressed], 0.5 / distance, rtol=1e-11)
    # 0.1 cos + 0.4 sin = 0.1 + 2 c
    np.testing.assert_allclose(0.1 * np.cos(q[2]) + 0.4 * np.sin(q[2]), 0.14, rtol=1e-13)
    np.testing.assert_allclose(q[0], 0.15, rtol=1e-13)


@pytest.mark.parametrize("seed", range(12))
def test_random_free_sliders_keep_all_balances(seed):
    rng = np.random.default_rng(seed)
    mechanism = box(
        rng.uniform(0, 0.6),
        rng.choice([0.0, 0.2, 0.8]),
        force_y=rng.normal() * 20,
        force_x=rng.normal() * 5,
        torque=rng.normal(),
    )
    velocity = start(*rng.normal(size=2), 2 * rng.normal())
    motion = impacting_motion(mechanism, start(0, 0, 0), velocity, 1.0, 1e-2, impacts=20)
    check_balances(motion)


def test_a_corner_chatters_while_another_one_slides():
    """The last flights of the front corner, below the rounding of its gap, must not let it pass its surface."""
    mechanism = FreeSlider(
        Gap(0.4, 0.1, 0.02, 0.05650046205343928, 0.05),
        2.0,
        0.03,
        force_y=14.290547630382832,
        torque=2.3144525862694914,
    )
    # a drawn start from which the passage was 1e-8 m
    q = start(0, -2.033783071094669e-05, -0.02831047737525764)
    v = start(-0.1410417998484368, 0.9448988777290654, 2.011190895614039)
    motion = impacting_motion(mechanism, q, v, 1.0, 1e-2, impacts=20)
    check_balances(motion)
    assert motion.phases[-1].start < 0.4 and CornerState.STICK in motion.phases[-1].states


# The slider-crank


def check_balances(motion):
    """Energy, momentum, Newton's and Coulomb's law of a motion."""
    mechanism, mu = motion.mechanism, motion.mechanism.gap.mu
    first = motion.phases[0]
    q, v = motion.state(0.0)
    energy = 1.0 + abs(mechanism.energy(q, v))
    for phase in motion.phases:
        # tolerances of the integration and the corrections at its start
        assert abs(phase.energy_residual) < 1e-11 * energy
        assert phase.drift < 1e-9
    for impact in motion.impacts:
        assert impact.momentum_residual < 1e-13 and abs(impact.energy_residual) < 1e-13
        assert impact.energy_change <= 0
        P_N, P_T = impact.normal_impulse, impact.friction_impulse
        loaded = P_N > 0
        assert np.all(P_N >= -1e-15) and loaded.any()
        # Newton's law where an impulse acts, and no penetration elsewhere in contact
        corners = list(impact.corners)
        law = impact.normal_after + impact.restitution * np.minimum(impact.normal_before, 0)
        assert np.max(np.abs(law[loaded])) < 1e-10 * max(1.0, impact.speed)
        assert np.min(law[corners]) > -1e-10
        assert np.all(np.abs(P_T) <= mu * P_N * (1 + 1e-9) + 1e-15)
        slips = loaded & (np.abs(impact.slip_after) > 1e-9)
        np.testing.assert_allclose(
            P_T[slips], (-mu * P_N * np.sign(impact.slip_after))[slips], rtol=1e-12, atol=1e-16
        )
    for t in np.linspace(first.start, motion.t_end, 101):
        gaps = mechanism.gaps(motion.state(t)[0])
        assert np.min(gaps) > -1e-11
        forces = motion.forces(t)
        scale = 1.0 + np.max(forces.normal)
        assert np.min(forces.normal) > -1e-8 * scale
        assert np.all(np.abs(forces.friction) <= mu * forces.normal + 1e-8 * scale)
        np.testing.assert_allclose(forces.normal * np.maximum(gaps, 0), 0, atol=1e-10 * scale)


@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.4])
def test_slider_crank_keeps_all_balances_until_its_20th_impact(restitution):
    motion = slider_crank(restitution, 20, 0.03)
    check_balances(motion)
    assert len(motion.impacts) >= 2
    # all first impacts are of both corners of one surface: no torque turns the slider in flight
    assert {impact.corners for impact in motion.impacts} == {(0, 1), (2, 3)}


def test_first_impact_of_the_slider_crank():
    """The flight to the first impact by the principle of virtual power of the three bodies, without a mass matrix.

    Crank pin at l1 e(th), slider at l1 e(th) + l2 e(ps). The power of inertia and weight vanishes for both angles; it is
    linear in (th'', ps''), so that two probes give its matrix.
    """
    l1, l2, m, J = 0.153, 0.306, (0.038, 0.038, 0.076), (7.4e-5, 5.9e-4)

    def direction(angle):
        return np.array([np.cos(angle), np.sin(angle)])

    def turned(angle):
        return np.array([-np.sin(angle), np.cos(angle)])

    def power(q, v, a):
        partials = [
            [(l1 / 2 * turned(q[0])), l1 * turned(q[0]), l1 * turned(q[0])],
            [np.zeros(2), l2 / 2 * turned(q[1]), l2 * turned(q[1])],
        ]
        weight = np.array([0.0, -G])
        result = np.array([J[0] * a[0], J[1] * a[1]])
        for k, (on_crank, on_rod) in enumerate([(0.5, 0.0), (1.0, 0.5), (1.0, 1.0)]):
            acceleration = on_crank * l1 * (
                a[0] * turned(q[0]) - v[0] ** 2 * direction(q[0])
            ) + on_rod * l2 * (a[1] * turned(q[1]) - v[1] ** 2 * direction(q[1]))
            inertia = m[k] * (acceleration - weight)
            result += [inertia @ partials[0][k], inertia @ partials[1][k]]
        return result

    def derivative(t, y):
        q, v = y[:2], y[2:]
        bias = power(q, v, np.zeros(2))
        matrix = np.array([power(q, v, unit) - bias for unit in np.eye(2)]).T
        return np.concatenate([v, np.linalg.solve(matrix, -bias)])

    def gap(t, y):
        return GAP - abs(l1 * np.sin(y[0]) + l2 * np.sin(y[1]))

    gap.terminal = True
    flight = solve_ivp(
        derivative, (0, 0.01), [0, 0, 150, -75], "DOP853", events=gap, rtol=1e-13, atol=1e-14
    )
    impact = slider_crank(0.4, 20, 0.03).impacts[0]
    # an error of 1e-13 in the angles over the normal speed 0.84 m/s
    np.testing.assert_allclose(impact.time, flight.t[-1], atol=1e-12)
    np.testing.assert_allclose(impact.q[:2], flight.y[:2, -1], atol=1e-12)
    np.testing.assert_allclose(impact.normal_after[[2, 3]], -0.4 * impact.normal_before[[2, 3]])


def test_steps_do_not_matter():
    """Another discretization differs by the tolerances, amplified by the impacts."""
    fine = slider_crank(0.4, 20, 0.03)
    coarse = slider_crank(0.4, 20, 0.03, 3.1e-4)
    bound = 1e-12
    for one, other in zip(fine.impacts, coarse.impacts, strict=True):
        # the error of the gap, 1e-15 m at most, over the speed
        bound += 1e-15 / one.speed
        assert abs(one.time - other.time) < bound and one.corners == other.corners


def angle_errors(engine, motion, restitution, step, instants, t_end):
    """Largest error of the angles at each instant of a run by time stepping."""
    run = load_engine(engine).simulate(
        scene_of(restitution), t_end=t_end, dt=step, fidelity="contact", output_step=5e-4
    )
    assert run.breakdown is None
    rows = np.searchsorted(run.t, instants - 1e-9)
    angles = np.stack([run[f"{body}.angle"][rows] for body in ("crank", "rod", "slider")], 1)
    exact = np.array([motion.state(t)[0] for t in instants])
    return np.max(np.abs(angles - exact), axis=1)


@pytest.mark.parametrize("restitution", [0.0, 0.4])
def test_moreau_converges_to_it(restitution):
    """Order 2 in the first flight, then a step of error of the time of each impact, whose jump it multiplies."""
    motion, instants = slider_crank(restitution, 20, 0.03), np.array([2.5e-3, 8e-3])
    flight, after = {}, {}
    for step in (1e-4, 1e-5, 1e-6):
        errors = angle_errors("moreau", motion, restitution, step, instants, 1e-2)
        flight[step], after[step] = errors
    assert 1.95 < np.log10(flight[1e-4] / flight[1e-5]) < 2.05
    jumps = sum(
        np.max(np.abs(impact.v_after - impact.v_before)[:2])
        for impact in motion.impacts
        if impact.time < instants[1]
    )
    for step in (1e-5, 1e-6):
        # the error of the flight grows with the square of the time
        assert after[step] < step * jumps + (8 / 2.5) ** 2 * flight[step]


@pytest.mark.long
@pytest.mark.parametrize("engine", ["moreau", "siconos"])
@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.4])
def test_order_of_time_stepping_over_the_whole_motion(engine, restitution):
    """The order until 0.025 s is 1 or more within its interval: 1 by the times of impacts, 2 by the midpoint rule."""
    if engine == "siconos":
        installed("siconos")
    motion = slider_crank(restitution)
    steps = np.array([1e-4, 5e-5, 2.5e-5, 1e-5])
    instants = np.arange(1, 51) * 5e-4
    errors = [
        np.max(angle_errors(engine, motion, restitution, step, instants, 0.025)) for step in steps
    ]
    order = fitted_exponent([(steps, np.array(errors))])
    assert order.value + order.uncertainty > 1 and errors[-1] < 1e-4


@pytest.mark.long
@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.4])
def test_the_whole_motion_keeps_all_balances(restitution):
    check_balances(slider_crank(restitution))


def test_other_scenes_are_refused():
    with pytest.raises(NotThisMechanism, match="motor"):
        slider_crank_with_clearance(load_scene("slider-crank"))
    with pytest.raises(NotThisMechanism, match="mus: found 0.02; expected mu = 0.01"):
        slider_crank_with_clearance(load_scene(SLIDER_CRANK, {"joints.guide.mus": 0.02}))
    with pytest.raises(NotThisMechanism, match="clearance: found"):
        ideal = {"guide.clearance": None, "guide.restitution": None}
        slider_crank_with_clearance(vary(load_scene(SLIDER_CRANK), ideal))
    for change, message in (
        ({"restitution": 1.5}, "restitution: found 1.5"),
        ({"clearance": 0.0}, "clearance: found 0.0"),
        ({"mu": -1.0}, "mu: found -1.0"),
    ):
        mechanism, _, _ = slider_crank_with_clearance(scene_of(0.4))
        with pytest.raises(ValueError, match=message):
            mechanism.with_gap(**change)
    with pytest.raises(ValueError, match="beyond its surface"):
        impacting_motion(box(), start(0, 0.03, 0), start(0, 0, 0), 1.0, 1e-2)
    with pytest.raises(ValueError, match="expected a time within"):
        impacting_motion(box(), start(0, 0, 0), start(0, 0, 0), 0.1, 1e-2).state(0.2)


def test_painleve_is_typed():
    """Sliding backwards on the rear corner needs 1/m + x^2/J > mu x y/J, here mu < 4.6; beyond there is no motion."""
    mechanism = box(20.0, 0.0)
    q = start(0, 0, 0.05)
    q[1] = -float(np.min(mechanism.gaps(q)[:2]))
    with pytest.raises(NoMotion, match="solution"):
        impacting_motion(mechanism, q, start(-3.0, 0, 0), 0.1, 1e-3)


def test_free_flight_has_no_forces():
    motion = impacting_motion(box(), start(0, 0, 0), start(0, 0, 0), 0.01, 1e-2)
    assert motion.phases[0].states == OPEN and not motion.forces(0.005).normal.any()
