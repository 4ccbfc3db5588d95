"""What it takes to make the numbers of a run again, in the folder of the run: packages, code, scenes, command."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stiction.comparisons.results import Results
from stiction.comparisons.environment import requirements
from stiction.scenes import catalogue, load_scene, scene_to_toml

FOLDER = "reproduce"
_STEPS = """\
# Make these numbers again

With Python {python}, in the sources of stiction {stiction} {commit}, where RUN is the folder that this one lies in:

    python -m venv .venv
    .venv/bin/pip install -r RUN/reproduce/requirements.txt
    .venv/bin/pip install --no-deps -e .
    .venv/bin/{command} --out again

- `requirements.txt` has the versions of the packages of the suite and of its extras, as far as they were installed. Engines of others are
  not in it: `engines` in `provenance.json` has the versions of all engines that took part.
- `source` in `provenance.json` is the SHA-256 of the code that the numbers come from{dirty}. If the new folder has the same,
  it was the same code. Here it is `{digest}`.
- The command runs on the processes of one machine: give it the `--executor` that the run had, if it was another.
- `scenes/` has the scenes of the catalogue that were simulated, each complete in its file: `stiction run RUN/reproduce/scenes/NAME.toml`
  runs one with later versions too. An engine without a static coefficient had mus = mu. Hard cases have changes to the catalogue's
  scenes, and scenes of their own: `comparisons/hard/` in the sources has them.
- In the folder of `validate`, a row of a table in `data/` whose trajectory is not stored has the command for its run alone, in `run again`.
- The machine: {machine}.

With these packages on a processor of this kind, motions, events and counters come out as they are here. Another processor or
another version rounds in other ways: what depends on rounding differs in the last digits. Times depend on the machine and on
what else it did; their intervals say how far they can be trusted.
"""


def command(validation: Results) -> str:
    """The command that makes the campaign, for a shell."""
    settings = validation.settings
    depth, engines, workers = settings.get("depth"), settings.get("engines", ()), settings.get("workers")
    engines = [name for name in engines if name != "reference"] or engines  # it takes part beside others in any case
    return shlex.join(["stiction", "validate", *([f"--{depth}"] if depth in ("quick", "full") else []), *(["--engines", ",".join(engines)] if engines else []),
                       *(["--workers", str(workers)] if workers else [])])


def write_reproduce(validation: Results, origin: Mapping[str, Any], folder: Path) -> None:
    """Write ``reproduce/`` of a run folder: ``README.md``, ``requirements.txt``, and ``scenes/`` as `scene_names` lists them."""
    place = folder / FOLDER
    for name in scene_names(validation):
        file = place / "scenes" / f"{name}.toml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(scene_to_toml(load_scene(name)), encoding="utf-8")
    place.mkdir(exist_ok=True)
    (place / "requirements.txt").write_text("".join(f"{line}\n" for line in requirements()), encoding="utf-8")
    commit, versions = origin["commit"], origin["versions"]
    (place / "README.md").write_text(_STEPS.format(
        command=origin["command"], digest=origin["source"], python=versions["python"], stiction=versions["stiction"],
        commit=f"(`git checkout {commit['hash']}`)" if commit else "(the run was not made in a checkout: no commit is known)",
        dirty=", which had changes that the commit does not have" if commit and commit["dirty"] else "",
        machine="; ".join(f"{name} {value}" for name, value in origin["machine"].items())), encoding="utf-8")


def scene_names(validation: Results) -> list[str]:
    """Of the catalogue, those of all runs and rows, sorted."""
    known = {*catalogue(), *catalogue("hard")}
    named = {record.scene for record in validation.records}.union(*(table["scene"] for table in validation.tables.values() if "scene" in table))
    return sorted(known & named)
