"""The folder of a run or of a paper: it appears complete or not at all, and never takes the place of something else.

Everything is written to a sibling with ``.partial-<process id>`` in its name, renamed at the end. What an interrupted
run leaves under that name is not a run folder and may be deleted.
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
"""The file that makes a folder a run folder; lists its files under ``"files"``."""


class FolderRefused(StictionError):
    """The folder cannot be written without losing something that is not a report."""


def check_folder(folder: str | Path, main: str, source: Path | None = None) -> None:
    """Raise FolderRefused for a folder that may not be written, before the hours of a campaign.

    Allowed are a new or empty folder, and a previous one of the same kind to which nothing was added: it is replaced.
    Its kind is shown by the file `main`: ``report.md`` of a run, ``paper.pdf`` of a paper. Neither `source`, the folder
    that it is made from, nor one around or in it may be written.
    """
    folder = Path(folder).resolve()
    existing = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    if not existing.is_dir():
        raise FolderRefused(
            f"{existing}: found a file; expected a folder, or nothing, for the report"
        )
    source = source and source.resolve()
    if source and (folder == source or folder in source.parents or source in folder.parents):
        raise FolderRefused(
            f"{folder}: found the folder that it is made from, or one around or in it ({source}); "
            "expected another place"
        )
    if existing == folder and any(folder.iterdir()):
        _check_previous(folder, main)
        existing = folder.parent
    if not os.access(existing, os.W_OK):
        raise FolderRefused(f"{existing}: not writable; expected a place for the report")


def _check_previous(folder: Path, main: str) -> None:
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
    if added := sorted(set(_files(folder)) - listed):
        some = ", ".join(added[:3]) + (" ..." if len(added) > 3 else "")
        raise FolderRefused(
            f"{folder}: found {some} beside a previous report, which would be lost; expected an empty "
            "folder, an unchanged report, or a new name"
        )


def _files(folder: Path) -> list[str]:
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()
    )


def write_provenance(folder: Path, origin: Mapping[str, Any]) -> None:
    """Write `PROVENANCE`, last of all: where the numbers come from, and every file of the folder."""

    def plain(value: Any) -> Any:
        return sorted(value) if isinstance(value, (set, frozenset)) else str(value)

    text = json.dumps(
        {**origin, "files": [*_files(folder), PROVENANCE]},
        indent=2,
        ensure_ascii=False,
        default=plain,
    )
    (folder / PROVENANCE).write_text(text + "\n", encoding="utf-8")


@contextmanager
def run_folder(folder: str | Path, main: str, source: Path | None = None) -> Iterator[Path]:
    """Yield a folder to write to that becomes `folder` when the block ends, and vanishes if the block raises.

    `check_folder` is called before the block, and again before a previous one is replaced. After an OSError of the
    block, NotWritten, what was there before is still there.
    """
    check_folder(folder, main, source)
    folder = Path(folder).resolve()
    partial = partial_name(folder)
    replaced = folder.with_name(f".{folder.name}.replaced-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        yield partial
        check_folder(folder, main, source)
        if folder.exists():
            folder.rename(replaced)
        partial.rename(folder)
    except OSError as error:
        raise NotWritten(folder, error) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if replaced.exists() and not folder.exists():
            replaced.rename(folder)
        shutil.rmtree(replaced, ignore_errors=True)
