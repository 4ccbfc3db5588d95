"""pymunk (Chipmunk2D): impulses on velocities, symplectic Euler, projected Gauss-Seidel.

A step from t to t + h moves first and forces then:  q(t+h) = q(t) + h v(t),  v(t+h) = v(t) + h a,
where a balances loads and reactions at q(t+h), t + h. So loads are evaluated there, and a sample
at t holds the acceleration of the step that ended at t; that at 0 holds the first one's.
Velocities that lead q(t+h) back onto the constraints are those of t + h/2, not of t: runs start
from such ones, but those of smooth boxes; see `between_steps`.

Joint fidelity. Revolute joint: `PivotJoint`. Translational joint of bodies that cannot turn:
`GrooveJoint` along the guide, and infinite moment of inertia. Of bodies that turn: a `GearJoint`
of ratio 1 for the angle, and a `PinJoint` across the guide whose far end goes along with the
slider. Angle drive: `SimpleMotor`, at constant rate left alone, otherwise with the rate that ends
each step on the law. Distance drive: `PinJoint` whose distance follows the law, along an axis a
`GrooveJoint` or `PinJoint` across it, as for guides, whose place does. Friction: the same across
the guide, so that only its force along the guide acts, without position correction and with
`max_force` at the bound. Friction in a pin: `SimpleMotor` of rate zero between its bodies, with
`max_force` at the bound.

A `GrooveJoint` must not be used where one of its bodies can turn. It multiplies the relative
velocity of its points by the inverse of their 2 x 2 mass matrix K and keeps the component n of
this impulse across the groove (Chipmunk2D, cpGrooveJoint.c, `applyImpulse`). That ends at n K^-1 v
= 0, not at n v = 0: where K is no multiple of the unit matrix, which is where the point is off a
body's centre of mass both along and across the groove, a slider that moves leaves its guide. A
`PinJoint` has one row, with the mass of that row.

Contact fidelity. The slider is a box of the guide's length and width, less `clearance`, between two segments. Without
clearance the box touches both from the start, and the impulses with which its contacts begin each step keep it pressed
between them: a box of length a and width b that slides from the start has 1 + 2 mu b/a times its friction, at any step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.joint_effects import EFFECTS_OF_GAPS, LAWS
from stiction.engines.protocol import check_version, installed_version
from stiction.engines.pymunk.correction import (
    Iteration,
    bias_of_share,
    constraint_rows,
    share_of_bias,
)
from stiction.engines.shared.contact_geometry import (
    contact_refusal,
    crowded,
    narrowing,
    slider_box,
    surface_distance,
    unlike_guides,
)
from stiction.engines.shared.fixed_step import Defaults, Sample, SteppedEngine, Stepper
from stiction.engines.shared.friction_bound import CoefficientSwitch, FrictionBound
from stiction.engines.shared.step_kernels import (
    SpaceContacts,
    SpaceStep,
    assemble,
    begin_space,
    finish_space,
    finish_space_contacts,
)
from stiction.reference_impl.compiled.kernel import bound
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, evaluate_law
from stiction.scenes.model import Drive

if TYPE_CHECKING:
    from pymunk import Body, Constraint, Vec2d
    from pymunk.batch import Buffer

MOST_GUIDES = 32
"""Largest number of guides at contact fidelity. Sliders touch their own guides only, by a bit of `ShapeFilter` each,
and these are the bits of an unsigned int."""
_GROOVE = 1e4
"""Half the length of a guide in metres: grooves end, guides do not. Rounding along it stays below 1e-11 m."""
AT_REST = 1e-9
"""A slip speed at the start up to this part of the mechanism's size per second, or of the largest speed, counts as
rest: the accuracy to which scene files fulfil their constraints."""
_ROD = 1.0
"""Length of a `PinJoint` that replaces a line, as a multiple of the mechanism's size. Any length will do that is far
above position errors and whose rounding is far below them."""
_SPARE = 2
"""Unused places at the end of a buffer whose memory is ours. If it is full, the library reallocates it with its own
allocator."""
_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {"iterations": 50, "passes": 2, "error_bias": 0.0},
    Fidelity.CONTACT: {
        "iterations": 100,
        "error_bias": 0.0,
        "collision_slop": 1e-5,
        "collision_bias": 0.9**60,
        "clearance": 1e-7,
    },
}
_TRIAL_ITERATIONS = 1000
_TRIAL = {"passes": 20, "error_bias": 0.0}
"""Settings of the one trial step before a run. It starts without impulses and bounds of friction from a step before,
and has to find them to rounding."""


class PymunkEngine(SteppedEngine):
    """Adapter of pymunk; the module describes how each element of a scene is modelled.

    Settings at joint fidelity: `iterations` of the solver per step; `passes`, repetitions of a step in which sticking
    is undecided; `error_bias`, the fraction of a joint's position error that remains after one second, as in
    Chipmunk. With the value 0, each step corrects as much as the iterations allow, which is the whole error for
    similar masses; see `stiction.engines.pymunk.correction`.

    Settings at contact fidelity: `iterations`; `error_bias`, where 0 means that each step corrects the whole error;
    `collision_slop`, the overlap that is not corrected, in m; `collision_bias`, as `error_bias`, for overlap;
    `clearance`, the guide's width minus that of the box, in m, of guides that declare no clearance.
    """

    name, defaults, reach = "pymunk", _SETTINGS, dict.fromkeys(Fidelity, _GROOVE)
    capabilities = replace(
        SteppedEngine.capabilities,
        joint_effects={
            **SteppedEngine.capabilities.joint_effects,
            Fidelity.CONTACT: LAWS | EFFECTS_OF_GAPS,
        },
    )

    @property
    def version(self) -> str:
        import pymunk  # noqa: F401 - an installation that cannot be imported has no version

        # the distribution's version: the module of the wheel 7.0.0 reports 2.0.0
        return check_version("pymunk", installed_version("pymunk"))

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if fidelity == Fidelity.CONTACT and (
            reason := contact_refusal(scene)
            or crowded(scene, MOST_GUIDES, "pymunk")
            or unlike_guides(scene)
        ):
            return reason
        fixed = non_turning(scene) if fidelity == Fidelity.JOINT else {GROUND}
        for name, drive in scene.drives.items():
            if drive.type == "angle" and fixed.issuperset(drive.bodies):
                return f"drives.{name}: neither of its bodies can turn, their guides hold the angle that it drives"
        for name, pin in scene.pins.items():
            if pin.frictional and fixed.issuperset(pin.bodies):
                return f"joints.{name}: has friction, and neither of its bodies can turn: their guides hold its angle"
        return None

    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> AbstractContextManager[Stepper]:
        return nullcontext(
            (_JointStepper if fidelity == Fidelity.JOINT else _ContactStepper)(assembly, h, options)
        )


def non_turning(scene: Scene) -> set[str]:
    """Return the ground and the bodies that guides keep at a constant angle to it."""
    # A guide holds the angle between its two bodies, so what is connected to the ground by guides
    # cannot turn. Follow the guides outwards until no body is added.
    fixed = {GROUND}
    guides = [set(guide.bodies) for guide in scene.guides.values()]
    while True:
        reached = {name for bodies in guides if fixed & bodies for name in bodies}
        if reached <= fixed:
            return fixed
        fixed |= reached


class _Line(NamedTuple):
    """A line of a body, with the unit vector `normal` across it, in the body's axes.

    Its distance (m) from the point `origin` at a time (s) is `level`, or zero. A line without an origin passes through
    the point that is held on it wherever that point is, so that only velocities are held.
    """

    normal: Vec2d
    origin: Vec2d | None = None
    level: Callable[[float], float] | None = None

    def distance(self, place: Vec2d, t: float) -> float:
        """Return the distance (m) of a place from the line, along the normal."""
        if self.origin is None:
            return 0.0
        return (place - self.origin).dot(self.normal) - (self.level(t) if self.level else 0.0)


class _PymunkStepper(Stepper):
    """A scene as pymunk bodies, pins, motors and loads; subclasses add guides and friction."""

    capped: ClassVar[bool]
    friction: FrictionBound | CoefficientSwitch

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], fixed: set[str]):
        import pymunk

        super().__init__(h)
        scene = assembly.scene
        self._assembly, self._fixed = assembly, fixed
        self._space = space = pymunk.Space()
        space.iterations = options["iterations"]
        if scene.gravity is not None:
            space.gravity = scene.gravity
        # A body that cannot turn has an infinite moment of inertia instead of a joint for its angle.
        named = {GROUND: space.static_body}
        for name, data in scene.bodies.items():
            body = pymunk.Body(data.mass, math.inf if name in fixed else data.inertia)
            body.position, body.angle = data.position, data.angle
            body.velocity, body.angular_velocity = data.velocity, data.angular_velocity
            space.add(body)
            named[name] = body
        # At contact fidelity friction is the engine's, and boxes land in the first two steps.
        self.bound = FrictionBound(assembly.whole, options.get("passes", 1), self.capped)
        self.balanced = bool(len(self.bound.held))
        self.settling = 1 if self.capped else 2
        self._rod = _ROD * self.bound.balance.m.length_scale
        self._iterations, self._bias = options["iterations"], options["error_bias"]
        self._targets: list[Callable[[float], None]] = []
        for pin in scene.pins.values():
            first, second = (named[name] for name in pin.bodies)
            self._space.add(pymunk.PivotJoint(first, second, *pin.points))
        for drive in scene.drives.values():
            self._drive(drive, *(named[name] for name in drive.bodies))
        self._named = named
        self._loaded = bool(scene.springs_and_dampers or scene.forces)
        self._share_states([named[name].id for name in scene.bodies])

    def _share_states(self, bodies: Sequence[int]) -> None:
        """Set up arrays for the states of the space's bodies, which are read and written in one call each.

        `data` contains the state as last fetched; its `before` is what `retreat` writes, its `pushed` are the loads.
        """
        from pymunk import batch

        fields, count, space = batch.BodyFields, len(bodies), self._space
        self._get, self._set = batch.get_space_bodies, batch.set_space_bodies
        self._motion = fields.POSITION | fields.ANGLE | fields.VELOCITY | fields.ANGULAR_VELOCITY
        self._force = fields.FORCE | fields.TORQUE
        # The arrays have no names of bodies, so their order has to be that of the scene.
        order = batch.Buffer()
        batch.get_space_bodies(space, fields.BODY_ID, order)
        expected = [*bodies, space.static_body.id]
        listed = list(memoryview(order.int_buf()).cast("P"))
        if listed != expected:
            raise RuntimeError(
                f"pymunk lists the bodies {listed}; expected {expected}, as they were added and the "
                "static one last"
            )
        # The library's buffers use memory of NumPy arrays, which the kernels read and write without
        # copies. They have a row for each body, and one for the static body at the end.
        self._present, present, _ = _buffer(6 * (count + 1))
        self._before, before, _ = _buffer(6 * (count + 1))
        self._pushed, pushed, _ = _buffer(3 * (count + 1))
        q, v, a = np.zeros((3, 3 * count))
        self.data = SpaceStep(
            cap=self.bound.data,
            h=self.h,
            ahead=self.h,  # the library moves the bodies first, and then balances forces
            loaded=int(self._loaded),
            pushed=pushed[: 3 * count],
            q=q,
            v=v,
            a=a,
            present=present[: 6 * count].reshape(count, 6),
            before=before[: 6 * count].reshape(count, 6),
        )
        self._fetch()

    def _fetch(self) -> None:
        """Read the present state of the space into `data`."""
        self._present.clear()  # the library appends
        self._get(self._space, self._motion, self._present)

    def retreat(self) -> None:
        """Write the state before the step to the space; `data.present` is unchanged until it is fetched."""
        self._set(self._space, self._motion, self._before)

    def _on_lines(
        self, base: Body, slider: Body, own: tuple[float, float], *lines: _Line
    ) -> Sequence[Constraint]:
        """Return constraints that hold a slider's point `own` on lines of a base, one for each.

        They are grooves where neither body can turn, else rods; see the module.
        """
        import pymunk

        if math.isinf(base.moment) and math.isinf(slider.moment):
            return [self._groove(base, slider, own, line) for line in lines]
        rods = [pymunk.PinJoint(base, slider, (0.0, 0.0), own) for _ in lines]
        for rod in rods:
            rod.distance = self._rod

        def go_along(t: float) -> None:
            """Move the far ends of the rods with the slider, across the lines at its place at time t."""
            # The engine moves the bodies first and then solves for impulses, so the rods are placed
            # for the positions to which the present velocities lead.
            angle = slider.angle + slider.angular_velocity * self.h
            point = slider.position + slider.velocity * self.h + pymunk.Vec2d(*own).rotated(angle)
            origin = base.position + base.velocity * self.h
            place = (point - origin).rotated(-base.angle - base.angular_velocity * self.h)
            for rod, line in zip(rods, lines):
                # The far end is a rod's length from the line, so the distance of both ends differs
                # from the length of the rod by the distance of the point from the line: this is the
                # position error that the engine corrects.
                rod.anchor_a = place - (self._rod + line.distance(place, t)) * line.normal

        self._targets.append(go_along)
        return rods

    def _groove(
        self, base: Body, slider: Body, own: tuple[float, float], line: _Line
    ) -> Constraint:
        import pymunk

        along, start = _GROOVE * line.normal.perpendicular(), line.origin
        # Bodies with grooves do not turn, so that a line through a moving point is one line.
        if start is None:
            start = base.world_to_local(slider.local_to_world(own))
        groove = pymunk.GrooveJoint(base, slider, start - along, start + along, own)
        if (level := line.level) is not None:

            def shift(t: float) -> None:
                place = start + level(t) * line.normal
                groove.groove_a, groove.groove_b = place - along, place + along

            self._targets.append(shift)
        return groove

    def _drive(self, drive: Drive, first: Body, second: Body) -> None:
        import pymunk
        from pymunk import Vec2d

        law, follow, h = drive.law, self._targets.append, self.h

        def aim(t: float) -> float:
            """Return the value that a step to time t has to aim at.

            A step corrects only a share of the distance to its aim. The aim is so far ahead that this share is the
            whole change of the law in the step, besides the same share of the error at t - h.
            """
            behind = evaluate_law(law, t - h)[0]
            return behind + (evaluate_law(law, t)[0] - behind) / self._share

        if drive.type == "angle":
            motor = pymunk.SimpleMotor(first, second, evaluate_law(law, 0.0)[1])
            self._space.add(motor)

            def turn(t: float) -> None:
                angle = (
                    first.angle
                    - second.angle
                    + self.h * (first.angular_velocity - second.angular_velocity)
                )
                motor.rate = self._share * (aim(t) - angle) / self.h

            if not isinstance(law, (Constant, Linear)):
                follow(turn)
        elif drive.axis is None:
            rod = pymunk.PinJoint(first, second, *drive.points)
            self._space.add(rod)

            def stretch(t: float) -> None:
                rod.distance = aim(t)

            follow(stretch)
        else:
            axis = Vec2d(*drive.axis).normalized()
            line = _Line(axis, Vec2d(*drive.points[1]), aim)
            self._space.add(*self._on_lines(second, first, drive.points[0], line))

    def compile(self) -> None:
        start, data, balance = self.bound.initial, self.data, self.bound.balance
        scene = self._assembly.scene
        # How much of a position error a step may correct depends on how fast the iterations
        # converge in this mechanism. At contact fidelity sliders are held by contacts, with a bias
        # of their own, and all of an error in pins is corrected.
        assemble(balance, 0.0, *start, 0.0)
        iteration = Iteration(scene, balance, self._fixed)
        share = iteration.share(self._iterations) if self.capped else 1.0
        bias = self._bias or bias_of_share(share, self.h)
        *between, guides = between_steps(
            self._assembly, self.h, bias, iteration.needed(_TRIAL_ITERATIONS)
        )
        self.bound.data.guides[:] = guides[: len(self.bound.data.guides)]
        self.correct(bias)
        # Iterations begin with the impulses of the step before, which the first step does not have.
        # It gets as many iterations as it takes without them.
        if self.capped:
            self._space.iterations = iteration.needed(self._iterations)
        # Frictionless boxes, which have not landed yet, gain nothing by a start between steps.
        is_ahead = self.capped or bool(scene.frictional_guides)
        self.begin(*(between if is_ahead else start))
        data.q[:], data.v[:] = start  # of the first sample, which is at t = 0

    def correct(self, error_bias: float) -> None:
        """Set the part of their position error that joints leave after a second."""
        self._share = share_of_bias(error_bias, self.h)
        for constraint in self._space.constraints:
            constraint.error_bias = error_bias

    def begin(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin the first step, at these coordinates and velocities."""
        self.data.before[:] = np.hstack((q.reshape(-1, 3), v.reshape(-1, 3)))
        self.retreat()
        self._fetch()
        begin_space(self.data, self.h)
        self.finish = bound(finish_space, self.data)

    def aim(self) -> None:
        if self.k == 1:  # the first step had iterations of its own
            self._space.iterations = self._iterations
        for target in self._targets:  # the position that follows the step
            target((self.k + 1) * self.h + self.h)

    def sample(self) -> Sample:
        data = self.data
        return Sample(
            data.q.copy(),
            data.v.copy(),
            data.a.copy(),
            self.friction.modes(),
            self.friction.frictions(),
        )

    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass of the engine under the loads, and fetch the state."""
        if self._loaded:
            # the space sets forces to zero in each step
            self._set(self._space, self._force, self._pushed)
        self.clock.call(self._space.step, self.h)
        self._fetch()


class _JointStepper(_PymunkStepper):
    """Guides as grooves, friction as capped grooves across them, or as capped motors of pins."""

    capped = True

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        import pymunk

        fixed = non_turning(assembly.scene)
        super().__init__(assembly, h, options, fixed)
        scene = assembly.scene
        rows: dict[str, Constraint] = {}
        for name, guide in scene.guides.items():
            slider, base = self._named[guide.slider], self._named[guide.guide]
            along = pymunk.Vec2d(*guide.direction).normalized()
            held = _Line(along.perpendicular(), pymunk.Vec2d(*guide.point))
            rubbing = [_Line(along)] if guide.frictional else []
            joint, *friction = self._on_lines(base, slider, guide.slider_point, held, *rubbing)
            self._space.add(joint)
            if guide.slider not in fixed:
                self._space.add(pymunk.GearJoint(base, slider, guide.angle, 1.0))
            if friction:
                (rows[name],) = friction
        for name, pin in scene.pins.items():
            if pin.frictional:
                first, second = (self._named[body] for body in pin.bodies)
                rows[name] = pymunk.SimpleMotor(first, second, 0.0)
        self._rubbing = [rows[name] for name in scene.frictional_joints]
        # Gauss-Seidel visits constraints in the order in which they were added. Friction is last, so
        # that no other constraint changes the slip after it. It corrects no position error.
        for row in self._rubbing:
            row.max_bias = 0.0
            self._space.add(row)
        self.friction = self.bound

    def advance(self, caps: Sequence[float]) -> None:
        for row, cap in zip(self._rubbing, caps):
            row.max_force = cap
        super().advance(caps)
        for i, row in enumerate(self._rubbing):
            self.bound.held[i] = row.impulse / self.h


class _ContactStepper(_PymunkStepper):
    """Sliders as boxes between the two segments of their guides."""

    capped = False
    friction: CoefficientSwitch

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        import pymunk
        from pymunk import batch

        super().__init__(assembly, h, options, {GROUND})
        scene = assembly.scene
        fields = batch.ArbiterFields
        self._get_arbiters = batch.get_space_arbiters
        self._arbiter_fields = (
            fields.BODY_A_ID | fields.BODY_B_ID | fields.TOTAL_IMPULSE | fields.NORMAL
        )
        space = self._space
        space.collision_slop, space.collision_bias = (
            options["collision_slop"],
            options["collision_bias"],
        )
        # Each box touches the two segments of its own guide only, by a bit of its filter. Chipmunk
        # multiplies the coefficients of two shapes, so that with 1 for the surfaces the coefficient
        # of the box is the contact's.
        boxes, directions = [], []
        for number, guide in enumerate(scene.guides.values()):
            category = pymunk.ShapeFilter(categories=1 << number, mask=1 << number)
            box = pymunk.Poly(
                self._named[guide.slider], slider_box(guide, narrowing(guide, options))
            )
            along = np.array(guide.direction) * (_GROOVE / math.hypot(*guide.direction))
            across = np.array([-along[1], along[0]]) * (surface_distance(guide) / _GROOVE)
            surfaces = [
                pymunk.Segment(
                    space.static_body,
                    tuple(guide.point + side - along),
                    tuple(guide.point + side + along),
                    0.0,
                )
                for side in (-across, across)
            ]
            for shape in (box, *surfaces):
                shape.filter, shape.friction = category, 1.0 if guide.frictional else 0.0
                shape.elasticity = 1.0
            # Coefficients of restitution are multiplied, too.
            box.elasticity = guide.restitution
            space.add(box, *surfaces)
            if guide.frictional:
                boxes.append((box, self._named[guide.slider]))
                directions.append(along / _GROOVE)
        self.friction = CoefficientSwitch(scene)
        # A box and a surface are a pair of shapes with one arbiter, which sums up its contacts.
        pairs = 2 * len(scene.guides)
        self._arbiters, impulse, touching = _buffer(4 * pairs, 2 * pairs)
        self._contacts = SpaceContacts(
            guides=self.friction.guides,
            step=self.data,
            along=np.array(directions).reshape(-1, 2),
            touching=touching[: 2 * pairs].reshape(pairs, 2),
            impulse=impulse[: 4 * pairs].reshape(pairs, 4),
            slider=np.array(
                [
                    list(scene.bodies).index(guide.slider)
                    for guide in scene.frictional_guides.values()
                ],
                dtype=np.int64,
            ),
            identity=np.array([body.id for _, body in boxes], dtype=np.uint64),
        )
        self._boxes = [box for box, _ in boxes]

    def compile(self) -> None:
        super().compile()
        self._finish_contacts = bound(finish_space_contacts, self._contacts)
        self.friction.begin()

    def begin(self, q: np.ndarray, v: np.ndarray) -> None:
        super().begin(q, v)
        self._finish_pass = self.finish
        if self._boxes:
            self.finish = self._finish_with_contacts

    def _finish_with_contacts(self, t: float) -> bool:
        """Evaluate a pass, as `Stepper.finish`. The contacts find the friction, so that no step is repeated."""
        self._finish_pass(t)
        self._arbiters.clear()
        self._get_arbiters(self._space, self._arbiter_fields, self._arbiters)
        self._finish_contacts()
        return False

    def advance(self, caps: Sequence[float]) -> None:
        for box, coefficient in zip(self._boxes, self.friction.coefficients()):
            box.friction = coefficient
        super().advance(caps)


def _buffer(reals: int, names: int = 0) -> tuple[Buffer, np.ndarray, np.ndarray]:
    """Return a buffer of the library for so many numbers and names of bodies, and the memory of both."""
    from pymunk.batch import Buffer

    buffer = Buffer()
    numbers = np.zeros(reals + _SPARE)
    identities = np.zeros(names + _SPARE, dtype=np.uint64)
    buffer.set_float_buf(numbers)
    if names:
        buffer.set_int_buf(identities)
    return buffer, numbers, identities


def between_steps(
    assembly: Assembly, h: float, error_bias: float, iterations: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a start from which the first step has the reactions of the motion, and the state of its guides.

    With Phi(q, t) = 0 and Phi'' = J q'' + gamma, a run whose steps correct a share s of Phi settles at Phi = h^2
    gamma/(2 s) and Phi' = -h gamma/2. There, the change of Phi in a step, h Phi' + h^2 gamma/2, is zero, and the
    velocity that the next step aims at, -s Phi/h, is Phi'. If a run begins at Phi = Phi' = 0 instead, its first step
    has (1 + s/2) times the reaction of the motion, which may exceed what holds a slider at rest, and 1/s steps are off.
    Therefore velocities are advanced by half a step of the engine's own acceleration, as in the leapfrog scheme.
    Positions are set back by the least acceleration that constraints and sliders at rest need, without that of drives'
    laws.

    The acceleration is that of a trial step, in which nothing is left of an error after so many `iterations`. The
    guides are those of that step.
    """
    # The trial has ideal guides at both fidelities, as boxes have not landed in a first step. It
    # corrects whole errors (s = 1), and begins at the values above for that share.
    trial = _JointStepper(assembly, h, {**_TRIAL, "iterations": iterations})
    share = share_of_bias(error_bias, h)
    q, v = trial.bound.initial
    with_laws, without_laws = _least_accelerations(assembly.scene, trial.bound)
    # changes of velocity in half a step; those of a position are h times these
    ahead = h / 2 * with_laws
    back = h / 2 * without_laws
    trial.correct(0.0)
    trial.begin(q - h * back, v + ahead)
    trial.step()
    return q - h / share * back, v + h / 2 * trial.sample().a, trial.bound.data.guides


