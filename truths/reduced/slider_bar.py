"""The slider-bar of the paper reduced to one degree of freedom (Zhuang & Wang 2014, Sect. 5), without an HLCP.

The motor turns the bar at a constant rate relative to the slider, which does not turn: th = th0 + w0 t is known, and
the slider's position x = x2 is the only unknown. With c = m1 L/2 and m = m1 + m2:

- bar and slider together, across the guide:  R = m g - c w0^2 sin th ;
- the bar about its pin:  tau = c (g cos th - x'' sin th) ; the slider's guide exerts M = tau ;
- bar and slider together, along the guide:
  m x'' = F(t) - k (x - L0) - d x' + c w0^2 cos th + phi N ,  phi = -mu sgn x' in slip (`slider_contact.py` for N).

In slip with a given contact configuration the last equation is linear in x''. In stick x'' = 0, and the friction phi N
that solves it yields the fraction rho = phi / mus. The slider breaks away at |rho| = 1, which is the slip equation with
mus. At velocity zero it sticks if |rho| < 1 and reverses otherwise.

The jump of the motor's torque at an event follows from the second equation: -c sin(th) times the jump of x''.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from stiction.scenes import InputError, Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear, Sine
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Translational
from stiction.truths.reduced.slider_contact import Contact, Mode, SingleSlider
from stiction.truths.reduced.truth_of_motion import truth_of
from stiction.truths.structure import (
    CENTRE,
    FORWARD,
    NEGATIVE,
    ON_X_AXIS,
    PULLS_ALONG_X,
    Condition,
    Part,
    Structure,
)
from stiction.truths.truth import Truth, body_columns

SLIDER_BAR = Structure(
    "a slider-bar",
    ("bar", "slider"),
    {
        "pin": Part(Revolute, "bar", "slider", name="pin", points=((NEGATIVE, 0), CENTRE)),
        "guide": Part(
            Translational,
            "slider",
            GROUND,
            name="guide",
            direction=FORWARD,
            point=CENTRE,
            slider_point=CENTRE,
            angle=0,
        ),
        "motor": Part(Drive, "bar", "slider", name="motor", type="angle", law=Linear),
        "spring": Part(
            LinearSpring, "slider", GROUND, points=(CENTRE, ON_X_AXIS), where=PULLS_ALONG_X
        ),
        "load": Part(Force, "slider", point=CENTRE, direction=FORWARD, law=Sine),
    },
    gravity=Condition("none or [0, any]", lambda gravity: gravity is None or gravity[0] == 0),
)


_MOST_TURNS = 64
"""Largest number of turns of the bar in a common period of bar and load."""
_RATIONAL = 1e-12
"""Distance from a rational number within which a ratio of frequencies equals it: rounding of both frequencies."""


@dataclass(frozen=True)
class SliderBar(SingleSlider):
    """The reduced slider-bar: parameters, equation of motion, contact modes, columns.

    Lengths in m, masses in kg, `rate` = w0 and `frequency` = Omega in rad/s; the force on the slider is
    force_offset + F0 sin(frequency t + phase).
    """

    m1: float
    m2: float
    L: float
    angle: float
    rate: float
    g: float
    stiffness: float
    damping: float
    L0: float
    force_offset: float
    F0: float
    frequency: float
    phase: float
    contact: Contact
    x: float
    v: float

    @classmethod
    def from_scene(cls, scene: Scene) -> SliderBar:
        """Return the slider-bar of a scene; raise NotThisMechanism if the scene is not a `SLIDER_BAR`."""
        match = SLIDER_BAR.match(scene)
        bar, slider = scene.bodies["bar"], scene.bodies["slider"]
        pin, guide, spring = match["pin"], match["guide"], match["spring"]
        motion, force = match["motor"].law, match["load"].law
        return cls(
            m1=bar.mass,
            m2=slider.mass,
            L=-2 * pin.points[0][0],
            angle=motion.offset,
            rate=motion.rate,
            g=-scene.gravity[1] if scene.gravity else 0.0,
            stiffness=spring.stiffness,
            damping=spring.damping,
            L0=spring.points[1][0] + spring.rest_length,
            force_offset=force.offset,
            F0=force.amplitude,
            frequency=force.frequency,
            phase=force.phase,
            contact=Contact.of(guide),
            x=slider.position[0],
            v=slider.velocity[0],
        )

    @property
    def mass(self) -> float:
        """Mass m of bar and slider, kg."""
        return self.m1 + self.m2

    @property
    def c(self) -> float:
        """First moment of the bar about its pin, kg m."""
        return self.m1 * self.L / 2

    @property
    def magnitude(self) -> float:
        """Size of x'': the sum of the accelerations by load, spring, weight and the rotation of the bar, m/s^2."""
        forces = (
            abs(self.force_offset)
            + abs(self.F0)
            + self.stiffness * abs(self.L0)
            + self.mass * abs(self.g)
            + self.c * self.rate**2
        )
        return 1.0 + forces / self.mass

    @property
    def fastest(self) -> float:
        return max(abs(self.rate), abs(self.frequency), (self.stiffness / self.mass) ** 0.5)

    def theta(self, t):
        """Return the angle th of the bar, rad."""
        return self.angle + self.rate * t

    def applied(self, t, x, v):
        """Return the sum of all terms of m x'' except friction, N."""
        return (
            self.force_offset
            + self.F0 * np.sin(self.frequency * t + self.phase)
            - self.stiffness * (x - self.L0)
            - self.damping * v
            + self.c * self.rate**2 * np.cos(self.theta(t))
        )

    def normal(self, t):
        """Return R, N."""
        return self.mass * self.g - self.c * self.rate**2 * np.sin(self.theta(t))

    def torque(self, t, a):
        """Return the motor's torque tau at the acceleration a (m/s^2), N m."""
        return self.c * (self.g * np.cos(self.theta(t)) - a * np.sin(self.theta(t)))

    def acceleration(self, t, q, v, mode: Mode):
        slip, signs = mode
        if slip == 0:
            return np.zeros_like(q)
        # N depends linearly on x'' by the bar's torque: N = load + slope x''. Friction therefore reduces
        # the inertia by phi slope.
        phi = self.slip_fraction(slip)
        load = self.contact.load(self.normal(t), self.torque(t, 0.0), phi, signs)
        slope = self.contact.load(0.0, -self.c * np.sin(self.theta(t)), phi, signs)
        push = self.applied(t, 0.0, 0.0) + phi * load
        inertia = self.mass - phi * slope
        return (push - self.stiffness * q - self.damping * v) / inertia

    def loads(self, t, q, v, a):
        return self.normal(t), self.torque(t, a[0]), self.applied(t, q[0], v[0])

    def limits(self, t, q, v, mode: Mode):
        """Return functions that are positive while x'' is unique.

        This is the case in slip if m > mu |B| (Painleve); for rest see `_rest_limits`.
        """
        if self.contact.length is None:
            return np.empty((0, 1, len(t)))
        # D = A - B x''. In slip m x'' + s mu max(|R|, |D|) must grow with x'': its slope is at
        # least m - mu |B|.
        B = 2 / self.contact.length * self.c * np.sin(self.theta(t))
        if mode[0]:
            return np.array([[self.mass - sign * self.contact.mu * B] for sign in (1, -1)])
        return self._rest_limits(t, B, self.applied(t, q[0], v[0]))

    def _rest_limits(self, t, B, P):
        """Return functions that are positive while rest is the only solution.

        A slider at rest can only accelerate against full static friction.

        In direction s, with z = s x'' >= 0, A = (2/a) (tau(0) + (b/2) mus s R) and B for s B, slip asks for
        h(z) = s P - m z - mus max(|R|, |A - B z|) = 0, which is concave in z and negative at 0 in rest. It has roots
        z > 0 only if it increases at 0: mus |B| > m. Its maximum is at the z at which |A - B z| has decreased to |R|.
        For B > 0 this is z = (A - |R|)/B, where h B = s P B - m (A - |R|) - mus |R| B; B < 0 is the same with -A, -B.
        Rest is therefore the only solution while one of  m - mus B,  |R| - A,  m A - s P B + (mus B - m) |R|  is
        positive. For mus B > m the last one, as the middle one, is the larger of its values for R and -R.
        """
        m, mus, R = self.mass, self.contact.mus, self.normal(t)
        limits = []
        for s in (1, -1):
            n1, n2 = self.contact.corners(R, self.torque(t, 0.0), -mus * s)
            for sign in (1, -1):
                # The two signs are for D >= 0 and D < 0; B is counted along the direction s.
                A = sign * (n2 - n1)
                b = sign * s * B
                limits.append(
                    [
                        m - mus * b,
                        R - A,
                        -R - A,
                        *(m * A - s * P * b + (mus * b - m) * r for r in (R, -R)),
                    ]
                )
        return np.array(limits)

    def columns(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Mode
    ) -> dict[str, np.ndarray]:
        a = self.acceleration(t, q, v, mode)
        (x,), (vx,), (ax,) = q, v, a
        zero = np.zeros_like(t)
        th = self.theta(t)
        sin, cos = np.sin(th), np.cos(th)
        half = self.L / 2
        w = self.rate
        # The bar's centre of mass rotates about the pin at a constant rate, so that its relative
        # acceleration is centripetal.
        bar_ax = ax - half * w * w * cos
        bar_ay = -half * w * w * sin
        return {
            **body_columns(
                "bar",
                (x + half * cos, half * sin, th),
                (vx - half * w * sin, half * w * cos, zero + w),
                (bar_ax, bar_ay, zero),
            ),
            **body_columns("slider", (x, zero, zero), (vx, zero, zero), (ax, zero, zero)),
            "pin.fx": self.m1 * bar_ax,
            "pin.fy": self.m1 * (bar_ay + self.g),
            "guide.displacement": x,
            "guide.slip_velocity": vx,
            "motor.effort": self.torque(t, ax),
            **self.guide_columns("guide", t, q, v, a, mode),
        }

    def break_away_margin(self, t: float, x: float) -> float:
        """Return the excess of the load over static friction at rest, N, which is positive if the slider breaks away.

        It is the larger value of  s P - mus max(|R|, |D_s|)  for s = -1, 1, where D_s is the D of `slider_contact.py`
        with phi = -mus s and x'' = 0.
        """
        R = self.normal(t)
        M = self.torque(t, 0.0)
        P = self.applied(t, x, 0.0)
        return max(s * P - self.contact.capacity(R, M, -self.contact.mus * s) for s in (-1, 1))

    def period(self) -> float:
        """Return the common period of bar and load, s; raise InputError if there is none."""
        if self.rate == 0:
            return 2 * np.pi / self.frequency
        # If the frequencies of load and bar have the ratio p/q, q turns of the bar are p periods of the
        # load.
        ratio = Fraction(self.frequency / abs(self.rate)).limit_denominator(_MOST_TURNS)
        if abs(self.frequency / abs(self.rate) - ratio) > _RATIONAL or ratio == 0:
            raise InputError(
                f"bar ({self.rate:g} rad/s) and load ({self.frequency:g} rad/s) have no common period"
            )
        return 2 * np.pi * ratio.denominator / abs(self.rate)


def slider_bar_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the slider-bar's motion; raise NoMotion also where mu |B| >= m (Painleve)."""
    mechanism = SliderBar.from_scene(scene)
    truth = truth_of(
        scene, ("guide",), mechanism, np.array([mechanism.x]), np.array([mechanism.v]), t_end
    )
    jumps = [
        -mechanism.c * np.sin(mechanism.theta(event.time)) * event.jump("slider.ax")
        for event in truth.events
    ]
    return replace(truth, jump_closed_form=np.array(jumps))
