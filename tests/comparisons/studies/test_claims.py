"""Every verdict on a sentence of the paper can fail: a fault in the scheme, or in the truth, turns it."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from report_material import study_tables

from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.measures.claim_measures import (
    MEASURES,
    ClaimMargin,
    Example,
    above,
    all_of,
    as_said,
    below,
)
from stiction.comparisons.measures.steady_stretch import run_stretch, steady_stretch, truth_stretch
from stiction.comparisons.studies import claims as paper_claims
from stiction.comparisons.studies.claims import (
    CHOICES,
    CONTRADICTS,
    FAILS,
    HOLDS,
    PARTLY,
    STEADY,
    STUDY,
    UNDECIDED,
    VERDICTS,
    Claim,
    Part,
    Sensitivity,
    Views,
    claims,
    drift_claims,
    general_claims,
    margins_of,
    paper_run,
    sensitivity,
    sensitivity_comparison,
    verdict_of,
)
from stiction.engines import load_engine
from stiction.engines.isolation import Outcome
from stiction.reports.text import section_of
from stiction.scenes import load_scene, vary
from stiction.truths import StickThreshold, slider_bar_truth
from stiction.truths.reduced.steady_state import NoSteadyState

CASES = {case: load_scene(f"slider-bar-case-{case}") for case in (1, 2, 3)}
THRESHOLD = StickThreshold(4.2119563, 1e-9, (4.2, 4.3))
CLAIMS = {claim.words: claim for claim in claims()}


def claim(words: str) -> Claim:
    [found] = [claim for text, claim in CLAIMS.items() if words in text]
    return found


@cache
def once(name, t_end, step):
    return paper_run(load_scene(name), t_end, step)


@cache
def steady_of_case_1():
    return steady_stretch(CASES[1])


WHOLE = Views(CASES, THRESHOLD, lambda scene, t_end, step: once(scene.name, t_end, step))


class Damaged(Views):
    """Views of runs of the scheme that have a fault, and of the truth, which has none."""

    truth, steady_truth = WHOLE.truth, WHOLE.steady_truth

    def __init__(self, fault):
        super().__init__(
            CASES, THRESHOLD, lambda scene, t_end, step: fault(once(scene.name, t_end, step))
        )


def column(name, change):
    """A fault in a column, in samples and on both sides of events."""

    def fault(run):
        events = tuple(
            replace(
                event,
                before={**event.before, name: change(event.before[name], event.time)},
                after={**event.after, name: change(event.after[name], event.time)},
            )
            for event in run.events
        )
        return replace(
            run, columns={**run.columns, name: change(run.columns[name], run.t)}, events=events
        )

    return fault


def without(kind):
    return lambda run: replace(
        run, events=tuple(event for event in run.events if event.kind != kind)
    )


def one_sided(run):
    """As the rows of an event were before they had the event's own values: of neighbouring samples, here the one before."""
    return replace(run, events=tuple(replace(event, after=event.before) for event in run.events))


