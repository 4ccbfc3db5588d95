"""Verdicts on the paper's statements about its example, for its true motion and for runs of the HLCP scheme.

Source: Zhuang & Wang, Acta Mech. Sin. 30(3), 437-446 (2014). ``data/paper_claims.toml`` quotes each statement
with its place in the paper, and names the measure that tests it. A measure returns a margin, which is positive
where the statement holds. It is evaluated on four stretches of motion: the truth from the start and in its steady
state, and a run of the paper's scheme from the start and in its last period. The verdict follows from the four
margins. Shorter and coarser runs then show which length and which step a run needs for the statement to hold.
"""

from __future__ import annotations

import textwrap
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.presentation import (
    Column,
    Presentation,
    TableView,
    view,
)
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables, only_cases_of_paper
from stiction.comparisons.measures.claim_measures import (
    CORNERS,
    EFFORT,
    LINE,
    MEASURES,
    ClaimMargin,
    Example,
)
from stiction.comparisons.measures.drift_growth import DECAYS, INCONCLUSIVE, ROUNDED
from stiction.comparisons.measures.steady_stretch import (
    Stretch,
    run_stretch,
    steady_stretch,
    truth_stretch,
)
from stiction.comparisons.studies.long_drift import (
    LENGTHS,
    NONE,
    PAPERS,
    Law,
    decisive_runs,
    drift_study_comparison,
)
from stiction.comparisons.studies.threshold import STUDY as THRESHOLD_STUDY
from stiction.comparisons.studies.threshold import TRUTH
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, load_scene, vary
from stiction.truths import NoMotion, StickThreshold, Tier, slider_bar_truth
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import NoSteadyState, stick_threshold

HOLDS = "holds"
"""The claim holds on every stretch of motion."""
STEADY = "holds in the steady state only"
"""The claim holds on the stretches of the steady state, but not on all of those from the start."""
PARTLY = "partly"
"""Truth and run disagree, or a part of the claim holds."""
FAILS = "does not hold"
"""The claim holds on no stretch, not even in part."""
CONTRADICTS = "contradicts itself"
"""The claim holds and cannot be true together with another statement of the paper."""
NOT_TESTABLE = "not testable"
"""The claim has no measure, for instance because it is a definition."""
UNDECIDED = "not decided"
"""A margin is unknown on some stretch."""
VERDICTS: Mapping[str, str] = {
    "holding": HOLDS,
    "steady": STEADY,
    "partly": PARTLY,
    "contradicting": CONTRADICTS,
    "failing": FAILS,
    "not_testable": NOT_TESTABLE,
    "undecided": UNDECIDED,
}
"""Verdicts by the names under which the text of the study counts the statements."""
NO_CHANGE = "none"
"""Entry of the columns of changes for a choice that changes nothing."""
NOT_KNOWN = "not known: the first choice has no result"
"""Entry of the columns of changes where there is no result to compare with."""


class Part(StrEnum):
    """A stretch of motion on which a claim is measured: of the truth, or of a run of the paper's scheme."""

    TRUTH_FROM_START = "truth_from_start"
    TRUTH_STEADY = "truth_steady"
    RUN_FROM_START = "run_from_start"
    RUN_LAST_PERIOD = "run_last_period"

    @property
    def is_steady(self) -> bool:
        """Whether the stretch belongs to the steady state."""
        return self in (Part.TRUTH_STEADY, Part.RUN_LAST_PERIOD)

    @property
    def margin(self) -> str:
        """Key of the column that contains the margin on this stretch."""
        return f"margin_{self}"

    @property
    def label(self) -> str:
        """Description for readers, for example ``truth, from the start``."""
        return {
            Part.TRUTH_FROM_START: "truth, from the start",
            Part.TRUTH_STEADY: "truth, steady",
            Part.RUN_FROM_START: "HLCP, from the start",
            Part.RUN_LAST_PERIOD: "HLCP, last period",
        }[self]


