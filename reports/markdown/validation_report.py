"""The report of a validation: a run folder with `report.md` in it."""

from __future__ import annotations

import json
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.measures.scene_truth import OWN_RUN
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, NO_TRUTH, PROVEN, PUBLISHED
from stiction.reports.figures import Drawing, drawings, save_all
from stiction.comparisons.methods import stored_keys
from stiction.reports.figures.style import rc
from stiction.reports.markdown.hard_page import hard_page
from stiction.reports.markdown.losses import losses
from stiction.reports.markdown.page_one import page_one
from stiction.reports.markdown.sections import sections, variants_table
from stiction.comparisons.presentation.cells import MISSING, NULL
from stiction.reports.markdown.tables import all_rows, fitted, markdown
from stiction.reports.run_folder.data import data_tables, write_data
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.provenance import provenance
from stiction.reports.run_folder.reproduce import FOLDER, write_reproduce
from stiction.reports.run_folder.settings import words

REPORT, HARD, FAILURES = "report.md", "hard.md", "failures.md"

BEST_FIRST = (PROVEN, CLOSED_FORM, HIGH_PRECISION, PUBLISHED, OWN_RUN)
TIERS = """\
Truth tiers, best first: *proven* (an enclosure of the motion in ball arithmetic, its uncertainty a bound; of scenes whose
certificate comes with the suite; efforts keep the estimate of the tier below); *closed form*; *independent high-precision solution* (the mechanism in its own minimal
coordinates, written without constraint Jacobian or complementarity problem, uncertainty from two discretizations);
*published*; *our own run* (good against regressions only: agreement with it proves nothing)."""

HOW_TO_READ = f"""\
- A method is a variant: an engine with its settings. A rung is one step (`dt`) or tolerance (`rtol`) of its ladder.
- Numbers are rounded here, errors to two digits. `data/*.csv` and `data/*.parquet` have all of them, and per row the
  run's key and the file of its trajectory. `stiction trace RUN KEY` prints a row with all that it comes from.
- A trajectory in `data/trajectories/` has a row every 10 ms and two rows more per event, equal `t`, the values before and
  after it. Those that figures show are stored, after `validate --full` those of all runs that are compared; other rows have in `run again` the command for it.
- *joint* fidelity: bilateral joints, friction bound from their reactions. *contact* fidelity: a box between two
  surfaces, the engine's own contacts. They answer different questions: compare within one.
- An engine without a static coefficient is compared with the truth of the physics it has, mus = mu.
- `< u`: the number is not larger than its uncertainty. A dash: not applicable, or the run did not come out.
  `{NULL.partition(" ")[0]}`: the source has lost the number, and nobody guessed it."""


def write_report(validation: Results, folder: str | Path) -> Path:
    """Write the run folder of a validation.

    ``report.md``, page one first; what is too long for it in ``hard.md`` and ``failures.md``; ``data/`` (see `stiction.reports.run_folder.data`);
    ``figures/*.png`` and ``*.pdf``; ``reproduce/`` (see `stiction.reports.run_folder.reproduce`); ``provenance.json``. The folder appears complete or not at all. A previous report is replaced if nothing was added to it; anything else
    is refused.

    Returns
    -------
    Path
        Of ``report.md``.

    Raises
    ------
    FolderRefused
        If writing would lose something; `check_folder` tells beforehand.
    """
    with run_folder(folder, REPORT) as partial:
        place = partial / "figures"
        place.mkdir()
        with rc():
            figures = list(drawings(validation))
        save_all(figures, place)
        captions = pd.DataFrame([(figure.name, figure.topic, figure.caption) for figure in figures], columns=["name", "topic", "caption"])
        stored = stored_keys(validation)
        write_data(validation, partial, stored, {"figures": captions})
        origin = provenance(validation)
        for name, text in pages(validation, stored, origin, figures).items():
            (partial / name).write_text(text, encoding="utf-8")
        write_reproduce(validation, origin, partial)
        files = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        text = json.dumps({**origin, "files": [*files, PROVENANCE]}, indent=2, ensure_ascii=False)
        (partial / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    return Path(folder) / REPORT


def pages(validation: Results, stored: Container[str], origin: Mapping[str, Any], figures: Sequence[Drawing]) -> dict[str, str]:
    """The texts by name of the file: the report, and what it links to."""
    hard, lost = validation.tables.get("hard", pd.DataFrame()), losses(validation)
    return {REPORT: compose(validation, stored, origin, figures), **({HARD: hard_page(hard)} if len(hard) else {}),
            **({FAILURES: "# What did not come out\n\n" + markdown(lost) + "\n"} if len(lost) else {})}


def compose(validation: Results, stored: Container[str], origin: Mapping[str, Any], figures: Sequence[Drawing]) -> str:
    """The text of ``report.md``."""
    tables = data_tables(validation, stored)
    parameters = tables["parameters"]
    return "\n\n".join([
        page_one(validation, _when(origin), figures), *sections(validation, figures),
        "## Methods", *([variants_table(validation), all_rows("variants", len(tables["variants"]))] if validation.records else []),
        "## Parameters of the scenes", fitted(parameters.assign(scene=[name.rpartition("/")[2] for name in parameters["scene"]]) if len(parameters) else parameters),
        "Choices that the paper leaves open:", "\n".join(f"- {name}: {text}" for name, text in origin["choices"].items()),
        "## Truths", *_truths(validation.tables.get("accuracy", pd.DataFrame())), TIERS,
        "## Provenance", _provenance(origin), "## How to read this", HOW_TO_READ]) + "\n"


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
    cut = " **It was interrupted: all that follows is of the runs that were made until then.**" if origin["campaign"].get("interrupted") else ""
    return f"Run of {origin['date'][:16].replace('T', ' ')} UTC with stiction {origin['versions']['stiction']}" + (f", {engines}." if engines else ".") + cut


def _provenance(origin: Mapping[str, Any]) -> str:
    """All that the folder's provenance has, a line each."""
    commit = origin["commit"]
    changes = " with uncommitted changes" if commit and commit["dirty"] else ""
    parts = {"date": origin["date"], "commit": commit["hash"] + changes if commit else "not in a checkout",
             "source": f"SHA-256 {origin['source']}", "command": f"`{origin['command']}`; [how to make these numbers again]({FOLDER}/README.md)",
             **{name: ", ".join(f"{key} {words(entry)}" for key, entry in origin[name].items()) for name in ("versions", "machine", "campaign")}}
    return "\n".join(f"- {name}: {text}" for name, text in parts.items())
