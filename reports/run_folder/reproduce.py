"""Means to make the numbers of a run again: packages, code, scenes, the commands of campaign and runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from stiction.comparisons.bench.environment import requirements
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import (
    Record,
    has_static_coefficient,
    job,
    run_command,
    run_key,
)
from stiction.scenes import Scene, catalogue, load_scene, scene_to_toml
from stiction.scenes.wording import as_given
from stiction.truths.physics import physics_of

FOLDER = "reproduce"
OPTIONS = ("t_end", "dt", "rtol", "output_step", "fidelity")
"""Options of `stiction run`; all other arguments of a run are settings of the engine."""
_STEPS = """\
# Make these numbers again

With Python {python}, in the sources of stiction {stiction} {commit}, where RUN is the folder that this one lies in:

    python -m venv .venv
    .venv/bin/pip install -r RUN/reproduce/requirements.txt
    .venv/bin/pip install --no-deps -e .
    .venv/bin/{command} --out again

- `requirements.txt` has the versions of the packages of the suite and of its extras, as far as they were installed.
  Engines of others are not in it: `engines` in `provenance.json` has the versions of all engines that took part.
- `source` in `provenance.json` is the SHA-256 of the code that the numbers come from{dirty}. If the new folder has the
  same, it was the same code. Here it is `{digest}`.
- The command runs on the processes of one machine: give it the `--executor` that the run had, if it was another.
- `scenes/` has the scenes of the catalogue that were simulated, each complete in its file; with later versions, too,
  `stiction run RUN/reproduce/scenes/NAME.toml` runs one. An engine without a static coefficient had mus = mu. Hard
  cases have changes to the catalogue's scenes, and scenes of their own: `comparisons/hard/` in the sources has them.
- In the folder of `validate`, a row of a table in `data/` whose trajectory is not stored has the command for its run
  alone, in `rerun_command`.
- The machine: {machine}.

With these packages on a processor of this kind, motions, events and counters are the same as here. Another processor
or another version rounds in other ways: what depends on rounding differs in the last digits. Times depend on the
machine and on what else it did; their intervals say how far they can be trusted.
"""


def write_reproduce(results: Results, origin: Mapping[str, Any], folder: Path) -> None:
    """Write ``reproduce/`` of a run folder: ``README.md``, ``requirements.txt``, and the catalogue's scenes."""
    place = folder / FOLDER
    place.mkdir()
    for name in scene_names(results):
        file = place / "scenes" / f"{name}.toml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(scene_to_toml(load_scene(name)), encoding="utf-8")
    (place / "requirements.txt").write_text(
        "".join(f"{line}\n" for line in requirements()), encoding="utf-8"
    )
    commit, versions = origin["commit"], origin["versions"]
    (place / "README.md").write_text(
        _STEPS.format(
            command=origin["command"],
            digest=origin["source"],
            python=versions["python"],
            stiction=versions["stiction"],
            commit=f"(`git checkout {commit['hash']}`)"
            if commit
            else "(not run in a checkout: no commit is known)",
            dirty=", which had changes that the commit does not have"
            if commit and commit["dirty"]
            else "",
            machine="; ".join(f"{name} {value}" for name, value in origin["machine"].items()),
        ),
        encoding="utf-8",
    )


def scene_names(results: Results) -> list[str]:
    """Return the scenes of the catalogue that any run or row is of, sorted."""
    rows = [table["scene"] for table in results.tables.values() if "scene" in table]
    named = {record.scene for record in results.records}.union(*rows)
    return sorted({*catalogue(), *catalogue("hard")} & named)


def command(results: Results) -> str:
    """Return the command that makes the campaign, for a shell."""
    depth, engines, workers = (
        results.settings.get(name) for name in ("depth", "engines", "workers")
    )
    engines = [
        name for name in engines or () if name != "reference"
    ] or engines  # it takes part in any case
    words = ["stiction", "validate", *([f"--{depth}"] if depth in ("quick", "full") else [])]
    words += ["--engines", ",".join(engines)] if engines else []
    return shlex.join(words + (["--workers", str(workers)] if workers else []))


def again(record: Record) -> str | None:
    """Return the command for a run; None if its scene is not in the catalogue.

    A change of a scene by an effect is made again with all others.
    """
    if record.scene not in catalogue():
        return None
    declared = _declared(record.scene)
    if record.key != run_key(declared, record.variant, record.step):
        return shlex.join(
            ["stiction", "compare", "effects", record.scene, "--engines", record.variant.engine]
        )
    scene = physics_of(declared, has_static_coefficient(record.variant))
    options = [
        (name.replace("_", "-"), str(value))
        if name in OPTIONS
        else ("setting", f"{name}={as_given(value)}")
        for name, value in job(scene, record.variant, record.step).arguments.items()
    ]
    options += [
        ("set", f"{name}.{key}={getattr(scene.joints[name], key)!r}")
        for name, joint in declared.joints.items()
        for key in ("mus", "static_friction")
        if getattr(joint, key, None) != getattr(scene.joints[name], key, None)
    ]
    return run_command(record.scene, record.variant.engine, options)


@cache
def _declared(name: str) -> Scene:
    """Read a scene of the catalogue once: each has dozens of runs, and reading it takes 5 ms."""
    return load_scene(name)
