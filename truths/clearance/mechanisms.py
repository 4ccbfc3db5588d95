"""Mechanisms with one slider in a guide with clearance, in minimal coordinates.

The guide lies along the x axis, its middle line at the height h. The slider (length a, width b) has the centre (x, y)
and the angle phi; the gap between the centred slider and each surface is c. Corners 1 .. 4 are lower rear, lower front,
upper front and upper rear, as in a `Trajectory`. A corner at (along, across) = (+-a/2, +-b/2) in the slider's axes, on
the side sigma (1: lower surface, -1: upper), has

    g = sigma (y + along sin phi + across cos phi - h) + b/2 + c                               gap
    u_N = g' = sigma (y' + (along cos phi - across sin phi) phi') ,
    u_T = x' - (along sin phi + across cos phi) phi'                                           slip velocity,

and these rates have the rates, with (x, y, phi)'' inserted,

    u_N' = sigma (y'' + (along cos phi - across sin phi) phi'' - (along sin phi + across cos phi) phi'^2) ,
    u_T' = x'' - (along sin phi + across cos phi) phi'' - (along cos phi - across sin phi) phi'^2 .

The coordinates q of a mechanism determine the slider's pose: (x, y, phi)' = P(q) v and (x, y, phi)'' = P v' + p(q, v).
Its equations of motion without contact are M(q) v' = f(q, v).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Revolute, Translational
from stiction.truths.structure import (
    ANY,
    CENTRE,
    FORWARD,
    NEGATIVE,
    POSITIVE,
    Match,
    Part,
    Structure,
)
from stiction.truths.truth import NotThisMechanism

CORNERS = 4
"""Number of corners of a slider."""
_ALONG = np.array([-1.0, 1.0, 1.0, -1.0])
"""Position of each corner along the slider, in halves of its length."""
_SIDE = np.array([1.0, 1.0, -1.0, -1.0])
"""Side of each corner: 1 at the lower surface, -1 at the upper one."""


@dataclass(frozen=True)
class Gap:
    """Dimensions and contact law of a slider in its guide.

    Attributes
    ----------
    length, width : float
        Length a and width b of the slider, m.
    clearance : float
        Gap c between the centred slider and each surface, m.
    mu : float
        Coefficient of friction.
    restitution : float
        Newton's coefficient e of the normal velocity, 0 .. 1.
    height : float
        Height h of the middle line of the guide, m.
    """

    length: float
    width: float
    clearance: float
    mu: float
    restitution: float
    height: float = 0.0

    def __post_init__(self) -> None:
        for name in ("length", "width", "clearance"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: found {getattr(self, name)!r}; expected > 0")
        if not self.mu >= 0:
            raise ValueError(f"mu: found {self.mu!r}; expected >= 0")
        if not 0 <= self.restitution <= 1:
            raise ValueError(f"restitution: found {self.restitution!r}; expected 0 .. 1")


@dataclass(frozen=True)
class CornerRows:
    """Kinematics of all corners in one state.

    Attributes
    ----------
    gap : ndarray, shape (4,)
        Distances from the surfaces, m.
    normal, tangent : ndarray, shape (4, n)
        Derivatives of the rates u_N and u_T by the velocities.
    normal_bias, tangent_bias : ndarray, shape (4,)
        Rates of u_N and u_T without accelerations of the coordinates, m/s^2.
    """

    gap: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    normal_bias: np.ndarray
    tangent_bias: np.ndarray


class GapMechanism(ABC):
    """A mechanism with n coordinates and one slider in a gap; q and v have the shape (n,)."""

    gap: Gap

    @abstractmethod
    def mass(self, q: np.ndarray) -> np.ndarray:
        """Return the mass matrix M, shape (n, n)."""

    @abstractmethod
    def force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the forces f without contact, shape (n,), including those that depend on velocities."""

    @abstractmethod
    def potential(self, q: np.ndarray) -> float:
        """Return the potential of all forces, J."""

    @abstractmethod
    def pose(self, q: np.ndarray) -> np.ndarray:
        """Return (x, y, phi) of the slider."""

    @abstractmethod
    def pose_rows(self, q: np.ndarray) -> np.ndarray:
        """Return P, the derivatives of (x, y, phi) by the coordinates, shape (3, n)."""

    @abstractmethod
    def pose_bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return p, the accelerations of (x, y, phi) without accelerations of the coordinates, shape (3,)."""

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Return kinetic energy plus potential, J."""
        return 0.5 * float(v @ self.mass(q) @ v) + self.potential(q)

    def gaps(self, q: np.ndarray) -> np.ndarray:
        """Return the distance of each corner from its surface, m, shape (4,)."""
        _, y, phi = self.pose(q)
        along, across = self._places()
        lift = y + along * np.sin(phi) + across * np.cos(phi) - self.gap.height
        return _SIDE * lift + 0.5 * self.gap.width + self.gap.clearance

    def corner_rows(self, q: np.ndarray, v: np.ndarray) -> CornerRows:
        """Return the kinematics of all corners."""
        phi = self.pose(q)[2]
        along, across = self._places()
        cos, sin = np.cos(phi), np.sin(phi)
        # Components of the lever from the centre to each corner, in the axes of the guide.
        lever_x = along * cos - across * sin
        lever_y = along * sin + across * cos
        rows, bias = self.pose_rows(q), self.pose_bias(q, v)
        spin = float(rows[2] @ v) ** 2
        normal = _SIDE[:, None] * (rows[1] + lever_x[:, None] * rows[2])
        tangent = rows[0] - lever_y[:, None] * rows[2]
        normal_bias = _SIDE * (bias[1] + lever_x * bias[2] - lever_y * spin)
        tangent_bias = bias[0] - lever_y * bias[2] - lever_x * spin
        return CornerRows(self.gaps(q), normal, tangent, normal_bias, tangent_bias)

    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of the corners along and across the slider, m, each of shape (4,)."""
        return 0.5 * self.gap.length * _ALONG, -0.5 * self.gap.width * _SIDE


@dataclass(frozen=True)
class FreeSlider(GapMechanism):
    """A slider that nothing but its guide touches, under a constant force at its centre; q = (x, y, phi).

    Attributes
    ----------
    gap : Gap
        Its guide.
    mass_kg, inertia : float
        Mass, kg, and moment of inertia about the centre, kg m^2.
    force_x, force_y : float
        Constant force, N.
    torque : float
        Constant torque, N m.
    """

    gap: Gap
    mass_kg: float
    inertia: float
    force_x: float = 0.0
    force_y: float = 0.0
    torque: float = 0.0

    def mass(self, q: np.ndarray) -> np.ndarray:
        return np.diag([self.mass_kg, self.mass_kg, self.inertia])

    def force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([self.force_x, self.force_y, self.torque])

    def potential(self, q: np.ndarray) -> float:
        return -float(self.force(q, q) @ q)

    def pose(self, q: np.ndarray) -> np.ndarray:
        return q

    def pose_rows(self, q: np.ndarray) -> np.ndarray:
        return np.eye(3)

    def pose_bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.zeros(3)


@dataclass(frozen=True)
class ClearanceSliderCrank(GapMechanism):
    """A slider-crank whose crank is free and whose slider has clearance; q = angles of crank, rod and slider.

    With th, ps the angles of crank and rod, the pivot at the origin, l and r their lengths, s and t the distances of
    their centres of mass from the pivot and the crank pin, and k = (m_rod t + m_slider r) l, Lagrange's equations are

        A th'' + k cos(ps - th) ps'' = k sin(ps - th) ps'^2 + (m_crank s + (m_rod + m_slider) l) g.n(th)
        B ps'' + k cos(ps - th) th'' = -k sin(ps - th) th'^2 + (m_rod t + m_slider r) g.n(ps)
        J_slider phi'' = 0

        A = J_crank + m_crank s^2 + (m_rod + m_slider) l^2 ,   B = J_rod + m_rod t^2 + m_slider r^2

    with the gravity g and n(angle) = (-sin, cos) the derivative of the direction (cos, sin) of a bar.

    Attributes
    ----------
    gap : Gap
        The guide.
    crank_length, rod_length : float
        Lengths l and r, m.
    crank_centre, rod_centre : float
        Distances s and t, m.
    masses, inertias : tuple of float
        Masses, kg, and moments of inertia about the centres of mass, kg m^2, of crank, rod and slider.
    gravity : tuple of float
        Acceleration of gravity, m/s^2.
    """

    gap: Gap
    crank_length: float
    rod_length: float
    crank_centre: float
    rod_centre: float
    masses: tuple[float, float, float]
    inertias: tuple[float, float, float]
    gravity: tuple[float, float]

    @cached_property
    def _moments(self) -> np.ndarray:
        """First moments of mass that hang on each angle, kg m."""
        crank, rod, slider = self.masses
        return np.array(
            [
                crank * self.crank_centre + (rod + slider) * self.crank_length,
                rod * self.rod_centre + slider * self.rod_length,
                0.0,
            ]
        )

    @cached_property
    def _inertias(self) -> np.ndarray:
        """Diagonal of the mass matrix, (A, B, J_slider), kg m^2."""
        crank, rod, slider = self.masses
        carried = [
            crank * self.crank_centre**2 + (rod + slider) * self.crank_length**2,
            rod * self.rod_centre**2 + slider * self.rod_length**2,
            0.0,
        ]
        return np.array(self.inertias) + np.array(carried)

    @cached_property
    def _coupling(self) -> float:
        """The constant k, kg m^2."""
        return float(self._moments[1] * self.crank_length)

    @cached_property
    def _lengths(self) -> np.ndarray:
        """Lengths of crank and rod, m."""
        return np.array([self.crank_length, self.rod_length])

    def mass(self, q: np.ndarray) -> np.ndarray:
        matrix = np.diag(self._inertias)
        matrix[0, 1] = matrix[1, 0] = self._coupling * np.cos(q[1] - q[0])
        return matrix

    def force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        turning = self._coupling * np.sin(q[1] - q[0])
        centrifugal = np.array([turning * v[1] ** 2, -turning * v[0] ** 2, 0.0])
        weight = self._moments * (self.gravity[1] * np.cos(q) - self.gravity[0] * np.sin(q))
        return centrifugal + weight

    def potential(self, q: np.ndarray) -> float:
        along_gravity = self.gravity[0] * np.cos(q) + self.gravity[1] * np.sin(q)
        return -float(self._moments @ along_gravity)

    def pose(self, q: np.ndarray) -> np.ndarray:
        lengths = self._lengths
        return np.array([lengths @ np.cos(q[:2]), lengths @ np.sin(q[:2]), q[2]])

    def pose_rows(self, q: np.ndarray) -> np.ndarray:
        lengths = self._lengths
        rows = np.zeros((3, 3))
        rows[0, :2] = -lengths * np.sin(q[:2])
        rows[1, :2] = lengths * np.cos(q[:2])
        rows[2, 2] = 1.0
        return rows

    def pose_bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        lengths = self._lengths
        centripetal = -lengths * v[:2] ** 2
        return np.array([centripetal @ np.cos(q[:2]), centripetal @ np.sin(q[:2]), 0.0])

    def with_gap(self, **changes: float) -> ClearanceSliderCrank:
        """Return the mechanism with other dimensions or another law of its gap."""
        return replace(self, gap=replace(self.gap, **changes))


FREE_SLIDER_CRANK = Structure(
    "a slider-crank with a free crank",
    ("crank", "rod", "slider"),
    {
        "pivot": Part(Revolute, "crank", GROUND, points=((NEGATIVE, 0), (0, 0))),
        "crank pin": Part(Revolute, "rod", "crank", points=((NEGATIVE, 0), (POSITIVE, 0))),
        "slider pin": Part(Revolute, "rod", "slider", points=((POSITIVE, 0), CENTRE)),
        "guide": Part(
            Translational,
            "slider",
            GROUND,
            direction=FORWARD,
            slider_point=CENTRE,
            angle=0,
            length=POSITIVE,
            width=POSITIVE,
            clearance=POSITIVE,
            restitution=ANY,
        ),
    },
)
"""Slider-cranks that `slider_crank_with_clearance` applies to."""


def slider_crank_with_clearance(
    scene: Scene,
) -> tuple[ClearanceSliderCrank, np.ndarray, np.ndarray]:
    """Return the slider-crank of a scene with clearance in its guide, and its coordinates and velocities at the start.

    Parameters
    ----------
    scene : Scene
        A slider-crank with frictionless pins and without a drive, whose bars have their pins on their x axes, and
        whose guide declares its clearance.

    Raises
    ------
    NotThisMechanism
        If the scene is another mechanism, or its guide has a static coefficient of friction of its own.
    """
    match: Match = FREE_SLIDER_CRANK.match(scene)
    guide = match["guide"]
    if guide.static_coefficient != guide.kinetic_coefficient:
        raise NotThisMechanism(
            f"joints.{match.name('guide')}.mus: found {guide.static_coefficient:g}; expected mu = "
            f"{guide.kinetic_coefficient:g}, the one coefficient of the impact law"
        )
    crank, rod, slider = (scene.bodies[match.bodies[role]] for role in ("crank", "rod", "slider"))
    (pivot, _), (crank_pin, crank_end), (rod_end, _) = (
        match[label].points for label in ("pivot", "crank pin", "slider pin")
    )
    mechanism = ClearanceSliderCrank(
        Gap(
            guide.length,
            guide.width,
            guide.clearance,
            guide.mu or 0.0,
            guide.restitution,
            guide.point[1],
        ),
        crank_length=crank_end[0] - pivot[0],
        rod_length=rod_end[0] - crank_pin[0],
        crank_centre=-pivot[0],
        rod_centre=-crank_pin[0],
        masses=(crank.mass, rod.mass, slider.mass),
        inertias=(crank.inertia, rod.inertia, slider.inertia),
        gravity=scene.gravity or (0.0, 0.0),
    )
    q = np.array([crank.angle, rod.angle, slider.angle], dtype=float)
    v = np.array([body.angular_velocity for body in (crank, rod, slider)], dtype=float)
    return mechanism, q, v
