"""MuJoCo: joint coordinates, soft constraints solved as a convex problem, semi-implicit Euler.

Joint fidelity. The scene is written as MJCF (`stiction.engines.mujoco.mjcf`): the tree of links of
`stiction.engines.shared.link_tree`, joints that close loops as `connect` constraints. Drives: a rotor of huge inertia
in the joint and, in each step, the force that ends the step on the law. Friction: `frictionloss` of the joint at the
bound, with a reference (``solreffriction``) that brings the joint to rest within a step. It is soft: only the share
`impedance` (``solimpfriction``) of the force that would hold a slider is applied, and a sticking slider would creep.
MuJoCo's `noslip` sweeps solve for the frictions once more without this softness.

Contact fidelity. The slider is a box between two planes, without clearance (`stiction.engines.mujoco.contact`);
contacts have elliptic cones. The adapter also sets the damping of a guide's friction before each step.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import copysign
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.mujoco.contact import SIDES, slip_damping, slip_reference, surface
from stiction.engines.mujoco.loads import ROTOR
from stiction.engines.mujoco.mjcf import HARDEST, START, joint_name, mjcf
from stiction.engines.protocol import EngineFailure, Refused, check_version
from stiction.engines.shared.acceleration_integrator import Dynamics
from stiction.engines.shared.contact_geometry import direction_of
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import Defaults
from stiction.engines.shared.friction_bound import CAPPED, CONTACT
from stiction.engines.shared.joint_coordinates import ContactStepper, TreeStepper
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import InputError, Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Translational

DEEPEST = 495
"""Largest number of links in a chain. A link is an element in that of its parent, and MuJoCo's reader accepts 500
nested elements (XML_ELEMENT_DEPTH_EXCEEDED), some of which are the file's own."""
_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {
        "iterations": 20,
        "passes": 2,
        "impedance": HARDEST,
        "solver": ("PGS", "Newton", "CG"),
        "noslip": ("on", "off"),
        "loss_reference": ("step", "default"),
        "integrator": ("Euler", "implicitfast", "discrete", "RK4"),
    },
    Fidelity.CONTACT: {
        "iterations": 100,
        "impedance": 2 / 3,
        "recovery": 0.8,
        "slip_reference": 1.5,
        "clearance": 0.0,
        "solver": ("Newton", "CG"),
        "friction_damping": ("adapted", "step"),
        "time_constant": 0.0,
        "cone": ("elliptic", "pyramidal"),
        "impratio": 1e4,
        "noslip_iterations": 0,
    },
}
_MOST_FRICTION = 1.5
"""Largest coefficient of friction at contact fidelity: up to it a sliding box of 3 : 1 is braked with an error of 1 %.
At 1.75 and 2 it is braked 1.08 and 1.25 times as much, and at 2.5 it is stopped."""


