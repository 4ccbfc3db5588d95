"""Pins whose friction depends on the force in them: closed forms, friction circles and inverse dynamics."""

from math import cos, pi, sin

import numpy as np
import pytest

from stiction.engines import EngineMissing, load_engine
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.energies import energies
from stiction.reference_impl.friction.pins_under_load import force_in_pin, take_loads
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.integration.coulomb_audit import audit
from stiction.reference_impl.multibody import mechanism as mechanisms
from stiction.reference_impl.multibody.banded_systems import open_cell
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.truths import NotThisMechanism, slider_crank_truth
from stiction.truths.reduced.pins_under_load import (
    BodyInMotion,
    LevelGuide,
    LoadedPin,
    inverse_dynamics,
    toggle_limit_with_guide,
    toggle_limits,
)

RTOLS = (1e-6, 1e-9, 1e-12)
TIMES_RTOL = 1e3
"""Error of a motion over the tolerance of a step: some hundred steps, amplified by ten."""
G = 9.81


def simulate(scene, rtol=1e-10, **arguments):
    run = ReferenceEngine().simulate(scene, rtol=rtol, **arguments)
    assert run.breakdown is None
    return run


def rotor(**pin):
    """A rotor on a journal through its centre of mass, which carries its weight."""
    return scene_from_dict(
        {
            "t_end": 3,
            "gravity": [0, -G],
            "bodies": {"rotor": {"mass": 2, "inertia": 0.05, "angular_velocity": 4}},
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["rotor", "ground"],
                    **{"mu": 0.2, "mus": 0.3, "radius": 0.03, **pin},
                }
            },
        }
    )


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("own", [0.0, 0.05])
def test_journal_under_constant_load(rtol, own):
    """The rotor runs down at the constant rate (mu r m g + friction) / I, and stops for good."""
    run = simulate(rotor(**({"friction": own} if own else {})), rtol)
    torque = 0.2 * 0.03 * 2 * G + own
    [event] = run.events
    assert (event.kind, event.joint) == ("stick", "pin")
    assert event.time == pytest.approx(4 * 0.05 / torque, rel=TIMES_RTOL * rtol)
    assert run["rotor.angle"][-1] == pytest.approx(0.05 * 16 / torque / 2, rel=TIMES_RTOL * rtol)
    slips = run["pin.mode"] != 0
    np.testing.assert_allclose(run["pin.friction"][slips], -torque, rtol=1e-12)
    np.testing.assert_allclose(run["pin.fy"], 2 * G, rtol=1e-12)


@pytest.mark.parametrize("rtol", RTOLS)
def test_journal_breaks_away_at_its_static_circle(rtol):
    """A growing force at the rim, r_rim F = mus r |R| with R = m g - F: F = mus r m g / (r_rim + mus r)."""
    scene = vary(
        rotor(),
        {
            "rotor.angular_velocity": None,
            "forces": {
                "pull": {
                    "type": "force",
                    "body": "rotor",
                    "point": [0.1, 0],
                    "direction": [0, 1],
                    "law": {"type": "linear", "rate": 1.0},
                }
            },
        },
    )
    circle = 0.3 * 0.03
    expected = circle * 2 * G / (0.1 + circle)
    run = simulate(scene, rtol, t_end=expected + 0.2)
    assert run.events[0].kind == "slip"
    assert run.events[0].time == pytest.approx(expected, rel=TIMES_RTOL * rtol)


def test_pendulum_loses_energy_by_the_forces_of_its_motion():
    """The force in the pin of a swinging bar is not its weight: friction by the columns of every sample."""
    scene = scene_from_dict(
        {
            "t_end": 10,
            "gravity": [0, -G],
            "bodies": {
                "bar": {
                    "mass": 1,
                    "inertia": 0.02,
                    "position": [0.3 * cos(0.5), 0.3 * sin(0.5)],
                    "angle": 0.5,
                }
            },
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[-0.3, 0], [0, 0]],
                    "mu": 0.3,
                    "mus": 0.4,
                    "radius": 0.05,
                }
            },
        }
    )
    run = simulate(scene, output_step=1e-3)
    force = np.hypot(run["bar.ax"], run["bar.ay"] + G)
    assert np.max(force) > 1.5 * np.min(force)
    slips = run["pin.mode"] != 0
    np.testing.assert_allclose(
        run["pin.friction"][slips], -(0.015 * force * run["pin.mode"])[slips], rtol=1e-9
    )
    assert np.all(np.abs(run["pin.friction"][~slips]) <= 0.02 * force[~slips] * (1 + 1e-9))
    assert [event.kind for event in run.events][-1] == "stick"
    frame = energies(run)
    assert np.max(np.abs(frame["balance"])) < 1e-5 * frame["kinetic"].max()
    found = audit(run, Mechanism(scene), 200)
    assert found.unsolved == 0 and found.acceleration < 1e-8 and found.complementarity < 1e-9


