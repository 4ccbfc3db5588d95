"""Settings of each engine: errors of position and torque, and drift, against engine time, one changed at a time.

The trials are data: ``data/engine_settings.toml``. Every choice runs at every step, as does the adapter's default. A
choice is on the Pareto front of a scene unless another is better: clearly faster with no larger error, or clearly more
accurate in one and no slower. Clearly faster is its slowest repeat before the other's fastest; an error is larger by
`MORE` at least, and no smaller than the truth's uncertainty. Drift counts as an error from the rounding of a coordinate
on, however small it is against the position error: a scheme that leaves some in each step has more of it the longer it
runs, and the study's runs are short.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import scene_title, succeeded, with_columns
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
ERROR, SUBJECT, SETTING, ON_FRONT = "position_error", "subject", "setting", "on_front"
DRIFT, ROUNDING = "position_drift", "drift_rounding"
JUDGED = {ERROR: "position_uncertainty", "torque_error": "torque_uncertainty", DRIFT: ROUNDING}
"""Errors that a choice is judged by, and their uncertainties; no torque of a scene without a drive.

The drift is that of all joints and drives, see `stiction.comparisons.measures.drift.drift`.
"""
FACTOR, EVERYWHERE = "time_of_fastest", "better_everywhere"
TIME_RATIO, ERROR_RATIO, FAILED = "time_ratio", "largest_error_ratio", "failed_runs"
TIME_RATIO_ENDS = f"{TIME_RATIO}, least", f"{TIME_RATIO}, most"
MORE = 1.01
"""Ratio from which one error counts as larger than another: a solver that has converged leaves less."""
ENDS = 0.5, 200.0
"""Ends of the axis of errors in units of the default's: what lies beyond stands at the edge."""
NO_DEFAULT: Mapping[str, object] = {
    "compared": 0,
    "on_front": 0,
    "better": [],
    "scene": None,
    "ends": ENDS,
}
"""Rows where no run with default settings succeeded."""


@dataclass(frozen=True)
class Subject:
    """A method of an engine, and the settings of it that matter.

    Attributes
    ----------
    choices : Mapping[str, Sequence]
        Values that are tried, by setting; the others stay at their defaults.
    fixed : Mapping[str, Any]
        Settings that make the method, such as the engine's own friction instead of the adapter's.
    name : str
        Of the method, in place of the values of `fixed`.
    """

    engine: str
    fidelity: Fidelity
    choices: Mapping[str, Sequence[Any]]
    fixed: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""

    @property
    def label(self) -> str:
        return ", ".join(
            [
                self.engine,
                self.fidelity,
                *([self.name] if self.name else map(str, self.fixed.values())),
            ]
        )

    def variants(self, steps: Sequence[float]) -> list[Variant]:
        """The default and every choice, which the label names."""
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
        return [
            default,
            *(
                replace(
                    default,
                    label=f"{self.label}: {name}={value}",
                    settings={**self.fixed, name: value},
                    setting=f"{name}={value}",
                    changed=name,
                )
                for name, values in self.choices.items()
                for value in values
            ),
        ]


@dataclass(frozen=True)
class Trials:
    """The methods and steps that are tried (s, times `time_factor` of a scene), and by scene the seconds of a run."""

    steps: tuple[float, ...]
    scenes: Mapping[str, float]
    subjects: tuple[Subject, ...]


