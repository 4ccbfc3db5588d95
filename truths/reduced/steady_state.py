"""Steady states of the slider-bar as fixed points of its return map, and the threshold of stick phases.

The threshold is the upper end of one band of F0 with stick phases, the one next to the scene's own F0. Above it the
slider may stick again.

Load and bar have a common period T; the return map takes (x, v) at time 0 to (x, v) at n T. The motion is followed from
its start until it nearly repeats itself after n <= 8 periods. Then Newton's method finds the fixed point, and the
eigenvalues of the map's Jacobian (the multipliers) decide whether it attracts. A slider that rests all the time is at a
fixed point without Newton's help, one of a continuum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import BarycentricInterpolator

from stiction.scenes import InputError, Scene
from stiction.truths.reduced.piecewise_smooth import Collocation, Motion, NoMotion, integrate
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.truth import TruthRefused

MOST_PERIODS = 8
"""Subharmonics of higher order count as not periodic."""
SETTLING = 400
"""Periods after which a motion that has not come near a fixed point is given up."""
DEFINITION = (
    "upper end of the band of F0, next to the scene's own, for which the steady state reached from the "
    "scene's start has a stick phase"
)

_STEPS, _CHECK = Collocation(order=20, longest_step=0.5), Collocation(order=16, longest_step=0.2)
_NEAR = (
    1e-2  # of the motion's size: repeats itself as closely as this before Newton's method is tried
)
_RESIDUAL = 1e-11  # m and m/s
_DIFFERENCE = 1e-7  # m and m/s; of the Jacobian by central differences
_ROUNDING = np.finfo(float).eps
_PARTS = 8  # of a bracket of 1e-3 F0: the distance at which steady states are compared
_SEEN = 1e-6  # of F0, above the end of a steady state: nearer to it the motion from the start is not followed
_NODES = 5  # of an extrapolation over so short a step that degree 4 leaves rounding


class NoSteadyState(TruthRefused):
    """No attracting periodic motion was found: quasi-periodic, chaotic, of a high order, or a very slow transient."""


@dataclass(frozen=True)
class SteadyState:
    """An attracting periodic motion over `periods` common periods of load and bar, from t = 0.

    `multipliers` are those of the return map (empty at rest), `residual` is the largest change of (x, v) over the
    motion, m and m/s.
    """

    periods: int
    motion: Motion
    multipliers: tuple[complex, ...]
    residual: float

    @property
    def state(self) -> np.ndarray:
        """(x, v) at t = 0."""
        return np.ravel(self.motion.state(np.zeros(1), np.zeros(1, dtype=int)))

    @property
    def sticks(self) -> bool:
        return any(segment.mode[0] == 0 for segment in self.motion.segments)


def steady_state(mechanism: SliderBar) -> SteadyState:
    """Find the periodic motion that is reached from the mechanism's start.

    Raises NoSteadyState if within `SETTLING` periods none of up to `MOST_PERIODS` periods is reached. NoMotion is
    raised where the equations have no motion or several on the way, InputError if load and bar have no common period.
    """
    orbit, next_try = [np.array([mechanism.x, mechanism.v], dtype=float)], 0
    for j in range(1, SETTLING + 1):
        motion = _period(mechanism, orbit[-1], 1)
        orbit.append(_end(motion))
        if all(segment.mode[0] == 0 for segment in motion.segments):
            return SteadyState(1, motion, (), 0.0)
        if j < next_try:
            continue
        size = _NEAR * max(
            np.ptp([s[i] for s in orbit[-MOST_PERIODS:]]) + abs(orbit[-1][i]) for i in (0, 1)
        )
        distances = {
            n: np.max(np.abs(orbit[-1] - orbit[-1 - n])) for n in range(1, min(MOST_PERIODS, j) + 1)
        }
        near = [n for n in distances if distances[n] < size]
        for n in dict.fromkeys(near[:1] + sorted(near, key=distances.__getitem__)[:1]):
            found = _newton(mechanism, orbit[-1], n)
            if found is not None and _attracts(mechanism, found, orbit[-1]):
                return found
            next_try = j + 10
    raise NoSteadyState(
        f"no steady state of up to {MOST_PERIODS} periods of {mechanism.period():g} s at F0 = "
        f"{mechanism.F0:.9g} N within {SETTLING} periods"
    )


def _period(mechanism: SliderBar, state: np.ndarray, n: int, steps: Collocation = _STEPS) -> Motion:
    return integrate(mechanism, 0.0, n * mechanism.period(), state[:1], state[1:], steps)


def _end(motion: Motion) -> np.ndarray:
    return np.concatenate(motion.final_state())


def _newton(mechanism: SliderBar, state: np.ndarray, n: int) -> SteadyState | None:
    """Fixed point of n periods near a state; None where Newton's method does not converge."""
    for _ in range(8):
        motion = _period(mechanism, state, n)
        change = _end(motion) - state
        jacobian = np.array(
            [
                (
                    _end(_period(mechanism, state + step, n))
                    - _end(_period(mechanism, state - step, n))
                )
                / (2 * _DIFFERENCE)
                for step in _DIFFERENCE * np.eye(2)
            ]
        ).T
        if np.max(np.abs(change)) <= _RESIDUAL:
            return SteadyState(
                n,
                motion,
                tuple(map(complex, np.linalg.eigvals(jacobian))),
                float(np.max(np.abs(change))),
            )
        matrix = np.eye(2) - jacobian
        if abs(np.linalg.det(matrix)) < 1e-12:
            return None
        state = state + np.linalg.solve(matrix, change)
    return None


