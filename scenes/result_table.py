"""A table of results from anywhere: a time column, and columns with the names of a scene, checked and in SI units.

A time that stands in two neighbouring rows is an instant at which quantities jump: the rows are its two sides.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.scenes.base_errors import InputError
from stiction.scenes.column_file import FILE_THRESHOLD_BYTES, REAL, ColumnFile
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.errors import FileError, Problem
from stiction.scenes.event_values import Row, rows_of
from stiction.scenes.model import Scene
from stiction.scenes.wording import did_you_mean, names, shortened, shown

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = (".csv", ".parquet")
MAX_FILE_SIZE = 2**30
"""Bytes; a larger file is refused unread."""
BLOCK_SIZE, BLOCK_ROWS = 2**22, 2**16
"""Bytes of a CSV file, and rows of a Parquet file or a DataFrame, that are read at a time: little beside what the
program itself takes, and much beside the cost of a call."""
TIME = "t"
TIME_NAMES = (TIME, "time", "Time", "TIME")
"""Names of the time column that need no mapping."""
MOST_ROWS = 9
"""Rows at one instant, at most: a sample, and the two sides of the events of four guides."""
UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "rad": ("angle", 1.0),
    "deg": ("angle", np.pi / 180),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "N": ("force", 1.0),
    "kN": ("force", 1e3),
    "mN": ("force", 1e-3),
}
"""Unit -> what it measures, and its size in SI."""
_ROW = re.compile(r"Row #(\d+)")
_ROUNDING = 1e-9
"""Part of the scene's t_end by which times may lie outside of 0 .. t_end."""
_MILLISECONDS = (50, 2000)
"""Ratio of the last time to t_end at which times are probably in ms: a run of a twentieth to twice the scene's."""
_TYPING_ERRORS = 5
"""Names that resemble the scene's without being one, at most: more are another scene's."""


class ResultError(FileError):
    """A table of results that cannot be used."""


@dataclass(frozen=True)
class ResultTable:
    """Results of a run as anybody's program gives them, checked.

    `origin`: the file's name, for messages. `t`: seconds, shape (n,), not decreasing, within 0 .. t_end and a last
    step; a time that occurs more than once is an event, from the row before it to the row after it. `columns`: by the
    scene's names, each of shape (n,), in SI units; numbers are finite, but forces may be nan where several guides with
    friction can leave them open. `left_out`: columns that are none of the scene's, and resemble none.
    """

    origin: str
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    left_out: tuple[str, ...] = ()

    @property
    def first(self) -> np.ndarray:
        """Row of the side before of each distinct instant, int (instants,); of 3, 5, .. rows the first is a sample."""
        rows = np.flatnonzero(np.diff(self.t, prepend=-np.inf))
        counts = np.diff(rows, append=len(self.t))
        return rows + ((counts > 1) & (counts % 2 == 1))

    @property
    def last(self) -> np.ndarray:
        """Row of the side after of each distinct instant, int (instants,); the same row where nothing jumps."""
        return np.flatnonzero(np.diff(self.t, append=np.inf))

    def jumps(self, columns: Mapping[str, np.ndarray]) -> Iterator[tuple[float, Row, Row]]:
        """Yield each instant with two sides, and the values of columns before and after it."""
        two = self.first < self.last
        sides = (
            rows_of({name: values[rows[two]] for name, values in columns.items()})
            for rows in (self.first, self.last)
        )
        return zip(self.t[self.first[two]].tolist(), *sides)


def parse_map(texts: Iterable[str]) -> dict[str, str]:
    """Read ``MINE=COLUMN`` as names by the table's names; ``MINE=-COLUMN`` reverses a sign, ``MINE=`` leaves out.

    Raises
    ------
    InputError
        For a text without both ends.
    """
    mapping = {}
    for text in texts:
        mine, equals, column = (part.strip() for part in text.rpartition("="))
        if not (mine and equals):
            raise InputError(
                f"found {shown(text)}; expected MINE=COLUMN such as x1=slider.x, x1=-slider.x for the "
                "other sign, or x1= to leave it out"
            )
        mapping[mine] = column
    return mapping


