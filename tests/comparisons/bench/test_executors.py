"""Runs on a cluster: what is made there is what is made here, and a worker that dies loses nothing."""

import math
import multiprocessing
import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest
from child_tasks import hang
from conftest import called_here, invoke

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench import executors
from stiction.comparisons.bench.executors import open_isolate
from stiction.comparisons.bench.timing import visits
from stiction.comparisons.bench.timing.visits import visit
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.measures.work_precision import work_precision
from stiction.engines.isolation import Job, Task, isolate, simulation
from stiction.scenes import InputError, load_scene

LIMIT_S = 120.0


def kill_the_worker(after: str) -> None:
    """End the process that isolates this task; once only if there is a file to leave."""
    if after:
        try:
            os.close(os.open(after, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return
    os.kill(multiprocessing.parent_process().pid, signal.SIGKILL)


def interrupt(outcome):
    raise KeyboardInterrupt


def test_dask_on_this_machine_has_the_outcomes_of_processes():
    pytest.importorskip("distributed")
    tasks = [
        *(Task(f"{number}", abs, (-number,)) for number in range(3 * executors.BATCH)),
        Task("crashes", os.abort),
        Task("raises", int, ("a",)),
    ]
    with open_isolate("dask", 2) as isolated:
        found = isolated(tasks, timeout_s=LIMIT_S)
    expected = isolate(tasks, workers=2, timeout_s=LIMIT_S)
    assert [outcome.status for outcome in expected[-2:]] == ["crashed", "failed"]
    assert "invalid literal" in found[-1].log and found[-1].bug
    # a log has tracebacks, with a frame more where a task was passed on
    incidental = {"wall_s": 0.0, "cpu_s": None, "log": ""}
    assert [replace(outcome, **incidental) for outcome in found] == [
        replace(outcome, **incidental) for outcome in expected
    ]


def test_an_interrupt_ends_the_children_of_dask_on_this_machine():
    """Those at work too: a process waits for its children at its end."""
    pytest.importorskip("distributed")
    with pytest.raises(KeyboardInterrupt), open_isolate("dask", 2) as isolated:
        isolated(
            [Task("done", abs, (-1,))] * executors.BATCH + [Task("hangs", hang)] * 20,
            timeout_s=LIMIT_S,
            on_result=interrupt,
        )
    assert [
        child for child in multiprocessing.active_children() if child.name == "stiction-child"
    ] == []


def test_what_is_timed_stays_here(monkeypatch):
    monkeypatch.setattr(visits, "SLOW", math.inf)  # no visit is repeated, whatever the machine does
    asked = {"elsewhere": [], "here": []}

    def by(place):
        def isolated(tasks, **options):
            asked[place].extend(task.function for task in tasks)
            return called_here(tasks, **options)

        return isolated

    variants = [Variant("pymunk", "pymunk", "dt", (1e-2, 5e-3))]
    comparison = work_precision(load_scene("slider-bar-case-1"), variants, t_end=0.1, repeats=2)
    table = comparison.make(isolated=by("elsewhere"), timed_by=by("here")).table
    assert list(table["status"]) == ["ok", "ok"] and (table["engine_time"] > 0).all()
    assert len(asked["elsewhere"]) == 2 and visit not in asked["elsewhere"]
    assert asked["here"] == [visit] * 4


@pytest.fixture
def cluster():
    """Two workers, each a process; a task that ends one is given up with the second."""
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set(
            {"distributed.worker.daemon": False, "distributed.scheduler.allowed-failures": 1}
        ),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as found,
    ):
        yield f"dask:{found.scheduler_address}"


@pytest.mark.long
def test_a_killed_worker_loses_nothing(cluster, tmp_path):
    scene = load_scene("slider-bar-case-1")
    runs = [
        simulation(Job(f"{engine} {dt}", engine, scene, {"t_end": 0.2, "dt": dt}))
        for engine in ("pymunk", "exudyn")
        for dt in (5e-3, 2e-3, 1e-3)
    ]
    deadly = Task("deadly once", kill_the_worker, (str(tmp_path / "killed"),))
    tasks, reported = [*runs[:3], deadly, *runs[3:]], []
    with open_isolate(cluster) as isolated:
        found = isolated(tasks, timeout_s=LIMIT_S, on_result=reported.append)
    assert (tmp_path / "killed").exists() and len(reported) == len(found)
    assert [outcome.label for outcome in found] == [task.label for task in tasks]
    assert [outcome.reason for outcome in found if outcome.status != "ok"] == []
    with pytest.importorskip("distributed").Client(cluster.removeprefix("dask:")) as client:
        imported = client.run(lambda: {"numba", "pandas", "scipy"} & set(sys.modules)).values()
    assert list(imported) == [set(), set()]  # what runs need is imported in children alone
    del found[3]
    for here, there in zip(isolate(runs, timeout_s=LIMIT_S), found, strict=True):
        assert here.value.columns.keys() == there.value.columns.keys()
        assert all(
            np.array_equal(here.value[name], there.value[name], equal_nan=True)
            for name in here.value.columns
        )


@pytest.mark.long
def test_what_kills_every_worker_is_a_row_that_says_so(cluster):
    """With the tasks of its batch; what crashes or raises in a child of a worker concerns itself alone."""
    tasks = [
        Task("deadly", kill_the_worker, ("",)),
        *(Task(f"{i}", abs, (-i,)) for i in range(1, executors.BATCH)),
        Task("crashes", os.abort),
        Task("raises", int, ("a",)),
        Task("fine", abs, (-7,)),
    ]
    with open_isolate(cluster) as isolated:
        found = {outcome.label: outcome for outcome in isolated(tasks, timeout_s=LIMIT_S)}
    assert [found[task.label].status for task in tasks] == ["crashed"] * executors.BATCH + [
        "crashed",
        "failed",
        "ok",
    ]
    assert "workers died" in found["deadly"].reason and "SIGABRT" in found["crashes"].reason
    assert found["fine"].value == 7


@pytest.mark.long
def test_workers_that_cannot_isolate_or_have_other_code_are_refused(monkeypatch):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as found:
        name = f"dask:{found.scheduler_address}"
        with pytest.raises(InputError, match="may start no processes"), open_isolate(name):
            pass
        monkeypatch.setattr(executors, "source_digest", lambda: "other")
        with pytest.raises(InputError, match="other code"), open_isolate(name):
            pass


@pytest.mark.parametrize(
    "arguments",
    [["compare", "hard"], ["compare", "settings", "slider-bar-case-1"], ["validate"], ["nightly"]],
)
def test_an_unknown_executor_is_refused(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = invoke(*arguments, "--executor", "threads", exit_code=BAD_INPUT)
    assert "found 'threads'" in ended.output + ended.stderr


def test_a_night_that_measures_time_stays_here(tmp_path):
    out = tmp_path / "out"
    ended = invoke("nightly", "--executor", "dask", "--out", out, exit_code=BAD_INPUT)
    assert "measures time" in ended.output + ended.stderr and not out.exists()
