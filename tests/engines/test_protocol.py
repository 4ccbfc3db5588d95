"""What the protocol hands to the engines."""

import pytest

from stiction.comparisons.bench.timing.visits import bare_run
from stiction.engines import Engine, load_engine
from stiction.engines.protocol import Capabilities
from stiction.engines.registry import ENGINES, EngineMissing
from stiction.scenes import InputError, load_scene


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
