"""Springs that act on one side only: stops, bumpers and cables, against closed forms, energy and random mechanisms."""

import numpy as np
import pytest
from fuzz.several_freedoms import RESERVE, differences, scene_with_one_sided_springs

from stiction.engines import load_engine
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.energies import energies
from stiction.scenes import SceneError, scene_from_dict, vary
from stiction.truths.closed_form.one_sided import Drop, MassBetweenStops, Stop
from stiction.truths.enumerated_motion import simulate as enumerate_motion

RTOLS = (1e-6, 1e-9, 1e-12)
TIMES_RTOL = 1e3
"""Error of a motion over the tolerance of a step: some hundred steps, amplified by ten."""
G = 9.81
T_END = 0.6


def simulate(scene, rtol=1e-10, **arguments):
    run = ReferenceEngine().simulate(scene, rtol=rtol, **arguments)
    assert run.breakdown is None
    return run


def times_of(run, kind, joint=None):
    return [
        event.time for event in run.events if event.kind == kind and joint in (None, event.joint)
    ]


def stop(stiffness, rest, acts="push", damping=0.0, direction=(1, 0)):
    return {
        "type": "linear",
        "bodies": ["block", "ground"],
        "axis": list(direction),
        "stiffness": stiffness,
        "damping": damping,
        "rest_length": rest,
        "acts": acts,
    }


def block(
    springs, *, x=0.0, velocity=0.0, mass=2.0, direction=(1, 0), gravity=0.0, t_end=5.0, **guide
):
    """A block on a guide of a direction, with springs along it."""
    return scene_from_dict(
        {
            "t_end": t_end,
            "gravity": [0, -gravity],
            "bodies": {
                "block": {
                    "mass": mass,
                    "inertia": 1,
                    "position": [x * direction[0], x * direction[1]],
                    "velocity": [velocity * direction[0], velocity * direction[1]],
                }
            },
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "direction": list(direction),
                    **guide,
                }
            },
            "springs": springs,
        }
    )


@pytest.mark.parametrize("rtol", RTOLS)
def test_mass_between_two_stops(rtol):
    """Flights and half swings, one after another; one stop pushes to the right, the other pulls to the left."""
    truth = MassBetweenStops(Stop(2.0, 800.0), distance=0.6, speed=1.5)
    scene = block(
        {"left": stop(800.0, -0.3, "push"), "right": stop(800.0, 0.3, "pull")},
        velocity=1.5,
        t_end=4.0 * truth.period,
    )
    run = simulate(scene, rtol)
    atol = TIMES_RTOL * rtol
    np.testing.assert_allclose(run["block.x"], truth.position(run.t), rtol=0, atol=atol)
    first = 0.2 + truth.period / 2 * np.arange(8)
    expected = [time for time in first if time < scene.t_end]
    np.testing.assert_allclose(times_of(run, "contact"), expected, rtol=0, atol=atol)
    assert {event.joint for event in run.events} == {"left", "right"}


@pytest.mark.parametrize("rtol", RTOLS)
def test_bouncing_mass(rtol):
    """Period and depth of a mass that falls on a stop, from the energy."""
    truth = Drop(mass=2.0, stiffness=3000.0, height=0.4, gravity=G)
    scene = block(
        {"floor": stop(3000.0, 0.1, direction=(0, 1))},
        x=0.5,
        direction=(0, 1),
        gravity=G,
        t_end=3.05 * truth.period,
    )
    run = simulate(scene, rtol, output_step=1e-4)
    atol = TIMES_RTOL * rtol
    contacts, releases = times_of(run, "contact"), times_of(run, "release")
    np.testing.assert_allclose(
        contacts, truth.contact + truth.period * np.arange(3), rtol=0, atol=atol
    )
    np.testing.assert_allclose(np.array(releases) - contacts, truth.contact_time, rtol=0, atol=atol)
    # sampled at 1e-4 s, the deepest sample is off by a (1e-4)^2/8 at most, a about k u/m = 113 m/s^2
    assert np.min(run["block.y"]) == pytest.approx(0.1 - truth.depth, abs=2e-7 + atol)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("damping", [1.0, 40.0])
def test_damped_stop_does_not_pull(rtol, damping):
    """The force ends before the depth does, and the mass leaves with the coefficient of restitution."""
    truth = Stop(2.0, 800.0, damping)
    scene = block({"wall": stop(800.0, -0.3, damping=damping)}, velocity=-1.5, t_end=1.0)
    run = simulate(scene, rtol)
    atol = TIMES_RTOL * rtol
    [contact], [release] = times_of(run, "contact"), times_of(run, "release")
    assert contact == pytest.approx(0.2, abs=atol)
    assert release - contact == pytest.approx(truth.contact_time, abs=atol)
    assert run["block.vx"][-1] == pytest.approx(1.5 * truth.restitution, abs=atol)
    # the stop pushes to the right, at most; the force jumps to c v at the contact
    assert np.min(run["block.ax"]) >= -1e-9
    [event] = [event for event in run.events if event.kind == "contact"]
    assert event.before["block.ax"] == 0.0
    assert event.after["block.ax"] == pytest.approx(damping * 1.5 / 2.0, rel=1e-6)


