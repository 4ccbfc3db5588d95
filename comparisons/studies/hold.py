"""Does it hold: creep under loads below the limit of static friction, and what happens at the limit.

The truth of a held load is rest, derived in the source of each scene. Runs, settings and laws are data
(`hold_data`). What is beyond the limit, the break-away under a slow ramp and the motion until a stop, is compared
with `stiction.comparisons.measures.scene_truth.ground_truth`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import at_equal_step, rank, succeeded, with_columns
from stiction.comparisons.bench.participants import REFERENCE, variants
from stiction.comparisons.bench.presentation import (
    CHOSEN,
    METHOD,
    OTHER,
    REFINED_BY,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.bench.timing.visits import visit
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    FRICTION_BY,
    OWN_CPU,
    Coefficients,
    Record,
    Variant,
    has_static_coefficient,
    run_command,
    truth_key,
)
from stiction.comparisons.measures.creep import LANDING, LET_GO, Slip, slip_of
from stiction.comparisons.measures.drift import ROUNDING
from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.comparisons.measures.published_creep import CREEP as OURS
from stiction.comparisons.measures.published_creep import (
    ENGINE,
    MATCHED,
    PUBLISHED,
    published_creep,
)
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.studies.hold_data import FORMS, load_data
from stiction.comparisons.studies.settings import DEFAULT, SETTING, SUBJECT
from stiction.engines.isolation import Outcome, Task
from stiction.engines.protocol import EngineFailure
from stiction.engines.registry import load_engine, own_methods
from stiction.engines.status import UNMADE
from stiction.scenes import InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.wording import as_given
from stiction.truths import Tier
from stiction.uncertain import Uncertain

PARAMETERS = ("part", "ramp", "v0", "limit", "mu", "mus")
"""Parameters of a scene of the study: the load is part + ramp t of the limit, and v0 the slider's speed along it."""
HELD, RAMP, STOP = "held", "ramp", "stop"
CHANGED = "changed"
"""Name of the setting that a run changes, none for the default."""
CREEP, UNSURE, LOAD, TEST = "creep", "creep_uncertainty", "load", "test"
PART, LETS_GO = "bound_fraction", "lets_go"
OF_STEP, OF_ZONE, LANDED = "creep_per_g_dt", "creep_per_regularization", "landing"
BREAK_AWAY, BREAK_UNSURE = "break_away_error", "break_away_uncertainty"
FASTER, STOPPED, STOP_UNSURE = "acceleration_error", "stop_error", "stop_uncertainty"
HOLDS, SLOWER, TIME = "holds", "creep_ratio", "time_ratio"
FOUND, FOUND_UNSURE = "found", "found_uncertainty"
OUTPUT = {HELD: 4e-3, RAMP: 1e-3, STOP: 4e-3}
"""Seconds between samples: of a ramp one step of 1 ms, for the instant of letting go."""
TRUE_STEP = 1e-4
"""Seconds between samples of a truth."""
STILL = 1e-9
"""m/s: a method holds if it creeps no faster, 32 mm in a year."""
SURE = 2.0
"""Uncertainties, each of an interval of 95 %, by which what is called creep exceeds `STILL`: the largest of a dozen
runs at rest exceeds one of them."""
USUAL = 0.9
"""Largest load, as a part of the limit, by which a method is judged: beyond it, small errors of the bound decide."""
BAND = {"exponent": 0.2, "ratio": 0.01}
"""A law is obeyed if what is found, with its interval, is no farther from it: other exponents in question are 0, 1/2,
2; of a predicted creep 1 % is left for what has not settled when the measurement begins."""
ENDS = 1e-13, 1e-2
"""m/s: slower creep stands at the lower edge of a figure, and faster slip at the upper one."""
SLOWEST = 4.0
"""Time over the default's: slower settings stand at the edge of the figure."""
SPEEDS = Axis("creep [m/s]", log=True, limits=(ENDS[0] / 3, 3 * ENDS[1]))
REST = "none: it rests"
"""What the creep of the reference grows with, by its law."""
OBEYED, BROKEN, OPEN = "obeyed", "broken", "inconclusive"
CONSTANTS = {
    "usual": 100 * USUAL,
    "still": STILL,
    "sure": SURE,
    "landing": LANDING,
    "let_go_speed": LET_GO,
    "slowest_drawn": ENDS[0],
    "fastest_drawn": ENDS[1],
    "longest_drawn": SLOWEST,
}
"""What the text of the study mentions besides results."""


