"""Common parts of adapters of engines in joint coordinates: which runs they make, and how."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar

from stiction.engines.protocol import FIDELITIES, Capabilities, Engine
from stiction.engines.shared.acceleration_integrator import METHOD, integrate, tolerance_of
from stiction.engines.shared.contact_geometry import contact_refusal
from stiction.engines.shared.fixed_step import Grid, run_steps, settings_of, step_of
from stiction.engines.shared.friction_cap import CAPPED, CONTACT
from stiction.engines.shared.joint_coordinates import TreeAccelerations, TreeStepper, tree_refusal
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene, Trajectory


def tree_of(scene: Scene, fidelity: str) -> LinkTree:
    """The scene's tree of links.

    At contact fidelity guides are no joints, and each slider is the root of a tree of its own: what a step leaves of J'
    v, J the Jacobian of the contacts at its start, would move a slider that hangs on a turning body along its surface,
    and off it.
    """
    if fidelity == "joint":
        return LinkTree(scene)
    return LinkTree(scene, frozenset(scene.guides), tuple(guide.slider for guide in scene.guides.values()))


class TreeEngine(Engine):
    """An engine that steps the joints of a tree of links, and whose accelerations can be integrated.

    ``method="accelerations"``, joint fidelity, mechanisms without loops: mass matrix and bias forces are the engine's,
    the integration to `rtol` with located events is ours (`stiction.engines.shared.acceleration_integrator`). It has no
    other settings and no `dt`.

    Attributes
    ----------
    called : str
        The engine's name in sentences.
    reach : float
        Metres from its point to which a guide's surfaces go at contact fidelity.
    defaults : Mapping
        By fidelity: settings of its own steps, as `settings_of` takes them.
    """

    capabilities = Capabilities(fidelities=FIDELITIES, static_coefficient={"joint": True, "contact": True},
                                friction_law={"joint": CAPPED, "contact": CONTACT}, reactions="momentum balance",
                                order="1", event_location="adapter")
    called: ClassVar[str]
    reach: ClassVar[float] = math.inf
    defaults: ClassVar[Mapping[str, Mapping[str, Any]]]

    def default_settings(self, fidelity: str) -> Mapping[str, Any]:
        return settings_of({}, self.defaults[fidelity], self.name, fidelity)

    def check_arguments(self, *, settings: Mapping[str, Any], **asked: Any) -> None:
        if "method" not in settings:  # each method has its own
            super().check_arguments(settings=settings, **asked)

    def locates_events(self, fidelity: str, settings: Mapping[str, Any]) -> bool:
        return settings.get("method") == METHOD

    def steps_by_impulses(self, fidelity: str, settings: Mapping[str, Any]) -> bool:
        return "method" not in settings  # its own steps

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        if fidelity == "contact" and (reason := contact_refusal(scene)):
            return reason
        tree = tree_of(scene, fidelity)
        return tree_refusal(scene, tree, self.called) or self.refusal_of_tree(scene, tree)

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        """Why this engine cannot represent a tree of links that others can; None if it can."""
        return None

    @abstractmethod
    def stepper(self, scene: Scene, tree: LinkTree, h: float, options: Mapping[str, Any],
                fidelity: str) -> AbstractContextManager[TreeStepper]:
        """The engine's own steps of h seconds, for as long as they are taken.

        InputError for a setting out of its range.
        """

    @abstractmethod
    def accelerations(self, scene: Scene, tree: LinkTree) -> AbstractContextManager[TreeAccelerations]:
        """Its mass matrix and bias forces, for as long as they are asked for."""

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        start = time.process_time()
        if settings.get("method") == METHOD:
            tolerance = tolerance_of(dt, rtol, fidelity, settings)
            with self.accelerations(scene, tree_of(scene, fidelity)) as accelerations:
                return integrate(accelerations, scene, engine=self.name, version=self.version, t_end=t_end,
                                 rtol=tolerance, output_step=output_step,
                                 setup_s=time.process_time() - start)
        h = step_of(dt, t_end)
        options = settings_of(settings, self.defaults[fidelity], self.name, fidelity)
        with self.stepper(scene, tree_of(scene, fidelity), h, options, fidelity) as stepper:
            return run_steps(self, stepper, scene, Grid.of(t_end, h, output_step), fidelity=fidelity, settings=options,
                             setup_s=time.process_time() - start,
                             reach=self.reach if fidelity == "contact" else math.inf)