class MujocoEngine(TreeEngine):
    """Adapter of MuJoCo; the module describes how each element of a scene is modelled.

    Settings at both fidelities: `iterations` of the solver per step; `solver`, Newton, CG or, at joint fidelity, PGS.

    Further settings at joint fidelity: `passes`, repetitions of a step in which sticking is undecided; `impedance` of
    friction and loops, the fraction of the force that would hold them rigidly, at most 0.9999; `noslip` (on, off),
    whether MuJoCo's noslip solver then computes friction as a hard constraint; `integrator`, Euler, implicitfast,
    discrete or RK4; `loss_reference`, step or default: whether friction is as stiff as one step allows, or has the
    ``solreffriction`` and ``solimpfriction`` of a model that sets neither. An ordinary MuJoCo model is
    ``loss_reference=default noslip=off solver=Newton``. Friction bounds and loads are constant during a step.

    Further settings at contact fidelity: `impedance` of contacts; `recovery`, the fraction of their overlap that hard
    contacts correct in one step; `friction_damping`, the damping by which friction opposes slip: with ``adapted``,
    the deceleration that it causes is at most `slip_reference` times the larger of two values, the deceleration in the
    last step and the largest one that friction can cause; with ``step``, slip ends within one step; `clearance` between
    a slider and both surfaces together, in m.

    MuJoCo's manual recommends three settings against slow slip: `cone`, elliptic or pyramidal; `impratio`, the ratio of
    frictional to normal impedance, to which the creep of a sticking slider is inversely proportional; and
    `noslip_iterations`, iterations of the noslip solver (with pyramidal cones).

    With a positive `time_constant` (s), contacts and their friction are damped as specified by MuJoCo's ``solref``, and
    `recovery`, `friction_damping` and `slip_reference` have no effect. The contacts of an ordinary MuJoCo model are
    ``time_constant=0.02 impedance=0.95 impratio=1 cone=pyramidal``.
    """

    name, called, defaults = "mujoco", "MuJoCo", _SETTINGS
    capabilities = replace(
        TreeEngine.capabilities,
        friction_law={
            Fidelity.JOINT: CAPPED,
            Fidelity.CONTACT: f"{CONTACT}, and sets the damping of friction",
        },
    )

    @property
    def version(self) -> str:
        import mujoco

        return check_version("mujoco-core", mujoco.__version__)

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if reason := super().refusal(scene, fidelity):
            return reason
        for name, guide in scene.frictional_guides.items() if fidelity == Fidelity.CONTACT else ():
            if guide.static_coefficient > _MOST_FRICTION:
                return (
                    f"joints.{name}: found a coefficient of friction of {guide.static_coefficient:g}; above "
                    f"{_MOST_FRICTION:g} MuJoCo's contacts brake a slider that tips on its corners too much"
                )
        return None

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        depth: dict[int, int] = {}
        for i, link in enumerate(tree.links):
            # A free body's three joints are in one element, so its other two links do not count.
            depth[i] = depth.get(link.parent, 0) + (link.body is not None)
        deepest = max(depth.values(), default=0)
        if deepest > DEEPEST:
            return (
                f"{deepest} links hang on each other; MuJoCo's reader of XML takes {DEEPEST}, as their elements "
                "are nested"
            )
        return None

    @contextlib.contextmanager
    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> Iterator[TreeStepper]:
        for name, fits, expected in (
            (
                "impedance",
                0 < options["impedance"] <= HARDEST,
                f"0 < impedance <= {HARDEST}, MuJoCo's own limit",
            ),
            (
                "slip_reference",
                options.get("slip_reference", 1.0) >= 1,
                "at least 1, with less friction does not oppose slip",
            ),
            ("impratio", options.get("impratio", 1.0) > 0, "a number > 0"),
        ):
            if not fits:
                raise InputError(f"{name}: found {options[name]!r}; expected {expected}")
        if options.get("noslip_iterations") and options["cone"] == "elliptic":
            raise InputError(
                f"noslip_iterations: found {options['noslip_iterations']!r} with elliptic cones; expected "
                "cone=pyramidal, as noslip leaves an elliptic contact alone with a direction in which "
                "nothing can move, as that out of the plane"
            )
        with _captured_warnings() as warnings:
            yield (_JointStepper if fidelity == Fidelity.JOINT else _ContactStepper)(
                assembly, h, options, warnings
            )

    @contextlib.contextmanager
    def dynamics(self, scene: Scene, tree: LinkTree, clock: EngineClock) -> Iterator[Dynamics]:
        import mujoco

        model, data = _model(
            scene, tree, 1.0, Fidelity.JOINT, self.default_settings(Fidelity.JOINT)
        )
        model.dof_armature[:] = 0.0  # without the rotors of drives, which are a means of stepping
        mass = np.zeros((model.nv, model.nv))

        def compute() -> None:
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_fullM(model, data, mass)

        def evaluate(
            position: np.ndarray, velocity: np.ndarray, second: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            data.qpos[:], data.qvel[:] = position, velocity
            clock.call(compute)
            return mass, mass @ second + data.qfrc_bias

        yield evaluate


@contextlib.contextmanager
def _captured_warnings() -> Iterator[list[str]]:
    """Collect warnings of MuJoCo, which otherwise go to the error stream and to a file in the working directory."""
    import mujoco

    warnings: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)
    try:
        yield warnings
    finally:
        mujoco.set_mju_user_warning(before)


