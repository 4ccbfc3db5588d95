"""The paper's sentences about its example: which hold on the truth, and which on runs of its HLCP scheme.

Source: Zhuang & Wang, Acta Mech. Sin. 30(3), 437-446 (2014); ``data/paper_claims.toml`` quotes each sentence with its
place. A measure with a margin, positive where the claim holds, is taken of four stretches of motion: the truth from the
start and in its steady state, and the paper's scheme from the start and in its last period. The verdict follows from
the four. The length and the step that a run needs follow from shorter and coarser runs.
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
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.measures.claim_measures import (
    CORNERS,
    EFFORT,
    LINE,
    MEASURES,
    ClaimMargin,
    Example,
)
from stiction.comparisons.measures.drift_growth import INCONCLUSIVE, ROUNDED
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
from stiction.scenes import Scene, Trajectory, load_scene, scene_to_toml, vary
from stiction.truths import NoMotion, StickThreshold, Tier, slider_bar_truth
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import NoSteadyState, stick_threshold

HOLDS, STEADY, PARTLY, FAILS = "holds", "holds in the steady state only", "partly", "does not hold"
CONTRADICTS, NOT_TESTABLE, UNDECIDED = "contradicts itself", "not testable", "not decided"
VERDICTS: Mapping[str, str] = {
    "holding": HOLDS,
    "steady": STEADY,
    "partly": PARTLY,
    "contradicting": CONTRADICTS,
    "failing": FAILS,
    "not_testable": NOT_TESTABLE,
    "undecided": UNDECIDED,
}
"""The verdicts by the names that the text has for the numbers of statements with them."""
NO_CHANGE = "none"
"""Entry of the columns of changes under a choice that changes nothing."""
NOT_KNOWN = "not known: the first choice has no result"
"""Entry of them where there is nothing to compare with."""


class Part(StrEnum):
    """A stretch of motion on which a claim is measured: of the truth, and of a run of the paper's scheme."""

    TRUTH_FROM_START = "truth_from_start"
    TRUTH_STEADY = "truth_steady"
    RUN_FROM_START = "run_from_start"
    RUN_LAST_PERIOD = "run_last_period"

    @property
    def is_steady(self) -> bool:
        """True for a stretch of the steady state."""
        return self in (Part.TRUTH_STEADY, Part.RUN_LAST_PERIOD)

    @property
    def margin(self) -> str:
        """Key of the column with the margin on it."""
        return f"margin_{self}"

    @property
    def label(self) -> str:
        """Words of it: ``truth, from the start``."""
        return {
            Part.TRUTH_FROM_START: "truth, from the start",
            Part.TRUTH_STEADY: "truth, steady",
            Part.RUN_FROM_START: "HLCP, from the start",
            Part.RUN_LAST_PERIOD: "HLCP, last period",
        }[self]


RUN, FROM_START = 80.0, 24.0
"""Seconds of a run of the scheme, whose last period is its steady state, and of the stretch from the start.

The latter is the length of the paper's figures. The slowest multiplier of the return maps is 0.5 in 8 s, and 0.5^9 is
below the width of a printed line.
"""
STEPS = (1e-2, 5e-3, 2.5e-3)
"""Steps of the runs of the scheme, s. The verdict is that of the last; at 1 ms all are the same."""

Simulate = Callable[[Scene, float, float], Trajectory]
"""(scene, t_end, step) to a run."""
View = Callable[[Scene], Stretch]


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper; the fields are those of ``data/paper_claims.toml``."""

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
        return f"Sect. 5, p. {self.page}"

    @property
    def number(self) -> int:
        """The case it is about, the first of several."""
        return int(self.case[0])

    def measured(self, views: Views, view: View) -> ClaimMargin:
        """The margin in one of the views; not a number where there is no such motion."""
        try:
            return MEASURES[self.measure](
                Example(views.cases, views.threshold, view), self.number, **self.arguments
            )
        except (NoSteadyState, NoMotion) as error:
            return ClaimMargin(float("nan"), why=str(error))


_QUOTED = tomllib.loads(
    (resources.files("stiction.comparisons") / "data" / "paper_claims.toml").read_text("utf-8")
)
CHOICES: Mapping[str, Mapping[str, Any]] = _QUOTED["choices"]
"""Values that the paper does not give, as overrides of `stiction.scenes.vary`; the first choice is ours."""


def claims() -> tuple[Claim, ...]:
    """The paper's sentences about its example, in their order; `drift_claims` has those about drift."""
    return tuple(Claim(**entry) for entry in _QUOTED["claim"])