def parse_units(text: str) -> dict[str, float]:
    """Read ``mm,deg`` as sizes in SI by what they measure; everything else stays in SI.

    Raises
    ------
    InputError
        For an unknown unit, or two of a kind.
    """
    sizes: dict[str, float] = {}
    for name in filter(None, (part.strip() for part in text.split(","))):
        if name not in UNITS:
            raise InputError(
                f"found {shown(name)}; expected units among {', '.join(UNITS)}{did_you_mean(name, UNITS)}"
            )
        kind, size = UNITS[name]
        if kind in sizes:
            raise InputError(f"found {shown(text)}; expected one unit of {kind}")
        sizes[kind] = size
    return sizes


@dataclass(frozen=True)
class _Block:
    """Some rows of a table: the number of the first (from 0), a frame, and the part of the table read with them."""

    begin: int
    frame: pd.DataFrame
    share: float


def result_table(
    frame: str | Path | pd.DataFrame | Mapping[str, Any],
    scene: Scene,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, float] | None = None,
    origin: str = "table",
    *,
    spills: bool = False,
    tell: Callable[[float], None] | None = None,
) -> ResultTable:
    """Check a table of results of the scene, and give it the scene's names and SI units.

    A file is read block by block, and only the scene's columns of it are kept.

    Parameters
    ----------
    frame
        A row an instant, in order of time; columns by name. The time is the column ``t`` or ``time``, or the index. Or
        a file, .csv or .parquet: the heading of a CSV file may begin with ``#``, its cells are separated by commas,
        semicolons or tabs.
    mapping, units
        As of `parse_map` and `parse_units`. Units are those of all columns: with ``mm`` and ``ms`` velocities are
        mm/ms, and moments N mm.
    spills
        Keep the columns of a table of more than `FILE_THRESHOLD_BYTES` bytes in a temporary file, see `ColumnFile`.
    tell
        Is called with the part of a table that has been read, above 0, up to 1.

    Raises
    ------
    ResultError
        For a file that cannot be read, unknown names that resemble the scene's, missing or repeated columns, what is
        no finite number, times that decrease or lie outside of 0 .. t_end, lengths that differ.
    NoRoom
        Where there is no room for the temporary file.
    """
    if isinstance(frame, str | Path):
        origin = str(frame)
        most, blocks = _read(Path(frame))
    else:
        whole = _frame(frame, origin)
        most, blocks = len(whole), _parts(whole)
    # The first block has the names of all columns: which of them are the scene's is decided by it.
    start = next(blocks)
    given = list(map(str, start.frame.columns))
    chosen, left_out, problems = _chosen(given, scene, mapping or {})
    # a file's most rows are a bound: whether there are two is known where the first block is all of it
    fewer = start.share == 1.0 and len(start.frame) < 2
    problems = problems or _first(
        (
            (
                TIME not in chosen,
                "time",
                f"the columns {names(given)}",
                "a column t or time, or --map MINE=t",
            ),
            (
                len(chosen) < 2,
                "columns",
                f"none of the scene's beside {names(given)}",
                f"one or more of {names(columns_of(scene))}; --map MINE=COLUMN renames",
            ),
            (fewer, "rows", str(len(start.frame)), "at least 2"),
        )
    )
    if problems:
        raise ResultError(origin, problems)
    # Block by block: numbers in SI units with their sign, and of each column its first fault.
    is_long = spills and most * len(chosen) * REAL.itemsize > FILE_THRESHOLD_BYTES
    kept: ColumnFile | _Memory = ColumnFile(most) if is_long else _Memory()
    rows, wrong = 0, dict[str, _Wrong]()
    for block in _and_then(start, blocks):
        rows = block.begin + len(block.frame)
        for name, (mine, sign) in chosen.items():
            unit = "s" if name == TIME else unit_of(name, scene)
            may_be_open = len(scene.frictional_joints) > 1 and unit in ("N", "N m")
            values, fault = _numbers(block.frame.iloc[:, mine], may_be_open)
            if fault is not None and (name not in wrong or fault.is_word > wrong[name].is_word):
                wrong[name] = fault.after(block.begin)
            kept.write(name, block.begin, sign * _size(unit, units or {}) * values)
        if tell is not None:
            tell(block.share)
    kept.shorten(rows)
    problems = [
        Problem(
            f"{shortened(given[chosen[name][0]])}, row {fault.row}", fault.found, fault.expected
        )
        for name in chosen
        if (fault := wrong.get(name)) is not None
    ]
    problems = problems or _first([(rows < 2, "rows", str(rows), "at least 2")])
    if problems:
        raise ResultError(origin, problems)
    t = np.array(kept[TIME])
    if problems := _time_problems(t, scene.t_end):
        raise ResultError(origin, problems)
    kept.drop(TIME)
    return ResultTable(origin, t, kept, tuple(left_out))


