"""Settings of the engines: errors, drift and engine time when one setting at a time is changed from its default.

``data/engine_settings.toml`` lists the settings. Every choice, and the adapter's default, runs with every step. On a
scene, a choice is Pareto-optimal unless another one is better: clearly faster with no larger error, or no slower with
no larger error and clearly more accurate in one. It is clearly faster if its slowest repeat is faster than the other's
fastest. An error is larger than another from a ratio of `MORE` on, where errors below the truth's uncertainty count
as that uncertainty. Drift counts as an error if it exceeds the rounding of a coordinate, even if it is small against
the position error: drift that accumulates in each step becomes larger in longer runs than those of this study.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import succeeded, with_columns
from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.presentation import (
    BETTER,
    CHOSEN,
    OTHER,
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    TableView,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.variants import OWN_CPU, Variant, scaled
from stiction.comparisons.measures.drift import rounding_over
from stiction.comparisons.measures.work_precision import HIGH, LOW, Timed, work_precision
from stiction.engines.status import Status
from stiction.scenes import InputError, Trajectory, load_scene
from stiction.scenes.fidelity import Fidelity

DEFAULT = "default"
"""Value of the column `SETTING` for runs in which no setting is changed."""
ERROR = "position_error"
"""Column: position error, m."""
SUBJECT = "subject"
"""Column: label of the `Subject` whose setting is changed."""
SETTING = "setting"
"""Column: the changed setting with its value, or `DEFAULT`."""
ON_FRONT = "on_front"
"""Column: whether the choice is Pareto-optimal on the scene."""
DRIFT = "position_drift"
"""Column: largest residual of the constraints of all joints and drives, see `stiction.comparisons.measures.drift`."""
ROUNDING = "drift_rounding"
"""Column: bound of the drift that rounding makes in the run."""
JUDGED = {ERROR: "position_uncertainty", "torque_error": "torque_uncertainty", DRIFT: ROUNDING}
"""Columns of the errors by which choices are compared, and of their uncertainties.

Scenes without a drive have no torque error.
"""
FACTOR = "time_of_fastest"
"""Column: time of the default divided by that of the fastest choice with no larger errors."""
EVERYWHERE = "better_everywhere"
"""Column: whether a choice is better than the default everywhere, or the choices for which this holds."""
TIME_RATIO = "time_ratio"
"""Column: geometric mean of the times of a choice relative to the default."""
TIME_RATIO_ENDS = f"{TIME_RATIO}, least", f"{TIME_RATIO}, most"
"""Columns: smallest and largest time of a choice relative to the default."""
ERROR_RATIO = "largest_error_ratio"
"""Column: largest error of a choice relative to the default."""
FAILED = "failed_runs"
"""Column: number of scenes and steps on which a choice failed and the default did not."""
MORE = 1.01
"""Ratio from which on one error counts as larger than another.

