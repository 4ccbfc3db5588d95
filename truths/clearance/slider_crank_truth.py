"""The truth of a slider-crank with a free crank and clearance in its guide: an event-driven motion with impacts."""

from __future__ import annotations

import numpy as np

from stiction.scenes import Scene
from stiction.truths.clearance.impacting_motion import ImpactingMotion, impacting_motion
from stiction.truths.clearance.mechanisms import (
    FREE_SLIDER_CRANK,
    ClearanceSliderCrank,
    slider_crank_with_clearance,
)
from stiction.truths.reduced.piecewise_smooth import Undecided
from stiction.truths.truth import Tier, Truth, body_columns

STEPS_PER_TURN = 200
"""Number of longest steps per turn of the faster bar at its speed at the start: 0.03 rad each."""
CHECK_INSTANTS = 101
"""Number of instants at which the two integrations are compared: their difference changes at impacts only."""


def clearance_slider_crank_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion, corner forces and friction of a slider-crank with clearance.

    The uncertainty of a column is its largest difference from a second integration with twice the longest step. Impacts
    are no events of a `Truth`, as they change no mode of a guide.

    Raises
    ------
    NotThisMechanism
        If the scene is another mechanism.
    NoMotion
        If the law of contact has no solution or several.
    Undecided
        If the two integrations have different impacts.
    """
    end = scene.t_end if t_end is None else t_end
    mechanism, q, v = slider_crank_with_clearance(scene)
    match = FREE_SLIDER_CRANK.match(scene)
    bodies = (match.bodies["crank"], match.bodies["rod"], match.bodies["slider"])
    guide = match.name("guide")
    point_x = match["guide"].point[0]
    # A mechanism that starts at rest has its own time scale, that of a pendulum of its length.
    speed = max(float(np.abs(v[:2]).max()), 1.0)
    longest_step = 2.0 * np.pi / speed / STEPS_PER_TURN
    motion, check = (
        impacting_motion(mechanism, q, v, end, step) for step in (longest_step, 2.0 * longest_step)
    )
    if len(motion.impacts) != len(check.impacts):
        raise Undecided(
            f"two integrations have {len(motion.impacts)} and {len(check.impacts)} impacts"
        )

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        return _columns(mechanism, motion, bodies, guide, point_x, t, side)

    instants = np.linspace(0.0, end, CHECK_INSTANTS)
    values = columns(instants, "after")
    others = _columns(mechanism, check, bodies, guide, point_x, instants, "after")
    uncertainty = {
        name: float(np.max(np.abs(values[name] - others[name])))
        + float(np.finfo(float).eps * np.max(np.abs(values[name])))
        for name in values
    }
    return Truth(
        scene.name,
        Tier.HIGH_PRECISION,
        end,
        columns,
        uncertainty,
        guides=frozenset(),
        has_gaps=True,
    )


def _columns(
    mechanism: ClearanceSliderCrank,
    motion: ImpactingMotion,
    bodies: tuple[str, str, str],
    guide: str,
    point_x: float,
    t: np.ndarray,
    side: str,
) -> dict[str, np.ndarray]:
    """Return the columns of a `Trajectory` at times (s), those of a side at an impact.

    Parameters
    ----------
    bodies : tuple of str
        Names of crank, rod and slider.
    guide : str
        Name of the guide.
    point_x : float
        Position of its point along it, m.
    """
    q, v, acceleration, normal, friction = _samples(motion, t, side)
    # Distances of the centres of mass from the pivot, along crank and rod.
    crank_length, rod_length = mechanism.crank_length, mechanism.rod_length
    arms = (
        (mechanism.crank_centre, 0.0),
        (crank_length, mechanism.rod_centre),
        (crank_length, rod_length),
    )
    values: dict[str, np.ndarray] = {}
    for number, (body, (on_crank, on_rod)) in enumerate(zip(bodies, arms, strict=True)):
        position = np.zeros((2, len(t)))
        velocity = np.zeros((2, len(t)))
        change = np.zeros((2, len(t)))
        for length, angle in ((on_crank, 0), (on_rod, 1)):
            along = np.array([np.cos(q[angle]), np.sin(q[angle])])
            across = np.array([-along[1], along[0]])
            position += length * along
            velocity += length * v[angle] * across
            change += length * (acceleration[angle] * across - v[angle] ** 2 * along)
        values |= body_columns(
            body,
            (*position, q[number]),
            (*velocity, v[number]),
            (*change, acceleration[number]),
        )
    slider = bodies[2]
    values[f"{guide}.displacement"] = values[f"{slider}.x"] - point_x
    values[f"{guide}.slip_velocity"] = values[f"{slider}.vx"]
    for corner in range(4):
        values[f"{guide}.F{corner + 1}"] = normal[corner]
    lower, upper = (0, 1), (2, 3)
    values[f"{guide}.normal_force"] = sum(normal[i] for i in lower) - sum(normal[i] for i in upper)
    values[f"{guide}.friction_lower"] = friction[lower[0]] + friction[lower[1]]
    values[f"{guide}.friction_upper"] = friction[upper[0]] + friction[upper[1]]
    values[f"{guide}.friction"] = friction.sum(axis=0)
    return values


def _samples(
    motion: ImpactingMotion, t: np.ndarray, side: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return coordinates, velocities, accelerations (3, n), and normal forces and frictions (4, n) at times (s)."""
    samples = []
    for time in t:
        q, v = motion.state(float(time), side)
        forces = motion.forces(float(time), side)
        samples.append(np.concatenate([q, v, forces.acceleration, forces.normal, forces.friction]))
    rows = np.array(samples).reshape(len(t), 17).T
    return rows[:3], rows[3:6], rows[6:9], rows[9:13], rows[13:17]