def _first(checks: Iterable[tuple[Any, str, str, str]]) -> list[Problem]:
    """The first problem: of each check if it is one, its key, what was found, what was expected."""
    return [
        Problem(key, found, f"expected {expected}")
        for wrong, key, found, expected in checks
        if wrong
    ][:1]


class _Memory(dict[str, np.ndarray]):
    """Columns in memory, written block by block like those of a `ColumnFile`."""

    def __init__(self) -> None:
        self._parts: dict[str, list[np.ndarray]] = {}

    def write(self, name: str, begin: int, values: np.ndarray) -> None:
        self._parts.setdefault(name, []).append(values)

    def shorten(self, rows: int) -> None:
        for name in list(self._parts):
            parts = self._parts.pop(name)
            self[name] = parts[0] if len(parts) == 1 else np.concatenate(parts)

    def drop(self, name: str) -> None:
        del self[name]


def _and_then(start: _Block, blocks: Iterator[_Block]) -> Iterator[_Block]:
    yield start
    yield from blocks


def _parts(frame: pd.DataFrame) -> Iterator[_Block]:
    """Blocks of a table in memory; one at least."""
    for begin in range(0, max(1, len(frame)), BLOCK_ROWS):
        part = frame.iloc[begin : begin + BLOCK_ROWS]
        yield _Block(begin, part, min(1.0, (begin + BLOCK_ROWS) / max(1, len(frame))))


def _read(path: Path) -> tuple[int, Iterator[_Block]]:
    """How many rows a file has at most, and its blocks; those of all of its columns."""
    wrong, ending = "", path.suffix.lower()
    try:
        size = path.stat().st_size
        if ending not in ENDINGS or not 0 < size <= MAX_FILE_SIZE:
            wrong = f"{shown(path.name)} of {size} bytes"
        elif ending == ".parquet":
            return _parquet_blocks(path)
        else:
            with path.open("rb") as file:
                ends = sum(
                    max(part.count(b"\n"), part.count(b"\r"))
                    for part in iter(lambda: file.read(BLOCK_SIZE), b"")
                )
            return ends + 1, _explained(path, _csv_blocks(path, size))
    except OSError as error:
        wrong = str(error.strerror or error)
    raise _unreadable(path, wrong)


def _unreadable(path: Path, wrong: str) -> ResultError:
    return ResultError(
        str(path),
        [
            Problem(
                "file",
                wrong,
                f"expected a table, {' or '.join(ENDINGS)}, of at most {MAX_FILE_SIZE} bytes",
            )
        ],
    )


def _explained(path: Path, blocks: Iterator[_Block]) -> Iterator[_Block]:
    """The blocks of a file; a ResultError for what is wrong with it, wherever in it that is found."""
    import pyarrow as pa

    try:
        yield from blocks
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        words = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise _unreadable(path, shortened(words, 160)) from None


