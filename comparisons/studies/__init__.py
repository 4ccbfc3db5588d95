"""The questions of the report: a module with a `STUDY` is one.

The others are what several of them, or sweeps, are made of: `study`, `work_precision`, `equal_error`,
`steady_state_measures`, `sweep`; `hold_data` has the runs of `hold`.
"""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiction.comparisons.bench.study import Study


@cache
def studies() -> tuple[Study, ...]:
    """All studies of this folder, in the order of the report."""
    modules = [
        import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)
    ]
    found = [module.STUDY for module in modules if hasattr(module, "STUDY")]
    return tuple(sorted(found, key=lambda study: study.place))
