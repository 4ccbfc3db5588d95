"""MuJoCo: joint coordinates, soft constraints solved as a convex problem, semi-implicit Euler.

Joint fidelity. The scene is written as MJCF (`stiction.engines.mujoco.mjcf`): the tree of links of `stiction.engines.shared.link_tree`, joints that close
loops as `connect` constraints. Drives: a rotor of huge inertia in the joint and, each step, the force that ends the step on the law; which
joints can be driven is said in `stiction.engines.shared.joint_coordinates`. Friction: `frictionloss` of the joint at the bound of `stiction.engines.shared.friction_cap`,
with a reference that brings the slider to rest within a step. It is soft: of the force that would hold a slider the share
`impedance` is applied, and a sticking slider would creep; MuJoCo's `noslip` sweeps find the frictions once more without that. Springs, dampers, forces and torques are evaluated by the adapter and applied to the bodies.

There is no contact fidelity: MuJoCo's contacts are springs between bodies that must have clearance, and a slider between two surfaces
is pumped by them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stiction.engines.mujoco.mjcf import ROTOR, START, joint_name, mjcf
from stiction.engines.protocol import Refused, accepted
from stiction.engines.shared.fixed_step import settings_of
from stiction.engines.shared.joint_coordinates import TreeAccelerations, TreeStepper, driven_link, tree_refusal
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import InputError, Scene
from stiction.scenes.laws import evaluate_law

DEEPEST = 495
"""Links in a chain: elements may be nested 500 deep (XML_ELEMENT_DEPTH_EXCEEDED)."""
_SETTINGS = {"iterations": 20, "passes": 2, "impedance": 0.9999, "solver": ("PGS", "Newton", "CG"), "noslip": ("on", "off"),
             "integrator": ("Euler", "implicitfast", "discrete", "RK4")}
_SETTLING = 16
"""Steps in which the joints that close loops settle at the position error they keep."""


class MujocoEngine(TreeEngine):
    """Adapter of MuJoCo; see the module for what becomes of each element.

    Settings: `iterations` of the solver a step, `passes` at a step where stick is undecided, `impedance` of friction and
    loops (share of the force that would hold them, at most 0.9999), `solver` (PGS, Newton, CG), `noslip` (on, off: whether
    frictions are then solved for as if they were hard), `integrator` (Euler, implicitfast, discrete, RK4; bounds and loads stay what they are over a step).
    """

    name, called = "mujoco", "MuJoCo"
    defaults = {"joint": _SETTINGS}

    @property
    def version(self) -> str:
        import mujoco

        return accepted("mujoco-core", mujoco.__version__)

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        depth: dict[int, int] = {}
        for i, link in enumerate(tree.links):
            depth[i] = depth.get(link.parent, 0) + 1
        if (deepest := max(depth.values(), default=0)) > DEEPEST:
            return f"{deepest} links hang on each other; MuJoCo's reader of XML takes {DEEPEST}, which are nested"
        return None

    @contextlib.contextmanager
    def stepper(self, scene: Scene, h: float, options: Mapping[str, Any], fidelity: str) -> Iterator[TreeStepper]:
        if not 0 < options["impedance"] <= _SETTINGS["impedance"]:
            raise InputError(f"impedance: found {options['impedance']!r}; expected 0 < impedance <= {_SETTINGS['impedance']}, MuJoCo's own limit")
        with _warnings() as said:
            yield _Stepper(scene, h, options, said)

    def accelerations(self, scene: Scene) -> TreeAccelerations:
        return _Accelerations(scene)


@contextlib.contextmanager
def _warnings() -> Iterator[list[str]]:
    """What MuJoCo warns of, which it otherwise writes to the error stream and to a file in the working directory."""
    import mujoco

    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield said
    finally:
        mujoco.set_mju_user_warning(before)


def scene_as_mjcf(scene: Scene, timestep: float, **options: Any) -> str:
    """The MJCF of a scene, with the defaults of `MujocoEngine` where no other settings are given.

    Raises
    ------
    Refused
        If a tree of links with motors cannot represent the scene.
    """
    options = settings_of(options, _SETTINGS, MujocoEngine.name, "joint")
    tree = LinkTree(scene)
    if reason := tree_refusal(scene, tree, MujocoEngine.called):
        raise Refused(reason)
    driven = {link: sign * evaluate_law(drive.law, 0.0)[1] for drive in scene.drives.values() for link, sign in [driven_link(scene, tree, drive)]}
    return mjcf(scene, tree, driven, timestep=timestep, noslip=options["noslip"] == "on",
                **{name: options[name] for name in ("iterations", "impedance", "solver", "integrator")})


def _model(scene: Scene, tree: LinkTree, timestep: float, **options: Any) -> tuple[Any, Any]:
    """MuJoCo's model and data at the scene's start; joint coordinates in the order of the tree's links."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(scene_as_mjcf(scene, timestep, **options))
    found, expected = [model.joint(i).name for i in range(model.njnt)], [joint_name(tree, i) for i in range(len(tree.links))]
    if found != expected:
        raise RuntimeError(f"MuJoCo numbers the joints {found}; expected {expected}")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
    return model, data


