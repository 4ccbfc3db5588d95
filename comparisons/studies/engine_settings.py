"""The best settings of each engine: errors of position and driving torque, and drift, against the engine's own time, one setting changed at a time.

What is tried is data: ``data/engine_settings.toml``. Every choice runs at every step, beside what the adapter has as default. A choice is on
the Pareto front of a scene unless another is better: clearly faster with no larger error, or clearly more accurate in one and no slower. Clearly
faster is its slowest repeat before the other's fastest; an error is larger by `MORE` at least, and no smaller than what the truth is unsure by. Drift counts as
an error from what rounding alone makes of it, however small it is beside the error of the position: a scheme that leaves some in each step has more of it the longer
it runs, and the study's runs are short.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.campaigns.participants import extent
from stiction.comparisons.measures.drift import rounding_over
from stiction.comparisons.methods import case_of
from stiction.comparisons.presentation.charts import BETTER, CHOSEN, OTHER, Axis, Chart, Panel, Series
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import Column, TableView, view
from stiction.comparisons.presentation.traced_text import TracedText, count, listed, traced
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.studies.work_precision import HIGH, LOW, Timed, came_out, work_precision
from stiction.comparisons.variants import OWN_CPU, Variant, scaled
from stiction.scenes import InputError, Scene, Trajectory, load_scene

DEFAULT = "default"
ERROR, SUBJECT, SETTING, ON_FRONT = "position error [m]", "subject", "setting", "on the front"
DRIFT, ROUNDING = "position drift, max [m]", "drift by rounding [m]"
JUDGED = {ERROR: "position uncertainty [m]", "torque error, L1 mean [N m]": "torque uncertainty [N m]", DRIFT: ROUNDING}
"""Errors that a choice is judged by, and what each is unsure by; of a scene without a drive no torque. The drift is that of all joints and drives, see `drift_table`."""
FASTEST, FACTOR, EVERYWHERE = "fastest with no larger error", "time, of the fastest [-]", "better everywhere"
TIME_RATIO, ERROR_RATIO = "time, of the default's [-]", "largest error, of the default's [-]"
TIME_RATIO_ENDS = f"{TIME_RATIO}, least", f"{TIME_RATIO}, most"
MORE = 1.01
"""How many times another an error is at least that counts as larger; below, it is what a solver that has converged leaves."""


@dataclass(frozen=True)
class Subject:
    """A method of an engine, and the settings of it that matter.

    Attributes
    ----------
    engine, fidelity : str
    fixed : Mapping[str, Any]
        Settings that make the method, such as the engine's own friction instead of the adapter's.
    choices : Mapping[str, Sequence]
        By setting the values that are tried; the others stay at their defaults.
    """

    engine: str
    fidelity: str
    choices: Mapping[str, Sequence[Any]]
    fixed: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        return ", ".join([self.engine, self.fidelity, *map(str, self.fixed.values())])

    def variants(self, steps: Sequence[float]) -> list[Variant]:
        """The default and every choice; the label says what is changed."""
        default = Variant(f"{self.label}: {DEFAULT}", self.engine, "dt", tuple(steps), self.fidelity, dict(self.fixed))
        return [default, *(replace(default, label=f"{self.label}: {name}={value}", settings={**self.fixed, name: value})
                           for name, values in self.choices.items() for value in values)]


@dataclass(frozen=True)
class Trials:
    """What is tried.

    Attributes
    ----------
    steps : tuple of float
        Seconds; on a scene times `stiction.comparisons.variants.time_factor`.
    scenes : Mapping[str, float]
        Names of the scenes of `settings_study`, and the seconds that each runs.
    subjects : tuple of Subject
    """

    steps: tuple[float, ...]
    scenes: Mapping[str, float]
    subjects: tuple[Subject, ...]

    @property
    def engines(self) -> list[str]:
        """Those that it has settings of."""
        return list(dict.fromkeys(subject.engine for subject in self.subjects))

    def variants(self, engines: Sequence[str]) -> list[Variant]:
        """Of the subjects of these engines, of all where there are none.

        Raises
        ------
        InputError
            If the study has nothing of an engine.
        """
        for engine in engines:
            if engine not in self.engines:
                raise InputError(f"engines: found {engine!r}; expected some of {', '.join(self.engines)}, which the study has settings of")
        return [variant for subject in self.subjects if subject.engine in (engines or self.engines) for variant in subject.variants(self.steps)]


def load_study() -> Trials:
    """That of ``data/engine_settings.toml``."""
    data = tomllib.loads((resources.files("stiction.comparisons") / "data" / "engine_settings.toml").read_text(encoding="utf-8"))
    return Trials(tuple(data["steps"]), data["scenes"], tuple(Subject(**subject) for subject in data["subjects"]))


def settings_study(engines: Sequence[str], *, repeats: int = 3) -> Comparison[pd.DataFrame]:
    """`settings_comparison` on all scenes of the study, timed in the same rounds; the rows of a subject follow each other."""
    parts = [settings_comparison(load_scene(name), engines, t_end=seconds, repeats=repeats) for name, seconds in load_study().scenes.items()]
    order = {subject.label: place for place, subject in enumerate(load_study().subjects)}

    def combine(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
        return pd.concat(tables).sort_values(SUBJECT, key=lambda labels: labels.map(order), kind="stable", ignore_index=True)

    return side_by_side(parts, combine)


def settings_comparison(scene: Scene, engines: Sequence[str], *, t_end: float | None = None, repeats: int = 3) -> Comparison[pd.DataFrame]:
    """One row per choice and step as `stiction.comparisons.studies.work_precision.work_precision` makes them, with its drift, what is changed and
    whether it is on the front.

    Parameters
    ----------
    engines
        Those of the study where empty.
    """
    found = work_precision(scene, scaled(load_study().variants(engines), scene, t_end), t_end=t_end, repeats=repeats)

    def with_front(timed: Timed) -> pd.DataFrame:
        table = timed.table.join(pd.DataFrame([drift_beside_rounding(record.trajectory) for record in timed.records], columns=[DRIFT, ROUNDING]))
        table[[SUBJECT, SETTING]] = table["variant"].str.partition(": ")[[0, 2]]
        table[ON_FRONT] = False
        for _, rows in _measured(table).groupby(SUBJECT, sort=False):
            table.loc[rows.index, ON_FRONT] = front(_errors(rows), *(rows[name].to_numpy(float) for name in (LOW, HIGH)))
        return table

    return found.then(with_front)


def drift_beside_rounding(trajectory: Trajectory | None) -> dict[str, float]:
    """`DRIFT` and `ROUNDING` of a run; nothing where there is none."""
    return {} if trajectory is None else {DRIFT: float(np.max(trajectory["drift.position"])), ROUNDING: rounding_over(trajectory)}


def front(errors: np.ndarray, fastest: np.ndarray, slowest: np.ndarray) -> np.ndarray:
    """Which points no other is better than, by their errors, shape (errors, points), and by the fastest and the slowest of their times."""
    this, other = errors[:, :, None], errors[:, None, :]
    no_larger, smaller = _no_larger(other, this), _smaller(other, this)
    faster, no_slower = slowest[None] < fastest[:, None], fastest[None] <= slowest[:, None]
    return ~(no_larger & (faster | smaller & no_slower)).any(axis=1)


def _no_larger(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    return (errors <= MORE * others).all(axis=0)


def _smaller(errors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether one of the errors is; where nothing moves, they may be 0."""
    return ((MORE * errors <= others) & (errors < others)).any(axis=0)


