"""Scene: a planar mechanism and the effects it declares.

Conventions: quantities are in SI units; angles are in radians, positive counter-clockwise. Points
and directions that belong to a body are given in the axes of this body, from its centre of mass.
`"ground"` is the fixed body with the origin (0, 0). No two elements of a scene have the same name.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, PrivateAttr

from stiction.scenes.fields import (
    GROUND,
    Direction,
    Inertial,
    Name,
    NonNegative,
    Number,
    Part,
    Positive,
    Restitution,
    Shape,
    Vector,
)
from stiction.scenes.laws import Law, Sum, Table, evaluate_law, law_terms
from stiction.scenes.wording import shortened

if TYPE_CHECKING:
    from stiction.scenes.pictures.picture import Picture


class Body(Part):
    """A rigid body and its state at t = 0."""

    mass: Inertial
    """Mass; kg, > 0"""
    inertia: Inertial
    """Moment of inertia about the centre of mass; kg m², > 0"""
    position: Vector = (0.0, 0.0)
    """Position of the centre of mass in ground axes; m"""
    angle: Number = 0.0
    """Angle of the body's axes relative to those of the ground; rad"""
    velocity: Vector = (0.0, 0.0)
    """Velocity of the centre of mass; m/s"""
    angular_velocity: Number = 0.0
    """Angular velocity; rad/s"""


