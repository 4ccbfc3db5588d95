"""A scene as items of an Exudyn system, and what the multipliers of its constraints mean.

Exudyn's own items wherever they are exact. Its coordinate between two bodies along an axis
(`MarkerBodiesRelativeTranslationCoordinate`) leaves out the lever across the axis: exact on a line that holds
the point (guides) and on the ground, not for an axis that turns with a body. Springs and drives along
such an axis, and drives of a distance, are user functions here.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, sin
from typing import Any

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Law, Linear, Sine, evaluate_law
from stiction.scenes.model import (
    Drive,
    Force,
    LinearSpring,
    Revolute,
    TorsionalSpring,
    Translational,
)


class Model:
    """An Exudyn system of a scene, to be assembled; states as in the scene: x, y, angle per body.

    Parameters
    ----------
    scene : Scene
    joints : bool
        Whether translational joints become prismatic joints; if not, the caller adds what guides the sliders.

    Attributes
    ----------
    system : exudyn.MainSystem
    constraints : dict of str to int
        By joint or drive: the number of its object.
    rows : dict of str to list of int
        By joint or drive: the indices of its multipliers among the algebraic coordinates. Set by `assemble`.
    """

    def __init__(self, scene: Scene, joints: bool = True):
        self.scene = scene
        self._open()
        self.index = {name: i for i, name in enumerate(scene.bodies)}
        self.nodes = {GROUND: self.system.AddNode(self.items.NodePointGround(name=GROUND))}
        self.bodies = {GROUND: self.system.AddObject(self.items.ObjectGround(name=GROUND))}
        self._add_bodies()
        self.constraints = {
            name: self._joint(name, joint)
            for name, joint in scene.joints.items()
            if joints or isinstance(joint, Revolute)
        }
        self.constraints |= {name: self._drive(name, drive) for name, drive in scene.drives.items()}
        for name, spring in scene.springs.items():
            self._spring(name, spring)
        for name, load in scene.forces.items():
            self._load(name, load)

    def assemble(self) -> None:
        """Complete the system; nothing can be added to it afterwards."""
        self.system.Assemble()
        self.rows = {name: self.multipliers(number) for name, number in self.constraints.items()}

    def _open(self) -> None:
        """Create an empty system, and the items to add to it."""
        import exudyn
        from exudyn import itemInterface

        self.items = itemInterface
        self._symbolic = exudyn.symbolic
        self._functions: list[Any] = []  # Exudyn does not keep symbolic functions alive itself
        self._container = exudyn.SystemContainer()
        self.system = self._container.AddSystem()

    def multipliers(self, item: int) -> list[int]:
        """Return the indices of an object's multipliers among the algebraic coordinates."""
        return list(self.system.systemData.GetObjectLTGAE(item))

    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates and velocities at t = 0, each of shape (3 * bodies,)."""
        bodies = self.scene.bodies.values()
        return (
            np.array([x for body in bodies for x in (*body.position, body.angle)]),
            np.array([x for body in bodies for x in (*body.velocity, body.angular_velocity)]),
        )

    def reactions(self, multipliers: np.ndarray) -> dict[str, np.ndarray]:
        """Return the columns of joints and drives from multipliers of shape (n, algebraic coordinates).

        Exudyn's residual is M a + C_q^T lambda - f, so that -C_q^T lambda is the force on the coordinates: a positive
        lambda acts against what raises C. `moment` is the moment of the joint itself, without the friction of the
        surfaces, which is a load in Exudyn.
        """
        columns = {}
        for name, rows in self.rows.items():
            values = multipliers[:, rows].T
            element = self.scene.joints.get(name)
            if isinstance(element, Revolute):  # C = p1 - p0
                columns[f"{name}.fx"], columns[f"{name}.fy"] = values
            elif isinstance(element, Translational):
                # C = [n . (p_guide - p_slider), n . direction in the slider]
                columns[f"{name}.normal_force"], columns[f"{name}.moment"] = values[0], -values[1]
            else:
                columns[f"{name}.effort"] = -values[0]
        return columns

    def rigid(self, body: str, point: tuple[float, float] = (0.0, 0.0)) -> int:
        """Return a marker at a point of a body."""
        return self.system.AddMarker(
            self.items.MarkerBodyRigid(bodyNumber=self.bodies[body], localPosition=[*point, 0.0])
        )

    def along(
        self,
        guide: str,
        point: tuple[float, float],
        axis: tuple[float, float],
        body: str,
        body_point: tuple[float, float],
    ) -> int:
        """Return a marker for the coordinate of `body_point` along `axis` of `guide`, from `point`."""
        return self.system.AddMarker(
            self.items.MarkerBodiesRelativeTranslationCoordinate(
                bodyNumbers=[self.bodies[guide], self.bodies[body]],
                localPosition0=[*point, 0.0],
                localPosition1=[*body_point, 0.0],
                axis0=[*unit(axis), 0.0],
            )
        )

    def zero(self) -> int:
        """Return a marker for a coordinate that stays zero."""
        return self._coordinate(GROUND, 0)

    def _coordinate(self, body: str, coordinate: int) -> int:
        return self.system.AddMarker(
            self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[body], coordinate=coordinate)
        )

    def _angles(self, bodies: tuple[str, str]) -> list[int]:
        """Return the markers of two angles in Exudyn's order: its connectors measure the second minus the first."""
        return [self._coordinate(name, 0 if name == GROUND else 2) for name in reversed(bodies)]

    def _add_bodies(self) -> None:
        for name, body in self.scene.bodies.items():
            self.nodes[name] = self.system.AddNode(
                self.items.NodeRigidBody2D(
                    name=name,
                    initialCoordinates=[*body.position, body.angle],
                    initialVelocities=[*body.velocity, body.angular_velocity],
                )
            )
            self.bodies[name] = self.system.AddObject(
                self.items.ObjectRigidBody2D(
                    name=name, mass=body.mass, inertia=body.inertia, nodeNumber=self.nodes[name]
                )
            )
            if self.scene.gravity is not None:
                marker = self.system.AddMarker(
                    self.items.MarkerBodyMass(bodyNumber=self.bodies[name])
                )
                self.system.AddLoad(
                    self.items.LoadMassProportional(
                        name=f"{name}-weight",
                        markerNumber=marker,
                        loadVector=[*self.scene.gravity, 0.0],
                    )
                )

    def _joint(self, name: str, joint: Revolute | Translational) -> int:
        if isinstance(joint, Revolute):
            markers = [self.rigid(body, point) for body, point in zip(joint.bodies, joint.points)]
            return self.system.AddObject(
                self.items.ObjectJointRevolute2D(name=name, markerNumbers=markers)
            )
        # Exudyn takes the direction in the axes of the slider (marker 0) and the normal in those of
        # the guide (marker 1). The slider is turned by `joint.angle` against the guide.
        ux, uy = unit(joint.direction)
        c, s = cos(joint.angle), sin(joint.angle)
        return self.system.AddObject(
            self.items.ObjectJointPrismatic2D(
                name=name,
                markerNumbers=[
                    self.rigid(joint.slider, joint.slider_point),
                    self.rigid(joint.guide, joint.point),
                ],
                axisMarker0=[c * ux + s * uy, c * uy - s * ux, 0.0],
                normalMarker1=[-uy, ux, 0.0],
            )
        )

    def _drive(self, name: str, drive: Drive) -> int:
        # Exudyn's own items for a difference of angles, a coordinate along an axis of the ground,
        # and a constant distance; a user function for the others (see the module).
        first, second = drive.bodies
        if drive.type == "angle":
            markers = self._angles(drive.bodies)
        elif drive.axis is not None and second == GROUND:
            markers = [
                self.zero(),
                self.along(second, drive.points[1], drive.axis, first, drive.points[0]),
            ]
        elif drive.axis is None and isinstance(drive.law, Constant):
            return self.system.AddObject(
                self.items.ObjectConnectorDistance(
                    name=name,
                    markerNumbers=[
                        self.rigid(body, point) for body, point in zip(drive.bodies, drive.points)
                    ],
                    distance=drive.law.value,
                )
            )
        else:
            return self._general_drive(name, drive)
        item = "ObjectConnectorCoordinate"
        return self.system.AddObject(
            self.items.ObjectConnectorCoordinate(
                name=name,
                markerNumbers=markers,
                offsetUserFunction=self._function(name, item, "offsetUserFunction", drive.law, 0),
                offsetUserFunction_t=self._function(
                    name, item, "offsetUserFunction_t", drive.law, 1
                ),
            )
        )

    def _general_drive(self, name: str, drive: Drive) -> int:
        """Add a drive of a distance, or of a coordinate along an axis of a moving body, as user functions."""
        measure = PointDistance(drive)

        def residual(
            system: Any, t: float, item: int, q: Any, rates: Any, velocity_level: bool
        ) -> list[float]:
            value, gradient = measure(q)
            law, law_rate, _ = evaluate_law(drive.law, t)
            return [float(gradient @ rates) - law_rate if velocity_level else value - law]

        def jacobian(
            system: Any, t: float, item: int, q: Any, rates: Any, velocity_level: bool
        ) -> np.ndarray:
            return measure(q)[1].reshape(1, -1)

        markers = [
            self.system.AddMarker(self.items.MarkerNodeCoordinates(nodeNumber=self.nodes[body]))
            for body in drive.bodies
        ]
        return self.system.AddObject(
            self.items.ObjectConnectorCoordinateVector(
                name=name,
                markerNumbers=markers,
                scalingMarker0=np.zeros((1, 0 if drive.bodies[0] == GROUND else 3)),
                scalingMarker1=np.zeros((1, 0 if drive.bodies[1] == GROUND else 3)),
                constraintUserFunction=residual,
                jacobianUserFunction=jacobian,
            )
        )

    def _spring(self, name: str, spring: LinearSpring | TorsionalSpring) -> None:
        add, items = self.system.AddObject, self.items
        coefficients = dict(name=name, stiffness=spring.stiffness, damping=spring.damping)
        if isinstance(spring, TorsionalSpring):
            add(
                items.ObjectConnectorCoordinateSpringDamper(
                    markerNumbers=self._angles(spring.bodies),
                    offset=spring.rest_angle,
                    **coefficients,
                )
            )
        elif spring.axis is not None and spring.bodies[1] == GROUND:
            marker = self.along(
                GROUND, spring.points[1], spring.axis, spring.bodies[0], spring.points[0]
            )
            add(
                items.ObjectConnectorCoordinateSpringDamper(
                    markerNumbers=[self.zero(), marker], offset=spring.rest_length, **coefficients
                )
            )
        elif spring.axis is not None:
            self._spring_along_moving_axis(name, spring)
        else:
            markers = [self.rigid(body, point) for body, point in zip(spring.bodies, spring.points)]
            if spring.rest_length > 0:
                add(
                    items.ObjectConnectorSpringDamper(
                        markerNumbers=markers, referenceLength=spring.rest_length, **coefficients
                    )
                )
            else:
                # Exudyn's spring divides by its length, which may be zero here; one for each
                # axis does not. It has no damping: that would need a direction, and is refused.
                add(
                    items.ObjectConnectorCartesianSpringDamper(
                        name=name, markerNumbers=markers, stiffness=[spring.stiffness] * 2 + [0.0]
                    )
                )

    def _spring_along_moving_axis(self, name: str, spring: LinearSpring) -> None:
        """Add a spring along an axis of a moving body, as a user function."""
        measure = PointDistance(spring)

        def force(system: Any, t: float, item: int, q: Any, rates: Any) -> np.ndarray:
            value, gradient = measure(q)
            return gradient * -(
                spring.stiffness * (value - spring.rest_length)
                + spring.damping * float(gradient @ rates)
            )

        nodes = [self.nodes[body] for body in spring.bodies if body != GROUND]
        self.system.AddObject(
            self.items.ObjectGenericODE2(name=name, nodeNumbers=nodes, forceUserFunction=force)
        )

    def _load(self, name: str, load: Any) -> None:
        if isinstance(load, Force):
            marker = self.rigid(load.body, load.point)
            vector = [*unit(load.direction), 0.0]
            item = "LoadForceVector"
        else:
            marker = self.rigid(load.body)
            vector = [0.0, 0.0, 1.0]
            item = "LoadTorqueVector"
        # A constant law goes into the vector; of another one the vector is the direction, which a
        # user function multiplies in each step.
        varying = {}
        if isinstance(load.law, Constant):
            vector = [load.law.value * component for component in vector]
        else:
            varying["loadVectorUserFunction"] = self._function(
                name, item, "loadVectorUserFunction", load.law, 0
            )
        self.system.AddLoad(
            getattr(self.items, item)(name=name, markerNumber=marker, loadVector=vector, **varying)
        )

    def _function(self, element: str, item: str, name: str, law: Law, derivative: int) -> Any:
        """Return the law (or its rate) as a user function, compiled by Exudyn, or in Python for tables."""
        from exudyn.utilities import CreateSymbolicUserFunction

        # Exudyn compiles what it can record by calling the function with symbols. A table has
        # branches, which symbols cannot take.
        symbolic = isinstance(law, (Constant, Linear, Sine))

        def value(t: Any) -> Any:
            return (
                self._expression(law, t, derivative)
                if symbolic
                else evaluate_law(law, t)[derivative]
            )

        def of_load(system: Any, t: Any, load: Any) -> list[Any]:
            return [value(t) * load[0], value(t) * load[1], value(t) * load[2]]

        def of_item(system: Any, t: Any, item: Any, offset: Any) -> Any:
            return value(t)

        function: Callable[..., Any] = of_load if name == "loadVectorUserFunction" else of_item
        if not symbolic:
            return function
        function = CreateSymbolicUserFunction(self.system, function, name, itemTypeName=item)
        self._functions.append(function)
        return function

    def _expression(self, law: Any, t: Any, derivative: int) -> Any:
        """Return the law (derivative 0) or its rate (1) in Exudyn's symbols."""
        symbols = self._symbolic
        if isinstance(law, Constant):
            return symbols.Real((law.value, 0.0)[derivative])
        if isinstance(law, Linear):
            return law.offset + law.rate * t if derivative == 0 else symbols.Real(law.rate)
        phase = law.frequency * t + law.phase
        if derivative == 0:
            return law.offset + law.amplitude * symbols.sin(phase)
        return law.amplitude * law.frequency * symbols.cos(phase)


