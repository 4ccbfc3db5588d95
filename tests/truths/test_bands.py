"""The search for bands on made-up parameters: every band wider than the resolution is found, with its ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.scenes import InputError
from stiction.truths.bands import (
    SPLIT_PART,
    Band,
    BandKind,
    Range,
    find_bands,
    stick_bands,
    threshold_of,
    with_coexisting,
)

REST, STICK, SLIP = BandKind.REST, BandKind.STICK, BandKind.SLIP
UNSETTLED = BandKind.UNSETTLED
WIDTH = 1e-6


def kind_in(ends, kinds):
    """The kinds between increasing ends, one more than these."""
    return lambda value: kinds[int(np.searchsorted(ends, value))]


@given(
    st.lists(st.floats(0.1, 2.0), min_size=1, max_size=6),
    st.lists(st.sampled_from([REST, STICK, SLIP]), min_size=7, max_size=7),
)
def test_every_band_wider_than_the_resolution_is_found(widths, kinds):
    """The last band fills the range, which is 13 long; neighbours of one kind are one band."""
    ends = np.cumsum(widths)
    searched = Range(0.0, 13.0, 0.099)
    found = find_bands(kind_in(ends, kinds), searched, WIDTH)
    expected = []
    for low, high, kind in zip([0.0, *ends], [*ends, 13.0], kinds):
        if expected and expected[-1][2] == kind:
            expected[-1] = expected[-1][0], high, kind
        else:
            expected.append((low, high, kind))
    assert [band.kind for band in found] == [kind for _, _, kind in expected]
    for band, (low, high, _) in zip(found, expected):
        assert abs(band.low - low) <= band.low_uncertainty + 1e-12 <= WIDTH
        assert abs(band.high - high) <= band.high_uncertainty + 1e-12 <= WIDTH


def test_the_band_of_the_counter_example_is_not_stepped_over():
    """0.4 N wide in 12 N, the narrowest that is known: nine probes from 0.75 to 12 N step over it."""
    kind_at = kind_in([0.81, 2.305, 4.324, 4.724], [REST, STICK, SLIP, STICK, SLIP])
    fine = find_bands(kind_at, Range(0.0, 12.0, 0.1), WIDTH)
    assert [band.kind for band in fine] == [REST, STICK, SLIP, STICK, SLIP]
    coarse = find_bands(kind_at, Range(0.75, 12.0, 1.41), WIDTH)
    assert [band.kind for band in coarse] == [REST, STICK, SLIP]


def test_a_third_kind_between_two_values_of_the_grid_is_found_where_it_is_met():
    kind_at = kind_in([1.4, 1.6], [REST, STICK, SLIP])
    found = find_bands(kind_at, Range(0.0, 3.0, 1.0), WIDTH)
    assert [band.kind for band in found] == [REST, STICK, SLIP]
    assert [band.low for band in found[1:]] == pytest.approx([1.4, 1.6], abs=WIDTH)


def test_an_end_next_to_no_steady_state_is_not_sharp():
    found = find_bands(kind_in([1.4], [SLIP, UNSETTLED]), Range(0.0, 3.0, 1.0), WIDTH)
    assert WIDTH < found[0].high_uncertainty <= SPLIT_PART / 2 and abs(found[0].high - 1.4) <= 0.07


@given(st.floats(0.02, 2.98), st.floats(0.02, 2.98))
def test_an_expected_end_saves_probes_and_changes_nothing(end, expected):
    """Wrong expectations are found out: the end is where it is, whatever was expected."""
    asked = []

    def kind_at(value):
        asked.append(value)
        return STICK if value < end else SLIP

    searched = Range(0.0, 3.0, 1.0)

    def expectation(low, high):
        return expected if low < expected < high else None

    found = find_bands(kind_at, searched, WIDTH, expected_end=expectation)
    assert [band.kind for band in found] == [STICK, SLIP]
    assert abs(found[0].high - end) <= found[0].high_uncertainty <= WIDTH / 2
    assert len(asked) <= 4 + 2 + np.log2(1.0 / WIDTH) + 2
    asked.clear()
    exact = find_bands(kind_at, searched, WIDTH, expected_end=lambda low, high: end)
    assert abs(exact[0].high - end) <= WIDTH / 2
    assert len(asked) <= 4 + np.log2(1 / SPLIT_PART) + 4


def test_kinds_that_change_everywhere_end_the_search():
    """A number of bands that the resolution bounds, whatever is found."""
    rng = np.random.default_rng(1)
    found = find_bands(lambda value: list(BandKind)[rng.integers(5)], Range(0.0, 1.0, 0.1), WIDTH)
    assert 1 < len(found) <= 10 * 2 / SPLIT_PART
    assert [band.high for band in found[:-1]] == [band.low for band in found[1:]]


@pytest.mark.parametrize(
    ("low", "high", "resolution", "words"),
    [
        (2.0, 1.0, 0.1, "LOW < HIGH"),
        (1.0, 1.0, 0.1, "LOW < HIGH"),
        (0.0, np.inf, 0.1, "finite"),
        (np.nan, 1.0, 0.1, "finite"),
        (0.0, 1.0, 0.0, "more than zero"),
        (0.0, 1.0, -1.0, "more than zero"),
        (0.0, 1.0, 2.0, "at most the width"),
        (0.0, 1.0, np.nan, "more than zero"),
        (0.0, 1.0, 1e-9, "at most 100000 values"),
    ],
)
def test_bad_ranges(low, high, resolution, words):
    with pytest.raises(InputError, match=words):
        Range(low, high, resolution)


def test_the_values_of_a_range_are_not_farther_apart_than_its_resolution():
    assert len(Range(0.0, 12.0, 0.1).values()) == 121
    values = Range(1.0, 2.0, 0.3).values()
    assert values[0] == 1.0 and values[-1] == 2.0 and max(np.diff(values)) <= 0.3


BANDS = (
    Band(0.0, 1.0, SLIP),
    Band(1.0, 2.0, REST),
    Band(2.0, 2.5, STICK),
    Band(2.5, 5.5, SLIP),
    Band(5.5, 7.5, STICK),
    Band(7.5, 8.0, SLIP),
)


def test_rest_and_stick_are_one_interval_with_stick():
    assert stick_bands(BANDS) == ((1.0, 2.5), (5.5, 7.5))


@pytest.mark.parametrize(
    ("own", "end"), [(1.5, 2.5), (2.2, 2.5), (4.0, 2.5), (6.0, 7.5), (8.0, 7.5), (0.5, 2.5)]
)
def test_the_threshold_is_the_end_of_the_interval_next_to_the_own_value(own, end):
    """Of the one that contains it, else of the next one below, else of the next one above."""
    below, above = threshold_of(BANDS, own)
    assert below.high == end == above.low


def test_no_threshold_where_no_interval_ends():
    assert threshold_of((Band(0.0, 8.0, STICK),), 3.0) is None
    assert threshold_of((Band(0.0, 8.0, SLIP),), 3.0) is None
    assert threshold_of((Band(0.0, 4.0, SLIP), Band(4.0, 8.0, STICK)), 3.0) is None


def test_a_band_knows_the_kinds_that_other_starts_lead_to():
    """Not those at its very ends, nor motions without a steady state."""
    bands = Band(0.0, 2.0, REST, 0.0, 0.1), Band(2.0, 4.0, SLIP, 0.1, 0.0)
    seen = [(1.0, SLIP), (1.5, SLIP), (1.95, STICK), (3.0, UNSETTLED), (3.5, SLIP)]
    rest, slip = with_coexisting(bands, seen)
    assert rest.coexisting == (SLIP,) and rest.depends_on_start
    assert slip.coexisting == () and not slip.depends_on_start
