"""From the formulas of a motion to a Truth: two-sided events, and rounding as uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stiction.comparisons.truth.truth import CLOSED_FORM, SIDES, Truth
from stiction.scenes import Event, Scene

EPS = np.finfo(float).eps


def truth_of_formulas(scene: Scene, t_end: float, columns: Callable[[np.ndarray, str], dict[str, np.ndarray]],
                      rounding: float, samples: int, switches: Sequence[tuple[float, str, str]] | None = None) -> Truth:
    """Return the closed form of a motion as a Truth, whose `columns` are given.

    Parameters
    ----------
    rounding
        Error of a column, relative to its largest size and 1, and of the times of events, relative to `t_end` and 1 s.
    samples
        Number of instants at which the largest sizes are found.
    switches
        Time, kind and guide of each event; None for a motion without friction.
    """
    found = columns(np.linspace(0, t_end, samples), "after")
    uncertainty = {name: rounding * float(1 + np.max(np.abs(values))) for name, values in found.items()}
    if switches is not None:
        uncertainty["event time"] = rounding * max(t_end, 1.0)
    events = []
    for time, kind, guide in switches or ():
        at_event = [columns(np.array([time]), side) for side in SIDES]
        before, after = ({name: float(values[0]) for name, values in found.items()} for found in at_event)
        events.append(Event(time, kind, guide, before, after))
    return Truth(scene.name, CLOSED_FORM, t_end, columns, uncertainty, tuple(events))
