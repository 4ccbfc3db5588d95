"""The simple pendulum, psi'' = -(g/l) sin psi, by Newton's law along the tangent.

Source: E. T. Whittaker, Analytical Dynamics, sect. 44. Nothing about it is piecewise: it shows the integrator on an
equation that is not linear in the state.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from stiction.scenes import Scene
from stiction.truths.closed_form.pendulum import PENDULUM
from stiction.truths.proof.enclosures.exact import ZERO
from stiction.truths.proof.mechanisms.mechanism import Next, ProvableMechanism
from stiction.truths.proof.mechanisms.scene_reader import SceneReader, balls


@dataclass(frozen=True, kw_only=True)
class Pendulum(ProvableMechanism):
    """A pendulum; q and v are the angle from the lowest position and its rate at t = 0."""

    length: arb
    g: arb
    pivot: tuple[arb, ...]
    body: str

    def equation(self, mode, t):
        w2 = self.g / self.length
        return lambda q, v: [q[0].sin() * -w2]

    def guards(self, mode, t, q, v, a):
        return {}

    def start(self) -> Next:
        return Next("swing")

    def after(self, mode, guard, t, q, v) -> Next:
        raise AssertionError("a pendulum has no guards")

    def require_unique(self, mode, t, bound) -> None:
        """Do nothing: the equation is Lipschitz, so that the a-priori enclosure suffices."""

    def columns(self, t, q, v):
        sine, cosine, l, name = q[0].sin(), q[0].cos(), self.length, self.body
        return {
            f"{name}.x": self.pivot[0] + l * sine,
            f"{name}.y": self.pivot[1] - l * cosine,
            f"{name}.vx": l * v[0] * cosine,
            f"{name}.vy": l * v[0] * sine,
        }

    @classmethod
    def from_scene(cls, scene: Scene) -> Pendulum:
        """Return the pendulum of a scene, whose start is assumed to satisfy the constraint."""
        reader = SceneReader(scene, PENDULUM)
        rod = reader.element("rod")
        mass = reader.body("mass")
        pivot, length = rod.points[1], rod.law.value
        # angle and rate of the start by the arm and the moment of the velocity about the pivot
        arm = [place - origin for place, origin in zip(mass.position, pivot)]
        moment = arm[0] * mass.velocity[1] - arm[1] * mass.velocity[0]
        rate = ZERO if moment.is_zero else moment / (length * length)
        return cls(
            length=length.ball,
            g=-reader.gravity[1].ball,
            pivot=balls(pivot),
            body=reader.match.bodies["mass"],
            q=[arb.atan2(arm[0].ball, -arm[1].ball)],
            v=[rate.ball],
            t_end=reader.t_end,
        )
