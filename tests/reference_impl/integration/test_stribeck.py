"""Friction that falls with the speed of slip, against an independent equation of one mass."""

from math import cos, pi, radians, sin

import numpy as np
import pytest

from stiction.engines import EngineMissing, load_engine
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.energies import energies
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.scenes.stribeck import bound_in_slip, coefficient_in_slip
from stiction.truths.reduced.stribeck_mass import StribeckMass

RTOLS = (1e-6, 1e-9, 1e-12)
TIMES_RTOL = 1e3
"""Error of a motion over the tolerance of a step: some hundred steps, amplified by ten."""
SHAPES = (1.0, 2.0, 1.5)
G = 9.81


def simulate(scene, rtol=1e-10, **arguments):
    run = ReferenceEngine().simulate(scene, rtol=rtol, **arguments)
    assert run.breakdown is None
    return run


def agree(run, truth, start, t_end, rtol):
    """The events and the end of a run are those of a `StribeckMass`."""
    x, v, events = truth.motion(*start, t_end)
    assert [(event.kind) for event in run.events] == [kind for kind, _ in events]
    times = [event.time for event in run.events]
    np.testing.assert_allclose(
        times, [time for _, time in events], rtol=0, atol=TIMES_RTOL * rtol * t_end
    )
    np.testing.assert_allclose(run["slider.x"][-1], x, rtol=0, atol=TIMES_RTOL * rtol)
    np.testing.assert_allclose(run["slider.vx"][-1], v, rtol=0, atol=TIMES_RTOL * rtol * 10)
    return events


@pytest.mark.parametrize("rtol", RTOLS)
def test_the_first_mass_of_modelicas_example(rtol):
    """Slip at 0.4097 s and x(5 s) = 1.76852 m, as OpenModelica gives them, and an own solution of the equation."""
    scene = load_scene("mass-stribeck")
    run = simulate(scene, rtol)
    truth = StribeckMass(lambda t, x, v: 25 * sin(pi / 2 * t) - v, 5.0, 15.0, 0.5)
    events = agree(run, truth, (0.0, 0.0), 5.0, rtol)
    assert [kind for kind, _ in events] == ["slip", "reversal", "reversal"]
    assert run.events[0].time == pytest.approx(np.arcsin(0.6) * 2 / pi, abs=TIMES_RTOL * rtol)
    assert run.events[0].time == pytest.approx(0.4097, abs=5e-5)
    assert run["slider.x"][-1] == pytest.approx(1.76852, abs=max(5e-6, TIMES_RTOL * rtol))


def belt(**changes):
    """A mass on a spring, on a belt of 0.2 m/s."""
    guide = {"guide.stribeck_velocity": 0.1, "guide.mus": 0.4, "v0": 0.2}
    return vary(load_scene("mass-on-belt"), {**guide, **changes})


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rtol", RTOLS)
def test_mass_on_belt(rtol, shape):
    """Stick-slip: rest relative to the belt, break-away and return, again and again."""
    run = simulate(belt(**{"guide.stribeck_shape": shape}), rtol, t_end=12.0)
    truth = StribeckMass(lambda t, x, v: -10 * x, 0.2 * G, 0.4 * G, 0.1, shape, guide_velocity=0.2)
    events = agree(run, truth, (0.0, 0.2), 12.0, rtol)
    assert {kind for kind, _ in events} == {"slip", "stick"} and len(events) >= 6


@pytest.mark.parametrize("rtol", (1e-6, 1e-10))
@pytest.mark.parametrize("velocity", [1e-3, 1e-4, 1e-6])
def test_fast_curves(rtol, velocity):
    """The curve is passed in a millisecond or less, many times faster than the motion: steps see it."""
    run = simulate(belt(**{"guide.stribeck_velocity": velocity}), rtol, t_end=6.0)
    truth = StribeckMass(lambda t, x, v: -10 * x, 0.2 * G, 0.4 * G, velocity, guide_velocity=0.2)
    agree(run, truth, (0.0, 0.2), 6.0, rtol)


