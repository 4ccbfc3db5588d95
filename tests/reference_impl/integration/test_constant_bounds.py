"""Dry friction with a bound of its own, in pins and guides, against closed forms of motion and energy."""

import numpy as np
import pytest

from stiction.engines import load_engine
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.energies import energies
from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import incline_truth, oscillator_truth, slider_crank_truth
from stiction.truths.closed_form.dry_friction import (
    MassesInSeries,
    RampedStart,
    break_away_load,
    oscillator_turning_points,
    pendulum_turning_angles,
)

RTOLS = (1e-6, 1e-9, 1e-12)
TIMES_RTOL = 1e3
"""Error of a motion over the tolerance of a step: some hundred steps, amplified by ten."""


def simulate(scene, rtol=1e-10, **arguments):
    run = ReferenceEngine().simulate(scene, rtol=rtol, **arguments)
    assert run.breakdown is None
    return run


def arm(law, inertia=0.5, bound=1.0, static_bound=None, damping=0.0):
    """An arm pinned to the ground in its centre of mass, under a torque."""
    pin = {"type": "revolute", "bodies": ["arm", "ground"], "friction": bound, "damping": damping}
    if static_bound is not None:
        pin["static_friction"] = static_bound
    return scene_from_dict(
        {
            "t_end": 2,
            "bodies": {"arm": {"mass": 1, "inertia": inertia}},
            "joints": {"pin": pin},
            "forces": {"torque": {"type": "torque", "body": "arm", "law": law}},
        }
    )


@pytest.mark.parametrize("rtol", RTOLS)
def test_pendulum_turns_by_energy(rtol):
    scene = load_scene("pendulum-dry-pin")
    p = scene.parameters
    expected = pendulum_turning_angles(
        p["m"] * p["g"] * p["l"], p["friction"], p["static_friction"], p["start"]
    )
    run = simulate(scene, rtol)
    kinds = [event.kind for event in run.events]
    assert kinds == ["reversal"] * (len(expected) - 2) + ["stick"]
    angles = [event.before["bar.angle"] + np.pi / 2 for event in run.events]
    np.testing.assert_allclose(angles, expected[1:], rtol=0, atol=TIMES_RTOL * rtol)
    # at rest the pin carries the moment of the weight
    moment = p["m"] * p["g"] * p["l"] * np.sin(expected[-1])
    assert run["pin.friction"][-1] == pytest.approx(moment, abs=TIMES_RTOL * rtol)
    assert run["pin.mode"][-1] == 0 and abs(run["pin.slip_velocity"][-1]) < 1e-12
    slips = run["pin.mode"] != 0
    np.testing.assert_allclose(
        run["pin.friction"][slips], -p["friction"] * run["pin.mode"][slips], rtol=1e-12
    )


def test_pendulum_holds_up_to_its_static_bound():
    """At rest while m g l |sin a| <= tau_s: from either side of the bound, by a part in a million."""
    p = load_scene("pendulum-dry-pin").parameters
    limit = np.arcsin(p["static_friction"] / (p["m"] * p["g"] * p["l"]))
    for factor, events in ((1 - 1e-6, 0), (1 + 1e-6, 1)):
        run = simulate(load_scene("pendulum-dry-pin", {"start": factor * limit}), t_end=0.3)
        moved = abs(run["bar.angle"][-1] - run["bar.angle"][0]) > 1e-9
        assert moved == bool(events)


