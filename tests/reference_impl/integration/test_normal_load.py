"""Weight across the plane of a mechanism: the `normal_load` of a guide."""

import numpy as np
import pytest

from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.truths.enumerated_motion import simulate

RTOL = 1e-11


def puck(**guide):
    """A puck of 2 kg that slides on a table, seen from above, with 3 m/s at the start."""
    return scene_from_dict(
        {
            "t_end": 2.0,
            "bodies": {"puck": {"mass": 2, "inertia": 1, "velocity": [3, 0]}},
            "joints": {"table": {"type": "translational", "slider": "puck", **guide}},
        }
    )


def test_a_puck_on_a_table():
    """It decelerates by mu g under its weight of m g, which is across the plane, and rests after v/(mu g)."""
    mu, g = 0.2, 9.81
    run = ReferenceEngine().simulate(puck(mu=mu, normal_load=2 * g), rtol=RTOL, output_step=2.0)
    [stick] = run.events
    assert (stick.kind, stick.time) == ("stick", pytest.approx(3 / (mu * g), abs=1e-10))
    assert run["puck.x"][-1] == pytest.approx(9 / (2 * mu * g), abs=1e-10)
    assert stick.before["table.friction"] == pytest.approx(-mu * 2 * g)
    assert stick.before["table.normal_force"] == 0.0


@pytest.mark.parametrize(("push", "rests"), [(2.09, True), (2.11, False)])
def test_a_puck_at_rest_holds_by_its_static_coefficient(push, rests):
    """Under 7 N it holds up to mus 7 N = 2.1 N, and beyond accelerates by (push - mu 7 N) / m."""
    scene = puck(mu=0.2, mus=0.3, normal_load=7.0)
    raw = scene.model_dump(mode="json", exclude_none=True)
    raw["bodies"]["puck"]["velocity"] = [0.0, 0.0]
    raw["forces"] = {
        "push": {
            "type": "force",
            "body": "puck",
            "direction": [1, 0],
            "law": {"type": "constant", "value": push},
        }
    }
    run = ReferenceEngine().simulate(scene_from_dict(raw), rtol=RTOL, output_step=2.0)
    expected = 0.0 if rests else (push - 0.2 * 7.0) / 2 * 2.0
    assert run["puck.vx"][-1] == pytest.approx(expected, abs=1e-10)


def test_it_is_a_constant_bound():
    """The same motion as with the bounds mu and mus times the load."""
    load = 7.0
    with_load = puck(mu=0.2, mus=0.3, normal_load=load)
    with_bound = puck(mu=0.2, mus=0.3, friction=0.2 * load, static_friction=0.3 * load)
    runs = [ReferenceEngine().simulate(scene, rtol=RTOL) for scene in (with_load, with_bound)]
    np.testing.assert_array_equal(runs[0]["puck.x"], runs[1]["puck.x"])


def test_against_the_second_method():
    scene = vary(load_scene("slider-bar-case-3"), {"guide.normal_load": 4.0})
    run = ReferenceEngine().simulate(scene, t_end=1.2, rtol=RTOL, output_step=1.2)
    motion = simulate(scene, 1.2)
    x = run["slider.x"][-1]
    assert x == pytest.approx(motion.q[-1, 3], abs=1e-9)
    assert [e.kind for e in run.events] == [e.kind for e in motion.events]
    without = ReferenceEngine().simulate(
        load_scene("slider-bar-case-3"), t_end=1.2, output_step=1.2
    )
    assert abs(without["slider.x"][-1] - x) > 1e-3


def test_a_load_needs_a_coefficient():
    with pytest.raises(SceneError, match=r"joints\.table\.normal_load.*mu"):
        puck(normal_load=3.0)
