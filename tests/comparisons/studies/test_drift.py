"""Drift as a study: sentences whose numbers are cells, over all cases, and failures where runs are missing."""

import numpy as np
import pandas as pd
import pytest
from made_up_runs import words, wrongly_written

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import validation_campaign
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.variants import Record, Variant
from stiction.comparisons.measures.drift import ROUNDING
from stiction.comparisons.measures.drift_growth import BOUNDED, DECAYS, GROWS, INCONCLUSIVE
from stiction.comparisons.studies.drift import JOINT_COORDINATES, POSITION, STUDY, VELOCITY
from stiction.engines.isolation import Outcome
from stiction.reports.text import section_of
from stiction.scenes import Trajectory

SHORT_NAMES = ("still", "slow", "touching")
SCENES = ("slider-bar-case-1", "slider-bar-case-3")
SIZES = {
    ("still", "joint"): ((3e-16, 2e-15), (1e-5, 4e-5)),
    ("slow", "joint"): ((2e-11, 7e-11), (1e-16, 2e-16)),
    ("touching", "contact"): ((1e-4, 3e-3), (2e-2, 1e-2)),
}
"""By method and fidelity position (m) and velocity drift (m/s) in both scenes."""


def run(label, scene, fidelity, size):
    t = np.linspace(0.0, 24.0, 241)
    columns = {"drift.position": np.full(241, size), "drift.velocity": np.zeros(241)}
    return Trajectory(scene, label, "1", fidelity, t, columns, settings={"method": label})


def made_up(status="ok"):
    """Runs of each method in both scenes, 50 times as far off at 10 ms; `status`: of `slow` in the first scene."""
    rows, records = [], []
    for (label, fidelity), (positions, velocities) in SIZES.items():
        variant = Variant(label, label, "dt", (1e-2, 1e-3), fidelity)
        for scene, position, velocity in zip(SCENES, positions, velocities):
            for step, factor in ((1e-2, 50.0), (1e-3, 1.0)):
                key, law = (
                    f"{scene}/{label}/dt={step:g}",
                    GROWS if label == "slow" else INCONCLUSIVE,
                )
                found = status if label == "slow" and scene == SCENES[0] else "ok"
                value = run(label, scene, fidelity, position) if found == "ok" else None
                records.append(Record(key, scene, variant, step, Outcome(key, found, value)))
                row = {
                    "scene": scene,
                    "variant": label,
                    "engine": label,
                    "fidelity": fidelity,
                    "parameter": "dt",
                    "step": step,
                    "status": found,
                    "reason": "",
                    "key": key,
                    JOINT_COORDINATES: label == "still",
                }
                rows.append(
                    row
                    if value is None
                    else row
                    | {
                        POSITION: factor * position,
                        VELOCITY: factor * velocity,
                        "position_drift_end": position,
                        "velocity_drift_end": velocity,
                        "growth": law,
                        "growth_exponent": 0.8,
                        "growth_exponent_uncertainty": 0.5,
                    }
                )
    return Results(tuple(records), {}, {"drift": pd.DataFrame(rows)})


def test_drift_is_the_largest_of_all_cases_at_equal_step():
    results = made_up()
    said = section_of(STUDY, results)
    joint, contact = STUDY.presented(results).rows["largest"]
    assert (joint["fidelity"], contact["fidelity"]) == ("joint", "contact")
    assert float(joint["position"]) == 7e-11 and float(joint["velocity"]) == 4e-5
    assert float(contact["position"]) == 3e-3 and float(contact["velocity"]) == 2e-2
    position, velocity = (headline.cells for headline in said.headlines)
    assert position == {"still": "0", "slow": "7e-11", "touching": "0.003"}  # 2e-15 m is rounding
    assert velocity == {"still": "4e-05", "slow": "0", "touching": "0.02"}
    assert all(
        number.text == "0"
        and results.tables["drift"][number.cell.quantity.key].iloc[number.cell.row - 1] < ROUNDING
        for number in wrongly_written(said, results)
    )
    rows = STUDY.presented(results).rows
    assert (rows["grows"], rows["runs"], rows["growing"]) == (2, 6, ["slow"])
    assert float(rows["largest_growing"]) == 7e-11 and not joint["bounded"]
    assert list(said.tables[0].frame["growth"])[-1] == "inconclusive, t^(0.8 ± 0.5)"


