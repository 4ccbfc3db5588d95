"""Submissions to the benchmark for a site: each is judged, and described by its text and tables."""

from __future__ import annotations

from pathlib import Path

from stiction.comparisons.bench.environment import SUITE, commit, versions
from stiction.comparisons.judge.submission import DESCRIPTION, is_submission, judge_submission
from stiction.reports.page.document import unique_anchor
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.site.content import SubmissionContent
from stiction.reports.submission_page import settings_in_words, submission_section
from stiction.scenes import InputError


def submission_folders(folder: Path) -> list[Path]:
    """Return the submissions in a folder, each a subfolder, in the order of their names.

    Raises
    ------
    InputError
        If there are none.
    """
    folders = []
    if folder.is_dir():
        folders = [path for path in sorted(folder.iterdir()) if is_submission(path)]
    if not folders:
        raise InputError(
            f"{folder}: found no submission; expected a folder with a subfolder for each submission, which "
            f"contains a {DESCRIPTION}"
        )
    return folders


def judged_submission(folder: Path) -> SubmissionContent:
    """Judge the submission in a folder, and return what its page shows.

    Raises
    ------
    FileError
        If the folder is no submission.
    """
    judged = judge_submission(folder)
    submission = judged.submission
    about = {
        "benchmark": submission.benchmark,
        "by": submission.who,
        "engine": f"{submission.engine} {submission.version}",
        "fidelity": submission.fidelity,
        "machine": submission.machine,
        "command": submission.command,
        "settings": settings_in_words(submission),
        "judged with": f"stiction {versions()[SUITE]}, commit {commit_in_words({'commit': commit()})}",
    }
    return SubmissionContent(
        path=f"submissions/{unique_anchor(folder.name)}.html",
        title=f"{submission.engine} {submission.version}",
        about=about,
        section=submission_section(judged),
    )
