"""Exudyn: implicit second-order methods on redundant coordinates with multipliers.

Joint fidelity: prismatic and revolute joints, drives as constraints of time, Coulomb friction located by the
adapter (`stepping`). Contact fidelity: Exudyn's penalty contacts (`contact`).
"""

from __future__ import annotations

import contextlib
import io
import re
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.exudyn.bristles import (
    CONSTANT_FRICTION_LAW,
    FRICTION_LAW,
    Bristles,
    bristles_of,
)
from stiction.engines.exudyn.contact import ContactGuide
from stiction.engines.exudyn.friction import FrictionalGuide, FrictionalPin, LocatedFriction
from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.script import exudyn_script
from stiction.engines.exudyn.solver import INTEGRATORS
from stiction.engines.exudyn.stepping import (
    DISCONTINUOUS_TOLERANCE,
    FRICTION_REPETITIONS,
    Sample,
    Stepper,
)
from stiction.engines.joint_effects import (
    COMMON_EFFECTS,
    LAWS,
    JointEffect,
    has_constant_bounds,
)
from stiction.engines.protocol import (
    UNSETTLED,
    Capabilities,
    Engine,
    EngineFailure,
    Refused,
    Supplier,
    Unsettled,
    check_version,
)
from stiction.engines.shared.contact_geometry import contact_refusal, static_coefficient_refusal
from stiction.engines.shared.fixed_step import DEFAULT_SHARE, Defaults, settings_of, step_of
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import Breakdown, Cost, Event, InputError, Scene, Trajectory
from stiction.scenes.event_values import rows_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import LinearSpring, Revolute

_DEFAULT_STEP = 2e-3
"""Step in seconds where none is given; twice that of the engines of first order, as Exudyn's methods are of second."""
LOCATED = "located"
"""Setting `method` at joint fidelity: the adapter's friction, whose switches are located."""
BRISTLES = "bristles"
"""Setting `method` at joint fidelity: Exudyn's own friction model."""
_EXPLICIT = {"rk44": "RK44", "dopri5": "DOPRI5", "velocity-verlet": "VelocityVerlet"}
"""Some of Exudyn's explicit methods, by their names there."""
_JOINT: Defaults = {
    "integrator": (*INTEGRATORS, *_EXPLICIT),
    "method": (LOCATED, BRISTLES),
    "spectral_radius": 0.3,
    "newton_tolerance": 1e-9,
}
"""Settings at joint fidelity with the adapter's friction."""
_JOINT_WITH_BRISTLES: Defaults = {
    **_JOINT,
    "bristle_stiffness": 1e5,
    "bristle_damping": 1e3,
    "static_decay": 1.0,
}
"""Settings at joint fidelity with Exudyn's own friction model."""
_CONTACT: Defaults = {
    "integrator": _JOINT["integrator"],
    "spectral_radius": 0.3,
    "newton_tolerance": 1e-8,
    "contact_stiffness": 1e7,
    "contact_damping": 5e4,
    "friction_zone": 1e-4,
}
"""Settings at contact fidelity."""
MOST_UNKNOWNS = 5000
"""Largest number of rows of the dense matrix that is searched for redundant constraints, which then takes 200 MB.
Exudyn's own sparse solvers would take many more."""
_SHORTEST = 1e-8
"""Shortest step (s) at contact fidelity. Contacts that close, open or reverse ask Exudyn to divide a step; below this
it gives up."""
_RECOVERY_STEPS = 2
"""Steps at contact fidelity after which Exudyn lengthens a divided step again: few, as contacts change at instants."""
_LONGEST_MESSAGE = 1000
"""Characters of a message from Exudyn; a matrix that it prints may be much longer."""