@pytest.mark.parametrize("static", [None, 3.0])
@pytest.mark.parametrize("rtol", RTOLS)
def test_oscillator_loses_a_fixed_amplitude(rtol, static):
    """Without mu: the amplitude falls by 2 F/k in each half cycle, whatever the weight."""
    changes = {"guide.mu": None, "guide.friction": 1.0, "load": None, "spring.stiffness": 10.0}
    scene = vary(
        load_scene("coulomb-oscillator"),
        changes | {"slider.position": [1.0, 0], "guide.static_friction": static},
    )
    expected = oscillator_turning_points(10.0, 1.0, static or 1.0, 1.0)
    run = simulate(scene, rtol, t_end=8.0)
    places = [event.before["slider.x"] for event in run.events]
    np.testing.assert_allclose(places, expected[1:], rtol=0, atol=TIMES_RTOL * rtol)
    assert [event.kind for event in run.events][-1] == "stick"
    truth = oscillator_truth(scene, 8.0)
    np.testing.assert_allclose(
        [event.time for event in run.events],
        [event.time for event in truth.events],
        rtol=0,
        atol=TIMES_RTOL * rtol,
    )
    for column, values in truth(run.t).items():
        size = max(1.0, np.max(np.abs(values)))
        if column not in ("guide.mode", "guide.friction"):
            np.testing.assert_allclose(run[column], values, rtol=0, atol=TIMES_RTOL * rtol * size)


def test_constant_bound_is_the_weight_times_a_coefficient():
    """On a level guide a constant bound mu m g is Coulomb's law, and both together are twice of it: forced motion."""
    scene = vary(load_scene("coulomb-oscillator", {"b": 0.3}), {"t_end": 30.0})
    F = scene.guides["guide"].mu * 9.81
    by_bound = vary(scene, {"guide.mu": None, "guide.friction": F})
    half = vary(scene, {"guide.mu": scene.guides["guide"].mu / 2, "guide.friction": F / 2})
    runs = [simulate(one, 1e-11) for one in (scene, by_bound, half)]
    for other in runs[1:]:
        for column in ("slider.x", "guide.friction"):
            np.testing.assert_allclose(other[column], runs[0][column], rtol=0, atol=1e-8)
    truth = oscillator_truth(half, 30.0)
    np.testing.assert_allclose(runs[2]["slider.x"], truth(runs[2].t)["slider.x"], atol=1e-9)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize(
    "changes", [{}, {"static_friction": 19.0}, {"v": 0}, {"v": 0, "static_friction": 19.0}]
)
def test_vertical_slider(changes, rtol):
    """It stops on its way up; then it holds above m g = 19.62 N and sinks with g - F/m below."""
    scene = load_scene("vertical-slider", changes)
    run, truth = simulate(scene, rtol), incline_truth(scene)
    assert [(event.kind, event.joint) for event in run.events] == [
        (event.kind, event.joint) for event in truth.events
    ]
    for column, values in truth(run.t).items():
        np.testing.assert_allclose(run[column], values, rtol=0, atol=TIMES_RTOL * rtol * 20)
    sinks = changes.get("static_friction", 25.0) < 19.62
    assert (run["slider.vy"][-1] < 0) == sinks
    if sinks:
        assert run["slider.ay"][-1] == pytest.approx(-(9.81 - 15 / 2), rel=1e-9)


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5, 0.9, 0.99])
def test_arm_rests_below_its_bound(part):
    """No creep: not a rounding of motion, and the friction is the torque."""
    run = simulate(arm({"type": "constant", "value": part}), 1e-6)
    assert not run.events and np.max(np.abs(run["arm.angle"])) == 0.0
    np.testing.assert_allclose(run["pin.friction"], -part, rtol=1e-12)
    np.testing.assert_array_equal(run["pin.mode"], 0)


