"""Steady states of the slider-bar as fixed points of its return map, and the ends of its bands of stick phases.

The threshold is the upper end of one band of F0 with stick phases, the one next to the scene's own F0. Above it the
slider may stick again: `truths.reduced.stick_bands` returns all bands of a parameter.

Load and bar have a common period T; the return map takes (x, v) at time 0 to (x, v) at n T. The motion is followed from
its start until it nearly repeats itself after n <= 8 periods. Then Newton's method finds the fixed point, and the
eigenvalues of the map's Jacobian (the multipliers) decide whether it attracts. A slider that rests all the time is at a
fixed point without Newton's help, one of a continuum.
"""

from __future__ import annotations

from collections.abc import Callable
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
"""Discretization of all motions, and another one, with which the uncertainty is estimated."""
_NEAR = 1e-2
"""Part of the motion's size to which it must repeat itself before Newton's method is tried: it converges from there."""
_NEXT_TRY = 10
"""Periods to wait after Newton's method has failed: it costs about five periods for each of its iterations."""
_RESIDUAL = 1e-11
"""Change of (x, v) over a period at a fixed point, m and m/s: what rounding leaves of it."""
_DIFFERENCE = 1e-7
"""Step of the Jacobian by central differences, m and m/s.

It is short, so that the sequence of events is the same on both sides. Rounding of the end state,
some 1e-14, leaves 1e-7 of a derivative: enough for multipliers, and for Newton's method to
converge.
"""
_MOST_NEWTON = 8
"""Newton iterations: from `_NEAR` the method converges fast or not at all."""
_SINGULAR = 1e-12
"""Determinant of 1 - DP below which Newton's step is not defined: a multiplier of 1, as on a continuum of rest."""
_PASSES = 3
"""Successive passes that must resemble the steady state: one alone may be chance."""
_LARGE_RESIDUAL = 100 * _RESIDUAL
"""Distance from a fixed point within which an orbit does not have to come nearer, m and m/s."""
_REAL = 1e-9
"""Imaginary part up to which a root on [-1, 1] counts as real."""
_ROUNDING = np.finfo(float).eps
_SEARCH = 1.25
"""Ratio of successive amplitudes in the search of a bracket."""
_FARTHEST = 1000
"""Ratio to the scene's own amplitude at which that search ends, in both directions."""
_BRACKET = 1e-3
"""Width of the bracket, relative to F0, within which the steady state is followed to its end."""
_PARTS = 8
"""Parts of that bracket, of which one is the distance at which steady states are compared."""
_SEEN = 1e-6
"""Part of F0, above the end of a steady state: nearer to it the motion from the start is not followed."""
_CONTINUES = 4.0
"""Ratio of the margins on both sides of their zero up to which they are those of one steady state."""
_RESOLUTION = 1e-9
"""Relative width of the bracket at which halving ends, unless a larger one is asked for; it is the uncertainty."""
_NODES = 5
"""Nodes of an extrapolation over so short a step that degree 4 leaves rounding."""
_FOLLOWED_FROM, _FOLLOWED_TO = 50, 1e-4
"""F0 over the first step, and last step over F0, in which a coexisting steady state is followed down for a note."""


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
        # A slider that rests throughout a period does so ever after.
        if all(segment.mode[0] == 0 for segment in motion.segments):
            return SteadyState(1, motion, (), 0.0)
        if j < next_try:
            continue

        # After how many periods the orbit nearly repeats itself, measured by its size.
        near_enough = _NEAR * max(
            np.ptp([s[i] for s in orbit[-MOST_PERIODS:]]) + abs(orbit[-1][i]) for i in (0, 1)
        )
        distances = {
            n: np.max(np.abs(orbit[-1] - orbit[-1 - n])) for n in range(1, min(MOST_PERIODS, j) + 1)
        }
        near = [n for n in distances if distances[n] < near_enough]

        # Two guesses of n: the smallest, and the one of the closest return. A period-two motion
        # close to its bifurcation nearly repeats itself after one period already.
        for n in dict.fromkeys(near[:1] + sorted(near, key=distances.__getitem__)[:1]):
            fixed_point = _newton(mechanism, orbit[-1], n)
            if fixed_point is not None and _attracts(mechanism, fixed_point, orbit[-1]):
                return fixed_point
            next_try = j + _NEXT_TRY
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
    for _ in range(_MOST_NEWTON):
        motion = _period(mechanism, state, n)
        change = _end(motion) - state
        # The map is smooth near a motion whose sequence of events does not change; motions are
        # exact to rounding, so that differences serve.
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
        # The multipliers are those at the fixed point itself: the test comes after its Jacobian.
        if np.max(np.abs(change)) <= _RESIDUAL:
            return SteadyState(
                n,
                motion,
                tuple(map(complex, np.linalg.eigvals(jacobian))),
                float(np.max(np.abs(change))),
            )
        matrix = np.eye(2) - jacobian
        if abs(np.linalg.det(matrix)) < _SINGULAR:
            return None
        state = state + np.linalg.solve(matrix, change)
    return None