class ExudynEngine(Engine):
    """Adapter of Exudyn.

    Settings at both fidelities: `integrator`, generalized-alpha (index 3), newmark (index 3) or trapezoidal (index
    2); `spectral_radius` of generalized alpha, from 0 (strongest damping of high frequencies) to 1 (none);
    `newton_tolerance`, relative to the first residual, and absolute. Exudyn refuses constrained systems with its
    explicit integrators (rk44, dopri5, velocity-verlet).

    Further settings at contact fidelity: `contact_stiffness` (N/m) and `contact_damping` (N s/m) of each corner;
    `friction_zone` (m/s), the slip speed below which friction is proportional to the speed, so that a sticking slider
    creeps. Exudyn subdivides steps in which a contact changes.

    ``method="bristles"``, at joint fidelity, uses Exudyn's own friction model (`bristles`). It has the further settings
    `bristle_stiffness` (N/m, of a pin N m/rad), `bristle_damping` (N s/m, N m s/rad) and `static_decay`. The excess of
    static over kinetic friction decreases exponentially with the slip speed, to 37 % at `static_decay` times the change
    of speed that the excess causes in one step.
    """

    name = "exudyn"
    capabilities = Capabilities(
        fidelities=tuple(Fidelity),
        static_coefficient={Fidelity.JOINT: True, Fidelity.CONTACT: False},
        friction_law={
            Fidelity.JOINT: "Coulomb with located switches, bound mu (|n1| + |n2|) from the joint's multipliers "
            "(adapter, as Exudyn's loads); stick: Exudyn's constraint",
            Fidelity.CONTACT: "Coulomb regularized below friction_zone, penalty contacts (engine)",
        },
        reactions="engine",
        order="2",
        event_location=Supplier.ADAPTER,
        friction_by={Fidelity.JOINT: Supplier.ADAPTER, Fidelity.CONTACT: Supplier.ENGINE},
        joint_effects={
            Fidelity.JOINT: COMMON_EFFECTS,
            Fidelity.CONTACT: LAWS | {JointEffect.CLEARANCE},
        },
    )

    @property
    def version(self) -> str:
        import exudyn

        return check_version("exudyn", exudyn.config.Version())

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return settings_of({}, _defaults(fidelity), self.name, fidelity)

    def check_arguments(self, *, settings: Mapping[str, Any], **asked: Any) -> None:
        # Each method has settings of its own, which `settings_of_run` checks.
        super().check_arguments(settings={} if "method" in settings else settings, **asked)

    def settings_of_run(
        self, given: Mapping[str, Any], *, fidelity: Fidelity, **_: Any
    ) -> dict[str, Any]:
        defaults = _defaults(fidelity, given.get("method"))
        return settings_of(given, defaults, self.name, fidelity)

    def friction_supplier(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> Supplier:
        if fidelity == Fidelity.JOINT and settings.get("method") == BRISTLES:
            return Supplier.BOTH  # the law is Exudyn's; the adapter sets its bound before each step
        return super().friction_supplier(fidelity, settings)

    def constant_bound_supplier(
        self, scene: Scene, fidelity: Fidelity, settings: Mapping[str, Any]
    ) -> Supplier | None:
        # Bristles have a static excess of their own, so that nothing is left to the adapter.
        if settings.get("method") == BRISTLES and has_constant_bounds(scene):
            return Supplier.ENGINE
        return super().constant_bound_supplier(scene, fidelity, settings)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == LOCATED

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == LOCATED

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        reason = _damper_refusal(scene)
        if reason is None:
            reason = _size_refusal(scene)
        if reason is None and fidelity == Fidelity.CONTACT:
            reason = contact_refusal(scene)
            if reason is None:
                reason = static_coefficient_refusal(scene, "Exudyn's contacts have")
        return reason

    def run(
        self,
        scene: Scene,
        *,
        t_end: float,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        output_step: float,
        settings: Mapping[str, Any],
        assembly: Assembly | None = None,
    ) -> Trajectory:
        h = step_of(_step(t_end) if dt is None else dt, t_end)
        options = self.settings_of_run(settings, fidelity=fidelity)
        if options["spectral_radius"] > 1:
            raise InputError(
                f"spectral_radius: found {options['spectral_radius']!r}; expected 0 .. 1"
            )
        setup_begin = time.process_time()
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
        with _captured_messages():
            simulation = _Simulation(assembly, h, options, options.get("method"))
            stepper = simulation.stepper
            stepping_begin = time.process_time()
            stepper.solver.clock.start()
            breakdown = _run_to_end(stepper, t_end, every=max(1, round(output_step / h)))
        stepping_end = time.process_time()
        cost = Cost(
            stepping_begin - setup_begin,
            0.0,
            stepping_end - stepping_begin,
            stepper.counters,
            stepper.solver.clock.engine_s,
        )
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=np.array([sample.t for sample in stepper.samples]),
            columns=simulation.columns(stepper.samples),
            events=simulation.events(),
            settings=self._reported_settings(scene, fidelity, h, options, stepper),
            cost=cost,
            termination="end" if breakdown is None else breakdown.reason,
            breakdown=breakdown,
        )

    def _reported_settings(
        self,
        scene: Scene,
        fidelity: Fidelity,
        h: float,
        options: Mapping[str, Any],
        stepper: Stepper,
    ) -> dict[str, Any]:
        """Return the step, the settings, and what the adapter chose for the scene."""
        # Only the dense solver of Eigen tolerates the singular matrices of redundant constraints.
        linear_solver = "EXUdense"
        if stepper.solver.redundant:
            linear_solver = "EigenDense, singular matrices tolerated"
        reported = {"dt": h, **options, "linear_solver": linear_solver}
        if not scene.frictional_joints:
            return reported
        if options.get("method") != BRISTLES:
            reported["friction_law"] = self.capabilities.friction_law[fidelity]
        elif has_constant_bounds(scene):
            reported["friction_law"] = CONSTANT_FRICTION_LAW
        else:
            reported["friction_law"] = FRICTION_LAW
        return reported


