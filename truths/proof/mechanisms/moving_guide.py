"""A slider with friction on an arm that turns, free or driven at a constant rate.

By Newton's and Euler's laws in polar coordinates of the slider's centre: r along the arm, th the arm's angle, e and n
its direction and normal. The arm is held at its centre of mass and the slider turns with it:

- slider along the arm:     m (r'' - r th'^2) = -k (r - r0) - d r' + m g.e - s mu N ;
- slider across the arm:    R = m (r th'' + 2 r' th' - g.n) ;
- slider about its centre:  M = Is th'' ;
- arm about its pivot:      J th'' = -M - r R - kt (th - th0) - dt th' ,  or th'' = 0 with a drive.

The last three give th'' = [-kt (th - th0) - dt th' - m r (2 r' th' - g.n)] / (J + Is + m r^2), without friction or r'':
so are R and M, and accelerations are unique whatever the coefficients. P is the first line without friction and r''.
The rest: `one_slider.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from stiction.scenes import Scene
from stiction.truths.proof.enclosures.exact import ZERO
from stiction.truths.proof.enclosures.series import Value, quotient
from stiction.truths.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.truths.proof.mechanisms.scene_reader import SceneReader, balls
from stiction.truths.reduced.moving_guide import TURNING_ARM


@dataclass(frozen=True, kw_only=True)
class MovingGuide(OneSlider):
    """Parameters as in the module's text.

    `arm` is J, `slider` is Is; `spring` is (k, d, r0), `twist` is (kt, dt, th0).
    """

    m: arb
    slider: arb
    arm: arb
    gravity: tuple[arb, ...]
    spring: tuple[arb, ...]
    twist: tuple[arb, ...]
    driven: bool
    pivot: tuple[arb, ...]

    def _across(self, th: Value) -> Value:
        """Return m g.n, N."""
        return th.cos() * (self.m * self.gravity[1]) - th.sin() * (self.m * self.gravity[0])

    def _loads(self, q: list[Value], v: list[Value], turn: Value) -> tuple[Value, Value, Value]:
        """Return R, M and P with th'' = turn."""
        k, d, r0 = self.spring
        R = (q[0] * turn + v[0] * v[1] * 2) * self.m - self._across(q[1])
        along = q[1].cos() * (self.m * self.gravity[0]) + q[1].sin() * (self.m * self.gravity[1])
        P = q[0] * v[1] * v[1] * self.m - (q[0] - r0) * k - v[0] * d + along
        return R, turn * self.slider, P

    def contact_loads(self, t, q, v, a):
        return self._loads(q, v, a[1])

    def equation(self, mode: Mode, t):
        def acceleration(q: list[Value], v: list[Value]) -> list[Value]:
            # th'' first: it does not depend on friction or r''.
            if self.driven:
                turn = v[1] * 0
            else:
                kt, dt, th0 = self.twist
                coriolis = v[0] * v[1] * (2 * self.m)
                moment = (q[1] - th0) * -kt - v[1] * dt - q[0] * (coriolis - self._across(q[1]))
                turn = quotient(moment, q[0] * q[0] * self.m + (self.arm + self.slider))
            if mode[0] == 0:
                return [turn * 0, turn]
            R, M, P = self._loads(q, v, turn)
            return [
                (P - self.contact.load(R, M, mode) * self.contact.friction(mode[0])) / self.m,
                turn,
            ]

        return acceleration

    def require_unique(self, mode, t, bound=None) -> None:
        """Do nothing: friction does not depend on accelerations, so that the a-priori enclosure suffices."""

    def columns(self, t, q, v):
        return {
            f"{self.joint}.displacement": q[0],
            f"{self.joint}.slip_velocity": v[0],
            "arm.angle": q[1],
            "arm.omega": v[1],
        }

    def bodies(self, t, q, v):
        # polar coordinates about the pivot, which the arm's centre of mass lies at
        (r, th), (speed, turn) = q, v
        sine, cosine, across = th.sin(), th.cos(), r * turn
        return self.columns(t, q, v) | {
            "slider.x": r * cosine + self.pivot[0],
            "slider.y": r * sine + self.pivot[1],
            "slider.vx": speed * cosine - across * sine,
            "slider.vy": speed * sine + across * cosine,
            "slider.angle": th,
            "slider.omega": turn,
        }

    @classmethod
    def from_scene(cls, scene: Scene) -> MovingGuide:
        reader = SceneReader(scene, TURNING_ARM)
        arm = reader.body("arm")
        slider = reader.body("slider")
        motor = reader.optional_element("motor")
        spring = reader.optional_element("spring")
        twist = reader.optional_element("twist")
        origin = reader.element("pivot").points[1]
        reader.require(
            motor is None
            or motor.law.offset.equals(arm.angle)
            and motor.law.rate.equals(arm.angular_velocity),
            "drives: expected one that meets the start of the arm",
        )
        angle, turn = arm.angle, arm.angular_velocity
        x, y = (place.ball - at.ball for place, at in zip(slider.position, origin))
        vx, vy = balls(slider.velocity)
        cosine, sine = angle.ball.cos(), angle.ball.sin()
        # At rest on the arm exactly, or proven to slip: a velocity that is only nearly zero decides
        # nothing.
        at_rest = all(value.is_zero for value in (*slider.velocity, turn))
        mechanism = cls(
            m=slider.mass.ball,
            slider=slider.inertia.ball,
            arm=arm.inertia.ball,
            gravity=balls(reader.gravity),
            spring=balls(
                (spring.stiffness, spring.damping, spring.points[1][0] + spring.rest_length)
                if spring
                else (ZERO,) * 3
            ),
            twist=balls(
                (twist.stiffness, twist.damping, twist.rest_angle) if twist else (ZERO,) * 3
            ),
            driven=motor is not None,
            pivot=balls(origin),
            contact=Contact.of(reader.element("guide")),
            surface=ZERO.ball,
            at_rest=at_rest,
            q=[x * cosine + y * sine, angle.ball],
            v=[ZERO.ball if at_rest else vx * cosine + vy * sine, turn.ball],
            t_end=reader.t_end,
            joint=reader.match.name("guide"),
        )
        reader.require_start(mechanism, {"arm.vx": arm.velocity[0], "arm.vy": arm.velocity[1]})
        return mechanism
