"""Numbers that describe a motion after its start has been forgotten, from a window of one run of the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stiction.comparisons.studies.stick_threshold import NoCommonPeriod, common_period
from stiction.engines.protocol import EngineFailure
from stiction.reference_impl.integration.event_driven import Integration, Run
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Event, Scene

SAMPLE_STEP = 0.01
"""s; largest distance of the samples that a peak is taken from. Between two of them a peak of a sine of frequency w is
missed by at most (w SAMPLE_STEP)^2 / 8 of its size: 1e-4 at w = 3 rad/s."""

STEP_LIMIT = 100_000
"""Steps after which a run is given up; a window of the catalogue's scenes takes some hundred."""


@dataclass(frozen=True)
class SteadyWindow:
    """An integration and the window of it, from `start` to `end` seconds, that is measured; samples and events of its run lie in the window only."""

    scene: Scene
    integration: Integration
    start: float
    end: float

    @property
    def run(self) -> Run:
        """What it yields.

        Raises
        ------
        EngineFailure
            If it ends before `end`, with its own words.
        """
        if self.integration.run.termination != "end":
            raise EngineFailure(self.integration.run.termination)
        return self.integration.run

    @property
    def events(self) -> Sequence[Event]:
        """Those in the window, its start left out; the mode there holds since those before."""
        return self.run.events


@dataclass(frozen=True)
class Measure:
    """A number of a `SteadyWindow`.

    Attributes
    ----------
    function : callable
        Of a window, and of the name of the column of its run that the number is of. Its docstring says what it is.
    needs : str or None
        What of the scene must not be empty: ``"guides"``, ``"frictional_guides"``, ``"drives"``.
    of : str
        Column of the first of these, such as ``"effort"``.
    sampled : bool
        Whether it needs samples all over the window, or events and ends suffice.
    """

    name: str
    unit: str
    function: Callable[[SteadyWindow, str], float]
    needs: str | None = None
    of: str = ""
    sampled: bool = False

    @property
    def column(self) -> str:
        return f"{self.name} [{self.unit}]"

    def source(self, scene: Scene) -> str:
        """The column of a run that it is of; none where that is of nothing."""
        return f"{next(iter(getattr(scene, self.needs)))}.{self.of}" if self.needs else ""

    def value(self, window: SteadyWindow) -> float:
        return float(self.function(window, self.source(window.scene)))


def stick_fraction(window: SteadyWindow, mode: str) -> float:
    """Part of the window in which the first frictional guide sticks; from the located events, without sampling."""
    since, last, stuck = window.start, window.run.columns[mode][0], 0.0
    for event in window.events:
        stuck += (event.time - since) * (last == 0)
        since, last = event.time, event.after[mode]
    return (stuck + (window.end - since) * (last == 0)) / (window.end - window.start)


def peak(window: SteadyWindow, column: str) -> float:
    """Largest absolute value, two-sided values at events included."""
    sides = [abs(side[column]) for event in window.events for side in (event.before, event.after)]
    return max(np.max(np.abs(window.run.columns[column])), *sides, 0.0)


def event_count(window: SteadyWindow, _: str) -> float:
    """Number of events in the window: changes of contact mode."""
    return len(window.events)


MEASURES = {measure.name: measure for measure in (
    Measure("stick-fraction", "-", stick_fraction, needs="frictional_guides", of="mode"),
    Measure("peak-torque", "N m", peak, needs="drives", of="effort", sampled=True),
    Measure("peak-speed", "m/s", peak, needs="guides", of="slip_velocity", sampled=True),
    Measure("event-count", "-", event_count))}
"""Those of peaks are of the first drive (N of a distance drive) and of the first guide's slider along its guide."""


def window_start(scene: Scene, settle: float, t_end: float) -> float:
    """Where the window of a scene that ends at `t_end` starts, at `settle` seconds or later.

    The window is the largest whole number of common periods of loads and drives that fits; where they have no
    common period, or a longer one, all of the time from `settle` on: an average over it is then off by the order
    of one period of the motion over the window's length.
    """
    try:
        period = common_period(scene)
    except NoCommonPeriod:
        return settle
    periods = int((t_end - settle) / period * (1 + 1e-12))
    return t_end - periods * period if periods else settle


@lru_cache(maxsize=8)
def _instants(start: float, t_end: float, sampled: bool) -> np.ndarray:
    """Of the samples of a window: its ends, and others at most `SAMPLE_STEP` apart if it is `sampled`; points of a sweep ask for the same."""
    instants = np.linspace(start, t_end, int(np.ceil((t_end - start) / SAMPLE_STEP)) + 1 if sampled else 2)
    instants.flags.writeable = False
    return instants


def steady_window(scene: Scene, settle: float, t_end: float, rtol: float, measures: Sequence[Measure], like: Mechanism | None = None) -> SteadyWindow:
    """With the reference's event-driven method and projection, the start moved onto the constraints; simulated when its run is asked for.

    Parameters
    ----------
    measures : sequence of Measure
        What the window is for: its run has no other columns than theirs.
    like : Mechanism, optional
        Of the scene that `vary` has made this one of; see `Mechanism`.

    Raises
    ------
    SceneError
        If the start cannot be assembled.
    """
    mechanism = Mechanism(scene, "projection", like)
    q, v = consistent_start(mechanism, assemble=True)
    start = window_start(scene, settle, t_end)
    output = _instants(start, t_end, any(measure.sampled for measure in measures))
    columns = {measure.source(scene) for measure in measures if measure.needs}
    return SteadyWindow(scene, Integration(mechanism, q, v, output, t_end, rtol, STEP_LIMIT, names=columns, events_behind=start), start, t_end)
