"""A scene read as a mechanism: its structure, its exact numbers, and whether its start is one of the mechanism's."""

from __future__ import annotations

from collections.abc import Iterable

from flint import arb

from stiction.comparisons.proof.enclosures.exact import ZERO, Exact, ExactScene
from stiction.comparisons.proof.mechanisms.mechanism import ProvableMechanism, SineLoad
from stiction.comparisons.truth.truth import NotThisMechanism
from stiction.scenes import Scene
from stiction.scenes.laws import Constant, Sine

CENTRE = (0, 0)
_PLACES = {"x": ("position", 0), "y": ("position", 1), "vx": ("velocity", 0), "vy": ("velocity", 1),
           "angle": ("angle",), "omega": ("angular_velocity",)}
"""Where a scene has the start of a body's columns."""


def fits(element: object, kind: type, **expected: object) -> bool:
    """Return whether an element of a scene is of a kind, each of its named values as expected.

    What is expected of a value is another one that it equals, or a function that is true of it.
    """
    return isinstance(element, kind) and all(wanted(getattr(element, name)) if callable(wanted)
                                             else getattr(element, name) == wanted
                                             for name, wanted in expected.items())


def along_x(vector: tuple[float, float] | None) -> bool:
    """Return whether a vector has the direction (1, 0)."""
    return vector is not None and vector[0] > 0 and vector[1] == 0


def dot(a: tuple[Exact, Exact], b: tuple[Exact, Exact]) -> Exact:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1]


def balls(values: Iterable[Exact]) -> tuple[arb, ...]:
    """Balls that contain exact numbers."""
    return tuple(value.ball for value in values)


class SceneReader:
    """A scene that may be a mechanism, with its exact numbers.

    Parameters
    ----------
    scene
        To be read at the working precision.
    mechanism
        Its kind in words ("a pendulum").
    """

    def __init__(self, scene: Scene, mechanism: str):
        self.scene, self.mechanism, self.exact = scene, mechanism, ExactScene(scene)

    def require(self, condition: bool, text: str) -> None:
        """Check a part of the structure.

        Raises
        ------
        NotThisMechanism
            With what was expected, where the condition is false.
        """
        if not condition:
            raise NotThisMechanism(f"{self.scene.name} is not {self.mechanism}: {text}")

    def gravity(self) -> tuple[Exact, Exact]:
        """Gravity, m/s^2; zero where the scene has none."""
        return self.exact.vector("gravity") if self.scene.gravity is not None else (ZERO, ZERO)

    def law(self, key: str) -> tuple[Exact, tuple[SineLoad, ...]]:
        """What is constant of a load, and its sine where it has one; requires its law to be one of the two."""
        law, path = self.scene.forces[key].law, ("forces", key, "law")
        self.require(isinstance(law, Constant | Sine), f"forces.{key}: expected a constant or a sine")
        if isinstance(law, Constant):
            return self.exact(*path, "value"), ()
        sine = SineLoad(*(self.exact(*path, part).ball for part in ("amplitude", "frequency", "phase")))
        return self.exact(*path, "offset"), (sine,)

    def require_start(self, mechanism: ProvableMechanism, zero: Iterable[Exact]) -> None:
        """Check, as far as balls show, that all bodies start where the mechanism has them and that numbers are zero."""
        differences = [value.ball for value in zero]
        for column, ball in mechanism.bodies(arb(0), mechanism.q, mechanism.v).items():
            name, _, part = column.rpartition(".")
            if name in self.scene.bodies:
                differences.append(ball - self.exact("bodies", name, *_PLACES[part]).ball)
        self.require(all(ball.contains(0) for ball in differences), "bodies: the start violates the constraints")
