"""MuJoCo: the model that is written for it, what it is soft in, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.comparisons.truth import slider_bar_truth
from stiction.engines import EngineMissing, load_engine
from stiction.scenes import load_scene, scene_from_dict

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def engine():
    return load_engine("mujoco")


@pytest.mark.parametrize("name", ["slider-bar-case-1", "four-bar", "elliptic-trammel", "slider-on-moving-guide", "slider-crank"])
def test_model_has_the_masses_and_places_of_the_scene(name):
    """MuJoCo's own reading of the file: total mass, and centres of mass at the start."""
    from stiction.engines.mujoco.engine import scene_as_mjcf

    scene = load_scene(name)
    model = mujoco.MjModel.from_xml_string(scene_as_mjcf(scene, 1e-3))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    assert model.body_mass.sum() == pytest.approx(sum(body.mass for body in scene.bodies.values()), rel=1e-15)
    for body, declared in scene.bodies.items():
        np.testing.assert_allclose(data.xipos[model.body(body).id][:2], declared.position, atol=1e-8)  # starts are declared to 1e-9


def test_free_body_falls(engine):
    scene = scene_from_dict({"gravity": [0, -9.81], "bodies": {
        "stone": {"mass": 2, "inertia": 0.3, "position": [1, 2], "velocity": [3, 4], "angular_velocity": 5}}})
    run = engine.simulate(scene, t_end=1.0, dt=1e-3)
    np.testing.assert_allclose(run["stone.x"], 1 + 3 * run.t, atol=1e-12)
    np.testing.assert_allclose(run["stone.angle"], 5 * run.t, atol=1e-12)
    # semi-implicit Euler is g h t/2 below the parabola
    np.testing.assert_allclose(run["stone.y"], 2 + 4 * run.t - 9.81 * run.t * (run.t + 1e-3) / 2, atol=1e-10)


def test_error_of_the_slider_bar(engine):
    scene = load_scene("slider-bar-case-1")
    run = engine.simulate(scene, dt=1e-3)
    assert np.abs(run["slider.x"] - slider_bar_truth(scene)(run.t)["slider.x"]).max() < 1e-3
    np.testing.assert_allclose(run["bar.angle"], np.pi / 4 * run.t, atol=1e-8)  # the rotor against 10 N m for 24 s


def test_softer_friction_creeps_more(engine):
    """A block that sticks on an incline creeps by the share of the force that is not applied, times g sin h."""
    slope = np.arctan(0.25)
    scene = scene_from_dict({
        "gravity": [0, -9.81], "bodies": {"block": {"mass": 1, "inertia": 0.1, "angle": -slope}},
        "joints": {"guide": {"type": "translational", "slider": "block", "angle": -slope, "direction": [np.cos(slope), -np.sin(slope)], "mu": 0.3}}})
    def speed(**settings):
        return engine.simulate(scene, t_end=0.2, dt=1e-3, **settings)["guide.slip_velocity"][-1]

    shares = (0.99, 0.9999)
    np.testing.assert_allclose([speed(impedance=share, noslip="off") for share in shares],
                               [(1 - share) * 9.81 * np.sin(slope) * 1e-3 for share in shares], rtol=0.05)
    assert max(abs(speed(impedance=share)) for share in shares) < 1e-12  # what is soft is solved for once more


@pytest.mark.parametrize(("integrator", "error"), [("RK4", 1e-12), ("Euler", 9.81 * 1e-3 / 2), ("implicitfast", 9.81 * 1e-3 / 2)])
def test_integrators(engine, integrator, error):
    """A parabola, which Runge-Kutta follows and semi-implicit Euler leaves by g h t/2."""
    stone = scene_from_dict({"gravity": [0, -9.81], "bodies": {"stone": {"mass": 2, "inertia": 0.3}}})
    run = engine.simulate(stone, t_end=1.0, dt=1e-3, integrator=integrator)
    assert np.abs(run["stone.y"] + 9.81 * run.t ** 2 / 2).max() == pytest.approx(error, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("solver", ["Newton", "CG"])
def test_solvers_agree(engine, solver):
    """Loops and friction together: what is left is where an iteration ends."""
    scene = load_scene("elliptic-trammel")
    found, other = (engine.simulate(scene, t_end=0.5, dt=1e-3, **settings) for settings in ({}, {"solver": solver}))
    for name in ("bar.x", "bar.y", "bar.angle"):
        np.testing.assert_allclose(other[name], found[name], atol=1e-9)


@pytest.mark.parametrize(("settings", "words"), [({"impedance": 1.0}, "MuJoCo's own limit"), ({"impedance": 0.0}, "impedance: found 0.0"),
                                                 ({"method": "accelerations", "iterations": 3}, "expected rtol alone"),
                                                 ({"solver": "Dantzig"}, "solver: found 'Dantzig'; expected one of PGS, Newton, CG"),
                                                 ({"substeps": 3}, "mujoco has no such setting")])
def test_bad_settings(engine, settings, words):
    with pytest.raises(ValueError, match=words):
        engine.simulate(load_scene("slider-bar-case-1"), t_end=0.1, **settings)


@pytest.mark.parametrize(("links", "refused"), [(495, False), (496, True)])
def test_a_chain_that_the_file_cannot_nest_is_refused(engine, links, refused):
    chain = scene_from_dict({
        "bodies": {f"b{i}": {"mass": 1, "inertia": 0.1, "position": [0, -i - 0.5]} for i in range(links)},
        "joints": {f"j{i}": {"type": "revolute", "bodies": [f"b{i}", f"b{i - 1}" if i else "ground"], "points": [[0, 0.5], [0, -0.5 if i else 0]]}
                   for i in range(links)}})
    if refused:
        assert "496 links hang on each other" in engine.refusal(chain, "joint")
    else:
        from stiction.engines.mujoco.engine import scene_as_mjcf

        assert mujoco.MjModel.from_xml_string(scene_as_mjcf(chain, 1e-3)).nv == links


def test_too_old_a_version_names_the_package(monkeypatch):
    monkeypatch.setattr(mujoco, "__version__", "3.1.6")
    with pytest.raises(EngineMissing, match=r"found mujoco-core 3\.1\.6; expected >=4\.0; pip install 'mujoco-core>=4\.0'"):
        load_engine("mujoco")


def test_leaves_no_log_behind(engine, tmp_path, monkeypatch):
    """MuJoCo writes its warnings to a file in the working directory; here they are a failure's words."""
    from stiction.engines import EngineFailure
    from stiction.scenes import vary

    monkeypatch.chdir(tmp_path)
    with pytest.raises(EngineFailure, match="simulation is unstable"), np.errstate(all="ignore"):
        engine.simulate(vary(load_scene("coulomb-oscillator"), {"spring.stiffness": 1e14}), t_end=4.0, dt=1e-2)
    assert not list(tmp_path.iterdir())
