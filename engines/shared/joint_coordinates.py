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
    """Return the link whose joint coordinate a drive prescribes, and the sign of the coordinate in the drive's law.

    Raises
    ------
    Refused
        If there is no such link; the message continues a sentence that begins with the name of an adapter.
    """
    if drive.type == "angle":
        # A motor drives one joint coordinate. An angle between bodies further apart in the tree is
        # the sum of several.
        hinges = tree.hinge_between(*drive.bodies)
        if len(hinges) == 1:
            return hinges[0]
        raise Refused(f"drives one hinge at a time, and {len(hinges)} hinges make up this angle")
    driven = None
    if drive.axis is not None:
        driven = link_along(scene, tree, drive.bodies, drive.axis)
    if driven is None:
        raise Refused(
            "drives distances only along a guide between the same two bodies, parallel to it"
        )
    if tree.links[driven[0]].joint in scene.frictional_guides:
        raise Refused("has one motor for each joint, and the guide's friction needs it")
    return driven


def link_along(
    scene: Scene, tree: LinkTree, bodies: tuple[str, str], axis: tuple[float, float]
) -> tuple[int, int] | None:
    """Return the link of a guide of these bodies (slider, guide) that is parallel to an axis, and its sign.

    The axis is in the axes of the second body. The sign is -1 if the link's coordinate decreases along the axis. None
    if there is no such guide.
    """
    ax, ay = axis
    for name, guide in scene.guides.items():
        if guide.bodies != bodies or name not in tree.link_of_joint:
            continue
        dx, dy = guide.direction
        sine = (ax * dy - ay * dx) / math.hypot(ax, ay) / math.hypot(dx, dy)
        if abs(sine) < PARALLEL:
            link = tree.link_of_joint[name]
            is_same_direction = np.dot(axis, guide.direction) > 0
            sign = tree.links[link].sign
            return link, sign if is_same_direction else -sign
    return None


Motor = tuple[int, int, Law, float]
"""Motor of a drive: its link, the sign of the link's coordinate in the drive's law, the law, and the coordinate at
which the law is zero."""


def motors_of(scene: Scene, tree: LinkTree, position: np.ndarray) -> list[Motor]:
    """Return the motors of a scene's drives; `position`, shape (links,), are the joint coordinates at the start."""
    motors = []
    for drive in scene.drives.values():
        link, sign = motor_link(scene, tree, drive)
        offset = position[link] - sign * evaluate_law(drive.law, 0.0)[0]
        motors.append((link, sign, drive.law, offset))
    return motors


