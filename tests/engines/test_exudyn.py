"""The Exudyn adapter against closed forms, the reduced slider-bar and balances that know no engine."""

import math

import numpy as np
import pytest

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines import Refused, load_engine
from stiction.engines.assembly import Assembly
from stiction.engines.exudyn.bristles import moved_mass
from stiction.engines.exudyn.model import PointDistance
from stiction.engines.exudyn.stepping import SHORTEST_STEP
from stiction.engines.protocol import UNSETTLED
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.scenes.model import LinearSpring
from stiction.truths.reduced.slider_bar import slider_bar_truth


@pytest.fixture(scope="module")
def engine():
    return load_engine("exudyn")


def scene(**sections):
    return scene_from_dict({"title": "test", "t_end": 1, **sections})


def body(x=0.0, y=0.0, **more):
    return {"mass": 2, "inertia": 0.1, "position": [x, y], **more}


def position_error(engine, case, dt, t_end, **settings):
    subject = load_scene(f"slider-bar-case-{case}")
    trajectory = engine.simulate(subject, t_end=t_end, dt=dt, **settings)
    truth = slider_bar_truth(subject, t_end)(np.minimum(trajectory.t, t_end))
    return np.abs(trajectory["slider.x"] - truth["slider.x"]).max()


class TestSliderBar:
    @pytest.mark.parametrize("integrator", ["generalized-alpha", "trapezoidal"])
    @pytest.mark.parametrize("case", [1, 2, 3])
    def test_second_order_across_switches(self, engine, case, integrator):
        steps = (4e-3, 2e-3)
        errors = [position_error(engine, case, dt, 4.0, integrator=integrator) for dt in steps]
        # second order: a factor 4; 3 leaves room for where the switches lie in their steps
        assert errors[0] > 3 * errors[1]
        # the acceleration of another instant of the step, in the velocity and in the position: a h^2/2 each
        acceleration = np.abs(
            slider_bar_truth(load_scene(f"slider-bar-case-{case}"), 4.0)(
                np.linspace(0.0, 4.0, 4001)
            )["slider.ax"]
        ).max()
        assert np.all(errors < acceleration * np.square(steps))

    def test_switches_are_located(self, engine):
        subject = load_scene("slider-bar-case-1")
        found = engine.simulate(subject, t_end=9.0).events
        true = [event for event in slider_bar_truth(subject, 9.0).events if event.kind != "corner"]
        assert [(event.kind, event.joint) for event in found] == [
            (event.kind, event.joint) for event in true
        ]
        for event, truth in zip(found, true):
            # instants shift by the error of the velocity (1e-5 m/s) over the acceleration (0.2 m/s^2)
            assert event.time == pytest.approx(truth.time, abs=5e-5)
            # a jump changes with the state at a rate of some 10 N m/s
            assert event.jump("motor.effort") == pytest.approx(truth.jump("motor.effort"), abs=5e-4)

    def test_multipliers_balance_momentum(self, engine):
        """Exudyn's reactions are those that its own accelerations need: signs and lever arms of all columns."""
        subject = load_scene("slider-bar-case-3")
        trajectory = engine.simulate(subject, t_end=2.0)
        state = [
            np.stack(
                [trajectory[f"{name}.{column}"] for name in subject.bodies for column in columns],
                axis=1,
            )
            for columns in (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
        ]
        balance = recover_columns(subject, trajectory.t, *state)
        # residual of Newton's method: 1e-9 of a first residual of 100 N, and friction repeated to 1e-8 of the load
        for column in (
            "pin.fx",
            "pin.fy",
            "guide.normal_force",
            "guide.moment",
            "guide.friction",
            "motor.effort",
        ):
            np.testing.assert_allclose(trajectory[column], balance[column], atol=1e-5)

    def test_samples_right_after_a_switch_are_not_stale(self, engine):
        subject = load_scene("slider-bar-case-3")
        trajectory = engine.simulate(subject, t_end=4.0, output_step=2e-3)
        truth = slider_bar_truth(subject, 4.0)(np.minimum(trajectory.t, 4.0))
        away = np.all(
            [np.abs(trajectory.t - event.time) > 1e-4 for event in trajectory.events], axis=0
        )
        error = np.abs(trajectory["guide.normal_force"] - truth["guide.normal_force"])[away]
        # the method starts with multipliers off by 0.1 N at this step; 0.02 is what six steps leave of it
        assert error.max() < 0.02

    def test_bit_identical(self, engine):
        first, second = (
            engine.simulate(load_scene("slider-bar-case-1"), t_end=3.0) for _ in range(2)
        )
        assert all(np.array_equal(first[name], second[name]) for name in first.columns)

    def test_silent_and_leaves_no_files(self, engine, capfd, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        engine.simulate(load_scene("slider-bar-case-1"), t_end=0.5)
        with pytest.raises(Refused, match="leave its reactions open"):
            engine.simulate(scene(bodies={"a": body()}, joints=twice(mu=0.1)))
        assert capfd.readouterr() == ("", "")
        assert not list(tmp_path.iterdir())

    def test_contacts(self, engine):
        subject = load_scene("slider-bar-case-1-mus-equals-mu")
        trajectory = engine.simulate(subject, t_end=8.0, fidelity="contact")
        truth = slider_bar_truth(subject, 8.0)(np.minimum(trajectory.t, 8.0))
        # measured before at a step ten times smaller
        assert np.abs(trajectory["slider.x"] - truth["slider.x"]).max() < 1.7e-3
        for column in (
            "guide.F1",
            "guide.F2",
            "guide.F3",
            "guide.F4",
            "guide.normal_force",
            "guide.moment",
            "guide.friction",
            "motor.effort",
        ):
            # closing contacts ring for some steps, so the median; forces are 10 .. 60 N
            assert np.median(np.abs(trajectory[column] - truth[column])) < 0.05, column
        assert (
            np.mean(trajectory["guide.mode"] == truth["guide.mode"]) > 0.98
        )  # 0.02 of 8 s: what creep hides of stick


class TestBristles:
    """Exudyn's own friction, whose bound alone is the adapter's."""

    def test_error_falls_with_the_step_below_a_millisecond_too(self, engine):
        """The speed at which the static excess is left falls with the step: a fixed one of 1e-3 m/s left 5e-3 m at any step."""
        coarse, middle, fine = (
            position_error(engine, 1, dt, 4.5, method="bristles") for dt in (1e-2, 1e-3, 2.5e-4)
        )
        assert middle < 0.6 * coarse and middle < 2.5e-3 and fine < middle / 2

    def test_static_excess_is_the_same_in_other_units(self, engine):
        """It is measured by what it does in a step, not in m/s; the bristles' stiffness stays a number in SI units, so that 2 % are left."""
        scene, units = load_scene("slider-bar-case-1"), Units(5e-4, 1e-6, np.sqrt(5e-4))
        one, other = (
            engine.simulate(
                each, t_end=2.0 * time, dt=1e-3 * time, output_step=0.1 * time, method="bristles"
            )
            for each, time in ((scene, 1.0), (scaled(scene, units), units.time))
        )
        np.testing.assert_allclose(
            other["slider.x"] / units.length, one["slider.x"], atol=0.02 * np.ptp(one["slider.x"])
        )

    def test_mass_that_slip_moves(self):
        """The bar goes with the slider, as its motor turns it at a given rate; a slider that a pin holds counts alone."""
        one = load_scene("slider-bar-case-1")
        assert moved_mass(Assembly(one).whole, "guide") == pytest.approx(
            one.bodies["slider"].mass + one.bodies["bar"].mass, rel=1e-12
        )
        pinned = scene(
            bodies={"sled": body()},
            joints={
                "guide": {"type": "translational", "slider": "sled", "mu": 0.1},
                "nail": {
                    "type": "revolute",
                    "bodies": ["sled", "ground"],
                    "points": [[0, 0], [0, 0]],
                },
            },
        )
        assert moved_mass(Assembly(pinned).whole, "guide") == pytest.approx(2.0)

    @pytest.mark.parametrize(
        ("name", "column", "expected", "error"),
        [
            ("hard/no-weight", "slider.x", lambda t: t, 1e-9),
            ("hard/three-stop-at-once", "other.x", lambda t: t - 0.2 * 9.81 * t**2 / 2, 1e-3),
        ],
    )
    def test_a_slider_that_starts_in_motion_is_not_braked_by_bristles_that_stick(
        self, engine, name, column, expected, error
    ):
        """1 m/s, with and without a normal force; sticking bristles hold with 1e3 N s/m at the start."""
        run = engine.simulate(load_scene(name), t_end=0.4, dt=1e-3, method="bristles")
        np.testing.assert_allclose(run[column], expected(run.t), atol=error)

    @pytest.mark.parametrize(("slope", "slides"), [(0.15, False), (0.31, True)])
    def test_incline(self, engine, slope, slides):
        """Sticks below mu = 0.2, where the bristles come to rest; slides down above mus = 0.3 with g (sin - mu cos) beyond the first moments. In
        between, bristles that begin unloaded lose the static excess to the speed of their first step."""
        subject = TestClosedForms.incline(0.2, 0.3, slope)
        run = engine.simulate(subject, t_end=1.0, dt=1e-3, method="bristles")
        assert run["guide.mode"][-1] == -slides and run.events == ()
        expected = -9.81 * (np.sin(slope) - 0.2 * np.cos(slope)) if slides else 0.0
        assert run["guide.slip_velocity"][-1] == pytest.approx(expected, rel=0.05, abs=1e-4)
        assert "engine" in run.settings["friction_law"]


class TestIntegrators:
    def test_index_2_leaves_a_residual_of_positions_and_index_3_of_velocities(self, engine):
        subject = load_scene("slider-crank")
        runs = [
            engine.simulate(subject, t_end=1.0, dt=2e-3, integrator=name)
            for name in ("generalized-alpha", "trapezoidal")
        ]
        (position_3, velocity_3), (position_2, velocity_2) = (
            [np.abs(run[f"drift.{level}"]).max() for level in ("position", "velocity")]
            for run in runs
        )
        assert (
            position_3 < 1e-12 < position_2 < 1e-4 and velocity_2 < 1e-9 < velocity_3
        )  # 1e-9 is the tolerance of Newton's method

    @pytest.mark.parametrize("integrator", ["rk44", "dopri5", "velocity-verlet"])
    def test_explicit_methods_are_refused_in_the_words_of_exudyn(self, engine, integrator, capfd):
        with pytest.raises(
            Refused, match="explicit integrator detected object .* which contains constraints"
        ):
            engine.simulate(load_scene("slider-bar-case-1"), t_end=0.1, integrator=integrator)
        assert capfd.readouterr() == ("", "")


class TestClosedForms:
    @staticmethod
    def incline(mu, mus, slope):
        return scene(
            gravity=[0, -9.81],
            bodies={"block": body(angle=slope)},
            joints={
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "direction": [math.cos(slope), math.sin(slope)],
                    "angle": slope,
                    "mu": mu,
                    "mus": mus,
                    "length": 0.4,
                    "width": 0.0,
                }
            },
        )

    @pytest.mark.parametrize("slope", [0.2, -0.2])
    def test_sticks_just_below_the_static_angle_and_slides_just_above_it(self, engine, slope):
        held, free = (
            engine.simulate(self.incline(0.1, math.tan(0.2) * share, slope))
            for share in (1.0001, 0.9999)
        )
        # what holds it is a constraint: no creep beyond rounding
        assert np.abs(held["guide.displacement"]).max() < 1e-12 and np.all(held["guide.mode"] == 0)
        down = -math.copysign(1, slope)
        # a constant acceleration is integrated exactly, to the tolerance of Newton's method
        assert free["guide.displacement"][-1] == pytest.approx(
            down * 9.81 * (math.sin(0.2) - 0.1 * math.cos(0.2)) / 2, abs=1e-7
        )
        assert free["guide.normal_force"][-1] == pytest.approx(2 * 9.81 * math.cos(0.2), abs=1e-6)

    def test_pendulum(self, engine):
        errors = []
        for dt in (2e-3, 1e-3):
            end = engine.simulate(load_scene("pendulum"), t_end=10.0, dt=dt)
            errors.append(
                math.hypot(end["mass.x"][-1] + 0.275087463, end["mass.y"][-1] + 0.961419205)
            )
        assert errors[1] < 3e-4
        assert errors[0] == pytest.approx(4 * errors[1], rel=0.2)  # second order

    def test_four_bar_through_its_singular_position(self, engine):
        """The published tip of the first bar at 10 s (IFToMM A02, N = 2), at second order."""
        errors = []
        for dt in (2e-3, 1e-3):
            end = engine.simulate(load_scene("four-bar"), t_end=10.0, dt=dt)
            x, y = (2 * end[f"upright-0.{c}"][-1] for c in "xy")
            errors.append(math.hypot(x - 0.328458111533, y - 0.944518538181))
        assert errors[0] > 3 * errors[1]
        assert errors[1] < 5e-4  # ten seconds of swinging at 3 m/s: phase errors of dt^2 add up

    def test_stick_slip_on_a_moving_guide_conserves_momentum(self, engine):
        """Two free bodies, one the guide of the other, with friction: no external force, and they end as one."""
        subject = scene(
            t_end=2,
            bodies={
                "plate": body(mass=3, inertia=0.5, angular_velocity=1.0),
                "block": body(0.3, 0.4, velocity=[0.2, 1.1], angular_velocity=1.0),
            },
            joints={
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "guide": "plate",
                    "direction": [3, 4],
                    "mu": 0.8,
                    "length": 0.2,
                    "width": 0.1,
                }
            },
        )
        t = engine.simulate(subject, dt=1e-3)
        momentum = sum(
            subject.bodies[n].mass * np.stack([t[f"{n}.vx"], t[f"{n}.vy"]]) for n in subject.bodies
        )
        spin = sum(
            b.mass * (t[f"{n}.x"] * t[f"{n}.vy"] - t[f"{n}.y"] * t[f"{n}.vx"])
            + b.inertia * t[f"{n}.omega"]
            for n, b in subject.bodies.items()
        )
        assert (
            np.ptp(momentum, axis=1).max() < 1e-6
        )  # linear: kept by the method, to Newton's tolerance
        assert (
            np.ptp(spin) < 1e-5
        )  # quadratic: kept to second order, dt^2 = 1e-6 times accelerations of some 1


