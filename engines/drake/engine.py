"""Drake: a multibody plant in joint coordinates.

Discrete steps by its convex solver SAP ("lagged"), semi-implicit Euler.

Joint fidelity. The bodies are those of `stiction.engines.shared.link_tree.LinkTree`, in prismatic and revolute joints;
joints that close loops are ball constraints. Drake has no Coulomb friction of joints. Its actuators have a servo, which
is solved for implicitly with the step, and an effort limit. Friction is a servo of rate zero whose limit is the bound,
in guides and in pins; a constant bound is the adapter's law, too. A drive is a servo without a limit. Drake limits a
servo's gain, so that a sticking slider creeps with 1/3948 of the speed that its load would give it in a step.

Contact fidelity. The corners of a slider touch half-spaces (`stiction.engines.drake.contact`). The continuous plant:
`stiction.engines.drake.continuous`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.drake.contact import Boxes, Material, corner_inertias
from stiction.engines.drake.continuous import METHOD, run_continuous
from stiction.engines.drake.plant import Plant, start_mass
from stiction.engines.protocol import Supplier, check_version, installed_version
from stiction.engines.shared.acceleration_integrator import Dynamics
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import Defaults
from stiction.engines.shared.joint_coordinates import ContactStepper, TreeStepper, motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import GROUND

_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {"passes": 2},
    Fidelity.CONTACT: {
        "approximation": ("lagged", "similar", "sap"),
        "near_rigid": 2.0,
        "dissipation": 0.0,
        "stiction_tolerance": 1e-7,
    },
}
_GAIN = 1e6
"""Gain of servos in inertias of the joint per step, larger than what Drake uses: at most (2 pi/0.1)^2 = 3948 (the
near-rigid regime of its servos' constraint)."""
_LEAST = 1e-12
"""Least effort limit (N, N m): Drake does not accept zero."""
_SLIPS = 0.999
"""Part of the bound above which friction slips. At the speed v, Drake's friction is v/sqrt(v^2 + e^2) of the bound.
Here e is the stiction tolerance, or a thousandth of the speed that the bound takes from the slider in a step, whichever
is more (`SapHuntCrossleyConstraint`). A slider that counts as sticking creeps with up to 22 e."""
_MOST_GUIDES = 7
"""Largest number of guides at contact fidelity: with a 15th half-space on the ground Drake 1.51 ends the process, in
its tree of bounding boxes."""
_LANDING = 16
"""Attempts at the first step in which boxes sink into their surfaces. At the default stiffness, the part of a load that
the surfaces do not carry yet decreases to a tenth in each."""


class DrakeEngine(TreeEngine):
    """Adapter of Drake; the module describes how each element of a scene is modelled.

    Setting at joint fidelity: `passes`, repetitions of a step in which sticking is undecided.

    Settings at contact fidelity: `approximation`, one of Drake's convex approximations of contact: lagged, similar or
    sap (in the last two, friction lifts the sliding body from its surface); `near_rigid`: the stiffness of a contact
    is (2 pi/near_rigid)^2 times its effective mass divided by the square of the step; `dissipation` of Hunt and
    Crossley (s/m); `stiction_tolerance` of regularized friction (m/s).

    ``method="continuous"`` selects Drake's integrator CENIC with the tolerance `rtol`
    (`stiction.engines.drake.continuous`). It requires contact fidelity, no loops, and motors of constant rate. Its
    settings are `stiffness` of contacts (N/m), `dissipation`, `stiction_tolerance` and `longest_step` (s).
    """

    name, called, defaults = "drake", "Drake", _SETTINGS
    capabilities = replace(
        TreeEngine.capabilities, constant_bound_by={Fidelity.JOINT: Supplier.ADAPTER}
    )

    @property
    def version(self) -> str:
        import_module("pydrake.multibody.plant")  # ImportError where it cannot be imported
        return check_version("drake", installed_version("drake"))

    def friction_supplier(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> Supplier:
        if fidelity == Fidelity.CONTACT and settings.get("method") == METHOD:
            return Supplier.ENGINE
        return super().friction_supplier(fidelity, settings)

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if reason := super().refusal(scene, fidelity):
            return reason
        if fidelity == Fidelity.CONTACT and len(scene.guides) > _MOST_GUIDES:
            return f"{len(scene.guides)} guides; with the surfaces of more than {_MOST_GUIDES} Drake ends the process"
        return None

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        # Drake 1.51 ends the process in the first step of a ball constraint one of whose bodies is
        # the world
        for name in tree.loops:
            if GROUND in scene.joints[name].bodies:
                return (
                    f"joints.{name}: closes a loop with the ground; Drake ends the process "
                    "with such a constraint"
                )
        return None

    def run(self, scene: Scene, *, assembly: Assembly | None = None, **asked: Any) -> Trajectory:
        if asked["settings"].get("method") == METHOD:
            return run_continuous(self, assembly_of(scene, assembly), **asked)
        return super().run(scene, assembly=assembly, **asked)

    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> AbstractContextManager[TreeStepper]:
        return nullcontext(
            (_JointStepper if fidelity == Fidelity.JOINT else _ContactStepper)(assembly, h, options)
        )

    @contextmanager
    def dynamics(self, scene: Scene, tree: LinkTree, clock: EngineClock) -> Iterator[Dynamics]:
        links = Plant(scene, tree, 0.0)
        links.finalize()

        def evaluate(
            position: np.ndarray, velocity: np.ndarray, second: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            links.put(position, velocity)
            mass, bias = clock.call(links.dynamics)
            return mass, mass @ second + bias

        yield evaluate


class _DrakeStepper(TreeStepper):
    """A scene as discrete plant with drives and loads; subclasses add friction and the `_output` that they read."""

    _output: Any

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        from pydrake.multibody.tree import PdControllerGains, default_model_instance

        super().__init__(assembly, h, options)
        scene = assembly.scene
        tree, self._options = self.tree, options
        self._links = Plant(scene, tree, h)
        self._plant = plant = self._links.plant
        plant.SetUseSampledOutputPorts(False)  # outputs are those of the present state
        for name in tree.loops:
            pin = scene.pins[name]
            (first, p), (second, q) = (
                self._side(body, point) for body, point in zip(pin.bodies, pin.points)
            )
            plant.AddBallConstraint(first, p, second, q)
        # A servo for each guide with friction, then one for each drive, so that the first efforts
        # are the frictions.
        self._mass = start_mass(scene, tree)
        driven = [motor_link(scene, tree, drive)[0] for drive in scene.drives.values()]
        self._servos = {link: place for place, link in enumerate([*self.friction_links, *driven])}
        self._brakes = []
        for link, place in self._servos.items():
            servo = plant.AddJointActuator(f"servo-{link}", self._links.joints[link])
            servo.set_controller_gains(
                PdControllerGains(p=0.0, d=_GAIN * float(self._mass[link, link]) / h)
            )
            if place < len(self.friction_links):
                self._brakes.append(servo)
        self._links.finalize(self._surround(scene))
        self._context = self._links.context
        # Input ports with fixed values, which are changed in place: the desired positions and rates
        # of the servos (positions have no gain), and the loads.
        self._desired = np.zeros((2, len(self._servos)))
        plant.get_actuation_input_port().FixValue(self._context, self._desired[0])
        self._desired_state = plant.get_desired_state_input_port(default_model_instance()).FixValue(
            self._context, self._desired.reshape(-1)
        )
        self._pushed = plant.get_applied_spatial_force_input_port().FixValue(
            self._context, self._links.loads if self.loaded else []
        )
        self.put(self.position, self.velocity)
        # In the first step servos settle at the speed error that their load leaves.
        self.settling = self.settling or 1

    @abstractmethod
    def _surround(self, scene: Scene) -> Any:
        """Add to the plant before it is finalized; returns the builder of its diagram, or None for a plant alone."""

    def _side(self, body: str, point: tuple[float, float]) -> tuple[Any, np.ndarray]:
        """Return Drake's body, and a point of it in Drake's frame of the body."""
        place, link = np.array((*point, 0.0)), self.tree.link_of[body]
        if link < 0:
            return self._plant.world_body(), place
        return self._links.bodies[link], self.tree.centre(link) + place

    def drive_rate(self, link: int, rate: float) -> None:
        self._desired[1, self._servos[link]] = rate
        values = self._desired_state.GetMutableData().get_mutable_value()
        values.SetFromVector(self._desired.reshape(-1))

    def advance(self, caps: Sequence[float]) -> None:
        if self.loaded:
            self._links.set_loads(self.loads.tolist())
            self._pushed.GetMutableData().set_value(self._links.loads)
        self._values = self.clock.call(self._step)
        self.position[:], self.velocity[:] = self._links.state()

    def _step(self) -> Any:
        """Make the engine's step; return the plant's output in it."""
        try:
            after = self._plant.EvalUniquePeriodicDiscreteUpdate(self._context)
        except RuntimeError as error:
            # Drake's exception for a state that is not finite any more
            raise FloatingPointError(str(error).partition(". ")[0]) from error
        # Outputs belong to the state before the step and are evaluated before that is replaced.
        # Drake keeps the solution of the step for both.
        values = self._output.Eval(self._context)
        self._context.SetDiscreteState(after)
        return values

    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._links.put(position, velocity)


class _JointStepper(_DrakeStepper):
    """Guides as prismatic joints, pins as revolute ones, friction as their limited servos."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        super().__init__(assembly, h, options)
        self._output = self._plant.get_net_actuation_output_port()

    def _surround(self, scene: Scene) -> None:
        from pydrake.multibody.plant import DiscreteContactApproximation

        self._plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)

    def advance(self, caps: Sequence[float]) -> None:
        for brake, cap in zip(self._brakes, caps):
            brake.set_effort_limit(max(cap, _LEAST))
        super().advance(caps)
        self.held[:] = np.abs(self._values[: len(self._brakes)])


class _ContactStepper(ContactStepper, _DrakeStepper):
    """Sliders as boxes whose corners touch the guide's surfaces."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        for name in ("near_rigid", "stiction_tolerance"):
            if not options[name] > 0:
                raise InputError(f"{name}: found {options[name]!r}; expected a number > 0")
        super().__init__(assembly, h, options)
        scene = assembly.scene
        self._output = self._plant.get_contact_results_output_port()
        self._normals = [0.0] * len(scene.frictional_guides)

    def _surround(self, scene: Scene) -> Any:
        from pydrake.multibody.plant import (
            AddMultibodyPlantSceneGraph,
            ContactModel,
            DiscreteContactApproximation,
        )
        from pydrake.systems.framework import DiagramBuilder

        options, builder = self._options, DiagramBuilder()
        plant, graph = AddMultibodyPlantSceneGraph(builder, self._plant)
        plant.set_contact_model(ContactModel.kPoint)
        plant.set_stiction_tolerance(options["stiction_tolerance"])
        approximation = DiscreteContactApproximation.__members__[
            f"k{options['approximation'].capitalize()}"
        ]
        plant.set_discrete_contact_approximation(approximation)
        # The stiffness of a contact such that its corner vibrates with a period of `near_rigid`
        # steps: any stiffer one would not be resolved by them.
        rate = 2 * math.pi / (options["near_rigid"] * self.h)
        driven = [motor_link(scene, self.tree, drive)[0] for drive in scene.drives.values()]
        materials = [
            Material(rate**2 * inertia, 0.0, 0.0, options["dissipation"], relaxation_time=self.h)
            for inertia in corner_inertias(scene, self.tree, self.position, self._mass, driven)
        ]
        self._boxes = Boxes(scene, self.tree, self._links.bodies, plant, graph, materials)
        return builder

    def compile(self) -> None:
        super().compile()
        self._boxes.begin(self._links.root)
        # Loops would pull the boxes about while they land. With loops, they sink in during the first
        # steps of the run.
        if not self.tree.loops:
            self._land()

    def _land(self) -> None:
        """Place the boxes in their bodies so deep in the surfaces that these carry them at the start.

        After each trial step everything is reset except how deep the bodies are in the surfaces. At the end the bodies
        are moved back, and the boxes stay. Frictions of these steps are discarded: a slider that its surfaces do not
        carry yet slips, and would begin with the kinetic coefficient.
        """
        start, position, velocity = self.position.copy(), self.position.copy(), self.velocity.copy()
        for _ in range(_LANDING):
            self.step()
            self._boxes.sink(position, self.position)
            self._begin_again(position, velocity)
        self._boxes.move(start, position)
        self._begin_again(start, velocity)

    def _begin_again(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Begin the first step at this state, with stick undecided in all guides that do not slip."""
        self.k = 0
        self.position[:], self.velocity[:] = position, velocity
        self.put(position, velocity)
        guides = self.friction.guides
        guides["slip_speed"] = self.slip_speeds()
        guides["stuck"] = guides["change"] = 0
        self.friction.begin()
        self.begin()

    def rub(self, coefficients: Sequence[float]) -> None:
        self._boxes.rub(coefficients)

    def contact_forces(self) -> tuple[list[float], list[float]]:
        # Drake's friction ("lagged") is bounded by the normal force of the step before, and reaches
        # its bound only asymptotically. A friction close to it counts as at it, which is slip.
        before = self._normals
        self._normals, frictions = self._boxes.forces(self._values)
        bounds = [
            coefficient * normal
            for coefficient, normal in zip(self.friction.coefficients(), before)
        ]
        return before, [
            max(friction, bound) if friction > _SLIPS * bound else friction
            for friction, bound in zip(frictions, bounds)
        ]
