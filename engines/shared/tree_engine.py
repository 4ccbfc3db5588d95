"""Common parts of adapters of engines in joint coordinates: their refusals, settings and methods."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, ClassVar

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.joint_effects import effects_of
from stiction.engines.protocol import Refused, Supplier
from stiction.engines.shared.acceleration_integrator import (
    DEFAULT_TOLERANCE,
    METHOD,
    Dynamics,
    TreeAccelerations,
    integrate,
)
from stiction.engines.shared.contact_geometry import contact_refusal
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import SteppedEngine
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.engines.shared.joint_coordinates import motor_refusal
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Translational


class TreeEngine(SteppedEngine):
    """An engine that steps the joints of a tree of links, and whose accelerations can be integrated.

    ``method="accelerations"``, joint fidelity, mechanisms without loops: mass matrix and bias forces are the engine's;
    the integration to `rtol` with located events is ours (`stiction.engines.shared.acceleration_integrator`). This
    method has no other settings and no `dt`.

    Attributes
    ----------
    called : str
        The engine's name in sentences.
    """

    capabilities = replace(SteppedEngine.capabilities, event_location=Supplier.ADAPTER)
    called: ClassVar[str]

    def check_arguments(self, *, settings: Mapping[str, Any], **asked: Any) -> None:
        # The arguments of a method are its own, and are checked when it runs.
        if "method" not in settings:
            super().check_arguments(settings=settings, **asked)

    def settings_of_run(self, given: Mapping[str, Any], **asked: Any) -> dict[str, Any]:
        # The defaults are those of steps, and not of any method.
        if "method" in given:
            return dict(given)
        return super().settings_of_run(given, **asked)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == METHOD

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if fidelity == Fidelity.CONTACT and (reason := contact_refusal(scene)):
            return reason
        # A loop is closed by a constraint between two points, so a translational joint has to be in
        # the tree.
        tree = LinkTree(scene, fidelity)
        for name in tree.loops:
            joint = scene.joints[name]
            if isinstance(joint, Translational):
                return f"joints.{name}: closes a loop; the {self.called} adapter closes loops by revolute joints only"
            if joint.frictional:
                return (
                    f"joints.{name}: closes a loop and has friction; {self.called} has friction in coordinates of "
                    "joints, of which a joint that closes a loop has none"
                )
        return motor_refusal(scene, tree, self.called) or self.refusal_of_tree(scene, tree)

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        """Return why this engine cannot represent a tree of links that others can; None if it can."""
        return None

    @abstractmethod
    def dynamics(
        self, scene: Scene, tree: LinkTree, clock: EngineClock
    ) -> AbstractContextManager[Dynamics]:
        """Return a context whose value are the engine's dynamics of a tree; the engine is called by the clock."""

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
        if settings.get("method") != METHOD:
            return super().run(
                scene,
                t_end=t_end,
                dt=dt,
                rtol=rtol,
                fidelity=fidelity,
                output_step=output_step,
                settings=settings,
                assembly=assembly,
            )
        if dt is not None or fidelity != Fidelity.JOINT or len(settings) > 1:
            raise InputError(
                f"method={METHOD}: found dt, contact fidelity or other settings; expected rtol alone"
            )
        effects = [name for name, joint in scene.joints.items() if effects_of(joint)]
        if effects:
            raise Refused(
                f"joints.{effects[0]}: method={METHOD} takes neither constant bounds of friction nor damping in "
                "joints; expected steps (dt)"
            )
        start, tolerance = time.process_time(), DEFAULT_TOLERANCE if rtol is None else rtol
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
        accelerations = TreeAccelerations(assembly.whole)
        with self.dynamics(
            scene, accelerations.tree, accelerations.clock
        ) as accelerations.dynamics:
            return integrate(
                accelerations,
                assembly.whole,
                self,
                t_end=t_end,
                rtol=tolerance,
                output_step=output_step,
                setup_s=time.process_time() - start,
            )
