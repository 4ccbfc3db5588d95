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
SINGULAR_STRETCH = 1e-4
"""Part of the stretch between two samples up to which several motions are taken to begin where the gain passes 1. A
second motion usually comes in from infinity there; just behind, its linear system is too nearly singular to be
counted."""


@kernel
def end_at_several(m: Arrays, w: Workspace, s: State) -> None:
    """End the step that is made where several motions begin, if they do so within it.

    `counted` is a fraction of the step just behind, where they can be counted: where they begin the linear system is
    singular.
    """
    step, low, below = s.attempt, 0.0, True
    fraction = step.length / step.h
    for i in range(1, GAIN_SAMPLES + 1):
        high = fraction * i / GAIN_SAMPLES
        _rows_at(m, w, s, high)
        several = has_several(m, w, s.slip)
        gain, _ = gain_of_mode(m, w, s.slip)
        if not several and below and gain >= 1.0:
            # two motions may have come and merged since the gain passed 1, as where a corner changes its surface
            passed = _onset(m, w, s, low, high, False)
            for k in range(1, HALVINGS_BEHIND + 1):
                between = passed + (high - passed) * 0.5**k
                _rows_at(m, w, s, between)
                if has_several(m, w, s.slip):
                    several, high = True, between
                    break
        below = gain < 1.0
        if several:
            step.is_ambiguous, step.counted = 1, _onset(m, w, s, low, high, True)
            passed = _onset(m, w, s, low, high, False)
            step.fraction = (
                passed if step.counted - passed <= SINGULAR_STRETCH * (high - low) else step.counted
            )
            step.length = step.fraction * step.h
            return
        low = high


@kernel
def _onset(m: Arrays, w: Workspace, s: State, low: float, high: float, several: bool) -> float:
    """Bisect between two fractions of the step: where several motions begin to be counted, or the gain reaches 1."""
    while (high - low) * s.attempt.h > 4e-16 * max(s.progress.time, s.attempt.h):
        middle = 0.5 * (low + high)
        _rows_at(m, w, s, middle)
        gain, _ = gain_of_mode(m, w, s.slip)
        if has_several(m, w, s.slip) if several else gain >= 1.0:
            high = middle
        else:
            low = middle
    return high


@kernel
def _rows_at(m, w, s, x):
    """The rows of the workspace at the fraction x of the step."""
    n = len(m.inverse_mass)
    dense_at(s.F, s.y, x, s.probe)
    row_form(m, w, s.progress.time + x * s.attempt.h, s.probe[:n], s.probe[n:])