@dataclass(frozen=True)
class Trial:
    """A run: a scene with its changed parameters, whether mus > mu among them, and what is measured."""

    scene: Scene
    changed: Mapping[str, float]
    static: bool
    variant: Variant
    step: float
    test: str
    load: float

    @property
    def key(self) -> str:
        return f"hold/{self.scene.name}/{self.variant.label}/{self.variant.parameter}={self.step:g}/{self.about}"

    @property
    def about(self) -> str:
        """``held 0.9``, or the test."""
        return f"{HELD} {self.load:g}" if self.test == HELD else self.test

    @property
    def tried(self) -> tuple[str | None, str | None, str | None]:
        """Subject and setting that are tried, and the name of the setting; None for a method as it is."""
        variant = self.variant
        return (
            (variant.subject, variant.setting, variant.changed or None)
            if variant.setting
            else (None, None, None)
        )

    @property
    def truth(self) -> str:
        """Key of the truth of what moves."""
        return f"hold/{truth_key(self.scene.name, self.static)}/{self.test}/truth"


def changes(scene: Scene, test: str, load: float, static_coefficient: bool) -> dict[str, float]:
    """Parameters of a scene under a load; of an engine without a static coefficient mus = mu, in the limit as well.

    Raises
    ------
    InputError
        If the scene lacks one of `PARAMETERS`.
    """
    if missing := [name for name in PARAMETERS if name not in scene.parameters]:
        raise InputError(
            f"{scene.name}: parameters: found no {', '.join(missing)}; expected {', '.join(PARAMETERS)}, "
            "as the scenes hold-.. of the catalogue have them"
        )
    data = load_data()
    change = {
        HELD: {"part": load},
        RAMP: data.ramp.model_dump(),
        STOP: data.stop.model_dump(exclude={"landed"}),
    }
    return {**change[test], **({} if static_coefficient else {"mus": scene.parameters["mu"]})}


def measured(
    engine: str, scene: Scene, test: str, arguments: Mapping[str, Any], timed: bool = False
) -> tuple[Slip, Trajectory]:
    """Run a scene and reduce it: the numbers of its slip, and the ends of its trajectory.

    Where it is `timed`, its engine time is the median of repeats (`visit`).

    Raises
    ------
    EngineFailure
        If the run ended early.
    """
    run = load_engine(engine).simulate(scene, output_step=OUTPUT[test], **arguments)
    if run.termination != "end":
        raise EngineFailure(run.termination)
    guide = next(iter(scene.frictional_guides))
    size = max(
        1.0,
        *(float(np.max(np.abs(run[f"{body}.{name}"]))) for body in scene.bodies for name in "xy"),
    )
    rounding = np.finfo(float).eps * size * max(1, run.cost.counters.get("steps", len(run.t)))
    slip = slip_of(
        run.t,
        run[f"{guide}.displacement"],
        run[f"{guide}.slip_velocity"],
        rounding,
        **_window(scene, test),
    )
    ends = replace(
        run,
        t=run.t[[0, -1]],
        columns={name: column[[0, -1]] for name, column in run.columns.items()},
        events=(),
    )
    if timed:
        ends = replace(
            ends, cost=replace(ends.cost, engine_s=visit(engine, scene, arguments).own_s)
        )
    return slip, ends


def true_slip(scene: Scene, test: str) -> tuple[Slip, float]:
    """The same numbers of the truth, and the uncertainty of its displacement.

    Raises
    ------
    InputError
        If there is no truth.
    """
    truth, guide = ground_truth(scene), next(iter(scene.frictional_guides))
    if truth.tier == Tier.NONE:
        raise InputError(f"{scene.name}: found no truth: {truth.note}; expected one of its motion")
    t = np.linspace(0.0, scene.t_end, round(scene.t_end / TRUE_STEP) + 1)
    columns = truth(t)
    slip = slip_of(
        t,
        columns[f"{guide}.displacement"],
        columns[f"{guide}.slip_velocity"],
        **_window(scene, test),
    )
    return slip, truth.uncertainty.get(f"{guide}.displacement", 0.0)


def _window(scene: Scene, test: str) -> dict[str, Any]:
    """The end of the landing, and the period over which a held load's displacement is averaged."""
    landed = load_data().stop.landed if test == STOP else LANDING
    return {"landed": landed, "period": scene.parameters.get("period")}


