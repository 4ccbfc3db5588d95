"""Stribeck's curve: dry friction whose bound falls with the speed of slip.

The bound at rest is larger than that of fast slip by an excess, of which a part remains at the speed v of slip,

    excess(v) = exp(-(|v| / stribeck_velocity)^stribeck_shape)

(Bo & Pavelescu, Wear 82 (1982) 277-289; shape 1: Tustin 1947, shape 2: a Gaussian curve). The whole of it acts at
v = 0, so that friction is continuous as a joint breaks away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stiction.scenes.model import Revolute, Translational


def remaining_excess(joint: Revolute | Translational, speed: ArrayLike) -> np.ndarray:
    """Return the part of the static excess of friction that remains at speeds of slip, from 0 to 1.

    Parameters
    ----------
    joint
        A joint of a scene. Without a ``stribeck_velocity`` nothing remains in slip, at any speed.
    speed
        Speeds of slip, m/s for a guide, rad/s for a pin; any signs, any shape.
    """
    size = np.abs(np.asarray(speed, dtype=float))
    if joint.stribeck_velocity is None:
        return np.zeros_like(size)
    return np.exp(-((size / joint.stribeck_velocity) ** joint.stribeck_shape))


def bound_in_slip(joint: Revolute | Translational, speed: ArrayLike) -> np.ndarray:
    """Return the constant part of the bound of friction at speeds of slip, N, or N m for a pin."""
    kinetic, static = joint.bounds
    return kinetic + (static - kinetic) * remaining_excess(joint, speed)


def friction_radius_in_slip(pin: Revolute, speed: ArrayLike) -> np.ndarray:
    """Return the radius of the friction circle of a pin, torque per force, at speeds of slip (rad/s), m."""
    kinetic, static = pin.friction_radii
    return kinetic + (static - kinetic) * remaining_excess(pin, speed)


def coefficient_in_slip(guide: Translational, speed: ArrayLike) -> np.ndarray:
    """Return the coefficient of friction of a guide at speeds of slip, m/s."""
    kinetic, static = guide.kinetic_coefficient, guide.static_coefficient
    return kinetic + (static - kinetic) * remaining_excess(guide, speed)
