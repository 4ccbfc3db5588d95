"""Submissions to the friction benchmark: a folder with a table for each scene, and its judgement.

The rules are those of the rule book of the set (``RULES.md`` in `benchmark.FOLDER`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import AfterValidator, Field, StrictStr, ValidationError

from stiction.comparisons.judge.benchmark import NAME, benchmark_scenes
from stiction.comparisons.judge.judgement import (
    FOUND,
    INVENTED,
    MISSED,
    UNRESOLVED,
    Judgement,
    judge,
)
from stiction.comparisons.measures.accuracy import TORQUE_ERROR
from stiction.comparisons.measures.other_parameters import EXPLAINED
from stiction.scenes import FileError, InputError, Problem
from stiction.scenes.columns import columns_of
from stiction.scenes.errors import problems_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model, Name
from stiction.scenes.loading import read_toml
from stiction.scenes.result_table import column_suggestions
from stiction.scenes.table_blocks import ENDINGS
from stiction.scenes.wording import did_you_mean, names

DESCRIPTION = "submission.toml"
"""File that describes a submission."""
STEP_ROUNDING = 1e-6
"""Relative rounding of the distances of rows, which are differences of printed times."""
COLUMNS = (
    "scene",
    "verdict",
    "reason",
    "position_error",
    "position_uncertainty",
    "position_bound",
    "error_column",
    "error_time",
    "velocity_error",
    "velocity_uncertainty",
    "torque_error",
    "torque_uncertainty",
    "effort_bound",
    "stick_phases",
    "stick_found",
    "stick_missed",
    "stick_unresolved",
    "stick_invented",
    "jumps",
    "jumps_read",
    "event_time_error",
    "off_columns",
    "off_factor",
    "off_unit",
    "other_parameter",
    "other_value",
    "explanations",
    "unknown_columns",
    "widest_gap",
    "max_step",
    "table_begin",
    "table_end",
    "t_end",
    "truth_tier",
)
"""Columns of the table of a judged submission, which has a row for each scene of the benchmark, and one for each table
with another name."""


def _check_setting(value: Any) -> Any:
    """Refuse a value that is not one number, text or truth value."""
    if not isinstance(value, (bool, int, float, str)):
        raise InputError("expected a number, a text, true or false")
    return value


Text = Annotated[StrictStr, Field(min_length=1)]
Setting = Annotated[Any, AfterValidator(_check_setting)]


class Verdict(StrEnum):
    """Verdict on the result of a scene; the values are written to tables."""

    WITHIN = "within bounds"
    """No error exceeds its bound, and no stick phase is missed or invented."""
    BEYOND = "beyond bounds"
    """An error exceeds its bound, or a stick phase is missed or invented."""
    OTHER_PARAMETERS = "other parameters"
    """The table is the motion of the scene with another value of one parameter."""
    OTHER_UNITS = "other units"
    """Columns seem to have another unit, sign or origin."""
    INCOMPLETE = "incomplete"
    """The table does not cover the time of the scene."""
    TOO_COARSE = "too coarse"
    """Rows are further apart than the scene allows."""
    NOT_JUDGED = "not judged"
    """The table has no column that depends on forces."""
    NOT_A_TABLE = "not a table"
    """The file cannot be read as a table of this scene."""
    UNKNOWN_SCENE = "unknown scene"
    """The file has the name of no scene of the benchmark."""
    DECLINED = "declined"
    """The description states why there is no table."""
    MISSING = "missing"
    """There is neither a table nor a reason."""


WRONG = (Verdict.BEYOND, Verdict.OTHER_PARAMETERS)
"""Verdicts on results that are not those of the scene."""
UNUSABLE = (
    Verdict.OTHER_UNITS,
    Verdict.INCOMPLETE,
    Verdict.TOO_COARSE,
    Verdict.NOT_JUDGED,
    Verdict.NOT_A_TABLE,
    Verdict.UNKNOWN_SCENE,
)
"""Verdicts on results that cannot be judged as they are."""


class Submission(Model):
    """The description of a submission, ``submission.toml``."""

    benchmark: Literal["friction-benchmark 1"]
    """Name and version of the benchmark"""
    who: Text
    """Who made the submission"""
    engine: Text
    """The solver"""
    version: Text
    """Its version"""
    fidelity: Fidelity
    """``joint``: ideal guides with a friction law; ``contact``: sliders between surfaces"""
    machine: Text
    """The machine, in words"""
    command: Text
    """The command that makes the tables again"""
    settings: dict[Text, Setting] = {}
    """Settings of the solver, under any names"""
    declined: dict[Name, Text] = {}
    """Scenes that the solver cannot represent, and why"""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield declined scenes that the benchmark does not have."""
        scenes = [scene.name for scene in benchmark_scenes()]
        for name in self.declined:
            if name not in scenes:
                yield (
                    f"declined.{name}",
                    self.declined[name],
                    f"no scene of the benchmark; expected one of {names(scenes)}"
                    f"{did_you_mean(name, scenes)}",
                )


