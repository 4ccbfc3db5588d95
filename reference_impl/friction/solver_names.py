"""Names of the solvers of the contact problem, and what they are counted by."""

from __future__ import annotations

from stiction.reference_impl.compiled.bundle import Record

AUTOMATIC, LEMKE, ENUMERATION, TRIAL = range(4)
SOLVERS = {"automatic": AUTOMATIC, "lemke": LEMKE, "enumeration": ENUMERATION, "trial": TRIAL}
"""See `contact_solvers`."""


class Counters(Record):
    """Counters of an integration."""

    steps: int  # accepted ones
    rejected: int
    rhs: int  # right-hand sides
    hlcp: int  # contact problems
    pivots: int  # or trials, or modes tried
    events: int
    projections: int
    lemke_rays: int  # ends of Lemke's method without a solution
    enumerations: int  # searches of all modes after such an end
    trial_fallbacks: (
        int  # contact problems that trial and error did not solve and handed to Lemke's method
    )


def named(counters: Record) -> dict[str, int]:
    """Counters by name."""
    return dict(zip(counters.dtype.names or (), counters.tolist()))