def paper_run(scene: Scene, t_end: float, step: float) -> Trajectory:
    """The paper's scheme with its stabilization, samples as the steps or every 2 ms."""
    return ReferenceEngine().simulate(
        scene, t_end=t_end, dt=step, output_step=max(step, 2e-3), assemble=True
    )


class Views:
    """The stretches of the cases' motions that claims are measured on; each motion is made once."""

    def __init__(
        self, cases: Mapping[int, Scene], threshold: StickThreshold, simulate: Simulate = paper_run
    ):
        self.cases, self.threshold = cases, threshold
        self._simulate = simulate
        self._known: dict[tuple[str, object], Stretch] = {}

    def steady_truth(self, scene: Scene) -> Stretch:
        return self._once(scene, "steady", lambda: steady_stretch(scene))

    def truth(self, scene: Scene) -> Stretch:
        return self._once(
            scene, "truth", lambda: truth_stretch(scene, slider_bar_truth(scene, FROM_START))
        )

    def run(self, step: float, scene: Scene) -> Stretch:
        """All of a run of the scheme: as many periods as `RUN` has."""
        period = SliderBar.from_scene(scene).period()
        t_end = period * max(2, round(RUN / period))
        return self._once(
            scene, step, lambda: run_stretch(scene, self._simulate(scene, t_end, step), step)
        )

    def beginning(self, step: float, scene: Scene) -> Stretch:
        return self.run(step, scene).between(0.0, FROM_START)

    def period(self, step: float, age: float, scene: Scene) -> Stretch:
        """The whole period that ends about `age` seconds before the end of the run; the first where none is as old."""
        whole = self.run(step, scene)
        number = min(round(age / whole.period), round(whole.end / whole.period) - 1)
        end = whole.end - number * whole.period
        return whole.between(end - whole.period, end)

    def _once(self, scene: Scene, what: object, make: Callable[[], Stretch]) -> Stretch:
        key = scene_to_toml(scene), what
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]


def claims_comparison(
    cases: Mapping[int, Scene], threshold: StickThreshold
) -> Comparison[pd.DataFrame]:
    """`claims_table` in tasks: those of one case share motions. The claims of a failed task are one row."""
    first: dict[str, int] = {}
    for row, claim in enumerate(claims()):
        first.setdefault(claim.case, row)

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        parts = []
        for case, outcome in zip(first, outcomes, strict=True):
            failed = {
                "case": case,
                "place": "",
                "claim": f"[all about case {case}]",
                "verdict": UNDECIDED,
                "why": outcome.reason,
            }
            found = pd.DataFrame(failed, [first[case]]) if outcome.value is None else outcome.value
            parts.append(found.assign(status=outcome.status, reason=outcome.reason))
        return pd.concat(parts).sort_index().reset_index(drop=True)

    return Comparison(
        tuple(
            Task(f"claims/{case}", claims_table, (dict(cases), threshold, case)) for case in first
        ),
        tabulate,
    )


def claims_table(cases: Mapping[int, Scene], threshold: StickThreshold, about: str) -> pd.DataFrame:
    """One row per claim with `Claim.case` `about`: words and place, verdict, margins, run and step needed.

    The threshold is that of the first case. The index is the place of the claim among `claims`.
    """
    views = Views(cases, threshold)
    chosen = {place: claim for place, claim in enumerate(claims()) if claim.case == about}
    return pd.DataFrame(
        [
            {
                "case": claim.case,
                "place": claim.place,
                "claim": claim.words,
                **_examine(claim, views),
                "truth_tier": Tier.HIGH_PRECISION,
            }
            for claim in chosen.values()
        ],
        index=list(chosen),
    )