def _attracts(mechanism: SliderBar, fixed_point: SteadyState, state: np.ndarray) -> bool:
    """Check that the multipliers are within the unit circle, and that the orbit at `state` comes nearer at each pass.

    A steady state without a stick phase attracts only from so near that no stick phase is met on
    the way. The orbit is followed until, for `_PASSES` passes, its distances from a stick phase
    (`_left_until_rest`) are half to one and a half times those of the steady state.
    """
    if max(map(abs, fixed_point.multipliers)) >= 1:
        return False
    left = {} if fixed_point.sticks else _left_until_rest(mechanism, fixed_point.motion)
    distances, near = [np.linalg.norm(state - fixed_point.state)], 0
    while near < _PASSES and len(distances) <= SETTLING:
        motion = _period(mechanism, state, fixed_point.periods)
        # A stick phase on the way: where the orbit goes after it the multipliers do not tell.
        if left and any(segment.mode[0] == 0 for segment in motion.segments):
            return False
        orbit_left = _left_until_rest(mechanism, motion) if left else {}
        state = _end(motion)
        alike = all(
            abs(orbit_left.get(way, np.inf) - value) < abs(value) / 2 for way, value in left.items()
        )
        near = near + 1 if alike else 0
        distances.append(np.linalg.norm(state - fixed_point.state))
    comes_nearer = distances[-1] < distances[0] or distances[-1] < _LARGE_RESIDUAL
    return near == _PASSES and bool(comes_nearer)


@dataclass(frozen=True)
class StickThreshold:
    """The threshold of `DEFINITION`: F0 and its uncertainty in N, both None if there is no threshold.

    The uncertainty is the sum of the errors of bracket or extrapolation, of the residual of the
    steady state, and of the discretization. Where the steady state jumps, the distance from the
    jump at which the motion from the start was followed is added. `bracket` contains the amplitudes
    with and without a stick phase between which the root was sought. `note` describes a coexisting
    steady state, or gives the reason why there is no threshold. `theorem` is the proof in words;
    with it the uncertainty is a bound.
    """

    F0: float | None
    uncertainty: float | None
    bracket: tuple[float, float]
    note: str = ""
    theorem: str = ""


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
    """Bracket the threshold from the mechanism's own F0, and refine it."""
    steady: dict[float, SteadyState] = {}

    def loaded(F0: float) -> SliderBar:
        return replace(mechanism, F0=F0)

    def sticks(F0: float) -> bool:
        steady[F0] = steady_state(loaded(F0))
        return margin(loaded(F0), steady[F0]) < 0

    # Upwards from the scene's own amplitude to the first one without a stick phase, else downwards
    # to one with a stick phase.
    low = high = mechanism.F0
    while sticks(high):
        low, high = high, _SEARCH * high
        if high > _FARTHEST * mechanism.F0:
            raise NoThreshold(f"a stick phase at every F0 up to {low:g} N")
    while low == high or not sticks(low):
        low, high = low / _SEARCH, low
        if low < mechanism.F0 / _FARTHEST:
            raise NoThreshold(f"no stick phase at any F0 down to {high:g} N")
    while high - low > _BRACKET * high:
        middle = (low + high) / 2
        low, high = (middle, high) if sticks(middle) else (low, middle)

    end = refined_end(loaded, low, high, steady[high], xtol)
    note = end.note
    if end.coexisting is not None:
        lower = _lower_end(loaded, end.coexisting, end.outside)
        note = f"two steady states coexist: {lower}{note}"
    return StickThreshold(end.value, end.uncertainty, end.bracket, note)


MechanismAt = Callable[[float], SliderBar]
"""Mechanism at a value of the varied parameter."""


