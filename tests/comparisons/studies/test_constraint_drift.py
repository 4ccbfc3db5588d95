"""Drift as a study: sentences whose numbers are cells, over all cases, and what is said where runs are missing."""

import numpy as np
import pandas as pd
import pytest

from stiction.comparisons.campaigns.participants import validation_campaign
from stiction.comparisons.depth import Depth
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED
from stiction.comparisons.results import Results
from stiction.comparisons.studies.constraint_drift import CHOICES, NONE, PAPERS, POSITION, STEPS, STUDY, VELOCITY, drift_study_comparison
from stiction.comparisons.studies.study import Scope, studies
from stiction.comparisons.variants import Record, Variant
from stiction.engines.isolation import Outcome

SCENES = ("slider-bar-case-1", "slider-bar-case-3")
SIZES = {("still", "joint"): ((3e-16, 2e-15), (1e-5, 4e-5)), ("slow", "joint"): ((2e-11, 7e-11), (1e-16, 2e-16)),
         ("touching", "contact"): ((1e-4, 3e-3), (2e-2, 1e-2))}
"""By method and fidelity position (m) and velocity drift (m/s) in both scenes."""


class Run:
    """A trajectory, as far as a presentation looks at it."""

    def __init__(self, label, size):
        self.settings, self.t = {"method": label}, np.linspace(0.0, 24.0, 241)
        self._columns = {"drift.position": np.full(241, size), "drift.velocity": np.zeros(241)}

    def __contains__(self, name):
        return name in self._columns

    def __getitem__(self, name):
        return self._columns[name]


def made_up(status="ok"):
    rows, records = [], []
    for (label, fidelity), (positions, velocities) in SIZES.items():
        variant = Variant(label, label, "dt", (1e-2, 1e-3), fidelity)
        for scene, position, velocity in zip(SCENES, positions, velocities):
            for step, factor in ((1e-2, 50.0), (1e-3, 1.0)):
                key = f"{scene}/{label}/dt={step:g}"
                failed = status != "ok" and label == "slow" and scene == SCENES[0]
                records.append(Record(key, scene, variant, step,
                                      Outcome(key, status if failed else "ok", None if failed
                                              else Run(label, position))))
                row = {"scene": scene, "variant": label, "engine": label, "fidelity": fidelity, "parameter": "dt",
                       "step": step, "status": status if failed else "ok", "reason": "", "key": key}
                rows.append(row if failed else {**row, POSITION: factor * position, VELOCITY: factor * velocity,
                                                "position drift, end [m]": position,
                                                "velocity drift, end [m/s]": velocity,
                                                "growth": GROWS if label == "slow" else INCONCLUSIVE,
                                                "exponent of growth [-]": 0.8, "interval of the exponent [-]": 0.5})
    return Results(tuple(records), {}, {"drift": pd.DataFrame(rows)})


def long_runs():
    """Without stabilization all runs grow; with the paper's terms three of four are bounded and one stops early; what they do to the motion of case 3."""
    rows, octaves = [], []
    for scene, worse in zip(SCENES, (1.0, 40.0)):
        for choice, power in ((NONE, 1.5), (PAPERS, 0.0), (CHOICES[-1], 0.0)):
            for number, step in enumerate(STEPS):
                drift = {NONE.label: 1e-11, PAPERS.label: 1e-6 * step, "projection": 1e-15}[choice.label]
                early = choice == PAPERS and number == 3
                rows.append({"scene": scene, "choice": choice.label, "run": f"{scene}/{choice.label}/{step}",
                             "step": step, "time [s]": 240.0, "status": "ok",
                             "reason": "modes follow each other" if early else "",
                             "position drift to 24 s, max [m]": drift, POSITION: 10 * drift, VELOCITY: drift,
                             "growth, 240 s": None if early else GROWS if power else ROUNDED if choice == CHOICES[-1]
                             else BOUNDED,
                             "exponent of growth, 240 s [-]": power + 0.1 * number,
                             "interval of the exponent, 240 s [-]": 0.2,
                             "position error [m]": 1e-5 * (worse if choice == PAPERS else 1.0),
                             "position uncertainty [m]": 1e-12,
                             "error, of that without [-]": None if choice == NONE else worse if choice == PAPERS
                             else 1.0,
                             "drift, of that without [-]": None if choice == NONE else drift / 1e-11})
                octaves += [] if early else [{"scene": scene, "choice": choice.label, "step": step, "to [s]": end,
                                              "position drift, rms [m]": drift} for end in (60.0, 120.0, 240.0)]
    return {"study": pd.DataFrame(rows), "octaves": pd.DataFrame(octaves)}


def holds(text, results):
    """Each number of a sentence is the cell or the count that it names."""
    for number in text.numbers:
        table = results.tables[number.table]
        if number.how == "count":
            rows = table
            for column, wanted in number.where.items():
                rows = rows[rows[column].isin(wanted if isinstance(wanted, frozenset) else [wanted])]
            assert number.text == str(len(rows))
            continue
        cell = number.factor * table.loc[number.rows[0] - 1, number.column]
        said = float(number.text.split(" ")[0])
        assert said == 0 and cell < 1e-13 or said == pytest.approx(cell, rel=0.05)