def _parquet_blocks(path: Path) -> tuple[int, Iterator[_Block]]:
    """Rows and blocks of a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet

    def blocks(file: Any, rows: int) -> Iterator[_Block]:
        begin = 0
        for batch in file.iter_batches(BLOCK_ROWS):
            part = _frame(pa.Table.from_batches([batch]).to_pandas(), str(path))
            yield _Block(begin, part, (begin + len(part)) / rows)
            begin += len(part)
        if not begin:
            yield _Block(0, _frame(file.schema_arrow.empty_table().to_pandas(), str(path)), 1.0)

    try:
        file = parquet.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(path, shortened(" ".join(str(error).split()), 160)) from None
    rows = file.metadata.num_rows
    return rows, _explained(path, blocks(file, rows))


def _csv_blocks(path: Path, size: int) -> Iterator[_Block]:
    """Blocks of a CSV file: parts of it that end with a line, each read as a file of its own.

    The type of a column is that of a block: where one block has words in it, these alone are no numbers.
    """
    import io

    from pyarrow import csv

    with path.open("rb") as file:
        heading = file.readline(2**20).decode("utf-8")
        file.seek(0)
        delimiter = max(",;\t", key=heading.count)
        column_names: list[str] = []
        begin, read = 0, 0
        while text := file.read(BLOCK_SIZE):
            while not (cut := max(text.rfind(b"\n"), text.rfind(b"\r")) + 1) and (
                more := file.read(BLOCK_SIZE)
            ):
                text += more  # a line longer than a block
            if read + len(text) < size:
                # a \r that ends the block may have its \n in the next one, and a line behind its end goes there too
                cut = cut - 1 if text[cut - 1 :] == b"\r" and cut > 1 else cut
                file.seek(cut - len(text), 1)
                text = text[:cut]
            read += len(text)
            if column_names and not text.strip():
                continue
            options = csv.ReadOptions(
                use_threads=False, block_size=len(text) + 1, column_names=column_names or None
            )
            try:
                table = csv.read_csv(
                    io.BytesIO(text), options, csv.ParseOptions(delimiter=delimiter)
                )
            except ValueError as error:
                # ArrowInvalid: its row is counted from the block's first line
                raise type(error)(
                    _ROW.sub(
                        lambda row: f"Row #{int(row[1]) + begin + bool(column_names)}", str(error)
                    )
                ) from None
            if not column_names:
                column_names = table.column_names
            cleaned = [name.lstrip("# ").strip() for name in column_names]
            part = _frame(table.rename_columns(cleaned).to_pandas(), str(path))
            yield _Block(begin, part, 1.0 if read >= size else read / size)
            begin += len(part)


def _frame(table: pd.DataFrame | Mapping[str, Any], origin: str) -> pd.DataFrame:
    """A frame whose time is a column."""
    import pandas as pd

    try:
        table = pd.DataFrame(dict(table)) if isinstance(table, Mapping) else table
        if not isinstance(table, pd.DataFrame):
            raise ValueError(f"a {type(table).__name__}")
    except ValueError as error:  # lengths that differ, arrays of two dimensions
        raise ResultError(
            origin,
            [
                Problem(
                    "columns",
                    shortened(str(error), 160),
                    "expected a file's name, a DataFrame or a mapping of arrays of one length",
                )
            ],
        ) from None
    has_time = set(TIME_NAMES) & set(table.columns)
    return table.reset_index() if not has_time and table.index.name in TIME_NAMES else table


def _chosen(
    given: list[str], scene: Scene, mapping: Mapping[str, str]
) -> tuple[dict[str, tuple[int, int]], list[str], list[Problem]]:
    """Number and sign of the table's column by the scene's name; columns left out; problems of names."""
    known = [TIME, *columns_of(scene)]
    chosen: dict[str, tuple[int, int]] = {}
    left_out, misspelt = [], []
    problems = [
        Problem(
            "--map",
            shown(mine),
            f"expected a column of the table: {names(given)}{did_you_mean(mine, given)}",
        )
        for mine in mapping
        if mine not in given
    ]
    # Each column of the table is one of the scene's, twice given, wrongly mapped, probably
    # misspelt, or none of them. If the time is mapped, a column of its usual name is another
    # quantity.
    time_is_mapped = {TIME, f"-{TIME}"} & set(mapping.values())
    for number, mine in enumerate(given):
        column = mapping.get(mine, TIME if mine in TIME_NAMES and not time_is_mapped else mine)
        name, sign = column.removeprefix("-"), -1 if column.startswith("-") else 1
        if name in chosen:
            problems.append(
                Problem(shortened(mine), f"a second column {name}", "expected each once")
            )
        elif name in known and column != f"-{TIME}":
            chosen[name] = number, sign
        elif mine in mapping and name:
            problems.append(
                Problem(
                    "--map",
                    shown(column),
                    f"expected a column of the scene: {names(known)}"
                    f"{did_you_mean(name, known)}" + "; times have no other sign" * (name == TIME),
                )
            )
        elif mine not in mapping and (close := did_you_mean(mine, known)):
            misspelt.append(
                Problem(
                    shortened(mine),
                    "a name that the scene does not have",
                    f"expected a column of the "
                    f"scene{close}; --map MINE=COLUMN renames, --map MINE= leaves out",
                )
            )
        else:
            left_out.append(mine)
    # so many are no typing errors: one problem in place of all
    if len(misspelt) > _TYPING_ERRORS:
        problems = []
        misspelt = [
            Problem(
                "columns",
                names([problem.key for problem in misspelt]),
                f"expected those of the scene: {names(known)}; is the table of another scene?",
            )
        ]
    return chosen, left_out, problems + misspelt


@dataclass(frozen=True)
class _Wrong:
    """What is no number in a column: row (from 1, below the names), found, expected; a word or another number."""

    row: int
    found: str
    expected: str
    is_word: bool

    def after(self, rows: int) -> _Wrong:
        """The same of a block that has rows before it."""
        return replace(self, row=self.row + rows)


def _numbers(column: pd.Series, may_be_open: bool) -> tuple[np.ndarray, _Wrong | None]:
    """Numbers of a column, and the first that is none: a word, or where there is no word nothing or infinity."""
    import pandas as pd

    values = np.full(len(column), np.nan)
    if column.dtype.kind in "iufO":  # neither dates nor truth values
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    words = np.isnan(values) & column.notna().to_numpy()
    if words.any():
        wrong = words
    else:
        wrong = np.isinf(values) if may_be_open else ~np.isfinite(values)
    if not wrong.any():
        return values, None
    row = int(np.argmax(wrong))
    if words[row]:
        content = shown(str(column.iloc[row]))
    else:
        content = "nothing (NaN)" if np.isnan(values[row]) else "inf"
    decimal = re.fullmatch(r"'\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*'", content)
    return values, _Wrong(
        row + 1,
        content,
        "expected a finite number" + " with a decimal point" * bool(decimal),
        bool(words[row]),
    )


def _size(unit: str, units: Mapping[str, float]) -> float:
    """Size in SI of a unit such as rad/s²; of norms of mixed units that of their lengths."""
    above, _, below = unit.partition(",")[0].partition("/")
    numerator, denominator = (
        np.prod([units.get(UNITS[factor][0], 1.0) for factor in part.rstrip("²").split()])
        for part in (above, below)
    )
    return float(numerator / denominator ** (1 + below.endswith("²")))


def _time_problems(t: np.ndarray, t_end: float) -> list[Problem]:
    steps, (instants, counts) = np.diff(t), np.unique(t, return_counts=True)
    back, most = int(np.argmax(steps < 0)), int(np.argmax(counts))
    hint = (
        "are they in ms (--units ms)?"
        if _MILLISECONDS[0] <= t[-1] / t_end <= _MILLISECONDS[1]
        else "--set t_end=.. makes the scene longer"
    )
    return _first(
        (
            (
                steps[back] < 0,
                f"time, row {back + 2}",
                f"{t[back + 1]:.9g} s after {t[back]:.9g} s",
                "times in order; two equal ones are the two sides of an event",
            ),
            (len(instants) < 2, "time", f"{t[0]:.9g} s in all {len(t)} rows", "increasing times"),
            (
                counts[most] > MOST_ROWS,
                "time",
                f"{counts[most]} rows at {instants[most]:.9g} s",
                f"at most {MOST_ROWS}; are the times written with too few digits?",
            ),
            (t[0] < -_ROUNDING * t_end, "time, row 1", f"{t[0]:.9g} s", "times from 0 on"),
            (
                t[-1] > t_end * (1 + _ROUNDING) + np.ptp(instants[-2:]),
                "time",
                f"times up to {t[-1]:.9g} s",
                f"the scene's t_end = {t_end:g} s at most; {hint}",
            ),
        )
    )
