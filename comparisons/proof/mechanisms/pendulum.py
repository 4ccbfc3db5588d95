"""The simple pendulum, psi'' = -(g/l) sin psi, by Newton's law along the tangent.

Source: E. T. Whittaker, Analytical Dynamics, sect. 44. Nothing about it is piecewise: it shows the integrator on an
equation that is not linear in the state.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from stiction.comparisons.proof.enclosures.exact import ZERO
from stiction.comparisons.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.comparisons.proof.mechanisms.scene_reader import CENTRE, SceneReader, balls
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant

SWING = "swing"


@dataclass(frozen=True)
class Pendulum(ProvableMechanism):
    """Length and gravity, pivot, angle from the lowest position and its rate at t = 0 (q, v)."""

    length: arb
    g: arb
    pivot: tuple[arb, arb]
    q: list[arb]
    v: list[arb]
    t_end: arb
    body: str
    joint: str = ""

    def timed(self, mode: str):
        w2 = self.g / self.length
        return lambda instant, order: lambda q, v: [q[0].sin() * -w2]

    def guards(self, mode, t, order, q, v, a):
        return []

    def start(self) -> Next:
        return Next(SWING)

    def after(self, mode, guard, t, q, v) -> Next:
        raise AssertionError("a pendulum has no guards")

    def require_unique(self, mode, t, bound) -> None:
        """The equation is Lipschitz: the a-priori enclosure proves it."""

    def columns(self, t, q, v) -> dict[str, arb]:
        sine, cosine, l, name = q[0].sin(), q[0].cos(), self.length, self.body
        return {f"{name}.x": self.pivot[0] + l * sine, f"{name}.y": self.pivot[1] - l * cosine,
                f"{name}.vx": l * v[0] * cosine, f"{name}.vy": l * v[0] * sine}

    @classmethod
    def from_scene(cls, scene: Scene) -> Pendulum:
        """Parameters of a scene; its start is taken to meet the constraint."""
        reader = SceneReader(scene, "a pendulum")
        name, drive = next(iter(scene.drives.items()), (None, None))
        body = next(iter(scene.bodies))
        alone = not (scene.joints or scene.springs or scene.forces) and len(scene.bodies) == len(scene.drives) == 1
        falls = scene.gravity is not None and scene.gravity[0] == 0 and scene.gravity[1] < 0
        reader.require(alone and falls and drive.type == "distance" and drive.bodies == (body, GROUND)
                       and drive.points[0] == CENTRE and drive.axis is None and isinstance(drive.law, Constant),
                       "expected one body, gravity (0, -g) and one constant distance drive from the body's centre "
                       "to the ground, nothing else")
        e = reader.exact
        pivot, length = e.vector("drives", name, "points", 1), e("drives", name, "law", "value")
        position, velocity = e.vector("bodies", body, "position"), e.vector("bodies", body, "velocity")
        arm = position[0] - pivot[0], position[1] - pivot[1]
        moment = arm[0] * velocity[1] - arm[1] * velocity[0]
        rate = ZERO if moment.is_zero else moment / (length * length)
        angle = arb.atan2(arm[0].ball, -arm[1].ball)
        return cls(length.ball, -e("gravity", 1).ball, balls(pivot), [angle], [rate.ball], e("t_end").ball, body)
