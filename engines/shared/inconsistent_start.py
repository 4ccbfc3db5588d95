"""The refusal of a start off its constraints, which an engine would move onto them without a word."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction.engines.protocol import Refused
from stiction.scenes import Scene

OFF = 1e-6
"""Of the mechanism's size, its rates of size per second or the largest speed, that of turning at the distance of its size included: a start that is farther off is refused. Scenes of the reference are met to 1e-9 of it
(`stiction.reference_impl.multibody.initial_state.CONSISTENT`), which engines in joint coordinates and in single precision need not see."""


def refuse_off(scene: Scene, position: Sequence[float] | np.ndarray, velocity: Sequence[float] | np.ndarray, what: str) -> None:
    """Refuse a start that is off.

    Parameters
    ----------
    scene : Scene
    position, velocity
        By how much: m or rad, and their rates.
    what : str
        It is off, in words.

    Raises
    ------
    Refused
    """
    from stiction.reference_impl.multibody.mechanism import Mechanism  # imported here: what lists engines needs no kernels
    from stiction.reference_impl.multibody.subsystems import independent_parts

    size = max(Mechanism(part).arrays.length_scale for part in independent_parts(scene))
    bodies = scene.bodies.values()
    speed = max([size, *(size * abs(body.angular_velocity) for body in bodies), *(abs(rate) for body in bodies for rate in body.velocity)])
    for distances, scale, units in ((position, size, "m or rad"), (velocity, speed, "m/s or rad/s")):
        off = np.abs(distances).max(initial=0.0)
        if off > OFF * scale:
            raise Refused(f"the start is {off:.2g} {units} off {what}; this adapter assembles nothing")
