"""Hard cases: what solvers do when the mathematics gets difficult; what must happen is derived, never observed.

``case``            what a case is; limits of right and degraded
``cases.toml``      the catalogue, by topic; ``hard_catalogue`` reads it
``checks``          closed forms, invariances, independent solutions
``closed_forms``    formulas of the catalogue
``hostile_scenes``  texts of scenes that are to be refused
``other_units``     a scene in other units
``examination``     one case through one variant, and the verdict
``table``           all of them
"""

from stiction.comparisons.hard.hard_catalogue import hard_cases
from stiction.comparisons.hard.table import HardComparison, hard_comparison

__all__ = ["HardComparison", "hard_cases", "hard_comparison"]