@dataclass(frozen=True)
class JudgedSubmission:
    """A submission with the judgements of its tables.

    Attributes
    ----------
    submission : Submission
        Its description.
    table : DataFrame
        One row for each scene of the benchmark, and one for each table with another name, with `COLUMNS`.
    judgements : Mapping[str, Judgement]
        Judgement of each table that could be read, by scene.
    """

    submission: Submission
    table: pd.DataFrame
    judgements: Mapping[str, Judgement]

    def count(self, *verdicts: Verdict) -> int:
        """Return the number of scenes with one of these verdicts."""
        return int(self.table["verdict"].isin(verdicts).sum())

    @property
    def submitted(self) -> int:
        """Number of tables, including those with the name of no scene."""
        return len(self.table) - self.count(Verdict.DECLINED, Verdict.MISSING)

    @property
    def submitted_scenes(self) -> int:
        """Number of scenes with a table."""
        return self.submitted - self.count(Verdict.UNKNOWN_SCENE)


def is_submission(folder: str | Path) -> bool:
    """Return True if a folder contains the description of a submission."""
    return (Path(folder) / DESCRIPTION).is_file()


def read_submission(folder: Path) -> tuple[Submission, dict[str, Path]]:
    """Return the description of a submission, and its tables by scene.

    Tables with the name of no scene are left out; see `unknown_tables`.

    Raises
    ------
    FileError
        If the description is absent or invalid, or if a scene has two tables, or a table and a reason for declining
        it. The error lists all problems.
    """
    file = folder / DESCRIPTION
    if not file.is_file():
        problem = Problem(DESCRIPTION, "no such file", "expected the description of a submission")
        raise FileError(str(folder), [problem])
    try:
        submission = Submission.model_validate(read_toml(file, str(file)))
    except ValidationError as error:
        raise FileError(str(file), problems_of(error, Submission)) from None

    unknown = unknown_tables(folder)
    problems = []
    tables: dict[str, Path] = {}
    for path in _table_files(folder):
        if path in unknown:
            continue
        if path.stem in tables:
            expected = "expected one table for each scene"
            problems.append(Problem(path.name, f"{tables[path.stem].name} beside it", expected))
        elif path.stem in submission.declined:
            expected = f"expected one of both, a table or declined.{path.stem} in {DESCRIPTION}"
            problems.append(Problem(path.name, "a table of a declined scene", expected))
        else:
            tables[path.stem] = path
    if not tables and not unknown and not problems and not submission.declined:
        expected = f"expected SCENE.csv or SCENE.parquet of a scene of {NAME}"
        problems.append(Problem("tables", "none", expected))
    if problems:
        raise FileError(str(folder), problems)
    return submission, tables


def _table_files(folder: Path) -> list[Path]:
    """Return the tables in the folder of a submission, in the order of their names."""
    return [path for path in sorted(folder.iterdir()) if path.suffix in ENDINGS]


def unknown_tables(folder: Path) -> list[Path]:
    """Return the tables in the folder of a submission that have the name of no scene of the benchmark."""
    scenes = [scene.name for scene in benchmark_scenes()]
    return [path for path in _table_files(folder) if path.stem not in scenes]


