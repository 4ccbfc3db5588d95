"""Measures of steady states: the search for the last period of a run, and numbers that are evaluated over it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize_scalar

from stiction.comparisons.bench.quantities import Quantity
from stiction.comparisons.bench.variants import COMMON_STEP, time_factor
from stiction.comparisons.measures.break_away import break_away
from stiction.comparisons.measures.invariant_shifts import TURN, invariant_shifts
from stiction.comparisons.measures.settling import (
    CREEP_TOLERANCE,
    LEAST_PASSES,
    MOST_PERIODS,
    SHORTEST_STICK,
    NoCommonPeriod,
    NotSettled,
    excitation_period,
    settled,
)
from stiction.engines.protocol import EVENTS_LOCATED_BY, EngineFailure, Refused
from stiction.engines.registry import load_engine
from stiction.reference_impl.integration.event_driven import Integration, Options
from stiction.reference_impl.integration.result import Run
from stiction.reference_impl.multibody.initial_state import consistent_start, with_consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fidelity import Fidelity

SAMPLE_STEP = 0.01
"""s; largest distance of the samples that a peak is taken from. Between two of them a peak of a sine of frequency w is
missed by at most (w SAMPLE_STEP)^2 / 8 of its size: 1e-4 at w = 3 rad/s."""
FEWEST_SAMPLES = 16
"""Samples of a period from which the range of a motion is taken, where no measure requires more."""

REPEATS = 1e3
"""Largest distance of a steady motion from its limit, in units of the tolerance times the range of the motion. Two
descriptions of the same mechanism yield motions that differ by about this much."""
CONTRACTION = 0.05
"""Smallest change from period to period, in units of that distance, from which the decay of a transient is computed.
The errors of a run itself are smaller, also those of steps at the limit of stability."""
FAR = 0.4
"""Part of its range by which a motion must leave a state before a return to this state counts as a repetition."""
BACK = (0, 3, 8, 21)
"""Samples, counted back from the end, whose states are tried one after the other as the state that is repeated. One
alone is not enough: next to a jump of the acceleration the interpolated motion is wrong by the size of the jump."""
SAME = 1e-9
"""Largest relative difference of accelerations and forces by an invariant shift; rounding leaves 1e-13."""
LEAST_SHIFT = 1e-3
"""Shortest shift in a period, as a part of the size of the mechanism, after which forces are compared. For shorter
ones it would take too many periods until the mechanism has moved by its own size."""
OFF_GRID = 1e-2
"""Largest deviation of an engine's sample from its instant, as a part of the distance of samples: an engine may move a
sample onto an event that is this close."""
STEP_LIMIT = 100_000
"""Steps of the reference after which a run is given up; a window of the catalogue's scenes takes some hundred."""


@dataclass(frozen=True)
class SteadyRun:
    """The settings of a run, and the time in which its steady state is searched for.

    Attributes
    ----------
    settle, t_end : float
        Start and end of the time in which the motion must come to rest or repeat itself, s.
    rtol : float
        Relative tolerance of a run without fixed steps. A motion repeats itself if it does to `REPEATS` times this
        part of its range.
    engine : str
        Name of the engine.
    fidelity : Fidelity
        Representation of guides in the engine.
    dt : float or None
        Largest step of a run with fixed steps, s. If None, an engine without a tolerance uses `COMMON_STEP`.
    """

    settle: float
    t_end: float
    rtol: float = 1e-6
    engine: str = "reference"
    fidelity: Fidelity = Fidelity.JOINT
    dt: float | None = None

    @property
    def is_event_driven_reference(self) -> bool:
        """True if the run is made by the event-driven method of the reference."""
        return self.engine == "reference" and self.dt is None

    def step(self, scene: Scene) -> float | None:
        """Return the largest step on a scene, s; None for a run with a tolerance."""
        if self.dt is not None or load_engine(self.engine).capabilities.adaptive:
            return self.dt
        return COMMON_STEP * time_factor(scene, self.t_end)