The errors that a converged iterative solver leaves differ by less.
"""
ENDS = 0.5, 200.0
"""Limits of the axis of relative errors; values beyond are drawn at the edge."""
NO_DEFAULT: Mapping[str, object] = {
    "compared": 0,
    "on_front": 0,
    "better": [],
    "scene": None,
    "ends": ENDS,
}
"""Rows for the text if no run with default settings succeeded."""
REPEATS_ON_ONE_SCENE = 3
"""Rounds of timing on a single scene, unless the scope states a number: enough to see which intervals overlap."""


@dataclass(frozen=True)
class Subject:
    """A method of an engine whose settings are tried.

    Attributes
    ----------
    engine : str
        Name of the engine.
    fidelity : Fidelity
        Whether guides are joints or contacts.
    choices : Mapping[str, Sequence]
        Values to try, by setting. Only one setting at a time differs from its default.
    fixed : Mapping[str, Any]
        Settings that select the method, such as the engine's own friction instead of the adapter's.
    name : str
        Name of the method; the values of `fixed` if empty.
    """

    engine: str
    fidelity: Fidelity
    choices: Mapping[str, Sequence[Any]]
    fixed: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""

    @property
    def label(self) -> str:
        """Name of the subject in tables: engine, fidelity and method."""
        method = [self.name] if self.name else [str(value) for value in self.fixed.values()]
        return ", ".join([self.engine, self.fidelity, *method])

    def variants(self, steps: Sequence[float]) -> list[Variant]:
        """Return the variants with the default and with each choice, to be run with some steps (s)."""
        default = Variant(
            f"{self.label}: {DEFAULT}",
            self.engine,
            "dt",
            tuple(steps),
            self.fidelity,
            dict(self.fixed),
            subject=self.label,
            setting=DEFAULT,
        )
        variants = [default]
        for name, values in self.choices.items():
            for value in values:
                setting = f"{name}={value}"
                variant = replace(
                    default,
                    label=f"{self.label}: {setting}",
                    settings={**self.fixed, name: value},
                    setting=setting,
                    changed=name,
                )
                variants.append(variant)
        return variants


@dataclass(frozen=True)
class Trials:
    """The content of ``data/engine_settings.toml``.

    Attributes
    ----------
    steps : tuple of float
        Steps of all runs, s; for each scene they are multiplied by its `time_factor`.
    scenes : Mapping[str, float]
        Duration of a run, s, by the name of the scene.
    subjects : tuple of Subject
        The methods whose settings are tried.
    """

    steps: tuple[float, ...]
    scenes: Mapping[str, float]
    subjects: tuple[Subject, ...]


def load_study() -> Trials:
    """Read ``data/engine_settings.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "engine_settings.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return Trials(
        tuple(data["steps"]),
        data["scenes"],
        tuple(Subject(**subject) for subject in data["subjects"]),
    )


def settings_table(timed: Timed) -> pd.DataFrame:
    """Return the rows of `work_precision` for the choices on a scene, with the columns of this study.

    These are `DRIFT`, `ROUNDING`, `SUBJECT`, `SETTING` and `ON_FRONT`.
    """
    drifts = [drift_and_rounding(record.trajectory) for record in timed.records]
    table = timed.table.join(pd.DataFrame(drifts, columns=[DRIFT, ROUNDING]))
    variants = {record.key: record.variant for record in timed.records}
    table[SUBJECT] = [variants[key].subject for key in table["key"]]
    table[SETTING] = [variants[key].setting for key in table["key"]]
    table[ON_FRONT] = False
    for _, rows in _measured(table).groupby(SUBJECT, sort=False):
        fastest = rows[LOW].to_numpy(float)
        slowest = rows[HIGH].to_numpy(float)
        table.loc[rows.index, ON_FRONT] = front(_errors(rows), fastest, slowest)
    return table


def drift_and_rounding(trajectory: Trajectory | None) -> dict[str, float]:
    """Return the columns `DRIFT` and `ROUNDING` of a run; empty for a run that failed."""
    if trajectory is None:
        return {}
    return {DRIFT: float(np.max(trajectory["drift.position"])), ROUNDING: rounding_over(trajectory)}


def front(errors: np.ndarray, fastest: np.ndarray, slowest: np.ndarray) -> np.ndarray:
    """Return a mask of the Pareto-optimal points: those than which no other point is better.

    Parameters
    ----------
    errors : ndarray, shape (errors, points)
        Errors that all count.
    fastest, slowest : ndarray, shape (points,)
        Ends of the intervals of the times.

    Returns
    -------
    ndarray of bool, shape (points,)
    """
    # Compare each point (second axis) with each other one (third axis).
    point, other = errors[:, :, None], errors[:, None, :]
    has_no_larger_error = _no_larger(other, point)
    has_smaller_error = _smaller(other, point)
    is_faster = slowest[None] < fastest[:, None]
    is_no_slower = fastest[None] <= slowest[:, None]
    is_better = has_no_larger_error & (is_faster | has_smaller_error & is_no_slower)
    return ~np.any(is_better, axis=1)


