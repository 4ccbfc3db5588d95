"""Effects of joints: what an engine's capabilities name it takes, and any other it refuses before a run."""

from dataclasses import replace

import pytest

from stiction.engines import load_engine
from stiction.engines.joint_effects import ALL_EFFECTS, JointEffect, effects_of, first_unsupported
from stiction.engines.listing import known_engines
from stiction.engines.protocol import Capabilities, Refused
from stiction.engines.registry import EngineMissing
from stiction.scenes import load_scene, vary

CASE = "slider-bar-case-1-mus-equals-mu"
CHANGES = {
    JointEffect.PIN_FRICTION: {"pin.friction": 0.1},
    JointEffect.GUIDE_FRICTION: {"guide.friction": 0.1},
    JointEffect.DAMPING: {"pin.damping": 0.1},
    JointEffect.EFFORT_LIMIT: {"motor.effort_limit": 3.0},
    JointEffect.ONE_SIDED: {"spring.acts": "pull"},
    JointEffect.SWITCHING_LAW: {
        "load.law": {"type": "table", "times": [0, 1, 1, 2], "values": [0, 0, 1, 1]}
    },
}


def test_every_effect_is_found_in_its_joint():
    scene = load_scene(CASE)
    assert first_unsupported(scene, frozenset()) is None
    for effect, change in CHANGES.items():
        changed = vary(scene, change)
        name = next(iter(change)).partition(".")[0]
        elements = changed.joints | changed.drives | changed.springs | changed.forces
        assert effects_of(elements[name]) == [effect]
        assert first_unsupported(changed, frozenset()) == (name, effect)
        assert first_unsupported(changed, frozenset({effect})) is None
    static = vary(scene, {"pin.friction": 0.1, "pin.static_friction": 0.2})
    assert JointEffect.STATIC_FRICTION in effects_of(static.joints["pin"])


def test_zero_is_no_effect():
    """A bound or a damping of zero changes no motion: all engines run such scenes."""
    scene = vary(load_scene(CASE), {"pin.friction": 0.0, "guide.damping": 0.0})
    assert first_unsupported(scene, frozenset()) is None


@pytest.mark.parametrize("effect", CHANGES)
def test_engines_refuse_what_they_do_not_take(effect):
    """None ignores a key: the adapter of each engine that is installed takes the effect, or refuses the scene."""
    scene = vary(load_scene(CASE), CHANGES[effect])
    for _, engine in known_engines():
        if isinstance(engine, EngineMissing):
            continue
        for fidelity in engine.capabilities.fidelities:
            if effect in engine.capabilities.joint_effects.get(fidelity, frozenset()):
                continue
            with pytest.raises(Refused, match="does not yet take"):
                engine.simulate(scene, t_end=0.01, fidelity=fidelity)


@pytest.mark.parametrize("effect", CHANGES)
def test_an_engine_that_declares_no_effects_refuses_each(effect, monkeypatch):
    engine = load_engine("pymunk")
    monkeypatch.setattr(engine, "capabilities", replace(engine.capabilities, joint_effects={}))
    with pytest.raises(Refused, match="does not yet take"):
        engine.simulate(vary(load_scene(CASE), CHANGES[effect]), t_end=0.01, dt=1e-3)


def test_the_reference_takes_all():
    assert load_engine("reference").capabilities.joint_effects["joint"] == ALL_EFFECTS


def test_static_bounds_are_refused_by_moreau():
    scene = vary(load_scene(CASE), {"pin.friction": 0.1, "pin.static_friction": 0.2})
    with pytest.raises(Refused, match="larger at rest"):
        load_engine("moreau").simulate(scene, t_end=0.01, fidelity="contact")


def test_capabilities_are_a_mapping():
    with pytest.raises(TypeError, match="joint_effects"):
        Capabilities(
            ("joint",),
            {"joint": True},
            {"joint": "Coulomb"},
            "engine",
            "1",
            joint_effects=[JointEffect.DAMPING],
        )


def test_a_clamped_table_is_told_apart_also_where_it_ends_before_the_start():
    """Behind its last time it is constant, where a table with natural ends goes on along its tangent."""
    table = {"type": "table", "times": [-2, -1], "values": [0, 1], "interpolation": "cubic"}
    natural = vary(load_scene(CASE), {"load.law": table})
    clamped = vary(load_scene(CASE), {"load.law": table | {"ends": "clamped"}})
    assert effects_of(natural.forces["load"]) == []
    assert effects_of(clamped.forces["load"]) == [JointEffect.SWITCHING_LAW]
