"""The folder of a run: it appears complete or not at all, and never takes the place of something else.

Everything is written to a sibling ``.<name>.partial-<process id>``, renamed at the end. What an interrupted run leaves
under that name is not a run folder and may be deleted.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROVENANCE = "provenance.json"
"""What makes a folder a run folder; lists its files under ``"files"``."""


class FolderRefused(Exception):
    """The folder cannot be written without losing something that is not a report."""


def check_folder(folder: str | Path) -> None:
    """Whether a report may be written to `folder`: to be asked before the hours of a campaign, not after.

    It may if the folder does not exist, is empty, or is a previous run folder to which nothing was added: then the
    new one replaces it.

    Raises
    ------
    FolderRefused
        Otherwise, naming what is in the way.
    """
    folder = Path(folder).resolve()
    existing = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    if not existing.is_dir():
        raise FolderRefused(f"{existing}: found a file; expected a folder, or nothing, for the report")
    if existing == folder and any(folder.iterdir()):
        _check_previous(folder)
        existing = folder.parent
    if not os.access(existing, os.W_OK):
        raise FolderRefused(f"{existing}: not writable; expected a place for the report")


def _check_previous(folder: Path) -> None:
    try:
        listed = set(json.loads((folder / PROVENANCE).read_text())["files"])
    except (OSError, ValueError, KeyError, TypeError):
        raise FolderRefused(f"{folder}: not empty and no previous report ({PROVENANCE} with its list of files is "
                            "missing); expected an empty folder, a previous report, or a new name") from None
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
    if added := sorted(present - listed):
        some = ", ".join(added[:3]) + (" ..." if len(added) > 3 else "")
        raise FolderRefused(f"{folder}: found {some} beside a previous report, which would be lost; expected an empty "
                            "folder, an unchanged report, or a new name")


@contextmanager
def run_folder(folder: str | Path) -> Iterator[Path]:
    """A folder to write to that becomes `folder` when the block ends, and vanishes if the block raises.

    Raises
    ------
    FolderRefused
        As `check_folder`, before the block and again before a previous report is replaced.
    """
    check_folder(folder)
    folder = Path(folder).resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    replaced = folder.with_name(f".{folder.name}.replaced-{os.getpid()}")
    partial.mkdir()
    try:
        yield partial
        check_folder(folder)
        if folder.exists():
            folder.rename(replaced)
        partial.rename(folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        if replaced.exists() and not folder.exists():
            replaced.rename(folder)
        raise
    shutil.rmtree(replaced, ignore_errors=True)
