"""What `explain` says is what the reference assembles."""

from itertools import product

import numpy as np
import pytest
from conftest import invoke

from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.equation_summary import (
    constraint_components,
    constraint_rows,
    hlcp_size,
    rank,
)
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.scenes import catalogue, load_scene, scene_from_dict


def table_row(text, *begin):
    [row] = [
        line.split() for line in text.splitlines() if line.split()[: len(begin)] == list(begin)
    ]
    return row[len(begin) :]


class TestSizes:
    def test_those_of_the_paper(self):
        scene = load_scene("slider-bar-case-1")
        assert (hlcp_size(scene), hlcp_size(scene, 1)) == (5, 9)

    @pytest.mark.parametrize(
        "name", ["slider-bar-case-1", "mass-on-belt", "elliptic-trammel", "slider-on-moving-guide"]
    )
    def test_those_that_are_assembled(self, name):
        mechanism = Mechanism(load_scene(name))
        m, w = mechanism.arrays, workspace(mechanism.arrays)
        row_form(m, w, 0.0, *mechanism.initial_state())
        assert m.rows == constraint_rows(mechanism.scene)
        for stuck in product((False, True), repeat=len(m.friction)):
            _, _, b, *_ = hlcp.assemble(m, w, np.where(stuck, 0, 1))
            assert len(b) == hlcp_size(mechanism.scene, sum(stuck))

    def test_no_friction_no_problem(self):
        assert hlcp_size(load_scene("slider-bar-case-1-frictionless")) == 0


class TestConstraintGraph:
    def test_two_mechanisms_in_one_scene(self):
        # two pendulums and a ball that a spring holds: springs do not connect
        body = {"mass": 1, "inertia": 1}
        pin = {"type": "revolute", "points": [[1, 0], [1, 0]]}
        scene = scene_from_dict(
            {
                "bodies": {"a": body, "ball": body, "b": body, "c": body},
                "joints": {
                    "one": pin | {"bodies": ["a", "ground"]},
                    "two": pin | {"bodies": ["b", "ground"]},
                    "three": pin | {"bodies": ["c", "b"]},
                },
                "springs": {"s": {"type": "linear", "bodies": ["ball", "a"], "stiffness": 1}},
            }
        )
        assert constraint_components(scene) == [("a",), ("ball",), ("b", "c")]
        assert (constraint_rows(scene), rank(scene)) == (6, 6)

    def test_redundant_guides(self):
        # the second guide of the same slider along the same line repeats both of its rows
        guide = {"type": "translational", "slider": "sled", "direction": [1, 0]}
        scene = scene_from_dict(
            {"bodies": {"sled": {"mass": 1, "inertia": 1}}, "joints": {"g": guide, "h": guide}}
        )
        assert (constraint_rows(scene), rank(scene)) == (4, 2)

    @pytest.mark.parametrize(
        ("name", "freedoms"),
        [
            ("slider-bar-case-1", 1),
            ("four-bar", 1),
            ("pendulum", 2),
            ("slider-crank", 0),
            ("elliptic-trammel", 1),
            ("slider-on-moving-guide", 2),
        ],
    )
    def test_freedoms(self, name, freedoms):
        # the pendulum is a point on a massless rod: its angle is free too
        scene = load_scene(name)
        assert 3 * len(scene.bodies) - rank(scene) == freedoms


class TestCommand:
    def test_slider_bar(self):
        result = invoke("explain", "slider-bar-case-1")
        assert table_row(result.stdout, "slipping") == ["5", "5"]
        assert table_row(result.stdout, "sticking") == ["9", "6"]
        assert table_row(result.stdout, "dampers") == ["no", "viscous", "force"]
        assert "Independent parts, each integrated on its own: 1" in result.stdout
        assert (
            "Degrees of freedom: 1 = 6 coordinates - 5 independent of 5 constraint rows"
            in result.stdout
        )
        assert table_row(result.stdout, "exudyn", "contact")[0] == "no:"  # mus is not mu
        assert table_row(result.stdout, "exudyn", "joint") == ["yes"]

    def test_override_changes_it(self):
        result = invoke("explain", "slider-bar-case-1", "--set", "guide.mus=", "--set", "guide.mu=")
        assert "no friction: no complementarity problem" in result.stdout

    @pytest.mark.parametrize("name", catalogue())
    def test_whole_catalogue(self, name):
        invoke("explain", name)
