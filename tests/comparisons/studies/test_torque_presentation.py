"""The study of torque jumps says what its table says: every jump of the truth counts, whoever has read it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up_runs import CASES, VARIANTS, about, record, words, wrongly_written

from stiction.comparisons.bench.presentation import ANSWER_LENGTH, Presentation
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.variants import COEFFICIENTS, Coefficients
from stiction.comparisons.studies.accuracy import in_scene
from stiction.comparisons.studies.torque import STUDY, plan, present, windows_table
from stiction.reports.text import section_of
from stiction.scenes import Event, InputError, Trajectory, load_scene
from stiction.truths import Tier, Truth

EFFORT = "motor.effort"
JUMPS = (-0.0636, 1.2, -2.5)
"""Of each case."""
BOUNDS = {
    "reference": 1e-12,
    "paper's scheme": 2.2e-4,
    "pymunk": 0.02,
    "PyBullet": 0.0142,
    "pymunk, contact": 0.03,
}


def results(unread=(), bounds=BOUNDS):
    """Each jump is off by at most the method's bound; those `unread`, of (label, case, number), by their size."""
    records, rows = [], []
    for label, bound in bounds.items():
        for case in CASES:
            for step in VARIANTS[label].ladder:
                one = record(label, case, step)
                records.append(one)
                for number, jump in enumerate(JUMPS):
                    is_read = (label, case, number) not in unread
                    off = bound * (1 - 0.1 * number) if is_read else abs(jump)
                    rows.append(
                        {
                            **about(one),
                            "event": number,
                            "true_jump": jump,
                            "resolved": is_read,
                            "jump_bound": off,
                            "time_error": 1e-3 if is_read else np.nan,
                        }
                    )
    return Results(tuple(records), {}, {"torque": pd.DataFrame(rows)})


def section(made):
    """The section of the study, all of whose numbers are those of the tables."""
    written = section_of(STUDY, made)
    assert not wrongly_written(written, made)
    return written


def jump_cells(made):
    [headline] = present(made).headlines
    return headline.cells


def test_the_answer_counts_all_jumps_and_the_worst_bound():
    made = results(unread={("pymunk, contact", CASES[0], 0), ("pymunk, contact", CASES[2], 1)})
    written, rows = section(made), present(made).rows
    assert written.answer.count("9/9") == 3 and written.answer.count("7/9") == 1
    assert {"1e-12", "0.00022"} <= {number.text for number in written.numbers}
    assert len(f"Torque jumps: {written.answer}") <= ANSWER_LENGTH
    assert [(one["variant"], one["read"], one["jumps"]) for one in rows["own"]] == [
        ("reference", 9, 9),
        ("paper's scheme", 9, 9),
    ]
    assert [float(one["bound"]) for one in rows["own"]] == [1e-12, 2.2e-4]
    joint, contact = rows["engines"]
    assert joint["fewest"] == joint["most"] == {"read": 9, "jumps": 9}
    assert contact["fewest"] == contact["most"] == {"read": 7, "jumps": 9}
    assert list(map(float, joint["bounds"])) == [0.0142, 0.02]
    assert list(map(float, contact["bounds"])) == [0.03]
    assert abs(float(rows["smallest_jump"])) == 0.0636 and abs(float(rows["largest_jump"])) == 2.5
    assert rows["unresolved"] == [{"variant": "pymunk, contact", "read": 7, "jumps": 9}]
    for part in (
        "0.064 to 2.5 N m",
        "0.015 to 0.02 N m with joints, 0.03 N m with contacts",
        "pymunk, contact 2 of 9",
    ):
        assert part in words(written)


def test_a_bound_is_rounded_up():
    assert jump_cells(results())["PyBullet"] == "9/9, 0.015"


def test_a_jump_that_is_not_read_is_counted_and_has_no_bound():
    """A jump that is not found in a run may be right: its size is no bound of what the engine is off by."""
    kept, lost = results(), results(unread={("pymunk", CASES[1], 2)})
    assert jump_cells(kept)["pymunk"] == "9/9, 0.02"
    assert jump_cells(lost)["pymunk"] == "8/9, 0.02"
    joint, _ = present(lost).rows["engines"]
    assert joint["fewest"] == {"read": 8, "jumps": 9} and joint["most"] == {"read": 9, "jumps": 9}
    assert "8/9 to 9/9" in section(lost).answer
    none = results(unread={("pymunk", case, number) for case in CASES for number in range(3)})
    assert jump_cells(none)["pymunk"] == "0/9" and section(none).answer
    joint, _ = present(none).rows["engines"]
    assert list(map(float, joint["bounds"])) == [0.0142]  # of the other engine with joints


def test_tables_say_it_by_case_and_by_run():
    said = section(results(unread={("pymunk", CASES[1], 2)}))
    assert all(each.caption for each in (*said.tables, *said.figures))
    first, *whole = said.tables
    row = first.frame.set_index("method").loc["pymunk"]
    assert (row["read"], row["jumps"]) == (8, 9)
    assert row[in_scene("read", CASES[0])] == "3/3, 0.02"
    assert row[in_scene("read", CASES[1])] == "2/3, 0.02"
    assert [table.name for table in whole] == [f"torque-{case}" for case in CASES]
    assert not any(table.in_report for table in whole)
    runs = whole[1].frame.set_index(["variant", "step"])
    assert (
        runs.loc[("pymunk", 1e-3), "read"] == 2 and len(runs) == 10 and len(whole[1].rows[0]) == 3
    )


