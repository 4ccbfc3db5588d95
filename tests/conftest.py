"""What several test files need."""

import gc
import os
import pickle
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import partial
from importlib import import_module
from io import StringIO
from itertools import islice
from pathlib import Path
from secrets import randbits

import pytest
from filelock import FileLock
from fuzz.seeds import BITS, VARIABLE
from hypothesis import settings
from report_material import CASE, LOST, T_END, leave_dots, record, timed, validation_of
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.comparisons.bench.participants import extent, variant
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Record, Variant
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.measures import scene_truth
from stiction.comparisons.studies import studies
from stiction.comparisons.studies.effects import toggles
from stiction.comparisons.studies.suppression import suppression_variants
from stiction.engines import Engine, EngineMissing, Outcome, isolation, load_engine
from stiction.engines.reference.engine import ReferenceEngine, compile_kernels
from stiction.reports import report_of, write_report
from stiction.scenes import load_scene
from stiction.truths import slider_bar_truth


def pytest_configure():
    """One fresh seed for all draws of a run; workers that are started later inherit it."""
    os.environ.setdefault(VARIABLE, str(randbits(BITS)))


def pytest_report_header():
    return f"fresh seed of random scenes: {VARIABLE}={os.environ[VARIABLE]}"


def pytest_sessionstart(session):
    """Kernels are compiled once, before workers start that would each compile the same."""
    if session.config.getoption("numprocesses", default=None):
        compile_kernels()
        compile_kernels("moreau")


def pytest_collection_finish():
    """What has been imported stays: the garbage collector, which looks at it again and again, took an eighth of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def compiled():
    """Kernels compiled and cached, so that a child with a time limit only loads them."""
    compile_kernels()


@pytest.fixture(scope="session", autouse=True)
def figures_in_this_process():
    """The workers of the tests keep all cores busy; and text that has been set for one figure need not be set again for the next."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiction.reports.figures.style.MIN_FIGURES_PER_PROCESS", 10_000)
        yield


LONGEST_REASON = 100
"""Characters of a reason to skip: it is a line of the summary, which names what is missing and not how that shows."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Skips of a file with the same reason are one line of the summary; a reason that is long, or has several lines, fails its test."""
    report = yield
    if report.skipped and isinstance(report.longrepr, tuple):
        reason = str(report.longrepr[2]).removeprefix("Skipped: ")
        report.longrepr = (str(item.path), None, reason)
        if len(reason) > LONGEST_REASON or "\n" in reason:
            report.outcome = "failed"
            report.longrepr = f"found a reason to skip of {len(reason)} characters; expected a line of at most {LONGEST_REASON}: {reason}"
    return report


def installed(engine: str) -> Engine:
    """The engine, or a skipped test, or module where a module asks, where its package is missing."""
    try:
        return load_engine(engine)
    except EngineMissing as missing:
        pytest.skip(f"{engine}: {missing.state}", allow_module_level=True)


