"""The page of a submission to the benchmark: who made it and how, the verdict, and the table of its scenes."""

from __future__ import annotations

from collections.abc import Iterator

from stiction.comparisons.bench.presentation import TableView
from stiction.reports.page.document import markdown, table
from stiction.reports.run_folder.trace import keys
from stiction.reports.site.content import SiteContent, SubmissionContent
from stiction.reports.site.layout import page


def submission_page(content: SiteContent, submission: SubmissionContent) -> str:
    """Return the HTML of the page of a submission."""
    subtitle = "A submission to the benchmark, judged when this site was built"
    return page(content, submission.path, submission.title, subtitle, _sections(submission))


def _sections(submission: SubmissionContent) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading of each section of the page, and its blocks of HTML."""
    section = submission.section
    findings = markdown("\n".join(f"- {finding}" for finding in section.findings))
    yield "The verdict", [markdown(f"**{section.answer}**"), findings]
    rows = list(submission.about.items())
    about = table("As the submission states it.", ("what", "value"), rows, (False, False))
    yield "Who and how", [about]
    tables = [_table(view) for view in section.tables]
    notes = markdown("\n".join(f"- {note}" for note in section.notes))
    yield "Scenes", [*tables, notes]


def _table(view: TableView) -> str:
    """Return the HTML of a table of a judgement, with the key of each row."""
    rows = [[*cells, key] for cells, key in zip(view.cells(), keys(view), strict=True)]
    return table(view.caption, [*view.heads(), "key"], rows, [*view.right(), False])