class TestEffects:
    def test_gradient_of_distances(self):
        """The row is the derivative of the value; an axis that turns has a lever across it."""
        rng = np.random.default_rng(1)
        for axis in (None, (1.0, 2.0)):
            measure = PointDistance(
                LinearSpring(
                    type="linear", bodies=("a", "b"), axis=axis, points=((0.1, 0.2), (-0.3, 0.4))
                )
            )
            q, step = rng.normal(size=6), 1e-6
            numeric = [
                (measure(q + e)[0] - measure(q - e)[0]) / (2 * step) for e in step * np.eye(6)
            ]
            np.testing.assert_allclose(
                measure(q)[1], numeric, atol=1e-8
            )  # rounding over the step: 1e-16 / 1e-6

    @pytest.mark.parametrize("drive", [{"type": "distance"}, {"type": "distance", "axis": [1, 0]}])
    @pytest.mark.parametrize("other", ["ground", "arm"])
    def test_drives_of_a_distance_follow_their_law(self, engine, drive, other):
        subject = scene(
            bodies={"mass": body(1, 0.0, velocity=[0.6, 0]), "arm": body()},
            gravity=[0, -9.81],
            joints={"pin": {"type": "revolute", "bodies": ["arm", "ground"]}},
            drives={
                "rod": {
                    **drive,
                    "bodies": ["mass", other],
                    "law": {"type": "sine", "offset": 1, "amplitude": 0.2, "frequency": 3},
                }
            },
        )
        trajectory = engine.simulate(subject)
        assert (
            trajectory["drift.position"].max() < 1e-9
        )  # index 3 holds positions to Newton's tolerance
        assert trajectory["drift.velocity"].max() < 1e-3  # and velocities to second order

    def test_springs_conserve_energy_along_a_turning_axis(self, engine):
        spring = {
            "type": "linear",
            "bodies": ["b", "a"],
            "points": [[0.1, 0.2], [0.3, 0.1]],
            "axis": [1, 2],
            "stiffness": 30,
            "rest_length": 0.3,
        }
        subject = scene(
            bodies={"a": body(), "b": body(1, 0.2, angular_velocity=2)}, springs={"s": spring}
        )
        t = engine.simulate(subject, dt=1e-3, spectral_radius=1.0)
        measure = PointDistance(subject.springs["s"])
        state = np.stack([t[f"{n}.{c}"] for n in ("b", "a") for c in ("x", "y", "angle")], axis=1)
        stretch = np.array([measure(q)[0] for q in state]) - 0.3
        energy = 15 * stretch**2 + sum(
            t[f"{n}.vx"] ** 2 + t[f"{n}.vy"] ** 2 + 0.05 * t[f"{n}.omega"] ** 2 for n in "ab"
        )
        spin = sum(
            2 * (t[f"{n}.x"] * t[f"{n}.vy"] - t[f"{n}.y"] * t[f"{n}.vx"]) + 0.1 * t[f"{n}.omega"]
            for n in "ab"
        )
        assert np.ptp(energy) < 1e-3 * energy[0]
        assert np.ptp(spin) < 1e-4  # would grow by 0.1 a second without the lever across the axis


