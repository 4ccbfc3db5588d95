"""A table of results from anywhere: a time column, and columns with the names of a scene, checked and in SI units.

Read from a CSV or Parquet file (`read_result`) or taken from a DataFrame (`result_table`). A time that stands in two
neighbouring rows is an instant at which quantities jump: the rows are its two sides.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.scenes.base_errors import InputError
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.errors import FileError, Problem
from stiction.scenes.model import Scene
from stiction.scenes.trajectory import rows_of
from stiction.scenes.wording import did_you_mean, names, shortened, shown

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = (".csv", ".parquet")
MAX_FILE_SIZE = 2 ** 30
"""Bytes; a larger file is refused unread."""
TIME = "t"
TIME_NAMES = (TIME, "time", "Time", "TIME")
"""Names of the time column that need no mapping."""
MOST_ROWS = 9
"""Rows at one instant, at most: a sample, and the two sides of the events of four guides."""
UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("length", 1.0), "cm": ("length", 1e-2), "mm": ("length", 1e-3), "rad": ("angle", 1.0),
    "deg": ("angle", np.pi / 180), "s": ("time", 1.0), "ms": ("time", 1e-3), "us": ("time", 1e-6),
    "N": ("force", 1.0), "kN": ("force", 1e3), "mN": ("force", 1e-3)}
"""Unit -> what it measures, and its size in SI."""
_POWERS: Mapping[str, Mapping[str, int]] = {
    "s": {"time": 1}, "m": {"length": 1}, "rad": {"angle": 1}, "m/s": {"length": 1, "time": -1},
    "rad/s": {"angle": 1, "time": -1}, "m/s²": {"length": 1, "time": -2}, "rad/s²": {"angle": 1, "time": -2},
    "N": {"force": 1}, "N m": {"force": 1, "length": 1}, "": {}}
_ROUNDING = 1e-9
_TYPING_ERRORS = 5
"""Names that resemble the scene's without being one, at most: more are another scene's."""
_NUMBER = "expected a finite number"


class ResultError(FileError):
    """A table of results that cannot be used."""


@dataclass(frozen=True)
class ResultTable:
    """Results of a run as anybody's program gives them, checked.

    Attributes
    ----------
    origin : str
        The file's name, for messages.
    t : ndarray, shape (n,)
        Seconds, not decreasing, within 0 .. t_end and a last step; a time that occurs more than once is an instant of
        an event, its first row the side before, its last row the side after.
    columns : Mapping[str, ndarray]
        By the scene's names (`stiction.scenes.columns.COLUMNS`), each of shape (n,), in SI units. Numbers are finite,
        but forces may be nan where several guides with friction can leave them open.
    left_out : tuple of str
        Columns of the table that are none of the scene's, and resemble none.
    """

    origin: str
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    left_out: tuple[str, ...] = ()

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __getitem__(self, column: str) -> np.ndarray:
        return self.columns[column]

    @property
    def first(self) -> np.ndarray:
        """Row of the side before of each distinct instant, int (instants,); of 3, 5, .. rows the first is a sample."""
        rows = np.flatnonzero(np.diff(self.t, prepend=-np.inf))
        counts = np.diff(np.append(rows, len(self.t)))
        return rows + ((counts > 1) & (counts % 2 == 1))

    @property
    def last(self) -> np.ndarray:
        """Row of the side after of each distinct instant, int (instants,); the same row where nothing jumps."""
        return np.flatnonzero(np.diff(self.t, append=np.inf))

    def jumps(self, columns: Mapping[str, np.ndarray]) -> Iterator[tuple[float, dict[str, float], dict[str, float]]]:
        """Yield each instant with two sides, and the values of columns before and after it."""
        two = self.first < self.last
        sides = (rows_of({name: values[rows[two]] for name, values in columns.items()})
                 for rows in (self.first, self.last))
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
            raise InputError(f"found {shown(text)}; expected MINE=COLUMN such as x1=slider.x, x1=-slider.x for the "
                             "other sign, or x1= to leave it out")
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
        kind, size = UNITS.get(name, ("", 0.0))
        if not kind:
            raise InputError(f"found {shown(name)}; expected units among {', '.join(UNITS)}{did_you_mean(name, UNITS)}")
        if kind in sizes:
            raise InputError(f"found {shown(text)}; expected one unit of {kind}")
        sizes[kind] = size
    return sizes


def read_result(path: str | Path, scene: Scene, mapping: Mapping[str, str] | None = None,
                units: Mapping[str, float] | None = None) -> ResultTable:
    """Read and check the results of a run of the scene from a file, .csv or .parquet; see `result_table`.

    The heading of a CSV file may begin with ``#``; its cells are separated by commas, semicolons or tabs.

    Raises
    ------
    ResultError
        With what is wrong in the file.
    """
    return result_table(_read(Path(path), str(path)), scene, mapping, units, str(path))


def result_table(frame: pd.DataFrame | Mapping[str, Any], scene: Scene, mapping: Mapping[str, str] | None = None,
                 units: Mapping[str, float] | None = None, origin: str = "table") -> ResultTable:
    """Check a table of results of the scene, and give it the scene's names and SI units.

    Parameters
    ----------
    frame
        A row an instant, in order of time; columns by name. The time is the column ``t`` or ``time``, or the index.
    mapping
        Name in the table -> the scene's name, as of `parse_map`; names that are the scene's need none.
    units
        Size in SI by what is measured, as of `parse_units`: of all columns, so that with ``mm`` and ``ms`` velocities
        are mm/ms, and moments N mm.

    Raises
    ------
    ResultError
        For unknown names that resemble the scene's, missing or repeated columns, what is no finite number, times that
        decrease or lie outside of 0 .. t_end, lengths that differ.
    """
    frame = _frame(frame, origin)
    chosen, left_out, problems = _chosen(list(map(str, frame.columns)), scene, mapping or {})
    if not problems and TIME not in chosen:
        problems = [Problem("time", f"the columns {names(list(map(str, frame.columns)))}",
                            "expected a column t or time, or --map MINE=t")]
    if not problems and len(chosen) < 2:
        problems = [Problem("columns", f"none of the scene's beside {names(list(map(str, frame.columns)))}",
                            f"expected one or more of {names(columns_of(scene))}; --map MINE=COLUMN renames")]
    if not problems and len(frame) < 2:
        problems = [Problem("rows", str(len(frame)), "expected at least 2")]
    if problems:
        raise ResultError(origin, problems)
    open_forces = len(scene.frictional_guides) > 1
    columns: dict[str, np.ndarray] = {}
    for name, (mine, sign) in chosen.items():
        unit = "s" if name == TIME else unit_of(name, scene)
        values, wrong = _numbers(frame.iloc[:, mine], open_forces and unit in ("N", "N m"))
        problems += [Problem(f"{shortened(str(frame.columns[mine]))}, row {row}", found, expected)
                     for row, found, expected in wrong]
        columns[name] = sign * _size(unit, units or {}) * values
    t = columns.pop(TIME)
    if problems or (problems := list(_time_problems(t, scene.t_end))):
        raise ResultError(origin, problems)
    return ResultTable(origin, t, columns, tuple(left_out))


def _read(path: Path, origin: str) -> pd.DataFrame:
    """All columns of a file."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    try:
        if (ending := path.suffix.lower()) not in ENDINGS:
            raise ResultError(origin, [Problem("file", shown(path.name), f"expected {' or '.join(ENDINGS)}")])
        if not 0 < (size := path.stat().st_size) <= MAX_FILE_SIZE:
            raise ResultError(origin, [Problem("file", f"{size} bytes", f"expected 1 .. {MAX_FILE_SIZE}")])
        if ending == ".parquet":
            return parquet.read_table(path).to_pandas()
        with path.open(encoding="utf-8") as file:
            heading = file.readline(2 ** 20)
        # one block: the type of a column is then that of all its rows
        found = csv.read_csv(path, csv.ReadOptions(use_threads=False, block_size=size + 1),
                             csv.ParseOptions(delimiter=max(",;\t", key=heading.count)))
    except OSError as error:
        wrong, expected = str(error.strerror or error), "expected a file that can be read"
    except UnicodeDecodeError as error:
        wrong, expected = f"byte {error.start} that is not UTF-8", "expected a table as text (CSV)"
    except pa.ArrowException as error:
        wrong, expected = shortened(" ".join(str(error).split()), 160), f"expected a table ({ending})"
    else:
        return found.rename_columns([name.lstrip("# ").strip() for name in found.column_names]).to_pandas()
    raise ResultError(origin, [Problem("file", wrong, expected)])


