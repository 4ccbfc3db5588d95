"""The simple pendulum, psi'' = -(g/l) sin psi, by Newton's law along the tangent (E. T. Whittaker, Analytical Dynamics, sect. 44).

Nothing about it is piecewise: it shows the integrator on an equation that is not linear in the state.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from stiction.comparisons.proof.enclosures.exact import ZERO, ExactScene
from stiction.comparisons.proof.enclosures.series import sin
from stiction.comparisons.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.comparisons.truth.truth import NotThisMechanism
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant

SWING = "swing"


@dataclass(frozen=True)
class Pendulum(ProvableMechanism):
    """Length and gravity, pivot, angle from the lowest position and its rate at t = 0."""

    length: arb
    g: arb
    pivot: tuple[arb, arb]
    angle: arb
    rate: arb
    t_end: arb
    body: str
    joint: str = ""

    @property
    def q(self) -> list[arb]:
        return [self.angle]

    @property
    def v(self) -> list[arb]:
        return [self.rate]

    def timed(self, mode: str):
        w2 = self.g / self.length
        return lambda instant, order: lambda q, v: [sin(q[0]) * -w2]

    def guards(self, mode, t, order, q, v, a):
        return []

    def start(self) -> Next:
        return Next(SWING)

    def after(self, mode, guard, t, q, v) -> Next:
        raise AssertionError("a pendulum has no guards")

    def require_unique(self, mode, t, bound) -> None:
        """The equation is Lipschitz: the a-priori enclosure proves it."""

    def columns(self, t, q, v) -> dict[str, arb]:
        sine, cosine, l = q[0].sin(), q[0].cos(), self.length
        name = self.body
        return {f"{name}.x": self.pivot[0] + l * sine, f"{name}.y": self.pivot[1] - l * cosine, f"{name}.vx": l * v[0] * cosine,
                f"{name}.vy": l * v[0] * sine}

    @classmethod
    def from_scene(cls, scene: Scene) -> Pendulum:
        """Parameters of a scene, exact, at the working precision; the start is taken to meet the constraint.

        Raises
        ------
        NotThisMechanism
            If the scene is anything else.
        """
        name, drive = next(iter(scene.drives.items()), (None, None))
        body = next(iter(scene.bodies))
        if (len(scene.bodies) != 1 or len(scene.drives) != 1 or scene.joints or scene.springs or scene.forces or scene.gravity is None
                or scene.gravity[0] != 0 or scene.gravity[1] >= 0 or drive.type != "distance" or drive.bodies != (body, GROUND)
                or drive.points[0] != (0, 0) or drive.axis is not None or not isinstance(drive.law, Constant)):
            raise NotThisMechanism(f"{scene.name} is not a pendulum: expected one body, gravity (0, -g) and one constant distance drive "
                                   "from the body's centre to the ground, nothing else")
        e = ExactScene(scene)
        pivot = e.vector("drives", name, "points", 1)
        position, velocity = e.vector("bodies", body, "position"), e.vector("bodies", body, "velocity")
        arm = position[0] - pivot[0], position[1] - pivot[1]
        length = e("drives", name, "law", "value")
        moment = arm[0] * velocity[1] - arm[1] * velocity[0]
        angle = arb.atan2(arm[0].ball, -arm[1].ball)
        return cls(length.ball, -e("gravity", 1).ball, (pivot[0].ball, pivot[1].ball), angle,
                   ZERO.ball if moment.is_zero else (moment / (length * length)).ball, e("t_end").ball, body)