def test_two_coefficients_are_the_limit_of_speed_zero():
    """The difference to the law with a jump falls in proportion to the speed of the curve."""
    jump = simulate(belt(**{"guide.stribeck_velocity": None}), 1e-11, t_end=5.0)
    errors = []
    for velocity in (1e-3, 1e-4, 1e-5):
        run = simulate(belt(**{"guide.stribeck_velocity": velocity}), 1e-11, t_end=5.0)
        assert [event.kind for event in run.events] == [event.kind for event in jump.events]
        errors.append(np.max(np.abs(run["slider.x"] - jump["slider.x"])))
    # over speed times its logarithm, the time in which an exponential leaves the rest
    assert errors[0] < 0.02
    for slow, fast in zip(errors, errors[1:]):
        assert 5 < slow / fast < 11


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rtol", RTOLS)
def test_block_on_an_incline(rtol, shape):
    """Thrown uphill it slows down along the curve, stops, and stays or slides back along the curve."""
    for slope, events in ((15, ["stick"]), (25, ["reversal"])):
        scene = vary(
            load_scene("block-on-incline"),
            {
                "incline": radians(slope),
                "guide.stribeck_velocity": 0.3,
                "guide.stribeck_shape": shape,
                "slider.velocity": [
                    -2 * cos(radians(slope)),
                    2 * sin(radians(slope)),
                ],
            },
        )
        run = simulate(scene, rtol)
        weight = G * sin(radians(slope))
        normal = G * cos(radians(slope))
        truth = StribeckMass(
            lambda t, x, v, weight=weight: weight, 0.2 * normal, 0.3 * normal, 0.3, shape
        )
        s, v, expected = truth.motion(0.0, -2.0, 2.0)
        assert [event.kind for event in run.events] == events == [kind for kind, _ in expected]
        assert run.events[0].time == pytest.approx(expected[0][1], abs=TIMES_RTOL * rtol)
        assert run["guide.displacement"][-1] == pytest.approx(s, abs=TIMES_RTOL * rtol)
        assert run["guide.slip_velocity"][-1] == pytest.approx(v, abs=TIMES_RTOL * rtol)


@pytest.mark.parametrize("rtol", RTOLS)
def test_ramp_breaks_a_guide_away_without_a_jump(rtol):
    """Friction is continuous at break-away; then it falls, and the motion grows faster than the force."""
    scene = scene_from_dict(
        {
            "t_end": 2,
            "bodies": {"slider": {"mass": 2, "inertia": 1}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "friction": 1.0,
                    "static_friction": 4.0,
                    "stribeck_velocity": 0.2,
                }
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "slider",
                    "direction": [1, 0],
                    "law": {"type": "linear", "rate": 3.0},
                }
            },
        }
    )
    run = simulate(scene, rtol)
    truth = StribeckMass(lambda t, x, v: 3.0 * t, 1.0, 4.0, 0.2, mass=2.0)
    agree(run, truth, (0.0, 0.0), 2.0, rtol)
    [event] = run.events
    assert event.time == pytest.approx(4 / 3, abs=1e-12)
    for side in (event.before, event.after):
        assert side["guide.friction"] == pytest.approx(-4.0, abs=1e-10)
        assert side["slider.ax"] == pytest.approx(0.0, abs=1e-10)


def test_pin_is_a_guide_with_an_inertia():
    """A torque turns a body on a pin as a force moves a mass of that size: angle and friction by their numbers."""
    guide = load_scene("mass-stribeck")
    declared = guide.joints["guide"]
    keys = ("friction", "static_friction", "stribeck_velocity", "stribeck_shape", "damping")
    pin = scene_from_dict(
        {
            "t_end": 5,
            "bodies": {"wheel": {"mass": 3.0, "inertia": 1.0, "position": [0.4, 0.7]}},
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["wheel", "ground"],
                    "points": [[0, 0], [0.4, 0.7]],
                    **{key: getattr(declared, key) for key in keys},
                }
            },
            "forces": {
                "torque": {
                    "type": "torque",
                    "body": "wheel",
                    "law": {"type": "sine", "amplitude": 25, "frequency": pi / 2},
                }
            },
        }
    )
    turning, sliding = simulate(pin), simulate(guide)
    for of_pin, of_guide in (
        ("wheel.angle", "slider.x"),
        ("pin.slip_velocity", "guide.slip_velocity"),
        ("pin.friction", "guide.friction"),
    ):
        np.testing.assert_allclose(turning[of_pin], sliding[of_guide], rtol=0, atol=1e-7)


def test_cells_of_a_large_mechanism():
    """Ten masses in a row, with springs between them that nothing stretches: each moves as one mass alone."""
    declared = load_scene("mass-stribeck")
    masses = [f"mass-{i}" for i in range(10)]
    names = ("friction", "static_friction", "stribeck_velocity", "damping")
    keys = {key: getattr(declared.joints["guide"], key) for key in names}
    load = {"type": "sine", "amplitude": 25, "frequency": pi / 2}
    scene = scene_from_dict(
        {
            "t_end": 5,
            "gravity": [0, -10],
            "bodies": {
                name: {"mass": 1, "inertia": 1, "position": [i, 0]} for i, name in enumerate(masses)
            },
            # half of each bound by the weight, half by a constant
            "joints": {
                f"guide-{name}": {
                    "type": "translational",
                    "slider": name,
                    "mu": keys["friction"] / 20,
                    "mus": keys["static_friction"] / 20,
                    **{key: keys[key] / 2 for key in names[:2]},
                    **{key: keys[key] for key in names[2:]},
                }
                for name in masses
            },
            "springs": {
                f"link-{i}": {
                    "type": "linear",
                    "bodies": [masses[i + 1], masses[i]],
                    "axis": [1, 0],
                    "stiffness": 3,
                    "rest_length": 1,
                }
                for i in range(9)
            },
            "forces": {
                f"load-{name}": {"type": "force", "body": name, "direction": [1, 0], "law": load}
                for name in masses
            },
        }
    )
    assert len(Mechanism(scene).arrays.separate) == 10
    run, alone = simulate(scene), simulate(declared)
    for i, name in enumerate(masses):
        np.testing.assert_allclose(run[f"{name}.x"], i + alone["slider.x"], rtol=0, atol=1e-7)


