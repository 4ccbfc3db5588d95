"""One mass that slides along a straight guide, with or without a bar that a motor turns on it; no complementarity problem.

Derived from Newton's and Euler's laws for slider-bar (Zhuang & Wang 2014, Sect. 5), block on an incline, mass on a spring with
dry friction (Den Hartog 1931) and mass on a belt at once. x is the slider's coordinate along the guide, s = sgn(x' - u) the direction of slip
on a surface of constant speed u. The bar (mass m1, centre of mass at distance l from its pin in the slider) turns at the constant
rate w, th = th0 + w t, so that with c = m1 l its centre of mass has the acceleration (x'' - l w^2 cos th, -l w^2 sin th):

- everything along the guide:    m x'' = P - s mu N ,   P = F(t) - k (x - x0) - d x' + c w^2 cos th ;
- everything across the guide:   R = n1 + n2 = W - c w^2 sin th ,  W the weight across ;
- the bar about its pin:         M = c (g cos th - x'' sin th)  is the motor's torque, which the guide has to balance.

With N = E R + T D, E = (e1 + e2)/2, T = (e2 - e1)/2 by the signs of the corner forces (`one_slider.py`, as for D and rest),

    [m - s mu T (2/a) c sin th] x'' = P - s mu (E R + T (2/a) (c g cos th + s mu (b/2) R)) .

x'' is unique, and depends continuously on the state, where the friction gain mu (2/a) c |sin th| is less than m: the equation
m x'' + s mu max(|R|, |D(x'')|) = P then has an increasing left side. The same with mus for what follows rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import arb, arb_series

from stiction.comparisons.proof.enclosures.arc import APriori
from stiction.comparisons.proof.enclosures.exact import ZERO, Exact, ExactScene
from stiction.comparisons.proof.enclosures.series import Value, quotient
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.mechanism import SineLoad, requirement, time_series
from stiction.comparisons.proof.mechanisms.one_slider import Contact, Mode, OneSlider
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine
from stiction.scenes.model import Force, LinearSpring, Revolute


@dataclass(frozen=True)
class SlidingMass(OneSlider):
    """Parameters as in the module's text.

    `weight` is W; `force` all that is constant along the guide, k x0 included; `c`, `g`, `rate`, `angle` are of the bar (c = 0 without one).
    The slider, `body`, is at offset + x along; `bar` has its name and l, `belt` its name and where it is at t = 0.
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
    x: arb
    speed: arb
    t_end: arb
    joint: str
    names: tuple[str, str]
    body: str
    along: tuple[arb, arb]
    offset: tuple[arb, arb]
    bar: tuple[str, arb] | None
    belt: tuple[str, arb] | None

    @property
    def q(self) -> list[arb]:
        return [self.x]

    @property
    def v(self) -> list[arb]:
        return [self.speed]

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
            t = time_series(instant, order)
            if slip == 0:
                return lambda q, v: [arb_series([0], order)]
            contact, E, T = self.contact, (e1 + e2) // 2, (e2 - e1) // 2
            friction, R, inertia = contact.friction(slip), self._normal(t), arb_series([self.mass], order)
            N = E * R
            if T:
                N = T * contact.difference(R, self._moment(t, arb_series([0], order)), friction)
                inertia = inertia - friction * T * (2 / contact.length) * self.c * self._theta(t).sin()
            factor = quotient(arb_series([1], order), inertia)
            push = (self._load(t) - friction * N) * factor
            stiffness, damping = factor * self.stiffness, factor * self.damping
            if T == 0:
                stiffness, damping = stiffness[0], damping[0]
            return lambda q, v: [push - q[0] * stiffness - v[0] * damping]

        return equation

    def require_unique(self, mode: Mode, t: arb, bound: APriori | None = None) -> None:
        contact = self.contact
        if contact.length is None or contact.frictionless:
            return
        gain = 2 / contact.length * self.c * abs((self.rate * t + self.angle).sin())
        if not (contact.mus if mode[0] == 0 else contact.mu) * gain < self.mass:
            raise Undecided("friction gain < 1, on which existence and uniqueness rest", t)

    def columns(self, t: arb, q, v) -> dict[str, arb]:
        return dict(zip(self.names, (q[0], v[0])))

    def bodies(self, t: Value, q, v) -> dict[str, Value]:
        found = self.columns(t, q, v)
        for i, axis in enumerate("xy"):
            found |= {f"{self.body}.{axis}": self.offset[i] + q[0] * self.along[i], f"{self.body}.v{axis}": v[0] * self.along[i]}
        if self.bar is not None:
            (name, l), theta = self.bar, self._theta(t)
            x, y = theta.cos() * l, theta.sin() * l
            found |= {f"{name}.x": found[f"{self.body}.x"] + x, f"{name}.y": found[f"{self.body}.y"] + y,
                      f"{name}.vx": found[f"{self.body}.vx"] - y * self.rate, f"{name}.vy": found[f"{self.body}.vy"] + x * self.rate, f"{name}.angle": theta}
        if self.belt is not None:
            name, x = self.belt
            found |= {f"{name}.x": x + t * self.surface, f"{name}.vx": t * 0 + self.surface}
        return found

    @classmethod
    def from_scene(cls, scene: Scene) -> SlidingMass:
        """Parameters of a scene, exact, at the working precision.

        Raises
        ------
        NotThisMechanism
            Naming what keeps the scene from being one.
        """
        return cls(**_Reader(scene).parameters())