def _attracts(mechanism: SliderBar, found: SteadyState, state: np.ndarray) -> bool:
    """Check that the multipliers are within the unit circle, and that the orbit at `state` comes nearer at each pass.

    One without a stick phase attracts only from so near that none is met on the way: the orbit is followed until, for
    three passes, what is left until one is half to one and a half times that of the steady state.
    """
    if max(map(abs, found.multipliers)) >= 1:
        return False
    left = {} if found.sticks else _left_until_rest(mechanism, found.motion)
    distances, near = [np.linalg.norm(state - found.state)], 0
    while near < 3 and len(distances) <= SETTLING:
        motion = _period(mechanism, state, found.periods)
        if left and any(segment.mode[0] == 0 for segment in motion.segments):
            return False
        here, state = _left_until_rest(mechanism, motion) if left else {}, _end(motion)
        alike = all(
            abs(here.get(way, np.inf) - value) < abs(value) / 2 for way, value in left.items()
        )
        near = near + 1 if alike else 0
        distances.append(np.linalg.norm(state - found.state))
    return near == 3 and bool(distances[-1] < distances[0] or distances[-1] < 100 * _RESIDUAL)


@dataclass(frozen=True)
class StickBands:
    """What a scan above a threshold has seen.

    Attributes
    ----------
    bands : tuple of (float, float)
        Smallest and largest F0 (N) seen with a stick phase of each band.
    end, step : float
        N; up to where it went, and the distance of its amplitudes: narrower bands may be missed.
    unknown : tuple of float
        Amplitudes (N) at which no steady state was found.
    """

    bands: tuple[tuple[float, float], ...]
    end: float
    step: float
    unknown: tuple[float, ...] = ()


@dataclass(frozen=True)
class StickThreshold:
    """`DEFINITION`, or why there is none: F0 and its uncertainty in N, both None where there is none.

    The uncertainty is the sum of bracket or extrapolation, residual of the steady state and discretization; where the
    steady state jumps, also the distance from the jump at which the motion from the start was followed. `bracket` are
    the amplitudes with and without a stick phase between which the root was sought. `note` says what coexists with it,
    or the reason where there is no threshold. `theorem` is the proof of it in words: then the uncertainty is a bound.
    `above` is what a scan above it has seen, where one was made.
    """

    F0: float | None
    uncertainty: float | None
    bracket: tuple[float, float]
    note: str = ""
    theorem: str = ""
    above: StickBands | None = None


class NoThreshold(TruthRefused):
    """The threshold is not defined or was not found."""