def _errors(rows: pd.DataFrame) -> np.ndarray:
    """Those that are `JUDGED`, shape (errors, rows): what they are unsure by at least; 0 where no row has one, infinite where only others have."""
    found = []
    for error, unsure in JUDGED.items():
        sizes = rows.reindex(columns=[error, unsure]).astype(float)
        found.append(np.zeros(len(rows)) if sizes[error].isna().all() else sizes.max(axis="columns").where(sizes[error].notna(), np.inf).to_numpy())
    return np.array(found)


def distance_of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """How far the defaults are from the front: per scene, subject and step the choices of no larger errors than no other is clearly faster than, and the
    time of the default in units of the first of them. What the intervals do not tell apart is not ranked: the default is among them unless it is clearly slower."""
    rows = []
    for (scene, subject), group in _measured(table).groupby(["scene", SUBJECT], sort=False):
        errors = _errors(group)
        for place in np.flatnonzero(group[SETTING] == DEFAULT):
            row, rivals = group.iloc[place].to_dict(), group[_no_larger(errors, errors[:, [place]])]
            best = rivals.loc[rivals[OWN_CPU].idxmin()]
            alike = rivals[rivals[LOW] <= best[HIGH]]
            rows.append({"scene": scene, SUBJECT: subject, "step": row["step"], ERROR: row[ERROR], OWN_CPU: row[OWN_CPU],
                         ON_FRONT: row[ON_FRONT], FASTEST: ", ".join(dict.fromkeys(alike[SETTING])), "its step": best["step"],
                         f"its {ERROR}": best[ERROR], FACTOR: row[OWN_CPU] / best[OWN_CPU]})
    return pd.DataFrame(rows, columns=["scene", SUBJECT, "step", ERROR, OWN_CPU, ON_FRONT, FASTEST, "its step", f"its {ERROR}", FACTOR])