def test_without_bounds_there_is_nothing_to_say():
    table = results().tables["torque"].drop(columns="jump_bound")
    assert present(replace(results(), tables={"torque": table})) == Presentation()


def test_rows_without_a_truth_or_of_an_engine_that_is_not_installed_count_for_nobody():
    made = results()
    table, contact = made.tables["torque"], made.tables["torque"]["fidelity"] == "contact"
    table["resolved"] = table["resolved"].astype(object)
    table.loc[contact, ["resolved", "jump_bound", "true_jump", "event"]] = None
    table.loc[contact, "status"] = "missing"
    assert "pymunk, contact" not in jump_cells(made)
    assert "contact" not in words(section(made))


def true_motion(name, *events):
    """An effort of slope one that jumps by a size at a time, of a kind."""

    def columns(t, side):
        return {EFFORT: t + sum(np.where(t >= time, size, 0.0) for _, time, size in events)}

    made, before = [], 0.0
    for kind, time, size in events:
        made.append(
            Event(time, kind, "guide", {EFFORT: time + before}, {EFFORT: time + before + size})
        )
        before += size
    return Truth(name, Tier.CLOSED_FORM, 10.0, columns, {}, tuple(made))


def windows():
    """A run without events that jumps 3 ms late, and one that locates those of another truth, which come 2 ms later."""
    events = [
        ("reversal", 1.0, 0.5),
        ("reversal", 3.0, -2.0),
        ("stick", 5.0, 0.25),
        ("slip", 7.0, 4.0),
    ]
    truth = true_motion("a", *events)
    other = true_motion("a (mus = mu)", *[(kind, time + 2e-3, size) for kind, time, size in events])
    late = true_motion("late", *[(kind, time + 3e-3, size) for kind, time, size in events])
    t = np.arange(0.0, 10.0, 2e-3)
    runs = {
        "pymunk": Trajectory("a", "pymunk", "1", "joint", t, late(t)),
        "reference": Trajectory("a", "reference", "1", "joint", t, other(t), other.events),
    }
    records = [record(label, "a", 1e-3) for label in runs]
    records = [
        replace(one, outcome=replace(one.outcome, value=run))
        for one, run in zip(records, runs.values())
    ]
    return windows_table(
        records, dict(zip((one.key for one in records), (truth, other))), EFFORT
    ), records


def test_windows_are_around_the_largest_events_as_each_run_has_them():
    found, _ = windows()
    assert list(found.groupby("event")["kind"].first()) == ["reversal", "stick"]
    first = found[found["event"] == 0]
    times = dict(first.groupby("variant")["event_time"].unique().map(sorted))
    assert times == {"pymunk": [3.0], "reference": [3.002], "truth": [3.0, 3.002]}
    assert ((first["t"] - first["event_time"]).abs() <= 0.03 * (1 + 1e-9)).all()
    own = {variant: rows for variant, rows in first[first["truth"] == "a"].groupby("variant")}
    sides = own["truth"].loc[own["truth"]["t"] == 3.0, "effort_value"]
    assert len(sides) == 2 and np.ptp(sides) == pytest.approx(2.0)
    jump = own["pymunk"].loc[own["pymunk"]["effort_value"].diff().abs().idxmax()]
    assert (
        jump["t"] == pytest.approx(3.004) and len(own["pymunk"]) == 31
    )  # every sample, 2 ms apart


def test_the_central_figure_shows_each_method_over_the_time_from_its_own_true_event():
    table, records = windows()
    rows = [
        {
            **about(one),
            "truth": truth,
            COEFFICIENTS: str(coefficients),
            "event": 0,
            "true_jump": -2.0,
            "resolved": True,
            "jump_bound": 0.1,
            "time_error": 0.0,
        }
        for one, truth, coefficients in zip(records, ("a", "a (mus = mu)"), Coefficients)
    ]
    said = present(
        Results(tuple(records), {}, {"torque": pd.DataFrame(rows), "event-windows": table})
    )
    [figure] = [figure for figure in said.figures if figure.name == "torque-events"]
    assert [panel.title for panel in figure.panels] == [
        "a, reversal",
        "a, stick",
    ] * 2 and figure.columns == 2
    for panel in figure.panels:
        run, truth = panel.series
        assert truth.look == "truth" and run.points and not truth.points
        assert truth.x[np.abs(np.diff(truth.y)).argmax() + 1] == pytest.approx(0.0, abs=1e-9)
    assert panel.y.limits[0] < truth.y.min() < truth.y.max() < panel.y.limits[1]


def test_a_scene_without_the_drive_is_refused():
    scene = load_scene("slider-bar-case-1")
    with pytest.raises(InputError, match="drive: found 'none'; expected one of motor"):
        plan(Scope((scene,), options={"drive": "none"}))
    with pytest.raises(InputError, match="no drive"):
        plan(Scope((load_scene("block-on-incline"),)))


def test_the_effort_of_a_drive_of_a_distance_is_a_force():
    """In newtons, in text, tables and figures; no word about a torque is left."""
    made = results()
    table = made.table("torque").assign(effort=EFFORT)
    scenes = {case: load_scene("mass-on-belt") for case in CASES}
    forces = replace(made, tables={"torque": table}, scenes=scenes)
    written = section(forces)
    assert "driving force" in words(written) and "torque" not in words(written)
    heads = [column.head for shown in written.tables for column in shown.columns]
    assert any("[N]" in head for head in heads) and not any("N m" in head for head in heads)
    torques = section(replace(made, tables={"torque": table}))
    assert "driving torque" in words(torques)