def _frame(table: pd.DataFrame | Mapping[str, Any], origin: str) -> pd.DataFrame:
    """A frame whose time is a column."""
    import pandas as pd

    if isinstance(table, Mapping):
        try:
            table = pd.DataFrame(dict(table))
        except ValueError as error:  # lengths that differ, arrays of two dimensions
            raise ResultError(origin, [Problem("columns", shortened(str(error), 160),
                                               "expected arrays of one length")]) from None
    if not isinstance(table, pd.DataFrame):
        raise ResultError(origin, [Problem("table", f"a {type(table).__name__}",
                                           "expected a file's name, a DataFrame or a mapping of arrays")])
    if not set(TIME_NAMES) & set(table.columns) and table.index.name in TIME_NAMES:
        return table.reset_index()
    return table


def _chosen(found: list[str], scene: Scene,
            mapping: Mapping[str, str]) -> tuple[dict[str, tuple[int, int]], list[str], list[Problem]]:
    """Number and sign of the table's column by the scene's name; columns left out; problems of names."""
    known = [TIME, *columns_of(scene)]
    chosen: dict[str, tuple[int, int]] = {}
    misspelt: dict[str, str] = {}
    left_out, problems = [], [
        Problem("--map", shown(mine), f"expected a column of the table: {names(found)}{did_you_mean(mine, found)}")
        for mine in mapping if mine not in found]
    mapped = {column.lstrip("-") for column in mapping.values()}
    for number, mine in enumerate(found):
        column = mapping.get(mine, TIME if mine in TIME_NAMES and TIME not in mapped else mine)
        name = column.removeprefix("-")
        if name in chosen:
            problems.append(Problem(shortened(mine), f"a second column {name}", "expected each once"))
        elif name in known:
            chosen[name] = number, -1 if column.startswith("-") else 1
        elif mine in mapping and name:
            problems.append(Problem("--map", shown(name), f"expected a column of the scene: "
                                                          f"{names(known)}{did_you_mean(name, known)}"))
        elif close := did_you_mean(mine, known) if mine not in mapping else "":
            misspelt[mine] = f"expected a column of the scene{close}; --map MINE=COLUMN renames, --map MINE= leaves out"
        else:
            left_out.append(mine)
    if len(misspelt) > _TYPING_ERRORS:
        return chosen, left_out, [Problem("columns", names(misspelt), f"expected those of the scene: {names(known)}; "
                                                                      "is the table of another scene?")]
    return chosen, left_out, [*problems, *(Problem(shortened(mine), "a name that the scene does not have", expected)
                                           for mine, expected in misspelt.items())]


