"""The accuracy study says what its table says, over all cases, and ranks no method that failed in one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up_runs import CASES, VARIANTS, about, record, words, wrongly_written

from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.studies.accuracy import STUDY, in_scene, largest_differences, present
from stiction.reports.text import section_of
from stiction.scenes import Event, Trajectory, load_scene
from stiction.truths import Tier, Truth

ERRORS = {
    "reference": (1e-12, 2e-12, 3e-12),
    "paper's scheme": (2e-4, 1e-4, 1e-6),
    "pymunk": (1e-3, 2e-3, 4.5e-3),
    "PyBullet": (9e-4, 1e-3, 9.4e-3),
    "pymunk, contact": (1e-3, 2e-3, 2.9e-3),
}


THIRD = load_scene(CASES[2]).title


def true_columns(t, side):
    return {"slider.x": t, "slider.y": 0 * t, "motor.effort": t + 1e-3}


def results(errors=ERRORS, lost=(), status="failed", reason="why"):
    """Runs at two steps, the coarse with ten times the error; those `lost`, of (label, case), at the fine one."""
    records, rows = [], []
    for label, sizes in errors.items():
        for case, size in zip(CASES, sizes):
            for step, factor in zip(VARIANTS[label].ladder, (10.0, 1.0)):
                is_lost = (label, case) in lost and factor == 1
                one = record(label, case, step, *((status, reason) if is_lost else ()))
                found = (
                    {}
                    if is_lost
                    else {"position_error": factor * size, "position_uncertainty": 1e-14}
                )
                records.append(one)
                rows.append({**about(one), **found})
    truths = {case: Truth(case, Tier.CLOSED_FORM, 0.01, true_columns, {}) for case in CASES}
    return Results(tuple(records), truths, {"accuracy": pd.DataFrame(rows)})


def test_the_answer_is_the_worst_case_of_each():
    made = results()
    section = section_of(STUDY, made)
    assert [number.text for number in section.numbers] == ["3e-12", "0.2", "4.5", "9.4", "2.9"]
    assert len(section.answer) <= ANSWER_LENGTH and not wrongly_written(section, made)
    rows = present(made).rows
    assert {one["variant"]: float(one["error"]) for one in rows["own"]} == {
        label: max(ERRORS[label]) for label in ("reference", "paper's scheme")
    }
    joint, contact = rows["engines"]
    assert (joint["fidelity"], joint["number"]) == ("joint", 2)
    assert (float(joint["smallest"]), float(joint["largest"])) == (4.5e-3, 9.4e-3)
    assert (contact["fidelity"], contact["number"]) == ("contact", 1)
    assert float(contact["largest"]) == 2.9e-3 and not rows["failed"]
    assert position_cells(made) == {label: f"{max(sizes):.2g}" for label, sizes in ERRORS.items()}


def position_cells(made):
    [headline] = present(made).headlines
    return headline.cells


def closest(made):
    [table] = [table for table in present(made).tables if table.name == "accuracy-closest"]
    # A single engine with contacts is compared with none. Pages and prints have no rows of groups.
    assert [row[0] for row in table.cells()] == ["joint, mus > mu"]
    return table.cells(brief=True)


def test_the_closest_is_closest_in_its_worst_case():
    """PyBullet is closer in two cases of three; in the third it is twice as far off."""
    assert closest(results()) == [
        ["pymunk", "2", "adapter", "nobody", "0.0045", THIRD],
    ]
    better = results({**ERRORS, "PyBullet": (9e-4, 1e-3, 4.4e-3)})
    assert closest(better)[0] == ["PyBullet", "2", "adapter", "nobody", "0.0044", THIRD]


def test_indistinguishable_errors_are_not_ranked():
    made = results({**ERRORS, "PyBullet": (9e-4, 1e-3, 4.5e-3)})
    assert closest(made)[0][:2] == ["pymunk; PyBullet", "2"]


@pytest.mark.parametrize(
    "status, reason",
    [("failed", "why"), ("crashed", "signal 11"), ("refused", "cannot"), ("ok", "step too small")],
)
def test_failing_in_the_worst_case_does_not_improve_a_method(status, reason):
    """Without case 3 pymunk would be at 2 mm; an early end counts, too."""
    made = results(lost={("pymunk", CASES[2])}, status=status, reason=reason)
    word = "declined" if status == "refused" else "failed"
    assert position_cells(made)["pymunk"] == f"0.002, 1 of 3 {word}"
    presented, section = present(made), section_of(STUDY, made)
    assert presented.rows["failed"] == [{"variant": "pymunk", "failed": 1, "runs": 3}]
    assert "pymunk in 1 of 3" in words(section) and not wrongly_written(section, made)
    # A single engine is left, which is compared with none.
    assert not [table for table in presented.tables if table.name == "accuracy-closest"]
    row = presented.tables[0].frame.set_index("method").loc["pymunk"]
    assert row["failed"] == f"{THIRD}: {reason}"
    assert np.isnan(row[in_scene("position_error", CASES[2])])
    assert row[in_scene("position_error", CASES[1])] == 2e-3


def test_where_every_run_failed_it_says_so():
    everything = {(label, case) for label in ERRORS for case in CASES}
    made = results(lost=everything)
    no_errors = made.tables["accuracy"].drop(columns=["position_error", "position_uncertainty"])
    made = replace(made, tables={"accuracy": no_errors})
    section = section_of(STUDY, made)
    assert section.answer and not section.numbers
    assert position_cells(made)["reference"] == "3 of 3 failed"
    assert len(present(made).rows["failed"]) == len(ERRORS)
    assert "nan" not in words(section) + str([table.cells() for table in section.tables])


def test_tables_and_figures_have_every_run_where_it_belongs():
    said = section_of(STUDY, results())
    assert all(each.caption for each in (*said.tables, *said.figures))
    whole = {table.name: table for table in said.tables}
    assert list(whole) == ["accuracy", "accuracy-closest", *(f"accuracy-{case}" for case in CASES)]
    assert [table.in_report for table in said.tables] == [True, True, False, False, False]
    assert whole["accuracy"].frame["group"].tolist() == ["joint, mus > mu"] * 4 + [
        "contact, mus > mu"
    ]
    assert whole[f"accuracy-{CASES[1]}"].rows[0] == (3,)  # the first run of the second case
    figures = {figure.name: figure for figure in said.figures}
    assert figures["accuracy"].caption != whole["accuracy"].caption
    assert list(figures) == ["accuracy", "difference-position", "difference-torque"]
    assert all(figure.columns == 3 for figure in said.figures)
    first = figures["accuracy"].panels[0]
    [line] = [series for series in first.series if series.label == "pymunk"]
    assert list(line.x) == [1e-3, 1e-2] and list(line.y) == [1e-3, 1e-2]  # at the steps themselves
    assert len(figures["difference-torque"].panels) == 6


def test_events_are_counted_of_the_kinds_that_a_method_reports():
    """Two reversals and three corners a case; the reference finds all, the scheme no corner, pymunk one of two reversals."""
    made = results()
    table = made.tables["accuracy"]
    for label, (matched, reversals, corners) in {
        "reference": (5, 0, 0),
        "paper's scheme": (2, 0, 3),
        "pymunk": (1, 1, 3),
    }.items():
        table.loc[
            table["variant"] == label,
            [
                "events_matched",
                "events_missed",
                "events_spurious",
                "reversal_events_missed",
                "corner_events_missed",
            ],
        ] = [matched, reversals + corners, 0, reversals, corners]
    events = tuple(
        Event(0.001 * number, kind, "guide", {}, {})
        for number, kind in enumerate(["reversal"] * 2 + ["corner"] * 3)
    )
    made = replace(
        made, truths={name: replace(truth, events=events) for name, truth in made.truths.items()}
    )
    shown = present(made).tables[0].frame.set_index("method")["events"]
    assert list(shown[["reference", "paper's scheme", "pymunk"]]) == [
        "15/0/0",
        "6/0/0; no corner",
        "3/3/0; no corner",
    ]


def test_differences_are_taken_where_the_truth_is_stored():
    t = np.linspace(0.0, 24.0, 2401)
    truth = Truth(
        "made-up",
        Tier.CLOSED_FORM,
        24.0,
        lambda t, side: {"slider.x": np.sin(t), "slider.y": 0 * t},
        {},
    )
    off = np.where(np.arange(len(t)) % 20 == 7, 3e-3, 1e-3)
    run = Trajectory(
        "made-up", "made-up", "1", "joint", t, {"slider.x": np.sin(t) + off, "slider.y": -0.5 * off}
    )
    at, size = largest_differences(run, truth, (".x", ".y"))
    assert len(at) == 120 and size == pytest.approx(3e-3, rel=1e-9) and np.allclose(at % 0.2, 0.07)
