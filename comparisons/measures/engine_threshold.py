"""The search of an engine's stick threshold: at which values of a parameter its steady state has a stick phase.

An engine that locates events is given time until its motion repeats itself, and any stick event counts. The motion of
another one is sampled, and counts as sticking where it is slow for long enough (`settling.CREEP_TOLERANCE`,
`settling.SHORTEST_STICK`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.measures.reference_bands import AMPLITUDE
from stiction.comparisons.measures.settling import (
    CREEP_TOLERANCE,
    MOST_PERIODS,
    SHORTEST_STICK,
    NoCommonPeriod,
    NotSettled,
    common_period,
    settled,
)
from stiction.engines.protocol import EngineFailure
from stiction.engines.registry import load_engine
from stiction.engines.status import Status
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.columns import BODY_COLUMNS

SETTLE_PERIODS = 4
"""Periods before the window of a sampled motion. By then the transients of the paper's example have decayed to about
the errors of the coarse steps with which such motions are computed."""
WINDOW_PERIODS = 1
"""Length of that window in periods: the steady states of the paper's cases repeat themselves after one."""
FIRST_SETTLING = 30
"""Periods that a motion with located events is given at first; see `reference_bands.FIRST_PERIODS`."""
MOST_SETTLING = 960
"""Periods after which a motion with located events counts as not settled."""
REST_PART = 1e-6
"""Part of the distance from the origin that is the unit of length of bodies at rest: rounding leaves 1e-16 of it."""
FIRST_STEP = 8
"""Length of the first step of a search that begins near the threshold, in widths of the bracket: as far as a refinement
of the step usually shifts it."""


@dataclass(frozen=True)
class Threshold:
    """A bracket of the threshold, in the unit of the varied parameter.

    Attributes
    ----------
    with_stick, without_stick : float or None
        Value with a stick phase, and the value beyond it without one.
    runs : int
        Number of simulations.
    remark : str
        The reason why a value is missing.
    residual : float
        Largest shift of the threshold by the rest of the transient, where events are located.
    status : Status
        `Status.NOT_FOUND` if the range contains no threshold, which is an answer and no failure of the runs;
        `Status.NO_STEADY_STATE` if a motion did not settle.
    """

    with_stick: float | None
    without_stick: float | None
    runs: int
    remark: str = ""
    residual: float = 0.0
    status: Status = Status.OK


@dataclass(frozen=True)
class Search:
    """The search of one end of a band between two values of a parameter.

    Attributes
    ----------
    low, high : float
        The search is given up unless the steady state has a stick phase at one of them alone: at the low one, or at the
        high one if `is_lower_end`.
    width : float
        Width of the final bracket.
    near : float, optional
        Where the end may be. From there on, steps that double enclose it: where it is near, that takes half as many
        runs as halving the whole range, which is done without `near`.
    first : float, optional
        Length of the first step from `near`; `FIRST_STEP` brackets if not given.
    is_lower_end : bool
        True if the band lies above the end.
    """

    low: float
    high: float
    width: float
    near: float | None = None
    first: float | None = None
    is_lower_end: bool = False


