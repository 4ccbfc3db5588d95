"""A scene as arrays: what the compiled kernels work on.

Rows. The constraints Phi = [Phi_CR; Phi_CT; Phi_D] of eq. (20) are numbered row by row, joints in the order of
the scene, then drives. A frictional joint adds one row behind them, its tangential direction: of a guide that of its
slider (W_T of eq. (8) at the slider's point), of a pin the relative rotation of its bodies. Every row touches at most
two bodies, so that it is stored as two blocks of three coefficients, `J[row, side]`.

A drive with a limit has no constraint row. It is dry friction with a constant bound: a tangential row behind those of
the joints, whose slip is the rate of its coordinate minus that of its law.

The rotation of a pin counts as the slip of a point at the distance `length_scale` from it (`Mechanism.slip_radius`),
and its friction as a force there, so that all slip velocities are in m/s and all frictions in newton. Columns of
trajectories are in rad/s and N m. So are those of a drive of an angle.

The surfaces (+) and (-) need no rows of their own: the angle of the slider in its guide is a constraint row, and the
row of W_T for a surface at lever -+b/2 is the tangential row +- b/2 times that angle row.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property, lru_cache
from math import dist, hypot, pi
from typing import Annotated, Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from stiction.reference_impl.compiled.bundle import (
    Bundle,
    Bundles,
    Integers,
    IntegerTable,
    Reals,
    Table,
)
from stiction.reference_impl.equations_of_motion import start_of
from stiction.reference_impl.friction.solver_names import AUTOMATIC, Counters
from stiction.reference_impl.multibody.baumgarte import PAPERS, coefficients
from stiction.reference_impl.multibody.guide_freedom import guide_freedoms
from stiction.scenes import Problem, Scene, SceneError
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import (
    MOVES,
    Constant,
    Law,
    Linear,
    Piece,
    Sine,
    Sum,
    law_kinks,
    law_switches,
    law_terms,
    pieces,
    spline_slopes,
)
from stiction.scenes.laws import Table as TableLaw
from stiction.scenes.model import (
    Baumgarte,
    Drive,
    Force,
    LinearSpring,
    Revolute,
    Translational,
)

MOST_ROWS = 2000
"""Constraint rows of one part of a scene: a matrix of them has 32 MB, a dense solve takes seconds."""
DENSE = 24
"""Rows, tangential ones included, up to which G is taken as dense: it is hardly slower, and simpler."""
UNLIKE = 1e5
"""Ratio of masses from which G is too rounded: at 1e4 case 1 is wrong by 6e-10 m at rtol 1e-12, at 1e8 by 3e-7 m,
whatever the tolerance."""
REVOLUTE, TRANSLATIONAL, ANGLE, DISTANCE, AXIS = range(5)
NO_GUIDE = -1
"""Place of a frictional guide where there is none."""
NO_ROW = -1
"""Row of the normal force of a drive with a limit, which has none. What kernels read there, the last entry and then the
first, they multiply by coefficients that are zero."""
NO_LAW = -1
"""Number of the law of a joint, which has none."""
LAW_POLYNOMIAL, LAW_SINE, LAW_TABLE, LAW_SPLINE, LAW_PIECES, LAW_SUM = range(6)


def _record(integers: str, numbers: str) -> np.dtype:
    return np.dtype(
        [
            *((name, np.int64) for name in integers.split()),
            *((name, float) for name in numbers.split()),
        ]
    )


CONSTRAINT = _record("kind row a b law friction", "ax ay bx by ux uy offset")
"""Bodies a and b, their points, direction (ux, uy) in the axes of b, offset of the angle, frictional guide or -1. A
drive with a limit has the row NO_ROW, and its number among the frictional ones."""
FRICTION = _record(
    "row corners pair freedom surfaces unit law",
    "length width mu mus bound static_bound kinetic_mu kinetic_bound stribeck shape "
    "own_bound own_static pin_mu pin_mus load",
)
"""A frictional joint, a guide or a pin, or a drive with a limit.

`row`, the first of its two constraint rows: of a guide that of the normal force, and that of the moment follows.
`corners`, the normal forces that have one sign each and that its friction depends on: 2, 1 without length, 0 without a
coefficient of friction. `pair`, the first of their pairs in the HLCP. `freedom`, one of `guide_freedom.GuideFreedom`.
`surfaces`, the directions of friction in the HLCP: the two surfaces of a guide with a coefficient, else 1. `unit`, the
row whose mobility measures its forces: that of the normal force, or without corners its tangential row. `law`, that of
a drive, whose rate the slip is measured from, or NO_LAW. `length` and `width` are 0 where it has none, or no corners.
Its friction is at most bound + mu times the load in slip, static_bound + mus times the load at rest (newton). Where
`stribeck`, the speed of Stribeck's curve of exponent `shape`, is not 0 (m/s), mu and bound are those of the last state
(`speed_dependence`), between the static values and `kinetic_mu` and `kinetic_bound`.

