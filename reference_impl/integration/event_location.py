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
enough. The first zero of g below minus its rounding (`step.noise`) is then found to the accuracy of the dense output.
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
"""Part of the step by which an event may be missed: what the last correction, made by Euler's method, is wrong by, its
own size times that or times the error of the slope."""
NEAR = 0.01
"""Part of the step up to which an event is approached by Runge-Kutta steps of order 4."""
AHEAD = 6.0
"""Steps up to which the polynomial of a step is looked at; no step is longer than so many times the last."""
CORRECTIONS = 4
"""Secant steps to an event at most: a stiff right-hand side may keep them from falling below rounding."""
LONGER = (1.0 + NEAR) ** CORRECTIONS
"""Times its length that these corrections can make a step at most."""
HALVINGS = 30
"""Bisections towards the start of a step in search of the rise of an event function that began at zero."""
OWN_ZERO = 1e-9
"""An event function at the start of a step below this part of its largest value there had its own event then."""
CREEP = 1e-3
"""Part of the largest speed or force so far by which an event function may be negative where its mode begins. A guide
at rest creeps by the integration error, and does so for an instant when it has broken away: it has no event unless it
falls below where it began. What is further below zero is in the wrong mode, as where redundant guides share their load
anew."""

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
"""Times its rounding from which on an event function varies."""

_X = 0.5 - 0.5 * np.cos(np.pi * np.arange(NODES + 1) / NODES)
_X[0], _X[-1] = 0.0, 1.0
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
_NODES_TO_BERNSTEIN = _bernstein(_X)
_NODES_TO_LAST = np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * _X - 1.0, NODES))[-2:]
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
def zero_near_end(before: Reals, seen: Table, e: int) -> float:
    """Distance from the end of the step to the next zero of event function e, or to one just passed, in steps.

    Infinite if none is in sight.

    before : event functions at the start of the step.  seen : those of its stages, in the order of times.
    """
    c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(AIMS)):
        value = before[e] if j == 0 else seen[AIMS[j] - 1, e]
        c0 += _AHEAD[0, j] * value
        c1 += _AHEAD[1, j] * value
        c2 += _AHEAD[2, j] * value
        c3 += _AHEAD[3, j] * value
        c4 += _AHEAD[4, j] * value
    x = 0.0
    for _ in range(10):
        slope = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * 4.0 * c4))
        if not (slope < 0.0 and x < AHEAD):
            break
        change = -(c0 + x * (c1 + x * (c2 + x * (c3 + x * c4)))) / slope
        x += change
        if abs(change) < SETTLED:
            return x
    return np.inf


@kernel
def may_vanish(s, meant):
    """Return True where the bound of the module's docstring fails, for the whole step, for an event function.

    meant : one that has its zero about the end of the step, and must only not have one before, or NO_EVENT.
    """
    for e in range(len(s.at_start)):
        if not _stays_positive(s.at_start, s.seen, e, e == meant, noise(s, e)):
            return True
    return False


@kernel
def falls_to_end(s, e):
    """Return True where event function e is lowest at the end of the step: no zero before one near there."""
    return _stays_positive(s.at_start, s.seen, e, True, noise(s, e))


@kernel
def _stays_positive(before: Reals, seen: Table, e: int, falls: bool, rounding: float) -> bool:
    """Return True where event function e has no zero within the step.

    One that rises from its start is not asked there, one that `falls` not at the end.
    """
    B, P, v0, b1, b2, b3, b4 = (
        _STAGES_TO_BERNSTEIN,
        _STAGES_TO_CHECKS,
        before[e],
        0.0,
        0.0,
        0.0,
        seen[AIMS[-1] - 1, e],
    )
    largest, wrong = 0.0, 0.0
    for j in range(len(AIMS)):
        value = v0 if j == 0 else seen[AIMS[j] - 1, e]
        largest = max(largest, abs(value))
        b1 += B[1, j] * value
        b2 += B[2, j] * value
        b3 += B[3, j] * value
    for k in range(len(CHECKS)):
        value, predicted = seen[CHECKS[k] - 1, e], 0.0
        for j in range(len(AIMS)):
            predicted += P[k, j] * (v0 if j == 0 else seen[AIMS[j] - 1, e])
        largest, wrong = max(largest, abs(value)), max(wrong, abs(value - predicted))
    if largest <= rounding:
        return True
    begins = v0 >= -CREEP / NOISE * rounding
    if falls:
        # (p - p(1)) / (1 - x), and once more divided by x where it starts from a zero
        lowest = min(v0 - b4, 4.0 / 3.0 * (b1 - b4), 2.0 * (b2 - b4), 4.0 * (b3 - b4))
        if begins and v0 <= OWN_ZERO * largest:
            # p = b4 x + x (1 - x) r: positive between its zeros where r is
            lowest = min(4.0 * b1 - b4, 2.0 * b2 - b4, 4.0 / 3.0 * b3 - b4)
            return lowest > 4.0 * SAFETY_AT_ZERO * wrong
        return lowest > SAFETY_AT_ZERO * wrong
    if (
        begins
        and min(4.0 * (b1 - v0), 2.0 * (b2 - v0), 4.0 / 3.0 * (b3 - v0), b4 - v0)
        > SAFETY_AT_ZERO * wrong
    ):
        return True
    return min(v0, b1, b2, b3, b4) > SAFETY * wrong