def drift_claims(study: pd.DataFrame, scene: str) -> list[dict[str, Any]]:
    """Rows as of `claims_table` for the two sentences about Fig. 14, from the table of the study of drift.

    The laws of growth of the longest runs decide. The margin is what is left of the interval of the exponent: above
    zero for drift that grows, and how far its spread is below that of a random walk for drift that does not. Drift that
    is no more than the rounding of a coordinate counts as bounded: the sentence is about the method.
    """
    return [
        _drift_row(decisive_runs(study, scene, PAPERS if entry["stabilized"] else NONE), **entry)
        for entry in _QUOTED["drift_claim"]
    ]


def _drift_row(
    found: Sequence[tuple[Mapping[Any, Any], Law]],
    words: str,
    stabilized: bool,
    allowed: Sequence[str],
    margin: str,
) -> dict[str, Any]:
    runs, laws = [run for run, _ in found], [law for _, law in found]
    held = [
        law in allowed for law, *_ in laws if law != INCONCLUSIVE
    ]  # a run that is too short decides nothing
    said = UNDECIDED if not held else HOLDS if all(held) else PARTLY if any(held) else FAILS
    row: dict[str, Any] = {
        "case": "-",
        "place": "Sect. 5, p. 445",
        "claim": words,
        "verdict": said,
        "margin_kind": margin,
        "truth_tier": "closed form",
        "study_runs": "; ".join(run["run"] for run in runs),
    }
    margins = [
        1 - spread if stabilized else exponent - half
        for law, exponent, half, spread, _ in laws
        if law not in (ROUNDED, INCONCLUSIVE)
    ]
    if margins:
        row[Part.RUN_FROM_START.margin] = min(margins)
    lengths = [
        length
        for length in LENGTHS
        if runs and all(run.get(f"growth_{length:g}s") in allowed for run in runs)
    ]
    if lengths:
        row |= {"run_needed": lengths[0], "step_needed": max(run["step"] for run in runs)}
    return row


def _examine(claim: Claim, views: Views) -> dict[str, Any]:
    if not claim.measure:
        return {"verdict": NOT_TESTABLE, "why": claim.why}
    found = findings(claim, views)
    said = verdict(claim, found)
    why = "; ".join(
        f"{part.label}: {finding.why}" for part, finding in found.items() if finding.why
    )
    return {
        "verdict": said,
        "why": claim.contradiction if said == CONTRADICTS else why,
        "margin_kind": _QUOTED["margin"][claim.measure].format(LINE=LINE, **claim.arguments)
        + claim.remark,
        **{part.margin: finding.margin for part, finding in found.items()},
        **(_needs(claim, views) if said in (HOLDS, STEADY, CONTRADICTS) else {}),
    }


def findings(claim: Claim, views: Views, truths_only: bool = False) -> dict[Part, ClaimMargin]:
    """Measure a claim on each stretch of motion; one about the beginning on those from the start."""
    where: dict[Part, View] = {
        Part.TRUTH_FROM_START: views.truth,
        Part.TRUTH_STEADY: views.steady_truth,
    }
    if not truths_only:
        where |= {
            Part.RUN_FROM_START: partial(views.beginning, STEPS[-1]),
            Part.RUN_LAST_PERIOD: partial(views.period, STEPS[-1], 0),
        }
    return {
        part: claim.measured(views, view)
        for part, view in where.items()
        if not (part.is_steady and claim.beginning)
    }


def verdict(claim: Claim, found: Mapping[Part, ClaimMargin]) -> str:
    """Return the verdict that follows from the findings on each stretch.

    A claim holds where it does on all of them; in the steady state only where it does on both stretches of that, and
    not on one from the start; partly where truth and run disagree, or where a part of it holds. A claim that holds and
    contradicts another contradicts itself.
    """
    holds = {part: finding.holds for part, finding in found.items()}
    if any(np.isnan(finding.margin) for finding in found.values()):
        return UNDECIDED
    if all(holds.values()):
        return CONTRADICTS if claim.contradiction else HOLDS
    steady = [held for part, held in holds.items() if part.is_steady]
    if steady and all(steady):
        return STEADY
    return (
        PARTLY if any(holds.values()) or any(finding.some for finding in found.values()) else FAILS
    )