@dataclass
class SteadyWindow:
    """A run, and the last period of its steady state, over which measures are evaluated.

    Attributes
    ----------
    scene : Scene
        The simulated scene.
    mechanism : Mechanism
        The mechanism of the scene.
    integration : Integration
        Integration by the reference, which computes the forces in the contact mode at the end of the run.
    whole : Run or Trajectory
        The run at equally spaced instants. A period of loads and drives is a whole number of their distances.
    located : bool
        True if the run contains the events of the motion.
    settle, end, rtol : float
        Fields of `SteadyRun`; `end` is the end of the run, which may be earlier than `SteadyRun.t_end`.
    period : float
        Common period of loads and drives, s; inf if they are constant, nan if they are not periodic.
    sampled : callable, optional
        Returns the run from a time (s) to its end, with samples as close as measures require. None if `whole` has such
        samples. A few samples in each period are enough to find a steady state.
    """

    scene: Scene
    mechanism: Mechanism
    integration: Integration
    whole: Run | Trajectory
    located: bool
    settle: float
    end: float
    period: float
    rtol: float
    sampled: Callable[[float], Run] | None = None

    def __post_init__(self) -> None:
        """Collect the motion of all bodies, its ranges, and the distances from a limit that are allowed.

        `_motion` contains positions, velocities and, if they were requested, accelerations, each of the shape
        (samples, 3 bodies). An allowed distance is a part of the range, plus the error of a step.
        """
        columns, bodies = self.whole.columns, list(self.scene.bodies)
        self._motion = [
            np.column_stack([columns[f"{body}.{label}"] for body in bodies for label in labels])
            for labels in BODY_COLUMNS
            if f"{bodies[0]}.{labels[0]}" in columns
        ]
        self._size = float(self.mechanism.arrays.length_scale)
        # Metres in a unit of each coordinate; an angle moves a point at the distance of the size.
        self._unit = np.tile([1.0, 1.0, self._size], len(bodies))
        self._fastest = float(np.max(np.abs(self._motion[1]) * self._unit))
        self._shifts = invariant_shifts(self.scene, self._size)
        self._places = self._shifts.places(self.whole.t, self._motion[0])
        range_of_places = np.ptp(self._places, axis=0)
        range_of_velocities = np.ptp(self._motion[1], axis=0) * self._unit
        # However often a body turns, two places on its circle are not farther apart than a turn.
        range_of_places = np.where(
            self._shifts.turns, np.minimum(range_of_places, TURN * self._size), range_of_places
        )
        self._ranges = [range_of_places, range_of_velocities]
        self._allowed = self.rtol * np.concatenate(
            [
                REPEATS * range_of_places + self._size,
                REPEATS * range_of_velocities + (self._fastest or 1.0),
            ]
        )

    @cached_property
    def start(self) -> float:
        """The start of the last period of the motion, s; the first sample if the mechanism rests or moves uniformly.

        Raises
        ------
        NotSettled
            If the motion neither rests nor repeats itself.
        """
        t = self.whole.t
        if self._is_steady():
            return float(t[0])
        if self.period < np.inf:
            step = round(self.period / (t[1] - t[0]))
            q, v = (values[::-step][::-1] for values in self._motion[:2])
            return self.end - self.period * self._order(self.end, self.period, q, v)
        if np.isnan(self.period):
            raise NotSettled(
                "loads and drives have no common period, and the mechanism is not at rest"
            )
        return self.end - self._own_period()

    @cached_property
    def run(self) -> Run | Trajectory:
        """The run from `start` to `end`; the contact mode at the start is that after all earlier events."""
        whole = self.whole if self.sampled is None else self.sampled(self.start)
        inside = whole.t >= self.start - 1e-9 * (self.end - self.settle)
        columns = {name: values[inside] for name, values in whole.columns.items()}
        events = tuple(event for event in whole.events if event.time > self.start)
        return replace(whole, t=whole.t[inside], columns=columns, events=events)

    def _is_steady(self) -> bool:
        """Return True if all bodies rest, or move uniformly in directions in which the equations do not change."""
        q, range_of_velocities = self._motion[0], self._ranges[1]
        if np.max(np.ptp(q, axis=0) * self._unit) <= self.rtol * self._size:
            return True
        if np.max(range_of_velocities) > CONTRACTION * REPEATS * self.rtol * self._fastest:
            return False
        change = self._places[-1] - self._places[0]
        change -= self._shifts.whole_turns(change)
        is_same_place = np.all(np.abs(change) <= self._allowed[: len(change)])
        return bool(is_same_place and self._forces_repeat(self.end - self.whole.t[0], q[-1] - q[0]))

    def _order(self, instant: float, period: float, q: np.ndarray, v: np.ndarray) -> int:
        """Return the number of periods after which a motion repeats itself.

        Parameters
        ----------
        instant : float
            Time of the last state, s.
        period : float
            Distance of the states in time, s.
        q, v : ndarray, shape (states, 3 bodies)
            Positions and velocities.

        Raises
        ------
        NotSettled
            If the motion does not repeat itself after up to `MOST_PERIODS` periods.
        """
        if len(q) < LEAST_PASSES:
            raise NotSettled(f"fewer than {LEAST_PASSES - 1} periods of {period:g} s to look at")
        passes = np.arange(1 - len(q), 1)
        places = self._shifts.places(instant + period * passes, q)
        for order in range(1, min(MOST_PERIODS, len(q) // LEAST_PASSES) + 1):
            turns = self._shifts.whole_turns(places[-1] - places[-1 - order])
            states = (
                np.hstack([places - np.outer(passes / order, turns), v * self._unit])
                / self._allowed
            )
            if settled(states, 1.0, CONTRACTION, (order,), 1.0) is not None and self._forces_repeat(
                order * period, q[-1] - q[-1 - order]
            ):
                return order
        raise NotSettled(
            f"the motion does not repeat itself to {REPEATS * self.rtol:g} of its range within "
            f"{len(q) - 1} periods of {period:g} s"
        )

    def _forces_repeat(self, time: float, change: np.ndarray) -> bool:
        """Return True if the forces are the same after the invariant shift that is next to a change in this time.

        The scene guarantees it, except for forces that are not unique and loads that are not periodic. Therefore
        accelerations and efforts are compared with those after so many shifts that the mechanism has moved by its own
        size.
        """
        shift = self._shifts.nearest(time, change, self._unit)
        q, v = (values[-1] for values in self._motion[:2])
        distance = np.max(np.abs(shift) * self._unit)
        if distance <= LEAST_SHIFT * self._size:
            return True
        times = int(np.ceil(self._size / distance))
        here, there = (
            self.integration.forces_at(self.end + k * time, q + k * shift, v) for k in (0, times)
        )
        efforts = [
            row for row, name in enumerate(self.mechanism.row_names) if name.endswith(".effort")
        ]
        pairs = (
            (here[0] * self._unit, there[0] * self._unit, self._fastest / time),
            (here[1], there[1], 0.0),
            (here[2][efforts], there[2][efforts], np.max(np.abs(here[2]), initial=0.0)),
        )
        return all(
            np.max(np.abs(others - values), initial=0.0)
            <= SAME * max(least, np.max(np.abs(values), initial=0.0))
            for values, others, least in pairs
        )

    def _own_period(self) -> float:
        """Return the shortest time (s) after which a mechanism with constant loads and drives repeats its motion.

        The state at one of the last samples is compared with all earlier ones. Minima of their distance, next to the
        sample first, are refined between samples, and the first one that is small enough is the period, provided that
        the motion repeats itself over all of the run.

        Raises
        ------
        NotSettled
            If there is no such time.
        """
        (q, v, a), t, n = self._motion, self.whole.t, 3 * len(self.scene.bodies)
        # Its error between samples is h^4/384 times the fourth derivative.
        motion = CubicHermiteSpline(t, np.hstack([q, v]), np.hstack([v, a]))
        ranges, count = np.concatenate(self._ranges), len(self._ranges[0])
        # Coordinates of bodies that rest or move uniformly have no range, and are left out.
        swings = np.concatenate(
            [self._ranges[0] > self.rtol * self._size, self._ranges[1] > self.rtol * self._fastest]
        )
        weight = 1.0 / ranges[swings]

        def states(instants: np.ndarray | float) -> np.ndarray:
            """Return the places and the velocities (m/s) at instants."""
            values = motion(instants)
            places = self._shifts.places(instants, values[..., :n])
            return np.concatenate([places, values[..., n:] * self._unit], axis=-1)

        def distance_after(instant: float, lag: np.ndarray | float) -> np.ndarray:
            """Return the largest relative difference of the states at an instant and a lag (s) before it."""
            change = states(instant - lag) - states(instant)
            change[..., :count] -= self._shifts.whole_turns(change[..., :count])
            return np.max(np.abs(change[..., swings]) * weight, axis=-1, initial=0.0)

        sampled = np.hstack([self._places, v * self._unit])
        step = np.max(np.abs(np.diff(sampled[:, swings], axis=0)) * weight, initial=0.0)
        reason = NotSettled(
            "the mechanism is neither at rest nor where it was before, within "
            f"{self.end - self.settle:g} s"
        )
        for last in len(t) - 1 - np.array(BACK)[np.array(BACK) < len(t) // 2]:
            instant, earlier = t[last], t[: last + 1]
            distance = distance_after(instant, instant - earlier)
            for i in range(last - 1, 0, -1):
                is_near = distance[i] <= min(step, distance[i - 1], distance[i + 1])
                if is_near and np.max(distance[i:]) > FAR:
                    bounds = instant - t[i + 1], instant - t[i - 1]
                    lag = float(
                        minimize_scalar(
                            partial(distance_after, instant),
                            bounds=bounds,
                            method="bounded",
                            options={"xatol": 1e-12},
                        ).x
                    )
                    if distance_after(instant, lag) > REPEATS * self.rtol:
                        continue
                    passes = motion(instant - lag * np.arange(int((instant - t[0]) / lag), -1, -1))
                    try:
                        return lag * self._order(instant, lag, passes[:, :n], passes[:, n:])
                    except NotSettled as error:
                        reason = error
                        # Longer lags are multiples of this one.
                        break
        raise reason


@dataclass(frozen=True)
class Measure:
    """The definition of a number that is evaluated over a `SteadyWindow`.

    Attributes
    ----------
    name : str
        Name in commands.
    unit : str
        Unit of the number; ``-`` if it has none.
    function : callable
        Returns the number of a window from the column of its run with a given name; if `from_start`, the number of a
        trajectory from t = 0.
    needs : str or None
        The part of the scene whose elements are measured, and which must not be empty: ``"guides"``,
        ``"frictional_joints"`` or ``"drives"``.
    of : str
        The column of such an element, such as ``"effort"``.
    sampled : bool
        True if it requires samples all over the window; False if events and ends are enough.
    from_start : bool
        True for a number of the motion from its start, which needs no steady state.
    also : str or None
        Another part of the scene, such as ``"bodies"``, whose elements can be measured if they are named.
    element : str
        Name of the measured element; the first one of `needs` if empty.
    """

    name: str
    unit: str
    function: Callable[..., float]
    needs: str | None = None
    of: str = ""
    sampled: bool = False
    from_start: bool = False
    also: str | None = None
    element: str = ""

    @property
    def column(self) -> str:
        """The key of its column in the table of a sweep, which is its name in a command: ``peak-speed:block``."""
        return f"{self.name}:{self.element}" if self.element else self.name

    @property
    def quantity(self) -> Quantity:
        """The quantity of its column."""
        label = f"{self.name} of {self.element}" if self.element else self.name
        return Quantity(self.column, label, "" if self.unit == "-" else self.unit)

    def source(self, scene: Scene) -> str:
        """Return the column of a run that is measured; empty for a measure of the whole mechanism."""
        if not self.needs:
            return ""
        element = self.element or next(iter(getattr(scene, self.needs)))
        return f"{element}.{self.of}"

    def subject(self, scene: Scene) -> str:
        """Return what is measured, in words; empty for a measure of the whole mechanism."""
        element = self.source(scene).rpartition(".")[0]
        guide = scene.guides.get(element)
        return element if guide is None else f"{guide.slider} along {element}"

    def choices(self, scene: Scene) -> list[str]:
        """Return the names of the elements that can be measured."""
        return [name for part in (self.needs, self.also) if part for name in getattr(scene, part)]

    def value(self, window: SteadyWindow) -> float:
        """Return the number of a window, in `unit`."""
        return float(self.function(window, self.source(window.scene)))


def measure_of(text: str) -> Measure:
    """Return the measure with a name, or the one that ``NAME:ELEMENT`` describes, such as ``peak-speed:block``.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    name, colon, element = text.partition(":")
    if name not in MEASURES or (colon and not (element and MEASURES[name].needs)):
        raise InputError(
            f"measures: found {text!r}; expected some of {', '.join(MEASURES)}, threshold; those of an "
            "element also with its name, as peak-speed:NAME"
        )
    return replace(MEASURES[name], element=element)


def stick_fraction(window: SteadyWindow, mode: str) -> float:
    """Return the part of the window in which a frictional joint sticks.

    It follows from located events. Without them, the time between two samples counts if the joint is slower than
    `CREEP_TOLERANCE` at both: at a reversal it is so at one sample only.
    """
    run, length = window.run, window.end - window.start
    if not window.located:
        is_slow = (
            np.abs(run.columns[mode.removesuffix("mode") + "slip_velocity"]) <= CREEP_TOLERANCE
        )
        return np.sum(np.diff(run.t)[is_slow[:-1] & is_slow[1:]]) / length
    since, stuck = window.start, 0.0
    for event in run.events:
        stuck += (event.time - since) * (event.before[mode] == 0)
        since = event.time
    return (stuck + (window.end - since) * (run.columns[mode][-1] == 0)) / length


def peak(window: SteadyWindow, column: str) -> float:
    """Return the largest absolute value of a column, including the values before and after events."""
    return _largest(window, (column,))


def peak_speed(window: SteadyWindow, column: str) -> float:
    """Return the largest speed (m/s) of the slider of a guide along it, or of the centre of mass of a body."""
    element = column.rpartition(".")[0]
    names = tuple(f"{element}.{label}" for label in BODY_COLUMNS[1][:2])
    return _largest(window, names if element in window.scene.bodies else (column,))


def _largest(window: SteadyWindow, columns: Sequence[str]) -> float:
    """Return the largest magnitude of the vector whose components are some columns."""
    run = window.run
    sides = [
        np.hypot.reduce([side[name] for name in columns])
        for event in run.events
        for side in (event.before, event.after)
    ]
    sampled = np.sqrt(np.sum([run.columns[name] ** 2 for name in columns], axis=0))
    return max(np.max(sampled), *sides, 0.0)


def event_count(window: SteadyWindow, _: str) -> float:
    """Return the number of events, that is, of changes of the contact mode, in the window.

    Raises
    ------
    Refused
        If the run does not locate them.
    """
    if not window.located:
        raise Refused("event-count: the engine does not locate events")
    return len(window.run.events)


MEASURES = {
    measure.name: measure
    for measure in (
        Measure("stick-fraction", "-", stick_fraction, needs="frictional_joints", of="mode"),
        Measure("peak-torque", "N m", peak, needs="drives", of="effort", sampled=True),
        Measure(
            "peak-speed",
            "m/s",
            peak_speed,
            needs="guides",
            of="slip_velocity",
            sampled=True,
            also="bodies",
        ),
        Measure("event-count", "-", event_count),
        Measure(
            "break-away", "s", break_away, needs="frictional_joints", of="mode", from_start=True
        ),
    )
}
"""The measures by name. Without the name of an element, ``peak-torque`` is that of the first drive (a force in N if it
drives a distance), and ``peak-speed`` that of the slider of the first guide along it."""


def steady_window(scene: Scene, run: SteadyRun, measures: Sequence[Measure]) -> SteadyWindow:
    """Simulate a scene from a start that is moved onto the constraints, and return the window of its steady state.

    The reference uses its event-driven method with projection, unless it is given a step.

    Parameters
    ----------
    measures : sequence of Measure
        The measures for which the window is used. Besides the state, a run of the reference has only their columns.

    Raises
    ------
    SceneError
        If the start cannot be assembled.
    Refused, EngineFailure
        If the engine cannot simulate the scene, or stops before the end.
    """
    try:
        period = excitation_period(scene, run.settle)
    except NoCommonPeriod:
        period = np.nan
    mechanism = Mechanism(scene, "projection")
    if run.is_event_driven_reference:
        return _window_of_reference(scene, mechanism, run, measures, period)
    return _window_of_engine(scene, mechanism, run, period)


def _window_of_reference(
    scene: Scene, mechanism: Mechanism, run: SteadyRun, measures: Sequence[Measure], period: float
) -> SteadyWindow:
    """Simulate with equally spaced samples after `settle`, over as many whole periods as fit.

    In the last period the samples are as close as measures require, since most motions repeat themselves with the
    period of their loads and drives. A motion that takes several periods is integrated again.
    """
    q, v = consistent_start(mechanism, assemble=True)
    settle, t_end = run.settle, run.t_end
    close = t_end
    if period < np.inf:
        periods, samples = _whole_periods(t_end - settle, period, np.inf)
        instants = (
            np.linspace(t_end - periods * period, t_end, samples + 1)
            if periods
            else np.array([settle, t_end])
        )
        if periods and any(measure.sampled for measure in measures):
            close = t_end - period
    else:
        instants = np.linspace(settle, t_end, int(np.ceil((t_end - settle) / SAMPLE_STEP)) + 1)
    columns = {
        measure.source(scene)
        for measure in measures
        if measure.needs and measure.element not in scene.bodies
    }
    columns |= {
        f"{body}.{label}"
        for body in scene.bodies
        for labels in BODY_COLUMNS[: 2 if period < np.inf else 3]
        for label in labels
    }

    def integrated(instants: np.ndarray) -> Integration:
        """Return the integration with output at instants."""
        options = Options(STEP_LIMIT, names=columns, events_behind=float(instants[0]))
        return Integration(mechanism, q, v, instants, t_end, run.rtol, options)

    def samples_from(begin: float) -> np.ndarray:
        """Return instants from a time to the end that are close enough for all measures."""
        return np.linspace(begin, t_end, int(np.ceil((t_end - begin) / SAMPLE_STEP)) + 1)

    # Both kinds of samples are computed in one run: those for the search of the steady state, and those
    # of the last period. An instant that both contain is computed twice.
    instants_of_state = len(instants)
    last_period = samples_from(close) if close < t_end else np.empty(0)
    together = np.concatenate([instants, last_period])
    order = np.argsort(together, kind="stable")
    integration = integrated(together[order])
    complete = _ended(integration.run)
    is_of_state = order < instants_of_state
    whole = _at(complete, is_of_state)

    def sampled(begin: float) -> Run:
        """Return the run from a time to its end, with close samples."""
        if begin >= close * (1 - 1e-12):
            return _at(complete, ~is_of_state)
        return _ended(integrated(samples_from(begin)).run)

    return SteadyWindow(
        scene,
        mechanism,
        integration,
        whole,
        True,
        settle,
        t_end,
        period,
        run.rtol,
        sampled if close < t_end else None,
    )


def run_from_start(scene: Scene, run: SteadyRun) -> Trajectory:
    """Simulate a scene from a start that is moved onto the constraints, with samples for measures of its start.

    Raises
    ------
    SceneError, Refused, EngineFailure
        As `steady_window`.
    """
    step = run.step(scene)
    accuracy = {"rtol": run.rtol} if step is None else {"dt": step}
    return _ended(
        load_engine(run.engine).simulate(
            with_consistent_start(scene, assemble=True),
            t_end=run.t_end,
            output_step=step or SAMPLE_STEP,
            fidelity=run.fidelity,
            **accuracy,
        )
    )


def _at(run: Run, chosen: np.ndarray) -> Run:
    """Return a run at chosen samples only."""
    columns = {name: values[chosen] for name, values in run.columns.items()}
    return replace(run, t=run.t[chosen], columns=columns)


def _whole_periods(time: float, period: float, longest: float) -> tuple[int, int]:
    """Return the number of whole periods in a time (s), and of samples in them that are at most `longest` s apart."""
    periods = int(time / period * (1 + 1e-12))
    return periods, periods * max(FEWEST_SAMPLES, int(np.ceil(period / longest)))


def _window_of_engine(
    scene: Scene, mechanism: Mechanism, run: SteadyRun, period: float
) -> SteadyWindow:
    """Simulate up to the last whole period; a period is a whole number of samples, and these of steps."""
    largest_step = run.step(scene)
    # Samples are at least two steps apart.
    finest = max(SHORTEST_STICK, 2 * (largest_step or 0.0))
    end, count = run.t_end, int(np.ceil(run.t_end / finest))
    if period <= run.t_end:
        periods, count = _whole_periods(run.t_end, period, finest)
        end = periods * period
    sample_step = end / count
    accuracy = (
        {"dt": sample_step / math.ceil(sample_step / largest_step)}
        if largest_step
        else {"rtol": run.rtol}
    )
    trajectory = _ended(
        load_engine(run.engine).simulate(
            with_consistent_start(scene, assemble=True),
            t_end=end,
            output_step=sample_step,
            fidelity=run.fidelity,
            **accuracy,
        )
    )
    instants = np.linspace(0.0, end, count + 1)
    sampled = trajectory.t
    if len(sampled) != len(instants) or not np.allclose(
        sampled, instants, rtol=0.0, atol=OFF_GRID * sample_step
    ):
        raise EngineFailure(
            f"found {len(sampled)} samples to {sampled[-1]:g} s; expected {len(instants)} to {end:g} s, "
            f"every {sample_step:g} s"
        )
    behind = instants >= run.settle * (1 - 1e-12)
    columns = {name: values[behind] for name, values in trajectory.columns.items()}
    whole = replace(trajectory, t=instants[behind], columns=columns)
    q, v = (
        np.array([columns[f"{body}.{label}"][-1] for body in scene.bodies for label in labels])
        for labels in BODY_COLUMNS[:2]
    )
    integration = Integration(mechanism, q, v, instants[:1], end, run.rtol)
    located = trajectory.settings[EVENTS_LOCATED_BY] != "nobody"
    return SteadyWindow(
        scene, mechanism, integration, whole, located, run.settle, end, period, run.rtol
    )


Ended = TypeVar("Ended", Run, Trajectory)


def _ended(run: Ended) -> Ended:
    """Return a run that has reached its end; raise EngineFailure with the reason of the run otherwise."""
    if run.termination != "end":
        raise EngineFailure(run.termination)
    return run
