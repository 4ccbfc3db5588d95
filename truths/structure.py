"""Structures of scenes: the elements of a mechanism, and their positions and directions.

A truth declares which scenes it applies to by a `Structure`. `Structure.match` finds the parts of
the mechanism in a scene, or raises an error that lists everything that does not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Any, get_args

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Force, Revolute, Torque, Translational
from stiction.scenes.wording import shown
from stiction.truths.truth import NotThisMechanism


@dataclass(frozen=True)
class Condition:
    """A condition on a value, and its words in a message."""

    words: str
    holds: Callable[[Any], bool]

    @classmethod
    def of(cls, wanted: Any) -> Condition:
        """Make a condition from what is wanted: a condition itself, a class, a value, or a tuple of these."""
        if isinstance(wanted, Condition):
            return wanted
        if isinstance(wanted, type | UnionType):
            names = " or ".join(kind.__name__ for kind in get_args(wanted) or (wanted,))
            return cls(names, lambda value: isinstance(value, wanted))
        if isinstance(wanted, tuple):
            parts = [cls.of(part) for part in wanted]
            return cls(
                f"[{', '.join(part.words for part in parts)}]",
                lambda value: (
                    value is not None
                    and all(part.holds(inner) for part, inner in zip(parts, value))
                ),
            )
        return cls(shown(wanted), lambda value: value == wanted)

    def misfit(self, name: str, value: Any) -> Iterator[str]:
        """Describe a value for which the condition does not hold."""
        if not self.holds(value):
            # a law is shown by its type: its numbers are not what is wrong
            actual = getattr(value, "type", None) or shown(value)
            yield f"{name}: found {actual}; expected {self.words}"


ANY = Condition("any", lambda value: True)
POSITIVE = Condition("> 0", lambda value: value > 0)
NEGATIVE = Condition("< 0", lambda value: value < 0)
ABSENT = Condition("none", lambda value: not value)
CENTRE = (0, 0)
FORWARD = (POSITIVE, 0)
"""A direction along the x axis."""
ON_X_AXIS = (ANY, 0)
"""A point of the x axis."""
PULLS_ALONG_X = Condition(
    "axis [> 0, 0], or none and rest_length 0",
    lambda spring: (
        spring.rest_length == 0 if spring.axis is None else Condition.of(FORWARD).holds(spring.axis)
    ),
)
"""Condition on a spring between two points of the x axis."""

ONE, OPTIONAL, SEVERAL = "one", "at most one", "any number"
"""How often a part occurs in a mechanism."""


JOINT_EFFECTS = ("friction", "static_friction", "damping")
"""Fields of joints that a truth takes only where it says so."""


class Part:
    """An element of a mechanism: its class, and the roles of the bodies that it connects or acts on, in their order.

    If `name` is None, the element may have any name. With `any_order` its bodies may be listed in
    either order. `where` is a condition on the whole element; each of the `fields` is a requirement
    in the sense of `Condition.of`. A joint must have neither a constant bound of friction nor damping,
    unless the fields say otherwise: a truth holds for the effects that it contains.
    """

    def __init__(
        self,
        kind: type,
        *bodies: str,
        name: str | None = None,
        count: str = ONE,
        any_order: bool = False,
        where: Condition = ANY,
        **fields: Any,
    ):
        self.kind, self.bodies, self.name, self.count = kind, bodies, name, count
        self.any_order, self.where = any_order, where
        absent = dict.fromkeys(JOINT_EFFECTS, ABSENT) if kind in (Revolute, Translational) else {}
        self.fields = {
            field: Condition.of(wanted) for field, wanted in {**absent, **fields}.items()
        }

    def bind(self, name: str, element: Any, roles: Mapping[str, str]) -> Mapping[str, str] | None:
        """Return the bodies by role, with those of an element; None where the element is another part."""
        if not isinstance(element, self.kind) or self.name not in (None, name):
            return None
        bodies, bound = _bodies(element), dict(roles)
        if self.any_order and bodies[0] != self.bodies[0]:
            bodies = bodies[::-1]
        for role, body in zip(self.bodies, bodies):
            if (role == GROUND) != (body == GROUND):
                return None
            # a role that is already another body's: the element is that of another part
            if bound.setdefault(role, body) != body:
                return None
        return bound

    def misfits(self, name: str, element: Any) -> Iterator[str]:
        """Describe which fields of an element are not as required."""
        for field, condition in self.fields.items():
            yield from condition.misfit(f"{name}.{field}", getattr(element, field))
        if not self.where.holds(element):
            yield f"{name}: expected {self.where.words}"


@dataclass(frozen=True)
class Match:
    """The parts of a mechanism in a scene: names of bodies by role, and elements by part and name."""

    bodies: Mapping[str, str]
    elements: Mapping[str, Mapping[str, Any]]

    def __getitem__(self, label: str) -> Any:
        """Return the element of a part; None where the scene has none."""
        return next(iter(self.elements[label].values()), None)

    def name(self, label: str) -> str:
        """Return the name of the element of a part; raises KeyError where the scene has none."""
        if not self.elements[label]:
            raise KeyError(f"{label}: found none; expected an element of the scene")
        return next(iter(self.elements[label]))


@dataclass(frozen=True)
class Structure:
    """The structure of a mechanism, by which scenes of it are recognized.

    `mechanism` is its name in messages, such as "a pendulum". `bodies` are the roles of its bodies,
    which are also their names unless `any_names` is set. `parts` contains all other elements by a
    label. `gravity` is the requirement on the gravity of the scene, like that on a field of a
    `Part`.
    """

    mechanism: str
    bodies: tuple[str, ...]
    parts: Mapping[str, Part]
    gravity: Any = ANY
    any_names: bool = False

    def match(self, scene: Scene) -> Match:
        """Find the parts in a scene; raises NotThisMechanism, naming everything that does not fit."""
        # With fixed names every role is known; else the elements bind the roles to bodies one after
        # the other.
        fixed = () if self.any_names else self.bodies
        roles: Mapping[str, str] = {name: name for name in (GROUND, *fixed)}
        faults = list(Condition.of(self.gravity).misfit("gravity", scene.gravity))
        if len(scene.bodies) != len(self.bodies) or not (
            self.any_names or set(scene.bodies) == set(self.bodies)
        ):
            faults.append(
                f"bodies: found {', '.join(scene.bodies)}; expected {', '.join(self.bodies)}"
            )
        # Each part takes its elements out of `others`; what remains there belongs to no part.
        others = {**scene.joints, **scene.drives, **scene.springs, **scene.forces}
        elements: dict[str, dict[str, Any]] = {label: {} for label in self.parts}
        for label, part in self.parts.items():
            for name, element in list(others.items()):
                bound = part.bind(name, element, roles)
                if bound is not None and (part.count == SEVERAL or not elements[label]):
                    elements[label][name], roles = others.pop(name), bound
                    faults += part.misfits(name, element)
            if part.count == ONE and not elements[label]:
                faults.append(
                    f"{label}: found none; expected a {part.kind.__name__} of {' and '.join(part.bodies)}"
                )
        faults += [
            f"{name}: found a {type(element).__name__} of {' and '.join(_bodies(element))}; expected none"
            for name, element in others.items()
        ]
        if faults:
            raise self.misfit(scene, *faults)
        return Match(roles, elements)

    def misfit(self, scene: Scene, *faults: str) -> NotThisMechanism:
        """Return the error for a scene that is not this mechanism."""
        return NotThisMechanism(f"{scene.name} is not {self.mechanism}:\n  " + "\n  ".join(faults))


def _bodies(element: Any) -> tuple[str, ...]:
    return (element.body,) if isinstance(element, (Force, Torque)) else element.bodies