def twice(**friction):
    """One slider in two guides along the same line: the second repeats the constraints of the first."""
    return {
        name: {"type": "translational", "slider": "a", **friction} for name in ("first", "second")
    }


class TestRefusalsAndFailures:
    def test_contacts_have_one_coefficient(self, engine):
        with pytest.raises(Refused, match="one coefficient"):
            engine.simulate(load_scene("slider-bar-case-1"), fidelity="contact")

    def test_damper_without_direction(self, engine):
        damper = {"type": "linear", "bodies": ["a", "ground"], "damping": 1}
        with pytest.raises(Refused, match="springs.damper"):
            engine.simulate(scene(bodies={"a": body()}, springs={"damper": damper}))

    def test_redundant_constraints_without_friction(self, engine):
        """Two guides on one line hold a body as one does; their shares are open, the motion is not."""
        run, alone = (
            engine.simulate(
                scene(gravity=[0, -9.81], bodies={"a": body(velocity=[1.5, 0])}, joints=joints),
                t_end=0.5,
            )
            for joints in (twice(), dict(list(twice().items())[:1]))
        )
        assert (
            "singular" in run.settings["linear_solver"]
            and "singular" not in alone.settings["linear_solver"]
        )
        for column in ("a.x", "a.vx", "a.y"):
            np.testing.assert_allclose(run[column], alone[column], atol=1e-12)

    def test_redundant_constraints_with_friction(self, engine):
        with pytest.raises(Refused, match="redundant and leave its reactions open"):
            engine.simulate(scene(bodies={"a": body()}, joints=twice(mu=0.1)))

    def test_sliders_that_stick_together(self, engine):
        """A trammel at rest: two sticking sliders, one motion to hold."""
        at_rest = vary(load_scene("elliptic-trammel"), {"w": 0, "mu": 0.9, "mus": 0.9, "T": 0})
        with pytest.raises(Refused, match="shares are open"):
            engine.simulate(at_rest)

    def test_acceleration_behind_a_break_away_has_the_friction_that_was_reached(self, engine):
        """With one coefficient friction goes on as it was, and so does the acceleration: it is zero, and not that without friction."""
        run = engine.simulate(load_scene("coulomb-oscillator"), t_end=3.0)
        [slip] = [event for event in run.events if event.kind == "slip"]
        assert (
            slip.after["guide.friction"] == pytest.approx(0.5)
            and abs(slip.after["slider.ax"]) < 1e-6
        )

    def test_friction_without_solution_ends_the_run(self, engine):
        """Painleve: the slip equation of case 1 has no unique solution where mu exceeds 0.45 / |sin th|."""
        run = engine.simulate(
            vary(load_scene("slider-bar-case-1"), {"mu": 0.9, "mus": 0.9, "F0": 60}), t_end=8.0
        )
        assert run.breakdown.kind == UNSETTLED and "do not settle" in run.termination
        assert (
            run.t[-1] <= run.breakdown.time < 8.0
            and abs(np.sin(np.pi / 4 * run.breakdown.time)) > 0.4
        )

    def test_friction_without_solution_at_the_start_leaves_the_start(self, engine):
        scene = load_scene("existence-lost")
        run = engine.simulate(scene, t_end=0.1)
        assert (
            run.breakdown.kind == UNSETTLED
            and list(run.t) == [0.0]
            and run["slider.x"][0] == scene.bodies["slider"].position[0]
        )


