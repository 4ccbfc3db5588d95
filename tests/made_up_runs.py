"""Runs that were never made, for presentations: records with a trajectory of two instants, and their table columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.traced_text import COUNT, NAME, Number
from stiction.comparisons.results import Results
from stiction.comparisons.variants import EVENTS_BY, FRICTION_BY, Record, Variant
from stiction.engines import Outcome
from stiction.scenes import Trajectory

CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
VARIANTS = {"reference": Variant("reference", "reference", "rtol", (1e-9, 1e-12)),
            "paper's scheme": Variant("paper's scheme", "reference", "dt", (1e-2, 1e-3)),
            "pymunk": Variant("pymunk", "pymunk", "dt", (1e-2, 1e-3)),
            "PyBullet": Variant("PyBullet", "pybullet", "dt", (1e-2, 1e-3)),
            "pymunk, contact": Variant("pymunk, contact", "pymunk", "dt", (1e-2, 1e-3), "contact")}


def record(label: str, case: str, step: float, status: str = "ok", reason: str = "") -> Record:
    variant, key = VARIANTS[label], f"{case}/{label}/{step:g}"
    t = np.array([0.0, 0.01])
    columns = {"slider.x": t + step, "slider.y": 0 * t, "motor.effort": t}
    run = Trajectory(case, variant.engine, "1", variant.fidelity, t, columns,
                     settings={"method": label}, termination=reason or "end")
    outcome = Outcome(key, status, run) if status == "ok" else Outcome(key, status, None, reason)
    return Record(key, case, variant, step, outcome)


def about(one: Record) -> dict[str, object]:
    """The columns that every table begins with; the reference alone has its own friction law, and locates events."""
    own = one.variant.engine == "reference"
    suppliers = {FRICTION_BY: "engine" if own else "adapter", EVENTS_BY: "engine" if own else "nobody"}
    return {**one.describe(), **(suppliers if one.trajectory is not None else {}), "truth": one.scene}


def recomputed(number: Number, results: Results) -> float:
    """The number from the cells that it names."""
    table = results.tables[number.table]
    if number.how == COUNT:
        chosen = np.ones(len(table), dtype=bool)
        for column, wanted in number.where.items():
            chosen &= [cell in wanted if isinstance(wanted, frozenset) else cell == wanted for cell in table[column]]
        return float(chosen.sum())
    [row] = number.rows
    return number.factor * abs(table[number.column].iloc[row - 1])


def wrong_numbers(said: Presentation, results: Results) -> list[Number]:
    """Numbers of the sentences that their cells do not have, to two digits; a bound may be rounded up."""
    texts = [said.answer, *said.findings, *(cell for headline in said.headlines for cell in headline.cells.values())]
    numbers = [number for text in texts for number in text.numbers if number.how != NAME]
    assert numbers
    pairs = [(number, recomputed(number, results)) for number in numbers]
    return [number for number, true in pairs if abs(float(number.text) - true) > 0.1 * abs(true)]


def sentences(said: Presentation) -> str:
    return " ".join(text.text for text in (said.answer, *said.findings))


def cells(said: Presentation) -> Mapping[str, str]:
    return {method: text.text for method, text in said.headlines[0].cells.items()}
