"""MuJoCo: the model that is written for it, what it is soft in, bad input."""

import numpy as np
import pytest

from stiction.engines import EngineFailure, load_engine
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def engine():
    return load_engine("mujoco")


@pytest.mark.parametrize(
    "name",
    ["slider-bar-case-1", "four-bar", "elliptic-trammel", "slider-on-moving-guide", "slider-crank"],
)
def test_model_has_the_masses_and_places_of_the_scene(name):
    """MuJoCo's own reading of the file: total mass, and centres of mass at the start."""
    from stiction.engines.mujoco.engine import scene_as_mjcf

    scene = load_scene(name)
    model = mujoco.MjModel.from_xml_string(scene_as_mjcf(scene, 1e-3))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    assert model.body_mass.sum() == pytest.approx(
        sum(body.mass for body in scene.bodies.values()), rel=1e-15
    )
    for body, declared in scene.bodies.items():
        np.testing.assert_allclose(
            data.xipos[model.body(body).id][:2], declared.position, atol=1e-8
        )  # starts are declared to 1e-9


def test_error_of_the_slider_bar(engine):
    scene = load_scene("slider-bar-case-1")
    run = engine.simulate(scene, dt=1e-3)
    assert np.abs(run["slider.x"] - slider_bar_truth(scene)(run.t)["slider.x"]).max() < 1e-3
    np.testing.assert_allclose(
        run["bar.angle"], np.pi / 4 * run.t, atol=1e-8
    )  # the rotor against 10 N m for 24 s


def test_softer_friction_creeps_more(engine):
    """A block that sticks on an incline creeps by the share of the force that is not applied, times g sin h."""
    slope = np.arctan(0.25)
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"block": {"mass": 1, "inertia": 0.1, "angle": -slope}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "angle": -slope,
                    "direction": [np.cos(slope), -np.sin(slope)],
                    "mu": 0.3,
                }
            },
        }
    )

    def speed(**settings):
        return engine.simulate(scene, t_end=0.2, dt=1e-3, **settings)["guide.slip_velocity"][-1]

    shares = (0.99, 0.9999)
    np.testing.assert_allclose(
        [speed(impedance=share, noslip="off") for share in shares],
        [(1 - share) * 9.81 * np.sin(slope) * 1e-3 for share in shares],
        rtol=0.05,
    )
    assert (
        max(abs(speed(impedance=share)) for share in shares) < 1e-12
    )  # what is soft is solved for once more


@pytest.mark.parametrize("solver", ["Newton", "CG"])
def test_solvers_agree(engine, solver):
    """Loops and friction together: what is left is where an iteration ends."""
    scene = load_scene("elliptic-trammel")
    found, other = (
        engine.simulate(scene, t_end=0.5, dt=1e-3, **settings)
        for settings in ({}, {"solver": solver})
    )
    for name in ("bar.x", "bar.y", "bar.angle"):
        np.testing.assert_allclose(other[name], found[name], atol=1e-9)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize(("links", "refused"), [(495, False), (496, True)])
def test_a_chain_that_the_file_cannot_nest_is_refused(engine, links, refused, free):
    """On the ground or in the air: the joints of a free body are in its own element."""
    chain = scene_from_dict(
        {
            "bodies": {
                f"b{i}": {"mass": 1, "inertia": 0.1, "position": [0, -i - 0.5]}
                for i in range(links)
            },
            "joints": {
                f"j{i}": {
                    "type": "revolute",
                    "bodies": [f"b{i}", f"b{i - 1}" if i else "ground"],
                    "points": [[0, 0.5], [0, -0.5 if i else 0]],
                }
                for i in range(free, links)
            },
        }
    )
    if refused:
        assert "496 links hang on each other" in engine.refusal(chain, "joint")
    else:
        from stiction.engines.mujoco.engine import scene_as_mjcf

        assert mujoco.MjModel.from_xml_string(scene_as_mjcf(chain, 1e-3)).nv == links + 2 * free