@pytest.mark.parametrize("part", [1.0 + 1e-9, 1.5, -3.0])
def test_arm_accelerates_above_its_bound(part):
    run = simulate(arm({"type": "constant", "value": part}), 1e-9)
    alpha = (part - np.sign(part)) / 0.5
    np.testing.assert_allclose(run["arm.alpha"], alpha, rtol=1e-6)
    np.testing.assert_allclose(run["arm.angle"], alpha * run.t**2 / 2, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("rtol", RTOLS)
def test_ramp_through_the_static_bound(rtol):
    """Break-away and motion of an arm whose friction drops from 0.5 to 0.05 N m."""
    scene = arm({"type": "linear", "rate": 0.4}, 0.5, 0.05, 0.5)
    truth = RampedStart(0.5, 0.0, 0.4, 0.05, 0.5)
    run = simulate(scene, rtol)
    [event] = run.events
    assert (event.kind, event.joint) == ("slip", "pin")
    assert event.time == pytest.approx(truth.break_away, abs=TIMES_RTOL * rtol)
    assert truth.break_away == 1.25 and event.after["arm.alpha"] == pytest.approx(0.9, rel=1e-9)
    assert event.before["pin.friction"] == pytest.approx(-0.5, rel=1e-9)
    assert event.after["pin.friction"] == pytest.approx(-0.05, rel=1e-9)
    np.testing.assert_allclose(
        run["arm.angle"], truth.displacement(run.t), rtol=0, atol=TIMES_RTOL * rtol
    )


@pytest.mark.parametrize("rtol", (1e-9, 1e-12))
@pytest.mark.parametrize("bounds", [(2.0, 5.0), (5.0, 2.0), (2.0, 2.5)])
def test_masses_in_series(bounds, rtol):
    """The smaller of two bounds gives way first; the other one follows by the inertia of the lower mass, or never."""
    lower, upper = bounds
    scene = scene_from_dict(
        {
            "t_end": 4,
            "bodies": {
                "below": {"mass": 3, "inertia": 1},
                "above": {"mass": 1, "inertia": 1},
            },
            "joints": {
                "low": {"type": "translational", "slider": "below", "friction": lower},
                "high": {
                    "type": "translational",
                    "slider": "above",
                    "guide": "below",
                    "friction": upper,
                },
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "above",
                    "direction": [1, 0],
                    "law": {"type": "linear", "rate": 2.0},
                }
            },
        }
    )
    expected = MassesInSeries(3, 1, lower, upper, 2.0).break_aways()
    run = simulate(scene, rtol)
    found = {event.joint: event.time for event in run.events if event.kind == "slip"}
    times = {"low": expected["lower"], "high": expected["upper"]}
    times = {name: time for name, time in times.items() if time < 4}
    assert found.keys() == times.keys() and len(run.events) == len(times)
    for name, time in times.items():
        assert found[name] == pytest.approx(time, abs=TIMES_RTOL * rtol)


@pytest.mark.parametrize("rtol", RTOLS)
def test_slider_crank_with_dry_pins(rtol):
    """The motor's torque, its jumps where the rod turns back, and the reactions of the slider."""
    scene = load_scene("slider-crank-dry-pins")
    run, truth = simulate(scene, rtol), slider_crank_truth(scene)
    assert [(event.kind, event.joint) for event in run.events] == [
        (event.kind, event.joint) for event in truth.events
    ]
    times = [event.time for event in truth.events]
    np.testing.assert_allclose([event.time for event in run.events], times, atol=TIMES_RTOL * rtol)
    away = np.min(np.abs(run.t[:, None] - np.array(times)), axis=1) > 1e-6
    for column, values in truth(run.t).items():
        size = max(1.0, np.max(np.abs(values)))
        np.testing.assert_allclose(
            run[column][away], values[away], rtol=0, atol=TIMES_RTOL * rtol * size, err_msg=column
        )
    # the jump of the torque: 2 tau |w_rod| / w0, as the power of the slider pin changes its sign
    for event, true in zip(run.events, truth.events):
        jump = true.after["motor.effort"] - true.before["motor.effort"]
        found = event.after["motor.effort"] - event.before["motor.effort"]
        assert found == pytest.approx(jump, abs=TIMES_RTOL * rtol * 10)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("count", [2, 3])
