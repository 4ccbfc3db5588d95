"""A scene as arrays: what the compiled kernels work on.

Rows. The constraints Phi = [Phi_CR; Phi_CT; Phi_D] of eq. (20) are numbered row by row, joints in the order of
the scene, then drives. A frictional guide adds one row behind them: the tangential direction of its slider
(W_T of eq. (8) at the slider's point). Every row touches at most two bodies, so that it is stored as two blocks
of three coefficients, `J[row, side]`.

The surfaces (+) and (-) need no rows of their own: the angle of the slider in its guide is a constraint row, and the
row of W_T for a surface at lever -+b/2 is the tangential row +- b/2 times that angle row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scenes import Scene
from scenes.fields import GROUND
from scenes.laws import Constant, Law, Linear, Sine, Table, spline_slopes
from scenes.model import Baumgarte, Drive, Force, LinearSpring, Revolute

REVOLUTE, TRANSLATIONAL, ANGLE, DISTANCE, AXIS = range(5)
LAW_POLYNOMIAL, LAW_SINE, LAW_TABLE, LAW_SPLINE = range(4)


class Arrays(NamedTuple):
    """The mechanism for the kernels; index -1 is the ground, angles in radians, SI units.

    `constraint_*`: one entry per joint and drive. `friction_*`: one per frictional guide. `block`: the blocks of three
    coefficients that a row has for a moving body, as (place in the flat J, row, 3 * body). `pair`: the pairs of blocks that
    meet at the same body, on and above the diagonal, as (place of the one, place of the other, place in the flat
    G, place of its mirror image): the sparsity of G = J M^-1 J^T.
    """

    bodies: int
    rows: int
    frictional: int
    inverse_mass: np.ndarray
    weight: np.ndarray
    constraint_kind: np.ndarray
    constraint_row: np.ndarray
    constraint_body: np.ndarray
    constraint_point: np.ndarray
    constraint_direction: np.ndarray
    constraint_offset: np.ndarray
    constraint_law: np.ndarray
    constraint_friction: np.ndarray
    friction_row: np.ndarray
    friction_length: np.ndarray
    friction_width: np.ndarray
    friction_mu: np.ndarray
    friction_mus: np.ndarray
    spring_kind: np.ndarray
    spring_body: np.ndarray
    spring_point: np.ndarray
    spring_axis: np.ndarray
    spring_stiffness: np.ndarray
    spring_damping: np.ndarray
    spring_rest: np.ndarray
    load_body: np.ndarray
    load_point: np.ndarray
    load_direction: np.ndarray
    load_law: np.ndarray
    law_kind: np.ndarray
    law_values: np.ndarray
    law_knots: np.ndarray
    block: np.ndarray
    pair: np.ndarray
    baumgarte_2alpha: float
    baumgarte_beta2: float
    length_scale: float


class Mechanism:
    """A scene assembled for the reference implementation.

    Only what the scene declares gets a block: no frictional guide, no complementarity problem; no drive, no
    driving multiplier; no gravity, no weight.

    Parameters
    ----------
    scene : Scene
    stabilization : {"scene", "none", "baumgarte", "projection"}
        What to do against drift; "scene" is what the scene declares, "baumgarte" its own alpha and beta or,
        where it declares none, the paper's 90 and 10.

    Attributes
    ----------
    arrays : Arrays
    body_names, row_names, guide_names : list of str
        Names of bodies, of constraint rows (``pin.fx``, ``guide.normal_force``, ``motor.effort``) and of
        frictional guides, in the order of the arrays.
    projection : bool
        Whether states are projected onto the constraints after each step.
    kinks : ndarray
        Times at which a tabulated law changes its formula.
    """

    def __init__(self, scene: Scene, stabilization: str = "scene"):
        self.scene = scene
        self.body_names = list(scene.bodies)
        self._index = {GROUND: -1, **{name: i for i, name in enumerate(self.body_names)}}
        self._laws: list[Law] = []
        self.guide_names = list(scene.frictional_guides)
        self.row_names: list[str] = []
        alpha, beta, self.projection = _stabilization(scene, stabilization)
        self.stabilization = {"method": "projection" if self.projection else "baumgarte" if alpha or beta else "none",
                              **({"alpha": alpha, "beta": beta} if alpha or beta else {})}
        inertia = [value for body in scene.bodies.values() for value in (body.mass, body.mass, body.inertia)]
        gravity = scene.gravity or (0.0, 0.0)
        weight = [value for body in scene.bodies.values() for value in (body.mass * gravity[0], body.mass * gravity[1], 0)]
        constraints = self._constraints()
        springs, loads = self._springs(), self._loads()
        frictional = list(scene.frictional_guides.values())
        self.arrays = Arrays(
            bodies=len(self.body_names), rows=len(self.row_names), frictional=len(frictional),
            inverse_mass=1.0 / np.array(inertia), weight=np.array(weight, dtype=float),
            **constraints,
            friction_length=np.array([guide.length or 0.0 for guide in frictional]),
            friction_width=np.array([guide.width or 0.0 for guide in frictional]),
            friction_mu=np.array([guide.mu for guide in frictional], dtype=float),
            friction_mus=np.array([guide.static_coefficient for guide in frictional], dtype=float),
            **springs, **loads, **self._law_arrays(),
            **self._blocks(constraints), baumgarte_2alpha=2.0 * alpha, baumgarte_beta2=beta ** 2,
            length_scale=self._length_scale())
        self.kinks = np.array(sorted({t for law in self._laws if isinstance(law, Table) for t in law.times}))

    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and velocities at t = 0 as the scene gives them, each of shape (3 * bodies,)."""
        bodies = self.scene.bodies.values()
        q = np.array([value for body in bodies for value in (*body.position, body.angle)])
        v = np.array([value for body in bodies for value in (*body.velocity, body.angular_velocity)])
        return q, v

    def _constraints(self) -> dict[str, np.ndarray]:
        scene = self.scene
        kind, row, body, point, direction, offset, law, friction, friction_row = ([] for _ in range(9))
        for name, element in [*scene.joints.items(), *scene.drives.items()]:
            row.append(len(self.row_names))
            body.append([self._index[other] for other in element.bodies])
            u, o, number, guide = (1.0, 0.0), 0.0, -1, -1
            if isinstance(element, Revolute):
                kind.append(REVOLUTE)
                point.append(element.points)
                self.row_names += [f"{name}.fx", f"{name}.fy"]
            elif isinstance(element, Drive):
                kind.append(ANGLE if element.type == "angle" else DISTANCE if element.axis is None else AXIS)
                point.append(element.points)
                u = element.axis or u
                number = self._law(element.law)
                self.row_names.append(f"{name}.effort")
            else:
                kind.append(TRANSLATIONAL)
                point.append((element.slider_point, element.point))
                u, o = element.direction, element.angle
                if element.frictional:
                    guide = len(friction_row)
                    friction_row.append(row[-1])
                self.row_names += [f"{name}.normal_force", f"{name}.moment"]
            direction.append(np.array(u) / np.hypot(*u))
            offset.append(o)
            law.append(number)
            friction.append(guide)
        integer = dict(dtype=np.int64)
        return dict(constraint_kind=np.array(kind, **integer), constraint_row=np.array(row, **integer),
                    constraint_body=np.array(body, **integer).reshape(-1, 2),
                    constraint_point=np.array(point, dtype=float).reshape(-1, 2, 2),
                    constraint_direction=np.array(direction, dtype=float).reshape(-1, 2),
                    constraint_offset=np.array(offset, dtype=float), constraint_law=np.array(law, **integer),
                    constraint_friction=np.array(friction, **integer), friction_row=np.array(friction_row, **integer))

    def _springs(self) -> dict[str, np.ndarray]:
        springs = list(self.scene.springs.values())
        linear = [isinstance(spring, LinearSpring) for spring in springs]
        origin = ((0.0, 0.0), (0.0, 0.0))
        axis = [spring.axis if is_linear and spring.axis else (1.0, 0.0) for spring, is_linear in zip(springs, linear)]
        return dict(
            spring_kind=np.array([ANGLE if not is_linear else DISTANCE if spring.axis is None else AXIS
                                  for spring, is_linear in zip(springs, linear)], dtype=np.int64),
            spring_body=np.array([[self._index[name] for name in s.bodies] for s in springs], dtype=np.int64).reshape(-1, 2),
            spring_point=np.array([s.points if is_linear else origin for s, is_linear in zip(springs, linear)],
                                  dtype=float).reshape(-1, 2, 2),
            spring_axis=np.array([np.array(u) / np.hypot(*u) for u in axis], dtype=float).reshape(-1, 2),
            spring_stiffness=np.array([s.stiffness for s in springs], dtype=float),
            spring_damping=np.array([s.damping for s in springs], dtype=float),
            spring_rest=np.array([s.rest_length if is_linear else s.rest_angle for s, is_linear in zip(springs, linear)],
                                 dtype=float))

    def _loads(self) -> dict[str, np.ndarray]:
        """Forces and torques; a torque is a load with direction (0, 0)."""
        loads = list(self.scene.forces.values())
        is_force = [isinstance(load, Force) for load in loads]
        return dict(
            load_body=np.array([self._index[load.body] for load in loads], dtype=np.int64),
            load_point=np.array([load.point if f else (0, 0) for load, f in zip(loads, is_force)], dtype=float).reshape(-1, 2),
            load_direction=np.array([np.array(load.direction) / np.hypot(*load.direction) if f else np.zeros(2)
                                     for load, f in zip(loads, is_force)], dtype=float).reshape(-1, 2),
            load_law=np.array([self._law(load.law) for load in loads], dtype=np.int64))

    def _law(self, law: Law) -> int:
        self._laws.append(law)
        return len(self._laws) - 1

    def _law_arrays(self) -> dict[str, np.ndarray]:
        kind, values, knots = [], [], []
        for law in self._laws:
            if isinstance(law, Constant):
                entry = LAW_POLYNOMIAL, (law.value, 0.0, 0.0, 0.0)
            elif isinstance(law, Linear):
                entry = LAW_POLYNOMIAL, (law.offset, law.rate, 0.0, 0.0)
            elif isinstance(law, Sine):
                entry = LAW_SINE, (law.offset, law.amplitude, law.frequency, law.phase)
            else:
                t, y = np.array(law.times), np.array(law.values)
                cubic = law.interpolation == "cubic"
                second = spline_slopes(t, y) if cubic else np.zeros(len(t))
                entry = LAW_SPLINE if cubic else LAW_TABLE, (len(knots), len(knots) + len(t), 0.0, 0.0)
                knots += zip(t, y, second)
            kind.append(entry[0])
            values.append(entry[1])
        return dict(law_kind=np.array(kind, dtype=np.int64), law_values=np.array(values, dtype=float).reshape(-1, 4),
                    law_knots=np.array(knots, dtype=float).reshape(-1, 3))

    def _blocks(self, constraints: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Blocks of the rows, tangential rows included, and their pairs at the same body."""
        size = len(self.row_names) + len(constraints["friction_row"])
        blocks: list[tuple[int, int, int]] = []
        for k, bodies in enumerate(constraints["constraint_body"]):
            first = constraints["constraint_row"][k]
            count = 2 if constraints["constraint_kind"][k] in (REVOLUTE, TRANSLATIONAL) else 1
            rows = [first + i for i in range(count)]
            if constraints["constraint_friction"][k] >= 0:
                rows.append(len(self.row_names) + constraints["constraint_friction"][k])
            blocks += [(6 * row + 3 * side, row, 3 * int(body)) for row in rows for side, body in enumerate(bodies) if body >= 0]
        at_body: dict[int, list[tuple[int, int]]] = {}
        for place, row, body in blocks:
            at_body.setdefault(body, []).append((place, row))
        pairs = [(p, o, size * r + c, size * c + r) for group in at_body.values() for p, r in group for o, c in group if c >= r]
        integer = dict(dtype=np.int64)
        return dict(block=np.array(sorted(blocks), **integer).reshape(-1, 3), pair=np.array(sorted(pairs), **integer).reshape(-1, 4))

    def _length_scale(self) -> float:
        """A length of the mechanism: the largest extent of points, positions, sliders and springs that is declared."""
        scene = self.scene
        lengths = [abs(x) for joint in scene.joints.values() if isinstance(joint, Revolute) for p in joint.points for x in p]
        lengths += [x for guide in scene.guides.values() for x in (guide.length or 0.0, guide.width or 0.0)]
        lengths += [abs(x) for body in scene.bodies.values() for x in body.position]
        return max(lengths, default=0.0) or 1.0


def _stabilization(scene: Scene, choice: str) -> tuple[float, float, bool]:
    declared = scene.stabilization
    method = declared.method if choice == "scene" else choice
    if method not in ("none", "baumgarte", "projection"):
        raise ValueError(f"stabilization: found {choice!r}; expected 'scene', 'none', 'baumgarte' or 'projection'")
    if method == "baumgarte":
        if isinstance(declared, Baumgarte):
            return declared.alpha, declared.beta, False
        return 90.0, 10.0, False
    return 0.0, 0.0, method == "projection"
