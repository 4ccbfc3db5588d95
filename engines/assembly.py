"""The mechanisms of one run: a scene is assembled once, for its engine and for the gate behind it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from stiction.scenes import Scene

if TYPE_CHECKING:
    from stiction.reference_impl.multibody.mechanism import Mechanism


@dataclass(frozen=True)
class Assembly:
    """A scene and its mechanisms, without stabilization, each created when it is first used.

    `stiction.engines.Engine.simulate` makes one for each run and passes it to `run` of engines with a parameter of this
    name. The arrays of a mechanism must not be written to: engine, adapter and gate share them.
    """

    scene: Scene

    @cached_property
    def parts(self) -> list[Mechanism]:
        """Mechanisms of the independent parts; one of many parts may be too large as a whole."""
        # imported here because it compiles kernels, which commands that only list engines do not need
        from stiction.reference_impl.multibody.mechanism import Mechanism
        from stiction.reference_impl.multibody.subsystems import independent_parts

        return [Mechanism(part, stabilization="none") for part in independent_parts(self.scene)]

    @cached_property
    def whole(self) -> Mechanism:
        """The mechanism of the whole scene, which is that of its part if there is only one."""
        from stiction.reference_impl.multibody.mechanism import Mechanism

        if len(self.parts) == 1:
            return self.parts[0]
        return Mechanism(self.scene, stabilization="none")

    @cached_property
    def size(self) -> float:
        """Length of the largest mechanism, m."""
        return max(part.arrays.length_scale for part in self.parts)


def assembly_of(scene: Scene, given: Assembly | None) -> Assembly:
    """Return the assembly that a run was given, or a new one if it was given none.

    Raises
    ------
    ValueError
        If the assembly is that of another scene.
    """
    if given is None:
        return Assembly(scene)
    if given.scene is not scene:
        raise ValueError(
            f"assembly: found that of scene {given.scene.name!r}; expected that of {scene.name!r}, "
            "the same object"
        )
    return given