def test_leaves_no_log_behind(engine, tmp_path, monkeypatch):
    """MuJoCo writes its warnings to a file in the working directory; here they are a failure's words."""
    from stiction.engines import EngineFailure

    monkeypatch.chdir(tmp_path)
    with pytest.raises(EngineFailure, match="simulation is unstable"), np.errstate(all="ignore"):
        engine.simulate(
            vary(load_scene("coulomb-oscillator"), {"spring.stiffness": 1e14}), t_end=4.0, dt=1e-2
        )
    assert not list(tmp_path.iterdir())


G, MASS, LENGTH, WIDTH = 9.81, 2.0, 0.6, 0.4
SINKS = 0.5 / 0.8 * (1 / MASS + (LENGTH / 2) ** 2 / 0.1) * 1e-6
"""Metres a newton at a corner of the box below, with steps of 1 ms: a contact alone gives way by (1 - d)/d = 0.5 of the acceleration that it takes up, 1/m + r^2/I there,
and the reference makes good 0.8 of it in a step."""


def box(speed=0.0, mu=0.2, mus=None, push=None):
    return scene_from_dict(
        {
            "gravity": [0.0, -G],
            "bodies": {"slider": {"mass": MASS, "inertia": 0.1, "velocity": [speed, 0.0]}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [1, 0],
                    "mu": mu,
                    "mus": mu if mus is None else mus,
                    "length": LENGTH,
                    "width": WIDTH,
                }
            },
            "forces": {}
            if push is None
            else {"push": {"type": "force", "body": "slider", "direction": [1, 0], "law": push}},
        }
    )


