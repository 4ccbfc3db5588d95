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

from flint import arb, arb_series

from stiction.comparisons.proof.enclosures.arc import APriori
from stiction.comparisons.proof.enclosures.exact import ONE, ZERO, Exact
from stiction.comparisons.proof.enclosures.series import Value, quotient
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import SineLoad
from stiction.comparisons.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.comparisons.proof.mechanisms.scene_reader import SceneReader, balls
from stiction.comparisons.truth.structure import ANY, CENTRE, FORWARD, NEGATIVE, SEVERAL, Part, Structure
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Translational

_OTHERS = {"springs": Part(LinearSpring, "slider", GROUND, count=SEVERAL, points=(CENTRE, ANY)),
           "loads": Part(Force, "slider", count=SEVERAL, point=CENTRE, law=Constant | Sine)}
_MASS = "one mass on a straight guide"
ALONE = Structure(_MASS, ("slider",), {
    "guide": Part(Translational, "slider", GROUND, slider_point=CENTRE), **_OTHERS}, any_names=True)
WITH_BAR = Structure(f"{_MASS}, with a bar", ("slider", "bar"), {
    "guide": Part(Translational, "slider", GROUND, slider_point=CENTRE, angle=0), **_OTHERS,
    "pin": Part(Revolute, "bar", "slider", points=((NEGATIVE, 0), CENTRE)),
    "motor": Part(Drive, "bar", "slider", type="angle", law=Linear)}, any_names=True)
ON_BELT = Structure(f"{_MASS} that a drive moves", ("slider", "belt"), {
    "guide": Part(Translational, "slider", "belt", slider_point=CENTRE), **_OTHERS,
    "track": Part(Translational, "belt", GROUND, direction=FORWARD, frictional=False),
    "drive": Part(Drive, "belt", GROUND, type="distance", axis=FORWARD, law=Linear)}, any_names=True)


@dataclass(frozen=True)
class SlidingMass(OneSlider):
    """Parameters as in the module's text.

    `weight` is W; `force` all that is constant along the guide, k x0 included; `c`, `g`, `rate`, `angle` are of the bar
    (c = 0 without one). `names` are the columns of x and x'. The slider, `body`, is at offset + x along; `bar` has its
    name and l, `belt` its name and its place at t = 0.
    """

    mass: arb
    weight: arb
    force: arb
    loads: tuple[SineLoad, ...]
    stiffness: arb
    damping: arb
    c: arb
    g: arb
    rate: arb
    angle: arb
    contact: Contact
    at_rest: bool
    surface: arb
    q: list[arb]
    v: list[arb]
    t_end: arb
    joint: str
    names: tuple[str, str]
    body: str
    along: tuple[arb, arb]
    offset: tuple[arb, arb]
    bar: tuple[str, arb] | None
    belt: tuple[str, arb] | None

    def _theta(self, t: arb_series) -> arb_series:
        return self.rate * t + self.angle

    def _normal(self, t: arb_series) -> arb_series:
        """R."""
        return self.weight - self.c * self.rate ** 2 * self._theta(t).sin()

    def _load(self, t: arb_series) -> arb_series:
        """P without spring and damper."""
        force = self.force + self.c * self.rate ** 2 * self._theta(t).cos()
        return sum((load(t) for load in self.loads), force)

    def _moment(self, t: arb_series, a: Value) -> Value:
        """M."""
        theta = self._theta(t)
        return self.c * self.g * theta.cos() - a * (self.c * theta.sin())

    def contact_loads(self, t, q, v, a):
        return self._normal(t), self._moment(t, a[0]), self._load(t) - q[0] * self.stiffness - v[0] * self.damping

    def equation(self, mode: Mode, t: arb_series):
        (slip, e1, e2), contact, zero = mode, self.contact, arb_series([0], t.prec)
        if slip == 0:
            return lambda q, v: [zero]
        friction, inertia = contact.friction(slip), arb_series([self.mass], t.prec)
        N = contact.load(self._normal(t), self._moment(t, zero), mode)
        if e1 != e2:
            inertia = inertia - friction * e2 * (2 / contact.between_corners) * self.c * self._theta(t).sin()
        factor = quotient(arb_series([1], t.prec), inertia)
        push = (self._load(t) - friction * N) * factor
        stiffness, damping = factor * self.stiffness, factor * self.damping
        if e1 == e2:
            stiffness, damping = stiffness[0], damping[0]
        return lambda q, v: [push - q[0] * stiffness - v[0] * damping]

    def require_unique(self, mode: Mode, t: arb, bound: APriori | None = None) -> None:
        contact = self.contact
        if contact.length is None or contact.frictionless:
            return
        gain = 2 / contact.length * self.c * abs(self._theta(t).sin())
        if not (contact.mus if mode[0] == 0 else contact.mu) * gain < self.mass:
            raise Undecided("friction gain < 1, on which existence and uniqueness rest", t)

    def columns(self, t: Value, q, v) -> dict[str, Value]:
        return dict(zip(self.names, (q[0], v[0])))

    def bodies(self, t: Value, q, v) -> dict[str, Value]:
        found, body = self.columns(t, q, v), self.body
        for i, axis in enumerate("xy"):
            found[f"{body}.{axis}"] = self.offset[i] + q[0] * self.along[i]
            found[f"{body}.v{axis}"] = v[0] * self.along[i]
        if self.bar is not None:
            (name, l), theta = self.bar, self._theta(t)
            x, y = theta.cos() * l, theta.sin() * l
            found |= {f"{name}.x": found[f"{body}.x"] + x, f"{name}.y": found[f"{body}.y"] + y,
                      f"{name}.vx": found[f"{body}.vx"] - y * self.rate,
                      f"{name}.vy": found[f"{body}.vy"] + x * self.rate, f"{name}.angle": theta}
        if self.belt is not None:
            name, x = self.belt
            found |= {f"{name}.x": x + t * self.surface, f"{name}.vx": t * 0 + self.surface}
        return found

    @classmethod
    def from_scene(cls, scene: Scene) -> SlidingMass:
        joints = {type(joint) for joint in scene.joints.values()}
        structure = WITH_BAR if Revolute in joints else ON_BELT if len(scene.bodies) == 2 else ALONE
        return _Reader(scene, structure).mechanism()


