"""Drake's continuous plant at contact fidelity.

Corners on half-spaces, both coefficients of friction, integrated with error control by CENIC.

CENIC (Kurtz & Castro 2025, https://arxiv.org/abs/2511.08771) solves the convex contact problem of a discrete step for a
step and for its two halves, and keeps the result of the halves. It chooses steps so that the two results differ by less
than `rtol` in any coordinate (m, rad). The contacts are those of `stiction.engines.drake.contact`, with a stiffness
that does not depend on steps. Friction follows from the normal force and the slip speed at the start of a step; it is
static up to a few times `stiction_tolerance`, kinetic beyond. The adapter evaluates loads whenever Drake asks for them.
A motor is one of them, a torque proportional to the error of its rate, which CENIC solves for with the step. The plant
does not know the forces of CENIC, so that the acceleration of a sample is the mean one over a short time after it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.drake.contact import Boxes, Material
from stiction.engines.drake.plant import Plant, start_mass
from stiction.engines.protocol import BadTrajectory, Engine, EngineFailure, Refused
from stiction.engines.reference.engine import output_times
from stiction.engines.shared.contact_geometry import direction_of
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import columns_of_motion, settings_of
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.step_kernels import Balance, applied_loads
from stiction.reference_impl.compiled.kernel import link_kernels
from stiction.scenes import Cost, InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import Constant, Linear, evaluate_law

METHOD = "continuous"
"""The setting `method` of contact fidelity."""
FRICTION_LAW = "Coulomb at each contact, both coefficients, regularized (engine)"
DEFAULT_TOLERANCE = 1e-5
"""Tolerance (m, rad) where none is given."""
SETTINGS: Mapping[str, Any] = {
    "stiffness": 1e7,
    "dissipation": 100.0,
    "stiction_tolerance": 2e-5,
    "longest_step": 1e-3,
}
_STICKS = 10
"""Slip speed, in stiction tolerances, at which friction is half-way from static to kinetic; see `_coefficients`."""
_TRANSITION_SPEEDS = 1000
"""Slip speeds in the transition at which `_coefficients` searches the peak of friction, which is smooth there."""
_BY_STEP = 1.3e-3
"""Least stiction tolerance, as part of the speed that static friction takes from a slider in a step. CENIC regularizes
friction up to the stiction tolerance or 2.65e-3 of the speed that one contact takes, whichever is more; but the
transition to kinetic friction depends on the stiction tolerance alone. Two contacts take half of the speed each."""
_GAIN = 1e8
"""Gain of motors, in inertias of their joint per second."""
_TOUCHING = 16
"""Largest number of short attempts at a step in which boxes sink into their surfaces. A short attempt takes sqrt(m/k):
a free body then falls as far as it will sink, so that no corner leaves the surface that it will press on."""
_LANDING = 16
"""Largest number of long attempts at such a step. A long attempt takes `_LONG_ATTEMPT` times as long, and the part of a
load that the surfaces do not carry yet decreases to a hundredth or less."""
_LONG_ATTEMPT = 10
"""Ratio of the duration of long attempts at landing to that of short ones."""
_LANDED = 0.01
"""Part of the depth to which boxes have sunk by which the last attempt may still move them."""
_ROUNDING = 1e-12
"""Distance (m or rad) that a box which carries nothing may still move, in mechanisms within a metre of the origin."""
_LEAST_MASS = 1e-9
"""Least mass of a link, in masses of the lightest body: CENIC does not accept links without mass."""


def run_continuous(
    engine: Engine,
    assembly: Assembly,
    *,
    t_end: float,
    dt: float | None,
    rtol: float | None,
    fidelity: Fidelity,
    output_step: float,
    settings: Mapping[str, Any],
) -> Trajectory:
    """Integrate from t = 0 to t_end; arguments and further exceptions as of `Engine.run`.

    Raises
    ------
    BadTrajectory
        If the stiction tolerance is too small for the steps and the loads, so that static friction was lost.
    """
    if dt is not None or fidelity != Fidelity.CONTACT:
        raise InputError(
            f"method={METHOD}: found dt or joint fidelity; expected rtol and contact fidelity"
        )
    options = settings_of(
        {name: value for name, value in settings.items() if name != "method"},
        SETTINGS,
        engine.name,
        fidelity,
    )
    for name in ("stiffness", "stiction_tolerance", "longest_step"):
        if not options[name] > 0:
            raise InputError(f"{name}: found {options[name]!r}; expected a number > 0")
    scene = assembly.scene
    rtol = DEFAULT_TOLERANCE if rtol is None else rtol
    started = time.process_time()
    t = output_times(t_end, output_step)
    instant = 0.0
    samples = []
    # accelerations are mean ones over this time after a sample, and before the next sample
    over = min(options["longest_step"], np.diff(t).min() / 2)
    try:
        simulation = _Simulation(assembly, LinkTree(scene, fidelity), options, rtol)
        setup_s, started = time.process_time() - started, time.process_time()
        simulation.clock.start()
        for instant in t:
            q, v = simulation.at(instant)
            normals = simulation.normals()
            samples.append((q, v, (simulation.at(instant + over)[1] - v) / over, normals))
    except (RuntimeError, SystemExit) as error:
        # Drake's exceptions, and its assertions, which are a SystemExit in Python
        raise EngineFailure(
            f"{engine.name}: {str(error).partition('. ')[0]}, after t = {instant:g} s with rtol = "
            f"{rtol:g}"
        ) from error
    ended, engine_s = time.process_time(), simulation.clock.engine_s
    steps = simulation.simulator.get_integrator().get_num_steps_taken()
    q, v, a, forces = (np.array(part) for part in zip(*samples))
    bodies, tolerance = list(scene.bodies), options["stiction_tolerance"]
    modes, frictions = np.zeros(forces.shape, dtype=np.int8), np.zeros(forces.shape)
    for i, ((name, guide), normal) in enumerate(zip(scene.frictional_guides.items(), forces.T)):
        # With a smaller stiction tolerance the regularized friction would reach its static value
        # only at speeds at which the coefficient is kinetic already. See `_BY_STEP`.
        least = (
            _BY_STEP
            * guide.static_coefficient
            * normal.max()
            * options["longest_step"]
            / scene.bodies[guide.slider].mass
        )
        if guide.static_coefficient > guide.kinetic_coefficient and tolerance < least:
            raise BadTrajectory(
                f"{engine.name}: stiction_tolerance: found {tolerance:g}; expected at least "
                f"{least:.2g} m/s in joints.{name}, whose contacts are loaded with up to "
                f"{normal.max():.3g} N, with steps of up to {options['longest_step']:g} s: below, "
                "static friction is lost"
            )
        # Drake reports no friction here: of a guide that slips it is Coulomb's, of one that sticks
        # the balance of momentum gives it.
        slip = v[:, 3 * bodies.index(guide.slider) :][:, :2] @ direction_of(guide)
        modes[:, i] = np.where(np.abs(slip) < _STICKS * tolerance, 0, np.sign(slip))
        frictions[:, i] = np.where(
            modes[:, i], -modes[:, i] * guide.kinetic_coefficient * normal, np.nan
        )
    return Trajectory(
        scene=scene.name,
        engine=engine.name,
        version=engine.version,
        fidelity=fidelity,
        t=t,
        columns=columns_of_motion(assembly.whole, t, q, v, a, modes, frictions),
        settings={"rtol": rtol, "method": METHOD, **options, "friction_law": FRICTION_LAW},
        cost=Cost(setup_s, 0.0, ended - started, {"steps": steps}, engine_s),
    )


def _coefficients(mu: float, mus: float) -> tuple[float, float]:
    """Return the coefficients for CENIC with which the peak of its friction is mus and its limit at high speeds mu.

    At a slip speed of s stiction tolerances, CENIC's friction is (kinetic + (static - kinetic) g) s/sqrt(1 + s^2) of
    the normal force, with g = (1 - f(s - 10)/f(10))/2 and f(x) = x/sqrt(1 + x^2) (Drake's `patch_constraints_pool.cc`).
    The first factor falls where the second still rises, so that the given static coefficient is not reached. And g does
    not tend to 0, so that friction does not tend to the given kinetic one.
    """

    def f(x: Any) -> Any:
        return x / np.sqrt(1 + np.square(x))

    if mus == mu:
        return mus, mu
    s = np.linspace(1.0, _STICKS, _TRANSITION_SPEEDS)
    # g, shifted and scaled so that it falls from 1 to 0 at high speeds, where g itself is `g_end`
    g_end = (1 - 1 / f(_STICKS)) / 2
    g = ((1 - f(s - _STICKS) / f(_STICKS)) / 2 - g_end) / (1 - g_end)
    # The friction is at most mus if (mu + (static - mu) g) f <= mus at all speeds.
    static = float((mu + (mus / f(s) - mu) / g).min())
    return static, (mu - g_end * static) / (1 - g_end)


class _Simulation:
    """A scene in Drake's simulator."""

    def __init__(
        self, assembly: Assembly, tree: LinkTree, options: Mapping[str, Any], accuracy: float
    ):
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel
        from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
        from pydrake.systems.framework import DiagramBuilder

        scene = assembly.scene
        if tree.loops:
            raise Refused(
                f"joints.{tree.loops[0]}: closes a loop, of which Drake's continuous plant has none"
            )
        start = tree.coordinates(scene)
        refuse_off(assembly)
        self.clock = EngineClock()
        self._tree, self._still = tree, np.zeros(len(tree.links))
        self._links = links = Plant(
            scene, tree, 0.0, _LEAST_MASS * min(body.mass for body in scene.bodies.values())
        )
        builder = DiagramBuilder()
        links.plant.set_name("plant")  # by which CENIC finds it
        plant, graph = AddMultibodyPlantSceneGraph(builder, links.plant)
        plant.set_contact_model(ContactModel.kPoint)
        plant.set_stiction_tolerance(options["stiction_tolerance"])
        materials = [
            Material(
                options["stiffness"],
                *_coefficients(guide.kinetic_coefficient, guide.static_coefficient),
                options["dissipation"],
                relaxation_time=0.0,
            )
            for guide in scene.guides.values()
        ]
        self._boxes = boxes = Boxes(scene, tree, links.bodies, plant, graph, materials)
        plant.Finalize()
        if scene.springs or scene.forces or scene.drives:
            self._add_loads(assembly, builder)
        links.finalize(builder)
        self.simulator = simulator = Simulator(links.system, links.root)
        boxes.begin(links.root)
        self._land(
            boxes,
            *start,
            math.sqrt(min(body.mass for body in scene.bodies.values()) / options["stiffness"]),
        )
        ResetIntegratorFromFlags(simulator, "cenic", options["longest_step"]).set_target_accuracy(
            accuracy
        )
        simulator.Initialize()

    def _land(self, boxes: Boxes, start: np.ndarray, velocity: np.ndarray, period: float) -> None:
        """Place the boxes in their bodies so deep in the surfaces that these carry them at the start.

        After each trial step everything is reset except how deep the bodies are in the surfaces. At the end the bodies
        are moved back, and the boxes stay. `period` is the duration (s) of short trial steps.
        """
        from pydrake.systems.analysis import ResetIntegratorFromFlags

        simulator, position = self.simulator, start.copy()
        for step in (*[period] * _TOUCHING, *[_LONG_ATTEMPT * period] * _LANDING):
            # A new integrator for each attempt: an old one would reuse its solution for this time.
            ResetIntegratorFromFlags(simulator, "cenic", step).set_fixed_step_mode(True)
            self._begin(position, velocity)
            simulator.AdvanceTo(step)
            before = position.copy()
            boxes.sink(position, self._links.state()[0])
        # The last attempt has to have moved the boxes by little, compared with how far they sank.
        rounding = _ROUNDING * max(1.0, np.abs(start).max())
        last_move = float(np.abs(position - before).max())
        if last_move > _LANDED * np.abs(position - start).max() + rounding:
            raise EngineFailure(
                f"drake: boxes do not come to rest in their surfaces at the start: after "
                f"{_TOUCHING + _LANDING} attempts they still move by {last_move:.2g} m or rad in one"
            )
        boxes.move(start, position)
        self._begin(start, velocity)

    def _begin(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Begin at t = 0 with these coordinates and rates of the links."""
        self._links.put(position, velocity)
        self._links.root.SetTime(0.0)
        self.simulator.Initialize()

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Advance to an instant, not before the last one; return coordinates and velocities of the bodies."""
        if t > 0:  # a step of length zero violates an assertion of Drake's
            self.clock.call(self.simulator.AdvanceTo, t)
        return self._tree.motion(*self._links.state(), self._still)[:2]

    def normals(self) -> list[float]:
        """Return the sum of the contacts' normal forces (N) of each frictional guide now.

        They follow from the state, so that those of the plant are those of CENIC.
        """
        return self._boxes.forces(
            self._links.plant.get_contact_results_output_port().Eval(self._links.context)
        )[0]

    def _add_loads(self, assembly: Assembly, builder: Any) -> None:
        """Add loads and motors to the diagram, as a system whose input is the state and whose output are forces."""
        from pydrake.common.value import Value
        from pydrake.systems.framework import LeafSystem

        links, tree = self._links, self._tree
        motors = self._motors(assembly.scene)
        balance = Balance.of(assembly.whole)
        link_kernels(applied_loads)

        def evaluate(context: Any, output: Any) -> None:
            position, velocity = links.ordered(system.get_input_port().Eval(context))
            applied_loads(
                balance, context.get_time(), *tree.motion(position, velocity, self._still)[:2], 0.0
            )
            loads = balance.loads.tolist()
            for link, rate, gain, sides in motors:
                for side, sign in sides:
                    loads[side] += sign * gain * (rate - velocity[link])
            links.set_loads(loads)
            output.set_value(links.loads)

        system = builder.AddSystem(LeafSystem())
        system.DeclareVectorInputPort("state", 2 * len(tree.links))
        system.DeclareAbstractOutputPort(
            "loads",
            lambda: Value(links.loads),
            lambda *arguments: self.clock.call_back(evaluate, *arguments),
        )
        builder.Connect(links.plant.get_state_output_port(), system.get_input_port())
        builder.Connect(
            system.get_output_port(), links.plant.get_applied_spatial_force_input_port()
        )

    def _motors(self, scene: Scene) -> list[tuple[int, float, float, list[tuple[int, int]]]]:
        """Return each drive's link, rate (rad/s), gain (N m s), and its torque's places among the loads with signs."""
        mass = start_mass(scene, self._tree)
        names = list(scene.bodies)
        motors = []
        for name, drive in scene.drives.items():
            if not isinstance(drive.law, (Constant, Linear)):
                raise Refused(
                    f"drives.{name}: follows a law of its own; motors of Drake's continuous plant have a "
                    "constant rate here"
                )
            place, sign = motor_link(scene, self._tree, drive)
            # The torque acts on the link's body and, reversed, on the parent's, if it is not the ground.
            link = self._tree.links[place]
            parent = self._tree.links[link.parent].body if link.parent >= 0 else None
            sides = [
                (3 * names.index(body) + 2, way)
                for body, way in ((link.body, 1), (parent, -1))
                if body is not None
            ]
            rate = sign * evaluate_law(drive.law, 0.0)[1]
            motors.append((place, rate, _GAIN * float(mass[place, place]), sides))
        return motors
