"""The second method against a truth of its own; the reference against it on mechanisms with several freedoms."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fuzz.several_freedoms import (
    RESERVE,
    differences,
    random_scene,
    scene_with_constant_bounds,
    scene_with_pins_under_load,
    scene_with_stribeck_curves,
)

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth
from stiction.truths.enumerated_motion import STEPS, TOLERANCE, simulate
from stiction.truths.truth import Tier

RTOLS = (1e-9, 1e-12)


def reference(scene, t_end, rtol):
    return ReferenceEngine().simulate(
        scene, t_end=t_end, rtol=rtol, stabilization="projection", output_step=t_end
    )


@pytest.mark.parametrize(("case", "t_end"), [(1, 8.4), (3, 1.2)])
def test_follows_the_reduced_equation(case, t_end):
    """One guide, every kind of event, against the equation of one degree of freedom."""
    scene = load_scene(f"slider-bar-case-{case}")
    motion, true = simulate(scene, t_end), slider_bar_truth(scene, t_end)
    events = [event for event in true.events if event.time < t_end]
    assert [event.kind for event in motion.events] == [event.kind for event in events]
    np.testing.assert_allclose(
        [event.time for event in motion.events],
        [event.time for event in events],
        rtol=0,
        atol=RESERVE * TOLERANCE,
    )
    assert motion.q[-1, 3] == pytest.approx(true(t_end)["slider.x"][0], abs=RESERVE * TOLERANCE)
    assert motion.breakdown is None and motion.violation < RESERVE * TOLERANCE


T_END = 0.6


@cache
def drawn(i):
    """A scene and its motion by the second method."""
    return (scene := random_scene(0, i)), simulate(scene, T_END)


def complete_run_agrees(scene):
    """The second method reaches the end, and a run of the reference is the same."""
    motion = simulate(scene, T_END)
    assert motion.breakdown is None and motion.violation < RESERVE * TOLERANCE
    run = reference(scene, T_END, 1e-9)
    assert run.breakdown is None and differences(scene, motion, run, 1e-9) == []


def runs_without_a_wrong_one(scene, t_end):
    """Runs at all tolerances, none of which is silently another motion than that of the second method."""
    motion = simulate(scene, t_end)
    assert motion.violation < RESERVE * TOLERANCE
    runs = []
    for rtol in RTOLS:
        run = reference(scene, t_end, rtol)
        assert run.breakdown or not motion.breakdown, (scene.name, rtol)
        assert differences(scene, motion, run, rtol) == [], (scene.name, rtol)
        runs.append(run)
    return runs


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms(i):
    scene, motion = drawn(i)
    assert motion.breakdown is None and motion.violation < RESERVE * TOLERANCE
    for rtol in RTOLS:
        run = reference(scene, T_END, rtol)
        assert run.breakdown is None and differences(scene, motion, run, rtol) == []


@pytest.mark.long
@pytest.mark.parametrize("block", range(12))
def test_hundreds_of_random_mechanisms(block):
    """Nothing is silently wrong. Where a scene has several motions the reference must stop with a typed breakdown."""
    for i in range(100, 400)[block::12]:
        scene, t_end = random_scene(2, i), 1.5
        runs_without_a_wrong_one(scene, t_end)


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms_with_constant_bounds(i):
    """Friction with bounds of its own in pins and guides, alone and beside coefficients, and damping."""
    scene = scene_with_constant_bounds(11, i)
    complete_run_agrees(scene)


@pytest.mark.long
@pytest.mark.parametrize("block", range(12))
def test_hundreds_of_random_mechanisms_with_constant_bounds(block):
    """Nothing is silently wrong; without friction that depends on a load nothing is refused either."""
    for i in range(300)[block::12]:
        scene, t_end = scene_with_constant_bounds(3, i), 1.0
        for run in runs_without_a_wrong_one(scene, t_end):
            assert run.breakdown is None or any(guide.mu for guide in scene.guides.values())


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms_with_stribeck_curves(i):
    """Friction that falls with the speed of slip, by coefficients and by constant bounds, in guides and pins."""
    scene = scene_with_stribeck_curves(1, i)
    complete_run_agrees(scene)


@pytest.mark.long
@pytest.mark.parametrize("block", range(12))
def test_hundreds_of_random_mechanisms_with_stribeck_curves(block):
    """Nothing is silently wrong."""
    for i in range(300)[block::12]:
        scene, t_end = scene_with_stribeck_curves(1, i), 1.5
        runs_without_a_wrong_one(scene, t_end)


@pytest.mark.parametrize("i", range(3))  # hundreds in the long tests
def test_random_mechanisms_with_pins_under_load(i):
    """Friction of pins by the forces in them, beside constant bounds and curves of friction."""
    scene = scene_with_pins_under_load(5, i)
    complete_run_agrees(scene)


@pytest.mark.long
@pytest.mark.parametrize("block", range(12))
def test_hundreds_of_random_mechanisms_with_pins_under_load(block):
    """Nothing is silently wrong."""
    for i in range(300)[block::12]:
        scene, t_end = scene_with_pins_under_load(5, i), 1.5
        runs_without_a_wrong_one(scene, t_end)


def test_surfaces_of_a_guide_without_a_coefficient_change_without_an_event():
    """Its slider has a length, so that corners have forces, but its friction is a constant: scene 79 is accepted."""
    scene = scene_with_stribeck_curves(1, 79)
    guide = scene.guides["guide-slider-1"]
    assert guide.length and guide.mu is None and guide.friction
    run = ReferenceEngine().simulate(scene, t_end=1.5, rtol=1e-9)
    kinds = {event.kind for event in run.events if event.joint == "guide-slider-1"}
    assert run.breakdown is None and kinds == {"reversal"}


def test_a_wrong_run_is_found():
    """An event left out, invented, shifted by more than its tolerance, and another end state: none agrees."""
    (scene, motion), rtol = drawn(0), 1e-9
    run = reference(scene, T_END, rtol)
    assert differences(scene, motion, run, rtol) == [] and len(run.events) > 2
    first, *others = run.events
    body = next(iter(scene.bodies))
    for wrong in (
        replace(run, events=tuple(others)),
        replace(run, events=(*run.events, replace(first, time=T_END - 1e-4))),
        replace(run, events=(replace(first, time=first.time + 1e-3), *others)),
        replace(
            run,
            events=(replace(first, kind="corner" if first.kind != "corner" else "stick"), *others),
        ),
        replace(run, columns={**run.columns, f"{body}.x": run[f"{body}.x"] + 1e-3}),
    ):
        assert differences(scene, motion, wrong, rtol)


def test_several_motions_are_reported():
    """They begin at sin th = 0.75, by closed form (`uniqueness-lost.toml`); every step is audited in its middle."""
    onset, t_end = np.arcsin(0.75) / (np.pi / 4), 1.5
    found = simulate(load_scene("uniqueness-lost"), t_end).breakdown
    assert (found.kind, found.solutions) == ("several solutions", 2)
    assert onset < found.time < onset + 2 * t_end / STEPS


def test_no_motion_is_reported():
    """Where no acceleration satisfies Coulomb's law from the start, by closed form (`existence-lost.toml`)."""
    motion = simulate(load_scene("existence-lost"), 1.0)
    assert (motion.breakdown.kind, motion.breakdown.time, motion.breakdown.solutions) == (
        "no solution",
        0.0,
        0,
    )
    assert len(motion.t) == 1 and not motion.events