def stick_threshold(scene: Scene, xtol: float = 1e-11) -> StickThreshold:
    """Find `DEFINITION`; a typed result without a number where there is none.

    In a steady state the slider sticks wherever its velocity reaches zero and the load there is below what static
    friction can hold. The smallest `SliderBar.break_away_margin` over the zeros of velocity is therefore positive
    without and negative with a stick phase. A bracket is sought in steps of a quarter of F0 and halved, each amplitude
    from the start. The steady state without a stick phase at its upper end is followed down. Its limit is where it
    stays at a stop, or comes to rest within a slip phase. That is the threshold if the start leads to a stick phase
    just below and to none just above. Otherwise two steady states coexist: the threshold is that of the start, located
    by halving alone. The note says down to where the other one exists, and where no steady state was found, which ends
    the halving. Raises InputError as `with_threshold`.
    """
    try:
        return _threshold(with_threshold(scene), xtol)
    except (NoSteadyState, NoMotion, NoThreshold) as error:
        return StickThreshold(None, None, (np.nan, np.nan), str(error))


def with_threshold(scene: Scene) -> SliderBar:
    """Return the mechanism of a scene that may have a threshold.

    InputError says that it is no slider-bar, has no friction, or load and bar have no common period.
    """
    mechanism = SliderBar.from_scene(scene)
    if mechanism.contact.frictionless:
        raise InputError(f"{scene.name}: joints.guide has no friction; expected mu > 0")
    mechanism.period()
    return mechanism


def margin(mechanism: SliderBar, steady: SteadyState) -> float:
    """Smallest excess of the load over static friction where the slider stops, N; negative if it sticks."""
    motion, x = steady.motion, _starts(steady.motion)
    stops = [
        mechanism.break_away_margin(switch.time, x[switch.index])
        for switch in motion.switches
        if motion.segments[switch.index - 1].mode[0] and switch.guard == 0
    ]
    if stops:
        return float(min(stops))
    return -np.inf if steady.sticks else np.inf  # at rest; never stops


def _starts(motion: Motion) -> np.ndarray:
    """x at the start of each segment."""
    starts = np.array([segment.start for segment in motion.segments])
    return motion.state(starts, np.arange(len(starts)))[0][0]


def _threshold(mechanism: SliderBar, xtol: float) -> StickThreshold:
    steady: dict[float, SteadyState] = {}

    def sticks(F0: float) -> bool:
        loaded = replace(mechanism, F0=F0)
        steady[F0] = steady_state(loaded)
        return margin(loaded, steady[F0]) < 0

    low = high = mechanism.F0
    while sticks(high):
        low, high = high, 1.25 * high
        if high > 1000 * mechanism.F0:
            raise NoThreshold(f"a stick phase at every F0 up to {low:g} N")
    while low == high or not sticks(low):
        low, high = low / 1.25, low
        if low < mechanism.F0 / 1000:
            raise NoThreshold(f"no stick phase at any F0 down to {high:g} N")
    while high - low > 1e-3 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if sticks(middle) else (low, middle)
    end = _end_of_sliding(mechanism, steady[high], low, high)
    if end is not None:
        (F0, uncertainty, note), bracket, offset = end, (low, high), (high - low) / _PARTS
        sides = F0 - offset, F0 + offset
        if sticks(sides[0]) and not sticks(sides[1]):
            below, above = (margin(replace(mechanism, F0=F0), steady[F0]) for F0 in sides)
            low, high = F0 + _SEEN * F0, sides[1]
            if not sticks(low):
                # a margin that runs on through zero is that of one steady state; above a jump its basin may be small
                jumps = not 0.25 < -below / above < 4
                return StickThreshold(
                    F0, uncertainty + _SEEN * F0 if jumps else uncertainty, bracket, note
                )
    unknown = ""
    while high - low > max(xtol, 1e-9 * high):
        middle = (low + high) / 2
        try:
            low, high = (middle, high) if sticks(middle) else (low, middle)
        except NoSteadyState as error:
            unknown = f"; {error}"
            break
    return StickThreshold(
        (low + high) / 2,
        high - low,
        (low, high),
        f"two steady states coexist: {_lower_end(mechanism, steady[high], high)}{unknown}",
    )