def _needs(claim: Claim, views: Views) -> dict[str, Any]:
    """The shortest run from which on the claim holds in every period, and the largest step from which on it does."""

    def held(step: float, age: float) -> bool:
        view = (
            partial(views.beginning, step) if claim.beginning else partial(views.period, step, age)
        )
        return claim.measured(views, view).holds

    period, number = SliderBar.from_scene(views.cases[claim.number]).period(), 0
    while (
        not claim.beginning
        and (number + 2) * period <= RUN
        and held(STEPS[-1], (number + 1) * period)
    ):
        number += 1
    coarsest = STEPS[-1]
    for step in STEPS[-2::-1]:
        if not held(step, 0):
            break
        coarsest = step
    return {
        "run_needed": FROM_START if claim.beginning else RUN - number * period,
        "step_needed": coarsest,
    }


SAMPLING = 1e-5
"""Part of a number by which it must differ to be said to change.

Maxima are of 4000 samples a period. The fastest oscillation here is four periods of the bar in one of the load: they
miss its maximum by up to (2 pi 4/4000)^2/8 = 5e-6 of it.
"""
THRESHOLD = "threshold_on_F0"


@dataclass(frozen=True)
class Sensitivity:
    """The truth under one choice: numbers by column, verdicts by case and words, and why numbers are missing."""

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
        f"case {claim.case}: {claim.words}": verdict(
            claim, findings(claim, views, truths_only=True)
        )
        for claim in claims()
        if claim.measure
    }
    for case in varied:
        try:
            steady = views.steady_truth(varied[case])
        except (NoSteadyState, NoMotion) as error:
            reasons.append(f"case {case}: {error}")
            continue
        stuck = steady.stick_time * steady.period / (steady.end - steady.start)
        numbers |= {
            f"stick_time_case_{case}": stuck,
            f"largest_corner_force_case_{case}": steady.maximum(*CORNERS),
            f"largest_moment_case_{case}": steady.maximum(EFFORT),
        }
    return Sensitivity(numbers, verdicts, "; ".join(reasons))


def sensitivity_comparison(cases: Mapping[int, Scene]) -> Comparison[pd.DataFrame]:
    """One row per choice that the paper leaves open, with the truth's numbers that depend on it.

    Columns: ``choice``; ``reason`` why a number, or the whole row, is missing; ``claims that change``: verdicts on the
    truth that are not those under the first choice; ``numbers that change``: those that differ from the first choice
    by more than `SAMPLING`; `THRESHOLD` and the other numbers.
    """

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        ours: Sensitivity | None = outcomes[0].value
        return pd.DataFrame(
            [
                {
                    "choice": choice,
                    "status": outcome.status,
                    "reason": outcome.reason,
                    **({} if outcome.value is None else _changes(outcome.value, ours)),
                }
                for choice, outcome in zip(CHOICES, outcomes, strict=True)
            ]
        )

    return Comparison(
        tuple(
            Task(f"sensitivity/{choice}", sensitivity, (dict(cases), overrides))
            for choice, overrides in CHOICES.items()
        ),
        tabulate,
    )


def _changes(found: Sensitivity, ours: Sensitivity | None) -> dict[str, Any]:
    if ours is None:
        of_claims = of_numbers = NOT_KNOWN
    else:
        before = {words: ours.verdicts.get(words, UNDECIDED) for words in found.verdicts}
        of_claims = (
            "; ".join(
                f'"{textwrap.shorten(words, 90, placeholder=" ..")}" {said} (was: {before[words]})'
                for words, said in found.verdicts.items()
                if said != before[words]
            )
            or NO_CHANGE
        )
        changed = {
            name: (old, new)
            for name, old in ours.numbers.items()
            if abs((new := found.numbers.get(name, old)) - old) > SAMPLING * abs(old)
        }
        of_numbers = (
            "; ".join(
                f"{quantity_of(name).label} {100 * (new / old - 1):+.2g} %"
                if old
                else f"{quantity_of(name).label} {new:.3g} (was: 0)"
                for name, (old, new) in changed.items()
            )
            or NO_CHANGE
        )
    return {
        "reason": found.reason,
        "claims_that_change": of_claims,
        "numbers_that_change": of_numbers,
        **found.numbers,
    }


