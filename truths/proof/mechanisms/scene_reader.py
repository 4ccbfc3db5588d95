"""Read a scene as a mechanism: its parts in exact numbers, and a check of its start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from flint import arb

from stiction.scenes import Scene
from stiction.scenes.laws import Constant
from stiction.truths.proof.enclosures.exact import ZERO, Exact, ExactPart, exact_scene
from stiction.truths.proof.mechanisms.mechanism import Load, ProvableMechanism
from stiction.truths.structure import Structure

_STARTS: Mapping[str, Callable[[ExactPart], Exact]] = {
    "x": lambda body: body.position[0],
    "y": lambda body: body.position[1],
    "vx": lambda body: body.velocity[0],
    "vy": lambda body: body.velocity[1],
    "angle": lambda body: body.angle,
    "omega": lambda body: body.angular_velocity,
}
"""Value at t = 0 that a scene gives a body, by the column of the body."""
_SECTIONS = ("joints", "drives", "springs", "forces")
"""Tables of a scene that hold its elements."""
_SHOWN_DIGITS = 6
"""Digits of the numbers in messages."""


def balls(values: Iterable[Exact]) -> tuple[arb, ...]:
    """Return balls that contain exact numbers."""
    return tuple(value.ball for value in values)


class SceneReader:
    """A scene that has a given structure, with its numbers as they are written.

    Parameters
    ----------
    scene : Scene
        The scene to read.
    structure : Structure
        The structure of the mechanism.

    Raises
    ------
    NotThisMechanism
        If the scene does not have the structure; the error names everything that does not fit.
    """

    def __init__(self, scene: Scene, structure: Structure):
        self.scene = scene
        self.structure = structure
        self.match = structure.match(scene)
        self.numbers = exact_scene(scene)
        self.gravity = (ZERO, ZERO) if scene.gravity is None else tuple(self.numbers.gravity)
        self.t_end = self.numbers.t_end.ball

    def require(self, condition: bool, text: str) -> None:
        """Check what a structure cannot express; raise NotThisMechanism with `text` if it fails."""
        if not condition:
            raise self.structure.misfit(self.scene, text)

    def body(self, role: str) -> ExactPart:
        """Return the body that has a role in the structure."""
        return self.numbers.bodies[self.match.bodies[role]]

    def elements(self, label: str) -> dict[str, ExactPart]:
        """Return the elements of a part of the structure, by name."""
        elements = {}
        for name in self.match.elements.get(label, ()):
            [section] = [section for section in _SECTIONS if name in getattr(self.scene, section)]
            elements[name] = self.numbers[section][name]
        return elements

    def element(self, label: str) -> ExactPart:
        """Return the only element of a part; raise ValueError if it has none or several."""
        element = self.optional_element(label)
        if element is None:
            raise ValueError(f"{label}: found no element; expected one")
        return element

    def optional_element(self, label: str) -> ExactPart | None:
        """Return the only element of a part, or None; raise ValueError if it has several."""
        elements = self.elements(label)
        if len(elements) > 1:
            raise ValueError(f"{label}: found {', '.join(elements)}; expected at most one element")
        for element in elements.values():
            return element
        return None

    def loads(self, label: str) -> tuple[Exact, tuple[Load, ...]]:
        """Return the constant part of the sum of some loads, and its sines one by one.

        The laws of the loads are constants or sines.
        """
        constant = ZERO
        sines = []
        for name, load in self.elements(label).items():
            law = load.law
            if isinstance(self.scene.forces[name].law, Constant):
                constant = constant + law.value
            else:
                constant = constant + law.offset
                sines.append(_sine(*balls((law.amplitude, law.frequency, law.phase))))
        return constant, tuple(sines)

    def require_start(self, mechanism: ProvableMechanism, residuals: Mapping[str, Exact]) -> None:
        """Reject a scene whose bodies start elsewhere than those of the mechanism.

        An enclosure that contains zero does not prove equality. The proof is about the start of the
        mechanism, and a scene whose start is rounded to floats does not equal it; this check merely
        rejects scenes that start elsewhere.

        Parameters
        ----------
        mechanism : ProvableMechanism
            The mechanism as read from the scene.
        residuals : mapping of str to Exact
            Numbers that are zero if the start meets the constraints, by what they are.

        Raises
        ------
        NotThisMechanism
            With every column and residual that is not zero, and by how much.
        """
        differences = {name: value.ball for name, value in residuals.items()}
        for column, ball in mechanism.bodies(arb(0), mechanism.q, mechanism.v).items():
            body, _, quantity = column.rpartition(".")
            if body in self.scene.bodies:
                start = _STARTS[quantity](self.numbers.bodies[body])
                differences[column] = ball - start.ball
        violations = [
            f"{name} off by {difference.str(_SHOWN_DIGITS, radius=False)}"
            for name, difference in differences.items()
            if not difference.contains(0)
        ]
        self.require(
            not violations,
            f"bodies: found {', '.join(violations)}; expected a start that meets the constraints",
        )


def _sine(amplitude: arb, frequency: arb, phase: arb) -> Load:
    """Return the load amplitude sin(frequency t + phase)."""
    return lambda t: amplitude * (frequency * t + phase).sin()
