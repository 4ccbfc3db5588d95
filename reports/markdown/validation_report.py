"""The report of a validation: a run folder with `report.md` in it."""

from __future__ import annotations

import json
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.measures.scene_truth import OWN_RUN
from stiction.comparisons.methods import stored_keys
from stiction.comparisons.presentation.cells import MISSING, NULL
from stiction.comparisons.presentation.charts import MechanismPicture
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, NO_TRUTH, PROVEN, PUBLISHED
from stiction.reports.figures.charts import drawn
from stiction.reports.figures.style import Drawing, rc, save_all
from stiction.reports.markdown.losses import grouped, losses
from stiction.reports.markdown.study_section import figure, study_section
from stiction.reports.markdown.tables import fitted, markdown
from stiction.reports.page_one import page_one
from stiction.reports.presentations import presentations
from stiction.reports.run_folder.data import data_tables, write_data
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.provenance import provenance
from stiction.reports.run_folder.reproduce import FOLDER, write_reproduce
from stiction.reports.run_folder.settings import words

REPORT, FAILURES = "report.md", "failures.md"

BEST_FIRST = (PROVEN, CLOSED_FORM, HIGH_PRECISION, PUBLISHED, OWN_RUN)
TERMS = f"""\
- **Method**: an engine with its settings; "+ .. (adapter)" names what our adapter adds. **Refinement series**: its runs at several steps or tolerances.
- **Truth**: a separate solution of the reduced equations, with its uncertainty. Tiers, best first: {", ".join(BEST_FIRST)}.
- **mu, mus**: kinetic and static coefficient of friction. An engine with one coefficient is compared with the truth for mus = mu.
- **Joint / contact**: an ideal guide with a friction law on it / a slider that touches two surfaces with clearance. Compare within one.
- `< u`: the number is not larger than its uncertainty u. {MISSING}: not applicable. {NULL.partition(" ")[0]}: lost in the source.
- Numbers are rounded here; `data/*.csv` and `data/*.parquet` have all digits, and `stiction trace RUN KEY` the origin of each."""


def write_report(results: Results, folder: str | Path) -> Path:
    """Write the run folder of a validation.

    ``report.md``, page one first; ``failures.md``; ``data/`` (see `stiction.reports.run_folder.data`); ``figures/*.png``, ``*.pdf`` and ``*.svg``;
    ``reproduce/`` (see `stiction.reports.run_folder.reproduce`); ``provenance.json``. The folder appears complete or not at all. A
    previous report is replaced if nothing was added to it; anything else is refused.

    Returns
    -------
    Path
        Of ``report.md``.

    Raises
    ------
    FolderRefused
        If writing would lose something; `check_folder` tells beforehand.
    """
    said = presentations(results)
    with run_folder(folder, REPORT) as partial:
        place = partial / "figures"
        place.mkdir()
        with rc():
            drawings = list(drawn([each for presentation in said.values() for each in presentation.figures], results))
        save_all(drawings, place)
        stored = stored_keys(results)
        write_data(results, partial, stored)
        origin = provenance(results)
        for name, text in pages(results, said, stored, origin, drawings).items():
            (partial / name).write_text(text, encoding="utf-8")
        write_reproduce(results, origin, partial)
        files = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        text = json.dumps({**origin, "files": [*files, PROVENANCE]}, indent=2, ensure_ascii=False)
        (partial / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    return Path(folder) / REPORT


def pages(results: Results, said: Mapping[Study, Presentation], stored: Container[str], origin: Mapping[str, Any],
          drawings: Sequence[Drawing]) -> dict[str, str]:
    """The texts by name of the file: the report, and what it links to."""
    lost = losses(results)
    return {REPORT: compose(results, said, stored, origin, drawings),
            **({FAILURES: "# Failed runs\n\n" + markdown(lost) + "\n"} if len(lost) else {})}


def compose(results: Results, said: Mapping[Study, Presentation], stored: Container[str], origin: Mapping[str, Any],
            drawings: Sequence[Drawing]) -> str:
    """The text of ``report.md``."""
    by_name = {drawing.name: drawing for drawing in drawings}
    pictures = [each.name for presentation in said.values() for each in presentation.figures if isinstance(each, MechanismPicture)]
    parameters = data_tables(results, stored)["parameters"]
    parts = [page_one(results, said, figure(by_name[pictures[0]]) if pictures else "", _when(origin)), "## Terms", TERMS]
    parts += [study_section(study, replace(presentation, figures=tuple(each for each in presentation.figures if each.name not in pictures[:1])), by_name)
              for study, presentation in said.items()]
    parts += [*_failed(results), "## Parameters of the scenes", fitted(parameters), "Choices that the paper leaves open:",
              "\n".join(f"- {name}: {text}" for name, text in origin["choices"].items()),
              "## Truths", *_truths(results.table("accuracy")), "## Provenance", _provenance(origin)]
    return "\n\n".join(parts) + "\n"


def _failed(results: Results) -> list[str]:
    """Failed runs by method and reason; nothing where all succeeded."""
    lost = losses(results)
    if lost.empty:
        return []
    shown = grouped(lost)[["variant", "status", "runs", "reason"]].rename(columns={"variant": "method"})
    return ["## What failed?", f"{len(lost)} runs failed or ended early; all are in [{FAILURES}]({FAILURES}).", fitted(shown)]


def _truths(accuracy: pd.DataFrame) -> list[str]:
    """The truths that runs were compared with, the best tier first, and how well they are known."""
    unsure = {"position uncertainty [m]": "position [m]", "velocity uncertainty [m/s]": "velocity [m/s]", "event time uncertainty [s]": "events [s]"}
    there = [name for name in unsure if name in accuracy]
    if not there:
        return []
    found = accuracy[accuracy["truth tier"] != NO_TRUTH].groupby(["truth", "truth tier"], sort=False)[there].max().reset_index()
    found = found.sort_values("truth tier", key=lambda tiers: tiers.map(BEST_FIRST.index), kind="stable")
    told = found[there].map(lambda value: MISSING if pd.isna(value) else f"± {value:.1e}")
    return [fitted(found[["truth", "truth tier"]].join(told).rename(columns=unsure | {"truth tier": "tier"}))]


def _when(origin: Mapping[str, Any]) -> str:
    engines = ", ".join(f"{name} {version}" for name, version in origin["engines"].items())
    return f"Run of {origin['date'][:16].replace('T', ' ')} UTC with stiction {origin['versions']['stiction']}" + (f", {engines}." if engines else ".")


def _provenance(origin: Mapping[str, Any]) -> str:
    """All that the folder's provenance has, a line each."""
    commit = origin["commit"]
    changes = " with uncommitted changes" if commit and commit["dirty"] else ""
    parts = {"date": origin["date"], "commit": commit["hash"] + changes if commit else "not in a checkout",
             "source": f"SHA-256 {origin['source']}", "command": f"`{origin['command']}`; [how to make these numbers again]({FOLDER}/README.md)",
             **{name: ", ".join(f"{key} {words(entry)}" for key, entry in origin[name].items()) for name in ("versions", "machine", "campaign")}}
    return "\n".join(f"- {name}: {text}" for name, text in parts.items())
