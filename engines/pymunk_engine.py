"""pymunk (Chipmunk2D): impulses on velocities, symplectic Euler, projected Gauss-Seidel.

A step from t to t + h moves first and forces then:  q(t+h) = q(t) + h v(t),  v(t+h) = v(t) + h a,  where a balances
loads and reactions at q(t+h), t + h. So loads are evaluated there, and a sample at t holds the acceleration of
the step that ended at t. (The sample at t = 0 holds that of the first step, which belongs to h: an error O(h).)

Joint fidelity. Revolute joint: `PivotJoint`. Translational joint: `GrooveJoint` along the guide and `GearJoint` of
ratio 1 for the angle; a slider whose guide cannot turn gets infinite moment of inertia instead of the gear.
Angle drive: `SimpleMotor`, at constant rate left alone, otherwise with the rate that ends each step on
the law. Distance drive: `PinJoint` whose distance follows the law, along an axis a `GrooveJoint` across it whose place
does. Friction: a `GrooveJoint` across the guide, so that only its force along the guide acts, without
position correction and with `max_force` at the bound of `engines.friction_cap`. Springs, dampers, forces and torques are
evaluated by the adapter.

Contact fidelity. The slider is a box of the guide's length and width between two segments, without clearance;
normal forces and friction are the engine's contacts. The static coefficient is the adapter's: before each
step a guide gets mus if its slider stuck or is about to reverse, mu otherwise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from engines.fixed_step import Sample, Stepper, run_steps, settings_of, step_of
from engines.friction_cap import LAW, FrictionCap, FrictionStepper
from engines.momentum import MomentumBalance
from engines.protocol import Capabilities, Engine
from scenes import Scene, Trajectory
from scenes.fields import GROUND
from scenes.laws import Constant, Linear, evaluate_law
from scenes.model import Drive, Revolute, Translational

_GROOVE = 1e4
"""Half the length of a guide in metres: grooves end, guides do not. Rounding along it stays below 1e-11 m."""


class PymunkEngine(Engine):
    """Adapter of pymunk; see the module for what becomes of each element.

    Settings: `iterations` of the solver a step, `passes` at a step where stick is undecided, `error_bias` (share of
    a joint's position error that is left after one second; 0 corrects it in one step).
    """

    name = "pymunk"
    capabilities = Capabilities(fidelities=("joint",), static_coefficient={"joint": True},
                                friction_law={"joint": LAW}, reactions="momentum balance", order="1")

    @property
    def version(self) -> str:
        import pymunk

        return pymunk.version

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        fixed = non_turning(scene)
        for name, drive in scene.drives.items():
            if drive.type == "angle" and fixed.issuperset(drive.bodies):
                return f"drives.{name}: neither of its bodies can turn, their guides hold the angle that it drives"
        return None

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        h = step_of(dt, rtol, self.name)
        options = settings_of(settings, {"iterations": 20, "passes": 3, "error_bias": 0.0}, self.name)
        start = time.process_time()
        stepper = _JointStepper(scene, h, options)
        setup_s = time.process_time() - start
        return run_steps(stepper, scene, engine=self.name, version=self.version, fidelity=fidelity, t_end=t_end, dt=h,
                         output_step=output_step, settings=options, setup_s=setup_s)


def non_turning(scene: Scene) -> set[str]:
    """Ground and the bodies that guides keep at a constant angle to it."""
    found = {GROUND}
    while more := {name for guide in scene.guides.values() if found & set(guide.bodies) for name in guide.bodies} - found:
        found |= more
    return found


class _JointStepper(Stepper, FrictionStepper):
    """A scene as pymunk bodies and constraints."""

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any]):
        import pymunk

        self._h, self._k = h, 0
        self.counters = {"passes": 0, "balances": 0}
        self._space = space = pymunk.Space()
        space.iterations = options["iterations"]
        if scene.gravity is not None:
            space.gravity = scene.gravity
        fixed = non_turning(scene)
        self._bodies = []
        named = {GROUND: space.static_body}
        for name, data in scene.bodies.items():
            body = pymunk.Body(data.mass, math.inf if name in fixed else data.inertia)
            body.position, body.angle = data.position, data.angle
            body.velocity, body.angular_velocity = data.velocity, data.angular_velocity
            space.add(body)
            self._bodies.append(body)
            named[name] = body
        self._bias = options["error_bias"]
        self._targets = []
        for joint in scene.joints.values():
            for constraint in _joint(joint, named, fixed):
                self._add(constraint)
        for drive in scene.drives.values():
            self._drive(drive, named)
        self._friction = []
        for guide in scene.frictional_guides.values():
            self._add_friction(guide, named, fixed)
        loaded = bool(scene.springs or scene.forces)
        self._balance = MomentumBalance(scene) if self._friction or loaded else None
        self._loaded = loaded
        self._cap = FrictionCap(scene, options["passes"]) if self._friction else None
        self._q, self._v = self._read()

    def _add(self, constraint) -> None:
        constraint.error_bias = self._bias
        self._space.add(constraint)

    def _drive(self, drive: Drive, named) -> None:
        import pymunk

        first, second = (named[name] for name in drive.bodies)
        law = drive.law
        if drive.type == "angle":
            motor = pymunk.SimpleMotor(first, second, evaluate_law(law, 0.0)[1])
            self._add(motor)
            if not isinstance(law, (Constant, Linear)):
                def follow(t: float) -> None:
                    angle = first.angle - second.angle + self._h * (first.angular_velocity - second.angular_velocity)
                    motor.rate = (evaluate_law(law, t)[0] - angle) / self._h
                self._targets.append(follow)
            return
        if drive.axis is None:
            pin = pymunk.PinJoint(first, second, *drive.points)
            self._add(pin)

            def reach(t: float) -> None:
                pin.distance = evaluate_law(law, t)[0]
            self._targets.append(reach)
            return
        axis = np.array(drive.axis) / math.hypot(*drive.axis)
        across = _GROOVE * np.array([-axis[1], axis[0]])
        place = np.array(drive.points[1]) + evaluate_law(law, 0.0)[0] * axis
        groove = pymunk.GrooveJoint(second, first, tuple(place - across), tuple(place + across), drive.points[0])
        self._add(groove)

        def shift(t: float) -> None:
            place = np.array(drive.points[1]) + evaluate_law(law, t)[0] * axis
            groove.groove_a, groove.groove_b = tuple(place - across), tuple(place + across)
        self._targets.append(shift)

    def _add_friction(self, guide: Translational, named, fixed: set[str]) -> None:
        import pymunk

        slider, base = named[guide.slider], named[guide.guide]
        normal = np.array([-guide.direction[1], guide.direction[0]]) * (_GROOVE / math.hypot(*guide.direction))
        place = np.array(base.world_to_local(slider.local_to_world(guide.slider_point)))
        groove = pymunk.GrooveJoint(base, slider, tuple(place - normal), tuple(place + normal), guide.slider_point)
        groove.max_bias = 0.0
        self._space.add(groove)
        self._friction.append(groove)
        if guide.guide in fixed:
            return

        def accompany(t: float) -> None:
            # a guide that turns feels where the friction acts on it; q is where this step will solve for forces
            position = slider.position + slider.velocity * self._h
            angle = slider.angle + slider.angular_velocity * self._h
            point = position + pymunk.Vec2d(*guide.slider_point).rotated(angle)
            origin = base.position + base.velocity * self._h
            place = np.array((point - origin).rotated(-base.angle - base.angular_velocity * self._h))
            groove.groove_a, groove.groove_b = tuple(place - normal), tuple(place + normal)
        self._targets.append(accompany)

    def _read(self) -> tuple[np.ndarray, np.ndarray]:
        q, v = [], []
        for body in self._bodies:
            q += *body.position, body.angle
            v += *body.velocity, body.angular_velocity
        return np.array(q), np.array(v)

    def compile(self) -> None:
        if self._balance is not None:
            self._balance.compile()

    def sample(self) -> Sample:
        q, v = self._q, self._v
        a, modes = getattr(self, "_last", (None, None))
        self._step()
        self._last = (self._v - v) / self._h, self._modes()
        if a is None:
            a, modes = self._last
        return Sample(q, v, a, modes)

    def _step(self) -> None:
        t = (self._k + 1) * self._h
        if self._balance is not None:
            ahead = self._q + self._h * self._v
            assign = self._balance.assemble if self._friction else self._balance.loads
            self._loads = assign(t, ahead, self._v).tolist()
        for target in self._targets:
            target(t + self._h)
        if self._cap is None:
            self.advance(())
        else:
            self._before = self._q, self._v
            self._cap.step(self)
        self._k += 1

    def advance(self, caps: Sequence[float]) -> list[float]:
        if self._loaded:
            for i, body in enumerate(self._bodies):
                fx, fy, torque = self._loads[3 * i:3 * i + 3]
                body.force, body.torque = (fx, fy), torque
        for groove, cap in zip(self._friction, caps):
            groove.max_force = cap
        self._space.step(self._h)
        self.counters["passes"] += 1
        self._q, self._v = self._read()
        return [groove.impulse / self._h for groove in self._friction]

    def retreat(self) -> None:
        self._q, self._v = self._before
        q, v = self._q.tolist(), self._v.tolist()
        for i, body in enumerate(self._bodies):
            body.position, body.angle = (q[3 * i], q[3 * i + 1]), q[3 * i + 2]
            body.velocity, body.angular_velocity = (v[3 * i], v[3 * i + 1]), v[3 * i + 2]

    def slip(self) -> np.ndarray:
        return self._balance.slip(self._v)

    def reactions(self, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self.counters["balances"] += 1
        return self._balance.reactions((self._v - self._before[1]) / self._h, friction)

    def _modes(self) -> np.ndarray:
        return self._cap.modes() if self._cap else np.zeros(0)


def _joint(joint, named, fixed: set[str]):
    """The constraints of a revolute or translational joint."""
    import pymunk

    first, second = (named[name] for name in joint.bodies)
    if isinstance(joint, Revolute):
        yield pymunk.PivotJoint(first, second, *joint.points)
        return
    along = np.array(joint.direction) * (_GROOVE / math.hypot(*joint.direction))
    place = np.array(joint.point)
    yield pymunk.GrooveJoint(second, first, tuple(place - along), tuple(place + along), joint.slider_point)
    if joint.slider not in fixed:
        gear = pymunk.GearJoint(second, first, joint.angle, 1.0)
        yield gear
