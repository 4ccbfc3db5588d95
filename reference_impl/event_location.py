"""Where in a step an event function becomes zero, compiled.

Two ways lead there. The event functions of a step tell where the next of them will be zero; the step after it is made to end there
(`zero_near_end`). A step that went past an event all the same is searched with its dense output (`first_root`), and is to be repeated
with the length found. Either way what is left is made up for by the secant method on the event function (`go_to_event`), each
correction a Runge-Kutta step, so that the state at an event is as accurate as any other.
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.dop853 import C, STAGES, dense_at
from reference_impl.right_hand_side import right_hand_side_apart
from reference_impl.step import copy, noise

SETTLED = 1e-6
"""Part of the step by which a zero of the dense output may still move when it is taken: what that is wrong by is left to the
secant method."""
FOUND = 1e-12
"""Part of the step to which a jump of an event function is located in the dense output."""
BESIDE = 1e-7
"""Part of the step over which the slope of an event function is taken, lest it be rounding, and below which an event may be at the
start of a step."""
SLOPE = 1e-3
"""Part of the step over which the slope that comes with a zero of the dense output was taken, about: by so much it is wrong."""
LEFT = 1e-12
"""Part of the step by which an event may be missed: what the last correction, made by Euler's method, is wrong by, its own size times
that or times the error of the slope."""
NEAR = 0.01
"""Part of the step up to which an event is approached by Runge-Kutta steps of order 4."""
AIMS = (0, 4, 8, 9, 12)
"""Stages, in the order of times, whose event functions tell where the next zero will be."""
_AHEAD = np.linalg.inv(np.vander(np.sort(C)[list(AIMS)] - 1.0, increasing=True))
"""From those five values to the coefficients of their polynomial about the end of the step."""
AHEAD = 6.0
"""Steps up to which that polynomial is looked at; no step is longer than so many times the last."""
CORRECTIONS = 4
"""Secant steps to an event at most: a stiff right-hand side may keep them from falling below rounding."""
HALVINGS = 30
"""Bisections towards the start of a step in search of the rise of an event function that began at zero."""
SAMPLES = 8
"""Points of a suspicious step at which the event functions are looked at."""
DIP = -2
"""Index of no event function, of one that may fall below zero and return."""
GRAZING = 0.1
"""A step in which an event function falls below this part of its largest value there is suspicious: it may reach zero
and return between two stages. They are at most 0.27 of the step apart, where a parabola falls by 0.06 of that value."""
OWN_ZERO = 1e-9
"""An event function at the start of a step below this part of its largest value there had its own event then."""


@kernel
def zero_near_end(before, seen, e):
    """Distance from the end of the step to the next zero of event function e, or to one just passed, in steps; infinite if none is in sight.

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
def ends_at_zero(slip, seen, scalar, aimed):
    """Whether the event function aimed at is the only one that is negative, and not before the end of the step."""
    for s in range(STAGES):
        if not _alone(slip, seen[s], scalar, aimed) or s < STAGES - 2 and seen[s, aimed] < -noise(slip, aimed, scalar):
            return False
    return True


@kernel
def _alone(slip, event, scalar, own):
    """Whether no other event function than its own is negative."""
    for e in range(len(event)):
        if e != own and event[e] < -noise(slip, e, scalar):
            return False
    return True


@kernel
def grazes(before, seen, aimed):
    """Whether an event function comes so near to zero within the step that it may pass it between the stages.

    One that rises from the zero of its own event does not, nor does one that was aimed at and falls.
    """
    for e in range(len(before)):
        largest, last = before[e], before[e]
        for s in range(STAGES):
            largest = max(largest, seen[s, e])
        own = before[e] <= OWN_ZERO * largest
        if not own and before[e] < GRAZING * largest:
            return True
        for s in range(STAGES):
            expected = own and seen[s, e] > last or e == aimed and (seen[s, e] < last or s == STAGES - 1)
            if seen[s, e] < GRAZING * largest and not expected:
                return True
            last = seen[s, e]
    return False


@kernel
def first_root(m, w, t, h, F, y, slip, corner, probe, dy, counters, scalar, dips, at_start, value):
    """First zero of an event function within the step: its fraction of the step, its index, and the slope per fraction.

    Index -1 if there is none. With `dips`, index DIP and the bottom where a function falls below zero and returns between
    two samples.
    """
    copy(at_start, value[0])
    for i in range(1, SAMPLES + 1):
        x = i / SAMPLES
        dense_at(F, y, x, probe)
        right_hand_side_apart(m, w, (t + x * h, probe, slip, corner, dy, counters))
        copy(w.event, value[i])
        best, which, steepness = 2.0, -1, 0.0
        for e in range(len(w.event)):
            if value[i, e] < -noise(slip, e, scalar):
                root, slope = _root(m, w, t, h, F, y, slip, corner, probe, dy, counters, e, (i - 1) / SAMPLES, x,
                                    value[i - 1, e], value[i, e])
                if root < best:
                    best, which, steepness = root, e, slope
            elif dips and i > 1 and _may_dip(value[i - 2:i + 1, e]):
                bottom, lowest = _minimum(m, w, t, h, F, y, slip, corner, probe, dy, counters, e, x, value[i - 2:i + 1, e])
                if lowest < -noise(slip, e, scalar) and 0.02 < bottom < 0.98:
                    return bottom, DIP, 0.0
        if which >= 0:
            return best, which, steepness
    return 1.0, -1, 0.0