class _Stepper(TreeStepper):
    """A scene as MuJoCo model."""

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any], warnings: Sequence[str]):
        import mujoco

        tree = LinkTree(scene)
        super().__init__(scene, h, tree, options["passes"])
        self._advance_engine, self._warnings = mujoco.mj_step, warnings
        self._model, self._data = model, data = _model(scene, tree, h, **options)
        self._loss, self._drive_force = model.dof_frictionloss, data.qfrc_applied
        self.joints_are(data.qpos, data.qvel)
        # force x, force y, torque z of each body among the six numbers that MuJoCo has of each
        self._pushed, self._places = data.xfrc_applied.reshape(-1), np.array([6 * model.body(name).id + k for name in scene.bodies for k in (0, 1, 5)])
        self._rates: dict[int, float] = {}
        self.add_drives(scene)
        if tree.loops:
            self.settling = _SETTLING
        self._by_link = sorted(range(len(self.friction_links)), key=self.friction_links.__getitem__)

    def drive_rate(self, link: int, rate: float) -> None:
        self._rates[link] = rate

    def retreat(self) -> None:
        self.position[:], self.velocity[:] = self.start

    def advance(self, caps: Sequence[float]) -> None:
        for link, cap in zip(self.friction_links, caps):
            self._loss[link] = cap
        for link, rate in self._rates.items():
            self._drive_force[link] = ROTOR * (rate - self.velocity[link]) / self.h
        if self.loaded:
            self._pushed[self._places] = self.loads
        self.clock.call(self._advance_engine, self._model, self._data)
        if self._warnings:
            raise FloatingPointError(self._warnings[0])
        row, force = self._data.ne, self._data.efc_force  # rows of friction stand behind those of loops, by joint; none where the bound is 0
        for i in self._by_link:
            self.held[i] = abs(force[row]) if caps[i] > 0.0 else 0.0
            row += caps[i] > 0.0


class _Accelerations(TreeAccelerations):
    """MuJoCo's mass matrix and bias forces."""

    def __init__(self, scene: Scene):
        import mujoco

        tree = LinkTree(scene)
        super().__init__(scene, tree)
        self._mujoco = mujoco
        self._model, self._data = _model(scene, tree, 1.0)
        self._model.dof_armature[:] = 0.0  # rotors are for stepping
        self._mass = np.zeros((self._model.nv, self._model.nv))

    def dynamics(self, position: np.ndarray, velocity: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._data.qpos[:], self._data.qvel[:] = position, velocity
        self.clock.call(self._compute)
        return self._mass, self._mass @ second + self._data.qfrc_bias

    def _compute(self) -> None:
        """Mass matrix and bias forces, by the engine."""
        self._mujoco.mj_fwdPosition(self._model, self._data)
        self._mujoco.mj_fwdVelocity(self._model, self._data)
        self._mujoco.mj_fullM(self._model, self._data, self._mass)
