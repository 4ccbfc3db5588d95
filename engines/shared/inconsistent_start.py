"""The refusal of a start off its constraints, which an engine would silently correct, or keep."""

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
    """Raise Declined for a start off the constraints of its joints and drives, with the largest residual."""
    scene, mechanisms, size = assembly.scene, assembly.parts, assembly.size
    rates = [
        abs(rate)
        for body in scene.bodies.values()
        for rate in (*body.velocity, size * body.angular_velocity)
    ]
    speed = max([size, *rates])
    # Residuals of all rows of all parts; the zeros are for scenes without any
    position, velocity = [0.0], [0.0]
    for mechanism in mechanisms:
        m, w = mechanism.arrays, workspace(mechanism.arrays)
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