@kernel
def are_resolved(s):
    """Return True where the stages of the step see how the event functions change: none is BLURRED.

    This is to the forces what the estimate of its error is to the motion.
    """
    for e in range(len(s.at_start)):
        low, high, wrong = s.at_start[e], s.at_start[e], 0.0
        for i in range(STAGES):
            low, high = min(low, s.seen[i, e]), max(high, s.seen[i, e])
        if not high - low > APPARENT * noise(s, e):
            continue
        for k in range(len(CHECKS)):
            value, predicted = s.seen[CHECKS[k] - 1, e], 0.0
            for j in range(len(AIMS)):
                predicted += _STAGES_TO_CHECKS[k, j] * (
                    s.at_start[e] if j == 0 else s.seen[AIMS[j] - 1, e]
                )
            wrong = max(wrong, abs(value - predicted))
        if wrong > BLURRED * (high - low):
            return False
    return True


@kernel
def _alone(w, s, own):
    """Return True where no other event function than its own is negative."""
    for e in range(len(w.event)):
        if e != own and w.event[e] < -noise(s, e):
            return False
    return True


@kernel
def _evaluate(m, w, s, x):
    """The event functions at the fraction x of the step."""
    dense_at(s.F, s.y, x, s.probe)
    right_hand_side(m, w, s.progress.time + x * s.attempt.h, s.probe, s.slip, s.corner, s.dy)


@kernel
def first_root(m: Arrays, w: Workspace, s: State) -> tuple[float, int, float]:
    """First zero of an event function within the step: its fraction of the step, its index, and the slope per fraction.

    NO_EVENT if there is none. The step is searched in parts, from its start: one in which the bound of the module's
    docstring neither excludes a zero nor encloses one is halved, the one after it is twice as long. `State.sampled` has
    the event functions at the nodes of a part, `State.bernstein` coefficients of one of them; `Attempt.unresolved`
    tells if it took more than PARTS of them.
    """
    value, low, width, parts = s.sampled, 0.0, 1.0, 0
    s.attempt.unresolved = 0
    copy(s.at_start, value[0])
    while low < 1.0:
        parts += 1
        if parts > PARTS:
            s.attempt.unresolved = 1
        for i in range(1, NODES + 1):
            _evaluate(m, w, s, low + width * _X[i])
            copy(w.event, value[i])
        best, which, steepness, resolved = 2.0, NO_EVENT, 0.0, True
        for e in range(len(w.event)):
            rounding = noise(s, e)
            begins = s.at_start[e] >= -CREEP / NOISE * rounding
            if begins:
                rounding = max(rounding, -1.001 * s.at_start[e])
            behind = _examine(
                value,
                e,
                rounding,
                low == 0.0 and begins,
                width <= FINEST or parts > PARTS,
                s.bernstein,
            )
            if behind == UNRESOLVED:
                resolved = False
                break
            if behind != FREE:
                root, slope = _root(
                    m,
                    w,
                    s,
                    e,
                    low + width * _X[behind - 1],
                    low + width * _X[behind],
                    value[behind - 1, e],
                    value[behind, e],
                )
                if root < best:
                    best, which, steepness = root, e, slope
        if not resolved:
            width *= 0.5
            continue
        if which != NO_EVENT:
            return best, which, steepness
        copy(value[NODES], value[0])
        low += width
        width = min(2.0 * width, 1.0 - low)
    return 1.0, NO_EVENT, 0.0