@pytest.mark.parametrize("rtol", RTOLS)
def test_force_that_passes_through_zero(rtol):
    """|R| = F |sin(w t)| has a kink at each zero; the rotor loses mu r F (1 - cos(w t)) / w, then as much again."""
    scene = vary(
        rotor(),
        {
            "gravity": None,
            "forces": {
                "shake": {
                    "type": "force",
                    "body": "rotor",
                    "direction": [1, 1],
                    "law": {"type": "sine", "amplitude": 20, "frequency": 2 * pi},
                }
            },
        },
    )
    run = simulate(scene, rtol, t_end=1.2)
    assert not run.events
    halves, rest = np.divmod(2 * run.t, 1)
    lost = 0.2 * 0.03 * 20 / (2 * pi) * (2 * halves + 1 - np.cos(pi * rest)) / 0.05
    np.testing.assert_allclose(run["rotor.omega"], 4 - lost, rtol=0, atol=TIMES_RTOL * rtol)


def crank_scene(guide_mu, static=1.2):
    """The slider-crank of the catalogue with pins under load and, unless None, friction of its guide."""
    pins = {"pivot": (0.2, 0.05), "crankpin": (0.15, 0.04), "pin": (0.25, 0.03)}
    changes = {"guide.mu": guide_mu}
    for name, (mu, radius) in pins.items():
        changes |= {f"{name}.mu": mu, f"{name}.mus": static * mu, f"{name}.radius": radius}
    smooth = load_scene("slider-crank")
    return smooth, vary(smooth, changes), {name: mu * r for name, (mu, r) in pins.items()}


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("guide_mu", [None, 0.2])
def test_slider_crank(rtol, guide_mu):
    """Torque of the motor and all forces by balances of the three bodies, with the closed form of their motion."""
    smooth, scene, circles = crank_scene(guide_mu)
    run = simulate(scene, rtol, output_step=0.05, t_end=2.0)
    assert {event.joint for event in run.events} >= {"pin"}
    events = np.array([event.time for event in run.events])
    true = slider_crank_truth(smooth)(run.t)
    compared = 0
    for i, t in enumerate(run.t):
        # at a dead centre the direction of the slider is about to change
        if np.min(np.abs(events - t)) < 1e-6 or abs(true["slider.vx"][i]) < 1e-6:
            continue
        compared += 1
        bodies = {
            name: BodyInMotion(
                body.mass,
                body.inertia,
                (true[f"{name}.x"][i], true[f"{name}.y"][i]),
                (true[f"{name}.ax"][i], true[f"{name}.ay"][i]),
                true[f"{name}.alpha"][i],
            )
            for name, body in scene.bodies.items()
        }
        crank, rod = true["crank.omega"][i], true["rod.omega"][i]
        end = np.array([cos(true["crank.angle"][i]), sin(true["crank.angle"][i])]) * 0.5
        slider = (true["slider.x"][i], true["slider.y"][i])
        pins = {
            "pivot": LoadedPin(("crank", "ground"), (0, 0), circles["pivot"], np.sign(crank)),
            "crankpin": LoadedPin(
                ("rod", "crank"), tuple(end), circles["crankpin"], np.sign(rod - crank)
            ),
            "pin": LoadedPin(("rod", "slider"), slider, circles["pin"], np.sign(rod)),
        }
        guides = {
            "guide": LevelGuide("slider", guide_mu or 0.0, int(np.sign(true["slider.vx"][i])))
        }
        forces = inverse_dynamics(bodies, pins, guides, ("crank", "ground"), (0, -G))
        size = max(abs(value) for value in forces.values())
        for column, value in forces.items():
            name = "motor.effort" if column == "effort" else column
            if name in run.columns:
                assert run[name][i] == pytest.approx(value, abs=TIMES_RTOL * rtol * size), name
    assert compared > 30