def test_a_start_in_motion_settles_where_all_friction_would_not(engine):
    """A trammel with one smooth guide, under a load that both guides together could not hold: held by more than static friction, what its surfaces
    have of that and their load would grow without end (b/a times friction over load is 1)."""
    c, s = np.cos(0.3), np.sin(0.3)
    guide = {"type": "translational", "length": 0.2, "width": 0.1}
    subject = scene(
        gravity=[0, -9.81],
        bodies={
            "a": {"mass": 1, "inertia": 0.02, "position": [c, 0]},
            "b": {"mass": 1.5, "inertia": 0.02, "position": [0, s]},
            "rod": {"mass": 0.5, "inertia": 0.04, "position": [c / 2, s / 2], "angle": np.pi - 0.3},
        },
        joints={
            "gx": {**guide, "slider": "a", "mu": 0},
            "gy": {**guide, "slider": "b", "direction": [0, 1], "mu": 0.3, "mus": 0.35},
            "pa": {"type": "revolute", "bodies": ["rod", "a"], "points": [[-0.5, 0], [0, 0]]},
            "pb": {"type": "revolute", "bodies": ["rod", "b"], "points": [[0.5, 0], [0, 0]]},
        },
        springs={
            "k": {
                "type": "linear",
                "bodies": ["b", "ground"],
                "axis": [0, 1],
                "stiffness": 30,
                "rest_length": 0.6,
            }
        },
    )
    found, expected = (
        engine.simulate(subject, t_end=0.3, dt=1e-3),
        load_engine("reference").simulate(subject, t_end=0.3),
    )
    assert (
        found.termination == "end"
        and np.abs(found["rod.angle"] - expected["rod.angle"]).max() < 1e-5
    )


