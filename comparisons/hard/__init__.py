"""Hard cases: what solvers do when the mathematics gets difficult; what must happen is derived, never observed.

``case``         what a case is; limits of right and degraded
``cases``        the catalogue, by topic
``checks``       closed forms, invariances, independent solutions
``hostile``      scenes that are to be refused
``scaling``      a scene in other units
``examination``  one case through one variant, and the verdict
``table``        all of them
"""

from comparisons.hard.cases import hard_cases
from comparisons.hard.table import METHODS, HardComparison, hard_cell, hard_comparison, hard_matrix

__all__ = ["METHODS", "HardComparison", "hard_cases", "hard_cell", "hard_comparison", "hard_matrix"]
