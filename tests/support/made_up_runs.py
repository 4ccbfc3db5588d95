"""Runs that were never made, for presentations: records with a trajectory of two instants, and their table columns."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    EVENTS_BY,
    FRICTION_BY,
    Coefficients,
    Record,
    Variant,
)
from stiction.engines import Outcome
from stiction.reports.text import Number, Section
from stiction.scenes import Trajectory

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
VARIANTS = {
    "reference": Variant("reference", "reference", "rtol", (1e-9, 1e-12)),
    "paper's scheme": Variant("paper's scheme", "reference", "dt", (1e-2, 1e-3)),
    "pymunk": Variant("pymunk", "pymunk", "dt", (1e-2, 1e-3)),
    "PyBullet": Variant("PyBullet", "pybullet", "dt", (1e-2, 1e-3)),
    "pymunk, contact": Variant("pymunk, contact", "pymunk", "dt", (1e-2, 1e-3), "contact"),
}


def record(label: str, case: str, step: float, status: str = "ok", reason: str = "") -> Record:
    variant, key = VARIANTS[label], f"{case}/{label}/{step:g}"
    t = np.array([0.0, 0.01])
    columns = {"slider.x": t + step, "slider.y": 0 * t, "motor.effort": t}
    run = Trajectory(
        case,
        variant.engine,
        "1",
        variant.fidelity,
        t,
        columns,
        settings={"method": label},
        termination=reason or "end",
    )
    outcome = Outcome(key, status, run) if status == "ok" else Outcome(key, status, None, reason)
    return Record(key, case, variant, step, outcome)


def about(one: Record) -> dict[str, object]:
    """The columns that every table begins with; the reference alone has its own friction law, and locates events."""
    own = one.variant.engine == "reference"
    suppliers = {
        FRICTION_BY: "engine" if own else "adapter",
        EVENTS_BY: "engine" if own else "nobody",
    }
    return {
        **one.describe(),
        COEFFICIENTS: str(Coefficients.BOTH),
        **(suppliers if one.trajectory is not None else {}),
        "truth": one.scene,
    }


def shows(text: str, true: float) -> bool:
    """Whether a number rounded as in the text may be this one, by its size: 980 stands for 975 to 985."""
    digits = re.fullmatch(r"-?(\d+)(?:\.(\d+))?(?:e([+-]?\d+))?", text)
    unit = 10.0 ** (int(digits[3] or 0) - len(digits[2] or ""))
    significant = len((digits[1] + (digits[2] or "")).strip("0")) or 1
    if float(text):
        unit = max(unit, 10.0 ** (np.floor(np.log10(abs(float(text)))) + 1 - significant))
    return abs(abs(float(text)) - abs(true)) <= 0.500001 * unit


def is_cell(number: Number, data: dict[str, pd.DataFrame]) -> bool:
    """Whether the data have what a template wrote; nothing here is shared with the code that writes it."""
    cell = number.cell
    true = number.factor * data[cell.table][cell.quantity.key].iloc[cell.row - 1]
    text = number.text
    [first, *_] = re.findall(NUMBER, text)
    if text.startswith("< "):
        unsure = data[cell.table][cell.quantity.uncertainty].iloc[cell.row - 1]
        return abs(true) <= number.factor * unsure <= float(first)
    if text[0] in "≤>≥":  # a bound stays one
        low, high = (1.0, 1.11) if text[0] == "≤" else (0.9, 1.0)
        return low - 1e-9 <= float(first) / true <= high + 1e-9
    if "bound" in cell.quantity.key:  # rounded up
        return true * (1 - 1e-12) <= float(first) <= 1.11 * true
    if " (" in text:  # a value with its interval in brackets
        return shows(first, true)
    if len(ends := re.findall(NUMBER, text)) == 2 and "±" not in text:  # an interval
        return float(ends[0]) <= true <= float(ends[1])
    return shows(first, true)


def wrongly_written(section: Section, results: Results) -> list[Number]:
    """Numbers of a section's text that their cells do not have."""
    assert section.numbers
    return [number for number in section.numbers if not is_cell(number, results.tables)]


def words(section: Section) -> str:
    """Answer and findings of a section."""
    return " ".join((section.answer, *section.findings))