RUN = 80.0
"""Length of a run of the scheme, s; its last period is taken as its steady state.

The slowest multiplier of the return maps is 0.5 in 8 s. At the beginning of the last period, 0.5^9 of a deviation is
left, which is less than the width of a printed line, see `LINE`.
"""
FROM_START = 24.0
"""Length of the stretch from the start, s: that of the paper's figures."""
STEPS = (1e-2, 5e-3, 2.5e-3)
"""Steps of the runs of the scheme, s. The verdict is taken at the last one; at 1 ms all verdicts are the same."""

Simulate = Callable[[Scene, float, float], Trajectory]
"""Function of a scene, t_end (s) and a step (s) that returns a run."""
View = Callable[[Scene], Stretch]
"""Function that returns one stretch of a scene's motion."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper; its fields are the keys of ``data/paper_claims.toml``.

    Attributes
    ----------
    case : str
        Numbers of the cases that the statement is about: ``"1"`` or ``"1, 2"``; ``"-"`` for none.
    page : str
        Page of Sect. 5.
    words : str
        The quotation.
    measure : str
        Name of a function in `MEASURES`; empty if the statement cannot be tested.
    arguments : Mapping
        Further arguments of the measure.
    remark : str
        Text that follows the meaning of the margin.
    why : str
        Reason why there is no measure.
    beginning : bool
        True if the statement is about the beginning of the motion alone.
    contradiction : str
        Another statement that cannot be true together with this one.
    """

    case: str
    page: str
    words: str
    measure: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""
    why: str = ""
    beginning: bool = False
    contradiction: str = ""

    @property
    def place(self) -> str:
        """Place of the statement in the paper."""
        return f"Sect. 5, p. {self.page}"

    @property
    def number(self) -> int:
        """Number of the case, the first one if there are several."""
        return int(self.case[0])

    def margin_in(self, views: Views, view: View) -> ClaimMargin:
        """Measure the claim in one view; the margin is nan where the scene has no such motion."""
        measure = MEASURES[self.measure]
        example = Example(views.cases, views.threshold, view)
        try:
            return measure(example, self.number, **self.arguments)
        except (NoSteadyState, NoMotion) as error:
            return ClaimMargin(float("nan"), why=str(error))


_QUOTED = tomllib.loads(
    (resources.files("stiction.comparisons") / "data" / "paper_claims.toml").read_text("utf-8")
)
CHOICES: Mapping[str, Mapping[str, Any]] = _QUOTED["choices"]
"""Values that the paper does not state, as overrides for `stiction.scenes.vary`; the first choice is ours."""


def claims() -> tuple[Claim, ...]:
    """Return the paper's statements about its example in their order, without those about drift."""
    return tuple(Claim(**entry) for entry in _QUOTED["claim"])


def paper_run(scene: Scene, t_end: float, step: float) -> Trajectory:
    """Run the paper's scheme with its stabilization; samples are stored every step, at intervals of 2 ms at least."""
    return ReferenceEngine().simulate(
        scene, t_end=t_end, dt=step, output_step=max(step, 2e-3), assemble=True
    )


class Views:
    """The stretches of motion on which claims are measured. Each motion is computed once, when first needed."""

    def __init__(
        self, cases: Mapping[int, Scene], threshold: StickThreshold, simulate: Simulate = paper_run
    ):
        self.cases, self.threshold = cases, threshold
        self._simulate = simulate
        self._stretches: dict[tuple[str, object], Stretch] = {}

    def steady_truth(self, scene: Scene) -> Stretch:
        """Return one period of the true steady state."""
        return self._once(scene, "steady", lambda: steady_stretch(scene))

    def truth(self, scene: Scene) -> Stretch:
        """Return the first `FROM_START` seconds of the true motion."""
        return self._once(
            scene, "truth", lambda: truth_stretch(scene, slider_bar_truth(scene, FROM_START))
        )

    def run(self, step: float, scene: Scene) -> Stretch:
        """Return a whole run of the scheme, of the number of periods that is nearest to `RUN` seconds."""
        period = SliderBar.from_scene(scene).period()
        t_end = period * max(2, round(RUN / period))
        return self._once(
            scene, step, lambda: run_stretch(scene, self._simulate(scene, t_end, step), step)
        )

    def beginning(self, step: float, scene: Scene) -> Stretch:
        """Return the first `FROM_START` seconds of a run of the scheme."""
        return self.run(step, scene).between(0.0, FROM_START)

    def period(self, step: float, age: float, scene: Scene) -> Stretch:
        """Return the period that ends about `age` seconds before the end of a run, or else its first period."""
        whole = self.run(step, scene)
        periods_before_end = min(round(age / whole.period), round(whole.end / whole.period) - 1)
        end = whole.end - periods_before_end * whole.period
        return whole.between(end - whole.period, end)

    def _once(self, scene: Scene, kind: object, compute: Callable[[], Stretch]) -> Stretch:
        """Return the stretch of this kind, which is the step of a run or a name for a truth."""
        key = scene.to_toml(), kind
        if key not in self._stretches:
            self._stretches[key] = compute()
        return self._stretches[key]


