"""A small validation, with runs that came out and runs lost in every way, for the tests of the reports."""

from __future__ import annotations

import pandas as pd

from comparisons.accuracy import accuracy_table, size_of
from comparisons.drift import drift_table
from comparisons.torque import torque_table
from comparisons.validation import Validation
from comparisons.variants import Record, Variant, run_key
from engines.isolation import Outcome
from scenes import load_scene

CASE, T_END = "slider-bar-case-1", 9.0  # one period and a bit: holds a whole stick phase
LOST = {"failed": "Newton did not converge at t = 1.25 s | really", "crashed": "SIGSEGV: free(): invalid pointer",
        "missing": "pymunk: No module named 'pymunk'", "timed out": "no result within 60 s",
        "refused": "has no contact fidelity"}


def record(variant: Variant, step: float, status: str = "ok", reason: str = "", value=None) -> Record:
    key = run_key(load_scene(CASE), variant, step)
    return Record(key, CASE, variant, step, Outcome(key, status, value, reason))


def validation_of(records: list[Record], truths: dict) -> Validation:
    truth_for = {record.key: truths[CASE] for record in records}
    came_out = [record.describe() for record in records if record.trajectory is not None]
    threshold = pd.DataFrame([{**{name: row[name] for name in row if name not in ("cpu [s]", "version")},
                               "F0 with stick [N]": 4.2119563, "F0 without stick [N]": 4.2119564, "mus": 0.04,
                               "truth [N]": 4.21195632, "error [N]": 3e-8, "paper [N]": None} for row in came_out])
    claims = pd.DataFrame([
        {"case": "1", "claim": "the motion is periodic", "verdict": "holds", "figure behind it": "period 8 s", "source": "Sect. 5"},
        {"case": "1-3", "claim": "there is no stick phase", "verdict": "does not hold", "figure behind it": 0.6, "source": "made up"}])
    return Validation(tuple(records), truths, {
        "accuracy": accuracy_table(records, truth_for, {CASE: size_of(load_scene(CASE))}), "drift": drift_table(records), "threshold": threshold,
        "torque": torque_table(records, truth_for), "claims": claims}, {"engines": ["a", "b"]}, 12.5, 20.25)
