"""Reading of long tables in blocks of rows, from CSV files, Parquet files and DataFrames.

Memory holds one block at a time, unless the table is in memory already.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from stiction.scenes.errors import FileError, Problem
from stiction.scenes.wording import shortened, shown

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = (".csv", ".parquet")
"""Extensions of the files that can be read."""
MAX_FILE_SIZE = 2**30
"""Largest size of a file, bytes."""
BLOCK_SIZE = 2**22
"""Bytes of a CSV file that are read at a time: little compared with the memory of the program, and enough that the cost
of a call is negligible."""
BLOCK_ROWS = 2**16
"""Rows of a Parquet file or a DataFrame that are read at a time, for the same reasons."""
TIME = "t"
TIME_NAMES = (TIME, "time", "Time", "TIME")
"""Names of the time column that need no mapping."""
_MAX_HEADING = 2**20
"""Bytes of the first line of a CSV file that are searched for the delimiter."""
_MAX_MESSAGE = 160
"""Characters of a library's error message that are shown: more than most of them have."""
_ROW_NUMBER = re.compile(r"Row #(\d+)")
"""Where pyarrow's messages contain the number of a line."""


class ResultError(FileError):
    """A table of results cannot be used."""


@dataclass(frozen=True)
class Block:
    """Consecutive rows of a table."""

    begin: int
    """Index of the first row in the table"""
    frame: pd.DataFrame
    """The rows, with all columns of the table"""
    share_read: float
    """Fraction of the table that has been read with this block, above 0, up to 1"""


def read_blocks(path: Path) -> tuple[int, Iterator[Block]]:
    """Open a file.

    Parameters
    ----------
    path
        A CSV or Parquet file.

    Returns
    -------
    max_rows : int
        An upper bound of the number of rows.
    blocks : iterator of Block
        All rows; at least one block.

    Raises
    ------
    ResultError
        If the file cannot be read; the iterator raises it, too.
    """
    ending = path.suffix.lower()
    try:
        size = path.stat().st_size
        if ending not in ENDINGS or not 0 < size <= MAX_FILE_SIZE:
            raise _unreadable(path, f"{shown(path.name)} of {size} bytes")
        if ending == ".parquet":
            return _open_parquet(path)
        return _count_line_ends(path) + 1, _translate_errors(path, _csv_blocks(path, size))
    except OSError as error:
        raise _unreadable(path, str(error.strerror or error)) from None


def frame_blocks(frame: pd.DataFrame) -> Iterator[Block]:
    """Yield the blocks of a table in memory; at least one."""
    rows = len(frame)
    for begin in range(0, max(1, rows), BLOCK_ROWS):
        end = begin + BLOCK_ROWS
        yield Block(begin, frame.iloc[begin:end], min(1.0, end / max(1, rows)))


def to_frame(table: pd.DataFrame | Mapping[str, Any], origin: str) -> pd.DataFrame:
    """Return a table as a DataFrame in which the time is a column and not the index.

    Raises
    ------
    ResultError
        If the table is not a DataFrame or a mapping of columns of equal length; it names `origin`.
    """
    import pandas as pd

    try:
        if isinstance(table, Mapping):
            table = pd.DataFrame(dict(table))
        if not isinstance(table, pd.DataFrame):
            raise ValueError(f"a {type(table).__name__}")
    except ValueError as error:
        # pandas raises it for different lengths and for arrays with two dimensions.
        expected = "expected a file's name, a DataFrame or a mapping of arrays of one length"
        found = shortened(str(error), _MAX_MESSAGE)
        raise ResultError(origin, [Problem("columns", found, expected)]) from None
    has_time_column = bool(set(TIME_NAMES) & set(table.columns))
    if not has_time_column and table.index.name in TIME_NAMES:
        return table.reset_index()
    return table


def _unreadable(path: Path, found: str) -> ResultError:
    """Return the error for a file that cannot be read."""
    expected = f"expected a table, {' or '.join(ENDINGS)}, of at most {MAX_FILE_SIZE} bytes"
    return ResultError(str(path), [Problem("file", found, expected)])


def _translate_errors(path: Path, blocks: Iterator[Block]) -> Iterator[Block]:
    """Yield the blocks of a file, and raise ResultError in place of the errors of the system and of pyarrow."""
    import pyarrow as pa

    try:
        yield from blocks
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        message = str(getattr(error, "strerror", None) or error)
        raise _unreadable(path, _one_line(message)) from None


