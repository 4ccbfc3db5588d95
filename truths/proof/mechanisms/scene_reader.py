"""A scene read as a mechanism: its parts with exact numbers, and whether its start is one of the mechanism's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from flint import arb

from stiction.scenes import Scene
from stiction.scenes.laws import Constant
from stiction.truths.proof.enclosures.exact import ZERO, Exact, ExactPart, exact_scene
from stiction.truths.proof.mechanisms.mechanism import Load, ProvableMechanism
from stiction.truths.structure import Structure

_PLACES = {
    "x": lambda body: body.position[0],
    "y": lambda body: body.position[1],
    "vx": lambda body: body.velocity[0],
    "vy": lambda body: body.velocity[1],
    "angle": lambda body: body.angle,
    "omega": lambda body: body.angular_velocity,
}
"""The start of a body's columns."""
_SECTIONS = ("joints", "drives", "springs", "forces")
"""Tables of a scene that hold its elements."""


def balls(values: Iterable[Exact]) -> tuple[arb, ...]:
    """Balls that contain exact numbers."""
    return tuple(value.ball for value in values)


class SceneReader:
    """A scene of some structure; raises NotThisMechanism, naming what keeps the scene from having it."""

    def __init__(self, scene: Scene, structure: Structure):
        self.scene, self.structure, self.match = scene, structure, structure.match(scene)
        self.numbers = exact_scene(scene)
        self.gravity = (ZERO, ZERO) if scene.gravity is None else tuple(self.numbers.gravity)
        self.t_end = self.numbers.t_end.ball

    def require(self, condition: bool, text: str) -> None:
        """Check what a structure cannot say; raises NotThisMechanism with what was expected."""
        if not condition:
            raise self.structure.misfit(self.scene, text)

    def body(self, role: str) -> ExactPart:
        """A body of the structure."""
        return self.numbers.bodies[self.match.bodies[role]]

    def elements(self, label: str) -> dict[str, ExactPart]:
        """The elements of a part of the structure, by name."""
        elements = {}
        for name in self.match.elements.get(label, ()):
            [section] = [section for section in _SECTIONS if name in getattr(self.scene, section)]
            elements[name] = self.numbers[section][name]
        return elements

    def __getitem__(self, label: str) -> Any:
        """Return the element of a part; None where the scene has none."""
        return next(iter(self.elements(label).values()), None)

    def loads(self, label: str) -> tuple[Exact, tuple[Load, ...]]:
        """The sum of what is constant of some loads, whose laws are constants or sines, and the sines."""
        total, sines = ZERO, []
        for name, load in self.elements(label).items():
            if isinstance(self.scene.forces[name].law, Constant):
                total = total + load.law.value
            else:
                total = total + load.law.offset
                sines.append(
                    _sine(*balls((load.law.amplitude, load.law.frequency, load.law.phase)))
                )
        return total, tuple(sines)

    def require_start(self, mechanism: ProvableMechanism, zero: Iterable[Exact]) -> None:
        """Check, as far as balls show, that all bodies start where the mechanism has them and that numbers are zero."""
        # Balls that contain zero are no proof of equality, but the start of a scene in floats has
        # none: the mechanism's own start is what the proof is about, and this excludes scenes that
        # start elsewhere.
        differences = [value.ball for value in zero]
        for column, ball in mechanism.bodies(arb(0), mechanism.q, mechanism.v).items():
            name, _, part = column.rpartition(".")
            if name in self.scene.bodies:
                differences.append(ball - _PLACES[part](self.numbers.bodies[name]).ball)
        self.require(
            all(ball.contains(0) for ball in differences),
            "bodies: the start violates the constraints",
        )


def _sine(amplitude: arb, frequency: arb, phase: arb) -> Load:
    return lambda t: amplitude * (frequency * t + phase).sin()