def plan(scope: Scope) -> Comparison[Tables]:
    """Every method on every scene and load of the depth, or on the one scene that is given.

    Methods have the steps of the depth, or their tightest tolerance. At full depth the settings as well, at the step
    nearest to `COMMON_STEP` and loads up to `USUAL`. Contacts have one coefficient, mus = mu, as most engines' own.
    """
    data, one = load_data(), scope.scenes if len(scope.scenes) == 1 else ()
    depth = data.depths[scope.depth]
    steps, middle = depth.steps, min(depth.steps, key=lambda step: rank("dt", step))
    compared = [
        replace(variant, ladder=steps if variant.parameter == "dt" else variant.ladder[-1:])
        for variant in variants(scope.engines)
    ]
    tried = [
        variant
        for subject in data.subjects
        if scope.engines is None or subject.engine in scope.engines
        for variant in subject.variants((middle,))
    ]
    held = [(HELD, load) for load in depth.loads]
    moved = [(RAMP, data.ramp.part), (STOP, data.stop.part)] if depth.moved else []
    usual = [(test, load) for test, load in held if load <= USUAL]
    ways = [
        (
            scene,
            variant,
            variant.fidelity == Fidelity.JOINT and has_static_coefficient(variant),
            held + moved,
        )
        for scene in one or map(load_scene, depth.scenes)
        for variant in compared
    ]
    ways += [
        (scene, variant, False, usual)
        for scene in (one or map(load_scene, depth.settings))
        if depth.settings
        for variant in tried
    ]
    trials = []
    for scene, variant, static, chosen in ways:
        for test, load in chosen:
            if test == RAMP and "period" in scene.parameters:
                continue  # it may rest again a moment after it let go
            changed = changes(scene, test, load, static)
            trials += [
                Trial(vary(scene, changed), changed, static, variant, step, test, load)
                for step in variant.ladder
            ]
    truths = {
        trial.truth: Task(trial.truth, true_slip, (trial.scene, trial.test))
        for trial in trials
        if trial.test != HELD
    }
    tasks = [
        Task(
            trial.key,
            measured,
            (
                trial.variant.engine,
                trial.scene,
                trial.test,
                {
                    trial.variant.parameter: trial.step,
                    "fidelity": trial.variant.fidelity,
                    **trial.variant.settings,
                },
                any(trial.tried),
            ),
        )
        for trial in trials
    ]
    is_published = moved and not one and any(variant.engine == ENGINE for _, variant, _, _ in ways)
    published = [Task("hold/published creep", published_creep)] if is_published else []

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        known, runs = dict(zip(truths, outcomes)), outcomes[len(truths) : len(truths) + len(trials)]
        table = pd.DataFrame(
            [
                _row(trial, outcome, known.get(trial.truth))
                for trial, outcome in zip(trials, runs, strict=True)
            ]
        )
        tables = {
            "hold": table,
            "hold-methods": methods_table(table),
            "hold-laws": laws_table(table),
            "hold-settings": settings_table(table),
        }
        for outcome in outcomes[len(truths) + len(trials) :]:
            if outcome.status not in UNMADE:
                failed = pd.DataFrame(
                    [{"case": "all", "status": outcome.status, "reason": outcome.reason}]
                )
                tables["hold-published"] = failed if outcome.value is None else outcome.value
        return Tables(tables)

    return Comparison(
        (*truths.values(), *tasks, *published),
        tabulate,
        tuple({way[1].label: way[1] for way in ways}.values()),
    )


def _row(trial: Trial, outcome: Outcome, true: Outcome | None) -> dict[str, Any]:
    """A row of the table: of a failed run with its reason, of a run without truth without errors."""
    ends = outcome.value and outcome.value[1]
    record = Record(
        trial.key, trial.scene.name, trial.variant, trial.step, replace(outcome, value=ends)
    )
    row = {
        **record.describe(),
        COEFFICIENTS: str(Coefficients.of(trial.static)),
        "truth": truth_key(trial.scene.name, trial.static),
        **dict(zip((SUBJECT, SETTING, CHANGED), trial.tried)),
        TEST: trial.test,
        LOAD: trial.load,
    }
    if outcome.value is None:
        return row
    row[AGAIN] = run_command(
        trial.scene.name,
        trial.variant.engine,
        [
            (trial.variant.parameter, f"{trial.step:g}"),
            ("fidelity", trial.variant.fidelity),
            *(("set", f"{name}={as_given(value)}") for name, value in trial.changed.items()),
            *(
                ("setting", f"{name}={as_given(value)}")
                for name, value in trial.variant.settings.items()
            ),
        ],
    )
    slip = outcome.value[0]
    if trial.test != RAMP:
        speed, gravity = abs(slip.creep.value), trial.scene.gravity
        row |= {CREEP: slip.creep.value, UNSURE: slip.creep.uncertainty}
        if trial.variant.parameter == "dt" and gravity:
            row[OF_STEP] = speed / (math.hypot(*gravity) * trial.step)
        zone = load_data().regularization.get(f"{trial.variant.engine}, {trial.variant.fidelity}")
        if zone is not None:
            row[OF_ZONE] = speed / float(ends.settings[zone])
    if trial.test == HELD:
        row |= {
            LANDED: slip.landing,
            LETS_GO: slip.lets_go,
            PART: _part_of_bound(trial.scene, ends),
        }
    if true is None or true.value is None:
        return row if true is None else row | {"truth_note": f"{true.status}: {true.reason}"}
    exact, unsure = true.value
    if trial.test == STOP:
        return row | {STOPPED: slip.landing - exact.landing, STOP_UNSURE: unsure}
    return row | _break_away(trial, slip, exact)


