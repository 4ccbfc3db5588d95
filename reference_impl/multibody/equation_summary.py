"""Equation blocks of a scene in the reference implementation: blocks, their sizes, and what was left out.

Sizes are counted from the declarations; only the rank of the constraints is numerical.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.multibody.subsystems import connected_bodies, independent_parts
from stiction.scenes import Scene
from stiction.scenes.model import Baumgarte, NoStabilization, Revolute

UNKNOWNS_OF_STICK = 4
"""gH+ and lH- of both surfaces: what a sticking guide with a coefficient of friction adds to the HLCP."""
UNKNOWNS_OF_DIRECTION = 2
"""gH+ and lH- of one direction: what any other sticking joint adds, a pin or a guide with a constant bound alone."""


@dataclass(frozen=True)
class Block:
    """An effect, and what it adds to the equations; their numbers are those of Zhuang & Wang 2014."""

    name: str
    elements: tuple[str, ...]
    """The elements of the scene that declare it; empty if it is left out."""
    equation: str
    size: str
    """What it adds in unknowns or equations; empty if nothing."""
    absence: str
    """What it means where no element declares the effect."""


def blocks(scene: Scene) -> list[Block]:
    """All effects there are, declared by the scene or not."""
    revolute = tuple(name for name, joint in scene.joints.items() if isinstance(joint, Revolute))
    guides = scene.guides
    frictional = {name: guide for name, guide in guides.items() if guide.mu is not None}
    bounded = tuple(
        name
        for name, joint in scene.joints.items()
        if joint.friction is not None or joint.bounds[1] > 0.0
    )
    firmer = tuple(
        name for name in bounded if scene.joints[name].bounds[1] > scene.joints[name].bounds[0]
    )
    alone = [name for name in bounded if name not in frictional]
    loaded = {name: pin for name, pin in scene.pins.items() if pin.is_under_load}
    firmer += tuple(
        name for name, pin in loaded.items() if pin.friction_radii[1] > pin.friction_radii[0]
    )
    cornered = tuple(name for name, guide in guides.items() if guide.length is not None)
    levers = tuple(name for name, guide in frictional.items() if guide.width)
    static = tuple(
        name
        for name, guide in frictional.items()
        if guide.static_coefficient > guide.kinetic_coefficient
    )
    stiff = tuple(name for name, spring in scene.springs.items() if spring.stiffness)
    damped = tuple(name for name, spring in scene.springs_and_dampers.items() if spring.damping)
    law, stabilization = scene.stabilization, "Phi'' = 0"
    if isinstance(law, Baumgarte):
        stabilization = f"Phi'' + {2 * law.alpha:g} Phi' + {law.beta**2:g} Phi = 0 (25)"
    elif not isinstance(law, NoStabilization):
        stabilization = "Phi'' = 0, q and q' projected onto the constraints after each step"
    declared = (
        (law.method,) if isinstance(law, Baumgarte) else ()
    )  # projection is no term of the equations
    return [
        Block(
            "bodies",
            tuple(scene.bodies),
            "M q'' = QE + J^T lambda + W_T^T lambda_T (21)",
            f"coordinates: {3 * len(scene.bodies)}",
            "",
        ),
        Block(
            "gravity",
            ("gravity",) if scene.gravity and any(scene.gravity) else (),
            "QE: m g on each body",
            "",
            "no weight",
        ),
        Block(
            "springs",
            stiff,
            "QE: -k (x - rest) on two bodies, x a distance or an angle",
            "",
            "no elastic force",
        ),
        Block(
            "one-sided springs",
            tuple(scene.one_sided_springs),
            "QE: the tension where x is beyond its rest and the tension has the spring's sign, else 0",
            "",
            "springs push and pull",
        ),
        Block("dampers", damped, "QE: -c x' on two bodies", "", "no viscous force"),
        Block("forces", tuple(scene.forces), "QE: law(t) on a body", "", "no law of time in QE"),
        Block(
            "revolute joints",
            revolute,
            "Phi_CR = r_1 - r_2 = 0",
            f"rows: {2 * len(revolute)}",
            "no pin force",
        ),
        Block(
            "translational joints",
            tuple(guides),
            "Phi_CT = [n . (r_1 - r_2); th_1 - th_2 - angle] = 0",
            f"rows: {2 * len(guides)}",
            "no guide",
        ),
        Block(
            "drives",
            tuple(scene.prescribed_drives),
            "Phi_D = coordinate - law(t) = 0",
            f"rows: {len(scene.prescribed_drives)}",
            "no driving multiplier",
        ),
        Block(
            "limited drives",
            tuple(scene.limited_drives),
            "holds: coordinate' = law', |lambda_D| <= L; gives way: lambda_D = -L sgn(coordinate' - law')",
            f"tangential rows: {len(scene.limited_drives)}",
            "no drive gives way",
        ),
        Block("stabilization", declared, stabilization, "", "no feedback of residuals"),
        Block(
            "corner forces",
            cornered,
            "F+ >= 0, F- >= 0, F+ F- = 0 (1)-(2)",
            f"pairs: {2 * len(cornered)}",
            "a guide has its resultant normal force and moment only",
        ),
        Block(
            "friction",
            tuple(frictional),
            "slip: lambda_T = -mu FN sgn(gT'); stick: gT' = 0 (3)-(16)",
            f"tangential rows: {len(frictional)}",
            "friction does not depend on normal forces: accelerations exist and are unique"
            if bounded or loaded or scene.limited_drives
            else "no complementarity problem: one linear solve gives all multipliers",
        ),
        Block(
            "constant bounds",
            bounded,
            "slip: lambda_T = -(c + mu FN) sgn(gT'); stick: |lambda_T| <= cH + mus FN",
            f"tangential rows: {len(alone)}",
            "friction is proportional to normal forces",
        ),
        Block(
            "surface levers",
            levers,
            "rows of W_T for both surfaces, +- b/2 apart",
            "",
            "friction does not turn a slider",
        ),
        Block(
            "static coefficient",
            tuple(dict.fromkeys([*static, *firmer])),
            "stick: |lambda_T| <= cH + mus FN, mus > mu or cH > c (14), (17)"
            if firmer
            else "stick: |lambda_T| <= mus FN, mus > mu (14), (17)",
            "",
            "friction does not drop at break-away",
        ),
        Block(
            "pins under load",
            tuple(loaded),
            "c = friction + mu radius |R|, cH = static_friction + mus radius |R|, R = (fx, fy)",
            f"tangential rows: {len([name for name in loaded if name not in bounded])}",
            "friction in pins does not depend on their forces",
        ),
        Block(
            "Stribeck's curve",
            tuple(name for name, joint in scene.joints.items() if joint.depends_on_speed),
            "slip: mu and c fall from mus and cH with exp(-(|gT'| / v_s)^shape)",
            "",
            "friction in slip does not depend on its speed",
        ),
    ]


def two_sided_guides(scene: Scene) -> list[str]:
    """Return the guides with a coefficient of friction, whose two surfaces have a friction each."""
    return [name for name, guide in scene.guides.items() if guide.mu is not None]


def hlcp_size(scene: Scene, sticking: int = 0, sticking_otherwise: int = 0) -> int:
    """Return the number of complementary pairs of eqs. (36)-(38) for a number of sticking joints.

    It is 0 without friction. There is a pair for every bilateral row. The two rows of a guide with a
    coefficient of friction give way to its two corners, or without a length its normal row to its
    normal force. `UNKNOWNS_OF_STICK` are added for each of these guides that is `sticking`, and
    `UNKNOWNS_OF_DIRECTION` for each other element that is `sticking_otherwise`: a pin, a guide with
    a constant bound alone, or a drive with a limit that holds.
    """
    if not scene.bounded_elements:
        return 0
    of_stick = UNKNOWNS_OF_STICK * sticking + UNKNOWNS_OF_DIRECTION * sticking_otherwise
    return constraint_rows(scene) + of_stick


def constraint_rows(scene: Scene) -> int:
    """Return the number of rows of Phi: two for a joint, one for a drive without a limit."""
    return 2 * len(scene.joints) + len(scene.prescribed_drives)


def constraint_components(scene: Scene) -> list[tuple[str, ...]]:
    """The bodies in groups that neither joints nor drives connect (the ground connects nothing)."""
    count, group = connected_bodies(
        scene, (element.bodies for element in (*scene.joints.values(), *scene.drives.values()))
    )
    members: list[list[str]] = [[] for _ in range(count)]
    for name in scene.bodies:
        members[group[name]].append(name)
    return [tuple(names) for names in members]


def degrees_of_freedom(scene: Scene) -> int:
    """Number of independent motions at the start, those that drives prescribe not counted."""
    return 3 * len(scene.bodies) - rank(scene)


def is_prescribed(scene: Scene) -> bool:
    """Return True if drives prescribe the motion completely.

    A drive that gives way beyond a limit prescribes nothing there.
    """
    drives = scene.drives.values()
    if not drives or any(drive.is_limited for drive in drives):
        return False
    return degrees_of_freedom(scene) == 0


def rank(scene: Scene) -> int:
    """Rank of J at the start: what it is short of the number of rows is redundant there."""
    parts = (EquationsOfMotion(part) for part in independent_parts(scene) if constraint_rows(part))
    return sum(int(np.linalg.matrix_rank(part.at(0.0, *part.start()).J)) for part in parts)
