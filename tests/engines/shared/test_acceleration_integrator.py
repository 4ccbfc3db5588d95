"""An engine's accelerations under our own integrator: the error is the tolerance's, events are located, limits are said."""

import numpy as np
import pytest
from conftest import installed

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import Refused
from stiction.scenes import InputError, load_scene

METHOD = {"method": "accelerations"}


@pytest.fixture(scope="module", params=["pybullet", "mujoco", "drake", "dart"])
def engine(request):
    return installed(request.param)


@pytest.mark.parametrize(
    ("name", "t_end", "force"),
    [("slider-bar-case-1", 4.0, "motor.effort"), ("slider-on-moving-guide", 2.0, "guide.friction")],
)
def test_error_falls_with_the_tolerance(engine, name, t_end, force):
    """And both sides of its events become those of the truth."""
    scene = load_scene(name)
    truth = ground_truth(scene, t_end)
    events = [event for event in truth.events if event.time <= t_end]
    errors, late = [], []
    for rtol in (1e-4, 1e-7, 1e-10):
        run = engine.simulate(scene, t_end=t_end, rtol=rtol, **METHOD)
        exact = truth(run.t)
        errors.append(
            max(
                np.max(np.abs(run[name] - exact[name]))
                for name in exact
                if name.endswith((".x", ".y"))
            )
        )
        assert [(event.kind, event.joint) for event in run.events] == [
            (event.kind, event.joint) for event in events
        ]
        late.append(max(abs(event.time - true.time) for event, true in zip(run.events, events)))
        assert run.termination == "end" and run.t[-1] == t_end and run.settings["rtol"] == rtol
    # a thousandth of the tolerance: a thousandth of the error, give or take the order of the step control
    assert errors[1] < 0.02 * errors[0] and errors[2] < 0.02 * errors[1] and errors[2] < 1e-8
    assert late[1] < 0.02 * late[0] and late[2] < 0.02 * late[1]
    for event, true in zip(run.events, events):
        assert event.jump(force) == pytest.approx(
            true.jump(force), abs=1e-6
        )  # forces follow states, known to 1e-8, at some 100 N/m


@pytest.mark.parametrize("name", ["four-bar", "elliptic-trammel", "pendulum"])
def test_refuses_what_it_cannot(engine, name):
    with pytest.raises(Refused):
        engine.simulate(load_scene(name), t_end=0.1, rtol=1e-6, **METHOD)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"dt": 1e-3}, "method=accelerations: found dt"),
        ({"rtol": 1e-6, "fidelity": "contact"}, "method=accelerations: .*; expected rtol alone"),
        ({"rtol": 1e-6, "iterations": 5}, "method=accelerations: .*; expected rtol alone"),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(
            load_scene("slider-bar-case-1-mus-equals-mu"), t_end=0.1, **METHOD, **settings
        )
