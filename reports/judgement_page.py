"""The folder of a judgement: a Markdown page, its figure, and its tables as data."""

from __future__ import annotations

from pathlib import Path

from stiction.comparisons.bench.results import Results
from stiction.comparisons.judge.judgement import Judgement
from stiction.comparisons.judge.judgement_presentation import presentation
from stiction.reports.figures.charts import drawn
from stiction.reports.figures.style import rc, save
from stiction.reports.markdown.study_section import figure, more, table
from stiction.reports.run_folder.data import storable, write_frame
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.text import Section, template, written

MAIN = "judgement.md"
"""The page; a folder with it is replaced by a later call."""


def judgement_section(judged: Judgement) -> Section:
    """Return a judgement in words, tables and figures."""
    return written(template("judgement.md"), presentation(judged))


def write_judgement(judged: Judgement, folder: Path) -> Path:
    """Write page, figure (SVG, PDF) and tables (CSV, Parquet); return the page. What it refuses: `run_folder`."""
    section = judgement_section(judged)
    parts = [
        f"# {judged.table.origin} on {judged.scene.name}",
        f"**{section.answer}**",
        "\n".join(f"- {finding}" for finding in section.findings),
    ]
    with run_folder(folder, MAIN) as partial:
        for part in ("data", "figures"):
            (partial / part).mkdir()
        for name, frame in judged.tables.items():
            storable(frame).to_csv(partial / "data" / f"{name}.csv", index=False)
            write_frame(storable(frame), partial / "data" / f"{name}.parquet")
        with rc():
            for drawing in drawn(section.figures, Results((), {}, {})):
                save(drawing, partial / "figures")
                parts.append(figure(drawing))
        parts += [
            f"*{view.caption}*\n\n{table(view)}{more(view)}"
            for view in section.tables
            if view.in_report
        ]
        parts.append("\n".join(f"- {note}" for note in section.notes))
        (partial / MAIN).write_text("\n\n".join(filter(None, parts)) + "\n", encoding="utf-8")
        write_provenance(partial, {"scene": judged.scene.name, "table": judged.table.origin})
    return Path(folder) / MAIN
