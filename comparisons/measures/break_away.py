"""The instant at which a joint first slips in a run from its start."""

from __future__ import annotations

import numpy as np

from stiction.comparisons.measures.settling import CREEP_TOLERANCE
from stiction.engines.protocol import EVENTS_LOCATED_BY
from stiction.scenes import StictionError, Trajectory


class NeverSlips(StictionError):
    """A joint that rests throughout a run has no break-away."""


def break_away(run: Trajectory, mode: str) -> float:
    """Return the time (s) at which a joint first slips; 0 if it slips at the start.

    It is the time of a located event. Without located events, it is that of the first sample from which the joint is
    faster than `CREEP_TOLERANCE`.

    Parameters
    ----------
    run : Trajectory
        A run from t = 0.
    mode : str
        The column of the joint's contact mode, such as ``guide.mode``.

    Raises
    ------
    NeverSlips
        If the joint rests up to the end of the run.
    """
    joint = mode.rpartition(".")[0]
    never = NeverSlips(f"{joint} rests up to the end of the run at {run.t[-1]:g} s")
    if run.settings[EVENTS_LOCATED_BY] == "nobody":
        slips = np.abs(run[f"{joint}.slip_velocity"]) > CREEP_TOLERANCE
        if not slips.any():
            raise never
        return float(run.t[np.argmax(slips)])

    if run[mode][0] != 0:
        return 0.0
    times = [event.time for event in run.events if event.joint == joint and event.kind == "slip"]
    if not times:
        raise never
    return times[0]
