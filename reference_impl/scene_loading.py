"""Loading of scenes with an initial state that satisfies the constraints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stiction import scenes
from stiction.scenes import Scene


def load_scene(
    name_or_path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    assemble: bool = False,
) -> Scene:
    """Read a scene from the catalogue (by name) or from a TOML file (by path).

    A file may describe a scene by its differences from another one: ``base`` names a scene of the
    catalogue or a file (relative to this one), ``set`` contains overrides, and ``unset`` lists keys to
    remove.

    Parameters
    ----------
    name_or_path
        The name of a scene of the catalogue, such as ``"slider-bar-case-1"``, or the path of a TOML
        file.
    overrides
        Values that replace those of the file, by key: a parameter (``"F0"``), a key of an element
        (``"motor.rate"``, ``"guide.mu"``, ``"bar.position.0"``) or a full path
        (``"bodies.bar.mass"``, ``"gravity.1"``). The value None removes the key.
    assemble
        If the initial state violates the constraints, project it onto them: close loops, and adapt
        the velocities to joints and drives. Otherwise the scene is returned as it is.

    Returns
    -------
    Scene
        The validated scene; all quantities are in SI units, angles in radians.

    Raises
    ------
    SceneError
        If the scene cannot be used, or cannot be assembled. The message lists all problems.
    """
    scene = scenes.load_scene(name_or_path, overrides)
    return assembled(scene) if assemble else scene


def assembled(scene: Scene) -> Scene:
    """Return a scene whose initial state satisfies the constraints: loops are closed.

    Parameters
    ----------
    scene
        A scene whose initial positions are near those of a closed mechanism. They are projected onto the constraints in
        the metric of the mass matrix, and the velocities are adapted to joints and drives.

    Raises
    ------
    SceneError
        If the mechanism cannot be assembled from this state.
    """
    # The kernels take long to import, and most callers do not need them.
    from stiction.reference_impl.multibody.initial_state import with_consistent_start

    return with_consistent_start(scene, assemble=True)