def test_drift_is_the_largest_of_all_cases_at_equal_step():
    results = made_up()
    said = STUDY.present(results)
    assert said.answer.text == "Methods drift by at most 7e-11 m (slow) and 4e-05 m/s (still) at joints, 0.003 m and 0.02 m/s at contacts (touching)."
    position, velocity = ({method: text.text for method, text in headline.cells.items()} for headline in said.headlines)
    assert position == {"still": "0", "slow": "7e-11", "touching": "0.003"}  # 2e-15 m is rounding
    assert velocity == {"still": "4e-05", "slow": "0", "touching": "0.02"}
    for text in (said.answer, *said.findings, *(cell for headline in said.headlines
                                                for cell in headline.cells.values())):
        holds(text, results)
    findings = " ".join(text.text for text in said.findings)
    assert "still drifts by 0 m and 4e-05 m/s, slow by 7e-11 m and 0 m/s" in findings
    assert "Drift clearly grows in 2 of 6 runs (slow; up to 7e-11 m)" in findings and "0.003 m (touching, case 3), goes with the power 0.8 ± 0.5 of time: inconclusive" in findings


def test_the_order_of_methods_is_not_said_to_differ_where_one_is_best_in_both():
    results = made_up()
    table = results.tables["drift"]
    table.loc[table["variant"] == "still", VELOCITY] = 1e-17
    assert not any("rank methods differently" in text.text for text in STUDY.present(results).findings)


def test_a_failed_run_is_counted_and_an_engine_that_is_not_installed_is_absent():
    said = STUDY.present(made_up("failed"))
    assert any(text.text == "Runs that failed and have no drift: slow in 1 of 2." for text in said.findings)
    [shown] = [view for view in said.tables if view.name == "drift"]
    assert "1 of 2" in [cell for row in shown.cells(brief=True) for cell in row]
    results = made_up()
    missing = Record("a/none/dt=1", "a", Variant("none", "none", "dt", (1e-3,)), 1e-3,
                     Outcome("a", "missing", None, "not installed"))
    lost = pd.DataFrame([{**results.tables["drift"].iloc[0][["scene", "fidelity", "parameter"]], "variant": "none",
                          "engine": "none", "step": 1e-3, "status": "missing", "key": missing.key}])
    with_missing = Results((*results.records, missing), {},
                           {"drift": pd.concat([results.tables["drift"], lost], ignore_index=True)})
    assert [text.text for text in STUDY.present(with_missing).findings] == [text.text
                            for text in STUDY.present(results).findings]


@pytest.mark.parametrize("tables", [{}, {"drift": pd.DataFrame()},
                                    {"drift": pd.DataFrame({"variant": ["a"], "status": ["failed"]})},
                                    {"study": pd.DataFrame({"scene": ["a"], "choice": ["none"], "step": [1e-3],
                                                            "status": ["failed"], "reason": ["killed"]}),
                                     "octaves": pd.DataFrame()}])
def test_without_drift_nothing_is_said(tables):
    said = STUDY.present(Results((), {}, tables))
    assert said.is_empty and not said.headlines


def test_all_long_runs_are_counted():
    results = Results((), {}, long_runs())
    said = STUDY.present(results)
    findings = " ".join(text.text for text in said.findings)
    assert "without stabilization, drift is growing in 8 of 8 runs of 240 s. Cases and steps: case 1 and case 3, 1 to 10 ms." in findings
    assert "Powers of time are 1.5 to 1.8; the largest drift is 1e-10 m." in findings
    assert "With the paper's Baumgarte terms, drift is bounded in 6 and unknown (stopped early) in 2 of 8 runs" in findings
    assert "With projection, drift is rounding in 8 of 8 runs" in findings
    assert "In case 1 at a step of 10 ms, drift in 24 s is 1e-11 m without stabilization and 1e-08 m with the paper's terms." in findings
    assert "In case 3 at 1 ms they raise the position error from 1e-05 to 0.0004 m." in findings
    for text in said.findings:
        holds(text, results)


def test_what_is_said_follows_the_data():
    tables = long_runs()
    tables["study"].loc[0, "growth, 240 s"] = BOUNDED
    tables["study"]["error, of that without [-]"] = 1.5
    findings = " ".join(text.text for text in STUDY.present(Results((), {}, tables)).findings)
    assert "drift is growing in 7 and bounded in 1 of 8 runs" in findings and "raise the position error" not in findings


def test_figures_show_long_runs_and_a_column_a_case():
    results = made_up()
    [fig14, *others, engines] = STUDY.present(Results(results.records, {}, {**results.tables, **long_runs()})).figures
    assert fig14.name == "fig14-drift" and len(others) == 1 and len(fig14.panels) == 2
    assert {series.hollow for series in fig14.panels[0].series} == {True, False}
    assert engines.columns == len(SCENES) and len(engines.panels) == 2 * len(SCENES)
    for panel, scene in zip(engines.panels, range(len(SCENES))):
        assert {series.label for series in panel.series} == {"", *(label for label, _ in SIZES)}
        for (label, _), (positions, _) in SIZES.items():
            [series] = [one for one in panel.series if one.label == label]
            assert np.all(series.y == max(positions[scene], 1e-17))


def test_the_plan_has_the_long_runs_for_the_papers_cases_alone():
    scenes = tuple(validation_campaign().scenes)
    assert STUDY in studies()
    engines, both = (STUDY.plan(Scope(some, Depth.QUICK, ())) for some in (scenes[:1], scenes))
    long = drift_study_comparison(dict(enumerate(scenes, 1)), Depth.QUICK)
    assert len(both.tasks) == len(long.tasks) + len(scenes) * len(engines.tasks) and engines.tasks
    failed = [Outcome(task.label, "failed", None, "made up") for task in both.tasks]
    tables = both.tabulate(failed)
    assert set(tables.tables) == {"drift", "study", "octaves"} and len(tables.tables["study"]) == len(long.tasks)
    assert len(tables.records) == len(tables.tables["drift"]) == len(scenes) * len(engines.tasks)
    said = STUDY.present(Results(tables.records, {}, tables.tables))
    assert not said.answer and not said.headlines
