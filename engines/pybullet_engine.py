"""PyBullet: a multibody in reduced coordinates (Featherstone), impulses on joint velocities, symplectic Euler.

A step from t to t + h solves for the accelerations at q(t) under the loads at t, then
v(t+h) = v(t) + h a,  q(t+h) = q(t) + h v(t+h).  So a sample at t holds the acceleration of the step that begins at t.

Joint fidelity. The mechanism is one multibody on a fixed base, its joints those of `engines.link_tree.LinkTree`.
Revolute joints that close a loop are point-to-point constraints, corrected by `erp` of their error each step; a
translational joint that closes a loop is refused (PyBullet has no such constraint between links). Angle drive: velocity
motor of the hinge, at constant rate left alone, otherwise with the rate that ends each step on the law; the bodies
must be joined through exactly one hinge. Distance drive: the same on a guide without friction, along its direction. Friction:
velocity motor at rest with `force` at the bound of `engines.friction_cap`. Springs, dampers, forces and torques are
evaluated by the adapter and applied as external forces. All damping that PyBullet adds by default is switched off.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from engines.fixed_step import Sample, Stepper, run_steps, settings_of, step_of
from engines.friction_cap import LAW, FrictionCap, FrictionStepper
from engines.link_tree import LinkTree
from engines.momentum import MomentumBalance
from engines.protocol import Capabilities, Engine
from scenes import Scene, Trajectory
from scenes.laws import Constant, Law, Linear, evaluate_law
from scenes.model import Drive, Revolute, Translational

_MOTOR_LIMIT = 1e9
"""Newton or newton metres that a drive or a loop may take: no limit, but finite, as PyBullet wants it."""


class PybulletEngine(Engine):
    """Adapter of PyBullet; see the module for what becomes of each element.

    Settings: `iterations` of the solver a step, `passes` at a step where stick is undecided, `erp` (share of a
    loop's position error that is corrected in one step).
    """

    name = "pybullet"
    capabilities = Capabilities(fidelities=("joint",), static_coefficient={"joint": True},
                                friction_law={"joint": LAW}, reactions="momentum balance", order="1")

    @property
    def version(self) -> str:
        from importlib.metadata import version

        _pybullet()
        return version("pybullet")

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        return _refusal(scene, LinkTree(scene))

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        h = step_of(dt, rtol, self.name)
        options = settings_of(settings, {"iterations": 50, "passes": 3, "erp": 1.0}, self.name)
        start = time.process_time()
        with _client() as client:
            stepper = _JointStepper(scene, h, options, client)
            setup_s = time.process_time() - start
            return run_steps(stepper, scene, engine=self.name, version=self.version, fidelity=fidelity, t_end=t_end,
                             dt=h, output_step=output_step, settings=options, setup_s=setup_s)


def _refusal(scene: Scene, tree: LinkTree) -> str | None:
    for name in tree.loops:
        if isinstance(scene.joints[name], Translational):
            return (f"joints.{name}: closes a loop, and PyBullet has no translational constraint between links; "
                    "only revolute joints can close loops here")
    motors: dict[int, str] = {}
    for name, drive in scene.drives.items():
        found = _motor(scene, tree, drive)
        if isinstance(found, str):
            return f"drives.{name}: {found}"
        if found[0] in motors:
            return f"drives.{name}: drives the same joint as drives.{motors[found[0]]}"
        motors[found[0]] = name
    return None


def _motor(scene: Scene, tree: LinkTree, drive: Drive) -> tuple[int, int] | str:
    """The link whose joint coordinate a drive prescribes, and its sign; or why there is none."""
    if drive.type == "angle":
        hinges = tree.hinge_between(*drive.bodies)
        if len(hinges) == 1:
            return hinges[0]
        return f"PyBullet drives one hinge at a time, this angle is that of {len(hinges)} hinges"
    for i, link in enumerate(tree.links):
        joint = scene.joints.get(link.joint)
        if drive.axis is None or not link.slides or link.joint is None or joint.bodies != drive.bodies:
            continue
        sine = (drive.axis[0] * joint.direction[1] - drive.axis[1] * joint.direction[0]) \
            / math.hypot(*drive.axis) / math.hypot(*joint.direction)
        if abs(sine) < 1e-12:  # parallel to rounding
            if joint.frictional:
                return "PyBullet has one motor a joint, and the guide's friction needs it"
            return i, link.sign if np.dot(drive.axis, joint.direction) > 0 else -link.sign
    return "PyBullet drives distances only along a guide between the same two bodies, as its axis"


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the build time, which the library writes to the error stream at import, off it."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _pybullet():
    """The library, imported when it is needed."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    with _quiet():
        import pybullet

    return pybullet


@contextlib.contextmanager
def _client() -> Iterator[int]:
    """A physics server of one run."""
    bullet = _pybullet()
    client = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise RuntimeError("PyBullet gave no physics server")
    try:
        yield client
    finally:
        bullet.disconnect(client)


class _JointStepper(Stepper, FrictionStepper):
    """A scene as a PyBullet multibody."""

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any], client: int):
        self._bullet, self._client, self._h, self._k = _pybullet(), client, h, 0
        self.counters = {"passes": 0, "balances": 0}
        self._tree = tree = LinkTree(scene)
        bullet = self._bullet
        bullet.setTimeStep(h, physicsClientId=client)
        bullet.setPhysicsEngineParameter(numSolverIterations=options["iterations"], solverResidualThreshold=0.0,
                                         physicsClientId=client)
        if scene.gravity is not None:
            bullet.setGravity(*scene.gravity, 0.0, physicsClientId=client)
        self._multibody = self._build(scene)
        self._links = list(range(len(tree.links)))
        self._body_links = [tree.link_of[name] for name in scene.bodies]
        for name in tree.loops:
            self._close_loop(scene.joints[name], options["erp"])
        self._position, self._velocity = tree.coordinates(scene)
        self._put()
        self._targets = []
        for drive in scene.drives.values():
            self._drive(scene, drive)
        self._friction = [(tree.link_of[guide.slider] if tree.links[tree.link_of[guide.slider]].joint == name
                           else tree.link_of[guide.guide]) for name, guide in scene.frictional_guides.items()]
        self._signs = np.array([tree.links[i].sign for i in self._friction])
        self._loaded = bool(scene.springs or scene.forces)
        self._balance = MomentumBalance(scene) if self._friction or self._loaded else None
        self._cap = FrictionCap(scene, options["passes"]) if self._friction else None

    def _build(self, scene: Scene) -> int:
        bullet, links = self._bullet, self._tree.links
        flat = [(*((np.subtract(link.anchor, links[link.parent].point) if link.parent >= 0 else link.anchor)), 0.0)
                for link in links]
        body = bullet.createMultiBody(
            baseMass=0.0, linkMasses=[scene.bodies[link.body].mass if link.body else 0.0 for link in links],
            linkCollisionShapeIndices=[-1] * len(links), linkVisualShapeIndices=[-1] * len(links), linkPositions=flat,
            linkOrientations=[bullet.getQuaternionFromEuler([0.0, 0.0, link.angle]) for link in links],
            linkInertialFramePositions=[(-link.point[0], -link.point[1], 0.0) for link in links],
            linkInertialFrameOrientations=[(0.0, 0.0, 0.0, 1.0)] * len(links),
            linkParentIndices=[link.parent + 1 for link in links],
            linkJointTypes=[bullet.JOINT_PRISMATIC if link.slides else bullet.JOINT_REVOLUTE for link in links],
            linkJointAxis=[(*link.axis, 0.0) if link.slides else (0.0, 0.0, 1.0) for link in links],
            physicsClientId=self._client)
        if body < 0:
            raise RuntimeError("PyBullet did not create the multibody")
        for i, link in enumerate(links):
            bullet.changeDynamics(body, i, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                                  physicsClientId=self._client)
            if link.body:  # in a call of its own: beside damping it is dropped in silence
                inertia = scene.bodies[link.body].inertia
                bullet.changeDynamics(body, i, localInertiaDiagonal=[inertia] * 3, physicsClientId=self._client)
            bullet.setJointMotorControl2(body, i, bullet.VELOCITY_CONTROL, force=0.0, physicsClientId=self._client)
        return body

    def _close_loop(self, joint: Revolute, erp: float) -> None:
        bullet = self._bullet
        (first, second), (p, q) = (self._tree.link_of[name] for name in joint.bodies), joint.points
        pin = bullet.createConstraint(self._multibody, first, self._multibody, second, bullet.JOINT_POINT2POINT,
                                      [0, 0, 0], [*p, 0.0], [*q, 0.0], physicsClientId=self._client)
        bullet.changeConstraint(pin, maxForce=_MOTOR_LIMIT, erp=erp, physicsClientId=self._client)

    def _motor_rate(self, link: int, rate: float) -> None:
        self._bullet.setJointMotorControl2(self._multibody, link, self._bullet.VELOCITY_CONTROL, targetVelocity=rate,
                                           force=_MOTOR_LIMIT, physicsClientId=self._client)

    def _drive(self, scene: Scene, drive: Drive) -> None:
        link, sign = _motor(scene, self._tree, drive)
        law: Law = drive.law
        if isinstance(law, (Constant, Linear)):
            self._motor_rate(link, sign * evaluate_law(law, 0.0)[1])
            return
        offset = self._position[link] - sign * evaluate_law(law, 0.0)[0]

        def follow(t: float) -> None:
            self._motor_rate(link, (sign * evaluate_law(law, t)[0] + offset - self._position[link]) / self._h)
        self._targets.append(follow)

    def _put(self) -> None:
        for i, (position, velocity) in enumerate(zip(self._position.tolist(), self._velocity.tolist())):
            self._bullet.resetJointState(self._multibody, i, position, velocity, physicsClientId=self._client)

    def compile(self) -> None:
        self._tree.motion(self._position, self._velocity, self._velocity)
        if self._balance is not None:
            self._balance.compile()

    def sample(self) -> Sample:
        t = self._k * self._h
        modes = self._modes() if self._k else None
        self._before = self._position, self._velocity
        zero = np.zeros(len(self._links))
        if self._balance is not None:
            q, v, _ = self._tree.motion(*self._before, zero)
            self._coordinates = q
            self._loads = (self._balance.assemble if self._friction else self._balance.loads)(t, q, v).tolist()
        for target in self._targets:
            target(t + self._h)
        if self._cap is None:
            self.advance(())
        else:
            self._cap.step(self)
        self._k += 1
        q, v, a = self._tree.motion(*self._before, (self._velocity - self._before[1]) / self._h)
        return Sample(q, v, a, self._modes() if modes is None else modes)

    def _modes(self) -> np.ndarray:
        return self._cap.modes() if self._cap else np.zeros(0)

    def advance(self, caps: Sequence[float]) -> list[float]:
        bullet, body, client = self._bullet, self._multibody, self._client
        if self._loaded:
            for i, link in enumerate(self._body_links):
                fx, fy, torque = self._loads[3 * i:3 * i + 3]
                if fx or fy:
                    bullet.applyExternalForce(body, link, [fx, fy, 0.0],
                                              [self._coordinates[3 * i], self._coordinates[3 * i + 1], 0.0],
                                              bullet.WORLD_FRAME, physicsClientId=client)
                if torque:
                    bullet.applyExternalTorque(body, link, [0.0, 0.0, torque], bullet.WORLD_FRAME, physicsClientId=client)
        for link, cap in zip(self._friction, caps):
            bullet.setJointMotorControl2(body, link, bullet.VELOCITY_CONTROL, targetVelocity=0.0, force=cap,
                                         physicsClientId=client)
        bullet.stepSimulation(physicsClientId=client)
        self.counters["passes"] += 1
        states = bullet.getJointStates(body, self._links, physicsClientId=client)
        self._position = np.array([state[0] for state in states])
        self._velocity = np.array([state[1] for state in states])
        return [abs(states[link][3]) for link in self._friction]

    def retreat(self) -> None:
        self._position, self._velocity = self._before
        self._put()

    def slip(self) -> np.ndarray:
        return self._signs * self._velocity[self._friction]

    def reactions(self, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self.counters["balances"] += 1
        _, _, a = self._tree.motion(*self._before, (self._velocity - self._before[1]) / self._h)
        return self._balance.reactions(a, friction)