def invoke(command: str, *arguments, exit_code: int | None = 0, **options):
    """A command with words between spaces, and more arguments, in this process; it ends with this exit code, or with any."""
    result = CliRunner().invoke(app, [*command.split(), *map(str, arguments)], **options)
    assert exit_code is None or result.exit_code == exit_code, result.output
    return result


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


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
def isolated_by(function):
    """Tasks are made by this function."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (
            "stiction.engines",
            "stiction.comparisons.regression.nightly",
            "stiction.comparisons.bench.runner",
            "stiction.comparisons.bench.executors",
            "stiction.comparisons.bench.complementarity.replay",
            "stiction.comparisons.judge.conformance",
        ):
            patch.setattr(f"{module}.isolate", function)
        yield


def here():
    """Tasks are called in this process instead of in children, each of which takes a second to start: for what is not about isolation."""
    return isolated_by(called_here)


@pytest.fixture
def in_this_process():
    with here():
        yield


@pytest.fixture
def fresh_truths(monkeypatch):
    """Truths are found anew each time, and none is kept for the tests to come: for what changes how they are found."""
    monkeypatch.setattr(
        "stiction.comparisons.measures.scene_truth._best_truth", scene_truth._best_truth.__wrapped__
    )


@pytest.fixture
def interruptible():
    """Children take SIGINT as they do at a terminal, even where this process was started to ignore it: ``nohup``, ``make test &``."""
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a child inherits what is ignored, not a handler
    yield
    signal.signal(signal.SIGINT, before)


LONG_STUDIES = frozenset({"claims", "drift", "long-drift", "orders", "settings", "threshold"})
"""Studies that take more than some seconds however few variants there are."""


def shorten_validation(monkeypatch: pytest.MonkeyPatch, variants: tuple[Variant, ...]) -> None:
    """`validate` with the variants it is given, without the `LONG_STUDIES`, and with few effects and hard cases; for tests that are not about what it finds."""
    chosen = [study for study in studies() if study.name not in LONG_STUDIES]
    fewer = {
        "variants": lambda *_: variants,
        "cost_variants": lambda *_: variants,
        "suppression_variants": lambda: suppression_variants()[:1],
        "toggles": lambda scene: islice(toggles(scene), 2),
    }
    for module in [import_module(study.present.__module__) for study in chosen]:
        for name in fewer.keys() & vars(module).keys():
            monkeypatch.setattr(module, name, fewer[name])
    for name, value in {
        "validation.studies": lambda: chosen,
        "validation.variants": lambda *_: variants,
        "validation.extent": lambda depth: extent(depth).model_copy(
            update={"limit": 600.0}
        ),  # a busy machine may take longer than a user waits
        "hard.table.hard_cases": lambda depth: hard_cases(depth)[:2],
    }.items():
        monkeypatch.setattr(f"stiction.comparisons.{name}", value)
    monkeypatch.setattr("stiction.reports.markdown.validation_report.save_all", leave_dots)


@pytest.fixture
def short_validation(monkeypatch):
    return partial(shorten_validation, monkeypatch)


@pytest.fixture(scope="session")
def truths() -> dict:
    return {CASE: slider_bar_truth(load_scene(CASE), T_END)}


@pytest.fixture(scope="session")
def lost_records() -> list[Record]:
    return [
        record(Variant(f"engine {i}", f"engine{i}", "dt", (1e-2,), "contact"), 1e-2, status, reason)
        for i, (status, reason) in enumerate(LOST.items())
    ]


@pytest.fixture(scope="session")
def validation(truths, lost_records) -> Results:
    scene, engine = load_scene(CASE), ReferenceEngine()
    tight = timed(engine.simulate(scene, t_end=T_END, rtol=1e-9, stabilization="projection"))
    paper = timed(engine.simulate(scene, t_end=T_END, dt=2.5e-3))
    # the paper's scheme stands in for an engine that came out: what matters here is that it has a name of its own
    other = Variant("other", "other", "dt", (2.5e-3,))
    return validation_of(
        [
            record(variant("reference"), 1e-9, value=tight),
            record(variant("paper's scheme"), 2.5e-3, value=paper),
            record(other, 2.5e-3, value=replace(paper, engine="other", events=())),
            *lost_records,
        ],
        truths,
    )


@pytest.fixture(scope="session")
def report_folder(validation, tmp_path_factory):
    """Written by the worker that needs it first, for all of them: its figures take ten seconds."""
    place = tmp_path_factory.getbasetemp()
    place = place.parent if "PYTEST_XDIST_WORKER" in os.environ else place
    path = place / "report" / "deep" / "run"
    with FileLock(place / "report.lock"):
        if not path.exists():
            assert write_report(report_of(validation), path) == path / "report.md"
    return path


# the same examples in every run: a failure that comes and goes helps nobody who changes something else
settings.register_profile("suite", derandomize=True, deadline=None, database=None)
settings.load_profile("suite")


BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="module")
def browser() -> Iterator:
    """The system's browser; a test that needs one is skipped without it."""
    api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (pip install '.[test]')"
    )
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        pytest.skip(f"no browser on the path: none of {', '.join(BROWSERS)}")
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=executable, args=["--no-sandbox"]
        )  # where tests run as root
        yield opened
        opened.close()


@pytest.fixture
def watched_page(browser) -> Iterator:
    """A function that opens a page without a network, and fails on complaints and on requests outside of `root`."""
    contexts, complaints = [], []

    def opened(url, root, scheme="light", width=1280, height=900):
        context = browser.new_context(
            offline=True, color_scheme=scheme, viewport={"width": width, "height": height}
        )
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "console",
            lambda message: (
                complaints.append(message.text) if message.type in ("error", "warning") else None
            ),
        )
        page.on(
            "request",
            lambda request: (
                None
                if request.url.startswith((root, "data:", "blob:"))
                else complaints.append(f"asks for {request.url}")
            ),
        )
        page.goto(url)
        page.wait_for_selector("body[data-ready=yes]", timeout=600_000)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []
