"""Event location: the place in a step at which an event function becomes zero, compiled.

Three ways, from cheap to thorough. The event functions at the stages of a step tell where the next of them will be
zero; the step after it is made to end there (`zero_near_end`). The same values tell, by a bound, that no other function
has a zero within a step (`may_vanish`). Only where that bound fails is the step searched with its dense output
(`first_root`), and repeated with the length found. Either way what is left is made up for by the secant method on the
event function (`go_to_event`), each correction a Runge-Kutta step, so that the state at an event is as accurate as any
other. `event_driven._locate` calls them in this order.

Guarantee. Within a mode an event function g is smooth (`frozen_mode.event_functions`). Let p be its polynomial
through n + 1 points of an interval. The Bernstein coefficients b_i of p bound it: p >= min b_i on the whole interval.
Hence g > 0 wherever

    min b_i > tau ,    tau >= |g - p| on the interval.

A step passes only if this holds on each interval of a division of it. n is 4 for the whole step, and 8 for the parts of
a searched one. That is divided until the bound holds, until a zero is enclosed, or until tau is below rounding. One
exception: a function may be unresolved in a FINEST part, or after PARTS parts of steps that were shortened for it, as
one that jumps or is noise near zero. It is judged by its values at the nodes. tau is an estimate, not a proof: from
values of g that p does not use, or from the last two of its Chebyshev coefficients. It is right where g is resolved by
the points, that is where its higher derivatives do not change faster than those that are seen: of sinusoids, where the
phase advances by less than 4.5 pi from the first point to the last. For what follows from the motion the control of
errors sees to that. For loads, for what turns, and for what passes a point evenly the motion tells nothing:
`step_limits` bounds the step, and says what it leaves out. A step whose stages disagree with the polynomial by more
than half of what g varies by is made shorter (`are_resolved`), and so is one for whose search PARTS parts are not
enough. The first zero of g below minus its rounding (`integration_state.noise`) is then found to the accuracy of the
dense output.

Names. Kernels take the mechanism m, the workspace w of one instant, and the integration s; e is the index of an event
function, x a fraction of the step, 0 at its start. "Bernstein coefficients" are those of a polynomial on [0, 1]:
p(x) = sum_i b_i C(n, i) x^i (1 - x)^(n - i), a mean of the b_i with positive weights.
"""

from __future__ import annotations

from math import comb

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy, product
from stiction.reference_impl.integration.dop853 import STAGES, C, dense_at
from stiction.reference_impl.integration.integration_state import (
    NO_EVENT,
    NODES,
    NOISE,
    State,
    noise,
)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

SETTLED = 1e-6
"""Part of the step by which a zero of the dense output may still move when it is taken: what that is wrong by is left
to the secant method."""
FOUND = 1e-12
"""Part of the step to which a jump of an event function is located in the dense output."""
BESIDE = 1e-7
"""Part of the step over which the slope of an event function is taken, lest it be rounding, and below which an event
may be at the start of a step."""
SLOPE = 1e-3
"""Part of the step over which the slope that comes with a zero of the dense output was taken, about: by so much it is
wrong."""
LEFT = 1e-12
"""Part of the step by which an event may be missed. It bounds the last correction, made by Euler's method: its error is
the square of the correction, or the correction times the error of the slope."""
NEAR = 0.01
"""Part of the step up to which an event is approached by Runge-Kutta steps of order 4: their error is then 1e-10 of
that of a step of this order as long as the whole one."""
AHEAD = 6.0
"""Steps up to which the polynomial of a step is looked at; no step is longer than so many times the last."""
CORRECTIONS = 4
"""Secant steps to an event at most: a stiff right-hand side may keep them from falling below rounding."""
LONGER = (1.0 + NEAR) ** CORRECTIONS
"""Times its length that these corrections can make a step at most."""
NEWTON_STEPS = 10
"""Steps of Newton's method from the end of a step to a zero of its polynomial. It converges quadratically: where so
many do not settle there is no zero nearby."""
ITERATIONS = 100
"""Steps to a zero of the dense output at most; the bisections among them alone leave 3e-8 of the bracket."""
BISECT_EVERY = 4
"""One step of so many bisects the bracket, so that it shrinks whatever interpolation proposes."""
CONVERGES = 0.1
"""Ratio of the values of two successive steps below which the interpolation is believed to converge; at a jump of the
event function the values do not fall."""
JUMP = 1e3
"""Times what its slope explains by which an event function changes within FOUND where it jumps."""
HALVINGS = 30
"""Bisections towards the start of a step in search of the rise of an event function that began at zero."""
OWN_ZERO = 1e-9
"""An event function at the start of a step below this part of its largest value there had its own event then."""
CREEP = 1e-3
"""Part of the largest speed or force so far by which an event function may be negative where its mode begins. A guide
at rest creeps by the integration error, and does so for an instant when it has broken away: it has no event unless it
falls below where it began. What is further below zero is in the wrong mode, as where redundant guides share their load
anew."""
BELOW_START = 1.001
"""Multiple of the negative value at which a mode began below which its event function has fallen: a little more than
once, as the value has rounding."""

