"""A table of results from anywhere: a time column, and columns with the names of a scene, checked and in SI units.

A time that stands in two neighbouring rows is an instant at which quantities jump: the rows are its two sides.
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
_ROUNDING = 1e-9
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
        _, rows, counts = np.unique(self.t, return_index=True, return_counts=True)
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
        if name not in UNITS:
            raise InputError(f"found {shown(name)}; expected units among {', '.join(UNITS)}{did_you_mean(name, UNITS)}")
        kind, size = UNITS[name]
        if kind in sizes:
            raise InputError(f"found {shown(text)}; expected one unit of {kind}")
        sizes[kind] = size
    return sizes


def result_table(frame: str | Path | pd.DataFrame | Mapping[str, Any], scene: Scene,
                 mapping: Mapping[str, str] | None = None, units: Mapping[str, float] | None = None,
                 origin: str = "table") -> ResultTable:
    """Check a table of results of the scene, and give it the scene's names and SI units.

    Parameters
    ----------
    frame
        A row an instant, in order of time; columns by name. The time is the column ``t`` or ``time``, or the index. Or
        a file, .csv or .parquet: the heading of a CSV file may begin with ``#``, its cells are separated by commas,
        semicolons or tabs.
    mapping, units
        As of `parse_map` and `parse_units`. Units are those of all columns: with ``mm`` and ``ms`` velocities are
        mm/ms, and moments N mm.

    Raises
    ------
    ResultError
        For a file that cannot be read, unknown names that resemble the scene's, missing or repeated columns, what is
        no finite number, times that decrease or lie outside of 0 .. t_end, lengths that differ.
    """
    if isinstance(frame, str | Path):
        frame, origin = _read(Path(frame)), str(frame)
    frame = _frame(frame, origin)
    found = list(map(str, frame.columns))
    chosen, left_out, problems = _chosen(found, scene, mapping or {})
    problems = problems or _first((
        (TIME not in chosen, "time", f"the columns {names(found)}", "a column t or time, or --map MINE=t"),
        (len(chosen) < 2, "columns", f"none of the scene's beside {names(found)}",
         f"one or more of {names(columns_of(scene))}; --map MINE=COLUMN renames"),
        (len(frame) < 2, "rows", str(len(frame)), "at least 2")))
    columns: dict[str, np.ndarray] = {}
    for name, (mine, sign) in chosen.items() if not problems else ():
        unit = "s" if name == TIME else unit_of(name, scene)
        values, wrong = _numbers(frame.iloc[:, mine], len(scene.frictional_guides) > 1 and unit in ("N", "N m"))
        problems += [Problem(f"{shortened(found[mine])}, row {row}", *words) for row, *words in wrong]
        columns[name] = sign * _size(unit, units or {}) * values
    if problems or (problems := _time_problems(columns[TIME], scene.t_end)):
        raise ResultError(origin, problems)
    return ResultTable(origin, columns.pop(TIME), columns, tuple(left_out))


def _first(checks: Iterable[tuple[Any, str, str, str]]) -> list[Problem]:
    """The first problem: of each check if it is one, its key, what was found, what was expected."""
    return [Problem(key, found, f"expected {expected}") for wrong, key, found, expected in checks if wrong][:1]


def _read(path: Path) -> pd.DataFrame:
    """All columns of a file."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    wrong, ending = "", path.suffix.lower()
    try:
        size = path.stat().st_size
        if ending not in ENDINGS or not 0 < size <= MAX_FILE_SIZE:
            wrong = f"{shown(path.name)} of {size} bytes"
        elif ending == ".parquet":
            return parquet.read_table(path).to_pandas()
        else:
            with path.open(encoding="utf-8") as file:
                heading = file.readline(2 ** 20)
            # one block: the type of a column is then that of all its rows
            found = csv.read_csv(path, csv.ReadOptions(use_threads=False, block_size=size + 1),
                                 csv.ParseOptions(delimiter=max(",;\t", key=heading.count)))
            return found.rename_columns([name.lstrip("# ").strip() for name in found.column_names]).to_pandas()
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        wrong = shortened(" ".join(str(getattr(error, "strerror", None) or error).split()), 160)
    raise ResultError(str(path), [Problem("file", wrong, f"expected a table, {' or '.join(ENDINGS)}, of at most "
                                                         f"{MAX_FILE_SIZE} bytes")])


def _frame(table: pd.DataFrame | Mapping[str, Any], origin: str) -> pd.DataFrame:
    """A frame whose time is a column."""
    import pandas as pd

    try:
        table = pd.DataFrame(dict(table)) if isinstance(table, Mapping) else table
        if not isinstance(table, pd.DataFrame):
            raise ValueError(f"a {type(table).__name__}")
    except ValueError as error:  # lengths that differ, arrays of two dimensions
        raise ResultError(origin, [Problem("columns", shortened(str(error), 160), "expected a file's name, a DataFrame "
                                           "or a mapping of arrays of one length")]) from None
    has_time = set(TIME_NAMES) & set(table.columns)
    return table.reset_index() if not has_time and table.index.name in TIME_NAMES else table