@pytest.mark.parametrize("dt", [0.00033333333, 0.00099999999])
def test_a_last_step_that_is_all_but_nothing_keeps_the_forces(engine, dt):
    """A step of 1e-8 s divides rounding by its square; the forces at the end are those just before, as nothing happens there."""
    run = engine.simulate(load_scene("slider-bar-case-1"), t_end=1.0, dt=dt, output_step=10 * dt)
    for column in ("motor.effort", "guide.normal_force"):
        assert run[column][-1] == pytest.approx(run[column][-2], rel=1e-6)


def test_a_start_at_a_dead_centre(engine):
    """The crank turns at a given rate, so that the slider rests for an instant alone: x = r cos wt + sqrt(l^2 - (r sin wt)^2)."""
    r, rod, w = 0.15, 0.55, 3.0
    subject = scene(
        gravity=[0, -9.81],
        bodies={
            "crank": body(r, 0, angular_velocity=w, velocity=[0, r * w]),
            "slider": body(r + rod, 0),
            "rod": body(r + rod / 2, 0, velocity=[0, r * w / 2], angular_velocity=-w * r / rod),
        },
        joints={
            "a": {"type": "revolute", "bodies": ["ground", "crank"], "points": [[0, 0], [-r, 0]]},
            "b": {
                "type": "revolute",
                "bodies": ["crank", "rod"],
                "points": [[0, 0], [-rod / 2, 0]],
            },
            "c": {
                "type": "revolute",
                "bodies": ["rod", "slider"],
                "points": [[rod / 2, 0], [0, 0]],
            },
            "guide": {
                "type": "translational",
                "slider": "slider",
                "length": 0.2,
                "mu": 0.2,
                "mus": 0.3,
            },
        },
        drives={
            "motor": {
                "type": "angle",
                "bodies": ["crank", "ground"],
                "law": {"type": "linear", "rate": w},
            }
        },
    )
    run = engine.simulate(subject, t_end=2.5, dt=1e-3)
    np.testing.assert_allclose(
        run["slider.x"],
        r * np.cos(w * run.t) + np.sqrt(rod**2 - (r * np.sin(w * run.t)) ** 2),
        atol=1e-5,
    )
    assert [event.kind for event in run.events] == ["reversal", "reversal"]
    np.testing.assert_allclose(
        [event.time for event in run.events], np.pi / w * np.arange(1, 3), atol=1e-5
    )


