"""What engines share that know a mechanism as a tree of links (`stiction.engines.shared.link_tree`) with motors in its joints.

A step from t to t + h solves for the accelerations at q(t) under the loads at t, then v(t+h) = v(t) + h a and
q(t+h) = q(t) + h v(t+h). So a sample at t holds the acceleration of the step that begins at t.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence

import numpy as np

from stiction.engines.protocol import Refused
from stiction.engines.shared.acceleration_integrator import Accelerations
from stiction.engines.shared.fixed_step import Sample, Stepper
from stiction.engines.shared.friction_cap import FrictionCap, FrictionStepper, GuideFriction
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.momentum import MomentumBalance
from stiction.engines.shared.step_kernels import judge_joints, prepare_joints
from stiction.scenes import Scene
from stiction.scenes.laws import Constant, Law, Linear, evaluate_law
from stiction.scenes.model import Drive, Translational


def tree_refusal(scene: Scene, tree: LinkTree, engine: str) -> str | None:
    """Why a tree with motors cannot represent the scene; None if it can."""
    for name in tree.loops:
        if isinstance(scene.joints[name], Translational):
            return (f"joints.{name}: closes a loop, and {engine} has no translational constraint between links; "
                    "only revolute joints can close loops here")
    motors: dict[int, str] = {}
    for name, drive in scene.drives.items():
        found = driven_link(scene, tree, drive)
        if isinstance(found, str):
            return f"drives.{name}: {engine} {found}"
        if found[0] in motors:
            return f"drives.{name}: drives the same joint as drives.{motors[found[0]]}"
        motors[found[0]] = name
    return None


def driven_link(scene: Scene, tree: LinkTree, drive: Drive) -> tuple[int, int] | str:
    """The link whose joint coordinate a drive prescribes, and its sign; or why there is none, in words behind the engine's name."""
    if drive.type == "angle":
        hinges = tree.hinge_between(*drive.bodies)
        if len(hinges) == 1:
            return hinges[0]
        return f"drives one hinge at a time, this angle is that of {len(hinges)} hinges"
    for i, link in enumerate(tree.links):
        joint = scene.joints.get(link.joint)
        if drive.axis is None or not link.slides or link.joint is None or joint.bodies != drive.bodies:
            continue
        sine = (drive.axis[0] * joint.direction[1] - drive.axis[1] * joint.direction[0]) \
            / math.hypot(*drive.axis) / math.hypot(*joint.direction)
        if abs(sine) < 1e-12:  # parallel to rounding
            if joint.frictional:
                return "has one motor a joint, and the guide's friction needs it"
            return i, link.sign if np.dot(drive.axis, joint.direction) > 0 else -link.sign
    return "drives distances only along a guide between the same two bodies, as its axis"


class TreeStepper(Stepper):
    """A tree of links with drives and loads, one step ahead of its samples; subclasses have the engine.

    Attributes
    ----------
    position, velocity : ndarray, shape (links,)
        Of the joints, after the last step.
    before : tuple of ndarray, each of shape (links,)
        The same before it.
    coordinates, loads : ndarray, shape (3 * bodies,)
        Coordinates of the bodies before the step, and applied forces in it, weight apart.
    friction : GuideFriction
        What the steps told of the frictional guides.
    """

    friction: GuideFriction

    def __init__(self, scene: Scene, h: float, tree: LinkTree):
        self.h, self.tree, self._k = h, tree, 0
        self.counters = {"passes": 0, "balances": 0}
        self.position, self.velocity = tree.coordinates(scene)
        self.still = np.zeros(len(tree.links))
        self.coordinates, self.loads = np.zeros((2, 3 * len(scene.bodies)))
        self.loaded = bool(scene.springs or scene.forces)
        self.balance = MomentumBalance(scene)  # of every scene: one that is too large for it is refused before the engine has it
        self._followed: list[tuple[int, int, Law, float]] = []

    def add_drives(self, scene: Scene) -> None:
        """Give each drive's joint its motor, by `drive_rate`: at constant rate left alone, otherwise set so that each step ends on the law."""
        for drive in scene.drives.values():
            link, sign = driven_link(scene, self.tree, drive)
            if isinstance(drive.law, (Constant, Linear)):
                self.drive_rate(link, sign * evaluate_law(drive.law, 0.0)[1])
            else:
                self._followed.append((link, sign, drive.law, self.position[link] - sign * evaluate_law(drive.law, 0.0)[0]))

    @abstractmethod
    def drive_rate(self, link: int, rate: float) -> None:
        """The motor of a joint holds this rate from now on (m/s or rad/s)."""

    @abstractmethod
    def take_step(self, t: float) -> None:
        """The step that begins at t."""

    def compile(self) -> None:
        self.tree.motion(self.position, self.velocity, self.still)
        self.balance.compile()

    def step(self) -> None:
        t = self._k * self.h
        self._k += 1
        self.before = self.position, self.velocity
        for link, sign, law, offset in self._followed:
            self.drive_rate(link, (sign * evaluate_law(law, t + self.h)[0] + offset - self.position[link]) / self.h)
        self.take_step(t)

    def load(self, t: float) -> None:
        """Coordinates and applied forces of the step that begins at t."""
        if self.loaded:
            self.coordinates, v, _ = self.tree.motion(self.position, self.velocity, self.still)
            self.loads = self.balance.loads(t, self.coordinates, v)

    def sample(self) -> Sample:
        """That at the beginning of the last step."""
        motion = self.tree.motion(*self.before, (self.velocity - self.before[1]) / self.h)
        return Sample(*motion, self.friction.modes_before(), self.friction.frictions())

    def samples(self, every: int) -> Iterator[Sample]:
        self.step()
        return super().samples(every)


