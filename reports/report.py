"""The report of a validation: a run folder with `report.md` in it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from comparisons.validation import Validation
from reports.data import data_tables, write_data
from reports.figures import drawings, save
from reports.figures.style import rc
from reports.folder import PROVENANCE, run_folder
from reports.losses import grouped, losses
from reports.provenance import provenance
from reports.summary import summary
from reports.tables import NULL, cell, markdown, quantities, run_table, worst

REPORT = "report.md"

TIERS = """Truth tiers, best first: *closed form*; *independent high-precision solution* (the mechanism in its own minimal coordinates,
written without constraint Jacobian or complementarity problem, uncertainty from two discretizations); *published*; *our own
run* (only against regressions: agreement with it proves nothing)."""

HOW_TO_READ = """- One row is one run: a variant (an engine with its settings) at one step (`dt`) or tolerance (`rtol`).
  `data` in its last column leads to its trajectory.
- Numbers are rounded here: errors to two digits. `data/*.csv` and `data/*.parquet` have all of them; pandas reads either.
- A trajectory in `data/trajectories/` has two rows more per event, the values before and after it: equal `t`, jump between.
  `data/events.parquet` has all events of all runs, two-sided.
- *joint* fidelity: bilateral joints, friction bound from their reactions. *contact* fidelity: a box between two surfaces, the
  engine's own contacts. They answer different questions: compare within one.
- Who supplies the friction law, engine or adapter, is part of a result: see the settings of the variants.
- An engine without a static coefficient is compared with the truth of the physics it has, mus = mu; the row says so.
- A dash: not applicable, or the run did not come out. `null`: the source has lost the number, and nobody guessed it."""


def write_report(validation: Validation, folder: str | Path) -> Path:
    """Write the run folder of a validation.

    ``report.md``; ``data/`` (see `reports.data`); ``figures/*.png`` and ``*.pdf``; ``provenance.json``. The folder appears complete or
    not at all. A previous report is replaced if nothing was added to it, anything else refused.

    Returns
    -------
    Path
        Of ``report.md``.

    Raises
    ------
    FolderRefused
        If writing would lose something; `check_folder` tells beforehand.
    """
    with run_folder(folder) as partial:
        write_data(validation, partial)
        (partial / "figures").mkdir()
        captions: dict[str, str] = {}
        with rc():
            for drawing in drawings(validation):
                save(drawing, partial / "figures")
                captions[drawing.name] = drawing.caption
        origin = provenance(validation)
        (partial / REPORT).write_text(compose(validation, origin, captions), encoding="utf-8")
        files = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        text = json.dumps({**origin, "files": [*files, PROVENANCE]}, indent=2, ensure_ascii=False)
        (partial / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    return Path(folder) / REPORT


def compose(validation: Validation, origin: Mapping[str, Any], captions: Mapping[str, str]) -> str:
    """The text of ``report.md``."""
    tables = data_tables(validation)
    lost = losses(validation)
    parts = [
        "# Validation report",
        "\n".join(f"{number}. {line}" for number, line in enumerate(summary(validation), 1)),
        TIERS,
        "## Provenance", markdown(pd.DataFrame(_origin_rows(origin), columns=["what", "value"])),
        "Choices that the paper leaves open:\n\n" + "\n".join(f"- {name}: {text}" for name, text in origin["choices"].items()),
        *_section("The paper's claims", tables, "claims", markdown),
        *_section("Accuracy", tables, "accuracy", run_table), *_figures(captions, "accuracy"),
        *_section("Constraint drift", tables, "drift", run_table), *_figures(captions, "fig14", "drift"),
        *_section("Stick threshold on F0", tables, "threshold", run_table, f"The paper's own figure: `{NULL}`."),
        *_figures(captions, "threshold"),
        *_section("Driving-torque jumps", tables, "torque", _torque,
                  "Largest errors per run over the jumps of the truth; every jump is a row of `data/torque.csv`."),
        "## The paper's figures, redrawn", *(_figures(captions, "fig0", "fig10", "fig11", "fig12", "fig13")
                                             or ["(no run came out that could be drawn)"]),
        "## Failures", markdown(grouped(lost)) if len(lost) else "None: every run came out.",
        "## Settings of the variants", markdown(_settings(validation)),
        "## How to read this", HOW_TO_READ,
    ]
    return "\n\n".join(parts) + "\n"
