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
from stiction.comparisons.proof.mechanisms.mechanism import SineLoad, time_series
from stiction.comparisons.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.comparisons.proof.mechanisms.scene_reader import CENTRE, SceneReader, along_x, balls, dot, fits
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute


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

    def timed(self, mode: Mode):
        slip, e1, e2 = mode

        def equation(instant: arb, order: int):
            t, contact, zero = time_series(instant, order), self.contact, arb_series([0], order)
            if slip == 0:
                return lambda q, v: [zero]
            friction, inertia = contact.friction(slip), arb_series([self.mass], order)
            N = contact.load(self._normal(t), self._moment(t, zero), mode)
            if e1 != e2:
                inertia = inertia - friction * e2 * (2 / contact.length) * self.c * self._theta(t).sin()
            factor = quotient(arb_series([1], order), inertia)
            push = (self._load(t) - friction * N) * factor
            stiffness, damping = factor * self.stiffness, factor * self.damping
            if e1 == e2:
                stiffness, damping = stiffness[0], damping[0]
            return lambda q, v: [push - q[0] * stiffness - v[0] * damping]

        return equation

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
        return _Reader(scene).mechanism_of_scene()


@dataclass(frozen=True)
class _Bar:
    """A bar that is pinned to the slider and turned against it; without a name where there is none."""

    name: str = ""
    mass: Exact = ZERO
    c: Exact = ZERO
    rate: Exact = ZERO
    angle: Exact = ZERO


