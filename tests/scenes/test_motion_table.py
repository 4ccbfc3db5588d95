"""Both sides of events in a table: of independent parts too, in whatever is made of it."""

import numpy as np
import pandas as pd
import pytest

import stiction
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.scenes import Event, load_scene
from stiction.scenes.motion_table import with_sides
from stiction.scenes.trajectory import events_frame, events_of


@pytest.fixture(scope="module")
def run(compiled):
    scene = load_scene("hard/three-stop-at-once")
    run = stiction.load_engine("reference").simulate(
        scene, rtol=1e-9, output_step=scene.t_end / 1000
    )
    assert len(run.events[0].before) < len(run.columns)
    return run


def test_events_of_independent_parts_have_all_columns(run):
    """Interpolated where a part has no event: within what the truth and the run at rtol 1e-9 leave."""
    frame, truth = run.to_frame(events=True, interpolated=True), ground_truth(run.mechanism)
    assert frame.notna().all(axis=None) and len(frame) == len(run.t) + 2 * len(run.events)
    true = truth(frame["t"].to_numpy())
    assert (
        max(np.abs(frame[name] - true[name]).max() for name in true if name.endswith((".x", ".vx")))
        < 1e-7
    )


def test_rows_of_events_have_no_values_that_the_run_has_not_computed(run):
    """A reader takes each number of a table for the reference's own: those of other parts are left out."""
    frame = run.to_frame(events=True)
    assert len(frame) == len(run.t) + 2 * len(run.events)
    for event in run.events:
        rows = frame[frame["t"] == event.time]
        others = [
            name
            for name in run.columns
            if name not in event.before and not name.startswith("drift.")
        ]
        assert others and rows[others].isna().any(axis=None)
        for side in (event.before, event.after):
            assert any(
                all(row[name] == value for name, value in side.items())
                for _, row in rows.iterrows()
            )


def test_their_energies_have_no_gaps(run):
    energies = stiction.energies(run)
    assert (
        energies.notna().all(axis=None)
        and energies["balance"].abs().max() < 1e-6 * energies["kinetic"].max()
    )


def test_events_of_two_parts_at_one_instant_are_passed_one_after_the_other():
    """The second one's columns have not jumped yet at the first, the first one's have at the second."""
    frame = pd.DataFrame({"t": [0.0, 1.0, 2.0], "a.vx": [1.0, 1.0, 3.0], "b.vx": [5.0, 5.0, 7.0]})
    events = [
        Event(1.5, "slip", "a", {"a.vx": 1.0}, {"a.vx": 3.0}),
        Event(1.5, "slip", "b", {"b.vx": 5.0}, {"b.vx": 7.0}),
    ]
    found = with_sides(frame, events)
    assert found["t"].tolist() == [0, 1, 1.5, 1.5, 1.5, 1.5, 2]
    np.testing.assert_allclose(found["a.vx"][2:6], [1, 3, 3, 3], rtol=1e-12)
    np.testing.assert_allclose(found["b.vx"][2:6], [5, 5, 5, 7], rtol=1e-12)


def test_a_table_of_events_gives_each_back_with_its_own_columns(run):
    assert events_of(events_frame(run.events)) == run.events
