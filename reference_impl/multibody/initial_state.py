"""The start: consistent, refused with its residual, or assembled onto the constraints on request."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.subsystems import independent_parts
from stiction.scenes import Problem, Scene, SceneError, vary
from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Translational

CONSISTENT = 1e-9
"""Residual of Phi relative to the mechanism's size, and of Phi' relative to size per second or the largest speed, up to
which a start counts as consistent: the accuracy to which scene files are written by hand, times a reserve."""


ROUNDINGS = 8
"""Roundings of the largest coordinate of a scene that the residual of a constraint may have."""


def _largest_coordinate(scene: Scene) -> float:
    """Return the largest coordinate of a body or point, or value of a law, at the start.

    Points are those of joints and drives.
    """
    values = [abs(x) for body in scene.bodies.values() for x in (*body.position, body.angle)]
    for element in [*scene.joints.values(), *scene.drives.values()]:
        points = (
            (element.slider_point, element.point)
            if isinstance(element, Translational)
            else element.points
        )
        values += [abs(x) for point in points for x in point]
    values += [abs(evaluate_law(drive.law, 0.0)[0]) for drive in scene.drives.values()]
    return max(values)


def consistent_start(mechanism: Mechanism, assemble: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return what `consistent_starts` returns, for one mechanism."""
    return consistent_starts([mechanism], assemble)[0]


def consistent_starts(
    parts: Sequence[Mechanism], assemble: bool = False
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return coordinates and velocities at t = 0 of the parts of a scene that meet the constraints.

    `assemble`: project an inconsistent start onto the constraints, in the metric of the mass matrix, instead of
    refusing it. Returns q and v, (3 * bodies,), of each part.

    Raises
    ------
    SceneError
        If the start is inconsistent and `assemble` is False, with the residual of every constraint that is not met;
        or if it could not be assembled.
    """
    starts, problems = [], []
    for mechanism in parts:
        q, v, found = _start(mechanism, assemble)
        starts.append((q, v))
        problems += found
    if problems:
        raise SceneError(parts[0].scene._origin, problems)
    return starts


def _start(mechanism: Mechanism, assemble: bool) -> tuple[np.ndarray, np.ndarray, list[Problem]]:
    q, v = mechanism.initial_state()
    m, w = mechanism.arrays, mechanism.workspace
    if not m.rows:
        return q, v, []
    row_form(m, w, 0.0, q, v)
    speed = max(m.length_scale, *map(abs, v.tolist()))
    # no residual is known better than the numbers that it is the difference of, far from the origin
    position_floor = max(
        CONSISTENT * m.length_scale, ROUNDINGS * np.spacing(_largest_coordinate(mechanism.scene))
    )
    velocity_floor = CONSISTENT * speed
    if assemble and all(map(isfinite, w.phi.tolist())):
        project(m, w, 0.0, q, v, np.zeros(len(m.friction), dtype=np.int64), False, 50)
        row_form(m, w, 0.0, q, v)
    problems = []
    for name, position, velocity in zip(mechanism.row_names, w.phi.tolist(), w.phi_dot.tolist()):
        for residual, floor, what in (
            (position, position_floor, "position"),
            (velocity, velocity_floor, "velocity"),
        ):
            if not abs(residual) <= floor:
                advice = (
                    "the start could not be assembled"
                    if assemble
                    else "correct the start or assemble it (--assemble)"
                )
                problems.append(
                    Problem(
                        f"start.{name}",
                        f"{what} residual {residual:.6g}",
                        f"expected the constraint to be met within {floor:.1g}; {advice}",
                    )
                )
    return q, v, problems


def with_consistent_start(scene: Scene, assemble: bool = False) -> Scene:
    """Return the scene itself if its start meets the constraints, else one whose start does.

    It is for engines that do not check the start.

    Parameters, errors: see `consistent_starts`.
    """
    parts = [Mechanism(part) for part in independent_parts(scene)]
    starts = consistent_starts(parts, assemble)
    if not assemble:
        return scene
    return vary(
        scene,
        {
            f"{name}.{key}": value
            for part, (q, v) in zip(parts, starts)
            for i, name in enumerate(part.body_names)
            for key, value in (
                ("position", q[3 * i : 3 * i + 2]),
                ("angle", q[3 * i + 2]),
                ("velocity", v[3 * i : 3 * i + 2]),
                ("angular_velocity", v[3 * i + 2]),
            )
        },
    )
