"""Which frictional joints can move at all: by a freedom of the mechanism, by its drives alone, or never.

Guides here are all frictional joints, pins among them: what is said of a slider holds for the rotation of a pin, and
for the coordinate of a drive with a limit, which is no row of D. A drive with a limit counts as driven where it is
locked, since it slips at the rate of its law. With
J the rows of the joints, D those of the drives and W the tangential row of a guide, the slip velocity W v is

    locked   W depends on J:       no motion that the joints allow moves the slider in its guide;
    driven   W depends on [J; D]:  the drives determine the slip velocity, and no freedom is left to it;
    free     otherwise.

The friction of a guide that is not free does no work on a freedom: any change of it is balanced by reactions and
efforts, and the accelerations stay. Hence rigid bodies do not determine the friction of such a guide at rest, and while
it slips Coulomb's law may allow several frictions for one motion (`friction.open_forces`).

Dependence in a single position proves nothing: the slider of a slider-crank cannot move in its dead centre, and can
everywhere else. Dependence is a property of the mechanism where it holds in general position, as the rank of an
analytic matrix is the same almost everywhere on a branch of motion. So it is tested in positions that the joints
allow and that are drawn at random near the start, whatever the drives ask for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache

import numpy as np
from scipy.linalg import qr

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Drive, Joint, Translational


class GuideFreedom(IntEnum):
    """How a guide can move; the values are those of the compiled kernels."""

    FREE = 0
    DRIVEN = 1
    LOCKED = 2


FREE, DRIVEN, LOCKED = (int(kind) for kind in GuideFreedom)


@dataclass(frozen=True)
class GuideFreedoms:
    """What a scene leaves to its frictional guides.

    Attributes
    ----------
    freedom : Mapping of str to GuideFreedom
        By guide, in the order of the scene.
    stressed : tuple of str
        Guides that a freedom moves and whose load depends on a stress that rigid bodies leave open: of redundant
        joints, of a guide that joints lock, or between a drive and the friction of a guide that it holds. The motion
        depends on that stress wherever such a guide slips or is about to.
    """

    freedom: Mapping[str, GuideFreedom]
    stressed: tuple[str, ...] = ()


DEPENDENT = 1e-6
"""Part of a unit row that is left beside the others, up to which it depends on them. In general position an independent
row leaves a part of the order of 1; rounding leaves 1e-12 even beside rows that are nearly dependent."""
RANK = 1e-9
"""Diagonal entry of the triangular factor, relative to the largest, up to which a row adds no rank."""
POSITIONS = 2
"""Positions in which dependence must hold. One in general position is enough with probability 1; a second one costs
little."""
AMPLITUDE = 0.05
"""Size of the random displacement of each coordinate, in radians or parts of the mechanism's size. Large enough to
leave a dead centre, small enough to stay on the branch of motion of the start."""
HALVINGS = 6
"""Times that the displacement is halved where Newton's method does not lead back to the joints."""
NEWTON_STEPS = 30
CLOSED = 1e-10
"""Residual of the joints, in parts of the mechanism's size, at which a position is one that they allow."""


@dataclass(frozen=True)
class _Geometry:
    """What the freedoms of the guides of a scene depend on: equal ones have the same."""

    bodies: tuple[tuple[str, tuple[float, ...]], ...]
    joints: tuple[tuple[str, Joint], ...]
    drives: tuple[tuple[str, Drive], ...]
    length_scale: float
    scene: Scene = field(compare=False)


def guide_freedoms(scene: Scene, length_scale: float) -> GuideFreedoms:
    """Return the freedom of every frictional guide of a scene, and which of them are stressed.

    Parameters
    ----------
    scene : Scene
    length_scale : float
        A length of the mechanism, m, by which angles are compared with lengths.
    """
    elements = scene.bounded_elements
    candidates = tuple(name for name in elements if _closes_loop(scene, name))
    if not candidates:
        return GuideFreedoms(dict.fromkeys(elements, GuideFreedom.FREE))
    positions = tuple((name, (*body.position, body.angle)) for name, body in scene.bodies.items())
    return _freedoms(
        _Geometry(
            positions, tuple(scene.joints.items()), tuple(scene.drives.items()), length_scale, scene
        ),
        candidates,
    )


