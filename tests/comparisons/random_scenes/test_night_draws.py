"""Random scenes of a night: in its history and its budget, judged without a baseline; the commands of such studies."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from conftest import invoke

from stiction.cli.exit_codes import COULD_NOT_RUN as COULD_NOT_RUN_CODE
from stiction.cli.exit_codes import NOT_COMPARED, REGRESSED
from stiction.comparisons.bench.environment import origin
from stiction.comparisons.bench.planned_runs import NOT_RUN, RANDOM, row_of
from stiction.comparisons.measures.accuracy import WRONG
from stiction.comparisons.random_scenes import __main__ as random_scenes
from stiction.comparisons.random_scenes import random_slider_bars, resting_mechanisms
from stiction.comparisons.random_scenes.night_draws import (
    BATCH,
    STUDIES,
    Draw,
    draws_of_night,
    sentences_on_draws,
)
from stiction.comparisons.random_scenes.random_study import RandomScenes, SceneOutcome
from stiction.comparisons.regression.baseline import FORMAT, Baseline, updated
from stiction.comparisons.regression.check import COULD_NOT_RUN, REGRESSION, findings
from stiction.comparisons.regression.history import open_history
from stiction.comparisons.regression.nightly import HISTORY
from stiction.engines import Outcome
from stiction.truths import one_freedom

DRAW = Draw("slider-bars", 7, 0, 2)
CAMPAIGN = """
scenes = ["block-on-incline"]
measure = ["counter"]
random = 2
random_mechanisms = 1
[variants.reference]
engine = "reference"
rtol = [1e-9]
"""


@pytest.fixture
def night(tmp_path, monkeypatch, in_this_process):
    """`stiction nightly` with two slider-bars and a mechanism that comes to rest."""
    monkeypatch.chdir(tmp_path)
    Path("campaign.toml").write_text(CAMPAIGN)
    Path("empty.toml").write_text(f"format = {FORMAT}\n")
    return partial(invoke, "nightly", "campaign.toml", "--baseline", "empty.toml", "--out", "out")


def rows():
    with open_history(Path("out") / HISTORY, write=False) as history:
        name = history.last_finished()
        return name, [row for row in history.rows(name) if row.variant == RANDOM]


def test_draws_are_in_the_history_with_their_seed(night):
    night(exit_code=NOT_COMPARED)  # what is drawn is right by itself, and no run was compared
    name, drawn = rows()
    report = next(Path("out").glob("*/report.md")).read_text()
    for row, draw, looks in zip(
        drawn, draws_of_night(name, {"slider-bars": 2, "mechanisms": 1}), (1, 3), strict=True
    ):
        study = STUDIES[draw.what]
        assert (
            row.status == "ok"
            and row.settings["seed"] == draw.seed
            and row.settings["count"] == draw.count
        )
        assert sum(metric.value for metric in row.metrics) == looks * draw.count * len(study.rtols)
        assert {metric.kind for metric in row.metrics} == {RANDOM}
        assert f"Seed {draw.seed}, {draw.count} {draw.what} of at most {study.t_end:g} s" in report
        # the night's seed decides which
        found = {metric.name: int(metric.value) for metric in row.metrics if metric.value}
        assert found.keys() <= study.outcomes.keys() - set(study.failing)
        assert all(f"{count} {outcome}" in report for outcome, count in found.items())


@pytest.mark.parametrize("module", [random_slider_bars, resting_mechanisms])
def test_what_is_silently_wrong_is_a_regression_with_the_command_that_repeats_it(
    night, monkeypatch, module
):
    # the motion that decides where a run disagrees takes ten seconds
    monkeypatch.setattr(
        resting_mechanisms, "simulate", lambda scene, t_end, *_: one_freedom.simulate(scene, t_end)
    )

    def wrong(*_):
        found = SceneOutcome(
            module.STUDY.failing[0], "event 3: truth stick, run slip", "this scene"
        )
        return found if module is resting_mechanisms else (found,)

    monkeypatch.setattr(module, "judge", wrong)
    ended = night(exit_code=REGRESSED)
    what = {random_slider_bars: "slider-bars", resting_mechanisms: "mechanisms"}[module]
    [row] = [row for row in rows()[1] if row.settings["what"] == what]
    assert row.status == WRONG and "event 3: truth stick, run slip; this scene" in ended.output
    assert (
        f"python -m stiction.comparisons.random_scenes {what} {row.settings['seed']} 0"
        in row.reason
    )


def test_the_budget_holds_for_the_draws_too(night):
    Path("campaign.toml").write_text(CAMPAIGN + "[budget]\ntotal = 1e-6\n")
    night(exit_code=COULD_NOT_RUN_CODE)
    report = next(Path("out").glob("*/report.md")).read_text()
    assert {row.status for row in rows()[1]} == {NOT_RUN}
    assert "2 slider-bars without a result" in report and "1 mechanisms without a result" in report


def test_seed_is_the_nights_own_and_batches_are_of_one_stream():
    batch = BATCH["slider-bars"]
    counts = {"slider-bars": 2 * batch + 3, "mechanisms": BATCH["mechanisms"] + 1}
    first, again, other = (
        draws_of_night(name, counts) for name in ("2026-01-01", "2026-01-01", "2026-01-02")
    )
    assert (
        first == again
        and len({draw.seed for draw in first}) == 1
        and first[0].seed != other[0].seed
    )
    assert [(draw.first, draw.count) for draw in first] == [
        (0, batch),
        (batch, batch),
        (2 * batch, 3),
        (0, BATCH["mechanisms"]),
        (BATCH["mechanisms"], 1),
    ]
    assert len({draw.key for draw in first}) == len(first)
    assert draws_of_night("2026-01-01", dict.fromkeys(counts, 0)) == []


@pytest.mark.parametrize(
    ("outcome", "severity"),
    [
        (Outcome("", "timed out", reason="no result within 1 s"), COULD_NOT_RUN),
        (Outcome("", "failed", reason="ValueError: x"), COULD_NOT_RUN),
        (
            Outcome("", "ok", replace(DRAW.row, status=WRONG, reason="silently wrong: ..")),
            REGRESSION,
        ),
        (Outcome("", "ok", replace(DRAW.row, status="ok")), None),
    ],
)
def test_findings_need_no_baseline(outcome, severity):
    row = row_of(DRAW, outcome)
    found = findings([row], Baseline(format=FORMAT), (), {}, "")
    assert [finding.severity for finding in found] == ([] if severity is None else [severity])
    assert all("seed 7" in finding.reason for finding in found)
    assert "Seed 7, 2 slider-bars" in sentences_on_draws([row]) and sentences_on_draws([]) == ""
    assert (
        updated(Baseline(format=FORMAT), [row], "why", origin(), {row.key}).runs == {}
    )  # nor does one hold a draw


def by_parity(seed, i, rtols):
    return [
        SceneOutcome("odd", f"{seed + i} is odd", f"scene {i}")
        if (seed + i) % 2
        else SceneOutcome("even")
        for _ in rtols
    ]


def test_the_command_counts_and_prints_what_is_not_best(capsys, monkeypatch):
    study = RandomScenes(
        by_parity,
        {"even": "good", "odd": "bad", "neither": "impossible"},
        ("odd",),
        (1e-6, 1e-9),
        2.0,
    )
    monkeypatch.setattr(random_scenes, "STUDIES", {"parity": study})
    assert random_scenes.main(["parity", "3", "1", "6"]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said == [
        line for i in (2, 4, 6) for line in [f"{i}: odd: {3 + i} is odd; scene {i}"] * 2
    ] + ["6 even: good", "6 odd: bad", "0 neither: impossible"]
    assert random_scenes.main(["parity", "4", "0"]) == 0


@pytest.mark.parametrize("what", STUDIES)
def test_studies_of_the_suite(what, capsys, compiled, monkeypatch):
    monkeypatch.setattr(random_scenes, "STUDIES", {what: replace(STUDIES[what], rtols=(1e-9,))})
    assert random_scenes.main([what, "0", "0"]) == 0
    best = next(iter(STUDIES[what].outcomes))
    assert re.search(f"^[13] {best}: ", capsys.readouterr().out, re.MULTILINE)
