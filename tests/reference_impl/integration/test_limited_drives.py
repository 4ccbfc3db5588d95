"""Drives with a limit: closed forms, energy, an equal mechanism of prescribed drives and friction, random mechanisms."""

from dataclasses import replace

import numpy as np
import pytest
from fuzz.several_freedoms import RESERVE, differences, scene_with_limited_drives
from scipy.optimize import brentq

from stiction.engines import EngineMissing, Refused, load_engine
from stiction.engines.examined import Examined
from stiction.engines.gate import first_problem
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.energies import energies
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.scenes.columns import unit_of
from stiction.truths.closed_form.limited_drive import Hoist, ShakenRotor, Stall
from stiction.truths.enumerated_motion import simulate as enumerate_motion

RTOLS = (1e-6, 1e-9, 1e-12)
TIMES_RTOL = 1e3
"""Error of a motion over the tolerance of a step: some hundred steps, amplified by ten."""
T_END = 0.6


def simulate(scene, rtol=1e-10, **arguments):
    run = ReferenceEngine().simulate(scene, rtol=rtol, **arguments)
    assert run.breakdown is None
    return run


def block(law, limit, *, velocity=0.0, mu=None, springs=None, direction=(1, 0), t_end=2.0):
    """A block of 2 kg on a guide of some direction, under gravity, with a drive along the guide."""
    guide = {"type": "translational", "slider": "block", "direction": list(direction)}
    if mu is not None:
        guide["mu"] = mu
    drive = {"type": "distance", "bodies": ["block", "ground"], "axis": list(direction)}
    return scene_from_dict(
        {
            "t_end": t_end,
            "gravity": [0, -9.81],
            "bodies": {
                "block": {
                    "mass": 2,
                    "inertia": 1,
                    "velocity": [velocity * direction[0], velocity * direction[1]],
                }
            },
            "joints": {"guide": guide},
            "drives": {"motor": {**drive, "law": law, "effort_limit": limit}},
            "springs": springs or {},
        }
    )