AIMS = (0, 4, 8, 9, 12)
"""Stages, in the order of times, through whose event functions the polynomial of a step is drawn."""
CHECKS = (6, 7, 10)
"""Stages that tell how far from it the event functions are. Earlier ones have states of low order."""
_TIMES = np.sort(C)
_AHEAD = np.linalg.inv(np.vander(_TIMES[list(AIMS)] - 1.0, increasing=True))
"""Matrix from values at the AIMS to the coefficients of their polynomial about the end of the step."""
SAFETY = 4.0
"""Times the largest distance at the CHECKS up to which the polynomial may be wrong. Its error is w(x) g^(5)/5!, w the
product of the distances to the AIMS; the largest |w| on the step, 0.0040, is that at the last of the CHECKS, so that 1
would do for a constant g^(5)."""
SAFETY_AT_ZERO = 120.0
"""SAFETY of a polynomial divided by the distance to one end of the step, where g is zero: |w/x| is 0.11 at most, 26
times |w| at the last of the CHECKS."""

BLURRED = 0.5
"""Distance at the CHECKS from the polynomial, in parts of the variation of an event function among the stages, from
which on the stages do not see how it changes. No sinusoid whose phase advances by less than 2.5 pi in the step is taken
for one, nearly all beyond 4 pi are, and no scene of the catalogue has such a step at tolerances of 1e-6 to 1e-12."""
APPARENT = 1e4
"""Multiple of its rounding from which on an event function is taken to vary; four digits of it are known then."""

_POINTS = 0.5 - 0.5 * np.cos(np.pi * np.arange(NODES + 1) / NODES)
_POINTS[0], _POINTS[-1] = 0.0, 1.0
"""Points of Chebyshev and Lobatto, at which a searched step is sampled."""


def _bernstein(x: np.ndarray) -> np.ndarray:
    """Return the matrix from values at the points x of [0, 1] to the Bernstein coefficients of their polynomial."""
    n = len(x) - 1
    binomial = np.array([comb(n, k) for k in range(n + 1)], dtype=float)
    k = np.arange(n + 1)
    return np.linalg.inv(binomial * x[:, None] ** k * (1.0 - x[:, None]) ** (n - k))


_STAGES_TO_BERNSTEIN = _bernstein(_TIMES[list(AIMS)])
_STAGES_TO_CHECKS = np.vander(_TIMES[list(CHECKS)] - 1.0, len(AIMS), increasing=True) @ _AHEAD
"""Matrix from values at the AIMS to those of their polynomial at the CHECKS."""
_NODES_TO_BERNSTEIN = _bernstein(_POINTS)
_NODES_TO_LAST = np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * _POINTS - 1.0, NODES))[-2:]
"""Matrix from values at the nodes to the last two Chebyshev coefficients."""
TAIL_AT_ZERO = 2.0 * (NODES + 1) ** 2
"""Times tau that a polynomial divided by the distance to the end where it is zero may be wrong: the slope of a
Chebyshev polynomial at its end."""
FINEST = 2.0**-24
"""Part of a step down to which it is divided in search of a zero: a function that falls below zero by 10^-13 of its
size and returns does so within 10^-6 of the time in which it changes."""
PARTS = 512
"""Parts of a step that are searched at most, each at a cost of NODES right-hand sides. A smooth function takes some
twice as many as halvings to FINEST for each zero that it grazes; one that is noise near zero would never end."""
FREE, UNRESOLVED = -1, 0
"""Verdicts on an event function in an interval: no zero, and one that a finer division must decide. Otherwise the first
node behind a zero."""


