"""Physics that a truth and an engine share: the joints with friction, and the coefficients of these."""

from __future__ import annotations

from stiction.scenes import Scene, vary


def rubbing_joints(scene: Scene) -> frozenset[str]:
    """Return the joints with friction. Their contact modes change the motion, and their events count in every truth."""
    return frozenset(name for name, joint in scene.joints.items() if joint.rubs)


def physics_of(scene: Scene, static_coefficient: bool) -> Scene:
    """Return the scene with the physics of an engine.

    Unless the engine has a static coefficient, every joint has mus = mu and static_friction = friction.
    """
    if static_coefficient:
        return scene
    overrides = {
        f"{name}.mus": joint.mu for name, joint in scene.joints.items() if joint.mus is not None
    }
    overrides |= {
        f"{name}.static_friction": joint.friction
        for name, joint in scene.joints.items()
        if joint.static_friction is not None
    }
    if not overrides:
        return scene
    return vary(scene, overrides)
