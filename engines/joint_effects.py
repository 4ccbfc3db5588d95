"""Effects that an engine may or may not take: friction, damping, clearance, limited drives, one-sided springs, laws."""

from __future__ import annotations

from enum import StrEnum

from stiction.scenes import Scene, vary
from stiction.scenes.laws import MOVES, Law, Sum, Table
from stiction.scenes.model import (
    Drive,
    Force,
    Joint,
    LinearSpring,
    Load,
    Revolute,
    Spring,
    Torque,
    TorsionalSpring,
    Translational,
)


class JointEffect(StrEnum):
    """An effect that a scene can declare for an element. The values are the words of a refusal."""

    PIN_FRICTION = "dry friction in a pin"
    GUIDE_FRICTION = "dry friction with a constant bound in a guide"
    STATIC_FRICTION = "a constant bound of friction that is larger at rest"
    PIN_UNDER_LOAD = "friction of a pin that depends on the force in it"
    SPEED_DEPENDENCE = "friction that depends on the speed of slip"
    DAMPING = "damping in a joint"
    EFFORT_LIMIT = "a limit of the effort of a drive"
    ONE_SIDED = "a spring that acts on one side only"
    SWITCHING_LAW = "a law of time with steps, clamped ends, moves or several terms"
    CLEARANCE = "clearance in a guide"
    RESTITUTION = "restitution in a guide"


EFFECTS_OF_GAPS = frozenset({JointEffect.CLEARANCE, JointEffect.RESTITUTION})
"""Effects of the gap between a slider and its guide, which exist at contact fidelity only. Joint fidelity neglects
them, because its guides are bilateral."""
ALL_EFFECTS = frozenset(JointEffect) - EFFECTS_OF_GAPS
"""Every effect that a scene with bilateral guides can have, for engines that take them all."""
LAWS_OF_THE_REFERENCE = frozenset(
    {JointEffect.PIN_UNDER_LOAD, JointEffect.SPEED_DEPENDENCE, JointEffect.EFFORT_LIMIT}
)
"""Laws of friction, and of drives that give way, that the adapters do not represent."""
COMMON_EFFECTS = ALL_EFFECTS - LAWS_OF_THE_REFERENCE - {JointEffect.ONE_SIDED}
"""Constant bounds in slip and at rest, and damping: for adapters that set such a bound in each step."""
LAWS = frozenset({JointEffect.SWITCHING_LAW})
"""Laws of time of every type, for adapters that evaluate laws by `stiction.scenes.laws.evaluate_law`."""
EFFECTS_WITH_LOADS = COMMON_EFFECTS | {JointEffect.ONE_SIDED}
"""The same and springs of one side, for engines to which the adapter applies springs as loads."""


def effects_of(joint: Joint | Drive | Spring | Load) -> list[JointEffect]:
    """Return the effects that an element declares; a bound of zero is no effect."""
    if isinstance(joint, Drive | Force | Torque):
        effects = [JointEffect.SWITCHING_LAW] if _is_switching(joint.law) else []
        if isinstance(joint, Drive) and joint.is_limited:
            effects.append(JointEffect.EFFORT_LIMIT)
        return effects
    if isinstance(joint, LinearSpring | TorsionalSpring):
        return [] if joint.acts is None else [JointEffect.ONE_SIDED]
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
    """Return the first element with an effect that is not supported, and that effect; None if there is none."""
    sections = (scene.joints, scene.drives, scene.springs, scene.forces)
    elements = [element for section in sections for element in section.items()]
    for name, element in elements:
        for effect in effects_of(element):
            if effect not in supported:
                return name, effect
    return None


def _is_switching(law: Law) -> bool:
    """Return True if a law is more than a constant, a line, a sine, or a table with natural ends and without steps."""
    if isinstance(law, Table):
        return law.ends == "clamped" or bool(law.steps)
    return isinstance(law, (Sum, *MOVES))


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