def _left_until_rest(mechanism: SliderBar, motion: Motion) -> dict[tuple[str, int], float]:
    """Distances of a motion of some periods from a stick phase, each positive without one and smooth in F0.

    By slip phase: the break-away margin (N) at its start, and the least speed (m/s) at the instants of x'' = 0 within.
    """
    x, stops, found = _starts(motion), 0, {}
    begun = {switch.index for switch in motion.switches if switch.guard == 0}
    for i, segment in enumerate(motion.segments):
        if i in begun:
            found["stop", stops] = mechanism.break_away_margin(segment.start, x[i])
            stops += 1
        (velocity,) = segment.velocity
        velocity = chebyshev.chebtrim(velocity, _ROUNDING * np.max(np.abs(velocity)))
        times = chebyshev.chebroots(chebyshev.chebder(velocity))
        times = times.real[(np.abs(times.imag) < 1e-9) & (np.abs(times.real) <= 1)]
        times = times[segment.start + (times + 1) / 2 * segment.length <= segment.end]
        phase = "dip", stops % max(len(begun), 1)  # the last is the first of the next period
        if len(times):
            found[phase] = min(
                found.get(phase, np.inf), float(np.min(np.abs(chebyshev.chebval(times, velocity))))
            )
    return found


def _end_of_sliding(
    mechanism: SliderBar, sliding: SteadyState, low: float, high: float
) -> tuple[float, float, str] | None:
    """F0 at which the steady state without a stick phase at `high` gets one; None if it has none down to `low`.

    With its uncertainty and a note.

    Where the slider comes to rest within a slip phase it is held for some time at once: the steady state jumps or
    ends. What is left until then is smooth in F0 down to its zero and not beyond: the zero is extrapolated from above.
    """
    step = (high - low) / _PARTS
    ways = _ways_to_rest(mechanism, sliding, high, step)
    way, end = max(ways.items(), key=lambda item: item[1], default=(("", 0), -np.inf))
    if end < low:
        return None
    amplitudes = end + step * np.arange(1, _NODES + 1)
    steady = [one for F0 in amplitudes if (one := _followed(mechanism, sliding, F0)) is not None]
    if len(steady) < _NODES:
        return None
    check = _period(replace(mechanism, F0=amplitudes[0]), steady[0].state, sliding.periods, _CHECK)
    left = [
        rest
        for F0, motion in zip(
            [*amplitudes, amplitudes[0]], [*(one.motion for one in steady), check]
        )
        if (rest := _left_until_rest(replace(mechanism, F0=F0), motion).get(way)) is not None
    ]
    if len(left) <= _NODES:
        return None
    *values, other = left
    root, coarser = (
        float(BarycentricInterpolator(values[:n], amplitudes[:n])(0.0))
        for n in (_NODES, _NODES - 1)
    )
    if not low < root < high:
        return None
    rate = max(map(abs, sliding.multipliers))
    residual = max([*np.abs(_end(check) - steady[0].state), *(one.residual for one in steady)])
    unsure = abs(values[0] - other) + (
        mechanism.stiffness if way[0] == "stop" else 1.0
    ) * residual / (1 - rate)
    slope = (values[1] - values[0]) / step
    note = (
        ""
        if sliding.periods == 1
        else f"the steady state has {sliding.periods} periods of load and bar"
    )
    return root, abs(root - coarser) + float(2**_NODES * unsure / slope), note


def _ways_to_rest(
    mechanism: SliderBar, sliding: SteadyState, high: float, step: float
) -> dict[tuple[str, int], float]:
    """F0 below `high` at which the steady state there comes to rest, in each of the ways, by a secant."""
    beyond = _followed(mechanism, sliding, high + step)
    if beyond is None:
        return {}
    near, far = (
        _left_until_rest(replace(mechanism, F0=F0), steady.motion)
        for F0, steady in ((high, sliding), (high + step, beyond))
    )
    return {
        way: high - step * near[way] / (far[way] - near[way])
        for way in near
        if far.get(way, -np.inf) > near[way]
    }


def _followed(mechanism: SliderBar, sliding: SteadyState, F0: float) -> SteadyState | None:
    """The steady state without a stick phase near another one, at F0; None if there is none."""
    loaded = replace(mechanism, F0=F0)
    found = _newton(loaded, sliding.state, sliding.periods)
    return (
        None
        if found is None or max(map(abs, found.multipliers)) >= 1 or margin(loaded, found) < 0
        else found
    )


def _lower_end(mechanism: SliderBar, steady: SteadyState, F0: float) -> str:
    """Down to where a steady state without a stick phase exists that is not reached from the start below F0."""
    step = F0 / 50
    while step > 1e-4 * F0:
        found = _followed(mechanism, steady, F0 - step)
        if found is None:
            step /= 2
        else:
            steady, F0 = found, F0 - step
    return f"one without a stick phase, not reached from the start, goes on down to F0 = {F0:.4g} N"
