"""A planar mechanism as a tree of links with one joint coordinate each, for engines of reduced coordinates.

Every body is connected to its parent (or to the ground) by one joint; the remaining joints close loops. A body without
a chain of joints to the ground is connected to it by three links: two without mass that slide along x and y, and the
body itself, which turns. A link's frame has the body's axes and its origin in the joint's point of the body.
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
    """A link, and the joint to its parent.

    Attributes
    ----------
    body, joint : str or None
        Names in the scene. A link without a body has no mass, and is part of the joint of a free body.
    parent : int
        Index of the parent; -1 for the ground.
    slides : bool
        True if the link slides along `axis`, False if it turns.
    axis : tuple of float
        Unit vector of the displacement, in the link's axes.
    anchor, point : tuple of float
        The joint's point in the parent and in this link, from their centres of mass, m.
    angle : float
        Angle of this link minus that of the parent at joint coordinate 0, rad.
    sign : int
        1 if the joint coordinate increases with the scene's coordinate (displacement of a guide; angle of the first
        body minus that of the second), -1 if it decreases.
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

    Translational joints are added to the tree first, then the revolute joints that are turned by an angle drive, then
    the others: a joint in the tree has a joint coordinate, which friction and motors need.

    At contact fidelity guides are no joints, and each slider is a free body. An engine solves for contacts with their
    Jacobian J at the start of a step; if a slider were connected to a turning body, the neglected change J' v within
    the step would move it along its surface and off it. Joints that connect sliders to each other, or to the ground,
    then close loops.

    Attributes
    ----------
    links : list of Link
        The links; a parent comes before its children.
    loops : list of str
        Names of the joints that close loops.
    link_of, link_of_joint : dict of str to int
        Index of each body's link (-1 for the ground), and of the child link of each joint of the tree.
    data : Tree
        Argument of `stiction.engines.shared.step_kernels.motion` and the other kernels.
    """

    def __init__(self, scene: Scene, fidelity: Fidelity = Fidelity.JOINT):
        contact_guides = scene.guides if fidelity == Fidelity.CONTACT else {}
        roots = [guide.slider for guide in contact_guides.values()]
        joints = [name for name in scene.joints if name not in contact_guides]
        tree, self.loops = _spanning_tree(scene, joints, roots)
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
        self.data = Tree(
            parent=np.array([link.parent for link in self.links], dtype=np.int64),
            slides=np.array([link.slides for link in self.links], dtype=np.int64),
            axis=np.array([link.axis for link in self.links], dtype=float),
            anchor=np.array([link.anchor for link in self.links], dtype=float),
            point=np.array([link.point for link in self.links], dtype=float),
            angle=np.array([link.angle for link in self.links], dtype=float),
            order=np.array([self.link_of[name] for name in scene.bodies]),
            **_motion_arrays(len(self.links)),
        )

    def _grow(self, scene: Scene, joints: Mapping[str, Sequence[str]], root: str) -> None:
        """Add all links that are connected to a body by joints of the tree, depth first."""
        # A stack is used instead of recursion: a chain may have more bodies than Python allows nested
        # calls.
        branches = [(root, iter(joints[root]))]
        while branches:
            parent, remaining = branches[-1]
            name = next(remaining, None)
            if name is None:
                branches.pop()
                continue
            bodies = scene.joints[name].bodies
            child = bodies[1] if bodies[0] == parent else bodies[0]
            if child not in self.link_of:
                self._add(scene.joints[name], name, parent, child)
                branches.append((child, iter(joints[child])))

    def _add_free(self, body: str) -> None:
        """Add the three links of a free body."""
        n = len(self.links)
        self.links += [
            Link(None, None, -1, True, (1.0, 0.0)),
            Link(None, None, n, True, (0.0, 1.0)),
            Link(body, None, n + 1, False),
        ]
        self.link_of[body] = n + 2

    def _add(self, joint: Revolute | Translational, name: str, parent: str, child: str) -> None:
        """Add the link of a child body, which is connected to its parent by a joint.

        The joint's coordinate is measured from its second body (the guide) to its first (the slider). If the child is
        the second body, the coordinate of the link has the opposite sign.
        """
        child_is_first = child == joint.bodies[0]
        axis = (1.0, 0.0)
        angle = 0.0
        if isinstance(joint, Revolute):
            points = joint.points
        else:
            axis = direction_of(joint)
            points = (joint.slider_point, joint.point)
            angle = joint.angle if child_is_first else -joint.angle
            if child_is_first:
                # Turn the direction from the guide's axes into the slider's.
                ux, uy = axis
                c, s = cos(angle), sin(angle)
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
        """Return the position of a link's joint in the frame of its parent (m), shape (3,)."""
        # The frame of the parent has its origin in the parent's own joint, not in its centre of mass.
        link = self.links[i]
        origin = self.links[link.parent].point if link.parent >= 0 else (0.0, 0.0)
        return np.array([link.anchor[0] - origin[0], link.anchor[1] - origin[1], 0.0])

    def centre(self, i: int) -> np.ndarray:
        """Return the centre of mass of a link in its frame (m), shape (3,)."""
        x, y = self.links[i].point
        return np.array([-x, -y, 0.0])

    def coordinates(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Return the joint coordinates and velocities of the scene's start, each of shape (links,)."""
        position = np.zeros(len(self.links))
        velocity = np.zeros(len(self.links))
        for i, link in enumerate(self.links):
            if link.body is None:
                continue  # set together with the link of the free body
            x, y, angle, vx, vy, omega = _start(scene, link.body, link.point)
            parent = self.links[link.parent].body if link.parent >= 0 else GROUND
            if link.joint is None or parent is None:
                # the three links of a free body
                position[i - 2 : i + 1] = (x, y, angle)
                velocity[i - 2 : i + 1] = (vx, vy, omega)
                continue
            px, py, parent_angle, pvx, pvy, parent_omega = _start(scene, parent, link.anchor)
            if not link.slides:
                position[i] = angle - parent_angle - link.angle
                velocity[i] = omega - parent_omega
                continue
            # With the vector r from the parent's point to the link's and the axis u:
            # d = u . r, d' = u . r' + (omega x u) . r.
            c, s = cos(angle), sin(angle)
            ux = c * link.axis[0] - s * link.axis[1]
            uy = s * link.axis[0] + c * link.axis[1]
            rx, ry = x - px, y - py
            position[i] = ux * rx + uy * ry
            velocity[i] = ux * (vx - pvx) + uy * (vy - pvy) + omega * (ux * ry - uy * rx)
        return position, velocity

    def hinge_between(self, first: str, second: str) -> list[tuple[int, int]]:
        """Return the hinges whose coordinates add up to the angle of `first` minus that of `second`: (link, sign)."""
        # The angle of a body is the sum of the hinges on its path to the ground. Hinges that both paths
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
        """Return coordinates, velocities and accelerations of the bodies, each (3 * bodies,), by the joints' ones."""
        q, v, a = np.empty((3, 3 * self._bodies))
        motion(self.data, position, velocity, acceleration, q, v, a)
        return q, v, a


def _spanning_tree(
    scene: Scene, joints: Sequence[str], roots: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Return the joints of a spanning tree of all bodies, and the joints that close loops.

    The bodies `roots` count as connected to the ground. Joints that need a joint coordinate come first, see `LinkTree`.
    """
    driven = {frozenset(drive.bodies) for drive in scene.drives.values() if drive.type == "angle"}

    def rank(name: str) -> int:
        joint = scene.joints[name]
        if isinstance(joint, Translational):
            return 0
        return 1 if frozenset(joint.bodies) in driven else 2

    # Kruskal's algorithm: a joint between two bodies that are not connected yet belongs to the tree,
    # any other one closes a loop.
    connected = DisjointSet((GROUND, *scene.bodies))
    for root in roots:
        connected.merge(GROUND, root)
    tree: list[str] = []
    loops: list[str] = []
    for name in sorted(joints, key=rank):
        if connected.merge(*scene.joints[name].bodies):
            tree.append(name)
        else:
            loops.append(name)
    return tree, loops


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