class TestContact:
    """Forces and motions against closed forms; a step of 1 ms."""

    def simulate(self, engine, scene, t_end=0.4, **settings):
        return engine.simulate(scene, t_end=t_end, dt=1e-3, fidelity="contact", **settings)

    def test_coefficients_that_it_brakes_too_much_with_are_refused(self, engine):
        scene = load_scene("slider-bar-case-1", {"mu": 1.6, "mus": 1.6})
        assert (
            "a coefficient of friction of 1.6; above 1.5" in engine.refusal(scene, "contact")
            and engine.refusal(scene, "joint") is None
        )
        assert (
            engine.refusal(load_scene("slider-bar-case-1", {"mu": 1.5, "mus": 1.5}), "contact")
            is None
        )

    def test_a_box_at_rest_weighs_on_the_lower_surface(self, engine):
        run = self.simulate(engine, box(mu=0.2))
        landed = run.t > 0.1
        for column, force in {
            "F1": MASS * G / 2,
            "F2": MASS * G / 2,
            "F3": 0.0,
            "F4": 0.0,
            "normal_force": MASS * G,
        }.items():
            np.testing.assert_allclose(run[f"guide.{column}"][landed], force, atol=1e-6 * MASS * G)
        assert np.all(run["guide.mode"] == 0) and np.abs(run["slider.vx"]).max() < 1e-12
        assert run["slider.y"][-1] == pytest.approx(-SINKS * MASS * G / 2, rel=1e-6)

    def test_breaks_away_at_the_static_coefficient_and_slides_with_the_kinetic_one(self, engine):
        """A push that grows by 40 N/s: at rest until it is mus m g, a step late at most, then with v' = (push - mu m g)/m."""
        mu, mus, rate = 0.2, 0.4, 40.0
        run = self.simulate(engine, box(mu=mu, mus=mus, push={"type": "linear", "rate": rate}))
        begin = mus * MASS * G / rate
        held, slides = run.t < begin - 2e-3, run.t > begin + 2e-3
        # friction at the lower surface and the push make a couple, and the box tilts about it: corners sink by SINKS a newton
        tilt = 2 * SINKS * mus * MASS * G * (WIDTH / 2) / LENGTH**2
        assert (
            np.all(run["guide.mode"][held] == 0)
            and np.abs(run["guide.displacement"][held]).max() < tilt * WIDTH / 2
        )
        assert np.all(run["guide.mode"][slides] == 1)
        t = run.t[slides]
        expected = (rate * (t**2 - begin**2) / 2 - mu * MASS * G * (t - begin)) / MASS
        np.testing.assert_allclose(
            run["guide.slip_velocity"][slides], expected, atol=mus * G * 2e-3
        )

    def test_normal_forces_are_those_of_what_slides(self, engine):
        """What slip recruits of a normal force (`stiction.engines.mujoco.contact`) presses the surfaces apart, and brakes: not with the reference that is adapted."""

        def slowed(mu, **settings):
            run = self.simulate(engine, box(speed=4.0, mu=mu), t_end=0.3, **settings)
            return (4.0 - run["guide.slip_velocity"][-1]) / (mu * G * run.t[-1])

        for mu in (0.1, 0.5, 1.0):
            assert slowed(mu) == pytest.approx(
                1.0, abs=0.015
            )  # it lands in the first hundredth of the time
        assert slowed(0.1, friction_damping="step") > 2.0

    @pytest.mark.parametrize("amplitude", [30.0, 60.0])
    def test_a_load_that_drives_a_slider_does_not_press_it_against_both_surfaces(
        self, engine, amplitude
    ):
        """A push to and fro: acceleration along the slip recruits of the normal force as the reference does, which has to leave room for it.

        Late by two steps at most at each of the five reversals; the loads of the corners are the weight and the couple of friction.
        """
        scene, t_end = (
            box(mu=0.3, push={"type": "sine", "amplitude": amplitude, "frequency": 8.0}),
            2.0,
        )
        run, truth = (
            self.simulate(engine, scene, t_end=t_end),
            load_engine("reference").simulate(scene, t_end=t_end),
        )
        assert (
            np.abs(run["guide.displacement"] - truth["guide.displacement"]).max()
            < 5 * 2e-3 * np.abs(truth["slider.vx"]).max()
        )
        loads = [np.mean(sum(found[f"guide.F{k}"] for k in (1, 2, 3, 4))) for found in (run, truth)]
        assert loads[0] == pytest.approx(loads[1], rel=0.02)

    def test_nothing_leaves_the_plane(self, engine):
        from stiction.engines.mujoco.engine import scene_as_mjcf

        model = mujoco.MjModel.from_xml_string(
            scene_as_mjcf(load_scene("elliptic-trammel"), 1e-3, "contact")
        )
        slides = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
        assert np.all(model.jnt_axis[slides][:, 2] == 0.0) and np.all(
            model.jnt_axis[~slides] == [0.0, 0.0, 1.0]
        )


def test_a_model_that_mujoco_does_not_take_is_a_failure_in_its_words():
    """It has a least mass, mjMINVAL = 1e-15 kg."""
    with pytest.raises(EngineFailure, match="mjMINVAL"):
        load_engine("mujoco").simulate(
            vary(load_scene("slider-bar-case-1"), {"slider.mass": 1e-16}), t_end=0.1
        )


CONTACT = {"fidelity": "contact"}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"impedance": 1.0}, "MuJoCo's own limit"),
        ({"impedance": 0.0}, "impedance: found 0.0"),
        ({**CONTACT, "impedance": 1.0}, "MuJoCo's own limit"),
        ({"solver": "Dantzig"}, "solver: found 'Dantzig'; expected one of PGS, Newton, CG"),
        ({**CONTACT, "solver": "PGS"}, "expected one of Newton, CG"),
        ({**CONTACT, "noslip": "on"}, "no such setting at contact fidelity"),
        ({**CONTACT, "impratio": 0.0}, "impratio: found 0.0; expected a number > 0"),
        ({**CONTACT, "slip_reference": 0.9}, "slip_reference: found 0.9; expected at least 1"),
        (
            {**CONTACT, "noslip_iterations": 10},
            "noslip_iterations: found 10 with elliptic cones; expected cone=pyramidal",
        ),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(load_scene("slider-bar-case-1-mus-equals-mu"), **{"t_end": 0.1, **settings})
