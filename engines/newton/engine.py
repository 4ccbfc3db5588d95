"""Newton: six solvers for one model, on Warp, in single precision.

The bodies of a scene are bodies in the plane z = 0, whose joints are revolute and prismatic (`stiction.engines.newton
.model`). At contact fidelity the slider has a sphere at each corner, or is a box, between two planes. Loads act on the
bodies as wrenches. The motion is read from the poses and velocities of the bodies.

Single precision is stated as an uncertainty. Each run is repeated with all inputs moved by one unit in the last place,
and the differences between both runs are the setting `PRECISION` of the trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.newton.solvers import (
    DVI,
    DVI_ITERATIONS,
    KAMINO,
    KINDS,
    MUJOCO,
    PADMM,
    SolverKind,
)
from stiction.engines.newton.stepper import NewtonStepper, quiet
from stiction.engines.protocol import (
    NEGLECTED,
    PRECISION,
    BadTrajectory,
    EngineFailure,
    Refused,
    Supplier,
    check_version,
    installed_version,
    required,
)
from stiction.engines.registry import EngineMissing
from stiction.engines.shared.contact_geometry import contact_refusal, static_coefficient_refusal
from stiction.engines.shared.fixed_step import DEFAULT_STEP, Defaults, SteppedEngine, Stepper
from stiction.engines.shared.friction_bound import CAPPED
from stiction.engines.shared.joint_coordinates import motor_link, motor_refusal
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import InputError, Scene, Trajectory, scene_from_dict
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Translational

REFUSE, RUN = "refuse", "run"
MEASURED, OFF = "measured", "off"
SINGLE = "differences of velocities in single precision"
"""Setting ``accelerations`` of a trajectory whose accelerations are too noisy for a balance of forces."""
ONE_COEFFICIENT = "Coulomb at each contact, one coefficient mu (engine)"
_SOLVER_SETTINGS: dict[str, float] = {
    name: 0 if name == "iterations" else 0.0 for kind in KINDS.values() for name in kind.defaults
}
"""Settings whose defaults depend on the solver: with 0 they are those of `KINDS`."""
_COMMON: Defaults = {
    "solver": tuple(KINDS),
    "rounding": (MEASURED, OFF),
    "moved_inputs": 0,
    "dynamics": (DVI, PADMM),
    "integrator": ("implicitfast", "euler"),
}
_STATES = ("x", "y", "angle", "vx", "vy", "omega")
"""Labels of the columns that are continuous in time."""
_CONTACT_SETTINGS = ("contact_stiffness", "contact_damping", "friction_gain", "slip_tolerance")
_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {
        **_COMMON,
        **{
            name: value for name, value in _SOLVER_SETTINGS.items() if name not in _CONTACT_SETTINGS
        },
        "passes": 2,
        "ignored_friction": (REFUSE, RUN),
    },
    Fidelity.CONTACT: {
        **_COMMON,
        **_SOLVER_SETTINGS,
        "shape": ("spheres", "box"),
        "clearance": 1e-5,
        "cone": ("elliptic", "pyramidal"),
    },
}
_BLOCK = {
    "t_end": 2 * DEFAULT_STEP,
    "gravity": [0.0, -9.81],
    "bodies": {"block": {"mass": 1.0, "inertia": 0.1}},
    "joints": {
        "guide": {
            "type": "translational",
            "slider": "block",
            "direction": [1.0, 0.0],
            "length": 1.0,
            "width": 0.5,
            "mu": 0.5,
        }
    },
}
"""A block on a level guide, whose runs need the kernels for joints, friction and contacts."""
_ALWAYS = {"shape": "spheres", "cone": "elliptic", "passes": 1, "ignored_friction": REFUSE}
"""Values of settings that a fidelity does not have."""


class NewtonEngine(SteppedEngine):
    """Adapter of Newton; the module describes how each element of a scene is modelled.

    Settings: `solver`, one of Newton's solvers: kamino, mujoco (MuJoCo Warp), xpbd, featherstone, semi_implicit, vbd;
    `rounding`, measured or off: whether each run is repeated with moved inputs; `moved_inputs`, the number of units in
    the last place by which all inputs of a run are moved, each of them up or down.

    The following settings have an effect on some solvers only, and with 0 the default of the solver (see the table in
    the documentation): `iterations`; `tolerance` of the iterations; `stabilization`, the fraction of the position
    error that Kamino corrects in one step; `relaxation` of the joints of XPBD; `joint_stiffness` (N/m and N m/rad) and
    `joint_damping` of joints that are springs; `drive_stiffness` and `drive_damping` of drives that are springs. For
    Kamino, `dynamics` is the method by which a step is solved, dvi or padmm. For MuJoCo, `integrator` is implicitfast
    or euler.

    Further settings at joint fidelity: `passes`, repetitions of a step in which sticking is undecided;
    `ignored_friction`, refuse or run: a solver that has no friction of joints refuses a scene with such friction. With
    run, it gets the scene nevertheless, and the trajectory lists the friction as neglected.

    Further settings at contact fidelity: `shape`, spheres at the corners of the slider or a box; `clearance`, the
    width of a guide minus that of the slider (m), of guides that declare none; `contact_stiffness` (N/m),
    `contact_damping` and `friction_gain` (N s/m) of shapes; `slip_tolerance` (m/s), below which VBD's friction is
    reduced; `cone` and `impratio` of MuJoCo.
    """

    name, defaults = "newton", _SETTINGS
    capabilities = replace(
        SteppedEngine.capabilities,
        static_coefficient={Fidelity.JOINT: True, Fidelity.CONTACT: False},
        friction_law={Fidelity.JOINT: CAPPED, Fidelity.CONTACT: ONE_COEFFICIENT},
        friction_by={Fidelity.JOINT: Supplier.ADAPTER, Fidelity.CONTACT: Supplier.ENGINE},
    )

    @property
    def version(self) -> str:
        import newton  # noqa: F401 - an installation that cannot be imported has no version

        return check_version("newton", installed_version("newton"))

    def settings_of_run(self, given: Mapping[str, Any], **asked: Any) -> dict[str, Any]:
        settings = super().settings_of_run(given, **asked)
        defaults = dict(KINDS[settings["solver"]].defaults) if settings["solver"] in KINDS else {}
        if settings["solver"] == KAMINO and settings["dynamics"] == DVI:
            defaults["iterations"] = DVI_ITERATIONS
        for name, value in defaults.items():
            if name in settings and not settings[name]:
                settings[name] = value
        return settings

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("solver") == KAMINO

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return super().keeps_cone(fidelity, settings) and NEGLECTED not in settings

    def constant_bound_supplier(
        self, scene: Scene, fidelity: Fidelity, settings: Mapping[str, Any]
    ) -> Supplier | None:
        if NEGLECTED in settings:
            return Supplier.NOBODY
        return super().constant_bound_supplier(scene, fidelity, settings)

    def prepare(self) -> None:
        """Compile the kernels of the default solver, which Warp keeps on disk, by two steps at each fidelity."""
        block = scene_from_dict(_BLOCK, "prepared block")
        for fidelity in self.capabilities.fidelities:
            self.simulate(block, dt=DEFAULT_STEP, fidelity=fidelity, rounding=OFF)

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        reason = None
        if fidelity == Fidelity.CONTACT:
            reason = contact_refusal(scene)
            reason = reason or static_coefficient_refusal(scene, "Newton's shapes have")
        return reason or motor_refusal(scene, LinkTree(scene, fidelity), "Newton")

    @contextmanager
    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> Iterator[Stepper]:
        if not 0 <= options["stabilization"] <= 1:
            raise InputError(
                f"stabilization: found {options['stabilization']!r}; expected a fraction, 0 .. 1"
            )
        with quiet():
            complete = {**_ALWAYS, **KINDS[options["solver"]].defaults, **options}
            yield NewtonStepper(assembly, h, complete, fidelity)

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
        # a solver with an unknown name is refused with the other settings
        kind = KINDS.get(settings["solver"])
        neglected = [] if kind is None else _neglected(scene, fidelity, kind, settings)

        def simulate(further: Mapping[str, Any]) -> Trajectory:
            return super(NewtonEngine, self).run(
                scene,
                t_end=t_end,
                dt=dt,
                rtol=rtol,
                fidelity=fidelity,
                output_step=output_step,
                settings={**settings, **further},
                assembly=assembly,
            )

        if settings["solver"] == MUJOCO:
            _require_mujoco_warp()
        trajectory = simulate({})
        # What the solver left out, and what single precision hides, are stated by the trajectory.
        completion: dict[str, Any] = {}
        if neglected:
            completion[NEGLECTED] = neglected
            completion["friction_law"] = "none: the solver has no friction of joints (engine)"
        if kind is not None and kind.rounds_positions:
            completion["accelerations"] = SINGLE
        # The effect of rounding is measured by the same run with moved inputs.
        if settings["rounding"] == MEASURED:
            units = settings["moved_inputs"] + 1
            try:
                moved = simulate({"moved_inputs": units})
            except (EngineFailure, BadTrajectory):
                moved = None
            completion[PRECISION] = effect_of_rounding(trajectory, moved)
        return replace(trajectory, settings={**trajectory.settings, **completion})


def _neglected(
    scene: Scene, fidelity: Fidelity, kind: SolverKind, settings: Mapping[str, Any]
) -> list[str]:
    """Return the keys of the friction that a solver ignores in a scene, if the settings allow it.

    Raises
    ------
    Refused
        If the solver cannot represent the scene.
    """
    tree = LinkTree(scene, fidelity)
    reason = refusal_of_drives(scene, tree, fidelity, kind) or refusal_of_loops(scene, tree, kind)
    if reason:
        raise Refused(reason)
    if fidelity != Fidelity.JOINT or kind.has_joint_friction:
        return []
    ignored = friction_keys(scene)
    if ignored and settings["ignored_friction"] == REFUSE:
        raise Refused(_reason_of_friction(ignored[0], kind))
    return ignored


def _require_mujoco_warp() -> None:
    """Raise EngineMissing if the package by which `MUJOCO` steps is not installed."""
    try:
        import mujoco_warp  # noqa: F401
    except ImportError as error:
        raise EngineMissing(
            f"newton: solver={MUJOCO}: {error}; pip install 'mujoco-warp{required('mujoco-warp')}' brings it"
        ) from error


def refusal_of_drives(
    scene: Scene, tree: LinkTree, fidelity: Fidelity, kind: SolverKind
) -> str | None:
    """Return why a solver cannot drive a joint of a scene along a law; None if it can, or if there are no drives."""
    for name, drive in scene.drives.items():
        if not kind.follows_drives:
            return (
                f"drives.{name}: Newton's {kind.label} follows a drive by a spring towards an angle that it knows up "
                "to a turn; expected solver=kamino, mujoco, featherstone or vbd"
            )
        link = tree.links[motor_link(scene, tree, drive)[0]]
        if link.joint is None and fidelity == Fidelity.JOINT and not kind.has_planar_joint:
            return (
                f"drives.{name}: turns a body that no joint ties to the ground; Newton's {kind.label} has no joint in "
                "which such a body could be driven; expected solver=mujoco, featherstone or vbd"
            )
    return None


def refusal_of_loops(scene: Scene, tree: LinkTree, kind: SolverKind) -> str | None:
    """Return why a solver cannot close the loops of a scene; None if it can, or if there are none."""
    for name in tree.loops:
        joint = scene.joints[name]
        if not kind.has_loops:
            return (
                f"joints.{name}: closes a loop; Newton's {kind.label} ignores joints that close loops without a "
                "message; expected solver=kamino, mujoco, xpbd, semi_implicit or vbd"
            )
        if isinstance(joint, Translational) and not kind.has_sliding_loops:
            return (
                f"joints.{name}: closes a loop; Newton's {kind.label} leaves out prismatic joints that close loops; "
                "expected solver=kamino, xpbd, semi_implicit or vbd"
            )
        if joint.frictional and kind.uses_joint_state:
            return (
                f"joints.{name}: closes a loop and has friction; Newton's {kind.label} has friction in coordinates "
                "of joints, of which a joint that closes a loop has none; expected solver=kamino"
            )
    return None


def friction_keys(scene: Scene) -> list[str]:
    """Return the keys of a scene with the friction of its joints, such as ``joints.pin.friction``."""
    keys = []
    for name, joint in scene.frictional_joints.items():
        if any(joint.bounds):
            keys.append(f"joints.{name}.friction")
        if isinstance(joint, Translational) and joint.static_coefficient > 0.0:
            keys.append(f"joints.{name}.mu")
    return keys


def _reason_of_friction(key: str, kind: SolverKind) -> str:
    """Return the refusal of a scene whose friction a solver would ignore."""
    return (
        f"{key}: Newton's {kind.label} ignores the friction of joints (Model.joint_friction) without a message; "
        f"expected solver=kamino or mujoco, or ignored_friction={RUN} for the motion without it"
    )


def effect_of_rounding(trajectory: Trajectory, moved: Trajectory | None) -> dict[str, float]:
    """Return the differences between a run and the same run with inputs moved by one unit in the last place.

    Returns
    -------
    dict of str to float
        By column of a position, an angle or their rates: the largest difference, m, rad, m/s or rad/s. By column of an
        effort: the mean difference over time, N or N m. They are infinite if the other run failed, as then nothing is
        known of the effect.
    """
    effects: dict[str, float] = {}
    for name, column in trajectory.columns.items():
        label = name.rpartition(".")[2]
        if label not in (*_STATES, "effort"):
            continue
        if moved is None:
            effects[name] = math.inf
            continue
        difference = np.abs(moved.columns[name] - column)
        if label in _STATES:
            effects[name] = float(np.max(difference))
        elif not np.isnan(difference).all():
            effects[name] = float(np.nanmean(difference))
    return effects
