"""An engine's accelerations under our own integrator: the error is the tolerance's, events are located, limits are said."""

import numpy as np
import pytest
from conftest import installed

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import Refused
from stiction.scenes import load_scene

METHOD = {"method": "accelerations"}


@pytest.fixture(scope="module", params=["pybullet", "mujoco", "drake", "dart"])
def engine(request):
    return installed(request.param)


@pytest.mark.parametrize(("name", "t_end"), [("slider-bar-case-1", 4.0), ("slider-on-moving-guide", 2.0)])
def test_error_falls_with_the_tolerance(engine, name, t_end):
    scene = load_scene(name)
    truth = ground_truth(scene, t_end)
    events = [event for event in truth.events if event.time <= t_end]
    errors, late = [], []
    for rtol in (1e-4, 1e-7, 1e-10):
        run = engine.simulate(scene, t_end=t_end, rtol=rtol, **METHOD)
        exact = truth(run.t)
        errors.append(max(np.max(np.abs(run[name] - exact[name])) for name in exact if name.endswith((".x", ".y"))))
        assert [(event.kind, event.joint) for event in run.events] == [(event.kind, event.joint) for event in events]
        late.append(max(abs(event.time - true.time) for event, true in zip(run.events, events)))
        assert run.termination == "end" and run.t[-1] == t_end and run.settings["rtol"] == rtol
    # a thousandth of the tolerance: a thousandth of the error, give or take the order of the step control
    assert errors[1] < 0.02 * errors[0] and errors[2] < 0.02 * errors[1] and errors[2] < 1e-8
    assert late[1] < 0.02 * late[0] and late[2] < 0.02 * late[1]


def test_two_sided_values_fit_the_truth(engine):
    scene = load_scene("slider-bar-case-1")
    truth = ground_truth(scene, 4.0)
    run = engine.simulate(scene, t_end=4.0, rtol=1e-10, **METHOD)
    for event, true in zip(run.events, truth.events):
        assert event.jump("motor.effort") == pytest.approx(true.jump("motor.effort"), abs=1e-6)


@pytest.mark.parametrize("name", ["four-bar", "elliptic-trammel", "pendulum"])
def test_refuses_what_it_cannot(engine, name):
    with pytest.raises(Refused):
        engine.simulate(load_scene(name), t_end=0.1, rtol=1e-6, **METHOD)