@kernel
def _may_dip(value):
    """Whether the parabola through three values at equal distances comes near zero between them, and none of them is below."""
    a, b, c = value[0], value[1], value[2]
    bend = a - 2.0 * b + c
    if not bend > 0.0 or min(a, b, c) < 0.0 or abs(a - c) >= 2.0 * bend:
        return False
    return b - 0.125 * (a - c) ** 2 / bend < GRAZING * max(a, c)


@kernel(allocates=True)
def _minimum(m, w, t, h, F, y, slip, corner, probe, dy, counters, e, last, value):
    """Smallest value found of event function e near its last three samples, by vertices of parabolas."""
    x, value = last + np.array([-2.0, -1.0, 0.0, 0.0]) / SAMPLES, np.append(value, 0.0)
    first = 0
    for _ in range(4):
        (a, b, c), (at_a, at_b, at_c) = x[first:first + 3], value[first:first + 3]
        slope, bend = (at_b - at_a) / (b - a), ((at_c - at_b) / (c - b) - (at_b - at_a) / (b - a)) / (c - a)
        vertex = 0.5 * (a + b - slope / bend)
        lowest = at_a + (vertex - a) * (slope + bend * (vertex - b))
        if not (bend > 0.0 and a < vertex < c and lowest < GRAZING * max(at_a, at_c)) or min(at_a, at_b, at_c) < 0.0:
            break
        dense_at(F, y, vertex, probe)
        right_hand_side_apart(m, w, (t + vertex * h, probe, slip, corner, dy, counters))
        k = 1 if vertex < b else 2
        x[:3], value[:3] = (a, b, c), (at_a, at_b, at_c)
        x[k + 1:], value[k + 1:] = x[k:3].copy(), value[k:3].copy()
        x[k], value[k] = vertex, w.event[e]
        first = 0 if np.argmin(value) < 2 else 1
    k = first + np.argmin(value[first:first + 3])
    return x[k], value[k]


@kernel
def _root(m, w, t, h, F, y, slip, corner, probe, dy, counters, e, low, high, at_low, at_high):
    """Zero of event function e between two fractions of the step, and its slope: inverse interpolation with bisection."""
    slope = (at_high - at_low) / (high - low)
    if at_low <= 0.0:
        # an event function is zero, give or take rounding, where its own event began the step: if it rises before it
        # falls, its zero is behind that rise; if it only falls, its mode was left at once
        for _ in range(HALVINGS):
            x = 0.5 * (low + high)
            dense_at(F, y, x, probe)
            right_hand_side_apart(m, w, (t + x * h, probe, slip, corner, dy, counters))
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
            jumps = at_low - at_high > 1e3 * abs(slope) * (high - low)  # as where a stuck guide has no other function
            return high, -np.inf if jumps else slope
        x = high - at_high * (high - low) / (at_high - at_low)
        if at_left < at_high or at_left > at_low:
            x += at_low * at_high * ((left - low) / (at_left - at_low) - (high - low) / (at_high - at_low)) / (at_left - at_high)
        if falling and low <= x <= high and abs(x - last) < SETTLED:
            return x, slope
        if i % 4 == 3 or not low < x < high:
            x = 0.5 * (low + high)
        dense_at(F, y, x, probe)
        right_hand_side_apart(m, w, (t + x * h, probe, slip, corner, dy, counters))
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
def go_to_event(m, w, t, h, correction, error, slip, corner, K, y_new, probe, counters, scalar, seen, event, first):
    """From the end of a step h to the zero of an event function, by the secant method.

    correction : how much longer the step must be; `error`: the part of itself by which that is wrong.  first : there is to be no zero of
    another event function on the way.
    Returns the step, and whether it ends at the zero. If the zero is off by more than a hundredth of the step, then its slope is not
    believed either.
    """
    value = seen[STAGES - 1, event]
    for _ in range(CORRECTIONS):
        if not abs(correction) < NEAR * h:
            return h, abs(value) <= noise(slip, event, scalar)
        if abs(correction) * max(abs(correction), error * h) <= LEFT * h * h:
            for i in range(len(y_new)):
                y_new[i] += correction * K[STAGES, i]
            return h + correction, True
        _runge_kutta(m, w, t + h, correction, y_new, slip, corner, K, probe, counters)
        h += correction
        if first and not _alone(slip, w.event, scalar, event):
            return h, False
        change = w.event[event] - value
        value, error = w.event[event], abs(correction) / h
        correction *= -value / change if change != 0.0 else 0.0
    return h, True


@kernel
def _runge_kutta(m, w, t, h, y, slip, corner, K, stage, counters):
    """Classical Runge-Kutta step of y in place; K[STAGES] is y' at its beginning before and at its end after."""
    for s in range(1, 5):
        if s < 4:
            for i in range(len(y)):
                stage[i] = y[i] + (h if s == 3 else 0.5 * h) * K[STAGES if s == 1 else s - 1, i]
        else:
            for i in range(len(y)):
                y[i] += h / 6.0 * (K[STAGES, i] + 2.0 * (K[1, i] + K[2, i]) + K[3, i])
                stage[i] = y[i]
        right_hand_side_apart(m, w, (t + (h if s > 2 else 0.5 * h), stage, slip, corner, K[s if s < 4 else STAGES], counters))
