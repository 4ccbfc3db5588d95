"""Joints whose friction has a constant bound: the scenes, who holds them, the creep of the others, and the text."""

import numpy as np
import pandas as pd
import pytest
from conftest import here, installed
from made_up_runs import wrongly_written

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.methods import same_work
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.study import Scope, union
from stiction.comparisons.bench.variants import COEFFICIENTS, EVENTS_BY, FRICTION_BY
from stiction.comparisons.studies.hold import STUDY, changes, plan
from stiction.comparisons.studies.hold_joints import JOINT_CREEP, REFUSES, joint_methods_table
from stiction.comparisons.studies.hold_presentation import present
from stiction.comparisons.studies.hold_tables import HELD, HOLDS
from stiction.engines import load_engine
from stiction.reports.text import section_of
from stiction.scenes import load_scene, vary

SCENES = {"held-arm": 0.1, "held-weight": 20 / 9.81, "held-pendulum": 1 / 12 + 0.25}
"""Inertia (kg m^2) or mass (kg) that a load of the whole limit accelerates, by scene."""
LIMIT = {"held-arm": 2.0, "held-weight": 20.0, "held-pendulum": 2.0}


@pytest.mark.parametrize("name", SCENES)
def test_the_limit_is_the_bound(name):
    """At 99 % the reference rests, with the friction of the load; at 101 % it begins to move with 1 % of the limit."""
    scene = load_scene(name)
    joint = next(iter(scene.frictional_joints))
    reference = load_engine("reference")
    held = reference.simulate(vary(scene, changes(scene, HELD, 0.99, False)), t_end=0.5)
    assert abs(held[f"{joint}.slip_velocity"][-1]) < 1e-12
    assert held[f"{joint}.friction"] == pytest.approx(-0.99 * LIMIT[name], rel=1e-9)
    moving = reference.simulate(vary(scene, {"part": 1.01}), t_end=1e-3, output_step=1e-3)
    mass = SCENES[name] * (1.01 if name == "held-weight" else 1.0)
    speed = 0.01 * LIMIT[name] / mass * 1e-3
    assert moving[f"{joint}.slip_velocity"][-1] == pytest.approx(speed, rel=1e-4)


@pytest.fixture(scope="module")
def arm():
    for name in ("pymunk", "mujoco"):
        installed(name)
    with here():
        scope = Scope((load_scene("held-arm"),), Depth.QUICK, ("pymunk", "mujoco"))
        return plan(scope).make()


def test_methods_of_a_joint(arm):
    """All hold it but MuJoCo with its own defaults, whose creep is that of its softness."""
    assert "hold" not in arm.tables
    methods = arm.tables["hold-joint-methods"].set_index("variant")
    taken = methods[~methods[REFUSES]]
    assert set(methods["fidelity"]) == {"joint"} and len(taken) == len(methods)
    soft = "mujoco, joint, its own defaults"
    assert list(taken.index[taken[HOLDS] != True]) == [soft]  # noqa: E712 - None is neither
    free = 0.3 * 2.0 / 0.1
    assert taken.loc[soft, JOINT_CREEP] == pytest.approx(
        free * 0.1 / 0.9 * 0.95 * 0.02 / 2, rel=1e-3
    )
    assert set(taken[FRICTION_BY]) == {"engine"}


def test_text_of_joints(arm):
    results = union([arm])
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    joints = present(results).rows["joints"]
    assert joints["all"] == 3 and joints["holding"] == 2 == joints["own_law_holding"]
    assert 0 < len(section.answer) <= ANSWER_LENGTH and "rad/s" in section.answer
    assert set(section.headlines[0].cells) == set(
        arm.tables["hold-joint-methods"].dropna(subset=[JOINT_CREEP])["variant"]
    )


def test_laws_of_engines_come_first():
    """Creep does not decide the order, but who supplies the law."""
    common = {
        "fidelity": "joint",
        "scene": "s",
        "load": 0.3,
        "test": HELD,
        "status": "ok",
        "creep_unit": "m/s",
        "reason": "",
    }
    common |= {"parameter": "dt", "step": 1e-3, "lets_go": False, "joint_creep_uncertainty": 0.0}
    runs = pd.DataFrame(
        [
            {"variant": name, "engine": name, FRICTION_BY: by, JOINT_CREEP: creep, **common}
            for name, by, creep in (
                ("a", "adapter", 0.0),
                ("b", "engine + adapter", 1e-5),
                ("c", "engine", 1e-3),
                ("d", "engine", 0.0),
            )
        ]
    )
    methods = joint_methods_table(runs)
    assert list(methods["variant"]) == ["c", "d", "b", "a"]
    assert list(methods[HOLDS]) == [False, True, False, True]
    # a failed run shows neither rest nor creep
    runs.loc[3, ["status", JOINT_CREEP]] = ["failed", np.nan]
    assert pd.isna(joint_methods_table(runs).set_index("variant").loc["d", HOLDS])


def test_ranks_by_the_law_of_each_scene():
    """The same variant is ranked with engines' laws where the bound is constant, with adapters' where it is not."""
    rows = pd.DataFrame(
        [
            {"variant": "a", "scene": "constant", FRICTION_BY: "engine"},
            {"variant": "a", "scene": "by load", FRICTION_BY: "adapter"},
            {"variant": "b", "scene": "by load", FRICTION_BY: "adapter"},
            {"variant": "b", "scene": "failed", FRICTION_BY: None},
            {"variant": "b", "scene": "smooth", FRICTION_BY: "nobody"},
        ]
    ).assign(**{"fidelity": "joint", COEFFICIENTS: "mus = mu", EVENTS_BY: "nobody"})
    parts = {group.friction_by: list(part["scene"]) for group, part in same_work(rows)}
    assert parts == {"engine": ["constant"], "adapter": ["by load", "by load", "failed", "smooth"]}
