"""Structures of scenes, by which a truth recognizes the mechanism that it applies to.

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
from stiction.scenes.model import (
    Drive,
    Force,
    LinearSpring,
    Revolute,
    Torque,
    TorsionalSpring,
    Translational,
)
from stiction.scenes.wording import shown
from stiction.truths.truth import NotThisMechanism


@dataclass(frozen=True)
class Condition:
    """A condition on a value.

    Attributes
    ----------
    words : str
        The condition in words, for messages.
    holds : callable
        Returns True for a value that fulfils the condition.
    """

    words: str
    holds: Callable[[Any], bool]

    @classmethod
    def of(cls, wanted: Any) -> Condition:
        """Return the condition that a value is an instance of a class, equals a value, or fulfils a condition.

        `wanted` is the class, the value or the condition, or a tuple of these for the elements of a tuple.
        """
        if isinstance(wanted, Condition):
            return wanted
        if isinstance(wanted, type | UnionType):
            names = " or ".join(kind.__name__ for kind in get_args(wanted) or (wanted,))
            return cls(names, lambda value: isinstance(value, wanted))
        if isinstance(wanted, tuple):
            parts = [cls.of(part) for part in wanted]

            def holds(value: Any) -> bool:
                if value is None:
                    return False
                return all(part.holds(element) for part, element in zip(parts, value))

            return cls(f"[{', '.join(part.words for part in parts)}]", holds)
        return cls(shown(wanted), lambda value: value == wanted)

    def misfit(self, name: str, value: Any) -> Iterator[str]:
        """Yield a message for a value that does not fulfil the condition."""
        if not self.holds(value):
            # A law is shown by its type, because its numbers are not wrong.
            actual = getattr(value, "type", None) or shown(value)
            yield f"{name}: found {actual}; expected {self.words}"


ANY = Condition("any", lambda value: True)
"""Condition that every value fulfils."""
POSITIVE = Condition("> 0", lambda value: value is not None and value > 0)
"""Condition on a positive number."""
NEGATIVE = Condition("< 0", lambda value: value < 0)
"""Condition on a negative number."""
ABSENT = Condition("none", lambda value: not value)
"""Condition on a value that is absent or zero."""
CENTRE = (0, 0)
"""The centre of mass of a body."""
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

ONE = "one"
"""Count of a part that occurs once in a mechanism."""
OPTIONAL = "at most one"
"""Count of a part that may be missing."""
SEVERAL = "any number"
"""Count of a part that may occur any number of times."""

JOINT_EFFECTS = ("friction", "static_friction", "stribeck_velocity", "damping")
"""Fields of joints that must be absent or zero unless a part has requirements on them."""
PIN_EFFECTS = ("mu", "mus")
"""Such fields of pins: their friction by load."""
OTHER_EFFECTS: Mapping[type, tuple[str, ...]] = {
    Revolute: (*JOINT_EFFECTS, *PIN_EFFECTS),
    Translational: (*JOINT_EFFECTS, "normal_load", "clearance"),
    Drive: ("effort_limit",),
    LinearSpring: ("acts",),
    TorsionalSpring: ("acts",),
}
"""Fields, by kind of the element, that must be absent or zero unless a part has requirements on them."""


class Part:
    """An element of a mechanism.

    A joint must have neither a constant bound of friction nor damping nor clearance, a drive no limit, and a spring
    must act on both sides, unless their fields say otherwise: a truth holds for the effects that it contains.

    Parameters
    ----------
    kind : type
        Class of the element.
    *bodies : str
        Roles of the bodies that it connects or acts on, in their order.
    name : str, optional
        Name of the element; any name if None.
    count : str
        `ONE`, `OPTIONAL` or `SEVERAL`.
    any_order : bool
        True if the bodies may be listed in either order.
    where : Condition
        Condition on the whole element.
    **fields
        Requirements on fields of the element, in the sense of `Condition.of`.
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
        self.kind = kind
        self.bodies = bodies
        self.name = name
        self.count = count
        self.any_order = any_order
        self.where = where
        absent = dict.fromkeys(OTHER_EFFECTS.get(kind, ()), ABSENT)
        self.fields = {
            field: Condition.of(wanted) for field, wanted in {**absent, **fields}.items()
        }

    def bind(self, name: str, element: Any, roles: Mapping[str, str]) -> Mapping[str, str] | None:
        """Return the bodies by role after the bodies of an element are added; None if the element is another part."""
        if not isinstance(element, self.kind) or self.name not in (None, name):
            return None
        bodies = _bodies(element)
        bound = dict(roles)
        if self.any_order and bodies[0] != self.bodies[0]:
            bodies = bodies[::-1]
        for role, body in zip(self.bodies, bodies):
            if (role == GROUND) != (body == GROUND):
                return None
            # If another body has the role already, the element belongs to another part.
            if bound.setdefault(role, body) != body:
                return None
        return bound

    def misfits(self, name: str, element: Any) -> Iterator[str]:
        """Yield a message for each field of an element that is not as required."""
        for field, condition in self.fields.items():
            yield from condition.misfit(f"{name}.{field}", getattr(element, field))
        if not self.where.holds(element):
            yield f"{name}: expected {self.where.words}"


