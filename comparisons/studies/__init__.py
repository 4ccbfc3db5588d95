"""The questions of the report: one file is one question, and has a `STUDY`.

File, command of `stiction compare` and main table have the same name. `hold_data`, `hold_tables` and
`hold_presentation` contain the runs, tables and presentation of `hold`; `paper_figures` redraws the figures of the
paper and is no command.
"""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiction.comparisons.bench.study import Study

ORDER = (
    "motion",
    "accuracy",
    "second-method",
    "cost",
    "torque",
    "clearance",
    "threshold",
    "hold",
    "joint-friction",
    "drift",
    "long-drift",
    "hard",
    "effects",
    "suppression",
    "claims",
    "orders",
    "settings",
    "paper",
)
"""Names of studies in the order of the report; others follow behind them, in that of their names."""


@cache
def studies() -> tuple[Study, ...]:
    """All studies of this folder, in the order of the report."""
    modules = [
        import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)
    ]
    found = {module.STUDY.name: module.STUDY for module in modules if hasattr(module, "STUDY")}
    others = sorted(set(found) - set(ORDER))
    return tuple(found[name] for name in (*ORDER, *others) if name in found)
