"""The rivals of the HLCP, each against truths that share no code with it: Moreau's time stepping, trial and error, enumeration.

That the paper's method is better where they fail says something only if they are right where they should not fail.
"""

import numpy as np
import pytest

from stiction.comparisons.measures.accuracy import errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import load_engine
from stiction.scenes import Scene, load_scene, vary
from stiction.truths import slider_bar_truth

SLIDER_BARS = [
    "slider-bar-case-1",
    "slider-bar-case-2",
    "slider-bar-case-3",
    "slider-bar-case-1-mus-equals-mu",
]
OTHERS = ["coulomb-oscillator", "mass-on-belt", "block-on-incline", "slider-on-moving-guide"]
CLEARANCE = 1e-7
"""Of Moreau's guides, in parts of the mechanism's size: small beside the errors of its steps."""


def simulate(scene, solver, rtol=1e-12):
    return load_engine("reference").simulate(
        scene, rtol=rtol, stabilization="projection", solver=solver
    )


@pytest.mark.parametrize("name", [*SLIDER_BARS, *OTHERS])
@pytest.mark.parametrize("solver", ["trial", "enumeration"])
class TestSolvers:
    def test_follows_the_truth(self, solver, name):
        """As closely as with Lemke's method: what the suite promises, 1e-9 for states and event times, 1e-8 N m for torques."""
        scene = load_scene(name)
        found = errors(simulate(scene, solver), ground_truth(scene))
        assert found["time_covered"] == scene.t_end
        assert found["position_error"] < 1e-9 and found["velocity_error"] < 1e-9
        assert found.get("events_missed", 0) == found.get("events_spurious", 0) == 0
        assert not found.get("event_time_error", 0.0) > 1e-9
        assert not found.get("torque_error", 0.0) > 1e-8


class TestWhereTheyFail:
    @pytest.mark.parametrize("solver", ["trial", "enumeration"])
    def test_no_motion_is_no_number(self, solver):
        """No acceleration satisfies Coulomb's law at the start, by closed form (`existence-lost.toml`)."""
        run = simulate(load_scene("existence-lost"), solver)
        assert run.breakdown.time == 0.0 and len(run.t) == 1
        assert run.breakdown.kind == {"trial": "sign cycle", "enumeration": "no solution"}[solver]

    def test_a_dead_centre(self):
        """A trammel's slider is at rest at its dead centre whatever the bar does: that it sticks is an equation which the pins already are.
        Trial and error, which assumes it on its way, says so; enumeration leaves that mode out."""
        scene = load_scene("elliptic-trammel")
        truth = ground_truth(scene, 2.0)
        dead_centre = next(event.time for event in truth.events if event.kind == "reversal")
        lost, found = (
            simulate(vary(scene, {"t_end": 2.0}), solver) for solver in ("trial", "enumeration")
        )
        assert lost.breakdown.kind == "singular" and lost.breakdown.time == pytest.approx(
            dead_centre, abs=1e-9
        )
        assert errors(lost, truth)["position_error"] < 1e-9  # until then
        assert found.termination == "end" and errors(found, truth)["position_error"] < 1e-9


def without_static_coefficient(name: str) -> Scene:
    """Moreau's impact law has one coefficient."""
    scene = load_scene(name)
    return vary(
        scene, {f"{guide}.mus": joint.mu for guide, joint in scene.frictional_guides.items()}
    )


def moreau(scene, dt, **settings):
    return load_engine("moreau").simulate(
        scene, dt=dt, fidelity="contact", clearance=CLEARANCE, **settings
    )


class TestMoreau:
    @pytest.mark.parametrize(
        "name", [*SLIDER_BARS[:3], *OTHERS, "elliptic-trammel", "pendulum", "slider-crank"]
    )
    def test_is_late_by_a_step_at_most(self, name):
        """Velocities jump at the ends of steps: a change of the contact mode waits for one, and what moves then is a step behind."""
        scene, dt = without_static_coefficient(name), 2e-3
        scene = vary(
            scene, {"t_end": min(scene.t_end, 9.0)}
        )  # a period of the slider-bars and a bit
        truth = ground_truth(scene)
        run = moreau(scene, dt)
        states = truth(np.linspace(0.0, scene.t_end, 4001))
        fastest = max(
            np.abs(values).max()
            for column, values in states.items()
            if column.endswith((".vx", ".vy"))
        )
        assert run.termination == "end" and run.t[-1] == pytest.approx(scene.t_end)
        assert errors(run, truth)["position_error"] < dt * fastest

    @pytest.mark.parametrize("name", SLIDER_BARS[:2])
    def test_first_order_in_reactions_between_events(self, name):
        """Two events may change places with the steps, so that positions have no smooth order; what is a step late has one between them."""
        scene, t_end = without_static_coefficient(name), 4.0
        truth, steps, found = slider_bar_truth(scene, t_end), (1e-3, 2.5e-4), []
        for dt in steps:
            run = moreau(scene, dt, t_end=t_end, output_step=0.02)
            between = (
                np.abs(run.t[:, None] - [0.0, *(event.time for event in truth.events)]).min(axis=1)
                > 0.019
            )
            true = truth(run.t)
            found.append(
                [
                    np.abs(run[column] - true[column])[between].max()
                    for column in ("motor.effort", "guide.friction", "guide.normal_force")
                ]
            )
        assert np.all(
            np.log(np.divide(*found)) / np.log(4.0) > 0.8
        )  # 1, less what is left of the coarse run's curvature

    def test_sticks_within_its_clearance(self):
        """At rest from 7.60 to 8.22 s: a contact that sticks has no velocity, and the slider stays where it is."""
        scene = without_static_coefficient("slider-bar-case-1")
        truth = slider_bar_truth(scene, 9.0)
        begin, end = (
            [event.time for event in truth.events if event.kind == kind][i]
            for kind, i in (("stick", 0), ("slip", 1))
        )
        run = moreau(scene, 1e-3, t_end=9.0, output_step=0.02)
        rest = (run.t > begin + 0.01) & (run.t < end - 0.01)
        assert rest.sum() > 10 and np.all(run["guide.mode"][rest] == 0)
        assert np.ptp(run["slider.x"][rest]) < 1e-9  # Lemke's zeros

    @pytest.mark.parametrize(("tangent", "slides"), [(0.19, False), (0.21, True)])
    def test_incline(self, tangent, slides):
        """Sticks if tan <= mu = 0.2; slides with g (sin - mu cos) from the first step on."""
        scene = vary(
            without_static_coefficient("block-on-incline"),
            {"guide.mu": 0.2, "guide.mus": 0.2, "incline": float(np.arctan(tangent))},
        )
        run, dt = moreau(scene, 1e-3, t_end=1.0), 1e-3
        angle = np.arctan(tangent)
        speed = 9.81 * (np.sin(angle) - 0.2 * np.cos(angle)) if slides else 0.0
        assert np.hypot(run["slider.vx"][-1], run["slider.vy"][-1]) == pytest.approx(
            speed, abs=9.81 * dt if slides else 1e-9
        )
