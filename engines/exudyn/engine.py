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
from stiction.engines.exudyn.bristles import FRICTION_LAW, BristleGuide, bristle_guides
from stiction.engines.exudyn.contact import ContactGuide
from stiction.engines.exudyn.friction import FrictionalGuide
from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.script import exudyn_script
from stiction.engines.exudyn.solver import INTEGRATORS
from stiction.engines.exudyn.stepping import (
    DISCONTINUOUS_TOLERANCE,
    FRICTION_REPETITIONS,
    Sample,
    Stepper,
)
from stiction.engines.protocol import (
    UNSETTLED,
    Capabilities,
    Engine,
    EngineFailure,
    Refused,
    Supplier,
    Unsettled,
    accepted,
)
from stiction.engines.shared.contact_geometry import contact_refusal
from stiction.engines.shared.fixed_step import DEFAULT_SHARE, Defaults, settings_of, step_of
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.scenes import Breakdown, Cost, Event, InputError, Scene, Trajectory
from stiction.scenes.event_values import rows_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import LinearSpring

_DEFAULT_STEP = 2e-3
"""Step in seconds where none is given; twice that of the engines of first order, as Exudyn's methods are of second."""
LOCATED, BRISTLES = "located", "bristles"
"""The setting `method` of joint fidelity: the adapter's friction with located switches, or Exudyn's own."""
_EXPLICIT = {"rk44": "RK44", "dopri5": "DOPRI5", "velocity-verlet": "VelocityVerlet"}
"""Some of Exudyn's explicit methods, by their names there."""
_JOINT: Defaults = {
    "integrator": (*INTEGRATORS, *_EXPLICIT),
    "method": (LOCATED, BRISTLES),
    "spectral_radius": 0.3,
    "newton_tolerance": 1e-9,
}
_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: _JOINT,
    BRISTLES: {**_JOINT, "bristle_stiffness": 1e5, "bristle_damping": 1e3, "static_decay": 1.0},
    Fidelity.CONTACT: {
        "integrator": _JOINT["integrator"],
        "spectral_radius": 0.3,
        "newton_tolerance": 1e-8,
        "contact_stiffness": 1e7,
        "contact_damping": 5e4,
        "friction_zone": 1e-4,
    },
}
"""Settings by fidelity; those of joint fidelity with Exudyn's own friction by the name of that method."""
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
    `bristle_stiffness` (N/m), `bristle_damping` (N s/m) and `static_decay`, the speed at which 37 % of the excess of
    static over kinetic friction remain, divided by the change of slip speed that this excess causes in one step.
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
    )

    @property
    def version(self) -> str:
        import exudyn

        return accepted("exudyn", exudyn.config.Version())

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return settings_of({}, _SETTINGS[fidelity], self.name, fidelity)

    def check_arguments(self, *, settings: Mapping[str, Any], **asked: Any) -> None:
        # Each method has settings of its own, which `settings_of_run` checks.
        super().check_arguments(settings={} if "method" in settings else settings, **asked)

    def settings_of_run(
        self, given: Mapping[str, Any], *, fidelity: Fidelity, **_: Any
    ) -> dict[str, Any]:
        own = given.get("method") == BRISTLES and fidelity == Fidelity.JOINT
        return settings_of(given, _SETTINGS[BRISTLES if own else fidelity], self.name, fidelity)

    def friction_supplier(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> Supplier:
        if fidelity == Fidelity.JOINT and settings.get("method") == BRISTLES:
            return Supplier.BOTH  # the law is Exudyn's; the adapter sets its bound before each step
        return super().friction_supplier(fidelity, settings)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == LOCATED

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == LOCATED

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        # At zero length the direction of a damper's force is the limit of the motion, and Exudyn
        # divides by that length.
        for name, spring in scene.springs.items():
            if (
                isinstance(spring, LinearSpring)
                and spring.axis is None
                and spring.rest_length == 0
                and spring.damping > 0
            ):
                return (
                    f"springs.{name}: Exudyn has no direction for a damper between points that may coincide; "
                    "give an axis"
                )
        if (
            unknowns := 3 * len(scene.bodies) + 2 * len(scene.joints) + len(scene.drives)
        ) > MOST_UNKNOWNS:
            return (
                f"{unknowns} coordinates and multipliers; expected at most {MOST_UNKNOWNS}: the adapter looks for "
                "redundant constraints in a dense matrix"
            )
        if fidelity == Fidelity.CONTACT:
            return contact_refusal(scene) or next(
                (
                    f"joints.{name}: Exudyn's contacts have one coefficient of friction; "
                    f"mus = {guide.mus:g} is not mu = "
                    f"{guide.mu:g}"
                    for name, guide in scene.guides.items()
                    if guide.frictional and guide.static_coefficient != guide.mu
                ),
                None,
            )
        return None

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
        start = time.process_time()
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
        with _captured_messages():
            simulation = _Simulation(assembly, h, options, options.get("method"))
            stepper = simulation.stepper
            started = time.process_time()
            # Friction that does not settle ends the motion, and is no failure of the run: it has
            # the samples before that.
            stop = None
            stepper.solver.clock.start()
            try:
                stepper.run(t_end, max(1, round(output_step / h)))
            except Unsettled as error:
                stop = Breakdown(UNSETTLED, error.time, str(error))
        ended, engine_s = time.process_time(), stepper.solver.clock.engine_s
        samples = stepper.samples
        # Columns are computed for arrays of samples: here for both sides of all switches at once.
        events = []
        if stepper.switches:
            rows = rows_of(
                simulation.columns(
                    [side for switch in stepper.switches for side in (switch.before, switch.after)]
                )
            )
            events = [
                Event(switch.before.t, switch.kind, switch.guide, before, after)
                for switch, before, after in zip(stepper.switches, rows[::2], rows[1::2])
            ]
        reported = {
            "dt": h,
            **options,
            "linear_solver": "EigenDense, singular matrices borne"
            if stepper.solver.redundant
            else "EXUdense",
        }
        if scene.frictional_guides:
            reported["friction_law"] = (
                FRICTION_LAW
                if options.get("method") == BRISTLES
                else self.capabilities.friction_law[fidelity]
            )
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=np.array([sample.t for sample in samples]),
            columns=simulation.columns(samples),
            events=tuple(events),
            settings=reported,
            cost=Cost(started - start, 0.0, ended - started, stepper.counters, engine_s),
            termination="end" if stop is None else stop.reason,
            breakdown=stop,
        )


