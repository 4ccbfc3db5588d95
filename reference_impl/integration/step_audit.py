"""Audit of a step: Coulomb's law at an instant that no method chose, compiled."""

from __future__ import annotations

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction.frozen_mode import margin
from stiction.reference_impl.integration.dop853 import STAGES
from stiction.reference_impl.integration.integration_state import State, Task, take_audit_step
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

AUDITED = 1e-9
"""Violation of Coulomb's law, relative to the largest force or speed so far, that an audit takes for a missed event."""
TIMES_RTOL = 10.0
"""Multiple of the tolerance below which a violation does not count either: the states are wrong by rtol themselves."""
GOLDEN = 0.6180339887498949
"""Audits are at the fractional parts of multiples of the golden section: spread evenly, and related to no stage."""


@kernel
def audit(
    m: Arrays, w: Workspace, s: State, task: Task, t: float, speed: float, force: float
) -> bool:
    """Return True where Coulomb's law holds at the audited instants of the step from t; else one becomes the state.

    speed, force : the largest so far, m/s and N.
    """
    n, length = len(m.inverse_mass), s.attempt.length
    part = max(AUDITED, TIMES_RTOL * task.rtol)
    for i in range(task.audits):
        x = ((w.counters.steps * task.audits + i) * GOLDEN) % 1.0
        if not _is_held(m, w, s, t, x, part * speed, part * force):
            # the run ends here: its last state, and the rows by which the breakdown is explained, are the audit's
            row_form(m, w, t + x * length, s.probe[:n], s.probe[n:])
            copy(s.probe, s.y)
            s.progress.time = t + x * length
            return False
    return True


@kernel
def _is_held(m, w, s, t, x, speed, force):
    """Return True where Coulomb's law holds, up to a speed (m/s) and a force (N), at the fraction x of a step.

    The state there is that of the cubic through both ends. Only if it violates the law a step is made that ends there,
    into `probe`, and decides.
    """
    length = s.attempt.length
    # The cubic of Hermite through states and derivatives at both ends. Its error is of order 4, more than the dense
    # output's, but it costs no stages.
    for k in range(len(s.y)):
        change = s.y_new[k] - s.y_old[k]
        left, right = length * s.K[0, k] - change, change - length * s.K[STAGES, k]
        s.probe[k] = s.y_old[k] + x * change + x * (1.0 - x) * ((1.0 - x) * left + x * right)
    right_hand_side(m, w, t + x * length, s.probe, s.slip, s.corner, s.dy)
    if not _violates(m, w, s.slip, speed, force):
        return True
    # the violation may be that of the cubic: a step as accurate as any other decides
    copy(s.K[0], s.audit_K[0])
    take_audit_step(m, w, s, t, x * length)
    return not _violates(m, w, s.slip, speed, force)


@kernel
def _violates(m, w, slip, speed, force):
    """Return True where a guide is beyond Coulomb's law by more than a speed (m/s) or a force (N)."""
    for f in range(len(m.friction)):
        speed_margin, force_margin = margin(m, w, slip, f)
        if not (speed_margin >= -speed and force_margin >= -force):  # nan is a violation
            return True
    return False
