"""The report of a validation: a run folder with `report.md` in it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.campaigns.validation import Validation
from stiction.reports.figures import Drawing, drawings, save_all
from stiction.reports.figures.style import rc
from stiction.reports.markdown.claims_page import claims_page, study_page
from stiction.reports.markdown.cost_page import cost_page
from stiction.reports.markdown.hard_page import hard_page
from stiction.reports.markdown.losses import grouped, losses
from stiction.reports.markdown.summary import summary
from stiction.reports.markdown.tables import NULL, cell, markdown, run_table, worst_per_run
from stiction.reports.run_folder.data import data_tables, write_data
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.provenance import provenance
from stiction.reports.run_folder.settings import words

REPORT = "report.md"

TIERS = """\
Truth tiers, best first: *closed form*; *independent high-precision solution* (the mechanism in its own minimal
coordinates, written without constraint Jacobian or complementarity problem, uncertainty from two discretizations);
*published*; *our own run* (good against regressions only: agreement with it proves nothing)."""

HOW_TO_READ = """\
- One row is one run: a variant (an engine with its settings) at one step (`dt`) or tolerance (`rtol`).
  `data` in its last column leads to its trajectory.
- Numbers are rounded here, errors to two digits. `data/*.csv` and `data/*.parquet` have all of them.
- A trajectory in `data/trajectories/` has two rows more per event, equal `t`, the values before and after it.
  `data/events.parquet` has all events of all runs, two-sided.
- *joint* fidelity: bilateral joints, friction bound from their reactions. *contact* fidelity: a box between two
  surfaces, the engine's own contacts. They answer different questions: compare within one.
- Who supplies the friction law, engine or adapter, is part of a result: see the settings of the variants.
- An engine without a static coefficient is compared with the truth of the physics it has, mus = mu.
- A dash: not applicable, or the run did not come out. `null`: the source has lost the number, and nobody guessed it."""


def write_report(validation: Validation, folder: str | Path) -> Path:
    """Write the run folder of a validation.

    ``report.md``; ``data/`` (see `stiction.reports.run_folder.data`); ``figures/*.png`` and ``*.pdf``; ``provenance.json``. The
    folder appears complete or not at all. A previous report is replaced if nothing was added to it; anything else
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
        write_data(validation, partial, {"figures": captions})
        origin = provenance(validation)
        (partial / REPORT).write_text(compose(validation, origin, figures), encoding="utf-8")
        files = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        text = json.dumps({**origin, "files": [*files, PROVENANCE]}, indent=2, ensure_ascii=False)
        (partial / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    return Path(folder) / REPORT


def compose(validation: Validation, origin: Mapping[str, Any], figures: Sequence[Drawing]) -> str:
    """The text of ``report.md``."""
    tables, lost = data_tables(validation), losses(validation)

    def section(title: str, table: str, render: Callable[[pd.DataFrame], str], *words: str) -> list[str]:
        there = tables.get(table, pd.DataFrame())
        shown = render(there) if len(there) else "(not compared in this run)"
        return [f"## {title}", *words, shown, *embedded(table)]

    def embedded(topic: str) -> list[str]:
        return [f"![{figure.name}](figures/{figure.name}.png)\n\n{figure.caption} ([PDF](figures/{figure.name}.pdf))"
                for figure in figures if figure.topic == topic]

    return "\n\n".join([
        "# Validation report",
        "\n".join(f"{number}. {line}" for number, line in enumerate(summary(validation), 1)),
        TIERS,
        "## Provenance", markdown(_origin_table(origin)),
        markdown(tables["parameters"]),
        "Choices that the paper leaves open:",
        "\n".join(f"- {name}: {text}" for name, text in origin["choices"].items()),
        "## What accuracy costs",
        *cost_page(*(tables.get(name, pd.DataFrame()) for name in ("cost", "effects", "suppression")), "\n\n".join(embedded("cost"))),
        *section("The paper's claims", "claims", claims_page),
        *section("What the paper leaves open", "sensitivity", markdown, "Claims by their numbers above; verdicts of the independent solution alone."),
        *section("Accuracy", "accuracy", run_table),
        *section("Order of convergence", "orders", markdown),
        *section("Constraint drift", "drift", run_table),
        *section("Drift and what is done against it", "study", study_page),
        *section("Stick threshold on F0", "threshold", run_table, f"The paper's own figure: `{NULL}`."),
        *section("Driving-torque jumps", "torque", lambda table: run_table(worst_per_run(table)),
                 "Largest errors per run over the jumps of the truth; every jump is a row of `data/torque.csv`."),
        *section("Hard cases", "hard", hard_page,
                 "Every case through the reference's methods and every engine: *right*; *degraded*, less accurate than the method "
                 "should be; *refused*, by its own word; *wrong*; *failed*, without a result. Numbers are errors relative to the size "
                 "of what is measured, of the worst measure (a count for events). The complementarity problems that the reference met "
                 "are in `data/hard-problems.parquet`, for `stiction replay --problems`."),
        "## The paper's figures, redrawn", *(embedded("paper") or ["(no run came out that could be drawn)"]),
        "## Failures", markdown(grouped(lost)) if len(lost) else "None: every run came out.",
        "## Settings of the variants", markdown(tables["variants"]),
        "## How to read this", HOW_TO_READ,
    ]) + "\n"


def _origin_table(origin: Mapping[str, Any]) -> pd.DataFrame:
    commit = origin["commit"]
    changes = " with uncommitted changes" if commit and commit["dirty"] else ""
    rows = {"date": origin["date"], **origin["versions"],
            **{f"engine {name}": version for name, version in origin["engines"].items()}, **origin["machine"],
            "commit": commit["hash"] + changes if commit else "not in a checkout",
            **{f"campaign: {name}": value for name, value in origin["campaign"].items()}}
    shown = [(name, cell(name, value if isinstance(value, float) else words(value))) for name, value in rows.items()]
    return pd.DataFrame(shown, columns=["what", "value"])