class _Reader(SceneReader):
    """A scene read as a sliding mass; `along` is the direction of its guide."""

    def __init__(self, scene: Scene, structure: Structure):
        super().__init__(scene, structure)
        self.name, self.slider = self.found.name("guide"), self.found.bodies["slider"]
        self.bar, self.belt = self.found.bodies.get("bar"), self.found.bodies.get("belt")
        self.direction, self.point = (self.vector("joints", self.name, part) for part in ("direction", "point"))
        size = _dot(self.direction, self.direction).sqrt()
        self.along = self.direction[0] / size, self.direction[1] / size
        self.position, self.velocity = self.place("slider", "position"), self.place("slider", "velocity")
        self.horizontal = self.along[0].factors is not None and self.along[0].equals(ONE) and self.along[1].is_zero
        self.require(self.horizontal or structure is ALONE, f"joints.{self.name}: expected the direction (1, 0)")

    def mechanism(self) -> SlidingMass:
        name, slider, along, gravity = self.name, self.slider, self.along, self.gravity()
        self.require(not self.bar or gravity[0].is_zero,
                     f"gravity: found {self.scene.gravity}; expected (0, -g) with a bar")
        m1 = self.body("bar", "mass") if self.bar else ZERO
        mass, c = self.body("slider", "mass") + m1, -m1 * self.part("joints", "pin", "points", 0, 0)
        rate, angle = (self.part("drives", "motor", "law", part) for part in ("rate", "offset"))
        surface, across = self.part("drives", "drive", "law", "rate"), along[0] * gravity[1] - along[1] * gravity[0]
        constant, loads = self._loads()
        stiffness, damping, force = self._springs(mass * _dot(gravity, along) + constant)
        x, speed, names = _dot(self.position, along), _dot(self.velocity, along), (f"{slider}.x", f"{slider}.vx")
        if not self.horizontal:  # the displacement counts from the guide's point; the spring's anchor moves with it
            origin, names = _dot(self.point, along), (f"{name}.displacement", f"{name}.slip_velocity")
            x, force = x - origin, force - stiffness * origin
        found = SlidingMass(
            mass=mass.ball, weight=-(mass * across).ball, force=force.ball, loads=loads, stiffness=stiffness.ball,
            damping=damping.ball, c=c.ball, g=-gravity[1].ball, rate=rate.ball, angle=angle.ball,
            contact=Contact.of(self, name), at_rest=speed.equals(surface), surface=surface.ball, q=[x.ball],
            v=[speed.ball], t_end=self("t_end").ball, joint=name, names=names, body=slider, along=balls(along),
            offset=balls(p - x * d for p, d in zip(self.position, along)),
            bar=(self.bar, (c / m1).ball) if self.bar else None,
            belt=(self.belt, self.body("belt", "position", 0).ball) if self.belt else None)
        turn = [self.body("bar", "angular_velocity") - rate] if self.bar else []
        self.require_start(found, self._off_the_guide() + turn)
        return found

    def _loads(self) -> tuple[Exact, tuple[SineLoad, ...]]:
        for key in self.found.elements["loads"]:
            self.require(self._parallel(self.vector("forces", key, "direction")),
                         f"forces.{key}: expected a force along the guide")
        return self.loads("loads")

    def _springs(self, force: Exact) -> tuple[Exact, Exact, Exact]:
        """Stiffness and damping of all springs, and a constant force with theirs at x = 0."""
        height = self.scene.bodies[self.slider].position[1]
        stiffness, damping = ZERO, ZERO
        for key, spring in self.found.elements["springs"].items():
            at = ("springs", key)
            k, rest_length = self(*at, "stiffness"), self(*at, "rest_length")
            self.require(self._parallel(self.vector(*at, "axis")) if spring.axis is not None else
                         rest_length.is_zero and self.horizontal and spring.points[1][1] == height,
                         f"springs.{key}: expected one along the guide")
            stiffness, damping = stiffness + k, damping + self(*at, "damping")
            force = force + k * (_dot(self.vector(*at, "points", 1), self.along) + rest_length)
        return stiffness, damping, force

    def _off_the_guide(self) -> list[Exact]:
        """Numbers that are zero where the slider starts on its guide."""
        across = -self.along[1], self.along[0]
        offset, moving = _dot(self.position, across) - _dot(self.point, across), _dot(self.velocity, across)
        if self.belt is not None:
            return [offset - _dot(self.place("belt", "position"), across), moving]
        turned = self.body("slider", "angle") - self("joints", self.name, "angle")
        return [offset, moving, turned, self.body("slider", "angular_velocity")]

    def _parallel(self, vector: tuple[Exact, Exact]) -> bool:
        """Return whether a vector has the guide's direction; false where its numbers cannot be compared."""
        cross = vector[0] * self.direction[1] - vector[1] * self.direction[0]
        return cross.product is not None and cross.is_zero and bool(_dot(vector, self.direction).ball > 0)


def _dot(a: tuple[Exact, Exact], b: tuple[Exact, Exact]) -> Exact:
    return a[0] * b[0] + a[1] * b[1]
