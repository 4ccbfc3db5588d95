"""Writes a site: all pages, the history for download, the data set, and the documentation."""

from __future__ import annotations

import shutil
import sqlite3
import zipfile
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from stiction.comparisons.regression.nightly import HISTORY
from stiction.reports.dataset import MAIN as DATASET_MAIN
from stiction.reports.page.history_page import extent_of, history_sections
from stiction.reports.page.nights import folder_name, read_nights
from stiction.reports.page.run_page import run_line, run_sections
from stiction.reports.page_one import title_of
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.site.content import (
    FILES_NOTE,
    Download,
    SiteContent,
    SubmissionContent,
    question_path,
    read_content,
)
from stiction.reports.site.engine_page import engine_page
from stiction.reports.site.front_page import front_page
from stiction.reports.site.layout import DOCS, INDEX, NIGHTS, RUN, origins, page
from stiction.reports.site.question_page import question_page
from stiction.reports.site.submission_page import submission_page
from stiction.scenes import InputError

DOWNLOADS = "download"
"""Folder of files for download in the site."""
DATASET = f"{DOWNLOADS}/dataset.zip"
"""Path of the data set in the site."""
RUN_DATA = f"{DOWNLOADS}/run.zip"
"""Path of the tables of the newest run in the site."""
RUN_FILES = (
    "report.md",
    "failures.md",
    "provenance.json",
    "datapackage.json",
    "data/*.csv",
    "data/*.parquet",
    "reproduce/**/*",
)
"""Patterns of the files of a run that the site offers; trajectories and figures would take ten times the space."""
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the archive, the earliest that the format allows, so that equal data give equal bytes."""


def write_site(
    history: Path,
    folder: Path,
    runs: Sequence[StoredRun] = (),
    submissions: Sequence[SubmissionContent] = (),
    dataset: Path | None = None,
    docs: Path | None = None,
) -> Path:
    """Write a site, complete or not at all, and return the path of its front page.

    The same input gives the same bytes.

    Parameters
    ----------
    history : Path
        History of `stiction nightly`, with the folders of its nights beside it.
    folder : Path
        Folder to write; `run_folder` refuses folders whose content would be lost.
    runs : sequence of StoredRun
        Runs of `stiction validate`. The newest one fills the front page and the pages of questions.
    submissions : sequence of SubmissionContent
        Judged submissions to the benchmark.
    dataset : Path, optional
        Folder written by `stiction dataset`.
    docs : Path, optional
        Folder of the documentation as HTML, written by MkDocs.

    Raises
    ------
    HistoryRefused
        If `history` is not a history.
    InputError
        If the history has no finished night, or `dataset` or `docs` is not such a folder.
    FolderRefused
        If content of the folder would be lost.
    """
    check_dataset(dataset)
    check_docs(docs)
    downloads = [
        Download(
            f"nights/{HISTORY}",
            HISTORY,
            "all numbers of all nights in full precision, an SQLite file",
        )
    ]
    if dataset is not None:
        description = "the benchmark set: scenes and their truths"
        downloads.append(Download(DATASET, Path(DATASET).name, description))
    if runs:
        description = (
            "all tables of the run in full precision, its failures, and how to repeat it; without "
            "trajectories and truths"
        )
        downloads.append(Download(RUN_DATA, Path(RUN_DATA).name, description))
    content = read_content(history, runs, submissions, downloads, docs)
    with run_folder(folder, INDEX) as partial:
        _write_pages(content, partial)
        _write_nights(content, history, partial)
        (partial / DOWNLOADS).mkdir()
        if dataset is not None:
            _write_zip(dataset, ["**/*"], partial / DATASET)
        if content.newest_run is not None:
            _write_zip(content.newest_run.stored.folder, RUN_FILES, partial / RUN_DATA)
        if docs is not None:
            shutil.copytree(docs, partial / DOCS)
        write_provenance(partial, {"origins": origins(content)})
    return Path(folder) / INDEX


def check_dataset(dataset: Path | None) -> None:
    """Check that a folder was written by `stiction dataset`."""
    if dataset is not None and not (dataset / DATASET_MAIN).is_file():
        raise InputError(
            f"{dataset}: found no {DATASET_MAIN}; expected a folder written by `stiction dataset`"
        )


def check_docs(docs: Path | None) -> None:
    """Check that a folder contains the documentation as HTML."""
    if docs is not None and not (docs / INDEX).is_file():
        raise InputError(
            f"{docs}: found no {INDEX}; expected the folder `site` that `mkdocs build` writes"
        )


def _write_pages(content: SiteContent, folder: Path) -> None:
    """Write all pages but that of the history."""
    pages = {INDEX: front_page(content)}
    for study in content.questions:
        pages[question_path(study)] = question_page(content, study)
    for engine, path in content.engine_pages.items():
        pages[path] = engine_page(content, engine)
    for submission in content.submissions:
        pages[submission.path] = submission_page(content, submission)
    run = content.newest_run
    if run is not None:
        title = title_of(run.report.results)
        sections = run_sections(run.stored, run.report, FILES_NOTE)
        pages[RUN] = page(content, RUN, title, run_line(run.stored), sections)
    for path, html in pages.items():
        file = folder / path
        file.parent.mkdir(exist_ok=True)
        file.write_text(html, encoding="utf-8")


def _write_nights(content: SiteContent, history: Path, folder: Path) -> None:
    """Write a copy of the history and of the folders of its nights, and the page about them."""
    target = folder / Path(NIGHTS).parent
    target.mkdir()
    # The newest rows of the history may be in a second file beside it, its write-ahead log.
    source = f"{history.absolute().as_uri()}?mode=ro"
    with closing(sqlite3.connect(source, uri=True)) as connection:
        connection.execute("VACUUM INTO ?", (str(target / HISTORY),))
    for night in content.nights.names:
        name = folder_name(night)
        if (history.parent / name).is_dir():
            shutil.copytree(history.parent / name, target / name)
    nights = read_nights(target / HISTORY)
    file = folder / NIGHTS
    sections = history_sections(nights, file).items()
    html = page(content, NIGHTS, "History of the nights", extent_of(nights), sections)
    file.write_text(html, encoding="utf-8")


def _write_zip(source: Path, patterns: Sequence[str], file: Path) -> None:
    """Write the files of a folder that match any pattern to an archive.

    Its bytes depend only on the names and contents of the files.
    """
    root = source.resolve().name
    paths = {path for pattern in patterns for path in source.glob(pattern) if path.is_file()}
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(paths):
            name = f"{root}/{path.relative_to(source).as_posix()}"
            entry = zipfile.ZipInfo(name, ZIP_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, path.read_bytes())
