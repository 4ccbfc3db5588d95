"""What several test files need."""

import os
import pickle
import signal
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import islice

import pytest
from filelock import FileLock
from hypothesis import settings
from report_material import CASE, LOST, T_END, record, timed, validation_of

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.campaigns.participants import extent, variant
from stiction.comparisons.results import Results
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.measures import scene_truth
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.studies.drift_suppression import suppression_variants
from stiction.comparisons.studies.effects import toggles
from stiction.comparisons.studies.study import Study, studies
from stiction.comparisons.truth import StickThreshold, slider_bar_truth
from stiction.comparisons.variants import Record, Variant
from stiction.engines import Outcome, isolation
from stiction.engines.reference import moreau
from stiction.engines.reference.engine import ReferenceEngine, compile_kernels
from stiction.reports import write_report
from stiction.reports.presentations import presentations
from stiction.scenes import load_scene


def pytest_sessionstart(session):
    """Kernels are compiled once, before workers start that would each compile the same."""
    if session.config.getoption("numprocesses", default=None):
        compile_kernels()
        moreau.compile_kernels()


@pytest.fixture(scope="session")
def compiled():
    """Kernels compiled and cached, so that a child with a time limit only loads them."""
    compile_kernels()


@pytest.fixture(scope="session", autouse=True)
def figures_in_this_process():
    """The workers of the tests keep all cores busy; and text that has been set for one figure need not be set again for the next."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiction.reports.figures.style.SHARE", 10_000)
        yield


def called_here(tasks, *, on_result=None, **_):
    """`stiction.engines.isolate` without children and limits of time; what a task raises or prints goes where it goes there."""
    outcomes = []
    for task in tasks:
        with redirect_stdout(StringIO()) as printed, redirect_stderr(printed):
            answer = isolation._answer(pickle.dumps((task.function, task.args)))
        outcomes.append(Outcome(task.label, **isolation._read(answer), log=printed.getvalue()))
        if on_result is not None:
            on_result(outcomes[-1])
    return outcomes


@contextmanager
def here():
    """Tasks are called in this process instead of in children, each of which takes a second to start: for what is not about isolation."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("stiction.engines", "stiction.comparisons.campaigns.nightly", "stiction.comparisons.campaigns.comparison",
                       "stiction.comparisons.studies.executors"):
            patch.setattr(f"{module}.isolate", called_here)
        yield


@pytest.fixture
def in_this_process():
    with here():
        yield


@pytest.fixture
def fresh_truths(monkeypatch):
    """Truths are found anew each time, and none is kept for the tests to come: for what changes how they are found."""
    monkeypatch.setattr("stiction.comparisons.measures.scene_truth._found", scene_truth._found.__wrapped__)


@pytest.fixture
def interruptible():
    """Children take SIGINT as they do at a terminal, even where this process was started to ignore it: ``nohup``, ``make test &``."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a child inherits what is ignored, not a handler
    yield
    signal.signal(signal.SIGINT, before)


QUICK_STUDIES = ("accuracy", "torque", "drift", "cost", "threshold", "effects", "suppression", "hard", "paper")


def shorten_validation(monkeypatch: pytest.MonkeyPatch, variants: tuple[Variant, ...]) -> None:
    """`validate` with the variants it is given, a few studies, effects, hard cases and figures; for tests that are not about what it finds.

    Thresholds are those that `test_truth_slider_bar` computes, each in ten seconds.
    """
    known = {True: StickThreshold(4.2119563, 6e-8, (4.2, 4.3)), False: StickThreshold(3.894203, 3e-6, (3.8, 3.9))}
    chosen = tuple(study for study in studies() if study.name in QUICK_STUDIES)

    def with_one_figure(results: Results) -> dict[Study, Presentation]:
        return {study: replace(said, figures=said.figures[:1] if study.name == "paper" else ()) for study, said in presentations(results).items()}

    for name, value in {
            "stiction.comparisons.campaigns.validation.studies": lambda: chosen,
            "stiction.comparisons.campaigns.participants._with_ladders": lambda *_: variants,
            "stiction.comparisons.studies.stick_threshold.true_thresholds": lambda _: Comparison((), lambda _: known),
            "stiction.comparisons.studies.constraint_drift.long_runs": lambda *_: [],
            "stiction.comparisons.studies.drift_suppression.suppression_variants": lambda: suppression_variants()[:1],
            "stiction.comparisons.hard.table.hard_cases": lambda depth: hard_cases(depth)[:2],
            "stiction.comparisons.studies.effects.toggles": lambda scene: islice(toggles(scene), 2),
            "stiction.comparisons.campaigns.validation.extent": lambda depth: replace(extent(depth), limit=600.0),  # a busy machine may take longer than a user waits
            "stiction.reports.markdown.validation_report.presentations": with_one_figure}.items():
        monkeypatch.setattr(name, value)


@pytest.fixture
def short_validation(monkeypatch):
    return partial(shorten_validation, monkeypatch)


@pytest.fixture(scope="session")
def truths() -> dict:
    return {CASE: slider_bar_truth(load_scene(CASE), T_END)}


@pytest.fixture(scope="session")
def lost_records() -> list[Record]:
    return [record(Variant(f"engine {i}", f"engine{i}", "dt", (1e-2,), "contact"), 1e-2, status, reason)
            for i, (status, reason) in enumerate(LOST.items())]


@pytest.fixture(scope="session")
def validation(truths, lost_records) -> Results:
    scene, engine = load_scene(CASE), ReferenceEngine()
    tight = timed(engine.simulate(scene, t_end=T_END, rtol=1e-9, stabilization="projection"))
    paper = timed(engine.simulate(scene, t_end=T_END, dt=2.5e-3))
    # the paper's scheme stands in for an engine that came out: what matters here is that it has a name of its own
    other = Variant("other", "other", "dt", (2.5e-3,))
    return validation_of([record(variant("reference"), 1e-9, value=tight), record(variant("paper's scheme"), 2.5e-3, value=paper),
                          record(other, 2.5e-3, value=replace(paper, engine="other", events=())), *lost_records],
                         truths)


@pytest.fixture(scope="session")
def report_folder(validation, tmp_path_factory):
    """Written by the worker that needs it first, for all of them: its figures take ten seconds."""
    place = tmp_path_factory.getbasetemp()
    place = place.parent if "PYTEST_XDIST_WORKER" in os.environ else place
    path = place / "report" / "deep" / "run"
    with FileLock(place / "report.lock"):
        if not path.exists():
            assert write_report(validation, path) == path / "report.md"
    return path


# the same examples in every run: a failure that comes and goes helps nobody who changes something else
settings.register_profile("suite", derandomize=True, deadline=None, database=None)
settings.load_profile("suite")
