"""Structures: what fits is found by its role, and everything that does not fit is named."""

import pytest

from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import (
    NotThisMechanism,
    four_bar_truth,
    moving_guide_truth,
    oscillator_truth,
    slider_crank_truth,
)
from stiction.truths.closed_form.oscillator import ON_BELT, ON_GROUND
from stiction.truths.closed_form.slider_crank import SLIDER_CRANK
from stiction.truths.reduced.slider_bar import SLIDER_BAR
from stiction.truths.reduced.trammel import TRAMMEL


def test_elements_by_part_and_bodies_by_role():
    found = ON_BELT.match(load_scene("mass-on-belt"))
    assert found.bodies == {"ground": "ground", "mass": "slider", "belt": "belt"}
    assert (
        found.name("guide") == "guide" and found["guide"].guide == "belt" and found["force"] is None
    )
    with pytest.raises(KeyError, match="force"):
        found.name("force")
    torques = TRAMMEL.match(load_scene("elliptic-trammel")).elements
    assert list(torques["torques"]) == ["torque"] and not torques["springs-x"]


@pytest.mark.parametrize(
    "change, fault",
    [
        (
            {"joints.pin.points": [[0.5, 0], [0, 0]]},
            "pin.points: found [[0.5, 0.0], [0.0, 0.0]]; expected [[< 0, 0], [0, 0]]",
        ),
        ({"joints.guide.angle": 0.1}, "guide.angle: found 0.1; expected 0"),
        (
            {"drives.motor.bodies": ["bar", "ground"]},
            "motor: found a Drive of bar and ground; expected none",
        ),
        (
            {"drives.motor.law": {"type": "constant", "value": 1}},
            "motor.law: found constant; expected Linear",
        ),
        (
            {"springs.spring.axis": [0, 1]},
            "spring: expected axis [> 0, 0], or none and rest_length 0",
        ),
        ({"gravity": [1, 0]}, "gravity: found [1.0, 0.0]; expected none or [0, any]"),
    ],
)
def test_a_field_that_does_not_fit_is_named(change, fault):
    with pytest.raises(NotThisMechanism) as caught:
        SLIDER_BAR.match(vary(load_scene("slider-bar-case-1"), change))
    assert fault in str(caught.value)


def added(name, section, **element):
    raw = load_scene(name)._raw
    return scene_from_dict(
        {**raw, section: {**raw.get(section, {}), "added": element}}, f"{name} and more"
    )


@pytest.mark.parametrize(
    "scene, truth",
    [
        (
            added(
                "coulomb-oscillator",
                "drives",
                type="angle",
                bodies=["slider", "ground"],
                law={"type": "linear", "rate": 1},
            ),
            oscillator_truth,
        ),
        (
            added("mass-on-belt", "springs", type="linear", bodies=["belt", "ground"], stiffness=1),
            oscillator_truth,
        ),
        (
            added(
                "slider-crank",
                "forces",
                type="torque",
                body="rod",
                law={"type": "constant", "value": 1},
            ),
            slider_crank_truth,
        ),
        (
            added(
                "slider-on-moving-guide",
                "springs",
                type="torsional",
                bodies=["arm", "ground"],
                stiffness=1,
            ),
            moving_guide_truth,
        ),
    ],
)
def test_what_a_mechanism_has_not_keeps_its_truth_away(scene, truth):
    with pytest.raises(NotThisMechanism, match="added: found a .*; expected none"):
        truth(scene)


def test_four_bars_of_another_shape_have_no_closed_form():
    """Feet nearer to each other than the couplers are long, and weight across: the uprights are no single pendulum."""
    for change in ({"joints.foot-1.points": [[-0.5, 0], [0.9, 0]]}, {"gravity": [1, -9.81]}):
        with pytest.raises(NotThisMechanism, match="row of four-bars"):
            four_bar_truth(vary(load_scene("four-bar"), change))


def test_pins_may_be_declared_in_either_order():
    """The reaction acts on the first body: it changes its sign with the order."""
    scene = load_scene("slider-crank")
    turned = vary(
        scene, {"joints.pin.bodies": ["slider", "rod"], "joints.pin.points": [[0, 0], ["l/2", 0]]}
    )
    assert SLIDER_CRANK.match(turned).name("slider pin") == "pin"
    one, other = slider_crank_truth(scene)(1.3), slider_crank_truth(turned)(1.3)
    assert one["pin.fx"] == -other["pin.fx"] != 0 and one["motor.effort"] == other["motor.effort"]


def test_missing_parts_are_named():
    with pytest.raises(NotThisMechanism) as caught:
        ON_GROUND.match(load_scene("pendulum"))
    for fault in (
        "pendulum is not a mass on a spring",
        "spring: found none",
        "guide: found none; expected a Translational of mass and ground",
        "rod: found a Drive of mass and ground; expected none",
    ):
        assert fault in str(caught.value)
