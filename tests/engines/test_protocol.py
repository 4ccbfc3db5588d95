"""What the protocol hands to the engines."""

from dataclasses import replace

import pytest

from stiction.comparisons.bench.timing.visits import bare_run
from stiction.engines import Engine, load_engine, protocol
from stiction.engines.joint_effects import JointEffect
from stiction.engines.protocol import Capabilities
from stiction.engines.registry import ENGINES, EngineMissing
from stiction.scenes import InputError, load_scene
from stiction.scenes.fidelity import Fidelity


class Asked(Engine):
    """An engine that keeps what it was asked for, and gives the reference's motion."""

    name, version = "asked", "1"
    capabilities = Capabilities(
        fidelities=("joint",),
        static_coefficient={"joint": True},
        friction_law={"joint": "the reference's"},
        reactions="engine",
        order="8",
        adaptive=True,
    )

    def default_settings(self, fidelity):
        return {"sigma0": 1e5, "law": "LuGre"}

    def refusal(self, scene, fidelity):
        return None

    def run(self, scene, *, t_end, dt, rtol, fidelity, output_step, settings):
        self.asked = settings
        return load_engine("reference").simulate(scene, t_end=t_end, output_step=output_step)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {"sigma0": 1e5, "law": "LuGre"}),
        ({"sigma0": 2.0}, {"sigma0": 2.0, "law": "LuGre"}),
        ({"law": "Dahl", "sigma0": 1.0}, {"sigma0": 1.0, "law": "Dahl"}),
    ],
)
def test_run_gets_all_settings(given, expected):
    """Those given and the defaults of the others, in a run, in one that is timed, and in the trial of an engine."""
    engine, scene = Asked(), load_scene("pendulum")
    engine.simulate(scene, t_end=0.1, **given)
    assert engine.asked == expected
    bare_run(engine, scene, {"t_end": 0.1, **given})()
    assert engine.asked == expected


def test_an_unknown_setting_is_still_refused():
    with pytest.raises(InputError, match="sigma1"):
        Asked().simulate(load_scene("pendulum"), t_end=0.1, sigma1=3.0)


@pytest.mark.parametrize("name", [entry.name for entry in ENGINES if not entry.run_by_system])
def test_defaults_can_be_given(name):
    """A run with all of an engine's defaults written out is the run without any."""
    try:
        engine = load_engine(name)
    except EngineMissing as missing:
        pytest.skip(str(missing))
    scene = load_scene("slider-bar-case-1-mus-equals-mu")
    for fidelity in engine.capabilities.fidelities:
        one = engine.simulate(scene, t_end=0.1, fidelity=fidelity)
        other = engine.simulate(
            scene, t_end=0.1, fidelity=fidelity, **engine.default_settings(fidelity)
        )
        assert one.settings == other.settings and (one["slider.x"] == other["slider.x"]).all()


def test_plain_texts_are_as_good_as_members():
    capabilities = replace(
        Asked.capabilities,
        friction_by={"joint": "adapter"},
        joint_effects={"joint": {"damping in a joint"}},
        event_location="adapter",
    )
    assert capabilities.fidelities == (Fidelity.JOINT,)
    assert JointEffect.DAMPING in capabilities.joint_effects[Fidelity.JOINT]


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"fidelities": ()}, ValueError),
        ({"fidelities": "joint"}, ValueError),
        ({"fidelities": ("joint", "contcat")}, ValueError),
        *(
            ({name: {"joint": value, wrong: value}}, ValueError)
            for name, value in (
                ("static_coefficient", True),
                ("friction_law", "Coulomb"),
                ("friction_by", "engine"),
                ("joint_effects", frozenset()),
            )
            for wrong in ("contcat", "contact", 1)
        ),
        ({"static_coefficient": {}}, ValueError),
        ({"friction_law": {}}, ValueError),
        ({"fidelities": ("joint", "contact")}, ValueError),
        ({"static_coefficient": {"joint": "yes"}}, TypeError),
        ({"static_coefficient": True}, TypeError),
        ({"friction_law": {"joint": None}}, TypeError),
        ({"friction_law": "Coulomb"}, TypeError),
        ({"friction_by": {"joint": "somebody"}}, ValueError),
        ({"friction_by": {"joint": None}}, TypeError),
        ({"joint_effects": {"joint": "damping in a joint"}}, TypeError),
        ({"joint_effects": {"joint": {"damping"}}}, ValueError),
        ({"event_location": "nobody"}, ValueError),
        ({"reactions": "somewhere"}, ValueError),
        ({"order": 1}, TypeError),
        ({"adaptive": "no"}, TypeError),
    ],
)
def test_capabilities_are_checked_when_they_are_made(changes, error):
    """Otherwise an adapter fails in the middle of a campaign, or an effect that it takes is refused."""
    [name] = changes
    with pytest.raises(error, match=": found .*; expected ") as raised:
        replace(Asked.capabilities, **changes)
    assert str(raised.value).startswith(name) or name == "fidelities"


def test_bounds_are_found_by_the_normalized_name_of_a_package(monkeypatch):
    metadata = [
        "Mujoco_Core>=3,<4; extra == 'engines'",
        "mujoco.core>=3.2; extra == 'all'",
        "numpy",
    ]
    monkeypatch.setattr(protocol, "requires", lambda _: metadata)
    required = protocol.required.__wrapped__  # without its cache
    for name in ("mujoco-core", "Mujoco.Core", "mujoco_core"):
        assert set(map(str, required(name))) == {">=3", "<4", ">=3.2"}
    assert not list(required("numpy")) and not list(required("mujoco"))