A pin under load has mu = mus = 0 and bounds that depend on the size `load` of the force in it (newton), of the last
state (`pins_under_load`): `own_bound` + `pin_mu` times this load in slip, `own_static` + `pin_mus` times it at rest.
`kinetic_mu` is then that of fast slip for `pin_mu`."""
SPRING = _record("kind a b", "ax ay bx by ux uy stiffness damping rest")
ONE_SIDED = _record("kind a b", "ax ay bx by ux uy stiffness damping rest sign")
"""A spring that acts on one side only; `sign` -1 of one that pushes, 1 of one that pulls (`one_sided`)."""
LOAD = _record("body law", "px py ux uy")
LINE = _record("a b flips", "ax ay bx by")
"""Points of two bodies along whose line a force acts; `flips`, 1 where the points may pass each other and the force has
the other direction behind."""
CELL = _record("first end band first_entry end_entry first_block end_block", "")
"""Places of a cell's rows in `order` (the first and the one behind the last), half the bandwidth, places of its entries
of G and of its blocks."""
LAW = _record("kind", "first second frequency phase")
"""A polynomial is first + second t, a sine first + second sin(frequency t + phase), a table the knots from first to
second, a move the pieces from first to second, a sum the laws from first to second."""
PIECE_BEGIN, PIECE_ORIGIN, PIECE_AMPLITUDE, PIECE_FREQUENCY, PIECE_COEFFICIENTS = range(5)
"""Columns of `Arrays.piece`: see `stiction.scenes.laws.Piece`; the coefficients are the last columns."""


class Arrays(Bundle):
    """The mechanism for the kernels; body -1 is the ground, angles in radians, SI units.

    Without cells (`banded_systems`), in a mechanism of at most `DENSE` rows, what belongs to them is empty. The cells
    of a mechanism of several are in `separate`, each as a mechanism of its own, for what starts from its rows: it has
    neither constraints nor loads. Rows and guides are numbered within the cell, bodies as in the whole.
    """

    rows: int  # constraint rows
    inverse_mass: Reals  # (3 * bodies,)
    weight: Reals
    constraint: Annotated[
        np.ndarray, CONSTRAINT, 1
    ]  # one per joint and drive, in the order of their rows
    friction: Annotated[
        np.ndarray, FRICTION, 1
    ]  # one per frictional joint, drives with a limit last
    spring: Annotated[np.ndarray, SPRING, 1]  # those that act on both sides
    one_sided: Annotated[np.ndarray, ONE_SIDED, 1]
    load: Annotated[np.ndarray, LOAD, 1]  # a torque has the direction (0, 0)
    turning: Integers
    """Bodies whose angle enters forces: one that guides a slider, carries the axis of a spring or a drive, or has a
    joint, a spring, a drive or a load that acts beside its centre of mass. As `line`, it bounds steps (`step_limits`),
    and is for mechanisms with friction or springs that act on one side only."""
    line: Annotated[
        np.ndarray, LINE, 1
    ]  # springs of points with rest length or damping, and drives of a distance
    law: Annotated[np.ndarray, LAW, 1]
    knots: Table  # (n, 3): time, value, second derivative
    piece: Table  # (n, PIECE_COEFFICIENTS + largest number of coefficients): pieces of moves
    block: Annotated[np.ndarray, np.uint64, 2]
    """The three coefficients that a row has for a moving body: place in J, row, 3 * body."""
    pair: Annotated[np.ndarray, np.uint64, 2]
    """Pairs of blocks at the same body: places of the two in J, row and column of their entry of G, on or above the
    diagonal, in the order of entries: the sparsity of G = J M^-1 J^T."""
    smooth: Integers
    """Rows that no corner force replaces, in increasing order: theirs are the first pairs of the HLCP (`hlcp`)."""
    cell: Annotated[np.ndarray, CELL, 1]
    order: Integers  # the rows, tangential ones among them, cell by cell, so that G is a band
    position: Integers  # the place of each row in its cell
    entry: (
        IntegerTable  # (n, 2), row and column of the entries of G that are not zero, cell by cell
    )
    separate: Bundles
    origin: Integers  # the rows of the whole that belong to a cell, in increasing order; nothing in the whole
    baumgarte_2alpha: float
    baumgarte_beta2: float
    length_scale: float
    unfree: int  # frictional joints that no freedom moves (`guide_freedom`)
    loaded: int  # frictional joints whose friction depends on a load: those with corners, and pins under load
    pins: int  # pins whose friction depends on the force in them (`pins_under_load`)
    varying: (
        int  # frictional joints whose bounds depend on the state: these pins, and Stribeck's curves
    )
    unlike: int  # 1 if masses or inertias are unlike by more than `UNLIKE` (`unlike_masses`)


class Workspace(Bundle):
    """Quantities of one instant; `all` rows are the constraint rows and, behind them, the tangential ones."""

    rotation: Table  # (bodies, 2), cosine and sine of the bodies' angles
    J: Reals  # (6 * all,), of each row three coefficients for its body a and three for b
    JM: Reals  # as J, divided by the masses
    phi: Reals  # (rows,), Phi
    phi_dot: Reals  # (rows,), Phi' = J v + dPhi/dt
    gamma: (
        Reals  # (all,), Phi'' = J q'' + gamma; for a tangential row the same of the slip velocity
    )
    slip_speed: Reals  # (frictional,), g_T', m/s
    free: Reals  # (3 * bodies,), M^-1 Q, the acceleration without joints
    G: Table  # (all, all), J M^-1 J^T
    right: Reals  # (all,), G times the row forces for the constraints (and a stuck slider) to hold
    stabilizing: Reals  # (rows,), Baumgarte's terms 2 alpha Phi' + beta^2 Phi, as far as `right` contains them
    held: Annotated[
        np.ndarray, np.uint64, 1
    ]  # scratch for linear solves, as A, x, unit and response
    A: Table
    x: Reals
    unit: Reals
    response: Table
    force: Reals  # (all,), multipliers, then the frictions on the sliders
    event: Reals  # (3 * (frictional + one-sided springs),), event functions of the mode, all >= 0 while it lasts
    acting: Integers  # (one-sided springs,), their states (`one_sided`)
    solver: int  # of contact problems; one of `solver_names.SOLVERS`
    counters: Counters  # work done so far
    separate: Bundles  # those of `Arrays.separate`; bodies, their rows and the counters are shared


def workspace(arrays: Arrays, solver: int = AUTOMATIC) -> Workspace:
    """Return room for the kernels' results."""
    coordinates, size = len(arrays.inverse_mass), arrays.rows + len(arrays.friction)
    whole = Workspace.zeros(
        rotation=(coordinates // 3, 2),
        J=6 * size,
        JM=6 * size,
        phi=arrays.rows,
        phi_dot=arrays.rows,
        gamma=size,
        free=coordinates,
        acting=len(arrays.one_sided),
        solver=solver,
        counters=(),
        separate=(),
        **_room(arrays),
    )
    if not arrays.separate:
        return whole
    cells = tuple(
        whole.replaced(
            **{
                name: np.zeros(shape, getattr(whole, name).dtype)
                for name, shape in _room(cell).items()
            }
        )
        for cell in arrays.separate
    )
    return whole.replaced(separate=cells)


def _room(m: Arrays) -> dict[str, Any]:
    """Return the shapes of what the workspace of a cell does not share with the whole."""
    nf, size = len(m.friction), m.rows + len(m.friction)
    return {
        "slip_speed": nf,
        "G": (size, size),
        "right": size,
        "stabilizing": m.rows,
        "held": size,
        "A": (size, size),
        "x": size,
        "unit": 2 * size,
        "response": (size, nf),
        "force": size,
        "event": 3 * (nf + len(m.one_sided)),
    }


class Mechanism:
    """A scene assembled for the reference implementation.

    Only what the scene declares gets a block: no frictional guide, no complementarity problem; no drive, no
    driving multiplier; no gravity, no weight.

    Parameters
    ----------
    scene : Scene
    stabilization : {"scene", "none", "baumgarte", "projection"}
        What to do against drift; "scene" is what the scene declares, "baumgarte" its own alpha and beta or,
        where it declares none, `baumgarte.PAPERS`.

    Attributes
    ----------
    arrays : Arrays
    body_names, row_names, guide_names : list of str
        Names of bodies, of constraint rows (``pin.fx``, ``guide.normal_force``, ``motor.effort``) and of
        frictional joints, guides and pins, in the order of the arrays. Drives with a limit are among the latter.
    force_names : list of str
        Columns of the row forces: `row_names`, then ``friction`` of the frictional joints and ``effort`` of drives with
        a limit.
    slip_radius : ndarray, shape (frictional,)
        Slip (m) per unit of relative motion of each frictional joint: 1 for a guide, `length_scale` for a pin (m/rad);
        of drives with a limit, 1 for a distance and `length_scale` for an angle.
    force_units : ndarray, shape (rows + frictional,)
        Value of a column of `force_names` per unit of its row force: `slip_radius` for frictions, else 1.
    event_names : list of str
        What has event functions: `guide_names`, then the springs that act on one side only.
    stressed_guides : tuple of str
        Guides whose load depends on a stress that rigid bodies leave open; see `guide_freedom.GuideFreedoms`.
    projection : bool
        Whether states are projected onto the constraints after each step.

    Raises
    ------
    SceneError
        For more than `MOST_ROWS` constraint rows.
    """

    def __init__(self, scene: Scene, stabilization: str = "scene"):
        self.scene = scene
        self.body_names, self.guide_names = list(scene.bodies), list(scene.bounded_elements)
        self.row_names = _row_names(scene)
        self.event_names = [*self.guide_names, *scene.one_sided_springs]
        self.force_names = [
            *self.row_names,
            *(f"{name}.friction" for name in scene.frictional_joints),
            *(f"{name}.effort" for name in scene.limited_drives),
        ]
        self._index = {GROUND: -1, **{name: i for i, name in enumerate(self.body_names)}}
        radius = self._length_scale()
        self.slip_radius = np.array(
            [radius if _turns(element) else 1.0 for element in scene.bounded_elements.values()]
        )
        self.force_units = np.concatenate([np.ones(len(self.row_names)), self.slip_radius])
        laws = {name: element.law for name, element in (scene.drives | scene.forces).items()}
        self._laws = list(laws.values())
        self.law_names = list(laws)
        alpha, beta = self._stabilize(stabilization)
        if len(self.row_names) > MOST_ROWS:
            raise SceneError(
                scene._origin,
                [
                    Problem(
                        "joints, drives",
                        f"{len(self.row_names)} constraint equations",
                        f"expected at most {MOST_ROWS} in one part of a scene",
                    )
                ],
            )
        parts = {**self._masses(), **self._constraints(), **self._springs(), **self._loads()}
        whole = Arrays(separate=(), **coefficients(alpha, beta), **parts, **_what_turns(parts))
        separate = _separate(whole)
        self.arrays = whole.replaced(separate=separate) if separate else whole

    @cached_property
    def workspace(self) -> Workspace:
        """Room for evaluations of single states. An integration has its own, which lasts from step to step."""
        return workspace(self.arrays)

    def of_one_run(self) -> Mechanism:
        """Return the same mechanism for one run, with records of friction of its own if these vary with the state.

        So two runs of a mechanism, one in the middle of the other, do not change the coefficients of each other.
        """
        if not self.arrays.varying:
            return self
        other = copy(self)
        separate = tuple(
            part.replaced(friction=part.friction.copy()) for part in self.arrays.separate
        )
        other.arrays = self.arrays.replaced(friction=self.arrays.friction.copy(), separate=separate)
        other.__dict__.pop("workspace", None)  # it has the cells of the other arrays
        return other

    def stabilized(self, stabilization: str) -> Mechanism:
        """Return the same mechanism with another stabilization; the two share their arrays."""
        other = copy(self)
        terms = coefficients(*other._stabilize(stabilization))
        separate = tuple(part.replaced(**terms) for part in self.arrays.separate)
        other.arrays = self.arrays.replaced(separate=separate, **terms)
        return other

    def _stabilize(self, stabilization: str) -> tuple[float, float]:
        """Set what is done against drift; returns Baumgarte's alpha and beta (1/s), 0 without."""
        alpha, beta, self.projection = _stabilization(self.scene, stabilization)
        self.stabilization = {
            "method": "projection" if self.projection else "baumgarte" if alpha or beta else "none",
            **({"alpha": alpha, "beta": beta} if alpha or beta else {}),
        }
        return alpha, beta

    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates and velocities at t = 0 as the scene has them, (3 * bodies,) each."""
        return start_of(self.scene)

    def kinks(self, t_end: float) -> np.ndarray:
        """Return the times in (0, t_end) at which a law is not smooth, in order.

        See `stiction.scenes.laws.law_kinks`.
        """
        return np.array(
            sorted({time for law in self._laws for time in law_kinks(law, t_end)}), dtype=float
        )

    def switches(self, t_end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return those of the kinks at which laws may change the contact mode, in order, and the law of each.

        A time at which several laws switch is repeated. See `stiction.scenes.laws.law_switches`.
        """
        switches = sorted(
            (time, i) for i, law in enumerate(self._laws) for time in law_switches(law, t_end)
        )
        times = np.array([time for time, _ in switches], dtype=float)
        return times, np.array([i for _, i in switches], dtype=np.int64)

    def fastest_law(self) -> float:
        """Return the largest angular frequency of a law, rad/s; 0 without sine laws and moves."""
        frequencies = [0.0]
        for law in self._laws:
            for term in law_terms(law):
                if isinstance(term, Sine):
                    frequencies.append(abs(term.frequency))
                elif isinstance(term, MOVES):
                    frequencies.append(2.0 * pi / term.duration)
        return max(frequencies)

    def largest_load(self) -> float:
        """Return the largest force of a load with a sine law, N.

        A torque counts by the mechanism's size.
        """
        largest = 0.0
        for load in self.scene.forces.values():
            arm = 1.0 if isinstance(load, Force) else self.arrays.length_scale
            for term in law_terms(load.law):
                if isinstance(term, Sine):
                    largest = max(largest, abs(term.amplitude) / arm)
        return largest

    def _masses(self) -> dict[str, np.ndarray]:
        bodies, (gx, gy) = self.scene.bodies.values(), self.scene.gravity or (0.0, 0.0)
        inertia = [value for body in bodies for value in (body.mass, body.mass, body.inertia)]
        weight = [value for body in bodies for value in (body.mass * gx, body.mass * gy, 0)]
        return {"inverse_mass": 1.0 / np.array(inertia), "weight": np.array(weight, dtype=float)}

    def _constraints(self) -> dict[str, np.ndarray | float]:
        constraints, row, driven = [], 0, 0
        frictions: list[tuple[float, ...]] = []
        found = guide_freedoms(self.scene, self._length_scale())
        freedoms, self.stressed_guides = found.freedom, found.stressed
        for name, element in [*self.scene.joints.items(), *self.scene.drives.items()]:
            direction, offset, law, guide, rows = (1.0, 0.0), 0.0, -1, NO_GUIDE, 2
            if isinstance(element, Revolute):
                kind, points = REVOLUTE, element.points
            elif isinstance(element, Drive):
                kind = (
                    ANGLE if element.type == "angle" else DISTANCE if element.axis is None else AXIS
                )
                points, direction, law, rows = element.points, element.axis or direction, driven, 1
                driven += 1
                if element.is_limited:
                    guide, rows = len(frictions), 0
                    frictions.append(self._limit(element, law, freedoms[name]))
            else:
                kind, points = TRANSLATIONAL, (element.slider_point, element.point)
                direction, offset = element.direction, element.angle
            if not isinstance(element, Drive) and element.frictional:
                guide = len(frictions)
                frictions.append(self._friction(name, element, row, freedoms[name]))
            constraints.append(
                (
                    kind,
                    row if rows else NO_ROW,
                    *(self._index[body] for body in element.bodies),
                    law,
                    guide,
                    *points[0],
                    *points[1],
                    *_unit(direction),
                    offset,
                )
            )
            row += rows
        constraint, friction = (
            np.array(constraints, dtype=CONSTRAINT),
            np.array(frictions, dtype=FRICTION),
        )
        tangential = row + np.arange(len(friction))
        friction["unit"] = np.where(friction["corners"] > 0, friction["row"], tangential)
        joints = tuple(
            [(kind, first, a, b, guide) for kind, first, a, b, _, guide, *_ in constraints]
        )
        block, pair = _blocks(row, joints)
        size = row + len(friction)
        cell, order, position, entry, block = (
            _cells(size, block, pair) if size > DENSE else (*_NO_CELLS, block)
        )
        return {
            "rows": row,
            "constraint": constraint,
            "friction": friction,
            "block": block,
            "pair": pair,
            "smooth": _hlcp_pairs(row, friction),
            "cell": cell,
            "order": order,
            "position": position,
            "entry": entry,
            "origin": np.zeros(0, dtype=np.int64),
            "length_scale": self._length_scale(),
            **_counts_of_friction(friction),
            "unlike": int(self.largest_ratio_of_masses() > UNLIKE),
        }

    def _friction(
        self, name: str, joint: Revolute | Translational, row: int, freedom: int
    ) -> tuple[float, ...]:
        """Return the entry of a frictional joint in `Arrays.friction`, whose `pair` and `unit` are set later."""
        corners, length, width, mu, mus = 0, 0.0, 0.0, 0.0, 0.0
        if isinstance(joint, Translational) and joint.mu is not None:
            corners = 2 if joint.length else 1
            length, width = joint.extent
            mu, mus = joint.kinetic_coefficient, joint.static_coefficient
        # the bounds of a pin are torques: its friction counts as a force at the radius of its slip
        radius = self._length_scale() if isinstance(joint, Revolute) else 1.0
        pin_mu, pin_mus = 0.0, 0.0
        if isinstance(joint, Revolute):
            pin_mu, pin_mus = (value / radius for value in joint.friction_radii)
        bound, static_bound = (value / radius for value in joint.bounds)
        surfaces = 2 if corners else 1
        stribeck, shape = 0.0, joint.stribeck_shape
        if joint.depends_on_speed and joint.stribeck_velocity is not None:
            stribeck = joint.stribeck_velocity * radius
        law = (mu, mus, bound, static_bound, mu or pin_mu, bound, stribeck, shape)
        by_load = (bound, static_bound, pin_mu, pin_mus, 0.0)
        return (row, corners, 0, freedom, surfaces, 0, NO_LAW, length, width, *law, *by_load)

    def _limit(self, drive: Drive, law: int, freedom: int) -> tuple[float, ...]:
        """Return the entry of a drive with a limit in `Arrays.friction`, of the law of this number."""
        radius = self._length_scale() if _turns(drive) else 1.0
        bound, static_bound = (value / radius for value in drive.bounds)
        friction = (0.0, 0.0, bound, static_bound, 0.0, bound, 0.0, 1.0)
        by_load = (bound, static_bound, 0.0, 0.0, 0.0)
        return (NO_ROW, 0, 0, freedom, 1, 0, law, 0.0, 0.0, *friction, *by_load)

    def _springs(self) -> dict[str, np.ndarray]:
        springs: list[tuple[float, ...]] = []
        one_sided: list[tuple[float, ...]] = []
        for spring in self.scene.springs_and_dampers.values():
            bodies = [self._index[body] for body in spring.bodies]
            if isinstance(spring, LinearSpring):
                kind, axis = (DISTANCE, (1.0, 0.0)) if spring.axis is None else (AXIS, spring.axis)
                springs.append(
                    (
                        kind,
                        *bodies,
                        *spring.points[0],
                        *spring.points[1],
                        *_unit(axis),
                        spring.stiffness,
                        spring.damping,
                        spring.rest_length,
                    )
                )
            else:
                springs.append(
                    (
                        ANGLE,
                        *bodies,
                        0,
                        0,
                        0,
                        0,
                        1,
                        0,
                        spring.stiffness,
                        spring.damping,
                        spring.rest_angle,
                    )
                )
            if spring.acts is not None:
                one_sided.append((*springs.pop(), spring.side))
        return {
            "spring": np.array(springs, dtype=SPRING),
            "one_sided": np.array(one_sided, dtype=ONE_SIDED),
        }

    def _loads(self) -> dict[str, np.ndarray]:
        """Return the loads, and the laws, those of drives first."""
        loads = [
            (
                self._index[load.body],
                law,
                *(
                    (*load.point, *_unit(load.direction))
                    if isinstance(load, Force)
                    else (0, 0, 0, 0)
                ),
            )
            for law, load in enumerate(self.scene.forces.values(), len(self.scene.drives))
        ]
        return {"load": np.array(loads, dtype=LOAD), **_law_arrays(self._laws)}

    def largest_ratio_of_masses(self) -> float:
        """Return the largest ratio of masses that guides, pins and levers couple.

        Levers couple masses and inertias; without one a guide couples masses with masses, inertias with inertias. Where
        a mechanism stands does not matter.
        """
        bodies, lever = self.scene.bodies.values(), self._largest_lever()
        masses, inertias = [body.mass for body in bodies], [body.inertia for body in bodies]
        coupled = (
            [[*masses, *(inertia / lever**2 for inertia in inertias)]]
            if lever
            else [masses, inertias]
        )
        return max(max(values) / min(values) for values in coupled)

    def _largest_lever(self) -> float:
        """Return the largest lever of joint forces about the centres of mass, m.

        Points of pins, sizes of sliders, and how far sliders are from the bodies that guide them at the start.
        """
        scene = self.scene
        lengths = [
            hypot(*point)
            for joint in scene.joints.values()
            if isinstance(joint, Revolute)
            for body, point in zip(joint.bodies, joint.points)
            if body in scene.bodies
        ]
        for guide in scene.guides.values():
            lengths += [guide.length or 0.0, guide.width or 0.0]
            if guide.guide in scene.bodies:
                lengths.append(
                    dist(scene.bodies[guide.slider].position, scene.bodies[guide.guide].position)
                )
        return max(lengths, default=0.0)

    def _length_scale(self) -> float:
        """Return a length of the mechanism, m: the largest extent of what is declared.

        Points, positions, sliders and springs count.
        """
        scene = self.scene
        lengths = [
            abs(x)
            for joint in scene.joints.values()
            if isinstance(joint, Revolute)
            for point in joint.points
            for x in point
        ]
        lengths += [
            x for guide in scene.guides.values() for x in (guide.length or 0.0, guide.width or 0.0)
        ]
        lengths += [abs(x) for body in scene.bodies.values() for x in body.position]
        return max(lengths, default=0.0) or 1.0


def _law_arrays(laws: Sequence[Law]) -> dict[str, np.ndarray]:
    """Return `Arrays.law`, `knots` and `piece` of laws; the terms of sums follow all laws of the mechanism."""
    records: list[tuple[float, ...]] = []
    knots: list[tuple[float, ...]] = []
    rows: list[Piece] = []
    queue = list(laws)
    for law in queue:
        if isinstance(law, Constant):
            records.append((LAW_POLYNOMIAL, law.value, 0, 0, 0))
        elif isinstance(law, Linear):
            records.append((LAW_POLYNOMIAL, law.offset, law.rate, 0, 0))
        elif isinstance(law, Sine):
            records.append((LAW_SINE, law.offset, law.amplitude, law.frequency, law.phase))
        elif isinstance(law, TableLaw):
            t, y = np.array(law.times), np.array(law.values)
            cubic = law.interpolation == "cubic"
            second = spline_slopes(law.times, law.values, law.ends) if cubic else np.zeros(len(t))
            kind = LAW_SPLINE if cubic else LAW_TABLE
            records.append((kind, len(knots), len(knots) + len(t), 0, 0))
            knots += zip(t, y, second)
        elif isinstance(law, Sum):
            records.append((LAW_SUM, len(queue), len(queue) + len(law.terms), 0, 0))
            queue += law.terms
        else:
            rows += pieces(law)
            first = len(rows) - len(pieces(law))
            records.append((LAW_PIECES, first, len(rows), 0, 0))

    widest = max((len(row.coefficients) for row in rows), default=0)
    piece = np.zeros((len(rows), PIECE_COEFFICIENTS + widest))
    for i, row in enumerate(rows):
        piece[i, :PIECE_COEFFICIENTS] = row.begin, row.origin, row.amplitude, row.frequency
        piece[i, PIECE_COEFFICIENTS : PIECE_COEFFICIENTS + len(row.coefficients)] = row.coefficients
    return {
        "law": np.array(records, dtype=LAW),
        "knots": np.array(knots, dtype=float).reshape(-1, 3),
        "piece": piece,
    }


def _what_turns(m: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return `Arrays.turning` and `Arrays.line`, from the other fields `m` of the arrays."""
    if not len(m["friction"]) and not len(m["one_sided"]):
        return {"turning": np.zeros(0, dtype=np.int64), "line": np.zeros(0, dtype=LINE)}
    bodies: set[int] = set()
    lines: list[tuple[float, ...]] = []
    for element in [*m["constraint"], *m["spring"], *m["one_sided"]]:
        kind, a, b = int(element["kind"]), int(element["a"]), int(element["b"])
        if kind == ANGLE:
            continue  # two angles, whose difference is the same for all directions
        points = [float(element[name]) for name in ("ax", "ay", "bx", "by")]
        if any(points[:2]):
            bodies.add(a)
        if any(points[2:]) or kind in (TRANSLATIONAL, AXIS):
            bodies.add(b)  # the axis, or the line of the guide, is fixed in b
        if kind == DISTANCE:
            is_spring = element.dtype in (SPRING, ONE_SIDED)
            rest, damping = (
                float(element[name]) if is_spring else 0.0 for name in ("rest", "damping")
            )
            if not is_spring or rest or damping:
                lines.append((a, b, 1 if rest else 0, *points))
    for load in m["load"]:
        if load["px"] or load["py"]:
            bodies.add(int(load["body"]))
    return {
        "turning": np.array(sorted(bodies - {-1}), dtype=np.int64),
        "line": np.array(lines, dtype=LINE),
    }


def _turns(element: Revolute | Translational | Drive) -> bool:
    """Return True if the slip of an element is an angle: that of a pin, and of a drive of an angle."""
    return isinstance(element, Revolute) or element.type == "angle"


def _counts_of_friction(friction: np.ndarray) -> dict[str, int]:
    """Return the numbers of frictional joints of several kinds, fields of `Arrays`."""
    under_load = friction["pin_mus"] > 0.0
    return {
        "unfree": int(np.count_nonzero(friction["freedom"])),
        "loaded": int(np.count_nonzero((friction["corners"] > 0) | under_load)),
        "pins": int(np.count_nonzero(under_load)),
        "varying": int(np.count_nonzero((friction["stribeck"] > 0.0) | under_load)),
    }


def _row_names(scene: Scene) -> list[str]:
    named = [
        (name, ("fx", "fy") if isinstance(joint, Revolute) else ("normal_force", "moment"))
        for name, joint in scene.joints.items()
    ]
    return [
        f"{name}.{row}"
        for name, rows in [*named, *((name, ("effort",)) for name in scene.prescribed_drives)]
        for row in rows
    ]


@lru_cache(maxsize=8)
def _blocks(
    rows: int, joints: tuple[tuple[int, int, int, int, int], ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Blocks of the rows, tangential rows included, and their pairs; `joints`: kind, row, bodies and frictional guide.

    Mechanisms that differ in numbers alone share them; nothing writes into them.
    """
    blocks: list[tuple[int, int, int]] = []
    for kind, first, a, b, friction in joints:
        own = [first + i for i in range(2 if kind in (REVOLUTE, TRANSLATIONAL) else 1)]
        if first == NO_ROW:
            own = []
        if friction >= 0:
            own.append(rows + friction)
        blocks += [
            (6 * row + 3 * side, row, 3 * body)
            for row in own
            for side, body in enumerate((a, b))
            if body >= 0
        ]
    at_body: dict[int, list[tuple[int, int]]] = {}
    for place, row, body in blocks:
        at_body.setdefault(body, []).append((place, row))
    pairs = [
        (p, o, r, c) for group in at_body.values() for p, r in group for o, c in group if c >= r
    ]
    return (
        np.array(sorted(blocks), dtype=np.uint64).reshape(-1, 3),
        np.array(sorted(pairs, key=lambda pair: (pair[2:], pair)), dtype=np.uint64).reshape(-1, 4),
    )


def _hlcp_pairs(rows: int, friction: np.ndarray) -> np.ndarray:
    """Return `Arrays.smooth`, and put the place of its first pair into each frictional guide."""
    replaced = {
        row + corner
        for row, corners in zip(friction["row"].tolist(), friction["corners"].tolist())
        for corner in range(corners)
    }
    smooth = np.array([row for row in range(rows) if row not in replaced], dtype=np.int64)
    friction["pair"] = len(smooth) + np.cumsum(friction["corners"]) - friction["corners"]
    return smooth


_NO_CELLS = (
    np.zeros(0, CELL),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 2), np.int64),
)
"""`Arrays.cell`, `order`, `position`, `entry` of a mechanism of few rows."""