def test_a_slow_ramp_moves_joints_with_the_cube_of_time(rtol, count):
    """Sliders joined in a row, at rest up to the sum of their bounds: then x = k t^3/(6 M), from no acceleration."""
    bounds, rate, mass = (1.0, 0.7, 2.1)[:count], 0.8, 1.3
    bodies, joints = {}, {}
    for k in range(count):
        bodies[f"s{k}"] = {"mass": mass, "inertia": 1, "position": [k, 0]}
        joints[f"guide{k}"] = {"type": "translational", "slider": f"s{k}", "friction": bounds[k]}
        if k:
            bodies[f"rod{k}"] = {"mass": mass, "inertia": 1, "position": [k - 0.5, 0]}
            for end, x, slider in (("left", -0.5, f"s{k - 1}"), ("right", 0.5, f"s{k}")):
                joints[f"{end}{k}"] = {
                    "type": "revolute",
                    "bodies": [f"rod{k}", slider],
                    "points": [[x, 0], [0, 0]],
                }
    law = {"type": "linear", "rate": rate}
    push = {"type": "force", "body": "s0", "direction": [1, 0], "law": law}
    scene = scene_from_dict({"bodies": bodies, "joints": joints, "forces": {"push": push}})
    start = sum(bounds) / rate
    run = simulate(scene, rtol, t_end=start + 2, output_step=0.01)
    assert [event.kind for event in run.events] == ["slip"] * count
    times = [event.time for event in run.events]
    np.testing.assert_allclose(times, start, rtol=0, atol=TIMES_RTOL * max(rtol, 1e-11))
    expected = rate * np.maximum(run.t - start, 0) ** 3 / 6 / (len(bodies) * mass)
    for k in range(count):
        np.testing.assert_allclose(run[f"s{k}.x"] - k, expected, rtol=0, atol=TIMES_RTOL * rtol)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("sign", [1, -1])
def test_equal_arms_break_away_at_the_same_time(rtol, sign):
    """Two arms that a spring joins, each under the same ramp: the spring keeps its length, phi = k t^3/(6 I)."""
    rate, bound, inertia = 0.5 * sign, 0.8, 0.3
    bodies, joints, forces = {}, {}, {}
    for name, x in (("left", 0.0), ("right", 1.0)):
        bodies[name] = {"mass": 1, "inertia": inertia, "position": [x, 0], "angle": 0.4}
        joints[f"{name}-pin"] = {
            "type": "revolute",
            "bodies": [name, "ground"],
            "points": [[0, 0], [x, 0]],
            "friction": bound,
        }
        law = {"type": "linear", "rate": rate}
        forces[f"{name}-torque"] = {"type": "torque", "body": name, "law": law}
    spring = {
        "type": "linear",
        "bodies": ["left", "right"],
        "points": [[0.3, 0], [0.3, 0]],
        "stiffness": 50,
        "rest_length": 1.0,
    }
    scene = scene_from_dict(
        {"bodies": bodies, "joints": joints, "forces": forces, "springs": {"spring": spring}}
    )
    start = bound / abs(rate)
    run = simulate(scene, rtol, t_end=start + 1, output_step=0.01)
    assert {(event.kind, event.joint) for event in run.events} == {
        ("slip", "left-pin"),
        ("slip", "right-pin"),
    }
    assert len(run.events) == 2
    times = [event.time for event in run.events]
    np.testing.assert_allclose(times, start, rtol=0, atol=TIMES_RTOL * max(rtol, 1e-11))
    expected = 0.4 + rate * np.maximum(run.t - start, 0) ** 3 / 6 / inertia
    for name in bodies:
        np.testing.assert_allclose(run[f"{name}.angle"], expected, rtol=0, atol=TIMES_RTOL * rtol)


