"""One protocol of timing: what is repeated how often, what is not counted, and what is timed beside it. No verdict here rests on a time."""

import pytest

from stiction.comparisons.studies import work_precision
from stiction.comparisons.studies.work_precision import timed_run
from stiction.comparisons.timing import timed_run as timing
from stiction.comparisons.timing.timed_run import LONG, MOST, SECONDS, bare_run, timed, turns
from stiction.engines import load_engine
from stiction.scenes import load_scene


@pytest.mark.parametrize(("seconds", "times"), [(1e-6, MOST), (SECONDS / MOST, MOST), (SECONDS / 10, 10), (SECONDS, 3), (10 * SECONDS, 3), (0.0, MOST)])
def test_a_call_is_repeated_for_a_tenth_of_a_second(seconds, times):
    assert turns(seconds, 3) == times


class Clock:
    """CPU time that only calls spend."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(timing, "process_time", lambda: self.now)

    def spending(self, *seconds):
        left = iter(seconds)

        def call():
            self.now += next(left)
            return self.now

        return call


def test_first_call_is_not_counted_and_others_alternate(monkeypatch):
    clock, asked = Clock(monkeypatch), []
    found = timed(clock.spending(0.9, *[0.05] * 5), 5, lambda seconds: asked.append(seconds) or 7.0)
    assert found.seconds == pytest.approx([0.05] * 5) and found.beside == (7.0,) * 5 and asked == pytest.approx([0.9] * 5)
    assert len(found.results) == 5


def test_a_long_call_is_made_once(monkeypatch):
    found = timed(Clock(monkeypatch).spending(1.5 * LONG), 5, lambda seconds: 1.0)
    assert found.seconds == (1.5 * LONG,) and found.beside == (1.0,) and len(found.results) == 1


def test_a_long_run_is_its_own_timing(monkeypatch, compiled):
    monkeypatch.setattr(work_precision, "LONG", 0.0)
    monkeypatch.setattr(work_precision, "timed", None)  # not called
    found = timed_run("reference", load_scene("slider-bar-case-1"), {"rtol": 1e-6, "t_end": 1.0}, 3)
    assert found.stepping_s == (found.trajectory.cost.stepping_s,)


def test_what_is_timed_is_the_motion_without_its_table(compiled):
    scene, engine = load_scene("slider-bar-case-1"), load_engine("reference")
    arguments = {"rtol": 1e-9, "t_end": 2.0, "output_step": 0.001, "fidelity": "joint", "stabilization": "projection"}
    bare, whole = bare_run(engine, scene, arguments)(), engine.simulate(scene, **arguments)
    assert len(bare.t) == 2 and bare.t[-1] == 2.0 and len(whole.t) == 2001
    assert bare["slider.x"][-1] == whole["slider.x"][-1] and bare.settings["stabilization"]["method"] == "projection"
    assert len(bare_run(engine, scene, {"rtol": 1e-9})().t) == 2
