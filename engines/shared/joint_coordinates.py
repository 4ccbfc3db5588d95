"""Steps of engines that know a mechanism as a tree of links with motors in its joints.

A step from t to t + h solves for the accelerations at q(t) under the loads at t, then v(t+h) = v(t) + h a and
q(t+h) = q(t) + h v(t+h). So a sample at t holds the acceleration of the step that begins at t. A motor holds the rate
of a drive's law, constant or such that each step ends on the law; `motor_link` says which joints can have one.
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


def motor_link(scene: Scene, tree: LinkTree, drive: Drive) -> tuple[int, int]:
    """The link whose joint coordinate a drive prescribes, and its sign.

    Raises
    ------
    Refused
        If there is none; the words go on from the name of an adapter.
    """
    if drive.type == "angle":
        hinges = tree.hinge_between(*drive.bodies)
        if len(hinges) == 1:
            return hinges[0]
        raise Refused(f"drives one hinge at a time, this angle is that of {len(hinges)} hinges")
    if drive.axis is None or (found := link_along(scene, tree, drive.bodies, drive.axis)) is None:
        raise Refused(
            "drives distances only along a guide between the same two bodies, as its axis"
        )
    if tree.links[found[0]].joint in scene.frictional_guides:
        raise Refused("has one motor a joint, and the guide's friction needs it")
    return found


def link_along(
    scene: Scene, tree: LinkTree, bodies: tuple[str, str], axis: tuple[float, float]
) -> tuple[int, int] | None:
    """The link of a guide, of bodies (slider, guide), that is parallel to an axis of the guide, and its sign."""
    for name, guide in scene.guides.items():
        (ax, ay), (dx, dy) = axis, guide.direction
        sine = (ax * dy - ay * dx) / math.hypot(ax, ay) / math.hypot(dx, dy)
        if guide.bodies == bodies and name in tree.link_of_joint and abs(sine) < 1e-12:
            # parallel to rounding
            link, sense = tree.link_of_joint[name], 1 if np.dot(axis, guide.direction) > 0 else -1
            return link, sense * tree.links[link].sign
    return None


Motor = tuple[int, int, Law, float]
"""Link and sign of a drive's joint coordinate, the drive's law, and the coordinate where the law is zero."""


def motors_of(scene: Scene, tree: LinkTree, position: np.ndarray) -> list[Motor]:
    """Return the motor of each drive of a scene that begins at this position of the links, shape (links,)."""
    found = [(*motor_link(scene, tree, drive), drive.law) for drive in scene.drives.values()]
    return [
        (link, sign, law, position[link] - sign * evaluate_law(law, 0.0)[0])
        for link, sign, law in found
    ]


_SETTLING = 16
"""Steps in which the joints that close loops settle at the position error they keep; measured in PyBullet: to 1e-3 of
their start's."""


