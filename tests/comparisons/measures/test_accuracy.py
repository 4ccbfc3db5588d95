"""Errors of runs: every event counts, and no number depends on the output or is smaller than its own uncertainty."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.bench.methods import groups
from stiction.comparisons.bench.participants import variant
from stiction.comparisons.bench.presentation.cells import with_uncertainty
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.variants import COEFFICIENTS, Coefficients, Record
from stiction.comparisons.measures.accuracy import (
    KINDS,
    effort_error,
    errors,
    graph,
    missed,
    truth_over_time,
)
from stiction.comparisons.measures.distances import Graph, l1
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.engines import Outcome
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reports.markdown.tables import markdown
from stiction.scenes import load_scene
from stiction.truths import slider_bar_truth
from stiction.uncertain import Uncertain

CASE, EFFORT = "slider-bar-case-1", "motor.effort"
TORQUE, UNSURE = "torque_error", "torque_uncertainty"


@pytest.fixture(scope="module")
def truth():
    return slider_bar_truth(load_scene(CASE))


def run(output_step, **settings):
    return ReferenceEngine().simulate(load_scene(CASE), output_step=output_step, **settings)


def all_jumps(truth):
    return sum(abs(event.jump(EFFORT)) for event in truth.events)


def test_an_engine_that_locates_no_corners_misses_them(truth):
    found = errors(run(0.01, dt=1e-2), truth)
    corners = sum(event.kind == "corner" for event in truth.events)
    assert corners > 5 and found[missed("corner")] == corners
    assert found["events_missed"] == sum(found[missed(kind)] for kind in KINDS)
    assert found["events_matched"] + found["events_missed"] == len(truth.events)
    assert errors(run(0.01, rtol=1e-9), truth)["events_missed"] == 0


def test_error_of_the_effort_does_not_depend_on_the_output(truth):
    """The scheme's error at 1 ms, 4e-4 N m in the mean; interpolating the effort itself is off by its curvature."""
    fine, coarse = run(1e-3, dt=1e-3), run(2e-2, dt=1e-3)
    one, other = (effort_error(found, truth, EFFORT) for found in (fine, coarse))
    assert abs(one.value - other.value) <= one.uncertainty + other.uncertainty < 0.1 * one.value
    by_interpolation = (
        l1(graph(coarse, EFFORT), Graph(*truth_over_time(truth, EFFORT, coarse.t))).value
        / coarse.t[-1]
    )
    assert abs(by_interpolation - one.value) > abs(other.value - one.value)


def test_an_effort_that_is_left_open_has_no_error_and_the_motion_has(truth):
    found = run(0.01, rtol=1e-9)
    effort = found[EFFORT].copy()
    effort[7] = np.nan
    unknown = replace(found, columns={**found.columns, EFFORT: effort})
    known, left_open = (errors(one, truth) for one in (found, unknown))
    assert (
        set(known) - set(left_open)
        == {name for name in known if name.startswith("torque")}
        != set()
    )
    assert left_open["position_error"] < 1e-6


def test_error_of_the_effort_of_a_shifted_truth(truth):
    """Jumps that all come by `shift` late: the mean error is their sum times the shift, and the known smooth part."""
    found, shift = run(1e-2, rtol=1e-12), 1e-4
    late = replace(
        found, events=tuple(replace(event, time=event.time + shift) for event in found.events)
    )
    expected = all_jumps(truth) * shift / truth.t_end
    assert effort_error(found, truth, EFFORT).value < 1e-3 * expected
    # the effort of the late rows is off by shift times its rate of some 15 N m/s
    assert effort_error(late, truth, EFFORT).value == pytest.approx(expected, rel=0.5)


def test_runs_without_events_know_their_effort_to_a_jump_times_the_output_step(truth):
    blind = replace(run(1e-2, rtol=1e-12), events=())
    found = effort_error(blind, truth, EFFORT)
    assert (
        found.value <= found.uncertainty
        and found.uncertainty >= all_jumps(truth) * 1e-2 / truth.t_end
    )
    record = Record("key", CASE, variant("paper's scheme"), 1e-2, Outcome("key", "ok", blind))
    table = torque_table([record], {"key": truth})
    assert (table["time_error"].abs() <= table["time_uncertainty"])[table["resolved"]].all()


@pytest.mark.parametrize(
    "value, uncertainty, shown",
    [
        (1.234e-3, 1e-9, "0.0012"),
        (1.234e-3, 2.01e-4, "0.00123 ± 0.00021"),
        (1.7e-13, 9e-6, "< 9.1e-06"),
        (-2e-5, 2e-5, "< 4e-05"),
        (0.0, 0.0, "0"),
        (float("inf"), 1e-3, "inf"),
    ],
)
def test_no_number_is_printed_below_its_uncertainty(value, uncertainty, shown):
    assert str(Uncertain(value, uncertainty)) == shown


def test_tables_print_numbers_with_their_uncertainty():
    assert (
        quantity_of("position_error").uncertainty == "position_uncertainty"
        and quantity_of(TORQUE).uncertainty == UNSURE
    )
    table = pd.DataFrame({"variant": ["a", "b"], TORQUE: [1e-3, 1e-13], UNSURE: [1e-9, 1e-6]})
    assert list(with_uncertainty(table)) == ["variant", TORQUE]
    text = markdown(table)
    assert "0.001" in text and "< 1.1e-06" in text and "1e-13" not in text


def test_lists_hold_one_fidelity_and_one_physics():
    table = pd.DataFrame(
        {
            "variant": list("abc"),
            "fidelity": ["joint", "contact", "joint"],
            COEFFICIENTS: [Coefficients.BOTH, Coefficients.BOTH, Coefficients.ONE],
        }
    )
    assert [(group.label, list(rows["variant"])) for group, rows in groups(table)] == [
        ("joint, mus > mu", ["a"]),
        ("contact, mus > mu", ["b"]),
        ("joint, mus = mu", ["c"]),
    ]