def _no_larger(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return where none of the errors (first axis) is larger than the corresponding other one."""
    return np.all(errors <= MORE * others, axis=0)


def _smaller(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return where at least one of the errors (first axis) is smaller than the corresponding other one.

    Both may be 0, where nothing moves: then neither is smaller.
    """
    return np.any((MORE * errors <= others) & (errors < others), axis=0)


def _measured(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of runs that reached their end and have a position error."""
    table = with_columns(table, ERROR)
    return table[succeeded(table) & table[ERROR].notna()]


def _errors(rows: pd.DataFrame) -> np.ndarray:
    """Return the errors that are `JUDGED`, at least their uncertainties, shape (errors, rows).

    An error that no row has is 0; one that only some rows have is infinite in the others.
    """
    errors = []
    for error, uncertainty in JUDGED.items():
        values = rows.reindex(columns=[error, uncertainty]).astype(float)
        is_known = values[error].notna()
        substitute = np.inf if is_known.any() else 0.0
        errors.append(values.max(axis="columns").where(is_known, substitute).to_numpy())
    return np.array(errors)


def ranks_of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """Compare the default of each subject with its other choices, over all scenes.

    Parameters
    ----------
    table : DataFrame
        Rows of `settings_table` for all scenes.

    Returns
    -------
    DataFrame
        A row per subject: `SUBJECT`; `ON_FRONT`, the number of scenes and steps on which the default is
        Pareto-optimal, as ``8 of 12``; `EVERYWHERE`, the choices of `better_everywhere`, or ``none``. The other
        columns describe the largest gain in time at no larger errors, as `_gains` yields it; they are empty if the
        default is among the fastest choices everywhere.
    """
    rows = []
    for subject, runs in _measured(table).groupby(SUBJECT, sort=False):
        defaults = runs[runs[SETTING] == DEFAULT]
        if defaults.empty:
            continue
        on_front = int(defaults[ON_FRONT].sum())
        gains = list(_gains(runs))
        largest_gain = max(gains, key=lambda gain: gain[FACTOR]) if gains else {}
        rows.append(
            {
                SUBJECT: subject,
                ON_FRONT: f"{on_front} of {len(defaults)}",
                EVERYWHERE: ", ".join(better_everywhere(runs)) or "none",
                **largest_gain,
            }
        )
    return pd.DataFrame(
        rows, columns=[SUBJECT, ON_FRONT, EVERYWHERE, FACTOR, "choice", "scene", "step"]
    )


def _gains(runs: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield, for a subject, what the fastest choice gains on each scene and step of the default.

    The fastest choices are those with no larger errors than which none is clearly faster; they may have another step.
    Nothing is yielded where the default is one of them.

    Yields
    ------
    dict
        `FACTOR`; ``choice``, the fastest choices, with their step if it is another; ``scene``; ``step``, of the
        default.
    """
    for scene, rows in runs.groupby("scene", sort=False):
        errors = _errors(rows)
        for place in np.flatnonzero(rows[SETTING] == DEFAULT):
            default = rows.iloc[place]
            rivals = rows[_no_larger(errors, errors[:, [place]])]
            best = rivals.loc[rivals[OWN_CPU].idxmin()]
            fastest = list(dict.fromkeys(rivals.loc[rivals[LOW] <= best[HIGH], SETTING]))
            if DEFAULT in fastest:
                continue
            other_step = "" if best["step"] == default["step"] else f" at {best['step']:g} s"
            yield {
                FACTOR: default[OWN_CPU] / best[OWN_CPU],
                "choice": ", ".join(fastest) + other_step,
                "scene": scene,
                "step": default["step"],
            }


def better_everywhere(table: pd.DataFrame) -> list[str]:
    """Return the choices of a subject that are better than its default `EVERYWHERE`."""
    choices = against_defaults(table)
    return list(choices.loc[choices[EVERYWHERE], SETTING])


def against_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """Compare each choice with its subject's default, over all scenes and steps on which both succeeded.

    Returns
    -------
    DataFrame
        A row per subject and setting: `SUBJECT`, `SETTING`; `TIME_RATIO`, the geometric mean of the times relative to
        the default, with the smallest and the largest under `TIME_RATIO_ENDS`; `ERROR_RATIO`, the largest relative
        error of those that are `JUDGED`, infinite where the default has none; `FAILED`, the number of scenes and
        steps on which only the default succeeded; `EVERYWHERE`, whether the choice is no worse in errors and time on
        every scene and step, and clearly better on one.
    """
    rows = []
    for subject, runs in _measured(table).groupby(SUBJECT, sort=False):
        runs = runs.set_index(["scene", "step"])
        defaults = runs[runs[SETTING] == DEFAULT]
        for setting, choices in runs.groupby(SETTING, sort=False):
            shared = defaults.index.intersection(choices.index)
            if shared.empty:
                continue
            failed = len(defaults) - len(shared)
            comparison = _comparison(choices.loc[shared], defaults.loc[shared])
            if setting == DEFAULT or failed:
                comparison[EVERYWHERE] = False
            rows.append({SUBJECT: subject, SETTING: setting, FAILED: failed, **comparison})
    columns = [SUBJECT, SETTING, TIME_RATIO, *TIME_RATIO_ENDS, ERROR_RATIO, FAILED, EVERYWHERE]
    return pd.DataFrame(rows, columns=columns)


def _comparison(choices: pd.DataFrame, defaults: pd.DataFrame) -> dict[str, Any]:
    """Return the columns of `against_defaults` that compare the runs of a choice with those of the default.

    Both tables have the same scenes and steps in the same order. `EVERYWHERE` is about these alone.
    """
    # All errors together, so that one that only some of the runs have is infinite in the others.
    errors, default_errors = np.split(_errors(pd.concat([choices, defaults])), 2, axis=1)
    error_ratios = np.divide(
        errors,
        default_errors,
        out=np.where(errors > default_errors, np.inf, 1.0),
        where=(default_errors > 0) & np.isfinite(default_errors),
    )
    times = choices[OWN_CPU] / defaults[OWN_CPU]
    is_no_worse = _no_larger(errors, default_errors) & (choices[LOW] <= defaults[HIGH])
    is_better = _smaller(errors, default_errors) | (choices[HIGH] < defaults[LOW])
    least, most = TIME_RATIO_ENDS
    return {
        TIME_RATIO: float(np.exp(np.log(times).mean())),
        least: times.min(),
        most: times.max(),
        ERROR_RATIO: float(error_ratios.max()),
        EVERYWHERE: bool(is_no_worse.all() and is_better.any()),
    }


def _reason_against(scope: Scope) -> str:
    """Return why a campaign on other scenes than the paper's does not try settings."""
    if scope.is_of_paper or not scope.is_campaign or extent(scope.depth).settings:
        return ""
    return "settings are tried with --full only; `stiction compare settings` tries them, too"


def plan(scope: Scope) -> Comparison[Tables] | None:
    """Plan all settings on all scenes of the trials, or on the scenes of the scope if these are not the paper's cases.

    In a campaign the depth decides whether there are any. None without scenes, and if no engine takes part. The rows
    of a subject follow each other in the table.

    Raises
    ------
    InputError
        If the scope has a single scene and names an engine of which the study has no settings.
    """
    trials, limits = load_study(), extent(scope.depth)
    engines = scope.engines
    if len(scope.scenes) == 1 and not scope.is_campaign:
        # `stiction compare` on one scene: an empty list of engines stands for all.
        engines = engines or None
        _check_engines(engines, trials)
        scenes = [(scope.scenes[0], scope.t_end)]
        repeats = scope.repeats or REPEATS_ON_ONE_SCENE
    else:
        scenes = []
        if limits.settings and scope.is_of_paper:
            scenes = [(load_scene(name), t_end) for name, t_end in trials.scenes.items()]
        elif limits.settings:
            scenes = [(scene, scope.t_end) for scene in scope.scenes]
        repeats = scope.repeats or limits.repeats
    variants = [
        variant
        for subject in trials.subjects
        if engines is None or subject.engine in engines
        for variant in subject.variants(trials.steps)
    ]
    if not scenes or not variants:
        return None
    places = {subject.label: place for place, subject in enumerate(trials.subjects)}

    def combine(tables: list[pd.DataFrame]) -> Tables:
        ordered = pd.concat(tables).sort_values(
            SUBJECT, key=lambda labels: labels.map(places), kind="stable", ignore_index=True
        )
        return Tables({"settings": ordered})

    parts = []
    for scene, t_end in scenes:
        scaled_variants = scaled(variants, scene, t_end)
        timed = work_precision(scene, scaled_variants, t_end=t_end, repeats=repeats)
        parts.append(timed.then(settings_table))
    return side_by_side(parts, combine)


def _check_engines(engines: Sequence[str] | None, trials: Trials) -> None:
    """Raise InputError if the trials have no settings of one of the engines."""
    with_settings = dict.fromkeys(subject.engine for subject in trials.subjects)
    unknown = sorted(set(engines or ()) - set(with_settings))
    if unknown:
        raise InputError(
            f"engines: found {unknown[0]!r}; expected some of {', '.join(with_settings)}, "
            "which the study has settings of"
        )


def present(results: Results) -> Presentation:
    """Present how often defaults are Pareto-optimal in error and time, and the choices that are better everywhere."""
    table = results.table("settings")
    if table.empty or not {SUBJECT, SETTING, "status"} <= set(table):
        return Presentation()
    ranks = ranks_of_defaults(table)
    if ranks.empty:
        return Presentation(rows=NO_DEFAULT)
    choices = against_defaults(table)
    defaults = table[table[SETTING] == DEFAULT]
    scenes = list(table["scene"].unique())
    rows = {
        "compared": int((defaults["status"] == Status.OK).sum()),
        "on_front": int(defaults[ON_FRONT].eq(True).sum()),
        "better": [
            {"subject": subject, "settings": list(better[SETTING])}
            for subject, better in choices[choices[EVERYWHERE]].groupby(SUBJECT, sort=False)
        ],
        "scene": scenes[0] if len(scenes) == 1 else None,
        "ends": ENDS,
    }
    return Presentation(
        rows=rows,
        tables=[_ranks_view(results, ranks, table), _choices_view(choices, table)],
        figures=[_figure(choices)],
    )


def _ranks_view(results: Results, ranks: pd.DataFrame, table: pd.DataFrame) -> TableView:
    """Return the table that compares the default of each subject with its other choices."""
    ranks = ranks.assign(where=ranks["scene"].map(results.title_of, na_action="ignore"))
    columns = (
        Column(SUBJECT, "engine"),
        Column(ON_FRONT, "default Pareto-optimal"),
        Column(EVERYWHERE),
        Column(FACTOR, "largest gain in time", form=".2g"),
        Column("choice", "choice with this gain"),
        Column("where", "scene"),
        Column("step", unit="s", form="g"),
    )
    rows = [(row, table[table[SUBJECT] == row[SUBJECT]]) for row in ranks.to_dict("records")]
    return view("settings", rows, columns)


def _choices_view(choices: pd.DataFrame, table: pd.DataFrame) -> TableView:
    """Return the table of all choices relative to their defaults."""
    columns = (
        Column(SUBJECT, "engine"),
        Column(SETTING),
        Column(TIME_RATIO, form=".2g"),
        Column(TIME_RATIO_ENDS[0], "least", form=".2g"),
        Column(TIME_RATIO_ENDS[1], "most", form=".2g"),
        Column(ERROR_RATIO, form=".2g"),
        Column(FAILED),
    )
    rows = []
    for row in choices.to_dict("records"):
        is_run = (table[SUBJECT] == row[SUBJECT]) & (table[SETTING] == row[SETTING])
        rows.append((row, table[is_run]))
    return view("settings-all", rows, columns, source="settings", in_report=False)


def _figure(choices: pd.DataFrame) -> Chart:
    """Return a chart with a panel per subject: largest error over time, both relative to the default."""
    panels = []
    for subject, rows in choices.groupby(SUBJECT, sort=False):
        is_default = rows[SETTING] == DEFAULT
        is_better = rows[EVERYWHERE]
        groups = (
            ("another choice", OTHER, ~is_better & ~is_default),
            (EVERYWHERE, BETTER, is_better),
            (DEFAULT, CHOSEN, is_default),
        )
        series = [
            Series(
                label,
                rows.loc[is_in_group, TIME_RATIO].to_numpy(float),
                rows.loc[is_in_group, ERROR_RATIO].clip(*ENDS).to_numpy(float),
                look=look,
                line=False,
                points=True,
            )
            for label, look, is_in_group in groups
            if is_in_group.any()
        ]
        panels.append(
            Panel(
                str(subject),
                Axis("time, of the default's", log=True),
                Axis("largest error, of the default's", log=True),
                series,
            )
        )
    return Chart("engine-settings", panels, height=1.9)


STUDY = Study(
    "settings",
    "Settings",
    "Are there better settings of the engines than the defaults?",
    present,
    plan,
    seconds=0.5,
    applies=_reason_against,
    on_page_one=False,
    takes=frozenset({"engines", "t_end", "repeats"}),
    tables={
        "settings": "Settings of engines",
    },
)