def test_elasto_gap_of_modelica():
    """Modelica.Mechanics.Translational.Examples.ElastoGap, lower mass, up to its first release.

    m = 1 kg between gaps of c = 10 N/m and d = 1.5 N s/m that are 1.5 m long and fixed at -2 m and 2 m; it starts at
    rest at 2 m, 1.5 m deep in the right one. There Modelica limits the damper's force as this format does: the total is
    no pull. (At a contact Modelica also limits the damper by the spring's force; this format does not.) With
    u = 1.5 m, a = 0.75/s, p^2 = 10 - a^2: u'' + 1.5 u' + 10 u = 0 until 10 u + 1.5 u' = 0.
    """
    right = stop(10.0, 1.5, damping=1.5, direction=(-1, 0)) | {"points": [[0, 0], [2, 0]]}
    left = stop(10.0, 1.5, damping=1.5) | {"points": [[0, 0], [-2, 0]]}
    scene = block({"right": right, "left": left}, x=2.0, mass=1.0, t_end=3.0)
    run = simulate(scene, 1e-11)
    a = 0.75
    p = np.sqrt(10.0 - a**2)
    # u = 1.5 exp(-a t) (cos p t + a/p sin p t), u' = -15/p exp(-a t) sin p t
    release = np.arctan2(p, 1.5 * 10.0 / 10.0 - a) / p
    assert times_of(run, "release", "right")[0] == pytest.approx(release, abs=1e-9)
    speed = 15.0 / p * np.exp(-a * release) * np.sin(p * release)
    before_left = run.t < times_of(run, "contact", "left")[0]
    flies = before_left & (run.t > release)
    np.testing.assert_allclose(run["block.vx"][flies], -speed, rtol=1e-9)


def test_bungee_jump():
    """Beer & Johnston, Vector Mechanics for Engineers: Dynamics, Problem 13.62: the cable is slack for 85 ft.

    A tower of 130 ft, a cable of 85 ft that 600 lb stretch to 100 ft when dropped, a man of 186 lb: how close to the
    ground does he come? In feet, pounds and slugs. From the energy, 186 (130 - y) = k/2 (45 - y)^2. The book has 37.0
    ft, with the rounded coefficients 266.7 y^2 - 23815 y + 515827 = 0.
    """
    stiffness = 2 * 600.0 * 100.0 / 15.0**2
    cable = stop(stiffness, 85.0, "pull", direction=(0, -1)) | {"points": [[0, 0], [0, 130.0]]}
    scene = block(
        {"cable": cable}, x=130.0, mass=186.0 / 32.2, direction=(0, 1), gravity=32.2, t_end=5.0
    )
    run = simulate(scene, output_step=1e-3)
    lowest = np.min(run["block.y"])
    half, linear, constant = (
        stiffness / 2,
        90.0 * stiffness / 2 - 186.0,
        45.0**2 * stiffness / 2 - 186.0 * 130.0,
    )
    exact = (linear - np.sqrt(linear**2 - 4 * half * constant)) / (2 * half)
    # sampled at 1e-3 s, the lowest sample is off by a (1e-3)^2/8 at most, a about 6 g
    assert lowest == pytest.approx(exact, abs=5e-5)
    assert lowest == pytest.approx(37.0, abs=0.1)
    assert times_of(run, "contact")[0] == pytest.approx(np.sqrt(2 * 85.0 / 32.2), abs=1e-8)


def test_cable_goes_slack():
    """A ball on a cable is thrown up beside its anchor: a parabola while the cable is slack, tight again beyond it."""
    scene = scene_from_dict(
        {
            "t_end": 1.0,
            "gravity": [0, -G],
            "bodies": {
                "ball": {"mass": 0.5, "inertia": 1, "position": [0.3, 0], "velocity": [0, 2.0]}
            },
            "springs": {
                "cable": {
                    "type": "linear",
                    "bodies": ["ball", "ground"],
                    "stiffness": 400.0,
                    "rest_length": 0.4,
                    "acts": "pull",
                }
            },
        }
    )
    run = simulate(scene)
    tight = times_of(run, "contact")[0]
    height = 2.0 * tight - G * tight**2 / 2
    assert np.hypot(0.3, height) == pytest.approx(0.4, abs=1e-9)
    flies = run.t < tight
    np.testing.assert_allclose(
        run["ball.y"][flies], (2.0 * run.t - G * run.t**2 / 2)[flies], rtol=0, atol=1e-9
    )
    length = np.hypot(run["ball.x"], run["ball.y"])
    assert np.max(length) > 0.4 and times_of(run, "release")