class TreeStepper(Stepper):
    """A tree of links with drives and loads, one step ahead of its samples; subclasses have the engine.

    The engine holds the joints of frictional guides by a friction with an upper bound; see `ContactStepper`. A step
    takes h seconds; of the settings `passes`, if any, is that of `FrictionBound`.

    Attributes
    ----------
    position, velocity : ndarray, shape (links,)
        State of the joints, to be set after each pass.
    coordinates, loads : ndarray, shape (3 * bodies,)
        Coordinates of the bodies at the beginning of the step, and applied forces in it, weight apart; where anything
        is `loaded`.
    friction_links : list of int
        Link of each guide with a bound.
    held : ndarray, shape (frictional,)
        Magnitudes of the frictions of the guides with a bound (N), to be set after each pass.
    rates : dict of int to float
        Rates of the links that motors turn in the coming pass (m/s or rad/s).
    """

    fidelity: ClassVar[Fidelity] = Fidelity.JOINT
    ahead = 1
    friction: GuideFriction

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        super().__init__(h)
        scene = assembly.scene
        tree, capped = LinkTree(scene, self.fidelity), self.fidelity == Fidelity.JOINT
        self.tree = tree
        self.loaded = bool(scene.springs or scene.forces)
        # of every scene: one that is too large for it is refused before the engine has it
        self.bound = FrictionBound(assembly.whole, options.get("passes", 1), capped)
        self.friction = self.bound
        self.held, self.balanced = self.bound.held, bool(len(self.bound.held))
        self.friction_links = (
            [tree.link_of_joint[name] for name in scene.frictional_guides] if capped else []
        )
        self.settling = _SETTLING if tree.loops else 0
        self.joints_are(*tree.coordinates(scene))
        self._motors = motors_of(scene, tree, self.position)
        self._followed = [
            motor for motor in self._motors if not isinstance(motor[2], (Constant, Linear))
        ]
        self.rates: dict[int, float] = {}

    def joints_are(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Have the joints' coordinates and velocities in these arrays from now on, of one's own or the engine's."""
        balance = self.bound.balance
        links = len(self.tree.links)
        self.position, self.velocity, self.loads = position, velocity, balance.loads
        self.coordinates, v, a = np.zeros((3, len(balance.q)))
        *self._start, last_position, last_velocity, acceleration = np.zeros((5, links))
        self._last = last_position, last_velocity, acceleration
        signs = [self.tree.links[link].sign for link in self.friction_links]
        self._data = JointStep(
            cap=self.bound.data,
            h=self.h,
            loaded=int(self.loaded),
            tree=self.tree.data_of_its_own(),
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
        """The motor of a joint holds this rate from now on (m/s or rad/s)."""
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
        for link, sign, law, offset in self._followed:
            end = sign * evaluate_law(law, self.k * self.h + self.h)[0] + offset
            self.drive_rate(link, (end - self.position[link]) / self.h)

    def sample(self) -> Sample:
        """Return the sample at the beginning of the last step."""
        return Sample(
            *self.tree.motion(*self._last), self.friction.modes_before(), self.friction.frictions()
        )


class ContactStepper(TreeStepper):
    """Steps of a tree whose sliders contacts hold; to be derived from together with an engine's `TreeStepper`."""

    fidelity = Fidelity.CONTACT
    friction: CoefficientSwitch

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], *engine: Any):
        super().__init__(assembly, h, options, *engine)
        scene = assembly.scene
        self.friction = CoefficientSwitch(scene)
        places = {name: 3 * i for i, name in enumerate(scene.bodies)}
        self._axes = [
            (places[guide.slider], *direction_of(guide))
            for guide in scene.frictional_guides.values()
        ]
        self._still = np.zeros(len(self.tree.links))
        self._last_step = tuple(
            self.friction.guides[name] for name in ("cap", "held", "slip_speed")
        )

    @abstractmethod
    def rub(self, coefficients: Sequence[float]) -> None:
        """Give the contacts of each frictional guide its coefficient of friction."""

    @abstractmethod
    def contact_forces(self) -> tuple[Sequence[float], Sequence[float]]:
        """Per frictional guide: sums of the magnitudes of its contacts' normal and tangential forces (N)."""

    def slip_speeds(self) -> list[float]:
        """Per frictional guide: the present slip speed (m/s)."""
        _, v, _ = self.tree.motion(self.position, self.velocity, self._still)
        return [ux * v[place] + uy * v[place + 1] for place, ux, uy in self._axes]

    def advance(self, caps: Sequence[float]) -> None:
        coefficients = self.friction.coefficients()
        self.rub(coefficients)
        super().advance(caps)
        if coefficients:
            (caps_of_contacts, held, slip_speeds), (normals, frictions) = (
                self._last_step,
                self.contact_forces(),
            )
            for i, speed in enumerate(self.slip_speeds()):
                caps_of_contacts[i], held[i], slip_speeds[i] = (
                    coefficients[i] * normals[i],
                    frictions[i],
                    speed,
                )
            finish_contacts(self.friction.guides)
