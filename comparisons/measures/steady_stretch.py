"""Stretches of motions of the paper's example, from the independent solution or from a run.

Statements of the paper are tested on stretches, so that truths and runs are tested by the same
functions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stiction.scenes import Event, Scene, Trajectory
from stiction.truths import Truth
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import steady_state
from stiction.truths.reduced.truth_of_motion import motion_columns, motion_events

GUIDE = "guide"
"""Name of the guide in the scenes of the example."""
TURNING = ("slip", "stick", "reversal")
"""Kinds of events at which friction jumps."""
SAMPLES_PER_PERIOD = 4001
"""Number of samples of one period, both ends included: one every 2 ms for a period of 8 s."""
ROUNDING = 1e-9
"""Tolerance of times at the ends of a stretch, s."""


def stick_intervals(
    events: Iterable[Event], start: float, end: float, starts_at_rest: bool
) -> list[tuple[float, float]]:
    """Return begin and end of each stick phase between two times, s, from the events of one guide.

    A phase that has not ended at `end` ends there.
    """
    intervals = []
    begin = start if starts_at_rest else None
    for event in events:
        if event.kind == "stick":
            begin = event.time
        elif event.kind == "slip" and begin is not None:
            intervals.append((begin, event.time))
            begin = None
    if begin is not None:
        intervals.append((begin, end))
    return intervals


@dataclass(frozen=True)
class Stretch:
    """A motion of the slider-bar between two instants.

    Attributes
    ----------
    start, end : float
        Instants, s.
    period : float
        Common period of load and bar, s.
    t : ndarray, shape (n,)
        Times of the samples, s.
    columns : Mapping[str, ndarray]
        As in `stiction.scenes.Trajectory`, each of shape (n,).
    events : tuple of Event
        Events after `start` and before `end`, with values on both sides.
    step : float
        Step size of the run, s; 0 for a truth.
    uncertainty : Mapping[str, float]
        By column, if it is known.
    """

    start: float
    end: float
    period: float
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    events: tuple[Event, ...]
    step: float = 0.0
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    def between(self, start: float, end: float) -> Stretch:
        """Return the part of the stretch between two instants, s."""
        inside = (self.t >= start - ROUNDING) & (self.t <= end + ROUNDING)
        return replace(
            self,
            start=start,
            end=end,
            t=self.t[inside],
            columns={name: values[inside] for name, values in self.columns.items()},
            events=tuple(event for event in self.events if start < event.time < end),
        )

    @cached_property
    def phases(self) -> list[tuple[float, float]]:
        """Begin and end of each stick phase within the stretch, s."""
        return stick_intervals(
            self.events, self.start, self.end, bool(self.columns[f"{GUIDE}.mode"][0] == 0)
        )

    @property
    def stick_time(self) -> float:
        """Time for which the slider sticks, s."""
        return float(sum(end - start for start, end in self.phases))

    def maximum(self, *names: str) -> float:
        """Return the largest size of the values in columns, including both sides of events."""
        sizes = []
        for name in names:
            sizes.append(np.max(np.abs(self.columns[name])))
            for event in self.events:
                sizes += [abs(event.before[name]), abs(event.after[name])]
        return float(max(sizes))

    @property
    def turning(self) -> list[Event]:
        """Events at which friction jumps."""
        return [event for event in self.events if event.kind in TURNING]

    def resolution(self, column: str) -> float:
        """Return the size of the smallest jump that can be distinguished, in the unit of the column.

        It is the largest change within a step where the column is smooth, plus the uncertainty: the
        run cannot distinguish such a change from a jump.
        """
        t, values = self.t, self.columns[column]
        is_smooth = np.ones(len(t) - 1, dtype=bool)
        for event in self.turning:
            is_smooth &= (t[1:] < event.time - ROUNDING) | (t[:-1] > event.time + ROUNDING)
        rate = np.abs(np.diff(values)) / np.diff(t)
        smooth_change = self.step * np.max(rate[is_smooth], initial=0.0)
        return float(smooth_change + self.uncertainty.get(column, 0.0))

    def change(self) -> float:
        """Return the largest change of position and velocity from one period to the next, relative to their ranges."""
        instants = np.arange(self.start, self.end + ROUNDING, self.period)
        largest = 0.0
        for name in ("slider.x", "slider.vx"):
            values = np.interp(instants, self.t, self.columns[name])
            value_range = float(np.ptp(self.columns[name])) or 1.0
            largest = max(largest, float(np.max(np.abs(np.diff(values)))) / value_range)
        return largest

    @cached_property
    def configurations(self) -> list[tuple[str, float]]:
        """Successive sets of corners that carry load, such as ``"1+3"``, each with its duration, s."""
        is_loaded = np.stack([self.columns[f"{GUIDE}.F{i}"] > 0 for i in range(1, 5)], axis=1)
        is_start = np.append(True, np.any(np.diff(is_loaded, axis=0), axis=1))
        starts = np.flatnonzero(is_start)
        names = []
        for i in starts:
            corners = np.flatnonzero(is_loaded[i]) + 1
            names.append("+".join(str(corner) for corner in corners))
        durations = np.diff([*self.t[starts], self.end])
        return list(zip(names, durations.tolist()))

    def cycle(self) -> list[str]:
        """Return the configurations of one period as a cycle that begins with 2+4, if this occurs."""
        names = [name for name, _ in self.configurations]
        # The end of the period cuts a configuration into two parts, the last and the first.
        if len(names) > 1 and names[0] == names[-1]:
            names = names[:-1]
        first = names.index("2+4") if "2+4" in names else 0
        return names[first:] + names[:first]


def steady_stretch(scene: Scene) -> Stretch:
    """Return one period of the steady motion that is reached from the scene's start, by the return map of the truth.

    Raises
    ------
    NoSteadyState, NoMotion
        If there is no steady motion, or no motion at all.
    """
    mechanism = SliderBar.from_scene(scene)
    steady, period = steady_state(mechanism), mechanism.period()
    end = period * steady.periods
    # the same instants of each period
    t = np.linspace(0.0, end, (SAMPLES_PER_PERIOD - 1) * steady.periods + 1)
    return Stretch(
        0.0,
        end,
        period,
        t,
        motion_columns(mechanism, steady.motion, t, "after"),
        motion_events(mechanism, steady.motion, (GUIDE,)),
        uncertainty={"residual": steady.residual},
    )


def truth_stretch(scene: Scene, truth: Truth) -> Stretch:
    """Return the stretch of a truth from its start to its end."""
    period = SliderBar.from_scene(scene).period()
    t = np.linspace(0.0, truth.t_end, round((SAMPLES_PER_PERIOD - 1) * truth.t_end / period) + 1)
    return Stretch(
        0.0, truth.t_end, period, t, truth(t), truth.events, uncertainty=truth.uncertainty
    )


def run_stretch(scene: Scene, run: Trajectory, step: float) -> Stretch:
    """Return the stretch of a whole run with a fixed step, s."""
    return Stretch(
        0.0,
        float(run.t[-1]),
        SliderBar.from_scene(scene).period(),
        run.t,
        run.columns,
        run.events,
        step,
    )
