"""What of a run's CPU time is the engine's own, on a machine whose clocks are told what happens."""

import pytest

from stiction.engines.shared import engine_clock
from stiction.engines.shared.engine_clock import INTERVAL, EngineClock

STEP = INTERVAL / 20


class Machine:
    """A processor: `work` takes it, while `wait` others have it; to ask for the CPU time takes it too, and others come in there."""

    def __init__(self, per_look: float = 0.0, wait_at_look: float = 0.0):
        self.time = self.cpu = 0.0
        self.looks, self._per_look, self._wait_at_look = 0, per_look, wait_at_look

    def work(self, seconds: float) -> None:
        self.time, self.cpu = self.time + seconds, self.cpu + seconds

    def wait(self, seconds: float) -> None:
        self.time += seconds

    def cpu_time(self) -> float:
        self.looks += 1
        self.wait(self._wait_at_look)
        self.work(self._per_look)
        return self.cpu


@pytest.fixture
def machine(monkeypatch):
    def make(**arguments) -> Machine:
        made = Machine(**arguments)
        monkeypatch.setattr(engine_clock, "perf_counter", lambda: made.time)
        monkeypatch.setattr(engine_clock, "process_time", made.cpu_time)
        return made

    return make


def run(made: Machine, steps: int, own: float, ours: float) -> EngineClock:
    clock = EngineClock()
    for _ in range(steps):
        clock.call(made.work, own)
        made.work(ours)
    return clock


def test_alone_on_a_machine_the_times_are_those_of_the_two_parts(machine):
    made = machine()
    clock = run(made, 1000, STEP, 2 * STEP)
    assert clock.engine_s == pytest.approx(1000 * STEP) and clock.calls == 1000
    assert made.looks < 1000 * 3 * STEP / INTERVAL + 3


def test_what_the_looks_take_is_shared_as_the_rest(machine):
    """A look of a tenth of an interval: a third of that is the engine's, as of all."""
    made = machine(per_look=INTERVAL / 10)
    clock = run(made, 3000, STEP, 2 * STEP)
    assert clock.engine_s == pytest.approx(made.cpu / 3, rel=0.01)


def test_others_that_come_in_where_the_cpu_time_is_asked_for_change_nothing(machine):
    made = machine(wait_at_look=100 * INTERVAL)
    assert run(made, 1000, STEP, 2 * STEP).engine_s == pytest.approx(1000 * STEP)


@pytest.mark.parametrize("inside", [True, False])
def test_a_disturbance_costs_at_most_its_interval(machine, inside):
    made, clock = machine(), EngineClock()
    for step in range(1000):
        clock.call(made.work, STEP)
        made.work(2 * STEP)
        if step % 100 == 50:
            clock.call(made.wait, 20 * INTERVAL) if inside else made.wait(20 * INTERVAL)
    assert clock.engine_s == pytest.approx(1000 * STEP, abs=10 * (INTERVAL + 3 * STEP))
    assert (clock.engine_s > 1000 * STEP) == inside


def test_what_is_called_back_is_not_the_engines(machine):
    made, clock = machine(), EngineClock()

    def steps() -> str:
        for _ in range(1000):
            made.work(STEP)
            clock.call_back(made.work, 3 * STEP)
            made.work(STEP)
        return "done"

    made.work(7 * STEP)
    assert clock.call(steps) == "done"
    assert clock.engine_s == pytest.approx(2000 * STEP) and clock.calls == 1
