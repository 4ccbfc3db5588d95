"""What a scene is: a planar mechanism and the effects it declares.

Conventions. SI units, angles in radians, counter-clockwise positive. Points and directions
that belong to a body are given in that body's axes, from its centre of mass; `"ground"` is the
fixed body with origin (0, 0). Every element has a name of its own within the scene.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr

from scenes.fields import GROUND, Direction, Model, Name, NonNegative, Number, Positive, Vector
from scenes.laws import Law, Table, evaluate_law


class Body(Model):
    """A rigid body and its state at t = 0; `position` is that of the centre of mass."""

    mass: Positive
    inertia: Positive
    position: Vector = (0.0, 0.0)
    angle: Number = 0.0
    velocity: Vector = (0.0, 0.0)
    angular_velocity: Number = 0.0


class Revolute(Model):
    """A smooth pin: `points[0]` of `bodies[0]` coincides with `points[1]` of `bodies[1]`.

    Reported force `fx`, `fy` (ground axes) acts on `bodies[0]`.
    """

    type: Literal["revolute"]
    bodies: tuple[Name, Name]
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))


class Translational(Model):
    """A slider on a guide.

    The slider's point `slider_point` stays on the line through `point` along `direction`
    (both in the axes of the guide), and the slider's angle minus the guide's stays `angle`.
    The normal is `direction` turned by +90 degrees; the lower surface (+) pushes the slider
    along it, the upper surface (-) against it.

    `length` (along the guide) resolves the normal force into corner forces, `width` (across)
    gives the friction of the two surfaces its lever. `mu` declares dry friction; `mus`, the
    static coefficient, is `mu` where it is not given (Coulomb's law with one coefficient).
    """

    type: Literal["translational"]
    slider: Name
    guide: Name = GROUND
    direction: Direction = (1.0, 0.0)
    point: Vector = (0.0, 0.0)
    slider_point: Vector = (0.0, 0.0)
    angle: Number = 0.0
    length: Positive | None = None
    width: NonNegative | None = None
    mu: NonNegative | None = None
    mus: NonNegative | None = None

    @property
    def bodies(self) -> tuple[str, str]:
        return self.slider, self.guide

    @property
    def frictional(self) -> bool:
        return self.mu is not None

    @property
    def static_coefficient(self) -> float:
        """The static coefficient in force, `mus` or else `mu` (0 without friction)."""
        return self.mus if self.mus is not None else self.mu or 0.0

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if self.width is not None and self.length is None:
            yield "width", self.width, "expected length too: the lever of surface friction needs corner forces"
        if self.mus is not None and self.mu is None:
            yield "mus", self.mus, "expected the kinetic coefficient mu too"
        if self.mus is not None and self.mu is not None and self.mus < self.mu:
            yield "mus", self.mus, f"expected at least mu = {self.mu:g}"


Joint = Annotated[Revolute | Translational, Field(discriminator="type")]


class Drive(Model):
    """A coordinate between two bodies that follows a law of time; the motor gives what it takes.

    `angle`: the angle of `bodies[0]` minus that of `bodies[1]`; effort = torque on `bodies[0]`.
    `distance`: from `points[1]` of `bodies[1]` to `points[0]` of `bodies[0]`, along `axis` of
    `bodies[1]` (signed) if that is given; effort = force on `bodies[0]` in that direction.
    """

    type: Literal["angle", "distance"]
    bodies: tuple[Name, Name]
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))
    axis: Direction | None = None
    law: Law

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if isinstance(self.law, Table) and self.law.interpolation != "cubic":
            yield "law.interpolation", self.law.interpolation, ("expected 'cubic': along straight lines a drive "
                                                                "would have infinite accelerations")
        if self.type == "angle":
            for key in ("points", "axis"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    yield key, getattr(self, key), "expected in a distance drive only; this one drives an angle"
        elif self.axis is None and (start := evaluate_law(self.law, 0.0)[0]) <= 0:
            yield "law", start, "the distance at t = 0; expected one > 0 (or an axis, which gives it a sign)"


class LinearSpring(Model):
    """Spring and damper between two points: tension `stiffness (d - rest_length) + damping d'`.

    `d` is the distance of the points or, if `axis` (in the axes of `bodies[1]`) is given, the
    signed coordinate of `points[0]` seen from `points[1]` along it. With `rest_length = 0` and
    no axis the force is `-stiffness` times the vector between the points.
    """

    type: Literal["linear"]
    bodies: tuple[Name, Name]
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))
    axis: Direction | None = None
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0
    rest_length: Number = 0.0

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if self.axis is None and self.rest_length < 0:
            yield "rest_length", self.rest_length, "expected a distance >= 0 (or an axis, which gives it a sign)"


class TorsionalSpring(Model):
    """Torque `-(stiffness (angle - rest_angle) + damping angle')` on `bodies[0]`, opposite on `bodies[1]`.

    `angle` is the angle of `bodies[0]` minus that of `bodies[1]`.
    """

    type: Literal["torsional"]
    bodies: tuple[Name, Name]
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0
    rest_angle: Number = 0.0


Spring = Annotated[LinearSpring | TorsionalSpring, Field(discriminator="type")]


class Force(Model):
    """A force `law(t) * direction/|direction|` (ground axes) at `point` of `body`."""

    type: Literal["force"]
    body: Name
    point: Vector = (0.0, 0.0)
    direction: Direction
    law: Law


class Torque(Model):
    """A torque `law(t)` on `body`."""

    type: Literal["torque"]
    body: Name
    law: Law


Load = Annotated[Force | Torque, Field(discriminator="type")]


class Baumgarte(Model):
    """`Phi'' + 2 alpha Phi' + beta^2 Phi = 0` instead of `Phi'' = 0` (Zhuang & Wang 2014, eq. 25)."""

    method: Literal["baumgarte"] = "baumgarte"
    alpha: NonNegative
    beta: NonNegative


class Projection(Model):
    """State projected back onto the constraints after each step, in the metric of the mass matrix."""

    method: Literal["projection"]


class NoStabilization(Model):
    """Constraints hold at acceleration level only."""

    method: Literal["none"]


Stabilization = Annotated[Baumgarte | Projection | NoStabilization, Field(discriminator="method")]


class Scene(Model):
    """A planar mechanism and only the effects it declares."""

    title: str = ""
    source: str = ""
    t_end: Positive = 10.0
    parameters: dict[Name, Number] = {}
    gravity: Vector | None = None
    bodies: dict[Name, Body] = Field(min_length=1)
    joints: dict[Name, Joint] = {}
    drives: dict[Name, Drive] = {}
    springs: dict[Name, Spring] = {}
    forces: dict[Name, Load] = {}
    stabilization: Stabilization = NoStabilization(method="none")
    _raw: dict[str, Any] = PrivateAttr(default_factory=dict)
    _origin: str = PrivateAttr(default="<scene>")
    _name: str = PrivateAttr(default="<scene>")

    def __eq__(self, other: object) -> bool:
        """Whether both declare the same mechanism; where they were read from does not matter."""
        return isinstance(other, Scene) and self.__dict__ == other.__dict__

    @property
    def name(self) -> str:
        """The name of the file without its ending."""
        return self._name

    @property
    def guides(self) -> dict[str, Translational]:
        """The translational joints, by name."""
        return {name: joint for name, joint in self.joints.items() if isinstance(joint, Translational)}

    @property
    def frictional_guides(self) -> dict[str, Translational]:
        """The translational joints that declare friction, by name."""
        return {name: guide for name, guide in self.guides.items() if guide.frictional}