def four_bar_motion(crank, rate, lengths):
    """Angles, rates and angular accelerations of the bars of a crank-rocker at constant speed, by its loop."""
    a, b, c, d = lengths
    begin = a * np.exp(1j * crank)
    span = d - begin
    distance = abs(span)
    along = (b**2 - c**2 + distance**2) / (2 * distance)
    joint = begin + span / distance * (along + 1j * np.sqrt(b**2 - along**2))
    coupler, rocker = np.angle(joint - begin), np.angle(joint - d)

    def solve(right):
        """b x i e^(i coupler) - c y i e^(i rocker) = right, for x and y."""
        first, second = b * 1j * np.exp(1j * coupler), -c * 1j * np.exp(1j * rocker)
        matrix = [[first.real, second.real], [first.imag, second.imag]]
        return np.linalg.solve(matrix, [right.real, right.imag])

    rates = solve(-a * rate * 1j * np.exp(1j * crank))
    centripetal = a * rate**2 * np.exp(1j * crank)
    centripetal += b * rates[0] ** 2 * np.exp(1j * coupler)
    centripetal -= c * rates[1] ** 2 * np.exp(1j * rocker)
    return (crank, coupler, rocker), (rate, *rates), (0.0, *solve(centripetal))


@pytest.mark.parametrize("rtol", RTOLS)
def test_four_bar(rtol):
    """A driven crank-rocker: the torque of the motor and the forces in its four pins."""
    lengths, w = (0.2, 0.5, 0.4, 0.45), 6.0
    names = ("crank", "coupler", "rocker")
    mass, inertia, centre = (0.5, 1.0, 0.7), (0.01, 0.03, 0.02), (0.08, 0.2, 0.25)
    circles = {"A": 0.006, "B": 0.004, "C": 0.005, "D": 0.0075}

    def bodies_at(crank):
        angles, rates, accelerations = four_bar_motion(crank, w, lengths)
        ends = (0.0, lengths[0] * np.exp(1j * angles[0]), lengths[3])
        # velocity and acceleration of the ends at which the bars are counted from
        end_rates = (0.0, 1j * w * ends[1], 0.0)
        end_accelerations = (0.0, -(w**2) * ends[1], 0.0)
        places, velocities, found = [], [], []
        for i in range(3):
            arm = centre[i] * np.exp(1j * angles[i])
            places.append(ends[i] + arm)
            velocities.append(end_rates[i] + 1j * rates[i] * arm)
            found.append(end_accelerations[i] + (1j * accelerations[i] - rates[i] ** 2) * arm)
        return angles, rates, accelerations, ends, places, velocities, found

    def pins_at(ends, angles, rates):
        middle = ends[1] + lengths[1] * np.exp(1j * angles[1])
        crank, coupler, rocker = rates
        return {
            name: LoadedPin(bodies, (place.real, place.imag), circles[name], int(np.sign(rate)))
            for name, bodies, place, rate in (
                ("A", ("crank", "ground"), 0j, crank),
                ("B", ("coupler", "crank"), ends[1], coupler - crank),
                ("C", ("rocker", "coupler"), middle, rocker - coupler),
                ("D", ("rocker", "ground"), lengths[3] + 0j, rocker),
            )
        }

    angles, rates, _, ends, places, velocities, _ = bodies_at(0.4)
    points = {
        "A": ([-0.08, 0], [0, 0]),
        "B": ([-0.2, 0], [0.12, 0]),
        "C": ([0.15, 0], [0.3, 0]),
        "D": ([-0.25, 0], [0.45, 0]),
    }
    scene = scene_from_dict(
        {
            "t_end": 1.0,
            "gravity": [0, -G],
            "bodies": {
                name: {
                    "mass": mass[i],
                    "inertia": inertia[i],
                    "position": [places[i].real, places[i].imag],
                    "angle": angles[i],
                    "velocity": [velocities[i].real, velocities[i].imag],
                    "angular_velocity": rates[i],
                }
                for i, name in enumerate(names)
            },
            "joints": {
                name: {
                    "type": "revolute",
                    "bodies": list(pin.bodies),
                    "points": [list(point) for point in points[name]],
                    "mu": 0.25,
                    "radius": circles[name] / 0.25,
                }
                for name, pin in pins_at(ends, angles, rates).items()
            },
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["crank", "ground"],
                    "law": {"type": "linear", "offset": 0.4, "rate": w},
                }
            },
        }
    )
    run = simulate(scene, rtol, output_step=0.02, assemble=True)
    events = np.array([event.time for event in run.events])
    assert len(events) >= 2
    for i, t in enumerate(run.t):
        if np.min(np.abs(events - t)) < 1e-6:
            continue
        angles, rates, accelerations, ends, places, _, found = bodies_at(0.4 + w * t)
        bodies = {
            name: BodyInMotion(
                mass[k],
                inertia[k],
                (places[k].real, places[k].imag),
                (found[k].real, found[k].imag),
                accelerations[k],
            )
            for k, name in enumerate(names)
        }
        pins = pins_at(ends, angles, rates)
        forces = inverse_dynamics(bodies, pins, {}, ("crank", "ground"), (0, -G))
        size = max(abs(value) for value in forces.values())
        for column, value in forces.items():
            name = "motor.effort" if column == "effort" else column
            assert run[name][i] == pytest.approx(value, abs=TIMES_RTOL * rtol * size), name


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("angle", [0.3, 0.08, 0.02])
def test_toggle(rtol, angle):
    """The load at which a toggle at rest stretches and folds; at 0.02 rad it locks itself, and folds under a pull only."""
    limits = toggle_limits(angle, 0.5, 100.0, (0.004, 0.009, 0.00625))
    middle = sum(limits) / 2
    assert (limits[1] < 0) == (angle == 0.02)
    for limit in limits:
        scene = load_scene(
            "toggle-pins-under-load", {"angle": angle, "load": middle, "rate": limit - middle}
        )
        run = simulate(scene, rtol, t_end=1.1, output_step=0.05)
        assert [(event.kind, event.joint) for event in run.events[:3]] == [
            ("slip", "A"),
            ("slip", "B"),
            ("slip", "C"),
        ]
        times = [event.time for event in run.events[:3]]
        np.testing.assert_allclose(times, 1.0, rtol=0, atol=TIMES_RTOL * rtol)
        rests = run.t < 1.0 - 1e-3
        for name, circle in (("A", 0.004), ("B", 0.009), ("C", 0.00625)):
            force = np.hypot(run[f"{name}.fx"], run[f"{name}.fy"])[rests]
            assert np.all(np.abs(run[f"{name}.friction"][rests]) <= circle * force * (1 + 1e-9))
        # it stretches downwards, and folds upwards
        assert np.sign(run["first.omega"][-1]) == -np.sign(limit - middle)


