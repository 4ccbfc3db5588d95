"""Effects of joints that an engine may or may not take: bounds of dry friction of several kinds, and damping."""

from __future__ import annotations

from enum import StrEnum

from stiction.scenes import Scene
from stiction.scenes.model import Joint, Revolute


class JointEffect(StrEnum):
    """An effect that a scene can declare for a joint. The values are the words of a refusal."""

    PIN_FRICTION = "dry friction in a pin"
    GUIDE_FRICTION = "dry friction with a constant bound in a guide"
    STATIC_FRICTION = "a constant bound of friction that is larger at rest"
    PIN_UNDER_LOAD = "friction of a pin that depends on the force in it"
    SPEED_DEPENDENCE = "friction that depends on the speed of slip"
    DAMPING = "damping in a joint"


ALL_EFFECTS = frozenset(JointEffect)
"""Every effect there is, for engines that take them all."""
LAWS_OF_THE_REFERENCE = frozenset({JointEffect.PIN_UNDER_LOAD, JointEffect.SPEED_DEPENDENCE})
"""Laws of friction that the adapters do not represent."""
COMMON_EFFECTS = ALL_EFFECTS - LAWS_OF_THE_REFERENCE
"""Constant bounds in slip and at rest, and damping: for adapters that set such a bound in each step."""


def effects_of(joint: Joint) -> list[JointEffect]:
    """Return the effects that a joint declares; a bound of zero is no effect."""
    effects = []
    kinetic, static = joint.bounds
    if static > 0.0:
        is_pin = isinstance(joint, Revolute)
        effects.append(JointEffect.PIN_FRICTION if is_pin else JointEffect.GUIDE_FRICTION)
    if static > kinetic:
        effects.append(JointEffect.STATIC_FRICTION)
    if isinstance(joint, Revolute) and joint.is_under_load:
        effects.append(JointEffect.PIN_UNDER_LOAD)
    if joint.depends_on_speed:
        effects.append(JointEffect.SPEED_DEPENDENCE)
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


def has_constant_bounds(scene: Scene) -> bool:
    """Return True if a scene has friction, and no bound of it depends on a normal force."""
    rubbing = [joint for joint in scene.frictional_joints.values() if joint.rubs]
    return bool(rubbing) and not any(_depends_on_load(joint) for joint in rubbing)


def has_static_bounds(scene: Scene) -> bool:
    """Return True if the constant bound of a joint is larger at rest than in slip."""
    return any(static > kinetic for kinetic, static in (j.bounds for j in scene.joints.values()))


def _depends_on_load(joint: Joint) -> bool:
    """Return True if the bound of a joint's friction grows with its normal force."""
    if isinstance(joint, Revolute):
        return joint.is_under_load
    return joint.static_coefficient > 0.0
