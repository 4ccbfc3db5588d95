"""A slider with friction on an arm that turns, free or driven at a constant rate: two degrees of freedom, or one and a given angle.

By Newton's and Euler's laws in polar coordinates of the slider's centre: r along the arm, th the arm's angle, e and n its direction and
normal. The arm is held at its centre of mass and the slider turns with it:

- slider along the arm:     m (r'' - r th'^2) = -k (r - r0) - d r' + m g.e - s mu N ;
- slider across the arm:    R = m (r th'' + 2 r' th' - g.n) ;
- slider about its centre:  M = Is th'' ;
- arm about its pivot:      J th'' = -M - r R - kt (th - th0) - dt th' ,  or th'' = 0 with a drive.

The last three give th'' = [-kt (th - th0) - dt th' - m r (2 r' th' - g.n)] / (J + Is + m r^2), without friction or r'': so are R and M, and
accelerations are unique whatever the coefficients. P is the first line without friction and r''. The rest: `one_slider.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from stiction.comparisons.proof.enclosures.exact import ZERO, Exact, ExactScene
from stiction.comparisons.proof.enclosures.series import Value, cos, quotient, sin
from stiction.comparisons.proof.mechanisms.mechanism import requirement
from stiction.comparisons.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import LinearSpring, Revolute


@dataclass(frozen=True)
class MovingGuide(OneSlider):
    """Parameters as in the module's text; `arm` is J, `slider` is Is; (k, d, r0) and (kt, dt, th0) of the springs; `names` of arm and slider."""

    m: arb
    slider: arb
    arm: arb
    gravity: tuple[arb, arb]
    spring: tuple[arb, arb, arb]
    twist: tuple[arb, arb, arb]
    driven: bool
    contact: Contact
    at_rest: bool
    q: list[arb]
    v: list[arb]
    t_end: arb
    joint: str
    names: tuple[str, str]
    pivot: tuple[arb, arb]
    surface: arb = ZERO.ball

    def _along(self, th: Value) -> Value:
        """m g.e."""
        return cos(th) * (self.m * self.gravity[0]) + sin(th) * (self.m * self.gravity[1])

    def _across(self, th: Value) -> Value:
        """m g.n."""
        return cos(th) * (self.m * self.gravity[1]) - sin(th) * (self.m * self.gravity[0])

    def _turn(self, q: list[Value], v: list[Value]) -> Value:
        """th''."""
        if self.driven:
            return v[1] * 0
        kt, dt, th0 = self.twist
        moment = (q[1] - th0) * -kt - v[1] * dt - q[0] * (v[0] * v[1] * (2 * self.m) - self._across(q[1]))
        return quotient(moment, q[0] * q[0] * self.m + (self.arm + self.slider))

    def _loads(self, q: list[Value], v: list[Value], turn: Value) -> tuple[Value, Value, Value]:
        k, d, r0 = self.spring
        R = (q[0] * turn + v[0] * v[1] * 2) * self.m - self._across(q[1])
        P = q[0] * v[1] * v[1] * self.m - (q[0] - r0) * k - v[0] * d + self._along(q[1])
        return R, turn * self.slider, P

    def contact_loads(self, t, q, v, a):
        return self._loads(q, v, a[1])

    def timed(self, mode: Mode):
        slip, e1, e2 = mode
        contact = self.contact
        friction, E, T = contact.friction(slip), (e1 + e2) // 2, (e2 - e1) // 2

        def acceleration(q: list[Value], v: list[Value]) -> list[Value]:
            turn = self._turn(q, v)
            if slip == 0:
                return [turn * 0, turn]
            R, M, P = self._loads(q, v, turn)
            N = contact.difference(R, M, friction) * T if T else R * E
            return [(P - N * friction) / self.m, turn]

        return lambda instant, order: acceleration

    def require_unique(self, mode, t, bound=None) -> None:
        """Accelerations do not enter what friction depends on: one solution, by the a-priori enclosure."""

    def columns(self, t, q, v) -> dict[str, Value]:
        arm, _ = self.names
        return {f"{self.joint}.displacement": q[0], f"{self.joint}.slip_velocity": v[0], f"{arm}.angle": q[1], f"{arm}.omega": v[1]}

    def bodies(self, t, q, v) -> dict[str, Value]:
        (r, th), (speed, turn), name, sine, cosine = q, v, self.names[1], sin(q[1]), cos(q[1])
        across = r * turn
        return self.columns(t, q, v) | {
            f"{name}.x": r * cosine + self.pivot[0], f"{name}.y": r * sine + self.pivot[1], f"{name}.vx": speed * cosine - across * sine,
            f"{name}.vy": speed * sine + across * cosine, f"{name}.angle": th, f"{name}.omega": turn}

    @classmethod
    def from_scene(cls, scene: Scene) -> MovingGuide:
        """Parameters of a scene, exact, at the working precision.

        Raises
        ------
        NotThisMechanism
            Naming what keeps the scene from being one.
        """
        require = requirement(scene, "a slider on a turning arm")
        pins = {name: joint for name, joint in scene.joints.items() if isinstance(joint, Revolute)}
        require(len(scene.guides) == len(pins) == 1 and len(scene.joints) == len(scene.bodies) == 2,
                "joints, bodies: expected an arm on one pin and a slider on one guide")
        ((pin_name, pin),), ((name, guide),) = pins.items(), scene.guides.items()
        arm, slider = pin.bodies[0], guide.slider
        require(pin.bodies == (arm, GROUND) and pin.points[0] == (0, 0), f"joints.{pin_name}: expected the arm's centre on the ground")
        require(guide.guide == arm and guide.direction[0] > 0 and guide.direction[1] == 0 and guide.point == guide.slider_point == (0, 0)
                and guide.angle == 0, f"joints.{name}: expected the slider's centre along the arm's x axis")
        require(not scene.forces, f"forces: found {', '.join(scene.forces)}; expected none")
        e = ExactScene(scene)
        spring, twist = (ZERO,) * 3, (ZERO,) * 3
        for key, element in scene.springs.items():
            at = ("springs", key)
            if isinstance(element, LinearSpring):
                require(element.bodies == (slider, arm) and element.points[0] == (0, 0) and element.points[1][1] == 0 and element.axis is not None
                        and element.axis[0] > 0 and element.axis[1] == 0 and spring[0] is ZERO, f"springs.{key}: expected one of slider against arm along (1, 0)")
                spring = e(*at, "stiffness"), e(*at, "damping"), e(*at, "points", 1, 0) + e(*at, "rest_length")
            else:
                require(element.bodies == (arm, GROUND) and twist[0] is ZERO, f"springs.{key}: expected one of arm against ground")
                twist = e(*at, "stiffness"), e(*at, "damping"), e(*at, "rest_angle")
        for key, drive in scene.drives.items():
            require(len(scene.drives) == 1 and drive.type == "angle" and drive.bodies == (arm, GROUND) and isinstance(drive.law, Linear)
                    and e("drives", key, "law", "offset").equals(e("bodies", arm, "angle"))
                    and e("drives", key, "law", "rate").equals(e("bodies", arm, "angular_velocity")),
                    f"drives.{key}: expected at most one linear angle drive of the arm, that meets its start")
        angle, turn = e("bodies", arm, "angle"), e("bodies", arm, "angular_velocity")
        pivot = e.vector("joints", pin_name, "points", 1)
        place = [p.ball - o.ball for p, o in zip(e.vector("bodies", slider, "position"), pivot)]
        speed = [x.ball for x in e.vector("bodies", slider, "velocity")]
        cosine, sine = angle.ball.cos(), angle.ball.sin()
        r, rate = (x * cosine + y * sine for x, y in (place, speed))
        across, moving = (y * cosine - x * sine for x, y in (place, speed))
        meets = [across, moving - r * turn.ball, (e("bodies", slider, "angle") - angle).ball,
                 (e("bodies", slider, "angular_velocity") - turn).ball, *(x.ball for x in e.vector("bodies", arm, "velocity"))]
        require(all(value.contains(0) for value in meets), "bodies: the start violates the constraints")
        still = all(x.is_zero for x in e.vector("bodies", slider, "velocity")) and turn.is_zero
        gravity = e.vector("gravity") if scene.gravity is not None else (ZERO, ZERO)

        def balls(values: tuple[Exact, ...]) -> tuple[arb, ...]:
            return tuple(value.ball for value in values)

        return cls(e("bodies", slider, "mass").ball, e("bodies", slider, "inertia").ball, e("bodies", arm, "inertia").ball, balls(gravity),
                   balls(spring), balls(twist), bool(scene.drives), Contact.of(e, name), still, [r, angle.ball],
                   [ZERO.ball if still else rate, turn.ball], e("t_end").ball, name, (arm, slider), balls(pivot))
