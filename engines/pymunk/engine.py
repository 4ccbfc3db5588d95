"""pymunk (Chipmunk2D): impulses on velocities, symplectic Euler, projected Gauss-Seidel.

A step from t to t + h moves first and forces then:  q(t+h) = q(t) + h v(t),  v(t+h) = v(t) + h a,  where a balances
loads and reactions at q(t+h), t + h. So loads are evaluated there, and a sample at t holds the acceleration of the step
that ended at t; that at 0 holds the first one's. Velocities that lead q(t+h) back onto the constraints are those of t +
h/2, not of t: runs with friction start from such ones, see `between_steps`. Without friction the first step makes them
of the consistent start, and its acceleration is not the motion's: the samples at 0 and h hold that of the second.

Joint fidelity. Revolute joint: `PivotJoint`. Translational joint: `GrooveJoint` along the guide and `GearJoint` of
ratio 1 for the angle; a slider whose guide cannot turn gets infinite moment of inertia instead of the gear. Angle
drive: `SimpleMotor`, at constant rate left alone, otherwise with the rate that ends each step on the law. Distance
drive: `PinJoint` whose distance follows the law, along an axis a `GrooveJoint` across it whose place does. Friction: a
`GrooveJoint` across the guide, so that only its force along the guide acts, without position correction and with
`max_force` at the bound.

Contact fidelity. The slider is a box of the guide's length and width, less `clearance`, between two segments. Without
clearance the box touches both from the start, and what its contacts remember keeps it pressed between them: a box of
length a and width b that slides from the start has 1 + 2 mu b/a times its friction, at any step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from stiction.engines.protocol import FIDELITIES, accepted, installed_version
from stiction.engines.shared.contact_geometry import contact_refusal, crowded, slider_box, unlike_guides
from stiction.engines.shared.fixed_step import Defaults, Sample, SteppedEngine, Stepper
from stiction.engines.shared.friction_bound import CoefficientSwitch, FrictionBound
from stiction.engines.shared.step_kernels import (SpaceContacts, SpaceStep, assemble, begin_space, finish_space,
                                                  finish_space_contacts)
from stiction.reference_impl.compiled.kernel import bound
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, evaluate_law
from stiction.scenes.model import Drive, Translational

if TYPE_CHECKING:
    from pymunk import Body, GrooveJoint
    from pymunk.batch import Buffer

MOST_GUIDES = 32
"""At contact fidelity sliders touch their own guides only: a bit of `ShapeFilter` each, of an unsigned int."""
_GROOVE = 1e4
"""Half the length of a guide in metres: grooves end, guides do not. Rounding along it stays below 1e-11 m."""
AT_REST = 1e-9
"""A slip speed at the start up to this part of the mechanism's size per second, or of the largest speed, is rest: scene
files are met to it."""
_SPARE = 2
"""Numbers for which a buffer that is not the library's own must have room left, or the library makes it longer with its
own allocator."""
_SETTINGS: Mapping[str, Defaults] = {
    "joint": {"iterations": 50, "passes": 2, "error_bias": 0.0},
    "contact": {"iterations": 100, "error_bias": 0.0, "collision_slop": 1e-5, "collision_bias": 0.9 ** 60,
                "clearance": 1e-7}}
_TRIAL = {"iterations": 1000, "passes": 20, "error_bias": 0.0}
"""Settings of the one step before a run: it finds impulses and bounds of friction, which no step before it has, to
rounding."""


class PymunkEngine(SteppedEngine):
    """Adapter of pymunk; see the module for what becomes of each element.

    Settings, joint fidelity: `iterations` of the solver a step, `passes` at a step where stick is undecided,
    `error_bias` (share of a joint's position error left after one second; 0 corrects it in one step). Contact
    fidelity: `iterations`, `error_bias`, `collision_slop` (overlap in metres that is let be), `collision_bias`
    (as `error_bias`, for overlap), `clearance` (by how much the box is narrower than its guide, m).
    """

    name, defaults, reach = "pymunk", _SETTINGS, dict.fromkeys(FIDELITIES, _GROOVE)

    @property
    def version(self) -> str:
        import pymunk  # noqa: F401 - an installation that cannot be imported has no version

        return accepted("pymunk", installed_version("pymunk"))  # that of the wheel 7.0.0 says 2.0.0 of itself

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        if fidelity == "contact" and (reason := contact_refusal(scene) or crowded(scene, MOST_GUIDES, "pymunk")
                                      or unlike_guides(scene)):
            return reason
        fixed = non_turning(scene) if fidelity == "joint" else {GROUND}
        for name, drive in scene.drives.items():
            if drive.type == "angle" and fixed.issuperset(drive.bodies):
                return f"drives.{name}: neither of its bodies can turn, their guides hold the angle that it drives"
        return None

    def stepper(self, scene: Scene, h: float, options: Mapping[str, Any],
                fidelity: str) -> AbstractContextManager[Stepper]:
        return nullcontext((_JointStepper if fidelity == "joint" else _ContactStepper)(scene, h, options))


def non_turning(scene: Scene) -> set[str]:
    """Ground and the bodies that guides keep at a constant angle to it."""
    found = {GROUND}
    guides = [set(guide.bodies) for guide in scene.guides.values()]
    while more := {name for bodies in guides if found & bodies for name in bodies} - found:
        found |= more
    return found


class _PymunkStepper(Stepper):
    """A scene as pymunk bodies, pins, motors and loads; subclasses add guides and friction."""

    capped: ClassVar[bool]
    friction: FrictionBound | CoefficientSwitch

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any], fixed: set[str]):
        import pymunk

        super().__init__()
        self._h, self._k, self._scene = h, 0, scene
        self._space = space = pymunk.Space()
        space.iterations = options["iterations"]
        if scene.gravity is not None:
            space.gravity = scene.gravity
        named = {GROUND: space.static_body}
        for name, data in scene.bodies.items():
            body = pymunk.Body(data.mass, math.inf if name in fixed else data.inertia)
            body.position, body.angle = data.position, data.angle
            body.velocity, body.angular_velocity = data.velocity, data.angular_velocity
            space.add(body)
            named[name] = body
        self._bias = options["error_bias"]
        self._targets: list[Callable[[float], None]] = []
        for pin in scene.pins.values():
            self._add(pymunk.PivotJoint(named[pin.bodies[0]], named[pin.bodies[1]], *pin.points))
        for drive in scene.drives.values():
            self._drive(drive, *(named[name] for name in drive.bodies))
        self._named = named
        self._loaded = bool(scene.springs or scene.forces)
        # boxes find their friction themselves, and land in the first step; all else settles in two
        self.bound = FrictionBound(scene, options.get("passes", 1), self.capped)
        self.balanced, self.settling = bool(len(self.bound.held)), 1 if len(self.bound.held) else 2
        self._share_states([named[name].id for name in scene.bodies])

    def _share_states(self, bodies: Sequence[int]) -> None:
        """Have the states of the space's bodies as arrays, read and written in one call each.

        `data` is as last fetched; its `before` is what `retreat` writes, its `pushed` the loads.
        """
        from pymunk import batch

        fields, count, space = batch.BodyFields, len(bodies), self._space
        self._get, self._set = batch.get_space_bodies, batch.set_space_bodies
        self._motion = fields.POSITION | fields.ANGLE | fields.VELOCITY | fields.ANGULAR_VELOCITY
        self._force = fields.FORCE | fields.TORQUE
        order = batch.Buffer()
        batch.get_space_bodies(space, fields.BODY_ID, order)
        expected = [*bodies, space.static_body.id]
        if (found := list(memoryview(order.int_buf()).cast("P"))) != expected:
            raise RuntimeError(f"pymunk lists the bodies {found}; expected {expected}, as they were added and the "
                               "static one last")
        # of each body, and behind them of the static one
        (self._present, present, _), (self._before, before, _), (self._pushed, pushed, _) = (
            _buffer(width * (count + 1)) for width in (6, 6, 3))
        q, v, a = np.zeros((3, 3 * count))
        self.data = SpaceStep(cap=self.bound.data, h=self._h, loaded=int(self._loaded), pushed=pushed[:3 * count], q=q,
                              v=v, a=a, present=present[:6 * count].reshape(count, 6),
                              before=before[:6 * count].reshape(count, 6))
        self._fetch()

    def _fetch(self) -> None:
        self._present.clear()
        self._get(self._space, self._motion, self._present)

    def _retreat(self) -> None:
        """Write what was before to the space; what is present stays as it is until it is fetched."""
        self._set(self._space, self._motion, self._before)

    def _add(self, constraint: Any) -> None:
        constraint.error_bias = self._bias
        self._space.add(constraint)

    def _drive(self, drive: Drive, first: Body, second: Body) -> None:
        import pymunk

        law, follow = drive.law, self._targets.append
        if drive.type == "angle":
            motor = pymunk.SimpleMotor(first, second, evaluate_law(law, 0.0)[1])
            self._add(motor)

            def turn(t: float) -> None:
                angle = first.angle - second.angle + self._h * (first.angular_velocity - second.angular_velocity)
                motor.rate = (evaluate_law(law, t)[0] - angle) / self._h
            if not isinstance(law, (Constant, Linear)):
                follow(turn)
        elif drive.axis is None:
            rod = pymunk.PinJoint(first, second, *drive.points)
            self._add(rod)

            def stretch(t: float) -> None:
                rod.distance = evaluate_law(law, t)[0]
            follow(stretch)
        else:
            axis = np.array(drive.axis) / math.hypot(*drive.axis)
            across = _GROOVE * np.array([-axis[1], axis[0]])
            groove = pymunk.GrooveJoint(second, first, tuple(-across), tuple(across), drive.points[0])
            self._add(groove)

            def shift(t: float) -> None:
                place = drive.points[1] + evaluate_law(law, t)[0] * axis
                groove.groove_a, groove.groove_b = tuple(place - across), tuple(place + across)
            follow(shift)

    def compile(self) -> None:
        start, data = self.bound.initial, self.data
        if self._scene.frictional_guides:
            *between, guides = between_steps(self._scene, self._h, self._bias)
            self.bound.data.guides[:] = guides[:len(self.bound.data.guides)]
        self.begin(*(between if self._scene.frictional_guides else start))
        data.q[:], data.v[:] = start  # of the first sample

    def begin(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin the first step, at these coordinates and velocities."""
        self.data.before[:] = np.hstack((q.reshape(-1, 3), v.reshape(-1, 3)))
        self._retreat()
        self._fetch()
        begin_space(self.data, self._h)
        self._finish = bound(finish_space, self.data)

    def step(self) -> None:
        self._k += 1
        for target in self._targets:  # the position that follows the step
            target(self._k * self._h + self._h)
        self.bound.step(self.advance, self._finish, (self._k + 1) * self._h, self._retreat)

    def sample(self) -> Sample:
        data = self.data
        return Sample(data.q.copy(), data.v.copy(), data.a.copy(), self.friction.modes(), self.friction.frictions())

    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass of the engine under the loads, and fetch the state."""
        if self._loaded:
            self._set(self._space, self._force, self._pushed)  # which the space forgets with its next step
        self.clock.call(self._space.step, self._h)
        self._fetch()


class _JointStepper(_PymunkStepper):
    """Guides as grooves, friction as capped grooves across them."""

    capped = True

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any], fixed: set[str] | None = None):
        import pymunk

        fixed = non_turning(scene) if fixed is None else fixed
        super().__init__(scene, h, options, fixed)
        for guide in scene.guides.values():
            slider, base = self._named[guide.slider], self._named[guide.guide]
            along = np.array(guide.direction) * (_GROOVE / math.hypot(*guide.direction))
            ends = tuple(guide.point - along), tuple(guide.point + along)
            self._add(pymunk.GrooveJoint(base, slider, *ends, guide.slider_point))
            if guide.slider not in fixed:
                self._add(pymunk.GearJoint(base, slider, guide.angle, 1.0))
        self._grooves = [self._friction_groove(guide, turning=guide.guide not in fixed)
                         for guide in scene.frictional_guides.values()]
        self.friction = self.bound

    def advance(self, caps: Sequence[float]) -> None:
        for groove, cap in zip(self._grooves, caps):
            groove.max_force = cap
        super().advance(caps)
        for i, groove in enumerate(self._grooves):
            self.bound.held[i] = groove.impulse / self._h

    def _friction_groove(self, guide: Translational, turning: bool) -> GrooveJoint:
        import pymunk

        slider, base = self._named[guide.slider], self._named[guide.guide]
        normal = np.array([-guide.direction[1], guide.direction[0]]) * (_GROOVE / math.hypot(*guide.direction))
        place = np.array(base.world_to_local(slider.local_to_world(guide.slider_point)))
        groove = pymunk.GrooveJoint(base, slider, tuple(place - normal), tuple(place + normal), guide.slider_point)
        groove.max_bias = 0.0
        self._space.add(groove)

        def accompany(t: float) -> None:
            # a guide that turns feels where the friction acts on it; q is where this step will solve for forces
            position = slider.position + slider.velocity * self._h
            angle = slider.angle + slider.angular_velocity * self._h
            point = position + pymunk.Vec2d(*guide.slider_point).rotated(angle)
            origin = base.position + base.velocity * self._h
            place = np.array((point - origin).rotated(-base.angle - base.angular_velocity * self._h))
            groove.groove_a, groove.groove_b = tuple(place - normal), tuple(place + normal)
        if turning:
            self._targets.append(accompany)
        return groove


class _ContactStepper(_PymunkStepper):
    """Sliders as boxes between the two segments of their guides."""

    capped = False
    friction: CoefficientSwitch

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any]):
        import pymunk
        from pymunk import batch

        super().__init__(scene, h, options, {GROUND})
        fields = batch.ArbiterFields
        self._get_arbiters = batch.get_space_arbiters
        self._arbiter_fields = fields.BODY_A_ID | fields.BODY_B_ID | fields.TOTAL_IMPULSE | fields.NORMAL
        space = self._space
        space.collision_slop, space.collision_bias = options["collision_slop"], options["collision_bias"]
        boxes, directions = [], []
        for number, guide in enumerate(scene.guides.values()):
            category = pymunk.ShapeFilter(categories=1 << number, mask=1 << number)
            box = pymunk.Poly(self._named[guide.slider], slider_box(guide, options["clearance"]))
            along = np.array(guide.direction) * (_GROOVE / math.hypot(*guide.direction))
            across = np.array([-along[1], along[0]]) * (guide.extent[1] / 2 / _GROOVE)
            surfaces = [pymunk.Segment(space.static_body, tuple(guide.point + side - along),
                                       tuple(guide.point + side + along), 0.0) for side in (-across, across)]
            for shape in (box, *surfaces):
                shape.filter, shape.friction = category, 1.0 if guide.frictional else 0.0
            space.add(box, *surfaces)
            if guide.frictional:
                boxes.append((box, self._named[guide.slider]))
                directions.append(along / _GROOVE)
        self.friction = CoefficientSwitch(scene)
        pairs = 2 * len(scene.guides)
        self._arbiters, impulse, touching = _buffer(4 * pairs, 2 * pairs)
        self._contacts = SpaceContacts(
            guides=self.friction.guides, step=self.data, along=np.array(directions).reshape(-1, 2),
            touching=touching[:2 * pairs].reshape(pairs, 2), impulse=impulse[:4 * pairs].reshape(pairs, 4),
            slider=np.array([list(scene.bodies).index(guide.slider) for guide in scene.frictional_guides.values()],
                            dtype=np.int64),
            identity=np.array([body.id for _, body in boxes], dtype=np.uint64))
        self._boxes = [box for box, _ in boxes]

    def compile(self) -> None:
        super().compile()
        self._finish_contacts = bound(finish_space_contacts, self._contacts)
        self.friction.begin()

    def step(self) -> None:
        for box, coefficient in zip(self._boxes, self.friction.coefficients()):
            box.friction = coefficient
        super().step()
        if self._boxes:
            self._arbiters.clear()
            self._get_arbiters(self._space, self._arbiter_fields, self._arbiters)
            self._finish_contacts()


def _buffer(reals: int, names: int = 0) -> tuple[Buffer, np.ndarray, np.ndarray]:
    """Return a buffer of the library for so many numbers, and names of bodies, and its memory for both."""
    from pymunk.batch import Buffer

    buffer, numbers, identities = Buffer(), np.zeros(reals + _SPARE), np.zeros(names + _SPARE, dtype=np.uint64)
    buffer.set_float_buf(numbers)
    if names:
        buffer.set_int_buf(identities)
    return buffer, numbers, identities


def between_steps(scene: Scene, h: float, error_bias: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a start from which the first step has the reactions of the motion, and the state of its guides.

    With Phi(q, t) = 0 and Phi'' = J q'' + gamma, a run has Phi = h^2 gamma/2 and Phi' = -h gamma/2 at each of its
    steps. From Phi = Phi' = 0 it gets there by half a step's reaction more, which a slider at rest does not stand. So
    velocities are advanced by half a step of the engine's own acceleration, as in the leapfrog scheme. Positions are
    set back by the least acceleration that constraints and sliders at rest need, of which laws of drives are no part.
    Joints that correct a share of their error in a step, by the run's `error_bias`, need that share of both. The guides
    are those of the trial step that gave the acceleration. The scene has friction.
    """
    # ideal guides at both fidelities: boxes have not landed in a first step
    trial = _JointStepper(scene, h, _TRIAL, fixed={GROUND})
    (q, v), share = trial.bound.initial, 1.0 - error_bias ** h
    of_velocity, of_position = (h / 2 * each for each in _least_accelerations(scene, trial.bound))
    trial.begin(q - h * of_position, v + of_velocity)
    trial.step()
    return (q - share * h * of_position, v + h / 2 * trial.sample().a - (1.0 - share) * of_velocity,
            trial.bound.data.guides)


def _least_accelerations(scene: Scene, friction: FrictionBound) -> tuple[np.ndarray, np.ndarray]:
    """Return the least accelerations, by masses, that hold constraints and sliders at rest; without laws behind it."""
    balance = friction.balance
    assemble(balance, 0.0, *friction.initial, 0.0)
    m, w = balance.m, balance.w
    slowest = AT_REST * max(m.length_scale, np.abs(friction.initial[1]).max())
    held = np.append(np.arange(m.rows), m.rows + np.flatnonzero(np.abs(w.slip_speed) <= slowest))
    resting = w.gamma.copy()
    resting[m.rows - len(scene.drives):m.rows] += [evaluate_law(drive.law, 0.0)[2] for drive in scene.drives.values()]
    J = np.zeros((len(w.gamma), len(balance.mass)))
    for place, row, body in m.block.astype(int):
        J[row, body:body + 3] = w.J[place:place + 3]
    force = np.linalg.lstsq(w.G[np.ix_(held, held)], np.stack((w.gamma, resting), axis=1)[held])[0]
    return tuple(-(J[held].T @ force).T / balance.mass)
