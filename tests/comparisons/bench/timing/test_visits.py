"""Protocol of timing: rounds over all runs, one computation timed once, doubts reported. Synthetic times, no clock."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from stiction.comparisons.bench.runner import Comparison, make
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.timing import visits
from stiction.comparisons.bench.timing.intervals import median_interval, ratio_interval
from stiction.comparisons.bench.timing.timed_runs import affordable, time_runs
from stiction.comparisons.bench.timing.visits import (
    BLOCK,
    LONG,
    REPEATS,
    SLOW,
    TRIES,
    Load,
    Timing,
    VisitTimes,
    bare_run,
    block,
    in_rounds,
    others,
    visit,
)
from stiction.comparisons.bench.variants import OWN_CPU, Variant
from stiction.comparisons.measures.work_precision import LEVEL, TIMING, work_precision
from stiction.comparisons.regression.older_code import STEPPING, TOTAL, _ratios
from stiction.comparisons.studies import suppression as stabilization_choices
from stiction.engines import load_engine
from stiction.engines.isolation import Job, Outcome, simulation
from stiction.scenes import Cost, load_scene, scene_from_dict

CASE = "slider-bar-case-1"
RUN = load_engine("reference").simulate(load_scene("pendulum"), rtol=1e-6, t_end=0.1)
ROUNDS = 8


def sample(own_s, kernel_s=1e-3):
    return VisitTimes(0.0, 2 * own_s, own_s, kernel_s, 1)


@pytest.mark.parametrize(
    "seconds, counted", [(1e-9, REPEATS), (BLOCK / 9.5, 10), (LONG, 1), (2 * LONG, 1)]
)
def test_a_visit_repeats_a_short_run_and_leaves_out_the_first(monkeypatch, seconds, counted):
    calls = []
    monkeypatch.setattr(
        visits, "seconds_of", lambda call: (calls.append(call()) or len(calls), seconds)
    )
    found = block(lambda: None)
    assert len(found) == counted and found[0][0] == (1 if seconds > LONG else 2)


def test_what_the_first_run_of_a_process_loads_is_no_time_of_the_run(monkeypatch):
    """The first call takes longer than `LONG` and its run is short: it is left out."""
    took = iter([5 * LONG] + [BLOCK / 9.5] * 20)
    monkeypatch.setattr(visits, "seconds_of", lambda call: (call(), next(took)))
    found = block(lambda: "run", lambda result, seconds: LONG / 10)
    assert [seconds for _, seconds in found] == [BLOCK / 9.5] * 10


def synthetic_visits(times):
    """A round of synthetic times, by key an iterator, and the keys that were visited, round by round."""
    seen = []

    def one_round(keys):
        seen.append(list(keys))
        return {key: next(times[key]) for key in keys}

    return one_round, seen


def noise(median, spread, seed):
    random = np.random.default_rng(seed)
    while True:
        yield median * np.exp(spread * random.normal())


def test_rounds_go_forwards_and_backwards_and_leave_out_what_is_lost():
    keys = ["a", "b", "lost"]
    one_round, seen = synthetic_visits({key: noise(1e-3, 1e-3, i) for i, key in enumerate(keys)})
    found = in_rounds(
        keys, lambda asked: {key: one for key, one in one_round(asked).items() if key != "lost"}, 3
    )
    assert {key: len(samples) for key, samples in found.items()} == {"a": 3, "b": 3, "lost": 0}
    assert seen == [keys, ["b", "a"], ["a", "b"]]


@pytest.mark.parametrize("ratio, told", [(1.0, False), (1.5, True)])
def test_a_drifting_machine_does_not_decide_who_is_faster(ratio, told):
    """On a machine that becomes 3 times slower, times in turns distinguish two runs if and only if they differ."""
    speed = iter(np.linspace(1.0, 3.0, 2 * ROUNDS))
    times = {"a": noise(1.0, 0.01, 1), "b": noise(ratio, 0.01, 2)}

    def one_round(keys):
        return {key: next(times[key]) * next(speed) for key in keys}

    found = in_rounds(["a", "b"], one_round, ROUNDS)
    within = ratio_interval(found["b"], found["a"])
    assert (within.low > 1 or within.high < 1) == told and within.low <= ratio <= within.high
    assert median_interval(found["a"]).high > median_interval(found["b"]).low


@pytest.mark.parametrize(
    "times, words",
    [
        ([1.0] * 5, ""),
        ([1.0], "timed once"),
        ([1.0] * 3, "3 rounds are too few for an interval"),
        ([0.8, 1.0, 1.0, 1.0, 1.5], "unsure: 0.80 to 1.50 of the median after 5 rounds"),
    ],
)
def test_what_makes_a_time_unsure_is_told(times, words):
    assert Timing(RUN, tuple(map(sample, times))).note == words


def test_load_by_others_is_what_the_machine_did_beside_us():
    assert others(Load(10.0, 100.0, 7.0), Load(12.0, 105.0, 9.0)) == pytest.approx(1.5)
    assert (
        others(Load(10.0, 100.0, 7.0), Load(12.0, 101.0, 9.0)) == 0.0
    )  # rounding of ticks is no load
    assert np.isnan(others(Load(10.0, 100.0, 7.0), Load(10.01, 100.1, 7.0)))


def outcomes_of(tasks, cpu_s=0.1):
    return [Outcome(task.label, "ok", sample(1.0 + i), cpu_s=cpu_s) for i, task in enumerate(tasks)]


def test_one_computation_is_timed_once_whatever_asks_for_it():
    scene, engine = load_scene(CASE), load_engine("reference")
    asked = {
        "as the scene": (scene, {}),
        "the same, said": (scene, {"stabilization": "baumgarte"}),
        "finer output": (scene, {"output_step": 0.01}),
        "other": (scene, {"stabilization": "projection"}),
        "longer": (scene, {"t_end": 0.2}),
        "tighter": (scene, {"rtol": 1e-8}),
    }
    simulations = []
    for label, (given, more) in asked.items():
        arguments = {"rtol": 1e-6, "t_end": 0.1, "output_step": 0.05, **more}
        simulations.append(
            (
                simulation(Job(label, "reference", given, arguments)),
                Outcome(label, "ok", engine.simulate(given, **arguments)),
            )
        )
    simulations.append(
        (simulation(Job("lost", "reference", scene, {"rtol": 1e-6})), Outcome("lost", "failed"))
    )
    visited = []

    def isolated(tasks, *, workers, timeout_s, on_result):
        visited.append([task.label for task in tasks])
        assert workers == 1
        return outcomes_of(tasks)

    found = time_runs(
        affordable(simulations, [""] * len(simulations), 5, math.inf), 5, isolated, 9.0
    )
    assert visited[0] == ["as the scene", "other", "longer", "tighter"] and len(found) == 4
    assert visited[1] == 2 * (visited[0][::-1] + visited[0]) and len(visited) == 2


PENDULUM = simulation(Job("run", "reference", load_scene("pendulum"), {"rtol": 1e-6, "t_end": 0.1}))


@pytest.mark.parametrize("lost, samples", [(0, 0), (1, 4)])
def test_a_run_that_is_lost_while_it_is_timed_says_so(lost, samples):
    """In the first round: it is not made again."""
    calls = []

    def isolated(tasks, **_):
        calls.append(tasks)
        made = outcomes_of(tasks)
        if len(calls) == lost + 1:
            made[-1] = Outcome("run", "timed out", reason="no result within 9 s")
        return made

    [timing] = time_runs([(PENDULUM, Outcome("run", "ok", RUN), True)], 5, isolated, 9.0).values()
    assert len(timing.samples) == samples and sum(map(len, calls)) == (5 if lost else 1)
    assert timing.note.startswith("while it was timed: timed out: no result within 9 s")


@pytest.mark.parametrize("later, repeats, left", [([2.0, 1.0], 2, 0), ([2.0] * TRIES, TRIES, 1)])
def test_visits_on_a_disturbed_machine_are_repeated_in_their_rounds(later, repeats, left):
    """The kernel tells, and the time does not: the third visit is disturbed, and so are repeats of it."""
    kernels, asked = iter([1.0, 1.01, SLOW * 1.02, 1.0, 1.0, *later]), []

    def isolated(tasks, **_):
        asked.append(len(tasks))
        return [Outcome(task.label, "ok", sample(1.0, next(kernels)), cpu_s=0.1) for task in tasks]

    [timing] = time_runs([(PENDULUM, Outcome("run", "ok", RUN), True)], 5, isolated, 9.0).values()
    assert asked == [1, 4, *[1] * repeats] and len(timing.samples) == 5
    assert [one.kernel_s > SLOW for one in timing.samples] == [
        False,
        False,
        bool(left),
        False,
        False,
    ]


def test_what_is_timed_is_the_motion_without_its_table(compiled):
    scene, engine = load_scene(CASE), load_engine("reference")
    arguments = {
        "rtol": 1e-9,
        "t_end": 2.0,
        "output_step": 0.001,
        "fidelity": "joint",
        "stabilization": "projection",
    }
    bare, whole = bare_run(engine, scene, arguments)(), engine.simulate(scene, **arguments)
    assert len(bare.t) == 2 and bare.t[-1] == 2.0 and len(whole.t) == 2001
    assert (
        bare["slider.x"][-1] == whole["slider.x"][-1]
        and bare.settings["stabilization"]["method"] == "projection"
    )
    assert len(bare_run(engine, scene, {"rtol": 1e-9})().t) == 2


def test_one_time_in_all_tables(in_this_process, monkeypatch):
    """Cost and drift suppression share a run, which is timed once. Untimed and failed runs have no time."""
    monkeypatch.setattr(visits, "SLOW", math.inf)  # no visit is repeated, whatever the machine does
    scene = load_scene(CASE)
    shared = Variant("mine", "reference", "rtol", (1e-6,), settings={"stabilization": "projection"})
    broken = Variant("broken", "reference", "rtol", (1e-6,), settings={"nonsense": 1})
    bare = [
        simulation(
            Job(
                name,
                "reference",
                scene,
                {"rtol": rtol, "t_end": 0.5, "stabilization": "projection"},
            )
        )
        for name, rtol in (("same", 1e-6), ("not timed", 1e-7))
    ]
    counted = []
    cost, suppression, untimed = make(
        [
            work_precision(scene, [shared, broken], t_end=0.5, repeats=2),
            stabilization_choices.plan(Scope((scene,), t_end=0.5, repeats=1)),
            Comparison(tuple(bare), lambda outcomes: [outcome.value.cost for outcome in outcomes]),
        ],
        on_result=counted.append,
    )
    rows = cost.table.set_index("variant")
    other = (
        suppression.tables["suppression"]
        .set_index(["variant", "step"])
        .loc[("reference, projection", 1e-6)]
    )
    columns = ["cpu_time", OWN_CPU, "setup_time"]
    times = [untimed[0].stepping_s, untimed[0].own_s, untimed[0].setup_s]
    assert list(rows.loc["mine", columns]) == list(other[columns]) == times
    assert np.isnan(untimed[1].stepping_s) and np.isnan(untimed[1].own_s)
    assert rows.at["mine", "repeats"] == 2 and rows.at["mine", LEVEL] == 0.5
    assert "2 rounds are too few" in rows.at["mine", TIMING]
    assert rows.at["broken", "status"] == "failed" and np.isnan(rows.at["broken", "cpu_time"])
    assert list(cost.samples["key"].unique()) == [rows.at["mine", "key"]] and list(
        cost.samples["round"]
    ) == [1, 2]
    distinct = len(suppression.tables["suppression"])
    assert len(counted) == 2 + distinct + 2 + 2 * distinct


def run_of(seconds, label="run"):
    return Outcome(label, "ok", replace(RUN, cost=Cost(0.0, 0.0, seconds, {}, seconds)), cpu_s=9.0)


def test_runs_beyond_the_budget_of_their_series_are_timed_once():
    """Of each series two runs at least are in all rounds; every run has a time, so that no method is short of one by our budget."""
    scene, rtols = load_scene("pendulum"), (1e-4, 1e-5, 1e-6, 1e-7)
    tasks = [
        simulation(Job(f"{ladder} {rtol:g}", "reference", scene, {"rtol": rtol, "t_end": t_end}))
        for ladder, t_end in (("cheap", 0.1), ("dear", 0.2))
        for rtol in rtols
    ]
    seconds = [0.1, 0.2, 0.3, 0.4, 30.0, 60.0, 120.0, 240.0]
    timed_labels = []

    def isolated(asked, *, workers, timeout_s, on_result):
        if asked[0].function is not visit:
            return [run_of(cost, task.label) for task, cost in zip(asked, seconds, strict=True)]
        timed_labels.extend(task.label for task in asked)
        return outcomes_of(asked)

    comparison = Comparison(
        tuple(tasks),
        lambda outcomes: [outcome.value for outcome in outcomes],
        rounds=3,
        ladders=tuple(task.label.partition(" ")[0] for task in tasks),
        budget_s=2.1,
    )
    [timings] = make([comparison], isolated=isolated)
    assert len(timed_labels) == 3 * 5 + 3 and timed_labels[-3:] == [
        tasks[i].label for i in (3, 6, 7)
    ]
    assert [len(timing.samples) for timing in timings] == [3, 3, 3, 1, 3, 3, 1, 1]
    assert (
        timings[3].note == "timed once"
        and timings[3].trajectory.cost.own_s == 1.0
        and timings[3].trajectory.t is RUN.t
    )


def test_what_two_comparisons_ask_for_alike_is_run_once():
    """Each has its label, and CPU time counts once; another output, or another name of the scene, is another run."""
    scene = load_scene("pendulum")
    asked = {
        "one": (scene, {"rtol": 1e-6}),
        "the same": (load_scene("pendulum"), {"rtol": 1e-6}),
        "finer output": (scene, {"rtol": 1e-6, "output_step": 0.1}),
        "renamed": (scene_from_dict(tomllib.loads(scene.to_toml()), "swing"), {"rtol": 1e-6}),
    }
    parts = [
        Comparison(
            (simulation(Job(label, "reference", given, arguments)),),
            lambda outcomes: outcomes[0].label,
        )
        for label, (given, arguments) in asked.items()
    ]
    made, told = [], []

    def isolated(tasks, *, workers, timeout_s, on_result):
        made.extend(task.label for task in tasks)
        found = [run_of(0.1, task.label) for task in tasks]
        for outcome in found:
            on_result(outcome)
        return found

    assert make(parts, isolated=isolated, on_result=told.append) == list(asked)
    assert made == ["one", "finer output", "renamed"]
    assert [(outcome.label, outcome.cpu_s) for outcome in told] == [
        ("one", 9.0),
        ("the same", 0.0),
        ("finer output", 9.0),
        ("renamed", 9.0),
    ]


class Code:
    """A code whose runs take these seconds, one after another, of which its steps take a tenth; or fail with a word."""

    def __init__(self, *answers, stepping=0.1):
        self.answers, self.stepping, self.asked = iter(answers), stepping, 0

    def timed(self, number):
        self.asked += 1
        answer = next(self.answers)
        if isinstance(answer, str):
            return answer
        return {TOTAL: answer} | ({STEPPING: self.stepping * answer} if self.stepping else {})


def test_now_over_before_is_of_the_shortest_times_in_turns():
    # the first may have to compile
    before, now = (
        Code(9.0, *[1.0, 2.0, 1.5, 1.0, 3.0]),
        Code(9.0, *[2.5, 2.2, 2.0, 4.0, 2.0], stepping=0.2),
    )
    assert (
        _ratios({"before": before, "now": now}, 0) == {TOTAL: 2.0, STEPPING: 4.0}
        and before.asked == now.asked == 6
    )


def test_a_code_that_fails_has_no_ratio_and_says_why():
    assert (
        _ratios({"before": Code("InputError: unknown key"), "now": Code(1.0)}, 0)
        == "before: InputError: unknown key"
    )
    later = Code(1.0, 1.0, "no result within 9 s")
    assert (
        _ratios({"before": Code(*[1.0] * 9), "now": later}, 0) == "now: no result within 9 s"
        and later.asked == 3
    )