def test_methods_that_are_as_far_off_are_all_named_and_an_offset_is_no_growth():
    """A velocity that is printed alike is that of both; zero is largest in no case."""
    results = made_up()
    table = results.tables["drift"]
    table.loc[table["variant"] == "slow", "growth"] = BOUNDED
    alike = (table["variant"] == "slow") & (table["scene"] == SCENES[1])
    table.loc[alike, VELOCITY] = 4.01e-5
    said = STUDY.presented(results)
    joint, contact = said.rows["largest"]
    assert joint["positions_of"] == ["slow"] and joint["bounded"]
    assert sorted(joint["velocities_of"]) == ["slow", "still"]
    assert contact["positions_of"] == contact["velocities_of"] == ["touching"]
    section = section_of(STUDY, results)
    named = " ".join((section.answer, *section.findings))
    assert all(name in named for name in SHORT_NAMES)
    cells = {row[0]: row for row in said.tables[0].cells(brief=True)}
    assert cells["still"][2:6] == ["0", "–", "4e-05", "Slider-bar, case 3"]


def test_drift_that_decays_is_not_called_inconclusive():
    results = made_up()
    table = results.tables["drift"]
    table["growth"] = DECAYS
    rows = STUDY.presented(results).rows
    assert (rows["decays"], rows["inconclusive"], rows["runs"]) == (6, 0, 6)
    [_, _, growth] = section_of(STUDY, results).findings
    assert "decays in 6" in growth and "inconclusive" not in growth and "short" not in growth


def test_a_failed_run_is_counted_and_an_engine_that_is_not_installed_is_absent():
    said = STUDY.presented(made_up("failed"))
    assert said.rows["failed"] == [{"variant": "slow", "failed": 1, "runs": 2}]
    assert "1 of 2" in [cell for row in said.tables[0].cells(brief=True) for cell in row]
    results = made_up()
    missing = Record(
        "a/none/dt=1",
        "a",
        Variant("none", "none", "dt", (1e-3,)),
        1e-3,
        Outcome("a", "missing", None, "not installed"),
    )
    lost = pd.DataFrame(
        [
            {
                **results.tables["drift"].iloc[0][
                    ["scene", "fidelity", "parameter", JOINT_COORDINATES]
                ],
                "variant": "none",
                "engine": "none",
                "step": 1e-3,
                "status": "missing",
                "key": missing.key,
            }
        ]
    )
    both = pd.concat([results.tables["drift"], lost], ignore_index=True)
    with_missing = section_of(STUDY, Results((*results.records, missing), {}, {"drift": both}))
    assert words(with_missing) == words(section_of(STUDY, results))


def test_the_figure_has_a_column_a_case():
    [figure] = STUDY.presented(made_up()).figures
    assert figure.columns == len(SCENES) and len(figure.panels) == 4 * len(
        SCENES
    )  # joints and contacts apart
    for place, panel in enumerate(figure.panels[: 2 * len(SCENES)]):
        fidelity, scene = ("joint", "contact")[place // len(SCENES)], place % len(SCENES)
        there = {
            label: positions for (label, one), (positions, _) in SIZES.items() if one == fidelity
        }
        assert {series.label for series in panel.series} == {"", *there}
        for label, positions in there.items():
            [series] = [one for one in panel.series if one.label == label]
            assert np.all(series.y == max(positions[scene], 1e-17))


def test_runs_that_failed_are_rows_and_nothing_is_said_of_their_drift():
    pytest.importorskip("pydrake")
    comparison = STUDY.plan(Scope(tuple(validation_campaign().scenes), Depth.QUICK, ("drake",)))
    made = comparison.tabulate(
        [Outcome(task.label, "failed", None, "made up") for task in comparison.tasks]
    )
    table = made.tables["drift"]
    assert len(made.records) == len(table) == len(comparison.tasks)
    assert (table[JOINT_COORDINATES] == (table["engine"] == "drake")).all()
    said = section_of(STUDY, Results(made.records, {}, made.tables))
    assert not said.answer and not said.headlines
