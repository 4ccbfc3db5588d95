"""Siconos behind the engine protocol: its declaration, how it is installed, and bounds of its settings."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.program.engine import ProgramEngine
from stiction.engines.registry import EngineBroken, EngineMissing
from stiction.engines.shared.fixed_step import settings_of
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

DECLARATION = Path(__file__).with_name("siconos.toml")
SYSTEM_PYTHON, PYTHON_VARIABLE = "/usr/bin/python3", "STICTION_SICONOS_PYTHON"
"""The Python of the declaration, and the environment variable that names another one that has Siconos."""
BRINGS = "apt-get install python3-siconos brings it (Debian)"
BLOCKS = ("nsgs", "cpg", "lemke", "enum")
BOUNDS = {
    "theta": (0.5, 1.0),
    "clearance": (1e-12, 1.0),
    "restitution": (0.0, 1.0),
    "tolerance": (1e-14, 1e-3),
    "iterations": (1, 10**9),
}
"""Smallest and largest value of each setting that is a number, of its type."""


class SiconosEngine(ProgramEngine):
    """The kernel of Siconos (Moreau-Jean scheme, unilateral contacts with friction), run by the system's Python.

    The program is `solver.py` next to this module; its declaration ``siconos.toml`` contains the settings: `theta` of
    MoreauJeanOSI; `clearance`, relative to the size of the mechanism, and `restitution`, as for
    `stiction.engines.reference.moreau.MoreauEngine`; `tolerance` of a step, relative to its largest speed; `iterations`
    of Gauss-Seidel; `block`, the solver of one contact within an iteration: nsgs, cpg, lemke or enum.
    """

    name, reactions = "siconos", "engine"

    def __init__(self) -> None:
        try:
            super().__init__(DECLARATION)
        except EngineBroken as error:
            # A Python without Siconos, or without NumPy, ends with the traceback of the import, of
            # which `EngineBroken` quotes the lines. The last line is the cause.
            last = str(error).partition("; expected a line")[0].rpartition(" | ")[2].strip()
            if last.startswith("ModuleNotFoundError"):
                raise EngineMissing(
                    f"{self.name}: {_python()} does not have it; {BRINGS}"
                ) from error
            raise EngineBroken(
                f"{self.name}: {_python()} cannot run it: {last}; {BRINGS}"
            ) from error
        except EngineMissing as error:
            raise EngineMissing(f"{self.name}: found no program {_python()}; {BRINGS}") from error

    def _found(self, word: str) -> Path:
        """Return the Python that has Siconos: the declaration's, or that of the environment variable."""
        return super()._found(_python() if word == SYSTEM_PYTHON else word)

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
        # The declaration gives the types of settings; their bounds are checked here, before the
        # program starts. The start is checked too, as the program would correct it silently.
        settings_of(
            settings,
            {"block": BLOCKS, **{name: least for name, (least, _) in BOUNDS.items()}},
            self.name,
            fidelity,
        )
        for name, value in settings.items():
            if name in BOUNDS and not BOUNDS[name][0] <= value <= BOUNDS[name][1]:
                raise InputError(
                    f"{name}: found {value!r}; expected {BOUNDS[name][0]:g} .. {BOUNDS[name][1]:g}"
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
    return os.environ.get(PYTHON_VARIABLE, SYSTEM_PYTHON)
