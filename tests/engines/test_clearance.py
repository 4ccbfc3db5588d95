"""Clearance and restitution of guides: a box that falls through its gap, what joints neglect, and who refuses."""

import numpy as np
import pytest

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import load_engine
from stiction.engines.joint_effects import JointEffect, neglected_keys
from stiction.engines.listing import known_engines
from stiction.engines.protocol import NEGLECTED, Refused
from stiction.engines.registry import EngineMissing
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.truths import NotThisMechanism, slider_bar_truth

GAP = 1e-3
GRAVITY = 9.81
FALL_TIME = np.sqrt(2 * GAP / GRAVITY)
"""Time in which a box in the middle of its guide falls to the lower surface: gap = g t^2 / 2."""
IMPACT_SPEED = np.sqrt(2 * GAP * GRAVITY)
DT = 1e-4
CASE = "slider-bar-case-3-mus-equals-mu"
CLEARANCE_TAKERS = ("moreau", "siconos", "pymunk", "pybullet", "mujoco", "exudyn", "drake", "dart")
RESTITUTION_TAKERS = {"moreau": 0.01, "siconos": 0.01, "pymunk": 0.01, "pybullet": 0.02}
"""Engines with Newton's law, and the tolerance of its coefficient at `DT`: PyBullet adds a bias to each impact."""


def falling_box(restitution=0.0, gap=GAP):
    """Return a box that begins in the middle of a horizontal guide, under gravity, and slides at 1 m/s."""
    slider = {"mass": 2.0, "inertia": 0.05, "velocity": [1.0, 0.0]}
    guide = {
        "type": "translational",
        "slider": "slider",
        "length": 0.6,
        "width": 0.5,
        "clearance": gap,
        "restitution": restitution,
    }
    tables = {"gravity": [0, -GRAVITY], "bodies": {"slider": slider}, "joints": {"guide": guide}}
    return scene_from_dict(tables)


def run_of(name, scene):
    """Run an engine that is installed at contact fidelity for 0.1 s, with an output at each step."""
    engine = dict(known_engines()).get(name)
    if engine is None or isinstance(engine, EngineMissing):
        pytest.skip(f"{name} is not installed")
    return engine.simulate(scene, fidelity="contact", dt=DT, output_step=DT, t_end=0.1)


@pytest.mark.parametrize("name", CLEARANCE_TAKERS)
@pytest.mark.parametrize("gap", [GAP, 2 * GAP])
def test_a_box_falls_through_its_clearance(name, gap):
    """It falls freely for sqrt(2 c/g), and is then at rest on the surface, c below the middle."""
    run = run_of(name, falling_box(gap=gap))
    y, t = run["slider.y"], run.t
    time = FALL_TIME * np.sqrt(gap / GAP)
    assert t[np.argmax(y <= -0.99 * gap)] == pytest.approx(time, abs=3 * DT)
    assert run["slider.vy"].min() == pytest.approx(-IMPACT_SPEED * np.sqrt(gap / GAP), rel=0.02)
    # the speed of fall times a step: by so much a contact that is found late is overlapped
    assert y.min() >= -gap - 2 * IMPACT_SPEED * np.sqrt(gap / GAP) * DT
    assert abs(run["slider.angle"]).max() < 1e-6


@pytest.mark.parametrize("restitution", [0.25, 0.5])
@pytest.mark.parametrize("name", RESTITUTION_TAKERS)
def test_newtons_law_of_restitution(name, restitution):
    speed = run_of(name, falling_box(restitution))["slider.vy"]
    assert speed.max() / -speed.min() == pytest.approx(restitution, rel=RESTITUTION_TAKERS[name])


def test_moreau_has_newtons_coefficient_to_rounding():
    speed = run_of("moreau", falling_box(0.3))["slider.vy"]
    hit = np.argmax(np.diff(speed) > 0)
    assert speed[hit + 1] == pytest.approx(-0.3 * speed[hit], abs=GRAVITY * DT)


@pytest.mark.parametrize("name", ["mujoco", "exudyn", "drake", "dart"])
def test_engines_without_newtons_law_refuse_restitution(name):
    with pytest.raises(Refused, match="does not yet take restitution in a guide"):
        run_of(name, falling_box(0.5))


@pytest.mark.parametrize("name", ["reference", "pymunk"])
def test_joints_neglect_clearance_and_say_so(name):
    ideal = load_scene(CASE)
    scene = vary(ideal, {"guide.clearance": 1e-3, "guide.restitution": 0.4})
    engine = load_engine(name)
    run = engine.simulate(scene, t_end=0.5)
    twin = engine.simulate(ideal, t_end=0.5)
    assert run.settings[NEGLECTED] == ["joints.guide.clearance", "joints.guide.restitution"]
    assert NEGLECTED not in twin.settings
    for column, values in twin.columns.items():
        np.testing.assert_array_equal(run[column], values)


def test_each_guide_has_its_own_clearance():
    """The setting of Moreau's method is for guides that declare none; the trajectory reports each gap."""
    scene = load_scene("elliptic-trammel")
    first, second = scene.guides
    sized = {f"{name}.{key}": 0.2 for name in scene.guides for key in ("length", "width")}
    sized |= {f"{name}.mus": None for name in scene.guides}  # Moreau's method has one coefficient
    changed = vary(scene, sized | {f"{first}.clearance": 1e-3, f"{second}.clearance": 2e-3})
    run = load_engine("moreau").simulate(changed, fidelity="contact", dt=1e-3, t_end=0.01)
    assert run.settings["gaps [m]"] == {first: 1e-3, second: 2e-3}


def test_the_truth_of_a_scene_with_clearance_is_that_of_ideal_joints():
    scene = vary(load_scene(CASE), {"guide.clearance": 1e-3})
    truth = ground_truth(scene, 0.5)
    ideal = ground_truth(load_scene(CASE), 0.5)
    assert truth.tier == ideal.tier
    assert "joints.guide.clearance" in truth.note
    assert not ideal.note
    with pytest.raises(NotThisMechanism, match="clearance"):
        slider_bar_truth(scene, 0.5)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"guide.clearance": 0.0}, "guide.clearance"),
        ({"guide.clearance": 1e-3, "guide.width": None}, "guide.clearance"),
        ({"guide.clearance": 1e-3, "guide.width": None, "guide.length": None}, "guide.clearance"),
        ({"guide.restitution": 0.5}, "guide.restitution"),
        ({"guide.clearance": 1e-3, "guide.restitution": 1.5}, "guide.restitution"),
        ({"guide.clearance": 1e-3, "guide.restitution": -0.1}, "guide.restitution"),
    ],
)
def test_gaps_without_corners_or_without_meaning_are_refused(change, key):
    with pytest.raises(SceneError, match=key):
        vary(load_scene(CASE), change)


def test_clearance_is_an_effect_and_a_gap_of_no_restitution_is_one_effect():
    assert neglected_keys(falling_box(0.0)) == ["joints.guide.clearance"]
    effects = load_engine("exudyn").capabilities.joint_effects["contact"]
    assert JointEffect.CLEARANCE in effects and JointEffect.RESTITUTION not in effects