class Revolute(Part):
    """A pin: `points[0]` of `bodies[0]` coincides with `points[1]` of `bodies[1]`.

    The reported force `fx`, `fy` (in ground axes) is the force on `bodies[0]`. `friction` declares dry friction whose
    bound is a torque of its own; it does not depend on the force in the pin. `mu` and `radius` declare dry friction of
    a journal under load: its bound is the torque `mu` times `radius` times the size of the force in the pin. With both,
    the bound is their sum. At rest `static_friction` and `mus` take their places. The reported torque `friction` acts
    on `bodies[0]`, against the angular velocity of `bodies[0]` relative to `bodies[1]`.

    With a `stribeck_velocity` the bound falls smoothly with the angular velocity w of slip, from that at rest to that
    of fast slip: the constant part is
    `friction + (static_friction - friction) exp(-(|w| / stribeck_velocity)^stribeck_shape)`, and the coefficient
    likewise.
    """

    type: Literal["revolute"] = "revolute"
    """A pin"""
    bodies: tuple[Name, Name]
    """Names of two bodies; one of them may be `"ground"`"""
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))
    """`[[x, y], [x, y]]`, the coinciding points in the axes of the two bodies; m"""
    mu: NonNegative | None = None
    """Kinetic coefficient of friction between journal and bearing; requires `radius`"""
    mus: NonNegative | None = None
    """Static coefficient of friction, at least `mu`; default: `mu`"""
    radius: Positive | None = None
    """Radius of the journal, at which friction by the force in the pin acts; requires `mu`; m, > 0"""
    friction: NonNegative | None = None
    """Part of the torque of dry friction, while the pin turns, that does not depend on the force in the pin; N m"""
    static_friction: NonNegative | None = None
    """The same at rest, its largest value, at least `friction`; default: `friction`; N m"""
    stribeck_velocity: Positive | None = None
    """Speed by which the bound falls from that at rest to that of fast slip; default: at once; rad/s, > 0"""
    stribeck_shape: Shape = 1.0
    """Exponent of the speed in this fall, 2 for a Gaussian curve; requires `stribeck_velocity`; >= 1"""
    damping: NonNegative = 0.0
    """Damping coefficient of the relative rotation; N m s"""

    @property
    def frictional(self) -> bool:
        """True if the pin declares dry friction, by a coefficient or by a torque of its own."""
        return self.mu is not None or self.friction is not None

    @property
    def bounds(self) -> tuple[float, float]:
        """The constant parts of the bounds of friction, of a pin that turns and of one at rest, N m."""
        return _bounds(self)

    @property
    def friction_radii(self) -> tuple[float, float]:
        """Radii of the friction circle, `mu` and `mus` times `radius`: torque per force in the pin, m."""
        kinetic = self.mu or 0.0
        static = kinetic if self.mus is None else self.mus
        radius = self.radius or 0.0
        return kinetic * radius, static * radius

    @property
    def is_under_load(self) -> bool:
        """True if its friction depends on the force in the pin."""
        return self.friction_radii[1] > 0.0

    @property
    def rubs(self) -> bool:
        """True if its friction can differ from zero: a pin whose bounds and coefficients are all 0 turns freely."""
        return self.bounds[1] > 0.0 or self.is_under_load

    @property
    def damper(self) -> TorsionalSpring | None:
        """The damping of the pin as a damper between its bodies; None without any."""
        if not self.damping:
            return None
        return TorsionalSpring(bodies=self.bodies, damping=self.damping)

    @property
    def depends_on_speed(self) -> bool:
        """True if the bound of its friction falls with the speed of slip (`stribeck_velocity`)."""
        if self.stribeck_velocity is None:
            return False
        kinetic, static = self.friction_radii
        return static > kinetic or self.bounds[1] > self.bounds[0]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield combinations of keys of friction that have no meaning, see `Model.inconsistencies`."""
        if self.mu is not None and self.radius is None:
            yield "mu", self.mu, "expected the radius of the journal too"
        if self.radius is not None and self.mu is None:
            yield "radius", self.radius, "expected a coefficient of friction, mu, too"
        yield from _inconsistent_coefficients(self)
        yield from _inconsistent_bounds(self)
        yield from _inconsistent_curve(self)


class Translational(Part):
    """A slider on a guide.

    The point `slider_point` of the slider stays on the line through `point` along `direction` (both in the axes of the
    guide), and the angle of the slider minus that of the guide is always `angle`. The normal is `direction` turned by
    +90 degrees. The lower surface (+) pushes the slider along the normal, the upper surface (-) against it.

    With a `length` (along the guide) the normal force is resolved into corner forces. With a `width` (across the guide)
    the friction of the two surfaces has a lever arm. `mu` declares dry friction whose bound is a multiple of the normal
    force, `friction` dry friction whose bound is a force of its own; with both, the bound of the guide is their sum,
    `friction` + `mu` times the normal force. At rest `static_friction` and `mus` take their places, by default the same
    numbers (Coulomb's law with one bound). The constant part acts along the line through `slider_point`: it does not
    turn the slider.

    A `normal_load`, such as a weight across the plane of the mechanism, adds `mu` (at rest `mus`) times itself to this
    constant part. The reported normal force and corner forces are those in the plane, without it.

    With a `stribeck_velocity` both fall smoothly with the speed v of slip (Stribeck's curve), from their values at rest
    to those of fast slip: the coefficient is `mu + (mus - mu) exp(-(|v| / stribeck_velocity)^stribeck_shape)`, and the
    constant part likewise. Friction is then continuous as the guide breaks away.

    With a `clearance` the slider has a gap to each surface while it is in the middle and parallel to the guide: it can
    move across the guide and turn until its corners touch. A corner that hits a surface rebounds with the coefficient
    of `restitution`. At contact fidelity all engines take the clearance, and some of them a restitution. Joint
    fidelity, and the reference with it, neglects both, as Zhuang & Wang do, and reports this in the setting `neglected`
    of a run.
    """

    type: Literal["translational"] = "translational"
    """A slider on a guide"""
    slider: Name
    """The sliding body; not the ground"""
    guide: Name = GROUND
    """The body on which it slides"""
    direction: Direction = (1.0, 0.0)
    """Direction of the line in the axes of the guide; any length except 0"""
    point: Vector = (0.0, 0.0)
    """A point of the line in the axes of the guide; m"""
    slider_point: Vector = (0.0, 0.0)
    """The point of the slider that stays on the line, in the axes of the slider; m"""
    angle: Number = 0.0
    """Angle of the slider minus that of the guide; rad"""
    length: Positive | None = None
    """Length of the slider along the guide, needed for corner forces; m, > 0"""
    width: NonNegative | None = None
    """Width of the slider across the guide, the lever arm of surface friction; requires `length`; m"""
    mu: NonNegative | None = None
    """Kinetic coefficient of friction; without it friction does not depend on the normal force"""
    mus: NonNegative | None = None
    """Static coefficient of friction, at least `mu`; default: `mu`"""
    normal_load: NonNegative = 0.0
    """Normal force that presses the slider on its guide beside those in the plane; requires `mu`; N"""
    friction: NonNegative | None = None
    """Part of the bound of friction in slip that does not depend on the normal force; N"""
    static_friction: NonNegative | None = None
    """The same at rest, at least `friction`; default: `friction`; N"""
    stribeck_velocity: Positive | None = None
    """Speed by which the bound falls from that at rest to that of fast slip; default: at once; m/s, > 0"""
    stribeck_shape: Shape = 1.0
    """Exponent of the speed in this fall, 2 for a Gaussian curve; requires `stribeck_velocity`; >= 1"""
    damping: NonNegative = 0.0
    """Damping coefficient of the motion along the guide; N s/m"""
    clearance: Positive | None = None
    """Gap between the slider in the middle of the guide and each surface; requires `length` and `width`; m, > 0"""
    restitution: Restitution = 0.0
    """Newton's coefficient of restitution of a corner that hits a surface, 0 to 1; requires `clearance`"""

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of the slider and of the guide, in the order of the bodies of a revolute joint."""
        return self.slider, self.guide

    @property
    def frictional(self) -> bool:
        """True if the guide declares dry friction, by a coefficient or by a bound of its own."""
        return self.mu is not None or self.friction is not None

    @property
    def bounds(self) -> tuple[float, float]:
        """The constant parts of the bounds of friction, in slip and at rest, with that by the `normal_load`; N."""
        kinetic, static = _bounds(self)
        if not self.normal_load:
            return kinetic, static
        return (
            kinetic + self.kinetic_coefficient * self.normal_load,
            static + self.static_coefficient * self.normal_load,
        )

    @property
    def rubs(self) -> bool:
        """True if its friction can differ from zero: a guide whose bounds and coefficients are all 0 slides freely."""
        return self.static_coefficient > 0.0 or self.bounds[1] > 0.0

    @property
    def damper(self) -> LinearSpring | None:
        """The damping of the guide as a damper along it; None without any."""
        if not self.damping:
            return None
        return LinearSpring(
            bodies=self.bodies,
            points=(self.slider_point, self.point),
            axis=self.direction,
            damping=self.damping,
        )

    @property
    def extent(self) -> tuple[float, float]:
        """`length` and `width`, each 0 if it is not declared; m."""
        return self.length or 0.0, self.width or 0.0

    @property
    def kinetic_coefficient(self) -> float:
        """Kinetic coefficient of friction that applies: `mu`, or 0 without friction."""
        return self.mu or 0.0

    @property
    def static_coefficient(self) -> float:
        """Static coefficient of friction that applies: `mus`, by default `mu`, or 0 without friction."""
        if self.mus is not None:
            return self.mus
        return self.kinetic_coefficient

    @property
    def depends_on_speed(self) -> bool:
        """True if its coefficient or bound of friction falls with the speed of slip (`stribeck_velocity`)."""
        if self.stribeck_velocity is None:
            return False
        falls_with_load = self.static_coefficient > self.kinetic_coefficient
        return falls_with_load or self.bounds[1] > self.bounds[0]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield combinations of size and friction that have no meaning, see `Model.inconsistencies`."""
        if self.width is not None and self.length is None:
            yield (
                "width",
                self.width,
                "expected length too: the lever of surface friction needs corner forces",
            )
        yield from _inconsistent_coefficients(self)
        if self.normal_load and self.mu is None:
            yield "normal_load", self.normal_load, "expected the coefficient of friction mu too"
        yield from self._inconsistent_gap()
        yield from _inconsistent_bounds(self)
        yield from _inconsistent_curve(self)

    def _inconsistent_gap(self) -> Iterator[tuple[str, Any, str]]:
        """Yield a clearance without corners, and a restitution without clearance, as `Model.inconsistencies`."""
        if self.clearance is not None and (self.length is None or self.width is None):
            yield (
                "clearance",
                self.clearance,
                "expected length and width too: they are the places of the corners that touch",
            )
        if self.restitution and self.clearance is None:
            yield "restitution", self.restitution, "expected clearance too: without it nothing hits"


def _inconsistent_coefficients(joint: Revolute | Translational) -> Iterator[tuple[str, Any, str]]:
    """Yield what is wrong with the coefficients of friction of a joint, as `Model.inconsistencies`."""
    if joint.mus is None:
        return
    if joint.mu is None:
        yield "mus", joint.mus, "expected the kinetic coefficient mu too"
    elif joint.mus < joint.mu:
        yield "mus", joint.mus, f"expected at least mu = {joint.mu:g}"


def _bounds(joint: Revolute | Translational) -> tuple[float, float]:
    """Return the constant bounds of friction of a joint, in slip and at rest; 0 where it declares none."""
    kinetic = joint.friction or 0.0
    static = kinetic if joint.static_friction is None else joint.static_friction
    return kinetic, static


def _inconsistent_bounds(joint: Revolute | Translational) -> Iterator[tuple[str, Any, str]]:
    """Yield what is wrong with the constant bounds of friction of a joint, as `Model.inconsistencies`."""
    static = joint.static_friction
    if static is None:
        return
    if joint.friction is None:
        yield "static_friction", static, "expected the bound in slip, friction, too"
    elif static < joint.friction:
        yield "static_friction", static, f"expected at least friction = {joint.friction:g}"


def _inconsistent_curve(joint: Revolute | Translational) -> Iterator[tuple[str, Any, str]]:
    """Yield keys of Stribeck's curve without what it needs, as `Model.inconsistencies`."""
    if joint.stribeck_velocity is None:
        if joint.stribeck_shape != 1.0:
            yield "stribeck_shape", joint.stribeck_shape, "expected stribeck_velocity too"
    elif not joint.frictional:
        yield (
            "stribeck_velocity",
            joint.stribeck_velocity,
            "expected dry friction too, which falls by this speed",
        )


Joint = Annotated[Revolute | Translational, Field(discriminator="type")]


class Drive(Part):
    """A motor: a coordinate between two bodies follows a law of time.

    Without an `effort_limit` the coordinate is that of the law, whatever torque or force this requires. With one, the
    effort is within `-effort_limit` and `effort_limit`: while that suffices, the coordinate changes at the rate of the
    law; otherwise the drive gives way and resists, at its limit, any motion relative to the rate of its law. It holds
    again where the rates are equal, at whatever distance from the law the coordinate then has.

    `angle`: the angle of `bodies[0]` minus that of `bodies[1]`. The reported effort is the torque on `bodies[0]`.

    `distance`: the distance from `points[1]` of `bodies[1]` to `points[0]` of `bodies[0]` or, with an `axis`, the
    signed coordinate along it. The reported effort is the force on `bodies[0]` in that direction.
    """

    type: Literal["angle", "distance"]
    """`"angle"` between two bodies, or `"distance"` of two points"""
    bodies: tuple[Name, Name]
    """Names of two bodies; one of them may be `"ground"`"""
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))
    """The two points in the axes of their bodies; distance only; m"""
    axis: Direction | None = None
    """Direction in the axes of `bodies[1]`: the signed coordinate along it is driven; distance only"""
    law: Law
    """The coordinate as a function of time; rad or m; a table must be cubic"""
    effort_limit: Positive | None = None
    """Largest torque or force of the drive, in either direction; without it there is no limit; N m or N, > 0"""

    @property
    def is_limited(self) -> bool:
        """Whether the drive gives way beyond a limit."""
        return self.effort_limit is not None

    @property
    def rubs(self) -> bool:
        """Whether the drive can give way, as a joint with friction can slip."""
        return self.is_limited

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds of the effort of a drive that gives way and of one that holds; N m or N, 0 without limit."""
        limit = self.effort_limit or 0.0
        return limit, limit

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield laws that no motion can follow, and keys of the other type; see `Model.inconsistencies`."""
        for i, term in enumerate(law_terms(self.law)):
            if isinstance(term, Table) and term.interpolation != "cubic":
                place = f"terms.{i}." if isinstance(self.law, Sum) else ""
                yield (
                    f"law.{place}interpolation",
                    term.interpolation,
                    "expected 'cubic': along straight lines a drive would have infinite accelerations",
                )
        if self.type == "angle":
            for key in ("points", "axis"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    yield (
                        key,
                        getattr(self, key),
                        "expected in a distance drive only; this one drives an angle",
                    )
        elif self.axis is None and not self.is_limited:
            # a limited drive follows the rate of its law alone, so that the law need not be a distance
            distance_at_start, *_ = evaluate_law(self.law, 0.0)
            if distance_at_start <= 0:
                yield (
                    "law",
                    distance_at_start,
                    "the distance at t = 0; expected one > 0 (or an axis, which gives it a sign)",
                )


class LinearSpring(Part):
    """A spring and damper between two points, with the tension `stiffness (d - rest_length) + damping d'`.

    `d` is the distance of the points or, with an `axis`, the signed coordinate of `points[0]` relative to `points[1]`
    along it. With `rest_length = 0` and without axis, the force is `-stiffness` times the vector between the points.

    A spring that `acts` on one side only is an end stop or a bumper ("push"), or a cable ("pull"). The first has no
    force while `d > rest_length`, and no tension above zero; the second has none while `d < rest_length`, and no
    tension below zero. Damping included: a stop never pulls, a cable never pushes.
    """

    type: Literal["linear"] = "linear"
    """A spring and damper between two points"""
    bodies: tuple[Name, Name]
    """Names of two bodies; one of them may be `"ground"`"""
    points: tuple[Vector, Vector] = ((0.0, 0.0), (0.0, 0.0))
    """The two points in the axes of their bodies; m"""
    axis: Direction | None = None
    """Direction in the axes of `bodies[1]`: `d` is the signed coordinate along it"""
    stiffness: NonNegative = 0.0
    """Stiffness; N/m"""
    damping: NonNegative = 0.0
    """Damping coefficient; N s/m"""
    rest_length: Number = 0.0
    """Value of `d` without tension; m"""
    acts: Literal["push", "pull"] | None = None
    """`"push"`: below `rest_length` only, and never pulling; `"pull"`: above it only, never pushing; default: both"""

    @property
    def rest(self) -> float:
        """The coordinate without tension: `rest_length`, m."""
        return self.rest_length

    @property
    def side(self) -> int:
        """The sign of the only stretch and tension that a one-sided spring has; 0 of one that acts on both sides."""
        return _side(self.acts)

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield a rest length that is no distance, or that is never passed; see `Model.inconsistencies`."""
        if self.acts == "push" and self.axis is None and self.rest_length == 0:
            yield (
                "rest_length",
                self.rest_length,
                "expected a distance > 0 with acts = 'push' (or an axis): no distance is below 0",
            )
        if self.axis is None and self.rest_length < 0:
            yield (
                "rest_length",
                self.rest_length,
                "expected a distance >= 0 (or an axis, which gives it a sign)",
            )


class TorsionalSpring(Part):
    """A torsional spring and damper between two bodies.

    The torque on `bodies[0]` is `-(stiffness (angle - rest_angle) + damping angle')`, with the opposite torque on
    `bodies[1]`. `angle` is the angle of `bodies[0]` minus that of `bodies[1]`. With `acts = "push"` there is a torque
    only while `angle < rest_angle`, and only in the direction of larger angles; with `"pull"` only while `angle >
    rest_angle`, and only in the direction of smaller ones.
    """

    type: Literal["torsional"] = "torsional"
    """A torsional spring and damper"""
    bodies: tuple[Name, Name]
    """Names of two bodies; one of them may be `"ground"`"""
    stiffness: NonNegative = 0.0
    """Stiffness; N m/rad"""
    damping: NonNegative = 0.0
    """Damping coefficient; N m s/rad"""
    rest_angle: Number = 0.0
    """Value of `angle` without torque; rad"""
    acts: Literal["push", "pull"] | None = None
    """`"push"`: below `rest_angle` only, `"pull"`: above it only; default: on both sides"""

    @property
    def rest(self) -> float:
        """The coordinate without torque: `rest_angle`, rad."""
        return self.rest_angle

    @property
    def side(self) -> int:
        """The sign of the only stretch and tension that a one-sided spring has; 0 of one that acts on both sides."""
        return _side(self.acts)


def _side(acts: str | None) -> int:
    """Return -1 for a spring that pushes, 1 for one that pulls, 0 for one that does both."""
    return {"push": -1, "pull": 1}.get(acts or "", 0)


Spring = Annotated[LinearSpring | TorsionalSpring, Field(discriminator="type")]


class Force(Part):
    """The force `law(t) * direction/|direction|` at `point` of `body`."""

    type: Literal["force"] = "force"
    """A force with constant direction in ground axes"""
    body: Name
    """The body on which it acts; not the ground"""
    point: Vector = (0.0, 0.0)
    """Point of application, in the axes of the body; m"""
    direction: Direction
    """Direction in ground axes; any length except 0"""
    law: Law
    """The force as a function of time; N"""


class Torque(Part):
    """The torque `law(t)` on `body`."""

    type: Literal["torque"] = "torque"
    """A torque"""
    body: Name
    """The body on which it acts; not the ground"""
    law: Law
    """The torque as a function of time; N m"""


Load = Annotated[Force | Torque, Field(discriminator="type")]


class Baumgarte(Part):
    """Baumgarte's stabilization: `Phi'' + 2 alpha Phi' + beta^2 Phi = 0` instead of `Phi'' = 0`.

    This is eq. (25) of Zhuang & Wang (2014).
    """

    method: Literal["baumgarte"] = "baumgarte"
    """Baumgarte's stabilization"""
    alpha: NonNegative
    """Half the feedback gain of `Phi'`; 1/s"""
    beta: NonNegative
    """Square root of the feedback gain of `Phi`; 1/s"""


class Projection(Part):
    """After each step the state is projected onto the constraints, in the metric of the mass matrix."""

    method: Literal["projection"] = "projection"
    """Projection after each step"""


class NoStabilization(Part):
    """No stabilization: constraints are satisfied at acceleration level only."""

    method: Literal["none"] = "none"
    """No stabilization"""


Stabilization = Annotated[Baumgarte | Projection | NoStabilization, Field(discriminator="method")]


class Scene(Part):
    """A planar mechanism: its bodies, joints, drives, springs and loads.

    A scene has only the effects that it declares: without ``gravity`` there is no weight, and a guide without a
    coefficient of friction is frictionless. The keys are described in the scene format. Quantities are in SI units,
    angles in radians. A scene that cannot be used
    raises `SceneError`, whose message lists all problems.
    """

    title: str = ""
    """A one-line description of the mechanism"""
    source: str = ""
    """Where the numbers come from, such as a publication"""
    t_end: Positive = 10.0
    """Simulated time, s; > 0"""
    parameters: dict[Name, Number] = {}
    """Named numbers for use in arithmetic expressions; each may use the parameters above it"""
    gravity: Vector | None = None
    """Gravitational acceleration `[gx, gy]`, m/s²; without it, bodies have no weight"""
    bodies: dict[Name, Body] = Field(min_length=1)
    """The bodies by name; at least one"""
    joints: dict[Name, Joint] = {}
    """Revolute joints (pins) and translational joints (sliders on guides) by name"""
    drives: dict[Name, Drive] = {}
    """Motors by name: coordinates that follow a law of time"""
    springs: dict[Name, Spring] = {}
    """Springs and dampers by name"""
    forces: dict[Name, Load] = {}
    """Applied forces and torques by name"""
    stabilization: Stabilization = Projection()
    """How the reference implementation limits constraint drift"""
    # The tables as they were written, with arithmetic expressions.
    _raw: dict[str, Any] = PrivateAttr(default_factory=dict)
    # What error messages call the scene: the name or path from which it was loaded.
    _origin: str = PrivateAttr(default="<scene>")
    _name: str = PrivateAttr(default="<scene>")

    if not TYPE_CHECKING:  # as in `Part`

        def __init__(self, **tables: Any) -> None:
            from stiction.scenes.checking import checked, plain_tables

            def validate(values: dict[str, Any], parameters: dict[str, float]) -> Scene:
                return self.__pydantic_validator__.validate_python(
                    values, context=parameters, self_instance=self
                )

            origin = type(self).__name__
            plain = plain_tables(tables, origin)
            checked(plain, origin, validate)
            self._raw = plain

        __init__.__pydantic_base_init__ = True

    def __eq__(self, other: object) -> bool:
        """Compare the declared values of two scenes; names and files of the scenes do not matter."""
        return isinstance(other, Scene) and self.__dict__ == other.__dict__

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Yield what pydantic shows in ``repr``: the name, the numbers of elements, and the end time."""
        yield None, shortened(self.name)
        for section in ("bodies", "joints", "drives", "springs", "forces"):
            yield section, len(getattr(self, section))
        yield "t_end", self.t_end

    @property
    def name(self) -> str:
        """The name of the scene: the file name without its extension."""
        return self._name

    @property
    def pins(self) -> dict[str, Revolute]:
        """The revolute joints, by name."""
        return {name: joint for name, joint in self.joints.items() if isinstance(joint, Revolute)}

    @property
    def guides(self) -> dict[str, Translational]:
        """The translational joints, by name."""
        return {
            name: joint for name, joint in self.joints.items() if isinstance(joint, Translational)
        }

    @property
    def frictional_guides(self) -> dict[str, Translational]:
        """The translational joints that declare friction, by name."""
        return {name: guide for name, guide in self.guides.items() if guide.frictional}

    @property
    def frictional_joints(self) -> dict[str, Joint]:
        """The joints that declare dry friction, pins and guides, by name in the order of the scene."""
        return {name: joint for name, joint in self.joints.items() if joint.frictional}

    @property
    def prescribed_drives(self) -> dict[str, Drive]:
        """The drives without a limit, which are constraints, by name in the order of the scene."""
        return {name: drive for name, drive in self.drives.items() if not drive.is_limited}

    @property
    def limited_drives(self) -> dict[str, Drive]:
        """The drives with an `effort_limit`, by name in the order of the scene."""
        return {name: drive for name, drive in self.drives.items() if drive.is_limited}

    @property
    def bounded_elements(self) -> dict[str, Joint | Drive]:
        """The joints with dry friction and, behind them, the drives with a limit, by name.

        A limited drive is dry friction between its bodies whose slip is measured relative to the rate of its law.
        """
        return {**self.frictional_joints, **self.limited_drives}

    @property
    def springs_and_dampers(self) -> dict[str, Spring]:
        """The springs and dampers by name, and behind them the damping of joints as dampers, by the joints' names."""
        dampers = {name: joint.damper for name, joint in self.joints.items()}
        return self.springs | {name: damper for name, damper in dampers.items() if damper}

    @property
    def one_sided_springs(self) -> dict[str, Spring]:
        """The springs that act on one side only, by name in the order of the scene."""
        return {name: spring for name, spring in self.springs.items() if spring.acts is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of the scene, with its parameters and arithmetic expressions.

        `scene_from_dict` makes an equal scene from them.
        """
        return copy.deepcopy(self._raw)

    def to_toml(self) -> str:
        """Return the scene as the text of a TOML file, with its parameters and arithmetic expressions.

        `load_scene` makes an equal scene from this file.
        """
        import tomli_w

        return tomli_w.dumps(self._raw)

    def draw(self) -> Picture:
        """Draw the mechanism at t = 0.

        Returns
        -------
        Picture
            It is displayed by Jupyter; its method ``write("scene.svg")`` writes a file (.svg, .pdf or .png).
        """
        from stiction.scenes.pictures.mechanism import drawing

        return drawing(self)

    def _repr_html_(self) -> str:
        """Return the scene as Jupyter displays it."""
        from stiction.scenes.pictures.notebook import scene_html

        return scene_html(self)