def test_a_slider_turns_while_another_sticks(engine):
    """On a shaken carriage: the switch is located by the speeds that the motion goes on with, so that it is one switch, and the steps go on."""
    amplitude, frequency = 0.1, 6.0
    on_car = {"type": "translational", "guide": "car", "length": 0.3, "width": 0.0}
    subject = scene(
        gravity=[0, -9.81],
        bodies={
            "car": {"mass": 5, "inertia": 1, "velocity": [amplitude * frequency, 0]},
            "s1": {"mass": 1, "inertia": 0.02, "position": [-0.5, 0]},
            "s2": {"mass": 2, "inertia": 0.02, "position": [0.5, 0]},
            "arm": {
                "mass": 0.2,
                "inertia": 0.006,
                "position": [-0.2, 0],
                "velocity": [0, 0.6],
                "angular_velocity": 2,
            },
        },
        joints={
            "rail": {"type": "translational", "slider": "car"},
            "g1": {**on_car, "slider": "s1", "mu": 0.1, "mus": 0.15},
            "g2": {**on_car, "slider": "s2", "mu": 0.4, "mus": 0.5},
            "pin": {"type": "revolute", "bodies": ["arm", "s1"], "points": [[-0.3, 0], [0, 0]]},
        },
        drives={
            "shake": {
                "type": "distance",
                "bodies": ["car", "ground"],
                "axis": [1, 0],
                "law": {"type": "sine", "amplitude": amplitude, "frequency": frequency},
            },
            "motor": {
                "type": "angle",
                "bodies": ["arm", "s1"],
                "law": {"type": "linear", "rate": 2},
            },
        },
        springs={
            "k": {
                "type": "linear",
                "bodies": ["s1", "ground"],
                "axis": [1, 0],
                "stiffness": 20,
                "rest_length": -0.5,
            }
        },
    )
    found, expected = (
        engine.simulate(subject, t_end=0.8, dt=1e-3),
        load_engine("reference").simulate(subject, t_end=0.8),
    )
    assert [(event.kind, event.joint) for event in found.events] == [
        ("stick", "g2"),
        ("reversal", "g1"),
        ("reversal", "g1"),
    ]
    assert (
        found.cost.counters["restarts"] < 1000
        and np.abs(found["s1.x"] - expected["s1.x"]).max() < 1e-5
    )


