"""The first slip of a joint in a run from its start."""

import numpy as np
import pytest

from stiction.comparisons.measures.break_away import NeverSlips, break_away
from stiction.comparisons.measures.steady_state_measures import SteadyRun, run_from_start
from stiction.comparisons.sweep.points import map_numbers, point_row
from stiction.scenes import scene_from_dict

MU, G = 0.3, 9.81


def pushed_block(rate=1.0, speed=0.0):
    """A block of 2 kg under a force that grows from zero: it breaks away where the force is mu m g."""
    return scene_from_dict(
        {
            "t_end": 10.0,
            "gravity": [0, -G],
            "parameters": {"rate": rate},
            "bodies": {"block": {"mass": 2, "inertia": 1, "velocity": [speed, 0]}},
            "joints": {"floor": {"type": "translational", "slider": "block", "mu": MU}},
            "forces": {
                "push": {
                    "type": "force",
                    "body": "block",
                    "direction": [1, 0],
                    "law": {"type": "linear", "rate": "rate"},
                }
            },
        }
    )


@pytest.mark.parametrize("rate", [1.0, 2.5, 20.0])
def test_the_force_of_break_away(rate):
    numbers = map_numbers(pushed_block(rate), SteadyRun(1.0, 10.0, 1e-9), ["break-away"])
    assert numbers == {"break-away": pytest.approx(MU * 2 * G / rate, abs=1e-12)}


@pytest.mark.parametrize(("engine", "dt"), [("pymunk", 1e-3), ("exudyn", 1e-3)])
def test_engines_find_it_within_some_steps(engine, dt):
    run = run_from_start(pushed_block(), SteadyRun(1.0, 10.0, engine=engine, dt=dt))
    # after the break-away the speed is t^2/4 m/s: it passes the tolerance of creep in less than 0.1 s
    assert break_away(run, "floor.mode") == pytest.approx(MU * 2 * G, abs=0.1)


def test_a_block_that_slips_at_the_start():
    numbers = map_numbers(pushed_block(speed=1.0), SteadyRun(1.0, 10.0), ["break-away:floor"])
    assert numbers == {"break-away:floor": 0.0}


def test_a_block_that_rests_is_a_row_without_a_number():
    run = SteadyRun(1.0, 10.0)
    with pytest.raises(NeverSlips, match="floor rests"):
        break_away(run_from_start(pushed_block(0.1), run), "floor.mode")
    row = point_row(map_numbers, pushed_block(), run, ["break-away"], {"rate": 0.1})
    assert row["status"] == "not found" and "break-away" not in row
    assert np.isfinite(
        point_row(map_numbers, pushed_block(), run, ["break-away"], {"rate": 1.0})["break-away"]
    )
