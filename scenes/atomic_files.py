"""Atomic writing of files: a crash, an interrupt or a full disk leaves the previous file unchanged."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stiction.scenes import InputError, StictionError


class NotWritten(StictionError):
    """A file could not be written, for example because the disk is full. Its previous content is unchanged."""

    def __init__(self, path: Path, error: OSError):
        super().__init__(
            f"{path}: not written: {error.strerror or error}; what was there before is untouched"
        )


class FolderMissing(InputError):
    """A folder to write to does not exist and cannot be created."""


def partial_name(path: Path) -> Path:
    """Return the name of the temporary file, beside `path` and with its extension, that is written first.

    If a process is killed, its temporary files remain; they may be deleted.
    """
    return path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Replace a file by what is written in a ``with`` block, or leave it unchanged if the block raises.

    Parameters
    ----------
    path
        The file. If it is a symbolic link, its target is replaced.

    Yields
    ------
    Path
        The temporary file that the block must write. It is renamed to `path` at the end of the block.

    Raises
    ------
    NotWritten
        If the block, or the replacement of the file, raises OSError.
    """
    path = Path(path).resolve()
    partial = partial_name(path)
    try:
        yield partial
        # Without fsync, a power failure could leave the new name with blocks that were not written.
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise NotWritten(path, error) from error
    finally:
        # After success it has been renamed; without its folder it never existed.
        with suppress(OSError):
            partial.unlink()


def make_folder(path: Path) -> None:
    """Create a folder and its parents unless it exists.

    Raises
    ------
    FolderMissing
        If it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FolderMissing(
            f"{path}: {error.strerror}; expected a folder, or a name for one that can be made"
        ) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text file atomically; raises the errors of `whole_file`."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