def test_a_self_locking_guide_is_refused():
    scene = vary(load_scene("slider-bar-case-1"), {"guide.width": 20.0})
    with pytest.raises(ValueError, match="guide: found width 20"):
        simulate(scene, 1.0)


def test_redundant_constraints_are_a_typed_breakdown():
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"block": {"mass": 1, "inertia": 1}},
            "joints": {
                name: {"type": "translational", "slider": "block", "length": 0.5, "mu": 0.1}
                for name in ("guide", "again")
            },
        }
    )
    assert simulate(scene, 0.1).breakdown.kind == "singular"


def test_guides_that_share_a_load_which_changes_are_a_typed_breakdown():
    """A trammel at rest: its two guides have one freedom, and the second method does not follow how they share."""
    scene = load_scene("hard/trammel-comes-to-rest")
    rest = simulate(scene, scene.t_end)
    assert rest.breakdown is None and rest.rest is not None and rest.t[-1] == rest.rest
    body = next(iter(scene.bodies))
    load = {
        "type": "torque",
        "body": body,
        "law": {"type": "sine", "amplitude": 1e-6, "frequency": 1.0},
    }
    changing = scene_from_dict({**scene._raw, "forces": {"small": load}})
    motion = simulate(changing, scene.t_end)
    assert motion.breakdown.kind == "singular" and "changes" in motion.breakdown.reason
    assert motion.rest is None and motion.t[-1] == pytest.approx(rest.rest, abs=1e-3)


def test_own_truth_states_its_tier_and_is_the_motion():
    """Two frictional guides and a chain: no independent truth has them. The second method does, to its own tolerance."""
    (scene, other), bound = drawn(0), RESERVE * TOLERANCE
    truth = ground_truth(scene, T_END)
    assert truth.tier == Tier.OWN_RUN and len(truth.events) == len(other.events)
    np.testing.assert_allclose(
        [event.time for event in truth.events],
        [event.time for event in other.events],
        rtol=0,
        atol=bound,
    )
    for body, q in zip(scene.bodies, other.q[-1].reshape(-1, 3)):
        for name, value in zip(("x", "y", "angle"), q):
            assert truth(T_END)[f"{body}.{name}"][0] == pytest.approx(value, abs=bound)
    assert 0 < truth.uncertainty["event time"] < bound