@kernel
def zero_near_end(at_start: Reals, at_stages: Table, e: int) -> float:
    """Return the distance from the end of the step to the next zero of event function e, in steps.

    A zero that has just been passed counts as well.

    Infinite if none is in sight.

    at_start : event functions at the start of the step.  at_stages : those of its stages, in the order of times.
    """
    # coefficients of the polynomial through the values at the AIMS, in powers of the distance from the end
    c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(AIMS)):
        value = at_start[e] if j == 0 else at_stages[AIMS[j] - 1, e]
        c0 += _AHEAD[0, j] * value
        c1 += _AHEAD[1, j] * value
        c2 += _AHEAD[2, j] * value
        c3 += _AHEAD[3, j] * value
        c4 += _AHEAD[4, j] * value
    # Newton's method from the end of the step. Only a falling function has its event ahead; far ahead, or where it
    # rises, the polynomial predicts nothing.
    x = 0.0
    for _ in range(NEWTON_STEPS):
        slope = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * 4.0 * c4))
        if not (slope < 0.0 and x < AHEAD):
            break
        change = -(c0 + x * (c1 + x * (c2 + x * (c3 + x * c4)))) / slope
        x += change
        if abs(change) < SETTLED:
            return x
    return np.inf


@kernel
def may_vanish(s, expected):
    """Return True where the bound of the module's docstring fails for an event function, on the whole step.

    expected : an event function that is known to have its zero near the end of the step, and is only asked whether it
        has another one before; or NO_EVENT.
    """
    for e in range(len(s.at_start)):
        if not _stays_positive(s.at_start, s.at_stages, e, e == expected, noise(s, e)):
            return True
    return False


@kernel
def falls_to_end(s, e):
    """Return True where event function e is lowest at the end of the step: no zero before one near there."""
    return _stays_positive(s.at_start, s.at_stages, e, True, noise(s, e))


@kernel
def _stays_positive(
    at_start: Reals, at_stages: Table, e: int, falls: bool, rounding: float
) -> bool:
    """Return True where event function e has no zero within the step.

    Zeros at the start of a function that rises from there, and at the end of one that `falls` to it, do not count.
    """
    # Bernstein coefficients v0, b1, .., b4 of the polynomial through the AIMS; the outer two are its end values
    v0, b4 = at_start[e], at_stages[AIMS[-1] - 1, e]
    b1, b2, b3 = 0.0, 0.0, 0.0
    largest = 0.0
    for j in range(len(AIMS)):
        value = v0 if j == 0 else at_stages[AIMS[j] - 1, e]
        largest = max(largest, abs(value))
        b1 += _STAGES_TO_BERNSTEIN[1, j] * value
        b2 += _STAGES_TO_BERNSTEIN[2, j] * value
        b3 += _STAGES_TO_BERNSTEIN[3, j] * value

    # distance of the function from the polynomial, at stages that the polynomial does not use
    distance = 0.0
    for k in range(len(CHECKS)):
        value, predicted = at_stages[CHECKS[k] - 1, e], 0.0
        for j in range(len(AIMS)):
            predicted += _STAGES_TO_CHECKS[k, j] * (v0 if j == 0 else at_stages[AIMS[j] - 1, e])
        largest = max(largest, abs(value))
        distance = max(distance, abs(value - predicted))
    if largest <= rounding:
        return True  # zero throughout, as of a guide without load: no change of sign is to be seen

    # A function that is zero at an end of the step is positive in between where the polynomial divided by the distance
    # to that end is. That quotient is a polynomial of degree 3, whose Bernstein coefficients follow from the b_i.
    begins = v0 >= -CREEP / NOISE * rounding
    if falls:
        # (p - p(1)) / (1 - x)
        lowest = min(v0 - b4, 4.0 / 3.0 * (b1 - b4), 2.0 * (b2 - b4), 4.0 * (b3 - b4))
        if begins and v0 <= OWN_ZERO * largest:
            # zero at both ends: p = b4 x + x (1 - x) r is positive between its zeros where r is
            lowest = min(4.0 * b1 - b4, 2.0 * b2 - b4, 4.0 / 3.0 * b3 - b4)
            return lowest > 4.0 * SAFETY_AT_ZERO * distance
        return lowest > SAFETY_AT_ZERO * distance
    # (p - p(0)) / x, for a function that is zero at the start, after its own event, and rises
    if (
        begins
        and min(4.0 * (b1 - v0), 2.0 * (b2 - v0), 4.0 / 3.0 * (b3 - v0), b4 - v0)
        > SAFETY_AT_ZERO * distance
    ):
        return True
    # the bound of the module's docstring
    return min(v0, b1, b2, b3, b4) > SAFETY * distance


