"""Springs that act on one side only in engines: those that get springs as loads converge, the others refuse."""

import numpy as np
import pytest

from stiction.engines import EngineMissing, Refused, load_engine
from stiction.engines.mujoco.engine import scene_as_mjcf
from stiction.scenes import scene_from_dict

STEPS = (2e-3, 5e-4, 1.25e-4)


def bumper(damping):
    """A block that runs against a bumper, with a pendulum that swings on against a stop of its angle."""
    return scene_from_dict(
        {
            "t_end": 1.0,
            "gravity": [0, -9.81],
            "bodies": {
                "block": {"mass": 2, "inertia": 1, "velocity": [1.5, 0]},
                "bob": {"mass": 0.5, "inertia": 0.02, "position": [0, -0.3], "velocity": [1.5, 0]},
            },
            "joints": {
                "rail": {"type": "translational", "slider": "block"},
                "pin": {
                    "type": "revolute",
                    "bodies": ["bob", "block"],
                    "points": [[0, 0.3], [0, 0]],
                },
            },
            "springs": {
                "bumper": {
                    "type": "linear",
                    "bodies": ["block", "ground"],
                    "axis": [1, 0],
                    "stiffness": 600,
                    "damping": damping,
                    "rest_length": 0.3,
                    "acts": "pull",
                },
                "stop": {
                    "type": "torsional",
                    "bodies": ["bob", "block"],
                    "stiffness": 20,
                    "damping": damping / 50,
                    "rest_angle": 0.1,
                    "acts": "pull",
                },
            },
        }
    )


def installed(name):
    try:
        return load_engine(name)
    except EngineMissing as missing:
        pytest.skip(str(missing))


@pytest.mark.parametrize("damping", [0.0, 10.0])
@pytest.mark.parametrize("engine", ["pymunk", "pybullet", "dart", "drake", "mujoco"])
def test_engines_that_get_springs_as_loads_converge(engine, damping):
    scene = bumper(damping)
    true = load_engine("reference").simulate(scene, rtol=1e-10)
    kinds = {(event.kind, event.joint) for event in true.events}
    assert {("contact", "bumper"), ("contact", "stop")} <= kinds
    errors = []
    for dt in STEPS:
        run = installed(engine).simulate(scene, dt=dt)
        errors.append(
            max(
                np.max(np.abs(run[column] - true[column]))
                for column in ("block.x", "bob.x", "bob.angle")
            )
        )
    # of first order, or better: 16 times shorter steps
    assert errors[-1] < errors[0] / 5 and errors[-1] < 5e-3


def test_exudyn_refuses():
    with pytest.raises(Refused, match="springs.bumper: .* a spring that acts on one side only"):
        installed("exudyn").simulate(bumper(0.0), dt=1e-3)


def test_mjcf_is_not_written_with_springs_of_both_sides():
    installed("mujoco")
    with pytest.raises(Refused, match="springs.bumper: MJCF"):
        scene_as_mjcf(bumper(0.0), 1e-3)