@dataclass(frozen=True)
class Match:
    """The parts of a mechanism in a scene.

    Attributes
    ----------
    bodies : Mapping
        Names of the bodies by role.
    elements : Mapping
        Elements by the label of their part, then by name.
    """

    bodies: Mapping[str, str]
    elements: Mapping[str, Mapping[str, Any]]

    def __getitem__(self, label: str) -> Any:
        """Return the element of a part; None if the scene has none."""
        return next(iter(self.elements[label].values()), None)

    def name(self, label: str) -> str:
        """Return the name of the element of a part; raise KeyError if the scene has none."""
        if not self.elements[label]:
            raise KeyError(f"{label}: found none; expected an element of the scene")
        return next(iter(self.elements[label]))


@dataclass(frozen=True)
class Structure:
    """The structure of a mechanism, by which its scenes are recognized.

    Attributes
    ----------
    mechanism : str
        The mechanism in messages, such as "a pendulum".
    bodies : tuple of str
        Roles of the bodies, which are also their names unless `any_names` is set.
    parts : Mapping
        All other elements by a label.
    gravity
        Requirement on the gravity of the scene, in the sense of `Condition.of`.
    any_names : bool
        True if the bodies may have any names.
    """

    mechanism: str
    bodies: tuple[str, ...]
    parts: Mapping[str, Part]
    gravity: Any = ANY
    any_names: bool = False

    def match(self, scene: Scene) -> Match:
        """Return the parts in a scene; raise NotThisMechanism with everything that does not fit."""
        # With fixed names every role is known. Otherwise the elements assign bodies to the roles one
        # after the other.
        fixed = () if self.any_names else self.bodies
        roles: Mapping[str, str] = {name: name for name in (GROUND, *fixed)}
        faults = list(Condition.of(self.gravity).misfit("gravity", scene.gravity))
        if len(scene.bodies) != len(self.bodies) or not (
            self.any_names or set(scene.bodies) == set(self.bodies)
        ):
            faults.append(
                f"bodies: found {', '.join(scene.bodies)}; expected {', '.join(self.bodies)}"
            )
        # Each part takes its elements out of `others`. The remaining ones belong to no part.
        others = {**scene.joints, **scene.drives, **scene.springs, **scene.forces}
        elements: dict[str, dict[str, Any]] = {label: {} for label in self.parts}
        for label, part in self.parts.items():
            for name, element in list(others.items()):
                bound = part.bind(name, element, roles)
                if bound is not None and (part.count == SEVERAL or not elements[label]):
                    elements[label][name] = others.pop(name)
                    roles = bound
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
    """Return the bodies that an element connects or acts on."""
    if isinstance(element, (Force, Torque)):
        return (element.body,)
    return element.bodies