def _least_accelerations(scene: Scene, friction: FrictionBound) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerations that hold constraints and sliders at rest, with the laws of drives and without.

    They are the least ones in the metric of the masses, each of shape (3 * bodies,).
    """
    balance = friction.balance
    assemble(balance, 0.0, *friction.initial, 0.0)
    m, w = balance.m, balance.w
    # the rows that are held: all constraints, and those along guides whose sliders are at rest
    slowest = AT_REST * max(m.length_scale, np.abs(friction.initial[1]).max())
    held = np.append(np.arange(m.rows), m.rows + np.flatnonzero(np.abs(w.slip_speed) <= slowest))
    # `gamma` of a drive contains the second derivative of its law with a minus sign
    without_laws = w.gamma.copy()
    without_laws[m.rows - len(scene.drives) : m.rows] += [
        evaluate_law(drive.law, 0.0)[2] for drive in scene.drives.values()
    ]
    # a = -M^-1 J^T (J M^-1 J^T)^-1 gamma; least squares, as rows may be redundant
    J = constraint_rows(balance)
    gammas = np.stack((w.gamma, without_laws), axis=1)
    force = np.linalg.lstsq(w.G[np.ix_(held, held)], gammas[held])[0]
    return tuple(-(J[held].T @ force).T / balance.mass)
