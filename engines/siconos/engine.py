"""Adapter of Siconos: its declaration, the Python that has it, and bounds of its settings."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.joint_effects import COMMON_EFFECTS, EFFECTS_OF_GAPS, LAWS
from stiction.engines.program.engine import ProgramEngine
from stiction.engines.protocol import Capabilities, Supplier
from stiction.engines.registry import EngineBroken, EngineMissing
from stiction.engines.shared.fixed_step import settings_of
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

DECLARATION = Path(__file__).with_name("siconos.toml")
SYSTEM_PYTHON = "/usr/bin/python3"
"""Python of the declaration."""
PYTHON_VARIABLE = "STICTION_SICONOS_PYTHON"
"""Environment variable with the path of another Python that has Siconos."""
INSTALLATION = "apt-get install python3-siconos brings it (Debian)"
"""How to install Siconos, for messages."""
BLOCKS = ("nsgs", "cpg", "lemke", "enum")
"""Values of the setting `block`, the default first."""
BOUNDS = {
    "theta": (0.5, 1.0),
    "clearance": (1e-12, 1.0),
    "tolerance": (1e-14, 1e-3),
    "iterations": (1, 10**9),
}
"""Smallest and largest value of each setting that is a number."""


class SiconosEngine(ProgramEngine):
    """The kernel of Siconos (Moreau-Jean scheme, unilateral contacts with friction), run by the system's Python.

    The program is `solver.py` next to this module; its declaration ``siconos.toml`` contains the settings: `theta` of
    MoreauJeanOSI; `clearance` of guides that declare none, relative to the size of the mechanism, as for
    `stiction.engines.reference.moreau.MoreauEngine`; `tolerance` of a step, relative to its largest speed; `iterations`
    of Gauss-Seidel; `block`, the solver of one contact within an iteration: nsgs, cpg, lemke or enum.
    """

    name = "siconos"
    reactions = "engine"

    def __init__(self) -> None:
        try:
            super().__init__(DECLARATION)
        except EngineBroken as error:
            # A Python without Siconos, or without NumPy, ends with the traceback of the import, whose
            # lines are quoted by `EngineBroken`. The last line is the cause.
            lines = str(error).partition("; expected a line")[0]
            cause = lines.rpartition(" | ")[2].strip()
            if cause.startswith("ModuleNotFoundError"):
                raise EngineMissing(
                    f"{self.name}: {_python()} does not have it; {INSTALLATION}"
                ) from error
            raise EngineBroken(
                f"{self.name}: {_python()} cannot run it: {cause}; {INSTALLATION}"
            ) from error
        except EngineMissing as error:
            raise EngineMissing(
                f"{self.name}: found no program {_python()}; {INSTALLATION}"
            ) from error

    @cached_property
    def capabilities(self) -> Capabilities:  # type: ignore[override]
        """Capabilities of the declaration, and effects of joints that it cannot declare: constant bounds, clearance."""
        fidelity = self.declared.fidelity
        return replace(
            super().capabilities,
            joint_effects={fidelity: (COMMON_EFFECTS - LAWS) | EFFECTS_OF_GAPS},
            constant_bound_by={fidelity: Supplier.ENGINE},
        )

    def _find_program(self, word: str) -> Path:
        """Return the Python that has Siconos: the declaration's, or that of the environment variable."""
        return super()._find_program(_python() if word == SYSTEM_PYTHON else word)

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
        # The declaration defines the types of settings; their bounds are checked here, before the
        # program starts. The start is checked too, as the program would correct it silently.
        lower_bounds = {name: smallest for name, (smallest, _) in BOUNDS.items()}
        settings_of(settings, {"block": BLOCKS, **lower_bounds}, self.name, fidelity)
        for name, (smallest, largest) in BOUNDS.items():
            if name in settings and not smallest <= settings[name] <= largest:
                raise InputError(
                    f"{name}: found {settings[name]!r}; expected {smallest:g} .. {largest:g}"
                )
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
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


def _python() -> str:
    """Return the path of the Python that runs Siconos."""
    return os.environ.get(PYTHON_VARIABLE, SYSTEM_PYTHON)