class CappedTreeStepper(TreeStepper, FrictionStepper):
    """A tree whose engine holds the joints of frictional guides by a friction with an upper bound.

    Parameters
    ----------
    passes : int
        As of `FrictionCap`.

    Attributes
    ----------
    friction_links : list of int
        Link of each frictional guide.
    """

    def __init__(self, scene: Scene, h: float, tree: LinkTree, passes: int):
        super().__init__(scene, h, tree)
        link_of_joint = {link.joint: i for i, link in enumerate(tree.links)}
        self.friction_links = [link_of_joint[name] for name in scene.frictional_guides]
        self._sliding = np.array(self.friction_links, dtype=int)
        self._signs = np.array([tree.links[i].sign for i in self.friction_links], dtype=float)
        self._cap = FrictionCap(scene, self.balance, passes) if self.friction_links else None
        self.friction = self._cap or GuideFriction(scene)

    @abstractmethod
    def advance(self, caps: Sequence[float]) -> np.ndarray:
        """One step of the engine with these bounds (N), under `loads`; magnitudes of the frictions in it (N), shape (frictional,)."""

    def take_step(self, t: float) -> None:
        if self._cap is None:
            self.load(t)
            self.advance(())
            return
        prepare_joints(self.tree.data, self._cap.data, t, self.position, self.velocity, self.coordinates, self.loads)
        self._cap.step(self)

    def attempt(self, caps: Sequence[float]) -> bool:
        held = self.advance(caps)
        self.counters["balances"] += 1
        slip_speed = self._signs * self.velocity[self._sliding]
        return judge_joints(self.tree.data, self._cap.data, *self.before, self.velocity, self.h, slip_speed, held)


class TreeAccelerations(Accelerations):
    """An engine's mass matrix and inverse dynamics of a scene's tree of links; subclasses have the engine."""

    def __init__(self, scene: Scene, tree: LinkTree):
        if tree.loops:
            raise Refused(f"joints.{tree.loops[0]}: closes a loop; inverse dynamics are those of a tree")
        self._tree = tree
        self._position, velocity = tree.coordinates(scene)
        self._driven: list[tuple[int, int, Law, float]] = []
        for drive in scene.drives.values():
            link, sign = driven_link(scene, tree, drive)
            self._driven.append((link, sign, drive.law, self._position[link] - sign * evaluate_law(drive.law, 0.0)[0]))
        self._free = np.setdiff1d(np.arange(len(tree.links)), [link for link, *_ in self._driven])
        self.start = self._position[self._free], velocity[self._free]
        links = [next(i for i, link in enumerate(tree.links) if link.joint == name) for name in scene.frictional_guides]
        self.guides = np.searchsorted(self._free, links)
        self.signs = np.array([tree.links[link].sign for link in links], dtype=float)
        self._balance = MomentumBalance(scene) if scene.springs or scene.forces else None

    @abstractmethod
    def dynamics(self, position: np.ndarray, velocity: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix, shape (links, links), and the joint forces that these accelerations take under gravity, shape (links,)."""

    def solve(self, t: float, x: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position, velocity, driven = self._joints(t, x, rate, np.zeros(len(x)))
        mass, needed = self.dynamics(position, velocity, driven)
        mobility = np.linalg.inv(mass[np.ix_(self._free, self._free)])
        force = -needed[self._free]
        if self._balance is not None:
            q, v, _ = self._tree.motion(position, velocity, driven)
            loads = self._balance.loads(t, q, v)
            still = np.zeros(len(position))
            for i, link in enumerate(self._free):
                unit = still.copy()
                unit[link] = 1.0
                force[i] += self._tree.motion(position, unit, still)[1] @ loads
        return mobility @ force, mobility

    def motion(self, t: float, x: np.ndarray, rate: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        return self._tree.motion(*self._joints(t, x, rate, second))

    def _joints(self, t: float, x: np.ndarray, rate: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates, rates and accelerations of all joints, those of drives by their laws."""
        joints = np.zeros((3, len(self._tree.links)))
        joints[:, self._free] = x, rate, second
        for link, sign, law, offset in self._driven:
            joints[:, link] = sign * np.array(evaluate_law(law, t))
            joints[0, link] += offset
        return tuple(joints)
