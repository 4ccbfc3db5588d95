"""Base class of the adapters of engines in joint coordinates: refusals, settings and methods."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, ClassVar

from stiction.engines.assembly import Assembly, assembly_of
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
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Translational


class TreeEngine(SteppedEngine):
    """An engine that steps the joints of a tree of links, and whose accelerations can be integrated.

    With ``method="accelerations"``, at joint fidelity and for mechanisms without loops, the engine computes only the
    mass matrix and the bias forces; `stiction.engines.shared.acceleration_integrator` integrates the motion to `rtol`
    with located events. This method has no other settings and no `dt`.

    Attributes
    ----------
    called : str
        The engine's name in messages.
    """

    capabilities = replace(SteppedEngine.capabilities, event_location=Supplier.ADAPTER)
    called: ClassVar[str]

    def check_arguments(self, *, settings: Mapping[str, Any], **asked: Any) -> None:
        # The arguments of a method are its own, and are checked when it runs.
        if "method" not in settings:
            super().check_arguments(settings=settings, **asked)

    def settings_of_run(self, given: Mapping[str, Any], **asked: Any) -> dict[str, Any]:
        # The defaults belong to steps. A method has no other settings.
        if "method" in given:
            return dict(given)
        return super().settings_of_run(given, **asked)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == METHOD

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if fidelity == Fidelity.CONTACT:
            reason = contact_refusal(scene)
            if reason:
                return reason
        # A loop is closed by a constraint between two points, so that a translational joint has to be
        # in the tree.
        tree = LinkTree(scene, fidelity)
        for name in tree.loops:
            if isinstance(scene.joints[name], Translational):
                return f"joints.{name}: closes a loop; the {self.called} adapter closes loops by revolute joints only"
        # Each drive needs a joint coordinate of its own.
        drive_of_link: dict[int, str] = {}
        for name, drive in scene.drives.items():
            try:
                link, _ = motor_link(scene, tree, drive)
            except Refused as error:
                return f"drives.{name}: the {self.called} adapter {error}"
            if link in drive_of_link:
                return f"drives.{name}: drives the same joint as drives.{drive_of_link[link]}"
            drive_of_link[link] = name
        return self.refusal_of_tree(scene, tree)

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        """Return why this engine cannot represent a tree of links that other engines can; None if it can."""
        return None

    @abstractmethod
    def dynamics(
        self, scene: Scene, tree: LinkTree, clock: EngineClock
    ) -> AbstractContextManager[Dynamics]:
        """Return a context whose value is the engine's `Dynamics` of a tree; the clock times its calls."""

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
        begin = time.process_time()
        tolerance = DEFAULT_TOLERANCE if rtol is None else rtol
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
                setup_s=time.process_time() - begin,
            )
