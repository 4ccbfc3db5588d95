"""Names of the solvers of the contact problem, and what they are counted by."""

from __future__ import annotations

from stiction.reference_impl.compiled.bundle import Record

AUTOMATIC, LEMKE, ENUMERATION, TRIAL = range(4)
SOLVERS = {"automatic": AUTOMATIC, "lemke": LEMKE, "enumeration": ENUMERATION, "trial": TRIAL}
"""See `contact_solvers`."""


class Counters(Record):
    """Counters of an integration: accepted and rejected steps, right-hand sides, contact problems, and so on.

    Attributes
    ----------
    pivots : int
        Or trials, or modes tried.
    lemke_rays : int
        Ends of Lemke's method without a solution.
    enumerations : int
        Searches of all modes after such an end.
    trial_fallbacks : int
        Contact problems that trial and error did not solve and handed to Lemke's method.
    """

    steps: int
    rejected: int
    rhs: int
    hlcp: int
    pivots: int
    events: int
    projections: int
    lemke_rays: int
    enumerations: int
    trial_fallbacks: int


def named(counters: Record) -> dict[str, int]:
    """Counters by name."""
    return dict(zip(counters.dtype.names or (), counters.tolist()))
