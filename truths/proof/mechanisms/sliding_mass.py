"""One mass that slides along a straight guide, with or without a bar that a motor turns on it.

Derived from Newton's and Euler's laws for slider-bar (Zhuang & Wang 2014, Sect. 5), block on an incline, mass on a
spring with dry friction (Den Hartog 1931) and mass on a belt at once. x is the slider's coordinate along the guide,
s = sgn(x' - u) the direction of slip on a surface of constant speed u. The bar (mass m1, centre of mass at distance l
from its pin in the slider) turns at the constant rate w, th = th0 + w t, so that with c = m1 l its centre of mass has
the acceleration (x'' - l w^2 cos th, -l w^2 sin th):

- everything along the guide:    m x'' = P - s mu N ,   P = F(t) - k (x - x0) - d x' + c w^2 cos th ;
- everything across the guide:   R = n1 + n2 = W - c w^2 sin th ,  W the weight across ;
- the bar about its pin:         M = c (g cos th - x'' sin th)  is the motor's torque, which the guide has to balance.

With N = E R + T D, E = (e1 + e2)/2, T = (e2 - e1)/2 by the signs of the corner forces (`one_slider.py`, as for D and
rest),

    [m - s mu T (2/a) c sin th] x'' = P - s mu (E R + T (2/a) (c g cos th + s mu (b/2) R)) .

x'' is unique, and depends continuously on the state, where the friction gain mu (2/a) c |sin th| is less than m: the
equation m x'' + s mu max(|R|, |D(x'')|) = P then has an increasing left side. The same with mus for what follows rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import arb, arb_series

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Translational
from stiction.truths.proof.enclosures.arc import APriori
from stiction.truths.proof.enclosures.exact import ONE, ZERO, Exact
from stiction.truths.proof.enclosures.series import Value, quotient
from stiction.truths.proof.enclosures.zeros import Undecided
from stiction.truths.proof.mechanisms.mechanism import Load
from stiction.truths.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.truths.proof.mechanisms.scene_reader import SceneReader, balls
from stiction.truths.structure import ANY, CENTRE, FORWARD, NEGATIVE, SEVERAL, Part, Structure

Vector = Any
"""Two exact numbers, by their index."""
_OTHERS = {
    "springs": Part(LinearSpring, "slider", GROUND, count=SEVERAL, points=(CENTRE, ANY)),
    "loads": Part(Force, "slider", count=SEVERAL, point=CENTRE, law=Constant | Sine),
}
_MASS = "one mass on a straight guide"
ALONE = Structure(
    _MASS,
    ("slider",),
    {"guide": Part(Translational, "slider", GROUND, slider_point=CENTRE), **_OTHERS},
    any_names=True,
)
WITH_BAR = Structure(
    f"{_MASS}, with a bar",
    ("slider", "bar"),
    {
        "guide": Part(Translational, "slider", GROUND, slider_point=CENTRE, angle=0),
        **_OTHERS,
        "pin": Part(Revolute, "bar", "slider", points=((NEGATIVE, 0), CENTRE)),
        "motor": Part(Drive, "bar", "slider", type="angle", law=Linear),
    },
    any_names=True,
)
ON_BELT = Structure(
    f"{_MASS} that a drive moves",
    ("slider", "belt"),
    {
        "guide": Part(Translational, "slider", "belt", slider_point=CENTRE),
        **_OTHERS,
        "track": Part(Translational, "belt", GROUND, direction=FORWARD, frictional=False),
        "drive": Part(Drive, "belt", GROUND, type="distance", axis=FORWARD, law=Linear),
    },
    any_names=True,
)


@dataclass(frozen=True, kw_only=True)
class SlidingMass(OneSlider):
    """Parameters as in the module's text.

    `weight` is W; `force` all that is constant along the guide, k x0 included; `c`, `g`, `rate`, `angle` are of the bar
    (c = 0 without one). `names` are the columns of x and x'. The slider, `body`, is at offset + x along; `bar` has its
    name and l, `belt` its name and its place at t = 0.
    """

    mass: arb
    weight: arb
    force: arb
    loads: tuple[Load, ...]
    stiffness: arb
    damping: arb
    c: arb
    g: arb
    rate: arb
    angle: arb
    names: tuple[str, str]
    body: str
    along: tuple[arb, ...]
    offset: tuple[arb, ...]
    bar: tuple[str, arb] | None
    belt: tuple[str, arb] | None

    def _theta(self, t: arb_series) -> arb_series:
        return self.rate * t + self.angle

    def _normal(self, t: arb_series) -> arb_series:
        """Return R."""
        return self.weight - self.c * self.rate**2 * self._theta(t).sin()

    def _load(self, t: arb_series) -> arb_series:
        """Return P without spring and damper."""
        force = self.force + self.c * self.rate**2 * self._theta(t).cos()
        return sum((load(t) for load in self.loads), force)

    def _moment(self, t: arb_series, a: Value) -> Value:
        """Return M."""
        theta = self._theta(t)
        return self.c * self.g * theta.cos() - a * (self.c * theta.sin())

    def contact_loads(self, t, q, v, a):
        return (
            self._normal(t),
            self._moment(t, a[0]),
            self._load(t) - q[0] * self.stiffness - v[0] * self.damping,
        )

    def equation(self, mode: Mode, t: arb_series):
        (slip, e1, e2), contact, zero = mode, self.contact, arb_series([0], t.prec)
        if slip == 0:
            return lambda q, v: [zero]
        # The bracket of the module's last equation, and its right side: both depend on time alone.
        # Only where the slider is tilted (corners on both surfaces) does the bar's torque, and with
        # it x'', enter N.
        friction, inertia = contact.friction(slip), arb_series([self.mass], t.prec)
        N = contact.load(self._normal(t), self._moment(t, zero), mode)
        if e1 != e2:
            inertia = inertia - friction * e2 * (2 / contact.length) * self.c * self._theta(t).sin()
        factor = quotient(arb_series([1], t.prec), inertia)
        push = (self._load(t) - friction * N) * factor
        stiffness, damping = factor * self.stiffness, factor * self.damping
        if e1 == e2:
            # constants in place of series: products with them are cheaper
            stiffness, damping = stiffness[0], damping[0]
        return lambda q, v: [push - q[0] * stiffness - v[0] * damping]

    def require_unique(self, mode: Mode, t: arb, bound: APriori | None = None) -> None:
        contact = self.contact
        if contact.length is None or contact.frictionless:
            return
        gain = 2 / contact.length * self.c * abs(self._theta(t).sin())
        if not (contact.mus if mode[0] == 0 else contact.mu) * gain < self.mass:
            raise Undecided("friction gain < 1, on which existence and uniqueness rest", t)

    def columns(self, t, q, v):
        return dict(zip(self.names, (q[0], v[0])))

    def bodies(self, t, q, v):
        columns, body = self.columns(t, q, v), self.body
        for i, axis in enumerate("xy"):
            columns[f"{body}.{axis}"] = self.offset[i] + q[0] * self.along[i]
            columns[f"{body}.v{axis}"] = v[0] * self.along[i]
        if self.bar is not None:
            name, l = self.bar
            theta = self._theta(t)
            x, y = theta.cos() * l, theta.sin() * l
            columns |= {
                f"{name}.x": columns[f"{body}.x"] + x,
                f"{name}.y": columns[f"{body}.y"] + y,
                f"{name}.vx": columns[f"{body}.vx"] - y * self.rate,
                f"{name}.vy": columns[f"{body}.vy"] + x * self.rate,
                f"{name}.angle": theta,
            }
        if self.belt is not None:
            name, x = self.belt
            columns |= {f"{name}.x": x + t * self.surface, f"{name}.vx": t * 0 + self.surface}
        return columns

    @classmethod
    def from_scene(cls, scene: Scene) -> SlidingMass:
        reader = SceneReader(scene, _structure_of(scene))
        guide = reader.element("guide")
        slider = reader.body("slider")
        gx, gy = reader.gravity
        name = reader.match.name("guide")
        body, belt = reader.match.bodies["slider"], reader.match.bodies.get("belt")
        size = _dot(guide.direction, guide.direction).sqrt()
        along = guide.direction[0] / size, guide.direction[1] / size
        horizontal = along[0].factors is not None and along[0].equals(ONE) and along[1].is_zero
        reader.require(
            horizontal or reader.structure is ALONE, f"joints.{name}: expected the direction (1, 0)"
        )
        residuals = _off_the_guide(reader, along)

        # The bar adds to the mass that moves along the guide; without one its terms are zero.
        mass, c, rate, angle, bar = slider.mass, ZERO, ZERO, ZERO, None
        if reader.structure is WITH_BAR:
            reader.require(
                gx.is_zero, f"gravity: found {scene.gravity}; expected (0, -g) with a bar"
            )
            turning = reader.body("bar")
            law = reader.element("motor").law
            l = -reader.element("pin").points[0][0]
            mass, c = mass + turning.mass, turning.mass * l
            rate, angle = law.rate, law.offset
            bar = reader.match.bodies["bar"], l.ball
            residuals["rate of the bar"] = turning.angular_velocity - rate

        # Of all loads along the guide, the constant parts are summed.
        surface = reader.element("drive").law.rate if belt else ZERO
        for key, load in reader.elements("loads").items():
            reader.require(
                _parallel(load.direction, guide.direction),
                f"forces.{key}: expected a force along the guide",
            )
        constant, loads = reader.loads("loads")
        stiffness, damping, pull = _springs(reader, along, horizontal)
        x, speed = _dot(slider.position, along), _dot(slider.velocity, along)
        names = f"{body}.x", f"{body}.vx"
        force = mass * _dot(reader.gravity, along) + constant + pull
        if not horizontal:
            # the displacement counts from the guide's point; the spring's anchor moves with it
            origin = _dot(guide.point, along)
            names = f"{name}.displacement", f"{name}.slip_velocity"
            x, force = x - origin, force - stiffness * origin
        mechanism = cls(
            mass=mass.ball,
            weight=-(mass * (along[0] * gy - along[1] * gx)).ball,
            force=force.ball,
            loads=loads,
            stiffness=stiffness.ball,
            damping=damping.ball,
            c=c.ball,
            g=-gy.ball,
            rate=rate.ball,
            angle=angle.ball,
            contact=Contact.of(guide),
            at_rest=speed.equals(surface),
            surface=surface.ball,
            q=[x.ball],
            v=[speed.ball],
            t_end=reader.t_end,
            joint=name,
            names=names,
            body=body,
            along=balls(along),
            offset=balls(p - x * d for p, d in zip(slider.position, along)),
            bar=bar,
            belt=(belt, reader.body("belt").position[0].ball) if belt else None,
        )
        reader.require_start(mechanism, residuals)
        return mechanism


def _structure_of(scene: Scene) -> Structure:
    """Return the structure that a scene is most similar to, for messages about what does not fit."""
    if any(isinstance(joint, Revolute) for joint in scene.joints.values()):
        return WITH_BAR
    return ON_BELT if len(scene.bodies) == 2 else ALONE


def _springs(reader: SceneReader, along: Vector, horizontal: bool) -> Vector:
    """Return stiffness and damping of all springs, and their constant force at x = 0."""
    height = reader.scene.bodies[reader.match.bodies["slider"]].position[1]
    direction = reader.element("guide").direction
    stiffness = damping = force = ZERO
    for key, spring in reader.elements("springs").items():
        # A spring without an axis pulls along the line between its ends: linear in x only on the
        # guide's own line and without a rest length.
        if spring.axis is not None:
            along_the_guide = _parallel(spring.axis, direction)
        else:
            level = reader.match.elements["springs"][key].points[1][1] == height
            along_the_guide = spring.rest_length.is_zero and horizontal and level
        reader.require(along_the_guide, f"springs.{key}: expected one along the guide")
        stiffness, damping = stiffness + spring.stiffness, damping + spring.damping
        force = force + spring.stiffness * (_dot(spring.points[1], along) + spring.rest_length)
    return stiffness, damping, force


def _off_the_guide(reader: SceneReader, along: Vector) -> dict[str, Exact]:
    """Return numbers that are zero where the slider starts on its guide, by what they are."""
    guide = reader.element("guide")
    slider = reader.body("slider")
    across = (-along[1], along[0])
    offset = _dot(slider.position, across) - _dot(guide.point, across)
    residuals = {"velocity across the guide": _dot(slider.velocity, across)}
    if "belt" in reader.match.bodies:
        offset = offset - _dot(reader.body("belt").position, across)
    else:
        residuals["angle in the guide"] = slider.angle - guide.angle
        residuals["angular velocity in the guide"] = slider.angular_velocity
    residuals["position across the guide"] = offset
    return residuals


def _parallel(vector: Vector, direction: Vector) -> bool:
    """Return True if two vectors have the same direction; False if their numbers cannot be compared."""
    cross = vector[0] * direction[1] - vector[1] * direction[0]
    return cross.product is not None and cross.is_zero and bool(_dot(vector, direction).ball > 0)


def _dot(a: Vector, b: Vector) -> Exact:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1]
