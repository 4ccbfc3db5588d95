"""A slider with friction on a guide that turns: an arm held at its centre of mass, free or driven at a constant rate.

Polar coordinates of the slider's centre, r along the arm and th the arm's angle; e, n the arm's direction and normal:

    m (r'' - r th'^2) = f - k (r - r0) - d r' + m g.e ,        R = m (r th'' + 2 r' th' - g.n) ,
    slider about its centre (it turns with the arm):   M = Is th'' ,
    arm about its pivot:   J th'' = -M - r R - kt (th - th0) - dt th' + tau ,  tau = 0 free, th'' = 0 driven,

so free:  (J + Is + m r^2) th'' = -kt (th - th0) - dt th' - m r (2 r' th' - g.n) .

Friction acts along the line through the pivot, and the moment of the surfaces about the slider's centre is part of
M, so neither enters th'': R and M are known before friction is, and f = phi N(R, M, phi) (`slider.py`) with
phi = -mu sgn r' in slip.
Rest on the arm: r' = r'' = 0 asks for f = k (r - r0) - m r th'^2 - m g.e, possible while |phi| <= mus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.comparisons.truth.reduced.slider_contact import Contact, Mode, SingleSlider
from stiction.comparisons.truth.reduced.truth_of_motion import truth_of
from stiction.comparisons.truth.truth import NotThisMechanism, Truth
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import LinearSpring, Revolute, Translational


@dataclass(frozen=True)
class MovingGuide(SingleSlider):
    """Parameters as in the module's text; `names` of pivot, guide and drive (None: free)."""

    m: float
    slider_inertia: float
    arm_mass: float
    arm_inertia: float
    gravity: tuple[float, float]
    stiffness: float
    damping: float
    rest: float
    twist_stiffness: float
    twist_damping: float
    rest_angle: float
    contact: Contact
    pivot: tuple[float, float]
    names: tuple[str, str, str | None]

    def _weight(self, th):
        """m g along and across the arm."""
        gx, gy = self.gravity
        cos, sin = np.cos(th), np.sin(th)
        return self.m * (gx * cos + gy * sin), self.m * (gy * cos - gx * sin)

    def _twist(self, q, v):
        return -self.twist_stiffness * (q[1] - self.rest_angle) - self.twist_damping * v[1]

    def angular_acceleration(self, q, v):
        """th''; independent of friction."""
        if self.names[2] is not None:
            return np.zeros_like(q[1])
        r, across = q[0], self._weight(q[1])[1]
        return (self._twist(q, v) - r * (2 * self.m * v[0] * v[1] - across)) / (
            self.arm_inertia + self.slider_inertia + self.m * r * r)

    def loads(self, q, v):
        """R, M and the force along the arm without friction, inertia of the turning frame included."""
        alpha = self.angular_acceleration(q, v)
        along, across = self._weight(q[1])
        R = self.m * (q[0] * alpha + 2 * v[0] * v[1]) - across
        force = self.m * q[0] * v[1] ** 2 - self.stiffness * (q[0] - self.rest) - self.damping * v[0] + along
        return R, self.slider_inertia * alpha, force

    def fraction(self, q, v, mode: Mode):
        """phi: -mu sgn r' in slip, what rest asks for in stick."""
        if mode[0]:
            return np.full_like(q[0], self.slip_fraction(mode[0]))
        R, M, force = self.loads(q, v)
        return self.contact.mobilization(R, M, -force)

    def acceleration(self, t, q, v, mode: Mode):
        slip, signs = mode
        if slip == 0:
            radial = np.zeros_like(q[0])
        else:
            R, M, force = self.loads(q, v)
            phi = self.slip_fraction(slip)
            radial = (force + phi * self.contact.load(R, M, phi, signs)) / self.m
        return np.array([radial, self.angular_acceleration(q, v)])

    def guards(self, t, q, v, a, mode: Mode):
        return self.contact_guards(v, *self.loads(q, v), mode)

    def columns(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Mode) -> dict[str, np.ndarray]:
        """All columns within a mode, by the names of a Trajectory."""
        pivot, guide, drive = self.names
        (r, th), (rv, w), (ra, alpha) = q, v, self.acceleration(t, q, v, mode)
        cos, sin, zero = np.cos(th), np.sin(th), np.zeros_like(t)
        e, n = np.array([cos, sin]), np.array([-sin, cos])
        velocity, a = rv * e + r * w * n, (ra - r * w * w) * e + (r * alpha + 2 * rv * w) * n
        values = {"arm.x": zero + self.pivot[0], "arm.y": zero + self.pivot[1], "arm.vx": zero, "arm.vy": zero,
                  "arm.ax": zero, "arm.ay": zero}
        for i, c in enumerate("xy"):
            values |= {f"slider.{c}": self.pivot[i] + r * e[i], f"slider.v{c}": velocity[i], f"slider.a{c}": a[i],
                       f"{pivot}.f{c}": self.m * a[i] - (self.m + self.arm_mass) * self.gravity[i]}
        for body in ("arm", "slider"):
            values |= {f"{body}.angle": th, f"{body}.omega": w, f"{body}.alpha": alpha}
        R, M, _ = self.loads(q, v)
        joint = self.contact.columns(R, M, self.fraction(q, v, mode))
        joint |= {"mode": np.sign(rv) if self.contact.frictionless else zero + mode[0],
                  "displacement": r, "slip_velocity": rv}
        if drive is not None:
            values[f"{drive}.effort"] = M + r * R - self._twist(q, v)
        return values | {f"{guide}.{name}": value for name, value in joint.items()}