@kernel
def are_resolved(s):
    """Return True where the stages of the step see how the event functions change: none is BLURRED.

    This is to the forces what the estimate of its error is to the motion.
    """
    for e in range(len(s.at_start)):
        # the variation of the function among the stages; one that hardly varies is seen
        low, high = s.at_start[e], s.at_start[e]
        for i in range(STAGES):
            low = min(low, s.at_stages[i, e])
            high = max(high, s.at_stages[i, e])
        if not high - low > APPARENT * noise(s, e):
            continue
        # its distance from the polynomial through the AIMS
        distance = 0.0
        for k in range(len(CHECKS)):
            value, predicted = s.at_stages[CHECKS[k] - 1, e], 0.0
            for j in range(len(AIMS)):
                at_aim = s.at_start[e] if j == 0 else s.at_stages[AIMS[j] - 1, e]
                predicted += _STAGES_TO_CHECKS[k, j] * at_aim
            distance = max(distance, abs(value - predicted))
        if distance > BLURRED * (high - low):
            return False
    return True


@kernel
def _no_other_is_negative(w, s, own):
    """Return True where no event function but `own` is negative."""
    for e in range(len(w.event)):
        if e != own and w.event[e] < -noise(s, e):
            return False
    return True


@kernel
def _evaluate(m, w, s, x):
    """Evaluate the event functions at the fraction x of the step, from its dense output."""
    dense_at(s.F, s.y, x, s.probe)
    right_hand_side(m, w, s.progress.time + x * s.attempt.h, s.probe, s.slip, s.corner, s.dy)


@kernel
def first_root(m: Arrays, w: Workspace, s: State) -> tuple[float, int, float]:
    """Find the first zero of an event function within the step, by its dense output.

    The step is searched in parts, from its start. A part in which the bound of the module's docstring neither excludes
    a zero nor encloses one is halved; the part after one that is decided is twice as long. `State.sampled` has the
    event functions at the nodes of a part, `State.bernstein` coefficients of one of them. `Attempt.unresolved` becomes
    1 if more than PARTS parts are searched.

    Returns
    -------
    fraction : float
        Place of the zero, as a fraction of the step; 1 if there is none.
    event : int
        The event function that has it, or NO_EVENT.
    slope : float
        Its change per fraction of the step there; -inf where it jumps.
    """
    value = s.sampled
    low, width = 0.0, 1.0  # the part [low, low + width]
    parts = 0
    s.attempt.unresolved = 0
    copy(s.at_start, value[0])
    while low < 1.0:
        parts += 1
        if parts > PARTS:
            s.attempt.unresolved = 1
        # the first node of a part is the last of the part before: its values are at hand
        for i in range(1, NODES + 1):
            _evaluate(m, w, s, low + width * _POINTS[i])
            copy(w.event, value[i])
        # Of all functions that have a zero in this part the first is the event. One that is unresolved might have an
        # earlier zero, so that the part is halved before any is believed.
        first, event, slope_at_first = 2.0, NO_EVENT, 0.0
        is_resolved = True
        is_finest = width <= FINEST or parts > PARTS
        for e in range(len(w.event)):
            rounding = noise(s, e)
            begins = s.at_start[e] >= -CREEP / NOISE * rounding
            if begins:
                # a mode may begin a little below zero; its event is a fall below where it began
                rounding = max(rounding, -BELOW_START * s.at_start[e])
            behind = _examine(value, e, rounding, low == 0.0 and begins, is_finest, s.bernstein)
            if behind == UNRESOLVED:
                is_resolved = False
                break
            if behind != FREE:
                left, right = low + width * _POINTS[behind - 1], low + width * _POINTS[behind]
                root, slope = _root(m, w, s, e, left, right, value[behind - 1, e], value[behind, e])
                if root < first:
                    first, event, slope_at_first = root, e, slope
        if not is_resolved:
            width *= 0.5
            continue
        if event != NO_EVENT:
            return first, event, slope_at_first
        copy(value[NODES], value[0])
        low += width
        width = min(2.0 * width, 1.0 - low)
    return 1.0, NO_EVENT, 0.0


