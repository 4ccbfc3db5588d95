"""Elliptic trammel with friction on both guides, reduced to one degree of freedom.

A bar (mass m, inertia I, pins at distances lx and ly from its centre, L = lx + ly) connects slider x (mass mx) on the
horizontal guide with slider y (mass my) on the vertical one. With p the angle of the bar below its own direction,

    X = L cos p ,  Y = L sin p ,  bar's centre (ly cos p, lx sin p) ,  bar's angle -p ,

from the upper left pin (0, Y) down to (X, 0). Let (H, V) be the pin forces on the sliders, E the applied forces on
them (weight and springs included), Rx the normal force of guide x (along +y), Ry that of guide y (its normal is -x),
fx, fy the frictions. The sliders do not turn and their pins are smooth at their centres, so M = 0 in
`slider_contact.py`: friction tilts a slider, n1, n2 = R (1 +- phi b/a)/2, but as long as mus b < a both corners stay on
the surface that the sign of R determines, N = |R| and

    fx = cx Rx ,  fy = cy Ry ,   c = phi sgn R ,  phi = -mu sgn(slip) .

Slider x:  mx X'' = Hx + fx + Ex_x ,  0 = Vx + Rx + Ex_y .
Slider y:  my Y'' = Vy + fy + Ey_y ,  0 = Hy - Ry + Ey_x .
Bar:  m xc'' = -Hx - Hy + Gx ,  m yc'' = -Vx - Vy + Gy , and its moments,

    I p'' = lx (cos p Vx + sin p Hx) - ly (cos p Vy + sin p Hy) - T   (T: torque on the bar) .

Eliminating the pin forces from the bar's two balances:

    Rx + cy Ry = m yc'' + my Y'' - Ey_y - Ex_y - Gy =: A ,   Ry - cx Rx = -m xc'' - mx X'' + Ex_x + Ey_x + Gx =: B ,
    Rx = (A - cy B) / (1 + cx cy) ,  Ry = (B + cx A) / (1 + cx cy) .

A, B and hence the moment equation are linear in p''. It is solved for each choice of the signs of R, of which the
consistent one is taken. The slip of a guide changes its direction with p', and also at the dead point of its slider,
sin p = 0 or cos p = 0, although the mechanism continues to move.

At rest, p' = 0, both guides stick. Friction is statically indeterminate; the columns contain the frictions of equal
mobilization of both guides, phi = -rho mus e with e the direction of slip for p' > 0. With p'' = 0 the moment equation
times (1 + cx cy) is quadratic in rho. Rest ends at |rho| = 1, where static friction is fully mobilized on all surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine, evaluate_law
from stiction.scenes.model import Force, LinearSpring, Revolute, Torque, Translational
from stiction.truths.reduced.piecewise_smooth import PiecewiseMechanism
from stiction.truths.reduced.slider_contact import Contact
from stiction.truths.reduced.truth_of_motion import truth_of
from stiction.truths.structure import (
    ANY,
    CENTRE,
    NEGATIVE,
    POSITIVE,
    SEVERAL,
    Condition,
    Part,
    Structure,
)
from stiction.truths.truth import Truth, body_columns


class Mode(NamedTuple):
    """Contact mode of the trammel.

    Attributes
    ----------
    turn : int
        Direction of p', 0 at rest.
    slip, signs : tuple of int
        Directions of slip of guide x and guide y, and signs of Rx, Ry.
    """

    turn: int
    slip: tuple[int, int]
    signs: tuple[int, int]


@dataclass(frozen=True)
class Trammel(PiecewiseMechanism):
    """An elliptic trammel, with the symbols of the module's text.

    Attributes
    ----------
    m, inertia : float
        Mass (kg) and moment of inertia I (kg m^2) of the bar.
    lx, ly : float
        Distances of the pins from the bar's centre, m.
    mx, my : float
        Masses of the sliders, kg.
    gravity : tuple of float
        Gravity, m/s^2.
    contacts : tuple of Contact
        Contacts of slider x and slider y.
    springs, forces : tuple of tuple
        For each slider, the springs along its guide, and the other forces on it.
    torques : tuple of Torque
        Torques on the bar.
    """

    m: float
    inertia: float
    lx: float
    ly: float
    mx: float
    my: float
    gravity: tuple[float, float]
    contacts: tuple[Contact, Contact]
    springs: tuple[tuple[LinearSpring, ...], ...]
    forces: tuple[tuple[Force, ...], ...]
    torques: tuple[Torque, ...]

    @property
    def L(self) -> float:
        """Distance of the pins, m."""
        return self.lx + self.ly

    def _second(self, p, v, a):
        """Return the second derivatives of cos p and sin p for p' = v and p'' = a."""
        return -np.sin(p) * a - np.cos(p) * v * v, np.cos(p) * a - np.sin(p) * v * v

    def _applied(self, i, t, position, velocity):
        """Return weight, springs and forces on a slider's centre (N), shape (2, k).

        `i` is 0 for slider x and 1 for slider y; position and velocity are those along its guide.
        """
        mass = (self.mx, self.my)[i]
        total = np.repeat(mass * np.array(self.gravity)[:, None], len(t), axis=1)
        for spring in self.springs[i]:
            stretch = position - (spring.points[1][i] + spring.rest_length)
            total[i] -= spring.stiffness * stretch + spring.damping * velocity
        for load in self.forces[i]:
            direction = np.array(load.direction) / np.hypot(*load.direction)
            total += direction[:, None] * evaluate_law(load.law, t)[0]
        return total

    def _balance(self, t, p, v, a, cx, cy):
        """Return Rx, Ry, the residual of the moment equation times (1 + cx cy), and the pin forces.

        `a` is p''; `cx` and `cy` are the frictions in units of Rx and Ry.
        """
        c2, s2 = self._second(p, v, a)
        sin, cos = np.sin(p), np.cos(p)
        Ex = self._applied(0, t, self.L * cos, -self.L * sin * v)
        Ey = self._applied(1, t, self.L * sin, self.L * cos * v)
        Gx, Gy = self.m * self.gravity[0], self.m * self.gravity[1]
        torque = sum((evaluate_law(load.law, t)[0] for load in self.torques), np.zeros_like(t))

        # The reactions follow from the momentum of the whole along y and x, with frictions that are
        # multiples of the reactions.
        A = self.m * self.lx * s2 + self.my * self.L * s2 - Ey[1] - Ex[1] - Gy
        B = -self.m * self.ly * c2 - self.mx * self.L * c2 + Ex[0] + Ey[0] + Gx
        common = 1 + cx * cy
        Rx, Ry = (A - cy * B) / common, (B + cx * A) / common

        # The pin forces follow from the balances of the sliders. The residual of the bar's moments, times
        # (1 + cx cy), is linear in p'' for given c, and quadratic in rho at rest.
        Hx, Vx = self.mx * self.L * c2 - cx * Rx - Ex[0], -Rx - Ex[1]
        Hy, Vy = Ry - Ey[0], self.my * self.L * s2 - cy * Ry - Ey[1]
        moment = self.lx * (cos * Vx + sin * Hx) - self.ly * (cos * Vy + sin * Hy) - torque
        return Rx, Ry, (self.inertia * a - moment) * common, (Hx, Vx, Hy, Vy)

    def _friction(self, p, mode: Mode, rho):
        """Return cx and cy in slip, or at rest with the mobilized fraction rho."""
        if mode.turn:
            return tuple(
                -contact.mu * s * sign
                for contact, s, sign in zip(self.contacts, mode.slip, mode.signs)
            )
        forward = -np.sign(np.sin(p)), np.sign(np.cos(p))
        return tuple(
            -rho * contact.mus * e * sign
            for contact, e, sign in zip(self.contacts, forward, mode.signs)
        )

    def mobilization(self, t, p, mode: Mode):
        """Return rho at rest, the root of the quadratic that is continuous with rho = 0."""
        # The coefficients of the quadratic follow from three of its values.
        zero = np.zeros_like(t)
        minus, constant, plus = (
            self._balance(t, p, zero, zero, *self._friction(p, mode, rho))[2]
            for rho in (-1.0, 0.0, 1.0)
        )
        square = (plus + minus) / 2 - constant
        linear = (plus - minus) / 2
        # The smaller root is computed without cancellation. Beyond break-away there may be no root; the
        # result is then not finite.
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(linear**2 - 4 * square * constant)
            return -2 * constant / (linear + np.copysign(root, linear))

    def acceleration(self, t, q, v, mode: Mode):
        if mode.turn == 0:
            return np.zeros_like(q)
        # The residual is linear in p'', so that its zero follows from two values.
        c = self._friction(q[0], mode, None)
        at_zero, at_one = (
            self._balance(t, q[0], v[0], a, *c)[2] for a in (np.zeros_like(t), np.ones_like(t))
        )
        return (at_zero / (at_zero - at_one))[None]

    def guards(self, t, q, v, a, mode: Mode):
        p, rate = q[0], v[0]
        rho = self.mobilization(t, p, mode) if mode.turn == 0 else 0.0
        Rx, Ry, _, _ = self._balance(t, p, rate, a[0], *self._friction(p, mode, rho))
        normals = [mode.signs[0] * Rx, mode.signs[1] * Ry]
        if mode.turn == 0:
            return np.array([1 + rho, 1 - rho, *normals])[:, None]
        # X' = -L sin p p' and Y' = L cos p p' keep their directions up to the dead points, while these
        # functions are positive.
        geometry = [-mode.turn * mode.slip[0] * np.sin(p), mode.turn * mode.slip[1] * np.cos(p)]
        return np.array([mode.turn * rate, *geometry, *normals])[:, None]

    def candidates(self, t: float, q, v, mode: Mode | None, guard: int | None):
        signs = list(product((1, -1), (1, -1)))
        rest = np.zeros(1)
        stopped = v[0] == 0 if mode is None else mode.turn == 0 or guard == 0
        if stopped:
            # Rest has precedence if static friction suffices. All directions of slip are tried with both
            # turns; the guards reject those that are geometrically impossible.
            moving = [
                (Mode(turn, slip, sign), rest)
                for turn in (1, -1)
                for slip in signs
                for sign in signs
            ]
            resting = [(Mode(0, (0, 0), sign), rest) for sign in signs]
            if any(contact.mus for contact in self.contacts):
                yield resting
            yield moving
        else:
            turn = int(np.sign(v[0])) if mode is None else mode.turn
            yield [(Mode(turn, slip, sign), v) for slip in signs for sign in signs]

    def slip(self, mode: Mode) -> tuple[int, ...]:
        return mode.slip

    def corner_guide(self, mode: Mode, guard: int) -> int:
        return guard - (2 if mode.turn == 0 else 3)

    def columns(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Mode
    ) -> dict[str, np.ndarray]:
        a = self.acceleration(t, q, v, mode)
        (p,), (rate,), (turn,) = q, v, a
        sin, cos, zero = np.sin(p), np.cos(p), np.zeros_like(t)
        c2, s2 = self._second(p, rate, turn)
        c1, s1 = -sin * rate, cos * rate
        # The coordinates of the bar's centre and of both sliders are multiples of cos p and sin p.
        values = {"bar.angle": -p, "bar.omega": -rate, "bar.alpha": -turn}
        for name, x, y in (
            ("bar", self.ly, self.lx),
            ("slider-x", self.L, 0.0),
            ("slider-y", 0.0, self.L),
        ):
            values |= body_columns(name, (x * cos, y * sin), (x * c1, y * s1), (x * c2, y * s2))
        rho = self.mobilization(t, p, mode) if mode.turn == 0 else 0.0
        c = self._friction(p, mode, rho)
        Rx, Ry, _, (Hx, Vx, Hy, Vy) = self._balance(t, p, rate, turn, *c)
        # (H, V) act on the sliders; the columns of a pin contain the force on its first body, the bar.
        values |= {"pin-x.fx": -Hx, "pin-x.fy": -Vx, "pin-y.fx": -Hy, "pin-y.fy": -Vy}
        along = ((self.L * cos, self.L * c1), (self.L * sin, self.L * s1))
        for i, (name, R) in enumerate((("guide-x", Rx), ("guide-y", Ry))):
            values |= self.contacts[i].columns(
                name,
                R,
                zero,
                c[i] * mode.signs[i] + zero,
                zero + mode.slip[i],
                displacement=along[i][0],
                slip_velocity=along[i][1],
            )
        return values


