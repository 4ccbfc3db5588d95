"""Names of the solvers of the contact problem, and what they are counted by."""

from __future__ import annotations

from typing import Annotated

import numpy as np

AUTOMATIC, LEMKE, ENUMERATION, TRIAL = range(4)
SOLVERS = {"automatic": AUTOMATIC, "lemke": LEMKE, "enumeration": ENUMERATION, "trial": TRIAL}
"""See `contact_solvers`."""

COUNTERS = np.dtype([(name, np.int64) for name in (
    "steps", "rejected", "rhs", "hlcp", "pivots", "events", "projections", "lemke_rays", "enumerations",
    "trial_fallbacks")])
"""What an integration counts: accepted and rejected steps, right-hand sides, contact problems, pivots (or trials, or
modes tried), events, projections. Where one solver took the place of another: ends of Lemke's method without a
solution, searches of all modes after such an end, and contact problems that trial and error did not solve and handed to
Lemke's method."""
Counters = Annotated[np.ndarray, COUNTERS, 0]


def named(counters: np.ndarray) -> dict[str, int]:
    """Counters by name."""
    return dict(zip(COUNTERS.names, counters.tolist()))