def _part_of_bound(scene: Scene, ends: Trajectory) -> float:
    """Friction at the end over mu times the corner forces, which may carry more than the limit's statics say."""
    name, guide = next(iter(scene.frictional_guides.items()))
    bound = (guide.mu or 0.0) * sum(abs(ends[f"{name}.F{corner}"][-1]) for corner in (1, 2, 3, 4))
    return abs(float(ends[f"{name}.friction"][-1])) / bound if bound > 0 else math.nan


def _break_away(trial: Trial, slip: Slip, exact: Slip) -> dict[str, Any]:
    """The load at which it lets go less the truth's, both at the same speed; a slider that never does has a bound."""
    if exact.let_go is None:
        return {"truth_note": f"the truth does not reach {LET_GO:g} m/s"}
    rate = trial.scene.parameters["ramp"]
    let_go = trial.scene.t_end if slip.let_go is None else slip.let_go
    sampled = max(OUTPUT[RAMP], trial.step if trial.variant.parameter == "dt" else 0.0)
    row: dict[str, Any] = {BREAK_AWAY: rate * (let_go - exact.let_go), BREAK_UNSURE: rate * sampled}
    if slip.let_go is None:
        row["bound"] = "≥"
    elif slip.let_go <= LANDING:
        row["bound"] = "≤"
    elif slip.acceleration is not None and exact.acceleration:
        row[FASTER] = slip.acceleration / exact.acceleration - 1
    return row


def fastest(runs: pd.DataFrame) -> Any:
    """Return the label of the run whose creep stands for all of them.

    It is the fastest of those that are `moving`; of runs that are not, the one with the largest bound. What does not
    exceed its rounding counts as rest.
    """
    speed = runs[CREEP].abs()
    sure = speed[moving(runs)]
    return (sure if len(sure) else (speed + runs[UNSURE]).where(speed > 0, 0.0)).idxmax()


def moving(runs: pd.DataFrame) -> pd.Series:
    """Test which runs creep for sure, or let go."""
    return (runs[CREEP].abs() > STILL + SURE * runs[UNSURE]) | runs[LETS_GO].eq(True)


def methods_table(table: pd.DataFrame) -> pd.DataFrame:
    """A row per method at the step nearest to `COMMON_STEP`, on all scenes of the depth.

    `HOLDS`: every load of at most `USUAL` is held, within `STILL`; none where uncertainties or failed runs leave it
    open. `CREEP`: the `fastest` there, with its scene and load, and whether the slider lets go; `OF_ZONE`: that creep
    over the speed at which the engine regularizes friction. ``failed``: the runs that failed.
    """
    own = with_columns(table, CREEP, UNSURE, LETS_GO, OF_ZONE)
    own = own[own[SUBJECT].isna() & own[TEST].eq(HELD) & ~own["status"].isin(UNMADE)]
    rows = []
    for variant in own["variant"].unique():
        runs = at_equal_step(own, variant)
        runs = runs[runs[LOAD] <= USUAL]
        made = runs[succeeded(runs) & runs[CREEP].notna()]
        if runs.empty:
            continue
        row = {
            **runs.iloc[0][["variant", "engine", "fidelity", COEFFICIENTS]],
            "failed": len(runs) - len(made),
        }
        if len(made):
            worst = made.loc[fastest(made)]
            may_move = made[CREEP].abs() + made[UNSURE] > STILL
            # a run that failed shows neither rest nor creep
            is_open = may_move.any() or len(made) < len(runs)
            holds: bool | None = True
            if moving(made).any():
                holds = False
            elif is_open:
                holds = None
            row |= {
                HOLDS: holds,
                LETS_GO: worst[LETS_GO],
                "scene": worst["scene"],
                LOAD: worst[LOAD],
                CREEP: abs(worst[CREEP]),
                UNSURE: worst[UNSURE],
                OF_ZONE: worst[OF_ZONE],
            }
        rows.append(row)
    return pd.DataFrame(
        rows,
        columns=[
            "variant",
            "engine",
            "fidelity",
            COEFFICIENTS,
            "failed",
            HOLDS,
            LETS_GO,
            "scene",
            LOAD,
            CREEP,
            UNSURE,
            OF_ZONE,
        ],
    )