@pytest.mark.parametrize("angle", [0.3, 0.08])
@pytest.mark.parametrize("coefficient", [0.0, 0.15])
def test_toggle_on_a_guide_with_friction(angle, coefficient):
    """Four joints share the load; they give way together, where all are at their limits."""
    circles = (0.004, 0.009, 0.00625)
    limits = [
        toggle_limit_with_guide(angle, 0.5, 100.0, circles, coefficient, sign) for sign in (1, -1)
    ]
    if coefficient == 0.0:
        np.testing.assert_allclose(limits, toggle_limits(angle, 0.5, 100.0, circles), rtol=1e-9)
    joints = {"A", "B", "C", "guide"} if coefficient else {"A", "B", "C"}
    middle = sum(limits) / 2
    for limit in limits:
        changes = {"angle": angle, "load": middle, "rate": limit - middle}
        if coefficient:
            changes |= {"guide.mu": 0.9 * coefficient, "guide.mus": coefficient}
        run = simulate(load_scene("toggle-pins-under-load", changes), 1e-9, t_end=1.05)
        first = run.events[: len(joints)]
        assert {(event.kind, event.joint) for event in first} == {("slip", name) for name in joints}
        times = [event.time for event in first]
        np.testing.assert_allclose(times, 1.0, rtol=0, atol=TIMES_RTOL * 1e-9)


def test_toggle_locks_itself():
    """Without any load the thrust, however large, does not fold it; with smaller friction circles it does."""
    for thrust in (1.0, 1e6):
        changes = {"thrust": thrust, "load": 0.0, "rate": 0.0}
        run = simulate(load_scene("toggle-pins-under-load", changes), t_end=0.5)
        assert not run.events and np.max(np.abs(run["first.omega"])) < 1e-12 * thrust
        slippery = {f"{name}.radius": 0.01 for name in ("A", "B", "C")}
        run = simulate(load_scene("toggle-pins-under-load", changes | slippery), t_end=1e-3)
        assert run["first.omega"][-1] > 0