def ranks_of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """How the default of each method of an engine stands among its other choices, over all scenes.

    Returns
    -------
    DataFrame
        A row per subject. `SUBJECT`; `ON_FRONT`, of the scenes and steps, as ``8 of 12``; `EVERYWHERE`, the choices that are better on the whole, see
        `better_everywhere`, or ``none``; and where another choice gains most in time at no larger error: `FACTOR`, ``choice`` (with its step, if that is another), ``scene``,
        ``step`` of the default; empty where none is told apart from the default.
    """
    rows = []
    for subject, group in distance_of_defaults(table).groupby(SUBJECT, sort=False):
        slower = group[[DEFAULT not in names.split(", ") for names in group[FASTEST]]]
        row = {SUBJECT: subject, ON_FRONT: f"{int(group[ON_FRONT].sum())} of {len(group)}",
               EVERYWHERE: ", ".join(better_everywhere(table[table[SUBJECT] == subject])) or "none"}
        if len(slower):
            worst = slower.loc[slower[FACTOR].idxmax()]
            elsewhere = "" if worst["its step"] == worst["step"] else f" at {worst['its step']:g} s"
            row |= {FACTOR: worst[FACTOR], "choice": worst[FASTEST] + elsewhere, "scene": worst["scene"], "step": worst["step"]}
        rows.append(row)
    return pd.DataFrame(rows, columns=[SUBJECT, ON_FRONT, EVERYWHERE, FACTOR, "choice", "scene", "step"])


def better_everywhere(table: pd.DataFrame) -> list[str]:
    """The choices of a subject that are no worse than its default in errors and in time on every scene and step, and clearly better on one.

    A default is one for all scenes: it is on the front of the whole study where there are none.
    """
    here = _measured(table).set_index(["scene", "step"])
    default, better = here[here[SETTING] == DEFAULT], []
    for setting, rows in here[here[SETTING] != DEFAULT].groupby(SETTING, sort=False):
        if not default.index.isin(rows.index).all():
            continue  # it does not come out where the default does
        rows = rows.loc[default.index]
        errors, defaults = np.split(_errors(pd.concat([rows, default])), 2, axis=1)
        no_worse = _no_larger(errors, defaults) & (rows[LOW] <= default[HIGH])
        clearly = _smaller(errors, defaults) | (rows[HIGH] < default[LOW])
        if no_worse.all() and clearly.any():
            better.append(str(setting))
    return better