def test_friction_of_every_sample_is_on_the_curve():
    """By the columns: in slip the bound at the speed of the sample, and the surfaces have the coefficient of it."""
    scene = vary(
        load_scene("block-on-incline"),
        {"guide.stribeck_velocity": 0.3, "incline": radians(25), "guide.friction": 0.2},
    )
    run = simulate(scene)
    guide = scene.guides["guide"]
    slips = run["guide.mode"] != 0
    speed = np.abs(run["guide.slip_velocity"])
    load = sum(run[f"guide.F{corner}"] for corner in (1, 2, 3, 4))
    coefficient = 0.2 + 0.1 * np.exp(-speed / 0.3)
    assert np.all(slips[1:]) and speed[-1] > 1.0
    np.testing.assert_allclose(coefficient_in_slip(guide, speed), coefficient, rtol=1e-14)
    np.testing.assert_allclose(bound_in_slip(guide, speed), 0.2, rtol=1e-14)
    np.testing.assert_allclose(
        -run["guide.friction"] * run["guide.mode"], 0.2 + coefficient * load, rtol=1e-11
    )
    lower = -coefficient * (run["guide.F1"] + run["guide.F2"]) - 0.1
    np.testing.assert_allclose(run["guide.friction_lower"], lower, rtol=0, atol=1e-10)


def test_energy_is_balanced():
    run = simulate(belt(), 1e-11, t_end=6.0, output_step=1e-3)
    frame = energies(run)
    assert np.max(np.abs(frame["balance"])) < 1e-5  # the trapezoidal rule, of order 2
    assert frame["guide.dissipated"].iloc[-1] > 0.1


@pytest.mark.parametrize("method", ["paper", "textbook"])
def test_the_papers_scheme_converges_to_the_same_motion(method):
    """Of order 4 while the block slides: with half of the step a twelfth of the error, or less."""
    scene = vary(
        load_scene("block-on-incline"),
        {
            "guide.stribeck_velocity": 0.3,
            "slider.velocity": [2 * cos(radians(20)), -2 * sin(radians(20))],
            "stabilization": {"method": "none"},
        },
    )

    def end(**arguments):
        run = ReferenceEngine().simulate(scene, t_end=0.5, output_step=0.5, **arguments)
        return run["guide.displacement"][-1]

    exact = end(rtol=1e-13)
    coarse, fine = (abs(end(dt=dt, method=method) - exact) for dt in (0.05, 0.025))
    assert fine < 1e-8 and coarse / fine > 12


def test_runs_of_one_mechanism_do_not_disturb_each_other():
    """The coefficients of the moment belong to a run: a second one in its middle leaves it as it is."""
    from stiction.reference_impl.integration.event_driven import Integration

    mechanism = Mechanism(belt())
    q, v = mechanism.initial_state()
    output = np.linspace(0, 3, 31)

    def integration():
        return Integration(mechanism, q, v, output, 3.0, 1e-9)

    alone = integration().run.columns["slider.x"]
    first, second = integration(), integration()
    second.forces_at(0.0, q, v + 0.3)
    np.testing.assert_array_equal(first.run.columns["slider.x"], alone)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"guide.stribeck_velocity": 0.0}, "guide.stribeck_velocity: found 0"),
        ({"guide.stribeck_velocity": -1.0}, "guide.stribeck_velocity: found -1"),
        ({"guide.stribeck_velocity": 1.0, "guide.stribeck_shape": 0.5}, "guide.stribeck_shape"),
        ({"guide.stribeck_shape": 2.0}, "expected stribeck_velocity too"),
        (
            {"guide.stribeck_velocity": 1.0, "guide.mu": None, "guide.mus": None},
            "expected dry friction too",
        ),
    ],
)
def test_keys_without_a_meaning_are_refused(changes, problem):
    with pytest.raises(SceneError, match=problem):
        vary(load_scene("block-on-incline"), changes)


def test_a_curve_of_one_coefficient_is_none():
    """Without an excess at rest the speed has no influence, so that engines with one coefficient take the scene."""
    scene = vary(load_scene("block-on-incline"), {"mus": 0.2, "guide.stribeck_velocity": 1.0})
    assert not scene.guides["guide"].depends_on_speed
    assert not Mechanism(scene).arrays.varying
    assert "stribeck_velocity" in scene.to_toml()


@pytest.mark.parametrize("engine", ["moreau", "pybullet", "pymunk", "exudyn"])
def test_engines_refuse_in_one_sentence(engine):
    try:
        one = load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(str(missing).splitlines()[0][:90])
    scene = vary(load_scene("block-on-incline"), {"guide.stribeck_velocity": 0.3})
    for fidelity in one.capabilities.fidelities:
        reason = one.reason_to_refuse(scene, fidelity)
        assert reason == (
            f"joints.guide: {engine} does not yet take friction that depends on the speed of slip"
        )