@kernel
def _examine(value, e, rounding, starts, finest, bernstein):
    """Return the verdict on event function e in a part of a step.

    It is FREE, UNRESOLVED, or the first node after the first zero. `rounding` is by how much the
    function may be negative. `starts` says whether the step starts here, in the right mode, and
    `finest` whether the part must not be divided.
    """
    # the first node at which the function is negative
    largest, behind = 0.0, FREE
    for i in range(NODES + 1):
        largest = max(largest, abs(value[i, e]))
        if behind == FREE and i > 0 and value[i, e] < -rounding:
            behind = i
    if largest <= rounding or behind == FREE and finest:
        return FREE
    if behind == 1 or finest:
        return behind  # no room for an earlier zero, or no finer division to look for one

    # the polynomial through the nodes; its last two Chebyshev coefficients estimate its error, since those of a smooth
    # function fall geometrically
    left, right = bernstein[0], bernstein[1]
    for k in range(NODES + 1):
        right[k] = product(_NODES_TO_BERNSTEIN[k], value[:, e])
    tail = abs(product(_NODES_TO_LAST[0], value[:, e])) + abs(
        product(_NODES_TO_LAST[1], value[:, e])
    )

    if behind > 1:
        # a zero is enclosed by two nodes: it is the first if there is none before them
        _split(right, _POINTS[behind - 1], left)
        return behind if _is_above(left, starts, tail, rounding) else UNRESOLVED

    # Bernstein coefficients of shorter intervals are closer to the polynomial: a quarter of the part costs no
    # evaluation, and spares most divisions
    for quarter in range(4):
        if quarter < 3:
            _split(right, 1.0 / (4.0 - quarter), left)
        if not _is_above(left if quarter < 3 else right, starts and quarter == 0, tail, rounding):
            return UNRESOLVED
    return FREE


@kernel
def _is_above(b, starts, tail, rounding):
    """Return True where a polynomial of Bernstein coefficients b, of error `tail`, is positive or above its start."""
    if starts:
        # (p - p(0)) / x, for a function that is zero at the start and rises
        lowest = np.inf
        for k in range(1, NODES + 1):
            lowest = min(lowest, (b[k] - b[0]) * NODES / k)
        if lowest > TAIL_AT_ZERO * tail:
            return True
    lowest = np.inf
    for k in range(NODES + 1):
        lowest = min(lowest, b[k])
    return lowest > tail or tail <= rounding and lowest >= -2.0 * rounding


@kernel
def _split(b, x, left):
    """Split Bernstein coefficients at x: the part before into `left`, that behind in place (de Casteljau)."""
    left[0] = b[0]
    for k in range(1, NODES + 1):
        for i in range(NODES + 1 - k):
            b[i] = (1.0 - x) * b[i] + x * b[i + 1]
        left[k] = b[0]


