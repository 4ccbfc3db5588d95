"""Tables of results of any program: their columns are checked and converted to SI units.

The table has a time column, and columns with the names of a scene. If a time occurs in neighbouring rows, quantities
jump at this instant: the first row contains the values before the jump, the last one those after it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.scenes.base_errors import InputError
from stiction.scenes.column_file import FILE_THRESHOLD_BYTES, REAL, ColumnFile
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.errors import Problem
from stiction.scenes.event_values import Row, rows_of
from stiction.scenes.model import Scene
from stiction.scenes.table_blocks import (
    TIME,
    TIME_NAMES,
    Block,
    ResultError,
    frame_blocks,
    read_blocks,
    to_frame,
)
from stiction.scenes.wording import did_you_mean, names, shortened, shown

if TYPE_CHECKING:
    import pandas as pd

MAX_ROWS_AT_INSTANT = 9
"""Largest number of rows with the same time: a sample, and the two sides of events of four guides."""
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
"""Unit -> the quantity that it measures, and its size in SI units."""
_TIME_ROUNDING = 1e-9
"""How far times may lie outside of 0 .. t_end, relative to t_end: they may be written with ten digits."""
_MILLISECOND_RATIO = (50, 2000)
"""Range of the last time divided by t_end in which times are probably milliseconds: such a run takes a twentieth of
t_end to twice t_end."""
_MAX_MISSPELT = 5
"""Largest number of misspelt names that are reported one by one; more of them belong to another scene."""
_MAX_SUGGESTIONS = 4
"""Largest number of columns that are suggested for one heading; more of them are no help."""


@dataclass(frozen=True)
class ResultTable:
    """A checked table of results.

    Attributes
    ----------
    origin : str
        Name of the file, for messages.
    t : ndarray, shape (n,)
        Times, s, not decreasing, from 0 to t_end or one step beyond. At a time that occurs more than once, quantities
        jump from the values of the first to those of the last of its rows.
    columns : Mapping[str, ndarray]
        Columns by the scene's names, each of shape (n,), in SI units. Values are finite, except that a force may be NaN
        if several guides have friction, since it may then not be unique.
    left_out : tuple of str
        Columns of the table that are not columns of the scene, and not misspelt ones.
    """

    origin: str
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    left_out: tuple[str, ...] = ()

    @property
    def rows_before(self) -> np.ndarray:
        """Row with the values before each distinct instant, int, shape (instants,).

        It is the first row of this time. If their number is odd and at least 3, it is the second one: the first row is
        then a sample, and the following pairs are the sides of events.
        """
        rows = np.flatnonzero(np.diff(self.t, prepend=-np.inf))
        counts = np.diff(rows, append=len(self.t))
        begins_with_sample = (counts > 1) & (counts % 2 == 1)
        return rows + begins_with_sample

    @property
    def rows_after(self) -> np.ndarray:
        """Row with the values after each distinct instant, int, shape (instants,).

        It is the last row of this time, and equal to that of `rows_before` if quantities do not jump.
        """
        return np.flatnonzero(np.diff(self.t, append=np.inf))

    def jumps(self, columns: Mapping[str, np.ndarray]) -> Iterator[tuple[float, Row, Row]]:
        """Return the time (s) of each jump, and the values of `columns`, shape (n,), before and after it."""
        is_jump = self.rows_before < self.rows_after
        before = self.rows_before[is_jump]
        after = self.rows_after[is_jump]
        values_before = rows_of({name: values[before] for name, values in columns.items()})
        values_after = rows_of({name: values[after] for name, values in columns.items()})
        return zip(self.t[before].tolist(), values_before, values_after)


def parse_map(texts: Iterable[str]) -> dict[str, str]:
    """Parse texts of the form ``MINE=COLUMN``.

    Parameters
    ----------
    texts
        MINE is a column of the table, COLUMN the scene's name of it. ``MINE=-COLUMN`` reverses the sign, and ``MINE=``
        excludes a column.

    Returns
    -------
    dict
        COLUMN by MINE; with a minus sign, or empty, in these cases.

    Raises
    ------
    InputError
        If a text does not have this form.
    """
    mapping = {}
    for text in texts:
        mine, equals, column = (part.strip() for part in text.rpartition("="))
        if not (mine and equals):
            raise InputError(
                f"found {shown(text)}; expected MINE=COLUMN such as x1=slider.x, x1=-slider.x for "
                "the other sign, or x1= to leave it out"
            )
        mapping[mine] = column
    return mapping


def parse_units(text: str) -> dict[str, float]:
    """Parse a list of units such as ``mm,deg``.

    Returns
    -------
    dict
        The size of the unit in SI units, by the quantity that it measures. Other quantities are in SI units.

    Raises
    ------
    InputError
        If a unit is unknown, or if there are two units of one quantity.
    """
    sizes: dict[str, float] = {}
    for part in text.split(","):
        unit = part.strip()
        if not unit:
            continue
        if unit not in UNITS:
            hint = did_you_mean(unit, UNITS)
            raise InputError(f"found {shown(unit)}; expected units among {', '.join(UNITS)}{hint}")
        quantity, size = UNITS[unit]
        if quantity in sizes:
            raise InputError(f"found {shown(text)}; expected one unit of {quantity}")
        sizes[quantity] = size
    return sizes


def result_table(
    frame: str | Path | pd.DataFrame | Mapping[str, Any],
    scene: Scene,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, float] | None = None,
    origin: str = "table",
    *,
    spills: bool = False,
    tell: Callable[[float], None] | None = None,
    has_map_option: bool = True,
) -> ResultTable:
    """Check a table of results, and convert it to the names of the scene and to SI units.

    A table is read block by block, and only the columns of the scene are kept.

    Parameters
    ----------
    frame
        Columns by name, with one row per instant, in order of time. The time is a column ``t`` or ``time``, or the
        index. Or the name of a file, .csv or .parquet: the heading of a CSV file may begin with ``#``, and its cells
        are separated by commas, semicolons or tabs.
    scene
        The scene whose results these are.
    mapping
        Names of columns, as returned by `parse_map`.
    units
        Units of all columns, as returned by `parse_units`. With ``mm`` and ``ms``, velocities are in mm/ms, and moments
        in N mm.
    origin
        What error messages call a table that is not a file.
    spills
        Keep the columns of a table of more than `FILE_THRESHOLD_BYTES` bytes in a temporary file, see `ColumnFile`.
    tell
        Called with the fraction of the table that has been read, above 0, up to 1.
    has_map_option
        Whether the command that reads the table has the option ``--map``, as `stiction judge` has; error messages then
        mention it.

    Raises
    ------
    ResultError
        If a file cannot be read, if columns are missing, repeated, misspelt or of different lengths, if a value is not
        a finite number, or if times decrease or lie outside of 0 .. t_end.
    NoRoom
        If there is no room for the temporary file.
    """
    if isinstance(frame, str | Path):
        origin = str(frame)
        max_rows, blocks = read_blocks(Path(frame))
    else:
        whole = to_frame(frame, origin)
        max_rows, blocks = len(whole), frame_blocks(whole)
    # Columns are selected by the names in the first block.
    first_block = next(blocks)
    names_in_table = list(map(str, first_block.frame.columns))
    selection = _select_columns(names_in_table, scene, mapping or {}, has_map_option)
    problems = selection.problems or _missing_columns(
        selection.sources, names_in_table, scene, has_map_option
    )
    if not problems and first_block.share_read == 1.0:
        problems = _too_few_rows(len(first_block.frame))
    if problems:
        raise ResultError(origin, problems)
    size_bytes = max_rows * len(selection.sources) * REAL.itemsize
    columns: ColumnFile | _ColumnLists = _ColumnLists()
    if spills and size_bytes > FILE_THRESHOLD_BYTES:
        columns = ColumnFile(max_rows)
    rows, problems = _convert_blocks(
        chain([first_block], blocks), selection.sources, scene, units or {}, columns, tell
    )
    problems = problems or _too_few_rows(rows)
    if problems:
        raise ResultError(origin, problems)
    t = np.array(columns[TIME])
    columns.drop(TIME)
    problems = _time_problems(t, scene.t_end)
    if problems:
        raise ResultError(origin, problems)
    return ResultTable(origin, t, columns, tuple(selection.left_out))


def _missing_columns(
    sources: Mapping[str, _Source],
    names_in_table: Collection[str],
    scene: Scene,
    has_map_option: bool,
) -> list[Problem]:
    """Return the problem of a table without a time, or without any other column of the scene."""
    if TIME not in sources:
        found = f"the columns {names(names_in_table)}"
        remedy = ", or --map MINE=t" if has_map_option else ""
        return [Problem("time", found, f"expected a column t or time{remedy}")]
    if len(sources) < 2:
        found = f"none of the scene's beside {names(names_in_table)}"
        remedy = "; --map MINE=COLUMN renames" if has_map_option else ""
        meant = column_suggestions(names_in_table, columns_of(scene))
        hint = f" ({meant})" if meant else ""
        expected = f"expected one or more of {names(columns_of(scene))}{hint}{remedy}"
        return [Problem("columns", found, expected)]
    return []


def column_suggestions(headings: Iterable[str], scene_names: Iterable[str]) -> str:
    """Return ``"x: did you mean 'slider.x'?"`` for each heading that may be a column of the scene, joined by ``"; "``.

    A heading may be similar to a column, or be its last part alone, such as ``x`` or ``pos_x``.
    """
    candidates = list(scene_names)
    suggestions = []
    for heading in headings:
        if heading in TIME_NAMES:
            continue
        hint = did_you_mean(heading, candidates).strip(" ()")
        last_part = re.split(r"[^A-Za-z]+", heading)[-1].lower()
        same_part = [name for name in candidates if name.rpartition(".")[2].lower() == last_part]
        if not hint and 0 < len(same_part) <= _MAX_SUGGESTIONS:
            hint = f"did you mean {' or '.join(map(shown, same_part))}?"
        if hint:
            suggestions.append(f"{shortened(heading)}: {hint}")
    return "; ".join(suggestions)


def _too_few_rows(rows: int) -> list[Problem]:
    """Return the problem of a table with fewer than two rows."""
    return [Problem("rows", str(rows), "expected at least 2")] if rows < 2 else []


class _ColumnLists(dict[str, np.ndarray]):
    """Columns in memory, which are written block by block like those of a `ColumnFile`.

    The mapping contains them after `shorten` has been called.
    """

    def __init__(self) -> None:
        self._parts: dict[str, list[np.ndarray]] = {}

    def write(self, name: str, begin: int, values: np.ndarray) -> None:
        """Append values to a column; `begin` is the number of values that it has already."""
        self._parts.setdefault(name, []).append(values)

    def shorten(self, rows: int) -> None:
        """Join the blocks of each column; together they have `rows` rows."""
        for name in list(self._parts):
            # Release the blocks of one column before the next one is joined.
            parts = self._parts.pop(name)
            self[name] = parts[0] if len(parts) == 1 else np.concatenate(parts)

    def drop(self, name: str) -> None:
        """Remove a column."""
        del self[name]


@dataclass(frozen=True)
class _Source:
    """The column of the table that supplies a column of the scene.

    Attributes
    ----------
    name : str
        Name in the table.
    place : int
        Index among the columns of the table.
    sign : int
        -1 if the sign of the values is to be reversed, otherwise 1.
    """

    name: str
    place: int
    sign: int


@dataclass(frozen=True)
class _Selection:
    """The columns of a table that are columns of the scene.

    Attributes
    ----------
    sources : Mapping[str, _Source]
        Sources of columns of the scene, by the scene's name.
    left_out : list of str
        Other columns of the table.
    problems : list of Problem
        Wrong names.
    """

    sources: Mapping[str, _Source]
    left_out: list[str]
    problems: list[Problem]


@dataclass(frozen=True)
class _Target:
    """What a heading of a table refers to.

    Attributes
    ----------
    column : str
        Name of a column, which the scene need not have; empty for a heading that is to be left out.
    sign : int
        -1 if the sign of the values is to be reversed, otherwise 1.
    is_mapped : bool
        Whether the user has mapped the heading; otherwise it refers to the column of the same name.
    """

    column: str
    sign: int
    is_mapped: bool


def _resolve(heading: str, mapping: Mapping[str, str], time_is_mapped: bool) -> _Target:
    """Return what a heading of a table refers to.

    If another column is mapped to the time, a column with one of its usual names is left out.
    """
    if heading in mapping:
        # Only a mapped name can reverse a sign: a heading that begins with a minus sign is an unknown name.
        column = mapping[heading]
        sign = -1 if column.startswith("-") else 1
        return _Target(column.removeprefix("-"), sign, is_mapped=True)
    if heading in TIME_NAMES:
        return _Target("" if time_is_mapped else TIME, 1, is_mapped=False)
    return _Target(heading, 1, is_mapped=False)


def _select_columns(
    names_in_table: list[str], scene: Scene, mapping: Mapping[str, str], has_map_option: bool
) -> _Selection:
    """Find the columns of the scene among those of a table; the options are those of `result_table`."""
    scene_names = [TIME, *columns_of(scene)]
    sources: dict[str, _Source] = {}
    left_out: list[str] = []
    misspelt: list[Problem] = []
    problems = _unused_mappings(names_in_table, mapping)
    time_is_mapped = not {TIME, f"-{TIME}"}.isdisjoint(mapping.values())
    for place, heading in enumerate(names_in_table):
        target = _resolve(heading, mapping, time_is_mapped)
        is_reversed_time = target.column == TIME and target.sign < 0
        if target.column in scene_names and not is_reversed_time:
            if target.column in sources:
                found = f"a second column {target.column}"
                problems.append(Problem(shortened(heading), found, "expected each once"))
            else:
                sources[target.column] = _Source(heading, place, target.sign)
        elif target.column and target.is_mapped:
            problems.append(_wrong_target(mapping[heading], target, scene_names))
        elif target.column and did_you_mean(heading, scene_names):
            misspelt.append(_misspelt_heading(heading, scene_names, has_map_option))
        else:
            left_out.append(heading)
    if len(misspelt) > _MAX_MISSPELT:
        # The table is probably that of another scene: one problem replaces all others.
        found = names([problem.key for problem in misspelt])
        expected = (
            f"expected those of the scene: {names(scene_names)}; is the table of another scene?"
        )
        return _Selection(sources, left_out, [Problem("columns", found, expected)])
    return _Selection(sources, left_out, problems + misspelt)


def _unused_mappings(names_in_table: list[str], mapping: Mapping[str, str]) -> list[Problem]:
    """Return a problem for each mapped name that is not a column of the table."""
    problems = []
    for heading in mapping:
        if heading not in names_in_table:
            hint = did_you_mean(heading, names_in_table)
            expected = f"expected a column of the table: {names(names_in_table)}{hint}"
            problems.append(Problem("--map", shown(heading), expected))
    return problems


def _wrong_target(text: str, target: _Target, scene_names: list[str]) -> Problem:
    """Return the problem of a heading that is mapped to `text`, no column of the scene or the reversed time."""
    hint = did_you_mean(target.column, scene_names)
    if target.column == TIME:
        hint += "; times have no other sign"
    expected = f"expected a column of the scene: {names(scene_names)}{hint}"
    return Problem("--map", shown(text), expected)


def _misspelt_heading(heading: str, scene_names: list[str], has_map_option: bool) -> Problem:
    """Return the problem of a heading that is similar to a column of the scene."""
    remedy = "; --map MINE=COLUMN renames, --map MINE= leaves out" if has_map_option else ""
    hint = did_you_mean(heading, scene_names)
    expected = f"expected a column of the scene{hint}{remedy}"
    return Problem(shortened(heading), "a name that the scene does not have", expected)


def _convert_blocks(
    blocks: Iterable[Block],
    sources: Mapping[str, _Source],
    scene: Scene,
    units: Mapping[str, float],
    columns: ColumnFile | _ColumnLists,
    tell: Callable[[float], None] | None,
) -> tuple[int, list[Problem]]:
    """Write the numbers of all blocks to `columns`, in SI units; the other arguments are those of `result_table`.

    Returns
    -------
    rows : int
        The number of rows.
    problems : list of Problem
        One invalid value of each column that has any: the first word, or else the first that is missing or infinite.
    """
    has_open_forces = len(scene.bounded_elements) > 1
    invalid: dict[str, _InvalidValue] = {}
    rows = 0
    for block in blocks:
        rows = block.begin + len(block.frame)
        for name, source in sources.items():
            unit = "s" if name == TIME else unit_of(name, scene)
            may_be_open = has_open_forces and unit in ("N", "N m")
            values, value = _to_numbers(block.frame.iloc[:, source.place], may_be_open)
            if value is not None and (name not in invalid or value.is_word > invalid[name].is_word):
                invalid[name] = replace(value, row=block.begin + value.row)
            columns.write(name, block.begin, source.sign * _size_of(unit, units) * values)
        if tell is not None:
            tell(block.share_read)
    columns.shorten(rows)
    problems = []
    for name, source in sources.items():
        if name in invalid:
            value = invalid[name]
            key = f"{shortened(source.name)}, row {value.row}"
            problems.append(Problem(key, value.found, value.expected))
    return rows, problems


@dataclass(frozen=True)
class _InvalidValue:
    """A value in a column that is not a finite number."""

    row: int
    """Row of the table, from 1, without the heading"""
    found: str
    expected: str
    is_word: bool
    """True if it is not a number at all; False if it is missing or infinite"""


def _to_numbers(column: pd.Series, may_be_open: bool) -> tuple[np.ndarray, _InvalidValue | None]:
    """Convert the values of a column to floats.

    Parameters
    ----------
    column
        The values, shape (n,).
    may_be_open
        Whether values may be missing, since the quantity is not unique.

    Returns
    -------
    values : ndarray, shape (n,)
        The numbers; NaN if there is none.
    invalid : _InvalidValue or None
        The first word; if there are none, the first value that is missing or infinite.
    """
    import pandas as pd

    values = np.full(len(column), np.nan)
    # Dates and truth values could be converted to numbers, too, but are not meant as such.
    if column.dtype.kind in "iufO":
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    is_word = np.isnan(values) & column.notna().to_numpy()
    if is_word.any():
        is_invalid = is_word
    elif may_be_open:
        is_invalid = np.isinf(values)
    else:
        is_invalid = ~np.isfinite(values)
    if not is_invalid.any():
        return values, None
    row = int(np.argmax(is_invalid))
    found = "nothing (NaN)" if np.isnan(values[row]) else str(values[row])
    expected = "expected a finite number"
    if is_word[row]:
        found = shown(str(column.iloc[row]))
        if re.fullmatch(r"'\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*'", found):
            expected += " with a decimal point"
    return values, _InvalidValue(row + 1, found, expected, bool(is_word[row]))


def _size_of(unit: str, units: Mapping[str, float]) -> float:
    """Return the size in SI units of a unit in which a table is given.

    Parameters
    ----------
    unit
        The SI unit of the column, such as ``rad/s²``. A norm of lengths and angles, ``m, rad``, counts as a length.
    units
        Sizes of the units of the table, by quantity, as returned by `parse_units`.
    """
    numerator, _, denominator = unit.partition(",")[0].partition("/")
    exponent = 2 if denominator.endswith("²") else 1
    above = _product_of_sizes(numerator, units)
    below = _product_of_sizes(denominator.removesuffix("²"), units)
    return above / below**exponent


def _product_of_sizes(factors: str, units: Mapping[str, float]) -> float:
    """Return the size of a product of units such as ``N m``; 1 if it is empty."""
    size = 1.0
    for unit in factors.split():
        quantity, _ = UNITS[unit]
        size *= units.get(quantity, 1.0)
    return size


def _time_problems(t: np.ndarray, t_end: float) -> list[Problem]:
    """Return the first problem of the times, shape (n,), s; t_end is the end of the scene, s."""
    steps = np.diff(t)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0))
        found = f"{t[row + 1]:.9g} s after {t[row]:.9g} s"
        expected = "expected times in order; two equal ones are the two sides of an event"
        return [Problem(f"time, row {row + 2}", found, expected)]
    instants, counts = np.unique(t, return_counts=True)
    if len(instants) < 2:
        found = f"{t[0]:.9g} s in all {len(t)} rows"
        return [Problem("time", found, "expected increasing times")]
    largest = int(np.argmax(counts))
    if counts[largest] > MAX_ROWS_AT_INSTANT:
        found = f"{counts[largest]} rows at {instants[largest]:.9g} s"
        expected = (
            f"expected at most {MAX_ROWS_AT_INSTANT}; are the times written with too few digits?"
        )
        return [Problem("time", found, expected)]
    if t[0] < -_TIME_ROUNDING * t_end:
        return [Problem("time, row 1", f"{t[0]:.9g} s", "expected times from 0 on")]
    # The last time may be that of the first step that reaches t_end.
    last_step = instants[-1] - instants[-2]
    if t[-1] > t_end * (1 + _TIME_ROUNDING) + last_step:
        low, high = _MILLISECOND_RATIO
        hint = "--set t_end=.. makes the scene longer"
        if low <= t[-1] / t_end <= high:
            hint = "are they in ms (--units ms)?"
        expected = f"expected the scene's t_end = {t_end:g} s at most; {hint}"
        return [Problem("time", f"times up to {t[-1]:.9g} s", expected)]
    return []
