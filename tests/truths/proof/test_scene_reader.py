"""What the reader of scenes rejects, and what it says."""

import pytest

from stiction.scenes import load_scene
from stiction.truths.proof.enclosures.series import working
from stiction.truths.proof.mechanisms.moving_guide import TURNING_ARM
from stiction.truths.proof.mechanisms.scene_reader import SceneReader
from stiction.truths.proof.motion import provable_mechanism
from stiction.truths.truth import NotThisMechanism


@pytest.fixture(autouse=True)
def working_precision():
    with working(64, 2):
        yield


@pytest.mark.parametrize(
    ("overrides", "column", "amount"),
    [
        ({"bodies.arm.velocity": [0, 0.25]}, "arm.vy", "0.25"),
        ({"bodies.slider.angle": "phi + 0.125"}, "slider.angle", "-0.125"),
    ],
)
def test_a_start_off_the_constraints_is_named_with_its_amount(overrides, column, amount):
    scene = load_scene("slider-on-moving-guide", overrides)
    with pytest.raises(NotThisMechanism) as caught:
        provable_mechanism(scene)
    assert f"bodies: found {column} off by {amount}" in str(caught.value)


def test_a_part_has_one_element_if_one_is_asked_for():
    reader = SceneReader(load_scene("slider-on-moving-guide"), TURNING_ARM)
    (guide,) = reader.elements("guide")
    assert reader.element("guide").mu.equals(reader.elements("guide")[guide].mu)
    assert reader.optional_element("no such part") is None
    with pytest.raises(ValueError, match="no such part: found no element"):
        reader.element("no such part")
    reader.match.elements["guide"]["spring"] = reader.scene.springs["spring"]
    with pytest.raises(ValueError, match="guide: found guide, spring"):
        reader.element("guide")
    with pytest.raises(ValueError, match="at most one"):
        reader.optional_element("guide")