def claims_comparison(
    cases: Mapping[int, Scene], threshold: StickThreshold
) -> Comparison[pd.DataFrame]:
    """Plan `claims_table` for all claims: one task per value of `Claim.case`, as its claims share motions.

    If a task fails, one row replaces its claims.
    """
    first_place: dict[str, int] = {}
    for place, claim in enumerate(claims()):
        first_place.setdefault(claim.case, place)

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        parts = []
        for case, outcome in zip(first_place, outcomes, strict=True):
            table = outcome.value
            if table is None:
                row = {
                    "case": case,
                    "place": "",
                    "claim": f"[all about case {case}]",
                    "verdict": UNDECIDED,
                    "why": outcome.reason,
                }
                table = pd.DataFrame(row, [first_place[case]])
            parts.append(table.assign(status=outcome.status, reason=outcome.reason))
        # The index is the place of a claim in the paper.
        return pd.concat(parts).sort_index().reset_index(drop=True)

    tasks = [
        Task(f"claims/{case}", claims_table, (dict(cases), threshold, case)) for case in first_place
    ]
    return Comparison(tuple(tasks), tabulate)


def claims_table(cases: Mapping[int, Scene], threshold: StickThreshold, about: str) -> pd.DataFrame:
    """Return one row per claim: words and place, verdict, margins, and the run and step that it needs.

    Parameters
    ----------
    cases : Mapping[int, Scene]
        The paper's cases by number.
    threshold : StickThreshold
        The stick threshold of the first case.
    about : str
        Only claims with this `Claim.case` have a row. The index is their place among `claims`.
    """
    views = Views(cases, threshold)
    chosen = {place: claim for place, claim in enumerate(claims()) if claim.case == about}
    rows = [
        {
            "case": claim.case,
            "place": claim.place,
            "claim": claim.words,
            **_examine(claim, views),
            "truth_tier": Tier.HIGH_PRECISION,
        }
        for claim in chosen.values()
    ]
    return pd.DataFrame(rows, index=list(chosen))


def drift_claims(study: pd.DataFrame, scene: str) -> list[dict[str, Any]]:
    """Return rows, as those of `claims_table`, for the two statements about Fig. 14.

    `study` is the table of the study of drift over long runs. The laws of growth of its longest runs decide. For
    drift that should grow, the margin is the lower end of the exponent's confidence interval. For drift that should
    be bounded, it is how far the spread of the drift is below that of a random walk. Drift that is no larger than
    the rounding of a coordinate counts as bounded, because the statement is about the method.
    """
    rows = []
    for entry in _QUOTED["drift_claim"]:
        choice = PAPERS if entry["stabilized"] else NONE
        rows.append(_drift_row(decisive_runs(study, scene, choice), **entry))
    return rows


