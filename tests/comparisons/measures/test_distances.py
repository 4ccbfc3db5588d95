"""Distances are metrics, and state an uncertainty that holds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stiction.comparisons.measures.distances import Graph, l1, match_events
from stiction.scenes import Event

VALUES = st.floats(-10, 10)


@st.composite
def graphs(draw):
    """Broken lines over [0, 1], some of them with jumps."""
    n = draw(st.integers(2, 8))
    inner = sorted(draw(st.lists(st.floats(0, 1), min_size=n - 2, max_size=n - 2)))
    values = draw(st.lists(VALUES, min_size=n, max_size=n))
    return Graph(np.array([0.0, *inner, 1.0]), np.array(values))


def step(at, jump=1.0):
    return Graph(np.array([0.0, at, at, 1.0]), np.array([0.0, 0.0, jump, jump]))


@settings(deadline=None, max_examples=60)
@given(graphs(), graphs(), graphs())
def test_l1_is_a_metric(a, b, c):
    rounding = 1e-12  # values of up to 10 over one second
    assert l1(a, a).value == 0
    assert l1(a, b).value == pytest.approx(l1(b, a).value, abs=rounding)
    assert l1(a, c).value <= l1(a, b).value + l1(b, c).value + rounding


@settings(deadline=None, max_examples=60)
@given(st.floats(0.1, 0.8), st.floats(0.0, 0.1), st.floats(0.5, 10))
def test_shift_of_a_jump(at, shift, jump):
    assert l1(step(at, jump), step(at + shift, jump)).value == pytest.approx(
        jump * shift, abs=1e-12
    )


@pytest.mark.parametrize("n", [50, 200, 1000])
def test_l1_uncertainty_covers_sampling(n):
    """Integral of |sin t| over a period is 4; broken lines miss O(h^2) of it, no more than the uncertainty says."""
    t = np.linspace(0, 2 * np.pi, n)
    distance = l1(Graph(t, np.sin(t)), Graph(t, 0 * t))
    assert abs(distance.value - 4) <= distance.uncertainty
    assert distance.uncertainty < 10 * abs(distance.value - 4)  # and not absurdly more


def test_l1_on_different_times_and_crossings():
    a = Graph(np.array([0.0, 2.0]), np.array([-1.0, 1.0]))
    b = Graph(np.array([-1.0, 0.7, 3.0]), np.zeros(3))
    assert l1(a, b).value == pytest.approx(1.0, abs=1e-15)  # two triangles of 1/2


@pytest.mark.parametrize(
    "t, values, what",
    [
        ([0.0], [1.0], "at least two"),
        ([0.0, 1.0], [1.0], "one value per time"),
        ([1.0, 0.0], [1.0, 1.0], "decrease"),
        ([0.0, 0.0], [1.0, 2.0], "advance"),
        ([0.0, 1.0], [1.0, math.nan], "finite"),
    ],
)
def test_graphs_refuse(t, values, what):
    with pytest.raises(ValueError, match=what):
        Graph(np.array(t), np.array(values))


def test_distances_refuse():
    with pytest.raises(ValueError, match="no time in common"):
        l1(step(0.5), Graph(np.array([2.0, 3.0]), np.zeros(2)))
    with pytest.raises(ValueError, match="window"):
        match_events([], [], window=0.0)


def event(time, kind="stick", joint="guide"):
    return Event(time, kind, joint, {}, {})


def test_events_match_by_kind_joint_and_time():
    true = [event(1.0), event(2.0, "slip"), event(3.0, "reversal"), event(4.0)]
    found = [event(1.01), event(2.02, "slip"), event(3.0), event(3.99, joint="other"), event(9.0)]
    result = match_events(true, found, window=0.1)
    assert result.matched == ((true[0], found[0]), (true[1], found[1]))
    assert result.missed == (true[2], true[3])
    assert result.spurious == tuple(found[2:])
    assert result.time_error == pytest.approx(0.02)


def test_matching_prefers_more_pairs_over_nearer_ones():
    """0.0-0.9 would be the nearest for 1.0's neighbour: greedy matching loses a pair, the assignment does not."""
    result = match_events([event(0.0), event(1.0)], [event(0.9), event(1.8)], window=1.0)
    assert len(result.matched) == 2 and not result.missed and not result.spurious


@given(st.lists(st.floats(0, 10), max_size=8), st.lists(st.floats(0, 10), max_size=8))
def test_every_event_is_accounted_for_once(true, found):
    a, b = [event(t) for t in true], [event(t) for t in found]
    result = match_events(a, b, window=0.5)
    assert len(result.matched) + len(result.missed) == len(a)
    assert len(result.matched) + len(result.spurious) == len(b)
    assert all(abs(first.time - second.time) <= 0.5 for first, second in result.matched)
    back = match_events(b, a, window=0.5)
    assert len(back.matched) == len(result.matched)
    if not result.matched:
        assert math.isnan(result.time_error)
