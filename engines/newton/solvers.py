"""Newton's solvers: what each of them represents, its defaults, and how it is created."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

KAMINO, MUJOCO, XPBD = "kamino", "mujoco", "xpbd"
FEATHERSTONE, SEMI_IMPLICIT, VBD = "featherstone", "semi_implicit", "vbd"


@dataclass(frozen=True)
class SolverKind:
    """What a solver of Newton represents, by the section "Joint limitations" of its documentation and by trial.

    Attributes
    ----------
    label : str
        Name of its class.
    defaults : mapping of str to number
        Defaults of the settings that differ between solvers. A setting that is not among them has no effect on the
        solver.
    has_joint_friction : bool
        Whether it applies ``Model.joint_friction``. The others ignore it without a message.
    has_loops : bool
        Whether joints outside of articulations close loops. Otherwise they are ignored without a message.
    has_sliding_loops : bool
        Whether such a joint may be prismatic.
    has_planar_joint : bool
        Whether it has joints with two sliding and one turning degree of freedom.
    has_armature : bool
        Whether it applies ``Model.joint_armature``, by which drives have a rotor. In the others a drive is a spring.
    follows_drives : bool
        Whether a joint can follow a law of time. A spring that knows an angle up to a turn only cannot.
    uses_joint_state : bool
        Whether it reads joint coordinates, and computes the bodies from them. The others read the bodies.
    detects_contacts : bool
        Whether it finds contacts itself, as in Newton's examples. The others get those of Newton's pipeline.
    rounds_positions : bool
        Whether velocities are differences of positions in single precision. Their rounding, divided by a step, is far
        above that of velocities that are integrated.
    """

    label: str
    defaults: Mapping[str, float] = field(default_factory=dict)
    has_joint_friction: bool = False
    has_loops: bool = True
    has_sliding_loops: bool = True
    has_planar_joint: bool = True
    has_armature: bool = False
    follows_drives: bool = True
    uses_joint_state: bool = False
    detects_contacts: bool = False
    rounds_positions: bool = False


_SOFT_CONTACT = {"contact_stiffness": 2.5e3, "contact_damping": 100.0}
"""Newton's own defaults for shapes, N/m and N s/m."""
_HARD_CONTACT = {"contact_stiffness": 1e5, "contact_damping": 100.0}
"""Contacts with the stiffness of Newton's examples of contacts, N/m, and the default of its damping, N s/m."""
KINDS: Mapping[str, SolverKind] = {
    KAMINO: SolverKind(
        "SolverKamino",
        {"iterations": 200, "tolerance": 1e-6, "stabilization": 0.1},
        has_joint_friction=True,
        has_planar_joint=False,
        has_armature=True,
        detects_contacts=True,
    ),
    MUJOCO: SolverKind(
        "SolverMuJoCo",
        {"iterations": 100, "tolerance": 1e-8, "impratio": 1.0, **_SOFT_CONTACT},
        has_joint_friction=True,
        has_sliding_loops=False,
        has_armature=True,
        uses_joint_state=True,
        detects_contacts=True,
    ),
    XPBD: SolverKind(
        "SolverXPBD",
        {"iterations": 20, "relaxation": 0.7},
        follows_drives=False,
        rounds_positions=True,
    ),
    FEATHERSTONE: SolverKind(
        "SolverFeatherstone",
        {"friction_gain": 1e3, **_HARD_CONTACT},
        has_loops=False,
        has_sliding_loops=False,
        has_armature=True,
        uses_joint_state=True,
    ),
    SEMI_IMPLICIT: SolverKind(
        "SolverSemiImplicit",
        {
            "joint_stiffness": 1e4,
            "joint_damping": 100.0,
            "friction_gain": 1e3,
            **_SOFT_CONTACT,
        },
        follows_drives=False,
        rounds_positions=True,
    ),
    VBD: SolverKind(
        "SolverVBD",
        {
            "iterations": 10,
            "joint_stiffness": 1e6,
            "drive_stiffness": 1e6,
            "drive_damping": 0.0,
            **_HARD_CONTACT,
            "slip_tolerance": 1e-2,
        },
        rounds_positions=True,
    ),
}
"""The solvers by the value of the setting `solver`, the default first."""
DVI = "dvi"
"""Value of the setting `dynamics`: Kamino's projected iterations with a direct solution for the joints."""
PADMM = "padmm"
"""Value of the setting `dynamics`: Kamino's proximal method of multipliers."""
DVI_ITERATIONS = 24
"""Default of `iterations` for `DVI`: that of Newton."""


def create(name: str, model: Any, options: Mapping[str, Any], most_contacts: int) -> Any:
    """Return a solver of a finalized model.

    Parameters
    ----------
    name : str
        A key of `KINDS`.
    model : newton.Model
    options : mapping
        Settings of the run.
    most_contacts : int
        Largest number of contacts; 0 if there are none.
    """
    from newton import solvers

    match name:
        case "kamino":
            return solvers.SolverKamino(model, config=_kamino_config(options, most_contacts))
        case "mujoco":
            return solvers.SolverMuJoCo(
                model,
                iterations=options["iterations"],
                integrator=options["integrator"],
                cone=options["cone"],
                impratio=options["impratio"],
                tolerance=options["tolerance"],
                disable_contacts=most_contacts == 0,
            )
        case "xpbd":
            return solvers.SolverXPBD(
                model,
                iterations=options["iterations"],
                joint_linear_relaxation=options["relaxation"],
                joint_angular_relaxation=options["relaxation"],
                angular_damping=0.0,
            )
        case "featherstone":
            return solvers.SolverFeatherstone(model, angular_damping=0.0)
        case "semi_implicit":
            return solvers.SolverSemiImplicit(
                model,
                angular_damping=0.0,
                joint_attach_ke=options["joint_stiffness"],
                joint_attach_kd=options["joint_damping"],
            )
        case "vbd":
            return solvers.SolverVBD(
                model,
                iterations=options["iterations"],
                rigid_joint_linear_ke=options["joint_stiffness"],
                rigid_joint_angular_ke=options["joint_stiffness"],
                friction_epsilon=options["slip_tolerance"],
            )
    raise ValueError(f"solver: found {name!r}; expected {', '.join(KINDS)}")


def _kamino_config(options: Mapping[str, Any], most_contacts: int) -> Any:
    """Return the configuration of Kamino."""
    from newton import solvers

    config = solvers.SolverKamino.Config(
        dynamics_solver=options["dynamics"], use_collision_detector=most_contacts > 0
    )
    config.constraints.alpha = options["stabilization"]
    config.constraints.gamma = options["stabilization"]
    if config.collision_detector is not None:
        config.collision_detector.max_contacts_per_world = most_contacts
    if options["dynamics"] == PADMM:
        config.padmm.max_iterations = options["iterations"]
        for name in ("primal_tolerance", "dual_tolerance", "compl_tolerance"):
            setattr(config.padmm, name, options["tolerance"])
    else:
        config.dvi.max_alternating_iterations = options["iterations"]
        config.dvi.tolerance = options["tolerance"]
    return config
