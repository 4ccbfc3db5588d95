"""Steps of engines that model a mechanism as a tree of links with motors in its joints.

A step from t to t + h solves for the accelerations at q(t) under the loads at t, then v(t+h) = v(t) + h a and q(t+h) =
q(t) + h v(t+h). So a sample at t contains the acceleration of the step that begins at t. A motor holds the rate of a
drive's law, constant or such that each step ends on the law; `motor_link` finds the joint of a drive's motor.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.protocol import Refused
from stiction.engines.shared.contact_geometry import direction_of
from stiction.engines.shared.fixed_step import Sample, Stepper
from stiction.engines.shared.friction_bound import CoefficientSwitch, FrictionBound, GuideFriction
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.step_kernels import (
    JointStep,
    begin_joints,
    finish_contacts,
    finish_joints,
    motion,
)
from stiction.reference_impl.compiled.kernel import bound, link_kernels
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import Constant, Law, Linear, evaluate_law
from stiction.scenes.model import Drive

PARALLEL = 1e-12
"""Sine of the angle between two axes that are parallel to rounding."""
_SETTLING = 16
"""Steps in which the joints that close loops settle at the position error that they keep. Measured in PyBullet: the
distance from that error is then 1e-3 of what it was at the start."""


def motor_link(scene: Scene, tree: LinkTree, drive: Drive) -> tuple[int, int]:
    """Return the link whose joint coordinate a drive prescribes, and its sign.

    Raises
    ------
    Refused
        If there is none; the message continues a sentence that begins with the name of an adapter.
    """
    if drive.type == "angle":
        # A motor drives one joint coordinate. An angle between bodies further apart in the tree is
        # the sum of several.
        hinges = tree.hinge_between(*drive.bodies)
        if len(hinges) == 1:
            _refuse_friction(scene, tree, hinges[0][0], "pin")
            return hinges[0]
        raise Refused(f"drives one hinge at a time, and {len(hinges)} hinges make up this angle")
    driven = None
    if drive.axis is not None:
        driven = link_along(scene, tree, drive.bodies, drive.axis)
    if driven is None:
        raise Refused(
            "drives distances only along a guide between the same two bodies, parallel to it"
        )
    _refuse_friction(scene, tree, driven[0], "guide")
    return driven


def motor_refusal(scene: Scene, tree: LinkTree, called: str) -> str | None:
    """Return why the drives of a scene cannot be motors of the links; None if they can.

    Each drive needs a joint coordinate, and no two may have the same. The engine is `called` so in the refusal.
    """
    motors: dict[int, str] = {}
    for name, drive in scene.drives.items():
        try:
            link, _ = motor_link(scene, tree, drive)
        except Refused as reason:
            return f"drives.{name}: the {called} adapter {reason}"
        other = motors.setdefault(link, name)
        if other != name:
            return f"drives.{name}: drives the same joint as drives.{other}"
    return None


def _refuse_friction(scene: Scene, tree: LinkTree, link: int, kind: str) -> None:
    """Raise Refused for a motor of a link whose joint, a guide or a pin by its `kind`, has friction."""
    if tree.links[link].joint in scene.frictional_joints:
        raise Refused(f"has one motor for each joint, and the {kind}'s friction needs it")


def link_along(
    scene: Scene, tree: LinkTree, bodies: tuple[str, str], axis: tuple[float, float]
) -> tuple[int, int] | None:
    """Return the link of a guide of these bodies (slider, guide) that is parallel to an axis, and its sign.

    The axis is in the axes of the second body. The sign is -1 if the link's coordinate decreases along the axis. None
    if there is no such guide.
    """
    for name, guide in scene.guides.items():
        (ax, ay), (dx, dy) = axis, guide.direction
        sine = (ax * dy - ay * dx) / math.hypot(ax, ay) / math.hypot(dx, dy)
        if guide.bodies == bodies and name in tree.link_of_joint and abs(sine) < PARALLEL:
            link = tree.link_of_joint[name]
            sense = 1 if np.dot(axis, guide.direction) > 0 else -1
            return link, sense * tree.links[link].sign
    return None


Motor = tuple[int, int, Law, float]
"""Link and sign of a drive's joint coordinate, the drive's law, and the coordinate where the law is zero."""


def motors_of(scene: Scene, tree: LinkTree, position: np.ndarray) -> list[Motor]:
    """Return the motor of each drive of a scene that begins at this position of the links, shape (links,)."""
    motors = []
    for drive in scene.drives.values():
        link, sign = motor_link(scene, tree, drive)
        offset = position[link] - sign * evaluate_law(drive.law, 0.0)[0]
        motors.append((link, sign, drive.law, offset))
    return motors


class TreeStepper(Stepper):
    """A tree of links with drives and loads, one step ahead of its samples; subclasses add the engine.

    The engine holds frictional joints by a friction with an upper bound; for contacts see `ContactStepper`. A step
    takes h seconds. The setting `passes`, if there is one, is that of `FrictionBound`.

    Attributes
    ----------
    position, velocity : ndarray, shape (links,)
        State of the joints, which the adapter sets after each pass.
    coordinates, loads : ndarray, shape (3 * bodies,)
        Coordinates of the bodies at the beginning of the step, and applied forces in it without weight. They are
        computed only if the scene is `loaded`.
    friction_links : list of int
        Link of each joint whose friction has a bound.
    held : ndarray, shape (frictional,)
        Magnitudes of the frictions of these joints (N, N m), which the adapter sets after each pass.
    rates : dict of int to float
        Rates of the links that motors drive in the coming pass (m/s or rad/s).
    """

    fidelity: ClassVar[Fidelity] = Fidelity.JOINT
    ahead = 1
    friction: GuideFriction

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        super().__init__(h)
        scene = assembly.scene
        tree, capped = LinkTree(scene, self.fidelity), self.fidelity == Fidelity.JOINT
        self.tree = tree
        self.loaded = bool(scene.springs_and_dampers or scene.forces)
        # Made of every scene, with friction or without: a mechanism that is too large for the
        # balance is then refused before the engine gets it.
        self.bound = FrictionBound(assembly.whole, options.get("passes", 1), capped)
        self.friction = self.bound
        self.held, self.balanced = self.bound.held, bool(len(self.bound.held))
        self.friction_links = (
            [tree.link_of_joint[name] for name in scene.frictional_joints] if capped else []
        )
        self.settling = _SETTLING if tree.loops else 0
        self.share_joint_state(*tree.coordinates(scene))
        # The rate of a constant or linear law is set once, that of another one before each step.
        self._motors = motors_of(scene, tree, self.position)
        self._followed = [
            motor for motor in self._motors if not isinstance(motor[2], (Constant, Linear))
        ]
        self.rates: dict[int, float] = {}

    def share_joint_state(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Keep the joints' coordinates and velocities in these arrays from now on, each of shape (links,).

        They may be the engine's own memory, which then need not be copied in each step.
        """
        balance = self.bound.balance
        links = len(self.tree.links)
        self.position, self.velocity, self.loads = position, velocity, balance.loads
        self.coordinates, v, a = np.zeros((3, len(balance.q)))
        # The compiled kernel and this object use the same arrays: the start of the coming step, to
        # which `retreat` returns, and start and acceleration of the last one, for `sample`.
        *self._start, last_position, last_velocity, acceleration = np.zeros((5, links))
        self._last = last_position, last_velocity, acceleration
        signs = [self.tree.links[link].sign for link in self.friction_links]
        self._data = JointStep(
            cap=self.bound.data,
            h=self.h,
            loaded=int(self.loaded),
            tree=self.tree.data_with_own_motion(),
            links=np.array(self.friction_links, dtype=np.int64),
            signs=np.array(signs, dtype=float),
            position=position,
            velocity=velocity,
            start_position=self._start[0],
            start_velocity=self._start[1],
            last_position=last_position,
            last_velocity=last_velocity,
            acceleration=acceleration,
            q=self.coordinates,
            v=v,
            a=a,
        )

    def drive_rate(self, link: int, rate: float) -> None:
        """Set the rate that the motor of a joint holds from now on (m/s or rad/s)."""
        self.rates[link] = rate

    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass of the engine with these bounds of `friction_links` (N, N m), under `loads`.

        Sets `position`, `velocity` and `held`.
        """
        raise NotImplementedError

    @abstractmethod
    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set the engine's joint coordinates and rates, each of shape (links,)."""

    def retreat(self) -> None:
        self.put(*self._start)

    def compile(self) -> None:
        for link, sign, law, _ in self._motors:
            self.drive_rate(link, sign * evaluate_law(law, 0.0)[1])
        link_kernels(motion)
        self.begin()
        self.friction.begin()

    def begin(self) -> None:
        """Begin the first step, from `position` and `velocity`."""
        begin_joints(self._data, 0.0)
        self.finish = bound(finish_joints, self._data)

    def aim(self) -> None:
        # The rate that leads from the present coordinate to the law at the end of the step, so that
        # errors of earlier steps are corrected and do not add up.
        for link, sign, law, offset in self._followed:
            end = sign * evaluate_law(law, self.k * self.h + self.h)[0] + offset
            self.drive_rate(link, (end - self.position[link]) / self.h)

    def sample(self) -> Sample:
        """Return the sample at the beginning of the last step."""
        return Sample(
            *self.tree.motion(*self._last), self.friction.modes_before(), self.friction.frictions()
        )