@pytest.mark.parametrize("rtol", (1e-9, 1e-12))
@pytest.mark.parametrize("ratio", [0.9, 1.0])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [(2.0, 1.0, 3.0, 4.0), (0.5, 3.0, 0.2, 0.0), (2.0, 1.0, 3.0)])
def test_joints_at_rest_share_a_load_up_to_the_sum_of_their_bounds(share, sign, ratio, rtol):
    """A slider-crank at rest under a growing torque on its crank: three pins and the guide give way together.

    Kinetic bounds are `ratio` times the static ones. Where they are equal, the motion begins without an acceleration.
    """
    r, l, angle = 0.5, 2.0, 0.7
    phi = np.arcsin(-r * np.sin(angle) / l)
    rod_rate = -r * np.cos(angle) / (l * np.cos(phi))
    slider_rate = -r * np.sin(angle) - l * np.sin(phi) * rod_rate
    # of three joints the shares are tried (`shared_rest`), of four the HLCP decides
    rates = (1.0, rod_rate - 1.0, rod_rate, slider_rate)[: len(share)]
    joints = ("pivot", "crankpin", "pin", "guide")[: len(share)]
    scene = vary(
        load_scene("slider-crank"),
        {
            "drives.motor": None,
            "gravity": None,
            "crank.angle": angle,
            "rod.angle": phi,
            "crank.position": [r / 2 * np.cos(angle), r / 2 * np.sin(angle)],
            "rod.position": [
                r * np.cos(angle) + l / 2 * np.cos(phi),
                r * np.sin(angle) + l / 2 * np.sin(phi),
            ],
            "slider.position": [r * np.cos(angle) + l * np.cos(phi), 0.0],
            "crank.velocity": None,
            "crank.angular_velocity": None,
            "rod.velocity": None,
            "rod.angular_velocity": None,
            **{f"{name}.friction": ratio * bound for name, bound in zip(joints, share)},
            **{f"{name}.static_friction": bound for name, bound in zip(joints, share)},
        },
    )
    torque = {"type": "torque", "body": "crank", "law": {"type": "linear", "rate": sign * 5.0}}
    scene = vary(scene, {"forces": {"torque": torque}})
    expected = break_away_load(share, rates) / 5.0
    run = simulate(scene, rtol, t_end=expected + 0.1, output_step=0.01)
    moving = [event for event in run.events if event.time < expected + 0.05]
    assert {event.kind for event in moving} == {"slip"}
    assert {event.joint for event in moving} == set(joints)
    times = [event.time for event in moving]
    np.testing.assert_allclose(times, expected, rtol=0, atol=TIMES_RTOL * rtol)
    # until then the frictions are within their bounds, and their power is that of the torque
    rests = run.t < expected - 1e-6
    power = sum(run[f"{name}.friction"][rests] * rate for name, rate in zip(joints, rates))
    np.testing.assert_allclose(power, -sign * 5.0 * run.t[rests], rtol=0, atol=1e-9)
    for name, bound in zip(joints, share):
        assert np.all(np.abs(run[f"{name}.friction"][rests]) <= bound * (1 + 1e-9) + 1e-12)


def four_bar(friction, w):
    """A crank-rocker a = 0.2, b = 0.5, c = 0.4, d = 0.45 m, driven at constant speed; bodies not at mid-bar."""
    lengths = {"crank": 0.2, "coupler": 0.5, "rocker": 0.4}
    masses = {"crank": (0.5, 0.01), "coupler": (1.0, 0.03), "rocker": (0.7, 0.02)}
    centre = {"crank": 0.08, "coupler": 0.2, "rocker": 0.25}
    angles = four_bar_angles(0.4)
    ends = {"crank": 0j, "coupler": 0.2 * np.exp(1j * angles["crank"]), "rocker": 0.45 + 0j}
    rates = {
        name: w * (four_bar_angles(0.4 + 1e-6)[name] - four_bar_angles(0.4 - 1e-6)[name]) / 2e-6
        for name in angles
    }
    bodies = {}
    for name, (mass, inertia) in masses.items():
        place = ends[name] + centre[name] * np.exp(1j * angles[name])
        bodies[name] = {
            "mass": mass,
            "inertia": inertia,
            "position": [place.real, place.imag],
            "angle": angles[name],
            "angular_velocity": rates[name],
        }
    pins = {
        "A": ("crank", "ground", -0.08, [0.0, 0.0]),
        "B": ("coupler", "crank", -0.2, [0.12, 0.0]),
        "C": ("rocker", "coupler", 0.15, [0.3, 0.0]),
        "D": ("rocker", "ground", -0.25, [0.45, 0.0]),
    }
    joints = {
        name: {
            "type": "revolute",
            "bodies": [first, second],
            "points": [[x, 0.0], point],
            **({"friction": friction[name]} if friction else {}),
        }
        for name, (first, second, x, point) in pins.items()
    }
    return scene_from_dict(
        {
            "t_end": 2 * np.pi / w,
            "gravity": [0, -9.81],
            "bodies": bodies,
            "joints": joints,
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["crank", "ground"],
                    "law": {"type": "linear", "offset": 0.4, "rate": w},
                }
            },
        }
    ), lengths


