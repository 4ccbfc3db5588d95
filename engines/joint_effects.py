"""Effects of joints that an engine may or may not take: dry friction with a bound of its own, and damping."""

from __future__ import annotations

from enum import StrEnum

from stiction.scenes import Scene
from stiction.scenes.model import Joint, Revolute


class JointEffect(StrEnum):
    """An effect that a scene can declare for a joint. The values are the words of a refusal."""

    PIN_FRICTION = "dry friction in a pin"
    GUIDE_FRICTION = "dry friction with a constant bound in a guide"
    STATIC_FRICTION = "a constant bound of friction that is larger at rest"
    DAMPING = "damping in a joint"


ALL_EFFECTS = frozenset(JointEffect)
"""Every effect there is, for engines that take them all."""


def effects_of(joint: Joint) -> list[JointEffect]:
    """Return the effects that a joint declares; a bound of zero is no effect."""
    effects = []
    kinetic, static = joint.bounds
    if static > 0.0:
        is_pin = isinstance(joint, Revolute)
        effects.append(JointEffect.PIN_FRICTION if is_pin else JointEffect.GUIDE_FRICTION)
    if static > kinetic:
        effects.append(JointEffect.STATIC_FRICTION)
    if joint.damping > 0.0:
        effects.append(JointEffect.DAMPING)
    return effects


def first_unsupported(
    scene: Scene, supported: frozenset[JointEffect]
) -> tuple[str, JointEffect] | None:
    """Return the first joint with an effect that is not supported, and that effect; None if there is none."""
    for name, joint in scene.joints.items():
        for effect in effects_of(joint):
            if effect not in supported:
                return name, effect
    return None
