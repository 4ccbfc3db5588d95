"""Watch for several motions within a step, compiled.

Where the friction gain (`uniqueness`) is 1 or more, more than one motion may follow. Within a step that comes near it
the motions are counted, at some points; the instant at which there begin to be several is found by bisection.
"""

from __future__ import annotations

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.friction.uniqueness import gain_of_mode, has_several
from stiction.reference_impl.integration.dop853 import dense_at
from stiction.reference_impl.integration.integration_state import State
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

NEARLY_SEVERAL = 0.5
"""Friction gain at either end of a step from which on the step is watched: several motions need 1."""
GAIN_SAMPLES = 8
"""Points of a step at which the motions are counted."""
HALVINGS_BEHIND = 8
"""Points behind the place where the gain passes 1 at which the motions are counted as well, each in half the distance
of the last: a second motion may come and merge again between two samples, as where a corner changes its surface."""
RESOLVED = 4e-16
"""Smallest difference of times that is resolved, relative to the time: two roundings of double precision."""
SINGULAR_STRETCH = 1e-4
"""Part of the stretch between two samples up to which several motions are taken to begin where the gain passes 1. A
second motion usually comes in from infinity there; just behind, its linear system is too nearly singular to be
counted."""


@kernel
def end_at_several(m: Arrays, w: Workspace, s: State) -> None:
    """End the step that is made where several motions begin, if they do so within it.

    `Attempt.counted` becomes the fraction of the step at which they were counted: just behind the place where they
    begin, as the linear system is singular there.
    """
    step = s.attempt
    low, was_below = 0.0, True  # the sample before, and whether the gain was below 1 there
    fraction = step.length / step.h
    for i in range(1, GAIN_SAMPLES + 1):
        high = fraction * i / GAIN_SAMPLES
        _rows_at(m, w, s, high)
        several = has_several(m, w, s.slip)
        gain, _ = gain_of_mode(m, w, s.slip)
        if not several and was_below and gain >= 1.0:
            # Two motions may have begun and ended since the gain passed 1, as where a corner changes its surface: look
            # at points that come closer and closer to that place.
            passed = _onset(m, w, s, low, high, False)
            for k in range(1, HALVINGS_BEHIND + 1):
                between = passed + (high - passed) * 0.5**k
                _rows_at(m, w, s, between)
                if has_several(m, w, s.slip):
                    several, high = True, between
                    break
        was_below = gain < 1.0
        if several:
            # They begin where they can be counted first. Where that is indistinguishable from the place at which the
            # gain passes 1, it is the latter: a second motion comes in from infinity there.
            step.is_ambiguous, step.counted = 1, _onset(m, w, s, low, high, True)
            passed = _onset(m, w, s, low, high, False)
            step.fraction = step.counted
            if step.counted - passed <= SINGULAR_STRETCH * (high - low):
                step.fraction = passed
            step.length = step.fraction * step.h
            return
        low = high


@kernel
def _onset(m: Arrays, w: Workspace, s: State, low: float, high: float, several: bool) -> float:
    """Bisect for the fraction of the step from which several motions are counted.

    Where the gain reaches 1 counts as well.
    """
    while (high - low) * s.attempt.h > RESOLVED * max(s.progress.time, s.attempt.h):
        middle = 0.5 * (low + high)
        _rows_at(m, w, s, middle)
        gain, _ = gain_of_mode(m, w, s.slip)
        is_behind = has_several(m, w, s.slip) if several else gain >= 1.0
        if is_behind:
            high = middle
        else:
            low = middle
    return high


@kernel
def _rows_at(m, w, s, x):
    """Evaluate the rows of the workspace at the fraction x of the step, from its dense output."""
    n = len(m.inverse_mass)
    dense_at(s.F, s.y, x, s.probe)
    row_form(m, w, s.progress.time + x * s.attempt.h, s.probe[:n], s.probe[n:])