def laws_table(table: pd.DataFrame) -> pd.DataFrame:
    """A row per law: what is found of it with its interval, and the verdict. The first: the reference rests exactly.

    Runs of the default and of those that change the law's setting count. Creep within its uncertainty is left out:
    rounding has no law. Of a form the farthest ratio of creep to prediction is found, of an exponent its fit over the
    setting at each scene and load. The verdict is `OPEN` where the interval is partly within `BAND`, or too few runs.
    """
    rows: list[dict[str, Any]] = []
    tried = with_columns(table, CREEP, UNSURE, SETTING, PART)
    held = tried[tried[TEST].eq(HELD)]
    tried, own = held[succeeded(held)], held[held["variant"] == REFERENCE]
    if succeeded(own).any():
        word = (
            BROKEN
            if own[CREEP].fillna(0.0).ne(0).any()
            else OBEYED
            if succeeded(own).all()
            else OPEN
        )
        rows.append(
            {
                SUBJECT: REFERENCE,
                "over": REST,
                "source": "derived in each scene",
                "runs": int(succeeded(own).sum()),
                "verdict": word,
            }
        )
    tried = tried[tried[CREEP].abs() > tried[UNSURE]]
    for law in load_data().laws:
        runs = tried[tried[SUBJECT] == law.subject]
        runs = runs[(runs[SETTING] == DEFAULT) | runs[CHANGED].eq(law.over)]
        runs = runs.assign(
            over=[json.loads(settings).get(law.over) for settings in runs["settings"]]
        )
        runs = runs[runs["over"] >= law.least]
        if runs.empty:
            continue
        kind, expected = ("exponent", law.exponent) if law.exponent is not None else ("ratio", 1.0)
        found = _farthest(runs, law.form) if law.form else _power(runs)
        rows.append(
            {
                SUBJECT: law.subject,
                "over": law.over,
                "kind": kind,
                "law": expected,
                "source": law.source,
                "runs": len(runs),
                FOUND: found and found.value,
                FOUND_UNSURE: found and found.uncertainty,
                "verdict": verdict(found, expected, BAND[kind]),
            }
        )
    return pd.DataFrame(
        rows,
        columns=[SUBJECT, "over", "kind", "law", "source", "runs", FOUND, FOUND_UNSURE, "verdict"],
    )


def _farthest(runs: pd.DataFrame, form: str) -> Uncertain:
    """The ratio of creep to what the form predicts that is farthest from 1."""
    predicted = FORMS[form](runs[PART].to_numpy(float), runs["over"].to_numpy(float))
    ratios = runs[CREEP].abs().to_numpy(float) / predicted
    place = int(np.abs(ratios - 1).argmax())
    return Uncertain(
        float(ratios[place]), float(runs[UNSURE].to_numpy(float)[place] / predicted[place])
    )


def _power(runs: pd.DataFrame) -> Uncertain | None:
    """The exponent over the setting, at each scene and load."""
    series = [
        (part["over"].to_numpy(float), part[CREEP].abs().to_numpy(float))
        for _, part in runs.groupby(["scene", LOAD], sort=False)
        if part["over"].nunique() > 1
    ]
    return fitted_exponent(series) if series else None


def verdict(found: Uncertain | None, law: float, band: float) -> str:
    """The verdict on what is found of a law, with half the width of its interval."""
    if found is None or math.isnan(found.value):
        return OPEN
    off = abs(found.value - law)
    return (
        OBEYED
        if off + found.uncertainty <= band
        else BROKEN
        if off - found.uncertainty > band
        else OPEN
    )


def settings_table(table: pd.DataFrame) -> pd.DataFrame:
    """A row per subject and setting, over the scenes and loads at which the default succeeded.

    `CREEP` is the `fastest`, `SLOWER` that over the default's, `TIME` the median of the engine times over the
    default's, with the ends of its interval.
    """
    rows = []
    tried = with_columns(table, CREEP, UNSURE, LETS_GO)
    tried = tried[tried[SUBJECT].notna() & ~tried["status"].isin(UNMADE)]
    for subject, group in tried.groupby(SUBJECT, sort=False):
        made = group[succeeded(group) & group[CREEP].notna()].set_index(["scene", LOAD])
        default = made[made[SETTING] == DEFAULT]
        for setting in group[SETTING].unique():
            changed = made[made[SETTING] == setting]
            shared = default.index.intersection(changed.index)
            row = {
                SUBJECT: subject,
                SETTING: setting,
                "failed": int((group[SETTING] == setting).sum()) - len(changed),
            }
            if len(shared):
                changed, unchanged = changed.loc[shared], default.loc[shared]
                worst = abs(changed.at[fastest(changed), CREEP])
                slip = abs(unchanged.at[fastest(unchanged), CREEP])
                times = ratio_interval(changed[OWN_CPU].tolist(), unchanged[OWN_CPU].tolist())
                ratio = worst / slip if slip > 0 else 1.0 if worst == 0 else math.nan
                row |= {
                    CREEP: worst,
                    UNSURE: changed.at[fastest(changed), UNSURE],
                    SLOWER: ratio,
                    TIME: times.value,
                    f"{TIME}, low": times.low,
                    f"{TIME}, high": times.high,
                }
            rows.append(row)
    return pd.DataFrame(
        rows,
        columns=[
            SUBJECT,
            SETTING,
            "failed",
            CREEP,
            UNSURE,
            SLOWER,
            TIME,
            f"{TIME}, low",
            f"{TIME}, high",
        ],
    )