def load_study() -> Trials:
    """The trials of ``data/engine_settings.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "engine_settings.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return Trials(
        tuple(data["steps"]),
        data["scenes"],
        tuple(Subject(**subject) for subject in data["subjects"]),
    )


def settings_table(timed: Timed) -> pd.DataFrame:
    """The rows of `work_precision` for the choices on a scene, with the setting, its drift, and the front."""
    drifts = [drift_and_rounding(record.trajectory) for record in timed.records]
    table = timed.table.join(pd.DataFrame(drifts, columns=[DRIFT, ROUNDING]))
    tried = {record.key: record.variant for record in timed.records}
    table[SUBJECT] = [tried[key].subject for key in table["key"]]
    table[SETTING] = [tried[key].setting for key in table["key"]]
    table[ON_FRONT] = False
    for _, rows in _measured(table).groupby(SUBJECT, sort=False):
        times = (rows[name].to_numpy(float) for name in (LOW, HIGH))
        table.loc[rows.index, ON_FRONT] = front(_errors(rows), *times)
    return table


def drift_and_rounding(trajectory: Trajectory | None) -> dict[str, float]:
    """`DRIFT` and `ROUNDING` of a run."""
    if trajectory is None:
        return {}
    return {DRIFT: float(np.max(trajectory["drift.position"])), ROUNDING: rounding_over(trajectory)}


def front(errors: np.ndarray, fastest: np.ndarray, slowest: np.ndarray) -> np.ndarray:
    """The points that no other is better than.

    Parameters
    ----------
    errors : ndarray, shape (errors, points)
    fastest, slowest : ndarray, shape (points,)
        Ends of the intervals of their times.
    """
    this, other = errors[:, :, None], errors[:, None, :]
    no_larger, smaller = _no_larger(other, this), _smaller(other, this)
    faster, no_slower = slowest[None] < fastest[:, None], fastest[None] <= slowest[:, None]
    return ~np.any(no_larger & (faster | smaller & no_slower), axis=1)


def _no_larger(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.all(errors <= MORE * others, axis=0)


def _smaller(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """True where one of the errors is smaller; where nothing moves, they may be 0."""
    return np.any((MORE * errors <= others) & (errors < others), axis=0)


def _measured(table: pd.DataFrame) -> pd.DataFrame:
    table = with_columns(table, ERROR)
    return table[succeeded(table) & table[ERROR].notna()]


def _errors(rows: pd.DataFrame) -> np.ndarray:
    """Errors that are `JUDGED`, shape (errors, rows), or their uncertainties where these are larger.

    They are 0 where no row has one, infinite where only others have.
    """
    found = []
    for error, unsure in JUDGED.items():
        pair = rows.reindex(columns=[error, unsure]).astype(float)
        known = pair[error].notna()
        found.append(
            pair.max(axis="columns").where(known, np.inf if known.any() else 0.0).to_numpy()
        )
    return np.array(found)


def ranks_of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """Default of each method of an engine among its other choices, over all scenes.

    On a scene and step the fastest choices are those with no larger errors that no other is clearly faster than.

    Returns
    -------
    DataFrame
        A row per subject. `SUBJECT`; `ON_FRONT`, of the scenes and steps, as ``8 of 12``; `EVERYWHERE`, the choices of
        `better_everywhere`, or ``none``; and where another choice gains most in time at no larger error: `FACTOR`,
        ``choice`` (with its step, if that is another), ``scene``, ``step`` of the default; empty where the default is
        among the fastest on each.
    """
    rows = []
    for subject, group in _measured(table).groupby(SUBJECT, sort=False):
        fronts, gains = [], []
        for scene, here in group.groupby("scene", sort=False):
            errors = _errors(here)
            for place in np.flatnonzero(here[SETTING] == DEFAULT):
                default, rivals = here.iloc[place], here[_no_larger(errors, errors[:, [place]])]
                best = rivals.loc[rivals[OWN_CPU].idxmin()]
                fastest = list(dict.fromkeys(rivals.loc[rivals[LOW] <= best[HIGH], SETTING]))
                elsewhere = "" if best["step"] == default["step"] else f" at {best['step']:g} s"
                fronts.append(default[ON_FRONT])
                if DEFAULT not in fastest:
                    gains.append(
                        {
                            FACTOR: default[OWN_CPU] / best[OWN_CPU],
                            "choice": ", ".join(fastest) + elsewhere,
                            "scene": scene,
                            "step": default["step"],
                        }
                    )
        if fronts:
            better = ", ".join(better_everywhere(group)) or "none"
            rows.append(
                {
                    SUBJECT: subject,
                    ON_FRONT: f"{sum(fronts)} of {len(fronts)}",
                    EVERYWHERE: better,
                    **max(gains, key=lambda gain: gain[FACTOR], default={}),
                }
            )
    return pd.DataFrame(
        rows, columns=[SUBJECT, ON_FRONT, EVERYWHERE, FACTOR, "choice", "scene", "step"]
    )


def better_everywhere(table: pd.DataFrame) -> list[str]:
    """Choices of a subject that are `EVERYWHERE` better than its default."""
    choices = against_defaults(table)
    return list(choices.loc[choices[EVERYWHERE], SETTING])


def against_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """Each choice in units of its method's default, over all scenes and steps at which the default succeeded.

    Returns
    -------
    DataFrame
        A row per subject and setting. `SUBJECT`, `SETTING`; `TIME_RATIO`, the geometric mean of the times, with the
        least and the most under `TIME_RATIO_ENDS`; `ERROR_RATIO`, the largest of an error that is `JUDGED`, infinite
        where the default has none; `FAILED`, the scenes and steps at which only the default succeeded; `EVERYWHERE`,
        whether it is no worse in errors and in time on every scene and step, and clearly better on one.
    """
    rows = []
    for subject, group in _measured(table).groupby(SUBJECT, sort=False):
        here = group.set_index(["scene", "step"])
        defaults = here[here[SETTING] == DEFAULT]
        for setting, found in here.groupby(SETTING, sort=False):
            shared = defaults.index.intersection(found.index)
            if shared.empty:
                continue
            found, default = found.loc[shared], defaults.loc[shared]
            errors, others = np.split(_errors(pd.concat([found, default])), 2, axis=1)
            larger = np.divide(
                errors,
                others,
                out=np.where(errors > others, np.inf, 1.0),
                where=(others > 0) & np.isfinite(others),
            )
            times, failed = found[OWN_CPU] / default[OWN_CPU], len(defaults) - len(shared)
            no_worse = _no_larger(errors, others) & (found[LOW] <= default[HIGH])
            better = _smaller(errors, others) | (found[HIGH] < default[LOW])
            rows.append(
                {
                    SUBJECT: subject,
                    SETTING: setting,
                    TIME_RATIO: float(np.exp(np.log(times).mean())),
                    **dict(zip(TIME_RATIO_ENDS, (times.min(), times.max()))),
                    ERROR_RATIO: float(larger.max()),
                    FAILED: failed,
                    EVERYWHERE: bool(
                        setting != DEFAULT and not failed and no_worse.all() and better.any()
                    ),
                }
            )
    return pd.DataFrame(
        rows,
        columns=[SUBJECT, SETTING, TIME_RATIO, *TIME_RATIO_ENDS, ERROR_RATIO, FAILED, EVERYWHERE],
    )


def plan(scope: Scope) -> Comparison[Tables] | None:
    """All settings on all scenes of the trials, at a depth that has them; of one scene at any depth.

    Rows of a subject follow each other.

    Raises
    ------
    InputError
        If the study has no settings of an engine that is named for one scene.
    """
    trials, limits, engines = load_study(), extent(scope.depth), scope.engines
    order = {subject.label: place for place, subject in enumerate(trials.subjects)}
    known = dict.fromkeys(subject.engine for subject in trials.subjects)
    if len(scope.scenes) == 1:
        where, engines, repeats = (
            [(scope.scenes[0], scope.t_end)],
            engines or None,
            scope.repeats or 3,
        )
        if unknown := set(engines or ()) - set(known):
            raise InputError(
                f"engines: found {min(unknown)!r}; expected some of {', '.join(known)}, "
                "which the study has settings of"
            )
    else:
        where = (
            [(load_scene(name), seconds) for name, seconds in trials.scenes.items()]
            if limits.settings
            else []
        )
        repeats = scope.repeats or limits.repeats
    variants = [
        variant
        for subject in trials.subjects
        if engines is None or subject.engine in engines
        for variant in subject.variants(trials.steps)
    ]

    def tables(found: list[pd.DataFrame]) -> Tables:
        return Tables(
            {
                "settings": pd.concat(found).sort_values(
                    SUBJECT, key=lambda labels: labels.map(order), kind="stable", ignore_index=True
                )
            }
        )

    parts = [
        work_precision(scene, scaled(variants, scene, t_end), t_end=t_end, repeats=repeats).then(
            settings_table
        )
        for scene, t_end in where
        if variants
    ]
    return side_by_side(parts, tables) if parts else None


def present(results: Results) -> Presentation:
    """Number of comparisons in which defaults are on the front of error and time, and the choices that are better."""
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
        tables=[_ranks_view(ranks, table), _choices_view(choices, table)],
        figures=[_figure(choices)],
    )


def _ranks_view(ranks: pd.DataFrame, table: pd.DataFrame) -> TableView:
    """How the default of each method of an engine stands among its other choices."""
    ranks = ranks.assign(where=ranks["scene"].map(scene_title, na_action="ignore"))
    columns = (
        Column(SUBJECT, "engine"),
        Column(ON_FRONT, "default Pareto-optimal"),
        Column(EVERYWHERE),
        Column(FACTOR, "largest gain in time", form=".2g"),
        Column("choice", "choice with this gain"),
        Column("where", "scene"),
        Column("step", unit="s", form="g"),
    )
    by_method = [(row, table[table[SUBJECT] == row[SUBJECT]]) for row in ranks.to_dict("records")]
    return view("settings", by_method, columns)


def _choices_view(choices: pd.DataFrame, table: pd.DataFrame) -> TableView:
    """Every choice in units of its default."""
    columns = (
        Column(SUBJECT, "engine"),
        Column(SETTING),
        Column(TIME_RATIO, form=".2g"),
        Column(TIME_RATIO_ENDS[0], "least", form=".2g"),
        Column(TIME_RATIO_ENDS[1], "most", form=".2g"),
        Column(ERROR_RATIO, form=".2g"),
        Column(FAILED),
    )
    by_choice = [
        (row, table[(table[SUBJECT] == row[SUBJECT]) & (table[SETTING] == row[SETTING])])
        for row in choices.to_dict("records")
    ]
    return view("settings-all", by_choice, columns, source="settings", in_report=False)


def _figure(choices: pd.DataFrame) -> Chart:
    """Each choice once, in units of the default; a panel for each method of an engine."""
    panels = []
    for subject, rows in choices.groupby(SUBJECT, sort=False):
        is_default, is_better = rows[SETTING] == DEFAULT, rows[EVERYWHERE]
        kinds = (
            ("another choice", OTHER, ~is_better & ~is_default),
            (EVERYWHERE, BETTER, is_better),
            (DEFAULT, CHOSEN, is_default),
        )
        series = [
            Series(
                label,
                rows.loc[chosen, TIME_RATIO].to_numpy(float),
                rows.loc[chosen, ERROR_RATIO].clip(*ENDS).to_numpy(float),
                look=look,
                line=False,
                points=True,
            )
            for label, look, chosen in kinds
            if chosen.any()
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
    on_page_one=False,
    takes=frozenset({"engines", "t_end", "repeats"}),
    tables={
        "settings": "Settings of engines",
    },
)