@kernel
def _root(
    m: Arrays,
    w: Workspace,
    s: State,
    e: int,
    low: float,
    high: float,
    at_low: float,
    at_high: float,
) -> tuple[float, float]:
    """Return the zero of event function e between two fractions of the step, and its slope there.

    The slope is per fraction.

    By inverse quadratic interpolation within a bracket, as in Brent's method, with a bisection every fourth time.
    """
    slope = (at_high - at_low) / (high - low)
    if at_low <= 0.0:
        # An event function is zero, but for rounding, where its own event began the step. If it rises before it falls,
        # its zero is behind that rise; if it only falls, its mode is left at once.
        for _ in range(HALVINGS):
            x = 0.5 * (low + high)
            _evaluate(m, w, s, x)
            if w.event[e] > 0.0:
                at_low, low = w.event[e], x
                break
            high, at_high = x, w.event[e]
        if at_low <= 0.0:
            return low, slope
    last, at_last, converges = high, at_high, False
    left, at_left = np.nan, np.nan  # the end of the bracket that was given up last
    for i in range(ITERATIONS):
        if high - low < FOUND:
            # a jump, as of the event function of a guide at rest where the HLCP alone tells when it leaves
            jumps = at_low - at_high > JUMP * abs(slope) * (high - low)
            return high, -np.inf if jumps else slope

        # inverse interpolation: linear between the ends of the bracket, quadratic with the end that was given up, if
        # the three values are in order
        x = high - at_high * (high - low) / (at_high - at_low)
        if at_left < at_high or at_left > at_low:
            x += (
                at_low
                * at_high
                * ((left - low) / (at_left - at_low) - (high - low) / (at_high - at_low))
                / (at_left - at_high)
            )
        if converges and low <= x <= high and abs(x - last) < SETTLED:
            return (
                x,
                slope,
            )  # the secant method on the event function itself does the rest (`go_to_event`)
        if i % BISECT_EVERY == BISECT_EVERY - 1 or not low < x < high:
            x = 0.5 * (low + high)
        _evaluate(m, w, s, x)
        value = w.event[e]
        if abs(x - last) > BESIDE:
            slope = (value - at_last) / (x - last)
        converges = abs(value) < CONVERGES * abs(at_last)
        last, at_last = x, value

        # the bracket keeps one value of each sign
        if value < 0.0:
            left, at_left = high, at_high
            high, at_high = x, value
        else:
            left, at_left = low, at_low
            low, at_low = x, value
    return high, slope


@kernel
def go_to_event(
    m: Arrays, w: Workspace, s: State, h: float, correction: float, error: float, first: bool
) -> tuple[float, bool]:
    """Go from the end of a step of length h to the zero of its event function, by the secant method.

    Parameters
    ----------
    h : float
        Length of the step, s, of which y_new, K and `at_stages` are.
    correction : float
        How much longer the step must be, s.
    error : float
        Relative error of the correction.
    first : bool
        Whether to stop where another event function becomes negative on the way.

    Returns
    -------
    h : float
        Length of the step that y_new is the end of.
    reached : bool
        Whether it ends at the zero; w.event is then that of its end, or of a state closer than LEFT.
    """
    t, y_new, K, event = s.progress.time, s.y_new, s.K, s.attempt.event
    value = s.at_stages[STAGES - 1, event]
    for _ in range(CORRECTIONS):
        # A correction towards a zero through which the function rises leads to the end of a dip below zero, not to its
        # beginning. One of more than a hundredth of the step has a slope that is not to be believed either.
        rises = correction * value < 0.0
        if rises or not abs(correction) < NEAR * h:
            return h, abs(value) <= noise(s, event)

        # the last correction is so small that Euler's method makes it, without another evaluation
        if abs(correction) * max(abs(correction), error * h) <= LEFT * h * h:
            for i in range(len(y_new)):
                y_new[i] += correction * K[STAGES, i]
            return h + correction, True

        # the new slope is that of the correction just made, and wrong by about its part of the step
        _runge_kutta(m, w, s, t + h, correction)
        h += correction
        if first and not _no_other_is_negative(w, s, event):
            return h, False
        change = w.event[event] - value
        value, error = w.event[event], abs(correction) / h
        correction *= -value / change if change != 0.0 else 0.0
    return h, abs(correction) <= SETTLED * h or abs(value) <= noise(s, event)


@kernel
def _runge_kutta(m, w, s, t, h):
    """Make a classical Runge-Kutta step of y_new in place.

    K[STAGES] is y' at its start before and at its end after; K[1], K[2], K[3] are the stages in between.
    """
    y, K, stage = s.y_new, s.K, s.probe
    # turn k makes the state of stage k + 1, or for k = 4 that of the end of the step, and y' there
    for k in range(1, 5):
        if k < 4:
            before = STAGES if k == 1 else k - 1
            part = h if k == 3 else 0.5 * h
            for i in range(len(y)):
                stage[i] = y[i] + part * K[before, i]
        else:
            for i in range(len(y)):
                y[i] += h / 6.0 * (K[STAGES, i] + 2.0 * (K[1, i] + K[2, i]) + K[3, i])
                stage[i] = y[i]
        time = t + (h if k > 2 else 0.5 * h)
        right_hand_side(m, w, time, stage, s.slip, s.corner, K[k if k < 4 else STAGES])