def present(results: Results) -> Presentation:
    """The methods that hold, the speeds at which the others creep, and the setting that slows it most."""
    table, methods = results.table("hold"), results.table("hold-methods")
    settings, laws = results.table("hold-settings"), results.table("hold-laws")
    published = results.table("hold-published")
    if methods.empty:
        return Presentation()
    rows = {
        "measured": bool(methods[CREEP].notna().any()),
        **_verdicts(table, methods),
        **_settings(settings),
        **_laws(laws),
        **_published(published),
        "failed": [
            row_of("hold-methods", methods, label) for label in methods.index[methods["failed"] > 0]
        ],
        **CONSTANTS,
    }
    if not rows["measured"]:
        return Presentation(rows=rows)
    loads = sorted(table.loc[table[TEST] == HELD, LOAD].unique())
    by_load = _by_load(table, methods, loads)
    return Presentation(
        rows=rows,
        headlines=[_headline(methods)],
        tables=[
            *_tables(table, methods, settings, laws, by_load, loads),
            *_published_tables(published),
        ],
        figures=[_over_load(by_load, loads), *([_over_cost(settings)] if len(settings) else [])],
    )


def _at_rest(table: pd.DataFrame) -> pd.DataFrame:
    """The table with no uncertainty of a creep that is below rounding: it is written as 0."""
    return table.assign(**{UNSURE: table[UNSURE].where(table[CREEP] != 0)})


def _ranked(methods: pd.DataFrame) -> pd.DataFrame:
    """The methods that have a creep, the slowest first."""
    return methods[methods[CREEP].notna()].sort_values(CREEP, kind="stable")


def _headline(methods: pd.DataFrame) -> Headline:
    """The creep of each method, or that it lets go."""
    ranked, shown = _ranked(methods), _at_rest(methods)
    cells = {
        variant: "breaks away" if gone is True else str(row_of("hold-methods", shown, label)[CREEP])
        for label, variant, gone in zip(ranked.index, ranked["variant"], ranked[LETS_GO])
    }
    return Headline("creep at loads up to 90 % of static friction [m/s]", cells)


def _verdicts(table: pd.DataFrame, methods: pd.DataFrame) -> dict[str, object]:
    """The numbers of methods that hold, and the rows of those that creep, let go or are undecided."""
    ranked, shown = _ranked(methods), _at_rest(methods)
    own = ranked["engine"].isin(own_methods())
    fails = moving(ranked)
    gone = fails & ranked[LETS_GO].eq(True)
    creeping = [row_of("hold-methods", shown, label) for label in ranked.index[fails & ~gone]]
    return {
        "engines": _held(ranked[~own]),
        "own": _held(ranked[own]),
        "creeping": creeping,
        "regularized": [row for row in creeping if row[OF_ZONE] is not None],
        "let_go": [
            {
                "method": row_of("hold-methods", shown, label),
                "ramp": _worst_ramp(table, methods.at[label, "variant"]),
            }
            for label in ranked.index[gone]
        ],
        "undecided": list(ranked.loc[ranked[HOLDS].isna(), "variant"]),
    }


def _held(methods: pd.DataFrame) -> dict[str, int]:
    """The number of methods that hold, and that of all."""
    return {"holding": int(methods[HOLDS].eq(True).sum()), "all": len(methods)}


def _worst_ramp(table: pd.DataFrame, variant: str) -> Row | None:
    """The run of a method under a slow ramp that breaks away farthest from the limit."""
    full = with_columns(table, BREAK_AWAY, BREAK_UNSURE, "bound")
    ramps = at_equal_step(full, variant).dropna(subset=[BREAK_AWAY])
    return row_of("hold", full, ramps[BREAK_AWAY].abs().idxmax()) if len(ramps) else None


def _settings(settings: pd.DataFrame) -> dict[str, object]:
    """The setting with the least creep of each subject whose default creeps, and that which helps most of these.

    It leaves the least part of the default's creep and, of equal ones, takes the least time.
    """
    if settings.empty:
        return {"best_settings": [], "most_helpful": None}
    shown = _at_rest(settings)
    best, defaults = [], {}
    whole = settings[settings["failed"].eq(0) & settings[CREEP].notna()]
    for _, rows in whole.groupby(SUBJECT, sort=False):
        # of settings with the same creep, which is often 0, the fastest
        slowest = int(rows.sort_values([CREEP, TIME], kind="stable").index[0])
        default = rows[rows[SETTING] == DEFAULT]
        if (default[CREEP] > STILL).any() and rows.at[slowest, SETTING] != DEFAULT:
            best.append(slowest)
            defaults[slowest] = default.index[0]
    most_helpful = None
    if best:
        first = min(best, key=lambda label: tuple(settings.loc[label, [SLOWER, TIME]]))
        most_helpful = {
            "setting": row_of("hold-settings", shown, first),
            "default": row_of("hold-settings", shown, defaults[first]),
        }
    return {
        "best_settings": [row_of("hold-settings", shown, label) for label in best],
        "most_helpful": most_helpful,
    }