def _one_line(message: str) -> str:
    """Return a message of a library in one line, without its end if it is long."""
    return shortened(" ".join(message.split()), _MAX_MESSAGE)


def _open_parquet(path: Path) -> tuple[int, Iterator[Block]]:
    """Return the number of rows of a Parquet file, and its blocks."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(path, _one_line(str(error))) from None
    return file.metadata.num_rows, _translate_errors(path, _parquet_blocks(file, str(path)))


def _parquet_blocks(file: Any, origin: str) -> Iterator[Block]:
    """Yield the blocks of an open ``ParquetFile``; `origin` is its name in error messages."""
    import pyarrow as pa

    begin = 0
    for batch in file.iter_batches(BLOCK_ROWS):
        frame = to_frame(pa.Table.from_batches([batch]).to_pandas(), origin)
        yield Block(begin, frame, (begin + len(frame)) / file.metadata.num_rows)
        begin += len(frame)
    if begin == 0:
        # A file without rows has no batches, but names of columns.
        yield Block(0, to_frame(file.schema_arrow.empty_table().to_pandas(), origin), 1.0)


def _count_line_ends(path: Path) -> int:
    r"""Return the number of ends of lines, which are ``\n``, ``\r`` or both; an upper bound if a file mixes them."""
    count = 0
    with path.open("rb") as file:
        while text := file.read(BLOCK_SIZE):
            count += max(text.count(b"\n"), text.count(b"\r"))
    return count


def _csv_blocks(path: Path, size: int) -> Iterator[Block]:
    """Yield the blocks of a CSV file of `size` bytes.

    Each block consists of whole lines and is parsed separately. Therefore a block determines the types of its columns:
    if one block contains a word, the numbers of other blocks remain numbers.
    """
    with path.open("rb") as file:
        heading = file.readline(_MAX_HEADING).decode("utf-8")
        file.seek(0)
        delimiter = max(",;\t", key=heading.count)
        column_names: list[str] = []
        begin = 0
        for text, bytes_read in _whole_lines(file, size):
            if column_names and not text.strip():
                continue
            table = _parse_csv(text, delimiter, column_names, begin)
            if not column_names:
                column_names = table.column_names
            cleaned_names = [name.lstrip("# ").strip() for name in column_names]
            frame = to_frame(table.rename_columns(cleaned_names).to_pandas(), str(path))
            yield Block(begin, frame, 1.0 if bytes_read >= size else bytes_read / size)
            begin += len(frame)


def _whole_lines(file: BinaryIO, size: int) -> Iterator[tuple[bytes, int]]:
    """Yield parts of a file of `size` bytes that end with a line, and the number of bytes up to their end."""
    bytes_read = 0
    while text := file.read(BLOCK_SIZE):
        end = _end_of_last_line(text)
        # A line may be longer than a block.
        while not end and (more := file.read(BLOCK_SIZE)):
            text += more
            end = _end_of_last_line(text)
        if bytes_read + len(text) < size:
            # A \r at the end may be followed by its \n; the whole line is then left to the next part.
            if text[end - 1 :] == b"\r" and end > 1:
                end -= 1
            file.seek(end - len(text), io.SEEK_CUR)
            text = text[:end]
        bytes_read += len(text)
        yield text, bytes_read


def _end_of_last_line(text: bytes) -> int:
    r"""Return the index behind the last ``\n`` or ``\r``; 0 if there is none."""
    return max(text.rfind(b"\n"), text.rfind(b"\r")) + 1


def _parse_csv(text: bytes, delimiter: str, column_names: list[str], begin: int) -> Any:
    """Parse whole lines of a CSV file as a table of pyarrow.

    Parameters
    ----------
    text
        The lines.
    delimiter
        What separates the cells.
    column_names
        Names of the columns; empty if the first of the lines contains them.
    begin
        The number of rows before these lines.
    """
    from pyarrow import csv

    options = csv.ReadOptions(
        use_threads=False, block_size=len(text) + 1, column_names=column_names or None
    )
    try:
        return csv.read_csv(io.BytesIO(text), options, csv.ParseOptions(delimiter=delimiter))
    except ValueError as error:
        # pyarrow counts from the first of these lines; the message shall count from that of the file.
        lines_before = begin + (1 if column_names else 0)
        message = _ROW_NUMBER.sub(lambda row: f"Row #{int(row[1]) + lines_before}", str(error))
        raise type(error)(message) from None