def _drift_row(
    decisive: Sequence[tuple[Mapping[Any, Any], Law]],
    words: str,
    stabilized: bool,
    allowed: Sequence[str],
    margin: str,
) -> dict[str, Any]:
    """Return the row of one statement about drift.

    Parameters
    ----------
    decisive : sequence of (row, Law)
        The runs that decide, see `decisive_runs`.
    words, stabilized, allowed, margin
        The keys of ``[[drift_claim]]`` in ``data/paper_claims.toml``; `allowed` lists the laws of growth with which
        the statement is true.
    """
    runs = [run for run, _ in decisive]
    laws = [law for _, law in decisive]
    row: dict[str, Any] = {
        "case": "-",
        "place": "Sect. 5, p. 445",
        "claim": words,
        "verdict": _drift_verdict(laws, allowed),
        "margin_kind": margin,
        "truth_tier": "closed form",
        "study_runs": "; ".join(run["run"] for run in runs),
    }
    # Neither drift by rounding nor a run that is too short yields an exponent or a spread.
    fitted = [law for law in laws if law.verdict not in (ROUNDED, INCONCLUSIVE)]
    if stabilized:
        # The spread of a residual that decays is large, although it is within any bound.
        fitted = [law for law in fitted if law.verdict != DECAYS]
    if fitted and stabilized:
        row[Part.RUN_FROM_START.margin] = min(1 - law.spread for law in fitted)
    elif fitted:
        row[Part.RUN_FROM_START.margin] = min(law.exponent - law.interval for law in fitted)
    sufficient_lengths = [
        length
        for length in LENGTHS
        if runs and all(run.get(f"growth_{length:g}s") in allowed for run in runs)
    ]
    if sufficient_lengths:
        row["run_needed"] = sufficient_lengths[0]
        row["step_needed"] = max(run["step"] for run in runs)
    return row


def _drift_verdict(laws: Sequence[Law], allowed: Sequence[str]) -> str:
    """Return the verdict on a statement that is true with the `allowed` laws of growth."""
    # A run that is too short does not count for or against the statement.
    is_allowed = [law.verdict in allowed for law in laws if law.verdict != INCONCLUSIVE]
    if not is_allowed:
        return UNDECIDED
    if all(is_allowed):
        return HOLDS
    return PARTLY if any(is_allowed) else FAILS


def _examine(claim: Claim, views: Views) -> dict[str, Any]:
    """Return the columns of a claim that follow from its measure: verdict, reason, margins, run and step needed."""
    if not claim.measure:
        return {"verdict": NOT_TESTABLE, "why": claim.why}
    margins = margins_of(claim, views)
    decision = verdict_of(claim, margins)
    reasons = [f"{part.label}: {margin.why}" for part, margin in margins.items() if margin.why]
    meaning = _QUOTED["margin"][claim.measure].format(LINE=LINE, **claim.arguments)
    row: dict[str, Any] = {
        "verdict": decision,
        "why": claim.contradiction if decision == CONTRADICTS else "; ".join(reasons),
        "margin_kind": meaning + claim.remark,
    }
    row |= {part.margin: margin.margin for part, margin in margins.items()}
    if decision in (HOLDS, STEADY, CONTRADICTS):
        row["run_needed"] = _shortest_run(claim, views)
        row["step_needed"] = _coarsest_step(claim, views)
    return row


def margins_of(claim: Claim, views: Views, truths_only: bool = False) -> dict[Part, ClaimMargin]:
    """Measure a claim on each stretch of motion; a claim about the beginning only on stretches from the start."""
    view_of_part: dict[Part, View] = {
        Part.TRUTH_FROM_START: views.truth,
        Part.TRUTH_STEADY: views.steady_truth,
    }
    if not truths_only:
        view_of_part[Part.RUN_FROM_START] = partial(views.beginning, STEPS[-1])
        view_of_part[Part.RUN_LAST_PERIOD] = partial(views.period, STEPS[-1], 0)
    return {
        part: claim.margin_in(views, view)
        for part, view in view_of_part.items()
        if not (part.is_steady and claim.beginning)
    }


