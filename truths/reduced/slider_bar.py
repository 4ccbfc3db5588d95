"""The paper's example reduced to one degree of freedom (Zhuang & Wang 2014, Sect. 5), without any HLCP.

The motor turns the bar at a constant rate against the slider, which does not turn: th = th0 + w0 t is known, and the
slider's position x = x2 is the only unknown. With c = m1 L/2 and m = m1 + m2:

- bar and slider together, across the guide:  R = m g - c w0^2 sin th ;
- the bar about its pin:  tau = c (g cos th - x'' sin th) ; the slider's guide has to supply M = tau ;
- bar and slider together, along the guide:
  m x'' = F(t) - k (x - L0) - d x' + c w0^2 cos th + phi N ,  phi = -mu sgn x' in slip (`slider_contact.py` for N).

In slip with known contact configuration this is linear in x''. In stick x'' = 0, and the friction phi N that the
equation asks for gives the fraction rho = phi / mus; the slider breaks away where |rho| = 1, which is the slip
equation with mus. At velocity zero it sticks if |rho| < 1 and reverses otherwise.

The jump of the motor's torque at an event follows from the second line: -c sin(th) times the jump of x''.
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
"""Turns of the bar within which the load must repeat itself for a common period."""
_RATIONAL = 1e-12
"""Distance from a ratio of whole numbers up to which a ratio of frequencies is that: rounding of both."""


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
        """Parameters of a scene of the structure `SLIDER_BAR`; NotThisMechanism for any other."""
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
        return self.m1 + self.m2

    @property
    def c(self) -> float:
        """First moment of the bar about its pin, kg m."""
        return self.m1 * self.L / 2

    @property
    def magnitude(self) -> float:
        """Largest acceleration that load, spring at rest length zero, weight and the bar's turning would each give."""
        return (
            1.0
            + (
                abs(self.force_offset)
                + abs(self.F0)
                + self.stiffness * abs(self.L0)
                + self.mass * abs(self.g)
                + self.c * self.rate**2
            )
            / self.mass
        )

    @property
    def fastest(self) -> float:
        return max(abs(self.rate), abs(self.frequency), (self.stiffness / self.mass) ** 0.5)

    def theta(self, t):
        return self.angle + self.rate * t

    def applied(self, t, x, v):
        """Everything in m x'' but friction, N."""
        return (
            self.force_offset
            + self.F0 * np.sin(self.frequency * t + self.phase)
            - self.stiffness * (x - self.L0)
            - self.damping * v
            + self.c * self.rate**2 * np.cos(self.theta(t))
        )

    def normal(self, t):
        """R, N."""
        return self.mass * self.g - self.c * self.rate**2 * np.sin(self.theta(t))

    def torque(self, t, a):
        """tau, N m."""
        return self.c * (self.g * np.cos(self.theta(t)) - a * np.sin(self.theta(t)))

    def acceleration(self, t, q, v, mode: Mode):
        slip, signs = mode
        if slip == 0:
            return np.zeros_like(q)
        # N depends on x'' by the bar's torque, linearly: N = load + slope x''. Friction adds phi
        # slope to the inertia.
        phi = self.slip_fraction(slip)
        load = self.contact.load(self.normal(t), self.torque(t, 0.0), phi, signs)
        slope = self.contact.load(0.0, -self.c * np.sin(self.theta(t)), phi, signs)
        push = self.applied(t, 0.0, 0.0) + phi * load
        inertia = self.mass - phi * slope
        return (push - self.stiffness * q - self.damping * v) / inertia

    def loads(self, t, q, v, a):
        return self.normal(t), self.torque(t, a[0]), self.applied(t, q[0], v[0])

    def limits(self, t, q, v, mode: Mode):
        """Positive while the accelerations are unique: in slip m > mu |B| (Painleve), at rest `_rest_limits`."""
        if self.contact.length is None:
            return np.empty((0, 1, len(t)))
        # D = A - B x''. In slip m x'' + s mu max(|R|, |D|) must grow with x'': its slope is at
        # least m - mu |B|.
        B = 2 / self.contact.length * self.c * np.sin(self.theta(t))
        if mode[0]:
            return np.array([[self.mass - sign * self.contact.mu * B] for sign in (1, -1)])
        return self._rest_limits(t, B, self.applied(t, q[0], v[0]))

    def _rest_limits(self, t, B, P):
        """Positive while no slip begins besides rest: the slider accelerates only against full static friction.

        In direction s, with z = s x'' >= 0, A = (2/a) (tau(0) + (b/2) mus s R) and B for s B, slip asks for
        h(z) = s P - m z - mus max(|R|, |A - B z|) = 0, concave in z and negative at 0 in rest. It has roots z > 0 only
        where it rises at 0: mus |B| > m. Its largest value is where |A - B z| has fallen to |R|. With B > 0
        that is at z = (A - |R|)/B, and h there times B is s P B - m (A - |R|) - mus |R| B; with B < 0 as for -A, -B.
        Rest is therefore the only solution while one of  m - mus B,  |R| - A,  m A - s P B + (mus B - m) |R|  is
        positive; for mus B > m the last is, as the middle one, the larger of the two with R and -R.
        """
        m, mus, R = self.mass, self.contact.mus, self.normal(t)
        limits = []
        for s in (1, -1):
            n1, n2 = self.contact.corners(R, self.torque(t, 0.0), -mus * s)
            for sign in (1, -1):
                # D >= 0 and D < 0 by the two signs, with B counted along the direction s
                A, b = sign * (n2 - n1), sign * s * B
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
        zero, th = np.zeros_like(t), self.theta(t)
        sin, cos, half, w = np.sin(th), np.cos(th), self.L / 2, self.rate
        # The bar's centre of mass goes round the pin at a constant rate: centripetal acceleration
        # alone.
        bar_ax, bar_ay = ax - half * w * w * cos, -half * w * w * sin
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
        """Excess of the load over what static friction can hold at rest, N: positive if the slider breaks away.

        max over s = -1, 1 of  s P - mus max(|R|, |D_s|), D_s the D of `slider_contact.py`, phi = -mus s and x'' = 0.
        """
        R, M, P = self.normal(t), self.torque(t, 0.0), self.applied(t, x, 0.0)
        return max(s * P - self.contact.capacity(R, M, -self.contact.mus * s) for s in (-1, 1))

    def period(self) -> float:
        """Return the common period of bar and load, s; raises InputError without one."""
        if self.rate == 0:
            return 2 * np.pi / self.frequency
        # load over bar as p/q: q turns of the bar are p periods of the load
        ratio = Fraction(self.frequency / abs(self.rate)).limit_denominator(_MOST_TURNS)
        if abs(self.frequency / abs(self.rate) - ratio) > _RATIONAL or ratio == 0:
            raise InputError(
                f"bar ({self.rate:g} rad/s) and load ({self.frequency:g} rad/s) have no common period"
            )
        return 2 * np.pi * ratio.denominator / abs(self.rate)


def slider_bar_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the slider-bar's motion from its start; NoMotion also where mu |B| >= m (Painleve)."""
    mechanism = SliderBar.from_scene(scene)
    truth = truth_of(
        scene, ("guide",), mechanism, np.array([mechanism.x]), np.array([mechanism.v]), t_end
    )
    jumps = [
        -mechanism.c * np.sin(mechanism.theta(event.time)) * event.jump("slider.ax")
        for event in truth.events
    ]
    return replace(truth, jump_closed_form=np.array(jumps))
