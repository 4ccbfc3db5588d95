"""Physics that a truth and an engine share: the joints with friction, and the coefficients of these."""

from __future__ import annotations

from typing import Any

from stiction.scenes import Scene, vary


def rubbing_joints(scene: Scene) -> frozenset[str]:
    """Return the joints with friction and the drives that can give way.

    Their contact modes change the motion, and their events count in every truth.
    """
    return frozenset(name for name, element in scene.bounded_elements.items() if element.rubs)


def physics_of(scene: Scene, static_coefficient: bool) -> Scene:
    """Return the scene with the physics of an engine.

    Unless the engine has a static coefficient, every joint has mus = mu and static_friction = friction.
    """
    overrides = physics_overrides(scene, static_coefficient)
    if not overrides:
        return scene
    return vary(scene, overrides)


def physics_overrides(scene: Scene, static_coefficient: bool) -> dict[str, Any]:
    """Return the values in which the scene of `physics_of` differs from the scene, by their paths."""
    if static_coefficient:
        return {}
    overrides: dict[str, Any] = {
        f"{name}.mus": joint.mu for name, joint in scene.joints.items() if joint.mus is not None
    }
    overrides |= {
        f"{name}.static_friction": joint.friction
        for name, joint in scene.joints.items()
        if joint.static_friction is not None
    }
    return overrides


def physics_over_values(scene: Scene, static_coefficient: bool) -> Scene:
    """Return the scene with the physics of an engine, to vary values of it.

    Unless the engine has a static coefficient, no joint has one: static friction then follows kinetic friction,
    whatever its value. In `physics_of` it has the value that the scene's kinetic friction has.
    """
    if static_coefficient:
        return scene
    removed = [f"{name}.mus" for name, guide in scene.guides.items() if guide.mus is not None]
    removed += [
        f"{name}.static_friction"
        for name, joint in scene.joints.items()
        if joint.static_friction is not None
    ]
    return vary(scene, dict.fromkeys(removed)) if removed else scene
