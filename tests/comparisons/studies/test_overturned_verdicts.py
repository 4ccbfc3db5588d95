"""Settings that overturn a verdict of a default on a hard case, in both directions, as the engines' pages say."""

from __future__ import annotations

import pytest

from stiction.comparisons.hard import hard_cases
from stiction.comparisons.hard.examination import DEGRADED, RIGHT, WRONG, examine, judge
from stiction.comparisons.studies.engine_settings import load_study
from stiction.comparisons.variants import Variant
from stiction.engines import Outcome, load_engine

MILLISECONDS, UNSTABLE = "load above static friction for 2 ms", "Baumgarte unstable for the step"
BELOW, WIDE = "static friction below kinetic", "slider wider than long by 1/mus"


@pytest.mark.parametrize(("engine", "setting", "value", "name", "default", "overturned"), [
    ("mujoco", "impedance", 0.8, UNSTABLE, DEGRADED, RIGHT),
    pytest.param("mujoco", "impedance", 0.8, BELOW, DEGRADED, WRONG, marks=pytest.mark.long),
    pytest.param("drake", "near_rigid", 1.0, MILLISECONDS, WRONG, DEGRADED, marks=pytest.mark.long),
    pytest.param("drake", "near_rigid", 1.0, WIDE, DEGRADED, WRONG, marks=pytest.mark.long),
    pytest.param("drake", "dissipation", 100.0, BELOW, DEGRADED, WRONG, marks=pytest.mark.long)])
def test_a_setting_overturns_the_verdict_of_the_default(engine, setting, value, name, default, overturned):
    pytest.importorskip({"drake": "pydrake"}.get(engine, engine))
    assert load_engine(engine).default_settings("contact")[setting] != value
    case = next(case for case in hard_cases() if case.name == name)
    for settings, word in (({}, default), ({setting: value}, overturned)):
        variant = Variant("tried", engine, "dt", (case.dt,), "contact", settings)
        assert judge(case, variant, Outcome("tried", "ok", examine(name, variant))).word == word
    subjects = {(subject.engine, subject.fidelity): subject for subject in load_study().subjects}
    assert value in subjects[engine, "contact"].choices[setting]