@dataclass(frozen=True)
class StickEnd:
    """An end of a band of a parameter with stick phases.

    Attributes
    ----------
    value, uncertainty : float
        In the unit of the parameter.
    bracket : tuple of float
        Values, the smaller one first, between which the end was sought.
    note : str
        The order of a subharmonic steady state, or the reason why halving has ended early.
    coexisting : SteadyState, optional
        The steady state without a stick phase at `outside`, where it goes on beyond the end, so that the start
        decides between two.
    outside : float
        Value without a stick phase next to the end.
    """

    value: float
    uncertainty: float
    bracket: tuple[float, float]
    note: str = ""
    coexisting: SteadyState | None = None
    outside: float = np.nan


def refined_end(
    at: MechanismAt, inside: float, outside: float, sliding: SteadyState, xtol: float
) -> StickEnd:
    """Refine the end of a band between a value with a stick phase and one without.

    Parameters
    ----------
    inside, outside : float
        The steady state from the mechanism's start has a stick phase at the first, which may be the larger one, and
        none at the second.
    sliding : SteadyState
        That at `outside`.
    xtol : float
        Width of the bracket to which the interval is halved where the steady state cannot be followed to its end;
        `_RESOLUTION` of the value at least.

    Raises
    ------
    NoSteadyState, NoMotion
        If a motion next to the end has none.
    """

    def sticks(value: float) -> bool:
        return margin_at(at, value) < 0

    # The steady state outside is followed to its own end, without transients and to rounding. That
    # is the end of the band only if the motion from the start leads to this steady state just
    # outside, and sticks just inside.
    end = _end_of_sliding(at, sliding, inside, outside)
    if end is not None:
        value, uncertainty, note = end
        bracket = min(inside, outside), max(inside, outside)
        offset = (outside - inside) / _PARTS
        margin_inside, margin_outside = (
            margin_at(at, side) for side in (value - offset, value + offset)
        )
        if margin_inside < 0 <= margin_outside:
            inside, outside = value + np.sign(offset) * _SEEN * abs(value), value + offset
            if not sticks(inside):
                # A margin that runs on through zero is that of one steady state; beside a jump its
                # basin may be small.
                is_jump = not 1 / _CONTINUES < -margin_inside / margin_outside < _CONTINUES
                if is_jump:
                    uncertainty += _SEEN * abs(value)
                return StickEnd(value, uncertainty, bracket, note)

    # Two steady states coexist: which of them the start leads to is found by trial alone.
    unknown = ""
    while abs(outside - inside) > max(xtol, _RESOLUTION * abs(outside)):
        middle = (inside + outside) / 2
        try:
            inside, outside = (middle, outside) if sticks(middle) else (inside, middle)
        except NoSteadyState as error:
            unknown = f"; {error}"
            break
    return StickEnd(
        (inside + outside) / 2,
        abs(outside - inside),
        (min(inside, outside), max(inside, outside)),
        unknown,
        steady_state(at(outside)),
        outside,
    )


def margin_at(at: MechanismAt, value: float) -> float:
    """Return `margin` of the steady state that is reached from the start, at a value of the parameter."""
    mechanism = at(value)
    return margin(mechanism, steady_state(mechanism))


def _left_until_rest(mechanism: SliderBar, motion: Motion) -> dict[tuple[str, int], float]:
    """Distances of a motion of some periods from a stick phase, each positive without one and smooth in F0.

    By slip phase: the break-away margin (N) at its start, and the least speed (m/s) at the instants of x'' = 0 within.
    """
    x, stops = _starts(motion), 0
    distances: dict[tuple[str, int], float] = {}
    begun = {switch.index for switch in motion.switches if switch.guard == 0}
    for i, segment in enumerate(motion.segments):
        # Guard 0 is the speed: the slider has stopped, and a slip phase begins.
        if i in begun:
            distances["stop", stops] = mechanism.break_away_margin(segment.start, x[i])
            stops += 1
        # Extrema of the velocity within the segment, in its own time -1 .. 1.
        (velocity,) = segment.velocity
        velocity = chebyshev.chebtrim(velocity, _ROUNDING * np.max(np.abs(velocity)))
        extrema = chebyshev.chebroots(chebyshev.chebder(velocity))
        extrema = extrema.real[(np.abs(extrema.imag) < _REAL) & (np.abs(extrema.real) <= 1)]
        extrema = extrema[segment.start + (extrema + 1) / 2 * segment.length <= segment.end]
        # the last slip phase is the first of the next period
        phase = "dip", stops % max(len(begun), 1)
        if len(extrema):
            least = float(np.min(np.abs(chebyshev.chebval(extrema, velocity))))
            distances[phase] = min(distances.get(phase, np.inf), least)
    return distances


