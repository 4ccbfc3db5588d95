"""The folder of a judgement: a Markdown page, its figure, and its tables as data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stiction.comparisons.bench.results import Results
from stiction.comparisons.judge.judgement import Judgement
from stiction.comparisons.judge.judgement_presentation import presentation
from stiction.reports.figures.charts import draw_figures
from stiction.reports.figures.style import Drawing, rc, save
from stiction.reports.markdown.study_section import figure_markdown, table_with_caption
from stiction.reports.run_folder.data import to_storable, write_frame
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.text import Section, fill_template, template

MAIN = "judgement.md"
"""The page, which marks a folder as a judgement; the folder of an earlier call is replaced."""


def judgement_section(judged: Judgement) -> Section:
    """Return the text, tables and figures that describe a judgement."""
    return fill_template(template("judgement.md"), presentation(judged))


def write_judgement(judged: Judgement, folder: Path) -> Path:
    """Write the page, its figures (SVG, PDF) and its tables (CSV, Parquet), and return the path of the page.

    `run_folder` refuses folders whose content would be lost.
    """
    section = judgement_section(judged)
    with run_folder(folder, MAIN) as partial:
        for part in ("data", "figures"):
            (partial / part).mkdir()
        for name, frame in judged.tables.items():
            table = to_storable(frame)
            table.to_csv(partial / "data" / f"{name}.csv", index=False)
            write_frame(table, partial / "data" / f"{name}.parquet")
        with rc():
            drawings = list(draw_figures(section.figures, Results((), {}, {})))
            for drawing in drawings:
                save(drawing, partial / "figures")
        (partial / MAIN).write_text(_page(judged, section, drawings), encoding="utf-8")
        write_provenance(partial, {"scene": judged.scene.name, "table": judged.table.origin})
    return Path(folder) / MAIN


def _page(judged: Judgement, section: Section, drawings: Sequence[Drawing]) -> str:
    """Return the Markdown of the page: answer, findings, figures, tables and notes."""
    parts = [
        f"# {judged.table.origin} on {judged.scene.name}",
        f"**{section.answer}**",
        "\n".join(f"- {finding}" for finding in section.findings),
        *[figure_markdown(drawing) for drawing in drawings],
        *[table_with_caption(view) for view in section.tables if view.in_report],
        "\n".join(f"- {note}" for note in section.notes),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"