def scene_as_script(scene: Scene, named: str = "SCENE") -> str:
    """Return the model as a script for Exudyn, with the adapter's default step and settings; see `exudyn_script`.

    Its comments call the scene `named` in a command line.

    Raises
    ------
    Refused
        If Exudyn cannot express the scene.
    """
    if (reason := ExudynEngine().refusal(scene, Fidelity.JOINT)) is not None:
        raise Refused(reason)
    options = settings_of({}, _SETTINGS[BRISTLES], ExudynEngine.name, Fidelity.JOINT)
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
        scene, self._mechanism = assembly.scene, assembly.whole
        self.scene, self.model = scene, Model(scene, joints=method is not None)
        self._zone = options.get("friction_zone", 0.0)
        # One of three models of the guides; the other two lists remain empty.
        located: list[FrictionalGuide] = []
        bristles: list[BristleGuide] = []
        boxes: list[ContactGuide] = []
        if method is None:
            boxes = [
                ContactGuide(self.model, name, guide, options)
                for name, guide in scene.guides.items()
            ]
        elif method == BRISTLES:
            bristles = bristle_guides(self.model, options, h, self._mechanism)
        else:
            located = [
                FrictionalGuide(self.model, name, guide)
                for name, guide in scene.frictional_guides.items()
                if guide.static_coefficient > 0
            ]
        self.model.assemble()
        settings = _solver_settings(self.model, h, options)
        if method is None:
            # Stiff contacts close and open within a step, which then is divided. A Jacobian of
            # another state of the contacts is useless, so each Newton iteration computes its own.
            settings.timeIntegration.adaptiveStep = True
            settings.timeIntegration.minimumStepSize = _SHORTEST
            settings.timeIntegration.adaptiveStepRecoverySteps = _RECOVERY_STEPS
            settings.timeIntegration.newton.useModifiedNewton = False
        # Where the solution of a step is repeated for the friction, a Jacobian of this step pays;
        # otherwise one of a step before costs less.
        settings.timeIntegration.newton.modifiedNewtonJacUpdatePerStep = bool(located)
        self._guides: list[Any] = [*located, *bristles, *boxes]
        self.stepper = Stepper(
            self.model,
            located,
            h,
            settings,
            bristles,
            self._mechanism,
            lambda: [guide.record() for guide in self._guides],
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
        for i, guide in enumerate(self._guides):
            reactions |= guide.columns(
                np.array([sample.guides[i] for sample in samples]), q, reactions
            )
        columns = {
            **recover_columns(self.scene, t, q, v, a, reactions, self._mechanism),
            **reactions,
        }
        for name in self.scene.frictional_guides if self._zone else ():
            speed = columns[f"{name}.slip_velocity"]
            columns[f"{name}.mode"] = np.where(
                np.abs(speed) < self._zone, 0, np.sign(speed)
            ).astype(np.int8)
        return columns


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
    integration.endTime, integration.numberOfSteps = h, 1
    integration.adaptiveStep = integration.automaticStepSize = False
    integration.generalizedAlpha.spectralRadius = options["spectral_radius"]
    integration.newton.relativeTolerance = integration.newton.absoluteTolerance = options[
        "newton_tolerance"
    ]
    integration.discontinuous.iterationTolerance = DISCONTINUOUS_TOLERANCE
    integration.discontinuous.maxIterations = FRICTION_REPETITIONS
    integration.discontinuous.ignoreMaxIterations = False
    if (name := options["integrator"]) in _EXPLICIT:
        # Exudyn itself says why it does not integrate constraints explicitly.
        integration.solverType = exudyn.DynamicSolverType.__members__[_EXPLICIT[name]]
        try:
            exudyn.MainSolverExplicit().InitializeSolver(model.system, settings)
        except exudyn.ModelError as error:
            raise Refused(f"integrator={name}: {_shortened(str(error), '')}") from None
        raise Refused(f"integrator={name}: the adapter restarts implicit methods only")
    integration.generalizedAlpha.useNewmark, integration.generalizedAlpha.useIndex2Constraints = (
        INTEGRATORS[name]
    )
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
    """Join the lines of a message and of what was printed, each once, without banners and names of source files."""
    text = re.sub(
        r"(Python WARNING )?\[(Python )?file '[^']*', line \d+\]:?", "", message + "\n" + printed
    )
    lines = [line.strip() for line in text.splitlines() if line.strip(" *=-+\t")]
    return "; ".join(dict.fromkeys(lines))[:_LONGEST_MESSAGE]