def test_gain_of_one_ends_the_run_with_the_name_of_the_pin():
    """A rotor with its journal as large as its radius of gyration times 1 / mu: friction could hold it by itself."""
    scene = scene_from_dict(
        {
            "t_end": 1,
            "gravity": [0, -G],
            "bodies": {
                "bar": {"mass": 1, "inertia": 0.01, "position": [0.3, 0], "angular_velocity": 0}
            },
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[-0.3, 0], [0, 0]],
                    "mu": 2.0,
                    "radius": 0.4,
                }
            },
        }
    )
    # a torque tau changes the force across the bar by m l / (I + m l^2) tau
    assert 0.8 * 0.3 / (0.01 + 0.09) > 1
    run = ReferenceEngine().simulate(scene, rtol=1e-9)
    assert run.breakdown is not None
    assert (run.breakdown.kind, run.breakdown.guide) == ("several solutions", "pin")
    turning = {"bar.angular_velocity": 3.0, "bar.velocity": [0.0, 0.9], "pin.mus": 2.0}
    run = ReferenceEngine().simulate(vary(scene, turning), rtol=1e-9)
    # in slip the loads do not converge
    assert run.breakdown is not None and run.breakdown.time == 0.0
    assert (run.breakdown.kind, run.breakdown.guide) == ("no solution", "pin")
    # the gains themselves, in slip and at rest
    mechanism = Mechanism(vary(scene, {"pin.mus": 3.0}))
    m, w = mechanism.arrays, mechanism.workspace
    row_form(m, w, 0.0, *mechanism.initial_state())
    for mode, coefficient in ((1, 2.0), (-1, 2.0), (0, 3.0)):
        gain, joint = gain_of_mode(m, w, np.array([mode]))
        assert joint == 0 and gain == pytest.approx(coefficient * 0.4 * 0.3 / 0.1, rel=1e-12)
    below = ReferenceEngine().simulate(vary(scene, {"pin.mu": 0.8}), rtol=1e-9)
    assert below.breakdown is None


def test_paper_scheme_converges_to_the_same_motion():
    """Of order 4 while the pendulum swings one way."""
    scene = scene_from_dict(
        {
            "t_end": 0.5,
            "gravity": [0, -G],
            "bodies": {"bar": {"mass": 1, "inertia": 0.02, "position": [0.3, 0]}},
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[-0.3, 0], [0, 0]],
                    "mu": 0.3,
                    "radius": 0.05,
                }
            },
            "stabilization": {"method": "none"},
        }
    )
    exact = simulate(scene, 1e-13, t_end=0.5)["bar.angle"][-1]
    errors = []
    for dt in (0.02, 0.01):
        run = ReferenceEngine().simulate(scene, dt=dt, method="paper", output_step=0.5)
        errors.append(abs(run["bar.angle"][-1] - exact))
    assert errors[1] < 1e-6 and errors[0] / errors[1] > 12
    with pytest.raises(SceneError, match="joints.pin.mu: found 0.3"):
        ReferenceEngine().simulate(scene, dt=0.01, method="textbook")


def row_of_pendulums():
    """Six pendulums on sliders in a row, with springs between the sliders: a cell for each."""
    count = 6
    bodies, joints, springs = {}, {}, {}
    for i in range(count):
        bodies[f"slider-{i}"] = {
            "mass": 1,
            "inertia": 1,
            "position": [i, 0],
            "velocity": [0.5 + 0.1 * i, 0],
        }
        bodies[f"bob-{i}"] = {
            "mass": 0.5 + 0.1 * i,
            "inertia": 0.02,
            "position": [i + 0.3, 0],
            "velocity": [0.5 + 0.1 * i, 0],
        }
        joints[f"guide-{i}"] = {
            "type": "translational",
            "slider": f"slider-{i}",
            "mu": 0.1,
            "mus": 0.15,
            "stribeck_velocity": 0.1,
        }
        joints[f"pin-{i}"] = {
            "type": "revolute",
            "bodies": [f"bob-{i}", f"slider-{i}"],
            "points": [[-0.3, 0], [0, 0]],
            "mu": 0.2,
            "mus": 0.3,
            "radius": 0.05,
            "stribeck_velocity": 0.5,
        }
        if i:
            springs[f"spring-{i}"] = {
                "type": "linear",
                "bodies": [f"slider-{i}", f"slider-{i - 1}"],
                "axis": [1, 0],
                "stiffness": 2,
                "rest_length": 1,
            }
    return scene_from_dict(
        {
            "t_end": 2,
            "gravity": [0, -G],
            "bodies": bodies,
            "joints": joints,
            "springs": springs,
        }
    )