def judge_submission(
    folder: Path, on_scene: Callable[[str], None] = lambda name: None
) -> JudgedSubmission:
    """Judge all tables of a submission by the rules of the benchmark.

    Parameters
    ----------
    folder : Path
        Folder of the submission.
    on_scene : callable
        Called with the name of each scene when it has been judged.

    Raises
    ------
    FileError
        If the folder is no submission; see `read_submission`.
    """
    submission, tables = read_submission(folder)
    rows = []
    judgements = {}
    for scene in benchmark_scenes():
        row: dict[str, Any] = {
            "scene": scene.name,
            "position_bound": scene.position_bound,
            "effort_bound": scene.effort_bound,
            "max_step": scene.max_step,
        }
        if scene.name in tables:
            try:
                judged = judge(
                    scene.folder,
                    tables[scene.name],
                    rest_speed=scene.rest_speed,
                    has_map_option=False,
                )
            except InputError as error:
                row |= {"verdict": Verdict.NOT_A_TABLE, "reason": _problems_in_one_line(error)}
            else:
                judgements[scene.name] = judged
                row |= _numbers(judged)
                verdict = _verdict(row, judged)
                row |= {"verdict": verdict, "reason": _reason(verdict, row, judged)}
        elif scene.name in submission.declined:
            row |= {"verdict": Verdict.DECLINED, "reason": submission.declined[scene.name]}
        else:
            expected = f"expected {scene.name}.csv, {scene.name}.parquet or declined.{scene.name}"
            row |= {"verdict": Verdict.MISSING, "reason": f"no table; {expected}"}
        rows.append(row)
        on_scene(scene.name)
    rows += [_row_of_unknown_table(path) for path in unknown_tables(folder)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    return JudgedSubmission(submission, table, judgements)


def _row_of_unknown_table(path: Path) -> dict[str, Any]:
    """Return the row of a table that has the name of no scene."""
    hint = did_you_mean(path.stem, [scene.name for scene in benchmark_scenes()])
    return {
        "scene": path.stem,
        "verdict": Verdict.UNKNOWN_SCENE,
        "reason": f"{path.name}: no scene of this name; expected a scene of {NAME}{hint}",
    }


def _numbers(judged: Judgement) -> dict[str, Any]:
    """Return the numbers of a judgement as columns of the table of a submission."""
    summary = judged.tables["summary"].loc[0]
    has_effort = any(f"{drive}.effort" in judged.table.columns for drive in judged.scene.drives)
    phases = judged.tables["stick-phases"]["verdict"].value_counts()
    jumps = judged.tables["jumps"]
    errors = judged.tables["errors"]
    numbers = {
        "position_error": judged.error,
        "position_uncertainty": judged.uncertainty,
        "velocity_error": summary.get("velocity_error"),
        "velocity_uncertainty": summary.get("velocity_uncertainty"),
        "torque_error": summary.get(TORQUE_ERROR),
        "torque_uncertainty": summary.get("torque_uncertainty"),
        "stick_phases": int(phases.reindex([FOUND, MISSED, UNRESOLVED]).sum()),
        "stick_found": int(phases.get(FOUND, 0)),
        "stick_missed": int(phases.get(MISSED, 0)),
        "stick_unresolved": int(phases.get(UNRESOLVED, 0)),
        "stick_invented": int(phases.get(INVENTED, 0)),
        # Without an effort in the table, its jumps were not looked for.
        "jumps": len(jumps) if has_effort else None,
        "jumps_read": _count_jumps_read(jumps) if has_effort else None,
        "event_time_error": summary.get("event_time_error"),
        "widest_gap": judged.widest_gap,
        "table_begin": summary["table_begin"],
        "table_end": summary["table_end"],
        "t_end": judged.scene.t_end,
        "truth_tier": str(judged.truth.tier),
        "unknown_columns": ", ".join(judged.table.left_out),
    }
    position_errors = judged.in_metres("error")
    if position_errors.notna().any():
        worst = errors.loc[position_errors.idxmax()]
        numbers |= {"error_column": worst["column"], "error_time": worst["error_time"]}
    is_off = errors["is_input"].astype(bool)
    if is_off.any():
        # Columns may be off for several causes; the one with most columns is stated.
        [factor, *_] = errors.loc[is_off, "factor"].mode(dropna=False)
        is_same = errors["factor"].eq(factor) | (np.isnan(factor) & errors["factor"].isna())
        numbers |= {
            "off_columns": ", ".join(errors.loc[is_off & is_same, "column"]),
            "off_factor": factor,
            "off_unit": errors.loc[is_off & is_same, "unit"].iloc[0],
        }
    numbers["explanations"] = "; ".join(_explanations(judged))
    named = _named_parameter(judged)
    if named is not None:
        value, factor = named["value"], named["factor"]
        numbers |= {
            "other_parameter": named["hypothesis"],
            "other_value": factor if pd.isna(value) else value,
        }
    return numbers


def _count_jumps_read(jumps: pd.DataFrame) -> int:
    """Return the number of jumps that a table shows; a table of jumps without rows has no other columns."""
    return int(jumps["resolved"].sum()) if len(jumps) else 0


def _explanations(judged: Judgement) -> list[str]:
    """Return the parameters with other values of which the table agrees, each in words."""
    tried = judged.tables["other-parameters"]
    is_explanation = tried["error after"] <= EXPLAINED * tried["error before"]
    return [_parameter_in_words(row) for row in tried[is_explanation].to_dict("records")]


def _named_parameter(judged: Judgement) -> Mapping[Any, Any] | None:
    """Return the row of the only parameter that explains the errors of a table; None if there is none, or several."""
    tried = judged.tables["other-parameters"]
    named = tried[tried["named"].astype(bool)].to_dict("records")
    return named[0] if named else None


def _parameter_in_words(row: Mapping[Any, Any]) -> str:
    """Return the words for a parameter that explains a table, and its value or its factor on the scene's value.

    `row` is a row of the table of other parameters of a judgement.
    """
    words = row["hypothesis"]
    if row["element"]:
        words += f" of {row['element']}"
    if not pd.isna(row["value"]):
        return f"{words} ({row['value']:.4g})"
    return words if pd.isna(row["factor"]) else f"{words} ({row['factor']:.4g} times)"


def _verdict(row: Mapping[str, Any], judged: Judgement) -> Verdict:
    """Return the verdict on a table; what makes its numbers meaningless comes before what they show."""
    if judged.is_misread:
        return Verdict.OTHER_UNITS
    if not judged.is_complete:
        return Verdict.INCOMPLETE
    if judged.widest_gap > row["max_step"] * (1 + STEP_ROUNDING):
        return Verdict.TOO_COARSE
    if judged.error is None or judged.says_nothing or _lacks_effort(row):
        return Verdict.NOT_JUDGED
    if "other_parameter" in row:
        return Verdict.OTHER_PARAMETERS
    if _excesses(row):
        return Verdict.BEYOND
    return Verdict.WITHIN


def _lacks_effort(row: Mapping[str, Any]) -> bool:
    """Return True if the drives prescribe the motion, and the table has none of their efforts."""
    return row["effort_bound"] is not None and pd.isna(row["torque_error"])


UNITS: Mapping[tuple[float, str], str] = {
    (1e3, "m"): "millimetres in place of metres?",
    (1e-3, "m"): "kilometres in place of metres?",
    (1e3, "N"): "mN in place of N?",
    (1e-3, "N"): "kN in place of N?",
    (1e3, "N m"): "N mm in place of N m?",
    (1e-3, "N m"): "kN m in place of N m?",
    (180 / np.pi, "rad"): "degrees in place of radians?",
}
"""Likely units of columns by their factor on the truth, and by the unit of the truth without the time."""
MOST_DIGITS = 17
"""Significant digits that distinguish any two numbers."""
OTHER_SIGN = -1.0
"""Factor of columns with the other sign."""


def _reason(verdict: Verdict, row: Mapping[str, Any], judged: Judgement) -> str:
    """Return the reason for a verdict as a sentence; empty for a result within bounds."""
    if verdict is Verdict.OTHER_UNITS:
        return f"{row['off_columns']}: {_misreading(row['off_factor'], row['off_unit'])}"
    if verdict is Verdict.INCOMPLETE:
        return (
            f"goes from {row['table_begin']:g} to {row['table_end']:g} s; "
            f"expected 0 to {row['t_end']:g} s"
        )
    if verdict is Verdict.TOO_COARSE:
        return f"rows {row['widest_gap']:.4g} s apart; expected at most {row['max_step']:g} s"
    if verdict is Verdict.NOT_JUDGED:
        if _lacks_effort(row):
            efforts = ", ".join(f"{drive}.effort" for drive in judged.scene.drives)
            reason = (
                f"no column {efforts}: the motors prescribe the motion, which shows nothing else"
            )
        else:
            held = f" ({', '.join(judged.held)}: prescribed)" if judged.held else ""
            reason = f"no position that depends on forces{held}; expected one or more"
        return "; ".join([reason, *unknown_columns(judged)])
    excesses = _excesses(row)
    named = _named_parameter(judged)
    if named is not None:
        return "; ".join([_agreement([_parameter_in_words(named)]), *excesses])
    if excesses and row["explanations"]:
        return "; ".join([*excesses, _agreement(_explanations(judged))])
    return "; ".join(excesses)


def unknown_columns(judged: Judgement) -> list[str]:
    """Return a sentence about the columns of a table that the scene does not have; empty if there are none."""
    left_out = judged.table.left_out
    if not left_out:
        return []
    absent = [name for name in columns_of(judged.scene) if name not in judged.table.columns]
    suggestions = column_suggestions(left_out, absent)
    hint = f" ({suggestions})" if suggestions else ""
    return [f"the scene has no column {names(left_out)}{hint}"]


def _misreading(factor: float, unit: str) -> str:
    """Return the words for a factor on the truth, NaN for another origin, of columns with the unit `unit`."""
    if np.isnan(factor):
        return "off by a constant: another origin or point of the body?"
    if factor == OTHER_SIGN:
        return "the other sign?"
    # Velocities are converted together with lengths and angles.
    cause = UNITS[factor, unit.partition("/")[0]]
    return f"{factor:.4g} times the truth: {cause}"


def _agreement(parameters: Sequence[str]) -> str:
    """Return the words for the other parameters with which a table agrees."""
    return f"the table agrees with {' or '.join(parameters)}, in place of the scene's values"


def _problems_in_one_line(error: InputError) -> str:
    """Return what is wrong with a table, without the name of the table."""
    if isinstance(error, FileError):
        return "; ".join(str(problem) for problem in error.problems)
    return " ".join(str(error).split())


def _above(value: float, bound: float) -> str:
    """Return a number that exceeds a bound, with at least two digits and as many as show that it does."""
    digits = 2
    while float(text := f"{value:.{digits}g}") <= bound and digits < MOST_DIGITS:
        digits += 1
    return text


def _excesses(row: Mapping[str, Any]) -> list[str]:
    """Return what is beyond the bounds, each in words."""
    excesses = []
    if row["position_error"] > row["position_bound"]:
        excesses.append(
            f"position error {_above(row['position_error'], row['position_bound'])} m ({row['error_column']} at t = "
            f"{row['error_time']:.4g} s); expected at most {row['position_bound']:g} m"
        )
    if row["effort_bound"] is not None:
        # Where within a row's distance an effort jumps is not known.
        certain_error = row["torque_error"] - row["torque_uncertainty"]
        if certain_error > row["effort_bound"]:
            excesses.append(
                f"mean error of efforts {row['torque_error']:.2g}, of which {row['torque_uncertainty']:.2g} "
                f"may be due to the distance of the rows; expected at most {row['effort_bound']:g}"
            )
    if row["stick_missed"]:
        excesses.append(
            f"{row['stick_missed']} of {row['stick_phases']} stick phases missed: a joint moves that is at rest "
            "in the truth"
        )
    if row["stick_invented"]:
        plural = "s" if row["stick_invented"] > 1 else ""
        excesses.append(
            f"{row['stick_invented']} stick phase{plural} invented: a joint is at rest that slips in the truth"
        )
    return excesses