@dataclass
class StickProbe:
    """Runs of an engine, each at one value of a parameter, and whether their steady states have a stick phase.

    The start is assembled at each value, as it is in the runs of the reference that yield the true bands: where the
    value enters the constraints or the laws of drives, the start of the scene's own value violates them. The period is
    that of the value, too, as the value may be the speed of a drive.

    Attributes
    ----------
    scene : Scene
        The mechanism; loads and drives must have a common period, at each value.
    engine : str
        Name of the engine.
    arguments : Mapping
        Arguments of `Engine.simulate`. With ``dt`` the motion is sampled, else its events are located.
    parameter : str
        Key of the varied value, as in `vary`.
    joint : str
        Name of the guide or pin; the first guide with friction, or the first such pin, where empty.
    seen : dict
        By value, whether the steady state has a stick phase, and the median speed (m/s) of the slowest stretch of a
        sampled motion.
    runs : int
        Number of simulations so far.
    settle_periods : int
        Periods after which the last motion with located events had settled.
    residual : float
        Largest shift of an end by the rest of the transient so far, in the unit of the parameter.
    """

    scene: Scene
    engine: str
    arguments: Mapping[str, Any]
    parameter: str = AMPLITUDE
    joint: str = ""
    seen: dict[float, tuple[bool, float | None]] = field(default_factory=dict)
    runs: int = 0
    settle_periods: int = FIRST_SETTLING
    residual: float = 0.0

    def __post_init__(self) -> None:
        common_period(self.scene)  # raises NoCommonPeriod before any run
        self.guide = self.joint or next(
            iter(self.scene.frictional_guides | self.scene.frictional_joints)
        )

    def sticks(self, value: float) -> bool:
        """Return True if the steady state at a value has a stick phase; raises NotSettled where there is none."""
        if value not in self.seen:
            if "dt" in self.arguments:
                self.seen[value] = self._sampled(value, self.arguments["dt"])
            else:
                self.seen[value] = self._located(value)
        return self.seen[value][0]

    def bracket(
        self,
        with_stick: float | None,
        without_stick: float | None,
        remark: str = "",
        status: Status = Status.OK,
    ) -> Threshold:
        """Return the result of a search that ends with this bracket."""
        return Threshold(with_stick, without_stick, self.runs, remark, self.residual, status)

    def _scene_at(self, value: float) -> tuple[Scene, float]:
        """Return the scene with a value, its start assembled, and the period of its loads and drives, s."""
        varied = vary(self.scene, {self.parameter: value})
        try:
            period = common_period(varied)
        except NoCommonPeriod as error:
            raise NotSettled(
                f"no steady state at {self.parameter} = {value:.9g}: {error}"
            ) from error
        return with_consistent_start(varied, assemble=True), period

    def _simulate(self, value: float, scene: Scene, end: float, output_step: float) -> Trajectory:
        run = load_engine(self.engine).simulate(
            scene,
            t_end=end,
            output_step=output_step,
            **self.arguments,
        )
        if run.termination != "end":
            raise EngineFailure(f"{self.parameter} = {value:g}: {run.termination}")
        self.runs += 1
        return run

    def _sampled(self, value: float, step: float) -> tuple[bool, float]:
        scene, period = self._scene_at(value)
        run = self._simulate(value, scene, (SETTLE_PERIODS + WINDOW_PERIODS) * period, step)
        return sticks(run, self.guide, SETTLE_PERIODS * period, step)

    def _located(self, value: float) -> tuple[bool, None]:
        scene, period = self._scene_at(value)
        periods = self.settle_periods
        while periods <= MOST_SETTLING:
            run = self._simulate(value, scene, periods * period, period)
            states = scaled_states(run, list(scene.bodies), period)
            state = settled(states[: periods + 1], size=1.0)
            if state is not None:
                self.settle_periods = periods
                self.residual = max(self.residual, state.distance * abs(value))
                start = (periods - state.order) * period * (1 - 1e-12)
                return sticks(run, self.guide, start, 0.0)[0], None
            periods *= 2
        raise NotSettled(
            f"not settled after {periods // 2} periods of {period:g} s at {self.parameter} = "
            f"{value:.9g}: no steady state of up to {MOST_PERIODS} periods"
        )


def scaled_states(run: Trajectory, bodies: Sequence[str], period: float) -> np.ndarray:
    """Return the states of all bodies at the samples of a run, one row each, in units of their own size.

    All bodies count, with their velocities: a slider may stay where it is for many periods while the others are still
    approaching their steady state, and set it in motion later. Of an angle the cosine and the sine are taken, since a
    drive that turns is in the same state after each turn.

    Parameters
    ----------
    run : Trajectory
        Samples every period.
    bodies : sequence of str
        Names of the bodies.
    period : float
        Period of loads and drives, s.
    """
    (x, y, angle), (vx, vy, rate) = BODY_COLUMNS[:2]
    places = np.column_stack([run[f"{body}.{label}"] for body in bodies for label in (x, y)])
    angles = np.column_stack([run[f"{body}.{angle}"] for body in bodies])
    speeds = np.column_stack([run[f"{body}.{label}"] for body in bodies for label in (vx, vy)])
    rates = np.column_stack([run[f"{body}.{rate}"] for body in bodies])

    # Units are the largest numbers of each kind. Where these are rounding errors, as of a mechanism
    # at rest, the units are larger.
    longest_way = float(np.max(np.ptp(places, axis=0)))
    length = max(longest_way, REST_PART * float(np.max(np.abs(places)))) or 1.0
    speed = max(float(np.max(np.abs(speeds))), length / period)
    angular_speed = max(float(np.max(np.abs(rates))), 1.0 / period)
    return np.hstack(
        [
            places / length,
            np.cos(angles),
            np.sin(angles),
            speeds / speed,
            rates / angular_speed,
        ]
    )


