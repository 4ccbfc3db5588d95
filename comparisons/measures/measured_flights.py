"""Comparison of the flights of corners in a run with contacts with those that the law of free flight predicts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from stiction.comparisons.measures.clearance_effect import GapRun
from stiction.comparisons.measures.corner_flights import CornerFlight, Release, corner_flights
from stiction.comparisons.measures.corner_gaps import (
    ARRIVAL,
    CornerImpact,
    corner_gaps,
    guides_with_gaps,
    impacts_in,
)
from stiction.scenes import Trajectory

SHOWN_CLEARANCE = 1e-3
"""Clearance whose flight time determines the stretch of the effort that is shown for all clearances, m."""
SHOWN_FLIGHTS = (-0.3, 2.0)
"""Begin and end of this stretch, in flight times at `SHOWN_CLEARANCE` after the release."""
SHOWN_SAMPLES = 600
"""Number of samples of this stretch.

The effort of a sample is its mean since the sample before, so that the height of an impact, which is an impulse, does
not depend on the step.
"""
LAW_EXPONENT = 1.0 / 3.0
"""Exponent of the flight time over the clearance after a zero of the force."""


def measured_flights(run: GapRun) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Simulate a run with clearance, and compare its flights with the predicted ones.

    Returns
    -------
    flights : list of dict
        For each release in the ideal motion, the predicted flight (``predicted_flight_time`` in s,
        ``predicted_impact_speed`` in m/s), the measured one (``flight_time``, ``impact_speed``) and the ratios of
        predicted to measured values. Where there is no measured flight, ``why_none`` tells why.
    efforts : list of dict
        Samples of the first drive's effort around the release with the least crowding: ``time_after_release`` (s),
        ``effort_value``, ``ideal_effort`` (N or N m). Empty without a drive or without a release.
    """
    scene = run.simulated_scene
    ideal = run.ideal_run()
    flights = corner_flights(scene, ideal)
    trajectory = run.simulate()
    rows: list[dict[str, Any]] = []
    for guide in guides_with_gaps(scene):
        gaps = corner_gaps(scene, trajectory, guide)
        impacts = impacts_in(trajectory.t, gaps, run.clearance)
        own = [flight for flight in flights if flight.guide == guide]
        for flight in own:
            rows.append(_flight_row(flight, own, trajectory, gaps, impacts))
    return rows, list(_effort_rows(run, flights, ideal, trajectory))


def _flight_row(
    flight: CornerFlight,
    flights: Sequence[CornerFlight],
    trajectory: Trajectory,
    gaps: np.ndarray,
    impacts: Sequence[CornerImpact],
) -> dict[str, Any]:
    """Return the row of one predicted flight.

    Parameters
    ----------
    flight : CornerFlight
        The predicted flight.
    flights : sequence of CornerFlight
        All predicted flights of the same slider.
    trajectory : Trajectory
        The run with contacts.
    gaps : ndarray, shape (4, samples)
        Gaps of the slider's corners in this run, m.
    impacts : sequence of CornerImpact
        Impacts of the slider in this run, in order of time.
    """
    row = _predicted_columns(flight)
    # A predicted flight that has no end (NaN) may have one in the run.
    end_of_run = float(trajectory.t[-1])
    if end_of_run < flight.time or end_of_run < flight.time + flight.flight_time:
        return {**row, "why_none": "the run ends during the flight"}
    sample = int(np.searchsorted(trajectory.t, flight.time))
    if gaps[flight.opposite_corner - 1, sample] <= ARRIVAL * flight.clearance:
        return {**row, "why_none": "the end is already at the other surface"}
    # The flight is over when the same end is released from the other surface in the ideal motion.
    later = [
        other.time
        for other in flights
        if other.time > flight.time and other.corner == flight.opposite_corner
    ]
    end = min(later, default=end_of_run)
    for impact in impacts:
        if impact.corner == flight.opposite_corner and flight.time < impact.time <= end:
            flight_time = impact.time - flight.time
            has_speed = impact.speed > 0.0
            return {
                **row,
                "flight_time": flight_time,
                "flight_time_ratio": flight.flight_time / flight_time,
                "impact_speed": impact.speed,
                "impact_speed_ratio": flight.impact_speed / impact.speed if has_speed else np.nan,
                "why_none": "",
            }
    return {**row, "why_none": "no impact before the end is released again"}


def _predicted_columns(flight: CornerFlight) -> dict[str, Any]:
    """Return the columns of a predicted flight."""
    return {
        "event_time": flight.time,
        "joint": flight.guide,
        "release": str(flight.release),
        "corner": flight.corner,
        "opposite_corner": flight.opposite_corner,
        "effective_mass": flight.mass,
        "crowding": flight.crowding,
        "mobilization": flight.mobilization,
        "predicted_flight_time": flight.flight_time,
        "predicted_impact_speed": flight.impact_speed,
    }


def shown_flight(flights: Sequence[CornerFlight]) -> CornerFlight | None:
    """Return the flight with the least crowding among those after a zero of the force; None if there is none.

    The crowdings of these flights are proportional to the same power of the clearance, so that it is the same flight
    for every clearance.
    """
    candidates = [flight for flight in flights if flight.release == Release.ZERO]
    return min(candidates, key=lambda flight: flight.crowding, default=None)


def _effort_rows(
    run: GapRun, flights: Sequence[CornerFlight], ideal: Trajectory, trajectory: Trajectory
) -> Iterator[dict[str, Any]]:
    """Yield the samples of the effort around the shown flight; see `measured_flights`."""
    flight = shown_flight(flights)
    drives = list(run.scene.drives)
    if flight is None or not drives:
        return
    column = f"{drives[0]}.effort"
    flight_unit = flight.flight_time * (SHOWN_CLEARANCE / run.clearance) ** LAW_EXPONENT
    ends = flight.time + flight_unit * np.linspace(*SHOWN_FLIGHTS, SHOWN_SAMPLES + 1)
    ends = ends[ends <= trajectory.t[-1]]
    # Integral of the effort up to each sample of the run, whose effort is the mean over the step that ends there.
    integral = np.concatenate([[0.0], np.cumsum(trajectory[column][1:] * np.diff(trajectory.t))])
    means = np.diff(np.interp(ends, trajectory.t, integral)) / np.diff(ends)
    middles = 0.5 * (ends[1:] + ends[:-1])
    frame = ideal.to_frame(events=True, interpolated=True)
    exact = np.interp(middles, frame["t"], frame[column])
    for time, value, ideal_value in zip(middles, means, exact, strict=True):
        yield {
            "event_time": flight.time,
            "time_after_release": float(time - flight.time),
            "effort_value": float(value),
            "ideal_effort": float(ideal_value),
        }
