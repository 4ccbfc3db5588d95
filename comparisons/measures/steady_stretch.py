"""Stretches of motions of the paper's example, from the independent solution and from runs of the HLCP scheme alike.

A claim about the example is measured on stretches alone, so that truth and run undergo the same measurement.
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
TURNING = ("slip", "stick", "reversal")
"""Kinds of the events at which friction jumps."""
SAMPLES_PER_PERIOD = 4001
"""Instants of one period, both ends included: every 2 ms of 8 s."""
ROUNDING = 1e-9
"""Seconds by which the ends of a stretch may miss a sample or an event."""


def stick_intervals(
    events: Iterable[Event], start: float, end: float, starts_at_rest: bool
) -> list[tuple[float, float]]:
    """Return begin and end of each stick phase, s, from the events of one guide; a phase lasts to `end` at most."""
    intervals, since = [], start if starts_at_rest else None
    for event in events:
        if event.kind == "stick":
            since = event.time
        elif event.kind == "slip" and since is not None:
            intervals.append((since, event.time))
            since = None
    return intervals if since is None else [*intervals, (since, end)]


@dataclass(frozen=True)
class Stretch:
    """A motion of the slider-bar between two instants.

    Attributes
    ----------
    start, end : float
        s.
    period : float
        Common period of load and bar, s.
    t : ndarray, shape (n,)
    columns : Mapping[str, ndarray]
        As of `stiction.scenes.Trajectory`, each of shape (n,).
    events : tuple of Event
        Events after `start` and before `end`, with two-sided values.
    step : float
        The method's, s; 0 for the truth.
    uncertainty : Mapping[str, float]
        By name of a column, where it is known.
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
        """Return a part of the stretch."""
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
        """Start and end of each stick phase, cut at the ends of the stretch."""
        return stick_intervals(
            self.events, self.start, self.end, bool(self.columns[f"{GUIDE}.mode"][0] == 0)
        )

    @property
    def stick_time(self) -> float:
        """Seconds in which the slider is stuck."""
        return float(sum(end - start for start, end in self.phases))

    def maximum(self, *names: str) -> float:
        """Return the largest size of columns, both sides of events included."""
        sides = [
            abs(side[name])
            for event in self.events
            for side in (event.before, event.after)
            for name in names
        ]
        return float(max([np.max(np.abs(self.columns[name])) for name in names] + sides))

    @property
    def turning(self) -> list[Event]:
        """Events at which friction jumps."""
        return [event for event in self.events if event.kind in TURNING]

    def resolution(self, column: str) -> float:
        """Return the size of the smallest distinguishable jump: the largest smooth change in a step, or uncertainty."""
        # changes of intervals in which no event lies: what is smooth there looks like a jump to a
        # method of this step
        t, values = self.t, self.columns[column]
        quiet = np.ones(len(t) - 1, dtype=bool)
        for event in self.turning:
            quiet &= (t[1:] < event.time - ROUNDING) | (t[:-1] > event.time + ROUNDING)
        rate = np.abs(np.diff(values)) / np.diff(t)
        return float(
            self.step * np.max(rate[quiet], initial=0.0) + self.uncertainty.get(column, 0.0)
        )

    def change(self) -> float:
        """Return the largest change of position and velocity from one period to the next, relative to their ranges."""
        instants = np.arange(self.start, self.end + ROUNDING, self.period)
        worst = 0.0
        for name in ("slider.x", "slider.vx"):
            values = np.interp(instants, self.t, self.columns[name])
            size = float(np.ptp(self.columns[name])) or 1.0
            worst = max(worst, float(np.max(np.abs(np.diff(values)))) / size)
        return worst

    @cached_property
    def configurations(self) -> list[tuple[str, float]]:
        """Corners that touch, in their order, each with the seconds it lasts: ``"1+3"``: corners 1 and 3 touch."""
        touching = np.stack([self.columns[f"{GUIDE}.F{i}"] > 0 for i in range(1, 5)], axis=1)
        starts = np.flatnonzero(np.append(True, np.any(np.diff(touching, axis=0), axis=1)))
        names = [
            "+".join(str(corner + 1) for corner in np.flatnonzero(touching[i])) for i in starts
        ]
        return list(zip(names, np.diff([*self.t[starts], self.end]).tolist()))

    def cycle(self) -> list[str]:
        """Return the configurations of one period as a cycle, beginning with 2+4 where there is one."""
        names = [name for name, _ in self.configurations]
        if len(names) > 1 and names[0] == names[-1]:
            names = names[:-1]
        first = names.index("2+4") if "2+4" in names else 0
        return names[first:] + names[:first]


def steady_stretch(scene: Scene) -> Stretch:
    """Return one period of the motion that the scene's start leads to, by the independent solution's return map.

    Raises
    ------
    NoSteadyState, NoMotion
        Where there is none.
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
    """Return all of an independent solution."""
    period = SliderBar.from_scene(scene).period()
    t = np.linspace(0.0, truth.t_end, round((SAMPLES_PER_PERIOD - 1) * truth.t_end / period) + 1)
    return Stretch(
        0.0, truth.t_end, period, t, truth(t), truth.events, uncertainty=truth.uncertainty
    )


def run_stretch(scene: Scene, run: Trajectory, step: float) -> Stretch:
    """Return all of a run of a method of fixed step."""
    return Stretch(
        0.0,
        float(run.t[-1]),
        SliderBar.from_scene(scene).period(),
        run.t,
        run.columns,
        run.events,
        step,
    )
