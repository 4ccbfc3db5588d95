"""A planar mechanism as a tree of links with one joint coordinate each, for engines of reduced coordinates.

Every body hangs from its parent (or from the ground) by one joint; the remaining joints close loops. A body that no
chain of joints ties to the ground hangs from it by three links: two without mass that slide along x and y, and the body
itself, which turns. A link's frame has the body's axes and its origin in the joint's point of the body.
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
    """One link and the joint to its parent, which is the ground if its index is -1.

    A link without a body has no mass, and is part of a free body's joint. A link slides along `axis` (in its own axes),
    or turns. `anchor` and `point` are the joint's point in the parent and in this link, from their centres of mass (m).
    `angle` is the angle of this link minus that of the parent at joint coordinate 0. `sign` is 1 if the joint
    coordinate grows with the scene's (displacement of a guide; angle of the first body minus that of the second), -1 if
    it decreases.
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

    Translational joints come into the tree first, then the revolute joints that an angle drive turns, then those with
    friction, then the others: a joint in the tree has a joint coordinate, which friction and motors need.

    At contact fidelity guides are no joints, and each slider hangs from the ground itself. An engine solves for
    contacts with their Jacobian J at the start of a step, and what the step leaves of J' v would move a slider that
    hangs on a turning body along its surface, and off it. Joints that tie sliders to each other, or to the ground, then
    close loops.

    Attributes
    ----------
    links : list of Link
    loops : list of str
        Names of the joints that close loops.
    link_of, link_of_joint : dict of str to int
        Index of each body's link (-1 for the ground), and of the child link of each joint of the tree.
    data : Tree
        Argument of `stiction.engines.shared.step_kernels.motion` and the other kernels.
    """

    def __init__(self, scene: Scene, fidelity: Fidelity = Fidelity.JOINT):
        free = scene.guides if fidelity == Fidelity.CONTACT else {}
        roots = [guide.slider for guide in free.values()]
        driven = {
            frozenset(drive.bodies) for drive in scene.drives.values() if drive.type == "angle"
        }

        def need_of_coordinate(name: str) -> int:
            """Sort key of a joint: the lower, the more it needs a joint coordinate."""
            joint = scene.joints[name]
            if isinstance(joint, Translational):
                return 0
            if frozenset(joint.bodies) in driven:
                return 1
            return 2 if joint.frictional else 3

        # Kruskal's algorithm for a spanning tree: a joint that connects two bodies which are not
        # connected yet belongs to the tree, any other one closes a loop.
        connected = DisjointSet((GROUND, *scene.bodies))
        for root in roots:
            connected.merge(GROUND, root)
        tree: list[str] = []
        self.loops: list[str] = []
        joints = [name for name in scene.joints if name not in free]
        for name in sorted(joints, key=need_of_coordinate):
            if connected.merge(*scene.joints[name].bodies):
                tree.append(name)
            else:
                self.loops.append(name)
        # Number the links from the roots outwards, so that each parent comes before its children.
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
            **_motion_arrays(len(self.links)),
        )

    def _grow(self, scene: Scene, joints: Mapping[str, Sequence[str]], root: str) -> None:
        """Add all links that hang on a body by joints of the tree, depth first."""
        # A stack instead of recursion: a chain may have more bodies than Python allows nested calls.
        branches = [(root, iter(joints[root]))]
        while branches:
            parent, remaining = branches[-1]
            if (name := next(remaining, None)) is None:
                branches.pop()
                continue
            bodies = scene.joints[name].bodies
            child = bodies[1] if bodies[0] == parent else bodies[0]
            if child not in self.link_of:
                self._add(scene.joints[name], name, parent, child)
                branches.append((child, iter(joints[child])))

    def _add_free(self, body: str) -> None:
        """Add the three links of a body that hangs freely from the ground."""
        n = len(self.links)
        self.links += [
            Link(None, None, -1, True, (1.0, 0.0)),
            Link(None, None, n, True, (0.0, 1.0)),
            Link(body, None, n + 1, False),
        ]
        self.link_of[body] = n + 2

    def _add(self, joint: Revolute | Translational, name: str, parent: str, child: str) -> None:
        """Add the link of a child body, which hangs on its parent by a joint.

        The joint's coordinate is measured from its second body (the guide) to its first (the slider). If the child is
        the second body, the coordinate of the link has the opposite sign.
        """
        child_is_first = child == joint.bodies[0]
        axis, angle = (1.0, 0.0), 0.0
        if isinstance(joint, Revolute):
            points = joint.points
        else:
            axis, points = direction_of(joint), (joint.slider_point, joint.point)
            angle = joint.angle if child_is_first else -joint.angle
            if child_is_first:
                # the direction, given in the guide's axes, in those of the slider
                (ux, uy), c, s = axis, cos(angle), sin(angle)
                axis = c * ux + s * uy, -s * ux + c * uy
        point, anchor = points if child_is_first else points[::-1]
        link = Link(
            body=child,
            joint=name,
            parent=self.link_of[parent],
            slides=isinstance(joint, Translational),
            axis=axis,
            anchor=anchor,
            point=point,
            angle=angle,
            sign=1 if child_is_first else -1,
        )
        self.link_of[child] = len(self.links)
        self.links.append(link)

    def place(self, i: int) -> np.ndarray:
        """Return the place of a link's joint in the frame of its parent, shape (3,)."""
        # the frame of the parent has its origin in the parent's own joint, not in its centre of mass
        link = self.links[i]
        origin = self.links[link.parent].point if link.parent >= 0 else (0.0, 0.0)
        return np.array([link.anchor[0] - origin[0], link.anchor[1] - origin[1], 0.0])

    def centre(self, i: int) -> np.ndarray:
        """Return the centre of mass of a link in its frame, shape (3,)."""
        x, y = self.links[i].point
        return np.array([-x, -y, 0.0])

    def coordinates(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Return the joint coordinates and velocities of the scene's start, each of shape (links,)."""
        position, velocity = np.zeros(len(self.links)), np.zeros(len(self.links))
        for i, link in enumerate(self.links):
            if link.body is None:
                # set together with the link of the free body
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
            # d = u . r with r from the parent's point to the link's, and d' = u . r' + (omega x u) . r
            c, s = cos(angle), sin(angle)
            ux, uy = c * link.axis[0] - s * link.axis[1], s * link.axis[0] + c * link.axis[1]
            position[i] = ux * (x - px) + uy * (y - py)
            velocity[i] = (
                ux * (vx - pvx) + uy * (vy - pvy) + omega * (ux * (y - py) - uy * (x - px))
            )
        return position, velocity

    def hinge_between(self, first: str, second: str) -> list[tuple[int, int]]:
        """Return the hinges whose coordinates add up to the angle of `first` minus that of `second`: (link, sign)."""
        # The angle of a body is the sum of the hinges on its way to the ground. Those that both ways
        # share cancel.
        signs: dict[int, int] = {}
        for body, sign in ((first, 1), (second, -1)):
            link = self.link_of[body]
            while link >= 0:
                if not self.links[link].slides:
                    signs[link] = signs.get(link, 0) + sign
                link = self.links[link].parent
        return [(link, sign) for link, sign in signs.items() if sign]

    def data_with_own_motion(self) -> Tree:
        """Return `data` with other arrays for the links' motion, which calls of `motion` do not overwrite."""
        return self.data.replaced(**_motion_arrays(len(self.links)))

    def motion(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return bodies' coordinates, velocities, accelerations, each (3 * bodies,), from those of the joints."""
        q, v, a = np.empty((3, 3 * self._bodies))
        motion(self.data, position, velocity, acceleration, q, v, a)
        return q, v, a


def _motion_arrays(links: int) -> dict[str, np.ndarray]:
    """Return the fields of `Tree` that hold the links' motion."""
    q, v, a = np.zeros((3, links, 3))
    return {"arm": np.zeros((links, 6)), "q": q, "v": v, "a": a}


def _start(scene: Scene, name: str, point: tuple[float, float]) -> tuple[float, ...]:
    """Return position, angle, velocity and angular velocity of a body's point at t = 0."""
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
