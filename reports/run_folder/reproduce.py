"""Reproduction of a run: packages, code, scenes, and the commands of the campaign and of single runs."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from stiction.comparisons.bench.environment import requirements
from stiction.comparisons.bench.results import (
    COMMAND,
    PAPERS_CASES,
    Results,
    scene_of_suite,
)
from stiction.comparisons.bench.variants import (
    Record,
    has_static_coefficient,
    job,
    run_command,
    run_key,
)
from stiction.engines.registry import UnknownEngine
from stiction.scenes import Scene, load_scene
from stiction.scenes.wording import as_given
from stiction.truths.physics import physics_of

FOLDER = "reproduce"
"""Subfolder of a run folder."""
SCENES = f"{FOLDER}/scenes/"
"""Subfolder of a run folder with one file for each scene, with a slash at its end."""
OPTIONS = ("t_end", "dt", "rtol", "output_step", "fidelity")
"""Arguments of a run that are options of `stiction run`; all others are settings of the engine."""
_README = """\
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
- `scenes/` has the scenes that were simulated, each complete in its file; with later versions, too,
  `stiction run RUN/reproduce/scenes/NAME.toml` runs one. An engine without a static coefficient had mus = mu. Hard
  cases have changes to the catalogue's scenes, and scenes of their own: `comparisons/hard/` in the sources has them.
- In the folder of `validate`, a row of a table in `data/` about a single run has the command for this run alone, in
  `rerun_command`.
- The machine: {machine}.

With these packages on a processor of this kind, motions, events and counters are the same as here. Another processor
or another version rounds in other ways: what depends on rounding differs in the last digits. Times depend on the
machine and on what else it did; their intervals say how far they can be trusted.
"""


def write_reproduce(results: Results, origin: Mapping[str, Any], folder: Path) -> None:
    """Write the subfolder `FOLDER` of a run folder: ``README.md``, ``requirements.txt``, and the scenes.

    Parameters
    ----------
    origin : mapping
        The provenance of the run.
    folder : Path
        The run folder.
    """
    subfolder = folder / FOLDER
    subfolder.mkdir()
    for name, scene in scenes_of(results).items():
        file = folder / scene_file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(scene.to_toml(), encoding="utf-8")
    packages = "".join(f"{line}\n" for line in requirements())
    (subfolder / "requirements.txt").write_text(packages, encoding="utf-8")
    (subfolder / "README.md").write_text(_readme(origin), encoding="utf-8")


def _readme(origin: Mapping[str, Any]) -> str:
    """Return the steps that reproduce the run with this provenance."""
    commit = origin["commit"]
    checkout = "(not run in a checkout: no commit is known)"
    uncommitted_changes = ""
    if commit:
        checkout = f"(`git checkout {commit['hash']}`)"
        if commit["dirty"]:
            uncommitted_changes = ", which had changes that the commit does not have"
    return _README.format(
        command=origin["command"],
        digest=origin["source"],
        python=origin["versions"]["python"],
        stiction=origin["versions"]["stiction"],
        commit=checkout,
        dirty=uncommitted_changes,
        machine="; ".join(f"{name} {value}" for name, value in origin["machine"].items()),
    )


def scene_file(name: str) -> str:
    """Return the file of a scene, relative to the run folder."""
    return f"{SCENES}{name}.toml"


def scenes_of(results: Results) -> dict[str, Scene]:
    """Return the scenes of a run, and the scenes of the suite in rows of its tables, by name and sorted by it."""
    names = {*results.scenes, *(record.scene for record in results.records)}
    for table in results.tables.values():
        if "scene" in table:
            names.update(table["scene"].dropna())
    scenes = {}
    for name in sorted(names):
        scene = results.scene(name)
        # Some hard cases have scenes that are no files.
        if scene is not None:
            scenes[name] = scene
    return scenes


def read_scenes(folder: Path, files: Iterable[str]) -> dict[str, Scene]:
    """Return the scenes of a run folder by name.

    Parameters
    ----------
    folder : Path
        The run folder.
    files : iterable of str
        All of its files, relative to it.
    """
    scenes = {}
    for file in files:
        if file.startswith(SCENES):
            name = file.removeprefix(SCENES).removesuffix(".toml")
            scenes[name] = load_scene(folder / file)
    return scenes


def campaign_command(results: Results) -> str:
    """Return the command that repeats the campaign, or the single study, quoted for a shell."""
    if COMMAND in results.settings:
        return results.settings[COMMAND]
    words = ["stiction", "validate"]
    scenes = results.settings.get("scenes", PAPERS_CASES)
    if tuple(scenes) != PAPERS_CASES or not results.is_about_paper:
        words += ["--scenes", ",".join(f"RUN/{scene_file(name)}" for name in scenes)]
    depth = results.settings.get("depth")
    if depth in ("quick", "full"):
        words.append(f"--{depth}")
    engines = results.settings.get("engines")
    if engines:
        # The reference takes part in any case, and is named only if it was the only engine.
        others = [name for name in engines if name != "reference"]
        words += ["--engines", ",".join(others or engines)]
    workers = results.settings.get("workers")
    if workers:
        words += ["--workers", str(workers)]
    return shlex.join(words)


def rerun_command(record: Record, results: Results) -> str | None:
    """Return the command that repeats a run, or None if its scene or its engine is not known here.

    A scene that is not in the catalogue is given by its file in the run folder, in which the command
    is to be executed.

    A run with a scene that the study of effects has changed is repeated by the command of this study,
    with all its other runs.
    """
    declared = results.scene(record.scene)
    if declared is None:
        return None
    place = record.scene
    if declared != scene_of_suite(record.scene):
        place = scene_file(record.scene)
    if record.key != run_key(declared, record.variant, record.step):
        return shlex.join(
            ["stiction", "compare", "effects", place, "--engines", record.variant.engine]
        )
    # An engine without static friction was given a scene whose static values are the kinetic ones.
    try:
        has_static = has_static_coefficient(record.variant)
    except UnknownEngine:
        # The engine came from a package that is no longer installed, so that no command could find it.
        return None
    scene = physics_of(declared, has_static)
    options = []
    for name, value in job(scene, record.variant, record.step).arguments.items():
        if name in OPTIONS:
            options.append((name.replace("_", "-"), str(value)))
        else:
            options.append(("setting", f"{name}={as_given(value)}"))
    for name, joint in declared.joints.items():
        for key in ("mus", "static_friction"):
            value = getattr(scene.joints[name], key, None)
            if getattr(joint, key, None) != value:
                options.append(("set", f"{name}.{key}={value!r}"))
    return run_command(place, record.variant.engine, options)