def rotor(law, limit, **body):
    """A body that turns about its centre of mass without a joint, with a drive of its angle."""
    return scene_from_dict(
        {
            "t_end": 2,
            "bodies": {"rotor": {"mass": 1, "inertia": 0.2, **body}},
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["rotor", "ground"],
                    "law": law,
                    "effort_limit": limit,
                }
            },
        }
    )


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("limit", [25.0, 15.0])
def test_hoist(limit, rtol):
    """A weight above the limit sinks with g - L/m; below it the weight is lifted, from rest, to the rate of the law."""
    truth = Hoist(mass=2.0, weight=2 * 9.81, limit=limit, rate=0.5)
    run = simulate(block({"type": "linear", "rate": 0.5}, limit, direction=(0, 1)), rtol)
    atol = TIMES_RTOL * rtol
    np.testing.assert_allclose(run["block.y"], truth.position(run.t), rtol=0, atol=atol)
    np.testing.assert_allclose(run["motor.effort"], truth.effort(run.t), rtol=1e-9)
    np.testing.assert_allclose(run["motor.lag"], 0.5 * run.t - run["block.y"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        run["motor.slip_velocity"], run["block.vy"] - 0.5, rtol=0, atol=1e-12
    )
    expected = [("stick", truth.time_to_hold)] if limit > truth.weight else []
    assert [event.kind for event in run.events] == [kind for kind, _ in expected]
    times = [event.time for event in run.events]
    np.testing.assert_allclose(times, [time for _, time in expected], rtol=0, atol=atol)


@pytest.mark.parametrize("limit", [19.62 * (1 - 1e-6), 19.62 * (1 + 1e-6)])
def test_a_joint_holds_or_sinks(limit):
    """The drive of a vertical slider holds its place up to the weight, to a part in a million."""
    scene = block({"type": "constant", "value": 0.0}, limit, direction=(0, 1))
    run = simulate(scene)
    sinks = limit < 19.62
    expected = -(9.81 - limit / 2) * 2.0 if sinks else 0.0
    assert run["block.vy"][-1] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert run["motor.mode"][-1] == (-1 if sinks else 0)
    # friction of the guide above the difference mends it
    held = simulate(vary(scene, {"guide.friction": 1e-4}))
    assert abs(held["block.vy"][-1]) < 1e-12


@pytest.mark.parametrize("rtol", RTOLS)
def test_stall_against_a_spring(rtol):
    """Pushed against a spring and a damper, the drive gives way at its limit and stalls where the spring equals it."""
    spring = {
        "type": "linear",
        "bodies": ["block", "ground"],
        "axis": [1, 0],
        "stiffness": 30.0,
        "damping": 2.0,
    }
    law = {"type": "linear", "rate": 0.8}
    scene = block(law, 12.0, velocity=0.8, springs={"spring": spring}, t_end=20.0)
    truth = Stall(mass=2.0, stiffness=30.0, damping=2.0, limit=12.0, rate=0.8)
    run = simulate(scene, rtol)
    atol = TIMES_RTOL * rtol
    np.testing.assert_allclose(run["block.x"], truth.position(run.t), rtol=0, atol=atol)
    [event] = run.events
    assert event.kind == "slip" and event.time == pytest.approx(truth.time_of_slip, abs=atol)
    assert run["block.x"][-1] == pytest.approx(12.0 / 30.0, abs=1e-3)  # but for exp(-10)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize(("limit", "kind"), [(0.7, "reversal"), (1.5, "stick")])
def test_shaken_rotor_has_no_joint(limit, kind, rtol):
    """A drive alone, of a law with acceleration: it gives way where the law asks for more, and catches up."""
    truth = ShakenRotor(inertia=0.2, limit=limit, amplitude=0.5, frequency=4.0)
    assert truth.holds_again == (kind == "stick")
    law = {"type": "sine", "amplitude": 0.5, "frequency": 4.0}
    run = simulate(rotor(law, limit, angular_velocity=2.0), rtol, t_end=1.6)
    atol = TIMES_RTOL * rtol
    assert [event.kind for event in run.events[:2]] == ["slip", kind]
    assert run.events[0].time == pytest.approx(truth.time_of_slip, abs=atol)
    assert run.events[1].time == pytest.approx(truth.time_of_equal_rates, abs=atol)
    holds = run.t < truth.time_of_slip
    expected = -0.2 * 0.5 * 16 * np.sin(4 * run.t[holds])
    np.testing.assert_allclose(run["motor.effort"][holds], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("limit", "moves"), [(5.0, False), (7.0, True)])
def test_drive_pulls_a_block_through_friction(limit, moves):
    """Friction 0.3 m g = 5.886 N: below it the block rests and the drive slips; above it the block gets its rate."""
    run = simulate(block({"type": "linear", "rate": 0.2}, limit, mu=0.3))
    if not moves:
        assert abs(run["block.x"][-1]) < 1e-12 and not run.events
        np.testing.assert_allclose(run["motor.effort"], limit, rtol=1e-12)
        np.testing.assert_allclose(run["guide.friction"], -limit, rtol=1e-12)
        return
    acceleration = (limit - 0.3 * 2 * 9.81) / 2
    [event] = run.events
    assert (event.kind, event.joint) == ("stick", "motor")
    assert event.time == pytest.approx(0.2 / acceleration, rel=1e-9)
    assert run["motor.effort"][-1] == pytest.approx(0.3 * 2 * 9.81, rel=1e-9)


def test_drive_that_dwells_shares_a_load_with_friction():
    """A drive and a guide at rest hold a load together up to the sum of their bounds, wherever one alone would give way."""
    law = {"type": "constant", "value": 0.0}
    for load, rests in ((12.8, True), (13.0, False)):
        # together they hold 7 + 0.3 m g = 12.886 N
        scene = vary(
            block(law, 7.0, mu=0.3),
            {
                "forces.push": {
                    "type": "force",
                    "body": "block",
                    "direction": [1, 0],
                    "law": {"type": "constant", "value": load},
                }
            },
        )
        run = simulate(scene)
        acceleration = 0.0 if rests else (load - 7.0 - 0.3 * 2 * 9.81) / 2
        assert run["block.x"][-1] == pytest.approx(acceleration * 2.0, abs=1e-9)


@pytest.mark.parametrize("rtol", RTOLS)
def test_winch_gives_way_and_holds_again(rtol):
    """The winch of the catalogue: with the pull P sin(w t) the slip velocity has elementary integrals between events."""
    scene = load_scene("winch")
    p = scene.parameters
    run = simulate(scene, rtol)
    atol = TIMES_RTOL * rtol
    w, pull, excess = p["frequency"], p["pull"], p["limit"] - p["m"] * p["g"]

    def momentum(begin, t):
        """The integral of the force that is left of the limit: excess - P sin(w t)."""
        return excess * (t - begin) + pull / w * (np.cos(w * t) - np.cos(w * begin))

    def hold(begin, missing, low, high):
        return brentq(lambda t: momentum(begin, t) - missing, low, high, xtol=1e-15, rtol=1e-15)

    period, rises = 2 * np.pi / w, np.arcsin(excess / pull) / w
    # from rest it gets the speed only while the pull is below zero; it gives way where P sin(w t) passes the excess
    first = hold(0.0, p["m"] * p["speed"], period / 2, period)
    expected = [("stick", first)]
    for number in (1, 2):
        slip = number * period + rises
        falls = number * period + period / 2 - rises
        expected += [("slip", slip), ("stick", hold(slip, 0.0, falls, slip + period))]
    expected = [(kind, time) for kind, time in expected if time < scene.t_end]
    assert len(expected) == 5
    assert [event.kind for event in run.events] == [kind for kind, _ in expected]
    times = [event.time for event in run.events]
    np.testing.assert_allclose(times, [time for _, time in expected], rtol=0, atol=atol)
    # the lag that was lost is kept while the drive holds
    lags = [event.after["winch.lag"] for event in run.events]
    assert lags[0] == pytest.approx(lags[1], abs=atol) and lags[2] > lags[1] > 0
    assert lags[2] == pytest.approx(lags[3], abs=atol) and lags[4] > lags[3]


def test_energy_is_balanced():
    """The drive's work is its effort times the rate of its coordinate, not of its law."""
    run = simulate(load_scene("winch"), output_step=1e-4)
    table = energies(run)
    assert np.max(np.abs(table["balance"])) < 1e-6 * np.max(np.abs(table["winch.work"]))


@pytest.mark.parametrize("limit", [0.3, 2.0])
def test_equals_friction_on_a_driven_body(limit):
    """A limited drive of an arm is a pin with friction on a body that a prescribed drive turns: another formulation."""
    law = {"type": "sine", "offset": 0.1, "amplitude": 0.4, "frequency": 5.0, "phase": 0.3}
    arm = {"mass": 1.5, "inertia": 0.2, "position": [0.3, 0.0], "angular_velocity": 1.0}
    arm["velocity"] = [0.0, 0.3]
    pin = {"type": "revolute", "bodies": ["arm", "ground"], "points": [[-0.3, 0.0], [0.0, 0.0]]}
    common = {"t_end": 3.0, "gravity": [0.0, -3.0]}
    drive = {"type": "angle", "bodies": ["arm", "ground"], "law": law, "effort_limit": limit}
    limited = scene_from_dict(
        {**common, "bodies": {"arm": arm}, "joints": {"pin": pin}, "drives": {"motor": drive}}
    )
    hub = {
        "mass": 1.0,
        "inertia": 1.0,
        "angle": 0.1 + 0.4 * np.sin(0.3),
        "angular_velocity": 2.0 * np.cos(0.3),
    }
    driven = scene_from_dict(
        {
            **common,
            "bodies": {"arm": arm, "hub": hub},
            "joints": {
                "axle": {"type": "revolute", "bodies": ["hub", "ground"]},
                "pin": {**pin, "bodies": ["arm", "hub"], "friction": limit},
            },
            "drives": {"motor": {"type": "angle", "bodies": ["hub", "ground"], "law": law}},
        }
    )
    one, other = (simulate(scene, 1e-11) for scene in (limited, driven))
    for column in ("arm.angle", "arm.omega"):
        np.testing.assert_allclose(one[column], other[column], rtol=0, atol=1e-8)
    np.testing.assert_allclose(one["motor.effort"], other["pin.friction"], rtol=0, atol=1e-7)
    mine, theirs = (
        [(event.kind, event.time) for event in run.events if event.joint == joint]
        for run, joint in ((one, "motor"), (other, "pin"))
    )
    assert [kind for kind, _ in mine] == [kind for kind, _ in theirs] and len(mine) > 2
    np.testing.assert_allclose([t for _, t in mine], [t for _, t in theirs], rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["paper", "textbook"])
def test_fixed_steps(method):
    """The paper's scheme, compiled and as written, has the same motion, but for its steps."""
    # without the rail, which is no guide of the paper's
    scene = vary(load_scene("winch"), {"stabilization": {"method": "none"}, "rail": None})
    true = simulate(scene)
    run = ReferenceEngine().simulate(scene, dt=1e-3, method=method)
    assert [event.kind for event in run.events] == [event.kind for event in true.events]
    # a break-away is late by a step at most
    np.testing.assert_allclose(run["load.y"], true["load.y"], rtol=0, atol=5e-3)
    assert run["winch.effort"][-1] == pytest.approx(true["winch.effort"][-1], rel=1e-6)


def test_moreau_converges():
    """Moreau's time stepping, of first order."""
    scene = load_scene("winch")
    true = simulate(scene)
    errors = []
    for dt in (2e-3, 5e-4, 1.25e-4):
        run = load_engine("moreau").simulate(scene, dt=dt, fidelity="contact")
        errors.append(np.max(np.abs(run["load.y"] - true["load.y"])))
    assert errors[0] < 5e-2 and errors[2] < errors[0] / 8


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms(i):
    """Limited drives of angles, axes and distances, beside friction of both kinds, by enumeration of modes."""
    scene = scene_with_limited_drives(7, i)
    motion = enumerate_motion(scene, T_END)
    assert motion.breakdown is None and motion.violation < RESERVE * 1e-11
    run = simulate(scene, 1e-9, t_end=T_END)
    assert differences(scene, motion, run, 1e-9) == []


@pytest.mark.long
@pytest.mark.parametrize("block_of", range(12))
def test_hundreds_of_random_mechanisms(block_of):
    """Nothing is silently wrong, wherever the second method has an answer."""
    for i in range(300)[block_of::12]:
        scene = scene_with_limited_drives(13, i)
        motion = enumerate_motion(scene, 1.0)
        run = ReferenceEngine().simulate(scene, t_end=1.0, rtol=1e-10)
        if motion.breakdown is not None and motion.breakdown.kind == "singular":
            continue  # guides and drives that share a load are left to others
        assert run.breakdown or not motion.breakdown, i
        assert differences(scene, motion, run, 1e-10) == [], i


def test_starts_off_its_law():
    """A limited drive follows the rate of its law alone: the start need not have its value, nor its rate."""
    scene = rotor({"type": "linear", "offset": 1.0, "rate": 3.0}, 0.4)
    run = simulate(scene)
    assert run["motor.lag"][0] == 1.0 and run["motor.slip_velocity"][0] == -3.0
    with pytest.raises(SceneError, match="start.motor.effort"):
        simulate(vary(scene, {"motor.effort_limit": None}))


@pytest.mark.parametrize("limit", [0.0, -1.0])
def test_a_limit_is_positive(limit):
    with pytest.raises(SceneError, match="effort_limit"):
        rotor({"type": "linear", "rate": 3.0}, limit)


def test_units_are_those_of_the_drive():
    scene = load_scene("winch")
    assert [unit_of(f"winch.{name}", scene) for name in ("effort", "slip_velocity", "lag")] == [
        "N",
        "m/s",
        "m",
    ]
    turning = rotor({"type": "linear", "rate": 3.0}, 0.4)
    assert [unit_of(f"motor.{name}", turning) for name in ("effort", "slip_velocity", "lag")] == [
        "N m",
        "rad/s",
        "rad",
    ]


def test_gate_finds_an_effort_beyond_the_limit():
    """The gate accepts neither an effort above the limit nor a slip velocity or lag that is not that of the states."""
    scene = load_scene("winch")
    run = simulate(scene)

    def problem_of(run):
        always = {"locates": lambda settings: True, "keeps": lambda settings: True}
        return first_problem(Examined(run, scene, scene.t_end, None, 1e-2, run.fidelity, **always))

    assert problem_of(run) is None
    for column in ("winch.slip_velocity", "winch.lag"):
        columns = {**run.columns, column: 1.01 * run[column]}
        assert column in problem_of(replace(run, columns=columns))
    stronger = simulate(vary(scene, {"limit": 25.01}))
    assert "winch.effort = 25.01" in problem_of(stronger)


@pytest.mark.parametrize("engine", ["pymunk", "mujoco", "exudyn", "pybullet", "dart", "drake"])
def test_engines_refuse_in_one_sentence(engine):
    """An engine whose drives have no limit says so, and runs nothing."""
    try:
        loaded = load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(str(missing))
    with pytest.raises(Refused, match="drives.winch: .* a limit of the effort of a drive"):
        loaded.simulate(load_scene("winch"), dt=1e-3)


def test_limited_drive_of_a_coordinate_that_others_determine():
    """Beside a drive without a limit, or where joints allow no motion, it slips at the rate of its law, at its limit."""
    prescribed = {
        "type": "angle",
        "bodies": ["rotor", "ground"],
        "law": {"type": "linear", "rate": 2.0},
    }
    both = vary(
        rotor({"type": "linear", "rate": 3.0}, 0.4, angular_velocity=2.0),
        {"drives.master": prescribed},
    )
    run = simulate(both)
    np.testing.assert_allclose(run["motor.effort"], 0.4, rtol=1e-12)
    np.testing.assert_allclose(run["master.effort"], -0.4, rtol=1e-12)
    np.testing.assert_allclose(run["motor.slip_velocity"], -1.0, rtol=1e-9)
    # at equal rates nothing tells how the two share the torque, which is zero
    shared = simulate(vary(both, {"motor.law": {"type": "linear", "rate": 2.0}}))
    assert np.isnan(shared["motor.effort"]).all() and np.isnan(shared["master.effort"]).all()

    # a slider does not turn in its guide
    turned = {"type": "angle", "bodies": ["block", "ground"], "effort_limit": 0.3}
    locked = vary(
        block({"type": "constant", "value": 0.0}, 1.0, t_end=0.5),
        {"drives.twist": {**turned, "law": {"type": "linear", "rate": 1.0}}},
    )
    run = simulate(locked)
    np.testing.assert_allclose(run["twist.effort"], 0.3, rtol=1e-12)
    np.testing.assert_allclose(run["guide.moment"], -0.3, rtol=1e-9)