def four_bar_angles(crank):
    """Angles of the bars: the joint of coupler and rocker is where two circles meet."""
    begin, pivot = 0.2 * np.exp(1j * crank), 0.45 + 0j
    span = pivot - begin
    distance = np.abs(span)
    along = (0.5**2 - 0.4**2 + distance**2) / (2 * distance)
    across = np.sqrt(0.5**2 - along**2)
    joint = begin + span / distance * (along + 1j * across)
    return {
        "crank": crank,
        "coupler": np.angle(joint - begin),
        "rocker": np.angle(joint - pivot),
    }


def test_four_bar_with_dry_pins():
    """Driving torque = torque without friction + sum of tau_i |relative rate_i| / rate, and it jumps where one turns."""
    friction, w = {"A": 0.3, "B": 0.5, "C": 0.7, "D": 0.4}, 3.0
    scene, _ = four_bar(friction, w)
    run = simulate(scene, 1e-11, assemble=True)
    smooth = simulate(four_bar(None, w)[0], 1e-11, assemble=True)
    h = 1e-5
    theta = 0.4 + w * run.t
    before, after = four_bar_angles(theta - h), four_bar_angles(theta + h)
    rate = {name: w * (after[name] - before[name]) / (2 * h) for name in before} | {"ground": 0.0}
    power = 0.0
    turns = 0
    for name, joint in scene.pins.items():
        relative = rate[joint.bodies[0]] - rate[joint.bodies[1]]
        power = power + friction[name] * np.abs(relative)
        turns += np.count_nonzero(np.diff(np.sign(relative)))
    np.testing.assert_allclose(
        run["motor.effort"], smooth["motor.effort"] + power / w, rtol=0, atol=1e-7
    )
    assert len(run.events) == turns > 0


def test_damping_of_a_pin_and_of_a_guide():
    """Without friction: the speed falls as exp(-c t/I), and as exp(-c t/m)."""
    turning = vary(
        arm({"type": "constant", "value": 0.0}, bound=0.0, damping=0.7),
        {"arm.angular_velocity": 2.0},
    )
    run = simulate(turning)
    np.testing.assert_allclose(run["arm.omega"], 2 * np.exp(-0.7 / 0.5 * run.t), rtol=1e-8)
    sliding = vary(
        load_scene("vertical-slider"),
        {
            "guide.friction": None,
            "guide.static_friction": None,
            "gravity": None,
            "guide.damping": 3,
        },
    )
    run = simulate(sliding)
    np.testing.assert_allclose(run["slider.vy"], 3 * np.exp(-3 / 2 * run.t), rtol=1e-8)


