"""The jump of an effort is read off samples without what happens inside the step of the jump, whatever the grid, and as well as it is said to be."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.measures.torque_jumps import JumpEstimate, estimate_jump
from stiction.comparisons.truth import slider_bar_truth
from stiction.engines.pymunk.engine import PymunkEngine
from stiction.scenes import Event, Trajectory, load_scene

EFFORT, AT = "motor.effort", 1.0
STEPS = st.sampled_from([5e-4, 1e-3, 2e-3, 5e-3, 1e-2])


def sampled(step, phase, size, inside=None, noise=0.0, seed=0):
    """An effort as smooth as the paper's (15 N m/s, 10 N m/s^2) that jumps at `AT`; in the step of the jump the value is `inside`, in units of the jump."""
    t = np.arange(0.0, 2 * AT, step) + phase * step
    values = 15 * t - 5 * t ** 2 + np.sin(2 * t) + np.where(t > AT, size * (1 + 0.1 * (t - AT)), 0.0)
    if inside is not None:
        k = int(np.searchsorted(t, AT))
        values[k] -= (1 - inside) * size
    return Trajectory("made-up", "made-up", "1", "joint", t, {EFFORT: values + noise * np.random.default_rng(seed).normal(size=len(t))})


def read(run, room=0.3):
    return estimate_jump(run, Event(AT, "reversal", "guide", {}, {}), room)


@given(STEPS, st.floats(0.05, 0.95), st.sampled_from([-1.2, 0.3, 1.0]), st.one_of(st.none(), st.floats(-1.0, 2.0)))
def test_what_is_inside_the_step_of_the_jump_does_not_count(step, phase, size, inside):
    """Impulse-based engines have a mean over the step there, or the impulse of a stop: of half the jump, if one side of it is taken to be the other's."""
    found = read(sampled(step, phase, size, inside))
    # unsure at 95 %: a value inside that is within a thousandth of one side bends its parabola; of 10,000 draws the worst was off by 1.87 times that
    assert abs(found.size - size) <= 2 * found.size_uncertainty < 0.02 * abs(size)  # slopes of the two sides differ by a tenth of the jump a second
    assert abs(found.time - AT) <= found.time_uncertainty + step and found.time_uncertainty <= 1.5 * step  # nothing tells which side a value inside belongs to


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_sizes_are_unsure_by_the_noise(step):
    """Jumps of thirty times the noise are found, and as near as is said; of noise alone hardly one is taken for a jump."""
    found = [read(sampled(step, 0.3, 1.0, 0.4, noise=0.03, seed=seed)) for seed in range(200)]
    errors = [(abs(one.size - 1.0), one.size_uncertainty) for one in found if one is not None]
    assert len(errors) > 150 and np.mean([error <= unsure for error, unsure in errors]) > 0.85  # the surest of many is not unsure enough
    assert np.mean([read(sampled(step, 0.3, 0.0, noise=0.1, seed=seed)) is not None for seed in range(200)]) < 0.1


def test_nothing_is_read_from_beyond_other_events():
    """Another jump 40 ms later, as large: with samples of 1 ms it is left out, with those of 10 ms there are too few on one side."""
    fine, coarse = (sampled(step, 0.3, 1.0) for step in (1e-3, 1e-2))
    both = [replace(run, columns={EFFORT: run[EFFORT] + 1.0 * (run.t > AT + 0.04)}) for run in (fine, coarse)]
    assert read(both[0], room=0.02).size == pytest.approx(1.0, abs=0.01) and read(both[1], room=0.02) is None


def test_an_effort_that_guides_at_rest_leave_open_has_no_jump():
    """Nan at the instants before: no size is read from the others. Beyond what is looked at it does not matter."""
    run = sampled(1e-3, 0.3, 1.0)
    near, far = (replace(run, columns={EFFORT: np.where(where, np.nan, run[EFFORT])}) for where in ((run.t > 0.9) & (run.t < AT), run.t < 0.2))
    assert read(near) is None and read(far).size == pytest.approx(1.0, abs=0.01)


@pytest.fixture(scope="module")
def pymunk_run():
    return PymunkEngine().simulate(load_scene("slider-bar-case-1"), t_end=8.5, dt=1e-3, output_step=1e-3)


def test_an_engine_is_told_the_same_jumps_on_any_grid(pymunk_run):
    """pymunk's efforts are right to 1e-3 N m on both sides of every jump, of 0.08 to 1.1 N m, of case 1: so are its jumps."""
    truth = slider_bar_truth(load_scene("slider-bar-case-1"), 8.5)
    jumps = [event for event in truth.events if abs(event.jump(EFFORT)) > 1e-9]
    for event in jumps:
        thinned = [replace(pymunk_run, t=pymunk_run.t[::n], columns={EFFORT: pymunk_run[EFFORT][::n]}) for n in (1, 2, 5, 10)]
        found: list[JumpEstimate] = [estimate_jump(run, event, 0.06) for run in thinned]
        assert all(abs(one.size - event.jump(EFFORT)) < 0.02 for one in found)
        assert all(abs(one.size - found[0].size) <= one.size_uncertainty + found[0].size_uncertainty < 0.05 for one in found)
    assert len(jumps) == 6