class _Reader(SceneReader):
    """A scene read as a sliding mass; `along` is the direction of its guide."""

    def __init__(self, scene: Scene):
        super().__init__(scene, "one mass on a straight guide")
        frictional = scene.frictional_guides or scene.guides
        self.require(len(frictional) == 1, f"joints: found {len(scene.guides)} guides, "
                                           f"{len(scene.frictional_guides)} with friction; expected 1")
        ((self.name, self.guide),) = frictional.items()
        self.slider, e = self.guide.slider, self.exact
        self.require(self.guide.slider_point == CENTRE,
                     f"joints.{self.name}.slider_point: found {self.guide.slider_point}; expected (0, 0)")
        self.direction = e.vector("joints", self.name, "direction")
        size = dot(self.direction, self.direction).sqrt()
        self.along = self.direction[0] / size, self.direction[1] / size
        self.horizontal = self.along[0].factors is not None and self.along[0].equals(ONE) and self.along[1].is_zero
        self.belt = self.guide.guide if self.guide.guide != GROUND else None

    def mechanism_of_scene(self) -> SlidingMass:
        e, name, slider, along = self.exact, self.name, self.slider, self.along
        surface, bar = self._surface(), self._bar()
        self._require_nothing_else(bar)
        mass, gravity = e("bodies", slider, "mass") + bar.mass, self.gravity()
        self.require(not bar.name or gravity[0].is_zero,
                     f"gravity: found {self.scene.gravity}; expected (0, -g) with a bar")
        constant, loads = self._loads()
        stiffness, damping, force = self._springs(mass * dot(gravity, along) + constant)
        position, velocity = e.vector("bodies", slider, "position"), e.vector("bodies", slider, "velocity")
        x, speed = dot(position, along), dot(velocity, along)
        names = f"{slider}.x", f"{slider}.vx"
        if not self.horizontal:  # the displacement counts from the guide's point; the spring's anchor moves with it
            origin = dot(e.vector("joints", name, "point"), along)
            x, force = x - origin, force - stiffness * origin
            names = f"{name}.displacement", f"{name}.slip_velocity"
        across = along[0] * gravity[1] - along[1] * gravity[0]
        found = SlidingMass(
            mass=mass.ball, weight=-(mass * across).ball, force=force.ball, loads=loads, stiffness=stiffness.ball,
            damping=damping.ball, c=bar.c.ball, g=-gravity[1].ball, rate=bar.rate.ball, angle=bar.angle.ball,
            contact=Contact.of(e, name), at_rest=speed.equals(surface), surface=surface.ball, q=[x.ball],
            v=[speed.ball], t_end=e("t_end").ball, joint=name, names=names, body=slider, along=balls(along),
            offset=balls(p - x * d for p, d in zip(position, along)),
            bar=(bar.name, (bar.c / bar.mass).ball) if bar.name else None,
            belt=(self.belt, e("bodies", self.belt, "position", 0).ball) if self.belt else None)
        turn = [e("bodies", bar.name, "angular_velocity") - bar.rate] if bar.name else []
        self.require_start(found, self._off_the_guide() + turn)
        return found

    def _surface(self) -> Exact:
        """Speed of the guide: of a belt that a linear distance drive moves along (1, 0), or zero."""
        if self.belt is None:
            return ZERO
        tracks = [joint for joint in self.scene.guides.values() if joint.slider == self.belt
                  and joint.guide == GROUND and along_x(joint.direction) and not joint.frictional]
        drives = [name for name, drive in self.scene.drives.items()
                  if fits(drive, Drive, bodies=(self.belt, GROUND), type="distance", axis=along_x)
                  and isinstance(drive.law, Linear)]
        self.require(self.horizontal and len(tracks) == len(drives) == 1,
                     f"joints, drives: expected {self.belt} on a track along (1, 0), with a linear distance drive")
        return self.exact("drives", drives[0], "law", "rate")

    def _bar(self) -> _Bar:
        scene, e = self.scene, self.exact
        pins = {name: joint for name, joint in scene.joints.items() if isinstance(joint, Revolute)}
        if not pins:
            return _Bar()
        self.require(len(pins) == len(scene.drives) == 1 and self.horizontal,
                     "joints, drives: expected one pin and one drive, of a bar")
        ((pin_name, pin),), ((drive_name, drive),) = pins.items(), scene.drives.items()
        bar, (on_bar, on_slider) = pin.bodies[0], pin.points
        self.require(pin.bodies[1] == self.slider and on_slider == CENTRE and on_bar[1] == 0 and on_bar[0] < 0,
                     f"joints.{pin_name}: expected a point (-l, 0) of the bar at the slider's centre")
        self.require(fits(drive, Drive, type="angle", bodies=(bar, self.slider)) and isinstance(drive.law, Linear),
                     f"drives.{drive_name}: expected the angle of {bar} against {self.slider}, a linear law")
        self.require(not self.guide.frictional or self.guide.angle == 0, "joints: expected a guide without angle")
        mass = e("bodies", bar, "mass")
        return _Bar(bar, mass, -mass * e("joints", pin_name, "points", 0, 0), e("drives", drive_name, "law", "rate"),
                    e("drives", drive_name, "law", "offset"))

    def _require_nothing_else(self, bar: _Bar) -> None:
        scene, others = self.scene, {part for part in (self.belt, bar.name) if part}
        known = {self.slider, *others}
        self.require(set(scene.bodies) == known,
                     f"bodies: found {', '.join(scene.bodies)}; expected {', '.join(sorted(known))}")
        self.require(len(scene.joints) == 1 + len(others) and len(scene.drives) == len(others),
                     f"joints, drives: expected those of {', '.join(sorted(known))} only")

    def _loads(self) -> tuple[Exact, tuple[SineLoad, ...]]:
        """The constant part of the forces along the guide, and the others."""
        total, loads = ZERO, ()
        for key, load in self.scene.forces.items():
            self.require(fits(load, Force, body=self.slider, point=CENTRE)
                         and self._parallel(self.exact.vector("forces", key, "direction")),
                         f"forces.{key}: expected a force on the slider's centre along the guide")
            constant, sines = self.law(key)
            total, loads = total + constant, loads + sines
        return total, loads

    def _springs(self, force: Exact) -> tuple[Exact, Exact, Exact]:
        """Stiffness and damping of all springs, and a constant force with theirs at x = 0."""
        e, start = self.exact, self.scene.bodies[self.slider].position
        stiffness, damping = ZERO, ZERO
        for key, spring in self.scene.springs.items():
            at = ("springs", key)
            self.require(fits(spring, LinearSpring, bodies=(self.slider, GROUND))
                         and spring.points[0] == CENTRE
                         and (self._parallel(e.vector(*at, "axis")) if spring.axis is not None else
                              e(*at, "rest_length").is_zero and self.horizontal and spring.points[1][1] == start[1]),
                         f"springs.{key}: expected a linear spring from the slider's centre to the ground along the "
                         "guide")
            k, rest_length = e(*at, "stiffness"), e(*at, "rest_length")
            stiffness, damping = stiffness + k, damping + e(*at, "damping")
            force = force + k * (dot(e.vector(*at, "points", 1), self.along) + rest_length)
        return stiffness, damping, force

    def _off_the_guide(self) -> list[Exact]:
        """Numbers that are zero where the slider starts on its guide."""
        e, guide, body = self.exact, self.guide, ("bodies", self.slider)
        across = -self.along[1], self.along[0]
        offset = dot(e.vector(*body, "position"), across) - dot(e.vector("joints", self.name, "point"), across)
        moving = dot(e.vector(*body, "velocity"), across)
        if self.belt is not None:
            return [offset - dot(e.vector("bodies", self.belt, "position"), across), moving]
        return [offset, moving, e(*body, "angle") - e("joints", self.name, "angle"), e(*body, "angular_velocity")]

    def _parallel(self, vector: tuple[Exact, Exact]) -> bool:
        """Return whether a vector has the guide's direction; false where its numbers cannot be compared."""
        direction = self.direction
        cross = vector[0] * direction[1] - vector[1] * direction[0]
        return cross.product is not None and cross.is_zero and bool(dot(vector, direction).ball > 0)
