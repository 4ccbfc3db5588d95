"""Adapters at joint fidelity on random scenes with all that the format allows, held to the reference."""

import numpy as np
import pytest
from random_joint_scenes import STEPS, compare, converges, random_joint_scene, truth_of

from stiction.engines import EngineMissing, load_engine
from stiction.scenes import scene_from_dict

ENGINES = ["exudyn", "pymunk", "pybullet", "mujoco", "drake", "dart"]
FEW = {"exudyn": (1, 2, 5, 6, 7)}
"""Seeds of every run of the tests; others of 0 to 7 take Exudyn seconds, with its callbacks in each step."""
RUNAWAY = {("pymunk", 98)}
"""Scenes in which a bound from the reactions of the pass before does not settle: a drive pulls two guides through each other, friction raises its own
load by more than itself, and the bound grows with each pass. The motion is given by the constraints, and the reference finds the one set of forces;
Exudyn's adapter, which repeats a step for the same bound, says that friction does not settle."""


def verdicts(engine, seeds):
    """The comparison of each scene that has one motion up to its end."""
    try:
        load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(str(missing))
    found = {}
    for seed in seeds:
        scene = random_joint_scene(seed)
        if (truth := truth_of(scene)) is not None:
            found[seed] = compare(engine, scene, truth)
    return found


@pytest.mark.parametrize("engine", ENGINES)
def test_a_few_scenes(engine):
    found = verdicts(engine, FEW.get(engine, range(8)))
    assert {
        seed: each for seed, each in found.items() if each.verdict not in ("converged", "refused")
    } == {}
    assert sum(each.verdict == "converged" for each in found.values()) >= 4


@pytest.mark.long
@pytest.mark.parametrize("engine", ENGINES)
def test_a_hundred_scenes(engine):
    """No run is wrong; at most a few end with a typed failure, where several guides load each other."""
    found = verdicts(engine, range(100))
    assert {(engine, seed) for seed, each in found.items() if each.verdict == "wrong"} == {
        pair for pair in RUNAWAY if pair[0] == engine
    }
    assert sum(each.verdict == "ended" for each in found.values()) <= 3
    assert sum(each.verdict == "converged" for each in found.values()) >= 60


def test_the_scenes_have_all_that_the_format_has():
    """Among two hundred: every kind of joint, drive, law, spring and load, closed loops, and points off in both directions."""
    kinds = set()
    for seed in range(200):
        scene = random_joint_scene(seed)
        kinds |= {f"{len(scene.bodies)} bodies"} | (
            {"no gravity"} if scene.gravity is None else set()
        )
        kinds |= {"loop"} if "closing" in scene.joints else set()
        for guide in scene.guides.values():
            kinds |= {"guide on a body"} if guide.guide != "ground" else set()
            kinds |= {"eccentric slider point"} if all(guide.slider_point) else set()
            kinds |= {"eccentric guide"} if all(guide.point) else set()
            kinds |= {
                f"friction {guide.mu is not None} {guide.mus is not None} length {guide.length is not None} width {guide.width is not None}"
            }
        kinds |= {
            f"{drive.type} {drive.axis is not None} {drive.law.type}"
            for drive in scene.drives.values()
        }
        kinds |= {
            f"{spring.type} {getattr(spring, 'axis', None) is not None} {spring.damping > 0}"
            for spring in scene.springs.values()
        }
        kinds |= {
            f"{load.type} {load.law.type} {getattr(load.law, 'interpolation', '')}"
            for load in scene.forces.values()
        }
    expected = {f"{n} bodies" for n in range(1, 5)} | {
        "no gravity",
        "loop",
        "guide on a body",
        "eccentric slider point",
        "eccentric guide",
    }
    expected |= {
        f"friction {mu} {mus} length {length} width {width}"
        for mu, mus in ((False, False), (True, False), (True, True))
        for length, width in ((False, False), (True, False), (True, True))
    }
    expected |= {
        f"{kind} {law}"
        for kind in ("angle False", "distance False", "distance True")
        for law in ("linear", "sine", "table")
    }
    expected |= {
        f"{kind} {damped}"
        for kind in ("linear True", "linear False", "torsional False")
        for damped in (True, False)
    }
    expected |= {
        f"{kind} {law}"
        for kind in ("force", "torque")
        for law in ("constant ", "linear ", "sine ", "table linear", "table cubic")
    }
    assert expected - kinds == set()


def test_starts_are_consistent():
    """Positions to rounding, and velocities, those of drives included."""
    from stiction.reference_impl.equations_of_motion import EquationsOfMotion

    for seed in range(100):
        equations = EquationsOfMotion(random_joint_scene(seed))
        terms = equations.at(0.0, *equations.start())
        assert (
            np.abs(terms.phi).max(initial=0.0) < 1e-12
            and np.abs(terms.phi_dot).max(initial=0.0) < 1e-11
        )


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([1e-2, 2.5e-3, 6.2e-4], True),
        ([1e-2, 6e-4, 4e-5], True),  # orders 1 and 2
        ([1e-4, 4e-4, 1e-4, 2.5e-5], True),  # small by chance at first
        ([1e-2, 5e-3, 2.5e-3, 1.25e-3, 6.2e-4], False),  # order 1/2
        ([6e-3, 2.7e-3, 2.5e-3, 2.5e-3, 2.5e-3], False),
        ([1e-3] * len(STEPS), False),
        ([4e-3, 5e-3, 6e-3], False),
        ([1e-13, 1e-12, 1e-11], True),
    ],
)  # rounding
def test_what_counts_as_convergence(errors, expected):
    assert converges(errors) == expected


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slider_point", [[0.35, 0.0], [0.0, 0.3], [0.1, 0.1], [0.35, -0.33]])
def test_a_block_whose_guide_is_off_its_centre(engine, slider_point):
    """It slows down by mu g from the first instant on, wherever its guide holds it: x = v t - mu g t^2/2."""
    try:
        solver = load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(str(missing))
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "slider_point": slider_point,
                    "mu": 0.2,
                }
            },
            "bodies": {
                "block": {
                    "mass": 1,
                    "inertia": 0.1,
                    "velocity": [1, 0],
                    "position": [-slider_point[0], -slider_point[1]],
                }
            },
        }
    )
    run = solver.simulate(scene, t_end=0.4, dt=1e-3)
    way = run.t - 0.2 * 9.81 * run.t**2 / 2
    np.testing.assert_allclose(
        run["guide.displacement"], way, atol=0.2 * 9.81 * 0.4 * 1e-3 / 2 + 1e-9
    )  # h a t/2 of a method of order 1
    np.testing.assert_allclose(run["guide.friction"], -0.2 * 9.81, rtol=1e-6)
