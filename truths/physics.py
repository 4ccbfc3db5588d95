"""Physics that a truth and an engine share: the guides with friction, and the coefficients of these."""

from __future__ import annotations

from stiction.scenes import Scene, vary


def rubbing_guides(scene: Scene) -> frozenset[str]:
    """Return the guides with friction. Their contact modes change the motion, and their events count in every truth."""
    return frozenset(
        name for name, guide in scene.frictional_guides.items() if guide.static_coefficient > 0
    )


def physics_of(scene: Scene, static_coefficient: bool) -> Scene:
    """Return the scene with the physics of an engine: mus = mu on every guide unless it has a static coefficient."""
    overrides = {
        f"{name}.mus": guide.mu
        for name, guide in scene.frictional_guides.items()
        if guide.mus is not None
    }
    if static_coefficient or not overrides:
        return scene
    return vary(scene, overrides)
