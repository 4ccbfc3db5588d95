"""What several test files need."""

import pytest
from hypothesis import settings

from engines import Outcome
from engines.reference import compile_kernels


@pytest.fixture(scope="session")
def compiled():
    """Kernels compiled and cached, so that a child with a time limit only loads them."""
    compile_kernels()


@pytest.fixture
def in_this_process(monkeypatch):
    """Tasks are called here instead of in a child, which takes a second to start: for tests that are not about isolation."""
    def isolate(tasks, *, on_result=None, **_):
        outcomes = []
        for task in tasks:
            outcomes.append(Outcome(task.label, "ok", task.function(*task.args)))
            if on_result is not None:
                on_result(outcomes[-1])
        return outcomes

    monkeypatch.setattr("engines.isolate", isolate)
    monkeypatch.setattr("comparisons.nightly.isolate", isolate)


# the same examples in every run: a failure that comes and goes helps nobody who changes something else
settings.register_profile("suite", derandomize=True, deadline=None, database=None)
settings.load_profile("suite")
