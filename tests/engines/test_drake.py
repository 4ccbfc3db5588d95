"""Drake's contacts: a box that is carried from the start and sticks; two of them with a pin that closes a loop; bad input."""

import tomllib

import numpy as np
import pytest

from stiction.engines import BadTrajectory, EngineFailure, Refused, load_engine
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth, trammel_truth

pytest.importorskip("pydrake")
G = 9.81
STEP = 1e-3


@pytest.fixture(scope="module")
def engine():
    return load_engine("drake")


def box(push=0.0, *, mu=0.2, mus=0.3, velocity=0.0):
    """2 kg in a guide of 0.6 m by 0.1 m, pushed along it."""
    return scene_from_dict(
        {
            "gravity": [0.0, -G],
            "bodies": {"slider": {"mass": 2, "inertia": 0.1, "velocity": [velocity, 0.0]}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [1, 0],
                    "length": 0.6,
                    "width": 0.1,
                    "mu": mu,
                    "mus": mus,
                }
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "slider",
                    "direction": [1, 0],
                    "law": {"type": "constant", "value": push},
                }
            },
        }
    )


def simulate(engine, scene, t_end=0.5, dt=STEP, **settings):
    return engine.simulate(scene, t_end=t_end, dt=dt, fidelity="contact", **settings)


def continue_(engine, scene, t_end=0.5, rtol=1e-5, **settings):
    """By the continuous plant."""
    return engine.simulate(
        scene, t_end=t_end, rtol=rtol, fidelity="contact", method="continuous", **settings
    )


BOTH = pytest.mark.parametrize("by", [simulate, continue_])
"""Plants: what is regularized in the continuous one is slower than its tolerance of 1e-5 m/s; the discrete one is late by steps."""


@BOTH
def test_a_box_at_rest_is_carried(engine, by):
    """It neither lands nor sinks: the surface carries its weight from the start, to what sixteen tenths in turn leave of it."""
    run = by(engine, box())
    np.testing.assert_allclose(run["slider.y"], 0.0, atol=1e-12)
    np.testing.assert_allclose(run["guide.normal_force"], 2 * G, rtol=1e-9)
    assert np.all(run["guide.mode"] == 0)


@BOTH
def test_a_block_in_two_guides_is_braked_by_both(engine, by):
    """Corners of one guide lie behind the other's surfaces, and what each guide tells is of its own corners: mu1 g/2 + mu2 g/2."""
    guides = {
        name: {
            "type": "translational",
            "slider": "block",
            "direction": [1, 0],
            "point": [0, y],
            "slider_point": [0, y],
            "length": 1,
            "width": 0.1,
            "mu": mu,
        }
        for name, y, mu in (("one", 0.0, 0.2), ("two", 0.5, 0.4))
    }
    run = by(
        engine,
        scene_from_dict(
            {
                "gravity": [0, -G],
                "bodies": {"block": {"mass": 2, "inertia": 0.1, "velocity": [2, 0]}},
                "joints": guides,
            }
        ),
        0.3,
    )
    np.testing.assert_allclose(
        run["one.slip_velocity"],
        2 - 0.3 * G * run.t,
        atol=2 * STEP * 0.3 * G if by is simulate else 1e-6,
    )
    for name, mu in (("one", 0.2), ("two", 0.4)):
        np.testing.assert_allclose(run[f"{name}.friction"][1:], -mu * G, rtol=1e-6)
        assert np.all(run[f"{name}.mode"][1:] == 1)


@pytest.mark.parametrize(("share", "sticks"), [(0.998, True), (1.002, False)])
def test_threshold_is_that_of_the_static_coefficient(engine, share, sticks):
    run = simulate(engine, box(share * 0.3 * 2 * G))
    if sticks:
        assert (
            np.abs(run["guide.slip_velocity"]).max() < 22 * 1e-3 * 0.3 * G * STEP * 2
        )  # a box has two corners, each with half of it or more
    else:
        # mus for the time in which 0.2 % of it as excess bring the slider to the speed at which friction counts as whole, and two steps
        assert run["guide.slip_velocity"][-1] == pytest.approx(
            (share * 0.3 - 0.2) * G * 0.5, abs=0.1 * G * 10 * STEP
        )


@pytest.mark.parametrize("near_rigid", [1.0, 4.0])
def test_stiffness_is_that_of_its_setting(engine, near_rigid):
    """A slow load across the guide presses two corners in by P/2 over (2 pi/near_rigid)^2 / (w h^2), with w = 1/m + (a/2)^2/I the mobility of a corner."""
    scene = vary(
        box(5.0, mu=0.0, mus=None),
        {
            "push.direction": [0, -1],
            "push.law": {"type": "sine", "amplitude": 5.0, "frequency": 1.0},
        },
    )
    run = simulate(engine, scene, 1.0, near_rigid=near_rigid)
    stiffness = (2 * np.pi / near_rigid / STEP) ** 2 / (1 / 2 + 0.3**2 / 0.1)
    np.testing.assert_allclose(
        run["slider.y"], -5.0 * np.sin(run.t) / (2 * stiffness), atol=0.01 * 5.0 / (2 * stiffness)
    )


def test_two_sliders_with_a_loop(engine):
    """Each slider has coordinates of its own, so that no curvature of a pin's path presses it into its guide."""
    scene = load_scene("elliptic-trammel")
    truth = trammel_truth(scene, 1.0)
    errors = [
        np.abs(run["bar.x"] - truth(run.t)["bar.x"]).max()
        for run in (simulate(engine, scene, 1.0, dt) for dt in (1e-3, 2.5e-4))
    ]
    assert errors[1] < errors[0] / 4**0.8


def test_the_motor_turns_as_told(engine):
    """By a law of its own and at constant rate."""
    scene = load_scene("slider-bar-case-1")
    np.testing.assert_allclose(
        (run := simulate(engine, scene, 1.0))["bar.angle"] - run["slider.angle"],
        np.pi / 4 * run.t,
        atol=1e-5,
    )
    swinging = vary(scene, {"motor.law": {"type": "sine", "amplitude": 1.0, "frequency": "w0"}})
    run = simulate(engine, swinging, 1.0)
    np.testing.assert_allclose(
        run["bar.angle"] - run["slider.angle"], np.sin(np.pi / 4 * run.t), atol=1e-5
    )


def test_convex_cones_jam_in_a_guide_with_two_sides(engine):
    """`similar` and `sap` let what slides glide off its surface; the other surface presses it back: friction without a load."""
    scene = load_scene("slider-bar-case-1")
    truth = slider_bar_truth(scene, 1.0)
    lagged, similar, sap = (
        np.abs(run["slider.x"] - truth(run.t)["slider.x"]).max()
        for run in (
            simulate(engine, scene, 1.0, approximation=word)
            for word in ("lagged", "similar", "sap")
        )
    )
    assert min(similar, sap) > 50 * lagged


def test_a_motor_in_a_pin_that_closes_a_loop_is_refused(engine):
    """The trammel with motors in both of its pins, one of which ties two sliders with coordinates of their own."""
    scene = load_scene("elliptic-trammel")
    spin = scene.bodies["bar"].angular_velocity
    data = tomllib.loads(scene.to_toml())
    data["drives"] = {
        f"motor-{end}": {
            "type": "angle",
            "bodies": ["bar", f"slider-{end}"],
            "law": {"type": "linear", "rate": spin, "offset": scene.bodies["bar"].angle},
        }
        for end in "xy"
    }
    with pytest.raises(
        Refused, match="drives.motor-.: the Drake adapter drives one hinge at a time"
    ):
        simulate(engine, scene_from_dict(data))


def test_more_guides_than_drake_survives_are_refused(engine):
    """The most that are taken run; of one more Drake's broad phase is lost."""

    def side_by_side(count):
        return scene_from_dict(
            {
                "gravity": [0, -G],
                "bodies": {
                    f"block-{i}": {
                        "mass": 2,
                        "inertia": 0.1,
                        "position": [0, i],
                        "velocity": [1, 0],
                    }
                    for i in range(count)
                },
                "joints": {
                    f"guide-{i}": {
                        "type": "translational",
                        "slider": f"block-{i}",
                        "direction": [1, 0],
                        "point": [0, i],
                        "length": 0.6,
                        "width": 0.1,
                        "mu": 0.2,
                    }
                    for i in range(count)
                },
            }
        )

    run = simulate(engine, side_by_side(7), 0.05)
    for i in range(7):
        assert run[f"guide-{i}.slip_velocity"][-1] == pytest.approx(
            1 - 0.2 * G * 0.05, abs=2 * STEP * 0.2 * G
        )
    with pytest.raises(
        Refused, match="8 guides; with the surfaces of more than 7 Drake ends the process"
    ):
        simulate(engine, side_by_side(8))
    assert engine.refusal(side_by_side(8), "joint") is None


@pytest.mark.parametrize("speed", [0.2, 1.5, -1.5])
def test_continuous_plant_starts_in_its_surfaces_on_an_incline(engine, speed):
    """A short slider that is slow to turn is carried by the two lower corners from the start, as it slides up or down."""
    angle, mass, mu, length, width = 0.5, 0.5, 0.25, 0.2, 0.1
    c, s = np.cos(angle), np.sin(angle)
    scene = scene_from_dict(
        {
            "gravity": [0.0, -G],
            "bodies": {
                "slider": {
                    "mass": mass,
                    "inertia": 0.02,
                    "angle": angle,
                    "velocity": [speed * c, speed * s],
                }
            },
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "angle": angle,
                    "direction": [c, s],
                    "length": length,
                    "width": width,
                    "mu": mu,
                }
            },
        }
    )
    run = continue_(engine, scene, t_end=0.02)
    normal, friction = mass * G * c, -np.sign(speed) * mu * mass * G * c
    front = (
        normal / 2 - friction * width / 2 / length
    )  # about the centre: the lower corners against friction at the lower surface
    for corner, force in zip(("F1", "F2", "F3", "F4"), (normal - front, front, 0.0, 0.0)):
        np.testing.assert_allclose(run[f"guide.{corner}"], force, atol=0.01 * normal)
    np.testing.assert_allclose(
        run["guide.slip_velocity"], speed + (friction / mass - G * s) * run.t, atol=1e-3
    )


@pytest.mark.parametrize("tolerance", [1e-5, 1e-4])
@pytest.mark.parametrize(("share", "sticks"), [(0.998, True), (1.002, False)])
def test_continuous_plant_sticks_up_to_the_static_coefficient(engine, share, sticks, tolerance):
    """Its law is given coefficients whose largest friction is mus; below, a slider creeps with less than ten times the tolerance."""
    run = continue_(engine, box(share * 0.3 * 2 * G), stiction_tolerance=tolerance)
    assert (np.abs(run["guide.slip_velocity"]).max() < 10 * tolerance) == sticks
    assert run["guide.mode"][-1] == (not sticks)
    if not sticks:  # as under mu, but for the time that 0.2 % of mus take from rest to the speed at which friction falls
        assert run["guide.slip_velocity"][-1] == pytest.approx(
            (share * 0.3 - 0.2) * G * 0.5, abs=0.3 * G * 0.1
        )


def test_continuous_plant_gives_way_by_its_stiffness(engine):
    """A slow load across the guide presses two corners in; there is no step that the stiffness depends on."""
    scene = vary(
        box(5.0, mu=0.0, mus=None),
        {
            "push.direction": [0, -1],
            "push.law": {"type": "sine", "amplitude": 5.0, "frequency": 1.0},
        },
    )
    for step in (1e-3, 5e-3):
        run = continue_(engine, scene, 1.0, stiffness=1e6, longest_step=step)
        np.testing.assert_allclose(
            run["slider.y"], -5.0 * np.sin(run.t) / 2e6, atol=0.01 * 5.0 / 2e6
        )


def test_continuous_plant_has_first_order(engine):
    """In its longest step, where that is what limits steps; the motor turns as told, and its torque is right from the start, as the boxes need not fall into their surfaces."""
    scene = load_scene("slider-bar-case-1-mus-equals-mu")
    truth = slider_bar_truth(scene, 2.0)
    runs = [
        continue_(engine, scene, 2.0, longest_step=step, stiction_tolerance=1e-6)
        for step in (2e-3, 5e-4)
    ]
    errors = [np.abs(run["slider.x"] - truth(run.t)["slider.x"]).max() for run in runs]
    assert np.log(errors[0] / errors[1]) / np.log(4) > 0.8
    np.testing.assert_allclose(
        runs[1]["bar.angle"] - runs[1]["slider.angle"], np.pi / 4 * runs[1].t, atol=1e-6
    )
    np.testing.assert_allclose(runs[1]["motor.effort"], truth(runs[1].t)["motor.effort"], atol=0.05)


def test_continuous_plant_converges_with_the_stiction_tolerance(engine):
    """A break-away waits until a slider creeps with some times the tolerance, longer than steps delay it."""
    scene = load_scene("slider-bar-case-1")
    truth = slider_bar_truth(scene, 1.0)
    errors = [
        np.abs(run["slider.x"] - truth(run.t)["slider.x"]).max()
        for run in (
            continue_(engine, scene, 1.0, stiction_tolerance=tolerance)
            for tolerance in (1e-3, 1e-4, 1e-5)
        )
    ]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_continuous_plant_holds_the_tolerance_of_its_steps(engine):
    scene = load_scene("slider-bar-case-3")
    truth = slider_bar_truth(scene, 1.0)
    runs = [
        continue_(engine, scene, 1.0, rtol, longest_step=0.05, stiction_tolerance=1e-3)
        for rtol in (1e-4, 1e-6)
    ]
    errors = [np.abs(run["slider.x"] - truth(run.t)["slider.x"]).max() for run in runs]
    assert (
        errors[0] > 2 * errors[1]
        and runs[0].cost.counters["steps"] < runs[1].cost.counters["steps"]
    )


