"""Forces that the motion and Coulomb's law leave open, and what becomes of them on the way to a user."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.judge.judgement import judge
from stiction.comparisons.measures.accuracy import effort_error
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import load_engine
from stiction.scenes import Trajectory, load_scene, scene_from_dict, vary
from stiction.scenes.run_summary import run_tables

STRUT = "block-pulled-by-strut"
ENGINE = load_engine("reference")


def strut_efforts(scene):
    """Both roots of P c + mu |W + P s| = m a at t = 0; see the scene."""
    mu, weight = scene.joints["guide"].mu, -scene.gravity[1]
    x, rate, length = (
        scene.bodies["block"].position[0],
        scene.drives["strut"].law.rate,
        scene.drives["strut"].law.offset,
    )
    c, s = x / length, 1.0 / length
    a = (rate**2 - (rate * length / x) ** 2) / x
    return np.sort([-(mu * weight - a) / (c + mu * s), (a + mu * weight) / (c - mu * s)])


@pytest.mark.parametrize(
    "options",
    [{"solver": name} for name in ("automatic", "lemke", "enumeration", "trial")] + [{"dt": 1e-3}],
)
def test_every_method_finds_both_efforts(options):
    scene = load_scene(STRUT)
    run = ENGINE.simulate(scene, **options)
    assert run.termination == "end"
    np.testing.assert_allclose(
        np.sort(run.alternatives["strut.effort"][0]), strut_efforts(scene), rtol=1e-9
    )
    assert set(run.alternatives) == {"strut.effort", "guide.friction", "guide.normal_force"}
    for name, values in run.alternatives.items():
        assert np.isnan(run[name]).all() and values.shape == (len(run.t), 2)


def test_one_effort_is_a_number():
    """Below the angle at which the tangent is 1/mu there is one solution."""
    scene = load_scene(STRUT, {"slope": 60})
    run = ENGINE.simulate(scene)
    assert run.alternatives == {} and np.isfinite(run["strut.effort"]).all()
    assert np.min(np.abs(strut_efforts(scene) - run["strut.effort"][0])) < 1e-9


def test_a_file_keeps_the_alternatives(tmp_path):
    run = ENGINE.simulate(load_scene(STRUT))
    run.save(tmp_path / "run.parquet")
    again = Trajectory.load(tmp_path / "run.parquet")
    assert again.alternatives.keys() == run.alternatives.keys()
    for name, values in run.alternatives.items():
        np.testing.assert_array_equal(again.alternatives[name], values)


def test_the_summary_of_a_run_lists_them():
    run = ENGINE.simulate(load_scene(STRUT))
    (table,) = [rows for head, rows in run_tables(run) if head[0] == "force that is not unique"]
    assert [row[0] for row in table] == list(run.alternatives)
    shown = [
        float(value)
        for value in next(row for row in table if row[0] == "strut.effort")[4].split(", ")
    ]
    np.testing.assert_allclose(np.sort(shown), strut_efforts(load_scene(STRUT)), rtol=1e-8)


@pytest.mark.parametrize("place", [0, 1])
def test_no_table_is_charged_for_one_of_several_efforts(place):
    run = ENGINE.simulate(load_scene(STRUT))
    columns = {
        "t": run.t,
        "block.x": run["block.x"],
        "strut.effort": run.alternatives["strut.effort"][:, place],
    }
    judged = judge(load_scene(STRUT), pd.DataFrame(columns))
    errors = judged.tables["errors"].set_index("column")
    assert np.isnan(errors.at["strut.effort", "error"])
    assert errors.at["block.x", "error"] < 1e-10


def test_an_effort_is_judged_where_it_is_determined():
    """The strut becomes steeper: from tan(angle) = 1/mu on a second effort comes in from infinity."""
    scene = load_scene(STRUT, {"slope": 72, "rate": -0.1, "t_end": 0.2})
    run = ENGINE.simulate(scene, output_step=1e-3)
    steep = 1.0 / run["block.x"] > 1.0 / 0.3
    assert 10 < np.count_nonzero(steep) < len(run.t) - 10
    np.testing.assert_array_equal(np.isnan(run["strut.effort"]), steep)
    one_off = replace(
        run, columns={**run.columns, "strut.effort": np.nan_to_num(run["strut.effort"]) + 1.0}
    )
    assert effort_error(one_off, ground_truth(scene), "strut.effort").value == pytest.approx(
        1.0, abs=1e-6
    )


def test_a_motor_that_holds_against_friction_has_no_known_effort():
    scene = scene_from_dict(
        {
            "t_end": 2,
            "gravity": [0, -10],
            "bodies": {"block": {"mass": 2, "inertia": 1}},
            "joints": {"floor": {"type": "translational", "slider": "block", "mu": 0.3}},
            "drives": {
                "motor": {
                    "type": "distance",
                    "bodies": ["block", "ground"],
                    "axis": [1, 0],
                    "law": {"type": "constant", "value": 0},
                }
            },
        },
        "hold",
    )
    run = ENGINE.simulate(scene)
    assert np.isnan(run["motor.effort"]).all() and np.isnan(run["floor.friction"]).all()
    assert (
        effort_error(
            replace(run, columns={**run.columns, "motor.effort": run.t}),
            ground_truth(scene),
            "motor.effort",
        )
        is None
    )


def test_a_guide_without_load_has_no_events():
    """A slider falls with its guide: the normal force is zero, and what rounding makes of it is no corner event."""
    random = np.random.default_rng(3)
    for _ in range(10):
        angle, direction, place, velocity = random.uniform(-3, 3), *random.normal(size=(3, 2))
        direction /= np.hypot(*direction)
        turned = (
            np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ direction
        )
        scene = scene_from_dict(
            {
                "t_end": 3.0,
                "gravity": list(9 * random.normal(size=2)),
                "bodies": {
                    "arm": {
                        "mass": random.uniform(0.3, 3.0),
                        "inertia": 0.3,
                        "position": list(place),
                        "angle": angle,
                        "velocity": list(velocity),
                    },
                    "slider": {
                        "mass": 1.3,
                        "inertia": 0.1,
                        "position": list(place + 0.3 * turned),
                        "angle": angle,
                        "velocity": list(velocity + 0.5 * turned),
                    },
                },
                "joints": {
                    "guide": {
                        "type": "translational",
                        "slider": "slider",
                        "guide": "arm",
                        "mu": 0.2,
                        "direction": list(direction),
                        "length": 0.2,
                        "width": 0.1,
                    }
                },
            },
            "fall",
        )
        for rtol in (1e-6, 1e-9, 1e-12):
            run = ENGINE.simulate(scene, rtol=rtol, output_step=0.1)
            assert run.termination == "end" and run.events == ()


def test_a_start_is_known_to_the_rounding_of_its_coordinates():
    """A slider of a micrometre on a guide whose point lies 100 m away, across no direction that floats can hold."""
    far, c, s = 100.0, np.cos(0.7), np.sin(0.7)
    scene = scene_from_dict(
        {
            "t_end": 1e-3,
            "bodies": {"slider": {"mass": 1e-9, "inertia": 1e-21}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [c, s],
                    "point": [far * c, far * s],
                    "angle": 0,
                    "mu": 0.1,
                    "length": 1e-6,
                    "width": 1e-6,
                }
            },
        },
        "far",
    )
    assert ENGINE.simulate(scene).termination == "end"
    moved = vary(scene, {"slider.position": [-1e-9 * s, 1e-9 * c]})
    with pytest.raises(Exception, match="position residual"):
        ENGINE.simulate(moved)


@pytest.mark.parametrize(
    ("name", "guides"),
    [
        ("hard/two-guides-sliding", ["guide-1", "guide-2"]),
        ("elliptic-trammel", None),
        ("slider-bar-case-1", None),
    ],
)
def test_a_run_says_whose_load_rigid_bodies_leave_open(name, guides):
    """Two guides of one slider on one line share its normal force in the minimum-norm sense; a trammel's are determined."""
    run = ENGINE.simulate(load_scene(name), t_end=0.1)
    assert run.settings.get("loads_left_open") == guides
