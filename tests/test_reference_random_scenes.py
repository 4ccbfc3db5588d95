"""Random mechanisms: what must hold for all of them, checked from the scene and the columns alone.

The scenes are moderate ones of `comparisons.random_scenes`; those whose motion the reference reports to be not the only one, or lost,
are left out.
"""

import copy

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from comparisons.hard.checks import friction_excess
from comparisons.random_scenes import moderate_scene, turn
from engines.reference import ReferenceEngine
from reference_checks import balance_residual, energy_defect
from reference_impl.audit import audit
from reference_impl.mechanism import Mechanism
from scenes import scene_from_dict

EXAMPLES = 25
T_END, RTOL = 1.5, 1e-9
SETTINGS = settings(max_examples=EXAMPLES, deadline=None, derandomize=True, database=None,
                    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])


def number(low, high):
    return st.integers(0, 1000).map(lambda k: round(low + (high - low) * k / 1000, 6))


class Drawn:
    """`comparisons.random_scenes.Dice` of hypothesis."""

    def __init__(self, draw):
        self._draw = draw

    def number(self, low, high):
        return self._draw(number(low, high))

    def integer(self, low, high):
        return self._draw(st.integers(low, high))

    def chance(self):
        return self._draw(st.booleans())

    def one_of(self, options):
        return self._draw(st.sampled_from(options))


@st.composite
def mechanisms(draw):
    return moderate_scene(Drawn(draw))


def moved(raw, shift, angle):
    """The same mechanism elsewhere: every ground position moved, every ground direction turned."""
    raw = copy.deepcopy(raw)

    def place(point):
        return list(turn(angle, point) + shift)

    raw["gravity"] = list(turn(angle, raw["gravity"]))
    for body in raw["bodies"].values():
        body["position"], body["velocity"] = place(body["position"]), list(turn(angle, body["velocity"]))
        body["angle"] += angle
    for joint in raw["joints"].values():
        if joint["type"] == "revolute" and joint["bodies"][1] == "ground":
            joint["points"][1] = place(joint["points"][1])
        elif joint.get("guide") == "ground":
            joint["point"], joint["direction"] = place(joint["point"]), list(turn(angle, joint["direction"]))
            joint["angle"] += angle
    for spring in raw["springs"].values():
        if spring["type"] == "linear" and spring["bodies"][1] == "ground":
            spring["points"][1], spring["axis"] = place(spring["points"][1]), list(turn(angle, spring["axis"]))
    for load in raw["forces"].values():
        load["direction"] = list(turn(angle, load["direction"]))
    for drive in raw["drives"].values():
        if drive["bodies"][1] == "ground":
            drive["law"]["offset"] += angle
    return raw


def reordered(raw):
    raw = copy.deepcopy(raw)
    for section in ("bodies", "joints", "drives", "springs", "forces"):
        raw[section] = dict(reversed(raw[section].items()))
    return raw


def run(raw):
    scene = scene_from_dict(raw)
    trajectory = ReferenceEngine().simulate(scene, t_end=T_END, rtol=RTOL, stabilization="projection", output_step=0.03)
    assume(not trajectory.termination.startswith(("the HLCP has no solution", "contact modes follow each other")))
    assert trajectory.termination == "end"
    return scene, trajectory


@SETTINGS
@given(mechanisms())
def test_forces_balance_and_obey_coulomb(raw):
    scene, trajectory = run(raw)
    # momentum: rounding of the linear solves, with a reserve of 10^4 over one epsilon for ill-conditioned mechanisms
    assert balance_residual(scene, trajectory.t, trajectory.columns) < 2e-12
    assert friction_excess(scene, trajectory.columns) < 1e-9  # moments of rounding size, divided by short sliders
    for name in scene.frictional_guides:
        mode, speed = trajectory[f"{name}.mode"], trajectory[f"{name}.slip_velocity"]
        # a stuck slider creeps by the integration error only, a slipping one slips in the direction of its mode
        size = 1 + np.max(np.abs(speed))
        assert np.all(np.abs(speed[mode == 0]) < 1e3 * RTOL * size)
        assert np.all(mode * speed >= -1e3 * RTOL * size)
    mechanism = Mechanism(scene, "projection")
    found = audit(trajectory, mechanism, 40)
    assert found.unsolved == 0
    assert found.complementarity < 1e-10
    # the frozen mode has the accelerations of the complementarity problem
    assert found.acceleration < 1e-8


@SETTINGS
@given(mechanisms())
def test_energy_balance(raw):
    scene, _ = run(raw)
    # T + V against the work of friction, drive, dampers and loads: the local tolerance times the number of steps, with
    # a reserve for forces that change fast within a panel of the quadrature
    assert energy_defect(scene, T_END, RTOL) < 1e-6


def largest_difference(one, other, bodies, back=lambda x: x):
    """Of the motion of all bodies, relative to its size; `back` takes the other's positions home."""
    worst = 0.0
    for name in bodies:
        x = np.array([one[f"{name}.x"], one[f"{name}.y"]])
        y = back(np.array([other[f"{name}.x"], other[f"{name}.y"]]))
        omega = one[f"{name}.omega"]
        worst = max(worst, np.max(np.abs(x - y)) / (1 + np.max(np.abs(x))),
                    np.max(np.abs(omega - other[f"{name}.omega"])) / (1 + np.max(np.abs(omega))))
    return worst


def sequence(trajectory):
    """Events in order, those of one instant by name."""
    return [key[1:] for key in sorted((round(event.time, 5), event.joint, event.kind) for event in trajectory.events)]


@SETTINGS
@given(mechanisms(), number(-3, 3), number(-2, 2))
def test_invariant_to_origin_axes_and_order(raw, angle, shift):
    scene, trajectory = run(raw)
    shift = np.array([shift, 1 - shift])
    _, elsewhere = run(moved(raw, shift, angle))
    # the integration tolerance is relative to a size that the origin enters, and the motion amplifies it
    assert largest_difference(trajectory, elsewhere, scene.bodies, lambda x: turn(-angle, x - shift[:, None])) < 1e-6
    _, shuffled = run(reordered(raw))
    assert largest_difference(trajectory, shuffled, scene.bodies) < 1e-7
    assert sequence(trajectory) == sequence(elsewhere) == sequence(shuffled)