def verdict_of(claim: Claim, margins: Mapping[Part, ClaimMargin]) -> str:
    """Return the verdict that follows from the margins on each stretch.

    The constants of this module define the verdicts. A margin that is nan leaves the claim undecided.
    """
    if any(np.isnan(margin.margin) for margin in margins.values()):
        return UNDECIDED
    if all(margin.holds for margin in margins.values()):
        return CONTRADICTS if claim.contradiction else HOLDS
    holds_in_steady_state = [margin.holds for part, margin in margins.items() if part.is_steady]
    if holds_in_steady_state and all(holds_in_steady_state):
        return STEADY
    if any(margin.holds or margin.some for margin in margins.values()):
        return PARTLY
    return FAILS


def _shortest_run(claim: Claim, views: Views) -> float:
    """Return the length (s) of the shortest run from which on the claim holds in every period."""
    if claim.beginning:
        return FROM_START
    period = SliderBar.from_scene(views.cases[claim.number]).period()
    # Go back from the last period, one period at a time, up to the first period of the run or to
    # one in which the claim fails.
    periods_back = 0
    while (periods_back + 2) * period <= RUN:
        age = (periods_back + 1) * period
        if not claim.margin_in(views, partial(views.period, STEPS[-1], age)).holds:
            break
        periods_back += 1
    return RUN - periods_back * period


def _coarsest_step(claim: Claim, views: Views) -> float:
    """Return the coarsest of `STEPS` (s) with which, and with all finer ones, the claim holds."""
    coarsest = STEPS[-1]
    for step in reversed(STEPS[:-1]):
        view = partial(views.beginning, step) if claim.beginning else partial(views.period, step, 0)
        if not claim.margin_in(views, view).holds:
            break
        coarsest = step
    return coarsest


SAMPLING = 1e-5
"""Relative difference up to which two values of a quantity count as equal.

Maxima are taken over 4000 samples a period. The fastest oscillation here has four periods of the bar in one period of
the load, so that its maximum is missed by up to (2 pi 4/4000)^2/8 = 5e-6 of its value.
"""
THRESHOLD = "threshold_on_F0"
"""Column: the stick threshold of case 1, N."""


@dataclass(frozen=True)
class Sensitivity:
    """Results of the truth under one choice.

    Attributes
    ----------
    numbers : Mapping[str, float]
        Values by the key of their column.
    verdicts : Mapping[str, str]
        Verdicts by case and words of the claim.
    reason : str
        Why numbers are missing; empty if none is.
    """

    numbers: Mapping[str, float]
    verdicts: Mapping[str, str]
    reason: str = ""


def sensitivity(cases: Mapping[int, Scene], overrides: Mapping[str, Any]) -> Sensitivity:
    """Measure the truth of the paper's cases, changed by `overrides` of `stiction.scenes.vary`."""
    varied = {case: vary(scene, overrides) if overrides else scene for case, scene in cases.items()}
    threshold = stick_threshold(varied[1])
    views = Views(varied, threshold)
    numbers = {} if threshold.F0 is None else {THRESHOLD: threshold.F0}
    reasons = [threshold.note] if threshold.F0 is None else []
    verdicts = {
        f"case {claim.case}: {claim.words}": verdict_of(
            claim, margins_of(claim, views, truths_only=True)
        )
        for claim in claims()
        if claim.measure
    }
    for case, scene in varied.items():
        try:
            steady = views.steady_truth(scene)
        except (NoSteadyState, NoMotion) as error:
            reasons.append(f"case {case}: {error}")
            continue
        # The steady state may have several periods of the load: the stick time is per period.
        stick_time = steady.stick_time * steady.period / (steady.end - steady.start)
        numbers |= {
            f"stick_time_case_{case}": stick_time,
            f"largest_corner_force_case_{case}": steady.maximum(*CORNERS),
            f"largest_moment_case_{case}": steady.maximum(EFFORT),
        }
    return Sensitivity(numbers, verdicts, "; ".join(reasons))