FAULTS = {
    "wrong sign of friction": (
        "due to the variation of the value of friction",
        HOLDS,
        column("guide.friction", lambda f, t: -f),
    ),
    "a corner never touches": (
        "initially, corners 2 and 4",
        CONTRADICTS,
        column("guide.F4", lambda f, t: 0 * f),
    ),
    "corners exchanged": (
        "initially, corners 2 and 4",
        CONTRADICTS,
        lambda run: replace(
            run,
            columns={
                **run.columns,
                "guide.F1": run.columns["guide.F2"],
                "guide.F2": run.columns["guide.F1"],
            },
        ),
    ),
    "no events of stick": (
        "stick phase takes place",
        HOLDS,
        lambda run: replace(
            without("stick")(run),
            columns={**run.columns, "guide.mode": np.ones_like(run.columns["guide.mode"])},
        ),
    ),
    "creeps in stick": (
        "stick phase takes place",
        HOLDS,
        column("slider.vx", lambda v, t: v + 1e-6),
    ),
    "events with the values of one side": (
        "a small abrupt change of the magnitude of driving moment",
        HOLDS,
        one_sided,
    ),
    "never settles": (
        "It is found that the motion of the slider is periodic",
        STEADY,
        column("slider.x", lambda x, t: x + 0.01 * t),
    ),
    "one corner alone": (
        "Two adjacent slider corners",
        HOLDS,
        column("guide.F2", lambda f, t: 0 * f),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_the_scheme_turns_the_verdict(fault):
    words, said, damage = FAULTS[fault]
    whole, damaged = (margins_of(claim(words), views) for views in (WHOLE, Damaged(damage)))
    assert verdict_of(claim(words), whole) == said != verdict_of(claim(words), damaged)


def test_verdicts_follow_from_what_was_found():
    about = Claim("1", "442", "words")

    def said(*margins, claim=about, some=False):
        return verdict_of(
            claim, {part: ClaimMargin(margin, some) for part, margin in zip(Part, margins)}
        )

    assert (
        said(1, 1, 1, 1) == HOLDS and said(-1, 1, -1, 1) == STEADY and said(-1, -1, -1, -1) == FAILS
    )
    assert (
        said(1, 1, 1, -1) == said(1, 1, -1, -1) == said(-1, -1, 1, 1) == said(1, -1, 1, 1) == PARTLY
    )  # truth and run do not agree
    assert (
        said(-1, -1, -1, -1, some=True) == PARTLY
        and said(1, 1, float("nan"), 1) == UNDECIDED
        and said(0, 0, 0, 0) == FAILS
    )
    assert said(1, 1, 1, 1, claim=replace(about, contradiction="another sentence")) == CONTRADICTS


def test_drift_that_grows_turns_the_verdict():
    study = study_tables()["study"].assign(scene="slider-bar-case-1")
    without_, with_ = (row["verdict"] for row in drift_claims(study, "slider-bar-case-1"))
    assert (without_, with_) == (HOLDS, HOLDS)
    growing = study.assign(**{"growth_240s": "grows"})
    assert [row["verdict"] for row in drift_claims(growing, "slider-bar-case-1")] == [HOLDS, FAILS]
    still = study.assign(**{"growth_240s": "bounded"})
    assert [row["verdict"] for row in drift_claims(still, "slider-bar-case-1")] == [FAILS, HOLDS]
    rounded = study.assign(
        **{"growth_240s": "rounding"}
    )  # the method adds nothing, which is no growth; nor is it a bound that is exceeded
    assert [row["verdict"] for row in drift_claims(rounded, "slider-bar-case-1")] == [FAILS, HOLDS]
    short = study.assign(**{"growth_240s": "inconclusive"})
    assert [row["verdict"] for row in drift_claims(short, "slider-bar-case-1")] == [
        UNDECIDED,
        UNDECIDED,
    ]
    assert [row["verdict"] for row in drift_claims(pd.DataFrame(), "slider-bar-case-1")] == [
        UNDECIDED,
        UNDECIDED,
    ]


def test_stretches_of_truth_and_run_measure_the_same():
    """Stick phases of case 1: from the start, [0, 0.304719758], then from 7.600035087 to 8.217361345 s."""
    scene = CASES[1]
    truth = truth_stretch(scene, slider_bar_truth(scene, 24.0)).between(0.0, 10.0)
    assert np.ravel(truth.phases) == pytest.approx(
        [0, 0.304719758, 7.600035087, 8.217361345], abs=1e-8
    )
    run = run_stretch(scene, paper_run(scene, 10.0, 1e-3), 1e-3)
    assert np.ravel(run.phases) == pytest.approx(
        np.ravel(truth.phases), abs=3e-3
    )  # late by up to a step at each end, and what the start's lateness leads to
    assert [name for name, _ in run.configurations] == [name for name, _ in truth.configurations]
    steady = steady_of_case_1()
    assert (
        steady.stick_time == pytest.approx(0.5323, abs=5e-5)
        and steady.change() < 1e-10
        and truth.change() > 0.1
    )
    assert steady.resolution("slider.ax") == 0 < run.resolution("slider.ax") < 0.01


def test_a_period_of_a_scene_whose_period_is_another():
    """Asked how long a run must be, claims about exchanged parameters look at scenes with other periods than the case they are about."""
    slow = vary(CASES[3], {"w0": CASES[1].parameters["w0"]})
    views = Views(CASES, THRESHOLD, lambda scene, t_end, step: paper_run(scene, t_end, 1e-2))
    last, first = (views.period(1e-2, age, slow) for age in (0.0, 1000.0))
    assert (last.end - last.start, first.start, first.end) == (
        pytest.approx(8.0),
        0.0,
        pytest.approx(8.0),
    ) and len(first.t) > 100


def test_claims_are_quoted_with_their_place_and_not_twice():
    assert len(CLAIMS) == len(claims())
    for found in CLAIMS.values():
        assert found.place.startswith("Sect. 5, p. 44") and bool(found.measure) != bool(found.why)
    assert {found.measure for found in CLAIMS.values() if found.measure} == set(
        MEASURES
    )  # each is said of something


def test_predicates_give_the_margin():
    assert below(0.1, 0.25).margin == 0.15 and not below(0.25, 0.25).holds
    assert (above([3, 5], 2).margin, above([1, 5], 2).holds, above([1, 5], 2).some) == (
        1,
        False,
        True,
    )
    assert all_of([True] * 4).margin == 1 / 8 and all_of([True] * 3 + [False]) == ClaimMargin(
        -1 / 8, True
    )
    assert as_said(True, [3, 2]).margin == 2 and not as_said(False, [3, 2]).holds


def test_a_threshold_that_is_not_where_sticking_ends_is_no_threshold():
    def found(
        threshold,
        stretch_of=lambda scene: SimpleNamespace(
            stick_time=float(scene.parameters["F0"] < THRESHOLD.F0)
        ),
    ):
        return MEASURES["sticks_below_threshold"](Example(CASES, threshold, stretch_of), 1)

    right, wrong = found(THRESHOLD, steady_stretch), found(replace(THRESHOLD, F0=4.5))
    assert right == found(THRESHOLD)  # made up as it is
    assert right.margin == pytest.approx(0.01)  # the nearest amplitude is 1 % off
    assert (wrong.margin, wrong.some) == (-1.0, True)
    unknown = found(StickThreshold(None, None, (0, 0), "why not"))
    assert unknown == ClaimMargin(-1.0, why="no threshold: why not")


@pytest.mark.parametrize(
    "overrides, threshold, moment",
    [(CHOICES["g = 9.8"], -0.0008, -0.0010), (CHOICES["spring natural at x = 0"], 0.0, 0.0)],
)
def test_of_what_the_paper_leaves_open_only_gravity_decides(overrides, threshold, moment):
    """As the page on the equations says: relative changes of the threshold, which is between two loads, and of the largest moment of case 1."""
    changed = vary(CASES[1], overrides)
    below, above = (
        steady_stretch(vary(changed, {"F0": 4.2119562663 * (1 + threshold + off)})).stick_time
        for off in (-1e-4, 1e-4)
    )
    assert below > 0 == above
    assert steady_stretch(changed).maximum("motor.effort") / steady_of_case_1().maximum(
        "motor.effort"
    ) - 1 == pytest.approx(moment, abs=5e-5)


def row_of(threshold, stick, said, reason=""):
    numbers = {"threshold_on_F0": threshold, "stick_time_case_1": stick}
    known = {name: number for name, number in numbers.items() if number is not None}
    return Outcome("a choice", "ok", Sensitivity(known, {"case 1: words": said}, reason))


def test_what_depends_on_what_the_paper_leaves_open():
    """A verdict and a number that change are named; sampling and rounding are no change; a choice that failed has its reason."""
    outcomes = [
        row_of(4.0, 0.5, HOLDS),
        row_of(4.0 * (1 + 1e-6), 0.5, HOLDS),
        row_of(4.4, 0.0, FAILS),
        row_of(None, 0.5, HOLDS, "no stick phase down to 1 mN"),
        Outcome("a choice", "timed out", reason="no result within 240 s"),
        *[row_of(4.0, 0.5, HOLDS)] * (len(CHOICES) - 5),
    ]
    table = sensitivity_comparison(CASES).tabulate(outcomes)
    same, changed, without_, lost = (table.iloc[i] for i in (1, 2, 3, 4))
    assert list(table["choice"]) == list(CHOICES) and (
        same["claims_that_change"],
        same["numbers_that_change"],
    ) == ("none", "none")
    assert changed["claims_that_change"] == f'"case 1: words" {FAILS} (was: {HOLDS})'
    assert (
        changed["numbers_that_change"]
        == "threshold on F0 +10 %; stick time per period, case 1 -1e+02 %"
    )
    assert (
        without_["reason"] == "no stick phase down to 1 mN"
        and np.isnan(without_["threshold_on_F0"])
        and without_["numbers_that_change"] == "none"
    )
    assert (lost["status"], lost["reason"]) == ("timed out", "no result within 240 s") and pd.isna(
        lost["claims_that_change"]
    )
    first_lost = sensitivity_comparison(CASES).tabulate(
        [lost_ for lost_ in [outcomes[4], *outcomes[1:]]]
    )
    assert first_lost["claims_that_change"].iloc[1].startswith("not known")


def test_a_choice_without_a_steady_state_is_reported_by_case(monkeypatch):
    """Case 2 without a steady state: the other cases keep their numbers, and the row says why those of case 2 are missing."""

    def steady(scene):
        if scene.name == CASES[2].name:
            raise NoSteadyState("no steady state of up to 8 periods")
        return steady_of_case_1() if scene == CASES[1] else steady_stretch(scene)

    monkeypatch.setattr(paper_claims, "steady_stretch", steady)
    monkeypatch.setattr(
        paper_claims, "stick_threshold", lambda scene: StickThreshold(4.2119563, 1e-9, (4.2, 4.3))
    )
    monkeypatch.setattr(paper_claims, "claims", lambda: ())
    found = sensitivity(CASES, {})
    assert found.reason == "case 2: no steady state of up to 8 periods" and not any(
        "case_2" in name for name in found.numbers
    )
    assert found.numbers["stick_time_case_1"] == pytest.approx(0.5323, abs=5e-5)


def test_forces_of_a_driven_mechanism_are_not_always_computed_easily():
    """A strut at 80 degrees pulls a block back: P c + mu |W + P s| = m a, W = m g, has two roots.

    With the block pressed down, P = -(mu W - m a) / (c + mu s); with the block lifted off, P = (m a + mu W) / (c - mu s).
    """
    (row,) = general_claims()
    assert row["verdict"] == FAILS
    scene = load_scene("block-pulled-by-strut")
    c, s, mu, weight = np.cos(np.deg2rad(80)), np.sin(np.deg2rad(80)), 0.3, 10.0
    x, rate, length = scene.bodies["block"].position[0], -0.001, scene.drives["strut"].law.offset
    a = (rate**2 - (rate * length / x) ** 2) / x  # x^2 + h^2 = L^2, twice differentiated
    run = load_engine("reference").simulate(scene)
    efforts = run.alternatives["strut.effort"][0]
    np.testing.assert_allclose(
        np.sort(efforts),
        np.sort([-(mu * weight - a) / (c + mu * s), (a + mu * weight) / (c - mu * s)]),
        rtol=1e-9,
    )
    assert np.isnan(run["strut.effort"]).all() and np.isnan(run["guide.friction"]).all()


def presented(verdicts, sensitivity=None):
    table = pd.DataFrame(
        {
            "case": "1",
            "claim": [f"statement {number}" for number in range(len(verdicts))],
            "verdict": verdicts,
            "status": "ok",
            "reason": "",
        }
    )
    tables = {"claims": table} | ({} if sensitivity is None else {"sensitivity": sensitivity})
    results = Results((), {}, tables)
    return STUDY.presented(results), section_of(STUDY, results)


def test_statements_are_counted_by_verdict():
    """A few; as many as the paper has, with every verdict; and one alone."""
    said, section = presented([HOLDS] * 3 + [FAILS] + [STEADY] * 2)
    counts = {name: said.rows[name] for name in VERDICTS}
    assert said.rows["statements"] == sum(counts.values()) == 6
    assert (counts["holding"], counts["failing"], counts["steady"]) == (3, 1, 2)
    assert "3 hold" in section.answer and "1 does not hold" in section.answer
    shown, every = section.tables
    assert [row[1] for row in shown.cells()] == [FAILS, STEADY, STEADY]  # the rarest first
    assert len(every.frame) == 6 and not section.findings
    others = [verdict for verdict in VERDICTS.values() if verdict != HOLDS]
    said, section = presented([HOLDS] * (len(CLAIMS) + 3 - 2 * len(others)) + 2 * others)
    assert all(said.rows[name] == 2 for name, verdict in VERDICTS.items() if verdict != HOLDS)
    assert len(f"{STUDY.title}: {section.answer}") <= ANSWER_LENGTH
    _, section = presented([FAILS])
    assert section.answer == "Of 1 statement 1 does not hold."


def test_choices_that_change_a_verdict_are_counted():
    """One that failed, and all of them where the first failed, change none."""
    failed = Outcome("a choice", "timed out", reason="no result within 240 s")
    same, other = row_of(4.0, 0.5, HOLDS), row_of(4.4, 0.0, FAILS)
    outcomes = [same, other, failed, *[same] * (len(CHOICES) - 3)]
    said, section = presented([HOLDS], sensitivity_comparison(CASES).tabulate(outcomes))
    counts = {"tried": len(CHOICES), "compared": len(CHOICES) - 1, "changing": 1}
    assert said.rows["open_choices"] == counts and len(section.findings) == 1
    lost = sensitivity_comparison(CASES).tabulate([failed, *outcomes[1:]])
    said, section = presented([HOLDS], lost)
    assert said.rows["open_choices"] == {"tried": len(CHOICES), "compared": 0, "changing": 0}
    assert [view.name for view in section.tables if view.caption] == [
        "claims-open",
        "claims",
        "sensitivity",
    ]
