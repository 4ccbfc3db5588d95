"""What the adapters of engines in joint coordinates have in common: which runs they make, and how."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar

from stiction.engines.protocol import Capabilities, Engine
from stiction.engines.shared.acceleration_integrator import METHOD, integrate
from stiction.engines.shared.fixed_step import run_steps, settings_of, step_of
from stiction.engines.shared.friction_cap import CAPPED
from stiction.engines.shared.joint_coordinates import TreeAccelerations, TreeStepper
from stiction.scenes import Scene, Trajectory


class TreeEngine(Engine):
    """An engine that steps the joints of a tree of links with capped friction, and whose accelerations can be integrated.

    ``method="accelerations"``, mechanisms without loops: mass matrix and bias forces are the engine's, the integration to `rtol` with located
    events is ours (`stiction.engines.shared.acceleration_integrator`). It has no other settings and no `dt`.

    Attributes
    ----------
    defaults : Mapping
        Settings of its own steps, as `settings_of` takes them.
    """

    capabilities = Capabilities(fidelities=("joint",), static_coefficient={"joint": True}, friction_law={"joint": CAPPED},
                                reactions="momentum balance", order="1")
    defaults: ClassVar[Mapping[str, Any]]

    def default_settings(self, fidelity: str) -> Mapping[str, Any]:
        return settings_of({}, self.defaults, self.name, fidelity)

    @abstractmethod
    def stepper(self, scene: Scene, h: float, options: Mapping[str, Any]) -> AbstractContextManager[TreeStepper]:
        """The engine's own steps of h seconds, for as long as they are taken; InputError for a setting out of its range."""

    @abstractmethod
    def accelerations(self, scene: Scene) -> TreeAccelerations:
        """Its mass matrix and bias forces."""

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        if settings.get("method") == METHOD:
            return integrate(lambda: self.accelerations(scene), scene, engine=self.name, version=self.version, t_end=t_end, dt=dt, rtol=rtol,
                             fidelity=fidelity, output_step=output_step, settings=settings)
        h = step_of(dt, rtol, self.name, t_end)
        options = settings_of(settings, self.defaults, self.name, fidelity)
        start = time.process_time()
        with self.stepper(scene, h, options) as stepper:
            return run_steps(stepper, scene, engine=self.name, version=self.version, fidelity=fidelity, t_end=t_end, dt=h,
                             output_step=output_step, setup_s=time.process_time() - start, reach=math.inf,
                             settings={**options, "friction_law": self.capabilities.friction_law[fidelity]})