def test_sliders_that_turn_all_but_at_once(engine):
    """Two equal sleds that do not act on each other: one passes zero next to the other's switch, and turns too, so that each moves as it does alone, but for a hundredth of a step."""

    def sleds(names):
        load = {
            "type": "force",
            "direction": [1, 0],
            "law": {"type": "sine", "amplitude": 6, "frequency": 5},
        }
        subject = scene(
            gravity=[0, -9.81],
            bodies={name: {"mass": 1, "inertia": 0.02} for name in names},
            joints={
                f"guide-{name}": {
                    "type": "translational",
                    "slider": name,
                    "length": 0.2,
                    "width": 0.1,
                    "mu": 0.2,
                    "mus": 0.3,
                }
                for name in names
            },
            springs={
                f"spring-{name}": {
                    "type": "linear",
                    "bodies": [name, "ground"],
                    "axis": [1, 0],
                    "stiffness": 20,
                }
                for name in names
            },
            forces={f"load-{name}": load | {"body": name} for name in names},
        )
        return engine.simulate(subject, t_end=2.2, dt=1e-3)

    alone, both = sleds("a"), sleds("ab")
    assert both.cost.counters["restarts"] < 2000 and len(both.events) == 2 * len(alone.events)
    late = SHORTEST_STEP * 1e-3
    assert all(
        np.abs(both[f"{name}.x"] - alone["a.x"]).max() < late * np.abs(alone["a.vx"]).max()
        for name in "ab"
    )


def test_a_slider_that_is_fast_for_its_steps_turns_round():
    """At 1e4 m/s and 100 rad/s the instant of rest is known to 1e-8 m/s alone."""
    scene = scene_from_dict(
        {
            "bodies": {"box": {"mass": 1.0, "inertia": 1.0, "position": [500.0, 0.0]}},
            "joints": {"guide": {"type": "translational", "slider": "box", "mu": 0.1}},
            "springs": {
                "spring": {
                    "type": "linear",
                    "bodies": ["ground", "box"],
                    "stiffness": 1e4,
                    "axis": [1, 0],
                }
            },
            "gravity": [0.0, -9810.0],
        }
    )
    run = load_engine("exudyn").simulate(scene, t_end=0.2, dt=2e-3, output_step=0.01)
    assert {event.kind for event in run.events} == {"reversal"}
    np.testing.assert_allclose(
        [event.time for event in run.events], np.pi / 100 * np.arange(1, 7), rtol=1e-2
    )  # half periods