@kernel
def _examine(value, e, rounding, starts, finest, bernstein):
    """Verdict on event function e in a part of a step: FREE, UNRESOLVED, or the first node behind its first zero.

    `rounding`: by which it may be negative; `starts`: whether the step starts here, in the right mode; `finest`:
    whether the part must not be divided.
    """
    largest, behind = 0.0, FREE
    for i in range(NODES + 1):
        largest = max(largest, abs(value[i, e]))
        if behind == FREE and i > 0 and value[i, e] < -rounding:
            behind = i
    if largest <= rounding or behind == FREE and finest:
        return FREE
    if behind == 1 or finest:
        return behind
    left, right = bernstein[0], bernstein[1]
    for k in range(NODES + 1):
        right[k] = product(_NODES_TO_BERNSTEIN[k], value[:, e])
    tail = abs(product(_NODES_TO_LAST[0], value[:, e])) + abs(
        product(_NODES_TO_LAST[1], value[:, e])
    )
    if behind > 1:
        # no zero before the node in front of the one that is negative
        _split(right, _X[behind - 1], left)
        return behind if _is_above(left, starts, tail, rounding) else UNRESOLVED
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
    """Zero of event function e between two fractions of the step by inverse interpolation and bisection; its slope."""
    slope = (at_high - at_low) / (high - low)
    if at_low <= 0.0:
        # an event function is zero, give or take rounding, where its own event began the step: if it rises before it
        # falls, its zero is behind that rise; if it only falls, its mode was left at once
        for _ in range(HALVINGS):
            x = 0.5 * (low + high)
            _evaluate(m, w, s, x)
            if w.event[e] > 0.0:
                at_low, low = w.event[e], x
                break
            high, at_high = x, w.event[e]
        if at_low <= 0.0:
            return low, slope
    last, at_last, falling = high, at_high, False
    left, at_left = np.nan, np.nan  # the end of the bracket that was given up last
    for i in range(100):
        if high - low < FOUND:
            jumps = at_low - at_high > 1e3 * abs(slope) * (
                high - low
            )  # as where a stuck guide has no other function
            return high, -np.inf if jumps else slope
        x = high - at_high * (high - low) / (at_high - at_low)
        if at_left < at_high or at_left > at_low:
            x += (
                at_low
                * at_high
                * ((left - low) / (at_left - at_low) - (high - low) / (at_high - at_low))
                / (at_left - at_high)
            )
        if falling and low <= x <= high and abs(x - last) < SETTLED:
            return x, slope
        if i % 4 == 3 or not low < x < high:
            x = 0.5 * (low + high)
        _evaluate(m, w, s, x)
        value = w.event[e]
        if abs(x - last) > BESIDE:
            slope = (value - at_last) / (x - last)
        falling = abs(value) < 0.1 * abs(at_last)  # not so where it jumps
        last, at_last = x, value
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
    """Go from the end of a step h to the zero of the event function of the attempt, by the secant method.

    correction : how much longer the step must be; `error`: the part of itself by which that is wrong.  first : there is
    to be no zero of another event function on the way. Returns the step, and whether it ends at the zero; w.event is
    then of its end. If the zero is off by more than a hundredth of the step, then its slope is not believed either; a
    zero through which the function rises is not that event.
    """
    t, y_new, K, event = s.progress.time, s.y_new, s.K, s.attempt.event
    value = s.seen[STAGES - 1, event]
    for _ in range(CORRECTIONS):
        rises = correction * value < 0.0  # towards the end of a dip, not to its beginning
        if rises or not abs(correction) < NEAR * h:
            return h, abs(value) <= noise(s, event)
        if abs(correction) * max(abs(correction), error * h) <= LEFT * h * h:
            for i in range(len(y_new)):
                y_new[i] += correction * K[STAGES, i]
            return h + correction, True
        _runge_kutta(m, w, s, t + h, correction)
        h += correction
        if first and not _alone(w, s, event):
            return h, False
        change = w.event[event] - value
        value, error = w.event[event], abs(correction) / h
        correction *= -value / change if change != 0.0 else 0.0
    return h, abs(correction) <= SETTLED * h or abs(value) <= noise(s, event)


@kernel
def _runge_kutta(m, w, s, t, h):
    """Classical Runge-Kutta step of y_new in place; K[STAGES] is y' at its beginning before and at its end after."""
    y, K, stage = s.y_new, s.K, s.probe
    for k in range(1, 5):
        if k < 4:
            for i in range(len(y)):
                stage[i] = y[i] + (h if k == 3 else 0.5 * h) * K[STAGES if k == 1 else k - 1, i]
        else:
            for i in range(len(y)):
                y[i] += h / 6.0 * (K[STAGES, i] + 2.0 * (K[1, i] + K[2, i]) + K[3, i])
                stage[i] = y[i]
        right_hand_side(
            m, w, t + (h if k > 2 else 0.5 * h), stage, s.slip, s.corner, K[k if k < 4 else STAGES]
        )
