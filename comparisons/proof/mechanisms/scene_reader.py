"""A scene read as a mechanism: its exact numbers, and whether its start is one of the mechanism's."""

from __future__ import annotations

from collections.abc import Iterable

from flint import arb

from stiction.comparisons.proof.enclosures.exact import ZERO, Exact, ExactScene
from stiction.comparisons.proof.mechanisms.mechanism import ProvableMechanism, SineLoad
from stiction.comparisons.truth.structure import Structure
from stiction.scenes import Scene
from stiction.scenes.laws import Constant

_PLACES = {"x": ("position", 0), "y": ("position", 1), "vx": ("velocity", 0), "vy": ("velocity", 1),
           "angle": ("angle",), "omega": ("angular_velocity",)}
"""Place of the start of a body's columns in a scene."""


def balls(values: Iterable[Exact]) -> tuple[arb, ...]:
    """Balls that contain exact numbers."""
    return tuple(value.ball for value in values)


class SceneReader(ExactScene):
    """A scene of some structure; raises NotThisMechanism, naming what keeps the scene from having it."""

    def __init__(self, scene: Scene, structure: Structure):
        super().__init__(scene)
        self.structure, self.found = structure, structure.match(scene)

    def require(self, condition: bool, text: str) -> None:
        """Check what a structure cannot say; raises NotThisMechanism with what was expected."""
        if not condition:
            raise self.structure.misfit(self.scene, text)

    def body(self, role: str, *path: str | int) -> Exact:
        """A number of a body."""
        return self("bodies", self.found.bodies[role], *path)

    def part(self, section: str, label: str, *path: str | int) -> Exact:
        """A number of a part of the structure; zero where the scene has no such part."""
        name = next(iter(self.found.elements.get(label, ())), None)
        return ZERO if name is None else self(section, name, *path)

    def gravity(self) -> tuple[Exact, Exact]:
        """Gravity, m/s^2; zero where the scene has none."""
        return self.vector("gravity") if self.scene.gravity is not None else (ZERO, ZERO)

    def place(self, role: str, field: str) -> tuple[Exact, Exact]:
        """The position or velocity of a body."""
        return self.vector("bodies", self.found.bodies[role], field)

    def loads(self, label: str) -> tuple[Exact, tuple[SineLoad, ...]]:
        """The sum of what is constant of some loads, whose laws are constants or sines, and the sines."""
        total, sines = ZERO, []
        for key, load in self.found.elements[label].items():
            path = ("forces", key, "law")
            if isinstance(load.law, Constant):
                total = total + self(*path, "value")
            else:
                total = total + self(*path, "offset")
                sines.append(SineLoad(*(self(*path, part).ball for part in ("amplitude", "frequency", "phase"))))
        return total, tuple(sines)

    def require_start(self, mechanism: ProvableMechanism, zero: Iterable[Exact]) -> None:
        """Check, as far as balls show, that all bodies start where the mechanism has them and that numbers are zero."""
        differences = [value.ball for value in zero]
        for column, ball in mechanism.bodies(arb(0), mechanism.q, mechanism.v).items():
            name, _, part = column.rpartition(".")
            if name in self.scene.bodies:
                differences.append(ball - self("bodies", name, *_PLACES[part]).ball)
        self.require(all(ball.contains(0) for ball in differences), "bodies: the start violates the constraints")