def _end_of_sliding(
    at: MechanismAt, sliding: SteadyState, inside: float, outside: float
) -> tuple[float, float, str] | None:
    """Return the value at which the steady state without a stick phase at `outside` gets one.

    With it its uncertainty and a note. None if it has no stick phase up to `inside`.

    Where the slider comes to rest within a slip phase it is held for some time at once: the steady state jumps or
    ends. What is left until then is smooth in the parameter down to its zero and not beyond: the zero is extrapolated
    from outside. With `step` directed outwards, the way to a stick phase is met first whose zero is nearest.
    """
    step = (outside - inside) / _PARTS
    ways = _ways_to_rest(at, sliding, outside, step)
    if not ways:
        return None
    way = min(ways, key=lambda name: (outside - ways[name]) / step)
    end = ways[way]
    if (outside - end) / step > _PARTS:
        return None

    # Steady states just outside of that value; the first of them by another discretization too.
    values = end + step * np.arange(1, _NODES + 1)
    followed = [_followed(at, sliding, value) for value in values]
    steady = [state for state in followed if state is not None]
    if len(steady) < _NODES:
        return None
    check = _period(at(values[0]), steady[0].state, sliding.periods, _CHECK)

    # What is left until rest at each of them.
    distances = []
    for value, motion in zip([*values, values[0]], [*(s.motion for s in steady), check]):
        left = _left_until_rest(at(value), motion).get(way)
        if left is None:
            return None
        distances.append(left)
    *distances, checked = distances

    # Inverse interpolation: the parameter as a polynomial in what is left, at zero. The difference
    # to one node less is its error.
    root, coarser = (
        float(BarycentricInterpolator(distances[:n], values[:n])(0.0)) for n in (_NODES, _NODES - 1)
    )
    if not min(inside, outside) < root < max(inside, outside):
        return None

    # Errors of the distances: discretization, and the residual of the steady state, which the map's
    # contraction bounds by residual / (1 - rate); a shift of x changes a break-away margin by the
    # stiffness times as much. Extrapolation amplifies errors by at most the sum of its weights,
    # 2^nodes - 1 for nodes at equal distances.
    rate = max(map(abs, sliding.multipliers))
    residual = max([*np.abs(_end(check) - steady[0].state), *(s.residual for s in steady)])
    per_metre = at(root).stiffness if way[0] == "stop" else 1.0
    unsure = abs(distances[0] - checked) + per_metre * residual / (1 - rate)
    slope = abs((distances[1] - distances[0]) / step)
    note = ""
    if sliding.periods > 1:
        note = f"the steady state has {sliding.periods} periods of load and bar"
    return root, abs(root - coarser) + float(2**_NODES * unsure / slope), note


def _ways_to_rest(
    at: MechanismAt, sliding: SteadyState, outside: float, step: float
) -> dict[tuple[str, int], float]:
    """Estimate by a secant where the steady state at `outside` comes to rest, in each of the ways that it may."""
    beyond = _followed(at, sliding, outside + step)
    if beyond is None:
        return {}
    near = _left_until_rest(at(outside), sliding.motion)
    far = _left_until_rest(at(outside + step), beyond.motion)
    return {
        way: outside - step * near[way] / (far[way] - near[way])
        for way in near
        if far.get(way, -np.inf) > near[way]
    }


def _followed(at: MechanismAt, sliding: SteadyState, value: float) -> SteadyState | None:
    """Return the steady state without a stick phase near another one, at a value; None if there is none."""
    mechanism = at(value)
    state = _newton(mechanism, sliding.state, sliding.periods)
    if state is None or max(map(abs, state.multipliers)) >= 1 or margin(mechanism, state) < 0:
        return None
    return state


def _lower_end(at: MechanismAt, steady: SteadyState, F0: float) -> str:
    """Describe down to which F0 a steady state without a stick phase exists that the start does not lead to."""
    step = F0 / _FOLLOWED_FROM
    while step > _FOLLOWED_TO * F0:
        lower = _followed(at, steady, F0 - step)
        if lower is None:
            step /= 2
        else:
            steady, F0 = lower, F0 - step
    return f"one without a stick phase, not reached from the start, goes on down to F0 = {F0:.4g} N"