def _defaults(fidelity: Fidelity, method: str | None = None) -> Defaults:
    """Return the settings that a fidelity has with a method of friction."""
    if fidelity == Fidelity.CONTACT:
        return _CONTACT
    return _JOINT_WITH_BRISTLES if method == BRISTLES else _JOINT


def _damper_refusal(scene: Scene) -> str | None:
    """Return why a damper between two points cannot be modelled, or None."""
    # At zero length the direction of a damper's force is the limit of the motion, and Exudyn divides
    # by that length.
    for name, spring in scene.springs.items():
        if not isinstance(spring, LinearSpring) or spring.axis is not None:
            continue
        if spring.rest_length == 0 and spring.damping > 0:
            return (
                f"springs.{name}: Exudyn has no direction for a damper between points that may coincide; "
                "give an axis"
            )
    return None


def _size_refusal(scene: Scene) -> str | None:
    """Return why a scene is too large, or None."""
    unknowns = 3 * len(scene.bodies) + 2 * len(scene.joints) + len(scene.drives)
    if unknowns > MOST_UNKNOWNS:
        return (
            f"{unknowns} coordinates and multipliers; expected at most {MOST_UNKNOWNS}: the adapter looks for "
            "redundant constraints in a dense matrix"
        )
    return None


def _run_to_end(stepper: Stepper, t_end: float, every: int) -> Breakdown | None:
    """Run to `t_end`; return the breakdown that ended the motion before, if any.

    Friction that does not settle is no failure of the run, which has the samples before that.
    """
    try:
        stepper.run(t_end, every)
    except Unsettled as error:
        return Breakdown(UNSETTLED, error.time, str(error))
    return None


def scene_as_script(scene: Scene, named: str = "SCENE") -> str:
    """Return the model as a script for Exudyn, with the adapter's default step and settings; see `exudyn_script`.

    Its comments call the scene `named` in a command line.

    Raises
    ------
    Refused
        If Exudyn cannot express the scene.
    """
    reason = ExudynEngine().reason_to_refuse(scene, Fidelity.JOINT)
    if reason is not None:
        raise Refused(reason)
    options = settings_of({}, _JOINT_WITH_BRISTLES, ExudynEngine.name, Fidelity.JOINT)
    return exudyn_script(scene, _step(scene.t_end), scene.t_end, options, named)


def _step(t_end: float) -> float:
    """Return the step (s) where none is given."""
    return min(_DEFAULT_STEP, DEFAULT_SHARE * t_end)


class _Simulation:
    """A scene in Exudyn, ready to step; columns from samples.

    `method` is `LOCATED`, `BRISTLES`, or None at contact fidelity.
    """

    def __init__(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], method: str | None
    ):
        self.scene = assembly.scene
        self._mechanism = assembly.whole
        self.model = Model(self.scene, joints=method is not None)
        self._zone = options.get("friction_zone", 0.0)
        # One of three models of the guides; the other two lists remain empty.
        located: list[LocatedFriction] = []
        bristles: list[Bristles] = []
        boxes: list[ContactGuide] = []
        if method is None:
            boxes = _contact_guides(self.model, options)
        elif method == BRISTLES:
            bristles = bristles_of(self.model, options, h, self._mechanism)
        else:
            located = _located_friction(self.model)
        self.model.assemble()
        settings = _solver_settings(self.model, h, options)
        if method is None:
            _divide_steps_at_contacts(settings)
        # Where the solution of a step is repeated for the friction, a Jacobian of this step pays;
        # otherwise one of a step before costs less.
        settings.timeIntegration.newton.modifiedNewtonJacUpdatePerStep = bool(located)
        self._rubbing: list[Any] = [*located, *bristles, *boxes]
        self.stepper = Stepper(
            self.model,
            located,
            h,
            settings,
            bristles,
            self._mechanism,
            lambda: [joint.record() for joint in self._rubbing],
        )

    def events(self) -> tuple[Event, ...]:
        """Return the located switches of the run, with all columns on both sides of each."""
        switches = self.stepper.switches
        if not switches:
            return ()
        # Columns are computed for arrays of samples: here for both sides of all switches at once.
        sides = []
        for switch in switches:
            sides += [switch.before, switch.after]
        rows = rows_of(self.columns(sides))
        return tuple(
            Event(switch.before.t, switch.kind, switch.guide, before, after)
            for switch, before, after in zip(switches, rows[::2], rows[1::2], strict=True)
        )

    def columns(self, samples: list[Sample]) -> dict[str, np.ndarray]:
        """Return all columns of a trajectory; reactions are Exudyn's multipliers and forces.

        At contact fidelity a slider counts as sticking while its speed is in the zone in which friction is proportional
        to it.
        """
        t, q, v, a, multipliers = (
            np.array([getattr(sample, name) for sample in samples])
            for name in ("t", "q", "v", "a", "multipliers")
        )
        reactions = self.model.reactions(multipliers)
        for i, joint in enumerate(self._rubbing):
            reactions |= joint.columns(
                np.array([sample.guides[i] for sample in samples]), q, reactions
            )
        columns = {
            **recover_columns(self.scene, t, q, v, a, reactions, self._mechanism),
            **reactions,
        }
        if self._zone:
            for name in self.scene.frictional_guides:
                speed = columns[f"{name}.slip_velocity"]
                is_slow = np.abs(speed) < self._zone
                columns[f"{name}.mode"] = np.where(is_slow, 0, np.sign(speed)).astype(np.int8)
        return columns


