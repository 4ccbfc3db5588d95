"""Files that appear whole or not at all: a crash, an interrupt or a full disk leaves what was there before."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stiction.scenes import InputError, StictionError


class NotWritten(StictionError):
    """The system failed during writing: a full disk, a folder that is gone. The old content is still there."""

    def __init__(self, path: Path, error: OSError):
        super().__init__(
            f"{path}: not written: {error.strerror or error}; what was there before is untouched"
        )


class FolderMissing(InputError):
    """A folder to write to is not there and cannot be made."""


def partial_name(path: Path) -> Path:
    """Return the sibling of the same ending that is written to; one that a killed process has left may be deleted."""
    return path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a path to write to that becomes `path` when the block ends, on the disk, and vanishes if the block raises.

    Raises `NotWritten` for an OSError of the block or of the replacement.
    """
    path = Path(path).resolve()  # of a link, the file behind it
    partial = partial_name(path)
    try:
        yield partial
        with partial.open("rb+") as file:
            # lest a power cut leaves the new name with blocks that were not written
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise NotWritten(path, error) from error
    finally:
        with suppress(OSError):  # where there is no folder there is no file either
            partial.unlink()


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, if it is not there; raises `FolderMissing` if it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        words = f"{path}: {error.strerror}; expected a folder, or a name for one that can be made"
        raise FolderMissing(words) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text file, whole or not at all; errors as of `whole_file`."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
