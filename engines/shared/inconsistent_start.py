"""Refusal of an initial state off its constraints, which an engine would silently correct or keep."""

from __future__ import annotations

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.protocol import Declined
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import workspace

OFF = 1e-6
"""Largest residual of a start, relative to the mechanism's size; for rates, relative to the size per second or the
largest speed, where a rotation counts as the speed at a distance of the size. The reference allows 1e-9
(`stiction.reference_impl.multibody.initial_state.CONSISTENT`), which is below the rounding of engines in single
precision."""


def refuse_off(assembly: Assembly) -> None:
    """Raise Declined if the initial state violates the constraints of joints and drives."""
    size = assembly.size
    speed = size
    for body in assembly.scene.bodies.values():
        vx, vy = body.velocity
        speed = max(speed, abs(vx), abs(vy), abs(size * body.angular_velocity))
    # Collect the residuals of all rows of all parts; the zeros are for scenes without rows.
    position = [0.0]
    velocity = [0.0]
    for mechanism in assembly.parts:
        m = mechanism.arrays
        w = workspace(m)
        row_form(m, w, 0.0, *mechanism.initial_state())
        position += w.phi.tolist()
        velocity += w.phi_dot.tolist()
    for residuals, scale, units in (
        (position, size, "m or rad"),
        (velocity, speed, "m/s or rad/s"),
    ):
        largest = np.abs(residuals).max()
        if not largest <= OFF * scale:
            raise Declined(
                f"the start is {largest:.2g} {units} off its constraints; this adapter assembles nothing"
            )