def _contact_guides(model: Model, options: Mapping[str, Any]) -> list[ContactGuide]:
    """Return Exudyn's contacts of all guides."""
    return [ContactGuide(model, name, guide, options) for name, guide in model.scene.guides.items()]


def _located_friction(model: Model) -> list[LocatedFriction]:
    """Return the adapter's friction of all joints that have any."""
    located: list[LocatedFriction] = []
    for name, joint in model.scene.frictional_joints.items():
        if not joint.rubs:
            continue
        if isinstance(joint, Revolute):
            located.append(FrictionalPin(model, name, joint))
        else:
            located.append(FrictionalGuide(model, name, joint))
    return located


def _divide_steps_at_contacts(settings: Any) -> None:
    """Let Exudyn divide a step in which stiff contacts close and open."""
    integration = settings.timeIntegration
    integration.adaptiveStep = True
    integration.minimumStepSize = _SHORTEST
    integration.adaptiveStepRecoverySteps = _RECOVERY_STEPS
    # A Jacobian of another state of the contacts is useless: each Newton iteration computes its own.
    integration.newton.useModifiedNewton = False


def _solver_settings(model: Model, h: float, options: Mapping[str, Any]) -> Any:
    """Return Exudyn's settings for steps of h seconds.

    Raises
    ------
    Refused
        If the integrator is an explicit one, with Exudyn's own reason if it has one.
    """
    import exudyn

    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    integration = settings.timeIntegration
    integration.verboseMode = 0
    integration.endTime = h
    integration.numberOfSteps = 1
    integration.adaptiveStep = False
    integration.automaticStepSize = False
    integration.generalizedAlpha.spectralRadius = options["spectral_radius"]
    integration.newton.relativeTolerance = options["newton_tolerance"]
    integration.newton.absoluteTolerance = options["newton_tolerance"]
    integration.discontinuous.iterationTolerance = DISCONTINUOUS_TOLERANCE
    integration.discontinuous.maxIterations = FRICTION_REPETITIONS
    integration.discontinuous.ignoreMaxIterations = False
    name = options["integrator"]
    if name in _EXPLICIT:
        # Exudyn itself says why it does not integrate constraints explicitly.
        integration.solverType = exudyn.DynamicSolverType.__members__[_EXPLICIT[name]]
        try:
            exudyn.MainSolverExplicit().InitializeSolver(model.system, settings)
        except exudyn.ModelError as error:
            raise Refused(f"integrator={name}: {_shortened(str(error), '')}") from None
        raise Refused(f"integrator={name}: the adapter restarts implicit methods only")
    use_newmark, use_index_2 = INTEGRATORS[name]
    integration.generalizedAlpha.useNewmark = use_newmark
    integration.generalizedAlpha.useIndex2Constraints = use_index_2
    return settings


@contextlib.contextmanager
def _captured_messages() -> Iterator[None]:
    """Keep Exudyn's messages from the terminal; append them to the message of a failure."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            yield
    except EngineFailure as failure:
        raise EngineFailure(_shortened(str(failure), printed.getvalue())) from failure
    except RuntimeError as error:
        raise EngineFailure(_shortened(str(error), printed.getvalue())) from error


def _shortened(message: str, printed: str) -> str:
    """Return the lines of a message and of the printed output, each once, without banners and names of source files."""
    text = re.sub(
        r"(Python WARNING )?\[(Python )?file '[^']*', line \d+\]:?", "", message + "\n" + printed
    )
    lines = [line.strip() for line in text.splitlines() if line.strip(" *=-+\t")]
    return "; ".join(dict.fromkeys(lines))[:_LONGEST_MESSAGE]
