"""A slider with friction on a guide that turns: an arm held at its centre of mass, free or driven at a constant rate.

Polar coordinates of the slider's centre, r along the arm and th the arm's angle; e, n the arm's direction and normal:

    m (r'' - r th'^2) = f - k (r - r0) - d r' + m g.e ,        R = m (r th'' + 2 r' th' - g.n) ,
    slider about its centre (it turns with the arm):   M = Is th'' ,
    arm about its pivot:   J th'' = -M - r R - kt (th - th0) - dt th' + tau ,  tau = 0 free, th'' = 0 driven,

so that a free arm obeys  (J + Is + m r^2) th'' = -kt (th - th0) - dt th' - m r (2 r' th' - g.n) .

Friction acts along the line through the pivot, and the moment of the surfaces about the slider's centre is part of
M. Therefore th'', R and M do not depend on friction, and f = phi N(R, M, phi) (`slider_contact.py`) with
phi = -mu sgn r' in slip. Rest on the arm, r' = r'' = 0, requires f = k (r - r0) - m r th'^2 - m g.e, which is possible
while |phi| <= mus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import Drive, LinearSpring, Revolute, TorsionalSpring, Translational
from stiction.truths.reduced.slider_contact import Contact, Mode, SingleSlider
from stiction.truths.reduced.truth_of_motion import truth_of
from stiction.truths.structure import ANY, CENTRE, FORWARD, ON_X_AXIS, OPTIONAL, Part, Structure
from stiction.truths.truth import Truth, body_columns


@dataclass(frozen=True)
class MovingGuide(SingleSlider):
    """A slider on a turning arm, with the symbols of the module's text.

    Attributes
    ----------
    m, slider_inertia : float
        Mass (kg) and moment of inertia Is (kg m^2) of the slider.
    arm_mass, arm_inertia : float
        Mass (kg) and moment of inertia J (kg m^2) of the arm.
    gravity : tuple of float
        g, m/s^2.
    spring, twist : tuple of float
        (k, d, r0) and (kt, dt, th0).
    contact : Contact
        Dimensions and coefficients of the guide.
    pivot : tuple of float
        Position of the pivot, m.
    names : tuple
        Names of pivot, guide and drive; None instead of a drive for a free arm.
    """

    m: float
    slider_inertia: float
    arm_mass: float
    arm_inertia: float
    gravity: tuple[float, float]
    spring: tuple[float, float, float]
    twist: tuple[float, float, float]
    contact: Contact
    pivot: tuple[float, float]
    names: tuple[str, str, str | None]

    def _weight(self, th):
        """Return the weight m g along and across the arm, N."""
        gx, gy = self.gravity
        cos, sin = np.cos(th), np.sin(th)
        return self.m * (gx * cos + gy * sin), self.m * (gy * cos - gx * sin)

    def _twist(self, q, v):
        """Return the moment of the torsional spring on the arm, N m."""
        kt, dt, th0 = self.twist
        return -kt * (q[1] - th0) - dt * v[1]

    def angular_acceleration(self, q, v):
        """Return th'', which does not depend on friction."""
        if self.names[2] is not None:
            return np.zeros_like(q[1])
        r = q[0]
        _, across = self._weight(q[1])
        moment = self._twist(q, v) - r * (2 * self.m * v[0] * v[1] - across)
        return moment / (self.arm_inertia + self.slider_inertia + self.m * r * r)

    def loads(self, t, q, v, a=None):
        """Return R, M and the push, which contains the inertia of the turning frame; they do not depend on q''."""
        alpha = self.angular_acceleration(q, v)
        along, across = self._weight(q[1])
        k, d, r0 = self.spring
        R = self.m * (q[0] * alpha + 2 * v[0] * v[1]) - across
        force = self.m * q[0] * v[1] ** 2 - k * (q[0] - r0) - d * v[0] + along
        return R, self.slider_inertia * alpha, force

    def acceleration(self, t, q, v, mode: Mode):
        # The motion of the arm is the same in slip and in stick, as th'' does not depend on friction.
        slip, signs = mode
        if slip == 0:
            radial = np.zeros_like(q[0])
        else:
            R, M, force = self.loads(t, q, v)
            phi = self.slip_fraction(slip)
            radial = (force + phi * self.contact.load(R, M, phi, signs)) / self.m
        return np.array([radial, self.angular_acceleration(q, v)])

    def columns(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Mode
    ) -> dict[str, np.ndarray]:
        pivot, guide, drive = self.names
        acceleration = self.acceleration(t, q, v, mode)
        (r, th), (rv, w), (ra, alpha) = q, v, acceleration
        cos, sin = np.cos(th), np.sin(th)
        zero = np.zeros_like(t)
        e = np.array([cos, sin])
        n = np.array([-sin, cos])
        # The acceleration in polar coordinates has centripetal and Coriolis terms.
        velocity = rv * e + r * w * n
        a = (ra - r * w * w) * e + (r * alpha + 2 * rv * w) * n
        px, py = self.pivot
        values = {
            **body_columns("arm", (zero + px, zero + py, th), (zero, zero, w), (zero, zero, alpha)),
            **body_columns("slider", (px + r * cos, py + r * sin, th), (*velocity, w), (*a, alpha)),
        }
        # The force of the pivot accelerates the slider and carries both weights. The arm's centre of
        # mass is at the pivot and has no acceleration.
        for i, c in enumerate("xy"):
            values[f"{pivot}.f{c}"] = self.m * a[i] - (self.m + self.arm_mass) * self.gravity[i]
        # The arm has a constant rate, so that the drive balances all moments on it.
        if drive is not None:
            R, M, _ = self.loads(t, q, v)
            values[f"{drive}.effort"] = M + r * R - self._twist(q, v)
        return values | self.guide_columns(
            guide, t, q, v, acceleration, mode, displacement=r, slip_velocity=rv
        )


TURNING_ARM = Structure(
    "a slider on a turning arm",
    ("arm", "slider"),
    {
        "pivot": Part(Revolute, "arm", GROUND, points=(CENTRE, ANY)),
        "guide": Part(
            Translational,
            "slider",
            "arm",
            direction=FORWARD,
            point=CENTRE,
            slider_point=CENTRE,
            angle=0,
            frictional=True,
        ),
        "spring": Part(
            LinearSpring, "slider", "arm", count=OPTIONAL, points=(CENTRE, ON_X_AXIS), axis=FORWARD
        ),
        "twist": Part(TorsionalSpring, "arm", GROUND, count=OPTIONAL),
        "motor": Part(Drive, "arm", GROUND, count=OPTIONAL, type="angle", law=Linear),
    },
)


def moving_guide_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of a slider (`slider`) with friction on a turning arm (`arm`)."""
    match = TURNING_ARM.match(scene)
    arm, slider = scene.bodies["arm"], scene.bodies["slider"]
    motor, spring, twist = match["motor"], match["spring"], match["twist"]
    if motor and (motor.law.offset, motor.law.rate) != (arm.angle, arm.angular_velocity):
        raise TURNING_ARM.misfit(
            scene, f"{match.name('motor')}: expected a drive that meets the start of the arm"
        )
    pivot = match["pivot"].points[1]
    # A missing spring has no stiffness, and an arm without a motor turns freely.
    spring_terms = (0.0, 0.0, 0.0)
    if spring:
        rest_position = spring.points[1][0] + spring.rest_length
        spring_terms = (spring.stiffness, spring.damping, rest_position)
    twist_terms = (0.0, 0.0, 0.0)
    if twist:
        twist_terms = (twist.stiffness, twist.damping, twist.rest_angle)
    guide = match.name("guide")
    mechanism = MovingGuide(
        m=slider.mass,
        slider_inertia=slider.inertia,
        arm_mass=arm.mass,
        arm_inertia=arm.inertia,
        gravity=scene.gravity or (0.0, 0.0),
        spring=spring_terms,
        twist=twist_terms,
        contact=Contact.of(match["guide"]),
        pivot=pivot,
        names=(match.name("pivot"), guide, match.name("motor") if motor else None),
    )
    # Compute the polar coordinates of the start. The velocity across the arm follows from its rate.
    along = np.array([np.cos(arm.angle), np.sin(arm.angle)])
    r = float((np.array(slider.position) - np.array(pivot)) @ along)
    radial = float(np.array(slider.velocity) @ along)
    q = np.array([r, arm.angle])
    v = np.array([radial, arm.angular_velocity])
    return truth_of(scene, (guide,), mechanism, q, v, t_end)