def against_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """Each choice in units of its method's default, over all scenes and steps at which the default came out.

    Returns
    -------
    DataFrame
        A row per subject and setting. `SUBJECT`, `SETTING`; `TIME_RATIO`, the geometric mean of the times, with the least and the most under `TIME_RATIO_ENDS`;
        `ERROR_RATIO`, the largest of an error that is `JUDGED`, infinite where the default has none; ``lost``, the scenes and steps at which it did not come out.
    """
    rows = []
    for subject, group in _measured(table).groupby(SUBJECT, sort=False):
        here = group.set_index(["scene", "step"])
        default = here[here[SETTING] == DEFAULT]
        for setting, found in here.groupby(SETTING, sort=False):
            shared = default.index.intersection(found.index)
            if shared.empty:
                continue
            errors, defaults = np.split(_errors(pd.concat([found.loc[shared], default.loc[shared]])), 2, axis=1)
            larger = np.divide(errors, defaults, out=np.where(errors > defaults, np.inf, 1.0), where=(defaults > 0) & np.isfinite(defaults))
            times = found.loc[shared, OWN_CPU] / default.loc[shared, OWN_CPU]
            rows.append({SUBJECT: subject, SETTING: setting, TIME_RATIO: float(np.exp(np.log(times).mean())), **dict(zip(TIME_RATIO_ENDS, (times.min(), times.max()))),
                         ERROR_RATIO: float(larger.max()), "lost": len(default) - len(shared)})
    return pd.DataFrame(rows, columns=[SUBJECT, SETTING, TIME_RATIO, *TIME_RATIO_ENDS, ERROR_RATIO, "lost"])


def _measured(table: pd.DataFrame) -> pd.DataFrame:
    """The runs that have an error."""
    return table[came_out(table) & table[ERROR].notna()] if ERROR in table else table.iloc[:0]


NOTES = ("One setting is changed at a time. The default is on the front where no other choice is clearly faster with no "
         "larger error of position or torque and no more drift, or clearly more accurate and no slower.",
         "Times are those inside the engine's own calls, which the settings are of. A default is one for all mechanisms: "
         "a choice is better everywhere if it is no worse on any scene and step, and clearly better on one.")
ENDS = 0.5, 200.0
"""Of the axis of errors in units of the default's: what lies beyond stands at the edge."""


def plan(scope: Scope) -> Comparison[Tables] | None:
    """All settings on all scenes of the trials, at a depth that has them; of one scene at any depth."""
    limits, trials = extent(scope.depth), load_study()
    if len(scope.scenes) == 1:
        found = settings_comparison(scope.scenes[0], scope.engines or (), t_end=scope.t_end, repeats=scope.repeats or 3)
    else:
        engines = [name for name in trials.engines if scope.engines is None or name in scope.engines]
        if not (limits.settings and engines):
            return None
        found = settings_study(engines, repeats=scope.repeats or limits.repeats)
    return found.then(lambda table: Tables({"settings": table}))


def present(results: Results) -> Presentation:
    """How often the defaults are on the front of error and time, and which other choices are better."""
    table = results.table("settings")
    if table.empty or not {SUBJECT, SETTING, "status"} <= set(table):
        return Presentation()
    table = table.assign(reason=table["reason"].fillna("").astype(str))
    if distance_of_defaults(table).empty:
        return Presentation(TracedText("No run with the default settings of an engine succeeded."))
    answer = traced("The defaults are on the front of error and time in {} of {} comparisons.",
                    count("settings", table, **{SETTING: DEFAULT, ON_FRONT: True}),
                    count("settings", table, **{SETTING: DEFAULT, "status": "ok"}))
    better = [traced("{} with {}", subject, listed(choices)) for subject, rows in table.groupby(SUBJECT, sort=False)
              if (choices := better_everywhere(rows))]
    scenes = table["scene"].nunique()
    where = "on every scene" if scenes > 1 else f"in {case_of(table['scene'].iloc[0])}"
    findings = [traced("Better than the default {}: {}.", where, listed(better, "; ", "; ")) if better else
                traced("No other choice is better than its default {}.", where)]
    figure = _over_scenes(table) if scenes > 1 else _on_one_scene(table)
    figures = (figure,) if figure.panels else ()
    return Presentation(answer, tuple(findings), (), (_ranks(table), _choices(table)), figures, NOTES)