def _numbers(column: pd.Series, may_be_open: bool) -> tuple[np.ndarray, list[tuple[int, str, str]]]:
    """Numbers of a column, and row (from 1, below the names), found and expected of the first that is none."""
    import pandas as pd

    values = np.full(len(column), np.nan)
    if column.dtype.kind in "iufO":  # neither dates nor truth values
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    words = np.isnan(values) & column.notna().to_numpy()
    if words.any():
        row = int(np.argmax(words))
        text = str(column.iloc[row])
        decimal = re.fullmatch(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*", text)
        return values, [(row + 1, shown(text), _NUMBER + " with a decimal point" * bool(decimal))]
    wrong = np.isinf(values) if may_be_open else ~np.isfinite(values)
    if not wrong.any():
        return values, []
    row = int(np.argmax(wrong))
    return values, [(row + 1, "nothing (NaN)" if np.isnan(values[row]) else str(values[row]), _NUMBER)]


def _size(unit: str, units: Mapping[str, float]) -> float:
    """Size in SI of a column's unit; of norms of mixed units that of their lengths."""
    powers = _POWERS.get(unit) or _POWERS.get(unit.partition(",")[0], {})
    return float(np.prod([units.get(kind, 1.0) ** power for kind, power in powers.items()]))


def _time_problems(t: np.ndarray, t_end: float) -> Iterator[Problem]:
    steps = np.diff(t)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0))
        yield Problem(f"time, row {row + 2}", f"{t[row + 1]:.9g} s after {t[row]:.9g} s",
                      "expected times in order; two equal ones are the two sides of an event")
        return
    if not t[-1] > t[0]:
        yield Problem("time", f"{t[0]:.9g} s in all {len(t)} rows", "expected increasing times")
        return
    instants, counts = np.unique(t, return_counts=True)
    if (most := int(np.max(counts))) > MOST_ROWS:
        yield Problem("time", f"{most} rows at {instants[np.argmax(counts)]:.9g} s",
                      f"expected at most {MOST_ROWS}; are the times written with too few digits?")
    if t[0] < -_ROUNDING * t_end:
        yield Problem("time, row 1", f"{t[0]:.9g} s", "expected times from 0 on")
    beyond = t[-1] / t_end
    if t[-1] > t_end * (1 + _ROUNDING) + (instants[-1] - instants[-2]):
        hint = "; are they in ms (--units ms)?" if 50 <= beyond <= 2000 else "; --set t_end=.. makes the scene longer"
        yield Problem("time", f"times up to {t[-1]:.9g} s", f"expected the scene's t_end = {t_end:g} s at most{hint}")
