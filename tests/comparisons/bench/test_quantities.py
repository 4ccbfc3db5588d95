"""What the columns of tables are: looked up, never read out of a label or of the name of a column."""

from dataclasses import replace

import pytest

from stiction.comparisons.bench import quantities
from stiction.comparisons.bench.methods import groups, same_work
from stiction.comparisons.bench.quantities import FAMILIES, QUANTITIES, Kind, quantity_of
from stiction.comparisons.studies import studies
from stiction.reports.text import section_of


def presented(results):
    """All numbers, rows, groups and rankings that studies make of the results; no heading."""
    found = {}
    for study in studies():
        said = section_of(study, results)
        found[study.name] = (
            [number.text for number in said.numbers],
            [
                (table.name, table.group, table.rows, table.cells(), table.right())
                for table in said.tables
            ],
            [headline.cells for headline in said.headlines],
        )
    accuracy = results.table("accuracy")
    found["groups"] = [(group, list(rows.index)) for group, rows in groups(accuracy)]
    found["rankings"] = [(group, list(rows.index)) for group, rows in same_work(accuracy)]
    return found


def test_other_labels_and_titles_change_no_number_ranking_or_group(validation, monkeypatch):
    before = presented(validation)
    assert before["groups"] and before["rankings"] and before["accuracy"][0]
    renamed = {
        key: replace(quantity, label=f"Zeta {place}, (mus = mu): adapter", description="error [m]")
        for place, (key, quantity) in enumerate(QUANTITIES.items())
    }
    monkeypatch.setattr(quantities, "QUANTITIES", renamed)
    assert quantity_of("position_error").label.startswith("Zeta")
    assert presented(validation) == before


def test_another_kind_changes_how_a_number_is_written(validation, monkeypatch):
    """The test above can fail: what decides is the kind."""
    before = presented(validation)
    exact = {**QUANTITIES, "position_drift": replace(QUANTITIES["position_drift"], kind=Kind.EXACT)}
    monkeypatch.setattr(quantities, "QUANTITIES", exact)
    assert presented(validation) != before


@pytest.mark.parametrize(
    ("key", "label", "unit"),
    [
        ("position_error", "position error", "m"),
        ("end:slider.x", "slider.x at the end", "m"),
        ("end:bar.angle", "bar.angle at the end", "rad"),
        ("events:guide.slip", "events of guide.slip", ""),
        ("last_event:guide.slip", "last event of guide.slip", "s"),
        ("counter:hlcp", "hlcp", ""),
        ("nothing_known", "nothing_known", ""),
    ],
)
def test_keys_are_looked_up(key, label, unit):
    found = quantity_of(key)
    assert (found.key, found.label, found.unit) == (key, label, unit)


def test_families_and_quantities_have_no_key_in_common():
    assert not set(FAMILIES) & set(QUANTITIES)
    assert not any(":" in key for key in QUANTITIES)