class TreeStepper(Stepper):
    """A tree of links with drives and loads, one step ahead of its samples; subclasses add the engine.

    The engine holds the joints of frictional guides by a friction with an upper bound; for contacts see
    `ContactStepper`. A step takes h seconds. The setting `passes`, if there is one, is that of `FrictionBound`.

    Attributes
    ----------
    position, velocity : ndarray, shape (links,)
        State of the joints, which the adapter sets after each pass.
    coordinates, loads : ndarray, shape (3 * bodies,)
        Coordinates of the bodies at the beginning of the step, and applied forces in it without weight. They are
        computed only if the scene is `loaded`.
    friction_links : list of int
        Link of each guide with a bound.
    held : ndarray, shape (frictional,)
        Magnitudes of the frictions of the guides with a bound (N), which the adapter sets after each pass.
    rates : dict of int to float
        Rates of the links that motors drive in the coming pass (m/s or rad/s).
    """

    fidelity: ClassVar[Fidelity] = Fidelity.JOINT
    ahead = 1
    friction: GuideFriction

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        super().__init__(h)
        scene = assembly.scene
        self.tree = tree = LinkTree(scene, self.fidelity)
        self.loaded = bool(scene.springs or scene.forces)
        # The bound is set up for every scene, with friction or without: a mechanism that is too large
        # for the balance is then refused before the engine gets it.
        is_capped = self.fidelity == Fidelity.JOINT
        self.bound = FrictionBound(assembly.whole, options.get("passes", 1), is_capped)
        self.friction = self.bound
        self.held = self.bound.held
        self.balanced = bool(len(self.held))
        self.friction_links = []
        if is_capped:
            self.friction_links = [tree.link_of_joint[name] for name in scene.frictional_guides]
        self.settling = _SETTLING if tree.loops else 0
        self.share_joint_state(*tree.coordinates(scene))
        # The rate of a constant or linear law is set once, the rate of any other law before each step.
        self._motors = motors_of(scene, tree, self.position)
        self._followed = [
            motor for motor in self._motors if not isinstance(motor[2], (Constant, Linear))
        ]
        self.rates: dict[int, float] = {}

    def share_joint_state(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Use these arrays, each of shape (links,), for the joints' coordinates and velocities from now on.

        They may be the engine's own memory, which then need not be copied in each step.
        """
        balance = self.bound.balance
        links = len(self.tree.links)
        self.position = position
        self.velocity = velocity
        self.loads = balance.loads
        self.coordinates, v, a = np.zeros((3, len(balance.q)))
        # The compiled kernel and this object share arrays: the start of the coming step, to which
        # `retreat` returns, and start and acceleration of the last step, for `sample`.
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
        """Set the rate (m/s or rad/s) that the motor of a link's joint maintains from now on."""
        self.rates[link] = rate

    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass of the engine with these bounds of `friction_links` (N), under `loads`.

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
        # The rate leads from the present coordinate to the law at the end of the step, so that errors
        # of earlier steps are corrected and do not add up.
        for link, sign, law, offset in self._followed:
            end = sign * evaluate_law(law, self.k * self.h + self.h)[0] + offset
            self.drive_rate(link, (end - self.position[link]) / self.h)

    def sample(self) -> Sample:
        """Return the sample at the beginning of the last step."""
        return Sample(
            *self.tree.motion(*self._last), self.friction.modes_before(), self.friction.frictions()
        )


class ContactStepper(TreeStepper):
    """Steps of a tree whose sliders are held by contacts; inherited together with an engine's `TreeStepper`."""

    fidelity = Fidelity.CONTACT
    friction: CoefficientSwitch

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], *engine: Any):
        super().__init__(assembly, h, options, *engine)
        scene = assembly.scene
        self.friction = CoefficientSwitch(scene)
        # For each frictional guide, the index of its slider's velocity, and the guide's direction, which
        # is fixed at contact fidelity.
        places = {name: 3 * i for i, name in enumerate(scene.bodies)}
        self._axes = [
            (places[guide.slider], *direction_of(guide))
            for guide in scene.frictional_guides.values()
        ]
        self._no_acceleration = np.zeros(len(self.tree.links))
        guides = self.friction.guides
        self._contact_caps = guides["cap"]
        self._contact_held = guides["held"]
        self._contact_slip_speeds = guides["slip_speed"]

    @abstractmethod
    def rub(self, coefficients: Sequence[float]) -> None:
        """Set the coefficient of friction of the contacts of each frictional guide."""

    @abstractmethod
    def contact_forces(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the sums of the normal and of the tangential force magnitudes of each guide's contacts, N."""

    def slip_speeds(self) -> list[float]:
        """Return the present slip speed of each frictional guide, m/s."""
        _, v, _ = self.tree.motion(self.position, self.velocity, self._no_acceleration)
        return [ux * v[place] + uy * v[place + 1] for place, ux, uy in self._axes]

    def advance(self, caps: Sequence[float]) -> None:
        coefficients = self.friction.coefficients()
        self.rub(coefficients)
        super().advance(caps)
        if coefficients:
            # The forces of the engine's contacts decide about the coefficients of the next step.
            normals, frictions = self.contact_forces()
            for i, speed in enumerate(self.slip_speeds()):
                self._contact_caps[i] = coefficients[i] * normals[i]
                self._contact_held[i] = frictions[i]
                self._contact_slip_speeds[i] = speed
            finish_contacts(self.friction.guides)