class _Reader:
    """A scene read as a sliding mass."""

    def __init__(self, scene: Scene):
        self.scene, self.exact = scene, ExactScene(scene)
        self.require = requirement(scene, "one mass on a straight guide")

    def parameters(self) -> dict[str, Any]:
        scene, e = self.scene, self.exact
        frictional = scene.frictional_guides or scene.guides
        self.require(len(frictional) == 1, f"joints: found {len(scene.guides)} guides, {len(scene.frictional_guides)} with friction; expected 1")
        ((name, guide),) = frictional.items()
        slider, path = guide.slider, ("joints", name)
        self.require(guide.slider_point == (0, 0), f"joints.{name}.slider_point: found {guide.slider_point}; expected (0, 0)")
        dx, dy = e.vector(*path, "direction")
        size = (dx * dx + dy * dy).sqrt()
        along = dx / size, dy / size
        horizontal = along[0].factors is not None and along[0].equals(Exact.rational(1)) and along[1].is_zero
        known, pieces = {slider}, {name}
        surface, origin, belt = ZERO, self._dot(e.vector(*path, "point"), along), None
        if guide.guide != GROUND:
            surface, drive = self._belt(guide.guide, horizontal)
            belt = guide.guide, e("bodies", guide.guide, "position", 0).ball
            known.add(guide.guide)
            pieces |= drive
        bar = self._bar(slider, known, pieces, horizontal)
        self.require(set(scene.bodies) == known, f"bodies: found {', '.join(scene.bodies)}; expected {', '.join(sorted(known))}")
        self.require({*scene.joints, *scene.drives} == pieces, f"joints, drives: expected {', '.join(sorted(pieces))} only")
        body = ("bodies", slider)
        mass = e(*body, "mass") + bar["mass"]
        gravity = e.vector("gravity") if scene.gravity is not None else (ZERO, ZERO)
        across = along[0] * gravity[1] - along[1] * gravity[0]
        self.require(bar["c"] is ZERO or gravity[0].is_zero, f"gravity: found {scene.gravity}; expected (0, -g) with a bar")
        force, loads = mass * self._dot(gravity, along), []
        for key, load in scene.forces.items():
            at = ("forces", key)
            self.require(isinstance(load, Force) and load.body == slider and load.point == (0, 0) and self._parallel(e.vector(*at, "direction"), (dx, dy)),
                         f"forces.{key}: expected a force on the slider's centre along the guide")
            if isinstance(load.law, Sine):
                force = force + e(*at, "law", "offset")
                loads.append(SineLoad(*(e(*at, "law", part).ball for part in ("amplitude", "frequency", "phase"))))
            else:
                self.require(isinstance(load.law, Constant), f"forces.{key}: expected a constant or a sine")
                force = force + e(*at, "law", "value")
        stiffness, damping = ZERO, ZERO
        for key, spring in scene.springs.items():
            at = ("springs", key)
            fixed = e.vector(*at, "points", 1)
            inline = (spring.axis is not None and self._parallel(e.vector(*at, "axis"), (dx, dy))) or (
                spring.axis is None and e(*at, "rest_length").is_zero and horizontal and spring.points[1][1] == scene.bodies[slider].position[1])
            self.require(isinstance(spring, LinearSpring) and spring.bodies == (slider, GROUND) and spring.points[0] == (0, 0) and inline,
                         f"springs.{key}: expected a linear spring from the slider's centre to the ground along the guide")
            k = e(*at, "stiffness")
            stiffness, damping = stiffness + k, damping + e(*at, "damping")
            force = force + k * (self._dot(fixed, along) + e(*at, "rest_length"))
        position, velocity = e.vector(*body, "position"), e.vector(*body, "velocity")
        self._require_start(name, along, bar)
        x, speed = self._dot(position, along), self._dot(velocity, along)
        names = (f"{slider}.x", f"{slider}.vx") if horizontal else (f"{name}.displacement", f"{name}.slip_velocity")
        if not horizontal:  # the displacement counts from the guide's point; the spring's anchor moves with it
            x, force = x - origin, force - stiffness * origin
        offset = tuple((p - x * d).ball for p, d in zip(position, along))
        return dict(mass=mass.ball, weight=-(mass * across).ball, force=force.ball, loads=tuple(loads), stiffness=stiffness.ball,
                    damping=damping.ball, c=bar["c"].ball, g=-gravity[1].ball, rate=bar["rate"].ball, angle=bar["angle"].ball,
                    contact=Contact.of(e, name), at_rest=speed.equals(surface), surface=surface.ball, x=x.ball,
                    speed=speed.ball, t_end=e("t_end").ball, joint=name, names=names, body=slider, along=tuple(d.ball for d in along), offset=offset,
                    bar=None if bar["c"] is ZERO else (bar["name"], (bar["c"] / bar["mass"]).ball), belt=belt)

    def _require_start(self, name: str, along: tuple[Exact, Exact], bar: dict[str, Exact]) -> None:
        """The start meets the constraints, as far as balls tell."""
        e, guide = self.exact, self.scene.guides[name]
        across = -along[1], along[0]
        zero = [self._dot(e.vector("bodies", guide.slider, key), across) for key in ("position", "velocity")]
        zero[0] = zero[0] - self._dot(e.vector("joints", name, "point"), across)
        if guide.guide == GROUND:
            zero += [e("bodies", guide.slider, "angle") - e("joints", name, "angle"), e("bodies", guide.slider, "angular_velocity")]
        else:
            zero[0] = zero[0] - self._dot(e.vector("bodies", guide.guide, "position"), across)
        if bar["c"] is not ZERO:
            l, body, angle = bar["c"] / bar["mass"], bar["name"], bar["angle"]
            cosine, sine = Exact(angle.ball.cos()), Exact(angle.ball.sin())
            offset = [a - b for a, b in zip(e.vector("bodies", body, "position"), e.vector("bodies", guide.slider, "position"))]
            moving = [a - b for a, b in zip(e.vector("bodies", body, "velocity"), e.vector("bodies", guide.slider, "velocity"))]
            zero += [offset[0] - l * cosine, offset[1] - l * sine, moving[0] + l * bar["rate"] * sine, moving[1] - l * bar["rate"] * cosine,
                     e("bodies", body, "angle") - angle, e("bodies", body, "angular_velocity") - bar["rate"]]
        self.require(all(x.ball.contains(0) for x in zero), "bodies: the start violates the constraints")

    @staticmethod
    def _dot(a: tuple[Exact, Exact], b: tuple[Exact, Exact]) -> Exact:
        return a[0] * b[0] + a[1] * b[1]

    @staticmethod
    def _parallel(vector: tuple[Exact, Exact], along: tuple[Exact, Exact]) -> bool:
        """Whether a vector points along the guide; only of numbers that can be compared."""
        cross = vector[0] * along[1] - vector[1] * along[0]
        return cross.product is not None and cross.is_zero and bool(_Reader._dot(vector, along).ball > 0)

    def _belt(self, belt: str, horizontal: bool) -> tuple[Exact, set[str]]:
        """Speed of a guide that a linear distance drive moves along (1, 0), and the names of track and drive."""
        scene = self.scene
        tracks = [name for name, joint in scene.guides.items() if joint.slider == belt and joint.guide == GROUND
                  and joint.direction[0] > 0 and joint.direction[1] == 0 and not joint.frictional]
        drives = [name for name, drive in scene.drives.items() if drive.bodies == (belt, GROUND) and drive.type == "distance"
                  and drive.axis is not None and drive.axis[0] > 0 and drive.axis[1] == 0 and isinstance(drive.law, Linear)]
        self.require(horizontal and len(tracks) == len(drives) == 1,
                     f"joints, drives: expected {belt} on a track along (1, 0), with a linear distance drive")
        return self.exact("drives", drives[0], "law", "rate"), {*tracks, *drives}

    def _bar(self, slider: str, known: set[str], pieces: set[str], horizontal: bool) -> dict[str, Any]:
        """Of a bar that is pinned to the slider and turned against it: name, mass, c, rate and angle; zeros where there is none."""
        scene, e = self.scene, self.exact
        pins = {name: joint for name, joint in scene.joints.items() if isinstance(joint, Revolute)}
        if not pins:
            return dict.fromkeys(("mass", "c", "rate", "angle"), ZERO)
        self.require(len(pins) == 1 and len(scene.drives) == 1 and horizontal, "joints, drives: expected one pin and one drive, of a bar")
        ((pin_name, pin),), ((drive_name, drive),) = pins.items(), scene.drives.items()
        self.require(pin.bodies[1] == slider and pin.points[1] == (0, 0) and pin.points[0][1] == 0 and pin.points[0][0] < 0,
                     f"joints.{pin_name}: expected a point (-l, 0) of the bar at the slider's centre")
        bar = pin.bodies[0]
        self.require(drive.type == "angle" and drive.bodies == (bar, slider) and isinstance(drive.law, Linear),
                     f"drives.{drive_name}: expected the angle of {bar} against {slider}, a linear law")
        self.require(scene.frictional_guides == {} or next(iter(scene.frictional_guides.values())).angle == 0, "joints: expected a guide without angle")
        known.add(bar)
        pieces |= {pin_name, drive_name}
        mass = e("bodies", bar, "mass")
        return {"name": bar, "mass": mass, "c": -mass * e("joints", pin_name, "points", 0, 0), "rate": e("drives", drive_name, "law", "rate"),
                "angle": e("drives", drive_name, "law", "offset")}