def _cells(size: int, block: np.ndarray, pair: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return `Arrays.cell`, `order`, `position`, `entry`, and the blocks sorted by cell."""
    entry = np.unique(np.vstack([pair[:, 2:], pair[:, :1:-1]]), axis=0).astype(np.int64)
    graph = csr_array((np.ones(len(entry)), (entry[:, 0], entry[:, 1])), shape=(size, size))
    count, label = connected_components(graph, directed=False)
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    order = order[np.argsort(label[order], kind="stable")]
    entry = entry[np.argsort(label[entry[:, 0]], kind="stable")]
    block = block[np.argsort(label[block[:, 1]], kind="stable")]
    cell = np.zeros(count, dtype=CELL)
    for (first, end), rows in (
        (("first", "end"), order),
        (("first_entry", "end_entry"), entry[:, 0]),
        (("first_block", "end_block"), block[:, 1]),
    ):
        bounds = np.searchsorted(label[rows], np.arange(count + 1))
        cell[first], cell[end] = bounds[:-1], bounds[1:]
    position = np.empty(size, dtype=np.int64)
    position[order] = np.arange(size) - cell["first"][label[order]]
    np.maximum.at(
        cell["band"], label[entry[:, 0]], np.abs(position[entry[:, 0]] - position[entry[:, 1]])
    )
    return cell, order, position, entry, block


def _separate(m: Arrays) -> tuple[Arrays, ...]:
    """Return `Arrays.separate`."""
    if len(m.cell) < 2:
        return ()
    local, found = np.empty(m.rows + len(m.friction), dtype=np.int64), []
    for cell in m.cell:
        order = m.order[cell["first"] : cell["end"]]
        rows = np.sort(order)
        local[rows] = np.arange(len(rows))
        friction = m.friction[rows[rows >= m.rows] - m.rows]
        friction["row"] = np.where(friction["row"] == NO_ROW, NO_ROW, local[friction["row"]])
        friction["unit"] = local[friction["unit"]]
        block = m.block[cell["first_block"] : cell["end_block"]].copy()
        block[:, 1] = local[block[:, 1].astype(np.int64)]
        entry = local[m.entry[cell["first_entry"] : cell["end_entry"]]]
        own = np.array([(0, len(rows), cell["band"], 0, len(entry), 0, len(block))], dtype=CELL)
        bands = (own, local[order], m.position[rows], entry) if len(rows) > DENSE else _NO_CELLS
        count = len(rows) - len(friction)
        found.append(
            m.replaced(
                rows=count,
                constraint=m.constraint[:0],
                friction=friction,
                spring=m.spring[:0],
                one_sided=m.one_sided[:0],
                load=m.load[:0],
                law=m.law[:0],
                knots=m.knots[:0],
                piece=m.piece[:0],
                **_counts_of_friction(friction),
                block=block,
                pair=m.pair[:0],
                smooth=_hlcp_pairs(count, friction),
                origin=rows,
                **dict(zip(("cell", "order", "position", "entry"), bands)),
            )
        )
    return tuple(found)


def _stabilization(scene: Scene, choice: str) -> tuple[float, float, bool]:
    declared = scene.stabilization
    method = declared.method if choice == "scene" else choice
    if method not in ("none", "baumgarte", "projection"):
        raise ValueError(
            f"stabilization: found {choice!r}; expected 'scene', 'none', 'baumgarte' or 'projection'"
        )
    if method == "baumgarte":
        return *(
            (declared.alpha, declared.beta) if isinstance(declared, Baumgarte) else PAPERS
        ), False
    return 0.0, 0.0, method == "projection"


def _unit(direction: tuple[float, float]) -> tuple[float, float]:
    length = float(np.hypot(*direction))
    return direction[0] / length, direction[1] / length