def general_claims() -> list[dict[str, Any]]:
    """Rows as of `claims_table` for sentences about all systems: one counter-example decides.

    The mechanism is of the paper's kind, with one driving constraint and one frictional translational joint. Its motion
    is given by kinematics; the forces are all solutions of the HLCP at t = 0 (`Trajectory.alternatives`).
    """
    rows = []
    for entry in _QUOTED["general_claim"]:
        scene = load_scene(entry["scene"])
        run = ReferenceEngine().simulate(scene, t_end=scene.t_end, dt=scene.t_end / 100)
        forces = run.alternatives.get(entry["effort"])
        known = run[entry["effort"]][:1] if forces is None else forces[0][~np.isnan(forces[0])]
        margin = 2.0 - len(known)
        why = f"{scene.name} at t = 0: {entry['effort']} of {' or '.join(f'{value:.5g}' for value in known)} N"
        rows.append(
            {
                "case": "-",
                "place": entry["place"],
                "claim": entry["words"],
                "verdict": HOLDS if margin > 0.0 else FAILS,
                "why": why,
                "margin_kind": entry["margin"],
                "truth_tier": "closed form",
                Part.RUN_FROM_START.margin: margin,
            }
        )
    return rows


def general_claims_comparison() -> Comparison[pd.DataFrame]:
    """`general_claims` in a task of its own; a row that says why where it failed."""

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        (outcome,) = outcomes
        failed = [
            {
                "case": "-",
                "place": "",
                "claim": "[about all systems]",
                "verdict": UNDECIDED,
                "why": outcome.reason,
            }
        ]
        found = pd.DataFrame(failed if outcome.value is None else outcome.value)
        return found.assign(status=outcome.status, reason=outcome.reason)

    return Comparison((Task("claims/general", general_claims, ()),), tabulate)


def plan(scope: Scope) -> Comparison[Tables]:
    """Statements about the motion, about drift on the runs of its study, and at full depth about open choices."""
    cases = dict(enumerate(scope.scenes, 1))
    parts: list[Comparison[Any]] = [
        claims_comparison(cases, scope.known[TRUTH][True].threshold),
        drift_study_comparison(cases, scope.depth),
        general_claims_comparison(),
    ]
    if extent(scope.depth).sensitivity:
        parts.append(sensitivity_comparison(cases))

    def tables(found: list[Any]) -> Tables:
        motion, drift, general, *open_choices = found
        about_drift = pd.DataFrame(drift_claims(drift.tables["study"], scope.scenes[0].name))
        every = pd.concat(
            [motion, about_drift.assign(status=Status.OK, reason=""), general], ignore_index=True
        )
        return Tables({"claims": every, **dict(zip(["sensitivity"], open_choices))})

    return side_by_side(parts, tables)


def present(results: Results) -> Presentation:
    """The number of statements with each verdict, and those that do not simply hold, in full."""
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
    """The numbers of choices: tried, with a result to compare, and with another verdict than the first."""
    column = choices.get("claims_that_change", pd.Series(dtype=object)).dropna()
    compared = column[column != NOT_KNOWN]
    return {
        "tried": len(choices),
        "compared": len(compared),
        "changing": int((compared != NO_CHANGE).sum()),
    }


def _claims_views(table: pd.DataFrame) -> list[TableView]:
    """The statements that do not simply hold, and all of them; the rarest verdicts first."""
    rarest = table.sort_values(
        "verdict", key=lambda verdicts: verdicts.map(verdicts.value_counts()), kind="stable"
    )
    parts = [part for part in Part if part.margin in table]
    rarest["margins"] = [
        "; ".join(
            f"{part.label}: {row[part.margin]:.2g}" for part in parts if pd.notna(row[part.margin])
        )
        for row in rarest.to_dict("records")
    ]
    brief = (
        Column("case"),
        Column("verdict"),
        Column("claim", "statement"),
        Column("why", "reason"),
    )
    every = (
        *brief,
        Column("place", "where"),
        Column("margins"),
        Column("run_needed", "run needed"),
        Column("step_needed", "step needed"),
    )
    return [
        view("claims-open", rarest[rarest["verdict"] != HOLDS], brief, source="claims"),
        view("claims", rarest, every, in_report=False),
    ]


STUDY = Study(
    "claims",
    "The paper",
    "Do the statements of the paper hold?",
    present,
    plan,
    THRESHOLD_STUDY.requires,
    seconds=1.9,
    compared=False,
    tables={
        "claims": "Statements of the paper, and whether they hold",
        "sensitivity": "Choices that the paper leaves open",
    },
)
