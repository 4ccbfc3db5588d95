"""The folder of a judged submission: a Markdown page, its tables, and the judgement of each scene."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from stiction.comparisons.judge.benchmark import NAME
from stiction.comparisons.judge.submission import JudgedSubmission, Submission
from stiction.comparisons.judge.submission_presentation import presentation
from stiction.reports.judgement_page import MAIN as JUDGEMENT
from stiction.reports.judgement_page import write_judgement
from stiction.reports.markdown.study_section import table_with_caption
from stiction.reports.run_folder.data import write_table
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.text import Section, fill_template, template

MAIN = "submission.md"
"""The page, which marks a folder as a judged submission; the folder of an earlier call is replaced."""
JOINED_TABLES = ("errors", "stick-phases", "jumps")
"""Tables of the judgements that are also written as one table of all scenes."""


def submission_section(judged: JudgedSubmission) -> Section:
    """Return the text and the table that describe a judged submission."""
    return fill_template(template("submission.md"), presentation(judged))


def settings_in_words(submission: Submission) -> str:
    """Return the settings of a submission in one line."""
    settings = ", ".join(f"{name} = {value}" for name, value in submission.settings.items())
    return settings or "none stated"


def write_submission_judgement(judged: JudgedSubmission, folder: Path) -> Path:
    """Write the page, the tables (CSV, Parquet) and the judgements of the scenes, and return the path of the page.

    `run_folder` refuses folders whose content would be lost.
    """
    section = submission_section(judged)
    with run_folder(folder, MAIN) as partial:
        (partial / "data").mkdir()
        tables = {"scenes": judged.table}
        for name in JOINED_TABLES:
            tables[name] = _joined(judged, name)
        for name, frame in tables.items():
            write_table(frame, partial / "data", name)
        for scene, judgement in judged.judgements.items():
            write_judgement(judgement, partial / "scenes" / scene)
        (partial / MAIN).write_text(_page(judged, section), encoding="utf-8")
        write_provenance(partial, {"benchmark": NAME, "submission": judged.submission.model_dump()})
    return Path(folder) / MAIN


def _joined(judged: JudgedSubmission, name: str) -> pd.DataFrame:
    """Return the rows of a table of all judgements, with the scene as first column."""
    tables = []
    for scene, judgement in judged.judgements.items():
        table = judgement.tables[name].copy()
        table.insert(0, "scene", scene)
        if len(table):
            tables.append(table)
    if not tables:
        return pd.DataFrame({"scene": []}, dtype=str)
    return pd.concat(tables, ignore_index=True)


def _page(judged: JudgedSubmission, section: Section) -> str:
    """Return the Markdown of the page: description, answer, findings, table, and links to the scenes."""
    submission = judged.submission
    description = {
        "by": submission.who,
        "machine": submission.machine,
        "command": f"`{submission.command}`",
        "settings": settings_in_words(submission),
    }
    links = [f"- [{scene}](scenes/{scene}/{JUDGEMENT})" for scene in judged.judgements]
    parts = [
        f"# {submission.engine} {submission.version}",
        "\n".join(f"- {name}: {value}" for name, value in description.items()),
        f"**{section.answer}**",
        "\n".join(f"- {finding}" for finding in section.findings),
        *[table_with_caption(view) for view in section.tables],
        "\n".join(links),
        "\n".join(f"- {note}" for note in section.notes),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"