def moving_guide_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """The motion of bodies `arm` and `slider`.

    Raises
    ------
    NotThisMechanism
        If the scene has another structure.
    NoMotion
        Where the equations have no motion or several.
    """
    mechanism, q, v = _from_scene(scene)
    return truth_of(scene, mechanism.names[1:2], mechanism, q, v, scene.t_end if t_end is None else t_end)


def _from_scene(scene: Scene) -> tuple[MovingGuide, np.ndarray, np.ndarray]:
    def require(condition: bool, text: str) -> None:
        if not condition:
            raise NotThisMechanism(f"{scene.name} is not a slider on a turning arm: {text}")

    require(set(scene.bodies) == {"arm", "slider"}, f"bodies: found {', '.join(scene.bodies)}; expected arm, slider")
    pins = [(name, joint) for name, joint in scene.joints.items() if isinstance(joint, Revolute)]
    guides = [(name, joint) for name, joint in scene.joints.items() if isinstance(joint, Translational)]
    require(len(pins) == 1 and pins[0][1].bodies == ("arm", GROUND) and pins[0][1].points[0] == (0, 0),
            "joints: expected one pin, of the arm's centre to the ground")
    require(len(guides) == 1 and guides[0][1].bodies == ("slider", "arm") and guides[0][1].direction[0] > 0
            and guides[0][1].direction[1] == 0 and guides[0][1].point == (0, 0) and guides[0][1].slider_point == (0, 0)
            and guides[0][1].angle == 0 and guides[0][1].frictional,
            "joints: expected one frictional guide, of the slider's centre along the arm's x axis")
    require(not scene.forces, f"forces: found {', '.join(scene.forces)}; expected none")
    linear, torsional = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for name, spring in scene.springs.items():
        if isinstance(spring, LinearSpring):
            require(spring.bodies == ("slider", "arm") and spring.points[0] == (0, 0) and spring.points[1][1] == 0
                    and spring.axis is not None and spring.axis[0] > 0 and spring.axis[1] == 0 and linear == (0, 0, 0),
                    f"springs.{name}: expected one spring of slider's centre against arm along (1, 0)")
            linear = spring.stiffness, spring.damping, spring.points[1][0] + spring.rest_length
        else:
            require(spring.bodies == ("arm", GROUND) and torsional == (0, 0, 0),
                    f"springs.{name}: expected one torsional spring of arm against ground")
            torsional = spring.stiffness, spring.damping, spring.rest_angle
    arm, slider = scene.bodies["arm"], scene.bodies["slider"]
    drive = None
    for drive, element in scene.drives.items():
        require(len(scene.drives) == 1 and element.type == "angle" and element.bodies == ("arm", GROUND)
                and isinstance(element.law, Linear) and element.law.offset == arm.angle
                and element.law.rate == arm.angular_velocity,
                f"drives.{drive}: expected at most one linear angle drive of the arm, that meets its start")
    pivot = pins[0][1].points[1]
    along = np.array([np.cos(arm.angle), np.sin(arm.angle)])
    r = float((np.array(slider.position) - np.array(pivot)) @ along)
    q, v = np.array([r, arm.angle]), np.array([float(np.array(slider.velocity) @ along), arm.angular_velocity])
    return MovingGuide(slider.mass, slider.inertia, arm.mass, arm.inertia, scene.gravity or (0.0, 0.0), *linear,
                       *torsional, Contact.of(guides[0][1]), pivot, (pins[0][0], guides[0][0], drive)), q, v