class ContactStepper(TreeStepper):
    """Steps of a tree whose sliders are held by contacts; a base besides an engine's `TreeStepper`."""

    fidelity = Fidelity.CONTACT
    friction: CoefficientSwitch

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], *engine: Any):
        super().__init__(assembly, h, options, *engine)
        scene = assembly.scene
        self.friction = CoefficientSwitch(scene)
        # Of each frictional guide: the place of its slider's velocity, and the guide's direction,
        # which is fixed at contact fidelity.
        places = {name: 3 * i for i, name in enumerate(scene.bodies)}
        self._axes = [
            (places[guide.slider], *direction_of(guide))
            for guide in scene.frictional_guides.values()
        ]
        self._still = np.zeros(len(self.tree.links))
        guides = self.friction.guides
        self._contact_caps, self._contact_held, self._contact_slip_speeds = (
            guides[name] for name in ("cap", "held", "slip_speed")
        )

    @abstractmethod
    def rub(self, coefficients: Sequence[float]) -> None:
        """Set the coefficient of friction of the contacts of each frictional guide."""

    @abstractmethod
    def contact_forces(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return, per frictional guide, sums of the magnitudes of its contacts' normal and tangential forces (N)."""

    def slip_speeds(self) -> list[float]:
        """Return, per frictional guide, the present slip speed (m/s)."""
        _, v, _ = self.tree.motion(self.position, self.velocity, self._still)
        return [ux * v[place] + uy * v[place + 1] for place, ux, uy in self._axes]

    def advance(self, caps: Sequence[float]) -> None:
        coefficients = self.friction.coefficients()
        self.rub(coefficients)
        super().advance(caps)
        if coefficients:
            # What the engine's contacts did decides the coefficients of the next step.
            normals, frictions = self.contact_forces()
            for i, speed in enumerate(self.slip_speeds()):
                self._contact_caps[i] = coefficients[i] * normals[i]
                self._contact_held[i] = frictions[i]
                self._contact_slip_speeds[i] = speed
            finish_contacts(self.friction.guides)
