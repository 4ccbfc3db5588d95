"""Effects of joints that an engine may or may not take: dry friction of several kinds, damping, and clearance."""

from __future__ import annotations

from enum import StrEnum

from stiction.scenes import Scene, vary
from stiction.scenes.model import Joint, Revolute, Translational


class JointEffect(StrEnum):
    """An effect that a scene can declare for a joint. The values are the words of a refusal."""

    PIN_FRICTION = "dry friction in a pin"
    GUIDE_FRICTION = "dry friction with a constant bound in a guide"
    STATIC_FRICTION = "a constant bound of friction that is larger at rest"
    SPEED_DEPENDENCE = "friction that depends on the speed of slip"
    DAMPING = "damping in a joint"
    CLEARANCE = "clearance in a guide"
    RESTITUTION = "restitution in a guide"


EFFECTS_OF_GAPS = frozenset({JointEffect.CLEARANCE, JointEffect.RESTITUTION})
"""Effects of the gap between a slider and its guide, which exist at contact fidelity only. Joint fidelity neglects
them, because its guides are bilateral."""
ALL_EFFECTS = frozenset(JointEffect) - EFFECTS_OF_GAPS
"""Every effect that a bilateral joint can have, for engines that take them all."""
LAWS_OF_THE_REFERENCE = frozenset({JointEffect.SPEED_DEPENDENCE})
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
    if joint.depends_on_speed:
        effects.append(JointEffect.SPEED_DEPENDENCE)
    if joint.damping > 0.0:
        effects.append(JointEffect.DAMPING)
    if isinstance(joint, Translational) and joint.clearance is not None:
        effects.append(JointEffect.CLEARANCE)
        if joint.restitution > 0.0:
            effects.append(JointEffect.RESTITUTION)
    return effects


def neglected_keys(scene: Scene) -> list[str]:
    """Return the keys of a scene that joint fidelity neglects, such as ``joints.guide.clearance``."""
    keys = []
    for name, guide in scene.guides.items():
        if guide.clearance is not None:
            keys.append(f"joints.{name}.clearance")
        if guide.restitution > 0.0:
            keys.append(f"joints.{name}.restitution")
    return keys


def with_ideal_guides(scene: Scene) -> Scene:
    """Return the scene that joint fidelity represents: without clearance and restitution."""
    keys = neglected_keys(scene)
    return vary(scene, dict.fromkeys(keys)) if keys else scene


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
    return isinstance(joint, Translational) and joint.static_coefficient > 0.0
