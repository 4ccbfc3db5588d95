"""Hard cases: mechanisms that are difficult to solve, with expected outcomes that are derived, not simulated.

``cases.toml``     the cases, by topic; ``case`` reads them
``checks``         measures of their runs; ``closed_forms`` contains formulas, ``scaled_scenes`` converts units
``examination``    runs one case with one variant, and judges the result
``table``          runs and judges all cases
"""

from stiction.comparisons.hard.case import hard_cases
from stiction.comparisons.hard.table import hard_comparison

__all__ = ["hard_cases", "hard_comparison"]