@pytest.mark.parametrize("acts", ["push", "pull"])
def test_torsional_stop(acts):
    """An arm that turns into a stop of its angle: a half swing, as of a mass."""
    side = -1.0 if acts == "push" else 1.0
    scene = scene_from_dict(
        {
            "t_end": 2,
            "bodies": {"arm": {"mass": 1, "inertia": 0.2, "angular_velocity": side * 2.0}},
            "joints": {"pin": {"type": "revolute", "bodies": ["arm", "ground"]}},
            "springs": {
                "stop": {
                    "type": "torsional",
                    "bodies": ["arm", "ground"],
                    "stiffness": 50.0,
                    "damping": 0.5,
                    "rest_angle": side * 0.8,
                    "acts": acts,
                }
            },
        }
    )
    truth = Stop(0.2, 50.0, 0.5)
    run = simulate(scene)
    assert times_of(run, "contact") == pytest.approx([0.4], abs=1e-9)
    assert times_of(run, "release") == pytest.approx([0.4 + truth.contact_time], abs=1e-8)
    assert run["arm.omega"][-1] == pytest.approx(-side * 2.0 * truth.restitution, abs=1e-8)


@pytest.mark.parametrize("damping", [0.0, 6.0])
def test_stop_breaks_friction(damping):
    """A stop that jumps at contact changes the modes of guides: a block at rest on another that is hit leaves."""
    scene = scene_from_dict(
        {
            "t_end": 1.0,
            "gravity": [0, -G],
            "bodies": {
                "cart": {"mass": 3, "inertia": 1, "velocity": [1.0, 0]},
                "block": {"mass": 1, "inertia": 1, "velocity": [1.0, 0]},
            },
            "joints": {
                "rail": {"type": "translational", "slider": "cart"},
                "bed": {"type": "translational", "slider": "block", "guide": "cart", "mu": 0.2},
            },
            "springs": {
                "wall": {
                    "type": "linear",
                    "bodies": ["cart", "ground"],
                    "axis": [1, 0],
                    "stiffness": 900.0,
                    "damping": damping,
                    "rest_length": 0.25,
                    "acts": "pull",
                }
            },
        }
    )
    run = simulate(scene)
    kinds = [(event.kind, event.joint) for event in run.events[:2]]
    assert kinds == [("contact", "wall"), ("slip", "bed")]
    # the block slides when the cart is braked by more than mu g: k u + c v = (m + M) mu g
    contact, slip = (event.time for event in run.events[:2])
    assert contact == pytest.approx(0.25, abs=1e-9)
    if damping * 1.0 < 4.0 * 0.2 * G:
        w, a = np.sqrt(900.0 / 4.0), damping / 8.0
        p = np.sqrt(w**2 - a**2)
        s = slip - contact
        depth = np.exp(-a * s) * np.sin(p * s) / p
        rate = np.exp(-a * s) * (np.cos(p * s) - a / p * np.sin(p * s))
        assert 900.0 * depth + damping * rate == pytest.approx(4.0 * 0.2 * G, rel=1e-6)
    motion = enumerate_motion(scene, 1.0)
    assert differences(scene, motion, run, 1e-10) == []


def test_jump_breaks_friction_at_once():
    """A damper strong enough lets the block slide at the instant of the contact."""
    hit = block(
        {"wall": stop(900.0, 0.25, "pull", damping=50.0)}, velocity=1.0, mass=3.0, gravity=G
    )
    bodies = {"bodies.load": {"mass": 1, "inertia": 1, "velocity": [1.0, 0]}}
    bed = {"type": "translational", "slider": "load", "guide": "block", "mu": 0.2}
    run = simulate(vary(hit, {**bodies, "joints.bed": bed}))
    first, second = run.events[:2]
    assert (first.kind, second.kind, second.joint) == ("contact", "slip", "bed")
    assert first.time == second.time


@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_energy_is_balanced(damping):
    """Damping included: what a spring that is clamped gives is lost."""
    scene = block(
        {"floor": stop(3000.0, 0.1, damping=damping, direction=(0, 1))},
        x=0.5,
        direction=(0, 1),
        gravity=G,
        t_end=2.0,
    )
    table = energies(simulate(scene, output_step=1e-4))
    exchanged = np.ptp(table["kinetic"])
    assert np.max(np.abs(table["balance"])) < 2e-5 * exchanged
    if damping:
        lost = table["floor.dissipated"].to_numpy()
        assert np.all(np.diff(lost) > -1e-12) and lost[-1] > 0.1 * exchanged