def _laws(laws: pd.DataFrame) -> dict[str, object]:
    """The verdict on the reference, and the rows of the laws of creep by verdict."""
    rows = [row_of("hold-laws", laws, label) for label in laws.index]
    of_creep = [row for row in rows if row[SUBJECT] != REFERENCE]
    by_verdict = {
        word: [row for row in of_creep if row["verdict"] == word] for word in (OBEYED, BROKEN, OPEN)
    }
    of_reference = [row for row in rows if row[SUBJECT] == REFERENCE]
    reference = None
    if of_reference:
        row = of_reference[0]
        reference = {
            "runs": row["runs"],
            "rests": row["verdict"] == OBEYED,
            "creeps": row["verdict"] == BROKEN,
        }
    return {"reference": reference, **by_verdict}


def _published(published: pd.DataFrame) -> dict[str, object]:
    """The farthest of our numbers from published ones, without those that chose the model; why there is none."""
    if PUBLISHED not in published:
        reasons = list(published["reason"]) if len(published) else []
        return {"farthest": None, "published_failed": reasons}
    others = published[published[PUBLISHED].notna() & ~published[MATCHED].astype(bool)]
    farthest = (others[OURS] / others[PUBLISHED] - 1).abs().idxmax()
    return {"farthest": row_of("hold-published", published, farthest), "published_failed": []}


def _published_tables(published: pd.DataFrame) -> Iterator[TableView]:
    """Published creep and ours, case by case."""
    if PUBLISHED in published:
        columns = (
            Column("case"),
            Column(PUBLISHED, "creep, published", form="g"),
            Column(OURS, "creep, computed here", interval=True),
            Column("margin", "Coulomb limit / weight", form=".3g"),
            Column(MATCHED),
            Column("source", brief=False),
        )
        yield view("hold-published", published, columns)


Rows = list[tuple[dict[str, Any], pd.DataFrame]]
"""Rows of a table, each with the runs that it sums up."""


def _tables(
    table: pd.DataFrame,
    methods: pd.DataFrame,
    settings: pd.DataFrame,
    laws: pd.DataFrame,
    by_load: Rows,
    loads: Sequence[float],
) -> Iterator[TableView]:
    """Creep by method and load, what is beyond the limit, settings, laws, and every run."""
    at_loads = [
        Column(
            f"creep at {load:g}",
            f"{100 * load:g} %",
            uncertainty=f"uncertainty at {load:g}",
            of=CREEP,
        )
        for load in loads
    ]
    yield view(
        "hold",
        by_load,
        (
            METHOD,
            Column("fidelity"),
            Column(FRICTION_BY),
            *at_loads,
            Column("scene", "fastest on", brief=False),
            Column(HOLDS),
        ),
    )
    usual = with_columns(table, CREEP, UNSURE, LETS_GO)
    usual = usual[
        usual[SUBJECT].isna() & usual[TEST].eq(HELD) & usual[LOAD].eq(USUAL) & usual[CREEP].notna()
    ]
    yield view(
        "hold-steps",
        _at_rest(
            usual.loc[[fastest(runs) for _, runs in usual.groupby(["variant", "step"], sort=False)]]
        ),
        (
            METHOD,
            REFINED_BY,
            Column("step", form="g"),
            Column(CREEP),
            Column(OF_STEP, "of g dt", form=".2g"),
            Column(OF_ZONE, "of the regularization", form=".2g"),
            Column("scene", "on"),
        ),
        source="hold",
        in_report=False,
    )
    moved = _beyond(table, methods)
    if moved:
        yield view(
            "hold-limit",
            moved,
            (
                METHOD,
                Column("fidelity"),
                Column(LANDED, "initial displacement", form=".2g"),
                Column(
                    BREAK_AWAY,
                    "break-away load, relative to the limit",
                    "%",
                    interval=True,
                    scale=100,
                    bound="bound",
                ),
                Column(FASTER, "acceleration", "%", form=".2g", scale=100),
                Column(STOPPED, "position at rest"),
            ),
            source="hold",
        )
    if len(settings):
        yield view(
            "hold-settings",
            _at_rest(settings),
            (
                Column(SUBJECT, "engine"),
                Column(SETTING),
                Column(CREEP),
                Column(SLOWER, "creep / default", form=".2g"),
                Column(TIME, form=".2g"),
                Column("failed"),
            ),
        )
    if len(laws) and laws[SUBJECT].ne(REFERENCE).any():
        yield view(
            "hold-laws",
            laws,
            (
                Column(SUBJECT, "engine"),
                Column("over"),
                Column("kind"),
                Column("law", form="g"),
                Column(FOUND, interval=True),
                Column("runs"),
                Column("verdict"),
                Column("source", brief=False),
            ),
        )
    every = [Column(name) for name in table if name not in ("settings", "version", AGAIN)]
    yield view("hold-all", table, every, source="hold", in_report=False)