def sensitivity_comparison(cases: Mapping[int, Scene]) -> Comparison[pd.DataFrame]:
    """Plan the table of the choices that the paper leaves open: a row per choice.

    Columns: ``choice``; ``status`` and ``reason``, why a number or the whole row is missing; ``claims_that_change``,
    the verdicts on the truth that differ from those under the first choice; ``numbers_that_change``, the values that
    differ from those under the first choice by more than `SAMPLING`; and all of `Sensitivity.numbers`.
    """

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        first: Sensitivity | None = outcomes[0].value
        rows = []
        for choice, outcome in zip(CHOICES, outcomes, strict=True):
            row = {"choice": choice, "status": outcome.status, "reason": outcome.reason}
            if outcome.value is not None:
                row |= _sensitivity_columns(outcome.value, first)
            rows.append(row)
        return pd.DataFrame(rows)

    tasks = [
        Task(f"sensitivity/{choice}", sensitivity, (dict(cases), overrides))
        for choice, overrides in CHOICES.items()
    ]
    return Comparison(tuple(tasks), tabulate)


def _sensitivity_columns(chosen: Sensitivity, first: Sensitivity | None) -> dict[str, Any]:
    """Return the columns of a choice; `first` contains the results under the first choice, None if it failed."""
    return {
        "reason": chosen.reason,
        "claims_that_change": NOT_KNOWN if first is None else _changed_verdicts(chosen, first),
        "numbers_that_change": NOT_KNOWN if first is None else _changed_numbers(chosen, first),
        **chosen.numbers,
    }


def _changed_verdicts(chosen: Sensitivity, first: Sensitivity) -> str:
    """Return the claims whose verdicts differ under two choices, with both verdicts."""
    changes = []
    for words, verdict_of_choice in chosen.verdicts.items():
        before = first.verdicts.get(words, UNDECIDED)
        if verdict_of_choice != before:
            claim = textwrap.shorten(words, 90, placeholder=" ..")
            changes.append(f'"{claim}" {verdict_of_choice} (was: {before})')
    return "; ".join(changes) or NO_CHANGE


def _changed_numbers(chosen: Sensitivity, first: Sensitivity) -> str:
    """Return the quantities whose values differ under two choices, with the relative changes."""
    changes = []
    for name, before in first.numbers.items():
        after = chosen.numbers.get(name, before)
        is_changed = abs(after - before) > SAMPLING * abs(before)
        if not is_changed:
            continue
        label = quantity_of(name).label
        if before:
            changes.append(f"{label} {100 * (after / before - 1):+.2g} %")
        else:
            changes.append(f"{label} {after:.3g} (was: 0)")
    return "; ".join(changes) or NO_CHANGE


def general_claims() -> list[dict[str, Any]]:
    """Return rows, as those of `claims_table`, for statements about all systems.

    One counter-example decides. It is a mechanism of the paper's kind, with one driving constraint and one
    frictional translational joint. Its motion is given by kinematics; its forces at t = 0 are all solutions of the
    HLCP (`Trajectory.alternatives`).
    """
    rows = []
    for entry in _QUOTED["general_claim"]:
        scene = load_scene(entry["scene"])
        effort = entry["effort"]
        run = ReferenceEngine().simulate(scene, t_end=scene.t_end, dt=scene.t_end / 100)
        alternatives = run.alternatives.get(effort)
        if alternatives is None:
            solutions = run[effort][:1]
        else:
            solutions = alternatives[0][~np.isnan(alternatives[0])]
        # Forces can be "computed easily" if the HLCP has fewer than two solutions.
        margin = 2.0 - len(solutions)
        values = " or ".join(f"{value:.5g}" for value in solutions)
        rows.append(
            {
                "case": "-",
                "place": entry["place"],
                "claim": entry["words"],
                "verdict": HOLDS if margin > 0.0 else FAILS,
                "why": f"{scene.name} at t = 0: {effort} of {values} N",
                "margin_kind": entry["margin"],
                "truth_tier": "closed form",
                Part.RUN_FROM_START.margin: margin,
            }
        )
    return rows


