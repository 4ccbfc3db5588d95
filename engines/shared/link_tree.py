"""A planar mechanism as a tree of links with one joint coordinate each, for engines of reduced coordinates.

Every body hangs from its parent (or from the ground) by one joint; the joints left over close loops. A body
that no chain of joints ties to the ground hangs from it by three links: two without mass that slide along x and y, and
itself turning. A link's frame has the body's axes and its origin in the joint's point of the body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from stiction.engines.shared.contact_geometry import direction_of
from stiction.engines.shared.step_kernels import Tree, motion
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Revolute, Translational


@dataclass(frozen=True)
class Link:
    """One link and the joint to its parent, which is the ground where its index is -1.

    A link without body has no mass, and is half of a free body's joint. It slides along `axis` (axes of this link), or
    turns. `anchor` and `point`: the joint's point in the parent and in this link, from their centres of mass (m).
    `angle`: of this link minus that of the parent at joint coordinate 0. `sign` is 1 if the joint coordinate grows as
    the scene's does (displacement of a guide; angle of the first body minus that of the second), -1 if against it.
    """

    body: str | None
    joint: str | None
    parent: int
    slides: bool
    axis: tuple[float, float] = (1.0, 0.0)
    anchor: tuple[float, float] = (0.0, 0.0)
    point: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    sign: int = 1


class LinkTree:
    """Links of a scene in depth-first order, each branch complete before the next begins.

    Translational joints come into the tree first, then the revolute joints that an angle drive turns, then
    the others: what needs a joint coordinate gets one.

    At contact fidelity guides are no joints, and each slider hangs from the ground itself: what a step leaves of J' v,
    J the Jacobian of the contacts at its start, would move a slider that hangs on a turning body along its surface, and
    off it. Joints that tie sliders to each other, or to the ground, close loops then.

    Attributes
    ----------
    links : list of Link
    loops : list of str
        Names of the joints that close loops.
    link_of, link_of_joint : dict of str to int
        Index of each body's link, the ground's is -1, and of the link behind each joint of the tree.
    data : Tree
        For `stiction.engines.shared.step_kernels.motion` and its relatives.
    """

    def __init__(self, scene: Scene, fidelity: Fidelity = Fidelity.JOINT):
        free = scene.guides if fidelity == Fidelity.CONTACT else {}
        roots = [guide.slider for guide in free.values()]
        driven = {
            frozenset(drive.bodies) for drive in scene.drives.values() if drive.type == "angle"
        }

        def rank(name: str) -> int:
            joint = scene.joints[name]
            return (
                0
                if isinstance(joint, Translational)
                else 1
                if frozenset(joint.bodies) in driven
                else 2
            )

        tied = DisjointSet((GROUND, *scene.bodies))
        for root in roots:
            tied.merge(GROUND, root)
        tree: list[str] = []
        self.loops: list[str] = []
        for name in sorted((name for name in scene.joints if name not in free), key=rank):
            (tree if tied.merge(*scene.joints[name].bodies) else self.loops).append(name)
        joints_of: dict[str, list[str]] = {name: [] for name in (GROUND, *scene.bodies)}
        for name in tree:
            for body in scene.joints[name].bodies:
                joints_of[body].append(name)
        self.links: list[Link] = []
        self.link_of = {GROUND: -1}
        for root in (GROUND, *roots, *scene.bodies):
            if root not in self.link_of:
                self._add_free(root)
            self._grow(scene, joints_of, root)
        self.link_of_joint = {
            link.joint: i for i, link in enumerate(self.links) if link.joint is not None
        }
        self._bodies = len(scene.bodies)
        tables = {
            field: np.array([getattr(link, field) for link in self.links], dtype=kind)
            for field, kind in (
                ("parent", np.int64),
                ("slides", np.int64),
                ("axis", float),
                ("anchor", float),
                ("point", float),
                ("angle", float),
            )
        }
        self.data = Tree(
            **tables,
            order=np.array([self.link_of[name] for name in scene.bodies]),
            **_room(len(self.links)),
        )

    def _grow(self, scene: Scene, joints: Mapping[str, Sequence[str]], root: str) -> None:
        branches = [(root, iter(joints[root]))]
        while branches:  # a chain may have more bodies than Python has room for calls
            parent, left = branches[-1]
            if (name := next(left, None)) is None:
                branches.pop()
                continue
            bodies = scene.joints[name].bodies
            child = bodies[1] if bodies[0] == parent else bodies[0]
            if child not in self.link_of:
                self._add(scene.joints[name], name, parent, child)
                branches.append((child, iter(joints[child])))

    def _add_free(self, body: str) -> None:
        n = len(self.links)
        self.links += [
            Link(None, None, -1, True, (1.0, 0.0)),
            Link(None, None, n, True, (0.0, 1.0)),
            Link(body, None, n + 1, False),
        ]
        self.link_of[body] = n + 2

    def _add(self, joint: Revolute | Translational, name: str, parent: str, child: str) -> None:
        first = child == joint.bodies[0]
        axis, angle = (1.0, 0.0), 0.0
        if isinstance(joint, Revolute):
            points = joint.points
        else:
            axis, points = direction_of(joint), (joint.slider_point, joint.point)
            angle = joint.angle if first else -joint.angle
            if first:  # the guide's direction in the slider's axes
                (ux, uy), c, s = axis, cos(angle), sin(angle)
                axis = c * ux + s * uy, -s * ux + c * uy
        point, anchor = points if first else points[::-1]
        link = Link(
            child,
            name,
            self.link_of[parent],
            isinstance(joint, Translational),
            axis,
            anchor,
            point,
            angle,
            1 if first else -1,
        )
        self.link_of[child] = len(self.links)
        self.links.append(link)

    def place(self, i: int) -> np.ndarray:
        """The joint of a link in the frame of its parent, shape (3,)."""
        link = self.links[i]
        origin = self.links[link.parent].point if link.parent >= 0 else (0.0, 0.0)
        return np.array([link.anchor[0] - origin[0], link.anchor[1] - origin[1], 0.0])

    def centre(self, i: int) -> np.ndarray:
        """The centre of mass of a link in its frame, shape (3,)."""
        x, y = self.links[i].point
        return np.array([-x, -y, 0.0])

    def coordinates(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Joint coordinates and velocities of the scene's start, each of shape (links,)."""
        position, velocity = np.zeros(len(self.links)), np.zeros(len(self.links))
        for i, link in enumerate(self.links):
            if link.body is None:
                continue
            x, y, angle, vx, vy, omega = _start(scene, link.body, link.point)
            parent = self.links[link.parent].body if link.parent >= 0 else GROUND
            if link.joint is None or parent is None:
                position[i - 2 : i + 1], velocity[i - 2 : i + 1] = (x, y, angle), (vx, vy, omega)
                continue
            px, py, parent_angle, pvx, pvy, parent_omega = _start(scene, parent, link.anchor)
            if not link.slides:
                position[i], velocity[i] = angle - parent_angle - link.angle, omega - parent_omega
                continue
            c, s = cos(angle), sin(angle)
            ux, uy = c * link.axis[0] - s * link.axis[1], s * link.axis[0] + c * link.axis[1]
            position[i] = ux * (x - px) + uy * (y - py)
            velocity[i] = (
                ux * (vx - pvx) + uy * (vy - pvy) + omega * (ux * (y - py) - uy * (x - px))
            )
        return position, velocity

    def hinge_between(self, first: str, second: str) -> list[tuple[int, int]]:
        """Hinges whose coordinates add up to the angle of `first` minus that of `second`: (link, sign)."""
        signs: dict[int, int] = {}
        for body, sign in ((first, 1), (second, -1)):
            link = self.link_of[body]
            while link >= 0:
                if not self.links[link].slides:
                    signs[link] = signs.get(link, 0) + sign
                link = self.links[link].parent
        return [(link, sign) for link, sign in signs.items() if sign]

    def data_of_its_own(self) -> Tree:
        """`data` with other room for the links' motion, which stays while `motion` is asked for another one."""
        return self.data.replaced(**_room(len(self.links)))

    def motion(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bodies' coordinates, velocities and accelerations, each of shape (3 * bodies,), from those of the joints."""
        q, v, a = np.empty((3, 3 * self._bodies))
        motion(self.data, position, velocity, acceleration, q, v, a)
        return q, v, a


def _room(links: int) -> dict[str, np.ndarray]:
    return {"arm": np.zeros((links, 6)), **dict(zip("qva", np.zeros((3, links, 3))))}


def _start(scene: Scene, name: str, point: tuple[float, float]) -> tuple[float, ...]:
    """Position, angle, velocity and angular velocity of a body's point at t = 0."""
    if name == GROUND:
        return (*point, 0.0, 0.0, 0.0, 0.0)
    body = scene.bodies[name]
    c, s, omega = cos(body.angle), sin(body.angle), body.angular_velocity
    rx, ry = c * point[0] - s * point[1], s * point[0] + c * point[1]
    return (
        body.position[0] + rx,
        body.position[1] + ry,
        body.angle,
        body.velocity[0] - omega * ry,
        body.velocity[1] + omega * rx,
        omega,
    )
