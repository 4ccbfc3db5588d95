"""Folders that are written completely or not at all, and never replace anything but an earlier one.

All files are written to a folder beside the final one, with ``.partial-<process id>`` in its name, which is
renamed at the end. A folder of this name that an interrupted run has left may be deleted.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stiction.scenes import StictionError
from stiction.scenes.atomic_files import NotWritten, partial_name

PROVENANCE = "provenance.json"
"""File that marks a folder as written by stiction; it lists the files of the folder under ``"files"``."""
MAX_FILES_NAMED = 3
"""Largest number of added files that a message names."""


class FolderRefused(StictionError):
    """The folder cannot be written without losing its present content."""


def check_folder(folder: str | Path, main: str, source: Path | None = None) -> None:
    """Check that a folder may be written. Commands call this before they compute, which may take hours.

    A folder may be written if it does not exist or is empty, or if an earlier call has written it and
    nothing was added since.

    Parameters
    ----------
    folder : str or Path
        The folder to write.
    main : str
        File that shows the kind of a folder: ``report.md`` of a run, ``paper.pdf`` of a paper.
    source : Path, optional
        Folder with the data that are read. The folder to write must be neither this folder, nor
        inside it, nor contain it.

    Raises
    ------
    FolderRefused
        If the folder may not be written.
    """
    folder = Path(folder).resolve()
    existing = folder
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise FolderRefused(
            f"{existing}: found a file; expected a folder, or nothing, for the report"
        )
    if source is not None:
        _check_apart(folder, source.resolve())
    if existing == folder and any(folder.iterdir()):
        _check_previous(folder, main)
        # The folder is replaced, which changes its parent.
        existing = folder.parent
    if not os.access(existing, os.W_OK):
        raise FolderRefused(f"{existing}: not writable; expected a place for the report")


def _check_apart(folder: Path, source: Path) -> None:
    """Check that a folder to write and the folder with the data do not contain each other."""
    if folder == source or folder in source.parents or source in folder.parents:
        raise FolderRefused(
            f"{folder}: found the folder that it is made from, or one around or in it ({source}); "
            "expected another place"
        )


def _check_previous(folder: Path, main: str) -> None:
    """Check that an earlier call has written all files of a folder, among them the file `main`."""
    try:
        listed = set(json.loads((folder / PROVENANCE).read_text())["files"])
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError):
        raise FolderRefused(
            f"{folder}: not empty and no previous report ({PROVENANCE} with its list of files is "
            "missing); expected an empty folder, a previous report, or a new name"
        ) from None
    if main not in listed:
        raise FolderRefused(
            f"{folder}: found another kind of folder, without {main}, which would be lost; "
            f"expected an empty folder, one with {main} of an earlier call, or a new name"
        )
    added = sorted(set(_files(folder)) - listed)
    if added:
        names = ", ".join(added[:MAX_FILES_NAMED])
        if len(added) > MAX_FILES_NAMED:
            names += " ..."
        raise FolderRefused(
            f"{folder}: found {names} beside a previous report, which would be lost; expected an empty "
            "folder, an unchanged report, or a new name"
        )


def _files(folder: Path) -> list[str]:
    """Return the files of a folder and of its subfolders, relative to it and sorted."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()
    )


def write_provenance(folder: Path, origin: Mapping[str, Any]) -> None:
    """Write `PROVENANCE`: the origin of the numbers, and the list of all files of the folder.

    The list is complete only if this file is written last.
    """
    text = json.dumps(
        {**origin, "files": [*_files(folder), PROVENANCE]},
        indent=2,
        ensure_ascii=False,
        default=_as_json,
    )
    (folder / PROVENANCE).write_text(text + "\n", encoding="utf-8")


def _as_json(value: Any) -> Any:
    """Convert a value that JSON cannot represent: a set to a list, anything else to text."""
    return sorted(value) if isinstance(value, (set, frozenset)) else str(value)


@contextmanager
def run_folder(folder: str | Path, main: str, source: Path | None = None) -> Iterator[Path]:
    """Yield a temporary folder that replaces `folder` at the end of the block.

    If the block raises, the temporary folder is removed, and a previous folder is not changed. The
    parameters are those of `check_folder`, which is called before the block and again after it.

    Raises
    ------
    FolderRefused
        If content of the folder would be lost.
    NotWritten
        If the operating system reports an error.
    """
    check_folder(folder, main, source)
    folder = Path(folder).resolve()
    partial = partial_name(folder)
    replaced = folder.with_name(f".{folder.name}.replaced-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        yield partial
        # Somebody may have added files to the folder during the block.
        check_folder(folder, main, source)
        if folder.exists():
            folder.rename(replaced)
        partial.rename(folder)
    except OSError as error:
        raise NotWritten(folder, error) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        # If the second renaming has failed, the previous folder returns to its place.
        if replaced.exists() and not folder.exists():
            replaced.rename(folder)
        shutil.rmtree(replaced, ignore_errors=True)