def test_cells_give_the_same_motion(monkeypatch):
    """Cell by cell, and as one dense system."""
    scene = row_of_pendulums()
    assert len(Mechanism(scene).arrays.separate) == 6
    by_cells = simulate(scene, 1e-11)
    monkeypatch.setattr(mechanisms, "DENSE", 1000)
    assert not Mechanism(scene).arrays.separate
    dense = simulate(scene, 1e-11)
    assert [(e.kind, e.joint) for e in by_cells.events] == [(e.kind, e.joint) for e in dense.events]
    assert len(dense.events) > 10
    for one, other in zip(by_cells.events, dense.events):
        assert one.time == pytest.approx(other.time, abs=1e-8)
    for name in scene.bodies:
        np.testing.assert_allclose(by_cells[f"{name}.x"], dense[f"{name}.x"], rtol=0, atol=1e-8)


def test_cells_get_the_laws_of_the_state():
    """Coefficients at the speed of slip, and bounds by the forces: those of the whole, in every cell."""
    mechanism = Mechanism(row_of_pendulums())
    m, w = mechanism.arrays, mechanism.workspace
    q, v = mechanism.initial_state()
    row_form(m, w, 0.0, q, v)
    w.force[:] = np.arange(len(w.force))
    take_loads(m, w)
    for c, cell in enumerate(m.separate):
        joints = open_cell(m, w, c)
        for field in ("mu", "own_bound", "pin_mu", "load", "bound", "static_bound"):
            np.testing.assert_array_equal(cell.friction[field], m.friction[field][joints])
    assert len(set(m.friction["mu"])) > 6  # each slider has a speed of its own


def test_loads_are_the_forces_in_the_pins():
    mechanism = Mechanism(rotor())
    m, w = mechanism.arrays, mechanism.workspace
    w.force[:2] = 3.0, 4.0
    assert force_in_pin(m, 0, w.force) == 5.0
    take_loads(m, w)
    radius = mechanism.slip_radius[0]
    assert m.friction["bound"][0] * radius == pytest.approx(0.2 * 0.03 * 5.0, rel=1e-15)
    assert m.friction["static_bound"][0] * radius == pytest.approx(0.3 * 0.03 * 5.0, rel=1e-15)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"pin.radius": None}, "expected the radius of the journal too"),
        ({"pin.radius": 0.0}, "pin.radius: found 0"),
        ({"pin.mu": None, "pin.mus": None}, "expected a coefficient of friction"),
        ({"pin.mus": 0.1}, "expected at least mu = 0.2"),
        ({"pin.mu": -0.1}, "pin.mu: found -0.1"),
    ],
)
def test_keys_without_a_meaning_are_refused(changes, problem):
    with pytest.raises(SceneError, match=problem):
        vary(rotor(), changes)


@pytest.mark.parametrize("engine", ["moreau", "pybullet", "pymunk", "exudyn"])
def test_engines_refuse_in_one_sentence(engine):
    try:
        one = load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(str(missing).splitlines()[0][:90])
    for fidelity in one.capabilities.fidelities:
        assert one.reason_to_refuse(rotor(), fidelity) == (
            f"joints.pin: {engine} does not yet take friction of a pin that depends on the force in it"
        )


def test_truths_without_the_effect_refuse_the_scene():
    with pytest.raises(NotThisMechanism, match="pivot.mu"):
        slider_crank_truth(crank_scene(None)[1])


def test_driven_angle_holds_a_pin_at_rest():
    """A pin whose angle a drive keeps stays there; drive and friction share the moment in a way that is left open."""
    scene = vary(
        rotor(),
        {
            "rotor.angular_velocity": None,
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["rotor", "ground"],
                    "law": {"type": "constant", "value": 0},
                }
            },
            "forces": {
                "torque": {
                    "type": "torque",
                    "body": "rotor",
                    "law": {"type": "sine", "amplitude": 3, "frequency": pi},
                }
            },
        },
    )
    run = simulate(scene)
    assert not run.events and np.max(np.abs(run["rotor.omega"])) < 1e-12
    assert np.all(np.isnan(run["motor.effort"])) and np.all(np.isnan(run["pin.friction"]))