@lru_cache(maxsize=64)
def _freedoms(geometry: _Geometry, candidates: tuple[str, ...]) -> GuideFreedoms:
    """Do the work of `guide_freedoms` for guides that close a loop.

    A run, its gate and the points of a sweep share the result.
    """
    scene, length_scale = geometry.scene, geometry.length_scale
    found = dict.fromkeys(scene.bounded_elements, GuideFreedom.FREE)
    equations = EquationsOfMotion(scene)
    start, _ = equations.start()
    unit = np.where(np.arange(len(start)) % 3 == 2, 1.0 / length_scale, 1.0)
    joints = len(equations.rows) - len(scene.prescribed_drives)
    names = list(equations.frictional)
    beside_joints = np.zeros((POSITIONS, len(names)))
    beside_all = np.zeros((POSITIONS, len(names)))
    for i, q in enumerate(_positions_near(equations, start, unit, joints, length_scale)):
        terms = equations.at(0.0, q, np.zeros_like(q))
        rows, tangents = terms.J * unit, terms.W * unit
        beside_joints[i] = _part_beside(rows[:joints], tangents)
        beside_all[i] = _part_beside(rows, tangents)

    for name in candidates:
        k = names.index(name)
        if np.all(beside_joints[:, k] <= DEPENDENT):
            is_drive = name in scene.drives
            found[name] = GuideFreedom.DRIVEN if is_drive else GuideFreedom.LOCKED
        elif np.all(beside_all[:, k] <= DEPENDENT):
            found[name] = GuideFreedom.DRIVEN

    # null vectors of the last position: reactions, efforts and frictions of guides that no freedom moves
    unfree = [names.index(name) for name, freedom in found.items() if freedom != GuideFreedom.FREE]
    left, size, _ = np.linalg.svd(np.vstack([rows, tangents[unfree]]))
    rank = int(np.sum(size > RANK * size[0]))
    moved = np.max(np.abs(left[:, rank:]), axis=1, initial=0.0) > DEPENDENT
    stressed = [
        name
        for name in candidates
        if found[name] == GuideFreedom.FREE
        and any(
            moved[equations.rows.index(f"{name}.{label}")]
            for label in _load_rows(scene.bounded_elements[name])
        )
    ]
    return GuideFreedoms(found, tuple(stressed))


def _load_rows(joint: Joint | Drive) -> tuple[str, ...]:
    """Return the names of the rows that the bound of friction of a joint depends on.

    Without a length this is the normal force alone, without a coefficient of friction nothing. The load of a pin is the
    force in it.
    """
    if isinstance(joint, Drive) or joint.mu is None:
        return ()
    if not isinstance(joint, Translational):
        return ("fx", "fy")
    return ("normal_force", "moment") if joint.length else ("normal_force",)


def _closes_loop(scene: Scene, guide: str) -> bool:
    """Return True if joints and drives connect the slider with its guide also without this joint.

    In a tree every guide can move, whatever its dimensions.
    """
    linked: dict[str, set[str]] = {}
    for name, element in [*scene.joints.items(), *scene.drives.items()]:
        if name != guide:
            a, b = element.bodies
            linked.setdefault(a, set()).add(b)
            linked.setdefault(b, set()).add(a)
    slider, goal = scene.bounded_elements[guide].bodies
    reached, waiting = {slider}, [slider]
    while waiting:
        for body in linked.get(waiting.pop(), set()) - reached:
            reached.add(body)
            waiting.append(body)
    return goal in reached or (goal == GROUND and GROUND in reached)


def _positions_near(
    equations: EquationsOfMotion,
    start: np.ndarray,
    unit: np.ndarray,
    joints: int,
    length_scale: float,
) -> list[np.ndarray]:
    """Return positions that the joints allow, displaced at random from the start.

    Where the joints leave no freedom, the only one is the start. The draw is always the same.
    """
    random = np.random.default_rng(20140306)
    closed = CLOSED * min(1.0, length_scale)  # residuals are lengths and angles
    basis = _span(equations.at(0.0, start, np.zeros_like(start)).J[:joints] * unit)
    found = []
    for _ in range(POSITIONS):
        displacement = AMPLITUDE * length_scale * random.uniform(-1.0, 1.0, len(start))
        position = None
        for _ in range(HALVINGS):
            along = displacement - basis @ (basis.T @ displacement)
            position = _closed(equations, start + unit * along, unit, joints, closed)
            if position is not None:
                break
            displacement *= 0.5
        found.append(start if position is None else position)
    return found


def _closed(
    equations: EquationsOfMotion, q: np.ndarray, unit: np.ndarray, joints: int, closed: float
) -> np.ndarray | None:
    """Move a position onto the joints by Newton's method; None where it does not converge."""
    for _ in range(NEWTON_STEPS):
        terms = equations.at(0.0, q, np.zeros_like(q))
        residual = terms.phi[:joints]
        if not len(residual) or np.max(np.abs(residual)) <= closed:
            return q
        step, *_ = np.linalg.lstsq(terms.J[:joints] * unit, residual, rcond=RANK)
        q = q - unit * step
    return None


def _part_beside(rows: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the part of each vector that is orthogonal to all rows, relative to its size."""
    basis = _span(rows)
    sizes = np.linalg.norm(vectors, axis=1)
    left = vectors - (vectors @ basis) @ basis.T
    left -= (left @ basis) @ basis.T  # once more: the first projection leaves its own rounding
    return np.linalg.norm(left, axis=1) / np.where(sizes > 0.0, sizes, 1.0)


def _span(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the span of rows, as columns.

    Rows are compared by their directions.
    """
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0.0] / sizes[sizes > 0.0, None]
    if not len(rows):
        return np.zeros((rows.shape[1], 0))
    basis, triangle, _ = qr(rows.T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    return basis[:, : int(np.sum(diagonal > RANK * diagonal[0]))]