def _chosen(found: list[str], scene: Scene,
            mapping: Mapping[str, str]) -> tuple[dict[str, tuple[int, int]], list[str], list[Problem]]:
    """Number and sign of the table's column by the scene's name; columns left out; problems of names."""
    known = [TIME, *columns_of(scene)]
    chosen: dict[str, tuple[int, int]] = {}
    left_out, misspelt = [], []
    problems = [Problem("--map", shown(mine), f"expected a column of the table: {names(found)}"
                                              f"{did_you_mean(mine, found)}") for mine in mapping if mine not in found]
    time_is_mapped = {TIME, f"-{TIME}"} & set(mapping.values())
    for number, mine in enumerate(found):
        column = mapping.get(mine, TIME if mine in TIME_NAMES and not time_is_mapped else mine)
        name, sign = column.removeprefix("-"), -1 if column.startswith("-") else 1
        if name in chosen:
            problems.append(Problem(shortened(mine), f"a second column {name}", "expected each once"))
        elif name in known and column != f"-{TIME}":
            chosen[name] = number, sign
        elif mine in mapping and name:
            problems.append(Problem("--map", shown(column), f"expected a column of the scene: {names(known)}"
                                    f"{did_you_mean(name, known)}" + "; times have no other sign" * (name == TIME)))
        elif mine not in mapping and (close := did_you_mean(mine, known)):
            misspelt.append(Problem(shortened(mine), "a name that the scene does not have", f"expected a column of the "
                                    f"scene{close}; --map MINE=COLUMN renames, --map MINE= leaves out"))
        else:
            left_out.append(mine)
    if len(misspelt) > _TYPING_ERRORS:
        problems, misspelt = [], [Problem("columns", names([problem.key for problem in misspelt]), "expected those of "
                                          f"the scene: {names(known)}; is the table of another scene?")]
    return chosen, left_out, problems + misspelt


def _numbers(column: pd.Series, may_be_open: bool) -> tuple[np.ndarray, list[tuple[int, str, str]]]:
    """Numbers of a column, and row (from 1, below the names), found and expected of the first that is none."""
    import pandas as pd

    values = np.full(len(column), np.nan)
    if column.dtype.kind in "iufO":  # neither dates nor truth values
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    words = np.isnan(values) & column.notna().to_numpy()
    wrong = words if words.any() else np.isinf(values) if may_be_open else ~np.isfinite(values)
    if not wrong.any():
        return values, []
    row = int(np.argmax(wrong))
    found = shown(str(column.iloc[row])) if words[row] else "nothing (NaN)" if np.isnan(values[row]) else "inf"
    decimal = re.fullmatch(r"'\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*'", found)
    return values, [(row + 1, found, "expected a finite number" + " with a decimal point" * bool(decimal))]


def _size(unit: str, units: Mapping[str, float]) -> float:
    """Size in SI of a unit such as rad/s²; of norms of mixed units that of their lengths."""
    above, _, below = unit.partition(",")[0].partition("/")
    numerator, denominator = (np.prod([units.get(UNITS[one][0], 1.0) for one in part.rstrip("²").split()])
                              for part in (above, below))
    return float(numerator / denominator ** (1 + below.endswith("²")))


def _time_problems(t: np.ndarray, t_end: float) -> list[Problem]:
    steps, (instants, counts) = np.diff(t), np.unique(t, return_counts=True)
    back, most = int(np.argmax(steps < 0)), int(np.argmax(counts))
    hint = "are they in ms (--units ms)?" if 50 <= t[-1] / t_end <= 2000 else "--set t_end=.. makes the scene longer"
    return _first((
        (steps[back] < 0, f"time, row {back + 2}", f"{t[back + 1]:.9g} s after {t[back]:.9g} s",
         "times in order; two equal ones are the two sides of an event"),
        (len(instants) < 2, "time", f"{t[0]:.9g} s in all {len(t)} rows", "increasing times"),
        (counts[most] > MOST_ROWS, "time", f"{counts[most]} rows at {instants[most]:.9g} s",
         f"at most {MOST_ROWS}; are the times written with too few digits?"),
        (t[0] < -_ROUNDING * t_end, "time, row 1", f"{t[0]:.9g} s", "times from 0 on"),
        (t[-1] > t_end * (1 + _ROUNDING) + np.ptp(instants[-2:]), "time", f"times up to {t[-1]:.9g} s",
         f"the scene's t_end = {t_end:g} s at most; {hint}")))
