"""Effects and stabilizations as studies: shares of the baseline's time with their intervals, traced to cells."""

import pandas as pd
import pytest

from stiction.comparisons.results import Results
from stiction.comparisons.studies import drift_suppression, effects
from stiction.comparisons.studies.effects import BASELINE, HIGH, LEFT_OUT, LOW, MOTION, PAIRS, RATIO
from stiction.comparisons.variants import OWN_CPU

ROWS = {BASELINE: (1.0, 1.0, 1.0, 5, ""), "no gravity": (1.2, 1.1, 1.3, 5, "gravity"),
        "no friction": (0.5, 0.48, 0.52, 0, "friction, static coefficient"),
        "no load": (0.45, 0.4, 0.5, 5, "forces"), "no spring": (0.98, 0.9, 1.1, 5, "springs"),
        "no stabilization": (0.9, 0.88, 0.92, 5, ""),
        "Baumgarte (alpha = 90, beta = 10)": (22.0, 21.0, 23.5, 5, "")}


def effects_table():
    table = pd.DataFrame([{"variant": "reference", "engine": "reference", "effect": effect, "status": "ok",
                           RATIO: share, LOW: low, HIGH: high, PAIRS: pairs, LEFT_OUT: out,
                           "rhs [-]": 1000 + number, MOTION: 0.5 * number} for number,
                          (effect, (share, low, high, pairs, out)) in enumerate(ROWS.items())])
    return table


def said_of(study, name, table):
    return study.present(Results((), {}, {name: table}))


def test_the_answer_has_what_saves_time_and_what_baumgarte_costs():
    table = effects_table()
    said = said_of(effects.STUDY, "effects", table)
    assert [number.text for number in said.answer.numbers] == ["0.45", "0.5", "22"]
    for number in said.answer.numbers:
        assert float(number.text) == table.loc[number.rows[0] - 1, number.column]
    findings = " ".join(text.text for text in said.findings)
    for part in ("friction, static coefficient", "from 5 to 0 pairs", "0.50 ± 0.02", "1002 instead of 1000", "1.2 ± 0.1 without gravity",
                 "without: spring", "0.90 ± 0.02"):
        assert part in findings


def test_what_cannot_be_distinguished_from_the_baseline_saves_nothing():
    table = effects_table()
    table.loc[table["effect"] == "no friction", [LOW, HIGH]] = 0.4, 1.05
    said = said_of(effects.STUDY, "effects", table)
    assert "friction" not in said.answer.text
    assert any(text.text.endswith("without: friction and spring.") for text in said.findings)


@pytest.mark.parametrize("study, name", [(effects.STUDY, "effects"), (drift_suppression.STUDY, "suppression")])
def test_failures_are_said_and_nothing_else(study, name):
    assert study.present(Results((), {}, {})).is_empty
    lost = pd.DataFrame({"variant": ["reference", "reference"], "engine": "reference", "effect": ["no load", BASELINE],
                         "status": "failed", "reason": "killed"})
    said = said_of(study, name, lost)
    assert not said.answer and not said.tables and len(said.findings) == 1 and "failed" in said.findings[0].text


def test_a_failed_effect_among_others_is_named():
    table = effects_table()
    table.loc[table["effect"] == "no load", ["status", "reason"]] = "failed", "killed"
    table.loc[table["effect"] == "no load", [RATIO, LOW, HIGH, MOTION, "rhs [-]"]] = None
    said = said_of(effects.STUDY, "effects", table)
    assert "load" not in said.answer.text and "no load" in said.findings[-1].text
    assert not any("nan" in cell for view in said.tables for row in view.cells() for cell in row)


def suppression_table():
    rows = []
    for parameter, step in (("rtol", 1e-6), ("rtol", 1e-9), ("dt", 1e-2)):
        for choice, cpu, drift in (("none", 1.0, 2e-11), ("baumgarte", 20.0, 3e-12), ("projection", 1.1, 4e-15)):
            rows.append({"variant": f"way, {choice}", "suppression": choice, "parameter": parameter, "step": step,
                         "status": "ok", "reason": "", OWN_CPU: cpu * step,
                         drift_suppression.LOW: 0.9 * cpu * step, drift_suppression.HIGH: 1.1 * cpu * step,
                         "position drift, max [m]": drift, "velocity drift, max [m/s]": drift})
    return pd.DataFrame(rows)


def test_stabilizations_are_compared_at_the_tightest_tolerance():
    table = suppression_table()
    said = said_of(drift_suppression.STUDY, "suppression", table)
    low, high = 20 * 0.9 / (1.1 * 1.1), 20 * 1.1 / (1.1 * 0.9)
    assert [number.text for number in said.answer.numbers] == [f"18 ({low:.2g} to {high:.2g})", "3e-12", "0"]
    time, *drifts = said.answer.numbers
    assert [table.loc[row - 1, "suppression"] for row in time.rows] == ["baumgarte",
                            "projection"] and {table.loc[row - 1, "step"] for row in time.rows} == {1e-9}
    assert [table.loc[number.rows[0] - 1, "suppression"] for number in drifts] == ["baumgarte", "projection"]
    assert ["2e-11", "3e-12", "0"] in [[number.text for number in text.numbers] for text in said.findings]
    without = table[(table["suppression"] != "baumgarte")]
    assert not said_of(drift_suppression.STUDY, "suppression", without.reset_index(drop=True)).answer