def test_what_the_continuous_plant_cannot_have_is_refused(engine):
    with pytest.raises(Refused, match="joints.pin-.: closes a loop"):
        continue_(engine, load_scene("elliptic-trammel"))
    swinging = vary(
        load_scene("slider-bar-case-1"),
        {"motor.law": {"type": "sine", "amplitude": 1.0, "frequency": "w0"}},
    )
    with pytest.raises(Refused, match="drives.motor: follows a law of its own"):
        continue_(engine, swinging)
    with pytest.raises(Refused, match="the start is .* off .* assembles nothing"):
        continue_(engine, vary(box(), {"slider.position": [0.0, 1e-3]}))


def test_continuous_plant_that_loses_static_friction_says_so(engine):
    """Ten times the step, or a tenth of the tolerance: a slider under 0.98 of its static friction would slide."""
    scene = box(0.98 * 0.3 * 2 * G)
    assert np.all(continue_(engine, scene)["guide.mode"] == 0)
    for settings in ({"longest_step": 1e-2}, {"stiction_tolerance": 1e-6}):
        with pytest.raises(
            BadTrajectory, match="stiction_tolerance: found .* static friction is lost"
        ):
            continue_(engine, scene, **settings)


def test_continuous_plant_that_fails_says_so(engine):
    """In an assertion of Drake's, which ends the process if nobody keeps it from it."""
    scene = vary(
        load_scene("slider-bar-case-1"), {"load.law": {"type": "constant", "value": 1e300}}
    )
    with pytest.raises(EngineFailure, match="drake: Failure at .* after t = 0 s with rtol = 1e-05"):
        continue_(engine, scene)


def test_continuous_plant_ends_where_it_is_told(engine):
    """At an instant that is no multiple of the output step, and nearer to the last one than its longest step."""
    run = continue_(engine, box(velocity=0.5), 0.1005)
    assert run.t[-1] == 0.1005 and run.t[-2] == 0.1
    np.testing.assert_allclose(run["guide.friction"], -0.2 * 2 * G, rtol=1e-4)


def test_a_box_at_rest_begins_at_rest(engine):
    """Its surfaces take some trial steps to carry it, in which it slips: it began with the kinetic coefficient, for good, at 12.2 N of 15.1 N."""
    run = engine.simulate(
        load_scene("hard/break-away-for-a-millisecond"),
        t_end=1.0,
        dt=1e-3,
        fidelity="contact",
        output_step=1e-2,
    )
    assert (
        np.abs(run["slider.x"] - run["slider.x"][0]).max() < 1e-4
    )  # creep of the regularized friction; with mu alone it is 0.1 m
    assert np.all(run["guide.mode"] == 0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        *(
            ({name: 0.0}, f"{name}: found 0.0; expected a number > 0")
            for name in ("near_rigid", "stiction_tolerance")
        ),
        *(
            ({"method": "continuous", **settings}, words)
            for settings, words in [
                ({"dt": 1e-3}, "found dt or joint fidelity"),
                ({"fidelity": "joint"}, "found dt or joint fidelity"),
                ({"passes": 2}, "passes: drake has no such setting"),
                *(
                    ({name: 0.0}, f"{name}: found 0.0")
                    for name in ("stiffness", "stiction_tolerance", "longest_step")
                ),
            ]
        ),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(
            load_scene("slider-bar-case-1-mus-equals-mu"),
            **{"t_end": 0.1, "fidelity": "contact", **settings},
        )


def test_a_loop_that_closes_with_the_ground_is_refused_in_words():
    """Drake ends the process in the first step of such a constraint. A bar in the slot of a block that slides on the ground, pinned to the ground."""
    scene = scene_from_dict(
        {
            "bodies": {
                "block": {"mass": 1, "inertia": 1},
                "bar": {"mass": 1, "inertia": 0.1, "position": [0, 0.5]},
            },
            "joints": {
                "guide": {"type": "translational", "slider": "block"},
                "slot": {
                    "type": "translational",
                    "slider": "bar",
                    "guide": "block",
                    "direction": [0, 1],
                },
                "foot": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[0, 0.5], [0, 1]],
                },
            },
        }
    )
    assert "joints.foot: closes a loop with the ground" in load_engine("drake").refusal(
        scene, "joint"
    )