@pytest.mark.parametrize("name", ["pendulum-dry-pin", "vertical-slider", "slider-crank-dry-pins"])
def test_energies_balance(name):
    """Heat of each joint, friction and damping, is what the energy and the work lose; it never falls."""
    scene = load_scene(name)
    run = simulate(scene, output_step=1e-3)
    found = energies(run)
    size = max(1.0, np.ptp(found["kinetic"]))
    assert np.max(np.abs(found["balance"])) < 1e-4 * size
    for joint in scene.frictional_joints:
        assert np.min(np.diff(found[f"{joint}.dissipated"])) >= -1e-12
        assert found[f"{joint}.dissipated"].iloc[-1] > 0.0


def test_paper_scheme_and_textbook():
    """The fixed-step scheme of the paper, compiled and as written, with a pin whose static bound is larger."""
    scene = load_scene("pendulum-dry-pin", {"stabilization": {"method": "none"}})
    exact = simulate(scene, 1e-11, t_end=3.0)
    written, compiled = (
        ReferenceEngine().simulate(scene, t_end=3.0, dt=0.01, method=method)
        for method in ("textbook", "paper")
    )
    for run in (written, compiled):
        assert [event.kind for event in run.events] == [event.kind for event in exact.events]
        np.testing.assert_allclose(run["bar.angle"], exact["bar.angle"], atol=1e-6)
    for column in compiled.columns:
        np.testing.assert_allclose(compiled[column], written[column], rtol=0, atol=1e-8)


def moreau(scene, dt, t_end):
    run = load_engine("moreau").simulate(
        scene, t_end=t_end, dt=dt, output_step=0.01, fidelity="contact"
    )
    assert run.breakdown is None
    return run


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("slider-crank-dry-pins", {}),
        ("slider-bar-case-1", {"guide.friction": 0.5, "pin.friction": 0.2, "guide.mus": None}),
        ("pendulum-dry-pin", {"pin.static_friction": None}),
    ],
)
def test_moreau_converges(name, changes):
    """To the event-driven motion, in pins and beside contacts; of first order across events."""
    scene = vary(load_scene(name), changes)
    exact = simulate(scene, 1e-10, t_end=1.0)
    body = list(scene.bodies)[-1]
    errors = []
    for dt in (2e-3, 5e-4, 1.25e-4):
        run = moreau(scene, dt, 1.0)
        errors.append(
            max(np.max(np.abs(run[f"{body}.{x}"] - exact[f"{body}.{x}"])) for x in ("x", "angle"))
        )
        for joint in scene.frictional_joints:
            difference = run[f"{joint}.friction"] - exact[f"{joint}.friction"]
            assert np.median(np.abs(difference)) < 1e-8 + 2 * dt
    assert errors[-1] < 0.5 * errors[0] and errors[-1] < 1e-4


@pytest.mark.parametrize("part", [0.3, 0.99])
def test_moreau_holds_below_the_bound(part):
    """Set-valued friction: no creep, and the friction is the load."""
    run = moreau(arm({"type": "constant", "value": part}), 1e-3, 0.5)
    assert np.max(np.abs(run["arm.angle"])) < 1e-14
    np.testing.assert_allclose(run["pin.friction"], -part, rtol=1e-9)
    assert not run["pin.mode"].any()


@pytest.mark.parametrize("solver", ["lemke", "enumeration", "trial"])
def test_every_solver(solver):
    """Lemke's method, enumeration, and trial and error choose the modes of a guide with both kinds and of a dry pin."""
    changes = {"guide.friction": 0.5, "guide.static_friction": 0.7, "pin.friction": 0.2}
    scene = vary(load_scene("slider-bar-case-1"), changes)
    expected = simulate(scene, 1e-10, t_end=8.0)
    assert {event.kind for event in expected.events} >= {"slip", "stick", "reversal"}
    found = simulate(scene, 1e-10, t_end=8.0, solver=solver)
    assert [(event.kind, event.joint) for event in found.events] == [
        (event.kind, event.joint) for event in expected.events
    ]
    for column in ("slider.x", "guide.friction", "motor.effort"):
        np.testing.assert_allclose(found[column], expected[column], rtol=0, atol=1e-7)