def _ranks(table: pd.DataFrame) -> TableView:
    """A row for each method of an engine."""
    ranks = ranks_of_defaults(table)
    ranks["where"] = ranks["scene"].map(case_of, na_action="ignore")
    behind = [[label + 1 for label in table.index[table[SUBJECT] == subject]] for subject in ranks[SUBJECT]]
    columns = (Column(SUBJECT, "engine"), Column(ON_FRONT, "default on the front"), Column(EVERYWHERE),
               Column(FACTOR, "largest gain in time", form=".2g"), Column("choice", "by"), Column("where", "in"),
               Column("step", unit="s", form="g"))
    caption = ("How the default settings of each engine stand among other choices, over all scenes and steps. "
               "The largest gain: time of the default over that of the fastest choice with no larger error.")
    return view("settings", caption, ranks, columns, rows=behind)


def _choices(table: pd.DataFrame) -> TableView:
    """A row for each choice, in units of the default."""
    choices = against_defaults(table)
    behind = [[label + 1 for label in table.index[(table[SUBJECT] == row[SUBJECT]) & (table[SETTING] == row[SETTING])]]
              for row in choices.to_dict("records")]
    columns = (Column(SUBJECT, "engine"), Column(SETTING), Column(TIME_RATIO, "time, of the default's", form=".2g"),
               Column(TIME_RATIO_ENDS[0], "least", form=".2g"), Column(TIME_RATIO_ENDS[1], "most", form=".2g"),
               Column(ERROR_RATIO, "largest error, of the default's", form=".2g"), Column("lost", "failed runs"))
    caption = "Every choice in units of its default: geometric mean of times over all scenes and steps, largest error."
    return view("settings-all", caption, choices, columns, source="settings", rows=behind, in_report=False)


def _over_scenes(table: pd.DataFrame) -> Chart:
    """Each choice once, in units of the default; a panel for each method of an engine."""
    panels = []
    for subject, rows in against_defaults(table).groupby(SUBJECT, sort=False):
        better = rows[SETTING].isin(better_everywhere(table[table[SUBJECT] == subject]))
        default = rows[SETTING] == DEFAULT
        kinds = (("another choice", OTHER, ~better & ~default), ("better everywhere", BETTER, better),
                 (DEFAULT, CHOSEN, default))
        series = [_points(label, look, rows.loc[chosen, TIME_RATIO], rows.loc[chosen, ERROR_RATIO].clip(*ENDS))
                  for label, look, chosen in kinds if chosen.any()]
        panels.append(Panel(str(subject), Axis("time, of the default's", log=True),
                            Axis("largest error, of the default's", log=True), series))
    caption = ("Settings of the engines, one changed at a time, in units of the default: mean time and largest error over "
               f"all scenes and steps. Errors beyond {ENDS[0]:g} and {ENDS[1]:g} stand at the edge. Left of the default "
               "and above it, a choice is faster and somewhere less accurate.")
    return Chart("engine-settings", caption, panels, height=1.9)


def _on_one_scene(table: pd.DataFrame) -> Chart:
    """Each choice at each step; a panel for each method of an engine."""
    measured, panels = _measured(table), []
    drawn = measured[measured[ERROR] > 0]
    for subject, rows in drawn.groupby(SUBJECT, sort=False):
        default = rows[SETTING] == DEFAULT
        kinds = (("another choice", OTHER, ~rows[ON_FRONT] & ~default),
                 ("on the front", BETTER, rows[ON_FRONT] & ~default), (DEFAULT, CHOSEN, default))
        series = [_points(label, look, rows.loc[chosen, OWN_CPU], rows.loc[chosen, ERROR])
                  for label, look, chosen in kinds if chosen.any()]
        panels.append(Panel(str(subject), Axis("CPU inside the engine [s]", log=True), Axis(ERROR, log=True), series))
    caption = (f"Settings of the engines, one changed at a time, in {case_of(table['scene'].iloc[0])}: error over the "
               "engine's own CPU time. On the front no other choice is clearly better.")
    return Chart("engine-settings", caption, panels, height=1.9)


def _points(label: str, look: str, x: pd.Series, y: pd.Series) -> Series:
    return Series(label, x.to_numpy(float), y.to_numpy(float), look=look, line=False, points=True)


STUDY = Study("settings", "Settings", "Are the engines at their best?", 11, present, plan, seconds=0.5,
              on_page_one=False, takes=frozenset({"engines", "t_end", "repeats"}))