_STAYS_ON_ONE_SURFACE = Condition(
    "mus * width < length",
    lambda guide: (
        guide.length is None or guide.static_coefficient * (guide.width or 0.0) < guide.length
    ),
)
_FORMULA = Constant | Linear | Sine


def _parts(axis: str, direction: tuple[int, int], forward: tuple[Any, Any]) -> dict[str, Part]:
    """Return the parts at the slider of an axis, by label; `forward` is the requirement on the axis of springs."""
    pin, guide, slider = f"pin-{axis}", f"guide-{axis}", f"slider-{axis}"
    side = POSITIVE if axis == "x" else NEGATIVE
    return {
        pin: Part(Revolute, "bar", slider, name=pin, points=((side, 0), CENTRE)),
        guide: Part(
            Translational,
            slider,
            GROUND,
            name=guide,
            direction=direction,
            point=CENTRE,
            slider_point=CENTRE,
            where=_STAYS_ON_ONE_SURFACE,
        ),
        f"springs-{axis}": Part(
            LinearSpring, slider, GROUND, count=SEVERAL, points=(CENTRE, ANY), axis=forward
        ),
        f"forces-{axis}": Part(Force, slider, count=SEVERAL, point=CENTRE, law=_FORMULA),
    }


TRAMMEL = Structure(
    "an elliptic trammel",
    ("bar", "slider-x", "slider-y"),
    {
        **_parts("x", (1, 0), (POSITIVE, 0)),
        **_parts("y", (0, 1), (0, POSITIVE)),
        "torques": Part(Torque, "bar", count=SEVERAL, law=_FORMULA),
    },
)


def trammel_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of an elliptic trammel, whose parts have the names of `TRAMMEL`, for mus b < a."""
    match = TRAMMEL.match(scene)

    def elements(*labels: str) -> tuple[tuple[Any, ...], ...]:
        """Return the elements of each of some parts."""
        return tuple(tuple(match.elements[label].values()) for label in labels)

    bar = scene.bodies["bar"]
    mechanism = Trammel(
        m=bar.mass,
        inertia=bar.inertia,
        lx=match["pin-x"].points[0][0],
        ly=-match["pin-y"].points[0][0],
        mx=scene.bodies["slider-x"].mass,
        my=scene.bodies["slider-y"].mass,
        gravity=scene.gravity or (0.0, 0.0),
        contacts=(Contact.of(match["guide-x"]), Contact.of(match["guide-y"])),
        springs=elements("springs-x", "springs-y"),
        forces=elements("forces-x", "forces-y"),
        torques=tuple(match.elements["torques"].values()),
    )
    return truth_of(
        scene,
        ("guide-x", "guide-y"),
        mechanism,
        np.array([-bar.angle]),
        np.array([-bar.angular_velocity]),
        t_end,
    )