def sticks(run: Trajectory, guide: str, start: float, step: float) -> tuple[bool, float]:
    """Return True if the guide sticks after `start` seconds, and the median speed (m/s) of its slowest stretch."""
    window = run.t >= start

    # The slowest stretch that is long enough to count as a stick phase.
    t, speed = run.t[window], np.abs(run[f"{guide}.slip_velocity"][window])
    count = max(2, int(round(max(SHORTEST_STICK, 2 * step) / np.median(np.diff(t)))) + 1)
    stretches = np.lib.stride_tricks.sliding_window_view(speed, min(count, len(speed)))
    worst = stretches.max(axis=1)
    slowest = int(np.argmin(worst))
    creep = float(np.median(stretches[slowest]))

    # Located events see a stick phase however short it is.
    if run.settings.get("method") == "event":
        events = [event for event in run.events if event.kind == "stick" and event.joint == guide]
        return bool(
            np.any(run[f"{guide}.mode"][window] == 0)
            or any(event.time >= start for event in events)
        ), creep
    return bool(worst[slowest] <= CREEP_TOLERANCE), creep


def measure_threshold(
    scene: Scene,
    engine: str,
    arguments: Mapping[str, Any],
    search: Search,
    parameter: str = AMPLITUDE,
    joint: str = "",
) -> Threshold:
    """Bracket one end of a band by an engine; see `Search` and `StickProbe`."""
    probe = StickProbe(scene, engine, arguments, parameter, joint)

    def is_below(value: float) -> bool:
        """Return True on the lower side of the end."""
        return probe.sticks(value) != search.is_lower_end

    try:
        low, high = _ends(is_below, search)
        inside, outside = (high, low) if search.is_lower_end else (low, high)
        if not probe.sticks(inside):
            creep = probe.seen[inside][1]
            slowest = "" if creep is None else f": the slowest stretch moves at {creep:.2g} m/s"
            remark = f"no stick phase at {parameter} = {inside:g}{slowest}"
            return probe.bracket(None, None, remark, Status.NOT_FOUND)
        if probe.sticks(outside):
            remark = f"still a stick phase at {parameter} = {outside:g}"
            return probe.bracket(outside, None, remark, Status.NOT_FOUND)
        while high - low > search.width:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_below(middle) else (low, middle)
    except NotSettled as error:
        return probe.bracket(None, None, str(error), Status.NO_STEADY_STATE)
    return probe.bracket(high, low) if search.is_lower_end else probe.bracket(low, high)


def measure_series(
    scene: Scene,
    variant: Variant,
    search: Search,
    parameter: str = AMPLITUDE,
    joint: str = "",
) -> tuple[Threshold, ...]:
    """Bracket an end at each step from coarse to fine; each search begins at the bracket before."""
    thresholds: list[Threshold] = []
    for step in variant.ladder:
        threshold = measure_threshold(
            scene, variant.engine, arguments_of(variant, step), search, parameter, joint
        )
        thresholds.append(threshold)
        inside, outside = threshold.with_stick, threshold.without_stick
        if inside is not None and outside is not None:
            search = replace(search, near=inside, first=FIRST_STEP * abs(outside - inside))
    return tuple(thresholds)


def arguments_of(variant: Variant, step: float) -> dict[str, Any]:
    """Return the arguments of `Engine.simulate` for a step or tolerance of a variant."""
    return {variant.parameter: step, "fidelity": variant.fidelity, **variant.settings}


def _ends(is_below: Callable[[float], bool], search: Search) -> tuple[float, float]:
    """Return the values between which the range is halved."""
    if search.near is None:
        return search.low, search.high
    first = search.first or FIRST_STEP * search.width
    return around(is_below, search.near, search.low, search.high, first)


def around(
    is_below: Callable[[float], bool], near: float, low: float, high: float, step: float
) -> tuple[float, float]:
    """Return two values around an end, the first of them below it.

    Steps from `near` on double until one has passed the end, or is `low` or `high`.
    """
    is_near_below, edge = is_below(near), near
    while True:
        other = min(edge + step, high) if is_near_below else max(edge - step, low)
        if other in (low, high) or is_below(other) != is_near_below:
            return (edge, other) if is_near_below else (other, edge)
        edge, step = other, 2 * step