def scene_as_mjcf(scene: Scene, timestep: float, fidelity: Fidelity = Fidelity.JOINT) -> str:
    """Return the MJCF of a scene with springs, dampers, loads and drives; Refused if MuJoCo cannot represent it."""
    engine = MujocoEngine()
    if reason := engine.reason_to_refuse(scene, fidelity):
        raise Refused(reason)
    # The adapter applies springs as loads, whereas the file has elements for them.
    for name in scene.one_sided_springs:
        raise Refused(
            f"springs.{name}: MJCF has no spring and damper that act on one side only; without acts it is written"
        )
    return mjcf(
        scene,
        LinkTree(scene, fidelity),
        timestep,
        fidelity,
        engine.default_settings(fidelity),
        loaded=True,
    )


def _model(
    scene: Scene, tree: LinkTree, timestep: float, fidelity: Fidelity, options: Mapping[str, Any]
) -> tuple[Any, Any]:
    """Return MuJoCo's model and data at the scene's start; joint coordinates are in the order of the tree's links."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_string(mjcf(scene, tree, timestep, fidelity, options))
    except ValueError as error:
        # MuJoCo's own limits, for example of masses
        raise EngineFailure(f"mujoco: {error}") from error
    names = [model.joint(i).name for i in range(model.njnt)]
    expected = [joint_name(tree, i) for i in range(len(tree.links))]
    if names != expected:
        raise RuntimeError(f"MuJoCo numbers the joints {names}; expected {expected}")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
    return model, data


class _Stepper(TreeStepper):
    """A scene as MuJoCo model with drives and loads; subclasses add friction."""

    def __init__(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], warnings: Sequence[str]
    ):
        import mujoco

        super().__init__(assembly, h, options)
        scene = assembly.scene
        self._advance_engine, self._warnings = mujoco.mj_step, warnings
        self.model, self.data = model, data = _model(scene, self.tree, h, self.fidelity, options)
        self._drive_force = data.qfrc_applied
        self.share_joint_state(data.qpos, data.qvel)
        # places of force x, force y, torque z of each body among MuJoCo's six numbers of each
        self._pushed = data.xfrc_applied.reshape(-1)
        self._places = np.array(
            [6 * model.body(name).id + k for name in scene.bodies for k in (0, 1, 5)]
        )

    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.position[:], self.velocity[:] = position, velocity

    def advance(self, caps: Sequence[float]) -> None:
        # The rotor's inertia dwarfs that of the mechanism, so this force gives the joint its rate
        # within the step, whatever the mechanism does.
        for link, rate in self.rates.items():
            self._drive_force[link] = ROTOR * (rate - self.velocity[link]) / self.h
        if self.loaded:
            self._pushed[self._places] = self.loads
        self.clock.call(self._advance_engine, self.model, self.data)
        # MuJoCo warns of a state that is not finite, and goes on with another one.
        if self._warnings:
            raise FloatingPointError(self._warnings[0])


class _JointStepper(_Stepper):
    """Guides as slides, pins as hinges, friction as their loss."""

    def __init__(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], warnings: Sequence[str]
    ):
        super().__init__(assembly, h, options, warnings)
        self._loss = self.model.dof_frictionloss
        self._by_link = sorted(range(len(self.friction_links)), key=self.friction_links.__getitem__)

    def advance(self, caps: Sequence[float]) -> None:
        for link, cap in zip(self.friction_links, caps):
            self._loss[link] = cap
        super().advance(caps)
        # Among MuJoCo's constraint forces, those of friction follow those of loops, in the order of
        # the joints. A joint whose bound is 0 has none.
        row, force = self.data.ne, self.data.efc_force
        for i in self._by_link:
            self.held[i] = abs(force[row]) if caps[i] > 0.0 else 0.0
            row += caps[i] > 0.0


class _ContactStepper(ContactStepper, _Stepper):
    """Sliders as boxes between two planes each."""

    def __init__(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], warnings: Sequence[str]
    ):
        super().__init__(assembly, h, options, warnings)
        scene = assembly.scene
        model, self._impedance = self.model, options["impedance"]
        self._adapted = options["friction_damping"] == "adapted"
        self._damped = not options["time_constant"]  # otherwise the damping is MuJoCo's own
        self._reference_ratio = partial(slip_reference, options["slip_reference"], self._impedance)
        # views of the model's memory: single numbers are written faster than to an array
        self._bounds = model.pair_friction.reshape(-1).data
        self._references = model.pair_solreffriction.reshape(-1).data
        # Of each frictional guide: its pairs of geoms, the places of its surfaces' measured forces,
        # its direction, and the mass that moves along it.
        self._guides = []
        for name, guide in scene.frictional_guides.items():
            surfaces = [model.geom(surface(name, side)).id for side in SIDES]
            pairs = np.flatnonzero(
                np.isin(model.pair_geom1, surfaces) | np.isin(model.pair_geom2, surfaces)
            ).tolist()
            places = [int(model.sensor(surface(name, side)).adr[0]) for side in SIDES]
            self._guides.append((pairs, places, *direction_of(guide), self._mass_along(guide)))
        velocities = [
            scene.bodies[guide.slider].velocity for guide in scene.frictional_guides.values()
        ]
        self._slip = [
            ux * vx + uy * vy for (_, _, ux, uy, _), (vx, vy) in zip(self._guides, velocities)
        ]
        # Deceleration of slip (m/s^2) that the damping of friction is to produce. With none at the
        # start, slip is not damped in the first step.
        self._wanted = [0.0] * len(self._guides)

    def _mass_along(self, guide: Translational) -> float:
        """Return the mass (kg) that a force along the guide accelerates at the start: 1/(J M^-1 J^T).

        It is that of the slider and of all that hangs on it.
        """
        import mujoco

        model, data = self.model, self.data
        mujoco.mj_fwdPosition(model, data)
        mass, jacobian = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_fullM(model, data, mass)
        mujoco.mj_jacBodyCom(model, data, jacobian, None, model.body(guide.slider).id)
        push = np.array([*direction_of(guide), 0.0]) @ jacobian
        return float(1.0 / (push @ np.linalg.solve(mass, push)))

    def rub(self, coefficients: Sequence[float]) -> None:
        bounds, references, h = self._bounds, self._references, self.h
        self._coefficients = coefficients
        for i, (pairs, *_) in enumerate(self._guides):
            # The least damping that opposes slip, for the reason in `stiction.engines.mujoco.contact`.
            # MuJoCo's direct format of a reference has a minus sign.
            damping = -self._impedance * (
                slip_damping(self._wanted[i], self._slip[i], h) if self._adapted else 1.0 / h
            )
            for pair in pairs:
                # Of the five coefficients of a pair, the two of tangential directions; those of
                # rotations are zero.
                bounds[5 * pair] = bounds[5 * pair + 1] = coefficients[i]
                if self._damped:
                    references[2 * pair + 1] = damping

    def contact_forces(self) -> tuple[list[float], list[float]]:
        # A sensor for each surface has the resultant force of its contacts. `_along` keeps the
        # friction with its sign, for the next damping.
        measured = self.data.sensordata.tolist()
        normals: list[float] = []
        frictions: list[float] = []
        self._along: list[float] = []
        for _, (lower, upper), ux, uy, _ in self._guides:
            (ax, ay), (bx, by) = measured[lower : lower + 2], measured[upper : upper + 2]
            normals.append(abs(ux * ay - uy * ax) + abs(ux * by - uy * bx))
            frictions.append(abs(ux * ax + uy * ay) + abs(ux * bx + uy * by))
            self._along.append(ux * (ax + bx) + uy * (ay + by))
        return normals, frictions

    def advance(self, caps: Sequence[float]) -> None:
        super().advance(caps)
        guides, before = self.friction.guides, self._slip
        bounds, self._slip = guides["cap"].tolist(), guides["slip_speed"].tolist()
        # The deceleration that the damping of the next step is to produce: `slip_reference` times
        # what friction can do by its bound, or has just done.
        for i, (*_, mass) in enumerate(self._guides):
            sense = copysign(1.0, self._slip[i])
            bound = bounds[i] / mass
            gained = sense * (self._slip[i] - before[i]) / self.h
            # What a load adds to the slip needs no damping to be opposed: by itself it recruits as
            # much normal force as a reference of its size does.
            driven = max(gained - sense * self._along[i] / mass, 0.0)
            ratio = self._reference_ratio(self._coefficients[i])
            self._wanted[i] = max(ratio * max(bound, -gained) - driven, 0.0)