def general_claims_comparison() -> Comparison[pd.DataFrame]:
    """Plan `general_claims` as one task; if it fails, one row states the reason."""

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        (outcome,) = outcomes
        rows = outcome.value
        if rows is None:
            rows = [
                {
                    "case": "-",
                    "place": "",
                    "claim": "[about all systems]",
                    "verdict": UNDECIDED,
                    "why": outcome.reason,
                }
            ]
        return pd.DataFrame(rows).assign(status=outcome.status, reason=outcome.reason)

    return Comparison((Task("claims/general", general_claims, ()),), tabulate)


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the claims about the motion, about drift and about all systems, and at full depth the open choices."""
    cases = dict(enumerate(scope.scenes, 1))
    parts: list[Comparison[Any]] = [
        claims_comparison(cases, scope.known[TRUTH][cases[1].name][True].threshold),
        drift_study_comparison(cases, scope.depth),
        general_claims_comparison(),
    ]
    if extent(scope.depth).sensitivity:
        parts.append(sensitivity_comparison(cases))

    def combine(yields: list[Any]) -> Tables:
        motion, drift, general, *open_choices = yields
        about_drift = pd.DataFrame(drift_claims(drift.tables["study"], scope.scenes[0].name))
        about_drift = about_drift.assign(status=Status.OK, reason="")
        tables = {"claims": pd.concat([motion, about_drift, general], ignore_index=True)}
        if open_choices:
            (tables["sensitivity"],) = open_choices
        return Tables(tables)

    return side_by_side(parts, combine)


def present(results: Results) -> Presentation:
    """Present the number of statements with each verdict, and in full those that do not simply hold."""
    table = results.table("claims")
    if table.empty:
        return Presentation()
    choices = results.table("sensitivity")
    rows = {
        "statements": len(table),
        **{name: int((table["verdict"] == verdict).sum()) for name, verdict in VERDICTS.items()},
        "open_choices": _open_choices(choices) if len(choices) else None,
    }
    tables = _claims_views(table)
    if len(choices):
        columns = [Column(str(name)) for name in choices if name not in ("status", "reason")]
        tables.append(view("sensitivity", choices, columns, in_report=False))
    return Presentation(rows=rows, tables=tables)


def _open_choices(choices: pd.DataFrame) -> dict[str, int]:
    """Return the numbers of choices: tried, with a result to compare, and with a verdict that differs."""
    changes = choices.get("claims_that_change", pd.Series(dtype=object)).dropna()
    compared = changes[changes != NOT_KNOWN]
    return {
        "tried": len(choices),
        "compared": len(compared),
        "changing": int((compared != NO_CHANGE).sum()),
    }


def _claims_views(table: pd.DataFrame) -> list[TableView]:
    """Return the tables of the statements that do not simply hold, and of all; rare verdicts come first."""
    ordered = table.sort_values(
        "verdict", key=lambda verdicts: verdicts.map(verdicts.value_counts()), kind="stable"
    )
    parts = [part for part in Part if part.margin in table]
    ordered["margins"] = [_margins_text(row, parts) for row in ordered.to_dict("records")]
    columns_in_report = (
        Column("case"),
        Column("verdict"),
        Column("claim", "statement"),
        Column("why", "reason"),
    )
    all_columns = (
        *columns_in_report,
        Column("place", "where"),
        Column("margins"),
        Column("run_needed", "run needed"),
        Column("step_needed", "step needed"),
    )
    not_holding = ordered[ordered["verdict"] != HOLDS]
    return [
        view("claims-open", not_holding, columns_in_report, source="claims"),
        view("claims", ordered, all_columns, in_report=False),
    ]


def _margins_text(row: Mapping[Any, Any], parts: Sequence[Part]) -> str:
    """Return the margins of a claim as text: ``truth, steady: 0.31; HLCP, last period: 0.3``."""
    margins = [
        f"{part.label}: {row[part.margin]:.2g}" for part in parts if pd.notna(row[part.margin])
    ]
    return "; ".join(margins)


STUDY = Study(
    "claims",
    "The paper",
    "Do the statements of the paper hold?",
    present,
    plan,
    THRESHOLD_STUDY.requires,
    seconds=1.9,
    compared=False,
    applies=only_cases_of_paper,
    tables={
        "claims": "Statements of the paper, and whether they hold",
        "sensitivity": "Choices that the paper leaves open",
    },
)