def test_fast_rotor_does_not_pass_a_stop_unseen():
    """A balanced rotor moves without error of any step, and touches a cable once in a turn."""
    scene = scene_from_dict(
        {
            "t_end": 1.0,
            "bodies": {"rotor": {"mass": 1, "inertia": 1.0, "angular_velocity": 40.0}},
            "joints": {"pin": {"type": "revolute", "bodies": ["rotor", "ground"]}},
            "springs": {
                "cable": {
                    "type": "linear",
                    "bodies": ["rotor", "ground"],
                    "points": [[0.2, 0], [0.5, 0]],
                    "stiffness": 1e-9,
                    "rest_length": 0.699,
                    "acts": "pull",
                }
            },
        }
    )
    run = simulate(scene, 1e-6)
    # tight within a small angle of pi: 40/(2 pi) turns, from the angle 0
    assert len(times_of(run, "contact")) == len(times_of(run, "release")) == 6


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms(i):
    """Stops of guides and pins, cables, with and without damping, beside friction, by enumeration of modes."""
    scene = scene_with_one_sided_springs(9, i)
    motion = enumerate_motion(scene, T_END)
    assert motion.breakdown is None and motion.violation < RESERVE * 1e-11
    run = simulate(scene, 1e-9, t_end=T_END)
    assert differences(scene, motion, run, 1e-9) == []


@pytest.mark.long
@pytest.mark.parametrize("block_of", range(12))
def test_hundreds_of_random_mechanisms(block_of):
    """Nothing is silently wrong."""
    for i in range(300)[block_of::12]:
        scene = scene_with_one_sided_springs(17, i)
        motion = enumerate_motion(scene, 1.0)
        run = ReferenceEngine().simulate(scene, t_end=1.0, rtol=1e-10)
        assert run.breakdown or not motion.breakdown, i
        assert differences(scene, motion, run, 1e-10) == [], i


def test_fixed_steps_and_moreau_converge():
    """The paper's scheme and Moreau's take the state of a spring from positions and velocities."""
    scene = block(
        {"floor": stop(3000.0, 0.1, damping=20.0, direction=(0, 1))},
        x=0.5,
        direction=(0, 1),
        gravity=G,
        t_end=1.0,
    )
    true = simulate(scene)
    for engine, fidelity in (("reference", "joint"), ("moreau", "contact")):
        errors = [
            np.max(np.abs(run["block.y"] - true["block.y"]))
            for run in (
                load_engine(engine).simulate(scene, dt=dt, fidelity=fidelity)
                for dt in (1e-3, 2.5e-4, 6.25e-5)
            )
        ]
        assert errors[-1] < errors[0] / 5 and errors[-1] < 2e-3


def test_a_push_needs_a_length():
    """No distance is below zero: a spring that pushes between two points has a rest length, or an axis."""
    spring = {"type": "linear", "bodies": ["block", "ground"], "stiffness": 1.0, "acts": "push"}
    with pytest.raises(SceneError, match="rest_length"):
        block({"stop": spring})
    with pytest.raises(SceneError, match="acts"):
        block({"stop": {**stop(1.0, 0.0), "acts": "pushes"}})


def test_stop_along_an_axis_that_turns():
    """The axis of a stop turns with a body: the force acts along one line on both, so that momentum is kept.

    A puck on a turning table without bearings: neither momentum nor moment of momentum of both together changes, and
    the energy is that of the start.
    """
    scene = scene_from_dict(
        {
            "t_end": 2.0,
            "bodies": {
                "table": {"mass": 2, "inertia": 0.5, "angular_velocity": 1.5},
                "puck": {
                    "mass": 1,
                    "inertia": 0.1,
                    "position": [0.6, 0.1],
                    "velocity": [-1.0, 0.4],
                },
            },
            "springs": {
                "stop": {
                    "type": "linear",
                    "bodies": ["puck", "table"],
                    "points": [[0.05, 0.0], [0.1, 0.05]],
                    "axis": [1.0, 0.2],
                    "stiffness": 80.0,
                    "rest_length": 0.3,
                    "acts": "push",
                }
            },
        }
    )
    run = simulate(scene, 1e-12)
    assert [event.kind for event in run.events[:2]] == ["contact", "release"]

    def total(label):
        return sum(scene.bodies[name].mass * run[f"{name}.{label}"] for name in scene.bodies)

    spin = sum(
        scene.bodies[name].mass
        * (run[f"{name}.x"] * run[f"{name}.vy"] - run[f"{name}.y"] * run[f"{name}.vx"])
        + scene.bodies[name].inertia * run[f"{name}.omega"]
        for name in scene.bodies
    )
    for constant in (total("vx"), total("vy"), spin):
        np.testing.assert_allclose(constant, constant[0], rtol=0, atol=1e-10)
    table = energies(run)
    energy = table["kinetic"] + table["potential"]
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9)
