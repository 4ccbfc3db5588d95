"""The command that makes a run again: for rows of tables whose trajectory is not stored."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from functools import cache
from typing import Any

from stiction.comparisons.variants import Record, has_static_coefficient, job, physics_of, run_key
from stiction.scenes import Scene, catalogue, load_scene
from stiction.scenes.wording import as_given

OPTIONS = ("t_end", "dt", "rtol", "output_step", "fidelity")
"""Of `stiction run`; what else a run is called with is a setting of the engine."""


def again(record: Record) -> str | None:
    """The command for a run; None if its scene is not in the catalogue. A change of a scene by an effect is made again with all others."""
    if record.scene not in catalogue():
        return None
    declared = _declared(record.scene)
    if record.key != run_key(declared, record.variant, record.step):
        return shlex.join(["stiction", "compare", "effects", record.scene, "--engines", record.variant.engine])
    scene = physics_of(declared, has_static_coefficient(record.variant))
    words = ["stiction", "run", record.scene, "--engine", record.variant.engine]
    for name, value in job(scene, record.variant, record.step).arguments.items():
        words += [f"--{name.replace('_', '-')}", str(value)] if name in OPTIONS else ["--setting", f"{name}={as_given(value)}"]
    return shlex.join(words + _overrides(declared, scene))


@cache
def _declared(name: str) -> Scene:
    """A scene of the catalogue: each has dozens of runs, and reading it takes 5 ms."""
    return load_scene(name)


def again_study(row: Mapping[str, Any]) -> str | None:
    """The command for a run of the study of drift, of a row of its table; None for one that did not come out."""
    if row.get("status", "ok") != "ok" or row["scene"] not in catalogue() or "time [s]" not in row:
        return None
    method = row["choice"].partition(" ")[0].lower()
    stabilization = [word for name in ("alpha", "beta") for word in ("--set", f"stabilization.{name}={row[f'{name} [1/s]']:g}")] if method == "baumgarte" else []
    return shlex.join(["stiction", "run", row["scene"], "--engine", "reference", "--t-end", f"{row['time [s]']:g}", "--dt", f"{row['step']:g}",
                       "--setting", f"stabilization={method}", *stabilization])


def _overrides(declared: Scene, scene: Scene) -> list[str]:
    """What makes the friction of a scene that of the physics which was simulated."""
    return [word for name, guide in declared.frictional_guides.items() if guide.mus != scene.guides[name].mus
            for word in ("--set", f"{name}.mus={scene.guides[name].mus!r}")]
