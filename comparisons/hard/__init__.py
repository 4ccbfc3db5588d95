"""Hard cases: where the mathematics gets difficult for solvers; what must happen is derived, never observed.

``cases.toml``    the cases, by topic; ``case`` reads them
``checks``        measures of their runs; ``closed_forms``: formulas for them; ``scaled_scenes``: a scene in other units
``examination``   one case through one variant, and the verdict
``table``         all of them
"""

from stiction.comparisons.hard.case import hard_cases
from stiction.comparisons.hard.table import hard_comparison

__all__ = ["hard_cases", "hard_comparison"]