class PointDistance:
    """Distance of two points of a drive or spring, along its axis if it has one, and its gradient.

    It is called with the coordinates of the bodies that are not the ground, `bodies[0]` first. It returns the value
    and d(value)/dq.
    """

    def __init__(self, element: Drive | LinearSpring):
        self.moving = [name != GROUND for name in element.bodies]
        self.points = element.points
        self.axis = None if element.axis is None else unit(element.axis)

    def __call__(self, q: Any) -> tuple[float, np.ndarray]:
        # Place and angle of both bodies; the ground is in none of Exudyn's coordinates.
        states = iter(np.reshape(q, (-1, 3)))
        (x0, y0, th0), (x1, y1, th1) = (
            next(states) if moving else (0.0, 0.0, 0.0) for moving in self.moving
        )
        # Levers of the two points, and the vector from the second point to the first
        rx0, ry0 = turned(self.points[0], th0)
        rx1, ry1 = turned(self.points[1], th1)
        dx, dy = x0 + rx0 - x1 - rx1, y0 + ry0 - y1 - ry1
        if self.axis is None:
            value = hypot(dx, dy)
            ux, uy = dx / value, dy / value
        else:
            ux, uy = turned(self.axis, th1)
            value = ux * dx + uy * dy
        # An axis turns with bodies[1], and the derivative of u . d by that angle has the term
        # (du/d angle) . d = ux dy - uy dx. For the distance of two points, u is parallel to d, and
        # the term is zero.
        rows = ((ux, uy, uy * rx0 - ux * ry0), (-ux, -uy, ux * ry1 - uy * rx1 + ux * dy - uy * dx))
        gradient = [
            derivative for row, moving in zip(rows, self.moving) if moving for derivative in row
        ]
        return value, np.array(gradient)


def unit(vector: tuple[float, float]) -> tuple[float, float]:
    """Return the vector divided by its length."""
    length = hypot(*vector)
    return vector[0] / length, vector[1] / length


def turned(vector: tuple[float, float], angle: float) -> tuple[float, float]:
    """Return the vector turned by an angle (rad), counter-clockwise."""
    c, s = cos(angle), sin(angle)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
