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

from stiction.comparisons.proof.enclosures.exact import ZERO
from stiction.comparisons.proof.enclosures.series import Value, quotient
from stiction.comparisons.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.comparisons.proof.mechanisms.scene_reader import CENTRE, SceneReader, along_x, balls, fits
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import LinearSpring, Revolute, Translational


@dataclass(frozen=True)
class MovingGuide(OneSlider):
    """Parameters as in the module's text.

    `arm` is J, `slider` is Is; (k, d, r0) and (kt, dt, th0) of the springs; `names` of arm and slider.
    """

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

    def _across(self, th: Value) -> Value:
        """m g.n."""
        return th.cos() * (self.m * self.gravity[1]) - th.sin() * (self.m * self.gravity[0])

    def _turn(self, q: list[Value], v: list[Value]) -> Value:
        """th''."""
        if self.driven:
            return v[1] * 0
        kt, dt, th0 = self.twist
        coriolis = v[0] * v[1] * (2 * self.m)
        moment = (q[1] - th0) * -kt - v[1] * dt - q[0] * (coriolis - self._across(q[1]))
        return quotient(moment, q[0] * q[0] * self.m + (self.arm + self.slider))

    def _loads(self, q: list[Value], v: list[Value], turn: Value) -> tuple[Value, Value, Value]:
        """R, M and P with th'' = turn."""
        k, d, r0 = self.spring
        R = (q[0] * turn + v[0] * v[1] * 2) * self.m - self._across(q[1])
        along = q[1].cos() * (self.m * self.gravity[0]) + q[1].sin() * (self.m * self.gravity[1])
        P = q[0] * v[1] * v[1] * self.m - (q[0] - r0) * k - v[0] * d + along
        return R, turn * self.slider, P

    def contact_loads(self, t, q, v, a):
        return self._loads(q, v, a[1])

    def timed(self, mode: Mode):
        def acceleration(q: list[Value], v: list[Value]) -> list[Value]:
            turn = self._turn(q, v)
            if mode[0] == 0:
                return [turn * 0, turn]
            R, M, P = self._loads(q, v, turn)
            return [(P - self.contact.load(R, M, mode) * self.contact.friction(mode[0])) / self.m, turn]

        return lambda instant, order: acceleration

    def require_unique(self, mode, t, bound=None) -> None:
        """Accelerations do not enter what friction depends on: one solution, by the a-priori enclosure."""

    def columns(self, t, q, v) -> dict[str, Value]:
        arm, _ = self.names
        return {f"{self.joint}.displacement": q[0], f"{self.joint}.slip_velocity": v[0],
                f"{arm}.angle": q[1], f"{arm}.omega": v[1]}

    def bodies(self, t, q, v) -> dict[str, Value]:
        (r, th), (speed, turn), name = q, v, self.names[1]
        sine, cosine, across = th.sin(), th.cos(), r * turn
        return self.columns(t, q, v) | {
            f"{name}.x": r * cosine + self.pivot[0], f"{name}.y": r * sine + self.pivot[1],
            f"{name}.vx": speed * cosine - across * sine, f"{name}.vy": speed * sine + across * cosine,
            f"{name}.angle": th, f"{name}.omega": turn}

    @classmethod
    def from_scene(cls, scene: Scene) -> MovingGuide:
        reader = SceneReader(scene, "a slider on a turning arm")
        e, require = reader.exact, reader.require
        pins = {name: joint for name, joint in scene.joints.items() if isinstance(joint, Revolute)}
        require(len(scene.guides) == len(pins) == 1 and len(scene.joints) == len(scene.bodies) == 2,
                "joints, bodies: expected an arm on one pin and a slider on one guide")
        ((pin_name, pin),), ((name, guide),) = pins.items(), scene.guides.items()
        arm, slider = pin.bodies[0], guide.slider
        require(fits(pin, Revolute, bodies=(arm, GROUND), points=lambda points: points[0] == CENTRE),
                f"joints.{pin_name}: expected the arm's centre on the ground")
        require(fits(guide, Translational, guide=arm, direction=along_x, point=CENTRE, slider_point=CENTRE, angle=0),
                f"joints.{name}: expected the slider's centre along the arm's x axis")
        require(not scene.forces, f"forces: found {', '.join(scene.forces)}; expected none")
        spring, twist = _springs(reader, arm, slider)
        _require_drive(reader, arm)
        angle, turn = e("bodies", arm, "angle"), e("bodies", arm, "angular_velocity")
        pivot, velocity = e.vector("joints", pin_name, "points", 1), e.vector("bodies", slider, "velocity")
        x, y = (place.ball - origin.ball for place, origin in zip(e.vector("bodies", slider, "position"), pivot))
        vx, vy = balls(velocity)
        cosine, sine = angle.ball.cos(), angle.ball.sin()
        still = all(value.is_zero for value in (*velocity, turn))
        v = [ZERO.ball if still else vx * cosine + vy * sine, turn.ball]
        found = cls(e("bodies", slider, "mass").ball, e("bodies", slider, "inertia").ball,
                    e("bodies", arm, "inertia").ball, balls(reader.gravity()), spring, twist, bool(scene.drives),
                    Contact.of(e, name), still, [x * cosine + y * sine, angle.ball], v, e("t_end").ball, name,
                    (arm, slider), balls(pivot))
        reader.require_start(found, e.vector("bodies", arm, "velocity"))
        return found


def _springs(reader: SceneReader, arm: str, slider: str) -> tuple[tuple[arb, ...], tuple[arb, ...]]:
    """(k, d, r0) and (kt, dt, th0); zeros where there is no spring."""
    e, linear, torsional = reader.exact, (), ()
    for key, spring in reader.scene.springs.items():
        at = ("springs", key)
        if isinstance(spring, LinearSpring):
            reader.require(not linear and fits(spring, LinearSpring, bodies=(slider, arm), axis=along_x,
                                               points=lambda points: points[0] == CENTRE and points[1][1] == 0),
                           f"springs.{key}: expected one of slider against arm along (1, 0)")
            linear = e(*at, "stiffness"), e(*at, "damping"), e(*at, "points", 1, 0) + e(*at, "rest_length")
        else:
            reader.require(not torsional and spring.bodies == (arm, GROUND),
                           f"springs.{key}: expected one of arm against ground")
            torsional = e(*at, "stiffness"), e(*at, "damping"), e(*at, "rest_angle")
    return balls(linear or (ZERO,) * 3), balls(torsional or (ZERO,) * 3)


def _require_drive(reader: SceneReader, arm: str) -> None:
    """Check that what drives the arm, if anything, turns it at a constant rate from its start on."""
    e = reader.exact
    for key, drive in reader.scene.drives.items():
        meets = (len(reader.scene.drives) == 1 and drive.type == "angle" and drive.bodies == (arm, GROUND)
                 and isinstance(drive.law, Linear)
                 and e("drives", key, "law", "offset").equals(e("bodies", arm, "angle"))
                 and e("drives", key, "law", "rate").equals(e("bodies", arm, "angular_velocity")))
        reader.require(meets, f"drives.{key}: expected at most one linear angle drive of the arm, that meets its start")