BRISTLES = {"method": "bristles"}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rtol": 1e-6}, "rtol"),
        ({"dt": 0.0}, "dt"),
        ({"output_step": -1.0}, "output_step"),
        ({"contact_stiffness": 1e6}, "contact_stiffness"),
        ({"iterations": 3}, "iterations.*spectral_radius"),
        ({"spectral_radius": 1.5}, "spectral_radius: found 1.5; expected 0 .. 1"),
        ({**BRISTLES, "fidelity": "contact"}, "no such setting at contact"),
        ({**BRISTLES, "bristle_stiffness": -1.0}, "bristle_stiffness"),
        ({**BRISTLES, "integrator": "euler"}, "found 'euler'; expected one of generalized-alpha"),
        ({**BRISTLES, "contact_stiffness": 1e7}, "no such setting"),
    ],
)
def test_bad_settings(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(load_scene("slider-bar-case-1-mus-equals-mu"), **{"t_end": 0.1, **settings})


@pytest.mark.parametrize("dt", [1e-2, 5e-3, 3e-3, 2e-3, 1e-3, 1e-4])
def test_a_reversal_that_falls_on_a_step(engine, dt):
    """The dead centres of a crank of 60 rpm, at 0.5 and 1 s; the torque is that of steps that do not meet them."""
    scene = load_scene("slider-crank", {"guide.mu": 0.2})
    run = engine.simulate(scene, t_end=1.1, dt=dt, output_step=0.01)
    assert [event.kind for event in run.events] == ["reversal", "reversal"]
    np.testing.assert_allclose([event.time for event in run.events], [0.5, 1.0], atol=1e-6)
    truth = load_engine("reference").simulate(scene, t_end=1.1, rtol=1e-10)
    for k, event in enumerate(run.events):
        for side in ("before", "after"):
            assert (
                abs(
                    getattr(event, side)["motor.effort"]
                    - getattr(truth.events[k], side)["motor.effort"]
                )
                < 2e3 * dt**2 + 1e-3
            )


@pytest.mark.parametrize("dt", [2e-3, 1e-3, 9e-4, 5e-4, 1e-4])
def test_a_quick_return_turns_round_on_a_step(engine, dt):
    """Crank and arm with a slot: where the crank pin is nearest the arm's pivot the slot reverses, and the arm turns with r w/(d - r)."""
    r, w, d = 0.1, 2 * np.pi, 0.25
    far = r * w / (d + r)
    subject = scene(
        bodies={
            "crank": {"mass": 1, "inertia": 0.01, "angular_velocity": w},
            "block": {
                "mass": 0.1,
                "inertia": 1e-4,
                "position": [r, 0],
                "velocity": [0, r * w],
                "angular_velocity": far,
            },
            "arm": {"mass": 2, "inertia": 0.1, "position": [-d, 0], "angular_velocity": far},
        },
        joints={
            "pivot": {"type": "revolute", "bodies": ["crank", "ground"]},
            "hinge": {"type": "revolute", "bodies": ["arm", "ground"], "points": [[0, 0], [-d, 0]]},
            "pin": {"type": "revolute", "bodies": ["block", "crank"], "points": [[0, 0], [r, 0]]},
            "slot": {
                "type": "translational",
                "slider": "block",
                "guide": "arm",
                "direction": [1, 0],
                "mu": 0.1,
            },
        },
        drives={
            "motor": {
                "type": "angle",
                "bodies": ["crank", "ground"],
                "law": {"type": "linear", "rate": w},
            }
        },
    )
    run = engine.simulate(subject, t_end=1.2, dt=dt)
    assert [event.kind for event in run.events] == ["reversal", "reversal"]
    np.testing.assert_allclose([event.time for event in run.events], [0.5, 1.0], atol=1e-6)
    np.testing.assert_allclose(
        [event.before["arm.omega"] for event in run.events], [-r * w / (d - r), far], rtol=1e-3
    )


@pytest.mark.parametrize("dt", [2.5e-4, 1e-4])
def test_a_load_that_passes_through_zero_settles(engine, dt):
    """A sled whose weight is lifted off for a moment: at small steps rounding of the multipliers is what is left of its load."""
    subject = scene(
        bodies={"sled": {"mass": 1, "inertia": 0.1, "velocity": [3, 0]}},
        joints={"guide": {"type": "translational", "slider": "sled", "mu": 0.2}},
        forces={
            "lift": {
                "type": "force",
                "body": "sled",
                "direction": [0, 1],
                "law": {"type": "linear", "offset": -1, "rate": 10},
            }
        },
    )
    run = engine.simulate(subject, t_end=0.2, dt=dt)
    t = run.t  # friction 0.2 |1 - 10 t|
    lost = np.where(t < 0.1, 0.2 * (t - 5 * t**2), 0.2 * (0.05 + 5 * (t - 0.1) ** 2))
    assert run.termination == "end"
    np.testing.assert_allclose(run["sled.vx"], 3 - lost, atol=1e-7)


def test_a_free_body_has_no_reactions(engine):
    """On a spring, x'' = -k x: the check of its balance of forces has no rows then."""
    subject = scene(
        bodies={"ball": {"mass": 1, "inertia": 1, "position": [0.1, 0]}},
        gravity=[0, 0],
        springs={"spring": {"type": "linear", "bodies": ["ball", "ground"], "stiffness": 4}},
    )
    run = engine.simulate(subject, t_end=1.0, dt=1e-3)
    np.testing.assert_allclose(run["ball.x"], 0.1 * np.cos(2 * run.t), atol=1e-6)