def _by_load(table: pd.DataFrame, methods: pd.DataFrame, loads: Sequence[float]) -> Rows:
    """The fastest creep of each method at each load."""
    own = with_columns(table[table[SUBJECT].isna()], CREEP, UNSURE, LETS_GO)
    rows = []
    for _, method in methods.iterrows():
        runs = at_equal_step(own, method["variant"])
        held = _at_rest(runs[runs[TEST].eq(HELD) & runs[CREEP].notna()])
        row = {
            **method[["variant", "fidelity", "scene"]],
            HOLDS: OPEN if pd.isna(method[HOLDS]) else method[HOLDS],
            FRICTION_BY: next(iter(runs[FRICTION_BY].dropna()), ""),
        }
        for load in loads:
            under_load = held[held[LOAD] == load]
            if len(under_load):
                worst = under_load.loc[fastest(under_load)]
                row |= {
                    f"creep at {load:g}": abs(worst[CREEP]),
                    f"uncertainty at {load:g}": worst[UNSURE],
                }
        rows.append((row, held))
    return rows


def _beyond(table: pd.DataFrame, methods: pd.DataFrame) -> Rows:
    """The worst landing, break-away, acceleration and stop of each method."""
    own = with_columns(
        table[table[SUBJECT].isna()],
        LANDED,
        BREAK_AWAY,
        BREAK_UNSURE,
        FASTER,
        STOPPED,
        STOP_UNSURE,
        "bound",
    )
    # displacements by rounding are 0, without an uncertainty
    exact = own[[LANDED, STOPPED]].abs() < ROUNDING
    own = own.assign(
        **{column: own[column].mask(exact[column], 0.0) for column in exact},
        **{STOP_UNSURE: own[STOP_UNSURE].mask(exact[STOPPED])},
    )
    rows: Rows = []
    if own[BREAK_AWAY].isna().all():
        return rows
    for _, method in methods.iterrows():
        runs, row = at_equal_step(own, method["variant"]), {**method[["variant", "fidelity"]]}
        for names in (
            (LANDED,),
            (BREAK_AWAY, BREAK_UNSURE, "bound"),
            (FASTER,),
            (STOPPED, STOP_UNSURE),
        ):
            if runs[names[0]].notna().any():
                row |= dict(runs.loc[runs[names[0]].abs().idxmax(), list(names)])
        rows.append((row, runs))
    return rows


def _over_load(by_load: Rows, loads: Sequence[float]) -> Chart:
    """A panel a fidelity, a line a method."""
    panels = []
    for fidelity in Fidelity:
        series = []
        for row, _ in by_load:
            known = [load for load in loads if f"creep at {load:g}" in row]
            creep = np.array([row[f"creep at {load:g}"] for load in known], dtype=float)
            if row["fidelity"] == fidelity and creep.any():
                series.append(
                    Series(
                        row["variant"],
                        100 * np.array(known),
                        np.clip(creep, *ENDS),
                        look=row["variant"],
                        points=True,
                    )
                )
        if series:
            panels.append(
                Panel(f"{fidelity.label} fidelity", Axis("load [% of the limit]"), SPEEDS, series)
            )
    return Chart("hold", panels, columns=2, height=2.8, share_y=True)


def _over_cost(settings: pd.DataFrame) -> Chart:
    """A panel a subject, each choice a point."""
    panels = []
    for subject, rows in settings[settings[CREEP].notna()].groupby(SUBJECT, sort=False):
        is_default = rows[SETTING] == DEFAULT
        times, creep = rows[TIME].clip(upper=SLOWEST), rows[CREEP].clip(*ENDS)
        series = [
            Series(
                label,
                times[chosen].to_numpy(float),
                creep[chosen].to_numpy(float),
                look=look,
                line=False,
                points=True,
            )
            for label, look, chosen in (
                ("another choice", OTHER, ~is_default),
                (DEFAULT, CHOSEN, is_default),
            )
            if chosen.any()
        ]
        panels.append(
            Panel(
                str(subject),
                Axis("engine time / default", limits=(0.0, 1.05 * SLOWEST)),
                SPEEDS,
                series,
            )
        )
    return Chart("hold-settings", panels, columns=2, height=1.5, share_x=True, share_y=True)


STUDY = Study(
    "hold",
    "Hold",
    "Does a slider remain at rest under a load below the limit of static friction?",
    present,
    plan,
    seconds=0.1,
    needs_scene=False,
    takes=frozenset({"engines"}),
    tables={
        "hold": "Runs of sliders that should be held",
        "hold-laws": "Laws of creep",
        "hold-methods": "Creep by method",
        "hold-published": "Published creep, and ours",
        "hold-settings": "Creep by setting",
    },
)
